//! Warnings about settings that are accepted but may be unintended.

use std::fmt;

use serde::Serialize;

use super::Scene;
use crate::device::sampling::Sampling;

/// Speed of a tip, m/s, that no hand reaches.
const LARGEST_SPEED_M_PER_S: f64 = 50.0;
/// Share of the run that a recording has to cover; below it there is a warning.
const LEAST_COVERED: f64 = 0.99;

/// A warning, with a code for programs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Kind of the warning; it does not change between versions.
    pub code: &'static str,
    /// The finding with its numbers, and a remedy.
    pub message: String,
}

impl Warning {
    /// Creates a warning.
    pub fn new(code: &'static str, message: String) -> Self {
        Self { code, message }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

/// Returns the warnings about a scene's motion: its speed, and a recording with gaps or outside the run.
pub(super) fn of_motion(scene: &Scene) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let speed = scene.path.top_speed();
    if !(speed <= LARGEST_SPEED_M_PER_S) {
        warnings.push(Warning::new(
            "tip-speed",
            format!(
                "the tip moves at up to {speed:.0} m/s, more than {LARGEST_SPEED_M_PER_S:.0} m/s: positions are in m and \
                 times in s; `instrument.scale` converts a recording"
            ),
        ));
    }
    if let (Some(file), [first, .., last]) = (scene.path.recording(), scene.path.waypoints()) {
        let sampling = Sampling::of(&scene.path);
        if let (1.., Some(usual)) = (sampling.gaps, sampling.usual_interval_s) {
            let others =
                if sampling.gaps > 1 { format!(" (the longest of {} gaps)", sampling.gaps) } else { String::new() };
            warnings.push(Warning::new(
                "recording-gap",
                format!(
                    "the recording {} has no sample for {:.3} s from {:.3} s on{others}, where {:.3e} s are usual: the tip moves \
                     through as between any two samples",
                    file.display(),
                    sampling.longest_interval_s,
                    sampling.longest_from_s,
                    usual
                ),
            ));
        }
        let end = scene.duration_s();
        let covered = (last.time.min(end) - first.time.max(0.0)).max(0.0) / end;
        if !(covered >= LEAST_COVERED) {
            warnings.push(Warning::new(
                "recording-outside-run",
                format!(
                    "the recording {} covers {} to {} s and the scene 0 to {end} s: the tip stands still for {:.0} % of the \
                     run; `instrument.start` is the recording's time at which the scene starts, `instrument.time_scale` its unit of \
                     time, `duration` the scene's length",
                    file.display(),
                    first.time,
                    last.time,
                    100.0 * (1.0 - covered)
                ),
            ));
        }
    }
    warnings
}
