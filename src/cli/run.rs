//! `stickslip run`: one scene, its files and its outcome.

use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::Args;

use super::explain::device::DeviceFacts;
use super::progress::Progress;
use super::terminal::{hand_out, say};
use super::{FAIL, PASS, folder, load, table};
use crate::device::instrument::InstrumentKind;
use crate::local::model::Linearization;
use crate::model::springs::TangentKind;
use crate::multirate::failsafe::FaultCause;
use crate::output::files::{FinishedRun, run_into};
use crate::output::vtk::VtkWriter;
use crate::pipeline::{Simulation, TickView};
use crate::scene::{Scene, Schedule};

/// Default ticks per frame: 50 frames per second at 1 kHz.
const FRAME_TICKS: &str = "20";

/// Advice for a run that diverged with the exact tangent, which is constant over a cycle.
const RUNAWAY_ADVICE: &str = "if `stickslip explain` shows steps within their stability limits, the tangent of \
    compressed springs may be indefinite: give `local.tangent = \"stabilised\"`, `local.linearization = \"none\"` or \
    a higher `global.rate`";

/// Advice for a run whose patch folded.
const FOLDED_ADVICE: &str = "give `contact.adhesion`, a `contact.radius`, more `local.rings` or a smaller drag";

/// Advice for a run that ended without a fault and whose energy balance is implausible.
const ENERGY_ADVICE: &str = "the local model and the network may excite each other, or contact may be lost and \
    regained; compare with a higher `global.rate` and with `local.tangent = \"stabilised\"`";

#[derive(Debug, Args)]
pub struct RunArguments {
    /// A scene file or the name of a shipped scene
    scene: PathBuf,
    /// Output folder (default: reports/SCENE)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Also write network.pvd and instrument.pvd for ParaView, one frame every TICKS ticks (default: 20)
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true, default_missing_value = FRAME_TICKS)]
    vtk: Option<NonZeroU64>,
}

pub fn run(arguments: &RunArguments) -> miette::Result<u8> {
    let (scene, _) = load(&arguments.scene)?;
    let out = arguments.out.clone().unwrap_or_else(|| Path::new("reports").join(&scene.name));
    // A folder is created only for a scene that can start.
    let mut frames = match arguments.vtk {
        Some(ticks) => {
            Simulation::prepare(&scene)?;
            Some(VtkWriter::new(&folder(Some(out.clone()), &scene)?, ticks.get())?)
        }
        None => None,
    };
    if matches!(scene.instrument, InstrumentKind::Phantom(_)) {
        let facts = DeviceFacts::new(&scene, &Simulation::prepare(&scene)?);
        if let Some(warning) = facts.as_ref().and_then(DeviceFacts::count_warning) {
            eprintln!("Warning: {warning}");
        }
    }
    let mut progress = Progress::new(scene.tick_count(), "ticks");
    progress.begin(&scene.name);
    let (finished, is_same) = execute(&scene, &out, |view| {
        frames.iter_mut().for_each(|frames| frames.record(view));
        progress.set(view.tick + 1);
    })?;
    drop(progress);
    let frames = frames.map(VtkWriter::finish).transpose()?;
    let outcome = match (finished.summary.completed, finished.summary.passes()) {
        _ if finished.summary.reproduced == Some(false) => "not reproduced",
        (false, _) => "fault",
        (true, false) if finished.summary.patch_folded > 0 => "folded",
        (true, false) => "tunnelled",
        (true, true) => "completed",
    };
    hand_out(&finished.summary)?;
    say(table::runs([(&finished.summary, outcome)]))?;
    say(format_args!("{} ticks in {}", finished.summary.ticks, out.display()))?;
    if let Some(frames) = frames {
        say(format_args!("{frames} frames for ParaView: {}", out.join("network.pvd").display()))?;
    }
    if let Some(counts) = &finished.summary.condensation {
        say(counts)?;
    }
    if finished.summary.patch_folded > 0 {
        eprintln!(
            "The patch folded over the tip: in {} ticks it was inside the surface and felt no force; {FOLDED_ADVICE}",
            finished.summary.patch_folded
        );
    }
    let energy = &finished.summary.energy;
    if finished.fault.is_none() && !energy.is_plausible() {
        eprintln!(
            "Warning: the energy residual of {:.1e} J exceeds the instrument's Σ|f·Δq| of {:.1e} J: {ENERGY_ADVICE}",
            energy.residual_j.abs(),
            energy.absolute_work_j
        );
    }
    if let Some(fault) = &finished.fault {
        eprintln!("{fault}");
        let is_frozen = scene.local().linearization == Linearization::Tangent(TangentKind::Exact);
        if matches!(fault.cause, FaultCause::Runaway { .. }) && is_frozen {
            eprintln!("{RUNAWAY_ADVICE}");
        }
    }
    Ok(if finished.summary.passes() && is_same { PASS } else { FAIL })
}

/// Runs a scene by its schedule and writes its files into a folder. Returns the run, and whether its repetition in
/// virtual time commanded the same forces to the bit; true for a run that was in virtual time.
pub fn execute(scene: &Scene, out: &Path, watch: impl FnMut(&TickView)) -> miette::Result<(FinishedRun, bool)> {
    match scene.schedule {
        Schedule::Lockstep => Ok((run_into(scene, out, watch)?, true)),
        Schedule::Threads => real_time::execute(scene, out, watch),
    }
}

#[cfg(all(feature = "realtime", target_os = "linux"))]
mod real_time {
    use std::path::Path;

    use super::super::interrupt;
    use super::super::terminal::say;
    use crate::output::files::{FinishedRun, write_json, write_run};
    use crate::pipeline::TickView;
    use crate::realtime::record::{Quantiles, record};
    use crate::scene::Scene;
    use crate::session::{ReplayOutcome, replay};

    pub fn execute(scene: &Scene, out: &Path, watch: impl FnMut(&TickView)) -> miette::Result<(FinishedRun, bool)> {
        let mut recorded = record(scene, interrupt::flag()?)?;
        let session = &recorded.session;
        let pass = session.passes.first().ok_or_else(|| miette::miette!("the loop recorded no pass"))?;
        let mut replayed = ReplayOutcome::Same { fault: None };
        let mut finished = write_run(scene, session.prepare(scene, pass)?, out, watch, |simulation, observe| {
            replayed = replay(simulation, pass, observe);
            match &replayed {
                ReplayOutcome::Same { fault } | ReplayOutcome::Ended { fault, .. } => fault.as_deref().copied(),
                ReplayOutcome::Differs { .. } => None,
            }
        })?;
        let summary = &mut recorded.summary;
        let is_same = matches!(replayed, ReplayOutcome::Same { .. });
        summary.replayed = is_same;
        write_json(&out.join("session.json"), session)?;
        write_json(&out.join("timing.json"), summary)?;
        finished.summary.add_real_time(is_same, summary.stopped);
        write_json(&out.join("summary.json"), &finished.summary)?;
        let Quantiles { p50, p99, max, .. } = summary.response_ns;
        say(format_args!(
            "real time under {}: response p50 {:.1} µs, p99 {:.1} µs, longest {:.1} µs; {} of {} ticks missed their \
             deadline of {:.0} µs, {} were skipped; {}",
            summary.settings.policy,
            p50 as f64 * 1e-3,
            p99 as f64 * 1e-3,
            max as f64 * 1e-3,
            summary.misses,
            finished.summary.ticks,
            summary.deadline_us,
            summary.skipped,
            match (is_same, summary.window.lost_notes) {
                (true, _) => "the repetition in virtual time commands the same forces to the bit".to_owned(),
                (false, 0) => "the repetition in virtual time commands OTHER forces".to_owned(),
                (false, lost) => format!(
                    "the repetition in virtual time commands OTHER forces; {lost} messages lost to a full ring buffer \
                     may be the cause: the global side was cycles late"
                ),
            },
        ))?;
        Ok((finished, is_same))
    }
}

#[cfg(not(all(feature = "realtime", target_os = "linux")))]
mod real_time {
    use std::path::Path;

    use crate::output::files::FinishedRun;
    use crate::pipeline::TickView;
    use crate::scene::Scene;

    pub fn execute(_: &Scene, _: &Path, _: impl FnMut(&TickView)) -> miette::Result<(FinishedRun, bool)> {
        Err(miette::miette!(
            help = "build with the feature `realtime` on Linux, or give `run.schedule = \"lockstep\"`",
            "this program cannot run scenes with `run.schedule = \"threads\"`"
        ))
    }
}
