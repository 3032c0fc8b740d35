//! Renderers in shared libraries, behind the C interface of `reference/include/stickslip_renderer.h`.
//!
//! [`open`] gives the renderer of a library as a [`Renderer`]. It runs in a child process wherever no clock is
//! certified: a library that crashes, hangs or writes beyond its arrays ends that process, and the run ends with a fault
//! that names the call. In real time it runs in this process, on the servo thread itself.

#[cfg(all(feature = "external", target_os = "linux"))]
pub mod abi;
#[cfg(all(feature = "external", target_os = "linux"))]
mod arrays;
#[cfg(all(feature = "external", target_os = "linux"))]
mod frames;
#[cfg(all(feature = "external", target_os = "linux"))]
pub mod host;
#[cfg(all(feature = "external", target_os = "linux"))]
mod in_process;
#[cfg(all(feature = "external", target_os = "linux"))]
mod library;
#[cfg(all(feature = "external", target_os = "linux"))]
mod process;

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::contact::renderer::Renderer;

/// Default of the time within which a call has to return, in a child process.
const TIMEOUT: Duration = Duration::from_secs(10);

/// A renderer in a shared library, in place of a scene's local model, contact scheme and law.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RendererLibrary {
    path: PathBuf,
    options: String,
    host: Option<PathBuf>,
    timeout: Duration,
}

impl RendererLibrary {
    /// Names a library. Its renderer runs in this process, without options.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), options: String::new(), host: None, timeout: TIMEOUT }
    }

    /// Sets the text that the library alone interprets.
    pub fn with_options(self, options: impl Into<String>) -> Self {
        Self { options: options.into(), ..self }
    }

    /// Runs the renderer in a child process. `host` is the `stickslip` program, which serves it there.
    pub fn hosted_by(self, host: impl Into<PathBuf>) -> Self {
        Self { host: Some(host.into()), ..self }
    }

    /// Runs the renderer in this process, as real time needs it.
    pub fn in_process(self) -> Self {
        Self { host: None, ..self }
    }

    /// Sets the time within which a call in a child process has to return.
    pub fn with_timeout(self, timeout: Duration) -> Self {
        Self { timeout, ..self }
    }

    /// Returns the path of the library.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the text that the library alone interprets.
    pub fn options(&self) -> &str {
        &self.options
    }

    /// Whether the renderer runs in a child process.
    pub fn is_hosted(&self) -> bool {
        self.host.is_some()
    }
}

/// Why a library's renderer cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, Error, Serialize, Deserialize)]
#[non_exhaustive]
pub enum LibraryError {
    /// The library cannot be loaded.
    #[error("cannot load the renderer {path}: {reason}")]
    NotLoaded {
        /// Path of the library.
        path: PathBuf,
        /// The loader's message.
        reason: String,
    },
    /// The library lacks a function of the interface.
    #[error("the renderer {path} does not define `{symbol}`")]
    Lacks {
        /// Path of the library.
        path: PathBuf,
        /// Name of the function.
        symbol: String,
    },
    /// The library was written against another version of the interface.
    #[error("the renderer {path} has version {found} of the interface; this program has version {expected}")]
    OtherVersion {
        /// Path of the library.
        path: PathBuf,
        /// Version of the library.
        found: u32,
        /// Version of this program.
        expected: u32,
    },
    /// The process that should serve the library does not answer.
    #[error("the process that loads the renderer {path} failed: {reason}")]
    NoHost {
        /// Path of the library.
        path: PathBuf,
        /// What happened to the process.
        reason: String,
    },
    /// This build leaves out renderers in libraries.
    #[error("this build cannot load the renderer {path}: renderers in libraries need Linux and the feature `external`")]
    NotBuiltIn {
        /// Path of the library.
        path: PathBuf,
    },
}

/// Opens the renderer of a library: in a child process if it is hosted, in this one otherwise.
///
/// # Errors
/// If the library cannot be loaded, has another version of the interface, or lacks a function.
#[cfg(all(feature = "external", target_os = "linux"))]
pub fn open(library: &RendererLibrary) -> Result<Box<dyn Renderer>, LibraryError> {
    Ok(match &library.host {
        Some(host) => Box::new(process::HostedRenderer::open(library, host)?),
        None => Box::new(in_process::LibraryRenderer::open(library)?),
    })
}

/// Refuses the renderer of a library, which this build cannot load.
///
/// # Errors
/// Always.
#[cfg(not(all(feature = "external", target_os = "linux")))]
pub fn open(library: &RendererLibrary) -> Result<Box<dyn Renderer>, LibraryError> {
    Err(LibraryError::NotBuiltIn { path: library.path.clone() })
}
