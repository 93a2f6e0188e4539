//! Makes surfels of points with normals and radii.

use std::f64::consts::PI;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::math::narrowed;
use crate::sample::left_out::LeftOut;
use crate::sample::mesh::SURFEL_WIDTH;
use crate::sample::report::SampleReport;
use crate::sample::sampled::Sampled;
use crate::scene::{Colour, Particles, PointVolume, Strength};

/// Makes the surfels of an opaque surface from points with normals and radii, as scans have them.
///
/// A point stands for a disc of the surface. If the areas π r² of all discs add up to the area of the surface,
/// the surfels cover it as evenly as the points lie. The standard deviation is [`SURFEL_WIDTH`] times the
/// square root of that area, as for surfels made of meshes ([`mesh::surfels`](crate::sample::mesh::surfels)).
///
/// - `positions`: centres, world units.
/// - `normals`: towards the front, of any length but zero.
/// - `radii`: world units.
/// - `colours`: linear RGB from 0 up, one for each point; empty for white.
///
/// Points that cannot be drawn are left out and counted: those with a number that is not finite, a normal
/// without length, or a radius that is not positive.
///
/// ```
/// use ewa_splat::sample::discs;
/// use glam::DVec3;
///
/// # fn main() -> ewa_splat::Result<()> {
/// let positions: Vec<DVec3> = (0..100).map(|i| DVec3::new((i % 10) as f64, (i / 10) as f64, 0.0)).collect();
/// // One for each unit square.
/// let radius = (1.0 / std::f64::consts::PI).sqrt();
/// let sampled = discs(positions, &[DVec3::Z; 100], &[radius; 100], &[])?;
/// assert_eq!(sampled.volume.particles.len(), 100);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Arrays of different lengths; no point that can be drawn.
pub fn discs(
    positions: impl Into<Vec<DVec3>>,
    normals: &[DVec3],
    radii: &[f64],
    colours: &[[f32; 3]],
) -> Result<Sampled> {
    let positions = positions.into();
    let count = positions.len();
    let fault = |place: &str, expected: String, found: String, advice: &str| {
        Err(Error::invalid("surfels", place, expected, found, advice))
    };
    for (place, length) in [
        ("normals", normals.len()),
        ("radii", radii.len()),
        ("colours", colours.len()),
    ] {
        if length != count && !(place == "colours" && length == 0) {
            let expected = format!("one for each of {count} positions");
            return fault(place, expected, length.to_string(), "give one for each");
        }
    }
    let tangents = |i: usize| -> Result<[f32; 6], LeftOut> {
        if !positions[i].is_finite() {
            return Err(LeftOut::Position);
        }
        let normal = normals[i].try_normalize().ok_or(LeftOut::Rotation)?;
        let sigma = SURFEL_WIDTH * PI.sqrt() * radii[i];
        if !(sigma > 0.0 && sigma.is_finite()) {
            return Err(LeftOut::Size);
        }
        let is_colour = |c: &f32| c.is_finite() && *c >= 0.0;
        if !colours.get(i).is_none_or(|c| c.iter().all(is_colour)) {
            return Err(LeftOut::Colour);
        }
        let (first, second) = normal.any_orthonormal_pair();
        let shape = [first, second].map(|t| (sigma * t).to_array().map(narrowed));
        let area = narrowed(PI * radii[i] * radii[i]);
        if !(area >= f32::MIN_POSITIVE && area.is_finite()) {
            return Err(LeftOut::BeyondSinglePrecision);
        }
        let [[ax, ay, az], [bx, by, bz]] = shape;
        Ok([ax, ay, az, bx, by, bz])
    };
    let mut report = SampleReport {
        sample_count: count,
        ..SampleReport::default()
    };
    let (mut kept, mut shapes, mut faults) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..count {
        match tangents(i) {
            Ok(shape) => {
                kept.push(i);
                shapes.push(shape);
            }
            Err(fault) => faults.push(fault),
        }
    }
    LeftOut::report(&mut report, "surfels", faults.into_iter());
    report.particle_count = kept.len();
    if kept.is_empty() {
        let found = match report.warnings().join(", ") {
            none if none.is_empty() => "none".into(),
            found => found,
        };
        let expected = "at least one that can be drawn".into();
        return fault("points", expected, found, "correct them");
    }
    let areas = kept.iter().map(|&i| narrowed(PI * radii[i] * radii[i]));
    Ok(Sampled {
        volume: PointVolume {
            strength: Strength::Surface(areas.collect()),
            colour: match colours.is_empty() {
                true => Colour::Uniform([1.0; 3]),
                false => Colour::PerParticle(kept.iter().map(|&i| colours[i]).collect()),
            },
            particles: Particles::Surfels {
                positions: kept.iter().map(|&i| positions[i]).collect(),
                tangents: shapes,
                is_one_sided: false,
            },
            values: None,
            transfer_function: None,
            boundary: None,
            normals: None,
            local_models: None,
        },
        report,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Camera;
    use crate::{Renderer, Settings};

    #[test]
    fn discs_face_their_normals_and_cover_their_area() {
        let place = |i: i32| DVec3::new(f64::from(i % 20), f64::from(i / 20), 0.0) / 20.0 - 0.475;
        let positions: Vec<DVec3> = (0..400).map(place).map(|p| p.with_z(0.0)).collect();
        let radius = (1.0 / (400.0 * PI)).sqrt();
        let sampled = discs(positions, &[3.0 * DVec3::Z; 400], &[radius; 400], &[]).unwrap();
        assert!(sampled.volume.validate().is_ok());
        let Particles::Surfels { tangents, .. } = &sampled.volume.particles else {
            panic!("surfels are wanted");
        };
        let [ax, ay, az, bx, by, bz] = tangents[0].map(f64::from);
        let front = DVec3::new(ax, ay, az).cross(DVec3::new(bx, by, bz));
        // 0.6² of the area 1/400.
        assert!((front - DVec3::Z * 0.36 / 400.0).length() < 1e-9, "{front}");
        let camera = Camera::orthographic(2.0 * DVec3::Z, DVec3::ZERO, DVec3::Y, 0.5, [16, 16]);
        let mut renderer = Renderer::new(vec![sampled.volume]).unwrap();
        let image = renderer.render(&camera, &Settings::default()).unwrap();
        for pixel in &image.pixels {
            // Opaque white surfels cover the plane.
            assert!(pixel.iter().all(|c| (c - 1.0).abs() < 1e-3), "{pixel:?}");
        }
    }

    #[test]
    fn what_is_no_disc_is_left_out_and_counted() {
        let at = [DVec3::ZERO, DVec3::NAN, DVec3::X, DVec3::Y, DVec3::Z];
        let normals = [DVec3::Z, DVec3::Z, DVec3::ZERO, DVec3::Z, DVec3::Z];
        let radii = [1.0, 1.0, 1.0, -1.0, 1.0];
        let colours = [[1.0; 3], [1.0; 3], [1.0; 3], [1.0; 3], [f32::NAN; 3]];
        let report = discs(at, &normals, &radii, &colours).unwrap().report;
        assert_eq!((report.particle_count, report.left_out_count()), (1, 4));
        assert!(discs(at, &normals, &radii, &[[f32::NAN; 3]; 5]).is_err());
        assert!(discs(at, &normals[1..], &radii, &[]).is_err());
        assert!(discs([], &[], &[], &[]).is_err());
    }
}
