//! A certificate for people: a few lines of text, a Markdown page and two figures.

use std::fmt::Write as _;

use maud::{Markup, PreEscaped, html};

use crate::cli::page;
use crate::cli::tick_timing::names;
use crate::realtime::meter::Meter;
use crate::realtime::record::Quantiles;
use crate::verify::certificate::bounds::RateBound;
use crate::verify::certificate::parts::Verdict;
use crate::verify::certificate::tail::Tail;
use crate::verify::certificate::verdict::{Certificate, IndependenceTests, MissRate, WorstTick};
use crate::verify::lateness::Consequences;

/// File of the figure of responses over time.
pub(super) const RESPONSE: &str = "response.svg";
/// How quantiles are to be read.
pub(super) const QUANTILES: &str = "Quantiles have three significant digits and are given only where at least one time can lie \
    beyond; the longest times and all counts are exact. A skipped tick's response is that of the next command.";

pub(super) fn us(ns: u64) -> f64 {
    ns as f64 * 1e-3
}

/// Builds the text for the terminal.
pub fn words(certificate: &Certificate) -> String {
    let Certificate { compute, platform, .. } = certificate;
    let mut text = format!(
        "{}: {} ticks at {:.0} Hz in {:.1} s, deadline {:.0} µs, load {}\n",
        certificate.scene,
        certificate.ticks,
        certificate.rate_hz,
        certificate.duration_s,
        certificate.deadline_us,
        certificate.load,
    );
    let mut part = |name: &str, verdict: &str, reasons: &[String]| {
        let _ = writeln!(text, "{name}: {verdict}: {}", reasons.join("; "));
    };
    for (name, verdict, reasons) in parts(certificate) {
        part(name, verdict.name(), reasons);
    }
    let lines = [
        line("compute time             ", &compute.compute_ns),
        line("the same on an idle core ", &compute.idle_ns),
        line("response, servo loop     ", &platform.response_ns),
        line("response, without payload", &platform.control.response_ns),
    ];
    text + &lines.join("\n")
}

/// Returns a line of text with the quantiles of a time.
pub(super) fn line(name: &str, q: &Quantiles) -> String {
    let rare = [("p99.9", q.p999), ("p99.99", q.p9999)];
    let rare = rare.map(|(name, ns)| ns.map_or(String::new(), |ns| format!(", {name} {:.1}", us(ns)))).concat();
    format!("{name}: p50 {:.1}, p99 {:.1}{rare}, longest {:.1} µs", us(q.p50), us(q.p99), us(q.max))
}

/// Returns the parts of a certificate with their names, verdicts and reasons.
fn parts(certificate: &Certificate) -> Vec<(&'static str, Verdict, &[String])> {
    let Certificate { compute, platform, global, .. } = certificate;
    let mut parts = vec![
        ("compute", compute.verdict, compute.reasons.as_slice()),
        ("platform", platform.verdict, platform.reasons.as_slice()),
    ];
    parts.extend(global.iter().map(|global| ("global side", global.verdict, global.reasons.as_slice())));
    parts
}

/// Returns the names of the measured times and their quantiles in µs.
fn times(certificate: &Certificate) -> Vec<[String; 7]> {
    let Certificate { compute, platform, .. } = certificate;
    let mut rows = vec![
        ("release to start", &platform.release_ns),
        ("start to command (wall clock)", &compute.compute_ns),
        ("start to command (CPU time of the thread)", &compute.cpu_ns),
        ("tick of the first pass, repeated on an idle core", &compute.idle_ns),
        ("release to command (response)", &platform.response_ns),
        ("control loop without a payload: release to start", &platform.control.release_ns),
        ("control loop without a payload: response", &platform.control.response_ns),
    ];
    if let Some(global) = &certificate.global {
        rows.push(("global cycle to model", &global.cycle_ns));
        rows.push(("global cycle to model (CPU time of the thread)", &global.cpu_ns));
    }
    quantile_rows(rows)
}

/// Returns names and quantiles in µs.
pub(super) fn quantile_rows<'a>(times: impl IntoIterator<Item = (&'a str, &'a Quantiles)>) -> Vec<[String; 7]> {
    let row = |(name, q): (&str, &Quantiles)| {
        let [p50, p90, p99, p999, p9999, max] = [Some(q.p50), Some(q.p90), Some(q.p99), q.p999, q.p9999, Some(q.max)]
            .map(|ns| ns.map_or("–".to_owned(), |ns| format!("{:.1}", us(ns))));
        [name.to_owned(), p50, p90, p99, p999, p9999, max]
    };
    times.into_iter().map(row).collect()
}

/// Builds the report's section.
pub fn section(certificate: &Certificate, figures: &[(&'static str, String)]) -> Markup {
    let head = ["time (µs)", "p50", "p90", "p99", "p99.9", "p99.99", "longest"];
    html! {
        h2 #certificate { "Certificate of the servo loop" }
        p {
            (certificate.scene) " in real time on this machine: " (certificate.ticks) " ticks at "
            (format!("{:.0} Hz in {:.1} s", certificate.rate_hz, certificate.duration_s))
            ", each with its command due " (format!("{:.0} µs", certificate.deadline_us))
            " after its release. For a certificate to rely on, measure for minutes with "
            code { "stickslip certify" } "."
        }
        @for (name, verdict, reasons) in parts(certificate) {
            p { b { (capitalised(name)) ": " (verdict.name()) ". " } (reasons.join("; ")) "." }
        }
        (page::table("", head, times(certificate)))
        div.pair {
            @for (name, svg) in figures {
                figure {
                    (PreEscaped(svg))
                    figcaption {
                        @if *name == RESPONSE { "Responses of the servo loop and of a control loop without a payload." }
                        @else { "Share of ticks whose response is longer than a given time." }
                    }
                }
            }
        }
    }
}

/// Builds the page `certificate.md`.
pub fn markdown(certificate: &Certificate) -> String {
    let Certificate { platform, window, settings, machine, identity, coverage, .. } = certificate;
    let mut page = format!("# {}: servo loop at {:.0} Hz\n\n", certificate.scene, certificate.rate_hz);
    let mut say = |text: String| {
        page.push_str(&text);
        page.push('\n');
    };
    for (name, verdict, reasons) in parts(certificate) {
        say(format!("**{}: {}.** {}.\n", capitalised(name), verdict.name(), reasons.join("; ")));
    }
    if certificate.stopped {
        say("The run was stopped early; the results cover the ticks done.\n".to_owned());
    }
    say(format!(
        "{} ticks in {:.2} s, deadline {:.1} µs after each release, policy for a missed deadline: {}. Load: {}.\n",
        certificate.ticks,
        certificate.duration_s,
        certificate.deadline_us,
        certificate.overrun.name(),
        certificate.load
    ));
    say("## Coverage\n".to_owned());
    say(format!(
        "The longest pass covered {:.1} % of the scene's path. The verdicts hold only for what the window covered.\n",
        100.0 * coverage.path_share
    ));
    say("| | in the window | in one run in lockstep |\n|---|---|---|".to_owned());
    for ((what, seen), (_, expected)) in coverage.window.named().into_iter().zip(coverage.lockstep.named()) {
        say(format!("| {what} | {seen} | {expected} |"));
    }
    if let Some(global) = &certificate.global {
        say(format!(
            "\nOf {} models {} took longer than their cycle of {:.1} ms, and {} cycles had no model of their own. Models \
             came into use up to {} ticks after their boundary and were up to {} ticks old; a cycle has {} ticks.",
            global.models_built,
            global.late_models,
            global.deadline_us * 1e-3,
            global.shared_cycles,
            global.largest_latency_ticks,
            global.largest_age_ticks,
            global.ticks_per_cycle
        ));
    }
    say("\n## Times (µs)\n".to_owned());
    say("| | p50 | p90 | p99 | p99.9 | p99.99 | longest |\n|---|---|---|---|---|---|---|".to_owned());
    for row in times(certificate) {
        say(format!("| {} |", row.join(" | ")));
    }
    say(format!("\n{QUANTILES}\n"));
    say("![response over time](response.svg)\n".to_owned());
    say("![share of ticks with a longer response](distribution.svg)\n".to_owned());
    say("## Deadline misses\n".to_owned());
    say(format!(
        "{} ticks missed their deadline and {} were skipped, at most {} in a row. The control loop without a \
         payload missed {} deadlines.\n",
        platform.misses, platform.skipped, platform.longest_miss_run, platform.control.misses
    ));
    if !platform.causes.is_empty() {
        say("| cause | misses |\n|---|---|".to_owned());
        for (cause, count) in &platform.causes {
            say(format!("| {} | {count} |", cause.name()));
        }
        if platform.misses_without_cause > 0 {
            say(format!("| not examined one by one | {} |", platform.misses_without_cause));
        }
        say(String::new());
    }
    for sentence in rate_sentences(&certificate.miss_rate) {
        say(format!("- {sentence}"));
    }
    say(format!("- {}\n", tail_sentence(&certificate.extrapolation)));
    say("## Longest ticks, repeated (µs)\n".to_owned());
    say("| pass | tick | reason | response measured | CPU time measured | warm caches: median, longest \
         | cold caches: median, longest |"
        .to_owned());
    say("|---|---|---|---|---|---|---|".to_owned());
    for WorstTick { pass, tick, why, times, warm_ns, cold_ns } in &certificate.worst {
        let then = |of: fn(&crate::realtime::meter::TickTimes) -> u64| {
            times.as_ref().map_or(String::new(), |times| format!("{:.1}", us(of(times))))
        };
        let pair = |[median, longest]: [u64; 2]| format!("{:.2}, {:.2}", us(median), us(longest));
        let (response, cpu) = (then(|times| times.response_ns), then(|times| times.cpu_ns));
        say(format!(
            "| {pass} | {tick} | {} | {response} | {cpu} | {} | {} |",
            names(why),
            pair(*warm_ns),
            pair(*cold_ns)
        ));
    }
    say("\n## Effects of missed deadlines\n".to_owned());
    say(format!(
        "The scene's path in virtual time. A share of the ticks, drawn from a fixed seed, takes {} ticks each; forces \
         are compared with the run in which no tick is late. Energy given: work of the commanded force along the tip's \
         path.\n",
        certificate.consequences.late_tick_ticks
    ));
    say("| policy | late | skipped | force error (RMS) | largest force jump (N) | contact losses \
         | energy given (mJ) | fault |"
        .to_owned());
    say("|---|---|---|---|---|---|---|---|".to_owned());
    let Consequences { on_time, late, .. } = &certificate.consequences;
    for consequence in std::iter::once(on_time).chain(late) {
        let name = if consequence.share == 0.0 { "no tick is late" } else { consequence.overrun.name() };
        let error = consequence.force_error_rms_rel.map_or("–".to_owned(), |error| format!("{:.2} %", 100.0 * error));
        let [missed, skipped] = consequence.missed_ticks;
        say(format!(
            "| {name} | {missed} | {skipped} | {error} | {:.3} | {} | {:.2} | {} |",
            consequence.largest_jump_n,
            consequence.contact_losses,
            1e3 * consequence.energy_given_j,
            consequence.fault.as_deref().unwrap_or_default(),
        ));
    }
    say("\n## Settings and machine\n".to_owned());
    let unknown = |value: &Option<String>| value.clone().unwrap_or_else(|| "unknown".to_owned());
    let refused = if settings.refused.is_empty() { "nothing".to_owned() } else { settings.refused.join("; ") };
    let allocations = window.allocations.map_or("not counted".to_owned(), |calls| calls.to_string());
    let facts = [
        ("scheduling", format!("{}, priority {}", settings.policy, settings.priority)),
        ("CPUs of the thread", format!("{:?} of {}", settings.cpus, machine.cpus)),
        ("memory locked", settings.memory_locked.to_string()),
        ("idle states of the CPU (C-states)", listed(&settings.cpu.idle_states)),
        ("/dev/cpu_dma_latency (µs)", number(settings.cpu.dma_latency_us)),
        ("/dev/cpu_dma_latency held at 0", settings.cpu.is_dma_latency_held.to_string()),
        ("SMT siblings of the CPU", unknown(&settings.cpu.smt_siblings)),
        ("timer slack of the thread (ns)", number(settings.cpu.timer_slack_ns)),
        ("frequency of the CPU: before, after, limits (kHz)", settings.cpu.frequency()),
        ("requests refused", refused),
        ("allocator calls in the window", allocations),
        ("page faults", window.page_faults.to_string()),
        (
            "context switches, voluntary and involuntary",
            format!("{}, {}", window.voluntary_switches, window.involuntary_switches),
        ),
        ("messages lost to a full ring buffer", window.lost_notes.to_string()),
        ("releases that waited for a pass to be prepared", window.idle_releases.to_string()),
        ("replay commands the same forces", certificate.replayed.to_string()),
        ("processor", unknown(&machine.processor)),
        ("instruction sets", machine.cpu_features.join(", ")),
        ("hypervisor", machine.hypervisor.to_string()),
        ("steal time (units of 10 ms, as a rule)", certificate.stolen.map_or("unknown".to_owned(), |n| n.to_string())),
        ("clock source", unknown(&machine.clock_source)),
        ("frequency governor", unknown(&machine.governor)),
        ("isolated CPUs", unknown(&machine.isolated)),
        ("kernel", unknown(&machine.kernel)),
        ("host", unknown(&machine.host)),
        ("date", identity.date.clone()),
        ("version", certificate.version.to_owned()),
        ("commit", identity.commit.unwrap_or("unknown").to_owned()),
        ("program (SHA-256)", unknown(&identity.program_sha256)),
        ("scene (SHA-256)", identity.scene_sha256.clone()),
        ("mesh (SHA-256)", identity.mesh_sha256.clone()),
        ("machine (SHA-256)", identity.machine_sha256.clone()),
    ];
    say("| | |\n|---|---|".to_owned());
    for (name, value) in facts {
        say(format!("| {name} | {value} |"));
    }
    page
}

fn number(value: Option<impl ToString>) -> String {
    value.map_or("unknown".to_owned(), |value| value.to_string())
}

fn listed(values: &Option<Vec<String>>) -> String {
    values.as_ref().map_or("unknown".to_owned(), |values| values.join(", "))
}

fn capitalised(name: &str) -> String {
    let mut rest = name.chars();
    rest.next().map_or(String::new(), |first| first.to_uppercase().chain(rest).collect())
}

pub(super) fn rate_sentences(rate: &MissRate) -> Vec<String> {
    let bound = |what: &str, bound: &Option<RateBound>| match bound {
        Some(bound) => format!(
            "{what}: at most {:.1e} with {:.0} % confidence, if {}",
            bound.upper,
            100.0 * bound.confidence,
            bound.assumption
        ),
        None => format!("{what}: nothing was measured"),
    };
    let mut sentences = vec![
        bound("share of ticks that miss their deadline", &rate.ticks),
        bound(&format!("share of blocks of {} ticks with a miss", rate.block_ticks), &rate.blocks),
    ];
    let IndependenceTests { ticks, blocks, responses } = &rate.independence;
    let tests = [
        ("missed ticks", ticks, "the bound for ticks is too low: rely on the bound for blocks"),
        ("blocks with a miss", blocks, "both bounds are too low: find the cause of the cluster, or measure for longer"),
        ("longest responses of blocks", responses, "the machine changes over minutes: measure for longer"),
    ];
    for (what, test, so) in tests {
        match test {
            Some(test) if test.independent => {
                sentences.push(format!("{what} pass the test of independence (p = {:.2})", test.p_value));
            }
            Some(test) => sentences.push(format!("{what} depend on earlier ones (p = {:.1e}): {so}", test.p_value)),
            None => {}
        }
    }
    sentences.extend(rate.untested.iter().map(|reason| format!("independence was not tested for {reason}")));
    sentences
}

pub(super) fn tail_sentence(tail: &Tail) -> String {
    match tail {
        Tail::Extrapolated { levels, .. } => {
            let levels = levels
                .iter()
                .map(|level| format!("{:.0} µs once in {:.0e} ticks", level.response_ns * 1e-3, level.ticks as f64));
            format!("extrapolated from the longest responses of blocks: {}", levels.collect::<Vec<_>>().join(", "))
        }
        Tail::Refused { reasons, .. } => {
            format!("not extrapolated beyond the measured responses: {}", reasons.join("; "))
        }
    }
}

/// Draws `response.svg` and `distribution.svg` of a loop that ran for `span_s` seconds.
#[cfg(feature = "plots")]
pub fn figures(meter: &Meter, span_s: f64) -> miette::Result<Vec<(&'static str, String)>> {
    use miette::{IntoDiagnostic, WrapErr};

    use crate::output::figures::latency::{Interval, over_time, tails};

    let total: u64 = meter.blocks().iter().map(|block| block.ticks).sum();
    let mut before = 0;
    let interval = |block: &crate::realtime::meter::Block| {
        let time_s = span_s * before as f64 / total as f64;
        before += block.ticks;
        let mean = block.response_sum_ns as f64 / block.ticks as f64;
        Interval { time_s, response_us: [us(block.response_max_ns), mean * 1e-3], control_us: us(block.control_max_ns) }
    };
    let intervals: Vec<Interval> = meter.blocks().iter().map(interval).collect();
    let deadline_us = us(meter.deadline_ns());
    let in_us = |tail: Vec<(f64, f64)>| tail.into_iter().map(|(ns, share)| (ns * 1e-3, share)).collect::<Vec<_>>();
    let draw = |svg: std::io::Result<String>| svg.into_diagnostic().wrap_err("cannot draw the times of the servo loop");
    Ok(vec![
        (RESPONSE, draw(over_time(&intervals, deadline_us))?),
        (
            "distribution.svg",
            draw(tails(&in_us(meter.response.tail()), &in_us(meter.control_response.tail()), deadline_us))?,
        ),
    ])
}

/// Returns no figures, without the feature `plots`.
#[cfg(not(feature = "plots"))]
pub fn figures(_: &Meter, _: f64) -> miette::Result<Vec<(&'static str, String)>> {
    Ok(Vec::new())
}
