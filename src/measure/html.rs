//! Writes a report as one HTML page: no scripts, no network, plots and pictures embedded.

mod labels;
mod plot;

use std::fmt::Write;
use std::path::Path;

use base64::Engine;

use self::plot::{Axis, Point, group_colour, measured, scientific, speed_accuracy};
use super::difference;
use super::difference::map_colour;
use super::sweep::front_of;
use crate::error::Result;
use crate::image::{Image, srgb_from_linear};
use crate::io::png_bytes;
use crate::measure::difference::difference_scale;
use crate::measure::errors::ImageErrors;
use crate::measure::html::plot::escaped;
use crate::measure::report::{BudgetRow, ReferenceSummary, Report, Row};
use crate::measure::variants::ACCURATE;

const STYLE: &str = include_str!("html/style.css");

/// Width of a strip of the error budget, in the SVG's own pixels.
const STRIP_PX: f64 = 300.0;

impl Report {
    /// Returns the report as a self-contained HTML page.
    ///
    /// # Errors
    /// Errors of the picture writer; none is known to occur.
    pub fn html(&self) -> Result<Vec<u8>> {
        let mut page = String::new();
        // Writing to a string does not fail.
        let _ = write!(
            page,
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}: speed and accuracy of EWA splatting</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n",
            title = escaped(&self.about.inputs.join(", ")),
        );
        self.heading(&mut page);
        self.front(&mut page);
        self.budget_section(&mut page);
        self.gallery(&mut page)?;
        self.table(&mut page);
        page.push_str("</main>\n</body>\n</html>\n");
        Ok(page.into_bytes())
    }

    fn heading(&self, page: &mut String) {
        let machine = &self.machine;
        let [width, height] = self.camera.size;
        let title = escaped(&self.about.inputs.join(", "));
        let _ = writeln!(
            page,
            "<header>\n<p class=\"kicker\">EWA splatting: speed against accuracy</p>\n\
             <h1>{title}</h1>\n<dl>"
        );
        let mut item = |name: &str, value: String| {
            let _ = writeln!(page, "<div><dt>{name}</dt><dd>{value}</dd></div>");
        };
        item(
            "Scene",
            format!(
                "{} particles, {} bytes each",
                grouped(self.particles as f64),
                self.rows.first().map_or_else(String::new, |row| format!(
                    "{:.1}",
                    row.cost.bytes_per_particle
                ))
            ),
        );
        item(
            "Image",
            format!("{width} × {height} px, {}", self.camera.projection),
        );
        item(
            "Camera",
            format!(
                "eye {}, looking along {}",
                vector(self.camera.eye),
                vector(self.camera.forward)
            ),
        );
        item(
            "Machine",
            format!(
                "{}, {} thread{}, {}, {}{}",
                escaped(machine.cpu.as_deref().unwrap_or("unknown processor")),
                machine.threads,
                if machine.threads == 1 { "" } else { "s" },
                machine.simd,
                machine.system,
                if machine.debug_build {
                    "; <strong>not an optimised build, times mean nothing</strong>"
                } else {
                    ""
                }
            ),
        );
        item(
            "Times",
            format!(
                "medians of {} frame{} after a warm-up",
                self.frames,
                if self.frames == 1 { "" } else { "s" }
            ),
        );
        item(
            "Reference",
            reference_text(&self.about.reference, "the true integral of the kernels"),
        );
        if let Some(reference) = &self.about.reference_data {
            let what = "the true integral of the data's own field";
            item("Reference of the data", reference_text(reference, what));
        }
        let _ = write!(
            page,
            "<div class=\"whole\"><dt>Command</dt><dd><code>{}</code> (version {})</dd></div>\n\
             </dl>\n</header>\n",
            escaped(&self.about.command),
            machine.version
        );
    }

    /// Returns the groups in the order of the rows.
    fn groups(&self) -> Vec<&'static str> {
        let mut groups = Vec::new();
        for row in &self.rows {
            if !groups.contains(&row.group) {
                groups.push(row.group);
            }
        }
        groups
    }

    fn front(&self, page: &mut String) {
        page.push_str("<section>\n<h2>What accuracy costs</h2>\n");
        self.legend(page);
        let same = |row: &Row| !row.changes_signal;
        let against_reference =
            self.speed_accuracy("RMSE against the reference", same, |row| row.errors.rmse);
        let against_baseline =
            self.speed_accuracy("RMSE against the most accurate splatting", same, |row| {
                row.from_baseline.rmse
            });
        let _ = write!(
            page,
            "<figure>\n{against_reference}\n<figcaption><strong>Against the truth.</strong> Each \
             point is one way to draw the scene, one thing changed from the default \
             (<em>together</em>: several). Left is faster, down is closer to the reference. The \
             line joins what nothing else beats in both, and dashes join the tolerances. Rings ask for another image than the \
             reference's (wider or narrower kernels or pixels, kernels classified otherwise): their \
             distance is a choice, and they are not on the line. Error: root mean square over red, green, blue and alpha, \
             linear, full scale 1.</figcaption>\n</figure>\n<figure>\n{against_baseline}\n\
             <figcaption><strong>Against the most accurate splatting</strong> (at the lower \
             edge: its error is 0 here). What settings add, without what splatting itself leaves \
             out: kernels are sorted whole, and depths are filtered instead of opacities. Where \
             that is the greater part, the plot above is level and this one tells the settings \
             apart.</figcaption>\n</figure>\n"
        );
        if self.reference_data_image.is_some() {
            let against_data = self.speed_accuracy(
                "RMSE against the data's own field",
                |row| !row.changes_pixels,
                |row| row.from_data.map_or(0.0, |errors| errors.rmse),
            );
            let _ = write!(
                page,
                "<figure>\n{against_data}\n<figcaption><strong>Against the data</strong>: their own \
                 field, interpolated between the samples as their cells define it and classified at \
                 every place of a ray. The reference above integrates kernels; this one has none. Rings \
                 ask for other pixels; other kernels, and other ways to classify them, count \
                 here.</figcaption>\n</figure>\n"
            );
        }
        page.push_str("</section>\n");
    }

    /// - `counts`: returns true if a row aims at the image that errors are measured against; other rows are
    ///   drawn as rings.
    fn speed_accuracy(
        &self,
        error_name: &str,
        counts: impl Fn(&Row) -> bool,
        error: impl Fn(&Row) -> f64,
    ) -> String {
        let groups = self.groups();
        let front = front_of(&self.rows, |row| counts(row).then(|| error(row)));
        let points: Vec<Point<'_>> = self
            .rows
            .iter()
            .enumerate()
            .map(|(i, row)| Point {
                time_ms: row.cost.times_ms.frame,
                error: error(row),
                label: &row.mark,
                group: groups.iter().position(|g| *g == row.group).unwrap_or(0),
                on_front: front.contains(&i),
                tolerance: ["tolerance", "as given"]
                    .contains(&row.group)
                    .then_some(row.settings.tolerance),
                changes_signal: !counts(row),
            })
            .collect();
        speed_accuracy(&points, error_name)
    }

    fn legend(&self, page: &mut String) {
        page.push_str("<p class=\"legend\">");
        for (i, group) in self.groups().into_iter().enumerate() {
            let changes = self
                .rows
                .iter()
                .any(|row| row.group == group && row.changes_signal);
            let colour = group_colour(i);
            let fill = if changes { "transparent" } else { colour };
            let _ = write!(
                page,
                "<span><i style=\"background:{fill};border-color:{colour}\"></i>{group}</span>"
            );
        }
        page.push_str("</p>\n");
    }

    fn budget_section(&self, page: &mut String) {
        let budget = &self.budget;
        let baseline = self.row(&budget.baseline);
        let values = budget.rows.iter().flat_map(|row| {
            let reference = row.against_reference.map(|e| e.rmse);
            [Some(row.alone.rmse), reference].into_iter().flatten()
        });
        let axis = Axis::over(values.chain([budget.baseline_errors.rmse]), 0.04);
        let _ = write!(
            page,
            "<section>\n<h2>Error budget</h2>\n<p class=\"lead\">The most accurate splatting \
             ({}) takes {} ms and is {} (RMSE) from the reference. Each row switches one \
             approximation on.</p>\n<table class=\"budget\">\n<thead><tr><th>approximation</th>\
             <th class=\"strip\">{}</th><th>alone<br>RMSE</th><th>alone<br>99.9 %</th>\
             <th>from reference<br>RMSE</th><th>frame<br>ms</th><th class=\"saved\">time saved\
             </th></tr></thead>\n<tbody>\n",
            baseline.map_or("", |row| row.label.as_str()),
            milliseconds(budget.baseline_frame_ms),
            error(budget.baseline_errors.rmse),
            strip_scale(&axis),
        );
        for row in &budget.rows {
            let (frame, saved) = row.saving.map_or((String::new(), String::new()), |saving| {
                (milliseconds(saving.frame_ms), saved_bar(saving.saved_share))
            });
            // Rows about the reference itself compare other images.
            let compares = if row.against_reference.is_none() {
                format!("<small>{}</small>", escaped(&row.compares))
            } else {
                String::new()
            };
            let _ = writeln!(
                page,
                "<tr><td>{}{compares}</td><td class=\"strip\">{}</td><td>{}</td>\
                 <td>{}</td><td>{}</td><td>{frame}</td><td class=\"saved\">{saved}</td></tr>",
                escaped(&row.label),
                strip(&axis, row, budget.baseline_errors.rmse),
                error(row.alone.rmse),
                error(row.alone.p999),
                row.against_reference
                    .map_or_else(|| "–".into(), |e| error(e.rmse)),
            );
        }
        page.push_str(
            "</tbody>\n</table>\n<p class=\"caption\">Filled: what the approximation alone adds, \
             the distance between the images with and without it. Ring: the distance from the \
             reference that results. Dashed: the distance of the most accurate splatting; a ring \
             below it means that two errors cancel. Logarithmic. Time saved is the share of the \
             most accurate splatting's frame.</p>\n</section>\n",
        );
    }

    fn gallery(&self, page: &mut String) -> Result<()> {
        page.push_str("<section>\n<h2>What the errors look like</h2>\n<div class=\"gallery\">\n");
        picture(
            page,
            &opaque(&self.reference_image),
            "<strong>Reference</strong>",
        )?;
        if let Some(data) = &self.reference_data_image {
            picture(page, &opaque(data), "<strong>The data's own field</strong>")?;
        }
        // The default beside the reference; then the others in rows of three, each row above its differences.
        let shown: Vec<_> = self
            .pictures
            .iter()
            .filter_map(|shown| Some((self.row(&shown.id)?, &shown.image)))
            .collect();
        let (first, others) = shown.split_at(shown.len().min(1));
        for pictures in std::iter::once(first).chain(others.chunks(3)) {
            for (row, image) in pictures {
                let label = format!(
                    "<strong>{}</strong><br>{} ms, RMSE {}, FLIP {}",
                    escaped(&row.label),
                    milliseconds(row.cost.times_ms.frame),
                    error(row.errors.rmse),
                    fraction(row.errors.flip)
                );
                picture(page, &opaque(image), &label)?;
            }
            for (row, image) in pictures {
                let scale = difference_scale(&row.errors);
                let of = difference(&self.reference_image, image, scale)?;
                let label = format!("Difference: 0 {} {}", colour_bar(), scientific(scale));
                picture(page, &of, &label)?;
            }
        }
        page.push_str(
            "</div>\n<p class=\"caption\">Over black. Differences are from the reference and absolute, the largest of \
             red, green, blue and alpha, linear, each picture with the scale beside its bar: what \
             99.9 % of pixels stay below, rounded up.</p>\n</section>\n",
        );
        Ok(())
    }

    fn table(&self, page: &mut String) {
        page.push_str(
            "<section>\n<h2>All figures</h2>\n<div class=\"wide\"><table class=\"all\">\n<thead>\
             <tr><th>variant</th><th>id</th><th>frame<br>ms</th><th>rasterise<br>ms</th>\
             <th>splat-px<br>10⁶</th><th>per core-s<br>10⁶</th><th>RMSE</th>\
             <th>from data<br>RMSE</th><th>99.9 %</th><th>max</th><th>bias</th><th>SSIM</th>\
             <th>FLIP</th></tr></thead>\n",
        );
        for (i, group) in self.groups().into_iter().enumerate() {
            let _ = writeln!(
                page,
                "<tbody>\n<tr class=\"group\"><th colspan=\"13\">\
                 <i style=\"background:{}\"></i>{group}</th></tr>",
                group_colour(i)
            );
            for row in self.rows.iter().filter(|row| row.group == group) {
                table_row(page, row);
            }
            page.push_str("</tbody>\n");
        }
        let _ = write!(
            page,
            "</table></div>\n<p class=\"caption\">● beaten by none in time and RMSE. Errors are against \
             the reference, linear premultiplied, full scale 1; bias is the mean of rendering \
             minus reference; SSIM (11 × 11, σ 1.5, luma) and FLIP (67 pixels per degree) of the \
             image over black, sRGB. A splat-pixel is one kernel evaluated at one pixel; per \
             core-second of rasterising. The most accurate variant is <code>{ACCURATE}</code>. \
             PSNR, stages, footprints and settings are in <code>report.csv</code> and \
             <code>report.json</code>.</p>\n</section>\n"
        );
    }
}

/// Describes the origin of a reference image; `what` describes an integrated one.
fn reference_text(reference: &ReferenceSummary, what: &str) -> String {
    let mut text = match reference.origin.as_str() {
        "integrated" => format!("{what} in double precision"),
        file => format!("read from <code>{}</code>", escaped(&name(file))),
    };
    match reference.error {
        Some(error) => {
            let _ = write!(text, ", stated error {}", scientific(error));
        }
        None => text.push_str(", error not stated"),
    }
    if let Some(count) = reference.unconverged.filter(|&n| n > 0) {
        let _ = write!(
            text,
            "; {} pixels stayed above the error aimed at",
            grouped(count as f64)
        );
    }
    if let (Some(rays), Some(seconds)) = (reference.rays, reference.seconds) {
        let _ = write!(text, "; {} rays in {seconds:.0} s", grouped(rays as f64));
    }
    text
}

fn table_row(page: &mut String, row: &Row) {
    let (c, t, e): (_, _, &ImageErrors) = (&row.cost, &row.cost.times_ms, &row.errors);
    let _ = writeln!(
        page,
        "<tr><td>{label}{front}</td><td><code>{id}</code></td><td>{frame}</td><td>{raster}</td>\
         <td>{pixels}</td><td>{rate}</td><td>{rmse}</td><td>{data}</td><td>{p999}</td>\
         <td>{max}</td><td>{bias}</td><td>{ssim}</td><td>{flip}</td></tr>",
        front = if row.on_front { " ●" } else { "" },
        label = escaped(&row.label),
        id = escaped(&row.id),
        frame = milliseconds(t.frame),
        raster = milliseconds(t.rasterise),
        pixels = decimals(c.splat_pixels as f64 / 1e6),
        rate = c
            .splat_pixels_per_core_second
            .map_or_else(|| "–".into(), |rate| grouped(rate / 1e6)),
        rmse = error(e.rmse),
        data = row.from_data.map_or_else(|| "–".into(), |e| error(e.rmse)),
        max = error(e.max),
        p999 = error(e.p999),
        bias = signed_error(e.mean_difference),
        ssim = fraction(e.ssim),
        flip = fraction(e.flip),
    );
}

/// Draws the ticks above the strips of the budget.
fn strip_scale(axis: &Axis) -> String {
    let mut svg = format!("<svg viewBox=\"0 0 {STRIP_PX} 18\" class=\"scale\">");
    let powers = axis.ticks();
    // Only powers of ten if there are several.
    let whole: Vec<f64> = powers
        .iter()
        .copied()
        .filter(|log| (log - log.round()).abs() < 1e-9)
        .collect();
    let ticks = if whole.len() >= 2 { whole } else { powers };
    for log in ticks {
        let value = 10_f64.powf(log);
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"12\" text-anchor=\"middle\">{}</text>",
            strip_x(axis, value),
            scientific(value)
        );
    }
    svg + "</svg>"
}

fn strip_x(axis: &Axis, value: f64) -> f64 {
    const MARGIN_PX: f64 = 14.0;
    MARGIN_PX + axis.share(value) * (STRIP_PX - 2.0 * MARGIN_PX)
}

/// Draws the dots of one row of the budget.
fn strip(axis: &Axis, row: &BudgetRow, baseline: f64) -> String {
    let x = |value| strip_x(axis, value);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {STRIP_PX} 22\"><line class=\"rule\" x1=\"0\" x2=\"{STRIP_PX}\" \
         y1=\"11\" y2=\"11\"/><line class=\"baseline\" x1=\"{b:.1}\" x2=\"{b:.1}\" y1=\"0\" \
         y2=\"22\"/>",
        b = x(baseline)
    );
    let alone = (row.alone.rmse > 0.0).then(|| x(row.alone.rmse));
    if let Some(x) = alone {
        let _ = write!(
            svg,
            "<line class=\"bar\" x1=\"0\" x2=\"{x:.1}\" y1=\"11\" y2=\"11\"/>"
        );
    }
    if let Some(e) = row.against_reference.filter(|e| e.rmse > 0.0) {
        let _ = write!(
            svg,
            "<circle class=\"ring\" cx=\"{:.1}\" cy=\"11\" r=\"6\"/>",
            x(e.rmse)
        );
    }
    if let Some(x) = alone {
        let _ = write!(
            svg,
            "<circle class=\"dot\" cx=\"{x:.1}\" cy=\"11\" r=\"4\"/>"
        );
    }
    svg + "</svg>"
}

fn saved_bar(share: f64) -> String {
    let width = share.abs().min(1.0) * 100.0;
    let class = if share < 0.0 { "lost" } else { "won" };
    format!(
        "<span class=\"bar\"><i class=\"{class}\" style=\"width:{width:.1}%\"></i></span>\
         <span class=\"share\">{}{:.0} %</span>",
        if share < 0.0 { "−" } else { "" },
        share.abs() * 100.0
    )
}

/// Draws the colours of a difference picture, from 0 to its scale.
fn colour_bar() -> String {
    let stops: Vec<String> = (0..=10)
        .map(|i| {
            let colour = map_colour(f64::from(i) / 10.0);
            let [r, g, b] = [0, 1, 2].map(|c| srgb_from_linear(colour[c]) * 255.0);
            format!("rgb({r:.0},{g:.0},{b:.0})")
        })
        .collect();
    format!(
        "<i class=\"colours\" style=\"background:linear-gradient(90deg,{})\"></i>",
        stops.join(",")
    )
}

fn picture(page: &mut String, image: &Image, caption: &str) -> Result<()> {
    let bytes = png_bytes(Path::new("report.html"), image)?;
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    let _ = writeln!(
        page,
        "<figure><img alt=\"\" width=\"{}\" height=\"{}\" src=\"data:image/png;base64,{text}\">\
         <figcaption>{caption}</figcaption></figure>",
        image.width, image.height
    );
    Ok(())
}

/// Returns the image over black.
fn opaque(image: &Image) -> Image {
    let mut image = image.clone();
    for pixel in &mut image.pixels {
        pixel[3] = 1.0;
    }
    image
}

fn name(path: &str) -> String {
    let name = Path::new(path).file_name();
    name.map_or_else(|| path.to_owned(), |n| n.to_string_lossy().into_owned())
}

fn vector(v: [f64; 3]) -> String {
    let parts = v.map(|x| format!("{x:.3}").replace('-', "−"));
    format!("({})", parts.join(", "))
}

/// Formats an error to three digits.
fn error(value: f64) -> String {
    if value > 0.0 {
        measured(value)
    } else {
        "0".into()
    }
}

fn signed_error(value: f64) -> String {
    let sign = if value < 0.0 { "−" } else { "+" };
    match error(value.abs()).as_str() {
        "0" => "0".into(),
        text => format!("{sign}{text}"),
    }
}

fn fraction(value: Option<f64>) -> String {
    value.map_or_else(|| "–".into(), |v| format!("{v:.4}"))
}

/// Formats milliseconds to three digits.
fn milliseconds(value: f64) -> String {
    decimals(value)
}

fn decimals(value: f64) -> String {
    if value < 10.0 {
        format!("{value:.2}")
    } else if value < 100.0 {
        format!("{value:.1}")
    } else {
        grouped(value)
    }
}

/// Formats a whole number with thin spaces between thousands.
fn grouped(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_numbers_are_grouped() {
        assert_eq!(escaped("<a & \"b\">"), "&lt;a &amp; &quot;b&quot;&gt;");
        assert_eq!(grouped(1_234_567.0), "1\u{2009}234\u{2009}567");
        assert_eq!(grouped(12.0), "12");
        assert_eq!(
            [9.994, 99.94, 1234.0].map(milliseconds),
            ["9.99", "99.9", "1\u{2009}234"]
        );
        assert_eq!(signed_error(-0.002), "−2.00·10⁻³");
        assert_eq!(signed_error(0.0), "0");
    }
}
