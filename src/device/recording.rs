//! A recorded motion of a tip: CSV, with the columns, the unit and the clock of whoever recorded it.

use std::fs::File;
use std::path::Path;
use std::str::FromStr;

use super::path::{PathError, TipPath, Waypoint};
use crate::Vec3;

/// Columns of a recording if none are named: time and position.
const COLUMNS: [&str; 4] = ["t", "x", "y", "z"];

/// How a recording is read.
///
/// ```
/// use stickslip::{Vec3, device::recording::Recording};
///
/// // A tracker's log: its own columns and clock, in mm and ms.
/// let folder = tempfile::tempdir()?;
/// let file = folder.path().join("tracker.csv");
/// std::fs::write(&file, "stamp,grip,px,py,pz\n12300,0,0,0,2\n12500,1,0,0,-3\n")?;
/// let columns = ["stamp", "px", "py", "pz"].map(str::to_owned);
/// let path = Recording { columns: Some(columns), scale: 1e-3, time_scale: 1e-3, start_s: 12.3, filter_hz: None }.read(&file)?;
/// assert!((path.at(0.0) - Vec3::z() * 2e-3).norm() < 1e-15);
/// assert!((path.end() - 0.2).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Names of the columns with the time and the position; other columns are ignored. Without names the file has the
    /// four columns `t,x,y,z` and no other.
    pub columns: Option<[String; 4]>,
    /// Length of the file's unit, m.
    pub scale: f64,
    /// Duration of the file's unit of time, s.
    pub time_scale: f64,
    /// Time on the file's clock, converted to s, at which the path starts.
    pub start_s: f64,
    /// Frequency at which a low-pass without phase lag halves the amplitude, Hz; without it positions are taken as recorded.
    pub filter_hz: Option<f64>,
}

impl Default for Recording {
    /// Columns `t,x,y,z` in s and m, with the scene's clock, unfiltered.
    fn default() -> Self {
        Self { columns: None, scale: 1.0, time_scale: 1.0, start_s: 0.0, filter_hz: None }
    }
}

impl Recording {
    /// Reads a recording.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, has anything but finite numbers in the columns, or its times do not ascend.
    /// The error names the line.
    pub fn read(&self, path: &Path) -> Result<TipPath, PathError> {
        let file = File::open(path).map_err(|error| PathError::Unreadable { path: path.to_owned(), error })?;
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file);
        let indices = self.indices(reader.headers()?)?;
        let mut waypoints = Vec::new();
        let mut before = f64::NEG_INFINITY;
        for record in reader.records() {
            let record = record?;
            let line = line(&record);
            let [time, x, y, z] = indices.map(|index| finite(&record, index));
            let position = Vec3::new(x?, y?, z?) * self.scale;
            let time = time? * self.time_scale;
            if !(time > before) {
                return Err(PathError::ClockBackwards { line, time, before });
            }
            before = time;
            waypoints.push(Waypoint { time: time - self.start_s, position });
        }
        // The filter needs times that ascend.
        let path_as_recorded = TipPath::new(waypoints.clone())?;
        let motion = match self.filter_hz {
            None => path_as_recorded,
            Some(hz) => {
                smooth(&mut waypoints, hz);
                TipPath::new(waypoints)?
            }
        };
        Ok(motion.with_recording(path.to_owned()))
    }

    /// Finds the columns in a header.
    fn indices(&self, header: &csv::StringRecord) -> Result<[usize; 4], PathError> {
        let Some(columns) = &self.columns else {
            return if header.iter().eq(COLUMNS) {
                Ok([0, 1, 2, 3])
            } else {
                Err(PathError::Header { found: joined(header) })
            };
        };
        find_columns(header, columns.each_ref().map(String::as_str))
    }
}

/// Finds columns by their names in the header of a CSV file.
pub(crate) fn find_columns<const N: usize>(
    header: &csv::StringRecord,
    names: [&str; N],
) -> Result<[usize; N], PathError> {
    let mut indices = [0; N];
    for (index, name) in indices.iter_mut().zip(names) {
        let place = header.iter().position(|column| column == name);
        *index = place.ok_or_else(|| PathError::NoColumn { name: name.to_owned(), found: joined(header) })?;
    }
    Ok(indices)
}

/// Reads a number from a row of a CSV file. The error names the line.
pub(crate) fn number<T: FromStr>(row: &csv::StringRecord, index: usize) -> Result<T, PathError> {
    let text = row.get(index).unwrap_or_default();
    text.parse().map_err(|_| PathError::NotANumber { line: line(row), text: text.to_owned() })
}

/// Reads a finite number from a row of a CSV file. The error names the line.
fn finite(row: &csv::StringRecord, index: usize) -> Result<f64, PathError> {
    let not_finite = || PathError::NotANumber { line: line(row), text: row.get(index).unwrap_or_default().to_owned() };
    number::<f64>(row, index).and_then(|number| if number.is_finite() { Ok(number) } else { Err(not_finite()) })
}

/// Returns the line of a row in its CSV file, from 1.
pub(crate) fn line(row: &csv::StringRecord) -> u64 {
    row.position().map_or(0, csv::Position::line)
}

fn joined(header: &csv::StringRecord) -> String {
    header.iter().collect::<Vec<_>>().join(",")
}

/// Smooths positions by a first-order low-pass forward and then backward, which cancels its lag. At the frequency `hz` each
/// pass leaves 1/√2 of the amplitude. Between samples the motion is taken as linear, so samples need no even spacing.
fn smooth(waypoints: &mut [Waypoint], hz: f64) {
    let omega = std::f64::consts::TAU * hz;
    let mut pass = |backward: bool| {
        let (count, mut last) = (waypoints.len(), None::<(Waypoint, Vec3)>);
        for step in 0..count {
            let waypoint = &mut waypoints[if backward { count - 1 - step } else { step }];
            let given = *waypoint;
            if let Some((before, state)) = last {
                // ẏ = ω(u − y) with u linear from u₀ to u₁ over T: y₁ = u₁ − s + (y₀ − u₀ + s) e^(−ωT), s = (u₁ − u₀)/(ωT).
                let phase = omega * (given.time - before.time).abs();
                let lag = (given.position - before.position) / phase;
                waypoint.position = given.position - lag + (state - before.position + lag) * (-phase).exp();
            }
            last = Some((given, waypoint.position));
        }
    };
    pass(false);
    pass(true);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_halves_its_frequency_without_lag() {
        // Sines sampled unevenly, at 0.4 and 0.6 ms: linear motion between samples is within 1e-5 of the sine.
        for (hz, left) in [(10.0, 0.5), (1.0, 1.0 / 1.01), (100.0, 1.0 / 101.0)] {
            let time = |i: usize| i as f64 * 5e-4 + if i.is_multiple_of(2) { 0.0 } else { -1e-4 };
            let sine = |t: f64| (std::f64::consts::TAU * hz * t).sin();
            let mut waypoints: Vec<Waypoint> =
                (0..8000).map(|i| Waypoint { time: time(i), position: Vec3::x() * sine(time(i)) }).collect();
            smooth(&mut waypoints, 10.0);
            let middle = &waypoints[3000..5000];
            let off = middle.iter().map(|w| (w.position.x - left * sine(w.time)).abs()).fold(0.0, f64::max);
            assert!(off < 2e-3, "{hz} Hz: {off:e}");
        }
    }
}
