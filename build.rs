//! Tells the program what it was built with, for the provenance of its reports, and exports its C allocator, which counts,
//! to the libraries that it loads.

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
    // The linker exports by itself only those functions of the allocator that libc refers to.
    if of("CARGO_CFG_TARGET_OS") == "linux"
        && of("CARGO_CFG_TARGET_ENV") == "gnu"
        && var("CARGO_FEATURE_REALTIME").is_ok()
    {
        for function in ["calloc", "realloc", "memalign", "aligned_alloc", "posix_memalign"] {
            println!("cargo::rustc-link-arg-bins=-Wl,--export-dynamic-symbol={function}");
        }
    }
    // Debug builds are for tests, and compiling them again after every commit would only take time.
    if of("PROFILE") == "release"
        && let Some(commit) = commit()
    {
        println!("cargo::rustc-env=STICKSLIP_COMMIT={commit}");
    }
}

/// Returns the commit that is built, with `+` if files that git tracks have changed since; `None` outside of a clone.
fn commit() -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    // The sources of a package may lie within a clone of another repository.
    let is_clone = git(&["rev-parse", "--show-prefix"])?.is_empty();
    let commit = is_clone.then(|| git(&["rev-parse", "--short=12", "HEAD"]))??;
    println!("cargo::rerun-if-changed={}", git(&["rev-parse", "--git-path", "logs/HEAD"])?);
    println!("cargo::rerun-if-changed=src");
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    Some(if changed.is_empty() { commit } else { format!("{commit}+") })
}
