//! Comparison of results with a baseline, quantity by quantity.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

use super::baseline::{Baseline, Provenance};
use super::results::{FORCES, KeptTick, Number, QUANTITIES, Results};

/// Largest difference, relative to a quantity's size, that counts as round-off. Another order of summation
/// changes traces by up to 2e-13, fused multiply-adds and wider vectors by as little; a wrong term
/// changes them by far more. The independent implementation in `reference/python` is compared with the
/// same tolerance.
pub const SCALED_TOLERANCE: f64 = 1e-9;

/// Outcome of the comparison of one quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum ComparisonOutcome {
    /// Equal to the last bit.
    #[serde(rename = "identical")]
    Identical,
    /// Not equal to the last bit, but within the tolerance.
    #[serde(rename = "within tolerance")]
    Within,
    /// Less work than before.
    #[serde(rename = "improved")]
    Improved,
    /// Beyond the tolerance, not a number, missing, or more work.
    #[serde(rename = "FAIL")]
    Fail,
}

/// Comparison of one quantity of one scene with its baseline.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Name of the quantity.
    pub quantity: String,
    /// Accepted value. For a trace, it is the value at the first tick beyond the tolerance, or else at the largest
    /// difference.
    pub baseline: Value,
    /// Present value, at the same place.
    pub now: Value,
    /// Present value minus accepted value; null if one of them is not a finite number.
    pub difference: Number,
    /// The largest difference that passes.
    pub tolerance: Number,
    /// First kept tick at which the quantity is beyond its tolerance; for a quantity without ticks, the first
    /// kept tick at which any quantity is.
    pub first_tick: Option<u64>,
    /// Outcome of the comparison.
    pub outcome: ComparisonOutcome,
}

impl Comparison {
    fn exact(quantity: impl Into<String>, baseline: Value, now: Value) -> Self {
        let same = baseline == now && !now.is_null();
        let outcome = if same { ComparisonOutcome::Identical } else { ComparisonOutcome::Fail };
        let difference = match (baseline.as_f64(), now.as_f64()) {
            _ if same => 0.0,
            (Some(before), Some(now)) => now - before,
            _ => f64::NAN,
        };
        let (difference, tolerance) = (Number(difference), Number(0.0));
        Self { quantity: quantity.into(), baseline, now, difference, tolerance, first_tick: None, outcome }
    }

    /// Lets a count differ by this share of its baseline.
    fn allowing(mut self, relative: Option<f64>) -> Self {
        if let (Some(relative), Some(before)) = (relative, self.baseline.as_f64()) {
            self.tolerance = Number(relative * before);
            if self.outcome == ComparisonOutcome::Fail && self.difference.0.abs() <= self.tolerance.0 {
                self.outcome = ComparisonOutcome::Within;
            }
        }
        self
    }

    /// Returns whether the quantity is a number, and so can have a tolerance.
    pub fn is_numeric(&self) -> bool {
        self.baseline.is_number() || self.now.is_number()
    }

    fn number(quantity: impl Into<String>, baseline: f64, now: f64, tolerance: f64) -> Self {
        Self {
            quantity: quantity.into(),
            baseline: json!(baseline),
            now: json!(now),
            difference: Number(now - baseline),
            tolerance: Number(tolerance),
            first_tick: None,
            outcome: judge(baseline, now, tolerance),
        }
    }

    /// Returns the difference over the tolerance; 0 if the tolerance is 0.
    pub fn share_of_tolerance(&self) -> f64 {
        if self.tolerance.0 > 0.0 { self.difference.0.abs() / self.tolerance.0 } else { 0.0 }
    }
}

fn judge(baseline: f64, now: f64, tolerance: f64) -> ComparisonOutcome {
    let difference = (now - baseline).abs();
    if difference <= tolerance {
        if now.to_bits() == baseline.to_bits() { ComparisonOutcome::Identical } else { ComparisonOutcome::Within }
    } else {
        ComparisonOutcome::Fail
    }
}

/// Compares every quantity of a scene's results with its baseline.
///
/// ```
/// use stickslip::verify::{baseline::Store, compare::{ComparisonOutcome, compare}, results::Number};
///
/// let baseline = Store::Program.load("fig3-sliding")?;
/// let mut now = baseline.results.clone();
/// assert!(compare(&baseline, &baseline.provenance, &now).iter().all(|each| each.outcome == ComparisonOutcome::Identical));
///
/// // A last bit is round-off, a NaN is not.
/// let force = now.summary["largest_force_n"].0;
/// now.summary.insert("largest_force_n".to_owned(), Number(force * (1.0 + f64::EPSILON)));
/// now.summary.insert("stored_j".to_owned(), Number(f64::NAN));
/// let compared = compare(&baseline, &baseline.provenance, &now);
/// let of = |name: &str| compared.iter().find(|each| each.quantity == name).expect("it is compared");
/// assert_eq!(of("largest_force_n").outcome, ComparisonOutcome::Within);
/// assert!(of("largest_force_n").share_of_tolerance() < 1e-6);
/// assert_eq!(of("stored_j").outcome, ComparisonOutcome::Fail);
/// # Ok::<(), stickslip::verify::baseline::BaselineError>(())
/// ```
pub fn compare(baseline: &Baseline, provenance: &Provenance, now: &Results) -> Vec<Comparison> {
    let before = &baseline.results;
    let sizes = Sizes::of(before);
    let relative = |name: &str| baseline.tolerances.get(name).copied();
    let scaled = |name: &str| relative(name).unwrap_or(SCALED_TOLERANCE);
    let mut all = trace(before, now, &sizes, &scaled);
    let beyond: BTreeMap<String, u64> =
        all.iter().filter_map(|c| Some((c.quantity.strip_prefix("trace ")?.to_owned(), c.first_tick?))).collect();
    let diverged = all.iter().filter_map(|comparison| comparison.first_tick).min();

    let mut rest = vec![
        Comparison::exact("scene_sha256", json!(baseline.provenance.scene_sha256), json!(provenance.scene_sha256)),
        Comparison::exact("fault", fault(before), fault(now)),
    ];
    for (name, before, now) in joined(&before.counts, &now.counts) {
        rest.push(Comparison::exact(name, json!(before), json!(now)).allowing(relative(name)));
    }
    for (name, before, now) in joined(&before.summary, &now.summary) {
        let tolerance = scaled(name) * sizes.of_summary(name);
        rest.push(Comparison::number(name, value(before), value(now), tolerance));
    }
    for comparison in rest.iter_mut().filter(|comparison| comparison.outcome == ComparisonOutcome::Fail) {
        comparison.first_tick = diverged;
    }
    for (name, before, now) in joined(&before.statistics, &now.statistics) {
        let (before, now) = (before.map(|s| s.named()), now.map(|s| s.named()));
        for i in 0..4 {
            let of = |s: &Option<[(&'static str, f64); 4]>| s.map_or(f64::NAN, |s| s[i].1);
            let statistic = ["min", "max", "mean", "rms"][i];
            let quantity = format!("{name} {statistic}");
            let tolerance = scaled(&quantity) * sizes.of_trace(name);
            let mut comparison = Comparison::number(quantity, of(&before), of(&now), tolerance);
            if comparison.outcome == ComparisonOutcome::Fail {
                comparison.first_tick = beyond.get(name).copied().or(diverged);
            }
            rest.push(comparison);
        }
    }
    for (name, before, now) in joined(&before.work, &now.work) {
        let quantity = format!("work: {name}");
        let allowed = relative(&quantity);
        let mut comparison = Comparison::exact(quantity, json!(before), json!(now)).allowing(allowed);
        if let (Some(before), Some(now)) = (before, now)
            && now < before
        {
            comparison.outcome = ComparisonOutcome::Improved;
        }
        rest.push(comparison);
    }
    all.extend(rest);
    all
}

fn fault(results: &Results) -> Value {
    match (&results.fault, results.fault_tick) {
        (Some(fault), Some(tick)) => json!(format!("{fault} at tick {tick}")),
        (None, None) => json!("none"),
        _ => Value::Null,
    }
}

fn value(number: Option<&Number>) -> f64 {
    number.map_or(f64::NAN, |number| number.0)
}

/// Joins the entries of both maps by name; an entry of only one map is included.
fn joined<'a, T>(
    a: &'a BTreeMap<String, T>,
    b: &'a BTreeMap<String, T>,
) -> impl Iterator<Item = (&'a str, Option<&'a T>, Option<&'a T>)> {
    let only_b = b.keys().filter(|name| !a.contains_key(*name));
    a.keys().chain(only_b).map(|name| (name.as_str(), a.get(name), b.get(name)))
}

/// Sizes of the quantities of a baseline, to which differences are relative.
struct Sizes<'a> {
    results: &'a Results,
    force: f64,
}

impl<'a> Sizes<'a> {
    fn of(results: &'a Results) -> Self {
        let mut sizes = Self { results, force: 0.0 };
        sizes.force = QUANTITIES[..FORCES].iter().map(|name| sizes.own(name)).fold(0.0, f64::max);
        sizes
    }

    fn own(&self, quantity: &str) -> f64 {
        self.results.statistics.get(quantity).map_or(0.0, |s| s.min.0.abs().max(s.max.0.abs()))
    }

    /// Returns the size of a trace's quantity. A part of the force can vanish, so all parts have that of the largest.
    fn of_trace(&self, quantity: &str) -> f64 {
        if QUANTITIES[..FORCES].contains(&quantity) { self.force } else { self.own(quantity) }
    }

    fn of_summary(&self, name: &str) -> f64 {
        let own = |name: &str| value(self.results.summary.get(name)).abs();
        match name {
            "force_power_above_100_hz_n2" => self.force * self.force,
            "stored_j" | "energy_residual_j" => own("absolute_work_j"),
            _ if name.ends_with("_n") => self.force,
            _ => own(name),
        }
    }
}

/// Compares the thinned traces tick by tick. Ticks that one of them lacks fail under the name "trace ticks".
fn trace(before: &Results, now: &Results, sizes: &Sizes, scaled: &impl Fn(&str) -> f64) -> Vec<Comparison> {
    let ticks = |results: &Results| results.trace.iter().map(|tick| tick.tick).collect::<Vec<_>>();
    let (ticks_before, ticks_now) = (ticks(before), ticks(now));
    let mut kept = Comparison::exact("trace ticks", json!(ticks_before.len()), json!(ticks_now.len()));
    if ticks_before != ticks_now {
        kept.outcome = ComparisonOutcome::Fail;
        let lacking = |a: &[u64], b: &[u64]| a.iter().copied().find(|tick| !b.contains(tick));
        let first = [lacking(&ticks_before, &ticks_now), lacking(&ticks_now, &ticks_before)];
        kept.first_tick = first.into_iter().flatten().min();
    }
    let pairs: Vec<(&KeptTick, &KeptTick)> =
        (before.trace.iter()).filter_map(|a| Some((a, now.trace.iter().find(|b| b.tick == a.tick)?))).collect();

    let mut all = vec![kept];
    let mode = |tick: &KeptTick| json!(tick.mode);
    // "none" is the right value of a free tick, so it must differ from a missing value.
    let triangle = |tick: &KeptTick| tick.triangle.map_or(json!("none"), |triangle| json!(triangle));
    all.push(exact_trace("trace mode", &pairs, mode));
    all.push(exact_trace("trace triangle", &pairs, triangle));
    for quantity in &now.quantities {
        let place = |results: &Results| results.quantities.iter().position(|name| name == quantity);
        let at = |tick: &KeptTick, place: Option<usize>| value(place.and_then(|i| tick.values.get(i)));
        let (place_before, place_now) = (place(before), place(now));
        let values = pairs.iter().map(|(a, b)| (a.tick, at(a, place_before), at(b, place_now)));
        let tolerance = scaled(&format!("trace {quantity}")) * sizes.of_trace(quantity);
        all.push(number_trace(quantity, values, tolerance));
    }
    all
}

fn exact_trace(name: &str, pairs: &[(&KeptTick, &KeptTick)], of: impl Fn(&KeptTick) -> Value) -> Comparison {
    let mut differing = pairs.iter().filter(|(a, b)| of(a) != of(b));
    let Some((a, b)) = differing.next().or(pairs.last()) else {
        return Comparison::exact(name, Value::Null, Value::Null);
    };
    let mut comparison = Comparison::exact(name, of(a), of(b));
    if comparison.outcome == ComparisonOutcome::Fail {
        comparison.first_tick = Some(a.tick);
    }
    comparison
}

fn number_trace(quantity: &str, values: impl Iterator<Item = (u64, f64, f64)>, tolerance: f64) -> Comparison {
    let name = format!("trace {quantity}");
    let mut worst: Option<Comparison> = None;
    for (tick, before, now) in values {
        let mut here = Comparison::number(name.as_str(), before, now, tolerance);
        if here.outcome == ComparisonOutcome::Fail {
            here.first_tick = Some(tick);
            return here;
        }
        let further = worst.as_ref().is_none_or(|worst| {
            here.difference.0.abs() > worst.difference.0.abs()
                || (worst.outcome == ComparisonOutcome::Identical && here.outcome == ComparisonOutcome::Within)
        });
        if further {
            worst = Some(here);
        }
    }
    // A comparison of no values must not pass.
    worst.unwrap_or_else(|| Comparison::number(name, f64::NAN, f64::NAN, tolerance))
}
