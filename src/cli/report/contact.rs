//! The section on what contact must reach.

use maud::{Markup, html};
use rayon::prelude::*;

use crate::cli::page;
use crate::cli::progress::Progress;
use crate::cli::table::fixed;
use crate::verify::contact_limits::{CONTACTS, Length, LimitRow, measure, table};

/// Measures every quantity for every contact, side by side: nothing is timed.
pub fn limits() -> miette::Result<Vec<LimitRow>> {
    let mut progress = Progress::new(1, "studies");
    progress.begin("what contact must reach");
    let columns: Result<Vec<_>, _> =
        (0..CONTACTS.len()).into_par_iter().map(|contact| measure(contact, Length::Whole)).collect();
    let columns = columns.map_err(|error| miette::miette!("{error}"))?;
    progress.end(1);
    Ok(table(&columns))
}

pub fn section(rows: &[LimitRow]) -> Markup {
    let [paper, velocity, massless] = CONTACTS.map(|(name, ..)| name);
    let cells = rows.iter().map(|row| {
        let with_unit = |value: String| if row.unit.is_empty() { value } else { format!("{value} {}", row.unit) };
        let limit = format!("{} {}", if row.is_least { "≥" } else { "≤" }, with_unit(row.limit.to_string()));
        let value = |contact: usize| {
            let decimals = if row.is_count() { 0 } else { 3 };
            let text = row.values[contact].map_or("–".to_owned(), |value| with_unit(fixed(value, decimals)));
            if row.holds(contact) { text } else { format!("{text} ✗") }
        };
        [row.quantity.clone(), limit, value(0), value(1), value(2)]
    });
    let held = |contact: usize| rows.iter().filter(|row| row.holds(contact)).count();
    html! {
        h2 #contact { "What contact must reach" }
        p {
            "The massless scheme over the limit surface is within " (held(2)) " of " (rows.len()) " limits, the velocity \
             scheme over it within " (held(1)) ", the paper's contact within " (held(0)) ". ✗: beyond the limit; –: the \
             run ended with a fault, or the event did not occur. Drags run the whole network; the modelled hand holds \
             the PHANTOM and presses with 0.7 N."
        }
        details open {
            summary { "Quantities, limits and values" }
            (page::table("", ["quantity", "limit", paper, velocity, massless], cells))
        }
    }
}
