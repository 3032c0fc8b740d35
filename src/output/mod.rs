//! What a run leaves behind: `trace.csv`, `network.json`, `summary.json` and the force plot.

#[cfg(feature = "plots")]
mod axes;
pub mod files;
pub mod frames;
#[cfg(all(feature = "plots", feature = "realtime", target_os = "linux"))]
pub mod latency;
#[cfg(feature = "plots")]
pub mod limits;
pub mod measures;
#[cfg(feature = "plots")]
pub mod plots;
#[cfg(feature = "plots")]
pub mod precision;
#[cfg(feature = "plots")]
pub mod refinement;
pub mod spectrum;
pub mod summary;
pub mod trace;
pub mod vtk;
#[cfg(feature = "plots")]
pub mod z_width;
