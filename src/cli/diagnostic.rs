//! Layout of error messages. Control characters from files do not reach the terminal, and long source lines are truncated
//! to a readable length.

use std::error::Error;
use std::fmt;

use miette::{
    Diagnostic, LabeledSpan, MietteError, MietteHandlerOpts, MietteSpanContents, ReportHandler, Severity, SourceCode,
    SourceSpan, SpanContents,
};
use textwrap::WordSplitter;

/// Largest number of characters shown of a source line.
const LONGEST_LINE: usize = 160;
/// Largest number of characters shown of a message.
const LONGEST_MESSAGE: usize = 2000;
/// Number of characters shown before the marked place in a truncated line.
const BEFORE: usize = 60;
/// Mark of a truncation.
const CUT: &str = "…";

/// Returns the handler that lays out an error. It does not break hyphenated names, so that they can be copied, and does not
/// repeat a cause that the message already contains.
pub fn layout(error: &(dyn Diagnostic + 'static)) -> Box<dyn ReportHandler> {
    let options = MietteHandlerOpts::new().word_splitter(WordSplitter::NoHyphenation).break_words(false);
    let is_told = error.source().is_some_and(|cause| error.to_string().contains(&cause.to_string()));
    let inner = if is_told { options.without_cause_chain() } else { options }.build();
    Box::new(Printable(Box::new(inner)))
}

/// Replaces control characters except newline and tab with the replacement character U+FFFD.
///
/// Escape sequences in a file could otherwise change the colours, title or text of the terminal that shows a message about
/// it.
pub fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() && !matches!(c, '\n' | '\t') { '\u{fffd}' } else { c }).collect()
}

/// Makes a message printable, and truncates a very long one, such as one that quotes an endless word.
fn message(text: &str) -> String {
    let mut message = printable(&text.chars().take(LONGEST_MESSAGE).collect::<String>());
    if text.chars().count() > LONGEST_MESSAGE {
        message += CUT;
    }
    message
}

/// A handler that makes errors printable before another lays them out.
struct Printable(Box<dyn ReportHandler>);

impl ReportHandler for Printable {
    fn debug(&self, error: &dyn Diagnostic, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.debug(&Clean::new(error), f)
    }
}

/// A printable copy of an error with its causes.
#[derive(Debug)]
struct Clean {
    message: String,
    help: Option<String>,
    code: Option<String>,
    severity: Option<Severity>,
    excerpt: Option<(Excerpt, LabeledSpan)>,
    cause: Option<Cause>,
}

#[derive(Debug)]
struct Cause {
    message: String,
    cause: Option<Box<Cause>>,
}

impl Cause {
    fn of(error: &(dyn Error + 'static)) -> Self {
        Self { message: message(&error.to_string()), cause: error.source().map(|cause| Box::new(Self::of(cause))) }
    }
}

impl Clean {
    fn new(error: &dyn Diagnostic) -> Self {
        let text = |of: Option<Box<dyn fmt::Display + '_>>| of.map(|text| message(&text.to_string()));
        // The errors of this program mark one place each.
        let label = error.labels().and_then(|mut labels| labels.next());
        Self {
            message: message(&error.to_string()),
            help: text(error.help()),
            code: text(error.code()),
            severity: error.severity(),
            excerpt: error.source_code().zip(label).and_then(|(source, label)| Excerpt::of(source, &label)),
            cause: error.source().map(Cause::of),
        }
    }
}

impl fmt::Display for Clean {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Error for Clean {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.cause.as_ref().map(|cause| cause as &dyn Error)
    }
}

impl Diagnostic for Clean {
    fn code<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.code.as_ref().map(|code| Box::new(code) as Box<dyn fmt::Display>)
    }

    fn severity(&self) -> Option<Severity> {
        self.severity
    }

    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.excerpt.as_ref().map(|(excerpt, _)| excerpt as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let (_, label) = self.excerpt.as_ref()?;
        Some(Box::new(std::iter::once(label.clone())))
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Error for Cause {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.cause.as_deref().map(|cause| cause as &dyn Error)
    }
}

/// The lines around a place in a file, truncated to a readable length.
#[derive(Debug)]
struct Excerpt {
    name: Option<String>,
    text: String,
    /// Line of the file with which the text begins, from 0.
    first_line: usize,
    /// Line and column of the place in the file, from 0.
    place: [usize; 2],
    lines: usize,
}

impl Excerpt {
    /// Returns the lines around a label, and the label's place within them.
    fn of(source: &dyn SourceCode, label: &LabeledSpan) -> Option<(Self, LabeledSpan)> {
        let around = source.read_span(label.inner(), 1, 1).ok()?;
        let exact = source.read_span(label.inner(), 0, 0).ok()?;
        let text = std::str::from_utf8(around.data()).ok()?;
        let start = label.offset().checked_sub(around.span().offset())?;
        let (mut cut, mut offset, mut length, mut at) = (String::new(), 0, 0, 0);
        for line in text.split_inclusive('\n') {
            let (content, end) = (line.trim_end_matches(['\r', '\n']), line.len());
            let is_marked = (at..at + end).contains(&start) || (start == at + end && at + end == text.len());
            let inside = if is_marked { start - at } else { 0 };
            let before = content.get(..inside.min(content.len())).unwrap_or_default();
            // Lines that fit stay whole; a longer line is truncated to the part around the label.
            let skipped = match content.chars().count() > LONGEST_LINE {
                true => before.chars().count().saturating_sub(BEFORE),
                false => 0,
            };
            let kept: String = content.chars().skip(skipped).take(LONGEST_LINE).collect();
            if is_marked {
                let shown: String = before.chars().skip(skipped).collect();
                offset = cut.len() + if skipped > 0 { CUT.len() } else { 0 } + printable(&shown).len();
                let marked = content.get(inside.min(content.len())..).unwrap_or_default();
                let marked: String =
                    marked.chars().take(LONGEST_LINE - shown.chars().count().min(LONGEST_LINE)).collect();
                let marked = marked.get(..label.len().min(marked.len())).unwrap_or(&marked).to_owned();
                length = printable(&marked).len();
            }
            let is_cut_after = content.chars().count() > skipped + LONGEST_LINE;
            let [head, tail] = [skipped > 0, is_cut_after].map(|is_cut| if is_cut { CUT } else { "" });
            cut += &format!("{head}{}{tail}\n", printable(&kept));
            at += end;
        }
        let excerpt = Self {
            name: around.name().or(exact.name()).map(printable),
            lines: cut.lines().count(),
            text: cut,
            first_line: around.line(),
            place: [exact.line(), exact.column()],
        };
        let label =
            LabeledSpan::new_primary_with_span(label.label().map(printable), SourceSpan::from((offset, length)));
        Some((excerpt, label))
    }
}

impl SourceCode for Excerpt {
    /// Returns the whole excerpt with the number of its first line, or the marked place alone if no lines around it are
    /// requested.
    fn read_span<'a>(
        &'a self,
        span: &SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn SpanContents<'a> + 'a>, MietteError> {
        let whole = SourceSpan::from((0, self.text.len()));
        let (span, line, column) = match (before, after) {
            (0, 0) => (*span, self.place[0], self.place[1]),
            _ => (whole, self.first_line, 0),
        };
        let data =
            self.text.as_bytes().get(span.offset()..span.offset() + span.len()).ok_or(MietteError::OutOfBounds)?;
        Ok(Box::new(match &self.name {
            Some(name) => MietteSpanContents::new_named(name.clone(), data, span, line, column, self.lines),
            None => MietteSpanContents::new(data, span, line, column, self.lines),
        }))
    }
}

#[cfg(test)]
mod tests {
    use miette::NamedSource;

    use super::*;

    fn excerpt(text: &str, place: &str) -> (Excerpt, String) {
        let offset = text.find(place).expect("it is there");
        let label = LabeledSpan::new_primary_with_span(None, (offset, place.len()));
        let source = NamedSource::new("a\u{1b}[31m.toml", text.to_owned());
        let (excerpt, label) = Excerpt::of(&source, &label).expect("an excerpt");
        let marked = excerpt.text[label.offset()..label.offset() + label.len()].to_owned();
        (excerpt, marked)
    }

    #[test]
    fn long_lines_are_cut_around_what_is_wrong() {
        let long = "x".repeat(100_000);
        let (excerpt, marked) = excerpt(&format!("first\nkey = \"{long}\" = wrong # {long}\nlast {long}\n"), "wrong");
        assert_eq!((marked.as_str(), excerpt.first_line, excerpt.place), ("wrong", 0, [1, 100_011]));
        assert!(excerpt.text.lines().all(|line| line.chars().count() <= LONGEST_LINE + 2), "{}", excerpt.text);
        assert!(excerpt.text.starts_with("first\n…xxx"), "{}", excerpt.text);
    }

    #[test]
    fn control_characters_are_replaced() {
        let (excerpt, marked) = excerpt("ä\u{1b}[2J = \u{9b}1\u{7}wrong", "\u{7}wrong");
        assert_eq!(
            (excerpt.text.as_str(), marked.as_str()),
            ("ä\u{fffd}[2J = \u{fffd}1\u{fffd}wrong\n", "\u{fffd}wrong")
        );
        assert_eq!(excerpt.name.as_deref(), Some("a\u{fffd}[31m.toml"));
    }
}
