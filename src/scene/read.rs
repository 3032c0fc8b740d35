//! Conversion of a scene file to a scene: defaults, units, files that it names, and keys without effect beside others.
//! [`super::check`] checks the result.

mod global;
mod instrument;
mod local;
mod material;
mod mesh;
mod timing;

use std::path::Path;

use super::build::default_force_limit_n;
use super::check::{check, whole_ticks};
use super::error::{Problem, SceneError};
use super::file::*;
use super::keys::{accepted, known_words};
use super::place::nearest;
use super::source::Source;
use super::words::{LawName, LocalModelName, SchemeName};
use super::{DEFAULT_GLOBAL_RATE_HZ, DEFAULT_LOCAL_RATE_HZ, Scene, Schedule, check};
use crate::contact::law::{Friction, Law};
use crate::contact::rules::{ContactRules, Scheme, Wall};
use crate::dynamics::integrators::GlobalIntegrator;
use crate::local::step::LocalIntegrator;

type Read<T = ()> = Result<T, Problem>;

pub(super) fn scene(source: Source, path: &Path) -> Result<Scene, SceneError> {
    let file = deserialize(&source)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let scene = assemble(file, folder).and_then(|scene| check(&scene).map(|()| scene));
    match scene {
        Ok(scene) => Ok(Scene { source: Some(source), ..scene }),
        Err(problem) => Err(SceneError::new(problem, Some(&source))),
    }
}

fn deserialize(source: &Source) -> Result<SceneFile, SceneError> {
    let text = source.text();
    let syntax =
        |error: &toml::de::Error| SceneError::at(Problem::Syntax(error.message().to_owned()), source, error.span());
    let deserializer = toml::Deserializer::parse(text).map_err(|error| syntax(&error))?;
    serde_path_to_error::deserialize(deserializer).map_err(|error| {
        let mut path: Vec<String> = error
            .path()
            .iter()
            .filter_map(|segment| match segment {
                serde_path_to_error::Segment::Map { key } if !key.starts_with('$') => Some(key.clone()),
                _ => None,
            })
            .collect();
        // Of a key that is not known, what is known is the table.
        let unknown = if accepted(&path.join(".")).is_none() { path.pop() } else { None };
        let key = path.join(".");
        let written = error.inner().span().and_then(|span| text.get(span)).unwrap_or("");
        let written = unknown.as_deref().unwrap_or(written.trim_matches(['"', '\'']));
        let meant = nearest(written, known_words(&key)).map(|word| format!("did you mean `{word}`?"));
        let values = accepted(&key).map(|values| format!("accepted for `{key}`: {values}"));
        let help: Vec<String> = meant.into_iter().chain(values).collect();
        let placed = syntax(error.inner());
        if help.is_empty() { placed } else { placed.with_help(help.join("\n")) }
    })
}

fn assemble(file: SceneFile, folder: &Path) -> Read<Scene> {
    let local_rate_hz = check::positive("local.rate", file.local.rate.unwrap_or(DEFAULT_LOCAL_RATE_HZ))?;
    let global_rate_hz = check::positive("global.rate", file.global.rate.unwrap_or(DEFAULT_GLOBAL_RATE_HZ))?;
    let given_rate = if file.local.rate.is_some() { "local.rate" } else { "global.rate" };
    let ticks_per_cycle = check::ticks_per_cycle(given_rate, local_rate_hz, global_rate_hz)?;
    let tick_count = whole_ticks("duration", check::positive("duration", file.duration)?, local_rate_hz)?;
    let is_full = file.local.model == LocalModelName::Full;
    let local = local::local(&file.local)?;
    let integrator = match file.local.model {
        LocalModelName::External => LocalIntegrator::default(),
        LocalModelName::Patch | LocalModelName::Full => file.local.integrator.unwrap_or_default(),
    };
    let global = global::global(&file)?;
    let size = check::Run {
        local: &local,
        integrator,
        ticks: tick_count,
        ticks_per_cycle,
        settles: file.settle.unwrap_or(false),
        is_implicit: !is_full && global.integrator == GlobalIntegrator::ImplicitEuler,
    };
    let (mesh, fixed) = mesh::mesh(&file.mesh, folder, size)?;
    let material = material::material(&file.material, &mesh)?;
    let schedule = file.run.schedule;
    let tick_s = 1.0 / local_rate_hz;
    let (deadline, costs) = timing::timing(&file.timing, schedule, tick_s)?;
    if schedule == Schedule::Threads {
        // A latency of zero agrees with real time.
        no_effect("sync.latency_ticks", file.sync.latency_ticks.is_some_and(|ticks| ticks > 0), check::IN_REAL_TIME)?;
    }
    if is_full {
        no_effect("instrument.smoothing_ticks", file.instrument.smoothing_ticks.is_some(), check::NO_HAND_OVERS)?;
    }
    let (instrument, path) = instrument::instrument(&file.instrument, folder)?;
    Ok(Scene {
        settle: file.settle.unwrap_or(false),
        global,
        contact: contact(&file.contact)?,
        surface: file.contact.surface,
        contact_radius: file.contact.radius.unwrap_or(0.0),
        force_limit_n: file.instrument.force_limit.unwrap_or_else(default_force_limit_n),
        smoothing_ticks: file.instrument.smoothing_ticks.unwrap_or(0),
        name: file.name,
        mesh,
        fixed,
        material,
        integrator,
        instrument,
        path,
        schedule,
        deadline,
        costs,
        local_rate_hz,
        ticks_per_cycle,
        tick_count,
        is_full,
        local,
        renderer: local::renderer(&file.local, folder)?,
        source: None,
    })
}

fn contact(contact: &ContactTable) -> Read<ContactRules> {
    let because = match contact.law {
        LawName::Sliding => "`contact.law = \"sliding\"`",
        LawName::Sticking => "`contact.law = \"sticking\"`",
        LawName::StickSlip => "",
    };
    let law = match (contact.law, contact.friction) {
        (LawName::StickSlip, Some(FrictionValue::Single(friction))) => Law::StickSlip { friction: friction.into() },
        (LawName::StickSlip, Some(FrictionValue::Pair(FrictionPair { static_coefficient, kinetic_coefficient }))) => {
            Law::StickSlip { friction: Friction { static_coefficient, kinetic_coefficient } }
        }
        (LawName::StickSlip, None) => return Err(Problem::Missing("contact.friction")),
        (LawName::Sliding, None) => Law::Sliding,
        (LawName::Sticking, None) => Law::Sticking,
        (LawName::Sliding | LawName::Sticking, Some(_)) => {
            return Err(Problem::NoEffect { key: "contact.friction", because });
        }
    };
    let wall = Wall::default();
    Ok(ContactRules {
        law,
        scheme: scheme(contact)?,
        adhesion_n: contact.adhesion.unwrap_or(0.0),
        wall: Wall {
            stiffness: contact.wall_stiffness.unwrap_or(wall.stiffness),
            damping: contact.wall_damping.unwrap_or(wall.damping),
        },
    })
}

fn scheme(contact: &ContactTable) -> Read<Scheme> {
    let (scheme, because) = match contact.scheme {
        SchemeName::Geometric => {
            return Ok(Scheme::Geometric {
                deformation: contact.deformation.unwrap_or_default(),
                metric: contact.metric.unwrap_or_default(),
            });
        }
        SchemeName::Velocity => (Scheme::Velocity, "`contact.scheme = \"velocity\"`"),
        SchemeName::Massless => (Scheme::Massless, "`contact.scheme = \"massless\"`"),
    };
    no_effect("contact.deformation", contact.deformation.is_some(), because)?;
    no_effect("contact.metric", contact.metric.is_some(), because)?;
    Ok(scheme)
}

fn no_effect(key: &'static str, is_given: bool, because: &'static str) -> Read {
    if is_given { Err(Problem::NoEffect { key, because }) } else { Ok(()) }
}
