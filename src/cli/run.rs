//! `stickslip run`.

use std::path::{Path, PathBuf};

use super::progress::Progress;
use super::{FAIL, PASS, load, say, table};
use crate::output::files::run_into;

pub fn run(scene: &Path, out: Option<PathBuf>) -> miette::Result<u8> {
    let (scene, _) = load(scene)?;
    let out = out.unwrap_or_else(|| Path::new("reports").join(&scene.name));
    let mut progress = Progress::new(scene.tick_count, "ticks");
    progress.begin(&scene.name);
    let finished = run_into(&scene, &out, |ticks| progress.set(ticks))?;
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
    Ok(if finished.summary.passes() { PASS } else { FAIL })
}
