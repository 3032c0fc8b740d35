//! Virtual walls in the modelled loop: the stiffest quiet one compared with published bounds, and the tip at rest.

use std::f64::consts::TAU;

use stickslip::device::phantom::hand::HandSettings;
use stickslip::device::phantom::kinematics::UPPER_LINK;
use stickslip::device::phantom::structure::StructureSettings;
use stickslip::device::phantom::{DeviceError, PhantomSettings};
use stickslip::verify::buzz::stiffest_clean_n_per_m;
use stickslip::verify::z_width::{QUIET_M, VirtualWall, ZWidthError, touch, wall_limit};

use crate::check::Worst;

fn range_m(rate: f64, stiffness: f64, damping: f64) -> f64 {
    let wall = VirtualWall { stiffness_n_per_m: stiffness, damping_n_s_per_m: damping };
    touch(&PhantomSettings::default(), rate, &wall).expect("a wall").range_m
}

#[test]
fn walls_that_have_to_be_passive_are_quiet_and_stiffer_ones_shake() {
    // Measured: 11548, 10182 and 17943 N/m at 1 kHz, 59352 N/m at 10 kHz. The onset of oscillation scatters by a tenth.
    let cases = [(1e3, 0.0), (1e3, 0.005), (1e3, 10.0), (1e4, 0.0)];
    let limits = cases.map(|(rate, damping)| {
        let limit = wall_limit(&PhantomSettings::default(), rate, damping).expect("a limit");
        let quiet = limit.quiet_n_per_m.expect("no wall of 1e5 N/m is quiet");
        // Bound of Colgate and Schenkel for the joint that moves the tip up and down at home.
        let passive = (2.0 * rate * (5e-4 / (UPPER_LINK * UPPER_LINK) - damping)).max(0.0);
        println!(
            "RESIDUAL | Colgate, Schenkel | {rate} Hz, B = {damping}: passive up to {passive:.0} N/m | - | {quiet:.0}"
        );
        assert!(limit.agrees && quiet >= passive && quiet > 0.0, "{limit:?}");
        assert!((limit.passive_n_per_m - passive).abs() <= 1e-9 * passive, "{limit:?}, not {passive}");
        let [below, beyond] = [0.5, 1.5].map(|share| range_m(rate, share * quiet, damping));
        println!(
            "RESIDUAL | - | range of the tip at half the limit and half beyond, m | {QUIET_M:e} | {below:e}, {beyond:e}"
        );
        assert!(below <= QUIET_M && beyond > QUIET_M, "{below:e}, {beyond:e} m");
        quiet
    });
    let [undamped, _, damped, fast] = limits;
    assert!(damped > undamped, "damping of the wall adds nothing: {damped}, {undamped} N/m");
    assert!(fast > undamped, "a tenth of the delay allows no more: {fast}, {undamped} N/m");
}

/// K d = k(5 mm − d) − g: wall, hand and arm in series, and the weight of the links, which lifts the tip at home.
#[test]
fn the_tip_rests_where_forces_balance() {
    let hand = HandSettings::default();
    let hand_stiffness = 1.0 / (1.0 / hand.stylus_stiffness.y + 1.0 / hand.arm_stiffness.y);
    let lift = 0.0163 / UPPER_LINK;
    let count = UPPER_LINK * TAU / (11.2 * 4096.0);
    // The wall's force depends on the measured depth, which is within half a count of the true one.
    let worst = Worst::new("balance of forces", "depth in a virtual wall, encoder counts", 0.5);
    for (rate, stiffness, damping) in [(1e3, 316.0, 0.0), (1e3, 1000.0, 1.0), (1e4, 1000.0, 0.0)] {
        let wall = VirtualWall { stiffness_n_per_m: stiffness, damping_n_s_per_m: damping };
        let depth = touch(&PhantomSettings::default(), rate, &wall).expect("a wall").depth_m;
        let expected = (hand_stiffness * 5e-3 - lift) / (hand_stiffness + stiffness);
        worst.check((depth - expected).abs() / count);
    }
}

#[test]
fn a_wall_or_a_rate_that_is_none_says_so() {
    let settings = PhantomSettings::default();
    for [rate, stiffness, damping] in [
        [1e3, f64::NAN, 0.0],
        [1e3, -1.0, 0.0],
        [1e3, 100.0, f64::INFINITY],
        [1e3, 100.0, -1.0],
        [f64::NAN, 100.0, 0.0],
        [-1e3, 100.0, 0.0],
        [0.0, 100.0, 0.0],
    ] {
        let wall = VirtualWall { stiffness_n_per_m: stiffness, damping_n_s_per_m: damping };
        let error = touch(&settings, rate, &wall).expect_err("no loop, or no wall");
        assert!(matches!(error, ZWidthError::Device(DeviceError::Setting { .. })), "{error}");
    }
    let slow = wall_limit(&settings, 10.0, 0.0).expect_err("ten substeps in 0.1 s are too few");
    assert!(slow.to_string().contains("substeps"), "{slow}");
    assert!(wall_limit(&settings, 1e3, f64::NAN).is_err());
}

/// The clean stiffness rises with the rate, as Choi and Tan (2004) found: from 0.33 N/mm at 250 Hz to 0.90 N/mm at 40 kHz,
/// with most of the gain up to 10 kHz.
#[test]
fn a_faster_loop_renders_stiffer_walls_cleanly() {
    for structure in [None, Some(StructureSettings::default())] {
        let settings = PhantomSettings { structure, ..PhantomSettings::default() };
        let [slow, fast] = [250.0, 1e4]
            .map(|rate| stiffest_clean_n_per_m(&settings, rate).expect("it can be simulated").expect("1e5 N/m buzz"));
        let what = if structure.is_some() { "with the structural mode" } else { "rigid" };
        println!(
            "RESIDUAL | Choi, Tan | {what}: clean up to, N/m, at 250 Hz, 10 kHz (330, 900) | - | {slow:.0}, {fast:.0}"
        );
        assert!(slow > 330.0 && fast < 3500.0, "{what}: {slow}, {fast} N/m");
        assert!((1.5..4.0).contains(&(fast / slow)), "{what}: {slow}, {fast} N/m");
    }
}
