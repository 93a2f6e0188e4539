//! Kernels that cross the plane of the eye: the line integral along the half line in front of it, one
//! pixel at a time. They are rare.
//!
//! Twin: `shaders/tile/evaluate/near.wgsl`.

use glam::Vec2;

use super::{Row, depth_reach};
use crate::constants::TILE_SIZE;
use crate::cpu::tile::arithmetic::cdf;
use crate::cpu::tile::pixels::{Patch, RowOf, TilePlace, ray};
use crate::math::normal_cdf;
use crate::record::{ExactTerms, Footprint, NearTerms, PATH_HALF_LINE, PATH_NEAR};
use crate::splat::{evaluate_near, near_share};

/// A near kernel on its way through the rows of a tile.
pub(in crate::cpu::tile) struct NearWalk<'a> {
    place: TilePlace<'a>,
    pub(super) footprint: &'a Footprint,
    terms: &'a NearTerms,
    pub(super) patch: Patch,
}

impl<'a> NearWalk<'a> {
    pub(super) fn new(
        place: &TilePlace<'a>,
        footprint: &'a Footprint,
        terms: &'a NearTerms,
    ) -> Self {
        Self {
            place: *place,
            footprint,
            terms,
            patch: place.patch(footprint),
        }
    }

    /// Row `y`: optical depths alone.
    pub(super) fn row(&self, y: usize) -> Row {
        let mut row = Row::new(self.footprint, y);
        for x in self.patch.columns[0]..self.patch.columns[1] {
            let tau = self.tau(self.place.centre(x, y));
            if tau > 0.0 {
                row.tau[x] = tau;
                row.inside[x] = 1;
                row.count += 1;
            }
        }
        row
    }

    /// The share of what a row's pixels see that lies in front of a depth of their own.
    pub(in crate::cpu::tile) fn shares_up_to(&self, row: &Row, depths: &RowOf<f32>) -> RowOf<f32> {
        let mut shares = [0.0; TILE_SIZE];
        for (x, share) in shares.iter_mut().enumerate() {
            if row.inside[x] != 0 {
                *share = self.share_up_to(self.place.centre(x, row.y), depths[x]);
            }
        }
        shares
    }

    pub(in crate::cpu::tile) fn terms(&self) -> &'a NearTerms {
        self.terms
    }

    /// The shares at which the ray through a pixel enters a plane's half-space and leaves it.
    pub(in crate::cpu::tile) fn edge_share<const FMA: bool>(
        &self,
        x: usize,
        y: usize,
        [ex, ey, ez, side]: [f32; 4],
    ) -> [f32; 2] {
        let pixel = self.place.centre(x, y);
        if self.footprint.path & 3 == PATH_NEAR {
            let direction = ray(self.place.view, pixel);
            let per_depth = ex * direction.x + ey * direction.y + ez;
            // The eye is inside or not, and the plane lies ahead or not.
            return match (side > 0.0, per_depth > 0.0) {
                (true, true) => [0.0, self.share_up_to(pixel, 1.0 / per_depth)],
                (true, false) => [0.0, 1.0],
                (false, true) => [self.share_up_to(pixel, 1.0 / per_depth), 1.0],
                (false, false) => [1.0, 0.0],
            };
        }
        let d = pixel - Vec2::from(self.footprint.centre_px);
        let deviations = ez + (ex * d.x + ey * d.y);
        let [gx, gy, z] = self.terms.half_line;
        let sigma = self.terms.sigma.max(f32::MIN_POSITIVE);
        let behind_eye = normal_cdf(-(z + gx * d.x + gy * d.y) / sigma);
        let in_front = |share: f32| {
            let share = (share - behind_eye) / (1.0 - behind_eye);
            // NaN leaves nothing.
            if share > 0.0 { share.min(1.0) } else { 0.0 }
        };
        if side > 0.0 {
            [in_front(cdf::<FMA>(-deviations)), 1.0]
        } else {
            [0.0, in_front(cdf::<FMA>(deviations))]
        }
    }

    /// Optical depth at a point of the image.
    fn tau(&self, pixel: Vec2) -> f32 {
        let Self {
            footprint, terms, ..
        } = self;
        if footprint.path & 3 == PATH_NEAR {
            let direction = ray(self.place.view, pixel);
            return evaluate_near(terms, footprint.tau, direction, footprint.cutoff_squared);
        }
        let d = pixel - Vec2::from(footprint.centre_px);
        let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
        let q = (px * d.x + py * d.y).powi(2) + (rx * d.x + ry * d.y).powi(2);
        if !(q <= footprint.cutoff_squared) {
            return 0.0;
        }
        let [gx, gy, z] = terms.half_line;
        let z = z + gx * d.x + gy * d.y;
        let in_front = normal_cdf(z / terms.sigma.max(f32::MIN_POSITIVE));
        footprint.tau * (-0.5 * q).exp() * in_front
    }

    /// Of what lies in front of the eye: the share that lies in front of a depth, too.
    fn share_up_to(&self, pixel: Vec2, at: f32) -> f32 {
        if at == f32::INFINITY {
            return 1.0;
        }
        let Self {
            footprint, terms, ..
        } = self;
        if footprint.path & 3 == PATH_NEAR {
            return near_share(terms, ray(self.place.view, pixel), at);
        }
        let d = pixel - Vec2::from(footprint.centre_px);
        let [gx, gy, z] = terms.half_line;
        let z = z + gx * d.x + gy * d.y;
        let sigma = terms.sigma.max(f32::MIN_POSITIVE);
        let behind_eye = normal_cdf(-z / sigma);
        let share = (normal_cdf((at - z) / sigma) - behind_eye) / (1.0 - behind_eye);
        if share.is_nan() {
            return 0.0;
        }
        share.clamp(0.0, 1.0)
    }

    /// How far it reaches along z on either side of its centre.
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
