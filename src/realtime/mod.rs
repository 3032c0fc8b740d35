//! Real-time runs on Linux: the servo loop on a thread of its own against the clock, the global cycle on another, and
//! time measurements of every tick.
//!
//! Once its window has begun, the servo thread allocates nothing, locks nothing and makes no system call but the clock
//! and the sleep; only after a deadline miss does it read its own counters. Models reach it through a triple buffer,
//! the patch's path leaves through a ring ([`channel`]); neither ever makes it wait. Passes are prepared and freed on
//! another thread.

pub mod allocations;
pub mod builder;
pub mod channel;
pub mod exercise;
pub mod load;
pub mod machine;
pub mod meter;
pub mod os;
pub mod power;
pub mod record;
mod supply;
pub mod threads;
