//! The optional parts of the pipeline that a scene needs or omits.

use std::fmt;

use super::words::{All, ExteriorName, InstrumentName, LawName, LinearizationName, SchemeName};
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
#[non_exhaustive]
pub struct Part {
    /// Name of the part.
    pub name: &'static str,
    /// Whether the scene needs the part.
    pub needed: bool,
    /// The scene's value that decides.
    pub because: String,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.name, self.because)
    }
}

impl Scene {
    /// Returns every optional part, with the value that decides whether this scene needs it.
    pub fn parts(&self) -> Vec<Part> {
        let part = |name, needed, because: String| Part { name, needed, because };
        let is = |key: &str, word: &str| format!("{key} = {word:?}");
        let local = self.local();
        let law_is = is("contact.law", LawName::of(self.contact.law).map_or("own", LawName::name));
        let model_is = is("local.model", self.model_name().name());
        let linearization_is = is("local.linearization", LinearizationName::from(local.linearization).name());
        let exterior_is = is("local.exterior", ExteriorName::from(local.exterior).name());
        let drifts = local.exterior == ExteriorKind::Drifting;
        let condenses = matches!(local.exterior, ExteriorKind::Condensed(_));
        let (coarsens, far_field_is) = match local.exterior {
            ExteriorKind::Condensed(Condensation { reach: Reach::Rings { far_field, .. }, .. }) => {
                (far_field == FarField::Coarse, is("local.far_field", far_field.name()))
            }
            ExteriorKind::Condensed(_) => (false, is("local.condense_rings", All::All.name())),
            ExteriorKind::Fixed | ExteriorKind::Drifting => (false, exterior_is.clone()),
        };
        let takes_all = local.extent == Extent::All;
        let rings_is = match local.extent {
            Extent::All => is("local.rings", All::All.name()),
            Extent::Rings(rings) => format!("local.rings = {rings}"),
        };
        let (replays, sync_is) = match self.global.sync {
            _ if takes_all => (false, "the local model takes every free node".to_owned()),
            sync => (sync == SyncMode::Replay, is("sync.mode", sync.name())),
        };
        let surface_is = is("contact.surface", self.surface.name());
        let is_impulsive = self.contact.scheme.is_impulsive();
        let scheme_is = is("contact.scheme", SchemeName::from(self.contact.scheme).name());
        let (weighted, metric_is) = match self.contact.scheme {
            Scheme::Velocity | Scheme::Massless => (true, scheme_is.clone()),
            Scheme::Geometric { metric, .. } => (metric == Metric::Mass, is("contact.metric", metric.name())),
        };
        let schedule_is = is("run.schedule", self.schedule.name());
        let device = match &self.instrument {
            InstrumentKind::Path => None,
            InstrumentKind::Phantom(settings) => Some(settings),
        };
        let is_controlled = device.is_some_and(|device| device.passivity_control);
        let material = &self.material;
        let mut parts = vec![
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
                !is_impulsive && self.contact.law != Law::Sliding,
                if is_impulsive { scheme_is.clone() } else { law_is.clone() },
            ),
            part(
                "sliding operator Q",
                !is_impulsive && self.contact.law != Law::Sticking,
                if is_impulsive { scheme_is.clone() } else { law_is },
            ),
            part("mass metric", weighted, metric_is),
            part("deformation of the mesh to the tip", !is_impulsive, scheme_is.clone()),
            part("rewind to the time of collision", !is_impulsive, scheme_is),
            part("vertex normals", self.surface == ContactSurface::Shaded, surface_is.clone()),
            part("subdivision tables", self.surface == ContactSurface::Subdivision, surface_is),
            part("contact over a disc", self.contact_radius > 0.0, format!("contact.radius = {}", self.contact_radius)),
            part(
                "linearisation (K, D)",
                !self.is_full() && local.linearization != Linearization::None,
                if self.is_full() { model_is.clone() } else { linearization_is },
            ),
            part(
                "solution of the linear model over a tick (A⁻¹)",
                self.integrator != LocalIntegrator::SemiImplicitEuler,
                is("local.integrator", self.integrator.name()),
            ),
            part("exterior at rest or moving", !takes_all, if self.is_full() { model_is.clone() } else { rings_is }),
            part("exterior drift", drifts && !takes_all, exterior_is.clone()),
            part("condensation (sparse factorisation)", condenses && !takes_all, exterior_is),
            part("coarse far field", coarsens && !takes_all, far_field_is),
            part("replay of the patch's path", replays, sync_is),
            part(
                "sparse factorisation of the network",
                self.global.integrator == GlobalIntegrator::ImplicitEuler && !self.is_full(),
                is("global.integrator", self.global.integrator.name()),
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
            part("threads and the real clock", self.schedule == Schedule::Threads, schedule_is),
            part(
                "smoothing of forces at hand-overs",
                self.smoothing_ticks > 0,
                format!("instrument.smoothing_ticks = {}", self.smoothing_ticks),
            ),
            part(
                "haptic device in a hand",
                device.is_some(),
                device.map_or("the instrument follows a path".to_owned(), |_| {
                    is("instrument.kind", InstrumentName::Phantom.name())
                }),
            ),
            part(
                "virtual coupling",
                device.is_some_and(|device| device.coupling.is_some()),
                device.and_then(|device| device.coupling).map_or("there is no `instrument.coupling`".to_owned(), |c| {
                    format!("instrument.coupling.stiffness = {}", c.stiffness)
                }),
            ),
            part("passivity control", is_controlled, format!("instrument.passivity_control = {is_controlled}")),
        ];
        // A renderer in a library has its own local model and scheme.
        if let Some(library) = self.renderer() {
            let of_local = [
                "sticking operator P",
                "sliding operator Q",
                "mass metric",
                "deformation of the mesh to the tip",
                "rewind to the time of collision",
                "linearisation (K, D)",
                "solution of the linear model over a tick (A⁻¹)",
                "exterior at rest or moving",
                "exterior drift",
                "condensation (sparse factorisation)",
                "coarse far field",
            ];
            parts.retain(|part| !of_local.contains(&part.name));
            let keys = [
                "local.rings",
                "local.linearization",
                "local.exterior",
                "local.tangent",
                "local.condense_rings",
                "local.far_field",
                "local.integrator",
                "contact.scheme",
                "contact.metric",
                "contact.deformation",
            ];
            parts.extend(keys.map(|key| part(key, false, model_is.clone())));
            parts.push(part("renderer of a library", true, format!("local.library = {:?}", library.path())));
        }
        parts
    }
}
