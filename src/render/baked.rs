//! Bakes light into the colours of particles, for files and viewers that have no lights.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Mat3, Vec3};
use rayon::prelude::*;

use crate::cpu::{Sides, lit, smooth_normal};
use crate::data::splats::constants_of_light;
use crate::error::{Error, Result};
use crate::image::srgb_from_linear;
use crate::math::{harmonics, harmonics_count, normal_of_code};
use crate::record::LightingUniform;
use crate::scene::{Colour, Lighting, Particles, PointVolume};
use crate::splat::unit_normal;
use crate::view::Camera;

/// Degree of the harmonics: with 2, fronts of matt surfaces under a headlight keep their sRGB codes within .02.
const DEGREE: u8 = 2;
/// Number of harmonics of a channel.
const COUNT: usize = 9;
/// Number of directions from which colours are fitted. The highlights of a shininess of 32 are 25 degrees wide; directions are some
/// 16 degrees apart.
const DIRECTIONS: usize = 160;
/// Weight of directions from behind a surfel of one side: some is needed, for a fit with one solution.
const UNSEEN: f64 = 1e-3;
/// Weight of directions from behind a surfel of two sides. Of closed meshes, which may be of two sides as well, only fronts are
/// seen.
const BEHIND: f64 = 0.1;

/// A direction from which particles are seen.
struct Sight {
    /// Direction to the eye, in the world.
    to_eye: Vec3,
    /// Harmonics of the direction from the eye.
    harmonics: [f64; COUNT],
    camera_from_world: Mat3,
    /// Lights in camera space.
    lighting: LightingUniform,
}

/// The normals of a particle, in the world.
struct Normals {
    /// Normal of a surfel's plane, or of a field.
    plane: Vec3,
    /// Normal of a smoother surface, if one is stored.
    stored: Option<Vec3>,
}

/// Replaces the colours of volumes by spherical harmonics of degree 2 that show them lit. Each particle's
/// colour is fitted by least squares to the lit colours, as sRGB codes, from directions all around; surfels mainly from
/// directions in front of them. Particles without a normal keep their colours. Highlights become wider and fainter.
///
/// Volumes without normals, and those with harmonics of their own, stay as they are. Returns false if all do.
///
/// - `up`: direction up of the cameras that lights may be fixed to.
///
/// # Errors
/// The errors of [`Lighting::validate`] and [`PointVolume::validate`].
pub fn bake_light(volumes: &mut [PointVolume], lighting: &Lighting, up: DVec3) -> Result<bool> {
    lighting.validate()?;
    let sights = sights(lighting, up);
    let mut is_lit = false;
    for volume in volumes {
        volume.validate()?;
        if let Some(colour) = lit_colour(volume, &sights) {
            volume.colour = colour;
            is_lit = true;
        }
    }
    Ok(is_lit)
}

/// Returns the harmonics of a lit volume; `None` if it reflects nothing.
fn lit_colour(volume: &PointVolume, sights: &[Sight]) -> Option<Colour> {
    let is_surface = matches!(volume.particles, Particles::Surfels { .. });
    let has_own = matches!(volume.colour, Colour::Harmonics { .. });
    if has_own || !(is_surface || volume.normals.is_some()) {
        return None;
    }
    let of_particle = |i: usize| -> [f32; 3 * COUNT] {
        let colour = volume.linear_colour(i).unwrap_or_default();
        match normals(volume, i) {
            Some(normals) if colour.iter().all(|c| c.is_finite()) => {
                fitted(sights, volume, &normals, colour)
            }
            _ => constant(colour),
        }
    };
    let coefficients = (0..volume.particles.len())
        .into_par_iter()
        .flat_map_iter(of_particle)
        .collect();
    Some(Colour::Harmonics {
        degree: DEGREE,
        coefficients,
        is_linear: false,
    })
}

/// Returns the error of light that no part of a scene reflects.
///
/// - `option`: the option that asks for it.
pub fn nothing_lit(option: &str) -> Error {
    let expected = "surfaces, or volumes with a field";
    let found = "splats or particles without one";
    Error::invalid(option, "inputs", expected, found, "leave it out")
}

/// Returns directions that are spread evenly over the sphere, by a spiral of the golden angle.
fn sights(lighting: &Lighting, up: DVec3) -> Vec<Sight> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let sight = |k: usize| {
        let z = 1.0 - (2 * k + 1) as f64 / DIRECTIONS as f64;
        let (sin, cos) = (golden * k as f64 % TAU).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        let to_eye = DVec3::new(radius * cos, radius * sin, z);
        let camera = Camera::orthographic(to_eye, DVec3::ZERO, up, 1.0, [1, 1]);
        let basis = harmonics(-to_eye.as_vec3());
        Sight {
            to_eye: to_eye.as_vec3(),
            harmonics: std::array::from_fn(|j| f64::from(basis[j])),
            camera_from_world: camera.camera_from_world.as_mat3(),
            lighting: LightingUniform::new(lighting, &camera),
        }
    };
    debug_assert_eq!(COUNT, harmonics_count(DEGREE));
    (0..DIRECTIONS).map(sight).collect()
}

/// Returns the normals of a particle; `None` if it stays unlit.
fn normals(volume: &PointVolume, i: usize) -> Option<Normals> {
    let stored = volume
        .normals
        .as_ref()
        .map(|codes| normal_of_code(codes[i]));
    let Particles::Surfels { tangents, .. } = &volume.particles else {
        let plane = stored.filter(|&normal| normal != Vec3::ZERO)?;
        return Some(Normals {
            plane,
            stored: None,
        });
    };
    let [ax, ay, az, bx, by, bz] = tangents[i];
    let plane = unit_normal(Vec3::new(ax, ay, az), Vec3::new(bx, by, bz))?;
    (stored != Some(Vec3::ZERO)).then_some(Normals { plane, stored })
}

/// Returns coefficients of a colour that is the same from all sides.
fn constant(colour: [f32; 3]) -> [f32; 3 * COUNT] {
    let mut coefficients = [0.0; 3 * COUNT];
    coefficients[..3].copy_from_slice(&constants_of_light(colour));
    coefficients
}

/// Fits harmonics to the lit colours of a particle.
fn fitted(
    sights: &[Sight],
    volume: &PointVolume,
    normals: &Normals,
    colour: [f32; 3],
) -> [f32; 3 * COUNT] {
    let (sides, behind) = match volume.particles {
        Particles::Surfels {
            is_one_sided: true, ..
        } => (Sides::Facing, UNSEEN),
        Particles::Surfels { .. } => (Sides::Facing, BEHIND),
        _ => (Sides::Both, 1.0),
    };
    let mut matrix = [[0.0; COUNT]; COUNT];
    let mut sums = [[0.0; 3]; COUNT];
    for sight in sights {
        let facing = f64::from(normals.plane.dot(sight.to_eye));
        let weight = if facing > 0.0 { 1.0 } else { behind };
        let normal = match normals.stored {
            Some(stored) => smooth_normal(normals.plane, stored, sight.to_eye),
            None => normals.plane,
        };
        let normal = sight.camera_from_world * normal;
        let lit = lit(&sight.lighting, sides, colour, normal, -Vec3::Z);
        let code = lit.map(|c| f64::from(srgb_from_linear(c.clamp(0.0, 1.0))) - 0.5);
        for (j, y) in sight.harmonics.iter().enumerate() {
            let weighted = weight * y;
            for (entry, other) in matrix[j].iter_mut().zip(&sight.harmonics) {
                *entry += weighted * other;
            }
            for (sum, code) in sums[j].iter_mut().zip(code) {
                *sum += weighted * code;
            }
        }
    }
    let solution = solved(matrix, sums);
    let mut coefficients = [0.0; 3 * COUNT];
    for (own, found) in coefficients.iter_mut().zip(solution.as_flattened()) {
        *own = crate::math::narrowed(*found);
    }
    coefficients
}

/// Solves a symmetric, positive definite system for three right-hand sides, by elimination.
fn solved(mut matrix: [[f64; COUNT]; COUNT], mut sides: [[f64; 3]; COUNT]) -> [[f64; 3]; COUNT] {
    for k in 0..COUNT {
        for row in k + 1..COUNT {
            let factor = matrix[row][k] / matrix[k][k];
            let (upper, lower) = matrix.split_at_mut(row);
            for (entry, above) in lower[0][k..].iter_mut().zip(&upper[k][k..]) {
                *entry -= factor * above;
            }
            let (upper, lower) = sides.split_at_mut(row);
            for (entry, above) in lower[0].iter_mut().zip(&upper[k]) {
                *entry -= factor * above;
            }
        }
    }
    for k in (0..COUNT).rev() {
        let (own, known) = sides[k..].split_at_mut(1);
        for (factor, below) in matrix[k][k + 1..].iter().zip(known) {
            for (entry, known) in own[0].iter_mut().zip(below) {
                *entry -= factor * *known;
            }
        }
        own[0] = own[0].map(|entry| entry / matrix[k][k]);
    }
    sides
}

#[cfg(test)]
mod tests {
    use std::slice;

    use super::*;
    use crate::math::harmonics_sum;
    use crate::scene::{Light, LightFrame};

    /// Returns a white surfel in the plane z = 0, lit from `lights`.
    fn baked(is_one_sided: bool, lights: Vec<Light>, specular: f32) -> Vec<f32> {
        let lighting = Lighting {
            lights,
            specular,
            ..Lighting::default()
        };
        let mut volume = PointVolume {
            particles: Particles::Surfels {
                positions: vec![DVec3::ZERO],
                tangents: vec![[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]],
                is_one_sided,
            },
            ..PointVolume::spheres([DVec3::ZERO], [1.0]).with_masses([1.0])
        };
        volume.strength = crate::scene::Strength::Surface(vec![1.0]);
        volume.colour = Colour::Uniform([1.0; 3]);
        assert!(bake_light(slice::from_mut(&mut volume), &lighting, DVec3::Y).unwrap());
        match volume.colour {
            Colour::Harmonics { coefficients, .. } => coefficients,
            _ => panic!("no harmonics"),
        }
    }

    fn light(direction: DVec3, frame: LightFrame) -> Vec<Light> {
        vec![Light {
            direction,
            frame,
            colour: [1.0; 3],
        }]
    }

    /// Returns the code seen from a direction to the eye.
    fn seen(coefficients: &[f32], to_eye: Vec3) -> f32 {
        harmonics_sum(coefficients, &harmonics(-to_eye.normalize()))[0]
    }

    #[test]
    fn a_surface_of_one_side_keeps_the_light_of_the_world() {
        // A surface that faces the light halfway: ambient .25 and .65 times the cosine.
        let direction = DVec3::new(1.0, 0.0, 1.0);
        let coefficients = baked(true, light(direction, LightFrame::World), 0.0);
        let truth = srgb_from_linear(0.25 + 0.65 * 0.5_f32.sqrt());
        for to_eye in [Vec3::Z, Vec3::new(1.0, 2.0, 1.0), Vec3::new(-3.0, 0.0, 1.0)] {
            let code = seen(&coefficients, to_eye);
            assert!((code - truth).abs() < 0.02, "{code} {truth}");
        }
    }

    #[test]
    fn a_headlight_dims_what_turns_away() {
        for is_one_sided in [true, false] {
            let headlight = light(DVec3::NEG_Z, LightFrame::Camera);
            let coefficients = baked(is_one_sided, headlight, 0.0);
            for degrees in [0.0_f32, 20.0, 40.0, 60.0, 75.0] {
                let (sin, cos) = degrees.to_radians().sin_cos();
                let code = seen(&coefficients, Vec3::new(sin, 0.0, cos));
                let truth = srgb_from_linear(0.25 + 0.65 * cos);
                // Harmonics of degree 2 round the edge between two sides.
                let most = if is_one_sided { 0.02 } else { 0.08 };
                assert!((code - truth).abs() < most, "{degrees}: {code} {truth}");
            }
        }
    }

    #[test]
    fn particles_without_a_normal_keep_their_colours() {
        let mut volume = PointVolume::spheres([DVec3::ZERO], [1.0]).with_masses([1.0]);
        let before = volume.colour.clone();
        assert!(!bake_light(slice::from_mut(&mut volume), &Lighting::default(), DVec3::Z).unwrap());
        assert_eq!(volume.colour, before);
    }
}
