//! Deadlines and late models in virtual time.

use stickslip::Vec3;
use stickslip::multirate::timeline::{Arrival, Cost, Costs, DeadlineOutcome, OverrunPolicy, RecordedTimes, Timeline};
use stickslip::pipeline::Simulation;
use stickslip::scene::Scene;
use stickslip::verify::lateness::{SHARES, consequences};

const SCENE: &str = "fig5-stick-slip";

/// Commands and actions of a run, tick by tick.
#[derive(Debug, Clone, PartialEq)]
struct Run {
    commanded: Vec<Vec3>,
    computed: Vec<Vec3>,
    tips: Vec<Vec3>,
    outcomes: Vec<DeadlineOutcome>,
    ages: Vec<u64>,
}

impl Run {
    fn of(scene: &Scene, timeline: Option<Timeline>) -> Self {
        let mut simulation = Simulation::prepare(scene).expect("it starts outside");
        if let Some(timeline) = timeline {
            simulation = simulation.with_timeline(timeline);
        }
        let mut run = Self { commanded: vec![], computed: vec![], tips: vec![], outcomes: vec![], ages: vec![] };
        simulation
            .run(|view| {
                run.commanded.push(view.force);
                run.computed.push(view.report.force);
                run.tips.push(view.tip);
                run.outcomes.push(view.deadline_outcome);
                run.ages.push(view.model_age);
            })
            .expect("no fault");
        run
    }

    fn late(&self) -> Vec<u64> {
        self.ticks(|deadline_outcome| matches!(deadline_outcome, DeadlineOutcome::Late(_)))
    }

    fn skipped(&self) -> Vec<u64> {
        self.ticks(|deadline_outcome| deadline_outcome == DeadlineOutcome::Skipped)
    }

    fn ticks(&self, which: impl Fn(DeadlineOutcome) -> bool) -> Vec<u64> {
        (0..)
            .zip(&self.outcomes)
            .filter(|&(_, &deadline_outcome)| which(deadline_outcome))
            .map(|(tick, _)| tick)
            .collect()
    }
}

fn scene(overrun: OverrunPolicy, tick: Cost, model: Cost) -> Scene {
    let mut scene = Scene::shipped(SCENE).expect("shipped");
    scene.deadline.overrun = overrun;
    scene.costs = Some(Costs { tick, model, seed: 7 });
    scene
}

const NOTHING: Cost = Cost::Constant(0.0);

fn rare() -> Cost {
    Cost::Rare { usual: 1e-4, rare: 2.5e-3, share: 0.05 }
}

#[test]
fn costs_within_the_deadline_change_nothing() {
    let plain = Run::of(&Scene::shipped(SCENE).expect("shipped"), None);
    let timed = Run::of(&scene(OverrunPolicy::Skip, Cost::Constant(1e-3), NOTHING), None);
    assert_eq!(plain, timed);
}

#[test]
fn the_same_seed_gives_the_same_misses_and_another_one_others() {
    let drawn = scene(OverrunPolicy::Hold, rare(), NOTHING);
    let run = Run::of(&drawn, None);
    assert_eq!(run, Run::of(&drawn, None));
    let mut other = drawn.clone();
    other.costs.as_mut().expect("it has costs").seed = 8;
    assert_ne!(run.late(), Run::of(&other, None).late());
    // 1200 draws of probability 0.05: 60, with a tolerance of four standard deviations of 7.5.
    assert!((30..=90).contains(&run.late().len()), "{} late ticks", run.late().len());
}

#[test]
fn holding_repeats_the_last_command_and_zero_commands_none() {
    for (overrun, expected) in [(OverrunPolicy::Hold, None), (OverrunPolicy::Zero, Some(Vec3::zeros()))] {
        let run = Run::of(&scene(overrun, rare(), NOTHING), None);
        assert!(!run.late().is_empty() && run.skipped().is_empty());
        let mut last = Vec3::zeros();
        for tick in 0..run.outcomes.len() {
            let force = match run.outcomes[tick] {
                DeadlineOutcome::OnTime => run.computed[tick],
                _ => expected.unwrap_or(last),
            };
            assert_eq!(run.commanded[tick], force, "tick {tick} under {overrun:?}");
            last = force;
        }
        // This instrument's path does not depend on the force, so the mesh is not affected.
        assert_eq!(run.computed, Run::of(&Scene::shipped(SCENE).expect("shipped"), None).computed);
    }
}

#[test]
fn an_overrun_of_two_and_a_half_ticks_skips_two_and_pushes_the_tip_on_at_once() {
    let table = |at: usize| (0..1200).map(|tick| if tick == at { 2.5e-3 } else { 1e-4 }).collect();
    let late = 400;
    let run = Run::of(&scene(OverrunPolicy::Skip, Cost::Table(table(late)), NOTHING), None);
    assert_eq!((run.late(), run.skipped()), (vec![400], vec![401, 402]));
    let plain = Run::of(&Scene::shipped(SCENE).expect("shipped"), None);
    assert_eq!(run.computed[..=late], plain.computed[..=late]);
    assert_eq!(run.tips, plain.tips);
    // The late force is commanded before the next computed tick.
    assert!(run.commanded[late..=late + 2].iter().all(|force| *force == run.commanded[late - 1]));
    assert_eq!(run.computed[late + 1..=late + 2], [run.computed[late]; 2]);
    assert_eq!(run.commanded[late + 3], run.computed[late + 3]);
    assert_ne!(run.computed[late + 3], plain.computed[late + 3]);
}

#[test]
fn models_come_when_they_are_ready_and_a_busy_side_leaves_boundaries_out() {
    let first_ticks = |cost: f64| {
        let run = Run::of(&scene(OverrunPolicy::Hold, NOTHING, Cost::Constant(cost)), None);
        (1..).zip(&run.ages[1..]).filter(|(_, age)| **age == 0).map(|(tick, _)| tick).collect::<Vec<u64>>()
    };
    let every = |start: u64, step: usize| (start..1200).step_by(step).collect::<Vec<u64>>();
    assert_eq!(first_ticks(0.03), every(130, 100));
    // Building takes exactly a cycle: none is omitted, and each arrives as the next begins.
    assert_eq!(first_ticks(0.1), every(200, 100));
    // Building takes a cycle and a half: from 100 to 250, then from the newest boundary, 200, to 400, then from 400 ...
    assert_eq!(first_ticks(0.15), every(250, 150));
}

#[test]
fn latency_in_virtual_time_is_that_of_the_scene() {
    let mut late = Scene::shipped(SCENE).expect("shipped");
    late.global.latency_ticks = 30;
    let timed = Run::of(&scene(OverrunPolicy::Hold, NOTHING, Cost::Constant(0.03)), None);
    assert_eq!(Run::of(&late, None), timed);
}

#[test]
fn what_was_recorded_runs_again_bit_for_bit() {
    for overrun in [OverrunPolicy::Hold, OverrunPolicy::Zero, OverrunPolicy::Skip] {
        let scene = scene(overrun, rare(), Cost::LogNormal { median: 0.05, p99: 0.25 });
        let drawn = Run::of(&scene, None);
        let mut arrivals = vec![];
        let mut timeline = scene.timeline();
        for from in (100..1200).step_by(100) {
            arrivals.extend(timeline.model_due(from).map(|at| Arrival { from, at }));
        }
        assert!(arrivals.len() < 11, "some boundary is left out");
        let times = RecordedTimes { arrivals, late: drawn.late(), skipped: drawn.skipped() };
        let again = Run::of(&scene, Some(Timeline::Recorded { times, overrun }));
        assert_eq!(drawn, again);
    }
}

#[test]
fn a_log_normal_cost_has_the_percentiles_it_is_given_by() {
    let ticks = 20_000_u64;
    let share_above = |deadline: f64| {
        let mut scene = scene(OverrunPolicy::Hold, Cost::LogNormal { median: 2e-4, p99: 9e-4 }, NOTHING);
        scene.deadline.after = deadline;
        let mut timeline = scene.timeline();
        (0..ticks).filter(|&tick| timeline.deadline_outcome(tick) != DeadlineOutcome::OnTime).count() as f64
            / ticks as f64
    };
    // The tolerance is four standard deviations of a share of 20,000 draws.
    for (deadline, share) in [(2e-4, 0.5), (9e-4, 0.01)] {
        let four = 4.0 * f64::sqrt(share * (1.0 - share) / ticks as f64);
        let found = share_above(deadline);
        assert!((found - share).abs() <= four, "{found} above {deadline}, expected {share} ± {four}");
    }
}

#[test]
fn more_lateness_does_more_and_none_does_nothing() {
    let scene = Scene::shipped(SCENE).expect("shipped");
    let found = consequences(&scene).expect("it runs");
    assert_eq!(found.on_time.force_error_rms_rel, Some(0.0));
    assert_eq!(found.on_time.missed_ticks, [0, 0]);
    for of_policy in found.late.chunks(SHARES.len()) {
        let errors: Vec<f64> = of_policy.iter().map(|c| c.force_error_rms_rel.expect("no fault")).collect();
        assert!(errors.windows(2).all(|pair| pair[0] <= pair[1]) && errors[2] > 0.0, "{of_policy:?}");
    }
    // A zero in the force changes it much; a force held for a tick hardly does.
    let error = |policy: OverrunPolicy| {
        let worst = found.late.iter().rfind(|c| c.overrun == policy).expect("every policy is there");
        worst.force_error_rms_rel.expect("no fault")
    };
    assert!(error(OverrunPolicy::Hold) < error(OverrunPolicy::Zero));
}
