//! Computes structural similarity (Z. Wang, A. Bovik, H. Sheikh, E. Simoncelli, *Image Quality Assessment: From
//! Error Visibility to Structural Similarity*, 2004).

use super::band::{Band, displayed_rows, sum_over_bands};
use crate::image::{Image, srgb_from_linear};
use crate::math::narrowed;

/// Half the window of 11 x 11 pixels.
const RADIUS: usize = 5;
/// Standard deviation of the window's Gaussian weights, pixels.
const SIGMA: f64 = 1.5;
/// (K1 L)² and (K2 L)² of eq. 13 with the paper's K1 = .01, K2 = .03 and full scale L = 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;
/// Luma of sRGB-encoded red, green and blue (ITU-R BT.709).
const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Returns the mean structural similarity of two images of one size: 1 for equal ones.
///
/// It compares the sRGB-encoded luma of each image over black, clamped to 0..1. The window is Gaussian, 11 x 11
/// pixels with σ = 1.5; moments are population moments. The mean is over the windows inside the image, at full
/// resolution (no pyramid, no downsampling). Returns `None` if no window fits.
pub fn ssim(first: &Image, second: &Image) -> Option<f64> {
    let (width, height) = (first.width, first.height);
    if (width, height) != (second.width, second.height) || width.min(height) < 2 * RADIUS + 1 {
        return None;
    }
    if !(first.is_whole() && second.is_whole()) {
        return None;
    }
    let weights = gaussian();
    let inner = RADIUS..height - RADIUS;
    let sum = sum_over_bands(inner, |rows| {
        let luma = |image| -> Vec<f64> {
            displayed_rows(image, &rows, RADIUS)
                .map(|p| {
                    (0..3)
                        .map(|c| LUMA[c] * f64::from(srgb_from_linear(narrowed(p[c]))))
                        .sum()
                })
                .collect()
        };
        let (x, y) = (luma(first), luma(second));
        let mean = |a: &[f64], b: Option<&[f64]>| {
            let products = match b {
                Some(b) => a.iter().zip(b).map(|(a, b)| a * b).collect(),
                None => a.to_vec(),
            };
            Band::new(width, products)
                .filtered(&weights, &weights)
                .values
        };
        let (mean_x, mean_y) = (mean(&x, None), mean(&y, None));
        let (mean_xx, mean_yy) = (mean(&x, Some(&x)), mean(&y, Some(&y)));
        let mean_xy = mean(&x, Some(&y));
        let mut sum = 0.0;
        for row in (0..rows.len()).map(|row| row * width) {
            for i in row + RADIUS..row + width - RADIUS {
                let (mx, my) = (mean_x[i], mean_y[i]);
                let covariance = mean_xy[i] - mx * my;
                let variances = (mean_xx[i] - mx * mx) + (mean_yy[i] - my * my);
                // Eq. 13.
                sum += (2.0 * mx * my + C1) * (2.0 * covariance + C2)
                    / ((mx * mx + my * my + C1) * (variances + C2));
            }
        }
        sum
    });
    Some(sum / ((width - 2 * RADIUS) * (height - 2 * RADIUS)) as f64)
}

fn gaussian() -> [f64; 2 * RADIUS + 1] {
    let weights: [f64; 2 * RADIUS + 1] = std::array::from_fn(|i| {
        let d = i as f64 - RADIUS as f64;
        (-0.5 * (d / SIGMA).powi(2)).exp()
    });
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::super::test_images::{constant, noise, noisy};
    use super::*;
    use crate::image::linear_from_srgb;

    #[test]
    fn constant_images_follow_the_formula() {
        // No variance: (2 a b + C1) / (a² + b² + C1).
        let (a, b) = (0.25_f64, 0.6);
        let of = |code: f64| constant(20, 300, [linear_from_srgb(narrowed(code)); 3]);
        let expected = (2.0 * a * b + C1) / (a * a + b * b + C1);
        let found = ssim(&of(a), &of(b)).unwrap();
        // Rounding of the sRGB curve and its inverse in f32.
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        // Values outside 0..1 are clamped.
        let over = ssim(&constant(20, 20, [1.0; 3]), &constant(20, 20, [7.0; 3]));
        assert_eq!(over, Some(1.0));
    }

    #[test]
    fn equal_is_one_and_order_does_not_matter() {
        let (a, b) = (noise(40, 200, 1), noise(40, 200, 2));
        assert_eq!(ssim(&a, &a), Some(1.0));
        let (ab, ba) = (ssim(&a, &b).unwrap(), ssim(&b, &a).unwrap());
        assert!((ab - ba).abs() < 1e-12 && ab < 0.2, "{ab} {ba}");
    }

    #[test]
    fn falls_as_noise_grows() {
        let clean = constant(64, 64, [0.2, 0.3, 0.1]);
        let found: Vec<f64> = [0.0, 0.01, 0.03, 0.1]
            .iter()
            .map(|&amplitude| ssim(&clean, &noisy(&clean, amplitude)).unwrap())
            .collect();
        assert!(found.is_sorted_by(|a, b| a > b), "{found:?}");
    }

    #[test]
    fn an_image_without_a_window_has_none() {
        for (width, height) in [(0, 0), (1, 1), (10, 50), (50, 10)] {
            let image = constant(width, height, [0.5; 3]);
            assert_eq!(ssim(&image, &image), None);
        }
        assert!(ssim(&constant(11, 11, [0.5; 3]), &constant(11, 11, [0.5; 3])).is_some());
    }
}
