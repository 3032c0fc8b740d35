//! Figures of the longest stable step.

use std::io;

use plotters::prelude::*;

/// A predicted boundary and its measurement.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Its name.
    pub name: String,
    /// What is varied, the predicted and the measured step, s.
    pub points: Vec<[f64; 3]>,
}

const SIZE: (u32, u32) = (900, 560);
/// Height of the upper part.
const SPLIT: i32 = 390;
const COLOURS: [RGBColor; 6] = [
    RGBColor(24, 90, 157),
    RGBColor(200, 80, 30),
    RGBColor(90, 140, 60),
    RGBColor(120, 70, 150),
    RGBColor(160, 130, 30),
    RGBColor(90, 90, 90),
];

/// Predicted (lines) and measured (marks) boundaries over what is varied, and below their ratio, as an SVG
/// document. Steps are on a logarithmic scale, and so is what is varied, if it is `logarithmic`.
///
/// # Errors
/// If the plotting library cannot draw it.
pub fn limits(varied: &str, logarithmic: bool, curves: &[Curve]) -> io::Result<String> {
    let mut svg = String::new();
    draw(&mut svg, varied, logarithmic, curves).map_err(|error| io::Error::other(error.to_string()))?;
    Ok(svg)
}

fn draw(svg: &mut String, varied: &str, logarithmic: bool, curves: &[Curve]) -> Result<(), Box<dyn std::error::Error>> {
    // Logarithms are drawn on linear axes, so that both kinds of axis are of one type.
    let place = |value: f64| if logarithmic { value.log10() } else { value };
    let label = |place: &f64| if logarithmic { format!("1e{place:.0}") } else { format!("{place}") };
    let points = || curves.iter().flat_map(|curve| &curve.points).filter(|point| point[1] > 0.0 && point[2] > 0.0);
    let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut bottom, mut top) = (f64::INFINITY, f64::NEG_INFINITY);
    for &[value, predicted, measured] in points() {
        (left, right) = (left.min(place(value)), right.max(place(value)));
        for step in [predicted, measured] {
            (bottom, top) = (bottom.min(step.log10().floor()), top.max(step.log10().ceil()));
        }
    }
    if !(left < right && bottom < top) {
        (left, right, bottom, top) = (0.0, 1.0, -4.0, -1.0);
    }
    let margin = 0.03 * (right - left);
    let x = left - margin..right + margin;

    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let (upper, lower) = root.split_vertically(SPLIT);
    let mut chart = ChartBuilder::on(&upper)
        .margin(12)
        .x_label_area_size(24)
        .y_label_area_size(72)
        .build_cartesian_2d(x.clone(), bottom..top)?;
    chart
        .configure_mesh()
        .y_desc("longest stable step (s)")
        .x_labels(9)
        .y_labels((top - bottom) as usize + 1)
        .x_label_formatter(&label)
        .y_label_formatter(&|step| format!("1e{step:.0}"))
        .light_line_style(BLACK.mix(0.0))
        .bold_line_style(BLACK.mix(0.12))
        .label_style(("sans-serif", 14))
        .draw()?;
    for (i, curve) in curves.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let line = curve.points.iter().filter(|p| p[1] > 0.0).map(|p| (place(p[0]), p[1].log10()));
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(2)));
        // Marks of different sizes, because curves may lie on each other.
        let marks = curve.points.iter().filter(|p| p[2] > 0.0);
        chart.draw_series(marks.map(|p| Circle::new((place(p[0]), p[2].log10()), 3 + 2 * i as i32, colour)))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerLeft)
        .margin(12)
        .legend_area_size(32)
        .border_style(BLACK.mix(0.2))
        .background_style(WHITE.mix(0.8))
        .label_font(("sans-serif", 14))
        .draw()?;

    let mut chart = ChartBuilder::on(&lower)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(72)
        .build_cartesian_2d(x.clone(), 0.95..1.05)?;
    chart
        .configure_mesh()
        .x_desc(varied)
        .y_desc("ratio")
        .x_labels(9)
        .y_labels(5)
        .x_label_formatter(&label)
        .y_label_formatter(&|ratio| format!("{ratio:.2}"))
        .light_line_style(BLACK.mix(0.0))
        .bold_line_style(BLACK.mix(0.12))
        .label_style(("sans-serif", 14))
        .draw()?;
    chart.draw_series([Rectangle::new([(x.start, 0.98), (x.end, 1.02)], BLACK.mix(0.06).filled())])?;
    for (i, curve) in curves.iter().enumerate() {
        let marks = curve.points.iter().filter(|p| p[1] > 0.0);
        let of = |p: &[f64; 3]| {
            Circle::new((place(p[0]), (p[2] / p[1]).clamp(0.95, 1.05)), 3 + 2 * i as i32, COLOURS[i % COLOURS.len()])
        };
        chart.draw_series(marks.map(of))?;
    }
    root.present()?;
    Ok(())
}
