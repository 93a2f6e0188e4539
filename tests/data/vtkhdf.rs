//! Tests VTKHDF files.
//!
//! | fixture | what |
//! |---|---|
//! | `solids.vtkhdf` | written by VTK 9.7: a hexahedron, a polyhedron and a pyramid over 13 nodes |
//! | `solids_in_time.vtkhdf` | the same at times 0, .5 and 2 |
//! | `surface.vtkhdf` | by VTK: a vertex, a line, a triangle, a quadrilateral and a strip |
//! | `parts.vtkhdf` | by VTK: a partitioned collection of the solids and of the same 4 further on |
//! | `image_in_time.vtkhdf` | by h5py: an oblique image at two times |
//! | `levels.vtkhdf`, `levels_in_time.vtkhdf` | by h5py: overlapping AMR of two levels |
//!
//! The files of VTK were copied array by array with h5py, without VTK's unused space. All numbers
//! are those that VTK's own reader gives for these files.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{Association, CellKind, Dataset, Geometry, OpenOptions, format_of, open};
use glam::DVec3;

use crate::common::real_data;
use crate::support::numbers;

fn fixture(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    folder.join(name)
}

fn read_at(name: &str, time_step: Option<usize>) -> Dataset {
    let options = OpenOptions {
        time_step,
        ..OpenOptions::default()
    };
    open(&fixture(name), &options).unwrap()
}

fn counted(first: f32, count: usize) -> Vec<f32> {
    (0..count).map(|i| first + i as f32).collect()
}

/// Returns the nodes of the solids.
fn nodes(shift: f64) -> Vec<DVec3> {
    let mut nodes = Vec::new();
    for k in 0..2 {
        for j in 0..2 {
            for i in 0..3 {
                let i = f64::from(i);
                nodes.push(DVec3::new(
                    shift + i,
                    f64::from(j),
                    f64::from(k) + 0.125 * i,
                ));
            }
        }
    }
    nodes.push(DVec3::new(shift + 3.0, 0.5, 0.5));
    nodes
}

#[test]
fn solids_with_polyhedra() {
    let data = read_at("solids.vtkhdf", None);
    let Geometry::Cells(mesh) = &data.geometry else {
        panic!("cells expected");
    };
    assert_eq!(mesh.nodes, nodes(0.0));
    assert_eq!(
        mesh.kinds,
        [
            CellKind::HEXAHEDRON,
            CellKind::POLYHEDRON,
            CellKind::PYRAMID
        ]
    );
    assert_eq!(mesh.cell(0), [0, 1, 4, 3, 6, 7, 10, 9]);
    let faces = [
        [1, 7, 10, 4],
        [2, 5, 11, 8],
        [1, 2, 8, 7],
        [4, 10, 11, 5],
        [1, 4, 5, 2],
        [7, 8, 11, 10],
    ];
    let stream = faces.iter().flat_map(|face| [4].into_iter().chain(*face));
    assert_eq!(mesh.cell(1), [vec![6], stream.collect()].concat());
    assert_eq!(mesh.cell(2), [2, 5, 11, 8, 12]);
    assert_eq!(numbers(&data, "T"), counted(0.0, 13));
    assert_eq!(data.scalar("v").unwrap().0, Association::Cells);
    assert_eq!(numbers(&data, "v:z"), [0.0, -1.0, -2.0]);
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}

#[test]
fn steps_of_time_are_read_from_where_they_begin() {
    let path = fixture("solids_in_time.vtkhdf");
    let format = format_of(&path, &OpenOptions::default()).unwrap();
    let steps = format.time_steps(&path).unwrap();
    let times: Vec<_> = steps
        .iter()
        .map(|s| (s.time, s.parts[0].time_step))
        .collect();
    assert_eq!(
        times,
        [
            (Some(0.0), Some(0)),
            (Some(0.5), Some(1)),
            (Some(2.0), Some(2))
        ]
    );
    for (step, time) in [(0, 0.0), (1, 0.5), (2, 2.0)] {
        let data = read_at("solids_in_time.vtkhdf", Some(step));
        assert_eq!(numbers(&data, "T"), counted(100.0 * time, 13));
        assert_eq!(numbers(&data, "v:y"), [10.0 * time; 3]);
        let Geometry::Cells(mesh) = &data.geometry else {
            panic!("cells expected");
        };
        assert_eq!(mesh.nodes, nodes(0.0));
        assert_eq!(mesh.cell(2), [2, 5, 11, 8, 12]);
        assert!(data.notes.is_empty(), "{:?}", data.notes);
    }
    let first = read_at("solids_in_time.vtkhdf", None);
    assert_eq!(first.notes, ["The first of 3 time steps, of time 0."]);
    let options = OpenOptions {
        time_step: Some(3),
        ..OpenOptions::default()
    };
    let error = open(&path, &options).unwrap_err().to_string();
    assert!(
        error.contains("one of 3") && error.contains("found 3"),
        "{error}"
    );
}

#[test]
fn polygonal_data() {
    let data = read_at("surface.vtkhdf", None);
    let Geometry::Mesh(mesh) = &data.geometry else {
        panic!("a mesh expected");
    };
    // One triangle, two of the quadrilateral, two of the strip.
    assert_eq!(mesh.parts[0].triangles.len(), 5);
    assert_eq!(mesh.parts[0].colours[1][1], 1.0);
    assert_eq!(
        data.bounds(),
        Some((DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0)))
    );
    assert_eq!(
        data.notes,
        ["2 points and lines are not shown beside the surface"]
    );
}

#[test]
fn blocks_of_a_collection_are_one_data_set() {
    let data = read_at("parts.vtkhdf", None);
    let Geometry::Cells(mesh) = &data.geometry else {
        panic!("cells expected");
    };
    assert_eq!(mesh.nodes, [nodes(0.0), nodes(4.0)].concat());
    assert_eq!(mesh.cell(5), [15, 18, 24, 21, 25]);
    assert_eq!(
        numbers(&data, "T"),
        [counted(0.0, 13), counted(100.0, 13)].concat()
    );
    assert_eq!(numbers(&data, "v:y"), [0., 0., 0., 10., 10., 10.]);
    assert_eq!(data.notes, ["Blocks put together: 2."]);
}

#[test]
fn images_keep_their_directions() {
    for (step, time) in [(0, 0.0), (1, 100.0)] {
        let data = read_at("image_in_time.vtkhdf", Some(step));
        let Geometry::Lattice(lattice) = &data.geometry else {
            panic!("a lattice expected");
        };
        assert_eq!(lattice.dims, [3, 2, 2]);
        assert_eq!(lattice.position([0, 0, 0]), DVec3::new(10., 21., 27.));
        assert_eq!(lattice.position([1, 0, 0]), DVec3::new(10., 22., 27.));
        assert_eq!(lattice.position([0, 1, 0]), DVec3::new(8., 21., 27.));
        assert_eq!(lattice.position([2, 1, 1]), DVec3::new(8., 23., 30.));
        assert_eq!(numbers(&data, "T"), counted(time, 12));
        let expected = if step == 0 { 22.0 } else { 22.5 };
        assert_eq!(numbers(&data, "u:y")[11], expected);
        let cells = if step == 0 { [1.0, 2.0] } else { [3.0, 4.0] };
        assert_eq!(numbers(&data, "n"), cells);
    }
}

#[test]
fn the_finest_level_counts() {
    for (name, step) in [
        ("levels", None),
        ("levels_in_time", Some(0)),
        ("levels_in_time", Some(1)),
    ] {
        let data = read_at(&format!("{name}.vtkhdf"), step);
        let Geometry::Curvilinear { blocks } = &data.geometry else {
            panic!("grids expected");
        };
        let dims: Vec<_> = blocks.iter().map(|block| block.dims).collect();
        assert_eq!(dims, [[3; 3], [3; 3], [5, 5, 3]]);
        assert_eq!(blocks[0].nodes[26], DVec3::new(3.0, 2.0, 2.0));
        assert_eq!(blocks[2].nodes[0], DVec3::new(2.0, 0.0, 0.0));
        assert_eq!(blocks[2].nodes[74], DVec3::new(4.0, 2.0, 1.0));
        let shift = if step == Some(1) { 1000.0 } else { 0.0 };
        let rho = [counted(shift, 16), counted(100.0 + shift, 32)].concat();
        assert_eq!(numbers(&data, "rho"), rho);
        // Marks as VTK writes them.
        let marks = [
            0., 8., 0., 8., 0., 0., 0., 0., 8., 0., 8., 0., 0., 0., 0., 0.,
        ];
        assert_eq!(
            numbers(&data, "vtkGhostType"),
            [&marks[..], &[0.0; 32]].concat()
        );
        let shift = if step == Some(1) { 1.0 } else { 0.0 };
        assert_eq!(numbers(&data, "u:y")[47], -131.0 + shift);
    }
}

#[test]
fn a_file_of_kitwares_is_read() {
    let Some(path) = real_data("formats/hdf/can-vtu.hdf") else {
        return;
    };
    let data = open(&path, &OpenOptions::default()).unwrap();
    let Geometry::Cells(mesh) = &data.geometry else {
        panic!("cells expected");
    };
    assert_eq!((mesh.nodes.len(), mesh.cell_count()), (6724, 4800));
    assert!(mesh.kinds.iter().all(|kind| *kind == CellKind::HEXAHEDRON));
    let names = [
        "ACCL",
        "DISPL",
        "GlobalNodeId",
        "PedigreeNodeId",
        "VEL",
        "EQPS",
    ];
    assert_eq!(data.field_names(), names);
    assert_eq!(numbers(&data, "EQPS")[1234], 1.237_09);
    assert_eq!(numbers(&data, "VEL:y")[4321], -2_274.952);
    assert_eq!(
        mesh.cell(4799),
        [5001, 5042, 6723, 6682, 5000, 5041, 6722, 6681]
    );
}
