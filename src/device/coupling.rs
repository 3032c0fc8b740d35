//! Optional stages between contact and device, in this order: smoothing of forces at hand-overs, a virtual coupling,
//! and passivity control.

use thiserror::Error;

use crate::Vec3;

/// What is wrong with a virtual coupling.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum CouplingError {
    /// A parameter is out of range.
    #[error("the virtual coupling's {name} = {value} must be {needs}")]
    Setting {
        /// Name of the parameter.
        name: &'static str,
        /// The value given.
        value: f64,
        /// Accepted range.
        needs: &'static str,
    },
    /// The coupling's own step is unstable: h²k/m + 2hb/m must be less than 4.
    #[error(
        "the virtual coupling alone is unstable: its mass of {mass} kg has to be more than (h²k + 2hb)/4 = {least} kg"
    )]
    TooLight {
        /// The mass given, kg.
        mass: f64,
        /// The mass to exceed, kg.
        least: f64,
    },
}

/// Settings of a spring and damper between the measured tip and a simulated tip with a mass.
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
    /// Stiffness k, N/m.
    pub stiffness: f64,
    /// Damping b, N·s/m.
    pub damping: f64,
    /// Mass m of the simulated tip, kg.
    pub mass: f64,
}

impl Default for CouplingSettings {
    /// Returns 500 N/m, 2 N·s/m and 50 g: about the stiffness of a hand's grip and the apparent mass of the device.
    fn default() -> Self {
        Self { stiffness: 500.0, damping: 2.0, mass: 0.05 }
    }
}

impl CouplingSettings {
    /// Checks that the settings are in range, and stable in ticks of `tick` seconds.
    ///
    /// # Errors
    /// If a setting is out of range, with the first one, or the coupling is unstable.
    pub fn check(&self, tick_s: f64) -> Result<(), CouplingError> {
        let Self { stiffness, damping, mass } = *self;
        for (name, value) in [("tick (s)", tick_s), ("stiffness (N/m)", stiffness), ("mass (kg)", mass)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(CouplingError::Setting { name, value, needs: "positive and finite" });
            }
        }
        if !(damping >= 0.0 && damping.is_finite()) {
            let needs = "finite and not negative";
            return Err(CouplingError::Setting { name: "damping (N·s/m)", value: damping, needs });
        }
        let least = 0.25 * tick_s * (tick_s * stiffness + 2.0 * damping);
        if !(mass > least) {
            return Err(CouplingError::TooLight { mass, least });
        }
        Ok(())
    }
}

/// A virtual coupling after J. E. Colgate, M. C. Stanley, J. M. Brown, *Issues in the haptic display of tool use*,
/// IROS 1995, with a mass for the simulated tip, since contact maps a motion to a force.
///
/// ```
/// use stickslip::{Vec3, device::coupling::{CouplingSettings, VirtualCoupling}};
///
/// let settings = CouplingSettings::default();
/// let mut coupling = VirtualCoupling::new(settings, 1e-3, Vec3::zeros())?;
/// // Contact pushes with 1 N while the hand keeps the device where it is, until nothing moves any more.
/// let (hand, contact_n) = (Vec3::zeros(), Vec3::z());
/// let tip = (0..2000).fold(hand, |_, _| coupling.advance(&hand, &contact_n));
/// assert!((coupling.force() - contact_n).norm() < 1e-9); // the device renders the contact force,
/// assert!((tip.z - 1.0 / settings.stiffness).abs() < 1e-12); // and the spring is stretched by f/k
/// # Ok::<(), stickslip::device::coupling::CouplingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct VirtualCoupling {
    settings: CouplingSettings,
    tick_s: f64,
    tip: Vec3,
    velocity: Vec3,
    measured: Vec3,
    measured_velocity: Vec3,
}

impl VirtualCoupling {
    /// Places the simulated tip at rest at the measured tip, m, for ticks of `tick` seconds.
    ///
    /// # Errors
    /// If [`CouplingSettings::check`] fails.
    pub fn new(settings: CouplingSettings, tick_s: f64, measured: Vec3) -> Result<Self, CouplingError> {
        settings.check(tick_s)?;
        let zero = Vec3::zeros();
        Ok(Self { settings, tick_s, tip: measured, velocity: zero, measured, measured_velocity: zero })
    }

    /// Advances the simulated tip by a semi-implicit step under the spring and the contact force of the last tick, N.
    /// Returns the tip that contact sees, m.
    pub fn advance(&mut self, measured: &Vec3, contact_force: &Vec3) -> Vec3 {
        self.measured_velocity = (measured - self.measured) / self.tick_s;
        self.measured = *measured;
        self.velocity += (contact_force - self.force()) * (self.tick_s / self.settings.mass);
        self.tip += self.velocity * self.tick_s;
        self.tip
    }

    /// Returns the velocity of the tip that contact sees, m/s.
    pub fn tip_velocity(&self) -> Vec3 {
        self.velocity
    }

    /// Returns the force on the device, −(k(q − x) + b(q̇ − ẋ)) with q measured and x simulated, N.
    pub fn force(&self) -> Vec3 {
        let CouplingSettings { stiffness, damping, .. } = self.settings;
        (self.tip - self.measured) * stiffness + (self.velocity - self.measured_velocity) * damping
    }
}

/// Time-domain passivity control in impedance causality: B. Hannaford, J.-H. Ryu, *Time-domain passivity control of
/// haptic interfaces*, IEEE Transactions on Robotics and Automation 18(1), 2002. A damper dissipates the energy that
/// the simulation has given out beyond what it took in. Work is counted with the displacement over which the motors
/// held a force, not with the one that caused the force: counted the other way, a spring that responds at once would
/// never give out energy, and the energy that a stiff wall gives out between two ticks would be missed.
///
/// ```
/// use stickslip::{Vec3, device::coupling::PassivityController};
///
/// let mut controller = PassivityController::default();
/// let force = Vec3::z(); // N
/// let applied = controller.command(&force, &Vec3::zeros());
/// assert_eq!(applied, force); // no energy has been given out yet
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
    /// Returns the force to command, N, after the measured tip has moved by Δq since the last command, m. The energy
    /// changes by −f·Δq with the force that was held meanwhile. While it is negative, f − αv is commanded, with α =
    /// −E/(h|v|²) and v = Δq/h, which is f + EΔq/|Δq|² whatever h. A force that is not finite is left to the device's
    /// limits.
    pub fn command(&mut self, force: &Vec3, displacement: &Vec3) -> Vec3 {
        self.energy -= self.held.dot(displacement);
        let square = displacement.norm_squared();
        if !(self.energy < 0.0 && square > 0.0) {
            return *force;
        }
        force + displacement * (self.energy / square)
    }

    /// Sets the force that the motors hold from here on, N: the command after the device's limits.
    pub fn hold(&mut self, applied: Vec3) {
        self.held = applied;
    }

    /// Returns E_o, the energy that the simulation has taken in and not given back, J.
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
/// // A new model returns 0 N: the jump of 1 N is rendered as four of 0.25 N.
/// assert_eq!([command(0.0, true), command(0.0, false), command(0.0, false)], [0.75, 0.5, 0.25]);
/// assert_eq!(command(0.0, false), 0.0);
/// ```
#[derive(Debug, Clone)]
pub struct HandOverSmoothing {
    ticks: u32,
    /// Ticks of the fade still to come.
    left: u32,
    /// Force before the hand-over minus force after it, N.
    difference: Vec3,
    last: Vec3,
}

impl HandOverSmoothing {
    /// Creates a smoothing over a number of ticks; 0 leaves forces unchanged.
    pub fn new(ticks: u32) -> Self {
        Self { ticks, left: 0, difference: Vec3::zeros(), last: Vec3::zeros() }
    }

    /// Returns the force to command for a force f, N, which may be the first of a new model. In tick j = 0 … n − 1 from
    /// there it is f + (f_before − f_first)(1 − (j + 1)/(n + 1)), with f_before as commanded, so that a hand-over
    /// during a fade starts from the rendered force.
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
