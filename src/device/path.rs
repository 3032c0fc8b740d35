//! The path of a tip, or of the hand that leads it: waypoints or a recording.

use std::io;
use std::path::{Path as FilePath, PathBuf};

use thiserror::Error;

use crate::Vec3;
#[cfg(feature = "files")]
use crate::device::recording::Recording;
use crate::word::words;

/// A waypoint: a tip position at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Time, s.
    pub time: f64,
    /// Position, m.
    pub position: Vec3,
}

/// Motion between two waypoints.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Constant velocity between waypoints. The velocity jumps at a waypoint, to which contact responds as to an impact.
    #[default]
    Linear,
    /// Minimum jerk: the share 10τ³ − 15τ⁴ + 6τ⁵ of the way at the share τ of the time, with zero velocity and acceleration
    /// at every waypoint (Flash & Hogan 1985, *J. Neurosci.* 5(7)).
    MinimumJerk,
}

words!(Interpolation { Linear = "linear", MinimumJerk = "minimum-jerk" });

impl Interpolation {
    /// Share of the way at a share τ of the time.
    pub(crate) fn share(self, t: f64) -> f64 {
        match self {
            Interpolation::Linear => t,
            Interpolation::MinimumJerk => t * t * t * (10.0 + t * (6.0 * t - 15.0)),
        }
    }

    /// Derivative of [`share`](Self::share) by τ.
    fn rate(self, t: f64) -> f64 {
        match self {
            Interpolation::Linear => 1.0,
            Interpolation::MinimumJerk => 30.0 * (t * (1.0 - t)).powi(2),
        }
    }
}

/// A path through waypoints, at rest before and after, whatever the force. Times ascend; there is at least one waypoint.
///
/// ```
/// use stickslip::{Vec3, device::path::{Interpolation, TipPath, Waypoint}};
///
/// let ends = [(0.0, 0.0), (1.0, 0.01)].map(|(time, x)| Waypoint { time, position: Vec3::x() * x });
/// let smooth = TipPath::new(ends.to_vec())?.with_interpolation(Interpolation::MinimumJerk);
/// assert_eq!(smooth.at(0.5).x, 0.005);
/// assert!(smooth.at(0.01).x < 1e-7); // it starts without a jump of velocity or acceleration
/// assert!((smooth.velocity_at(0.5).x - 0.01875).abs() < 1e-15); // 15/8 of the mean
/// assert_eq!(smooth.top_speed(), smooth.velocity_at(0.5).x);
/// # Ok::<(), stickslip::device::path::PathError>(())
/// ```
///
/// ```
/// use stickslip::{Vec3, device::path::{PathError, TipPath, Waypoint}};
///
/// let at = |time, z| Waypoint { time, position: Vec3::new(0.0, 0.0, z) };
/// let press = TipPath::new(vec![at(0.0, 0.002), at(0.5, -0.003), at(1.0, -0.003)])?;
/// assert_eq!(press.at(0.5).z, -0.003);
/// assert!((press.velocity_at(0.25).z + 0.01).abs() < 1e-15); // 5 mm in 0.5 s
/// assert_eq!(press.velocity_at(2.0), Vec3::zeros());
/// let slower = press.transformed(2.0, |point| point + Vec3::x());
/// assert_eq!(slower.at(1.0), Vec3::new(1.0, 0.0, -0.003));
/// assert!((slower.top_speed() - 0.005).abs() < 1e-15);
/// assert!(matches!(TipPath::new(vec![at(1.0, 0.0), at(0.0, 0.0)]), Err(PathError::NotAscending { index: 1, .. })));
/// # Ok::<(), stickslip::device::path::PathError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TipPath {
    waypoints: Vec<Waypoint>,
    interpolation: Interpolation,
    /// File that the path was read from, if it was recorded.
    recording: Option<PathBuf>,
}

/// What is wrong with a path.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PathError {
    /// There is no waypoint.
    #[error("there is no waypoint")]
    Empty,
    /// A waypoint, or its displacement from the one before, is NaN or infinite.
    #[error("waypoint {index} is not finite")]
    NotFinite {
        /// Index of the waypoint, from 0.
        index: usize,
    },
    /// A waypoint is not later than the one before.
    #[error("waypoint {index} at {time} s is not later than the one before it, at {before} s")]
    NotAscending {
        /// Index of the waypoint, from 0.
        index: usize,
        /// Time of the waypoint, s.
        time: f64,
        /// Time of the waypoint before, s.
        before: f64,
    },
    /// The recording cannot be opened.
    #[error("cannot read {path}: {error}")]
    Unreadable {
        /// Path of the recording.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The recording is not CSV; the parser's message.
    #[cfg(feature = "files")]
    #[error("{0}")]
    Csv(#[from] csv::Error),
    /// The library was built without the feature that reads recordings.
    #[cfg(not(feature = "files"))]
    #[error("cannot read {0}: this build reads no recordings (feature `files`)")]
    NoFiles(PathBuf),
    /// The recording has other columns than `t,x,y,z`.
    #[error("its header is `{found}`, not `t,x,y,z`")]
    Header {
        /// First line of the file.
        found: String,
    },
    /// The recording has no column of this name.
    #[error("there is no column `{name}` in its header `{found}`")]
    NoColumn {
        /// Name of the column.
        name: String,
        /// First line of the file.
        found: String,
    },
    /// A field of the recording is not a finite number.
    #[error("line {line}: `{text}` is not a finite number")]
    NotANumber {
        /// Line of the file, from 1.
        line: u64,
        /// The field.
        text: String,
    },
    /// The clock of the recording stands still or goes backwards.
    #[error("line {line}: its time, {time} s, is not later than that of the sample before it, {before} s")]
    ClockBackwards {
        /// Line of the file, from 1.
        line: u64,
        /// Time of the sample on the file's clock, s.
        time: f64,
        /// Time of the sample before, s.
        before: f64,
    },
}

impl TipPath {
    /// Builds a path from waypoints in ascending order.
    ///
    /// # Errors
    /// If there is no waypoint, one is not finite, or their times do not ascend.
    pub fn new(waypoints: Vec<Waypoint>) -> Result<Self, PathError> {
        if waypoints.is_empty() {
            return Err(PathError::Empty);
        }
        for (index, waypoint) in waypoints.iter().enumerate() {
            if !(waypoint.time.is_finite() && waypoint.position.iter().all(|c| c.is_finite())) {
                return Err(PathError::NotFinite { index });
            }
        }
        for (index, pair) in waypoints.windows(2).enumerate() {
            let index = index + 1;
            // Finite numbers that are far apart may have an infinite difference.
            if !((pair[1].position - pair[0].position).norm() / (pair[1].time - pair[0].time)).is_finite()
                && pair[1].time > pair[0].time
            {
                return Err(PathError::NotFinite { index });
            }
            if pair[1].time <= pair[0].time {
                return Err(PathError::NotAscending { index, time: pair[1].time, before: pair[0].time });
            }
        }
        Ok(Self { waypoints, interpolation: Interpolation::Linear, recording: None })
    }

    /// Returns the path through the same waypoints with another motion between them.
    pub fn with_interpolation(self, interpolation: Interpolation) -> Self {
        Self { interpolation, ..self }
    }

    /// Returns the motion between waypoints.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// Records the file that the path was read from.
    pub fn with_recording(self, file: PathBuf) -> Self {
        Self { recording: Some(file), ..self }
    }

    /// Returns the file that the path was read from, if it was recorded.
    pub fn recording(&self) -> Option<&FilePath> {
        self.recording.as_deref()
    }

    /// Reads a recording: CSV with the header `t,x,y,z`, in s and m.
    ///
    /// # Errors
    /// If the file cannot be read, has other columns or anything but numbers, or its times do not ascend; the error
    /// names the line.
    ///
    /// ```
    /// use stickslip::device::path::TipPath;
    ///
    /// let folder = tempfile::tempdir()?;
    /// let recording = folder.path().join("press.csv");
    /// std::fs::write(&recording, "t,x,y,z\n0.0,0,0,0.002\n0.5,0,0,-0.003\n")?;
    /// assert!((TipPath::from_csv(&recording)?.top_speed() - 0.01).abs() < 1e-15); // m/s
    /// std::fs::write(&recording, "time,z\n0.0,0.002\n")?;
    /// let error = TipPath::from_csv(&recording).expect_err("other columns");
    /// assert_eq!(error.to_string(), "its header is `time,z`, not `t,x,y,z`");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[cfg(feature = "files")]
    pub fn from_csv(path: &FilePath) -> Result<Self, PathError> {
        Recording::default().read(path)
    }

    /// Refuses a recording, which a build without the feature `files` cannot read.
    ///
    /// # Errors
    /// Always.
    #[cfg(not(feature = "files"))]
    pub fn from_csv(path: &FilePath) -> Result<Self, PathError> {
        Err(PathError::NoFiles(path.to_owned()))
    }

    /// Returns the waypoints.
    pub fn waypoints(&self) -> &[Waypoint] {
        &self.waypoints
    }

    /// Returns the time of the last waypoint, s.
    pub fn end(&self) -> f64 {
        self.waypoints.last().map_or(0.0, |last| last.time)
    }

    /// Returns the tip position at a time, s.
    pub fn at(&self, time: f64) -> Vec3 {
        match self.around(time) {
            (Some(before), Some(after)) => {
                let fraction = (time - before.time) / (after.time - before.time);
                before.position + (after.position - before.position) * self.interpolation.share(fraction)
            }
            (Some(only), None) => only.position,
            (None, Some(only)) => only.position,
            (None, None) => unreachable!("a path has at least one waypoint"),
        }
    }

    /// Returns the velocity at a time, m/s; at a waypoint, that of the segment after it.
    pub fn velocity_at(&self, time: f64) -> Vec3 {
        match self.around(time) {
            (Some(before), Some(after)) => {
                let duration = after.time - before.time;
                let rate = self.interpolation.rate((time - before.time) / duration);
                (after.position - before.position) / duration * rate
            }
            _ => Vec3::zeros(),
        }
    }

    /// Returns the last waypoint not after a time, and the first after it.
    fn around(&self, time: f64) -> (Option<&Waypoint>, Option<&Waypoint>) {
        let after = self.waypoints.partition_point(|waypoint| waypoint.time <= time);
        (after.checked_sub(1).map(|i| &self.waypoints[i]), self.waypoints.get(after))
    }

    /// Maps the positions of the path, and slows it down by a factor.
    pub fn transformed(&self, slower: f64, to: impl Fn(Vec3) -> Vec3) -> Self {
        let waypoints = self.waypoints.iter();
        let waypoint = |w: &Waypoint| Waypoint { time: w.time * slower, position: to(w.position) };
        Self { waypoints: waypoints.map(waypoint).collect(), ..self.clone() }
    }

    /// Returns the largest speed of the tip, m/s.
    pub fn top_speed(&self) -> f64 {
        self.waypoints
            .windows(2)
            .map(|pair| (pair[1].position - pair[0].position).norm() / (pair[1].time - pair[0].time))
            .fold(0.0, f64::max)
            * self.interpolation.rate(0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waypoint(time: f64, x: f64) -> Waypoint {
        Waypoint { time, position: Vec3::x() * x }
    }

    #[test]
    fn the_tip_moves_linearly_and_stays_outside() {
        let path = TipPath::new(vec![waypoint(1.0, 0.0), waypoint(3.0, 4.0), waypoint(4.0, 4.0)]).unwrap();
        for (time, x) in [(0.0, 0.0), (1.0, 0.0), (1.5, 1.0), (3.0, 4.0), (3.5, 4.0), (9.0, 4.0)] {
            assert_eq!(path.at(time).x, x, "at {time} s");
        }
        for (time, speed) in [(0.0, 0.0), (1.0, 2.0), (2.9, 2.0), (3.0, 0.0), (9.0, 0.0)] {
            assert_eq!(path.velocity_at(time).x, speed, "at {time} s");
        }
        assert_eq!(path.top_speed(), 2.0);
    }

    #[test]
    fn bad_waypoints_are_named() {
        assert!(matches!(TipPath::new(vec![]), Err(PathError::Empty)));
        assert!(matches!(
            TipPath::new(vec![waypoint(0.0, 0.0), waypoint(0.0, 1.0)]),
            Err(PathError::NotAscending { index: 1, .. })
        ));
        assert!(matches!(TipPath::new(vec![waypoint(0.0, f64::NAN)]), Err(PathError::NotFinite { index: 0 })));
    }
}
