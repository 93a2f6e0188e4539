//! Classifies and lights the mean value of each layer of slabs per pixel, instead of each particle.
//!
//! Particles carry their value, as a fraction of the range, in the place of a colour, and they all have
//! the same extinction. So the optical depth W of a layer is the length of the ray in it, in units of
//! that extinction. The sum N of optical depth times value gives the mean value f = N / W. Lighting needs
//! the gradient of f, (∇N - f ∇W) / W, from the derivatives of the footprints (as section 8 of Zwicker et
//! al. 2001 proposes for the resampling filter), including the low-pass filter.
//!
//! Twin: `shaders/tile/classify/slab.wgsl`.

use glam::Vec3;

use crate::constants::{FRAC_1_SQRT_2PI, LEAST_SLOPE, TILE_PIXELS, TILE_SIZE};
use crate::cpu::light::{Sides, lit};
use crate::cpu::tile::evaluate::{Evaluate, Row, RowSlope};
use crate::cpu::tile::interval::shares_up_to;
use crate::cpu::tile::pixels::{Plane, RowOf, TilePlace, add_scaled, ray};
use crate::math::lane::exp_minus_half;
use crate::record::LightingUniform;
use crate::scene::TransferFunction;

/// Data that turns the mean value of a layer into a colour and an optical depth.
#[derive(Debug, Clone, Copy)]
pub struct PostClassification<'a> {
    /// Maps values to colours and extinctions.
    pub transfer: &'a TransferFunction,
    /// One over the extinction that particles carry.
    pub per_extinction: f32,
    /// Lighting of layers.
    pub lighting: Option<&'a LightingUniform>,
}

impl PostClassification<'_> {
    /// Returns the linear colour and the optical depth of a layer at pixel `i` of a tile.
    ///
    /// - `length`, `carried`: W and N.
    /// - `slopes`: derivatives of both, if layers are lit; `depth`: the middle of the layer.
    pub(in crate::cpu::tile) fn classify(
        &self,
        place: &TilePlace<'_>,
        i: usize,
        [length, carried]: [f32; 2],
        slopes: Option<&Slopes>,
        depth: f32,
    ) -> [f32; 4] {
        let mean = carried / length;
        let [red, green, blue, extinction] = self.transfer.classify_share(mean);
        let mut colour = [red, green, blue];
        if let (Some(lighting), Some(slopes)) = (self.lighting, slopes) {
            let direction = ray(place.view, place.pixel(i));
            let normal = slopes.direction(place, i, [length, mean], direction, depth);
            let to_eye = if place.view.orthographic == 0 {
                -direction.normalize_or_zero()
            } else {
                -Vec3::Z
            };
            colour = lit(lighting, Sides::Both, colour, normal, to_eye);
        }
        let [red, green, blue] = colour;
        [red, green, blue, length * self.per_extinction * extinction]
    }
}

/// The part of a kernel along a row of a tile up to one depth at each pixel.
pub(in crate::cpu::tile) struct RowEdge {
    /// Share of the kernel's optical depth.
    share: [f32; TILE_SIZE],
    /// Derivative of the share with respect to the depth.
    density: [f32; TILE_SIZE],
}

impl RowEdge {
    #[inline(always)]
    pub(in crate::cpu::tile) fn new<const FMA: bool>(
        evaluate: &Evaluate<'_>,
        row: &Row,
        depths: &RowOf<f32>,
    ) -> Self {
        let mut edge = Self {
            share: shares_up_to::<FMA>(evaluate, row, depths),
            density: [0.0; TILE_SIZE],
        };
        for (lane, (out, depth)) in edge.density.iter_mut().zip(depths).enumerate() {
            let ahead = row.ahead(lane, *depth);
            let density = exp_minus_half::<FMA>((ahead * ahead).min(49.0));
            // NaN and depths far out have density 0.
            let near_by = if ahead.abs() <= 7.0 { density } else { 0.0 };
            *out = near_by * FRAC_1_SQRT_2PI * row.per_sigma[lane];
        }
        if let Some([from, to]) = &row.domain {
            // If the domain ends before a layer does, the kernel's part of the layer does not change with
            // the layer's end.
            for lane in 0..TILE_SIZE {
                let is_within = from[lane] < edge.share[lane] && edge.share[lane] < to[lane];
                edge.density[lane] *= f32::from(u8::from(is_within));
            }
        }
        edge
    }
}

/// Derivatives of the sums over the kernels of a layer at the pixels of a tile: along its columns, its
/// rows, and z.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(in crate::cpu::tile) struct Slopes {
    carried: [Plane; 3],
    length: [Plane; 3],
}

impl Default for Slopes {
    fn default() -> Self {
        Self {
            carried: [[0.0; TILE_PIXELS]; 3],
            length: [[0.0; TILE_PIXELS]; 3],
        }
    }
}

impl Slopes {
    /// Clears pixel `i`.
    pub(in crate::cpu::tile) fn clear_pixel(&mut self, i: usize) {
        for plane in self.carried.iter_mut().chain(&mut self.length) {
            plane[i] = 0.0;
        }
    }

    /// Adds the part of a kernel between two depths at the pixels of a row, which begins at `first`.
    ///
    /// - `carried`: the value that the kernel carries.
    #[inline(always)]
    pub(in crate::cpu::tile) fn add(
        &mut self,
        first: usize,
        row: &Row,
        slope: &RowSlope,
        [below, above]: [&RowEdge; 2],
        carried: f32,
    ) {
        let mut part = [0.0; TILE_SIZE];
        let mut rise = [0.0; TILE_SIZE];
        for lane in 0..TILE_SIZE {
            part[lane] = row.tau[lane] * (above.share[lane] - below.share[lane]).max(0.0);
            rise[lane] = row.tau[lane] * (above.density[lane] - below.density[lane]);
        }
        let mut of_axis = [[0.0; TILE_SIZE], [0.0; TILE_SIZE], rise];
        for (k, of_axis) in of_axis[..2].iter_mut().enumerate() {
            let (log_tau, mean) = (&slope.log_tau[k], &slope.mean[k]);
            for lane in 0..TILE_SIZE {
                of_axis[lane] = log_tau[lane] * part[lane] - mean[lane] * rise[lane];
            }
        }
        for (k, of_axis) in of_axis.iter().enumerate() {
            add_scaled(&mut self.length[k], first, of_axis, 1.0);
            add_scaled(&mut self.carried[k], first, of_axis, carried);
        }
    }

    /// Returns the camera-space direction in which the mean value grows; zero if there is none.
    fn direction(
        &self,
        place: &TilePlace<'_>,
        i: usize,
        [length, mean]: [f32; 2],
        ray: Vec3,
        depth: f32,
    ) -> Vec3 {
        let view = place.view;
        let at = |planes: &[Plane; 3]| Vec3::from([0, 1, 2].map(|k| planes[k][i]));
        // Gradient of the mean value, per pixel and per unit of z; then per thickness of a layer.
        let of_mean = at(&self.carried) - mean * at(&self.length);
        let mut slope = of_mean * (view.layer_thickness / length);
        let perspective = view.orthographic == 0;
        // Pixels grow with z under perspective.
        let per_px = if perspective { depth } else { 1.0 };
        slope.x *= view.focal_px[0] / per_px;
        slope.y *= view.focal_px[1] / per_px;
        if perspective {
            slope.z -= ray.x * slope.x + ray.y * slope.y;
        }
        if slope.length_squared() > LEAST_SLOPE * LEAST_SLOPE {
            slope.normalize_or_zero()
        } else {
            Vec3::ZERO
        }
    }
}
