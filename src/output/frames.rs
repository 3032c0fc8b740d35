//! A run for the eye: the surface some sixty times a second, as the local side holds it.

use serde::Serialize;

use crate::Vec3;
use crate::local::patch::OUTSIDE;
use crate::pipeline::TickView;
use crate::scene::Scene;

/// Of simulated time, at most, 1/s.
const FRAMES_PER_S: f64 = 60.0;
/// A position: three numbers of 16 bits.
const BYTES_PER_POSITION: usize = 6;
/// What 16 bits can tell apart.
const STEPS: f64 = u16::MAX as f64;

/// Collects frames from the ticks of a run.
///
/// ```
/// use stickslip::{output::frames::{FrameRecorder, NoFrames}, pipeline, scene::Scene};
///
/// // the tip meets the block after 80
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let record = |most_bytes| {
///     let mut recorder = FrameRecorder::new(&scene, most_bytes);
///     pipeline::run(&scene, |tick| recorder.record(tick)).expect("it comes to its end");
///     recorder.finish()
/// };
/// let frames = record(1 << 20)?;
/// assert_eq!(frames.time_s.len(), 9); // one in 17 ticks of 1 ms: not more than 60 a second
/// assert_eq!(frames.fixed.len(), 81); // the bottom
/// assert_eq!(frames.positions.len(), 9 * 3 * frames.moving.len());
/// let size_m = frames.step_m * f64::from(u16::MAX);
/// assert!((size_m - 0.1).abs() < 0.001); // the block is 10 cm long
/// assert_eq!(record(100).err(), Some(NoFrames::TooLarge { vertices: 226 }));
/// # Ok::<(), NoFrames>(())
/// ```
#[derive(Debug)]
pub struct FrameRecorder {
    /// By node.
    is_fixed: Vec<bool>,
    /// Ticks from one frame to the next by [`FRAMES_PER_S`], and of the whole run.
    ticks: [u64; 2],
    most_bytes: usize,
    recording: Recording,
}

/// What is known once the surface has been seen.
#[derive(Debug)]
enum Recording {
    Nothing,
    TooLarge { vertices: usize },
    Going { stride: u64, surface: StillSurface, shots: Vec<Shot>, patches: Vec<PatchFrom> },
}

/// What does not change.
#[derive(Debug)]
struct StillSurface {
    triangles: Vec<[u32; 3]>,
    /// Where every vertex was in the first frame, m.
    first: Vec<Vec3>,
    fixed: Vec<u32>,
    moving: Vec<u32>,
}

/// One frame.
#[derive(Debug)]
struct Shot {
    time: f64,
    tip: Vec3,
    force: Vec3,
    normal_force: f64,
    tangential_force: f64,
    mode: &'static str,
    /// Of the vertices that move, m.
    positions: Vec<Vec3>,
}

/// The surface vertices in the patch, from a frame on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatchFrom {
    /// The first in which it is in use.
    pub frame: usize,
    /// Ascending.
    pub vertices: Vec<u32>,
}

/// A run as a viewer needs it. Positions are whole steps from an origin, x, y, z of one vertex after the other.
#[derive(Debug, Serialize)]
pub struct Frames {
    /// Outward, of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Vertices that never move.
    pub fixed: Vec<u32>,
    /// All others, ascending.
    pub moving: Vec<u32>,
    /// Lowest corner of the box around all positions, m.
    pub origin_m: [f64; 3],
    /// Length of a step, m.
    pub step_m: f64,
    /// Of every vertex in the first frame.
    #[serde(skip)]
    pub first: Vec<u16>,
    /// Of the moving vertices, frame after frame.
    #[serde(skip)]
    pub positions: Vec<u16>,
    /// Patches in the order in which they came into use.
    pub patches: Vec<PatchFrom>,
    /// At the end of each frame's tick, s.
    pub time_s: Vec<f64>,
    /// Where the tip was, m.
    pub tip_m: Vec<[f64; 3]>,
    /// Commanded to the instrument, N.
    pub force_n: Vec<[f64; 3]>,
    /// F_N, N.
    pub normal_force_n: Vec<f64>,
    /// F_T, N.
    pub tangential_force_n: Vec<f64>,
    /// What the contact did.
    pub mode: Vec<&'static str>,
}

/// Why there are no frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoFrames {
    /// Nothing was seen.
    #[error("no tick was done")]
    NoTick,
    /// Two frames would take more than they may.
    #[error("its surface of {vertices} vertices is too large for this page")]
    TooLarge {
        /// All of it.
        vertices: usize,
    },
}

impl FrameRecorder {
    /// For a run of a scene whose positions take at most so many bytes: a larger run has fewer frames.
    pub fn new(scene: &Scene, most_bytes: usize) -> Self {
        let stride = (1.0 / (FRAMES_PER_S * scene.tick_s())).ceil().max(1.0) as u64;
        Self {
            is_fixed: scene.fixed.clone(),
            ticks: [stride, scene.tick_count()],
            most_bytes,
            recording: Recording::Nothing,
        }
    }

    /// Takes a tick in.
    pub fn record(&mut self, view: &TickView) {
        if let Recording::Nothing = self.recording {
            self.recording = self.begin(view);
        }
        let Recording::Going { stride, surface, shots, patches } = &mut self.recording else { return };
        if !view.tick.is_multiple_of(*stride) {
            return;
        }
        let slots = &view.local.model().patch.vertex_slot;
        let vertices: Vec<u32> = (0..slots.len() as u32).filter(|&v| slots[v as usize] != OUTSIDE).collect();
        if patches.last().is_none_or(|last| last.vertices != vertices) {
            patches.push(PatchFrom { frame: shots.len(), vertices });
        }
        shots.push(Shot {
            time: view.time,
            tip: view.tip,
            force: view.force,
            normal_force: view.normal_force(),
            tangential_force: view.tangential_force(),
            mode: view.report.mode.name(),
            positions: surface.moving.iter().map(|&vertex| position(view, vertex)).collect(),
        });
    }

    fn begin(&self, view: &TickView) -> Recording {
        let surface = &view.local.surface().topology;
        let vertices = surface.vertex_node.len();
        let is_fixed = |vertex: &u32| {
            let node = surface.vertex_node[*vertex as usize];
            self.is_fixed.get(node as usize).copied().unwrap_or(false)
        };
        let (fixed, moving): (Vec<u32>, Vec<u32>) = (0..vertices as u32).partition(is_fixed);
        let frame_bytes = BYTES_PER_POSITION * moving.len().max(1);
        let most_frames = self.most_bytes.saturating_sub(BYTES_PER_POSITION * vertices) / frame_bytes;
        if most_frames < 2 {
            return Recording::TooLarge { vertices };
        }
        let [stride, tick_count] = self.ticks;
        Recording::Going {
            stride: stride.max(tick_count.div_ceil(most_frames as u64)),
            surface: StillSurface {
                triangles: surface.triangles.clone(),
                first: (0..vertices as u32).map(|vertex| position(view, vertex)).collect(),
                fixed,
                moving,
            },
            shots: Vec::new(),
            patches: Vec::new(),
        }
    }

    /// What was recorded.
    ///
    /// # Errors
    /// If there is nothing to show.
    pub fn finish(self) -> Result<Frames, NoFrames> {
        let (surface, shots, patches) = match self.recording {
            Recording::Nothing => return Err(NoFrames::NoTick),
            Recording::TooLarge { vertices } => return Err(NoFrames::TooLarge { vertices }),
            Recording::Going { surface, shots, patches, .. } => (surface, shots, patches),
        };
        let StillSurface { triangles, first, fixed, moving } = surface;
        let all = || first.iter().chain(shots.iter().flat_map(|shot| &shot.positions));
        let lowest = all().fold(Vec3::repeat(f64::INFINITY), |lowest, x| lowest.inf(x));
        let highest = all().fold(Vec3::repeat(f64::NEG_INFINITY), |highest, x| highest.sup(x));
        let size = (highest - lowest).max();
        let step = if size > 0.0 { size / STEPS } else { 1.0 };
        // A cast to 16 bits saturates: rounding cannot leave the box.
        let steps = |x: &Vec3| <[f64; 3]>::from((x - lowest) / step).map(|steps| steps.round() as u16);
        Ok(Frames {
            first: first.iter().flat_map(steps).collect(),
            positions: shots.iter().flat_map(|shot| &shot.positions).flat_map(steps).collect(),
            triangles,
            fixed,
            moving,
            origin_m: lowest.into(),
            step_m: step,
            patches,
            time_s: shots.iter().map(|shot| shot.time).collect(),
            tip_m: shots.iter().map(|shot| shot.tip.into()).collect(),
            force_n: shots.iter().map(|shot| shot.force.into()).collect(),
            normal_force_n: shots.iter().map(|shot| shot.normal_force).collect(),
            tangential_force_n: shots.iter().map(|shot| shot.tangential_force).collect(),
            mode: shots.iter().map(|shot| shot.mode).collect(),
        })
    }
}

/// Where a surface vertex is: of the patch by the local state, outside it where the local model holds it.
fn position(view: &TickView, vertex: u32) -> Vec3 {
    view.local.model().vertex(vertex, &view.local.state().x, view.local.elapsed())
}
