//! Baselines: the accepted results of a scene, their provenance, and the values that they replaced.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::results::Results;
use crate::output::files::{WriteError, write_json};
use crate::scene::Scene;
use crate::session::{sha256, sha256_of_file};

/// Why no baseline could be loaded.
#[derive(Debug, Error)]
pub enum BaselineError {
    /// The baseline's file is missing or empty.
    #[error("there is no baseline {0}")]
    Missing(PathBuf),
    /// The file cannot be read.
    #[error("cannot read {path}: {error}")]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        #[source]
        error: io::Error,
    },
    /// The file's content is not a baseline.
    #[error("{path} is not a baseline: {error}")]
    Malformed {
        /// Path of the file.
        path: PathBuf,
        /// Error of the JSON reader.
        #[source]
        error: serde_json::Error,
    },
}

/// Provenance of results: program, scene and machine.
///
/// ```
/// use stickslip::{scene::Scene, verify::baseline::Provenance};
///
/// let sliding = Provenance::of(&Scene::shipped("fig3-sliding").expect("shipped with the program"));
/// let sticking = Provenance::of(&Scene::shipped("fig4-sticking").expect("shipped with the program"));
/// assert_eq!(sliding.scene_sha256.len(), 64);
/// assert_ne!(sliding.scene_sha256, sticking.scene_sha256); // other settings
/// assert_eq!(sliding.cpu_features, sticking.cpu_features); // the same machine
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the program.
    pub version: String,
    /// SHA-256 of the scene's settings, without comments and layout, and of the files that it names; in hexadecimal.
    pub scene_sha256: String,
    /// Changes of single keys that the scene was read with, in their order; the hash is that of the changed scene.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
    /// Architecture and operating system.
    pub target: String,
    /// Vector instructions that the compiler was allowed to use.
    pub compiled_features: Vec<String>,
    /// Vector instructions that the processor supports.
    pub cpu_features: Vec<String>,
}

/// Record of one acceptance of a baseline.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acceptance {
    /// Reason, in the words of the person who accepted the results.
    pub reason: String,
    /// Version of the program.
    pub version: String,
    /// Previous value of each quantity that changed.
    pub previous: BTreeMap<String, serde_json::Value>,
}

/// A scene's accepted results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    /// Name of the scene.
    pub scene: String,
    /// Provenance of the results.
    pub provenance: Provenance,
    /// Acceptances, oldest first.
    pub accepted: Vec<Acceptance>,
    /// Tolerances of quantities that need another one than [`SCALED_TOLERANCE`](super::compare::SCALED_TOLERANCE), relative
    /// to the quantity's size. The keys are the names of [`Comparison`](super::compare::Comparison).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub tolerances: BTreeMap<String, f64>,
    /// The accepted results.
    pub results: Results,
}

/// Place in which baselines are stored.
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
    /// A folder with one file `<scene>.json` for each scene.
    Folder(PathBuf),
    /// The baselines of the shipped scenes, built into the program.
    Program,
}

macro_rules! in_program {
    ($($name:literal),* $(,)?) => {
        /// Pairs of scene and JSON text.
        const IN_PROGRAM: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../../fixtures/baselines/", $name, ".json")))),*];
    };
}

in_program! {
    "fig3-sliding",
    "fig4-sticking",
    "fig4-sticking-unilateral",
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
    /// Returns the path of a scene's file in a folder of baselines.
    pub fn path(folder: &Path, scene: &str) -> PathBuf {
        folder.join(format!("{scene}.json"))
    }

    /// Loads the baseline of a scene.
    ///
    /// # Errors
    /// If there is no baseline, or it cannot be read.
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
    /// Writes the baseline to a folder, atomically.
    ///
    /// # Errors
    /// If the folder or the file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<PathBuf, WriteError> {
        let path = Store::path(folder, &self.scene);
        let failed = |source| WriteError { path: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(failed)?;
        write_json(&path, self)?;
        Ok(path)
    }
}

impl Provenance {
    /// Describes this program on this machine, and a scene.
    pub fn of(scene: &Scene) -> Self {
        let mut meaning = scene.meaning();
        for file in scene.named_files() {
            let found = sha256_of_file(&scene.folder().join(file));
            meaning.push_str(found.as_deref().unwrap_or("unreadable"));
        }
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_sha256: sha256(meaning.as_bytes()),
            changes: scene.changes(),
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
