//! Options for a renderer in a shared library, on the commands that take one.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use crate::external::RendererLibrary;
use crate::scene::Scene;

#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Renderer")]
pub struct RendererArguments {
    /// A shared library whose renderer takes the place of the scene's local model, contact scheme and contact law; its
    /// functions are those of reference/include/stickslip_renderer.h
    #[arg(long, value_name = "LIB")]
    renderer: Option<PathBuf>,
    /// Text that the renderer interprets
    #[arg(long, value_name = "TEXT", requires = "renderer")]
    renderer_options: Option<String>,
    /// Time within which every call of a renderer has to return, in its process (default: 10)
    #[arg(long, value_name = "S", value_parser = seconds)]
    timeout: Option<Duration>,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().filter(|&seconds: &f64| seconds > 0.0);
    seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()).ok_or("give a number above 0".to_owned())
}

impl RendererArguments {
    /// Gives a scene the renderer of the command line. Renderers in libraries run in a process of their own.
    pub fn apply(&self, scene: Scene) -> Scene {
        let named = self.renderer.as_ref().map(RendererLibrary::new);
        let Some(library) = named.or_else(|| scene.renderer().cloned()) else { return scene };
        let library = match &self.renderer_options {
            Some(options) => library.with_options(options),
            None => library,
        };
        let library = match self.timeout {
            Some(timeout) => library.with_timeout(timeout),
            None => library,
        };
        // Without the program's own path, the library runs in this process.
        let library = match std::env::current_exe() {
            Ok(program) => library.hosted_by(program),
            Err(_) => library,
        };
        scene.with_renderer(library)
    }
}
