//! A contact law of one's own: Coulomb friction with a ceiling, F_T ≤ min(μF_N, F_max).
//!
//! Run it with `cargo run --example own_law`.

use stickslip::{ContactLaw, Law, Mode, RunError, Scene, Vec3};

/// Coulomb friction up to a largest tangential force, as of a lubricated surface.
#[derive(Debug)]
struct Lubricated {
    friction: f64,
    largest_n: f64,
}

impl ContactLaw for Lubricated {
    fn contact_force(&self, reaction: Vec3, normal: Vec3) -> (Mode, Vec3) {
        let normal_force = reaction.dot(&normal);
        let tangential = reaction - normal * normal_force;
        let bound = (self.friction * normal_force).min(self.largest_n);
        if tangential.norm() <= bound {
            (Mode::Stick, reaction)
        } else {
            (Mode::Slip, normal * normal_force + tangential.normalize() * bound)
        }
    }
}

fn main() -> Result<(), RunError> {
    let mut scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
    scene.contact.law = Law::Own(&Lubricated { friction: 1.0, largest_n: 0.05 });
    let (mut peak_n, mut slips) = (0.0_f64, 0);
    stickslip::run(&scene, |tick| {
        peak_n = peak_n.max(tick.tangential_force());
        slips += u32::from(tick.report.mode == Mode::Slip);
    })?;
    println!("largest tangential force {peak_n:.3} N, {slips} ticks of slip");
    assert!((peak_n - 0.05).abs() < 1e-12 && slips > 500);
    Ok(())
}
