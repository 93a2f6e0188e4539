//! Draws a scale bar of a round length.

use glam::{DVec2, DVec3};

use crate::annotate::strokes::{fill_plate, gap, rim, thickness_px};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::overlay::{Font, Line, Rect, Stroke};
use crate::view::{Camera, Projection};

/// Greatest share of a picture's width for a bar; its least share is two fifths of that.
const GREATEST_SHARE: f64 = 0.2;

/// A bar with its label above, in the lower right corner.
#[derive(Debug, Clone)]
pub(super) struct ScaleBar {
    pub(super) plate: Rect,
    label: Line,
    /// Ends of the bar, pixel coordinates.
    ends: [DVec2; 2],
    /// Height of the marks at the ends, pixels.
    mark_px: f64,
}

impl ScaleBar {
    /// # Errors
    /// A point at which the camera sees no length.
    pub(super) fn of(camera: &Camera, point: DVec3, font: Font) -> Result<Self> {
        let z = camera.camera_point(point).z;
        let px = match camera.projection {
            Projection::Perspective => camera.focal_px.x / z,
            Projection::Orthographic => camera.focal_px.x,
        };
        let greatest = GREATEST_SHARE * camera.width as f64 / px;
        if !(px > 0.0 && greatest > 0.0 && greatest.is_finite()) {
            return Err(Error::invalid(
                "scale bar",
                "camera",
                "data whose centre lies in front of the eye",
                format!("a distance of {z:.3e}"),
                "move the eye, or leave the bar out",
            ));
        }
        let (length, text) = round(greatest);
        let (gap, rim) = (gap(font), rim(font));
        let mark_px = font.line_px() as f64 / 3.0;
        let length_px = length * px;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a part of a picture's width, a part of a line"
        )]
        let whole = |x: f64| x.ceil() as usize;
        // Includes the width of the marks.
        let bar_px = whole(length_px + 2.0 * thickness_px(font)) + 1;
        let inner = bar_px.max(font.width_px(&text));
        let plate_height = rim + font.line_px() + whole(mark_px) + 2 * rim;
        let plate = Rect {
            left: camera.width.saturating_sub(gap + inner + 2 * gap),
            top: camera.height.saturating_sub(gap + plate_height),
            width: inner + 2 * gap,
            height: plate_height,
        };
        let middle = plate.left as f64 + plate.width as f64 / 2.0;
        let y = (plate.bottom() - rim) as f64 - mark_px / 2.0;
        let half = DVec2::new(length_px / 2.0, 0.0);
        let label = Line {
            left: plate.left + (plate.width - font.width_px(&text)) / 2,
            top: plate.top + rim,
            text,
        };
        Ok(Self {
            plate,
            label,
            ends: [DVec2::new(middle, y) - half, DVec2::new(middle, y) + half],
            mark_px,
        })
    }

    /// Returns width and height, pixels.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.plate.width, self.plate.height)
    }

    pub(super) fn draw(&self, image: &mut Image, font: Font) {
        fill_plate(image, self.plate);
        self.label.draw(font, image);
        let width_px = 1.5 * thickness_px(font);
        let [from, to] = self.ends;
        let up = DVec2::new(0.0, self.mark_px / 2.0 - width_px / 2.0);
        for (from, to) in [(from, to), (from - up, from + up), (to - up, to + up)] {
            let stroke = Stroke { from, to, width_px };
            stroke.draw(image, [1.0; 3], 1.0);
        }
    }
}

/// Returns the greatest of 1, 2 and 5 times a power of ten that does not exceed a positive number, and its
/// text.
fn round(greatest: f64) -> (f64, String) {
    #[expect(clippy::cast_possible_truncation, reason = "-324 to 308")]
    let exponent = greatest.log10().floor() as i32;
    // The logarithm may be off by a rounding error.
    let mut best = (f64::MIN_POSITIVE, String::new());
    for e in exponent - 1..=exponent + 1 {
        for digit in [1, 2, 5] {
            let in_powers = format!("{digit}e{e}");
            // The number nearest to the label's.
            let value: f64 = in_powers.parse().unwrap_or(0.0);
            if value <= greatest && value > best.0 {
                let is_plain = (-4..=5).contains(&e);
                best = (
                    value,
                    if is_plain {
                        value.to_string()
                    } else {
                        in_powers
                    },
                );
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::super::tests::cameras;
    use super::*;
    use crate::overlay::font_of;

    #[test]
    fn lengths_are_round() {
        for (greatest, value, text) in [
            (1.0, 1.0, "1"),
            (0.999_999, 0.5, "0.5"),
            (4.99, 2.0, "2"),
            (5.0, 5.0, "5"),
            (1234.0, 1000.0, "1000"),
            (0.000_3, 0.000_2, "0.0002"),
            (0.000_09, 5e-5, "5e-5"),
            (1e3, 1e3, "1000"),
            (7e8, 5e8, "5e8"),
            (3e-300, 2e-300, "2e-300"),
        ] {
            assert_eq!(round(greatest), (value, text.to_string()));
        }
    }

    /// The bar is as long as the distance on the picture between two points that far apart, side by side at the
    /// distance of the data's centre.
    #[test]
    fn the_bar_is_as_long_as_its_length_is_seen() {
        let point = DVec3::new(1.0, 0.5, -0.3);
        for size in [[120, 90], [400, 300], [3000, 1000]] {
            for camera in cameras(size) {
                let bar = ScaleBar::of(&camera, point, font_of(size)).unwrap();
                let length: f64 = bar.label.text.parse().unwrap();
                let right = camera.camera_from_world.row(0);
                let place = |share: f64| camera.project(point + right * length * share).unwrap();
                let seen = (place(0.5) - place(-0.5)).length();
                let drawn = bar.ends[1].x - bar.ends[0].x;
                assert!((drawn - seen).abs() < 1e-9, "{drawn} {seen}");
                let share = drawn / size[0] as f64;
                assert!((0.0799..0.2001).contains(&share), "{share}");

                // The marks are drawn that far apart, too.
                let mut image = Image::new(size[0], size[1]);
                bar.draw(&mut image, font_of(size));
                let ink = |x: usize| {
                    let rows = bar.plate.top + bar.label.top - bar.plate.top
                        + font_of(size).line_px()
                        ..bar.plate.bottom();
                    f64::from(rows.map(|y| image.pixel(x, y)[0]).sum::<f32>())
                };
                let columns = bar.plate.left..bar.plate.right();
                let middle = (bar.ends[0].x + bar.ends[1].x) / 2.0;
                let level = ink(columns.start + bar.plate.width / 2);
                // The centre of mass of the ink that a half has beyond the bar itself: its mark.
                let mark = |is_left: bool| {
                    let (mut sum, mut moment) = (0.0, 0.0);
                    for x in columns.clone() {
                        let centre = x as f64 + 0.5;
                        let more = ink(x) - level;
                        if (centre < middle) == is_left && more > 0.0 {
                            sum += more;
                            moment += more * centre;
                        }
                    }
                    moment / sum
                };
                let apart = mark(false) - mark(true);
                // The inner half of the mark's width overlaps the bar.
                assert!((apart - seen).abs() < 1.0, "{apart} {seen}");
            }
        }
    }

    #[test]
    fn a_centre_behind_the_eye_is_refused() {
        let camera = &cameras([400, 300])[0];
        let font = font_of([400, 300]);
        for point in [camera.eye, camera.eye - camera.forward(), DVec3::NAN] {
            assert!(ScaleBar::of(camera, point, font).is_err());
        }
    }
}
