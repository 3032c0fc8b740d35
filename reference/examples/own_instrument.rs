//! An instrument of one's own: a stylus of 50 g on a spring that follows a target, instead of a path or the modelled
//! PHANTOM.
//!
//! Run it with `cargo run --example own_instrument`.

use stickslip::{Instrument, InstrumentFault, OwnParts, RunError, Scene, Simulation, Vec3};

const MASS_KG: f64 = 0.05;
const STIFFNESS_N_PER_M: f64 = 200.0;
const DAMPING_N_S_PER_M: f64 = 3.0;

/// A point mass that a spring pulls to a target, which comes down at 20 mm/s.
#[derive(Debug, Clone)]
struct Stylus {
    position: Vec3,
    velocity: Vec3,
    commanded: Vec3,
}

impl Stylus {
    fn target(time_s: f64) -> Vec3 {
        Vec3::new(0.0, 0.0013, (0.002 - 0.02 * time_s).max(-0.006))
    }
}

impl Instrument for Stylus {
    fn start(&self) -> Vec3 {
        self.position
    }

    fn sense(&mut self, begin_s: f64, end_s: f64, _contact_force: &Vec3) -> Result<Vec3, InstrumentFault> {
        let h = end_s - begin_s;
        let pull = (Self::target(end_s) - self.position) * STIFFNESS_N_PER_M - self.velocity * DAMPING_N_S_PER_M;
        self.velocity += (pull + self.commanded) * (h / MASS_KG);
        self.position += self.velocity * h;
        Ok(self.position)
    }

    fn command(&mut self, contact_force: &Vec3) -> Vec3 {
        self.commanded = *contact_force;
        self.commanded
    }

    fn release(&mut self) {
        self.commanded = Vec3::zeros();
    }
}

fn main() -> Result<(), RunError> {
    let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
    let stylus = Stylus { position: Stylus::target(0.0), velocity: Vec3::zeros(), commanded: Vec3::zeros() };
    let own = OwnParts { instrument: Some(Box::new(stylus)), ..OwnParts::default() };
    let mut end = (0.0, 0.0);
    Simulation::prepare_with(&scene, own)?.run(|tick| end = (tick.tip.z, tick.force.z))?;
    println!("at rest {:.2} mm deep under {:.3} N", -1e3 * end.0, end.1);
    // Spring and body share the way to the target: the spring's force is the body's.
    assert!((end.1 - (end.0 + 0.006) * STIFFNESS_N_PER_M).abs() < 0.02, "in balance");
    Ok(())
}
