//! What a missed deadline was due to, as far as the thread's clocks and counters tell.

use serde::{Deserialize, Serialize};

/// What a missed deadline was due to.
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
/// assert_eq!(MissCause::Preempted.name(), "something else had the CPU");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MissCause {
    /// The tick itself computed too long.
    Compute,
    /// It was woken too late.
    Release,
    /// Something else had the CPU.
    Preempted,
    /// Memory was not there.
    Fault,
    /// What would be one of the others, but the hypervisor took time meanwhile, which looks the same.
    StealSuspected,
    /// Nothing measured explains it.
    Unknown,
}

/// A missed deadline in numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Missed {
    /// From the scheduled release, ns.
    pub deadline_ns: u64,
    /// From the scheduled release to the tick's begin, ns.
    pub release_ns: u64,
    /// From the scheduled release to the command, ns.
    pub response_ns: u64,
    /// From begin to command by the wall clock, ns.
    pub compute_ns: u64,
    /// CPU time of the same, ns.
    pub cpu_ns: u64,
    /// Of the thread since the miss before.
    pub page_faults: u64,
    /// Times the thread was taken off the CPU since the miss before.
    pub involuntary_switches: u64,
    /// The tick before missed its deadline too.
    pub follows: bool,
    /// The hypervisor took time meanwhile ([`steal_grew`]).
    pub steal: bool,
    /// Median of `compute_ns` over all ticks.
    pub typical_compute_ns: u64,
    /// Median of `cpu_ns` over all ticks.
    pub typical_cpu_ns: u64,
}

impl MissCause {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            MissCause::Compute => "the tick computed too long",
            MissCause::Release => "released too late",
            MissCause::Preempted => "something else had the CPU",
            MissCause::Fault => "a page fault",
            MissCause::StealSuspected => "the hypervisor, it seems",
            MissCause::Unknown => "unknown",
        }
    }

    /// Of each of a run's misses, in the order of time. One that follows another has the other's cause: it began late
    /// because that one ended late.
    pub fn of_all(misses: &[Missed]) -> Vec<Self> {
        let mut causes: Vec<Self> = Vec::with_capacity(misses.len());
        for miss in misses {
            let inherited = if miss.follows { causes.last().copied() } else { None };
            causes.push(inherited.unwrap_or_else(|| Self::of(miss)));
        }
        causes
    }

    /// Of a miss by itself. CPU time beyond the deadline is enough to miss it. Otherwise the excess over the deadline
    /// is put down to the largest of release latency, time off the CPU and CPU time beyond the usual (the first of
    /// these if equal), if that is at least half of the excess. A tick that missed nothing is `Unknown`.
    pub fn of(miss: &Missed) -> Self {
        let excess_ns = miss.response_ns.saturating_sub(miss.deadline_ns);
        if excess_ns == 0 {
            return MissCause::Unknown;
        }
        if miss.cpu_ns > miss.deadline_ns && !miss.steal {
            return MissCause::Compute;
        }
        // The two clocks are not read at the same instant: the usual difference is none of time off the CPU.
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

    /// A thread that nothing took off the CPU was not preempted, wherever its time went.
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

/// How much time the hypervisor had taken by an instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StealSample {
    /// The instant, ns.
    pub at_ns: u64,
    /// Clock ticks that were stolen so far, as `/proc/stat` counts them.
    pub stolen_ticks: u64,
}

/// Whether the count grew around `[from_ns, to_ns]`: between the last sample not after it begins and the first not
/// before it ends, or the outermost there are. Samples are in the order of time; without two around it, nothing was
/// seen.
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
