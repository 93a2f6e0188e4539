//! Defines a kernel's footprint on the image.

use bytemuck::{Pod, Zeroable};

use crate::constants::{SPLAT_CEILING, TILE_SIZE};

/// Three words that a particle and its footprint carry to the pixels: a colour, a value or a sign. The
/// pass defines their meaning ([`Classify`](crate::splat::Classify),
/// [`Accumulate`](crate::splat::Accumulate)).
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(transparent)]
pub struct Carried([f32; 3]);

impl Carried {
    /// Carries linear RGB.
    #[inline]
    pub const fn of_colour(colour: [f32; 3]) -> Self {
        Self(colour)
    }

    /// Carries the sign of an amplitude, for sums of columns. The amplitude's magnitude is the mass.
    #[inline]
    pub const fn of_sign(sign: f32) -> Self {
        Self([sign, 0.0, 0.0])
    }

    /// Returns linear RGB, in passes that classify particles.
    #[inline]
    pub const fn colour(self) -> [f32; 3] {
        self.0
    }

    /// Returns the particle's value as a fraction of the transfer function's range, in passes that
    /// classify slabs.
    #[inline]
    pub const fn value(self) -> f32 {
        self.0[0]
    }

    /// Returns the sign of the particle's amplitude, in passes that sum columns.
    #[inline]
    pub const fn sign(self) -> f32 {
        self.0[0]
    }
}

/// The footprint of a kernel or a surfel on the image: sixteen words.
///
/// The optical depth of an affine footprint at offset d = (dx, dy) px from the centre is tau exp(-Q/2)
/// with Q = (p . d)² + (r . d)², cut off at Q > `cutoff_squared`.
///
/// A footprint has the size and alignment of a cache line, so that one fetch loads it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Footprint {
    /// x_k, pixels.
    pub centre_px: [f32; 2],
    /// First row p of the triangular form of the inverse variance, 1/px. One of its two numbers
    /// is zero. Near kernels have none.
    pub form_p: [f32; 2],
    /// Second row r.
    pub form_r: [f32; 2],
    /// Optical depth at the centre. On the exact path: divided by |D0|. For near kernels:
    /// g/(2 pi), in the units of its terms. For splats: the opacity at the centre. For surfels
    /// [`Self::weight`] reads it.
    pub tau: f32,
    /// Square of the cut-off radius.
    pub cutoff_squared: f32,
    /// A colour, a value or a sign.
    pub carried: Carried,
    /// Camera-space z of the centre. For surfels [`Self::greatest_inverse_depth`] reads it.
    pub depth: f32,
    /// Evaluation path: one of the `PATH_` constants, in the low two bits. The bits above hold the index
    /// of the footprint's [`NearTerms`](super::NearTerms), or the flags that turn [`PATH_AFFINE`] into
    /// [`PATH_PEAK`] or [`PATH_CAPPED`]. Other terms lie at the footprint's own index.
    pub path: u32,
    /// First and one-past-last pixel column, low and high half word.
    pub columns: u32,
    /// First and one-past-last pixel row, low and high half word. An empty range marks a kernel
    /// that reaches no pixel.
    pub rows: u32,
    /// Depth key: smaller is nearer.
    pub key: u32,
}

/// Affine footprint: EWA and everything cheaper.
pub const PATH_AFFINE: u32 = 0;
/// Affine footprint whose `tau` is an opacity: min(tau exp(-Q/2), 1), whatever the mode of the frame.
pub const PATH_PEAK: u32 = PATH_AFFINE | 4;
/// The same with a ceiling: min(tau exp(-Q/2), [`SPLAT_CEILING`]).
pub const PATH_CAPPED: u32 = PATH_PEAK | 16;
/// Surfel of an opaque surface: [`SurfelTerms`](super::SurfelTerms).
pub const PATH_SURFEL: u32 = PATH_AFFINE | 8;
/// Surfel that reaches the camera plane: [`NearTerms`](super::NearTerms), whose index lies above the low
/// four bits.
pub const PATH_NEAR_SURFEL: u32 = PATH_NEAR | 8;
/// Exact perspective: [`ExactTerms`](super::ExactTerms).
pub const PATH_EXACT: u32 = 1;
/// Perspective kernel that crosses the camera plane: [`NearTerms`](super::NearTerms).
pub const PATH_NEAR: u32 = 2;
/// Orthographic kernel that crosses the camera plane: affine times a half-line factor
/// from `half_line` and `sigma` of its [`NearTerms`](super::NearTerms).
pub const PATH_HALF_LINE: u32 = 3;

impl Footprint {
    /// Returns the weight at the centre of a surfel of an opaque surface.
    #[inline]
    pub fn weight(&self) -> f32 {
        self.tau
    }

    /// Returns the greatest inverse depth that a surfel of an opaque surface has within its cut-off, plus
    /// its slack. Under parallel rays: the greatest negative depth.
    #[inline]
    pub fn greatest_inverse_depth(&self) -> f32 {
        self.depth
    }

    /// Returns the first and one-past-last pixel column.
    #[inline]
    pub fn column_range(&self) -> (u32, u32) {
        (self.columns & 0xffff, self.columns >> 16)
    }

    /// Returns the first and one-past-last pixel row.
    #[inline]
    pub fn row_range(&self) -> (u32, u32) {
        (self.rows & 0xffff, self.rows >> 16)
    }

    /// Returns the number of tiles that the box of a visible footprint touches.
    #[inline(always)]
    pub(crate) fn tile_count(&self) -> u64 {
        let size = TILE_SIZE as u64;
        let tile = |px: u32| u64::from(px) / size;
        let touched = |(first, end): (u32, u32)| tile(end - 1) - tile(first) + 1;
        touched(self.column_range()) * touched(self.row_range())
    }

    /// Returns the index of its [`NearTerms`](super::NearTerms), if its path reads them.
    ///
    /// - `is_surfel`: whether the footprint is a surfel of an opaque surface.
    #[inline]
    pub(crate) fn near_place(&self, is_surfel: bool) -> Option<u32> {
        if is_surfel {
            return (self.path & 15 == PATH_NEAR_SURFEL).then_some(self.path >> 4);
        }
        matches!(self.path & 3, PATH_NEAR | PATH_HALF_LINE).then_some(self.path >> 2)
    }

    /// Returns the same footprint with another index of its near terms.
    #[inline]
    pub(crate) fn with_near_place(self, place: u32, is_surfel: bool) -> Self {
        let path = if is_surfel {
            place << 4 | PATH_NEAR_SURFEL
        } else {
            place << 2 | self.path & 3
        };
        Self { path, ..self }
    }

    /// Returns the greatest opacity on the image, if `tau` is an opacity.
    #[inline(always)]
    pub(crate) fn ceiling(&self) -> Option<f32> {
        match self.path {
            PATH_PEAK => Some(1.0),
            PATH_CAPPED => Some(SPLAT_CEILING),
            _ => None,
        }
    }

    /// Returns whether it reaches any pixel.
    #[inline]
    pub fn is_visible(&self) -> bool {
        self.rows != 0
    }
}

/// Packs a half-open pixel range into a word.
#[inline]
pub fn pack_range(first: u32, end: u32) -> u32 {
    first | end << 16
}
