//! Extension point for custom renderers: tip positions in, forces out, over a body that deforms.
//!
//! A [`Renderer`] lives on the global side and builds a [`RendererModel`] from the network's state at every hand-over;
//! the model lives on the servo side and renders ticks until the next one takes over. Contact, local model and friction
//! law are then the renderer's own; the scene's local model and scheme are not used.

use std::any::Any;
use std::fmt;

use dyn_clone::DynClone;
use thiserror::Error;

use crate::Vec3;
use crate::contact::law::{Law, Mode};
use crate::model::network::Network;
use crate::surface::geometry::{ContactPoint, ContactSurface, SurfaceModel};

/// The body as a renderer sees it, constant within a run.
#[derive(Debug, Clone, Copy)]
pub struct Body<'a> {
    /// Nodes, masses and springs.
    pub network: &'a Network,
    /// The boundary triangles, and the contact surface that the scene requests.
    pub surface: &'a SurfaceModel,
}

/// What a scene asks of its renderer, constant within a run.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    /// Time between two ticks, s.
    pub tick_s: f64,
    /// Time between two models, s.
    pub cycle_s: f64,
    /// Law of contact.
    pub law: Law,
    /// Largest pulling force of a contact, N; may be infinite under [`Law::Sticking`].
    pub adhesion_n: f64,
    /// The surface that the tip touches.
    pub surface: ContactSurface,
    /// Radius of the disc over which a contact is spread, m; 0 for a point.
    pub radius_m: f64,
}

/// State of the network at a hand-over.
#[derive(Debug, Clone, Copy)]
pub struct BodyState<'a> {
    /// Number of the first tick after this state, from 0.
    pub tick: u64,
    /// Node positions, m.
    pub x: &'a [Vec3],
    /// Node velocities, m/s.
    pub v: &'a [Vec3],
    /// Position of the tip, m.
    pub tip: Vec3,
    /// Result of the renderer's last tick before this state; [`Rendered::FREE`] before the first.
    pub last: Rendered,
}

/// Result of a renderer's tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rendered {
    /// Force on the instrument, N.
    pub force: Vec3,
    /// Mode of the contact.
    pub mode: Mode,
    /// Contact point and its outward unit normal; `None` when free. Without [`moved`](RendererModel::moved), the
    /// opposite of the force acts on the network at this point.
    pub contact: Option<(ContactPoint, Vec3)>,
}

impl Rendered {
    /// A result without contact and force.
    pub const FREE: Self = Self { force: Vec3::new(0.0, 0.0, 0.0), mode: Mode::Free, contact: None };
}

/// What a tick cost, as measured in the process that rendered it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TickCost {
    /// Time of the call, ns.
    pub nanoseconds: u64,
    /// Calls of the allocator in it, freeing included, where they are counted.
    pub allocations: Option<u64>,
}

/// Reason why a renderer cannot go on. It ends the run with a named fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the renderer failed: {0}")]
pub struct RendererFault(pub &'static str);

impl RendererFault {
    /// Returns a fault with a text that is only known at run time. The text stays in memory for the life of the
    /// process, so that faults can be copied without allocation: there is one of them in a run.
    pub fn with_text(text: String) -> Self {
        Self(Box::leak(text.into_boxed_str()))
    }
}

/// Nodes that a renderer moves itself, with their positions and velocities: three slices of equal length.
#[derive(Debug, Clone, Copy)]
pub struct MovedNodes<'a> {
    /// Node indices.
    pub nodes: &'a [u32],
    /// Positions, m.
    pub x: &'a [Vec3],
    /// Velocities, m/s.
    pub v: &'a [Vec3],
}

/// A custom renderer, on the global side.
///
/// Contract: it is clonable and `Send`, since runs are copied and moved between threads; the copy of a renderer that
/// cannot be copied may answer every call with a fault. It is deterministic: equal states give models that render the
/// same forces to the bit. It may allocate and take its time: only the next model waits for it. In real time, `build` is
/// called on another thread than the ticks of its models, while they run.
///
/// ```
/// use stickslip::{Body, BodyState, Mode, OwnParts, Rendered, Renderer, RendererFault, RendererModel, Scene, Simulation, Vec3};
///
/// /// A rigid half-space below z = 0, rendered as a spring.
/// #[derive(Debug, Clone)]
/// struct Floor {
///     stiffness_n_per_m: f64,
/// }
/// impl Renderer for Floor {
///     fn build(&mut self, _: Body<'_>, _: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
///         Ok(Box::new(self.clone()))
///     }
/// }
/// impl RendererModel for Floor {
///     fn tick(&mut self, _before: Vec3, tip: Vec3) -> Result<Rendered, RendererFault> {
///         let force = Vec3::z() * (-tip.z * self.stiffness_n_per_m).max(0.0);
///         Ok(if force.z > 0.0 { Rendered { force, mode: Mode::Slide, contact: None } } else { Rendered::FREE })
///     }
/// }
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program"); // pressed in by 3 mm
/// let own = OwnParts { renderer: Some(Box::new(Floor { stiffness_n_per_m: 200.0 })), ..OwnParts::default() };
/// let mut peak_n = 0.0_f64;
/// Simulation::prepare_with(&scene, own)?.run(|tick| peak_n = peak_n.max(tick.force.z))?;
/// assert!((peak_n - 0.6).abs() < 1e-12);
/// # Ok::<(), stickslip::RunError>(())
/// ```
pub trait Renderer: DynClone + fmt::Debug + Send {
    /// Prepares for a body. Called once, before the first model is built.
    ///
    /// # Errors
    /// If the renderer does not take the body or the setup; the scene cannot start.
    fn create(&mut self, _body: Body<'_>, _setup: &Setup) -> Result<(), RendererFault> {
        Ok(())
    }

    /// Builds a model from the network's state at a hand-over, ready for ticks.
    ///
    /// # Errors
    /// If no model can be built; the run ends with a named fault.
    fn build(&mut self, body: Body<'_>, state: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault>;
}

dyn_clone::clone_trait_object!(Renderer);

/// The model of a custom renderer, on the servo side between two hand-overs.
///
/// Contract: it is clonable and `Send`; a tick allocates nothing, locks nothing and does no I/O, and depends only on
/// its arguments and the ticks before. A force that is not finite never reaches the instrument: it ends the run.
pub trait RendererModel: Any + DynClone + fmt::Debug + Send {
    /// Goes on from where the model in use has stopped; `None` for the first model of a run. Called once, before the
    /// first tick; the old model returns to the global side and is freed there.
    fn take_over(&mut self, _old: Option<&mut dyn RendererModel>) {}

    /// Renders one tick, in which the tip moves from `before` to `tip`, m.
    ///
    /// # Errors
    /// If the renderer cannot go on; the fault ends the run.
    fn tick(&mut self, before: Vec3, tip: Vec3) -> Result<Rendered, RendererFault>;

    /// Returns the nodes that the last tick has moved, for the global side, which prescribes them; the set may change
    /// only at a hand-over. With `None`, the opposite of the force moves the network at the contact point. Before the
    /// first tick only the choice between the two counts.
    fn moved(&self) -> Option<MovedNodes<'_>> {
        None
    }

    /// Returns what the last tick cost where the renderer runs in another process, and a clock here would measure the way
    /// there and back.
    fn own_cost(&self) -> Option<TickCost> {
        None
    }
}

dyn_clone::clone_trait_object!(RendererModel);
