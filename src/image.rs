//! The picture that a render returns: linear, premultiplied, f32.

use crate::constants::{SRGB_GAMMA, SRGB_LINEAR_END, SRGB_OFFSET, SRGB_SCALE, SRGB_SLOPE};

/// An image of linear premultiplied RGBA in f32, rows from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width * height` pixels, row by row from the top: red, green, blue (linear, times
    /// alpha) and alpha.
    pub pixels: Vec<[f32; 4]>,
}

/// A depth image: one f32 per pixel, rows from the top.
///
/// The depth of a pixel is the camera-space z (perspective and orthographic alike) of the
/// particle at which the transmittance along the pixel's ray falls to one half or less, and
/// infinity where it never does.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width * height` depths in world units.
    pub depths: Vec<f32>,
}

/// Normals of opaque surfaces, rows from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NormalImage {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width * height` unit vectors, world space, towards the eye; of the surface at which half of
    /// the pixel is covered, zero where there is none.
    pub normals: Vec<[f32; 3]>,
}

/// A column density: the line integral of a field through each pixel, rows from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ColumnImage {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width * height` values; field x length.
    pub values: Vec<f32>,
    /// The area of a pixel, world units squared, where all have the same: under an orthographic
    /// camera.
    pub pixel_area: Option<f64>,
}

impl ColumnImage {
    /// The sum of the pixels times their area: the integral of the field over what the image
    /// shows, for a density its mass. `None` under perspective.
    pub fn sum_times_area(&self) -> Option<f64> {
        let sum: f64 = self.values.iter().map(|&v| f64::from(v)).sum();
        self.pixel_area.map(|area| sum * area)
    }

    /// The least and the greatest value.
    pub fn range(&self) -> Option<[f32; 2]> {
        range(self.values.iter().copied().filter(|v| !v.is_nan()))
    }

    /// The least and the greatest value above zero, or `None` where there is none.
    pub fn positive_range(&self) -> Option<[f32; 2]> {
        range(self.values.iter().copied().filter(|v| *v > 0.0))
    }

    /// What the colours of a picture span, logarithmically: [`ColumnImage::positive_range`], but no
    /// more than four decades below the greatest value. Further down lie the rims of kernels, where
    /// a Gaussian says nothing of the data.
    pub fn shown_range(&self) -> Option<[f32; 2]> {
        let [least, greatest] = self.positive_range()?;
        Some([least.max(greatest * 1e-4), greatest])
    }
}

fn range(values: impl Iterator<Item = f32>) -> Option<[f32; 2]> {
    values.fold(None, |range, v| {
        Some(range.map_or([v, v], |[lo, hi]: [f32; 2]| [lo.min(v), hi.max(v)]))
    })
}

/// Behind pictures that are to be looked at, linear: the sRGB colour #1c1c21, on which neither white nor black
/// vanishes.
pub const DARK_GREY: [f32; 3] = [0.0116, 0.0116, 0.0152];

impl Image {
    /// The same over a linear background, opaque: as [`Settings::background`](crate::Settings::background) draws it.
    #[must_use]
    pub fn over(&self, background: [f32; 3]) -> Self {
        let mut image = self.clone();
        for pixel in &mut image.pixels {
            *pixel = over(*pixel, background);
        }
        image
    }

    /// A transparent black image.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            pixels: vec![[0.0; 4]; width * height],
        }
    }

    /// Whether there are as many pixels as width and height say.
    pub(crate) fn is_whole(&self) -> bool {
        self.width.checked_mul(self.height) == Some(self.pixels.len())
    }

    /// The pixel in column `x` and row `y`.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 4] {
        self.pixels[y * self.width + x]
    }

    /// The picture for screens and files: sRGB-encoded red, green and blue, not multiplied by alpha, and alpha; four bytes a
    /// pixel. Colours above 1 are cut.
    pub fn to_srgb8(&self) -> Vec<u8> {
        let of_pixel = |&[r, g, b, a]: &[f32; 4]| {
            let share = if a > 0.0 { a } else { 1.0 };
            let [r, g, b] = [r, g, b].map(|c| byte(srgb_from_linear(c / share)));
            [r, g, b, byte(a)]
        };
        self.pixels.iter().flat_map(of_pixel).collect()
    }
}

/// A pixel over a background.
pub(crate) fn over([r, g, b, a]: [f32; 4], [br, bg, bb]: [f32; 3]) -> [f32; 4] {
    let left = 1.0 - a;
    [r + left * br, g + left * bg, b + left * bb, 1.0]
}

/// A value from 0 to 1 as a byte; NaN becomes 0.
pub(crate) fn byte(x: f32) -> u8 {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped, and float casts saturate"
    )]
    {
        (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
    }
}

/// The sRGB code value, 0 to 1, of a linear one (IEC 61966-2-1).
///
/// Values outside 0 to 1 follow the same curve, mirrored about 0.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let x = linear.abs();
    let code = if x <= SRGB_LINEAR_END {
        SRGB_SLOPE * x
    } else {
        SRGB_SCALE * x.powf(1.0 / SRGB_GAMMA) - SRGB_OFFSET
    };
    code.copysign(linear)
}

/// The linear value of an sRGB code value, 0 to 1 (IEC 61966-2-1): the inverse of
/// [`srgb_from_linear`].
pub fn linear_from_srgb(code: f32) -> f32 {
    let x = code.abs();
    let linear = if x <= 0.040_45 {
        x / SRGB_SLOPE
    } else {
        ((x + SRGB_OFFSET) / SRGB_SCALE).powf(SRGB_GAMMA)
    };
    linear.copysign(code)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_background_shows_where_nothing_hides_it() {
        let image = Image {
            width: 3,
            height: 1,
            pixels: vec![[0.0; 4], [0.25, 0.0, 0.5, 0.5], [1.0, 0.5, 0.25, 1.0]],
        };
        let shown = image.over([0.5, 1.0, 0.0]);
        let expected = [
            [0.5, 1.0, 0.0, 1.0],
            [0.5, 0.5, 0.5, 1.0],
            [1.0, 0.5, 0.25, 1.0],
        ];
        assert_eq!(shown.pixels, expected);
    }

    #[test]
    fn srgb_has_its_known_values_and_survives_a_round_trip() {
        assert_eq!(linear_from_srgb(0.0), 0.0);
        assert_eq!(linear_from_srgb(1.0), 1.0);
        // The standard's mid grey: code 0.5 is linear 0.214041.
        assert!((linear_from_srgb(0.5) - 0.214_041_14).abs() < 1e-6);
        for i in 0..=255_u8 {
            let code = f32::from(i) / 255.0;
            // Two powers of f32 with exponents up to 2.4, each good to a few roundings.
            assert!((srgb_from_linear(linear_from_srgb(code)) - code).abs() < 2e-6);
        }
        assert!(srgb_from_linear(f32::NAN).is_nan());
    }
}
