//! The methods of a comparison.

use super::super::surfaces::whole;
use super::method::{Method, Touching, ticks_per_cycle};
use crate::contact::rules::{Deformation, Scheme};
use crate::local::condensation::{Condensation, FarField, Reach};
use crate::local::model::{ExteriorKind, Linearization, LocalSettings};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::springs::TangentKind;
use crate::pipeline::Simulation;
use crate::scene::{LocalModelName, Scene, SceneError};
use crate::surface::geometry::ContactSurface;
use crate::surface::support::Metric;

/// The paper's local model: one ring of tangents in a fixed exterior.
pub const PAPER: LocalSettings = LocalSettings {
    extent: Extent::Rings(1),
    linearization: Linearization::Tangent(TangentKind::Exact),
    exterior: ExteriorKind::Fixed,
};
/// Rate at which the paper's local model is updated, Hz.
pub const PAPER_RATE_HZ: f64 = 10.0;

/// Largest size of the dense matrices of one local model in a grid, bytes; a scene's own may exceed it.
const MOST_MATRIX_BYTES: usize = 1 << 28;

/// Extent of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coverage {
    /// One and two rings, the paper's rate, the scene's contact: the extent of a report.
    Brief,
    /// One to three rings and all, the paper's rate and five times that, the scene's contact and the velocity
    /// scheme on the limit surface.
    Default,
    /// The default, and four rings, coarse far fields, more rates and more contacts.
    All,
}

/// Methods of a comparison, among them the paper's and the scene's own.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Methods, each once, grouped by contact, the scene's own contact first.
    pub methods: Vec<Method>,
    /// Contacts in the order of the methods.
    pub contacts: Vec<Touching>,
    /// Omitted methods, with the reasons.
    pub omitted: Vec<String>,
}

/// Lists the methods with which a scene's drag is run.
///
/// # Errors
/// If the scene cannot be assembled.
///
/// ```
/// use stickslip::{scene::Scene, verify::accuracy::{Coverage, Method, PAPER, PAPER_RATE_HZ, grid}};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let grid = grid(&scene, Coverage::Default)?;
/// assert!(grid.methods.contains(&Method::of(&scene)));
/// assert!(grid.methods.iter().any(|method| method.local == PAPER && method.global_rate == PAPER_RATE_HZ));
/// assert_eq!(grid.contacts[0], Method::of(&scene).touching); // its own first
/// assert!(grid.methods.iter().enumerate().all(|(i, method)| !grid.methods[..i].contains(method))); // each once
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
pub fn grid(scene: &Scene, coverage: Coverage) -> Result<Grid, SceneError> {
    let own = Method::of(scene);
    Simulation::prepare(scene)?;
    let mut omitted = Vec::new();
    let mut contacts = vec![own.touching];
    for touching in other_contacts(coverage) {
        if !contacts.contains(&touching) {
            match Simulation::prepare(&whole(scene, touching.surface, touching.scheme)) {
                Ok(_) => contacts.push(touching),
                Err(error) => omitted.push(format!("{touching}: {error}")),
            }
        }
    }
    let mut rates = vec![own.global_rate];
    let more: &[f64] = match coverage {
        Coverage::Brief => &[PAPER_RATE_HZ],
        Coverage::Default => &[PAPER_RATE_HZ, 50.0],
        Coverage::All => &[PAPER_RATE_HZ, 20.0, 50.0, 100.0],
    };
    for &rate in more {
        match ticks_per_cycle(scene, rate) {
            Some(_) if rates.contains(&rate) => {}
            Some(_) => rates.push(rate),
            None => omitted
                .push(format!("{rate} Hz: the scene's ticks or its latency do not fit into a cycle at this rate")),
        }
    }
    let free = scene.fixed.iter().filter(|&&fixed| !fixed).count();
    let (mut locals, too_large): (Vec<_>, Vec<_>) =
        local_models(coverage).into_iter().partition(|local| matrix_bytes(local, free) <= MOST_MATRIX_BYTES);
    if !too_large.is_empty() {
        omitted.push(format!("tangents of all rings: the matrix of {free} free nodes is too large"));
    }
    if own.model != LocalModelName::Full && !locals.contains(&own.local) {
        locals.insert(0, own.local);
    }

    let explicit = LocalIntegrator::SemiImplicitEuler;
    let mut methods = Vec::new();
    for &touching in &contacts {
        if own.model == LocalModelName::Full {
            methods.push(Method { touching, ..own });
        }
        for &local in &locals {
            // A model with all springs evaluated at every tick is the full network at any update rate.
            let renewals = if is_exact(&local) { &rates[..1] } else { &rates[..] };
            methods.extend(renewals.iter().map(|&global_rate| Method {
                model: LocalModelName::Patch,
                local,
                integrator: explicit,
                global_rate,
                touching,
            }));
        }
        if touching.scheme.is_impulsive() {
            let implicit = SOLVED.into_iter().flat_map(|integrator| {
                let solved = locals.iter().filter(|local| is_solvable(local));
                solved.map(move |&local| (integrator, local))
            });
            methods.extend(implicit.map(|(integrator, local)| Method {
                model: LocalModelName::Patch,
                local,
                integrator,
                global_rate: own.global_rate,
                touching,
            }));
        }
        if own.model != LocalModelName::Full && own.touching == touching && !methods.contains(&own) {
            methods.push(own);
        }
    }
    Ok(Grid { methods, contacts, omitted })
}

/// Integrators that solve the linear model exactly or implicitly.
const SOLVED: [LocalIntegrator; 3] =
    [LocalIntegrator::ImplicitEuler, LocalIntegrator::ImplicitMidpoint, LocalIntegrator::Exponential];

/// Returns whether such integrators are compared on a local model: one or two rings, fixed (the paper's) or condensed.
fn is_solvable(local: &LocalSettings) -> bool {
    let small = matches!(local.extent, Extent::Rings(1 | 2));
    let followed = Condensation { tangent: TangentKind::Exact, reach: Reach::All };
    let exterior = [ExteriorKind::Fixed, ExteriorKind::Condensed(followed)].contains(&local.exterior);
    small && exterior && local.linearization == Linearization::Tangent(TangentKind::Exact)
}

fn is_exact(local: &LocalSettings) -> bool {
    (local.extent, local.linearization) == (Extent::All, Linearization::None)
}

/// Returns the contacts that are compared beside the scene's own.
fn other_contacts(coverage: Coverage) -> Vec<Touching> {
    let geometric = |surface, deformation| {
        let scheme = Scheme::Geometric { deformation, metric: Metric::Euclidean };
        Touching { surface, scheme }
    };
    let velocity = |surface| Touching { surface, scheme: Scheme::Velocity };
    let mut contacts = match coverage {
        Coverage::Brief => Vec::new(),
        Coverage::Default | Coverage::All => vec![velocity(ContactSurface::Subdivision)],
    };
    if coverage == Coverage::All {
        contacts.extend([
            geometric(ContactSurface::Faceted, Deformation::Rigid),
            geometric(ContactSurface::Shaded, Deformation::LeastNorm),
            velocity(ContactSurface::Faceted),
        ]);
    }
    contacts
}

/// Returns the local models that are compared.
fn local_models(coverage: Coverage) -> Vec<LocalSettings> {
    use Linearization::{None as Springs, Tangent};
    use TangentKind::{Exact, Stabilised};
    let most_rings = match coverage {
        Coverage::Brief => 2,
        Coverage::Default => 3,
        Coverage::All => 4,
    };
    let mut models = Vec::new();
    for rings in 1..=most_rings {
        let mut reaches = vec![Reach::All];
        if coverage == Coverage::All {
            reaches.push(Reach::Rings { rings: rings + 2, far_field: FarField::Coarse });
        }
        for linearization in [Tangent(Exact), Tangent(Stabilised), Springs] {
            let condensed_by: &[TangentKind] = match linearization {
                Tangent(Exact) => &[Exact],
                Tangent(Stabilised) => &[Stabilised],
                Springs => &[Exact, Stabilised],
            };
            let condensed = condensed_by.iter().flat_map(|&tangent| {
                reaches.iter().map(move |&reach| ExteriorKind::Condensed(Condensation { tangent, reach }))
            });
            let exteriors = [ExteriorKind::Fixed, ExteriorKind::Drifting].into_iter().chain(condensed);
            let extent = Extent::Rings(rings);
            models.extend(exteriors.map(|exterior| LocalSettings { extent, linearization, exterior }));
        }
    }
    models.extend([Tangent(Exact), Tangent(Stabilised), Springs].map(|linearization| LocalSettings {
        extent: Extent::All,
        linearization,
        exterior: ExteriorKind::Fixed,
    }));
    models
}

/// Returns the size of \[K D\] of a patch, 3m × 6m, in bytes.
fn matrix_bytes(local: &LocalSettings, free: usize) -> usize {
    let m = match local.extent {
        Extent::All => free,
        Extent::Rings(rings) => free.min((2 * rings as usize + 1).saturating_pow(3)),
    };
    match local.linearization {
        Linearization::Tangent(_) => m.saturating_mul(m).saturating_mul(18 * size_of::<f64>()),
        Linearization::None => 0,
    }
}
