//! Force of a run compared with that of the whole network at the haptic rate, as far as that is affordable.

use serde::Serialize;

use crate::contact::law::Mode;
use crate::device::instrument::InstrumentKind;
use crate::output::summary::Sample;
use crate::output::time_steps::TimeSteps;
use crate::pipeline::{Lockstep, Simulation};
use crate::scene::Scene;
use crate::verify::surfaces::whole;

/// Largest number of springs that the reference evaluates over all ticks: some seconds of one core. A scene of 2,000
/// springs and 1,200 ticks evaluates less than a hundredth of it.
const AFFORDABLE: u64 = 400_000_000;
/// Least number of ticks in contact for a comparison.
const LEAST_CONTACT_TICKS: usize = 20;

/// A run compared with its reference over its first ticks.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShortReference {
    /// The forces were compared.
    Compared {
        /// Number of ticks compared.
        ticks: u64,
        /// Root mean square of the forces' difference over that of the reference.
        force_error_rms_rel: f64,
    },
    /// There is no reference, for this reason.
    None(String),
}

impl ShortReference {
    /// Runs the whole network of a scene at the haptic rate with the same contact, and compares the force of `samples`, the
    /// ticks of the scene's run.
    ///
    /// ```
    /// use stickslip::{output::summary::Recorder, pipeline, scene::Scene, verify::short_reference::ShortReference};
    ///
    /// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(300);
    /// let mut recorder = Recorder::default();
    /// pipeline::run(&scene, |tick| recorder.record(tick))?;
    /// let error = ShortReference::of(&scene, recorder.samples()).force_error().expect("a small network");
    /// assert!(error > 0.01 && error < 0.3, "{error}"); // one ring in a fixed exterior is too stiff
    /// let full = ShortReference::of(&scene.with_full_model(), recorder.samples());
    /// assert!(matches!(full, ShortReference::None(reason) if reason.contains("is the whole network")));
    /// # Ok::<(), pipeline::RunError>(())
    /// ```
    pub fn of(scene: &Scene, samples: &[Sample]) -> Self {
        let none = |reason: &str| Self::None(reason.to_owned());
        if scene.is_full() {
            return none("the scene is the whole network at the haptic rate");
        }
        if matches!(scene.instrument, InstrumentKind::Phantom(_)) {
            return none("a device in a hand takes another path under another force");
        }
        let reference = whole(scene, scene.surface, scene.contact.scheme);
        let simulation = match Simulation::prepare(&reference) {
            Ok(simulation) => simulation,
            Err(error) => return Self::None(format!("the whole network cannot start: {error}")),
        };
        let springs = simulation.network().springs.len().max(1) as u64;
        let ticks = (samples.len() as u64).min(AFFORDABLE / springs);
        let own = &samples[..ticks as usize];
        let touches = own.iter().filter(|sample| sample.mode != Mode::Free).count();
        if touches < LEAST_CONTACT_TICKS {
            return Self::None(format!(
                "the whole network of {springs} springs can be run for {ticks} ticks, of which only {touches} are in contact"
            ));
        }
        let step = TimeSteps::where_in_doubt(&reference, &simulation).local;
        if step.is_beyond() {
            return Self::None(format!("the whole network is unstable at the haptic rate: {}", step.text()));
        }
        let (mut difference, mut square) = (0.0, 0.0);
        let mut run = Lockstep::new(simulation);
        for sample in own {
            match run.step() {
                Ok(Some(view)) => {
                    difference += (sample.force - view.force).norm_squared();
                    square += view.force.norm_squared();
                }
                Ok(None) => break,
                Err(fault) => return Self::None(format!("the whole network ends in a fault: {fault}")),
            }
        }
        if !(square > 0.0) {
            return none("the whole network exerts no force");
        }
        Self::Compared { ticks, force_error_rms_rel: (difference / square).sqrt() }
    }

    /// Returns the relative force error, if there was a comparison.
    pub fn force_error(&self) -> Option<f64> {
        match self {
            Self::Compared { force_error_rms_rel, .. } => Some(*force_error_rms_rel),
            Self::None(_) => None,
        }
    }
}
