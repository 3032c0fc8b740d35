//! What a scene needs of the program, and what is left out of its pipeline.

use std::fmt;

use super::{Scene, Schedule};
use crate::Vec3;
use crate::contact::law::Law;
use crate::contact::rules::Scheme;
use crate::device::instrument::InstrumentKind;
use crate::dynamics::constraint::Threads;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::local::condensation::{Condensation, FarField, Reach};
use crate::local::model::{ExteriorKind, Linearization};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::material::PerSpring;
use crate::multirate::global::SyncMode;
use crate::surface::geometry::ContactSurface;
use crate::surface::support::Metric;

/// A part of the pipeline that not every scene needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// What it is.
    pub name: &'static str,
    /// Whether this scene has it.
    pub needed: bool,
    /// The value in the scene that decides.
    pub because: String,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.name, self.because)
    }
}

impl Scene {
    /// Every optional part, with what decides whether this scene has it.
    pub fn parts(&self) -> Vec<Part> {
        let part = |name, needed, because: String| Part { name, needed, because };
        let law = match self.contact.law {
            Law::Sliding => "sliding",
            Law::Sticking => "sticking",
            Law::StickSlip { .. } => "stick-slip",
            Law::Own(_) => "own",
        };
        let law_is = format!("contact.law = {law:?}");
        let model = if self.is_full { "local.model = \"full\"" } else { "local.model = \"patch\"" };
        let (linear, linear_is) = match self.local.linearization {
            _ if self.is_full => (false, model),
            Linearization::Tangent(_) => (true, "local.linearization = \"tangent\""),
            Linearization::None => (false, "local.linearization = \"none\""),
        };
        let exterior_is = match self.local.exterior {
            ExteriorKind::Fixed => "local.exterior = \"fixed\"",
            ExteriorKind::Drifting => "local.exterior = \"drifting\"",
            ExteriorKind::Condensed(_) => "local.exterior = \"condensed\"",
        };
        let drifts = self.local.exterior == ExteriorKind::Drifting;
        let condenses = matches!(self.local.exterior, ExteriorKind::Condensed(_));
        let (coarsens, far_field_is) = match self.local.exterior {
            ExteriorKind::Condensed(Condensation { reach: Reach::Rings { far_field, .. }, .. }) => match far_field {
                FarField::Fixed => (false, "local.far_field = \"fixed\""),
                FarField::Coarse => (true, "local.far_field = \"coarse\""),
            },
            ExteriorKind::Condensed(_) => (false, "local.condense_rings = \"all\""),
            ExteriorKind::Fixed | ExteriorKind::Drifting => (false, exterior_is),
        };
        let takes_all = self.local.extent == Extent::All;
        let (replays, sync_is) = match self.global.sync {
            _ if takes_all => (false, "the local model takes every free node"),
            SyncMode::Replay => (true, "sync.mode = \"replay\""),
            SyncMode::Overwrite => (false, "sync.mode = \"overwrite\""),
        };
        let surface_is = match self.surface {
            ContactSurface::Faceted => "contact.surface = \"faceted\"",
            ContactSurface::Shaded => "contact.surface = \"shaded\"",
            ContactSurface::Subdivision => "contact.surface = \"subdivision\"",
        };
        let (is_velocity, scheme_is) = match self.contact.scheme {
            Scheme::Geometric { .. } => (false, "contact.scheme = \"geometric\""),
            Scheme::Velocity => (true, "contact.scheme = \"velocity\""),
        };
        let (weighted, metric_is) = match self.contact.scheme {
            Scheme::Velocity => (true, scheme_is),
            Scheme::Geometric { metric: Metric::Euclidean, .. } => (false, "contact.metric = \"euclidean\""),
            Scheme::Geometric { metric: Metric::Mass, .. } => (true, "contact.metric = \"mass\""),
        };
        let device = match &self.instrument {
            InstrumentKind::Path => None,
            InstrumentKind::Phantom(settings) => Some(settings),
        };
        let is_controlled = device.is_some_and(|device| device.passivity_control);
        let material = &self.material;
        vec![
            part(
                "gravity",
                material.gravity != Vec3::zeros(),
                format!("material.gravity = {:?}", material.gravity.as_slice()),
            ),
            part("settling before t = 0", self.settle, format!("settle = {}", self.settle)),
            part("node drag", material.drag != 0.0, format!("material.drag = {}", material.drag)),
            part(
                "spring dampers",
                material.damping.range()[1] != 0.0,
                match &material.damping {
                    PerSpring::Same(damping) => format!("material.damping = {damping}"),
                    each => format!("material.damping_ratio gives {each} N·s/m"),
                },
            ),
            part("friction", matches!(self.contact.law, Law::StickSlip { .. }), law_is.clone()),
            part(
                "sticking operator P",
                !is_velocity && self.contact.law != Law::Sliding,
                if is_velocity { scheme_is.to_owned() } else { law_is.clone() },
            ),
            part(
                "sliding operator Q",
                !is_velocity && self.contact.law != Law::Sticking,
                if is_velocity { scheme_is.to_owned() } else { law_is },
            ),
            part("mass metric", weighted, metric_is.to_owned()),
            part("deformation of the mesh to the tip", !is_velocity, scheme_is.to_owned()),
            part("rewind to the time of collision", !is_velocity, scheme_is.to_owned()),
            part("vertex normals", self.surface == ContactSurface::Shaded, surface_is.to_owned()),
            part("subdivision tables", self.surface == ContactSurface::Subdivision, surface_is.to_owned()),
            part("linearisation (K, D)", linear, linear_is.to_owned()),
            part(
                "solution of the linear model over a tick (A⁻¹)",
                self.integrator != LocalIntegrator::SemiImplicitEuler,
                format!("local.integrator = {:?}", self.integrator.name()),
            ),
            part(
                "exterior at rest or moving",
                !takes_all,
                if self.is_full { model.to_owned() } else { format!("local.rings: {:?}", self.local.extent) },
            ),
            part("exterior drift", drifts && !takes_all, exterior_is.to_owned()),
            part("condensation (sparse factorisation)", condenses && !takes_all, exterior_is.to_owned()),
            part("coarse far field", coarsens && !takes_all, far_field_is.to_owned()),
            part("replay of the patch's path", replays, sync_is.to_owned()),
            part(
                "sparse factorisation of the network",
                self.global.integrator == GlobalIntegrator::ImplicitEuler && !self.is_full,
                format!("global.integrator = {:?}", self.global.integrator.name()),
            ),
            part("second thread for the network", self.global.threads == Threads::Two, "global.threads = 1".to_owned()),
            part(
                "hand-over latency",
                self.global.latency_ticks > 0,
                format!("sync.latency_ticks = {}", self.global.latency_ticks),
            ),
            part(
                "costs and deadlines in virtual time",
                self.costs.is_some(),
                "there is no `timing.tick_cost` and no `timing.model_cost`".to_owned(),
            ),
            part(
                "threads and the real clock",
                self.schedule == Schedule::Threads,
                "run.schedule = \"lockstep\"".to_owned(),
            ),
            part(
                "smoothing of forces at hand-overs",
                self.smoothing_ticks > 0,
                format!("instrument.smoothing_ticks = {}", self.smoothing_ticks),
            ),
            part(
                "haptic device in a hand",
                device.is_some(),
                device.map_or("the instrument follows a path", |_| "instrument.kind = \"phantom-1.5\"").to_owned(),
            ),
            part(
                "virtual coupling",
                device.is_some_and(|device| device.coupling.is_some()),
                device.and_then(|device| device.coupling).map_or("there is no `instrument.coupling`".to_owned(), |c| {
                    format!("instrument.coupling.stiffness = {}", c.stiffness)
                }),
            ),
            part("passivity control", is_controlled, format!("instrument.passivity_control = {is_controlled}")),
        ]
    }
}
