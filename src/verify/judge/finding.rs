//! What does not fit between a force trace and its scene: time, rate, unit, sign and lag.

use std::fmt;

use serde::{Serialize, Serializer, ser::SerializeStruct};

use super::percent;
use super::trace::ForceTrace;
use crate::output::summary::Sample;
use crate::scene::Scene;

/// Steps longer than this many medians are gaps.
const GAP: f64 = 1.5;
/// Relative difference of the median step and the tick from which the rates differ; a logger's clock drifts by less.
const OTHER_RATE: f64 = 0.01;
/// Longest lag that is looked for, s.
const LONGEST_LAG_S: f64 = 0.05;
/// Share of the error that has to remain at most without the lag: else the lag is not what makes the error.
const LAG_EXPLAINS: f64 = 0.5;
/// Relative distance of the best factor from one that a wrong unit or sign gives.
const NEAR_UNIT: f64 = 0.05;

/// Factors on a trace that correct its unit or sign, and what they mean.
const UNITS: [(f64, &str); 5] = [
    (1e-3, "its forces seem to be in mN"),
    (1e3, "its forces seem to be in kN"),
    (-1.0, "its forces seem to be those on the body, which are minus those on the instrument"),
    (-1e-3, "its forces seem to be in mN, and those on the body instead of those on the instrument"),
    (-1e3, "its forces seem to be in kN, and those on the body instead of those on the instrument"),
];

/// Something that does not fit between a trace and its scene. It prints as a sentence with the remedy; in JSON it has a
/// `code` and this `message`.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Finding {
    /// The reference ended in a fault.
    ReferenceFault {
        /// The fault.
        fault: String,
    },
    /// The trace lacks ticks of the scene.
    Shorter {
        /// Number of ticks of the scene beyond the trace.
        missing_ticks: usize,
        /// Number of ticks of the scene.
        scene_ticks: u64,
        /// Times of the first and the last tick compared, s.
        compared_s: [f64; 2],
    },
    /// The trace begins before the scene or ends after it.
    Longer {
        /// Times of the first and the last row, s.
        trace_s: [f64; 2],
        /// Duration of the scene, s.
        duration_s: f64,
    },
    /// The rows have another rate than the scene's ticks.
    OtherRate {
        /// Rate of the rows, Hz: 1 over their median step.
        trace_hz: f64,
        /// Rate of the ticks, Hz.
        scene_hz: f64,
    },
    /// Rows of the scene's rate lie between ticks.
    BetweenTicks {
        /// Number of ticks without a row of their own.
        ticks: usize,
    },
    /// Rows are missing.
    Gaps {
        /// Number of gaps.
        count: usize,
        /// Length of the longest one, s.
        longest_s: f64,
    },
    /// The trace seems to have another unit or sign.
    Unit {
        /// Factor that corrects it.
        factor: f64,
        /// What the factor means.
        meaning: &'static str,
        /// Factor at which the error is least.
        best_scale: f64,
    },
    /// The trace is late, or early if this is negative.
    Lag {
        /// Lag in whole ticks.
        ticks: i64,
        /// Lag, s.
        lag_s: f64,
        /// Force error without it.
        error_without: f64,
    },
}

impl Finding {
    /// Returns the code of the finding.
    pub fn code(&self) -> &'static str {
        match self {
            Finding::ReferenceFault { .. } => "reference-fault",
            Finding::Shorter { .. } => "shorter",
            Finding::Longer { .. } => "longer",
            Finding::OtherRate { .. } => "other-rate",
            Finding::BetweenTicks { .. } => "between-ticks",
            Finding::Gaps { .. } => "gaps",
            Finding::Unit { .. } => "unit",
            Finding::Lag { .. } => "lag",
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Finding::ReferenceFault { fault } => {
                write!(f, "the reference ended in a fault, and has no force after it: {fault}")
            }
            Finding::Shorter { missing_ticks, scene_ticks, compared_s: [from, to] } => write!(
                f,
                "the trace is shorter than the scene: {missing_ticks} of {scene_ticks} ticks are missing; compared are \
                 {from:.3} s to {to:.3} s"
            ),
            Finding::Longer { trace_s: [from, to], duration_s } => write!(
                f,
                "the trace, from {from:.3} s to {to:.3} s, is longer than the scene, from 0 s to {duration_s} s; the rest of \
                 it is not compared"
            ),
            Finding::OtherRate { trace_hz, scene_hz } => write!(
                f,
                "the trace has {trace_hz:.0} rows per second and the scene {scene_hz:.0} ticks; its force at each tick is \
                 interpolated linearly"
            ),
            Finding::BetweenTicks { ticks } => write!(
                f,
                "{ticks} ticks have no row at their end; the force there is interpolated linearly between rows"
            ),
            Finding::Gaps { count, longest_s } => write!(
                f,
                "the trace has {count} gaps, the longest of {:.1} ms; its force is interpolated linearly across them",
                1e3 * longest_s
            ),
            Finding::Unit { factor, meaning, best_scale } => write!(
                f,
                "{meaning}: the error is least with a factor of {best_scale:.4}; give a scale that is {factor} times the \
                 present one"
            ),
            Finding::Lag { ticks, lag_s, error_without } => {
                let (count, way) = (ticks.abs(), if *ticks > 0 { "late" } else { "early" });
                let plural = if count == 1 { "" } else { "s" };
                write!(
                    f,
                    "the trace is {count} tick{plural} ({:.3} ms) {way}, by the largest correlation in whole ticks; without \
                     this lag the force error is {}; if the lag is one of clocks, add a time offset of {} s",
                    1e3 * lag_s.abs(),
                    percent(*error_without),
                    -lag_s
                )
            }
        }
    }
}

impl Serialize for Finding {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut finding = serializer.serialize_struct("Finding", 2)?;
        finding.serialize_field("code", self.code())?;
        finding.serialize_field("message", &self.to_string())?;
        finding.end()
    }
}

/// A trace and its reference over the ticks that both have.
pub struct Compared<'a> {
    pub trace: &'a ForceTrace,
    pub scene: &'a Scene,
    /// Number of ticks of the scene that were not compared.
    pub missing_ticks: usize,
    /// Times of the first and the last tick compared, s.
    pub compared_s: [f64; 2],
    /// Number of compared ticks whose force was interpolated.
    pub interpolated: usize,
    /// Ticks of the trace.
    pub own: &'a [Sample],
    /// Those ticks of the reference.
    pub reference: &'a [Sample],
    /// Relative force error.
    pub error: f64,
}

/// How a trace fits best.
pub struct Fit {
    pub lag_ticks: i64,
    pub error_without_lag: f64,
    pub best_scale: f64,
    /// Duration of the gaps beyond their regular step, in ticks.
    pub ticks_in_gaps: f64,
}

/// Finds what does not fit, in the order in which it is to be corrected.
pub fn findings(compared: &Compared, fault: Option<&str>) -> (Vec<Finding>, Fit) {
    let Compared { trace, scene, missing_ticks, compared_s, interpolated, own, reference, error } = *compared;
    let (tick_s, duration_s) = (scene.tick_s(), scene.duration_s());
    let mut found: Vec<Finding> =
        fault.map(|fault| Finding::ReferenceFault { fault: fault.to_owned() }).into_iter().collect();
    if missing_ticks > 0 {
        found.push(Finding::Shorter { missing_ticks, scene_ticks: scene.tick_count(), compared_s });
    }
    // A first row at 0 s is the state before the first tick.
    let trace_s = trace.span_s();
    if trace_s[0] < -0.5 * tick_s || trace_s[1] > duration_s + 0.5 * tick_s {
        found.push(Finding::Longer { trace_s, duration_s });
    }
    if !((trace.step_s() / tick_s - 1.0).abs() <= OTHER_RATE) {
        found.push(Finding::OtherRate { trace_hz: 1.0 / trace.step_s(), scene_hz: scene.local_rate_hz() });
    } else if interpolated > 0 {
        found.push(Finding::BetweenTicks { ticks: interpolated });
    }
    let gaps = trace.gaps_s(GAP, compared_s);
    if !gaps.is_empty() {
        let longest_s = gaps.iter().copied().fold(0.0, f64::max);
        found.push(Finding::Gaps { count: gaps.len(), longest_s });
    }
    let ticks_in_gaps = gaps.iter().map(|gap| (gap - trace.step_s()) / tick_s).sum();

    let best_scale = product(own, reference) / product(own, own);
    let unit = UNITS.into_iter().find(|(factor, _)| (best_scale / factor - 1.0).abs() <= NEAR_UNIT);
    if let Some((factor, meaning)) = unit {
        found.push(Finding::Unit { factor, meaning, best_scale });
    }
    let factor = unit.map_or(1.0, |(factor, _)| factor);
    let lag_ticks = lag(own, reference, (LONGEST_LAG_S / tick_s).round() as i64);
    let error_at = |lag: i64| {
        let (own, reference) = overlap(own, reference, lag);
        let square: f64 =
            own.iter().zip(reference).map(|(own, other)| (own.force * factor - other.force).norm_squared()).sum();
        (square / product(reference, reference)).sqrt()
    };
    let error_without_lag = error_at(lag_ticks);
    if lag_ticks != 0 && error > 0.0 && error_without_lag <= LAG_EXPLAINS * error_at(0) {
        found.push(Finding::Lag {
            ticks: lag_ticks,
            lag_s: lag_ticks as f64 * tick_s,
            error_without: error_without_lag,
        });
    }
    (found, Fit { lag_ticks, error_without_lag, best_scale, ticks_in_gaps })
}

/// Returns Σ f·g.
fn product(a: &[Sample], b: &[Sample]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.force.dot(&b.force)).sum()
}

/// Returns the parts of a trace and its reference that lie over each other when the trace is `lag` ticks late.
fn overlap<'a>(own: &'a [Sample], reference: &'a [Sample], lag: i64) -> (&'a [Sample], &'a [Sample]) {
    let by = lag.unsigned_abs() as usize;
    if lag >= 0 { (&own[by..], &reference[..reference.len() - by]) } else { (&own[..own.len() - by], &reference[by..]) }
}

/// Returns the lag in whole ticks at which the correlation |Σ f·g| / √(Σ f² Σ g²) is largest; the smallest of equal ones.
/// It is 1 where both are proportional, so that a wrong unit or sign does not matter.
fn lag(own: &[Sample], reference: &[Sample], longest: i64) -> i64 {
    let longest = longest.min(own.len() as i64 / 2);
    let correlation = |lag: i64| {
        let (own, reference) = overlap(own, reference, lag);
        product(own, reference).abs() / (product(own, own) * product(reference, reference)).sqrt()
    };
    let lags = std::iter::once(0).chain((1..=longest).flat_map(|lag| [lag, -lag]));
    let (mut best, mut largest) = (0, 0.0);
    for lag in lags {
        let value = correlation(lag);
        if value > largest {
            (best, largest) = (lag, value);
        }
    }
    best
}
