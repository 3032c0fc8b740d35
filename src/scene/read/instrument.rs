//! The `[instrument]` table: the path, and the modelled device with its settings.

use std::path::Path;

use super::{Read, no_effect};
use crate::device::coupled::CoupledSettings;
use crate::device::coupling::CouplingSettings;
use crate::device::instrument::InstrumentKind;
use crate::device::path::{TipPath, Waypoint};
use crate::device::phantom::PhantomSettings;
use crate::device::phantom::hand::HandSettings;
use crate::device::phantom::structure::StructureSettings;
use crate::scene::error::Problem;
use crate::scene::file::{CouplingTable, DeviceTable, HandTable, InstrumentTable, StructureTable};
use crate::scene::words::InstrumentName;
use crate::{Mat3, Vec3};

pub(super) fn instrument(table: &InstrumentTable, folder: &Path) -> Read<(InstrumentKind, TipPath)> {
    let (kind, path) = kind_and_path(table, folder)?;
    Ok((kind, path.with_interpolation(table.interpolation.unwrap_or_default())))
}

fn kind_and_path(table: &InstrumentTable, folder: &Path) -> Read<(InstrumentKind, TipPath)> {
    match table.kind {
        InstrumentName::Path => {
            let because = "`instrument.kind = \"path\"`";
            no_effect("instrument.file", table.file.is_some(), because)?;
            no_device(table, because)?;
            no_recording(table, because)?;
            Ok((InstrumentKind::Path, waypoints(table)?))
        }
        InstrumentName::Recording => {
            let because = "`instrument.kind = \"recording\"`";
            no_effect("instrument.waypoints", table.waypoints.is_some(), because)?;
            no_device(table, because)?;
            let file = table.file.as_ref().ok_or(Problem::Missing("instrument.file"))?;
            Ok((InstrumentKind::Path, recording(table, &folder.join(file))?))
        }
        InstrumentName::Phantom => {
            let because = "`instrument.kind = \"phantom-1.5\"`, which has `device.largest_force`";
            no_effect("instrument.force_limit", table.force_limit.is_some(), because)?;
            let path = match &table.file {
                Some(file) => {
                    no_effect("instrument.waypoints", table.waypoints.is_some(), "`instrument.file`")?;
                    recording(table, &folder.join(file))?
                }
                None => {
                    no_recording(table, "`instrument.waypoints`")?;
                    waypoints(table)?
                }
            };
            let settings = CoupledSettings {
                phantom: phantom(table.device.as_ref(), table.hand.as_ref()),
                coupling: table.coupling.as_ref().map(coupling),
                passivity_control: table.passivity_control.unwrap_or(false),
            };
            Ok((InstrumentKind::Phantom(Box::new(settings)), path))
        }
    }
}

#[cfg(feature = "files")]
fn recording(table: &InstrumentTable, file: &Path) -> Read<TipPath> {
    use crate::device::recording::Recording;
    use crate::scene::check::{finite, positive};

    let given = Recording {
        columns: table.columns.clone(),
        scale: positive("instrument.scale", table.scale.unwrap_or(1.0))?,
        time_scale: positive("instrument.time_scale", table.time_scale.unwrap_or(1.0))?,
        start_s: finite("instrument.start", table.start.unwrap_or(0.0))?,
        filter_hz: table.filter_hz.map(|hz| positive("instrument.filter_hz", hz)).transpose()?,
    };
    given.read(file).map_err(|error| Problem::Path { key: "instrument.file", error })
}

#[cfg(not(feature = "files"))]
fn recording(_: &InstrumentTable, file: &Path) -> Read<TipPath> {
    TipPath::from_csv(file).map_err(|error| Problem::Path { key: "instrument.file", error })
}

/// Rejects the keys that set how a recording is read.
fn no_recording(table: &InstrumentTable, because: &'static str) -> Read {
    no_effect("instrument.columns", table.columns.is_some(), because)?;
    no_effect("instrument.scale", table.scale.is_some(), because)?;
    no_effect("instrument.time_scale", table.time_scale.is_some(), because)?;
    no_effect("instrument.start", table.start.is_some(), because)?;
    no_effect("instrument.filter_hz", table.filter_hz.is_some(), because)
}

fn no_device(table: &InstrumentTable, because: &'static str) -> Read {
    no_effect("instrument.passivity_control", table.passivity_control.is_some(), because)?;
    no_effect("instrument.device", table.device.is_some(), because)?;
    no_effect("instrument.hand", table.hand.is_some(), because)?;
    no_effect("instrument.coupling", table.coupling.is_some(), because)
}

fn waypoints(table: &InstrumentTable) -> Read<TipPath> {
    let key = "instrument.waypoints";
    let list = table.waypoints.as_ref().ok_or(Problem::Missing(key))?;
    let mut path = Vec::with_capacity(list.len());
    for (index, waypoint) in list.iter().enumerate() {
        let &[time, x, y, z] = waypoint.as_slice() else {
            return Err(Problem::Waypoint { index, given: waypoint.clone() });
        };
        path.push(Waypoint { time, position: Vec3::new(x, y, z) });
    }
    TipPath::new(path).map_err(|error| Problem::Path { key, error })
}

fn phantom(device: Option<&DeviceTable>, hand: Option<&HandTable>) -> PhantomSettings {
    let mut settings = PhantomSettings::default();
    if let Some(hand) = hand {
        settings.hand = self::hand(hand);
    }
    let Some(table) = device else { return settings };
    let PhantomSettings { axes, joints, actuation, structure, sensing, substeps, .. } = &mut settings;
    *sensing = table.tip;
    *structure = table.structure.as_ref().map(self::structure);
    if let Some(rows) = table.rotation {
        axes.rotation = Mat3::from_fn(|row, column| rows[row][column]);
    }
    set(&mut axes.offset, table.offset.map(Vec3::from));
    set(&mut joints.damping, table.joint_damping.map(Vec3::repeat));
    set(&mut joints.friction, table.joint_friction.map(Vec3::from));
    set(&mut joints.friction_speed, table.friction_speed);
    set(&mut joints.rotor_inertia, table.rotor_inertia.map(Vec3::from));
    set(&mut actuation.torque_constant, table.torque_constant);
    set(&mut actuation.capstan_ratio, table.capstan_ratio.map(Vec3::from));
    set(&mut actuation.largest_current, table.largest_current);
    set(&mut actuation.torque_bits, table.torque_bits);
    set(&mut actuation.encoder_counts, table.encoder_counts.map(f64::from));
    set(&mut actuation.amplifier_bandwidth, table.amplifier_bandwidth);
    set(&mut actuation.largest_force, table.largest_force);
    set(substeps, table.substeps);
    settings
}

fn structure(table: &StructureTable) -> StructureSettings {
    let mut settings = StructureSettings::default();
    set(&mut settings.stiffness, table.stiffness);
    set(&mut settings.tip_mass, table.tip_mass);
    set(&mut settings.damping_ratio, table.damping_ratio);
    settings
}

fn hand(table: &HandTable) -> HandSettings {
    let mut settings = HandSettings::default();
    set(&mut settings.mass, table.mass.map(Vec3::from));
    set(&mut settings.stylus_stiffness, table.stylus_stiffness.map(Vec3::from));
    set(&mut settings.stylus_damping, table.stylus_damping.map(Vec3::from));
    set(&mut settings.arm_stiffness, table.arm_stiffness.map(Vec3::from));
    set(&mut settings.arm_damping, table.arm_damping.map(Vec3::from));
    settings
}

fn coupling(table: &CouplingTable) -> CouplingSettings {
    let mut settings = CouplingSettings::default();
    set(&mut settings.stiffness, table.stiffness);
    set(&mut settings.damping, table.damping);
    set(&mut settings.mass, table.mass);
    settings
}

/// Replaces a default by a given value, if there is one.
fn set<T>(setting: &mut T, given: Option<T>) {
    if let Some(given) = given {
        *setting = given;
    }
}
