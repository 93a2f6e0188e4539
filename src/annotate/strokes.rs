//! Plates and strokes that annotations share.

use crate::image::Image;
use crate::overlay::{Font, PLATE_OPACITY, Rect, Stroke, fill};

/// Linear grey level of dark rims.
pub(super) const RIM: [f32; 3] = [0.0; 3];

/// Returns the distance between drawings and the picture's edges, and between text and the ends of its plate,
/// pixels.
pub(super) fn gap(font: Font) -> usize {
    font.line_px() / 2
}

/// Returns the distance between text and the upper and lower edges of its plate, pixels.
pub(super) fn rim(font: Font) -> usize {
    font.line_px() / 4
}

/// Returns the width of lines, pixels.
pub(super) fn thickness_px(font: Font) -> f64 {
    font.line_px() as f64 / 14.0
}

pub(super) fn fill_plate(image: &mut Image, plate: Rect) {
    fill(image, plate, [0.0, 0.0, 0.0, 1.0], PLATE_OPACITY);
}

/// Draws lines with a common dark rim.
pub(super) fn draw_rimmed(image: &mut Image, strokes: &[Stroke], colour: [f32; 3], opacity: f32) {
    /// Opacity of a rim relative to its line's: visible, and on white a third of the light remains.
    const RIM_OPACITY: f32 = 0.65;
    for stroke in strokes {
        let rim = Stroke {
            width_px: 3.0 * stroke.width_px,
            ..*stroke
        };
        rim.draw(image, RIM, opacity * RIM_OPACITY);
    }
    for stroke in strokes {
        stroke.draw(image, colour, opacity);
    }
}
