//! Ticks, deadlines and what computing takes in virtual time.

use toml::Spanned;

use super::{Checker, Placed, Sign, whole};
use crate::multirate::timeline::{Cost, Costs, Deadline, OverrunPolicy};
use crate::scene::error::{Problem, SceneError};
use crate::scene::file::{CostValue, LogNormalCost, RareCost, TimingTable};
use crate::scene::{Scene, Schedule};

/// Why what is declared for virtual time has no effect.
pub(super) const IN_REAL_TIME: &str = "`run.schedule = \"threads\"`, where computing takes the time it takes";

pub(in crate::scene) fn at_rate(mut scene: Scene, rate: f64) -> Placed<Scene> {
    let refuse =
        |value: String| SceneError::unplaced(Problem::NotAccepted { key: "local.rate", value }, "give another rate");
    if !(rate > 0.0 && rate.is_finite()) {
        return Err(refuse(rate.to_string()));
    }
    let not_global = || refuse(format!("{rate} Hz, which is no whole multiple of the global {} Hz", scene.global.rate));
    let ticks_per_cycle =
        whole(rate / scene.global.rate).filter(|&ratio| ratio <= f64::from(u32::MAX)).ok_or_else(not_global)?;
    let ticks = scene.duration * rate;
    let tick_count =
        whole(ticks).ok_or_else(|| refuse(format!("{rate} Hz: {} s would be {ticks} ticks", scene.duration)))?;
    let tick = 1.0 / rate;
    let Deadline { after, .. } = scene.deadline;
    if after == scene.tick {
        scene.deadline.after = tick;
    } else if !(after <= tick) {
        return Err(refuse(format!("{rate} Hz with a deadline of {after} s: a tick is over after {tick} s")));
    }
    scene.ticks_per_cycle = ticks_per_cycle as u32;
    scene.tick_count = tick_count as u64;
    scene.tick = tick;
    Ok(scene)
}

impl Checker {
    pub(super) fn timing(
        &self,
        timing: &TimingTable,
        schedule: Schedule,
        tick: f64,
    ) -> Placed<(Deadline, Option<Costs>)> {
        let TimingTable { tick_cost, model_cost, deadline, overrun, seed } = timing;
        let is_seeded = |cost: &Option<Spanned<CostValue>>| {
            matches!(cost.as_ref().map(Spanned::get_ref), Some(CostValue::LogNormal(_) | CostValue::Rare(_)))
        };
        let (tick_span, model_span) = (tick_cost.as_ref().map(Spanned::span), model_cost.as_ref().map(Spanned::span));
        match schedule {
            Schedule::Threads => {
                self.no_effect("timing.tick_cost", tick_span, IN_REAL_TIME)?;
                self.no_effect("timing.model_cost", model_span, IN_REAL_TIME)?;
                self.no_effect("timing.seed", seed.as_ref().map(Spanned::span), IN_REAL_TIME)?;
            }
            Schedule::Lockstep => {
                if tick_cost.is_none() {
                    let because = "ticks that take no time: give `timing.tick_cost`";
                    self.no_effect("timing.deadline", deadline.as_ref().map(Spanned::span), because)?;
                    self.no_effect("timing.overrun", overrun.as_ref().map(Spanned::span), because)?;
                }
                if !is_seeded(tick_cost) && !is_seeded(model_cost) {
                    let because = "costs of which none is drawn from a distribution";
                    self.no_effect("timing.seed", seed.as_ref().map(Spanned::span), because)?;
                }
            }
        }
        let after = match deadline {
            None => tick,
            Some(deadline) => {
                let after = self.number("timing.deadline", deadline, Sign::Positive)?;
                if !(after <= tick) {
                    let value = format!("{after} s: a tick is over after {tick} s");
                    return Err(self.error(Problem::NotAccepted { key: "timing.deadline", value }, deadline.span()));
                }
                after
            }
        };
        let overrun = overrun.as_ref().map_or(OverrunPolicy::Hold, |overrun| *overrun.get_ref());
        let costs = if tick_cost.is_some() || model_cost.is_some() {
            Some(Costs {
                tick: self.cost("timing.tick_cost", tick_cost)?,
                model: self.cost("timing.model_cost", model_cost)?,
                seed: seed.as_ref().map_or(0, |seed| *seed.get_ref()),
            })
        } else {
            None
        };
        Ok((Deadline { after, overrun }, costs))
    }

    /// Nothing if the key is absent.
    fn cost(&self, key: &'static str, cost: &Option<Spanned<CostValue>>) -> Placed<Cost> {
        let Some(cost) = cost else { return Ok(Cost::Constant(0.0)) };
        let check = |value: f64| self.check(key, value, cost.span(), Sign::NonNegative);
        let refuse = |value: String| Err(self.error(Problem::NotAccepted { key, value }, cost.span()));
        match cost.get_ref() {
            CostValue::Constant(value) => Ok(Cost::Constant(check(*value)?)),
            CostValue::Table(values) if values.is_empty() => refuse("an empty list".to_owned()),
            CostValue::Table(values) => {
                values.iter().map(|&value| check(value)).collect::<Placed<Vec<_>>>().map(Cost::Table)
            }
            &CostValue::LogNormal(LogNormalCost { median, p99 }) => {
                if !(median > 0.0 && p99 >= median && p99.is_finite()) {
                    return refuse(format!("{{ median = {median}, p99 = {p99} }}"));
                }
                Ok(Cost::LogNormal { median, p99 })
            }
            &CostValue::Rare(RareCost { usual, rare, share }) => {
                if !(0.0..=1.0).contains(&share) {
                    return refuse(format!("drawn with share = {share}"));
                }
                Ok(Cost::Rare { usual: check(usual)?, rare: check(rare)?, share })
            }
        }
    }
}
