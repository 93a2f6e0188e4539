//! Defines the stages' view of a frame's camera, lights and settings.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::constants::{MAX_CLIP_PLANES, MAX_LIGHTS, MAX_PLANES};
use crate::scene::{LightFrame, Lighting};
use crate::view::{Camera, Projection};

/// Quantity that depth keys measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum KeyKind {
    /// The distance from the eye.
    Distance = 0,
    /// The depth along the camera's axis.
    Depth = 1,
    /// The depth along an axis, in a range that the layers give.
    Layers = 2,
}

/// The camera and the settings of a frame in f32, as its stages read them.
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
    /// The tolerance that the adaptive filter and the cut-off follow.
    pub tolerance: f32,
    /// A cut-off radius given by hand, standard deviations; 0 follows the tolerance.
    pub cutoff: f32,
    /// Depth keys per unit of distance.
    pub key_scale: f32,
    /// 1 if colours show the evaluation path of each kernel, 0 otherwise.
    pub show_choice: u32,
    /// Quantity that depth keys measure, as [`KeyKind`] numbers it.
    pub key_kind: u32,
    /// Depth z at which the first layer of slabs begins, in multiples of the thickness.
    pub layer_first: i32,
    /// Thickness of a layer, world units.
    pub layer_thickness: f32,
    /// Axis of the keys of layers: a unit vector in camera space.
    pub key_axis: [f32; 3],
    /// A footprint belongs to the layer `key >> layer_shift`. With slabs it begins in that layer.
    pub layer_shift: u32,
    /// 1 if a depth key encodes where a kernel begins, 0 if it encodes the centre.
    pub keys_begin: u32,
    /// Number of clip planes.
    pub clip_count: u32,
    /// 1 if a kernel smaller than a pixel has the opacity it would have alone, 0 otherwise.
    pub sub_pixel_opacity: u32,
    /// For maxima: least length of a ray in a slab for the slab's mean value to count. Given as optical
    /// depth of the extinction that particles carry.
    pub least_length: f32,
    /// Standard deviation of the opening of the lens along an axis, world units; 0 for a point.
    pub aperture: f32,
    /// One over the depth that is in focus, per world unit.
    pub per_focus: f32,
    /// Padding to four words.
    pub unused: u32,
    /// For column sums: 0 for Gaussians, otherwise 1 + the index of the [`SphKernel`](crate::data::smoothing::SphKernel) by which
    /// affine footprints are drawn.
    pub smoothing: u32,
    /// Planes n . u + d >= 0, camera space: (n, d).
    pub clip_planes: [[f32; 4]; MAX_CLIP_PLANES],
}

/// The camera in more precision, as the stages on the device read it besides a [`ViewUniform`]. Each f64
/// is stored as its bits, low word first: the device subtracts the eye in integers (`shared/f64.wgsl`).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CameraUniform {
    /// The eye, world units, f64.
    pub eye: [[u32; 2]; 3],
    /// Rows of the rotation into camera space, f64.
    pub camera_from_world: [[[u32; 2]; 3]; 3],
    /// Inward normals of the frustum's planes and of the clip planes, camera space, f64.
    pub plane_normals: [[[u32; 2]; 3]; MAX_PLANES],
    /// Distances of these planes, f64: inside is n . u + d >= 0.
    pub plane_distances: [[u32; 2]; MAX_PLANES],
    /// Magnitudes of the normals' components in the world, f64.
    pub plane_spreads: [[[u32; 2]; 3]; MAX_PLANES],
    /// Axis of the keys of layers, camera space, f64.
    pub key_axis: [[u32; 2]; 3],
    /// Distance at which depth keys begin, world units, f64.
    pub key_near: [u32; 2],
    /// Depth keys per unit of distance, f64.
    pub keys_per_unit: [u32; 2],
    /// Columns of the rotation into camera space.
    pub rotation: [[f32; 3]; 3],
    /// 1 if blocks outside the frustum are rejected, 0 otherwise.
    pub has_frustum: u32,
    /// 1 for an orthographic camera, 0 for a perspective one.
    pub orthographic: u32,
    /// Quantity that depth keys measure, as [`KeyKind`] numbers it.
    pub key_kind: u32,
    /// Number of planes.
    pub plane_count: u32,
    /// Padding to a pair of words.
    pub unused: u32,
    /// Rules by which blocks choose their filter.
    pub choice: ChoiceUniform,
}

/// A light in camera space.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightUniform {
    /// Towards the light, camera space, unit length; 0.
    pub direction: [f32; 4],
    /// Linear RGB; 0.
    pub colour: [f32; 4],
}

/// The lighting of a frame: [`Lighting`] in camera space.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightingUniform {
    /// Lights; zeros from `count` on.
    pub lights: [LightUniform; MAX_LIGHTS],
    /// Number of lights.
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
    /// Transforms `lighting` into the space of `camera`. Lights beyond [`MAX_LIGHTS`] are left out
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

/// Parameters of the choice of a block's filter and of merged particles.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ChoiceUniform {
    /// The least and the greatest focal length, pixels per unit of slope or per world unit.
    pub focal_px: [f32; 2],
    /// c_min and c_max of eq. 7 of Chen et al. 2004, the latter times its factor of the field of view.
    /// Read if `by_hand` is 1.
    pub thresholds: [f32; 2],
    /// 1 if the thresholds choose the filter, 0 if the tolerance does.
    pub by_hand: u32,
    /// 1 for an orthographic camera, 0 for a perspective one.
    pub orthographic: u32,
    /// The filter asked for, as [`crate::splat::Filter`] numbers them.
    pub filter_kind: u32,
    /// Variance of the low-pass filter, px².
    pub low_pass_variance_px2: f32,
    /// The tolerance.
    pub tolerance: f32,
    /// The tolerance for merged particles that replace their members; 0 if none may.
    pub merge_tolerance: f32,
    /// Rule that classifies kernels which need more than their values, as
    /// [`ClassifiedBy`](super::ClassifiedBy) numbers it.
    pub classified_by: u32,
    /// Thickness of slabs whose mean values are classified, world units.
    pub slab_thickness: f32,
}
