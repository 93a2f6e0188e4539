//! Draws the difference of two images as a picture.

use super::errors::check_sizes;
use crate::error::{Error, Result};
use crate::image::{Image, linear_from_srgb};
use crate::measure::errors::ImageErrors;

/// Draws the absolute difference between two images: the largest of each pixel's four channels, mapped by
/// matplotlib's perceptually uniform *inferno*. Black means 0, pale yellow `scale` or more.
///
/// - `scale`: the difference, linear colour of full scale 1, at the top of the map;
///   [`difference_scale`] suggests one.
///
/// # Errors
/// Different sizes, or a scale that is not positive.
pub fn difference(first: &Image, second: &Image, scale: f64) -> Result<Image> {
    check_sizes(first, second)?;
    if !(scale > 0.0 && scale.is_finite()) {
        return Err(Error::invalid(
            "difference",
            "scale",
            "a finite number above 0",
            scale.to_string(),
            "give the difference that the brightest colour stands for",
        ));
    }
    let mut image = Image::new(first.width, first.height);
    for ((a, b), out) in first
        .pixels
        .iter()
        .zip(&second.pixels)
        .zip(&mut image.pixels)
    {
        let largest = a
            .iter()
            .zip(b)
            .map(|(a, b)| (f64::from(*b) - f64::from(*a)).abs())
            .fold(0.0, f64::max);
        *out = map_colour(largest / scale);
    }
    Ok(image)
}

/// Returns the linear opaque colour of a fraction of the scale.
pub(super) fn map_colour(fraction: f64) -> [f32; 4] {
    use colorgrad::Gradient;
    thread_local! {
        static MAP: colorgrad::BasisGradient = colorgrad::preset::inferno();
    }
    #[expect(clippy::cast_possible_truncation, reason = "0..1")]
    let [r, g, b, _] = MAP.with(|map| map.at(fraction.clamp(0.0, 1.0) as f32).to_array());
    [
        linear_from_srgb(r),
        linear_from_srgb(g),
        linear_from_srgb(b),
        1.0,
    ]
}

/// Returns a scale that shows a difference: the least of 1, 2 or 5 times a power of ten that is at least the
/// error's 99.9th percentile (or the largest difference, if the percentile is 0).
///
/// Returns 1 for equal images.
pub fn difference_scale(errors: &ImageErrors) -> f64 {
    let shown = if errors.p999 > 0.0 {
        errors.p999
    } else {
        errors.max
    };
    if !(shown > 0.0) {
        return 1.0;
    }
    let decade = 10_f64.powf(shown.log10().floor());
    // A little slack: the f32 next to 0.2 counts as 0.2.
    let steps = [1.0, 2.0, 5.0].into_iter();
    steps
        .map(|step| step * decade)
        .find(|&scale| scale >= shown * (1.0 - 1e-6))
        .unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::super::test_images::constant;
    use super::*;
    use crate::measure::errors::compare;

    #[test]
    fn brightness_follows_the_largest_channel() {
        let black = Image::new(4, 1);
        let mut other = black.clone();
        for (pixel, d) in other.pixels.iter_mut().zip([0.0, 0.05, 0.1, 0.3]) {
            pixel[2] = d;
        }
        let shown = difference(&black, &other, 0.1).unwrap();
        let luminance = |p: [f32; 4]| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2];
        let l: Vec<f32> = shown.pixels.iter().map(|&p| luminance(p)).collect();
        assert!(
            l[0] < 0.01 && l[0] < l[1] && l[1] < l[2] && l[2] > 0.5,
            "{l:?}"
        );
        assert_eq!(shown.pixels[2], shown.pixels[3]);
        assert_eq!(shown, difference(&other, &black, 0.1).unwrap());
        assert!(difference(&black, &other, 0.0).is_err());
        assert!(difference(&black, &Image::new(1, 4), 0.1).is_err());
    }

    #[test]
    fn scales_are_round() {
        let errors = compare(&Image::new(3, 3), &constant(3, 3, [0.5; 3])).unwrap();
        let of = |p999, max| {
            difference_scale(&ImageErrors {
                p999,
                max,
                ..errors
            })
        };
        for (p999, scale) in [
            (f64::from(0.2_f32), 0.2),
            (0.21, 0.5),
            (0.6, 1.0),
            (6e-5, 1e-4),
            (1.0, 1.0),
        ] {
            assert!((of(p999, 3.0) / scale - 1.0).abs() < 1e-12, "{p999}");
        }
        assert!((of(0.0, 0.004) / 0.005 - 1.0).abs() < 1e-12);
        assert_eq!(of(0.0, 0.0), 1.0);
    }
}
