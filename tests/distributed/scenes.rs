//! Makes small scenes that use every feature of a frame.

use ewa_splat::scene::{
    Colour, Lattice, LocalModel, LocalModels, Particles, PointVolume, Strength, TransferFunction,
    Values,
};
use glam::{DVec3, Vec3};

use crate::common::{Random, lower_factor};

pub(crate) fn plain(particles: Particles, strength: Strength, colour: Colour) -> PointVolume {
    PointVolume {
        colour,
        ..PointVolume::new(particles, strength)
    }
}

fn numbers(random: &mut Random, count: usize, low: f64, high: f64) -> Vec<f32> {
    (0..count).map(|_| random.range(low, high) as f32).collect()
}

/// Returns coloured spheres with masses about the origin, in clumps, some around the eye at z = -4.
pub(crate) fn spheres(count: usize) -> PointVolume {
    let mut random = Random::new(7);
    let place = |n: usize, random: &mut Random| match n % 50 {
        0 => DVec3::NEG_Z * 4.0 + random.point(0.05),
        n => {
            DVec3::new((n % 3) as f64, (n % 5) as f64, (n % 2) as f64) * 0.3 - 0.5
                + random.point(0.4)
        }
    };
    let positions = (0..count).map(|n| place(n, &mut random)).collect();
    let sigmas = numbers(&mut random, count, 0.002, 0.03);
    let masses = numbers(&mut random, count, 1e-6, 1e-4);
    // Colours are so similar that they are merged from afar.
    let colours = (0..count).map(|_| [0, 1, 2].map(|_| random.range(0.45, 0.55) as f32));
    let colour = Colour::PerParticle(colours.collect());
    plain(
        Particles::Isotropic { positions, sigmas },
        Strength::Mass(masses),
        colour,
    )
}

/// Returns a transfer function with a narrow lobe, so that kernels are classified over their
/// extents.
pub(crate) fn shells() -> TransferFunction {
    let opacity = |v: f32| {
        if (v - 0.6).abs() < 0.04 {
            0.9
        } else {
            0.02 * v
        }
    };
    TransferFunction::from_curves(|v| [v, 0.5, 1.0 - v], opacity, [0.0, 1.0], 0.1).unwrap()
}

/// Returns ellipsoids that fill the cube from -1 to 1, with values that decrease from the origin,
/// and their local models.
pub(crate) fn ellipsoids(count: usize) -> PointVolume {
    let mut random = Random::new(11);
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(1.0)).collect();
    let factors = (0..count).map(|_| lower_factor(&random.factor(0.05, 4.0)));
    let factors: Vec<[f32; 6]> = factors.collect();
    let value = |p: &DVec3| (1.0 - 0.6 * p.length()) as f32;
    let values: Vec<f32> = positions.iter().map(value).collect();
    let models = positions.iter().zip(&factors).map(|(p, l)| {
        let g = (-0.6 * p.normalize_or_zero()).as_vec3();
        LocalModel {
            slope: Vec3::new(
                l[0] * g.x + l[1] * g.y + l[3] * g.z,
                l[2] * g.y + l[4] * g.z,
                l[5] * g.z,
            ),
            departure: 0.0,
            below: 0.2,
            above: 0.2,
        }
    });
    let models: Vec<LocalModel> = models.collect();
    let share = 8.0 / count as f64;
    PointVolume {
        values: Some(Values::F32(values)),
        transfer_function: Some(shells()),
        local_models: Some(LocalModels::new(&models)),
        ..plain(
            Particles::Anisotropic { positions, factors },
            Strength::Classified {
                volumes: numbers(&mut random, count, 0.5 * share, 1.5 * share),
            },
            Colour::Classified,
        )
    }
}

/// Returns a lattice of bytes about the origin with a boundary.
pub(crate) fn lattice(n: usize) -> PointVolume {
    box_of([n; 3])
}

/// Returns such a lattice with any number of samples along each axis.
pub(crate) fn box_of(dims: [usize; 3]) -> PointVolume {
    let step = DVec3::from(dims.map(|n| 2.0 / (n - 1) as f64));
    let lattice = Lattice::uniform(dims, DVec3::splat(-1.0), step);
    let [x, y, _] = dims;
    let at = |i: usize| {
        let p = lattice.position([i % x, i / x % y, i / (x * y)]);
        (255.0 * (1.0 - 0.6 * p.length()).max(0.0)) as u8
    };
    let values = Values::U8((0..lattice.len()).map(at).collect());
    let opacity = |v: f32| {
        if (v - 0.6).abs() < 0.04 {
            0.9
        } else {
            0.02 * v
        }
    };
    let transfer = TransferFunction::from_curves(|v| [v, 0.5, 1.0 - v], opacity, [0.0, 255.0], 0.1);
    PointVolume {
        values: Some(values),
        transfer_function: Some(transfer.unwrap()),
        boundary: Some(ewa_splat::scene::Boundary::Lattice),
        ..plain(
            Particles::Lattice {
                lattice,
                kernel_width: 0.6,
            },
            Strength::Classified {
                volumes: Vec::new(),
            },
            Colour::Classified,
        )
    }
}

/// Returns opaque surfels of a sphere.
pub(crate) fn ball(count: usize, radius: f64) -> PointVolume {
    let mut random = Random::new(3);
    let (mut positions, mut tangents) = (Vec::new(), Vec::new());
    let side = (4.0 * std::f64::consts::PI * radius * radius / count as f64).sqrt();
    while positions.len() < count {
        let p = random.point(1.0);
        if !(0.1..1.0).contains(&p.length()) {
            continue;
        }
        let n = p.normalize();
        let a = n.any_orthonormal_vector() * 0.7 * side;
        let b = n.cross(a);
        positions.push(n * radius);
        tangents.push([a.x, a.y, a.z, b.x, b.y, b.z].map(|x| x as f32));
    }
    let area = (side * side) as f32;
    plain(
        Particles::Surfels {
            positions,
            tangents,
            is_one_sided: true,
        },
        Strength::Surface(vec![area; count]),
        Colour::Uniform([0.8, 0.5, 0.2]),
    )
}
