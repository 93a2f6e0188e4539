//! Splats as radiance fields store them.

use glam::DVec3;

/// Anisotropic Gaussians with a peak opacity and a colour each. Their opacity on the image is
/// peak x exp(-Q/2), the same from every side: not the optical depth of a volume.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SplatCloud {
    /// Centres.
    pub positions: Vec<DVec3>,
    /// Standard deviations along the kernel's own axes, world units; the third is 0 where the
    /// file holds flat splats.
    pub scales: Vec<[f32; 3]>,
    /// Rotations as quaternions w, x, y, z of any length but zero.
    pub rotations: Vec<[f32; 4]>,
    /// Peak opacities, 0 to 1.
    pub opacities: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub harmonics_degree: u8,
    /// (degree + 1)² coefficients of three colour channels per splat, one splat after another:
    /// R, G, B of the first coefficient, of the second, ... A colour is 1/2 + their sum, as an
    /// sRGB-encoded value.
    pub harmonics: Vec<f32>,
    /// Whether the file says that it was made for a low-pass filter that keeps a splat's
    /// opacity times its area.
    pub is_anti_aliased: bool,
}

impl SplatCloud {
    /// Numbers of colour per splat: three for each of (degree + 1)² coefficients.
    pub fn harmonics_stride(&self) -> usize {
        3 * (usize::from(self.harmonics_degree) + 1).pow(2)
    }
}
