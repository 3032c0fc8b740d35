//! Maxima of residuals that keep NaN: [`f64::max`] would drop it, and the check would pass.

/// Returns the larger of two numbers; NaN if one of them is.
///
/// ```
/// use stickslip::verify::residual::larger;
///
/// assert_eq!(larger(1.0, 2.0), 2.0);
/// assert!(larger(f64::NAN, 2.0).is_nan() && larger(2.0, f64::NAN).is_nan());
/// ```
pub fn larger(a: f64, b: f64) -> f64 {
    if b <= a || a.is_nan() { a } else { b }
}

/// Returns the largest of some non-negative numbers; 0 if there are none, NaN if one of them is.
///
/// ```
/// use stickslip::verify::residual::largest;
///
/// assert_eq!((largest([1.0, 3.0, 2.0]), largest([])), (3.0, 0.0));
/// assert!(largest([1.0, f64::NAN, 2.0]).is_nan());
/// ```
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, larger)
}
