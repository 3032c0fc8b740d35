//! The `[timing]` table: deadlines, and computing times in virtual time.

use super::{Read, no_effect};
use crate::multirate::timeline::{Cost, Costs, Deadline};
use crate::scene::Schedule;
use crate::scene::check::IN_REAL_TIME;
use crate::scene::file::{CostValue, LogNormalCost, RareCost, TimingTable};

pub(super) fn timing(timing: &TimingTable, schedule: Schedule, tick_s: f64) -> Read<(Deadline, Option<Costs>)> {
    let TimingTable { tick_cost, model_cost, deadline, overrun, seed } = timing;
    let is_seeded = |cost: &Option<CostValue>| matches!(cost, Some(CostValue::LogNormal(_) | CostValue::Rare(_)));
    match schedule {
        Schedule::Threads => {
            no_effect("timing.tick_cost", tick_cost.is_some(), IN_REAL_TIME)?;
            no_effect("timing.model_cost", model_cost.is_some(), IN_REAL_TIME)?;
            no_effect("timing.seed", seed.is_some(), IN_REAL_TIME)?;
        }
        Schedule::Lockstep => {
            if tick_cost.is_none() {
                let because = "ticks that take no time: give `timing.tick_cost`";
                no_effect("timing.deadline", deadline.is_some(), because)?;
                no_effect("timing.overrun", overrun.is_some(), because)?;
            }
            if !is_seeded(tick_cost) && !is_seeded(model_cost) {
                no_effect("timing.seed", seed.is_some(), "costs that are not drawn from a distribution")?;
            }
        }
    }
    let deadline = Deadline { after: deadline.unwrap_or(tick_s), overrun: overrun.unwrap_or_default() };
    let has_costs = tick_cost.is_some() || model_cost.is_some();
    let costs =
        has_costs.then(|| Costs { tick: cost(tick_cost), model: cost(model_cost), seed: seed.unwrap_or_default() });
    Ok((deadline, costs))
}

/// Returns the computing time; zero if the key is absent.
fn cost(cost: &Option<CostValue>) -> Cost {
    match cost {
        None => Cost::Constant(0.0),
        Some(CostValue::Constant(value)) => Cost::Constant(*value),
        Some(CostValue::Table(values)) => Cost::Table(values.clone()),
        &Some(CostValue::LogNormal(LogNormalCost { median, p99 })) => Cost::LogNormal { median, p99 },
        &Some(CostValue::Rare(RareCost { usual, rare, share })) => Cost::Rare { usual, rare, share },
    }
}
