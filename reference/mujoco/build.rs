//! Writes the directory of MuJoCo's shared library into the tests, so that they find it without
//! `LD_LIBRARY_PATH`. An rpath does not propagate from a dependency: it has to be set here.

fn main() {
    const DIRECTORY: &str = "MUJOCO_DYNAMIC_LINK_DIR";
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed={DIRECTORY}");
    match std::env::var(DIRECTORY) {
        Ok(directory) => println!("cargo::rustc-link-arg=-Wl,-rpath,{directory}"),
        Err(_) => println!("cargo::error={DIRECTORY} is not set: run `fetch DIR` and set it to DIR, absolute"),
    }
}
