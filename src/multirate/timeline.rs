//! When things happen in virtual time: which ticks miss their deadline, and when models arrive. What a run
//! in real time went through is recorded in the same words, so that it can be run again.

use crate::word::words;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

/// What becomes of a tick whose force is not there by its deadline.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum OverrunPolicy {
    /// The instrument keeps the force it was commanded last; the late one is thrown away.
    #[default]
    Hold,
    /// It is commanded zero.
    Zero,
    /// The late force goes out when it is there, and the ticks that fall due meanwhile are left out.
    Skip,
}

words!(OverrunPolicy { Hold = "hold", Zero = "zero", Skip = "skip" });

/// Whether a tick met its deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeadlineOutcome {
    /// Its force was there.
    OnTime,
    /// It was not.
    Late(OverrunPolicy),
    /// The tick fell due while an earlier one was being computed, and was left out.
    Skipped,
}

impl DeadlineOutcome {
    /// As the trace writes it.
    pub fn name(self) -> &'static str {
        match self {
            DeadlineOutcome::OnTime => "on-time",
            DeadlineOutcome::Late(_) => "late",
            DeadlineOutcome::Skipped => "skipped",
        }
    }
}

/// How long something takes to compute, s.
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
    /// Always the same.
    Constant(f64),
    /// One after the other, and again from the start.
    Table(Vec<f64>),
    /// Log-normal, by its median and its 99th percentile.
    LogNormal {
        /// s.
        median: f64,
        /// s.
        p99: f64,
    },
    /// Mostly one, rarely the other.
    Rare {
        /// s.
        usual: f64,
        /// s.
        rare: f64,
        /// Share of the rare ones.
        share: f64,
    },
}

/// By when a tick's force has to be there, and what happens if it is not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deadline {
    /// From the tick's release, s.
    pub after: f64,
    /// What a missed one does.
    pub overrun: OverrunPolicy,
}

/// What computing takes in virtual time.
#[derive(Debug, Clone, PartialEq)]
pub struct Costs {
    /// Of a tick.
    pub tick: Cost,
    /// Of a cycle of the global side, from its boundary to its model.
    pub model: Cost,
    /// Of the distributions.
    pub seed: u64,
}

/// A model that came into use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Arrival {
    /// The boundary from whose state it was built: the tick that begins there.
    pub from: u64,
    /// Its first tick.
    pub at: u64,
}

/// What a run in real time went through.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedTimes {
    /// Models, in the order in which they came.
    pub arrivals: Vec<Arrival>,
    /// Ticks that missed their deadline, ascending.
    pub late: Vec<u64>,
    /// Ticks that were left out, ascending.
    pub skipped: Vec<u64>,
}

/// Decides the deadline_outcome of every tick and the arrival of every model.
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
/// // The same once more, from what was written down of it.
/// let times = RecordedTimes { arrivals: vec![Arrival { from: 100, at: 130 }], late: vec![1], skipped: vec![2, 3] };
/// let mut recorded = Timeline::Recorded { times, overrun };
/// assert!((0..5).all(|tick| recorded.deadline_outcome(tick).name() == outcomes[tick as usize]));
/// assert_eq!((recorded.model_due(100), recorded.model_due(200)), (Some(130), None));
/// assert_eq!(Timeline::Ideal { latency: 7 }.model_due(100), Some(107));
/// ```
#[derive(Debug, Clone)]
pub enum Timeline {
    /// Nothing takes time, but models arrive some ticks after their boundary.
    Ideal {
        /// Ticks.
        latency: u64,
    },
    /// Costs are drawn.
    Drawn(Box<DrawnTimes>),
    /// As it was.
    Recorded {
        /// What happened.
        times: RecordedTimes,
        /// What lateness did.
        overrun: OverrunPolicy,
    },
}

impl Timeline {
    /// The first tick of the model that is built from the state at a boundary; `None` if none is, because the
    /// global side is still at work on an earlier one when the next boundary comes. Boundaries ascend.
    pub fn model_due(&mut self, boundary: u64) -> Option<u64> {
        match self {
            Timeline::Ideal { latency } => Some(boundary + *latency),
            Timeline::Drawn(drawn) => drawn.model_due(boundary),
            Timeline::Recorded { times, .. } => {
                times.arrivals.iter().find(|arrival| arrival.from == boundary).map(|arrival| arrival.at)
            }
        }
    }

    /// The deadline_outcome of a tick. Ticks ascend.
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

/// Costs drawn from a seed: the same seed, the same times.
#[derive(Debug, Clone)]
pub struct DrawnTimes {
    costs: Costs,
    deadline: Deadline,
    /// h, s.
    tick_s: f64,
    ticks_per_cycle: u64,
    latency: u64,
    ticks: Draws,
    models: Draws,
    /// The first tick after what is being computed, under [`OverrunPolicy::Skip`].
    next_release: u64,
    /// When the global side is done with what it is at, in ticks.
    idle_from: f64,
}

impl DrawnTimes {
    /// For ticks of `tick_s` seconds.
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
        // Whoever is done takes the newest boundary that has passed.
        let start = self.idle_from.max(boundary as f64);
        if start >= (boundary + self.ticks_per_cycle) as f64 {
            return None;
        }
        self.idle_from = start + self.models.draw(&self.costs.model) / self.tick_s;
        Some(whole_ticks(self.idle_from) + self.latency)
    }
}

/// Rounded up, where a rounding of the quotient is no tick more.
fn whole_ticks(ticks: f64) -> u64 {
    (ticks * (1.0 - 4.0 * f64::EPSILON)).ceil() as u64
}

/// Draws costs one by one.
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

    /// Between 0 and 1, both excluded.
    fn uniform(&mut self) -> f64 {
        ((self.random.next_u64() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
    }
}
