//! The text that a scene was read from, and what its places were before the text was changed.

use std::ops::Range;
use std::path::Path;

use miette::NamedSource;
use toml_edit::DocumentMut;

use super::change::Change;
use super::error::{Problem, SceneError};
use super::place::place;

/// The text of a scene: that of its file with the changes asked for beside it.
#[derive(Debug, Clone)]
pub(super) struct Source {
    /// The file, named by its path.
    file: NamedSource<String>,
    /// The text with all changes; `None` without any.
    changed: Option<String>,
    edits: Vec<Edit>,
}

/// A change with what it did to the text.
#[derive(Debug, Clone)]
struct Edit {
    change: Change,
    /// Bytes that it replaced in the text before it.
    before: Range<usize>,
    /// Bytes that it put in their place, in the text after it.
    after: Range<usize>,
}

/// Where a place of the changed text comes from.
pub(super) struct Origin {
    /// The file, or the change as it was asked for.
    pub source: NamedSource<String>,
    pub span: Range<usize>,
    /// The change that the place is in; `None` for the file.
    pub change: Option<Change>,
}

impl Source {
    /// Applies changes to the text of a file.
    ///
    /// # Errors
    /// If there are changes and the text is not TOML.
    pub fn new(text: &str, path: &Path, changes: &[Change]) -> Result<Self, SceneError> {
        let name = path.display().to_string();
        let mut source = Self { file: NamedSource::new(&name, text.to_owned()), changed: None, edits: Vec::new() };
        if changes.is_empty() {
            return Ok(source);
        }
        let mut document = text
            .parse::<DocumentMut>()
            .map_err(|error| SceneError::at(Problem::Syntax(error.message().to_owned()), &source, error.span()))?;
        // A document is written with line feeds alone, so that edits are found in a text that has no other line ends.
        source.file = NamedSource::new(&name, document.to_string());
        for change in changes {
            change.apply(&mut document);
            let after = document.to_string();
            source.edits.push(Edit::new(change, source.text(), &after));
            source.changed = Some(after);
        }
        Ok(source)
    }

    /// Returns the text with all changes.
    pub fn text(&self) -> &str {
        self.changed.as_deref().unwrap_or(self.file.inner())
    }

    /// Returns the path of the file, as errors name it.
    pub fn name(&self) -> &str {
        self.file.name()
    }

    /// Returns the changes in their order.
    pub fn changes(&self) -> impl Iterator<Item = &Change> {
        self.edits.iter().map(|edit| &edit.change)
    }

    /// Returns the file, for an error without a place.
    pub fn file(&self) -> &NamedSource<String> {
        &self.file
    }

    /// Returns where a place of the changed text comes from.
    pub fn origin(&self, mut span: Range<usize>) -> Origin {
        let written = self.text().get(span.clone()).unwrap_or_default().trim_matches(['"', '\'']);
        for Edit { change, before, after } in self.edits.iter().rev() {
            if span.start < after.end && after.start < span.end {
                let asked = change.to_string();
                let start = asked.rfind(written).filter(|_| !written.is_empty());
                let span = start.map_or(0..asked.len(), |start| start..start + written.len());
                return Origin { source: NamedSource::new("change", asked), span, change: Some(change.clone()) };
            }
            if span.start >= after.end {
                let moved = |place: usize| place - after.end + before.end;
                span = moved(span.start)..moved(span.end);
            }
        }
        Origin { source: self.file.clone(), span, change: None }
    }
}

impl Edit {
    fn new(change: &Change, old: &str, new: &str) -> Self {
        let (old_bytes, new_bytes) = (old.as_bytes(), new.as_bytes());
        let shorter = old.len().min(new.len());
        let head = (0..shorter).find(|&i| old_bytes[i] != new_bytes[i]).unwrap_or(shorter);
        let tail = (0..shorter - head)
            .find(|&i| old_bytes[old.len() - 1 - i] != new_bytes[new.len() - 1 - i])
            .unwrap_or(shorter - head);
        let mut after = head..new.len() - tail;
        // Where whole lines are new, the first bytes of the line behind them may be the same as theirs.
        if head + tail == old.len() {
            let mut back = 0;
            while back < head
                && new_bytes[head - back - 1] != b'\n'
                && new_bytes[head - back - 1] == new_bytes[after.end - back - 1]
            {
                back += 1;
            }
            if back < head && new_bytes[head - back - 1] == b'\n' {
                after = head - back..after.end - back;
            }
        }
        // A part of the value may be as it was.
        if let Some(value) = place(new, change.key(), None) {
            after = after.start.min(value.start)..after.end.max(value.end);
        }
        let before = after.start..after.end + old.len() - new.len();
        Self { change: change.clone(), before, after }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every mark of a text, after changes, comes from the same mark of the file, or from the change that wrote it.
    #[test]
    fn places_are_those_of_the_file_or_of_a_change() {
        let text = "name = 'a'\r\n[contact]\r\nfriction = 1.00 # μ\r\n[instrument]\r\nkind = 'x'\r\n[sync]\nlast = 7\n";
        let asked = [
            "name=better",
            "contact.friction=1.0",
            "contact.frictoin=2",
            "instrument.device.substeps=3",
            "settle=true",
        ];
        let changes: Vec<Change> = asked.iter().map(|change| change.parse().expect("a change")).collect();
        let source = Source::new(text, Path::new("a.toml"), &changes).expect("TOML");
        let origin = |mark: &str| {
            let start = source.text().rfind(mark).expect("it is there");
            let Origin { source, span, change } = source.origin(start..start + mark.len());
            (source.inner()[span].to_owned(), change.map(|change| change.to_string()), source.name().to_owned())
        };
        for mark in ["[contact]", "friction", "# μ", "[instrument]", "'x'", "[sync]", "last", "7"] {
            assert_eq!(origin(mark), (mark.to_owned(), None, "a.toml".to_owned()), "{mark}\n{}", source.text());
        }
        for (mark, change) in [("\"better\"", 0), ("1.0", 1), ("frictoin", 2), ("2", 2), ("substeps", 3), ("settle", 4)]
        {
            let of_change = (mark.trim_matches('"').to_owned(), Some(asked[change].to_owned()), "change".to_owned());
            assert_eq!(origin(mark), of_change, "{}", source.text());
        }
        assert_eq!(origin("[instrument.device]").1.as_deref(), Some(asked[3]));
    }
}
