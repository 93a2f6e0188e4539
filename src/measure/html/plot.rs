//! Draws plots as SVG text.

use std::fmt::Write;

use super::labels::{Rect, place};

/// Width and height of a plot in its own pixels; the page scales it.
const SIZE: [f64; 2] = [1080.0, 640.0];
/// Area of the points; numbers and names of the axes are to the left and below.
const FRAME: Rect = Rect {
    left: 82.0,
    top: 8.0,
    right: 1064.0,
    bottom: 580.0,
};
const FONT_PX: f64 = 13.0;
const MARKER_RADIUS_PX: f64 = 5.0;

const INK: &str = "#2b2f36";
const FAINT: &str = "#9aa1ab";
const GRID: &str = "#e6e8ec";

/// Colours that most eyes can tell apart (after Okabe and Ito), darkened for white paper.
const PALETTE: [&str; 10] = [
    INK, "#b33c2e", "#1f6fb2", "#1b8a62", "#c77d0a", "#a24b8f", "#3f9fc4", "#7a6a4f", "#6b727d",
    "#7d921f",
];

/// Returns the colour of the n-th group.
pub(super) fn group_colour(n: usize) -> &'static str {
    PALETTE[n % PALETTE.len()]
}

/// A point of the speed-accuracy plot.
pub(super) struct Point<'a> {
    pub(super) time_ms: f64,
    pub(super) error: f64,
    pub(super) label: &'a str,
    /// Number of the point's group, for its colour.
    pub(super) group: usize,
    pub(super) on_front: bool,
    /// Tolerance of a point where nothing else differs from the default.
    pub(super) tolerance: Option<f32>,
    /// True to draw a ring: the error results from a choice.
    pub(super) changes_signal: bool,
}

/// Plots time against error on logarithmic axes. A line joins the points of the front, dashes those of the tolerances.
///
/// Errors of 0 lie on the lower edge.
pub(super) fn speed_accuracy(points: &[Point<'_>], error_name: &str) -> String {
    let times = Axis::over(points.iter().map(|p| p.time_ms), 0.12);
    let errors = Axis::over(points.iter().map(|p| p.error), 0.12);
    let [width, height] = SIZE;
    let mut svg = String::new();
    // Writing to a string does not fail.
    let _ = writeln!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\">"
    );
    axes(&mut svg, &times, &errors, error_name);

    let on_page: Vec<(f64, f64)> = points
        .iter()
        .map(|p| {
            (
                across(times.share(p.time_ms)),
                upwards(errors.share(p.error)),
            )
        })
        .collect();
    let on_front = points.iter().zip(&on_page).filter(|(p, _)| p.on_front);
    let mut front: Vec<(f64, f64)> = on_front.map(|(_, at)| *at).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    joined(&mut svg, &front, "none");
    let by_tolerance = points.iter().zip(&on_page);
    let mut by_tolerance: Vec<(f32, (f64, f64))> = by_tolerance
        .filter_map(|(p, at)| Some((p.tolerance?, *at)))
        .collect();
    by_tolerance.sort_by(|a, b| a.0.total_cmp(&b.0));
    let by_tolerance: Vec<(f64, f64)> = by_tolerance.into_iter().map(|(_, at)| at).collect();
    joined(&mut svg, &by_tolerance, "5 5");
    for (p, (x, y)) in points.iter().zip(&on_page) {
        let colour = group_colour(p.group);
        let fill = if p.changes_signal { "none" } else { colour };
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{MARKER_RADIUS_PX}\" fill=\"{fill}\" \
             stroke=\"{colour}\" stroke-width=\"2\"/>"
        );
    }

    let texts: Vec<&str> = points.iter().map(|p| p.label).collect();
    let rects = place(&on_page, &texts, MARKER_RADIUS_PX, FONT_PX, &front, &FRAME);
    for ((p, rect), &at) in points.iter().zip(&rects).zip(&on_page) {
        label(&mut svg, p, rect, at);
    }
    svg.push_str("</svg>");
    svg
}

/// Draws a line through points of the page.
///
/// - `dashes`: lengths of dashes and gaps; `none` for a continuous line.
fn joined(svg: &mut String, points: &[(f64, f64)], dashes: &str) {
    let path: Vec<String> = points
        .iter()
        .map(|(x, y)| format!("{x:.1},{y:.1}"))
        .collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{INK}\" stroke-opacity=\"0.55\" \
         stroke-width=\"2\" stroke-dasharray=\"{dashes}\"/>",
        path.join(" ")
    );
}

/// Draws grid, numbers and names of both axes.
fn axes(svg: &mut String, times: &Axis, errors: &Axis, error_name: &str) {
    let Rect {
        left,
        top,
        right,
        bottom,
    } = FRAME;
    let _ = writeln!(svg, "<g font-size=\"12.5\" fill=\"{INK}\">");
    for log in times.ticks() {
        let x = across(times.along(log));
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} {top}V{bottom}\" stroke=\"{GRID}\"/>\
             <path d=\"M{x:.1} {bottom}v5\" stroke=\"{FAINT}\"/>\
             <text x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{text}</text>",
            y = bottom + 19.0,
            text = decimal(10_f64.powf(log)),
        );
    }
    for log in errors.ticks() {
        let y = upwards(errors.along(log));
        let _ = writeln!(
            svg,
            "<path d=\"M{left} {y:.1}H{right}\" stroke=\"{GRID}\"/>\
             <path d=\"M{left} {y:.1}h-5\" stroke=\"{FAINT}\"/>\
             <text x=\"{x}\" y=\"{y:.1}\" dy=\"0.35em\" text-anchor=\"end\">{text}</text>",
            x = left - 9.0,
            text = scientific(10_f64.powf(log)),
        );
    }
    let _ = writeln!(
        svg,
        "</g>\n<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"{FAINT}\"/>\n\
         <g font-size=\"13.5\" fill=\"{INK}\" text-anchor=\"middle\">\
         <text x=\"{x}\" y=\"{below}\">frame time, ms (logarithmic)</text>\
         <text transform=\"translate(20 {y}) rotate(-90)\">{name} (logarithmic)</text></g>",
        x = f64::midpoint(left, right),
        below = SIZE[1] - 14.0,
        y = f64::midpoint(top, bottom),
        name = escaped(error_name),
    );
}

/// Draws a point's name in its place.
fn label(svg: &mut String, point: &Point<'_>, rect: &Rect, (x, y): (f64, f64)) {
    let colour = group_colour(point.group);
    let (near_x, near_y) = rect.nearest(x, y);
    // A line joins a distant label to its point.
    if (near_x - x).hypot(near_y - y) > MARKER_RADIUS_PX + 8.0 {
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} {y:.1}L{near_x:.1} {near_y:.1}\" stroke=\"{colour}\" \
             stroke-opacity=\"0.45\"/>"
        );
    }
    // Aligned with the side that faces the point, because widths of texts are estimates.
    let (x, anchor) = if rect.left > x {
        (rect.left, "start")
    } else if rect.right < x {
        (rect.right, "end")
    } else {
        (f64::midpoint(rect.left, rect.right), "middle")
    };
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" dy=\"0.35em\" font-size=\"{FONT_PX}\" \
         fill=\"{colour}\" text-anchor=\"{anchor}\">{text}</text>",
        y = f64::midpoint(rect.top, rect.bottom),
        text = escaped(point.label),
    );
}

/// Converts a share of the time axis to pixels.
fn across(share: f64) -> f64 {
    FRAME.left + share * (FRAME.right - FRAME.left)
}

/// Converts a share of the error axis to pixels, which run downwards.
fn upwards(share: f64) -> f64 {
    FRAME.bottom - share * (FRAME.bottom - FRAME.top)
}

/// A logarithmic axis: decimal logarithms and their ticks.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Axis {
    /// Returns an axis over all positive values, with a margin on both sides as a share of the whole.
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
        // At least a factor of two, so that noise does not fill the whole plot.
        let pad = (margin * (high - low)).max((0.301 - (high - low)) / 2.0);
        Self {
            low: low - pad.max(0.02),
            high: high + pad.max(0.02),
        }
    }

    /// Returns the position of a value on the axis; values that are not positive lie at the lower end.
    fn place(&self, value: f64) -> f64 {
        if value > 0.0 {
            value.log10().clamp(self.low, self.high)
        } else {
            self.low
        }
    }

    /// Returns the position of a value as a share of the axis.
    pub(super) fn share(&self, value: f64) -> f64 {
        self.along(self.place(value))
    }

    /// Returns a logarithm as a share of the axis.
    fn along(&self, log: f64) -> f64 {
        (log - self.low) / (self.high - self.low)
    }

    /// Returns round values on the axis: 1, 2, 5 of each decade, or only powers of ten over many decades.
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

/// Formats a number of a time axis.
pub(super) fn decimal(value: f64) -> String {
    // The values are powers of ten of logarithms: three digits are accurate enough.
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

/// Formats a number of an error axis: 2·10⁻³, 10⁻³.
pub(super) fn scientific(value: f64) -> String {
    let (mantissa, power) = mantissa_and_power(value, 1);
    match mantissa.trim_end_matches(".0") {
        "1" => power,
        mantissa => format!("{mantissa}·{power}"),
    }
}

/// Formats a measured number: 2.00·10⁻³.
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

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
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
            tolerance: None,
            changes_signal: false,
        };
        let points = [point(1.0, 0.0, "a <b>"), point(1.0, 0.0, "second")];
        let svg = speed_accuracy(&points, "RMSE <0>");
        assert!(
            svg.contains("second") && svg.contains("a &lt;b&gt;"),
            "{svg}"
        );
        assert!(speed_accuracy(&[], "RMSE").contains("</svg>"));
        // Tolerances are joined in their order.
        let of = |tolerance: f32, time_ms| Point {
            tolerance: Some(tolerance),
            ..point(time_ms, f64::from(tolerance), "")
        };
        let curve = speed_accuracy(&[of(0.1, 3.0), of(0.01, 9.0), of(0.03, 5.0)], "RMSE");
        let line = curve.lines().find(|l| l.contains("\"5 5\"")).unwrap();
        let line = line.split('"').nth(1).unwrap().split(' ');
        let across: Vec<f64> = line
            .map(|at| at.split_once(',').unwrap().0.parse().unwrap())
            .collect();
        assert!(
            across.len() == 3 && across.is_sorted_by(|a, b| a > b),
            "{across:?}"
        );
        // Well-formed, with a mark for each point, also at the edge for errors of 0.
        let page = roxmltree::Document::parse(&svg).unwrap();
        let marks: Vec<_> = page
            .descendants()
            .filter(|node| node.has_tag_name("circle"))
            .map(|node| node.attribute("cy").unwrap())
            .collect();
        assert_eq!(marks, ["580.0", "580.0"]);
    }
}
