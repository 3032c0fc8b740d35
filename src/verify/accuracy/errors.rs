//! Errors of a method, and its status.

use serde::Serialize;

use super::method::Method;
use super::record::{MODE_WINDOW_S, Record, Reference, RenderedTick, force_error, mean, ratio};
use crate::contact::law::Mode;
use crate::scene::{Scene, SceneError};
use crate::verify::residual::largest;

/// Relative difference below which a hand cannot tell two forces apart.
pub const PERCEPTION: f64 = 0.1;
/// Relative error above which a method counts as diverged: commanding no force at all has the error 1.
const DIVERGED_ABOVE: f64 = 1.0;
/// Length of the windows for which force errors are given, s.
const FORCE_WINDOW_S: f64 = 0.1;

/// Force errors in a window of time, relative to the force of the whole drag.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WindowError {
    /// Begin of the window, s.
    pub time_s: f64,
    /// Error of the force.
    pub force: f64,
    /// Error along the contact normal.
    pub normal: f64,
    /// Error across the contact normal.
    pub tangential: f64,
}

/// Errors of a method against the reference at the same tick, unless stated otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Errors {
    /// Root mean square of the force error over that of the reference's force.
    pub force_error_rms_rel: f64,
    /// Root mean square of the force error against the fine reference, over that of its force.
    pub force_error_rms_rel_fine: f64,
    /// Largest force error, N.
    pub force_error_max_n: f64,
    /// Part of the error along the reference's normal, relative to the whole force.
    pub normal_error_rms_rel: f64,
    /// Part across the normal, relative to the whole force; the squares of both parts add up to that of the error.
    pub tangential_error_rms_rel: f64,
    /// Force errors in windows of 100 ms.
    pub force_error_per_100_ms: Vec<WindowError>,
    /// 1 − ½ Σ |difference in the share of free, sticking, sliding and slipping ticks|, mean over windows of
    /// 50 ms: under stick-slip contact, 1 − the difference in the fraction that slips.
    pub mode_agreement: f64,
    /// Mode agreement in the worst window.
    pub mode_agreement_worst: f64,
    /// Delay of the onset of slip, s; absent if slip does not set in in both runs.
    pub slip_onset_error_s: Option<f64>,
    /// Root mean square of the distance between the contact points, on the surface at rest, m; absent if
    /// they never touch at the same time.
    pub contact_point_error_rms_m: Option<f64>,
    /// Largest distance between the contact points, on the surface at rest, m.
    pub contact_point_error_max_m: Option<f64>,
    /// Largest change of force in the first tick of a new model, beyond the reference's, over its force.
    pub handover_jump_rel: f64,
    /// Residual of the energy balance over the total |work|.
    pub energy_residual_rel: f64,
}

impl Errors {
    /// Computes the errors of a run.
    pub fn of(record: &Record, reference: &Reference) -> Self {
        let coarse = &reference.coarse;
        let force_rms = coarse.force_rms_n();
        let parts: Vec<[f64; 3]> = record.rendered.iter().zip(&coarse.rendered).map(error_parts).collect();
        let relative = |part: usize, parts: &[[f64; 3]]| ratio(mean(parts.iter().map(|e| e[part])).sqrt(), force_rms);
        let window = record.window(FORCE_WINDOW_S);
        let per_window = parts.chunks(window).enumerate().map(|(i, parts)| WindowError {
            time_s: (i * window) as f64 * record.tick,
            force: relative(0, parts),
            normal: relative(1, parts),
            tangential: relative(2, parts),
        });
        let modes = record.window(MODE_WINDOW_S);
        let agreements: Vec<f64> = record
            .rendered
            .chunks(modes)
            .zip(coarse.rendered.chunks(modes))
            .map(|(a, b)| mode_agreement(a, b))
            .collect();
        let places =
            record.rendered.iter().zip(&coarse.rendered).filter_map(|(a, b)| Some((a.place? - b.place?).norm()));
        let distances: Vec<f64> = places.collect();
        let touched = |value: f64| (!distances.is_empty()).then_some(value);
        Self {
            force_error_rms_rel: relative(0, &parts),
            force_error_rms_rel_fine: force_error(record, &reference.fine),
            force_error_max_n: largest(parts.iter().map(|e| e[0].sqrt())),
            normal_error_rms_rel: relative(1, &parts),
            tangential_error_rms_rel: relative(2, &parts),
            force_error_per_100_ms: per_window.collect(),
            mode_agreement: mean(agreements.iter().copied()),
            mode_agreement_worst: agreements.iter().copied().fold(1.0, f64::min),
            slip_onset_error_s: record.slip_onset().zip(coarse.slip_onset()).map(|(a, b)| a - b),
            contact_point_error_rms_m: touched(mean(distances.iter().map(|d| d * d)).sqrt()),
            contact_point_error_max_m: touched(largest(distances.iter().copied())),
            handover_jump_rel: record.handover_jump_rel(coarse),
            energy_residual_rel: record.energy_residual_rel,
        }
    }
}

/// Returns |e|², (e·n̂)² and |e − (e·n̂)n̂|² of one tick, N².
fn error_parts((rendered, reference): (&RenderedTick, &RenderedTick)) -> [f64; 3] {
    let error = rendered.force - reference.force;
    let along = reference.normal.or(rendered.normal).map_or(0.0, |normal| error.dot(&normal));
    let square = error.norm_squared();
    [square, along * along, (square - along * along).max(0.0)]
}

/// Returns 1 − the total variation distance between the shares of modes.
fn mode_agreement(a: &[RenderedTick], b: &[RenderedTick]) -> f64 {
    let share = |rendered: &[RenderedTick], mode| {
        rendered.iter().filter(|rendered| rendered.mode == mode).count() as f64 / rendered.len() as f64
    };
    let apart = [Mode::Free, Mode::Stick, Mode::Slide, Mode::Slip].map(|mode| (share(a, mode) - share(b, mode)).abs());
    1.0 - 0.5 * apart.iter().sum::<f64>()
}

/// Status of a method.
///
/// ```
/// use stickslip::verify::accuracy::Status;
///
/// let written = serde_json::to_value([Status::Ok, Status::Unresolved, Status::Overrun, Status::Diverged])?;
/// assert_eq!(written, serde_json::json!(["ok", "unresolved", "overrun", "diverged"]));
/// assert_eq!(written[1], Status::Unresolved.name());
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// The error exceeds the disagreement of the references, and the method is within the budget.
    Ok,
    /// The error is at or below the disagreement of the references and cannot be resolved.
    Unresolved,
    /// A tick or a cycle takes longer than the budget allows.
    Overrun,
    /// A fault ended the run, or the force is worse than none.
    Diverged,
}

impl Status {
    /// Returns the name as it is written in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Unresolved => "unresolved",
            Self::Overrun => "overrun",
            Self::Diverged => "diverged",
        }
    }
}

/// Comparison of a method with its reference.
#[derive(Debug, Clone)]
pub struct Assessment {
    /// Run of the method.
    pub record: Record,
    /// Errors of the method.
    pub errors: Errors,
    /// Whether the error is at or below the floor.
    pub is_unresolved: bool,
    /// Whether a fault ended the run, or its force is worse than none.
    pub is_diverged: bool,
}

impl Assessment {
    /// Runs the scene's drag by a method with the reference's contact, and computes its errors.
    ///
    /// # Errors
    /// If the method cannot start.
    pub fn of(scene: &Scene, method: &Method, reference: &Reference) -> Result<Self, SceneError> {
        Ok(Self::of_record(Record::of(&method.scene(scene))?, reference))
    }

    /// Computes the errors of a record.
    pub fn of_record(record: Record, reference: &Reference) -> Self {
        let errors = Errors::of(&record, reference);
        let is_good = errors.force_error_rms_rel <= DIVERGED_ABOVE;
        Self {
            is_unresolved: errors.force_error_rms_rel <= reference.floor,
            is_diverged: record.fault.is_some() || !is_good,
            record,
            errors,
        }
    }

    /// Returns the status of the method.
    pub fn status(&self, within_budget: bool) -> Status {
        match (self.is_diverged, within_budget, self.is_unresolved) {
            (true, _, _) => Status::Diverged,
            (false, false, _) => Status::Overrun,
            (false, true, true) => Status::Unresolved,
            (false, true, false) => Status::Ok,
        }
    }
}

/// Marks the Pareto front of some (cost, error): the points that no other beats in both.
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
