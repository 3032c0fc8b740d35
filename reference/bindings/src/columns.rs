//! The rows of `trace.csv` as columns.

use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyDict, PyString};
use stickslip::output::trace::TraceRow;
use stickslip::pipeline::TickView;

/// Columns of whole numbers; an empty cell is −1.
const WHOLE: [&str; 3] = ["tick", "triangle", "model_age"];
/// Columns of words; an empty cell is an empty word.
const WORDS: [&str; 2] = ["mode", "timing"];

/// A trace in memory, in the format of `trace.csv`.
///
/// Its floats are in the shortest form that reads back to the same bits, so nothing is lost on the way through text, and
/// the columns are those of the file by construction.
#[derive(Debug)]
pub struct Trace(csv::Writer<Vec<u8>>);

/// The values of a column; all other columns than those above are floats, and an empty cell is NaN.
#[derive(Debug)]
enum Values {
    Whole(Vec<i64>),
    Words(Vec<String>),
    Floats(Vec<f64>),
}

/// The columns of a trace by name, in the order of the file.
#[derive(Debug)]
pub struct Columns(Vec<(String, Values)>);

impl Trace {
    /// Begins an empty trace.
    pub fn new() -> Self {
        Self(csv::Writer::from_writer(Vec::new()))
    }

    /// Adds the row of a tick.
    ///
    /// # Errors
    /// Never in practice: memory can be written.
    pub fn record(&mut self, view: &TickView) -> csv::Result<()> {
        self.0.serialize(TraceRow::new(view))
    }

    /// Reads the columns back.
    ///
    /// # Errors
    /// If a cell is not of its column's type.
    pub fn columns(self) -> csv::Result<Columns> {
        let text = self.0.into_inner().map_err(|error| error.into_error())?;
        let mut reader = csv::Reader::from_reader(&*text);
        let mut columns: Vec<(String, Values)> = Vec::new();
        for name in reader.headers()? {
            let values = match name {
                _ if WHOLE.contains(&name) => Values::Whole(Vec::new()),
                _ if WORDS.contains(&name) => Values::Words(Vec::new()),
                _ => Values::Floats(Vec::new()),
            };
            columns.push((name.to_owned(), values));
        }
        let mut row = csv::StringRecord::new();
        while reader.read_record(&mut row)? {
            for (cell, (name, values)) in row.iter().zip(&mut columns) {
                values
                    .push(cell)
                    .map_err(|error| std::io::Error::other(format!("column {name}: {cell:?}: {error}")))?;
            }
        }
        Ok(Columns(columns))
    }
}

impl Values {
    fn push(&mut self, cell: &str) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        match self {
            Self::Whole(values) => values.push(if cell.is_empty() { -1 } else { cell.parse()? }),
            Self::Words(values) => values.push(cell.to_owned()),
            Self::Floats(values) => values.push(if cell.is_empty() { f64::NAN } else { cell.parse()? }),
        }
        Ok(())
    }
}

impl<'py> IntoPyObject<'py> for Columns {
    type Target = PyDict;
    type Output = Bound<'py, PyDict>;
    type Error = PyErr;

    /// A dictionary from names to pairs: numpy's name of the type, and bytes, or a list of words.
    fn into_pyobject(self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let columns = PyDict::new(py);
        for (name, values) in self.0 {
            let entry = match values {
                Values::Whole(values) => ("i8", PyByteArray::new(py, bytemuck::cast_slice(&values)).into_any()),
                Values::Floats(values) => ("f8", PyByteArray::new(py, bytemuck::cast_slice(&values)).into_any()),
                Values::Words(words) => {
                    // A handful of words: one object for each, however many ticks there are.
                    let words = words.iter().map(|word| PyString::intern(py, word));
                    ("U", pyo3::types::PyList::new(py, words.collect::<Vec<_>>())?.into_any())
                }
            };
            columns.set_item(name, entry)?;
        }
        Ok(columns)
    }
}
