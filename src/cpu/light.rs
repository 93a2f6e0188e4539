//! Stage: light on particles that have a normal, per visible particle, once.

use glam::{Mat3, Vec3, Vec4};
use rayon::prelude::*;

use crate::blocks::{BlockedParticles, BlockedVolume};
use crate::math::normal_of_code;
use crate::record::{BlockView, Carried, ClassifiedParticle, LightingUniform};
use crate::splat::unit_normal;

/// Lights the colours of `classified`: by the normals that the volume stores, of surfels without any by those of
/// their planes; does nothing elsewhere, nor to splats that state their opacity,
/// whose colours are those of a radiance field, lit already.
///
/// - `views`: with their origins in camera space.
/// - `rotation`: of the viewing transformation.
pub fn light(
    volume: &BlockedVolume,
    views: &[BlockView],
    rotation: Mat3,
    lighting: &LightingUniform,
    classified: &mut [ClassifiedParticle],
) {
    /// Particles per parallel task at least.
    const GRAIN: usize = 1024;
    if !volume.is_lit() {
        return;
    }
    let light_one = |particle: &mut ClassifiedParticle| {
        let view = &views[particle.view as usize];
        let (i, offset) = volume.place(view.block, particle.local);
        let from_eye = Vec3::from(view.origin_camera) + rotation * offset;
        let to_eye = if lighting.orthographic != 0 {
            -Vec3::Z
        } else {
            -from_eye.normalize_or_zero()
        };
        let (normal, sides) = match (&volume.particles, &volume.normals) {
            (BlockedParticles::Surfels { tangents, .. }, codes) => {
                let [ax, ay, az, bx, by, bz] = tangents[i];
                let (a, b) = (Vec3::new(ax, ay, az), Vec3::new(bx, by, bz));
                let plane = unit_normal(rotation * a, rotation * b).unwrap_or(Vec3::ZERO);
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
        let colour = particle.carried.colour();
        particle.carried = Carried::of_colour(lit(lighting, sides, colour, normal, to_eye));
    };
    classified
        .par_iter_mut()
        .with_min_len(GRAIN)
        .for_each(light_one);
}

/// The least cosine between a smooth normal and the direction to the eye: beyond a silhouette's bend it would face
/// away, and light would fall on it from the other side.
const LEAST_FACING: f32 = 0.01;

/// The normal by which a surfel reflects whose surface is smoother than its plane, on the eye's side of the plane;
/// zero where none is stored, and the surfel stays unlit.
///
/// - `plane`, `stored`, `to_eye`: camera space, unit length; the first two zero for none.
#[inline]
fn smooth_normal(plane: Vec3, stored: Vec3, to_eye: Vec3) -> Vec3 {
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

/// From which side light falls on what a normal stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sides {
    /// From either: the gradient of a field has no outside.
    Both,
    /// From the side that the eye is on: a surface.
    Facing,
}

/// The colour of a particle under `lighting`, as [`Lighting`](crate::scene::Lighting) has it;
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
    for light in &lighting.lights[..lighting.count as usize] {
        let direction = Vec4::from(light.direction).truncate();
        let diffuse = seen(normal.dot(direction));
        // Behind a surface.
        if !(diffuse > 0.0) {
            continue;
        }
        let halfway = (direction + to_eye).normalize_or_zero();
        let specular = seen(normal.dot(halfway)).min(1.0);
        let light = Vec4::from(light.colour).truncate();
        reflected += light * (lighting.diffuse * diffuse);
        highlight += light * (lighting.specular * specular.powf(lighting.shininess));
    }
    (Vec3::from(colour) * reflected + highlight).into()
}
