//! Ctrl-C and termination requests. They leave no half-written file; a loop in real time ends at its next tick and keeps
//! the completed ticks.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::output::folder::remove_unfinished;

/// Exit code after a signal, as shells report it for Ctrl-C.
const INTERRUPTED: i32 = 130;

static STOP: AtomicBool = AtomicBool::new(false);
static ENDS_BY_ITSELF: AtomicBool = AtomicBool::new(false);

/// Listens for signals, once per process.
pub fn listen() {
    // If another part of the process handles signals already, its handler stays.
    let _ = ctrlc::set_handler(|| {
        let is_first = !STOP.swap(true, Ordering::Relaxed);
        if !(is_first && ENDS_BY_ITSELF.load(Ordering::Relaxed)) {
            remove_unfinished();
            std::process::exit(INTERRUPTED);
        }
    });
}

/// Returns the flag that the first signal sets, for work that polls it and ends on its own. The second signal ends the
/// program at once.
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub fn flag() -> &'static AtomicBool {
    ENDS_BY_ITSELF.store(true, Ordering::Relaxed);
    &STOP
}
