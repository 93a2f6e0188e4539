//! Finishes a mesh for all mesh readers: removes and counts the elements that cannot be drawn.

use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use crate::data::mesh::{Material, Mesh, MeshPart};
use crate::error::{Advice, Error, Result};

/// Ratio of a triangle's area to the square of its longest side below which its corners are collinear up to rounding. A
/// cross product of f64 edges errs by a few units in the last place.
const FLAT: f64 = 8.0 * f64::EPSILON;

/// Numbers of elements that were left out or replaced.
#[derive(Debug, Default)]
pub(crate) struct LeftOut {
    /// Triangles with a corner that is not finite.
    pub(crate) non_finite: usize,
    /// Triangles without an area.
    pub(crate) zero_area: usize,
    /// Lines and points that are not finite.
    pub(crate) marks: usize,
    /// Texture coordinates that are not finite; they became 0.
    pub(crate) coordinates: usize,
    /// Colours that are not finite; they became white.
    pub(crate) colours: usize,
}

impl LeftOut {
    /// Returns one sentence for each kind that occurs.
    pub(crate) fn notes(&self) -> impl Iterator<Item = String> {
        [
            (
                self.non_finite,
                "triangles have NaN or infinite corners and are left out",
            ),
            (self.zero_area, "triangles have no area and are left out"),
            (
                self.marks,
                "lines and points are not finite and are left out",
            ),
            (
                self.coordinates,
                "texture coordinates are not finite and taken as 0",
            ),
            (self.colours, "colours are not finite and taken as white"),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
    }
}

/// Returns the cross product of two sides, or `None` if a corner (or the product) is not finite.
pub(crate) fn cross(part: &MeshPart, triangle: [u32; 3]) -> Option<DVec3> {
    let [a, b, c] = triangle.map(|i| part.positions[i as usize]);
    Some((b - a).cross(c - a)).filter(|n| n.is_finite() && a.is_finite())
}

/// Old indices of the kept elements of a part.
#[derive(Debug)]
pub(crate) struct Kept {
    /// Kept corners; empty if all are kept.
    pub(crate) corners: Vec<u32>,
    pub(crate) triangles: Vec<u32>,
}

/// Removes triangles that cannot be drawn and corners that nothing uses, and establishes the guarantees of
/// [`MeshPart`]. Indices must be in range.
pub(crate) fn finish(part: &mut MeshPart, left_out: &mut LeftOut) -> Kept {
    let mut triangles = std::mem::take(&mut part.triangles);
    let mut kept = Vec::new();
    let mut numbers = 0_u32..;
    triangles.retain(|&triangle| {
        let number = numbers.next();
        let [a, b, c] = triangle.map(|i| part.positions[i as usize]);
        let Some(normal) = cross(part, triangle) else {
            left_out.non_finite += 1;
            return false;
        };
        let longest = (b - a)
            .length_squared()
            .max((c - a).length_squared())
            .max((c - b).length_squared());
        let is_kept = normal.length() > FLAT * longest;
        left_out.zero_area += usize::from(!is_kept);
        kept.extend(number.filter(|_| is_kept));
        is_kept
    });
    part.triangles = triangles;
    let is_finite = |i: u32| part.positions[i as usize].is_finite();
    let before = part.lines.len() + part.points.len();
    part.lines.retain(|line| line.iter().all(|&i| is_finite(i)));
    part.points.retain(|&i| is_finite(i));
    left_out.marks += before - part.lines.len() - part.points.len();
    let corners = leave_out_unused(part);
    for set in &mut part.texture_coordinates {
        for uv in set.iter_mut().filter(|uv| !uv.is_finite()) {
            *uv = Vec2::ZERO;
            left_out.coordinates += 1;
        }
    }
    for colour in &mut part.colours {
        if !colour.iter().all(|c| c.is_finite()) {
            *colour = [1.0; 4];
            left_out.colours += 1;
        }
    }
    unit_normals(part);
    Kept {
        corners,
        triangles: kept,
    }
}

/// Removes unused corners. Returns the old indices of the kept corners, or an empty list if all are kept. Indices must
/// be in range.
pub(crate) fn leave_out_unused(part: &mut MeshPart) -> Vec<u32> {
    let mut is_used = vec![false; part.positions.len()];
    let in_lines = part.lines.as_flattened().iter().chain(&part.points);
    for &i in part.triangles.as_flattened().iter().chain(in_lines) {
        is_used[i as usize] = true;
    }
    if is_used.iter().all(|is| *is) {
        return Vec::new();
    }
    fn keep<T>(items: &mut Vec<T>, is_used: &[bool]) {
        let mut used = is_used.iter();
        items.retain(|_| used.next() == Some(&true));
    }
    let mut next = 0;
    let indices: Vec<u32> = is_used
        .iter()
        .map(|&is| {
            let index = next;
            next += u32::from(is);
            index
        })
        .collect();
    let in_lines = part.lines.as_flattened_mut().iter_mut();
    let in_triangles = part.triangles.as_flattened_mut().iter_mut();
    for i in in_triangles.chain(in_lines).chain(&mut part.points) {
        *i = indices[*i as usize];
    }
    keep(&mut part.positions, &is_used);
    keep(&mut part.normals, &is_used);
    keep(&mut part.colours, &is_used);
    for set in &mut part.texture_coordinates {
        keep(set, &is_used);
    }
    let used = (0..).zip(&is_used).filter(|(_, is)| **is);
    used.map(|(i, _)| i).collect()
}

/// Normalises the normals. One without a direction is computed from its triangles.
fn unit_normals(part: &mut MeshPart) {
    let unit = |n: Vec3| n.as_dvec3().try_normalize().map(DVec3::as_vec3);
    if part.normals.iter().any(|n| unit(*n).is_none()) {
        let mut sums = vec![DVec3::ZERO; part.positions.len()];
        for &triangle in &part.triangles {
            let normal = cross(part, triangle).unwrap_or_default();
            triangle
                .iter()
                .for_each(|&i| sums[i as usize] += normal.normalize_or_zero());
        }
        for (n, sum) in part.normals.iter_mut().zip(sums) {
            if unit(*n).is_none() {
                // Opposite triangles may cancel; then any direction is acceptable.
                *n = sum.try_normalize().unwrap_or(DVec3::Z).as_vec3();
            }
        }
    }
    for n in &mut part.normals {
        *n = unit(*n).unwrap_or(Vec3::Z);
    }
}

/// Linear grey for meshes without colours. It is 80 % in sRGB encoding, so that lit surfaces stay below white.
const PLAIN_GREY: f32 = 0.604;

/// Returns the material for a format without materials: white if the mesh has colours, and light grey otherwise.
pub(crate) fn plain(has_colours: bool) -> Material {
    let grey = if has_colours { 1.0 } else { PLAIN_GREY };
    Material {
        base_colour: [grey, grey, grey, 1.0],
        ..Material::default()
    }
}

/// Refuses a mesh with no elements.
pub(crate) fn check_not_empty(path: &Path, mesh: &Mesh) -> Result<()> {
    if mesh.triangle_count() > 0 || mesh.line_count() + mesh.point_count() > 0 {
        return Ok(());
    }
    Err(Error::format(
        path,
        "mesh",
        "a triangle with an area",
        "none",
        Advice::no_data("save the mesh again, with its faces"),
    ))
}
