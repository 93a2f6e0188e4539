//! The picture that a render returns: linear, premultiplied, f32.

/// An image of linear premultiplied RGBA in f32, rows from the top.
#[derive(Debug, Clone, PartialEq)]
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

impl Image {
    /// A transparent black image.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            pixels: vec![[0.0; 4]; width * height],
        }
    }

    /// The pixel in column `x` and row `y`.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 4] {
        self.pixels[y * self.width + x]
    }
}

/// The linear value of an sRGB-encoded one, 0..1 (IEC 61966-2-1).
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// The sRGB-encoded value of a linear one, 0..1 (IEC 61966-2-1).
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        linear * 12.92
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}
