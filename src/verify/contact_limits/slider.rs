//! Stick-slip of one mass on one spring under a tip that drags it, compared with its closed form.

use std::sync::Arc;

use super::{LimitError, Measured};
use crate::Vec3;
use crate::contact::law::{Friction, Law, Mode};
use crate::contact::rules::{ContactRules, Scheme, Wall};
use crate::contact::simulation::LocalSimulation;
use crate::local::model::{LocalModelBuilder, LocalSettings};
use crate::model::mesh::Mesh;
use crate::model::network::{Material, Network};
use crate::model::topology::Surface;
use crate::surface::geometry::SurfaceModel;

/// Stick-slip of one mass on one spring, m = 10 g and k = 100 N/m, under a tip that drags it at v = 1 mm/s with μ_s = 0.6
/// and μ_k = 0.3.
///
/// Closed form without dampers, with ω = √(k/m) and Δ = (μ_s − μ_k)F_N/k: the spring's stretch falls by 2Δ within
/// T = (2/ω)(π − arctan(ωΔ/v)), in which the tip slips by 2Δ + vT over the surface.
pub(super) fn spring_slider(scheme: Scheme) -> Result<Vec<Measured>, LimitError> {
    let cycle = Slider::new(scheme, 8000.0)?.first_slip();
    let [drop, time, way] = cycle.map_or([f64::NAN; 3], |slip| {
        let (natural, delta) = ((STIFFNESS / MASS).sqrt(), (0.6 - 0.3) * slip.normal_force / STIFFNESS);
        let time = 2.0 / natural * (std::f64::consts::PI - (natural * delta / DRAW).atan());
        [slip.drop / (2.0 * delta), slip.time / time, slip.way / (2.0 * delta + DRAW * time)]
    });
    Ok([("drop of the stretch", drop), ("slip time", time), ("slip distance", way)]
        .map(|(name, ratio)| {
            Measured::at_most(
                format!("spring and slider: deviation of the {name} from the closed form"),
                "%",
                2.0,
                100.0 * (ratio - 1.0).abs(),
            )
        })
        .into())
}

const MASS: f64 = 0.01;
const STIFFNESS: f64 = 100.0;
/// Speed of the tip, m/s.
const DRAW: f64 = 1e-3;

/// One free node on a spring along x and one along z, under a tip that drags it along x.
struct Slider {
    local: LocalSimulation,
    tick_s: f64,
}

/// The first slip of a slider.
struct Slip {
    drop: f64,
    time: f64,
    way: f64,
    normal_force: f64,
}

impl Slider {
    fn new(scheme: Scheme, rate_hz: f64) -> Result<Self, LimitError> {
        // The tip is 1 mm beside the free corner of a triangle of 1 m, whose other corners weigh a thousandth each.
        let mesh = Mesh {
            nodes: vec![Vec3::zeros(), Vec3::x(), Vec3::y(), -Vec3::z()],
            edges: vec![[0, 1], [0, 3]],
            triangles: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
            tetrahedra: vec![],
        };
        let material = Material::uniform(4, MASS, STIFFNESS, 0.0);
        let network = Network::new(&mesh, &material, vec![false, true, true, true])?;
        let surface = Surface::new(&mesh)?;
        let surface = SurfaceModel::faceted(Arc::new(surface));
        let mut builder = LocalModelBuilder::new(&network, surface.clone(), LocalSettings::FULL);
        let built = builder.build(&network, &network.rest_state(), Vec3::zeros(), None);
        let (model, state) = built?;
        let law = Law::StickSlip { friction: Friction { static_coefficient: 0.6, kinetic_coefficient: 0.3 } };
        let rules = ContactRules { law, scheme, adhesion_n: 0.0, wall: Wall::default() };
        let tick_s = 1.0 / rate_hz;
        Ok(Self { local: LocalSimulation::new(rules, tick_s, surface, model, state), tick_s })
    }

    /// Presses 1 mm deep and drags until the first slip has ended; `None` if it has not within 5 s, or contact is lost.
    fn first_slip(mut self) -> Option<Slip> {
        let mut tip = Vec3::new(1e-3, 1e-3, 5e-4);
        let mut step = |local: &mut LocalSimulation, by: Vec3| {
            let next = tip + by;
            let report = local.tick(tip, next);
            tip = next;
            report
        };
        let press = (0.15 / self.tick_s) as u32;
        for _ in 0..press {
            step(&mut self.local, -Vec3::z() * (0.01 * self.tick_s));
        }
        let stretch = |local: &LocalSimulation| local.state().x[0].x;
        let (mut begun, mut ticks) = (None, 0_u32);
        let longest = (5.0 / self.tick_s) as u32;
        for _ in 0..longest {
            let before = stretch(&self.local);
            let report = step(&mut self.local, Vec3::x() * (DRAW * self.tick_s));
            match (report.mode, begun) {
                (Mode::Slip, None) => begun = Some((before, report.normal_force)),
                (Mode::Slip, Some(_)) => ticks += 1,
                (Mode::Stick, Some((from, normal_force))) => {
                    let (drop, time) = (from - stretch(&self.local), f64::from(ticks) * self.tick_s);
                    return Some(Slip { drop, time, way: drop + DRAW * time, normal_force });
                }
                (Mode::Free | Mode::Slide, _) => return None,
                _ => {}
            }
        }
        None
    }
}
