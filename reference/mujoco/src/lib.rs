//! # stickslip compared with MuJoCo
//!
//! An independent simulator is given the same network, contact point and loads:
//! [`mjcf`] writes a network as a MuJoCo model, [`Reference`] runs it, [`samples`] makes the
//! networks, states and contact points that the two are compared on, and [`residual`] says by how
//! much they differ. The comparisons themselves are in `tests/`. To run them, from the root of the
//! repository:
//!
//! ```sh
//! MUJOCO_DYNAMIC_LINK_DIR=$(reference/mujoco/fetch target/mujoco)
//! export MUJOCO_DYNAMIC_LINK_DIR
//! cargo test --locked --package stickslip-mujoco -- --show-output
//! ```
//!
//! A line `RESIDUAL | mujoco | quantity | tolerance | measured` belongs to every comparison (its
//! tolerance is `-` where there is nothing to pass), one that begins with `CONTROL` to every
//! deliberate mistake, whose measure has to be beyond the tolerance.

pub mod mjcf;
pub mod residual;
pub mod samples;

mod reference;

pub use reference::Reference;
