//! The files that a run leaves, read back: the trace as columns, the summary as JSON.
//!
//! Run it with `cargo run --example read_results`.

use std::error::Error;

use stickslip::{Scene, run_into};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
    run_into(&scene, folder.path(), |_| ())?;

    let mut reader = csv::Reader::from_path(folder.path().join("trace.csv"))?;
    let headers = reader.headers()?.clone();
    let column = |name: &str| headers.iter().position(|header| header == name).ok_or(format!("no column {name}"));
    let (time, normal_force) = (column("t")?, column("fn")?);
    let mut peak = (0.0, 0.0);
    for row in reader.records() {
        let row = row?;
        let (t, force): (f64, f64) = (row[time].parse()?, row[normal_force].parse()?);
        if force > peak.1 {
            peak = (t, force);
        }
    }
    println!("largest normal force {:.3} N at {:.3} s", peak.1, peak.0);

    let summary: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.path().join("summary.json"))?)?;
    assert_eq!(summary["scene"], "fig3-sliding");
    assert_eq!(summary["largest_normal_force_n"], peak.1);
    Ok(())
}
