//! Facts on a recorded motion before a run.

use serde::Serialize;

use crate::device::sampling::Sampling;
use crate::scene::Scene;

/// A recorded motion beside the scene that follows it. Times are the scene's.
#[derive(Debug, Serialize)]
pub struct RecordingFacts {
    /// Path of the file.
    file: String,
    samples: usize,
    /// Times of the first and of the last sample, s.
    from_s: f64,
    to_s: f64,
    /// Rate of the samples, Hz, by the median of their intervals; absent for fewer than ten samples.
    rate_hz: Option<f64>,
    /// Rate of the scene's ticks, Hz.
    local_rate_hz: f64,
    /// Whether the two rates differ, so that positions at ticks lie between samples.
    is_resampled: bool,
    /// Longest interval between samples, s, and when it begins.
    longest_interval_s: f64,
    longest_from_s: f64,
    /// Time of the recording after the end of the scene, which is not used, s.
    unused_s: f64,
    #[serde(skip)]
    interpolation: &'static str,
}

/// Relative difference between the rates of a recording and of the scene below which they are the same: a clock's drift.
const SAME_RATE: f64 = 1e-3;

impl RecordingFacts {
    /// Describes a scene's recording; `None` if its path is not recorded.
    pub fn new(scene: &Scene) -> Option<Self> {
        let file = scene.path.recording()?.display().to_string();
        let sampling = Sampling::of(&scene.path);
        let from_s = scene.path.waypoints().first()?.time;
        let to_s = scene.path.end();
        let rate_hz = sampling.usual_interval_s.map(f64::recip);
        let local_rate_hz = scene.local_rate_hz();
        Some(Self {
            file,
            samples: sampling.samples,
            from_s,
            to_s,
            rate_hz,
            local_rate_hz,
            is_resampled: !rate_hz.is_some_and(|rate| (rate / local_rate_hz - 1.0).abs() <= SAME_RATE),
            longest_interval_s: sampling.longest_interval_s,
            longest_from_s: sampling.longest_from_s,
            unused_s: (to_s - from_s.max(scene.duration_s())).max(0.0),
            interpolation: scene.path.interpolation().name(),
        })
    }

    /// Returns the facts as lines of text.
    pub fn lines(&self) -> Vec<String> {
        let Self { file, samples, from_s, to_s, local_rate_hz, interpolation, .. } = self;
        let rate = self.rate_hz.map_or("too few to have a rate".to_owned(), |rate| format!("{rate:.4} Hz"));
        let resampled = if self.is_resampled {
            format!("positions at the scene's {local_rate_hz} Hz are interpolated ({interpolation})")
        } else {
            format!("as the scene's {local_rate_hz} Hz")
        };
        let mut lines = vec![
            format!("  file      {file}: {samples} samples, from {from_s} to {to_s} s of the scene"),
            format!("  rate      {rate}; {resampled}"),
            format!("  interval  at most {:.6} s, from {:.6} s on", self.longest_interval_s, self.longest_from_s),
        ];
        if self.unused_s > 0.0 {
            lines.push(format!("  unused    {:.6} s after the end of the scene", self.unused_s));
        }
        lines
    }
}
