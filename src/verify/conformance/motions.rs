//! Motions of the tip for conformance, from a place on the body where a scene touches it.

use crate::Vec3;
use crate::device::path::{Interpolation, TipPath, Waypoint};
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError};

/// Depth of a press, as a share of the distance between neighbouring nodes.
const DEPTH: f64 = 0.1;
/// Largest length of a drag, in distances between neighbouring nodes: it crosses edges.
const DRAG: f64 = 2.0;
/// Number of points of a drag that have to lie inside the body at rest.
const POINTS: u32 = 40;
/// Top speed of a stroke, m/s.
const STROKE_M_PER_S: f64 = 0.3;
/// Top speed of a motion of minimum jerk, over its mean speed.
const TOP_OVER_MEAN: f64 = 1.875;

/// Time at which a press has reached its depth, s.
pub const PRESSED_S: f64 = 0.3;
/// Time at which a held press ends, s.
pub const HELD_S: f64 = 2.3;
/// Time at which the tip of [`Motion::LiftOff`] is free again, s. Half of it is a press so slow that dampers take little, and
/// a renderer that gives energy cannot hide it behind them.
pub const LIFTED_S: f64 = 10.0;
/// Tick of [`Motion::Teleport`] in which the tip jumps out, and the tick in which it jumps in again, deeper.
pub const JUMPS: [u64; 2] = [500, 600];

/// A place on the body, and the scale of motions there.
#[derive(Debug, Clone, Copy)]
pub struct Site {
    point: Vec3,
    normal: Vec3,
    along: Vec3,
    /// Depth of a press, m.
    pub depth_m: f64,
    /// Length of a drag, m.
    pub length_m: f64,
}

impl Site {
    /// Finds where the scene's own local model first touches the body along the scene's path; `None` if it never does.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn of(scene: &Scene) -> Result<Option<Self>, SceneError> {
        let own = scene.clone().with_local_model(scene.local());
        let (mut first, mut along): (Option<(Vec3, Vec3)>, _) = (None, None);
        // A fault after the first contact does not matter here.
        let _ = Simulation::prepare(&own)?.run(|view| {
            if first.is_none() {
                first = view.report.touch.map(|touch| (touch.position, touch.normal));
            }
            let (Some((_, normal)), None) = (first, along) else { return };
            let step = view.tip - view.tip_before;
            let across = step - normal * step.dot(&normal);
            if across.norm() > 0.5 * step.norm() {
                along = Some(across.normalize());
            }
        });
        let Some((point, normal)) = first else { return Ok(None) };
        let (depth_m, longest_m) = (DEPTH * scene.mesh.spacing(), DRAG * scene.mesh.spacing());
        // The tip moves straight: on a body that curves away, and near its end, a drag is shorter.
        let at_rest = Simulation::prepare(&own)?;
        let shape = at_rest.local().shape();
        let reach = |along: Vec3| {
            let inside = |share: f64| {
                let below = point - normal * (0.5 * depth_m) + along * (share * longest_m);
                shape.signed_distance(below) < 0.0
            };
            let shares = (1..=POINTS).map(|i| f64::from(i) / f64::from(POINTS));
            shares.take_while(|&share| inside(share)).last().unwrap_or(0.0) * longest_m
        };
        // The path's own direction first, if it has one.
        let any = if normal.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() };
        let across = any.cross(&normal).normalize();
        let directions = along.into_iter().chain([across, -across, across.cross(&normal)]);
        let drags = directions.map(|along| (along, reach(along)));
        // Of equal ones the first.
        let (along, length_m) = drags.reduce(|a, b| if b.1 > a.1 { b } else { a }).unwrap_or((across, 0.0));
        Ok(Some(Self { point, normal, along, depth_m, length_m }))
    }

    /// Returns the tip's distance from the surface at rest, m: along the normal at the site.
    pub fn height(&self, tip: Vec3) -> f64 {
        (tip - self.point).dot(&self.normal)
    }

    /// Returns the place this far above the surface at the site, m.
    pub fn above(&self, height_m: f64) -> Vec3 {
        self.point + self.normal * height_m
    }

    /// Returns the place so many depths above the surface and so many lengths along it.
    fn at(&self, [time, depths, lengths]: [f64; 3]) -> Waypoint {
        let position = self.point + self.normal * (self.depth_m * depths) + self.along * (self.length_m * lengths);
        Waypoint { time, position }
    }
}

/// A motion of the tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Pressed in and held.
    Press,
    /// Pressed in and dragged over edges in a second.
    SlowDrag,
    /// Ten times a second in and out.
    Tap,
    /// Pressed in and dragged over edges at 0.3 m/s.
    Stroke,
    /// Pressed in slowly, lifted off, held free until the body is at rest, and pressed in again.
    LiftOff,
    /// Jumps within one tick: out of a press, and in again, three times as deep.
    Teleport,
}

impl Motion {
    /// Returns the name of the motion.
    pub fn name(self) -> &'static str {
        match self {
            Motion::Press => "press and hold",
            Motion::SlowDrag => "slow drag",
            Motion::Tap => "tap",
            Motion::Stroke => "stroke",
            Motion::LiftOff => "lift-off",
            Motion::Teleport => "teleport",
        }
    }

    /// Returns the waypoints, each with its time, s, its height in depths of a press and its way in lengths of a drag.
    fn waypoints(self, site: &Site, tick_s: f64) -> Vec<[f64; 3]> {
        let pressed = [[0.0, 1.0, 0.0], [PRESSED_S, -1.0, 0.0]];
        let stroke_s = site.length_m * TOP_OVER_MEAN / STROKE_M_PER_S;
        let more: Vec<[f64; 3]> = match self {
            Motion::Press => vec![[HELD_S, -1.0, 0.0]],
            Motion::SlowDrag => vec![[PRESSED_S + 1.0, -1.0, 1.0]],
            Motion::Tap => {
                let taps = (1..7).map(|half| [0.05 * f64::from(half), if half % 2 == 0 { 1.0 } else { -1.0 }, 0.0]);
                return std::iter::once([0.0, 1.0, 0.0]).chain(taps).collect();
            }
            Motion::Stroke => vec![[PRESSED_S + stroke_s, -1.0, 1.0], [PRESSED_S + stroke_s + 0.2, -1.0, 1.0]],
            Motion::LiftOff => {
                let up = |time| [time, 1.0, 0.0];
                return vec![
                    up(0.0),
                    [0.5 * LIFTED_S, -1.0, 0.0],
                    up(LIFTED_S),
                    up(LIFTED_S + 1.0),
                    [LIFTED_S + 1.5, -1.0, 0.0],
                ];
            }
            Motion::Teleport => {
                let [out, back] = JUMPS.map(|tick| tick as f64 * tick_s);
                let deep = [[back + tick_s, -3.0, 0.0], [back + 0.1, -3.0, 0.0]];
                let free = [[out, -1.0, 0.0], [out + tick_s, 10.0, 0.0], [back, 10.0, 0.0]];
                free.into_iter().chain(deep).collect()
            }
        };
        pressed.into_iter().chain(more).collect()
    }

    /// Returns the scene with this motion at a site in place of its own instrument and path, in virtual time without costs.
    ///
    /// # Errors
    /// If the motion does not fit the scene's rates.
    pub fn scene(self, scene: &Scene, site: &Site) -> Result<Scene, SceneError> {
        let waypoints: Vec<Waypoint> = self.waypoints(site, scene.tick_s()).into_iter().map(|at| site.at(at)).collect();
        let end = waypoints.last().map_or(0.0, |last| last.time);
        let interpolation = match self {
            Motion::Teleport => Interpolation::Linear,
            _ => Interpolation::MinimumJerk,
        };
        // Waypoints ascend, and every one is finite as the site is.
        let Ok(path) = TipPath::new(waypoints) else { return Ok(scene.clone()) };
        let ticks = (end / scene.tick_s()).round() as u64;
        let mut moved = scene
            .clone()
            .with_instrument(crate::device::instrument::InstrumentKind::Path, path.with_interpolation(interpolation))
            .with_ticks(ticks);
        (moved.costs, moved.schedule) = (None, crate::scene::Schedule::Lockstep);
        Ok(moved)
    }
}
