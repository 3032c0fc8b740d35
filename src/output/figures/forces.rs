//! Figures of force over time, as in the paper's Figures 3–5, and of force jumps by contact surface.

use std::io;

use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Area, BLUE, Drawn, GREEN, ORANGE, document, legend, quiet};
use crate::output::summary::Sample;

const SIZE: (u32, u32) = (900, 420);
const NORMAL: RGBColor = BLUE;
const TANGENTIAL: RGBColor = ORANGE;
/// Buckets per curve: more than the figure's columns of pixels.
const BUCKETS: usize = 2000;

/// Draws normal (solid) and tangential (dotted) force over time, as an SVG document.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::{output::figures::forces::forces, output::summary::Recorder};
/// use stickslip::{pipeline, scene::Scene};
///
/// // The tip meets the block after 80 ticks.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let mut recorder = Recorder::default();
/// pipeline::run(&scene, |tick| recorder.record(tick))?;
/// let svg = forces(&scene.name, recorder.samples())?;
/// assert!(svg.starts_with("<svg") && svg.contains("fig3-sliding"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn forces(title: &str, samples: &[Sample]) -> io::Result<String> {
    document(SIZE, |root| draw(root, title, samples))
}

/// A mark of [`jumps`].
#[derive(Debug, Clone, Copy)]
pub struct Jump {
    /// Index of its column.
    pub column: usize,
    /// Index of its series.
    pub series: usize,
    /// Whether the mark is hollow.
    pub hollow: bool,
    /// Largest force jump over the mean force.
    pub relative: f64,
}

/// Draws the largest force jump between two ticks over the mean force on a logarithmic scale, as an SVG document with a
/// column per combination of surface and scheme, and a colour per law.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::output::figures::forces::{Jump, jumps};
///
/// let columns = ["faceted".to_owned(), "smooth".to_owned()];
/// let mark = |column, relative| Jump { column, series: 0, hollow: false, relative };
/// let svg = jumps(&columns, &["sliding"], &[mark(0, 0.2), mark(1, 0.01)])?;
/// // A hundredth is below a fifth; in a drawing that is a larger y. The first circle is the legend's or a mark's.
/// let heights: Vec<i32> = svg.split("<circle ").skip(1).filter_map(|mark| mark.split("cy=\"").nth(1)?.split('"').next()?.parse().ok()).collect();
/// assert!(heights.windows(2).any(|pair| pair[1] > pair[0] + 50));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn jumps(columns: &[String], series: &[&str], marks: &[Jump]) -> io::Result<String> {
    document(SIZE, |root| draw_jumps(root, columns, series, marks))
}

fn draw_jumps(root: &Area, columns: &[String], series: &[&str], marks: &[Jump]) -> Drawn {
    const COLOURS: [RGBColor; 3] = [NORMAL, GREEN, TANGENTIAL];
    let right = columns.len() as f64;
    let mut chart = ChartBuilder::on(root)
        .caption("largest change of force between two ticks over the mean force", ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(0.0..right, (1e-4..1e2).log_scale())?;
    quiet(
        chart
            .configure_mesh()
            .disable_x_mesh()
            // Axis labels are at whole numbers; the names of the columns go between them.
            .x_labels(0)
            .y_label_formatter(&|value| format!("{value:e}")),
    )
    .draw()?;
    for (i, column) in columns.iter().enumerate() {
        let style = ("sans-serif", 13).into_font().color(&BLACK).pos(Pos::new(HPos::Center, VPos::Top));
        for (line, text) in column.split(' ').enumerate() {
            let (x, y) = chart.backend_coord(&(i as f64 + 0.5, 1e-4));
            root.draw_text(text, &style, (x, y + 6 + 15 * line as i32))?;
        }
    }
    for (k, name) in series.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let of_series = marks.iter().filter(|mark| mark.series == k && mark.relative > 0.0);
        let drawn = of_series.map(|mark| {
            let x = mark.column as f64 + 0.3 + 0.2 * k as f64 + if mark.hollow { 0.08 } else { 0.0 };
            let style = if mark.hollow { colour.stroke_width(2) } else { colour.filled() };
            Circle::new((x, mark.relative.clamp(1e-4, 1e2)), 5, style)
        });
        chart.draw_series(drawn)?.label(*name).legend(move |(x, y)| Circle::new((x + 12, y), 5, colour.filled()));
    }
    legend(&mut chart, SeriesLabelPosition::UpperRight, 10, 30)?;
    Ok(())
}

fn draw(root: &Area, title: &str, samples: &[Sample]) -> Drawn {
    let end = samples.last().map_or(1.0, |sample| sample.time);
    let top = samples.iter().map(|s| s.normal_force.max(s.tangential_force)).fold(0.0, f64::max);
    let mut chart = ChartBuilder::on(root)
        .caption(title, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(58)
        .build_cartesian_2d(0.0..end, 0.0..if top > 0.0 { 1.2 * top } else { 1.0 })?;
    quiet(chart.configure_mesh().x_desc("time (s)").y_desc("force on the instrument (N)")).draw()?;
    let curve = |of: fn(&Sample) -> f64| thinned(samples, of);
    let normal = ShapeStyle::from(NORMAL).stroke_width(2);
    let tangential = ShapeStyle::from(TANGENTIAL).stroke_width(2);
    chart
        .draw_series(LineSeries::new(curve(|s| s.normal_force), normal))?
        .label("normal")
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 26, y)], normal));
    chart
        .draw_series(DashedLineSeries::new(curve(|s| s.tangential_force), 2, 4, tangential))?
        .label("tangential")
        .legend(move |(x, y)| DashedPathElement::new(vec![(x, y), (x + 26, y)], 2, 4, tangential));
    legend(&mut chart, SeriesLabelPosition::UpperLeft, 14, 34)?;
    Ok(())
}

/// Returns a curve with the smallest and the largest value of every bucket, so that no jump of a single tick is lost.
pub(super) fn thinned(samples: &[Sample], of: fn(&Sample) -> f64) -> Vec<(f64, f64)> {
    let bucket = samples.len().div_ceil(BUCKETS).max(1);
    if bucket == 1 {
        return samples.iter().map(|sample| (sample.time, of(sample))).collect();
    }
    let by_value = |a: &&Sample, b: &&Sample| of(a).total_cmp(&of(b));
    let ends = samples.chunks(bucket).flat_map(|samples| {
        let mut ends = [samples.iter().min_by(by_value), samples.iter().max_by(by_value)];
        ends.sort_by(|a, b| a.map(|s| s.time).partial_cmp(&b.map(|s| s.time)).unwrap_or(std::cmp::Ordering::Equal));
        ends.into_iter().flatten()
    });
    ends.map(|sample| (sample.time, of(sample))).collect()
}
