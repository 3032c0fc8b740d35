//! Common parts of all figures: document, axes and legend.

use std::io;

use plotters::chart::{ChartContext, MeshStyle, SeriesLabelPosition};
use plotters::coord::CoordTranslate;
use plotters::coord::ranged1d::Ranged;
use plotters::prelude::*;

pub(super) type Drawn = Result<(), Box<dyn std::error::Error>>;
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

pub(super) const BLUE: RGBColor = RGBColor(24, 90, 157);
pub(super) const ORANGE: RGBColor = RGBColor(200, 80, 30);
pub(super) const GREEN: RGBColor = RGBColor(90, 140, 60);
pub(super) const GREY: RGBColor = RGBColor(120, 120, 120);

/// Draws on a white ground and returns the SVG document.
pub(super) fn document(size: (u32, u32), draw: impl FnOnce(&Area) -> Drawn) -> io::Result<String> {
    let mut svg = String::new();
    let drawn = || -> Drawn {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        draw(&root)?;
        Ok(root.present()?)
    };
    drawn().map_err(|error| io::Error::other(error.to_string()))?;
    Ok(svg)
}

/// Styles grid lines and labels so that they stay in the background.
pub(super) fn quiet<'m, 'a, 'b, X: Ranged, Y: Ranged, B: DrawingBackend>(
    mesh: &'m mut MeshStyle<'a, 'b, X, Y, B>,
) -> &'m mut MeshStyle<'a, 'b, X, Y, B> {
    mesh.light_line_style(BLACK.mix(0.04)).bold_line_style(BLACK.mix(0.12)).label_style(("sans-serif", 14))
}

/// Draws the legend, `margin` pixels from the edge of the chart, with sample lines of `line` pixels.
pub(super) fn legend<'a, 'svg: 'a, C: CoordTranslate>(
    chart: &mut ChartContext<'a, SVGBackend<'svg>, C>,
    position: SeriesLabelPosition,
    margin: i32,
    line: i32,
) -> Drawn {
    chart
        .configure_series_labels()
        .position(position)
        .margin(margin)
        .legend_area_size(line)
        .border_style(BLACK.mix(0.2))
        .background_style(WHITE.mix(0.8))
        .label_font(("sans-serif", 14))
        .draw()?;
    Ok(())
}
