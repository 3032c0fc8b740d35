//! Verdicts as JUnit's XML, which continuous integration reads.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use crate::output::files::write_file;
use crate::output::verdict::Verdict;

/// Where the verdicts of a command go.
#[derive(Debug, Args)]
pub struct JunitArguments {
    /// Also write the verdicts as JUnit's XML, for continuous integration; INCONCLUSIVE is an error there
    #[arg(long = "junit", value_name = "FILE")]
    file: Option<PathBuf>,
}

/// The verdicts of one run of a command.
pub struct JunitSuite {
    /// The command.
    pub name: &'static str,
    pub cases: Vec<JunitCase>,
}

/// One verdict.
pub struct JunitCase {
    /// What was judged.
    pub name: String,
    /// What it belongs to, such as the scene; names with dots are shown as folders.
    pub class: String,
    /// How long it took to find out, s; `None` if that was not measured for this verdict alone.
    pub seconds: Option<f64>,
    pub verdict: Verdict,
    /// The findings that decide.
    pub reasons: Vec<String>,
}

impl JunitArguments {
    /// Makes ready for the file before anything is computed: makes its folder, and removes the verdicts of an earlier run, which
    /// must not be taken for those of one that fails.
    pub fn prepare(&self) -> miette::Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.map_or(Ok(()), fs::create_dir_all).map_err(|error| cannot_write(file, &error))?;
        match fs::remove_file(file) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(cannot_write(file, &error)),
            _ => Ok(()),
        }
    }

    /// Writes the file whole, if one was asked for.
    pub fn write(&self, suite: impl FnOnce() -> JunitSuite) -> miette::Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        let text = suite().xml().map_err(|error| miette::miette!("the verdicts cannot be written as XML: {error}"))?;
        write_file(file, text.as_bytes()).map_err(|error| cannot_write(file, &error.source))
    }
}

fn cannot_write(file: &Path, error: &io::Error) -> miette::Report {
    miette::miette!(
        help = "give --junit a file in a folder that can be written",
        "cannot write {}: {error}",
        file.display()
    )
}

impl JunitSuite {
    fn xml(self) -> Result<String, quick_junit::SerializeError> {
        let mut suite = TestSuite::new(self.name);
        suite.add_test_cases(self.cases.into_iter().map(JunitCase::element));
        let mut report = Report::new("stickslip");
        report.add_test_suite(suite);
        report.to_string()
    }
}

impl JunitCase {
    fn element(self) -> TestCase {
        let kind = match self.verdict {
            Verdict::Pass => None,
            Verdict::Fail => Some(NonSuccessKind::Failure),
            // A pipeline is red at an error, and green where a case was skipped: what was not decided must not pass.
            Verdict::Inconclusive => Some(NonSuccessKind::Error),
        };
        let status = kind.map_or(TestCaseStatus::success(), |kind| {
            let mut status = TestCaseStatus::non_success(kind);
            status.set_type(self.verdict.name());
            status.set_message(self.reasons.first().map_or("", String::as_str));
            status.set_description(self.reasons.join("\n"));
            status
        });
        let mut case = TestCase::new(self.name, status);
        case.set_classname(self.class);
        if let Some(duration) = self.seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()) {
            case.set_time(duration);
        }
        case
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_verdict_is_counted_and_what_is_not_decided_is_an_error() {
        let case = |name: &str, verdict, reasons: &[&str]| JunitCase {
            name: name.to_owned(),
            class: "stickslip.test".to_owned(),
            seconds: Some(1.5),
            verdict,
            reasons: reasons.iter().map(ToString::to_string).collect(),
        };
        let cases = vec![
            case("good", Verdict::Pass, &["as it has to be"]),
            case("b<a&d>", Verdict::Fail, &["0.3 > \"0.2\"", "a\u{1b}[31m colour"]),
            case("open", Verdict::Inconclusive, &["no clock"]),
            case("silent", Verdict::Fail, &[]),
        ];
        let xml = JunitSuite { name: "test", cases }.xml().expect("XML");
        let document = roxmltree::Document::parse(&xml).unwrap_or_else(|error| panic!("{error}:\n{xml}"));
        let suite = document.descendants().find(|node| node.has_tag_name("testsuite")).expect("a suite");
        let count = |name| suite.attribute(name).and_then(|count| count.parse().ok());
        assert_eq!(["tests", "failures", "errors", "skipped"].map(count), [Some(4), Some(2), Some(1), Some(0)]);
        let cases: Vec<_> = suite.children().filter(|node| node.has_tag_name("testcase")).collect();
        assert_eq!(
            cases.iter().filter_map(|case| case.attribute("name")).collect::<Vec<_>>(),
            ["good", "b<a&d>", "open", "silent"]
        );
        assert!(cases.iter().all(|case| case.attribute("time") == Some("1.500")), "{xml}");
        let inner = |case: usize| cases[case].first_element_child();
        assert!(inner(0).is_none());
        let failure = inner(1).expect("a failure");
        assert_eq!((failure.tag_name().name(), failure.attribute("message")), ("failure", Some("0.3 > \"0.2\"")));
        assert!(failure.text().is_some_and(|text| text.contains("colour")), "{xml}");
        assert_eq!(inner(2).map(|error| error.tag_name().name()), Some("error"));
    }
}
