//! The largest of some residuals, which a NaN among them becomes: folded by [`f64::max`] it would be lost, and pass.

/// The larger of two numbers; NaN if one of them is.
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

/// The largest of some numbers that are not negative; 0 of none, NaN if one of them is.
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
