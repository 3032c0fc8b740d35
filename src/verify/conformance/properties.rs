//! The properties, each with its limit and the reason for it.

use super::drive::{Drive, DrivenTick};
use super::motions::{HELD_S, JUMPS, LIFTED_S, Motion, PRESSED_S};
use super::{PropertyFinding, Runs};
use crate::Vec3;
use crate::contact::law::{Law, Mode};
use crate::contact::renderer::Renderer;
use crate::multirate::failsafe::{Bounds, FailSafe};
use crate::output::verdict::Verdict;
use crate::pipeline::{OwnParts, Simulation};
use crate::scene::{Scene, SceneError};
use crate::verify::residual::{larger, largest};

/// Force of a free tip, N: none at all.
const FREE_N: f64 = 0.0;
/// Force beyond the cone or adhesion, over the peak: single precision suffices for a renderer.
const BEYOND_CONE: f64 = 1e-6;
/// Difference between two runs of one physics, over the peak: single precision again, grown over a drag. Ours are below
/// 1e-9.
const SAME: f64 = 1e-5;
/// Shrinking of the difference when ticks are halved: a first-order method has one half.
const SHRINKS: f64 = 0.8;
/// Difference over the peak below which forces have converged already.
const CONVERGED: f64 = 0.01;
/// Energy given to the hand over a closed path, over the work done on the way: forces are samples at the ticks' ends, and
/// the trapezoidal rule integrates them to far less.
const ENERGY: f64 = 0.01;
/// Change of the force of a held tip, over that force: a tenth of what a hand can tell.
const HELD: f64 = 0.01;
/// Change of the force at a hand-over, over the force before it: what a hand can tell (10 %).
const HAND_OVER: f64 = 0.1;
/// Force after a jump in, over that of a slow press times the ratio of depths: the margin of the fail-safe over a device's
/// force. A jump of centimetres within a tick is felt through the body's dampers, and by some schemes as an impact.
const TELEPORT: f64 = 100.0;
/// Time of ticks at the end of a long hold, over that at its begin, of the faster of two runs.
const SLOWER: f64 = 2.0;
/// Length of the intervals in which times of ticks are compared, ticks.
const INTERVAL: usize = 200;

/// Measures all properties.
pub(super) fn all(
    scene: &Scene,
    renderer: Option<Box<dyn Renderer>>,
    runs: &Runs,
) -> Result<Vec<PropertyFinding>, SceneError> {
    Ok(vec![
        free(scene, runs),
        cone(scene, runs),
        lag(runs),
        turned(runs),
        renumbered(runs),
        same_bits(runs),
        converges(runs),
        energy(runs),
        held(runs),
        edges(runs),
        hand_over(runs),
        teleport(runs),
        nan(scene, renderer, runs)?,
        allocation(runs),
        slowdown(runs),
    ])
}

/// Judges what was measured. A value that is not finite, and a fault in one of the drives, fail.
fn judge(
    name: &'static str,
    property: &'static str,
    motions: &[Motion],
    drives: &[&Drive],
    (measured, limit, unit): (f64, f64, &'static str),
    words: String,
) -> PropertyFinding {
    let fault = drives.iter().find_map(|drive| drive.fault.as_ref());
    let passes = fault.is_none() && measured <= limit;
    PropertyFinding {
        name,
        verdict: if passes { Verdict::Pass } else { Verdict::Fail },
        measured: (fault.is_none() && measured.is_finite()).then_some(measured),
        limit,
        unit,
        property,
        motion: motions.iter().map(|motion| motion.name()).collect::<Vec<_>>().join(", "),
        finding: match fault {
            Some(fault) => format!("a run ended early: {fault}"),
            None => words,
        },
    }
}

/// Returns a finding about what could not be measured.
fn unknown(finding: PropertyFinding, reason: &str) -> PropertyFinding {
    match finding.verdict {
        Verdict::Fail => finding,
        _ => PropertyFinding { verdict: Verdict::Inconclusive, measured: None, finding: reason.to_owned(), ..finding },
    }
}

fn holds_on(scene: &Scene) -> bool {
    !scene.contact.adhesion_n.is_finite()
}

/// Returns all drives with the scene's tick and body, with their motions.
fn ordinary(runs: &Runs) -> [(&Drive, Motion); 6] {
    [
        (&runs.press, Motion::Press),
        (&runs.drag, Motion::SlowDrag),
        (&runs.tap, Motion::Tap),
        (&runs.stroke, Motion::Stroke),
        (&runs.lift_off, Motion::LiftOff),
        (&runs.teleport, Motion::Teleport),
    ]
}

fn free(scene: &Scene, runs: &Runs) -> PropertyFinding {
    // A tip that is a whole depth above the surface at rest is free, whatever the renderer reports; unless it holds on.
    let is_away = |tick: &DrivenTick| !holds_on(scene) && runs.site.height(tick.tip) > 0.99 * runs.site.depth_m;
    let forces = ordinary(runs).into_iter().flat_map(|(drive, _)| &drive.ticks);
    let forces = forces.filter(|tick| tick.mode == Mode::Free || is_away(tick)).map(|tick| tick.force.norm());
    let force = largest(forces);
    let (drives, motions) = parts(runs);
    judge(
        "no-force-when-free",
        "A tip that touches nothing feels no force.",
        &motions,
        &drives,
        (force, FREE_N, "N"),
        format!("the largest force on a free tip is {force:.3e} N"),
    )
}

fn parts(runs: &Runs) -> (Vec<&Drive>, Vec<Motion>) {
    ordinary(runs).into_iter().unzip()
}

fn cone(scene: &Scene, runs: &Runs) -> PropertyFinding {
    let adhesion = scene.contact.adhesion_n;
    let friction = match scene.contact.law {
        Law::Sliding => Some(0.0),
        Law::StickSlip { friction } => Some(friction.static_coefficient),
        Law::Sticking | Law::Own(_) => None,
    };
    let (mut excess, mut pull) = (0.0, 0.0);
    let mut lacks_normal = false;
    for (drive, _) in ordinary(runs) {
        for tick in drive.ticks.iter().filter(|tick| tick.mode != Mode::Free) {
            let Some(normal) = tick.normal.filter(|normal| (normal.norm() - 1.0).abs() < 1e-6) else {
                lacks_normal = true;
                continue;
            };
            let along = tick.force.dot(&normal);
            pull = larger(pull, -along - adhesion.min(f64::MAX));
            if let Some(friction) = friction {
                let across = (tick.force - normal * along).norm();
                excess = larger(excess, across - friction * (along + adhesion).max(0.0));
            }
        }
    }
    let peak = runs.drag.peak_n().max(runs.press.peak_n());
    let measured = larger(excess.max(0.0), pull.max(0.0)) / peak;
    let (drives, motions) = parts(runs);
    let words = if pull > excess {
        format!("the contact pulls by {pull:.3e} N more than its adhesion")
    } else {
        format!("the tangential force exceeds the friction cone by at most {:.3e} N", excess.max(0.0))
    };
    let finding = judge(
        "force-within-cone",
        "The force is finite and within the friction cone, and pulls by no more than the adhesion.",
        &motions,
        &drives,
        (measured, BEYOND_CONE, ""),
        words,
    );
    match lacks_normal {
        true => PropertyFinding {
            verdict: Verdict::Fail,
            finding: "a contact has no normal of unit length".to_owned(),
            ..finding
        },
        false => finding,
    }
}

fn lag(runs: &Runs) -> PropertyFinding {
    // The tick in which the tip jumps in.
    let jump = JUMPS[1] as usize;
    let after = runs.teleport.ticks.get(jump..).unwrap_or_default();
    let ticks = after.iter().position(|tick| tick.force.norm() > 0.0);
    let measured = ticks.map_or(f64::INFINITY, |ticks| ticks as f64);
    judge(
        "no-lag",
        "A tip that is pressed in feels a force at the end of the same tick.",
        &[Motion::Teleport],
        &[&runs.teleport],
        (measured, 0.0, "ticks"),
        match ticks {
            Some(ticks) => format!("the force comes {ticks} ticks after the tick in which the tip enters"),
            None => "no force comes after the tip has entered".to_owned(),
        },
    )
}

/// Returns the largest difference of forces over the peak.
fn difference(a: &Drive, b: &Drive) -> f64 {
    if a.ticks.len() != b.ticks.len() {
        return f64::INFINITY;
    }
    largest(a.ticks.iter().zip(&b.ticks).map(|(a, b)| (a.force - b.force).norm())) / a.peak_n()
}

fn turned(runs: &Runs) -> PropertyFinding {
    let measured = difference(&runs.drag, &runs.drag_turned);
    judge(
        "rotates-with-scene",
        "Turning the body and the path turns the force.",
        &[Motion::SlowDrag],
        &[&runs.drag, &runs.drag_turned],
        (measured, SAME, ""),
        format!("turned with the scene, the force differs by {measured:.3e} of the peak"),
    )
}

fn renumbered(runs: &Runs) -> PropertyFinding {
    let measured = difference(&runs.drag, &runs.drag_renumbered);
    judge(
        "order-does-not-matter",
        "The order of nodes and springs does not matter.",
        &[Motion::SlowDrag],
        &[&runs.drag, &runs.drag_renumbered],
        (measured, SAME, ""),
        format!("with nodes and springs in the opposite order, the force differs by {measured:.3e} of the peak"),
    )
}

fn same_bits(runs: &Runs) -> PropertyFinding {
    let bits = |tick: &DrivenTick| tick.force.map(f64::to_bits);
    let pairs = runs.press.ticks.iter().zip(&runs.press_again.ticks);
    let differ = pairs.filter(|(a, b)| bits(a) != bits(b)).count();
    let differ = differ + runs.press.ticks.len().abs_diff(runs.press_again.ticks.len());
    judge(
        "same-bits",
        "The same input gives the same forces to the bit.",
        &[Motion::Press],
        &[&runs.press, &runs.press_again],
        (differ as f64, 0.0, "ticks"),
        format!("{differ} ticks differ between two equal runs"),
    )
}

fn converges(runs: &Runs) -> PropertyFinding {
    let [half, quarter] = &runs.drag_shorter;
    let peak = runs.drag.peak_n();
    // Root mean square of the difference at the ends of the coarser drive's ticks, over the peak.
    let apart = |coarse: &Drive, fine: &Drive| {
        let fine = fine.ticks.iter().skip(1).step_by(2);
        let squares: Vec<f64> =
            coarse.ticks.iter().zip(fine).map(|(a, b)| (a.force - b.force).norm_squared()).collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt() / peak
    };
    let (first, second) = (apart(&runs.drag, half), apart(half, quarter));
    let limit = (SHRINKS * first).max(CONVERGED);
    judge(
        "converges",
        "Halving the tick changes the force less and less.",
        &[Motion::SlowDrag],
        &[&runs.drag, half, quarter],
        (second, limit, ""),
        format!(
            "halving the tick changes the force by {:.2} % of the peak (root mean square), and halving it again by {:.2} %",
            100.0 * first,
            100.0 * second
        ),
    )
}

fn energy(runs: &Runs) -> PropertyFinding {
    // From a free tip to a free tip; the body comes to rest after it.
    let tick_s = tick_s(&runs.lift_off, LIFTED_S + 1.5);
    let end = ((LIFTED_S + 1.0) / tick_s) as usize;
    let ticks = &runs.lift_off.ticks[..end.min(runs.lift_off.ticks.len())];
    let (mut given, mut total) = (0.0, 0.0);
    for pair in ticks.windows(2) {
        let work = 0.5 * (pair[0].force + pair[1].force).dot(&(pair[1].tip - pair[0].tip));
        given += work;
        total += work.abs();
    }
    let created = ticks.last().map_or(0.0, |tick| tick.created_j);
    let measured = if total > 0.0 { ((given - created) / total).max(0.0) } else { f64::NAN };
    judge(
        "no-energy",
        "Over a closed path that starts and ends free, the contact gives no energy to the hand.",
        &[Motion::LiftOff],
        &[&runs.lift_off],
        (measured, ENERGY, ""),
        format!(
            "the hand {} {:.3e} J of {total:.3e} J exchanged, and {created:.3e} J are stated as created by the contact",
            if given > 0.0 { "gains" } else { "loses" },
            given.abs()
        ),
    )
}

/// Returns the length of a tick of a drive that lasts so long.
fn tick_s(drive: &Drive, duration_s: f64) -> f64 {
    duration_s / drive.ticks.len().max(1) as f64
}

/// Returns the ticks of a held press in an interval of time, s.
fn held_between(drive: &Drive, from: f64, to: f64) -> &[DrivenTick] {
    let tick_s = tick_s(drive, HELD_S);
    let count = drive.ticks.len();
    let at = |time: f64| ((time / tick_s) as usize).min(count);
    &drive.ticks[at(from)..at(to)]
}

fn held(runs: &Runs) -> PropertyFinding {
    // The network has had more than a second to come to rest.
    let ticks = held_between(&runs.press, HELD_S - 0.5, HELD_S);
    let first = ticks.first().map_or(Vec3::zeros(), |tick| tick.force);
    let change = largest(ticks.iter().map(|tick| (tick.force - first).norm())) / first.norm();
    judge(
        "no-motion-no-change",
        "The force on a tip that is held does not change: the contact neither creeps nor buzzes.",
        &[Motion::Press],
        &[&runs.press],
        (change, HELD, ""),
        format!("in half a second of holding, the force changes by {:.3} %", 100.0 * change),
    )
}

fn edges(runs: &Runs) -> PropertyFinding {
    // Pressed in by a depth, a tip that slides over edges stays in contact.
    let begin = |drive: &Drive, duration_s: f64| (PRESSED_S / tick_s(drive, duration_s)) as usize;
    let lost = |drive: &Drive, duration_s: f64| {
        let ticks = drive.ticks.get(begin(drive, duration_s)..).unwrap_or_default();
        ticks.iter().filter(|tick| !(tick.force.norm() > 0.0)).count()
    };
    // Strokes end in a fifth of a second of holding; their length in seconds is that of their ticks.
    let stroke_s = runs.stroke.ticks.len() as f64 * tick_s(&runs.drag, PRESSED_S + 1.0);
    let lost = lost(&runs.drag, PRESSED_S + 1.0) + lost(&runs.stroke, stroke_s);
    judge(
        "nothing-lost-at-edges",
        "A tip that is dragged over the edges of the mesh keeps its contact.",
        &[Motion::SlowDrag, Motion::Stroke],
        &[&runs.drag, &runs.stroke],
        (lost as f64, 0.0, "ticks"),
        format!("{lost} ticks are without force"),
    )
}

fn hand_over(runs: &Runs) -> PropertyFinding {
    let held = held_between(&runs.press, PRESSED_S, HELD_S);
    let jumps = held.windows(2).filter(|pair| pair[1].is_new_model);
    let jump = largest(jumps.map(|pair| (pair[1].force - pair[0].force).norm() / pair[0].force.norm()));
    let count = held.iter().filter(|tick| tick.is_new_model).count();
    let finding = judge(
        "bounded-hand-over",
        "The force on a tip that is held changes little when a new model takes over.",
        &[Motion::Press],
        &[&runs.press],
        (jump, HAND_OVER, ""),
        format!("the largest change at a hand-over is {:.2} %", 100.0 * jump),
    );
    if count == 0 { unknown(finding, "there was no hand-over during the hold") } else { finding }
}

fn teleport(runs: &Runs) -> PropertyFinding {
    let pressed = held_between(&runs.press, PRESSED_S, HELD_S).last().map_or(f64::NAN, |tick| tick.force.norm());
    let jump = runs.teleport.ticks.get(JUMPS[1] as usize..).unwrap_or_default();
    let force = largest(jump.iter().map(|tick| tick.force.norm()));
    let measured = force / (3.0 * pressed);
    judge(
        "bounded-teleport",
        "After a jump into the body within one tick, the force is finite and of the size of a press to that depth.",
        &[Motion::Teleport],
        &[&runs.teleport],
        (measured, TELEPORT, ""),
        format!("the force after the jump is {force:.3} N, {measured:.2} times that of a slow press as deep"),
    )
}

fn nan(scene: &Scene, renderer: Option<Box<dyn Renderer>>, runs: &Runs) -> Result<PropertyFinding, SceneError> {
    let pressed = Motion::Press.scene(scene, &runs.site)?;
    let simulation = Simulation::prepare_with(&pressed, OwnParts { renderer, ..OwnParts::default() })?;
    let mut fail_safe = FailSafe::new(Bounds::new(&simulation.network().rest, scene.largest_contact_force_n()));
    let mut servo = simulation.into_sides().servo;
    // To the end of the first cycle, in which the first model is in use.
    let ticks = u64::from(scene.ticks_per_cycle()).min(pressed.tick_count());
    let mut fault = None;
    while servo.next_tick() < ticks && fault.is_none() {
        fault = servo.tick(crate::multirate::timeline::DeadlineOutcome::OnTime).err();
    }
    let (tick, before) = (servo.next_tick(), servo.tip());
    let mut local = servo.into_local();
    let tip = Vec3::repeat(f64::NAN);
    let report = local.tick(before, tip);
    // What the fail-safe would let pass.
    let passed = fail_safe.command(tick, tip, &local, &report);
    let measured = passed.map_or(0.0, |force| force.norm());
    Ok(judge(
        "nan-never-a-force",
        "A tip position that is not a number is never answered by a force.",
        &[],
        &[],
        (measured, 0.0, "N"),
        match passed {
            Ok(_) => format!("the command after it is {measured:.3e} N"),
            Err(fault) => format!("it ends the run: {}", fault.cause),
        },
    ))
}

fn allocation(runs: &Runs) -> PropertyFinding {
    // In the first tick of a run and of a model, the program itself may still be loading code.
    let counts = ordinary(runs).into_iter().flat_map(|(drive, _)| drive.ticks.iter().skip(1));
    let counts: Vec<Option<u64>> = counts.map(|tick| tick.allocations).collect();
    let most = counts.iter().flatten().max().copied().unwrap_or_default();
    let (drives, motions) = parts(runs);
    let finding = judge(
        "no-allocation",
        "A tick allocates and frees no memory.",
        &motions,
        &drives,
        (most as f64, 0.0, "calls"),
        format!("a tick makes up to {most} calls of the allocator"),
    );
    if counts.iter().all(Option::is_some) {
        finding
    } else {
        unknown(finding, "this program does not count calls of the allocator")
    }
}

fn slowdown(runs: &Runs) -> PropertyFinding {
    let median = |ticks: &[DrivenTick]| {
        let mut times: Vec<u64> = ticks.iter().map(|tick| tick.nanoseconds).collect();
        times.sort_unstable();
        times.get(times.len() / 2).map_or(f64::NAN, |&time| time as f64)
    };
    let ratio = |drive: &Drive| {
        let held = held_between(drive, PRESSED_S, HELD_S);
        let count = INTERVAL.min(held.len() / 2);
        median(&held[held.len() - count..]) / median(&held[..count])
    };
    let measured = ratio(&runs.press).min(ratio(&runs.press_again));
    let finding = judge(
        "no-slowdown",
        "A tick takes no longer late in a run than early.",
        &[Motion::Press],
        &[&runs.press, &runs.press_again],
        (measured, SLOWER, ""),
        format!("late ticks of a hold take {measured:.2} times as long as early ones"),
    );
    // A time is the machine's as well, so it decides nothing by itself.
    match finding.verdict {
        Verdict::Fail if measured.is_finite() => PropertyFinding { verdict: Verdict::Inconclusive, ..finding },
        _ => finding,
    }
}
