//! `summary.json`: the quantities of a run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;

use super::measures::ContactMeasures;
use super::spectrum::power_above;
use super::verdict::RunVerdict;
use crate::Vec3;
use crate::contact::law::Mode;
use crate::device::coupled::DeviceView;
use crate::local::condensation::CondensationCounts;
use crate::local::model::Linearization;
use crate::model::springs::TangentKind;
use crate::model::work::WorkCounts;
use crate::multirate::failsafe::{Fault, FaultCause};
use crate::multirate::timeline::{DeadlineOutcome, OverrunPolicy};
use crate::pipeline::TickView;
use crate::scene::{Scene, Warning};

/// Frequency above which a force counts as ripple, Hz.
const RIPPLE_HZ: f64 = 100.0;

/// Quantities of one tick for plots and the summary.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Time at the end of the tick, s.
    pub time: f64,
    /// Force commanded to the instrument, N.
    pub force: Vec3,
    /// Normal force F_N, N.
    pub normal_force: f64,
    /// Tangential force F_T, N.
    pub tangential_force: f64,
    /// Contact state.
    pub mode: Mode,
}

impl Summary {
    /// Returns the number of ticks in contact.
    pub fn contact_ticks(&self) -> u64 {
        self.ticks - self.mode_ticks.free
    }

    /// Records how a run in real time ended, in the summary of its repetition in virtual time.
    pub fn add_real_time(&mut self, is_reproduced: bool, is_stopped: bool) {
        self.reproduced = Some(is_reproduced);
        self.completed &= is_reproduced && !is_stopped;
        self.verdict = RunVerdict::of(self);
    }

    /// Applies changes that are known only after the run, such as warnings or that it was stopped, and updates the verdict.
    pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self.verdict = RunVerdict::of(&self);
        self
    }
}

/// Recorder of a run's ticks.
///
/// ```
/// use stickslip::{output::{summary::Recorder, verdict::Verdict}, pipeline, scene::Scene};
///
/// // The tip meets the block after 80 ticks.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let mut recorder = Recorder::default();
/// pipeline::run(&scene, |tick| recorder.record(tick))?;
/// let summary = recorder.summary(&scene, None, 0.1);
/// assert_eq!(summary.verdict.verdict, Verdict::Pass);
/// assert_eq!((summary.ticks, summary.mode_ticks.free, summary.collisions), (150, 80, 1));
/// // Without friction the force is along the normal.
/// let samples = recorder.samples();
/// assert!(samples[149].normal_force > 0.1 && samples[149].tangential_force < 1e-12);
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
#[derive(Debug, Default)]
pub struct Recorder {
    samples: Vec<Sample>,
    contact: ContactMeasures,
    releases: u64,
    collisions: u64,
    tension_ticks: u64,
    patch_exits: u64,
    fallback_ticks: u64,
    energy: EnergySummary,
    /// Ticks in which friction helped the tip along, and its energy, J.
    friction_assist: (u64, f64),
    contact_energy_created_j: f64,
    work: WorkCounts,
    condensation: Option<CondensationCounts>,
    timing: Option<Lateness>,
    device: Option<DeviceSummary>,
}

/// Counts of late ticks, skipped ticks and models.
#[derive(Debug, Clone, Copy, Default)]
struct Lateness {
    late_ticks: u64,
    skipped_ticks: u64,
    missed_run: u64,
    longest_missed_run: u64,
    models_used: u64,
    largest_model_age: u64,
    /// Σ |commanded − contact force|², N².
    withheld: f64,
}

impl Lateness {
    fn take(&mut self, view: &TickView) {
        let missed = match view.deadline_outcome {
            DeadlineOutcome::OnTime => false,
            DeadlineOutcome::Late(_) => {
                self.late_ticks += 1;
                true
            }
            DeadlineOutcome::Skipped => {
                self.skipped_ticks += 1;
                true
            }
        };
        self.missed_run = if missed { self.missed_run + 1 } else { 0 };
        self.longest_missed_run = self.longest_missed_run.max(self.missed_run);
        self.models_used += u64::from(view.model_age == 0 && view.tick > 0);
        self.largest_model_age = self.largest_model_age.max(view.model_age);
        if missed {
            self.withheld += (view.force - view.report.force).norm_squared();
        }
    }
}

/// Deadline outcomes of a run with deadlines, and their effects.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct TimingSummary {
    /// Deadline after a tick's release, s.
    pub deadline_s: f64,
    /// Policy for a missed deadline.
    pub overrun: OverrunPolicy,
    /// Ticks whose force came after the deadline.
    pub late_ticks: u64,
    /// Ticks skipped.
    pub skipped_ticks: u64,
    /// Largest number of successive ticks that were late or skipped.
    pub longest_missed_run: u64,
    /// Local models that came into use after the first one.
    pub models_used: u64,
    /// Cycle boundaries whose model was never used: it was skipped, or not complete at the end.
    pub models_not_used: u64,
    /// Largest age of a model in use, ticks.
    pub largest_model_age: u64,
    /// Root mean square over all ticks of the commanded force less the contact force, N. It does not contain the effect
    /// that missed deadlines have on later contact.
    pub withheld_force_rms_n: f64,
}

/// Quantities of a modelled device over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct DeviceSummary {
    /// Ticks whose command was changed by a limit of force or current.
    pub saturated_ticks: u64,
    /// Ticks with a mean force above what the device can sustain.
    pub overheated_ticks: u64,
    /// Ticks whose command was changed by passivity control.
    pub passivity_control_ticks: u64,
    /// Net energy that the hand received at the stylus, J.
    pub energy_to_hand_j: f64,
    /// Maximum over time of the net energy to the hand, J; at least 0, its value at the start. Above 0, the hand
    /// received more than it had given, from the motors or from the weight of the links.
    pub largest_energy_to_hand_j: f64,
}

impl DeviceSummary {
    fn take(&mut self, device: &DeviceView) {
        self.saturated_ticks += u64::from(device.is_saturated);
        self.overheated_ticks += u64::from(device.overheats);
        self.passivity_control_ticks += u64::from(device.is_damped);
        self.energy_to_hand_j = device.energy_to_hand_j;
        self.largest_energy_to_hand_j = self.largest_energy_to_hand_j.max(device.energy_to_hand_j);
    }
}

/// Number of ticks in each mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct ModeTicks {
    /// Ticks without force.
    pub free: u64,
    /// Sticking ticks.
    pub stick: u64,
    /// Sliding ticks: frictionless or rigid contact.
    pub slide: u64,
    /// Slipping ticks, at the Coulomb bound.
    pub slip: u64,
}

/// Energy balance at the end of a run.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct EnergySummary {
    /// Work of the instrument, J.
    pub work_j: f64,
    /// Absolute work of the instrument, Σ |f·Δq|, J.
    pub absolute_work_j: f64,
    /// Change of kinetic, elastic and gravitational energy within ticks, J.
    pub stored_j: f64,
    /// Energy dissipated by dampers and drag, J.
    pub damping_loss_j: f64,
    /// Energy dissipated by slipping, J.
    pub friction_loss_j: f64,
    /// Energy dissipated by impacts under the velocity and the massless scheme, J.
    pub impact_loss_j: f64,
    /// Kinetic energy of the contact point along the directions that the massless scheme holds, J.
    pub contact_kinetic_j: f64,
    /// Energy that the mesh received from that contact point without work of the instrument, J.
    pub contact_exchange_j: f64,
    /// Energy residual, work + contact_kinetic + contact_exchange − stored − dissipated, J. Scheme and exterior generate
    /// energy if it is negative.
    pub residual_j: f64,
    /// Energy residual over Σ |f·Δq|; 0 without work.
    pub residual_relative: f64,
}

/// Quantities of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Name of the scene.
    pub scene: String,
    /// Changes of single keys that the scene was read with, in their order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
    /// Version of the program.
    pub version: &'static str,
    /// Whether the run reached its duration.
    pub completed: bool,
    /// Whether the repetition of a run in real time, which the trace records, commanded the same forces to the bit; absent
    /// in virtual time. If it did not, the trace is not that of the run, and the run does not count as completed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reproduced: Option<bool>,
    /// The fault that ended it, if one did.
    pub fault: Option<String>,
    /// Verdict on the run, derived from the other fields.
    pub verdict: RunVerdict,
    /// Warnings before and after the run.
    pub warnings: Vec<Warning>,
    /// Parts of the pipeline that the scene does not need.
    pub left_out: Vec<String>,
    /// Library of the renderer that took the local model's place; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub renderer: Option<PathBuf>,
    /// Number of ticks, each a row of the trace.
    pub ticks: u64,
    /// Number of ticks in each mode.
    pub mode_ticks: ModeTicks,
    /// Share of stick and slip ticks that stick; absent without friction.
    pub stick_share: Option<f64>,
    /// Number of collisions of the tip with the surface.
    pub collisions: u64,
    /// Number of contact losses, as [`ContactMeasures`] defines them.
    pub contact_losses: u64,
    /// Number of contacts that ended.
    pub releases: u64,
    /// Ticks with a contact kept under tension.
    pub tension_ticks: u64,
    /// Ticks with a rigid contact: its point had left the free nodes of the patch.
    pub patch_exits: u64,
    /// Ticks with the tip inside the surface, no force and no contact kept, as [`ContactMeasures`] defines them; 0 in a
    /// run that passes.
    pub tunnelling_ticks: u64,
    /// 1 if the run ended because the patch folded over the tip ([`FaultCause::PatchFolded`]), else 0.
    pub patch_folded: u64,
    /// Ticks in which the law had no solution for the contact's response and sliding was solved instead.
    pub fallback_ticks: u64,
    /// Largest commanded force, N.
    pub largest_force_n: f64,
    /// Largest normal force, N.
    pub largest_normal_force_n: f64,
    /// Largest tangential force, N.
    pub largest_tangential_force_n: f64,
    /// Largest force jump as [`ContactMeasures`] defines it, N.
    pub largest_force_jump_n: f64,
    /// Tick of the largest force jump; absent if the force never changed in contact.
    pub largest_force_jump_tick: Option<u64>,
    /// Largest force jump where contact begins or ends, N.
    pub largest_force_jump_at_ends_n: f64,
    /// Ticks in which friction pushed the tip along its motion over the surface.
    pub friction_assist_ticks: u64,
    /// Energy that friction gave to the instrument in those ticks, J.
    pub friction_assist_j: f64,
    /// Energy that the massless scheme left in the mesh without work of the instrument, J: the sum of the positive changes
    /// of `contact_exchange`. Zero under the other schemes.
    pub contact_energy_created_j: f64,
    /// Mode switches per second of simulated time, 1/s.
    pub mode_switches_per_s: f64,
    /// Mean square of the force above 100 Hz, N².
    pub force_power_above_100_hz_n2: f64,
    /// Energy balance at the end.
    pub energy: EnergySummary,
    /// Counts of the work done.
    pub work: WorkCounts,
    /// Outcomes of static condensation; absent without a condensed exterior.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condensation: Option<CondensationCounts>,
    /// Deadline outcomes; absent without deadlines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<TimingSummary>,
    /// Quantities of the modelled device; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceSummary>,
    /// What may help against an energy residual, of what the scene does not have.
    #[serde(skip)]
    pub energy_advice: String,
    /// SHA-256 of every other file of the run, by its name. A file with another hash belongs to another run.
    pub files: BTreeMap<&'static str, String>,
    /// Wall-clock time of the run and its output, s.
    pub wall_time_s: f64,
}

impl Recorder {
    /// Records a tick.
    pub fn record(&mut self, view: &TickView) {
        let report = view.report;
        self.contact.record(view);
        self.releases += u64::from(report.released);
        self.collisions += u64::from(report.collision_time.is_some());
        self.patch_exits += u64::from(report.rigid);
        self.fallback_ticks += u64::from(report.fell_back);
        self.tension_ticks += u64::from(report.mode == Mode::Free && view.local.contact().is_some());
        if view.has_deadlines {
            self.timing.get_or_insert_default().take(view);
        }
        if let Some(device) = &view.device {
            self.device.get_or_insert_default().take(device);
        }
        self.work = view.work;
        self.condensation = view.condensation;
        let energy = view.energy;
        self.friction_assist = (energy.friction_assist_ticks, energy.friction_assist);
        self.contact_energy_created_j = energy.contact.created;
        let residual = energy.residual();
        self.energy = EnergySummary {
            work_j: energy.work,
            absolute_work_j: energy.absolute_work,
            stored_j: energy.stored,
            damping_loss_j: energy.damping_loss,
            friction_loss_j: energy.friction_loss,
            impact_loss_j: energy.impact_loss,
            contact_kinetic_j: energy.contact.kinetic,
            contact_exchange_j: energy.contact.exchanged,
            residual_j: residual,
            residual_relative: if energy.absolute_work > 0.0 { residual / energy.absolute_work } else { 0.0 },
        };
        self.samples.push(Sample {
            time: view.time,
            force: view.force,
            normal_force: view.normal_force(),
            tangential_force: view.tangential_force(),
            mode: report.mode,
        });
    }

    /// Returns the samples of all ticks so far.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Computes the summary.
    pub fn summary(&self, scene: &Scene, fault: Option<&Fault>, wall_time_s: f64) -> Summary {
        let samples = &self.samples;
        let count = |mode: Mode| samples.iter().filter(|sample| sample.mode == mode).count() as u64;
        let mode_ticks = ModeTicks {
            free: count(Mode::Free),
            stick: count(Mode::Stick),
            slide: count(Mode::Slide),
            slip: count(Mode::Slip),
        };
        let largest = |of: fn(&Sample) -> f64| samples.iter().map(of).fold(0.0, f64::max);
        let (contact, jump) = (&self.contact, self.contact.largest_force_jump());
        let forces: Vec<Vec3> = samples.iter().map(|sample| sample.force).collect();
        let frictional = mode_ticks.stick + mode_ticks.slip;
        let time = samples.last().map_or(0.0, |sample| sample.time);
        let summary = Summary {
            scene: scene.name.clone(),
            changes: scene.changes(),
            version: env!("CARGO_PKG_VERSION"),
            completed: fault.is_none(),
            reproduced: None,
            fault: fault.map(ToString::to_string),
            verdict: RunVerdict::nothing(),
            warnings: Vec::new(),
            renderer: scene.renderer().map(|library| library.path().to_owned()),
            left_out: scene.parts().iter().filter(|part| !part.needed).map(|part| part.to_string()).collect(),
            ticks: samples.len() as u64,
            mode_ticks,
            stick_share: (frictional > 0).then(|| mode_ticks.stick as f64 / frictional as f64),
            collisions: self.collisions,
            contact_losses: contact.contact_losses(),
            releases: self.releases,
            tension_ticks: self.tension_ticks,
            patch_exits: self.patch_exits,
            tunnelling_ticks: contact.tunnelling_ticks(),
            patch_folded: u64::from(fault.is_some_and(|fault| matches!(fault.cause, FaultCause::PatchFolded { .. }))),
            fallback_ticks: self.fallback_ticks,
            largest_force_n: largest(|sample| sample.force.norm()),
            largest_normal_force_n: largest(|sample| sample.normal_force),
            largest_tangential_force_n: largest(|sample| sample.tangential_force),
            largest_force_jump_n: jump.newtons,
            largest_force_jump_tick: jump.tick,
            largest_force_jump_at_ends_n: contact.largest_force_jump_at_ends().newtons,
            friction_assist_ticks: self.friction_assist.0,
            friction_assist_j: self.friction_assist.1,
            contact_energy_created_j: self.contact_energy_created_j,
            mode_switches_per_s: if time > 0.0 { contact.mode_switches() as f64 / time } else { 0.0 },
            force_power_above_100_hz_n2: power_above(&forces, scene.local_rate_hz(), RIPPLE_HZ),
            energy: self.energy,
            work: self.work,
            condensation: self.condensation,
            timing: self.timing.map(|late| {
                let ticks = samples.len() as u64;
                let boundaries = ticks.saturating_sub(1) / u64::from(scene.ticks_per_cycle());
                TimingSummary {
                    deadline_s: scene.deadline.after,
                    overrun: scene.deadline.overrun,
                    late_ticks: late.late_ticks,
                    skipped_ticks: late.skipped_ticks,
                    longest_missed_run: late.longest_missed_run,
                    models_used: late.models_used,
                    models_not_used: boundaries.saturating_sub(late.models_used),
                    largest_model_age: late.largest_model_age,
                    withheld_force_rms_n: (late.withheld / ticks as f64).sqrt(),
                }
            }),
            device: self.device,
            energy_advice: energy_advice(scene),
            files: BTreeMap::new(),
            wall_time_s,
        };
        summary.with(|_| ())
    }
}

/// Lists what may help against an energy residual and is not set yet.
fn energy_advice(scene: &Scene) -> String {
    let mut ways = vec!["a smaller drag"];
    if !scene.is_full() {
        ways.push("a higher `global.rate`");
        if scene.local().linearization == Linearization::Tangent(TangentKind::Exact) {
            ways.push("`local.tangent = \"stabilised\"`");
        }
    }
    if !scene.contact.scheme.is_impulsive() {
        ways.push("`contact.scheme = \"massless\"` with `contact.surface = \"subdivision\"`");
    }
    format!("compare with {}", ways.join(", "))
}
