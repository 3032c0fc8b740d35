//! Extrapolation of the longest response to many more ticks than were measured, by extreme-value theory: only
//! where the assumptions of that theory were tested and not rejected.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use statrs::consts::EULER_MASCHERONI;
use statrs::function::gamma::gamma;
use statrs::stats_tests::NaNPolicy;
use statrs::stats_tests::ks_test::{KSTwoSampleAlternativeMethod, ks_twosample};

use super::bounds::rank_test;

/// Least number of blocks that determines a shape.
pub const FEWEST_BLOCKS: usize = 100;
/// Least number of ticks whose maximum counts as an extreme value.
pub const FEWEST_BLOCK_TICKS: u64 = 50;
/// Level of the tests: one is passed if its p-value is above this. Data that meet all assumptions fail each this often.
pub const LEVEL: f64 = 0.05;
/// Horizons for which levels are given: one exceedance in this many ticks.
pub const HORIZONS_TICKS: [u64; 2] = [10_000_000, 1_000_000_000];
/// Admissible shapes. Beyond, parameter estimates have no finite variance, or the formula for the shape does not hold.
const SHAPES: std::ops::RangeInclusive<f64> = -0.5..=0.5;
/// Lags of the test of independence: memory that outlasts ten blocks also shows in shorter lags.
const LAGS: usize = 10;
const RESAMPLES: usize = 200;
const SEED: u64 = 1985;

/// Generalised extreme-value distribution F(x) = exp(−(1 + ξ z)^(−1/ξ)), z = (x − location) / scale: the limit for
/// maxima of many independent values (Fisher and Tippett, 1928). ξ > 0 has a heavy tail; ξ < 0 has an upper end.
///
/// ```
/// use stickslip::verify::certificate::tail::Gev;
///
/// let law = Gev { location: 100.0, scale: 10.0, shape: 0.1 };
/// assert!((law.cdf(law.quantile(0.01)) - (-0.01_f64).exp()).abs() < 1e-12);
/// assert!((law.cdf(100.0) - (-1.0_f64).exp()).abs() < 1e-15); // at its location F is 1/e
/// // A sample that is spread as the law says gives the law back.
/// let sample: Vec<f64> = (1..=1000).map(|i| law.quantile(-((f64::from(i) - 0.35) / 1000.0).ln())).collect();
/// let fitted = Gev::fit(&sample).expect("there is a spread");
/// assert!((fitted.location - 100.0).abs() < 0.2 && (fitted.scale - 10.0).abs() < 0.2);
/// assert!((fitted.shape - 0.1).abs() < 0.02);
/// assert_eq!(Gev::fit(&[1.0; 1000]), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gev {
    /// Location, in the unit of the values.
    pub location: f64,
    /// Scale, in the unit of the values; positive.
    pub scale: f64,
    /// Shape ξ.
    pub shape: f64,
}

impl Gev {
    /// Fits the distribution by L-moments, with their unbiased estimates bᵣ and k = −ξ ≈ 7.8590 c + 2.9554 c²,
    /// c = (2b₁ − b₀) / (3b₂ − b₀) − ln 2 / ln 3 (Hosking, Wallis and Wood, Technometrics 27, 1985),
    /// which is within 9·10⁻⁴ of the solution for |k| < 0.5. None for fewer than three values or values without
    /// spread.
    pub fn fit(sample: &[f64]) -> Option<Self> {
        if sample.len() < 3 {
            return None;
        }
        let mut sorted = sample.to_vec();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len() as f64;
        let (mut b0, mut b1, mut b2) = (0.0, 0.0, 0.0);
        for (below, x) in sorted.iter().enumerate() {
            let j = below as f64;
            b0 += x / n;
            b1 += x / n * j / (n - 1.0);
            b2 += x / n * j * (j - 1.0) / ((n - 1.0) * (n - 2.0));
        }
        let l2 = 2.0 * b1 - b0;
        let c = l2 / (3.0 * b2 - b0) - 2_f64.ln() / 3_f64.ln();
        let k = 7.8590 * c + 2.9554 * c * c;
        // For smaller |k|, 1 − Γ(1 + k) loses more digits than the error of its limit −k γ.
        let (scale, shift) = if k.abs() < 1e-7 {
            (l2 / 2_f64.ln(), EULER_MASCHERONI)
        } else {
            let gamma = gamma(1.0 + k);
            (l2 * k / (gamma * -(-k * 2_f64.ln()).exp_m1()), (1.0 - gamma) / k)
        };
        let fitted = Self { location: b0 - scale * shift, scale, shape: -k };
        let finite = fitted.location.is_finite() && fitted.scale.is_finite() && fitted.shape.is_finite();
        (finite && fitted.scale > 0.0).then_some(fitted)
    }

    /// Returns the probability F(x).
    pub fn cdf(&self, x: f64) -> f64 {
        let z = (x - self.location) / self.scale;
        // x is beyond the end of the support.
        if 1.0 + self.shape * z <= 0.0 {
            return if self.shape > 0.0 { 0.0 } else { 1.0 };
        }
        let y = if self.shape == 0.0 { z } else { (self.shape * z).ln_1p() / self.shape };
        (-(-y).exp()).exp()
    }

    /// Returns the x with −ln F(x) = `exponent` > 0.
    pub fn quantile(&self, exponent: f64) -> f64 {
        let y = -exponent.ln();
        let z = if self.shape == 0.0 { y } else { (self.shape * y).exp_m1() / self.shape };
        self.location + self.scale * z
    }

    /// Returns Kolmogorov's distance between F and the sample's distribution.
    fn distance(&self, sample: &[f64]) -> f64 {
        let mut sorted = sample.to_vec();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len() as f64;
        let apart = |(i, x): (usize, &f64)| {
            let f = self.cdf(*x);
            ((i + 1) as f64 / n - f).max(f - i as f64 / n)
        };
        sorted.iter().enumerate().map(apart).fold(0.0, f64::max)
    }
}

/// Result of a test of an assumption.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tested {
    /// Statistic of the test.
    pub statistic: f64,
    /// Probability of a statistic at least as large if the assumption holds.
    pub p_value: f64,
    /// Whether `p_value` is above [`LEVEL`].
    pub passed: bool,
}

impl Tested {
    fn new(statistic: f64, p_value: f64) -> Self {
        Self { statistic, p_value, passed: p_value > LEVEL }
    }
}

/// Tests of the assumptions of the extrapolation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tests {
    /// Number of block maxima.
    pub blocks: usize,
    /// Number of ticks in a block.
    pub block_ticks: u64,
    /// Test by ranks that no maximum depends on earlier ones; `None`, as for the other tests, if it could not be made.
    pub independence: Option<Tested>,
    /// Test that both halves are equally distributed, by Kolmogorov and Smirnov. A drift there and back escapes it.
    pub stationarity: Option<Tested>,
    /// Test of the fitted distribution: Kolmogorov's distance, compared with those of samples drawn from it and fitted
    /// in turn.
    pub fit: Option<Tested>,
}

/// Response time with its expected rate of exceedance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Level {
    /// Number of ticks in which one exceedance is expected.
    pub ticks: u64,
    /// Response time, ns.
    pub response_ns: f64,
    /// Upper limit of the response time, ns: 95 of 100 samples from the fitted distribution, refitted, are not above.
    pub response_ns_p95: f64,
}

/// Extrapolation from block maxima to longer runs.
///
/// ```
/// use stickslip::verify::certificate::tail::Tail;
///
/// // A response that grows from block to block cannot be extrapolated.
/// let drifting: Vec<u64> = (0..200).map(|block| 100_000 + 1_000 * block).collect();
/// let Tail::Refused { reasons, tests } = Tail::of_block_maxima(&drifting, 1000) else { panic!("not refused") };
/// assert!(tests.independence.is_some_and(|test| !test.passed));
/// assert!(tests.stationarity.is_some_and(|test| !test.passed));
/// assert!(reasons.len() >= 2);
/// // Nor can a few blocks.
/// assert!(matches!(Tail::of_block_maxima(&[1, 2, 3], 1000), Tail::Refused { .. }));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "outcome", rename_all = "kebab-case")]
pub enum Tail {
    /// No assumption was rejected, and levels are given.
    Extrapolated {
        /// Location of the [`Gev`], ns.
        location_ns: f64,
        /// Scale of the [`Gev`], ns.
        scale_ns: f64,
        /// Shape of the [`Gev`].
        shape: f64,
        /// Tests of the assumptions, all passed.
        tests: Tests,
        /// Levels for [`HORIZONS_TICKS`].
        levels: Vec<Level>,
    },
    /// An assumption was rejected or could not be tested, and no levels are given.
    Refused {
        /// All reasons.
        reasons: Vec<String>,
        /// Tests of the assumptions, as far as they could be done.
        tests: Tests,
    },
}

impl Tail {
    /// Extrapolates from the longest response of each block, ns, in chronological order; all blocks have this many
    /// ticks (omit a last one that was cut short). In T ticks one exceedance is expected of the level with
    /// −ln F = −m ln(1 − 1/T), m ticks being a block, if ticks within blocks are independent; responses in clusters
    /// exceed the level at fewer places.
    pub fn of_block_maxima(maxima_ns: &[u64], block_ticks: u64) -> Self {
        let mut tests =
            Tests { blocks: maxima_ns.len(), block_ticks, independence: None, stationarity: None, fit: None };
        let mut reasons = Vec::new();
        if tests.blocks < FEWEST_BLOCKS {
            reasons.push(format!("{} blocks are too few; at least {FEWEST_BLOCKS} are needed", tests.blocks));
        }
        if block_ticks < FEWEST_BLOCK_TICKS {
            reasons.push(format!("blocks of {block_ticks} ticks are too short; {FEWEST_BLOCK_TICKS} are needed"));
        }
        if !reasons.is_empty() {
            return Tail::Refused { reasons, tests };
        }
        let maxima: Vec<f64> = maxima_ns.iter().map(|&ns| ns as f64).collect();

        match rank_test(&maxima, LAGS) {
            Ok(test) => tests.independence = Some(Tested::new(test.statistic, test.p_value)),
            Err(error) => reasons.push(error.to_string()),
        }
        tests.stationarity = halves(&maxima);
        let fitted = Gev::fit(&maxima);
        let resampled = fitted.map_or_else(Vec::new, |fitted| bootstrap(fitted, maxima.len()));
        match fitted {
            Some(fitted) => {
                let distance = fitted.distance(&maxima);
                let farther = resampled.iter().filter(|(_, other)| *other >= distance).count();
                tests.fit = Some(Tested::new(distance, (1 + farther) as f64 / (1 + RESAMPLES) as f64));
                if !SHAPES.contains(&fitted.shape) {
                    reasons.push(format!("the shape {:.3} is not between -0.5 and 0.5", fitted.shape));
                }
            }
            None => reasons.push("the maxima do not determine a distribution".to_owned()),
        }

        for (test, rejected) in [
            (tests.independence, "the maxima depend on earlier ones"),
            (tests.stationarity, "the second half of the run differs from the first"),
            (tests.fit, "the extreme-value distribution does not fit"),
        ] {
            if let Some(test) = test.filter(|test| !test.passed) {
                reasons.push(format!("{rejected} (p = {:.2e}, above {LEVEL} is needed)", test.p_value));
            }
        }
        match fitted {
            Some(Gev { location, scale, shape }) if reasons.is_empty() => {
                let level = |ticks| level(Gev { location, scale, shape }, &resampled, block_ticks, ticks);
                let levels = HORIZONS_TICKS.into_iter().map(level).collect();
                Tail::Extrapolated { location_ns: location, scale_ns: scale, shape, tests, levels }
            }
            _ => Tail::Refused { reasons, tests },
        }
    }
}

/// Compares both halves by the two-sample test. They have equal length, so that equal steps cancel exactly.
fn halves(maxima: &[f64]) -> Option<Tested> {
    let half = maxima.len() / 2;
    let (mut first, mut second) = (maxima[..half].to_vec(), maxima[maxima.len() - half..].to_vec());
    first.sort_by(f64::total_cmp);
    second.sort_by(f64::total_cmp);
    // The series for the p-value in statrs 0.19 does not terminate at distance 0.
    if first == second {
        return Some(Tested::new(0.0, 1.0));
    }
    let method = KSTwoSampleAlternativeMethod::TwoSidedAsymptotic;
    let (statistic, p_value) = ks_twosample(first, second, method, NaNPolicy::Error).ok()?;
    Some(Tested::new(statistic, p_value))
}

/// Draws samples from a distribution, and returns each one's fit and its distance from it. A sample that cannot be
/// fitted is omitted, as if it were closer than any.
fn bootstrap(from: Gev, values: usize) -> Vec<(Gev, f64)> {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut draw = || {
        // Uniform between 0 and 1, both excluded.
        let uniform = ((random.next_u64() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64;
        from.quantile(-uniform.ln())
    };
    let samples = (0..RESAMPLES).map(|_| (0..values).map(|_| draw()).collect::<Vec<_>>());
    let fit = |sample: Vec<f64>| Gev::fit(&sample).map(|fitted| (fitted, fitted.distance(&sample)));
    samples.filter_map(fit).collect()
}

fn level(fitted: Gev, resampled: &[(Gev, f64)], block_ticks: u64, ticks: u64) -> Level {
    let exponent = -(block_ticks as f64) * (-1.0 / ticks as f64).ln_1p();
    let response_ns = fitted.quantile(exponent);
    let mut others: Vec<f64> = resampled.iter().map(|(other, _)| other.quantile(exponent)).collect();
    others.sort_by(f64::total_cmp);
    let rank = (others.len() * 95).div_ceil(100).saturating_sub(1);
    Level { ticks, response_ns, response_ns_p95: others.get(rank).copied().unwrap_or(response_ns) }
}
