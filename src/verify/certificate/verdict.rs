//! Certificate of a measured loop: two verdicts and the evidence for them.

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

/// Least number of ticks for a verdict.
const LEAST_TICKS: u64 = 1000;
/// Lags of the test of independence.
const LAGS: usize = 10;
/// Margin around a miss, in which growth of the stolen time counts for it, ns: it covers the interval of the kernel's
/// accounting and that between two samples of it.
const STEAL_MARGIN_NS: u64 = 50_000_000;

/// Verdict on a loop.
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
    /// The loop keeps its deadlines, as far as was measured.
    Pass,
    /// The loop does not keep its deadlines.
    Fail,
    /// The measurements do not decide.
    Inconclusive,
}

impl Verdict {
    /// Returns the name as it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Pass => "PASS",
            Verdict::Fail => "FAIL",
            Verdict::Inconclusive => "INCONCLUSIVE",
        }
    }
}

/// One of the longest ticks, as recorded and repeated.
#[derive(Debug, Clone, Serialize)]
pub struct WorstTick {
    /// Run of the path to which the tick belongs.
    pub pass: u32,
    /// Number of the tick in its pass, counted from 0.
    pub tick: u64,
    /// Reason for which the tick was repeated.
    pub why: ReplayReason,
    /// Recorded times; absent for a tick that was chosen for its kind.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub times: Option<TickTimes>,
    /// Times when repeated with warm caches: median and longest, ns.
    pub warm_ns: [u64; 2],
    /// Times when repeated with cold caches: median and longest, ns.
    pub cold_ns: [u64; 2],
}

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

/// Part of a certificate on the program on this machine.
#[derive(Debug, Clone, Serialize)]
pub struct PlatformPart {
    /// Whether commands came by their deadline.
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

/// Deadline miss.
#[derive(Debug, Clone, Serialize)]
pub struct MissEntry {
    /// Times of the tick.
    #[serde(flatten)]
    pub times: TickTimes,
    /// Release of the tick, s from the begin of the window.
    pub at_s: f64,
    /// Cause of the miss.
    pub cause: MissCause,
}

/// Bounds of the rate of deadline misses.
#[derive(Debug, Clone, Serialize)]
pub struct MissRate {
    /// Bound for ticks, valid if ticks are independent of each other.
    pub ticks: Option<RateBound>,
    /// Bound for blocks of ticks with a miss, valid if blocks are independent: misses come in clusters.
    pub blocks: Option<RateBound>,
    /// Number of ticks in a block.
    pub block_ticks: u64,
    /// Test of independence of the blocks' longest responses, by their autocorrelation.
    pub independence: Option<Independence>,
    /// Reason for which independence could not be tested.
    pub untested: Option<String>,
}

/// Certificate of a loop's deadlines, the content of `certificate.json`.
///
/// This certificate covers ten ticks, one of which was woken too late:
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
/// // The program was never slow, but ten ticks are too few to prove it. The deadline was missed all the same.
/// assert_eq!(certificate.compute.verdict, Verdict::Inconclusive);
/// assert_eq!(certificate.platform.verdict, Verdict::Fail);
/// assert_eq!(certificate.platform.causes[&MissCause::Release], 1);
/// assert_eq!(certificate.verdict(), Verdict::Fail);
/// ```
#[derive(Debug, Clone, Serialize)]
pub struct Certificate {
    /// Version of the program.
    pub version: &'static str,
    /// Name of the scene.
    pub scene: String,
    /// Number of ticks in the window.
    pub ticks: u64,
    /// Duration of the window, s.
    pub duration_s: f64,
    /// Rate of the local loop, Hz.
    pub rate_hz: f64,
    /// Deadline from a tick's release, µs.
    pub deadline_us: f64,
    /// Policy for missed deadlines.
    pub overrun: OverrunPolicy,
    /// Description of the other load on the machine.
    pub load: String,
    /// Whether the run was stopped early.
    pub stopped: bool,
    /// Fault that ended the run, if one did.
    pub fault: Option<String>,
    /// Counters of the servo thread.
    pub window: Window,
    /// Verdict on the program itself.
    pub compute: ComputePart,
    /// Verdict on the program on this machine.
    pub platform: PlatformPart,
    /// Bounds of the rate of deadline misses.
    pub miss_rate: MissRate,
    /// Extrapolation of the longest response to longer runs.
    pub extrapolation: Tail,
    /// Effect of missed deadlines on this scene, in virtual time.
    pub consequences: Consequences,
    /// Scheduling settings actually granted.
    pub settings: Obtained,
    /// Description of the machine.
    pub machine: Machine,
    /// Time taken by the hypervisor within the window, in ticks of the kernel's accounting; absent if not reported.
    pub stolen: Option<u64>,
    /// Whether every repeated pass commanded the same forces to the bit.
    pub replayed: bool,
    /// Longest ticks, repeated.
    pub worst: Vec<WorstTick>,
    /// First misses of the window.
    pub misses: Vec<MissEntry>,
}

/// Circumstances of a measured loop.
#[derive(Debug)]
pub struct Circumstances {
    /// Name of the scene.
    pub scene: String,
    /// Rate of the local loop, Hz.
    pub rate_hz: f64,
    /// Policy for missed deadlines.
    pub overrun: OverrunPolicy,
    /// Description of the other load on the machine.
    pub load: String,
    /// Samples of the time taken by the hypervisor, on `CLOCK_MONOTONIC`, ascending.
    pub steal: Vec<StealSample>,
    /// Description of the machine.
    pub machine: Machine,
    /// Whether every repeated pass commanded the same forces to the bit.
    pub replayed: bool,
    /// Longest ticks, repeated.
    pub worst: Vec<WorstTick>,
    /// Effect of missed deadlines on this scene, in virtual time.
    pub consequences: Consequences,
}

impl Certificate {
    /// Judges a measured loop.
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

    /// Returns the verdict on the whole: the worse of the two.
    pub fn verdict(&self) -> Verdict {
        match (self.compute.verdict, self.platform.verdict) {
            (Verdict::Fail, _) | (_, Verdict::Fail) => Verdict::Fail,
            (Verdict::Pass, Verdict::Pass) => Verdict::Pass,
            _ => Verdict::Inconclusive,
        }
    }
}

/// Judges the program: its own time, and that it allocates nothing and repeats.
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
        Some(0) => passed.push("no allocator calls in the window".to_owned()),
        Some(calls) => failed.push(format!("{calls} allocator calls in the window; 0 are allowed")),
        None => open.push("allocator calls were not counted".to_owned()),
    }
    match (replayed, window.lost_notes) {
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
    } else if failed.is_empty() {
        open.push(format!(
            "a tick took {:.1} µs of CPU time, which includes time taken by a hypervisor or interrupts; repeated, the \
             worst ticks keep the deadline",
            us(longest)
        ));
    }
    if meter.ticks() < LEAST_TICKS {
        open.push(format!("{} ticks are too few; at least {LEAST_TICKS} are needed", meter.ticks()));
    }
    let (verdict, reasons) = judge(failed, open, passed);
    ComputePart { verdict, reasons, compute_ns: Quantiles::of(&meter.compute), cpu_ns: Quantiles::of(&meter.cpu) }
}

/// Judges the result on this machine: deadlines apply to responses.
fn platform_part(meter: &Meter, obtained: &Obtained, causes: BTreeMap<MissCause, u64>, explained: u64) -> PlatformPart {
    let (mut failed, mut open, mut passed) = (Vec::new(), Vec::new(), Vec::new());
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
    if !obtained.memory_locked {
        open.push("memory was not locked: any tick may incur a page fault; allow locked memory".to_owned());
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

fn judge(failed: Vec<String>, open: Vec<String>, passed: Vec<String>) -> (Verdict, Vec<String>) {
    if !failed.is_empty() {
        (Verdict::Fail, failed)
    } else if !open.is_empty() {
        (Verdict::Inconclusive, open)
    } else {
        (Verdict::Pass, passed)
    }
}

/// Finds the cause of every miss. The clock of a thread's CPU time runs on while interrupts and a hypervisor have the
/// CPU. A repeated tick does identical work, though: time beyond the longest repetition with cold caches was taken by
/// something else.
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
