//! `stickslip replay`: recorded ticks repeated in virtual time.

use std::path::Path;

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use serde::Serialize;

use super::progress::Progress;
use super::terminal::{hand_out, say};
use super::tick_timing::{TimedTick, names, time_ticks};
use super::{FAIL, PASS};
use crate::pipeline::Simulation;
use crate::session::{self, ReplayOutcome, Session};

/// Findings of `replay`, as printed by `--json`.
#[derive(Serialize)]
struct Found<'a> {
    /// Whether the forces of every pass are identical to the bit.
    same: bool,
    passes: &'a [Went],
    worst: &'a [TimedTick],
}

/// Finding of one pass.
#[derive(Serialize)]
struct Went {
    pass: u32,
    same: bool,
    how: String,
}

pub fn replay(file: &Path) -> miette::Result<u8> {
    let session = Session::load(file)?;
    let scene = session.scene()?;
    session.check(&scene)?;
    Simulation::prepare(&scene)?;
    let mut progress = Progress::new(session.passes.iter().map(|pass| pass.ticks).sum(), "ticks");
    let mut passes = Vec::new();
    for pass in &session.passes {
        progress.begin(&format!("pass {}", pass.pass));
        let simulation = session.prepare(&scene, pass)?;
        let went = session::replay(simulation, pass, |view| progress.set(view.tick + 1));
        progress.end(pass.ticks);
        let (is_same, words) = match went {
            ReplayOutcome::Same { fault: None } => (true, format!("{} ticks, the same to the bit", pass.ticks)),
            ReplayOutcome::Same { fault: Some(fault) } => {
                (true, format!("{} ticks, the same to the bit, with the same end: {fault}", pass.ticks))
            }
            ReplayOutcome::Differs { tick: Some(tick) } => (false, format!("DIFFERS from tick {tick} on")),
            ReplayOutcome::Differs { tick: None } => (false, "DIFFERS: the forces have another checksum".to_owned()),
            ReplayOutcome::Ended { ticks, fault } => {
                let why = fault.map_or("the scene's duration is over".to_owned(), |fault| fault.to_string());
                (false, format!("ENDED after {ticks} of {} ticks: {why}", pass.ticks))
            }
        };
        passes.push(Went { pass: pass.pass, same: is_same, how: words });
    }
    drop(progress);
    for Went { pass, how, .. } in &passes {
        say(format_args!("pass {pass}: {how}"))?;
    }
    let timed = if session.worst.is_empty() { Vec::new() } else { time_ticks(&session, &scene)? };
    if !timed.is_empty() {
        say(table(&timed))?;
    }
    let same = passes.iter().all(|pass| pass.same);
    hand_out(&Found { same, passes: &passes, worst: &timed })?;
    Ok(if same { PASS } else { FAIL })
}

/// Builds the table of ticks that were timed again.
pub fn table(timed: &[TimedTick]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header([
        "pass",
        "tick",
        "why",
        "warm caches: median, longest (µs)",
        "cold caches: median, longest (µs)",
    ]);
    for tick in timed {
        let us = |[median, max]: [u64; 2]| format!("{:.2}, {:.2}", median as f64 * 1e-3, max as f64 * 1e-3);
        table.add_row([
            tick.pass.to_string(),
            tick.tick.to_string(),
            names(&tick.why),
            us(tick.warm_ns),
            us(tick.cold_ns),
        ]);
    }
    table
}
