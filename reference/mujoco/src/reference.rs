//! MuJoCo at work on one network.

use mujoco_rs::prelude::*;
use nalgebra::{DMatrix, DVector};
use stickslip::Vec3;
use stickslip::model::network::Network;
use stickslip::model::state::State;

use crate::mjcf::{self, Integrator, PointTendon};

/// A network and constraints on a contact point in MuJoCo.
#[derive(Debug)]
pub struct Reference {
    data: MjData<Box<MjModel>>,
    free: Vec<usize>,
    rest: Vec<Vec3>,
}

impl Reference {
    /// A network without contact.
    pub fn new(network: &Network, integrator: Integrator, timestep: f64) -> Self {
        Self::build(network, &mjcf::write(network, integrator, timestep, &[]), |_| {})
    }

    /// A network with constraints on a contact point. `hardening` divides R, by which MuJoCo
    /// softens them.
    pub fn constrained(network: &Network, timestep: f64, tendons: &[PointTendon], hardening: f64) -> Self {
        let xml = mjcf::write(network, Integrator::Euler, timestep, tendons);
        Self::build(network, &xml, |model| {
            model.tendon_invweight0_mut().iter_mut().for_each(|weight| *weight /= hardening);
        })
    }

    fn build(network: &Network, xml: &str, prepare: impl FnOnce(&mut MjModel)) -> Self {
        let mut model = MjModel::from_xml_string(xml).expect("MuJoCo takes the model");
        prepare(&mut model);
        let free = (0..network.node_count()).filter(|&node| !network.fixed[node]).collect();
        Self { data: MjData::new(Box::new(model)), free, rest: network.rest.clone() }
    }

    /// Takes over a state, and computes everything that follows from it.
    pub fn set_state(&mut self, state: &State) {
        for (slot, &node) in self.free.iter().enumerate() {
            self.data.qpos_mut()[3 * slot..][..3].copy_from_slice(state.x[node].as_slice());
            self.data.qvel_mut()[3 * slot..][..3].copy_from_slice(state.v[node].as_slice());
        }
        self.data.forward();
    }

    /// One step of the integrator.
    pub fn step(&mut self) {
        self.data.step();
    }

    /// Positions of all nodes, m.
    pub fn positions(&self) -> Vec<Vec3> {
        self.nodes(self.data.qpos(), &self.rest)
    }

    /// Velocities of all nodes, m/s.
    pub fn velocities(&self) -> Vec<Vec3> {
        self.nodes(self.data.qvel(), &vec![Vec3::zeros(); self.rest.len()])
    }

    /// Accelerations of all nodes, m/s².
    pub fn accelerations(&self) -> Vec<Vec3> {
        self.nodes(self.data.qacc(), &vec![Vec3::zeros(); self.rest.len()])
    }

    fn nodes(&self, free: &[f64], fixed: &[Vec3]) -> Vec<Vec3> {
        let mut values = fixed.to_vec();
        for (&node, value) in self.free.iter().zip(free.chunks_exact(3)) {
            values[node] = Vec3::from_column_slice(value);
        }
        values
    }

    /// The force of each active constraint on the network, as MuJoCo has it, N.
    pub fn constraint_forces(&self) -> DVector<f64> {
        // SAFETY: `set_state` and `step` have run the constraint solver.
        DVector::from_column_slice(unsafe { self.data.efc_force() })
    }

    /// Whether each active constraint is at a bound of its force.
    pub fn at_bound(&self) -> Vec<bool> {
        // SAFETY: `set_state` and `step` have run the constraint solver.
        unsafe { self.data.efc_state() }
            .iter()
            .map(|&state| state != MjtConstraintState::mjCNSTRSTATE_QUADRATIC)
            .collect()
    }

    /// A = JM⁻¹Jᵀ of the active constraints, from MuJoCo's own Jacobian and mass matrix, 1/kg.
    fn inverse_inertia(&self) -> DMatrix<f64> {
        let nv = self.data.qvel().len();
        let jacobian = DMatrix::from_row_slice(self.data.efc_j().len() / nv, nv, self.data.efc_j());
        let mut mass = vec![0.0; nv * nv];
        self.data.full_m(&mut mass).expect("the matrix has room");
        let mass = DMatrix::from_row_slice(nv, nv, &mass).cholesky().expect("masses are positive");
        &jacobian * mass.solve(&jacobian.transpose())
    }

    /// The forces that hard constraints would exert on the network, N.
    ///
    /// MuJoCo softens constraints: its forces f solve (A + R) f = a_ref − a₀, with a₀ what the
    /// constrained coordinates would do by themselves. Hard ones solve A λ = −a₀, so that
    /// λ = A⁻¹((A + R) f − a_ref).
    pub fn hard_forces(&self) -> DVector<f64> {
        let forces = self.constraint_forces();
        // SAFETY: `set_state` and `step` have run the constraint solver.
        let (softness, reference) = unsafe { (self.data.efc_r(), self.data.efc_aref()) };
        let softened = DVector::from_column_slice(softness).component_mul(&forces);
        let reference = DVector::from_column_slice(reference);
        let inverse_inertia = self.inverse_inertia().cholesky().expect("the contact point can move");
        forces + inverse_inertia.solve(&(softened - reference))
    }

    /// R A⁻¹ of the first active constraint: by how much it is softened.
    pub fn softness(&self) -> f64 {
        // SAFETY: `set_state` and `step` have run the constraint solver.
        let softness = unsafe { self.data.efc_r() }[0];
        softness / self.inverse_inertia()[(0, 0)]
    }
}
