//! Computes the normals for shading a surface, from its corners and its materials' textures.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use super::paint::Laid;
use super::surface::{Surface, Triangle};
use super::texture::{Pyramid, Weighing};
use crate::data::mesh::{Material, Mesh, MeshPart};
use crate::sample::positions::index_u32;

/// Cosine of 40 degrees: triangles that meet at a smaller angle belong to one smooth surface, unless the file
/// states otherwise.
const SMOOTH_COSINE: f64 = 0.766;

/// Least cosine between a shading normal and the triangle's own normal: textures bend normals no farther.
const LEAST_OUTWARD: f64 = 0.02;

/// Sources of normals.
pub(super) struct Normals<'a> {
    mesh: &'a Mesh,
    /// Corner normals of each triangle, for smooth parts whose corners have none.
    smooth: HashMap<u32, Vec<[DVec3; 3]>>,
    /// Pyramids of the normal textures in use.
    pyramids: HashMap<usize, Pyramid<'a>>,
}

impl<'a> Normals<'a> {
    /// Prepares the normals of a surface's materials that `is_used`.
    pub(super) fn new(surface: &Surface<'a>, is_used: &[bool]) -> Self {
        let mesh = surface.mesh;
        let mut pyramids = HashMap::new();
        let used = mesh
            .materials
            .iter()
            .zip(is_used)
            .filter(|(_, used)| **used);
        for (material, _) in used {
            if let Some(laid) = &material.normal_texture
                && let Some(texture) = mesh.textures.get(laid.texture)
            {
                let make = || Pyramid::new(texture, Weighing::Numbers);
                pyramids.entry(laid.texture).or_insert_with(make);
            }
        }
        Self {
            mesh,
            smooth: smoothed(surface),
            pyramids,
        }
    }

    /// Returns the normals of a triangle of the surface; `None` for unlit materials.
    pub(super) fn of(&self, surface: &Surface, triangle: &Triangle) -> Option<TriangleNormals<'_>> {
        let part = &self.mesh.parts[triangle.part as usize];
        let material = &self.mesh.materials[part.material];
        if material.is_unlit {
            return None;
        }
        let indices = part.triangles[triangle.index as usize];
        let own = triangle.normal.as_dvec3();
        let of_file = || {
            let normal = |i: u32| part.normals.get(i as usize).map(|n| n.as_dvec3());
            let [a, b, c] = indices.map(normal);
            Some([a?, b?, c?])
        };
        let of_smooth = || {
            let of_part = self.smooth.get(&triangle.part)?;
            of_part.get(triangle.index as usize).copied()
        };
        let corners = of_file().or_else(of_smooth).unwrap_or([own; 3]);
        // Some files have normals that face away from the front that the winding defines.
        let outward = |normal: DVec3| match normal.dot(own) < 0.0 {
            true => -normal,
            false => normal,
        };
        Some(TriangleNormals {
            own,
            corners: corners.map(outward),
            relief: self.relief(surface, part, material, indices),
        })
    }

    fn relief(
        &self,
        surface: &Surface,
        part: &MeshPart,
        material: &Material,
        indices: [u32; 3],
    ) -> Option<Relief<'_>> {
        let used = material.normal_texture.as_ref()?;
        let pyramid = self.pyramids.get(&used.texture)?;
        let laid = Laid::of(used, part, indices, pyramid)?;
        let [a, b, c] = indices.map(|i| part.positions[i as usize]);
        let (along, across) = (b - a, c - a);
        // The directions in which the texture's coordinates grow, along the triangle.
        let [du, dv] = [0, 1].map(|axis| [laid.edges[0][axis], laid.edges[1][axis]]);
        let determinant = du[0] * dv[1] - du[1] * dv[0];
        let right = (along * dv[1] - across * dv[0]) * determinant.signum();
        let down = (across * du[0] - along * du[1]) * determinant.signum();
        let unit = surface.unit;
        Some(Relief {
            laid,
            right: (right / unit).try_normalize()?,
            top: -(down / unit).try_normalize()?,
            scale: f64::from(material.normal_scale),
        })
    }
}

/// The normals over a triangle.
pub(super) struct TriangleNormals<'a> {
    own: DVec3,
    corners: [DVec3; 3],
    relief: Option<Relief<'a>>,
}

/// A texture of normals on a triangle.
struct Relief<'a> {
    laid: Laid<'a>,
    /// Unit vectors to the right and to the top of the texture.
    right: DVec3,
    top: DVec3,
    scale: f64,
}

impl TriangleNormals<'_> {
    /// Returns the unit normal of a part of the triangle, given by its middle and its variance (xx, xy, yy) in
    /// barycentric coordinates along the two edges.
    pub(super) fn at(&self, middle: DVec2, variance: [f64; 3]) -> DVec3 {
        let [a, b, c] = self.corners;
        let between = a * (1.0 - middle.x - middle.y) + b * middle.x + c * middle.y;
        let smooth = between.try_normalize().unwrap_or(self.own);
        let Some(relief) = &self.relief else {
            return smooth;
        };
        let [x, y, z, _] = relief.laid.filtered(middle, variance);
        let [x, y, z] = [x, y, z].map(|c| 2.0 * c - 1.0);
        let within =
            |direction: DVec3| (direction - smooth * direction.dot(smooth)).try_normalize();
        let (Some(right), Some(top)) = (within(relief.right), within(relief.top)) else {
            return smooth;
        };
        let bent = (right * x + top * y) * relief.scale + smooth * z.max(LEAST_OUTWARD);
        bent.try_normalize().unwrap_or(smooth)
    }
}

/// Computes normals at the corners of smooth parts that have none: means over the triangles there that meet at
/// small angles. Each triangle is weighted by its angle at the corner.
fn smoothed(surface: &Surface) -> HashMap<u32, Vec<[DVec3; 3]>> {
    let mesh = surface.mesh;
    let is_smooth = |part: &&MeshPart| part.normals.is_empty() && !part.is_flat;
    // Coinciding corners of several parts count as one place.
    let mut places: HashMap<[u64; 3], u32> = HashMap::new();
    let mut corners: Vec<(u32, DVec3)> = Vec::new();
    let mut place_of: Vec<Vec<u32>> = Vec::new();
    for part in mesh.parts.iter().filter(is_smooth) {
        let own = part.positions.iter().map(|position| {
            let next = places.len();
            // Adding zero makes -0 and 0 equal.
            let bits = position.to_array().map(|x| (x + 0.0).to_bits());
            *places.entry(bits).or_insert(index_u32(next))
        });
        let own: Vec<u32> = own.collect();
        for &indices in &part.triangles {
            let Some((normal, angles)) = shape(part, indices) else {
                continue;
            };
            for (corner, angle) in indices.into_iter().zip(angles) {
                corners.push((own[corner as usize], normal * angle));
            }
        }
        place_of.push(own);
    }
    corners.sort_by_key(|(place, _)| *place);
    let mut first = vec![0; places.len() + 1];
    for (place, _) in &corners {
        first[*place as usize + 1] += 1;
    }
    for i in 1..first.len() {
        first[i] += first[i - 1];
    }
    let parts = mesh.parts.iter().enumerate();
    let parts = parts.filter(|(_, part)| is_smooth(part));
    let normals = parts.zip(place_of).map(|((number, part), own)| {
        let of_triangle = |&indices: &[u32; 3]| {
            let Some((normal, _)) = shape(part, indices) else {
                return [DVec3::ZERO; 3];
            };
            indices.map(|corner| {
                let place = own[corner as usize] as usize;
                let around = &corners[first[place]..first[place + 1]];
                let near = around.iter().map(|(_, weighed)| *weighed);
                let is_near = |n: &DVec3| n.dot(normal) >= SMOOTH_COSINE * n.length();
                near.filter(is_near).sum()
            })
        };
        let normals = part.triangles.iter().map(of_triangle).collect();
        (index_u32(number), normals)
    });
    normals.collect()
}

/// Returns the unit normal of a triangle and its angles \[rad\]; `None` if it has no area.
fn shape(part: &MeshPart, indices: [u32; 3]) -> Option<(DVec3, [f64; 3])> {
    let at = |i: u32| part.positions.get(i as usize).copied();
    let [a, b, c] = indices.map(at);
    let corners = [a?, b?, c?];
    let edge = |from: usize, to: usize| (corners[to % 3] - corners[from]).try_normalize();
    let normal = edge(0, 1)?.cross(edge(0, 2)?).try_normalize()?;
    let angle = |i: usize| Some(edge(i, i + 1)?.dot(edge(i, i + 2)?).clamp(-1.0, 1.0).acos());
    Some((normal, [angle(0)?, angle(1)?, angle(2)?]))
}
