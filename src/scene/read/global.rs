//! The `[global]` and `[sync]` tables: integration of the network, and its coupling to the local model's cycle.

use super::Read;
use crate::dynamics::constraint::Threads;
use crate::scene::GlobalSettings;
use crate::scene::error::Problem;
use crate::scene::file::SceneFile;

pub(super) fn global(file: &SceneFile) -> Read<GlobalSettings> {
    let default = GlobalSettings::default();
    Ok(GlobalSettings {
        integrator: file.global.integrator,
        substeps: file.global.substeps.unwrap_or(default.substeps),
        threads: match file.global.threads {
            None => default.threads,
            Some(1) => Threads::One,
            Some(2) => Threads::Two,
            Some(other) => {
                return Err(Problem::NotAccepted { key: "global.threads", value: other.to_string() });
            }
        },
        sync: file.sync.mode,
        latency_ticks: file.sync.latency_ticks.unwrap_or(default.latency_ticks),
    })
}
