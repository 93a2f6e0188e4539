//! Text in pictures: Noto Sans Mono, rasterised beforehand.

use noto_sans_mono_bitmap::{
    FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width,
};

/// Sizes that there are, ascending.
const HEIGHTS: [RasterHeight; 4] = [
    RasterHeight::Size16,
    RasterHeight::Size20,
    RasterHeight::Size24,
    RasterHeight::Size32,
];

/// Stands for a character that the font has not.
const UNKNOWN: char = '?';

/// A size of text: one that there is, enlarged by a whole number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Font {
    height: RasterHeight,
    enlargement: usize,
}

impl Font {
    /// The largest whose lines are no higher than `line_px`, or the smallest there is.
    pub(crate) fn of_line(line_px: usize) -> Self {
        let enlargement = (line_px / RasterHeight::Size32.val()).max(1);
        let fits = |h: &&RasterHeight| h.val() * enlargement <= line_px;
        Self {
            height: *HEIGHTS.iter().rev().find(fits).unwrap_or(&HEIGHTS[0]),
            enlargement,
        }
    }

    /// From one line to the next, pixels.
    pub(crate) fn line_px(self) -> usize {
        self.height.val() * self.enlargement
    }

    /// From one character to the next, pixels.
    pub(crate) fn advance_px(self) -> usize {
        get_raster_width(FontWeight::Regular, self.height) * self.enlargement
    }

    /// The width of a text, pixels.
    pub(crate) fn width_px(self, text: &str) -> usize {
        text.chars().count() * self.advance_px()
    }

    /// A text of at most `width_px`: its end gives way to two points where it is longer.
    pub(crate) fn shortened(self, text: &str, width_px: usize) -> String {
        let most = width_px / self.advance_px();
        if text.chars().count() <= most {
            return text.to_owned();
        }
        let kept = text.chars().take(most.saturating_sub(2));
        kept.chain("..".chars().take(most)).collect()
    }

    /// Calls `pixel` with the column, the row and the coverage, 0 to 1, of each pixel that a text
    /// touches; all lie within its width and its line.
    pub(crate) fn draw(self, text: &str, mut pixel: impl FnMut(usize, usize, f32)) {
        for (i, character) in text.chars().enumerate() {
            let glyph = get_raster(character, FontWeight::Regular, self.height)
                .or_else(|| get_raster(UNKNOWN, FontWeight::Regular, self.height));
            let Some(glyph) = glyph else { continue };
            for y in 0..self.line_px() {
                for x in 0..self.advance_px() {
                    let coverage = self.coverage(&glyph, x, y);
                    if coverage > 0.0 {
                        pixel(i * self.advance_px() + x, y, coverage);
                    }
                }
            }
        }
    }

    /// Of a pixel of an enlarged character: between the four pixels around its centre.
    fn coverage(self, glyph: &RasterizedChar, x: usize, y: usize) -> f32 {
        let at = |px: usize| (px as f32 + 0.5) / self.enlargement as f32 - 0.5;
        let (x, y) = (at(x), at(y));
        let of = |x: f32, y: f32| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "small whole numbers; what is below 0 has no ink"
            )]
            let ink = (x >= 0.0 && y >= 0.0).then(|| glyph.pixel(x as usize, y as usize));
            f32::from(ink.flatten().unwrap_or(0)) / 255.0
        };
        let (left, top) = (x.floor(), y.floor());
        let (s, t) = (x - left, y - top);
        let row = |y: f32| {
            let right = if s > 0.0 { of(left + 1.0, y) } else { 0.0 };
            of(left, y) * (1.0 - s) + right * s
        };
        let below = if t > 0.0 { row(top + 1.0) } else { 0.0 };
        row(top) * (1.0 - t) + below * t
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fonts_fit_their_lines() {
        let heights = [1, 16, 19, 20, 31, 32, 63, 64, 200].map(|px| Font::of_line(px).line_px());
        assert_eq!(heights, [16, 16, 16, 20, 24, 32, 32, 64, 192]);
    }

    #[test]
    fn ink_lies_within_the_text_and_grows_with_it() {
        let ink = |font: Font, text: &str| {
            let mut sum = 0.0;
            font.draw(text, |x, y, coverage| {
                assert!(x < font.width_px(text) && y < font.line_px());
                assert!(coverage > 0.0 && coverage <= 1.0);
                sum += f64::from(coverage);
            });
            sum
        };
        let (small, large) = (Font::of_line(32), Font::of_line(96));
        let text = "Ag|_É 0.5e-7 ρ";
        assert!(ink(small, text) > 100.0);
        // Bilinear enlargement by 3 keeps nine times the ink, but for what passes a character's edge.
        let ratio = ink(large, text) / ink(small, text);
        assert!((ratio - 9.0).abs() < 0.1, "{ratio}");
        assert_eq!(ink(small, " "), 0.0);
        assert_eq!(ink(small, "ρ"), ink(small, "?"));
    }

    #[test]
    fn long_texts_are_shortened() {
        let font = Font::of_line(16);
        let width = |n: usize| n * font.advance_px();
        assert_eq!(font.shortened("density", width(7)), "density");
        assert_eq!(font.shortened("velocity", width(7)), "veloc..");
        assert_eq!(font.shortened("äöü", width(2)), "..");
        assert_eq!(font.shortened("äöü", 0), "");
    }
}
