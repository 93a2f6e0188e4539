//! Plots as SVG text.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::labels::{Rect, place};
use crate::error::Result;
use crate::measure::report::not_written;

/// Width and height of a plot, its own pixels; the page scales it.
const SIZE: (u32, u32) = (1080, 640);
const FONT_PX: f64 = 13.0;
/// What plotters writes for a font of a size: its sizes are heights of lines.
const LINE_PER_FONT: f64 = 1.24;
const MARKER_RADIUS_PX: u32 = 5;

const INK: RGBColor = RGBColor(0x2b, 0x2f, 0x36);
const FAINT: RGBColor = RGBColor(0x9a, 0xa1, 0xab);
const GRID: RGBColor = RGBColor(0xe6, 0xe8, 0xec);

/// Colours that are told apart by most eyes (after Okabe and Ito), darkened for white paper.
const PALETTE: [RGBColor; 10] = [
    RGBColor(0x2b, 0x2f, 0x36),
    RGBColor(0xb3, 0x3c, 0x2e),
    RGBColor(0x1f, 0x6f, 0xb2),
    RGBColor(0x1b, 0x8a, 0x62),
    RGBColor(0xc7, 0x7d, 0x0a),
    RGBColor(0xa2, 0x4b, 0x8f),
    RGBColor(0x3f, 0x9f, 0xc4),
    RGBColor(0x7a, 0x6a, 0x4f),
    RGBColor(0x6b, 0x72, 0x7d),
    RGBColor(0x7d, 0x92, 0x1f),
];

/// The colour of the n-th group.
pub(super) fn group_colour(n: usize) -> String {
    let RGBColor(r, g, b) = palette(n);
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn palette(n: usize) -> RGBColor {
    PALETTE[n % PALETTE.len()]
}

/// A point of the speed-accuracy plot.
pub(super) struct Point<'a> {
    pub(super) time_ms: f64,
    pub(super) error: f64,
    pub(super) label: &'a str,
    /// Number of its group, for colour.
    pub(super) group: usize,
    pub(super) on_front: bool,
    /// Drawn as a ring: its error is a choice.
    pub(super) changes_signal: bool,
}

/// Time against error on logarithmic axes; the points of the front are joined.
///
/// Errors of 0 lie on the lower edge.
pub(super) fn speed_accuracy(points: &[Point<'_>], error_name: &str) -> Result<String> {
    let mut svg = String::new();
    draw(&mut svg, points, error_name).map_err(|e| not_written("report.html", &e))?;
    Ok(svg)
}

fn draw(
    svg: &mut String,
    points: &[Point<'_>],
    error_name: &str,
) -> std::result::Result<(), Box<dyn std::error::Error>> {
    let times = Axis::over(points.iter().map(|p| p.time_ms), 0.12);
    let errors = Axis::over(points.iter().map(|p| p.error), 0.12);
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    let mut chart = ChartBuilder::on(&root)
        .margin(8)
        .margin_right(16)
        .x_label_area_size(52)
        .y_label_area_size(74)
        .build_cartesian_2d(times, errors)?;
    let text = font(12.5).color(&INK);
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID)
        .axis_style(FAINT)
        .label_style(text.clone())
        .axis_desc_style(font(13.5).color(&INK))
        .x_label_formatter(&|x| decimal(10_f64.powf(*x)))
        .y_label_formatter(&|y| scientific(10_f64.powf(*y)))
        .x_desc("frame time, ms (logarithmic)")
        .y_desc(format!("{error_name} (logarithmic)"))
        .draw()?;

    let at = |p: &Point<'_>| (times.place(p.time_ms), errors.place(p.error));
    let mut front: Vec<_> = points.iter().filter(|p| p.on_front).map(at).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    chart.draw_series(LineSeries::new(
        front.iter().copied(),
        INK.mix(0.55).stroke_width(2),
    ))?;
    for p in points {
        let colour = palette(p.group);
        if p.changes_signal {
            let ring = Circle::new(at(p), MARKER_RADIUS_PX, colour.stroke_width(2));
            chart.draw_series([ring])?;
        } else {
            let dot = Circle::new(at(p), MARKER_RADIUS_PX, colour.filled());
            chart.draw_series([dot])?;
        }
    }

    let plotting = chart.plotting_area();
    let on_page = |at: &(f64, f64)| {
        let (x, y) = plotting.map_coordinate(at);
        (f64::from(x), f64::from(y))
    };
    let line: Vec<(f64, f64)> = front.iter().map(on_page).collect();
    let on_page: Vec<(f64, f64)> = points.iter().map(|p| on_page(&at(p))).collect();
    let (xs, ys) = plotting.get_pixel_range();
    let frame = Rect {
        left: f64::from(xs.start),
        right: f64::from(xs.end),
        top: f64::from(ys.start),
        bottom: f64::from(ys.end),
    };
    let texts: Vec<&str> = points.iter().map(|p| p.label).collect();
    let radius = f64::from(MARKER_RADIUS_PX);
    let rects = place(&on_page, &texts, radius, FONT_PX, &line, &frame);
    for ((p, rect), &(x, y)) in points.iter().zip(&rects).zip(&on_page) {
        let colour = palette(p.group);
        let (near_x, near_y) = rect.nearest(x, y);
        // A label that had to go away from its point is led back to it.
        if (near_x - x).hypot(near_y - y) > radius + 8.0 {
            root.draw(&PathElement::new(
                [pixel(x, y), pixel(near_x, near_y)],
                colour.mix(0.45),
            ))?;
        }
        // Flush with the side that faces the point: widths of texts are guesses.
        let (x, side) = if rect.left > x {
            (rect.left, HPos::Left)
        } else if rect.right < x {
            (rect.right, HPos::Right)
        } else {
            (f64::midpoint(rect.left, rect.right), HPos::Center)
        };
        let style = font(FONT_PX)
            .color(&colour)
            .pos(Pos::new(side, VPos::Center));
        let y = f64::midpoint(rect.top, rect.bottom);
        root.draw(&Text::new(p.label, pixel(x, y), style))?;
    }
    root.present()?;
    drop(chart);
    drop(root);
    Ok(())
}

fn font(size_px: f64) -> FontDesc<'static> {
    ("sans-serif", size_px * LINE_PER_FONT).into_font()
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "pixels of a plot, and float casts saturate"
)]
fn pixel(x: f64, y: f64) -> (i32, i32) {
    (x.round() as i32, y.round() as i32)
}

/// A logarithmic axis: decimal logarithms and their ticks.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Axis {
    /// Over all positive values, with a margin as a share of the whole on both sides.
    pub(super) fn over(values: impl Iterator<Item = f64>, margin: f64) -> Self {
        let (low, high) = values
            .filter(|v| *v > 0.0 && v.is_finite())
            .map(f64::log10)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
                (a.min(v), b.max(v))
            });
        if !(low <= high) {
            return Self {
                low: -1.0,
                high: 1.0,
            };
        }
        // At least a factor of two, so that noise is not spread over the whole plot.
        let pad = (margin * (high - low)).max((0.301 - (high - low)) / 2.0);
        Self {
            low: low - pad.max(0.02),
            high: high + pad.max(0.02),
        }
    }

    /// Where a value lies; what is not positive lies at the lower end.
    pub(super) fn place(&self, value: f64) -> f64 {
        if value > 0.0 {
            value.log10().clamp(self.low, self.high)
        } else {
            self.low
        }
    }

    /// The same as a share of the axis.
    pub(super) fn share(&self, value: f64) -> f64 {
        (self.place(value) - self.low) / (self.high - self.low)
    }

    /// Round values on the axis: 1, 2, 5 of each decade, or only powers of ten of many.
    pub(super) fn ticks(&self) -> Vec<f64> {
        let decades = self.high - self.low;
        let steps: &[f64] = if decades < 1.0 {
            &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0]
        } else if decades < 2.2 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let mut ticks = Vec::new();
        let mut decade = self.low.floor();
        while decade <= self.high {
            let logs = steps.iter().map(|step| decade + step.log10());
            ticks.extend(logs.filter(|log| (self.low..=self.high).contains(log)));
            decade += 1.0;
        }
        ticks
    }
}

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, log: &f64, (from, to): (i32, i32)) -> i32 {
        let share = (log - self.low) / (self.high - self.low);
        pixel(f64::from(from) + share * f64::from(to - from), 0.0).0
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.low..self.high
    }
}

/// A number of a time axis.
pub(super) fn decimal(value: f64) -> String {
    // Powers of logarithms: three digits are exact enough.
    let digits = if value < 0.95 {
        2
    } else if value < 9.5 {
        1
    } else {
        0
    };
    let text = format!("{value:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A number of an error axis: 2·10⁻³, 10⁻³.
pub(super) fn scientific(value: f64) -> String {
    let (mantissa, power) = mantissa_and_power(value, 1);
    match mantissa.trim_end_matches(".0") {
        "1" => power,
        mantissa => format!("{mantissa}·{power}"),
    }
}

/// A measured number: 2.00·10⁻³.
pub(super) fn measured(value: f64) -> String {
    let (mantissa, power) = mantissa_and_power(value, 2);
    format!("{mantissa}·{power}")
}

fn mantissa_and_power(value: f64, decimals: usize) -> (String, String) {
    let mut exponent = value.log10().floor();
    let mut mantissa = format!("{:.decimals$}", value / 10_f64.powf(exponent));
    if mantissa.starts_with("10") {
        mantissa = format!("{:.decimals$}", 1.0);
        exponent += 1.0;
    }
    let power: String = format!("{exponent:.0}")
        .chars()
        .map(|c| match c.to_digit(10) {
            Some(digit) => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit as usize],
            None => '⁻',
        })
        .collect();
    (mantissa, format!("10{power}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_ticks_and_bear_anything() {
        for values in [
            &[][..],
            &[0.0],
            &[1.0],
            &[3.0, 3.1],
            &[1e-9, 1.0],
            &[f64::NAN, 2.0],
        ] {
            let axis = Axis::over(values.iter().copied(), 0.1);
            assert!(
                axis.low < axis.high && !axis.ticks().is_empty(),
                "{values:?}"
            );
            assert!((0.0..=1.0).contains(&axis.share(0.0)));
        }
    }

    #[test]
    fn numbers_read_well() {
        let found = [1e-3, 2e-4, 0.15, 9.99e-3, 1.0].map(scientific);
        assert_eq!(found, ["10⁻³", "2·10⁻⁴", "1.5·10⁻¹", "10⁻²", "10⁰"]);
        let found = [1e-3, 0.1234, 9.999e-3].map(measured);
        assert_eq!(found, ["1.00·10⁻³", "1.23·10⁻¹", "1.00·10⁻²"]);
        assert_eq!(
            [0.25, 1.5, 2.0, 20.0, 150.0].map(decimal),
            ["0.25", "1.5", "2", "20", "150"]
        );
    }

    #[test]
    fn a_plot_names_every_point() {
        let point = |time_ms, error, label| Point {
            time_ms,
            error,
            label,
            group: 3,
            on_front: true,
            changes_signal: false,
        };
        let points = [point(1.0, 0.0, "a <b>"), point(1.0, 0.0, "second")];
        let svg = speed_accuracy(&points, "RMSE").unwrap();
        assert!(
            svg.contains("second") && svg.contains("a &lt;b&gt;"),
            "{svg}"
        );
        assert!(speed_accuracy(&[], "RMSE").unwrap().contains("</svg>"));
    }
}
