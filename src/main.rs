//! The `stickslip` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    stickslip::cli::main()
}
