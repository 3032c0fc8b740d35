//! Coverage of a scene's path and contact by a run: a verdict holds for nothing else.

use serde::Serialize;

use crate::contact::law::Mode;
use crate::contact::report::TickReport;
use crate::multirate::failsafe::Fault;
use crate::multirate::timeline::DeadlineOutcome;
use crate::output::summary::ModeTicks;
use crate::pipeline::Simulation;

/// Counts of what a run exercised on the servo side. Skipped ticks compute nothing and do not count.
///
/// ```
/// use stickslip::{pipeline::Simulation, realtime::exercise::Exercise, scene::Scene};
///
/// // The tip meets the block after 80 ticks, and a model is handed over after 100.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let (exercise, fault) = Exercise::of_lockstep(Simulation::prepare(&scene)?);
/// assert_eq!((exercise.mode_ticks.free, exercise.mode_ticks.slide), (80, 70));
/// assert_eq!((exercise.collisions, exercise.hand_overs, exercise.models_built), (1, 1, 1));
/// assert!(fault.is_none());
/// # Ok::<(), stickslip::SceneError>(())
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Exercise {
    /// Number of ticks in each contact mode.
    pub mode_ticks: ModeTicks,
    /// Number of collisions of the tip with the surface.
    pub collisions: u64,
    /// Number of ticks whose contact is on another triangle than in the tick before.
    pub edge_crossings: u64,
    /// Number of local models that came into use after the first one.
    pub hand_overs: u64,
    /// Number of local models that the global side built after the first one.
    pub models_built: u64,
    /// Triangle in contact in the last tick.
    #[serde(skip)]
    pub triangle: Option<u32>,
}

impl Exercise {
    /// Records a computed tick, with a new model or without.
    pub fn record(&mut self, report: &TickReport, is_hand_over: bool) {
        let ticks = match report.mode {
            Mode::Free => &mut self.mode_ticks.free,
            Mode::Stick => &mut self.mode_ticks.stick,
            Mode::Slide => &mut self.mode_ticks.slide,
            Mode::Slip => &mut self.mode_ticks.slip,
        };
        *ticks += 1;
        self.collisions += u64::from(report.collision_time.is_some());
        let triangle = report.touch.map(|touch| touch.point.triangle);
        self.edge_crossings += u64::from(self.triangle.is_some() && triangle.is_some() && triangle != self.triangle);
        self.triangle = triangle;
        self.hand_overs += u64::from(is_hand_over);
    }

    /// Runs a simulation in lockstep to its end. Returns its counts, and the fault that ended it, if one did.
    pub fn of_lockstep(simulation: Simulation) -> (Self, Option<Fault>) {
        let mut exercise = Self::default();
        let mut built = 0;
        let fault = simulation.run(|view| {
            if view.deadline_outcome != DeadlineOutcome::Skipped {
                exercise.record(view.report, view.tick > 0 && view.model_age == 0 && view.work.models_built > 1);
            }
            built = view.work.models_built.saturating_sub(1);
        });
        exercise.models_built = built;
        (exercise, fault.err())
    }

    /// Adds the counts of another run.
    pub fn add(&mut self, other: &Self) {
        let Self { mode_ticks: ModeTicks { free, stick, slide, slip }, .. } = other;
        self.mode_ticks.free += free;
        self.mode_ticks.stick += stick;
        self.mode_ticks.slide += slide;
        self.mode_ticks.slip += slip;
        self.collisions += other.collisions;
        self.edge_crossings += other.edge_crossings;
        self.hand_overs += other.hand_overs;
        self.models_built += other.models_built;
    }

    /// Returns the counts with their names, as sentences use them.
    pub fn named(&self) -> [(&'static str, u64); 8] {
        let ModeTicks { free, stick, slide, slip } = self.mode_ticks;
        [
            ("free ticks", free),
            ("sticking ticks", stick),
            ("sliding ticks", slide),
            ("slipping ticks", slip),
            ("collisions", self.collisions),
            ("crossed edges", self.edge_crossings),
            ("hand-overs of a model", self.hand_overs),
            ("models built", self.models_built),
        ]
    }
}
