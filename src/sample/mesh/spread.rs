//! Chooses the number of surfels for a mesh.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::surface::Surface;
use super::{MOST_SURFELS, Spread};
use crate::data::mesh::{Mesh, MeshPart};
use crate::error::{Error, Parameter, Place, Result};
use crate::memory::no_room;
use crate::view::{Camera, Projection};

/// Greatest automatic spacing of surfels, as a share of the bounding box's diagonal: a mesh that fills a
/// picture of a thousand pixels has about one surfel per pixel.
const COARSEST: f64 = 1.0 / 1000.0;

/// Greatest automatic number of surfels: some five seconds of sampling on two cores.
const MOST_AUTOMATIC: f64 = 1e6;

/// Share of the covered pixels that get at least one surfel each. The remaining pixels, where a mesh is nearest
/// to the eye, would set the number for the whole mesh: a textured box took a million surfels instead of
/// 400,000, and twice the time.
const SEEN: f64 = 0.5;

/// Greatest ratio of the farthest depth of a piece to its nearest, for one density to hold for the piece.
/// Densities vary by at most its cube, a third.
const MOST_DEPTHS: f64 = 1.1;

/// Greatest width or height of such a piece, as a share of the picture's. A piece across the picture's edge
/// counts as a whole.
const MOST_OF_PICTURE: f64 = 1.0 / 16.0;

/// Greatest number of halvings of one triangle: 4,096 pieces.
const MOST_HALVINGS: u32 = 12;

/// Least memory \[bytes\] of a surfel, during sampling and in the scene.
const LEAST_BYTES: u64 = 200;

/// Returns the number of surfels to spread over the surface.
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
        Spread::Within { density, count } => (
            Parameter::SurfelDensity.into(),
            density,
            automatic(surface, area)
                .min(area * density)
                .min(count as f64),
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
    match no_room(count as u64 * LEAST_BYTES) {
        None => Ok(count),
        Some([expected, found]) => Err(Error::invalid(
            what,
            "number of surfels",
            expected,
            format!("{found} for {count} of them"),
            "ask for fewer surfels",
        )),
    }
}

/// Greatest number of surfels that are merged into one on average, for surfels that viewers composite. On a cow and on a
/// sphere, eight gave .7 dB more than four, for twice the time.
const MOST_MERGED: usize = 8;

/// Returns the number of surfels to merge into each of `count`. No more are spread than follow automatically from the
/// textures and the size of the surface.
pub(super) fn finer(surface: &Surface, count: usize) -> usize {
    let area = surface.area() * surface.unit * surface.unit;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a positive ratio, clamped below"
    )]
    let ratio = (automatic(surface, area) / count as f64) as usize;
    ratio.clamp(1, MOST_MERGED)
}

/// Returns the number of surfels that [`surfels`](super::surfels) spreads over the triangles of a mesh; 0 for a
/// mesh without area.
///
/// # Errors
/// The errors of [`Mesh::validate`]; numbers of `spread` that are not positive; more surfels than [`MOST_SURFELS`]
/// or than there is memory for.
pub fn surfel_count(mesh: &Mesh, spread: Spread) -> Result<usize> {
    mesh.validate()?;
    let surface = Surface::new(mesh);
    match surface.area() > 0.0 {
        true => count(&surface, spread),
        false => Ok(0),
    }
}

/// Returns the greatest number of surfels for each of several meshes that are drawn together. In total they get
/// at most as many as one mesh gets automatically, shared in proportion to what each would get by itself.
///
/// - `wanted`: surfels of each mesh alone ([`surfel_count`]).
///
/// ```
/// use ewa_splat::sample::mesh::share_out;
///
/// assert_eq!(share_out(&[40_000, 60_000]), [40_000, 60_000]);
/// assert_eq!(share_out(&[1_000_000, 3_000_000]), [250_000, 750_000]);
/// ```
pub fn share_out(wanted: &[usize]) -> Vec<usize> {
    let sum: f64 = wanted.iter().map(|&count| count as f64).sum();
    let share = (MOST_AUTOMATIC / sum.max(1.0)).min(1.0);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a count"
    )]
    let of = |&count: &usize| (count as f64 * share).ceil() as usize;
    wanted.iter().map(of).collect()
}

/// Returns the median number of pixels per unit area of a mesh in a picture \[1/length²\], over the pixels that
/// the mesh covers. Surfels of this density put at least one surfel on half of these pixels. Occlusion is ignored,
/// and so are parts outside the picture. Returns `None` if a part of the mesh lies behind the eye, or if the whole
/// mesh is outside the picture.
///
/// On a plane at the distance h from the eye, an area at the depth z covers fx fy h / z³ pixels per unit. A
/// mesh of lines and points alone is treated as an area at the mean depth of its corners that faces the eye.
pub fn pixels_per_area(mesh: &Mesh, camera: &Camera) -> Option<f64> {
    if mesh.triangle_count() == 0 {
        return straight_on(mesh, camera);
    }
    let of_part = |part: &MeshPart| {
        let add = |mut pieces: Vec<Piece>, triangle: &[u32; 3]| {
            let corner = |c: u32| part.positions.get(c as usize).filter(|p| p.is_finite());
            if let [Some(&a), Some(&b), Some(&c)] = triangle.map(corner) {
                add_pieces(camera, [a, b, c], 0, &mut pieces)?;
            }
            Some(pieces)
        };
        let joined = |mut some: Vec<Piece>, more| {
            some.extend::<Vec<_>>(more);
            Some(some)
        };
        let triangles = part.triangles.par_iter();
        let found = triangles.try_fold(Vec::new, add);
        found.try_reduce(Vec::new, joined)
    };
    let parts: Option<Vec<_>> = mesh.parts.iter().map(of_part).collect();
    let mut pieces = parts?.concat();
    pieces.sort_by(|a, b| b.density.total_cmp(&a.density));
    let covered: f64 = pieces.iter().map(|piece| piece.pixels).sum();
    let mut denser = 0.0;
    let last = pieces.into_iter().find(|piece| {
        denser += piece.pixels;
        denser > (1.0 - SEEN) * covered
    })?;
    (last.density > 0.0 && last.density.is_finite()).then_some(last.density)
}

/// Returns the pixels per unit of an area that faces the eye at the mean depth of a mesh's corners
/// \[1/length²\].
fn straight_on(mesh: &Mesh, camera: &Camera) -> Option<f64> {
    let positions = mesh.parts.iter().flat_map(|part| &part.positions);
    let depths = positions
        .filter(|p| p.is_finite())
        .map(|p| camera.camera_point(*p).z);
    let (sum, count) = depths.fold((0.0, 0.0), |(sum, count), z| (sum + z, count + 1.0));
    let depth = match camera.projection {
        Projection::Perspective => sum / count,
        Projection::Orthographic => 1.0,
    };
    let density = camera.focal_px.element_product() / (depth * depth);
    (count > 0.0 && depth > 0.0 && density > 0.0 && density.is_finite()).then_some(density)
}

/// A part of a triangle in the picture.
#[derive(Clone, Copy)]
struct Piece {
    /// Pixels per unit of area, at the middle \[1/length²\].
    density: f64,
    /// Pixels that the part covers.
    pixels: f64,
}

/// Halves a triangle until one density holds for each piece, and drops pieces outside the picture. Returns
/// `None` if a part lies behind the eye.
fn add_pieces(
    camera: &Camera,
    corners: [DVec3; 3],
    level: u32,
    pieces: &mut Vec<Piece>,
) -> Option<()> {
    let [a, b, c] = corners.map(|p| camera.camera_point(p));
    let (nearest, farthest) = (a.z.min(b.z).min(c.z), a.z.max(b.z).max(c.z));
    if !(nearest > 0.0) {
        return None;
    }
    let pixel = |p: DVec3| camera.project(p);
    let on_image = [pixel(corners[0])?, pixel(corners[1])?, pixel(corners[2])?];
    let low = on_image[0].min(on_image[1]).min(on_image[2]);
    let high = on_image[0].max(on_image[1]).max(on_image[2]);
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    if !(low.cmplt(size).all() && high.cmpgt(DVec2::ZERO).all()) {
        return Some(());
    }
    let is_perspective = camera.projection == Projection::Perspective;
    let is_deep = is_perspective && farthest > MOST_DEPTHS * nearest;
    let is_large = (high - low).max_element() > MOST_OF_PICTURE * size.max_element();
    if (is_deep || is_large) && level < MOST_HALVINGS {
        let length = |i: usize| corners[i].distance_squared(corners[(i + 1) % 3]);
        let longer = |i: usize, k: usize| if length(k) > length(i) { k } else { i };
        let i = longer(longer(0, 1), 2);
        let (p, q, r) = (corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]);
        let middle = p.midpoint(q);
        add_pieces(camera, [p, middle, r], level + 1, pieces)?;
        return add_pieces(camera, [middle, q, r], level + 1, pieces);
    }
    let doubled = (b - a).cross(c - a);
    let normal = doubled.normalize_or_zero();
    let focal = camera.focal_px.x * camera.focal_px.y;
    let at = (a + b + c) / 3.0;
    let density = if is_perspective {
        focal * normal.dot(at).abs() / (at.z * at.z * at.z)
    } else {
        focal * normal.z.abs()
    };
    let pixels = 0.5 * density * doubled.length();
    pieces.push(Piece { density, pixels });
    Some(())
}

/// Returns one surfel for each texel of the finest texture, within bounds.
fn automatic(surface: &Surface, area: f64) -> f64 {
    let finest = (0..surface.mesh.materials.len())
        .filter_map(|material| texel_density(surface, material))
        .fold(0.0, f64::max);
    let coarsest = COARSEST * diagonal(surface.mesh);
    (area * finest)
        .max(area / (coarsest * coarsest))
        .min(MOST_AUTOMATIC)
}

/// Returns the texels per unit area of a material's whole surface, for the finer of its textures; `None`
/// without textures or surface.
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

/// Diagonal of the box around all finite corners.
fn diagonal(mesh: &Mesh) -> f64 {
    let positions = mesh.parts.iter().flat_map(|part| &part.positions);
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in positions.filter(|p| p.is_finite()) {
        (low, high) = (low.min(*p), high.max(*p));
    }
    (high - low).length()
}
