//! Errors of a sparse factorisation.

use faer::sparse::linalg::{LltError, LuError};
use faer::sparse::{CreationError, FaerError};
use thiserror::Error;

/// Why a sparse system has no solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The matrix is singular, not definite where it has to be, or the solution is not finite.
    #[error("the matrix is singular or not finite")]
    Singular,
    /// The factor does not fit into memory.
    #[error("the factor of a matrix of {rows} rows does not fit into memory; give fewer nodes")]
    OutOfMemory {
        /// Number of rows.
        rows: usize,
    },
}

impl SolveError {
    /// Returns the error of a factorisation of this many rows: an index that overflows is beyond any memory too.
    pub(super) fn of_memory(_: FaerError, rows: usize) -> Self {
        Self::OutOfMemory { rows }
    }

    pub(super) fn of_lu(error: LuError, rows: usize) -> Self {
        match error {
            LuError::SymbolicSingular { .. } => Self::Singular,
            LuError::Generic(error) => Self::of_memory(error, rows),
        }
    }

    pub(super) fn of_llt(error: LltError, rows: usize) -> Self {
        match error {
            LltError::Numeric(_) => Self::Singular,
            LltError::Generic(error) => Self::of_memory(error, rows),
        }
    }

    pub(super) fn of_creation(error: CreationError, rows: usize) -> Self {
        match error {
            CreationError::Generic(error) => Self::of_memory(error, rows),
            CreationError::OutOfBounds { .. } => Self::Singular,
        }
    }
}
