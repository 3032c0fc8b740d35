//! Power of a force above a cut-off frequency: the ripple that a smooth surface would not give.

use realfft::RealFftPlanner;

use crate::Vec3;

/// Returns the mean square of a force above `cutoff_hz`, N², summed over the three axes.
///
/// A Hann window keeps the jump between the end and the start of the record, which does not come from the contact, out
/// of the high frequencies. The result is divided by the window's mean power, 3/8.
///
/// ```
/// use stickslip::{Vec3, output::spectrum::power_above};
/// // 2 N at 10 Hz and 0.5 N at 200 Hz: the faster one has a mean square of 0.125 N².
/// let tone = |f: f64, t: f64| (2.0 * std::f64::consts::PI * f * t).sin();
/// let force: Vec<Vec3> =
///     (0..2000).map(|i| i as f64 * 1e-3).map(|t| Vec3::x() * (2.0 * tone(10.0, t) + 0.5 * tone(200.0, t))).collect();
/// assert!((power_above(&force, 1000.0, 100.0) - 0.125).abs() < 1e-9);
/// ```
pub fn power_above(force: &[Vec3], rate_hz: f64, cutoff_hz: f64) -> f64 {
    let n = force.len();
    if n < 2 {
        return 0.0;
    }
    let window: Vec<f64> = (0..n).map(|i| (std::f64::consts::PI * i as f64 / n as f64).sin().powi(2)).collect();
    let fft = RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let (mut signal, mut spectrum) = (fft.make_input_vec(), fft.make_output_vec());
    let mut power = 0.0;
    for axis in 0..3 {
        let mean = force.iter().map(|f| f[axis]).sum::<f64>() / n as f64;
        signal.iter_mut().zip(force).zip(&window).for_each(|((s, f), w)| *s = (f[axis] - mean) * w);
        fft.process(&mut signal, &mut spectrum).expect("buffers made by the plan have its lengths");
        for (bin, value) in spectrum.iter().enumerate() {
            // Bins strictly between zero and Nyquist count twice.
            let share = if bin == 0 || 2 * bin == n { 1.0 } else { 2.0 };
            if bin as f64 * rate_hz / n as f64 > cutoff_hz {
                power += share * value.norm_sqr();
            }
        }
    }
    power / (0.375 * (n as f64).powi(2))
}
