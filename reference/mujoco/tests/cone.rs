//! Coulomb friction in the plane: a mass on a rough floor, pulled from rest with more than the bound.
//!
//! Direction and ratio only, averaged over time: MuJoCo's contact is soft along the normal, and may
//! chatter while it slides. The pull is constant, so that velocity, which friction in MuJoCo
//! opposes, and reaction, which (28) goes by, keep one direction.

use mujoco_rs::prelude::*;
use stickslip::Vec3;
use stickslip::contact::law::{Friction, Interface, Law, Mode};
use stickslip::surface::support::{Metric, Support};
use stickslip_mujoco::residual::{check, largest, must_fail};

/// Largest angle between the two friction forces, rad: MuJoCo's solver stops at a tolerance of its
/// own, 1e-8 of a cost that is quadratic in the error. Measured: 6e-15.
const DIRECTION: f64 = 1e-9;
/// Largest difference of |F_T|/F_N, relative to μ. A sliding contact lies on the cone, whatever its
/// load: what is left is round-off, and the solver's tolerance. Measured: 7e-16.
const RATIO: f64 = 1e-9;

const MASS: f64 = 0.02;
const FRICTION: f64 = 0.6;
const GRAVITY: f64 = 9.81;
/// s.
const STEP: f64 = 1e-3;
/// Steps left out while the mass settles on the floor, and steps averaged over.
const SETTLING: usize = 300;
const AVERAGED: usize = 700;

/// MuJoCo's mean force on the floor while the mass slides under a constant pull.
fn mean_force_on_floor(pull: Vec3, cone: &str) -> Vec3 {
    let xml = format!(
        r#"<mujoco>
<option timestep="{STEP}" cone="{cone}" gravity="0 0 -{GRAVITY}"><flag autoreset="disable"/></option>
<worldbody>
<geom type="plane" size="1 1 1" condim="3" friction="{FRICTION} 0 0"/>
<body pos="0 0 0.01">
<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
<geom type="sphere" size="0.01" mass="{MASS}" condim="3" friction="{FRICTION} 0 0"/>
</body>
</worldbody>
</mujoco>"#
    );
    let mut data = MjData::new(Box::new(MjModel::from_xml_string(&xml).expect("MuJoCo takes the model")));
    data.qfrc_applied_mut().copy_from_slice(pull.as_slice());
    let mut sum = Vec3::zeros();
    for step in 0..SETTLING + AVERAGED {
        data.step();
        if step >= SETTLING {
            sum -= Vec3::from_column_slice(data.qfrc_constraint());
        }
    }
    let speed = Vec3::from_column_slice(data.qvel()).norm();
    assert!(speed > 0.1, "it has to slide: {speed} m/s");
    sum / AVERAGED as f64
}

/// Our force on the same floor: the mass is the mesh, the floor the instrument.
fn our_force(pull: Vec3) -> Vec3 {
    let mut support = Support::with_capacity(1);
    support.set(Metric::Mass, [(0, 1.0, 1.0 / MASS)]);
    let reaction = support.reaction(&[pull - Vec3::z() * (MASS * GRAVITY)]);
    let (mode, force) =
        Law::StickSlip { friction: Friction::single(FRICTION) }.contact_force(reaction, -Vec3::z(), Interface::NEW);
    assert_eq!(mode, Mode::Slip);
    force
}

/// Largest angle, and largest difference of the ratios relative to μ, over directions and loads.
fn errors(cone: &str, ours: impl Fn(Vec3) -> Vec3) -> (f64, f64) {
    let (mut direction, mut ratio) = (0.0, 0.0);
    for turn in 0..16 {
        // Not along the axes of the contact frame.
        let angle = 0.1 + f64::from(turn) * std::f64::consts::TAU / 16.0;
        for load in [1.2, 3.0] {
            let pull = Vec3::new(angle.cos(), angle.sin(), 0.0) * (load * FRICTION * MASS * GRAVITY);
            let (ours, theirs) = (ours(pull), mean_force_on_floor(pull, cone));
            let (ours_t, theirs_t) = (ours.xy(), theirs.xy());
            direction = largest([direction, ours_t.perp(&theirs_t).atan2(ours_t.dot(&theirs_t)).abs()]);
            let share = |force: Vec3| force.xy().norm() / -force.z;
            ratio = largest([ratio, (share(ours) - share(theirs)).abs() / FRICTION]);
        }
    }
    (direction, ratio)
}

#[test]
fn friction_has_the_direction_and_ratio_of_the_cone() {
    let (direction, ratio) = errors("elliptic", our_force);
    check("cone: direction of friction while sliding, rad", DIRECTION, direction);
    check("cone: F_T/F_N while sliding, relative to μ", RATIO, ratio);
}

#[test]
fn a_mistake_in_the_cone_shows() {
    let (_, ratio) = errors("pyramidal", our_force);
    must_fail("cone: pyramid instead of a cone", RATIO, ratio);
    let (direction, _) = errors("elliptic", |pull| {
        let force = our_force(pull);
        Vec3::new(-force.x, -force.y, force.z)
    });
    must_fail("cone: friction along the motion", DIRECTION, direction);
}
