//! How high a rate may be, given how often something was seen, and whether a series is independent, which
//! those bounds assume.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::beta::beta_reg;
use thiserror::Error;

/// Of the bounds: the share of experiments in which the true rate is not above them, at least.
pub const CONFIDENCE: f64 = 0.95;
/// A series is called independent unless its p-value is at or below this.
pub const LEVEL: f64 = 0.01;
/// A shorter series is not tested: the χ² distribution of the statistic is that of long ones.
pub const SHORTEST_SERIES: usize = 50;
/// With more trials the logarithms of factorials in the incomplete beta function leave it too few digits.
pub const MOST_TRIALS: u64 = 1_000_000_000;
/// With more events the continued fraction of the incomplete beta function is cut off before it has converged.
pub const MOST_EVENTS: u64 = 1_000_000;

/// What a rate is a share of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trials {
    /// An event is a tick that missed its deadline.
    Ticks,
    /// An event is a block of ticks with at least one miss: right even where misses come in bursts, if those are
    /// short against a block.
    Blocks,
}

impl Trials {
    /// What has to hold for a bound on their rate.
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
/// // No miss in a million ticks: the rule of three says not more than 3 in a million.
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
    /// How often it was seen.
    pub events: u64,
    /// How often it could have been.
    pub trials: u64,
    /// events / trials.
    pub estimate: f64,
    /// The rate is not above it.
    pub upper: f64,
    /// [`CONFIDENCE`].
    pub confidence: f64,
    /// What the bound takes for granted.
    pub assumption: String,
}

impl RateBound {
    /// The one-sided bound of Clopper and Pearson (Biometrika 26, 1934): the rate p at which so few events have
    /// probability 1 − confidence, P(X ≤ x | n, p) = 1 − I_p(x + 1, n − x). None without trials, with more
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

/// Bisection down to the last bit, 0 <= x < n. The quantile of statrs 0.19 for the same is Newton's method from no less
/// than 10⁻⁴, and does not come to an end for rates far below that.
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

/// Whether the values of a series depend on those before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Independence {
    /// Q of Ljung and Box.
    pub statistic: f64,
    /// How far back was looked.
    pub lags: usize,
    /// Probability of a Q at least as large if the series is independent.
    pub p_value: f64,
    /// `p_value` is above [`LEVEL`].
    pub independent: bool,
}

/// Why a series cannot be tested for independence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "kebab-case")]
pub enum Untested {
    /// The statistic's distribution is known for long series only.
    #[error("{values} values are too few to test for independence; at least {SHORTEST_SERIES} are needed")]
    TooFew {
        /// In the series.
        values: usize,
    },
    /// There is no such distance between values.
    #[error("{lags} lags cannot be tested in {values} values; choose at least one and fewer than there are values")]
    Lags {
        /// As asked for.
        lags: usize,
        /// In the series.
        values: usize,
    },
    /// Nothing varies, so nothing can be correlated.
    #[error("all values of the series are the same")]
    Constant,
    /// A value, or the sum of their squares, is not a number that a computer can hold.
    #[error("the series is not finite")]
    NotFinite,
}

/// Q = n (n + 2) Σ ρₖ² / (n − k) over k = 1…lags, ρₖ the autocorrelations: χ² distributed with as many degrees of
/// freedom if the series is independent (Ljung and Box, Biometrika 65, 1978).
///
/// # Errors
/// Where that distribution is not known or Q is not defined.
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
