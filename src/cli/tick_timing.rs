//! Times of single ticks of a recorded session, repeated from the same state with warm caches and with evicted ones.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::time::Instant;

use serde::Serialize;

use crate::contact::law::Mode;
use crate::multirate::servo::Servo;
use crate::multirate::timeline::DeadlineOutcome;
use crate::pipeline::{Lockstep, Simulation};
use crate::scene::{Scene, SceneError};
use crate::session::{RecordedPass, ReplayReason, Session, TickToReplay};

/// Repetitions with warm caches.
const WARM: usize = 101;
/// Repetitions with cold caches.
const COLD: usize = 21;
/// Words of 8 bytes written between two cold repetitions: more than one core's share of any cache.
const EVICTING: usize = 8 << 20;
/// Ticks of rest after which all motion has decayed.
const REST_TICKS: u64 = 20_000;

/// Times of a repeated tick.
#[derive(Debug, Clone, Serialize)]
pub struct TimedTick {
    /// Number of the pass.
    pub pass: u32,
    /// Number of the tick in its pass, from 0; for a tick at rest, the number of ticks at rest before it.
    pub tick: u64,
    /// Reasons to repeat the tick.
    pub why: Vec<ReplayReason>,
    /// Median and longest time with warm caches, ns.
    pub warm_ns: [u64; 2],
    /// Median and longest time with cold caches, ns.
    pub cold_ns: [u64; 2],
}

/// Times the ticks that a session marks, and from its first pass one of every kind that may take long: contact onset,
/// crossing of an edge, hand-over of a model, rest after a long decay. A tick with several reasons is timed once. Repeating a
/// tick takes copies of it, which a renderer in a library does not have: then nothing is timed.
///
/// # Errors
/// If the scene cannot start.
pub fn time_ticks(session: &Session, scene: &Scene) -> Result<Vec<TimedTick>, SceneError> {
    if scene.renderer().is_some() {
        return Ok(Vec::new());
    }
    let mut timed = Vec::new();
    let mut cache = vec![0_u64; EVICTING];
    for (number, pass) in session.passes.iter().enumerate() {
        let simulation = session.prepare(scene, pass)?;
        let mut marked: Vec<TickToReplay> =
            session.worst.iter().filter(|tick| tick.pass == pass.pass).cloned().collect();
        if number == 0 {
            marked.extend(kinds(simulation.clone(), pass));
            let rest = Simulation::prepare(scene)?;
            timed.extend(at_rest(rest, pass.pass, &mut cache));
        }
        let mut reasons: BTreeMap<u64, Vec<ReplayReason>> = BTreeMap::new();
        marked.iter().for_each(|marked| reasons.entry(marked.tick).or_default().push(marked.why));
        let mut run = Lockstep::new(simulation);
        for (tick, why) in reasons {
            while run.servo().next_tick() < tick && matches!(run.step(), Ok(Some(_))) {}
            let is_next = run.servo().next_tick() == tick;
            if let Some(servo) = is_next.then(|| run.servo_at_next_tick()).flatten() {
                let [warm_ns, cold_ns] = time(&servo, &mut cache);
                timed.push(TimedTick { pass: pass.pass, tick, why, warm_ns, cold_ns });
            }
        }
    }
    Ok(timed)
}

/// Returns the first tick of every kind in a pass.
fn kinds(simulation: Simulation, pass: &RecordedPass) -> Vec<TickToReplay> {
    let mut run = Lockstep::new(simulation);
    let mut first: Vec<(ReplayReason, u64)> = Vec::new();
    let mut triangle = None;
    while run.servo().next_tick() < pass.ticks
        && let Ok(Some(view)) = run.step()
    {
        let now = view.report.touch.map(|touch| touch.point.triangle);
        let found = [
            (ReplayReason::ContactOnset, view.report.collision_time.is_some()),
            (ReplayReason::EdgeCrossed, triangle.is_some() && now.is_some() && now != triangle),
            (ReplayReason::HandOver, view.tick > 0 && view.model_age == 0 && view.report.mode != Mode::Free),
        ];
        triangle = now;
        for (why, _) in found.iter().filter(|(_, is_so)| *is_so && view.deadline_outcome != DeadlineOutcome::Skipped) {
            if !first.iter().any(|(known, _)| known == why) {
                first.push((*why, view.tick));
            }
        }
    }
    first.iter().map(|&(why, tick)| TickToReplay { pass: pass.pass, tick, why }).collect()
}

/// Times a tick of a network at rest without contact, where subnormal numbers would show.
fn at_rest(simulation: Simulation, pass: u32, cache: &mut [u64]) -> Option<TimedTick> {
    let mut servo = simulation.into_sides().servo;
    // The tip of the first tick, held.
    for _ in 0..REST_TICKS {
        let tip = servo.tip();
        servo.compute(tip).ok()?;
    }
    let [warm_ns, cold_ns] = time(&servo, cache);
    Some(TimedTick { pass, tick: REST_TICKS, why: vec![ReplayReason::Rest], warm_ns, cold_ns })
}

/// Returns the median and the longest time with warm and with cold caches, ns.
fn time(servo: &Servo, cache: &mut [u64]) -> [[u64; 2]; 2] {
    let once = |before: &mut dyn FnMut()| {
        let mut servo = servo.clone();
        let tip = servo.sense();
        before();
        let start = Instant::now();
        // A fault takes its time like any other outcome.
        let report = tip.and_then(|tip| servo.compute(tip));
        let took = start.elapsed();
        let _ = black_box(report);
        took.as_nanos() as u64
    };
    let warm = (0..WARM).map(|_| once(&mut || ())).collect();
    let mut evict = || {
        cache.iter_mut().for_each(|word| *word = word.wrapping_add(1));
        black_box(&mut *cache);
    };
    let cold = (0..COLD).map(|_| once(&mut evict)).collect();
    [median_and_max(warm), median_and_max(cold)]
}

fn median_and_max(mut times: Vec<u64>) -> [u64; 2] {
    times.sort_unstable();
    [times[times.len() / 2], times.last().copied().unwrap_or_default()]
}

/// Returns the names of reasons, separated by commas.
pub fn names(why: &[ReplayReason]) -> String {
    why.iter().map(|why| why.name()).collect::<Vec<_>>().join(", ")
}
