//! Conformance: properties that every haptic renderer has, ours or another's, checked over a scene's body and law along
//! motions of the tip that [`motions`] builds where the scene touches.
//!
//! A renderer conforms whatever its method is: nothing is compared with a reference. Each property has a limit, and what
//! was measured stands beside it.

pub mod drive;
pub mod motions;
mod properties;

use serde::Serialize;

use self::drive::{Arrangement, Drive};
use self::motions::{Motion, Site};
use crate::contact::renderer::Renderer;
use crate::output::verdict::Verdict;
use crate::scene::{Scene, SceneError};

/// Factors by which ticks are shortened to see whether forces converge.
const SHORTER: [f64; 2] = [2.0, 4.0];

/// What was found about one property.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PropertyFinding {
    /// Name of the property.
    pub name: &'static str,
    /// PASS, FAIL, or INCONCLUSIVE where it could not be measured.
    pub verdict: Verdict,
    /// What was measured; absent if a fault or a value that is not finite came before.
    pub measured: Option<f64>,
    /// Largest value that passes.
    pub limit: f64,
    /// Unit of both; empty for a ratio.
    pub unit: &'static str,
    /// What the property says.
    pub property: &'static str,
    /// Motions along which it was measured.
    pub motion: String,
    /// The finding in words.
    pub finding: String,
}

/// Conformance of a renderer over one scene: the contents of `conformance.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Conformance {
    /// Version of the program.
    pub version: &'static str,
    /// Name of the scene, whose body, law and surface are used.
    pub scene: String,
    /// The renderer: a library's path, or the scene's own method.
    pub renderer: String,
    /// The worst of the findings.
    pub verdict: Verdict,
    /// Depth of a press, m.
    pub depth_m: f64,
    /// Length of a drag, m.
    pub drag_m: f64,
    /// All properties.
    pub properties: Vec<PropertyFinding>,
}

/// The runs that properties are measured on.
struct Runs {
    site: Site,
    press: Drive,
    press_again: Drive,
    drag: Drive,
    drag_turned: Drive,
    drag_renumbered: Drive,
    /// The drag with ticks of a half and a quarter.
    drag_shorter: [Drive; 2],
    tap: Drive,
    stroke: Drive,
    lift_off: Drive,
    teleport: Drive,
}

/// Number of runs that [`Conformance::of`] makes.
pub const RUNS: u64 = 11;

impl Conformance {
    /// Examines the renderer of a scene. `done` is called after each of [`RUNS`] runs. `None` if the scene's path never
    /// touches the body, so that there is no place to press.
    ///
    /// ```no_run
    /// use stickslip::{output::verdict::Verdict, scene::Scene, verify::conformance::Conformance};
    ///
    /// let scene = Scene::shipped("fig5-stick-slip-subdivision").expect("shipped with the program");
    /// let conformance = Conformance::of(&scene, || ())?.expect("its path touches the block");
    /// let free = &conformance.properties[0];
    /// assert_eq!((free.name, free.verdict, free.measured), ("no-force-when-free", Verdict::Pass, Some(0.0)));
    /// # Ok::<(), stickslip::scene::SceneError>(())
    /// ```
    ///
    /// # Errors
    /// If the scene cannot start.
    pub fn of(scene: &Scene, done: impl FnMut()) -> Result<Option<Self>, SceneError> {
        Self::of_renderer(scene, || None, done)
    }

    /// Examines a custom renderer over a scene's body, as [`of`](Self::of) does. `renderer` gives one for each run; `None`
    /// stands for the scene's own.
    ///
    /// # Errors
    /// If the scene cannot start, or the renderer does not take it.
    pub fn of_renderer(
        scene: &Scene,
        renderer: impl Fn() -> Option<Box<dyn Renderer>>,
        mut done: impl FnMut(),
    ) -> Result<Option<Self>, SceneError> {
        let Some(site) = Site::of(scene)? else { return Ok(None) };
        let mut drive = |motion: Motion, arrangement| -> Result<Drive, SceneError> {
            let drive = Drive::of(&motion.scene(scene, &site)?, renderer(), arrangement)?;
            done();
            Ok(drive)
        };
        let as_is = Arrangement::AsIs;
        let (press, press_again) = (drive(Motion::Press, as_is)?, drive(Motion::Press, as_is)?);
        let drag = drive(Motion::SlowDrag, as_is)?;
        let drag_turned = drive(Motion::SlowDrag, Arrangement::Turned)?;
        let drag_renumbered = drive(Motion::SlowDrag, Arrangement::Renumbered)?;
        let tap = drive(Motion::Tap, as_is)?;
        let stroke = drive(Motion::Stroke, as_is)?;
        let lift_off = drive(Motion::LiftOff, as_is)?;
        let teleport = drive(Motion::Teleport, as_is)?;
        let dragged = Motion::SlowDrag.scene(scene, &site)?;
        let mut shorter = |factor: f64| -> Result<Drive, SceneError> {
            let rate_hz = dragged.local_rate_hz() * factor;
            let drive = Drive::of(&dragged.clone().with_local_rate_hz(rate_hz)?, renderer(), as_is)?;
            done();
            Ok(drive)
        };
        let [half, quarter] = SHORTER;
        let drag_shorter = [shorter(half)?, shorter(quarter)?];
        let runs = Runs {
            site,
            press,
            press_again,
            drag,
            drag_turned,
            drag_renumbered,
            drag_shorter,
            tap,
            stroke,
            lift_off,
            teleport,
        };
        let properties = properties::all(scene, renderer(), &runs)?;
        Ok(Some(Self {
            version: env!("CARGO_PKG_VERSION"),
            scene: scene.name.clone(),
            renderer: match scene.renderer() {
                Some(library) => library.path().display().to_string(),
                None => "the scene's own".to_owned(),
            },
            verdict: properties.iter().map(|finding| finding.verdict).min().unwrap_or(Verdict::Inconclusive),
            depth_m: site.depth_m,
            drag_m: site.length_m,
            properties,
        }))
    }
}
