//! Stability of a renderer in a shared library: of its local model nothing is known but the forces.

use maud::{Markup, html};
use serde::Serialize;

use super::super::never_touches;
use super::super::page::{self, Row};
use super::super::progress::Progress;
use super::super::terminal::{hand_out, say, significant};
use crate::output::files::{write_file, write_json};
use crate::output::folder::ResultFolder;
use crate::output::verdict::Verdict;
use crate::scene::Scene;
use crate::verify::rendered::{RUNS, RenderedStability};

/// Contents of `stability.json` for a renderer.
#[derive(Serialize)]
struct RendererFile {
    version: &'static str,
    scene: String,
    renderer: String,
    passes: bool,
    #[serde(flatten)]
    stability: RenderedStability,
}

/// Examines the renderer of a scene and writes its files. Returns the verdict.
pub fn stability(scene: &Scene, folder: &ResultFolder) -> miette::Result<Verdict> {
    let mut progress = Progress::new(RUNS, "runs");
    progress.begin(&scene.name);
    let stability = RenderedStability::of(scene, || progress.end(1))?;
    drop(progress);
    let stability = stability.ok_or_else(|| never_touches(scene))?;
    let renderer = scene.renderer().map_or(String::new(), |library| library.path().display().to_string());
    let (verdict, out) = (stability.verdict, folder.path());
    let passes = verdict == Verdict::Pass;
    let file =
        RendererFile { version: env!("CARGO_PKG_VERSION"), scene: scene.name.clone(), renderer, passes, stability };
    write_json(&out.join("stability.json"), &file)?;
    let page = page::page(&format!("stickslip: stability of a renderer over {}", scene.name), &section(&file));
    write_file(&out.join("index.html"), page.into_string().as_bytes())?;
    hand_out(&file)?;
    for body in &file.stability.z_width {
        let finding = match (&body.fault, body.buzz_m) {
            (None, Some(buzz_m)) => format!("the tip moves by {} µm above 50 Hz", significant(1e6 * buzz_m)),
            (fault, _) => fault.clone().unwrap_or_default(),
        };
        say(format_args!("stiffness × {:<4} {:.3} N, {finding}", body.factor, body.force_n))?;
    }
    for jump in &file.stability.jumps {
        let depth_mm = significant(1e3 * jump.depth_m);
        say(format_args!(
            "jump of {depth_mm} mm: at most {:.3} N, {:.3} N after 50 ticks",
            jump.peak_n, jump.settled_n
        ))?;
    }
    say(format_args!("{}: {}", verdict.name(), file.stability.reasons.join("; ")))?;
    say(format_args!("report: {}", out.join("index.html").display()))?;
    Ok(verdict)
}

fn section(file: &RendererFile) -> Markup {
    let RenderedStability { verdict, reasons, z_width, jumps } = &file.stability;
    let bodies = z_width.iter().map(|body| Row {
        class: (!body.is_quiet).then(|| "diverged".to_owned()),
        cells: [
            significant(body.factor),
            if body.is_quiet { "quiet" } else { "shakes" }.to_owned(),
            significant(body.force_n),
            body.buzz_m.map_or("–".to_owned(), |buzz_m| significant(1e6 * buzz_m)),
            body.fault.clone().unwrap_or_default(),
        ],
    });
    let jumps = jumps.iter().map(|jump| {
        [
            significant(1e3 * jump.depth_m),
            significant(jump.peak_n),
            significant(jump.settled_n),
            jump.fault.clone().unwrap_or_default(),
        ]
    });
    html! {
        p { strong { (verdict.name()) ": " (reasons.join("; ")) } }
        p { "Renderer: " code { (file.renderer) } ". Body, contact law and contact surface: scene " code { (file.scene) } "." }
        h2 { "Stiffer bodies under the modelled device in a hand" }
        (page::table("", ["stiffness ×", "", "force (N)", "motion above 50 Hz (µm)", "fault"], bodies))
        h2 { "Jumps into the body within one tick" }
        (page::table("", ["depth (mm)", "peak force (N)", "force after 50 ticks (N)", "fault"], jumps))
    }
}
