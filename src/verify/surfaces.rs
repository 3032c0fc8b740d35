//! Effect of contact surface and scheme on the force: one drag, run with every combination
//! and the whole network at the haptic rate, so that nothing but the contact differs.

use serde::Serialize;

use crate::Vec3;
use crate::contact::law::Law;
use crate::contact::rules::{Deformation, Scheme};
use crate::model::mesh::Block;
use crate::multirate::energy::EnergyBalance;
use crate::output::measures::ContactMeasures;
use crate::output::spectrum::power_above;
use crate::pipeline::{self, RunError};
use crate::scene::{MeshSource, Scene};
use crate::surface::geometry::ContactSurface;
use crate::surface::support::Metric;

/// Drags that are compared: 6 mm deep, one for each law.
pub const DRAGS: [&str; 3] = ["deep-sliding", "deep-sticking", "deep-stick-slip"];
/// Contact surfaces, each with its name in scenes.
pub const SURFACES: [(&str, ContactSurface); 3] = [
    ("faceted", ContactSurface::Faceted),
    ("shaded", ContactSurface::Shaded),
    ("subdivision", ContactSurface::Subdivision),
];
/// Contact schemes, each with its name in scenes; the geometric one with its smallest deformation.
pub const SCHEMES: [(&str, Scheme); 3] = [
    ("geometric", Scheme::Geometric { deformation: Deformation::LeastNorm, metric: Metric::Euclidean }),
    ("velocity", Scheme::Velocity),
    ("massless", Scheme::Massless),
];

/// Begin of the evaluation, s. The press ends at 0.2 s with a jump of the tip's velocity, which has decayed by then.
const SETTLED_S: f64 = 0.25;
/// Lower limit of the frequencies that count as ripple, Hz.
const RIPPLE_HZ: f64 = 100.0;

/// Combination of a drag, a surface and a scheme.
#[derive(Debug, Clone)]
pub struct Combination {
    /// Name of the drag.
    pub drag: &'static str,
    /// Name of the surface.
    pub surface: &'static str,
    /// Name of the scheme.
    pub scheme: &'static str,
    /// Edge of the mesh, m.
    pub spacing_m: f64,
    /// Scene to run.
    pub scene: Scene,
}

/// Force measures from the end of the press on, and the energy balance of the whole run.
#[derive(Debug, Clone, Serialize)]
pub struct SurfaceMeasures {
    /// Fault that ended the run early, if one did.
    pub fault: Option<String>,
    /// Mean magnitude of the force, N.
    pub mean_force_n: f64,
    /// Largest force jump as [`ContactMeasures`] defines it, N.
    pub largest_jump_n: f64,
    /// Largest force jump over the mean force.
    pub jump_relative: f64,
    /// Mean square of the force above 100 Hz, N².
    pub power_above_100_hz_n2: f64,
    /// Amplitude of the force, over its mean, at the frequency at which the tip passes edges; absent
    /// for a sticking tip.
    pub mesh_ripple_relative: Option<f64>,
    /// Contact losses as [`ContactMeasures`] defines them.
    pub contact_losses: u64,
    /// Changes of contact mode per second.
    pub mode_switches_per_s: f64,
    /// Residual of the energy balance over the total |work|.
    pub energy_residual_relative: f64,
}

/// Returns every combination over one mesh. `refinement` divides the drag's block further, with the same material:
/// stiffness proportional to the spacing, masses to its cube, and an unchanged damping ratio.
///
/// ```
/// use stickslip::verify::surfaces::{DRAGS, SCHEMES, SURFACES, grid};
///
/// let (coarse, fine) = (grid(1), grid(2));
/// assert_eq!(coarse.len(), DRAGS.len() * SURFACES.len() * SCHEMES.len());
/// assert!(coarse.iter().chain(&fine).all(|combination| combination.scene.check().is_ok()));
/// assert_eq!(fine[0].spacing_m, coarse[0].spacing_m / 2.0);
/// // The same body in finer pieces: an eighth of the mass per node, springs half as stiff.
/// let [coarse, fine] = [&coarse[0], &fine[0]].map(|each| &each.scene.material);
/// assert_eq!(fine.node_mass[0], coarse.node_mass[0] / 8.0);
/// assert_eq!(fine.stiffness.range()[0], coarse.stiffness.range()[0] / 2.0);
/// ```
pub fn grid(refinement: usize) -> Vec<Combination> {
    let mut grid = Vec::new();
    for drag in DRAGS {
        let Some(shipped) = Scene::shipped(drag) else { continue };
        for (surface, kind) in SURFACES {
            for (scheme, rules) in SCHEMES {
                let mut scene = whole(&shipped, kind, rules);
                refine(&mut scene, refinement);
                scene.name = format!("{drag}-{surface}-{scheme}");
                grid.push(Combination { drag, surface, scheme, spacing_m: scene.mesh.spacing(), scene });
            }
        }
    }
    grid
}

/// Returns the drag with the whole network at the haptic rate, over another surface, with another scheme, and without a
/// limit of the contact force.
///
/// ```
/// use stickslip::{contact::rules::Scheme, surface::geometry::ContactSurface};
/// use stickslip::{pipeline::Simulation, scene::Scene, verify::surfaces::whole};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let whole = whole(&scene, ContactSurface::Faceted, Scheme::Velocity);
/// let free = whole.fixed.iter().filter(|&&fixed| !fixed).count();
/// assert_eq!(Simulation::prepare(&whole)?.local().model().patch.len(), free); // every node that can move
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
pub fn whole(scene: &Scene, surface: ContactSurface, scheme: Scheme) -> Scene {
    let mut whole = scene.clone().with_full_model().with_surface(surface).with_scheme(scheme);
    // The reference drives no device, and the impacts of the velocity scheme grow as 1/h.
    whole.force_limit_n = f64::MAX;
    whole
}

/// Divides a scene's block further, with the same material.
pub(super) fn refine(scene: &mut Scene, refinement: usize) {
    let factor = refinement as f64;
    let MeshSource::Block(coarse) = scene.mesh else { return };
    let block = Block {
        nodes: coarse.nodes.map(|count| (count - 1) * refinement + 1),
        spacing: coarse.spacing / factor,
        stencil: coarse.stencil,
    };
    let count = block.nodes.iter().product();
    scene.mesh = block.into();
    scene.fixed = scene.mesh.bottom();
    let material = &mut scene.material;
    let mass = material.node_mass.first().copied().unwrap_or_default();
    material.node_mass = vec![mass / factor.powi(3); count];
    material.stiffness /= factor;
    material.damping /= factor * factor;
}

/// Runs a scene and measures its force. `progress` is called with the number of ticks done.
///
/// # Errors
/// If the scene cannot start. A fault is part of the result.
///
/// ```
/// use stickslip::{scene::Scene, verify::surfaces::measure};
///
/// let measures = |name| {
///     let scene = Scene::shipped(name).expect("shipped with the program");
///     let mut done = 0;
///     let measures = measure(&scene, |ticks| done = ticks);
///     assert_eq!(done, scene.tick_count());
///     measures
/// };
/// // From facet to facet the normal jumps, and the force with it.
/// let (faceted, smooth) = (measures("fig3-sliding")?, measures("fig3-sliding-subdivision")?);
/// assert!(smooth.jump_relative < faceted.jump_relative);
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
pub fn measure(scene: &Scene, mut progress: impl FnMut(u64)) -> Result<SurfaceMeasures, RunError> {
    let settled = (SETTLED_S / scene.tick_s()) as u64;
    let (mut forces, mut contact): (Vec<Vec3>, _) = (Vec::new(), ContactMeasures::default());
    let mut energy = EnergyBalance::default();
    let end = pipeline::run(scene, |view| {
        if view.tick >= settled {
            forces.push(view.force);
            contact.record(view);
        }
        energy = *view.energy;
        progress(view.tick + 1);
    });
    let fault = match end {
        Ok(()) => None,
        Err(RunError::Fault(fault)) => Some(fault.to_string()),
        Err(error) => return Err(error),
    };
    let mean = forces.iter().map(Vec3::norm).sum::<f64>() / forces.len() as f64;
    let jump = contact.largest_force_jump().newtons;
    let slides = scene.contact.law != Law::Sticking;
    Ok(SurfaceMeasures {
        fault,
        mean_force_n: mean,
        largest_jump_n: jump,
        jump_relative: jump / mean,
        power_above_100_hz_n2: power_above(&forces, scene.local_rate_hz(), RIPPLE_HZ),
        mesh_ripple_relative: slides.then(|| ripple(scene, &forces).map(|amplitude| amplitude / mean)).flatten(),
        contact_losses: contact.contact_losses(),
        mode_switches_per_s: contact.mode_switches() as f64 / (forces.len() as f64 * scene.tick_s()),
        energy_residual_relative: energy.residual() / energy.absolute_work,
    })
}

/// Returns the amplitude of the force's magnitude at the frequency at which the tip passes from edge to edge, N, over
/// the last whole number of edges; `None` for a tip that passes none.
fn ripple(scene: &Scene, forces: &[Vec3]) -> Option<f64> {
    let end = scene.tick_count() as f64 * scene.tick_s();
    let way = scene.path.at(end) - scene.path.at(end - scene.tick_s());
    let edges_per_tick = way.norm() / scene.mesh.spacing();
    let ticks_per_edge = (1.0 / edges_per_tick).round();
    if !(ticks_per_edge >= 2.0 && ticks_per_edge <= forces.len() as f64) {
        return None;
    }
    let period = ticks_per_edge as usize;
    let window = &forces[forces.len() % period..];
    let mean = window.iter().map(Vec3::norm).sum::<f64>() / window.len() as f64;
    let (mut cosine, mut sine) = (0.0, 0.0);
    for (i, force) in window.iter().enumerate() {
        let phase = std::f64::consts::TAU * i as f64 / ticks_per_edge;
        cosine += (force.norm() - mean) * phase.cos();
        sine += (force.norm() - mean) * phase.sin();
    }
    Some(2.0 * f64::hypot(cosine, sine) / window.len() as f64)
}
