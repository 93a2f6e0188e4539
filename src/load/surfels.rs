//! Chooses the number of surfels of meshes by the pixels of pictures.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::facts::Corners;
use crate::data::mesh::Mesh;
use crate::sample::mesh::{Spread, pixels_per_area, share_out, surfel_count};
use crate::scene::{Particles, PointVolume};
use crate::view::{Bounds, Camera, Projection};

/// Number of surfels of a mesh that no camera sees.
const UNSEEN: usize = 256;

/// Number of positions sampled to find where most particles of a volume are, if no transfer
/// function shows them.
const PLACES: usize = 4096;

/// Fraction of these positions that may lie beyond the box, on each side.
const BEYOND: f64 = 0.02;

/// Number of surfels that a mesh would get by itself.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct SurfelDemand {
    /// Largest number of surfels per unit area, if pictures determine it.
    density: Option<f64>,
    count: usize,
    is_unseen: bool,
}

impl SurfelDemand {
    /// Computes the number of surfels.
    ///
    /// - `cameras`: cameras of the pictures; empty if they are not known.
    pub fn of(mesh: &Mesh, cameras: &[Camera]) -> Self {
        let own = Self::without_count(mesh, cameras);
        let spread = own.density.map_or(Spread::Automatic, Spread::NoDenser);
        let count = match own.is_unseen {
            true => UNSEEN,
            // Sampling reports the errors of a mesh.
            false => surfel_count(mesh, spread).unwrap_or_default(),
        };
        Self { count, ..own }
    }

    /// Computes everything but the count.
    pub(super) fn without_count(mesh: &Mesh, cameras: &[Camera]) -> Self {
        let densities = cameras
            .iter()
            .filter_map(|camera| pixels_per_area(mesh, camera));
        let density = densities.reduce(f64::max);
        let is_unseen =
            density.is_none() && !cameras.is_empty() && !cameras.iter().any(|c| is_seen(mesh, c));
        Self {
            density,
            count: 0,
            is_unseen,
        }
    }

    /// Returns how surfels are spread over each mesh that has a demand, and the largest number of
    /// each. All meshes together get no more surfels than one would.
    pub fn share(all: &[Option<Self>]) -> Vec<Option<(Spread, usize)>> {
        let counts = all.iter().map(|own| own.map_or(0, |own| own.count));
        let shares = share_out(&counts.collect::<Vec<_>>());
        let each = all.iter().zip(shares);
        each.map(|(own, count)| own.map(|own| (own.spread(count, all.len() == 1), count)))
            .collect()
    }

    /// Returns how surfels are spread over the mesh.
    ///
    /// - `count`: the mesh's share of all surfels, if the mesh is not alone.
    fn spread(&self, count: usize, is_alone: bool) -> Spread {
        match (self.density, is_alone) {
            _ if self.is_unseen => Spread::Count(UNSEEN),
            (None, true) => Spread::Automatic,
            (Some(density), true) => Spread::NoDenser(density),
            (None, false) => Spread::Count(count.max(1)),
            (Some(density), false) => Spread::Within { density, count },
        }
    }
}

pub(super) fn joined(a: Corners, b: Corners) -> Corners {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Returns the corners of the visible part of a volume: where its transfer function shows
/// something, or where most of its particles are.
pub(super) fn seen_corners(volume: &PointVolume) -> Option<Corners> {
    let particles = &volume.particles;
    let count = particles.len();
    let position = |i: usize| match particles {
        Particles::Lattice { lattice, .. } => {
            let [x, y, _] = lattice.dims;
            lattice.position([i % x, i / x % y, i / (x * y)])
        }
        _ => particles.positions()[i],
    };
    if let (Some(function), Some(values)) = (&volume.transfer_function, &volume.values) {
        let [low, high] = function.range();
        let least = (function.max_extinction(low, high) * crate::constants::FAINT_SHARE)
            .max(f32::MIN_POSITIVE);
        let shown = (0..count).into_par_iter().filter(|&i| {
            let value = values.get(i);
            value.is_finite() && function.classify(value)[3] >= least
        });
        let places = shown.map(|i| (position(i), position(i)));
        return places.reduce_with(joined);
    }
    let stride = count.div_ceil(PLACES).max(1);
    let places: Vec<DVec3> = (0..count).step_by(stride).map(position).collect();
    let ends = |axis: usize| {
        let along = places.iter().map(|p| p[axis]).filter(|x| x.is_finite());
        let mut along: Vec<f64> = along.collect();
        along.sort_by(f64::total_cmp);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a few thousand"
        )]
        let beyond = (along.len() as f64 * BEYOND) as usize;
        Some((
            *along.get(beyond)?,
            *along.get(along.len().checked_sub(1 + beyond)?)?,
        ))
    };
    let [x, y, z] = [ends(0)?, ends(1)?, ends(2)?];
    Some((DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1)))
}

/// Returns true if a camera may see any of a mesh, judged by the box around it.
fn is_seen(mesh: &Mesh, camera: &Camera) -> bool {
    let positions = mesh.parts.iter().flat_map(|part| &part.positions);
    let ends = positions.filter(|p| p.is_finite()).map(|&p| (p, p));
    let Some((low, high)) = ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) else {
        return false;
    };
    let corner = |i: usize| {
        let pick = |axis: usize| {
            if i >> axis & 1 == 0 {
                low[axis]
            } else {
                high[axis]
            }
        };
        camera.camera_point(DVec3::new(pick(0), pick(1), pick(2)))
    };
    let corners: Vec<DVec3> = (0..8).map(corner).collect();
    let is_flat = camera.projection == Projection::Orthographic;
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let (low, high) = (-camera.centre_px, size - camera.centre_px);
    // A box lies outside the picture if all its corners lie beyond one of the picture's sides.
    let beyond = |side: &dyn Fn(DVec2, f64) -> bool| {
        corners.iter().all(|p| {
            let depth = if is_flat { 1.0 } else { p.z };
            side(camera.focal_px * p.truncate(), depth)
        })
    };
    let is_behind = !is_flat && corners.iter().all(|p| p.z <= 0.0);
    !(is_behind
        || beyond(&|p, depth| p.x < low.x * depth)
        || beyond(&|p, depth| p.x > high.x * depth)
        || beyond(&|p, depth| p.y < low.y * depth)
        || beyond(&|p, depth| p.y > high.y * depth))
}

/// Returns boxes around runs of triangles, lines and points of a mesh.
pub(super) fn boxes_of(mesh: &Mesh) -> Vec<Bounds> {
    /// Triangles in a run: neighbours in a file are mostly neighbours in space.
    const RUN: usize = 256;
    let mut boxes = Vec::new();
    for part in &mesh.parts {
        let place = |&i: &u32| part.positions.get(i as usize).filter(|p| p.is_finite());
        let mut add = |indices: &mut dyn Iterator<Item = &u32>| {
            let ends = indices.filter_map(place).map(|&p| (p, p)).reduce(joined);
            boxes.extend(ends.map(|(a, b)| ((a + b) / 2.0, (b - a) / 2.0)));
        };
        let triangles = part.triangles.chunks(RUN);
        triangles.for_each(|run| add(&mut run.iter().flatten()));
        let lines = part.lines.chunks(RUN);
        lines.for_each(|run| add(&mut run.iter().flatten()));
        part.points.chunks(RUN).for_each(|run| add(&mut run.iter()));
    }
    boxes
}
