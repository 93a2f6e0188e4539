//! Tests particles: the meaning of their lengths, and the shapes of particles without lengths.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "helpers of tests fail by panicking, as tests do; columns are f32"
)]

use std::path::Path;

use crate::common::{Random, scalar};
use ewa_splat::io::{
    Association, Dataset, Field, FieldSource, Geometry, LengthMeaning, Smoothing, SphKernel,
};
use ewa_splat::sample::{
    KernelOptions, ParticleShape, PurposeOptions, SampleOptions, Sampled, volume,
};
use ewa_splat::scene::{Colour, Particles, Strength, Values};
use glam::{DMat3, DVec3};

fn column(name: &str, values: Vec<f32>) -> Field {
    scalar(name, Association::Nodes, values)
}

fn dataset(positions: Vec<DVec3>, columns: Vec<Field>) -> Dataset {
    let geometry = Geometry::Points { positions };
    Dataset::new(Path::new("test"), "test", geometry, columns)
}

fn sample(dataset: Dataset, options: SampleOptions) -> Sampled {
    volume(dataset, &options).unwrap()
}

fn sigmas(sampled: &Sampled) -> &[f32] {
    match &sampled.volume.particles {
        Particles::Isotropic { sigmas, .. } => sigmas,
        other => panic!("spheres expected, found {other:?}"),
    }
}

/// Returns the factors as matrices.
fn factors(sampled: &Sampled) -> Vec<DMat3> {
    let Particles::Anisotropic { factors, .. } = &sampled.volume.particles else {
        panic!("ellipsoids expected")
    };
    let matrix = |l: &[f32; 6]| {
        let [a, b, c, d, e, f] = l.map(f64::from);
        DMat3::from_cols(
            DVec3::new(a, b, d),
            DVec3::new(0.0, c, e),
            DVec3::new(0.0, 0.0, f),
        )
    };
    factors.iter().map(matrix).collect()
}

fn cube(n: usize) -> Vec<DVec3> {
    (0..n * n * n)
        .map(|i| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / (n * n)) as f64))
        .collect()
}

#[test]
fn lengths_mean_what_is_stated() {
    let points = || cube(2);
    let lengths = |name: &str| vec![column(name, vec![0.5; 8]), column("m", vec![1.0; 8])];
    let with = |name: &str, options: SampleOptions| {
        let sampled = sample(dataset(points(), lengths(name)), options);
        f64::from(sigmas(&sampled)[3])
    };
    let is = |sigma: f64, expected: f64| assert!((sigma / expected - 1.0).abs() < 1e-6, "{sigma}");
    let default = SampleOptions::default;
    // Cubic spline: variance .3 h², support 2 h.
    is(with("h", default()), 0.5 * 0.3_f64.sqrt());
    is(with("sigma", default()), 0.5);
    is(with("radius", default()), 0.5);
    let meaning = |length| SampleOptions {
        kernels: KernelOptions {
            length: Some(length),
            ..default().kernels
        },
        ..default()
    };
    is(
        with("h", meaning(LengthMeaning::Support)),
        0.25 * 0.3_f64.sqrt(),
    );
    is(with("h", meaning(LengthMeaning::Sigma)), 0.5);
    is(
        with("radius", meaning(LengthMeaning::Fwhm)),
        0.5 / (8.0 * 2.0_f64.ln()).sqrt(),
    );
    let quintic = SampleOptions {
        kernels: KernelOptions {
            smoothing: Some(SphKernel::QuinticSpline),
            ..default().kernels
        },
        ..default()
    };
    is(with("h", quintic), 0.5 * (7.0_f64 / 15.0).sqrt());
    // One length replaces all columns; the width scales everything.
    let given = SampleOptions {
        kernels: KernelOptions {
            radius: Some(2.0),
            ..default().kernels
        },
        ..default()
    };
    is(with("h", given), 2.0);
    let wide = SampleOptions {
        kernels: KernelOptions {
            width: 1.2,
            ..default().kernels
        },
        ..default()
    };
    is(with("sigma", wide), 1.0);

    // The format names its fields and its kernel.
    let mut snapshot = dataset(
        points(),
        vec![
            column("Lengths", vec![0.5; 8]),
            column("Masses", vec![3.0; 8]),
            column("Densities", vec![6.0; 8]),
        ],
    );
    snapshot.smoothing = Some(Smoothing {
        length: Some("Lengths".into()),
        meaning: LengthMeaning::Support,
        kernel: SphKernel::WendlandC2,
        mass: Some("Masses".into()),
        density: Some("Densities".into()),
    });
    let sampled = sample(snapshot, default());
    is(f64::from(sigmas(&sampled)[0]), 0.5 / 15.0_f64.sqrt());
    let Strength::Classified { volumes } = &sampled.volume.strength else {
        panic!()
    };
    assert!(volumes.iter().all(|v| (v - 0.5).abs() < 1e-6));
    let lengths = sampled.report.lengths.unwrap();
    assert!(
        lengths.contains("support radius of the Wendland C2"),
        "{lengths}"
    );
}

#[test]
fn radii_over_many_decades_are_kept_and_none_are_left_out() {
    let mut radii: Vec<f32> = (0..64)
        .map(|i| 10_f32.powf(i as f32 / 63.0 * 5.0 - 4.0))
        .collect();
    radii[3] = 0.0;
    radii[5] = -1.0;
    radii[7] = f32::NAN;
    let columns = vec![column("radius", radii), column("one", vec![1.0; 64])];
    let sampled = sample(dataset(cube(4), columns), SampleOptions::default());
    assert_eq!(sampled.volume.particles.len(), 61);
    assert_eq!(
        sampled.report.warnings(),
        ["3 particles left out: size zero, negative or not finite"]
    );
}

/// Returns points spread evenly on the unit sphere.
fn sphere(count: usize) -> Vec<DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / count as f64;
            let r = (1.0 - z * z).sqrt();
            let (sin, cos) = (golden * i as f64).sin_cos();
            DVec3::new(r * cos, r * sin, z)
        })
        .collect()
}

#[test]
fn points_of_a_surface_become_its_discs() {
    let points = sphere(4000);
    let sampled = sample(dataset(points.clone(), vec![]), SampleOptions::default());
    // Each has an area of 4 pi / 4000; the width is .6 of its root.
    let expected = 0.6 * (std::f64::consts::PI / 1000.0).sqrt();
    for (point, l) in points.iter().zip(factors(&sampled)) {
        let along = (l.transpose() * *point).length();
        let tangent = point.any_orthonormal_vector();
        let across = (l.transpose() * tangent).length();
        // The tolerance of a third allows for the neighbourhood's curvature and shape.
        assert!(
            (across / expected - 1.0).abs() < 0.35,
            "{across} {expected}"
        );
        assert!(along < 0.2 * across, "{along} {across}");
    }
    // Points that fill space stay spheres, in layers too; so does a random cloud.
    let mut random = Random::new(3);
    let cloud = (0..4000).map(|_| random.point(1.0)).collect();
    let layers = cube(16)
        .into_iter()
        .map(|p| p * DVec3::new(1.0, 1.0, 4.0))
        .collect();
    for points in [cloud, layers, cube(12)] {
        let sampled = sample(dataset(points, vec![]), SampleOptions::default());
        assert!(!sigmas(&sampled).is_empty());
    }
}

#[test]
fn fluid_kernels_are_flat_along_a_sheet() {
    // Two layers of a lattice of spacing 1, and an isolated drop.
    let mut points: Vec<DVec3> = cube(20).into_iter().filter(|p| p.z < 2.0).collect();
    points.push(DVec3::splat(50.0));
    let count = points.len();
    let columns = || {
        vec![
            column("h", vec![2.0; count]),
            column("rho", vec![1.0; count]),
            column("m", vec![1.0; count]),
            column("one", vec![1.0; count]),
        ]
    };
    let sampled = sample(
        dataset(points.clone(), columns()),
        SampleOptions {
            kernels: KernelOptions {
                shape: ParticleShape::YuTurk,
                ..KernelOptions::default()
            },
            ..SampleOptions::default()
        },
    );
    let factors = factors(&sampled);
    let sigma = 2.0 * 0.3_f64.sqrt();
    let middle = factors[10 + 20 * 10];
    let [x, z] = [DVec3::X, DVec3::Z].map(|axis| (middle.transpose() * axis).length());
    // Widths follow the eigenvalues, but are at least a quarter of the greatest.
    assert!(z < 0.5 * x && z > 0.24 * x, "{x} {z}");
    assert!((middle.determinant().abs() / sigma.powi(3) - 1.0).abs() < 1e-5);
    let drop = factors[count - 1];
    assert!((drop.determinant().abs() / (0.5 * sigma).powi(3) - 1.0).abs() < 1e-5);
}

#[test]
fn columns_of_bare_points_count_them() {
    let mut random = Random::new(4);
    let points: Vec<DVec3> = (0..500).map(|_| random.point(3.0)).collect();
    let columns = SampleOptions {
        purpose: PurposeOptions {
            for_columns: true,
            ..PurposeOptions::default()
        },
        ..SampleOptions::default()
    };
    let sampled = sample(dataset(points, vec![]), columns);
    assert_eq!(sampled.report.field.as_deref(), Some("number density"));
    let Strength::Classified { volumes } = &sampled.volume.strength else {
        panic!()
    };
    let values = sampled.volume.values.unwrap();
    // Two roundings to f32.
    let one = |(i, v): (usize, &f32)| (values.get(i) * v - 1.0).abs() < 3e-7;
    assert!(volumes.iter().enumerate().all(one));
}

#[test]
fn a_far_outlier_loses_only_itself() {
    let mut random = Random::new(6);
    let cloud: Vec<DVec3> = (0..4000).map(|_| random.point(1.0)).collect();
    let alone = sample(dataset(cloud.clone(), vec![]), SampleOptions::default());
    for outlier in [-1e17, 1e17, 1e30, -9.97e36] {
        let mut points = cloud.clone();
        points.push(DVec3::new(outlier, 0.5, outlier));
        let sampled = sample(dataset(points, vec![]), SampleOptions::default());
        // Beyond single precision, the outlier has no size.
        let sizes = sigmas(&sampled);
        assert_eq!(&sizes[..4000], sigmas(&alone), "{outlier}");
    }
}

#[test]
fn lengths_that_reach_everywhere_are_refused() {
    let columns = vec![column("h", vec![1e3; 10_648])];
    let error = volume(dataset(cube(22), columns), &SampleOptions::default()).unwrap_err();
    assert!(
        error.to_string().contains("10648 neighbours each"),
        "{error}"
    );
}

#[test]
fn a_snapshot_goes_by_its_own_names() {
    // A snapshot's `Mass` is not the table column `mass`, and `radius` is no length here.
    let of = |for_columns: bool, field: Option<&str>| {
        let mut snapshot = dataset(
            cube(2),
            vec![
                column("Mass", vec![3.0; 8]),
                column("Density", (0..8_u8).map(|i| 6.0 + f32::from(i)).collect()),
                column("radius", vec![9.0; 8]),
            ],
        );
        snapshot.smoothing = Some(Smoothing {
            length: None,
            meaning: LengthMeaning::Support,
            kernel: SphKernel::CubicSpline,
            mass: Some("Mass".into()),
            density: Some("Density".into()),
        });
        let options = SampleOptions {
            purpose: PurposeOptions {
                for_columns,
                ..PurposeOptions::default()
            },
            field: field.map(str::to_owned),
            ..SampleOptions::default()
        };
        sample(snapshot, options)
    };
    let amounts = |sampled: &Sampled| -> Vec<f32> {
        let Strength::Classified { volumes } = &sampled.volume.strength else {
            panic!()
        };
        let values = sampled.volume.values.as_ref().unwrap();
        volumes
            .iter()
            .enumerate()
            .map(|(i, v)| v * values.get(i))
            .collect()
    };
    for (field, name) in [
        (None, "Density"),
        (Some("Mass"), "density (mass over volume)"),
    ] {
        let sampled = of(true, field);
        assert_eq!(sampled.report.field.as_deref(), Some(name));
        // Density times mass over density gives the masses.
        assert!(amounts(&sampled).iter().all(|m| (m - 3.0).abs() < 1e-5));
    }
    // Without lengths, sizes follow mass over density.
    let sampled = of(false, None);
    for (i, sigma) in (0..8_u8).zip(sigmas(&sampled)) {
        let expected = 0.6 * (3.0 / (6.0 + f64::from(i))).cbrt();
        assert!((f64::from(*sigma) / expected - 1.0).abs() < 1e-6);
    }
}

#[test]
fn a_field_named_for_columns_is_what_is_summed() {
    let columns = || {
        vec![
            column("sigma", vec![1.0; 8]),
            column("mass", vec![5.0; 8]),
            column("volume", vec![2.0; 8]),
            column("T", vec![7.0; 8]),
        ]
    };
    let options = |field: Option<&str>| SampleOptions {
        purpose: PurposeOptions {
            for_columns: true,
            ..PurposeOptions::default()
        },
        field: field.map(str::to_owned),
        ..SampleOptions::default()
    };
    let plain = sample(dataset(cube(2), columns()), options(None));
    assert_eq!(plain.volume.strength, Strength::Mass(vec![5.0; 8]));
    let named = sample(dataset(cube(2), columns()), options(Some("T")));
    assert_eq!(
        named.volume.strength,
        Strength::Classified {
            volumes: vec![2.0; 8]
        }
    );
}

#[test]
fn bytes_of_colour_are_decoded() {
    let mut columns = vec![column("sigma", vec![1.0; 8]), column("mass", vec![1.0; 8])];
    for (name, byte) in [("red", 255), ("green", 0), ("blue", 188)] {
        columns.push(Field {
            name: name.into(),
            association: Association::Nodes,
            source: FieldSource::Scalar(Values::U8(vec![byte; 8])),
            unit: None,
        });
    }
    let sampled = sample(dataset(cube(2), columns), SampleOptions::default());
    let Colour::PerParticle(colours) = &sampled.volume.colour else {
        panic!()
    };
    // 188 of 255 is half of the light.
    let [red, green, blue] = colours[0];
    assert!((red - 1.0).abs() < 1e-6 && green.abs() < 1e-6 && (blue - 0.5).abs() < 5e-3);
}

#[test]
fn optical_masses_beside_densities_are_remarked_on() {
    let columns = |mass: &str| {
        let rho = (0..8_u8).map(f32::from).collect();
        vec![
            column("h", vec![1.0; 8]),
            column(mass, vec![1.0; 8]),
            column("rho", rho),
        ]
    };
    let warnings = |mass: &str| {
        let sampled = sample(dataset(cube(2), columns(mass)), SampleOptions::default());
        sampled.report.warnings().join("; ")
    };
    assert!(warnings("mass").contains("call physical masses `m`"));
    assert!(!warnings("m").contains("physical masses"));
}

/// More rows than one chunk shapes, some of them without a position, a size, a mass or a colour.
#[test]
fn rows_that_are_left_out_take_nothing_of_others_with_them() {
    const COUNT: usize = 150_000;
    // Colours are as bright as linear ones may be.
    let number = |i: usize| ((i % 1013) as f32 + 1.0) / 64.0;
    let broken =
        |of: usize| (0..COUNT).map(move |i| if i % 1009 == of { f32::NAN } else { number(i) });
    let mut positions: Vec<DVec3> = (0..COUNT).map(|i| DVec3::splat(i as f64)).collect();
    for p in positions.iter_mut().skip(1).step_by(1009) {
        p.y = f64::INFINITY;
    }
    let column_of = |name, of| column(name, broken(of).collect());
    let dataset = dataset(
        positions,
        vec![
            column_of("sigma", 2),
            column_of("mass", 3),
            column_of("r", 4),
            column_of("g", 4),
            column_of("b", 5),
        ],
    );
    let sampled = sample(dataset, SampleOptions::default());
    let kept: Vec<usize> = (0..COUNT)
        .filter(|i| !(1..=5).contains(&(i % 1009)))
        .collect();
    assert_eq!(sampled.report.particle_count, kept.len());
    let findings = &sampled.report.findings;
    let left_out = findings.iter().filter(|finding| finding.left_out);
    let left_out: usize = left_out.map(|finding| finding.count).sum();
    assert_eq!(left_out, COUNT - kept.len());
    let Particles::Isotropic { positions, sigmas } = &sampled.volume.particles else {
        panic!("spheres expected")
    };
    let Strength::Mass(masses) = &sampled.volume.strength else {
        panic!("masses expected")
    };
    let Colour::PerParticle(colours) = &sampled.volume.colour else {
        panic!("colours expected")
    };
    let lengths = [positions.len(), sigmas.len(), masses.len(), colours.len()];
    assert_eq!(lengths, [kept.len(); 4]);
    for (n, &i) in kept.iter().enumerate() {
        assert_eq!(positions[n], DVec3::splat(i as f64));
        let expected = number(i).to_bits();
        let all = [
            sigmas[n],
            masses[n],
            colours[n][0],
            colours[n][1],
            colours[n][2],
        ];
        assert!(
            all.iter().all(|x| x.to_bits() == expected),
            "row {i}: {all:?}"
        );
    }
}
