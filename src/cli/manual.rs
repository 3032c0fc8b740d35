//! `stickslip man` and `stickslip completions`, generated from the description that `--help` uses.

use std::path::Path;

use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use miette::IntoDiagnostic;

use super::terminal::print;
use super::{Arguments, PASS, say};
use crate::output::files::{WriteError, write_file};

/// Prints a shell's completion script.
pub fn completions(shell: Shell) -> miette::Result<u8> {
    let mut script = Vec::new();
    generate(shell, &mut Arguments::command(), "stickslip", &mut script);
    print(String::from_utf8(script).into_diagnostic()?.trim_end())?;
    Ok(PASS)
}

/// Prints the manual page, or writes one per command into a folder.
pub fn man(out: Option<&Path>) -> miette::Result<u8> {
    let mut program = Arguments::command();
    program.build();
    let Some(out) = out else {
        print(String::from_utf8(page(program)?).into_diagnostic()?.trim_end())?;
        return Ok(PASS);
    };
    std::fs::create_dir_all(out).map_err(|source| WriteError { path: out.to_owned(), source })?;
    let commands: Vec<Command> = program.get_subcommands().filter(|command| !command.is_hide_set()).cloned().collect();
    let mut written = 0;
    for command in std::iter::once(program).chain(commands) {
        let name = command.get_display_name().unwrap_or(command.get_name()).to_owned();
        write_file(&out.join(format!("{name}.1")), &page(command)?)?;
        written += 1;
    }
    say(format_args!("{written} manual pages in {}", out.display()))?;
    Ok(PASS)
}

fn page(command: Command) -> miette::Result<Vec<u8>> {
    let mut text = Vec::new();
    Man::new(command).render(&mut text).into_diagnostic()?;
    Ok(text)
}
