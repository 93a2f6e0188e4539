//! Tests CGNS files in HDF5, which VTK's reader reads to the same numbers.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{CellMesh, Dataset, Geometry, OpenOptions, format_of, open, read};
use glam::DVec3;

use crate::support::{at_step, cells, numbers};

fn path(name: &str) -> PathBuf {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    fixtures.join("cgns").join(format!("{name}.cgns"))
}

fn fixture(name: &str, time_step: Option<usize>) -> Dataset {
    at_step(&path(name), time_step)
}

fn kinds(mesh: &CellMesh) -> Vec<u8> {
    mesh.kinds.iter().map(|kind| kind.0).collect()
}

#[test]
fn sections_and_mixed_lists_say_the_same() {
    let linear = |p: &DVec3| (p.x + 2.0 * p.y + 4.0 * p.z) as f32;
    for (name, step, factor, add) in [
        ("sections", 0, 1.0, 0.0),
        ("mixed", 0, 1.0, 1.0),
        ("mixed", 1, 2.0, 2.0),
    ] {
        let data = fixture(name, Some(step));
        let mesh = cells(&data);
        assert_eq!(kinds(mesh), [12, 14, 13, 10], "{name}");
        assert_eq!(mesh.cell(2), [1, 9, 2, 5, 10, 6], "{name}");
        let expected: Vec<f32> = mesh.nodes.iter().map(|p| factor * linear(p)).collect();
        assert_eq!(numbers(&data, "T"), expected, "{name}");
        let pressure = [5.0, 6.0, 7.0, 8.0].map(|x| x + add);
        assert_eq!(numbers(&data, "Pressure"), pressure, "{name}");
        assert_eq!(
            numbers(&data, "Velocity:2"),
            [-1.0, -2.0, -3.0, -4.0],
            "{name}"
        );
    }
    let notes = fixture("sections", None).notes.join(" ");
    assert!(notes.contains("2 pieces of surfaces"), "{notes}");
    let format = format_of(&path("mixed"), &OpenOptions::default()).unwrap();
    let steps = format.time_steps(&path("mixed")).unwrap();
    let times: Vec<_> = steps.iter().map(|step| step.time).collect();
    assert_eq!(times, [Some(0.5), Some(2.0)]);
}

/// A hexahedron and a pyramid above it, by their faces: of version 4, of versions before it, and by the cells on both
/// sides of each face.
#[test]
fn polyhedra_are_cells_of_their_faces() {
    for name in ["polyhedra", "polyhedra_old", "parents"] {
        let data = fixture(name, None);
        let mesh = cells(&data);
        assert_eq!(kinds(mesh), [12, 14], "{name}");
        let sorted = |cell: usize| {
            let mut nodes = mesh.cell(cell).to_vec();
            nodes.sort_unstable();
            nodes
        };
        assert_eq!(sorted(0), [0, 1, 2, 3, 4, 5, 6, 7], "{name}");
        assert_eq!(mesh.cell(1)[4], 8, "{name}");
        assert_eq!(sorted(1), [4, 5, 6, 7, 8], "{name}");
        assert_eq!(numbers(&data, "q"), [1.5, 2.5], "{name}");
    }
}

#[test]
fn structured_zones_are_blocks_without_their_rind() {
    let data = fixture("structured", None);
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!("no curvilinear grid")
    };
    let dims: Vec<[usize; 3]> = blocks.iter().map(|block| block.dims).collect();
    assert_eq!(dims, [[4, 3, 2], [2, 3, 2]]);
    assert_eq!(blocks[0].nodes[23].to_array(), [3.2, 2.2, 1.15]);
    // The second zone's coordinates have planes before and behind.
    assert_eq!(blocks[1].nodes[11].to_array(), [11.2, 2.2, 1.05]);
    let a: Vec<f32> = (0..24).chain(0..12).map(|i: u8| f32::from(i)).collect();
    assert_eq!(numbers(&data, "a"), a);
    let c = numbers(&data, "c");
    assert_eq!(c[..6], [0.5, 1.5, 2.5, 3.5, 4.5, 5.5]);
    assert!(c.len() == 8 && c[6].is_nan() && c[7].is_nan(), "{c:?}");
}

/// Each zone is one element, whose further nodes were made from its corners by the rules of the SIDS.
#[test]
fn nodes_of_second_order_lie_where_vtk_has_them() {
    const EDGES: [(u8, &[[usize; 2]]); 4] = [
        (
            12,
            &[
                [0, 1],
                [1, 2],
                [2, 3],
                [3, 0],
                [4, 5],
                [5, 6],
                [6, 7],
                [7, 4],
                [0, 4],
                [1, 5],
                [2, 6],
                [3, 7],
            ],
        ),
        (
            13,
            &[
                [0, 1],
                [1, 2],
                [2, 0],
                [3, 4],
                [4, 5],
                [5, 3],
                [0, 3],
                [1, 4],
                [2, 5],
            ],
        ),
        (
            14,
            &[
                [0, 1],
                [1, 2],
                [2, 3],
                [3, 0],
                [0, 4],
                [1, 4],
                [2, 4],
                [3, 4],
            ],
        ),
        (10, &[[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]]),
    ];
    let faces: [&[usize]; 7] = [
        &[0, 3, 7, 4],
        &[1, 2, 6, 5],
        &[0, 1, 5, 4],
        &[3, 2, 6, 7],
        &[0, 1, 2, 3],
        &[4, 5, 6, 7],
        &[0, 1, 2, 3, 4, 5, 6, 7],
    ];
    let data = fixture("second", None);
    let mesh = cells(&data);
    assert_eq!(kinds(mesh), [25, 29, 26, 32, 27, 27, 24]);
    for cell in 0..mesh.cell_count() {
        let nodes = mesh.cell(cell);
        let at = |i: usize| mesh.nodes[nodes[i] as usize];
        let corner_kind = match mesh.kinds[cell].0 {
            25 | 29 => 12,
            26 | 32 => 13,
            27 => 14,
            _ => 10,
        };
        let (_, edges) = EDGES.iter().find(|(kind, _)| *kind == corner_kind).unwrap();
        let first = [12, 13, 14, 10]
            .iter()
            .position(|&k| k == corner_kind)
            .map(|i| [8, 6, 5, 4][i])
            .unwrap();
        for (i, [a, b]) in (first..).zip(*edges) {
            let middle = 0.5 * (at(*a) + at(*b));
            assert!((at(i) - middle).length() < 1e-12, "cell {cell}, node {i}");
        }
        if mesh.kinds[cell].0 == 29 {
            for (i, corners) in (20..).zip(faces) {
                let mean = corners.iter().map(|&c| at(c)).sum::<DVec3>() / corners.len() as f64;
                assert!((at(i) - mean).length() < 1e-12, "cell {cell}, node {i}");
            }
        }
    }
    // The faces of the prism follow one another as its sides do.
    assert_eq!(mesh.cell(3)[15..].len(), 3);
}

#[test]
fn what_is_not_in_the_file_is_said() {
    let error = open(&path("linked"), &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("a link to another file") && error.contains("cgnsconvert"),
        "{error}"
    );
    let whole = std::fs::read(path("sections")).unwrap();
    // Under another name it is recognised by the name of the version, if that stands in its first bytes, or refused by
    // that name with a way out.
    if let Err(error) = read("a.h5", &whole, &OpenOptions::default()) {
        assert!(error.to_string().contains("ends in .cgns"), "{error}");
    }
    // Cut anywhere, the file is refused or what it was.
    for len in (1..whole.len()).step_by(97) {
        if let Ok(data) = read("a.cgns", &whole[..len], &OpenOptions::default()) {
            assert_eq!(kinds(cells(&data)), [12, 14, 13, 10], "{len}");
        }
    }
}
