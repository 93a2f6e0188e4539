//! Tests legacy VTK files: every kind of data set in every version, encoding and kind of line end
//! gives the original data.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use crate::support::vtk_legacy::LegacyVtk;
use ewa_splat::Result;
use ewa_splat::io::{Association, CellKind, CellMesh, Dataset, Geometry, OpenOptions, open};
use ewa_splat::scene::{LatticeSpacing, Values};
use glam::DVec3;

fn try_read(bytes: &[u8]) -> Result<Dataset> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    open(file.path(), &OpenOptions::default())
}

fn read(vtk: &LegacyVtk) -> Dataset {
    try_read(&vtk.file).unwrap_or_else(|e| panic!("{e}\n{}", String::from_utf8_lossy(&vtk.file)))
}

fn refuse(text: &str) -> String {
    try_read(text.as_bytes()).unwrap_err().to_string()
}

/// Writes a data set in all ways, and reads it.
fn read_all(write: impl Fn(&mut LegacyVtk)) -> Vec<(LegacyVtk, Dataset)> {
    let read_one = |mut vtk: LegacyVtk| {
        write(&mut vtk);
        let data = read(&vtk);
        (vtk, data)
    };
    LegacyVtk::all().into_iter().map(read_one).collect()
}

fn f32s(count: usize, f: impl Fn(usize) -> f32) -> Vec<f32> {
    (0..count).map(f).collect()
}

/// Returns coordinates that are exact in single precision.
fn coordinates(points: usize) -> Vec<f32> {
    f32s(3 * points, |i| i as f32 * 0.25 - 2.0)
}

fn positions(points: usize) -> Vec<DVec3> {
    let as_position = |c: &[f32]| DVec3::new(c[0].into(), c[1].into(), c[2].into());
    coordinates(points).chunks(3).map(as_position).collect()
}

fn write_points(vtk: &mut LegacyVtk, points: usize) {
    let heading = format!("POINTS {points}");
    vtk.array(
        &heading,
        &crate::support::float32("", 3, &coordinates(points)),
    );
}

/// Writes one array of points, and one of cells unless there are none.
fn write_values(vtk: &mut LegacyVtk, points: usize, cells: usize) {
    if cells > 0 {
        vtk.line(&format!("CELL_DATA {cells}"));
        let values: Vec<i16> = (0..cells as i16).map(|i| -7 * i).collect();
        vtk.field(&[crate::support::int16("c", 1, &values)]);
    }
    vtk.line(&format!("POINT_DATA {points}"));
    vtk.line("SCALARS p float");
    vtk.line("LOOKUP_TABLE default");
    vtk.numbers(&crate::support::float32(
        "",
        1,
        &f32s(points, |i| i as f32 / 8.0),
    ));
}

fn check_values(data: &Dataset, points: usize, cells: usize) {
    let expected = Values::F32(f32s(points, |i| i as f32 / 8.0));
    assert_eq!(data.scalar("p").unwrap(), (Association::Nodes, expected));
    if cells > 0 {
        let expected = Values::I16((0..cells as i16).map(|i| -7 * i).collect());
        assert_eq!(data.scalar("c").unwrap(), (Association::Cells, expected));
    }
    assert_eq!(data.fields.len(), 1 + usize::from(cells > 0));
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}

#[test]
fn structured_points_become_a_lattice() {
    for sections in [
        "DIMENSIONS 2 3 4\nORIGIN 1 2 3\nSPACING 0.5 0.25 2",
        "spacing 0.5 0.25 2\nOrigin 1 2 3\ndimensions 2 3 4",
        "ASPECT_RATIO 0.5 0.25 2\nORIGIN 1 2 3\nDIMENSIONS 2 3 4",
        "EXTENT -2 -1 4 6 0 3\nSPACING 0.5 0.25 2\nORIGIN 2.0 1.0 3",
    ] {
        for (_, data) in read_all(|vtk| {
            vtk.line("DATASET STRUCTURED_POINTS");
            vtk.lines(sections);
            write_values(vtk, 24, 6);
        }) {
            let Geometry::Lattice(lattice) = &data.geometry else {
                panic!("{sections}");
            };
            assert_eq!(lattice.dims, [2, 3, 4]);
            assert_eq!(lattice.position([0; 3]), DVec3::new(1.0, 2.0, 3.0));
            assert_eq!(lattice.position([1, 2, 3]), DVec3::new(1.5, 2.5, 9.0));
            check_values(&data, 24, 6);
        }
    }
}

#[test]
fn rectilinear_grids_keep_their_coordinates() {
    for (_, data) in read_all(|vtk| {
        vtk.lines("DATASET RECTILINEAR_GRID\nDIMENSIONS 2 3 4");
        vtk.array(
            "X_COORDINATES 2",
            &crate::support::float64("", 1, &[-1.0, 1e9 + 0.5]),
        );
        vtk.array(
            "Z_COORDINATES 4",
            &crate::support::int16("", 1, &[-5, -4, 0, 300]),
        );
        vtk.array(
            "Y_COORDINATES 3",
            &crate::support::float32("", 1, &[0.5, 0.75, 2.5]),
        );
        write_values(vtk, 24, 6);
    }) {
        let Geometry::Lattice(lattice) = &data.geometry else {
            panic!();
        };
        let coordinates = [
            vec![-1.0, 1e9 + 0.5],
            vec![0.5, 0.75, 2.5],
            vec![-5.0, -4.0, 0.0, 300.0],
        ];
        assert_eq!(lattice.dims, [2, 3, 4]);
        assert_eq!(lattice.spacing, LatticeSpacing::Rectilinear { coordinates });
        check_values(&data, 24, 6);
    }
}

#[test]
fn structured_grids_are_curvilinear() {
    for (_, data) in read_all(|vtk| {
        vtk.lines("DATASET STRUCTURED_GRID\nDIMENSIONS 2 3 4");
        write_points(vtk, 24);
        vtk.array("BLANKING 24", &crate::support::uint8("", 1, &[1; 24]));
        write_values(vtk, 24, 6);
    }) {
        let Geometry::Curvilinear { blocks } = &data.geometry else {
            panic!();
        };
        assert_eq!(blocks.len(), 1);
        assert_eq!(blocks[0].dims, [2, 3, 4]);
        assert_eq!(blocks[0].nodes, positions(24));
        check_values(&data, 24, 6);
    }
}

#[test]
fn unstructured_grids_keep_their_cells() {
    let cells: [&[i32]; 5] = [
        &[0, 1, 2, 3],
        &[7, 6, 5, 4, 3, 2, 1, 0],
        // A tetrahedron as a polyhedron: four faces.
        &[4, 3, 0, 1, 2, 3, 0, 1, 3, 3, 0, 2, 3, 3, 1, 2, 3],
        &[8],
        &[5, 6, 7, 8, 4],
    ];
    let kinds = [10, 12, 42, 1, 14];
    let mut offsets = vec![0];
    for cell in cells {
        offsets.push(offsets[offsets.len() - 1] + cell.len() as u32);
    }
    let mesh = CellMesh {
        nodes: positions(9),
        kinds: kinds.map(CellKind).to_vec(),
        offsets,
        connectivity: cells.concat().iter().map(|&n| n as u32).collect(),
    };
    for (vtk, data) in read_all(|vtk| {
        vtk.line("DATASET UNSTRUCTURED_GRID");
        write_points(vtk, 9);
        vtk.cells("CELLS", &cells);
        vtk.line("CELL_TYPES 5");
        vtk.numbers(&crate::support::int32("", 1, &kinds.map(i32::from)));
        write_values(vtk, 9, 5);
    }) {
        let Geometry::Cells(found) = &data.geometry else {
            panic!();
        };
        assert_eq!(*found, mesh, "{}", vtk.version);
        check_values(&data, 9, 5);
    }
}

#[test]
fn polygonal_data_has_its_cells_in_the_order_of_its_cell_data() {
    for (_, data) in read_all(|vtk| {
        vtk.line("DATASET POLYDATA");
        write_points(vtk, 6);
        vtk.cells("LINES", &[&[0, 1], &[1, 2, 3]]);
        vtk.cells("VERTICES", &[&[5], &[3, 4]]);
        write_values(vtk, 6, 4);
    }) {
        let Geometry::Cells(mesh) = &data.geometry else {
            panic!();
        };
        let kinds: Vec<u8> = mesh.kinds.iter().map(|kind| kind.0).collect();
        assert_eq!(kinds, [1, 2, 3, 4]);
        assert_eq!(mesh.cell(0), [5]);
        assert_eq!(mesh.cell(3), [1, 2, 3]);
        check_values(&data, 6, 4);
    }
}

#[test]
fn vertices_and_bare_points_are_particles() {
    for (_, data) in read_all(|vtk| {
        vtk.line("DATASET POLYDATA");
        write_points(vtk, 3);
        vtk.cells("VERTICES", &[&[2], &[0], &[1]]);
        write_values(vtk, 3, 3);
    }) {
        let Geometry::Points { positions: found } = &data.geometry else {
            panic!();
        };
        assert_eq!(*found, positions(3));
        // Vertex 0 is point 2.
        let own = Values::I16(vec![-7, -14, 0]);
        assert_eq!(data.scalar("c").unwrap(), (Association::Nodes, own));
    }
    for kind in ["POLYDATA", "UNSTRUCTURED_GRID"] {
        for (_, data) in read_all(|vtk| {
            vtk.line(&format!("DATASET {kind}"));
            write_points(vtk, 3);
            write_values(vtk, 3, 0);
        }) {
            assert!(matches!(data.geometry, Geometry::Points { .. }));
            check_values(&data, 3, 0);
        }
    }
}

/// Positions are decoded in chunks of some thousands.
#[test]
fn many_points_keep_their_order() {
    for binary in [false, true] {
        let mut vtk = LegacyVtk::new("3.0", binary, false);
        vtk.line("DATASET POLYDATA");
        write_points(&mut vtk, 10_001);
        let Geometry::Points { positions: found } = read(&vtk).geometry else {
            panic!();
        };
        assert!(found == positions(10_001), "binary {binary}");
    }
}

/// Writes every kind of attribute, with everything that may come between them.
fn write_attributes(vtk: &mut LegacyVtk) {
    let of = |components: usize| f32s(4 * components, |i| i as f32 + 0.5);
    vtk.lines(
        "METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\n\
         DATA 2 0.5 1.5\n\nPOINT_DATA 4",
    );
    vtk.lines("SCALARS three unsigned_char 3\nLOOKUP_TABLE own");
    vtk.numbers(&crate::support::uint8(
        "",
        3,
        &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 255],
    ));
    vtk.line("LOOKUP_TABLE own 2");
    if vtk.binary {
        vtk.numbers(&crate::support::uint8(
            "",
            4,
            &[0, 10, 13, 32, 255, 0, 0, 1],
        ));
    } else {
        vtk.numbers(&crate::support::float32(
            "",
            4,
            &[0.0, 0.1, 0.2, 1.0, 1.0, 0.0, 0.0, 1.0],
        ));
    }
    vtk.line("COLOR_SCALARS colours 2");
    let bytes = [0, 1, 127, 128, 200, 254, 255, 51];
    if vtk.binary {
        vtk.numbers(&crate::support::uint8("", 2, &bytes));
    } else {
        vtk.numbers(&crate::support::float32(
            "",
            2,
            &bytes.map(|b| f32::from(b) / 255.0),
        ));
    }
    vtk.array(
        "VECTORS wind%20speed",
        &crate::support::float32("", 3, &of(3)),
    );
    vtk.lines("METADATA\nCOMPONENT_NAMES\neast\nnorth%20east\nSCALARS\n");
    vtk.line("");
    vtk.array("NORMALS n", &crate::support::float32("", 3, &of(3)));
    vtk.array("TENSORS t", &crate::support::float32("", 9, &of(9)));
    vtk.array("TENSORS6 t6", &crate::support::float32("", 6, &of(6)));
    vtk.array(
        "TEXTURE_COORDINATES uv 2",
        &crate::support::float32("", 2, &of(2)),
    );
    vtk.line("GLOBAL_IDS gid vtkIdType");
    vtk.numbers(&crate::support::int32("", 1, &[5, 6, 7, 70_000]));
    vtk.line("PEDIGREE_IDS who string");
    vtk.texts(&["a b", "", "POINT_DATA 7", "x\ny"]);
    vtk.array("edge_flags e", &crate::support::uint8("", 1, &[0, 1, 1, 0]));
    vtk.lines("FIELD f 5\nNULL_ARRAY\nlabels 2 2 string");
    vtk.texts(&["p", "q", "r s", "t"]);
    // Two variants, which are text in binary files too.
    vtk.lines("any 1 2 variant\n6 3\n13 a%20b");
    vtk.line("bits 1 4 bit");
    if vtk.binary {
        vtk.file.push(0b0110_0000);
        vtk.line("");
    } else {
        vtk.line("0 1 1 0");
    }
    vtk.array(
        "METADATA 1 4",
        &crate::support::float64("", 1, &[0.0, 1.0, 2.0, 3.0]),
    );
    vtk.line("CELL_DATA 1");
    vtk.field(&[
        crate::support::int8("i8", 1, &[-3]),
        crate::support::uint16("u16", 1, &[65_535]),
        crate::support::int32("i32", 1, &[-70_000]),
        crate::support::uint32("u32", 1, &[4_000_000_000]),
        crate::support::int64("i64", 1, &[-5_000_000_000]),
        crate::support::uint64("u64", 1, &[5_000_000_000]),
    ]);
}

#[test]
fn all_attributes_are_read_and_what_stands_between_them_is_not() {
    let component =
        |components: usize, c: usize| Values::F32(f32s(4, |i| (components * i + c) as f32 + 0.5));
    for (vtk, data) in read_all(|vtk| {
        vtk.line("DATASET UNSTRUCTURED_GRID");
        vtk.lines("FIELD FieldData 2\nTIME 1 1 double");
        vtk.numbers(&crate::support::float64("", 1, &[1.5]));
        vtk.line("made%20by 1 1 string");
        vtk.texts(&["somebody\nelse"]);
        write_points(vtk, 4);
        vtk.cells("CELLS", &[&[0, 1, 2, 3]]);
        vtk.line("CELL_TYPES 1");
        vtk.numbers(&crate::support::int32("", 1, &[10]));
        write_attributes(vtk);
    }) {
        let what = format!("{} binary {}", vtk.version, vtk.binary);
        let names = [
            "three",
            "colours",
            "wind speed",
            "n",
            "t",
            "t6",
            "uv",
            "gid",
            "e",
            "bits",
            "METADATA",
            "i8",
            "u16",
            "i32",
            "u32",
            "i64",
            "u64",
        ];
        assert_eq!(data.field_names(), names, "{what}");
        let values = |name: &str| data.scalar(name).unwrap().1;
        assert_eq!(values("three:0"), Values::U8(vec![1, 4, 7, 10]));
        assert_eq!(values("three:2"), Values::U8(vec![3, 6, 9, 255]));
        assert_eq!(values("colours:0"), Values::U8(vec![0, 127, 200, 255]));
        assert_eq!(values("colours:1"), Values::U8(vec![1, 128, 254, 51]));
        assert_eq!(values("wind speed:y"), component(3, 1));
        assert_eq!(values("n:z"), component(3, 2));
        assert_eq!(values("t:8"), component(9, 8));
        assert_eq!(values("t6:5"), component(6, 5));
        assert_eq!(values("uv:x"), component(2, 0));
        assert_eq!(values("gid"), Values::F32(vec![5.0, 6.0, 7.0, 70_000.0]));
        assert_eq!(values("e"), Values::U8(vec![0, 1, 1, 0]));
        assert_eq!(values("bits"), Values::U8(vec![0, 1, 1, 0]));
        assert_eq!(values("METADATA"), Values::F32(vec![0.0, 1.0, 2.0, 3.0]));
        let of_cells = |name: &str, expected: Values| {
            assert_eq!(data.scalar(name).unwrap(), (Association::Cells, expected));
        };
        of_cells("i8", Values::I16(vec![-3]));
        of_cells("u16", Values::U16(vec![65_535]));
        of_cells("i32", Values::F32(vec![-70_000.0]));
        of_cells("u32", Values::F32(vec![4e9]));
        of_cells("i64", Values::F32(vec![-5e9]));
        of_cells("u64", Values::F32(vec![5e9]));
        assert_eq!(data.notes.len(), 1);
        assert!(
            data.notes[0].contains("who, labels, any"),
            "{}",
            data.notes[0]
        );
    }
}

#[test]
fn a_lookup_table_may_be_anywhere_or_nowhere() {
    for heading in [
        "SCALARS s float",
        "SCALARS s float 1",
        "SCALARS s float\nLOOKUP_TABLE default",
        "SCALARS s float 1\nlookup_table t",
        "SCALARS s float LOOKUP_TABLE t",
        "SCALARS s float 1 LOOKUP_TABLE t",
    ] {
        for (_, data) in read_all(|vtk| {
            vtk.lines("DATASET STRUCTURED_POINTS\nDIMENSIONS 2 1 1\nPOINT_DATA 2");
            vtk.lines(heading);
            vtk.numbers(&crate::support::float32("", 1, &[1.0, 2.0]));
            vtk.line("LOOKUP_TABLE t 0");
        }) {
            let values = data.scalar("s").unwrap().1;
            assert_eq!(values, Values::F32(vec![1.0, 2.0]), "{heading}");
        }
    }
}

#[test]
fn flat_grids_keep_their_points_and_leave_out_their_cells() {
    for (_, data) in read_all(|vtk| {
        vtk.lines("DATASET STRUCTURED_POINTS\nDIMENSIONS 3 3 1\nSPACING 1 1 0");
        vtk.line("CELL_DATA 4");
        vtk.field(&[crate::support::uint8("flat", 1, &[1; 4])]);
        vtk.line("POINT_DATA 9");
        vtk.field(&[crate::support::uint8("kept", 1, &[1; 9])]);
    }) {
        assert_eq!(data.field_names(), ["kept"]);
        assert!(data.notes[0].contains("flat"), "{:?}", data.notes);
    }
}

#[test]
fn what_is_no_number_stays_none() {
    let text = "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 5 double\n\
                0 0 0 nan 0 0 0 0 0 0 0 0 0 0 0\nPOINT_DATA 5\nSCALARS s float\n\
                nan -nan inf -inf 1.5e3\n";
    let data = try_read(text.as_bytes()).unwrap();
    let values = data.scalar("s").unwrap().1;
    assert_eq!(values.non_finite_count(), 4);
    assert_eq!(values.get(4), 1500.0);
}

/// Text after the first three lines, and words of the error: the place, and the problem.
const MISTAKES: &[(&str, &[&str])] = &[
    ("", &["DATASET", "line 4", "nothing"]),
    ("DATASET", &["found nothing"]),
    ("DATASET TABLE\nROW_DATA 3\n", &["line 4", "`TABLE`"]),
    ("FIELD f 1\na 1 1 int\n7\n", &["found nothing"]),
    (
        "DATASET FIELD\nFIELD f 1\na 1 1 int\n7\n",
        &["fields without a geometry"],
    ),
    ("POINTS 1 float\n0 0 0\n", &["DATASET", "`POINTS`"]),
    (
        "DATASET POLYDATA\n",
        &["a section POINTS", "end of the file"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 2 float\n0 0 0 1.00 1.00\n",
        &["POINTS, line 7", "after 5"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 9 float\n0 0 0\n",
        &["POINTS", "line 5", "27 numbers"],
    ),
    (
        "DATASET POLYDATA\nPOINTS -1 float\n",
        &["POINTS, line 5", "`-1`"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 0 float\n",
        &["at least one point"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 floats\n0 0 0\n",
        &["line 5", "a type", "`floats`"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 string\n0 0 0\n",
        &["numbers", "text"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0\nx\n",
        &["line 7", "number 3 of 3", "`x`"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 6148914691236517206 float\n0 0 0\n",
        &["fit into memory"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOLYGON 1 4\n",
        &["line 7", "POLYGONS", "`POLYGON`"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 1 3\n2 0 1\n",
        &["cell 0, line", "node 1"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 1 3\n2 0 -1\n",
        &["LINES, line 8", "number 3 of 3", "`-1`"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 2 4\n2 0 0 9\n",
        &["2 cells in 4 numbers", "cell 1"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 1 4\n2 0 0 9\n",
        &["4 numbers in 1 cells", "found 3"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 5 4\n2 0 0 9\n",
        &["5 cells"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 2 2\nOFFSETS int\n0 1\nCONNECTIVITY int\n0 0\n",
        &["from 0 to 2", "to 1"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 3 2\nOFFSETS int\n0 3 2\nCONNECTIVITY int\n0 0\n",
        &["offsets that fall"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nLINES 2 1\nOFFSETS int\n0 1\nPOINT_DATA 1\n",
        &["CONNECTIVITY", "POINT_DATA"],
    ),
    (
        "DATASET UNSTRUCTURED_GRID\nPOINTS 1 float\n0 0 0\nCELLS 1 2\n1 0\n",
        &["a section CELL_TYPES", "end of the file"],
    ),
    (
        "DATASET UNSTRUCTURED_GRID\nPOINTS 1 float\n0 0 0\nCELLS 1 2\n1 0\nCELL_TYPES 2\n1 1\n",
        &["1 kinds", "found 2"],
    ),
    (
        "DATASET UNSTRUCTURED_GRID\nPOINTS 1 float\n0 0 0\nCELLS 1 2\n1 0\nCELL_TYPES 1\n256\n",
        &["0 to 255", "256"],
    ),
    (
        "DATASET UNSTRUCTURED_GRID\nPOINTS 1 float\n0 0 0\nCELLS 1 2\n1 0\nCELL_TYPES 1\n10\n",
        &["cell 0, tetrahedron", "1 nodes"],
    ),
    (
        "DATASET STRUCTURED_POINTS\nPOINT_DATA 1\n",
        &["DIMENSIONS", "`POINT_DATA`"],
    ),
    (
        "DATASET STRUCTURED_POINTS\nDIMENSIONS 2 0 2\n",
        &["line 5", "[2, 0, 2]"],
    ),
    (
        "DATASET STRUCTURED_POINTS\nEXTENT 0 1 0 1 5 3\n",
        &["line 5", "[2, 2, 0]"],
    ),
    (
        "DATASET STRUCTURED_POINTS\nDIMENSIONS 9999999999 9999999999 9999999999\n",
        &["fits into memory"],
    ),
    (
        "DATASET STRUCTURED_POINTS\nDIMENSIONS 999999 999999 999999\nPOINT_DATA 0\n",
        &["at least one array"],
    ),
    (
        "DATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nSPACING 1 0 1\n",
        &["SPACING", "volume"],
    ),
    (
        "DATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 1 0\n",
        &["ORIGIN", "coordinate"],
    ),
    (
        "DATASET STRUCTURED_GRID\nDIMENSIONS 2 1 1\nPOINTS 1 float\n0 0 0\n",
        &["DIMENSIONS", "[2, 1, 1]"],
    ),
    (
        "DATASET RECTILINEAR_GRID\nDIMENSIONS 2 1 1\nX_COORDINATES 2 float\n0 0\n",
        &["X_COORDINATES, line 7", "0 after 0"],
    ),
    (
        "DATASET RECTILINEAR_GRID\nDIMENSIONS 2 1 1\nX_COORDINATES 1 float\n0\nY_COORDINATES 1 \
         float\n0\nZ_COORDINATES 1 float\n0\n",
        &["[1, 1, 1]", "[2, 1, 1]"],
    ),
    (
        "DATASET RECTILINEAR_GRID\nDIMENSIONS 1 1 1\nX_COORDINATES 1 float\n0\n",
        &["Y_COORDINATES"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nTANGENT t float\n",
        &["`TANGENT`"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 2\nVECTORS v float\n0 0 0 0 0 0\n",
        &[
            "POINT_DATA, array `v`",
            "1 tuples, one for each point",
            "found 2",
        ],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nFIELD f 1\nv 1 3 float\n0 0 0\n",
        &["array `v`", "1 tuples", "found 3"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nCELL_DATA 1\nFIELD f 1\nv 1 1 float\n0\n",
        &[
            "CELL_DATA, array `v`",
            "0 tuples, one for each cell",
            "found 1",
        ],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nFIELD f 2\nv 1 1 float\n0\n",
        &["POINT_DATA", "a name", "end of the file"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nFIELD f 1\nv 9999999999999 1 bit\n0\n",
        &["array `v`", "1024 components"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nSCALARS s unsigned_char\n256\n",
        &["array `s`, line 9", "0 to 255", "`256`"],
    ),
    (
        "DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nSCALARS s float one\n2\n",
        &["number of components", "`one`"],
    ),
];

#[test]
fn mistakes_are_named_with_their_line() {
    let mut failures = Vec::new();
    for (text, words) in MISTAKES {
        let err = refuse(&format!("# vtk DataFile Version 3.0\ntitle\nASCII\n{text}"));
        let missing = words.iter().filter(|word| !err.contains(**word));
        failures.extend(missing.map(|word| format!("{word}: {err}")));
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    for (header, words) in [
        ("# vtk DataFile Version 6.0\n\nASCII\n", "up to 5"),
        ("# vtk DataFile Version x\n\nASCII\n", "Version x"),
        ("# vtk DataFile\n", "up to 5"),
        ("# vtk DataFile Version 3.0\nt\nTEXT\n", "`TEXT`"),
        ("# vtk DataFile Version 3.0\nt", "ASCII or BINARY"),
    ] {
        let err = refuse(header);
        assert!(err.contains(words), "{err}");
    }
}

#[test]
fn binary_files_cut_short_name_the_section_and_the_byte() {
    let mut vtk = LegacyVtk::new("3.0", true, false);
    vtk.line("DATASET UNSTRUCTURED_GRID");
    write_points(&mut vtk, 4);
    let points = vtk.file.len();
    vtk.cells("CELLS", &[&[0, 1, 2, 3]]);
    let cells = vtk.file.len();
    for (len, section) in [(points - 2, "POINTS, byte"), (cells - 2, "CELLS, byte")] {
        let err = try_read(&vtk.file[..len]).unwrap_err().to_string();
        assert!(err.contains(section) && err.contains("cut short"), "{err}");
    }
    let mut negative = vtk.file.clone();
    negative[cells - 5] = 0xff;
    let err = try_read(&negative).unwrap_err().to_string();
    assert!(
        err.contains("number 5 of 5") && err.contains("[ff, 00, 00, 03]"),
        "{err}"
    );
}
