//! Stability-limit time step of the linear local model: measured on the running model by bisection, and
//! predicted as the step at which the spectral radius of its one-step matrix reaches 1, or the contact cannot be held.

mod subject;

use serde::Serialize;
use thiserror::Error;

use self::subject::{ON_THE_CIRCLE, Subject};
use crate::contact::rules::Scheme;
use crate::local::condensation::{Condensation, Reach};
use crate::local::error::ModelError;
use crate::local::model::ExteriorKind;
use crate::local::step::LocalIntegrator;
use crate::model::network::NetworkError;
use crate::model::springs::TangentKind;
use crate::model::topology::SurfaceError;
use crate::scene::{Scene, SchemeName};
use crate::surface::disc::DiscError;

/// Range of steps that are tried, s.
const SHORTEST: f64 = 1e-9;
const LONGEST: f64 = 10.0;
/// Factor between the steps of the search for the first unstable one. Stable and unstable steps alternate
/// where exact ticks hold a point; a narrower range of unstable steps may be missed.
const LOOKS: f64 = 1.5;
/// Relative resolution of the boundary.
const RESOLUTION: f64 = 7e-4;
/// Largest relative difference of the measured from the predicted boundary.
pub const TOLERANCE: f64 = 0.02;
/// Exteriors that are compared, with their names in scenes. A drifting one adds a force that grows with
/// time to the K and D of a fixed one, so that its boundary is identical.
pub const EXTERIORS: [(&str, ExteriorKind); 2] = [
    ("fixed", ExteriorKind::Fixed),
    ("condensed", ExteriorKind::Condensed(Condensation { tangent: TangentKind::Exact, reach: Reach::All })),
];

/// Varied parameter; all others are the scene's.
///
/// ```
/// use stickslip::verify::stability_map::{Axis, EXTERIORS, points};
///
/// let values: usize = Axis::ALL.into_iter().map(|axis| axis.values().len()).sum();
/// assert_eq!(points().len(), 4 * EXTERIORS.len() * values); // four integrators
/// assert_eq!(Axis::Stiffness.name(), "stiffness (N/m)");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// Stiffness k of every spring, N/m.
    Stiffness,
    /// Factor by which the node that carries most of the contact point is made lighter.
    MassRatio,
    /// Damping ratio ζ = cω_max/2k of the free patch with a fixed exterior.
    DampingRatio,
}

impl Axis {
    /// All parameters.
    pub const ALL: [Self; 3] = [Self::Stiffness, Self::MassRatio, Self::DampingRatio];

    /// Returns the name as it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Axis::Stiffness => "stiffness (N/m)",
            Axis::MassRatio => "mass ratio",
            Axis::DampingRatio => "damping ratio",
        }
    }

    /// Returns the values at which boundaries are measured.
    pub fn values(self) -> &'static [f64] {
        match self {
            Axis::Stiffness => &[1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8],
            Axis::MassRatio => &[1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6],
            Axis::DampingRatio => &[0.0, 0.1, 0.3, 1.0, 3.0, 10.0],
        }
    }
}

/// Point of a map, at which the boundary is measured free and held.
#[derive(Debug, Clone, Copy)]
pub struct MapPoint {
    /// Integrator of the local model.
    pub integrator: LocalIntegrator,
    /// Exterior of the local model, with its name in scenes.
    pub exterior: (&'static str, ExteriorKind),
    /// Varied parameter.
    pub axis: Axis,
    /// Value of the varied parameter.
    pub value: f64,
}

/// Returns every point of every map.
pub fn points() -> Vec<MapPoint> {
    let mut points = Vec::new();
    for integrator in LocalIntegrator::ALL {
        for exterior in EXTERIORS {
            for axis in Axis::ALL {
                points.extend(axis.values().iter().map(|&value| MapPoint { integrator, exterior, axis, value }));
            }
        }
    }
    points
}

/// Whether the patch is touched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Touching {
    /// The patch has no contact.
    Free,
    /// A tip that stands still holds a point of the patch.
    Held,
}

/// Predicted and measured boundary.
#[derive(Debug, Clone, Serialize)]
pub struct Boundary {
    /// Integrator of the local model.
    pub integrator: &'static str,
    /// `geometric` or `velocity`: the scene's scheme where the integrator takes it.
    pub scheme: &'static str,
    /// Exterior of the local model.
    pub exterior: &'static str,
    /// Whether the patch is touched.
    pub touching: Touching,
    /// Varied parameter.
    pub axis: Axis,
    /// Value of the varied parameter.
    pub value: f64,
    /// Predicted stability-limit time step, s; 0 where no step is stable, none where all are.
    pub predicted_s: Option<f64>,
    /// Measured stability-limit time step, s; 0 where no step is stable, none where all are.
    pub measured_s: Option<f64>,
    /// Measured over predicted step; 1 where neither has a limit.
    pub ratio: f64,
    /// Whether the ratio is 1 within [`TOLERANCE`].
    pub agrees: bool,
    /// Reason for a disagreement, where it is known.
    pub reason: Option<String>,
}

/// Why maps cannot be made of a scene.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MapError {
    /// The surface cannot be built.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The mesh has no triangle.
    #[error("the mesh has no surface that can be touched")]
    NoSurface,
    /// The contact is rigid: the patch carries less than half of the contact point.
    #[error("below the tip's first position the patch carries {free_weight:.2} of the contact point, less than half")]
    Rigid {
        /// Weight of the contact point on free nodes, Σ_free w.
        free_weight: f64,
    },
    /// K is singular.
    #[error("the patch can move without a force: nothing holds it against the tip")]
    NotHeld,
    /// The contact cannot be spread over a disc.
    #[error(transparent)]
    Disc(#[from] DiscError),
    /// The network cannot be built.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The local model cannot be built.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Predicts and measures the boundary at a point of a map, free and held.
///
/// # Errors
/// If the scene's tip does not start above a patch that can be pressed.
///
/// ```
/// use stickslip::local::step::LocalIntegrator;
/// use stickslip::scene::Scene;
/// use stickslip::verify::stability_map::{Axis, EXTERIORS, MapPoint, boundaries};
///
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let integrator = LocalIntegrator::SemiImplicitEuler;
/// let point = MapPoint { integrator, exterior: EXTERIORS[0], axis: Axis::DampingRatio, value: 0.0 };
/// let [free, _] = boundaries(&scene, &point)?;
/// // An explicit step is stable up to 2/ω, with a ring of nodes of 10 g on springs of 100 N/m; measured as predicted.
/// let longest = free.measured_s.expect("it has a limit");
/// assert!(free.agrees && longest > 2e-3 && longest < 2e-2);
/// # Ok::<(), stickslip::verify::stability_map::MapError>(())
/// ```
pub fn boundaries(scene: &Scene, point: &MapPoint) -> Result<[Boundary; 2], MapError> {
    let model = Subject::new(scene, point)?;
    // In this step the fastest undamped mode turns by at most one radian: half the limit of an explicit step.
    let first = (1.0 / model.stiffness.norm().sqrt()).clamp(SHORTEST, LONGEST);
    Ok([Touching::Free, Touching::Held].map(|touching| {
        let predicted_s = longest_stable(first, |h| model.spectral_radius(touching, h) <= 1.0 + ON_THE_CIRCLE);
        let measured_s = longest_stable(first, |h| !model.grows(touching, h));
        let ratio = match (measured_s, predicted_s) {
            (Some(measured), Some(predicted)) if measured == predicted => 1.0,
            (Some(measured), Some(predicted)) => measured / predicted,
            (None, None) => 1.0,
            (None, Some(_)) => f64::INFINITY,
            (Some(_), None) => 0.0,
        };
        let agrees = (ratio - 1.0).abs() <= TOLERANCE;
        let reason = if agrees { None } else { model.reason(touching, measured_s, predicted_s) };
        Boundary {
            integrator: point.integrator.name(),
            scheme: SchemeName::from(scheme(scene, point.integrator)).name(),
            exterior: point.exterior.0,
            touching,
            axis: point.axis,
            value: point.value,
            predicted_s,
            measured_s,
            ratio,
            agrees,
            reason,
        }
    }))
}

/// Returns the step up to which all are `stable`: 0 if none is, `None` if all are. It is sought upwards from `first` by
/// factors of [`LOOKS`], since longer steps may be stable again, and then by bisection of the logarithm.
fn longest_stable(first: f64, mut stable: impl FnMut(f64) -> bool) -> Option<f64> {
    let mut looks = std::iter::successors(Some(first), |h| (*h < LONGEST).then_some((h * LOOKS).min(LONGEST)));
    let above = looks.find(|&h| !stable(h))?;
    let mut range = [if above > first { above / LOOKS } else { SHORTEST }, above].map(f64::ln);
    while range[1] - range[0] > RESOLUTION {
        let middle = 0.5 * (range[0] + range[1]);
        range[usize::from(!stable(middle.exp()))] = middle;
    }
    Some(if range[0] > SHORTEST.ln() { (0.5 * (range[0] + range[1])).exp() } else { 0.0 })
}

/// Returns the scene's scheme, or the velocity scheme where the integrator does not take the geometric one.
fn scheme(scene: &Scene, integrator: LocalIntegrator) -> Scheme {
    match integrator {
        LocalIntegrator::ImplicitEuler | LocalIntegrator::ImplicitMidpoint | LocalIntegrator::Exponential
            if !scene.contact.scheme.is_impulsive() =>
        {
            Scheme::Velocity
        }
        _ => scene.contact.scheme,
    }
}
