//! Times of ticks and cycles. Every repetition of a run does the same work in the same order, so what a tick
//! takes is the least of its repetitions: the rest is the machine's doing, and its spread is given.

use std::time::{Duration, Instant};

use serde::Serialize;

use crate::multirate::global::Moment;
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError};

/// Times of each run, unless the share of its time is over before.
const REPEATS: usize = 7;

/// What a method takes.
#[derive(Debug, Clone, Serialize)]
pub struct Cost {
    /// Median over ticks, each the least of its repeats, ns.
    pub tick_ns_p50: f64,
    /// 99th percentile of the same.
    pub tick_ns_p99: f64,
    /// Largest of the same.
    pub tick_ns_max: f64,
    /// Least and largest median among the repeats.
    pub tick_ns_p50_spread: [f64; 2],
    /// The longest tick of any repeat, with whatever interrupted it.
    pub tick_ns_longest: f64,
    /// Building a local model: median over cycles, each the least of its repeats; absent without cycles.
    pub build_ms: Option<f64>,
    /// Largest of the same.
    pub build_ms_max: Option<f64>,
    /// The longest whole cycle: to catch up and to build.
    pub cycle_ms_max: Option<f64>,
    /// Runs that were timed.
    pub repeats: usize,
}

/// Times one run after the other.
pub struct Stopwatch {
    share: Duration,
}

#[derive(Clone, Default)]
struct Times {
    ticks: Vec<f64>,
    builds: Vec<f64>,
    cycles: Vec<f64>,
}

impl Stopwatch {
    /// For so many methods, which all together may take `patience`.
    pub fn new(patience: Duration, methods: usize) -> Self {
        Self { share: patience / methods.max(1) as u32 }
    }

    /// What a scene takes.
    ///
    /// # Errors
    /// If it cannot start.
    pub fn cost(&mut self, scene: &Scene) -> Result<Cost, SceneError> {
        let simulation = Simulation::prepare(scene)?;
        let start = Instant::now();
        let mut least = run(simulation.clone());
        let mut longest = highest(&least.ticks);
        let mut medians = vec![percentile(&least.ticks, 0.5)];
        while medians.len() < REPEATS && start.elapsed() < self.share {
            let again = run(simulation.clone());
            longest = longest.max(highest(&again.ticks));
            medians.push(percentile(&again.ticks, 0.5));
            for (least, again) in [
                (&mut least.ticks, &again.ticks),
                (&mut least.builds, &again.builds),
                (&mut least.cycles, &again.cycles),
            ] {
                least.iter_mut().zip(again).for_each(|(least, again)| *least = least.min(*again));
            }
        }
        let ms = |times: &[f64], share: f64| (!times.is_empty()).then(|| 1e-6 * percentile(times, share));
        Ok(Cost {
            tick_ns_p50: percentile(&least.ticks, 0.5),
            tick_ns_p99: percentile(&least.ticks, 0.99),
            tick_ns_max: highest(&least.ticks),
            tick_ns_p50_spread: [percentile(&medians, 0.0), percentile(&medians, 1.0)],
            tick_ns_longest: longest,
            build_ms: ms(&least.builds, 0.5),
            build_ms_max: ms(&least.builds, 1.0),
            cycle_ms_max: ms(&least.cycles, 1.0),
            repeats: medians.len(),
        })
    }
}

/// Times of one run, ns; up to its fault, if one ends it.
fn run(simulation: Simulation) -> Times {
    let mut times = Times::default();
    let now = Instant::now();
    let (mut tick, mut cycle, mut build) = (now, now, now);
    let since = |start: Instant| start.elapsed().as_nanos() as f64;
    let mark = |moment| match moment {
        Moment::CycleBegins => cycle = Instant::now(),
        Moment::ModelBegins => build = Instant::now(),
        Moment::ModelEnds => {
            times.builds.push(since(build));
            times.cycles.push(since(cycle));
        }
        Moment::TickBegins => tick = Instant::now(),
        Moment::TickEnds => times.ticks.push(since(tick)),
    };
    // What comes of it is known; here only the time counts.
    let _ = simulation.run_timed(mark, |_| ());
    times
}

fn highest(times: &[f64]) -> f64 {
    times.iter().copied().fold(0.0, f64::max)
}

/// The least value that this share of all does not exceed; 0 of none.
fn percentile(times: &[f64], share: f64) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied().unwrap_or(0.0)
}
