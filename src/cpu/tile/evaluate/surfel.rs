//! Evaluates surfels of opaque surfaces: their weights, and the inverse depth of their plane, which is
//! linear over the image. Q is that of the affine footprint. With a homography it is divided by the
//! square of the inverse depth relative to the centre's.
//!
//! Twin: `shaders/tile/evaluate/surfel.wgsl`.

use std::ops::Range;

use glam::Vec3;

use super::Walk;
use super::affine::RowForm;
use crate::constants::TILE_SIZE;
use crate::cpu::tile::pixels::{RowOf, TilePlace, ray};
use crate::math::lane::{exp_minus_half, madd};
use crate::math::unpack_normal;
use crate::record::{Footprint, NearTerms, SurfelTerms};

/// A surfel at the pixels of a row.
pub(in crate::cpu::tile) struct SurfelRow {
    /// Weights; 0 outside the cut-off.
    pub(in crate::cpu::tile) weight: RowOf<f32>,
    pub(in crate::cpu::tile) inverse_depth: RowOf<f32>,
    /// 1 within the cut-off.
    pub(in crate::cpu::tile) inside: RowOf<f32>,
}

impl SurfelRow {
    /// Removes the pixels at which the surfel lies beyond the end of the ray.
    ///
    /// - `ends`: inverse depths of the row's ends.
    #[inline(always)]
    pub(in crate::cpu::tile) fn end(&mut self, ends: &[f32]) {
        let Some(ends) = ends.first_chunk::<TILE_SIZE>() else {
            return;
        };
        for (lane, end) in ends.iter().enumerate() {
            // Phrased so that NaN is beyond.
            let is_shown = self.inverse_depth[lane] > *end;
            let shown = if is_shown { 1.0 } else { 0.0 };
            self.weight[lane] *= shown;
            self.inside[lane] *= shown;
        }
    }
}

/// A surfel while the rows of a tile are evaluated.
pub(in crate::cpu::tile) struct SurfelWalk<'a> {
    walk: Walk<'a>,
    terms: &'a SurfelTerms,
}

impl<'a> SurfelWalk<'a> {
    #[inline(always)]
    pub(in crate::cpu::tile) fn new(
        place: &TilePlace<'_>,
        footprint: &'a Footprint,
        terms: &'a SurfelTerms,
    ) -> Self {
        Self {
            walk: Walk::new(place, footprint, None),
            terms,
        }
    }

    /// Returns the rows of the tile that it may reach.
    #[inline(always)]
    pub(in crate::cpu::tile) fn rows(&self) -> Range<usize> {
        self.walk.rows[0]..self.walk.rows[1]
    }

    /// Returns the offset from its centre to the first pixel of row `y`.
    #[inline(always)]
    pub(in crate::cpu::tile) fn offset(&self, y: usize) -> [f32; 2] {
        [self.walk.first[0], self.walk.dy(y)]
    }

    /// Returns the unit normal, camera space, towards the eye.
    pub(in crate::cpu::tile) fn normal(&self) -> [f32; 3] {
        unpack_normal(self.terms.normal).into()
    }

    /// Evaluates row `y` of the tile.
    #[inline(always)]
    pub(in crate::cpu::tile) fn row<const FMA: bool, const HOMOGRAPHY: bool>(
        &self,
        y: usize,
    ) -> SurfelRow {
        let Self { walk, terms } = self;
        let footprint = walk.footprint;
        let [gx, gy] = terms.gradient;
        let peak = footprint.weight();
        let per_centre = 1.0 / terms.inverse_depth;
        let dy = walk.dy(y);
        let form = RowForm::new(footprint, dy);
        let of_row = madd::<FMA>(gy, dy, terms.inverse_depth);
        let mut row = SurfelRow {
            weight: [0.0; TILE_SIZE],
            inverse_depth: [0.0; TILE_SIZE],
            inside: [0.0; TILE_SIZE],
        };
        for lane in 0..TILE_SIZE {
            let dx = walk.dx(lane);
            let mut q = form.q::<FMA>(dx);
            let z = madd::<FMA>(gx, dx, of_row);
            let mut is_inside = true;
            if HOMOGRAPHY {
                let root = z * per_centre;
                q /= root * root;
                is_inside = root > 0.0;
            }
            // NaN compares false: outside.
            is_inside &= q <= walk.limits[lane];
            row.weight[lane] = if is_inside {
                peak * exp_minus_half::<FMA>(q)
            } else {
                0.0
            };
            row.inverse_depth[lane] = z;
            row.inside[lane] = f32::from(u8::from(is_inside));
        }
        row
    }
}

/// A surfel that reaches the plane of the eye.
pub(in crate::cpu::tile) struct NearSurfel<'a> {
    place: TilePlace<'a>,
    footprint: &'a Footprint,
    terms: &'a NearTerms,
}

/// A surfel across the plane of the eye, at a pixel.
pub(in crate::cpu::tile) struct NearSurfelAt {
    pub(in crate::cpu::tile) weight: f32,
    pub(in crate::cpu::tile) inverse_depth: f32,
    /// Change of the inverse depth along the ray's slope: N of
    /// [`near_surfel`](crate::splat::near_surfel).
    pub(in crate::cpu::tile) plane: Vec3,
    /// Greatest difference of inverse depth between surfels that count as one surface.
    pub(in crate::cpu::tile) slack: f32,
    /// Unit normal towards the eye.
    pub(in crate::cpu::tile) normal: [f32; 3],
}

impl<'a> NearSurfel<'a> {
    pub(in crate::cpu::tile) fn new(
        place: &TilePlace<'a>,
        footprint: &'a Footprint,
        terms: &'a NearTerms,
    ) -> Self {
        Self {
            place: *place,
            footprint,
            terms,
        }
    }

    /// Evaluates the surfel at a pixel of the tile; `None` outside its cut-off.
    pub(in crate::cpu::tile) fn at(&self, x: usize, y: usize) -> Option<NearSurfelAt> {
        let [a, b, n] = [0, 1, 2].map(|i| Vec3::from(self.terms.misses[i]));
        let d = ray(self.place.view, self.place.centre(x, y));
        let inverse_depth = d.dot(n);
        let (along_a, along_b) = (d.dot(a) / inverse_depth, d.dot(b) / inverse_depth);
        let q = along_a * along_a + along_b * along_b;
        // Phrased so that NaN is outside.
        if !(inverse_depth > 0.0 && q <= self.footprint.cutoff_squared) {
            return None;
        }
        let normal = n.normalize_or_zero();
        let is_behind = normal.dot(d) > 0.0;
        Some(NearSurfelAt {
            weight: self.footprint.weight() * (-0.5 * q).exp(),
            inverse_depth,
            plane: n,
            slack: self.terms.sigma * inverse_depth * inverse_depth,
            normal: if is_behind { -normal } else { normal }.into(),
        })
    }
}
