//! Standard output: text for people, JSON for programs, or nothing.

use std::fmt::Display;
use std::io::Write;
use std::sync::OnceLock;

use miette::IntoDiagnostic;
use serde::Serialize;

/// What the command line asked for, once for the process.
static ASKED: OnceLock<Asked> = OnceLock::new();

/// How much is printed.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct Asked {
    /// Print nothing but errors: the exit code says how it went
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Print what the command found as JSON, in place of text
    #[arg(long, global = true)]
    json: bool,
}

/// To be called once, before anything is printed.
pub fn ask(asked: Asked) {
    // A second call would change nothing.
    let _ = ASKED.set(asked);
}

fn asked() -> Asked {
    ASKED.get().copied().unwrap_or_default()
}

/// Whether people are to be told how far it is.
pub fn shows_progress() -> bool {
    !asked().quiet
}

/// Whether the result is wanted as JSON.
pub fn wants_json() -> bool {
    asked().json
}

/// Prints a line for people.
pub fn say(text: impl Display) -> miette::Result<()> {
    let Asked { quiet, json } = asked();
    if quiet || json { Ok(()) } else { print(text) }
}

/// Prints what a command found, where JSON is asked for.
pub fn hand_out(found: &impl Serialize) -> miette::Result<()> {
    if asked().json { print(serde_json::to_string_pretty(found).into_diagnostic()?) } else { Ok(()) }
}

/// Prints a line whatever was asked for. That nobody reads on is no error.
pub fn print(text: impl Display) -> miette::Result<()> {
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{text}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(miette::miette!("cannot write to standard output: {error}"))
        }
        _ => Ok(()),
    }
}
