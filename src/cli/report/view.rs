//! The 3-D view: runs that one can turn and replay. Everything it needs is in the page.

use base64::{Engine, prelude::BASE64_STANDARD};
use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::runs::Reported;
use crate::output::frames::Frames;

/// What `three/README.md` says how to make.
const THREE: &str = include_str!("view/three/three.bundle.min.js");
/// Of three.js.
pub const LICENCE: &str = include_str!("view/three/LICENSE");
const SCRIPT: &str = include_str!("view/view.js");
const STYLE: &str = include_str!("view/view.css");

/// What positions of all runs take in the page, at most, before they are written as text.
const MOST_BYTES: usize = 3_000_000;

/// What one of so many runs may take.
pub fn share(runs: usize) -> usize {
    MOST_BYTES / runs.max(1)
}

/// A run as the script reads it.
#[derive(Serialize)]
struct ViewedRun<'a> {
    scene: &'a str,
    /// How it ended.
    outcome: &'static str,
    #[serde(flatten)]
    frames: &'a Frames,
    /// 16-bit numbers, lower byte first, in base 64.
    first: String,
    positions: String,
}

fn encoded(steps: &[u16]) -> String {
    let bytes: Vec<u8> = steps.iter().flat_map(|step| step.to_le_bytes()).collect();
    BASE64_STANDARD.encode(bytes)
}

/// JSON that nothing in it can end: `<` only stands in strings.
fn inlined(value: &impl Serialize) -> serde_json::Result<String> {
    Ok(serde_json::to_string(value)?.replace('<', "\\u003c"))
}

pub fn section(reported: &[Reported]) -> miette::Result<Markup> {
    let viewed: Vec<ViewedRun> = reported
        .iter()
        .filter_map(|r| {
            let frames = r.frames.as_ref().ok()?;
            let (first, positions) = (encoded(&frames.first), encoded(&frames.positions));
            Some(ViewedRun { scene: r.name(), outcome: r.outcome(), frames, first, positions })
        })
        .collect();
    let data = inlined(&viewed).map_err(|error| miette::miette!("cannot write the 3-D view: {error}"))?;
    Ok(html! {
        h2 #view { "3-D view" }
        p {
            "The surface as the local side has it: the patch of the local model (orange nodes) in motion, everything else as \
             that model holds it until the next one comes. Dark nodes are fixed. The arrow is the force on the instrument."
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
                    "Drag to turn, wheel or two fingers to zoom. With the keyboard, in the picture: arrows turn, + and − zoom, space \
                     plays, , and . step."
                }
            }
            p #view-none { "The 3-D view needs JavaScript and WebGL, and this browser gives it none. All else is here." }
            script #view-data type="application/json" { (PreEscaped(data)) }
            script { (PreEscaped(THREE)) }
            script { (PreEscaped(SCRIPT)) }
        }
        @for r in reported {
            @if let Err(reason) = &r.frames { p { (r.name()) " is not in the view: " (reason) "." } }
        }
    })
}
