//! `stickslip run`.

use std::path::{Path, PathBuf};

use super::progress::Progress;
use super::{FAIL, PASS, load, table};
use crate::output::files::run_into;

pub fn run(scene: &Path, out: Option<PathBuf>) -> miette::Result<u8> {
    let scene = load(scene)?;
    let out = out.unwrap_or_else(|| Path::new("reports").join(&scene.name));
    let mut progress = Progress::new(scene.tick_count);
    progress.begin(&scene.name);
    let finished = run_into(&scene, &out, |ticks| progress.set(ticks))?;
    drop(progress);
    let outcome = if finished.summary.completed { "completed" } else { "fault" };
    println!("{}", table::runs([(&finished.summary, outcome)]));
    println!("{} ticks in {}", finished.summary.ticks, out.display());
    match finished.fault {
        None => Ok(PASS),
        Some(fault) => {
            eprintln!("{fault}");
            Ok(FAIL)
        }
    }
}
