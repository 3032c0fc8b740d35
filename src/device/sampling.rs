//! How densely a recorded path is sampled.

use super::path::TipPath;

/// Fewest samples of which a usual interval can be told.
const FEWEST_SAMPLES: usize = 10;
/// Multiple of the usual interval from which an interval is a gap: a clock that jitters, or drops a few samples, stays below.
const GAP: f64 = 10.0;

/// The samples of a recording.
///
/// ```
/// use stickslip::{Vec3, device::{path::{TipPath, Waypoint}, sampling::Sampling}};
///
/// // 100 Hz, without the second half of the first second.
/// let samples = (0..200).filter(|i| !(50..100).contains(i));
/// let waypoints = samples.map(|i| Waypoint { time: f64::from(i) * 0.01, position: Vec3::zeros() });
/// let sampling = Sampling::of(&TipPath::new(waypoints.collect())?);
/// assert!((sampling.usual_interval_s.expect("enough samples") - 0.01).abs() < 1e-12);
/// assert_eq!(sampling.gaps, 1);
/// assert!((sampling.longest_interval_s - 0.51).abs() < 1e-12 && (sampling.longest_from_s - 0.49).abs() < 1e-12);
/// # Ok::<(), stickslip::device::path::PathError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Number of samples.
    pub samples: usize,
    /// Median of the intervals between samples, s; `None` for fewer than ten samples.
    pub usual_interval_s: Option<f64>,
    /// Longest interval between two samples, s; 0 with one sample.
    pub longest_interval_s: f64,
    /// Time at which the longest interval begins, s.
    pub longest_from_s: f64,
    /// Number of intervals of at least ten times the median; 0 where that is not known.
    pub gaps: usize,
}

impl Sampling {
    /// Measures the intervals between the waypoints of a path.
    pub fn of(path: &TipPath) -> Self {
        let waypoints = path.waypoints();
        let mut intervals: Vec<f64> = waypoints.windows(2).map(|pair| pair[1].time - pair[0].time).collect();
        let longest = (0..intervals.len()).max_by(|&a, &b| intervals[a].total_cmp(&intervals[b]));
        let longest_interval_s = longest.map_or(0.0, |index| intervals[index]);
        intervals.sort_by(f64::total_cmp);
        let usual_interval_s = (waypoints.len() >= FEWEST_SAMPLES).then(|| intervals[intervals.len() / 2]);
        Self {
            samples: waypoints.len(),
            usual_interval_s,
            longest_interval_s,
            longest_from_s: longest.map_or(0.0, |index| waypoints[index].time),
            gaps: usual_interval_s
                .map_or(0, |usual| intervals.len() - intervals.partition_point(|&interval| !(interval >= GAP * usual))),
        }
    }
}
