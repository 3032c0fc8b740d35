//! The built-in local models behind the door for custom renderers: the same ticks, through the same calls as another's.

use std::any::Any;

use super::renderer::{Body, BodyState, MovedNodes, Rendered, Renderer, RendererFault, RendererModel, Setup};
use super::rules::ContactRules;
use super::simulation::LocalSimulation;
use crate::Vec3;
use crate::local::model::{LocalModel, LocalModelBuilder, LocalSettings, LocalState};
use crate::local::step::LocalIntegrator;
use crate::model::state::State;

/// A built-in local model as a [`Renderer`]. It commands the forces of a scene with the same settings to the bit, and so
/// shows that the door hides nothing from a renderer, and what it costs.
///
/// ```
/// use stickslip::{OwnParts, Scene, Simulation, contact::local_renderer::LocalRenderer};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program").with_ticks(250);
/// let ours = LocalRenderer::new(scene.contact, scene.local(), scene.integrator);
/// let own = OwnParts { renderer: Some(Box::new(ours)), ..OwnParts::default() };
/// let (mut through, mut direct) = (Vec::new(), Vec::new());
/// Simulation::prepare_with(&scene, own)?.run(|tick| through.push(tick.force))?;
/// Simulation::prepare(&scene)?.run(|tick| direct.push(tick.force))?;
/// assert_eq!(through, direct);
/// # Ok::<(), stickslip::RunError>(())
/// ```
#[derive(Debug, Clone)]
pub struct LocalRenderer {
    rules: ContactRules,
    settings: LocalSettings,
    integrator: LocalIntegrator,
    tick_s: f64,
    builder: Option<LocalModelBuilder>,
}

#[derive(Debug, Clone)]
struct LocalRendererModel {
    local: LocalSimulation,
    /// The model and state that the first tick takes over.
    next: Option<(LocalModel, LocalState)>,
    tip: Vec3,
}

impl LocalRenderer {
    /// Sets rules of contact, local model and integrator.
    pub fn new(rules: ContactRules, settings: LocalSettings, integrator: LocalIntegrator) -> Self {
        Self { rules, settings, integrator, tick_s: 0.0, builder: None }
    }
}

impl Renderer for LocalRenderer {
    fn create(&mut self, body: Body<'_>, setup: &Setup) -> Result<(), RendererFault> {
        let builder = LocalModelBuilder::new(body.network, body.surface.clone(), self.settings);
        self.tick_s = setup.tick_s;
        self.builder = Some(builder.with_integrator(self.integrator, setup.tick_s));
        Ok(())
    }

    fn build(&mut self, body: Body<'_>, state: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
        let builder = self.builder.as_mut().ok_or(RendererFault("it was not created for a body"))?;
        let network = State { x: state.x.to_vec(), v: state.v.to_vec() };
        let contact = state.last.contact.map(|(point, _)| point);
        let around = contact.map_or(state.tip, |point| {
            body.surface.node_weights(&point).map(|(node, weight)| state.x[node] * weight).sum()
        });
        let (model, local_state) = builder
            .build(body.network, &network, around, contact.map(|point| point.triangle))
            .map_err(|error| RendererFault::with_text(error.to_string()))?;
        let next = Some((model.clone(), local_state.clone()));
        let local = LocalSimulation::new(self.rules, self.tick_s, body.surface.clone(), model, local_state);
        Ok(Box::new(LocalRendererModel { local, next, tip: state.tip }))
    }
}

impl RendererModel for LocalRendererModel {
    fn take_over(&mut self, old: Option<&mut dyn RendererModel>) {
        let old = old.and_then(|old| (old as &mut dyn Any).downcast_mut::<Self>());
        let (Some(old), Some((model, state))) = (old, self.next.take()) else { return };
        // The contact and what it remembers stay; the old model goes back with the new simulation around it.
        std::mem::swap(&mut self.local, &mut old.local);
        self.local.hand_over(model, state, 0, old.tip);
    }

    fn tick(&mut self, before: Vec3, tip: Vec3) -> Result<Rendered, RendererFault> {
        self.tip = tip;
        Ok(self.local.tick(before, tip).rendered())
    }

    fn moved(&self) -> Option<MovedNodes<'_>> {
        let (nodes, state) = (&self.local.model().patch.nodes, self.local.state());
        Some(MovedNodes { nodes, x: &state.x[..nodes.len()], v: &state.v[..nodes.len()] })
    }
}
