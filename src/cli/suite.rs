//! `stickslip suite`: the problem set as files, for programs that know nothing of this one.

use std::path::PathBuf;
use std::sync::Mutex;

use clap::Args;
use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use rayon::prelude::*;
use serde::Serialize;

use super::progress::Progress;
use super::terminal::{complain, hand_out, say};
use super::{FAIL, PASS};
use crate::output::files::{write_file, write_json};
use crate::output::folder::{ResultFolder, sha256};
use crate::verify::suite::{self, PROBLEMS, ProblemFile, SuiteError};

#[derive(Debug, Args)]
pub struct SuiteArguments {
    /// Output folder
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Contents of `suite.json`.
#[derive(Serialize)]
struct SuiteFile {
    suite: u32,
    program: &'static str,
    problems: Vec<ProblemEntry>,
}

/// A problem in `suite.json`.
#[derive(Serialize)]
struct ProblemEntry {
    name: &'static str,
    tries: &'static str,
    floor_rms_rel: f64,
    fault: Option<String>,
    /// SHA-256 of its `problem.json`, which has those of its other files.
    sha256: Option<String>,
}

pub fn suite(arguments: &SuiteArguments) -> miette::Result<u8> {
    let folder = ResultFolder::take(&arguments.out)?;
    folder.clear(&["suite.json", "README.md", "example.py"])?;
    let out = folder.path();
    let progress = Mutex::new(Progress::new(PROBLEMS.len() as u64, "problems"));
    let written: Vec<ProblemFile> = PROBLEMS
        .par_iter()
        .map(|problem| {
            let file = suite::write(problem, out, |_| ())?;
            // If a thread panicked while it counted, the lock is poisoned and the count no longer matters.
            if let Ok(mut progress) = progress.lock() {
                progress.begin(problem.name);
                progress.end(1);
            }
            Ok(file)
        })
        .collect::<Result<_, SuiteError>>()?;
    drop(progress);
    let entry = |file: &ProblemFile| ProblemEntry {
        name: file.name,
        tries: file.tries,
        floor_rms_rel: file.reference.floor_rms_rel,
        fault: file.reference.fault.clone(),
        sha256: sha256(&out.join(file.name).join("problem.json")).ok(),
    };
    let problems = written.iter().map(entry).collect();
    let file = SuiteFile { suite: suite::VERSION, program: env!("CARGO_PKG_VERSION"), problems };
    write_file(&out.join("example.py"), suite::EXAMPLE.as_bytes())?;
    write_file(&out.join("README.md"), suite::guide(&written).as_bytes())?;
    write_json(&out.join("suite.json"), &file)?;

    hand_out(&file)?;
    say(format_args!("{} problems in {}", written.len(), out.display()))?;
    say(table(&written))?;
    say(format_args!("how to take part: {}", out.join("README.md").display()))?;
    let faults = file.problems.iter().filter_map(|problem| Some((problem.name, problem.fault.as_ref()?)));
    let faults: Vec<_> = faults.collect();
    for (name, fault) in &faults {
        complain(format_args!("{name}: the reference ended in a fault: {fault}"));
    }
    Ok(if faults.is_empty() { PASS } else { FAIL })
}

/// Builds the table of the problems.
fn table(problems: &[ProblemFile]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED);
    table.set_header(["problem", "law", "surface", "nodes", "ticks in contact", "largest force (N)", "floor"]);
    for problem in problems {
        let ProblemFile { contact, reference, .. } = problem;
        table.add_row([
            problem.name.to_owned(),
            contact.law.to_owned(),
            contact.surface.to_owned(),
            problem.body.nodes.to_string(),
            format!("{} of {}", reference.contact_ticks, problem.ticks),
            format!("{:.2}", reference.force_max_n),
            format!("{:.2} %", 100.0 * reference.floor_rms_rel),
        ]);
    }
    table
}
