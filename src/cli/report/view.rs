//! The 3-D view, in which runs can be turned and replayed. The page contains everything that it needs.

use base64::{Engine, prelude::BASE64_STANDARD};
use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::runs::Reported;
use crate::output::frames::Frames;

/// Bundle of three.js; `three/README.md` describes how to make it.
const THREE: &str = include_str!("view/three/three.bundle.min.js");
/// Licence of three.js.
pub const LICENCE: &str = include_str!("view/three/LICENSE");
const SCRIPT: &str = include_str!("view/view.js");
const STYLE: &str = include_str!("view/view.css");

/// Largest size of the positions of all runs in the page, bytes, before they are encoded as text.
const MOST_BYTES: usize = 3_000_000;

/// Returns the largest size of one of several runs, bytes.
pub fn share(runs: usize) -> usize {
    MOST_BYTES / runs.max(1)
}

/// A run in the form that the script reads.
#[derive(Serialize)]
struct ViewedRun<'a> {
    scene: &'a str,
    /// Outcome of the run.
    outcome: String,
    #[serde(flatten)]
    frames: &'a Frames,
    /// 16-bit numbers in base 64, lower byte first.
    first: String,
    positions: String,
}

fn encoded(steps: &[u16]) -> String {
    let bytes: Vec<u8> = steps.iter().flat_map(|step| step.to_le_bytes()).collect();
    BASE64_STANDARD.encode(bytes)
}

/// Serialises a value as JSON that cannot end its script element: `<` occurs in strings only, and is escaped.
fn inlined(value: &impl Serialize) -> serde_json::Result<String> {
    Ok(serde_json::to_string(value)?.replace('<', "\\u003c"))
}

pub fn section(reported: &[Reported]) -> miette::Result<Markup> {
    let viewed: Vec<ViewedRun> = reported
        .iter()
        .filter_map(|r| {
            let frames = r.frames.as_ref().ok()?;
            let (first, positions) = (encoded(&frames.first), encoded(&frames.positions));
            Some(ViewedRun { scene: r.name(), outcome: r.verdict().cell(), frames, first, positions })
        })
        .collect();
    let data = inlined(&viewed).map_err(|error| miette::miette!("cannot write the 3-D view: {error}"))?;
    Ok(html! {
        h2 #view { "3-D view" }
        p {
            "The surface as the servo loop has it. Orange nodes are the patch of the local model and move with every \
             tick. All other nodes are where that model holds them until the next hand-over; dark nodes are fixed. \
             The arrow is the force on the instrument."
        }
        @if !viewed.is_empty() {
            style { (PreEscaped(STYLE)) }
            div #view-stage hidden {
                div.view-picture {
                    canvas #view-canvas tabindex="0" role="img" aria-describedby="view-keys" aria-label="The mesh under the tip" {}
                }
                p #view-text {}
                div.view-controls {
                    button #view-play type="button" { "Play" }
                    label.view-time { "Time " input #view-time type="range" min="0" max="0" step="1" value="0"; }
                    label { "Scene " select #view-scene {
                        @for (index, run) in viewed.iter().enumerate() { option value=(index) { (run.scene) } }
                    } }
                    label { "Speed " select #view-speed {
                        option value="1" { "real time" }
                        option value="0.5" { "1/2" }
                        option value="0.25" selected { "1/4" }
                        option value="0.1" { "1/10" }
                    } }
                    button #view-reset type="button" { "Reset view" }
                }
                p #view-keys {
                    "Drag to turn; use the wheel or two fingers to zoom. Keys, with the view in focus: arrows turn, \
                     + and − zoom, space plays and pauses, comma and full stop step."
                }
            }
            p #view-none {
                "The 3-D view needs JavaScript and WebGL, which this browser does not provide. The rest of the report \
                 is complete."
            }
            script #view-data type="application/json" { (PreEscaped(data)) }
            script { (PreEscaped(THREE)) }
            script { (PreEscaped(SCRIPT)) }
        }
        @for r in reported {
            @if let Err(reason) = &r.frames { p { (r.name()) " is not in the 3-D view: " (reason) "." } }
        }
    })
}
