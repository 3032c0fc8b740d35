//! Figures of the servo loop's response times.

use std::io;

use plotters::chart::ChartContext;
use plotters::coord::ranged1d::Ranged;
use plotters::prelude::*;

use super::axes::{Area, BLUE, Drawn, GREY, document, legend, quiet};

const SIZE: (u32, u32) = (900, 420);
const DEADLINE: RGBColor = RGBColor(200, 60, 40);
/// Shortest time drawn, µs.
const SHORTEST_US: f64 = 0.1;

/// Responses in an interval of a run.
#[derive(Debug, Clone, Copy)]
pub struct Interval {
    /// Start of the interval, s.
    pub time_s: f64,
    /// Longest and mean response, µs.
    pub response_us: [f64; 2],
    /// Longest response of the control loop without a payload, µs; 0 if it was not run.
    pub control_us: f64,
}

/// Draws responses over time on a logarithmic scale, with the deadline, as an SVG document.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::output::figures::latency::{Interval, over_time};
///
/// let interval = |time_s| Interval { time_s, response_us: [80.0, 20.0], control_us: 0.0 };
/// let mut intervals = [0.0, 1.0, 2.0].map(interval);
/// assert!(!over_time(&intervals, 1e3)?.contains("without a payload")); // it was not run
/// intervals[1].control_us = 5.0;
/// assert!(over_time(&intervals, 1e3)?.contains("without a payload"));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn over_time(intervals: &[Interval], deadline_us: f64) -> io::Result<String> {
    document(SIZE, |area| draw_over_time(area, intervals, deadline_us))
}

/// Draws the share of ticks whose response is longer than a given time (µs), for the servo loop and for the control
/// loop without a payload, on logarithmic scales, with the deadline, as an SVG document.
///
/// # Errors
/// If the plotting library cannot draw it.
///
/// ```
/// use stickslip::output::figures::latency::tails;
///
/// // Of ten thousand ticks one took longer than 400 µs, and none longer than 600 µs.
/// let servo = [(50.0, 0.5), (400.0, 1e-4), (600.0, 0.0)];
/// let svg = tails(&servo, &[], 1e3)?;
/// assert!(svg.contains("share of ticks with a longer response") && !svg.contains("without a payload"));
/// // The control loop is drawn where it was run.
/// assert!(tails(&servo, &[(5.0, 0.1), (20.0, 1e-4)], 1e3)?.contains("without a payload"));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn tails(servo: &[(f64, f64)], control: &[(f64, f64)], deadline_us: f64) -> io::Result<String> {
    document(SIZE, |area| draw_tails(area, servo, control, deadline_us))
}

/// Draws a line and names it in the legend.
fn named<'a, 'svg: 'a, X: Ranged<ValueType = f64>, Y: Ranged<ValueType = f64>>(
    chart: &mut ChartContext<'a, SVGBackend<'svg>, Cartesian2d<X, Y>>,
    points: Vec<(f64, f64)>,
    style: ShapeStyle,
    name: &str,
) -> Drawn {
    chart
        .draw_series(LineSeries::new(points, style))?
        .label(name)
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
    Ok(())
}

fn decades(values: impl Iterator<Item = f64>, deadline_us: f64) -> (f64, f64) {
    let (mut bottom, mut top) = (deadline_us, deadline_us);
    for value in values.filter(|value| *value > SHORTEST_US && value.is_finite()) {
        (bottom, top) = (bottom.min(value), top.max(value));
    }
    (10_f64.powf(bottom.log10().floor()), 10_f64.powf((top * 1.05).log10().ceil()))
}

fn draw_over_time(area: &Area, intervals: &[Interval], deadline_us: f64) -> Drawn {
    let values =
        intervals.iter().flat_map(|interval| [interval.response_us[0], interval.response_us[1], interval.control_us]);
    let (bottom, top) = decades(values, deadline_us);
    let end = intervals.last().map_or(1.0, |interval| interval.time_s).max(1e-3);
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(72)
        .build_cartesian_2d(0.0..end, (bottom..top).log_scale())?;
    quiet(&mut chart.configure_mesh())
        .x_desc("time (s)")
        .y_desc("response (µs)")
        .y_label_formatter(&|us| format!("{us}"))
        .draw()?;
    let line = |of: fn(&Interval) -> f64| {
        intervals.iter().map(move |s| (s.time_s, of(s))).filter(|(_, us)| *us > SHORTEST_US).collect::<Vec<_>>()
    };
    let control = line(|s| s.control_us);
    if !control.is_empty() {
        named(&mut chart, control, GREY.stroke_width(1), "longest, control loop without a payload")?;
    }
    named(&mut chart, line(|s| s.response_us[0]), BLUE.stroke_width(1), "longest in the interval")?;
    named(&mut chart, line(|s| s.response_us[1]), BLUE.mix(0.5).stroke_width(2), "mean of the interval")?;
    named(&mut chart, vec![(0.0, deadline_us), (end, deadline_us)], DEADLINE.stroke_width(2), "deadline")?;
    legend(&mut chart, SeriesLabelPosition::UpperLeft, 10, 24)
}

fn draw_tails(area: &Area, servo: &[(f64, f64)], control: &[(f64, f64)], deadline_us: f64) -> Drawn {
    let (left, right) = decades(servo.iter().chain(control).map(|point| point.0), deadline_us);
    let rarest = servo.iter().chain(control).map(|point| point.1).filter(|share| *share > 0.0).fold(0.1, f64::min);
    let bottom = 10_f64.powf(rarest.log10().floor());
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(72)
        .build_cartesian_2d((left..right).log_scale(), (bottom..1.0).log_scale())?;
    quiet(&mut chart.configure_mesh())
        .x_desc("response (µs)")
        .y_desc("share of ticks with a longer response")
        .x_label_formatter(&|us| format!("{us}"))
        .y_label_formatter(&|share| format!("{share:.0e}"))
        .draw()?;
    let drawn = |points: &[(f64, f64)]| points.iter().copied().filter(|(us, _)| *us > SHORTEST_US).collect::<Vec<_>>();
    if !control.is_empty() {
        named(&mut chart, drawn(control), GREY.stroke_width(2), "control loop without a payload")?;
    }
    named(&mut chart, drawn(servo), BLUE.stroke_width(2), "servo loop")?;
    named(&mut chart, vec![(deadline_us, bottom), (deadline_us, 1.0)], DEADLINE.stroke_width(2), "deadline")?;
    legend(&mut chart, SeriesLabelPosition::LowerLeft, 10, 24)
}
