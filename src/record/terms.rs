//! Defines the terms that only some evaluation paths of footprints read.

use bytemuck::{Pod, Zeroable};

use crate::constants::MOST_EDGES;

/// The additional terms of a pass's footprints, each at its footprint's own index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FootprintTerms<'a> {
    /// No terms: all footprints are affine, or have [`NearTerms`].
    None,
    /// Terms of kernels.
    Exact(&'a [ExactTerms]),
    /// Terms of surfels of opaque surfaces.
    Surfel(&'a [SurfelTerms]),
}

impl<'a> FootprintTerms<'a> {
    /// Returns the terms of kernels; empty if there are none.
    pub fn exact(self) -> &'a [ExactTerms] {
        match self {
            Self::Exact(terms) => terms,
            _ => &[],
        }
    }

    /// Returns the terms of surfels; empty if there are none.
    pub fn surfel(self) -> &'a [SurfelTerms] {
        match self {
            Self::Surfel(terms) => terms,
            _ => &[],
        }
    }
}

/// The five floats that make an affine footprint exact under perspective: w(d) = 1 + g . d + hxx dx² +
/// hxy dx dy + hyy dy². If opaque surfaces may cut kernels, every footprint has such terms; those of
/// affine footprints describe the depth alone.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ExactTerms {
    /// Gradient of w at the centre, 1/px. For an affine footprint: change of its depth z* per pixel.
    pub gradient: [f32; 2],
    /// hxx, hxy, hyy \[1/px²\].
    pub hessian: [f32; 3],
    /// Standard deviation of z along the ray through the centre, world units. A surface that cuts the
    /// kernel needs it; 0 if no surface may cut it.
    pub depth_sigma: f32,
    /// If the boundary of its domain cuts the kernel: one more than the index of its [`NearTerms`], of
    /// which only the edges are read. 0 otherwise. Read in passes with boundaries.
    pub edges: u32,
}

/// The plane of a surfel on the image. A device stores it in the place of a kernel's [`ExactTerms`]; both
/// have the same number of words.
///
/// At offset d from the centre its inverse depth (1/z under perspective, -z under an orthographic
/// camera) is `inverse_depth + gradient . d`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SurfelTerms {
    /// Change of the inverse depth per pixel.
    pub gradient: [f32; 2],
    /// The inverse depth of the centre.
    pub inverse_depth: f32,
    /// Greatest difference of inverse depth between surfels that count as one surface.
    pub slack: f32,
    /// 1 if the footprint follows the homography of its plane: Q is divided by the square of the inverse
    /// depth relative to the centre's. 0 if it is affine.
    pub homography: f32,
    /// Unit normal, camera space, towards the eye, encoded as a whole number by
    /// [`pack_normal`](crate::math::pack_normal).
    pub normal: f32,
    /// Padding to the words of [`ExactTerms`].
    pub unused: u32,
}

/// Terms of a kernel that the eye lies within or beside. The line integral is taken directly along D =
/// (X, Y, 1), in units of a length of the kernel's own. With five columns f of its factor (the last two
/// the low-pass filter's): Q = sum (D . (f x u))² / S, S = DᵀKD = sum (D . (f_i x f_j))², z* = sum (D .
/// (f_i x f_j)) (u . (f_i x f_j)) / S, sigma_z = sigma / sqrt(S).
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct NearTerms {
    /// f x u for each column.
    pub misses: [[f32; 3]; 5],
    /// f_i x f_j for each pair of columns.
    pub minors: [[f32; 3]; 10],
    /// u . (f_i x f_j).
    pub minor_depths: [f32; 10],
    /// sqrt(det V). On the half-line path: the standard deviation of z along the ray.
    pub sigma: f32,
    /// The length unit of the terms above, world units.
    pub unit: f32,
    /// Reach of the kernel along z within its cut-off, world units.
    pub reach: f32,
    /// Half-line path: dz/dx, dz/dy \[1/px\] and z at the centre.
    pub half_line: [f32; 3],
    /// Planes at which the boundary of its domain cuts the kernel, in the form that its path reads
    /// (`splat/edges.rs`).
    pub edges: [[f32; 4]; MOST_EDGES],
    /// Number of these planes, plus the flag [`RAY_EDGES`] if rays meet them.
    pub edge_count: u32,
}

/// Flag in [`NearTerms::edge_count`]: the cut follows where each ray meets the planes (exact footprints),
/// not an affine form.
pub const RAY_EDGES: u32 = 1 << 8;

/// Terms of a classified particle whose kernel was classified over its extent. They give the position and
/// width of the piece (lobe) within the particle's kernel.
///
/// With the particle's factor F in camera space, V = F Fᵀ, and the axis a: the centre moves by shift F a,
/// and the factor becomes F (I + (width - 1) a aᵀ) (section 9.1 of the mathematics: no difference of
/// variances is formed).
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PieceTerms {
    /// Unit vector along Lᵀ g, in the frame of the factor L that the particle is stored with; 0 for a
    /// kernel that stays whole.
    pub axis: [f32; 3],
    /// Shift along F a, in standard deviations.
    pub shift: f32,
    /// Standard deviation along the axis, relative to the particle's.
    pub width: f32,
    /// Padding to the words of a classified particle, which these terms follow on a device.
    pub unused: u32,
}

impl PieceTerms {
    /// Terms of a kernel that stays whole.
    pub const WHOLE: Self = Self {
        axis: [0.0; 3],
        shift: 0.0,
        width: 1.0,
        unused: 0,
    };
}
