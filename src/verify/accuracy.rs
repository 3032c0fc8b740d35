//! What local approximations cost in accuracy: a grid of them, each held against the whole network at the
//! haptic rate with the same contact code, so that nothing but the local model differs.

use std::fmt;

use serde::Serialize;

use super::surfaces::whole;
use crate::Vec3;
use crate::contact::law::Mode;
use crate::contact::operators::Metric;
use crate::contact::surface::ContactSurface;
use crate::contact::tick::{Deformation, Scheme};
use crate::model::condensation::{Condensation, CondensationCounts, FarField, Reach};
use crate::model::local::{ExteriorKind, Linearization, LocalSettings};
use crate::model::patch::Extent;
use crate::model::springs::TangentKind;
use crate::model::step::LocalIntegrator;
use crate::model::work::WorkCounts;
use crate::output::summary::Sample;
use crate::pipeline::Simulation;
use crate::scene::{Scene, SceneError};

/// The paper's local model: one ring of tangents in an exterior that stands still,
pub const PAPER: LocalSettings = LocalSettings {
    extent: Extent::Rings(1),
    linearization: Linearization::Tangent(TangentKind::Exact),
    exterior: ExteriorKind::Fixed,
};
/// renewed so often, Hz.
pub const PAPER_RATE_HZ: f64 = 10.0;

/// The fine reference takes so many steps in a tick.
pub const REFINEMENT: u32 = 8;
/// A hand takes forces for the same that differ by less than this share.
pub const PERCEPTION: f64 = 0.1;
/// A relative error above this is worse than commanding no force at all, whose error is 1.
const DIVERGED_ABOVE: f64 = 1.0;
/// Force errors are also given for windows this long, s.
const FORCE_WINDOW_S: f64 = 0.1;
/// Ticks stick and slip in turns, so modes are compared by their shares in windows this long, s.
const MODE_WINDOW_S: f64 = 0.05;
/// Slip has set in where at least this share of the window that follows slips.
const ONSET_SHARE: f64 = 0.5;
/// Bytes that the dense matrices of one local model may take in a grid; a scene's own may take more.
const MOST_MATRIX_BYTES: usize = 1 << 28;

/// How the tip meets the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touching {
    /// What it feels.
    pub surface: ContactSurface,
    /// How it constrains.
    pub scheme: Scheme,
}

/// One way to run a drag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    /// `model = "full"`: there is no local model.
    pub is_full: bool,
    /// The local model.
    pub local: LocalSettings,
    /// How its ticks are solved.
    pub integrator: LocalIntegrator,
    /// How often it is renewed, Hz.
    pub global_rate: f64,
    /// The contact.
    pub touching: Touching,
}

/// A method in the words of scenes; `None` where a key has no effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Names {
    /// "patch" or "full".
    pub model: &'static str,
    /// A number, or "all".
    pub rings: Rings,
    /// "tangent" or "none".
    pub linearization: &'static str,
    /// "fixed", "drifting" or "condensed".
    pub exterior: Option<&'static str>,
    /// "exact" or "stabilised".
    pub tangent: Option<&'static str>,
    /// How far a condensed exterior follows; "all" of it, or springs from the centre.
    pub condense_rings: Option<Rings>,
    /// What lies beyond, "fixed" or "coarse".
    pub far_field: Option<&'static str>,
    /// Of the local model.
    pub integrator: &'static str,
    /// "geometric" or "velocity".
    pub scheme: &'static str,
    /// "faceted", "shaded" or "subdivision".
    pub surface: &'static str,
    /// "rigid" or "least-norm".
    pub deformation: Option<&'static str>,
    /// "euclidean" or "mass".
    pub metric: Option<&'static str>,
    /// Hz.
    pub global_rate: f64,
}

/// `rings` as scenes give them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Rings {
    /// So many.
    Count(u32),
    /// "all".
    Named(&'static str),
}

/// Which methods are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coverage {
    /// One to three rings and all, the paper's rate and five times that, the scene's contact and the velocity
    /// scheme on subdivision.
    Default,
    /// Also four rings, coarse far fields, more rates and more contacts.
    All,
}

/// The methods of a comparison, the paper's and the scene's own among them.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Each once, grouped by contact, the scene's own contact first.
    pub methods: Vec<Method>,
    /// Contacts in the order in which they come.
    pub contacts: Vec<Touching>,
    /// What was not taken in, and why.
    pub left_out: Vec<String>,
}

impl Method {
    /// What a scene asks for.
    pub fn of(scene: &Scene) -> Self {
        Self {
            is_full: scene.is_full,
            local: scene.local,
            integrator: scene.integrator,
            global_rate: scene.global.rate,
            touching: Touching { surface: scene.surface, scheme: scene.contact.scheme },
        }
    }

    /// The scene's drag, run this way. The substeps of the global side stay as long as they are.
    pub fn scene(&self, scene: &Scene) -> Scene {
        let mut own = scene.clone();
        (own.local, own.is_full, own.integrator) = (self.local, self.is_full, self.integrator);
        (own.surface, own.contact.scheme) = (self.touching.surface, self.touching.scheme);
        if let Some(ticks) = ticks_per_cycle(scene, self.global_rate) {
            let substeps = f64::from(scene.global.substeps) * f64::from(ticks) / f64::from(scene.ticks_per_cycle);
            own.global.substeps = (substeps.round() as u32).max(1);
            (own.global.rate, own.ticks_per_cycle) = (self.global_rate, ticks);
        }
        own
    }

    /// In the words of scenes.
    pub fn names(&self) -> Names {
        let kind = |kind: TangentKind| match kind {
            TangentKind::Exact => "exact",
            TangentKind::Stabilised => "stabilised",
        };
        let LocalSettings { extent, linearization, exterior } = self.local;
        let (linearization, mut tangent) = match linearization {
            Linearization::Tangent(tangent) => ("tangent", Some(kind(tangent))),
            Linearization::None => ("none", None),
        };
        let (mut condense_rings, mut far_field) = (None, None);
        let exterior = match exterior {
            ExteriorKind::Fixed => "fixed",
            ExteriorKind::Drifting => "drifting",
            ExteriorKind::Condensed(condensation) => {
                tangent = Some(kind(condensation.tangent));
                (condense_rings, far_field) = match condensation.reach {
                    Reach::All => (Some(Rings::Named("all")), None),
                    Reach::Rings { rings, far_field: FarField::Fixed } => (Some(Rings::Count(rings)), Some("fixed")),
                    Reach::Rings { rings, far_field: FarField::Coarse } => (Some(Rings::Count(rings)), Some("coarse")),
                };
                "condensed"
            }
        };
        let (rings, exterior) = match extent {
            Extent::Rings(rings) => (Rings::Count(rings), Some(exterior)),
            Extent::All => (Rings::Named("all"), None),
        };
        let (scheme, deformation, metric) = match self.touching.scheme {
            Scheme::Geometric { deformation, metric } => ("geometric", Some(deformation), Some(metric)),
            Scheme::Velocity => ("velocity", None, None),
        };
        Names {
            model: if self.is_full { "full" } else { "patch" },
            rings,
            linearization,
            exterior,
            tangent,
            condense_rings,
            far_field,
            integrator: self.integrator.name(),
            scheme,
            surface: match self.touching.surface {
                ContactSurface::Faceted => "faceted",
                ContactSurface::Shaded => "shaded",
                ContactSurface::Subdivision => "subdivision",
            },
            deformation: deformation.map(|deformation| match deformation {
                Deformation::Rigid => "rigid",
                Deformation::LeastNorm => "least-norm",
            }),
            metric: metric.map(|metric| match metric {
                Metric::Euclidean => "euclidean",
                Metric::Mass => "mass",
            }),
            global_rate: self.global_rate,
        }
    }
}

impl fmt::Display for Rings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(1) => f.write_str("1 ring"),
            Self::Count(rings) => write!(f, "{rings} rings"),
            Self::Named(name) => write!(f, "{name} rings"),
        }
    }
}

/// The local model and its rate; not the contact.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_full {
            return f.write_str("full network");
        }
        let Names { rings, linearization, exterior, tangent, condense_rings, global_rate, .. } = self.names();
        write!(f, "{rings}, {linearization}")?;
        [exterior, tangent].into_iter().flatten().try_for_each(|word| write!(f, ", {word}"))?;
        if let Some(reach @ Rings::Count(_)) = condense_rings {
            write!(f, " within {reach}")?;
        }
        if self.integrator != LocalIntegrator::SemiImplicitEuler {
            write!(f, ", {}", self.integrator.name())?;
        }
        write!(f, ", {global_rate} Hz")
    }
}

impl fmt::Display for Touching {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.names();
        write!(f, "{} scheme on the {} surface", names.scheme, names.surface)?;
        names.deformation.map_or(Ok(()), |deformation| write!(f, ", {deformation}"))
    }
}

/// Ticks in a cycle of this rate; `None` if it is no whole number, or the scene's models come later than that.
fn ticks_per_cycle(scene: &Scene, rate: f64) -> Option<u32> {
    let ratio = 1.0 / (scene.tick * rate);
    let ticks = ratio.round();
    let whole = (ratio - ticks).abs() <= 1e-9 * ratio && ticks >= 1.0 && ticks <= f64::from(u32::MAX);
    (whole && f64::from(scene.global.latency_ticks) < ticks).then_some(ticks as u32)
}

/// The methods that a scene's drag is run with.
///
/// # Errors
/// If the scene cannot be put together.
pub fn grid(scene: &Scene, coverage: Coverage) -> Result<Grid, SceneError> {
    let own = Method::of(scene);
    Simulation::prepare(scene)?;
    let mut left_out = Vec::new();
    let mut contacts = vec![own.touching];
    for touching in other_contacts(coverage) {
        if !contacts.contains(&touching) {
            match Simulation::prepare(&whole(scene, touching.surface, touching.scheme)) {
                Ok(_) => contacts.push(touching),
                Err(error) => left_out.push(format!("{touching}: {error}")),
            }
        }
    }
    let mut rates = vec![own.global_rate];
    let more: &[f64] = match coverage {
        Coverage::Default => &[PAPER_RATE_HZ, 50.0],
        Coverage::All => &[PAPER_RATE_HZ, 20.0, 50.0, 100.0],
    };
    for &rate in more {
        match ticks_per_cycle(scene, rate) {
            Some(_) if rates.contains(&rate) => {}
            Some(_) => rates.push(rate),
            None => {
                left_out.push(format!("{rate} Hz: the scene's ticks, or its latency, do not fit into such a cycle"))
            }
        }
    }
    let free = scene.fixed.iter().filter(|&&fixed| !fixed).count();
    let (mut locals, too_large): (Vec<_>, Vec<_>) =
        local_models(coverage).into_iter().partition(|local| matrix_bytes(local, free) <= MOST_MATRIX_BYTES);
    if !too_large.is_empty() {
        left_out.push(format!("tangents of all rings: their matrix, for {free} free nodes, is too large"));
    }
    if !own.is_full && !locals.contains(&own.local) {
        locals.insert(0, own.local);
    }

    let explicit = LocalIntegrator::SemiImplicitEuler;
    let mut methods = Vec::new();
    for &touching in &contacts {
        if own.is_full {
            methods.push(Method { touching, ..own });
        }
        for &local in &locals {
            // All springs at every tick are the full network, however often they are collected anew.
            let renewals = if is_exact(&local) { &rates[..1] } else { &rates[..] };
            methods.extend(renewals.iter().map(|&global_rate| Method {
                is_full: false,
                local,
                integrator: explicit,
                global_rate,
                touching,
            }));
        }
        if touching.scheme == Scheme::Velocity {
            let implicit = SOLVED.into_iter().flat_map(|integrator| {
                let solved = locals.iter().filter(|local| is_solvable(local));
                solved.map(move |&local| (integrator, local))
            });
            methods.extend(implicit.map(|(integrator, local)| Method {
                is_full: false,
                local,
                integrator,
                global_rate: own.global_rate,
                touching,
            }));
        }
        if !own.is_full && own.touching == touching && !methods.contains(&own) {
            methods.push(own);
        }
    }
    Ok(Grid { methods, contacts, left_out })
}

/// Integrators that solve the linear model as a whole.
const SOLVED: [LocalIntegrator; 3] =
    [LocalIntegrator::ImplicitEuler, LocalIntegrator::ImplicitMidpoint, LocalIntegrator::Exponential];

/// Linear models that they are compared on: one and two rings, as the paper has them or condensed.
fn is_solvable(local: &LocalSettings) -> bool {
    let small = matches!(local.extent, Extent::Rings(1 | 2));
    let followed = Condensation { tangent: TangentKind::Exact, reach: Reach::All };
    let exterior = [ExteriorKind::Fixed, ExteriorKind::Condensed(followed)].contains(&local.exterior);
    small && exterior && local.linearization == Linearization::Tangent(TangentKind::Exact)
}

fn is_exact(local: &LocalSettings) -> bool {
    (local.extent, local.linearization) == (Extent::All, Linearization::None)
}

/// The contacts that are compared beside the scene's own.
fn other_contacts(coverage: Coverage) -> Vec<Touching> {
    let geometric = |surface, deformation| {
        let scheme = Scheme::Geometric { deformation, metric: Metric::Euclidean };
        Touching { surface, scheme }
    };
    let velocity = |surface| Touching { surface, scheme: Scheme::Velocity };
    let mut contacts = vec![velocity(ContactSurface::Subdivision)];
    if coverage == Coverage::All {
        contacts.extend([
            geometric(ContactSurface::Faceted, Deformation::Rigid),
            geometric(ContactSurface::Shaded, Deformation::LeastNorm),
            velocity(ContactSurface::Faceted),
        ]);
    }
    contacts
}

/// The local models that are compared.
fn local_models(coverage: Coverage) -> Vec<LocalSettings> {
    use Linearization::{None as Springs, Tangent};
    use TangentKind::{Exact, Stabilised};
    let most_rings = if coverage == Coverage::All { 4 } else { 3 };
    let mut models = Vec::new();
    for rings in 1..=most_rings {
        let mut reaches = vec![Reach::All];
        if coverage == Coverage::All {
            reaches.push(Reach::Rings { rings: rings + 2, far_field: FarField::Coarse });
        }
        for linearization in [Tangent(Exact), Tangent(Stabilised), Springs] {
            let condensed_by: &[TangentKind] = match linearization {
                Tangent(Exact) => &[Exact],
                Tangent(Stabilised) => &[Stabilised],
                Springs => &[Exact, Stabilised],
            };
            let condensed = condensed_by.iter().flat_map(|&tangent| {
                reaches.iter().map(move |&reach| ExteriorKind::Condensed(Condensation { tangent, reach }))
            });
            let exteriors = [ExteriorKind::Fixed, ExteriorKind::Drifting].into_iter().chain(condensed);
            let extent = Extent::Rings(rings);
            models.extend(exteriors.map(|exterior| LocalSettings { extent, linearization, exterior }));
        }
    }
    models.extend([Tangent(Exact), Tangent(Stabilised), Springs].map(|linearization| LocalSettings {
        extent: Extent::All,
        linearization,
        exterior: ExteriorKind::Fixed,
    }));
    models
}

/// \[K D\] of a patch, 3m × 6m.
fn matrix_bytes(local: &LocalSettings, free: usize) -> usize {
    let m = match local.extent {
        Extent::All => free,
        Extent::Rings(rings) => free.min((2 * rings as usize + 1).saturating_pow(3)),
    };
    match local.linearization {
        Linearization::Tangent(_) => m.saturating_mul(m).saturating_mul(18 * size_of::<f64>()),
        Linearization::None => 0,
    }
}

/// One tick of a record.
#[derive(Debug, Clone, Copy)]
struct Felt {
    force: Vec3,
    normal_force: f64,
    tangential_force: f64,
    mode: Mode,
    /// n̂, in contact.
    normal: Option<Vec3>,
    /// Where the contact point lies on the surface at rest, m.
    place: Option<Vec3>,
    /// The first tick of a new model.
    handed_over: bool,
}

/// After a fault nothing is commanded.
const NOTHING: Felt = Felt {
    force: Vec3::new(0.0, 0.0, 0.0),
    normal_force: 0.0,
    tangential_force: 0.0,
    mode: Mode::Free,
    normal: None,
    place: None,
    handed_over: false,
};

/// A run as errors are taken from it: the state at the end of every tick of the scene, without force after
/// a fault.
#[derive(Debug, Clone)]
pub struct Record {
    felt: Vec<Felt>,
    tick: f64,
    /// The fault that ended it, if one did.
    pub fault: Option<String>,
    /// Residual of the energy book over the total |work|; 0 without work.
    pub energy_residual_rel: f64,
    /// What was computed.
    pub work: WorkCounts,
    /// What became of a condensed exterior.
    pub condensation: Option<CondensationCounts>,
}

impl Record {
    /// Runs a scene.
    ///
    /// # Errors
    /// If it cannot start. A fault is part of the answer.
    pub fn of(scene: &Scene) -> Result<Self, SceneError> {
        Self::every(scene, 1)
    }

    /// Runs a scene and keeps one tick of so many. The geometric scheme's force is that of a state, kept as it
    /// is at the end; the velocity scheme's is an impulse over a tick, kept as its mean.
    fn every(scene: &Scene, ticks: u32) -> Result<Self, SceneError> {
        let simulation = Simulation::prepare(scene)?;
        let rest = simulation.network().rest.clone();
        let mut record = Self {
            felt: Vec::with_capacity((scene.tick_count / u64::from(ticks)) as usize),
            tick: scene.tick * f64::from(ticks),
            fault: None,
            energy_residual_rel: 0.0,
            work: WorkCounts::default(),
            condensation: None,
        };
        let mut impulse = Vec3::zeros();
        let end = simulation.run(|view| {
            impulse += view.force;
            if (view.tick + 1) % u64::from(ticks) != 0 {
                return;
            }
            let mean = std::mem::take(&mut impulse) / f64::from(ticks);
            let force = match scene.contact.scheme {
                Scheme::Geometric { .. } => view.force,
                Scheme::Velocity => mean,
            };
            let (report, model) = (view.report, view.local.model());
            let place = report.touch.map(|touch| {
                let weights = model.geometry.weights(&model.surface, &touch.point);
                let node = |vertex: u32| model.surface.vertex_node[vertex as usize] as usize;
                weights.map(|(vertex, weight)| rest[node(vertex)] * weight).sum()
            });
            record.felt.push(Felt {
                force,
                normal_force: report.normal_force,
                tangential_force: report.tangential_force(),
                mode: report.mode,
                normal: report.touch.map(|touch| touch.normal),
                place,
                handed_over: view.tick > 0 && view.model_age == 0 && !scene.is_full,
            });
            record.energy_residual_rel = ratio(view.energy.residual(), view.energy.absolute_work);
            (record.work, record.condensation) = (view.work, view.condensation);
        });
        record.fault = end.err().map(|fault| fault.to_string());
        record.felt.resize((scene.tick_count / u64::from(ticks)) as usize, NOTHING);
        Ok(record)
    }

    /// For a figure of its forces.
    pub fn samples(&self) -> Vec<Sample> {
        let samples = self.felt.iter().enumerate().map(|(i, felt)| Sample {
            time: (i + 1) as f64 * self.tick,
            force: felt.force,
            normal_force: felt.normal_force,
            tangential_force: felt.tangential_force,
            mode: felt.mode,
        });
        samples.collect()
    }

    /// Root mean square of the force, N.
    pub fn force_rms_n(&self) -> f64 {
        mean(self.felt.iter().map(|felt| felt.force.norm_squared())).sqrt()
    }

    /// Largest change of force in the first tick of a new model, with contact before and after it, beyond that of
    /// the reference in the same tick, over the reference's force before it.
    fn handover_jump_rel(&self, reference: &Record) -> f64 {
        let touches = |felt: &Felt| felt.mode != Mode::Free;
        let jumps = self.felt.windows(2).zip(reference.felt.windows(2)).filter_map(|(own, whole)| {
            let counts = own[1].handed_over && own.iter().chain(whole).all(touches);
            let change = (own[1].force - own[0].force) - (whole[1].force - whole[0].force);
            counts.then(|| ratio(change.norm(), whole[0].force.norm()))
        });
        jumps.fold(0.0, f64::max)
    }

    /// When slip sets in, s.
    fn slip_onset(&self) -> Option<f64> {
        let window = self.window(MODE_WINDOW_S);
        let slips = |felt: &Felt| felt.mode == Mode::Slip;
        let share = |felt: &[Felt]| felt.iter().filter(|felt| slips(felt)).count() as f64 / window as f64;
        let first = self.felt.windows(window).position(|ahead| slips(&ahead[0]) && share(ahead) >= ONSET_SHARE)?;
        Some((first + 1) as f64 * self.tick)
    }

    /// Ticks in so many seconds.
    fn window(&self, seconds: f64) -> usize {
        ((seconds / self.tick).round() as usize).max(1)
    }
}

/// The whole network at the haptic rate with one contact: what methods are held against.
#[derive(Debug, Clone)]
pub struct Reference {
    /// The contact.
    pub touching: Touching,
    /// At the scene's tick.
    pub coarse: Record,
    /// At an eighth of it.
    pub fine: Record,
    /// Their disagreement, relative to the coarse one: smaller errors mean nothing.
    pub floor: f64,
}

impl Touching {
    /// In the words of scenes, with the full network.
    pub fn names(self) -> Names {
        Method {
            is_full: true,
            local: LocalSettings::FULL,
            integrator: LocalIntegrator::SemiImplicitEuler,
            global_rate: 0.0,
            touching: self,
        }
        .names()
    }
}

impl Reference {
    /// The scene of a reference at its tick.
    pub fn scene(scene: &Scene, touching: Touching) -> Scene {
        whole(scene, touching.surface, touching.scheme)
    }

    /// Runs both.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn of(scene: &Scene, touching: Touching) -> Result<Self, SceneError> {
        let coarse = Self::scene(scene, touching);
        let mut fine = coarse.clone();
        fine.tick /= f64::from(REFINEMENT);
        fine.tick_count *= u64::from(REFINEMENT);
        fine.ticks_per_cycle = fine.ticks_per_cycle.saturating_mul(REFINEMENT);
        let (coarse, fine) = (Record::of(&coarse)?, Record::every(&fine, REFINEMENT)?);
        let floor = force_error(&fine, &coarse);
        Ok(Self { touching, coarse, fine, floor })
    }
}

/// Force errors in a window of time, relative to the force of the whole drag.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WindowError {
    /// Where it begins, s.
    pub time_s: f64,
    /// Of the force,
    pub force: f64,
    /// along the contact normal,
    pub normal: f64,
    /// and across.
    pub tangential: f64,
}

/// How far a method is off, against the reference at the same tick unless it says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Errors {
    /// Root mean square of the force error over that of the reference's force.
    pub force_error_rms_rel: f64,
    /// The same against the fine reference.
    pub force_error_rms_rel_fine: f64,
    /// N.
    pub force_error_max_n: f64,
    /// The part of the error along the reference's normal,
    pub normal_error_rms_rel: f64,
    /// and across: both relative to the whole force, so that their squares add up.
    pub tangential_error_rms_rel: f64,
    /// The same in windows.
    pub force_error_per_100_ms: Vec<WindowError>,
    /// 1 − ½ Σ |difference in the share of free, sticking, sliding and slipping ticks|, mean over windows of
    /// 50 ms: under stick-slip contact, 1 − the difference in the fraction that slips.
    pub mode_agreement: f64,
    /// In the worst window.
    pub mode_agreement_worst: f64,
    /// How much later slip sets in, s; absent if it does not in both.
    pub slip_onset_error_s: Option<f64>,
    /// Root mean square of the distance between the contact points, on the surface at rest, m; absent if
    /// they never touch at the same time.
    pub contact_point_error_rms_m: Option<f64>,
    /// The largest, m.
    pub contact_point_error_max_m: Option<f64>,
    /// Largest change of force in the first tick of a new model, beyond the reference's, over its force.
    pub handover_jump_rel: f64,
    /// Residual of the energy book over the total |work|.
    pub energy_residual_rel: f64,
}

impl Errors {
    /// Of a run.
    pub fn of(record: &Record, reference: &Reference) -> Self {
        let coarse = &reference.coarse;
        let force_rms = coarse.force_rms_n();
        let parts: Vec<[f64; 3]> = record.felt.iter().zip(&coarse.felt).map(error_parts).collect();
        let relative = |part: usize, parts: &[[f64; 3]]| ratio(mean(parts.iter().map(|e| e[part])).sqrt(), force_rms);
        let window = record.window(FORCE_WINDOW_S);
        let per_window = parts.chunks(window).enumerate().map(|(i, parts)| WindowError {
            time_s: (i * window) as f64 * record.tick,
            force: relative(0, parts),
            normal: relative(1, parts),
            tangential: relative(2, parts),
        });
        let modes = record.window(MODE_WINDOW_S);
        let agreements: Vec<f64> =
            record.felt.chunks(modes).zip(coarse.felt.chunks(modes)).map(|(a, b)| mode_agreement(a, b)).collect();
        let places = record.felt.iter().zip(&coarse.felt).filter_map(|(a, b)| Some((a.place? - b.place?).norm()));
        let distances: Vec<f64> = places.collect();
        let touched = |value: f64| (!distances.is_empty()).then_some(value);
        Self {
            force_error_rms_rel: relative(0, &parts),
            force_error_rms_rel_fine: force_error(record, &reference.fine),
            force_error_max_n: parts.iter().map(|e| e[0].sqrt()).fold(0.0, f64::max),
            normal_error_rms_rel: relative(1, &parts),
            tangential_error_rms_rel: relative(2, &parts),
            force_error_per_100_ms: per_window.collect(),
            mode_agreement: mean(agreements.iter().copied()),
            mode_agreement_worst: agreements.iter().copied().fold(1.0, f64::min),
            slip_onset_error_s: record.slip_onset().zip(coarse.slip_onset()).map(|(a, b)| a - b),
            contact_point_error_rms_m: touched(mean(distances.iter().map(|d| d * d)).sqrt()),
            contact_point_error_max_m: touched(distances.iter().copied().fold(0.0, f64::max)),
            handover_jump_rel: record.handover_jump_rel(coarse),
            energy_residual_rel: record.energy_residual_rel,
        }
    }
}

/// |e|², (e·n̂)² and |e − (e·n̂)n̂|² of one tick, N².
fn error_parts((felt, reference): (&Felt, &Felt)) -> [f64; 3] {
    let error = felt.force - reference.force;
    let along = reference.normal.or(felt.normal).map_or(0.0, |normal| error.dot(&normal));
    let square = error.norm_squared();
    [square, along * along, (square - along * along).max(0.0)]
}

/// 1 − the total variation distance between the shares of modes.
fn mode_agreement(a: &[Felt], b: &[Felt]) -> f64 {
    let share = |felt: &[Felt], mode| felt.iter().filter(|felt| felt.mode == mode).count() as f64 / felt.len() as f64;
    let apart = [Mode::Free, Mode::Stick, Mode::Slide, Mode::Slip].map(|mode| (share(a, mode) - share(b, mode)).abs());
    1.0 - 0.5 * apart.iter().sum::<f64>()
}

/// Root mean square of the difference of forces over that of the reference.
fn force_error(record: &Record, reference: &Record) -> f64 {
    let square = record.felt.iter().zip(&reference.felt).map(|(a, b)| (a.force - b.force).norm_squared());
    ratio(mean(square).sqrt(), reference.force_rms_n())
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    if count > 0 { sum / count as f64 } else { 0.0 }
}

/// Nothing over nothing is nothing.
fn ratio(part: f64, whole: f64) -> f64 {
    if part == 0.0 { 0.0 } else { part / whole }
}

/// What came of a method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Its error can be told from the reference's own, and it is within the budget.
    Ok,
    /// Its error is below the disagreement of the references: better than can be measured here.
    Unresolved,
    /// A tick or a cycle takes longer than the budget allows.
    Overrun,
    /// A fault ended it, or its force is worse than none.
    Diverged,
}

impl Status {
    /// As JSON has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Unresolved => "unresolved",
            Self::Overrun => "overrun",
            Self::Diverged => "diverged",
        }
    }
}

/// A method held against its reference.
#[derive(Debug, Clone)]
pub struct Assessment {
    /// Its run.
    pub record: Record,
    /// How far it is off.
    pub errors: Errors,
    /// Whether its error is at or below the floor.
    pub is_unresolved: bool,
    /// A fault ended it, or its force is worse than none.
    pub is_diverged: bool,
}

impl Assessment {
    /// Runs the scene's drag by a method whose contact is that of the reference.
    ///
    /// # Errors
    /// If it cannot start.
    pub fn of(scene: &Scene, method: &Method, reference: &Reference) -> Result<Self, SceneError> {
        let record = Record::of(&method.scene(scene))?;
        let errors = Errors::of(&record, reference);
        let is_good = errors.force_error_rms_rel <= DIVERGED_ABOVE;
        Ok(Self {
            is_unresolved: errors.force_error_rms_rel <= reference.floor,
            is_diverged: record.fault.is_some() || !is_good,
            record,
            errors,
        })
    }

    /// What came of it.
    pub fn status(&self, within_budget: bool) -> Status {
        match (self.is_diverged, within_budget, self.is_unresolved) {
            (true, _, _) => Status::Diverged,
            (false, false, _) => Status::Overrun,
            (false, true, true) => Status::Unresolved,
            (false, true, false) => Status::Ok,
        }
    }
}

/// Which of some (cost, error) no other beats in both: the Pareto front.
///
/// ```
/// use stickslip::verify::accuracy::front;
/// assert_eq!(front(&[(1.0, 0.3), (2.0, 0.1), (3.0, 0.2), (f64::NAN, 0.0)]), [true, true, false, false]);
/// ```
pub fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
    let whole = |point: &(f64, f64)| point.0.is_finite() && point.1.is_finite();
    points.iter().map(|point| whole(point) && !points.iter().any(|other| beats(other, point))).collect()
}
