//! Positions and velocities of the full network, and forces on single nodes.

use crate::Vec3;

/// Speeds below this, m/s, count as rest. A decaying network otherwise passes through the subnormal numbers, where
/// arithmetic is a hundred times slower; at this speed a node needs 1e12 s to move by the last bit of 1 mm.
pub const REST_SPEED: f64 = 1e-30;

/// A force on single nodes, stored only if the scene has it.
///
/// ```
/// use stickslip::{Vec3, model::state::ExternalForce};
///
/// let gravity = ExternalForce::Gravity(Vec3::new(0.0, 0.0, -9.81));
/// let mut f = [Vec3::zeros()];
/// gravity.add(&[2.0], &[Vec3::zeros()], &mut f);
/// assert_eq!(f[0].z, -19.62);
/// assert_eq!(gravity.potential(2.0, &Vec3::z()), 19.62); // mgz
/// // Drag dissipates the power b|v|².
/// let (v, mut f) = ([Vec3::new(3.0, 4.0, 0.0)], [Vec3::zeros()]);
/// ExternalForce::Drag(0.1).add(&[2.0], &v, &mut f);
/// assert!((f[0].dot(&v[0]) + 0.1 * 25.0).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExternalForce {
    /// Weight m g, with g in m/s².
    Gravity(Vec3),
    /// Drag −b v, with b in N·s/m.
    Drag(f64),
}

impl ExternalForce {
    /// Potential energy of a node, J, zero at z = 0 for a downward g.
    pub fn potential(&self, mass: f64, x: &Vec3) -> f64 {
        match self {
            ExternalForce::Gravity(g) => -mass * g.dot(x),
            ExternalForce::Drag(_) => 0.0,
        }
    }

    /// Adds the force on every node, N.
    pub fn add(&self, mass: &[f64], v: &[Vec3], f: &mut [Vec3]) {
        match self {
            ExternalForce::Gravity(g) => f.iter_mut().zip(mass).for_each(|(f, m)| *f += g * *m),
            ExternalForce::Drag(b) => f.iter_mut().zip(v).for_each(|(f, v)| *f -= v * *b),
        }
    }
}

/// Positions and velocities of every node.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct State {
    /// Positions, m.
    pub x: Vec<Vec3>,
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
}

/// Sets velocity components below [`REST_SPEED`] to zero.
///
/// ```
/// use stickslip::{Vec3, model::state::{REST_SPEED, snap_to_rest}};
///
/// let mut v = [Vec3::new(0.1 * REST_SPEED, -10.0 * REST_SPEED, 1.0)];
/// snap_to_rest(&mut v);
/// assert_eq!(v[0], Vec3::new(0.0, -10.0 * REST_SPEED, 1.0));
/// ```
pub fn snap_to_rest(v: &mut [Vec3]) {
    for component in bytemuck::cast_slice_mut::<Vec3, f64>(v) {
        // This selects a value instead of deciding whether to write, so that it compiles to vector instructions.
        *component = if component.abs() < REST_SPEED { 0.0 } else { *component };
    }
}
