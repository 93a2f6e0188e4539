//! Iso-surfaces within a volume: kernels through which one passes become surfels of it.

use glam::DVec3;
use rayon::prelude::*;

use super::narrowed;
use crate::error::{Error, Hint, Parameter, Result};
use crate::math::tangents_of;
use crate::scene::{Lattice, Particles, PointVolume, Strength, Values};
use crate::task::{Stage, Task};

/// A gradient counts as strong from this share of the values' range per cell on: below it the
/// direction is noise.
const STRONG: f64 = 0.02;

/// Takes the samples of a lattice through whose cells the iso-surface of `value` passes out of the
/// volume and returns them as surfels: the end of the continuum of
/// [`flatten`](crate::math::flatten), each kernel flattened without end along its gradient and moved
/// along it onto the surface (linear interpolation of the field). `None` where there are none.
///
/// A surfel keeps its sample's cell volume and has the surface's own value, so that a transfer
/// function that shows the value shows the surface: as an absorbing sheet of the optical depth that a
/// layer of cells has.
///
/// # Errors
/// A volume that is no classified lattice.
pub(super) fn take_surface(
    volume: &mut PointVolume,
    value: f64,
    task: Option<&Task>,
) -> Result<Option<PointVolume>> {
    let refuse = |found: &str| {
        Err(Error::invalid(
            Parameter::Flatten,
            "data",
            "a regular or rectilinear grid with a field",
            found,
            Hint::LeaveOut(Parameter::Flatten),
        ))
    };
    let (
        Particles::Lattice {
            lattice,
            kernel_width,
        },
        Strength::Classified { .. },
    ) = (&volume.particles, &volume.strength)
    else {
        return refuse("other data");
    };
    let Some(values) = &volume.values else {
        return refuse("no field");
    };
    let [lo, hi] = values.finite_range().unwrap_or([0.0; 2]).map(f64::from);
    let least = STRONG * (hi - lo);
    let [nx, ny, _] = lattice.dims;
    let on_surface = |i: usize| {
        let cell = [i % nx, i / nx % ny, i / (nx * ny)];
        let own = f64::from(values.get(i));
        let per_cell = gradient(lattice, values, cell);
        let reach = per_cell.abs().element_sum();
        // Phrased so that NaN is not on it.
        if !(reach >= least && reach > 0.0 && (own - value).abs() <= 0.5 * reach) {
            return None;
        }
        let step = lattice.step(cell);
        let gradient = step.inverse().transpose() * per_cell;
        let squared = gradient.length_squared();
        let position = lattice.position(cell) - gradient * ((own - value) / squared);
        // The front faces lower values.
        let direction = -gradient / squared.sqrt();
        let [a, b] = tangents_of(step * *kernel_width, direction);
        let tangents = [a.x, a.y, a.z, b.x, b.y, b.z].map(narrowed);
        let is_finite = position.is_finite() && tangents.iter().all(|t| t.is_finite());
        let extent = narrowed(step.determinant().abs());
        is_finite.then_some((i, position, tangents, extent))
    };
    let stage = Stage::new(task, "finding the surface", lattice.len());
    let found: Vec<_> = (0..lattice.len())
        .into_par_iter()
        .filter(|i| stage.counts(*i))
        .filter_map(on_surface)
        .collect();
    stage.check()?;
    if found.is_empty() {
        return Ok(None);
    }
    // What is no number is transparent.
    let mut rest: Vec<f32> = (0..values.len()).map(|i| values.get(i)).collect();
    let mut positions = Vec::with_capacity(found.len());
    let mut tangents = Vec::with_capacity(found.len());
    let mut volumes = Vec::with_capacity(found.len());
    for (i, position, tangent, extent) in found {
        rest[i] = f32::NAN;
        positions.push(position);
        tangents.push(tangent);
        volumes.push(extent);
    }
    let count = positions.len();
    let surface = PointVolume {
        particles: Particles::Surfels {
            positions,
            tangents,
            is_one_sided: false,
        },
        strength: Strength::Classified { volumes },
        colour: volume.colour.clone(),
        values: Some(Values::F32(vec![narrowed(value); count])),
        transfer_function: volume.transfer_function.clone(),
        boundary: None,
        normals: None,
        local_models: None,
    };
    volume.values = Some(Values::F32(rest));
    Ok(Some(surface))
}

/// The change of the field from one cell to the next along each index: central differences, one-sided
/// at the border, NaN where a neighbour is.
fn gradient(lattice: &Lattice, values: &Values, cell: [usize; 3]) -> DVec3 {
    let [nx, ny, _] = lattice.dims;
    let at = |[i, j, k]: [usize; 3]| f64::from(values.get((k * ny + j) * nx + i));
    DVec3::from([0, 1, 2].map(|axis| {
        let (mut below, mut above) = (cell, cell);
        below[axis] = cell[axis].saturating_sub(1);
        above[axis] = (cell[axis] + 1).min(lattice.dims[axis] - 1);
        let steps = above[axis] - below[axis];
        if steps == 0 {
            return 0.0;
        }
        (at(above) - at(below)) / steps as f64
    }))
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::scene::{Colour, TransferDefaults, TransferFunction};

    /// The distance from a point, sampled on a sheared lattice.
    fn ball(step: DMat3) -> (PointVolume, DVec3) {
        let dims = [24, 20, 22];
        let lattice = Lattice {
            dims,
            spacing: crate::scene::LatticeSpacing::Uniform {
                origin: DVec3::splat(-1.0),
                step,
            },
        };
        let centre = lattice.position([12, 10, 11]);
        let values = (0..lattice.len()).map(|i| {
            let cell = [i % 24, i / 24 % 20, i / 480];
            narrowed((lattice.position(cell) - centre).length())
        });
        let values = Values::F32(values.collect());
        let defaults = TransferDefaults {
            range: [0.0, 2.0],
            unit_distance: 1.0,
        };
        let volume = PointVolume {
            particles: Particles::Lattice {
                lattice,
                kernel_width: 0.6,
            },
            strength: Strength::Classified {
                volumes: Vec::new(),
            },
            colour: Colour::Classified,
            values: Some(values),
            transfer_function: TransferFunction::named("viridis", &defaults).ok(),
            boundary: None,
            normals: None,
            local_models: None,
        };
        (volume, centre)
    }

    #[test]
    fn surfels_lie_on_the_surface_and_along_it() {
        let sheared = DMat3::from_cols(
            DVec3::new(0.1, 0.0, 0.0),
            DVec3::new(0.03, 0.12, 0.0),
            DVec3::new(0.0, 0.02, 0.09),
        );
        let (mut volume, centre) = ball(sheared);
        let radius = 0.7;
        let surface = take_surface(&mut volume, radius, None).unwrap().unwrap();
        surface.validate().unwrap();
        volume.validate().unwrap();
        let Particles::Surfels {
            positions,
            tangents,
            ..
        } = &surface.particles
        else {
            panic!("surfels expected");
        };
        assert!(positions.len() > 500);
        for (position, tangents) in positions.iter().zip(tangents) {
            let outward = (*position - centre).normalize();
            // Second order of the field over half a cell of .1: .1² / (8 x .7), and of central
            // differences.
            let off = (*position - centre).length() - radius;
            assert!(off.abs() < 0.01, "{off}");
            let [a, b] = [0, 3].map(|i| {
                DVec3::new(
                    f64::from(tangents[i]),
                    f64::from(tangents[i + 1]),
                    f64::from(tangents[i + 2]),
                )
            });
            // Values grow outwards: the front faces inwards.
            assert!(a.cross(b).normalize().dot(outward) < -0.98);
        }
        // What became a surfel is no kernel any more.
        let left = volume.values.unwrap();
        let gone = (0..left.len()).filter(|&i| left.get(i).is_nan()).count();
        assert_eq!(gone, positions.len());
    }

    #[test]
    fn volumes_add_up_and_other_data_are_refused() {
        let (mut volume, _) = ball(DMat3::from_diagonal(DVec3::splat(0.1)));
        assert!(take_surface(&mut volume, 99.0, None).unwrap().is_none());
        let surface = take_surface(&mut volume, 0.5, None).unwrap().unwrap();
        let Strength::Classified { volumes } = &surface.strength else {
            panic!("classified surfels expected");
        };
        assert!(volumes.iter().all(|v| (v - 1e-3).abs() < 1e-9));
        // The surface's area 4 pi r², a cell's share of it between .1² and sqrt(3) times less.
        let layer = 4.0 * std::f64::consts::PI * 0.25 / 0.01;
        let count = volumes.len() as f64;
        assert!(count > layer && count < 1.8 * layer, "{count} for {layer}");
        assert!(take_surface(&mut surface.clone(), 0.5, None).is_err());
    }
}
