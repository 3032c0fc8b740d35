//! Ctrl-C: ends a loop in real time at its next tick and keeps the ticks done.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use miette::{IntoDiagnostic, WrapErr};

static STOP: AtomicBool = AtomicBool::new(false);
static HANDLER: Once = Once::new();

/// Returns the flag that the first Ctrl-C sets. The second one ends the program at once.
pub fn flag() -> miette::Result<&'static AtomicBool> {
    let mut installed = Ok(());
    HANDLER.call_once(|| {
        installed = ctrlc::set_handler(|| {
            if STOP.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
        });
    });
    installed.into_diagnostic().wrap_err("cannot listen for Ctrl-C")?;
    Ok(&STOP)
}
