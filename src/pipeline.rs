//! The path of the data, on one page: scene → network → linearise → local model → collide →
//! constrain → integrate → instrument force → global cycle.

use std::sync::Arc;

use thiserror::Error;

use crate::Vec3;
use crate::contact::collision::START_TOLERANCE;
use crate::contact::surface::ContactGeometry;
use crate::contact::tick::{LocalSimulation, TickReport};
use crate::device::failsafe::{FailSafe, Fault};
use crate::device::instrument::TipPath;
use crate::dynamics::energy::EnergyBook;
use crate::dynamics::global::{
    CycleMessage, CycleSettings, GlobalSimulation, Keep, ModelMessage, SyncMode, Trajectory,
};
use crate::model::condensation::CondensationCounts;
use crate::model::local::LocalModelBuilder;
use crate::model::mesh::Mesh;
use crate::model::network::Network;
use crate::model::patch::Extent;
use crate::model::surface::Surface;
use crate::model::work::WorkCounts;
use crate::scene::{Problem, Scene, SceneError};

/// Why a run did not complete.
#[derive(Debug, Error)]
pub enum RunError {
    /// It could not start.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The fail-safe ended it.
    #[error(transparent)]
    Fault(#[from] Fault),
}

/// What an observer sees after a tick.
#[derive(Debug)]
pub struct TickView<'a> {
    /// Counted from 0.
    pub tick: u64,
    /// At the end of the tick, s.
    pub time: f64,
    /// The tip at the start of the tick, m.
    pub tip_before: Vec3,
    /// The tip at its end, m.
    pub tip: Vec3,
    /// The force commanded to the instrument, before device limits, N.
    pub force: Vec3,
    /// What the tick did.
    pub report: &'a TickReport,
    /// The local side, at the end of the tick.
    pub local: &'a LocalSimulation,
    /// Age of the model that did it, ticks.
    pub model_age: u64,
    /// Energies at its end.
    pub energy: &'a EnergyBook,
    /// What both sides have computed so far.
    pub work: WorkCounts,
    /// What became of the exterior in the models so far, if it is condensed.
    pub condensation: Option<CondensationCounts>,
}

/// Where the schedule is, for whoever keeps time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// The network is about to catch up with the cycle just past.
    CycleBegins,
    /// It has; its next local model is about to be built.
    ModelBegins,
    /// The model is there.
    ModelEnds,
    /// The local side is about to do a tick.
    TickBegins,
    /// It has.
    TickEnds,
}

/// A scene put together, ready to run.
#[derive(Debug, Clone)]
pub struct Simulation {
    network: Arc<Network>,
    surface: Arc<Surface>,
    global: GlobalSimulation,
    local: LocalSimulation,
    path: TipPath,
    failsafe: FailSafe,
    tick: f64,
    tick_count: u64,
    ticks_per_cycle: u64,
    latency_ticks: u64,
    keep: Keep,
    /// The whole network runs at the local rate: there are no cycles and no model to age.
    is_full: bool,
}

impl Simulation {
    /// Scene → mesh → network → first local model. All allocation that depends on the scene is done
    /// here and at boundaries, none in a tick.
    ///
    /// # Errors
    /// If the mesh has no proper surface, or the tip starts inside it.
    pub fn prepare(scene: &Scene) -> Result<Self, SceneError> {
        Self::assemble(scene, &scene.block.mesh())
    }

    /// The same over a mesh of one's own, with as many nodes as the scene has masses.
    ///
    /// # Errors
    /// As [`prepare`](Self::prepare).
    pub fn assemble(scene: &Scene, mesh: &Mesh) -> Result<Self, SceneError> {
        let surface = Surface::new(mesh).map_err(|error| scene.mesh_error(Problem::Surface(error)))?;
        let surface = Arc::new(surface);
        let geometry =
            ContactGeometry::new(scene.surface, &surface).map_err(|error| scene.mesh_error(Problem::Surface(error)))?;
        let network = Arc::new(Network::new(mesh, &scene.material, scene.fixed.clone()));
        let builder = LocalModelBuilder::new(&network, surface.clone(), geometry, scene.local)
            .with_integrator(scene.integrator, scene.tick);
        let cycle = CycleSettings {
            sync: scene.global.sync,
            integrator: scene.global.integrator,
            substeps: scene.global.substeps,
            ticks: scene.ticks_per_cycle,
            tick: scene.tick,
            metric: scene.contact.scheme.overwrite_metric(),
        };
        let mut global = GlobalSimulation::new(cycle, network.clone(), surface.clone(), builder);

        let tip = scene.path.at(0.0);
        let ModelMessage { model, state } =
            global.build_model(tip).map_err(|error| scene.mesh_error(Problem::Model(error)))?;
        let local = LocalSimulation::new(scene.contact, scene.tick, model, state);
        let distance = local.shape().signed_distance(tip);
        if !(distance >= -START_TOLERANCE) {
            return Err(scene.tip_inside(-distance));
        }
        let replays = scene.global.sync == SyncMode::Replay && scene.local.extent != Extent::All;
        Ok(Self {
            failsafe: FailSafe::new(&network.rest),
            network,
            surface,
            global,
            local,
            path: scene.path.clone(),
            tick: scene.tick,
            tick_count: scene.tick_count,
            ticks_per_cycle: u64::from(scene.ticks_per_cycle),
            latency_ticks: u64::from(scene.global.latency_ticks),
            keep: if replays { Keep::Path } else { Keep::End },
            is_full: scene.is_full,
        })
    }

    /// The full model.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Its surface.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The local side.
    pub fn local(&self) -> &LocalSimulation {
        &self.local
    }

    /// The global side.
    pub fn global(&self) -> &GlobalSimulation {
        &self.global
    }

    /// The two sides, for a loop of one's own. (A clone of the local side has to allocate its scratch
    /// again in its first ticks; this one has it.)
    pub fn into_sides(self) -> (GlobalSimulation, LocalSimulation) {
        (self.global, self.local)
    }

    /// Runs in lockstep: the two sides take turns in virtual time. `observe` is called after every
    /// tick that the fail-safe lets pass.
    ///
    /// # Errors
    /// With the fault that ended the run.
    pub fn run(self, observe: impl FnMut(&TickView)) -> Result<(), Fault> {
        self.run_timed(|_| (), observe)
    }

    /// As [`run`](Self::run); `mark` is told of every moment of the schedule as it comes.
    ///
    /// # Errors
    /// With the fault that ended the run.
    pub fn run_timed(mut self, mut mark: impl FnMut(Moment), mut observe: impl FnMut(&TickView)) -> Result<(), Fault> {
        let mut trajectory = Trajectory::new(self.keep);
        self.begin_segment(&mut trajectory, 0);
        let mut pending: Option<(u64, ModelMessage)> = None;
        let mut energy = EnergyBook::new(if self.is_full { self.network.fixed_potential() } else { 0.0 });
        energy.take_stock(&self.local);
        let mut tip_before = self.path.at(0.0);
        for tick in 0..self.tick_count {
            let tick_in_cycle = tick % self.ticks_per_cycle;
            if tick_in_cycle == 0 && tick > 0 && !self.is_full {
                // Up: the cycle just past. Down: the model of the next, due after its latency.
                let contact = self.local.contact();
                let past = std::mem::replace(&mut trajectory, Trajectory::new(self.keep));
                let message = CycleMessage { trajectory: past, contact, tip: tip_before };
                mark(Moment::CycleBegins);
                let caught_up = self.global.catch_up(&message);
                mark(Moment::ModelBegins);
                let model = caught_up.and_then(|()| self.global.build_model(tip_before));
                mark(Moment::ModelEnds);
                self.failsafe.check_network(tick, tip_before, self.global.state())?;
                // A network that has run away has no model either: that it ran away is the cause.
                let model = model.map_err(|error| self.failsafe.no_model(tick, tip_before, error))?;
                pending = Some((tick + self.latency_ticks, model));
            }
            if let Some((_, model)) = pending.take_if(|(due, _)| *due == tick) {
                self.local.hand_over(model.model, model.state, self.latency_ticks, tip_before);
                energy.take_stock(&self.local);
                self.begin_segment(&mut trajectory, tick_in_cycle);
            } else if tick_in_cycle == 0 && tick > 0 && !self.is_full {
                self.begin_segment(&mut trajectory, 0);
            }

            let model_age = if self.is_full { 0 } else { self.local.model_age() };
            let time = (tick + 1) as f64 * self.tick;
            let tip = self.path.at(time);
            mark(Moment::TickBegins);
            let report = self.local.tick(tip_before, tip);
            mark(Moment::TickEnds);
            let force = self.failsafe.command(tick, tip, &self.local, &report)?;

            if !self.is_full {
                trajectory.record(self.local.state());
            }
            energy.book(&self.local, &report, tip_before, tip, self.tick);
            let local = &self.local;
            observe(&TickView {
                tick,
                time,
                tip_before,
                tip,
                force,
                report: &report,
                local,
                model_age,
                energy: &energy,
                work: local.state().work + self.global.work(),
                condensation: self.global.condensation(),
            });
            tip_before = tip;
        }
        Ok(())
    }

    /// The path from here on of the model now in use, to the end of the cycle at most.
    fn begin_segment(&self, trajectory: &mut Trajectory, tick_in_cycle: u64) {
        let ticks = (self.ticks_per_cycle - tick_in_cycle).min(self.tick_count);
        trajectory.begin(self.local.model(), self.local.state(), tick_in_cycle as usize, ticks as usize);
    }
}

/// Puts a scene together and runs it.
///
/// # Errors
/// If the scene cannot start, or the fail-safe ends it.
pub fn run(scene: &Scene, observe: impl FnMut(&TickView)) -> Result<(), RunError> {
    Simulation::prepare(scene)?.run(observe)?;
    Ok(())
}
