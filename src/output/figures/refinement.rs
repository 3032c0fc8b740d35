//! Figure of errors over mesh refinement.

use std::io;

use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Area, BLUE, Drawn, GREEN, GREY, ORANGE, document, quiet};

/// Errors of one quantity.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Title of the panel.
    pub title: &'static str,
    /// Curves, one per kind of mesh.
    pub curves: Vec<Curve>,
}

/// Errors of meshes of one kind.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Index of the group, which decides the colour.
    pub group: usize,
    /// Whether the marks are triangles; otherwise they are circles.
    pub triangle: bool,
    /// Whether the curve is dashed.
    pub dashed: bool,
    /// Pairs of the number of cells and the relative error.
    pub errors: Vec<(f64, f64)>,
}

const WIDTH: u32 = 900;
const LEGEND: u32 = 60;
const PANEL: u32 = 270;
const COLUMNS: usize = 2;
const COLOURS: [RGBColor; 4] = [GREY, BLUE, ORANGE, GREEN];
/// Largest relative error on the axis.
const LARGEST: f64 = 1.0;
/// Step of the ends of the axis.
const STEP: f64 = 0.25;

/// Draws errors of several quantities over refinement, a panel each with the same scale, as an SVG document. `groups`
/// are the names of the colours, at most four.
///
/// # Errors
/// If the plotting library cannot draw it.
pub fn refinement(groups: &[&str], panels: &[Panel]) -> io::Result<String> {
    let rows = panels.len().div_ceil(COLUMNS);
    document((WIDTH, LEGEND + PANEL * rows as u32), |root| draw(root, groups, panels))
}

fn draw(root: &Area, groups: &[&str], panels: &[Panel]) -> Drawn {
    let (above, rest) = root.split_vertically(LEGEND);
    let line = |x: i32, y: i32| [(x, y), (x + 30, y)];
    let place = |i: usize| 80 + 205 * i as i32;
    for (i, name) in groups.iter().enumerate() {
        above.draw(&PathElement::new(line(place(i), 18), colour(i).stroke_width(3)))?;
        write(&above, (place(i) + 38, 18), name)?;
    }
    above.draw(&circle((place(0) + 15, 42), GREY))?;
    write(&above, (place(0) + 38, 42), "exact or Van Gelder")?;
    above.draw(&triangle((place(1) + 15, 42), GREY))?;
    write(&above, (place(1) + 38, 42), "Lloyd")?;
    above.draw(&DashedPathElement::new(line(place(2), 42), 6, 4, GREY.stroke_width(2)))?;
    write(&above, (place(2) + 38, 42), "nodes moved at random")?;

    let points = || panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| curve.errors.iter().copied());
    let outwards = |of: fn(f64, f64) -> f64, value: fn((f64, f64)) -> f64| points().map(value).fold(0.0, of);
    let bottom = (outwards(f64::min, |p| p.1).max(-LARGEST) / STEP).floor() * STEP;
    let top = (outwards(f64::max, |p| p.1).min(LARGEST) / STEP).ceil() * STEP;
    let (left, right) = (points().map(|p| p.0).fold(f64::INFINITY, f64::min), outwards(f64::max, |p| p.0));
    // Give the axis a width even if there are no points, or points of one size only.
    let x = if left < right { left - 0.5..right + 0.5 } else { right - 1.0..right + 1.0 };
    let y = if bottom < top { bottom - 0.05..top + 0.05 } else { -STEP..STEP };
    for (area, panel) in rest.split_evenly((panels.len().div_ceil(COLUMNS), COLUMNS)).iter().zip(panels) {
        let mut chart = ChartBuilder::on(area)
            .caption(panel.title, ("sans-serif", 16))
            .margin(8)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d(x.clone(), y.clone())?;
        quiet(
            chart
                .configure_mesh()
                .x_desc("cells along the side")
                .y_desc("error")
                .x_labels(6)
                .x_label_formatter(&|cells| if cells.fract() == 0.0 { format!("{cells}") } else { String::new() })
                .y_label_formatter(&|error| format!("{:+} %", (100.0 * error).round() + 0.0))
                .max_light_lines(0),
        )
        .draw()?;
        chart.draw_series([PathElement::new([(x.start, 0.0), (x.end, 0.0)], BLACK.mix(0.5).stroke_width(1))])?;
        for curve in &panel.curves {
            let colour = colour(curve.group);
            let points = curve.errors.iter().map(|&(cells, error)| (cells, error.clamp(y.start, y.end)));
            let style = colour.stroke_width(2);
            if curve.dashed {
                chart.draw_series(DashedLineSeries::new(points.clone(), 6, 4, style))?;
            } else {
                chart.draw_series(LineSeries::new(points.clone(), style))?;
            }
            if curve.triangle {
                chart.draw_series(points.map(|at| triangle(at, colour)))?;
            } else {
                chart.draw_series(points.map(|at| circle(at, colour)))?;
            }
        }
    }
    Ok(())
}

fn colour(group: usize) -> RGBColor {
    COLOURS[group % COLOURS.len()]
}

fn circle<Place>(at: Place, colour: RGBColor) -> Circle<Place, i32> {
    Circle::new(at, 4, colour.filled())
}

fn triangle<Place>(at: Place, colour: RGBColor) -> TriangleMarker<Place, i32> {
    TriangleMarker::new(at, 6, colour.filled())
}

fn write(area: &Area, at: (i32, i32), text: &str) -> Drawn {
    let style = ("sans-serif", 14).into_font().color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center));
    Ok(area.draw_text(text, &style, at)?)
}
