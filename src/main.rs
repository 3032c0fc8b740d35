//! The `stickslip` program.

use std::process::ExitCode;

/// So that a certificate can state how often the servo thread allocated, in Rust and in C.
#[cfg(all(feature = "realtime", target_os = "linux", target_env = "gnu"))]
mod malloc;

/// Without glibc, a certificate states how often the servo thread allocated in Rust alone.
#[cfg(all(feature = "realtime", target_os = "linux", not(target_env = "gnu")))]
#[global_allocator]
static ALLOCATOR: stickslip::realtime::allocations::Counting = stickslip::realtime::allocations::Counting;

fn main() -> ExitCode {
    stickslip::cli::main(std::env::args_os())
}
