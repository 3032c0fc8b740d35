//! Why there is no local model.

use thiserror::Error;

use crate::dynamics::implicit::NotSolved;

/// Why a local model cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ModelError {
    /// The equations of one tick have no solution, or none that is finite.
    #[error(
        "the {integrator} step of the local model has no finite solution: its matrix of {rows} rows is singular or not finite"
    )]
    NoStep {
        /// Its name in a scene.
        integrator: &'static str,
        /// 3m.
        rows: usize,
    },
    /// The network it is to be built from was not brought over the cycle.
    #[error(transparent)]
    NotSolved(#[from] NotSolved),
}
