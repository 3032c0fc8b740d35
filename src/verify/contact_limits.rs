//! What contact must reach, measured for three contacts: convergence of the force with the rate, first contact, energy
//! balance, a hand at rest, creep, continuity over a finer mesh, stick-slip against its closed form, and friction that
//! pushes the tip along.

mod slider;

use serde::Serialize;
use thiserror::Error;

use super::residual::{larger, largest};
use super::surfaces::{self, refine, whole};
use crate::Vec3;
use crate::contact::law::{Friction, Law, Mode};
use crate::contact::rules::{Deformation, Scheme};
use crate::device::coupled::CoupledSettings;
use crate::device::instrument::InstrumentKind;
use crate::device::path::{PathError, TipPath, Waypoint};
use crate::local::error::ModelError;
use crate::model::network::NetworkError;
use crate::model::topology::SurfaceError;
use crate::pipeline::{self, RunError, TickView};
use crate::scene::{Scene, SceneError};
use crate::surface::geometry::ContactSurface;
use crate::surface::support::{Metric, Support};

/// Contacts that are compared: the paper's, the velocity scheme, and the recommended one.
pub const CONTACTS: [(&str, ContactSurface, Scheme); 3] = [
    (
        "geometric, faceted",
        ContactSurface::Faceted,
        Scheme::Geometric { deformation: Deformation::Rigid, metric: Metric::Euclidean },
    ),
    ("velocity, subdivision", ContactSurface::Subdivision, Scheme::Velocity),
    ("massless, subdivision", ContactSurface::Subdivision, Scheme::Massless),
];

/// How long the studies are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// Rates up to 16 kHz, a hand at rest for ten seconds, sixty seconds of creep.
    Whole,
    /// For tests: rates up to 4 kHz, a hand at rest for three seconds, three of creep.
    Short,
}

/// A quantity with its limit.
#[derive(Debug, Clone, Serialize)]
pub struct LimitRow {
    /// What is measured.
    pub quantity: String,
    /// Unit of limit and values; empty for a count or a ratio.
    pub unit: &'static str,
    /// The limit.
    pub limit: f64,
    /// Whether the limit is the least value allowed, not the largest.
    pub is_least: bool,
    /// Value of each of [`CONTACTS`]; `None` where it is not finite or the run ended with a fault.
    pub values: Vec<Option<f64>>,
}

impl LimitRow {
    /// Whether the values are counts of ticks.
    pub fn is_count(&self) -> bool {
        self.unit.is_empty() && self.limit == 0.0
    }

    /// Whether one of [`CONTACTS`], by its index, is within the limit.
    pub fn holds(&self, contact: usize) -> bool {
        self.values[contact].is_some_and(|value| if self.is_least { value >= self.limit } else { value <= self.limit })
    }
}

/// A quantity as one contact has it.
struct Measured {
    quantity: String,
    unit: &'static str,
    limit: f64,
    is_least: bool,
    value: f64,
}

impl Measured {
    fn at_most(quantity: impl Into<String>, unit: &'static str, limit: f64, value: f64) -> Self {
        Self { quantity: quantity.into(), unit, limit, is_least: false, value }
    }
}

/// Every quantity of one contact, in the order of the table.
pub struct Column(Vec<Measured>);

/// Measures every quantity for one of [`CONTACTS`], by its index.
///
/// # Errors
/// If a scene cannot start. A fault makes a value absent.
pub fn measure(contact: usize, length: Length) -> Result<Column, LimitError> {
    let (_, surface, scheme) = CONTACTS[contact];
    let mut measured = Vec::new();
    for drag in ["fig3-sliding", "fig5-stick-slip"] {
        measured.extend(over_rates(drag, surface, scheme, length)?);
    }
    measured.extend(held_still(surface, scheme, length)?);
    measured.extend(creep(surface, scheme, length)?);
    measured.extend(over_finer_mesh(surface, scheme, length)?);
    measured.extend(slider::spring_slider(scheme)?);
    Ok(Column(measured))
}

/// Puts the columns of all [`CONTACTS`] beside one another.
pub fn table(columns: &[Column]) -> Vec<LimitRow> {
    let mut rows: Vec<LimitRow> =
        columns.first().map_or_else(Vec::new, |first| first.0.iter().map(LimitRow::from).collect());
    for Column(measured) in columns {
        for (row, Measured { value, .. }) in rows.iter_mut().zip(measured) {
            row.values.push(value.is_finite().then_some(*value));
        }
    }
    rows
}

impl From<&Measured> for LimitRow {
    fn from(measured: &Measured) -> Self {
        let Measured { quantity, unit, limit, is_least, .. } = measured;
        Self { quantity: quantity.clone(), unit, limit: *limit, is_least: *is_least, values: Vec::new() }
    }
}

/// Why a study cannot start.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LimitError {
    /// A drag is not among the shipped scenes.
    #[error("there is no shipped scene {0}")]
    NotShipped(&'static str),
    /// A scene cannot start.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A scene is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The hand's aim is invalid.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The slider's network is invalid.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The slider has no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The slider's local model cannot be built.
    #[error(transparent)]
    Model(#[from] ModelError),
}

fn shipped(name: &'static str) -> Result<Scene, LimitError> {
    Scene::shipped(name).ok_or(LimitError::NotShipped(name))
}

/// Runs a scene, and returns whether it completed.
fn completes(scene: &Scene, observe: impl FnMut(&TickView)) -> Result<bool, RunError> {
    match pipeline::run(scene, observe) {
        Ok(()) => Ok(true),
        Err(RunError::Fault(_)) => Ok(false),
        Err(error) => Err(error),
    }
}

/// Force over one run of the whole network, and its largest change apart from that of the dampers.
struct ForceRecord {
    /// Force at the end of every millisecond from the first contact on, N.
    each_ms: Vec<Vec3>,
    peak: f64,
    /// Largest change within a tick, N, less the dampers' response to the change of the tip's velocity.
    change: f64,
    energy_residual: f64,
    assist_ticks: f64,
    completed: bool,
}

fn record(scene: &Scene) -> Result<ForceRecord, RunError> {
    let ticks_per_ms = (1e-3 / scene.tick_s()).round() as u64;
    let mut record = ForceRecord {
        each_ms: Vec::new(),
        peak: 0.0,
        change: 0.0,
        energy_residual: f64::NAN,
        assist_ticks: 0.0,
        completed: false,
    };
    let (mut last, mut speed, mut begun) = (Vec3::zeros(), None::<Vec3>, false);
    let follows_normal = scene.contact.law == Law::Sliding;
    record.completed = completes(scene, |view| {
        let velocity = (view.tip - view.tip_before) / scene.tick_s();
        begun |= view.report.mode != Mode::Free;
        if begun && (view.tick + 1) % ticks_per_ms == 0 {
            record.each_ms.push(view.force);
        }
        record.peak = larger(record.peak, view.force.norm());
        let change = (view.force - last).norm();
        // A tip that meets the surface takes its contact point from rest to its own velocity.
        let jump = match (speed, view.report.collision_time) {
            (_, Some(_)) => velocity,
            (Some(before), None) => velocity - before,
            (None, None) => Vec3::zeros(),
        };
        let damped = if jump.norm() > 0.0 { damper_force(view, jump, follows_normal) } else { 0.0 };
        record.change = larger(record.change, change - damped);
        (last, speed) = (view.force, Some(velocity));
        record.energy_residual = view.energy.residual() / view.energy.absolute_work;
        record.assist_ticks = view.energy.friction_assist_ticks as f64;
    })?;
    Ok(record)
}

/// Force that the dampers add at the contact point if its velocity changes by `jump`, m/s.
fn damper_force(view: &TickView, jump: Vec3, follows_normal: bool) -> f64 {
    let (Some(touch), local) = (view.report.touch, view.local) else { return 0.0 };
    let mut support = Support::with_capacity(local.surface().geometry.largest_support());
    local.shape().touch(Metric::Mass, &touch.point, &mut support);
    let jump = if follows_normal { touch.normal * touch.normal.dot(&jump) } else { jump };
    let mut state = local.state().clone();
    let reaction = |state: &mut _| {
        local.model().evaluate_forces(local.elapsed(), state);
        support.reaction(&state.f)
    };
    let before = reaction(&mut state);
    support.push(jump / support.scale(), &mut state.v);
    let change = reaction(&mut state) - before;
    if follows_normal { touch.normal.dot(&change).abs() } else { change.norm() }
}

/// Press and drag of the whole network at rates that double: convergence of the force, its changes, energy balance.
fn over_rates(
    drag: &'static str,
    surface: ContactSurface,
    scheme: Scheme,
    length: Length,
) -> Result<Vec<Measured>, LimitError> {
    let factors: &[u32] = match length {
        Length::Whole => &[1, 2, 4, 8, 16],
        Length::Short => &[1, 2, 4],
    };
    let base = whole(&shipped(drag)?, surface, scheme);
    let mut records = Vec::with_capacity(factors.len());
    for &factor in factors {
        let rate_hz = base.local_rate_hz() * f64::from(factor);
        let scene = base.clone().with_local_rate_hz(rate_hz)?;
        records.push(record(&scene)?);
    }
    let peak = records.last().map_or(f64::NAN, |finest| finest.peak);
    let all_completed = records.iter().all(|record| record.completed);
    let valid = |value: f64| if all_completed { value } else { f64::NAN };
    let differences: Vec<f64> = records
        .windows(2)
        .map(|pair| {
            let both = pair[0].each_ms.iter().rev().zip(pair[1].each_ms.iter().rev());
            largest(both.map(|(coarse, fine)| (coarse - fine).norm() / peak))
        })
        .collect();
    let furthest = largest(differences.iter().copied());
    let order = (differences[0] / differences[differences.len() - 1]).log2() / (differences.len() - 1) as f64;
    let of = |index: usize| &records[index];
    let fine = factors.iter().position(|&factor| factor == 8).unwrap_or(factors.len() - 1);
    let highest_khz = factors[factors.len() - 1];
    let balance = |index: usize| of(index).energy_residual.abs();
    Ok(vec![
        Measured::at_most(
            format!("{drag}: largest difference of the force over the peak, rates doubled from 1 to {highest_khz} kHz"),
            "%",
            3.0,
            valid(100.0 * furthest),
        ),
        Measured {
            is_least: true,
            ..Measured::at_most(format!("{drag}: observed order of convergence"), "", 0.9, valid(order))
        },
        Measured::at_most(
            format!("{drag}: largest change within a tick, less the dampers' part, at 1 kHz, over the peak"),
            "%",
            2.0,
            valid(100.0 * of(0).change / peak),
        ),
        Measured::at_most(
            format!("{drag}: the same at {} kHz", factors[fine]),
            "%",
            2.0,
            valid(100.0 * of(fine).change / peak),
        ),
        Measured::at_most(format!("{drag}: energy residual over the work, 1 kHz"), "%", 1.0, valid(100.0 * balance(0))),
        Measured::at_most(
            format!("{drag}: the same at 4 kHz over that at 1 kHz"),
            "",
            0.5,
            valid(balance(2) / balance(0)),
        ),
        Measured::at_most(
            format!("{drag}: ticks in which friction pushes the tip along"),
            "",
            0.0,
            valid(of(0).assist_ticks),
        ),
    ])
}

/// The modelled hand presses the block through the PHANTOM and aims aside, so that the contact bears a tangential force.
///
/// ```
/// use stickslip::{contact::rules::Scheme, surface::geometry::ContactSurface, verify::contact_limits::by_hand};
///
/// let scene = by_hand(ContactSurface::Subdivision, Scheme::Massless, 1000.0, 0.005, 10.0)?;
/// assert_eq!(scene.tick_count(), 10_000);
/// # Ok::<(), stickslip::verify::contact_limits::LimitError>(())
/// ```
///
/// # Errors
/// If the duration is no whole number of ticks.
pub fn by_hand(
    surface: ContactSurface,
    scheme: Scheme,
    rate_hz: f64,
    aside_m: f64,
    duration_s: f64,
) -> Result<Scene, LimitError> {
    let settings = CoupledSettings::default();
    let at = |time, x, z| Waypoint { time, position: Vec3::new(x, 0.0013, z) };
    let aim = vec![at(0.0, -0.005, 0.002), at(0.4, -0.005, -0.01), at(0.8, -0.005 + aside_m, -0.01)];
    let path = TipPath::new(aim)?;
    let scene = shipped("fig5-stick-slip")?.with_surface(surface).with_scheme(scheme).with_law(FIRM);
    let scene = scene.with_instrument(InstrumentKind::Phantom(Box::new(settings)), path);
    Ok(scene.with_local_rate_hz(rate_hz)?.with_duration_s(duration_s)?)
}

/// Friction of the contacts under the hand: firm enough to stick.
const FIRM: Law = Law::StickSlip { friction: Friction::single(0.5) };
/// Distance by which the hand aims aside, m: the contact then bears 0.3 N along the surface and 0.7 N along the normal.
const ASIDE_M: f64 = 0.0036;
/// Distance by which the hand aims aside in the study of creep, m: the contact then bears 0.33 N along the surface, and can
/// bear 0.35 N.
const ASIDE_TO_CREEP_M: f64 = 0.0054;
/// Time after which the hand's approach has decayed, s.
const SETTLED_S: f64 = 2.0;

/// The hand holds the device still: peak to peak of the commanded force, and the net energy that the hand receives.
fn held_still(surface: ContactSurface, scheme: Scheme, length: Length) -> Result<Vec<Measured>, LimitError> {
    let duration_s = match length {
        Length::Whole => 12.0,
        Length::Short => 5.0,
    };
    let mut measured = Vec::new();
    for rate_hz in [1000.0, 4000.0, 10_000.0] {
        let scene = by_hand(surface, scheme, rate_hz, ASIDE_M, duration_s)?;
        let (mut least, mut most) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        let (mut start_j, mut largest_j) = (None, 0.0_f64);
        let completed = completes(&scene, |view| {
            let (Some(device), true) = (view.device, view.time > SETTLED_S) else { return };
            (least, most) = (least.inf(&view.force), most.sup(&view.force));
            let start = *start_j.get_or_insert(device.energy_to_hand_j);
            largest_j = larger(largest_j, device.energy_to_hand_j - start);
        })?;
        let valid = |value: f64| if completed { value } else { f64::NAN };
        let khz = rate_hz * 1e-3;
        measured.push(Measured::at_most(
            format!("held still at {khz} kHz: peak to peak of the force"),
            "N",
            0.06,
            valid((most - least).amax()),
        ));
        measured.push(Measured::at_most(
            format!("held still at {khz} kHz: energy to the hand"),
            "mJ",
            0.1,
            valid(1e3 * largest_j),
        ));
    }
    Ok(measured)
}

/// The hand pulls with nine tenths of the largest static friction: ticks in which the contact slips.
fn creep(surface: ContactSurface, scheme: Scheme, length: Length) -> Result<Vec<Measured>, LimitError> {
    let duration_s = match length {
        Length::Whole => 62.0,
        Length::Short => 5.0,
    };
    let mut measured = Vec::new();
    for rate_hz in [1000.0, 10_000.0] {
        let scene = by_hand(surface, scheme, rate_hz, ASIDE_TO_CREEP_M, duration_s)?;
        let mut slips = 0_u64;
        let completed = completes(&scene, |view| {
            if view.time > SETTLED_S {
                slips += u64::from(view.report.mode == Mode::Slip);
            }
        })?;
        let khz = rate_hz * 1e-3;
        let name = format!("creep at {khz} kHz under nine tenths of the static friction: slipping ticks");
        measured.push(Measured::at_most(name, "", 0.0, if completed { slips as f64 } else { f64::NAN }));
    }
    Ok(measured)
}

/// Radius of contact over the finer mesh, m: two of its edges.
const RADIUS_M: f64 = 0.012;

/// Drags of the whole network on a mesh that is twice as fine, with contact over a disc: the largest force jump once the
/// press has ended.
fn over_finer_mesh(surface: ContactSurface, scheme: Scheme, length: Length) -> Result<Vec<Measured>, LimitError> {
    let ticks = match length {
        Length::Whole => 700,
        Length::Short => 400,
    };
    let mut measured = Vec::new();
    for (drag, limit) in [("fig3-sliding", 1.0), ("fig5-stick-slip", 3.0)] {
        let mut scene = whole(&shipped(drag)?, surface, scheme).with_contact_radius(RADIUS_M).with_ticks(ticks);
        refine(&mut scene, 2);
        let measures = surfaces::measure(&scene, |_| {})?;
        let percent = if measures.fault.is_none() { 100.0 * measures.jump_relative } else { f64::NAN };
        let name =
            format!("{drag}: largest force jump over the mean, mesh twice as fine, radius {} mm", 1e3 * RADIUS_M);
        measured.push(Measured::at_most(name, "%", limit, percent));
    }
    Ok(measured)
}
