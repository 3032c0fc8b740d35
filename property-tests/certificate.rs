//! Statistics of a certificate compared with closed forms, exact sums, and samples of known distribution.

use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use statrs::distribution::{Binomial, ContinuousCDF, Discrete, DiscreteCDF, Normal};
use stickslip::verify::certificate::bounds::{
    CONFIDENCE, Independence, RateBound, Trials, Untested, rank_test, runs_test,
};
use stickslip::verify::certificate::causes::{MissCause, Missed, StealSample, steal_grew};
use stickslip::verify::certificate::tail::{Gev, HORIZONS_TICKS, Tail, Tests};

use crate::check::{Worst, runner};

struct Draws(ChaCha8Rng);

impl Draws {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn uniform(&mut self) -> f64 {
        ((self.0.next_u64() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
    }

    fn normal(&mut self) -> f64 {
        Normal::standard().inverse_cdf(self.uniform())
    }

    /// Builds the series xᵢ = memory xᵢ₋₁ + noise.
    fn autoregressive(&mut self, memory: f64, values: usize) -> Vec<f64> {
        let mut x = 0.0;
        let mut step = || {
            x = memory * x + self.normal();
            x
        };
        (0..values).map(|_| step()).collect()
    }

    fn extremes(&mut self, from: Gev, values: usize) -> Vec<f64> {
        (0..values).map(|_| from.quantile(-self.uniform().ln())).collect()
    }
}

fn bound(events: u64, trials: u64) -> RateBound {
    RateBound::of(events, trials, Trials::Ticks).expect("a bound")
}

/// Up to 1000 trials the sum over the binomial distribution is exact to rounding; each term follows from the one before
/// by a ratio.
fn at_most(events: u64, trials: u64, rate: f64) -> f64 {
    let mut term = (trials as f64 * (-rate).ln_1p()).exp();
    let mut sum = term;
    for k in 0..events {
        term *= (trials - k) as f64 / (k + 1) as f64 * rate / (1.0 - rate);
        sum += term;
    }
    sum
}

#[test]
fn without_events_the_bound_has_a_closed_form() {
    // ln Γ(n + 1) − ln Γ(n) and ln(1 − x) lose digits with n. Largest measured: 2.6e-7.
    let worst = Worst::new("1 - 0.05^(1/n)", "upper bound of no events, relative", 1e-6);
    for trials in [1, 2, 10, 1000, 100_000, 3_600_000, 10_000_000, 1_000_000_000] {
        let exact = -(0.05_f64.ln() / trials as f64).exp_m1();
        worst.check((bound(0, trials).upper / exact - 1.0).abs());
    }
}

#[test]
fn at_the_bound_so_few_events_are_as_rare_as_stated() {
    // Rounding of logarithms of factorials, 1e3 · 1e-16, and of the sum.
    let worst = Worst::new("binomial sum", "P(X <= x) at the upper bound", 1e-12);
    for (events, trials) in [(0, 1), (1, 2), (3, 10), (9, 10), (1, 1000), (5, 1000), (100, 1000), (400, 1000)] {
        let bound = bound(events, trials);
        worst.check((at_most(events, trials, bound.upper) - (1.0 - CONFIDENCE)).abs());
        assert!(bound.upper > bound.estimate && bound.upper <= 1.0, "{bound:?}");
    }
}

/// For so many events that the continued fraction converges slowly, the sum runs downwards from its largest term.
#[test]
fn many_events_have_their_bound_too() {
    // ln n! ≈ 2e10 for the most trials has an error of 4e-6.
    let worst = Worst::new("binomial sum", "P(X <= x) at the upper bound, many events", 1e-6);
    for (events, trials) in [
        (10_000, 1_000_000),
        (500_000, 1_000_000),
        (100_000, 10_000_000),
        (1_000_000, 100_000_000),
        (1000, 1_000_000_000),
    ] {
        let rate = bound(events, trials).upper;
        let mut term = Binomial::new(rate, trials).expect("a rate").pmf(events);
        let mut sum = 0.0;
        for k in (1..=events).rev() {
            sum += term;
            term *= k as f64 / (trials - k + 1) as f64 * (1.0 - rate) / rate;
        }
        worst.check((sum + term - (1.0 - CONFIDENCE)).abs());
    }
}

/// Whatever the true rate, the share of experiments with a bound below it is at most 5 %.
#[test]
fn the_bound_covers_every_rate() {
    let mut most = 0.0_f64;
    for trials in [20_u64, 200] {
        let bounds: Vec<f64> = (0..=trials).map(|events| bound(events, trials).upper).collect();
        for rate in (1..200).map(|i| f64::from(i) / 200.0) {
            let binomial = Binomial::new(rate, trials).expect("a rate");
            let below = bounds.partition_point(|upper| *upper < rate) as u64;
            let uncovered = if below == 0 { 0.0 } else { binomial.cdf(below - 1) };
            most = most.max(uncovered);
            assert!(uncovered <= 1.0 - CONFIDENCE + 1e-9, "rate {rate} of {trials}: {uncovered} not covered");
        }
    }
    println!("RESIDUAL | binomial sum | rate above its bound, share of experiments | 0.05 | {most:.4}");
    assert!(most > 0.04, "bounds are wider than they need be: {most}");
}

#[test]
fn bounds_say_what_they_assume_and_where_there_is_none() {
    assert_eq!(bound(2, 2).upper.to_bits(), 1.0_f64.to_bits());
    assert!(RateBound::of(0, 0, Trials::Ticks).is_none());
    assert!(RateBound::of(3, 2, Trials::Ticks).is_none());
    assert!(RateBound::of(0, u64::MAX, Trials::Ticks).is_none());
    assert!(RateBound::of(2_000_000, 10_000_000, Trials::Ticks).is_none());
    let blocks = RateBound::of(1, 10, Trials::Blocks).expect("a bound");
    assert_eq!(blocks.assumption, "independent blocks");
    assert_eq!(bound(1, 10).assumption, "independent ticks");
}

#[test]
fn white_noise_is_called_dependent_as_often_as_the_level_says() {
    let runs = 2000;
    let rejected = (0..runs)
        .filter(|&seed| !rank_test(&Draws::new(seed).autoregressive(0.0, 400), 10).expect("tested").independent)
        .count() as u64;
    // For a share of 1 % the count is in this range with probability 1 - 2e-4. The upper end is that of 1.5 %, as χ² is
    // the limit for long series only.
    let low = Binomial::new(0.01, runs).expect("a share").inverse_cdf(1e-4);
    let high = Binomial::new(0.015, runs).expect("a share").inverse_cdf(1.0 - 1e-4);
    println!("RESIDUAL | level 0.01 | white noise called dependent, of {runs} | {low}..{high} | {rejected}");
    assert!((low..=high).contains(&rejected), "{rejected} of {runs}");
}

#[test]
fn memory_is_found() {
    for seed in 0..100 {
        let test = rank_test(&Draws::new(seed).autoregressive(0.4, 400), 10).expect("tested");
        assert!(!test.independent && test.p_value < 0.01, "seed {seed}: {test:?}");
    }
}

/// An outlier of ten times the spread in one value of a hundred changes neither the level nor the power of a rank test.
#[test]
fn outliers_neither_hide_memory_nor_look_like_it() {
    let with_outliers = |seed: u64, memory: f64| {
        let mut draws = Draws::new(seed);
        let mut series = draws.autoregressive(memory, 400);
        series.iter_mut().for_each(|x| *x *= if draws.uniform() < 0.01 { 1e6 } else { 1.0 });
        rank_test(&series, 10).expect("tested").independent
    };
    assert!((0..100).all(|seed| !with_outliers(seed, 0.4)));
    assert!((0..100).filter(|&seed| !with_outliers(seed, 0.0)).count() <= 6, "1 is expected; 6 with p = 5e-4");
}

/// Over random orders of the ranks the statistic has the mean of χ², as the moments at each lag are exact.
#[test]
fn ranks_have_the_moments_that_the_test_assumes() {
    let n = 60;
    let mut draws = Draws::new(9);
    let trials = 4000;
    let mut sum = 0.0;
    for _ in 0..trials {
        let mut order: Vec<f64> = (0..n).map(f64::from).collect();
        for i in (1..order.len()).rev() {
            order.swap(i, (draws.uniform() * (i + 1) as f64) as usize);
        }
        sum += rank_test(&order, 2).expect("tested").statistic;
    }
    // χ² of two degrees has variance 4: the mean of 4000 has a standard error of 0.032.
    let mean = sum / f64::from(trials);
    println!("RESIDUAL | χ² of 2 degrees | mean statistic of ranks | 2 ± 0.13 | {mean:.3}");
    assert!((mean - 2.0).abs() <= 0.13, "{mean}");
}

/// Counts the orders of n events among trials by their number of runs.
fn orders_by_runs(events: u32, trials: u32) -> Vec<u64> {
    let mut counts = vec![0; trials as usize + 1];
    for order in (0..1_u32 << trials).filter(|order| order.count_ones() == events) {
        let changes = (order ^ (order >> 1)) & ((1 << (trials - 1)) - 1);
        counts[changes.count_ones() as usize + 1] += 1;
    }
    counts
}

#[test]
fn runs_have_the_distribution_of_all_orders() {
    // Logarithms of factorials lose about 1e-15 of their size, 30.
    let worst = Worst::new("all orders", "P(R <= r)", 1e-12);
    for (events, trials) in [(2, 4), (3, 9), (5, 10), (8, 16), (2, 16), (14, 16)] {
        let counts = orders_by_runs(events, trials);
        let all: u64 = counts.iter().sum();
        let (n, m) = (u64::from(events), u64::from(trials - events));
        let most = (0..counts.len()).rev().find(|&runs| counts[runs] > 0).expect("an order");
        for runs in 2..=most {
            let exact = counts[..=runs].iter().sum::<u64>() as f64 / all as f64;
            let test = runs_test(n, m, runs as u64).expect("tested");
            worst.check((test.p_value - exact).abs());
            assert_eq!((test.statistic, test.independent), (runs as f64, exact > 0.01));
        }
        assert_eq!(runs_test(n, m, most as u64 + 1), Err(Untested::Runs { runs: most as u64 + 1 }));
    }
    // Beyond the exact sum, the normal distribution continues from where the sum ends.
    for runs in [950, 980, 1000, 1020] {
        let [sum, normal] = [1000, 1001].map(|n| runs_test(n, n, runs + n - 1000).expect("tested").p_value);
        assert!((sum - normal).abs() < 0.01, "{runs} runs: {sum} and {normal}");
    }
    assert_eq!(runs_test(1, 9, 2), Err(Untested::TooFewEvents { events: 1, trials: 10 }));
    assert_eq!(runs_test(9, 1, 2), Err(Untested::TooFewEvents { events: 9, trials: 10 }));
}

#[test]
fn misses_in_clusters_are_found_and_others_are_not() {
    let outcome = |misses: &[bool]| {
        let events = misses.iter().filter(|&&miss| miss).count() as u64;
        let runs = misses.chunk_by(|a, b| a == b).count() as u64;
        runs_test(events, misses.len() as u64 - events, runs).expect("tested")
    };
    let mut rejected = 0;
    for seed in 0..1000 {
        let mut draws = Draws::new(seed);
        let spread: Vec<bool> = (0..400).map(|_| draws.uniform() < 0.1).collect();
        rejected += u64::from(!outcome(&spread).independent);
        // A miss is followed by another with probability 1/2.
        let mut miss = false;
        let mut next = || {
            miss = draws.uniform() < if miss { 0.5 } else { 0.05 };
            miss
        };
        let clustered: Vec<bool> = (0..2000).map(|_| next()).collect();
        let found: Independence = outcome(&clustered);
        assert!(!found.independent && found.p_value < 1e-3, "seed {seed}: {found:?}");
    }
    let most = Binomial::new(0.01, 1000).expect("a share").inverse_cdf(1.0 - 1e-4);
    println!("RESIDUAL | level 0.01 | spread misses called clustered, of 1000 | <= {most} | {rejected}");
    assert!(rejected <= most, "{rejected}");
}

#[test]
fn what_cannot_be_tested_says_why() {
    let noise = Draws::new(1).autoregressive(0.0, 60);
    assert_eq!(rank_test(&noise[..49], 10), Err(Untested::TooFew { values: 49 }));
    assert_eq!(rank_test(&noise, 0), Err(Untested::Lags { lags: 0, values: 60 }));
    assert_eq!(rank_test(&noise, 31), Err(Untested::Lags { lags: 31, values: 60 }));
    assert_eq!(rank_test(&[0.1; 60], 10), Err(Untested::Constant));
    let mut broken = noise.clone();
    broken[7] = f64::NAN;
    assert_eq!(rank_test(&broken, 10), Err(Untested::NotANumber));
    broken[7] = f64::INFINITY;
    assert!(rank_test(&broken, 10).is_ok(), "it has a rank");
}

const TIMES: Gev = Gev { location: 200_000.0, scale: 10_000.0, shape: 0.0 };

/// The mean of the estimates over 200 samples of 1000 keeps the estimator's bias, and its spread / √200.
#[test]
fn a_fit_finds_what_samples_were_drawn_from() {
    // The shape of one fit has the standard error √(0.56 / 1000) = 0.024 at 0 (Hosking et al., 1985); location and
    // scale have about 0.035 and more. That of the mean is 0.0025; the tolerance is four times that.
    let tolerance = 0.01;
    let location = Worst::new("known GEV", "mean fitted location, in scales", tolerance);
    let scale = Worst::new("known GEV", "mean fitted scale, relative", tolerance);
    let shape = Worst::new("known GEV", "mean fitted shape", tolerance);
    for xi in [-0.5, -0.3, -0.1, 0.0, 0.1, 0.2] {
        let from = Gev { shape: xi, ..TIMES };
        let mut draws = Draws::new(3);
        let fits: Vec<Gev> = (0..200).map(|_| Gev::fit(&draws.extremes(from, 1000)).expect("a fit")).collect();
        let mean = |of: fn(&Gev) -> f64| fits.iter().map(of).sum::<f64>() / fits.len() as f64;
        location.check((mean(|fit| fit.location) - from.location).abs() / from.scale);
        scale.check((mean(|fit| fit.scale) / from.scale - 1.0).abs());
        shape.check((mean(|fit| fit.shape) - xi).abs());
    }
}

#[test]
fn quantiles_undo_the_distribution_and_rise() {
    let inverse = Worst::new("F(x(F))", "GEV, absolute", 2e-15);
    for shape in [-0.5, -0.1, -1e-9, 0.0, 1e-9, 0.1, 0.5] {
        let gev = Gev { location: 5.0, scale: 2.0, shape };
        let mut below = f64::NEG_INFINITY;
        for i in 1..1000 {
            let share = f64::from(i) / 1000.0;
            let x = gev.quantile(-share.ln());
            assert!(x > below, "shape {shape}: {x} after {below}");
            inverse.check((gev.cdf(x) - share).abs());
            below = x;
        }
        let (before, after) = (gev.cdf(-1e9), gev.cdf(1e30));
        assert!(before <= 1e-9 && after >= 1.0 - 1e-9, "shape {shape}: {before}, {after}");
    }
}

fn rounded(maxima: &[f64]) -> Vec<u64> {
    maxima.iter().map(|ns| ns.max(0.0) as u64).collect()
}

/// Samples of a known distribution are extrapolated, to levels near the true ones; three tests at 5 % refuse
/// up to 15 % of them.
#[test]
fn extremes_are_extrapolated() {
    let runs = 60;
    let mut kept = 0;
    let mut covered = 0;
    // A shape off by its standard error, √(0.56 / 500) = 0.034 (Hosking et al., 1985), moves the level 13.8 scales
    // above the location by 0.034 · 13.8² / 2 = 3.2 scales, a tenth of it; upwards it moves more. The tolerance is four
    // such errors.
    let error = Worst::new("known GEV", "level of one in 1e7 and 1e9 ticks, relative", 0.4);
    // The second order is half of 1 / ticks.
    let formula = Worst::new("-ln F = 1000 / ticks", "level of the fitted distribution, relative", 1e-7);
    for seed in 0..runs {
        let maxima = rounded(&Draws::new(seed).extremes(TIMES, 500));
        let tail = Tail::of_block_maxima(&maxima, 1000);
        let Tail::Extrapolated { location_ns, scale_ns, shape, levels, tests } = tail else { continue };
        let fitted = Gev { location: location_ns, scale: scale_ns, shape };
        kept += 1;
        let passed = [tests.independence, tests.stationarity, tests.fit].map(|test| test.is_some_and(|t| t.passed));
        assert_eq!(passed, [true; 3]);
        assert_eq!(levels.iter().map(|level| level.ticks).collect::<Vec<_>>(), HORIZONS_TICKS);
        for level in &levels {
            // One exceedance in `ticks` ticks: for the maximum of 1000 ticks, 1000 / ticks to first order.
            let exponent = 1000.0 / level.ticks as f64;
            let exact = TIMES.quantile(exponent);
            formula.check((level.response_ns / fitted.quantile(exponent) - 1.0).abs());
            error.check((level.response_ns / exact - 1.0).abs());
            assert!(level.response_ns_p95 >= level.response_ns);
        }
        assert!(levels[0].response_ns < levels[1].response_ns);
        covered += usize::from(levels[0].response_ns_p95 >= TIMES.quantile(1e-4));
    }
    let fewest = Binomial::new(0.85, runs).expect("a share").inverse_cdf(1e-3);
    println!(
        "RESIDUAL | known GEV | extrapolated, of {runs} | >= {fewest} | {kept}, {covered} with p95 above the true"
    );
    assert!(kept >= fewest && kept <= runs, "{kept} of {runs}");
}

fn refused(maxima: &[u64], block_ticks: u64) -> (String, Tests) {
    match Tail::of_block_maxima(maxima, block_ticks) {
        Tail::Refused { reasons, tests } => (reasons.join("; "), tests),
        tail => panic!("not refused: {tail:?}"),
    }
}

#[test]
fn what_is_not_extreme_and_independent_is_refused() {
    let maxima = rounded(&Draws::new(5).extremes(TIMES, 500));
    let (few, tests) = refused(&maxima[..99], 1000);
    assert!(few.contains("99 blocks are too few") && tests.fit.is_none(), "{few}");
    let (short, _) = refused(&maxima, 49);
    assert!(short.contains("blocks of 49 ticks are too short"), "{short}");

    for seed in 0..10 {
        let mut draws = Draws::new(seed);
        let memory: Vec<f64> = draws.autoregressive(0.5, 500).iter().map(|x| 2e5 + 1e4 * x).collect();
        let (reasons, tests) = refused(&rounded(&memory), 1000);
        assert!(reasons.contains("depend on earlier ones"), "seed {seed}: {reasons}");
        assert!(tests.independence.is_some_and(|test| !test.passed));

        let drift: Vec<f64> = (0..).zip(draws.extremes(TIMES, 500)).map(|(i, x)| x + 40.0 * f64::from(i)).collect();
        let (reasons, _) = refused(&rounded(&drift), 1000);
        assert!(reasons.contains("differs from the first"), "seed {seed}: {reasons}");

        // One block in three is interrupted for 0.3 ms.
        let mut two = || 2e5 + 1e4 * draws.normal() + if draws.uniform() < 0.33 { 3e5 } else { 0.0 };
        let two: Vec<f64> = (0..500).map(|_| two()).collect();
        let (reasons, _) = refused(&rounded(&two), 1000);
        assert!(reasons.contains("does not fit"), "seed {seed}: {reasons}");

        let heavy = draws.extremes(Gev { shape: 0.9, ..TIMES }, 2000);
        let (reasons, _) = refused(&rounded(&heavy), 1000);
        assert!(reasons.contains("shape"), "seed {seed}: {reasons}");
    }
}

#[test]
fn degenerate_maxima_are_refused() {
    for ns in [0, 1, 200_000, u64::MAX] {
        let (reasons, _) = refused(&[ns; 200], 1000);
        assert!(reasons.contains("all values of the series are the same"), "{reasons}");
    }
    let halves: Vec<u64> = (0..200).map(|i| 1000 + i % 100).collect();
    let (_, tests) = refused(&halves, 1000);
    assert!(tests.stationarity.is_some_and(|test| test.passed && test.statistic == 0.0), "{tests:?}");
    refused(&[], 0);
    let json = serde_json::to_string(&Tail::of_block_maxima(&[], 0)).expect("serializable");
    assert!(json.starts_with(r#"{"outcome":"refused","reasons":["0 blocks"#), "{json}");
}

/// Usual tick: deadline 1000 ns, 400 ns of wall time and 390 ns of CPU time.
const USUAL: Missed = Missed {
    deadline_ns: 1000,
    release_ns: 50,
    response_ns: 450,
    compute_ns: 400,
    cpu_ns: 390,
    page_faults: 0,
    involuntary_switches: 0,
    follows: false,
    steal: false,
    typical_compute_ns: 400,
    typical_cpu_ns: 390,
};

#[test]
fn every_rule_has_its_label() {
    let busy = Missed { response_ns: 1150, compute_ns: 1100, cpu_ns: 1090, ..USUAL };
    let partly_busy = Missed { release_ns: 150, response_ns: 1130, compute_ns: 980, cpu_ns: 970, ..USUAL };
    let released_late = Missed { release_ns: 800, response_ns: 1200, ..USUAL };
    let off = Missed { response_ns: 1150, compute_ns: 1100, involuntary_switches: 1, ..USUAL };
    let faulted = Missed { page_faults: 2, ..off };
    // The excess is 700, of which no clock has seen more than the 300 off the CPU.
    let unexplained = Missed { response_ns: 1700, compute_ns: 700, ..USUAL };
    let stolen = |miss: Missed| Missed { steal: true, ..miss };
    for (miss, cause) in [
        (USUAL, MissCause::Unknown),
        (Missed { response_ns: 1000, ..released_late }, MissCause::Unknown),
        (busy, MissCause::Compute),
        (stolen(busy), MissCause::StealSuspected),
        (Missed { release_ns: 2000, response_ns: 3100, ..busy }, MissCause::Compute),
        (partly_busy, MissCause::Compute),
        (stolen(partly_busy), MissCause::StealSuspected),
        (released_late, MissCause::Release),
        (stolen(released_late), MissCause::StealSuspected),
        (off, MissCause::Preempted),
        (stolen(off), MissCause::StealSuspected),
        (Missed { involuntary_switches: 0, ..off }, MissCause::Unknown),
        (stolen(Missed { involuntary_switches: 0, ..off }), MissCause::StealSuspected),
        (faulted, MissCause::Fault),
        (stolen(faulted), MissCause::Fault),
        (unexplained, MissCause::Unknown),
        (stolen(unexplained), MissCause::Unknown),
        // Half of the excess is enough: 300 of 600, less the usual time off the CPU.
        (Missed { compute_ns: 700, involuntary_switches: 1, response_ns: 1600, ..USUAL }, MissCause::Preempted),
        (Missed { compute_ns: 699, involuntary_switches: 1, response_ns: 1600, ..USUAL }, MissCause::Unknown),
    ] {
        assert_eq!(MissCause::of(&miss), cause, "{miss:?}");
    }
}

#[test]
fn a_miss_that_follows_another_has_its_cause() {
    let first = Missed { response_ns: 1150, compute_ns: 1100, cpu_ns: 1090, ..USUAL };
    let late = Missed { release_ns: 800, response_ns: 1200, ..USUAL };
    let after = Missed { follows: true, ..late };
    assert_eq!(
        MissCause::of_all(&[after, first, after, after, late]),
        [MissCause::Release, MissCause::Compute, MissCause::Compute, MissCause::Compute, MissCause::Release]
    );
    assert_eq!(serde_json::to_string(&MissCause::StealSuspected).expect("a name"), r#""steal-suspected""#);
}

fn any_time() -> impl Strategy<Value = u64> {
    prop_oneof![any::<u64>(), 0..2000_u64, Just(0), Just(u64::MAX)]
}

#[test]
fn every_miss_has_one_label_whatever_its_numbers() {
    let times = proptest::array::uniform7(any_time());
    let miss = (times, any::<[u64; 2]>(), any::<[bool; 2]>()).prop_map(|(times, counts, [follows, steal])| Missed {
        deadline_ns: times[0],
        release_ns: times[1],
        response_ns: times[2],
        compute_ns: times[3],
        cpu_ns: times[4],
        typical_compute_ns: times[5],
        typical_cpu_ns: times[6],
        page_faults: counts[0] % 2,
        involuntary_switches: counts[1] % 2,
        follows,
        steal,
    });
    let result = runner(2000).run(&proptest::collection::vec(miss, 0..20), |misses| {
        let causes = MissCause::of_all(&misses);
        prop_assert_eq!(causes.len(), misses.len());
        for (i, (miss, cause)) in misses.iter().zip(&causes).enumerate() {
            let expected = if miss.follows && i > 0 { causes[i - 1] } else { MissCause::of(miss) };
            prop_assert_eq!(*cause, expected);
            let lone = MissCause::of(miss);
            prop_assert!(miss.steal || lone != MissCause::StealSuspected);
            prop_assert!(
                !miss.steal || matches!(lone, MissCause::StealSuspected | MissCause::Fault | MissCause::Unknown)
            );
        }
        Ok(())
    });
    result.expect("one label each");
}

#[test]
fn steal_is_seen_between_the_samples_around() {
    let sample = |at_ns, stolen_ticks| StealSample { at_ns, stolen_ticks };
    let samples = [sample(100, 7), sample(200, 7), sample(300, 8), sample(400, 8)];
    for (from, to, grew) in [
        (110, 190, false),
        (210, 290, true),
        (190, 210, true),
        (200, 200, false),
        (200, 201, true),
        (310, 390, false),
        (0, 50, false),
        (0, u64::MAX, true),
        (500, 600, false),
        (290, 210, true),
    ] {
        assert_eq!(steal_grew(&samples, from, to), grew, "{from}..{to}");
    }
    assert!(!steal_grew(&[], 0, 1) && !steal_grew(&samples[..1], 0, 1000));
}
