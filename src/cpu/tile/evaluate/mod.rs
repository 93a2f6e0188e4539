//! Axis *evaluate*: computes the optical depth of a kernel along the rays of a row of pixels, and its
//! depth along the rays. A footprint's path selects the file. The next axes, *interval* and *accumulate*,
//! receive rows and do not depend on the path.

pub(super) mod affine;
pub(super) mod exact;
pub(super) mod near;
pub(super) mod surfel;

use std::ops::Range;

use glam::Vec2;

use super::pixels::{RowOf, TilePlace};
use crate::constants::TILE_SIZE;
use crate::record::{ExactTerms, Footprint, NearTerms, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR};

/// A kernel at the pixels of a row.
pub(super) struct Row {
    /// Index of the row in the tile.
    pub(super) y: usize,
    /// Optical depths; 0 outside.
    pub(super) tau: RowOf<f32>,
    /// Depth of the footprint's centre; 0, the eye's, for near kernels.
    pub(super) depth: f32,
    /// Mean z of the kernel along each ray, minus `depth`.
    pub(super) beyond: RowOf<f32>,
    /// One over the standard deviation of z.
    pub(super) per_sigma: RowOf<f32>,
    /// 1 within the cut-off.
    pub(super) inside: RowOf<u32>,
    /// Number of pixels within the cut-off.
    pub(super) count: u32,
    /// Shares of the optical depth along each ray at which the domain begins and ends, if its boundary
    /// cuts the kernel.
    pub(super) domain: Option<[RowOf<f32>; 2]>,
}

impl Row {
    #[inline(always)]
    fn new(footprint: &Footprint, y: usize) -> Self {
        Self {
            y,
            tau: [0.0; TILE_SIZE],
            depth: footprint.depth,
            beyond: [0.0; TILE_SIZE],
            per_sigma: [0.0; TILE_SIZE],
            inside: [0; TILE_SIZE],
            count: 0,
            domain: None,
        }
    }

    /// Returns the distance of a depth beyond the kernel's mean, in standard deviations. The footprint's
    /// depth is subtracted first: sums of depths would round away the cuts of needles, by a hundredth of
    /// the width of 1:10,000 ones.
    #[inline(always)]
    pub(super) fn ahead(&self, lane: usize, depth: f32) -> f32 {
        ((depth - self.depth) - self.beyond[lane]) * self.per_sigma[lane]
    }

    /// Returns the index of its first pixel in the tile.
    #[inline(always)]
    pub(super) fn first(&self) -> usize {
        self.y * TILE_SIZE
    }
}

/// Derivatives of a kernel at the pixels of a row, along the columns and the rows of the image.
pub(super) struct RowSlope {
    /// Derivatives of the logarithm of the optical depth.
    pub(super) log_tau: [RowOf<f32>; 2],
    /// Derivatives of the mean z.
    pub(super) mean: [RowOf<f32>; 2],
}

/// A footprint while the rows of a tile are evaluated.
pub(super) struct Walk<'a> {
    pub(super) footprint: &'a Footprint,
    /// Offset from its centre to the tile's first pixel.
    first: [f32; 2],
    /// Limit of Q for each column; negative outside the patch, where no pixel is within the cut-off.
    limits: RowOf<f32>,
    rows: [usize; 2],
    /// The planes at which the boundary of its domain cuts the kernel.
    pub(super) edges: Option<&'a NearTerms>,
}

impl<'a> Walk<'a> {
    #[inline(always)]
    fn new(place: &TilePlace<'_>, footprint: &'a Footprint, edges: Option<&'a NearTerms>) -> Self {
        let patch = place.patch(footprint);
        let mut limits = [-1.0; TILE_SIZE];
        limits[patch.columns[0]..patch.columns[1]].fill(footprint.cutoff_squared);
        let first = |i: usize| place.px(i, 0) - footprint.centre_px[i];
        Self {
            footprint,
            first: [first(0), first(1)],
            limits,
            rows: patch.rows,
            edges,
        }
    }

    /// Returns the offset of row `y` from the centre.
    #[inline(always)]
    pub(super) fn dy(&self, y: usize) -> f32 {
        self.first[1] + y as f32
    }

    /// Returns the offset of a column from the centre.
    #[inline(always)]
    pub(super) fn dx(&self, lane: usize) -> f32 {
        self.first[0] + lane as f32
    }
}

/// Distribution of a kernel's optical depth along a ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Along {
    /// A Gaussian.
    Gaussian,
    /// All at the centre's depth: a splat that states its opacity is not divided.
    Point,
    /// The part of a Gaussian in front of the eye.
    HalfGaussian,
}

/// A kernel's evaluation, by the path of its footprint.
pub(super) enum Evaluate<'a> {
    Affine(Walk<'a>, &'a ExactTerms),
    Exact(Walk<'a>, &'a ExactTerms),
    Near(near::NearWalk<'a>),
}

/// Terms of affine footprints if no depths are needed.
const NO_TERMS: &ExactTerms = &ExactTerms {
    gradient: [0.0; 2],
    hessian: [0.0; 3],
    depth_sigma: 0.0,
    edges: 0,
};

impl<'a> Evaluate<'a> {
    /// Selects the evaluation of a footprint.
    ///
    /// - `terms`: the footprint's own, if it has any.
    /// - `near`: terms of all near kernels.
    #[inline(always)]
    pub(super) fn new(
        place: &TilePlace<'a>,
        footprint: &'a Footprint,
        terms: Option<&'a ExactTerms>,
        near: &'a [NearTerms],
    ) -> Self {
        if let Some(terms) = near_terms_of(footprint, near) {
            return Self::Near(near::NearWalk::new(place, footprint, terms));
        }
        let walk = Walk::new(place, footprint, terms.and_then(|t| edges_of(t, near)));
        match terms {
            Some(terms) if footprint.path == PATH_EXACT => Self::Exact(walk, terms),
            _ => Self::Affine(walk, terms.unwrap_or(NO_TERMS)),
        }
    }

    pub(super) fn footprint(&self) -> &'a Footprint {
        match self {
            Self::Affine(walk, _) | Self::Exact(walk, _) => walk.footprint,
            Self::Near(walk) => walk.footprint,
        }
    }

    /// Returns the rows of the tile that it may reach.
    #[inline(always)]
    pub(super) fn rows(&self) -> Range<usize> {
        let [first, end] = match self {
            Self::Affine(walk, _) | Self::Exact(walk, _) => walk.rows,
            Self::Near(walk) => walk.patch.rows,
        };
        first..end
    }

    /// Evaluates row `y` of the tile.
    ///
    /// - `ray_length`: |D| of its pixels; read only on the exact path.
    #[inline(always)]
    pub(super) fn row<const FMA: bool>(&self, y: usize, ray_length: &RowOf<f32>) -> Row {
        match self {
            Self::Affine(walk, terms) => affine::row::<FMA>(walk, terms, y),
            Self::Exact(walk, terms) => exact::row::<FMA>(walk, terms, y, ray_length),
            Self::Near(walk) => walk.row::<FMA>(y),
        }
    }

    /// Returns the derivatives of the kernel along row `y`; `None` for near kernels. On the exact path
    /// they omit the change of the ray's length, which all kernels share, and the change of `per_sigma`.
    #[inline(always)]
    pub(super) fn slope(&self, y: usize) -> Option<RowSlope> {
        match self {
            Self::Affine(walk, terms) => Some(affine::slope(walk, terms, y)),
            Self::Exact(walk, terms) => Some(exact::slope(walk, terms, y)),
            Self::Near(_) => None,
        }
    }

    /// Returns the distribution of its optical depth along a ray.
    #[inline(always)]
    pub(super) fn along(&self) -> Along {
        match self {
            Self::Near(_) => Along::HalfGaussian,
            Self::Affine(walk, _) if walk.footprint.ceiling().is_some() => Along::Point,
            _ => Along::Gaussian,
        }
    }

    /// Returns its reach along z on either side of its centre.
    pub(super) fn depth_reach(&self) -> f32 {
        match self {
            Self::Affine(walk, terms) | Self::Exact(walk, terms) => {
                depth_reach(walk.footprint, terms)
            }
            Self::Near(walk) => walk.depth_reach(),
        }
    }
}

/// Returns the terms of a footprint on the near or the half-line path.
pub(super) fn near_terms_of<'a>(
    footprint: &Footprint,
    near: &'a [NearTerms],
) -> Option<&'a NearTerms> {
    match footprint.path & 3 {
        PATH_NEAR | PATH_HALF_LINE => near.get((footprint.path >> 2) as usize),
        _ => None,
    }
}

/// Returns the planes at which the boundary of its domain cuts a footprint's kernel, if it does.
#[inline]
pub(super) fn edges_of<'a>(terms: &ExactTerms, near: &'a [NearTerms]) -> Option<&'a NearTerms> {
    near.get((terms.edges as usize).checked_sub(1)?)
}

/// Returns the reach of a kernel along z on either side of its centre: r sqrt(V_zz). V_zz is the variance
/// at the centre of the footprint plus the part that its slope adds.
pub(super) fn depth_reach(footprint: &Footprint, terms: &ExactTerms) -> f32 {
    let slope = if footprint.path == PATH_EXACT {
        // z* = z (1 + g . d / 2) / w.
        Vec2::from(terms.gradient) * (-0.5 * footprint.depth)
    } else {
        Vec2::from(terms.gradient)
    };
    // slopeᵀ S slope = |A⁻ᵀ slope|², A the rows p and r of the form.
    let ([px, py], [rx, ry]) = (footprint.form_p, footprint.form_r);
    let determinant = px * ry - py * rx;
    let solved = Vec2::new(ry * slope.x - rx * slope.y, px * slope.y - py * slope.x) / determinant;
    let squared = solved.length_squared() + terms.depth_sigma * terms.depth_sigma;
    let reach = (footprint.cutoff_squared * squared).sqrt();
    // NaN reaches everywhere.
    if reach.is_finite() {
        reach
    } else {
        f32::INFINITY
    }
}
