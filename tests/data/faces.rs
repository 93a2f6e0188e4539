//! Tests points with faces: PLY and VTK files, read as meshes, or as points if asked for.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use crate::common::real_data;
use crate::support::meshes::{SQUARE, png, rich_gltf};
use crate::support::splats::{
    Element, Ply, glb_splats, some_splats, splat_ply, splat_records, spz,
};
use crate::support::vtk_legacy::LegacyVtk;
use crate::support::{
    Folder, VtkArray, VtkEncoding, XmlPiece, float32, int32, int64, uint8, vtk_xml,
};
use ewa_splat::image::linear_from_srgb;
use ewa_splat::io::{
    AlphaMode, CellKind, Dataset, Geometry, Mesh, MeshPart, OpenOptions, ReadAs, open,
};
use ewa_splat::scene::Values;
use glam::{DVec3, Vec2, Vec3};

const XYZ: [&str; 3] = ["float x", "float y", "float z"];
const INDICES: &[&str] = &["list uchar int vertex_indices"];

fn mesh(data: &Dataset) -> &Mesh {
    let Geometry::Mesh(mesh) = &data.geometry else {
        panic!("{}: {:?}", data.path.display(), data.notes)
    };
    mesh.validate().unwrap();
    mesh
}

fn part(data: &Dataset) -> &MeshPart {
    let [part] = mesh(data).parts.as_slice() else {
        panic!("{} parts", mesh(data).parts.len())
    };
    part
}

/// Returns the normals of triangles, twice their areas long.
fn normals(part: &MeshPart) -> Vec<DVec3> {
    let corners = part.triangles.iter();
    let corners = corners.map(|t| t.map(|i| part.positions[i as usize]));
    corners.map(|[a, b, c]| (b - a).cross(c - a)).collect()
}

fn read_as(folder: &Folder, name: &str, bytes: &[u8], what: ReadAs) -> Result<Dataset, String> {
    let options = OpenOptions {
        read_as: Some(what),
        ..OpenOptions::default()
    };
    open(&folder.file(name, bytes), &options).map_err(|e| e.to_string())
}

fn square_rows(more: &[[f64; 2]; 4]) -> Vec<Vec<f64>> {
    let corners = SQUARE.chunks(3).zip(more);
    corners.map(|(xyz, more)| [xyz, more].concat()).collect()
}

// PLY.

#[test]
fn ply_polygons_are_triangles_with_colours_and_normals() {
    let folder = Folder::new();
    // A square, an arrow head (concave at its third corner), and a triangle.
    let places = [
        [0.0, 0.0],
        [1.0, 0.0],
        [1.0, 1.0],
        [0.0, 1.0],
        [5.0, -1.0],
        [3.5, 0.0],
        [5.0, 1.0],
        [3.0, 0.0],
    ];
    let codes = |i: usize| {
        [
            255.0,
            0.0,
            51.0 + i as f64,
            if i == 2 { 102.0 } else { 255.0 },
        ]
    };
    let faces = [
        vec![4.0, 0.0, 1.0, 2.0, 3.0],
        vec![4.0, 7.0, 4.0, 5.0, 6.0],
        vec![3.0, 0.0, 1.0, 2.0],
    ];
    for encoding in Ply::ALL {
        for (kind, scale) in [
            ("uchar", 1.0),
            ("ushort", 257.0),
            ("float", 1.0 / 255.0),
            ("int", 1.0),
        ] {
            let colours = ["red", "green", "blue", "alpha"].map(|c| format!("{kind} {c}"));
            let mut properties = vec!["float nx", "double ny", "float nz"];
            properties.extend(XYZ);
            properties.extend(colours.iter().map(String::as_str));
            properties.push("short quality");
            let rows: Vec<Vec<f64>> = places
                .iter()
                .enumerate()
                .map(|(i, [x, y])| {
                    let mut row = vec![0.0, 0.0, 4.0, *x, *y, 2.0];
                    row.extend(codes(i).map(|code| code * scale));
                    row.push(7.0);
                    row
                })
                .collect();
            let elements: [Element<'_>; 3] = [
                ("edge", &["int vertex1"], &[vec![1.0]]),
                (
                    "face",
                    &[
                        "uchar flags",
                        "list ushort uint vertex_index",
                        "list uchar float rest",
                    ],
                    &{
                        let row =
                            |face: &Vec<f64>| [&[9.0], face.as_slice(), &[2.0, 0.5, -0.5]].concat();
                        faces.iter().map(row).collect::<Vec<_>>()
                    },
                ),
                ("vertex", &properties, &rows),
            ];
            let data = folder.open("a.ply", &encoding.file("", &elements));
            let what = format!("{encoding:?} {kind}: {:?}", data.notes);
            assert_eq!(data.format, "PLY mesh");
            let part = part(&data);
            assert_eq!(part.positions[5], DVec3::new(3.5, 0.0, 2.0), "{what}");
            assert_eq!(part.triangles.len(), 5, "{what}");
            let normals = normals(part);
            assert!(
                normals
                    .iter()
                    .all(|n| n.x == 0.0 && n.y == 0.0 && n.z > 0.0)
            );
            // Twice the areas are 2, 1 and 1.
            let area: f64 = normals.iter().map(|n| n.z).sum();
            assert!((area - 4.0).abs() < 1e-12, "{area}");
            assert!(part.normals.iter().all(|n| *n == Vec3::Z));
            for (i, colour) in part.colours.iter().enumerate() {
                let [r, g, b, a] = codes(i).map(|code| (code / 255.0) as f32);
                let expected = [r, g, b].map(linear_from_srgb);
                // Files of floats hold rounded fractions.
                let off = |c: usize| (colour[c] - expected[c]).abs();
                assert!(
                    (0..3).all(|c| off(c) < 1e-6) && (colour[3] - a).abs() < 1e-6,
                    "{what}"
                );
            }
            let material = &mesh(&data).materials[part.material];
            assert_eq!(
                (material.alpha, material.base_colour),
                (AlphaMode::Blend, [1.0; 4])
            );
            assert!(material.is_double_sided);
            let note = |words: &str| data.notes.iter().any(|n| n.contains(words));
            assert!(note("not shown: `quality`"), "{what}");
            assert_eq!(note("taken as 0 to 255"), kind == "int", "{what}");
        }
    }
}

#[test]
fn ply_strips_keep_their_sides() {
    let folder = Folder::new();
    // A row of four squares, and a separate one.
    let rows: Vec<Vec<f64>> = (0..14)
        .map(|i| vec![f64::from(i / 2), f64::from(i % 2), 0.0])
        .collect();
    // The upper corner follows the lower one, so that the first triangle faces +z. A corner named
    // twice reverses the strip.
    let first = [1.0, 0.0, 3.0, 2.0, 5.0, 4.0, 7.0, 6.0, 9.0, 8.0];
    for (end, kind) in [(-1.0, "int"), (f64::from(u32::MAX), "uint")] {
        let mut strip = first.to_vec();
        strip.extend([end, 11.0, 10.0, 13.0, 12.0, end]);
        strip.insert(0, strip.len() as f64);
        for encoding in Ply::ALL {
            let list = format!("list int {kind} vertex_indices");
            let elements: [Element<'_>; 2] = [
                ("vertex", &XYZ, &rows),
                ("tristrips", &[list.as_str()], std::slice::from_ref(&strip)),
            ];
            let data = folder.open("a.ply", &encoding.file("", &elements));
            let normals = normals(part(&data));
            assert_eq!(normals.len(), 10);
            assert!(normals.iter().all(|n| *n == DVec3::Z), "{normals:?}");
            assert!(data.notes.is_empty(), "{:?}", data.notes);
            let file = std::fs::read(&data.path).unwrap();
            let points = read_as(&folder, "a.ply", &file, ReadAs::Points).unwrap();
            assert!(points.notes[0].contains("1 strips are not used"));
        }
    }
}

#[test]
fn closed_ply_meshes_are_seen_from_outside_alone() {
    let folder = Folder::new();
    let rows = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vec::from);
    let sides = [
        [0.0, 2.0, 1.0],
        [0.0, 1.0, 3.0],
        [1.0, 2.0, 3.0],
        [2.0, 0.0, 3.0],
    ];
    let faces: Vec<Vec<f64>> = sides.iter().map(|f| [&[3.0], &f[..]].concat()).collect();
    for count in [4, 3] {
        let elements: [Element<'_>; 2] =
            [("vertex", &XYZ, &rows), ("face", INDICES, &faces[..count])];
        let data = folder.open("a.ply", &Ply::Little.file("", &elements));
        assert_eq!(mesh(&data).materials[0].is_double_sided, count == 3);
        assert!(mesh(&data).materials[0].base_colour[0] < 1.0, "plain grey");
    }
}

#[test]
fn ply_textures_are_laid_on() {
    let folder = Folder::new();
    folder.file("a b.png", &png(2, &[[255, 0, 0, 255], [0, 255, 0, 255]]));
    folder.file("c.png", &png(1, &[[9, 9, 9, 255]]));
    let uv = [[0.0, 0.25], [1.0, 0.25], [1.0, 0.75], [0.0, 0.75]];
    let rows = square_rows(&uv);
    let face = [vec![4.0, 0.0, 1.0, 2.0, 3.0]];
    for names in [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]] {
        let [u, v] = names.map(|n| format!("float {n}"));
        let properties = [&XYZ[..], &[&u, &v]].concat();
        let elements: [Element<'_>; 2] = [("vertex", &properties, &rows), ("face", INDICES, &face)];
        let file = |comments| Ply::Ascii.file(comments, &elements);
        let data = folder.open("a.ply", &file("comment TextureFile a b.png\n"));
        let textured = mesh(&data);
        assert_eq!(textured.textures[0].image.width, 2);
        assert!(textured.materials[0].base_texture.is_some());
        assert_eq!(textured.materials[0].base_colour, [1.0; 4]);
        // v points up in the file and down here.
        let flipped = uv.map(|[u, v]| Vec2::new(u as f32, 1.0 - v as f32));
        assert_eq!(part(&data).texture_coordinates, [flipped.to_vec()]);

        let missing = folder.open("a.ply", &file("comment TextureFile none.png\n"));
        assert!(mesh(&missing).textures.is_empty());
        assert!(
            missing.notes[0].contains("no file `none.png`"),
            "{:?}",
            missing.notes
        );
        let options = OpenOptions {
            texture: Some(folder.path().join("c.png")),
            ..OpenOptions::default()
        };
        let by_hand = open(&folder.file("a.ply", &file("")), &options).unwrap();
        assert_eq!(mesh(&by_hand).textures[0].image.pixels, [[9, 9, 9, 255]]);
    }
    let elements: [Element<'_>; 2] = [
        (
            "vertex",
            &XYZ,
            &SQUARE.chunks(3).map(<[f64]>::to_vec).collect::<Vec<_>>(),
        ),
        ("face", INDICES, &face),
    ];
    let bare = folder.open(
        "a.ply",
        &Ply::Big.file("comment TextureFile c.png\n", &elements),
    );
    assert!(mesh(&bare).textures.is_empty());
    assert!(
        bare.notes[0].contains("no texture coordinates"),
        "{:?}",
        bare.notes
    );
}

/// Texture coordinates belong to faces' corners where the texture is cut; faces use two textures.
#[test]
fn ply_faces_have_coordinates_of_their_own() {
    let folder = Folder::new();
    folder.file("0.png", &png(1, &[[1, 1, 1, 255]]));
    folder.file("1.png", &png(1, &[[2, 2, 2, 255]]));
    let rows: Vec<Vec<f64>> = SQUARE.chunks(3).map(<[f64]>::to_vec).collect();
    let face = |corners: [f64; 3], uv: [f64; 6], number: f64| {
        [&[3.0], &corners[..], &[6.0], &uv[..], &[number]].concat()
    };
    let uv = [0.0, 0.0, 0.5, 0.0, 0.5, 0.5];
    let properties: &[&str] = &[
        "list uchar int vertex_indices",
        "list uchar float texcoord",
        "int texnumber",
    ];
    for encoding in Ply::ALL {
        let read = |comments: &str, faces: &[Vec<f64>]| {
            let elements: [Element<'_>; 2] = [("vertex", &XYZ, &rows), ("face", properties, faces)];
            folder.open("a.ply", &encoding.file(comments, &elements))
        };
        let faces = [
            face([0.0, 1.0, 2.0], uv, 1.0),
            face([0.0, 2.0, 3.0], uv, 0.0),
        ];
        let one = read("comment TextureFile 1.png\n", &faces);
        // Vertex 0 has the same coordinates in both faces, vertex 2 has different ones.
        assert_eq!(part(&one).positions.len(), 5, "{encoding:?}");
        assert_eq!(part(&one).triangles, [[0, 1, 2], [0, 3, 4]]);
        assert_eq!(part(&one).texture_coordinates[0][3], Vec2::new(0.5, 1.0));

        let two = "comment TextureFile 0.png\ncomment TextureFile 1.png\n";
        let data = read(two, &faces);
        let parts = &mesh(&data).parts;
        assert_eq!(parts.len(), 2);
        let pixel = |part: &MeshPart| {
            let material = &mesh(&data).materials[part.material];
            let texture = material.base_texture.as_ref().unwrap().texture;
            mesh(&data).textures[texture].image.pixels[0][0]
        };
        assert_eq!([pixel(&parts[0]), pixel(&parts[1])], [1, 2]);
        assert!(parts[1].positions.contains(&DVec3::X) && !parts[0].positions.contains(&DVec3::X));

        // The number of an absent texture, and lists that do not fit.
        let data = read(two, &[face([0.0, 1.0, 2.0], uv, 5.0)]);
        assert!(mesh(&data).materials[0].base_texture.is_none());
        let short = [[3.0, 0.0, 1.0, 2.0, 2.0, 0.0, 0.0, 0.0].to_vec()];
        let data = read(two, &short);
        assert!(
            data.notes[0].contains("not two for each corner"),
            "{:?}",
            data.notes
        );
    }
}

#[test]
fn ply_faces_that_cannot_be_are_refused() {
    let folder = Folder::new();
    let rows: Vec<Vec<f64>> = SQUARE.chunks(3).map(<[f64]>::to_vec).collect();
    for encoding in Ply::ALL {
        for (corner, words) in [(4.0, "found vertex 4"), (-1.0, "found vertex -1")] {
            let faces = [vec![3.0, 0.0, 1.0, 2.0], vec![3.0, 0.0, 1.0, corner]];
            let elements: [Element<'_>; 2] = [("vertex", &XYZ, &rows), ("face", INDICES, &faces)];
            let error = folder.refuse("a.ply", &encoding.file("", &elements));
            assert!(error.contains("element `face`, row 1 of 2"), "{error}");
            assert!(
                error.contains(words) && error.contains("among 4"),
                "{error}"
            );
        }
        // No face has an area.
        let faces = [vec![0.0], vec![2.0, 0.0, 1.0], vec![3.0, 0.0, 1.0, 1.0]];
        let elements: [Element<'_>; 2] = [("vertex", &XYZ, &rows), ("face", INDICES, &faces)];
        let error = folder.refuse("a.ply", &encoding.file("", &elements));
        assert!(error.contains("a triangle with an area"), "{error}");
    }
    let head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
                property float z\nelement face 1\nproperty list uint int vertex_indices\n\
                end_header\n0 0 0\n";
    for (row, words) in [
        ("4000000000 0 0 0", "end of the line"),
        ("3 0 0 0.5", "found vertex 0.5"),
        ("3 0 0 nan", "found vertex NaN"),
        ("3 0 0 x", "found `x`"),
    ] {
        let error = folder.refuse("a.ply", format!("{head}{row}\n").as_bytes());
        assert!(error.contains(words), "{error}");
    }
    let mut huge = Ply::Little.file(
        "",
        &[
            ("vertex", &XYZ, &rows),
            ("face", &["list uint uint vertex_indices"], &[vec![0.0]]),
        ],
    );
    let at = huge.len() - 4;
    huge[at..].copy_from_slice(&u32::MAX.to_le_bytes());
    let error = folder.refuse("a.ply", &huge);
    assert!(error.contains("the end of the file"), "{error}");
}

#[test]
fn what_has_no_faces_or_is_asked_for_stays_points() {
    let folder = Folder::new();
    let rows = square_rows(&[[1.0, 2.0]; 4]);
    let properties = [&XYZ[..], &["float mass", "uchar red"]].concat();
    let face = [vec![3.0, 0.0, 1.0, 2.0]];
    let with: [Element<'_>; 2] = [("vertex", &properties, &rows), ("face", INDICES, &face)];
    let without: [Element<'_>; 2] = [("vertex", &properties, &rows), ("face", INDICES, &[])];
    for encoding in Ply::ALL {
        let [with, without] = [&with, &without].map(|e| encoding.file("", e));
        let table = folder.open("a.ply", &without);
        assert!(table.notes.is_empty());
        let points = read_as(&folder, "a.ply", &with, ReadAs::Points).unwrap();
        assert!(points.notes[0].contains("1 faces are not used"));
        for data in [table, points] {
            assert!(
                matches!(&data.geometry, Geometry::Points { positions } if positions.len() == 4)
            );
            assert_eq!(data.field_names(), ["mass", "red"]);
        }
        let same = read_as(&folder, "a.ply", &with, ReadAs::Mesh).unwrap();
        assert_eq!(part(&same).triangles.len(), 1);
        let error = read_as(&folder, "a.ply", &without, ReadAs::Mesh).unwrap_err();
        assert!(
            error.contains("a.ply: geometry: expected what can be read as a mesh"),
            "{error}"
        );
        assert!(error.contains("points without faces"), "{error}");
    }
    let splats = splat_ply(Ply::Little, "", &some_splats(3, 0), &[]);
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for (name, bytes, what, found) in [
        ("s.ply", splats.as_slice(), ReadAs::Mesh, Some("splats")),
        ("s.ply", &splats, ReadAs::Points, Some("splats")),
        (
            "a.obj",
            obj,
            ReadAs::Points,
            Some("is read as nothing else"),
        ),
        ("a.obj", obj, ReadAs::Mesh, None),
        ("a.csv", b"x,y,z\n1,2,3\n", ReadAs::Points, None),
    ] {
        match (read_as(&folder, name, bytes, what), found) {
            (Err(error), Some(found)) => assert!(error.contains(found), "{error}"),
            (Ok(_), None) => {}
            (outcome, _) => panic!("{name}: {:?}", outcome.err()),
        }
    }
}

// VTK.

const POINTS: [f32; 18] = [
    0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0., 2., 0., 0., 2., 1., 0.,
];

fn piece(
    point_data: Vec<VtkArray>,
    counts: &str,
    elements: Vec<(&'static str, Vec<VtkArray>)>,
) -> XmlPiece {
    let mut all = vec![
        ("PointData", point_data),
        ("Points", vec![float32("Points", 3, &POINTS)]),
    ];
    all.extend(elements);
    XmlPiece {
        attributes: format!("NumberOfPoints=\"6\" {counts}"),
        elements: all,
    }
}

fn runs(connectivity: &[i32], offsets: &[i32]) -> Vec<VtkArray> {
    vec![
        int32("connectivity", 1, connectivity),
        int32("offsets", 1, offsets),
    ]
}

#[test]
fn vtk_polygons_and_strips_are_a_mesh() {
    let folder = Folder::new();
    for encoding in VtkEncoding::all() {
        let bytes: Vec<u8> = (0..24).map(|i| 10 * i).collect();
        let surface = piece(
            vec![
                uint8("ids", 1, &[1; 6]),
                float32("NORMALS", 3, &[0., 0., 2.].repeat(6)),
                uint8("colours", 4, &bytes),
            ],
            "NumberOfPolys=\"1\" NumberOfStrips=\"1\" NumberOfVerts=\"1\" NumberOfLines=\"1\"",
            vec![
                ("Verts", runs(&[0], &[1])),
                ("Lines", runs(&[0, 1], &[2])),
                ("Polys", runs(&[0, 1, 2, 3], &[4])),
                ("Strips", runs(&[2, 1, 5, 4], &[4])),
            ],
        );
        let data = folder.open("a.vtp", &vtk_xml(encoding, "PolyData", "", &[surface]));
        let part = part(&data);
        assert_eq!(part.positions.len(), 6, "{encoding:?}");
        assert!(
            normals(part).iter().all(|n| *n == DVec3::Z),
            "{:?}",
            part.triangles
        );
        assert_eq!(part.triangles.len(), 4);
        assert!(part.normals.iter().all(|n| *n == Vec3::Z));
        let share = |i: usize| f32::from(bytes[i]) / 255.0;
        let expected = [
            linear_from_srgb(share(4)),
            linear_from_srgb(share(5)),
            linear_from_srgb(share(6)),
        ];
        assert_eq!(
            part.colours[1],
            [expected[0], expected[1], expected[2], share(7)]
        );
        assert_eq!(mesh(&data).materials[0].alpha, AlphaMode::Blend);
        assert_eq!(
            data.notes,
            ["2 points and lines are not shown beside the surface"]
        );
        // Arrays that are neither colour nor normal stay fields.
        assert_eq!(data.field_names(), ["ids"]);
        assert_eq!(data.scalar("ids").unwrap().1.len(), 6);
    }
}

#[test]
fn vtk_surfaces_are_points_where_these_are_asked_for() {
    let folder = Folder::new();
    let surface = piece(
        vec![uint8("p", 1, &[1, 2, 3, 4, 5, 6])],
        "NumberOfPolys=\"1\"",
        vec![
            ("CellData", vec![uint8("c", 1, &[9])]),
            ("Polys", runs(&[0, 1, 2], &[3])),
        ],
    );
    let file = vtk_xml(VtkEncoding::TEXT, "PolyData", "", &[surface]);
    let data = read_as(&folder, "a.vtp", &file, ReadAs::Points).unwrap();
    assert!(matches!(&data.geometry, Geometry::Points { positions } if positions.len() == 6));
    assert_eq!(
        data.scalar("p").unwrap().1,
        Values::U8(vec![1, 2, 3, 4, 5, 6])
    );
    assert_eq!(data.field_names(), ["p"]);
    assert!(
        data.notes[0].contains("1 cell arrays left out"),
        "{:?}",
        data.notes
    );
    assert_eq!(part(&folder.open("a.vtp", &file)).triangles, [[0, 1, 2]]);
}

/// A quarter disc as one second-order triangle: its curved edges are followed, and values with
/// them.
#[test]
fn flat_cells_of_second_order_are_followed() {
    let folder = Folder::new();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let points = [
        0., 0., 0., 1., 0., 0., 0., 1., 0., 0.5, 0., 0., half, half, 0., 0., 0.5, 0.,
    ];
    let x: Vec<f32> = points.chunks(3).map(|p| p[0]).collect();
    let grid = XmlPiece {
        attributes: "NumberOfPoints=\"6\" NumberOfCells=\"1\"".into(),
        elements: vec![
            ("PointData", vec![float32("x", 1, &x)]),
            ("CellData", vec![uint8("c", 1, &[9])]),
            ("Points", vec![float32("Points", 3, &points)]),
            (
                "Cells",
                vec![
                    int64("connectivity", 1, &[0, 1, 2, 3, 4, 5]),
                    int32("offsets", 1, &[6]),
                    uint8("types", 1, &[22]),
                ],
            ),
        ],
    };
    let file = vtk_xml(VtkEncoding::RAW, "UnstructuredGrid", "", &[grid]);
    let data = folder.open("a.vtu", &file);
    let part = part(&data);
    let sum: f64 = normals(part).iter().map(|n| n.z).sum();
    // Twice the area: half of it below the chord of length 2^.5. Above the chord, it is two thirds
    // of the chord times the height of the parabola, (2^-.5 - .5) 2^.5. Polygons are inscribed.
    let expected = 1.0 + 8.0 / 3.0 * (f64::from(half) - 0.5);
    assert!(sum > 0.98 * expected && sum < expected, "{sum}, {expected}");
    let (_, x) = data.scalar("x").unwrap();
    assert_eq!(x.len(), part.positions.len());
    for (i, position) in part.positions.iter().enumerate() {
        assert!(
            (f64::from(x.get(i)) - position.x).abs() < 1e-6,
            "{position}"
        );
    }
    let (_, c) = data.scalar("c").unwrap();
    assert_eq!(c, Values::U8(vec![9; part.triangles.len()]));
}

/// Ghosts identify the cells, which are numbered in the order verts, lines, polys, strips.
#[test]
fn vtk_cells_that_are_hidden_are_left_out() {
    let folder = Folder::new();
    let file = |ghosts: &[u8]| {
        let surface = piece(
            vec![],
            "NumberOfVerts=\"1\" NumberOfPolys=\"2\" NumberOfStrips=\"1\"",
            vec![
                ("CellData", vec![uint8("vtkGhostType", 1, ghosts)]),
                ("Strips", runs(&[2, 1, 5, 4], &[4])),
                ("Polys", runs(&[0, 1, 2, 0, 2, 3], &[3, 6])),
                ("Verts", runs(&[0], &[1])),
            ],
        );
        vtk_xml(VtkEncoding::RAW, "PolyData", "", &[surface])
    };
    let count = |ghosts: &[u8]| part(&folder.open("a.vtp", &file(ghosts))).triangles.len();
    assert_eq!(count(&[0, 0, 0, 0]), 4);
    assert_eq!(count(&[1, 0, 0, 0]), 4);
    assert_eq!(count(&[0, 1, 0, 0]), 3);
    assert_eq!(count(&[0, 0, 32, 0]), 3);
    assert_eq!(count(&[0, 0, 0, 1]), 2);
    let error = folder.refuse("a.vtp", &file(&[0, 1, 1, 1]));
    assert!(error.contains("a triangle with an area"), "{error}");
}

#[test]
fn flat_unstructured_grids_are_a_mesh_and_others_stay() {
    let folder = Folder::new();
    let open_cells = |cells: &[(u8, &[i64])]| {
        let ends = cells.iter().scan(0, |end, (_, nodes)| {
            *end += i32::try_from(nodes.len()).unwrap();
            Some(*end)
        });
        let ends: Vec<i32> = ends.collect();
        let nodes: Vec<i64> = cells.iter().flat_map(|(_, n)| n.iter().copied()).collect();
        let kinds: Vec<u8> = cells.iter().map(|(kind, _)| *kind).collect();
        let grid = piece(
            vec![],
            &format!("NumberOfCells=\"{}\"", cells.len()),
            vec![(
                "Cells",
                vec![
                    int64("connectivity", 1, &nodes),
                    int32("offsets", 1, &ends),
                    uint8("types", 1, &kinds),
                ],
            )],
        );
        let file = vtk_xml(VtkEncoding::RAW, "UnstructuredGrid", "", &[grid]);
        open(&folder.file("a.vtu", &file), &OpenOptions::default())
    };
    let quad: (u8, &[i64]) = (CellKind::QUAD.0, &[0, 1, 2, 3]);
    // Each covers the unit square or half of it.
    for (cell, twice_area) in [
        (quad, 2.0),
        ((CellKind::PIXEL.0, &[0, 1, 3, 2][..]), 2.0),
        ((CellKind::TRIANGLE.0, &[0, 1, 2]), 1.0),
        ((CellKind::POLYGON.0, &[0, 1, 2, 3]), 2.0),
        ((CellKind::TRIANGLE_STRIP.0, &[3, 0, 2, 1]), 2.0),
        ((36, &[0, 1, 2, 3, 4, 4, 5, 5]), 2.0),
    ] {
        let data = open_cells(&[cell, (CellKind::LINE.0, &[0, 1])]).unwrap();
        let normals = normals(part(&data));
        assert!(normals.iter().all(|n| n.z > 0.0), "{cell:?}");
        let sum: f64 = normals.iter().map(|n| n.z).sum();
        assert_eq!(sum, twice_area, "{cell:?}");
        let is_told = data.notes.iter().any(|n| n.contains("of a higher order"));
        assert_eq!(is_told, cell.0 == 36, "{:?}", data.notes);
    }
    // A solid, and an unknown kind.
    for kind in [CellKind::TETRA.0, 41] {
        let data = open_cells(&[quad, (kind, &[0, 1, 2, 4])]).unwrap();
        assert!(matches!(data.geometry, Geometry::Cells(_)), "{kind}");
    }
    let error = open_cells(&[(CellKind::QUAD.0, &[0, 1, 2])]).unwrap_err();
    assert!(
        error.to_string().contains("cell 0, quadrilateral"),
        "{error}"
    );
}

#[test]
fn legacy_vtk_surfaces_are_a_mesh() {
    let folder = Folder::new();
    for mut vtk in LegacyVtk::all() {
        vtk.line("DATASET POLYDATA");
        vtk.array("POINTS 6", &float32("", 3, &POINTS));
        vtk.cells("TRIANGLE_STRIPS", &[&[2, 1, 5, 4]]);
        vtk.cells("POLYGONS", &[&[0, 1, 2], &[0, 2, 3]]);
        vtk.lines("POINT_DATA 6\nCOLOR_SCALARS c 3");
        let bytes: Vec<u8> = (0..18).map(|i| 51 * (i % 6)).collect();
        if vtk.binary {
            vtk.numbers(&uint8("", 3, &bytes));
        } else {
            let shares: Vec<f32> = bytes.iter().map(|b| f32::from(*b) / 255.0).collect();
            vtk.numbers(&float32("", 3, &shares));
        }
        let data = folder.open("a.vtk", &vtk.file);
        let part = part(&data);
        assert!(
            normals(part).iter().all(|n| *n == DVec3::Z),
            "{:?}",
            vtk.version
        );
        assert_eq!(part.triangles.len(), 4);
        let expected = [153, 204, 255_u8].map(|b| linear_from_srgb(f32::from(b) / 255.0));
        assert_eq!(part.colours[1][..3], expected, "{:?}", data.notes);
        assert_eq!(mesh(&data).materials[0].alpha, AlphaMode::Opaque);
    }
}

// Real files, and their direction up.

#[test]
fn real_files_with_faces_are_meshes() {
    for (name, triangles, closed, size) in [
        ("meshes/cube_uv.ply", 12, true, [2.0, 2.0, 2.0]),
        ("meshes/float-color.ply", 1, false, [200.0, 200.0, 0.0]),
        ("meshes/shark.ply", 5116, false, [150.07, 62.089, 38.6384]),
    ] {
        let Some(path) = real_data(&format!("formats/{name}")) else {
            return;
        };
        let data = open(&path, &OpenOptions::default()).unwrap();
        let part = part(&data);
        assert_eq!(part.triangles.len(), triangles, "{name}: {:?}", data.notes);
        assert_eq!(mesh(&data).materials[0].is_double_sided, !closed, "{name}");
        let corners = part.positions.iter();
        let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| {
            (a.min(*p), b.max(*p))
        });
        // The cube is off by a millionth; the others' numbers have six digits.
        assert!(
            (high - low - DVec3::from(size)).abs().max_element() < 1e-5,
            "{name}: {low} {high}"
        );
        if name.contains("float") {
            assert_eq!(part.colours, [[0.0, 0.0, 1.0, 1.0]; 3]);
        }
    }
    for step in 0..=10 {
        let folder = "formats/collections/pvd/singleSphereAnimation";
        let name = format!("{folder}/singleSphereAnimation_source93T00{step:02}.vtp");
        let Some(path) = real_data(&name) else {
            return;
        };
        let data = open(&path, &OpenOptions::default()).unwrap();
        let part = part(&data);
        assert!(part.triangles.len() > 10 && part.normals.len() == part.positions.len());
        // The sphere of radius 1/2 is cut open. Its normals point away from its centre, within the
        // angle between neighbours of a dozen.
        for (p, n) in part.positions.iter().zip(&part.normals) {
            assert!((p.length() - 0.5).abs() < 1e-6, "{name}: {p}");
            assert!(n.as_dvec3().dot(*p) > 0.4, "{name}: {p} {n}");
        }
    }
}

#[test]
fn every_format_says_what_is_up() {
    let folder = Folder::new();
    let square: Vec<Vec<f64>> = SQUARE.chunks(3).map(<[f64]>::to_vec).collect();
    let face = [vec![3.0, 0.0, 1.0, 2.0]];
    let elements: [Element<'_>; 2] = [("vertex", &XYZ, &square), ("face", INDICES, &face)];
    let splats = some_splats(4, 0);
    let surface = piece(
        vec![],
        "NumberOfPolys=\"1\"",
        vec![("Polys", runs(&[0, 1, 2], &[3]))],
    );
    let disc = b"x,y,z\n0,0,0\n9,1,0\n0,0,9\n9,1,9\n";
    for (name, bytes, expected) in [
        (
            "a.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(),
            DVec3::Y,
        ),
        ("a.glb", rich_gltf().glb(), DVec3::Y),
        ("b.glb", glb_splats(&splats), DVec3::Y),
        ("a.ply", Ply::Big.file("", &elements), DVec3::Z),
        (
            "a.vtp",
            vtk_xml(VtkEncoding::RAW, "PolyData", "", &[surface]),
            DVec3::Z,
        ),
        (
            "b.ply",
            splat_ply(Ply::Little, "", &splats, &[]),
            DVec3::NEG_Y,
        ),
        ("a.splat", splat_records(&splats), DVec3::NEG_Y),
        // Rotated to the axes of the two files before it.
        ("a.spz", spz(3, 0, &splats), DVec3::NEG_Y),
        ("a.csv", b"x,y,z\n0,0,0\n9,9,9\n".to_vec(), DVec3::Z),
        ("b.csv", disc.to_vec(), DVec3::Y),
    ] {
        let up = folder.open(name, &bytes).up();
        assert_eq!(up.direction, expected, "{name}: {}", up.reason);
        assert!(!up.reason.is_empty());
    }
}
