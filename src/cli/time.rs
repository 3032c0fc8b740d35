//! `stickslip check --time`: paired run times of this program and another one, with a control.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use miette::{IntoDiagnostic, WrapErr};
use tempfile::TempDir;

use super::terminal::say;
use super::{FAIL, PASS};
use crate::verify::paired::Median;

/// Rounds that are not counted, as they bring files and code into the caches.
const WARM_UP: usize = 2;

/// Times whole runs that write into a temporary folder. In every round this program, the other one, and this one again
/// as control run once each; the order rotates.
pub fn compare(scenes: &[PathBuf], against: &Path, rounds: usize) -> miette::Result<()> {
    let this = std::env::current_exe().into_diagnostic().wrap_err("cannot find this program")?;
    let out = TempDir::new().into_diagnostic().wrap_err("cannot create a temporary folder")?;
    let programs = [this.as_path(), against, this.as_path()];
    say(format_args!("\nrun times of {} over those of {}, {rounds} rounds", this.display(), against.display()))?;
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
        say(format_args!("{}: {}", scene.display(), finding(&ratios, &control)))?;
    }
    Ok(())
}

fn finding(ratios: &[f64], control: &[f64]) -> String {
    let (Some(ratio), Some(control)) = (Median::of(ratios), Median::of(control)) else {
        return "the clock gave no usable times".to_owned();
    };
    let Median { median, lower, upper, confidence } = ratio;
    let smallest = 100.0 * control.reach();
    let seen = if !control.covers_one() {
        "inconclusive: this program differs from itself, so the machine was not idle enough; repeat on an idle one"
    } else if ratio.covers_one() || (median - 1.0).abs() <= control.reach() {
        "no difference found"
    } else if median < 1.0 {
        "this program is faster"
    } else {
        "this program is slower"
    };
    format!(
        "median ratio {median:.4}, {:.1} % interval {lower:.4} to {upper:.4}; control {:.4}, {:.4} to {:.4}; \
         the smallest detectable effect is {smallest:.2} %; {seen}",
        100.0 * confidence,
        control.median,
        control.lower,
        control.upper
    )
}

fn time(program: &Path, scene: &Path, out: &Path) -> miette::Result<f64> {
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
    // The time of a run that ends in a fault counts too.
    match status.code() {
        Some(code) if [PASS, FAIL].map(i32::from).contains(&code) => Ok(elapsed),
        _ => miette::bail!("{} run {} ended with {status}", program.display(), scene.display()),
    }
}
