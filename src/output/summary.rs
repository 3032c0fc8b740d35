//! `summary.json`: a run in numbers.

use serde::Serialize;

use super::measures::ContactMeasures;
use super::spectrum::power_above;
use crate::Vec3;
use crate::contact::law::Mode;
use crate::device::coupled::DeviceView;
use crate::local::condensation::CondensationCounts;
use crate::model::work::WorkCounts;
use crate::multirate::failsafe::Fault;
use crate::multirate::timeline::{DeadlineOutcome, OverrunPolicy};
use crate::pipeline::TickView;
use crate::scene::Scene;

/// Frequencies above this count as ripple, Hz.
const RIPPLE_HZ: f64 = 100.0;

/// What one tick leaves for plots and the summary.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// s.
    pub time: f64,
    /// N.
    pub force: Vec3,
    /// F_N, N.
    pub normal_force: f64,
    /// F_T, N.
    pub tangential_force: f64,
    /// What the contact did.
    pub mode: Mode,
}

impl Summary {
    /// Whether the run is one to believe: it reached its duration and nothing passed through the
    /// surface unfelt.
    pub fn passes(&self) -> bool {
        self.completed && self.tunnelling_ticks == 0
    }
}

/// Collects a run tick by tick.
///
/// ```
/// use stickslip::{output::summary::Recorder, pipeline, scene::Scene};
///
/// // the tip meets the block after 80
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let mut recorder = Recorder::default();
/// pipeline::run(&scene, |tick| recorder.record(tick))?;
/// let summary = recorder.summary(&scene, None, 0.1);
/// assert!(summary.passes());
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
    work: WorkCounts,
    condensation: Option<CondensationCounts>,
    timing: Option<Lateness>,
    device: Option<DeviceSummary>,
}

/// Counts what was late.
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

/// What was late, and what that did. Of a run with deadlines.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct TimingSummary {
    /// From a tick's release, s.
    pub deadline_s: f64,
    /// What a missed one does.
    pub overrun: OverrunPolicy,
    /// Ticks whose force came after it.
    pub late_ticks: u64,
    /// Ticks left out.
    pub skipped_ticks: u64,
    /// Late or left out, one after the other.
    pub longest_missed_run: u64,
    /// Models that came into use after the first.
    pub models_used: u64,
    /// Boundaries whose model was never used: left out, or still under way at the end.
    pub models_not_used: u64,
    /// Ticks.
    pub largest_model_age: u64,
    /// Root mean square over all ticks of what was commanded less what the contact asked for, N. What a different past
    /// does to the contact is not in it.
    pub withheld_force_rms_n: f64,
}

/// What a modelled device went through.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct DeviceSummary {
    /// Ticks that ended with a command changed by a limit of force or current.
    pub saturated_ticks: u64,
    /// Ticks that ended with a mean force above what the device can sustain.
    pub overheated_ticks: u64,
    /// Ticks that ended with a command changed by passivity control.
    pub passivity_control_ticks: u64,
    /// What the hand got at the stylus, less what it gave.
    pub energy_to_hand_j: f64,
    /// Its maximum over time, at least 0, where it starts: above 0, the hand got more than it had given. Motors can do
    /// that, and so can the links' weight.
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

/// Ticks in each mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct ModeTicks {
    /// No force.
    pub free: u64,
    /// Held.
    pub stick: u64,
    /// Frictionless or rigid.
    pub slide: u64,
    /// At the Coulomb bound.
    pub slip: u64,
}

/// The energy balance at the end of a run, J.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct EnergySummary {
    /// What the instrument put in.
    pub work_j: f64,
    /// Σ |f·Δq|.
    pub absolute_work_j: f64,
    /// Change of kinetic, elastic and gravitational energy within ticks.
    pub stored_j: f64,
    /// By dampers and drag.
    pub damping_loss_j: f64,
    /// By slipping.
    pub friction_loss_j: f64,
    /// By impacts, under the velocity scheme.
    pub impact_loss_j: f64,
    /// Work − stored − dissipated: what the scheme and the exterior made or lost.
    pub residual_j: f64,
    /// Relative to Σ |f·Δq|; 0 without work.
    pub residual_relative: f64,
}

impl EnergySummary {
    /// Whether the residual is no more than Σ |f·Δq|, where there was contact. The geometric scheme moves nodes without
    /// work; in shipped scenes that end without a fault the residual is 0.39 of it at most.
    pub fn is_plausible(&self) -> bool {
        self.absolute_work_j == 0.0 || self.residual_j.abs() <= self.absolute_work_j
    }
}

/// A run in numbers.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Its scene.
    pub scene: String,
    /// Of the program.
    pub version: &'static str,
    /// Whether it reached its duration.
    pub completed: bool,
    /// The fault that ended it, if one did.
    pub fault: Option<String>,
    /// What the scene did not need.
    pub left_out: Vec<String>,
    /// Rows of the trace.
    pub ticks: u64,
    /// By mode.
    pub mode_ticks: ModeTicks,
    /// Share of stick and slip ticks that stick; absent without friction.
    pub stick_share: Option<f64>,
    /// Times the tip met the surface.
    pub collisions: u64,
    /// Contact losses as [`ContactMeasures`] defines them.
    pub contact_losses: u64,
    /// Times a contact ended.
    pub releases: u64,
    /// Ticks with a contact kept under tension.
    pub tension_ticks: u64,
    /// Ticks in which the contact was rigid: its point had left the free nodes of the patch.
    pub patch_exits: u64,
    /// Ticks with the tip inside the surface, no force and no contact kept, by [`ContactMeasures`]; must be 0.
    pub tunnelling_ticks: u64,
    /// Ticks in which the law had no solution for the contact's response and sliding was solved in its place.
    pub fallback_ticks: u64,
    /// N.
    pub largest_force_n: f64,
    /// N.
    pub largest_normal_force_n: f64,
    /// N.
    pub largest_tangential_force_n: f64,
    /// Largest force jump as [`ContactMeasures`] defines it, N.
    pub largest_force_jump_n: f64,
    /// Its tick.
    pub largest_force_jump_tick: Option<u64>,
    /// Changes of mode.
    pub mode_switches_per_s: f64,
    /// Mean square of the force above 100 Hz, N².
    pub force_power_above_100_hz_n2: f64,
    /// The energy balance.
    pub energy: EnergySummary,
    /// What was computed.
    pub work: WorkCounts,
    /// What became of a condensed exterior; absent where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condensation: Option<CondensationCounts>,
    /// What was late; absent without deadlines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<TimingSummary>,
    /// What the modelled device went through; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceSummary>,
    /// Of the run with its outputs.
    pub wall_time_s: f64,
}

impl Recorder {
    /// Takes in a tick.
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
        let residual = energy.residual();
        self.energy = EnergySummary {
            work_j: energy.work,
            absolute_work_j: energy.absolute_work,
            stored_j: energy.stored,
            damping_loss_j: energy.damping_loss,
            friction_loss_j: energy.friction_loss,
            impact_loss_j: energy.impact_loss,
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

    /// Every tick so far.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// The run in numbers.
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
        Summary {
            scene: scene.name.clone(),
            version: env!("CARGO_PKG_VERSION"),
            completed: fault.is_none(),
            fault: fault.map(ToString::to_string),
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
            fallback_ticks: self.fallback_ticks,
            largest_force_n: largest(|sample| sample.force.norm()),
            largest_normal_force_n: largest(|sample| sample.normal_force),
            largest_tangential_force_n: largest(|sample| sample.tangential_force),
            largest_force_jump_n: jump.newtons,
            largest_force_jump_tick: jump.tick,
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
            wall_time_s,
        }
    }
}
