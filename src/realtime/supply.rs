//! Supply of passes: each is prepared while the one before it runs, on a thread of ordinary priority, which also takes
//! passes back from the servo thread when they are over. Neither thread waits for the other.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};

use super::builder::ToGlobal;
use super::exercise::Exercise;
use super::threads::Pass;
use crate::session::RecordedPass;

/// Largest number of finished passes that wait to be taken back.
const TAKEN_BACK: usize = 8;

/// The servo thread's end.
pub(super) struct Upcoming {
    prepared: Consumer<Pass>,
    over: Producer<Pass>,
    is_exhausted: Arc<AtomicBool>,
}

/// The preparing thread's end.
pub(super) struct Preparer {
    prepared: Producer<Pass>,
    over: Consumer<Pass>,
    is_exhausted: Arc<AtomicBool>,
}

/// What follows a pass that is over.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Next {
    /// The next pass has taken its place.
    Pass,
    /// The next pass is not prepared yet.
    NotYet,
    /// There is no further pass.
    End,
}

/// Finished passes.
#[derive(Debug, Default)]
pub(super) struct Over {
    pub passes: Vec<RecordedPass>,
    pub exercise: Exercise,
}

impl Over {
    /// Adds a pass, with its number in order.
    pub fn add(&mut self, pass: Pass) {
        self.exercise.add(&pass.exercise);
        self.passes.push(pass.into_recorded(self.passes.len() as u32));
    }
}

/// Builds both ends.
pub(super) fn supply() -> (Upcoming, Preparer) {
    // One ahead: the next one is prepared when the last has been taken.
    let (prepared_up, prepared) = RingBuffer::new(1);
    let (over, over_down) = RingBuffer::new(TAKEN_BACK);
    let is_exhausted = Arc::new(AtomicBool::new(false));
    (
        Upcoming { prepared, over, is_exhausted: is_exhausted.clone() },
        Preparer { prepared: prepared_up, over: over_down, is_exhausted },
    )
}

impl Upcoming {
    /// Exchanges a pass that is over for the next one. Allocates nothing, frees nothing.
    pub fn exchange(&mut self, pass: &mut Pass) -> Next {
        // The flag is read first, so that a pass that was prepared before the flag was set is still seen.
        let is_exhausted = self.is_exhausted.load(Ordering::Acquire);
        if self.over.is_full() {
            return Next::NotYet;
        }
        match self.prepared.pop() {
            Ok(next) => {
                let returned = self.over.push(std::mem::replace(pass, next));
                debug_assert!(returned.is_ok(), "there was room for it");
                Next::Pass
            }
            Err(_) if is_exhausted => Next::End,
            Err(_) => Next::NotYet,
        }
    }
}

impl Preparer {
    /// Prepares passes from the second on and takes back those that are over, until `done`.
    pub fn run(
        mut self,
        mut passes: impl Iterator<Item = Pass>,
        to_global: &Sender<ToGlobal>,
        idle: Duration,
        done: &AtomicBool,
    ) -> Over {
        let (mut over, mut number) = (Over::default(), 1);
        loop {
            let is_done = done.load(Ordering::Acquire);
            while let Ok(pass) = self.over.pop() {
                over.add(pass);
            }
            if is_done {
                return over;
            }
            if self.is_exhausted.load(Ordering::Relaxed) || self.prepared.is_full() {
                std::thread::sleep(idle);
            } else if let Some(mut pass) = passes.next() {
                send_side(number, &mut pass, to_global);
                number += 1;
                let sent = self.prepared.push(pass);
                debug_assert!(sent.is_ok(), "there was room for it");
            } else {
                self.is_exhausted.store(true, Ordering::Release);
            }
        }
    }
}

/// Sends a pass's global side ahead of its cycles.
pub(super) fn send_side(number: u32, pass: &mut Pass, to_global: &Sender<ToGlobal>) {
    if let Some(side) = pass.take_global() {
        // If the receiver is gone, the loop is ending.
        let _ = to_global.send(ToGlobal::Side { pass: number, side: Box::new(side), ticks: pass.ticks() });
    }
}
