//! What the stages of a frame read of camera, lights and settings.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::constants::{MAX_CLIP_PLANES, MAX_LIGHTS, MAX_PLANES};
use crate::scene::{LightFrame, Lighting};
use crate::view::{Camera, Projection};

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
    /// Which multiple of the thickness the first layer of slabs begins at, depth z.
    pub layer_first: i32,
    /// Thickness of a layer, world units.
    pub layer_thickness: f32,
    /// A unit vector in camera space.
    pub key_axis: [f32; 3],
    /// A footprint belongs to (of slabs: begins in) the layer `key >> layer_shift`.
    pub layer_shift: u32,
    /// 1 where a depth key says where a kernel begins; 0 where it says where its centre lies.
    pub keys_begin: u32,
    /// How many of the clip planes there are.
    pub clip_count: u32,
    /// 1 where kernels smaller than a pixel have the opacity of lone ones.
    pub sub_pixel_opacity: u32,
    /// Of maxima: how long a ray must be in a slab for its mean value to count, as optical depth of the
    /// extinction that particles carry.
    pub least_length: f32,
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
    /// Padding to a pair of words.
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
    /// Padding to four words.
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
    /// The tolerance for merged particles that stand for their members; 0 where none may.
    pub merge_tolerance: f32,
    /// What decides about kernels where more than their values must be asked, as
    /// [`ClassifiedBy`](super::ClassifiedBy) numbers it.
    pub classified_by: u32,
    /// World units, of slabs whose mean values are classified.
    pub slab_thickness: f32,
}
