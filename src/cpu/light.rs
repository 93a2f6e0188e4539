//! Stage: lights the visible particles that have a normal, once per particle.

use glam::{Mat3, Vec3, Vec4};
use rayon::prelude::*;

use super::project::Shapes;
use super::shadow::{kernel_transmittance, surfel_transmittance};
use crate::blocks::{BlockedParticles, BlockedVolume};
use crate::constants::MAX_LIGHTS;
use crate::math::normal_of_code;
use crate::record::{
    BlockView, Carried, ClassifiedParticle, LightingUniform, PieceTerms, ShadowUniform,
};
use crate::scene::StrengthIn;
use crate::splat::unit_normal;

/// Shadows of a frame.
#[derive(Debug, Clone, Copy)]
pub struct Shadowing<'a> {
    /// The lights' grids and maps as the camera sees them.
    pub uniform: &'a ShadowUniform,
    /// The numbers of all grids and maps.
    pub words: &'a [f32],
}

/// Lights the colours of `classified`. The normals are those that the volume stores; surfels without
/// stored normals use those of their planes. Other particles stay unchanged. So do splats that state
/// their opacity: their colours are those of a radiance field, which is already lit.
///
/// - `views`: with their origins in camera space.
/// - `pieces`: one for each particle if kernels are classified over their extents; empty otherwise.
/// - `rotation`: rotation of the viewing transformation.
pub fn light(
    volume: &BlockedVolume,
    views: &[BlockView],
    pieces: &[PieceTerms],
    rotation: Mat3,
    lighting: &LightingUniform,
    shadows: Option<Shadowing<'_>>,
    classified: &mut [ClassifiedParticle],
) {
    /// Least number of particles per parallel task.
    const GRAIN: usize = 1024;
    if !volume.is_lit() {
        return;
    }
    let shapes = Shapes::new(volume, rotation);
    let is_sheet = matches!(volume.strength, StrengthIn::Translucent(_));
    let light_one = |(n, particle): (usize, &mut ClassifiedParticle)| {
        let view = &views[particle.view as usize];
        let (i, offset) = volume.place(view.block, particle.local);
        let from_eye = Vec3::from(view.origin_camera) + rotation * offset;
        let to_eye = if lighting.orthographic != 0 {
            -Vec3::Z
        } else {
            -from_eye.normalize_or_zero()
        };
        let mut facing = Vec3::ZERO;
        let (normal, sides) = match (&volume.particles, &volume.normals) {
            (BlockedParticles::Surfels { tangents, .. }, codes) => {
                let [ax, ay, az, bx, by, bz] = tangents[i];
                let (a, b) = (Vec3::new(ax, ay, az), Vec3::new(bx, by, bz));
                let plane = unit_normal(rotation * a, rotation * b).unwrap_or(Vec3::ZERO);
                facing = plane;
                let normal = match codes {
                    Some(codes) => {
                        smooth_normal(plane, rotation * normal_of_code(codes[i]), to_eye)
                    }
                    None => plane,
                };
                (normal, Sides::Facing)
            }
            (_, Some(codes)) => (rotation * normal_of_code(codes[i]), Sides::Both),
            (_, None) => return,
        };
        let mut passed = [1.0; MAX_LIGHTS];
        if let Some(Shadowing { uniform, words }) = shadows {
            let lights = uniform.lights.iter().zip(&mut passed);
            let lights = lights.take(lighting.count as usize);
            if sides == Sides::Facing {
                for (shadow, passed) in lights {
                    *passed = surfel_transmittance(shadow, words, from_eye, facing, is_sheet);
                }
            } else {
                let of_block = shapes.of_block(view.block);
                let (_, mut factor) = of_block.get(particle.local);
                let mut at = from_eye;
                if let Some(piece) = pieces.get(n)
                    && (piece.width != 1.0 || piece.shift != 0.0)
                {
                    let moved;
                    (moved, factor) = piece.applied(of_block.axis(piece), factor);
                    at += moved;
                }
                for (shadow, passed) in lights {
                    *passed = kernel_transmittance(shadow, words, at, &factor, to_eye);
                }
            }
        }
        let colour = particle.carried.colour();
        let lit = lit_through(lighting, sides, colour, normal, to_eye, &passed);
        particle.carried = Carried::of_colour(lit);
    };
    classified
        .par_iter_mut()
        .enumerate()
        .with_min_len(GRAIN)
        .for_each(light_one);
}

/// Least cosine between a smooth normal and the direction to the eye. Beyond a silhouette a smooth normal
/// would face away, and light would fall on it from the other side.
const LEAST_FACING: f32 = 0.01;

/// Returns the normal by which a surfel of a smooth surface reflects, on the eye's side of the surfel's
/// plane. Zero if none is stored: the surfel then stays unlit.
///
/// - `plane`, `stored`, `to_eye`: camera space, unit length; the first two are zero for none.
#[inline]
pub(crate) fn smooth_normal(plane: Vec3, stored: Vec3, to_eye: Vec3) -> Vec3 {
    let outward = if plane.dot(to_eye) < 0.0 {
        -stored
    } else {
        stored
    };
    let cosine = outward.dot(to_eye);
    if stored == Vec3::ZERO || cosine >= LEAST_FACING {
        return outward;
    }
    (outward + to_eye * (LEAST_FACING - cosine)).normalize_or_zero()
}

/// The sides of a normal from which light falls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sides {
    /// Either side: the gradient of a field has no outside.
    Both,
    /// The side of the eye: for surfaces.
    Facing,
}

/// Returns the colour of a particle under `lighting`, as [`Lighting`](crate::scene::Lighting) defines it;
/// `colour` itself without a normal.
///
/// - `normal`, `to_eye`: camera space, unit length; zero for none.
#[inline]
pub fn lit(
    lighting: &LightingUniform,
    sides: Sides,
    colour: [f32; 3],
    normal: Vec3,
    to_eye: Vec3,
) -> [f32; 3] {
    lit_through(lighting, sides, colour, normal, to_eye, &[1.0; MAX_LIGHTS])
}

/// As [`lit`], under shadows.
///
/// - `passed`: share of each light that reaches the particle.
#[inline]
fn lit_through(
    lighting: &LightingUniform,
    sides: Sides,
    colour: [f32; 3],
    normal: Vec3,
    to_eye: Vec3,
    passed: &[f32; MAX_LIGHTS],
) -> [f32; 3] {
    if normal == Vec3::ZERO {
        return colour;
    }
    let normal = if sides == Sides::Facing && normal.dot(to_eye) < 0.0 {
        -normal
    } else {
        normal
    };
    let seen = |cosine: f32| match sides {
        Sides::Both => cosine.abs(),
        Sides::Facing => cosine.max(0.0),
    };
    let mut reflected = Vec3::splat(lighting.ambient);
    let mut highlight = Vec3::ZERO;
    let lights = lighting.lights.iter().zip(passed);
    for (light, passed) in lights.take(lighting.count as usize) {
        let direction = Vec4::from(light.direction).truncate();
        let diffuse = seen(normal.dot(direction));
        // The light is behind the surface.
        if !(diffuse > 0.0) {
            continue;
        }
        let halfway = (direction + to_eye).normalize_or_zero();
        let specular = seen(normal.dot(halfway)).min(1.0);
        let light = Vec4::from(light.colour).truncate() * *passed;
        reflected += light * (lighting.diffuse * diffuse);
        highlight += light * (lighting.specular * specular.powf(lighting.shininess));
    }
    (Vec3::from(colour) * reflected + highlight).into()
}
