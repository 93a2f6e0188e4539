//! Computes surfels of an opaque surface: flat kernels that are averaged, not absorbed.
//!
//! At a pixel every surfel has a weight, area |det M| G(M V2 Mᵀ + V_h), with V2 its variance in its
//! tangent plane and M the plane's mapping to the image (section 5 of Zwicker et al. 2001, where it is
//! T^2D). This is Heckbert's EWA filter, with the surface as the texture. If surfels tile a surface,
//! their weights sum to about 1. The colour is the weighted mean and the coverage is the sum, so that the
//! low-pass filter softens silhouettes.
//!
//! At a pixel a surfel has the depth of its plane along the pixel's ray, not that of its centre. So the
//! surfels of one surface agree in depth. The inverse depth changes linearly across the image under
//! perspective; under an orthographic camera the depth itself does. [`SurfelTerms::inverse_depth`] is
//! that linear number; it is greater for nearer points.
//!
//! Twin: `shaders/shared/surfel.wgsl`; for packed normals `shaders/shared/normal.wgsl`.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::filter::Filter;
use super::footprint::{ImageKernel, Kernel, ScreenFactor, project_kernel};
use crate::math::pack_normal;
use crate::record::{NearTerms, SurfelTerms, ViewUniform};

/// Difference of depth up to which surfels of one surface are averaged, in units of their standard
/// deviation: a curved surface bends by this much between them. Across a crease they differ by more, and
/// fall into two layers, which have the same coverage.
pub(crate) const SLACK_SIGMAS: f32 = 1.0;

/// Addition to that difference for a surface that bends within a pixel, in pixels.
pub(crate) const SLACK_PIXELS: f32 = 0.5;

/// Addition to that difference for a surface seen at a slant, whose depths the low-pass filter spreads:
/// standard deviations of the filter along the slope.
pub(crate) const SLACK_SLOPE: f32 = 3.0;

/// Least cosine between a plane's normal and the ray that is used for its slope. A plane seen from its
/// edge has little weight, but its depth would leave all bounds, and its slack would let it join surfaces
/// far in front of it. A plane seen more obliquely falls into several layers, which sum to the same.
pub(crate) const GRAZING: f32 = 0.2;

/// Relative depth across its cut-off from which a surfel is drawn by the exact homography of its plane
/// instead of the affine map. Below it no weight is off by more than a hundredth.
pub(crate) const PERSPECTIVE_FROM: f32 = 0.01;

/// A surfel on the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfelFootprint {
    /// Its projected factor.
    pub screen: ScreenFactor,
    /// Its footprint; `tau` is the weight at the centre.
    pub image: ImageKernel,
    /// Its plane.
    pub terms: SurfelTerms,
}

/// Returns the footprint of a surfel of an opaque surface; `None` if it is one-sided and seen from
/// behind, or is not a surfel.
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
    // |det M| = |det J| cos theta; `weight` contains |det J| and the ray's length |D0|.
    screen.weight *= across.abs() / screen.ray_length;
    let image = screen.filtered(Filter::Ewa, view.low_pass_variance_px2);
    let is_shape = (image.a + image.c).is_finite();
    if !(is_shape && image.tau > 0.0 && image.tau.is_finite()) {
        return None;
    }
    // The inverse depth D . n / (n . u), u = u2 D0. Under parallel rays: minus the depth.
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
        // The mean of the inverse depth over the part of the filtered kernel in the pixel. Mass that the
        // filter has moved keeps the inverse depth of its origin.
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

/// Returns the low-pass filter's standard deviation, pixels.
#[inline]
fn h_of(view: &ViewUniform) -> f32 {
    view.low_pass_variance_px2.sqrt()
}

/// Returns the greater standard deviation of a surfel.
#[inline]
fn widest(a: Vec3, b: Vec3) -> f32 {
    // Units of its own size: its squares would underflow or overflow at the scale of some scenes.
    let unit = a.abs().max(b.abs()).max_element();
    let (a, b) = (a / unit, b / unit);
    let (aa, bb, ab) = (a.length_squared(), b.length_squared(), a.dot(b));
    let half = 0.5 * (aa - bb);
    unit * (0.5 * (aa + bb) + (half * half + ab * ab).sqrt()).sqrt()
}

/// Returns the direction of a x b; `None` if it has none.
#[inline]
pub(crate) fn unit_normal(a: Vec3, b: Vec3) -> Option<Vec3> {
    let (a, b) = (a / a.abs().max_element(), b / b.abs().max_element());
    let normal = a.cross(b);
    let length = normal.length();
    // Phrased so that NaN gives none.
    (length > 1e-6).then(|| normal / length)
}

/// Returns the terms of a surfel that reaches the camera plane, and its weight at the centre.
///
/// For a ray D its inverse depth is N . D. Its coordinates along the tangents, in standard deviations,
/// are A . D / N . D and B . D / N . D. A, B and N are the first three of [`NearTerms::misses`]. `None`
/// as for [`surfel_footprint`], and if the eye lies in the surfel's plane.
///
/// No low-pass filter is applied: a surfel that reaches the eye is far wider than a pixel.
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
