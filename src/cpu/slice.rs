//! Sums kernels on a plane across an orthographic view, at the pixels' centres: a slice through their field.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::project::Shapes;
use crate::blocks::{BlockedScene, BlockedVolume, visit_amplitudes};
use crate::constants::MOST_EDGES;
use crate::data::smoothing::SphKernel;
use crate::error::Result;
use crate::scene::NO_EDGE;
use crate::splat::RoundKernel;
use crate::task::{Task, check};
use crate::view::{Camera, ClipPlane};

/// Rows of the image that are summed together.
const BAND_ROWS: usize = 16;

/// Kernels whose sections are kept at a time: 64 MB, with the edges of each.
const BATCH: usize = 1 << 18;

/// The plane of a slice, and what is drawn on it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane<'a> {
    /// An orthographic camera; the plane lies across its view.
    pub(crate) camera: &'a Camera,
    /// A point of the plane, world units.
    pub(crate) through: DVec3,
    /// The kernel of round particles; `None` for Gaussians.
    pub(crate) smoothing: Option<SphKernel>,
    /// Cut-off radius of Gaussians, standard deviations.
    pub(crate) cutoff: f64,
    /// Planes outside which nothing counts.
    pub(crate) clip: &'a [ClipPlane],
    /// May cancel the sum.
    pub(crate) task: Option<&'a Task>,
}

/// Sums on a plane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Slice {
    /// One value for each pixel, row by row; field.
    pub(crate) values: Vec<f64>,
    /// Number of kernels that the plane cuts.
    pub(crate) cut: usize,
    /// Number of these whose section is narrower than a pixel, so that pixels' centres may miss it.
    pub(crate) narrow: usize,
    /// Number of kernels at the plane without a thickness, which have no density.
    pub(crate) flat: usize,
}

/// The section of a kernel: peak x profile(m²), with m² = rest + d' Q d for an offset d from its middle.
#[derive(Debug, Clone, Copy)]
struct Section {
    /// Middle on the image.
    middle_px: DVec2,
    /// Half extents on the image.
    reach_px: DVec2,
    /// Q: xx, xy, yy; 1/px².
    precision: [f64; 3],
    rest: f64,
    /// Greatest m² that counts.
    limit: f64,
    /// Amplitude over volume.
    peak: f64,
    /// Inward normals on the image and distances of the middle from the planes that end the kernel; px.
    edges: Option<[[f64; 3]; MOST_EDGES]>,
}

/// Sums the kernels of a scene's data on a plane.
///
/// # Errors
/// Cancelled.
pub(crate) fn slice(scene: &BlockedScene, plane: &Plane<'_>) -> Result<Slice> {
    let (width, height) = (plane.camera.width, plane.camera.height);
    let mut sum = Slice {
        values: vec![0.0; width * height],
        ..Slice::default()
    };
    for volume in scene.data() {
        let blocks = 0..volume.blocks.len() as u32;
        let reached: Vec<u32> = blocks.filter(|&b| plane.reaches(volume, b)).collect();
        for batch in batches(&reached, |block| volume.blocks[block as usize].count) {
            check(plane.task)?;
            let found: Vec<Found> = batch
                .par_iter()
                .map(|&block| plane.sections(volume, block))
                .collect();
            plane.add(&mut sum, &found);
        }
    }
    check(plane.task)?;
    plane.clip_rows(&mut sum.values);
    Ok(sum)
}

/// Divides blocks into runs of about [`BATCH`] kernels.
///
/// - `kernels`: returns the number of kernels of a block.
fn batches(blocks: &[u32], kernels: impl Fn(u32) -> u32) -> Vec<&[u32]> {
    let (mut batches, mut first, mut held) = (Vec::new(), 0, 0);
    for (i, &block) in blocks.iter().enumerate() {
        let count = kernels(block) as usize;
        if held > 0 && held + count > BATCH {
            batches.push(&blocks[first..i]);
            (first, held) = (i, 0);
        }
        held += count;
    }
    batches.push(&blocks[first..]);
    batches
}

/// Sections of a block's kernels.
#[derive(Default)]
struct Found {
    sections: Vec<Section>,
    flat: usize,
}

impl Plane<'_> {
    /// Adds the sections of kernels to the sums.
    fn add(&self, sum: &mut Slice, found: &[Found]) {
        let (width, height) = (self.camera.width, self.camera.height);
        let mut bands = vec![Vec::new(); height.div_ceil(BAND_ROWS)];
        for section in found.iter().flat_map(|of_block| &of_block.sections) {
            sum.cut += 1;
            sum.narrow += usize::from(section.reach_px.min_element() < 0.5);
            let rows = pixels(section.middle_px.y, section.reach_px.y, height);
            if !rows.is_empty() {
                for band in &mut bands[rows.start / BAND_ROWS..=(rows.end - 1) / BAND_ROWS] {
                    band.push(section);
                }
            }
        }
        sum.flat += found.iter().map(|of_block| of_block.flat).sum::<usize>();
        let kernel = self.smoothing.map(RoundKernel::new);
        let rows = sum.values.par_chunks_mut((BAND_ROWS * width).max(1));
        rows.zip(&bands).enumerate().for_each(|(n, (rows, band))| {
            for section in band {
                section.add(rows, [width, n * BAND_ROWS], kernel.as_ref());
            }
        });
    }

    /// Returns the depth of the plane in camera space.
    fn depth(&self) -> f64 {
        self.camera.camera_point(self.through).z
    }

    /// Returns the square of the radius at which m is 1, in standard deviations, and the greatest m² that counts.
    fn reach(&self) -> (f64, f64) {
        match self.smoothing {
            Some(kernel) => (RoundKernel::reach(kernel).powi(2), 1.0),
            None => (1.0, self.cutoff * self.cutoff),
        }
    }

    /// Clears the pixels whose centres lie outside a clip plane.
    fn clip_rows(&self, values: &mut [f64]) {
        if self.clip.is_empty() {
            return;
        }
        let Camera {
            eye,
            camera_from_world,
            focal_px,
            centre_px,
            width,
            ..
        } = self.camera;
        let (to_world, depth) = (camera_from_world.transpose(), self.depth());
        let rows = values.par_chunks_mut((*width).max(1));
        rows.enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                let at_px = DVec2::new(x as f64, y as f64) + 0.5 - *centre_px;
                let point = *eye + to_world * (at_px / *focal_px).extend(depth);
                if self.clip.iter().any(|plane| plane.inside(point) < 0.0) {
                    *value = 0.0;
                }
            }
        });
    }

    /// Returns whether the plane may cut a kernel of a block.
    fn reaches(&self, volume: &BlockedVolume, block: u32) -> bool {
        let block = &volume.blocks[block as usize];
        let distance = self.camera.camera_point(block.origin).z - self.depth();
        let (widening, limit) = self.reach();
        let reach = (widening * limit).sqrt() * f64::from(block.max_sigma)
            + f64::from(block.half_extent.length());
        // NaN counts.
        !(distance.abs() > 1.001 * reach)
    }

    fn sections(&self, volume: &BlockedVolume, block: u32) -> Found {
        let rotation = self.camera.camera_from_world.as_mat3();
        let shapes = Shapes::new(volume, rotation);
        let shapes = shapes.of_block(block);
        let origin = self
            .camera
            .camera_point(volume.blocks[block as usize].origin);
        let depth = self.depth();
        let has_edges = volume.has_boundary();
        let mut found = Found::default();
        visit_amplitudes(volume, block, |local, amplitude| {
            if amplitude == 0.0 || !amplitude.is_finite() {
                return;
            }
            let (offset, factor) = shapes.get(local);
            let centre = origin + offset.as_dvec3();
            let rows = [factor.x, factor.y, factor.z].map(|row| row.as_dvec3());
            let section = match self.section(centre, depth - centre.z, rows, amplitude) {
                Ok(Some(section)) => section,
                Ok(None) => return,
                Err(IsFlat) => {
                    found.flat += 1;
                    return;
                }
            };
            let edges = has_edges.then(|| shapes.edges(local));
            found.sections.push(Section {
                edges: edges.map(|edges| self.edges(edges, depth - centre.z, &section, centre)),
                ..section
            });
        });
        found
    }

    /// Returns the section of a kernel, if there is one.
    ///
    /// - `centre`: camera space, relative to the eye.
    /// - `rise`: distance from the centre to the plane, along the view.
    /// - `rows`: rows of the factor F, of the variance F F'.
    fn section(
        &self,
        centre: DVec3,
        rise: f64,
        [x, y, z]: [DVec3; 3],
        amplitude: f64,
    ) -> std::result::Result<Option<Section>, IsFlat> {
        let focal = self.camera.focal_px;
        let depth_variance = z.length_squared();
        let (widening, limit) = self.reach();
        let rest = rise * rise / (widening * depth_variance);
        if depth_variance == 0.0 {
            let is_there = rise == 0.0;
            return if is_there { Err(IsFlat) } else { Ok(None) };
        }
        if !(rest < limit) {
            return Ok(None);
        }
        // The distribution across the view at the plane: means and variances under a condition.
        let tilt = DVec2::new(x.dot(z), y.dot(z)) / depth_variance;
        let xx = x.length_squared() - tilt.x * tilt.x * depth_variance;
        let yy = y.length_squared() - tilt.y * tilt.y * depth_variance;
        let xy = x.dot(y) - tilt.x * tilt.y * depth_variance;
        let determinant = xx * yy - xy * xy;
        // Rounding of f32 shapes: as flat as nothing.
        if !(determinant > 1e-12 * (xx * yy) && xx > 0.0 && yy > 0.0) {
            return Err(IsFlat);
        }
        let root = (depth_variance * determinant).sqrt();
        let volume = match self.smoothing {
            Some(_) => widening.powf(1.5) * root,
            None => std::f64::consts::TAU.powf(1.5) * root,
        };
        let middle = centre.truncate() + tilt * rise;
        let left = (limit - rest) * widening;
        let section = Section {
            middle_px: middle * focal + self.camera.centre_px,
            reach_px: DVec2::new((left * xx).sqrt(), (left * yy).sqrt()) * focal,
            precision: [
                yy / (determinant * widening * focal.x * focal.x),
                -xy / (determinant * widening * focal.x * focal.y),
                xx / (determinant * widening * focal.y * focal.y),
            ],
            rest,
            limit,
            peak: amplitude / volume,
            edges: None,
        };
        let is_sound = section.middle_px.is_finite() && section.peak.is_finite();
        Ok(is_sound.then_some(section))
    }

    /// Returns the planes that end a kernel, on the image about the middle of its section.
    fn edges(
        &self,
        planes: [[f32; 4]; MOST_EDGES],
        rise: f64,
        section: &Section,
        centre: DVec3,
    ) -> [[f64; 3]; MOST_EDGES] {
        let focal = self.camera.focal_px;
        planes.map(|plane| {
            let [x, y, z, distance] = plane.map(f64::from);
            if plane == NO_EDGE || !distance.is_finite() {
                return [0.0, 0.0, f64::INFINITY];
            }
            let normal = self.camera.camera_from_world * DVec3::new(x, y, z);
            let across = normal.truncate() / focal;
            let middle = section.middle_px - self.camera.centre_px - centre.truncate() * focal;
            let inside = distance + normal.z * rise + across.dot(middle);
            [across.x, across.y, inside]
        })
    }
}

/// Says that a kernel has no thickness.
struct IsFlat;

impl Section {
    /// Adds the section to rows of the image.
    ///
    /// - `width`, `first`: the image's width, and the number of the first row.
    fn add(&self, rows: &mut [f64], [width, first]: [usize; 2], kernel: Option<&RoundKernel>) {
        let [qxx, qxy, qyy] = self.precision;
        let across = pixels(self.middle_px.x, self.reach_px.x, width);
        let all = pixels(
            self.middle_px.y,
            self.reach_px.y,
            first + rows.len() / width,
        );
        for row in all.start.max(first)..all.end {
            let dy = row as f64 + 0.5 - self.middle_px.y;
            let values = &mut rows[(row - first) * width..][across.clone()];
            for (value, column) in values.iter_mut().zip(across.clone()) {
                let dx = column as f64 + 0.5 - self.middle_px.x;
                let m_squared = self.rest + dx * (qxx * dx + 2.0 * qxy * dy) + qyy * dy * dy;
                let is_outside = |[nx, ny, inside]: &[f64; 3]| inside + nx * dx + ny * dy < 0.0;
                let ends = self.edges.as_ref();
                if !(m_squared < self.limit) || ends.is_some_and(|e| e.iter().any(is_outside)) {
                    continue;
                }
                let profile = match kernel {
                    Some(kernel) => kernel.at(m_squared.sqrt()),
                    None => (-0.5 * m_squared).exp(),
                };
                *value += self.peak * profile;
            }
        }
    }
}

/// Returns the pixels whose centres lie within `reach` of `middle`, of `count`.
fn pixels(middle: f64, reach: f64, count: usize) -> std::ops::Range<usize> {
    let first = (middle - reach - 0.5).ceil().max(0.0);
    let last = (middle + reach - 0.5).floor() + 1.0;
    let end = last.clamp(0.0, count as f64) as usize;
    (first.min(count as f64) as usize).min(end)..end
}
