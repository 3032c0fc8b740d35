//! # stickslip
//!
//! A verification and benchmarking testbed for multi-rate haptic simulation: a nonlinear
//! mass-spring-damper network at about 10 Hz, and beside it a low-order local model that does
//! collision, stick-slip contact and force feedback at 1 kHz, after Jacobs & Çavuşoğlu,
//! *High Fidelity Haptic Rendering of Stick-Slip Frictional Contact With Deformable Objects in
//! Virtual Environments Using Multi-Rate Simulation*. Numbers in parentheses, like (12), are that
//! paper's equations. All quantities are SI and `f64`; axes are right-handed.
//!
//! ## What is public
//!
//! The items at the crate's root: [`Scene`] and what it is built of, [`run`] and [`Simulation`], what a tick shows
//! ([`TickView`], [`TickReport`]), files and their errors, and three doors for custom parts: [`Renderer`],
//! [`Instrument`] and [`ContactLaw`], which [`OwnParts`] and [`Law::Own`] take. The modules are hidden from this page: the
//! tests, benches and the program reach into them, and they may change with every version.
//!
//! ## The path of the data
//!
//! `scene` (with meshes from a `mesh_file`) → `model` (mesh, network) → `surface` (contact surface, once per mesh) → `local`
//! (local model) → `contact` (the tick: detect, constrain, law) → `multirate` (the two sides, global cycle, energy balance,
//! fail-safe) → `device` (instrument, modelled PHANTOM) → `output` (trace, summary, figures). `pipeline` is that path on
//! one page; `verify` judges what comes out of it.
//!
//! ```
//! use stickslip::{Scene, run};
//!
//! let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
//! let mut peak_n = 0.0_f64;
//! run(&scene, |tick| peak_n = peak_n.max(tick.normal_force()))?;
//! assert!(peak_n > 1.0);
//! # Ok::<(), stickslip::RunError>(())
//! ```
//!
//! ## Symbols
//!
//! Kernels use these; public names say the quantity, and its unit where it is not SI.
//!
//! | symbol | shape | unit | meaning |
//! |---|---|---|---|
//! | n, m | – | – | nodes of the full network; free nodes of the local model |
//! | x, v | n × 3 | m, m/s | node positions, velocities |
//! | x₀, v₀ | m × 3 | m, m/s | the state a local model was built from |
//! | M | n, diagonal | kg | lumped node masses; a fixed node has M⁻¹ = 0 |
//! | k, c, L | per spring | N/m, N·s/m, m | stiffness, damping, rest length |
//! | d, ℓ, u, ω | 3, 1, 3, 3 | m, m, –, m/s | spring vector, its length and direction, relative velocity |
//! | f | n × 3 | N | internal and external node forces |
//! | K, D | 3m × 3m | N/m, N·s/m | ∂f/∂x and ∂f/∂v: a stable spring has negative K |
//! | h, H | – | s | local (haptic) tick, global cycle |
//! | q₀, q₁ | 3 | m | instrument tip at the start and the end of a tick |
//! | τ | – | – | time of collision as a fraction of the tick |
//! | w | support | – | weights of the contact point p = Σ wᵢxᵢ, Σ w = 1 |
//! | W | 3 × 3m | – | \[αI βI γI 0 …\]; columns of fixed nodes and of nodes outside the patch are zero |
//! | s | – | – | Σ wᵢgᵢ over free support nodes, g = w (Euclidean) or w/m (mass metric) |
//! | n̂, t̂ | 3 | – | outward unit contact normal; direction of the tangential force |
//! | P, Q, P̃, Q̃ | 3m × 3m | – | the paper's constraint operators (10), (19), (13), (21) |
//! | λ | 3 | N | contact force on the instrument under sticking |
//! | F_N, F_T, μ | – | N, N, – | normal and tangential magnitude of λ; friction coefficient |
#![warn(missing_docs)]
#![deny(unsafe_code)]

mod word;

#[doc(hidden)]
pub mod scene;

#[doc(hidden)]
pub mod mesh_file;

#[doc(hidden)]
pub mod model;

#[doc(hidden)]
pub mod surface;

#[doc(hidden)]
pub mod dynamics;

#[doc(hidden)]
pub mod local;

#[doc(hidden)]
pub mod contact;

#[doc(hidden)]
pub mod device;

#[doc(hidden)]
pub mod external;

#[doc(hidden)]
pub mod multirate;

#[doc(hidden)]
pub mod pipeline;

#[doc(hidden)]
#[cfg(feature = "files")]
pub mod session;

#[doc(hidden)]
#[cfg(all(feature = "realtime", target_os = "linux"))]
pub mod realtime;

#[doc(hidden)]
#[cfg(feature = "files")]
pub mod output;

#[doc(hidden)]
#[cfg(feature = "files")]
pub mod verify;

#[doc(hidden)]
#[cfg(feature = "cli")]
pub mod cli;

pub use contact::law::{ContactLaw, Friction, Impulse, Interface, Law, Mode};
pub use contact::renderer::{
    Body, BodyState, MovedNodes, Rendered, Renderer, RendererFault, RendererModel, Setup, TickCost,
};
pub use contact::report::TickReport;
pub use contact::rules::{ContactRules, Deformation, Scheme, Wall};
pub use device::instrument::{Instrument, InstrumentFault};
pub use device::path::{Interpolation, PathError, TipPath, Waypoint};
pub use external::{LibraryError, RendererLibrary};
pub use model::mesh::{Block, Mesh, Stencil};
pub use model::network::{Material, Network};
pub use multirate::failsafe::{Fault, FaultCause};
#[cfg(feature = "files")]
pub use output::files::{FinishedRun, RunFilesError, run_into};
#[cfg(feature = "files")]
pub use output::summary::Summary;
pub use pipeline::{AssemblyError, Lockstep, OwnParts, RunError, Simulation, TickView, run};
pub use scene::{Change, ChangeError, MeshSource, Problem, Scene, SceneError};
pub use surface::disc::DiscError;
pub use surface::geometry::{ContactPoint, ContactSurface, SurfaceModel};
pub use surface::support::Metric;

/// A point, vector, velocity or force.
pub type Vec3 = nalgebra::Vector3<f64>;
/// A 3 × 3 block of a Jacobian.
pub type Mat3 = nalgebra::Matrix3<f64>;
