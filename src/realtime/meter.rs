//! Time measurements of a servo loop's ticks, recorded in memory that is allocated before the loop begins.

use hdrhistogram::Histogram;
use serde::Serialize;

use super::os::Usage;

/// Longest time that a histogram resolves, ns. Maxima are recorded separately.
const LONGEST_NS: u64 = 10_000_000_000;
/// Significant digits of a histogram.
const DIGITS: u8 = 3;
/// Number of blocks that a run is divided into, for its course over time and for tests of independence.
const BLOCKS: u64 = 2000;
/// Least number of ticks of a block: the maximum of fewer is no extreme value.
const LEAST_BLOCK: u64 = 50;
/// Largest number of misses recorded one by one; all are counted.
const MISSES_KEPT: usize = 4096;
/// Number of worst ticks recorded, by response and by CPU time each.
const WORST_KEPT: usize = 8;

/// Measured times of a tick.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct TickTimes {
    /// Number of the tick's pass.
    pub pass: u32,
    /// Number of the tick in its pass, from 0.
    pub tick: u64,
    /// Time from the scheduled release to the tick's begin, ns.
    pub release_ns: u64,
    /// Time from the scheduled release to the command, ns, which a deadline bounds.
    pub response_ns: u64,
    /// Time from begin to command, ns.
    pub compute_ns: u64,
    /// CPU time of the thread from begin to command, ns, including the reading of that clock.
    pub cpu_ns: u64,
}

/// A deadline miss, with the thread's counters.
#[derive(Debug, Clone, Copy)]
pub struct Miss {
    /// Times of the tick.
    pub times: TickTimes,
    /// Time of the release after the window began, ns.
    pub at_ns: u64,
    /// Whether the tick before missed its deadline too.
    pub follows: bool,
    /// Counters since the miss before, or since the window began.
    pub usage: Usage,
}

/// A segment of the run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Block {
    /// Number of ticks in the block.
    pub ticks: u64,
    /// Number of misses in the block.
    pub misses: u64,
    /// Longest response, ns.
    pub response_max_ns: u64,
    /// Sum of the responses, ns.
    pub response_sum_ns: u64,
    /// Longest response of the control loop without a payload, ns.
    pub control_max_ns: u64,
}

/// A distribution of times, with its exact maximum.
///
/// ```
/// use stickslip::realtime::meter::{Meter, TickTimes};
///
/// let mut meter = Meter::new(1000, 1_000_000);
/// for tick in 1..=1000 {
///     meter.tick(TickTimes { tick, compute_ns: tick * 1000, ..TickTimes::default() }, 0);
/// }
/// let compute = &meter.compute; // 1 µs, 2 µs, … 1 ms
/// assert_eq!((compute.count(), compute.max_ns()), (1000, 1_000_000));
/// assert!((compute.quantile_ns(0.99) as f64 / 990_000.0 - 1.0).abs() < 1e-3); // three digits
/// let (_, share) = compute.tail()[0];
/// assert_eq!(share, 1.0); // all take as long as the shortest, or longer
/// ```
#[derive(Debug, Clone)]
pub struct Times {
    histogram: Histogram<u64>,
    max_ns: u64,
}

impl Times {
    /// Prepares an empty distribution.
    #[allow(clippy::new_without_default, reason = "it allocates")]
    pub fn new() -> Self {
        let histogram = Histogram::new_with_max(LONGEST_NS, DIGITS);
        Self { histogram: histogram.expect("the bounds are constants that it accepts"), max_ns: 0 }
    }

    /// Records a time, ns.
    pub fn record(&mut self, ns: u64) {
        self.histogram.saturating_record(ns);
        self.max_ns = self.max_ns.max(ns);
    }

    /// Returns the number of times recorded.
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// Returns the time that at least this share does not exceed, ns, to three digits; the maximum is exact.
    pub fn quantile_ns(&self, share: f64) -> u64 {
        self.histogram.value_at_quantile(share).min(self.max_ns)
    }

    /// Returns the longest time, ns.
    pub fn max_ns(&self) -> u64 {
        self.max_ns
    }

    /// Returns pairs of a time, ns, and the share of times that are at least as long, for plots.
    pub fn tail(&self) -> Vec<(f64, f64)> {
        let total = self.histogram.len() as f64;
        let mut above = self.histogram.len();
        let mut tail = Vec::new();
        for step in self.histogram.iter_recorded() {
            tail.push((step.value_iterated_to() as f64, above as f64 / total));
            above -= step.count_at_value();
        }
        tail
    }
}

/// The time measurements of a run.
///
/// ```
/// use stickslip::realtime::{meter::{Meter, TickTimes}, os::Usage};
///
/// let mut meter = Meter::new(1000, 300_000); // a deadline of 300 µs
/// meter.begin(Usage::of_this_thread());
/// for tick in 0..997 {
///     let times = TickTimes { tick, response_ns: 100_000 + tick, ..TickTimes::default() };
///     assert!(meter.tick(times, tick * 1_000_000));
///     meter.control(Some((2_000, 3_000)));
/// }
/// // A tick that takes 2.2 ms, so that two are skipped.
/// let late = TickTimes { tick: 997, response_ns: 2_200_000, cpu_ns: 2_100_000, ..TickTimes::default() };
/// assert!(!meter.tick(late, 997_000_000));
/// meter.skip(998_000_000);
/// meter.skip(999_000_000);
/// meter.control(None); // its release had passed as well
/// assert_eq!((meter.ticks(), meter.missed(), meter.skipped(), meter.longest_run()), (998, 1, 2, 3));
/// assert_eq!(meter.control_missed(), (0, 1));
/// assert_eq!((meter.misses()[0].times, meter.misses()[0].follows), (late, false));
/// assert_eq!((meter.worst_by_response()[0], meter.worst_by_cpu()[0]), (late, late));
/// assert_eq!(meter.response.max_ns(), meter.worst_by_response()[0].response_ns);
/// assert_eq!(meter.blocks().iter().map(|block| block.misses).sum::<u64>(), 1);
/// assert_eq!((meter.deadline_ns(), meter.runs()), (300_000, 2));
/// // The next command is the response to the skipped ticks, too: after 2.1, 1.1 and 0.1 ms.
/// meter.tick(TickTimes { tick: 1000, response_ns: 100_000, ..TickTimes::default() }, 1_000_000_000);
/// assert_eq!((meter.response.count(), meter.response.max_ns(), meter.runs()), (1001, 2_200_000, 3));
/// assert_eq!(meter.response.quantile_ns(999.0 / 1001.0) / 1000, 1100);
/// ```
#[derive(Debug, Clone)]
pub struct Meter {
    /// Times from a scheduled release to the tick's begin.
    pub release: Times,
    /// Times from a scheduled release to the command; for a skipped tick, to the next tick's command.
    pub response: Times,
    /// Times from begin to command.
    pub compute: Times,
    /// CPU times from begin to command.
    pub cpu: Times,
    /// Times from release to begin of the control loop without a payload, released half a tick later.
    pub control_release: Times,
    /// Times from release to end of the control loop without a payload.
    pub control_response: Times,
    deadline_ns: u64,
    /// Number of ticks that missed their deadline, then of ticks that were skipped.
    missed: u64,
    skipped: u64,
    control_missed: u64,
    /// Number of releases of the control loop that had passed before the tick was complete.
    control_left_out: u64,
    run: u64,
    longest_run: u64,
    /// Number of runs of consecutive ticks that were all in time, or all missed or skipped.
    runs: u64,
    /// Skipped ticks without a response so far: their number, and the release of the first of them after the window began,
    /// ns.
    unanswered: (u64, u64),
    misses: Vec<Miss>,
    blocks: Vec<Block>,
    block_ticks: u64,
    ticks: u64,
    worst_response: Vec<TickTimes>,
    worst_cpu: Vec<TickTimes>,
    last_usage: Usage,
}

impl Meter {
    /// Prepares measurements for a number of ticks with this deadline, ns.
    pub fn new(ticks: u64, deadline_ns: u64) -> Self {
        let times = Times::new();
        let block_ticks = ticks.div_ceil(BLOCKS).max(LEAST_BLOCK);
        let blocks = ticks.div_ceil(block_ticks) as usize + 1;
        Self {
            release: times.clone(),
            response: times.clone(),
            compute: times.clone(),
            cpu: times.clone(),
            control_release: times.clone(),
            control_response: times,
            deadline_ns,
            missed: 0,
            skipped: 0,
            control_missed: 0,
            control_left_out: 0,
            run: 0,
            longest_run: 0,
            runs: 0,
            unanswered: (0, 0),
            misses: Vec::with_capacity(MISSES_KEPT),
            blocks: vec![Block::default(); blocks],
            block_ticks,
            ticks: 0,
            worst_response: Vec::with_capacity(WORST_KEPT + 1),
            worst_cpu: Vec::with_capacity(WORST_KEPT + 1),
            last_usage: Usage::default(),
        }
    }

    /// Begins the window.
    pub fn begin(&mut self, usage: Usage) {
        self.last_usage = usage;
    }

    /// Records a tick, released `at_ns` after the window began. Returns whether it met its deadline.
    pub fn tick(&mut self, times: TickTimes, at_ns: u64) -> bool {
        self.answer(at_ns, times.response_ns);
        self.release.record(times.release_ns);
        self.response.record(times.response_ns);
        self.compute.record(times.compute_ns);
        self.cpu.record(times.cpu_ns);
        keep_worst(&mut self.worst_response, times, |times| times.response_ns);
        keep_worst(&mut self.worst_cpu, times, |times| times.cpu_ns);
        let on_time = times.response_ns <= self.deadline_ns;
        let block = &mut self.blocks[(self.ticks / self.block_ticks) as usize];
        block.ticks += 1;
        block.misses += u64::from(!on_time);
        block.response_max_ns = block.response_max_ns.max(times.response_ns);
        block.response_sum_ns += times.response_ns;
        self.runs += u64::from(on_time == (self.run > 0) || self.runs == 0);
        self.ticks += 1;
        if on_time {
            self.run = 0;
            return true;
        }
        self.missed += 1;
        let follows = self.run > 0;
        self.extend_run();
        // Only a miss costs the reading of the counters.
        let usage = Usage::of_this_thread();
        if self.misses.len() < self.misses.capacity() {
            self.misses.push(Miss { times, at_ns, follows, usage: usage.since(self.last_usage) });
        }
        self.last_usage = usage;
        false
    }

    /// Records a skipped tick, released `at_ns` after the window began. Its response is the next command, so that the
    /// distribution of responses has all ticks and not only those that were computed.
    pub fn skip(&mut self, at_ns: u64) {
        self.skipped += 1;
        self.runs += u64::from(self.run == 0);
        self.extend_run();
        let (ticks, first_ns) = self.unanswered;
        self.unanswered = (ticks + 1, if ticks == 0 { at_ns } else { first_ns });
    }

    /// Ends the window `at_ns` after it began. Skipped ticks without a response have waited at least until then.
    pub fn end(&mut self, at_ns: u64) {
        self.answer(at_ns, 0);
    }

    /// Records the responses of skipped ticks at the command of a tick that was released at `at_ns`.
    fn answer(&mut self, at_ns: u64, response_ns: u64) {
        let (ticks, first_ns) = std::mem::take(&mut self.unanswered);
        for skipped in 0..ticks {
            let waited = at_ns.saturating_sub(first_ns) * (ticks - skipped) / ticks;
            self.response.record(waited + response_ns);
        }
    }

    fn extend_run(&mut self) {
        self.run += 1;
        self.longest_run = self.longest_run.max(self.run);
    }

    /// Records the control loop's release and response times, ns, or a release that had passed (`None`).
    pub fn control(&mut self, times: Option<(u64, u64)>) {
        let Some((release_ns, response_ns)) = times else {
            self.control_left_out += 1;
            return;
        };
        self.control_release.record(release_ns);
        self.control_response.record(response_ns);
        self.control_missed += u64::from(response_ns > self.deadline_ns);
        let last = self.ticks.saturating_sub(1) / self.block_ticks;
        let block = &mut self.blocks[last as usize];
        block.control_max_ns = block.control_max_ns.max(response_ns);
    }

    /// Returns the number of ticks completed.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Returns the deadline, ns.
    pub fn deadline_ns(&self) -> u64 {
        self.deadline_ns
    }

    /// Returns the number of completed ticks that missed their deadline.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Returns the number of skipped ticks.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Returns the control loop's numbers of missed deadlines and of omitted releases.
    pub fn control_missed(&self) -> (u64, u64) {
        (self.control_missed, self.control_left_out)
    }

    /// Returns the largest number of consecutive ticks that were missed or skipped.
    pub fn longest_run(&self) -> u64 {
        self.longest_run
    }

    /// Returns the number of runs of consecutive ticks that were all in time, or all missed or skipped.
    pub fn runs(&self) -> u64 {
        self.runs
    }

    /// Returns the first 4096 misses.
    pub fn misses(&self) -> &[Miss] {
        &self.misses
    }

    /// Returns the blocks of the run.
    pub fn blocks(&self) -> &[Block] {
        let used = self.blocks.iter().take_while(|block| block.ticks > 0).count();
        &self.blocks[..used]
    }

    /// Returns the worst ticks, longest response first.
    pub fn worst_by_response(&self) -> &[TickTimes] {
        &self.worst_response
    }

    /// Returns the worst ticks, most CPU time first.
    pub fn worst_by_cpu(&self) -> &[TickTimes] {
        &self.worst_cpu
    }
}

/// Inserts a tick in descending order; the list never grows beyond its capacity.
fn keep_worst(worst: &mut Vec<TickTimes>, times: TickTimes, by: impl Fn(&TickTimes) -> u64) {
    if worst.len() < WORST_KEPT || worst.last().is_some_and(|least| by(least) < by(&times)) {
        let at = worst.partition_point(|other| by(other) >= by(&times));
        worst.insert(at, times);
        worst.truncate(WORST_KEPT);
    }
}
