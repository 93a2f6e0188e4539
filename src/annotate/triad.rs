//! Draws the world's axes as a camera sees them.

use glam::{DVec2, DVec3};

use crate::annotate::strokes::{RIM, draw_rimmed, gap, thickness_px};
use crate::image::Image;
use crate::overlay::{Font, Line, PLATE_OPACITY, Stroke};
use crate::view::Camera;

/// Length of an axis perpendicular to the view, in lines of text.
const ARM_LINES: f64 = 1.75;
/// Distance from the tip of such an axis to the middle of its letter, in lines of text.
const LETTER_LINES: f64 = 0.65;
/// Radius of the disc behind a letter, in lines of text.
const DISC_LINES: f64 = 0.5;

/// An axis: its direction on the picture, letter and colour.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axis {
    letter: char,
    /// The axis's unit vector on the picture, x to the right and y down. It is shorter than 1 if the axis
    /// points towards the eye or away from it.
    direction: DVec2,
    /// Depth of the tip behind the origin, as a share of the axis's length.
    depth: f64,
    colour: [f32; 3],
}

/// Three axes from one point.
#[derive(Debug, Clone)]
pub(super) struct Triad {
    /// The origin, pixel coordinates.
    centre: DVec2,
    /// Length of an axis perpendicular to the view, pixels.
    arm_px: f64,
    /// The axes, farthest first: nearer ones are drawn over them.
    axes: [Axis; 3],
}

impl Triad {
    /// Returns the side of the square that contains the triad in any rotation, pixels.
    pub(super) fn side(font: Font) -> usize {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a few lines of text"
        )]
        let radius = (font.line_px() as f64 * (ARM_LINES + LETTER_LINES + DISC_LINES)) as usize + 1;
        2 * radius
    }

    /// Places a triad in the lower left corner of a camera's picture.
    pub(super) fn of(camera: &Camera, font: Font) -> Self {
        let middle = (gap(font) + Self::side(font) / 2) as f64;
        let axis = |letter, axis: DVec3, colour| {
            let turned = camera.camera_from_world * axis;
            Axis {
                letter,
                direction: turned.truncate(),
                depth: turned.z,
                colour,
            }
        };
        // About equally bright to the eye: the blue has some green.
        let mut axes = [
            axis('x', DVec3::X, [1.0, 0.12, 0.1]),
            axis('y', DVec3::Y, [0.2, 0.8, 0.15]),
            axis('z', DVec3::Z, [0.15, 0.4, 1.0]),
        ];
        axes.sort_by(|a, b| b.depth.total_cmp(&a.depth));
        Self {
            centre: DVec2::new(middle, camera.height as f64 - middle),
            arm_px: font.line_px() as f64 * ARM_LINES,
            axes,
        }
    }

    /// Returns the pixels that the triad may touch.
    #[cfg(test)]
    pub(super) fn square(&self) -> crate::overlay::Rect {
        let half = self.arm_px / ARM_LINES * (ARM_LINES + LETTER_LINES + DISC_LINES);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "within a picture"
        )]
        let whole = |x: f64| x as usize;
        let low = self.centre - (half.floor() + 1.0);
        crate::overlay::Rect {
            left: whole(low.x),
            top: whole(low.y),
            width: 2 * (whole(half) + 1),
            height: 2 * (whole(half) + 1),
        }
    }

    /// Returns the end of an axis, pixel coordinates.
    fn tip(&self, axis: &Axis) -> DVec2 {
        self.centre + axis.direction * self.arm_px
    }

    pub(super) fn draw(&self, image: &mut Image, font: Font) {
        let line_px = font.line_px() as f64;
        for axis in &self.axes {
            let stroke = Stroke {
                from: self.centre,
                to: self.tip(axis),
                width_px: 1.5 * thickness_px(font),
            };
            draw_rimmed(image, &[stroke], axis.colour, 1.0);
            let middle = self.tip(axis) + axis.direction * (LETTER_LINES * line_px);
            let disc = Stroke {
                from: middle,
                to: middle,
                width_px: 2.0 * DISC_LINES * line_px - 1.0,
            };
            disc.draw(image, RIM, PLATE_OPACITY);
            let text = axis.letter.to_string();
            let left = middle.x - font.width_px(&text) as f64 / 2.0;
            // Small letters are centred in the lower half of a line.
            let top = middle.y - 0.55 * line_px;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "within the picture: in the triad's square"
            )]
            let whole = |x: f64| x.round() as usize;
            let line = Line {
                text,
                left: whole(left),
                top: whole(top),
            };
            line.draw(font, image);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::cameras;
    use super::*;
    use crate::overlay::font_of;
    use crate::view::Projection;

    /// A short step along an axis from a point on the optical axis moves on the picture like the triad's axis:
    /// in the same direction, and with lengths in the same ratio.
    #[test]
    fn tips_lie_where_the_camera_sees_the_axes() {
        const STEP: f64 = 1e-6;
        for size in [[300, 200], [1024, 1024]] {
            for camera in cameras(size) {
                let font = font_of(size);
                let triad = Triad::of(&camera, font);
                let distance = 3.0;
                let origin = camera.eye + camera.forward() * distance;
                let px = match camera.projection {
                    Projection::Perspective => camera.focal_px.x / distance,
                    Projection::Orthographic => camera.focal_px.x,
                };
                for axis in &triad.axes {
                    let vector = match axis.letter {
                        'x' => DVec3::X,
                        'y' => DVec3::Y,
                        _ => DVec3::Z,
                    };
                    let project = |p| camera.project(p).unwrap();
                    let ends = [-STEP, STEP].map(|step| project(origin + vector * step));
                    let seen = (ends[1] - ends[0]) / (2.0 * STEP * px);
                    let drawn = (triad.tip(axis) - triad.centre) / triad.arm_px;
                    // Pixel coordinates near 1e3 are accurate to 1e-13; steps of 1e-6 leave 1e-7 of that.
                    assert!((seen - drawn).length() < 1e-6, "{seen} {drawn}");
                    let behind = camera.camera_point(origin + vector).z - distance;
                    assert!((behind - axis.depth).abs() < 1e-12);
                }
                let depths = triad.axes.map(|axis| axis.depth);
                assert!(depths.is_sorted_by(|a, b| a >= b), "{depths:?}");
            }
        }
    }

    /// The farthest axis is drawn first: with y towards the eye, y's colour is in the middle.
    #[test]
    fn the_nearest_axis_is_drawn_over_the_others() {
        let size = [300, 300];
        let eye = DVec3::new(0.2, 9.0, 0.1);
        let camera = Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 4.0, size);
        let triad = Triad::of(&camera, font_of(size));
        assert_eq!(triad.axes[2].letter, 'y');
        let mut image = Image::new(size[0], size[1]);
        triad.draw(&mut image, font_of(size));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "x's tip"
        )]
        let [x, y] = triad
            .tip(triad.axes.iter().find(|a| a.letter == 'x').unwrap())
            .to_array()
            .map(|c| c as usize);
        let [r, g, ..] = image.pixel(x, y);
        assert!(r > 3.0 * g && r > 0.2, "{r} {g}");
    }
}
