//! Held against what was accepted before: results of a run, the baselines they are compared with,
//! and times of two programs. And held against each other: contact surfaces and schemes, local models.

pub mod accept;
pub mod accuracy;
pub mod baseline;
pub mod compare;
pub mod paired;
pub mod results;
pub mod surfaces;
