//! Writes column densities to files; the extension chooses the format.
//!
//! | extension | numbers |
//! |---|---|
//! | `.npy` | f32 (height, width), rows from the top |
//! | `.pfm` | f32 grey, rows from the bottom |
//! | `.exr` | f32, one channel Y |
//! | `.png` | colours: viridis over the logarithm; values below the shown range are transparent |

use std::path::Path;

use super::image_file::{
    IMAGE_EXTENSIONS, check_size, grey_bytes, unknown_extension, write_image_with,
};
use crate::error::Result;
use crate::image::{ColumnImage, Image, linear_from_srgb};
use crate::io::bytes::atomic::write_bytes_atomically;
use crate::io::bytes::file::extension;
use crate::scene::{ScaleName, TransferFunction, is_diverging};

/// Share of the greatest magnitude from which a value below 0 is more than rounding.
const LEAST_SIGNED: f32 = 1e-3;

/// Writes a column density in the format that the extension names. `npy`, `pfm` and `exr` (channel Y) store the values.
/// `png` stores their colours over [`ColumnImage::shown_range`]; lower values are transparent.
///
/// # Errors
/// The errors of [`write_image`](crate::io::write_image).
pub fn write_column(path: &Path, column: &ColumnImage) -> Result<()> {
    write_column_with(path, column, None)
}

/// Writes a column density as [`write_column`] does, with a record of how it was made if the format has a place for it.
pub(crate) fn write_column_with(
    path: &Path,
    column: &ColumnImage,
    record: Option<&str>,
) -> Result<()> {
    let (width, height) = (column.width, column.height);
    check_size(path, width, height, column.values.len())?;
    if extension(path) == "png" {
        let picture = match column_colours(column, None, None, None)? {
            Some(colours) => column_picture(column, &colours),
            None => Image::new(width, height),
        };
        return write_image_with(path, &picture, record);
    }
    let names = ["Y", "column density"];
    let bytes = grey_bytes(path, [width, height], &column.values, names, record)
        .ok_or_else(|| unknown_extension(path, IMAGE_EXTENSIONS))??;
    write_bytes_atomically(path, &bytes)
}

/// Returns the viridis map from 0 to 1: linear RGB, opaque.
pub(crate) fn viridis() -> impl Fn(f32) -> [f32; 4] {
    use colorgrad::Gradient;
    let map = colorgrad::preset::viridis();
    move |fraction| {
        let [r, g, b, _] = map.at(fraction.clamp(0.0, 1.0)).to_array();
        let [r, g, b] = [r, g, b].map(linear_from_srgb);
        [r, g, b, 1.0]
    }
}

/// Returns the colours of a column density as a transfer function over its values; `None` if there is nothing to show.
///
/// - `map`: a colour map's name ([`COLOUR_MAP_NAMES`](crate::scene::COLOUR_MAP_NAMES)); `None` is viridis, or coolwarm for
///   values of both signs.
/// - `range`: range of the values. `None` takes [`ColumnImage::shown_range`] on a logarithmic scale and all values on
///   others, symmetric about 0 for values of both signs and a diverging map.
/// - `scale`: `None` is logarithmic, or linear for values of both signs.
///
/// # Errors
/// An unknown map; a range whose ends do not rise; a range that is not above 0 on a logarithmic scale.
pub fn column_colours(
    column: &ColumnImage,
    map: Option<&str>,
    range: Option<[f32; 2]>,
    scale: Option<ScaleName>,
) -> Result<Option<TransferFunction>> {
    let (name, own_map) = column_look(column, scale);
    let map = map.unwrap_or(own_map);
    let is_symmetric = has_signs(column) && is_diverging(map);
    let own = match name {
        // A single value gets the last colour, and a range of one decade.
        ScaleName::Log => column.shown_range().map(|[least, greatest]| {
            let is_one = least >= greatest;
            [if is_one { greatest / 10.0 } else { least }, greatest]
        }),
        ScaleName::Linear | ScaleName::Symlog if is_symmetric => {
            column.range().map(|[least, greatest]| {
                let extreme = greatest.max(-least);
                [-extreme, extreme]
            })
        }
        ScaleName::Linear | ScaleName::Symlog => column.range(),
    };
    let Some(range) = range.or(own) else {
        return Ok(None);
    };
    TransferFunction::of_colours(map, range.map(f64::from), name).map(Some)
}

/// Returns the scale and the colour map of a column density.
///
/// - `scale`: the scale, if it was asked for.
pub fn column_look(column: &ColumnImage, scale: Option<ScaleName>) -> (ScaleName, &'static str) {
    match (has_signs(column), scale) {
        (true, Some(ScaleName::Log)) => (ScaleName::Log, "viridis"),
        (true, scale) => (scale.unwrap_or(ScaleName::Linear), "coolwarm"),
        (false, scale) => (scale.unwrap_or(ScaleName::Log), "viridis"),
    }
}

/// Returns whether a column density has values of both signs, or below 0. Masses have no sign, but rounding may leave one.
fn has_signs(column: &ColumnImage) -> bool {
    let range = column.range();
    range.is_some_and(|[least, greatest]| -least > LEAST_SIGNED * greatest.max(-least))
}

/// Colours a column density by [`column_colours`]; values below their range are transparent. Returns an empty image if
/// the numbers of values and pixels differ.
pub fn column_picture(column: &ColumnImage, colours: &TransferFunction) -> Image {
    if column.width.checked_mul(column.height) != Some(column.values.len()) {
        return Image::new(0, 0);
    }
    let mut picture = Image::new(column.width, column.height);
    let scale = colours.value_scale();
    let [least, _] = colours.range();
    for (pixel, &value) in picture.pixels.iter_mut().zip(&column.values) {
        let position = scale.position(value.into());
        if position >= least {
            let [red, green, blue, _] = colours.classify(position);
            *pixel = [red, green, blue, 1.0];
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
            values: vec![0.0, -1e-4, 1e-9, 1e-4, 1e-2, 1.0],
            pixel_area: None,
        };
        let colours = column_colours(&column, None, None, None).unwrap().unwrap();
        let pixels = column_picture(&column, &colours).pixels;
        assert_eq!(pixels[..3], [[0.0; 4]; 3]);
        // Viridis: #440154 and #fde725. In the middle the preset has #26838f and matplotlib's table #21918c. The
        // preset's spline misses the table's ends and middle by a level or two of 255.
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

    #[test]
    fn values_of_both_signs_are_symmetric_about_grey() {
        let column = ColumnImage {
            width: 3,
            height: 1,
            values: vec![-4.0, 0.0, 2.0],
            pixel_area: None,
        };
        let colours = column_colours(&column, None, None, None).unwrap().unwrap();
        assert_eq!(colours.range(), [-4.0, 4.0]);
        let [low, middle, high] = column_picture(&column, &colours).pixels[..] else {
            panic!("three pixels")
        };
        assert!(low[2] > low[0] && high[0] > high[2], "{low:?} {high:?}");
        assert!((middle[0] - middle[2]).abs() < 0.02, "{middle:?}");
    }

    #[test]
    fn a_map_a_range_and_a_scale_may_be_asked_for() {
        let column = ColumnImage {
            width: 4,
            height: 1,
            values: vec![-2.0, 0.0, 1.0, 3.0],
            pixel_area: None,
        };
        let grey = |range, scale| {
            let colours = column_colours(&column, Some("grayscale"), range, scale);
            let picture = column_picture(&column, &colours.unwrap().unwrap());
            let encoded = |p: &[f32; 4]| (crate::image::srgb_from_linear(p[0]), p[3]);
            picture.pixels.iter().map(encoded).collect::<Vec<_>>()
        };
        // The levels are even from -2 to 3, within a step of the table.
        for ((level, alpha), expected) in grey(None, Some(ScaleName::Linear))
            .iter()
            .zip([0.0, 0.4, 0.6, 1.0])
        {
            assert!((level - expected).abs() < 1e-3 && *alpha >= 1.0);
        }
        // Lower values are transparent; higher values have the last colour.
        let shown = grey(Some([0.5, 1.0]), Some(ScaleName::Linear));
        assert_eq!(shown.iter().filter(|p| p.1 > 0.0).count(), 2);
        assert!((shown[2].0 - 1.0).abs() < 1e-3 && (shown[3].0 - 1.0).abs() < 1e-3);
        // The value lies in the middle of three decades.
        let [.., (level, _)] = grey(Some([0.1, 90.0]), Some(ScaleName::Log))[..] else {
            panic!("four pixels")
        };
        assert!((level - 0.5).abs() < 1e-3, "{level}");
        for (map, range) in [
            (Some("no-such-map"), None),
            (None, Some([0.0, 1.0])),
            (None, Some([2.0, 1.0])),
        ] {
            assert!(column_colours(&column, map, range, Some(ScaleName::Log)).is_err());
        }
    }
}
