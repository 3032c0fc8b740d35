//! The global thread: it receives the cycles that have passed and sends the models that it builds from them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::channel::GlobalEnd;
use super::meter::Times;
use super::os;
use crate::multirate::global::GlobalSide;
use crate::multirate::timeline::RecordedTimes;

/// Measurements of the global side.
///
/// ```
/// use stickslip::multirate::timeline::{Arrival, RecordedTimes};
/// use stickslip::realtime::builder::GlobalTimes;
///
/// let mut global = GlobalTimes::new(100, 100_000_000); // cycles of 100 ticks and 0.1 s
/// global.record(40_000_000, 39_000_000, 1);
/// global.record(150_000_000, 60_000_000, 2); // it took two cycles at once, and too long
/// assert_eq!((global.models_built(), global.late(), global.shared()), (2, 1, 1));
///
/// // The second model is 250 ticks old when a pass of 450 ticks ends.
/// let arrivals = vec![Arrival { from: 100, at: 141 }, Arrival { from: 200, at: 352 }];
/// global.record_ages(&RecordedTimes { arrivals, ..RecordedTimes::default() }, 450);
/// assert_eq!((global.largest_latency_ticks(), global.largest_age_ticks()), (152, 251));
/// ```
#[derive(Debug, Clone)]
pub struct GlobalTimes {
    /// Wall time from the receipt of a cycle to its model.
    pub cycle: Times,
    /// CPU time of the global thread in the same interval.
    pub cpu: Times,
    ticks_per_cycle: u64,
    deadline_ns: u64,
    late: u64,
    shared: u64,
    largest_latency_ticks: u64,
    largest_age_ticks: u64,
}

impl GlobalTimes {
    /// Prepares measurements for cycles of this many ticks and ns, which is also their deadline.
    pub fn new(ticks_per_cycle: u64, deadline_ns: u64) -> Self {
        Self {
            cycle: Times::new(),
            cpu: Times::new(),
            ticks_per_cycle,
            deadline_ns,
            late: 0,
            shared: 0,
            largest_latency_ticks: 0,
            largest_age_ticks: 0,
        }
    }

    /// Records a model that took `cycle_ns` from the receipt of this many cycles.
    pub fn record(&mut self, cycle_ns: u64, cpu_ns: u64, cycles: u64) {
        self.cycle.record(cycle_ns);
        self.cpu.record(cpu_ns);
        self.late += u64::from(cycle_ns > self.deadline_ns);
        self.shared += cycles.saturating_sub(1);
    }

    /// Records how old models came into use and became in a pass of this many ticks.
    pub fn record_ages(&mut self, times: &RecordedTimes, ticks: u64) {
        let mut from = 0;
        for arrival in &times.arrivals {
            self.largest_latency_ticks = self.largest_latency_ticks.max(arrival.at.saturating_sub(arrival.from));
            self.largest_age_ticks = self.largest_age_ticks.max(arrival.at.saturating_sub(1 + from));
            from = arrival.from;
        }
        self.largest_age_ticks = self.largest_age_ticks.max(ticks.saturating_sub(1 + from));
    }

    /// Returns the number of ticks in a cycle.
    pub fn ticks_per_cycle(&self) -> u64 {
        self.ticks_per_cycle
    }

    /// Returns the deadline of a cycle, ns: a model that takes longer than a cycle delays the next one.
    pub fn deadline_ns(&self) -> u64 {
        self.deadline_ns
    }

    /// Returns the number of models built.
    pub fn models_built(&self) -> u64 {
        self.cycle.count()
    }

    /// Returns the number of models that took longer than a cycle.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Returns the number of cycles without a model of their own: the global side took them together with later ones.
    pub fn shared(&self) -> u64 {
        self.shared
    }

    /// Returns the largest number of ticks from the boundary that a model was built from to its first tick.
    pub fn largest_latency_ticks(&self) -> u64 {
        self.largest_latency_ticks
    }

    /// Returns the largest number of ticks from that boundary to a tick that used the model.
    pub fn largest_age_ticks(&self) -> u64 {
        self.largest_age_ticks
    }
}

/// Builds models until `done`; `sides` has the global side and the number of ticks of every pass.
pub(super) fn build_models(
    mut end: GlobalEnd,
    mut sides: Vec<(Option<GlobalSide>, u64)>,
    first_patches: &[Vec<u32>],
    idle: Duration,
    done: &AtomicBool,
    mut times: GlobalTimes,
) -> GlobalTimes {
    let mut pass = 0;
    loop {
        if let Some(waiting) = end.pass_waiting()
            && waiting != pass
        {
            pass = waiting;
            end.begin_pass(pass, first_patches.get(pass as usize).map_or(&[][..], Vec::as_slice));
        }
        let (wall_ns, cpu_ns) = (os::now_ns(), os::thread_cpu_ns());
        let mut passed = Vec::new();
        let mut boundary = 0;
        while let Some((tick, cycle)) = end.next_cycle() {
            boundary = tick;
            passed.push(cycle);
        }
        let is_over = end.pass_waiting().is_some_and(|waiting| waiting != pass);
        match sides.get_mut(pass as usize) {
            Some((Some(side), ticks)) if !passed.is_empty() && boundary < *ticks && !is_over => {
                let cycles = passed.len() as u64;
                let model = side.next_model(passed, &mut |_| ());
                end.send(boundary, model);
                times.record(os::now_ns() - wall_ns, os::thread_cpu_ns() - cpu_ns, cycles);
            }
            _ if done.load(Ordering::Acquire) => return times,
            _ => std::thread::sleep(idle),
        }
    }
}
