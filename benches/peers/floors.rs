//! Lower bounds for any loop over springs, timed alone on this machine: a root and a division per spring, and reading
//! its three numbers from memory.

use std::hint::black_box;
use std::time::Instant;

/// Size of k, c and L, bytes.
const SPRING_BYTES: usize = 24;
/// Number of calls, of which the fastest counts.
const REPEATS: usize = 200;
/// Number of roots at once: inputs and outputs lie in the first-level cache.
const LENGTHS: usize = 1024;

/// Times `1 / sqrt`, ns per spring, with the instructions that every CPU has and with AVX2 where available.
pub fn root_and_division_ns() -> (f64, Option<f64>) {
    (fastest_ns(reciprocal_roots) / LENGTHS as f64, wide().map(|roots| fastest_ns(roots) / LENGTHS as f64))
}

type Roots = fn(&[f64], &mut [f64]);

fn fastest_ns(roots: Roots) -> f64 {
    let squares: Vec<f64> = (0..LENGTHS).map(|i| 1e-4 * (1.0 + i as f64)).collect();
    let mut inverse = vec![0.0; LENGTHS];
    let calls = (0..REPEATS).map(|_| {
        let start = Instant::now();
        for _ in 0..10 {
            roots(black_box(&squares), black_box(&mut inverse));
        }
        start.elapsed().as_nanos() as f64 / 10.0
    });
    calls.fold(f64::INFINITY, f64::min)
}

#[inline(always)]
fn reciprocal_roots(squares: &[f64], inverse: &mut [f64]) {
    for (inverse, square) in inverse.iter_mut().zip(squares) {
        *inverse = 1.0 / square.sqrt();
    }
}

#[cfg(target_arch = "x86_64")]
fn wide() -> Option<Roots> {
    #[target_feature(enable = "avx2")]
    fn reciprocal_roots_avx2(squares: &[f64], inverse: &mut [f64]) {
        reciprocal_roots(squares, inverse);
    }
    // SAFETY: called only where the CPU is known to have AVX2.
    std::arch::is_x86_feature_detected!("avx2")
        .then_some(|squares, inverse| unsafe { reciprocal_roots_avx2(squares, inverse) })
}

#[cfg(not(target_arch = "x86_64"))]
fn wide() -> Option<Roots> {
    None
}

/// Times reading k, c and L of a spring, ns, of `springs` in a row.
pub fn reading_ns(springs: usize) -> f64 {
    let numbers = vec![1.0_f64; springs * SPRING_BYTES / size_of::<f64>()];
    let reads = (0..REPEATS).map(|_| {
        let start = Instant::now();
        let mut sums = [0.0; 16];
        for chunk in black_box(&numbers).chunks_exact(sums.len()) {
            sums.iter_mut().zip(chunk).for_each(|(sum, number)| *sum += number);
        }
        black_box(sums);
        start.elapsed().as_nanos() as f64
    });
    reads.fold(f64::INFINITY, f64::min) / springs as f64
}
