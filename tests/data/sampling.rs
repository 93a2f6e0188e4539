//! Tests laws of sampling: volumes add up to the grid's, factors reproduce the Jacobians, nothing
//! depends on the origin, and undrawable samples are counted.
#![allow(
    clippy::cast_possible_truncation,
    reason = "test data narrow to f32 on purpose"
)]

use std::f64::consts::PI;

use std::path::Path;

use crate::common::grid_nodes;
use ewa_splat::Error;
use ewa_splat::error::{Parameter, Place};
use ewa_splat::io::{Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use ewa_splat::sample::{
    FunctionOptions, KernelOptions, PurposeOptions, SampleOptions, Sampled, TransferChoice, volume,
};
use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Particles, ScaleName, Strength, ValueScale, Values,
};
use glam::{DMat3, DVec3};

fn field(name: &str, association: Association, values: Values) -> Field {
    Field {
        name: name.into(),
        association,
        source: FieldSource::Scalar(values),
        unit: None,
    }
}

fn dataset(geometry: Geometry, fields: Vec<Field>) -> Dataset {
    Dataset::new(Path::new("test"), "test", geometry, fields)
}

fn sample(dataset: Dataset) -> Sampled {
    let sampled = volume(dataset, &SampleOptions::default()).expect("samples");
    check(&sampled);
    sampled
}

/// Checks that all arrays have one entry per particle, and that all numbers are usable.
fn check(sampled: &Sampled) {
    let v = &sampled.volume;
    let n = v.particles.len();
    assert_eq!(sampled.report.particle_count, n);
    match &v.strength {
        Strength::Mass(m) | Strength::Surface(m) | Strength::Translucent(m) => {
            assert_eq!(m.len(), n)
        }
        Strength::PeakOpacity { opacities, .. } => assert_eq!(opacities.len(), n),
        Strength::Classified { volumes } => {
            assert!(v.values.is_some() && v.transfer_function.is_some());
            match v.particles {
                Particles::Lattice { .. } => assert!(volumes.is_empty()),
                _ => assert_eq!(volumes.len(), n),
            }
        }
    }
    if let Some(values) = &v.values {
        assert_eq!(values.len(), n);
    }
    if let Colour::PerParticle(colours) = &v.colour {
        assert_eq!(colours.len(), n);
    }
    match &v.particles {
        Particles::Lattice { .. } => {}
        Particles::Isotropic { positions, sigmas } => {
            assert_eq!(positions.len(), n);
            assert!(sigmas.iter().all(|s| *s > 0.0 && s.is_finite()));
        }
        Particles::Anisotropic { positions, factors } => {
            assert_eq!(positions.len(), n);
            assert!(factors.iter().flatten().all(|l| l.is_finite()));
        }
        Particles::Surfels {
            positions,
            tangents,
            ..
        } => {
            assert_eq!(positions.len(), n);
            assert!(tangents.iter().flatten().all(|t| t.is_finite()));
        }
    }
}

/// Makes a curvilinear grid: `at` maps index fractions, each 0..1, to positions.
fn grid(dims: [usize; 3], association: Association, at: impl Fn(DVec3) -> DVec3) -> Dataset {
    let nodes = grid_nodes(dims, at);
    let [ni, nj, nk] = dims;
    let count = match association {
        Association::Nodes => ni * nj * nk,
        Association::Cells => (ni - 1) * (nj - 1) * (nk - 1),
    };
    let values = Values::F32((0..count).map(|i| i as f32).collect());
    dataset(
        Geometry::Curvilinear {
            blocks: vec![CurvilinearBlock { dims, nodes }],
        },
        vec![field("a", association, values)],
    )
}

fn total_volume(sampled: &Sampled) -> f64 {
    match &sampled.volume.strength {
        Strength::Classified { volumes } => volumes.iter().map(|v| f64::from(*v)).sum(),
        _ => panic!("classified volumes expected"),
    }
}

fn anisotropic(sampled: &Sampled) -> (&[DVec3], &[[f32; 6]]) {
    match &sampled.volume.particles {
        Particles::Anisotropic { positions, factors } => (positions, factors),
        other => panic!("anisotropic particles expected, found {other:?}"),
    }
}

fn variance(&[l00, l10, l11, l20, l21, l22]: &[f32; 6]) -> DMat3 {
    let l = DMat3::from_cols(
        DVec3::new(l00.into(), l10.into(), l20.into()),
        DVec3::new(0.0, l11.into(), l21.into()),
        DVec3::new(0.0, 0.0, l22.into()),
    );
    l * l.transpose()
}

fn assert_near(a: DMat3, b: DMat3, tolerance: f64) {
    let gap = (a - b)
        .to_cols_array()
        .iter()
        .fold(0f64, |m, x| m.max(x.abs()));
    assert!(gap <= tolerance, "{a} against {b}: {gap}");
}

// f32 volumes: 2^-24 each; sums of a few hundred stay within 1e-6.
const SUM: f64 = 1e-6;

#[test]
fn volumes_of_box_and_sheared_grid_add_up() {
    let shear = DMat3::from_cols(
        DVec3::new(2.0, 0.5, -0.25),
        DVec3::new(0.0, 3.0, 1.0),
        DVec3::new(1.0, 0.0, -4.0),
    );
    for (matrix, expected) in [(DMat3::IDENTITY, 1.0), (shear, shear.determinant().abs())] {
        for association in [Association::Nodes, Association::Cells] {
            let sampled = sample(grid([5, 7, 4], association, |s| matrix * s));
            assert!((total_volume(&sampled) / expected - 1.0).abs() < SUM);
            assert!(sampled.report.warnings().is_empty(), "{:?}", sampled.report);
        }
    }
}

#[test]
fn boundary_kernels_lie_inside_and_inner_ones_at_their_nodes() {
    let sampled = sample(grid([5, 5, 5], Association::Nodes, |s| s * 4.0));
    let (positions, _) = anisotropic(&sampled);
    // The Gauss points of the two half cells inside cancel; the one at the corner gives .2113.
    assert!(positions[2 + 5 * (2 + 5 * 2)].distance(DVec3::splat(2.0)) < 1e-12);
    assert!(positions[0].distance(DVec3::splat(0.211_324_865)) < 1e-8);
}

#[test]
fn factors_are_those_of_the_jacobian() {
    let matrix = DMat3::from_cols(
        DVec3::new(2.0, 0.5, -0.25),
        DVec3::new(0.0, 3.0, 1.0),
        DVec3::new(1.0, 0.0, 4.0),
    );
    for association in [Association::Nodes, Association::Cells] {
        let sampled = sample(grid([5, 3, 9], association, |s| matrix * s));
        // Column d of F: one step of index d.
        let f = matrix * DMat3::from_diagonal(DVec3::new(0.25, 0.5, 0.125));
        let expected = f * f.transpose() * 0.36;
        let (_, factors) = anisotropic(&sampled);
        for factor in factors {
            assert_near(variance(factor), expected, 1e-6);
        }
    }
}

/// Maps to a ring from radius 1 to 3 and height 2, i around.
fn polar(s: DVec3) -> DVec3 {
    let (angle, radius) = (2.0 * PI * s.x, 1.0 + 2.0 * s.y);
    DVec3::new(radius * angle.cos(), radius * angle.sin(), 2.0 * s.z)
}

#[test]
fn a_polar_o_grid_has_one_seam_and_its_polygon_s_volume() {
    let (ni, nj, nk) = (33, 9, 5);
    // 32 straight sides: the annulus of polygons has the area n/2 sin(2 pi/n) (9 - 1).
    let expected = 16.0 * (2.0 * PI / 32.0).sin() * 8.0 * 2.0;
    let sampled = sample(grid([ni, nj, nk], Association::Nodes, polar));
    assert_eq!(sampled.report.left_out_count(), nj * nk);
    assert_eq!(sampled.volume.particles.len(), (ni - 1) * nj * nk);
    assert!((total_volume(&sampled) / expected - 1.0).abs() < SUM);
    assert!(sampled.report.warnings()[0].contains("45 nodes left out: on a periodic seam"));
    // The seam has no effect: each kernel of a ring is its neighbour rotated.
    let (_, factors) = anisotropic(&sampled);
    let row = (ni - 1) * (4 + nj * 2);
    let trace = |m: DMat3| m.x_axis.x + m.y_axis.y + m.z_axis.z;
    let first = trace(variance(&factors[row]));
    for factor in &factors[row..row + ni - 1] {
        assert!((trace(variance(factor)) / first - 1.0).abs() < 1e-5);
    }
    let cells = sample(grid([ni, nj, nk], Association::Cells, polar));
    assert_eq!(cells.volume.particles.len(), (ni - 1) * (nj - 1) * (nk - 1));
    assert!((total_volume(&cells) / expected - 1.0).abs() < SUM);
}

#[test]
fn a_closed_seam_in_single_precision_is_found_and_an_open_one_is_not() {
    let narrow = |p: DVec3| p.as_vec3().as_dvec3();
    let sampled = sample(grid([65, 5, 5], Association::Nodes, |s| narrow(polar(s))));
    assert_eq!(sampled.report.left_out_count(), 25);
    let open = |s: DVec3| polar(s * DVec3::new(0.98, 1.0, 1.0));
    let sampled = sample(grid([65, 5, 5], Association::Nodes, open));
    assert_eq!(sampled.report.left_out_count(), 0);
}

#[test]
fn kernels_keep_a_uniform_density_uniform() {
    // Density of extinction 1 along a radius of a polar grid, away from its boundary.
    let sampled = sample(grid([49, 13, 13], Association::Nodes, polar));
    let (positions, factors) = anisotropic(&sampled);
    let Strength::Classified { volumes } = &sampled.volume.strength else {
        panic!()
    };
    let mut worst = 0f64;
    for step in 0..20 {
        let x = DVec3::new(
            1.6 + 0.04 * f64::from(step),
            0.05,
            1.0 + 0.003 * f64::from(step),
        );
        let density: f64 = positions
            .iter()
            .zip(factors)
            .zip(volumes)
            .map(|((p, f), &v)| {
                let variance = variance(f);
                let d = x - *p;
                let q = d.dot(variance.inverse() * d);
                let norm = ((2.0 * PI).powi(3) * variance.determinant()).sqrt();
                f64::from(v) * (-0.5 * q).exp() / norm
            })
            .sum();
        worst = worst.max((density - 1.0).abs());
    }
    // Ripple .7 % at width .6, bias -.6 % on polar grids.
    assert!(worst < 0.02, "{worst}");
}

#[test]
fn degenerate_cells_and_bad_nodes_are_counted() {
    // The first layer of k is flat.
    let flat = |s: DVec3| DVec3::new(s.x, s.y, (s.z - 0.25).max(0.0));
    let sampled = sample(grid([4, 4, 5], Association::Nodes, flat));
    let warnings = sampled.report.warnings();
    assert!(warnings[0].starts_with("9 cells: degenerate"));
    assert!(warnings[1].starts_with("9 cells: without volume"));
    assert_eq!(warnings[2], "16 nodes left out: no volume, or inverted");
    assert!((total_volume(&sampled) - 0.75).abs() < SUM);

    // j edges vanish at i = 0: wedges.
    let wedge = |s: DVec3| DVec3::new(s.x, s.x * s.y, s.z);
    let sampled = sample(grid([5, 5, 5], Association::Nodes, wedge));
    assert!((total_volume(&sampled) - 0.5).abs() < SUM);
    assert!(sampled.report.warnings()[0].starts_with("16 cells: degenerate"));
    assert_eq!(sampled.report.left_out_count(), 0);

    let mut bad = grid([5, 5, 5], Association::Nodes, |s| s);
    let Geometry::Curvilinear { blocks } = &mut bad.geometry else {
        panic!()
    };
    let nodes = &mut blocks[0].nodes;
    nodes[62] = DVec3::splat(f64::NAN);
    let FieldSource::Scalar(Values::F32(values)) = &mut bad.fields[0].source else {
        panic!()
    };
    values[0] = f32::NAN;
    let mut blank = vec![1u8; 125];
    blank[124] = 0;
    bad.fields
        .push(field("IBLANK", Association::Nodes, Values::U8(blank)));
    let sampled = sample(bad);
    assert_eq!(
        sampled.report.warnings(),
        [
            "1 nodes left out: position not finite",
            "1 nodes left out: value not finite",
            "1 nodes left out: blanked (iblank 0, or hidden by vtkGhostType)"
        ]
    );
    assert_eq!(
        sampled.volume.values.as_ref().unwrap().get(0).to_bits(),
        1f32.to_bits()
    );
}

#[test]
fn inverted_cells_are_counted_and_left_handed_grids_are_not() {
    let mirrored = sample(grid([4, 4, 4], Association::Nodes, |s| {
        s * DVec3::new(1.0, 1.0, -1.0)
    }));
    assert!(mirrored.report.warnings().is_empty());
    assert!((total_volume(&mirrored) - 1.0).abs() < SUM);
    // The last layer folds back.
    let fold = |s: DVec3| DVec3::new(s.x, s.y, if s.z > 0.9 { 0.7 } else { s.z });
    let folded = sample(grid([4, 4, 5], Association::Nodes, fold));
    assert!(folded.report.warnings()[0].starts_with("9 cells: inverted"));
}

#[test]
fn a_far_origin_changes_nothing() {
    let here = sample(grid([33, 5, 5], Association::Nodes, polar));
    let offset = DVec3::new(1e7, -1e7, 1e7);
    let there = sample(grid([33, 5, 5], Association::Nodes, |s| polar(s) + offset));
    assert_eq!(here.report, there.report);
    let ((p, f), (q, g)) = (anisotropic(&here), anisotropic(&there));
    for i in 0..p.len() {
        // f64 resolves 2e-9 at 1e7.
        assert!((p[i] + offset).distance(q[i]) < 1e-8);
        assert_near(variance(&f[i]), variance(&g[i]), 1e-7);
    }
}

#[test]
fn lattices_stay_lattices_and_values_move() {
    let lattice = Lattice::uniform([5, 4, 3], DVec3::ONE, DVec3::new(1.0, 2.0, 4.0));
    let bytes: Vec<u8> = (0..60).collect();
    let address = bytes.as_ptr();
    let sampled = sample(dataset(
        Geometry::Lattice(lattice.clone()),
        vec![field("v", Association::Nodes, Values::U8(bytes))],
    ));
    assert!((sampled.report.unit_distance - 2.0).abs() < 1e-12);
    let Some(Values::U8(moved)) = &sampled.volume.values else {
        panic!()
    };
    assert_eq!(moved.as_ptr(), address);
    let Particles::Lattice {
        lattice: kept,
        kernel_width,
    } = &sampled.volume.particles
    else {
        panic!()
    };
    assert_eq!(*kept, lattice);
    assert!((kernel_width - 0.6).abs() < 1e-12);
}

#[test]
fn cell_values_become_a_lattice_of_cell_centres() {
    let cells = |n: usize| {
        let values = Values::F32((0..n).map(|i| i as f32).collect());
        vec![field("v", Association::Cells, values)]
    };
    let uniform = Lattice::uniform([3, 4, 1], DVec3::ONE, DVec3::new(1.0, 2.0, 4.0));
    let sampled = sample(dataset(Geometry::Lattice(uniform), cells(6)));
    let Particles::Lattice { lattice, .. } = &sampled.volume.particles else {
        panic!()
    };
    assert_eq!(lattice.dims, [2, 3, 1]);
    assert!(
        lattice
            .position([1, 2, 0])
            .distance(DVec3::new(2.5, 6.0, 1.0))
            < 1e-12
    );

    let rectilinear = Lattice {
        dims: [3, 2, 1],
        spacing: LatticeSpacing::Rectilinear {
            coordinates: [vec![0.0, 1.0, 4.0], vec![0.0, 2.0], vec![5.0]],
        },
    };
    let sampled = sample(dataset(Geometry::Lattice(rectilinear), cells(2)));
    let Particles::Lattice { lattice, .. } = &sampled.volume.particles else {
        panic!()
    };
    assert_eq!(lattice.dims, [2, 1, 1]);
    assert!(
        lattice
            .position([1, 0, 0])
            .distance(DVec3::new(2.5, 1.0, 5.0))
            < 1e-12
    );
}

#[test]
fn nan_on_a_lattice_stays_and_is_counted() {
    let values = Values::F32(vec![0.0, f32::NAN, 1.0, 2.0, 3.0, f32::INFINITY, 4.0, 5.0]);
    let lattice = Lattice::uniform([2, 2, 2], DVec3::ZERO, DVec3::ONE);
    let sampled = sample(dataset(
        Geometry::Lattice(lattice),
        vec![field("v", Association::Nodes, values)],
    ));
    assert_eq!(sampled.volume.particles.len(), 8);
    assert!(sampled.report.warnings()[0].starts_with("2 values: not finite"));
    let t = sampled.volume.transfer_function.unwrap();
    assert!(t.classify(f32::NAN)[3] <= 0.0);
}

#[test]
fn the_default_field_is_the_first_that_varies() {
    let lattice = || Geometry::Lattice(Lattice::uniform([2, 1, 1], DVec3::ZERO, DVec3::ONE));
    let f = |name: &str, a: f32, b: f32| field(name, Association::Nodes, Values::F32(vec![a, b]));
    let fields = || {
        vec![
            f("flat", 1.0, 1.0),
            f("first", 0.0, 1.0),
            f("Density", 2.0, 3.0),
        ]
    };
    let chosen = |d: Dataset| sample(d).report.field.unwrap();
    assert_eq!(chosen(dataset(lattice(), fields())), "first");
    let plot3d = Dataset {
        format: "PLOT3D grid",
        ..dataset(lattice(), fields())
    };
    assert_eq!(chosen(plot3d), "Density");
    // A constant field is not shown if another varies, not even a density. Fields of colours are
    // not shown, either.
    let vector = |name: &str, components: [[u8; 2]; 3]| {
        let components = components.map(|c| Values::U8(c.to_vec()));
        Field {
            name: name.into(),
            association: Association::Nodes,
            source: FieldSource::Vector(components.to_vec()),
            unit: None,
        }
    };
    let still = vector("still", [[1, 1]; 3]);
    let colours = vector("Colors", [[1, 200]; 3]);
    let moving = vector("moving", [[1, 1], [3, 3], [0, 9]]);
    let fields = vec![f("density", 1.0, 1.0), colours, still, moving];
    let plot3d = Dataset {
        format: "PLOT3D grid",
        ..dataset(lattice(), fields)
    };
    assert_eq!(chosen(plot3d), "moving");
    let fails = volume(dataset(lattice(), vec![]), &SampleOptions::default()).unwrap_err();
    assert!(fails.to_string().contains("a field to show"));
}

/// Makes a table of particles at the corners of a cube.
fn table(columns: &[(&str, &[f32])]) -> Dataset {
    let n = columns[0].1.len();
    let positions = (0..n)
        .map(|i| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64))
        .collect();
    let fields = columns
        .iter()
        .map(|(name, v)| field(name, Association::Nodes, Values::F32(v.to_vec())))
        .collect();
    dataset(Geometry::Points { positions }, fields)
}

fn masses(sampled: &Sampled) -> &[f32] {
    match &sampled.volume.strength {
        Strength::Mass(m) => m,
        _ => panic!("masses expected"),
    }
}

#[test]
fn a_scale_moves_the_values_that_are_classified_and_not_those_that_are_summed() {
    let lattice = || Geometry::Lattice(Lattice::uniform([10, 10, 10], DVec3::ZERO, DVec3::ONE));
    // Values spread evenly over six decades.
    let raw: Vec<f32> = (0..1000).map(|i| 10f32.powf(0.006 * i as f32)).collect();
    let data = || {
        dataset(
            lattice(),
            vec![field("v", Association::Nodes, Values::F32(raw.clone()))],
        )
    };
    let of = |options: &SampleOptions| volume(data(), options).unwrap().volume;
    let defaults = SampleOptions::default();
    // A caller of the library gets the values unchanged, unless the sampler may choose a scale.
    let plain = of(&defaults);
    assert_eq!(plain.values, Some(Values::F32(raw.clone())));
    let by_itself = of(&SampleOptions {
        function: FunctionOptions {
            scale: None,
            ..defaults.function.clone()
        },
        ..defaults.clone()
    });
    let asked = of(&SampleOptions {
        function: FunctionOptions {
            scale: Some(ScaleName::Log),
            ..defaults.function.clone()
        },
        ..defaults.clone()
    });
    for volume in [by_itself, asked] {
        let Some(Values::F32(positions)) = &volume.values else {
            panic!("positions are f32")
        };
        for (position, value) in positions.iter().zip(&raw) {
            assert!((position - value.log10()).abs() < 1e-5);
        }
        assert_eq!(
            volume.transfer_function.unwrap().value_scale(),
            ValueScale::Log
        );
    }
    let columns = of(&SampleOptions {
        purpose: PurposeOptions {
            for_columns: true,
            ..defaults.purpose
        },
        function: FunctionOptions {
            scale: None,
            ..defaults.function
        },
        ..defaults
    });
    assert_eq!(columns.values, Some(Values::F32(raw.clone())));
}

#[test]
fn arrays_of_colours_colour_particles() {
    let mut data = table(&[
        ("sigma", &[0.1, 0.2]),
        ("mass", &[1.0, 2.0]),
        ("rho", &[1.0, 3.0]),
    ]);
    let channel = |bytes: [u8; 2]| Values::U8(bytes.to_vec());
    data.fields.push(Field {
        name: "rgb".into(),
        association: Association::Nodes,
        source: FieldSource::Vector(vec![
            channel([255, 0]),
            channel([0, 188]),
            channel([0, 255]),
            channel([9, 9]),
        ]),
        unit: None,
    });
    // Bytes are encoded: 188 is half of the light.
    let half = ewa_splat::image::linear_from_srgb(188.0 / 255.0);
    let expected = Colour::PerParticle(vec![[1.0, 0.0, 0.0], [0.0, half, 1.0]]);
    assert_eq!(sample(data).volume.colour, expected);
}

#[test]
fn sigma_and_mass_columns() {
    let sampled = sample(table(&[
        ("SIGMA", &[0.1, 0.2, 0.0, -1.0, f32::NAN]),
        ("mass", &[1.0, 2.0, 3.0, 4.0, 5.0]),
        ("r", &[1.0, 0.5, 0.0, 0.0, 0.0]),
        ("g", &[0.0, 0.25, 0.0, 0.0, 0.0]),
        ("b", &[0.0, 0.125, 0.0, 0.0, 0.0]),
    ]));
    let Particles::Isotropic { sigmas, .. } = &sampled.volume.particles else {
        panic!()
    };
    assert_eq!(sigmas, &[0.1, 0.2]);
    assert_eq!(masses(&sampled), [1.0, 2.0]);
    let expected = Colour::PerParticle(vec![[1.0, 0.0, 0.0], [0.5, 0.25, 0.125]]);
    assert_eq!(sampled.volume.colour, expected);
    assert_eq!(
        sampled.report.warnings(),
        ["3 particles left out: size zero, negative or not finite"]
    );
    assert_eq!(sampled.report.field, None);
}

#[test]
fn smoothing_length_with_m_and_rho() {
    let sampled = sample(table(&[
        ("h", &[1.0, 2.0]),
        ("m", &[6.0, 6.0]),
        ("rho", &[2.0, 3.0]),
        ("vx", &[5.0, 6.0]),
    ]));
    let Particles::Isotropic { sigmas, .. } = &sampled.volume.particles else {
        panic!()
    };
    assert!((f64::from(sigmas[1]).powi(2) - 0.3 * 4.0).abs() < 1e-6);
    assert!((total_volume(&sampled) - 5.0).abs() < 1e-6);
    assert_eq!(sampled.report.field.as_deref(), Some("rho"));
    assert_eq!(sampled.volume.colour, Colour::Classified);
}

#[test]
fn variance_columns_with_extinction_and_volume() {
    let sampled = sample(table(&[
        ("vxx", &[4.0, 1.0, 1.0]),
        ("vxy", &[1.0, 0.0, 2.0]),
        ("vxz", &[0.5, 0.0, 0.0]),
        ("vyy", &[3.0, 1.0, 1.0]),
        ("vyz", &[-1.0, 0.0, 0.0]),
        ("vzz", &[2.0, 0.0, 1.0]),
        ("extinction", &[0.5, 1.0, 1.0]),
        ("volume", &[4.0, 5.0, 1.0]),
    ]));
    let (_, factors) = anisotropic(&sampled);
    let expected = DMat3::from_cols(
        DVec3::new(4.0, 1.0, 0.5),
        DVec3::new(1.0, 3.0, -1.0),
        DVec3::new(0.5, -1.0, 2.0),
    );
    assert_near(variance(&factors[0]), expected, 1e-6);
    assert_near(
        variance(&factors[1]),
        DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)),
        1e-6,
    );
    assert_eq!(masses(&sampled), [2.0, 5.0]);
    assert_eq!(sampled.volume.colour, Colour::Uniform([1.0; 3]));
    assert!(sampled.report.warnings()[0].contains("1 particles left out: variance indefinite"));
}

#[test]
fn scales_and_rotations_with_opacity() {
    // A quarter turn about z, not normalised, exchanges x and y.
    let sampled = sample(table(&[
        ("scale_0", &[3.0]),
        ("scale_1", &[2.0]),
        ("scale_2", &[1.0]),
        ("rot_0", &[2.0]),
        ("rot_1", &[0.0]),
        ("rot_2", &[0.0]),
        ("rot_3", &[2.0]),
        ("opacity", &[0.5]),
    ]));
    let (_, factors) = anisotropic(&sampled);
    let expected = DMat3::from_diagonal(DVec3::new(4.0, 9.0, 1.0));
    assert_near(variance(&factors[0]), expected, 1e-5);
    // Along z: tau = g / (2 pi 3 2) = ln 2.
    let expected = 2f64.ln() * 2.0 * PI * 6.0;
    assert!((f64::from(masses(&sampled)[0]) / expected - 1.0).abs() < 1e-6);
}

#[test]
fn bare_positions_get_spheres_and_a_number_density() {
    let positions: Vec<DVec3> = (0..1000)
        .map(|i| DVec3::new((i % 10) as f64, (i / 10 % 10) as f64, (i / 100) as f64))
        .collect();
    let geometry = |offset: f64| {
        let mut points: Vec<DVec3> = positions
            .iter()
            .map(|p| *p + DVec3::splat(offset))
            .collect();
        points.push(DVec3::INFINITY);
        Geometry::Points { positions: points }
    };
    let sampled = sample(dataset(geometry(0.0), vec![]));
    assert_eq!(
        sampled.report.field.as_deref(),
        Some("log10 number density")
    );
    assert_eq!(
        sampled.report.warnings(),
        ["1 particles left out: position not finite"]
    );
    let Particles::Isotropic { sigmas, .. } = &sampled.volume.particles else {
        panic!()
    };
    // Neighbours 7 to 18 of a lattice point are at sqrt(2): volume 1.0325 for 1.
    assert!((f64::from(sigmas[555]) - 0.6 * 1.0325f64.cbrt()).abs() < 1e-3);
    let far = sample(dataset(geometry(1e7), vec![]));
    let Particles::Isotropic { sigmas: far, .. } = &far.volume.particles else {
        panic!()
    };
    assert_eq!(sigmas, far);
}

#[test]
fn a_named_field_colours_particles_with_masses() {
    let options = SampleOptions {
        field: Some("t".into()),
        function: FunctionOptions {
            transfer: TransferChoice::Named("viridis".into()),
            ..FunctionOptions::default()
        },
        ..SampleOptions::default()
    };
    let columns: [(&str, &[f32]); 3] = [
        ("sigma", &[1.0; 3]),
        ("mass", &[1.0; 3]),
        ("t", &[0.0, 1.0, f32::NAN]),
    ];
    let sampled = volume(table(&columns), &options).unwrap();
    check(&sampled);
    assert_eq!(sampled.volume.colour, Colour::Classified);
    assert_eq!(masses(&sampled), [1.0, 1.0]);
    assert_eq!(
        sampled.report.warnings(),
        ["1 particles left out: value not finite"]
    );
}

#[test]
fn contradictory_and_incomplete_tables_are_refused() {
    let one: &[f32] = &[1.0];
    for (columns, expected) in [
        (&[("sigma", one), ("h", one)][..], "one kind of shape"),
        (
            &[("sigma", one), ("mass", one), ("opacity", one)],
            "one kind of strength",
        ),
        (&[("vxx", one)], "no `vxy`"),
        (
            &[("sigma", one), ("extinction", one)],
            "`volume` beside `extinction`",
        ),
        (&[("t", one)], "fewer than two distinct positions"),
        (
            &[("sigma", &[0.0][..]), ("mass", one)],
            "at least one that can be drawn",
        ),
    ] {
        let error = volume(table(columns), &SampleOptions::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
    let options = SampleOptions {
        kernels: KernelOptions {
            width: f64::NAN,
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    let error = volume(table(&[("sigma", one)]), &options).unwrap_err();
    assert!(
        matches!(
            error,
            Error::Invalid {
                what: Place::Parameter(Parameter::KernelWidth),
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn an_explicit_unit_distance_wins_over_the_file() {
    let file = tempfile::NamedTempFile::with_suffix(".json").unwrap();
    std::fs::write(
        file.path(),
        r#"{"unit_distance": 2, "points": [{"value": 0, "opacity": 0.5}]}"#,
    )
    .unwrap();
    let run = |unit_distance| {
        let options = SampleOptions {
            function: FunctionOptions {
                transfer: TransferChoice::File(file.path().into()),
                unit_distance,
                ..FunctionOptions::default()
            },
            ..SampleOptions::default()
        };
        let sampled = volume(grid([3, 3, 3], Association::Nodes, |s| s), &options).unwrap();
        sampled.volume.transfer_function.unwrap().classify(0.0)[3]
    };
    assert!((run(None) - 2f32.ln() / 2.0).abs() < 1e-6);
    assert!((run(Some(4.0)) - 2f32.ln() / 4.0).abs() < 1e-6);
}

#[test]
fn hidden_samples_of_a_lattice_are_transparent_and_counted() {
    let lattice = Geometry::Lattice(Lattice::uniform([3, 2, 1], DVec3::ZERO, DVec3::ONE));
    let values = field("v", Association::Nodes, Values::U8(vec![1, 2, 3, 4, 5, 6]));
    // Hiding the node hides its cell, and thereby the one other node that has no other cell.
    let hidden = Values::U8(vec![2, 0, 1, 0, 0, 0]);
    let ghosts = field("vtkGhostType", Association::Nodes, hidden);
    let sampled = sample(dataset(lattice, vec![values, ghosts]));
    let values = sampled.volume.values.unwrap();
    assert!(values.get(0).is_nan() && values.get(3).is_nan() && values.get(2) == 3.0);
    assert_eq!(sampled.report.left_out_count(), 2);
}

#[test]
fn flat_blocks_among_others_are_left_out() {
    let solid = grid([3, 3, 3], Association::Nodes, |s| s);
    let Geometry::Curvilinear { mut blocks } = solid.geometry else {
        panic!()
    };
    blocks.push(CurvilinearBlock {
        dims: [3, 3, 1],
        nodes: blocks[0].nodes[..9].to_vec(),
    });
    let values = Values::F32((0..36_u8).map(f32::from).collect());
    let fields = vec![field("a", Association::Nodes, values)];
    let sampled = sample(dataset(Geometry::Curvilinear { blocks }, fields));
    assert!((total_volume(&sampled) - 1.0).abs() < SUM);
    assert_eq!(sampled.report.left_out_count(), 9);
}
