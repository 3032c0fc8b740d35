//! Facts on a modelled device before a run, and the warnings that follow from them.

use serde::Serialize;

use crate::Vec3;
use crate::contact::impedance::Impedance;
use crate::contact::rules::{Scheme, Wall};
use crate::device::instrument::InstrumentKind;
use crate::device::phantom::TipSensing;
use crate::device::phantom::observer::LONGEST_WINDOW_S;
use crate::pipeline::Simulation;
use crate::scene::{Scene, Warning};

/// The modelled device at its start; the wall bounds are along the scene's z, the normal of the top.
#[derive(Debug, Serialize)]
pub struct DeviceFacts {
    apparent_mass_kg: [f64; 3],
    resolution_m: [f64; 3],
    largest_force_n: f64,
    hand_mass_kg: [f64; 3],
    grip_stiffness_n_per_m: [f64; 3],
    arm_stiffness_n_per_m: [f64; 3],
    structure: Option<StructureFacts>,
    coupling: Option<CouplingFacts>,
    passivity_control: bool,
    smoothing_ticks: u32,
    wall_stiffness_n_per_m: f64,
    /// Passivity bound 2(b − |B|)/h, by the device's damping.
    wall_bound_by_damping_n_per_m: f64,
    /// Passivity bound 2f_c/Δ, by the device's friction; absent if nothing is quantised.
    wall_bound_by_friction_n_per_m: Option<f64>,
    /// The contact below the start of the path; absent if nothing there can move.
    contact: Option<ContactFacts>,
}

/// What one encoder count along the normal commands.
#[derive(Debug, Serialize)]
struct ContactFacts {
    /// Mass under the tip m_c, kg.
    mass_kg: f64,
    /// Mass under the tip over the device's apparent mass along the normal.
    mass_ratio: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
    newtons_per_count: f64,
    /// Formula of `newtons_per_count` and its cause, for people.
    because: &'static str,
}

/// Force of one encoder count above which there is a warning, N: 2.5 times the backdrive friction of the PHANTOM,
/// 0.04 N at the tip, which masks smaller forces.
const LOUD_COUNT_N: f64 = 0.1;

impl ContactFacts {
    /// Returns `None` where nothing can move, or a virtual coupling stands between the encoders and the contact.
    fn new(scene: &Scene, simulation: &Simulation) -> Option<Self> {
        if matches!(&scene.instrument, InstrumentKind::Phantom(settings) if settings.coupling.is_some()) {
            return None;
        }
        let (local, device) = (simulation.local(), simulation.device()?.phantom());
        let point = local.shape().nearest(scene.path.at(0.0))?;
        let Impedance { mass_kg, stiffness_n_per_m, damping_n_s_per_m } = Impedance::at(local, &point);
        let axes = device.settings().axes;
        let along = |of_axes: Vec3| (axes.rotation * Vec3::z()).abs().dot(&of_axes);
        let (count_m, h) = (along(device.resolution_m()), scene.tick_s());
        let elastic = stiffness_n_per_m * count_m;
        let (newtons_per_count, because) = match scene.contact.scheme {
            Scheme::Velocity => (mass_kg * count_m / (h * h), "m_c Δ/h²: the contact point follows within a tick"),
            Scheme::Geometric { .. } => (elastic, "k_c Δ: the springs around the contact point"),
            Scheme::Massless => match device.settings().sensing.unwrap_or_default() {
                TipSensing::Quantised => {
                    (elastic + damping_n_s_per_m * count_m / h, "k_c Δ + c_c Δ/h: springs and dampers")
                }
                TipSensing::Observed => {
                    (elastic * (h / LONGEST_WINDOW_S).min(1.0), "k_c Δ h/T: the observed tip follows over T = 20 ms")
                }
            },
        };
        let mass_ratio = mass_kg / along(device.apparent_mass_kg());
        mass_kg.is_finite().then_some(Self {
            mass_kg,
            mass_ratio,
            stiffness_n_per_m,
            damping_n_s_per_m,
            newtons_per_count,
            because,
        })
    }

    fn warning(&self) -> Option<Warning> {
        (self.newtons_per_count > LOUD_COUNT_N).then(|| {
            Warning::new(
                "encoder-count",
                format!(
                    "one encoder count commands {:.2} N ({}): the device may vibrate in a hand that holds still; \
                 `contact.scheme = \"massless\"` with `instrument.device.tip = \"observed\"` avoids it",
                    self.newtons_per_count, self.because
                ),
            )
        })
    }
}

/// Compliant structure between the links and the tip in the hand.
#[derive(Debug, Serialize)]
struct StructureFacts {
    stiffness_n_per_m: f64,
    tip_mass_kg: f64,
    damping_ratio: f64,
    /// Frequency of the structural mode along the device's x, y and z with a free tip, Hz.
    frequency_hz: [f64; 3],
}

#[derive(Debug, Serialize)]
struct CouplingFacts {
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
    mass_kg: f64,
}

impl DeviceFacts {
    /// Collects the facts; `None` without a modelled device.
    pub fn new(scene: &Scene, simulation: &Simulation) -> Option<Self> {
        let InstrumentKind::Phantom(settings) = &scene.instrument else { return None };
        let device = simulation.device()?.phantom();
        let Wall { stiffness, damping } = scene.contact.wall;
        let bounds = device.wall_bounds(&Vec3::z(), damping);
        let hand = &settings.phantom.hand;
        Some(Self {
            apparent_mass_kg: device.apparent_mass_kg().into(),
            resolution_m: device.resolution_m().into(),
            largest_force_n: settings.phantom.actuation.largest_force,
            hand_mass_kg: hand.mass.into(),
            grip_stiffness_n_per_m: hand.stylus_stiffness.into(),
            arm_stiffness_n_per_m: hand.arm_stiffness.into(),
            structure: settings.phantom.structure.zip(device.structure_frequency_hz()).map(|(structure, frequency)| {
                StructureFacts {
                    stiffness_n_per_m: structure.stiffness,
                    tip_mass_kg: structure.tip_mass,
                    damping_ratio: structure.damping_ratio,
                    frequency_hz: frequency.into(),
                }
            }),
            coupling: settings.coupling.map(|coupling| CouplingFacts {
                stiffness_n_per_m: coupling.stiffness,
                damping_n_s_per_m: coupling.damping,
                mass_kg: coupling.mass,
            }),
            passivity_control: settings.passivity_control,
            smoothing_ticks: scene.smoothing_ticks,
            wall_stiffness_n_per_m: stiffness,
            wall_bound_by_damping_n_per_m: bounds.by_damping_n_per_m,
            wall_bound_by_friction_n_per_m: Some(bounds.by_friction_n_per_m).filter(|bound| bound.is_finite()),
            contact: ContactFacts::new(scene, simulation),
        })
    }

    /// Returns the warnings: of an encoder count that commands more than 0.1 N, and of a wall stiffness beyond both bounds.
    pub fn warnings(&self) -> impl Iterator<Item = Warning> {
        self.contact.as_ref().and_then(ContactFacts::warning).into_iter().chain(self.wall_warning())
    }

    fn wall_warning(&self) -> Option<Warning> {
        let friction = self.wall_bound_by_friction_n_per_m?;
        let (bound, which) = if friction > self.wall_bound_by_damping_n_per_m {
            (friction, "2f_c/Δ of Abbott and Okamura, by the device's friction")
        } else {
            (self.wall_bound_by_damping_n_per_m, "2(b − |B|)/h of Colgate and Schenkel, by the device's damping")
        };
        (self.wall_stiffness_n_per_m > bound).then(|| {
            Warning::new(
                "wall-passivity",
                format!(
                    "contact.wall_stiffness = {} N/m is beyond the passivity bound of the device alone, {bound:.0} N/m \
                 ({which}): on rigid ground the loop may generate energy",
                    self.wall_stiffness_n_per_m
                ),
            )
        })
    }

    /// Returns the facts as lines of text.
    pub fn lines(&self) -> Vec<String> {
        let three = |values: [f64; 3], scale: f64, digits: usize| {
            values.map(|value| format!("{:.digits$}", value * scale)).join(", ")
        };
        let mut lines = vec![
            format!(
                "  device    PHANTOM Premium 1.5: {} g at the tip, {} mm resolution (device x, y, z), at most {} N",
                three(self.apparent_mass_kg, 1e3, 0),
                three(self.resolution_m, 1e3, 4),
                self.largest_force_n
            ),
            format!(
                "  hand      {} g, grip {} N/m, arm {} N/m",
                three(self.hand_mass_kg, 1e3, 0),
                three(self.grip_stiffness_n_per_m, 1.0, 0),
                three(self.arm_stiffness_n_per_m, 1.0, 0)
            ),
        ];
        if let Some(structure) = &self.structure {
            lines.push(format!(
                "  structure {} N/m, tip of {} g, damping ratio {}: {} Hz with a free tip",
                structure.stiffness_n_per_m,
                1e3 * structure.tip_mass_kg,
                structure.damping_ratio,
                three(structure.frequency_hz, 1.0, 0)
            ));
        }
        lines.push(match &self.coupling {
            Some(CouplingFacts { stiffness_n_per_m: k, damping_n_s_per_m: b, mass_kg: m }) => {
                format!("  coupling  {k} N/m, {b} N·s/m, {:.0} g", 1e3 * m)
            }
            None => "  coupling  none: the contact is computed at the device's tip".to_owned(),
        });
        if let Some(contact) = &self.contact {
            lines.push(format!(
                "  contact   m_c = {:.1} g under the tip, {:.2} of the device's apparent mass; an encoder count commands \
                 {:.3} N, {}",
                1e3 * contact.mass_kg,
                contact.mass_ratio,
                contact.newtons_per_count,
                contact.because
            ));
        }
        let friction = match self.wall_bound_by_friction_n_per_m {
            Some(bound) => format!("{bound:.0} N/m"),
            None => "any stiffness, as nothing is quantised".to_owned(),
        };
        lines.push(format!(
            "  rigid ground of {} N/m; passive by the device's damping, 2(b − |B|)/h, up to {:.1} N/m; by its \
             friction, 2f_c/Δ, up to {friction}",
            self.wall_stiffness_n_per_m, self.wall_bound_by_damping_n_per_m
        ));
        lines
    }
}
