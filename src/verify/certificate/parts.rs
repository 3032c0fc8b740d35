//! The parts of a certificate, each a verdict with its reasons.

use std::collections::BTreeMap;

use serde::Serialize;

use super::causes::MissCause;
use super::verdict::WorstTick;
pub use crate::output::verdict::Verdict;
use crate::realtime::builder::GlobalTimes;
use crate::realtime::exercise::Exercise;
use crate::realtime::meter::Meter;
use crate::realtime::record::Quantiles;
use crate::realtime::threads::{Obtained, Window};

/// Least number of ticks for a verdict.
pub(super) const LEAST_TICKS: u64 = 1000;
/// Least number of models for a verdict on the global side.
const LEAST_MODELS: u64 = 10;

/// Part of a certificate on the program itself.
#[derive(Debug, Clone, Serialize)]
pub struct ComputePart {
    /// Whether the program's own time keeps the deadline.
    pub verdict: Verdict,
    /// Reasons for the verdict.
    pub reasons: Vec<String>,
    /// Wall time from begin to command, ns.
    pub compute_ns: Quantiles,
    /// CPU time from begin to command, ns, including about 0.2 µs for reading that clock.
    pub cpu_ns: Quantiles,
    /// Wall time of the first pass's ticks when repeated after the load has ended, ns: the program's cost where nothing
    /// else has the core. It includes a modelled instrument, which the window's times do not.
    pub idle_ns: Quantiles,
}

/// Part of a certificate on the global side: the network's cycles and the models built from them.
#[derive(Debug, Clone, Serialize)]
pub struct GlobalPart {
    /// Whether every cycle delivered its model in time.
    pub verdict: Verdict,
    /// Reasons for the verdict.
    pub reasons: Vec<String>,
    /// Deadline of a cycle, µs: its own duration.
    pub deadline_us: f64,
    /// Number of ticks in a cycle.
    pub ticks_per_cycle: u64,
    /// Number of models built in the window.
    pub models_built: u64,
    /// Number of models that took longer than a cycle.
    pub late_models: u64,
    /// Number of cycles without a model of their own, because the global side was not ready for them.
    pub shared_cycles: u64,
    /// Number of the servo side's notes that did not fit into the ring.
    pub lost_notes: u64,
    /// Largest number of ticks from the boundary that a model was built from to its first tick.
    pub largest_latency_ticks: u64,
    /// Largest number of ticks from that boundary to a tick that used the model.
    pub largest_age_ticks: u64,
    /// Wall time from the receipt of a cycle to its model, ns.
    pub cycle_ns: Quantiles,
    /// CPU time of the global thread in the same interval, ns.
    pub cpu_ns: Quantiles,
}

/// What the window exercised, compared with a whole run of the scene in lockstep.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Coverage {
    /// Share of the scene's path that the longest pass covered, at most 1.
    pub path_share: f64,
    /// Number of ticks that were asked for.
    pub asked_ticks: u64,
    /// Counts of the window, over all passes.
    pub window: Exercise,
    /// Counts of the scene's path in lockstep.
    pub lockstep: Exercise,
}

/// Control loop without a payload, released half a tick after each tick: it shows the machine without the program.
#[derive(Debug, Clone, Serialize)]
pub struct ControlPart {
    /// Time from release to begin, ns.
    pub release_ns: Quantiles,
    /// Time from release to the end of the empty computation, ns.
    pub response_ns: Quantiles,
    /// Deadlines missed by the control loop.
    pub misses: u64,
    /// Releases that were omitted, because they had passed before the tick ended.
    pub skipped: u64,
}

/// Part of a certificate on the commands of the program on this machine.
#[derive(Debug, Clone, Serialize)]
pub struct PlatformPart {
    /// Whether commands met their deadlines.
    pub verdict: Verdict,
    /// Reasons for the verdict.
    pub reasons: Vec<String>,
    /// Exact number of ticks whose command came too late.
    pub misses: u64,
    /// Number of skipped ticks.
    pub skipped: u64,
    /// Largest number of consecutive late or skipped ticks.
    pub longest_miss_run: u64,
    /// Time from the scheduled release to the command, ns.
    pub response_ns: Quantiles,
    /// Time from the scheduled release to the tick's begin, ns.
    pub release_ns: Quantiles,
    /// Number of misses by cause.
    pub causes: BTreeMap<MissCause, u64>,
    /// Number of misses without a cause: those beyond the recorded ones.
    pub misses_without_cause: u64,
    /// Control loop without a payload.
    pub control: ControlPart,
}

impl Coverage {
    /// Returns what the scene's path of `path_s` seconds exercises and the window does not.
    pub(super) fn gaps(&self, path_s: f64) -> Vec<String> {
        let mut gaps = Vec::new();
        if !(self.path_share >= 1.0) {
            gaps.push(format!(
                "the window covers {:.1} % of the scene's path of {path_s} s: measure for at least {path_s} s",
                100.0 * self.path_share
            ));
        }
        for ((what, seen), (_, expected)) in self.window.named().into_iter().zip(self.lockstep.named()) {
            if seen == 0 && expected > 0 {
                gaps.push(format!(
                    "no {what} in the window, but {expected} in the scene's lockstep run: measure for longer"
                ));
            }
        }
        gaps
    }
}

/// The repetition of a loop in virtual time.
pub(super) struct Replayed<'a> {
    /// Whether every repeated pass commanded the same forces to the bit.
    pub same: bool,
    /// Longest ticks, repeated.
    pub worst: &'a [WorstTick],
    /// Times of the first pass, repeated without load, ns.
    pub idle: Quantiles,
}

/// Judges the program: its own time, that it allocates nothing, and that its ticks repeat. `open` lists what was not
/// measured.
pub(super) fn compute_part(
    meter: &Meter,
    window: &Window,
    replayed: Replayed,
    fault: Option<&str>,
    mut open: Vec<String>,
) -> ComputePart {
    let Replayed { same, worst, idle } = replayed;
    let deadline_ns = meter.deadline_ns();
    let us = |ns: u64| ns as f64 * 1e-3;
    let (mut failed, mut passed) = (Vec::new(), Vec::new());
    if let Some(fault) = fault {
        failed.push(format!("the run ended in a fault: {fault}"));
    }
    match window.allocations {
        Some(0) => passed.push("no allocator calls in the window".to_owned()),
        Some(calls) => failed.push(format!("{calls} allocator calls in the window; 0 are allowed")),
        None => open.push("allocator calls were not counted".to_owned()),
    }
    match (same, window.lost_notes) {
        (true, _) => passed.push("repeated passes command the same forces to the bit".to_owned()),
        (false, 0) => failed.push("a repeated pass commands different forces".to_owned()),
        // Models may have been built from a path with gaps, while the repetition builds them from the whole path. Which
        // pass lost the notes is not known.
        (false, lost) => open.push(format!(
            "a repeated pass commands different forces, possibly because of {lost} notes lost to a full ring: \
             the global side was late by cycles and built models from a path with gaps"
        )),
    }
    // A tick that is slow by itself is slow again when it is repeated.
    let slow = worst.iter().filter(|tick| tick.warm_ns[0].max(tick.cold_ns[0]) > deadline_ns);
    for tick in slow {
        let took = us(tick.warm_ns[0].max(tick.cold_ns[0]));
        failed.push(format!("tick {} of pass {} takes {took:.1} µs whenever it is repeated", tick.tick, tick.pass));
    }
    let longest = meter.cpu.max_ns();
    if longest <= deadline_ns {
        passed.push(format!("no tick took more than {:.1} µs of CPU time", us(longest)));
        passed.push(format!("on an idle core, no tick of the first pass took more than {:.1} µs", us(idle.max)));
    } else if failed.is_empty() {
        open.push(format!(
            "a tick took {:.1} µs of CPU time, which includes time taken by a hypervisor or interrupts; repeated on an \
             idle core, the worst ticks keep the deadline and the longest took {:.1} µs: measure on a quieter machine",
            us(longest),
            us(idle.max)
        ));
    }
    if meter.ticks() < LEAST_TICKS {
        open.push(format!("{} ticks are too few; at least {LEAST_TICKS} are needed", meter.ticks()));
    }
    let (verdict, reasons) = judge(failed, open, passed);
    let (compute_ns, cpu_ns) = (Quantiles::of(&meter.compute), Quantiles::of(&meter.cpu));
    ComputePart { verdict, reasons, compute_ns, cpu_ns, idle_ns: idle }
}

/// Judges the global side: every cycle has a model before the next one ends, built from the whole path.
pub(super) fn global_part(global: &GlobalTimes, window: &Window) -> GlobalPart {
    let (mut failed, mut open, mut passed) = (Vec::new(), Vec::new(), Vec::new());
    let (models, cycle_ticks) = (global.models_built(), global.ticks_per_cycle());
    let ms = |ns: u64| ns as f64 * 1e-6;
    let deadline_ms = ms(global.deadline_ns());
    match window.lost_notes {
        0 => passed.push("no note lost".to_owned()),
        lost => failed.push(format!(
            "{lost} notes were lost to a full ring, so that models were built from a path with gaps: give the global \
             side a CPU of its own, or a lower `global.rate`"
        )),
    }
    match global.late() {
        0 => passed.push(format!("no model took more than {:.1} of {deadline_ms:.1} ms", ms(global.cycle.max_ns()))),
        late => {
            let cpu_ns = global.cpu.max_ns();
            let way_out = if cpu_ns <= global.deadline_ns() {
                "the CPU time keeps the deadline, so the machine is the cause: give the global side a CPU of its own"
            } else {
                "the computation is too long: give a lower `global.rate` or fewer `global.substeps`"
            };
            failed.push(format!(
                "{late} of {models} models took longer than their cycle of {deadline_ms:.1} ms, at most {:.1} ms, of \
                 which {:.1} ms CPU time; {way_out}",
                ms(global.cycle.max_ns()),
                ms(cpu_ns)
            ));
        }
    }
    // A model that is complete within a cycle from its boundary is replaced a cycle later at the latest.
    let oldest = global.largest_age_ticks();
    if oldest < 2 * cycle_ticks {
        passed.push(format!("no model was more than {oldest} ticks old"));
    } else {
        failed.push(format!(
            "a model was {oldest} ticks old when it was used; with cycles of {cycle_ticks} ticks at most {} are allowed, \
             and {} cycles had no model of their own",
            2 * cycle_ticks - 1,
            global.shared()
        ));
    }
    if models < LEAST_MODELS {
        open.push(format!("{models} models are too few; at least {LEAST_MODELS} are needed: measure for longer"));
    }
    let (verdict, reasons) = judge(failed, open, passed);
    GlobalPart {
        verdict,
        reasons,
        deadline_us: global.deadline_ns() as f64 * 1e-3,
        ticks_per_cycle: cycle_ticks,
        models_built: models,
        late_models: global.late(),
        shared_cycles: global.shared(),
        lost_notes: window.lost_notes,
        largest_latency_ticks: global.largest_latency_ticks(),
        largest_age_ticks: oldest,
        cycle_ns: Quantiles::of(&global.cycle),
        cpu_ns: Quantiles::of(&global.cpu),
    }
}

/// Judges the result on this machine: deadlines apply to responses. `open` lists what was not measured.
pub(super) fn platform_part(
    meter: &Meter,
    window: &Window,
    obtained: &Obtained,
    causes: BTreeMap<MissCause, u64>,
    explained: u64,
    mut open: Vec<String>,
) -> PlatformPart {
    let (mut failed, mut passed) = (Vec::new(), Vec::new());
    let (control_misses, skipped) = meter.control_missed();
    match meter.missed() {
        0 => passed.push(format!("no deadline missed in {} ticks", meter.ticks())),
        misses => failed.push(format!("{misses} of {} ticks missed their deadline", meter.ticks())),
    }
    if meter.skipped() > 0 {
        failed.push(format!("{} ticks were skipped", meter.skipped()));
    }
    if !failed.is_empty() && control_misses > 0 {
        failed.push(format!(
            "the control loop without a payload missed {control_misses} of {} deadlines: the machine alone causes misses",
            meter.control_response.count()
        ));
    }
    if obtained.is_realtime() {
        passed.push(format!("{} at priority {}", obtained.policy, obtained.priority));
    } else {
        open.push(format!(
            "SCHED_FIFO was not granted ({}): nothing else can be proven; allow real-time scheduling",
            obtained.policy
        ));
    }
    match (obtained.memory_locked, window.page_faults) {
        (true, 0) => passed.push("memory locked, no page fault in the window".to_owned()),
        (true, faults) => failed.push(format!("{faults} page faults in the window, though memory was locked; 0 are allowed")),
        (false, faults) => open.push(format!(
            "memory was not locked and {faults} page faults occurred in the window: any tick may incur one; allow locked \
             memory"
        )),
    }
    if meter.ticks() < LEAST_TICKS {
        open.push(format!("{} ticks are too few; at least {LEAST_TICKS} are needed", meter.ticks()));
    }
    let (verdict, reasons) = judge(failed, open, passed);
    PlatformPart {
        verdict,
        reasons,
        misses: meter.missed(),
        skipped: meter.skipped(),
        longest_miss_run: meter.longest_run(),
        response_ns: Quantiles::of(&meter.response),
        release_ns: Quantiles::of(&meter.release),
        causes,
        misses_without_cause: meter.missed() - explained,
        control: ControlPart {
            release_ns: Quantiles::of(&meter.control_release),
            response_ns: Quantiles::of(&meter.control_response),
            misses: control_misses,
            skipped,
        },
    }
}

/// Returns the verdict, the worst of what was found, with its reasons.
pub(super) fn judge(failed: Vec<String>, open: Vec<String>, passed: Vec<String>) -> (Verdict, Vec<String>) {
    if !failed.is_empty() {
        (Verdict::Fail, failed)
    } else if !open.is_empty() {
        (Verdict::Inconclusive, open)
    } else {
        (Verdict::Pass, passed)
    }
}
