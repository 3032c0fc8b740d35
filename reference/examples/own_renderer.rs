//! A renderer of one's own in place of the local model: a penalty force on the nearest surface node, which pushes the
//! network back.
//!
//! Run it with `cargo run --example own_renderer`.

use stickslip::{
    Body, BodyState, ContactPoint, Mode, OwnParts, Rendered, Renderer, RendererFault, RendererModel, RunError, Scene,
    Simulation, Vec3,
};

/// Builds a model at every hand-over.
#[derive(Debug, Clone)]
struct Penalty {
    stiffness_n_per_m: f64,
}

/// The surface as it was at the hand-over.
#[derive(Debug, Clone)]
struct PenaltyModel {
    stiffness_n_per_m: f64,
    triangles: Vec<[Vec3; 3]>,
}

impl Renderer for Penalty {
    fn build(&mut self, body: Body<'_>, state: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
        let surface = &body.surface.topology;
        let corners = |triangle| surface.triangle_nodes(triangle).map(|node| state.x[node as usize]);
        let triangles = (0..surface.triangles.len() as u32).map(corners).collect();
        Ok(Box::new(PenaltyModel { stiffness_n_per_m: self.stiffness_n_per_m, triangles }))
    }
}

impl RendererModel for PenaltyModel {
    fn tick(&mut self, _before: Vec3, tip: Vec3) -> Result<Rendered, RendererFault> {
        // The triangle whose centre is nearest, as a plane.
        let centre = |[a, b, c]: &[Vec3; 3]| (a + b + c) / 3.0;
        let distance = |corners: &[Vec3; 3]| (centre(corners) - tip).norm();
        let nearest = (0..).zip(&self.triangles).min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
        let Some((triangle, corners)) = nearest else { return Ok(Rendered::FREE) };
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
        let depth = (centre(corners) - tip).dot(&normal);
        if !(depth > 0.0) {
            return Ok(Rendered::FREE);
        }
        let contact = Some((ContactPoint { triangle, weights: [1.0 / 3.0; 3] }, normal));
        Ok(Rendered { force: normal * (self.stiffness_n_per_m * depth), mode: Mode::Slide, contact })
    }
}

fn main() -> Result<(), RunError> {
    let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
    let renderer = Box::new(Penalty { stiffness_n_per_m: 50.0 });
    let own = OwnParts { renderer: Some(renderer), ..OwnParts::default() };
    let (mut peak_n, mut lowest_m) = (0.0_f64, 0.0_f64);
    Simulation::prepare_with(&scene, own)?.run(|tick| {
        peak_n = peak_n.max(tick.force.norm());
        lowest_m = tick.network_state.x.iter().map(|x| x.z).fold(lowest_m, f64::min);
    })?;
    println!("peak force {peak_n:.3} N");
    assert!(peak_n > 0.05 && peak_n < 0.5, "a spring of 50 N/m, pressed by at most 3 mm on a body that yields");
    Ok(())
}
