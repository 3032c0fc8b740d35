//! Method of running a drag, and its names in scenes.

use std::fmt;

use serde::Serialize;

use crate::contact::rules::Scheme;
use crate::local::condensation::Reach;
use crate::local::model::{ExteriorKind, Linearization, LocalSettings};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::springs::TangentKind;
use crate::scene::{ExteriorName, LinearizationName, LocalModelName, Rings, Scene, SchemeName};
use crate::surface::geometry::ContactSurface;

/// Contact of the tip with the mesh: surface and scheme.
///
/// ```
/// use stickslip::{contact::rules::Scheme, surface::geometry::ContactSurface};
/// use stickslip::verify::accuracy::Touching;
///
/// // An impulse acts through the masses and leaves no choice of deformation or metric.
/// let names = Touching { surface: ContactSurface::Subdivision, scheme: Scheme::Velocity }.names();
/// assert_eq!((names.surface, names.scheme), ("subdivision", "velocity"));
/// assert_eq!((names.deformation, names.metric), (None, None));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touching {
    /// Contact surface.
    pub surface: ContactSurface,
    /// Contact scheme.
    pub scheme: Scheme,
}

/// Method of running a drag: local model, integrator, update rate and contact.
///
/// ```
/// use stickslip::{scene::{Rings, Scene}, verify::accuracy::Method};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let method = Method::of(&scene);
/// assert_eq!(method.to_string(), "1 ring, tangent, fixed, exact, 10 Hz"); // the paper's
/// let names = method.names();
/// assert_eq!((names.model, names.rings, names.far_field), ("patch", Some(Rings::Count(1)), None));
/// assert_eq!(method.touching.to_string(), "geometric scheme on the faceted surface, rigid");
/// assert_eq!(method.touching.names().model, "full"); // of the reference
///
/// // Updated five times as often, with unchanged steps of the network.
/// let often = Method { global_rate: 50.0, ..method }.scene(&scene);
/// assert_eq!((often.ticks_per_cycle(), often.global.substeps), (20, 20));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    /// A local model, the full network, or the scene's renderer in a library.
    pub model: LocalModelName,
    /// Settings of the local model.
    pub local: LocalSettings,
    /// Integrator of the local model.
    pub integrator: LocalIntegrator,
    /// Rate at which the local model is updated, Hz.
    pub global_rate: f64,
    /// Contact of the tip with the mesh.
    pub touching: Touching,
}

/// Names of a method's settings in scenes; `None` where a key has no effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Names {
    /// "patch", "full" or "external".
    pub model: &'static str,
    /// Number of rings, or "all".
    pub rings: Option<Rings>,
    /// "tangent" or "none".
    pub linearization: Option<&'static str>,
    /// "fixed", "drifting" or "condensed".
    pub exterior: Option<&'static str>,
    /// "exact" or "stabilised".
    pub tangent: Option<&'static str>,
    /// Reach of a condensed exterior: "all" of it, or a number of springs from the centre.
    pub condense_rings: Option<Rings>,
    /// Far field beyond that reach: "fixed" or "coarse".
    pub far_field: Option<&'static str>,
    /// Integrator of the local model.
    pub integrator: Option<&'static str>,
    /// "geometric" or "velocity".
    pub scheme: &'static str,
    /// "faceted", "shaded" or "subdivision".
    pub surface: &'static str,
    /// "rigid" or "least-norm".
    pub deformation: Option<&'static str>,
    /// "euclidean" or "mass".
    pub metric: Option<&'static str>,
    /// Rate of the global cycle, Hz.
    pub global_rate: f64,
}

impl Method {
    /// Returns the method of a scene.
    pub fn of(scene: &Scene) -> Self {
        Self {
            model: scene.model_name(),
            local: scene.local(),
            integrator: scene.integrator,
            global_rate: scene.global_rate_hz(),
            touching: Touching { surface: scene.surface, scheme: scene.contact.scheme },
        }
    }

    /// Returns the scene's drag with this method. The length of the global side's substeps is unchanged.
    pub fn scene(&self, scene: &Scene) -> Scene {
        let own = scene.clone().with_surface(self.touching.surface).with_scheme(self.touching.scheme);
        let mut own = match self.model {
            LocalModelName::Patch => own.with_local_model(self.local).with_local_integrator(self.integrator),
            LocalModelName::Full => own.with_full_model(),
            LocalModelName::External => own,
        };
        let Some(ticks) = ticks_per_cycle(scene, self.global_rate) else { return own };
        let substeps = f64::from(scene.global.substeps) * f64::from(ticks) / f64::from(scene.ticks_per_cycle());
        own.global.substeps = (substeps.round() as u32).max(1);
        own.with_ticks_per_cycle(ticks)
    }

    /// Returns the method's name in tables and figures: a renderer goes by the file name of the scene's library.
    pub fn name(&self, scene: &Scene) -> String {
        match (self.model, scene.renderer().and_then(|library| library.path().file_name())) {
            (LocalModelName::External, Some(file)) => format!("{}, {} Hz", file.display(), self.global_rate),
            _ => self.to_string(),
        }
    }

    /// Returns the names in scenes.
    pub fn names(&self) -> Names {
        let LocalSettings { extent, linearization, exterior } = self.local;
        let has_local = self.model != LocalModelName::External;
        let mut tangent = match linearization {
            Linearization::Tangent(tangent) => Some(tangent),
            Linearization::None => None,
        };
        let (mut condense_rings, mut far_field) = (None, None);
        if let ExteriorKind::Condensed(condensation) = exterior {
            tangent = Some(condensation.tangent);
            condense_rings = Some(condensation.reach.into());
            if let Reach::Rings { far_field: beyond, .. } = condensation.reach {
                far_field = Some(beyond.name());
            }
        }
        let (deformation, metric) = match self.touching.scheme {
            Scheme::Geometric { deformation, metric } => (Some(deformation.name()), Some(metric.name())),
            Scheme::Velocity | Scheme::Massless => (None, None),
        };
        Names {
            model: self.model.name(),
            rings: has_local.then_some(extent.into()),
            linearization: has_local.then_some(LinearizationName::from(linearization).name()),
            exterior: (has_local && extent != Extent::All).then_some(ExteriorName::from(exterior).name()),
            tangent: tangent.filter(|_| has_local).map(TangentKind::name),
            condense_rings: condense_rings.filter(|_| has_local),
            far_field: far_field.filter(|_| has_local),
            integrator: has_local.then_some(self.integrator.name()),
            scheme: SchemeName::from(self.touching.scheme).name(),
            surface: self.touching.surface.name(),
            deformation,
            metric,
            global_rate: self.global_rate,
        }
    }
}

impl Touching {
    /// Returns the names in scenes, with the full network.
    pub fn names(self) -> Names {
        Method {
            model: LocalModelName::Full,
            local: LocalSettings::FULL,
            integrator: LocalIntegrator::SemiImplicitEuler,
            global_rate: 0.0,
            touching: self,
        }
        .names()
    }
}

/// Prints the local model and its rate, without the contact.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Names { rings, linearization, exterior, tangent, condense_rings, global_rate, .. } = self.names();
        match (self.model, rings, linearization) {
            (LocalModelName::Full, ..) => return f.write_str("full network"),
            (_, Some(rings), Some(linearization)) => write!(f, "{rings}, {linearization}")?,
            _ => return write!(f, "renderer of a library, {global_rate} Hz"),
        }
        [exterior, tangent].into_iter().flatten().try_for_each(|word| write!(f, ", {word}"))?;
        if let Some(reach @ Rings::Count(_)) = condense_rings {
            write!(f, " within {reach}")?;
        }
        if self.integrator != LocalIntegrator::SemiImplicitEuler {
            write!(f, ", {}", self.integrator.name())?;
        }
        write!(f, ", {global_rate} Hz")
    }
}

impl fmt::Display for Touching {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.names();
        write!(f, "{} scheme on the {} surface", names.scheme, names.surface)?;
        names.deformation.map_or(Ok(()), |deformation| write!(f, ", {deformation}"))
    }
}

/// Returns the ticks in a cycle of this rate; `None` if that is no whole number, or not above the models' latency.
pub(super) fn ticks_per_cycle(scene: &Scene, rate: f64) -> Option<u32> {
    let ratio = scene.local_rate_hz() / rate;
    let ticks = ratio.round();
    let whole = (ratio - ticks).abs() <= 1e-9 * ratio && ticks >= 1.0 && ticks <= f64::from(u32::MAX);
    (whole && f64::from(scene.global.latency_ticks) < ticks).then_some(ticks as u32)
}
