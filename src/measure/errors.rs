//! Computes error figures between two images of linear f32.

use serde::Serialize;

use super::{flip, ssim};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::measure::flip::FLIP_PIXELS_PER_DEGREE;

/// Differences between two images over red, green, blue and alpha, linear premultiplied,
/// full scale 1.
///
/// SSIM and FLIP measure the image as displayed: over black, clamped to 0..1, encoded.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ImageErrors {
    /// Root mean square over pixels and channels.
    pub rmse: f64,
    /// Largest absolute difference.
    pub max: f64,
    /// 99.9th percentile over pixels of the largest absolute difference among a pixel's channels.
    pub p999: f64,
    /// Peak signal-to-noise ratio, dB, for full scale 1; `None` (JSON null) for equal images.
    pub psnr: Option<f64>,
    /// Mean of (second - first): a bias that the other figures hide.
    pub mean_difference: f64,
    /// Mean structural similarity, 1 for equal images ([`ssim`]); `None` if an image is smaller than its window
    /// of 11 x 11 pixels.
    pub ssim: Option<f64>,
    /// Mean FLIP, 0 for equal images ([`flip`]); `None` for images without pixels.
    pub flip: Option<f64>,
}

/// Compares two images of one size.
///
/// # Errors
/// Different sizes; too few or too many pixels; a pixel that is not finite.
pub fn compare(first: &Image, second: &Image) -> Result<ImageErrors> {
    check_sizes(first, second)?;
    let channels = first.pixels.len() as f64 * 4.0;
    let mut sum = 0.0;
    let mut squares = 0.0;
    let mut per_pixel = Vec::with_capacity(first.pixels.len());
    for (a, b) in first.pixels.iter().zip(&second.pixels) {
        let mut largest = 0.0_f64;
        for (a, b) in a.iter().zip(b) {
            let difference = f64::from(*b) - f64::from(*a);
            if !difference.is_finite() {
                let found = format!("{a} and {b}");
                return Err(Error::invalid(
                    "comparison",
                    "images",
                    "finite pixels",
                    found,
                    "see where it came from",
                ));
            }
            sum += difference;
            squares += difference * difference;
            largest = largest.max(difference.abs());
        }
        per_pixel.push(largest);
    }
    per_pixel.sort_unstable_by(f64::total_cmp);
    let rank = (per_pixel.len() * 999).div_ceil(1000);
    let mean_square = if channels > 0.0 {
        squares / channels
    } else {
        0.0
    };
    Ok(ImageErrors {
        rmse: mean_square.sqrt(),
        max: per_pixel.last().copied().unwrap_or(0.0),
        p999: per_pixel
            .get(rank.saturating_sub(1))
            .copied()
            .unwrap_or(0.0),
        psnr: (mean_square > 0.0).then(|| -10.0 * mean_square.log10()),
        mean_difference: if channels > 0.0 { sum / channels } else { 0.0 },
        ssim: ssim(first, second),
        flip: flip(first, second, FLIP_PIXELS_PER_DEGREE),
    })
}

/// Refuses two images of different sizes, or one with missing pixels.
pub(super) fn check_sizes(first: &Image, second: &Image) -> Result<()> {
    for image in [first, second] {
        if !image.is_whole() {
            return Err(Error::invalid(
                "comparison",
                "images",
                format!("{} x {} pixels", image.width, image.height),
                image.pixels.len().to_string(),
                "give all pixels of both",
            ));
        }
    }
    if (first.width, first.height) == (second.width, second.height) {
        return Ok(());
    }
    Err(Error::invalid(
        "comparison",
        "images",
        format!("two images of {} x {}", first.width, first.height),
        format!("{} x {}", second.width, second.height),
        "render both at one size",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_pixel_in_a_thousand() {
        let a = Image::new(100, 20);
        let mut b = a.clone();
        b.pixels[7] = [0.5, 0.0, 0.0, 0.0];
        let e = compare(&a, &b).unwrap();
        assert_eq!((e.max, e.p999), (0.5, 0.0));
        assert!((e.rmse - 0.5 / 8000_f64.sqrt()).abs() < 1e-12);
        assert!((e.psnr.unwrap() + 20.0 * e.rmse.log10()).abs() < 1e-9);
        let equal = compare(&a, &a).unwrap();
        assert_eq!(
            (equal.psnr, equal.ssim, equal.flip),
            (None, Some(1.0), Some(0.0))
        );
        let keys = serde_json::to_value(equal).unwrap();
        for key in [
            "rmse",
            "max",
            "p999",
            "psnr",
            "mean_difference",
            "ssim",
            "flip",
        ] {
            assert!(keys.get(key).is_some(), "{key}");
        }
        assert_eq!(
            compare(&Image::new(0, 0), &Image::new(0, 0)).unwrap().flip,
            None
        );
        assert!(compare(&a, &Image::new(20, 100)).is_err());
        b.pixels[8][3] = f32::NAN;
        assert!(compare(&a, &b).is_err());
    }
}
