//! Force traces of other programs: CSV with a time and a force in each row.

use std::io;
use std::path::Path;

use miette::Diagnostic;
use thiserror::Error;

use crate::Vec3;
use crate::contact::law::Mode;
use crate::device::path::PathError;
use crate::device::recording::{find_columns, line, number};
use crate::verify::accuracy::OutsideTick;

/// Columns of a trace if none are named: time and force.
const COLUMNS: [&str; 4] = ["t", "fx", "fy", "fz"];
/// Columns that may be present besides: contact mode, and the contact point on the surface at rest.
const MODE: &str = "mode";
const PLACE: [&str; 3] = ["px", "py", "pz"];

/// Part of a tick within which a row counts as that tick's own: times are written with six digits or more.
const SAME_TIME: f64 = 1e-3;

/// How a trace is read.
#[derive(Debug, Clone, PartialEq)]
pub struct TraceFormat {
    /// Names of the columns with the time and the three components of the force on the instrument, in any order.
    pub columns: [String; 4],
    /// Force of the file's unit, N: 0.001 for mN, -1 for the force on the body.
    pub scale: f64,
    /// Time added to the file's, s.
    pub time_offset_s: f64,
}

impl Default for TraceFormat {
    /// Columns `t,fx,fy,fz`, in s and N.
    fn default() -> Self {
        Self { columns: COLUMNS.map(str::to_owned), scale: 1.0, time_offset_s: 0.0 }
    }
}

/// What is wrong with a trace.
#[derive(Debug, Error, Diagnostic)]
#[non_exhaustive]
pub enum TraceError {
    /// The file cannot be read, has no such column, or has anything but numbers in it.
    #[error(transparent)]
    #[diagnostic(help(
        "give a CSV file with a header and the columns `t,fx,fy,fz`, or name its columns: time, then force"
    ))]
    Table(#[from] PathError),
    /// A number is NaN or infinite.
    #[error("line {line}: `{column}` is {value}, not a finite number")]
    #[diagnostic(help("correct the row, or remove it: a missing row is counted as a gap"))]
    NotFinite {
        /// Line of the file, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// The value.
        value: f64,
    },
    /// A row is not later than the one before.
    #[error("line {line}: the time {time} s is not later than {before} s of the row before")]
    #[diagnostic(help("sort the rows by time, and keep one row for each time"))]
    NotAscending {
        /// Line of the file, from 1.
        line: u64,
        /// Time of the row, s.
        time: f64,
        /// Time of the row before, s.
        before: f64,
    },
    /// A contact mode is none of a trace's words.
    #[error("line {line}: `{text}` is no contact mode")]
    #[diagnostic(help("the modes are `free`, `stick`, `slide` and `slip`; a trace without the column is accepted"))]
    Mode {
        /// Line of the file, from 1.
        line: u64,
        /// The field.
        text: String,
    },
    /// There are less than two rows.
    #[error("the trace has {rows} rows; at least two are needed")]
    #[diagnostic(help("give one row for each tick"))]
    TooShort {
        /// Number of rows.
        rows: usize,
    },
    /// No tick of the scene lies within the trace.
    #[error(
        "the trace covers nothing of the scene: it runs from {first_s} s to {last_s} s, and the scene from 0 s to {duration_s} s"
    )]
    #[diagnostic(help("add a time offset of {} s, so that the trace starts with the scene", -first_s))]
    Elsewhere {
        /// Time of the first row, s.
        first_s: f64,
        /// Time of the last row, s.
        last_s: f64,
        /// Duration of the scene, s.
        duration_s: f64,
    },
}

/// A row of a trace.
#[derive(Debug, Clone, Copy)]
struct Row {
    time: f64,
    force: Vec3,
    /// Free without a column for it.
    mode: Mode,
    place: Option<Vec3>,
}

/// A force trace, in s and N, with ascending times.
///
/// ```
/// use stickslip::verify::judge::{ForceTrace, TraceFormat};
///
/// // A trace in mN, at 500 Hz, with another column beside.
/// let folder = tempfile::tempdir()?;
/// let file = folder.path().join("mine.csv");
/// std::fs::write(&file, "fz,fx,fy,t,temperature\n500,0,0,0.002,20\n700,0,0,0.004,20\n")?;
/// let trace = ForceTrace::read(&file, &TraceFormat { scale: 1e-3, ..TraceFormat::default() })?;
/// assert_eq!((trace.rows(), trace.step_s()), (2, 0.002));
/// assert!((trace.force_at(0.003).z - 0.6).abs() < 1e-15); // linear between rows
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct ForceTrace {
    rows: Vec<Row>,
    step_s: f64,
    pub(super) has_modes: bool,
    pub(super) has_places: bool,
}

impl ForceTrace {
    /// Reads a trace.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, has anything but finite numbers in these columns, or its times do not
    /// ascend; the error names the line.
    pub fn read(path: &Path, format: &TraceFormat) -> Result<Self, TraceError> {
        let unreadable = |error| PathError::Unreadable { path: path.to_owned(), error };
        Self::parse(std::fs::File::open(path).map_err(unreadable)?, format)
    }

    /// Reads a trace from the text of such a file.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn parse(text: impl io::Read, format: &TraceFormat) -> Result<Self, TraceError> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text);
        let header = reader.headers().map_err(PathError::from)?.clone();
        let names = format.columns.each_ref().map(String::as_str);
        let columns = find_columns(&header, names)?;
        let mode_column = header.iter().position(|name| name == MODE);
        let place_columns = find_columns(&header, PLACE).ok();
        let mut rows: Vec<Row> = Vec::new();
        for row in reader.records() {
            let row = row.map_err(PathError::from)?;
            let finite = |index: usize, name: &str| -> Result<f64, TraceError> {
                let value: f64 = number(&row, index)?;
                let column = name.to_owned();
                if value.is_finite() {
                    Ok(value)
                } else {
                    Err(TraceError::NotFinite { line: line(&row), column, value })
                }
            };
            let [t, fx, fy, fz] = std::array::from_fn(|i| finite(columns[i], names[i]));
            let time = t? + format.time_offset_s;
            let mode = match mode_column {
                None => Mode::Free,
                Some(column) => {
                    let text = row.get(column).unwrap_or_default();
                    Mode::named(text).ok_or_else(|| TraceError::Mode { line: line(&row), text: text.to_owned() })?
                }
            };
            // A free tick has no contact point.
            let place = match place_columns.filter(|[x, ..]| row.get(*x).is_some_and(|text| !text.is_empty())) {
                None => None,
                Some(columns) => {
                    let [x, y, z] = std::array::from_fn(|i| finite(columns[i], PLACE[i]));
                    Some(Vec3::new(x?, y?, z?))
                }
            };
            if let Some(before) = rows.last().map(|before| before.time).filter(|&before| !(time > before)) {
                return Err(TraceError::NotAscending { line: line(&row), time, before });
            }
            rows.push(Row { time, force: Vec3::new(fx?, fy?, fz?) * format.scale, mode, place });
        }
        if rows.len() < 2 {
            return Err(TraceError::TooShort { rows: rows.len() });
        }
        let mut steps: Vec<f64> = rows.windows(2).map(|pair| pair[1].time - pair[0].time).collect();
        let middle = steps.len() / 2;
        let (_, &mut step_s, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
        Ok(Self { rows, step_s, has_modes: mode_column.is_some(), has_places: place_columns.is_some() })
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    /// Returns the median step between rows, s.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Returns the times of the first and the last row, s.
    pub fn span_s(&self) -> [f64; 2] {
        [self.rows[0].time, self.rows[self.rows.len() - 1].time]
    }

    /// Returns the force at a time within the trace, N, linear between rows; beyond its ends, that of the nearest row.
    pub fn force_at(&self, time: f64) -> Vec3 {
        let after = self.rows.partition_point(|row| row.time < time).clamp(1, self.rows.len() - 1);
        let [before, after] = [self.rows[after - 1], self.rows[after]];
        let share = ((time - before.time) / (after.time - before.time)).clamp(0.0, 1.0);
        before.force + (after.force - before.force) * share
    }

    /// Returns what the trace has for the tick that ends at a time within it, and whether that is a row's own value: the
    /// force linear between rows, mode and contact point those of the nearest row.
    pub(super) fn tick_at(&self, time: f64, tick_s: f64) -> (OutsideTick, bool) {
        let after = self.rows.partition_point(|row| row.time < time);
        let around = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| self.rows.get(i));
        let apart = |row: &&Row| (row.time - time).abs();
        let nearest = around.min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(&self.rows[0]);
        let is_own = apart(&nearest) <= SAME_TIME * tick_s;
        let force = if is_own { nearest.force } else { self.force_at(time) };
        (OutsideTick { force, mode: nearest.mode, place: nearest.place }, is_own)
    }

    /// Returns the lengths of the gaps that begin or end within a span of time, s: steps longer than `times` the median.
    pub(super) fn gaps_s(&self, times: f64, [from, to]: [f64; 2]) -> Vec<f64> {
        let steps = self.rows.windows(2).filter(|pair| pair[1].time > from && pair[0].time < to);
        steps.map(|pair| pair[1].time - pair[0].time).filter(|step| !(*step <= times * self.step_s)).collect()
    }
}
