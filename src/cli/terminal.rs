//! Standard output: text for people, JSON for programs, or nothing.

use std::fmt::Display;
use std::io::Write;
use std::sync::OnceLock;

use miette::IntoDiagnostic;
use serde::Serialize;

/// Output options of the command line, set once per process.
static ASKED: OnceLock<Asked> = OnceLock::new();

/// Output options of every command.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct Asked {
    /// Print nothing but errors; the exit code gives the verdict
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Print the findings as JSON and nothing else
    #[arg(long, global = true)]
    json: bool,
}

/// Sets the output options. Call it once, before anything is printed.
pub fn ask(asked: Asked) {
    // A second call would change nothing.
    let _ = ASKED.set(asked);
}

fn asked() -> Asked {
    ASKED.get().copied().unwrap_or_default()
}

/// Returns whether progress is shown.
pub fn shows_progress() -> bool {
    !asked().quiet
}

/// Prints a line of text, unless the output is JSON or nothing.
pub fn say(text: impl Display) -> miette::Result<()> {
    let Asked { quiet, json } = asked();
    if quiet || json { Ok(()) } else { print(text) }
}

/// Prints a command's findings, if the output is JSON.
pub fn hand_out(found: &impl Serialize) -> miette::Result<()> {
    if asked().json { print(serde_json::to_string_pretty(found).into_diagnostic()?) } else { Ok(()) }
}

/// Prints a line under all output options. A closed pipe is no error.
pub fn print(text: impl Display) -> miette::Result<()> {
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{text}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(miette::miette!("cannot write to standard output: {error}"))
        }
        _ => Ok(()),
    }
}

/// Prints a line on standard error. An undelivered message changes no verdict, so a closed or full standard error is
/// ignored.
pub fn complain(text: impl Display) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Formats a number with four significant digits at most.
pub fn significant(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    // Adding 0 makes −0 a 0.
    let rounded = rounded + 0.0;
    let magnitude = rounded.abs();
    if magnitude == 0.0 || !magnitude.is_finite() || (1e-3..1e6).contains(&magnitude) {
        format!("{rounded}")
    } else {
        format!("{rounded:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::significant;

    #[test]
    fn four_digits_are_kept() {
        let numbers = [250.0 / 3.0, 100.0, 0.5, -0.0, -6e-5, -2_971_409.2, 0.000_999_96, f64::NAN];
        let texts = ["83.33", "100", "0.5", "0", "-6e-5", "-2.971e6", "0.001", "NaN"];
        assert_eq!(numbers.map(significant), texts);
    }
}
