//! Tests Gmsh's meshes, written by Gmsh: they give the numbers that Gmsh was given, and the elements that meshio reads.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{Association, CellMesh, Dataset, Geometry, OpenOptions, format_of, read};
use glam::DVec3;

use crate::support::{at_step, cells, numbers};

/// Files of the same mesh and results in each version and form, two of them in big-endian order.
const FORMS: [&str; 7] = [
    "solids22t",
    "solids22b",
    "solids22big",
    "solids40t",
    "solids41t",
    "solids41b",
    "solids41big",
];

fn path(name: &str) -> PathBuf {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    fixtures.join("gmsh").join(format!("{name}.msh"))
}

fn fixture(name: &str, time_step: Option<usize>) -> Dataset {
    at_step(&path(name), time_step)
}

#[test]
fn all_forms_say_what_gmsh_was_given() {
    for name in FORMS {
        let format = format_of(&path(name), &OpenOptions::default()).unwrap();
        let steps = format.time_steps(&path(name)).unwrap();
        let times: Vec<_> = steps.iter().map(|step| step.time).collect();
        assert_eq!(times, [Some(0.5), Some(2.0)], "{name}");
        for (step, number) in [(0, 0.0), (1, 3.0)] {
            let data = fixture(name, Some(step));
            let mesh = cells(&data);
            assert_eq!(mesh.nodes.len(), 12, "{name}");
            assert_eq!(mesh.nodes[11].to_array(), [2.5, 1.5, 0.5], "{name}");
            let temperature = numbers(&data, "T");
            for (node, t) in mesh.nodes.iter().zip(&temperature) {
                let expected = 10.0 * number + node.x + 2.0 * node.y + 4.0 * node.z;
                assert!((f64::from(*t) - expected).abs() < 1e-6, "{name}: {t}");
            }
            // The elements 5 to 8 are a hexahedron, a pyramid, a prism and a tetrahedron.
            let flow: Vec<Vec<f32>> = (0..3)
                .map(|i| numbers(&data, &format!("flow:{i}")))
                .collect();
            assert_eq!(mesh.cell_count(), 4, "{name}");
            for (i, kind) in mesh.kinds.iter().enumerate() {
                let element = match kind.0 {
                    12 => 5.0,
                    14 => 6.0,
                    13 => 7.0,
                    10 => 8.0,
                    other => panic!("{name}: kind {other}"),
                };
                let expected = [number as f32 + element, element / 3.0, -element];
                let found = [flow[0][i], flow[1][i], flow[2][i]];
                let is_near = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
                assert!(
                    found.iter().zip(&expected).all(is_near),
                    "{name}: {found:?}"
                );
            }
            // The hexahedron has 1 to 8 at its nodes, the prism 10 to 60; they share nodes 2, 3, 6 and 7.
            let means = [1.0, 6.0, 16.5, 4.0, 5.0, 23.0, 33.5, 8.0];
            let corner = numbers(&data, "corner");
            assert_eq!(corner[..8], means, "{name}");
            assert!(corner[8].is_nan() && corner[11].is_nan(), "{name}");
            assert_eq!(corner[9..11], [20.0, 50.0], "{name}");
            assert_eq!(numbers(&data, "gmsh:physical"), [21.0; 4], "{name}");
            assert_eq!(numbers(&data, "gmsh:geometrical"), [7.0; 4], "{name}");
            let of_groups = data
                .fields
                .iter()
                .find(|f| f.name == "gmsh:physical")
                .unwrap();
            assert_eq!(of_groups.association, Association::Cells);
            let notes = data.notes.join(" ");
            assert!(
                notes.contains("2 pieces of surfaces") && notes.contains("21 `fluid`"),
                "{notes}"
            );
        }
        let notes = fixture(name, None).notes.join(" ");
        assert!(
            notes.contains("The first of 2 time steps, of time 0.5"),
            "{notes}"
        );
    }
}

/// Node `i` of a cell is the mean of some of its corners, by VTK's definition of the cell.
fn lies_between(mesh: &CellMesh, cell: usize, i: usize, corners: &[usize]) {
    let nodes = mesh.cell(cell);
    let at = |i: usize| mesh.nodes[nodes[i] as usize];
    let mean = corners.iter().map(|&c| at(c)).sum::<DVec3>() / corners.len() as f64;
    let kind = mesh.kinds[cell].name();
    assert!(
        (at(i) - mean).length() < 1e-12,
        "{kind}, node {i}: {} and {mean}",
        at(i)
    );
}

const TETRAHEDRON: &[&[usize]] = &[&[0, 1], &[1, 2], &[2, 0], &[0, 3], &[1, 3], &[2, 3]];
const HEXAHEDRON: &[&[usize]] = &[
    &[0, 1],
    &[1, 2],
    &[2, 3],
    &[3, 0],
    &[4, 5],
    &[5, 6],
    &[6, 7],
    &[7, 4],
    &[0, 4],
    &[1, 5],
    &[2, 6],
    &[3, 7],
    &[0, 3, 7, 4],
    &[1, 2, 6, 5],
    &[0, 1, 5, 4],
    &[3, 2, 6, 7],
    &[0, 1, 2, 3],
    &[4, 5, 6, 7],
    &[0, 1, 2, 3, 4, 5, 6, 7],
];
const WEDGE: &[&[usize]] = &[
    &[0, 1],
    &[1, 2],
    &[2, 0],
    &[3, 4],
    &[4, 5],
    &[5, 3],
    &[0, 3],
    &[1, 4],
    &[2, 5],
    &[0, 1, 4, 3],
    &[1, 2, 5, 4],
    &[2, 0, 3, 5],
];
const PYRAMID: &[&[usize]] = &[
    &[0, 1],
    &[1, 2],
    &[2, 3],
    &[3, 0],
    &[0, 4],
    &[1, 4],
    &[2, 4],
    &[3, 4],
];

#[test]
fn nodes_of_second_order_lie_where_vtk_has_them() {
    for (name, counts) in [
        ("second", [10, 27, 18, 13]),
        ("serendipity", [10, 20, 15, 13]),
    ] {
        let data = fixture(name, None);
        let mesh = cells(&data);
        let mut found = Vec::new();
        for (cell, kind) in mesh.kinds.iter().enumerate() {
            let between = match kind.0 {
                24 => TETRAHEDRON,
                25 | 29 => HEXAHEDRON,
                26 | 32 => WEDGE,
                27 => PYRAMID,
                other => panic!("kind {other}"),
            };
            let count = mesh.cell(cell).len();
            found.push(count);
            let corners = kind.faces().unwrap().iter().flat_map(|face| face.iter());
            let first = usize::from(*corners.max().unwrap()) + 1;
            for (i, corners) in (first..count).zip(between) {
                lies_between(mesh, cell, i, corners);
            }
        }
        assert_eq!(found, counts, "{name}");
    }
    // As meshio reads the first two elements, but for the faces of the hexahedron, of which it exchanges two.
    let data = fixture("second", None);
    assert_eq!(
        cells(&data).cell(0),
        [2, 16, 17, 18, 19, 20, 21, 22, 24, 23]
    );
    let edges = [
        0, 1, 2, 3, 4, 12, 13, 14, 5, 10, 9, 8, 28, 30, 31, 29, 7, 25, 26, 27,
    ];
    assert_eq!(cells(&data).cell(1)[..20], edges);
}

#[test]
fn files_may_end_anywhere() {
    for name in FORMS {
        let whole = std::fs::read(path(name)).unwrap();
        let end = whole
            .windows(12)
            .rposition(|w| w == b"$EndElements")
            .unwrap()
            + 12;
        for len in 1..whole.len() {
            match read("a.msh", &whole[..len], &OpenOptions::default()) {
                // All elements are there, and whole sections of results.
                Ok(data) => {
                    assert!(len >= end, "{name}: {len}");
                    assert_eq!(cells(&data).cell_count(), 4);
                }
                Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
            }
        }
    }
}

#[test]
fn surfaces_are_meshes_and_mistakes_are_named_by_line() {
    let surface = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n5 1 1 0\n4 0 1 0\n$EndNodes\n\
                   $Elements\n3\n1 1 2 0 1 1 2\n2 2 2 7 1 1 2 5\n3 2 2 8 1 1 5 4\n$EndElements\n";
    let text = |text: &str| read("a.msh", text.as_bytes(), &OpenOptions::default());
    let data = text(surface).unwrap();
    let Geometry::Mesh(mesh) = &data.geometry else {
        panic!("no mesh")
    };
    assert_eq!(mesh.parts[0].triangles.len(), 2);
    assert_eq!(numbers(&data, "gmsh:physical"), [7.0, 8.0]);
    assert!(data.notes.join(" ").contains("1 lines"), "{:?}", data.notes);
    for (from, to, says) in [
        ("8 1 1 5 4\n", "8 1 1 5 3\n", "node 3"),
        ("8 1 1 5 4\n", "8 1 1 5\n", "line 15"),
        ("2.2 0 8", "3 0 8", "version 2, 4.0 or 4.1"),
        ("2.2 0 8", "2.2 0 16", "4 or 8 bytes"),
        ("\n4 0 1 0", "\n5 0 1 0", "node 5 again"),
        ("1 1 0\n", "1 one 0\n", "`one`"),
        ("$Nodes\n4", "$Nodes\n5", "the number of a node"),
        ("$Nodes\n4", "$Nodes\n3", "`$EndNodes`"),
        ("$Elements", "$Elemente", "`$EndElemente`"),
        (
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n",
            "$Other\n1\n$EndOther\n",
            "`$MeshFormat`",
        ),
    ] {
        let error = text(&surface.replacen(from, to, 1))
            .unwrap_err()
            .to_string();
        assert!(error.contains(says), "{to}: {error}");
    }
}

#[test]
fn elements_of_two_groups_are_one() {
    // As Gmsh lists an entity of two physical groups; an entity whose number is not known stays as it is.
    let in_turn = [(1, 1), (2, 1), (1, 2), (2, 2)];
    let by_group = [(1, 1), (1, 2), (2, 1), (2, 2)];
    for (entity, order, expected) in [(7, in_turn, 2), (7, by_group, 2), (0, by_group, 4)] {
        let mut text = String::from("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n");
        text += "1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n$EndNodes\n$Elements\n4\n";
        for (number, (group, element)) in (1..).zip(order) {
            let nodes = ["1 2 3 4", "2 3 4 5"][element - 1];
            text += &format!("{number} 4 2 {group} {entity} {nodes}\n");
        }
        text += "$EndElements\n";
        let data = read("a.msh", text.as_bytes(), &OpenOptions::default()).unwrap();
        assert_eq!(cells(&data).cell_count(), expected);
        let is_told = data.notes.iter().any(|note| note.contains("2 elements"));
        assert_eq!(is_told, expected == 2, "{:?}", data.notes);
    }
}
