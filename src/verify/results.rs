//! Results of a run that a baseline keeps: statistics of the trace, a thinned trace, the summary, counts of work.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::value::RawValue;

use crate::multirate::failsafe::{Fault, FaultCause};
use crate::output::summary::{Recorder, Summary};
use crate::pipeline::{Simulation, TickView};
use crate::scene::{Scene, SceneError};

/// Interval of the ticks that are kept.
pub const KEEP_EVERY: u64 = 20;

/// Quantities of a trace that are kept and compared, in the order of [`KeptTick::values`].
pub const QUANTITIES: [&str; 12] = [
    "fx",
    "fy",
    "fz",
    "fn",
    "ft",
    "kinetic",
    "elastic",
    "gravitational",
    "work",
    "damping_loss",
    "friction_loss",
    "model_age",
];

/// Number of leading [`QUANTITIES`] that are components of the force.
pub const FORCES: usize = 5;

/// A number that JSON writes as `null` where it is not finite.
///
/// ```
/// use stickslip::verify::results::Number;
///
/// let written = serde_json::to_string(&[Number(0.1), Number(f64::NAN)])?;
/// assert_eq!(written, "[0.1,null]");
/// let read: Vec<Number> = serde_json::from_str(&written)?;
/// assert!(read[0] == Number(0.1) && read[1].0.is_nan());
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number(pub f64);

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(self.0)
    }
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Option::<f64>::deserialize(deserializer).map(|value| Self(value.unwrap_or(f64::NAN)))
    }
}

/// Statistics of one quantity over a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Smallest value.
    pub min: Number,
    /// Largest value.
    pub max: Number,
    /// Mean value.
    pub mean: Number,
    /// Root mean square.
    pub rms: Number,
}

impl Statistics {
    /// Computes the statistics of some values; NaN if one of the values is.
    fn of(values: impl Iterator<Item = f64> + Clone) -> Self {
        let n = values.clone().count() as f64;
        // f64::min and max skip NaN; the sums do not.
        let sum: f64 = values.clone().sum();
        let square: f64 = values.clone().map(|value| value * value).sum();
        let extreme = |pick: fn(f64, f64) -> f64| {
            let found = values.clone().reduce(pick).unwrap_or(f64::NAN);
            Number(if sum.is_nan() { f64::NAN } else { found })
        };
        Self { min: extreme(f64::min), max: extreme(f64::max), mean: Number(sum / n), rms: Number((square / n).sqrt()) }
    }

    /// Returns each statistic with its name.
    pub fn named(&self) -> [(&'static str, f64); 4] {
        [("min", self.min.0), ("max", self.max.0), ("mean", self.mean.0), ("rms", self.rms.0)]
    }
}

/// One tick of the thinned trace.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeptTick {
    /// Number of the tick, counted from 0.
    pub tick: u64,
    /// Contact mode.
    pub mode: String,
    /// Triangle in contact; none when free.
    pub triangle: Option<u32>,
    /// Values of [`QUANTITIES`], to the last bit.
    pub values: Vec<Number>,
}

/// Results of a run.
///
/// ```
/// use stickslip::{scene::Scene, verify::results::Results};
///
/// // the tip comes down at 25 mm/s from 2 mm
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let mut results = Results::of(&scene, |_| ())?;
/// assert_eq!((results.counts["free_ticks"], results.counts["collisions"]), (80, 1));
/// assert_eq!(results.counts["free_ticks"] + results.counts["slide_ticks"], 150);
/// assert_eq!(results.not_finite(), None);
/// let normal_force = &results.statistics["fn"];
/// assert_eq!(normal_force.named()[0], ("min", 0.0));
/// assert!(normal_force.mean.0 <= normal_force.rms.0 && normal_force.rms.0 <= normal_force.max.0);
/// results.trace[3].values[0].0 = f64::NAN;
/// assert_eq!(results.not_finite(), Some(("fx".to_owned(), Some(60)))); // every 20th tick is kept
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Results {
    /// Tick of the fault that ended the run, if one did.
    pub fault_tick: Option<u64>,
    /// Cause of the fault.
    pub fault: Option<String>,
    /// Integers of the summary, among them the ticks per mode.
    pub counts: BTreeMap<String, u64>,
    /// Counts of computed work.
    pub work: BTreeMap<String, u64>,
    /// Real numbers of the summary.
    pub summary: BTreeMap<String, Number>,
    /// Statistics of each quantity.
    pub statistics: BTreeMap<String, Statistics>,
    /// Names of the values in a tick of the trace.
    pub quantities: Vec<String>,
    /// The first of every [`KEEP_EVERY`] ticks, and the last.
    #[serde(serialize_with = "line_by_line")]
    pub trace: Vec<KeptTick>,
}

/// Writes one tick a line, even where the surrounding JSON is indented.
fn line_by_line<S: Serializer>(trace: &[KeptTick], serializer: S) -> Result<S::Ok, S::Error> {
    let line = |tick| serde_json::to_string(tick).and_then(RawValue::from_string);
    let lines: Vec<_> = trace.iter().map(line).collect::<Result<_, _>>().map_err(serde::ser::Error::custom)?;
    lines.serialize(serializer)
}

impl Results {
    /// Runs a scene and keeps its results. A fault is a result like any other. `progress` is called with the number of
    /// ticks done.
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn of(scene: &Scene, mut progress: impl FnMut(u64)) -> Result<Self, SceneError> {
        let simulation = Simulation::prepare(scene)?;
        let mut recorder = Recorder::default();
        let mut columns = vec![Vec::with_capacity(scene.tick_count() as usize); QUANTITIES.len()];
        let mut trace = Vec::new();
        let mut last = None;
        let fault = simulation
            .run(|view| {
                recorder.record(view);
                let values = values(view);
                columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
                let kept = KeptTick {
                    tick: view.tick,
                    mode: view.report.mode.name().to_owned(),
                    triangle: view.report.touch.map(|touch| touch.point.triangle),
                    values: values.map(Number).to_vec(),
                };
                if view.tick.is_multiple_of(KEEP_EVERY) {
                    trace.push(kept);
                    last = None;
                } else {
                    last = Some(kept);
                }
                progress(view.tick + 1);
            })
            .err();
        trace.extend(last);
        let summary = recorder.summary(scene, fault.as_ref(), 0.0);
        let statistics = QUANTITIES.iter().zip(&columns);
        Ok(Self {
            fault_tick: fault.map(|fault| fault.tick),
            fault: fault.map(|fault| cause(&fault).to_owned()),
            counts: counts(&summary),
            work: summary.work.named().map(|(name, count)| (name.to_owned(), count)).into(),
            summary: numbers(&summary),
            statistics: statistics
                .map(|(name, column)| ((*name).to_owned(), Statistics::of(column.iter().copied())))
                .collect(),
            quantities: QUANTITIES.map(str::to_owned).to_vec(),
            trace,
        })
    }

    /// Returns the name of the first value that is not finite, with its tick if it belongs to the trace.
    pub fn not_finite(&self) -> Option<(String, Option<u64>)> {
        for tick in &self.trace {
            if let Some(i) = tick.values.iter().position(|value| !value.0.is_finite()) {
                return Some((self.quantities.get(i).cloned().unwrap_or_default(), Some(tick.tick)));
            }
        }
        let statistics = self.statistics.iter().flat_map(|(name, statistics)| {
            statistics.named().map(|(statistic, value)| (format!("{name} {statistic}"), value))
        });
        let summary = self.summary.iter().map(|(name, value)| (name.clone(), value.0));
        statistics.chain(summary).find(|(_, value)| !value.is_finite()).map(|(name, _)| (name, None))
    }
}

fn values(view: &TickView) -> [f64; QUANTITIES.len()] {
    let energy = view.energy;
    [
        view.force.x,
        view.force.y,
        view.force.z,
        view.report.normal_force,
        view.report.tangential_force(),
        energy.kinetic,
        energy.elastic,
        energy.gravitational,
        energy.work,
        energy.damping_loss,
        energy.friction_loss,
        view.model_age as f64,
    ]
}

/// Returns the kind of a fault. Its numbers describe a diverged state and are less informative than its tick.
fn cause(fault: &Fault) -> &'static str {
    match fault.cause {
        FaultCause::ForceNotFinite => "the contact force is not finite",
        FaultCause::ForceTooLarge { .. } => "the contact force exceeds its limit",
        FaultCause::StateNotFinite { .. } => "the state is not finite",
        FaultCause::EnergyNotFinite => "the energy balance is not finite",
        FaultCause::NoModel(_) => "no local model could be built",
        FaultCause::Renderer(_) => "the renderer failed",
        FaultCause::Instrument(_) | FaultCause::Device(_) => {
            "the instrument left the range in which it can be simulated"
        }
        FaultCause::Runaway { .. } => "diverged",
        FaultCause::PatchFolded { .. } => "the patch folded over the tip",
    }
}

fn counts(summary: &Summary) -> BTreeMap<String, u64> {
    let modes = summary.mode_ticks;
    let counts = [
        ("ticks", summary.ticks),
        ("free_ticks", modes.free),
        ("stick_ticks", modes.stick),
        ("slide_ticks", modes.slide),
        ("slip_ticks", modes.slip),
        ("collisions", summary.collisions),
        ("contact_losses", summary.contact_losses),
        ("releases", summary.releases),
        ("tension_ticks", summary.tension_ticks),
        ("patch_exits", summary.patch_exits),
        ("tunnelling_ticks", summary.tunnelling_ticks),
    ];
    counts.map(|(name, count)| (name.to_owned(), count)).into()
}

fn numbers(summary: &Summary) -> BTreeMap<String, Number> {
    let energy = summary.energy;
    let numbers = [
        ("largest_force_n", summary.largest_force_n),
        ("largest_normal_force_n", summary.largest_normal_force_n),
        ("largest_tangential_force_n", summary.largest_tangential_force_n),
        ("largest_force_jump_n", summary.largest_force_jump_n),
        ("mode_switches_per_s", summary.mode_switches_per_s),
        ("force_power_above_100_hz_n2", summary.force_power_above_100_hz_n2),
        ("absolute_work_j", energy.absolute_work_j),
        ("stored_j", energy.stored_j),
        ("energy_residual_j", energy.residual_j),
    ];
    numbers.map(|(name, value)| (name.to_owned(), Number(value))).into()
}
