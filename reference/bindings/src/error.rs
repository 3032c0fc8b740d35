//! Scene errors as Python exceptions, with their place in the text.

use std::error::Error;

use miette::Diagnostic;
use pyo3::prelude::*;

/// Builds the exception `stickslip.SceneError` of an error: the message with its causes, file, line, column (both from 1),
/// help, the source line and the width of the marked place in it.
pub fn scene_error(py: Python<'_>, error: &stickslip::SceneError) -> PyErr {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        let text = inner.to_string();
        if !message.contains(&text) {
            message = format!("{message}: {text}");
        }
        cause = inner.source();
    }
    let help = error.help().map(|help| help.to_string());
    let place = Place::of(error);
    let build = || {
        let class = py.import("stickslip._errors")?.getattr("SceneError")?;
        let Place { file, line, column, text, width } = place;
        class.call1((message, file, line, column, help, text, width))
    };
    match build() {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}

/// Place of an error; all is absent where the error has none.
#[derive(Default)]
struct Place {
    file: Option<String>,
    line: Option<usize>,
    column: Option<usize>,
    text: Option<String>,
    /// Number of characters marked in the line.
    width: usize,
}

impl Place {
    fn of(error: &stickslip::SceneError) -> Self {
        let Some(source) = error.source_code() else { return Self::default() };
        let label = error.labels().and_then(|mut labels| labels.next());
        // Without a label the error is about the whole file.
        let Some(label) = label else {
            let start = source.read_span(&0.into(), 0, 0);
            return Self { file: start.ok().and_then(|start| start.name().map(str::to_owned)), ..Self::default() };
        };
        // Only the begin of the label: it may span many lines. A line of context on both sides gives the line whole.
        let start = miette::SourceSpan::new(label.offset().into(), 0);
        let (Ok(at), Ok(around)) = (source.read_span(&start, 0, 0), source.read_span(&start, 1, 1)) else {
            return Self::default();
        };
        let text = String::from_utf8_lossy(around.data());
        let text = text.lines().nth(at.line().saturating_sub(around.line())).unwrap_or_default().to_owned();
        Self {
            file: at.name().map(str::to_owned),
            line: Some(at.line() + 1),
            column: Some(at.column() + 1),
            width: label.len().clamp(1, text.len().saturating_sub(at.column()).max(1)),
            text: Some(text),
        }
    }
}
