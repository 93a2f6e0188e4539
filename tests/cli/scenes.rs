//! Tests several inputs in one picture: one field, surfels by the pixels of the whole, empty inputs
//! left out, one direction up.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::fmt::Write;
use std::path::Path;

use crate::commands::{run, text};

/// Returns a square of `n` by `n` quadrilaterals from a corner on, with the x coordinate as a
/// field.
fn square(n: usize, [x0, y0]: [f64; 2]) -> String {
    let (mut points, mut values) = (String::new(), String::new());
    for (j, i) in (0..=n).flat_map(|j| (0..=n).map(move |i| (j, i))) {
        let [x, y] = [(i, x0), (j, y0)].map(|(i, at)| at + i as f64 / n as f64);
        writeln!(points, "{x} {y} 0").unwrap();
        writeln!(values, "{x}").unwrap();
    }
    let (mut cells, mut ends) = (String::new(), String::new());
    for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
        let at = |i: usize, j: usize| i + (n + 1) * j;
        let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        let corners = corners.map(|c| c.to_string()).join(" ");
        writeln!(cells, "{corners}").unwrap();
        writeln!(ends, "{}", 4 * (1 + i + n * j)).unwrap();
    }
    let array = |name: &str, kind: &str, count: usize, text: &str| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{count}\" format=\"ascii\">{text}</DataArray>"
        )
    };
    format!(
        "<VTKFile type=\"PolyData\" version=\"1.0\"><PolyData><Piece NumberOfPoints=\"{}\" NumberOfPolys=\"{}\">\
         <PointData>{}</PointData><Points>{}</Points><Polys>{}{}</Polys></Piece></PolyData></VTKFile>",
        (n + 1) * (n + 1),
        n * n,
        array("x", "Float64", 1, &values),
        array("Points", "Float64", 3, &points),
        array("connectivity", "Int32", 1, &cells),
        array("offsets", "Int32", 1, &ends),
    )
}

/// Returns a collection of files.
fn collection(files: &[String]) -> String {
    let entries: String = files
        .iter()
        .enumerate()
        .map(|(i, file)| format!("<DataSet index=\"{i}\" file=\"{file}\"/>"))
        .collect();
    format!(
        "<VTKFile type=\"vtkMultiBlockDataSet\" version=\"1.0\"><vtkMultiBlockDataSet>{entries}</vtkMultiBlockDataSet></VTKFile>"
    )
}

/// Unstructured grid without points, with an empty array.
const EMPTY: &str = "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\"><UnstructuredGrid><Piece NumberOfPoints=\"0\" \
    NumberOfCells=\"0\"><PointData><DataArray type=\"Float32\" Name=\"x\" format=\"ascii\"></DataArray></PointData>\
    <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\"></DataArray></Points><Cells>\
    <DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\"></DataArray>\
    <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\"></DataArray>\
    <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\"></DataArray></Cells></Piece></UnstructuredGrid></VTKFile>";

/// Returns a block of 5 x 5 x 5 nodes that begins at `first` along x.
///
/// - `nodes`, `cells`: fields, each with its factor of x.
fn block(first: usize, nodes: &[(&str, f64)], cells: &[(&str, f64)]) -> String {
    let of = |fields: &[(&str, f64)], n: usize| -> String {
        fields
            .iter()
            .map(|(name, factor)| {
                let values: String = (0..n * n * n)
                    .map(|i| format!("{} ", factor * (first + i % n) as f64))
                    .collect();
                format!("<DataArray type=\"Float32\" Name=\"{name}\" format=\"ascii\">{values}</DataArray>")
            })
            .collect()
    };
    let extent = format!("{first} {} 0 4 0 4", first + 4);
    format!(
        "<VTKFile type=\"ImageData\" version=\"1.0\"><ImageData WholeExtent=\"{extent}\" Origin=\"0 0 0\" Spacing=\"1 1 1\">\
         <Piece Extent=\"{extent}\"><PointData>{}</PointData><CellData>{}</CellData></Piece></ImageData></VTKFile>",
        of(nodes, 5),
        of(cells, 4)
    )
}

/// Draws inputs. Returns the statistics and the messages.
fn drawn(folder: &Path, inputs: &[&str], more: &[&str]) -> (serde_json::Value, String) {
    let own = ["--size", "128x128", "--stats", "s.json", "--backend", "cpu"];
    // Pictures of different commands are compared byte by byte.
    let out = ["--no-provenance", "--out", "a.png"];
    let words = [&["render"], inputs, &own, &out, more].concat();
    let output = run(folder, &words);
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    let stats = std::fs::read(folder.join("s.json")).unwrap();
    (serde_json::from_slice(&stats).unwrap(), said)
}

fn particles(stats: &serde_json::Value) -> u64 {
    stats["particles"].as_u64().unwrap()
}

#[test]
fn surfaces_share_the_pixels_of_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut files = Vec::new();
    for i in 0..16 {
        let name = format!("q{i}.vtp");
        let corner = [(i % 4) as f64, (i / 4) as f64];
        std::fs::write(at.join(&name), square(2, corner)).unwrap();
        files.push(name);
    }
    std::fs::write(at.join("all.vtm"), collection(&files)).unwrap();
    std::fs::write(at.join("one.vtp"), square(8, [0.0, 0.0])).unwrap();
    let (one, _) = drawn(at, &["one.vtp"], &[]);
    let (all, _) = drawn(at, &["all.vtm"], &[]);
    let (one, all) = (particles(&one), particles(&all));
    // The number of surfels depends on the pixels, not on the number of pieces.
    assert!(all < one + one / 5 && all > one / 2, "{all}, {one}");
    // The same holds in a series and beside a volume.
    let (beside, _) = {
        std::fs::write(at.join("v.vti"), block(0, &[("p", 1.0)], &[])).unwrap();
        drawn(at, &["one.vtp", "v.vti"], &[])
    };
    assert!(particles(&beside) < 2 * one + 125, "{beside}");
    // A number that is asked for is met.
    let (asked, _) = drawn(at, &["all.vtm"], &["--count", "100"]);
    assert!((1500..1700).contains(&particles(&asked)), "{asked}");
}

#[test]
fn blocks_show_one_field() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // T is first in two of the blocks, p in all; k is constant.
    let blocks = [
        block(0, &[("k", 0.0), ("T", 5.0), ("p", 1.0)], &[]),
        block(4, &[("p", 1.0), ("k", 0.0)], &[]),
        block(8, &[("T", 5.0), ("p", 1.0), ("k", 0.0)], &[]),
    ];
    let mut files = Vec::new();
    for (i, block) in blocks.iter().enumerate() {
        let name = format!("b{i}.vti");
        std::fs::write(at.join(&name), block).unwrap();
        files.push(name);
    }
    std::fs::write(at.join("all.vtm"), collection(&files)).unwrap();
    // All blocks share one function; several would be refused.
    drawn(at, &["all.vtm"], &["--write-transfer-function", "f.json"]);
    let function = std::fs::read_to_string(at.join("f.json")).unwrap();
    let function: serde_json::Value = serde_json::from_str(&function).unwrap();
    let range = &function["range"];
    assert!(range[1].as_f64().unwrap() <= 12.0, "{function}");
    let default = std::fs::read(at.join("a.png")).unwrap();
    drawn(at, &["all.vtm"], &["--field", "p"]);
    assert_eq!(std::fs::read(at.join("a.png")).unwrap(), default);
}

#[test]
fn nodes_and_cells_may_share_a_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let both = block(0, &[("same", 1.0)], &[("same", -3.0)]);
    std::fs::write(at.join("b.vti"), both).unwrap();
    let low = |inputs: &[&str], more: &[&str]| {
        let more = [more, &["--write-transfer-function", "f.json"]].concat();
        drawn(at, inputs, &more);
        let function = std::fs::read_to_string(at.join("f.json")).unwrap();
        let function: serde_json::Value = serde_json::from_str(&function).unwrap();
        function["range"][0].as_f64().unwrap()
    };
    assert!(low(&["b.vti"], &["--field", "same@nodes"]) >= 0.0);
    assert!(low(&["b.vti"], &["--field", "same@cells"]) < -8.0);
    assert!(low(&["b.vti@same@cells"], &[]) < -8.0);
    assert!(low(&["b.vti@same@cells@viridis"], &[]) < -8.0);
    assert!(low(&["b.vti@same@nodes"], &[]) >= 0.0);
    let output = run(at, &["info", "b.vti", "--field", "other"]);
    let said = text(&output.stderr);
    assert!(said.contains("same@nodes, same@cells"), "{said}");
}

#[test]
fn parts_of_nothing_are_left_out_with_one_note() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("e0.vtu"), EMPTY).unwrap();
    std::fs::write(at.join("e1.vtu"), EMPTY).unwrap();
    std::fs::write(at.join("q.vtp"), square(4, [0.0, 0.0])).unwrap();
    let files = ["e0.vtu", "q.vtp", "e1.vtu"].map(str::to_owned);
    std::fs::write(at.join("all.vtm"), collection(&files)).unwrap();
    let (_, said) = drawn(at, &["all.vtm"], &[]);
    let expected = "2 of 3 inputs hold nothing to draw and are left out: e0.vtu, e1.vtu";
    assert!(
        said.contains(expected) && said.lines().count() == 1,
        "{said}"
    );
    let pvd = |files: &[(f64, &str)]| -> String {
        let entries: String = files
            .iter()
            .enumerate()
            .map(|(i, (t, f))| format!("<DataSet timestep=\"{t}\" part=\"{i}\" file=\"{f}\"/>"))
            .collect();
        format!(
            "<VTKFile type=\"Collection\" version=\"0.1\"><Collection>{entries}</Collection></VTKFile>"
        )
    };
    std::fs::write(at.join("a.pvd"), pvd(&[(0.0, "e0.vtu"), (0.0, "q.vtp")])).unwrap();
    drawn(at, &["a.pvd"], &[]);
    // A step that holds nothing gives an empty picture.
    let steps = pvd(&[(0.0, "e0.vtu"), (1.0, "q.vtp")]);
    std::fs::write(at.join("s.pvd"), steps).unwrap();
    let words = [
        "render", "s.pvd", "--series", "--size", "64x64", "--out", "s%d.png",
    ];
    let output = run(at, &words);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(at.join("s0.png").exists() && at.join("s1.png").exists());
    // An entirely empty collection is an error.
    std::fs::write(at.join("n.vtm"), collection(&files[2..])).unwrap();
    let output = run(at, &["render", "n.vtm", "--out", "n.png"]);
    assert!(text(&output.stderr).contains("at least one point"));
}

#[test]
fn cells_without_a_field_are_drawn_as_their_outside() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // Two adjacent cubes: ten of their twelve faces are outside.
    let grid = "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\"><UnstructuredGrid><Piece NumberOfPoints=\"12\" \
        NumberOfCells=\"2\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">\
        0 0 0 1 0 0 2 0 0 0 1 0 1 1 0 2 1 0 0 0 1 1 0 1 2 0 1 0 1 1 1 1 1 2 1 1</DataArray></Points><Cells>\
        <DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 4 3 6 7 10 9 1 2 5 4 7 8 11 10</DataArray>\
        <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">8 16</DataArray>\
        <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">12 12</DataArray></Cells></Piece></UnstructuredGrid>\
        </VTKFile>";
    std::fs::write(at.join("c.vtu"), grid).unwrap();
    let (stats, said) = drawn(at, &["c.vtu"], &[]);
    assert!(particles(&stats) > 1000, "{stats}");
    assert!(said.contains("the outside of the cells is drawn"), "{said}");
}

#[test]
fn the_boundary_of_a_grid_is_drawn_alone_or_around_its_volume() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // 4 x 3 x 5 bytes.
    std::fs::write(at.join("v.raw"), (0..60).collect::<Vec<u8>>()).unwrap();
    let raw = ["--dims", "4,3,5", "--count", "2000"];
    let with = |more: &[&str]| {
        let (stats, _) = drawn(at, &["v.raw"], &[&raw, more].concat());
        let picture = std::fs::read(at.join("a.png")).unwrap();
        (particles(&stats), picture)
    };
    let (surfels, alone) = with(&["--surface"]);
    // Squares and cells are rounded to whole numbers.
    assert!((1900..2100).contains(&surfels), "{surfels}");
    // A soft boundary has no ghosts: the volume has one kernel for each sample.
    let soft = ["--surface-opacity", ".3", "--boundary", "soft"];
    let around = with(&soft);
    assert_eq!(around.0, surfels + 60);
    assert!(around.1 != alone);
    assert!(with(&[&["--surface"], &soft[..]].concat()) == around);
    // The boundary is that of the cropped data: a different picture than that of all data.
    assert!(with(&["--surface", "--crop", "0,0,0,2,1,4"]).1 != alone);
}

/// Returns a box of sides 1, 3 and 1 whose longest side lies along an axis.
fn tall(axis: usize) -> [[f64; 3]; 8] {
    std::array::from_fn(|i| {
        let side = |a: usize| if i >> a & 1 == 0 { 0.0 } else { 1.0 };
        let mut corner = [side(0), side(1), side(2)];
        corner[axis] *= 3.0;
        corner
    })
}

const FACES: [[usize; 4]; 6] = [
    [0, 2, 3, 1],
    [4, 5, 7, 6],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 4, 6, 2],
    [1, 3, 7, 5],
];

#[test]
fn inputs_of_other_axes_are_turned() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut obj = String::new();
    for [x, y, z] in tall(1) {
        writeln!(obj, "v {x} {y} {z}").unwrap();
    }
    for face in FACES {
        let corners = face.map(|c| (c + 1).to_string()).join(" ");
        writeln!(obj, "f {corners}").unwrap();
    }
    std::fs::write(at.join("y.obj"), obj).unwrap();
    let mut ply = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
         element face 6\nproperty list uchar int vertex_indices\nend_header\n"
        .to_owned();
    for [x, y, z] in tall(2) {
        writeln!(ply, "{} {y} {z}", x + 3.0).unwrap();
    }
    for face in FACES {
        let corners = face.map(|c| c.to_string()).join(" ");
        writeln!(ply, "4 {corners}").unwrap();
    }
    std::fs::write(at.join("z.ply"), ply).unwrap();
    let up = ["--up", "0,0,1"];
    let picture = || std::fs::read(at.join("a.png")).unwrap();
    let (_, said) = drawn(at, &["y.obj", "z.ply"], &up);
    let expected = "y.obj: +y is up (OBJ mostly has y up), +z in the picture: turned to it; --keep-axes leaves it";
    assert!(said.contains(expected), "{said}");
    let turned = picture();
    // The up directions of all inputs point up in the picture.
    drawn(at, &["y.obj", "z.ply"], &[]);
    assert!(picture() == turned);
    let by_hand = ["--rotate", "1,0,0,90", "--rotate", "none"];
    let (_, said) = drawn(at, &["y.obj", "z.ply"], &[&up[..], &by_hand].concat());
    assert!(said.is_empty(), "{said}");
    assert!(picture() == turned);
    let keeps = [&up[..], &["--keep-axes"]].concat();
    let (_, said) = drawn(at, &["y.obj", "z.ply"], &keeps);
    assert!(said.is_empty(), "{said}");
    assert!(picture() != turned);
}

#[test]
fn a_series_is_checked_as_a_picture_is() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let splats = "x,y,z,scale_0,scale_1,scale_2,rot_0,rot_1,rot_2,rot_3,opacity\n\
        0,0,0,.1,.1,.1,1,0,0,0,.5\n1,1,1,.1,.1,.1,1,0,0,0,.5\n";
    std::fs::write(at.join("a.csv"), splats).unwrap();
    std::fs::write(at.join("b.csv"), splats).unwrap();
    let own = ["--lit", "--size", "32x32", "--out"];
    let one = run(at, &[&["render", "a.csv"], &own[..], &["a.png"]].concat());
    let all = ["render", "a.csv", "b.csv", "--series"];
    let all = run(at, &[&all[..], &own, &["a%d.png"]].concat());
    let (one, all) = (text(&one.stderr), text(&all.stderr));
    assert!(one.contains("--lit") && one == all, "{one}{all}");
}
