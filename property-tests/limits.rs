//! Limits of what a run commands and computes.

use stickslip::multirate::failsafe::FaultCause;
use stickslip::pipeline::{self, RunError};
use stickslip::scene::Scene;

fn shipped(name: &str) -> Scene {
    Scene::shipped(name).expect("shipped with the program")
}

/// The first force beyond the limit is a fault, and its tick commands nothing.
#[test]
fn no_force_beyond_the_limit_is_commanded() {
    let mut scene = shipped("fig3-sliding");
    assert_eq!(scene.largest_contact_force_n(), 850.0); // a hundred times the device's 8.5 N
    scene.force_limit_n = 0.7;
    let mut largest = 0.0_f64;
    let end = pipeline::run(&scene, |tick| largest = largest.max(tick.force.norm()));
    let Err(RunError::Fault(fault)) = end else { panic!("a force above 0.7 N passed") };
    let FaultCause::ForceTooLarge { newtons, limit_n } = fault.cause else { panic!("{fault}") };
    assert!(newtons > 0.7 && limit_n == 0.7 && largest <= 0.7 && largest > 0.5, "{newtons} {largest}");
}

/// Energies that are not finite are a fault, even if positions, velocities and forces are finite.
#[test]
fn an_energy_that_overflows_ends_the_run() {
    let scene = Scene::parse(
        "name = 'huge'\nduration = 0.1\n[mesh]\nnodes = [9, 9, 4]\nspacing = 1e60\n[contact]\nlaw = 'sliding'\n\
         [material]\nnode_mass = 1e200\nstiffness = 100.0\ndamping = 0.0\ngravity = [0.0, 0.0, -1e63]\n\
         [instrument]\nwaypoints = [[0.0, 0.0, 0.0, 1e61]]\n",
        "huge.toml".as_ref(),
    )
    .expect("every value is finite");
    let mut seen_finite = true;
    let end = pipeline::run(&scene, |tick| seen_finite &= tick.energy.is_finite());
    let Err(RunError::Fault(fault)) = end else { panic!("an infinite energy passed: {end:?}") };
    assert!(seen_finite && matches!(fault.cause, FaultCause::EnergyNotFinite), "{fault}");
}
