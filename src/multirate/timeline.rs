//! The timeline of a run: which ticks miss their deadline, and when models arrive. A run in real time is recorded in
//! the same terms, so that it can be replayed.

use crate::word::words;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

/// Policy for a tick whose force misses its deadline.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum OverrunPolicy {
    /// The last command stays; the late force is discarded.
    #[default]
    Hold,
    /// Zero force is commanded.
    Zero,
    /// The late force is commanded when it is ready, and the ticks that fall due meanwhile are skipped.
    Skip,
}

words!(OverrunPolicy { Hold = "hold", Zero = "zero", Skip = "skip" });

/// The deadline outcome of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeadlineOutcome {
    /// The force was ready by the deadline.
    OnTime,
    /// The force missed the deadline.
    Late(OverrunPolicy),
    /// The tick fell due while an earlier one was being computed, and was skipped.
    Skipped,
}

impl DeadlineOutcome {
    /// Returns the name used in the trace.
    pub fn name(self) -> &'static str {
        match self {
            DeadlineOutcome::OnTime => "on-time",
            DeadlineOutcome::Late(_) => "late",
            DeadlineOutcome::Skipped => "skipped",
        }
    }
}

/// A model of a computing time, s.
///
/// ```
/// use stickslip::multirate::timeline::{Cost, Costs, Deadline, DrawnTimes, DeadlineOutcome, OverrunPolicy, Timeline};
///
/// // A deadline at the 99th percentile: one tick in a hundred misses it.
/// let tick = Cost::LogNormal { median: 5e-5, p99: 1e-3 };
/// let costs = Costs { tick, model: Cost::Constant(0.0), seed: 1 };
/// let deadline = Deadline { after: 1e-3, overrun: OverrunPolicy::Hold };
/// let mut drawn = Timeline::Drawn(Box::new(DrawnTimes::new(costs, deadline, 1e-3, 100, 0)));
/// let late = (0..10_000).filter(|&tick| drawn.deadline_outcome(tick) != DeadlineOutcome::OnTime).count();
/// assert!((60..140).contains(&late), "{late}"); // 100 ± 4 standard deviations
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Cost {
    /// A constant time, s.
    Constant(f64),
    /// A list of times, s, used in turn and repeated from the start.
    Table(Vec<f64>),
    /// A log-normal distribution, by its median and its 99th percentile.
    LogNormal {
        /// Median, s.
        median: f64,
        /// 99th percentile, s.
        p99: f64,
    },
    /// A usual time, and rarely another.
    Rare {
        /// Usual time, s.
        usual: f64,
        /// Rare time, s.
        rare: f64,
        /// Probability of the rare time.
        share: f64,
    },
}

/// The deadline of a tick's force, and the policy for a deadline miss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deadline {
    /// Time from the tick's release to the deadline, s.
    pub after: f64,
    /// Policy for a deadline miss.
    pub overrun: OverrunPolicy,
}

/// Computing times in virtual time.
#[derive(Debug, Clone, PartialEq)]
pub struct Costs {
    /// Computing time of a tick.
    pub tick: Cost,
    /// Computing time of a global cycle, from its boundary to its model.
    pub model: Cost,
    /// Seed of the distributions.
    pub seed: u64,
}

/// Arrival of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Arrival {
    /// Tick at the boundary from whose state the model was built.
    pub from: u64,
    /// First tick of the model.
    pub at: u64,
}

/// The timing of a recorded run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedTimes {
    /// Arrivals of models, in order.
    pub arrivals: Vec<Arrival>,
    /// Ticks that missed their deadline, ascending.
    pub late: Vec<u64>,
    /// Ticks that were skipped, ascending.
    pub skipped: Vec<u64>,
}

/// Determines the deadline outcome of every tick and the arrival of every model.
///
/// ```
/// use stickslip::multirate::timeline::{Arrival, Cost, Costs, Deadline, DrawnTimes, OverrunPolicy, RecordedTimes, Timeline};
///
/// let overrun = OverrunPolicy::Skip;
/// assert_eq!(overrun.name(), "skip");
/// // The second tick takes 2.5 ms, a model 30 ms.
/// let tick = Cost::Table(vec![1e-4, 2.5e-3, 1e-4]);
/// let costs = Costs { tick, model: Cost::Constant(0.03), seed: 0 };
/// let deadline = Deadline { after: 1e-3, overrun };
/// let mut drawn = Timeline::Drawn(Box::new(DrawnTimes::new(costs, deadline, 1e-3, 100, 0)));
/// let outcomes: Vec<&str> = (0..5).map(|tick| drawn.deadline_outcome(tick).name()).collect();
/// assert_eq!(outcomes, ["on-time", "late", "skipped", "skipped", "on-time"]);
/// assert_eq!(drawn.model_due(100), Some(130));
///
/// // The recording of these times gives the same outcomes.
/// let times = RecordedTimes { arrivals: vec![Arrival { from: 100, at: 130 }], late: vec![1], skipped: vec![2, 3] };
/// let mut recorded = Timeline::Recorded { times, overrun };
/// assert!((0..5).all(|tick| recorded.deadline_outcome(tick).name() == outcomes[tick as usize]));
/// assert_eq!((recorded.model_due(100), recorded.model_due(200)), (Some(130), None));
/// assert_eq!(Timeline::Ideal { latency: 7 }.model_due(100), Some(107));
/// ```
#[derive(Debug, Clone)]
pub enum Timeline {
    /// Computing takes no time, but models arrive some ticks after their boundary.
    Ideal {
        /// Latency of models, ticks.
        latency: u64,
    },
    /// Computing times are drawn from distributions.
    Drawn(Box<DrawnTimes>),
    /// Computing times are those of a recorded run.
    Recorded {
        /// Recorded times.
        times: RecordedTimes,
        /// Policy for a deadline miss in the recorded run.
        overrun: OverrunPolicy,
    },
}

impl Timeline {
    /// Returns the first tick of the model that is built from the state at a boundary; `None` if none is, because the
    /// global side is still computing an earlier one when the next boundary comes. Boundaries ascend.
    pub fn model_due(&mut self, boundary: u64) -> Option<u64> {
        match self {
            Timeline::Ideal { latency } => Some(boundary + *latency),
            Timeline::Drawn(drawn) => drawn.model_due(boundary),
            Timeline::Recorded { times, .. } => {
                times.arrivals.iter().find(|arrival| arrival.from == boundary).map(|arrival| arrival.at)
            }
        }
    }

    /// Returns the deadline outcome of a tick. Ticks ascend.
    pub fn deadline_outcome(&mut self, tick: u64) -> DeadlineOutcome {
        match self {
            Timeline::Ideal { .. } => DeadlineOutcome::OnTime,
            Timeline::Drawn(drawn) => drawn.deadline_outcome(tick),
            Timeline::Recorded { times, overrun } => {
                if times.skipped.binary_search(&tick).is_ok() {
                    DeadlineOutcome::Skipped
                } else if times.late.binary_search(&tick).is_ok() {
                    DeadlineOutcome::Late(*overrun)
                } else {
                    DeadlineOutcome::OnTime
                }
            }
        }
    }
}

/// Computing times drawn from a seed: equal seeds give equal times.
#[derive(Debug, Clone)]
pub struct DrawnTimes {
    costs: Costs,
    deadline: Deadline,
    /// Local tick h, s.
    tick_s: f64,
    ticks_per_cycle: u64,
    latency: u64,
    ticks: Draws,
    models: Draws,
    /// First tick that can start after the current computation, under [`OverrunPolicy::Skip`].
    next_release: u64,
    /// Time at which the global side completes its current work, in ticks.
    idle_from: f64,
}

impl DrawnTimes {
    /// Creates a timeline for ticks of `tick_s` seconds.
    pub fn new(costs: Costs, deadline: Deadline, tick_s: f64, ticks_per_cycle: u64, latency: u64) -> Self {
        let (ticks, models) = (Draws::new(costs.seed, 0), Draws::new(costs.seed, 1));
        Self { costs, deadline, tick_s, ticks_per_cycle, latency, ticks, models, next_release: 0, idle_from: 0.0 }
    }

    fn deadline_outcome(&mut self, tick: u64) -> DeadlineOutcome {
        let Deadline { after, overrun } = self.deadline;
        if tick < self.next_release {
            return DeadlineOutcome::Skipped;
        }
        let cost = self.ticks.draw(&self.costs.tick);
        if cost <= after {
            return DeadlineOutcome::OnTime;
        }
        if overrun == OverrunPolicy::Skip {
            self.next_release = tick + whole_ticks(cost / self.tick_s).max(1);
        }
        DeadlineOutcome::Late(overrun)
    }

    fn model_due(&mut self, boundary: u64) -> Option<u64> {
        // A global side that becomes idle takes the newest boundary that has passed.
        let start = self.idle_from.max(boundary as f64);
        if start >= (boundary + self.ticks_per_cycle) as f64 {
            return None;
        }
        self.idle_from = start + self.models.draw(&self.costs.model) / self.tick_s;
        Some(whole_ticks(self.idle_from) + self.latency)
    }
}

/// Rounds up to whole ticks; rounding errors of the quotient add no tick.
fn whole_ticks(ticks: f64) -> u64 {
    (ticks * (1.0 - 4.0 * f64::EPSILON)).ceil() as u64
}

/// Draws computing times one by one.
#[derive(Debug, Clone)]
struct Draws {
    random: ChaCha8Rng,
    drawn: usize,
}

impl Draws {
    fn new(seed: u64, stream: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        Self { random, drawn: 0 }
    }

    fn draw(&mut self, cost: &Cost) -> f64 {
        let drawn = self.drawn;
        self.drawn += 1;
        match cost {
            Cost::Constant(cost) => *cost,
            Cost::Table(costs) => costs[drawn % costs.len()],
            Cost::LogNormal { median, p99 } => {
                let standard = Normal::standard();
                let sigma = (p99 / median).ln() / standard.inverse_cdf(0.99);
                median * (sigma * standard.inverse_cdf(self.uniform())).exp()
            }
            Cost::Rare { usual, rare, share } => {
                if self.uniform() < *share {
                    *rare
                } else {
                    *usual
                }
            }
        }
    }

    /// Draws a number strictly between 0 and 1.
    fn uniform(&mut self) -> f64 {
        ((self.random.next_u64() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
    }
}
