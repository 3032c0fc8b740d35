//! Force traces of other programs, judged by the measures of the accuracy of local models: each is compared with the whole
//! network at the haptic rate along the same path of the tip.

mod finding;
mod trace;

use miette::Diagnostic;
use serde::Serialize;
use thiserror::Error;

pub use finding::Finding;
pub use trace::{ForceTrace, TraceError, TraceFormat};

use self::finding::{Compared, findings};
use super::accuracy::{Errors, Method, PERCEPTION, Record, Reference, WindowError};
use crate::contact::law::Mode;
use crate::device::instrument::InstrumentKind;
use crate::output::summary::Sample;
use crate::output::verdict::Verdict;
use crate::scene::{Scene, SceneError};

/// Ticks at the begin or the end that a trace may lack and still cover the scene: programs that give a tick's force the time
/// of its begin lack the last one.
const MARGIN_TICKS: usize = 1;
/// Share of the compared ticks that may lie in gaps of the trace: what is interpolated over more decides nothing.
const MOST_IN_GAPS: f64 = 0.01;

/// Judgement on a force trace, the content of `judge.json`.
///
/// ```
/// use stickslip::{output::{files::write_csv, verdict::Verdict}, scene::Scene};
/// use stickslip::verify::judge::{ForceTrace, Judgement, TraceFormat, reference};
///
/// // The reference is as good as itself.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let reference = reference(&scene, |_| ())?;
/// let folder = tempfile::tempdir()?;
/// let file = folder.path().join("mine.csv");
/// write_csv(&file, reference.coarse.rows())?;
/// let own = Judgement::of(&ForceTrace::read(&file, &TraceFormat::default())?, &scene, &reference)?;
/// assert_eq!((own.verdict, own.force_error_rms_rel, own.below_floor), (Verdict::Pass, 0.0, true));
/// assert!(own.findings.is_empty());
///
/// // The same force on the body, and a tick late.
/// let format = TraceFormat { scale: -1.0, time_offset_s: scene.tick_s(), ..TraceFormat::default() };
/// let off = Judgement::of(&ForceTrace::read(&file, &format)?, &scene, &reference)?;
/// assert_eq!((off.verdict, off.lag_ticks), (Verdict::Fail, 1));
/// assert!((off.best_scale + 1.0).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Serialize)]
pub struct Judgement {
    /// Name of the scene.
    pub scene: String,
    /// Version of the program.
    pub version: &'static str,
    /// PASS: the force error is at most [`PERCEPTION`] over the whole scene; FAIL: it is above; INCONCLUSIVE: the trace
    /// does not cover the scene or its contact, or there is no valid reference.
    pub verdict: Verdict,
    /// The verdict's reason as a sentence, with its figures.
    pub sentence: String,
    /// What does not fit between trace and scene; empty if all does.
    pub findings: Vec<Finding>,
    /// Number of ticks of the scene.
    pub scene_ticks: usize,
    /// Number of ticks compared.
    pub compared_ticks: usize,
    /// Times of the first and the last tick compared, s.
    pub compared_s: [f64; 2],
    /// Number of ticks of the scene in which the reference has contact.
    pub scene_contact_ticks: usize,
    /// Number of these that were compared.
    pub compared_contact_ticks: usize,
    /// Contact of the tip with the mesh in the reference.
    pub contact: String,
    /// Difference of the references with ticks of h and h/8 over the compared ticks, relative to the force: smaller errors
    /// have no meaning.
    pub floor_rms_rel: f64,
    /// Whether the error is at or below the floor.
    pub below_floor: bool,
    /// Root mean square of the reference's force over the compared ticks, N.
    pub force_rms_n: f64,
    /// Root mean square of the force error over that of the reference's force.
    pub force_error_rms_rel: f64,
    /// Root mean square of the force error against the fine reference, over that of its force.
    pub force_error_rms_rel_fine: f64,
    /// Largest force error, N.
    pub force_error_max_n: f64,
    /// Part of the error along the reference's normal, relative to the whole force.
    pub normal_error_rms_rel: f64,
    /// Part across the normal, relative to the whole force.
    pub tangential_error_rms_rel: f64,
    /// Force errors in windows of 100 ms.
    pub force_error_per_100_ms: Vec<WindowError>,
    /// 1 − difference in the shares of contact modes, mean over windows of 50 ms; absent without a column `mode`.
    pub mode_agreement: Option<f64>,
    /// Agreement of the contact modes in the worst window; absent without a column `mode`.
    pub mode_agreement_worst: Option<f64>,
    /// Delay of the onset of slip, s; absent without a column `mode`, or if slip does not set in in both.
    pub slip_onset_error_s: Option<f64>,
    /// Root mean square of the distance between the contact points on the surface at rest, m; absent without columns
    /// `px,py,pz`.
    pub contact_point_error_rms_m: Option<f64>,
    /// The largest such distance, m.
    pub contact_point_error_max_m: Option<f64>,
    /// Lag of the trace with the largest correlation, in whole ticks within ±50 ms; positive if the trace is late.
    pub lag_ticks: i64,
    /// Force error at that lag, in the corrected unit if that is in doubt.
    pub force_error_rms_rel_without_lag: f64,
    /// Factor on the trace at which the error is least.
    pub best_scale: f64,
}

/// Why a scene has no reference that a trace can be compared with.
#[derive(Debug, Error, Diagnostic)]
#[non_exhaustive]
pub enum ReferenceError {
    /// The scene cannot start.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    /// The tip of the scene is led by a modelled hand.
    #[error(
        "the tip of `{scene}` is that of a device in a modelled hand, which takes another path under another force"
    )]
    #[diagnostic(help("give a scene with `instrument.kind = \"path\"` or `\"recording\"`"))]
    ByHand {
        /// Name of the scene.
        scene: String,
    },
}

/// Runs the reference of a scene for [`Judgement::of`]: the whole network at the haptic rate with the scene's contact.
/// `watch` is called after every tick with the number of ticks done, of (1 + [`REFINEMENT`](super::accuracy::REFINEMENT))
/// times the scene's.
///
/// # Errors
/// If the scene cannot start, or the path of its tip depends on the force.
pub fn reference(scene: &Scene, watch: impl FnMut(u64)) -> Result<Reference, ReferenceError> {
    match scene.instrument {
        InstrumentKind::Phantom(_) => Err(ReferenceError::ByHand { scene: scene.name.clone() }),
        InstrumentKind::Path => Ok(Reference::watched(scene, Method::of(scene).touching, watch)?),
    }
}

impl Judgement {
    /// Judges a trace by the [`reference`] of its scene.
    ///
    /// # Errors
    /// If the trace covers no tick of the scene.
    pub fn of(trace: &ForceTrace, scene: &Scene, reference: &Reference) -> Result<Self, TraceError> {
        let (tick_s, rate) = (scene.tick_s(), scene.local_rate_hz());
        let time = |tick: usize| (tick + 1) as f64 / rate;
        let whole = reference.coarse.samples();
        // A time that is rounded in the file still counts as the tick's.
        let [first_s, last_s] = trace.span_s();
        let rounding = 1e-3 * tick_s;
        let is_covered = |&tick: &usize| time(tick) >= first_s - rounding && time(tick) <= last_s + rounding;
        let mut covered = (0..whole.len()).filter(is_covered);
        let elsewhere = || TraceError::Elsewhere { first_s, last_s, duration_s: scene.duration_s() };
        let begin = covered.next().ok_or_else(elsewhere)?;
        let end = covered.next_back().unwrap_or(begin) + 1;
        let ticks: Vec<_> = (begin..end).map(|tick| trace.tick_at(time(tick), tick_s)).collect();
        let record = Record::of_forces(ticks.iter().map(|(tick, _)| *tick), tick_s);
        let part = reference.part(begin..end);
        let errors = Errors::of(&record, &part);

        let compared_s = [time(begin), time(end - 1)];
        let compared = Compared {
            trace,
            scene,
            missing_ticks: whole.len() - (end - begin),
            compared_s,
            interpolated: ticks.iter().filter(|(_, is_own)| !is_own).count(),
            own: &record.samples(),
            reference: &part.coarse.samples(),
            error: errors.force_error_rms_rel,
        };
        let fault = reference.coarse.fault.as_ref().or(reference.fine.fault.as_ref());
        let (found, fit) = findings(&compared, fault.map(String::as_str));
        let contact = |samples: &[Sample]| samples.iter().filter(|sample| sample.mode != Mode::Free).count();
        let (scene_contact_ticks, compared_contact_ticks) = (contact(&whole), contact(&whole[begin..end]));
        let in_gaps = fit.ticks_in_gaps > MOST_IN_GAPS * (end - begin) as f64;
        let open = if fault.is_some() {
            Some("the reference ended in a fault")
        } else if begin > MARGIN_TICKS || whole.len() - end > MARGIN_TICKS {
            Some("the trace does not cover the whole scene")
        } else if compared_contact_ticks == 0 {
            Some("the reference has no contact in the compared ticks")
        } else if in_gaps {
            Some("more than 1 % of the compared ticks lie in gaps of the trace")
        } else {
            None
        };
        let error = errors.force_error_rms_rel;
        let below_floor = error <= part.floor;
        let verdict = match open {
            Some(_) => Verdict::Inconclusive,
            None if error <= PERCEPTION => Verdict::Pass,
            None => Verdict::Fail,
        };
        Ok(Self {
            scene: scene.name.clone(),
            version: env!("CARGO_PKG_VERSION"),
            verdict,
            sentence: sentence(error, part.floor, open),
            findings: found,
            scene_ticks: whole.len(),
            compared_ticks: end - begin,
            compared_s,
            scene_contact_ticks,
            compared_contact_ticks,
            contact: reference.touching.to_string(),
            floor_rms_rel: part.floor,
            below_floor,
            force_rms_n: part.coarse.force_rms_n(),
            force_error_rms_rel: error,
            force_error_rms_rel_fine: errors.force_error_rms_rel_fine,
            force_error_max_n: errors.force_error_max_n,
            normal_error_rms_rel: errors.normal_error_rms_rel,
            tangential_error_rms_rel: errors.tangential_error_rms_rel,
            // Windows are counted from the first tick compared.
            force_error_per_100_ms: errors
                .force_error_per_100_ms
                .into_iter()
                .map(|window| WindowError { time_s: window.time_s + begin as f64 / rate, ..window })
                .collect(),
            mode_agreement: trace.has_modes.then_some(errors.mode_agreement),
            mode_agreement_worst: trace.has_modes.then_some(errors.mode_agreement_worst),
            slip_onset_error_s: errors.slip_onset_error_s.filter(|_| trace.has_modes),
            contact_point_error_rms_m: errors.contact_point_error_rms_m.filter(|_| trace.has_places),
            contact_point_error_max_m: errors.contact_point_error_max_m.filter(|_| trace.has_places),
            lag_ticks: fit.lag_ticks,
            force_error_rms_rel_without_lag: fit.error_without_lag,
            best_scale: fit.best_scale,
        })
    }
}

/// Returns the finding on the error as a sentence.
fn sentence(error: f64, floor: f64, open: Option<&str>) -> String {
    let how = if error <= floor {
        format!(", below the floor of {}: as good as the reference", percent(floor))
    } else if error <= PERCEPTION {
        format!(", within the {} that a hand cannot tell apart; the floor is {}", percent(PERCEPTION), percent(floor))
    } else {
        format!(", above the {} that a hand can tell apart", percent(PERCEPTION))
    };
    let open = open.map_or(String::new(), |reason| format!(", but {reason}"));
    format!("force error {} RMS{how}{open}", percent(error))
}

/// Formats a share in percent, with two digits after the point for small ones.
fn percent(share: f64) -> String {
    let value = 100.0 * share;
    let decimals = match value.abs() {
        small if small < 1.0 => 2,
        medium if medium < 10.0 => 1,
        _ => 0,
    };
    format!("{value:.decimals$} %")
}
