//! Tells the program what it was built with, for the provenance of its reports.

use std::env::var;
use std::process::Command;

fn main() {
    let version = Command::new(var("RUSTC").unwrap_or_else(|_| "rustc".to_owned())).arg("--version").output();
    let version = version.ok().map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    let of = |name: &str| var(name).unwrap_or_else(|_| "not told".to_owned());
    println!(
        "cargo::rustc-env=STICKSLIP_BUILD={}, {}, optimisation {}",
        version.unwrap_or_else(|| "not told".to_owned()),
        of("TARGET"),
        of("OPT_LEVEL")
    );
    println!("cargo::rerun-if-changed=build.rs");
}
