//! Collects the triangles of a mesh that have an area, in a frame of their own, by kind of surface.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::data::mesh::{AlphaMode, Mesh};
use crate::sample::positions::index_u32;

/// Kind of a surface; the surfels of one kind form a point volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kind {
    pub(super) is_pane: bool,
    pub(super) is_one_sided: bool,
}

impl Kind {
    pub(super) const ALL: [Self; 4] = [
        Self::of(false, true),
        Self::of(false, false),
        Self::of(true, true),
        Self::of(true, false),
    ];

    const fn of(is_pane: bool, is_one_sided: bool) -> Self {
        Self {
            is_pane,
            is_one_sided,
        }
    }
}

/// Corners of a triangle that is a whole triangle of the mesh.
const WHOLE: [DVec2; 3] = [DVec2::ZERO, DVec2::X, DVec2::Y];

/// A triangle with an area: one of the mesh, or a part of one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle {
    pub(super) part: u32,
    pub(super) index: u32,
    /// Barycentric coordinates of the corners along the two edges of the mesh's triangle.
    pub(super) corners: [DVec2; 3],
    /// Connected component; connected triangles share it.
    pub(super) component: u32,
    /// Unit normal of the front.
    pub(super) normal: Vec3,
    /// Area, in the surface's squared unit.
    pub(super) area: f64,
}

/// The triangles of a mesh. Coordinates are relative to `origin`, in units of `unit`.
#[derive(Debug)]
pub(super) struct Surface<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) origin: DVec3,
    pub(super) unit: f64,
    /// One list for each of [`Kind::ALL`].
    pub(super) kinds: [Vec<Triangle>; 4],
    pub(super) faults: Faults,
}

/// Reason why a triangle gives nothing.
#[derive(Debug, Clone, Copy)]
enum Fault {
    Missing,
    NotFinite,
    Empty,
}

/// Numbers of triangles that give nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Faults {
    /// A corner or the material does not exist.
    pub(super) missing: usize,
    /// A corner is not finite, or too far from the others to compute with.
    pub(super) not_finite: usize,
    /// The triangle has no area.
    pub(super) empty: usize,
}

impl<'a> Surface<'a> {
    /// Collects the triangles, in units of the mesh's greatest extent.
    pub(super) fn new(mesh: &'a Mesh) -> Self {
        let (low, high) = bounds(mesh);
        let origin = 0.5 * low + 0.5 * high;
        let extent = (high - low).max_element();
        let unit = if extent > 0.0 && extent.is_finite() {
            extent
        } else {
            1.0
        };
        let mut surface = Self {
            mesh,
            origin,
            unit,
            kinds: Default::default(),
            faults: Faults::default(),
        };
        let components = components(mesh);
        let mut first_corner = 0;
        for (part, p) in mesh.parts.iter().enumerate() {
            let Some(material) = mesh.materials.get(p.material) else {
                surface.faults.missing += p.triangles.len();
                first_corner += p.positions.len();
                continue;
            };
            let kind = Kind::of(
                material.alpha == AlphaMode::Blend,
                !material.is_double_sided,
            );
            let list = Kind::ALL.iter().position(|k| *k == kind).unwrap_or(0);
            for index in 0..p.triangles.len() {
                match surface.triangle(part, index) {
                    Ok((normal, area)) => surface.kinds[list].push(Triangle {
                        part: index_u32(part),
                        index: index_u32(index),
                        corners: WHOLE,
                        component: components[first_corner + p.triangles[index][0] as usize],
                        normal,
                        area,
                    }),
                    Err(Fault::Missing) => surface.faults.missing += 1,
                    Err(Fault::NotFinite) => surface.faults.not_finite += 1,
                    Err(Fault::Empty) => surface.faults.empty += 1,
                }
            }
            first_corner += p.positions.len();
        }
        surface
    }

    /// Returns the normal and the area of a triangle.
    fn triangle(&self, part: usize, index: usize) -> Result<(Vec3, f64), Fault> {
        let corners = self.mesh.parts[part].triangles[index];
        let count = self.mesh.parts[part].positions.len();
        if corners.iter().any(|&c| c as usize >= count) {
            return Err(Fault::Missing);
        }
        let [_, e1, e2] = self.edges(part, index);
        let cross = e1.cross(e2);
        let length = cross.length();
        if !(length.is_finite() && e1.is_finite() && e2.is_finite()) {
            return Err(Fault::NotFinite);
        }
        // Slivers far below rounding still have a direction: scaled before squaring.
        let normal = (cross / cross.abs().max_element()).try_normalize();
        match normal {
            Some(normal) if length > 0.0 => Ok((normal.as_vec3(), 0.5 * length)),
            _ => Err(Fault::Empty),
        }
    }

    /// Returns the first corner and the two edges that begin there, in the surface's frame.
    fn edges(&self, part: usize, index: usize) -> [DVec3; 3] {
        let part = &self.mesh.parts[part];
        let corner = part.triangles[index].map(|c| self.local(part.positions[c as usize]));
        [corner[0], corner[1] - corner[0], corner[2] - corner[0]]
    }

    /// Returns the same for the mesh's triangle that contains this one.
    pub(super) fn edges_of(&self, triangle: &Triangle) -> [DVec3; 3] {
        self.edges(triangle.part as usize, triangle.index as usize)
    }

    fn local(&self, world: DVec3) -> DVec3 {
        (world - self.origin) / self.unit
    }

    pub(super) fn world(&self, local: DVec3) -> DVec3 {
        self.origin + local * self.unit
    }

    /// Changes the unit of length; `unit` is in world units.
    pub(super) fn measure_in(&mut self, unit: f64) {
        let ratio = self.unit / unit;
        for triangle in self.kinds.iter_mut().flatten() {
            triangle.area *= ratio * ratio;
        }
        self.unit = unit;
    }

    /// Returns the area of all triangles, in units of the frame.
    pub(super) fn area(&self) -> f64 {
        self.kinds.iter().map(|list| area(list)).sum()
    }
}

/// Returns the sum of areas.
pub(super) fn area(triangles: &[Triangle]) -> f64 {
    triangles.iter().map(|t| t.area).sum()
}

/// Returns the least and greatest finite coordinates.
fn bounds(mesh: &Mesh) -> (DVec3, DVec3) {
    let of = |positions: &[DVec3]| {
        positions
            .par_iter()
            .filter(|p| p.is_finite())
            .map(|&p| (p, p))
            .reduce_with(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    };
    let parts = mesh.parts.iter().filter_map(|part| of(&part.positions));
    parts
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
        .unwrap_or((DVec3::ZERO, DVec3::ZERO))
}

/// Returns a number for each corner of all parts, equal for corners that triangles connect. Corners at one
/// position count as one, in whatever parts they are.
fn components(mesh: &Mesh) -> Vec<u32> {
    let count: usize = mesh.parts.iter().map(|part| part.positions.len()).sum();
    let mut parents: Vec<u32> = (0..count).map(index_u32).collect();
    let mut at: HashMap<[u64; 3], u32> = HashMap::with_capacity(count);
    let mut first = 0;
    for part in &mesh.parts {
        for (i, position) in part.positions.iter().enumerate() {
            // Adding zero makes -0 and 0 equal.
            let bits = position.to_array().map(|x| (x + 0.0).to_bits());
            let corner = index_u32(first + i);
            let same = *at.entry(bits).or_insert(corner);
            parents[corner as usize] = same;
        }
        for triangle in &part.triangles {
            if triangle.iter().any(|&c| c as usize >= part.positions.len()) {
                continue;
            }
            let [a, b, c] = triangle.map(|c| index_u32(first) + c);
            join(&mut parents, a, b);
            join(&mut parents, a, c);
        }
        first += part.positions.len();
    }
    for corner in 0..index_u32(count) {
        parents[corner as usize] = root(&mut parents, corner);
    }
    parents
}

fn root(parents: &mut [u32], mut corner: u32) -> u32 {
    while parents[corner as usize] != corner {
        // Path halving keeps the path short.
        let above = parents[corner as usize];
        parents[corner as usize] = parents[above as usize];
        corner = parents[corner as usize];
    }
    corner
}

fn join(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parents, a), root(parents, b));
    let (low, high) = (a.min(b), a.max(b));
    parents[high as usize] = low;
}
