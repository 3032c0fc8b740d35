//! Custom parts of a run that are given from Python.

use std::path::PathBuf;

use pyo3::prelude::*;
use stickslip::{OwnParts, RendererLibrary, Scene};

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
        let (mut scene, mut own, raised) = (scene.clone(), OwnParts::default(), Raised::default());
        if let Some((path, options)) = self.library {
            scene = scene.with_renderer(RendererLibrary::new(path).with_options(options));
        }
        if let Some((name, renderer)) = self.renderer {
            scene = scene.with_renderer(RendererLibrary::new(name));
            own.renderer = Some(Box::new(PythonRenderer::new(renderer, raised.clone())));
        }
        if let Some(instrument) = self.instrument {
            own.instrument = Some(Box::new(PythonInstrument::new(instrument, raised.clone())));
        }
        (scene, own, raised)
    }
}
