//! Tests unstructured grids: the kernels of each kind of cell, and invalid cells.
#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests fail by panicking, as tests do"
)]

use std::path::Path;

use crate::common::scalar;

use ewa_splat::Result;
use ewa_splat::io::{Association, CellKind, CellMesh, Dataset, Field, Geometry};
use ewa_splat::sample::{KernelOptions, SampleOptions, Sampled, volume};
use ewa_splat::scene::{Particles, Strength};
use glam::DVec3;

/// Roundings of f32 volumes.
const ROUNDING: f64 = 1e-6;

fn mesh(nodes: &[[f64; 3]], cells: &[(u8, &[u32])]) -> CellMesh {
    let mut mesh = CellMesh {
        nodes: nodes.iter().map(|n| DVec3::from_array(*n)).collect(),
        offsets: vec![0],
        ..CellMesh::default()
    };
    for (kind, entries) in cells {
        mesh.kinds.push(CellKind(*kind));
        mesh.connectivity.extend_from_slice(entries);
        mesh.offsets
            .push(u32::try_from(mesh.connectivity.len()).unwrap());
    }
    mesh
}

fn try_sample(mesh: CellMesh, association: Association, more: Vec<Field>) -> Result<Sampled> {
    let count = match association {
        Association::Nodes => mesh.nodes.len(),
        Association::Cells => mesh.cell_count(),
    };
    let values = (0..count).map(|i| i as f32).collect();
    let mut fields = vec![scalar("value", association, values)];
    fields.extend(more);
    let dataset = Dataset::new(Path::new("test"), "test", Geometry::Cells(mesh), fields);
    let options = SampleOptions {
        field: Some("value".into()),
        kernels: KernelOptions {
            width: 1.0,
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    volume(dataset, &options)
}

fn sample(mesh: CellMesh, association: Association) -> Sampled {
    try_sample(mesh, association, vec![]).unwrap()
}

fn parts(sampled: &Sampled) -> (&[DVec3], &[[f32; 6]], Vec<f64>) {
    let Particles::Anisotropic { positions, factors } = &sampled.volume.particles else {
        panic!()
    };
    let Strength::Classified { volumes } = &sampled.volume.strength else {
        panic!()
    };
    let volumes = volumes.iter().map(|v| f64::from(*v)).collect();
    (positions, factors, volumes)
}

fn total(sampled: &Sampled) -> f64 {
    parts(sampled).2.iter().sum()
}

/// Returns the mean of the particles' positions, weighted by volume.
fn centroid(sampled: &Sampled) -> DVec3 {
    let (positions, _, volumes) = parts(sampled);
    let sum: DVec3 = positions.iter().zip(&volumes).map(|(p, v)| *p * *v).sum();
    sum / volumes.iter().sum::<f64>()
}

const CUBE: [[f64; 3]; 8] = [
    [0., 0., 0.],
    [1., 0., 0.],
    [1., 1., 0.],
    [0., 1., 0.],
    [0., 0., 1.],
    [1., 0., 1.],
    [1., 1., 1.],
    [0., 1., 1.],
];

/// Returns one cell of each solid kind with its volume and its centroid.
fn solids() -> Vec<(CellMesh, f64, DVec3)> {
    let half = DVec3::splat(0.5);
    let prism = |corners: &[[f64; 2]]| {
        let mut nodes = Vec::new();
        for z in [0.0, 2.0] {
            nodes.extend(corners.iter().map(|[x, y]| [*x, *y, z]));
        }
        nodes
    };
    let ring = |n: u32| -> Vec<[f64; 2]> {
        (0..n)
            .map(|i| f64::from(i) / f64::from(n) * std::f64::consts::TAU)
            .map(|a| [a.cos(), a.sin()])
            .collect()
    };
    // Area of a regular polygon in the unit circle.
    let area = |n: f64| 0.5 * n * (std::f64::consts::TAU / n).sin();
    let ids = |n: u32| (0..n).collect::<Vec<u32>>();
    let one = |nodes: &[[f64; 3]], kind: u8, entries: &[u32]| mesh(nodes, &[(kind, entries)]);
    let cube_faces = [
        6, 4, 0, 3, 2, 1, 4, 4, 5, 6, 7, 4, 0, 1, 5, 4, 4, 1, 2, 6, 5, 4, 2, 3, 7, 6, 4, 3, 0, 4, 7,
    ];
    // Faces are reversed, because files differ in their orientation.
    let turned = [
        6, 4, 1, 2, 3, 0, 4, 4, 5, 6, 7, 4, 4, 5, 1, 0, 4, 1, 2, 6, 5, 4, 6, 7, 3, 2, 4, 3, 0, 4, 7,
    ];
    let tetra = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    let quarter = DVec3::splat(0.25);
    let mut quadratic = tetra.to_vec();
    for [a, b] in [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]] {
        quadratic.push(std::array::from_fn(|i| (tetra[a][i] + tetra[b][i]) / 2.0));
    }
    let pyramid = [CUBE[0], CUBE[1], CUBE[2], CUBE[3], [0.5, 0.5, 1.0]];
    let third = 1.0 / 3.0;
    vec![
        (one(&tetra, 10, &ids(4)), 1.0 / 6.0, quarter),
        (one(&quadratic, 24, &ids(10)), 1.0 / 6.0, quarter),
        (one(&CUBE, 12, &ids(8)), 1.0, half),
        (one(&CUBE, 11, &[0, 1, 3, 2, 4, 5, 7, 6]), 1.0, half),
        (one(&CUBE, 42, &cube_faces), 1.0, half),
        (one(&CUBE, 42, &turned), 1.0, half),
        (
            one(&prism(&[[0., 0.], [1., 0.], [0., 1.]]), 13, &ids(6)),
            1.0,
            DVec3::new(third, third, 1.0),
        ),
        (
            one(&pyramid, 14, &ids(5)),
            third,
            DVec3::new(0.5, 0.5, 0.25),
        ),
        (
            one(&prism(&ring(5)), 15, &ids(10)),
            2.0 * area(5.0),
            DVec3::Z,
        ),
        (
            one(&prism(&ring(6)), 16, &ids(12)),
            2.0 * area(6.0),
            DVec3::Z,
        ),
    ]
}

#[test]
fn every_solid_has_its_volume_and_its_centroid() {
    for (mesh, volume, middle) in solids() {
        let kind = mesh.kinds[0].name();
        for association in [Association::Nodes, Association::Cells] {
            let sampled = sample(mesh.clone(), association);
            let (found, at) = (total(&sampled), centroid(&sampled));
            assert!((found / volume - 1.0).abs() < ROUNDING, "{kind} {found}");
            assert!(at.distance(middle) < ROUNDING, "{kind} {at}");
            if association == Association::Cells {
                assert_eq!(sampled.volume.particles.len(), 1, "{kind}");
            }
        }
    }
}

#[test]
fn a_concave_polyhedron_has_its_volume() {
    // An L of area 9 and height 1; the mean of its corners sees some faces from outside.
    let corners = [[0., 0.], [5., 0.], [5., 1.], [1., 1.], [1., 5.], [0., 5.]];
    let mut nodes: Vec<[f64; 3]> = Vec::new();
    for z in [0.0, 1.0] {
        nodes.extend(corners.map(|[x, y]| [x, y, z]));
    }
    let mut faces = vec![8, 6, 5, 4, 3, 2, 1, 0, 6, 6, 7, 8, 9, 10, 11];
    for i in 0..6 {
        let j = (i + 1) % 6;
        faces.extend([4, i, j, j + 6, i + 6]);
    }
    let mut inside_out = vec![8];
    let mut rest = &faces[1..];
    while let Some((&n, tail)) = rest.split_first() {
        inside_out.push(n);
        inside_out.extend(tail[..n as usize].iter().rev());
        rest = &tail[n as usize..];
    }
    for faces in [faces, inside_out] {
        let cell = mesh(&nodes, &[(42, &faces)]);
        for association in [Association::Nodes, Association::Cells] {
            let found = total(&sample(cell.clone(), association));
            assert!(
                (found / 9.0 - 1.0).abs() < ROUNDING,
                "{association:?} {found}"
            );
        }
    }
}

#[test]
fn tetrahedra_numbered_either_way_are_all_there() {
    // Every other one of twelve cells is reversed.
    let (mut nodes, mut cells) = (Vec::new(), Vec::new());
    for i in 0..12_u32 {
        let x = f64::from(i) * 2.0;
        nodes.extend([[x, 0., 0.], [x + 1., 0., 0.], [x, 1., 0.], [x, 0., 1.]]);
        let n = 4 * i;
        cells.push(if i % 2 == 0 {
            [n, n + 1, n + 2, n + 3]
        } else {
            [n, n + 2, n + 1, n + 3]
        });
    }
    let cells: Vec<(u8, &[u32])> = cells.iter().map(|c| (10, &c[..])).collect();
    let both = mesh(&nodes, &cells);
    for association in [Association::Nodes, Association::Cells] {
        let sampled = sample(both.clone(), association);
        assert!((total(&sampled) - 2.0).abs() < ROUNDING);
        assert_eq!(sampled.report.warnings(), [""; 0]);
    }
}

#[test]
fn pieces_that_meet_are_as_good_as_one() {
    // The two cubes have their own nodes, as pieces of a parallel file do.
    let whole = two_cubes();
    let mut pieces = CellMesh {
        offsets: vec![0],
        ..CellMesh::default()
    };
    for cell in 0..2 {
        for &n in whole.cell(cell) {
            pieces
                .connectivity
                .push(u32::try_from(pieces.nodes.len()).unwrap());
            pieces.nodes.push(whole.nodes[n as usize]);
        }
        pieces.kinds.push(CellKind::HEXAHEDRON);
        pieces
            .offsets
            .push(u32::try_from(pieces.connectivity.len()).unwrap());
    }
    let (one, two) = (
        sample(whole, Association::Nodes),
        sample(pieces, Association::Nodes),
    );
    let (p, f, v) = parts(&one);
    let (q, g, w) = parts(&two);
    assert_eq!(q.len(), 16);
    let mut shares = vec![0.0; p.len()];
    for i in 0..q.len() {
        // The kernel equals that of the whole mesh there, with a part of its volume.
        let twin = (0..p.len()).find(|&k| p[k].distance(q[i]) < 1e-12).unwrap();
        let gap = f[twin].iter().zip(&g[i]).map(|(a, b)| (a - b).abs());
        assert!(gap.fold(0.0, f32::max) < 1e-6);
        shares[twin] += w[i];
    }
    for (share, volume) in shares.iter().zip(v) {
        assert!((share / volume - 1.0).abs() < ROUNDING);
    }
}

#[test]
fn a_tetrahedron_has_the_moments_of_its_quarters() {
    // Compares the closed form with the decomposition into tetrahedra that other cells use. A
    // tetrahedron of kind 24 is decomposed.
    let nodes = [[0., 0., 0.], [2., 0.1, 0.], [0.3, 1., 0.2], [-0.1, 0., 3.]];
    let [closed, cut] =
        [10, 24].map(|kind| sample(mesh(&nodes, &[(kind, &[0, 1, 2, 3])]), Association::Nodes));
    let ((p, f, v), (q, g, w)) = (parts(&closed), parts(&cut));
    for i in 0..4 {
        assert!(p[i].distance(q[i]) < 1e-12);
        assert!((v[i] / w[i] - 1.0).abs() < ROUNDING);
        let gap = f[i].iter().zip(&g[i]).map(|(a, b)| (a - b).abs());
        assert!(gap.fold(0.0, f32::max) < 1e-6, "{:?} {:?}", f[i], g[i]);
    }
    assert_eq!(closed.report.warnings(), [""; 0]);
    assert_eq!(
        cut.report.warnings(),
        ["1 cells: of higher order: drawn by their corners"]
    );
}

/// Returns two adjacent cubes along x, by their nodes (i + 3 (j + 2 k)).
fn two_cubes() -> CellMesh {
    let mut nodes = Vec::new();
    for k in [0.0, 1.0] {
        for j in [0.0, 1.0] {
            nodes.extend([0.0, 1.0, 2.0].map(|i| [i, j, k]));
        }
    }
    mesh(
        &nodes,
        &[
            (12, &[0, 1, 4, 3, 6, 7, 10, 9]),
            (12, &[1, 2, 5, 4, 7, 8, 11, 10]),
        ],
    )
}

#[test]
fn cubes_have_kernels_of_their_spacing() {
    // A lattice of 4 x 4 x 4 unit cubes: at width 1, the kernels of its inner nodes and cells are
    // unit spheres.
    let side = 5_u32;
    let at = |i: u32| [i % side, i / side % side, i / (side * side)].map(f64::from);
    let nodes: Vec<[f64; 3]> = (0..side.pow(3)).map(at).collect();
    let mut cells = Vec::new();
    for c in 0..64 {
        let first = c % 4 + side * (c / 4 % 4 + side * (c / 16));
        let corners = [0, 1, 1 + side, side].map(|o| first + o);
        let above = corners.map(|n| n + side * side);
        cells.push([corners, above].concat());
    }
    let cells: Vec<(u8, &[u32])> = cells.iter().map(|c| (12, &c[..])).collect();
    let lattice = mesh(&nodes, &cells);
    for (association, middle) in [(Association::Nodes, 62), (Association::Cells, 21)] {
        let sampled = sample(lattice.clone(), association);
        let (positions, factors, volumes) = parts(&sampled);
        assert!((volumes[middle] - 1.0).abs() < ROUNDING);
        let expected = match association {
            Association::Nodes => DVec3::splat(2.0),
            Association::Cells => DVec3::splat(1.5),
        };
        assert!(positions[middle].distance(expected) < 1e-12);
        for (l, e) in factors[middle].iter().zip([1.0, 0.0, 1.0, 0.0, 0.0, 1.0]) {
            assert!((l - e).abs() < 1e-6, "{:?}", factors[middle]);
        }
    }
}

#[test]
fn mirrored_meshes_are_whole_and_inverted_cells_are_left_out() {
    let mut mirrored = two_cubes();
    for node in &mut mirrored.nodes {
        node.x = -node.x;
    }
    let sampled = sample(mirrored, Association::Nodes);
    assert!((total(&sampled) - 2.0).abs() < ROUNDING);
    assert_eq!(sampled.report.warnings(), [""; 0]);

    // One of three cells is inverted: the majority decides.
    let mut folded = two_cubes();
    folded.nodes.extend([
        DVec3::new(5., 0., 0.),
        DVec3::new(6., 0., 0.),
        DVec3::new(5., 1., 0.),
        DVec3::new(5., 0., 1.),
    ]);
    let inverted = [0, 1, 4, 3, 6, 7, 10, 9].map(|n| if n < 6 { n + 6 } else { n - 6 });
    folded.kinds.push(CellKind::HEXAHEDRON);
    folded.connectivity.extend(inverted);
    folded.offsets.push(24);
    for (association, warnings) in [
        (
            Association::Nodes,
            vec![
                "1 cells: without volume, or inverted against the others of their kind: left out \
                 of their nodes' volumes",
                "4 nodes left out: corner of no cell with a volume (between corners, or of cells left out)",
            ],
        ),
        (
            Association::Cells,
            vec![
                "1 cells: without volume, or inverted against the others of their kind: left out \
                 of their nodes' volumes",
                "1 cells left out: no volume, or inverted",
            ],
        ),
    ] {
        let sampled = sample(folded.clone(), association);
        assert_eq!(sampled.report.warnings(), warnings);
        assert!((total(&sampled) - 2.0).abs() < ROUNDING);
    }
}

#[test]
fn what_has_no_volume_is_left_out_and_counted() {
    let mut mixed = two_cubes();
    for (kind, entries) in [
        (CellKind::TRIANGLE, &[0, 1, 4][..]),
        (CellKind::LINE, &[0, 1]),
        (CellKind::VERTEX, &[2]),
        // This cell is flat.
        (CellKind::TETRA, &[0, 1, 3, 4]),
        // This one has no faces of three corners.
        (CellKind::POLYHEDRON, &[1, 2, 0, 1]),
        (CellKind::POLYHEDRON, &[0]),
    ] {
        mixed.kinds.push(kind);
        mixed.connectivity.extend(entries);
        mixed
            .offsets
            .push(u32::try_from(mixed.connectivity.len()).unwrap());
    }
    let sampled = sample(mixed, Association::Cells);
    assert_eq!(sampled.volume.particles.len(), 2);
    assert_eq!(
        sampled.report.warnings()[1..],
        [
            "3 cells left out: no volume, or inverted",
            "3 cells left out: points, lines, surfaces and kinds that are not read have no volume"
        ]
    );

    let surface = mesh(&CUBE, &[(9, &[0, 1, 2, 3]), (7, &[4, 5, 6])]);
    let error = try_sample(surface, Association::Nodes, vec![]).unwrap_err();
    assert!(error.to_string().contains("cells with a volume"), "{error}");
}

#[test]
fn bad_nodes_values_and_ghosts_are_left_out() {
    let mut bad = two_cubes();
    bad.nodes[2].y = f64::NAN;
    let sampled = sample(bad, Association::Nodes);
    assert!((total(&sampled) - 1.0).abs() < ROUNDING);
    assert_eq!(
        sampled.report.warnings(),
        [
            "1 cells: with a corner that is not finite: left out of their nodes' volumes",
            "1 nodes left out: position not finite",
            "3 nodes left out: corner of no cell with a volume (between corners, or of cells left out)",
        ]
    );

    // The second cube belongs to another piece (1) or is hidden (32); bits 2 and 16 do not apply to
    // cells.
    for (bits, left) in [(1.0, 1.0), (32.0, 1.0), (2.0, 2.0), (16.0, 2.0)] {
        let ghosts = scalar("vtkGhostType", Association::Cells, vec![0.0, bits]);
        let sampled = try_sample(two_cubes(), Association::Cells, vec![ghosts]).unwrap();
        assert!((total(&sampled) - left).abs() < ROUNDING, "{bits}");
    }
    let mut hidden = vec![0.0; 12];
    hidden[0] = 2.0;
    let ghosts = scalar("vtkGhostType", Association::Nodes, hidden);
    // A cell with a hidden corner is hidden.
    let sampled = try_sample(two_cubes(), Association::Nodes, vec![ghosts]).unwrap();
    assert!((total(&sampled) - 1.0).abs() < ROUNDING);
}

#[test]
fn the_sums_do_not_depend_on_the_number_of_threads() {
    let side = 21_u32;
    let at = |i: u32| [i % side, i / side % side, i / (side * side)].map(|c| f64::from(c).sqrt());
    let nodes: Vec<[f64; 3]> = (0..side.pow(3)).map(at).collect();
    let n = side - 1;
    let mut cells = Vec::new();
    for c in 0..n.pow(3) {
        let first = c % n + side * (c / n % n + side * (c / (n * n)));
        cells.push([0, 1, side, side * side].map(|o| first + o));
    }
    let cells: Vec<(u8, &[u32])> = cells.iter().map(|c| (10, &c[..])).collect();
    let many = mesh(&nodes, &cells);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap()
            .install(|| sample(many.clone(), Association::Nodes).volume)
    };
    assert!(on(1) == on(3));
}
