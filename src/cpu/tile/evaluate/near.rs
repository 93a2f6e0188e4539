//! Evaluates kernels that cross the plane of the eye: the line integral along the half line in front of
//! it.
//!
//! Twin: `shaders/tile/evaluate/near.wgsl`.

use glam::Vec2;

use super::affine::RowForm;
use super::{Row, depth_reach};
use crate::constants::{MAX_CUTOFF, TILE_SIZE};
use crate::cpu::tile::pixels::{Patch, RowOf, TilePlace, ray};
use crate::math::lane::{cdf, exp_minus_half, madd};
use crate::record::{ExactTerms, Footprint, NearTerms, PATH_HALF_LINE, PATH_NEAR};
use crate::splat::misses_near;

/// A near kernel while the rows of a tile are evaluated.
pub(in crate::cpu::tile) struct NearWalk<'a> {
    place: TilePlace<'a>,
    pub(super) footprint: &'a Footprint,
    terms: &'a NearTerms,
    pub(super) patch: Patch,
}

impl<'a> NearWalk<'a> {
    /// Prepares a kernel for a tile. The patch is empty if no ray through the tile meets the kernel: the
    /// box of a kernel beside the eye is far larger than the pixels it covers.
    pub(super) fn new(
        place: &TilePlace<'a>,
        footprint: &'a Footprint,
        terms: &'a NearTerms,
    ) -> Self {
        let mut patch = place.patch(footprint);
        if footprint.path & 3 == PATH_NEAR && !patch.is_empty() {
            let middle = [0, 1].map(|i| place.px(i, 0) + 0.5 * (TILE_SIZE - 1) as f32);
            let half = Vec2::splat(0.5 * (TILE_SIZE - 1) as f32) / Vec2::from(place.view.focal_px);
            let middle = ray(place.view, middle.into());
            if misses_near(terms, middle, half, footprint.cutoff_squared) {
                patch.rows = [0; 2];
            }
        }
        Self {
            place: *place,
            footprint,
            terms,
            patch,
        }
    }

    /// Evaluates row `y`. Depths are those along the whole line, including the part behind the eye.
    #[inline(always)]
    pub(super) fn row<const FMA: bool>(&self, y: usize) -> Row {
        let mut row = Row::new(self.footprint, y);
        row.depth = 0.0;
        let mut limits = [-1.0; TILE_SIZE];
        limits[self.patch.columns[0]..self.patch.columns[1]].fill(self.footprint.cutoff_squared);
        let (q, tau) = if self.footprint.path & 3 == PATH_NEAR {
            self.on_rays::<FMA>(&mut row)
        } else {
            self.on_parallel_rays::<FMA>(&mut row)
        };
        for lane in 0..TILE_SIZE {
            // No contribution if the line lies behind the eye by more than a kernel's reach. Phi's tail
            // ends at 1e-12, which would be visible when multiplied by a great depth.
            let behind = row.ahead(lane, 0.0);
            let is_ahead = behind <= MAX_CUTOFF;
            let tau = tau[lane] * exp_minus_half::<FMA>(q[lane]) * cdf::<FMA>(-behind);
            // NaN compares false: outside.
            let is_inside = is_ahead & (q[lane] <= limits[lane]) & (tau > 0.0);
            row.tau[lane] = if is_inside { tau } else { 0.0 };
            row.inside[lane] = u32::from(is_inside);
        }
        row.count = row.inside.iter().sum();
        row
    }

    /// Returns Q, and the optical depth at Q = 0 if all of the line counts. Writes the mean and spread of
    /// z along the rays.
    #[inline(always)]
    fn on_rays<const FMA: bool>(&self, row: &mut Row) -> (RowOf<f32>, RowOf<f32>) {
        let terms = self.terms;
        let Vec2 { x: first, y: slope } =
            ray(self.place.view, self.place.centre(0, row.y)).truncate();
        let step = 1.0 / self.place.view.focal_px[0];
        let x: RowOf<f32> = std::array::from_fn(|lane| first + lane as f32 * step);
        let (mut miss, mut across, mut along) =
            ([0.0; TILE_SIZE], [0.0; TILE_SIZE], [0.0; TILE_SIZE]);
        for [of_x, of_y, of_z] in terms.misses {
            let base = madd::<FMA>(of_y, slope, of_z);
            for lane in 0..TILE_SIZE {
                let m = madd::<FMA>(of_x, x[lane], base);
                miss[lane] = madd::<FMA>(m, m, miss[lane]);
            }
        }
        for ([of_x, of_y, of_z], depth) in terms.minors.into_iter().zip(terms.minor_depths) {
            let base = madd::<FMA>(of_y, slope, of_z);
            for lane in 0..TILE_SIZE {
                let m = madd::<FMA>(of_x, x[lane], base);
                across[lane] = madd::<FMA>(m, m, across[lane]);
                along[lane] = madd::<FMA>(m, depth, along[lane]);
            }
        }
        let (mut q, mut tau) = ([0.0; TILE_SIZE], [0.0; TILE_SIZE]);
        // A flat kernel lies wholly on one side.
        let sigma = terms.sigma.max(f32::MIN_POSITIVE);
        for lane in 0..TILE_SIZE {
            let root = across[lane].sqrt();
            q[lane] = miss[lane] / across[lane];
            let length = madd::<FMA>(x[lane], x[lane], madd::<FMA>(slope, slope, 1.0)).sqrt();
            tau[lane] = self.footprint.tau * length / root;
            row.beyond[lane] = along[lane] / across[lane] * terms.unit;
            row.per_sigma[lane] = root / sigma / terms.unit;
        }
        (q, tau)
    }

    /// As `on_rays`, for an orthographic camera.
    #[inline(always)]
    fn on_parallel_rays<const FMA: bool>(&self, row: &mut Row) -> (RowOf<f32>, RowOf<f32>) {
        let Self {
            footprint, terms, ..
        } = self;
        let [gx, gy, z] = terms.half_line;
        let [cx, cy] = footprint.centre_px;
        let (first, dy) = (self.place.px(0, 0) - cx, self.place.px(1, row.y) - cy);
        let form = RowForm::new(footprint, dy);
        let mut q = [0.0; TILE_SIZE];
        for (lane, q) in q.iter_mut().enumerate() {
            let dx = first + lane as f32;
            *q = form.q::<FMA>(dx);
            row.beyond[lane] = z + gx * dx + gy * dy;
            row.per_sigma[lane] = 1.0 / terms.sigma.max(f32::MIN_POSITIVE);
        }
        (q, [footprint.tau; TILE_SIZE])
    }

    /// Returns the shares of a row's pixels that lie in front of a depth of each pixel.
    #[inline(always)]
    pub(in crate::cpu::tile) fn shares_up_to<const FMA: bool>(
        row: &Row,
        depths: &RowOf<f32>,
    ) -> RowOf<f32> {
        let mut shares = [0.0; TILE_SIZE];
        for lane in 0..TILE_SIZE {
            shares[lane] = share_up_to::<FMA>(row, lane, depths[lane]);
        }
        shares
    }

    pub(in crate::cpu::tile) fn terms(&self) -> &'a NearTerms {
        self.terms
    }

    /// Returns the shares at which the rays through a row's pixels enter a plane's half-space and leave
    /// it.
    #[inline(always)]
    pub(in crate::cpu::tile) fn edge_shares<const FMA: bool>(
        &self,
        row: &Row,
        [ex, ey, ez, side]: [f32; 4],
    ) -> [RowOf<f32>; 2] {
        let (mut from, mut to) = ([0.0; TILE_SIZE], [1.0; TILE_SIZE]);
        let is_inside = side > 0.0;
        let on_rays = self.footprint.path & 3 == PATH_NEAR;
        for lane in 0..TILE_SIZE {
            let pixel = self.place.centre(lane, row.y);
            if on_rays {
                let direction = ray(self.place.view, pixel);
                let per_depth = ex * direction.x + ey * direction.y + ez;
                let share = share_up_to::<FMA>(row, lane, 1.0 / per_depth);
                // Cases: the eye is inside or outside, the plane lies ahead or behind.
                [from[lane], to[lane]] = match (is_inside, per_depth > 0.0) {
                    (true, true) => [0.0, share],
                    (true, false) => [0.0, 1.0],
                    (false, true) => [share, 1.0],
                    (false, false) => [1.0, 0.0],
                };
            } else {
                let d = pixel - Vec2::from(self.footprint.centre_px);
                let deviations = ez + (ex * d.x + ey * d.y);
                let share =
                    share_at::<FMA>(row, lane, if is_inside { -deviations } else { deviations });
                if is_inside {
                    from[lane] = share;
                } else {
                    to[lane] = share;
                }
            }
        }
        [from, to]
    }

    /// Returns its reach along z on either side of its centre.
    pub(super) fn depth_reach(&self) -> f32 {
        if self.footprint.path & 3 != PATH_HALF_LINE {
            return self.terms.reach;
        }
        let [gx, gy, _] = self.terms.half_line;
        let as_exact = ExactTerms {
            gradient: [gx, gy],
            depth_sigma: self.terms.sigma,
            ..ExactTerms::default()
        };
        depth_reach(self.footprint, &as_exact)
    }
}

/// Returns the share, of the part in front of the eye, that lies in front of a depth.
#[inline(always)]
fn share_up_to<const FMA: bool>(row: &Row, lane: usize, depth: f32) -> f32 {
    share_at::<FMA>(row, lane, row.ahead(lane, depth))
}

/// As `share_up_to`, for a depth `ahead` standard deviations beyond the mean: 1 - Phi(-ahead) /
/// Phi(-eye). Only tails are used, because they have a small relative error.
#[inline(always)]
fn share_at<const FMA: bool>(row: &Row, lane: usize, ahead: f32) -> f32 {
    let share = 1.0 - cdf::<FMA>(-ahead) / cdf::<FMA>(-row.ahead(lane, 0.0));
    // NaN gives 0.
    if share > 0.0 { share } else { 0.0 }
}
