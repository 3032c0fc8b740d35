//! The classical fourth-order Runge–Kutta method for the network under a constraint.

use super::constraint::Constraint;
use crate::Vec3;
use crate::model::network::Network;
use crate::model::state::State;

/// Scratch of the stages, sized by the first step.
#[derive(Debug, Clone, Default)]
pub(super) struct Rk4 {
    f: Vec<Vec3>,
    stage: State,
    sum: State,
}

impl Rk4 {
    /// Does one step of `h` seconds. Returns the number of force evaluations.
    pub(super) fn step(&mut self, network: &Network, state: &mut State, h: f64, constraint: &impl Constraint) -> u64 {
        // (fraction of the step at the stage, weight of the stage)
        const STAGES: [(f64, f64); 4] = [(0.0, 1.0 / 6.0), (0.5, 1.0 / 3.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 6.0)];
        constraint.state(0.0, state);
        self.sum.clone_from(state);
        self.stage.clone_from(state);
        self.f.resize(state.x.len(), Vec3::zeros());
        for (i, (ahead, weight)) in STAGES.into_iter().enumerate() {
            if i > 0 {
                // self.stage.v and self.f still hold the slope of the stage before.
                for ((x, v), start) in self.stage.x.iter_mut().zip(&self.stage.v).zip(&state.x) {
                    *x = start + v * (ahead * h);
                }
                for ((v, a), start) in self.stage.v.iter_mut().zip(&self.f).zip(&state.v) {
                    *v = start + a * (ahead * h);
                }
                constraint.state(ahead, &mut self.stage);
            }
            network.forces(&self.stage.x, &self.stage.v, &mut self.f);
            accelerate(network, &mut self.f);
            constraint.accelerations(&mut self.f);
            add_scaled(&mut self.sum.x, &self.stage.v, weight * h);
            add_scaled(&mut self.sum.v, &self.f, weight * h);
        }
        std::mem::swap(state, &mut self.sum);
        constraint.state(1.0, state);
        STAGES.len() as u64
    }
}

/// Computes the accelerations a = M⁻¹f.
fn accelerate(network: &Network, f: &mut [Vec3]) {
    f.iter_mut().zip(&network.inverse_mass).for_each(|(f, w)| *f *= *w);
}

fn add_scaled(to: &mut [Vec3], from: &[Vec3], scale: f64) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += from * scale);
}
