//! Tests the VTK XML readers: every format in every encoding, pieces, indices, and refusals.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use crate::support::{
    Compression, Folder, VtkArray, VtkEncoding, XmlPiece, float32, float64, int8, int16, int32,
    int64, uint8, uint16, uint32, uint64, vtk_xml,
};
use ewa_splat::io::{
    Association, CellKind, CellMesh, CurvilinearBlock, Dataset, FieldSource, Geometry, OpenOptions,
    open,
};
use ewa_splat::scene::{LatticeSpacing, Values};
use glam::DVec3;

fn values(data: &Dataset, field: &str) -> Values {
    data.scalar(field).unwrap().1
}

/// Returns a piece of a structured grid.
fn structured(
    extent: &str,
    point_data: Vec<VtkArray>,
    cell_data: Vec<VtkArray>,
    geometry: (&'static str, Vec<VtkArray>),
) -> XmlPiece {
    XmlPiece {
        attributes: format!("Extent=\"{extent}\""),
        elements: vec![("PointData", point_data), ("CellData", cell_data), geometry],
    }
}

fn whole(extent: &str) -> String {
    format!("WholeExtent=\"{extent}\"")
}

fn axes(x: &[f64], y: &[f32], z: &[i16]) -> (&'static str, Vec<VtkArray>) {
    let arrays = vec![float64("x", 1, x), float32("y", 1, y), int16("z", 1, z)];
    ("Coordinates", arrays)
}

fn coordinates(data: &Dataset) -> &[Vec<f64>; 3] {
    let Geometry::Lattice(lattice) = &data.geometry else {
        panic!("{:?}", data.geometry)
    };
    let LatticeSpacing::Rectilinear { coordinates } = &lattice.spacing else {
        panic!("{lattice:?}")
    };
    assert_eq!(lattice.dims, [0, 1, 2].map(|axis| coordinates[axis].len()));
    coordinates
}

fn block(data: &Dataset) -> &CurvilinearBlock {
    match &data.geometry {
        Geometry::Curvilinear { blocks } if blocks.len() == 1 => &blocks[0],
        other => panic!("{other:?}"),
    }
}

fn mesh(data: &Dataset) -> &CellMesh {
    match &data.geometry {
        Geometry::Cells(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

/// Returns each cell's kind and entries.
fn cells(data: &Dataset) -> Vec<(u8, Vec<u32>)> {
    let mesh = mesh(data);
    (0..mesh.cell_count())
        .map(|i| (mesh.kinds[i].0, mesh.cell(i).to_vec()))
        .collect()
}

/// Returns positions that single precision cannot represent.
fn positions(count: usize) -> Vec<f64> {
    (0..3 * count).map(|i| 1e6 + i as f64 / 3.0).collect()
}

fn to_points(numbers: &[f64]) -> Vec<DVec3> {
    numbers.chunks(3).map(DVec3::from_slice).collect()
}

fn points(numbers: &[f64]) -> (&'static str, Vec<VtkArray>) {
    ("Points", vec![float64("Points", 3, numbers)])
}

#[test]
fn vtr_in_every_encoding() {
    let folder = Folder::new();
    let numbers: Vec<f32> = (0..12).map(|i| i as f32 / 7.0).collect();
    let piece = structured(
        "4 5 -2 0 7 8",
        vec![float32("p", 1, &numbers)],
        vec![int16("c", 1, &[-3, 4])],
        axes(&[0.1, 1e9], &[0.5, 0.75, 3.0], &[-2, 5]),
    );
    for encoding in VtkEncoding::all() {
        let file = vtk_xml(
            encoding,
            "RectilinearGrid",
            &whole("4 5 -2 0 7 8"),
            std::slice::from_ref(&piece),
        );
        let data = folder.open("a.vtr", &file);
        let expected = [vec![0.1, 1e9], vec![0.5, 0.75, 3.0], vec![-2.0, 5.0]];
        assert_eq!(coordinates(&data), &expected, "{encoding:?}");
        assert_eq!(values(&data, "p"), Values::F32(numbers.clone()));
        let cell_values = (Association::Cells, Values::I16(vec![-3, 4]));
        assert_eq!(data.scalar("c").unwrap(), cell_values);
    }
}

#[test]
fn falling_axes_are_turned_round_with_their_samples() {
    let folder = Folder::new();
    let p: Vec<u8> = (0..12).collect();
    let v: Vec<i16> = (0..24).collect();
    let piece = structured(
        "0 1 0 2 0 1",
        vec![uint8("p", 1, &p), int16("v", 2, &v)],
        vec![uint16("c", 1, &[10, 20])],
        axes(&[0.0, 1.0], &[9.0, 5.0, 4.0], &[1, -1]),
    );
    let file = vtk_xml(
        VtkEncoding::RAW,
        "RectilinearGrid",
        &whole("0 1 0 2 0 1"),
        &[piece],
    );
    let data = folder.open("a.vtr", &file);
    let expected = [vec![0.0, 1.0], vec![4.0, 5.0, 9.0], vec![-1.0, 1.0]];
    assert_eq!(coordinates(&data), &expected);
    let turned: Vec<u8> = vec![10, 11, 8, 9, 6, 7, 4, 5, 2, 3, 0, 1];
    assert_eq!(values(&data, "p"), Values::U8(turned.clone()));
    let y = turned.iter().map(|&i| 2 * i16::from(i) + 1).collect();
    assert_eq!(values(&data, "v:1"), Values::I16(y));
    assert_eq!(values(&data, "c"), Values::U16(vec![20, 10]));
}

#[test]
fn vtr_pieces_bring_their_own_coordinates() {
    let folder = Folder::new();
    let piece = |extent, x: &[f64], p: &[u8], c: &[u8]| {
        structured(
            extent,
            vec![uint8("p", 1, p)],
            vec![uint8("c", 1, c)],
            axes(x, &[0.0, 1.0], &[0, 1]),
        )
    };
    let pieces = [
        piece("2 3 0 1 0 1", &[4.0, 9.0], &[3, 4, 3, 4, 3, 4, 3, 4], &[30]),
        piece(
            "0 2 0 1 0 1",
            &[0.0, 1.0, 4.0],
            &[1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3],
            &[10, 20],
        ),
    ];
    for encoding in VtkEncoding::all() {
        let file = vtk_xml(encoding, "RectilinearGrid", &whole("0 3 0 1 0 1"), &pieces);
        let data = folder.open("a.vtr", &file);
        assert_eq!(coordinates(&data)[0], [0.0, 1.0, 4.0, 9.0]);
        assert_eq!(values(&data, "p"), Values::U8([1, 2, 3, 4].repeat(4)));
        assert_eq!(values(&data, "c"), Values::U8(vec![10, 20, 30]));
    }
    let one = vtk_xml(
        VtkEncoding::RAW,
        "RectilinearGrid",
        &whole("0 3 0 1 0 1"),
        &pieces[..1],
    );
    let err = folder.refuse("a.vtr", &one);
    assert!(err.contains("4 coordinates along x, found 2"), "{err}");
}

#[test]
fn vtr_coordinates_must_run_one_way() {
    let folder = Folder::new();
    for (x, found) in [
        (&[0.0, 1.0, 1.0], "found 1 at node 2"),
        (&[0.0, 2.0, 1.0], "found 1 at node 2"),
        (&[2.0, 1.0, 5.0], "found 1 at node 1"),
        (&[0.0, f64::NAN, 1.0], "found NaN at node 1"),
        (&[0.0, 1.0, f64::INFINITY], "found inf at node 2"),
    ] {
        let piece = structured(
            "0 2 0 1 0 1",
            vec![uint8("p", 1, &[1; 12])],
            vec![],
            axes(x, &[0.0, 1.0], &[0, 1]),
        );
        let file = vtk_xml(
            VtkEncoding::TEXT,
            "RectilinearGrid",
            &whole("0 2 0 1 0 1"),
            &[piece],
        );
        let err = folder.refuse("a.vtr", &file);
        assert!(err.contains(found), "{err}");
    }
}

#[test]
fn vts_in_every_encoding() {
    let folder = Folder::new();
    let at = positions(12);
    let piece = structured(
        "-1 0 3 5 0 1",
        vec![
            float64("p", 1, &at[..12]),
            uint8("vtkGhostType", 1, &[2; 12]),
        ],
        vec![uint32("c", 1, &[70_000, 5])],
        points(&at),
    );
    for encoding in VtkEncoding::all() {
        let file = vtk_xml(
            encoding,
            "StructuredGrid",
            &whole("-1 0 3 5 0 1"),
            std::slice::from_ref(&piece),
        );
        let data = folder.open("a.vts", &file);
        let expected = CurvilinearBlock {
            dims: [2, 3, 2],
            nodes: to_points(&at),
        };
        assert_eq!(block(&data), &expected, "{encoding:?}");
        // Double precision is kept if single precision does not represent the numbers.
        assert_eq!(values(&data, "p"), Values::F64(at[..12].to_vec()));
        assert_eq!(values(&data, "vtkGhostType"), Values::U8(vec![2; 12]));
        assert_eq!(values(&data, "c"), Values::F32(vec![70_000.0, 5.0]));
    }
}

/// NaN positions are left to the samplers, which count them.
#[test]
fn nan_positions_are_passed_on() {
    let folder = Folder::new();
    let mut at = positions(8);
    at[4] = f64::NAN;
    let piece = structured(
        "0 1 0 1 0 1",
        vec![uint8("p", 1, &[0; 8])],
        vec![],
        points(&at),
    );
    for encoding in [VtkEncoding::RAW, VtkEncoding::TEXT] {
        let file = vtk_xml(
            encoding,
            "StructuredGrid",
            &whole("0 1 0 1 0 1"),
            std::slice::from_ref(&piece),
        );
        let data = folder.open("a.vts", &file);
        assert!(block(&data).nodes[1].y.is_nan());
        assert!(block(&data).nodes.iter().filter(|n| n.is_nan()).count() == 1);
    }
}

/// Returns two pieces that share the nodes of plane i = 1, where each marks those of the other as
/// ghosts.
fn overlapping_vts() -> [XmlPiece; 2] {
    let node = |i: usize, j: usize, k: usize| [i as f64, j as f64 + 0.25, k as f64 * 1.5];
    let piece = |extent: &str, is: [usize; 2], ghosts: [u8; 2], extra: Option<VtkArray>| {
        let mut at = Vec::new();
        let mut p = Vec::new();
        let mut marks = Vec::new();
        for k in 0..2 {
            for j in 0..2 {
                for (i, ghost) in is.into_iter().zip(ghosts) {
                    at.extend(node(i, j, k));
                    p.push((100 * k + 10 * j + i) as u8);
                    marks.push(ghost);
                }
            }
        }
        let mut point_data = vec![uint8("vtkGhostType", 1, &marks), uint8("p", 1, &p)];
        point_data.extend(extra);
        let cell = vec![uint8("c", 1, &[is[0] as u8])];
        structured(extent, point_data, cell, points(&at))
    };
    [
        piece("0 1 0 1 0 1", [0, 1], [0, 1], None),
        // An array that only one piece has, and another order.
        piece(
            "1 2 0 1 0 1",
            [1, 2],
            [0, 2],
            Some(float32("more", 1, &[1.0; 8])),
        ),
    ]
}

fn check_overlapping(data: &Dataset) {
    let block = block(data);
    assert_eq!(block.dims, [3, 2, 2]);
    assert_eq!(block.nodes[1], DVec3::new(1.0, 0.25, 0.0));
    assert_eq!(block.nodes[11], DVec3::new(2.0, 1.25, 1.5));
    let p = vec![0, 1, 2, 10, 11, 12, 100, 101, 102, 110, 111, 112];
    assert_eq!(values(data, "p"), Values::U8(p));
    assert_eq!(values(data, "c"), Values::U8(vec![0, 1]));
    // A ghost of one piece that another piece owns is no ghost of the whole.
    assert_eq!(
        values(data, "vtkGhostType"),
        Values::U8([0, 0, 2].repeat(4))
    );
    assert_eq!(data.field_names(), ["vtkGhostType", "p", "c"]);
    assert_eq!(data.notes.len(), 1);
    assert!(data.notes[0].contains("PointData") && data.notes[0].contains("`more`"));
}

#[test]
fn vts_pieces_are_put_together() {
    let folder = Folder::new();
    for encoding in VtkEncoding::all() {
        for pieces in [
            overlapping_vts(),
            overlapping_vts()
                .into_iter()
                .rev()
                .collect::<Vec<_>>()
                .try_into()
                .unwrap(),
        ] {
            let file = vtk_xml(encoding, "StructuredGrid", &whole("0 2 0 1 0 1"), &pieces);
            check_overlapping(&folder.open("a.vts", &file));
        }
    }
    let file = vtk_xml(
        VtkEncoding::RAW,
        "StructuredGrid",
        &whole("0 2 0 1 0 1"),
        &overlapping_vts()[..1],
    );
    let err = folder.refuse("a.vts", &file);
    assert!(err.contains("12 samples, found 8 samples"), "{err}");
}

/// Eight pieces around one node, each with its own nodes and cell.
#[test]
fn pieces_join_along_every_axis() {
    let folder = Folder::new();
    let node = |i: usize, j: usize, k: usize| [i, j + 10, k + 20].map(|n| n as f64);
    let ranges = |cut: usize, far: bool| if far { cut..4 } else { 0..cut + 1 };
    let mut pieces = Vec::new();
    for octant in 0..8 {
        let [is, js, ks] =
            [(1, 1), (2, 2), (2, 4)].map(|(cut, bit)| ranges(cut, octant & bit != 0));
        let mut at = Vec::new();
        let mut p = Vec::new();
        let mut c = Vec::new();
        for k in ks.clone() {
            for j in js.clone() {
                for i in is.clone() {
                    at.extend(node(i, j, k));
                    p.push((16 * k + 4 * j + i) as u8);
                    if i + 1 < is.end && j + 1 < js.end && k + 1 < ks.end {
                        c.push((9 * k + 3 * j + i) as u8);
                    }
                }
            }
        }
        let extent = [&is, &js, &ks].map(|r| format!("{} {}", r.start, r.end - 1));
        pieces.push(structured(
            &extent.join(" "),
            vec![uint8("p", 1, &p)],
            vec![uint8("c", 1, &c)],
            points(&at),
        ));
    }
    let file = |pieces: &[XmlPiece]| {
        vtk_xml(
            VtkEncoding::RAW,
            "StructuredGrid",
            &whole("0 3 0 3 0 3"),
            pieces,
        )
    };
    let data = folder.open("a.vts", &file(&pieces));
    assert_eq!(values(&data, "p"), Values::U8((0..64).collect()));
    assert_eq!(values(&data, "c"), Values::U8((0..27).collect()));
    let numbers = (0..64).flat_map(|n| node(n % 4, n / 4 % 4, n / 16));
    assert_eq!(block(&data).nodes, to_points(&numbers.collect::<Vec<_>>()));
    pieces[3] = pieces[4].clone();
    let err = folder.refuse("a.vts", &file(&pieces));
    assert!(err.contains("in none of them"), "{err}");
}

/// Returns the cells of a piece of an unstructured grid, with numbers of the type of `ids`.
fn unstructured(
    node_count: usize,
    cell_arrays: Vec<VtkArray>,
    cell_count: usize,
    point_data: Vec<VtkArray>,
    cell_data: Vec<VtkArray>,
) -> XmlPiece {
    XmlPiece {
        attributes: format!("NumberOfPoints=\"{node_count}\" NumberOfCells=\"{cell_count}\""),
        elements: vec![
            ("PointData", point_data),
            ("CellData", cell_data),
            points(&positions(node_count)),
            ("Cells", cell_arrays),
        ],
    }
}

const TETRA_FACES: [u32; 17] = [4, 3, 0, 1, 3, 3, 1, 2, 3, 3, 2, 0, 3, 3, 0, 2, 1];

/// Returns a tetrahedron, a polyhedron, a pyramid and a polyhedron that shares a face with the
/// first one.
fn mixed_cells(form: usize) -> Vec<VtkArray> {
    let connectivity = [4, 5, 6, 7, 0, 1, 2, 3, 0, 1, 2, 3, 4, 1, 2, 3, 4];
    let ends = [4, 8, 13, 17];
    let kinds = [10, 42, 14, 42];
    let streams: Vec<i64> = [
        &TETRA_FACES.map(i64::from)[..],
        &[4, 3, 1, 2, 3, 3, 1, 2, 4, 3, 2, 3, 4, 3, 3, 1, 4],
    ]
    .concat();
    let as_u8 = |n: &[i64]| n.iter().map(|&n| n as u8).collect::<Vec<_>>();
    let as_i32 = |n: &[i64]| n.iter().map(|&n| n as i32).collect::<Vec<_>>();
    let as_u64 = |n: &[i64]| n.iter().map(|&n| n as u64).collect::<Vec<_>>();
    match form {
        // The form that VTK wrote until 9.3.
        0 => vec![
            int64("connectivity", 1, &connectivity),
            int64("offsets", 1, &ends),
            uint8("types", 1, &as_u8(&kinds)),
            int64("faces", 1, &streams),
            int64("faceoffsets", 1, &[-1, 17, -1, 34]),
        ],
        1 => vec![
            uint8("types", 1, &as_u8(&kinds)),
            int32("offsets", 1, &as_i32(&ends)),
            uint8("connectivity", 1, &as_u8(&connectivity)),
            int8("faceoffsets", 1, &[-1, 17, -1, 34]),
            uint64("faces", 1, &as_u64(&streams)),
        ],
        // The form that VTK writes since 9.4, the second cell's second face shared.
        _ => vec![
            uint64("connectivity", 1, &as_u64(&connectivity)),
            uint16("offsets", 1, &ends.map(|n| n as u16)),
            int32("types", 1, &as_i32(&kinds)),
            int32(
                "face_connectivity",
                1,
                &[
                    0, 1, 3, 1, 2, 3, 2, 0, 3, 0, 2, 1, 1, 2, 4, 2, 3, 4, 3, 1, 4,
                ],
            ),
            int64("face_offsets", 1, &[3, 6, 9, 12, 15, 18, 21]),
            uint8("polyhedron_to_faces", 1, &[0, 1, 2, 3, 1, 4, 5, 6]),
            uint32("polyhedron_offsets", 1, &[0, 4, 4, 8]),
        ],
    }
}

fn mixed_expected(shift: u32) -> Vec<(u8, Vec<u32>)> {
    let shifted = |nodes: &[u32]| nodes.iter().map(|n| n + shift).collect::<Vec<_>>();
    let faces = |nodes: [[u32; 3]; 4]| {
        let faces = nodes.iter().flat_map(|f| [vec![3], shifted(f)].concat());
        [4].into_iter().chain(faces).collect::<Vec<_>>()
    };
    vec![
        (10, shifted(&[4, 5, 6, 7])),
        (42, faces([[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]])),
        (14, shifted(&[0, 1, 2, 3, 4])),
        (42, faces([[1, 2, 3], [1, 2, 4], [2, 3, 4], [3, 1, 4]])),
    ]
}

#[test]
fn vtu_in_every_encoding() {
    let folder = Folder::new();
    for form in 0..3 {
        let piece = unstructured(
            8,
            mixed_cells(form),
            4,
            vec![float32("p", 3, &[0.5; 24])],
            vec![uint8("c", 1, &[1, 2, 3, 4])],
        );
        for encoding in VtkEncoding::all() {
            let file = vtk_xml(
                encoding,
                "UnstructuredGrid",
                "",
                std::slice::from_ref(&piece),
            );
            let data = folder.open("a.vtu", &file);
            assert_eq!(mesh(&data).nodes, to_points(&positions(8)), "{encoding:?}");
            assert_eq!(cells(&data), mixed_expected(0), "{encoding:?} {form}");
            assert_eq!(values(&data, "p:2"), Values::F32(vec![0.5; 8]));
            let cell_values = (Association::Cells, Values::U8(vec![1, 2, 3, 4]));
            assert_eq!(data.scalar("c").unwrap(), cell_values);
        }
    }
}

/// Returns a grid of several pieces, one of them empty, whose arrays differ.
fn vtu_pieces() -> [XmlPiece; 3] {
    let first = unstructured(
        8,
        mixed_cells(0),
        4,
        vec![float32("p", 1, &[1.0; 8]), uint8("gone", 1, &[1; 8])],
        vec![uint8("c", 1, &[1, 2, 3, 4])],
    );
    let empty = XmlPiece {
        attributes: "NumberOfPoints=\"0\" NumberOfCells=\"0\"".into(),
        elements: vec![
            ("PointData", vec![]),
            ("Points", vec![float32("Points", 3, &[])]),
        ],
    };
    let last = unstructured(
        8,
        mixed_cells(2),
        4,
        vec![uint8("gone", 2, &[1; 16]), float32("p", 1, &[2.0; 8])],
        vec![uint8("c", 1, &[5, 6, 7, 8]), uint8("too", 1, &[0; 4])],
    );
    [first, empty, last]
}

fn check_vtu_pieces(data: &Dataset) {
    let expected = [mixed_expected(0), mixed_expected(8)].concat();
    assert_eq!(cells(data), expected);
    let once = to_points(&positions(8));
    assert_eq!(mesh(data).nodes, [once.clone(), once].concat());
    assert_eq!(data.field_names(), ["p", "c"]);
    assert_eq!(
        values(data, "p"),
        Values::F32([[1.0; 8], [2.0; 8]].concat())
    );
    assert_eq!(values(data, "c"), Values::U8((1..=8).collect()));
    assert_eq!(data.notes.len(), 2);
    assert!(data.notes[0].contains("PointData") && data.notes[0].contains("`gone`"));
    assert!(data.notes[1].contains("CellData") && data.notes[1].contains("`too`"));
}

#[test]
fn vtu_pieces_are_put_one_after_another() {
    let folder = Folder::new();
    for encoding in VtkEncoding::all() {
        let file = vtk_xml(encoding, "UnstructuredGrid", "", &vtu_pieces());
        check_vtu_pieces(&folder.open("a.vtu", &file));
    }
}

/// A piece without cells need not have their arrays.
#[test]
fn a_piece_without_cells_keeps_the_arrays_of_cells() {
    let folder = Folder::new();
    let [full, ..] = vtu_pieces();
    let bare = unstructured(8, vec![], 0, vec![float32("p", 1, &[3.0; 8])], vec![]);
    let file = vtk_xml(VtkEncoding::RAW, "UnstructuredGrid", "", &[full, bare]);
    let data = folder.open("a.vtu", &file);
    assert_eq!(data.field_names(), ["p", "c"]);
    assert_eq!(cells(&data), mixed_expected(0));
    assert_eq!(mesh(&data).nodes.len(), 16);
}

/// A node that the piece lacks must not become one of the next piece's.
#[test]
fn pieces_may_not_use_nodes_of_others() {
    let folder = Folder::new();
    let piece = |node| {
        let arrays = vec![
            int32("connectivity", 1, &[0, 1, 2, node]),
            int32("offsets", 1, &[4]),
            uint8("types", 1, &[10]),
        ];
        unstructured(4, arrays, 1, vec![], vec![])
    };
    let file = |node| {
        vtk_xml(
            VtkEncoding::RAW,
            "UnstructuredGrid",
            "",
            &[piece(node), piece(3)],
        )
    };
    assert_eq!(cells(&folder.open("a.vtu", &file(3)))[1].1, [4, 5, 6, 7]);
    assert!(folder.refuse("a.vtu", &file(4)).contains("found node 4"));
}

#[test]
fn vertex_cells_are_particles() {
    let folder = Folder::new();
    let arrays = vec![
        int32("connectivity", 1, &[2, 0, 1]),
        int32("offsets", 1, &[1, 2, 3]),
        uint8("types", 1, &[1; 3]),
    ];
    let piece = unstructured(3, arrays, 3, vec![], vec![int16("m", 1, &[20, 0, 10])]);
    let file = vtk_xml(VtkEncoding::TEXT, "UnstructuredGrid", "", &[piece]);
    let data = folder.open("a.vtu", &file);
    let Geometry::Points { positions: read } = &data.geometry else {
        panic!()
    };
    assert_eq!(read, &to_points(&positions(3)));
    let of_nodes = (Association::Nodes, Values::I16(vec![0, 10, 20]));
    assert_eq!(data.scalar("m").unwrap(), of_nodes);
}

fn vtp_piece(counts: [usize; 4], elements: Vec<(&'static str, Vec<VtkArray>)>) -> XmlPiece {
    let [verts, lines, strips, polys] = counts;
    let mut all = vec![
        ("PointData", vec![uint8("p", 1, &[7; 6])]),
        points(&positions(6)),
    ];
    all.extend(elements);
    XmlPiece {
        attributes: format!(
            "NumberOfPoints=\"6\" NumberOfVerts=\"{verts}\" NumberOfLines=\"{lines}\" \
             NumberOfStrips=\"{strips}\" NumberOfPolys=\"{polys}\""
        ),
        elements: all,
    }
}

fn runs(connectivity: &[i64], offsets: &[i32]) -> Vec<VtkArray> {
    vec![
        int64("connectivity", 1, connectivity),
        int32("offsets", 1, offsets),
    ]
}

/// Returns points and lines, in the order of VTK's files, with values in the order of VTK's cells.
/// With faces, the data are a mesh: `faces` holds these.
fn all_vtp_kinds() -> XmlPiece {
    vtp_piece(
        [2, 2, 0, 0],
        vec![
            ("CellData", vec![uint8("c", 1, &[1, 2, 3, 4])]),
            ("Lines", runs(&[0, 1, 3, 4, 5], &[2, 5])),
            ("Verts", runs(&[0, 1, 2], &[1, 3])),
        ],
    )
}

fn vtp_expected(shift: u32) -> Vec<(u8, Vec<u32>)> {
    [
        (CellKind::VERTEX, &[0][..]),
        (CellKind::POLY_VERTEX, &[1, 2]),
        (CellKind::LINE, &[0, 1]),
        (CellKind::POLY_LINE, &[3, 4, 5]),
    ]
    .map(|(kind, nodes)| (kind.0, nodes.iter().map(|n| n + shift).collect()))
    .into()
}

#[test]
fn vtp_in_every_encoding() {
    let folder = Folder::new();
    for encoding in VtkEncoding::all() {
        let file = vtk_xml(encoding, "PolyData", "", &[all_vtp_kinds()]);
        let data = folder.open("a.vtp", &file);
        assert_eq!(cells(&data), vtp_expected(0), "{encoding:?}");
        assert_eq!(values(&data, "c"), Values::U8((1..=4).collect()));
        let file = vtk_xml(
            encoding,
            "PolyData",
            "",
            &[all_vtp_kinds(), all_vtp_kinds()],
        );
        let data = folder.open("a.vtp", &file);
        assert_eq!(cells(&data), [vtp_expected(0), vtp_expected(6)].concat());
        assert_eq!(values(&data, "p"), Values::U8(vec![7; 12]));
    }
}

#[test]
fn vtp_without_lines_and_faces_is_particles() {
    let folder = Folder::new();
    let verts = ("Verts", runs(&[0, 1, 2, 3, 4, 5], &[1, 2, 3, 4, 5, 6]));
    for piece in [
        vtp_piece([0; 4], vec![]),
        vtp_piece([6, 0, 0, 0], vec![verts]),
    ] {
        let file = vtk_xml(VtkEncoding::RAW, "PolyData", "", &[piece]);
        let data = folder.open("a.vtp", &file);
        assert!(matches!(&data.geometry, Geometry::Points { positions } if positions.len() == 6));
        assert_eq!(values(&data, "p"), Values::U8(vec![7; 6]));
    }
}

/// Returns an index that names files.
fn index(kind: &str, attributes: &str, sources: &[&str]) -> Vec<u8> {
    let pieces: String = sources
        .iter()
        .map(|source| format!("<Piece Source=\"{source}\"/>"))
        .collect();
    format!(
        "<VTKFile type=\"P{kind}\" version=\"0.1\"><P{kind} {attributes} GhostLevel=\"0\">\
         <PPointData><PDataArray type=\"Float32\" Name=\"p\"/></PPointData>{pieces}</P{kind}>\
         </VTKFile>"
    )
    .into_bytes()
}

#[test]
fn indices_join_the_files_they_name() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path().join("parts")).unwrap();
    for encoding in VtkEncoding::all() {
        let write = |name: &str, kind: &str, attributes: &str, pieces: &[XmlPiece]| {
            folder.file(name, &vtk_xml(encoding, kind, attributes, pieces));
        };
        // The files of pieces may state their own part as the whole extent.
        let [left, right] = overlapping_vts();
        write(
            "parts/l.vts",
            "StructuredGrid",
            &whole("0 1 0 1 0 1"),
            &[left],
        );
        write(
            "parts/r.vts",
            "StructuredGrid",
            &whole("1 2 0 1 0 1"),
            &[right],
        );
        let file = index(
            "StructuredGrid",
            &whole("0 2 0 1 0 1"),
            &["parts/l.vts", "parts/r.vts"],
        );
        check_overlapping(&folder.open("a.pvts", &file));

        for (i, piece) in vtu_pieces().into_iter().enumerate() {
            write(&format!("{i}.vtu"), "UnstructuredGrid", "", &[piece]);
        }
        let absolute = folder.path().join("2.vtu");
        let sources = ["./0.vtu", "1.vtu", absolute.to_str().unwrap()];
        let data = folder.open("a.pvtu", &index("UnstructuredGrid", "", &sources));
        check_vtu_pieces(&data);
        assert!(data.path.ends_with("a.pvtu"));

        write("0.vtp", "PolyData", "", &[all_vtp_kinds()]);
        write("1.vtp", "PolyData", "", &[all_vtp_kinds()]);
        let data = folder.open("a.pvtp", &index("PolyData", "", &["0.vtp", "1.vtp"]));
        assert_eq!(cells(&data), [vtp_expected(0), vtp_expected(6)].concat());

        let image = |extent: &str, p: &[u8]| XmlPiece {
            attributes: format!("Extent=\"{extent}\""),
            elements: vec![("PointData", vec![uint8("p", 1, p)])],
        };
        write(
            "0.vti",
            "ImageData",
            &whole("5 6 0 1 0 0"),
            &[image("5 6 0 1 0 0", &[1, 2, 5, 6])],
        );
        write(
            "1.vti",
            "ImageData",
            &whole("7 7 0 1 0 0"),
            &[image("7 7 0 1 0 0", &[3, 7])],
        );
        let attributes = whole("5 7 0 1 0 0") + " Origin=\"1 0 0\" Spacing=\"2 1 1\"";
        let data = folder.open(
            "a.pvti",
            &index("ImageData", &attributes, &["1.vti", "0.vti"]),
        );
        assert_eq!(values(&data, "p"), Values::U8(vec![1, 2, 3, 5, 6, 7]));
        let Geometry::Lattice(lattice) = &data.geometry else {
            panic!()
        };
        assert_eq!(lattice.position([2, 1, 0]), DVec3::new(15.0, 1.0, 0.0));

        let part = |extent, x: &[f64], p: &[u8]| {
            structured(
                extent,
                vec![uint8("p", 1, p)],
                vec![],
                axes(x, &[0.0], &[0]),
            )
        };
        let parts = [
            ("0.vtr", part("0 1 0 0 0 0", &[0.0, 3.0], &[1, 2])),
            ("1.vtr", part("2 2 0 0 0 0", &[4.0], &[3])),
        ];
        for (name, part) in parts {
            write(name, "RectilinearGrid", &whole("0 2 0 0 0 0"), &[part]);
        }
        let attributes = whole("0 2 0 0 0 0");
        let file = index("RectilinearGrid", &attributes, &["0.vtr", "1.vtr"]);
        let data = folder.open("a.pvtr", &file);
        assert_eq!(coordinates(&data)[0], [0.0, 3.0, 4.0]);
        assert_eq!(values(&data, "p"), Values::U8(vec![1, 2, 3]));
    }
}

#[test]
fn bad_indices_are_explained() {
    let folder = Folder::new();
    let vtp = vtk_xml(VtkEncoding::RAW, "PolyData", "", &[all_vtp_kinds()]);
    folder.file("a.vtp", &vtp);
    folder.file("b.pvtp", &index("PolyData", "", &["a.vtp"]));
    folder.file("cut.vtp", &vtp[..vtp.len() / 2]);
    for (kind, source, words) in [
        (
            "PolyData",
            "gone.vtp",
            "Piece 1, `Source`: expected a file beside the index, found no file `gone.vtp`",
        ),
        ("PolyData", "../none/a.vtp", "no file `../none/a.vtp`"),
        ("PolyData", "", "the name of the piece's file"),
        ("PolyData", "./a.vtp", "each file once"),
        (
            "PolyData",
            "b.pvtp",
            "b.pvtp: VTKFile, `type`: expected PolyData, found `PPolyData`",
        ),
        ("PolyData", "c.pvtp", "c.pvtp: VTKFile, `type`"),
        ("PolyData", ".", "a directory"),
        ("PolyData", "cut.vtp", "cut.vtp: "),
        (
            "UnstructuredGrid",
            "b.pvtp",
            "a.vtp: VTKFile, `type`: expected UnstructuredGrid",
        ),
    ] {
        let err = folder.refuse("c.pvtp", &index(kind, "", &["a.vtp", source]));
        assert!(err.contains(words), "{source}: {err}");
    }
    let err = folder.refuse("c.pvtp", &index("PolyData", "", &[]));
    assert!(err.contains("at least one point"), "{err}");
    let err = folder.refuse("c.pvti", &index("ImageData", "", &[]));
    assert!(err.contains("WholeExtent"), "{err}");
}

/// Replaces one array of the valid cells.
fn with_array(form: usize, array: VtkArray) -> Vec<VtkArray> {
    let mut arrays = mixed_cells(form);
    arrays.retain(|a| a.name != array.name);
    arrays.push(array);
    arrays
}

#[test]
fn damaged_cells_are_refused() {
    let folder = Folder::new();
    let without = |form, name| {
        let mut arrays = mixed_cells(form);
        arrays.retain(|a| a.name != name);
        arrays
    };
    let ids = |last| [4, 5, 6, 7, 0, 1, 2, 3, 0, 1, 2, 3, 4, 1, 2, 3, last];
    let faces = |at: usize, n: i64| {
        let mut all: Vec<i64> = TETRA_FACES.map(i64::from).repeat(2);
        all[at] = n;
        all
    };
    let cases = [
        (
            with_array(0, int64("connectivity", 1, &ids(-1))),
            "found -1 as number 16",
        ),
        (
            with_array(0, int64("connectivity", 1, &ids(1 << 32))),
            "found 4294967296",
        ),
        (
            with_array(0, float32("connectivity", 1, &[1.0; 17])),
            "an array of integers, found Float32",
        ),
        (
            with_array(0, int64("connectivity", 1, &ids(0)[..16])),
            "DataArray `connectivity`",
        ),
        // Beginnings with a final end, as VTK holds them in memory, do not occur in its files.
        (
            with_array(0, int64("offsets", 1, &[0, 4, 8, 13, 17])),
            "DataArray `offsets`",
        ),
        (
            with_array(0, int64("offsets", 1, &[4, 3, 13, 17])),
            "found 3 after 4",
        ),
        (
            with_array(0, int64("offsets", 1, &[3, 8, 13, 17])),
            "cell 0, tetrahedron",
        ),
        (
            with_array(0, int16("types", 1, &[10, 42, 14, 256])),
            "found 256 as number 3",
        ),
        (
            with_array(0, int64("faceoffsets", 1, &[-1, 17, -1, 16])),
            "found 16 after 17",
        ),
        (
            with_array(0, int64("faceoffsets", 1, &[-1, 17, -1, -2])),
            "found -2 as number 3",
        ),
        (
            with_array(0, int64("faceoffsets", 1, &[-1, -1, -1, 34])),
            "cell 1, polyhedron",
        ),
        (
            with_array(0, int64("faces", 1, &faces(0, 5))),
            "a face beyond the cell's end",
        ),
        (
            with_array(0, int64("faces", 1, &faces(0, 3))),
            "numbers after its faces",
        ),
        (with_array(0, int64("faces", 1, &faces(2, 8))), "node 8"),
        (without(0, "connectivity"), "Cells, `connectivity`"),
        (without(0, "offsets"), "Cells, `offsets`"),
        (without(0, "types"), "Cells, `types`"),
        (without(0, "faces"), "Cells, `faces`"),
        (without(0, "faceoffsets"), "Cells, `faceoffsets`"),
        (without(2, "face_offsets"), "Cells, `face_offsets`"),
        (
            without(2, "face_connectivity"),
            "Cells, `face_connectivity`",
        ),
        (
            without(2, "polyhedron_to_faces"),
            "Cells, `polyhedron_to_faces`",
        ),
        (
            with_array(
                2,
                uint8("polyhedron_to_faces", 1, &[0, 1, 2, 3, 1, 4, 5, 7]),
            ),
            "face 7 in cell 3",
        ),
        (
            with_array(
                2,
                uint8("polyhedron_to_faces", 1, &[0, 1, 2, 3, 1, 4, 1, 6]),
            ),
            "each at most twice",
        ),
        (
            with_array(2, uint32("polyhedron_offsets", 1, &[0, 4, 4])),
            "DataArray `polyhedron_offsets`",
        ),
        (
            with_array(2, int64("face_offsets", 1, &[3, 6, 9, 12, 15, 18])),
            "DataArray `face_connectivity`",
        ),
        (
            with_array(2, int64("face_offsets", 1, &[3, 6, 9, 12, 18, 15, 21])),
            "found 15 after 18",
        ),
    ];
    for encoding in [VtkEncoding::RAW, VtkEncoding::TEXT] {
        for (arrays, words) in &cases {
            let piece = unstructured(8, arrays.clone(), 4, vec![], vec![]);
            let err = folder.refuse(
                "a.vtu",
                &vtk_xml(encoding, "UnstructuredGrid", "", &[piece]),
            );
            assert!(err.contains(words), "{words}: {err}");
        }
    }
}

#[test]
fn damaged_elements_are_refused() {
    let folder = Folder::new();
    let sound = unstructured(8, mixed_cells(0), 4, vec![], vec![]);
    let with = |attributes: &str, points: Vec<VtkArray>| {
        let mut piece = sound.clone();
        piece.attributes = attributes.to_owned();
        piece.elements[2].1 = points;
        piece
    };
    let all = "NumberOfPoints=\"8\" NumberOfCells=\"4\"";
    let at = float64("Points", 3, &positions(8));
    for (piece, words) in [
        (with(all, vec![]), "Points: expected an array, found none"),
        (
            with(all, vec![float64("Points", 2, &[0.0; 16])]),
            "3 components, found 2",
        ),
        (
            with(all, vec![float64("Points", 3, &[0.0; 21])]),
            "DataArray `Points`",
        ),
        (
            with("NumberOfCells=\"4\"", vec![at.clone()]),
            "at least one point",
        ),
        (
            with(
                "NumberOfPoints=\"8\" NumberOfCells=\"-4\"",
                vec![at.clone()],
            ),
            "`NumberOfCells`: expected a number, found `-4`",
        ),
        (
            with(
                "NumberOfPoints=\"8\" NumberOfCells=\"18446744073709551615\"",
                vec![at.clone()],
            ),
            "DataArray `types`",
        ),
        (
            with(
                "NumberOfPoints=\"18446744073709551615\" NumberOfCells=\"4\"",
                vec![at.clone()],
            ),
            "DataArray `Points`",
        ),
        (
            with("NumberOfPoints=\"0\" NumberOfCells=\"0\"", vec![at]),
            "at least one point",
        ),
    ] {
        let err = folder.refuse(
            "a.vtu",
            &vtk_xml(VtkEncoding::RAW, "UnstructuredGrid", "", &[piece]),
        );
        assert!(err.contains(words), "{words}: {err}");
    }
    let thin = structured("0 1 0 1 0 1", vec![], vec![], ("Coordinates", vec![]));
    let file = vtk_xml(
        VtkEncoding::RAW,
        "RectilinearGrid",
        &whole("0 1 0 1 0 1"),
        &[thin],
    );
    let err = folder.refuse("a.vtr", &file);
    assert!(err.contains("three arrays: x, y and z, found 0"), "{err}");
    let bare = structured("0 1 0 1 0 1", vec![], vec![], points(&positions(8)));
    let file = vtk_xml(
        VtkEncoding::RAW,
        "StructuredGrid",
        &whole("0 1 0 1 0 1"),
        &[bare],
    );
    let err = folder.refuse("a.vts", &file);
    assert!(err.contains("at least one array"), "{err}");
}

#[test]
fn other_types_and_compressors_are_refused_by_name() {
    let folder = Folder::new();
    for (kind, advice) in [
        ("vtkNonOverlappingAMR", "one of the files that it names"),
        ("HyperTreeGrid", "resample"),
        ("Table", "CSV"),
        ("Unheard", "one of these"),
    ] {
        let file = format!("<?xml version=\"1.0\"?><VTKFile type=\"{kind}\"></VTKFile>");
        let err = folder.refuse("a.vtm", file.as_bytes());
        assert!(
            err.contains(&format!("`{kind}`")) && err.contains(advice),
            "{err}"
        );
    }
    let brotli = b"<VTKFile type=\"PolyData\" compressor=\"vtkBrotli\"><PolyData/></VTKFile>";
    let err = folder.refuse("a.vtp", brotli);
    assert!(
        err.contains("vtkLZMADataCompressor, found `vtkBrotli`"),
        "{err}"
    );
    let err = folder.refuse("a.vtp", b"<VTKFile type=\"PolyData\"></VTKFile>");
    assert!(err.contains("this element"), "{err}");
}

/// Returns compressed blocks of `count` zeros, as small as the compressor makes them.
fn zeros(compression: Compression, count: usize) -> Vec<u8> {
    let zeros = vec![0; count];
    match compression {
        Compression::Lz4 => lz4_flex::block::compress(&zeros),
        Compression::Lzma => crate::support::xz(&zeros),
        _ => {
            let level = flate2::Compression::best();
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), level);
            std::io::Write::write_all(&mut encoder, &zeros).unwrap();
            encoder.finish().unwrap()
        }
    }
}

/// Data at the compressor's limit are read. A header that claims more is refused before anything is
/// allocated for it.
#[test]
fn claims_of_compressed_arrays_are_bounded() {
    const COUNT: usize = 1 << 24;
    let folder = Folder::new();
    for (compression, name) in [
        (Compression::Zlib, "vtkZLibDataCompressor"),
        (Compression::Lz4, "vtkLZ4DataCompressor"),
        (Compression::Lzma, "vtkLZMADataCompressor"),
    ] {
        let block = zeros(compression, COUNT);
        let file = |last_node: usize, claim: usize| {
            let mut file = format!(
                "<VTKFile type=\"ImageData\" header_type=\"UInt64\" compressor=\"{name}\">\
                 <ImageData WholeExtent=\"0 {last_node} 0 0 0 0\"><Piece><PointData>\
                 <DataArray type=\"UInt8\" Name=\"v\" format=\"appended\" offset=\"0\"/>\
                 </PointData></Piece></ImageData><AppendedData encoding=\"raw\">_"
            )
            .into_bytes();
            for word in [1, claim, 0, block.len()] {
                file.extend((word as u64).to_le_bytes());
            }
            file.extend(&block);
            file.extend(b"</AppendedData></VTKFile>");
            file
        };
        let data = folder.open("a.vti", &file(COUNT - 1, COUNT));
        assert_eq!(values(&data, "v"), Values::U8(vec![0; COUNT]));
        let err = folder.refuse("a.vti", &file(COUNT, COUNT + 1));
        assert!(err.contains("in block 0"), "{err}");
        let err = folder.refuse("a.vti", &file(COUNT - 2, COUNT - 1));
        assert!(err.contains("in block 0"), "{err}");
        let much = 1 << 30;
        let err = folder.refuse("a.vti", &file(much - 1, much));
        assert!(err.contains(&format!("data for {much} bytes")), "{err}");
    }
}

#[test]
fn arrays_without_thickness_are_no_cells() {
    let folder = Folder::new();
    let piece = structured(
        "0 2 0 0 0 1",
        vec![uint8("p", 1, &[1, 2, 3, 4, 5, 6])],
        vec![uint8("c", 1, &[])],
        points(&positions(6)),
    );
    for encoding in VtkEncoding::all() {
        let file = vtk_xml(
            encoding,
            "StructuredGrid",
            &whole("0 2 0 0 0 1"),
            std::slice::from_ref(&piece),
        );
        let data = folder.open("a.vts", &file);
        assert_eq!(block(&data).dims, [3, 1, 2]);
        assert_eq!(data.field_names(), ["p"]);
        assert!(matches!(data.fields[0].source, FieldSource::Scalar(_)));
    }
}

/// Text at the end of a binary file, and a mark at its beginning.
#[test]
fn a_byte_order_mark_and_comments_are_skipped() {
    let folder = Folder::new();
    let file = vtk_xml(VtkEncoding::TEXT, "PolyData", "", &[all_vtp_kinds()]);
    let path = folder.file(
        "a.vtp",
        &[b"\xef\xbb\xbf<!-- made -->", &file[22..]].concat(),
    );
    let data = open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(cells(&data), vtp_expected(0));
}
