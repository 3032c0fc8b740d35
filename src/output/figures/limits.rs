//! Figure of stability-limit time steps.

use std::io;

use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Area, BLUE, Drawn, ORANGE, document, quiet};

/// Stability limits of one integrator.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Title of the panel.
    pub title: String,
    /// Curves of the panel.
    pub curves: Vec<Curve>,
}

/// A predicted stability limit and its measurement.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Index of the series, which decides colour and dash.
    pub series: usize,
    /// Predicted and measured limit at every value, s; none without a limit.
    pub steps: Vec<[Option<f64>; 2]>,
}

const WIDTH: u32 = 960;
const LEGEND: u32 = 36;
const PANEL: u32 = 400;
/// Height of a panel's upper part.
const SPLIT: i32 = 300;
const COLUMNS: usize = 2;
/// Colours of the series: of 0 and 2, and of 1 and 3.
const COLOURS: [RGBColor; 2] = [BLUE, ORANGE];
/// Smallest ratio on the axis, whose largest is 2 less this one.
const LEAST_RATIO: f64 = 0.95;

/// Draws predicted (lines) and measured (marks) stability limits at every value of the varied parameter, with their
/// ratio below, as an SVG document with a panel per integrator. Steps are on a logarithmic scale; "no limit" is a line
/// above it. There are at most four series: the last two are dashed, with hollow marks around those of the first two.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::output::figures::limits::{Curve, Panel, limits};
///
/// // Four times the stiffness, half the step; without any there is no limit.
/// let steps = vec![[None; 2], [Some(2e-3), Some(1.99e-3)], [Some(1e-3), Some(1e-3)]];
/// let panel = Panel { title: "semi-implicit-euler".to_owned(), curves: vec![Curve { series: 0, steps }] };
/// let svg = limits("stiffness (N/m)", &[0.0, 100.0, 400.0], &["free".to_owned()], &[panel])?;
/// assert!(svg.contains("semi-implicit-euler") && svg.contains("no limit"));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn limits(varied: &str, values: &[f64], series: &[String], panels: &[Panel]) -> io::Result<String> {
    let rows = panels.len().div_ceil(COLUMNS);
    document((WIDTH, LEGEND + PANEL * rows as u32), |root| draw(root, varied, values, series, panels))
}

fn draw(root: &Area, varied: &str, values: &[f64], series: &[String], panels: &[Panel]) -> Drawn {
    let rows = panels.len().div_ceil(COLUMNS);
    let (legend, rest) = root.split_vertically(LEGEND);
    for (i, name) in series.iter().enumerate() {
        let (x, y) = (84 + i as i32 * (WIDTH as i32 - 100) / series.len() as i32, 22);
        if is_dashed(i) {
            legend.draw(&DashedPathElement::new([(x, y), (x + 30, y)], 6, 4, colour(i).stroke_width(2)))?;
        } else {
            legend.draw(&PathElement::new([(x, y), (x + 30, y)], colour(i).stroke_width(2)))?;
        }
        legend.draw(&mark(i, (x + 15, y)))?;
        write(&legend, (x + 38, y), name, HPos::Left)?;
    }
    let limits = || panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| curve.steps.iter().flatten());
    let decades = limits().flatten().filter(|limit| **limit > 0.0).map(|limit| limit.log10());
    let (bottom, top) =
        decades.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at.floor()), high.max(at.ceil())));
    let (bottom, top) = if bottom < top { (bottom, top) } else { (-4.0, -1.0) };
    for (area, panel) in rest.split_evenly((rows, COLUMNS)).iter().zip(panels) {
        draw_panel(area, panel, varied, values, [bottom, top + 1.0])?;
    }
    Ok(())
}

/// Draws a panel with steps from 10^bottom s; "no limit" is in the place of 10^rail s.
fn draw_panel(area: &Area, panel: &Panel, varied: &str, values: &[f64], [bottom, rail]: [f64; 2]) -> Drawn {
    // Values are equally spaced, whatever their differences.
    let x = -0.4..values.len() as f64 - 0.6;
    let name = |place: &f64| {
        let value = values.get(place.round() as usize).filter(|_| (place - place.round()).abs() < 0.01);
        value.map_or(String::new(), |value| if *value < 1e3 { format!("{value}") } else { format!("{value:e}") })
    };
    let (upper, lower) = area.split_vertically(SPLIT);
    let mut chart = ChartBuilder::on(&upper)
        .caption(&panel.title, ("sans-serif", 16))
        .margin(8)
        .x_label_area_size(4)
        .y_label_area_size(64)
        .build_cartesian_2d(x.clone(), bottom..rail + 0.3)?;
    quiet(
        chart
            .configure_mesh()
            .y_desc("longest stable step (s)")
            .x_labels(0)
            .y_labels((rail - bottom) as usize + 1)
            .y_label_formatter(&|step| if *step < rail { format!("1e{step:.0}") } else { "no limit".to_owned() })
            .max_light_lines(0),
    )
    .draw()?;
    let place = |limit: Option<f64>| limit.map_or(rail, |limit| limit.log10().max(bottom));
    for curve in &panel.curves {
        let points = |which: usize| {
            curve.steps.iter().enumerate().map(move |(i, step)| (i as f64, place(step[which]))).collect::<Vec<_>>()
        };
        let style = colour(curve.series).stroke_width(2);
        if is_dashed(curve.series) {
            chart.draw_series(DashedLineSeries::new(points(0), 6, 4, style))?;
        } else {
            chart.draw_series(LineSeries::new(points(0), style))?;
        }
        chart.draw_series(points(1).into_iter().map(|at| mark(curve.series, at)))?;
    }

    let mut chart = ChartBuilder::on(&lower)
        .margin(8)
        .x_label_area_size(40)
        .y_label_area_size(64)
        .build_cartesian_2d(x.clone(), LEAST_RATIO - 0.015..2.015 - LEAST_RATIO)?;
    quiet(
        chart
            .configure_mesh()
            .x_desc(varied)
            .y_desc("ratio")
            .x_labels(values.len() + 1)
            .y_labels(3)
            .x_label_formatter(&name)
            .y_label_formatter(&|ratio| format!("{ratio:.2}"))
            .max_light_lines(0),
    )
    .draw()?;
    chart.draw_series([Rectangle::new([(x.start, 0.98), (x.end, 1.02)], BLACK.mix(0.06).filled())])?;
    for curve in &panel.curves {
        let marks = curve.steps.iter().enumerate().map(|(i, &[predicted, measured])| {
            let ratio = match (predicted, measured) {
                (Some(predicted), Some(measured)) if predicted != measured => measured / predicted,
                (Some(_), None) => f64::INFINITY,
                (None, Some(_)) => 0.0,
                (Some(_), Some(_)) | (None, None) => 1.0,
            };
            mark(curve.series, (i as f64, ratio.clamp(LEAST_RATIO, 2.0 - LEAST_RATIO)))
        });
        chart.draw_series(marks)?;
    }
    Ok(())
}

fn colour(series: usize) -> RGBColor {
    COLOURS[series % 2]
}

fn is_dashed(series: usize) -> bool {
    series >= 2
}

fn mark<Place>(series: usize, at: Place) -> Circle<Place, i32> {
    if is_dashed(series) {
        Circle::new(at, 6, colour(series).stroke_width(1))
    } else {
        Circle::new(at, 3, colour(series).filled())
    }
}

fn write(area: &Area, at: (i32, i32), text: &str, side: HPos) -> Drawn {
    let style = ("sans-serif", 14).into_font().color(&BLACK).pos(Pos::new(side, VPos::Center));
    Ok(area.draw_text(text, &style, at)?)
}
