//! Column densities to files, by extension.
//!
//! | extension | numbers |
//! |---|---|
//! | `.npy` | f32 (height, width), rows from the top |
//! | `.pfm` | f32 grey, rows from the bottom |
//! | `.exr` | f32, one channel Y |
//! | `.png` | a picture: viridis over the logarithm, nothing and next to nothing transparent |

use std::path::Path;

use super::atomic::write_bytes_atomically;
use super::image_file::{IMAGE_EXTENSIONS, check_size, grey_bytes, png_bytes, unknown_extension};
use crate::error::Result;
use crate::image::{ColumnImage, Image, linear_from_srgb};

/// Writes a column density in the format that the extension names: `npy`, `pfm`, `exr` (channel
/// Y) hold the values, `png` a picture of them, its colours over
/// [`ColumnImage::shown_range`]; what is less is transparent.
///
/// # Errors
/// As [`write_image`](super::write_image).
pub fn write_column(path: &Path, column: &ColumnImage) -> Result<()> {
    let (width, height) = (column.width, column.height);
    check_size(path, width, height, column.values.len())?;
    let bytes = if super::extension(path) == "png" {
        png_bytes(path, &column_picture(column))?
    } else {
        grey_bytes(
            path,
            [width, height],
            &column.values,
            ["Y", "column density"],
        )
        .ok_or_else(|| unknown_extension(path, IMAGE_EXTENSIONS))??
    };
    write_bytes_atomically(path, &bytes)
}

/// Viridis over 0 to 1: linear RGB, opaque.
pub(crate) fn viridis() -> impl Fn(f32) -> [f32; 4] {
    use colorgrad::Gradient;
    let map = colorgrad::preset::viridis();
    move |fraction| {
        let [r, g, b, _] = map.at(fraction.clamp(0.0, 1.0)).to_array();
        let [r, g, b] = [r, g, b].map(linear_from_srgb);
        [r, g, b, 1.0]
    }
}

/// The picture of a column density that [`write_column`] writes to a `png`; an empty one where the
/// values are fewer or more than the pixels.
pub fn column_picture(column: &ColumnImage) -> Image {
    if column.width.checked_mul(column.height) != Some(column.values.len()) {
        return Image::new(0, 0);
    }
    let colour_of = viridis();
    let mut picture = Image::new(column.width, column.height);
    let Some([least, greatest]) = column.shown_range() else {
        return picture;
    };
    let (first, span) = (least.log10(), greatest.log10() - least.log10());
    for (pixel, &value) in picture.pixels.iter_mut().zip(&column.values) {
        if value >= least {
            // One value alone is the greatest.
            let fraction = if span > 0.0 {
                (value.log10() - first) / span
            } else {
                1.0
            };
            *pixel = colour_of(fraction);
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_logarithmic_and_nothing_is_transparent() {
        let column = ColumnImage {
            width: 6,
            height: 1,
            values: vec![0.0, -3.0, 1e-9, 1e-4, 1e-2, 1.0],
            pixel_area: None,
        };
        let pixels = column_picture(&column).pixels;
        assert_eq!(pixels[..3], [[0.0; 4]; 3]);
        // Viridis: #440154 and #fde725; in the middle the preset has #26838f, where matplotlib's
        // table has #21918c. Its spline leaves its ends and middle by a level or two of 255.
        for (pixel, code) in pixels[3..]
            .iter()
            .zip([[68, 1, 84], [38, 131, 143], [253, 231, 37]])
        {
            for (linear, code) in pixel.iter().zip(code) {
                let level = crate::image::srgb_from_linear(*linear) * 255.0;
                assert!((level - code as f32).abs() < 3.0, "{pixel:?}: {code}");
            }
        }
    }
}
