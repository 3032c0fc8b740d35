//! The servo tick does not allocate: 10⁵ ticks through collision, every contact mode, walks over
//! edges, tension and release, with a counting allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use stickslip::device::coupling::{CouplingSettings, HandOverSmoothing, PassivityController, VirtualCoupling};
use stickslip::device::path::{TipPath, Waypoint};
use stickslip::device::phantom::{Phantom, PhantomSettings};
use stickslip::multirate::timeline::{DeadlineOutcome, OverrunPolicy};
use stickslip::{
    Body, BodyState, ContactLaw, Friction, Instrument, InstrumentFault, Interface, Law, Mode, OwnParts, Rendered,
    Renderer, RendererFault, RendererModel, Scene, Simulation, Vec3,
};

struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Counts this thread's allocations and releases while `work` runs.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = COUNT.with(Cell::get);
    work();
    COUNT.with(Cell::get) - before
}

/// Path in and out of the surface and across it, without a period in common with the mesh.
fn tip(tick: u64) -> Vec3 {
    let t = tick as f64 * 1e-3;
    Vec3::new(0.02 * (1.3 * t).sin(), 0.015 * (0.9 * t).cos(), 0.0005 - 0.002 * (7.0 * t).sin())
}

#[test]
fn a_hundred_thousand_ticks_allocate_nothing() {
    for law in ["\"sliding\"", "\"sticking\"", "\"stick-slip\"\nfriction = 0.3"] {
        let (euler, midpoint, exact) =
            ("integrator = \"implicit-euler\"", "integrator = \"implicit-midpoint\"", "integrator = \"exponential\"");
        for (surface, scheme, local, radius) in [
            ("faceted", "geometric", "rings = 1", 0.0),
            ("shaded", "geometric", "linearization = \"none\"", 0.0),
            ("shaded", "velocity", "exterior = \"drifting\"", 0.0),
            ("subdivision", "geometric", "rings = 1", 0.0),
            ("subdivision", "velocity", "rings = 1", 0.0),
            ("shaded", "velocity", "rings = 1", 0.008),
            ("subdivision", "geometric", "rings = 1", 0.008),
            ("shaded", "geometric", "exterior = \"condensed\"", 0.0),
            (
                "shaded",
                "geometric",
                "exterior = \"condensed\"\nlinearization = \"none\"\ntangent = \"stabilised\"",
                0.0,
            ),
            ("faceted", "velocity", euler, 0.0),
            ("subdivision", "velocity", midpoint, 0.0),
            ("faceted", "velocity", exact, 0.0),
            ("subdivision", "massless", "rings = 1", 0.0),
            ("subdivision", "massless", "rings = 1", 0.008),
            ("faceted", "massless", midpoint, 0.0),
        ] {
            let scene = Scene::parse(
                &format!(
                    "name = 'allocation'\nduration = 1.0\n[mesh]\nnodes = [7, 7, 4]\nspacing = 0.01\n[material]\n\
                     node_mass = 0.01\nstiffness = 100.0\ndamping = 0.5\n[local]\n{local}\n\
                     [contact]\nlaw = {law}\nsurface = '{surface}'\nscheme = '{scheme}'\nradius = {radius}\n[instrument]\nwaypoints = [[0.0, 0.0, 0.015, 0.0025]]"
                ),
                "allocation.toml".as_ref(),
            )
            .expect("a scene");
            let mut local = Simulation::prepare(&scene).expect("it starts outside").into_sides().servo.into_local();
            let mut seen = [0_u64; 4];
            let (mut collisions, mut releases, mut tension, mut crossings) = (0, 0, 0, 0);
            let mut triangle = None;
            let ticks = if law.contains("slip") && surface == "faceted" { 100_000 } else { 10_000 };
            let count = allocations(|| {
                for tick in 0..ticks {
                    let report = local.tick(tip(tick), tip(tick + 1));
                    seen[match report.mode {
                        Mode::Free => 0,
                        Mode::Stick => 1,
                        Mode::Slide => 2,
                        Mode::Slip => 3,
                    }] += 1;
                    collisions += u64::from(report.collision_time.is_some());
                    releases += u64::from(report.released);
                    tension += u64::from(report.touch.is_none() && local.contact().is_some());
                    let now = report.touch.map(|touch| touch.point.triangle);
                    crossings += u64::from(now.is_some() && triangle.is_some() && now != triangle);
                    triangle = now;
                }
            });
            assert_eq!(count, 0, "{law} {surface}: {count} calls of the allocator in {ticks} ticks");
            // The only model's patch is left now and then: rigid ground slides under every law.
            let mut expected = match scene.contact.law {
                Law::Sliding => [true, false, true, false],
                Law::Sticking => [true, true, true, false],
                Law::StickSlip { .. } | Law::Own(_) => [true; 4],
            };
            // Under the massless scheme a contact that was torn off slides or slips, until the tip turns round.
            if scheme == "massless" && scene.contact.law != Law::Sliding {
                (expected[1], expected[2]) = (seen[1] > 0, seen[2] > 0);
            }
            // The patch of a disc is larger, and a contact that sticks need not leave it.
            if radius > 0.0 && scene.contact.law != Law::Sliding {
                expected[2] = seen[2] > 0;
            }
            assert_eq!(seen.map(|count| count > 0), expected, "{law} {surface}: {seen:?}");
            assert!(tension > 0, "{law} {surface}: no tension");
            assert!(law.contains("sticking") || crossings > 10, "{law} {surface}: {crossings} edges");
            assert!(collisions > 1 && releases > 1, "{law} {surface}: {collisions} collisions, {releases} releases");
        }
    }
}

/// A disc on a block that can turn, for which rotations are computed.
#[test]
fn a_turning_block_allocates_nothing() {
    let text = include_str!("turning-disc.toml");
    let scene = Scene::parse(text, "allocation.toml".as_ref()).expect("a scene");
    let mut servo = Simulation::prepare(&scene).expect("it starts outside").into_sides().servo;
    let mut touching = 0;
    let count = allocations(|| {
        for _ in 0..150 {
            let done = servo.tick(DeadlineOutcome::OnTime).expect("no fault");
            touching += u32::from(done.report.touch.is_some());
        }
    });
    assert!(touching > 50, "{touching} ticks in contact");
    assert_eq!(count, 0);
}

/// The counter does count, so that a count of zero has a meaning.
#[test]
fn the_counter_counts() {
    assert!(allocations(|| drop(std::hint::black_box(Box::new(1)))) == 2);
}

/// The modelled device with every optional stage before it, pressed into a wall.
#[test]
fn a_modelled_device_allocates_nothing() {
    let waypoints = [(0.0, 0.002), (1.0, -0.01)];
    let waypoints = waypoints.map(|(time, height)| Waypoint { time, position: Vec3::z() * height });
    let path = TipPath::new(waypoints.to_vec()).expect("ascending");
    let mut phantom = Phantom::new(PhantomSettings::default(), &path, 1e-3).expect("near home");
    let settings = CouplingSettings { stiffness: 500.0, damping: 5.0, mass: 0.05 };
    let mut before = phantom.measured_tip();
    let mut coupling = VirtualCoupling::new(settings, 1e-3, before).expect("heavy enough");
    let mut passivity = PassivityController::default();
    let mut smoothing = HandOverSmoothing::new(20);
    let (mut contact, mut most) = (Vec3::zeros(), 0.0_f64);
    let count = allocations(|| {
        for tick in 0..2000 {
            let measured = phantom.advance(tick as f64 * 1e-3).expect("within the workspace");
            let tip = coupling.advance(&measured, &contact);
            contact = smoothing.command(&(Vec3::z() * (-800.0 * tip.z).max(0.0)), tick % 100 == 0);
            let force = passivity.command(&coupling.force(), &(measured - before));
            most = most.max(phantom.command(&force).norm());
            before = measured;
        }
    });
    assert!(most > 0.1, "no contact: {most} N");
    assert_eq!(count, 0);
}

/// The loop with device, coupling, passivity control and smoothing, also where ticks are late.
#[test]
fn a_servo_tick_with_a_device_allocates_nothing() {
    let text = include_str!("../fixtures/closed-loop/stick-slip-by-hand.toml")
        .replace("kind = ", "smoothing_ticks = 20\npassivity_control = true\ncoupling = {}\nkind = ");
    let scene = Scene::parse(&text, "allocation.toml".as_ref()).expect("a scene");
    let mut servo = Simulation::prepare(&scene).expect("it starts outside").into_sides().servo;
    let mut touching = 0;
    let count = allocations(|| {
        for tick in 0..1000 {
            let deadline_outcome = match tick % 10 {
                3 => DeadlineOutcome::Late(OverrunPolicy::Hold),
                5 => DeadlineOutcome::Late(OverrunPolicy::Zero),
                7 => DeadlineOutcome::Late(OverrunPolicy::Skip),
                8 => DeadlineOutcome::Skipped,
                _ => DeadlineOutcome::OnTime,
            };
            let done = servo.tick(deadline_outcome).expect("no fault");
            touching += u32::from(done.report.touch.is_some());
        }
    });
    assert!(touching > 500, "{touching} ticks in contact");
    assert_eq!(count, 0);
}

/// A servo tick with a law, an instrument and a renderer from outside.
#[test]
fn a_servo_tick_with_own_parts_allocates_nothing() {
    #[derive(Debug)]
    struct Coulomb;
    impl ContactLaw for Coulomb {
        fn contact_force(&self, reaction: Vec3, normal: Vec3) -> (Mode, Vec3) {
            Law::StickSlip { friction: Friction::single(0.3) }.contact_force(reaction, normal, Interface::NEW)
        }
    }
    #[derive(Debug, Clone)]
    struct Press;
    impl Instrument for Press {
        fn start(&self) -> Vec3 {
            Vec3::new(0.0, 0.0, 0.002)
        }
        fn sense(&mut self, _: f64, end_s: f64, _: &Vec3) -> Result<Vec3, InstrumentFault> {
            Ok(Vec3::new(0.02 * end_s, 0.0, (0.002 - 0.03 * end_s).max(-0.003)))
        }
        fn command(&mut self, contact_force: &Vec3) -> Vec3 {
            *contact_force
        }
        fn release(&mut self) {}
    }
    #[derive(Debug, Clone)]
    struct Floor;
    impl Renderer for Floor {
        fn build(&mut self, _: Body<'_>, _: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
            Ok(Box::new(Floor))
        }
    }
    impl RendererModel for Floor {
        fn tick(&mut self, _: Vec3, tip: Vec3) -> Result<Rendered, RendererFault> {
            let (force, mode) = (Vec3::z() * (-100.0 * tip.z).max(0.0), Mode::Slide);
            Ok(Rendered { force, mode, contact: None })
        }
    }

    let mut scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
    scene.contact.law = Law::Own(&Coulomb);
    let renderers: [Option<Box<dyn Renderer>>; 2] = [None, Some(Box::new(Floor))];
    for renderer in renderers {
        let own = OwnParts { instrument: Some(Box::new(Press)), renderer, ..OwnParts::default() };
        let mut servo = Simulation::prepare_with(&scene, own).expect("it starts outside").into_sides().servo;
        let mut pressing = 0;
        let count = allocations(|| {
            for _ in 0..1000 {
                let done = servo.tick(DeadlineOutcome::OnTime).expect("no fault");
                pressing += u32::from(done.force.z > 0.0);
            }
        });
        assert!(pressing > 500, "{pressing} ticks with a force");
        assert_eq!(count, 0);
    }
}
