//! Draws splats of radiance fields by the rule of their format (Kerbl et al. 2023, *3D Gaussian Splatting
//! for Real-Time Radiance Field Rendering*): alpha = peak x exp(-Q/2).
//!
//! Twin: `shaders/shared/peak.wgsl`.

use glam::Vec2;

use super::defocus::defocus;
use super::filter::Filter;
use super::footprint::{ImageKernel, Kernel, ScreenFactor, project_kernel};
use crate::constants::{SPLAT_CUTOFF, SPLAT_FLOOR};
use crate::record::ViewUniform;
use crate::scene::SplatRule;

/// Variance added to a splat's footprint, px². The training of Kerbl et al. adds it to keep splats from
/// falling between pixels. The peak stays unchanged.
pub const SPLAT_LOW_PASS_PX2: f32 = 0.3;

/// The same for splats made for the anti-aliasing filter of Yu et al. 2024, *Mip-Splatting*: a pixel's
/// box as a Gaussian. The peak falls as the area grows.
pub const ANTI_ALIASED_LOW_PASS_PX2: f32 = 0.1;

/// Distance beyond the image within which the Jacobian is taken at a splat's own slope, as a fraction of
/// half the image. Farther out the slope is clamped. Otherwise the affine footprints of splats beside the
/// eye would reach across the picture; training never saw such footprints.
pub(crate) const JACOBIAN_MARGIN: f32 = 0.3;

/// Returns the footprint of a splat, with `tau` the opacity at the centre; `None` if the rule draws
/// nothing.
///
/// - `kernel`: its mass is the peak opacity.
///
/// The projection is affine, whatever the filter of the frame, because the opacities were trained with
/// it. An anti-aliased splat's opacity is multiplied by sqrt(det V / det (V + h²)), with V its
/// footprint's variance, so that opacity times area stays that of the unfiltered footprint. The opacity
/// of other splats does not depend on their size.
///
/// A splat is not drawn if its centre lies behind the eye, or nearer in front of it than its own standard
/// deviation along the camera's axis: an affine footprint is meaningless there. (The limit in viewers is
/// a distance in scene units.)
#[inline]
pub fn peak_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    rule: SplatRule,
) -> Option<(ScreenFactor, ImageKernel)> {
    let (z, reach) = (kernel.centre.z, kernel.factor.z.length());
    let nearest = if view.orthographic != 0 { 0.0 } else { reach };
    // Phrased so that NaN draws nothing.
    if !(z > nearest) {
        return None;
    }
    let mut screen = project_kernel(view, kernel);
    if view.orthographic == 0 {
        let focal = Vec2::from(view.focal_px);
        let size = Vec2::new(view.size[0] as f32, view.size[1] as f32);
        let margin = JACOBIAN_MARGIN * 0.5 * size / focal;
        let lower = -Vec2::from(view.centre_px) / focal - margin;
        let upper = (size - Vec2::from(view.centre_px)) / focal + margin;
        let slope = screen.slope.max(lower).min(upper);
        if slope != screen.slope {
            let per_depth = 1.0 / z;
            let s = screen.relative_depth;
            screen.row_x = (kernel.factor.x * per_depth - s * slope.x) * focal.x;
            screen.row_y = (kernel.factor.y * per_depth - s * slope.y) * focal.y;
        }
    }
    let h2 = if rule.is_anti_aliased() {
        ANTI_ALIASED_LOW_PASS_PX2
    } else {
        SPLAT_LOW_PASS_PX2
    };
    let mut image = screen.filtered(Filter::Ewa, h2);
    image.tau = kernel.mass;
    if rule.is_anti_aliased() {
        // Minors, not the difference of products, so that a flat splat seen from its edge keeps its
        // digits.
        let determinant = screen.row_x.cross(screen.row_y).length_squared();
        image.tau *= (determinant / image.determinant).sqrt();
    }
    let blur = defocus(view, kernel);
    if blur > 0.0 {
        // Opacity times area stays.
        let sharp = image;
        image = screen.filtered(Filter::Ewa, h2 + blur);
        image.tau = sharp.tau * (sharp.determinant / image.determinant).sqrt();
    }
    // A footprint whose squared lengths overflow f32 has no form.
    let is_shape = (image.a + image.c).is_finite();
    (is_shape && image.tau > 0.0 && image.tau.is_finite()).then_some((screen, image))
}

/// Returns the radius within which the rule draws a splat, standard deviations; `None` if nowhere.
///
/// - `peak`: its opacity at the centre.
/// - `radius`: the cut-off without a rule.
#[inline]
pub fn peak_reach(rule: SplatRule, peak: f32, radius: f32) -> Option<f32> {
    match rule {
        SplatRule::Exact => Some(radius),
        SplatRule::Khr => Some(radius.min(SPLAT_CUTOFF)),
        SplatRule::Inria | SplatRule::Mip => {
            // Phrased so that NaN draws nothing.
            (peak >= SPLAT_FLOOR).then(|| radius.min((2.0 * (peak / SPLAT_FLOOR).ln()).sqrt()))
        }
    }
}
