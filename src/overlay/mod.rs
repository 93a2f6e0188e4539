//! Draws over finished pictures: text, plates behind it, rectangles and lines.
//!
//! Colours are linear and opaque; coverage is the share of the background that they hide.

mod line;
mod text;

pub(crate) use line::Stroke;
pub(crate) use text::Font;

use crate::image::Image;

/// Opacity of a plate, which is black, in linear light. Over white it leaves .15. White text on that has 5.3
/// times its luminance (1.05 / .20 by WCAG 2); legible text needs 4.5.
pub(crate) const PLATE_OPACITY: f32 = 0.85;
/// Height of a line of text as a share of the picture's shorter side, if the font allows it.
const LINE_SHARE: f64 = 1.0 / 40.0;

/// Returns the font for a picture of this width and height.
pub(crate) fn font_of([width, height]: [usize; 2]) -> Font {
    Font::of_line(share(width.min(height), LINE_SHARE))
}

/// Returns a share of a picture's side, in whole pixels.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "shares of a picture's sides"
)]
pub(crate) fn share(side: usize, share: f64) -> usize {
    (side as f64 * share) as usize
}

/// A rectangle of pixels from `left` and `top` on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rect {
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Rect {
    pub(crate) fn right(&self) -> usize {
        self.left + self.width
    }

    pub(crate) fn bottom(&self) -> usize {
        self.top + self.height
    }
}

/// A line of text in the picture.
#[derive(Debug, Clone)]
pub(crate) struct Line {
    pub(crate) text: String,
    pub(crate) left: usize,
    pub(crate) top: usize,
}

impl Line {
    /// Draws the text in white.
    pub(crate) fn draw(&self, font: Font, image: &mut Image) {
        font.draw(&self.text, |x, y, coverage| {
            let pixel = Rect {
                left: self.left + x,
                top: self.top + y,
                width: 1,
                height: 1,
            };
            fill(image, pixel, [1.0; 4], coverage);
        });
    }
}

/// Composites a colour (linear, opaque) over pixels with the given `coverage`. Parts beyond the picture's right
/// and lower edges are ignored.
pub(crate) fn fill(image: &mut Image, rect: Rect, colour: [f32; 4], coverage: f32) {
    let right = rect.right().min(image.width);
    for y in rect.top..rect.bottom().min(image.height) {
        let row = y * image.width;
        for pixel in &mut image.pixels[row + rect.left.min(right)..row + right] {
            blend(pixel, colour, coverage);
        }
    }
}

/// Composites a colour over a pixel.
fn blend(pixel: &mut [f32; 4], colour: [f32; 4], coverage: f32) {
    for (channel, new) in pixel.iter_mut().zip(colour) {
        *channel = if coverage >= 1.0 {
            new
        } else {
            *channel * (1.0 - coverage) + new * coverage
        };
    }
}
