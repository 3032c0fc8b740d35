//! Extreme scenes, each with the outcome that is expected of it: the right answer, by a quantity that is
//! known otherwise, or an error or fault that has a name.

mod watch;

use std::fmt;
use std::path::Path;

use serde::Serialize;

use crate::Vec3;
use crate::contact::law::Law;
use crate::contact::rules::Scheme;
use crate::model::mesh::{Block, Mesh, Stencil};
use crate::multirate::failsafe::{Fault, FaultCause};
use crate::pipeline::{OwnParts, Simulation};
use crate::scene::{MeshSource, Scene, SceneError};
use crate::surface::geometry::ContactSurface;
use crate::verify::accuracy::Method;

use self::watch::Watch;

/// A scene in `fixtures/extremes/`.
///
/// ```
/// use stickslip::verify::extremes::{EXTREMES, Expected, FaultKind, Got, Variant};
///
/// let extreme = EXTREMES.iter().find(|extreme| extreme.name == "stiffness-1e8").expect("it is one of them");
/// // At 10⁸ N/m a tick of 1 ms is far beyond what an explicit step can do: the fail-safe has to end it.
/// assert!(extreme.scene(Variant::AsGiven)?.material.stiffness.range()[0] >= 1e8);
/// let expected = extreme.expected(Variant::AsGiven);
/// assert!(matches!(expected, Expected::Fault(FaultKind::Runaway)));
/// let got = extreme.run(Variant::AsGiven, &expected);
/// assert!(expected.is_met_by(&got), "{got}");
/// assert_eq!(got.name(), "fault");
/// assert!(!expected.is_met_by(&Got::Hung));
/// assert_eq!(extreme.variants().iter().map(|&variant| extreme.contact(variant)).collect::<Vec<_>>(), ["geometric, faceted", "velocity, subdivision"]);
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Extreme {
    /// Its name.
    pub name: &'static str,
    /// Its TOML.
    pub text: &'static str,
    /// Puts another mesh in the place of the scene's block, where that is the extreme.
    pub reshape: Option<fn(&mut Scene) -> Mesh>,
    /// Expected outcome of the scene as its file has it.
    pub expected: Expected,
    /// Expected outcome of the same scene with the velocity scheme over the limit surface, if it is another one.
    pub expected_of_variant: Option<Expected>,
}

/// The contact that an extreme is run with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// As the scene says.
    AsGiven,
    /// The velocity scheme over the limit surface.
    SubdivisionVelocity,
}

/// How an extreme is to end.
#[derive(Debug, Clone, Copy)]
pub enum Expected {
    /// After its duration, nothing having passed through the surface unfelt, every quantity within its
    /// tolerance.
    Answer(&'static [(Quantity, f64)]),
    /// With a fault of this kind.
    Fault(FaultKind),
    /// Before its first tick, with an error that says this.
    Refused(&'static str),
}

/// A [`FaultCause`] without its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// [`FaultCause::ForceNotFinite`].
    ForceNotFinite,
    /// [`FaultCause::StateNotFinite`].
    StateNotFinite,
    /// [`FaultCause::Runaway`].
    Runaway,
    /// [`FaultCause::NoModel`].
    NoModel,
    /// [`FaultCause::Device`] or [`FaultCause::Instrument`].
    Device,
    /// [`FaultCause::Renderer`].
    Renderer,
}

impl FaultKind {
    fn of(cause: &FaultCause) -> Self {
        match cause {
            FaultCause::ForceNotFinite => Self::ForceNotFinite,
            FaultCause::StateNotFinite { .. } => Self::StateNotFinite,
            FaultCause::Runaway { .. } => Self::Runaway,
            FaultCause::NoModel(_) => Self::NoModel,
            FaultCause::Device(_) | FaultCause::Instrument(_) => Self::Device,
            FaultCause::Renderer(_) => Self::Renderer,
        }
    }
}

/// What shows that an answer is right. All are relative unless they have a unit.
#[derive(Debug, Clone, Copy)]
pub enum Quantity {
    /// Instrument, ground and weight are in balance at the end: their sum over the largest of them. The
    /// ground's share is taken from the springs alone.
    Balance,
    /// The force is another scene's at every tick, times a factor: largest difference over largest force.
    SameAs(Twin, f64),
    /// The force ends as another scene's ends.
    EndsAs(Twin),
    /// How far F_T goes beyond μF_N, N.
    Coulomb,
    /// Work that is neither stored nor dissipated, over all work.
    EnergyBalance,
    /// The largest change of the energy of a free body.
    EnergyKept,
    /// How far nodes ever get from their rest places, m. Zero is to the bit.
    Moved(fn(u32) -> bool),
    /// How far nodes are from their rest places at the end, m.
    Remains,
    /// Largest force, N.
    Force,
    /// The force at the end is this, N; relative.
    Ends(f64),
    /// The order, in the age of local models, of the error at the end against another scene: from models that are updated
    /// five times as often. The tolerance is the least. An error that does not vanish with the age has the order 0.
    OrderInAge(Twin),
    /// Share of local models that fell back to the stabilised tangent; the tolerance is the least.
    FellBack,
}

/// A scene made from another one.
pub type Twin = fn(&mut Scene);

impl Quantity {
    fn name(&self) -> &'static str {
        match self {
            Quantity::Balance => "imbalance of instrument, ground and weight",
            Quantity::SameAs(..) => "difference from the reference run's force at every tick",
            Quantity::EndsAs(_) => "difference from the reference run's force at the end",
            Quantity::Coulomb => "F_T beyond μ F_N (N)",
            Quantity::EnergyBalance => "energy residual over work",
            Quantity::EnergyKept => "change of the free body's energy",
            Quantity::Moved(_) => "largest distance from rest (m)",
            Quantity::Remains => "distance from rest at the end (m)",
            Quantity::Force => "largest force (N)",
            Quantity::Ends(_) => "deviation of the force at the end",
            Quantity::OrderInAge(_) => "order of the error in the age of models",
            Quantity::FellBack => "share of models that fell back",
        }
    }

    /// Whether it is a least instead of a most.
    fn is_floor(&self) -> bool {
        matches!(self, Quantity::FellBack | Quantity::OrderInAge(_))
    }
}

/// A quantity of a run.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Measured {
    /// Which.
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// What it may be at most, or at least for what fell back and for an order.
    pub tolerance: f64,
    /// Whether it is.
    pub within: bool,
}

/// How an extreme ended.
#[derive(Debug, Clone)]
pub enum Got {
    /// After its duration.
    Answer {
        /// What was expected to be right.
        measured: Vec<Measured>,
        /// Ticks with the tip inside the surface, no force and no contact kept.
        tunnelling_ticks: u64,
    },
    /// By the fail-safe.
    Fault(Fault),
    /// Before the first tick.
    Refused(String),
    /// With a panic: never right.
    Panicked,
    /// Not within the time it was given: never right.
    Hung,
}

impl Expected {
    /// Whether a run ended so. NaN is within nothing.
    pub fn is_met_by(&self, got: &Got) -> bool {
        match (self, got) {
            (Expected::Answer(quantities), Got::Answer { measured, tunnelling_ticks }) => {
                *tunnelling_ticks == 0 && measured.len() == quantities.len() && measured.iter().all(|m| m.within)
            }
            (Expected::Fault(kind), Got::Fault(fault)) => FaultKind::of(&fault.cause) == *kind,
            (Expected::Refused(words), Got::Refused(error)) => error.contains(words),
            _ => false,
        }
    }
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Expected::Answer(quantities) => {
                write!(f, "result: ")?;
                for (i, (quantity, tolerance)) in quantities.iter().enumerate() {
                    let bound = if quantity.is_floor() { "≥" } else { "≤" };
                    write!(f, "{}{} {bound} {tolerance:.0e}", if i > 0 { "; " } else { "" }, quantity.name())?;
                }
                Ok(())
            }
            Expected::Fault(FaultKind::ForceNotFinite) => f.write_str("fault: force not finite"),
            Expected::Fault(FaultKind::StateNotFinite) => f.write_str("fault: state not finite"),
            Expected::Fault(FaultKind::Runaway) => f.write_str("fault: diverged"),
            Expected::Fault(FaultKind::NoModel) => f.write_str("fault: no model"),
            Expected::Fault(FaultKind::Device) => f.write_str("fault: device out of range"),
            Expected::Fault(FaultKind::Renderer) => f.write_str("fault: renderer failed"),
            Expected::Refused(words) => write!(f, "error: {words}"),
        }
    }
}

impl Got {
    /// In one word.
    pub fn name(&self) -> &'static str {
        match self {
            Got::Answer { tunnelling_ticks: 1.., .. } => "tunnelled",
            Got::Answer { .. } => "answer",
            Got::Fault(_) => "fault",
            Got::Refused(_) => "error",
            Got::Panicked => "panic",
            Got::Hung => "hang",
        }
    }
}

impl fmt::Display for Got {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Got::Answer { measured, tunnelling_ticks } => {
                for (i, m) in measured.iter().enumerate() {
                    write!(f, "{}{} {:.1e}", if i > 0 { "; " } else { "" }, m.quantity, m.value)?;
                }
                if *tunnelling_ticks > 0 { write!(f, "; tunnelled for {tunnelling_ticks} ticks") } else { Ok(()) }
            }
            Got::Fault(fault) => fault.fmt(f),
            Got::Refused(error) => f.write_str(error),
            Got::Panicked => f.write_str("the simulation panicked"),
            Got::Hung => f.write_str("the simulation did not end"),
        }
    }
}

impl Extreme {
    /// What is expected of it.
    pub fn expected(&self, variant: Variant) -> Expected {
        match variant {
            Variant::AsGiven => self.expected,
            Variant::SubdivisionVelocity => self.expected_of_variant.unwrap_or(self.expected),
        }
    }

    /// The variants that are runs of their own: both, or the scene as given alone where it has the velocity scheme over
    /// the limit surface already, or cannot be read.
    pub fn variants(&self) -> Vec<Variant> {
        let [given, variant] = [Variant::AsGiven, Variant::SubdivisionVelocity].map(|variant| self.scene(variant).ok());
        let touching = |scene: &Scene| Method::of(scene).touching;
        if given.as_ref().map(touching) == variant.as_ref().map(touching) {
            vec![Variant::AsGiven]
        } else {
            vec![Variant::AsGiven, Variant::SubdivisionVelocity]
        }
    }

    /// Scheme and surface of the scene that is run, in the words of scenes.
    pub fn contact(&self, variant: Variant) -> String {
        self.scene(variant).map_or_else(
            |_| "none: the scene is refused".to_owned(),
            |scene| {
                let names = Method::of(&scene).touching.names();
                format!("{}, {}", names.scheme, names.surface)
            },
        )
    }

    /// Its scene, with this contact.
    ///
    /// # Errors
    /// If it is refused.
    pub fn scene(&self, variant: Variant) -> Result<Scene, SceneError> {
        let mut scene = Scene::parse(self.text, Path::new(self.name))?;
        if variant == Variant::SubdivisionVelocity {
            (scene.surface, scene.contact.scheme) = (ContactSurface::Subdivision, Scheme::Velocity);
        }
        Ok(scene)
    }

    /// Runs it and measures what `expected` asks for.
    pub fn run(&self, variant: Variant, expected: &Expected) -> Got {
        let scene = match self.scene(variant) {
            Ok(scene) => scene,
            Err(error) => return Got::Refused(error.to_string()),
        };
        let watch = match self.watch(scene.clone()) {
            Ok(watch) => watch,
            Err(got) => return got,
        };
        let quantities: &[(Quantity, f64)] = match expected {
            Expected::Answer(quantities) => quantities,
            Expected::Fault(_) | Expected::Refused(_) => &[],
        };
        let mut measured = Vec::with_capacity(quantities.len());
        let watch_twin = |twin: Twin| {
            let mut other = scene.clone();
            twin(&mut other);
            self.watch(other)
        };
        for (quantity, tolerance) in quantities {
            let value = match quantity {
                Quantity::SameAs(twin, _) | Quantity::EndsAs(twin) => {
                    watch_twin(*twin).map(|other| watch.compare(quantity, &other))
                }
                Quantity::OrderInAge(twin) => watch_twin(*twin).and_then(|other| {
                    let error = |watch: &Watch| watch.compare(&Quantity::EndsAs(*twin), &other);
                    let often = watch_twin(updated_more_often)?;
                    Ok((error(&watch) / error(&often)).ln() / f64::from(AGE_RATIO).ln())
                }),
                _ => Ok(watch.value(quantity)),
            };
            let value = match value {
                Ok(value) => value,
                Err(got) => return got,
            };
            let within = if quantity.is_floor() { value >= *tolerance } else { value <= *tolerance };
            measured.push(Measured { quantity: quantity.name(), value, tolerance: *tolerance, within });
        }
        Got::Answer { measured, tunnelling_ticks: watch.tunnelling_ticks }
    }

    fn watch(&self, mut scene: Scene) -> Result<Watch, Got> {
        let mesh = match self.reshape {
            Some(reshape) => reshape(&mut scene),
            None => scene.mesh.mesh(),
        };
        let simulation = Simulation::prepare_with(&scene, OwnParts { mesh: Some(mesh.clone()), ..OwnParts::default() })
            .map_err(|error| Got::Refused(error.to_string()))?;
        let mut watch = Watch::new(&scene, &mesh);
        simulation.run(|view| watch.see(view)).map_err(Got::Fault)?;
        Ok(watch)
    }
}

/// Balances of what has settled: round-off of forces of some newtons. Measured: 1.3e-13.
const BALANCED: f64 = 1e-12;
/// Forces of two runs that settle at the same place: what the slowest mode has left. Measured: 3.0e-7.
const SETTLED: f64 = 1e-6;
/// Round-off over a run in which nothing but the order of operations differs. Measured: 1.5e-13.
const ROUND_OFF: f64 = 1e-12;
/// Round-off of F_T and μF_N of some newtons, N. Measured: 8.9e-16.
const ON_THE_CONE: f64 = 1e-14;
/// How many times as often models are updated for the order in their age.
const AGE_RATIO: u32 = 5;

macro_rules! extremes {
    ($($name:literal $(reshaped by $reshape:path)? => $expected:expr $(, variant $variant:expr)?;)*) => {
        /// All extremes.
        pub const EXTREMES: &[Extreme] = &[$(Extreme {
            name: $name,
            text: include_str!(concat!("../../fixtures/extremes/", $name, ".toml")),
            reshape: extremes!(@option $($reshape)?),
            expected: $expected,
            expected_of_variant: extremes!(@option $($variant)?),
        }),*];
    };
    (@option) => { None };
    (@option $value:expr) => { Some($value) };
}

use Expected::{Answer, Fault as Faults};
use Quantity::{
    Balance, Coulomb, Ends, EndsAs, EnergyBalance, EnergyKept, FellBack, Force, Moved, OrderInAge, Remains, SameAs,
};

extremes! {
    // A hundredth of the width makes slow modes, which are still dying. Measured: 8.0e-6.
    "needles" reshaped by needles => Answer(&[(Balance, 5e-5)]);
    // A nanometre beside it, over springs of some millimetres. Measured: 1.4e-7.
    "vertex" => Answer(&[(Balance, BALANCED), (SameAs(beside, 1.0), 1e-6)]);
    "edge" => Answer(&[(Balance, BALANCED), (SameAs(beside, 1.0), 1e-6)]);
    "ten-edges" => Answer(&[(Balance, BALANCED), (EndsAs(pressed_at_the_end), SETTLED)]);
    "fast-tip" => Answer(&[(EndsAs(pressed_at_the_end_whole), SETTLED)]);
    "jump" => Answer(&[(Balance, BALANCED), (Coulomb, ON_THE_CONE)]);
    "friction-0" => Answer(&[(EndsAs(sliding), SETTLED), (Coulomb, ON_THE_CONE)]);
    "friction-1e-9" => Answer(&[(EndsAs(sliding), SETTLED), (Coulomb, ON_THE_CONE)]);
    "friction-10" => Answer(&[(SameAs(sticking, 1.0), ROUND_OFF), (Coulomb, ON_THE_CONE)]);
    "friction-1e6" => Answer(&[(SameAs(sticking, 1.0), ROUND_OFF), (Coulomb, ON_THE_CONE)]);
    "masses" => Faults(FaultKind::Runaway), variant Answer(&[(EnergyBalance, 0.05)]);
    // Of first order in the step. Measured: 3.1e-4; where the step is ten times as long, in `masses`, 0.024.
    "masses-fine" => Answer(&[(EnergyBalance, 2e-3)]);
    "stiffness-1e8" => Faults(FaultKind::Runaway);
    "stiffness-1e8-fine" => Answer(&[(SameAs(softer_and_slower, 1e6), ROUND_OFF)]);
    "undamped" => Answer(&[(EnergyKept, 0.05)]);
    "inverted" => Answer(&[(Balance, BALANCED)]);
    "compressed" => Answer(&[(FellBack, 0.01), (EndsAs(whole), 2e-3)]);
    "frozen" => Faults(FaultKind::Runaway);
    // At the end of its 100 ms the model is half as stiff again as it should be, as it lacks what pushes: the force is
    // off by 0.49995, on every machine by the same bits, so that the bound is next to it. Its age is all that is wrong:
    // models updated five times as often are off by 0.088. Order measured: 1.08; theory, for a model that is right where
    // it is fresh: 1.
    "frozen-stabilised" => Answer(&[(Coulomb, ON_THE_CONE), (EndsAs(whole), 0.51), (OrderInAge(whole), 0.9)]);
    // Measured: 0.032.
    "frozen-renewed" => Answer(&[(Coulomb, ON_THE_CONE), (EndsAs(whole), 0.05)]);
    "pieces" reshaped by two_pieces => Answer(&[(Balance, BALANCED), (Moved(in_second_piece), 0.0)]);
    "cut" => Answer(&[(Balance, BALANCED), (Moved(behind_the_wall), 0.0)]);
    // 1000 N/m of rigid ground by 1 mm: less than half of the point's weight is on the free node.
    "one-free-node" => Answer(&[(Balance, BALANCED)]), variant Answer(&[(Ends(1.0), 0.01)]);
    "sag" => Answer(&[(Balance, BALANCED), (Force, 0.0)]);
    "rest-60s" => Answer(&[(Moved(any), 0.0), (Force, 0.0)]);
    // Round-off of coordinates of 0.05 m. Measured: 3.5e-18.
    "rest-24h" => Answer(&[(Remains, 2e-17)]);
}

fn any(_: u32) -> bool {
    true
}

/// Squeezes a block along y to a hundredth.
fn needles(scene: &mut Scene) -> Mesh {
    let mut mesh = scene.mesh.mesh();
    mesh.nodes.iter_mut().for_each(|x| x.y *= 1e-2);
    mesh
}

/// Sets a second block of 3 × 3 × 3 nodes beside the scene's.
fn two_pieces(scene: &mut Scene) -> Mesh {
    let MeshSource::Block(block) = scene.mesh else { return scene.mesh.mesh() };
    let second = Block { nodes: [3; 3], spacing: block.spacing, stencil: Stencil::Shear };
    let aside = Vec3::x() * (block.spacing * block.nodes[0] as f64);
    let (mut mesh, other) = (block.mesh(), second.mesh());
    let first = mesh.nodes.len() as u32;
    mesh.nodes.extend(other.nodes.iter().map(|x| x + aside));
    mesh.edges.extend(other.edges.iter().map(|edge| edge.map(|node| node + first)));
    mesh.triangles.extend(other.triangles.iter().map(|nodes| nodes.map(|node| node + first)));
    scene.fixed.extend((0..other.nodes.len()).map(|node| second.is_bottom(node)));
    let mass = scene.material.node_mass[0];
    scene.material.node_mass.resize(mesh.nodes.len(), mass);
    mesh
}

/// Beyond the 9 × 9 × 4 nodes of the first.
fn in_second_piece(node: u32) -> bool {
    node >= 324
}

/// Of 9 nodes along x, those beyond the middle.
fn behind_the_wall(node: u32) -> bool {
    node % 9 > 4
}

/// A tip a nanometre aside of where nodes and edges are.
fn beside(scene: &mut Scene) {
    scene.path = scene.path.transformed(1.0, |x| x + Vec3::new(1e-9, 0.7e-9, 0.0));
}

/// A tip that goes down where this one ends, and nowhere else.
fn pressed_at_the_end(scene: &mut Scene) {
    let end = scene.path.at(f64::INFINITY);
    scene.path = scene.path.transformed(1.0, |x| Vec3::new(end.x, end.y, x.z));
}

fn pressed_at_the_end_whole(scene: &mut Scene) {
    pressed_at_the_end(scene);
    whole(scene);
}

/// The whole network at the local rate.
fn whole(scene: &mut Scene) {
    *scene = scene.clone().with_full_model();
}

/// The same length of substeps in shorter cycles.
fn updated_more_often(scene: &mut Scene) {
    let ticks_per_cycle = scene.ticks_per_cycle() / AGE_RATIO;
    *scene = scene.clone().with_ticks_per_cycle(ticks_per_cycle);
    scene.global.substeps /= AGE_RATIO;
}

fn sliding(scene: &mut Scene) {
    scene.contact.law = Law::Sliding;
}

fn sticking(scene: &mut Scene) {
    scene.contact.law = Law::Sticking;
}

/// With a millionth of the stiffness, and time a thousand times slower, forces are a millionth.
fn softer_and_slower(scene: &mut Scene) {
    scene.material.stiffness /= 1e6;
    scene.material.damping /= 1e3;
    *scene = scene.clone().with_slower_time(1e3);
}
