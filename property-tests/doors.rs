//! Renderers, instruments and contact laws from outside: they keep their contracts, and the built-in parts give the
//! same results through the public traits.

use stickslip::contact::local_renderer::LocalRenderer;
use stickslip::multirate::failsafe::FaultCause;
use stickslip::surface::geometry::ContactPoint;
use stickslip::{
    Body, BodyState, ContactLaw, Instrument, InstrumentFault, Law, Lockstep, Mode, MovedNodes, OwnParts, Rendered,
    Renderer, RendererFault, RendererModel, Scene, Simulation, Vec3,
};

use crate::check::{Worst, shipped};

fn forces(simulation: Simulation) -> Vec<Vec3> {
    let mut forces = Vec::new();
    simulation.run(|tick| forces.push(tick.force)).expect("no fault");
    forces
}

fn with_renderer(renderer: impl Renderer + 'static) -> OwnParts {
    OwnParts { renderer: Some(Box::new(renderer)), ..OwnParts::default() }
}

/// The paper's model through the public trait commands the built-in model's forces to the bit, hand-overs included.
#[test]
fn the_built_in_local_model_through_the_seam_gives_the_same_bits() {
    for name in ["fig3-sliding", "fig5-stick-slip", "fig5-stick-slip-subdivision"] {
        let scene = shipped(name);
        let ours = LocalRenderer::new(scene.contact, scene.local(), scene.integrator);
        let through = Simulation::prepare_with(&scene, with_renderer(ours)).expect("it starts outside");
        assert_eq!(forces(through), forces(Simulation::prepare(&scene).expect("it starts outside")), "{name}");
    }
}

/// Renderer of a constant force on one point of the surface, which moves no nodes itself.
#[derive(Debug, Clone)]
struct Push {
    force: Vec3,
    point: ContactPoint,
}

impl Renderer for Push {
    fn build(&mut self, _: Body<'_>, _: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
        Ok(Box::new(self.clone()))
    }
}

impl RendererModel for Push {
    fn tick(&mut self, _: Vec3, _: Vec3) -> Result<Rendered, RendererFault> {
        Ok(Rendered { force: self.force, mode: Mode::Slide, contact: Some((self.point, Vec3::z())) })
    }
}

/// Without moved nodes the network takes minus the force: a body that floats freely gains its impulse to round-off,
/// whatever substeps and ticks have in common.
#[test]
fn a_renderer_that_moves_no_nodes_pushes_the_network() {
    let momentum = Worst::new("own renderer", "momentum of a floating body - impulse, relative", 1e-12);
    for (integrator, substeps) in [("semi-implicit-euler", 100), ("semi-implicit-euler", 130), ("rk4", 60)] {
        let scene = Scene::parse(
            &format!(
                "name = 'push'\nduration = 0.3\n[mesh]\nnodes = [5, 5, 3]\nspacing = 0.01\nfixed = 'none'\n[material]\n\
                 node_mass = 0.01\nstiffness = 100.0\ndamping = 0.5\n[global]\nintegrator = '{integrator}'\n\
                 substeps = {substeps}\n[contact]\nlaw = 'sliding'\n[instrument]\nwaypoints = [[0.0, 0.0, 0.0, 0.01]]"
            ),
            "push.toml".as_ref(),
        )
        .expect("a scene");
        let (force, point) = (Vec3::new(0.1, 0.0, 0.5), ContactPoint { triangle: 3, weights: [0.2, 0.3, 0.5] });
        let own = with_renderer(Push { force, point });
        let mut run = Lockstep::new(Simulation::prepare_with(&scene, own).expect("it starts outside"));
        let mut moving = Vec3::zeros();
        while let Some(view) = run.step().expect("no fault") {
            moving = view.network_state.v.iter().sum::<Vec3>() * 0.01;
        }
        // The last tick is in the third cycle: the network has been brought over two.
        let expected = force * -0.2;
        momentum.check((moving - expected).norm() / expected.norm());
    }
}

/// A failure of a part from outside ends the run with a fault that names it, and nothing of it is commanded.
#[test]
fn faults_of_own_parts_are_named() {
    #[derive(Debug, Clone)]
    struct Faulty(u32, Rendered, Option<RendererFault>);
    impl Renderer for Faulty {
        fn build(&mut self, _: Body<'_>, _: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
            Ok(Box::new(self.clone()))
        }
    }
    impl RendererModel for Faulty {
        fn tick(&mut self, _: Vec3, _: Vec3) -> Result<Rendered, RendererFault> {
            self.0 += 1;
            match self.2 {
                _ if self.0 < 5 => Ok(Rendered::FREE),
                Some(fault) => Err(fault),
                None => Ok(self.1),
            }
        }
    }
    let scene = shipped("fig3-sliding");
    let nowhere = ContactPoint { triangle: u32::MAX, weights: [1.0, 0.0, 0.0] };
    let fault = RendererFault("out of books");
    let not_finite = Rendered { force: Vec3::repeat(f64::NAN), ..Rendered::FREE };
    let off = Rendered { contact: Some((nowhere, Vec3::z())), ..Rendered::FREE };
    for (rendered, fault, cause) in [
        (Rendered::FREE, Some(fault), FaultCause::Renderer(fault)),
        (not_finite, None, FaultCause::ForceNotFinite),
        (off, None, FaultCause::Renderer(RendererFault("its contact point is not on the surface"))),
    ] {
        let own = with_renderer(Faulty(0, rendered, fault));
        let mut ticks = 0;
        let ended = Simulation::prepare_with(&scene, own).expect("it starts outside").run(|_| ticks += 1);
        let ended = ended.expect_err("a fault");
        assert_eq!((ended.tick, ended.cause, ticks), (4, cause, 4));
    }

    /// Moves a node that there is not from the second model on, or gives it no velocity.
    #[derive(Debug, Clone)]
    struct Mover {
        models: u32,
        has_velocity: bool,
        node: [u32; 1],
    }
    impl Renderer for Mover {
        fn build(&mut self, _: Body<'_>, _: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
            self.models += 1;
            self.node = [if self.models > 1 { u32::MAX } else { 300 }];
            Ok(Box::new(self.clone()))
        }
    }
    impl RendererModel for Mover {
        fn tick(&mut self, _: Vec3, _: Vec3) -> Result<Rendered, RendererFault> {
            Ok(Rendered::FREE)
        }
        fn moved(&self) -> Option<MovedNodes<'_>> {
            const AT: [Vec3; 1] = [Vec3::new(0.0, 0.0, 0.0)];
            Some(MovedNodes { nodes: &self.node, x: &AT, v: if self.has_velocity { &AT } else { &[] } })
        }
    }
    for (has_velocity, tick, reason) in [
        // The nodes are looked at with the cycle in which they moved.
        (true, 200, "it moves nodes that are fixed or that the body does not have"),
        (false, 0, "it does not give a position and a velocity for each node it moves"),
    ] {
        let own = with_renderer(Mover { models: 0, has_velocity, node: [300] });
        let ended = Simulation::prepare_with(&scene, own).expect("it starts outside").run(|_| ());
        let ended = ended.expect_err("a fault");
        assert_eq!((ended.tick, ended.cause), (tick, FaultCause::Renderer(RendererFault(reason))));
    }

    #[derive(Debug, Clone)]
    struct Lost;
    impl Instrument for Lost {
        fn start(&self) -> Vec3 {
            Vec3::z() * 0.002
        }
        fn sense(&mut self, begin_s: f64, _: f64, _: &Vec3) -> Result<Vec3, InstrumentFault> {
            Ok(if begin_s < 0.0095 { Vec3::z() * 0.002 } else { Vec3::repeat(f64::NAN) })
        }
        fn command(&mut self, _: &Vec3) -> Vec3 {
            Vec3::repeat(f64::INFINITY)
        }
        fn release(&mut self) {}
    }
    let own = OwnParts { instrument: Some(Box::new(Lost)), ..OwnParts::default() };
    let mut largest = 0.0_f64;
    let ended = Simulation::prepare_with(&scene, own).expect("it starts outside");
    let ended = ended.run(|tick| largest = largest.max(tick.force.norm())).expect_err("a fault");
    assert_eq!((ended.tick, ended.cause), (10, FaultCause::Instrument(InstrumentFault("its tip is not finite"))));
    assert_eq!(largest, 0.0, "an infinite command went out");
}

/// A scene in which a renderer would get no models is refused.
#[test]
fn a_renderer_without_a_cycle_is_refused() {
    let mut scene = shipped("fig3-sliding");
    scene.global.sync = stickslip::multirate::global::SyncMode::Overwrite;
    let point = ContactPoint { triangle: 0, weights: [1.0, 0.0, 0.0] };
    let refused = Simulation::prepare_with(&scene, with_renderer(Push { force: Vec3::zeros(), point }));
    let refused = refused.expect_err("no cycle is replayed").to_string();
    assert!(refused.contains("sync.mode"), "{refused}");
}

/// A copy taken in the middle of a run continues with identical bits, whichever part is from outside.
#[test]
fn copies_of_a_run_go_on_alike() {
    let scene = shipped("fig5-stick-slip");
    let ours = LocalRenderer::new(scene.contact, scene.local(), scene.integrator);
    let mut run = Lockstep::new(Simulation::prepare_with(&scene, with_renderer(ours)).expect("it starts outside"));
    for _ in 0..250 {
        run.step().expect("no fault");
    }
    let mut copy = run.clone();
    loop {
        let (original, copied) = (run.step().expect("no fault"), copy.step().expect("no fault"));
        assert_eq!(original.as_ref().map(|view| view.force), copied.as_ref().map(|view| view.force));
        if original.is_none() {
            break;
        }
    }
}

/// Coulomb's law, as a law from outside.
#[derive(Debug)]
struct Coulomb(f64);

impl ContactLaw for Coulomb {
    fn contact_force(&self, reaction: Vec3, normal: Vec3) -> (Mode, Vec3) {
        let normal_force = reaction.dot(&normal);
        let tangential = reaction - normal * normal_force;
        let (tangential_force, bound) = (tangential.norm(), self.0 * normal_force);
        if tangential_force <= bound {
            (Mode::Stick, reaction)
        } else {
            (Mode::Slip, normal * normal_force + tangential * (bound / tangential_force))
        }
    }
}

/// Under explicit steps the built-in law and its copy from outside give identical bits, in either scheme.
#[test]
fn the_built_in_law_through_the_door_gives_the_same_bits() {
    static COULOMB: Coulomb = Coulomb(1.0);
    for name in ["fig5-stick-slip", "fig5-stick-slip-subdivision"] {
        let built_in = shipped(name);
        let mut own = shipped(name);
        own.contact.law = Law::Own(&COULOMB);
        let [built_in, own] =
            [built_in, own].map(|scene| forces(Simulation::prepare(&scene).expect("it starts outside")));
        assert_eq!(own, built_in, "{name}");
    }
}

/// Where an impulse moves the whole patch, a law's default impulse makes the contact point follow along the normal and
/// bounds the tangential impulse by the law's force.
#[test]
fn the_default_impulse_of_an_own_law_keeps_contact_and_bound() {
    let follows = Worst::new("own law", "normal velocity of the contact point - wanted, relative", 1e-14);
    let g = stickslip::Mat3::new(2.0, 0.3, 0.1, 0.2, 1.5, -0.2, 0.0, 0.1, 1.0);
    let (r, n) = (Vec3::new(1.0, -0.4, -0.3), Vec3::z());
    let impulse = Coulomb(0.2).impulse(&g, r, n, 1e-3);
    assert_eq!((impulse.mode, impulse.fell_back), (Mode::Slip, false));
    follows.check(((g * impulse.value - r).dot(&n) / r.dot(&n)).abs());
    assert!(impulse.value.dot(&n) < 0.0, "it pushes the mesh");
    let held = Coulomb(1e9).impulse(&g, r, n, 1e-3);
    assert_eq!(held.mode, Mode::Stick);
    follows.check((g * held.value - r).norm() / r.norm());
}

/// Every part from outside can be moved to another thread.
#[test]
fn own_parts_are_send() {
    fn is_send<T: Send>() {}
    is_send::<Box<dyn Renderer>>();
    is_send::<Box<dyn RendererModel>>();
    is_send::<Box<dyn Instrument>>();
    is_send::<Law>();
    is_send::<Simulation>();
}
