//! Stability of any renderer: stiffer and stiffer bodies under the modelled device in a hand (Z-width), and tips that jump
//! within one tick. Nothing of the renderer but its forces is known.

use serde::Serialize;

use super::buzz::{HighPass, PERCEIVED_M};
use super::conformance::motions::Site;
use super::residual::larger;
use crate::Vec3;
use crate::device::coupled::CoupledSettings;
use crate::device::instrument::InstrumentKind;
use crate::device::path::{Interpolation, PathError, TipPath, Waypoint};
use crate::output::verdict::Verdict;
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError, Schedule};

/// Factors on the stiffness of all springs.
const FACTORS: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
/// Depths of jumps into the body, in depths of a press.
const JUMPS: [f64; 4] = [1.0, 3.0, 10.0, 30.0];
/// Height of the hand's set-point above and below the surface, m.
const SET_POINT_M: f64 = 5e-3;
/// Time at which the hand has reached its set-point, s.
const PRESSED_S: f64 = 0.3;
/// Time from which the tip is observed, s.
const SETTLED_S: f64 = 0.8;
/// End of the observation, s.
const END_S: f64 = 1.2;
/// Ticks before a jump, and after it.
const FREE_TICKS: u64 = 100;
const INSIDE_TICKS: u64 = 50;

/// A body, stiffer than the scene's, under the modelled device in a hand.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StifferBody {
    /// Factor on the stiffness of all springs; dampers keep their damping ratio.
    pub factor: f64,
    /// Force at the end, N.
    pub force_n: f64,
    /// Largest motion of the tip above 50 Hz while the hand keeps still, m; absent after a fault.
    pub buzz_m: Option<f64>,
    /// Fault that ended the run, if one did.
    pub fault: Option<String>,
    /// Whether the hand feels no buzz.
    pub is_quiet: bool,
}

/// A jump of the tip into the body within one tick.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Jump {
    /// Depth after the jump, m.
    pub depth_m: f64,
    /// Largest force, N.
    pub peak_n: f64,
    /// Force 50 ticks after the jump, N.
    pub settled_n: f64,
    /// Fault that ended the run, if one did.
    pub fault: Option<String>,
}

/// Stability of a renderer over a scene's body.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RenderedStability {
    /// FAIL if the scene's own body buzzes or ends in a fault, or a jump does.
    pub verdict: Verdict,
    /// The findings.
    pub reasons: Vec<String>,
    /// Bodies by stiffness.
    pub z_width: Vec<StifferBody>,
    /// Jumps by depth.
    pub jumps: Vec<Jump>,
}

impl RenderedStability {
    /// Examines the renderer of a scene. `None` if the scene's path never touches the body. `done` is called after each of
    /// [`RUNS`] runs.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn of(scene: &Scene, mut done: impl FnMut()) -> Result<Option<Self>, SceneError> {
        let Some(site) = Site::of(scene)? else { return Ok(None) };
        let (mut z_width, mut jumps) = (Vec::new(), Vec::new());
        for factor in FACTORS {
            z_width.push(under_hand(scene, &site, factor)?);
            done();
        }
        for depths in JUMPS {
            jumps.push(jump(scene, &site, depths)?);
            done();
        }
        let mut reasons = Vec::new();
        let quiet: Vec<f64> = z_width.iter().take_while(|body| body.is_quiet).map(|body| body.factor).collect();
        let is_quiet = !quiet.is_empty();
        reasons.push(match (quiet.last(), z_width.get(quiet.len())) {
            (Some(factor), Some(next)) => format!(
                "a hand feels no buzz up to {factor} times the body's stiffness; at {} times, {}",
                next.factor,
                next.fault
                    .clone()
                    .unwrap_or_else(|| format!("the tip shakes by {:.2e} m", next.buzz_m.unwrap_or(f64::NAN)))
            ),
            (Some(factor), None) => format!("a hand feels no buzz up to {factor} times the body's stiffness"),
            (None, next) => {
                let fault = next.and_then(|next| next.fault.clone());
                format!("the body itself buzzes in a hand: {}", fault.unwrap_or_else(|| "the tip shakes".to_owned()))
            }
        });
        let fault = jumps.iter().find_map(|jump| Some((jump.depth_m, jump.fault.as_ref()?)));
        let is_bounded = jumps.iter().all(|jump| jump.peak_n.is_finite());
        reasons.push(match fault {
            Some((depth_m, fault)) => format!("a jump of {:.2} mm into the body ends the run: {fault}", 1e3 * depth_m),
            None => {
                let peak = jumps.iter().map(|jump| jump.peak_n).fold(0.0, larger);
                format!("jumps into the body command at most {peak:.3} N")
            }
        });
        let passes = is_quiet && fault.is_none() && is_bounded;
        let verdict = if passes { Verdict::Pass } else { Verdict::Fail };
        Ok(Some(Self { verdict, reasons, z_width, jumps }))
    }
}

/// Number of runs that [`RenderedStability::of`] makes.
pub const RUNS: u64 = (FACTORS.len() + JUMPS.len()) as u64;

/// Returns the scene with another instrument, in virtual time without costs.
fn with(scene: &Scene, kind: InstrumentKind, path: Result<TipPath, PathError>, end_s: f64) -> Scene {
    let mut scene = scene.clone();
    // Waypoints ascend and are finite, as the site is.
    if let Ok(path) = path {
        scene = scene.with_instrument(kind, path);
    }
    (scene.costs, scene.schedule) = (None, Schedule::Lockstep);
    let ticks = (end_s / scene.tick_s()).round() as u64;
    scene.with_ticks(ticks)
}

fn under_hand(scene: &Scene, site: &Site, factor: f64) -> Result<StifferBody, SceneError> {
    let mut settings = CoupledSettings::default();
    // The site lies in the middle of the device's workspace.
    settings.phantom.axes.offset = -(settings.phantom.axes.rotation * site.above(0.0));
    let at = |time, height| Waypoint { time, position: site.above(height) };
    let path = TipPath::new(vec![at(0.0, SET_POINT_M), at(PRESSED_S, -SET_POINT_M), at(END_S, -SET_POINT_M)]);
    let path = path.map(|path| path.with_interpolation(Interpolation::MinimumJerk));
    let mut scene = with(scene, InstrumentKind::Phantom(Box::new(settings)), path, END_S);
    let root = factor.sqrt();
    scene.material.stiffness = scene.material.stiffness.clone().scaled(factor);
    scene.material.damping = scene.material.damping.clone().scaled(root);
    // The network's own steps keep their distance from their stability limit.
    scene.global.substeps = (f64::from(scene.global.substeps) * root).ceil() as u32;
    let simulation = Simulation::prepare(&scene)?;
    let start = simulation.device().map_or(Vec3::zeros(), |device| device.view().tip);
    let mut filter = HighPass::new(scene.tick_s(), start);
    let (mut buzz_m, mut force_n) = (0.0, 0.0);
    let end = simulation.run(|view| {
        let fast = view.device.map_or(Vec3::repeat(f64::NAN), |device| filter.next(device.tip));
        if view.time >= SETTLED_S {
            buzz_m = larger(buzz_m, fast.norm());
        }
        force_n = view.force.norm();
    });
    let fault = end.err().map(|fault| fault.to_string());
    let is_quiet = fault.is_none() && buzz_m <= PERCEIVED_M;
    Ok(StifferBody { factor, force_n, buzz_m: fault.is_none().then_some(buzz_m), fault, is_quiet })
}

fn jump(scene: &Scene, site: &Site, depths: f64) -> Result<Jump, SceneError> {
    let (tick_s, depth_m) = (scene.tick_s(), depths * site.depth_m);
    let at = |tick: u64, height| Waypoint { time: tick as f64 * tick_s, position: site.above(height) };
    let (inside, end) = (FREE_TICKS + 1, FREE_TICKS + 1 + INSIDE_TICKS);
    let waypoints = vec![at(0, site.depth_m), at(FREE_TICKS, site.depth_m), at(inside, -depth_m), at(end, -depth_m)];
    let scene = with(scene, InstrumentKind::Path, TipPath::new(waypoints), end as f64 * tick_s);
    let (mut peak_n, mut settled_n) = (0.0, 0.0);
    let end = Simulation::prepare(&scene)?.run(|view| {
        settled_n = view.force.norm();
        peak_n = larger(peak_n, settled_n);
    });
    Ok(Jump { depth_m, peak_n, settled_n, fault: end.err().map(|fault| fault.to_string()) })
}
