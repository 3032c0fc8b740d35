//! The three contact constraints: the force on the instrument, and the motion of the mesh.

use std::fmt;

use crate::surface::support::Support;
use crate::{Mat3, Vec3};

/// The constraint between the tip and the surface.
///
/// ```
/// use stickslip::{Mat3, Vec3, contact::law::{Friction, Interface, Law, Mode}};
///
/// let law = Law::StickSlip { friction: 0.5.into() };
/// let normal = Vec3::z();
/// let gentle = Vec3::new(0.3, 0.0, 1.0); // F_T < μF_N
/// assert_eq!(law.contact_force(gentle, normal, Interface::NEW), (Mode::Stick, gentle));
/// let hard = Vec3::new(0.8, 0.0, 1.0);
/// let (mode, force) = law.contact_force(hard, normal, Interface::NEW);
/// assert_eq!(mode, Mode::Slip);
/// assert!((force - Vec3::new(0.5, 0.0, 1.0)).norm() < 1e-15); // F_T = μF_N
/// assert_eq!(Law::Sliding.contact_force(hard, normal, Interface::NEW), (Mode::Slide, normal));
///
/// // A contact that slipped in its last tick sticks again only below the kinetic bound; adhesion raises both.
/// let sticky = Law::StickSlip { friction: Friction { static_coefficient: 0.5, kinetic_coefficient: 0.2 } };
/// let slipped = Interface { slipped: true, ..Interface::NEW };
/// assert_eq!(sticky.contact_force(gentle, normal, Interface::NEW).0, Mode::Stick);
/// assert_eq!(sticky.contact_force(gentle, normal, slipped).0, Mode::Slip);
/// assert_eq!(sticky.contact_force(gentle, normal, Interface { adhesion_n: 0.5, ..slipped }).0, Mode::Stick);
///
/// // The impulse that changes the velocity of a point of 2 kg by (1, 0, −1) m/s: its tangential part is bounded too.
/// let response = Mat3::identity() / 2.0;
/// let impulse = law.impulse(&response, Vec3::new(1.0, 0.0, -1.0), normal, 1e-3, Interface::NEW);
/// assert_eq!((impulse.mode, impulse.fell_back), (Mode::Slip, false));
/// assert!((impulse.value - Vec3::new(1.0, 0.0, -2.0)).norm() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy)]
pub enum Law {
    /// The tip keeps the surface out of its way, without friction.
    Sliding,
    /// The tip holds the surface point that it touched.
    Sticking,
    /// The contact sticks up to the Coulomb bound (5), and slides with friction beyond it.
    StickSlip {
        /// Friction coefficients.
        friction: Friction,
    },
    /// A custom contact law.
    Own(&'static dyn ContactLaw),
}

/// Coefficients of Coulomb friction, 0 ≤ μ_k ≤ μ_s.
///
/// ```
/// use stickslip::contact::law::Friction;
///
/// // One number is both.
/// assert_eq!(Friction::from(0.5), Friction { static_coefficient: 0.5, kinetic_coefficient: 0.5 });
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// Static coefficient μ_s: the Coulomb bound of a contact that is new or stuck in its last tick.
    pub static_coefficient: f64,
    /// Kinetic coefficient μ_k: the friction of a slipping contact, and the bound below which it sticks again.
    pub kinetic_coefficient: f64,
}

impl Friction {
    /// Returns the friction of a single coefficient.
    pub const fn single(coefficient: f64) -> Self {
        Self { static_coefficient: coefficient, kinetic_coefficient: coefficient }
    }

    /// Returns the coefficient of the Coulomb bound.
    fn bound(self, slipped: bool) -> f64 {
        if slipped { self.kinetic_coefficient } else { self.static_coefficient }
    }
}

impl From<f64> for Friction {
    fn from(coefficient: f64) -> Self {
        Self::single(coefficient)
    }
}

/// State and adhesion of the touching surfaces, on which the Coulomb bound depends in addition to the reaction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interface {
    /// Whether the contact slipped in its last tick.
    pub slipped: bool,
    /// Adhesion A ≥ 0, N: the tension that the contact bears, and an addition to the normal force in the Coulomb bound,
    /// μ(F_N + A) (Derjaguin). May be infinite under [`Law::Sticking`].
    pub adhesion_n: f64,
}

impl Interface {
    /// A new contact without adhesion.
    pub const NEW: Self = Self { slipped: false, adhesion_n: 0.0 };
}

impl PartialEq for Law {
    /// Custom laws are equal if they are the same object.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Law::Sliding, Law::Sliding) | (Law::Sticking, Law::Sticking) => true,
            (Law::StickSlip { friction }, Law::StickSlip { friction: other }) => friction == other,
            (Law::Own(law), Law::Own(other)) => std::ptr::addr_eq(*law, *other),
            _ => false,
        }
    }
}

/// Extension point for custom contact laws: turns the force that would hold the contact point into the contact force.
///
/// Contract: a law is `Sync`, since both threads and all copies of a run share it, and lives as long as the program: a
/// constant, a `static`, or a leaked box. It has no state; it allocates nothing, locks nothing and does no I/O; equal
/// arguments give the same result to the bit.
///
/// ```
/// use stickslip::{ContactLaw, Law, Mode, Scene, Vec3};
///
/// /// Adhesive friction after Derjaguin: F_T is at most μ(F_N + A).
/// #[derive(Debug)]
/// struct Derjaguin {
///     friction: f64,
///     adhesion_n: f64,
/// }
/// impl ContactLaw for Derjaguin {
///     fn contact_force(&self, reaction: Vec3, normal: Vec3) -> (Mode, Vec3) {
///         let normal_force = reaction.dot(&normal);
///         let tangential = reaction - normal * normal_force;
///         let bound = self.friction * (normal_force + self.adhesion_n);
///         if tangential.norm() <= bound {
///             (Mode::Stick, reaction)
///         } else {
///             (Mode::Slip, normal * normal_force + tangential.normalize() * bound)
///         }
///     }
/// }
///
/// let mut scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// scene.contact.law = Law::Own(&Derjaguin { friction: 0.3, adhesion_n: 0.1 });
/// let mut excess_n = f64::NEG_INFINITY;
/// stickslip::run(&scene, |tick| {
///     if tick.report.mode == Mode::Slip {
///         excess_n = excess_n.max(tick.tangential_force() - 0.3 * (tick.normal_force() + 0.1));
///     }
/// })?;
/// assert!(excess_n.abs() < 1e-12);
/// # Ok::<(), stickslip::RunError>(())
/// ```
pub trait ContactLaw: fmt::Debug + Sync {
    /// Returns the force on the instrument, N, and the contact mode, for the reaction λ that would hold the contact
    /// point. It is called where F_N = λ·n̂ > −A, with the adhesion A of the scene, 0 by default; the massless scheme also
    /// asks it with F_N = 0, for the friction of a contact that is re-established after tension. Under [`Mode::Slip`] and [`Mode::Slide`] the contact point is free to
    /// move along the surface.
    fn contact_force(&self, reaction: Vec3, normal: Vec3) -> (Mode, Vec3);

    /// Whether the geometric scheme moves the mesh to the tip along the normal only, as frictionless sliding does.
    fn follows_along_normal_only(&self) -> bool {
        false
    }

    /// Returns the impulse Λ that adds r to the contact point's velocity, as far as the law allows, on a mesh that
    /// responds with GΛ. G is any 3 × 3 matrix, and a tick lasts `tick_s`, h, s. The contact is not under tension:
    /// n̂·r/(n̂·Gn̂) < Ah. By default the tangential part is that of [`contact_force`](Self::contact_force) for −G⁻¹r/h, and
    /// the normal part makes the contact point follow the tip along n̂; where it would pull, sliding is solved.
    fn impulse(&self, response: &Mat3, r: Vec3, normal: Vec3, tick_s: f64) -> Impulse {
        let slide = normal * (normal.dot(&r) / normal.dot(&(response * normal)));
        let fallback = Impulse { mode: Mode::Slide, value: slide, fell_back: true };
        let Some(held) = response.try_inverse().map(|inverse| inverse * r) else { return fallback };
        if held.dot(&normal) >= 0.0 {
            return fallback;
        }
        let (mode, force) = self.contact_force(held * (-1.0 / tick_s), normal);
        if mode == Mode::Stick {
            return Impulse { mode, value: held, fell_back: false };
        }
        let tangential = (force - normal * force.dot(&normal)) * -tick_s;
        let push = (normal.dot(&r) - normal.dot(&(response * tangential))) / normal.dot(&(response * normal));
        if push >= 0.0 { fallback } else { Impulse { mode, value: normal * push + tangential, fell_back: false } }
    }
}

/// Mode of the contact in a tick.
///
/// ```
/// use stickslip::Vec3;
/// use stickslip::{contact::law::Mode, surface::support::{Metric, Support}};
///
/// let mut support = Support::with_capacity(1);
/// support.set(Metric::Euclidean, [(0, 1.0, 100.0)]);
/// for (mode, after) in [(Mode::Free, [1.0, -1.0]), (Mode::Stick, [0.0, 0.0]), (Mode::Slip, [1.0, 0.0])] {
///     let mut v = [Vec3::new(1.0, 0.0, -1.0)];
///     mode.project_velocity(&support, Vec3::z(), &mut v);
///     assert_eq!([v[0].x, v[0].z], after, "{}", mode.name());
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// No force: there is no contact, or the contact is under tension.
    Free,
    /// The contact point is held.
    Stick,
    /// The contact slides without friction, or is rigid.
    Slide,
    /// The contact slips at the Coulomb bound.
    Slip,
}

impl Mode {
    /// Returns the name that a trace uses.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Free => "free",
            Mode::Stick => "stick",
            Mode::Slide => "slide",
            Mode::Slip => "slip",
        }
    }

    /// Returns the mode with a name that a trace uses.
    #[cfg(feature = "files")]
    pub(crate) fn named(name: &str) -> Option<Self> {
        [Mode::Free, Mode::Stick, Mode::Slide, Mode::Slip].into_iter().find(|mode| mode.name() == name)
    }
}

impl Law {
    /// Returns the force on the instrument, N, and the mode, for a reaction λ with F_N = λ·n̂ > −A.
    ///
    /// (5) decides between sticking and slipping, with the bound μ(F_N + A). Beyond that bound (28) holds:
    /// f̂ = F_N n̂ + μ_k(F_N + A) t̂ with t̂ = (λ − F_N n̂)/F_T. A contact with F_T = 0 never slips, so t̂ is never formed
    /// from zero.
    pub fn contact_force(self, reaction: Vec3, normal: Vec3, interface: Interface) -> (Mode, Vec3) {
        let normal_force = reaction.dot(&normal);
        match self {
            Law::Sliding => (Mode::Slide, normal * normal_force),
            Law::Sticking => (Mode::Stick, reaction),
            Law::StickSlip { friction } => {
                let tangential = reaction - normal * normal_force;
                let tangential_force = tangential.norm();
                let pressed = normal_force + interface.adhesion_n;
                if tangential_force <= friction.bound(interface.slipped) * pressed {
                    (Mode::Stick, reaction)
                } else {
                    let kinetic = friction.kinetic_coefficient * pressed;
                    (Mode::Slip, normal * normal_force + tangential * (kinetic / tangential_force))
                }
            }
            Law::Own(law) => law.contact_force(reaction, normal),
        }
    }

    /// Whether the geometric scheme moves the mesh to the tip along the normal only.
    pub fn follows_along_normal_only(self) -> bool {
        match self {
            Law::Sliding => true,
            Law::Sticking | Law::StickSlip { .. } => false,
            Law::Own(law) => law.follows_along_normal_only(),
        }
    }
}

/// An impulse on the mesh, and the contact mode that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impulse {
    /// Mode of the contact.
    pub mode: Mode,
    /// Impulse Λ, N·s.
    pub value: Vec3,
    /// Whether the law had no solution, and sliding was solved in its place.
    pub fell_back: bool,
}

impl Law {
    /// Returns the impulse Λ that adds r to the contact point's velocity, as far as the law allows. The mesh responds
    /// with GΛ, where G is any 3 × 3 matrix, and the contact is not under tension: n̂·r/(n̂·Gn̂) < Ah. A tick lasts
    /// `tick_s`, h, s.
    ///
    /// Sticking: Λ = G⁻¹r. Sliding: Λ = n̂(n̂·r)/(n̂·Gn̂). Beyond |Λ_T| = μ(Ah − Λ·n̂): Λ = −an̂ + μ_k(a + Ah)t̂ with
    /// t̂ = Λ_T/|Λ_T| and a = (n̂·r − μ_kAh n̂·Gt̂)/(n̂·G(−n̂ + μ_kt̂)), so that the contact point follows along the
    /// normal. For some G, Λ = G⁻¹r would pull beyond the adhesion (Λ·n̂ ≥ Ah), or the slipping impulse would (−a ≥ Ah).
    /// The law then has no solution, and sliding is solved.
    pub fn impulse(self, response: &Mat3, r: Vec3, normal: Vec3, tick_s: f64, interface: Interface) -> Impulse {
        let along = |direction: Vec3| direction * (normal.dot(&r) / normal.dot(&(response * direction)));
        let slide = |fell_back| Impulse { mode: Mode::Slide, value: along(normal), fell_back };
        let adhesion = interface.adhesion_n * tick_s;
        let hold = || response.try_inverse().map(|inverse| inverse * r).filter(|held| !(held.dot(&normal) >= adhesion));
        let stick = |value| Impulse { mode: Mode::Stick, value, fell_back: false };
        match self {
            Law::Sliding => slide(false),
            Law::Sticking => hold().map_or_else(|| slide(true), stick),
            Law::StickSlip { friction } => {
                let Some(held) = hold() else { return slide(true) };
                let normal_impulse = held.dot(&normal);
                let tangential = held - normal * normal_impulse;
                let tangential_impulse = tangential.norm();
                if tangential_impulse <= friction.bound(interface.slipped) * (adhesion - normal_impulse) {
                    return stick(held);
                }
                let friction = tangential * (friction.kinetic_coefficient / tangential_impulse);
                let beyond = normal.dot(&r) - adhesion * normal.dot(&(response * friction));
                let push = beyond / normal.dot(&(response * (friction - normal)));
                let value = (friction - normal) * push + friction * adhesion;
                if value.dot(&normal) >= adhesion {
                    slide(true)
                } else {
                    Impulse { mode: Mode::Slip, value, fell_back: false }
                }
            }
            Law::Own(law) => law.impulse(response, r, normal, tick_s),
        }
    }
}

impl Mode {
    /// Stops the contact point as the mode requires: (12) for sticking, (20) and (26) along the normal.
    pub fn project_velocity(self, support: &Support, normal: Vec3, v: &mut [Vec3]) {
        match self {
            Mode::Free => {}
            Mode::Stick => support.project_sticking(v),
            Mode::Slide | Mode::Slip => support.project_sliding(normal, v),
        }
    }
}
