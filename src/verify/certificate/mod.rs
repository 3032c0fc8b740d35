//! Statistics of a real-time certificate: bounds for ticks that were not measured, from a run's misses and responses,
//! and the cause of each miss. All are pure functions of plain numbers.

pub mod bounds;
pub mod causes;
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub mod identity;
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub mod log;
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub mod parts;
pub mod tail;
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub mod verdict;
