//! What may stand between contact and device, each by itself: smoothing of forces at hand-overs, a virtual coupling,
//! and passivity control, in this order from contact to device.

use thiserror::Error;

use crate::Vec3;

/// What is wrong with a virtual coupling.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum CouplingError {
    /// A parameter is out of range.
    #[error("the virtual coupling's {name} = {value} must be {needs}")]
    Setting {
        /// Which.
        name: &'static str,
        /// What it is.
        value: f64,
        /// What it has to be.
        needs: &'static str,
    },
    /// Its own step is unstable: h²k/m + 2hb/m has to be less than 4.
    #[error(
        "the virtual coupling swings up by itself: its mass of {mass} kg has to be more than (h²k + 2hb)/4 = {least} kg"
    )]
    TooLight {
        /// What it is.
        mass: f64,
        /// What it has to exceed, kg.
        least: f64,
    },
}

/// A spring and damper between the measured tip and a simulated one that has a mass.
///
/// ```
/// use stickslip::device::coupling::{CouplingError, CouplingSettings};
///
/// let settings = CouplingSettings::default();
/// settings.check(1e-3)?;
/// // Its own step is stable while h²k + 2hb < 4m: up to 16.4 ms.
/// settings.check(0.016)?;
/// assert!(matches!(settings.check(0.017), Err(CouplingError::TooLight { .. })));
/// let pulling = CouplingSettings { stiffness: -1.0, ..settings };
/// assert!(pulling.check(1e-3).is_err());
/// # Ok::<(), CouplingError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CouplingSettings {
    /// k, N/m.
    pub stiffness: f64,
    /// b, N·s/m.
    pub damping: f64,
    /// m of the simulated tip, kg.
    pub mass: f64,
}

impl Default for CouplingSettings {
    /// 500 N/m, 2 N·s/m, 50 g: about as stiff as a hand's grip, about as heavy as the device feels.
    fn default() -> Self {
        Self { stiffness: 500.0, damping: 2.0, mass: 0.05 }
    }
}

impl CouplingSettings {
    /// Whether they are in range, and stable in ticks of h, s.
    ///
    /// # Errors
    /// With the first that is not.
    pub fn check(&self, tick: f64) -> Result<(), CouplingError> {
        let Self { stiffness, damping, mass } = *self;
        for (name, value) in [("tick (s)", tick), ("stiffness (N/m)", stiffness), ("mass (kg)", mass)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(CouplingError::Setting { name, value, needs: "positive and finite" });
            }
        }
        if !(damping >= 0.0 && damping.is_finite()) {
            let needs = "finite and not negative";
            return Err(CouplingError::Setting { name: "damping (N·s/m)", value: damping, needs });
        }
        let least = 0.25 * tick * (tick * stiffness + 2.0 * damping);
        if !(mass > least) {
            return Err(CouplingError::TooLight { mass, least });
        }
        Ok(())
    }
}

/// J. E. Colgate, M. C. Stanley, J. M. Brown, *Issues in the haptic display of tool use*, IROS 1995, with a mass for
/// the simulated tip, since contact answers a motion with a force.
///
/// ```
/// use stickslip::{Vec3, device::coupling::{CouplingSettings, VirtualCoupling}};
///
/// let settings = CouplingSettings::default();
/// let mut coupling = VirtualCoupling::new(settings, 1e-3, Vec3::zeros())?;
/// // Contact pushes with 1 N while the hand keeps the device where it is, until nothing moves any more.
/// let (hand, contact_n) = (Vec3::zeros(), Vec3::z());
/// let tip = (0..2000).fold(hand, |_, _| coupling.advance(&hand, &contact_n));
/// assert!((coupling.force() - contact_n).norm() < 1e-9); // the device gets what contact gives,
/// assert!((tip.z - 1.0 / settings.stiffness).abs() < 1e-12); // and the spring is stretched by f/k
/// # Ok::<(), stickslip::device::coupling::CouplingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct VirtualCoupling {
    settings: CouplingSettings,
    tick: f64,
    tip: Vec3,
    velocity: Vec3,
    measured: Vec3,
    measured_velocity: Vec3,
}

impl VirtualCoupling {
    /// At rest at the measured tip, m, for ticks of h, s.
    ///
    /// # Errors
    /// As [`CouplingSettings::check`].
    pub fn new(settings: CouplingSettings, tick: f64, measured: Vec3) -> Result<Self, CouplingError> {
        settings.check(tick)?;
        let zero = Vec3::zeros();
        Ok(Self { settings, tick, tip: measured, velocity: zero, measured, measured_velocity: zero })
    }

    /// A semi-implicit step of the simulated tip under the spring and the contact force of the last tick, N: where
    /// contact is to look for it, m.
    pub fn advance(&mut self, measured: &Vec3, contact_force: &Vec3) -> Vec3 {
        self.measured_velocity = (measured - self.measured) / self.tick;
        self.measured = *measured;
        self.velocity += (contact_force - self.force()) * (self.tick / self.settings.mass);
        self.tip += self.velocity * self.tick;
        self.tip
    }

    /// The force on the device, −(k(q − x) + b(q̇ − ẋ)) with q measured and x simulated, N.
    pub fn force(&self) -> Vec3 {
        let CouplingSettings { stiffness, damping, .. } = self.settings;
        (self.tip - self.measured) * stiffness + (self.velocity - self.measured_velocity) * damping
    }
}

/// Time-domain passivity control in impedance causality: B. Hannaford, J.-H. Ryu, *Time-domain passivity control of
/// haptic interfaces*, IEEE Transactions on Robotics and Automation 18(1), 2002. A damper takes up what the simulation
/// has given out beyond what it took in. A force is counted with the way over which the motors held it, not with the one
/// that it answers: by that count a spring that answers at once never gives anything, and the energy that a stiff wall
/// gives out between two ticks would not be seen.
///
/// ```
/// use stickslip::{Vec3, device::coupling::PassivityController};
///
/// let mut controller = PassivityController::default();
/// let force = Vec3::z(); // N
/// let applied = controller.command(&force, &Vec3::zeros());
/// assert_eq!(applied, force); // nothing has been given yet
/// controller.hold(applied);
/// // The motors push the hand away by 1 mm: the simulation has given 1 mJ that it never took in.
/// let way = Vec3::z() * 1e-3;
/// let damped = controller.command(&force, &way);
/// assert_eq!(controller.energy_j(), -1e-3);
/// assert!(damped.norm() < 1e-12); // f + EΔq/|Δq|² = 1 N − 1 mJ/1 mm
/// ```
#[derive(Debug, Clone, Default)]
pub struct PassivityController {
    energy: f64,
    held: Vec3,
}

impl PassivityController {
    /// The force to command, N, where the measured tip has moved by Δq since the command before, m. The energy goes
    /// up by −f·Δq with the force that was held meanwhile; while it is negative, f − αv is commanded, α = −E/(h|v|²),
    /// v = Δq/h, which is f + EΔq/|Δq|² whatever h. A force that is not finite is left to what limits the device.
    pub fn command(&mut self, force: &Vec3, displacement: &Vec3) -> Vec3 {
        self.energy -= self.held.dot(displacement);
        let square = displacement.norm_squared();
        if !(self.energy < 0.0 && square > 0.0) {
            return *force;
        }
        force + displacement * (self.energy / square)
    }

    /// What the motors hold from here on, N: the command as the device's limits let it through.
    pub fn hold(&mut self, applied: Vec3) {
        self.held = applied;
    }

    /// E_o: energy that the simulation has taken in and not given back, J.
    pub fn energy_j(&self) -> f64 {
        self.energy
    }
}

/// Spreads the jump of the force at a hand-over over n ticks, linearly.
///
/// ```
/// use stickslip::{Vec3, device::coupling::HandOverSmoothing};
///
/// let mut smoothing = HandOverSmoothing::new(3);
/// let mut command = |force_n: f64, is_first| smoothing.command(&(Vec3::z() * force_n), is_first).z;
/// assert_eq!(command(1.0, false), 1.0);
/// // A new model says 0 N: a jump of 1 N is felt as four of 0.25 N.
/// assert_eq!([command(0.0, true), command(0.0, false), command(0.0, false)], [0.75, 0.5, 0.25]);
/// assert_eq!(command(0.0, false), 0.0);
/// ```
#[derive(Debug, Clone)]
pub struct HandOverSmoothing {
    ticks: u32,
    /// Of the fade, still to come.
    left: u32,
    /// Force before less force after the hand-over, N.
    difference: Vec3,
    last: Vec3,
}

impl HandOverSmoothing {
    /// Over so many ticks; 0 leaves forces as they are.
    pub fn new(ticks: u32) -> Self {
        Self { ticks, left: 0, difference: Vec3::zeros(), last: Vec3::zeros() }
    }

    /// The force to command in the place of one, N, that is the first of a new model or not. In tick j = 0 … n − 1 from
    /// there it is f + (f_before − f_first)(1 − (j + 1)/(n + 1)), f_before as commanded, so that a hand-over during a
    /// fade starts from what is felt.
    pub fn command(&mut self, force: &Vec3, is_first_of_model: bool) -> Vec3 {
        if is_first_of_model {
            self.left = self.ticks;
            self.difference = self.last - force;
        }
        if self.left == 0 {
            self.last = *force;
            return *force;
        }
        let share = f64::from(self.left) / (f64::from(self.ticks) + 1.0);
        self.left -= 1;
        self.last = force + self.difference * share;
        self.last
    }
}
