//! How far two results are apart, and the verdict.

use stickslip::Vec3;

/// Prints one line of the table of residuals, and panics if the residual is beyond the tolerance.
#[track_caller]
pub fn check(quantity: &str, tolerance: f64, measured: f64) {
    println!("RESIDUAL | mujoco | {quantity} | {tolerance:.1e} | {measured:.3e}");
    assert!(is_within(tolerance, measured), "{quantity}: {measured:e} is not within {tolerance:e}");
}

/// Not a number is within no tolerance.
fn is_within(tolerance: f64, measured: f64) -> bool {
    measured <= tolerance
}

/// Prints a line that has no tolerance: a number worth knowing, not a verdict.
pub fn note(quantity: &str, measured: f64) {
    println!("RESIDUAL | mujoco | {quantity} | - | {measured:.3e}");
}

/// Prints the outcome of a negative control, and panics unless the comparison saw the mistake.
#[track_caller]
pub fn must_fail(mistake: &str, tolerance: f64, measured: f64) {
    println!("CONTROL | mujoco | {mistake} | {tolerance:.1e} | {measured:.3e}");
    assert!(is_seen(tolerance, measured), "{mistake}: {measured:e} passes {tolerance:e}");
}

/// What is not finite is no proof that a comparison saw the mistake.
fn is_seen(tolerance: f64, measured: f64) -> bool {
    measured.is_finite() && measured > tolerance
}

/// The largest of some numbers that are not negative. Unlike a fold over `f64::max` it does not
/// lose a NaN on the way.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values
        .into_iter()
        .fold(0.0, |largest: f64, value| if largest >= value || largest.is_nan() { largest } else { value })
}

/// The largest difference between two sets of vectors.
pub fn largest_difference(ours: &[Vec3], theirs: &[Vec3]) -> f64 {
    assert_eq!(ours.len(), theirs.len());
    largest(ours.iter().zip(theirs).map(|(ours, theirs)| (ours - theirs).norm()))
}

/// The largest magnitude among some vectors.
pub fn largest_norm(vectors: &[Vec3]) -> f64 {
    largest(vectors.iter().map(Vec3::norm))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nan_is_never_lost() {
        assert_eq!(largest([1.0, 3.0, 2.0]), 3.0);
        for position in 0..3 {
            let mut values = [1.0, 3.0, 2.0];
            values[position] = f64::NAN;
            assert!(largest(values).is_nan(), "at {position}");
        }
    }

    #[test]
    fn a_nan_neither_passes_nor_proves_a_mistake() {
        assert!(is_within(1.0, 1.0) && !is_within(1.0, 1.1));
        assert!(is_seen(1.0, 1.1) && !is_seen(1.0, 1.0));
        assert!(!is_within(f64::INFINITY, f64::NAN));
        assert!(!is_seen(0.0, f64::NAN) && !is_seen(0.0, f64::INFINITY));
    }
}
