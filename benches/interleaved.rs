//! Ratios from one run in which the cases take turns, so that a slow moment of the machine affects all
//! of them.

use std::time::Instant;

const ROUNDS: usize = 60;

/// Name and timed closure.
pub type Case = (&'static str, Box<dyn FnMut()>);

/// Times `calls` calls of each case in turn and prints medians and quartiles of the ratio to the
/// first.
pub fn print_ratios(cases: &mut [Case], calls: u32) {
    let mut times = vec![Vec::with_capacity(ROUNDS); cases.len()];
    for _ in 0..ROUNDS {
        for ((_, case), times) in cases.iter_mut().zip(&mut times) {
            let start = Instant::now();
            (0..calls).for_each(|_| case());
            times.push(start.elapsed().as_nanos() as f64 / f64::from(calls));
        }
    }
    println!("\n{:<50} {:>12} {:>10} {:>17}", "interleaved", "ns (median)", "ratio", "(quartiles)");
    for ((name, _), case) in cases.iter().zip(&times) {
        let mut ratios: Vec<f64> = case.iter().zip(&times[0]).map(|(a, b)| a / b).collect();
        let mut sorted = case.clone();
        ratios.sort_by(f64::total_cmp);
        sorted.sort_by(f64::total_cmp);
        let at = |values: &[f64], quarter: usize| values[values.len() * quarter / 4];
        println!(
            "{name:<50} {:>12.0} {:>10.2} {:>8.2} .. {:.2}",
            at(&sorted, 2),
            at(&ratios, 2),
            at(&ratios, 1),
            at(&ratios, 3)
        );
    }
}
