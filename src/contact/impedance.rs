//! Resistance of a contact point to a sudden motion of the tip along the normal: its mass, and the stiffness and damping
//! of the springs and dampers around it, before anything else has moved.

use super::shape::Touch;
use super::simulation::LocalSimulation;
use crate::surface::geometry::ContactPoint;
use crate::surface::support::{Metric, Support};

/// Displacement by which the stiffness is measured, m: a strain of 1e-4 in springs of 1 mm, and more than 1e9 ulps of a
/// position of 0.1 m. The same number, in m/s, measures the damping.
const DISPLACEMENT_M: f64 = 1e-7;

/// Mass, stiffness and damping of a contact point along the normal.
///
/// ```
/// use stickslip::{Vec3, contact::impedance::Impedance, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding-subdivision").expect("shipped with the program");
/// let local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
/// let point = local.shape().nearest(scene.path.at(0.0)).expect("the surface is not empty");
/// let contact = Impedance::at(&local, &point);
/// assert!(contact.mass_kg > 0.01, "several nodes of 10 g move with the point");
/// // All dampers are 5 ms times their springs.
/// assert!((contact.damping_n_s_per_m / contact.stiffness_n_per_m - 0.005).abs() < 1e-4);
/// // Under the velocity scheme a step of 30 µm within 0.1 ms takes the force of this mass, m_c Δ/h².
/// assert!(contact.mass_kg * 3e-5 / (1e-4 * 1e-4) > 50.0);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impedance {
    /// Mass m_c = (WM⁻¹Wᵀ)⁻¹, kg.
    pub mass_kg: f64,
    /// Stiffness while all other nodes stand still, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping while all other nodes stand still, N·s/m.
    pub damping_n_s_per_m: f64,
}

impl Impedance {
    /// Measures the contact at a point of the present state. Not finite where no node of the point is free.
    pub fn at(local: &LocalSimulation, point: &ContactPoint) -> Self {
        let mut support = Support::with_capacity(local.surface().geometry.largest_support());
        let Touch { normal, .. } = local.shape().touch(Metric::Mass, point, &mut support);
        let (model, elapsed) = (local.model(), local.elapsed());
        let reaction = |moves: bool, speeds: bool| {
            let mut state = local.state().clone();
            let step = normal * (DISPLACEMENT_M / support.scale());
            if moves {
                support.push(step, &mut state.x);
            }
            if speeds {
                support.push(step, &mut state.v);
            }
            model.evaluate_forces(elapsed, &mut state);
            normal.dot(&support.reaction(&state.f))
        };
        let rest = reaction(false, false);
        Self {
            mass_kg: 1.0 / support.scale(),
            stiffness_n_per_m: (rest - reaction(true, false)) / DISPLACEMENT_M,
            damping_n_s_per_m: (rest - reaction(false, true)) / DISPLACEMENT_M,
        }
    }
}
