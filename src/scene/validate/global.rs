//! The `[global]` and `[sync]` parts: how the network is integrated, and how it takes in the local model's cycle.

use super::{Checker, Placed};
use crate::dynamics::constraint::Threads;
use crate::dynamics::integrators::GlobalIntegrator;
use crate::multirate::global::SyncMode;
use crate::scene::GlobalSettings;
use crate::scene::error::Problem;
use crate::scene::file::{GlobalIntegratorName, LocalModelName, SceneFile, SyncName};

impl Checker {
    pub(super) fn global(&self, file: &SceneFile, rate: f64, ticks_per_cycle: u32) -> Placed<GlobalSettings> {
        let latency_ticks = match &file.sync.latency_ticks {
            Some(latency) if *latency.get_ref() >= ticks_per_cycle => {
                let value = format!("{}: one global cycle has {ticks_per_cycle} ticks", latency.get_ref());
                return Err(self.error(Problem::NotAccepted { key: "sync.latency_ticks", value }, latency.span()));
            }
            Some(latency) => *latency.get_ref(),
            None => 0,
        };
        Ok(GlobalSettings {
            rate,
            integrator: match file.global.integrator {
                GlobalIntegratorName::SemiImplicitEuler => GlobalIntegrator::SemiImplicitEuler,
                GlobalIntegratorName::ImplicitEuler => GlobalIntegrator::ImplicitEuler,
                GlobalIntegratorName::Rk4 => GlobalIntegrator::Rk4,
            },
            substeps: self.count_or("global.substeps", &file.global.substeps, 100)?,
            threads: self.threads(file)?,
            sync: match file.sync.mode {
                SyncName::Replay => SyncMode::Replay,
                SyncName::Overwrite => SyncMode::Overwrite,
            },
            latency_ticks,
        })
    }

    fn threads(&self, file: &SceneFile) -> Placed<Threads> {
        const KEY: &str = "global.threads";
        let Some(threads) = &file.global.threads else { return Ok(Threads::One) };
        match threads.get_ref() {
            1 => return Ok(Threads::One),
            2 => {}
            other => {
                return Err(self.error(Problem::NotAccepted { key: KEY, value: other.to_string() }, threads.span()));
            }
        }
        let because = match (&file.global.integrator, &file.sync.mode, &file.local.model) {
            (GlobalIntegratorName::ImplicitEuler, _, _) => {
                "`global.integrator = \"implicit-euler\"`, which one thread solves"
            }
            (GlobalIntegratorName::Rk4, _, _) => "`global.integrator = \"rk4\"`, which one thread integrates",
            (_, SyncName::Overwrite, _) => "`sync.mode = \"overwrite\"`, which holds one point of the whole network",
            (_, _, LocalModelName::Full) => "`local.model = \"full\"`, which leaves no network to a global side",
            _ => return Ok(Threads::Two),
        };
        self.no_effect(KEY, Some(threads.span()), because).map(|()| Threads::One)
    }
}
