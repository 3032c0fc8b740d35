//! Held against what was accepted before: results of a run, the baselines they are compared with,
//! and times of two programs. And held against each other: contact surfaces and schemes, local models;
//! extreme scenes and the outcomes expected of them; limits of steps and of virtual walls, measured and predicted;
//! observed orders.

pub mod accept;
pub mod accuracy;
pub mod baseline;
pub mod certificate;
pub mod compare;
pub mod elasticity;
pub mod extremes;
pub mod lateness;
pub mod orders;
pub mod paired;
pub mod residual;
pub mod results;
pub mod stability_map;
pub mod surfaces;
pub mod tetrahedral_block;
pub mod z_width;
