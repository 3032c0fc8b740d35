//! `stickslip judge`: what is found in another program's force trace.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::LazyLock;

use stickslip::output::verdict::Verdict;
use stickslip::scene::Scene;
use stickslip::verify::accuracy::Reference;
use stickslip::verify::judge::{ForceTrace, Judgement, ReferenceError, TraceError, TraceFormat, reference};

use crate::check::{PRESS_AND_DRAG, shipped, small_scene};

/// A small scene with its reference, for all tests.
static JUDGED: LazyLock<(Scene, Reference)> = LazyLock::new(|| {
    let scene = small_scene("law = \"stick-slip\"\nfriction = 0.5", "rings = 1", PRESS_AND_DRAG);
    let reference = reference(&scene, |_| ()).expect("it starts outside");
    (scene, reference)
});

/// Rows (t, fx, fy, fz) of the reference itself.
fn rows() -> Vec<[f64; 4]> {
    let samples = JUDGED.1.coarse.samples();
    samples.iter().map(|sample| [sample.time, sample.force.x, sample.force.y, sample.force.z]).collect()
}

fn write(rows: &[[f64; 4]]) -> String {
    let mut text = "t,fx,fy,fz\n".to_owned();
    for [t, x, y, z] in rows {
        writeln!(text, "{t},{x},{y},{z}").expect("text");
    }
    text
}

fn read(text: &str, format: &TraceFormat) -> Result<ForceTrace, TraceError> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("trace.csv");
    std::fs::write(&file, text).expect("a file");
    ForceTrace::read(&file, format)
}

fn judged(text: &str) -> Judgement {
    let trace = read(text, &TraceFormat::default()).expect("a trace");
    Judgement::of(&trace, &JUDGED.0, &JUDGED.1).expect("it covers the scene")
}

fn codes(judgement: &Judgement) -> Vec<&'static str> {
    judgement.findings.iter().map(|finding| finding.code()).collect()
}

#[test]
fn the_reference_has_no_error_in_itself() {
    let judgement = judged(&write(&rows()));
    assert_eq!((judgement.verdict, judgement.force_error_rms_rel), (Verdict::Pass, 0.0));
    assert!(judgement.below_floor && judgement.floor_rms_rel > 0.0 && judgement.findings.is_empty(), "{judgement:?}");
    assert!(judgement.sentence.starts_with("force error 0.00 % RMS, below the floor of"), "{}", judgement.sentence);
    assert_eq!((judgement.compared_ticks, judgement.lag_ticks), (judgement.scene_ticks, 0));
    assert!((judgement.best_scale - 1.0).abs() < 1e-12);
    // Without columns for them, neither modes nor contact points were compared.
    assert_eq!((judgement.mode_agreement, judgement.contact_point_error_rms_m), (None, None));
}

#[test]
fn a_shift_by_ticks_is_found_to_the_tick() {
    let tick_s = JUDGED.0.tick_s();
    for ticks in [1_i32, -1, 7] {
        let late: Vec<_> = rows().into_iter().map(|[t, x, y, z]| [t + f64::from(ticks) * tick_s, x, y, z]).collect();
        let judgement = judged(&write(&late));
        assert_eq!(judgement.lag_ticks, i64::from(ticks));
        assert!(judgement.force_error_rms_rel > judgement.floor_rms_rel, "{judgement:?}");
        assert!(codes(&judgement).contains(&"lag"), "{judgement:?}");
        // What rounding of the times interpolates between rows.
        assert!(judgement.force_error_rms_rel_without_lag < 1e-9, "{judgement:?}");
        // A single tick at an end may be missing.
        let whole = ticks.abs() == 1;
        assert_eq!(judgement.verdict == Verdict::Inconclusive, !whole, "{judgement:?}");
    }
}

#[test]
fn a_wrong_unit_or_sign_is_named() {
    for (factor, expected) in [(1e3, 1e-3), (1e-3, 1e3), (-1.0, -1.0), (-1e3, -1e-3)] {
        let scaled: Vec<_> = rows().into_iter().map(|[t, x, y, z]| [t, factor * x, factor * y, factor * z]).collect();
        let judgement = judged(&write(&scaled));
        assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Fail, vec!["unit"]), "{judgement:?}");
        assert!((judgement.best_scale / expected - 1.0).abs() < 1e-9);
        let format = TraceFormat { scale: expected, ..TraceFormat::default() };
        let corrected = read(&write(&scaled), &format).expect("a trace");
        let corrected = Judgement::of(&corrected, &JUDGED.0, &JUDGED.1).expect("it covers the scene");
        assert_eq!((corrected.verdict, codes(&corrected)), (Verdict::Pass, vec![]), "{corrected:?}");
    }
    // A force that is a fifth too large is an error, and no unit.
    let larger: Vec<_> = rows().into_iter().map(|[t, x, y, z]| [t, 1.2 * x, 1.2 * y, 1.2 * z]).collect();
    let judgement = judged(&write(&larger));
    assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Fail, vec![]));
    assert!((judgement.force_error_rms_rel - 0.2).abs() < 1e-12);
}

#[test]
fn another_rate_a_gap_and_a_part_are_said() {
    let all = rows();
    let every_other: Vec<_> = all.iter().skip(1).step_by(2).copied().collect();
    assert_eq!(codes(&judged(&write(&every_other))), ["shorter", "other-rate"]);

    let mut gap = all.clone();
    gap.remove(200);
    let judgement = judged(&write(&gap));
    assert_eq!((codes(&judgement), judgement.verdict), (vec!["between-ticks", "gaps"], Verdict::Pass), "{judgement:?}");
    let mut long_gap = all.clone();
    long_gap.drain(200..250);
    assert_eq!(judged(&write(&long_gap)).verdict, Verdict::Inconclusive);

    let judgement = judged(&write(&all[..all.len() - 50]));
    assert_eq!((codes(&judgement), judgement.verdict), (vec!["shorter"], Verdict::Inconclusive));
    assert_eq!((judgement.scene_ticks - judgement.compared_ticks, judgement.force_error_rms_rel), (50, 0.0));

    let mut longer = all.clone();
    longer.push([1.0, 0.0, 0.0, 0.0]);
    assert!(codes(&judged(&write(&longer))).contains(&"longer"));

    // Half of the press is without contact: there is no force to compare with.
    let judgement = judged(&write(&all[..10]));
    assert_eq!((judgement.compared_contact_ticks, judgement.verdict), (0, Verdict::Inconclusive), "{judgement:?}");
    assert!(matches!(
        Judgement::of(
            &read("t,fx,fy,fz\n5,0,0,1\n5.1,0,0,1\n", &TraceFormat::default()).expect("a trace"),
            &JUDGED.0,
            &JUDGED.1
        ),
        Err(TraceError::Elsewhere { .. })
    ));
}

#[test]
fn modes_and_contact_points_are_compared_where_they_are_given() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("trace.csv");
    stickslip::output::files::write_csv(&file, JUDGED.1.coarse.rows()).expect("a file");
    let trace = ForceTrace::read(&file, &TraceFormat::default()).expect("a trace");
    let judgement = Judgement::of(&trace, &JUDGED.0, &JUDGED.1).expect("it covers the scene");
    assert_eq!((judgement.mode_agreement, judgement.contact_point_error_max_m), (Some(1.0), Some(0.0)));
    assert_eq!(judgement.slip_onset_error_s, Some(0.0));
}

#[test]
fn bad_traces_are_refused_with_their_line() {
    let message = |text: &str| read(text, &TraceFormat::default()).expect_err(text).to_string();
    for (text, expected) in [
        ("t,fx,fy\n0,1,2\n", "there is no column `fz` in its header `t,fx,fy`"),
        ("t,fx,fy,fz\n0,0,0,1\n0.1,0,x,1\n", "line 3: `x` is not a finite number"),
        ("t,fx,fy,fz\n0,0,0,1\n0.1,0,NaN,1\n", "line 3: `fy` is NaN, not a finite number"),
        ("fz,t,fx,fy\n0,0,0,1\ninf,0.1,0,1\n", "line 3: `fz` is inf, not a finite number"),
        (
            "t,fx,fy,fz\n0,0,0,1\n0.2,0,0,1\n0.1,0,0,1\n",
            "line 4: the time 0.1 s is not later than 0.2 s of the row before",
        ),
        ("t,fx,fy,fz,mode\n0,0,0,1,stuck\n", "line 2: `stuck` is no contact mode"),
        ("t,fx,fy,fz\n0,0,0,1\n", "the trace has 1 rows; at least two are needed"),
    ] {
        assert_eq!(message(text), expected);
    }
    let absent = ForceTrace::read(Path::new("no-such-trace.csv"), &TraceFormat::default()).expect_err("no file");
    assert!(absent.to_string().contains("no-such-trace.csv"), "{absent}");
}

#[test]
fn a_scene_in_a_hand_has_no_reference() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/closed-loop/tap.toml");
    let by_hand = Scene::load(&path).expect("a scene");
    assert!(matches!(reference(&by_hand, |_| ()), Err(ReferenceError::ByHand { .. })));
    assert!(reference(&shipped("fig3-sliding").with_ticks(2), |_| ()).is_ok());
}
