//! From the scene file to a scene: ranges, and which keys go together.

mod global;
mod instrument;
mod material;
mod mesh;
mod timing;

use std::ops::Range;
use std::path::Path;

use miette::NamedSource;
use toml::Spanned;

use super::error::{Problem, SceneError};
use super::file::*;
use super::keys::accepted;
use super::{Scene, Schedule, Source};
use crate::contact::law::Law;
use crate::contact::rules::{ContactRules, Deformation, Scheme, Wall};
use crate::local::condensation::{Condensation, FarField, Reach};
use crate::local::model::{ExteriorKind, Linearization, LocalSettings};
use crate::local::patch::Extent;
use crate::local::step::LocalIntegrator;
use crate::model::springs::TangentKind;
use crate::surface::geometry::ContactSurface;
use crate::surface::support::Metric;
pub(super) use timing::at_rate;

/// How far from a whole number a ratio of two decimal inputs may be and still mean one: a few
/// roundings of numbers up to 1e9 ticks.
const WHOLE_NUMBER_TOLERANCE: f64 = 1e-9;

type Placed<T> = Result<T, SceneError>;

pub(super) fn scene(text: &str, path: &Path) -> Placed<Scene> {
    let checker = Checker { source: NamedSource::new(path.display().to_string(), text.to_owned()) };
    let file = checker.deserialize(text)?;
    checker.scene(file, path.parent().unwrap_or(Path::new("")))
}

/// A ratio of two decimal inputs, if it is a whole number.
fn whole(ratio: f64) -> Option<f64> {
    ((ratio - ratio.round()).abs() <= WHOLE_NUMBER_TOLERANCE * ratio && ratio >= 0.5).then_some(ratio.round())
}

struct Checker {
    source: NamedSource<String>,
}

/// What a number may be.
#[derive(Clone, Copy)]
enum Sign {
    Positive,
    NonNegative,
}

impl Checker {
    fn error(&self, problem: Problem, span: Range<usize>) -> SceneError {
        SceneError::at(problem, self.source.clone(), Some(span))
    }

    fn deserialize(&self, text: &str) -> Placed<SceneFile> {
        let syntax = |error: &toml::de::Error| {
            SceneError::at(Problem::Syntax(error.message().to_owned()), self.source.clone(), error.span())
        };
        let deserializer = toml::Deserializer::parse(text).map_err(|error| syntax(&error))?;
        serde_path_to_error::deserialize(deserializer).map_err(|error| {
            // The path names the key of a wrong value, but the table of an unknown or missing one.
            let path: Vec<String> = error
                .path()
                .iter()
                .filter_map(|segment| match segment {
                    serde_path_to_error::Segment::Map { key } if !key.starts_with('$') => Some(key.clone()),
                    _ => None,
                })
                .collect();
            let placed = syntax(error.inner());
            match accepted(&path.join(".")) {
                Some(values) => placed.with_help(format!("accepted for `{}`: {values}", path.join("."))),
                None => placed,
            }
        })
    }

    fn scene(&self, file: SceneFile, folder: &Path) -> Placed<Scene> {
        let name = self.name(&file.name)?;
        let duration = self.number("duration", &file.duration, Sign::Positive)?;
        let local_rate = self.number_or("local.rate", &file.local.rate, 1000.0, Sign::Positive)?;
        let global_rate = self.number_or("global.rate", &file.global.rate, 10.0, Sign::Positive)?;
        let ticks_per_cycle =
            whole(local_rate / global_rate).filter(|&ratio| ratio <= f64::from(u32::MAX)).ok_or_else(|| {
                let (key, span) = match (&file.local.rate, &file.global.rate) {
                    (Some(rate), _) => ("local.rate", rate.span()),
                    (None, Some(rate)) => ("global.rate", rate.span()),
                    (None, None) => ("global.rate", 0..0),
                };
                let value = format!("so: {local_rate} Hz is not a whole multiple of the global {global_rate} Hz");
                self.error(Problem::NotAccepted { key, value }, span)
            })? as u32;
        let tick_count = whole(duration * local_rate).ok_or_else(|| {
            let value = format!("{duration} s, which is {} ticks of {} s", duration * local_rate, 1.0 / local_rate);
            self.error(Problem::NotAccepted { key: "duration", value }, file.duration.span())
        })? as u64;

        let local = self.local(&file.local)?;
        let integrator = self.integrator(&file.local, file.contact.get_ref())?;
        let needs =
            mesh::Needs { local: &local, integrator, ticks: tick_count, cycle_ticks: u64::from(ticks_per_cycle) };
        let (mesh, fixed, warnings) = self.mesh(&file.mesh, folder, &needs)?;
        let material = self.material(&file.material, &mesh)?;
        let settle = self.settle(&file.settle, &material)?;

        let global = self.global(&file, global_rate, ticks_per_cycle)?;
        let schedule = match file.run.schedule {
            ScheduleName::Lockstep => Schedule::Lockstep,
            ScheduleName::Threads => Schedule::Threads,
        };
        if schedule == Schedule::Threads {
            // None at all is what there is anyway.
            let span = file.sync.latency_ticks.as_ref().filter(|ticks| *ticks.get_ref() > 0).map(Spanned::span);
            self.no_effect("sync.latency_ticks", span, timing::IN_REAL_TIME)?;
        }
        let (deadline, costs) = self.timing(&file.timing, schedule, 1.0 / local_rate)?;
        let is_full = matches!(file.local.model, LocalModelName::Full);
        let (instrument, path) = self.instrument(&file.instrument, folder, 1.0 / local_rate)?;
        let smoothing = &file.instrument.get_ref().smoothing_ticks;
        if is_full {
            let span = smoothing.as_ref().map(Spanned::span);
            self.no_effect("instrument.smoothing_ticks", span, "`local.model = \"full\"`, which has no hand-overs")?;
        }
        let source = Source {
            text: self.source.clone(),
            instrument: file.instrument.span(),
            mesh: file.mesh.span(),
            settle: file.settle.as_ref().map(Spanned::span),
        };
        Ok(Scene {
            name,
            duration,
            tick_count,
            tick: 1.0 / local_rate,
            ticks_per_cycle,
            fixed,
            material,
            settle,
            global,
            is_full,
            local,
            integrator,
            surface: match file.contact.get_ref().surface {
                SurfaceName::Faceted => ContactSurface::Faceted,
                SurfaceName::Shaded => ContactSurface::Shaded,
                SurfaceName::Subdivision => ContactSurface::Subdivision,
            },
            contact: self.contact(&file.contact)?,
            instrument,
            path,
            smoothing_ticks: smoothing.as_ref().map_or(0, |ticks| *ticks.get_ref()),
            schedule,
            deadline,
            costs,
            mesh,
            warnings,
            source,
        })
    }

    fn name(&self, name: &Spanned<String>) -> Placed<String> {
        let text = name.get_ref();
        let allowed = |c: char| c.is_alphanumeric() || "-_.".contains(c);
        if text.starts_with(char::is_alphanumeric) && text.chars().all(allowed) {
            return Ok(text.clone());
        }
        Err(self.error(Problem::NotAccepted { key: "name", value: format!("{text:?}") }, name.span()))
    }

    fn local(&self, local: &LocalTable) -> Placed<LocalSettings> {
        if let LocalModelName::Full = local.model {
            let unused = [
                ("local.rings", local.rings.as_ref().map(Spanned::span)),
                ("local.linearization", local.linearization.as_ref().map(Spanned::span)),
                ("local.exterior", local.exterior.as_ref().map(Spanned::span)),
                ("local.tangent", local.tangent.as_ref().map(Spanned::span)),
                ("local.condense_rings", local.condense_rings.as_ref().map(Spanned::span)),
                ("local.far_field", local.far_field.as_ref().map(Spanned::span)),
            ];
            for (key, span) in unused {
                self.no_effect(key, span, "`local.model = \"full\"`")?;
            }
            return Ok(LocalSettings::FULL);
        }
        let extent = match &local.rings {
            None => Extent::Rings(1),
            Some(rings) => match rings.get_ref() {
                Rings::Named(AllName::All) => Extent::All,
                Rings::Count(0) => {
                    let problem = Problem::NotAccepted { key: "local.rings", value: "0".to_owned() };
                    return Err(self.error(problem, rings.span()));
                }
                Rings::Count(rings) => Extent::Rings(*rings),
            },
        };
        let tangent = match local.tangent.as_ref().map(Spanned::get_ref) {
            None | Some(TangentName::Exact) => TangentKind::Exact,
            Some(TangentName::Stabilised) => TangentKind::Stabilised,
        };
        let condensed = matches!(local.exterior.as_ref().map(Spanned::get_ref), Some(ExteriorName::Condensed));
        let linearization = match local.linearization.as_ref().map(Spanned::get_ref) {
            None | Some(LinearizationName::Tangent) => Linearization::Tangent(tangent),
            Some(LinearizationName::None) => {
                if !condensed {
                    let span = local.tangent.as_ref().map(Spanned::span);
                    self.no_effect("local.tangent", span, "`local.linearization = \"none\"`")?;
                }
                Linearization::None
            }
        };
        if extent == Extent::All {
            let span = local.exterior.as_ref().map(Spanned::span);
            self.no_effect("local.exterior", span, "`local.rings = \"all\"`")?;
        }
        let exterior = match local.exterior.as_ref().map(Spanned::get_ref) {
            None | Some(ExteriorName::Fixed) => ExteriorKind::Fixed,
            Some(ExteriorName::Drifting) => ExteriorKind::Drifting,
            Some(ExteriorName::Condensed) => {
                ExteriorKind::Condensed(Condensation { tangent, reach: self.reach(local, extent)? })
            }
        };
        if !condensed {
            let because = "a `local.exterior` that is not \"condensed\"";
            self.no_effect("local.condense_rings", local.condense_rings.as_ref().map(Spanned::span), because)?;
            self.no_effect("local.far_field", local.far_field.as_ref().map(Spanned::span), because)?;
        }
        Ok(LocalSettings { extent, linearization, exterior })
    }

    /// How much of a condensed exterior follows.
    fn reach(&self, local: &LocalTable, extent: Extent) -> Placed<Reach> {
        let far_field = match local.far_field.as_ref().map(Spanned::get_ref) {
            None | Some(FarFieldName::Fixed) => FarField::Fixed,
            Some(FarFieldName::Coarse) => FarField::Coarse,
        };
        match local.condense_rings.as_ref().map(|rings| (rings.get_ref(), rings.span())) {
            None | Some((Rings::Named(AllName::All), _)) => {
                let span = local.far_field.as_ref().map(Spanned::span);
                self.no_effect("local.far_field", span, "`local.condense_rings = \"all\"`")?;
                Ok(Reach::All)
            }
            Some((&Rings::Count(rings), span)) => match extent {
                Extent::Rings(patch) if rings <= patch => {
                    let value = format!("{rings}: the patch has {patch} rings, so nothing near it would follow");
                    Err(self.error(Problem::NotAccepted { key: "local.condense_rings", value }, span))
                }
                Extent::Rings(_) | Extent::All => Ok(Reach::Rings { rings, far_field }),
            },
        }
    }

    /// All but the explicit one solve the linear model, with the contact's impulse in the same equations.
    fn integrator(&self, local: &LocalTable, contact: &ContactTable) -> Placed<LocalIntegrator> {
        let Some(name) = &local.integrator else { return Ok(LocalIntegrator::SemiImplicitEuler) };
        let integrator = match name.get_ref() {
            LocalIntegratorName::SemiImplicitEuler => return Ok(LocalIntegrator::SemiImplicitEuler),
            LocalIntegratorName::ImplicitEuler => LocalIntegrator::ImplicitEuler,
            LocalIntegratorName::ImplicitMidpoint => LocalIntegrator::ImplicitMidpoint,
            LocalIntegratorName::Exponential => LocalIntegrator::Exponential,
        };
        let needs = if matches!(local.model, LocalModelName::Full) {
            "`local.model = \"patch\"`"
        } else if matches!(local.linearization.as_ref().map(Spanned::get_ref), Some(LinearizationName::None)) {
            "`local.linearization = \"tangent\"`"
        } else if matches!(contact.scheme, SchemeName::Geometric) {
            "`contact.scheme = \"velocity\"`"
        } else {
            return Ok(integrator);
        };
        let problem = Problem::Needs { key: "local.integrator", value: integrator.name(), needs };
        Err(self.error(problem, name.span()).with_help(format!(
            "give {needs}, or `local.integrator = \"semi-implicit-euler\"`, which takes every model"
        )))
    }

    fn contact(&self, table: &Spanned<ContactTable>) -> Placed<ContactRules> {
        let contact = table.get_ref();
        let friction_span = contact.friction.as_ref().map(Spanned::span);
        let law = match (&contact.law, &contact.friction) {
            (LawName::Sliding, _) => {
                self.no_effect("contact.friction", friction_span, "`contact.law = \"sliding\"`")?;
                Law::Sliding
            }
            (LawName::Sticking, _) => {
                self.no_effect("contact.friction", friction_span, "`contact.law = \"sticking\"`")?;
                Law::Sticking
            }
            (LawName::StickSlip, Some(friction)) => {
                Law::StickSlip { friction: self.number("contact.friction", friction, Sign::NonNegative)? }
            }
            (LawName::StickSlip, None) => {
                return Err(self.error(Problem::Missing("contact.friction"), table.span()));
            }
        };
        Ok(ContactRules {
            law,
            scheme: self.scheme(contact)?,
            wall: Wall {
                stiffness: self.number_or(
                    "contact.wall_stiffness",
                    &contact.wall_stiffness,
                    1000.0,
                    Sign::NonNegative,
                )?,
                damping: self.number_or("contact.wall_damping", &contact.wall_damping, 0.0, Sign::NonNegative)?,
            },
        })
    }

    fn scheme(&self, contact: &ContactTable) -> Placed<Scheme> {
        let (deformation, metric) = (&contact.deformation, &contact.metric);
        if let SchemeName::Velocity = contact.scheme {
            let because = "`contact.scheme = \"velocity\"`";
            self.no_effect("contact.deformation", deformation.as_ref().map(Spanned::span), because)?;
            self.no_effect("contact.metric", metric.as_ref().map(Spanned::span), because)?;
            return Ok(Scheme::Velocity);
        }
        Ok(Scheme::Geometric {
            deformation: match deformation.as_ref().map(Spanned::get_ref) {
                None | Some(DeformationName::Rigid) => Deformation::Rigid,
                Some(DeformationName::LeastNorm) => Deformation::LeastNorm,
            },
            metric: match metric.as_ref().map(Spanned::get_ref) {
                None | Some(MetricName::Euclidean) => Metric::Euclidean,
                Some(MetricName::Mass) => Metric::Mass,
            },
        })
    }

    fn number(&self, key: &'static str, value: &Spanned<f64>, sign: Sign) -> Placed<f64> {
        self.check(key, *value.get_ref(), value.span(), sign)
    }

    fn number_or(&self, key: &'static str, value: &Option<Spanned<f64>>, default: f64, sign: Sign) -> Placed<f64> {
        value.as_ref().map_or(Ok(default), |value| self.number(key, value, sign))
    }

    fn check(&self, key: &'static str, value: f64, span: Range<usize>, sign: Sign) -> Placed<f64> {
        let in_range = match sign {
            Sign::Positive => value > 0.0,
            Sign::NonNegative => value >= 0.0,
        };
        if value.is_finite() && in_range {
            return Ok(value);
        }
        Err(self.error(Problem::NotAccepted { key, value: value.to_string() }, span))
    }

    fn count_or(&self, key: &'static str, value: &Option<Spanned<u32>>, default: u32) -> Placed<u32> {
        match value {
            None => Ok(default),
            Some(value) if *value.get_ref() >= 1 => Ok(*value.get_ref()),
            Some(value) => {
                let problem = Problem::NotAccepted { key, value: value.get_ref().to_string() };
                Err(self.error(problem, value.span()))
            }
        }
    }

    fn no_effect(&self, key: &'static str, span: Option<Range<usize>>, because: &'static str) -> Placed<()> {
        match span {
            Some(span) => Err(self.error(Problem::NoEffect { key, because }, span)),
            None => Ok(()),
        }
    }
}
