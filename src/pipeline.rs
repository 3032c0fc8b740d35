//! The path of the data, on one page: scene → network → linearise → local model → detect → constrain → move →
//! instrument force → global cycle. Reading order:
//!
//! 1. [`Simulation::prepare`] puts a scene together: mesh → network → surface → first local model → instrument.
//! 2. [`Lockstep::step`] is one tick. Before it, at a boundary, the cycle just past goes up, the global side brings the
//!    network over it and builds the next model ([`GlobalSide::next_model`]); a model that is due is handed over.
//! 3. [`Servo::tick`] senses the tip, has the local side do the six steps of the tick
//!    ([`LocalSimulation::tick`](crate::contact::simulation::LocalSimulation::tick)), checks the result in the fail-safe, and
//!    commands the instrument.
//! 4. [`TickView`] is what an observer sees of it: traces, summaries, figures and studies take it from there.

use std::collections::VecDeque;
use std::sync::Arc;

use thiserror::Error;

use crate::Vec3;
use crate::contact::collision::START_TOLERANCE;
use crate::contact::renderer::{Renderer, RendererFault, Setup};
use crate::contact::report::TickReport;
use crate::contact::simulation::LocalSimulation;
use crate::device::coupled::InstrumentError;
use crate::device::coupled::{CoupledPhantom, DeviceView};
use crate::device::coupling::HandOverSmoothing;
use crate::device::instrument::{Instrument, InstrumentInUse};
use crate::dynamics::integrators::GlobalIntegrator;
use crate::dynamics::settle::{SettleError, settle};
use crate::external::{self, LibraryError};
use crate::local::condensation::CondensationCounts;
use crate::local::model::LocalModelBuilder;
use crate::local::patch::Extent;
use crate::model::mesh::Mesh;
use crate::model::network::{Network, NetworkError};
use crate::model::state::State;
use crate::model::topology::{Surface, SurfaceError};
use crate::model::work::WorkCounts;
use crate::multirate::energy::EnergyBalance;
use crate::multirate::failsafe::{Bounds, FailSafe, Fault, FaultCause};
use crate::multirate::global::{BuildError, CycleSettings, GlobalSide, GlobalSimulation, Moment, SyncMode};
use crate::multirate::messages::{CycleMessage, ModelMessage};
use crate::multirate::servo::Servo;
use crate::multirate::timeline::{Arrival, DeadlineOutcome, Timeline};
use crate::multirate::trajectory::{PathRecording, Trajectory};
use crate::scene::{Problem, Scene, SceneError};
use crate::surface::disc::DiscError;
use crate::surface::geometry::SurfaceModel;

/// Why a run did not complete.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunError {
    /// The scene could not be put together.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The fail-safe ended the run.
    #[error(transparent)]
    Fault(#[from] Fault),
}

/// State of a run after a tick, as observers see it.
///
/// ```
/// use stickslip::{pipeline, scene::Scene};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program").with_ticks(250);
/// pipeline::run(&scene, |view| {
///     assert!(((view.tick + 1) as f64 * scene.tick_s() - view.time).abs() < 1e-12);
///     // The force has no other parts.
///     assert!((view.normal_force().hypot(view.tangential_force()) - view.force.norm()).abs() < 1e-12);
/// })?;
/// # Ok::<(), pipeline::RunError>(())
/// ```
#[derive(Debug)]
pub struct TickView<'a> {
    /// Number of the tick, from 0.
    pub tick: u64,
    /// Time at the end of the tick, s.
    pub time: f64,
    /// Tip position at the start of the tick, m.
    pub tip_before: Vec3,
    /// Tip position at the end of the tick, m.
    pub tip: Vec3,
    /// Force commanded to the instrument, before device limits, N.
    pub force: Vec3,
    /// Report of the tick, or of the last computed one if this tick was skipped.
    pub report: &'a TickReport,
    /// Whether the tick met its deadline.
    pub deadline_outcome: DeadlineOutcome,
    /// Whether the run has deadlines.
    pub has_deadlines: bool,
    /// Local side at the end of the tick.
    pub local: &'a LocalSimulation,
    /// The full model.
    pub network: &'a Network,
    /// State of the network at the last boundary.
    pub network_state: &'a State,
    /// Age of the local model in use, ticks.
    pub model_age: u64,
    /// Energy balance at the end of the tick.
    pub energy: &'a EnergyBalance,
    /// Work counts of both sides so far.
    pub work: WorkCounts,
    /// Counts of how models condensed their exterior so far, if they condense it.
    pub condensation: Option<CondensationCounts>,
    /// Modelled device at the end of the tick, if there is one.
    pub device: Option<DeviceView>,
}

impl TickView<'_> {
    /// Returns f·n̂ of the commanded force, N; 0 when free.
    pub fn normal_force(&self) -> f64 {
        self.report.touch.map_or(0.0, |touch| self.force.dot(&touch.normal))
    }

    /// Returns |f − (f·n̂) n̂| of the commanded force, N; 0 when free.
    pub fn tangential_force(&self) -> f64 {
        self.report.touch.map_or(0.0, |touch| (self.force - touch.normal * self.normal_force()).norm())
    }
}

/// Custom parts, in place of those of the scene.
#[derive(Debug, Default)]
pub struct OwnParts {
    /// Mesh in place of the scene's. The scene's masses, and the constants of springs where each has its own, must be as
    /// many as its nodes and edges.
    pub mesh: Option<Mesh>,
    /// Instrument in place of the scene's.
    pub instrument: Option<Box<dyn Instrument>>,
    /// Renderer in place of the scene's local model, contact scheme and law. It runs in lockstep.
    pub renderer: Option<Box<dyn Renderer>>,
}

/// Why a scene cannot be put together.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AssemblyError {
    /// The material does not fit the mesh.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The mesh has no proper surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Contacts cannot be spread over a disc of the scene's radius.
    #[error(transparent)]
    Disc(#[from] DiscError),
    /// There is no static equilibrium to start from.
    #[error(transparent)]
    Settle(#[from] SettleError),
    /// The instrument cannot be where the tip starts.
    #[error(transparent)]
    Instrument(#[from] InstrumentError),
    /// The first model cannot be built.
    #[error(transparent)]
    Model(#[from] BuildError),
    /// The tip starts inside the body.
    #[error("the tip starts {depth_m:.6} m inside the body")]
    TipInside {
        /// How deep, m.
        depth_m: f64,
    },
    /// A custom renderer does not take the body or the scene's settings.
    #[error("the renderer refuses the scene: {}", .0.0)]
    Refused(RendererFault),
    /// The scene's renderer cannot be loaded.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// A custom renderer gets its models from cycles that are replayed.
    #[error("a custom renderer needs a global side, so not `local.model = \"full\"`, and `sync.mode = \"replay\"`")]
    NoCycle,
    /// A custom renderer that moves no nodes pushes the network, which an implicit global step does not take.
    #[error("a custom renderer that moves no nodes needs an explicit `global.integrator`")]
    PushedImplicitly,
}

impl AssemblyError {
    /// Adds the place in the scene that decides the error.
    fn located(self, scene: &Scene) -> SceneError {
        match self {
            Self::Network(error) => scene.error(Problem::Network(error)),
            Self::Surface(error) => scene.error(Problem::Surface(error)),
            Self::Disc(error) => scene.error(Problem::Disc(error)),
            Self::Settle(error) => scene.error(Problem::Settle(error)),
            Self::Instrument(error) => scene.error(Problem::Instrument { key: "instrument", error }),
            Self::Model(BuildError::Model(error)) => scene.error(Problem::Model(error)),
            Self::TipInside { depth_m } => scene.error(Problem::TipInside { depth_m }),
            Self::Library(error) => scene.error(Problem::Library(error)),
            error @ (Self::Model(BuildError::Renderer(_))
            | Self::Refused(_)
            | Self::NoCycle
            | Self::PushedImplicitly) => scene.error(Problem::OwnPart(error.to_string())),
        }
    }
}

/// The two sides of a simulation, ready for another schedule than lockstep.
#[derive(Debug, Clone)]
pub struct Sides {
    /// The local model, contact, instrument and fail-safe.
    pub servo: Servo,
    /// The network, its cycle, and the builder of local models.
    pub global: GlobalSide,
}

/// An assembled scene, ready to run.
///
/// ```
/// use stickslip::contact::law::Mode;
/// use stickslip::multirate::global::Moment;
/// use stickslip::multirate::timeline::Timeline;
/// use stickslip::pipeline::{OwnParts, Simulation};
/// use stickslip::scene::Scene;
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(250);
/// let simulation = Simulation::prepare(&scene)?;
/// assert_eq!((simulation.network().node_count(), simulation.surface().triangles.len()), (324, 448));
/// assert!(simulation.device().is_none() && simulation.global().state().x == simulation.network().rest);
///
/// // Models are built where cycles end, after 100 and 200 ticks; here they take 30 ticks to come.
/// let (mut built, mut oldest) = (0, 0);
/// simulation.with_timeline(Timeline::Ideal { latency: 30 }).run_timed(
///     |moment| built += u32::from(moment == Moment::ModelEnds),
///     |tick| oldest = oldest.max(tick.model_age),
/// )?;
/// assert_eq!((built, oldest), (2, 129)); // the first one's, in the last tick before the second came
///
/// // The tip comes down at 25 µm a tick from 2 mm: to a mesh that is 1.01 mm higher, in 39.6 ticks.
/// let mut mesh = scene.mesh.mesh();
/// mesh.nodes.iter_mut().for_each(|node| node.z += 0.00101);
/// let own = OwnParts { mesh: Some(mesh), ..OwnParts::default() };
/// let mut free = 0;
/// Simulation::prepare_with(&scene, own)?.run(|tick| free += u32::from(tick.report.mode == Mode::Free))?;
/// assert_eq!(free, 39);
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Simulation {
    network: Arc<Network>,
    surface: Arc<Surface>,
    global: GlobalSide,
    servo: Servo,
    timeline: Timeline,
    tick_s: f64,
    tick_count: u64,
    ticks_per_cycle: u64,
    recording: PathRecording,
    /// The whole network runs at the local rate: there are no cycles and no model to age.
    is_full: bool,
}

impl Simulation {
    /// Scene → mesh → network → first local model. All allocation that depends on the scene is done
    /// here and at boundaries, none in a tick.
    ///
    /// # Errors
    /// If settings of the scene are out of range or do not go together, the mesh has no proper surface, the tip starts
    /// inside it, or the device cannot be where the tip starts.
    pub fn prepare(scene: &Scene) -> Result<Self, SceneError> {
        Self::prepare_with(scene, OwnParts::default())
    }

    /// Assembles a scene with custom parts in place of its own.
    ///
    /// # Errors
    /// As [`prepare`](Self::prepare), or if a part does not fit the scene.
    pub fn prepare_with(scene: &Scene, own: OwnParts) -> Result<Self, SceneError> {
        if own.mesh.is_none() {
            scene.check()?;
        }
        Self::assemble(scene, own).map_err(|error| error.located(scene))
    }

    fn assemble(scene: &Scene, own: OwnParts) -> Result<Self, AssemblyError> {
        let mesh = own.mesh.unwrap_or_else(|| scene.mesh.mesh());
        let network = Arc::new(Network::new(&mesh, &scene.material, scene.fixed.clone())?);
        let surface = Arc::new(Surface::new(&mesh)?);
        let contact_surface = SurfaceModel::new(scene.surface, surface.clone())?.spread(
            scene.contact_radius,
            &network.rest,
            &network.fixed,
        )?;
        let mut start = network.rest_state();
        if scene.settle {
            start.x = settle(&network)?;
        }
        let builder = LocalModelBuilder::new(&network, contact_surface.clone(), scene.local())
            .with_integrator(scene.integrator, scene.tick_s());
        let cycle = CycleSettings {
            sync: scene.global.sync,
            integrator: scene.global.integrator,
            substeps: scene.global.substeps,
            threads: scene.global.threads,
            ticks_per_cycle: scene.ticks_per_cycle(),
            tick_s: scene.tick_s(),
            metric: scene.contact.scheme.overwrite_metric(),
        };
        let mut global = GlobalSimulation::new(cycle, network.clone(), builder, start);
        let renderer = match own.renderer {
            Some(renderer) => Some(renderer),
            None => scene.renderer().map(external::open).transpose()?,
        };
        let is_rendered_by_another = renderer.is_some();
        if let Some(renderer) = renderer {
            if scene.is_full() || scene.global.sync != SyncMode::Replay {
                return Err(AssemblyError::NoCycle);
            }
            let setup = Setup {
                tick_s: scene.tick_s(),
                cycle_s: f64::from(scene.ticks_per_cycle()) * scene.tick_s(),
                law: scene.contact.law,
                adhesion_n: scene.contact.adhesion_n,
                surface: scene.surface,
                radius_m: scene.contact_radius,
            };
            global = global.with_renderer(renderer, &setup).map_err(AssemblyError::Refused)?;
        }

        let instrument = match own.instrument {
            Some(instrument) => InstrumentInUse::Own(instrument),
            None => InstrumentInUse::new(&scene.instrument_in_use(), &scene.path, scene.tick_s())?,
        };
        let smoothing = HandOverSmoothing::new(scene.smoothing_ticks);
        let tip = instrument.start();
        let ModelMessage { model, state, renderer } = global.build_model(tip)?;
        let mut local = LocalSimulation::new(scene.contact, scene.tick_s(), contact_surface, model, state);
        local.take_over(renderer);
        let distance = local.shape().signed_distance(tip);
        if !(distance >= -START_TOLERANCE) {
            return Err(AssemblyError::TipInside { depth_m: -distance });
        }
        let recording = match (is_rendered_by_another, local.moved()) {
            (true, None) if scene.global.integrator == GlobalIntegrator::ImplicitEuler => {
                return Err(AssemblyError::PushedImplicitly);
            }
            (true, None) => PathRecording::Forces,
            (true, Some(_)) => PathRecording::EveryTick,
            (false, _) if scene.global.sync == SyncMode::Replay && scene.local().extent != Extent::All => {
                PathRecording::EveryTick
            }
            (false, _) => PathRecording::LastTick,
        };
        let bounds = Bounds::new(&network.rest, scene.largest_contact_force_n());
        Ok(Self {
            servo: Servo::new(local, instrument, smoothing, FailSafe::new(bounds), scene.tick_s()),
            timeline: scene.timeline(),
            global: GlobalSide::new(global, network.clone(), bounds),
            network,
            surface,
            tick_s: scene.tick_s(),
            tick_count: scene.tick_count(),
            ticks_per_cycle: u64::from(scene.ticks_per_cycle()),
            recording,
            is_full: scene.is_full(),
        })
    }

    /// Replaces the times at which ticks end and models arrive.
    pub fn with_timeline(self, timeline: Timeline) -> Self {
        Self { timeline, ..self }
    }

    /// Returns the full model.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Returns the boundary triangles of the body.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Returns the local side.
    pub fn local(&self) -> &LocalSimulation {
        self.servo.local()
    }

    /// Returns the modelled device, if there is one.
    pub fn device(&self) -> Option<&CoupledPhantom> {
        self.servo.device()
    }

    /// Returns the global side.
    pub fn global(&self) -> &GlobalSimulation {
        self.global.simulation()
    }

    /// Returns the two sides, for another schedule or a custom loop. A clone of the servo side allocates its workspace
    /// again in its first ticks; this one has it.
    pub fn into_sides(self) -> Sides {
        Sides { servo: self.servo, global: self.global }
    }

    /// Returns how much of the patch's path the global side needs; `None` without cycles.
    pub fn recording(&self) -> Option<PathRecording> {
        (!self.is_full).then_some(self.recording)
    }

    /// Runs in lockstep: the two sides take turns in virtual time. `observe` is called after every
    /// tick that the fail-safe lets pass.
    ///
    /// # Errors
    /// With the fault that ended the run.
    pub fn run(self, observe: impl FnMut(&TickView)) -> Result<(), Fault> {
        self.run_timed(|_| (), observe)
    }

    /// Runs as [`run`](Self::run) does; `mark` is called at every moment of the schedule.
    ///
    /// # Errors
    /// With the fault that ended the run.
    pub fn run_timed(self, mut mark: impl FnMut(Moment), mut observe: impl FnMut(&TickView)) -> Result<(), Fault> {
        let mut run = Lockstep::new(self);
        while let Some(view) = run.step_timed(&mut mark)? {
            observe(&view);
        }
        Ok(())
    }
}

/// A run in lockstep in virtual time, tick by tick.
///
/// ```
/// use stickslip::{pipeline::{Lockstep, Simulation}, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(120);
/// let mut run = Lockstep::new(Simulation::prepare(&scene)?);
/// let mut ticks = 0;
/// let mut tip = run.servo().tip();
/// while let Some(view) = run.step()? {
///     assert_eq!(view.tip_before, tip);
///     (tip, ticks) = (view.tip, ticks + 1);
/// }
/// assert_eq!((ticks, run.servo().next_tick()), (120, 120));
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Lockstep {
    simulation: Simulation,
    trajectory: Trajectory,
    /// Up: the cycles that the global side has not yet taken in.
    passed: Vec<CycleMessage>,
    /// Down: models that are not yet due, or why there is none.
    pending: VecDeque<(Arrival, Result<ModelMessage, FaultCause>)>,
    energy: EnergyBalance,
    /// A segment of the path that begins with the next tick of a custom renderer, which only then has moved nodes: its
    /// first tick in the cycle, and the largest number of its ticks.
    segment: Option<(usize, usize)>,
}

impl Lockstep {
    /// Starts a run before its first tick.
    pub fn new(simulation: Simulation) -> Self {
        let ground = if simulation.is_full { simulation.network.fixed_potential() } else { 0.0 };
        let mut energy = EnergyBalance::new(ground);
        energy.take_stock(simulation.servo.local());
        let trajectory = Trajectory::new(simulation.recording);
        let mut run =
            Self { simulation, trajectory, passed: Vec::new(), pending: VecDeque::new(), energy, segment: None };
        run.begin_segment();
        run
    }

    /// Returns the servo side after the last tick.
    pub fn servo(&self) -> &Servo {
        &self.simulation.servo
    }

    /// Returns a copy of the servo side as it enters the next tick, with the model that is due then; `None` after the last
    /// tick, or if the global side ends the run before it.
    pub fn servo_at_next_tick(&self) -> Option<Servo> {
        let mut ahead = self.clone();
        matches!(ahead.begin(&mut |_| ()), Ok(true)).then_some(ahead.simulation.servo)
    }

    /// Does one tick, with what comes before it: the boundary of a cycle, a model that is due. `None` when the run is over.
    ///
    /// # Errors
    /// With the fault that ended the run.
    pub fn step(&mut self) -> Result<Option<TickView<'_>>, Fault> {
        self.step_timed(&mut |_| ())
    }

    /// Does one tick as [`step`](Self::step); `mark` is called at every moment of the schedule as it comes.
    ///
    /// # Errors
    /// With the fault that ended the run.
    pub fn step_timed(&mut self, mark: &mut impl FnMut(Moment)) -> Result<Option<TickView<'_>>, Fault> {
        if self.begin(mark)? { self.finish(mark).map(Some) } else { Ok(None) }
    }

    /// Does what comes before a tick. Returns whether there is one.
    fn begin(&mut self, mark: &mut impl FnMut(Moment)) -> Result<bool, Fault> {
        let Simulation { global, servo, timeline, ticks_per_cycle, tick_count, recording, is_full, .. } =
            &mut self.simulation;
        let tick = servo.next_tick();
        if tick >= *tick_count {
            return Ok(false);
        }
        let is_boundary = tick % *ticks_per_cycle == 0 && tick > 0 && !*is_full;
        if is_boundary {
            let past = std::mem::replace(&mut self.trajectory, Trajectory::new(*recording));
            self.passed.push(CycleMessage {
                trajectory: past,
                contact: servo.local().contact(),
                tip: servo.tip(),
                rendered: servo.report().rendered(),
            });
            if let Some(at) = timeline.model_due(tick) {
                self.pending.push_back((Arrival { from: tick, at }, global.next_model(self.passed.drain(..), mark)));
            }
        }
        let is_due = self.pending.front().is_some_and(|(arrival, _)| arrival.at <= tick);
        if let Some((arrival, model)) = if is_due { self.pending.pop_front() } else { None } {
            let model = model.map_err(|cause| servo.latch(cause))?;
            servo.hand_over(model, arrival.from);
            self.energy.take_stock(servo.local());
            self.begin_segment();
        } else if is_boundary {
            self.begin_segment();
        }
        Ok(true)
    }

    /// Does the tick itself.
    fn finish(&mut self, mark: &mut impl FnMut(Moment)) -> Result<TickView<'_>, Fault> {
        let Simulation { global, network, servo, timeline, tick_s, is_full, recording, .. } = &mut self.simulation;
        let deadline_outcome = timeline.deadline_outcome(servo.next_tick());
        mark(Moment::TickBegins);
        let done = servo.tick(deadline_outcome)?;
        mark(Moment::TickEnds);
        let local = servo.local();
        let is_skipped = deadline_outcome == DeadlineOutcome::Skipped;
        match (local.moved(), *recording) {
            _ if *is_full => {}
            // The segment begins in the next tick.
            (Some(_), _) if is_skipped && self.segment.is_some() => {
                self.segment = self.segment.map(|(tick, ticks)| (tick + 1, ticks.saturating_sub(1)));
            }
            (Some(moved), _) => {
                if let Some((tick, ticks)) = self.segment.take() {
                    self.trajectory.begin_nodes(moved.nodes, tick, ticks);
                }
                self.trajectory.record_at(moved.x, moved.v);
            }
            (None, PathRecording::Forces) => {
                let point = servo.report().touch.filter(|_| !is_skipped).map(|touch| touch.point);
                self.trajectory.record_push(done.report.force, point);
            }
            (None, _) => self.trajectory.record(local.state()),
        }
        if !is_skipped {
            self.energy.add_tick(local, &done.report, done.tip_before, done.tip, *tick_s);
            if !self.energy.is_finite() {
                return Err(Fault { tick: done.tick, ..servo.latch(FaultCause::EnergyNotFinite) });
            }
        }
        let local = servo.local();
        Ok(TickView {
            tick: done.tick,
            time: done.time,
            tip_before: done.tip_before,
            tip: done.tip,
            force: done.force,
            report: servo.report(),
            deadline_outcome,
            has_deadlines: !matches!(timeline, Timeline::Ideal { .. }),
            local,
            network,
            network_state: global.simulation().state(),
            model_age: if *is_full { 0 } else { done.model_age },
            energy: &self.energy,
            work: local.state().work + global.simulation().work(),
            condensation: global.simulation().condensation(),
            device: done.device,
        })
    }

    /// Begins to record the path of the model in use, to the end of the cycle at most.
    fn begin_segment(&mut self) {
        let Simulation { servo, ticks_per_cycle, tick_count, .. } = &self.simulation;
        let tick_in_cycle = servo.next_tick() % ticks_per_cycle;
        let ticks = (ticks_per_cycle - tick_in_cycle).min(*tick_count);
        let local = servo.local();
        let (tick, ticks) = (tick_in_cycle as usize, ticks as usize);
        match local.moved() {
            Some(_) => self.segment = Some((tick, ticks)),
            None => self.trajectory.begin(local.model(), local.state(), tick, ticks),
        }
    }
}

/// Assembles a scene and runs it.
///
/// # Errors
/// If the scene cannot start, or the fail-safe ends it.
pub fn run(scene: &Scene, observe: impl FnMut(&TickView)) -> Result<(), RunError> {
    Simulation::prepare(scene)?.run(observe)?;
    Ok(())
}
