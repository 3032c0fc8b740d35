//! Frames of a run for display: the surface as the servo loop has it, up to 60 times per second of simulated time.

use serde::Serialize;

use crate::Vec3;
use crate::local::patch::OUTSIDE;
use crate::pipeline::TickView;
use crate::scene::Scene;

/// Largest number of frames per second of simulated time, 1/s.
const FRAMES_PER_S: f64 = 60.0;
/// Size of a position, bytes: three 16-bit numbers.
const BYTES_PER_POSITION: usize = 6;
/// Largest 16-bit number: quantisation steps along the longest side.
const STEPS: f64 = u16::MAX as f64;

/// Collects frames from the ticks of a run.
///
/// ```
/// use stickslip::{output::frames::{FrameRecorder, NoFrames}, pipeline, scene::Scene};
///
/// // The tip meets the block after 80 ticks.
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
    /// Whether each node is fixed.
    is_fixed: Vec<bool>,
    /// Ticks per frame by [`FRAMES_PER_S`], and ticks of the whole run.
    ticks: [u64; 2],
    most_bytes: usize,
    recording: Recording,
}

/// State of the recording.
#[derive(Debug)]
enum Recording {
    Nothing,
    TooLarge { vertices: usize },
    Going { stride: u64, surface: StillSurface, shots: Vec<Shot>, patches: Vec<PatchFrom> },
}

/// Constant data of the surface.
#[derive(Debug)]
struct StillSurface {
    triangles: Vec<[u32; 3]>,
    /// Position of every vertex in the first frame, m.
    first: Vec<Vec3>,
    fixed: Vec<u32>,
    moving: Vec<u32>,
}

/// Data of one frame.
#[derive(Debug)]
struct Shot {
    time: f64,
    tip: Vec3,
    force: Vec3,
    normal_force: f64,
    tangential_force: f64,
    mode: &'static str,
    /// Positions of the moving vertices, m.
    positions: Vec<Vec3>,
}

/// Surface vertices in the patch, from one frame until the next change.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatchFrom {
    /// First frame with this patch.
    pub frame: usize,
    /// Vertices, ascending.
    pub vertices: Vec<u32>,
}

/// Frames of a run for a viewer. Positions are multiples of a step from an origin: x, y, z of each vertex in turn.
#[derive(Debug, Serialize)]
pub struct Frames {
    /// Triangles by vertices, with outward orientation.
    pub triangles: Vec<[u32; 3]>,
    /// Fixed vertices, ascending.
    pub fixed: Vec<u32>,
    /// Moving vertices, ascending.
    pub moving: Vec<u32>,
    /// Lowest corner of the bounding box of all positions, m.
    pub origin_m: [f64; 3],
    /// Length of a step, m.
    pub step_m: f64,
    /// Positions of all vertices in the first frame, steps.
    #[serde(skip)]
    pub first: Vec<u16>,
    /// Positions of the moving vertices, frame by frame, steps.
    #[serde(skip)]
    pub positions: Vec<u16>,
    /// Patches in their order of use.
    pub patches: Vec<PatchFrom>,
    /// Time at the end of each frame's tick, s.
    pub time_s: Vec<f64>,
    /// Position of the tip, m.
    pub tip_m: Vec<[f64; 3]>,
    /// Force commanded to the instrument, N.
    pub force_n: Vec<[f64; 3]>,
    /// Normal force F_N, N.
    pub normal_force_n: Vec<f64>,
    /// Tangential force F_T, N.
    pub tangential_force_n: Vec<f64>,
    /// Contact state.
    pub mode: Vec<&'static str>,
}

/// Reason why there are no frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoFrames {
    /// No tick was recorded.
    #[error("the run has no ticks")]
    NoTick,
    /// Two frames would exceed the allowed size.
    #[error("its surface of {vertices} vertices is too large for this page")]
    TooLarge {
        /// Number of vertices of the surface.
        vertices: usize,
    },
}

impl FrameRecorder {
    /// Prepares the recording of a scene's run. Positions take at most `most_bytes`: a larger run has fewer frames.
    pub fn new(scene: &Scene, most_bytes: usize) -> Self {
        let stride = (1.0 / (FRAMES_PER_S * scene.tick_s())).ceil().max(1.0) as u64;
        Self {
            is_fixed: scene.fixed.clone(),
            ticks: [stride, scene.tick_count()],
            most_bytes,
            recording: Recording::Nothing,
        }
    }

    /// Records a tick.
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

    /// Returns the recorded frames.
    ///
    /// # Errors
    /// If no tick was recorded, or two frames would exceed the allowed size.
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

/// Returns a surface vertex's position, m: by the local state in the patch, and as the local model holds it outside.
fn position(view: &TickView, vertex: u32) -> Vec3 {
    view.local.model().vertex(vertex, &view.local.state().x, view.local.elapsed())
}
