//! Residuals with tolerances, repeatable random cases, and small scenes.

use std::cell::Cell;

use proptest::test_runner::{Config, RngSeed, TestCaseError, TestRunner};
use stickslip::Vec3;
use stickslip::output::measures::is_tunnelling;
use stickslip::pipeline::{self, RunError};
use stickslip::scene::Scene;

/// Largest residual of one quantity. On drop it prints a row of the cross-check table, and fails if nothing was
/// compared.
pub struct Worst {
    reference: &'static str,
    quantity: &'static str,
    tolerance: f64,
    largest: Cell<f64>,
    comparisons: Cell<u64>,
}

impl Worst {
    pub fn new(reference: &'static str, quantity: &'static str, tolerance: f64) -> Self {
        Self { reference, quantity, tolerance, largest: Cell::new(0.0), comparisons: Cell::new(0) }
    }

    /// Fails unless the residual is within the tolerance; NaN never is.
    #[track_caller]
    pub fn check(&self, residual: f64) {
        if let Err(message) = self.compare(residual) {
            panic!("{message}");
        }
    }

    /// Fails the random case, so that it is shrunk, unless the residual is within the tolerance.
    pub fn case(&self, residual: f64) -> Result<(), TestCaseError> {
        self.compare(residual).map_err(TestCaseError::fail)
    }

    fn compare(&self, residual: f64) -> Result<(), String> {
        self.comparisons.set(self.comparisons.get() + 1);
        if residual <= self.tolerance {
            self.largest.set(self.largest.get().max(residual));
            return Ok(());
        }
        Err(format!("{} | {}: {residual:e} is not within {:e}", self.reference, self.quantity, self.tolerance))
    }
}

impl Drop for Worst {
    fn drop(&mut self) {
        if self.comparisons.get() == 0 {
            assert!(std::thread::panicking(), "{} | {}: nothing was compared", self.reference, self.quantity);
            return;
        }
        println!(
            "RESIDUAL | {} | {} | {:.1e} | {:.1e}",
            self.reference,
            self.quantity,
            self.tolerance,
            self.largest.get()
        );
    }
}

#[test]
fn a_residual_that_is_none_does_not_pass() {
    let worst = || Worst::new("itself", "made to fail", 1.0);
    // This one is never dropped, and so adds no row to the table.
    let undropped = std::mem::ManuallyDrop::new(worst());
    assert!(undropped.case(f64::NAN).is_err() && undropped.case(1.1).is_err() && undropped.case(1.0).is_ok());
    let never = std::panic::catch_unwind(|| drop(worst())).expect_err("nothing was compared");
    assert!(never.downcast_ref::<String>().is_some_and(|message| message.contains("nothing was compared")));
}

/// Settings of random cases with a fixed seed, so that a failure repeats; PROPTEST_RNG_SEED and PROPTEST_CASES
/// select others.
pub fn runner(cases: u32) -> TestRunner {
    let mut config = Config { failure_persistence: None, ..Config::default() };
    if std::env::var_os("PROPTEST_CASES").is_none() {
        config.cases = cases;
    }
    if config.rng_seed == RngSeed::Random {
        config.rng_seed = RngSeed::Fixed(0x5711_C451);
    }
    TestRunner::new(config)
}

/// Force and mode of every tick.
pub struct Run {
    pub force: Vec<Vec3>,
    pub normal_force: Vec<f64>,
    pub tangential_force: Vec<f64>,
    pub mode: Vec<stickslip::contact::law::Mode>,
    pub tension_ticks: usize,
    pub tunnelling_ticks: usize,
    pub rigid_ticks: usize,
    pub releases: usize,
    pub fault: Option<stickslip::multirate::failsafe::Fault>,
}

/// Runs a scene and records force and mode of every tick.
pub fn run(scene: &Scene) -> Run {
    let mut run = Run {
        force: vec![],
        normal_force: vec![],
        tangential_force: vec![],
        mode: vec![],
        tension_ticks: 0,
        tunnelling_ticks: 0,
        rigid_ticks: 0,
        releases: 0,
        fault: None,
    };
    let end = pipeline::run(scene, |view| {
        run.force.push(view.force);
        run.normal_force.push(view.report.normal_force);
        run.tangential_force.push(view.report.tangential_force());
        run.mode.push(view.report.mode);
        run.rigid_ticks += usize::from(view.report.rigid);
        run.releases += usize::from(view.report.released);
        run.tension_ticks += usize::from(view.report.touch.is_none() && view.local.contact().is_some());
        run.tunnelling_ticks += usize::from(is_tunnelling(view));
    });
    match end {
        Ok(()) => {}
        Err(RunError::Fault(fault)) => run.fault = Some(fault),
        Err(error) => panic!("{error}"),
    }
    run
}

pub fn shipped(name: &str) -> Scene {
    Scene::shipped(name).expect("a shipped scene")
}

/// Parses the test's own scene; an error in it is a defect of the test.
pub fn scene(text: &str) -> Scene {
    Scene::parse(text, "test.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

/// Builds the scene of a small block, pressed and dragged; `extra` may replace whole tables.
pub fn small_scene(contact: &str, local: &str, waypoints: &str) -> Scene {
    scene(&format!(
        r#"
        name = "small"
        duration = 0.4
        [mesh]
        nodes = [5, 5, 3]
        spacing = 0.0125
        [material]
        node_mass = 0.01
        stiffness = 100.0
        damping = 0.5
        [local]
        {local}
        [contact]
        {contact}
        [instrument]
        waypoints = {waypoints}
        "#
    ))
}

/// Path down by 2 mm, then along x.
pub const PRESS_AND_DRAG: &str =
    "[[0.0, -0.012, 0.0013, 0.001], [0.1, -0.012, 0.0013, -0.002], [0.4, 0.012, 0.0013, -0.002]]";

pub fn relative_rms(a: &[Vec3], b: &[Vec3]) -> f64 {
    assert_eq!(a.len(), b.len(), "runs of different length");
    let sum = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>();
    let difference = sum(&mut a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()));
    (difference / sum(&mut b.iter().map(Vec3::norm_squared))).sqrt()
}
