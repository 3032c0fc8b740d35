//! Times of ticks and cycles. Every repetition of a run does the same work in the same order, so a tick's time is the
//! shortest of its repetitions. The rest comes from the machine, and its spread is given.

use std::time::{Duration, Instant};

use serde::Serialize;

use crate::multirate::global::Moment;
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError};

/// Repetitions of each run, unless its share of the time is used up earlier.
const REPEATS: usize = 7;

/// Times of a method.
#[derive(Debug, Clone, Serialize)]
pub struct Cost {
    /// Median over ticks of the time per tick, ns; each tick's is the shortest of its repetitions.
    pub tick_ns_p50: f64,
    /// 99th percentile over ticks, ns.
    pub tick_ns_p99: f64,
    /// Largest over ticks, ns.
    pub tick_ns_max: f64,
    /// Smallest and largest median among the repetitions, ns.
    pub tick_ns_p50_spread: [f64; 2],
    /// Longest tick of any repetition, interruptions included, ns.
    pub tick_ns_longest: f64,
    /// Median over cycles of the time to build a local model, ms; absent without cycles.
    pub build_ms: Option<f64>,
    /// Longest time to build a local model, ms; absent without cycles.
    pub build_ms_max: Option<f64>,
    /// Longest whole cycle, ms: catching up and building a model.
    pub cycle_ms_max: Option<f64>,
    /// Timed runs.
    pub repeats: usize,
}

/// Times runs one after the other.
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
    /// Shares `patience` among a number of methods.
    pub fn new(patience: Duration, methods: usize) -> Self {
        Self { share: patience / methods.max(1) as u32 }
    }

    /// Measures the times of a scene.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn cost(&mut self, scene: &Scene) -> Result<Cost, SceneError> {
        let simulation = Simulation::prepare(scene)?;
        // A renderer in a library has no copy, and is prepared anew.
        let another = || match scene.renderer() {
            Some(_) => Simulation::prepare(scene),
            None => Ok(simulation.clone()),
        };
        let start = Instant::now();
        let mut least = run(another()?);
        let mut longest = highest(&least.ticks);
        let mut medians = vec![percentile(&least.ticks, 0.5)];
        while medians.len() < REPEATS && start.elapsed() < self.share {
            let again = run(another()?);
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

/// Measures one run, ns, up to its fault if one ends it.
fn run(simulation: Simulation) -> Times {
    let (mut times, mut elsewhere) = (Times::default(), Vec::new());
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
    // The result is known; only the time counts here.
    let _ = simulation.run_timed(mark, |view| elsewhere.extend(view.local.renderer_cost()));
    // A renderer in a process of its own knows what its ticks took.
    for (tick, cost) in times.ticks.iter_mut().zip(&elsewhere) {
        *tick = cost.nanoseconds as f64;
    }
    times
}

fn highest(times: &[f64]) -> f64 {
    times.iter().copied().fold(0.0, f64::max)
}

/// Returns the smallest value that at least this share of all values does not exceed; 0 if there are none.
fn percentile(times: &[f64], share: f64) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied().unwrap_or(0.0)
}
