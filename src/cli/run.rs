//! `stickslip run`: one scene, its files and its outcome.

use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::Args;

use super::progress::Progress;
use super::terminal::{hand_out, say};
use super::{FAIL, INCONCLUSIVE, PASS, folder, read, table, warn};
use crate::local::model::Linearization;
use crate::model::springs::TangentKind;
use crate::multirate::failsafe::FaultCause;
use crate::output::files::{FinishedRun, write_run};
use crate::output::time_steps::TimeSteps;
use crate::output::verdict::Verdict;
use crate::output::vtk::VtkWriter;
use crate::output::warnings::before_run;
use crate::pipeline::{Simulation, TickView};
use crate::scene::{Scene, Schedule, Warning};

/// Default ticks per frame: 50 frames per second at 1 kHz.
const FRAME_TICKS: &str = "20";

/// Advice for a run whose patch folded.
const FOLDED_ADVICE: &str = "give `contact.adhesion`, a `contact.radius`, more `local.rings` or a smaller drag";

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
    let (scene, _) = read(&arguments.scene)?;
    let out = arguments.out.clone().unwrap_or_else(|| Path::new("reports").join(&scene.name));
    // A folder is created only for a scene that can start.
    let mut frames = match arguments.vtk {
        Some(ticks) => {
            Simulation::prepare(&scene)?;
            Some(VtkWriter::new(&folder(Some(out.clone()), &scene)?, ticks.get())?)
        }
        None => None,
    };
    let mut progress = Progress::new(scene.tick_count(), "ticks");
    progress.begin(&scene.name);
    let (finished, is_same) = execute(&scene, &out, warn, |view| {
        frames.iter_mut().for_each(|frames| frames.record(view));
        progress.set(view.tick + 1);
    })?;
    drop(progress);
    let frames = frames.map(VtkWriter::finish).transpose()?;
    let verdict = &finished.summary.verdict;
    hand_out(&finished.summary)?;
    say(table::runs([(&finished.summary, verdict.cell())]))?;
    say(format_args!("{} ticks in {}", finished.summary.ticks, out.display()))?;
    if let Some(frames) = frames {
        say(format_args!("{frames} frames for ParaView: {}", out.join("network.pvd").display()))?;
    }
    if let Some(counts) = &finished.summary.condensation {
        say(counts)?;
    }
    if verdict.verdict != Verdict::Pass {
        eprintln!("{}: {}", verdict.verdict.name(), verdict.reasons.join("; "));
    }
    match finished.fault.map(|fault| fault.cause) {
        Some(FaultCause::Runaway { .. }) => eprintln!("{}", runaway_advice(&scene)),
        Some(FaultCause::PatchFolded { .. }) => eprintln!("{FOLDED_ADVICE}"),
        _ => {}
    }
    Ok(match verdict.verdict {
        Verdict::Fail => FAIL,
        _ if !is_same => FAIL,
        Verdict::Inconclusive => INCONCLUSIVE,
        Verdict::Pass => PASS,
    })
}

/// Advises on a run that diverged: what the scene does not have yet.
fn runaway_advice(scene: &Scene) -> String {
    let Ok(simulation) = Simulation::prepare(scene) else { return String::new() };
    let steps = TimeSteps::new(scene, &simulation);
    let step_warning =
        before_run(scene, &simulation, &steps).into_iter().find(|warning| warning.code.ends_with("-step-limit"));
    if let Some(warning) = step_warning {
        return format!("Cause: {warning}");
    }
    let mut ways = Vec::new();
    if scene.local().linearization == Linearization::Tangent(TangentKind::Exact) && !scene.is_full() {
        ways.push("`local.tangent = \"stabilised\"`, as the tangent of compressed springs may be indefinite");
        ways.push("`local.linearization = \"none\"`");
    }
    if !scene.is_full() {
        ways.push("a higher `global.rate`");
    }
    if !scene.contact.scheme.is_impulsive() {
        ways.push("`contact.scheme = \"massless\"` with `contact.surface = \"subdivision\"`");
    }
    ways.push("a smaller drag");
    format!("The steps are within their stability limits at rest. Try {}", ways.join(", or "))
}

/// Runs a scene by its schedule and writes its files into a folder. Returns the run, and whether its repetition in
/// virtual time commanded the same forces to the bit; true for a run that was in virtual time.
///
/// `announce` is given the warnings before the run.
pub fn execute(
    scene: &Scene,
    out: &Path,
    announce: impl FnOnce(&[Warning]),
    watch: impl FnMut(&TickView),
) -> miette::Result<(FinishedRun, bool)> {
    let simulation = Simulation::prepare(scene)?;
    let foreseen = before_run(scene, &simulation, &TimeSteps::where_in_doubt(scene, &simulation));
    announce(&foreseen);
    match scene.schedule {
        Schedule::Lockstep => {
            let run = |simulation: Simulation, observe: &mut dyn FnMut(&TickView)| simulation.run(observe).err();
            Ok((write_run(scene, simulation, &foreseen, out, watch, run)?, true))
        }
        Schedule::Threads => real_time::execute(scene, &foreseen, out, watch),
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
    use crate::scene::{Scene, Warning};
    use crate::session::{ReplayOutcome, replay};

    pub fn execute(
        scene: &Scene,
        foreseen: &[Warning],
        out: &Path,
        watch: impl FnMut(&TickView),
    ) -> miette::Result<(FinishedRun, bool)> {
        let mut recorded = record(scene, interrupt::flag()?)?;
        let session = &recorded.session;
        let pass = session.passes.first().ok_or_else(|| miette::miette!("the loop recorded no pass"))?;
        let mut replayed = ReplayOutcome::Same { fault: None };
        let mut finished =
            write_run(scene, session.prepare(scene, pass)?, foreseen, out, watch, |simulation, observe| {
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
        if summary.stopped {
            finished.summary = finished.summary.with(|summary| summary.completed = false);
            write_json(&out.join("summary.json"), &finished.summary)?;
        }
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
    use crate::scene::{Scene, Warning};

    pub fn execute(
        _: &Scene,
        _: &[Warning],
        _: &Path,
        _: impl FnMut(&TickView),
    ) -> miette::Result<(FinishedRun, bool)> {
        Err(miette::miette!(
            help = "build with the feature `realtime` on Linux, or give `run.schedule = \"lockstep\"`",
            "this program cannot run scenes with `run.schedule = \"threads\"`"
        ))
    }
}
