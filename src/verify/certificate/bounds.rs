//! Upper bounds of a rate from observed events, and a test of whether a series is independent, which
//! those bounds assume.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::beta::beta_reg;
use thiserror::Error;

/// Confidence of the bounds: the least share of experiments in which the true rate is not above them.
pub const CONFIDENCE: f64 = 0.95;
/// A series counts as independent if its p-value is above this.
pub const LEVEL: f64 = 0.01;
/// Length below which a series is not tested: the statistic is χ² distributed only in long series.
pub const SHORTEST_SERIES: usize = 50;
/// Number of trials above which the logarithms of factorials in the incomplete beta function lose too many digits.
pub const MOST_TRIALS: u64 = 1_000_000_000;
/// Number of events above which the continued fraction of the incomplete beta function is cut off before convergence.
pub const MOST_EVENTS: u64 = 1_000_000;

/// Trials to which a rate refers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trials {
    /// An event is a tick that missed its deadline.
    Ticks,
    /// An event is a block of ticks with at least one miss: valid even for misses in bursts, if these are
    /// short compared with a block.
    Blocks,
}

impl Trials {
    /// Returns the assumption of a bound on the rate.
    pub fn assumption(self) -> &'static str {
        match self {
            Trials::Ticks => "independent ticks",
            Trials::Blocks => "independent blocks",
        }
    }
}

/// A rate and its upper confidence bound.
///
/// ```
/// use stickslip::verify::certificate::bounds::{RateBound, Trials};
///
/// // No miss in a million ticks: by the rule of three the rate is not above 3 in a million.
/// let bound = RateBound::of(0, 1_000_000, Trials::Ticks).expect("there were trials");
/// assert_eq!(bound.estimate, 0.0);
/// assert!((bound.upper - (1.0 - 0.05_f64.powf(1e-6))).abs() < 1e-12 && (bound.upper - 3e-6).abs() < 1e-8);
/// assert_eq!(bound.assumption, Trials::Ticks.assumption());
/// // 10 in 100: Clopper and Pearson's bound is the p with P(X ≤ 10) = 0.05.
/// let bound = RateBound::of(10, 100, Trials::Blocks).expect("there were trials");
/// let binomial = |k: i32| {
///     let choose: f64 = (0..k).map(|i| f64::from(100 - i) / f64::from(i + 1)).product();
///     choose * bound.upper.powi(k) * (1.0 - bound.upper).powi(100 - k)
/// };
/// assert!(((0..=10).map(binomial).sum::<f64>() - 0.05).abs() < 1e-9);
/// assert_eq!(RateBound::of(2, 1, Trials::Ticks), None); // more events than trials
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RateBound {
    /// Number of events.
    pub events: u64,
    /// Number of trials.
    pub trials: u64,
    /// Estimated rate, events / trials.
    pub estimate: f64,
    /// Upper confidence bound of the rate.
    pub upper: f64,
    /// Confidence of the bound, [`CONFIDENCE`].
    pub confidence: f64,
    /// Assumption of the bound.
    pub assumption: String,
}

impl RateBound {
    /// Computes the one-sided bound of Clopper and Pearson (Biometrika 26, 1934): the rate p at which so few events
    /// have probability 1 − confidence, P(X ≤ x | n, p) = 1 − I_p(x + 1, n − x). None without trials, with more
    /// events than trials, or beyond [`MOST_TRIALS`] or [`MOST_EVENTS`], where it cannot be computed.
    pub fn of(events: u64, trials: u64, of: Trials) -> Option<Self> {
        if trials == 0 || events > trials || trials > MOST_TRIALS || events > MOST_EVENTS {
            return None;
        }
        let estimate = events as f64 / trials as f64;
        let upper = if events == trials { 1.0 } else { upper_bound(events as f64, trials as f64) };
        let assumption = of.assumption().to_owned();
        Some(Self { events, trials, estimate, upper, confidence: CONFIDENCE, assumption })
    }
}

/// Computes the bound by bisection to the last bit, 0 <= x < n. statrs 0.19 computes this quantile by Newton's method
/// from a start of at least 10⁻⁴, which does not terminate for rates far below that.
fn upper_bound(x: f64, n: f64) -> f64 {
    let (mut low, mut high) = (x / n, 1.0);
    loop {
        let middle = low + 0.5 * (high - low);
        if middle <= low || middle >= high {
            return high;
        }
        if beta_reg(x + 1.0, n - x, middle) < CONFIDENCE {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// Test of whether the values of a series depend on earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Independence {
    /// Statistic Q of Ljung and Box.
    pub statistic: f64,
    /// Number of lags.
    pub lags: usize,
    /// Probability of a Q at least as large if the series is independent.
    pub p_value: f64,
    /// Whether `p_value` is above [`LEVEL`].
    pub independent: bool,
}

/// Why a series cannot be tested for independence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "kebab-case")]
pub enum Untested {
    /// The statistic's distribution is known for long series only.
    #[error("{values} values are too few to test for independence; at least {SHORTEST_SERIES} are needed")]
    TooFew {
        /// Number of values in the series.
        values: usize,
    },
    /// The number of lags is zero, or too large for the series.
    #[error("{lags} lags cannot be tested in {values} values; choose at least one and fewer than there are values")]
    Lags {
        /// Requested number of lags.
        lags: usize,
        /// Number of values in the series.
        values: usize,
    },
    /// All values are equal, so that no correlation is defined.
    #[error("all values of the series are the same")]
    Constant,
    /// A value, or the sum of their squares, is not finite.
    #[error("the series is not finite")]
    NotFinite,
}

/// Tests independence by Q = n (n + 2) Σ ρₖ² / (n − k) over k = 1…lags, ρₖ the autocorrelations: χ² distributed with as
/// many degrees of freedom if the series is independent (Ljung and Box, Biometrika 65, 1978).
///
/// # Errors
/// If that distribution is not known or Q is not defined.
///
/// ```
/// use stickslip::verify::certificate::bounds::{Untested, ljung_box};
///
/// // ρ₁ = −0.99 of 100 alternating values: Q = n(n + 2)ρ₁²/(n − 1) = 100.98.
/// let alternating: Vec<f64> = (0..100).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let tested = ljung_box(&alternating, 1)?;
/// assert!((tested.statistic - 100.98).abs() < 1e-9 && !tested.independent);
/// assert_eq!(ljung_box(&[1.0; 100], 1), Err(Untested::Constant));
/// assert_eq!(ljung_box(&alternating[..10], 1), Err(Untested::TooFew { values: 10 }));
/// # Ok::<(), Untested>(())
/// ```
pub fn ljung_box(series: &[f64], lags: usize) -> Result<Independence, Untested> {
    let values = series.len();
    if values < SHORTEST_SERIES {
        return Err(Untested::TooFew { values });
    }
    if lags >= values {
        return Err(Untested::Lags { lags, values });
    }
    let chi_squared = ChiSquared::new(lags as f64).map_err(|_| Untested::Lags { lags, values })?;
    if series.iter().all(|value| *value == series[0]) {
        return Err(Untested::Constant);
    }
    let n = values as f64;
    let mean = series.iter().sum::<f64>() / n;
    let product = |lag: usize| series.iter().zip(&series[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    let variance = product(0);
    if !variance.is_finite() {
        return Err(Untested::NotFinite);
    }
    if !(variance > 0.0) {
        return Err(Untested::Constant);
    }
    let sum: f64 = (1..=lags).map(|lag| (product(lag) / variance).powi(2) / (n - lag as f64)).sum();
    let statistic = n * (n + 2.0) * sum;
    let p_value = chi_squared.sf(statistic);
    Ok(Independence { statistic, lags, p_value, independent: p_value > LEVEL })
}
