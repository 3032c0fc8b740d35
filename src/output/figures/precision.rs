//! Figures of an accuracy report: force error against cost, and forces of several methods.

use std::io;

use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Area, BLUE, Drawn, GREEN, GREY, ORANGE, document, legend, quiet};
use super::forces::thinned;
use crate::output::summary::Sample;

const SIZE: (u32, u32) = (900, 520);
const COLOURS: [RGBColor; 4] = [BLUE, GREEN, ORANGE, GREY];
/// Smallest relative error on the axis.
const LOWEST: f64 = 1e-5;
/// Place on the axis of errors for methods that diverged.
const HIGHEST: f64 = 3.0;

/// A method's mark in [`precision`].
#[derive(Debug, Clone)]
pub struct Mark {
    /// Cost on the axis; none is drawn on the left edge.
    pub cost: Option<f64>,
    /// Relative force error.
    pub error: f64,
    /// Index of the group, which decides the colour.
    pub group: usize,
    /// Whether the mark is a triangle; otherwise it is a circle.
    pub triangle: bool,
    /// Whether the mark is hollow, as the method is over budget.
    pub hollow: bool,
    /// Whether the method diverged; its mark is then at the upper edge.
    pub diverged: bool,
    /// Whether the method is on the Pareto front.
    pub on_front: bool,
    /// Label beside the mark.
    pub label: Option<String>,
}

/// Contents of a figure of error against cost.
#[derive(Debug, Clone)]
pub struct Precision<'a> {
    /// Title of the figure.
    pub title: &'a str,
    /// Label of the cost axis.
    pub cost: &'a str,
    /// Names of the groups, at most four.
    pub groups: &'a [&'a str],
    /// Marks of the methods.
    pub marks: &'a [Mark],
    /// Budget, in the unit of the costs.
    pub budget: f64,
    /// Relative error below which the reference resolves nothing.
    pub floor: f64,
    /// Relative error below which a hand perceives nothing.
    pub perception: f64,
}

/// Draws error against cost on logarithmic axes, as an SVG document. Methods that diverged are at the upper edge, errors
/// too small for the axis at the lower one.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::output::figures::precision::{Mark, Precision, precision};
///
/// let mark = |cost, error, label: &str| Mark {
///     cost: Some(cost),
///     error,
///     group: 0,
///     triangle: false,
///     hollow: cost > 1000.0,
///     diverged: false,
///     on_front: true,
///     label: Some(label.to_owned()),
/// };
/// // Rings around the contact: each costs more and leaves less error.
/// let marks = [mark(10.0, 0.3, "1 ring"), mark(50.0, 0.1, "2 rings"), mark(2000.0, 0.001, "all rings")];
/// let (title, cost, groups) = ("deep sticking", "µs a tick", &["fixed"][..]);
/// let figure = Precision { title, cost, groups, marks: &marks, budget: 1000.0, floor: 1e-4, perception: 0.1 };
/// let svg = precision(&figure)?;
/// assert!(["1 ring", "2 rings", "all rings"].iter().all(|name| svg.contains(name)));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn precision(figure: &Precision) -> io::Result<String> {
    document(SIZE, |root| draw_precision(root, figure))
}

/// Draws normal (solid) and tangential (dotted) force of several runs over time, as an SVG document.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::{output::figures::precision::compared_forces, output::summary::Recorder};
/// use stickslip::local::{model::LocalSettings, patch::Extent};
/// use stickslip::{pipeline, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let mut recorders = [1, 2].map(|rings| (rings, Recorder::default()));
/// for (rings, recorder) in &mut recorders {
///     let local = LocalSettings { extent: Extent::Rings(*rings), ..scene.local() };
///     pipeline::run(&scene.clone().with_local_model(local), |tick| recorder.record(tick))?;
/// }
/// let [one, two] = recorders.each_ref().map(|(_, recorder)| recorder.samples());
/// assert!(two[149].normal_force < one[149].normal_force); // more of the block gives way
/// let svg = compared_forces("fig3-sliding", &[("one ring", one), ("two rings", two)])?;
/// assert!(svg.contains("one ring") && svg.contains("two rings"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn compared_forces(title: &str, runs: &[(&str, &[Sample])]) -> io::Result<String> {
    document(SIZE, |root| draw_forces(root, title, runs))
}

fn draw_precision(root: &Area, figure: &Precision) -> Drawn {
    let costs = || figure.marks.iter().filter_map(|mark| mark.cost).chain([figure.budget]);
    let left = costs().filter(|&cost| cost > 0.0).fold(f64::INFINITY, f64::min) / 2.0;
    let right = costs().fold(0.0, f64::max) * 2.0;
    let errors = figure.marks.iter().map(|mark| mark.error).chain([figure.floor, figure.perception]);
    let bottom = errors.filter(|&error| error > 0.0).fold(1.0, f64::min).max(LOWEST) / 2.0;
    let top = 2.0 * HIGHEST;
    let mut chart = ChartBuilder::on(root)
        .caption(figure.title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(70)
        .build_cartesian_2d((left..right).log_scale(), (bottom..top).log_scale())?;
    let floor = figure.floor.clamp(bottom, top);
    chart.draw_series([Rectangle::new([(left, bottom), (right, floor)], BLACK.mix(0.06).filled())])?;
    quiet(
        chart
            .configure_mesh()
            .x_desc(figure.cost)
            .y_desc("force error, relative RMS")
            .x_label_formatter(&|value| format!("{value}"))
            .y_label_formatter(&|value| format!("{} %", 100.0 * (value * 1e9).round() / 1e9)),
    )
    .draw()?;

    let rule = BLACK.mix(0.6).stroke_width(1);
    let across = |error: f64| [(left, error), (right, error)];
    chart.draw_series([
        DashedPathElement::new(across(figure.perception), 6, 4, rule),
        DashedPathElement::new(across(floor), 1, 3, rule),
        DashedPathElement::new([(figure.budget, bottom), (figure.budget, top)], 6, 4, rule),
    ])?;
    chart.draw_series([PathElement::new(across(HIGHEST), RED.mix(0.4))])?;

    let place = |mark: &Mark| {
        let error = if mark.diverged { HIGHEST } else { mark.error.clamp(bottom, 1.0) };
        (mark.cost.unwrap_or(left).clamp(left, right), error)
    };
    let mut front: Vec<(f64, f64)> = figure.marks.iter().filter(|mark| mark.on_front).map(place).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    // A method is the most accurate one from its own cost to the cost of the next.
    let steps = front.iter().zip(front.iter().skip(1).map(|next| next.0).chain([right]));
    let steps: Vec<(f64, f64)> = steps.flat_map(|(&(cost, error), next)| [(cost, error), (next, error)]).collect();
    chart.draw_series([PathElement::new(steps, BLACK.mix(0.35).stroke_width(2))])?;

    for (k, name) in figure.groups.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let of_group = || figure.marks.iter().filter(move |mark| mark.group == k);
        let style = |mark: &Mark| if mark.hollow { colour.stroke_width(1) } else { colour.mix(0.8).filled() };
        let circles = of_group().filter(|mark| !mark.triangle && !mark.diverged);
        let circles = circles.map(|mark| Circle::new(place(mark), if mark.on_front { 6 } else { 4 }, style(mark)));
        chart.draw_series(circles)?.label(*name).legend(move |(x, y)| Circle::new((x + 10, y), 5, colour.filled()));
        let triangles = of_group().filter(|mark| mark.triangle && !mark.diverged);
        chart.draw_series(triangles.map(|mark| {
            let (half, style) = (if mark.on_front { 7 } else { 5 }, style(mark));
            let corners = vec![(-half, half - 1), (half, half - 1), (0, -half), (-half, half - 1)];
            // A polygon is always filled, and a path never.
            let outline = PathElement::new(corners.clone(), colour.stroke_width(1));
            let inside = Polygon::new(if mark.hollow { Vec::new() } else { corners }, style);
            EmptyElement::at(place(mark)) + outline + inside
        }))?;
        let diverged = of_group().filter(|mark| mark.diverged);
        chart.draw_series(diverged.map(|mark| Cross::new(place(mark), 5, colour.stroke_width(2))))?;
    }
    legend(&mut chart, SeriesLabelPosition::LowerLeft, 12, 30)?;

    let write =
        |(x, y): (i32, i32), text: &str, h: HPos, v: VPos| -> Drawn { text_at(root, (x, y), text, Pos::new(h, v)) };
    let at = |point: (f64, f64)| chart.backend_coord(&point);
    let beside = |(x, y): (i32, i32), dx: i32, dy: i32| (x + dx, y + dy);
    write(beside(at((right, figure.perception)), -4, -2), "10 %: perception threshold", HPos::Right, VPos::Bottom)?;
    write(beside(at((right, floor)), -4, 3), "below: not resolved by the reference", HPos::Right, VPos::Top)?;
    write(beside(at((right, HIGHEST)), -4, -2), "diverged", HPos::Right, VPos::Bottom)?;
    write(beside(at((figure.budget, bottom)), 4, -4), "budget", HPos::Left, VPos::Bottom)?;
    for mark in figure.marks {
        if let Some(label) = &mark.label {
            write(beside(at(place(mark)), -10, 0), label, HPos::Right, VPos::Center)?;
        }
    }
    Ok(())
}

fn text_at(root: &Area, at: (i32, i32), text: &str, pos: Pos) -> Drawn {
    root.draw_text(text, &("sans-serif", 13).into_font().color(&BLACK).pos(pos), at)?;
    Ok(())
}

fn draw_forces(root: &Area, title: &str, runs: &[(&str, &[Sample])]) -> Drawn {
    let end = runs.iter().filter_map(|(_, samples)| samples.last()).map(|last| last.time).fold(0.0, f64::max);
    // The first run, the reference, scales the axis: a run that diverges leaves the figure.
    let reference = runs.first().map_or(&[][..], |(_, samples)| samples);
    let top = reference.iter().map(|s| s.normal_force.max(s.tangential_force)).fold(0.0, f64::max);
    let top = if top > 0.0 { 1.5 * top } else { 1.0 };
    let mut chart = ChartBuilder::on(root)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(58)
        .build_cartesian_2d(0.0..if end > 0.0 { end } else { 1.0 }, 0.0..top)?;
    quiet(chart.configure_mesh().x_desc("time (s)").y_desc("force on the instrument (N)")).draw()?;
    let colours = [BLACK, COLOURS[0], COLOURS[2], COLOURS[1]];
    for ((name, samples), colour) in runs.iter().zip(colours) {
        let style = colour.mix(0.85).stroke_width(2);
        let curve = |of: fn(&Sample) -> f64| {
            let mut curve = thinned(samples, of);
            curve.iter_mut().for_each(|point| point.1 = point.1.clamp(0.0, top));
            curve
        };
        chart
            .draw_series(LineSeries::new(curve(|s| s.normal_force), style))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 26, y)], style));
        chart.draw_series(DashedLineSeries::new(curve(|s| s.tangential_force), 2, 4, style))?;
    }
    legend(&mut chart, SeriesLabelPosition::UpperLeft, 14, 34)?;
    Ok(())
}
