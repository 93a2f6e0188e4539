//! Converts colours of pictures to luma and chroma planes of films.

/// Weights of red and blue in luma, by ITU-R BT.709.
const RED: f64 = 0.2126;
const BLUE: f64 = 0.0722;

/// Fixed-point digits of the conversion.
const BITS: u32 = 16;

/// Luma and chroma of a picture in 4:2:0, a row after another.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Planes {
    /// Luma of each pixel, 16 to 235.
    pub(super) luma: Vec<u8>,
    /// Blue and red chroma, 16 to 240, of half the columns and half the rows, rounded up.
    pub(super) chroma: [Vec<u8>; 2],
}

/// Returns three weights and an offset in fixed point.
fn fixed(weights: [f64; 3], offset: f64) -> [i64; 4] {
    let scale = f64::from(1_u32 << BITS);
    #[expect(clippy::cast_possible_truncation, reason = "below 2^25")]
    [weights[0], weights[1], weights[2], offset].map(|x| (x * scale).round() as i64)
}

/// Converts a picture to planes of BT.709 in limited range.
///
/// Chroma is sited as MPEG-2 and most decoders have it: at every second column, halfway between two rows. It is averaged
/// with weights 1, 2, 1 over columns and 1, 1 over rows. Beyond the picture its last column and row go on.
///
/// - `pixels`: sRGB, `size[0]` x `size[1]`, row by row.
pub(super) fn planes(pixels: &[[u8; 3]], size: [usize; 2]) -> Planes {
    let green = 1.0 - RED - BLUE;
    // Codes 0 to 255 become 219 steps of luma, and 224 of chroma from one end to the other.
    let (steps, half) = (219.0 / 255.0, 112.0 / 255.0);
    let luma_of = fixed([RED * steps, green * steps, BLUE * steps], 16.5);
    let blue = half / (1.0 - BLUE);
    let blue_of = fixed([-RED * blue, -green * blue, half], 128.5);
    let red = half / (1.0 - RED);
    let red_of = fixed([half, -green * red, -BLUE * red], 128.5);
    // A sum of eight weights of colours has three more digits.
    let code = |[r, g, b, offset]: [i64; 4], [x, y, z]: [i64; 3], digits: u32| {
        let sum = r * x + g * y + b * z + (offset << digits);
        u8::try_from(sum >> (BITS + digits)).unwrap_or(0)
    };
    let wide = |pixel: [u8; 3]| pixel.map(i64::from);
    let luma = pixels.iter().map(|pixel| code(luma_of, wide(*pixel), 0));
    let luma = luma.collect();
    let [width, height] = size;
    let halves = [width.div_ceil(2), height.div_ceil(2)];
    let mut chroma = [0, 1].map(|_| Vec::with_capacity(halves[0] * halves[1]));
    for row in 0..halves[1] {
        let rows = [2 * row, (2 * row + 1).min(height - 1)];
        for column in 0..halves[0] {
            let middle = 2 * column;
            let columns = [
                (middle.saturating_sub(1), 1),
                (middle, 2),
                ((middle + 1).min(width - 1), 1),
            ];
            let mut sum = [0; 3];
            for y in rows {
                for (x, weight) in columns {
                    for (sum, c) in sum.iter_mut().zip(wide(pixels[y * width + x])) {
                        *sum += weight * c;
                    }
                }
            }
            chroma[0].push(code(blue_of, sum, 3));
            chroma[1].push(code(red_of, sum, 3));
        }
    }
    Planes { luma, chroma }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours come back from the planes by the standard's own formula, as decoders have it.
    #[test]
    fn flat_colours_come_back() {
        for (colour, codes) in [
            // Table of BT.709 in 8 bits: black, white and the saturated colours.
            ([0, 0, 0], [16, 128, 128]),
            ([255, 255, 255], [235, 128, 128]),
            ([255, 0, 0], [63, 102, 240]),
            ([0, 255, 0], [173, 42, 26]),
            ([0, 0, 255], [32, 240, 118]),
        ] {
            let own = planes(&[colour; 15], [5, 3]);
            assert_eq!(own.luma, [codes[0]; 15], "{colour:?}");
            assert_eq!(own.chroma[0], [codes[1]; 6], "{colour:?}");
            assert_eq!(own.chroma[1], [codes[2]; 6], "{colour:?}");
        }
    }

    /// Chroma of an edge has the weights 1, 2, 1: the second sample stands at the third column.
    #[test]
    fn chroma_stands_at_even_columns() {
        let blue = |n: u8| [0, 0, n];
        let row = [blue(0), blue(0), blue(0), blue(200), blue(200), blue(200)];
        let own = planes(&row, [6, 1]);
        // 128 + 112/255 B: B is 0, 50 and 200.
        assert_eq!(own.chroma[0], [128, 150, 216]);
    }
}
