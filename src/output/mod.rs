//! Outputs of a run: `trace.csv`, `network.json`, `summary.json`, frames and figures.

pub mod device_facts;
#[cfg(feature = "plots")]
pub mod figures;
pub mod files;
pub mod folder;
pub mod frames;
pub mod measures;
pub mod recording_facts;
pub mod spectrum;
pub mod summary;
pub mod time_steps;
pub mod trace;
pub mod verdict;
pub mod vtk;
pub mod warnings;
