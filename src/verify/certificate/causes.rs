//! Causes of missed deadlines, as far as the thread's clocks and counters show them.

use serde::{Deserialize, Serialize};

/// Cause of a missed deadline.
///
/// ```
/// use stickslip::verify::certificate::causes::{MissCause, Missed};
///
/// // A deadline of 500 µs, usually kept with 50 µs of computing.
/// let usual = Missed {
///     deadline_ns: 500_000,
///     compute_ns: 50_000,
///     cpu_ns: 50_000,
///     typical_compute_ns: 50_000,
///     typical_cpu_ns: 50_000,
///     ..Missed::default()
/// };
/// let woken_late = Missed { release_ns: 800_000, response_ns: 850_000, ..usual };
/// let slow = Missed { compute_ns: 900_000, cpu_ns: 900_000, response_ns: 900_000, ..usual };
/// let interrupted =
///     Missed { compute_ns: 900_000, response_ns: 900_000, involuntary_switches: 1, ..usual };
/// let causes = [woken_late, slow, interrupted].map(|miss| MissCause::of(&miss));
/// assert_eq!(causes, [MissCause::Release, MissCause::Compute, MissCause::Preempted]);
/// assert_eq!(MissCause::of(&Missed { steal: true, ..woken_late }), MissCause::StealSuspected);
/// // The tick after a slow one begins late because of that one.
/// let next = Missed { follows: true, ..woken_late };
/// assert_eq!(MissCause::of_all(&[slow, next]), [MissCause::Compute; 2]);
/// assert_eq!(MissCause::Preempted.name(), "preempted");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MissCause {
    /// The tick's own computation was too long.
    Compute,
    /// The thread was woken too late.
    Release,
    /// Something else occupied the CPU.
    Preempted,
    /// A page fault occurred.
    Fault,
    /// The hypervisor took time meanwhile, which is indistinguishable from the other causes.
    StealSuspected,
    /// No measurement explains the miss.
    Unknown,
}

/// Measurements of a missed deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Missed {
    /// Deadline from the scheduled release, ns.
    pub deadline_ns: u64,
    /// Time from the scheduled release to the tick's begin, ns.
    pub release_ns: u64,
    /// Time from the scheduled release to the command, ns.
    pub response_ns: u64,
    /// Wall time from begin to command, ns.
    pub compute_ns: u64,
    /// CPU time from begin to command, ns.
    pub cpu_ns: u64,
    /// Page faults of the thread since the previous miss.
    pub page_faults: u64,
    /// Involuntary context switches of the thread since the previous miss.
    pub involuntary_switches: u64,
    /// Whether the previous tick missed its deadline too.
    pub follows: bool,
    /// Whether the hypervisor took time meanwhile ([`steal_grew`]).
    pub steal: bool,
    /// Median of `compute_ns` over all ticks, ns.
    pub typical_compute_ns: u64,
    /// Median of `cpu_ns` over all ticks, ns.
    pub typical_cpu_ns: u64,
}

impl MissCause {
    /// Returns the name as it is printed.
    pub fn name(self) -> &'static str {
        match self {
            MissCause::Compute => "computation too long",
            MissCause::Release => "late release",
            MissCause::Preempted => "preempted",
            MissCause::Fault => "page fault",
            MissCause::StealSuspected => "hypervisor suspected",
            MissCause::Unknown => "unknown",
        }
    }

    /// Returns the causes of a run's misses, in chronological order. A miss that follows another has the other's cause:
    /// it began late because that one ended late.
    pub fn of_all(misses: &[Missed]) -> Vec<Self> {
        let mut causes: Vec<Self> = Vec::with_capacity(misses.len());
        for miss in misses {
            let inherited = if miss.follows { causes.last().copied() } else { None };
            causes.push(inherited.unwrap_or_else(|| Self::of(miss)));
        }
        causes
    }

    /// Returns the cause of a single miss. CPU time beyond the deadline is enough to miss it. Otherwise the cause is
    /// the largest of release latency, time off the CPU and CPU time beyond the usual (the first of these if equal),
    /// if that is at least half of the excess over the deadline. A tick that missed nothing is `Unknown`.
    pub fn of(miss: &Missed) -> Self {
        let excess_ns = miss.response_ns.saturating_sub(miss.deadline_ns);
        if excess_ns == 0 {
            return MissCause::Unknown;
        }
        if miss.cpu_ns > miss.deadline_ns && !miss.steal {
            return MissCause::Compute;
        }
        // The two clocks are not read at the same instant: their usual difference is not time off the CPU.
        let usually_off_ns = miss.typical_compute_ns.saturating_sub(miss.typical_cpu_ns);
        let off_ns = miss.compute_ns.saturating_sub(miss.cpu_ns).saturating_sub(usually_off_ns);
        let busy_ns = miss.cpu_ns.saturating_sub(miss.typical_cpu_ns);
        let largest_ns = miss.release_ns.max(off_ns).max(busy_ns);
        if largest_ns < excess_ns.div_ceil(2) {
            return MissCause::Unknown;
        }
        if largest_ns == miss.release_ns {
            miss.unless_stolen(MissCause::Release)
        } else if largest_ns == off_ns {
            miss.off_the_cpu()
        } else {
            miss.unless_stolen(MissCause::Compute)
        }
    }
}

impl Missed {
    fn unless_stolen(&self, cause: MissCause) -> MissCause {
        if self.steal { MissCause::StealSuspected } else { cause }
    }

    /// Returns the cause of time off the CPU: `Preempted` only for a thread that was taken off it.
    fn off_the_cpu(&self) -> MissCause {
        if self.page_faults > 0 {
            MissCause::Fault
        } else if self.involuntary_switches > 0 {
            self.unless_stolen(MissCause::Preempted)
        } else {
            self.unless_stolen(MissCause::Unknown)
        }
    }
}

/// Time that the hypervisor had taken up to an instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StealSample {
    /// Instant, ns.
    pub at_ns: u64,
    /// Stolen time so far, in clock ticks, as counted by `/proc/stat`.
    pub stolen_ticks: u64,
}

/// Returns whether the count grew around `[from_ns, to_ns]`: between the last sample not after its begin and the first
/// not before its end, or the outermost samples. Samples are in chronological order; without two around the interval,
/// no growth was seen.
///
/// ```
/// use stickslip::verify::certificate::causes::{StealSample, steal_grew};
///
/// let at = |at_ns, stolen_ticks| StealSample { at_ns, stolen_ticks };
/// let samples = [at(0, 7), at(100, 7), at(200, 8), at(300, 8)];
/// assert!(steal_grew(&samples, 120, 130)); // somewhere between 100 and 200
/// assert!(!steal_grew(&samples, 20, 80) && !steal_grew(&samples, 220, 280));
/// assert!(!steal_grew(&[], 120, 130));
/// ```
pub fn steal_grew(samples: &[StealSample], from_ns: u64, to_ns: u64) -> bool {
    let before = samples.partition_point(|sample| sample.at_ns <= from_ns).saturating_sub(1);
    let after = samples.partition_point(|sample| sample.at_ns < to_ns).min(samples.len().saturating_sub(1));
    match (samples.get(before), samples.get(after)) {
        (Some(first), Some(last)) => last.stolen_ticks > first.stolen_ticks,
        _ => false,
    }
}
