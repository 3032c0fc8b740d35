//! One way to run a drag, and its words.

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

/// How the tip meets the mesh.
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
    /// What it feels.
    pub surface: ContactSurface,
    /// How it constrains.
    pub scheme: Scheme,
}

/// One way to run a drag.
///
/// ```
/// use stickslip::{scene::{Rings, Scene}, verify::accuracy::Method};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let method = Method::of(&scene);
/// assert_eq!(method.to_string(), "1 ring, tangent, fixed, exact, 10 Hz"); // the paper's
/// let names = method.names();
/// assert_eq!((names.model, names.rings, names.far_field), ("patch", Rings::Count(1), None));
/// assert_eq!(method.touching.to_string(), "geometric scheme on the faceted surface, rigid");
/// assert_eq!(method.touching.names().model, "full"); // what it is held against
///
/// // Renewed five times as often, with steps of the network as long as before.
/// let often = Method { global_rate: 50.0, ..method }.scene(&scene);
/// assert_eq!((often.ticks_per_cycle(), often.global.substeps), (20, 20));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    /// `model = "full"`: there is no local model.
    pub is_full: bool,
    /// The local model.
    pub local: LocalSettings,
    /// How its ticks are solved.
    pub integrator: LocalIntegrator,
    /// How often it is renewed, Hz.
    pub global_rate: f64,
    /// The contact.
    pub touching: Touching,
}

/// A method in the words of scenes; `None` where a key has no effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Names {
    /// "patch" or "full".
    pub model: &'static str,
    /// A number, or "all".
    pub rings: Rings,
    /// "tangent" or "none".
    pub linearization: &'static str,
    /// "fixed", "drifting" or "condensed".
    pub exterior: Option<&'static str>,
    /// "exact" or "stabilised".
    pub tangent: Option<&'static str>,
    /// How far a condensed exterior follows; "all" of it, or springs from the centre.
    pub condense_rings: Option<Rings>,
    /// What lies beyond, "fixed" or "coarse".
    pub far_field: Option<&'static str>,
    /// Of the local model.
    pub integrator: &'static str,
    /// "geometric" or "velocity".
    pub scheme: &'static str,
    /// "faceted", "shaded" or "subdivision".
    pub surface: &'static str,
    /// "rigid" or "least-norm".
    pub deformation: Option<&'static str>,
    /// "euclidean" or "mass".
    pub metric: Option<&'static str>,
    /// Hz.
    pub global_rate: f64,
}

impl Method {
    /// What a scene asks for.
    pub fn of(scene: &Scene) -> Self {
        Self {
            is_full: scene.is_full(),
            local: scene.local(),
            integrator: scene.integrator,
            global_rate: scene.global_rate_hz(),
            touching: Touching { surface: scene.surface, scheme: scene.contact.scheme },
        }
    }

    /// The scene's drag, run this way. The substeps of the global side stay as long as they are.
    pub fn scene(&self, scene: &Scene) -> Scene {
        let own = scene.clone().with_surface(self.touching.surface).with_scheme(self.touching.scheme);
        let mut own = if self.is_full {
            own.with_full_model()
        } else {
            own.with_local_model(self.local).with_local_integrator(self.integrator)
        };
        let Some(ticks) = ticks_per_cycle(scene, self.global_rate) else { return own };
        let substeps = f64::from(scene.global.substeps) * f64::from(ticks) / f64::from(scene.ticks_per_cycle());
        own.global.substeps = (substeps.round() as u32).max(1);
        own.with_ticks_per_cycle(ticks)
    }

    /// In the words of scenes.
    pub fn names(&self) -> Names {
        let LocalSettings { extent, linearization, exterior } = self.local;
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
            Scheme::Velocity => (None, None),
        };
        let model = if self.is_full { LocalModelName::Full } else { LocalModelName::Patch };
        Names {
            model: model.name(),
            rings: extent.into(),
            linearization: LinearizationName::from(linearization).name(),
            exterior: (extent != Extent::All).then_some(ExteriorName::from(exterior).name()),
            tangent: tangent.map(TangentKind::name),
            condense_rings,
            far_field,
            integrator: self.integrator.name(),
            scheme: SchemeName::from(self.touching.scheme).name(),
            surface: self.touching.surface.name(),
            deformation,
            metric,
            global_rate: self.global_rate,
        }
    }
}

impl Touching {
    /// In the words of scenes, with the full network.
    pub fn names(self) -> Names {
        Method {
            is_full: true,
            local: LocalSettings::FULL,
            integrator: LocalIntegrator::SemiImplicitEuler,
            global_rate: 0.0,
            touching: self,
        }
        .names()
    }
}

/// The local model and its rate; not the contact.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_full {
            return f.write_str("full network");
        }
        let Names { rings, linearization, exterior, tangent, condense_rings, global_rate, .. } = self.names();
        write!(f, "{rings}, {linearization}")?;
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

/// Ticks in a cycle of this rate; `None` if it is no whole number, or the scene's models come later than that.
pub(super) fn ticks_per_cycle(scene: &Scene, rate: f64) -> Option<u32> {
    let ratio = scene.local_rate_hz() / rate;
    let ticks = ratio.round();
    let whole = (ratio - ticks).abs() <= 1e-9 * ratio && ticks >= 1.0 && ticks <= f64::from(u32::MAX);
    (whole && f64::from(scene.global.latency_ticks) < ticks).then_some(ticks as u32)
}
