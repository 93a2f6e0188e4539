//! Draws colour bars into pictures: a key from colours to values of a field.
//!
//! A legend is drawn over a finished picture, into its upper right corner. Each transfer function has a plate
//! with its name, a bar of its colours and round numbers beside the bar. To the left of the bar its opacity is
//! drawn as a curve.

mod ticks;

pub use crate::data::unit::{name_without_unit, title_of};

use self::ticks::Tick;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::math::narrowed;
use crate::overlay::{Font, Line, PLATE_OPACITY, Rect, fill, font_of, share};
use crate::scene::{Colour, PointVolume, Strength, TransferFunction, ValueScale};

/// A scale of colours and its title.
#[derive(Debug, Clone, PartialEq)]
pub struct ColourBar {
    title: String,
    colours: Colours,
}

#[derive(Debug, Clone, PartialEq)]
enum Colours {
    /// A transfer function over its range, evenly on its scale.
    Transfer(TransferFunction),
    /// The same without opacities.
    Column(TransferFunction),
}

/// Share of a picture's height for a bar, if there is room.
const BAR_SHARE: f64 = 0.35;
/// Greatest share of a picture's width for all titles together, before they are shortened.
const TITLE_SHARE: f64 = 0.4;
/// Greatest number of lines in a title.
const MOST_TITLE_LINES: usize = 2;
/// Greatest number of ticks.
const MOST_TICKS: usize = 7;
/// Number of ticks that must fit: with five there are at least two round numbers ([`ticks::linear`]).
const LEAST_TICKS: usize = 5;
/// Linear grey level of outlines and of the opacity's curve.
const OUTLINE: f32 = 0.4;

impl ColourBar {
    /// Makes a bar of a transfer function's colours over its range.
    ///
    /// - `title`: name of the field, with its unit if known.
    pub fn of_transfer_function(title: &str, transfer: &TransferFunction) -> Self {
        Self {
            title: title.into(),
            colours: Colours::Transfer(transfer.clone()),
        }
    }

    /// Makes a bar of the colours of a column density's picture
    /// ([`column_colours`](crate::io::column_colours)).
    pub fn of_column(title: &str, colours: &TransferFunction) -> Self {
        Self {
            title: title.into(),
            colours: Colours::Column(colours.clone()),
        }
    }

    /// Makes a bar of the colours that classify a volume; `None` for a volume with colours of its own.
    pub fn of_volume(title: &str, volume: &PointVolume) -> Option<Self> {
        let transfer = volume.transfer_function.as_ref();
        let transfer = transfer.filter(|_| matches!(volume.colour, Colour::Classified))?;
        // An opaque surface shows only the function's colours.
        Some(match volume.strength {
            Strength::Surface(_) => Self::of_column(title, transfer),
            _ => Self::of_transfer_function(title, transfer),
        })
    }

    /// Returns the same bar for another function.
    #[must_use]
    pub fn with_transfer_function(&self, transfer: &TransferFunction) -> Self {
        let transfer = transfer.clone();
        Self {
            title: self.title.clone(),
            colours: match &self.colours {
                Colours::Transfer(_) => Colours::Transfer(transfer),
                Colours::Column(_) => Colours::Column(transfer),
            },
        }
    }

    /// Returns the title of the bar.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Returns round numbers on the bar's scale: each one's height on the bar, 0 to 1, and its label.
    ///
    /// - `most`: greatest number of labels, at least 5.
    pub fn labels(&self, most: usize) -> Vec<(f64, String)> {
        let ticks = self.ticks(most);
        let fractions = ticks.iter().map(|tick| self.fraction(tick.value()));
        fractions.zip(ticks::labels(&ticks)).collect()
    }

    fn transfer(&self) -> &TransferFunction {
        match &self.colours {
            Colours::Transfer(transfer) | Colours::Column(transfer) => transfer,
        }
    }

    /// Returns the values at the ends.
    fn range(&self) -> [f64; 2] {
        let scale = self.scale();
        self.transfer().range().map(|end| scale.value(end))
    }

    /// Returns the scale of the values between the ends.
    fn scale(&self) -> ValueScale {
        self.transfer().value_scale()
    }

    fn ticks(&self, most: usize) -> Vec<Tick> {
        match self.scale() {
            ValueScale::Linear => ticks::linear(self.range(), most),
            ValueScale::Shifted { .. } => ticks::shifted(self.range(), most),
            ValueScale::Log => ticks::logarithmic(self.range(), most),
            ValueScale::Symlog { linear } => ticks::symmetric(self.range(), linear.into(), most),
        }
    }

    /// Returns the height of a value on the bar, 0 to 1.
    fn fraction(&self, value: f64) -> f64 {
        let [low, high] = self.range();
        let fraction = match self.scale() {
            ValueScale::Linear | ValueScale::Shifted { .. } => (value - low) / (high - low),
            ValueScale::Log => (value / low).ln() / (high / low).ln(),
            scale @ ValueScale::Symlog { .. } => {
                let [low, high, value] = [low, high, value].map(|v| f64::from(scale.position(v)));
                (value - low) / (high - low)
            }
        };
        fraction.clamp(0.0, 1.0)
    }

    /// Returns the linear colour at a fraction of the bar's length, and the opacity there as a share of the
    /// greatest; `None` if all is opaque.
    pub fn at(&self, fraction: f64) -> ([f32; 3], Option<f32>) {
        match &self.colours {
            Colours::Transfer(transfer) => {
                let [low, high] = transfer.range().map(f64::from);
                let position = narrowed(low + (high - low) * fraction);
                let [r, g, b, extinction] = transfer.classify(position);
                let opacity = |extinction: f32| {
                    1.0 - (-f64::from(extinction) * transfer.unit_distance()).exp()
                };
                let greatest = transfer.table().iter().map(|e| e[3]).fold(0.0, f32::max);
                #[expect(clippy::cast_possible_truncation, reason = "a share of one")]
                let share = (opacity(extinction) / opacity(greatest).max(1e-30)) as f32;
                ([r, g, b], Some(share.clamp(0.0, 1.0)))
            }
            Colours::Column(colours) => {
                let [low, high] = colours.range().map(f64::from);
                let [r, g, b, _] = colours.classify(narrowed(low + (high - low) * fraction));
                ([r, g, b], None)
            }
        }
    }
}

/// Checks that the bars fit into a picture of this width and height, before the picture is drawn.
///
/// # Errors
/// A picture that is too small. The least size has text 16 pixels high and five lines of it beside a bar.
pub fn check_legend_size(bars: &[ColourBar], size: [usize; 2]) -> Result<()> {
    layout(bars, size).map(|_| ())
}

/// Returns the number of columns of a picture to the left of all plates.
///
/// # Errors
/// The errors of [`check_legend_size`].
pub fn columns_beside_legend(bars: &[ColourBar], size: [usize; 2]) -> Result<usize> {
    let plates = layout(bars, size)?;
    Ok(plates.first().map_or(size[0], |first| first.plate.left))
}

/// Returns the number of columns at the right of a picture that the plates take; 0 without bars, or if they do
/// not fit.
pub fn legend_width(bars: &[ColourBar], size: [usize; 2]) -> usize {
    columns_beside_legend(bars, size).map_or(0, |left| size[0] - left)
}

/// Draws colour bars into the upper right corner of a picture; nothing outside their plates changes.
///
/// Colours are opaque, as the transfer function states them: the colour of a sample in front of everything
/// else. The curve to the left of a bar is the opacity per unit distance; its greatest value is as wide as the
/// bar. Text is a fortieth of the picture's shorter side, rounded to a size that the font has, and at least 16
/// pixels.
///
/// # Errors
/// The errors of [`check_legend_size`].
pub fn draw_legend(bars: &[ColourBar], image: &mut Image) -> Result<()> {
    if !image.is_whole() {
        return Err(Error::invalid(
            "legend",
            "image",
            format!("{} x {} pixels", image.width, image.height),
            image.pixels.len().to_string(),
            "give all pixels",
        ));
    }
    let plates = layout(bars, [image.width, image.height])?;
    for (bar, plate) in bars.iter().zip(&plates) {
        plate.draw(bar, image);
    }
    Ok(())
}

/// A tick: its row in the bar, and its label.
#[derive(Debug, Clone)]
struct Mark {
    row: usize,
    label: Line,
}

/// Positions of the parts of one colour bar.
#[derive(Debug, Clone)]
struct Plate {
    font: Font,
    plate: Rect,
    /// The opaque colours.
    bar: Rect,
    /// Extent of the opacity's curve to the left of the bar, pixels.
    curve: usize,
    titles: Vec<Line>,
    marks: Vec<Mark>,
}

/// Arranges the plates side by side, the last one in the corner.
fn layout(bars: &[ColourBar], [width, height]: [usize; 2]) -> Result<Vec<Plate>> {
    let font = font_of([width, height]);
    let line = font.line_px();
    let gap = line / 2;
    // Space above and below the bar: the margin, the plate's rim, and the title with a gap.
    let around = 2 * gap + 2 * gap + line + gap;
    let least = LEAST_TICKS * line;
    let length = share(height, BAR_SHARE).max(least);
    let title_px = share(width, TITLE_SHARE) / bars.len().max(1);

    // Titles get a second line if there is room; all bars begin below the longest title.
    let has_room = length + around + line <= height;
    let most_lines = if has_room { MOST_TITLE_LINES } else { 1 };
    let inner_of = |bar: &ColourBar, labels: &[String]| {
        let longest = labels.iter().map(|l| font.width_px(l)).max().unwrap_or(0);
        let curve = if bar.at(0.0).1.is_some() { line } else { 0 };
        (curve, curve + line + gap + longest)
    };
    let most_ticks = (length / line).clamp(LEAST_TICKS, MOST_TICKS);
    let titles: Vec<Vec<String>> = bars
        .iter()
        .map(|bar| {
            let (_, inner) = inner_of(bar, &ticks::labels(&bar.ticks(most_ticks)));
            font.wrapped(&bar.title, title_px.max(inner), most_lines)
        })
        .collect();
    let title_height = line * titles.iter().map(Vec::len).max().unwrap_or(1);
    let around = around - line + title_height;

    let mut plates: Vec<Plate> = Vec::with_capacity(bars.len());
    let mut left = gap;
    for (bar, titles) in bars.iter().zip(titles) {
        let ticks = bar.ticks(most_ticks);
        let labels = ticks::labels(&ticks);
        let (curve, inner) = inner_of(bar, &labels);
        let widest = titles.iter().map(|title| font.width_px(title)).max();
        let inner = inner.max(widest.unwrap_or(0));
        let plate = Rect {
            left,
            top: gap,
            width: gap + inner + gap,
            height: gap + title_height + gap + length + gap,
        };
        let area = Rect {
            left: left + gap + curve,
            top: plate.top + gap + title_height + gap,
            width: line,
            height: length,
        };
        let mark = |(tick, text): (&Tick, String)| {
            let row = row_of(bar.fraction(tick.value()), length);
            let middle = area.top + row;
            Mark {
                row,
                label: Line {
                    text,
                    left: area.right() + gap,
                    top: middle.saturating_sub(line / 2),
                },
            }
        };
        plates.push(Plate {
            font,
            plate,
            bar: area,
            curve,
            titles: titles
                .into_iter()
                .enumerate()
                .map(|(i, text)| Line {
                    text,
                    left: left + gap,
                    top: plate.top + gap + i * line,
                })
                .collect(),
            marks: ticks.iter().zip(labels).map(mark).collect(),
        });
        left = plate.right() + gap;
    }
    // An empty legend fits everywhere.
    if !bars.is_empty() && (left > width || length + around > height) {
        return Err(Error::invalid(
            "legend",
            "image size",
            format!("{left} x {} pixels at least", least + around),
            format!("{width} x {height}"),
            "draw a larger picture, or one without a legend",
        ));
    }
    let moved = width.saturating_sub(left);
    for plate in &mut plates {
        plate.move_right(moved);
    }
    Ok(plates)
}

/// Returns the row, from the top, of a bar of `length` rows at a fraction of its height.
fn row_of(fraction: f64, length: usize) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 to the bar's length"
    )]
    let up = (fraction * length as f64) as usize;
    length - 1 - up.min(length - 1)
}

impl Plate {
    fn move_right(&mut self, px: usize) {
        self.plate.left += px;
        self.bar.left += px;
        for title in &mut self.titles {
            title.left += px;
        }
        for mark in &mut self.marks {
            mark.label.left += px;
        }
    }

    fn draw(&self, bar: &ColourBar, image: &mut Image) {
        let grey = |level: f32| [level, level, level, 1.0];
        fill(image, self.plate, [0.0, 0.0, 0.0, 1.0], PLATE_OPACITY);
        let thickness = (self.font.line_px() / 16).max(1);
        let outline = Rect {
            left: self.bar.left - thickness,
            top: self.bar.top - thickness,
            width: self.bar.width + 2 * thickness,
            height: self.bar.height + 2 * thickness,
        };
        fill(image, outline, grey(OUTLINE), 1.0);
        for row in 0..self.bar.height {
            let fraction = 1.0 - (row as f64 + 0.5) / self.bar.height as f64;
            let ([r, g, b], opacity) = bar.at(fraction);
            let rows = Rect {
                top: self.bar.top + row,
                height: 1,
                ..self.bar
            };
            fill(image, rows, [r, g, b, 1.0], 1.0);
            if let Some(share) = opacity {
                self.draw_curve(image, rows, share, thickness);
            }
        }
        for mark in &self.marks {
            let tick = Rect {
                left: self.bar.right() + thickness,
                top: (self.bar.top + mark.row).saturating_sub(thickness / 2),
                width: self.font.line_px() / 4,
                height: thickness,
            };
            fill(image, tick, grey(1.0), 1.0);
            mark.label.draw(self.font, image);
        }
        for title in &self.titles {
            title.draw(self.font, image);
        }
    }

    /// Draws one row of the opacity's curve: grey from the bar outwards, over this share of the curve's extent.
    fn draw_curve(&self, image: &mut Image, row: Rect, share: f32, thickness: usize) {
        let most = self.curve - 2 * thickness;
        let reach = share * most as f32;
        for i in 0..most {
            let coverage = (reach - i as f32).clamp(0.0, 1.0);
            let pixel = Rect {
                left: row.left - 2 * thickness - i,
                width: 1,
                ..row
            };
            fill(image, pixel, [OUTLINE, OUTLINE, OUTLINE, 1.0], coverage);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::ColumnImage;
    use crate::scene::TransferDefaults;

    fn viridis_bar(title: &str, range: [f32; 2]) -> ColourBar {
        let defaults = TransferDefaults {
            range,
            unit_distance: 0.3,
        };
        let transfer = TransferFunction::named("viridis", &defaults).unwrap();
        ColourBar::of_transfer_function(title, &transfer)
    }

    #[test]
    fn labels_lie_on_the_scale_and_functions_are_exchanged() {
        let bar = viridis_bar("density", [0.0, 10.0]);
        let labels = bar.labels(6);
        for (at, label) in &labels {
            let value: f64 = label.parse().unwrap();
            assert!((at - value / 10.0).abs() < 1e-12, "{at} {label}");
        }
        assert_eq!(labels.len(), 6);
        let other = viridis_bar("pressure", [1.0, 2.0]);
        let exchanged = bar.with_transfer_function(other.transfer());
        assert_eq!(
            (exchanged.title(), exchanged.labels(6)),
            ("density", other.labels(6))
        );
        let column = ColourBar::of_column("density", bar.transfer());
        assert_eq!(
            column.with_transfer_function(other.transfer()).at(0.3).1,
            None
        );
    }

    fn column_bar(values: Vec<f32>) -> ColourBar {
        let column = ColumnImage {
            width: values.len(),
            height: 1,
            values,
            pixel_area: None,
        };
        let colours = crate::io::column_colours(&column, None, None, None);
        ColourBar::of_column("column density", &colours.unwrap().unwrap())
    }

    const SIZES: [[usize; 2]; 5] = [
        [256, 256],
        [320, 180],
        [512, 512],
        [1024, 1024],
        [2600, 4000],
    ];

    #[test]
    fn bars_have_the_colours_of_their_values_at_the_ticks() {
        let bars = [
            viridis_bar("density", [-3.0, 41.0]),
            column_bar(vec![2e-3, 7.0, 30.0]),
        ];
        for size in SIZES {
            for bar in &bars {
                let mut image = Image::new(size[0], size[1]);
                draw_legend(std::slice::from_ref(bar), &mut image).unwrap();
                let plate = &layout(std::slice::from_ref(bar), size).unwrap()[0];
                let ticks = bar.ticks((plate.bar.height / plate.font.line_px()).clamp(5, 7));
                assert_eq!(ticks.len(), plate.marks.len());
                let colour = |value: f64| bar.at(bar.fraction(value)).0;
                for (tick, mark) in ticks.iter().zip(&plate.marks) {
                    assert_eq!(mark.label.text.parse::<f64>().unwrap(), tick.value());
                    let x = plate.bar.left + plate.bar.width / 2;
                    let [r, g, b, a] = image.pixel(x, plate.bar.top + mark.row);
                    assert_eq!(a, 1.0);
                    // The row shows its own colour, and the tick's colour lies within the row. They differ at
                    // most by the colours at the row's ends, and by the bend of the gradient within it.
                    let end = |row: usize| bar.at(1.0 - row as f64 / plate.bar.height as f64).0;
                    let ends = [end(mark.row), end(mark.row + 1)];
                    let expected = colour(tick.value());
                    for (c, found) in [r, g, b].into_iter().enumerate() {
                        let width = (ends[0][c] - ends[1][c]).abs() + 1e-3;
                        assert!((found - expected[c]).abs() <= width, "{found} {expected:?}");
                    }
                }
            }
        }
        // The colours of the transfer function itself and of the picture of columns.
        let Colours::Transfer(transfer) = &bars[0].colours else {
            panic!("a transfer function")
        };
        assert_eq!(
            bars[0].at(bars[0].fraction(19.0)).0,
            transfer.classify(19.0)[..3]
        );
        let unit = TransferDefaults {
            range: [0.0, 1.0],
            unit_distance: 1.0,
        };
        let named = TransferFunction::named("viridis", &unit).unwrap();
        let [r, g, b, _] = named.classify(0.5);
        // Between 3e-3, four decades below 30, and 30.
        for (found, expected) in bars[1].range().into_iter().zip([3e-3, 30.0]) {
            assert!((found / expected - 1.0).abs() < 1e-5);
        }
        let middle = bars[1].at(bars[1].fraction(0.3)).0;
        for (found, expected) in middle.into_iter().zip([r, g, b]) {
            // A step of the table is .001 of the colours.
            assert!((found - expected).abs() < 1e-3);
        }
    }

    #[test]
    fn all_lies_on_the_plates_and_nothing_else_changes() {
        let long = "a field with a name that is far too long for any legend of any picture";
        let bars = [
            viridis_bar("p", [0.0, 1.0]),
            viridis_bar(long, [1e6, 1e6 + 2.0]),
            column_bar(vec![1e-12, 1e-8]),
        ];
        for size in SIZES {
            for bars in [&bars[..1], &bars[1..2], &bars[2..], &bars] {
                let is_small = bars.len() > 1 && size[0] < 1024;
                let Ok(plates) = layout(bars, size) else {
                    assert!(is_small);
                    continue;
                };
                let value = |i: usize| (i % 251) as f32 / 251.0;
                let mut image = Image::new(size[0], size[1]);
                for (i, pixel) in image.pixels.iter_mut().enumerate() {
                    *pixel = [value(i); 4];
                }
                draw_legend(bars, &mut image).unwrap();
                let mut changed = 0;
                for (i, pixel) in image.pixels.iter().enumerate() {
                    let (x, y) = (i % size[0], i / size[0]);
                    let is_on = plates.iter().any(|p| {
                        (p.plate.left..p.plate.right()).contains(&x)
                            && (p.plate.top..p.plate.bottom()).contains(&y)
                    });
                    assert!(pixel.iter().all(|c| (0.0..=1.0).contains(c)));
                    if !is_on {
                        assert_eq!(*pixel, [value(i); 4]);
                    } else if *pixel != [value(i); 4] {
                        changed += 1;
                    }
                }
                let area: usize = plates.iter().map(|p| p.plate.width * p.plate.height).sum();
                // A pixel may by chance have had its new colour before: one level of 251 on the plate.
                assert!(changed > area * 98 / 100);
                for plate in &plates {
                    let lines = plate.marks.iter().map(|m| &m.label).chain(&plate.titles);
                    for line in lines {
                        assert!(line.left >= plate.plate.left && line.top >= plate.plate.top);
                        let right = line.left + plate.font.width_px(&line.text);
                        assert!(right <= plate.plate.right());
                        assert!(line.top + plate.font.line_px() <= plate.plate.bottom());
                    }
                    assert!(plate.plate.right() < size[0] && plate.plate.bottom() < size[1]);
                    for pair in plate.marks.windows(2) {
                        // Labels do not touch: capitals are 3/4 of a line high.
                        let apart = pair[0].label.top - pair[1].label.top;
                        assert!(4 * apart > 3 * plate.font.line_px(), "{apart}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_curve_is_the_opacity() {
        // The opacity rises linearly from 0 to .2.
        let bar = viridis_bar("p", [0.0, 1.0]);
        for (fraction, share) in [(0.0, 0.0), (0.25, 0.25), (1.0, 1.0)] {
            assert!((bar.at(fraction).1.unwrap() - share).abs() < 1e-3);
        }
        let size = [512, 512];
        let mut image = Image::new(size[0], size[1]);
        draw_legend(std::slice::from_ref(&bar), &mut image).unwrap();
        let plate = &layout(std::slice::from_ref(&bar), size).unwrap()[0];
        let ink = |row: usize| -> f32 {
            let columns = plate.bar.left - plate.curve..plate.bar.left - 1;
            let y = plate.bar.top + row;
            columns.map(|x| image.pixel(x, y)[0]).sum::<f32>() / OUTLINE
        };
        let most = (plate.curve - 2) as f32;
        let rows = plate.bar.height;
        for row in [0, rows / 2, rows - 1] {
            let share = 1.0 - (row as f32 + 0.5) / rows as f32;
            // The table interpolates extinctions, not opacities.
            assert!((ink(row) - share * most).abs() < 0.01 * most, "{row}");
        }
    }

    #[test]
    fn pictures_too_small_are_refused() {
        let bar = [viridis_bar("density", [0.0, 1.0])];
        assert!(check_legend_size(&bar, [60, 512]).is_err());
        assert!(check_legend_size(&bar, [512, 100]).is_err());
        let error = check_legend_size(&bar, [0, 0]).unwrap_err().to_string();
        // The size that the error asks for is sufficient.
        let numbers: Vec<usize> = error.split(' ').filter_map(|w| w.parse().ok()).collect();
        assert!(
            check_legend_size(&bar, [numbers[0], numbers[1]]).is_ok(),
            "{error}"
        );
        let mut image = Image::new(32, 32);
        assert!(draw_legend(&bar, &mut image).is_err());
        assert_eq!(image, Image::new(32, 32));
        assert!(draw_legend(&[], &mut image).is_ok());
        assert_eq!(image, Image::new(32, 32));
        let many = vec![bar[0].clone(); 40];
        assert!(check_legend_size(&many, [1024, 1024]).is_err());
    }
}
