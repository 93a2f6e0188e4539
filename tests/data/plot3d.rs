//! Tests PLOT3D function files: all encodings, with or without names, beside the grid or given,
//! give the numbers that VTK reads.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;

use ewa_splat::io::{Geometry, OpenOptions, open, read_with};

use crate::support::{Folder, Plot3dBlock, Plot3dEncoding, numbers};

/// Returns two grids of 24 and 12 nodes, or the first of them, with `per_node` numbers at each
/// node.
fn blocks(encoding: Plot3dEncoding, per_node: usize, first: f64) -> Vec<Plot3dBlock> {
    let block = |dims: [i32; 3], first: f64| Plot3dBlock {
        dims,
        numbers: (0..per_node * dims.iter().product::<i32>() as usize)
            .map(|i| first + i as f64 / 8.0)
            .collect(),
        iblank: vec![],
    };
    let mut blocks = vec![block([3, 2, 4], first), block([2, 2, 3], 50.0 + first)];
    if !encoding.grid_count {
        blocks.pop();
    }
    blocks
}

/// Returns function `i` of `count` at the nodes of all blocks.
fn function(blocks: &[Plot3dBlock], i: usize, count: usize) -> Vec<f32> {
    let of = |block: &Plot3dBlock| {
        let nodes = block.numbers.len() / count;
        block.numbers[i * nodes..][..nodes]
            .iter()
            .map(|&x| x as f32)
            .collect::<Vec<_>>()
    };
    blocks.iter().flat_map(of).collect()
}

const FIRST: Plot3dEncoding = Plot3dEncoding {
    text: false,
    double: false,
    big_endian: false,
    records: true,
    grid_count: true,
};

/// `ducts.json` holds what `vtkMultiBlockPLOT3DReader` of VTK 9.7 read of the same files.
#[test]
fn functions_are_those_that_vtk_reads() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/plot3d");
    let data = open(&folder.join("ducts.xyz"), &OpenOptions::default()).unwrap();
    assert!(data.notes.is_empty(), "{:?}", data.notes);
    assert_eq!(data.field_names(), ["cp", "q criterion", "T_wall"]);
    let text = std::fs::read_to_string(folder.join("ducts.json")).unwrap();
    let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
    for name in data.field_names() {
        let of_vtk = expected[name].as_array().unwrap();
        let of_vtk: Vec<f32> = of_vtk.iter().map(|x| x.as_f64().unwrap() as f32).collect();
        assert_eq!(of_vtk.len(), 42);
        assert_eq!(numbers(&data, name), of_vtk, "{name}");
    }
    assert_eq!(numbers(&data, "T_wall")[24], 1002.0);
}

#[test]
fn functions_in_every_encoding() {
    for encoding in Plot3dEncoding::all() {
        for (count, trailing) in [(1, 0), (2, 0), (5, 12), (7, 0)] {
            let grids = blocks(encoding, 3, -3.0);
            let functions = blocks(encoding, count, 1.0);
            let mut file = encoding.functions(&functions, count as i32);
            if !encoding.text {
                file.extend(vec![0; trailing]);
            }
            let folder = Folder::new();
            folder.file("fin.fun", &file);
            let data = folder.open("fin.xyz", &encoding.grids(&grids));
            assert!(data.notes.is_empty(), "{:?}", data.notes);
            assert_eq!(data.fields.len(), count, "{encoding:?}");
            for i in 0..count {
                let name = format!("f{}", i + 1);
                let expected = function(&functions, i, count);
                assert_eq!(numbers(&data, &name), expected, "{encoding:?}");
            }
            // Beside a solution, functions precede the derived fields.
            let solutions = blocks(encoding, 5, 1.0);
            folder.file("fin.q", &encoding.solutions(&solutions));
            folder.file("fin.nam", b"Mach\r\n\r\n eddy viscosity ; turbulence \r\n");
            let data = folder.open("fin.xyz", &encoding.grids(&grids));
            let names = data.field_names();
            assert_eq!(names[..4], ["density", "momentum", "energy", "Mach (2)"]);
            assert_eq!(names[names.len() - 1], "mach");
            let named = ["Mach (2)", "eddy viscosity", "f3"];
            for (i, name) in named.into_iter().enumerate().take(count) {
                let expected = function(&functions, i, count);
                assert_eq!(numbers(&data, name), expected, "{encoding:?}");
            }
            assert_eq!(data.notes.len(), usize::from(count != 2));
            assert_eq!(numbers(&data, "energy"), function(&solutions, 4, 5));
        }
    }
}

#[test]
fn functions_and_solutions_are_given_by_one_option() {
    let folder = Folder::new();
    let functions = FIRST.functions(&blocks(FIRST, 2, 1.0), 2);
    let solutions = FIRST.solutions(&blocks(FIRST, 5, 1.0));
    let grid = folder.file("a.xyz", &FIRST.grids(&blocks(FIRST, 3, 0.0)));
    folder.file("a.q", &solutions);
    for name in ["other.f", "other.dat"] {
        let options = OpenOptions {
            solution: Some(folder.file(name, &functions)),
            ..OpenOptions::default()
        };
        let data = open(&grid, &options).unwrap();
        assert_eq!(numbers(&data, "f2")[0], 4.0, "{name}");
        assert_eq!(numbers(&data, "density")[0], 1.0, "{name}");
    }
    let options = OpenOptions {
        solution: Some(folder.file("other.bin", &solutions)),
        ..OpenOptions::default()
    };
    folder.file("a.f", &functions);
    let data = open(&grid, &options).unwrap();
    assert_eq!(
        data.field_names()[..5],
        ["density", "momentum", "energy", "f1", "f2"]
    );

    // From memory.
    let beside = |path: &Path| match path.to_str()? {
        "a.fun" => Some(functions.clone()),
        "a.nam" => Some(b"lift\ndrag\n".to_vec()),
        _ => None,
    };
    let bytes = std::fs::read(&grid).unwrap();
    let data = read_with("a.g", &bytes, &OpenOptions::default(), &beside).unwrap();
    assert_eq!(data.field_names(), ["lift", "drag"]);
}

#[test]
fn functions_that_do_not_fit_are_explained() {
    let folder = Folder::new();
    let grid = FIRST.grids(&blocks(FIRST, 3, 0.0));
    let functions = FIRST.functions(&blocks(FIRST, 2, 1.0), 2);
    folder.file("cut.f", &functions[..functions.len() - 4]);
    let cut = folder.refuse("cut.xyz", &grid);
    assert!(
        cut.contains("cut.f: PLOT3D functions of") && cut.contains("2 functions of the first"),
        "{cut}"
    );
    let mut other = blocks(FIRST, 2, 1.0);
    other[1].dims = [2, 3, 2];
    folder.file("other.f", &FIRST.functions(&other, 2));
    let other = folder.refuse("other.xyz", &grid);
    assert!(
        other.contains("2 x 2 x 3 nodes in grid 2") && other.contains("found 2 x 3 x 2"),
        "{other}"
    );
    let alone = folder.refuse("alone.f", &functions);
    assert!(alone.contains("functions at nodes"), "{alone}");

    // Fortran source files have the same extension.
    for program in [
        "      PROGRAM GRID\n",
        "c     makes a grid\n",
        "! makes a grid\n",
    ] {
        folder.file("made.f", program.as_bytes());
        assert!(
            folder.open("made.xyz", &grid).fields.is_empty(),
            "{program}"
        );
    }

    // The second grid has one more function.
    let mut words = vec![FIRST.word(2), FIRST.words(&[3, 2, 4, 1, 2, 2, 3, 2])];
    words.push(FIRST.reals(&[1.5; 24]));
    words.push(FIRST.reals(&[2.5; 24]));
    folder.file("uneven.f", &FIRST.file(&words));
    let uneven = folder.open("uneven.xyz", &grid);
    assert_eq!(uneven.field_names(), ["f1"]);
    assert_eq!(numbers(&uneven, "f1")[23..25], [1.5, 2.5]);
    assert!(
        uneven.notes[0].starts_with("Of 2 functions"),
        "{:?}",
        uneven.notes
    );

    // A short text claims many functions by repeating a number.
    let text = Plot3dEncoding {
        text: true,
        ..FIRST
    };
    folder.file("many.f", b"1\n1 1 1 5000\n5000*1\n");
    let many = folder.refuse("many.xyz", &text.grid([1, 1, 1], &[0.0; 3], None));
    assert!(many.contains("at most 20 numbers"), "{many}");
}

/// Two-dimensional files have no nk, no z and no momentum along z; they become a layer at z = 0.
#[test]
fn files_of_two_dimensions_are_layers() {
    let folder = Folder::new();
    let words = |words: &[u32]| {
        words
            .iter()
            .flat_map(|w| w.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let reals = |reals: &[f32]| {
        reals
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let x = [0.0, 1.0, 2.0, 0.0, 1.0, 2.0];
    let y = [0.0, 0.0, 0.0, 1.0, 1.5, 1.0];
    let mut grid = words(&[3, 2]);
    grid.extend(reals(&[x, y].concat()));
    let mut solution = words(&[3, 2]);
    let state = [[1.0; 6], [2.0; 6], [0.0; 6], [5.0; 6]].concat();
    solution.extend(reals(&[&[0.5, 0.0, 1.0, 0.0][..], &state].concat()));
    let mut functions = words(&[3, 2, 1]);
    functions.extend(reals(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    folder.file("flat.q", &solution);
    folder.file("flat.f", &functions);
    let data = folder.open("flat.xyz", &grid);
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!("a grid is expected");
    };
    assert_eq!(blocks[0].dims, [3, 2, 1]);
    assert_eq!(blocks[0].nodes[4].to_array(), [1.0, 1.5, 0.0]);
    let first = |name: &str| data.scalar(name).unwrap().1.get(0);
    assert_eq!(data.scalar("f1").unwrap().1.get(5), 6.0);
    assert_eq!(
        (
            first("momentum:x"),
            first("momentum:y"),
            first("momentum:z")
        ),
        (2.0, 0.0, 0.0)
    );
    // p = (gamma - 1) (e - rho u^2 / 2).
    assert!((first("pressure") - 0.4 * 3.0).abs() < 1e-6);
    let alone = folder.refuse("other.xyz", &solution);
    assert!(alone.contains("a solution"), "{alone}");
}

/// VTK's own file holds two grids of 11 x 17 nodes each, in double precision.
#[test]
fn vtk_s_grids_of_two_dimensions_are_read() {
    let Some(path) = crate::common::case("grids/multi-bin-2D.xyz") else {
        return;
    };
    let data = ewa_splat::io::open(&path, &OpenOptions::default()).unwrap();
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!("a grid is expected");
    };
    let dims: Vec<_> = blocks.iter().map(|block| block.dims).collect();
    assert_eq!(dims, [[11, 17, 1], [11, 17, 1]]);
    assert!(
        blocks
            .iter()
            .flat_map(|b| &b.nodes)
            .all(|p| p.is_finite() && p.z == 0.0)
    );
}
