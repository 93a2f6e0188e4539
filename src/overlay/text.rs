//! Draws text into pictures: Noto Sans Mono from prerasterised bitmaps.

use noto_sans_mono_bitmap::{
    FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width,
};

/// Available sizes, ascending.
const HEIGHTS: [RasterHeight; 4] = [
    RasterHeight::Size16,
    RasterHeight::Size20,
    RasterHeight::Size24,
    RasterHeight::Size32,
];

/// Replaces characters that the font lacks.
const UNKNOWN: char = '?';

/// A size of text: an available size, enlarged by a whole number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Font {
    height: RasterHeight,
    enlargement: usize,
}

impl Font {
    /// Returns the largest font whose lines are at most `line_px` high, or else the smallest.
    pub(crate) fn of_line(line_px: usize) -> Self {
        let enlargement = (line_px / RasterHeight::Size32.val()).max(1);
        let fits = |h: &&RasterHeight| h.val() * enlargement <= line_px;
        Self {
            height: *HEIGHTS.iter().rev().find(fits).unwrap_or(&HEIGHTS[0]),
            enlargement,
        }
    }

    /// Returns the distance between lines, pixels.
    pub(crate) fn line_px(self) -> usize {
        self.height.val() * self.enlargement
    }

    /// Returns the distance between characters, pixels.
    pub(crate) fn advance_px(self) -> usize {
        get_raster_width(FontWeight::Regular, self.height) * self.enlargement
    }

    /// Returns the width of a text, pixels.
    pub(crate) fn width_px(self, text: &str) -> usize {
        text.chars().count() * self.advance_px()
    }

    /// Shortens a text to at most `width_px`: two dots replace its end if it is longer.
    pub(crate) fn shortened(self, text: &str, width_px: usize) -> String {
        let most = width_px / self.advance_px();
        if text.chars().count() <= most {
            return text.to_owned();
        }
        let kept = text.chars().take(most.saturating_sub(2));
        kept.chain("..".chars().take(most)).collect()
    }

    /// Wraps a text into at most `most_lines` lines of at most `width_px`. It breaks after spaces, underscores,
    /// dots, slashes and hyphens if possible. Two dots replace the end of a last line that is too long.
    pub(crate) fn wrapped(self, text: &str, width_px: usize, most_lines: usize) -> Vec<String> {
        let most = width_px / self.advance_px();
        let mut rest: Vec<char> = text.chars().collect();
        let mut lines = Vec::new();
        while lines.len() + 1 < most_lines && rest.len() > most {
            let is_break = |c: &char| matches!(c, ' ' | '_' | '.' | '/' | '-');
            let after = rest[..most].iter().rposition(is_break).map(|i| i + 1);
            // No break that would leave only a letter or two in the first line.
            let end = after.filter(|end| 3 * end >= most).unwrap_or(most).max(1);
            let others = rest.split_off(end);
            lines.push(rest.into_iter().collect::<String>().trim_end().to_owned());
            rest = others;
        }
        let last: String = rest.into_iter().collect();
        lines.push(self.shortened(last.trim_start(), width_px));
        lines
    }

    /// Calls `pixel` with the column, the row and the coverage, 0 to 1, of each pixel that a text touches. All
    /// lie within the text's width and its line.
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

    /// Interpolates the coverage of a pixel of an enlarged character between the four pixels around its centre.
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
    fn long_texts_are_wrapped_at_words_and_then_shortened() {
        let font = Font::of_line(16);
        let wrapped = |text: &str, columns: usize, lines| {
            font.wrapped(text, columns * font.advance_px(), lines)
        };
        assert_eq!(wrapped("density", 8, 2), ["density"]);
        assert_eq!(
            wrapped("velocity magnitude", 12, 2),
            ["velocity", "magnitude"]
        );
        assert_eq!(wrapped("grad_rho_norm", 10, 2), ["grad_rho_", "norm"]);
        assert_eq!(wrapped("velocity magnitude", 12, 1), ["velocity m.."]);
        assert_eq!(
            wrapped("velocity of the magnitude", 9, 2),
            ["velocity", "of the .."]
        );
        // No word ends nearby, so the break is within one.
        assert_eq!(wrapped("a_verylongword", 9, 2), ["a_verylon", "gword"]);
        assert_eq!(wrapped("", 9, 2), [""]);
    }

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
        // Bilinear enlargement by 3 gives nine times the ink, except at a character's edge.
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
