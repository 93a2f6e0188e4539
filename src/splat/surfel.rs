//! Surfels of an opaque surface: flat kernels that are averaged, not absorbed.
//!
//! At a pixel every surfel has a weight, area |det M| G(M V2 Mᵀ + V_h), with V2 its variance in its
//! tangent plane and M the plane's mapping to the image (section 5 of Zwicker et al. 2001, where
//! it is T^2D): Heckbert's EWA filter, had the surface a texture. Where surfels tile a surface
//! their weights sum to about 1; the colour is the weighted mean and the coverage the sum, so that
//! silhouettes are as soft as the low-pass filter makes them.
//!
//! Surfels of one surface meet at a pixel at one depth: that of the surfel's plane along the
//! pixel's ray, not of its centre. The inverse of it changes linearly across the image under
//! perspective, the depth itself under an orthographic camera; [`SurfelTerms::inverse_depth`] is that
//! linear number, greater for what is nearer.
//!
//! Twin: `shaders/shared/surfel.wgsl`, of packed normals `shaders/shared/normal.wgsl`.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::filter::Filter;
use super::footprint::{ImageKernel, Kernel, ScreenFactor, project_kernel};
use crate::math::pack_normal;
use crate::record::{NearTerms, SurfelTerms, ViewUniform};

/// Surfels of one surface differ in depth by what it bends between them: up to this many of
/// their standard deviations they are averaged. Across a crease they differ by more, and fall into
/// two layers, which cover as much.
pub(crate) const SLACK_SIGMAS: f32 = 1.0;

/// And by what it bends within a pixel: so many pixels.
pub(crate) const SLACK_PIXELS: f32 = 0.5;

/// And, where it is seen at a slant, by what the low-pass filter has spread: so many of its standard
/// deviations along the slope.
pub(crate) const SLACK_SLOPE: f32 = 3.0;

/// The slope of a plane is taken for no steeper than a cosine of this towards the ray: what is seen
/// from its edge has little weight, but its depth would leave all bounds, and its slack would let it
/// join what lies far in front of it. A plane that is seen flatter falls into several layers, which
/// add up to the same.
pub(crate) const GRAZING: f32 = 0.2;

/// From this relative depth across its cut-off on, a surfel is drawn by the exact homography of
/// its plane instead of the affine map: below, no weight is off by more than a hundredth.
pub(crate) const PERSPECTIVE_FROM: f32 = 0.01;

/// A surfel on the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfelFootprint {
    /// Its factor there.
    pub screen: ScreenFactor,
    /// Its footprint; `tau` is the weight at the centre.
    pub image: ImageKernel,
    /// Its plane.
    pub terms: SurfelTerms,
}

/// The footprint of a surfel of an opaque surface; `None` where it is seen from behind and has one
/// side, or is no surfel.
///
/// - `kernel`: its mass is the area, its factor the two tangents; in front of the eye.
#[inline]
pub fn surfel_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    is_one_sided: bool,
    cutoff: f32,
) -> Option<SurfelFootprint> {
    let is_orthographic = view.orthographic != 0;
    let (u, focal) = (kernel.centre, Vec2::from(view.focal_px));
    let mut screen = project_kernel(view, kernel);
    let [a, b, _] = kernel.factor.columns();
    let normal = unit_normal(a, b)?;
    // D0, the ray through the centre, and the cosine towards it.
    let ray = if is_orthographic {
        Vec3::Z
    } else {
        screen.slope.extend(1.0)
    };
    let across = normal.dot(ray);
    if is_one_sided && across > 0.0 {
        return None;
    }
    let facing = across;
    // |det M| = |det J| cos theta; `weight` has |det J| and the ray's length |D0|.
    screen.weight *= across.abs() / screen.ray_length;
    let image = screen.filtered(Filter::Ewa, view.low_pass_variance_px2);
    let is_shape = (image.a + image.c).is_finite();
    if !(is_shape && image.tau > 0.0 && image.tau.is_finite()) {
        return None;
    }
    // The inverse depth D . n / (n . u), u = u2 D0; -D . n / ... of the depth under parallel rays.
    let least = GRAZING * screen.ray_length;
    let across = if across < 0.0 {
        across.min(-least)
    } else {
        across.max(least)
    };
    let mut terms = SurfelTerms::default();
    let slope = normal.truncate() / (across * focal);
    let pixel = 1.0 / focal.min_element();
    let sigma = widest(a, b);
    let plane;
    if is_orthographic {
        plane = slope;
        terms.inverse_depth = -u.z;
        terms.slack = SLACK_SIGMAS * sigma + SLACK_PIXELS * pixel;
    } else {
        let per_depth = 1.0 / u.z;
        plane = slope * per_depth;
        terms.inverse_depth = per_depth;
        terms.slack = (SLACK_SIGMAS * (sigma * per_depth) + SLACK_PIXELS * pixel) * per_depth;
    }
    if screen.relative_depth.length() * cutoff > PERSPECTIVE_FROM && !is_orthographic {
        terms.homography = 1.0;
        terms.gradient = plane.into();
    } else {
        // The mean of the inverse depth where the filtered kernel meets the pixel: what the filter has
        // spread has the inverse depth of where it came from.
        let (x, y) = (screen.row_x, screen.row_y);
        let along = Vec2::new(
            x.length_squared() * plane.x + x.dot(y) * plane.y,
            x.dot(y) * plane.x + y.length_squared() * plane.y,
        );
        let seen = Vec2::new(
            image.c * along.x - image.b * along.y,
            image.a * along.y - image.b * along.x,
        );
        terms.gradient = (seen / image.determinant).into();
    }
    terms.slack += SLACK_SLOPE * h_of(view) * plane.length();
    terms.normal = pack_normal(if facing < 0.0 { normal } else { -normal });
    Some(SurfelFootprint {
        screen,
        image,
        terms,
    })
}

/// The low-pass filter's standard deviation, pixels.
#[inline]
fn h_of(view: &ViewUniform) -> f32 {
    view.low_pass_variance_px2.sqrt()
}

/// The greater standard deviation of a surfel.
#[inline]
fn widest(a: Vec3, b: Vec3) -> f32 {
    // Units of its own size: squares of it would underflow or overflow at the scale of some scenes.
    let unit = a.abs().max(b.abs()).max_element();
    let (a, b) = (a / unit, b / unit);
    let (aa, bb, ab) = (a.length_squared(), b.length_squared(), a.dot(b));
    let half = 0.5 * (aa - bb);
    unit * (0.5 * (aa + bb) + (half * half + ab * ab).sqrt()).sqrt()
}

/// The direction of a x b; `None` where there is none.
#[inline]
pub(crate) fn unit_normal(a: Vec3, b: Vec3) -> Option<Vec3> {
    let (a, b) = (a / a.abs().max_element(), b / b.abs().max_element());
    let normal = a.cross(b);
    let length = normal.length();
    // Phrased so that NaN gives none.
    (length > 1e-6).then(|| normal / length)
}

/// What a surfel that reaches the camera plane is evaluated by, and its weight at the centre:
/// for a ray D its inverse depth is N . D and its coordinates along the tangents, in standard
/// deviations, A . D / N . D and B . D / N . D; A, B and N are the first three of
/// [`NearTerms::misses`]. `None` as for [`surfel_footprint`], and where the eye lies in its plane.
///
/// No low-pass filter: what the eye touches is far wider than a pixel.
pub fn near_surfel(kernel: &Kernel, is_one_sided: bool) -> Option<(NearTerms, f32)> {
    let [a, b, _] = kernel.factor.columns();
    let unit = [a, b, kernel.centre]
        .iter()
        .map(|v| v.abs().max_element())
        .fold(0.0, f32::max);
    if !(unit > 0.0 && unit.is_finite()) {
        return None;
    }
    let (a, b, u) = (a / unit, b / unit, kernel.centre / unit);
    let normal = a.cross(b);
    let squared = normal.length_squared();
    let distance = normal.dot(u);
    if is_one_sided && distance > 0.0 {
        return None;
    }
    let (along_a, along_b) = (b.cross(normal) / squared, normal.cross(a) / squared);
    let inverse_depth = normal / distance;
    let mut terms = NearTerms::default();
    // All three per world unit, not per `unit`.
    terms.misses[0] = ((along_a - inverse_depth * along_a.dot(u)) / unit).into();
    terms.misses[1] = ((along_b - inverse_depth * along_b.dot(u)) / unit).into();
    terms.misses[2] = (inverse_depth / unit).into();
    terms.sigma = (SLACK_SIGMAS * widest(a, b)) * unit;
    let weight = kernel.mass / unit / unit / (TAU * squared.sqrt());
    let is_usable = terms.misses[..3].iter().flatten().all(|x| x.is_finite());
    (is_usable && weight > 0.0 && weight.is_finite()).then_some((terms, weight))
}
