//! Certificate from the log of a servo loop that this program did not run: the platform part and its statistics. There is no
//! compute part, as such a log shows neither CPU times nor what was computed.

use std::path::Path;

use miette::Diagnostic;
use serde::Serialize;
use thiserror::Error;

use super::parts::{LEAST_TICKS, Verdict, judge};
use super::tail::Tail;
use super::verdict::{MissRate, block_maxima};
use crate::device::path::PathError;
use crate::device::recording::{find_columns, line, number};
use crate::realtime::meter::{Meter, Miss, TickTimes};
use crate::realtime::record::Quantiles;

/// Columns of a log: scheduled release, begin and end of each tick, ns.
const COLUMNS: [&str; 3] = ["release_ns", "start_ns", "end_ns"];
/// Largest relative difference between the median of the releases' distances and a stated period. A clock or a timer is off
/// by far less; times in another unit by far more.
const OTHER_PERIOD: f64 = 0.1;

/// Number of periods without a tick from which the loop was not running, as nothing that skips ticks does so for so long.
const PAUSE_PERIODS: u64 = 1_000_000;

/// What is wrong with a log.
#[derive(Debug, Error, Diagnostic)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be read, or has no such column.
    #[error(transparent)]
    #[diagnostic(help(
        "give a CSV file with the header `release_ns,start_ns,end_ns` and whole numbers, in ns of one clock"
    ))]
    Table(#[from] PathError),
    /// A time is no whole number.
    #[error("line {line}: `{text}` is not a whole number")]
    #[diagnostic(help("give all times in ns, without a decimal point or an exponent"))]
    NotWhole {
        /// Line of the file, from 1.
        line: u64,
        /// What stands in place of the time.
        text: String,
    },
    /// A time is before one that it cannot precede.
    #[error("line {line}: {what}: {time} ns is not {than} {other} ns")]
    #[diagnostic(help("sort the rows by `release_ns`, and take all three times from one clock"))]
    Order {
        /// Line of the file, from 1.
        line: u64,
        /// Which times are out of order.
        what: &'static str,
        /// The time, ns.
        time: i64,
        /// The order that is needed.
        than: &'static str,
        /// The other time, ns.
        other: i64,
    },
    /// There are less than two ticks.
    #[error("the log has {ticks} ticks; at least two are needed")]
    #[diagnostic(help("give one row for each tick"))]
    TooShort {
        /// Number of ticks.
        ticks: usize,
    },
    /// The log has a pause.
    #[error("line {line}: the release is {distance_s} s after that of the row before")]
    #[diagnostic(help("judge the parts before and after the pause each for itself"))]
    Pause {
        /// Line of the file, from 1.
        line: u64,
        /// Distance of the releases, s.
        distance_s: f64,
    },
    /// The releases have another period than stated.
    #[error("the releases are {median_ns} ns apart, as a median, and not the {period_ns} ns of {rate_hz} Hz")]
    #[diagnostic(help("give the rate of the log, or convert its times to ns"))]
    OtherRate {
        /// Median distance of the releases, ns.
        median_ns: u64,
        /// Stated period, ns.
        period_ns: u64,
        /// Stated rate, Hz.
        rate_hz: f64,
    },
}

/// Times of a tick, ns.
#[derive(Debug, Clone, Copy)]
struct LoggedTick {
    /// Line of the file.
    line: u64,
    release: i64,
    start: i64,
    end: i64,
}

/// Log of a servo loop, in the order of its releases.
#[derive(Debug, Clone)]
pub struct LoopLog {
    ticks: Vec<LoggedTick>,
}

impl LoopLog {
    /// Reads a log.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, has anything but whole numbers in it, or times out of order; the error names
    /// the line.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let unreadable = |error| PathError::Unreadable { path: path.to_owned(), error };
        let file = std::fs::File::open(path).map_err(unreadable)?;
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file);
        let columns = find_columns(reader.headers().map_err(PathError::from)?, COLUMNS)?;
        let mut ticks: Vec<LoggedTick> = Vec::new();
        for row in reader.records() {
            let row = row.map_err(PathError::from)?;
            let whole = |column| {
                number::<i64>(&row, column).map_err(|error| match error {
                    PathError::NotANumber { line, text } => LogError::NotWhole { line, text },
                    other => other.into(),
                })
            };
            let [release, start, end] = columns.map(whole);
            let (release, start, end) = (release?, start?, end?);
            let order = |what, time, than, other| LogError::Order { line: line(&row), what, time, than, other };
            if let Some(before) = ticks.last().filter(|before| release <= before.release) {
                return Err(order("the release and that of the row before", release, "after", before.release));
            }
            if start < release {
                return Err(order("start and release", start, "at or after", release));
            }
            if end < start {
                return Err(order("end and start", end, "at or after", start));
            }
            ticks.push(LoggedTick { line: line(&row), release, start, end });
        }
        if ticks.len() < 2 {
            return Err(LogError::TooShort { ticks: ticks.len() });
        }
        Ok(Self { ticks })
    }

    /// Returns the median distance of two releases, ns.
    fn median_period_ns(&self) -> u64 {
        let mut steps: Vec<u64> = self.ticks.windows(2).map(|pair| pair[1].release.abs_diff(pair[0].release)).collect();
        let middle = steps.len() / 2;
        *steps.select_nth_unstable(middle).1
    }

    /// Returns the measurements of the log, with this period as the deadline. Releases that are missing between two rows count
    /// as skipped ticks.
    fn meter(&self, period_ns: u64) -> Meter {
        let first = self.ticks[0].release;
        let all = self.ticks[self.ticks.len() - 1].release.abs_diff(first) / period_ns + 1;
        let mut meter = Meter::new(all.max(self.ticks.len() as u64), period_ns);
        let mut last: Option<u64> = None;
        for (tick, &LoggedTick { release, start, end, .. }) in self.ticks.iter().enumerate() {
            let at_ns = release.abs_diff(first);
            if let Some(last) = last {
                // Half a period is nearer to the next release than to this one.
                let periods = (at_ns - last + period_ns / 2) / period_ns;
                (1..periods).for_each(|skipped| meter.skip(last + skipped * period_ns));
            }
            last = Some(at_ns);
            let times = TickTimes {
                tick: tick as u64,
                release_ns: start.abs_diff(release),
                response_ns: end.abs_diff(release),
                compute_ns: end.abs_diff(start),
                ..TickTimes::default()
            };
            meter.tick(times, at_ns);
        }
        meter
    }
}

/// Where the period of a log comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PeriodSource {
    /// It was stated.
    Stated,
    /// It is the median distance of the log's releases.
    MedianOfReleases,
}

/// Deadline miss of a log.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct LoggedMiss {
    /// Number of the row, from 0.
    pub row: u64,
    /// Release after the first one, s.
    pub at_s: f64,
    /// Time from release to start, ns.
    pub release_ns: u64,
    /// Time from release to end, ns.
    pub response_ns: u64,
    /// Time from start to end, ns.
    pub compute_ns: u64,
}

/// Platform part of a log's certificate.
#[derive(Debug, Clone, Serialize)]
pub struct LoggedPlatform {
    /// Whether every tick of the log met its deadline.
    pub verdict: Verdict,
    /// Reasons for the verdict.
    pub reasons: Vec<String>,
    /// Number of ticks that ended after their deadline.
    pub misses: u64,
    /// Number of these, among the first 4096, whose time from start to end alone exceeds the deadline: the others began late.
    pub misses_by_duration: u64,
    /// Number of releases that are missing in the log.
    pub skipped: u64,
    /// Largest number of consecutive late or skipped ticks.
    pub longest_miss_run: u64,
    /// Time from release to end, ns; for a skipped tick, to the end of the next one.
    pub response_ns: Quantiles,
    /// Time from release to start, ns.
    pub release_ns: Quantiles,
    /// Time from start to end, ns.
    pub compute_ns: Quantiles,
}

/// Certificate from a log, the content of `certificate.json` in that case.
#[derive(Debug, Clone, Serialize)]
pub struct LogCertificate {
    /// Version of the program.
    pub version: &'static str,
    /// Number of ticks in the log.
    pub ticks: u64,
    /// Time from the first release to the last, and one period, s.
    pub duration_s: f64,
    /// Rate of the loop, Hz.
    pub rate_hz: f64,
    /// Where that rate comes from.
    pub rate_from: PeriodSource,
    /// Deadline from a tick's release, µs: the period.
    pub deadline_us: f64,
    /// Verdict on the commands of the loop.
    pub platform: LoggedPlatform,
    /// Bounds of the rate of deadline misses.
    pub miss_rate: MissRate,
    /// Extrapolation of the longest response to longer runs.
    pub extrapolation: Tail,
    /// First 4096 misses.
    pub misses: Vec<LoggedMiss>,
}

impl LogCertificate {
    /// Judges a log, and returns its measurements too. The deadline is the period of `rate_hz`, or else the median distance of
    /// the releases.
    ///
    /// # Errors
    /// If the log has another period than stated, or a pause of a million periods.
    ///
    /// ```
    /// use stickslip::verify::certificate::{log::{LogCertificate, LoopLog, PeriodSource}, parts::Verdict};
    ///
    /// // 2000 ticks at 1 kHz, of which one ends 1.2 ms after its release, and one is not there.
    /// let mut text = String::from("release_ns,start_ns,end_ns\n");
    /// for tick in (0..2001).filter(|tick| *tick != 1500) {
    ///     let release = 1_000_000 * tick;
    ///     let took = if tick == 700 { 1_200_000 } else { 50_000 };
    ///     text += &format!("{release},{},{}\n", release + 5_000, release + took);
    /// }
    /// let folder = tempfile::tempdir()?;
    /// let file = folder.path().join("loop.csv");
    /// std::fs::write(&file, text)?;
    /// let (certificate, _) = LogCertificate::of(&LoopLog::read(&file)?, None)?;
    /// assert_eq!((certificate.rate_hz, certificate.rate_from), (1000.0, PeriodSource::MedianOfReleases));
    /// let platform = &certificate.platform;
    /// assert_eq!((platform.verdict, platform.misses, platform.skipped), (Verdict::Fail, 1, 1));
    /// assert_eq!(certificate.misses[0].row, 700);
    /// assert!(LogCertificate::of(&LoopLog::read(&file)?, Some(1e6)).is_err()); // as for times in another unit
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn of(log: &LoopLog, rate_hz: Option<f64>) -> Result<(Self, Meter), LogError> {
        let median_ns = log.median_period_ns();
        let (period_ns, rate_hz, rate_from) = match rate_hz {
            None => (median_ns, 1e9 / median_ns as f64, PeriodSource::MedianOfReleases),
            Some(rate_hz) => {
                let period_ns = (1e9 / rate_hz).round().max(1.0) as u64;
                if !((median_ns as f64 / period_ns as f64 - 1.0).abs() <= OTHER_PERIOD) {
                    return Err(LogError::OtherRate { median_ns, period_ns, rate_hz });
                }
                (period_ns, rate_hz, PeriodSource::Stated)
            }
        };
        let paused = |pair: &&[LoggedTick]| pair[1].release.abs_diff(pair[0].release) / period_ns >= PAUSE_PERIODS;
        if let Some([before, after]) = log.ticks.windows(2).find(paused) {
            let distance_s = after.release.abs_diff(before.release) as f64 * 1e-9;
            return Err(LogError::Pause { line: after.line, distance_s });
        }
        let meter = log.meter(period_ns);
        let (maxima_ns, block_ticks) = block_maxima(&meter);
        let span_ns = log.ticks[log.ticks.len() - 1].release.abs_diff(log.ticks[0].release);
        let logged = |miss: &Miss| LoggedMiss {
            row: miss.times.tick,
            at_s: miss.at_ns as f64 * 1e-9,
            release_ns: miss.times.release_ns,
            response_ns: miss.times.response_ns,
            compute_ns: miss.times.compute_ns,
        };
        let misses: Vec<LoggedMiss> = meter.misses().iter().map(logged).collect();
        let certificate = Self {
            version: env!("CARGO_PKG_VERSION"),
            ticks: meter.ticks(),
            duration_s: (span_ns + period_ns) as f64 * 1e-9,
            rate_hz,
            rate_from,
            deadline_us: period_ns as f64 * 1e-3,
            platform: platform(&meter, &misses),
            miss_rate: MissRate::of(&meter, &maxima_ns, block_ticks),
            extrapolation: Tail::of_block_maxima(&maxima_ns, block_ticks),
            misses,
        };
        Ok((certificate, meter))
    }
}

/// Judges the responses of a log.
fn platform(meter: &Meter, misses: &[LoggedMiss]) -> LoggedPlatform {
    // Of more misses than are kept one by one, those beyond are not told apart.
    let misses_by_duration = misses.iter().filter(|miss| miss.compute_ns > meter.deadline_ns()).count() as u64;
    let (mut failed, mut open, mut passed) = (Vec::new(), Vec::new(), Vec::new());
    match meter.missed() {
        0 => passed.push(format!("no deadline missed in {} ticks", meter.ticks())),
        missed => failed.push(format!(
            "{missed} of {} ticks missed their deadline; {misses_by_duration} of them took longer than it from start to end, \
             and the others began late",
            meter.ticks()
        )),
    }
    match meter.skipped() {
        0 => passed.push("no release is missing".to_owned()),
        skipped => failed.push(format!("ticks whose release is missing, and which were skipped: {skipped}")),
    }
    if meter.ticks() < LEAST_TICKS {
        open.push(format!("{} ticks are too few; at least {LEAST_TICKS} are needed", meter.ticks()));
    }
    passed.push("scheduling, memory and page faults are not in the log, and not judged".to_owned());
    let (verdict, reasons) = judge(failed, open, passed);
    LoggedPlatform {
        verdict,
        reasons,
        misses: meter.missed(),
        misses_by_duration,
        skipped: meter.skipped(),
        longest_miss_run: meter.longest_run(),
        response_ns: Quantiles::of(&meter.response),
        release_ns: Quantiles::of(&meter.release),
        compute_ns: Quantiles::of(&meter.compute),
    }
}
