//! How many surfels.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::surface::Surface;
use super::{MOST_SURFELS, Spread};
use crate::error::{Error, Parameter, Place, Result};
use crate::io::{Mesh, MeshPart};
use crate::view::{Camera, Projection};

/// Chosen automatically, surfels lie no further apart than this share of the bounding box's
/// diagonal: a mesh that fills a picture of a thousand pixels has about one for each.
const COARSEST: f64 = 1.0 / 1000.0;

/// Surfels chosen automatically at most: some five seconds of sampling on two cores.
const MOST_AUTOMATIC: f64 = 1e6;

/// How many surfels to spread over the surface.
pub(super) fn count(surface: &Surface, spread: Spread) -> Result<usize> {
    // World units squared.
    let area = surface.area() * surface.unit * surface.unit;
    let surfels = || Place::from("surfels");
    let (what, given, count) = match spread {
        Spread::Automatic => (surfels(), 1.0, automatic(surface, area)),
        Spread::NoDenser(density) => (
            Parameter::SurfelDensity.into(),
            density,
            automatic(surface, area).min(area * density),
        ),
        Spread::Density(density) => (Parameter::SurfelDensity.into(), density, area * density),
        Spread::Spacing(spacing) => (
            Parameter::SurfelSpacing.into(),
            spacing,
            area / (spacing * spacing),
        ),
        Spread::Count(count) => (surfels(), 1.0, count as f64),
    };
    if !(given > 0.0 && given.is_finite()) {
        return Err(Error::invalid(
            what,
            "value",
            "a positive number",
            given.to_string(),
            "leave it out to have it chosen",
        ));
    }
    if !(count <= MOST_SURFELS as f64) {
        return Err(Error::invalid(
            what,
            "number of surfels",
            format!("at most {MOST_SURFELS}"),
            format!("{count:.3e} for an area of {area:.6e}"),
            "ask for fewer surfels",
        ));
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive and checked above"
    )]
    let count = count.round().max(1.0) as usize;
    Ok(count)
}

/// How many pixels fall on a unit of a mesh's area where it is seen largest \[1/length²\]: surfels of this
/// density are one for each pixel there, and more everywhere else. What hides it does not count, and nor
/// does the edge of the picture. `None` where some of the mesh lies beside or behind the eye, or nothing of it
/// has a place.
///
/// On a plane at the distance h from the eye an area at the depth z has fx fy h / z³ pixels, most at the
/// nearest corner of a triangle.
pub fn most_pixels_per_area(mesh: &Mesh, camera: &Camera) -> Option<f64> {
    let focal = camera.focal_px.x * camera.focal_px.y;
    let of_triangle = |part: &MeshPart, triangle: &[u32; 3]| {
        let corner = |c: u32| part.positions.get(c as usize).filter(|p| p.is_finite());
        let [Some(a), Some(b), Some(c)] = triangle.map(corner) else {
            return 0.0;
        };
        let [a, b, c] = [a, b, c].map(|p| camera.camera_point(*p));
        let depth = a.z.min(b.z).min(c.z);
        if !(depth > 0.0) {
            return f64::INFINITY;
        }
        let normal = (b - a).cross(c - a).normalize_or_zero();
        match camera.projection {
            Projection::Perspective => focal * normal.dot(a).abs() / (depth * depth * depth),
            Projection::Orthographic => focal * normal.z.abs(),
        }
    };
    let of_part = |part: &MeshPart| {
        let densities = part.triangles.par_iter().map(|t| of_triangle(part, t));
        densities.reduce(|| 0.0, f64::max)
    };
    let most = mesh.parts.iter().map(of_part).fold(0.0, f64::max);
    (most > 0.0 && most.is_finite()).then_some(most)
}

/// One surfel for each texel of the finest texture, within bounds.
fn automatic(surface: &Surface, area: f64) -> f64 {
    let finest = (0..surface.mesh.materials.len())
        .filter_map(|material| texel_density(surface, material))
        .fold(0.0, f64::max);
    let coarsest = COARSEST * diagonal(surface.mesh);
    (area * finest)
        .max(area / (coarsest * coarsest))
        .min(MOST_AUTOMATIC)
}

/// Texels per unit area of a material's surface as a whole, of the finer of its textures;
/// `None` without textures or surface.
fn texel_density(surface: &Surface, material: usize) -> Option<f64> {
    let mesh = surface.mesh;
    let uses = [
        &mesh.materials[material].base_texture,
        &mesh.materials[material].emissive_texture,
    ];
    let density = |used: &crate::io::TextureUse| {
        let image = &mesh.textures.get(used.texture)?.image;
        let (mut texels, mut area) = (0.0, 0.0);
        for triangle in surface.kinds.iter().flatten() {
            let part = &mesh.parts[triangle.part as usize];
            if part.material != material {
                continue;
            }
            let set = part.texture_coordinates.get(used.coordinates)?;
            let corner = |c: u32| -> Option<DVec2> {
                let uv = used.transform.transform_point2(*set.get(c as usize)?);
                Some(uv.as_dvec2())
            };
            let [a, b, c] = part.triangles[triangle.index as usize];
            let (a, b, c) = (corner(a)?, corner(b)?, corner(c)?);
            let covered = 0.5 * (b - a).perp_dot(c - a).abs();
            if covered.is_finite() {
                texels += covered * image.width as f64 * image.height as f64;
                area += triangle.area;
            }
        }
        let density = texels / (area * surface.unit * surface.unit);
        density.is_finite().then_some(density)
    };
    uses.into_iter()
        .flatten()
        .filter_map(density)
        .reduce(f64::max)
}

/// Of the box around all finite corners.
fn diagonal(mesh: &Mesh) -> f64 {
    let positions = mesh.parts.iter().flat_map(|part| &part.positions);
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in positions.filter(|p| p.is_finite()) {
        (low, high) = (low.min(*p), high.max(*p));
    }
    (high - low).length()
}
