//! Computes one particle's footprint, of any kind, including those that lanes can compute.

use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

use glam::{Vec2, Vec3};

use super::output::ProjectOutput;
use crate::constants::{MAX_CUTOFF, NEAR_MARGIN, TILE_SIZE};
use crate::record::{
    BlockView, Carried, ExactTerms, Footprint, KeyKind, NearTerms, PATH_AFFINE, PATH_CAPPED,
    PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_NEAR_SURFEL, PATH_PEAK, PATH_SURFEL, SurfelTerms,
    ViewUniform, pack_range,
};
use crate::scene::SplatRule;
use crate::splat::{
    Edges, Filter, ImageKernel, Kernel, SPLAT_LOW_PASS_PX2, ScreenFactor, SurfelFootprint,
    budget::CUTOFF_SHARE, choose_exact, cutoff_radius, cutoff_share, defocus, depth_terms,
    edge_growth, exact_extent, half_line_terms, meeting, near_surfel, near_terms, peak_footprint,
    peak_reach, project_kernel, surfel_footprint,
};

/// Returns the key of the depth, or of the distance |B + o| = |B| + o.(2B + o)/(|B + o| + |B|): the block's own key, which
/// is exact, plus a difference that f32 resolves to some 22 bits of the block's size. The error is within
/// 1.5 keys and four roundings of that size (`tests/frames/bounds.rs`).
#[inline]
pub(super) fn depth_key(view: &ViewUniform, block: &BlockView, origin: Vec3, offset: Vec3) -> u32 {
    let delta = if view.key_kind == KeyKind::Layers as u32 {
        offset.dot(Vec3::from(view.key_axis))
    } else if view.key_kind == KeyKind::Depth as u32 {
        offset.z
    } else {
        let sum = (origin + offset).length() + origin.length();
        if sum > 0.0 {
            offset.dot(origin * 2.0 + offset) / sum
        } else {
            0.0
        }
    };
    let keys = (delta * view.key_scale).round_ties_even() as i32;
    block.key.saturating_add_signed(keys)
}

/// Returns the key of the depth at which a kernel begins; kernels that begin behind the eye get the depth
/// of the eye.
#[inline]
pub(super) fn slab_key(
    view: &ViewUniform,
    block: &BlockView,
    origin: Vec3,
    kernel: &Kernel,
    footprint: &Footprint,
) -> u32 {
    let reach = footprint.cutoff_squared.sqrt() * kernel.factor.z.length();
    let begin = (kernel.centre.z - reach).max(0.0);
    let keys = ((begin - origin.z) * view.key_scale).round_ties_even() as i32;
    block.key.saturating_add_signed(keys)
}

/// Returns a footprint that reaches no pixel yet.
#[inline]
pub(super) fn invisible(kernel: &Kernel, carried: Carried, key: u32) -> Footprint {
    Footprint {
        centre_px: [0.0; 2],
        form_p: [0.0; 2],
        form_r: [0.0; 2],
        tau: 0.0,
        cutoff_squared: 0.0,
        carried,
        depth: kernel.centre.z,
        path: PATH_AFFINE,
        columns: 0,
        rows: 0,
        key,
    }
}

/// Returns the footprint of a splat whose opacity is stated. The mass lost by the cut-off is not
/// restored: the peak stays.
#[inline]
pub(super) fn splat_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    crowding: f32,
    rule: SplatRule,
    carried: Carried,
    key: u32,
) -> Footprint {
    let mut out = invisible(kernel, carried, key);
    let Some((screen, image)) = peak_footprint(view, kernel, rule) else {
        return out;
    };
    let depth = image.tau * image.enlargement * meeting(crowding);
    let r = cutoff_radius(depth, 1.0, view.tolerance, view.cutoff);
    // The limits of a rule are those of sharp splats.
    let rule = if defocus(view, kernel) > SPLAT_LOW_PASS_PX2 {
        SplatRule::Exact
    } else {
        rule
    };
    let Some(r) = peak_reach(rule, image.tau, r) else {
        return out;
    };
    affine_part(&mut out, &screen, &image, r);
    out.tau = image.tau;
    out.path = if rule.has_limits() {
        PATH_CAPPED
    } else {
        PATH_PEAK
    };
    let half = affine_bounds(&image, r);
    set_bounds(view, &mut out, screen.centre_px, half);
    out
}

/// Returns the footprint of a surfel of an opaque surface.
#[inline]
pub(super) fn surfel(
    view: &ViewUniform,
    kernel: &Kernel,
    is_one_sided: bool,
    carried: Carried,
    key: u32,
    plane: &mut Option<SurfelTerms>,
    near: &Mutex<Vec<NearTerms>>,
) -> Footprint {
    let mut out = invisible(kernel, carried, key);
    // Weights are averaged, so the error at a kernel's end is relative.
    let r = cutoff_radius(0.0, 1.0, view.tolerance / CUTOFF_SHARE, view.cutoff);
    let reach = r * kernel.factor.z.length();
    if kernel.centre.z < -reach {
        return out;
    }
    if kernel.centre.z <= NEAR_MARGIN * reach && view.orthographic == 0 {
        let Some((terms, weight)) = near_surfel(kernel, is_one_sided) else {
            return out;
        };
        let columns = near_range(kernel, Vec3::X, kernel.factor.x, view, 0, r, 0.0);
        let rows = near_range(kernel, Vec3::Y, kernel.factor.y, view, 1, r, 0.0);
        if let (Some(columns), Some(rows)) = (columns, rows) {
            out.columns = columns;
            out.rows = rows;
            out.tau = weight / cutoff_share(r);
            out.cutoff_squared = r * r;
            out.path = push_at(near, terms) << 4 | PATH_NEAR_SURFEL;
            out.depth = f32::INFINITY;
        }
        return out;
    }
    let Some(surfel) = surfel_footprint(view, kernel, is_one_sided, r) else {
        return out;
    };
    let SurfelFootprint {
        screen,
        image,
        terms,
    } = surfel;
    affine_part(&mut out, &screen, &image, r);
    out.path = PATH_SURFEL;
    let mut middle = Vec2::ZERO;
    let mut half = affine_bounds(&image, r);
    if terms.homography > 0.0 {
        let h2 = view.low_pass_variance_px2;
        let Some(extent) = exact_extent(&screen, h2, r) else {
            return out;
        };
        (middle, half) = extent;
    }
    set_bounds(view, &mut out, screen.centre_px + middle, half);
    // Greatest inverse depth within the box: no fragment of the surfel is nearer.
    let gradient = Vec2::from(terms.gradient);
    let nearest = terms.inverse_depth + gradient.dot(middle) + gradient.abs().dot(half);
    out.depth = nearest + terms.slack;
    *plane = Some(terms);
    out
}

/// Returns the cosine between a surfel's normal and the ray through its centre. It makes the optical
/// depth of a sheet the same from every side. 0 for a one-sided surfel seen from behind.
#[inline]
pub(super) fn facing(view: &ViewUniform, kernel: &Kernel, is_one_sided: bool) -> f32 {
    let [a, b, _] = kernel.factor.columns();
    let unit = |v: Vec3| v / v.abs().max_element();
    let normal = unit(a).cross(unit(b));
    let ray = if view.orthographic != 0 {
        Vec3::Z
    } else {
        unit(kernel.centre)
    };
    let across = normal.dot(ray);
    let lengths = normal.length() * ray.length();
    // Phrased so that NaN draws nothing.
    if !(lengths > 0.0) || (is_one_sided && across > 0.0) {
        return 0.0;
    }
    across.abs() / lengths
}

/// Returns the footprint of one kernel; invisible if it reaches no pixel.
#[allow(
    clippy::too_many_arguments,
    reason = "what one kernel's footprint depends on, and where its terms go"
)]
#[inline]
pub(super) fn footprint(
    view: &ViewUniform,
    filter: Filter,
    is_lone: bool,
    kernel: &Kernel,
    crowding: f32,
    carried: Carried,
    key: u32,
    is_cut: bool,
    exact: &mut Option<ExactTerms>,
    near: &Mutex<Vec<NearTerms>>,
) -> Footprint {
    let mut out = invisible(kernel, carried, key);
    let h2 = view.low_pass_variance_px2;
    let z = kernel.factor.z;
    let mut reach = z.length();
    if reach == f32::INFINITY {
        // Lengths beyond 1e19, whose squares overflow f32.
        reach = z.x.hypot(z.y).hypot(z.z);
    }
    if kernel.centre.z < -MAX_CUTOFF * reach {
        return out;
    }
    let orthographic = view.orthographic != 0;
    if kernel.centre.z <= 0.0 && !orthographic {
        near_footprint(view, kernel, crowding, near, &mut out);
        return out;
    }
    let screen = project_kernel(view, kernel);
    let mut image = screen.filtered(filter, h2);
    if is_lone {
        image = screen.as_lone(filter, h2, image);
    }
    let is_shape = screen.row_x.is_finite() && screen.row_y.is_finite();
    if !(is_shape && image.tau > 0.0 && image.tau.is_finite()) {
        // A singular footprint (no low-pass filter), or numbers beyond f32.
        return out;
    }
    // Total depth of the kernels whose edges coincide.
    let depth = image.tau * image.enlargement * meeting(crowding);
    let mut r = cutoff_radius(depth, 1.0, view.tolerance, view.cutoff);
    let mut terms = choose_exact(view, filter, &screen, &image, crowding);
    if let Some(terms) = &terms {
        // Away from the camera's axis one side of the edge exceeds exp(-r²/2). The kernel ends where that
        // side falls below the tolerance. The radius is a tenth larger, because the wider edge exceeds it
        // more.
        let growth = edge_growth(view, &screen, &image, terms, 1.1 * r);
        let wider = cutoff_radius(depth, growth, view.tolerance, view.cutoff);
        // `max` takes the other argument when one is NaN.
        r = r.max(wider);
    }
    if kernel.centre.z <= NEAR_MARGIN * r * reach {
        if orthographic {
            half_line_footprint(view, kernel, near, &mut out, &screen, &image, r);
        } else {
            near_footprint(view, kernel, crowding, near, &mut out);
        }
        return out;
    }
    if terms.is_some() {
        let Some((middle, half)) = exact_extent(&screen, h2, r) else {
            return out;
        };
        if let (true, Some(terms)) = (is_cut, &mut terms) {
            (_, terms.depth_sigma) =
                depth_terms(view, &screen, h2, image.determinant, kernel.centre.z);
        }
        *exact = terms;
        affine_part(&mut out, &screen, &image, r);
        out.path = PATH_EXACT;
        // |D| is evaluated per pixel; |D0| goes here.
        out.tau /= screen.ray_length;
        set_bounds(view, &mut out, screen.centre_px + middle, half);
    } else {
        if is_cut {
            let determinant = screen.filtered(Filter::Ewa, h2).determinant;
            let (slope, depth_sigma) = depth_terms(view, &screen, h2, determinant, kernel.centre.z);
            *exact = Some(ExactTerms {
                gradient: slope.into(),
                depth_sigma,
                ..ExactTerms::default()
            });
        }
        affine_part(&mut out, &screen, &image, r);
        let half = affine_bounds(&image, r);
        set_bounds(view, &mut out, screen.centre_px, half);
    }
    out
}

#[inline]
fn affine_part(out: &mut Footprint, screen: &ScreenFactor, image: &ImageKernel, r: f32) {
    let [p, q] = image.triangular_form();
    out.centre_px = screen.centre_px.into();
    out.form_p = p;
    out.form_r = q;
    out.tau = image.tau / cutoff_share(r);
    out.cutoff_squared = r * r;
}

/// Returns the half extents of the box around the cut-off `r` of an affine footprint, pixels.
#[inline(always)]
pub(super) fn affine_bounds(image: &ImageKernel, r: f32) -> Vec2 {
    Vec2::new(image.a.sqrt(), image.c.sqrt()) * r
}

/// Sets the ranges of pixels whose centres lie within `half` of `centre`.
#[inline]
fn set_bounds(view: &ViewUniform, out: &mut Footprint, centre: Vec2, half: Vec2) {
    let columns = pixel_range(centre.x, half.x, view.size[0]);
    let rows = pixel_range(centre.y, half.y, view.size[1]);
    if columns != 0 && rows != 0 {
        (out.columns, out.rows) = (columns, rows);
    }
}

/// Returns the range of pixels along an axis of `size` pixels whose centres lie within `half` of
/// `centre`; 0 if there are none.
#[inline(always)]
pub(super) fn pixel_range(centre: f32, half: f32, size: u32) -> u32 {
    let size = size as f32;
    // NaN gives 0: an empty range.
    let first = (centre - half - 0.5).ceil().max(0.0);
    let end = ((centre + half - 0.5).floor() + 1.0).max(0.0).min(size);
    let range = pack_range(first.min(size) as u32, end as u32);
    if first < end { range } else { 0 }
}

fn push(near: &Mutex<Vec<NearTerms>>, terms: NearTerms, path: u32) -> u32 {
    push_at(near, terms) << 2 | path
}

/// Appends terms to those of near kernels, and returns their index.
fn push_at(near: &Mutex<Vec<NearTerms>>, terms: NearTerms) -> u32 {
    let mut near = near.lock().unwrap_or_else(PoisonError::into_inner);
    near.push(terms);
    (near.len() - 1) as u32
}

/// Adds the planes at which the boundary of its domain cuts a kernel to its footprint.
pub(super) fn cut_by_edges(
    view: &ViewUniform,
    kernel: &Kernel,
    edges: &Edges,
    out: &Footprint,
    terms: &mut Option<ExactTerms>,
    output: &ProjectOutput,
) {
    let near = &output.near;
    if matches!(out.path & 3, PATH_NEAR | PATH_HALF_LINE) {
        let mut near = near.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = near.get_mut((out.path >> 2) as usize) {
            edges.write(view, kernel, out.path, own);
        }
        return;
    }
    let mut own = NearTerms::default();
    edges.write(view, kernel, out.path, &mut own);
    output.cut_count.fetch_add(1, Ordering::Relaxed);
    terms.get_or_insert_default().edges = push_at(near, own) + 1;
}

/// Computes the footprint of an orthographic kernel that reaches behind the eye's plane.
fn half_line_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    near: &Mutex<Vec<NearTerms>>,
    out: &mut Footprint,
    screen: &ScreenFactor,
    image: &ImageKernel,
    r: f32,
) {
    affine_part(out, screen, image, r);
    let half = affine_bounds(image, r);
    set_bounds(view, out, screen.centre_px, half);
    if out.is_visible() {
        let h2 = view.low_pass_variance_px2;
        let determinant = screen.filtered(Filter::Ewa, h2).determinant;
        let (slope, sigma) = depth_terms(view, screen, h2, determinant, kernel.centre.z);
        out.path = push(near, half_line_terms(kernel, slope, sigma), PATH_HALF_LINE);
    }
}

/// Computes the footprint of a perspective kernel that reaches the camera plane.
fn near_footprint(
    view: &ViewUniform,
    kernel: &Kernel,
    crowding: f32,
    near: &Mutex<Vec<NearTerms>>,
    out: &mut Footprint,
) {
    let Some((terms, weight)) = near_terms(view, kernel) else {
        return;
    };
    // A bound of the optical depth in any direction: |D|/sqrt(DᵀKD) <= sqrt(trace V / det V), V with the
    // low-pass filter of `near_terms`.
    let h = view.low_pass_variance_px2.sqrt();
    let low_pass = h * kernel.centre.z.abs().max(kernel.factor.z.length());
    let trace = kernel
        .factor
        .columns()
        .into_iter()
        .chain(view.focal_px.map(|f| Vec3::X * (low_pass / f)))
        .map(|c| c.length_squared())
        .sum::<f32>();
    let unit2 = kernel.mass / (std::f32::consts::TAU * weight);
    let mut highest = weight * (trace / unit2).sqrt() / terms.sigma;
    if !highest.is_finite() {
        // A flat kernel's bound is infinite, and NaN must not reduce the radius.
        highest = f32::MAX;
    }
    let r = cutoff_radius(
        highest * meeting(crowding),
        1.0,
        view.tolerance,
        view.cutoff,
    );
    let columns = near_range(kernel, Vec3::X, kernel.factor.x, view, 0, r, h);
    let rows = near_range(kernel, Vec3::Y, kernel.factor.y, view, 1, r, h);
    if let (Some(columns), Some(rows)) = (columns, rows) {
        out.columns = columns;
        out.rows = rows;
        out.tau = weight / cutoff_share(r);
        out.cutoff_squared = r * r;
        let terms = NearTerms {
            reach: r * kernel.factor.z.length(),
            ..terms
        };
        out.path = push(near, terms, PATH_NEAR);
    }
}

/// Returns the pixels along one axis that the cut-off ellipsoid may reach, in whole tiles: from the first
/// to the last slab that neither bounding plane separates from it.
fn near_range(
    kernel: &Kernel,
    axis: Vec3,
    row: Vec3,
    view: &ViewUniform,
    i: usize,
    r: f32,
    h: f32,
) -> Option<u32> {
    let size = view.size[i];
    let tile = TILE_SIZE as u32;
    let slope_at = |px: f32| (px - view.centre_px[i]) / view.focal_px[i];
    // The low-pass filter of `near_terms`, as a width in the plane of the image.
    let reach_z = kernel.factor.z.length();
    let low_pass = h * kernel.centre.z.abs().max(reach_z) / view.focal_px[i];
    // Extent of the ellipsoid beyond the plane x = X z, on either side of it.
    let side = |slope: f32| {
        let centre = kernel.centre.dot(axis) - slope * kernel.centre.z;
        let reach = r * (row - kernel.factor.z * slope).length().hypot(low_pass);
        (centre - reach, centre + reach)
    };
    let reaches = |t: u32| {
        let (_, highest) = side(slope_at((t * tile) as f32));
        let (lowest, _) = side(slope_at(((t + 1) * tile) as f32));
        highest >= 0.0 && lowest <= 0.0
    };
    let tiles = size.div_ceil(tile);
    let first = (0..tiles).find(|&t| reaches(t))?;
    let last = (first..tiles).rev().find(|&t| reaches(t))?;
    Some(pack_range(first * tile, ((last + 1) * tile).min(size)))
}
