//! The contact surface, prepared once per mesh: its kind, the support of its points, the box tree that searches it, the Loop
//! limit surface, and the discs over which a contact is spread. Nothing in it moves.

pub mod disc;
pub mod geometry;
pub mod subdivision;
pub mod support;
pub mod tree;
