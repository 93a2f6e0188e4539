//! The structs that the stages of a frame exchange: plain words, so that any back end can fill
//! and read them.
//!
//! | struct | written by | read by |
//! |---|---|---|
//! | [`ViewUniform`] | the frame's set-up | project, rasterise |
//! | [`CameraUniform`] | the frame's set-up (GPU) | cull, shade, project |
//! | [`LightingUniform`] | the frame's set-up | light |
//! | [`DeviceBlock`] | the upload (GPU) | cull, classify, project |
//! | [`LatticeUniform`] | the upload (GPU) | classify, shade, project |
//! | [`BrickUniform`] | the upload (GPU) | classify |
//! | [`FrameState`] | cull, classify (GPU) | cull, the frame |
//! | [`PartState`] | cull, classify (GPU) | classify, shade, project, the frame |
//! | [`ChoiceUniform`] | the frame's set-up | cull |
//! | [`MergedBlock`] | cull (GPU) | cull |
//! | [`BlockView`] | cull (places, filters), classify (counts) | classify, project |
//! | [`ClassifiedParticle`] | classify | project |
//! | [`Footprint`] | project | sort, bin, rasterise |
//! | [`ExactTerms`] | project, for exact footprints | bin, rasterise |
//! | [`SurfelTerms`] | project, for surfels of opaque surfaces | rasterise |
//! | [`NearTerms`] | project, for kernels that cross the camera plane | bin, rasterise |
//! | [`PartIndex`] | the upload (GPU) | sort, gather |
//! | [`PartRange`] | sort (GPU) | sort, gather |
//! | [`SortState`] | sort (GPU) | gather |
//! | [`ChunkUniform`] | the frame's set-up (GPU) | gather, bin |
//! | [`ChunkState`] | gather, bin (GPU) | gather, bin |

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::constants::MAX_LIGHTS;
use crate::scene::{LightFrame, Lighting};
use crate::view::{Camera, Projection};

use crate::constants::{MAX_CLIP_PLANES, MAX_PLANES};

/// What a frame's stages need of the camera and the settings, in f32.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ViewUniform {
    /// (fx, fy), pixels per unit of slope or per world unit.
    pub focal_px: [f32; 2],
    /// (cx, cy), pixels.
    pub centre_px: [f32; 2],
    /// Image size, pixels.
    pub size: [u32; 2],
    /// 1 for an orthographic camera, 0 for a perspective one.
    pub orthographic: u32,
    /// The filter, as [`crate::splat::Filter`] numbers them.
    pub filter_kind: u32,
    /// Variance of the low-pass filter, px².
    pub low_pass_variance_px2: f32,
    /// The tolerance that `adaptive` and the cut-off follow.
    pub tolerance: f32,
    /// A cut-off radius given by hand, standard deviations; 0 follows the tolerance.
    pub cutoff: f32,
    /// Depth keys per unit of distance.
    pub key_scale: f32,
    /// 1 where colours show what draws each kernel.
    pub show_choice: u32,
    /// 1 where depth keys measure along `key_axis`; 0 where they measure the distance from the eye (of
    /// an orthographic camera z).
    pub directional_keys: u32,
    /// Where the first layer begins, along `key_axis` from the eye; world units.
    pub layer_near: f32,
    /// Thickness of a layer, world units.
    pub layer_thickness: f32,
    /// A unit vector in camera space.
    pub key_axis: [f32; 3],
    /// A footprint belongs to (of slabs: begins in) the layer `key >> layer_shift`.
    pub layer_shift: u32,
    /// How footprints become a picture, as [`crate::splat::Composite`] numbers it.
    pub composite: u32,
    /// How many of the clip planes there are.
    pub clip_count: u32,
    /// 1 where kernels smaller than a pixel have the opacity of lone ones.
    pub sub_pixel_opacity: u32,
    /// Fills up four words.
    pub unused: u32,
    /// Planes n . u + d >= 0, camera space: n, d.
    pub clip_planes: [[f32; 4]; MAX_CLIP_PLANES],
}

/// What the stages on the device need of a camera besides a [`ViewUniform`]. Numbers of f64 go as
/// their bits, low word first: the device subtracts the eye in integers (`shared/f64.wgsl`).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CameraUniform {
    /// The eye, world units, f64.
    pub eye: [[u32; 2]; 3],
    /// Rows of the rotation into camera space, f64.
    pub camera_from_world: [[[u32; 2]; 3]; 3],
    /// Inward normals of the frustum's planes and of those that clip, camera space, f64.
    pub plane_normals: [[[u32; 2]; 3]; MAX_PLANES],
    /// Their distances, f64: inside where n . u + d >= 0.
    pub plane_distances: [[u32; 2]; MAX_PLANES],
    /// Magnitudes of the normals' components in the world, f64.
    pub plane_spreads: [[[u32; 2]; 3]; MAX_PLANES],
    /// Where depth keys are measured along a direction: that direction, camera space, f64.
    pub key_axis: [[u32; 2]; 3],
    /// And where they begin, world units, f64.
    pub key_near: [u32; 2],
    /// And how many there are per unit, f64.
    pub keys_per_unit: [u32; 2],
    /// Columns of the rotation into camera space.
    pub rotation: [[f32; 3]; 3],
    /// 1 where the frustum rejects blocks.
    pub has_frustum: u32,
    /// 1 for an orthographic camera, 0 for a perspective one.
    pub orthographic: u32,
    /// 1 where depth keys are measured along a direction, over a range given.
    pub directional_keys: u32,
    /// How many planes there are.
    pub plane_count: u32,
    /// Fills up a pair of words.
    pub unused: u32,
    /// What blocks are drawn by.
    pub choice: ChoiceUniform,
}

/// A light as a frame sees it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightUniform {
    /// Towards the light, camera space, unit length; 0.
    pub direction: [f32; 4],
    /// Linear RGB; 0.
    pub colour: [f32; 4],
}

/// What lighting needs: [`Lighting`] in camera space.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightingUniform {
    /// Lights; zeros from `count` on.
    pub lights: [LightUniform; MAX_LIGHTS],
    /// How many there are.
    pub count: u32,
    /// 1 for an orthographic camera, 0 for a perspective one.
    pub orthographic: u32,
    /// As in [`Lighting`].
    pub ambient: f32,
    /// As in [`Lighting`].
    pub diffuse: f32,
    /// As in [`Lighting`].
    pub specular: f32,
    /// As in [`Lighting`].
    pub shininess: f32,
    /// Fills up four words.
    pub unused: [u32; 2],
}

impl LightingUniform {
    /// `lighting` as `camera` sees it; lights beyond [`MAX_LIGHTS`] are left out
    /// ([`Lighting::validate`] refuses them).
    pub fn new(lighting: &Lighting, camera: &Camera) -> Self {
        let mut uniform = Self {
            orthographic: u32::from(camera.projection == Projection::Orthographic),
            ambient: lighting.ambient,
            diffuse: lighting.diffuse,
            specular: lighting.specular,
            shininess: lighting.shininess,
            ..Self::default()
        };
        for (slot, light) in uniform.lights.iter_mut().zip(&lighting.lights) {
            let direction = match light.frame {
                LightFrame::World => camera.camera_from_world * light.direction,
                LightFrame::Camera => light.direction,
            };
            let [red, green, blue] = light.colour;
            *slot = LightUniform {
                direction: direction
                    .try_normalize()
                    .unwrap_or(DVec3::ZERO)
                    .as_vec3()
                    .extend(0.0)
                    .into(),
                colour: [red, green, blue, 0.0],
            };
            uniform.count += 1;
        }
        uniform
    }
}

/// What the choice of a block's filter and of merged particles follows.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ChoiceUniform {
    /// The least and the greatest focal length, pixels per unit of slope or per world unit.
    pub focal_px: [f32; 2],
    /// c_min and c_max of eq. 7 of Chen et al. 2004, the latter with its factor of the field of
    /// view; where `by_hand` says so.
    pub thresholds: [f32; 2],
    /// 1 where the thresholds rule, 0 where the tolerance does.
    pub by_hand: u32,
    /// 1 for an orthographic camera, 0 for a perspective one.
    pub orthographic: u32,
    /// The filter asked for, as [`crate::splat::Filter`] numbers them.
    pub filter_kind: u32,
    /// Variance of the low-pass filter, px².
    pub low_pass_variance_px2: f32,
    /// The tolerance.
    pub tolerance: f32,
    /// 1 where merged particles may stand for their members.
    pub level_of_detail: u32,
}

/// A block of particles as the device keeps it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DeviceBlock {
    /// World position that the particles' offsets are relative to, f64 as its bits.
    pub origin: [[u32; 2]; 3],
    /// Half the extent of the particles' centres.
    pub half_extent: [f32; 3],
    /// No kernel's standard deviation exceeds this in any direction.
    pub max_sigma: f32,
    /// None falls below this.
    pub min_sigma: f32,
    /// The greatest mass, cell volume or opacity of a particle.
    pub max_strength: f32,
    /// Least and greatest finite value; reversed where there is none.
    pub value_range: [f32; 2],
    /// Index of its first particle in the arrays of its part.
    pub first: u32,
    /// Number of particles; for a brick of a lattice, of its cells within the lattice.
    pub count: u32,
    /// The block of merged particles that stands for this one among others, counted over the merged
    /// blocks of the scene; [`NO_PARENT`](crate::blocks::NO_PARENT) for none.
    pub parent: u32,
    /// 0 for the data's own particles, above for merged ones.
    pub level: u32,
}

/// A block of merged particles in a frame on the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct MergedBlock {
    /// The merged block that stands for this one among others, as [`DeviceBlock::parent`].
    pub parent: u32,
    /// Whether it decides about its members by itself: one of the `MERGED_` constants.
    pub state: u32,
}

/// Its members are asked.
pub const MERGED_OPEN: u32 = 0;
/// Nothing is seen of it or of its members.
pub const MERGED_UNSEEN: u32 = 1;
/// Its particles may be drawn instead of their members.
pub const MERGED_FITS: u32 = 2;

/// A lattice as the device keeps it: particles are cells, in bricks of
/// [`BRICK`](crate::constants::BRICK).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LatticeUniform {
    /// Cells along each axis.
    pub dims: [u32; 3],
    /// Bricks along each axis.
    pub bricks: [u32; 3],
    /// Which of the lattice's bricks is the first of its part.
    pub first_brick: u32,
    /// 1 where cells follow from the samples of the axes, 0 where all are alike.
    pub has_axes: u32,
    /// Columns: the units of the axes in the world; of a uniform lattice the step from one cell to
    /// the next along each index.
    pub basis: [[f32; 3]; 3],
    /// Columns of the factor that all kernels share, world units.
    pub factor: [[f32; 3]; 3],
}

/// Which bricks of a lattice a part holds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BrickUniform {
    /// Samples of the lattice along x, y and z; zeros where the part's volume is none.
    pub dims: [u32; 3],
    /// The brick that is the part's first block.
    pub first: u32,
}

/// What the stages of a frame on the device know of all parts together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct FrameState {
    /// The least distance of a block in view, as a word that is the greater the nearer; 0 for
    /// none.
    pub nearest: [u32; 2],
    /// The greatest distance, as a word in the order of distances; 0 for none.
    pub farthest: [u32; 2],
    /// Where depth keys begin: world units, f64.
    pub near: [u32; 2],
    /// Depth keys per unit of distance, f64.
    pub keys_per_unit: [u32; 2],
    /// Particles classified; `u32::MAX` stands for more.
    pub classified_count: u32,
    /// Blocks in view, by their filter.
    pub filters: [u32; 7],
}

/// What the stages of a frame on the device know of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PartState {
    /// Room for classified particles: what the host has allocated.
    pub capacity: u32,
    /// Blocks in view.
    pub view_count: u32,
    /// One more than that: the counts whose prefix sums are taken.
    pub count_length: u32,
    /// Particles that the transfer function leaves visible; `u32::MAX` stands for more.
    pub needed: u32,
    /// How many of them were classified: all, or none where they have no room.
    pub classified_count: u32,
    /// How many of the parts before were classified.
    pub first: u32,
}

/// A visible block of particles as one frame sees it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BlockView {
    /// The block's origin in camera space, subtracted in f64.
    pub origin_camera: [f32; 3],
    /// Which block of its volume.
    pub block: u32,
    /// Where its classified particles begin.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// Depth key of the block's origin.
    pub key: u32,
    /// What draws its particles, as [`crate::splat::Filter`] numbers them: `Adaptive` where each
    /// is asked for itself.
    pub filter_kind: u32,
    /// Its level of detail: 0 for the data's own particles.
    pub level: u32,
}

/// A particle that the transfer function leaves visible.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ClassifiedParticle {
    /// Which [`BlockView`] of its volume.
    pub view: u32,
    /// Which particle of the block.
    pub local: u32,
    /// g = extinction x volume \[length²\]; for splats: the peak opacity.
    pub mass: f32,
    /// Linear RGB.
    pub colour: [f32; 3],
}

/// A kernel's footprint on the image: sixteen words.
///
/// Optical depth at offset d = (dx, dy) px from the centre, for an affine footprint:
/// tau exp(-Q/2) with Q = (p . d)² + (r . d)², cut off at Q > `cutoff_squared`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Footprint {
    /// x_k, pixels.
    pub centre_px: [f32; 2],
    /// First row p of the triangular form of the inverse variance, 1/px. One of its two numbers
    /// is zero. On the near path instead: how far the kernel reaches along z, world units, and zero.
    pub form_p: [f32; 2],
    /// Second row r.
    pub form_r: [f32; 2],
    /// Optical depth at the centre. On the exact path: divided by |D0|. For near kernels:
    /// g/(2 pi), in the units of its terms. For splats: the opacity at the centre.
    pub tau: f32,
    /// Square of the cut-off radius.
    pub cutoff_squared: f32,
    /// Linear RGB.
    pub colour: [f32; 3],
    /// Camera-space z of the centre.
    pub depth: f32,
    /// What evaluates it: one of the `PATH_` constants, in the low two bits; above them, the
    /// index of its [`NearTerms`], or what makes [`PATH_PEAK`] of [`PATH_AFFINE`]. Exact terms lie
    /// at the footprint's own index.
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
/// Affine footprint whose `tau` is an opacity: min(tau exp(-Q/2), 1), whatever the mode of the
/// frame.
pub const PATH_PEAK: u32 = PATH_AFFINE | 4;
/// Surfel of an opaque surface: [`SurfelTerms`]; `tau` is its weight at the centre, `depth` the
/// greatest nearness that it has within its cut-off, its slack added.
pub const PATH_SURFEL: u32 = PATH_AFFINE | 8;
/// Surfel that reaches the camera plane: [`NearTerms`], its index above the low four bits.
pub const PATH_NEAR_SURFEL: u32 = PATH_NEAR | 8;
/// Exact perspective: [`ExactTerms`].
pub const PATH_EXACT: u32 = 1;
/// Perspective kernel that crosses the camera plane: [`NearTerms`].
pub const PATH_NEAR: u32 = 2;
/// Orthographic kernel that crosses the camera plane: affine times a half-line factor
/// from `half_line` and `sigma` of its [`NearTerms`].
pub const PATH_HALF_LINE: u32 = 3;

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
}

/// The plane of a surfel on the image. It takes the place of [`ExactTerms`], word by word.
///
/// At offset d from the centre its nearness (1/z under perspective, -z under an orthographic
/// camera) is `nearness + gradient . d`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SurfelTerms {
    /// Change of the nearness per pixel.
    pub gradient: [f32; 2],
    /// The nearness of the centre.
    pub nearness: f32,
    /// How far the nearness of one surface's surfels may differ.
    pub slack: f32,
    /// 1 where the footprint follows the plane's homography, Q over the square of the nearness
    /// relative to the centre's; 0 where it is affine.
    pub homography: f32,
    /// The unit normal, camera space, towards the eye: a whole number, as
    /// [`pack_normal`](crate::math::pack_normal) makes it.
    pub normal: f32,
}

impl From<SurfelTerms> for ExactTerms {
    #[inline]
    fn from(terms: SurfelTerms) -> Self {
        bytemuck::cast(terms)
    }
}

impl From<ExactTerms> for SurfelTerms {
    #[inline]
    fn from(terms: ExactTerms) -> Self {
        bytemuck::cast(terms)
    }
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
    /// Half-line path: dz/dx, dz/dy \[1/px\] and z at the centre. Otherwise the first is the length
    /// that the other terms are in units of, world units.
    pub half_line: [f32; 3],
}

/// Which part of the frame's footprints a dispatch works on.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartIndex {
    /// Its number.
    pub index: u32,
}

/// Where the footprints of a part lie among those of all parts.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PartRange {
    /// The global index of its first footprint.
    pub first: u32,
    /// How many it has.
    pub count: u32,
}

/// How many footprints a frame has.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SortState {
    /// Of all parts, visible or not.
    pub count: u32,
    /// Those that reach a pixel: the first ones in depth order.
    pub visible: u32,
    /// Of these, on the exact path.
    pub exact: u32,
}

/// Which footprints in depth order, and which tiles of the image, are drawn together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkUniform {
    /// The place of the chunk's first footprint in depth order.
    pub start: u32,
    /// Footprints of the chunk at most.
    pub capacity: u32,
    /// First column and row of the band, tiles.
    pub band_first: [u32; 2],
    /// Columns and rows of the band, tiles.
    pub band_size: [u32; 2],
    /// 1 for the last chunk.
    pub is_last: u32,
    /// Fills up a pair of words.
    pub unused: u32,
}

/// How much a chunk has.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkState {
    /// Footprints.
    pub length: u32,
    /// Words of the prefix sums of their entries: one more.
    pub offset_count: u32,
    /// Pairs of a tile and a footprint; 0 where they did not all find room.
    pub entries: u32,
    /// The most pairs that any chunk had since the host cleared this word, whether they found
    /// room or not; `u32::MAX` where they were that many or more.
    pub needed: u32,
}

impl Footprint {
    /// First and one-past-last pixel column.
    #[inline]
    pub fn column_range(&self) -> (u32, u32) {
        (self.columns & 0xffff, self.columns >> 16)
    }

    /// First and one-past-last pixel row.
    #[inline]
    pub fn row_range(&self) -> (u32, u32) {
        (self.rows & 0xffff, self.rows >> 16)
    }

    /// Whether it reaches any pixel.
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
