//! Times of two programs that take turns: the median of their ratios and what is known of it.

use serde::Serialize;

/// An interval has to cover the median with at least this probability.
const CONFIDENCE: f64 = 0.95;

/// Fewer pairs cannot give an interval of that confidence: of 5, even the whole range covers the
/// median with 0.9375 only.
pub const FEWEST_PAIRS: usize = 6;

/// More are of no use, and 2⁻ⁿ still is a normal number.
pub const MOST_PAIRS: usize = 1000;

/// The median of a population, from a sample of it.
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
    /// Of the sample.
    pub median: f64,
    /// The population's is at least this,
    pub lower: f64,
    /// and at most this,
    pub upper: f64,
    /// with this probability.
    pub confidence: f64,
}

impl Median {
    /// By order statistics, whatever the distribution: each value is above the median with
    /// probability ½, so how many are is binomial. `None` for fewer than [`FEWEST_PAIRS`] values,
    /// more than [`MOST_PAIRS`], or one that is not finite.
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

    /// How far from 1 the interval of a ratio reaches.
    pub fn reach(&self) -> f64 {
        (self.lower - 1.0).abs().max((self.upper - 1.0).abs())
    }

    /// Whether 1 is in the interval of a ratio.
    pub fn covers_one(&self) -> bool {
        self.lower <= 1.0 && self.upper >= 1.0
    }
}
