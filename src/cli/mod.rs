//! The command line: arguments in, exit code out. Nothing below this module reads arguments,
//! prints, or ends the process.

mod accuracy;
#[cfg(all(feature = "realtime", target_os = "linux"))]
mod certify;
mod check;
mod explain;
#[cfg(all(feature = "realtime", target_os = "linux"))]
mod interrupt;
mod manual;
mod page;
mod progress;
mod replay;
mod report;
mod run;
mod stability;
mod table;
mod terminal;
mod tick_timing;
mod time;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use self::report::ReportArguments;
use self::terminal::{Asked, say};
use crate::output::files::WriteError;
use crate::scene::{Expectation, SHIPPED, Scene, SceneError};

/// Everything went as it should.
const PASS: u8 = 0;
/// A verdict is FAIL, or a fault ended a run.
const FAIL: u8 = 1;
/// A verdict is INCONCLUSIVE, and none is FAIL.
#[cfg(all(feature = "realtime", target_os = "linux"))]
const INCONCLUSIVE: u8 = 3;
/// The arguments, a scene or a file is not as it should be.
const USAGE: u8 = 2;

#[derive(Debug, Parser)]
#[command(
    version,
    about = "Verification and benchmarking testbed for multi-rate haptic simulation with stick-slip contact",
    long_about = "Verification and benchmarking testbed for multi-rate haptic simulation with stick-slip contact.\n\n\
        A nonlinear mass-spring-damper network runs at about 10 Hz; beside it a low-order local model does \
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
    /// Run scenes and write one report that opens in a browser
    #[command(
        after_help = "Writes DIR/index.html, which needs no other file and no network, DIR/report.json, and for every \
        scene the files of `run` in DIR/<scene>/. Without scenes it also compares contact surfaces and local models, \
        looks at stability, and certifies the servo loop for a few seconds; --quick leaves that out.\n\n\
        Exit code 1: a scene did not end as expected, accuracy could not be judged, or a stability verdict is FAIL. \
        Verdicts on this machine (certificate) and of earlier runs (cross-check) are shown and change nothing.\n\n\
        Example: stickslip report fig5-stick-slip my-scene.toml"
    )]
    Report(report::ReportArguments),
    /// Run one scene: trace, network, summary and force plot
    #[command(after_help = "Writes trace.csv (a row per tick), network.json, summary.json and forces.svg; with --vtk \
        also network.pvd and instrument.pvd with their frames.\n\n\
        Exit code 0: it reached its duration; 1: a fault ended it (the rows before it are kept), or the tip passed \
        through the surface; 2: the scene or the output folder is not as it should be.\n\nExample: stickslip run fig5-stick-slip --out /tmp/fig5")]
    Run(run::RunArguments),
    /// Show what a scene needs, what is left out, what it costs and how long its steps may be
    Explain {
        /// A scene file or the name of a shipped scene
        scene: PathBuf,
    },
    /// How long steps may be, measured against predicted limits, virtual walls, and scenes that go to extremes
    #[command(
        after_help = "Writes DIR/index.html with its figures inside and DIR/stability.json. The limits are those of \
        the scene's local model, with stiffness, mass ratio and damping varied; virtual walls and extremes are always \
        the same.\n\n\
        Exit code 1: an extreme did not end as expected, a limit is more than 2 % off for no known reason, or a \
        virtual wall that has to be passive shakes.\n\n\
        Example: stickslip stability fig5-stick-slip --out /tmp/stability"
    )]
    Stability {
        /// A scene file or the name of a shipped scene
        #[arg(default_value = "fig5-stick-slip")]
        scene: PathBuf,
        /// Where the files go (default: reports/<scene name>)
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Compare results with accepted baselines, quantity by quantity
    #[command(after_help = "Writes DIR/check.json with every quantity; the table shows those that fail or improved. \
        A missing baseline, a value that is not finite, and more work than before fail.\n\n\
        Examples:\n  stickslip check\n  stickslip check --accept fig5-stick-slip --reason \"friction bound uses the new normal\"\n  \
        stickslip check fig5-stick-slip --time --against /tmp/before/stickslip")]
    Check(check::CheckArguments),
    /// Compare local approximations: force error against time per tick
    #[command(
        after_help = "Runs the scene's drag with a grid of local models and holds each against the full network \
        at the haptic rate. Writes DIR/index.html and DIR/accuracy.json. Times are taken one after the other: keep \
        the machine quiet.\n\nExit code 0: done; 1: no method is within the budget; 2: the scene or the output folder is \
        not as it should be.\n\nExample: stickslip accuracy deep-stick-slip --budget-us 5 --out /tmp/accuracy"
    )]
    Accuracy(accuracy::AccuracyArguments),
    /// Whether the servo loop keeps its deadlines on this machine
    #[cfg(all(feature = "realtime", target_os = "linux"))]
    #[command(
        after_help = "Runs the scene's loop in real time, on a thread of its own, and judges twice: what the program takes \
        (compute), and whether commands came by their deadline on this machine (platform). A loop that does nothing runs \
        between the ticks, so that what the machine does is told from what the program does. Ticks that took longest \
        are done again, with warm and with cold caches. Writes DIR/certificate.md, certificate.json, session.json and \
        two figures. Ctrl-C ends it with what it has.\n\nWithout the right to SCHED_FIFO (root, or `ulimit -r`) the \
        platform part cannot pass.\n\nExit code 0: both parts PASS; 1: one FAILs; 3: neither fails, but one is \
        INCONCLUSIVE; 2: the scene, an option or the output folder is not as it should be.\n\n\
        Example: stickslip certify fig5-stick-slip --duration 60 --load cpu --out /tmp/certificate"
    )]
    Certify(certify::CertifyArguments),
    /// Do recorded ticks again, bit for bit
    #[command(
        after_help = "FILE is the session.json that a run with `schedule = \"threads\"` or a certificate left. Every \
        tick is done again in virtual time, with the models and the late ticks of the recording, and compared with \
        it. Ticks that a certificate marked as its worst are timed again, with warm and with cold caches.\n\n\
        Exit code 0: the same to the bit; 1: something differs; 2: the file is no session, or its scene cannot start.\n\n\
        Example: stickslip replay reports/fig5-stick-slip/session.json"
    )]
    Replay {
        /// A recorded session
        file: PathBuf,
    },
    /// Print a script that completes commands and options in a shell
    #[command(
        after_help = "Example: stickslip completions bash > ~/.local/share/bash-completion/completions/stickslip"
    )]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page, or write one for every command
    #[command(after_help = "Example: stickslip man --out ~/.local/share/man/man1")]
    Man {
        /// Folder for a page of every command
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

fn after_help() -> String {
    let names: Vec<String> = SHIPPED.iter().map(|shipped| format!("  {}", shipped.name)).collect();
    format!(
        "Shipped scenes, which can be given by name:\n{}\n\nA first look:\n  stickslip explain fig5-stick-slip\n  \
         stickslip run fig5-stick-slip --out /tmp/fig5\n\nExit codes: 0 pass; 1 a verdict is FAIL or a fault ended a \
         run; 2 usage, scene or file error.",
        names.join("\n")
    )
}

/// Parses the arguments, of which the first is the program's name, and does what they say.
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
    let done = match command.unwrap_or_else(|| Command::Report(ReportArguments::default())) {
        Command::Report(arguments) => report::report(&arguments),
        Command::Run(arguments) => run::run(&arguments),
        Command::Stability { scene, out } => stability::stability(&scene, out),
        Command::Explain { scene } => explain::explain(&scene),
        Command::Check(arguments) => check::check(&arguments),
        Command::Accuracy(arguments) => accuracy::accuracy(&arguments),
        #[cfg(all(feature = "realtime", target_os = "linux"))]
        Command::Certify(arguments) => certify::certify(&arguments),
        Command::Replay { file } => replay::replay(&file),
        Command::Completions { shell } => manual::completions(shell),
        Command::Man { out } => manual::man(out.as_deref()),
    };
    match done {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("{error:?}");
            ExitCode::from(USAGE)
        }
    }
}

/// As [`read`], with its warnings on standard error.
fn load(scene: &Path) -> Result<(Scene, Expectation), SceneError> {
    let (scene, expectation) = read(scene)?;
    for warning in &scene.warnings() {
        eprintln!("Warning: {warning}");
    }
    Ok((scene, expectation))
}

/// A scene file, or else a shipped scene of that name, and how it is expected to end.
fn read(scene: &Path) -> Result<(Scene, Expectation), SceneError> {
    let shipped = SHIPPED.iter().find(|shipped| scene.as_os_str() == shipped.name);
    match shipped {
        Some(shipped) if !scene.exists() => Ok((Scene::parse(shipped.text, scene)?, shipped.expectation)),
        _ => Ok((Scene::load(scene)?, Expectation::Completes)),
    }
}

/// Where a command's files go: the folder given, or else one of the scene's name. It is made here, so that nothing
/// is computed that could not be written.
fn folder(out: Option<PathBuf>, scene: &Scene) -> Result<PathBuf, WriteError> {
    let out = out.unwrap_or_else(|| Path::new("reports").join(&scene.name));
    match std::fs::create_dir_all(&out) {
        Ok(()) => Ok(out),
        Err(source) => Err(WriteError { path: out, source }),
    }
}
