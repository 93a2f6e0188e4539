//! Tests round trips: files of every encoding, written by the tests, read by the library.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use crate::support::{Folder, Plot3dBlock, Plot3dEncoding, VtkEncoding, VtkPiece};
use ewa_splat::Error;
use ewa_splat::image::{DepthImage, Image};
use ewa_splat::io::{
    Association, CurvilinearBlock, Dataset, Geometry, OpenOptions, RawLayout, RawType, open,
    read_image, write_depth, write_image,
};
use ewa_splat::scene::Values;
use exr::prelude::{ReadChannels, ReadLayers};
use glam::DVec3;

fn values(data: &Dataset, field: &str) -> Values {
    data.scalar(field).unwrap().1
}

#[test]
fn vti_in_every_encoding() {
    let folder = Folder::new();
    let n = 2 * 3 * 2;
    let numbers = |f: fn(usize) -> i16| (0..n).map(f).collect::<Vec<i16>>();
    let small: Vec<u8> = (0..n as u8).collect();
    let signed: Vec<i8> = (0..n as i8).map(|i| i - 5).collect();
    let wide: Vec<f32> = (0..n).map(|i| i as f32 * 1000.5).collect();
    let piece = VtkPiece {
        extent: "1 2 -1 1 5 6",
        point_data: vec![
            crate::support::uint8("u8", 1, &small),
            crate::support::int8("i8", 1, &signed),
            crate::support::int16("i16", 1, &numbers(|i| -300 * i as i16)),
            crate::support::uint16("u16", 1, &[65535; 12]),
            crate::support::int32("i32", 1, &[-70_000; 12]),
            crate::support::uint32("u32", 1, &[4_000_000_000; 12]),
            crate::support::int64("i64", 1, &[-5_000_000_000; 12]),
            crate::support::uint64("u64", 1, &[5_000_000_000; 12]),
            crate::support::float32("f32", 1, &wide),
            crate::support::float64(
                "f64",
                3,
                &(0..3 * n).map(|i| i as f64 / 8.0).collect::<Vec<_>>(),
            ),
        ],
        cell_data: vec![crate::support::float32("cells", 1, &[0.25, -0.5])],
    };
    for encoding in VtkEncoding::all() {
        let attributes = "WholeExtent=\"1 2 -1 1 5 6\" Origin=\"0 0 0.5\" Spacing=\"1 2 4\"";
        let data = folder.open(
            "a.vti",
            &crate::support::vti(encoding, attributes, std::slice::from_ref(&piece)),
        );
        let Geometry::Lattice(lattice) = &data.geometry else {
            panic!("{encoding:?}");
        };
        assert_eq!(lattice.dims, [2, 3, 2]);
        assert_eq!(lattice.position([1, 1, 1]), DVec3::new(2.0, 0.0, 24.5));
        assert_eq!(
            values(&data, "u8"),
            Values::U8(small.clone()),
            "{encoding:?}"
        );
        let widened = signed.iter().map(|&i| i16::from(i)).collect();
        assert_eq!(values(&data, "i8"), Values::I16(widened));
        assert_eq!(
            values(&data, "i16"),
            Values::I16(numbers(|i| -300 * i as i16))
        );
        assert_eq!(values(&data, "u16"), Values::U16(vec![65535; 12]));
        assert_eq!(values(&data, "i32"), Values::F32(vec![-70_000.0; 12]));
        assert_eq!(values(&data, "u32"), Values::F32(vec![4_000_000_000.0; 12]));
        assert_eq!(
            values(&data, "i64"),
            Values::F32(vec![-5_000_000_000.0; 12])
        );
        assert_eq!(values(&data, "u64"), Values::F32(vec![5_000_000_000.0; 12]));
        assert_eq!(values(&data, "f32"), Values::F32(wide.clone()));
        let y = (0..n).map(|i| (3 * i + 1) as f32 / 8.0).collect();
        assert_eq!(values(&data, "f64:y"), Values::F32(y));
        let cells = data.scalar("cells").unwrap();
        assert_eq!(cells, (Association::Cells, Values::F32(vec![0.25, -0.5])));
    }
}

#[test]
fn vti_pieces_with_cells_are_put_together() {
    let folder = Folder::new();
    let cells = |extent, cell_values: &[u8]| VtkPiece {
        extent,
        point_data: vec![],
        cell_data: vec![crate::support::uint8("c", 1, cell_values)],
    };
    let pieces = [cells("0 1 0 1 0 2", &[1, 3]), cells("1 2 0 1 0 2", &[2, 4])];
    for encoding in VtkEncoding::all() {
        let file = crate::support::vti(encoding, "WholeExtent=\"0 2 0 1 0 2\"", &pieces);
        let data = folder.open("a.vti", &file);
        assert_eq!(
            data.scalar("c").unwrap(),
            (Association::Cells, Values::U8(vec![1, 2, 3, 4]))
        );
    }
}

#[test]
fn vti_arrays_may_not_share_bytes() {
    let folder = Folder::new();
    let piece = VtkPiece {
        extent: "0 99 0 9 0 0",
        point_data: vec![crate::support::float64("a", 1, &[1.0; 1000])],
        cell_data: vec![],
    };
    let file = crate::support::vti(VtkEncoding::RAW, "WholeExtent=\"0 99 0 9 0 0\"", &[piece]);
    let array: &[u8] = b"<DataArray type=\"Float64\" Name=\"b\" format=\"appended\" offset=\"0\"/>";
    let at = file.windows(12).position(|w| w == b"</PointData>").unwrap();
    let file = [&file[..at], array, &file[at..]].concat();
    assert!(folder.refuse("a.vti", &file).contains("overlap"));
}

const DIMS: [i32; 3] = [3, 2, 4];
const NODES: usize = 24;

fn coordinates() -> Vec<f64> {
    (0..3 * NODES).map(|i| i as f64 / 4.0 - 3.0).collect()
}

fn variables() -> Vec<f64> {
    (0..5 * NODES).map(|i| 1.0 + i as f64 / 16.0).collect()
}

#[test]
fn plot3d_in_every_encoding() {
    for encoding in Plot3dEncoding::all() {
        for (iblank, trailing) in [(None, 0), (Some([-1; NODES]), 484)] {
            let folder = Folder::new();
            let grid = encoding.grid(DIMS, &coordinates(), iblank.as_ref().map(|b| &b[..]));
            let bare = folder.open("fin.xyz", &grid);
            assert_eq!(bare.fields.len(), usize::from(iblank.is_some()));
            let mut solution = encoding.solution(DIMS, &variables());
            if !encoding.text {
                solution.extend(vec![0; trailing]);
            }
            folder.file("fin.q", &solution);
            let data = folder.open("fin.xyz", &grid);
            let Geometry::Curvilinear { blocks } = &data.geometry else {
                panic!("{encoding:?}");
            };
            let CurvilinearBlock { dims, nodes } = &blocks[0];
            assert_eq!(dims, &[3, 2, 4]);
            for (i, node) in nodes.iter().enumerate() {
                let at = |axis: usize| coordinates()[i + axis * NODES];
                assert_eq!(*node, DVec3::new(at(0), at(1), at(2)), "{encoding:?}");
            }
            let variable = |v: usize| {
                Values::F32(
                    variables()[v * NODES..][..NODES]
                        .iter()
                        .map(|&x| x as f32)
                        .collect(),
                )
            };
            assert_eq!(values(&data, "density"), variable(0));
            assert_eq!(values(&data, "momentum:z"), variable(3));
            assert_eq!(values(&data, "energy"), variable(4));
            for derived in ["velocity_magnitude", "pressure", "mach"] {
                assert_eq!(values(&data, derived).len(), NODES);
            }
            if iblank.is_some() {
                assert_eq!(values(&data, "iblank"), Values::I16(vec![-1; NODES]));
            }
        }
    }
}

#[test]
fn plot3d_mismatches_are_explained() {
    let encoding = Plot3dEncoding {
        text: false,
        double: false,
        big_endian: true,
        records: false,
        grid_count: false,
    };
    let folder = Folder::new();
    let grid = encoding.grid(DIMS, &coordinates(), None);

    let cut = folder.refuse("cut.xyz", &grid[..grid.len() - 4]);
    assert!(
        cut.contains("300 for 3 x 2 x 4 big-endian f32") && cut.contains("296 bytes"),
        "{cut}"
    );

    folder.file("other.q", &encoding.solution([2, 2, 2], &[1.0; 40]));
    let other = folder.refuse("other.xyz", &grid);
    assert!(
        other.contains("3 x 2 x 4") && other.contains("2 x 2 x 2"),
        "{other}"
    );

    let mut tail = encoding.solution(DIMS, &variables());
    tail.extend([0, 0, 7]);
    folder.file("tail.q", &tail);
    let tail = folder.refuse("tail.xyz", &grid);
    assert!(tail.contains("nothing but zeros"), "{tail}");

    let swapped = folder.refuse("q.bin", &encoding.solution(DIMS, &variables()));
    assert!(swapped.contains("as its solution"), "{swapped}");

    let mut line = encoding.words(&[3, 1]);
    line.extend(encoding.reals(&coordinates()[..6]));
    let line = folder.refuse("line.xyz", &line);
    assert!(line.contains("PLOT3D grid: expected"), "{line}");

    let short = folder.refuse("text.xyz", b"1\n2 2 2\n0 1 0 1\n");
    assert!(
        short.contains("28 for 2 x 2 x 2 text") && short.contains("8 numbers"),
        "{short}"
    );
    // There are more grids than the rest of the file can hold.
    let bare = folder.refuse("bare.xyz", b"2 1 1 1 1 1 1\n");
    assert!(bare.contains("7 numbers"), "{bare}");
    let molecule = folder.refuse("water.xyz", b"3\nwater\nO 0 0 0\n");
    assert!(
        molecule.contains("expected 3 rows, of which 1 are there"),
        "{molecule}"
    );
}

/// Returns two grids of different sizes, their solutions and their blanks.
fn two_blocks() -> [[Plot3dBlock; 2]; 2] {
    let block = |dims: [i32; 3], per_node: i32, first: f64| {
        let nodes: i32 = dims.iter().product();
        Plot3dBlock {
            dims,
            numbers: (0..per_node * nodes)
                .map(|i| first + f64::from(i) / 8.0)
                .collect(),
            iblank: vec![],
        }
    };
    [
        [block([3, 2, 4], 3, -3.0), block([2, 2, 3], 3, 5.0)],
        [block([3, 2, 4], 5, 1.0), block([2, 2, 3], 5, 100.0)],
    ]
}

#[test]
fn plot3d_of_several_grids_in_every_encoding() {
    for encoding in Plot3dEncoding::all()
        .into_iter()
        .filter(|encoding| encoding.grid_count)
    {
        for blanked in [false, true] {
            let [mut grids, solutions] = two_blocks();
            if blanked {
                grids[0].iblank = (0..24).collect();
                grids[1].iblank = (0..12).map(|i| -i).collect();
            }
            let folder = Folder::new();
            folder.file("two.q", &encoding.solutions(&solutions));
            let data = folder.open("two.xyz", &encoding.grids(&grids));
            assert!(data.notes.is_empty(), "{:?}", data.notes);
            let Geometry::Curvilinear { blocks } = &data.geometry else {
                panic!("{encoding:?}");
            };
            assert_eq!(blocks.len(), 2);
            for (block, grid) in blocks.iter().zip(&grids) {
                assert_eq!(block.dims, grid.dims.map(|n| n as usize));
                let n = block.nodes.len();
                for (i, node) in block.nodes.iter().enumerate() {
                    let at = |axis: usize| grid.numbers[i + axis * n];
                    assert_eq!(*node, DVec3::new(at(0), at(1), at(2)), "{encoding:?}");
                }
            }
            let variable = |v: usize| {
                let of = |s: &Plot3dBlock| {
                    let n = s.numbers.len() / 5;
                    let part = s.numbers[v * n..][..n].iter().map(|&x| x as f32);
                    part.collect::<Vec<_>>()
                };
                Values::F32(solutions.iter().flat_map(of).collect())
            };
            assert_eq!(values(&data, "density"), variable(0), "{encoding:?}");
            assert_eq!(values(&data, "momentum:y"), variable(2));
            assert_eq!(values(&data, "energy"), variable(4));
            assert_eq!(values(&data, "mach").len(), 36);
            if blanked {
                let words = (0..24).chain((0..12).map(|i| -i)).collect();
                assert_eq!(values(&data, "iblank"), Values::I16(words));
            }
        }
    }
}

#[test]
fn plot3d_solutions_of_other_grids_are_explained() {
    let [grids, solutions] = two_blocks();
    for encoding in Plot3dEncoding::all()
        .into_iter()
        .filter(|encoding| encoding.grid_count)
    {
        let folder = Folder::new();
        let grid = encoding.grids(&grids);
        let mut other = solutions.clone();
        other[1].dims = [3, 2, 2];
        folder.file("a.q", &encoding.solutions(&other));
        let error = folder.refuse("a.xyz", &grid);
        assert!(
            error.contains("2 x 2 x 3 nodes in grid 2") && error.contains("found 3 x 2 x 2"),
            "{error}"
        );
        folder.file("b.q", &encoding.solutions(&solutions[..1]));
        let error = folder.refuse("b.xyz", &grid);
        assert!(
            error.contains("expected 2 grids, as in the grid, found 1 grid of 3 x 2 x 4"),
            "{error}"
        );
        let swapped = folder.refuse("c.xyz", &encoding.solutions(&solutions));
        assert!(swapped.contains("as its solution"), "{swapped}");
    }
}

/// Each k plane is a record of its own, as some Fortran programs write them.
#[test]
fn plot3d_by_planes_is_refused() {
    let encoding = Plot3dEncoding {
        text: false,
        double: false,
        big_endian: false,
        records: true,
        grid_count: true,
    };
    let [grids, _] = two_blocks();
    let header = [encoding.word(2), encoding.words(&[3, 2, 4, 2, 2, 3])];
    let planes = grids.iter().flat_map(|grid| {
        let size = 4 * grid.numbers.len() / grid.dims[2] as usize;
        vec![vec![0x3f; size]; grid.dims[2] as usize]
    });
    let records: Vec<Vec<u8>> = header.into_iter().chain(planes).collect();
    let error = Folder::new().refuse("planes.xyz", &encoding.file(&records));
    assert!(error.contains("whole format"), "{error}");
}

/// The file's size and the words at its start determine the format.
#[test]
fn plot3d_of_several_grids_needs_no_extension() {
    let [grids, _] = two_blocks();
    for encoding in Plot3dEncoding::all()
        .into_iter()
        .filter(|encoding| encoding.grid_count && !encoding.text)
    {
        let data = Folder::new().open("grid", &encoding.grids(&grids));
        assert_eq!(data.format, "PLOT3D grid");
    }
}

#[test]
fn csv_and_npy_are_recognised_by_content() {
    let folder = Folder::new();
    let body: Vec<u8> = [1.0_f32, 2.0, 3.0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3), }\n";
    for (name, file) in [
        ("a.csv", b"x,y,z\n1,2,3\n".to_vec()),
        ("a.dat", b"# a comment\nx;y;z\n1;2;3\n".to_vec()),
        ("particles", b"x\ty\tz\n1\t2\t3\n".to_vec()),
        ("a.xyz", b"x,y,z\n1,2,3\n".to_vec()),
        ("a.npy", crate::support::npy(1, header, &body)),
        ("b.dat", crate::support::npy(2, header, &body)),
    ] {
        let data = folder.open(name, &file);
        let Geometry::Points { positions } = &data.geometry else {
            panic!("{name}");
        };
        assert_eq!(positions, &[DVec3::new(1.0, 2.0, 3.0)]);
    }
}

/// The bytes are those that `numpy.save` writes.
#[test]
fn npy_written_by_numpy_is_read() {
    let folder = Folder::new();
    let mut file = b"\x93NUMPY\x01\0\x76\0".to_vec();
    file.extend(b"{'descr': '<f8', 'fortran_order': False, 'shape': (2, 4), }");
    file.resize(127, b' ');
    file.push(b'\n');
    file.extend((0..8).flat_map(|i| f64::from(i).to_le_bytes()));
    let data = folder.open("a.npy", &file);
    assert_eq!(values(&data, "c3"), Values::F32(vec![3.0, 7.0]));
}

fn npy_array<const N: usize>(descr: &str, shape: &str, numbers: &[[u8; N]]) -> Vec<u8> {
    let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n");
    crate::support::npy(1, &header, numbers.as_flattened())
}

#[test]
fn npz_archives_of_every_form() {
    let folder = Folder::new();
    let doubles = |numbers: &[f64]| numbers.iter().map(|n| n.to_le_bytes()).collect::<Vec<_>>();
    let rows = doubles(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let mass = npy_array("'>i2'", "(2,)", &[[0, 7], [0, 9]]);
    let velocity = npy_array("'<f8'", "(2, 3)", &rows);
    let axis = |a: f64, b: f64| npy_array("'<f8'", "(2,)", &doubles(&[a, b]));
    let structured = npy_array("[('x', '<f8'), ('y', '<f8'), ('z', '<f8')]", "(2,)", &rows);
    let whole = vec![
        ("Pos.npy", velocity.clone()),
        ("mass.npy", mass.clone()),
        ("v.npy", velocity.clone()),
        ("time.npy", axis(0.5, 0.5)[..].to_vec()),
        ("box.npy", npy_array("'<f8'", "()", &doubles(&[8.0]))),
    ];
    let axes = vec![
        ("x.npy", axis(1.0, 4.0)),
        ("mass.npy", mass.clone()),
        ("z.npy", axis(3.0, 6.0)),
        ("y.npy", axis(2.0, 5.0)),
    ];
    for packed in [true, false] {
        for (members, fields) in [
            (whole.clone(), vec!["mass", "v", "time"]),
            (axes.clone(), vec!["mass"]),
            (vec![("arr_0.npy", structured.clone())], vec![]),
            (vec![("arr_0.npy", velocity.clone())], vec![]),
        ] {
            let data = folder.open("a.npz", &crate::support::npz(&members, packed));
            let Geometry::Points { positions } = &data.geometry else {
                panic!();
            };
            assert_eq!(
                positions,
                &[DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]
            );
            assert_eq!(data.field_names(), fields);
            if fields.contains(&"mass") {
                assert_eq!(values(&data, "mass"), Values::I16(vec![7, 9]));
            }
            if fields.contains(&"v") {
                assert_eq!(values(&data, "v:z"), Values::F32(vec![3.0, 6.0]));
                assert!(data.notes[0].contains("`box`"), "{:?}", data.notes);
            }
        }
    }
}

#[test]
fn particles_of_a_plane_and_half_floats_are_read() {
    let folder = Folder::new();
    let halves = |bits: &[u16]| bits.iter().map(|n| n.to_le_bytes()).collect::<Vec<_>>();
    // 1, 2, .5, -2, 65504, 0.
    let rows = halves(&[0x3c00, 0x4000, 0x3800, 0xc000, 0x7bff, 0]);
    let expected = [
        DVec3::new(1.0, 2.0, 0.0),
        DVec3::new(0.5, -2.0, 0.0),
        DVec3::new(65504.0, 0.0, 0.0),
    ];
    let plane = npy_array("'<f2'", "(3, 2)", &rows);
    let named = npy_array("[('y', '<f2'), ('x', '<f2')]", "(3,)", &{
        let mut swapped = rows.clone();
        swapped
            .as_chunks_mut::<2>()
            .0
            .iter_mut()
            .for_each(|row| row.reverse());
        swapped
    });
    let archive = crate::support::npz(
        &[
            ("pos.npy", plane.clone()),
            ("m.npy", npy_array("'>f2'", "(3,)", &[[0x3c, 0]; 3])),
        ],
        true,
    );
    for (name, bytes) in [("a.npy", &plane), ("b.npy", &named), ("a.npz", &archive)] {
        let data = folder.open(name, bytes);
        let Geometry::Points { positions } = &data.geometry else {
            panic!("{name}");
        };
        assert_eq!(positions, &expected, "{name}");
        assert!(
            data.notes.iter().any(|note| note.contains("z = 0")),
            "{name}"
        );
    }
    assert_eq!(
        values(&folder.open("a.npz", &archive), "m"),
        Values::F32(vec![1.0; 3])
    );
    let space = npy_array(
        "'<f2'",
        "(1, 4)",
        &halves(&[0x3c00, 0x4000, 0x3800, 0x3555]),
    );
    let data = folder.open("a.npy", &space);
    assert_eq!(values(&data, "c3"), Values::F32(vec![0.333_251_95]));
    // Whole numbers, or no more rows than columns: such an array may be any table.
    let integers = npy_array("'<i4'", "(3, 2)", &[[1, 0, 0, 0]; 6]);
    assert!(folder.refuse("a.npy", &integers).contains("(N, 3 or more)"));
    let square = npy_array("'<f4'", "(2, 2)", &[[0; 4]; 4]);
    assert!(folder.refuse("a.npy", &square).contains("(N, 3 or more)"));
    let data = folder.open("a.csv", b"y,x,h\n2,1,.5\n4,3,.5\n");
    assert_eq!(data.bounds().unwrap().1, DVec3::new(3.0, 4.0, 0.0));
}

#[test]
fn npz_archives_that_claim_too_much_are_refused() {
    let folder = Folder::new();
    let other = crate::support::npz(&[("a.txt", vec![1, 2, 3])], true);
    assert!(folder.refuse("a.npz", &other).contains("no arrays"));
    let array = npy_array("'<f4'", "(2, 3)", &[[0; 4]; 6]);
    let short = crate::support::npz(&[("x.npy", array.clone()), ("z.npy", array.clone())], true);
    assert!(folder.refuse("a.npz", &short).contains("no column `y`"));
    // The directory states sizes beyond what deflate can reach.
    let mut bomb = crate::support::npz(&[("x.npy", array.clone())], true);
    let size = (array.len() as u32).to_le_bytes();
    let at: Vec<usize> = (0..bomb.len() - 4)
        .filter(|&at| bomb[at..at + 4] == size)
        .collect();
    assert!(!at.is_empty());
    for at in at {
        bomb[at..at + 4].copy_from_slice(&0x7fff_ffff_u32.to_le_bytes());
    }
    let error = folder.refuse("a.npz", &bomb);
    assert!(error.contains("2147483647 bytes packed into"), "{error}");
}

#[test]
fn a_raw_volume_needs_its_layout() {
    let folder = Folder::new();
    let path = folder.file("nucleon_2x2x1_int16.raw", &[1, 0, 2, 0, 3, 0, 255, 255]);
    match open(&path, &OpenOptions::default()) {
        Err(Error::NoLayout {
            suggested: Some(layout),
            ..
        }) => assert_eq!((layout.dims, layout.scalar), ([2, 2, 1], "i16")),
        other => panic!("{other:?}"),
    }
    let mut layout = RawLayout::new([2, 2, 1], RawType::I16);
    layout.origin = DVec3::new(1.0, 0.0, 0.0);
    layout.spacing = DVec3::splat(0.5);
    let options = OpenOptions {
        raw: Some(layout),
        ..OpenOptions::default()
    };
    let data = open(&path, &options).unwrap();
    assert_eq!(values(&data, "value"), Values::I16(vec![1, 2, 3, -1]));
    let Geometry::Lattice(lattice) = &data.geometry else {
        panic!()
    };
    assert_eq!(lattice.position([1, 1, 0]), DVec3::new(1.5, 0.5, 0.0));
}

#[test]
fn what_is_no_data_file_is_refused() {
    let folder = Folder::new();
    for (name, bytes, words) in [
        ("empty.vti", &b""[..], "empty"),
        ("a.vtk", b"# vtk DataFile Version 3.0\n", "ASCII or BINARY"),
        ("a.obj", b"vn 0 0 1\n", "expected a vertex"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "HDF5"),
        ("a.foo", b"\x00\x01\x02", "none of these"),
        ("a.raw", b"\x00\x01\x02", "dimensions and type"),
        ("a.raw.gz", b"\x1f\x8b\x02", "dimensions and type"),
        ("a.vtu.gz", b"\x1f\x8b\x02", "gunzip"),
    ] {
        let err = folder.refuse(name, bytes);
        assert!(err.contains(words), "{err}");
    }
    let folder_err = open(folder.0.path(), &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(folder_err.contains("a directory"));
    assert!(open(&folder.0.path().join("none"), &OpenOptions::default()).is_err());
}

fn picture() -> Image {
    let mut image = Image::new(5, 3);
    for (i, pixel) in image.pixels.iter_mut().enumerate() {
        let a = i as f32 / 14.0;
        *pixel = [a * 0.9, a * a * 0.5, 0.1 * a, a];
    }
    image
}

#[test]
fn float_images_come_back_exactly() {
    let folder = Folder::new();
    for name in ["a.exr", "a.npy"] {
        let path = folder.0.path().join(name);
        write_image(&path, &picture()).unwrap();
        assert_eq!(read_image(&path).unwrap(), picture());
    }
}

#[test]
fn png_images_come_back_to_half_a_step() {
    let folder = Folder::new();
    let path = folder.0.path().join("a.png");
    write_image(&path, &picture()).unwrap();
    let read = read_image(&path).unwrap();
    for (read, pixel) in read.pixels.iter().zip(&picture().pixels) {
        for c in 0..4 {
            // Half a step of 1/255 in alpha, and half a step in colour times the curve's greatest
            // slope (2.4 / 1.055).
            assert!(
                (read[c] - pixel[c]).abs() <= 0.5 / 255.0 * (1.0 + 2.4),
                "{read:?} {pixel:?}"
            );
        }
    }
}

#[test]
fn depth_images_keep_infinity() {
    let folder = Folder::new();
    let depth = DepthImage {
        width: 2,
        height: 2,
        depths: vec![1.0, f32::INFINITY, 2.5, 3.0],
    };
    for name in ["d.exr", "d.pfm", "d.npy"] {
        write_depth(&folder.0.path().join(name), &depth).unwrap();
    }
    let grey = read_image(&folder.0.path().join("d.pfm")).unwrap();
    assert_eq!(
        grey.pixels.iter().map(|p| p[0]).collect::<Vec<_>>(),
        depth.depths
    );
    let npy = std::fs::read(folder.0.path().join("d.npy")).unwrap();
    let (header, numbers) = npy.split_at(128);
    let header = String::from_utf8_lossy(header);
    assert!(header.contains("'descr': '<f4'") && header.contains("'shape': (2, 2), }"));
    let depths = numbers.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
    assert_eq!(depths.collect::<Vec<_>>(), depth.depths);
    let exr = std::fs::read(folder.0.path().join("d.exr")).unwrap();
    let exr = exr::image::read::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(std::io::Cursor::new(exr))
        .unwrap();
    let channel = &exr.layer_data.channel_data.list[0];
    assert_eq!(channel.name.to_string(), "Z");
    let depths: Vec<f32> = channel.sample_data.values_as_f32().collect();
    assert_eq!(depths, depth.depths);
}

/// `Temp` finds `Temp [K]` if that is the only match; a field of exactly that name is found first.
#[test]
fn units_in_brackets_behind_names_are_units() {
    let read = |header: &str| {
        let table = format!("x,y,z,{header}\n0,0,0,1,2,3\n1,0,0,4,5,6\n");
        ewa_splat::io::read("a.csv", table.as_bytes(), &OpenOptions::default()).unwrap()
    };
    let first = |data: &ewa_splat::io::Dataset, name: &str| {
        let found = data.scalar(name);
        found.map(|(_, values)| values.get(0)).ok()
    };
    let data = read("Temp [K],rho[g/cm^3],v[0]");
    assert_eq!(data.field_names(), ["Temp [K]", "rho[g/cm^3]", "v[0]"]);
    assert_eq!(data.unit("temp"), Some("K"));
    assert_eq!(data.unit("Temp [K]"), Some("K"));
    assert_eq!(data.unit("rho"), Some("g/cm^3"));
    assert_eq!(data.unit("v[0]"), None);
    assert_eq!(
        [first(&data, "temp"), first(&data, "RHO")],
        [Some(1.0), Some(2.0)]
    );
    assert_eq!(first(&data, "v"), None);
    let data = read("T [K],T [eV],T");
    assert_eq!((first(&data, "T"), data.unit("T")), (Some(3.0), None));
    let data = read("T [K],T [eV],m");
    assert_eq!(first(&data, "T"), None);
    assert_eq!(
        (first(&data, "t [ev]"), data.unit("t [ev]")),
        (Some(2.0), Some("eV"))
    );
}
