//! Tests `--resize`, `--rotate`, `--translate` and `--crop`: pictures and files of edited inputs.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::fmt::Write;
use std::path::Path;

use ewa_splat::io::{SplatCloud, SplatFileOptions, read_image, write_splats};
use ewa_splat::scene::SplatRule;
use glam::{DQuat, DVec3};

use crate::commands::{files, run, text};

/// Runs the program, which must succeed.
fn done(folder: &Path, line: &str) {
    let words: Vec<&str> = line.split_whitespace().collect();
    let output = run(folder, &words);
    assert!(output.status.success(), "{line}: {}", text(&output.stderr));
}

/// Draws pictures by two command lines. Returns the greatest difference of a channel, and the
/// greatest opacity.
fn difference(folder: &Path, a: &str, b: &str) -> (f32, f32) {
    let picture = |line: &str| {
        done(
            folder,
            &format!("render {line} --backend cpu --out picture.npy"),
        );
        read_image(&folder.join("picture.npy")).unwrap()
    };
    let (a, b) = (picture(a), picture(b));
    assert_eq!((a.width, a.height), (b.width, b.height));
    let mut most = (0.0f32, 0.0f32);
    for (p, q) in a.pixels.iter().zip(&b.pixels) {
        most.1 = most.1.max(p[3]);
        for c in 0..4 {
            most.0 = most.0.max((p[c] - q[c]).abs());
        }
    }
    most
}

/// Returns the options of a camera, moved as the data are.
fn camera(size: f64, rotation: DQuat, translation: DVec3) -> String {
    let place = |p: DVec3| rotation * (size * p) + translation;
    let eye = place(DVec3::new(9.0, -14.0, 6.0));
    let target = place(DVec3::new(2.5, 2.0, 1.5));
    let up = rotation * DVec3::Z;
    let numbers = |v: DVec3| format!("{},{},{}", v.x, v.y, v.z);
    format!(
        "--eye {} --target {} --up {} --size 64x48",
        numbers(eye),
        numbers(target),
        numbers(up)
    )
}

/// Returns the options of a move, and those of the camera moved likewise.
fn moved(axis: DVec3, degrees: f64) -> (String, String) {
    let (size, translation) = (2.5, DVec3::new(3.0, -2.0, 1.0));
    let rotation = DQuat::from_axis_angle(axis.normalize(), degrees.to_radians());
    let options = format!(
        "--resize {size} --rotate {},{},{},{degrees} --translate 3,-2,1",
        axis.x, axis.y, axis.z
    );
    (options, camera(size, rotation, translation))
}

const DIMS: [usize; 3] = [6, 5, 4];

fn wave(p: DVec3) -> f64 {
    1.0 + (1.1 * p.x + 0.3 * p.z).sin() * (0.9 * p.y).cos() + 0.2 * p.z
}

/// Returns the positions of a grid's nodes, x fastest.
fn nodes(place: impl Fn([usize; 3]) -> DVec3) -> Vec<DVec3> {
    let [x, y, z] = DIMS;
    (0..x * y * z)
        .map(|n| place([n % x, n / x % y, n / x / y]))
        .collect()
}

/// Writes a legacy VTK file of these nodes and a field at each.
fn vtk(folder: &Path, name: &str, geometry: &str, nodes: &[DVec3]) {
    let mut file = format!("# vtk DataFile Version 3.0\n{name}\nASCII\n{geometry}");
    let count = nodes.len();
    write!(
        file,
        "POINT_DATA {count}\nSCALARS wave float 1\nLOOKUP_TABLE default\n"
    )
    .unwrap();
    for node in nodes {
        writeln!(file, "{}", wave(*node)).unwrap();
    }
    writeln!(file, "VECTORS flow float").unwrap();
    for node in nodes {
        writeln!(file, "{} {} {}", node.y, -node.x, wave(*node)).unwrap();
    }
    std::fs::write(folder.join(name), file).unwrap();
}

fn points(nodes: &[DVec3]) -> String {
    let mut lines = format!("POINTS {} double\n", nodes.len());
    for p in nodes {
        writeln!(lines, "{} {} {}", p.x, p.y, p.z).unwrap();
    }
    lines
}

const LINES: [&[f64]; 3] = [
    &[0.0, 0.8, 1.9, 3.0, 4.2, 5.0],
    &[0.0, 1.1, 2.0, 2.8, 4.0],
    &[0.0, 0.9, 2.1, 3.0],
];

fn uneven([i, j, k]: [usize; 3]) -> DVec3 {
    DVec3::new(LINES[0][i], LINES[1][j], LINES[2][k])
}

/// `even.vtk`, `uneven.vtk`, `bent.vtk`, `same.vtk` (the nodes of `uneven.vtk` as a curvilinear grid), `cells.vtk`.
fn write_grids(folder: &Path) {
    let [x, y, z] = DIMS;
    let dims = format!("DIMENSIONS {x} {y} {z}\n");
    let even = nodes(|n| DVec3::from(n.map(|n| n as f64)));
    let header = format!("DATASET STRUCTURED_POINTS\n{dims}ORIGIN 0 0 0\nSPACING 1 1 1\n");
    vtk(folder, "even.vtk", &header, &even);
    let lines = |axis: usize| {
        let numbers: Vec<String> = LINES[axis].iter().map(f64::to_string).collect();
        let name = ["X", "Y", "Z"][axis];
        format!(
            "{name}_COORDINATES {} double\n{}\n",
            numbers.len(),
            numbers.join(" ")
        )
    };
    let header = format!(
        "DATASET RECTILINEAR_GRID\n{dims}{}{}{}",
        lines(0),
        lines(1),
        lines(2)
    );
    vtk(folder, "uneven.vtk", &header, &nodes(uneven));
    let bent = nodes(|n| {
        let p = uneven(n);
        let (radius, angle) = (1.0 + 0.5 * p.x, 0.4 * p.y);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), p.z)
    });
    for (name, nodes) in [("bent.vtk", &bent), ("same.vtk", &nodes(uneven))] {
        let header = format!("DATASET STRUCTURED_GRID\n{dims}{}", points(nodes));
        vtk(folder, name, &header, nodes);
    }
    let mut cells = Vec::new();
    for n in 0..x * y * z {
        let [i, j, k] = [n % x, n / x % y, n / x / y];
        if i + 1 < x && j + 1 < y && k + 1 < z {
            let (dy, dz) = (x, x * y);
            let corners = [0, 1, 1 + dy, dy, dz, dz + 1, dz + 1 + dy, dz + dy];
            cells.push(corners.map(|c| (n + c).to_string()).join(" "));
        }
    }
    let count = cells.len();
    let mut header = format!(
        "DATASET UNSTRUCTURED_GRID\n{}CELLS {count} {}\n",
        points(&bent),
        9 * count
    );
    for cell in cells {
        writeln!(header, "8 {cell}").unwrap();
    }
    writeln!(header, "CELL_TYPES {count}\n{}", "12 ".repeat(count)).unwrap();
    vtk(folder, "cells.vtk", &header, &bent);
}

/// Returns disordered but reproducible positions.
fn scattered(count: usize) -> Vec<DVec3> {
    let part = |i: usize, step: f64| (i as f64 * step).fract();
    (0..count)
        .map(|i| {
            let p = DVec3::new(part(i, 0.754_877), part(i, 0.569_840), part(i, 0.381_966));
            p * DVec3::new(5.0, 4.0, 3.0)
        })
        .collect()
}

/// Writes a table with columns for shapes and strengths.
fn table(folder: &Path, name: &str, columns: &str, row: impl Fn(DVec3) -> String, of: &[DVec3]) {
    let mut file = format!("x,y,z,{columns}\n");
    for p in of {
        writeln!(file, "{},{},{},{}", p.x, p.y, p.z, row(*p)).unwrap();
    }
    std::fs::write(folder.join(name), file).unwrap();
}

fn write_tables(folder: &Path) {
    let all = scattered(300);
    let rho = |p: DVec3| format!("0.3,{},{}", 0.2 * wave(p), wave(p));
    table(folder, "sph.csv", "h,m,rho", rho, &all);
    let disc = |p: DVec3| format!("0.09,0.01,0.02,0.04,0,0.01,0.05,{},0.4,0.2", 0.2 * wave(p));
    table(
        folder,
        "discs.csv",
        "vxx,vxy,vxz,vyy,vyz,vzz,mass,r,g,b",
        disc,
        &all,
    );
    let needle = |p: DVec3| format!("0.4,0.1,0.1,1,0.3,-0.2,0.5,{},0.2", 0.3 * wave(p));
    let columns = "scale_0,scale_1,scale_2,rot_0,rot_1,rot_2,rot_3,extinction,volume";
    table(folder, "needles.csv", columns, needle, &all);
    table(folder, "bare.csv", "v", |p| wave(p).to_string(), &all);
}

fn write_splats_file(folder: &Path) {
    let positions = scattered(60);
    let count = positions.len();
    let cloud = SplatCloud {
        positions,
        scales: vec![[0.5, 0.25, 0.1]; count],
        rotations: vec![[0.9, 0.1, -0.3, 0.2]; count],
        opacities: vec![0.7; count],
        harmonics_degree: 3,
        harmonics: (0..48 * count)
            .map(|i| ((13 * i) % 29) as f32 / 40.0 - 0.35)
            .collect(),
        rule: SplatRule::Exact,
        is_linear: false,
        ..SplatCloud::default()
    };
    write_splats(
        &folder.join("splats.ply"),
        &cloud,
        &SplatFileOptions::default(),
    )
    .unwrap();
}

fn write_mesh(folder: &Path) {
    let mesh = "v 0 0 0\nv 5 0 0\nv 5 4 1\nv 0 4 0\nv 2 2 3\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 4 3 2 1\n";
    std::fs::write(folder.join("roof.obj"), mesh).unwrap();
}

/// Options that draw exactly. Approximations depend on blocks, and blocks lie along the world's
/// axes.
const EXACT: &str = "--filter exact --level-of-detail off --refine off --cutoff 6";
const WHOLE: &str = "--level-of-detail off --refine off --cutoff 6";

#[test]
fn data_and_camera_moved_alike_show_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_grids(folder);
    write_tables(folder);
    write_splats_file(folder);
    write_mesh(folder);
    let before = camera(1.0, DQuat::IDENTITY, DVec3::ZERO);
    let oblique = (DVec3::new(1.0, 2.0, 3.0), 50.0);
    let quarter = (DVec3::ONE, 120.0);
    // The tolerance is f32 rounding.
    let rounding = 1e-4;
    // Gradient directions are stored in steps, on a net that does not rotate with the data.
    let steps = 5e-3;
    // Surfels are spread in cubes along the world's axes, so rotated data get them at other
    // positions. The differences at edges decrease with the number of surfels.
    let spread = 5e-3;
    let alone = "--classify particle";
    // The boundary of cells is cut by planes joined from faces, the largest first. Rounding decides
    // among faces of equal size around a node, as in a regular mesh.
    let soft = "--classify particle --boundary soft";
    // By default, tables show the logarithm of the number density, which changes with their size.
    let of_v = "--classify particle --field v";
    for (file, own, (axis, degrees), limit) in [
        ("even.vtk", "", oblique, rounding),
        ("even.vtk", "--flatten 1.2", oblique, rounding),
        ("uneven.vtk", "", quarter, rounding),
        ("uneven.vtk", "", (DVec3::X, -90.0), rounding),
        ("bent.vtk", alone, oblique, rounding),
        ("bent.vtk", "", oblique, steps),
        ("bent.vtk", "--lit", oblique, steps),
        ("cells.vtk", soft, oblique, rounding),
        ("cells.vtk", "", oblique, steps),
        ("sph.csv", alone, oblique, rounding),
        ("discs.csv", "", oblique, rounding),
        ("needles.csv", "", oblique, rounding),
        ("bare.csv", of_v, oblique, rounding),
        ("splats.ply", "", oblique, rounding),
        ("roof.obj", "--count 40000", oblique, spread),
    ] {
        let (options, after) = moved(axis, degrees);
        // An automatic function estimates the opacity of particles along the world's axes.
        let function = |unit: f64| match file {
            "sph.csv" | "bare.csv" => {
                format!("--transfer-function function.json --unit-distance {unit}")
            }
            _ => String::new(),
        };
        if !function(1.0).is_empty() {
            let written = "--write-transfer-function function.json --size 8x8 --out any.png";
            done(folder, &format!("render {file} {own} {written}"));
        }
        // Surfaces and splats have no filter.
        let is_filtered =
            !(own.contains("--flatten") || ["splats.ply", "roof.obj"].contains(&file));
        let exact = if is_filtered { EXACT } else { WHOLE };
        let a = format!("{file} {own} {} {exact} {before}", function(1.0));
        let b = format!("{file} {own} {} {exact} {after} {options}", function(2.5));
        let (most, opacity) = difference(folder, &a, &b);
        assert!(opacity > 0.1, "{file}: an empty picture");
        assert!(most < limit, "{file} {own}: {most}");
    }
    // A rotated rectilinear lattice equals the curvilinear grid of its nodes.
    let (options, after) = moved(oblique.0, oblique.1);
    let (most, _) = difference(
        folder,
        &format!("same.vtk {alone} {EXACT} {before}"),
        &format!("uneven.vtk {alone} {EXACT} {after} {options}"),
    );
    assert!(most < rounding, "{most}");
    // Vectors rotate: the component along z is now along x.
    let (options, after) = moved(DVec3::ONE, 120.0);
    let (most, _) = difference(
        folder,
        &format!("bent.vtk@flow:z {alone} {EXACT} {before}"),
        &format!("bent.vtk@flow:x {alone} {EXACT} {after} {options}"),
    );
    assert!(most < rounding, "{most}");
}

/// A fitted camera keeps the direction up.
#[test]
fn what_is_turned_is_seen_turned() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // A tall wedge with its point at the top.
    let wedge = "v 0 0 0\nv 1 0 0\nv 0 0 1\nv 0.2 3 0.2\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n";
    std::fs::write(folder.join("wedge.obj"), wedge).unwrap();
    let centre = |options: &str| {
        let line = format!(
            "render wedge.obj --elevation 0 --size 60x60 --backend cpu --out a.npy{options}"
        );
        done(folder, &line);
        let image = ewa_splat::io::read_image(&folder.join("a.npy")).unwrap();
        let rows = (0..60).flat_map(|y| (0..60).map(move |x| (x, y)));
        let seen: Vec<usize> = rows
            .filter(|&(x, y)| image.pixel(x, y)[3] > 0.5)
            .map(|(_, y)| y)
            .collect();
        seen.iter().sum::<usize>() as f64 / seen.len() as f64
    };
    // Most of it is at its foot.
    let (upright, upside_down) = (centre(""), centre(" --rotate 0,0,1,180"));
    assert!(
        upright > 33.0 && upside_down < 27.0,
        "{upright} {upside_down}"
    );
}

#[test]
fn cropped_data_are_those_of_files_cut_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_grids(folder);
    write_tables(folder);
    // Samples 1 to 4, 1 to 3 and 0 to 2, cut from a whole grid, so that whole numbers stay.
    let cut: Vec<DVec3> = (0..36)
        .map(|n| DVec3::new((1 + n % 4) as f64, (1 + n / 4 % 3) as f64, (n / 12) as f64))
        .collect();
    let header = "DATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 3\nORIGIN 1 1 0\nSPACING 1 1 1\n";
    vtk(folder, "cut.vtk", header, &cut);
    let (lower, upper) = (DVec3::new(0.5, 1.0, -1.0), DVec3::new(4.0, 3.9, 2.5));
    let inside: Vec<DVec3> = scattered(300)
        .into_iter()
        .filter(|p| p.cmpge(lower).all() && p.cmple(upper).all())
        .collect();
    assert!(inside.len() > 50 && inside.len() < 250);
    let rho = |p: DVec3| format!("0.3,{},{}", 0.2 * wave(p), wave(p));
    table(folder, "cut.csv", "h,m,rho", rho, &inside);
    let crop = "--crop 0.5,1,-1,4,3.9,2.5";
    let view = "--eye 9,-14,6 --target 2.5,2,1.5 --size 48x40";
    for (whole, cut, own) in [
        ("even.vtk", "cut.vtk", "--backend cpu"),
        ("even.vtk", "cut.vtk", "--flatten 1.1 --backend cpu"),
        ("even.vtk", "cut.vtk", "--reference=data --tolerance 1e-2"),
        ("even.vtk", "cut.vtk", "--column-density --backend cpu"),
        ("sph.csv", "cut.csv", "--backend cpu"),
        (
            "sph.csv",
            "cut.csv",
            "--column-density --column-mean h --backend cpu",
        ),
    ] {
        let picture = |line: &str| {
            done(folder, &format!("render {line} {own} {view} --out a.npy"));
            std::fs::read(folder.join("a.npy")).unwrap()
        };
        let edited = picture(&format!("{whole} {crop}"));
        assert_eq!(edited, picture(cut), "{whole} {own}");
        assert_ne!(edited, picture(whole), "{whole} {own}");
    }
}

#[test]
fn each_input_has_its_own_place() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (few, more) = (scattered(20), scattered(40)[20..].to_vec());
    let sigma = |_| "0.25,0.5,1,0,0".to_owned();
    let columns = "sigma,opacity,r,g,b";
    table(folder, "a.csv", columns, sigma, &few);
    table(folder, "b.csv", columns, sigma, &more);
    let beside: Vec<DVec3> = more
        .iter()
        .map(|p| *p + DVec3::new(8.0, 0.0, -1.0))
        .collect();
    table(folder, "moved.csv", columns, sigma, &beside);
    let splats = |line: &str| {
        done(folder, &format!("convert {line} --out out.ply"));
        std::fs::read(folder.join("out.ply")).unwrap()
    };
    let by_hand = splats("a.csv moved.csv");
    let placed = splats("a.csv b.csv --translate none --translate 8,0,-1");
    assert_eq!(placed, by_hand);
    let both = splats("a.csv b.csv --translate 8,0,-1");
    assert_ne!(both, by_hand);
    // The crop box is in the coordinates after the move.
    let cropped =
        splats("a.csv b.csv --translate 8,0,-1 --translate none --crop none --crop -1,-1,-1,6,6,6");
    assert_eq!(
        cropped,
        splats("a.csv b.csv --translate 8,0,-1 --translate 0,0,0")
    );
    let sizes = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let output = run(folder, &words);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        json
    };
    let info = sizes("info a.csv --json --crop 0,0,0,2.5,9,9");
    let bounds = info["bounds"].to_string();
    assert_ne!(bounds, sizes("info a.csv --json")["bounds"].to_string());
}

/// Three factors stretch each axis by its own. Exaggeration stretches along the direction up alone.
#[test]
fn grids_are_stretched_along_each_axis() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_grids(folder);
    let bounds = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let output = run(folder, &words);
        assert!(output.status.success(), "{line}: {}", text(&output.stderr));
        let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let up = info["up"]["direction"].clone();
        let corner = |i: usize| [0, 1, 2].map(|axis| info["bounds"][i][axis].as_f64().unwrap());
        ([corner(0), corner(1)], up)
    };
    let ([low, high], up) = bounds("info even.vtk --json");
    let (stretched, _) = bounds("info even.vtk --json --resize 2,1,50");
    for (corner, own) in stretched.iter().zip([low, high]) {
        assert_eq!(*corner, [2.0 * own[0], own[1], 50.0 * own[2]]);
    }
    let along = (0..3)
        .find(|&i| up[i].as_f64().unwrap().abs() > 0.5)
        .unwrap();
    let (raised, _) = bounds("info even.vtk --json --resize 3 --exaggerate 10");
    for (corner, own) in raised.iter().zip([low, high]) {
        for axis in 0..3 {
            let factor = if axis == along { 30.0 } else { 3.0 };
            assert!((corner[axis] - factor * own[axis]).abs() < 1e-9, "{axis}");
        }
    }
}

#[test]
fn a_series_is_placed_step_by_step() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_grids(folder);
    let line = "even.vtk even.vtk --series --size 40x30 --backend cpu --no-provenance";
    done(folder, &format!("render {line} --out plain_%d.png"));
    done(
        folder,
        &format!("render {line} --out moved_%d.png --resize none --resize 0.5"),
    );
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let files = files(folder);
    let steps: Vec<&String> = files.iter().filter(|f| f.starts_with("moved_")).collect();
    let [first, second] = steps.as_slice() else {
        panic!("two pictures: {files:?}");
    };
    assert_ne!(read(first), read(second));
}

/// Points move by the vectors times the factor, as numpy computes it; a lattice becomes a grid. A field that is none is named.
#[test]
fn points_are_displaced_by_vectors() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/xdmf");
    let folder = tempfile::tempdir().unwrap();
    let bounds = |name: &str, displace: &[&str]| {
        let file = fixtures.join(name);
        let line = [&["info", file.to_str().unwrap(), "--json"], displace].concat();
        let output = run(folder.path(), &line);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        [0, 1].map(|i| [0, 1, 2].map(|axis| info["bounds"][i][axis].as_f64().unwrap()))
    };
    let still = [[0.0; 3], [2.5, 1.5, 1.75]];
    assert_eq!(bounds("mixed_xml.xdmf", &[]), still);
    assert_eq!(bounds("mixed_xml.xdmf", &["--displace", "none"]), still);
    let moved = [[-3.75, -4.25, -4.25], [0.5, -0.5, -1.0]];
    assert_eq!(bounds("mixed_xml.xdmf", &["--displace", "V,-0.5"]), moved);
    // Resizing follows.
    let twice = bounds("mixed_xml.xdmf", &["--displace", "v,-0.5", "--resize", "2"]);
    assert_eq!(twice, moved.map(|corner| corner.map(|x| 2.0 * x)));
    let file = fixtures.join("mixed_xml.xdmf");
    for (name, says) in [
        ("w", "no field of that name"),
        ("T", "a scalar"),
        ("k", "a field of cells"),
        ("v,", "NAME,F"),
        ("v,nan", "NAME,F"),
    ] {
        let line = ["info", file.to_str().unwrap(), "--displace", name];
        let output = run(folder.path(), &line);
        let error = text(&output.stderr);
        assert!(
            !output.status.success() && error.contains(says),
            "{name}: {error}"
        );
    }
    let vtk = "# vtk DataFile Version 3.0\na\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\n\
               SPACING 1 1 1\nPOINT_DATA 8\nVECTORS Displ float\n";
    let vectors = "1 0 0\n".repeat(8);
    std::fs::write(folder.path().join("a.vtk"), format!("{vtk}{vectors}")).unwrap();
    let info = |displace: &[&str]| {
        let output = run(folder.path(), &[&["info", "a.vtk"], displace].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    assert!(info(&[]).contains("before their displacement `Displ`"));
    let moved = info(&["--displace", "Displ,0.25"]);
    assert!(
        !moved.contains("displacement `Displ`") && moved.contains("1.25, 1, 1"),
        "{moved}"
    );
}
