//! Certificate of a measured loop: a verdict on each of its parts, and the evidence for them.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::multirate::timeline::OverrunPolicy;
use crate::realtime::exercise::Exercise;
use crate::realtime::machine::Machine;
use crate::realtime::meter::{Meter, Miss, TickTimes};
use crate::realtime::record::Quantiles;
use crate::realtime::threads::{Obtained, Served, Window};
use crate::session::ReplayReason;
use crate::verify::certificate::bounds::{Independence, RateBound, Trials, Untested, rank_test, runs_test};
use crate::verify::certificate::causes::{MissCause, Missed, StealSample, steal_grew};
use crate::verify::certificate::identity::Identity;
use crate::verify::certificate::parts::{
    ComputePart, Coverage, GlobalPart, PlatformPart, Replayed, Verdict, compute_part, global_part, platform_part,
};
use crate::verify::certificate::tail::Tail;
use crate::verify::lateness::Consequences;

/// Number of lags of the rank test: dependence over more than ten blocks also shows at shorter lags.
const LAGS: usize = 10;
/// Margin around a miss, in which growth of the stolen time counts for it, ns: it covers the interval of the kernel's
/// accounting and that between two samples of it.
const STEAL_MARGIN_NS: u64 = 50_000_000;

/// One of the longest ticks, as recorded and repeated.
#[derive(Debug, Clone, Serialize)]
pub struct WorstTick {
    /// Run of the path to which the tick belongs.
    pub pass: u32,
    /// Number of the tick in its pass, counted from 0.
    pub tick: u64,
    /// Reasons why the tick was repeated.
    pub why: Vec<ReplayReason>,
    /// Recorded times; absent for a tick that was chosen for its kind.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub times: Option<TickTimes>,
    /// Times when repeated with warm caches: median and longest, ns.
    pub warm_ns: [u64; 2],
    /// Times when repeated with cold caches: median and longest, ns.
    pub cold_ns: [u64; 2],
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
    /// Whether no test rejected independence; absent if none could be done.
    pub independent: Option<bool>,
    /// Tests of independence.
    pub independence: IndependenceTests,
    /// Reasons why a test could not be made.
    pub untested: Vec<String>,
}

/// Tests of the assumptions of the bounds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct IndependenceTests {
    /// Whether missed ticks cluster, by their runs; skipped ticks count as missed.
    pub ticks: Option<Independence>,
    /// Whether blocks with a miss cluster, by their runs.
    pub blocks: Option<Independence>,
    /// Whether the blocks' longest responses depend on earlier ones, by their ranks.
    pub responses: Option<Independence>,
}

impl MissRate {
    pub(super) fn of(meter: &Meter, maxima_ns: &[u64], block_ticks: u64) -> Self {
        let (missed, all) = (meter.missed() + meter.skipped(), meter.ticks() + meter.skipped());
        let has_miss: Vec<bool> = meter.blocks().iter().map(|block| block.misses > 0).collect();
        let missed_blocks = has_miss.iter().filter(|&&has_miss| has_miss).count() as u64;
        let all_blocks = has_miss.len() as u64;
        let runs = has_miss.chunk_by(|a, b| a == b).count() as u64;
        let maxima: Vec<f64> = maxima_ns.iter().map(|&ns| ns as f64).collect();
        let mut untested = Vec::new();
        let mut tested = |what: &str, test: Result<Independence, Untested>| {
            test.map_err(|reason| untested.push(format!("{what}: {reason}"))).ok()
        };
        let independence = IndependenceTests {
            ticks: tested("missed ticks", runs_test(missed, all - missed, meter.runs())),
            blocks: tested("blocks with a miss", runs_test(missed_blocks, all_blocks - missed_blocks, runs)),
            responses: tested("longest responses of blocks", rank_test(&maxima, LAGS)),
        };
        let IndependenceTests { ticks, blocks, responses } = independence;
        let outcomes = [ticks, blocks, responses].into_iter().flatten();
        Self {
            ticks: RateBound::of(missed, all, Trials::Ticks),
            blocks: RateBound::of(missed_blocks, all_blocks, Trials::Blocks),
            block_ticks,
            independent: outcomes.map(|test| test.independent).reduce(|a, b| a && b),
            independence,
            untested,
        }
    }
}

/// Certificate of a loop's deadlines, the content of `certificate.json`.
///
/// This certificate covers ten ticks, one of which was woken too late:
///
/// ```
/// use stickslip::verify::certificate::{parts::Verdict, verdict::{Certificate, Circumstances}};
/// use stickslip::realtime::meter::{Meter, TickTimes};
/// use stickslip::realtime::threads::{Obtained, Served, Window};
/// # use stickslip::realtime::{exercise::Exercise, machine::Machine};
/// # use stickslip::realtime::record::Quantiles;
/// # use stickslip::verify::certificate::identity::Identity;
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
/// #     cpus: vec![0], memory_locked: true, cpu: Default::default(), refused: vec![] };
/// # let (global, exercise) = (None, Exercise::default());
/// # let idle = Quantiles::of(&meter.compute);
/// let served = Served { passes, meter, global, exercise, window, obtained, stopped, fault };
/// # let overrun = OverrunPolicy::Hold;
/// # let on_time = Consequence {
/// #     overrun, share: 0.0, missed_ticks: [0; 2], force_error_rms_rel: Some(0.0), largest_jump_n: 0.0,
/// #     contact_losses: 0, energy_given_j: 0.0, fault: None,
/// # };
/// # let consequences = Consequences { late_tick_ticks: 1.5, on_time, late: vec![] };
/// # let circumstances = Circumstances {
/// #     identity: Identity::default(), scene: "example".into(), rate_hz: 1e3, overrun, load: "none".into(),
/// #     steal: vec![], machine: Machine::describe(0), replayed: true, worst: vec![], consequences, idle,
/// #     asked_ticks: 10, path_ticks: 10, longest_pass_ticks: 10, lockstep: Exercise::default(),
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
    /// Time, program, scene and machine of the measurement.
    pub identity: Identity,
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
    /// What the window exercised: the verdicts hold for nothing else.
    pub coverage: Coverage,
    /// Verdict on the program itself.
    pub compute: ComputePart,
    /// Verdict on the program on this machine.
    pub platform: PlatformPart,
    /// Verdict on the global side; absent without cycles.
    pub global: Option<GlobalPart>,
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
    /// Time, program, scene and machine of the measurement.
    pub identity: Identity,
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
    /// Wall time of the first pass's ticks, repeated after the load has ended, ns.
    pub idle: Quantiles,
    /// Number of ticks that were asked for.
    pub asked_ticks: u64,
    /// Number of ticks of the scene's path.
    pub path_ticks: u64,
    /// Number of ticks of the longest pass.
    pub longest_pass_ticks: u64,
    /// Counts of the scene's path in lockstep.
    pub lockstep: Exercise,
}

impl Certificate {
    /// Judges a measured loop.
    pub fn new(served: &Served, around: Circumstances) -> Self {
        let Served { meter, global, exercise, window, obtained, stopped, fault, .. } = served;
        let coverage = Coverage {
            path_share: (around.longest_pass_ticks as f64 / around.path_ticks as f64).min(1.0),
            asked_ticks: around.asked_ticks,
            window: *exercise,
            lockstep: around.lockstep,
        };
        let done = meter.ticks() + meter.skipped();
        let is_cut_short = *stopped || (fault.is_none() && done < around.asked_ticks);
        let cut_short = is_cut_short.then(|| {
            format!("the window was stopped after {done} of {} ticks: let it run to its end", around.asked_ticks)
        });
        let fault = fault.map(|fault| fault.to_string());
        let stolen =
            around.steal.first().zip(around.steal.last()).map(|(first, last)| last.stolen_ticks - first.stolen_ticks);
        let misses = explain(meter, window, &around.steal, &around.worst);
        let mut causes = BTreeMap::new();
        misses.iter().for_each(|miss| *causes.entry(miss.cause).or_insert(0) += 1);
        let (maxima_ns, block_ticks) = block_maxima(meter);
        Self {
            version: env!("CARGO_PKG_VERSION"),
            identity: around.identity,
            scene: around.scene,
            ticks: meter.ticks(),
            duration_s: window.end_ns.saturating_sub(window.begin_ns) as f64 * 1e-9,
            rate_hz: around.rate_hz,
            deadline_us: meter.deadline_ns() as f64 * 1e-3,
            overrun: around.overrun,
            load: around.load,
            stopped: *stopped,
            window: *window,
            coverage,
            compute: {
                let open = coverage.gaps(around.path_ticks as f64 / around.rate_hz);
                let open = cut_short.iter().cloned().chain(open).collect();
                let replayed = Replayed { same: around.replayed, worst: &around.worst, idle: around.idle };
                compute_part(meter, window, replayed, fault.as_deref(), open)
            },
            platform: platform_part(
                meter,
                window,
                obtained,
                causes,
                misses.len() as u64,
                cut_short.into_iter().collect(),
            ),
            global: global.as_ref().map(|global| global_part(global, window)),
            miss_rate: MissRate::of(meter, &maxima_ns, block_ticks),
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

    /// Returns the verdict on the whole: the worst of its parts.
    pub fn verdict(&self) -> Verdict {
        let parts = [Some(self.compute.verdict), Some(self.platform.verdict), self.global.as_ref().map(|g| g.verdict)];
        let has = |verdict| parts.contains(&Some(verdict));
        if has(Verdict::Fail) {
            Verdict::Fail
        } else if has(Verdict::Inconclusive) {
            Verdict::Inconclusive
        } else {
            Verdict::Pass
        }
    }
}

/// Returns the longest response of each whole block, ns, and the number of ticks in a block.
pub(super) fn block_maxima(meter: &Meter) -> (Vec<u64>, u64) {
    let block_ticks = meter.blocks().first().map_or(0, |block| block.ticks);
    let whole = meter.blocks().iter().filter(|block| block.ticks == block_ticks);
    (whole.map(|block| block.response_max_ns).collect(), block_ticks)
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
