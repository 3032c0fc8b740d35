//! Runs of a renderer along a motion, recorded tick by tick, over a body that may be turned or renumbered.

use std::cell::RefCell;
use std::time::Instant;

use crate::Vec3;
use crate::contact::law::Mode;
use crate::contact::renderer::Renderer;
use crate::model::mesh::Mesh;
use crate::multirate::global::Moment;
use crate::pipeline::{OwnParts, Simulation};
use crate::scene::{Scene, SceneError};

/// How the body lies in space and in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrangement {
    /// As the scene has it.
    AsIs,
    /// Turned and moved, with path and gravity.
    Turned,
    /// Nodes, and with them springs and triangles, in the opposite order.
    Renumbered,
}

/// What a tick showed.
#[derive(Debug, Clone, Copy)]
pub struct DrivenTick {
    /// Position of the tip at the end, m.
    pub tip: Vec3,
    /// Force on the instrument, N.
    pub force: Vec3,
    /// Mode of the contact.
    pub mode: Mode,
    /// Contact normal.
    pub normal: Option<Vec3>,
    /// Whether this is the first tick of a new model.
    pub is_new_model: bool,
    /// Energy that the massless contact has created so far, J.
    pub created_j: f64,
    /// Time of the tick, ns.
    pub nanoseconds: u64,
    /// Calls of the allocator, where they are counted.
    pub allocations: Option<u64>,
}

/// A recorded run.
#[derive(Debug, Clone)]
pub struct Drive {
    /// Every tick before a fault.
    pub ticks: Vec<DrivenTick>,
    /// Fault that ended the run, if one did.
    pub fault: Option<String>,
}

fn rotation() -> nalgebra::Matrix3<f64> {
    // Any turn about no axis of the scene.
    *nalgebra::Rotation3::from_euler_angles(0.7, -1.2, 2.3).matrix()
}

/// Number of allocator calls of this thread so far, where they are counted.
fn allocations() -> Option<u64> {
    #[cfg(all(feature = "realtime", target_os = "linux"))]
    let count = crate::realtime::allocations::on_this_thread();
    #[cfg(not(all(feature = "realtime", target_os = "linux")))]
    let count = None;
    count
}

impl Drive {
    /// Runs a scene over an arrangement of its body, with a custom renderer if one is given. Forces and tips are given in the scene's own axes.
    ///
    /// # Errors
    /// If the scene cannot start. A fault is part of the result.
    pub fn of(
        scene: &Scene,
        renderer: Option<Box<dyn Renderer>>,
        arrangement: Arrangement,
    ) -> Result<Self, SceneError> {
        let (scene, mesh) = arranged(scene, arrangement);
        let own = OwnParts { mesh, renderer, ..OwnParts::default() };
        let back = match arrangement {
            Arrangement::Turned => rotation().transpose(),
            Arrangement::AsIs | Arrangement::Renumbered => nalgebra::Matrix3::identity(),
        };
        let mut ticks = Vec::with_capacity(scene.tick_count() as usize);
        let begun = RefCell::new((Instant::now(), allocations(), 0_u64, None));
        let mark = |moment: Moment| {
            let mut begun = begun.borrow_mut();
            match moment {
                Moment::TickBegins => (begun.0, begun.1) = (Instant::now(), allocations()),
                Moment::TickEnds => {
                    begun.2 = begun.0.elapsed().as_nanos() as u64;
                    begun.3 = allocations().zip(begun.1).map(|(now, before)| now - before);
                }
                Moment::CycleBegins | Moment::ModelBegins | Moment::ModelEnds => {}
            }
        };
        let end = Simulation::prepare_with(&scene, own)?.run_timed(mark, |view| {
            let (_, _, nanoseconds, allocations) = *begun.borrow();
            // A renderer in a process of its own knows what its ticks cost.
            let cost = view.local.renderer_cost();
            ticks.push(DrivenTick {
                tip: back * view.tip,
                force: back * view.force,
                mode: view.report.mode,
                normal: view.report.touch.map(|touch| back * touch.normal),
                is_new_model: view.tick > 0 && view.model_age == 0,
                created_j: view.energy.contact.created,
                nanoseconds: cost.map_or(nanoseconds, |cost| cost.nanoseconds),
                allocations: cost.map_or(allocations, |cost| cost.allocations),
            });
        });
        Ok(Self { ticks, fault: end.err().map(|fault| fault.to_string()) })
    }

    /// Returns the largest force, N.
    pub fn peak_n(&self) -> f64 {
        crate::verify::residual::largest(self.ticks.iter().map(|tick| tick.force.norm()))
    }
}

/// Returns the scene with its body arranged, and the body's mesh if it is another than the scene's.
fn arranged(scene: &Scene, arrangement: Arrangement) -> (Scene, Option<Mesh>) {
    let mut scene = scene.clone();
    match arrangement {
        Arrangement::AsIs => (scene, None),
        Arrangement::Turned => {
            let turn = rotation();
            let mut mesh = scene.mesh.mesh();
            // Without a shift, so that forces need only be turned back.
            mesh.nodes.iter_mut().for_each(|node| *node = turn * *node);
            scene.material.gravity = turn * scene.material.gravity;
            scene.path = scene.path.transformed(1.0, |position| turn * position);
            (scene, Some(mesh))
        }
        Arrangement::Renumbered => {
            let mesh = scene.mesh.mesh();
            let last = mesh.nodes.len() as u32 - 1;
            let renumbered = Mesh {
                nodes: mesh.nodes.iter().rev().copied().collect(),
                edges: mesh.edges.iter().map(|edge| edge.map(|node| last - node)).collect(),
                triangles: mesh.triangles.iter().map(|triangle| triangle.map(|node| last - node)).collect(),
                tetrahedra: mesh.tetrahedra.iter().map(|corners| corners.map(|node| last - node)).collect(),
            };
            scene.material.node_mass.reverse();
            scene.fixed.reverse();
            (scene, Some(renumbered))
        }
    }
}
