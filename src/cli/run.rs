//! `stickslip run`: one scene, its files and its outcome.

use std::cell::RefCell;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::Args;

use super::progress::Progress;
use super::renderer::RendererArguments;
use super::terminal::{complain, hand_out, say};
use super::{Changes, FAIL, exit_code, read, table, warn};
use crate::local::model::Linearization;
use crate::model::springs::TangentKind;
use crate::multirate::failsafe::FaultCause;
use crate::output::files::{FinishedRun, WriteError, write_run};
use crate::output::folder::ResultFolder;
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
    #[command(flatten)]
    changes: Changes,
    /// Output folder (default: reports/SCENE)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Also write network.pvd and instrument.pvd for ParaView, one frame every TICKS ticks (default: 20)
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true, default_missing_value = FRAME_TICKS)]
    vtk: Option<NonZeroU64>,
    #[command(flatten)]
    renderer: RendererArguments,
}

pub fn run(arguments: &RunArguments) -> miette::Result<u8> {
    let scene = arguments.renderer.apply(read(&arguments.scene, &arguments.changes)?.0);
    let out = arguments.out.clone().unwrap_or_else(|| Path::new("reports").join(&scene.name));
    let mut progress = Progress::new(scene.tick_count(), "ticks");
    progress.begin(&scene.name);
    let every_ticks = arguments.vtk.map(NonZeroU64::get);
    let Executed { finished, is_same, frames } =
        execute(&scene, &out, every_ticks, warn, |view| progress.set(view.tick + 1))?;
    drop(progress);
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
        complain(format_args!("{}: {}", verdict.verdict.name(), verdict.reasons.join("; ")));
    }
    match finished.fault.map(|fault| fault.cause) {
        Some(FaultCause::Runaway { .. }) => complain(runaway_advice(&scene)),
        Some(FaultCause::PatchFolded { .. }) => complain(FOLDED_ADVICE),
        _ => {}
    }
    Ok(if is_same { exit_code(verdict.verdict) } else { FAIL })
}

/// Returns advice on a run that diverged: the remedies that the scene does not use yet.
fn runaway_advice(scene: &Scene) -> String {
    let Ok(simulation) = Simulation::prepare(scene) else { return String::new() };
    let steps = TimeSteps::new(scene, &simulation);
    let step_warning =
        before_run(scene, &simulation, &steps).into_iter().find(|warning| warning.code.ends_with("-step-limit"));
    if let Some(warning) = step_warning {
        return format!("Cause: {warning}");
    }
    let mut ways = Vec::new();
    if scene.renderer().is_some() {
        return "The renderer commanded forces that the network does not bear: check their sign and size".to_owned();
    }
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

/// A run with its files.
pub struct Executed {
    pub finished: FinishedRun,
    /// Whether the repetition of a run in real time commanded the same forces to the bit; true for a run in virtual time.
    pub is_same: bool,
    /// Number of frames for ParaView, if they were asked for.
    pub frames: Option<usize>,
}

/// Runs a scene by its schedule and writes its files into a folder, which is created only if the scene can start. With
/// `every_ticks`, frames for ParaView are written too, one every so many ticks. `announce` receives the warnings before the
/// run.
pub fn execute(
    scene: &Scene,
    out: &Path,
    every_ticks: Option<u64>,
    announce: impl FnOnce(&[Warning]),
    mut watch: impl FnMut(&TickView),
) -> miette::Result<Executed> {
    let simulation = Simulation::prepare(scene)?;
    let foreseen = before_run(scene, &simulation, &TimeSteps::where_in_doubt(scene, &simulation));
    announce(&foreseen);
    let folder = ResultFolder::take(out)?;
    folder.clear_frames()?;
    // The writer is taken out when the run is over, before the summary is written.
    let writer = RefCell::new(every_ticks.map(|ticks| VtkWriter::new(out, ticks)).transpose()?);
    let mut frames = None;
    let watch = |view: &TickView| {
        writer.borrow_mut().iter_mut().for_each(|writer| writer.record(view));
        watch(view);
    };
    let mut finish_frames = || -> Result<(), WriteError> {
        frames = writer.take().map(VtkWriter::finish).transpose()?;
        Ok(())
    };
    let (finished, is_same) = match scene.schedule {
        Schedule::Lockstep => {
            let run = |simulation: Simulation, observe: &mut dyn FnMut(&TickView)| simulation.run(observe).err();
            let finished = write_run(scene, simulation, &foreseen, &folder, watch, run, |_| finish_frames())?;
            (finished, true)
        }
        Schedule::Threads => {
            drop(simulation);
            real_time::execute(scene, &foreseen, &folder, watch, finish_frames)?
        }
    };
    Ok(Executed { finished, is_same, frames })
}

#[cfg(all(feature = "realtime", target_os = "linux"))]
mod real_time {
    use std::cell::Cell;

    use super::super::interrupt;
    use super::super::terminal::say;
    use crate::output::files::{FinishedRun, WriteError, write_json, write_run};
    use crate::output::folder::ResultFolder;
    use crate::output::summary::Summary;
    use crate::pipeline::{Simulation, TickView};
    use crate::realtime::record::{Quantiles, Recorded, record};
    use crate::scene::{Scene, Warning};
    use crate::session::{ReplayOutcome, replay};

    pub fn execute(
        scene: &Scene,
        foreseen: &[Warning],
        folder: &ResultFolder,
        watch: impl FnMut(&TickView),
        finish_frames: impl FnOnce() -> Result<(), WriteError>,
    ) -> miette::Result<(FinishedRun, bool)> {
        let scene = &scene.clone().with_renderer_in_process();
        let Recorded { session, mut summary, .. } = record(scene, interrupt::flag())?;
        let pass = session.passes.first().ok_or_else(|| miette::miette!("the loop recorded no pass"))?;
        let replayed = Cell::new(false);
        let repeat = |simulation: Simulation, observe: &mut dyn FnMut(&TickView)| {
            let outcome = replay(simulation, pass, observe);
            replayed.set(matches!(outcome, ReplayOutcome::Same { .. }));
            match outcome {
                ReplayOutcome::Same { fault } | ReplayOutcome::Ended { fault, .. } => fault.map(|fault| *fault),
                ReplayOutcome::Differs { .. } => None,
            }
        };
        let conclude = |of_run: &mut Summary| {
            summary.replayed = replayed.get();
            of_run.add_real_time(summary.replayed, summary.stopped);
            write_json(&folder.path().join("session.json"), &session)?;
            write_json(&folder.path().join("timing.json"), &summary)?;
            finish_frames()
        };
        let simulation = session.prepare(scene, pass)?;
        let finished = write_run(scene, simulation, foreseen, folder, watch, repeat, conclude)?;
        let is_same = replayed.get();
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
    use crate::output::files::{FinishedRun, WriteError};
    use crate::output::folder::ResultFolder;
    use crate::pipeline::TickView;
    use crate::scene::{Scene, Warning};

    pub fn execute(
        _: &Scene,
        _: &[Warning],
        _: &ResultFolder,
        _: impl FnMut(&TickView),
        _: impl FnOnce() -> Result<(), WriteError>,
    ) -> miette::Result<(FinishedRun, bool)> {
        Err(miette::miette!(
            help = "build with the feature `realtime` on Linux, or give `run.schedule = \"lockstep\"`",
            "this program cannot run scenes with `run.schedule = \"threads\"`"
        ))
    }
}
