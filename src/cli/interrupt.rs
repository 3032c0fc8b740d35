//! Ctrl-C and requests to end: they leave no half-written file. A loop in real time ends at its next tick and keeps the ticks done.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::output::folder::remove_unfinished;

/// Exit code of a program that a signal ended, as shells give it for Ctrl-C.
const INTERRUPTED: i32 = 130;

static STOP: AtomicBool = AtomicBool::new(false);
static ENDS_BY_ITSELF: AtomicBool = AtomicBool::new(false);

/// Listens for signals, once per process.
pub fn listen() {
    // Where another part of the process listens already, it decides.
    let _ = ctrlc::set_handler(|| {
        let is_first = !STOP.swap(true, Ordering::Relaxed);
        if !(is_first && ENDS_BY_ITSELF.load(Ordering::Relaxed)) {
            remove_unfinished();
            std::process::exit(INTERRUPTED);
        }
    });
}

/// Returns the flag that the first signal sets, for work that looks at it and ends by itself. The second signal ends the program at
/// once.
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub fn flag() -> &'static AtomicBool {
    ENDS_BY_ITSELF.store(true, Ordering::Relaxed);
    &STOP
}
