//! `stickslip judge`: another program's force trace, compared with the whole network at the haptic rate.

use std::path::PathBuf;

use clap::Args;
use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use serde::Serialize;

use super::junit::{JunitArguments, JunitCase, JunitSuite};
use super::progress::Progress;
use super::renderer::RendererArguments;
use super::terminal::{hand_out, say, significant};
use super::{Changes, exit_code, folder, load};
use crate::output::files::write_json;
use crate::output::folder::sha256;
use crate::verify::accuracy::REFINEMENT;
use crate::verify::judge::{ForceTrace, Judgement, TraceFormat, reference};

#[derive(Debug, Args)]
pub struct JudgeArguments {
    /// A scene file or the name of a shipped scene
    scene: PathBuf,
    #[command(flatten)]
    changes: Changes,
    /// The trace: a CSV file with a header and the columns t,fx,fy,fz in s and N, in any order, and others beside them
    #[arg(long, value_name = "FILE")]
    trace: PathBuf,
    /// Output folder (default: reports/SCENE)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Factor on the forces: 0.001 for mN, -1 for the force on the body
    #[arg(long, value_name = "S", default_value_t = 1.0, allow_negative_numbers = true, value_parser = factor)]
    scale: f64,
    /// Time added to the trace's, s
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    time_offset: f64,
    /// Names of the columns: time, then the force on the instrument along x, y and z
    #[arg(long, value_name = "T,FX,FY,FZ", default_value = "t,fx,fy,fz", value_parser = columns)]
    columns: [String; 4],
    #[command(flatten)]
    junit: JunitArguments,
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| "give a finite number".to_owned())
}

fn factor(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|value| *value != 0.0).ok_or_else(|| "give a finite number other than 0".to_owned())
}

fn columns(text: &str) -> Result<[String; 4], String> {
    let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
    names.try_into().map_err(|_| "give four names with commas between them".to_owned())
}

/// Contents of `judge.json`.
#[derive(Serialize)]
struct JudgeFile {
    #[serde(flatten)]
    judgement: Judgement,
    trace: TraceEntry,
}

/// The trace as it was read.
#[derive(Serialize)]
struct TraceEntry {
    path: PathBuf,
    sha256: Option<String>,
    rows: usize,
    /// Times of the first and the last row after the offset, s.
    span_s: [f64; 2],
    /// Median step, s.
    step_s: f64,
    scale: f64,
    time_offset_s: f64,
    columns: [String; 4],
}

pub fn judge(arguments: &JudgeArguments) -> miette::Result<u8> {
    let JudgeArguments { scene, trace: path, out, scale, time_offset, columns, .. } = arguments;
    let scene = load(scene, &arguments.changes, &RendererArguments::default())?;
    let format = TraceFormat { columns: columns.clone(), scale: *scale, time_offset_s: *time_offset };
    // A bad trace is refused before anything is computed.
    let trace = ForceTrace::read(path, &format)?;
    let folder = folder(out.clone(), &scene, &["judge.json"])?;
    arguments.junit.prepare()?;
    let mut progress = Progress::new(scene.tick_count() * u64::from(1 + REFINEMENT), "ticks");
    progress.begin("references");
    let reference = reference(&scene, |done| progress.set(done))?;
    drop(progress);
    let judgement = Judgement::of(&trace, &scene, &reference)?;

    let TraceFormat { columns, scale, time_offset_s } = format;
    let trace = TraceEntry {
        path: path.clone(),
        sha256: sha256(path).ok(),
        rows: trace.rows(),
        span_s: trace.span_s(),
        step_s: trace.step_s(),
        scale,
        time_offset_s,
        columns,
    };
    let file = JudgeFile { judgement, trace };
    let written = folder.path().join("judge.json");
    write_json(&written, &file)?;
    arguments.junit.write(|| {
        let judgement = &file.judgement;
        let case = JunitCase {
            name: path.display().to_string(),
            class: format!("stickslip.judge.{}", scene.name),
            seconds: None,
            verdict: judgement.verdict,
            reasons: vec![judgement.sentence.clone()],
        };
        JunitSuite { name: "stickslip judge", cases: vec![case] }
    })?;
    hand_out(&file)?;
    let JudgeFile { judgement, .. } = file;
    for finding in &judgement.findings {
        say(format_args!("Note: {finding}."))?;
    }
    say(format_args!("{}: {}", judgement.verdict.name(), judgement.sentence))?;
    say(table(&judgement))?;
    say(format_args!("judgement: {}", written.display()))?;
    Ok(exit_code(judgement.verdict))
}

/// Builds the table of the errors.
fn table(judgement: &Judgement) -> Table {
    let share = |value: f64| format!("{} %", significant(100.0 * value));
    let worst = judgement.force_error_per_100_ms.iter().max_by(|a, b| a.force.total_cmp(&b.force));
    let rows = [
        ("force error, RMS, of the reference's force", Some(share(judgement.force_error_rms_rel))),
        ("… along the contact normal", Some(share(judgement.normal_error_rms_rel))),
        ("… across it", Some(share(judgement.tangential_error_rms_rel))),
        ("… against the reference with ticks of an eighth", Some(share(judgement.force_error_rms_rel_fine))),
        ("difference of the two references (floor)", Some(share(judgement.floor_rms_rel))),
        ("worst 100 ms", worst.map(|window| format!("{} from {:.1} s", share(window.force), window.time_s))),
        ("largest force error", Some(format!("{} N", significant(judgement.force_error_max_n)))),
        ("agreement of the contact modes", judgement.mode_agreement.map(share)),
        (
            "distance of the contact points, RMS",
            judgement.contact_point_error_rms_m.map(|m| format!("{} mm", significant(1e3 * m))),
        ),
        (
            "ticks compared, of them in contact",
            Some(format!(
                "{} of {}, {} of {}",
                judgement.compared_ticks,
                judgement.scene_ticks,
                judgement.compared_contact_ticks,
                judgement.scene_contact_ticks
            )),
        ),
    ];
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(["measure", "value"]);
    for (measure, value) in rows {
        table.add_row([measure.to_owned(), value.unwrap_or_else(|| "–".to_owned())]);
    }
    table
}
