//! The command line: arguments in, exit code out. Nothing below this module reads arguments,
//! prints, or ends the process.

mod accuracy;
#[cfg(all(feature = "realtime", target_os = "linux"))]
mod certify;
mod check;
mod conform;
mod diagnostic;
mod explain;
#[cfg(all(feature = "external", target_os = "linux"))]
mod external;
mod init;
mod interrupt;
mod judge;
mod junit;
mod list;
mod manual;
mod page;
mod progress;
mod renderer;
mod replay;
mod report;
mod run;
mod stability;
mod suite;
mod table;
mod terminal;
mod tick_timing;
mod time;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use miette::Report;

use self::renderer::RendererArguments;
use self::report::ReportArguments;
use self::terminal::{Asked, complain, say};
use crate::output::files::{RunFilesError, WriteError};
use crate::output::folder::ResultFolder;
use crate::output::verdict::Verdict;
use crate::scene::{Change, Expectation, SHIPPED, Scene, SceneError, Warning};
use crate::verify::accept::AcceptError;

/// No verdict is FAIL or INCONCLUSIVE, and no fault ended a run.
const PASS: u8 = 0;
/// A verdict is FAIL, a fault ended a run, or no local model is within the budget.
const FAIL: u8 = 1;
/// A verdict is INCONCLUSIVE, and none is FAIL.
const INCONCLUSIVE: u8 = 3;
/// The arguments, a scene or a file is invalid, or a file cannot be written.
const USAGE: u8 = 2;

#[derive(Debug, Parser)]
#[command(
    version,
    about = "Verification and benchmarking testbed for multi-rate haptic simulation with stick-slip contact",
    long_about = "Verification and benchmarking testbed for multi-rate haptic simulation with stick-slip contact.\n\n\
        A nonlinear mass-spring-damper network runs at about 10 Hz. Beside it, a low-order local model computes \
        collision, stick-slip contact and force feedback at 1 kHz. Without a command, `report` runs the \
        shipped scenes.",
    after_help = after_help(),
)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    asked: Asked,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run scenes and write one report for the browser
    #[command(
        after_help = "Writes DIR/index.html, which needs no other file and no network, DIR/report.json, and for every \
        scene the files of `run` in DIR/<scene>/. Without scenes it also compares contact surfaces and local models, \
        measures stability limits, and certifies the servo loop over a few seconds; --quick omits these.\n\n\
        Exit codes: 0 pass; 1 a verdict on scenes, accuracy or stability is FAIL; 2 usage, scene or file error; 3 none \
        of them is FAIL, and one on scenes or stability is INCONCLUSIVE. The verdicts on this machine (certificate) and on \
        an earlier run (cross-check) are shown and do not change the exit code.\n\n\
        Example: stickslip report fig5-stick-slip my-scene.toml"
    )]
    Report(report::ReportArguments),
    /// Run one scene: write its trace, network, summary and force plot
    #[command(after_help = "Writes trace.csv (a row per tick), network.json, summary.json and forces.svg; with --vtk \
        also network.pvd and instrument.pvd with their frames.\n\n\
        Exit codes: 0 the verdict is PASS; 1 it is FAIL: a fault ended the run (the rows before it are kept), the tip \
        passed through the surface, the energy residual exceeds the instrument's work, or the repetition of a run in real \
        time commanded other forces; 2 usage, scene or file error; 3 it is INCONCLUSIVE: the run was stopped, or the energy residual exceeds \
        half of the work.\n\nExample: stickslip run fig5-stick-slip --out /tmp/fig5")]
    Run(run::RunArguments),
    /// Print which parts a scene needs, what it costs, and its stability-limit time steps
    #[command(after_help = "Exit codes: 0 pass; 2 usage or scene error.\n\nExample: stickslip explain fig5-stick-slip")]
    Explain {
        /// A scene file or the name of a shipped scene
        scene: PathBuf,
        #[command(flatten)]
        changes: Changes,
        #[command(flatten)]
        renderer: RendererArguments,
    },
    /// Judge the stability of a scene along its path, and compare limits with predictions
    #[command(
        after_help = "Writes DIR/index.html with its figures inside and DIR/stability.json. The scene is run, and for every \
        local model along its path the stability-limit time step and the growth of the fastest-growing mode are computed. The \
        stability-limit time steps of the first local model are then measured, with stiffness, mass ratio and damping ratio \
        varied. Virtual walls and extreme scenes, which do not depend on the scene, are judged too.\n\n\
        Exit codes: 0 pass; 1 the scene ends in a fault, an extreme scene did not end as expected, or a virtual wall that must \
        be passive oscillates; 2 usage, scene or file error; 3 a local model along the path would diverge if it were kept, or a \
        limit differs from its prediction by more than 2 % for no known reason.\n\n\
        Example: stickslip stability fig5-stick-slip --out /tmp/stability"
    )]
    Stability {
        /// A scene file or the name of a shipped scene
        #[arg(default_value = "fig5-stick-slip")]
        scene: PathBuf,
        #[command(flatten)]
        changes: Changes,
        /// Output folder (default: reports/SCENE)
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        #[command(flatten)]
        renderer: RendererArguments,
    },
    /// Compare results with accepted baselines, quantity by quantity
    #[command(after_help = "Writes DIR/check.json with every quantity; the table shows those that fail or improved. \
        A missing baseline, a value that is not finite, and more work than before fail.\n\n\
        Exit codes: 0 pass; 1 the verdict is FAIL, or a result that is not finite is not accepted; 2 usage, scene or \
        file error.\n\nExamples:\n  stickslip check\n  \
        stickslip check --accept fig5-stick-slip --reason \"friction bound uses the new normal\"\n  \
        stickslip check fig5-stick-slip --time --against /tmp/before/stickslip")]
    Check(check::CheckArguments),
    /// Compare local models with the full network: force error against time per tick
    #[command(
        after_help = "Runs the scene's drag with a grid of local models and compares each with the full network \
        at the haptic rate. Writes DIR/index.html, DIR/accuracy.json and the full network's force at every tick with each \
        contact, DIR/reference-CONTACT.csv. Runs are timed one after the other: keep \
        the machine idle.\n\nExit codes: 0 pass; 1 no local model is within the budget; 2 usage, scene or file \
        error.\n\nExample: stickslip accuracy deep-stick-slip --budget-us 5 --out /tmp/accuracy"
    )]
    Accuracy(accuracy::AccuracyArguments),
    /// Judge another program's force trace along a scene's path
    #[command(
        after_help = "The trace has the columns t,fx,fy,fz: the time at the end of each tick, s, and the force on the \
        instrument, N. It is compared with the full network at the haptic rate, by the measures of `accuracy`. With a \
        column `mode` (free, stick, slide, slip) the contact modes are compared too, and with px,py,pz, a point of the \
        surface at rest, the contact points. What does not fit is named first: another rate, gaps, a lag, another unit or \
        sign. Writes DIR/judge.json.\n\n\
        Exit codes: 0 PASS: the force error is at most 10 % over the whole scene, which a hand cannot tell apart; 1 FAIL: \
        it is larger; 2 usage, scene or file error, a number that is not finite, or times that do not ascend; 3 \
        INCONCLUSIVE: the trace lacks more than a tick at either end of the scene, or gaps have more than 1 % of its ticks, \
        nothing was touched, or the reference ended in a fault.\n\n\
        Example: stickslip judge deep-stick-slip --trace mine.csv --scale 0.001 --out /tmp/judge"
    )]
    Judge(judge::JudgeArguments),
    /// Write the problem set as files, for programs that know nothing of this one
    #[command(
        after_help = "Writes DIR/README.md, which explains how to take part, DIR/example.py, DIR/suite.json, and a folder for each problem: \
        body.vtu, network.json, tip.csv (the tip at every tick), reference.csv (force, contact point and normal at every \
        tick, from the full network at the haptic rate), problem.toml (the same as a scene) and problem.json (rates, contact, \
        floor, tolerances and the SHA-256 of each file). A solution is compared by `stickslip judge`. It takes about a \
        minute.\n\n\
        Exit codes: 0 pass; 1 a reference ended in a fault; 2 usage or file error.\n\n\
        Example: stickslip suite --out problems\n  stickslip judge problems/tap/problem.toml --trace mine.csv"
    )]
    Suite(suite::SuiteArguments),
    /// Certify the deadlines of the servo loop on this machine
    #[cfg(all(feature = "realtime", target_os = "linux"))]
    #[command(
        after_help = "Runs the scene's servo loop in real time, on a thread of its own, and gives three verdicts: on the \
        program's own time per tick (compute), on whether commands met their deadlines on this machine (platform), and \
        on whether models were built in time (global side; absent without cycles). \
        A control loop without a payload runs between the ticks: deadlines that it misses too are the machine's. The \
        longest ticks are repeated with warm and with cold caches. Writes DIR/certificate.md, certificate.json, \
        session.json and two figures. With --times instead of a scene it judges the log of another servo loop, a CSV file \
        with the scheduled release, the start and the end of every tick in ns: the deadline is the period, and there is the \
        platform part alone. Ctrl-C ends the run and certifies what was measured.\n\nWithout the right to \
        SCHED_FIFO (root, or `ulimit -r`) the platform part cannot pass.\n\nExit codes: 0 all parts PASS; 1 one is \
        FAIL; 2 usage, scene or file error; 3 none is FAIL, and one is INCONCLUSIVE.\n\n\
        Examples:\n  stickslip certify fig5-stick-slip --duration 60 --load cpu --out /tmp/certificate\n  \
        stickslip certify --times loop.csv --rate 1000 --out /tmp/loop"
    )]
    Certify(certify::CertifyArguments),
    /// Check the properties that every haptic renderer has
    #[command(
        after_help = "Presses, drags, taps, strokes, lifts off and teleports the tip where the scene's path first touches \
        the body, and checks forces, energy and cost of the renderer: the scene's own local model, or with --renderer that \
        of a shared library. Nothing is compared with a reference. Writes DIR/conformance.json and DIR/index.html.\n\n\
        Exit codes: 0 all properties hold; 1 one does not; 2 usage, scene, library or file error; 3 none fails, and one \
        could not be decided.\n\n\
        Example: stickslip conform fig5-stick-slip --renderer ./libmine.so --renderer-options rings=2"
    )]
    Conform(conform::ConformArguments),
    /// Repeat recorded ticks, bit for bit
    #[command(
        after_help = "FILE is the session.json that `certify`, or `run` with `run.schedule = \"threads\"`, wrote. \
        Every tick is repeated in virtual time, with the models and the late ticks of the recording, and compared with \
        it. The longest ticks of a certificate are timed again, with warm and with cold caches.\n\n\
        Exit codes: 0 identical to the bit; 1 something differs; 2 usage or file error, or the scene cannot \
        start.\n\n\
        Example: stickslip replay reports/fig5-stick-slip/session.json"
    )]
    Replay {
        /// A recorded session
        file: PathBuf,
    },
    /// Serve a renderer's calls to the program that started this process
    #[cfg(all(feature = "external", target_os = "linux"))]
    #[command(hide = true)]
    ServeRenderer {
        /// A shared library
        library: PathBuf,
    },
    /// Write a commented scene to start from
    #[command(
        after_help = "Writes every table with the keys that are changed most, their accepted values and the defaults. With \
        --mesh the unit, the fixed nodes, the path of the tip, the material and the steps are chosen for the mesh, and the \
        choices are stated. The scene runs as it is.\n\nExit codes: 0 written; 2 usage or mesh error, or the file is there \
        already.\n\nExamples:\n  stickslip init my-scene.toml\n  stickslip init organ.toml --mesh organ.vtu"
    )]
    Init(init::InitArguments),
    /// List the shipped scenes and what each shows
    #[command(after_help = "Example: stickslip list --json")]
    List,
    /// Print a shell's script for the completion of commands and options
    #[command(
        after_help = "Example: stickslip completions bash > ~/.local/share/bash-completion/completions/stickslip"
    )]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page, or write one per command
    #[command(after_help = "Example: stickslip man --out ~/.local/share/man/man1")]
    Man {
        /// Folder for the pages of all commands
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

fn after_help() -> String {
    let names: Vec<String> = SHIPPED.iter().map(|shipped| format!("  {}", shipped.name)).collect();
    format!(
        "Shipped scenes, which can be given by name:\n{}\n\nA first look:\n  stickslip explain fig5-stick-slip\n  \
         stickslip run fig5-stick-slip --out /tmp/fig5\n\nExit codes: 0 pass; 1 a verdict is FAIL, a fault \
         ended a run, or no local model is within the budget; 2 usage, scene or file error; 3 a verdict is \
         INCONCLUSIVE.",
        names.join("\n")
    )
}

/// Returns the exit code of a verdict.
fn exit_code(verdict: Verdict) -> u8 {
    match verdict {
        Verdict::Pass => PASS,
        Verdict::Fail => FAIL,
        Verdict::Inconclusive => INCONCLUSIVE,
    }
}

/// Returns the error of a scene that has no place to press, since its path never touches the body.
fn never_touches(scene: &Scene) -> Report {
    miette::miette!(
        help = "give a scene whose path touches the body: `stickslip explain` warns of one that does not",
        "the path of {} never touches the body, so there is no place to press",
        scene.name
    )
}

/// Parses the arguments, the first of which is the program's name, and executes the command.
///
/// ```
/// use std::process::ExitCode;
/// use stickslip::cli;
///
/// let folder = tempfile::tempdir()?;
/// let out = folder.path().to_str().expect("a path in Unicode");
/// let done = cli::main(["stickslip", "run", "fixtures/crosscheck/wall.toml", "--quiet", "--out", out].map(Into::into));
/// assert_eq!(done, ExitCode::SUCCESS);
/// assert!(folder.path().join("trace.csv").exists());
/// assert_eq!(cli::main(["stickslip", "run", "fixtures/no-such-scene.toml"].map(Into::into)), ExitCode::from(2));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let Arguments { command, asked } = Arguments::parse_from(arguments);
    terminal::ask(asked);
    interrupt::listen();
    // It can be set once in a process; whoever has set another keeps it.
    let _ = miette::set_hook(Box::new(diagnostic::layout));
    let done = match command.unwrap_or_else(|| Command::Report(ReportArguments::default())) {
        Command::Report(arguments) => report::report(&arguments),
        Command::Run(arguments) => run::run(&arguments),
        Command::Stability { scene, changes, out, renderer } => stability::stability(&scene, &changes, out, &renderer),
        Command::Explain { scene, changes, renderer } => explain::explain(&scene, &changes, &renderer),
        Command::Check(arguments) => check::check(&arguments),
        Command::Accuracy(arguments) => accuracy::accuracy(&arguments),
        Command::Judge(arguments) => judge::judge(&arguments),
        Command::Suite(arguments) => suite::suite(&arguments),
        #[cfg(all(feature = "realtime", target_os = "linux"))]
        Command::Certify(arguments) => certify::certify(&arguments),
        Command::Conform(arguments) => conform::conform(&arguments),
        Command::Replay { file } => replay::replay(&file),
        #[cfg(all(feature = "external", target_os = "linux"))]
        Command::ServeRenderer { library } => external::serve(&library),
        Command::Init(arguments) => init::init(&arguments),
        Command::List => list::list(),
        Command::Completions { shell } => manual::completions(shell),
        Command::Man { out } => manual::man(out.as_deref()),
    };
    match done {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            complain(format_args!("{error:?}"));
            if let Some(option) = option(&error) {
                complain(option);
            }
            ExitCode::from(USAGE)
        }
    }
}

/// Returns which option of the command line the advice on an error is about; the library knows none.
fn option(error: &Report) -> Option<String> {
    let scene_error = match error.downcast_ref() {
        Some(RunFilesError::Scene(error)) => Some(error),
        _ => error.downcast_ref::<SceneError>(),
    };
    if let Some(change) = scene_error.and_then(SceneError::change) {
        return Some(format!("Option: --set {}", diagnostic::printable(&change.to_string())));
    }
    if error.is::<WriteError>() || matches!(error.downcast_ref(), Some(RunFilesError::Write(_))) {
        return Some("Option: --out DIR".to_owned());
    }
    matches!(error.downcast_ref(), Some(AcceptError::NoReason)).then(|| "Option: --reason TEXT".to_owned())
}

/// Changes of a command's scene.
#[derive(Debug, Default, Args)]
struct Changes {
    /// Set a key of the scene, such as contact.friction=0.5 or mesh.nodes=[9,9,4]; a bare word is a string (can be repeated)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    changes: Vec<Change>,
}

/// Reads a scene like [`read`] and prints its warnings on standard error.
fn load(scene: &Path, changes: &Changes, renderer: &RendererArguments) -> Result<Scene, SceneError> {
    let (scene, _) = read(scene, changes)?;
    warn(&scene.warnings());
    Ok(renderer.apply(scene))
}

/// Prints warnings on standard error.
fn warn(warnings: &[Warning]) {
    for warning in warnings {
        complain(format_args!("Warning: {}", diagnostic::printable(&warning.message)));
    }
}

/// Reads a scene file, or else the shipped scene of that name with its expected end, which a changed scene does not have.
fn read(scene: &Path, Changes { changes }: &Changes) -> Result<(Scene, Option<Expectation>), SceneError> {
    let shipped = SHIPPED.iter().find(|shipped| scene.as_os_str() == shipped.name);
    let (scene, expectation) = match shipped {
        Some(shipped) if !scene.exists() => {
            let expectation = changes.is_empty().then_some(shipped.expectation);
            (Scene::parse_with(shipped.text, scene, changes)?, expectation)
        }
        _ => (Scene::load_with(scene, changes)?, None),
    };
    Ok((RendererArguments::default().apply(scene), expectation))
}

/// Takes the output folder: the given one, or one named after the scene. The folder is created before anything is computed,
/// so that no result is lost because it cannot be written, and the files that mark an earlier result as complete are
/// removed.
fn folder(out: Option<PathBuf>, scene: &Scene, conclusions: &[&str]) -> Result<ResultFolder, WriteError> {
    let folder = ResultFolder::take(&out.unwrap_or_else(|| Path::new("reports").join(&scene.name)))?;
    folder.clear(conclusions)?;
    Ok(folder)
}
