//! Writes kernel counts to files, as numbers or in colours; the extension chooses the format.

use std::borrow::Cow;
use std::path::Path;

use super::column_file::viridis;
use super::image_file::write_image;
use crate::error::Result;
use crate::image::Image;
use crate::io::bytes::file::extension;

/// Writes the image of [`Show::Count`](crate::Show::Count). `exr`, `pfm` and `npy` store the numbers as [`write_image`]
/// writes pixels. `png` stores viridis colours from 0 to the greatest number.
///
/// # Errors
/// The errors of [`write_image`].
pub fn write_count(path: &Path, count: &Image) -> Result<()> {
    write_image(path, &shown_count(path, count))
}

/// Returns the pixels that stand for counts in a file: the numbers, or colours in `png`.
pub(crate) fn shown_count<'a>(path: &Path, count: &'a Image) -> Cow<'a, Image> {
    match extension(path) == "png" {
        true => Cow::Owned(picture(count)),
        false => Cow::Borrowed(count),
    }
}

fn picture(count: &Image) -> Image {
    let colour_of = viridis();
    let greatest = count.pixels.iter().map(|p| p[0]).fold(0.0, f32::max);
    // If all counts are zero, this scale keeps them zero.
    let scale = 1.0 / greatest.max(1.0);
    Image {
        pixels: count
            .pixels
            .iter()
            .map(|p| colour_of(p[0] * scale))
            .collect(),
        ..*count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_linear_from_zero() {
        let of = |counts: &[f32]| {
            picture(&Image {
                width: counts.len(),
                height: 1,
                pixels: counts.iter().map(|&n| [n, n, n, 1.0]).collect(),
            })
            .pixels
        };
        let colour = viridis();
        assert_eq!(
            of(&[0.0, 2.0, 8.0, 4.0]),
            [0.0, 0.25, 1.0, 0.5].map(&colour)
        );
        assert_eq!(of(&[0.0; 3]), [colour(0.0); 3]);
    }
}
