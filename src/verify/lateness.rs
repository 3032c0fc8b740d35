//! Effect of missed deadlines on a scene: the run repeated in virtual time with increasing shares of late ticks, under
//! every policy, compared with the run without late ticks.

use serde::Serialize;

use crate::Vec3;
use crate::multirate::failsafe::Fault;
use crate::multirate::timeline::{Cost, Costs, DeadlineOutcome, DrawnTimes, OverrunPolicy, Timeline};
use crate::output::measures::ContactMeasures;
use crate::pipeline::{RunError, Simulation};
use crate::scene::Scene;

/// Shares of ticks that are made late.
pub const SHARES: [f64; 3] = [0.001, 0.01, 0.1];
/// Duration of a late tick, in ticks: under [`OverrunPolicy::Skip`], two ticks are skipped for each.
const LATE_TICKS: f64 = 2.5;
/// Seed of the random draws of late ticks.
const SEED: u64 = 0;
const POLICIES: [OverrunPolicy; 3] = [OverrunPolicy::Hold, OverrunPolicy::Zero, OverrunPolicy::Skip];

/// Result of a run with one policy and one share of late ticks.
#[derive(Debug, Clone, Serialize)]
pub struct Consequence {
    /// Policy for missed deadlines.
    pub overrun: OverrunPolicy,
    /// Share of ticks that were made late.
    pub share: f64,
    /// Numbers of late ticks and of skipped ticks.
    pub missed_ticks: [u64; 2],
    /// Root mean square of the difference of commanded forces, relative to that of the commanded force without
    /// lateness; absent if there was a fault, or no force.
    pub force_error_rms_rel: Option<f64>,
    /// Largest force jump as [`ContactMeasures`] defines it, N.
    pub largest_jump_n: f64,
    /// Contact losses as [`ContactMeasures`] defines them.
    pub contact_losses: u64,
    /// Work of the commanded force along the instrument's path, J: the energy that a hand would have received.
    pub energy_given_j: f64,
    /// The fault that ended the run, if one did.
    pub fault: Option<String>,
}

/// Results of the run without lateness and of the runs with it.
#[derive(Debug, Clone, Serialize)]
pub struct Consequences {
    /// Duration of a late tick, in ticks.
    pub late_tick_ticks: f64,
    /// Result without lateness.
    pub on_time: Consequence,
    /// Results with lateness, by policy and share.
    pub late: Vec<Consequence>,
}

/// Commanded forces and contact measures of a run.
#[derive(Default)]
struct Run {
    forces: Vec<Vec3>,
    missed: [u64; 2],
    contact: ContactMeasures,
    energy: f64,
    fault: Option<Fault>,
}

fn run(scene: &Scene, timeline: Timeline) -> Result<Run, RunError> {
    let mut run = Run::default();
    let simulation = Simulation::prepare(scene)?.with_timeline(timeline);
    run.fault = simulation
        .run(|view| {
            match view.deadline_outcome {
                DeadlineOutcome::OnTime => {}
                DeadlineOutcome::Late(_) => run.missed[0] += 1,
                DeadlineOutcome::Skipped => run.missed[1] += 1,
            }
            run.contact.record(view);
            let before = run.forces.last().copied().unwrap_or_default();
            // The force that was held over the tick acts along the tip's motion in it.
            run.energy += before.dot(&(view.tip - view.tip_before));
            run.forces.push(view.force);
        })
        .err();
    Ok(run)
}

impl Run {
    fn consequence(self, overrun: OverrunPolicy, share: f64, on_time: &[Vec3]) -> Consequence {
        let square = |forces: &mut dyn Iterator<Item = Vec3>| forces.map(|force| force.norm_squared()).sum::<f64>();
        let all = square(&mut on_time.iter().copied());
        let off = square(&mut on_time.iter().zip(&self.forces).map(|(a, b)| a - b));
        let is_whole = self.fault.is_none() && all > 0.0;
        Consequence {
            overrun,
            share,
            missed_ticks: self.missed,
            force_error_rms_rel: is_whole.then(|| (off / all).sqrt()),
            largest_jump_n: self.contact.largest_force_jump().newtons,
            contact_losses: self.contact.contact_losses(),
            energy_given_j: self.energy,
            fault: self.fault.map(|fault| fault.to_string()),
        }
    }
}

/// Runs a scene with every policy and share; late ticks of the scene itself are disabled.
///
/// # Errors
/// If the scene cannot start.
///
/// ```
/// use stickslip::{scene::Scene, verify::lateness::{SHARES, consequences}};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(200);
/// let consequences = consequences(&scene)?;
/// assert_eq!(consequences.on_time.force_error_rms_rel, Some(0.0));
/// assert_eq!(consequences.late.len(), 3 * SHARES.len()); // hold, zero, skip
/// // Where every tenth force is replaced by zero, the force drops.
/// let zero = consequences.late.iter().find(|each| each.overrun.name() == "zero" && each.share == 0.1);
/// let zero = zero.expect("a policy that is looked at");
/// assert!(zero.missed_ticks[0] > 0 && zero.largest_jump_n > consequences.on_time.largest_jump_n);
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
pub fn consequences(scene: &Scene) -> Result<Consequences, RunError> {
    let latency = u64::from(scene.global.latency_ticks);
    let mut on_time = run(scene, Timeline::Ideal { latency })?;
    let forces = std::mem::take(&mut on_time.forces);
    let mut late = Vec::new();
    for overrun in POLICIES {
        for share in SHARES {
            let tick = Cost::Rare { usual: 0.0, rare: LATE_TICKS * scene.tick_s(), share };
            let costs = Costs { tick, model: Cost::Constant(0.0), seed: SEED };
            let mut deadline = scene.deadline;
            deadline.overrun = overrun;
            let ticks_per_cycle = u64::from(scene.ticks_per_cycle());
            let drawn = DrawnTimes::new(costs, deadline, scene.tick_s(), ticks_per_cycle, latency);
            let run = run(scene, Timeline::Drawn(Box::new(drawn)))?;
            late.push(run.consequence(overrun, share, &forces));
        }
    }
    on_time.forces = forces.clone();
    let on_time = on_time.consequence(scene.deadline.overrun, 0.0, &forces);
    Ok(Consequences { late_tick_ticks: LATE_TICKS, on_time, late })
}
