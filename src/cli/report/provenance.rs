//! Where a report comes from: program, machine, scenes.

use std::time::SystemTime;

use maud::{Markup, html};
use serde::Serialize;

use super::runs::Reported;
use super::view::LICENCE;
use crate::cli::page;

/// In `report.json`.
#[derive(Serialize)]
pub struct Origin {
    version: &'static str,
    /// Compiler, target and level of optimisation.
    build: &'static str,
    debug_assertions: bool,
    /// Vector instructions that the compiler was free to use, and that the processor has.
    compiled_features: Vec<String>,
    cpu_features: Vec<String>,
    machine: Vec<(&'static str, String)>,
    /// UTC.
    date: String,
    /// Sections of the report that were not asked for.
    left_out: Vec<&'static str>,
}

impl Origin {
    pub fn new(reported: &[Reported], left_out: Vec<&'static str>) -> Self {
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
            left_out,
        }
    }
}

#[cfg(all(feature = "realtime", target_os = "linux"))]
fn machine() -> Vec<(&'static str, String)> {
    let machine = crate::realtime::machine::Machine::describe(0);
    let told = |value: Option<String>| value.unwrap_or_else(|| "not told".to_owned());
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

const HEAD: [&str; 5] = ["scene", "its text (SHA-256)", "ticks", "time (s)", "parts left out"];

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
        ("made", origin.date.clone()),
        ("built", origin.build.to_owned()),
        ("debug assertions", origin.debug_assertions.to_string()),
        ("vector instructions compiled for", features(&origin.compiled_features)),
        ("of the processor", features(&origin.cpu_features)),
    ];
    let facts = facts.into_iter().chain(origin.machine.iter().cloned());
    html! {
        h2 #provenance { "Provenance" }
        (page::table("words", ["what", "is"], facts.map(|(name, value)| [name.to_owned(), value])))
        @if !origin.left_out.is_empty() {
            p { "Not in this report: " (origin.left_out.join(", ")) ". " code { "stickslip report" } " has all of it." }
        }
        p {
            "Each scene goes without the parts of the pipeline that it does not need; which these are is in its "
            code { "summary.json" } "."
        }
        (page::table("", HEAD, reported.iter().map(row)))
        details {
            summary { "Licence of three.js, which draws the 3-D view" }
            pre { (LICENCE) }
        }
    }
}
