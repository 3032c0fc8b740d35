//! `stickslip run`.

use std::path::{Path, PathBuf};

use super::progress::Progress;
use super::{FAIL, PASS, load, say, table};
use crate::output::files::{FinishedRun, run_into};
use crate::pipeline::TickView;
use crate::scene::{Scene, Schedule};

pub fn run(scene: &Path, out: Option<PathBuf>) -> miette::Result<u8> {
    let (scene, _) = load(scene)?;
    let out = out.unwrap_or_else(|| Path::new("reports").join(&scene.name));
    let mut progress = Progress::new(scene.tick_count, "ticks");
    progress.begin(&scene.name);
    let (finished, is_same) = execute(&scene, &out, |view| progress.set(view.tick + 1))?;
    drop(progress);
    let outcome = match (finished.summary.completed, finished.summary.passes()) {
        (false, _) => "fault",
        (true, false) => "tunnelled",
        (true, true) => "completed",
    };
    say(table::runs([(&finished.summary, outcome)]))?;
    say(format_args!("{} ticks in {}", finished.summary.ticks, out.display()))?;
    if let Some(counts) = &finished.summary.condensation {
        say(counts)?;
    }
    if let Some(fault) = &finished.fault {
        eprintln!("{fault}");
    }
    Ok(if finished.summary.passes() && is_same { PASS } else { FAIL })
}

/// Runs a scene by its schedule into a folder. Beside what the run was: whether what was recorded in real time came out
/// the same, to the bit, when it was done again for the files.
pub fn execute(scene: &Scene, out: &Path, watch: impl FnMut(&TickView)) -> miette::Result<(FinishedRun, bool)> {
    match scene.schedule {
        Schedule::Lockstep => Ok((run_into(scene, out, watch)?, true)),
        Schedule::Threads => real_time::execute(scene, out, watch),
    }
}

#[cfg(all(feature = "realtime", target_os = "linux"))]
mod real_time {
    use std::path::Path;

    use super::super::{interrupt, say};
    use crate::output::files::{FinishedRun, write_json, write_run};
    use crate::pipeline::TickView;
    use crate::realtime::record::{Quantiles, record};
    use crate::scene::Scene;
    use crate::session::{Replayed, replay};

    pub fn execute(scene: &Scene, out: &Path, watch: impl FnMut(&TickView)) -> miette::Result<(FinishedRun, bool)> {
        let mut recorded = record(scene, interrupt::flag()?)?;
        let session = &recorded.session;
        let pass = session.passes.first().ok_or_else(|| miette::miette!("the loop left no pass"))?;
        let mut replayed = Replayed::Same { fault: None };
        let mut finished = write_run(scene, session.prepare(scene, pass)?, out, watch, |simulation, observe| {
            replayed = replay(simulation, pass, observe);
            match &replayed {
                Replayed::Same { fault } | Replayed::Ended { fault, .. } => fault.as_deref().copied(),
                Replayed::Differs { .. } => None,
            }
        })?;
        let summary = &mut recorded.summary;
        let is_same = matches!(replayed, Replayed::Same { .. });
        summary.replayed = is_same;
        write_json(&out.join("session.json"), session)?;
        write_json(&out.join("timing.json"), summary)?;
        if summary.stopped {
            finished.summary.completed = false;
            write_json(&out.join("summary.json"), &finished.summary)?;
        }
        let Quantiles { p50, p99, max, .. } = summary.response_ns;
        say(format_args!(
            "real time under {}: response p50 {:.1} µs, p99 {:.1} µs, longest {:.1} µs; {} of {} ticks missed their \
             deadline of {:.0} µs, {} were left out; done again in virtual time {}",
            summary.settings.policy,
            p50 as f64 * 1e-3,
            p99 as f64 * 1e-3,
            max as f64 * 1e-3,
            summary.misses,
            finished.summary.ticks,
            summary.deadline_us,
            summary.skipped,
            if is_same { "it commands the same forces to the bit" } else { "it commands OTHER forces" },
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
