//! What a measured loop proves: two verdicts, and everything they rest on.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::multirate::timeline::OverrunPolicy;
use crate::realtime::machine::Machine;
use crate::realtime::meter::{Meter, Miss, TickTimes};
use crate::realtime::record::Quantiles;
use crate::realtime::threads::{Obtained, Served, Window};
use crate::session::ReplayReason;
use crate::verify::certificate::bounds::{Independence, RateBound, Trials, Untested, ljung_box};
use crate::verify::certificate::causes::{MissCause, Missed, StealSample, steal_grew};
use crate::verify::certificate::tail::Tail;
use crate::verify::lateness::Consequences;

/// Fewer ticks prove nothing.
const LEAST_TICKS: u64 = 1000;
/// Lags of the test of independence.
const LAGS: usize = 10;
/// Around a miss, in which growth of the stolen time counts for it: what the kernel accounts in, and what lies
/// between two looks at it, ns.
const STEAL_MARGIN_NS: u64 = 50_000_000;

/// What can be said.
///
/// ```
/// use stickslip::verify::certificate::verdict::Verdict;
///
/// let verdicts = [Verdict::Pass, Verdict::Fail, Verdict::Inconclusive];
/// assert_eq!(serde_json::to_value(verdicts)?, serde_json::json!(verdicts.map(Verdict::name)));
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Verdict {
    /// It keeps its deadlines, as far as was measured.
    Pass,
    /// It does not.
    Fail,
    /// What was measured does not decide it.
    Inconclusive,
}

impl Verdict {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Pass => "PASS",
            Verdict::Fail => "FAIL",
            Verdict::Inconclusive => "INCONCLUSIVE",
        }
    }
}

/// A tick that took longest, as it went and done again.
#[derive(Debug, Clone, Serialize)]
pub struct WorstTick {
    /// The run of the path that it belongs to.
    pub pass: u32,
    /// Counted from 0 in its pass.
    pub tick: u64,
    /// Why it is here.
    pub why: ReplayReason,
    /// As it went; absent for a tick that is here for its kind.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub times: Option<TickTimes>,
    /// Done again with warm caches: median and longest, ns.
    pub warm_ns: [u64; 2],
    /// With cold caches.
    pub cold_ns: [u64; 2],
}

/// The program's own part.
#[derive(Debug, Clone, Serialize)]
pub struct ComputePart {
    /// Whether its own time keeps the deadline.
    pub verdict: Verdict,
    /// Why.
    pub reasons: Vec<String>,
    /// From begin to command, on the wall clock.
    pub compute_ns: Quantiles,
    /// CPU time of the same, with the 0.2 µs or so that reading that clock takes.
    pub cpu_ns: Quantiles,
}

/// The loop that does nothing, released half a tick after each tick: what the machine does without the program.
#[derive(Debug, Clone, Serialize)]
pub struct ControlPart {
    /// From release to begin.
    pub release_ns: Quantiles,
    /// From release until nothing has been done.
    pub response_ns: Quantiles,
    /// Deadlines that it missed.
    pub misses: u64,
    /// Releases that had passed before the tick was done.
    pub left_out: u64,
}

/// The machine's part.
#[derive(Debug, Clone, Serialize)]
pub struct PlatformPart {
    /// Whether commands came by their deadline.
    pub verdict: Verdict,
    /// Why.
    pub reasons: Vec<String>,
    /// Ticks whose command came too late, exactly.
    pub misses: u64,
    /// Ticks that were left out.
    pub skipped: u64,
    /// Missed or left out, one after the other.
    pub longest_miss_run: u64,
    /// From the scheduled release to the command.
    pub response_ns: Quantiles,
    /// From the scheduled release to the tick's begin.
    pub release_ns: Quantiles,
    /// Misses by what they come from.
    pub causes: BTreeMap<MissCause, u64>,
    /// Misses beyond those that are kept one by one, which have no cause.
    pub misses_without_cause: u64,
    /// Beside it.
    pub control: ControlPart,
}

/// A deadline that was missed.
#[derive(Debug, Clone, Serialize)]
pub struct MissEntry {
    /// What it took.
    #[serde(flatten)]
    pub times: TickTimes,
    /// Its release, s from the begin of the window.
    pub at_s: f64,
    /// What it comes from.
    pub cause: MissCause,
}

/// What the misses, or their absence, say about the rate of misses.
#[derive(Debug, Clone, Serialize)]
pub struct MissRate {
    /// If ticks are independent of each other.
    pub ticks: Option<RateBound>,
    /// Of blocks of ticks with a miss, if blocks are: misses come in clusters.
    pub blocks: Option<RateBound>,
    /// Ticks of a block.
    pub block_ticks: u64,
    /// Whether the longest responses of blocks are, by their autocorrelation.
    pub independence: Option<Independence>,
    /// Why that could not be tested.
    pub untested: Option<String>,
}

/// `certificate.json`.
///
/// A judgement of ten ticks, one of which was woken too late:
///
/// ```
/// use stickslip::verify::certificate::verdict::{Certificate, Circumstances, Verdict};
/// use stickslip::realtime::meter::{Meter, TickTimes};
/// use stickslip::realtime::threads::{Obtained, Served, Window};
/// # use stickslip::realtime::machine::Machine;
/// # use stickslip::multirate::timeline::OverrunPolicy;
/// # use stickslip::verify::lateness::{Consequence, Consequences};
/// use stickslip::verify::certificate::causes::MissCause;
///
/// let mut meter = Meter::new(10, 500_000);
/// let usual = TickTimes { response_ns: 60_000, compute_ns: 50_000, cpu_ns: 50_000, ..TickTimes::default() };
/// for tick in 0..9 {
///     meter.tick(TickTimes { tick, ..usual }, tick * 1_000_000);
/// }
/// meter.tick(TickTimes { tick: 9, release_ns: 900_000, response_ns: 950_000, ..usual }, 9_000_000);
/// # let (passes, stopped, fault) = (vec![], false, None);
/// # let window = Window { allocations: Some(0), end_ns: 10_000_000, ..Window::default() };
/// # let obtained = Obtained { policy: "SCHED_FIFO", priority: 80,
/// #     cpus: vec![0], memory_locked: true, refused: vec![] };
/// let served = Served { passes, meter, window, obtained, stopped, fault };
/// # let overrun = OverrunPolicy::Hold;
/// # let on_time = Consequence {
/// #     overrun, share: 0.0, missed_ticks: [0; 2], force_error_rms_rel: Some(0.0), largest_jump_n: 0.0,
/// #     contact_losses: 0, energy_given_j: 0.0, fault: None,
/// # };
/// # let consequences = Consequences { late_tick_ticks: 1.5, on_time, late: vec![] };
/// # let circumstances = Circumstances {
/// #     scene: "example".into(), rate_hz: 1e3, overrun, load: "none".into(), steal: vec![],
/// #     machine: Machine::describe(0), replayed: true, worst: vec![], consequences,
/// # };
/// let certificate = Certificate::new(&served, circumstances);
/// // The program was never slow, but that is not known of ten ticks. The deadline was missed all the same.
/// assert_eq!(certificate.compute.verdict, Verdict::Inconclusive);
/// assert_eq!(certificate.platform.verdict, Verdict::Fail);
/// assert_eq!(certificate.platform.causes[&MissCause::Release], 1);
/// assert_eq!(certificate.verdict(), Verdict::Fail);
/// ```
#[derive(Debug, Clone, Serialize)]
pub struct Certificate {
    /// Of the program.
    pub version: &'static str,
    /// Its name.
    pub scene: String,
    /// Done in the window.
    pub ticks: u64,
    /// Of the window, s.
    pub duration_s: f64,
    /// Of the local loop.
    pub rate_hz: f64,
    /// From a tick's release.
    pub deadline_us: f64,
    /// What a missed one did.
    pub overrun: OverrunPolicy,
    /// What else the machine did.
    pub load: String,
    /// Whether it was ended before its time.
    pub stopped: bool,
    /// The fault that ended it, if one did.
    pub fault: Option<String>,
    /// The servo thread's own counters.
    pub window: Window,
    /// The program's own part.
    pub compute: ComputePart,
    /// The machine's part.
    pub platform: PlatformPart,
    /// What follows for the rate of misses.
    pub miss_rate: MissRate,
    /// How long the longest response may become in a longer run.
    pub extrapolation: Tail,
    /// What missed deadlines would do to this scene, in virtual time.
    pub consequences: Consequences,
    /// What the servo thread had.
    pub settings: Obtained,
    /// Where it ran.
    pub machine: Machine,
    /// Time that the hypervisor took within the window, in ticks of the kernel's accounting; absent if it does not say.
    pub stolen: Option<u64>,
    /// Whether every recorded pass that was done again commanded the same forces to the bit.
    pub replayed: bool,
    /// Ticks that took longest, done again.
    pub worst: Vec<WorstTick>,
    /// The first misses.
    pub misses: Vec<MissEntry>,
}

/// What surrounds a measured loop.
#[derive(Debug)]
pub struct Circumstances {
    /// Its scene.
    pub scene: String,
    /// Hz.
    pub rate_hz: f64,
    /// Planned.
    pub overrun: OverrunPolicy,
    /// In words.
    pub load: String,
    /// What the hypervisor had taken, on `CLOCK_MONOTONIC`, ascending.
    pub steal: Vec<StealSample>,
    /// The machine.
    pub machine: Machine,
    /// Whether recorded passes came out the same.
    pub replayed: bool,
    /// Ticks that were done again.
    pub worst: Vec<WorstTick>,
    /// What missed deadlines would do.
    pub consequences: Consequences,
}

impl Certificate {
    /// Judges a loop.
    pub fn new(served: &Served, around: Circumstances) -> Self {
        let Served { meter, window, obtained, stopped, fault, .. } = served;
        let fault = fault.map(|fault| fault.to_string());
        let stolen =
            around.steal.first().zip(around.steal.last()).map(|(first, last)| last.stolen_ticks - first.stolen_ticks);
        let misses = explain(meter, window, &around.steal, &around.worst);
        let mut causes = BTreeMap::new();
        misses.iter().for_each(|miss| *causes.entry(miss.cause).or_insert(0) += 1);
        let block_ticks = meter.blocks().first().map_or(0, |block| block.ticks);
        let whole = meter.blocks().iter().filter(|block| block.ticks == block_ticks);
        let maxima_ns: Vec<u64> = whole.map(|block| block.response_max_ns).collect();
        let maxima: Vec<f64> = maxima_ns.iter().map(|&ns| ns as f64).collect();
        let independence = ljung_box(&maxima, LAGS);
        let missed_blocks = meter.blocks().iter().filter(|block| block.misses > 0).count() as u64;
        Self {
            version: env!("CARGO_PKG_VERSION"),
            scene: around.scene,
            ticks: meter.ticks(),
            duration_s: window.end_ns.saturating_sub(window.begin_ns) as f64 * 1e-9,
            rate_hz: around.rate_hz,
            deadline_us: meter.deadline_ns() as f64 * 1e-3,
            overrun: around.overrun,
            load: around.load,
            stopped: *stopped,
            window: *window,
            compute: compute_part(meter, window, &around.worst, around.replayed, fault.as_deref()),
            platform: platform_part(meter, obtained, causes, misses.len() as u64),
            miss_rate: MissRate {
                ticks: RateBound::of(meter.missed() + meter.skipped(), meter.ticks() + meter.skipped(), Trials::Ticks),
                blocks: RateBound::of(missed_blocks, meter.blocks().len() as u64, Trials::Blocks),
                block_ticks,
                untested: independence.as_ref().err().map(Untested::to_string),
                independence: independence.ok(),
            },
            extrapolation: Tail::of_block_maxima(&maxima_ns, block_ticks),
            consequences: around.consequences,
            settings: obtained.clone(),
            machine: around.machine,
            stolen,
            replayed: around.replayed,
            worst: around.worst,
            misses,
            fault,
        }
    }

    /// What a program that asks for it should be told.
    pub fn verdict(&self) -> Verdict {
        match (self.compute.verdict, self.platform.verdict) {
            (Verdict::Fail, _) | (_, Verdict::Fail) => Verdict::Fail,
            (Verdict::Pass, Verdict::Pass) => Verdict::Pass,
            _ => Verdict::Inconclusive,
        }
    }
}

/// Judges the program: what it takes itself, and that it takes nothing it should not.
fn compute_part(
    meter: &Meter,
    window: &Window,
    worst: &[WorstTick],
    replayed: bool,
    fault: Option<&str>,
) -> ComputePart {
    let deadline_ns = meter.deadline_ns();
    let us = |ns: u64| ns as f64 * 1e-3;
    let (mut failed, mut open, mut passed) = (Vec::new(), Vec::new(), Vec::new());
    if let Some(fault) = fault {
        failed.push(format!("the run ended in a fault: {fault}"));
    }
    match window.allocations {
        Some(0) => passed.push("no call of the allocator in the window".to_owned()),
        Some(calls) => failed.push(format!("{calls} calls of the allocator in the window")),
        None => open.push("nobody counted calls of the allocator".to_owned()),
    }
    match (replayed, window.lost_notes) {
        (true, _) => passed.push("recorded passes, done again, command the same forces to the bit".to_owned()),
        (false, 0) => failed.push("a recorded pass, done again, commands other forces".to_owned()),
        // Models may have come from a path with gaps, and come from the whole one when it is done again. Which pass lost
        // them is not known.
        (false, lost) => open.push(format!(
            "a recorded pass, done again, commands other forces, which may come of {lost} notes lost to a full ring: \
             the global side was late by cycles and built models from a path with gaps"
        )),
    }
    // What is slow by itself is slow again.
    let slow = worst.iter().filter(|tick| tick.warm_ns[0].max(tick.cold_ns[0]) > deadline_ns);
    for tick in slow {
        let took = us(tick.warm_ns[0].max(tick.cold_ns[0]));
        failed.push(format!("tick {} of pass {} takes {took:.1} µs each time it is done again", tick.tick, tick.pass));
    }
    let longest = meter.cpu.max_ns();
    if longest <= deadline_ns {
        passed.push(format!("no tick took more than {:.1} µs of CPU time", us(longest)));
    } else if failed.is_empty() {
        open.push(format!(
            "a tick took {:.1} µs of CPU time, which includes what a hypervisor or interrupts took; done again, the \
             worst ticks keep the deadline",
            us(longest)
        ));
    }
    if meter.ticks() < LEAST_TICKS {
        open.push(format!("{} ticks are fewer than {LEAST_TICKS}", meter.ticks()));
    }
    let (verdict, reasons) = judge(failed, open, passed);
    ComputePart { verdict, reasons, compute_ns: Quantiles::of(&meter.compute), cpu_ns: Quantiles::of(&meter.cpu) }
}

/// Judges what came of it on this machine: deadlines are about responses.
fn platform_part(meter: &Meter, obtained: &Obtained, causes: BTreeMap<MissCause, u64>, explained: u64) -> PlatformPart {
    let (mut failed, mut open, mut passed) = (Vec::new(), Vec::new(), Vec::new());
    let (control_misses, left_out) = meter.control_missed();
    match meter.missed() {
        0 => passed.push(format!("no deadline missed in {} ticks", meter.ticks())),
        misses => failed.push(format!("{misses} of {} ticks missed their deadline", meter.ticks())),
    }
    if meter.skipped() > 0 {
        failed.push(format!("{} ticks were left out", meter.skipped()));
    }
    if !failed.is_empty() && control_misses > 0 {
        failed.push(format!("so did {control_misses} of {} empty ones", meter.control_response.count()));
    }
    if obtained.is_realtime() {
        passed.push(format!("{} at priority {}", obtained.policy, obtained.priority));
    } else {
        open.push(format!("without the right to SCHED_FIFO ({}) nothing else can be proven", obtained.policy));
    }
    if !obtained.memory_locked {
        open.push("memory was not locked: any tick may meet a page fault".to_owned());
    }
    if meter.ticks() < LEAST_TICKS {
        open.push(format!("{} ticks are fewer than {LEAST_TICKS}", meter.ticks()));
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
            left_out,
        },
    }
}

fn judge(failed: Vec<String>, open: Vec<String>, passed: Vec<String>) -> (Verdict, Vec<String>) {
    if !failed.is_empty() {
        (Verdict::Fail, failed)
    } else if !open.is_empty() {
        (Verdict::Inconclusive, open)
    } else {
        (Verdict::Pass, passed)
    }
}

/// What every miss comes from. The clock of a thread's CPU time runs on while interrupts and a hypervisor have the
/// CPU. A tick does the same again, though: what it took beyond the longest of all ticks that were done again with
/// cold caches was somebody else's.
fn explain(meter: &Meter, window: &Window, steal: &[StealSample], worst: &[WorstTick]) -> Vec<MissEntry> {
    let longest_again = worst.iter().map(|tick| tick.cold_ns[1].max(tick.warm_ns[1])).max().unwrap_or(u64::MAX);
    let missed = |miss: &Miss| {
        let TickTimes { release_ns, response_ns, compute_ns, cpu_ns, .. } = miss.times;
        let released = window.begin_ns + miss.at_ns;
        let to = released + response_ns + STEAL_MARGIN_NS;
        Missed {
            deadline_ns: meter.deadline_ns(),
            release_ns,
            response_ns,
            compute_ns,
            cpu_ns: cpu_ns.min(longest_again),
            page_faults: miss.usage.page_faults,
            involuntary_switches: miss.usage.involuntary_switches,
            follows: miss.follows,
            steal: steal_grew(steal, released.saturating_sub(STEAL_MARGIN_NS), to),
            typical_compute_ns: meter.compute.quantile_ns(0.5),
            typical_cpu_ns: meter.cpu.quantile_ns(0.5),
        }
    };
    let misses: Vec<Missed> = meter.misses().iter().map(missed).collect();
    let causes = MissCause::of_all(&misses);
    let entry =
        |(miss, cause): (&Miss, MissCause)| MissEntry { times: miss.times, at_s: miss.at_ns as f64 * 1e-9, cause };
    meter.misses().iter().zip(causes).map(entry).collect()
}
