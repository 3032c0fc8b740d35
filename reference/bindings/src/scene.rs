//! Scenes, as Python holds them.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use toml_edit::DocumentMut;

use crate::error::scene_error;
use crate::keys;

/// A scene that has been read and checked.
#[pyclass(frozen, module = "stickslip._stickslip")]
pub struct Scene {
    /// The scene.
    pub inner: stickslip::Scene,
}

#[pymethods]
impl Scene {
    /// Names of the shipped scenes.
    #[staticmethod]
    fn shipped_names() -> Vec<&'static str> {
        stickslip::scene::SHIPPED.iter().map(|shipped| shipped.name).collect()
    }

    /// Reads a shipped scene; `None` if there is none of this name.
    #[staticmethod]
    fn shipped(name: &str) -> Option<Self> {
        Some(Self { inner: stickslip::Scene::shipped(name)? })
    }

    /// Reads a scene from a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Self::read(py, stickslip::Scene::load(&path))
    }

    /// Reads a scene from TOML. `path` names it in errors, and files that it mentions are relative to it.
    #[staticmethod]
    fn parse(py: Python<'_>, text: &str, path: PathBuf) -> PyResult<Self> {
        Self::read(py, stickslip::Scene::parse(text, &path))
    }

    /// Reads a scene from keys and values.
    #[staticmethod]
    fn build(py: Python<'_>, keys: Vec<(String, Bound<'_, PyAny>)>, path: PathBuf) -> PyResult<Self> {
        Self::change(py, "", keys, &path)
    }

    /// Reads the scene again with other values of some keys.
    fn with_keys(&self, py: Python<'_>, keys: Vec<(String, Bound<'_, PyAny>)>) -> PyResult<Self> {
        Self::change(py, self.text(), keys, self.inner.path_name())
    }

    #[getter]
    fn text(&self) -> &str {
        self.inner.text().unwrap_or_default()
    }

    #[getter]
    fn path(&self) -> String {
        self.inner.path_name().display().to_string()
    }

    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    #[getter]
    fn tick_s(&self) -> f64 {
        self.inner.tick_s()
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }

    #[getter]
    fn tick_count(&self) -> u64 {
        self.inner.tick_count()
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.inner.warnings().into_iter().map(|warning| warning.message).collect()
    }
}

impl Scene {
    fn read(py: Python<'_>, scene: Result<stickslip::Scene, stickslip::SceneError>) -> PyResult<Self> {
        scene.map(|inner| Self { inner }).map_err(|error| scene_error(py, &error))
    }

    fn change(py: Python<'_>, text: &str, keys: Vec<(String, Bound<'_, PyAny>)>, path: &Path) -> PyResult<Self> {
        let (mut changes, mut removed) = (Vec::new(), Vec::new());
        for (key, value) in &keys {
            keys::collect(key, value, &mut changes, &mut removed)?;
        }
        let mut text = Cow::Borrowed(text);
        if !removed.is_empty() {
            // A scene that was read is TOML.
            let mut document: DocumentMut = text.parse().unwrap_or_default();
            removed.iter().for_each(|key| keys::remove(&mut document, key));
            text = document.to_string().into();
        }
        Self::read(py, stickslip::Scene::parse_with(&text, path, &changes))
    }
}
