//! Makes the images shown in place of the picture: its errors, depths, normals.

use ewa_splat::{DepthImage, Image, NormalImage};

/// Image shown in place of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Instead {
    /// Errors of the picture, once it is at rest.
    Error,
    /// Depth at which half of the light is absorbed.
    Depth,
    /// Normals of opaque surfaces.
    Normals,
}

/// Decades of error that the colours cover; the tolerance lies at two thirds of them.
const DECADES: f32 = 3.0;

/// Colours each pixel by its greatest difference in linear colour. It is black below a hundredth of
/// the tolerance, blue and green above, yellow at the tolerance, and red from ten times the
/// tolerance on.
pub(crate) fn errors(image: &Image, truth: &Image, tolerance: f32) -> Image {
    let mut shown = image.clone();
    for (pixel, exact) in shown.pixels.iter_mut().zip(&truth.pixels) {
        let differences = pixel.iter().zip(exact).map(|(a, b)| (a - b).abs());
        let error = differences.fold(0.0, f32::max);
        *pixel = colour((error / tolerance).log10() + 2.0);
    }
    shown
}

/// Shows depths: white at the nearest, dark at the farthest, black without a depth.
pub(crate) fn depths(depth: &DepthImage) -> Image {
    let finite = || depth.depths.iter().copied().filter(|d| d.is_finite());
    let [near, far] = [
        finite().fold(f32::INFINITY, f32::min),
        finite().fold(f32::NEG_INFINITY, f32::max),
    ];
    let shade = |&d: &f32| {
        let t = if far > near {
            (d - near) / (far - near)
        } else {
            0.0
        };
        let grey = if d.is_finite() { 1.0 - 0.96 * t } else { 0.0 };
        [grey, grey, grey, 1.0]
    };
    Image {
        width: depth.width,
        height: depth.height,
        pixels: depth.depths.iter().map(shade).collect(),
    }
}

/// Shows normals: x, y and z from -1 to 1 become red, green and blue; black without a normal.
pub(crate) fn normals(normals: &NormalImage) -> Image {
    let shade = |&[x, y, z]: &[f32; 3]| match [x, y, z] == [0.0; 3] {
        true => [0.0, 0.0, 0.0, 1.0],
        false => [0.5 + 0.5 * x, 0.5 + 0.5 * y, 0.5 + 0.5 * z, 1.0],
    };
    Image {
        width: normals.width,
        height: normals.height,
        pixels: normals.normals.iter().map(shade).collect(),
    }
}

/// Returns the colour of an error, given as decades above a hundredth of the tolerance.
fn colour(decades: f32) -> [f32; 4] {
    const STOPS: [[f32; 3]; 5] = [
        [0.0, 0.0, 0.0],
        [0.02, 0.05, 0.5],
        [0.02, 0.4, 0.15],
        [0.9, 0.8, 0.1],
        [0.9, 0.05, 0.02],
    ];
    // The fourth stop stands for the tolerance.
    let place = match decades {
        d if d <= 2.0 => d.max(0.0) * 1.5,
        d => 3.0 + (d.min(DECADES) - 2.0),
    };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "from 0 to the last stop"
    )]
    let below = (place as usize).min(STOPS.len() - 2);
    let t = place - below as f32;
    let [r, g, b] =
        std::array::from_fn(|i| STOPS[below][i] + (STOPS[below + 1][i] - STOPS[below][i]) * t);
    [r, g, b, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_is_bright_and_nothing_is_black() {
        let depth = DepthImage {
            width: 3,
            height: 1,
            depths: vec![2.0, 4.0, f32::INFINITY],
        };
        let shown: Vec<f32> = depths(&depth).pixels.iter().map(|p| p[0]).collect();
        assert_eq!(shown[0], 1.0);
        assert!(shown[1] > 0.0 && shown[1] < 0.1);
        assert_eq!(shown[2], 0.0);
        let turned = NormalImage {
            width: 2,
            height: 1,
            normals: vec![[0.0, -1.0, 0.0], [0.0; 3]],
        };
        let shown = normals(&turned).pixels;
        assert_eq!(shown, [[0.5, 0.0, 0.5, 1.0], [0.0, 0.0, 0.0, 1.0]]);
    }

    #[test]
    fn the_tolerance_is_yellow() {
        let image = |x: f32| Image {
            width: 1,
            height: 1,
            pixels: vec![[0.5, x, 0.5, 1.0]],
        };
        let at = |error: f32| errors(&image(0.25 + error), &image(0.25), 0.01).pixels[0];
        assert_eq!(at(0.0), [0.0, 0.0, 0.0, 1.0]);
        let [r, g, b, _] = at(0.01);
        assert!((r - 0.9).abs() < 0.02 && (g - 0.8).abs() < 0.02 && (b - 0.1).abs() < 0.02);
        let [r, g, b, _] = at(0.2);
        assert!((r - 0.9).abs() < 1e-6 && (g - 0.05).abs() < 1e-6 && (b - 0.02).abs() < 1e-6);
        assert!(at(0.0005)[2] > at(0.0005)[0]);
    }
}
