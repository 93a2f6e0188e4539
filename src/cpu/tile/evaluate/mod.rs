//! Axis *evaluate*: the optical depth of a kernel along the rays of a row of pixels, and where along them
//! it lies. A footprint's path says which file does it; what follows, *interval* and *accumulate*, takes
//! rows and does not ask.

pub(super) mod affine;
pub(super) mod exact;
pub(super) mod near;
pub(super) mod surfel;

use std::ops::Range;

use glam::Vec2;

use super::pixels::{RowOf, TilePlace};
use crate::constants::TILE_SIZE;
use crate::record::{
    ExactTerms, Footprint, NearTerms, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR, PATH_PEAK,
};

/// A kernel at the pixels of a row.
pub(super) struct Row {
    /// Which row of the tile.
    pub(super) y: usize,
    /// Optical depths; 0 outside.
    pub(super) tau: RowOf<f32>,
    /// The footprint's depth; the eye's, zero, of near kernels.
    pub(super) depth: f32,
    /// How far the kernel's mean z along each ray lies beyond that.
    pub(super) beyond: RowOf<f32>,
    /// One over the standard deviation of z.
    pub(super) per_sigma: RowOf<f32>,
    /// 1 within the cut-off.
    pub(super) inside: RowOf<u32>,
    /// How many are within it.
    pub(super) count: u32,
    /// Where the domain of its data cuts the kernel: the shares of its optical depth along each ray at
    /// which it begins and ends.
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

    /// How far a depth lies beyond the kernel's mean, in standard deviations. From the footprint's depth
    /// first: sums of depths would round away what needles are cut at, 1:10,000 ones by a hundredth of
    /// their width.
    #[inline(always)]
    pub(super) fn ahead(&self, lane: usize, depth: f32) -> f32 {
        ((depth - self.depth) - self.beyond[lane]) * self.per_sigma[lane]
    }

    /// The tile's pixel that it begins with.
    #[inline(always)]
    pub(super) fn first(&self) -> usize {
        self.y * TILE_SIZE
    }
}

/// How a kernel changes from pixel to pixel of a row: along the columns and the rows of the image.
pub(super) struct RowSlope {
    /// The logarithm of its optical depth.
    pub(super) log_tau: [RowOf<f32>; 2],
    /// Its mean z.
    pub(super) mean: [RowOf<f32>; 2],
}

/// A footprint on its way through the rows of a tile.
pub(super) struct Walk<'a> {
    pub(super) footprint: &'a Footprint,
    /// From its centre to the tile's first pixel.
    first: [f32; 2],
    /// Of each column; negative beside the patch, where nothing is within the cut-off.
    limits: RowOf<f32>,
    rows: [usize; 2],
    /// Where the domain of its data cuts the kernel.
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

    /// Offset of row `y` from the centre.
    #[inline(always)]
    pub(super) fn dy(&self, y: usize) -> f32 {
        self.first[1] + y as f32
    }

    /// Offset of a column from the centre.
    #[inline(always)]
    pub(super) fn dx(&self, lane: usize) -> f32 {
        self.first[0] + lane as f32
    }
}

/// How a kernel's optical depth is spread along a ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Along {
    /// As a Gaussian.
    Gaussian,
    /// All at the centre's depth: a splat that states its opacity is not divided.
    Point,
    /// As what lies of a Gaussian in front of the eye.
    HalfGaussian,
}

/// A kernel's evaluation, by the path of its footprint.
pub(super) enum Evaluate<'a> {
    Affine(Walk<'a>, &'a ExactTerms),
    Exact(Walk<'a>, &'a ExactTerms),
    Near(near::NearWalk<'a>),
}

/// What affine footprints have where no depths are asked for.
const NO_TERMS: &ExactTerms = &ExactTerms {
    gradient: [0.0; 2],
    hessian: [0.0; 3],
    depth_sigma: 0.0,
    edges: 0,
};

impl<'a> Evaluate<'a> {
    /// - `terms`: the footprint's own, where it has any.
    /// - `near`: those of all near kernels.
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

    /// Rows of the tile that it may reach.
    #[inline(always)]
    pub(super) fn rows(&self) -> Range<usize> {
        let [first, end] = match self {
            Self::Affine(walk, _) | Self::Exact(walk, _) => walk.rows,
            Self::Near(walk) => walk.patch.rows,
        };
        first..end
    }

    /// Row `y` of the tile.
    ///
    /// - `ray_length`: of its pixels; read on the exact path alone.
    #[inline(always)]
    pub(super) fn row<const FMA: bool>(&self, y: usize, ray_length: &RowOf<f32>) -> Row {
        match self {
            Self::Affine(walk, terms) => affine::row::<FMA>(walk, terms, y),
            Self::Exact(walk, terms) => exact::row::<FMA>(walk, terms, y, ray_length),
            Self::Near(walk) => walk.row::<FMA>(y),
        }
    }

    /// How the kernel changes along row `y`; of the exact path without what all kernels have in common,
    /// the length of the ray, and without the change of `per_sigma`. `None` of near kernels.
    #[inline(always)]
    pub(super) fn slope(&self, y: usize) -> Option<RowSlope> {
        match self {
            Self::Affine(walk, terms) => Some(affine::slope(walk, terms, y)),
            Self::Exact(walk, terms) => Some(exact::slope(walk, terms, y)),
            Self::Near(_) => None,
        }
    }

    /// How it is spread along a ray.
    #[inline(always)]
    pub(super) fn along(&self) -> Along {
        match self {
            Self::Near(_) => Along::HalfGaussian,
            Self::Affine(walk, _) if walk.footprint.path == PATH_PEAK => Along::Point,
            _ => Along::Gaussian,
        }
    }

    /// How far it reaches along z on either side of its centre.
    pub(super) fn depth_reach(&self) -> f32 {
        match self {
            Self::Affine(walk, terms) | Self::Exact(walk, terms) => {
                depth_reach(walk.footprint, terms)
            }
            Self::Near(walk) => walk.depth_reach(),
        }
    }
}

/// The terms of a footprint on the near or the half-line path.
pub(super) fn near_terms_of<'a>(
    footprint: &Footprint,
    near: &'a [NearTerms],
) -> Option<&'a NearTerms> {
    match footprint.path & 3 {
        PATH_NEAR | PATH_HALF_LINE => near.get((footprint.path >> 2) as usize),
        _ => None,
    }
}

/// Where the domain of its data cuts a footprint's kernel, if it does.
#[inline]
pub(super) fn edges_of<'a>(terms: &ExactTerms, near: &'a [NearTerms]) -> Option<&'a NearTerms> {
    near.get((terms.edges as usize).checked_sub(1)?)
}

/// How far a kernel reaches along z on either side of its centre: r sqrt(V_zz), V_zz the variance at
/// the centre of the footprint and what its slope adds.
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
