//! Clips surfels at planes. The coverage falls from 1 to 0 across the cut, softened by the low-pass
//! filter: Phi of the distance from the cut on the image, in standard deviations of the filter.
//!
//! Twin: `shaders/shared/clip.wgsl`.

use glam::{Mat2, Vec2};

use crate::constants::{CLIP_SOFTNESS, MAX_CLIP_PLANES, TILE_SIZE};
use crate::cpu::tile::evaluate::surfel::{NearSurfelAt, SurfelRow};
use crate::cpu::tile::pixels::{TilePlace, ray};
use crate::math::lane::{cdf, hypot, madd};
use crate::record::{Footprint, SurfelTerms, ViewUniform};

/// The clip planes that cut a surfel. The distance inside a plane, in standard deviations of the low-pass
/// filter, is linear over the image.
///
/// The low-pass filter spreads a surfel: a pixel at offset d from its centre shows, on average, the point
/// at F d, with F = V (V + V_h)⁻¹ = 1 - V_h S⁻¹ and S the variance of the footprint. The gradient of the
/// surfel's inverse depth already refers to the image.
#[derive(Debug, Clone, Copy)]
pub(in crate::cpu::tile) struct ClipEdges {
    /// Distance inside at the surfel's centre, and its change per pixel.
    edges: [[f32; 3]; MAX_CLIP_PLANES],
    count: usize,
}

impl ClipEdges {
    /// Returns the planes that cut a surfel in a tile; `None` if there are none.
    #[inline(always)]
    pub(in crate::cpu::tile) fn of(
        place: &TilePlace<'_>,
        footprint: &Footprint,
        terms: &SurfelTerms,
    ) -> Option<Self> {
        let view = place.view;
        if view.clip_count == 0 {
            return None;
        }
        let patch = place.patch(footprint);
        let first = |i: usize| place.px(i, 0) - footprint.centre_px[i];
        let reach = hypot(
            farthest(patch.columns, first(0)),
            farthest(patch.rows, first(1)),
        );
        let edges = Self::new(
            view,
            footprint.centre_px.into(),
            terms.inverse_depth,
            terms.gradient.into(),
            shown(view, footprint, terms),
            reach,
        );
        (edges.count > 0).then_some(edges)
    }

    /// Returns the share that remains of a surfel across the plane of the eye, at a point of the image.
    pub(in crate::cpu::tile) fn share_of_near(
        view: &ViewUniform,
        pixel: Vec2,
        at: &NearSurfelAt,
    ) -> f32 {
        let gradient = at.plane.truncate() / Vec2::from(view.focal_px);
        let edges = Self::new(view, pixel, at.inverse_depth, gradient, Mat2::IDENTITY, 0.0);
        edges.share::<false>(0.0, 0.0)
    }

    /// Multiplies a row of a surfel by the shares that remain. `dx` and `dy` lead from its centre to the
    /// row's first pixel.
    #[inline(always)]
    pub(in crate::cpu::tile) fn cut<const FMA: bool>(
        &self,
        row: &mut SurfelRow,
        [dx, dy]: [f32; 2],
    ) {
        let mut shares = [0.0; TILE_SIZE];
        for (lane, share) in shares.iter_mut().enumerate() {
            *share = self.share::<FMA>(dx + lane as f32, dy);
        }
        for (lane, share) in shares.into_iter().enumerate() {
            // NaN leaves nothing.
            let is_left = share > 0.0;
            row.weight[lane] *= if is_left { share } else { 0.0 };
            row.inside[lane] *= f32::from(u8::from(is_left));
        }
    }

    /// Returns the planes that cut a surfel's plane within `reach` pixels, given its inverse depth at a
    /// point of the image and the change of the inverse depth.
    ///
    /// - `shown`: F.
    fn new(
        view: &ViewUniform,
        pixel: Vec2,
        inverse_depth: f32,
        gradient: Vec2,
        shown: Mat2,
        reach: f32,
    ) -> Self {
        let mut edges = Self {
            edges: [[0.0; 3]; MAX_CLIP_PLANES],
            count: 0,
        };
        let direction = ray(view, pixel);
        let focal = Vec2::from(view.focal_px);
        for &[nx, ny, nz, d] in &view.clip_planes[..view.clip_count as usize] {
            // Distance of the point D / inverse depth (orthographic: X, Y, -inverse depth), times a
            // positive number.
            let across = nx * direction.x + ny * direction.y;
            let (inside, rate) = if view.orthographic == 0 {
                (across + nz + d * inverse_depth, d)
            } else {
                (across - nz * inverse_depth + d, -nz)
            };
            let slope = shown * (Vec2::new(nx, ny) / focal) + gradient * rate;
            // The variance of the part that a pixel shows is h² F.
            let kept = slope.dot(shown * slope) / slope.length_squared();
            let spread = (view.low_pass_variance_px2 / kept.max(LEAST_SHOWN)).sqrt();
            let softness = slope.length() * spread;
            let scale = 1.0 / softness.max(f32::MIN_POSITIVE);
            if inside * scale - slope.length() * scale * reach < WHOLE {
                let slope = slope * scale;
                edges.edges[edges.count] = [inside * scale, slope.x, slope.y];
                edges.count += 1;
            }
        }
        edges
    }

    /// Returns the share of a surfel that remains at an offset from its centre; 0 beyond the softness.
    #[inline(always)]
    fn share<const FMA: bool>(&self, dx: f32, dy: f32) -> f32 {
        let mut share = 1.0;
        for [inside, along_x, along_y] in &self.edges[..self.count] {
            let inside = madd::<FMA>(*along_x, dx, madd::<FMA>(*along_y, dy, *inside));
            // Phrased so that NaN is outside.
            share *= if inside > -CLIP_SOFTNESS {
                cdf::<FMA>(inside)
            } else {
                0.0
            };
        }
        share
    }
}

/// Number of standard deviations inside a plane from which a surfel is whole: Phi is 1 in f32.
const WHOLE: f32 = 5.5;

/// Least share of a surfel in a pixel, that of a surfel of a thousandth of a pixel. Below it the
/// roundings of F dominate.
const LEAST_SHOWN: f32 = 1e-6;

/// Returns F of [`ClipEdges`]. For surfels that follow their plane's homography F is 1, because their
/// inverse depth is not filtered.
fn shown(view: &ViewUniform, footprint: &Footprint, terms: &SurfelTerms) -> Mat2 {
    if terms.homography > 0.0 {
        return Mat2::IDENTITY;
    }
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    let across = px * py + rx * ry;
    let inverse = Mat2::from_cols_array(&[px * px + rx * rx, across, across, py * py + ry * ry]);
    Mat2::IDENTITY - inverse * view.low_pass_variance_px2
}

/// Returns the distance of the farthest of a row or column of pixels from a centre; `first` is the offset
/// of the tile's first pixel.
fn farthest([start, end]: [usize; 2], first: f32) -> f32 {
    (first + start as f32).abs().max((first + end as f32).abs())
}
