//! Certificates from the log of a servo loop: exactly the misses that were put into it are found.

use std::fmt::Write as _;
use std::path::Path;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use stickslip::verify::certificate::log::{LogCertificate, LogError, LoopLog, PeriodSource};
use stickslip::verify::certificate::parts::Verdict;

const PERIOD_NS: u64 = 1_000_000;

fn read(text: &str) -> Result<LoopLog, LogError> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("loop.csv");
    std::fs::write(&file, text).expect("a file");
    LoopLog::read(&file)
}

/// A log with random times within the deadline, but for the ticks that are late and those that are missing.
fn log(ticks: u64, late: &[u64], missing: &[u64]) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(17);
    let mut below = |most: u64| random.next_u64() % most;
    // The clock of another machine, in ns since 1970, and a column that is not read.
    let (first, mut text) = (1_764_598_000_123_456_789_u64, "cpu,start_ns,release_ns,end_ns\n".to_owned());
    for tick in (0..ticks).filter(|tick| !missing.contains(tick)) {
        let release = first + tick * PERIOD_NS;
        let start = release + below(50_000);
        let end = if late.contains(&tick) { release + PERIOD_NS + 1 + below(500_000) } else { start + below(900_000) };
        writeln!(text, "0,{start},{release},{end}").expect("text");
    }
    text
}

#[test]
fn exactly_the_misses_in_a_log_are_found() {
    let (late, missing) = ([100, 5000, 5001, 5002, 19_999], [777, 5003]);
    let (certificate, _) =
        LogCertificate::of(&read(&log(20_000, &late, &missing)).expect("a log"), None).expect("a period");
    let platform = &certificate.platform;
    assert_eq!((platform.misses, platform.skipped, platform.longest_miss_run), (5, 2, 4), "{platform:?}");
    assert_eq!((platform.verdict, certificate.ticks), (Verdict::Fail, 19_998));
    assert_eq!((certificate.rate_hz, certificate.rate_from), (1000.0, PeriodSource::MedianOfReleases));
    // Rows are counted without the missing tick before them.
    let rows: Vec<u64> = certificate.misses.iter().map(|miss| miss.row).collect();
    assert_eq!(rows, [100, 4999, 5000, 5001, 19_997]);
    let bound = certificate.miss_rate.ticks.expect("a bound");
    assert_eq!((bound.events, bound.trials), (7, 20_000));
    assert!(bound.upper > 7.0 / 20_000.0);
}

#[test]
fn a_log_without_misses_passes_and_a_short_one_decides_nothing() {
    let (certificate, _) =
        LogCertificate::of(&read(&log(20_000, &[], &[])).expect("a log"), Some(1000.0)).expect("its rate");
    assert_eq!((certificate.platform.verdict, certificate.rate_from), (Verdict::Pass, PeriodSource::Stated));
    assert_eq!((certificate.platform.misses, certificate.platform.skipped), (0, 0));
    let (certificate, _) = LogCertificate::of(&read(&log(999, &[], &[])).expect("a log"), None).expect("a period");
    assert_eq!(certificate.platform.verdict, Verdict::Inconclusive);
    // An end exactly at the deadline is in time, and a nanosecond later it is not.
    for (end, misses) in [(PERIOD_NS, 0), (PERIOD_NS + 1, 1)] {
        let text = format!("release_ns,start_ns,end_ns\n0,0,{end}\n{PERIOD_NS},{PERIOD_NS},{PERIOD_NS}\n");
        let (certificate, _) = LogCertificate::of(&read(&text).expect("a log"), None).expect("a period");
        assert_eq!(certificate.platform.misses, misses, "{end} ns");
    }
}

#[test]
fn bad_logs_are_refused_with_their_line() {
    let head = "release_ns,start_ns,end_ns\n";
    for (rows, expected) in [
        ("0,1,2\n1000,1x,1200\n", "line 3: `1x` is not a whole number"),
        ("0,1,2\n1000,1001,1.2e3\n", "line 3: `1.2e3` is not a whole number"),
        ("0,1,2\n1000,999,1200\n", "line 3: start and release: 999 ns is not at or after 1000 ns"),
        ("0,1,2\n1000,1001,1000\n", "line 3: end and start: 1000 ns is not at or after 1001 ns"),
        ("5,6,7\n5,6,7\n", "line 3: the release and that of the row before: 5 ns is not after 5 ns"),
        ("0,1,2\n", "the log has 1 ticks; at least two are needed"),
    ] {
        let error = read(&format!("{head}{rows}")).expect_err(rows);
        assert_eq!(error.to_string(), expected);
    }
    let error = read("release,start,end\n0,1,2\n").expect_err("other columns");
    assert_eq!(error.to_string(), "there is no column `release_ns` in its header `release,start,end`");
    assert!(LoopLog::read(Path::new("no-such-log.csv")).is_err());
    // A clock that jumps by hours is no loop that skips ticks.
    let paused =
        read(&format!("{head}0,1,2\n1000,1001,1002\n2000,2001,2002\n9000000000000,9000000000000,9000000000000\n"));
    assert!(matches!(LogCertificate::of(&paused.expect("a log"), None), Err(LogError::Pause { line: 5, .. })));
}
