//! The servo loop in real time. The tests check its behaviour, and none depends on its duration.
#![cfg(all(feature = "realtime", target_os = "linux"))]

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use stickslip::contact::law::Mode;
use stickslip::multirate::timeline::{Arrival, DeadlineOutcome, OverrunPolicy, RecordedTimes};
use stickslip::multirate::trajectory::PathRecording;
use stickslip::output::summary::ModeTicks;
use stickslip::output::summary::Recorder;
use stickslip::pipeline::{Sides, Simulation};
use stickslip::realtime::allocations::{self, Counting};
use stickslip::realtime::builder::GlobalTimes;
use stickslip::realtime::channel::{ChannelSettings, channel};
use stickslip::realtime::exercise::Exercise;
use stickslip::realtime::machine::Machine;
use stickslip::realtime::meter::{Meter, TickTimes};
use stickslip::realtime::os;
use stickslip::realtime::power::CpuSettings;
use stickslip::realtime::record::{Quantiles, Recorded, loop_settings, record};
use stickslip::realtime::threads::{Obtained, Pass, Served, Window, serve};
use stickslip::scene::Scene;
use stickslip::session::{RecordedPass, ReplayOutcome, ReplayReason, Session, replay};
use stickslip::verify::certificate::causes::MissCause;
use stickslip::verify::certificate::identity::Identity;
use stickslip::verify::certificate::parts::Verdict;
use stickslip::verify::certificate::verdict::{Certificate, Circumstances, WorstTick};
use stickslip::verify::lateness::consequences;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allows one loop at a time: they share the last CPU.
static TURN: Mutex<()> = Mutex::new(());

fn scene(text: &str) -> Scene {
    let scene = Scene::shipped("fig5-stick-slip")
        .expect("shipped")
        .text()
        .expect("it was read")
        .replace("latency_ticks = 0", "");
    Scene::parse(&format!("{scene}\n[run]\nschedule = \"threads\"\n{text}"), "threads.toml".as_ref()).expect("a scene")
}

fn recorded(scene: &Scene) -> Recorded {
    let _turn = TURN.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    record(scene, &AtomicBool::new(false)).expect("it starts")
}

fn again(session: &Session, pass: &RecordedPass) -> ReplayOutcome {
    let scene = session.scene().expect("it was one");
    replay(session.prepare(&scene, pass).expect("it starts"), pass, |_| ())
}

#[test]
fn a_run_in_real_time_is_done_again_bit_for_bit() {
    // With a deadline of a few microseconds, many ticks are late; with one of a tick, hardly any.
    for text in [
        "",
        "[timing]\ndeadline = 3e-6\noverrun = \"zero\"",
        "[timing]\ndeadline = 3e-6\noverrun = \"hold\"",
        "[timing]\ndeadline = 3e-6\noverrun = \"skip\"",
    ] {
        let run = recorded(&scene(text));
        let pass = &run.session.passes[0];
        assert_eq!((pass.ticks, pass.tape.len()), (1200, 1200));
        assert_eq!(run.summary.window.lost_notes, 0, "the ring holds cycles; the global side was seconds late");
        assert_eq!(again(&run.session, pass), ReplayOutcome::Same { fault: None }, "{text}");
        assert!(!pass.times.arrivals.is_empty(), "no model ever arrived");
        if !text.is_empty() {
            assert!(!pass.times.late.is_empty(), "no response is as short as 3 µs");
        }
    }
}

#[test]
fn a_recording_survives_its_file_and_betrays_what_was_changed() {
    let mut run = recorded(&scene(""));
    let text = serde_json::to_string(&run.session).expect("it can be written");
    let read: Session = serde_json::from_str(&text).expect("and read");
    assert_eq!(again(&read, &read.passes[0]), ReplayOutcome::Same { fault: None });

    let pass = &mut run.session.passes[0];
    let tick = pass.tape.iter().rposition(|taped| taped.force[2] != 0.0).unwrap_or(0);
    let whole = pass.clone();
    pass.tape[tick].force[2] = f64::from_bits(pass.tape[tick].force[2].to_bits() ^ 1);
    let changed = pass.clone();
    assert_eq!(again(&run.session, &changed), ReplayOutcome::Differs { tick: Some(tick as u64) });

    // Without a tape the checksum detects it.
    let mut untaped = whole.clone();
    untaped.tape.clear();
    assert_eq!(again(&run.session, &untaped), ReplayOutcome::Same { fault: None });
    untaped.checksum = "0000000000000000".to_owned();
    assert_eq!(again(&run.session, &untaped), ReplayOutcome::Differs { tick: None });

    // A missing model changes the forces.
    let mut lost = whole.clone();
    lost.times.arrivals.remove(0);
    assert!(matches!(again(&run.session, &lost), ReplayOutcome::Differs { tick: Some(_) }));
}

#[test]
fn the_servo_thread_allocates_nothing_in_its_window() {
    for text in ["", "[timing]\noverrun = \"skip\"\ndeadline = 5e-6"] {
        let window = recorded(&scene(text)).summary.window;
        assert_eq!(window.allocations, Some(0));
        println!("RESIDUAL | servo thread | page faults in the window | 0 | {}", window.page_faults);
    }
    // The allocation counter does count.
    let before = allocations::on_this_thread().expect("this test has the counting allocator");
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(allocations::on_this_thread(), Some(before + 2));
}

#[test]
fn a_loop_can_be_stopped_and_keeps_what_it_has() {
    let _turn = TURN.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let run = record(&scene(""), &AtomicBool::new(true)).expect("it starts");
    assert!(run.summary.stopped);
    assert_eq!(run.session.passes[0].ticks, 0);
}

#[test]
fn a_fault_ends_the_loop_and_comes_again() {
    let text = Scene::shipped("deep-stick-slip-faceted")
        .expect("shipped")
        .text()
        .expect("it was read")
        .replace("latency_ticks = 0", "");
    let text = format!("{text}\n[run]\nschedule = \"threads\"\n");
    let run = recorded(&Scene::parse(&text, "fault.toml".as_ref()).expect("a scene"));
    let pass = &run.session.passes[0];
    assert!(pass.ticks < 1200, "it runs away");
    let recorded = pass.fault.clone().expect("it is kept");
    match again(&run.session, pass) {
        ReplayOutcome::Same { fault: Some(fault) } => assert_eq!(fault.to_string(), recorded),
        other => panic!("{other:?}"),
    }
    // Without its fault it is another run: one that should have continued.
    let mut cut = pass.clone();
    cut.fault = Some("another".to_owned());
    assert!(matches!(again(&run.session, &cut), ReplayOutcome::Ended { .. }));
    assert_eq!(run.session.overrun, OverrunPolicy::Hold);
}

/// Counts of a run with every kind of contact.
fn exercised() -> Exercise {
    Exercise {
        mode_ticks: ModeTicks { free: 80, stick: 100, slide: 0, slip: 820 },
        collisions: 1,
        edge_crossings: 12,
        hand_overs: 9,
        models_built: 9,
        ..Exercise::default()
    }
}

/// Builds the times of a global side with cycles of 100 ticks and 0.1 s, most of which take 20 ms.
fn global(models: u64) -> GlobalTimes {
    let mut global = GlobalTimes::new(100, 100_000_000);
    (0..models).for_each(|_| global.record(20_000_000, 19_000_000, 1));
    global
}

/// Builds a loop with given release, response and CPU time of its ticks, in ns.
fn served(ticks: impl Iterator<Item = [u64; 3]> + Clone, deadline_ns: u64, policy: &'static str) -> Served {
    let mut meter = Meter::new(ticks.clone().count() as u64, deadline_ns);
    for (tick, [release_ns, response_ns, cpu_ns]) in (0..).zip(ticks) {
        let compute_ns = response_ns - release_ns;
        meter.tick(TickTimes { pass: 0, tick, release_ns, response_ns, compute_ns, cpu_ns }, tick * 1_000_000);
        meter.control(Some((release_ns, release_ns)));
    }
    Served {
        passes: Vec::new(),
        meter,
        global: Some(global(50)),
        exercise: exercised(),
        window: Window { allocations: Some(0), ..Window::default() },
        obtained: Obtained {
            policy,
            priority: 80,
            cpus: vec![1],
            memory_locked: true,
            cpu: CpuSettings::default(),
            refused: Vec::new(),
        },
        stopped: false,
        fault: None,
    }
}

fn worst(cold_ns: u64) -> WorstTick {
    let why = ReplayReason::MostCpuTime;
    WorstTick { pass: 0, tick: 5, why: vec![why], times: None, warm_ns: [1000, 1200], cold_ns: [cold_ns, cold_ns] }
}

fn judged(served: &Served, worst: Vec<WorstTick>, replayed: bool) -> Certificate {
    judged_over(served, worst, replayed, [5000, 1000, 1000])
}

/// Judges a loop. `ticks` are the number asked for, that of the path, and that of the longest pass.
fn judged_over(served: &Served, worst: Vec<WorstTick>, replayed: bool, ticks: [u64; 3]) -> Certificate {
    let machine = Machine::describe(0);
    let (scene, load) = ("x".to_owned(), "none".to_owned());
    let overrun = OverrunPolicy::Hold;
    let steal = Vec::new();
    let none = consequences(&Scene::shipped("fig3-sliding").expect("shipped").with_ticks(100)).expect("it runs");
    let [asked_ticks, path_ticks, longest_pass_ticks] = ticks;
    Certificate::new(
        served,
        Circumstances {
            identity: Identity::default(),
            scene,
            rate_hz: 1000.0,
            overrun,
            load,
            steal,
            machine,
            replayed,
            worst,
            consequences: none,
            idle: Quantiles::of(&served.meter.compute),
            asked_ticks,
            path_ticks,
            longest_pass_ticks,
            lockstep: exercised(),
        },
    )
}

const DEADLINE_NS: u64 = 1_000_000;

fn quiet(tick: u64) -> [u64; 3] {
    [20_000 + tick % 7, 25_000 + tick % 11, 5_000]
}

#[test]
fn verdicts_follow_from_what_was_measured() {
    use Verdict::{Fail, Inconclusive, Pass};
    let quiet_loop = || served((0..5000).map(quiet), DEADLINE_NS, "SCHED_FIFO");
    let verdicts = |certificate: &Certificate| (certificate.compute.verdict, certificate.platform.verdict);
    let judge = |served: &Served| verdicts(&judged(served, vec![worst(9_000)], true));
    assert_eq!(judge(&quiet_loop()), (Pass, Pass));

    let late_at = |at: u64, cpu: u64| move |tick| if tick == at { [30_000, 1_500_000, cpu] } else { quiet(tick) };
    let one_late = served((0..5000).map(late_at(77, 6_000)), DEADLINE_NS, "SCHED_FIFO");
    assert_eq!(judge(&one_late), (Pass, Fail));
    // A response on the deadline is in time, and one a nanosecond later is not.
    let exactly =
        |ns| served((0..5000).map(move |t| if t == 7 { [0, ns, 9] } else { quiet(t) }), DEADLINE_NS, "SCHED_FIFO");
    assert_eq!(judge(&exactly(DEADLINE_NS)).1, Pass);
    assert_eq!(judge(&exactly(DEADLINE_NS + 1)).1, Fail);

    assert_eq!(judge(&served((0..5000).map(quiet), DEADLINE_NS, "SCHED_OTHER")), (Pass, Inconclusive));
    let unlocked = Served { obtained: Obtained { memory_locked: false, ..quiet_loop().obtained }, ..quiet_loop() };
    assert_eq!(judge(&unlocked), (Pass, Inconclusive));
    assert_eq!(judge(&served((0..500).map(quiet), DEADLINE_NS, "SCHED_FIFO")), (Inconclusive, Inconclusive));

    let with = |allocations| Served { window: Window { allocations, ..Window::default() }, ..quiet_loop() };
    assert_eq!(judge(&with(Some(1))).0, Fail);
    assert_eq!(judge(&with(None)).0, Inconclusive);

    // A tick that is slow once does not fail; one that is slow when repeated does.
    let much_cpu = served((0..5000).map(late_at(77, 1_400_000)), DEADLINE_NS, "SCHED_FIFO");
    assert_eq!(judge(&much_cpu).0, Inconclusive);
    assert_eq!(verdicts(&judged(&much_cpu, vec![worst(1_100_000)], true)).0, Fail);
    assert_eq!(verdicts(&judged(&quiet_loop(), vec![worst(9_000)], false)).0, Fail);

    // Different forces from a path with gaps on the global side do not count against the program.
    let lossy = |allocations| {
        let window = Window { allocations: Some(allocations), lost_notes: 3, ..Window::default() };
        judged(&Served { window, ..quiet_loop() }, vec![worst(9_000)], false)
    };
    let certificate = lossy(0);
    assert_eq!(verdicts(&certificate), (Inconclusive, Pass));
    assert!(certificate.compute.reasons.concat().contains("3 notes lost to a full ring"), "{certificate:?}");
    assert_eq!(verdicts(&lossy(1)).0, Fail);
    let window = Window { allocations: Some(0), lost_notes: 3, ..Window::default() };
    assert_eq!(judge(&Served { window, ..quiet_loop() }).0, Pass, "what was lost made no difference");
}

/// A window in which the tip never touches proves nothing about contact, and neither does a window over a part of the path.
#[test]
fn a_verdict_is_about_what_was_exercised() {
    use Verdict::{Inconclusive, Pass};
    let quiet_loop = || served((0..5000).map(quiet), DEADLINE_NS, "SCHED_FIFO");
    let judge = |served: &Served, ticks| judged_over(served, vec![worst(9_000)], true, ticks);
    assert_eq!(judge(&quiet_loop(), [5000, 1000, 1000]).compute.verdict, Pass);

    // 3 of 60 s, none of them in contact.
    let free = Exercise { mode_ticks: ModeTicks { free: 3000, ..ModeTicks::default() }, ..Exercise::default() };
    let never_touched = Served { exercise: free, ..quiet_loop() };
    let certificate = judge(&never_touched, [3000, 60_000, 3000]);
    assert_eq!((certificate.compute.verdict, certificate.verdict()), (Inconclusive, Inconclusive));
    let reasons = certificate.compute.reasons.join("; ");
    for finding in ["5.0 % of the scene's path of 60 s", "no sticking ticks", "no collisions", "820 in the scene's"] {
        assert!(reasons.contains(finding), "{finding}: {reasons}");
    }
    assert_eq!(certificate.coverage.path_share, 0.05);
    // One window covers the whole path without the contact that it has in lockstep; the other covers a part of it with all
    // contact.
    assert_eq!(judge(&never_touched, [5000, 1000, 1000]).compute.verdict, Inconclusive);
    assert_eq!(judge(&quiet_loop(), [5000, 1000, 999]).compute.verdict, Inconclusive);

    let cut_short = judge(&Served { stopped: true, ..quiet_loop() }, [60_000, 1000, 1000]);
    assert_eq!([cut_short.compute.verdict, cut_short.platform.verdict], [Inconclusive; 2]);
    assert!(cut_short.compute.reasons.concat().contains("stopped after 5000 of 60000 ticks"), "{cut_short:?}");
}

#[test]
fn the_global_side_is_judged_by_its_cycles_the_ages_of_models_and_lost_notes() {
    use Verdict::{Fail, Inconclusive, Pass};
    let with = |global: GlobalTimes, lost_notes| {
        let window = Window { allocations: Some(0), lost_notes, ..Window::default() };
        let quiet_loop = served((0..5000).map(quiet), DEADLINE_NS, "SCHED_FIFO");
        let certificate = judged(&Served { global: Some(global), window, ..quiet_loop }, vec![worst(9_000)], true);
        let whole = certificate.verdict();
        let part = certificate.global.expect("there are cycles");
        assert_eq!(part.verdict, whole, "the servo side passes");
        (whole, part.reasons.join("; "))
    };
    assert_eq!(with(global(50), 0).0, Pass);
    assert_eq!(with(global(9), 0).0, Inconclusive);
    let (verdict, reasons) = with(global(50), 1873);
    assert_eq!(verdict, Fail);
    assert!(reasons.contains("1873 notes were lost"), "{reasons}");

    let mut late = global(50);
    late.record(100_000_001, 30_000_000, 1);
    let (verdict, reasons) = with(late, 0);
    assert_eq!(verdict, Fail);
    assert!(reasons.contains("1 of 51 models") && reasons.contains("the machine is the cause"), "{reasons}");
    let mut slow = global(50);
    slow.record(120_000_000, 110_000_000, 1);
    assert!(with(slow, 0).1.contains("the computation is too long"));

    // A model of every boundary, in use up to the 199th tick after it; and one that had to last for longer.
    let arrivals = |second| RecordedTimes {
        arrivals: vec![Arrival { from: 100, at: 200 }, Arrival { from: 200, at: second }],
        ..RecordedTimes::default()
    };
    let aged = |second| {
        let mut global = global(50);
        global.record_ages(&arrivals(second), second + 50);
        with(global, 0)
    };
    assert_eq!(aged(300).0, Pass);
    let (verdict, reasons) = aged(301);
    assert_eq!(verdict, Fail);
    assert!(reasons.contains("200 ticks old") && reasons.contains("at most 199"), "{reasons}");
}

#[test]
fn page_faults_count_against_locked_memory() {
    let with = |page_faults, memory_locked| {
        let quiet_loop = served((0..5000).map(quiet), DEADLINE_NS, "SCHED_FIFO");
        let window = Window { allocations: Some(0), page_faults, ..Window::default() };
        let obtained = Obtained { memory_locked, ..quiet_loop.obtained.clone() };
        judged(&Served { window, obtained, ..quiet_loop }, vec![worst(9_000)], true).platform.verdict
    };
    assert_eq!([with(0, true), with(1, true)], [Verdict::Pass, Verdict::Fail]);
    assert_eq!([with(0, false), with(1, false)], [Verdict::Inconclusive; 2]);
}

#[test]
fn misses_are_counted_exactly_and_explained_one_by_one() {
    let ticks = |tick: u64| match tick {
        // This tick is released late, and the next one follows from it.
        100 => [1_800_000, 1_805_000, 5_000],
        101 => [1_200_000, 1_205_000, 5_000],
        // This tick is off the CPU in the middle.
        2000 => [20_000, 2_000_000, 6_000],
        _ => quiet(tick),
    };
    let certificate = judged(&served((0..5000).map(ticks), DEADLINE_NS, "SCHED_FIFO"), vec![worst(9_000)], true);
    let platform = &certificate.platform;
    assert_eq!((platform.misses, platform.longest_miss_run, platform.skipped), (3, 2, 0));
    assert_eq!(platform.response_ns.max, 2_000_000);
    let causes: Vec<(u64, MissCause)> = certificate.misses.iter().map(|miss| (miss.times.tick, miss.cause)).collect();
    assert_eq!(causes[..2], [(100, MissCause::Release), (101, MissCause::Release)]);
    // Whether something else took the CPU is read from the counters of this very thread.
    assert!(matches!(causes[2..], [(2000, MissCause::Unknown | MissCause::Preempted)]), "{causes:?}");
    let bound = certificate.miss_rate.ticks.as_ref().expect("there are ticks");
    assert!(bound.estimate < bound.upper && bound.upper < 0.01);
    // Quantiles have three digits.
    let q = platform.response_ns;
    let p999 = q.p999.expect("5000 ticks are enough");
    assert!(q.p50.abs_diff(25_005) <= 25 && q.p50 <= q.p90 && q.p90 <= q.p99 && q.p99 <= p999 && p999 <= q.max);
    assert_eq!(q.p9999, None, "and too few for this one");
}

/// Misses in 7 runs of blocks, 44 of 80 blocks with one, are judged dependent, and those of a generator independent.
#[test]
fn misses_that_cluster_are_called_dependent() {
    let rate = |misses: &dyn Fn(u64) -> bool| {
        let ticks: Vec<[u64; 3]> =
            (0..4000).map(|t| if misses(t) { [1_200_000, 1_205_000, 5_000] } else { quiet(t) }).collect();
        judged(&served(ticks.iter().copied(), DEADLINE_NS, "SCHED_FIFO"), vec![worst(9_000)], true).miss_rate
    };
    let hash =
        |tick: u64| (tick.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (tick << 13)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 33;
    // Blocks of 50 ticks: a tenth of the ticks of the blocks 0–11, 20–29 and 58–79 miss.
    let clustered = rate(&|tick| matches!(tick / 50, 0..12 | 20..30 | 58..80) && hash(tick) % 10 < 2);
    assert_eq!(clustered.block_ticks, 50);
    assert_eq!(clustered.independent, Some(false));
    let tests = clustered.independence;
    assert!(tests.blocks.is_some_and(|test| !test.independent && test.p_value < 1e-9), "{tests:?}");
    assert!(tests.ticks.is_some_and(|test| !test.independent), "{tests:?}");
    assert!(tests.responses.is_some_and(|test| !test.independent), "{tests:?}");

    let spread = rate(&|tick| hash(tick) % 100 < 2);
    assert_eq!(spread.independent, Some(true), "{:?}", spread.independence);
    // Without a miss there is nothing that could cluster.
    let none = rate(&|_| false);
    assert!(none.independence.ticks.is_none() && none.independence.blocks.is_none());
    assert!(none.untested.iter().any(|reason| reason.contains("0 events among 4000")), "{:?}", none.untested);
}

fn path(recording: Option<PathRecording>) -> ChannelSettings {
    ChannelSettings { tick_s: 1e-3, ticks_per_cycle: 10, pass_ticks: 1200, recording, rendered_nodes: 0 }
}

#[test]
fn a_ring_that_is_full_counts_what_it_loses_and_waits_for_nobody() {
    let simulation = Simulation::prepare(&scene("")).expect("it starts");
    let settings = path(simulation.recording());
    let mut servo = simulation.into_sides().servo;
    let nodes = servo.local().model().patch.nodes.clone();
    let (mut up, mut down, _) = channel(settings, &nodes);
    up.begin_pass(0, &servo);
    for _ in 0..1100 {
        servo.tick(DeadlineOutcome::OnTime).expect("no fault");
        up.end_tick(&servo);
    }
    assert!(up.lost() > 0);
    // The notes that fitted come out in order, cycle by cycle.
    let boundaries: Vec<u64> = std::iter::from_fn(|| down.next_cycle()).map(|cycle| cycle.boundary).collect();
    assert!(boundaries.len() >= 50, "{boundaries:?}");
    assert!((1..).zip(&boundaries).all(|(n, &boundary)| boundary == 10 * n), "{boundaries:?}");
}

/// A global side that builds no model for the whole run, 12 cycles, loses nothing of the path, which waits outside the
/// ring.
#[test]
fn a_global_side_that_is_cycles_late_loses_nothing() {
    let simulation = Simulation::prepare(&scene("")).expect("it starts");
    let settings = ChannelSettings { ticks_per_cycle: 100, ..path(simulation.recording()) };
    let Sides { mut servo, mut global } = simulation.clone().into_sides();
    let nodes = servo.local().model().patch.nodes.clone();
    let (mut up, mut down, mut sender) = channel(settings, &nodes);
    up.begin_pass(0, &servo);
    let mut cycles = Vec::new();
    for tick in 0..1200 {
        if tick > 0 && tick % 100 == 0 {
            up.begin_segment(&servo);
        }
        servo.tick(DeadlineOutcome::OnTime).expect("no fault");
        up.end_tick(&servo);
        cycles.extend(down.next_cycle());
    }
    assert_eq!((cycles.len(), up.lost()), (12, 0));
    // The whole path brings the global side to where the servo side is.
    let boundary = cycles.last().expect("a cycle").boundary;
    let model = global.next_model(cycles.into_iter().map(|cycle| cycle.message), &mut |_| ());
    let state = global.simulation().state();
    let local = servo.local();
    let patch = &local.model().patch.nodes;
    assert!(patch.iter().zip(&local.state().x).all(|(&node, x)| state.x[node as usize] == *x));
    sender.send(0, boundary, model);
    assert_eq!(up.take_model(&mut servo), Ok(Some(1200)));
}

/// A pass is requested only when the one before it has begun, so memory does not grow with the number of passes.
#[test]
fn passes_are_prepared_one_ahead() {
    let _turn = TURN.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    const TICKS: u64 = 50;
    let scene = scene("");
    let simulation = Simulation::prepare(&scene).expect("it starts");
    let settings = loop_settings(&scene, &simulation, false);
    let asked_ns = Mutex::new(Vec::new());
    let passes = (0..4).map(|_| {
        asked_ns.lock().expect("no panic").push(os::now_ns());
        Pass::new(Simulation::prepare(&scene).expect("it starts"), TICKS, false)
    });
    let warm_up = simulation.into_sides().servo;
    let served = serve(passes, 4 * TICKS, warm_up, settings, &AtomicBool::new(false)).expect("there are passes");
    let numbers: Vec<(u32, u64)> = served.passes.iter().map(|pass| (pass.pass, pass.ticks)).collect();
    assert_eq!(numbers, [0, 1, 2, 3].map(|pass| (pass, TICKS)));
    assert_eq!(served.window.allocations, Some(0), "passes are exchanged without");
    let asked_ns = asked_ns.into_inner().expect("no panic");
    for pass in 2..4 {
        // The pass before it begins after the last tick of the one before that, at its release at the earliest.
        let begins_ns = served.window.begin_ns + ((pass - 1) * TICKS - 1) * 1_000_000;
        assert!(asked_ns[pass as usize] >= begins_ns, "pass {pass}");
    }
    let first = |pass: &RecordedPass| again_of(&scene, pass);
    assert!(served.passes.iter().all(|pass| first(pass) == ReplayOutcome::Same { fault: None }));
}

fn again_of(scene: &Scene, pass: &RecordedPass) -> ReplayOutcome {
    let session = Session::new(scene, OverrunPolicy::Hold);
    replay(session.prepare(scene, pass).expect("it starts"), pass, |_| ())
}

/// While a tick is skipped, the tip moves on into the body, and contact has not been computed there yet.
#[test]
fn a_skipped_tick_does_not_tunnel() {
    let text = Scene::shipped("fig5-stick-slip").expect("shipped").text().expect("it was read").to_owned();
    let text = format!("{text}\n[timing]\ntick_cost = 0.0025\noverrun = \"skip\"\n");
    let scene = Scene::parse(&text, "skip.toml".as_ref()).expect("a scene").with_ticks(200);
    let mut recorder = Recorder::default();
    let mut unseen = 0;
    stickslip::run(&scene, |view| {
        recorder.record(view);
        let is_inside = view.local.shape().signed_distance(view.tip) < -1e-9;
        let is_skipped = view.deadline_outcome == DeadlineOutcome::Skipped;
        unseen +=
            u32::from(is_skipped && is_inside && view.report.mode == Mode::Free && view.local.contact().is_none());
    })
    .expect("no fault");
    let summary = recorder.summary(&scene, None, 0.0);
    assert!(unseen > 0, "the tip goes in while no tick is computed");
    assert_eq!(summary.tunnelling_ticks, 0);
    assert!(summary.completed);
}

#[test]
fn a_summary_says_that_its_trace_did_not_happen() {
    let scene = scene("").with_ticks(20);
    let mut recorder = Recorder::default();
    stickslip::run(&scene, |view| recorder.record(view)).expect("no fault");
    let summary = recorder.summary(&scene, None, 0.0);
    let with = |is_reproduced, is_stopped| {
        let mut summary = summary.clone();
        summary.add_real_time(is_reproduced, is_stopped);
        let json = serde_json::to_value(&summary).expect("it can be written");
        (summary.verdict.because == "not reproduced", json["completed"].clone(), json["reproduced"].clone())
    };
    assert_eq!(with(true, false), (false, true.into(), true.into()));
    assert_eq!(with(false, false), (true, false.into(), false.into()));
    assert_eq!(with(true, true), (false, false.into(), true.into()));
    assert!(serde_json::to_value(&summary).expect("it can be written").get("reproduced").is_none());
}
