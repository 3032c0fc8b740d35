//! Figure of the stiffest quiet virtual walls.

use std::io;

use plotters::element::DashedPathElement;
use plotters::prelude::*;

use super::axes::{Area, BLUE, Drawn, GREY, ORANGE, document, legend, quiet};

/// Limits at one rate of the servo loop.
#[derive(Debug, Clone)]
pub struct RateCurve {
    /// Name in the legend.
    pub name: String,
    /// Stiffest quiet wall at every damping, N/m; 0 if no wall is quiet, none if all are.
    pub quiet: Vec<Option<f64>>,
    /// Passivity bound by the device's damping at every damping, N/m; 0 if no wall is passive.
    pub by_damping: Vec<f64>,
}

const COLOURS: [RGBColor; 2] = [ORANGE, BLUE];
/// Place of "none" on the axis of decades.
const NO_WALL: f64 = 0.0;
/// Place of "all" on the axis of decades.
const ALL_WALLS: f64 = 6.0;

/// Draws measured limits (marks) and passivity bounds (lines) of stiffness over the dampings of the wall, N·s/m, as an
/// SVG document. Stiffnesses are on a logarithmic scale; "none" is a line below it and "all" a line above it.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::output::figures::z_width::{RateCurve, z_width};
///
/// // Between no wall and all walls there are decades of stiffness.
/// let quiet = vec![Some(0.0), Some(1200.0), None];
/// let curve = RateCurve { name: "1000 Hz".to_owned(), quiet, by_damping: vec![0.0, 900.0, 2000.0] };
/// let svg = z_width(&[0.0, 1.0, 2.0], &[curve], None)?;
/// assert!(["1000 Hz", "none", "all", "1e3"].iter().all(|text| svg.contains(text)));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn z_width(dampings: &[f64], rates: &[RateCurve], by_friction: Option<f64>) -> io::Result<String> {
    document((960, 460), |root| draw(root, dampings, rates, by_friction))
}

fn draw(root: &Area, dampings: &[f64], rates: &[RateCurve], by_friction: Option<f64>) -> Drawn {
    // Dampings are equally spaced, whatever their differences.
    let (left, right) = (-0.4, dampings.len() as f64 - 0.6);
    let name = |place: &f64| {
        let value = dampings.get(place.round() as usize).filter(|_| (place - place.round()).abs() < 0.01);
        value.map_or(String::new(), |value| format!("{value}"))
    };
    let decade = |stiffness: f64| stiffness.log10().clamp(NO_WALL, ALL_WALLS);
    let mut chart = ChartBuilder::on(root)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(70)
        .build_cartesian_2d(left..right, NO_WALL - 0.3..ALL_WALLS + 0.3)?;
    quiet(
        chart
            .configure_mesh()
            .x_desc("damping of the wall (N·s/m)")
            .y_desc("stiffness of the wall (N/m)")
            .x_labels(dampings.len() + 1)
            .y_labels(8)
            .x_label_formatter(&name)
            .y_label_formatter(&|decade| match *decade {
                at if at <= NO_WALL => "none".to_owned(),
                at if at >= ALL_WALLS => "all".to_owned(),
                at => format!("1e{at:.0}"),
            })
            .max_light_lines(0),
    )
    .draw()?;
    for (rate, colour) in rates.iter().zip(COLOURS) {
        let marks = rate.quiet.iter().enumerate().map(|(i, limit)| (i as f64, limit.map_or(ALL_WALLS, decade)));
        chart
            .draw_series(marks.map(|at| Circle::new(at, 5, colour.filled())))?
            .label(format!("{}: stiffest quiet wall, measured", rate.name))
            .legend(move |(x, y)| Circle::new((x + 13, y), 5, colour.filled()));
        let style = colour.stroke_width(2);
        let bounds = rate.by_damping.iter().enumerate().map(|(i, &bound)| (i as f64, decade(bound)));
        chart
            .draw_series(LineSeries::new(bounds, style))?
            .label(format!("{}: passivity bound by damping, 2(b − |B|)/h", rate.name))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 26, y)], style));
    }
    if let Some(bound) = by_friction {
        let style = GREY.stroke_width(2);
        let at = decade(bound);
        chart
            .draw_series([DashedPathElement::new([(left, at), (right, at)], 6, 4, style)])?
            .label("passivity bound by friction and encoders, 2f_c/Δ")
            .legend(move |(x, y)| DashedPathElement::new([(x, y), (x + 26, y)], 6, 4, style));
    }
    legend(&mut chart, plotters::chart::SeriesLabelPosition::Coordinate(470, 225), 12, 34)
}
