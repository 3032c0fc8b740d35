//! The statistics of a real-time certificate: what a run's misses and responses say of the ticks that were not
//! measured, and what each miss was due to. Pure functions of plain numbers.

pub mod bounds;
pub mod causes;
pub mod tail;
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub mod verdict;
