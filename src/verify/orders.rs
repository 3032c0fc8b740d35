//! Observed orders of convergence and momentum defects: every integrator with every scheme that it takes, on smooth
//! motions of a small block in which nothing but the step varies.

use std::path::Path;

use serde::Serialize;
use thiserror::Error;

use super::residual::{self, larger};
use super::surfaces::SCHEMES;
use crate::Vec3;
use crate::contact::law::Law;
use crate::contact::rules::Scheme;
use crate::device::path::{PathError, TipPath, Waypoint};
use crate::dynamics::constraint::Unconstrained;
use crate::dynamics::integrators::{GlobalIntegrator, Stepper};
use crate::local::step::LocalIntegrator;
use crate::model::network::{Network, NetworkError};
use crate::pipeline::{self, RunError, TickView};
use crate::scene::{Scene, SceneError, SchemeName};

/// A single linear local model of the whole block, kept for the whole motion.
const SCENE: &str = r#"
name = "orders"
duration = 0.09
[mesh]
nodes = [5, 5, 3]
spacing = 0.0125
[material]
node_mass = 0.01
stiffness = 100.0
damping = 0.5
[local]
rings = "all"
[contact]
law = "sliding"
surface = "subdivision"
[instrument]
waypoints = [[0.0, -0.01, 0.0013, 1.0], [1.0, -0.01, 0.0013, 1.0]]
"#;
/// Divisors of the 1 ms tick. The line is fitted to the differences between successive runs, C hᵖ(1 − 2⁻ᵖ), which have
/// the slope of the errors themselves, so that no reference run with much shorter steps is needed.
const DIVISORS: [u32; 5] = [2, 4, 8, 16, 32];
const DIFFERENCES: usize = DIVISORS.len() - 1;
/// Gravity of the free motions, in which the block begins to sag, m/s².
const GRAVITY: f64 = 9.81;
/// Relative differences below this are rounding.
const EXACT_BELOW: f64 = 1e-10;

/// Motion of the block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// The block sags without a contact.
    Free,
    /// A tip presses the block and slides on it.
    Sliding,
    /// A tip presses the block and drags it along.
    Sticking,
    /// A tip presses and drags the block, which has no dampers.
    StickingUndamped,
}

impl Motion {
    /// All motions.
    pub const ALL: [Self; 4] = [Self::Free, Self::Sliding, Self::Sticking, Self::StickingUndamped];

    /// Returns the name as it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Motion::Free => "none",
            Motion::Sliding => "sliding",
            Motion::Sticking => "sticking",
            Motion::StickingUndamped => "sticking, undamped",
        }
    }
}

/// Case whose order is observed.
///
/// ```
/// use stickslip::verify::orders::{Case, Motion};
///
/// let cases = Case::all();
/// let free = cases.iter().filter(|case| matches!(case, Case::Local(_, _, Motion::Free))).count();
/// assert_eq!(free, 4, "each local integrator once: without a contact there is no scheme to vary");
/// assert_eq!(Motion::StickingUndamped.name(), "sticking, undamped");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Case {
    /// The local model, by integrator, scheme and motion.
    Local(LocalIntegrator, Scheme, Motion),
    /// The whole network, which sags.
    Global(GlobalIntegrator),
}

impl Case {
    /// Returns every integrator with every scheme it takes, in every motion. Without a contact no scheme is varied.
    pub fn all() -> Vec<Self> {
        let mut cases = Vec::new();
        for integrator in LocalIntegrator::ALL {
            let takes =
                |scheme: &Scheme| integrator == LocalIntegrator::SemiImplicitEuler || *scheme == Scheme::Velocity;
            // The massless scheme's order is among the limits of contact.
            let compared = SCHEMES.into_iter().filter(|(_, scheme)| *scheme != Scheme::Massless && takes(scheme));
            for (_, scheme) in compared {
                let motions =
                    Motion::ALL.into_iter().filter(|&each| each != Motion::Free || scheme == Scheme::Velocity);
                cases.extend(motions.map(|motion| Case::Local(integrator, scheme, motion)));
            }
        }
        let global = [GlobalIntegrator::SemiImplicitEuler, GlobalIntegrator::ImplicitEuler, GlobalIntegrator::Rk4];
        cases.extend(global.map(Case::Global));
        cases
    }
}

/// Why an order could not be observed.
#[derive(Debug, Error)]
pub enum OrderError {
    /// The block's scene is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The block's springs or masses are invalid.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The tip's path is invalid.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A run ended early.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// Row of the table of orders.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObservedOrder {
    /// Name of the local model's integrator as in scenes; preceded by "global" for the network's.
    pub integrator: String,
    /// "geometric" or "velocity"; none without a contact.
    pub scheme: Option<&'static str>,
    /// "sliding", "sticking", "sticking, undamped" or "none".
    pub law: &'static str,
    /// Order in which the positions at the end converge with the step: slope of a least-squares line through the
    /// logarithms of their changes as the step is halved four times; none where the changes are rounding alone.
    pub order: Option<f64>,
    /// Largest distance of the logarithm of a change from that line.
    pub residual: Option<f64>,
    /// Momentum defect of a loose block in the same contact ([`momentum_defect`]); none without a contact.
    pub momentum_defect: Option<f64>,
}

/// Observes the order of a case, and its momentum defect.
///
/// # Errors
/// If a run ends early.
///
/// ```
/// use stickslip::dynamics::integrators::GlobalIntegrator;
/// use stickslip::verify::orders::{Case, observe};
///
/// let observed = observe(Case::Global(GlobalIntegrator::SemiImplicitEuler))?;
/// let order = observed.order.expect("its errors are more than rounding");
/// assert!((order - 1.0).abs() < 0.1, "{order}");
/// assert_eq!(observed.integrator, "global semi-implicit-euler");
/// # Ok::<(), stickslip::verify::orders::OrderError>(())
/// ```
pub fn observe(case: Case) -> Result<ObservedOrder, OrderError> {
    let at = |divisor| match case {
        Case::Local(integrator, scheme, motion) => local_positions(integrator, scheme, motion, divisor),
        Case::Global(integrator) => global_positions(integrator, divisor),
    };
    let (start, mut coarser) = at(DIVISORS[0])?;
    let moved = distance(&coarser, &start);
    let mut differences = [0.0; DIFFERENCES];
    for (difference, &divisor) in differences.iter_mut().zip(&DIVISORS[1..]) {
        let (_, finer) = at(divisor)?;
        *difference = distance(&coarser, &finer) / moved;
        coarser = finer;
    }
    // Negated, so that NaN does not pass for an exact result: its order is NaN, which fails every comparison.
    let line = (!(differences[0] <= EXACT_BELOW)).then(|| line(differences));
    let (order, residual) = line.unzip();
    let (integrator, scheme, law) = match case {
        Case::Local(integrator, scheme, motion) => (
            integrator.name().to_owned(),
            (motion != Motion::Free).then(|| SchemeName::from(scheme).name()),
            motion.name(),
        ),
        Case::Global(integrator) => (format!("global {}", integrator.name()), None, Motion::Free.name()),
    };
    let momentum_defect = match case {
        Case::Local(_, _, Motion::Free) | Case::Global(_) => None,
        Case::Local(integrator, scheme, motion) => Some(momentum_defect(&loose(integrator, scheme, motion)?)?),
    };
    Ok(ObservedOrder { integrator, scheme, law, order, residual, momentum_defect })
}

/// Returns the largest |Σ m v − impulse of the tip| over the largest |Σ m v|, at the ends of ticks, for a scene without
/// any other external force. NaN if nothing moves.
///
/// # Errors
/// If the run ends early.
///
/// ```
/// use stickslip::{contact::rules::Scheme, surface::geometry::ContactSurface};
/// use stickslip::{scene::Scene, verify::{orders::momentum_defect, surfaces::whole}};
///
/// // A block that nothing holds, pushed away by the tip: action and reaction.
/// let scene = Scene::shipped("fig4-sticking").expect("shipped with the program");
/// let mut scene = whole(&scene, ContactSurface::Faceted, Scheme::Velocity);
/// scene.fixed.fill(false);
/// scene = scene.with_ticks(120);
/// assert!(momentum_defect(&scene)? < 1e-11);
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
pub fn momentum_defect(scene: &Scene) -> Result<f64, RunError> {
    let mut impulse = Vec3::zeros();
    let (mut largest, mut defect) = (0.0_f64, 0.0_f64);
    pipeline::run(scene, |view| {
        impulse -= view.force * scene.tick_s();
        let nodes = view.local.model().patch.mass.iter().zip(&view.local.state().v);
        let momentum: Vec3 = nodes.map(|(mass, v)| v * *mass).sum();
        largest = larger(largest, momentum.norm());
        defect = larger(defect, (momentum - impulse).norm());
    })?;
    Ok(defect / largest)
}

/// Fits a least-squares line through the logarithms of differences from [`DIVISORS`] on, and returns its slope and the
/// largest distance from it.
fn line(differences: [f64; DIFFERENCES]) -> (f64, f64) {
    let points = DIVISORS.iter().zip(differences).map(|(divisor, size)| (-f64::from(*divisor).ln(), size.ln()));
    let points: Vec<(f64, f64)> = points.collect();
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let products = |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|point| of(point.0 - x, point.1 - y)).sum::<f64>();
    let slope = products(&|x, y| x * y) / products(&|x, _| x * x);
    let off = points.iter().map(|point| (point.1 - y - slope * (point.0 - x)).abs());
    (slope, residual::largest(off))
}

fn distance(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>().sqrt()
}

/// Builds the scene of the block in a motion, with the tick divided by `divisor`.
fn scene(integrator: LocalIntegrator, scheme: Scheme, motion: Motion, divisor: u32) -> Result<Scene, OrderError> {
    let mut scene = Scene::parse(SCENE, Path::new("orders"))?;
    (scene.integrator, scene.contact.scheme) = (integrator, scheme);
    let rate_hz = scene.local_rate_hz() * f64::from(divisor);
    let mut scene = scene.with_local_rate_hz(rate_hz)?;
    match motion {
        Motion::Free => scene.material.gravity = Vec3::z() * -GRAVITY,
        Motion::Sliding => scene.contact.law = Law::Sliding,
        Motion::Sticking => scene.contact.law = Law::Sticking,
        Motion::StickingUndamped => {
            scene.contact.law = Law::Sticking;
            scene.material.damping = 0.0.into();
        }
    }
    if motion != Motion::Free {
        scene.path = smooth_path()?;
    }
    Ok(scene)
}

/// Builds the scene of the same block without fixed nodes, with unequal masses.
fn loose(integrator: LocalIntegrator, scheme: Scheme, motion: Motion) -> Result<Scene, OrderError> {
    let mut scene = scene(integrator, scheme, motion, 1)?;
    scene.fixed.fill(false);
    scene.material.node_mass.iter_mut().enumerate().for_each(|(i, mass)| *mass *= 1.0 + (i % 3) as f64);
    Ok(scene)
}

/// Builds a path 3 mm down and 4 mm along x from a tip at rest on the surface, with two continuous derivatives and a
/// waypoint at every end of the shortest tick.
fn smooth_path() -> Result<TipPath, PathError> {
    let blend = |t: f64| {
        let t = t.clamp(0.0, 1.0);
        t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
    };
    let shortest = DIVISORS[DIFFERENCES];
    let at = |i: u32| {
        let time = f64::from(i) * 1e-3 / f64::from(shortest);
        let along = -0.01 + 0.004 * blend((time - 0.04) / 0.05);
        Waypoint { time, position: Vec3::new(along, 0.0013, -0.003 * blend(time / 0.08)) }
    };
    TipPath::new((0..=100 * shortest).map(at).collect())
}

/// Returns positions at the start and at the end.
fn local_positions(
    integrator: LocalIntegrator,
    scheme: Scheme,
    motion: Motion,
    divisor: u32,
) -> Result<(Vec<Vec3>, Vec<Vec3>), OrderError> {
    let scene = scene(integrator, scheme, motion, divisor)?;
    let mut end = Vec::new();
    pipeline::run(&scene, |view: &TickView| {
        if view.tick + 1 == scene.tick_count() {
            end.clone_from(&view.local.state().x);
        }
    })?;
    // All free nodes in ascending order, then the fixed ones.
    let mesh = scene.mesh.mesh().nodes;
    let nodes = |fixed: bool| mesh.iter().zip(&scene.fixed).filter(move |(_, is)| **is == fixed).map(|(x, _)| *x);
    Ok((nodes(false).chain(nodes(true)).collect(), end))
}

fn global_positions(integrator: GlobalIntegrator, divisor: u32) -> Result<(Vec<Vec3>, Vec<Vec3>), OrderError> {
    let scene = scene(LocalIntegrator::SemiImplicitEuler, Scheme::Velocity, Motion::Free, divisor)?;
    let network = Network::new(&scene.mesh.mesh(), &scene.material, scene.fixed.clone())?;
    let mut state = network.rest_state();
    let mut stepper = Stepper::new(&network);
    for _ in 0..scene.tick_count() {
        stepper.step(integrator, &network, &mut state, scene.tick_s(), &Unconstrained);
    }
    Ok((network.rest, state.x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_of_the_orders_passes_its_check() {
        for case in Case::all() {
            let Case::Local(integrator, scheme, motion) = case else { continue };
            let finer = DIVISORS.map(|divisor| scene(integrator, scheme, motion, divisor));
            for scene in finer.into_iter().chain([loose(integrator, scheme, motion)]) {
                let checked = scene.map_err(|error| error.to_string()).map(|scene| scene.check());
                assert!(matches!(checked, Ok(Ok(()))), "{case:?}: {checked:?}");
            }
        }
    }
}
