//! The global side's threads: one receives the cycles that have passed, the other builds models from them.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use super::channel::{Intake, ModelSender, PastCycle};
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
/// global.record(150_000_000, 60_000_000, 2); // from two cycles at once, and late
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

    /// Records the latency and the largest age of the models of a pass of this many ticks.
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

/// A message to the global thread.
pub(super) enum ToGlobal {
    /// The global side of a pass of this many ticks, before all its cycles.
    Side { pass: u32, side: Box<GlobalSide>, ticks: u64 },
    /// A cycle that has passed.
    Cycle(Box<PastCycle>),
}

/// Empties the ring into an unbounded queue until `done`, so that no part of the path is lost while the global side
/// computes.
pub(super) fn take_in(mut intake: Intake, queue: &Sender<ToGlobal>, idle: Duration, done: &AtomicBool) {
    loop {
        let is_done = done.load(Ordering::Acquire);
        while let Some(cycle) = intake.next_cycle() {
            if queue.send(ToGlobal::Cycle(Box::new(cycle))).is_err() {
                return;
            }
        }
        if is_done {
            return;
        }
        std::thread::sleep(idle);
    }
}

/// Builds models until `done`, each from all cycles of the newest pass that have arrived in the meantime.
pub(super) fn build_models(
    queue: &Receiver<ToGlobal>,
    mut sender: ModelSender,
    done: &AtomicBool,
    mut times: GlobalTimes,
) -> GlobalTimes {
    let mut sides: VecDeque<(u32, Box<GlobalSide>, u64)> = VecDeque::new();
    while let Ok(first) = queue.recv() {
        let (wall_ns, cpu_ns) = (os::now_ns(), os::thread_cpu_ns());
        let mut passed: Vec<PastCycle> = Vec::new();
        for message in std::iter::once(first).chain(queue.try_iter()) {
            match message {
                ToGlobal::Side { pass, side, ticks } => sides.push_back((pass, side, ticks)),
                ToGlobal::Cycle(cycle) => {
                    // A pass that is over needs no model.
                    passed.retain(|earlier| earlier.pass == cycle.pass);
                    passed.push(*cycle);
                }
            }
        }
        if done.load(Ordering::Acquire) {
            break;
        }
        let Some(&PastCycle { pass, boundary, .. }) = passed.last() else { continue };
        sides.retain(|(of, _, _)| *of >= pass);
        if let Some((_, side, ticks)) = sides.front_mut().filter(|(of, _, _)| *of == pass)
            && boundary < *ticks
        {
            let cycles = passed.len() as u64;
            let model = side.next_model(passed.into_iter().map(|cycle| cycle.message), &mut |_| ());
            sender.send(pass, boundary, model);
            times.record(os::now_ns() - wall_ns, os::thread_cpu_ns() - cpu_ns, cycles);
        }
    }
    times
}
