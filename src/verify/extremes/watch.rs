//! Measurements on the run of an extreme.

use std::ops::Range;

use super::Quantity;
use crate::Vec3;
use crate::contact::law::{Law, Mode};
use crate::contact::rules::Scheme;
use crate::local::condensation::CondensationCounts;
use crate::model::mesh::Mesh;
use crate::output::measures::is_tunnelling;
use crate::pipeline::TickView;
use crate::scene::Scene;
use crate::surface::support::Support;
use crate::verify::residual::larger;
use crate::verify::residual::largest;

/// Measurements of a run.
pub(super) struct Watch {
    scheme: Scheme,
    friction: Option<f64>,
    gravity: Vec3,
    rest: Vec<Vec3>,
    forces: Vec<Vec3>,
    pub(super) tunnelling_ticks: u64,
    beyond_coulomb_n: f64,
    balance: f64,
    energy_balance: f64,
    /// Least and largest energy in free ticks once work has been done, J.
    free_energy: Range<f64>,
    /// Largest distance of each node from its rest position, m.
    moved: Vec<f64>,
    remains: f64,
    condensation: Option<CondensationCounts>,
    last_tick: u64,
}

impl Watch {
    pub(super) fn new(scene: &Scene, mesh: &Mesh) -> Self {
        Self {
            scheme: scene.contact.scheme,
            friction: match scene.contact.law {
                Law::StickSlip { friction } => Some(friction.static_coefficient),
                Law::Sliding | Law::Sticking | Law::Own(_) => None,
            },
            gravity: scene.material.gravity,
            rest: mesh.nodes.clone(),
            forces: Vec::new(),
            tunnelling_ticks: 0,
            beyond_coulomb_n: 0.0,
            balance: f64::NAN,
            energy_balance: f64::NAN,
            free_energy: f64::INFINITY..f64::NEG_INFINITY,
            moved: vec![0.0; mesh.nodes.len()],
            remains: f64::NAN,
            condensation: None,
            last_tick: scene.tick_count() - 1,
        }
    }

    pub(super) fn see(&mut self, view: &TickView) {
        let (local, report) = (view.local, view.report);
        self.forces.push(view.force);
        self.tunnelling_ticks += u64::from(is_tunnelling(view));
        if let (Some(friction), false) = (self.friction, report.rigid) {
            let beyond = report.tangential_force() - friction * report.normal_force;
            self.beyond_coulomb_n = larger(self.beyond_coulomb_n, beyond);
        }

        let (patch, state) = (&local.model().patch, local.state());
        let mut furthest = 0.0;
        for (slot, x) in state.x.iter().enumerate() {
            let node = patch.node(slot) as usize;
            let moved = (x - self.rest[node]).norm();
            furthest = larger(furthest, moved);
            self.moved[node] = larger(self.moved[node], moved);
        }
        if report.mode == Mode::Free && view.tick > 0 && view.energy.absolute_work > 0.0 {
            let energy = view.energy.kinetic + view.energy.elastic + view.energy.gravitational;
            self.free_energy = self.free_energy.start.min(energy)..larger(self.free_energy.end, energy);
        }
        self.condensation = view.condensation;
        if view.tick == self.last_tick {
            self.remains = furthest;
            self.balance = self.out_of_balance(view);
            self.energy_balance = view.energy.residual().abs() / view.energy.absolute_work;
        }
    }

    /// Returns |instrument + ground − weight| over the largest of the three.
    fn out_of_balance(&self, view: &TickView) -> f64 {
        let (model, state) = (view.local.model(), view.local.state());
        let mut f = vec![Vec3::zeros(); state.x.len()];
        model.patch.springs.add_forces(&state.x, &state.v, &mut f);
        let ground: Vec3 = f[model.patch.len()..].iter().sum();
        let weight = self.gravity * model.patch.mass.iter().sum::<f64>();
        let mut support = Support::with_capacity(view.local.surface().geometry.largest_support());
        if let (Some(contact), false) = (view.local.contact(), view.report.rigid) {
            view.local.shape().touch(self.scheme.metric(), &contact.point, &mut support);
        }
        // The share of the contact point on fixed nodes acts on the ground directly.
        let instrument = view.force * support.free_weight();
        let of_all = largest([instrument, ground, weight].map(|force| force.norm()));
        (instrument + ground - weight).norm() / of_all
    }

    pub(super) fn compare(&self, quantity: &Quantity, reference: &Watch) -> f64 {
        let last = |watch: &Watch| watch.forces.last().copied().unwrap_or_else(|| Vec3::repeat(f64::NAN));
        match quantity {
            Quantity::SameAs(_, factor) if self.forces.len() == reference.forces.len() => {
                let pairs = self.forces.iter().zip(&reference.forces);
                let difference = largest(pairs.map(|(a, b)| (a - b * *factor).norm()));
                difference / largest(reference.forces.iter().map(|b| (b * *factor).norm()))
            }
            Quantity::EndsAs(_) => (last(self) - last(reference)).norm() / last(reference).norm(),
            _ => f64::NAN,
        }
    }

    pub(super) fn value(&self, quantity: &Quantity) -> f64 {
        match quantity {
            Quantity::Balance => self.balance,
            Quantity::Coulomb => self.beyond_coulomb_n,
            Quantity::EnergyBalance => self.energy_balance,
            Quantity::EnergyKept => (self.free_energy.end - self.free_energy.start) / self.free_energy.end,
            Quantity::Moved(which) => {
                let nodes = (0..).zip(&self.moved).filter(|&(node, _)| which(node));
                largest(nodes.map(|(_, &moved)| moved))
            }
            Quantity::Remains => self.remains,
            Quantity::Force => largest(self.forces.iter().map(Vec3::norm)),
            Quantity::Ends(force_n) => {
                self.forces.last().map_or(f64::NAN, |force| (force.norm() / force_n - 1.0).abs())
            }
            Quantity::FellBack => {
                self.condensation.map_or(0.0, |counts| counts.stabilised as f64 / counts.models as f64)
            }
            Quantity::SameAs(..) | Quantity::EndsAs(_) | Quantity::OrderInAge(_) => f64::NAN,
        }
    }
}
