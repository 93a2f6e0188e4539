//! Tests surfaces that show a field, and grids of one layer, which become surfaces.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;

use crate::common::scalar;

use ewa_splat::io::{
    Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry, Material, Mesh, MeshPart,
};
use ewa_splat::sample::mesh::Spread;
use ewa_splat::sample::{
    FunctionOptions, KernelOptions, SampleOptions, SampledScene, TransferChoice, is_surface, scene,
};
use ewa_splat::scene::{
    Colour, Lattice, Particles, PointVolume, Strength, TransferFunction, Values,
};
use glam::DVec3;

const COUNT: usize = 20_000;

fn field(association: Association, values: Vec<f32>) -> Field {
    Field {
        unit: Some("K".into()),
        ..scalar("f", association, values)
    }
}

/// Returns the unit square as two triangles.
fn square(fields: Vec<Field>) -> Dataset {
    let part = MeshPart {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..MeshPart::default()
    };
    let mesh = Mesh {
        parts: vec![part],
        materials: vec![Material::default()],
        textures: Vec::new(),
    };
    Dataset::new(Path::new("a"), "test", Geometry::Mesh(mesh), fields)
}

fn sampled(dataset: Dataset, transfer: TransferChoice) -> SampledScene {
    let options = SampleOptions {
        kernels: KernelOptions {
            spread: Spread::Count(COUNT),
            ..KernelOptions::default()
        },
        function: FunctionOptions {
            transfer,
            ..FunctionOptions::default()
        },
        ..SampleOptions::default()
    };
    scene(dataset, &options).unwrap()
}

/// Returns positions and values of all surfels.
fn values(scene: &SampledScene) -> Vec<(DVec3, f64)> {
    let of = |volume: &PointVolume| {
        let Particles::Surfels { positions, .. } = &volume.particles else {
            panic!("surfels expected");
        };
        assert_eq!(volume.colour, Colour::Classified);
        assert!(volume.transfer_function.is_some());
        let values = volume.values.clone().unwrap();
        let value = move |i: usize| f64::from(values.get(i));
        let both = positions.iter().enumerate().map(|(i, p)| (*p, value(i)));
        both.collect::<Vec<_>>()
    };
    scene.volumes.iter().flat_map(of).collect()
}

#[test]
fn values_of_corners_are_linear_between_them() {
    // 300 + 7 x - 20 y.
    let data = square(vec![field(
        Association::Nodes,
        vec![300.0, 307.0, 287.0, 280.0],
    )]);
    let found = sampled(data, TransferChoice::Automatic);
    assert_eq!(found.report.field.as_deref(), Some("f"));
    assert_eq!(found.report.unit.as_deref(), Some("K"));
    assert_eq!(found.report.value_range, Some([280.0, 307.0]));
    let all = values(&found);
    assert!(all.len() > COUNT / 2, "{}", all.len());
    for (at, value) in all {
        let expected = 300.0 + 7.0 * at.x - 20.0 * at.y;
        // The mean of a linear field is its value at the centroid; values are stored in f32.
        assert!(
            (value - expected).abs() < 1e-3,
            "{at}: {value}, not {expected}"
        );
    }
    assert!(matches!(found.volumes[0].strength, Strength::Surface(_)));
}

#[test]
fn values_of_cells_stay_in_their_triangles() {
    let data = square(vec![field(Association::Cells, vec![2.0, 5.0])]);
    let all = values(&sampled(data, TransferChoice::Automatic));
    let spacing = (1.0 / COUNT as f64).sqrt();
    for (at, value) in all {
        // Surfels on the diagonal have parts of both.
        if (at.x - at.y).abs() > 2.0 * spacing {
            let expected = if at.x > at.y { 2.0 } else { 5.0 };
            assert!((value - expected).abs() < 1e-6, "{at}: {value}");
        }
    }
}

#[test]
fn triangles_without_values_are_left_out_and_counted() {
    let nan = f32::NAN;
    let data = square(vec![field(Association::Nodes, vec![1.0, nan, 2.0, 3.0])]);
    let found = sampled(data, TransferChoice::Automatic);
    assert!(
        found
            .report
            .warnings()
            .iter()
            .any(|w| w.contains("1 triangle")),
        "{:?}",
        found.report.warnings()
    );
    assert!(values(&found).iter().all(|(at, _)| at.y >= at.x - 1e-9));
    let data = square(vec![field(Association::Nodes, vec![1.0, 2.0])]);
    assert!(scene(data, &SampleOptions::default()).is_err());
}

/// A caller's transfer function makes the surface as opaque as stated, seen along its normal.
#[test]
fn own_functions_give_opacities() {
    let half = TransferFunction::from_curves(|_| [1.0; 3], |_| 0.5, [0.0, 1.0], 0.25).unwrap();
    let data = square(vec![field(Association::Nodes, vec![0.0, 1.0, 1.0, 0.0])]);
    let found = sampled(data, TransferChoice::Given(half));
    let Strength::Translucent(strengths) = &found.volumes[0].strength else {
        panic!("translucent surfels expected");
    };
    let sum: f64 = strengths.iter().map(|s| f64::from(*s)).sum();
    // An area of 1, times -ln(1 - .5).
    assert!((sum - std::f64::consts::LN_2).abs() < 1e-3, "{sum}");
    let opaque = TransferFunction::from_curves(|_| [1.0; 3], |_| 1.0, [0.0, 1.0], 1.0).unwrap();
    let data = square(vec![field(Association::Nodes, vec![0.0, 1.0, 1.0, 0.0])]);
    let found = sampled(data, TransferChoice::Given(opaque));
    assert!(matches!(found.volumes[0].strength, Strength::Surface(_)));
}

#[test]
fn grids_of_one_layer_are_surfaces() {
    let at = |i: usize, j: usize| DVec3::new(i as f64, 2.0, j as f64);
    let nodes: Vec<DVec3> = (0..5).flat_map(|j| (0..4).map(move |i| at(i, j))).collect();
    let of_nodes: Vec<f32> = nodes.iter().map(|p| (p.x + 10.0 * p.z) as f32).collect();
    let block = CurvilinearBlock {
        dims: [4, 1, 5],
        nodes,
    };
    let geometry = Geometry::Curvilinear {
        blocks: vec![block],
    };
    let fields = vec![field(Association::Nodes, of_nodes.clone())];
    let data = Dataset::new(Path::new("a"), "test", geometry, fields);
    assert!(is_surface(&data));
    let up = data.up();
    assert_eq!(
        (up.direction, up.front, up.is_plane),
        (DVec3::Z, Some(DVec3::Y), true)
    );
    for (at, value) in values(&sampled(data, TransferChoice::Automatic)) {
        assert!((value - at.x - 10.0 * at.z).abs() < 1e-3, "{at}: {value}");
        assert!((at.y - 2.0).abs() < 1e-6);
    }

    // Values of cells on a lattice, of which one is blanked.
    let lattice = Lattice::uniform([4, 5, 1], DVec3::ZERO, DVec3::ONE);
    let of_cells: Vec<f32> = (0..12).map(|i| i as f32).collect();
    let mut ghosts = vec![0; 12];
    ghosts[7] = 32;
    let hidden = Field {
        name: "vtkGhostType".into(),
        association: Association::Cells,
        source: FieldSource::Scalar(Values::U8(ghosts)),
        unit: None,
    };
    let fields = vec![field(Association::Cells, of_cells), hidden];
    let data = Dataset::new(Path::new("a"), "test", Geometry::Lattice(lattice), fields);
    assert_eq!(data.up().front, Some(DVec3::NEG_Z));
    let mut seen = 0;
    for (at, value) in values(&sampled(data, TransferChoice::Automatic)) {
        let cell = (at.x.floor(), at.y.floor());
        assert!(cell != (1.0, 2.0), "{at} is hidden");
        let inside = (at.x.fract() - 0.5).abs().max((at.y.fract() - 0.5).abs()) < 0.4;
        if inside {
            seen += 1;
            assert!(
                (value - cell.0 - 3.0 * cell.1).abs() < 1e-4,
                "{at}: {value}"
            );
        }
    }
    assert!(seen > 1000, "{seen}");
}
