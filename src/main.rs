//! The `stickslip` program.

use std::process::ExitCode;

/// So that a certificate can say how often the servo thread allocated.
#[cfg(all(feature = "realtime", target_os = "linux"))]
#[global_allocator]
static ALLOCATOR: stickslip::realtime::allocations::Counting = stickslip::realtime::allocations::Counting;

fn main() -> ExitCode {
    stickslip::cli::main(std::env::args_os())
}
