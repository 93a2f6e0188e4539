//! Defines the images that a render returns: linear, premultiplied, f32.

mod deep;

use crate::constants::{SRGB_GAMMA, SRGB_LINEAR_END, SRGB_OFFSET, SRGB_SCALE, SRGB_SLOPE};

pub use deep::{DeepImage, DeepSample, DepthOf};

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
/// The depth of a pixel is the camera-space z (perspective and orthographic alike) of the particle at which the
/// transmittance along the pixel's ray falls to one half or less. It is infinity if the transmittance stays
/// above one half.
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
    /// `width * height` unit vectors, world space, towards the eye. Each is the normal of the surface at which
    /// the coverage of the pixel reaches half; zero without a surface.
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
    /// Area of a pixel, world units squared, if all pixels have the same: under an orthographic camera.
    pub pixel_area: Option<f64>,
}

impl ColumnImage {
    /// Returns the sum of the pixels times their area: the integral of the field over the visible region, for a
    /// density its mass. Returns `None` under perspective.
    pub fn sum_times_area(&self) -> Option<f64> {
        let sum: f64 = self.values.iter().map(|&v| f64::from(v)).sum();
        self.pixel_area.map(|area| sum * area)
    }

    /// Returns the least and the greatest value.
    pub fn range(&self) -> Option<[f32; 2]> {
        range(self.values.iter().copied().filter(|v| !v.is_nan()))
    }

    /// Returns the least and the greatest value above zero, or `None` if there are none.
    pub fn positive_range(&self) -> Option<[f32; 2]> {
        range(self.values.iter().copied().filter(|v| *v > 0.0))
    }

    /// Returns the range of a picture's logarithmic colours: [`ColumnImage::positive_range`], limited to four
    /// decades below the greatest value. Lower values are the rims of kernels, where a Gaussian carries no
    /// information about the data.
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

/// Linear background of pictures for viewing: the sRGB colour #1c1c21, against which both white and black stand
/// out.
pub const DARK_GREY: [f32; 3] = [0.0116, 0.0116, 0.0152];

impl Image {
    /// Returns the image over a linear background, opaque, as
    /// [`Settings::background`](crate::Settings::background) draws it.
    #[must_use]
    pub fn over(&self, background: [f32; 3]) -> Self {
        let mut image = self.clone();
        image.lay_over(background);
        image
    }

    /// Draws a linear background behind the image.
    pub(crate) fn lay_over(&mut self, background: [f32; 3]) {
        for pixel in &mut self.pixels {
            *pixel = over(*pixel, background);
        }
    }

    /// Draws another image of the same size behind this one: both premultiplied and linear.
    ///
    /// - `in_codes`: whether to composite sRGB codes, straight ones times the opacity.
    pub(crate) fn lay_on(&mut self, behind: &Self, in_codes: bool) {
        for (front, behind) in self.pixels.iter_mut().zip(&behind.pixels) {
            let [mut a, b] = [*front, *behind].map(|pixel| match in_codes {
                true => of_straight(pixel, srgb_from_linear),
                false => pixel,
            });
            let through = 1.0 - a[3];
            for (channel, under) in a.iter_mut().zip(b) {
                *channel += through * under;
            }
            *front = match in_codes {
                true => of_straight(a, linear_from_srgb),
                false => a,
            };
        }
    }

    /// Makes a transparent black image.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            pixels: vec![[0.0; 4]; width * height],
        }
    }

    /// Returns true if the number of pixels is width times height.
    pub(crate) fn is_whole(&self) -> bool {
        self.width.checked_mul(self.height) == Some(self.pixels.len())
    }

    /// Returns the pixel in column `x` and row `y`.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 4] {
        self.pixels[y * self.width + x]
    }

    /// Encodes the picture for screens and files: sRGB-encoded red, green and blue, not multiplied by alpha,
    /// and alpha; four bytes a pixel. Colours above 1 are clamped.
    pub fn to_srgb8(&self) -> Vec<u8> {
        let of_pixel = |&[r, g, b, a]: &[f32; 4]| {
            let share = if a > 0.0 { a } else { 1.0 };
            let [r, g, b] = [r, g, b].map(|c| byte(srgb_from_linear(c / share)));
            [r, g, b, byte(a)]
        };
        self.pixels.iter().flat_map(of_pixel).collect()
    }
}

/// Applies a curve to the colour of a premultiplied pixel, divided by its opacity; of a pixel without opacity, to what it adds.
pub(crate) fn of_straight([r, g, b, a]: [f32; 4], curve: impl Fn(f32) -> f32) -> [f32; 4] {
    let share = if a > 0.0 { a } else { 1.0 };
    let [r, g, b] = [r, g, b].map(|c| share * curve(c / share));
    [r, g, b, a]
}

/// Composites a pixel over a background.
pub(crate) fn over([r, g, b, a]: [f32; 4], [br, bg, bb]: [f32; 3]) -> [f32; 4] {
    let left = 1.0 - a;
    [r + left * br, g + left * bg, b + left * bb, 1.0]
}

/// Converts a value from 0 to 1 to a byte; NaN becomes 0.
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

/// Returns the sRGB code value, 0 to 1, of a linear one (IEC 61966-2-1).
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

/// Returns the linear value of an sRGB code value, 0 to 1 (IEC 61966-2-1): the inverse of [`srgb_from_linear`].
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
            // Two powers in f32 with exponents up to 2.4, each accurate to a few roundings.
            assert!((srgb_from_linear(linear_from_srgb(code)) - code).abs() < 2e-6);
        }
        assert!(srgb_from_linear(f32::NAN).is_nan());
    }
}
