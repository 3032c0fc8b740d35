//! The instrument of a scene: its path, and the modelled device with all that belongs to it.

use std::path::Path;

use toml::Spanned;

use super::{Checker, Placed, Sign};
use crate::device::coupled::InstrumentError;
use crate::device::coupled::{CoupledPhantom, CoupledSettings};
use crate::device::coupling::{CouplingError, CouplingSettings};
use crate::device::instrument::InstrumentKind;
use crate::device::path::{TipPath, Waypoint};
use crate::device::phantom::actuation::ActuationSettings;
use crate::device::phantom::dynamics::JointSettings;
use crate::device::phantom::hand::HandSettings;
use crate::device::phantom::{Axes, DeviceError, PhantomSettings};
use crate::scene::error::Problem;
use crate::scene::file::{CouplingTable, DeviceTable, HandTable, InstrumentName, InstrumentTable};
use crate::{Mat3, Vec3};

impl Checker {
    pub(super) fn instrument(
        &self,
        table: &Spanned<InstrumentTable>,
        folder: &Path,
        tick: f64,
    ) -> Placed<(InstrumentKind, TipPath)> {
        let instrument = table.get_ref();
        let file = instrument.file.as_ref().map(Spanned::span);
        match instrument.kind {
            InstrumentName::Path => {
                let because = "`instrument.kind = \"path\"`";
                self.no_effect("instrument.file", file, because)?;
                self.no_device(instrument, because)?;
                Ok((InstrumentKind::Path, self.waypoints(table)?))
            }
            InstrumentName::Recording => {
                let because = "`instrument.kind = \"recording\"`";
                self.no_effect("instrument.waypoints", instrument.waypoints.as_ref().map(Spanned::span), because)?;
                self.no_device(instrument, because)?;
                let key = "instrument.file";
                let file = instrument.file.as_ref().ok_or_else(|| self.error(Problem::Missing(key), table.span()))?;
                let path = TipPath::from_csv(&folder.join(file.get_ref()))
                    .map_err(|error| self.error(Problem::Path { key, error }, file.span()))?;
                Ok((InstrumentKind::Path, path))
            }
            InstrumentName::Phantom => {
                self.no_effect("instrument.file", file, "`instrument.kind = \"phantom-1.5\"`")?;
                let path = self.waypoints(table)?;
                Ok((InstrumentKind::Phantom(Box::new(self.coupled(table, &path, tick)?)), path))
            }
        }
    }

    fn no_device(&self, instrument: &InstrumentTable, because: &'static str) -> Placed<()> {
        let InstrumentTable { passivity_control, device, hand, coupling, .. } = instrument;
        self.no_effect("instrument.passivity_control", passivity_control.as_ref().map(Spanned::span), because)?;
        self.no_effect("instrument.device", device.as_ref().map(Spanned::span), because)?;
        self.no_effect("instrument.hand", hand.as_ref().map(Spanned::span), because)?;
        self.no_effect("instrument.coupling", coupling.as_ref().map(Spanned::span), because)
    }

    fn waypoints(&self, table: &Spanned<InstrumentTable>) -> Placed<TipPath> {
        let key = "instrument.waypoints";
        let list = table.get_ref().waypoints.as_ref();
        let list = list.ok_or_else(|| self.error(Problem::Missing(key), table.span()))?;
        let mut path = Vec::with_capacity(list.get_ref().len());
        for waypoint in list.get_ref() {
            let &[time, x, y, z] = waypoint.get_ref().as_slice() else {
                let value = format!("{:?}: four numbers are needed", waypoint.get_ref());
                return Err(self.error(Problem::NotAccepted { key, value }, waypoint.span()));
            };
            path.push(Waypoint { time, position: Vec3::new(x, y, z) });
        }
        TipPath::new(path).map_err(|error| self.error(Problem::Path { key, error }, list.span()))
    }

    fn coupled(&self, table: &Spanned<InstrumentTable>, path: &TipPath, tick: f64) -> Placed<CoupledSettings> {
        let InstrumentTable { waypoints, passivity_control, device, hand, coupling, .. } = table.get_ref();
        let device = device.as_ref().map(Spanned::get_ref);
        let settings = CoupledSettings {
            phantom: self.phantom(device.unwrap_or(&DeviceTable::default()), hand.as_ref().map(Spanned::get_ref))?,
            coupling: coupling.as_ref().map(|coupling| self.coupling(coupling.get_ref())).transpose()?,
            passivity_control: passivity_control.as_ref().is_some_and(|is_on| *is_on.get_ref()),
        };
        // What depends on more than one key.
        let Err(error) = CoupledPhantom::new(&settings, path, tick) else { return Ok(settings) };
        let (key, span) = match error {
            InstrumentError::Device(DeviceError::Rotation { .. }) => {
                ("instrument.device.rotation", device.and_then(|device| device.rotation.as_ref().map(Spanned::span)))
            }
            InstrumentError::Device(DeviceError::Substeps { .. }) => {
                ("instrument.device.substeps", device.and_then(|device| device.substeps.as_ref().map(Spanned::span)))
            }
            InstrumentError::Device(DeviceError::Pose { .. }) => {
                ("instrument.waypoints", waypoints.as_ref().map(Spanned::span))
            }
            InstrumentError::Coupling(CouplingError::TooLight { .. }) => {
                ("instrument.coupling.mass", coupling.as_ref().map(Spanned::span))
            }
            InstrumentError::Device(_) | InstrumentError::Coupling(_) => ("instrument", None),
        };
        Err(self.error(Problem::Instrument { key, error }, span.unwrap_or(table.span())))
    }

    fn phantom(&self, device: &DeviceTable, hand: Option<&HandTable>) -> Placed<PhantomSettings> {
        let defaults = PhantomSettings::default();
        let (joints, actuation, axes) = (defaults.joints, defaults.actuation, defaults.axes);
        let number = |key, value: &Option<Spanned<f64>>, default, sign| self.number_or(key, value, default, sign);
        let (positive, not_negative) = (Some(Sign::Positive), Some(Sign::NonNegative));
        Ok(PhantomSettings {
            axes: Axes {
                rotation: match &device.rotation {
                    None => axes.rotation,
                    Some(rows) => Mat3::from_fn(|row, column| rows.get_ref()[row][column]),
                },
                offset: self.vector("instrument.device.offset", &device.offset, axes.offset, None)?,
            },
            joints: JointSettings {
                damping: match &device.joint_damping {
                    None => joints.damping,
                    Some(value) => {
                        Vec3::repeat(self.number("instrument.device.joint_damping", value, Sign::NonNegative)?)
                    }
                },
                friction: self.vector(
                    "instrument.device.joint_friction",
                    &device.joint_friction,
                    joints.friction,
                    not_negative,
                )?,
                friction_speed: number(
                    "instrument.device.friction_speed",
                    &device.friction_speed,
                    joints.friction_speed,
                    Sign::Positive,
                )?,
                rotor_inertia: self.vector(
                    "instrument.device.rotor_inertia",
                    &device.rotor_inertia,
                    joints.rotor_inertia,
                    not_negative,
                )?,
            },
            actuation: ActuationSettings {
                torque_constant: number(
                    "instrument.device.torque_constant",
                    &device.torque_constant,
                    actuation.torque_constant,
                    Sign::Positive,
                )?,
                capstan_ratio: self.vector(
                    "instrument.device.capstan_ratio",
                    &device.capstan_ratio,
                    actuation.capstan_ratio,
                    positive,
                )?,
                current_limit: number(
                    "instrument.device.largest_current",
                    &device.largest_current,
                    actuation.current_limit,
                    Sign::Positive,
                )?,
                torque_bits: match &device.torque_bits {
                    Some(bits) if *bits.get_ref() > 32 => {
                        let (key, value) = ("instrument.device.torque_bits", bits.get_ref().to_string());
                        return Err(self.error(Problem::NotAccepted { key, value }, bits.span()));
                    }
                    bits => bits.as_ref().map_or(actuation.torque_bits, |bits| *bits.get_ref()),
                },
                encoder_counts: device
                    .encoder_counts
                    .as_ref()
                    .map_or(actuation.encoder_counts, |counts| f64::from(*counts.get_ref())),
                amplifier_bandwidth: number(
                    "instrument.device.amplifier_bandwidth",
                    &device.amplifier_bandwidth,
                    actuation.amplifier_bandwidth,
                    Sign::Positive,
                )?,
                force_limit: number(
                    "instrument.device.largest_force",
                    &device.largest_force,
                    actuation.force_limit,
                    Sign::Positive,
                )?,
                ..actuation
            },
            hand: self.hand(hand.unwrap_or(&HandTable::default()))?,
            substeps: self.count_or("instrument.device.substeps", &device.substeps, defaults.substeps)?,
        })
    }

    fn hand(&self, hand: &HandTable) -> Placed<HandSettings> {
        let default = HandSettings::default();
        let not_negative = Some(Sign::NonNegative);
        Ok(HandSettings {
            mass: self.vector("instrument.hand.mass", &hand.mass, default.mass, Some(Sign::Positive))?,
            grip_stiffness: self.vector(
                "instrument.hand.stylus_stiffness",
                &hand.stylus_stiffness,
                default.grip_stiffness,
                not_negative,
            )?,
            grip_damping: self.vector(
                "instrument.hand.stylus_damping",
                &hand.stylus_damping,
                default.grip_damping,
                not_negative,
            )?,
            arm_stiffness: self.vector(
                "instrument.hand.arm_stiffness",
                &hand.arm_stiffness,
                default.arm_stiffness,
                not_negative,
            )?,
            arm_damping: self.vector(
                "instrument.hand.arm_damping",
                &hand.arm_damping,
                default.arm_damping,
                not_negative,
            )?,
        })
    }

    fn coupling(&self, coupling: &CouplingTable) -> Placed<CouplingSettings> {
        let CouplingTable { stiffness, damping, mass } = coupling;
        let default = CouplingSettings::default();
        Ok(CouplingSettings {
            stiffness: self.number_or("instrument.coupling.stiffness", stiffness, default.stiffness, Sign::Positive)?,
            damping: self.number_or("instrument.coupling.damping", damping, default.damping, Sign::NonNegative)?,
            mass: self.number_or("instrument.coupling.mass", mass, default.mass, Sign::Positive)?,
        })
    }

    /// Three numbers, finite and of a sign if there is one.
    fn vector(
        &self,
        key: &'static str,
        value: &Option<Spanned<[f64; 3]>>,
        default: Vec3,
        sign: Option<Sign>,
    ) -> Placed<Vec3> {
        let Some(value) = value else { return Ok(default) };
        for &component in value.get_ref() {
            match sign {
                Some(sign) => self.check(key, component, value.span(), sign)?,
                None if component.is_finite() => component,
                None => {
                    let problem = Problem::NotAccepted { key, value: component.to_string() };
                    return Err(self.error(problem, value.span()));
                }
            };
        }
        Ok(Vec3::from(*value.get_ref()))
    }
}
