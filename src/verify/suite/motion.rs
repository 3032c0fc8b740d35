//! Motions of the tip in the problem set. All begin and end at rest, without jumps of velocity or acceleration, so that the path
//! makes no impacts of its own.

use std::f64::consts::TAU;

use crate::Vec3;
use crate::device::path::Interpolation;

/// Motion of the tip.
#[derive(Debug, Clone, Copy)]
pub enum Motion {
    /// Minimum jerk from each of these points [t, x, y, z] to the next, in s and m.
    Through(&'static [[f64; 4]]),
    /// Minimum jerk between points, with a tremor of three incommensurable frequencies, one for each axis, that grows after `from_s` and fades
    /// before `to_s`.
    Tremor {
        /// Points of the motion below the tremor.
        through: &'static [[f64; 4]],
        /// Begin of the tremor, s.
        from_s: f64,
        /// End of the tremor, s.
        to_s: f64,
        /// Amplitude along each axis, m.
        amplitude: [f64; 3],
        /// Frequency along each axis, Hz.
        hz: [f64; 3],
    },
    /// A press, then turns of a circle in the plane of the surface, of minimum jerk along the arc.
    Circle {
        /// Points of the press, which ends where the circle begins, at its largest x.
        through: &'static [[f64; 4]],
        /// Begin and end of the turns, s.
        turning_s: [f64; 2],
        /// Radius, m.
        radius: f64,
        /// Number of turns.
        turns: f64,
    },
}

/// Time in which a tremor grows and fades, s.
const FADE_S: f64 = 0.2;

/// Share of a motion of minimum jerk at the share τ of its time.
fn share(t: f64) -> f64 {
    Interpolation::MinimumJerk.share(t.clamp(0.0, 1.0))
}

impl Motion {
    /// Returns the position at a time, s.
    pub fn at(self, time: f64) -> Vec3 {
        match self {
            Motion::Through(points) => along(points, time),
            Motion::Tremor { through, from_s, to_s, amplitude, hz } => {
                let strength = share((time - from_s) / FADE_S) * share((to_s - time) / FADE_S);
                let wave = |axis: usize| amplitude[axis] * strength * (TAU * hz[axis] * (time - from_s)).sin();
                along(through, time) + Vec3::new(wave(0), wave(1), wave(2))
            }
            Motion::Circle { through, turning_s: [from_s, to_s], radius, turns } => {
                let angle = TAU * turns * share((time - from_s) / (to_s - from_s));
                along(through, time) + Vec3::new(angle.cos() - 1.0, angle.sin(), 0.0) * radius
            }
        }
    }
}

/// Returns the position on the way through some points; at rest before the first and after the last.
fn along(points: &[[f64; 4]], time: f64) -> Vec3 {
    let position = |&[_, x, y, z]: &[f64; 4]| Vec3::new(x, y, z);
    let after = points.partition_point(|point| point[0] <= time);
    match (after.checked_sub(1).map(|before| &points[before]), points.get(after)) {
        (Some(before), Some(after)) => {
            let t = share((time - before[0]) / (after[0] - before[0]));
            position(before) + (position(after) - position(before)) * t
        }
        (Some(only), None) | (None, Some(only)) => position(only),
        (None, None) => Vec3::zeros(),
    }
}
