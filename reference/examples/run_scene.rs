//! A scene built in Rust, run, and its peak force: a tip that is pressed into a soft block and drawn across it.

use std::error::Error;

use stickslip::{
    Block, ContactSurface, Law, Material, MeshSource, Scene, Scheme, Stencil, TipPath, Vec3, Waypoint, run,
};

fn main() -> Result<(), Box<dyn Error>> {
    // 10 cm × 10 cm × 4 cm, its top at z = 0, its bottom layer fixed.
    let mesh = MeshSource::from(Block { nodes: [9, 9, 4], spacing: 0.0125, stencil: Stencil::Shear });
    let material = Material::uniform(mesh.node_count(), 0.01, 100.0, 0.5);
    let at = |time, x, z| Waypoint { time, position: Vec3::new(x, 0.0013, z) };
    let path = TipPath::new(vec![at(0.0, -0.03, 0.002), at(0.2, -0.03, -0.003), at(0.6, -0.01, -0.003)])?;

    let scene = Scene::new("pressed-and-drawn", mesh, material, Law::StickSlip { friction: 0.5.into() }, path)?
        .with_surface(ContactSurface::Subdivision)
        .with_scheme(Scheme::Velocity)
        .with_global_rate_hz(50.0)?;

    let (mut peak_n, mut slipping) = (0.0_f64, 0_u64);
    run(&scene, |tick| {
        peak_n = peak_n.max(tick.force.norm());
        slipping += u64::from(tick.report.mode.name() == "slip");
    })?;
    println!(
        "{}: peak force {peak_n:.3} N, slipping in {slipping} of {} ticks over {} s",
        scene.name,
        scene.tick_count(),
        scene.duration_s()
    );

    // A block pushed in by 3 mm at its middle gives way with several newtons per centimetre.
    assert!(peak_n > 0.3 && peak_n < 3.0, "{peak_n} N");
    assert!(slipping > 0 && slipping < scene.tick_count());
    Ok(())
}
