//! The full network alone: mesh, surface topology, material, springs and state.

pub mod columns;
pub mod material;
pub mod mesh;
pub mod network;
pub mod search;
pub(crate) mod simd;
pub mod springs;
pub mod state;
pub mod topology;
pub mod work;
