//! Records of runs, from which errors are computed, and the references of the methods.

use std::ops::Range;

use serde::Serialize;

use super::super::surfaces::whole;
use super::method::Touching;
use crate::Vec3;
use crate::contact::law::Mode;
use crate::contact::rules::Scheme;
use crate::local::condensation::CondensationCounts;
use crate::model::work::WorkCounts;
use crate::output::summary::Sample;
use crate::pipeline::{OwnParts, Simulation};
use crate::scene::{Scene, SceneError};
use crate::verify::residual::largest;

/// Steps of the fine reference in a tick.
pub const REFINEMENT: u32 = 8;
/// Length of the windows in which shares of modes are compared, s: ticks alternate between stick and slip.
pub(super) const MODE_WINDOW_S: f64 = 0.05;
/// Share of slipping ticks in the following window at which slip has set in.
const ONSET_SHARE: f64 = 0.5;

/// Tick of a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct RenderedTick {
    /// Tip at the tick's end, m; none after a fault.
    pub(super) tip: Option<Vec3>,
    pub(super) force: Vec3,
    normal_force: f64,
    tangential_force: f64,
    pub(super) mode: Mode,
    /// Contact normal n̂; none when free.
    pub(super) normal: Option<Vec3>,
    /// Place of the contact point on the surface at rest, m.
    pub(super) place: Option<Vec3>,
    /// Whether this is the first tick of a new model.
    handed_over: bool,
}

/// Tick after a fault, in which nothing is commanded.
const NOTHING: RenderedTick = RenderedTick {
    tip: None,
    force: Vec3::new(0.0, 0.0, 0.0),
    normal_force: 0.0,
    tangential_force: 0.0,
    mode: Mode::Free,
    normal: None,
    place: None,
    handed_over: false,
};

/// Tick of another program.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutsideTick {
    /// Force on the instrument, N.
    pub(crate) force: Vec3,
    /// Contact mode; free if it is not known.
    pub(crate) mode: Mode,
    /// Place of the contact point on the surface at rest, m, if it is known.
    pub(crate) place: Option<Vec3>,
}

/// Row of `reference.csv`: what a renderer has to bring about in a tick. The columns of the contact point and its normal are
/// empty in free ticks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ForceRow {
    t: f64,
    qx: Option<f64>,
    qy: Option<f64>,
    qz: Option<f64>,
    fx: f64,
    fy: f64,
    fz: f64,
    px: Option<f64>,
    py: Option<f64>,
    pz: Option<f64>,
    nx: Option<f64>,
    ny: Option<f64>,
    nz: Option<f64>,
    mode: &'static str,
}

impl ForceRow {
    fn new(t: f64, rendered: &RenderedTick) -> Self {
        let axes = |vector: Option<Vec3>| [0, 1, 2].map(|axis| vector.map(|vector| vector[axis]));
        let ([qx, qy, qz], [px, py, pz]) = (axes(rendered.tip), axes(rendered.place));
        let ([nx, ny, nz], [fx, fy, fz]) = (axes(rendered.normal), rendered.force.into());
        Self { t, qx, qy, qz, fx, fy, fz, px, py, pz, nx, ny, nz, mode: rendered.mode.name() }
    }
}

/// Record of a run: the state at the end of every tick of the scene, without force after
/// a fault.
///
/// ```
/// use stickslip::{scene::Scene, verify::accuracy::Record};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let record = Record::of(&scene)?;
/// let samples = record.samples();
/// assert_eq!((samples.len(), samples[0].time, &record.fault), (150, scene.tick_s(), &None));
/// let squares: f64 = samples.iter().map(|sample| sample.force.norm_squared()).sum();
/// assert!((record.force_rms_n() - (squares / 150.0).sqrt()).abs() < 1e-14);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Record {
    pub(super) rendered: Vec<RenderedTick>,
    pub(super) tick: f64,
    /// Fault that ended the run, if one did.
    pub fault: Option<String>,
    /// Residual of the energy balance over the total |work|; 0 without work.
    pub energy_residual_rel: f64,
    /// Counts of computed work.
    pub work: WorkCounts,
    /// Counts of condensed models, with a condensed exterior.
    pub condensation: Option<CondensationCounts>,
}

impl Record {
    /// Runs a scene and records it.
    ///
    /// # Errors
    /// If the scene cannot start. A fault is part of the result.
    pub fn of(scene: &Scene) -> Result<Self, SceneError> {
        Self::of_parts(scene, OwnParts::default(), |_| ())
    }

    /// Runs a scene with custom parts and records it. `watch` is called after every tick with the number of ticks done.
    ///
    /// # Errors
    /// If the scene cannot start, or a part does not fit it. A fault is part of the result.
    pub fn of_parts(scene: &Scene, own: OwnParts, watch: impl FnMut(u64)) -> Result<Self, SceneError> {
        Self::every(scene, own, 1, watch)
    }

    /// Returns the record of forces that another program rendered, one for each tick of `tick_s` seconds.
    pub(crate) fn of_forces(forces: impl IntoIterator<Item = OutsideTick>, tick_s: f64) -> Self {
        let rendered = |OutsideTick { force, mode, place }| RenderedTick { force, mode, place, ..NOTHING };
        Self {
            rendered: forces.into_iter().map(rendered).collect(),
            tick: tick_s,
            fault: None,
            energy_residual_rel: 0.0,
            work: WorkCounts::default(),
            condensation: None,
        }
    }

    /// Returns some of the ticks. The energy residual and the counts stay those of the whole run.
    pub(crate) fn part(&self, ticks: Range<usize>) -> Self {
        Self { rendered: self.rendered[ticks].to_vec(), ..self.clone() }
    }

    /// Runs a scene and records one in `ticks` ticks. The geometric and the massless scheme's force is that of a state and is recorded at
    /// the end; the velocity scheme's is an impulse over a tick and is recorded as its mean. `watch` is called after every tick with the
    /// number of ticks done.
    fn every(scene: &Scene, own: OwnParts, ticks: u32, mut watch: impl FnMut(u64)) -> Result<Self, SceneError> {
        let simulation = Simulation::prepare_with(scene, own)?;
        let rest = simulation.network().rest.clone();
        let mut record = Self {
            rendered: Vec::with_capacity((scene.tick_count() / u64::from(ticks)) as usize),
            tick: scene.tick_s() * f64::from(ticks),
            fault: None,
            energy_residual_rel: 0.0,
            work: WorkCounts::default(),
            condensation: None,
        };
        let mut impulse = Vec3::zeros();
        let end = simulation.run(|view| {
            watch(view.tick + 1);
            impulse += view.force;
            if (view.tick + 1) % u64::from(ticks) != 0 {
                return;
            }
            let mean = std::mem::take(&mut impulse) / f64::from(ticks);
            let force = match scene.contact.scheme {
                Scheme::Geometric { .. } | Scheme::Massless => view.force,
                Scheme::Velocity => mean,
            };
            let report = view.report;
            let place = report.touch.map(|touch| {
                view.local.surface().node_weights(&touch.point).map(|(node, weight)| rest[node] * weight).sum()
            });
            record.rendered.push(RenderedTick {
                tip: Some(view.tip),
                force,
                normal_force: report.normal_force,
                tangential_force: report.tangential_force(),
                mode: report.mode,
                normal: report.touch.map(|touch| touch.normal),
                place,
                handed_over: view.tick > 0 && view.model_age == 0 && !scene.is_full(),
            });
            record.energy_residual_rel = ratio(view.energy.residual(), view.energy.absolute_work);
            (record.work, record.condensation) = (view.work, view.condensation);
        });
        record.fault = end.err().map(|fault| fault.to_string());
        record.rendered.resize((scene.tick_count() / u64::from(ticks)) as usize, NOTHING);
        Ok(record)
    }

    /// Returns the forces as samples for a figure.
    pub fn samples(&self) -> Vec<Sample> {
        let samples = self.rendered.iter().enumerate().map(|(i, rendered)| Sample {
            time: (i + 1) as f64 * self.tick,
            force: rendered.force,
            normal_force: rendered.normal_force,
            tangential_force: rendered.tangential_force,
            mode: rendered.mode,
        });
        samples.collect()
    }

    /// Returns a row of `reference.csv` for every tick.
    pub fn rows(&self) -> impl Iterator<Item = ForceRow> {
        // Exact for rates that are whole numbers of hertz, unlike multiples of the tick.
        let rate = 1.0 / self.tick;
        let rate = if (rate - rate.round()).abs() < 1e-9 * rate { rate.round() } else { rate };
        let rows = self.rendered.iter().enumerate();
        rows.map(move |(i, rendered)| ForceRow::new((i + 1) as f64 / rate, rendered))
    }

    /// Returns the root mean square of the force, N.
    pub fn force_rms_n(&self) -> f64 {
        mean(self.rendered.iter().map(|rendered| rendered.force.norm_squared())).sqrt()
    }

    /// Returns the largest change of force in the first tick of a new model, with contact before and after it, beyond
    /// that of the reference in the same tick, over the reference's force before it.
    pub(super) fn handover_jump_rel(&self, reference: &Record) -> f64 {
        let touches = |rendered: &RenderedTick| rendered.mode != Mode::Free;
        let jumps = self.rendered.windows(2).zip(reference.rendered.windows(2)).filter_map(|(own, whole)| {
            let counts = own[1].handed_over && own.iter().chain(whole).all(touches);
            let change = (own[1].force - own[0].force) - (whole[1].force - whole[0].force);
            counts.then(|| ratio(change.norm(), whole[0].force.norm()))
        });
        largest(jumps)
    }

    /// Returns the time at which slip sets in, s.
    pub(super) fn slip_onset(&self) -> Option<f64> {
        let window = self.window(MODE_WINDOW_S);
        let slips = |rendered: &RenderedTick| rendered.mode == Mode::Slip;
        let share = |rendered: &[RenderedTick]| {
            rendered.iter().filter(|rendered| slips(rendered)).count() as f64 / window as f64
        };
        let first = self.rendered.windows(window).position(|ahead| slips(&ahead[0]) && share(ahead) >= ONSET_SHARE)?;
        Some((first + 1) as f64 * self.tick)
    }

    /// Returns the number of ticks in some seconds.
    pub(super) fn window(&self, seconds: f64) -> usize {
        ((seconds / self.tick).round() as usize).max(1)
    }
}

/// Reference of the methods: the whole network at the haptic rate with one contact.
///
/// ```
/// use stickslip::{scene::Scene, verify::accuracy::{Assessment, Errors, Method, Reference, Status}};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let method = Method::of(&scene);
/// let reference = Reference::of(&scene, method.touching)?;
/// // The reference is the whole network at the haptic rate, and finds no error in itself.
/// assert!(Reference::scene(&scene, method.touching).is_full());
/// let errors = Errors::of(&reference.coarse, &reference);
/// assert_eq!((errors.force_error_rms_rel, errors.mode_agreement), (0.0, 1.0));
/// assert!(reference.floor > 0.0 && reference.floor < 0.1); // what eight times shorter ticks change
///
/// // One ring of tangents in a fixed exterior is too stiff by far more than that.
/// let assessment = Assessment::of(&scene, &method, &reference)?;
/// assert!(assessment.errors.force_error_rms_rel > reference.floor);
/// assert_eq!(assessment.status(true), Status::Ok);
/// assert_eq!(assessment.status(false), Status::Overrun); // had it taken too long
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Reference {
    /// Contact of the tip with the mesh.
    pub touching: Touching,
    /// Run at the scene's tick.
    pub coarse: Record,
    /// Run at an eighth of the scene's tick.
    pub fine: Record,
    /// Disagreement of the two runs, relative to the coarse one: smaller errors have no meaning.
    pub floor: f64,
}

impl Reference {
    /// Returns the scene of a reference at its tick.
    pub fn scene(scene: &Scene, touching: Touching) -> Scene {
        whole(scene, touching.surface, touching.scheme)
    }

    /// Runs both references.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn of(scene: &Scene, touching: Touching) -> Result<Self, SceneError> {
        Self::watched(scene, touching, |_| ())
    }

    /// Runs both references and calls `watch` after every tick with the number of ticks done, of
    /// (1 + [`REFINEMENT`]) times the scene's.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn watched(scene: &Scene, touching: Touching, mut watch: impl FnMut(u64)) -> Result<Self, SceneError> {
        let coarse = Self::scene(scene, touching);
        let fine = coarse.clone().with_local_rate_hz(coarse.local_rate_hz() * f64::from(REFINEMENT))?;
        let done = scene.tick_count();
        let coarse = Record::of_parts(&coarse, OwnParts::default(), &mut watch)?;
        let fine = Record::every(&fine, OwnParts::default(), REFINEMENT, |ticks| watch(done + ticks))?;
        Ok(Self::between(touching, coarse, fine))
    }

    /// Returns the reference over some of the ticks.
    pub(crate) fn part(&self, ticks: Range<usize>) -> Self {
        Self::between(self.touching, self.coarse.part(ticks.clone()), self.fine.part(ticks))
    }

    fn between(touching: Touching, coarse: Record, fine: Record) -> Self {
        let floor = force_error(&fine, &coarse);
        Self { touching, coarse, fine, floor }
    }
}

/// Returns the root mean square of the difference of forces over that of the reference.
pub(super) fn force_error(record: &Record, reference: &Record) -> f64 {
    let square = record.rendered.iter().zip(&reference.rendered).map(|(a, b)| (a.force - b.force).norm_squared());
    ratio(mean(square).sqrt(), reference.force_rms_n())
}

pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    if count > 0 { sum / count as f64 } else { 0.0 }
}

/// Returns part / whole; 0 if `part` is 0, also for 0 / 0.
pub(super) fn ratio(part: f64, whole: f64) -> f64 {
    if part == 0.0 { 0.0 } else { part / whole }
}
