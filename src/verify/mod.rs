//! Verification: baselines, the results of a run that are compared with them, and paired timings of two programs;
//! comparisons of contact surfaces and schemes, of local models, and of springs with the elastic solid; extreme scenes
//! with their expected outcomes; stability-limit time steps and limits of virtual walls, measured and predicted;
//! observed orders; certificates of deadlines; force traces of other programs, judged.

pub mod accept;
pub mod accuracy;
pub mod baseline;
pub mod buzz;
pub mod certificate;
pub mod compare;
pub mod conformance;
pub mod contact_limits;
pub mod elasticity;
pub mod extremes;
pub mod judge;
pub mod lateness;
pub mod orders;
pub mod paired;
pub mod path_stability;
pub mod rendered;
pub mod residual;
pub mod results;
pub mod short_reference;
pub mod stability_map;
pub mod suite;
pub mod surfaces;
pub mod tetrahedral_block;
pub mod z_width;
