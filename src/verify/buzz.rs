//! Largest stiffness of a virtual wall at which the modelled device does not buzz in the hand, over the rate of the servo
//! loop.
//!
//! S. Choi, H. Z. Tan, *Effect of update rate on perceived instability of virtual haptic texture*, IEEE/RSJ
//! International Conference on Intelligent Robots and Systems 2004, found on a PHANTOM that the largest stiffness that
//! people perceive as clean rises from 0.33 N/mm at 250 Hz to 0.90 N/mm at 40 kHz. The measure of perceived buzz is
//! here the tip's motion above 50 Hz while the hand keeps pressing into the wall: the quantisation by the encoders and
//! the loop's delay excite the device and the hand. A hand at rest does not show this buzz, because the device's
//! friction holds the tip between two encoder counts.

use super::residual::larger;
use super::z_width::{VirtualWall, ZWidthError, path, stiffest};
use crate::Vec3;
use crate::device::phantom::{DeviceError, Phantom, PhantomSettings};

/// Largest motion above [`BUZZ_HZ`] that a person does not perceive, m: about the human threshold for vibrations between
/// 100 and 300 Hz.
pub const PERCEIVED_M: f64 = 5e-7;
/// Motion above this frequency counts as buzz, Hz.
pub const BUZZ_HZ: f64 = 50.0;

/// Path of the hand: height, m, over time, s. It reaches 5 mm below the wall's surface within 0.1 s and presses on at
/// 100 mm/s.
const PRESS: [(f64, f64); 3] = [(0.0, 5e-3), (0.1, -5e-3), (END, -75e-3)];
/// Time at which the hand's arrival has decayed, s.
const SETTLED: f64 = 0.6;
/// End of the observation, s.
const END: f64 = 0.8;

/// Returns the largest motion of the true tip above [`BUZZ_HZ`], m, in a wall without damping of the given stiffness,
/// N/m, with the loop at the given rate, Hz. The result is infinite if the device left its workspace. The device takes
/// as many substeps as it needs.
///
/// # Errors
/// If the device cannot be simulated.
///
/// ```
/// use stickslip::device::phantom::PhantomSettings;
/// use stickslip::verify::buzz::{PERCEIVED_M, buzz_m};
///
/// let settings = PhantomSettings::default();
/// assert!(buzz_m(&settings, 1000.0, 300.0)? <= PERCEIVED_M);
/// assert!(buzz_m(&settings, 1000.0, 3000.0)? > PERCEIVED_M);
/// # Ok::<(), stickslip::verify::z_width::ZWidthError>(())
/// ```
pub fn buzz_m(settings: &PhantomSettings, rate: f64, stiffness: f64) -> Result<f64, ZWidthError> {
    let tick = 1.0 / rate;
    let mut settings = PhantomSettings { substeps: 1, ..*settings };
    if let Err(DeviceError::Substeps { least, .. }) = settings.check(tick) {
        settings.substeps = least as u32;
    }
    let mut device = Phantom::new(settings, &path(&PRESS)?, tick)?;
    let wall = VirtualWall { stiffness_n_per_m: stiffness, damping_n_s_per_m: 0.0 };
    let mut filter = HighPass::new(tick, device.tip());
    let mut largest = 0.0;
    for count in 0..(END * rate).round() as u64 {
        let Ok(measured) = device.advance(count as f64 * tick) else { return Ok(f64::INFINITY) };
        device.command(&Vec3::new(0.0, 0.0, wall.force(measured.z, 0.0)));
        let fast = filter.next(device.tip());
        if count as f64 * tick >= SETTLED {
            largest = larger(largest, fast.norm());
        }
    }
    Ok(largest)
}

/// Returns the largest stiffness, N/m, up to which no wall buzzes perceptibly with the loop at the given rate, Hz;
/// `None` if not even the stiffest wall does.
///
/// # Errors
/// If the device cannot be simulated.
pub fn stiffest_clean_n_per_m(settings: &PhantomSettings, rate: f64) -> Result<Option<f64>, ZWidthError> {
    stiffest(|stiffness| Ok(buzz_m(settings, rate, stiffness)? <= PERCEIVED_M))
}

/// Two first-order high-pass filters in series.
pub(super) struct HighPass {
    share: f64,
    slow: [Vec3; 2],
}

impl HighPass {
    /// Starts at rest at a position, m, with ticks of this length, s.
    pub fn new(tick: f64, start: Vec3) -> Self {
        Self { share: -(-std::f64::consts::TAU * BUZZ_HZ * tick).exp_m1(), slow: [start, Vec3::zeros()] }
    }

    /// Returns the fast part of the next position.
    pub fn next(&mut self, value: Vec3) -> Vec3 {
        self.slow.iter_mut().fold(value, |value, slow| {
            *slow += (value - *slow) * self.share;
            value - *slow
        })
    }
}
