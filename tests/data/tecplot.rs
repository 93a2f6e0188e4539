//! Tests Tecplot's text files.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{Association, CellKind, Dataset, Geometry, OpenOptions, format_of, read};

use crate::support::tecplot::{BRICKS, LAYER, LINE, OLD, ORDERED, SURFACE};

fn data(text: &str) -> Dataset {
    at_step(text, None).unwrap()
}

fn at_step(text: &str, time_step: Option<usize>) -> ewa_splat::Result<Dataset> {
    let options = OpenOptions {
        time_step,
        ..OpenOptions::default()
    };
    read("a.dat", text.as_bytes(), &options)
}

fn numbers(data: &Dataset, selector: &str) -> (Association, Vec<f32>) {
    let (association, values) = data.scalar(selector).unwrap();
    (
        association,
        (0..values.len()).map(|i| values.get(i)).collect(),
    )
}

#[test]
fn ordered_zones_are_grids() {
    let data = data(ORDERED);
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!("blocks expected");
    };
    assert_eq!(blocks.len(), 2);
    assert_eq!((blocks[0].dims, blocks[1].dims), ([2, 2, 3], [2, 2, 2]));
    assert_eq!(blocks[0].nodes[10].to_array(), [0.0, 1.0, 2.5]);
    assert_eq!(blocks[1].nodes[7].to_array(), [6.0, 1.0, 1.0]);
    let (association, p) = numbers(&data, "p");
    assert_eq!(association, Association::Nodes);
    let expected: Vec<f32> = (1..=12).chain(1..=8).map(|i| i as f32).collect();
    assert_eq!(p, expected);
    assert_eq!(data.field_names(), ["p"]);
}

#[test]
fn a_layer_is_a_surface() {
    let data = data(LAYER);
    let Geometry::Mesh(mesh) = &data.geometry else {
        panic!("a mesh expected");
    };
    assert_eq!(mesh.parts[0].triangles.len(), 4);
    assert_eq!(
        numbers(&data, "c"),
        (Association::Cells, vec![7.5, 7.5, 8.5, 8.5])
    );
    assert_eq!(numbers(&data, "p").1, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let (low, high) = data.bounds().unwrap();
    assert_eq!(
        (low.to_array(), high.to_array()),
        ([0.0; 3], [2.0, 1.0, 0.0])
    );
}

#[test]
fn elements_are_cells_of_each_time() {
    let first = data(BRICKS);
    let Geometry::Cells(mesh) = &first.geometry else {
        panic!("cells expected");
    };
    let kinds = [
        CellKind::HEXAHEDRON,
        CellKind::WEDGE,
        CellKind::PYRAMID,
        CellKind::TETRA,
    ];
    assert_eq!(mesh.kinds, kinds);
    assert_eq!(mesh.cell(1), [0, 2, 1, 4, 6, 5]);
    assert_eq!(mesh.cell(2), [4, 5, 6, 7, 8]);
    assert_eq!(mesh.cell(3), [5, 9, 6, 8]);
    assert_eq!(mesh.nodes[9].to_array(), [2.0, 0.5, 1.5]);
    assert_eq!(
        numbers(&first, "c"),
        (Association::Cells, vec![10.0, 20.0, 30.0, 40.0])
    );
    assert_eq!(first.notes, ["The first of 2 time steps, of time 0.25."]);

    let second = at_step(BRICKS, Some(1)).unwrap();
    assert_eq!(second.bounds(), first.bounds());
    assert_eq!(numbers(&second, "p").1, [-1.0; 10]);
    assert_eq!(numbers(&second, "c").1, [50.0; 4]);
    assert!(at_step(BRICKS, Some(2)).is_err());

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.plt");
    std::fs::write(&path, BRICKS).unwrap();
    let format = format_of(&path, &OpenOptions::default()).unwrap();
    let times: Vec<_> = format
        .time_steps(&path)
        .unwrap()
        .iter()
        .map(|s| s.time)
        .collect();
    assert_eq!(times, [Some(0.25), Some(0.5)]);
}

#[test]
fn old_headers_and_surfaces_of_elements_are_read() {
    let old = data(OLD);
    let Geometry::Cells(mesh) = &old.geometry else {
        panic!("cells expected");
    };
    assert_eq!(mesh.kinds, [CellKind::TETRA; 2]);
    assert_eq!(mesh.connectivity, [0, 1, 2, 3, 1, 2, 3, 4]);
    assert_eq!(numbers(&old, "p").1, [1.0, 2.0, 3.0, 4.0, 5.0]);
    let surface = data(SURFACE);
    let Geometry::Mesh(mesh) = &surface.geometry else {
        panic!("a mesh expected");
    };
    assert_eq!(mesh.parts[0].triangles.len(), 3);
    let line = data(LINE);
    let Geometry::Points { positions } = &line.geometry else {
        panic!("points expected");
    };
    assert_eq!(positions[2].to_array(), [2.0, 0.0, 0.0]);
    assert!(line.notes[0].contains("`lon`, `lat`"), "{:?}", line.notes);
}

#[test]
fn damage_is_said_by_line() {
    for (text, from, to, expected) in [
        (
            ORDERED,
            "1 1 1 8",
            "1 1 1 x",
            "ZONE, line 13: expected a number, found `x`",
        ),
        (LAYER, "3*0", "99999999*0", "more, by repetition"),
        (LAYER, "DATAPACKING=BLOCK", "DATAPACKING=POINT", "BLOCK"),
        (
            BRICKS,
            "5 6 7 8 9 9 9 9",
            "5 6 7 8 9 9 9 11",
            "a node from 1 to 10",
        ),
        (BRICKS, "([1-3]=1)", "([1-3]=7)", "zone 7"),
        (BRICKS, "FEBRICK", "FEPOLYHEDRON", "FEPOLYHEDRON"),
        (OLD, "N=5", "N=many", "a whole number"),
        (OLD, "N=5", "N=999999999999", "a number"),
        (LINE, "I=3", "I=0", "one node or more"),
    ] {
        assert!(text.contains(from));
        let error = at_step(&text.replacen(from, to, 1), None)
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{to}: {error}");
    }
}

/// Some programs give either key the values of the other.
#[test]
fn blocks_of_elements_may_be_called_so_by_either_key() {
    let text = |packing: &str| {
        format!(
            "VARIABLES=\"X\",\"Y\",\"Z\",\"P\"\nZONE N=4, E=1, ET=QUADRILATERAL, {packing}, \
             VARLOCATION=([4]=CELLCENTERED)\n0 1 1 0 2 2 1 1 0 0 0 0\n7.5\n1 2 3 4\n"
        )
    };
    for packing in ["DATAPACKING=FEBLOCK", "F=FEBLOCK", "DATAPACKING=BLOCK"] {
        let data = data(&text(packing));
        let (association, p) = numbers(&data, "p");
        // One cell gives two triangles.
        assert_eq!(
            (association, p),
            (Association::Cells, vec![7.5, 7.5]),
            "{packing}"
        );
    }
}

/// VTK's test file of cell values, in blocks and elements.
#[test]
fn vtk_s_file_of_cell_values_is_read() {
    let Some(path) = crate::common::case("grids/cellcentered.tec") else {
        return;
    };
    let data = ewa_splat::io::open(&path, &OpenOptions::default()).unwrap();
    let (association, p) = numbers(&data, "P");
    assert_eq!(
        (association, p),
        (Association::Cells, vec![1.0, 1.0, 2.0, 2.0])
    );
    let (_, t) = numbers(&data, "T");
    assert_eq!(t, [15.0, 15.0, -15.0, -15.0]);
    let (association, v) = numbers(&data, "V");
    assert_eq!(association, Association::Nodes);
    assert_eq!(v, [0.2, 0.25, 0.3, 0.05, 0.2, 0.25, 0.3, 0.05]);
}
