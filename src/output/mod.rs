//! Outputs of a run: `trace.csv`, `network.json`, `summary.json`, frames and figures.

#[cfg(feature = "plots")]
pub mod figures;
pub mod files;
pub mod frames;
pub mod measures;
pub mod spectrum;
pub mod summary;
pub mod trace;
pub mod vtk;
