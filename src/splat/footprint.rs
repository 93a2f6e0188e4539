//! Computes the resampling filter of a kernel: eq. 20 and 25 of Zwicker et al. 2001, eq. 3 to 5 of Chen
//! et al. 2004, in factored form.
//!
//! Twin: `shaders/shared/footprint.wgsl`.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::budget::GREATEST_ENLARGEMENT;
use super::filter::Filter;
use crate::math::Factor;
use crate::record::ViewUniform;

/// A particle in camera space.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Kernel {
    /// u_k, camera units.
    pub centre: Vec3,
    /// Factor of the variance in camera space.
    pub factor: Factor,
    /// g = extinction x volume \[length²\].
    pub mass: f32,
}

/// A kernel's factor projected to the image, before any filter.
///
/// T = J W L, the first two rows: eq. 20 of Zwicker et al. 2001 (J: eq. 25; its printed third column and
/// that of the 2004 paper are damaged). First order: exact for an orthographic camera. For a perspective
/// camera the error for a sphere is at most 1.16 epsilon tan theta + 1.1 epsilon² / cos² theta of its
/// peak (epsilon = sigma / distance up to .03, theta its angle off the axis); `tests/frames/bounds.rs`
/// measures it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenFactor {
    /// x_k, pixels.
    pub centre_px: Vec2,
    /// The slopes (x/z, y/z) of the centre; zero for an orthographic camera.
    pub slope: Vec2,
    /// First row of T, pixels.
    pub row_x: Vec3,
    /// Second row of T, pixels.
    pub row_y: Vec3,
    /// Third row of the factor. Under perspective it is divided by the centre's depth (the kernel's
    /// relative depth). For an orthographic camera it is in world units.
    pub relative_depth: Vec3,
    /// |D0| = sqrt(1 + slope²): true length over depth along the central ray; 1 orthographic.
    pub ray_length: f32,
    /// det J times the mass: the optical depth that is distributed over the footprint, px².
    pub weight: f32,
}

/// A footprint after the filter: variance (a b; b c), its determinant and the amplitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageKernel {
    /// Variance along x, px².
    pub a: f32,
    /// Covariance, px².
    pub b: f32,
    /// Variance along y, px².
    pub c: f32,
    /// a c - b², computed without that subtraction.
    pub determinant: f32,
    /// Optical depth at the centre for the full mass (not yet corrected for the cut-off).
    pub tau: f32,
    /// Factor by which the filter has enlarged its area, and thus the number of its neighbours that
    /// overlap because of the filter; 1 to [`GREATEST_ENLARGEMENT`].
    pub enlargement: f32,
}

/// Projects a kernel to the image plane.
///
/// The steps avoid powers of the depth: first factor over depth, then focal lengths. This is correct for
/// scenes of 1e-15 to 1e15 units, as long as the mass fits f32.
#[inline(always)]
pub fn project_kernel(view: &ViewUniform, kernel: &Kernel) -> ScreenFactor {
    let focal = Vec2::from(view.focal_px);
    let u = kernel.centre;
    let f = &kernel.factor;
    if view.orthographic != 0 {
        return ScreenFactor {
            centre_px: focal * u.truncate() + Vec2::from(view.centre_px),
            slope: Vec2::ZERO,
            row_x: f.x * focal.x,
            row_y: f.y * focal.y,
            relative_depth: f.z,
            ray_length: 1.0,
            weight: kernel.mass * focal.x * focal.y,
        };
    }
    let per_depth = 1.0 / u.z;
    let slope = u.truncate() * per_depth;
    let s = f.z * per_depth;
    let ray_length = (1.0 + slope.length_squared()).sqrt();
    ScreenFactor {
        centre_px: focal * slope + Vec2::from(view.centre_px),
        slope,
        row_x: (f.x * per_depth - s * slope.x) * focal.x,
        row_y: (f.y * per_depth - s * slope.y) * focal.y,
        relative_depth: s,
        ray_length,
        // |det J| = (fx/u2)(fy/u2) l/u2.
        weight: kernel.mass * (focal.x * per_depth) * (focal.y * per_depth) * ray_length,
    }
}

impl ScreenFactor {
    /// Applies the low-pass filter `h2` \[px²\] according to `filter`.
    ///
    /// The determinant is computed by the Cauchy-Binet formula, as a sum of squares. Its relative error
    /// is a few epsilon for any axis ratio, whereas a c - b² has no correct digit beyond 1:4000. A filter
    /// that leaves a singular variance gives a determinant of zero.
    #[inline(always)]
    pub fn filtered(&self, filter: Filter, h2: f32) -> ImageKernel {
        let (x, y) = (self.row_x, self.row_y);
        let (xx, yy) = (x.length_squared(), y.length_squared());
        let minors = x.cross(y).length_squared();
        let with_low_pass = |h2: f32| {
            let determinant = minors + h2 * (xx + yy) + h2 * h2;
            (xx + h2, x.dot(y), yy + h2, determinant)
        };
        let (a, b, c, determinant) = match filter {
            Filter::Adaptive | Filter::Exact | Filter::Ewa => with_low_pass(h2),
            Filter::Reconstruction => with_low_pass(0.0),
            Filter::LowPass => (h2, 0.0, h2, h2 * h2),
            Filter::Isotropic => {
                let v = 0.5 * (xx + yy) + h2;
                (v, 0.0, v, v * v)
            }
            Filter::UniformScaling => {
                let largest = 0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(x.dot(y));
                // A kernel without any width is given a millionth of its length.
                let smallest = (minors / largest).max(largest * 1e-12);
                if largest == 0.0 {
                    (h2, 0.0, h2, h2 * h2)
                } else {
                    // NaN takes this branch and stays NaN: it draws nothing.
                    let s2 = (h2 / smallest).max(1.0);
                    let determinant = (minors * s2).max(largest * smallest * s2) * s2;
                    (xx * s2, x.dot(y) * s2, yy * s2, determinant)
                }
            }
        };
        let growth = (determinant / minors).sqrt();
        let enlargement = match minors > 0.0 {
            true if growth > 1.0 => growth.min(GREATEST_ENLARGEMENT),
            // Also for NaN.
            true => 1.0,
            false => GREATEST_ENLARGEMENT,
        };
        ImageKernel {
            a,
            b,
            c,
            determinant,
            tau: self.weight / (TAU * determinant.sqrt()),
            enlargement,
        }
    }
}

impl ImageKernel {
    /// Returns the rows p and r of the triangular form: Q = (p . d)² + (r . d)². All terms are sums of
    /// squares, so Q keeps its relative accuracy. The larger variance is eliminated first.
    #[inline(always)]
    pub fn triangular_form(&self) -> [[f32; 2]; 2] {
        let Self {
            a,
            b,
            c,
            determinant,
            ..
        } = *self;
        if a >= c {
            let s = (a / determinant).sqrt();
            [[1.0 / a.sqrt(), 0.0], [-(b / a) * s, s]]
        } else {
            let s = (c / determinant).sqrt();
            [[0.0, 1.0 / c.sqrt()], [s, -(b / c) * s]]
        }
    }
}
