//! `stickslip certify`: a certificate of the servo loop's deadlines on this machine.

mod log;
mod page;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use maud::Markup;
use miette::Diagnostic;

use super::junit::{JunitArguments, JunitCase, JunitSuite};
use super::progress::Progress;
use super::renderer::RendererArguments;
use super::terminal::{complain, hand_out, say, significant};
use super::tick_timing::{TimedTick, time_ticks};
use super::{Changes, exit_code, folder, interrupt, load};
use crate::multirate::global::Moment;
use crate::multirate::timeline::OverrunPolicy;
use crate::output::files::{write_file, write_json};
use crate::pipeline::Simulation;
use crate::realtime::exercise::Exercise;
use crate::realtime::load::Load;
use crate::realtime::machine::{Machine, stolen};
use crate::realtime::meter::{TickTimes, Times};
use crate::realtime::os;
use crate::realtime::record::{Quantiles, loop_settings};
use crate::realtime::threads::{Pass, Served, Window, serve};
use crate::scene::{Scene, SceneError};
use crate::session::{ReplayOutcome, ReplayReason, Session, TickToReplay, replay_timed};
use crate::verify::certificate::causes::StealSample;
use crate::verify::certificate::identity::Identity;
use crate::verify::certificate::parts::Verdict;
use crate::verify::certificate::verdict::{Certificate, Circumstances, WorstTick};
use crate::verify::lateness::consequences;

/// Interval between two readings of the time taken by the hypervisor.
const WATCH: Duration = Duration::from_millis(20);
/// Largest number of passes in a window: for every finished pass, the arrival times of its models are kept.
const MOST_PASSES: u64 = 10_000;

#[derive(Debug, Args)]
pub struct CertifyArguments {
    /// A scene file or the name of a shipped scene; not with --times
    #[arg(required_unless_present = "times")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    changes: Changes,
    /// Judge the log of another servo loop instead: a CSV file with the header release_ns,start_ns,end_ns
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "changes", "deadline", "duration", "load", "policy", "renderer"])]
    times: Option<PathBuf>,
    /// Rate of the servo loop (default: the scene's; with --times, that of the log's releases)
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Deadline of a command after its tick's release (default: the scene's, or else one tick)
    #[arg(long, value_name = "US")]
    deadline: Option<f64>,
    /// Duration of the measurement; the scene's path is repeated
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    duration: f64,
    /// Load on the machine during the measurement
    #[arg(long, value_enum, default_value_t = LoadName::None)]
    load: LoadName,
    /// Policy for a missed deadline (default: the scene's, or else hold)
    #[arg(long, value_parser = policy_parser())]
    policy: Option<OverrunPolicy>,
    /// Output folder (default: reports/SCENE; with --times, reports/ and the file's name)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    renderer: RendererArguments,
    #[command(flatten)]
    junit: JunitArguments,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum LoadName {
    None,
    Cpu,
    Memory,
}

pub fn certify(arguments: &CertifyArguments) -> miette::Result<u8> {
    if let Some(times) = &arguments.times {
        return log::certify(times, arguments.rate, arguments.out.as_deref(), &arguments.junit);
    }
    let scene = asked_for(arguments)?;
    arguments.junit.prepare()?;
    let folder = folder(arguments.out.clone(), &scene, &["certificate.json", "certificate.md", "session.json"])?;
    let out = folder.path();
    let (certificate, _) = measure(&scene, arguments.duration, arguments.load, out)?;
    arguments.junit.write(|| verdicts(&certificate))?;
    hand_out(&certificate)?;
    say(page::words(&certificate))?;
    say(format_args!("certificate: {}", out.join("certificate.md").display()))?;
    Ok(exit_code(certificate.verdict()))
}

/// Returns the verdicts on the parts of a certificate.
fn verdicts(certificate: &Certificate) -> JunitSuite {
    let Certificate { compute, platform, global, .. } = certificate;
    let global = global.as_ref().map(|part| ("global side", part.verdict, &part.reasons));
    let parts = [("compute", compute.verdict, &compute.reasons), ("platform", platform.verdict, &platform.reasons)];
    let case = |(name, verdict, reasons): (&str, Verdict, &Vec<String>)| JunitCase {
        name: name.to_owned(),
        class: format!("stickslip.certify.{}", certificate.scene),
        // All parts are judged by one window.
        seconds: Some(certificate.duration_s),
        verdict,
        reasons: reasons.clone(),
    };
    JunitSuite { name: "stickslip certify", cases: parts.into_iter().chain(global).map(case).collect() }
}

/// Builds the report's section on a scene's servo loop, measured for `duration_s` without load.
pub fn brief(scene: &Scene, duration_s: f64, out: &Path) -> miette::Result<(Certificate, Markup)> {
    let (certificate, figures) = measure(scene, duration_s, LoadName::None, out)?;
    let section = page::section(&certificate, &figures);
    Ok((certificate, section))
}

/// Parses a policy by its name in scenes.
fn policy_parser() -> impl TypedValueParser<Value = OverrunPolicy> {
    PossibleValuesParser::new(OverrunPolicy::NAMES).try_map(|word| {
        let found = OverrunPolicy::ALL.into_iter().find(|policy| policy.name() == word);
        found.ok_or("unknown policy")
    })
}

/// Returns the scene with the changes of the command line.
fn asked_for(arguments: &CertifyArguments) -> miette::Result<Scene> {
    // Without --times the command line requires a scene.
    let path = arguments.scene.as_ref().ok_or_else(|| miette::miette!("give a scene, or a log with --times"))?;
    // The servo thread itself is certified, so the renderer runs in this process.
    let mut scene = load(path, &arguments.changes, &arguments.renderer)?.with_renderer_in_process();
    if let Some(rate) = arguments.rate {
        let asked = scene.with_local_rate_hz(rate).and_then(|scene| {
            scene.check_real_time()?;
            scene.check()?;
            Ok(scene)
        });
        scene = asked.map_err(|error| {
            let help = error.help().map_or(String::new(), |help| help.to_string());
            miette::miette!(help = help, "--rate {rate}: {error}")
        })?;
    }
    scene.check_real_time()?;
    if let Some(us) = arguments.deadline {
        let after = us * 1e-6;
        if !(after > 0.0 && after <= scene.tick_s()) {
            return Err(miette::miette!(
                help = "give a deadline above 0 and at most one tick",
                "a deadline of {us} µs is not possible with ticks of {} µs",
                significant(scene.tick_s() * 1e6)
            ));
        }
        scene.deadline.after = after;
    }
    if let Some(overrun) = arguments.policy {
        scene.deadline.overrun = overrun;
    }
    if !(arguments.duration > 0.0 && arguments.duration <= MOST_PASSES as f64 * scene.duration_s()) {
        return Err(miette::miette!(
            help = format!(
                "give a duration above 0 and at most {MOST_PASSES} times the scene's {} s",
                significant(scene.duration_s())
            ),
            "a duration of {} s is not possible",
            arguments.duration
        ));
    }
    Ok(scene)
}

/// File names and SVG documents of the figures.
type Figures = Vec<(&'static str, String)>;

/// Measures a scene's loop, repeats its longest ticks, reaches the verdicts, and writes all files into a folder.
fn measure(scene: &Scene, duration_s: f64, load: LoadName, out: &Path) -> miette::Result<(Certificate, Figures)> {
    let stop = interrupt::flag();
    let ticks = (duration_s / scene.tick_s()).round().max(1.0) as u64;
    let warm_up = Simulation::prepare(scene)?;
    // The warm-up has prepared this scene already. If a later preparation fails, for example for lack of memory, the
    // window ends.
    let passes = pass_lengths(ticks, scene.tick_count()).map_while(|ticks| match Simulation::prepare(scene) {
        Ok(simulation) => Some(Pass::new(simulation, ticks, false)),
        Err(error) => {
            complain(format_args!("Warning: the window ends early, as a pass cannot be prepared: {error}"));
            None
        }
    });
    let settings = loop_settings(scene, &warm_up, true);
    let cpus = os::affinity();
    let (kind, words) = match load {
        LoadName::None => (Load::None, "none".to_owned()),
        LoadName::Cpu => (Load::Cpu, format!("cpu: {} computing threads", cpus.len())),
        LoadName::Memory => (Load::Memory, format!("memory: {} threads writing through 64 MiB each", cpus.len())),
    };
    let mut progress = Progress::new(ticks, "ticks");
    progress.begin(&scene.name);
    let load = kind.start(cpus.len());
    let (served, steal) =
        watched(duration_s, &mut progress, ticks, || serve(passes, ticks, warm_up.into_sides().servo, settings, stop));
    drop(load);
    drop(progress);
    let mut served = served?;

    let longest_pass_ticks = served.passes.iter().map(|pass| pass.ticks).max().unwrap_or_default();
    let session = session(scene, &mut served);
    let (replayed, idle) = replays(&session, scene)?;
    let worst = worst(&served, time_ticks(&session, scene)?);
    let consequences = consequences(scene).map_err(|error| miette::miette!("{error}"))?;
    let (lockstep, _) = Exercise::of_lockstep(Simulation::prepare(scene)?);
    let machine = Machine::describe(served.obtained.cpus.first().copied().unwrap_or_default());
    let certificate = Certificate::new(
        &served,
        Circumstances {
            identity: Identity::now(scene, &machine),
            scene: scene.name.clone(),
            rate_hz: scene.local_rate_hz(),
            overrun: scene.deadline.overrun,
            load: words,
            steal,
            machine,
            replayed,
            worst,
            consequences,
            idle,
            asked_ticks: ticks,
            path_ticks: scene.tick_count(),
            longest_pass_ticks,
            lockstep,
        },
    );
    write_json(&out.join("session.json"), &session)?;
    write_json(&out.join("certificate.json"), &certificate)?;
    let figures = {
        let Window { begin_ns, end_ns, .. } = served.window;
        page::figures(&served.meter, end_ns.saturating_sub(begin_ns) as f64 * 1e-9)?
    };
    for (name, svg) in &figures {
        write_file(&out.join(name), svg.as_bytes())?;
    }
    write_file(&out.join("certificate.md"), page::markdown(&certificate).as_bytes())?;
    Ok((certificate, figures))
}

/// Returns the length of each pass, in ticks: whole paths, and a last pass with the remainder of `ticks`.
fn pass_lengths(ticks: u64, path_ticks: u64) -> impl Iterator<Item = u64> {
    (0..ticks.div_ceil(path_ticks)).map(move |pass| (ticks - pass * path_ticks).min(path_ticks))
}

/// Runs `work` while this thread samples the time taken by the hypervisor and shows the expected progress.
fn watched<T: Send>(
    duration_s: f64,
    progress: &mut Progress,
    ticks: u64,
    work: impl FnOnce() -> T + Send,
) -> (T, Vec<StealSample>) {
    let looks = (duration_s / WATCH.as_secs_f64()) as usize + 1000;
    let mut samples = Vec::with_capacity(looks);
    let look = || stolen().map(|stolen_ticks| StealSample { at_ns: os::now_ns(), stolen_ticks });
    let start = os::now_ns();
    let done = std::thread::scope(|scope| {
        let work = scope.spawn(work);
        while !work.is_finished() {
            samples.extend(look());
            let share = (os::now_ns() - start) as f64 * 1e-9 / duration_s;
            progress.set((share.min(1.0) * ticks as f64) as u64);
            std::thread::sleep(WATCH);
        }
        work.join()
    });
    samples.extend(look());
    match done {
        Ok(done) => (done, samples),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// Builds the session that repeats the longest ticks: their passes, and the first one.
fn session(scene: &Scene, served: &mut Served) -> Session {
    let mut session = Session::new(scene, scene.deadline.overrun);
    let kinds = [
        (served.meter.worst_by_response(), ReplayReason::LongestResponse),
        (served.meter.worst_by_cpu(), ReplayReason::MostCpuTime),
    ];
    for (ticks, why) in kinds {
        for TickTimes { pass, tick, .. } in ticks {
            session.worst.push(TickToReplay { pass: *pass, tick: *tick, why });
        }
    }
    let mut passes = std::mem::take(&mut served.passes);
    let is_marked = |number| session.worst.iter().any(|tick| tick.pass == number);
    passes.retain(|pass| pass.ticks > 0 && (pass.pass == 0 || is_marked(pass.pass)));
    session.passes = passes;
    session
}

/// Returns whether every recorded pass replays to the same forces, and the quantiles of the tick times of the first pass,
/// ns.
fn replays(session: &Session, scene: &Scene) -> Result<(bool, Quantiles), SceneError> {
    let (mut same, mut idle) = (true, Times::new());
    for (number, pass) in session.passes.iter().enumerate() {
        let mut begin = Instant::now();
        let clock = |moment| match moment {
            Moment::TickBegins => begin = Instant::now(),
            Moment::TickEnds if number == 0 => idle.record(begin.elapsed().as_nanos() as u64),
            _ => {}
        };
        let outcome = replay_timed(session.prepare(scene, pass)?, pass, clock, |_| ());
        same &= matches!(outcome, ReplayOutcome::Same { .. });
    }
    Ok((same, Quantiles::of(&idle)))
}

/// Joins the times of repeated ticks with those of the measurement.
fn worst(served: &Served, timed: Vec<TimedTick>) -> Vec<WorstTick> {
    let measured = || served.meter.worst_by_response().iter().chain(served.meter.worst_by_cpu());
    let entry = |TimedTick { pass, tick, why, warm_ns, cold_ns }| {
        let is_measured =
            why.iter().any(|why| matches!(why, ReplayReason::LongestResponse | ReplayReason::MostCpuTime));
        let times = measured().find(|times| is_measured && (times.pass, times.tick) == (pass, tick)).copied();
        WorstTick { pass, tick, why, times, warm_ns, cold_ns }
    };
    timed.into_iter().map(entry).collect()
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Alone {
        #[command(flatten)]
        arguments: CertifyArguments,
    }

    #[test]
    fn passes_add_up_to_the_window() {
        let lengths = |ticks, path| pass_lengths(ticks, path).collect::<Vec<_>>();
        assert_eq!(lengths(3000, 1200), [1200, 1200, 600]);
        assert_eq!(lengths(2400, 1200), [1200, 1200]);
        assert_eq!(lengths(5, 1200), [5]);
    }

    #[test]
    fn every_scene_that_can_be_asked_for_passes_its_check() {
        for policy in OverrunPolicy::NAMES {
            for rate in ["1000", "4000"] {
                let asked = ["certify", "fig5-stick-slip", "--rate", rate, "--deadline", "200", "--policy", policy];
                let scene = asked_for(&Alone::parse_from(asked).arguments).expect("a scene");
                assert!(scene.check().is_ok(), "{rate} Hz, {policy}: {:?}", scene.check());
            }
        }
    }
}
