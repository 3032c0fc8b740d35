//! Baselines: the accepted results of a scene, where they came from, and what they replaced.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;

use super::results::Results;
use crate::output::files::{WriteError, write_json};
use crate::scene::Scene;

/// Why there is nothing to compare with.
#[derive(Debug, Error)]
pub enum BaselineError {
    /// No such file, or an empty one.
    #[error("there is no baseline {0}")]
    Missing(PathBuf),
    /// It cannot be read.
    #[error("cannot read {path}: {error}")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// It is not a baseline.
    #[error("{path} is not a baseline: {error}")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Why.
        error: serde_json::Error,
    },
}

/// What produced some results.
///
/// ```
/// use stickslip::{scene::Scene, verify::baseline::Provenance};
///
/// let sliding = Provenance::of(&Scene::shipped("fig3-sliding").expect("shipped with the program"));
/// let sticking = Provenance::of(&Scene::shipped("fig4-sticking").expect("shipped with the program"));
/// assert_eq!(sliding.scene_sha256.len(), 64);
/// assert_ne!(sliding.scene_sha256, sticking.scene_sha256); // another text
/// assert_eq!(sliding.cpu_features, sticking.cpu_features); // the same machine
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Of the program.
    pub version: String,
    /// SHA-256 of the scene's text, in hexadecimal.
    pub scene_sha256: String,
    /// Architecture and operating system.
    pub target: String,
    /// Vector instructions that the compiler was free to use.
    pub compiled_features: Vec<String>,
    /// Vector instructions that the processor has.
    pub cpu_features: Vec<String>,
}

/// How a baseline came to be what it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acceptance {
    /// In the words of whoever accepted it.
    pub reason: String,
    /// Of the program.
    pub version: String,
    /// The value that each changed quantity had before.
    pub previous: BTreeMap<String, serde_json::Value>,
}

/// A scene's accepted results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    /// Its name.
    pub scene: String,
    /// Of the results.
    pub provenance: Provenance,
    /// Oldest first.
    pub accepted: Vec<Acceptance>,
    /// The results.
    pub results: Results,
}

/// Where baselines are.
///
/// ```
/// use stickslip::verify::baseline::{BaselineError, Store};
///
/// let baseline = Store::Program.load("fig3-sliding")?;
/// let folder = tempfile::tempdir()?;
/// let file = baseline.save(folder.path())?;
/// assert_eq!(file, Store::path(folder.path(), "fig3-sliding"));
/// let store = Store::Folder(folder.path().to_owned());
/// assert_eq!(store.load("fig3-sliding")?, baseline); // to the last bit
/// // One that is not there is missing; none is made.
/// assert!(matches!(store.load("fig4-sticking"), Err(BaselineError::Missing(_))));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Store {
    /// A file `<scene>.json` for each.
    Folder(PathBuf),
    /// In the program: those of the shipped scenes.
    Program,
}

macro_rules! in_program {
    ($($name:literal),* $(,)?) => {
        /// (scene, JSON)
        const IN_PROGRAM: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../../fixtures/baselines/", $name, ".json")))),*];
    };
}

in_program! {
    "fig3-sliding",
    "fig4-sticking",
    "fig5-stick-slip",
    "deep-sliding",
    "deep-sticking",
    "deep-stick-slip",
    "deep-stick-slip-faceted",
    "fig3-sliding-subdivision",
    "fig4-sticking-subdivision",
    "fig5-stick-slip-subdivision",
    "deep-sliding-subdivision",
    "deep-sticking-subdivision",
    "deep-stick-slip-subdivision",
}

impl Store {
    /// A scene's file in a folder of baselines.
    pub fn path(folder: &Path, scene: &str) -> PathBuf {
        folder.join(format!("{scene}.json"))
    }

    /// What is accepted for a scene.
    ///
    /// # Errors
    /// If nothing is.
    pub fn load(&self, scene: &str) -> Result<Baseline, BaselineError> {
        let (path, text) = match self {
            Store::Program => {
                let found = IN_PROGRAM.iter().find(|(name, _)| *name == scene);
                (PathBuf::from(scene), found.map_or(String::new(), |(_, text)| (*text).to_owned()))
            }
            Store::Folder(folder) => {
                let path = Self::path(folder, scene);
                let text = match fs::read_to_string(&path) {
                    Ok(text) => text,
                    Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
                    Err(error) => return Err(BaselineError::Unreadable { path, error }),
                };
                (path, text)
            }
        };
        if text.is_empty() {
            return Err(BaselineError::Missing(path));
        }
        serde_json::from_str(&text).map_err(|error| BaselineError::Malformed { path, error })
    }
}

impl Baseline {
    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn save(&self, folder: &Path) -> Result<PathBuf, WriteError> {
        let path = Store::path(folder, &self.scene);
        let failed = |source| WriteError { path: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(failed)?;
        write_json(&path, self)?;
        Ok(path)
    }
}

impl Provenance {
    /// Of what this program computes on this machine from a scene.
    pub fn of(scene: &Scene) -> Self {
        // A scene that was built has no text of its own but what Rust prints of it.
        let text = scene.text().map_or_else(|| format!("{scene:?}"), str::to_owned);
        let hash = Sha256::digest(text.as_bytes());
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_sha256: hash.iter().map(|byte| format!("{byte:02x}")).collect(),
            target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
            compiled_features: listed(&[
                ("sse2", cfg!(target_feature = "sse2")),
                ("avx2", cfg!(target_feature = "avx2")),
                ("fma", cfg!(target_feature = "fma")),
                ("avx512f", cfg!(target_feature = "avx512f")),
                ("neon", cfg!(target_feature = "neon")),
            ]),
            cpu_features: cpu_features(),
        }
    }
}

fn listed(features: &[(&str, bool)]) -> Vec<String> {
    features.iter().filter(|(_, there)| *there).map(|(name, _)| (*name).to_owned()).collect()
}

#[cfg(target_arch = "x86_64")]
fn cpu_features() -> Vec<String> {
    listed(&[
        ("sse2", is_x86_feature_detected!("sse2")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
    ])
}

#[cfg(target_arch = "aarch64")]
fn cpu_features() -> Vec<String> {
    listed(&[("neon", std::arch::is_aarch64_feature_detected!("neon"))])
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn cpu_features() -> Vec<String> {
    Vec::new()
}
