//! Makes iso-surfaces of volumes: one disc per kernel, on which the field has the iso-value.
//!
//! An iso-surface is the limit of classification over kernels' extents for an opaque lobe of zero width, the
//! far end of [`flatten`](crate::math::flatten). Over a kernel of variance V and volume v at x_i, the field is
//! f + g . (x - x_i), and the spread of its values is w = sqrt(gᵀ V g). The iso-value lies t = (value - f) / w
//! deviations from the value at the kernel's centre. The disc lies at x_i + t V g / w, perpendicular to g, with
//! the kernel's variance in that plane. Its area is v |g| phi(t) / w. The areas of all discs add up to that of
//! the surface (the coarea formula), however steep the field and whatever the grid.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Hint, Parameter, Result};
use crate::math::{narrowed, tangents_of};
use crate::scene::{
    LocalModels, Particles, PointVolume, Strength, TransferFunction, ValueScale, Values,
};
use crate::task::{Stage, Task};

/// Cut-off: kernels whose centre is farther from the surface, in deviations of the field's values, have no
/// disc. That loses a 1,200th of the surface's area; [`COMPLETE`] scales the others to make up for it.
const REACH: f64 = 3.34;
const COMPLETE: f64 = 1.0 / 0.999_162;

/// A disc of the surface.
struct Disc {
    position: DVec3,
    tangents: [f32; 6],
    area: f32,
}

/// The field over a kernel of variance L Lᵀ.
struct Over {
    /// Lᵀ g \[value units\].
    slope: DVec3,
    /// Iso-value minus the field at the kernel's centre, in deviations of the field's values over the kernel.
    away: f64,
}

/// Makes the opaque iso-surface of a value of a classified volume, in the colour that the transfer function has
/// there.
///
/// # Errors
/// A volume that no field classifies, or without models of the field over its kernels; a value that the field
/// does not take.
pub(in crate::sample) fn iso_surface(
    volume: &PointVolume,
    wanted: f64,
    task: Option<&Task>,
) -> Result<PointVolume> {
    let refuse = |expected: &str, found: &str| {
        Err(Error::invalid(
            Parameter::Flatten,
            "data",
            expected,
            found,
            Hint::LeaveOut(Parameter::Flatten),
        ))
    };
    let (Strength::Classified { volumes }, Some(values), Some(transfer)) =
        (&volume.strength, &volume.values, &volume.transfer_function)
    else {
        return refuse("a field", "strengths of their own");
    };
    let [lo, hi] = values.finite_range().unwrap_or([0.0; 2]);
    let absent = |expected: String| {
        let found = wanted.to_string();
        Err(Error::invalid(
            Parameter::Flatten,
            "value",
            expected,
            found,
            "name another",
        ))
    };
    let scale = transfer.value_scale();
    let value = place_of(transfer, wanted);
    // Phrased so that NaN is refused.
    if !(lo <= value && value <= hi) {
        let ends = [lo, hi].map(|end| scale.value(narrowed(end)));
        let [lo, hi] = ends.map(|end| match scale {
            ValueScale::Shifted { .. } => end.to_string(),
            _ => narrowed(end).to_string(),
        });
        return absent(format!("one that the field has, from {lo} to {hi}"));
    }
    let particles = &volume.particles;
    let found = |i: usize| {
        let over = match (particles, &volume.local_models) {
            (
                Particles::Lattice {
                    lattice,
                    kernel_width,
                },
                _,
            ) => over_lattice(lattice.dims, *kernel_width, values, i, value)?,
            (_, Some(models)) => over_point(models, values, i, value)?,
            (_, None) => return None,
        };
        let (position, factor, cell) = particles.shape(i);
        let volume = volumes.get(i).map_or(cell, |&volume| f64::from(volume));
        disc(position, factor, volume, &over)
    };
    let stage = Stage::new(task, "finding the surface", values.len());
    let discs: Vec<Disc> = (0..values.len())
        .into_par_iter()
        .filter(|i| stage.counts(*i))
        .filter_map(found)
        .collect();
    stage.check()?;
    if discs.is_empty() {
        return absent("one that the field has between samples".into());
    }
    let [red, green, blue, _] = transfer.classify(narrowed(value));
    Ok(PointVolume::new(
        Particles::Surfels {
            positions: discs.iter().map(|disc| disc.position).collect(),
            tangents: discs.iter().map(|disc| disc.tangents).collect(),
            is_one_sided: false,
        },
        Strength::Surface(discs.iter().map(|disc| disc.area).collect()),
    )
    .with_colour([red, green, blue]))
}

/// Returns the number by which a volume of a transfer function stores a value.
pub(in crate::sample) fn place_of(transfer: &TransferFunction, value: f64) -> f64 {
    let scale = transfer.value_scale();
    match scale {
        ValueScale::Linear => value,
        _ => f64::from(scale.position(value)),
    }
}

/// - `volume`: volume of the kernel's cell.
fn disc(position: DVec3, factor: DMat3, volume: f64, over: &Over) -> Option<Disc> {
    let Over { slope, away } = *over;
    let spread = slope.length();
    // Phrased so that NaN and a constant field have no disc.
    if !(spread > 0.0 && away.abs() <= REACH) {
        return None;
    }
    let gradient = factor.inverse().transpose() * slope;
    let steepness = gradient.length();
    // The front faces lower values.
    let [a, b] = tangents_of(factor, -gradient / steepness);
    let tangents = [a.x, a.y, a.z, b.x, b.y, b.z].map(narrowed);
    let position = position + factor * slope * (away / spread);
    let density = (-0.5 * away * away).exp() / TAU.sqrt();
    let area = narrowed(COMPLETE * volume * density * (steepness / spread));
    let is_finite = position.is_finite() && tangents.iter().all(|t| t.is_finite());
    (is_finite && area > 0.0 && area.is_finite()).then_some(Disc {
        position,
        tangents,
        area,
    })
}

/// Returns the field over point `i`; `None` if the neighbours' values all lie on one side of the iso-value.
fn over_point(models: &LocalModels, values: &Values, i: usize, value: f64) -> Option<Over> {
    let model = models.get(i);
    let own = f64::from(values.get(i));
    let (below, above) = (f64::from(model.below), f64::from(model.above));
    // Phrased so that NaN has no disc.
    if !(own - below <= value && value <= own + above) {
        return None;
    }
    let slope = model.slope.as_dvec3();
    Some(Over {
        slope,
        away: (value - own - f64::from(model.departure)) / slope.length(),
    })
}

/// Returns the field over sample `i` of a lattice, from its neighbours, as the renderer computes it. Returns
/// `None` if the values of two rings of neighbours all lie on one side of the iso-value.
fn over_lattice(
    dims: [usize; 3],
    kernel_width: f64,
    values: &Values,
    i: usize,
    value: f64,
) -> Option<Over> {
    const RINGS: usize = 2;
    let [nx, ny, _] = dims;
    let cell = [i % nx, i / nx % ny, i / (nx * ny)];
    let at = |[x, y, z]: [usize; 3]| f64::from(values.get((z * ny + y) * nx + x));
    let own = at(cell);
    if !own.is_finite() {
        return None;
    }
    // Lᵀ g of a lattice is the kernel width times the change from cell to cell.
    let (mut changes, mut towards) = (DVec3::ZERO, DVec3::ZERO);
    for axis in 0..3 {
        let mut neighbour = cell;
        neighbour[axis] = cell[axis].wrapping_sub(1);
        let below = (cell[axis] > 0).then(|| own - at(neighbour));
        neighbour[axis] = cell[axis] + 1;
        let above = (neighbour[axis] < dims[axis]).then(|| at(neighbour) - own);
        let [below, above] = [below, above].map(|change| change.filter(|c| c.is_finite()));
        changes[axis] = match (below, above) {
            (Some(below), Some(above)) => 0.5 * (below + above),
            (one, other) => one.or(other).unwrap_or(0.0),
        };
        // The change on the side of the iso-value: beside a step the field is constant on the other side.
        let is_above = (value - own) * changes[axis] > 0.0;
        let side = if is_above { above } else { below };
        towards[axis] = side.unwrap_or(changes[axis]);
    }
    let spread = kernel_width * towards.length();
    // Most samples end here.
    if !((value - own).abs() <= REACH * spread) {
        return None;
    }
    let around = |axis: usize, n: usize| n.saturating_sub(RINGS)..=(n + RINGS).min(dims[axis] - 1);
    let (mut lowest, mut highest) = (own, own);
    for z in around(2, cell[2]) {
        for y in around(1, cell[1]) {
            for x in around(0, cell[0]) {
                // `min` and `max` ignore a NaN.
                lowest = lowest.min(at([x, y, z]));
                highest = highest.max(at([x, y, z]));
            }
        }
    }
    if !(lowest <= value && value <= highest) {
        return None;
    }
    Some(Over {
        slope: kernel_width * changes,
        away: (value - own) / spread,
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::data::association::Association;
    use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
    use crate::sample::{SampleOptions, grid, scene, volume};
    use crate::scene::{Lattice, LatticeSpacing, TransferDefaults, TransferFunction};

    const RADIUS: f64 = 0.7;

    /// The distance from a point, sampled on a sheared lattice.
    fn ball() -> (PointVolume, DVec3) {
        let step = DMat3::from_cols(
            DVec3::new(0.1, 0.0, 0.0),
            DVec3::new(0.03, 0.12, 0.0),
            DVec3::new(0.0, 0.02, 0.09),
        );
        let lattice = Lattice {
            dims: [26, 22, 24],
            spacing: LatticeSpacing::Uniform {
                origin: DVec3::splat(-1.0),
                step,
            },
        };
        let centre = lattice.position([13, 11, 12]);
        let cells = (0..lattice.len()).map(|i| [i % 26, i / 26 % 22, i / 572]);
        let values = cells.map(|cell| narrowed((lattice.position(cell) - centre).length()));
        let values: Vec<f32> = values.collect();
        let defaults = TransferDefaults {
            range: [0.0, 2.0],
            unit_distance: 1.0,
        };
        let viridis = TransferFunction::named("viridis", &defaults).unwrap();
        let volume = PointVolume::lattice(lattice, values, viridis);
        (volume, centre)
    }

    /// Nodes of a warped grid around the origin, and their distances from it.
    fn warped() -> (Vec<DVec3>, Vec<f32>) {
        let at = |i: usize| (i as f64 - 12.0) / 12.0;
        let node = |n: usize| {
            let p = DVec3::new(at(n % 25), at(n / 25 % 25), at(n / 625));
            p + 0.05 * DVec3::new((3.0 * p.y).sin(), (3.0 * p.z).sin(), (2.0 * p.x).cos())
        };
        let nodes: Vec<DVec3> = (0..15_625).map(node).collect();
        let values = nodes.iter().map(|p| narrowed(p.length())).collect();
        (nodes, values)
    }

    /// Returns the area, the distance of the discs from the sphere (root mean square by area), and the cosine
    /// of the worst angle.
    fn measured(surface: &PointVolume, centre: DVec3) -> [f64; 3] {
        surface.validate().unwrap();
        let (
            Particles::Surfels {
                positions,
                tangents,
                ..
            },
            Strength::Surface(areas),
        ) = (&surface.particles, &surface.strength)
        else {
            panic!("surfels expected");
        };
        let [mut area, mut squares, mut worst] = [0.0, 0.0, 1.0_f64];
        for ((position, tangents), own) in positions.iter().zip(tangents).zip(areas) {
            let own = f64::from(*own);
            let out = *position - centre;
            area += own;
            squares += own * (out.length() - RADIUS).powi(2);
            let [a, b] =
                [0, 3].map(|i| DVec3::from_array([0, 1, 2].map(|k| tangents[i + k].into())));
            // Values grow outwards, so the front faces inwards.
            let facing = -a.cross(b).normalize().dot(out.normalize());
            if own > 1e-5 {
                worst = worst.min(facing);
            }
        }
        [area, (squares / area).sqrt(), worst]
    }

    #[test]
    fn discs_are_the_surface() {
        let sphere = 4.0 * PI * RADIUS * RADIUS;
        let (lattice, centre) = ball();
        let (nodes, values) = warped();
        let options = SampleOptions::default();
        let curvilinear = grid([25; 3], nodes.clone(), values.clone(), &options).unwrap();
        let table = Dataset::new(
            std::path::Path::new("table"),
            "points",
            Geometry::Points { positions: nodes },
            vec![Field {
                name: "distance".into(),
                association: Association::Nodes,
                source: FieldSource::Scalar(Values::F32(values)),
                unit: None,
            }],
        );
        let by_field = SampleOptions {
            field: Some("distance".into()),
            ..options
        };
        let particles = volume(table, &by_field).unwrap();
        for (name, volume, centre, [area_off, off, facing]) in [
            // The field bends by 1/R over .06: the sum of flat discs is a thousandth larger, each disc lies up
            // to .06² / 2R = .003 inside or out, and central differences turn by 1e-3.
            ("lattice", &lattice, centre, [0.01, 0.004, 0.99]),
            // Warped cells have slightly uneven volumes.
            (
                "grid",
                &curvilinear.volume,
                DVec3::ZERO,
                [0.02, 0.004, 0.99],
            ),
            // The volumes come from neighbours' distances.
            (
                "particles",
                &particles.volume,
                DVec3::ZERO,
                [0.1, 0.01, 0.95],
            ),
        ] {
            let surface = iso_surface(volume, RADIUS, None).unwrap();
            let [area, strays, worst] = measured(&surface, centre);
            println!(
                "{name}: {} discs, {:.4} of the area, {strays:.5} off, cosine {worst:.4}",
                surface.particles.len(),
                area / sphere
            );
            assert!(
                (area / sphere - 1.0).abs() < area_off,
                "{name}: {area}, not {sphere}"
            );
            assert!(strays < off && worst > facing, "{name}: {strays} {worst}");
        }
    }

    #[test]
    fn a_steep_step_is_one_surface() {
        // A step from 0 to 200 between two samples: the discs' areas still sum to the plane's.
        let lattice = Lattice::uniform([9, 9, 12], DVec3::ZERO, DVec3::ONE);
        let values = (0..lattice.len()).map(|i| if i / 81 < 6 { 0 } else { 200 });
        let (ball, _) = ball();
        let volume = PointVolume {
            particles: Particles::Lattice {
                lattice,
                kernel_width: 0.6,
            },
            values: Some(Values::U8(values.collect())),
            ..ball
        };
        let surface = iso_surface(&volume, 100.0, None).unwrap();
        let Strength::Surface(areas) = &surface.strength else {
            panic!("a surface expected");
        };
        let area: f64 = areas.iter().copied().map(f64::from).sum();
        // The linear models of the two layers beside the step reach it: 2 / (sqrt(2 pi) .6) exp(-(5/6)²/2) =
        // .94.
        assert!((0.8..1.1).contains(&(area / 81.0)), "{area}");
        let Particles::Surfels { positions, .. } = &surface.particles else {
            panic!("surfels expected");
        };
        assert!(positions.iter().all(|p| (p.z - 5.5).abs() < 0.7));
    }

    #[test]
    fn what_has_no_such_value_is_refused() {
        let (volume, _) = ball();
        for value in [-0.1, 99.0, f64::NAN] {
            let error = iso_surface(&volume, value, None).unwrap_err().to_string();
            assert!(error.contains("one that the field has, from 0"), "{error}");
        }
        let constant = PointVolume {
            values: Some(Values::U8(vec![7; 26 * 22 * 24])),
            ..volume.clone()
        };
        let error = iso_surface(&constant, 7.0, None).unwrap_err().to_string();
        assert!(error.contains("between samples"), "{error}");
        let surface = iso_surface(&volume, 0.5, None).unwrap();
        assert!(iso_surface(&surface, 0.5, None).is_err());
        // The same through the public function.
        let geometry = Geometry::Points {
            positions: warped().0,
        };
        let bare = Dataset::new(std::path::Path::new("bare"), "points", geometry, Vec::new());
        let options = SampleOptions {
            flatten: Some(0.5),
            ..SampleOptions::default()
        };
        let scene = scene(bare, &options);
        assert!(scene.is_err() || scene.is_ok_and(|scene| scene.volumes[0].values.is_none()));
    }
}
