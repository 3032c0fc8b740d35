//! The servo thread, which keeps to the clock, beside the global thread, which builds its models.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use miette::Diagnostic;
use serde::Serialize;
use thiserror::Error;

use super::allocations;
use super::builder::{GlobalTimes, build_models, take_in};
use super::channel::{ChannelSettings, ServoEnd, channel};
use super::exercise::Exercise;
use super::meter::{Meter, TickTimes};
use super::os::{self, Usage};
use super::power::{CpuSettings, frequency_khz, hold_dma_latency};
use super::supply::{Next, Over, Upcoming, send_side, supply};
use crate::Vec3;
use crate::contact::report::TickReport;
use crate::multirate::failsafe::Fault;
use crate::multirate::global::GlobalSide;
use crate::multirate::servo::{Servo, ServoTick};
use crate::multirate::timeline::{Arrival, Deadline, DeadlineOutcome, OverrunPolicy, RecordedTimes};
use crate::multirate::trajectory::PathRecording;
use crate::pipeline::{Sides, Simulation};
use crate::session::{Checksum, RecordedPass, RecordedTick};

/// `SCHED_FIFO` priority of the servo thread: above ordinary interrupt threads, below the watchdogs.
const PRIORITY: i32 = 80;
/// `SCHED_FIFO` priority of the thread that empties the servo thread's ring.
const INTAKE_PRIORITY: i32 = 70;
/// Time from the start of the servo thread to its first release, s.
const LEAD_S: f64 = 0.02;
/// Size of the stack that is touched before the window, bytes.
const STACK: usize = 256 << 10;
/// Number of ticks of a discarded copy that load code and branch predictors before the window.
const WARM_UP_TICKS: u64 = 200;

/// A run along a scene's path, from a state that is prepared before the loop begins.
#[derive(Debug)]
pub struct Pass {
    servo: Servo,
    global: Option<GlobalSide>,
    ticks: u64,
    /// Arrival times of models, and late and skipped ticks.
    pub times: RecordedTimes,
    /// Tip and force of every tick, if they are recorded.
    pub tape: Vec<RecordedTick>,
    tapes: bool,
    /// Checksum of all commanded forces, in order.
    pub checksum: Checksum,
    /// What the pass exercised.
    pub exercise: Exercise,
    /// The fault that ended the pass, if one did.
    pub fault: Option<Fault>,
}

impl Pass {
    /// Prepares a pass of `ticks` ticks; with `tapes`, tip and force of every tick are recorded.
    pub fn new(simulation: Simulation, ticks: u64, tapes: bool) -> Self {
        let has_global = simulation.recording().is_some();
        let Sides { servo, global } = simulation.into_sides();
        let (arrival, tick) = (Arrival { from: 1, at: 1 }, RecordedTick::new(Vec3::x(), Vec3::x()));
        Self {
            servo,
            global: has_global.then_some(global),
            ticks,
            times: RecordedTimes {
                arrivals: touched(arrival, ticks),
                late: touched(1, ticks),
                skipped: touched(1, ticks),
            },
            tape: touched(tick, if tapes { ticks } else { 0 }),
            tapes,
            checksum: Checksum::default(),
            exercise: Exercise::default(),
            fault: None,
        }
    }

    /// Converts a pass that is over to its recording.
    pub fn into_recorded(mut self, number: u32) -> RecordedPass {
        let RecordedTimes { arrivals, late, skipped } = &mut self.times;
        arrivals.shrink_to_fit();
        late.shrink_to_fit();
        skipped.shrink_to_fit();
        RecordedPass {
            pass: number,
            ticks: self.servo.next_tick(),
            fault: self.fault.map(|fault| fault.to_string()),
            times: self.times,
            checksum: self.checksum.text(),
            tape: self.tape,
        }
    }

    /// Returns the number of ticks that the pass has if nothing ends it earlier.
    pub(super) fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Returns the number of nodes that a custom renderer may move; 0 without one.
    fn rendered_nodes(&self) -> usize {
        let global = self.global.as_ref().filter(|_| self.servo.local().is_rendered_by_another());
        global.map_or(0, |global| global.simulation().state().x.len())
    }

    /// Takes the global side out, for the thread that it runs on; `None` without cycles.
    pub(super) fn take_global(&mut self) -> Option<GlobalSide> {
        self.global.take()
    }

    fn end_tick(&mut self, done: &ServoTick) {
        match done.deadline_outcome {
            DeadlineOutcome::OnTime => {}
            DeadlineOutcome::Late(_) => self.times.late.push(done.tick),
            DeadlineOutcome::Skipped => self.times.skipped.push(done.tick),
        }
        if done.deadline_outcome != DeadlineOutcome::Skipped {
            self.exercise.record(&done.report, done.tick > 0 && done.model_age == 0);
        }
        self.checksum.add(done.force);
        if self.tapes {
            self.tape.push(RecordedTick::new(done.tip, done.force));
        }
    }
}

/// Returns an empty list whose memory for this many values is already mapped, since the first write to new memory is a
/// page fault. `filling` must not be zero: the system hands out zeros without memory behind them.
fn touched<T: Clone>(filling: T, length: u64) -> Vec<T> {
    let mut list = vec![filling; length as usize];
    list.clear();
    list
}

/// Settings of a real-time loop.
#[derive(Debug, Clone, Copy)]
pub struct LoopSettings {
    /// Local tick h, s.
    pub tick_s: f64,
    /// Number of ticks in a global cycle.
    pub ticks_per_cycle: u64,
    /// The part of the patch's path that is sent to the global side; `None` if there are no cycles.
    pub recording: Option<PathRecording>,
    /// Deadline of every tick.
    pub deadline: Deadline,
    /// Whether a control loop without a payload is released half a tick after each tick.
    pub control: bool,
}

/// Scheduling settings actually granted to the servo thread.
///
/// ```
/// use stickslip::realtime::threads::Obtained;
///
/// # let cpu = Default::default();
/// let mut obtained =
///     Obtained { policy: "SCHED_OTHER", priority: 0, cpus: vec![0, 1], memory_locked: false, cpu, refused: vec![] };
/// assert!(!obtained.is_realtime()); // any other program may take its CPU
/// (obtained.policy, obtained.priority) = ("SCHED_FIFO", 80);
/// assert!(obtained.is_realtime());
/// ```
#[derive(Debug, Clone, Serialize)]
pub struct Obtained {
    /// Scheduling policy.
    pub policy: &'static str,
    /// Scheduling priority.
    pub priority: i32,
    /// CPUs that the thread may run on.
    pub cpus: Vec<usize>,
    /// Whether all memory was locked.
    pub memory_locked: bool,
    /// Idle states, timers and frequency of the CPU.
    pub cpu: CpuSettings,
    /// Requests that were refused, with the reasons.
    pub refused: Vec<String>,
}

impl Obtained {
    /// Returns whether threads of ordinary priority cannot preempt the servo thread.
    pub fn is_realtime(&self) -> bool {
        self.policy == "SCHED_FIFO"
    }
}

/// The servo thread's own counters over the window.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Window {
    /// Number of allocator calls, freeing included; `None` without a counting allocator.
    pub allocations: Option<u64>,
    /// Number of page faults, minor and major.
    pub page_faults: u64,
    /// Number of voluntary context switches: one for every sleep.
    pub voluntary_switches: u64,
    /// Number of involuntary context switches.
    pub involuntary_switches: u64,
    /// Number of notes that did not fit into the ring.
    pub lost_notes: u64,
    /// Number of releases that passed between two passes because the second one was not prepared yet.
    pub idle_releases: u64,
    /// Time at which the window began, on `CLOCK_MONOTONIC`, ns.
    pub begin_ns: u64,
    /// Time at which the window ended, on `CLOCK_MONOTONIC`, ns.
    pub end_ns: u64,
}

/// The result of a real-time loop.
#[derive(Debug)]
pub struct Served {
    /// Recordings of all passes.
    pub passes: Vec<RecordedPass>,
    /// Time measurements of the servo side.
    pub meter: Meter,
    /// Time measurements of the global side; `None` without cycles.
    pub global: Option<GlobalTimes>,
    /// What all passes exercised.
    pub exercise: Exercise,
    /// Counters of the servo thread.
    pub window: Window,
    /// Scheduling settings actually granted.
    pub obtained: Obtained,
    /// Whether the loop was stopped before its end.
    pub stopped: bool,
    /// The fault that ended the loop, if one did.
    pub fault: Option<Fault>,
}

/// A reason why a loop has no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error, Diagnostic)]
pub enum NotServed {
    /// No pass was given.
    #[error("there is no pass to run in real time")]
    NoPass,
    /// A thread of the loop panicked.
    #[error("a thread of the loop panicked")]
    #[diagnostic(help("this is a defect of the program: please report it, with the scene"))]
    Panicked,
}

/// Runs passes over one scene after the other in real time, `ticks` ticks in all. A pass is taken from `passes` while the
/// one before it runs, on a thread of ordinary priority, so that memory does not grow with the number of passes. The servo
/// thread is pinned to the last of the CPUs that this thread may use; `stop` ends the loop at the next tick.
///
/// # Errors
/// If there is no pass, or a thread panicked.
///
/// ```
/// use std::sync::atomic::AtomicBool;
/// use stickslip::realtime::record::loop_settings;
/// use stickslip::realtime::threads::{Pass, serve};
/// use stickslip::{pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let settings = loop_settings(&scene, &simulation, false);
/// let warm_up = simulation.into_sides().servo;
/// // Two passes of 20 ticks each, one after the other at the same period.
/// let passes = (0..2).map_while(|_| Some(Pass::new(Simulation::prepare(&scene).ok()?, 20, false)));
/// let served = serve(passes, 40, warm_up, settings, &AtomicBool::new(false)).expect("there are passes");
/// assert!(served.passes.iter().all(|pass| pass.ticks == 20) && served.passes.len() == 2);
/// assert_eq!(served.meter.ticks() + served.meter.skipped(), 40);
/// assert!(served.window.end_ns - served.window.begin_ns > 38_000_000); // not faster than real time
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
pub fn serve(
    passes: impl IntoIterator<Item = Pass, IntoIter: Send>,
    ticks: u64,
    warm_up: Servo,
    settings: LoopSettings,
    stop: &AtomicBool,
) -> Result<Served, NotServed> {
    let mut passes = passes.into_iter();
    let mut first = passes.next().ok_or(NotServed::NoPass)?;
    let LoopSettings { tick_s, ticks_per_cycle, recording, deadline, .. } = settings;
    let mut refused = Vec::new();
    let mut meter = Meter::new(ticks, nanoseconds(deadline.after));
    let rendered_nodes = first.rendered_nodes();
    let path = ChannelSettings { tick_s, ticks_per_cycle, pass_ticks: first.ticks, recording, rendered_nodes };
    let (servo_end, intake, sender) = channel(path, &first.servo.local().model().patch.nodes);
    let global = GlobalTimes::new(ticks_per_cycle, nanoseconds(ticks_per_cycle as f64 * tick_s));
    let (to_global, from_all) = mpsc::channel();
    let from_ring = to_global.clone();
    send_side(0, &mut first, &to_global);
    let (upcoming, preparer) = supply();

    let memory_locked = match os::lock_memory() {
        Ok(()) => true,
        Err(error) => {
            refused.push(format!("mlockall: {error}"));
            false
        }
    };
    let cpus = os::affinity();
    let last = cpus.last().copied().unwrap_or_default();
    // Closed after the window, which ends its effect.
    let latency = hold_dma_latency();
    if let Err(error) = &latency {
        refused.push(format!("/dev/cpu_dma_latency: {error}"));
    }
    let mut cpu = CpuSettings { is_dma_latency_held: latency.is_ok(), ..CpuSettings::of(last) };
    let done = AtomicBool::new(false);
    let idle = Duration::from_secs_f64((tick_s / 4.0).clamp(2e-5, 1e-3));
    let served = std::thread::scope(|scope| {
        let done = &done;
        let builder = scope.spawn(move || build_models(&from_all, sender, done, global));
        let intake = scope.spawn(move || {
            // This thread only copies, and must not wait for ordinary threads. Where its priority is refused, the ring
            // covers half a second.
            let _ = os::request_fifo(INTAKE_PRIORITY);
            take_in(intake, &from_ring, idle, done);
        });
        let preparer = scope.spawn(move || preparer.run(passes, &to_global, idle, done));
        let servo = scope.spawn(|| {
            if let Err(error) = os::pin(&[last]) {
                refused.push(format!("sched_setaffinity: {error}"));
            }
            if let Err(error) = os::request_fifo(PRIORITY) {
                refused.push(format!("SCHED_FIFO: {error}"));
            }
            let (policy, priority) = os::policy();
            cpu.timer_slack_ns = os::least_timer_slack_ns();
            touch_stack();
            warm(warm_up);
            let (pass, window, stopped) = run_loop(first, upcoming, servo_end, &mut meter, settings, stop);
            cpu.frequency_khz[1] = frequency_khz(last);
            let obtained = Obtained { policy, priority, cpus: os::affinity(), memory_locked, cpu, refused };
            (pass, meter, window, obtained, stopped)
        });
        let served = servo.join();
        done.store(true, Ordering::Release);
        let (over, taken_in, built) = (preparer.join(), intake.join(), builder.join());
        taken_in.and_then(|()| Ok((served?, over?, built?))).map_err(|_| NotServed::Panicked)
    });
    os::unlock_memory();
    drop(latency);
    let ((pass, meter, window, obtained, stopped), mut over, mut global) = served?;
    let fault = pass.fault;
    over.add(pass);
    let Over { passes, mut exercise } = over;
    for pass in passes.iter().filter(|pass| pass.ticks > 0) {
        global.record_ages(&pass.times, pass.ticks);
    }
    exercise.models_built = global.models_built();
    let global = recording.is_some().then_some(global);
    Ok(Served { passes, meter, global, exercise, window, obtained, stopped, fault })
}

fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}

/// Touches the pages of the stack that the loop may use.
fn touch_stack() {
    let mut stack = [0_u8; STACK];
    std::hint::black_box(&mut stack);
}

/// Warms up code, caches and branch predictors by ticks whose results are discarded.
fn warm(mut servo: Servo) {
    for _ in 0..WARM_UP_TICKS {
        if servo.tick(DeadlineOutcome::OnTime).is_err() {
            break;
        }
    }
}

/// Runs the servo thread within its window. Returns the last pass, the counters, and whether the loop was stopped.
fn run_loop(
    mut pass: Pass,
    mut upcoming: Upcoming,
    mut end: ServoEnd,
    meter: &mut Meter,
    settings: LoopSettings,
    stop: &AtomicBool,
) -> (Pass, Window, bool) {
    let LoopSettings { tick_s, ticks_per_cycle, deadline, control, .. } = settings;
    let start = os::now_ns() + nanoseconds(LEAD_S);
    // Releases are counted over all passes: a new pass keeps the period.
    let mut released = 0_u64;
    let release_of = |released: u64| start + nanoseconds(released as f64 * tick_s);

    let usage = Usage::of_this_thread();
    let allocated = allocations::on_this_thread();
    meter.begin(usage);
    let (mut stopped, mut idle_releases) = (false, 0);
    let mut number = 0;
    'passes: loop {
        end.begin_pass(number, &pass.servo);
        while pass.servo.next_tick() < pass.ticks {
            if stop.load(Ordering::Relaxed) {
                stopped = true;
                break 'passes;
            }
            let release = release_of(released);
            let timed = timed_tick(&mut pass, &mut end, number, release, ticks_per_cycle);
            let TimedTick { tip, report, times, command } = match timed {
                Ok(timed) => timed,
                Err(fault) => {
                    pass.fault = Some(fault);
                    break 'passes;
                }
            };
            let on_time = meter.tick(times, release - start);
            let deadline_outcome =
                if on_time { DeadlineOutcome::OnTime } else { DeadlineOutcome::Late(deadline.overrun) };
            let done = pass.servo.conclude(tip, report, deadline_outcome);
            end.end_tick(&pass.servo);
            pass.end_tick(&done);
            released += 1;

            if !on_time && deadline.overrun == OverrunPolicy::Skip {
                while release_of(released) < command && pass.servo.next_tick() < pass.ticks {
                    if let Err(fault) = skip(&mut pass, &mut end, ticks_per_cycle) {
                        pass.fault = Some(fault);
                        break 'passes;
                    }
                    meter.skip(release_of(released) - start);
                    released += 1;
                }
            }
            if control {
                control_tick(meter, release_of(released - 1) + nanoseconds(tick_s / 2.0));
            }
        }
        loop {
            match upcoming.exchange(&mut pass) {
                Next::Pass => break,
                Next::End => break 'passes,
                Next::NotYet if stop.load(Ordering::Relaxed) => {
                    stopped = true;
                    break 'passes;
                }
                // The next pass begins at a release like any other.
                Next::NotYet => {
                    os::sleep_until_ns(release_of(released));
                    (released, idle_releases) = (released + 1, idle_releases + 1);
                }
            }
        }
        number += 1;
    }
    let end_ns = os::now_ns();
    meter.end(end_ns.saturating_sub(start));
    let counted = Usage::of_this_thread().since(usage);
    let window = Window {
        allocations: allocations::on_this_thread().zip(allocated).map(|(now, before)| now - before),
        page_faults: counted.page_faults,
        voluntary_switches: counted.voluntary_switches,
        involuntary_switches: counted.involuntary_switches,
        lost_notes: end.lost(),
        idle_releases,
        begin_ns: start,
        end_ns,
    };
    (pass, window, stopped)
}

/// A tick that has been computed and timed, before its command.
struct TimedTick {
    /// m.
    tip: Vec3,
    report: TickReport,
    times: TickTimes,
    /// Time at which the force was ready, ns.
    command: u64,
}

/// Computes the next tick of a pass at its scheduled release, ns, and times it.
fn timed_tick(
    pass: &mut Pass,
    end: &mut ServoEnd,
    number: u32,
    release: u64,
    ticks_per_cycle: u64,
) -> Result<TimedTick, Fault> {
    let tick = pass.servo.next_tick();
    // The modelled instrument is advanced while the loop waits: a real one needs no computation.
    let tip = pass.servo.sense()?;
    os::sleep_until_ns(release);
    let cpu = os::thread_cpu_ns();
    let begin = os::now_ns();
    arrive(pass, end, tick, ticks_per_cycle)?;
    let report = pass.servo.compute(tip)?;
    let command = os::now_ns();
    let times = TickTimes {
        pass: number,
        tick,
        release_ns: begin.saturating_sub(release),
        response_ns: command.saturating_sub(release),
        compute_ns: command - begin,
        cpu_ns: os::thread_cpu_ns() - cpu,
    };
    Ok(TimedTick { tip, report, times, command })
}

/// Runs the control loop without a payload, half a tick after the payload's release: what it misses, the machine misses.
fn control_tick(meter: &mut Meter, release: u64) {
    let is_ahead = os::now_ns() < release;
    meter.control(is_ahead.then(|| {
        os::sleep_until_ns(release);
        let begin = os::now_ns();
        (begin.saturating_sub(release), os::now_ns() - release)
    }));
}

/// Puts a model that has arrived to use, and begins a segment of the path with it or with a cycle.
fn arrive(pass: &mut Pass, end: &mut ServoEnd, tick: u64, ticks_per_cycle: u64) -> Result<(), Fault> {
    match end.take_model(&mut pass.servo) {
        Err((from, cause)) => {
            pass.times.arrivals.push(Arrival { from, at: tick });
            return Err(pass.servo.latch(cause));
        }
        Ok(Some(from)) => {
            pass.times.arrivals.push(Arrival { from, at: tick });
            end.begin_segment(&pass.servo);
        }
        Ok(None) if tick > 0 && tick.is_multiple_of(ticks_per_cycle) => end.begin_segment(&pass.servo),
        Ok(None) => {}
    }
    Ok(())
}

/// Skips a tick whose release passed while another was being computed.
fn skip(pass: &mut Pass, end: &mut ServoEnd, ticks_per_cycle: u64) -> Result<(), Fault> {
    if pass.servo.next_tick().is_multiple_of(ticks_per_cycle) {
        end.begin_segment(&pass.servo);
    }
    let done = pass.servo.skip()?;
    end.skip_tick(&pass.servo);
    pass.end_tick(&done);
    Ok(())
}
