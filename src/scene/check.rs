//! Checks of a scene, whether read or built: ranges, and which settings go together.

use super::error::Problem;
use super::memory::mesh_fits;
use super::{MeshSource, Scene, Schedule};
use crate::Vec3;
use crate::contact::law::{Friction, Law};
use crate::contact::rules::Wall;
use crate::device::coupled::InstrumentError;
use crate::device::coupled::{CoupledPhantom, CoupledSettings};
use crate::device::coupling::CouplingError;
use crate::device::instrument::InstrumentKind;
use crate::device::phantom::DeviceError;
use crate::dynamics::constraint::Threads;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::local::condensation::Reach;
use crate::local::model::{ExteriorKind, Linearization};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::material::PerSpring;
use crate::model::mesh::Block;
use crate::multirate::global::SyncMode;
use crate::multirate::timeline::Cost;

pub(super) use super::memory::Run;

/// Tolerance within which a ratio of two decimal inputs counts as a whole number: a few roundings of numbers up to 1e9
/// ticks.
const WHOLE_NUMBER_TOLERANCE: f64 = 1e-9;

/// Highest rate of a loop in real time, Hz: waking up alone takes a Linux thread microseconds.
pub const MOST_REAL_TIME_HZ: f64 = 100_000.0;

/// Least spacing, m: far below any tissue, and far above where the areas of triangles underflow.
const LEAST_SPACING: f64 = 1e-6;

/// Reason why settings of virtual time have no effect.
pub(super) const IN_REAL_TIME: &str = "`run.schedule = \"threads\"`, where computing takes real time";
/// Reason why settings of hand-overs have no effect.
pub(super) const NO_HAND_OVERS: &str = "`local.model = \"full\"`, which has no hand-overs";

type Checked<T = ()> = Result<T, Problem>;

/// Finds the first problem of a scene, if it has one.
pub(super) fn check(scene: &Scene) -> Checked {
    name(&scene.name)?;
    positive("duration", scene.duration_s())?;
    mesh(scene)?;
    material(scene)?;
    local_model(scene)?;
    contact(scene)?;
    global(scene)?;
    timing(scene)?;
    instrument(scene)
}

fn name(name: &str) -> Checked {
    let allowed = |c: char| c.is_alphanumeric() || "-_.".contains(c);
    if name.starts_with(char::is_alphanumeric) && name.chars().all(allowed) {
        return Ok(());
    }
    Err(Problem::NotAccepted { key: "name", value: format!("{name:?}") })
}

/// Checks the mesh before anything of its size is allocated.
pub(super) fn mesh(scene: &Scene) -> Checked {
    if let MeshSource::Block(given) = &scene.mesh {
        block(given)?;
    }
    mesh_fits(&scene.mesh, Run::of(scene))
}

pub(super) fn block(block: &Block) -> Checked {
    let Block { nodes, spacing, .. } = block;
    if nodes.iter().any(|&count| count < 2) {
        return Err(Problem::NotAccepted { key: "mesh.nodes", value: format!("{nodes:?}") });
    }
    accept("mesh.spacing", *spacing, spacing.is_finite() && *spacing >= LEAST_SPACING)?;
    Ok(())
}

fn material(scene: &Scene) -> Checked {
    let (material, nodes) = (&scene.material, scene.mesh.node_count());
    for (key, found) in [("material.node_mass", material.node_mass.len()), ("mesh.fixed", scene.fixed.len())] {
        if found != nodes {
            return Err(Problem::WrongLength { key, found, nodes });
        }
    }
    material.node_mass.iter().try_for_each(|&mass| positive("material.node_mass", mass).map(drop))?;
    every("material.stiffness", &material.stiffness, positive)?;
    every("material.damping", &material.damping, non_negative)?;
    non_negative("material.drag", material.drag)?;
    if !material.gravity.iter().all(|g| g.is_finite()) {
        let value = format!("{:?}", material.gravity.as_slice());
        return Err(Problem::NotAccepted { key: "material.gravity", value });
    }
    if scene.settle && material.gravity == Vec3::zeros() {
        let because = "a `material.gravity` of zero: the network is at rest as it is";
        return Err(Problem::NoEffect { key: "settle", because });
    }
    Ok(())
}

fn every(key: &'static str, values: &PerSpring, check: fn(&'static str, f64) -> Checked<f64>) -> Checked {
    match values {
        PerSpring::Same(value) => check(key, *value).map(drop),
        PerSpring::Each(values) => values.iter().try_for_each(|&value| check(key, value).map(drop)),
    }
}

fn local_model(scene: &Scene) -> Checked {
    let local = &scene.local;
    if local.extent == Extent::Rings(0) {
        return Err(Problem::NotAccepted { key: "local.rings", value: "0".to_owned() });
    }
    if local.extent == Extent::All && local.exterior != ExteriorKind::Fixed {
        return Err(Problem::NoEffect { key: "local.exterior", because: "`local.rings = \"all\"`" });
    }
    if let (Extent::Rings(patch), ExteriorKind::Condensed(condensation)) = (local.extent, local.exterior)
        && let Reach::Rings { rings, .. } = condensation.reach
        && rings <= patch
    {
        let value = format!("{rings}: the patch has {patch} rings, so nothing beyond it would be condensed");
        return Err(Problem::NotAccepted { key: "local.condense_rings", value });
    }
    if scene.is_full && scene.smoothing_ticks > 0 {
        return Err(Problem::NoEffect { key: "instrument.smoothing_ticks", because: NO_HAND_OVERS });
    }
    if scene.integrator == LocalIntegrator::SemiImplicitEuler {
        return Ok(());
    }
    // All others solve the linear model, with the contact's impulse in the same equations.
    let needs = if scene.is_full {
        "`local.model = \"patch\"`"
    } else if local.linearization == Linearization::None {
        "`local.linearization = \"tangent\"`"
    } else if !scene.contact.scheme.is_impulsive() {
        "`contact.scheme = \"massless\"` or `\"velocity\"`"
    } else {
        return Ok(());
    };
    Err(Problem::Needs { key: "local.integrator", value: scene.integrator.name(), needs })
}

fn contact(scene: &Scene) -> Checked {
    if let Law::StickSlip { friction: Friction { static_coefficient, kinetic_coefficient } } = scene.contact.law {
        let [bound, slip] = match static_coefficient.to_bits() == kinetic_coefficient.to_bits() {
            true => ["contact.friction"; 2],
            false => ["contact.friction.static", "contact.friction.kinetic"],
        };
        non_negative(bound, static_coefficient)?;
        non_negative(slip, kinetic_coefficient)?;
        if !(kinetic_coefficient <= static_coefficient) {
            let value = format!("{kinetic_coefficient}: above the static coefficient {static_coefficient}");
            return Err(Problem::NotAccepted { key: slip, value });
        }
    }
    let adhesion_n = scene.contact.adhesion_n;
    if matches!(scene.contact.law, Law::Own(_)) && adhesion_n != 0.0 {
        return Err(Problem::NoEffect { key: "contact.adhesion", because: "a custom contact law, which has its own" });
    }
    if !(adhesion_n == f64::INFINITY && scene.contact.law == Law::Sticking) {
        non_negative("contact.adhesion", adhesion_n)?;
    }
    let Wall { stiffness, damping } = scene.contact.wall;
    non_negative("contact.radius", scene.contact_radius)?;
    non_negative("contact.wall_stiffness", stiffness)?;
    non_negative("contact.wall_damping", damping)?;
    Ok(())
}

fn global(scene: &Scene) -> Checked {
    let global = &scene.global;
    at_least_one("global.substeps", global.substeps)?;
    if global.latency_ticks >= scene.ticks_per_cycle {
        let value = format!("{}: one global cycle has {} ticks", global.latency_ticks, scene.ticks_per_cycle);
        return Err(Problem::NotAccepted { key: "sync.latency_ticks", value });
    }
    if global.threads == Threads::One {
        return Ok(());
    }
    let because = match (global.integrator, global.sync) {
        (GlobalIntegrator::ImplicitEuler, _) => "`global.integrator = \"implicit-euler\"`, which one thread solves",
        (GlobalIntegrator::Rk4, _) => "`global.integrator = \"rk4\"`, which one thread integrates",
        (_, SyncMode::Overwrite) => "`sync.mode = \"overwrite\"`, which holds one point of the whole network",
        _ if scene.is_full => "`local.model = \"full\"`, which leaves no network to a global side",
        _ => return Ok(()),
    };
    Err(Problem::NoEffect { key: "global.threads", because })
}

fn timing(scene: &Scene) -> Checked {
    let (tick_s, after) = (scene.tick_s(), scene.deadline.after);
    positive("timing.deadline", after)?;
    if !(after <= tick_s) {
        let value = format!("{after} s: a tick lasts {tick_s} s");
        return Err(Problem::NotAccepted { key: "timing.deadline", value });
    }
    if let Some(costs) = &scene.costs {
        if scene.schedule == Schedule::Threads {
            return Err(Problem::NoEffect { key: "timing.tick_cost", because: IN_REAL_TIME });
        }
        cost("timing.tick_cost", &costs.tick)?;
        cost("timing.model_cost", &costs.model)?;
    }
    if scene.schedule == Schedule::Threads {
        real_time_rate(scene)?;
    }
    if scene.schedule == Schedule::Threads && scene.global.latency_ticks > 0 {
        return Err(Problem::NoEffect { key: "sync.latency_ticks", because: IN_REAL_TIME });
    }
    Ok(())
}

/// Checks that a loop in real time can have the scene's rate.
pub(super) fn real_time_rate(scene: &Scene) -> Checked {
    let rate_hz = scene.local_rate_hz;
    if rate_hz <= MOST_REAL_TIME_HZ {
        return Ok(());
    }
    let value = format!("{rate_hz} Hz in real time, where {MOST_REAL_TIME_HZ} Hz is the most");
    Err(Problem::NotAccepted { key: "local.rate", value })
}

fn cost(key: &'static str, cost: &Cost) -> Checked {
    let refuse = |value: String| Err(Problem::NotAccepted { key, value });
    match cost {
        Cost::Constant(value) => non_negative(key, *value).map(drop),
        Cost::Table(values) if values.is_empty() => refuse("an empty list".to_owned()),
        Cost::Table(values) => values.iter().try_for_each(|&value| non_negative(key, value).map(drop)),
        &Cost::LogNormal { median, p99 } => {
            if !(median > 0.0 && p99 >= median && p99.is_finite()) {
                return refuse(format!("{{ median = {median}, p99 = {p99} }}"));
            }
            Ok(())
        }
        &Cost::Rare { usual, rare, share } => {
            if !(0.0..=1.0).contains(&share) {
                return refuse(format!("drawn with share = {share}"));
            }
            non_negative(key, usual)?;
            non_negative(key, rare).map(drop)
        }
    }
}

fn instrument(scene: &Scene) -> Checked {
    let InstrumentKind::Phantom(settings) = &scene.instrument else {
        return positive("instrument.force_limit", scene.force_limit_n).map(drop);
    };
    device(settings)?;
    // Checks that depend on more than one setting.
    let Err(error) = CoupledPhantom::new(settings, &scene.path, scene.tick_s()) else { return Ok(()) };
    let key = match error {
        InstrumentError::Device(DeviceError::Rotation { .. }) => "instrument.device.rotation",
        InstrumentError::Device(DeviceError::Substeps { .. }) => "instrument.device.substeps",
        InstrumentError::Device(DeviceError::Pose { .. }) => "instrument.waypoints",
        InstrumentError::Coupling(CouplingError::TooLight { .. }) => "instrument.coupling.mass",
        InstrumentError::Device(_) | InstrumentError::Coupling(_) => "instrument",
    };
    Err(Problem::Instrument { key, error })
}

fn device(settings: &CoupledSettings) -> Checked {
    let phantom = &settings.phantom;
    let (axes, joints, actuation, hand) = (&phantom.axes, &phantom.joints, &phantom.actuation, &phantom.hand);
    let all = Vec3::repeat;
    let above_0 = [
        ("instrument.device.friction_speed", all(joints.friction_speed)),
        ("instrument.device.capstan_ratio", actuation.capstan_ratio),
        ("instrument.device.torque_constant", all(actuation.torque_constant)),
        ("instrument.device.largest_current", all(actuation.largest_current)),
        ("instrument.device.amplifier_bandwidth", all(actuation.amplifier_bandwidth)),
        ("instrument.device.largest_force", all(actuation.largest_force)),
        ("instrument.hand.mass", hand.mass),
    ];
    let at_least_0 = [
        ("instrument.device.joint_friction", joints.friction),
        ("instrument.device.joint_damping", joints.damping),
        ("instrument.device.rotor_inertia", joints.rotor_inertia),
        ("instrument.device.encoder_counts", all(actuation.encoder_counts)),
        ("instrument.hand.stylus_stiffness", hand.stylus_stiffness),
        ("instrument.hand.stylus_damping", hand.stylus_damping),
        ("instrument.hand.arm_stiffness", hand.arm_stiffness),
        ("instrument.hand.arm_damping", hand.arm_damping),
    ];
    for (key, values) in above_0 {
        values.iter().try_for_each(|&value| positive(key, value).map(drop))?;
    }
    for (key, values) in at_least_0 {
        values.iter().try_for_each(|&value| non_negative(key, value).map(drop))?;
    }
    for &offset in axes.offset.iter() {
        accept("instrument.device.offset", offset, offset.is_finite())?;
    }
    accept("instrument.device.torque_bits", f64::from(actuation.torque_bits), actuation.torque_bits <= 32)?;
    at_least_one("instrument.device.substeps", phantom.substeps)?;
    if let Some(structure) = phantom.structure {
        positive("instrument.device.structure.stiffness", structure.stiffness)?;
        positive("instrument.device.structure.tip_mass", structure.tip_mass)?;
        non_negative("instrument.device.structure.damping_ratio", structure.damping_ratio)?;
    }
    if let Some(coupling) = settings.coupling {
        positive("instrument.coupling.stiffness", coupling.stiffness)?;
        non_negative("instrument.coupling.damping", coupling.damping)?;
        positive("instrument.coupling.mass", coupling.mass)?;
    }
    Ok(())
}

/// Returns the number of ticks in a duration, s, if it is whole. `key` is named in the error.
pub(super) fn whole_ticks(key: &'static str, duration_s: f64, local_rate_hz: f64) -> Checked<u64> {
    let ticks = duration_s * local_rate_hz;
    let refuse = || {
        let value = format!("{duration_s} s, which is {ticks} ticks of {} s", 1.0 / local_rate_hz);
        Problem::NotAccepted { key, value }
    };
    whole(ticks).map(|ticks| ticks as u64).ok_or_else(refuse)
}

/// Returns the number of ticks that cover a time, s: at least one.
pub(super) fn covering_ticks(time_s: f64, local_rate_hz: f64) -> u64 {
    let ticks = time_s * local_rate_hz;
    whole(ticks).unwrap_or(ticks.ceil()).max(1.0) as u64
}

/// Returns the number of ticks in a global cycle, if it is whole. `key` is named in the error.
pub(super) fn ticks_per_cycle(key: &'static str, local_rate_hz: f64, global_rate_hz: f64) -> Checked<u32> {
    let ratio = whole(local_rate_hz / global_rate_hz).filter(|&ratio| ratio <= f64::from(u32::MAX));
    let refuse = || {
        let value = format!("as given: {local_rate_hz} Hz is not a whole multiple of the global {global_rate_hz} Hz");
        Problem::NotAccepted { key, value }
    };
    ratio.map(|ratio| ratio as u32).ok_or_else(refuse)
}

/// Rounds a ratio of two decimal inputs, if it is a whole number of at least 1.
fn whole(ratio: f64) -> Option<f64> {
    ((ratio - ratio.round()).abs() <= WHOLE_NUMBER_TOLERANCE * ratio && ratio >= 0.5).then_some(ratio.round())
}

pub(super) fn positive(key: &'static str, value: f64) -> Checked<f64> {
    accept(key, value, value.is_finite() && value > 0.0)
}

pub(super) fn non_negative(key: &'static str, value: f64) -> Checked<f64> {
    accept(key, value, value.is_finite() && value >= 0.0)
}

#[cfg(feature = "files")]
pub(super) fn finite(key: &'static str, value: f64) -> Checked<f64> {
    accept(key, value, value.is_finite())
}

pub(super) fn at_least_one(key: &'static str, count: u32) -> Checked<u32> {
    if count >= 1 { Ok(count) } else { Err(Problem::NotAccepted { key, value: count.to_string() }) }
}

fn accept(key: &'static str, value: f64, is_accepted: bool) -> Checked<f64> {
    if is_accepted { Ok(value) } else { Err(Problem::NotAccepted { key, value: value.to_string() }) }
}
