//! Custom parts of a run that are given from Python.

use std::path::PathBuf;

use pyo3::prelude::*;
use stickslip::{Instrument, OwnParts, Renderer, RendererLibrary, Scene};

use crate::instrument::PythonInstrument;
use crate::raised::Raised;
use crate::renderer::PythonRenderer;

/// Custom parts: for a renderer in Python its name and the adapter that calls it, for one in a library its path and
/// options; for an instrument the adapter.
#[derive(FromPyObject)]
pub struct Parts {
    renderer: Option<(String, Py<PyAny>)>,
    library: Option<(PathBuf, String)>,
    instrument: Option<Py<PyAny>>,
}

impl Parts {
    /// Returns the scene with its renderer, the parts in Python, and what they will raise.
    ///
    /// A renderer in Python goes by its name where another has the path of its library: in the summary, and in the names
    /// of methods. It is never looked for as a file, since the part itself is given.
    pub fn apply(self, scene: &Scene) -> (Scene, OwnParts, Raised) {
        let (instrument, (scene, renderer, raised)) =
            (self.instrument, Self { instrument: None, ..self }.renderers(scene));
        let instrument = instrument
            .map(|adapter| -> Box<dyn Instrument> { Box::new(PythonInstrument::new(adapter, raised.clone())) });
        let own = OwnParts { renderer: renderer(), instrument, ..OwnParts::default() };
        (scene, own, raised)
    }

    /// Returns the scene with its renderer, what gives the renderer in Python for each of several runs, and what it will
    /// raise in them.
    pub fn renderers(self, scene: &Scene) -> (Scene, impl Fn() -> Option<Box<dyn Renderer>> + Send, Raised) {
        let (mut scene, raised) = (scene.clone(), Raised::default());
        if let Some((path, options)) = self.library {
            scene = scene.with_renderer(RendererLibrary::new(path).with_options(options));
        }
        let adapter = self.renderer.map(|(name, adapter)| {
            scene = scene.clone().with_renderer(RendererLibrary::new(name));
            adapter
        });
        let kept = raised.clone();
        let renderer = move || -> Option<Box<dyn Renderer>> {
            let adapter = Python::attach(|py| Some(adapter.as_ref()?.clone_ref(py)))?;
            Some(Box::new(PythonRenderer::new(adapter, kept.clone())))
        };
        (scene, renderer, raised)
    }
}
