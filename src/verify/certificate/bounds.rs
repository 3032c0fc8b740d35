//! Upper bounds of a rate from observed events, and tests of whether events and values are independent of earlier ones,
//! which those bounds assume.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};
use statrs::function::beta::beta_reg;
use statrs::function::factorial::ln_binomial;
use thiserror::Error;

/// Confidence of the bounds: the least share of experiments in which the true rate is not above them.
pub const CONFIDENCE: f64 = 0.95;
/// A series counts as independent if its p-value is above this.
pub const LEVEL: f64 = 0.01;
/// Length below which a series is not tested: the statistic is χ² distributed only in long series.
pub const SHORTEST_SERIES: usize = 50;
/// Largest count of the rarer outcome for which the distribution of runs is summed exactly.
pub const MOST_EXACT: u64 = 1000;
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

/// Result of a test of whether later events or values depend on earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Independence {
    /// Statistic of the test.
    pub statistic: f64,
    /// Probability of a statistic at least as extreme if the series is independent.
    pub p_value: f64,
    /// Whether `p_value` is above [`LEVEL`].
    pub independent: bool,
}

impl Independence {
    fn new(statistic: f64, p_value: f64) -> Self {
        Self { statistic, p_value, independent: p_value > LEVEL }
    }
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
    #[error("{lags} lags cannot be tested in {values} values; choose at least one and at most half as many as values")]
    Lags {
        /// Requested number of lags.
        lags: usize,
        /// Number of values in the series.
        values: usize,
    },
    /// All values are equal, so that no correlation is defined.
    #[error("all values of the series are the same")]
    Constant,
    /// A value is not a number.
    #[error("a value of the series is not a number")]
    NotANumber,
    /// One event has no neighbour to cluster with.
    #[error("{events} events among {trials} trials cannot cluster; at least two of either outcome are needed")]
    TooFewEvents {
        /// Number of events.
        events: u64,
        /// Number of trials.
        trials: u64,
    },
    /// The number of runs is impossible for these counts.
    #[error("{runs} runs are not possible")]
    Runs {
        /// Stated number of runs.
        runs: u64,
    },
}

/// Tests whether events cluster, by the number of runs of equal outcomes in a series of `events` events and `others`
/// (Wald and Wolfowitz, Annals of Mathematical Statistics 11, 1940). All orders of independent trials are equally
/// probable, and fewer runs than in nearly all of them are a sign of clusters. The p-value is P(R ≤ runs); more runs
/// than usual pass, since events that avoid each other make no bound too low. The sum is exact up to [`MOST_EXACT`] of
/// the rarer outcome. Beyond that, R is taken as normal with mean 2nm/N + 1 and variance 2nm (2nm − N) / (N² (N − 1)),
/// N = n + m.
///
/// # Errors
/// If there are fewer than two events or two others, or the number of runs is impossible.
///
/// ```
/// use stickslip::verify::certificate::bounds::{Untested, runs_test};
///
/// // 44 of 80 blocks have a miss, in 7 runs of blocks with and without: they cluster.
/// assert!(!runs_test(44, 36, 7)?.independent);
/// assert!(runs_test(44, 36, 41)?.independent);
/// // Two events and two others have 6 orders, two of them with two runs.
/// assert!((runs_test(2, 2, 2)?.p_value - 2.0 / 6.0).abs() < 1e-14);
/// assert_eq!(runs_test(1, 999, 3), Err(Untested::TooFewEvents { events: 1, trials: 1000 }));
/// # Ok::<(), Untested>(())
/// ```
pub fn runs_test(events: u64, others: u64, runs: u64) -> Result<Independence, Untested> {
    let (few, many) = (events.min(others), events.max(others));
    if few < 2 {
        return Err(Untested::TooFewEvents { events, trials: events + others });
    }
    if runs < 2 || runs > 2 * few + u64::from(few < many) {
        return Err(Untested::Runs { runs });
    }
    let p_value = if few <= MOST_EXACT {
        (2..=runs).map(|runs| probability_of_runs(few, many, runs)).sum::<f64>().min(1.0)
    } else {
        let (n, m) = (few as f64, many as f64);
        let (product, total) = (2.0 * n * m, n + m);
        let variance = product * (product - total) / (total * total * (total - 1.0));
        // The continuity correction of half a run.
        Normal::standard().cdf((runs as f64 + 0.5 - (product / total + 1.0)) / variance.sqrt())
    };
    Ok(Independence::new(runs as f64, p_value))
}

/// Returns P(R = runs) over all orders of n and m outcomes: 2 C(n−1, k−1) C(m−1, k−1) / C(n+m, n) for 2k runs, and
/// (C(n−1, k) C(m−1, k−1) + C(n−1, k−1) C(m−1, k)) / C(n+m, n) for 2k + 1.
fn probability_of_runs(n: u64, m: u64, runs: u64) -> f64 {
    let all = ln_binomial(n + m, n);
    let ways = |in_n: u64, in_m: u64| {
        let is_possible = in_n <= n && in_m <= m;
        if is_possible { (ln_binomial(n - 1, in_n - 1) + ln_binomial(m - 1, in_m - 1) - all).exp() } else { 0.0 }
    };
    let k = runs / 2;
    if runs.is_multiple_of(2) { 2.0 * ways(k, k) } else { ways(k + 1, k) + ways(k, k + 1) }
}

/// Tests independence by the autocorrelations r of the values' ranks at lags k = 1…lags, on which the distribution of
/// the values has no influence: Q = Σ (r − μ)² / σ², with the exact mean μ = −(n − k) / (n (n − 1)) and variance σ² =
/// (5n⁴ − (5k + 9) n³ + 9 (k − 2) n² + 2k (5k + 8) n + 16k²) / (5 (n − 1)² n² (n + 1)) over all orders of the ranks, is
/// χ² distributed with as many degrees of freedom as lags (Dufour and Roy, Communications in Statistics A 15, 1986).
/// Equal values share the mean of their ranks.
///
/// # Errors
/// If that distribution is not known or Q is not defined.
///
/// ```
/// use stickslip::verify::certificate::bounds::{Untested, rank_test};
///
/// // One value far above all others is no dependence; a trend is.
/// let mut values: Vec<f64> = (0..100).map(|i| f64::from(i * i * i % 101)).collect();
/// values[50] = 1e12;
/// assert!(rank_test(&values, 1)?.independent);
/// values.sort_by(f64::total_cmp);
/// assert!(!rank_test(&values, 1)?.independent);
/// assert_eq!(rank_test(&[1.0; 100], 1), Err(Untested::Constant));
/// assert_eq!(rank_test(&values[..10], 1), Err(Untested::TooFew { values: 10 }));
/// # Ok::<(), Untested>(())
/// ```
pub fn rank_test(series: &[f64], lags: usize) -> Result<Independence, Untested> {
    let values = series.len();
    if values < SHORTEST_SERIES {
        return Err(Untested::TooFew { values });
    }
    if lags > values / 2 {
        return Err(Untested::Lags { lags, values });
    }
    let chi_squared = ChiSquared::new(lags as f64).map_err(|_| Untested::Lags { lags, values })?;
    if series.iter().any(|value| value.is_nan()) {
        return Err(Untested::NotANumber);
    }
    if series.iter().all(|value| *value == series[0]) {
        return Err(Untested::Constant);
    }
    let centred = centred_ranks(series);
    let square: f64 = centred.iter().map(|rank| rank * rank).sum();
    let n = values as f64;
    let statistic = (1..=lags)
        .map(|lag| {
            let k = lag as f64;
            let r = centred.iter().zip(&centred[lag..]).map(|(a, b)| a * b).sum::<f64>() / square;
            let mean = -(n - k) / (n * (n - 1.0));
            let numerator = 5.0 * n.powi(4) - (5.0 * k + 9.0) * n.powi(3)
                + 9.0 * (k - 2.0) * n * n
                + 2.0 * k * (5.0 * k + 8.0) * n
                + 16.0 * k * k;
            let variance = numerator / (5.0 * (n - 1.0).powi(2) * n * n * (n + 1.0));
            (r - mean).powi(2) / variance
        })
        .sum();
    Ok(Independence::new(statistic, chi_squared.sf(statistic)))
}

/// Returns the ranks of the values less their mean; equal values have the mean of their ranks.
fn centred_ranks(series: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..series.len()).collect();
    order.sort_by(|&a, &b| series[a].total_cmp(&series[b]));
    let middle = (series.len() as f64 - 1.0) / 2.0;
    let mut ranks = vec![0.0; series.len()];
    let mut first = 0;
    for equal in order.chunk_by(|&a, &b| series[a] == series[b]) {
        let rank = first as f64 + (equal.len() as f64 - 1.0) / 2.0;
        equal.iter().for_each(|&at| ranks[at] = rank - middle);
        first += equal.len();
    }
    ranks
}
