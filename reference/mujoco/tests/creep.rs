//! Creep under a constant load inside the friction cone. MuJoCo softens friction, so that a contact that should stick moves
//! at a constant speed (its issue 3328 reports 155 µm/s); ours is held in place.

use mujoco_rs::prelude::*;
use stickslip::contact::law::{Friction, Law, Mode};
use stickslip::contact::rules::Scheme;
use stickslip::device::instrument::InstrumentKind;
use stickslip::pipeline::{self, Simulation};
use stickslip::surface::geometry::ContactSurface;
use stickslip::{Scene, TipPath, Vec3, Waypoint};
use stickslip_mujoco::residual::{check, note};

/// Static friction coefficient μ_s in both simulations.
const FRICTION: f64 = 0.5;
/// Normal force F_N, N.
const NORMAL_FORCE: f64 = 0.7;
/// Tangential force F_T over μ_s F_N.
const SHARE: f64 = 0.9;
/// Time from which motion counts as creep, s.
const SETTLED: f64 = 2.0;
/// End of the observation, s.
const END: f64 = 3.0;

/// Speed, m/s, of a block on a plane under gravity that pulls it down and aside. The cone is elliptic; MuJoCo divides the
/// softness of friction by `impratio`, 1 by default.
fn theirs(impratio: f64) -> f64 {
    let (g, step) = (9.81, 1e-3);
    let xml = format!(
        r#"<mujoco>
<option timestep="{step}" cone="elliptic" impratio="{impratio}" gravity="{} 0 {}"/>
<worldbody>
<geom type="plane" size="1 1 0.1" friction="{FRICTION} 0.005 0.0001"/>
<body pos="0 0 0.01"><freejoint/>
<geom type="box" size="0.01 0.01 0.01" mass="{}" friction="{FRICTION} 0.005 0.0001"/>
</body>
</worldbody>
</mujoco>"#,
        SHARE * FRICTION * g,
        -g,
        NORMAL_FORCE / g
    );
    let model = MjModel::from_xml_string(&xml).expect("MuJoCo takes the model");
    let mut data = MjData::new(Box::new(model));
    let mut run = |seconds: f64| {
        for _ in 0..(seconds / step).round() as u64 {
            data.step();
        }
        data.qpos()[0]
    };
    let start = run(SETTLED);
    (run(END - SETTLED) - start) / (END - SETTLED)
}

/// Speed, m/s, at which the contact moves over the body that the modelled hand presses and drags aside through the
/// PHANTOM, and the mean of F_N and of F_T over μ_s F_N.
fn ours() -> (f64, f64, f64) {
    let at = |time, x, z| Waypoint { time, position: Vec3::new(x, 0.0013, z) };
    let aim = vec![at(0.0, -0.005, 0.002), at(0.4, -0.005, -0.01), at(0.8, -0.005 + 0.0052, -0.01)];
    let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
    let law = Law::StickSlip { friction: Friction::single(FRICTION) };
    let scene = scene.with_surface(ContactSurface::Subdivision).with_scheme(Scheme::Massless).with_law(law);
    let path = TipPath::new(aim).expect("ascending");
    let scene = scene.with_instrument(InstrumentKind::Phantom(Box::default()), path);
    let scene = scene.with_duration_s(END).expect("whole ticks");
    let rest = Simulation::prepare(&scene).expect("it starts outside").network().rest.clone();
    let (mut first, mut last, mut ticks, mut normal, mut share) = (None, Vec3::zeros(), 0.0, 0.0, 0.0);
    pipeline::run(&scene, |view| {
        if view.time <= SETTLED {
            return;
        }
        let touch = view.report.touch.expect("in contact");
        assert_eq!(view.report.mode, Mode::Stick, "at {} s", view.time);
        let corners = view.local.surface().topology.triangle_nodes(touch.point.triangle);
        last = touch.point.position(corners.map(|node| rest[node as usize]));
        first.get_or_insert(last);
        ticks += 1.0;
        normal += view.report.normal_force;
        share += view.report.tangential_force() / (FRICTION * view.report.normal_force);
    })
    .expect("it completes");
    ((last - first.expect("it settles")).norm() / (END - SETTLED), normal / ticks, share / ticks)
}

#[test]
fn a_contact_within_the_cone_stays_where_it_is() {
    let (creep, normal, share) = ours();
    note("creep: ours, F_N, N", normal);
    note("creep: ours, F_T over μ_s F_N", share);
    assert!((normal - NORMAL_FORCE).abs() <= 0.1 && (share - SHARE).abs() <= 0.05, "{normal} N, {share}");
    check("creep under a load within the cone: ours, m/s", 0.0, creep);
    for impratio in [1.0, 10.0] {
        let creep = theirs(impratio);
        note(&format!("creep under a load within the cone: MuJoCo, impratio {impratio}, m/s"), creep);
        assert!(creep > 1e-4, "{creep}");
    }
}
