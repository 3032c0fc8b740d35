//! Acceptance of results as a baseline: the only way in which a baseline is created or changed.

use std::collections::BTreeMap;

use miette::Diagnostic;
use thiserror::Error;

use super::baseline::{Acceptance, Baseline, BaselineError, Provenance};
use super::compare::{ComparisonOutcome, compare};
use super::results::Results;
use crate::scene::Scene;

/// Why results were not accepted.
#[derive(Debug, Error, Diagnostic)]
pub enum AcceptError {
    /// No reason was given.
    #[error("a baseline cannot be changed without a reason")]
    #[diagnostic(help("state what changed the results and why the change is right"))]
    NoReason,
    /// The present baseline cannot be read, and its record would be lost.
    #[error(transparent)]
    #[diagnostic(help("restore the file, or delete it to begin with a first baseline"))]
    Baseline(BaselineError),
}

/// Returns the baseline after `results` and `tolerances` are accepted; `None` if nothing changes. Earlier tolerances stay.
///
/// # Errors
/// If no reason is given, or the present baseline cannot be read.
///
/// ```
/// use stickslip::scene::Scene;
/// use stickslip::verify::{accept::{AcceptError, accept}, baseline::Store};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let present = Store::Program.load(&scene.name)?;
/// let mut results = present.results.clone();
/// // Identical results change nothing.
/// let none = std::collections::BTreeMap::new();
/// assert_eq!(accept(Store::Program.load(&scene.name), &scene, results.clone(), &none, "try")?, None);
/// // Others come in with a reason, and what they replace stays on record.
/// results.counts.insert("collisions".to_owned(), 99);
/// let error = accept(Store::Program.load(&scene.name), &scene, results.clone(), &none, " ");
/// assert!(matches!(error, Err(AcceptError::NoReason)));
/// let accepted = accept(Store::Program.load(&scene.name), &scene, results, &none, "a bouncing tip")?;
/// let last = accepted.and_then(|baseline| baseline.accepted.into_iter().last()).expect("it has changed");
/// assert_eq!(last.reason, "a bouncing tip");
/// assert_eq!(last.previous["collisions"], present.results.counts["collisions"]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn accept(
    present: Result<Baseline, BaselineError>,
    scene: &Scene,
    results: Results,
    tolerances: &BTreeMap<String, f64>,
    reason: &str,
) -> Result<Option<Baseline>, AcceptError> {
    if reason.trim().is_empty() {
        return Err(AcceptError::NoReason);
    }
    let provenance = Provenance::of(scene);
    let (mut accepted, mut own, previous) = match present {
        Err(BaselineError::Missing(_)) => (Vec::new(), BTreeMap::new(), BTreeMap::new()),
        Err(error) => return Err(AcceptError::Baseline(error)),
        Ok(present) => {
            let changed = compare(&present, &provenance, &results);
            let changed = changed.into_iter().filter(|comparison| comparison.outcome != ComparisonOutcome::Identical);
            let previous: BTreeMap<_, _> = changed.map(|c| (c.quantity, c.baseline)).collect();
            if previous.is_empty() && tolerances.iter().all(|(name, value)| present.tolerances.get(name) == Some(value))
            {
                return Ok(None);
            }
            (present.accepted, present.tolerances, previous)
        }
    };
    let version = provenance.version.clone();
    accepted.push(Acceptance { reason: reason.trim().to_owned(), version, previous });
    own.extend(tolerances.clone());
    Ok(Some(Baseline { scene: scene.name.clone(), provenance, accepted, tolerances: own, results }))
}
