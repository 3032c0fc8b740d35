//! Virtual walls that the modelled device renders without shaking: table, section of the page and figure.

use comfy_table::{Table, presets::UTF8_FULL_CONDENSED};
use maud::{Markup, PreEscaped, html};

use crate::cli::page;
use crate::device::phantom::PhantomSettings;
use crate::verify::z_width::{DAMPINGS_N_S_PER_M, QUIET_M, RATES_HZ, WallLimit, ZWidthError, wall_limit};

/// Returns all pairs of servo rate, Hz, and wall damping, N·s/m.
pub fn points() -> Vec<[f64; 2]> {
    RATES_HZ.iter().flat_map(|&rate| DAMPINGS_N_S_PER_M.map(|damping| [rate, damping])).collect()
}

/// Measures the limit at one pair, for the default device.
pub fn limit(&[rate, damping]: &[f64; 2]) -> Result<WallLimit, ZWidthError> {
    wall_limit(&PhantomSettings::default(), rate, damping)
}

const HEAD: [&str; 6] =
    ["servo rate", "wall damping", "stiffest quiet wall", "2(b − |B|)/h", "2f_c/Δ", "passive walls are quiet"];

fn row(limit: &WallLimit) -> [String; 6] {
    let stiffness = |value: f64| format!("{value:.0} N/m");
    [
        rate_name(limit.rate_hz),
        format!("{} N·s/m", limit.damping_n_s_per_m),
        match limit.quiet_n_per_m {
            Some(0.0) => "none".to_owned(),
            Some(quiet) => stiffness(quiet),
            None => "all".to_owned(),
        },
        stiffness(limit.by_damping_n_per_m),
        limit.by_friction_n_per_m.map_or("no bound".to_owned(), stiffness),
        if limit.agrees { "yes".to_owned() } else { "NO".to_owned() },
    ]
}

fn rate_name(rate_hz: f64) -> String {
    format!("{} kHz", 1e-3 * rate_hz)
}

pub fn table(limits: &[WallLimit]) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header(HEAD);
    limits.iter().for_each(|limit| {
        table.add_row(row(limit));
    });
    table
}

pub fn section(limits: &[WallLimit]) -> miette::Result<Markup> {
    let rows = limits
        .iter()
        .map(|limit| page::Row { class: (!limit.agrees).then(|| "unexpected".to_owned()), cells: row(limit) });
    Ok(html! {
        h3 { "Virtual walls" }
        p {
            "Stiffest wall into which the modelled hand can lead the modelled device without the tip shaking by more \
             than " (1e3 * QUIET_M) " mm. Hand and device have their default parameters, whatever the scene. Marks: \
             measured on the sampled loop with encoders, quantised currents and a delay of one tick. Lines: passivity \
             bounds of Colgate and Schenkel, 2(b − |B|)/h, and of Abbott and Okamura, 2f_c/Δ; a wall below both is \
             passive in any hand. The bounds are sufficient: no mark may be below the lower one, and marks may be far \
             above. This hand adds damping, and near rest the friction of the joints resists like a damper far above \
             their own."
        }
        figure { (PreEscaped(figure(limits)?)) figcaption { "Stiffest quiet wall over its damping." } }
        details {
            summary { "Table of all walls" }
            (page::table("", HEAD, rows))
        }
    })
}

#[cfg(feature = "plots")]
fn figure(limits: &[WallLimit]) -> miette::Result<String> {
    use crate::output::figures::z_width::{RateCurve, z_width};
    let curves = RATES_HZ.map(|rate| {
        let of_rate = || limits.iter().filter(move |limit| limit.rate_hz == rate);
        RateCurve {
            name: rate_name(rate),
            quiet: of_rate().map(|limit| limit.quiet_n_per_m).collect(),
            by_damping: of_rate().map(|limit| limit.by_damping_n_per_m).collect(),
        }
    });
    // This bound depends on neither rate nor damping.
    let by_friction = limits.first().and_then(|limit| limit.by_friction_n_per_m);
    z_width(&DAMPINGS_N_S_PER_M, &curves, by_friction)
        .map_err(|error| miette::miette!("cannot draw the virtual walls: {error}"))
}

#[cfg(not(feature = "plots"))]
fn figure(_: &[WallLimit]) -> miette::Result<String> {
    Ok(String::new())
}
