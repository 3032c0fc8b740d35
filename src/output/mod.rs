//! What a run leaves behind: `trace.csv`, `network.json`, `summary.json` and the force plot.

pub mod files;
#[cfg(feature = "plots")]
pub mod limits;
#[cfg(feature = "plots")]
pub mod plots;
pub mod spectrum;
pub mod summary;
pub mod trace;
