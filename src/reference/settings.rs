//! Defines settings of reference images, and their results.

use crate::error::{Error, Result};
use crate::image::{DepthImage, Image};
use crate::task::Task;
use crate::view::Camera;

/// Target of the pixel's low-pass filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFilter {
    /// Filters the image (eq. 6 of Zwicker et al. 2001) by supersampling: the exact definition.
    Image,
    /// Filters each kernel, as EWA splatting does: depths are filtered, not opacities. It takes one ray per
    /// pixel. The remaining difference between this image and a rendered one is due to neither filter nor
    /// aliasing.
    Kernels,
}

/// Settings of a reference image.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceSettings {
    /// Requested error, linear colour, full scale 1.
    pub error: f64,
    /// Variance of the low-pass filter, px²; 0 samples pixel centres.
    pub low_pass_variance_px2: f64,
    /// Target of the filter.
    pub pixel_filter: PixelFilter,
    /// Greatest number of rays per pixel; a pixel that needs more keeps its estimated error.
    pub max_rays_per_pixel: u32,
    /// Linear RGB of the background; `None` leaves the image transparent.
    pub background: Option<[f32; 3]>,
    /// Receives the progress of the image, and may cancel it.
    pub task: Option<Task>,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            error: 1e-4,
            low_pass_variance_px2: 1.0,
            pixel_filter: PixelFilter::Image,
            max_rays_per_pixel: 256,
            background: None,
            task: None,
        }
    }
}

/// A reference image and its statistics.
#[derive(Debug, Clone)]
pub struct ReferenceFrame {
    /// The image, narrowed to f32.
    pub image: Image,
    /// The same in f64, row by row: premultiplied linear RGBA.
    pub pixels: Vec<[f64; 4]>,
    /// Greatest estimated error of a pixel.
    pub error: f64,
    /// Number of pixels whose estimated error stayed above the requested one.
    pub unconverged: usize,
    /// Number of rays integrated.
    pub rays: u64,
}

/// Refuses settings out of range.
///
/// - `ends`: depths at which rays end.
///
/// # Errors
/// An image without pixels; an error or a variance out of range; depths of another size.
pub(super) fn check(
    camera: &Camera,
    settings: &ReferenceSettings,
    ends: Option<&DepthImage>,
) -> Result<()> {
    let refuse = |place: &str, expected: &str, found: String| {
        let advice = "change it";
        Err(Error::invalid("reference", place, expected, found, advice))
    };
    if camera.width == 0 || camera.height == 0 {
        let found = format!("{} x {}", camera.width, camera.height);
        return refuse("image size", "at least one pixel", found);
    }
    if let Some(ends) = ends {
        let size = [camera.width, camera.height];
        let count = camera.width.saturating_mul(camera.height);
        if [ends.width, ends.height] != size || ends.depths.len() != count {
            let expected = format!("{} x {} pixels, as the image", size[0], size[1]);
            return refuse(
                "ends of rays",
                &expected,
                format!("{} x {}", ends.width, ends.height),
            );
        }
    }
    let error = settings.error;
    if !(1e-14..1.0).contains(&error) {
        return refuse("error", "a number from 1e-14 to 1", error.to_string());
    }
    let h2 = settings.low_pass_variance_px2;
    if !(h2 >= 0.0 && h2.is_finite()) {
        return refuse("low-pass variance", "a number from 0 up", h2.to_string());
    }
    Ok(())
}
