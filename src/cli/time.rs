//! `stickslip check --time`: paired run times of this program and another one, with a control.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use miette::{IntoDiagnostic, WrapErr};
use serde::Serialize;
use tempfile::TempDir;

use super::terminal::say;
use super::{FAIL, INCONCLUSIVE, PASS};
use crate::verify::paired::Median;

/// Rounds that are not counted, as they bring files and code into the caches.
const WARM_UP: usize = 2;

/// Run times compared with those of another program.
#[derive(Debug, Serialize)]
pub struct Compared {
    against: PathBuf,
    rounds: usize,
    scenes: Vec<Times>,
}

/// Run times of one scene.
#[derive(Debug, Serialize)]
struct Times {
    scene: PathBuf,
    /// Run times of this program over those of the other one; absent if the clock gave no usable times.
    ratio: Option<Median>,
    /// Run times of this program over those of itself.
    control: Option<Median>,
    /// Smallest difference from 1 that the control can resolve.
    smallest_effect: Option<f64>,
    finding: &'static str,
}

/// Checks that a program is a build of stickslip, before anything is compared with it.
///
/// # Errors
/// If it cannot be started or is not stickslip.
pub fn probe(program: &Path) -> miette::Result<()> {
    let output = Command::new(program).arg("--version").stdin(Stdio::null()).output();
    let output = output.into_diagnostic().wrap_err_with(|| format!("cannot run {}", program.display()))?;
    if output.status.success() && output.stdout.starts_with(b"stickslip ") {
        return Ok(());
    }
    Err(miette::miette!(
        help = "give the path of another build of stickslip",
        "cannot run {} as stickslip: with --version it ended with {} and did not print its name",
        program.display(),
        output.status
    ))
}

/// Times whole runs that write into a temporary folder. In every round this program, the other one, and this one again
/// as control run once each; the order rotates.
pub fn compare(scenes: &[PathBuf], against: &Path, rounds: usize) -> miette::Result<Compared> {
    let this = std::env::current_exe().into_diagnostic().wrap_err("cannot find this program")?;
    let out = TempDir::new().into_diagnostic().wrap_err("cannot create a temporary folder")?;
    let programs = [this.as_path(), against, this.as_path()];
    say(format_args!("\nrun times of {} over those of {}, {rounds} rounds", this.display(), against.display()))?;
    let mut compared = Compared { against: against.to_owned(), rounds, scenes: Vec::new() };
    for scene in scenes {
        let mut ratios = Vec::with_capacity(rounds);
        let mut control = Vec::with_capacity(rounds);
        for round in 0..WARM_UP + rounds {
            let mut times = [0.0; 3];
            for turn in 0..3 {
                let which = (round + turn) % 3;
                times[which] = time(programs[which], scene, out.path())?;
            }
            if round >= WARM_UP {
                let [this, other, again] = times;
                ratios.push(this / other);
                control.push(this / again);
            }
        }
        let times = Times::of(scene, &ratios, &control);
        say(format_args!("{}: {}", scene.display(), times.words()))?;
        compared.scenes.push(times);
    }
    Ok(compared)
}

impl Times {
    fn of(scene: &Path, ratios: &[f64], control: &[f64]) -> Self {
        let (ratio, control) = (Median::of(ratios), Median::of(control));
        let finding = match (ratio, control) {
            (Some(_), Some(control)) if !control.covers_one() => {
                "inconclusive: this program differs from itself, so the machine was not idle enough; repeat on an idle one"
            }
            (Some(ratio), Some(control)) if ratio.covers_one() || (ratio.median - 1.0).abs() <= control.reach() => {
                "no difference found"
            }
            (Some(ratio), Some(_)) if ratio.median < 1.0 => "this program is faster",
            (Some(_), Some(_)) => "this program is slower",
            _ => "the clock gave no usable times",
        };
        let smallest_effect = control.map(|control| control.reach());
        Self { scene: scene.to_owned(), ratio, control, smallest_effect, finding }
    }

    fn words(&self) -> String {
        let (Some(ratio), Some(control)) = (self.ratio, self.control) else { return self.finding.to_owned() };
        format!(
            "median ratio {:.4}, {:.1} % interval {:.4} to {:.4}; control {:.4}, {:.4} to {:.4}; the smallest detectable \
             effect is {:.2} %; {}",
            ratio.median,
            100.0 * ratio.confidence,
            ratio.lower,
            ratio.upper,
            control.median,
            control.lower,
            control.upper,
            100.0 * control.reach(),
            self.finding
        )
    }
}

fn time(program: &Path, scene: &Path, out: &Path) -> miette::Result<f64> {
    let summary = out.join("summary.json");
    // A program that writes no summary has not run the scene, whatever its exit code.
    let _ = std::fs::remove_file(&summary);
    let mut command = Command::new(program);
    command
        .arg("run")
        .arg(scene)
        .arg("--out")
        .arg(out)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let start = Instant::now();
    let status = command.status().into_diagnostic().wrap_err_with(|| format!("cannot run {}", program.display()))?;
    let elapsed = start.elapsed().as_secs_f64();
    // The time of a run counts whatever its verdict.
    match status.code() {
        Some(code) if [PASS, FAIL, INCONCLUSIVE].map(i32::from).contains(&code) && summary.exists() => Ok(elapsed),
        _ => miette::bail!("{} run {} ended with {status}", program.display(), scene.display()),
    }
}
