//! Figures as SVG documents.

mod axes;
pub mod forces;
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub mod latency;
pub mod limits;
pub mod precision;
pub mod refinement;
pub mod z_width;
