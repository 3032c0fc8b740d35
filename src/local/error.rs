//! Errors of building a local model.

use thiserror::Error;

use crate::dynamics::implicit::NotSolved;

/// Reason why a local model cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The equations of one tick have no solution, or none that is finite.
    #[error(
        "the {integrator} step of the local model has no finite solution: its matrix of {rows} rows is singular or not finite"
    )]
    NoStep {
        /// Name of the integrator in a scene.
        integrator: &'static str,
        /// Number of rows, 3m.
        rows: usize,
    },
    /// The network that the model is to be built from could not be integrated over the cycle.
    #[error(transparent)]
    NotSolved(#[from] NotSolved),
}
