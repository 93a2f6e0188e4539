//! Tests that one rule applies to columns of colours: points, vertices and faces in all file
//! formats and number types.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{Dataset, Geometry, Mesh, OpenOptions, read};
use ewa_splat::sample::{SampleOptions, Sampled, volume};
use ewa_splat::scene::Colour;

fn open(name: &str, bytes: &[u8]) -> Dataset {
    match read(name, bytes, &OpenOptions::default()) {
        Ok(data) => data,
        Err(error) => panic!("{name}: {error}"),
    }
}

fn sampled(data: Dataset) -> Sampled {
    volume(data, &SampleOptions::default()).unwrap()
}

fn colours(sampled: &Sampled) -> Vec<[f32; 3]> {
    match &sampled.volume.colour {
        Colour::PerParticle(colours) => colours.clone(),
        other => panic!("{other:?}"),
    }
}

fn mesh(data: &Dataset) -> &Mesh {
    match &data.geometry {
        Geometry::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn assert_near(found: &[f32], expected: &[f32], tolerance: f32) {
    let is_near = |(a, b): (&f32, &f32)| (a - b).abs() <= tolerance;
    assert!(
        found.iter().zip(expected).all(is_near) && found.len() == expected.len(),
        "{found:?} in place of {expected:?}"
    );
}

/// Byte codes of three colours, and the linear light for each.
const CODES: [[f64; 3]; 3] = [
    [255.0, 128.0, 0.0],
    [10.0, 200.0, 77.0],
    [188.0, 1.0, 255.0],
];

fn light() -> Vec<[f32; 3]> {
    let decode = |code: f64| {
        let x = code / 255.0;
        let linear = if x <= 0.04045 {
            x / 12.92
        } else {
            ((x + 0.055) / 1.055).powf(2.4)
        };
        linear as f32
    };
    CODES.iter().map(|rgb| rgb.map(decode)).collect()
}

/// Names of columns, their type, and the stored number for a code.
type Stored = ([&'static str; 3], &'static str, Box<dyn Fn(f64) -> f64>);

fn stored() -> Vec<Stored> {
    let named = [
        ["red", "green", "blue"],
        ["diffuse_red", "diffuse_green", "diffuse_blue"],
        ["Red", "Green", "Blue"],
    ];
    let mut all: Vec<Stored> = Vec::new();
    for names in named.into_iter().chain([["r", "g", "b"]]) {
        all.push((names, "uchar", Box::new(|code| code)));
        all.push((names, "ushort", Box::new(|code| 257.0 * code)));
        all.push((names, "ushort", Box::new(|code| code)));
        all.push((names, "int", Box::new(|code| code)));
        all.push((names, "float", Box::new(|code| code)));
        all.push((names, "double", Box::new(|code| 257.0 * code)));
        match names {
            ["r", ..] => all.push((
                names,
                "float",
                Box::new(|code| {
                    let x: f64 = code / 255.0;
                    if x <= 0.04045 {
                        x / 12.92
                    } else {
                        ((x + 0.055) / 1.055).powf(2.4)
                    }
                }),
            )),
            _ => all.push((names, "float", Box::new(|code| code / 255.0))),
        }
    }
    all
}

const CORNERS: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

#[test]
fn points_vertices_and_faces_follow_one_rule() {
    for (names, kind, of_code) in stored() {
        let properties: String = names
            .iter()
            .map(|n| format!("property {kind} {n}\n"))
            .collect();
        let numbers = |i: usize| {
            let numbers = CODES[i].map(|code| of_code(code).to_string());
            numbers.join(" ")
        };
        let what = format!("{names:?} {kind} {}", numbers(1));
        let xyz = "property float x\nproperty float y\nproperty float z\n";
        let place = |i: usize| CORNERS[i].map(|x| x.to_string()).join(" ");
        let row = |i: usize| format!("{} {}\n", place(i), numbers(i));
        let rows: String = (0..3).map(row).collect();

        // Points.
        let header = format!("ply\nformat ascii 1.0\nelement vertex 3\n{xyz}{properties}");
        let points = format!("{header}end_header\n{rows}");
        let sampled_points = sampled(open("a.ply", points.as_bytes()));
        let found = colours(&sampled_points);
        let tolerance = if kind == "uchar" { 1e-6 } else { 3e-6 };
        assert_near(found.as_flattened(), light().as_flattened(), tolerance);
        let is_said = sampled_points
            .report
            .warnings()
            .iter()
            .any(|line| line.contains("are taken as 0 to"));
        let is_by_type = kind == "uchar" || (kind == "ushort" && of_code(1.0) > 1.0);
        assert_eq!(is_said, !is_by_type && of_code(255.0) > 1.0, "{what}");

        // Vertices.
        let face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
        let vertices = format!("{header}{face}{rows}3 0 1 2\n");
        let data = open("a.ply", vertices.as_bytes());
        let found: Vec<[f32; 3]> = mesh(&data).parts[0]
            .colours
            .iter()
            .map(|[r, g, b, _]| [*r, *g, *b])
            .collect();
        assert_near(found.as_flattened(), light().as_flattened(), tolerance);
        let is_said_of_mesh = data
            .notes
            .iter()
            .any(|note| note.contains("are taken as 0 to"));
        assert_eq!(is_said_of_mesh, is_said, "{what}: {:?}", data.notes);

        // Faces: three triangles, each of one corner of its own.
        let header = format!(
            "ply\nformat ascii 1.0\nelement vertex 5\n{xyz}element face 3\nproperty list uchar int \
             vertex_indices\n{properties}end_header\n"
        );
        let fan = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n-1 0 0\n";
        let of_face = |i: usize| format!("3 0 {} {} {}\n", i + 1, i + 2, numbers(i));
        let faces: String = (0..3).map(of_face).collect();
        let data = open("a.ply", format!("{header}{fan}{faces}").as_bytes());
        let part = &mesh(&data).parts[0];
        assert_eq!(part.triangles.len(), 3);
        for (triangle, expected) in part.triangles.iter().zip(light()) {
            for corner in triangle {
                assert_near(&part.colours[*corner as usize][..3], &expected, tolerance);
            }
        }

        // Tables.
        if kind != "uchar" && kind != "ushort" {
            let header = format!("x,y,z,{}", names.join(","));
            let table = format!("{header}\n{}", rows.replace(' ', ","));
            let found = colours(&sampled(open("a.csv", table.as_bytes())));
            assert_near(found.as_flattened(), light().as_flattened(), tolerance);
        }
    }
}

#[test]
fn bright_fractions_of_r_g_b_stay_linear() {
    let table = b"x,y,z,r,g,b\n0,0,0,2.5,0,1\n1,0,0,.5,0,1\n0,1,0,0,.25,15.5\n";
    let found = sampled(open("a.csv", table));
    assert_eq!(colours(&found)[0], [2.5, 0.0, 1.0]);
    assert_eq!(colours(&found)[2], [0.0, 0.25, 15.5]);
}

#[test]
fn what_is_no_colour_is_a_field_and_what_is_ignored_is_said() {
    let rows = |columns: &str, numbers: [&str; 3]| {
        let places = ["0,0,0", "1,0,0", "0,1,0"];
        let rows: String = (0..3)
            .map(|i| format!("{},{}\n", places[i], numbers[i]))
            .collect();
        sampled(open("a.csv", format!("x,y,z,{columns}\n{rows}").as_bytes()))
    };
    let warnings = |sampled: &Sampled| sampled.report.warnings().join("; ");
    // A distance from an axis is no colour.
    let found = rows("r,sigma", ["0.5,1", "1,1", "2,1"]);
    assert_eq!(found.report.field.as_deref(), Some("r"));
    assert!(warnings(&found).is_empty(), "{}", warnings(&found));
    // Two bands of a camera are no colour, either.
    let found = rows("red,nir,sigma", ["5,1,1", "10,1,1", "20,1,1"]);
    assert_eq!(found.report.field.as_deref(), Some("red"));
    assert!(warnings(&found).contains("one or two of the three columns"));
    let found = rows(
        "red,green,blue,diffuse_red,diffuse_green,diffuse_blue,alpha",
        ["1,0,0,0,0,1,1", "1,0,0,0,0,1,0.5", "1,0,0,0,0,1,0.5"],
    );
    assert_eq!(colours(&found)[0], [1.0, 0.0, 0.0]);
    assert!(warnings(&found).contains("other columns of colours"));
    assert!(warnings(&found).contains("2 particles: have an `alpha` below 1"));
}

#[test]
fn vertices_colours_are_before_those_of_faces() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
        element face 1\nproperty list uchar int vertex_indices\nproperty uchar red\n\
        property uchar green\nproperty uchar blue\nproperty uchar alpha\nend_header\n\
        0 0 0 255 0 0\n1 0 0 255 0 0\n0 1 0 255 0 0\n3 0 1 2 0 0 255 128\n";
    let data = open("a.ply", text.as_bytes());
    assert_eq!(mesh(&data).parts[0].colours, [[1.0, 0.0, 0.0, 1.0]; 3]);
    assert!(
        data.notes
            .iter()
            .any(|n| n.contains("colours of faces are not used"))
    );
    // Without others they count, with their opacity.
    let alone = text
        .replacen(
            "property uchar red\nproperty uchar green\nproperty uchar blue\n",
            "",
            1,
        )
        .replace(" 255 0 0\n", "\n");
    let data = open("a.ply", alone.as_bytes());
    assert_near(
        &mesh(&data).parts[0].colours[0],
        &[0.0, 0.0, 1.0, 128.0 / 255.0],
        1e-6,
    );
}

#[test]
fn colours_of_vtk_cells_are_those_of_their_triangles() {
    let vtp = r#"<VTKFile type="PolyData" version="1.0"><PolyData>
        <Piece NumberOfPoints="4" NumberOfPolys="2" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0">
        <PointData><DataArray type="Float32" Name="t" format="ascii">0 1 2 3</DataArray></PointData>
        <CellData><DataArray type="UInt8" Name="Colors" NumberOfComponents="3" format="ascii">
        255 0 0 0 0 255</DataArray></CellData>
        <Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">
        0 0 0 1 0 0 1 1 0 0 1 0</DataArray></Points>
        <Polys><DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 0 2 3</DataArray>
        <DataArray type="Int32" Name="offsets" format="ascii">3 6</DataArray></Polys>
        </Piece></PolyData></VTKFile>"#;
    let data = open("a.vtp", vtp.as_bytes());
    let part = &mesh(&data).parts[0];
    let of = |triangle: usize| part.triangles[triangle].map(|i| part.colours[i as usize]);
    assert_eq!(of(0), [[1.0, 0.0, 0.0, 1.0]; 3]);
    assert_eq!(of(1), [[0.0, 0.0, 1.0, 1.0]; 3]);
    // Fields of points follow the points' corners.
    let (_, t) = data.scalar("t").unwrap();
    assert_eq!(t.len(), part.positions.len());
    for (i, p) in part.positions.iter().enumerate() {
        let expected = [[0.0, 1.0], [3.0, 2.0]][p.y as usize][p.x as usize];
        assert_eq!(t.get(i), expected);
    }
}

#[test]
fn colours_of_binary_faces_are_those_of_their_triangles() {
    let vertices: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    for (kind, is_float) in [("uchar", false), ("float", true)] {
        let mut file = format!(
            "ply\nformat binary_big_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
             property float z\nelement face 2\nproperty list uchar int vertex_indices\n\
             property {kind} red\nproperty {kind} green\nproperty {kind} blue\nend_header\n"
        )
        .into_bytes();
        file.extend(vertices.as_flattened().iter().flat_map(|x| x.to_be_bytes()));
        for (corners, colour) in [([0_i32, 1, 2], [1_u8, 0, 0]), ([0, 2, 3], [0, 0, 1])] {
            file.push(3);
            file.extend(corners.iter().flat_map(|i| i.to_be_bytes()));
            match is_float {
                true => file.extend(colour.iter().flat_map(|c| f32::from(*c).to_be_bytes())),
                false => file.extend(colour.map(|c| 255 * c)),
            }
        }
        let data = open("a.ply", &file);
        let part = &mesh(&data).parts[0];
        let of = |triangle: usize| part.triangles[triangle].map(|i| part.colours[i as usize]);
        assert_eq!(of(0), [[1.0, 0.0, 0.0, 1.0]; 3], "{kind}");
        assert_eq!(of(1), [[0.0, 0.0, 1.0, 1.0]; 3], "{kind}");
    }
}
