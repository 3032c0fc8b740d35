//! A progress bar on standard error for work that takes longer than two seconds. There is none if standard error is
//! not a terminal.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::terminal::shows_progress;

/// Shortest work with a progress bar.
const PATIENCE: Duration = Duration::from_secs(2);

/// Progress of one or several runs.
pub struct Progress {
    bar: ProgressBar,
    start: Instant,
    shown: bool,
    done_before: u64,
}

impl Progress {
    /// Starts the count of `count` items in all; `unit` is their plural name.
    pub fn new(count: u64, unit: &str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(count), ProgressDrawTarget::hidden());
        if let Ok(style) =
            ProgressStyle::with_template(&format!("{{msg}} {{wide_bar}} {{pos}}/{{len}} {unit}, {{eta}} left"))
        {
            bar.set_style(style);
        }
        Self { bar, start: Instant::now(), shown: false, done_before: 0 }
    }

    /// Begins the next run.
    pub fn begin(&mut self, name: &str) {
        self.bar.set_message(name.to_owned());
    }

    /// Sets the number of items done in this run.
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

    /// Ends this run: all its `planned` items count as done, even if it ended early.
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
