//! A progress bar on standard error for what takes longer than two seconds; none if that is not a
//! terminal.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::terminal::shows_progress;

/// Work shorter than this goes without.
const PATIENCE: Duration = Duration::from_secs(2);

/// Counts what is done of one or several runs.
pub struct Progress {
    bar: ProgressBar,
    start: Instant,
    shown: bool,
    done_before: u64,
}

impl Progress {
    /// For this many in all of what is counted, of which `unit` is the name.
    pub fn new(count: u64, unit: &str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(count), ProgressDrawTarget::hidden());
        if let Ok(style) =
            ProgressStyle::with_template(&format!("{{msg}} {{wide_bar}} {{pos}}/{{len}} {unit}, {{eta}} left"))
        {
            bar.set_style(style);
        }
        Self { bar, start: Instant::now(), shown: false, done_before: 0 }
    }

    /// The next run begins.
    pub fn begin(&mut self, name: &str) {
        self.bar.set_message(name.to_owned());
    }

    /// What is done of this run.
    pub fn set(&mut self, done: u64) {
        self.show();
        self.bar.set_position(self.done_before + done);
    }

    fn show(&mut self) {
        if !self.shown && self.start.elapsed() > PATIENCE {
            if shows_progress() {
                self.bar.set_draw_target(ProgressDrawTarget::stderr());
            }
            self.shown = true;
        }
    }

    /// This run ended after what was planned, or before.
    pub fn end(&mut self, planned: u64) {
        self.show();
        self.done_before += planned;
        self.bar.set_position(self.done_before);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
