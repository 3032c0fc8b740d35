//! Paired timings of two programs that take turns: the median of their ratios with a confidence interval.

use serde::Serialize;

/// Least probability with which an interval covers the median.
const CONFIDENCE: f64 = 0.95;

/// Least number of pairs. Fewer cannot give an interval of that confidence: even the whole range of five pairs
/// covers the median with a probability of only 0.9375.
pub const FEWEST_PAIRS: usize = 6;

/// Largest number of pairs. More add nothing, and at this number 2⁻ⁿ is still a normal number.
pub const MOST_PAIRS: usize = 1000;

/// Median of a population with a confidence interval, from a sample.
///
/// ```
/// use stickslip::verify::paired::Median;
///
/// // Times with a change over times without it, from eight interleaved pairs.
/// let slower = Median::of(&[1.04, 1.06, 1.05, 1.03, 1.07, 1.05, 1.04, 1.06]).expect("enough pairs");
/// assert!(!slower.covers_one() && (slower.median - 1.05).abs() < 1e-15);
/// assert!((slower.reach() - 0.07).abs() < 0.011);
/// let same = Median::of(&[0.99, 1.01, 1.0, 0.98, 1.02, 1.0, 0.99, 1.01]).expect("enough pairs");
/// assert!(same.covers_one());
/// assert_eq!(Median::of(&[1.0; 5]), None); // whatever they are, five say too little
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Median {
    /// Median of the sample.
    pub median: f64,
    /// Lower end of the confidence interval of the population's median.
    pub lower: f64,
    /// Upper end of that interval.
    pub upper: f64,
    /// Probability that the interval covers the population's median.
    pub confidence: f64,
}

impl Median {
    /// Estimates the median by order statistics, whatever the distribution: each value is above the median with
    /// probability ½, so the number of values above it is binomial. `None` for fewer than [`FEWEST_PAIRS`] values,
    /// more than [`MOST_PAIRS`], or a value that is not finite.
    ///
    /// ```
    /// use stickslip::verify::paired::Median;
    /// let values: Vec<f64> = (1..=20).map(f64::from).collect();
    /// // The 6th and the 15th of 20, as tables of the sign test have it: 0.9586.
    /// let median = Median::of(&values).unwrap();
    /// assert_eq!((median.median, median.lower, median.upper), (10.5, 6.0, 15.0));
    /// assert!((median.confidence - 0.95861).abs() < 1e-5);
    /// ```
    pub fn of(values: &[f64]) -> Option<Self> {
        let n = values.len();
        if !(FEWEST_PAIRS..=MOST_PAIRS).contains(&n) || !values.iter().all(|value| value.is_finite()) {
            return None;
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        // P(at most `left` of n are below the median), term by term.
        let mut term = 0.5_f64.powi(n as i32);
        let (mut tail, mut left) = (term, 0);
        while left + 1 < n / 2 {
            let next = term * (n - left) as f64 / (left + 1) as f64;
            if 1.0 - 2.0 * (tail + next) < CONFIDENCE {
                break;
            }
            (term, tail, left) = (next, tail + next, left + 1);
        }
        let middle = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
        Some(Self { median: middle, lower: sorted[left], upper: sorted[n - 1 - left], confidence: 1.0 - 2.0 * tail })
    }

    /// Returns the largest distance from 1 of the interval of a ratio.
    pub fn reach(&self) -> f64 {
        (self.lower - 1.0).abs().max((self.upper - 1.0).abs())
    }

    /// Returns whether the interval of a ratio contains 1.
    pub fn covers_one(&self) -> bool {
        self.lower <= 1.0 && self.upper >= 1.0
    }
}
