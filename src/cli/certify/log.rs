//! `stickslip certify --times`: the log of another servo loop.

use std::path::{Path, PathBuf};

use miette::miette;
use serde::Serialize;

use super::page;
use crate::cli::exit_code;
use crate::cli::junit::{JunitArguments, JunitCase, JunitSuite};
use crate::cli::terminal::{hand_out, say, significant};
use crate::output::files::{write_file, write_json};
use crate::output::folder::{ResultFolder, sha256};
use crate::verify::certificate::log::{LogCertificate, LoopLog, PeriodSource};

/// Contents of `certificate.json` for a log.
#[derive(Serialize)]
struct LogFile {
    log: PathBuf,
    log_sha256: Option<String>,
    #[serde(flatten)]
    certificate: LogCertificate,
}

/// Judges a log and writes its certificate.
pub fn certify(log: &Path, rate_hz: Option<f64>, out: Option<&Path>, junit: &JunitArguments) -> miette::Result<u8> {
    if let Some(rate) = rate_hz.filter(|rate| !(*rate > 0.0 && rate.is_finite())) {
        return Err(miette!(help = "give the rate of the loop in Hz, above 0", "--rate {rate} is not possible"));
    }
    let (certificate, meter) = LogCertificate::of(&LoopLog::read(log)?, rate_hz)?;
    let out = out.map_or_else(|| Path::new("reports").join(log.file_stem().unwrap_or(log.as_os_str())), Path::to_owned);
    junit.prepare()?;
    let folder = ResultFolder::take(&out)?;
    // A session, if there is one, belongs to the certificate of a scene.
    folder.clear(&["certificate.json", "certificate.md", "session.json"])?;
    let file = LogFile { log: log.to_owned(), log_sha256: sha256(log).ok(), certificate };
    for (name, svg) in page::figures(&meter, file.certificate.duration_s)? {
        write_file(&out.join(name), svg.as_bytes())?;
    }
    write_file(&out.join("certificate.md"), markdown(&file).as_bytes())?;
    write_json(&out.join("certificate.json"), &file)?;
    junit.write(|| {
        let platform = &file.certificate.platform;
        let case = JunitCase {
            name: "platform".to_owned(),
            class: format!("stickslip.certify.{}", log.display()),
            seconds: Some(file.certificate.duration_s),
            verdict: platform.verdict,
            reasons: platform.reasons.clone(),
        };
        JunitSuite { name: "stickslip certify", cases: vec![case] }
    })?;
    hand_out(&file)?;
    let LogCertificate { platform, .. } = &file.certificate;
    say(format_args!("platform: {}: {}", platform.verdict.name(), platform.reasons.join("; ")))?;
    say(heading(&file.certificate))?;
    say(page::line("release to start", &platform.release_ns))?;
    say(page::line("start to end    ", &platform.compute_ns))?;
    say(page::line("response        ", &platform.response_ns))?;
    say(format_args!("certificate: {}", out.join("certificate.md").display()))?;
    Ok(exit_code(platform.verdict))
}

/// Returns the log's size, rate and deadline as a sentence.
fn heading(certificate: &LogCertificate) -> String {
    let from = match certificate.rate_from {
        PeriodSource::Stated => "as stated",
        PeriodSource::MedianOfReleases => "the median of its releases",
    };
    format!(
        "{} ticks at {} Hz ({from}) in {:.2} s, deadline {} µs after each release: the period",
        certificate.ticks,
        significant(certificate.rate_hz),
        certificate.duration_s,
        significant(certificate.deadline_us)
    )
}

/// Builds the page `certificate.md`.
fn markdown(file: &LogFile) -> String {
    let LogFile { log, log_sha256, certificate } = file;
    let platform = &certificate.platform;
    let mut lines = vec![
        format!("# {}: log of a servo loop\n", log.display()),
        format!("**Platform: {}.** {}.\n", platform.verdict.name(), platform.reasons.join("; ")),
        format!("{}.\n", heading(certificate)),
        "The log has no CPU times and does not show what was computed, so there is no compute part.\n".to_owned(),
        "## Times (µs)\n".to_owned(),
        "| | p50 | p90 | p99 | p99.9 | p99.99 | longest |\n|---|---|---|---|---|---|---|".to_owned(),
    ];
    let times = [
        ("release to start", &platform.release_ns),
        ("start to end", &platform.compute_ns),
        ("release to end (response)", &platform.response_ns),
    ];
    lines.extend(page::quantile_rows(times).iter().map(|row| format!("| {} |", row.join(" | "))));
    lines.push(format!("\n{}\n", page::QUANTILES));
    lines.push(format!("![response over time]({})\n", page::RESPONSE));
    lines.push("![share of ticks with a longer response](distribution.svg)\n".to_owned());
    lines.push("## Deadline misses\n".to_owned());
    lines.push(format!(
        "{} ticks missed their deadline and {} were skipped, at most {} in a row.\n",
        platform.misses, platform.skipped, platform.longest_miss_run
    ));
    lines.extend(page::rate_sentences(&certificate.miss_rate).iter().map(|sentence| format!("- {sentence}")));
    lines.push(format!("- {}\n", page::tail_sentence(&certificate.extrapolation)));
    lines.push(format!(
        "Log: SHA-256 {}; version {}.\n",
        log_sha256.as_deref().unwrap_or("unknown"),
        certificate.version
    ));
    lines.join("\n")
}
