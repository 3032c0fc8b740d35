//! Virtual walls that the modelled device renders without oscillation in the user's hand: measured on the sampled
//! loop, and the bounds below which a wall is passive. (Z-width: J. E. Colgate, J. M. Brown, *Factors affecting the
//! Z-width of a haptic display*, IEEE International Conference on Robotics and Automation 1994.)
//!
//! Passivity bounds are sufficient for any hand. The modelled hand is one of them and adds damping, and a wall that
//! emits a little energy need not oscillate: the measured limit has to lie at or above the bounds, and its distance
//! from them shows what they neglect.

use serde::Serialize;
use thiserror::Error;

use super::residual::larger;
use crate::Vec3;
use crate::device::path::{PathError, TipPath, Waypoint};
use crate::device::phantom::{DeviceError, Needs, Phantom, PhantomSettings};

/// Rates of the servo loop, Hz.
pub const RATES_HZ: [f64; 2] = [1e3, 1e4];
/// Dampings of the wall, N·s/m. The device's own at the tip is 0.011: only the first two are below it.
pub const DAMPINGS_N_S_PER_M: [f64; 6] = [0.0, 0.005, 0.1, 1.0, 3.0, 10.0];
/// Range of stiffnesses in which the limit is sought, N/m.
pub const STIFFNESSES_N_PER_M: [f64; 2] = [1e1, 1e5];
/// Largest motion of a quiet tip once it has settled, m: about three encoder counts at the tip.
pub const QUIET_M: f64 = 1e-4;

/// Number of stiffnesses in the upward search for the first wall that oscillates, four to a decade. The search goes
/// upwards because a quiet wall may be stiffer than one that oscillates.
const LOOKS: i32 = 16;
/// Bisections between the last two stiffnesses of the search: the limit is known to 1 %.
const HALVINGS: u32 = 6;
/// Distance from the wall at which the hand starts, and depth at which it aims, m.
const AIM: f64 = 5e-3;
/// Duration of the hand's approach, s; then it rests.
const APPROACH: f64 = 0.1;
/// Time at which the loop counts as settled, s; hand and arm come to rest with a time constant of 0.08 s.
/// In softer walls the tip still creeps by up to 60 µm then.
const SETTLED: f64 = 0.6;
/// End of the observation, s.
const END: f64 = 0.8;

/// Rigid ground, z ≤ 0 in the scene: f = max(0, K·depth − B·ż) inside, where ż is the difference of the last two
/// measured positions over the tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualWall {
    /// Stiffness K, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping B, N·s/m.
    pub damping_n_s_per_m: f64,
}

/// Motion of the tip in a wall once the loop has had time to settle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallTouch {
    /// Largest range of the true tip along an axis, m; infinite if the device left its workspace, NaN if the tip was
    /// not a number.
    pub range_m: f64,
    /// Mean depth of the true tip in the wall, m; NaN if the device left its workspace.
    pub depth_m: f64,
}

/// Stiffest quiet wall at a damping and a rate, and the published passivity bounds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WallLimit {
    /// Rate of the servo loop, 1/h, Hz.
    pub rate_hz: f64,
    /// Damping of the wall, B, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Stiffness up to which all walls tried are quiet, N/m. 0: not even the softest is; none: all are.
    pub quiet_n_per_m: Option<f64>,
    /// Bound 2(b − |B|)/h of Colgate and Schenkel at the wall, N/m.
    pub by_damping_n_per_m: f64,
    /// Bound 2f_c/Δ of Abbott and Okamura at the wall, N/m; none if nothing is quantised.
    pub by_friction_n_per_m: Option<f64>,
    /// Smaller of both bounds, N/m.
    pub passive_n_per_m: f64,
    /// Whether all walls that have to be passive are quiet.
    pub agrees: bool,
}

/// Why no limit could be measured.
#[derive(Debug, Error)]
pub enum ZWidthError {
    /// The device's settings or the wall's numbers are invalid.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The hand's path is invalid.
    #[error(transparent)]
    Path(#[from] PathError),
}

/// Measures the tip in a wall into which the hand is led, with the loop at a rate, Hz, for 0.8 s. A command acts
/// over the tick after the one at whose end it was computed, as in the servo.
///
/// # Errors
/// If the device cannot be simulated at this rate, or a number of the wall is negative or not finite.
///
/// ```
/// use stickslip::device::phantom::PhantomSettings;
/// use stickslip::verify::z_width::{QUIET_M, VirtualWall, touch};
///
/// let settings = PhantomSettings::default();
/// let soft = VirtualWall { stiffness_n_per_m: 300.0, damping_n_s_per_m: 0.0 };
/// let felt = touch(&settings, 1e3, &soft)?;
/// assert!(felt.range_m <= QUIET_M && felt.depth_m > 0.0);
/// // Between two ticks, a hard wall emits more energy than joints and hand absorb.
/// let hard = VirtualWall { stiffness_n_per_m: 2e4, ..soft };
/// assert!(touch(&settings, 1e3, &hard)?.range_m > QUIET_M);
/// # Ok::<(), stickslip::verify::z_width::ZWidthError>(())
/// ```
pub fn touch(settings: &PhantomSettings, rate: f64, wall: &VirtualWall) -> Result<WallTouch, ZWidthError> {
    for (name, value) in
        [("the wall's stiffness (N/m)", wall.stiffness_n_per_m), ("the wall's damping (N·s/m)", wall.damping_n_s_per_m)]
    {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(DeviceError::Setting { name, value, needs: Needs::NotNegative }.into());
        }
    }
    let tick = 1.0 / rate;
    let mut device = Phantom::new(*settings, &path(&[(0.0, AIM), (APPROACH, -AIM)])?, tick)?;
    let [settled, end] = [SETTLED, END].map(|time| (time * rate).round() as u64);
    let mut tips = Vec::new();
    let mut before = device.measured_tip().z;
    for count in 0..end {
        let Ok(measured) = device.advance(count as f64 * tick) else {
            return Ok(WallTouch { range_m: f64::INFINITY, depth_m: f64::NAN });
        };
        let speed = (measured.z - before) / tick;
        before = measured.z;
        device.command(&Vec3::new(0.0, 0.0, wall.force(measured.z, speed)));
        if count >= settled {
            tips.push(device.tip());
        }
    }
    Ok(WallTouch::of(&tips))
}

impl WallTouch {
    /// Measures positions, m; the range is NaN if there are none or one is not a number.
    fn of(tips: &[Vec3]) -> Self {
        let along = |axis: usize| tips.iter().map(move |tip| tip[axis]);
        let range = |axis: usize| Some(along(axis).reduce(larger)? + along(axis).map(|x| -x).reduce(larger)?);
        let range_m = (0..3).map(|axis| range(axis).unwrap_or(f64::NAN)).fold(0.0, larger);
        let depths = along(2).fold(0.0, |sum, z| sum - z);
        Self { range_m, depth_m: depths / tips.len() as f64 }
    }
}

impl VirtualWall {
    /// Returns the force on a tip at a height, m, with an upward speed, m/s: N, never negative.
    pub(super) fn force(&self, height: f64, speed: f64) -> f64 {
        if height < 0.0 { (-self.stiffness_n_per_m * height - self.damping_n_s_per_m * speed).max(0.0) } else { 0.0 }
    }
}

/// Measures the limit at a rate, Hz, and a damping of the wall, N·s/m.
///
/// # Errors
/// If the device cannot be simulated at this rate, or the damping is negative or not finite.
///
/// ```
/// use stickslip::device::phantom::PhantomSettings;
/// use stickslip::verify::z_width::{ZWidthError, wall_limit};
///
/// let limit = wall_limit(&PhantomSettings::default(), 1e3, 0.0)?;
/// // All passive walls are quiet; with a hand, much stiffer ones are quiet too.
/// assert!(limit.agrees);
/// assert!(limit.quiet_n_per_m.is_some_and(|quiet| quiet > limit.passive_n_per_m));
/// assert!(matches!(wall_limit(&PhantomSettings::default(), 1e3, -1.0), Err(ZWidthError::Device(_))));
/// # Ok::<(), ZWidthError>(())
/// ```
pub fn wall_limit(settings: &PhantomSettings, rate: f64, damping: f64) -> Result<WallLimit, ZWidthError> {
    let is_quiet = |stiffness: f64| -> Result<bool, ZWidthError> {
        let wall = VirtualWall { stiffness_n_per_m: stiffness, damping_n_s_per_m: damping };
        Ok(touch(settings, rate, &wall)?.range_m <= QUIET_M)
    };
    let quiet_n_per_m = stiffest(is_quiet)?;
    // The tip rests on the surface of the wall.
    let bounds = Phantom::new(*settings, &path(&[(0.0, 0.0)])?, 1.0 / rate)?.wall_bounds(&Vec3::z(), damping);
    let passive = bounds.passive_n_per_m();
    Ok(WallLimit {
        rate_hz: rate,
        damping_n_s_per_m: damping,
        quiet_n_per_m,
        by_damping_n_per_m: bounds.by_damping_n_per_m,
        by_friction_n_per_m: Some(bounds.by_friction_n_per_m).filter(|bound| bound.is_finite()),
        passive_n_per_m: passive,
        agrees: quiet_n_per_m.is_none_or(|quiet| quiet >= passive),
    })
}

/// Returns the last quiet stiffness before the first that is not: an upward search, then bisection of the logarithm.
pub(super) fn stiffest(is_quiet: impl Fn(f64) -> Result<bool, ZWidthError>) -> Result<Option<f64>, ZWidthError> {
    let [softest, hardest] = STIFFNESSES_N_PER_M;
    let stiffness = |look: i32| softest * (hardest / softest).powf(f64::from(look) / f64::from(LOOKS));
    for look in 0..=LOOKS {
        if is_quiet(stiffness(look))? {
            continue;
        }
        if look == 0 {
            return Ok(Some(0.0));
        }
        let [mut quiet, mut shaking] = [stiffness(look - 1), stiffness(look)];
        for _ in 0..HALVINGS {
            let middle = (quiet * shaking).sqrt();
            *(if is_quiet(middle)? { &mut quiet } else { &mut shaking }) = middle;
        }
        return Ok(Some(quiet));
    }
    Ok(None)
}

/// Builds a vertical path through heights, m, at times, s.
pub(super) fn path(heights: &[(f64, f64)]) -> Result<TipPath, PathError> {
    TipPath::new(
        heights.iter().map(|&(time, z)| Waypoint { time, position: Vec3::new(0.0, 0.0, z) }).collect::<Vec<_>>(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tip_that_is_nowhere_is_not_quiet() {
        let still = Vec3::new(0.0, 0.0, -0.002);
        assert_eq!(WallTouch::of(&[still, still + Vec3::x() * 1e-3]), WallTouch { range_m: 1e-3, depth_m: 0.002 });
        let nowhere = Vec3::repeat(f64::NAN);
        for tips in [&[nowhere, still][..], &[still, nowhere], &[still, nowhere, still], &[]] {
            assert!(!(WallTouch::of(tips).range_m <= QUIET_M), "{tips:?}");
        }
    }
}
