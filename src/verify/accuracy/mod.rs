//! Accuracy of local approximations: a grid of local models, each compared with the whole network at the
//! haptic rate with the same contact code, so that nothing but the local model differs.

mod errors;
mod grid;
mod method;
mod record;

pub use errors::{Assessment, Errors, PERCEPTION, Status, WindowError, front};
pub use grid::{Coverage, Grid, PAPER, PAPER_RATE_HZ, grid};
pub use method::{Method, Names, Touching};
pub(crate) use record::OutsideTick;
pub use record::{ForceRow, REFINEMENT, Record, Reference};
