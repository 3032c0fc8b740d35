//! Provenance of a report: program, machine and scenes.

use std::time::SystemTime;

use maud::{Markup, html};
use serde::Serialize;

use super::runs::Reported;
use super::view::LICENCE;
use crate::cli::page;

/// The provenance in `report.json`.
#[derive(Serialize)]
pub struct Origin {
    version: &'static str,
    /// Compiler, target and optimisation level.
    build: &'static str,
    debug_assertions: bool,
    /// Vector instructions that the compiler was allowed to use.
    compiled_features: Vec<String>,
    /// Vector instructions of the processor.
    cpu_features: Vec<String>,
    machine: Vec<(&'static str, String)>,
    /// Time of the report, UTC.
    date: String,
    /// Sections that this report omits.
    omitted: Vec<&'static str>,
}

impl Origin {
    pub fn new(reported: &[Reported], omitted: Vec<&'static str>) -> Self {
        let of = |list: fn(&crate::verify::baseline::Provenance) -> &Vec<String>| {
            reported.first().map(|r| list(&r.provenance).clone()).unwrap_or_default()
        };
        Self {
            version: env!("CARGO_PKG_VERSION"),
            build: env!("STICKSLIP_BUILD"),
            debug_assertions: cfg!(debug_assertions),
            compiled_features: of(|provenance| &provenance.compiled_features),
            cpu_features: of(|provenance| &provenance.cpu_features),
            machine: machine(),
            date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            omitted,
        }
    }
}

#[cfg(all(feature = "realtime", target_os = "linux"))]
fn machine() -> Vec<(&'static str, String)> {
    let machine = crate::realtime::machine::Machine::describe(0);
    let told = |value: Option<String>| value.unwrap_or_else(|| "unknown".to_owned());
    vec![
        ("processor", told(machine.processor)),
        ("CPUs", machine.cpus.to_string()),
        ("hypervisor", machine.hypervisor.to_string()),
        ("kernel", told(machine.kernel)),
        ("program (SHA-256)", told(machine.program_sha256)),
    ]
}

#[cfg(not(all(feature = "realtime", target_os = "linux")))]
fn machine() -> Vec<(&'static str, String)> {
    vec![("system", format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS))]
}

const HEAD: [&str; 5] = ["scene", "settings of the scene (SHA-256)", "ticks", "run time (s)", "parts omitted"];

pub fn section(origin: &Origin, reported: &[Reported]) -> Markup {
    let row = |r: &Reported| {
        let summary = r.summary();
        [
            r.name().to_owned(),
            r.provenance.scene_sha256.clone(),
            summary.ticks.to_string(),
            format!("{:.2}", summary.wall_time_s),
            summary.left_out.len().to_string(),
        ]
    };
    let features = |list: &[String]| if list.is_empty() { "none".to_owned() } else { list.join(", ") };
    let facts = [
        ("stickslip", origin.version.to_owned()),
        ("date", origin.date.clone()),
        ("build", origin.build.to_owned()),
        ("debug assertions", origin.debug_assertions.to_string()),
        ("vector instructions compiled for", features(&origin.compiled_features)),
        ("vector instructions of the processor", features(&origin.cpu_features)),
    ];
    let facts = facts.into_iter().chain(origin.machine.iter().cloned());
    html! {
        h2 #provenance { "Provenance" }
        (page::table("words", ["property", "value"], facts.map(|(name, value)| [name.to_owned(), value])))
        @if !origin.omitted.is_empty() {
            p { "Not in this report: " (origin.omitted.join(", ")) ". For all of it, run " code { "stickslip report" } "." }
        }
        p {
            "A scene's pipeline omits the parts that the scene does not need; the scene's " code { "summary.json" }
            " lists them under " code { "left_out" } "."
        }
        (page::table("", HEAD, reported.iter().map(row)))
        details {
            summary { "Licence of three.js, which draws the 3-D view" }
            pre { (LICENCE) }
        }
    }
}
