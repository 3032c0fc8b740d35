//! The contact surface, prepared once per mesh: its kind, the support of its points, the box tree that searches it, and
//! the Loop limit surface. Nothing in it moves.

pub mod geometry;
pub mod subdivision;
pub mod support;
pub mod tree;
