//! What footprints have besides: the terms that only some ways to evaluate them read.

use bytemuck::{Pod, Zeroable};

use crate::constants::MOST_EDGES;

/// The terms that the footprints of a pass have besides, each at its footprint's own index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FootprintTerms<'a> {
    /// None: all are affine, or have [`NearTerms`].
    None,
    /// Of kernels.
    Exact(&'a [ExactTerms]),
    /// Of surfels of opaque surfaces.
    Surfel(&'a [SurfelTerms]),
}

impl<'a> FootprintTerms<'a> {
    /// Those of kernels; empty where there are none.
    pub fn exact(self) -> &'a [ExactTerms] {
        match self {
            Self::Exact(terms) => terms,
            _ => &[],
        }
    }

    /// Those of surfels; empty where there are none.
    pub fn surfel(self) -> &'a [SurfelTerms] {
        match self {
            Self::Surfel(terms) => terms,
            _ => &[],
        }
    }
}

/// The five floats that make an affine footprint exact under perspective:
/// w(d) = 1 + g . d + hxx dx² + hxy dx dy + hyy dy². Where opaque surfaces may cut kernels, every
/// footprint has such terms; of the affine ones they say the depth alone.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ExactTerms {
    /// Gradient of w at the centre, 1/px. Of an affine footprint: change of its depth z* per pixel.
    pub gradient: [f32; 2],
    /// hxx, hxy, hyy \[1/px²\].
    pub hessian: [f32; 3],
    /// The standard deviation of z along the ray through the centre, world units: what a surface
    /// that cuts the kernel needs; 0 where no surface may.
    pub depth_sigma: f32,
    /// Where the domain of its data cuts a kernel: one more than the place of its [`NearTerms`],
    /// of which only the edges count; 0 where nothing does. Read where a pass has boundaries.
    pub edges: u32,
}

/// The plane of a surfel on the image. A device keeps it where it keeps [`ExactTerms`] of kernels: as
/// many words.
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
    /// How far the inverse depth of one surface's surfels may differ.
    pub slack: f32,
    /// 1 where the footprint follows the plane's homography, Q over the square of the inverse depth
    /// relative to the centre's; 0 where it is affine.
    pub homography: f32,
    /// The unit normal, camera space, towards the eye: a whole number, as
    /// [`pack_normal`](crate::math::pack_normal) makes it.
    pub normal: f32,
    /// Fills up to the words of [`ExactTerms`].
    pub unused: u32,
}

/// A kernel seen from within or beside it, by the direct line integral along D = (X, Y, 1), in
/// units of a length of the kernel's own. With five columns f of its factor (the last two the
/// low-pass filter's): Q = sum (D . (f x u))² / S, S = DᵀKD = sum (D . (f_i x f_j))²,
/// z* = sum (D . (f_i x f_j)) (u . (f_i x f_j)) / S, sigma_z = sigma / sqrt(S).
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
    /// The length that the terms above are in units of, world units.
    pub unit: f32,
    /// How far the kernel reaches along z within its cut-off, world units.
    pub reach: f32,
    /// Half-line path: dz/dx, dz/dy \[1/px\] and z at the centre.
    pub half_line: [f32; 3],
    /// The planes at which the domain of its data cuts the kernel, as its path reads them
    /// (`splat/edges.rs`).
    pub edges: [[f32; 4]; MOST_EDGES],
    /// How many of them there are, and whether rays meet them ([`RAY_EDGES`]).
    pub edge_count: u32,
}

/// In [`NearTerms::edge_count`]: an exact footprint is cut where rays meet its planes, not as an affine one.
pub const RAY_EDGES: u32 = 1 << 8;

/// What a classified particle has besides where the transfer function was asked over its kernel's extent:
/// how the kernel of a lobe lies in the particle's own.
///
/// With F the particle's factor in camera space, of V = F Fᵀ, and a the axis: centre + shift F a, and the factor
/// F (I + (width - 1) a aᵀ) (section 9.1 of the mathematics: no difference of variances is formed).
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PieceTerms {
    /// Direction of Lᵀ g, of unit length, in the frame of the factor L that the particle is stored with; 0 of a
    /// kernel that stays as it is.
    pub axis: [f32; 3],
    /// Standard deviations along F a.
    pub shift: f32,
    /// Standard deviation along it, of the particle's.
    pub width: f32,
    /// Padding to the words of a classified particle, which it follows on a device.
    pub unused: u32,
}

impl PieceTerms {
    /// Of a kernel that stays as it is.
    pub const WHOLE: Self = Self {
        axis: [0.0; 3],
        shift: 0.0,
        width: 1.0,
        unused: 0,
    };
}
