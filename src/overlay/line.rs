//! Draws lines into pictures: anti-aliased, with round ends.

use glam::DVec2;

use super::blend;
use crate::image::Image;

/// A line between two points, pixel coordinates (the centre of pixel (i, j) is (i + 0.5, j + 0.5)).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stroke {
    /// Start of the line.
    pub(crate) from: DVec2,
    /// End of the line.
    pub(crate) to: DVec2,
    /// Width, pixels.
    pub(crate) width_px: f64,
}

impl Stroke {
    /// Draws the line.
    ///
    /// The coverage of a pixel is the distance of its centre inside the outline, from half a pixel outside to
    /// half a pixel inside. It is exact for lines along the axes that are at least a pixel wide, and accurate
    /// to about a tenth for others.
    ///
    /// - `colour`: linear.
    /// - `opacity`: opacity of the line where it covers a pixel.
    pub(crate) fn draw(&self, image: &mut Image, colour: [f32; 3], opacity: f32) {
        let radius = self.width_px / 2.0;
        let reach = radius + 0.5;
        let Some([from, to]) = self.within(image, reach + 1.0) else {
            return;
        };
        let [r, g, b] = colour;
        let along = to - from;
        // Steep lines are drawn row by row, others column by column.
        let is_steep = along.y.abs() > along.x.abs();
        let turned = |p: DVec2| if is_steep { DVec2::new(p.y, p.x) } else { p };
        let size = turned(DVec2::new(image.width as f64, image.height as f64));
        let (a, b_) = (turned(from), turned(to));
        let (a, b_) = if a.x <= b_.x { (a, b_) } else { (b_, a) };
        let slope = if b_.x > a.x {
            (b_.y - a.y) / (b_.x - a.x)
        } else {
            0.0
        };
        // Half of the extent of the line's band, and of its round end, across the direction of iteration.
        let across = reach * (1.0 + slope * slope).sqrt() + 1.0;
        for i in pixels(a.x - reach, b_.x + reach, size.x) {
            let x = i as f64 + 0.5;
            let middle = a.y + slope * (x.clamp(a.x, b_.x) - a.x);
            for j in pixels(middle - across, middle + across, size.y) {
                let centre = DVec2::new(x, j as f64 + 0.5);
                let coverage = (reach - distance(centre, a, b_)).clamp(0.0, 1.0);
                if coverage > 0.0 {
                    let (column, row) = if is_steep { (j, i) } else { (i, j) };
                    let pixel = &mut image.pixels[row * image.width + column];
                    #[expect(clippy::cast_possible_truncation, reason = "a share of one")]
                    blend(pixel, [r, g, b, 1.0], coverage as f32 * opacity);
                }
            }
        }
    }

    /// Returns the part of the line in the picture, widened by `margin` pixels, so that long lines take no
    /// extra work: Liang and Barsky 1984.
    fn within(&self, image: &Image, margin: f64) -> Option<[DVec2; 2]> {
        let along = self.to - self.from;
        if !(self.from.is_finite() && along.is_finite()) {
            return None;
        }
        let high = DVec2::new(image.width as f64, image.height as f64) + margin;
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for (p, d, high) in [
            (self.from.x, along.x, high.x),
            (self.from.y, along.y, high.y),
        ] {
            let (enters, leaves) = match d {
                0.0 if (-margin..=high).contains(&p) => continue,
                0.0 => return None,
                d if d > 0.0 => ((-margin - p) / d, (high - p) / d),
                d => ((high - p) / d, (-margin - p) / d),
            };
            first = first.max(enters);
            last = last.min(leaves);
        }
        (first <= last).then(|| [self.from + along * first, self.from + along * last])
    }
}

/// Returns the pixels among `count` whose centres lie between two coordinates.
fn pixels(low: f64, high: f64, count: f64) -> std::ops::Range<usize> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 to the picture's side"
    )]
    let whole = |x: f64| x.clamp(0.0, count) as usize;
    whole((low - 0.5).ceil())..whole((high - 0.5).floor() + 1.0)
}

/// Returns the distance from a point to the line between two others.
fn distance(p: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = b - a;
    let share = (p - a).dot(along) / along.length_squared();
    // A line without length is a dot.
    let share = if share.is_finite() {
        share.clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p - (a + along * share)).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the coverage of all pixels.
    fn ink(stroke: &Stroke, size: [usize; 2]) -> Image {
        let mut image = Image::new(size[0], size[1]);
        stroke.draw(&mut image, [1.0; 3], 1.0);
        image
    }

    /// Each pixel's coverage is that of its distance from the whole line, also where rows and columns are
    /// skipped and where the line runs far out of the picture.
    #[test]
    fn coverage_is_that_of_the_distance() {
        let size = [40, 30];
        for (from, to) in [
            ([4.0, 5.0], [35.0, 22.0]),
            ([30.5, 28.0], [28.0, 2.0]),
            ([3.0, 25.0], [3.0, 25.0]),
            ([20.0, 4.0], [20.0, 26.0]),
            ([38.0, 15.0], [2.0, 15.0]),
            ([-1e7, -3e6], [2e7, 6e6 + 20.0]),
            ([10.0, -1e9], [11.0, 1e9]),
            ([-50.0, -50.0], [-10.0, 90.0]),
        ] {
            for width_px in [1.0, 2.5, 6.0] {
                let stroke = Stroke {
                    from: from.into(),
                    to: to.into(),
                    width_px,
                };
                let image = ink(&stroke, size);
                for (i, pixel) in image.pixels.iter().enumerate() {
                    let centre = DVec2::new((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5);
                    let far = distance(centre, stroke.from, stroke.to);
                    let expected = (width_px / 2.0 + 0.5 - far).clamp(0.0, 1.0);
                    // Coordinates of 1e9 are accurate to 1e-7; the cut at the picture's edges adds a few such
                    // errors.
                    let error = (f64::from(pixel[3]) - expected).abs();
                    assert!(error < 1e-5, "{from:?} {to:?}: {error}");
                }
            }
        }
    }

    #[test]
    fn a_straight_line_has_its_area() {
        let stroke = Stroke {
            from: DVec2::new(5.25, 10.0),
            to: DVec2::new(25.75, 10.0),
            width_px: 3.0,
        };
        let image = ink(&stroke, [40, 20]);
        let column = |x: usize| (0..20).map(|y| image.pixel(x, y)[0]).sum::<f32>();
        assert!((column(15) - 3.0).abs() < 1e-6);
    }

    #[test]
    fn no_number_is_no_line() {
        let stroke = Stroke {
            from: DVec2::new(f64::NAN, 0.0),
            to: DVec2::new(5.0, f64::INFINITY),
            width_px: 3.0,
        };
        assert_eq!(ink(&stroke, [8, 8]), Image::new(8, 8));
    }
}
