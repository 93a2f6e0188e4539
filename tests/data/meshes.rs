//! Tests meshes: real files with known properties, and small files for each trap of OBJ and glTF.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::collections::HashMap;
use std::path::Path;

use crate::common::real_data;
use crate::support::Folder;
use crate::support::meshes::{
    F32, Gltf, I16, RICH_MTL, RICH_OBJ, SQUARE, SQUARE_UV, U8, U16, U32, component_bytes, jpeg,
    png, rich_gltf,
};
use ewa_splat::image::linear_from_srgb;
use ewa_splat::io::{
    AlphaMode, Dataset, Geometry, Material, Mesh, MeshPart, OpenOptions, Wrap, open,
};
use glam::{Affine2, DVec3, Vec2};
use serde_json::{Value, json};

fn mesh(data: &Dataset) -> &Mesh {
    let Geometry::Mesh(mesh) = &data.geometry else {
        panic!("{}: no mesh", data.path.display())
    };
    check_promises(mesh);
    mesh
}

/// Checks the invariants of [`Mesh`] for any file.
#[track_caller]
fn check_promises(mesh: &Mesh) {
    assert!(mesh.triangle_count() > 0);
    for part in &mesh.parts {
        let n = part.positions.len();
        assert!(part.positions.iter().all(|p| p.is_finite()));
        assert!(
            part.triangles
                .as_flattened()
                .iter()
                .all(|i| (*i as usize) < n)
        );
        assert!(part.normals.is_empty() || part.normals.len() == n);
        assert!(part.colours.is_empty() || part.colours.len() == n);
        assert!(part.colours.as_flattened().iter().all(|c| c.is_finite()));
        for normal in &part.normals {
            // An f64 direction rounded to f32.
            assert!((normal.length() - 1.0).abs() < 1e-6, "{normal}");
        }
        for set in &part.texture_coordinates {
            assert!(set.is_empty() || set.len() == n);
            assert!(set.iter().all(|uv| uv.is_finite()));
        }
        let material = &mesh.materials[part.material];
        for use_ in [&material.base_texture, &material.emissive_texture]
            .into_iter()
            .flatten()
        {
            assert!(use_.texture < mesh.textures.len());
            assert_eq!(part.texture_coordinates[use_.coordinates].len(), n);
        }
        assert!((0..part.triangles.len()).all(|t| area(part, t).length() > 0.0));
    }
    for texture in &mesh.textures {
        let image = &texture.image;
        assert_eq!(image.pixels.len(), image.width * image.height);
    }
}

/// Returns a triangle's normal, twice its area long.
fn area(part: &MeshPart, triangle: usize) -> DVec3 {
    let [a, b, c] = part.triangles[triangle].map(|i| part.positions[i as usize]);
    (b - a).cross(c - a)
}

fn bounds(mesh: &Mesh) -> [DVec3; 2] {
    let all = mesh.parts.iter().flat_map(|p| &p.positions);
    all.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[a, b], p| {
        [a.min(*p), b.max(*p)]
    })
}

#[track_caller]
fn check_bounds(mesh: &Mesh, lower: [f64; 3], upper: [f64; 3], tolerance: f64) {
    let [a, b] = bounds(mesh);
    let far = (a - DVec3::from(lower))
        .abs()
        .max((b - DVec3::from(upper)).abs());
    assert!(far.max_element() <= tolerance, "{a} to {b}");
}

/// Checks that triangles' and corners' normals point to the same side, which mirrored nodes may get
/// wrong.
#[track_caller]
fn check_sides(mesh: &Mesh) {
    let (mut same, mut all) = (0, 0);
    for part in mesh.parts.iter().filter(|p| !p.normals.is_empty()) {
        for (t, triangle) in part.triangles.iter().enumerate() {
            let sum: DVec3 = triangle
                .iter()
                .map(|&i| part.normals[i as usize].as_dvec3())
                .sum();
            all += 1;
            same += usize::from(sum.dot(area(part, t)) > 0.0);
        }
    }
    assert!(all > 0);
    // Smooth normals at sharp creases may lean past a thin triangle's plane.
    assert!(same as f64 >= 0.995 * all as f64, "{same} of {all}");
}

fn read(path: &Path) -> Dataset {
    open(path, &OpenOptions::default()).unwrap()
}

/// Returns an OBJ file's polygons in the order of their materials' first use: positions of corners.
fn polygons(path: &Path) -> Vec<Vec<DVec3>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut vertices: Vec<DVec3> = Vec::new();
    let mut groups: Vec<(String, Vec<Vec<DVec3>>)> = Vec::new();
    let mut material = String::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.first() {
            Some(&"v") => {
                let [x, y, z] = [1, 2, 3].map(|i| words[i].parse().unwrap());
                vertices.push(DVec3::new(x, y, z));
            }
            Some(&"usemtl") => material = words[1..].join(" "),
            Some(&"f") => {
                let corner = |word: &&str| {
                    let index: i64 = word.split('/').next().unwrap().parse().unwrap();
                    let count = vertices.len() as i64;
                    let index = if index < 0 { count + index } else { index - 1 };
                    vertices[index as usize]
                };
                let face = words[1..].iter().map(corner).collect();
                match groups.iter_mut().find(|(name, _)| *name == material) {
                    Some((_, faces)) => faces.push(face),
                    None => groups.push((material.clone(), vec![face])),
                }
            }
            _ => {}
        }
    }
    groups.into_iter().flat_map(|(_, faces)| faces).collect()
}

/// Returns Newell's normal, twice the area long.
fn newell(face: &[DVec3]) -> DVec3 {
    let origin = face[0];
    let next = face.iter().cycle().skip(1);
    face.iter()
        .zip(next)
        .map(|(a, b)| (*a - origin).cross(*b - origin))
        .sum()
}

/// Checks that the triangles of each polygon of an OBJ file tile it: seen along its normal, none is
/// reversed, and together they have its area. (Reversed ones would cancel in the sum of areas.)
/// Returns the number of concave polygons, and the number of those that two crossing sides make
/// impossible to tile.
#[track_caller]
fn check_polygons(path: &Path, mesh: &Mesh) -> [usize; 2] {
    let polygons = polygons(path);
    let areas: Vec<DVec3> = mesh
        .parts
        .iter()
        .flat_map(|part| (0..part.triangles.len()).map(|t| area(part, t)))
        .collect();
    let mut rest = areas.as_slice();
    let (mut concave, mut crossing) = (0, 0);
    for (p, face) in polygons.iter().enumerate() {
        let (own, others) = rest.split_at(face.len() - 2);
        rest = others;
        let whole = newell(face);
        let normal = whole.normalize();
        let corner = |i: usize| face[i % face.len()];
        let cross = |a: DVec3, b: DVec3| a.cross(b).dot(normal);
        let are_crossing = |i: usize, j: usize| {
            let [a, b, c, d] = [i, i + 1, j, j + 1].map(corner);
            cross(b - a, c - a) * cross(b - a, d - a) < 0.0
                && cross(d - c, a - c) * cross(d - c, b - c) < 0.0
        };
        // Longer polygons of these files do not cross themselves.
        if face.len() == 4 && (are_crossing(0, 2) || are_crossing(1, 3)) {
            concave += 1;
            crossing += 1;
            continue;
        }
        let sum: f64 = own.iter().map(|a| a.dot(normal).abs()).sum();
        // Coordinates have six or more digits; products are in f64.
        assert!(
            (sum / whole.length() - 1.0).abs() < 1e-9,
            "polygon {p} of {}: {sum} for {}",
            face.len(),
            whole.length()
        );
        let is_reflex = (0..face.len()).any(|i| {
            let [a, b, c] = [i, i + 1, i + 2].map(corner);
            cross(b - a, c - b) < -1e-12 * whole.length()
        });
        concave += usize::from(is_reflex);
    }
    assert!(rest.is_empty(), "{} triangles too many", rest.len());
    [concave, crossing]
}

#[test]
fn real_obj_files_have_their_triangles() {
    // Two quads of spot's cage are twisted: seen along their normals, two sides cross.
    for (name, triangles, parts, concave, crossing) in [
        ("concave_polygon/concave_polygon.obj", 64, 1, 1, 0),
        ("cornell_box/cornell_box.obj", 36, 4, 0, 0),
        ("fuze/fuze.obj", 1000, 1, 0, 0),
        ("spot/spot_triangulated.obj", 5856, 1, 0, 0),
        ("spot/spot_quadrangulated.obj", 5856, 1, 0, 0),
        ("spot/spot_control_mesh.obj", 372, 1, 12, 2),
        ("stanford-bunny.obj", 69451, 1, 0, 0),
        ("trumpet.obj", 23696, 2, 2, 0),
    ] {
        let Some(path) = real_data(&format!("meshes/obj/{name}")) else {
            return;
        };
        let data = read(&path);
        let mesh = mesh(&data);
        println!(
            "{name}: {} {:?} {:?}",
            mesh.triangle_count(),
            mesh.parts.len(),
            data.notes
        );
        assert_eq!(mesh.triangle_count(), triangles, "{name}");
        assert_eq!(mesh.parts.len(), parts, "{name}");
        assert_eq!(check_polygons(&path, mesh), [concave, crossing], "{name}");
        assert_eq!(has_note(&data, "2 polygons cross themselves"), crossing > 0);
    }
}

#[test]
fn real_obj_materials_are_those_of_their_files() {
    let Some(path) = real_data("meshes/obj/fuze/fuze.obj") else {
        return;
    };
    let data = read(&path);
    let fuze = mesh(&data);
    // Its MTL states `Tr 1.000000`, its name ends in tabs, and its image's name has a space.
    let [material] = &fuze.materials[..] else {
        panic!()
    };
    assert_eq!(material.name, "a-super-duper-material");
    assert_eq!(material.alpha, AlphaMode::Opaque);
    assert_eq!(material.base_colour, [1.0; 4]);
    assert!(material.base_texture.is_some());
    assert!(!material.is_double_sided, "a closed bottle");
    assert_eq!(fuze.textures.len(), 1);
    assert!(data.notes.is_empty(), "{:?}", data.notes);

    let path = real_data("meshes/obj/cornell_box/cornell_box.obj").unwrap();
    let data = read(&path);
    let box_ = mesh(&data);
    let colour = |name: &str| {
        let named = |m: &&Material| m.name == name;
        box_.materials.iter().find(named).unwrap().base_colour
    };
    assert_eq!(colour("red"), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(colour("green"), [0.0, 1.0, 0.0, 1.0]);
    assert!(box_.materials.iter().all(|m| m.is_double_sided));

    let path = real_data("meshes/obj/concave_polygon/concave_polygon.obj").unwrap();
    let expected = [0.14_f32, 0.18, 0.41].map(linear_from_srgb);
    let found = mesh(&read(&path)).materials[0].base_colour;
    // The file's colour has two digits.
    assert!(
        (0..3).all(|i| (found[i] - expected[i]).abs() < 0.01),
        "{found:?}"
    );

    let path = real_data("meshes/obj/trumpet.obj").unwrap();
    let data = read(&path);
    assert!(
        data.notes.iter().any(|n| n.contains("and 1 more")),
        "{:?}",
        data.notes
    );
}

#[test]
fn a_texture_is_bound_by_hand() {
    let Some(path) = real_data("meshes/obj/spot/spot_triangulated.obj") else {
        return;
    };
    let plain = read(&path);
    assert!(mesh(&plain).materials[0].base_texture.is_none());
    assert!(mesh(&plain).parts[0].texture_coordinates.is_empty());
    assert!(!mesh(&plain).materials[0].is_double_sided, "spot is closed");
    let texture = path.with_file_name("spot_texture.png");
    let options = OpenOptions {
        texture: Some(texture),
        ..OpenOptions::default()
    };
    let data = open(&path, &options).unwrap();
    let spot = mesh(&data);
    let use_ = spot.materials[0].base_texture.as_ref().unwrap();
    let image = &spot.textures[use_.texture].image;
    assert_eq!((image.width, image.height), (1024, 1024));
    assert_eq!(spot.parts[0].texture_coordinates[0].len(), 3225);
    // v points up in the file and down here.
    let text = std::fs::read_to_string(&path).unwrap();
    let first = text.lines().find(|l| l.starts_with("vt ")).unwrap();
    let words: Vec<f32> = first[3..].split(' ').map(|w| w.parse().unwrap()).collect();
    let flipped = Vec2::new(words[0], 1.0 - words[1]);
    let set = &spot.parts[0].texture_coordinates[0];
    assert!(set.iter().any(|uv| uv.distance(flipped) < 1e-6));

    let missing = OpenOptions {
        texture: Some(path.with_file_name("README.txt")),
        ..OpenOptions::default()
    };
    let error = open(&path, &missing).unwrap_err().to_string();
    assert!(
        error.contains("is no image that is read (PNG, JPEG,"),
        "{error}"
    );
}

#[test]
fn real_gltf_files_have_their_triangles() {
    for (name, triangles, parts, has_normals) in [
        ("AlphaBlendModeTest.glb", 61, 9, true),
        ("BoxInterleaved.glb", 12, 1, true),
        ("BoxTextured/BoxTextured.gltf", 12, 1, true),
        ("Duck.glb", 4212, 1, true),
        ("FlightHelmet/FlightHelmet.gltf", 94722, 6, true),
        ("NegativeScaleTest.glb", 0, 0, true),
        ("OrientationTest.glb", 524, 13, true),
        ("SimpleSparseAccessor.gltf", 12, 1, false),
        (
            "TextureTransformTest/TextureTransformTest.gltf",
            24,
            12,
            false,
        ),
        ("VertexColorTest.glb", 36, 2, true),
    ] {
        let Some(path) = real_data(&format!("meshes/gltf/{name}")) else {
            return;
        };
        let data = read(&path);
        let mesh = mesh(&data);
        let [lower, upper] = bounds(mesh);
        println!(
            "{name}: {} {} {lower} {upper} {:?}",
            mesh.triangle_count(),
            mesh.parts.len(),
            data.notes
        );
        if triangles > 0 {
            assert_eq!(mesh.triangle_count(), triangles, "{name}");
            assert_eq!(mesh.parts.len(), parts, "{name}");
        }
        if has_normals {
            check_sides(mesh);
        }
    }
}

#[test]
fn real_gltf_files_lie_where_they_should() {
    let Some(path) = real_data("meshes/gltf/Duck.glb") else {
        return;
    };
    // The bounds that its accessor states, times its node's scale .01; numbers are f32.
    let duck = read(&path);
    let (lower, upper) = (
        [-0.692_985, 0.099_293_7, -0.613_282],
        [0.961_799, 1.639_7, 0.539_252],
    );
    check_bounds(mesh(&duck), lower, upper, 1e-5);
    assert_eq!(mesh(&duck).textures[0].image.width, 512);
    assert!(!mesh(&duck).materials[0].is_double_sided);

    for name in ["BoxInterleaved.glb", "BoxTextured/BoxTextured.gltf"] {
        let path = real_data(&format!("meshes/gltf/{name}")).unwrap();
        check_bounds(mesh(&read(&path)), [-0.5; 3], [0.5; 3], 1e-6);
    }
    let path = real_data("meshes/gltf/SimpleSparseAccessor.gltf").unwrap();
    check_bounds(mesh(&read(&path)), [0.0; 3], [6.0, 4.0, 0.0], 1e-6);
}

#[test]
fn real_gltf_materials_are_those_of_their_files() {
    let Some(path) = real_data("meshes/gltf/AlphaBlendModeTest.glb") else {
        return;
    };
    let data = read(&path);
    let material = |name: &str| {
        let materials = mesh(&data).materials.iter();
        materials.clone().find(|m| m.name == name).map_or_else(
            || {
                let names: Vec<&String> = materials.map(|m| &m.name).collect();
                panic!("{names:?}")
            },
            |m| m.alpha,
        )
    };
    assert_eq!(material("MatBlend"), AlphaMode::Blend);
    assert_eq!(material("MatOpaque"), AlphaMode::Opaque);
    assert_eq!(material("MatCutoff25"), AlphaMode::Mask(0.25));
    assert_eq!(material("MatCutoff75"), AlphaMode::Mask(0.75));
    assert_eq!(material("MatCutoffDefault"), AlphaMode::Mask(0.5));

    let path = real_data("meshes/gltf/VertexColorTest.glb").unwrap();
    let data = read(&path);
    assert!(mesh(&data).parts.iter().any(|p| !p.colours.is_empty()));
    assert!(
        mesh(&data)
            .materials
            .iter()
            .all(|m| m.base_texture.is_some())
    );
}

/// In this file, an arrow's tip lies on the marker "not supported" if a texture's transform is
/// ignored, and on the marker "correct" if it is applied. So the image point shown at "correct" is
/// the one that would be shown at "not supported" without the transform.
#[test]
fn texture_transforms_bring_the_arrow_to_its_marker() {
    let name = "meshes/gltf/TextureTransformTest/TextureTransformTest.gltf";
    let Some(path) = real_data(name) else {
        return;
    };
    let json: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let marker = |name: &str| {
        let nodes = json["nodes"].as_array().unwrap().iter();
        let node = nodes.clone().find(|n| n["name"] == name).unwrap();
        let [x, y] = [0, 1].map(|i| node["translation"][i].as_f64().unwrap() as f32);
        // The quads extend from -1/2 to 1/2, and v points down.
        Vec2::new(x + 0.5, 0.5 - y)
    };
    let tip = marker("Rotation - Not Supported");
    let data = read(&path);
    let transform = |name: &str| -> Affine2 {
        let named = |m: &&Material| m.name == name;
        let material = mesh(&data).materials.iter().find(named).unwrap();
        material.base_texture.as_ref().unwrap().transform
    };
    // Markers were placed by calculation in two cases, and by eye in the third.
    for (name, tolerance) in [("Rotation", 1e-5), ("Scale", 1e-5), ("All", 0.04)] {
        let found = transform(name).transform_point2(marker(&format!("{name} - Correct")));
        assert!(found.distance(tip) < tolerance, "{name}: {found} for {tip}");
    }
    let wrong = transform("Rotation").transform_point2(marker("Rotation - Error"));
    assert!(wrong.distance(tip) > 0.3);
    let moved = transform("Offset UV").transform_point2(Vec2::ZERO);
    assert_eq!(moved, Vec2::splat(0.5));
    let texture = mesh(&data).materials[0]
        .base_texture
        .as_ref()
        .unwrap()
        .texture;
    assert_eq!(mesh(&data).textures[texture].wrap, [Wrap::ClampToEdge; 2]);
}

/// The vase in `fixtures/` is the same in both formats.
#[test]
fn the_vase_is_the_same_in_both_formats() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let [obj, glb] = ["vase.obj", "vase.glb"].map(|name| read(&folder.join(name)));
    let sorted = |data: &Dataset| {
        let [part] = &mesh(data).parts[..] else {
            panic!()
        };
        assert!(data.notes.is_empty(), "{:?}", data.notes);
        check_sides(mesh(data));
        let corner = |i: u32| {
            let i = i as usize;
            let uv = part.texture_coordinates[0][i].as_dvec2();
            let [p, n] = [part.positions[i], part.normals[i].as_dvec3()];
            // The numbers agree, except for the f32 of one and the flipped v of the other.
            [p.x, p.y, p.z, n.x, n.y, n.z, uv.x, uv.y].map(|x| (x * 1e4).round() as i64)
        };
        let mut triangles: Vec<_> = part.triangles.iter().map(|t| t.map(corner)).collect();
        triangles.sort_unstable();
        triangles
    };
    let [a, b] = [sorted(&obj), sorted(&glb)];
    assert_eq!(a.len(), 1800);
    assert!(a == b);
    for data in [&obj, &glb] {
        let mesh = mesh(data);
        assert_eq!(mesh.textures.len(), 1);
        assert_eq!(mesh.materials[0].name, "glaze");
        assert!(!mesh.materials[0].is_double_sided, "it is closed");
        let image = &mesh.textures[0].image;
        assert_eq!((image.width, image.height), (64, 64));
        assert_eq!(image.pixels, self::mesh(&obj).textures[0].image.pixels);
    }
}

// OBJ, trap by trap.

fn obj(folder: &Folder, text: &str) -> Dataset {
    folder.open("a.obj", text.as_bytes())
}

const SQUARE_OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

/// Returns a square with a material of this MTL.
fn painted(folder: &Folder, mtl: &str) -> (Material, Dataset) {
    folder.file("a.mtl", format!("newmtl m\n{mtl}\n").as_bytes());
    let text = format!("mtllib a.mtl\n{SQUARE_OBJ}usemtl m\nf 1/1 2/2 3/3 4/4\n");
    let data = obj(folder, &text);
    (mesh(&data).materials[0].clone(), data)
}

fn has_note(data: &Dataset, words: &str) -> bool {
    data.notes.iter().any(|n| n.contains(words))
}

#[test]
fn obj_is_known_by_its_name_or_its_text() {
    let folder = Folder::new();
    let text = format!("# made\n\n{SQUARE_OBJ}f 1 2 3 4\n");
    for name in ["a.obj", "a.OBJ", "a", "a.txt"] {
        let data = folder.open(name, text.as_bytes());
        assert_eq!(mesh(&data).triangle_count(), 2, "{name}");
        assert_eq!(data.format, "Wavefront OBJ mesh");
    }
    let crlf = text.replace('\n', "\r\n");
    assert_eq!(mesh(&folder.open("b", crlf.as_bytes())).triangle_count(), 2);
    let bom = format!("\u{feff}{text}");
    assert_eq!(
        mesh(&folder.open("c.obj", bom.as_bytes())).triangle_count(),
        2
    );
    // A table is no OBJ file.
    let error = folder.refuse("d", b"v,f,g\n1,2,3\n");
    assert!(!error.contains("OBJ mesh"), "{error}");
}

#[test]
fn all_kinds_of_corners_may_be_in_one_object() {
    let folder = Folder::new();
    folder.file("a.mtl", RICH_MTL.as_bytes());
    folder.file("a.png", &png(1, &[[255; 4]]));
    let data = obj(&folder, RICH_OBJ);
    let found = mesh(&data);
    // There are two triangles for each quad, and one for each other face.
    assert_eq!(found.triangle_count(), 6);
    let with_uv = found
        .parts
        .iter()
        .filter(|p| !p.texture_coordinates.is_empty());
    assert_eq!(with_uv.count(), 1);
    let of = |name: &str| {
        let named = |p: &&MeshPart| found.materials[p.material].name == name;
        found.parts.iter().filter(named).count()
    };
    assert_eq!((of("red paint"), of("none")), (2, 2));
    assert_eq!((found.line_count(), found.point_count()), (2, 1));
    for words in [
        "no material `none`",
        "2 of 5 vertices have no colour",
        "corners only",
        "no texture coordinates",
    ] {
        assert!(has_note(&data, words), "{words}: {:?}", data.notes);
    }
    // Colours belong to their vertices, whatever else corners name.
    for part in &found.parts {
        for (p, colour) in part.positions.iter().zip(&part.colours) {
            let expected = match (p.x, p.y) {
                (0.0, 0.0) => [1.0, 0.0, 0.0, 1.0],
                (1.0, 0.0) => [0.0, 1.0, 0.0, 1.0],
                (1.0, 1.0) => [0.0, 0.0, 1.0, 1.0],
                _ => [1.0; 4],
            };
            assert_eq!(*colour, expected, "{p}");
        }
    }
}

#[test]
fn coordinates_keep_their_digits() {
    let folder = Folder::new();
    let text = "v 1000000.0009765625 0 0\nv 1000001 0 0\nv 1000000 1 0\nf 1 2 3\n";
    let data = obj(&folder, text);
    assert!(mesh(&data).parts[0].positions.contains(&DVec3::new(
        1_000_000.000_976_562_5,
        0.0,
        0.0
    )));
}

#[test]
fn colours_of_vertices_are_decoded() {
    let folder = Folder::new();
    let colour = |text: &str| {
        let text = format!("{text}\nv 1 0 0 0 0 0\nv 0 1 0 0 0 0\nf 1 2 3\n");
        let data = obj(&folder, &text);
        let part = &mesh(&data).parts[0];
        let at = part.positions.iter().position(|p| p.z > 0.5).unwrap();
        part.colours[at]
    };
    let [half, rest] = [linear_from_srgb(0.5), 1.0];
    assert_eq!(colour("v 0 0 1 0.5 1 0"), [half, 1.0, 0.0, rest]);
    assert_eq!(colour("v 0 0 1 0.5 1 0 0.25"), [half, 1.0, 0.0, rest]);
    let bytes = colour("v 0 0 1 127.5 255 0");
    assert_eq!(bytes, [half, 1.0, 0.0, rest]);
    assert_eq!(colour("v 0 0 1 nan 1 0"), [1.0; 4]);
}

#[test]
fn what_cannot_be_shown_is_left_out_and_counted() {
    let folder = Folder::new();
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nv 1e999 0 0\nv 2 0 0\nv -1.#IND 0 0\n\
                f 1 2 3\nf 1 2 4\nf 1 5 3\nf 1 2 6\nf 1 1 2\nf 2 7 3\nf 1 2 3 3\n";
    let data = obj(&folder, text);
    // The last is a triangle with a corner named twice.
    assert_eq!(mesh(&data).triangle_count(), 2);
    assert!(has_note(&data, "3 triangles have NaN"), "{:?}", data.notes);
    assert!(
        has_note(&data, "2 triangles have no area"),
        "{:?}",
        data.notes
    );
    assert_eq!(mesh(&data).parts[0].positions.len(), 3);
    for text in [
        "v 0 0 0\nf 1 1 1\n",
        "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    ] {
        let error = folder.refuse("b.obj", text.as_bytes());
        assert!(error.contains("a triangle with an area"), "{error}");
    }
}

#[test]
fn normals_are_units_or_their_triangles() {
    let folder = Folder::new();
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 5\nvn 0 0 0\nvn nan 1 0\nf 1//1 2//2 3//3\n";
    let data = obj(&folder, text);
    let normals = &mesh(&data).parts[0].normals;
    assert_eq!(normals.len(), 3);
    assert!(normals.iter().all(|n| *n == glam::Vec3::Z), "{normals:?}");
}

#[test]
fn broken_obj_files_name_the_line() {
    let folder = Folder::new();
    for (text, line, words) in [
        ("v 0 0\n", 1, "3, 4, 6 or 7"),
        ("v 0 0 0 1 1\n", 1, "3, 4, 6 or 7"),
        ("v 0 0 a\n", 1, "a number"),
        ("vt\n", 1, "one to three"),
        ("vn 1 0\n", 1, "three numbers"),
        ("v 0 0 0\nf 1 1 2\n", 2, "one of the file's 1 vertices"),
        ("v 0 0 0\nf 0 1 1\n", 2, "vertices above"),
        ("v 0 0 0\nf -2 1 1\n", 2, "vertices above"),
        (
            "v 0 0 0\nvt 0 0\nf 1/18446744073709551615 1/1 1/1\n",
            3,
            "a corner",
        ),
        ("v 0 0 0\nf 1/1/1/1 1 1\n", 2, "a corner"),
        ("v 0 0 0\nf a b c\n", 2, "a corner"),
        ("v 0 0 0\nf\n", 2, "three corners"),
        (
            "v 0 0 0\n# a \\\n b\nv 1 0 \\\n0\nf 1 2 3\n",
            6,
            "2 vertices",
        ),
    ] {
        let error = folder.refuse("a.obj", text.as_bytes());
        assert!(error.contains(&format!("line {line}:")), "{text}: {error}");
        assert!(error.contains(words), "{text}: {error}");
    }
    let error = folder.refuse("a.obj", b"o nothing\nvn 1 0 0\n");
    assert!(error.contains("a vertex (`v`)"), "{error}");
    // Faces may precede the vertices that they name.
    let data = obj(&folder, "f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n");
    assert_eq!(mesh(&data).triangle_count(), 1);
}

#[test]
fn faces_go_without_normals_and_coordinates_that_are_not_there() {
    let folder = Folder::new();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 1 0\n";
    let whole = "f 1/1/1 2/2/1 3/3/1\n";
    for (face, coordinates, normals) in [
        ("f 1/1/1 3/3/2 4/2/1", [true, true], [true, false]),
        ("f 1/1/0 3/3/1 4/2/1", [true, true], [true, false]),
        ("f 1/1/-2 3/3/1 4/2/1", [true, true], [true, false]),
        ("f 1/9/1 3/3/1 4/2/1", [true, false], [true, true]),
        (
            "f 1/9223372036854775807/7 3/3/1 4/-9223372036854775808/1",
            [true, false],
            [true, false],
        ),
    ] {
        let data = obj(&folder, &format!("{square}{whole}{face}\n{whole}"));
        let parts = &mesh(&data).parts;
        // The two complete faces stay together; coordinates are kept if a texture uses them.
        assert_eq!(parts[0].triangles.len(), 2, "{face}");
        assert_eq!(parts[1].triangles.len(), 1, "{face}");
        assert_eq!(
            [0, 1].map(|i| !parts[i].normals.is_empty()),
            normals,
            "{face}"
        );
        assert_eq!(
            parts[1].positions,
            [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]
        );
        let is_told = |what: &str| {
            has_note(
                &data,
                &format!("1 faces name {what} that are not in the file"),
            )
        };
        assert_eq!(is_told("normals"), !normals[1], "{:?}", data.notes);
        assert_eq!(
            is_told("texture coordinates"),
            !coordinates[1],
            "{:?}",
            data.notes
        );
    }
}

#[test]
fn opacities_and_colours_follow_their_rules() {
    let folder = Folder::new();
    folder.file("a b.png", &png(2, &[[255, 0, 0, 255], [0, 255, 0, 0]]));
    folder.file("grey.png", &png(1, &[[128, 128, 128, 255]]));
    folder.file("c.jpg", &jpeg(8, [200, 100, 50]));
    let material = |mtl: &str| painted(&folder, mtl).0;
    let half = linear_from_srgb(0.5);

    assert_eq!(material("Tr 1.000000").alpha, AlphaMode::Opaque);
    assert_eq!(
        material("Tr 0.25").base_colour[3].to_bits(),
        0.75_f32.to_bits()
    );
    assert_eq!(material("Tr 0.25").alpha, AlphaMode::Blend);
    assert_eq!(
        material("Tr 1\nd 0.5").base_colour[3].to_bits(),
        0.5_f32.to_bits()
    );
    assert_eq!(
        material("Kd 0.5 0.5 0.5").base_colour,
        [half, half, half, 1.0]
    );
    assert_eq!(material("Kd 0 0 0").base_colour, [0.0, 0.0, 0.0, 1.0]);
    let textured = material("Kd 0 0 0\nmap_Kd a b.png");
    assert_eq!(textured.base_colour, [1.0; 4]);
    assert_eq!(textured.alpha, AlphaMode::Opaque);
    let halved = material("Kd 0.5 0.5 0.5\nmap_Kd C:\\old\\c.jpg");
    assert_eq!(halved.base_colour, [half, half, half, 1.0]);
    assert!(halved.base_texture.is_some());
    assert_eq!(material("Ke 1 0 0").emissive, [1.0, 0.0, 0.0]);
    assert_eq!(material("Ke 0 0 0\nmap_Ke grey.png").emissive, [1.0; 3]);
    assert!(material("map_Ke grey.png").emissive_texture.is_some());
    assert_eq!(material("Ke 1 1 1\nmap_Ke none.png").emissive, [0.0; 3]);

    // An opacity map of 0 and 1 alone is a cut-out.
    assert_eq!(material("map_d a b.png").alpha, AlphaMode::Mask(0.5));
    assert_eq!(
        material("map_Kd a b.png\nmap_d a b.png").alpha,
        AlphaMode::Mask(0.5)
    );
    assert_eq!(material("map_d none.png").alpha, AlphaMode::Opaque);
    let (grey, data) = painted(&folder, "map_Kd c.jpg\nmap_d grey.png");
    assert_eq!(grey.alpha, AlphaMode::Blend);
    // Its alpha is 1 everywhere, so its brightness is the opacity.
    let texture = grey.base_texture.unwrap().texture;
    let image = &mesh(&data).textures[texture].image;
    assert!(
        image.pixels.iter().all(|p| p[3] == 128),
        "{:?}",
        image.pixels[0]
    );
    let (same, data) = painted(&folder, "map_Kd grey.png\nmap_d grey.png");
    let texture = same.base_texture.unwrap().texture;
    assert_eq!(
        mesh(&data).textures[texture].image.pixels,
        [[128, 128, 128, 255]]
    );
}

#[test]
fn texture_statements_are_obeyed() {
    let folder = Folder::new();
    folder.file("a.png", &png(1, &[[255; 4]]));
    let (material, data) = painted(&folder, "map_Kd -s 2 4 1 -o 0.25 0.5 -clamp on a.png");
    let use_ = material.base_texture.unwrap();
    assert_eq!(
        mesh(&data).textures[use_.texture].wrap,
        [Wrap::ClampToEdge; 2]
    );
    // In the file's convention, v up: (u, v) to (2 u + 1/4, 4 v + 1/2).
    let uv = Vec2::new(0.5, 0.125);
    let found = use_.transform.transform_point2(Vec2::new(uv.x, 1.0 - uv.y));
    let expected = Vec2::new(2.0 * uv.x + 0.25, 1.0 - (4.0 * uv.y + 0.5));
    assert_eq!(found, expected);
    // The square's corner (0, 1) has the image's top left corner.
    let part = &mesh(&data).parts[0];
    let at = part.positions.iter().position(|p| *p == DVec3::Y).unwrap();
    assert_eq!(part.texture_coordinates[0][at], Vec2::ZERO);

    for (mtl, words) in [
        ("map_Kd none.png", "no file `none.png`"),
        ("map_Kd a.mtl", "is no image that is read"),
        ("Kd spectral x", "no RGB colour"),
    ] {
        let (material, data) = painted(&folder, mtl);
        assert!(has_note(&data, words), "{:?}", data.notes);
        assert!(material.base_texture.is_none());
    }
    let data = obj(&folder, &format!("mtllib none.mtl\n{SQUARE_OBJ}f 1 2 3\n"));
    assert!(has_note(&data, "no file `none.mtl`"), "{:?}", data.notes);
    assert_eq!(mesh(&data).materials[0].base_colour, [1.0; 4]);
    // Libraries with a space in the name, and two in one statement.
    folder.file("x y.mtl", b"newmtl m\nKd 1 0 0\n");
    folder.file("z.mtl", b"newmtl n\nKd 0 1 0\n");
    for (statement, colour) in [
        ("x y.mtl", [1.0, 0.0, 0.0, 1.0]),
        ("a.mtl\t.\\z.mtl", [0.0, 1.0, 0.0, 1.0]),
    ] {
        let name = if statement.starts_with('x') { "m" } else { "n" };
        let text = format!("mtllib {statement}\n{SQUARE_OBJ}usemtl {name}\nf 1 2 3\n");
        let data = obj(&folder, &text);
        assert_eq!(
            mesh(&data).materials[0].base_colour,
            colour,
            "{:?}",
            data.notes
        );
    }
}

#[test]
fn vertices_alone_are_points() {
    let folder = Folder::new();
    let text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 1\n";
    let data = obj(&folder, text);
    let Geometry::Points { positions } = &data.geometry else {
        panic!("{:?}", data.geometry)
    };
    assert_eq!(positions.len(), 4);
    assert_eq!(data.field_names(), ["red", "green", "blue"]);
    let red = data.scalar("red").unwrap().1;
    // The last vertex has no colour: white.
    assert_eq!([0, 1, 2, 3].map(|i| red.get(i)), [255.0, 0.0, 0.0, 255.0]);
    assert!(has_note(&data, "drawn as points"), "{:?}", data.notes);
    let bare = obj(&folder, "mtllib a.mtl\nv 0 0 0\nv 0 1 0\n");
    assert!(bare.field_names().is_empty());
    assert!(
        has_note(&bare, "files of materials are not used"),
        "{:?}",
        bare.notes
    );
}

#[test]
fn what_materials_lose_is_said() {
    let folder = Folder::new();
    folder.file("a.png", &png(1, &[[255; 4]]));
    folder.file("a.mtl", b"newmtl m\nKd 1 0 0\n");
    let text = format!("mtllib a.mtl\n{SQUARE_OBJ}f 1 2 3\n");
    let data = obj(&folder, &text);
    assert!(
        has_note(&data, "faces name no material (`usemtl`)"),
        "{:?}",
        data.notes
    );
    let data = obj(&folder, &format!("{text}usemtl m\nf 1 3 4\n"));
    assert!(
        has_note(&data, "before the first `usemtl`"),
        "{:?}",
        data.notes
    );
    for (mtl, note) in [
        ("map_Ka a.png", Some("`map_Ka` (`a.png`) is not used")),
        (
            "map_Ka a.png\nmap_Kd b.png",
            Some("`map_Ka` (`a.png`) is not used"),
        ),
        ("map_Ka a.png\nmap_Kd a.png", None),
        ("map_Kd -mm 0 1 a.png", None),
        (
            "map_Kd -mm 0.2 0.5 a.png",
            Some("options of `map_kd` are not used: -mm"),
        ),
        ("map_Kd -t 0 0 0 -cc on a.png", Some("are not used: -cc")),
    ] {
        let (_, data) = painted(&folder, mtl);
        match note {
            Some(words) => assert!(has_note(&data, words), "{mtl}: {:?}", data.notes),
            None => assert!(data.notes.is_empty(), "{mtl}: {:?}", data.notes),
        }
    }
}

#[test]
fn names_that_differ_in_case_are_found_and_said() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path().join("Maps")).unwrap();
    folder.file("Maps/Wood.PNG", &png(1, &[[9, 8, 7, 255]]));
    folder.file("Other.MTL", b"newmtl m\nmap_Kd maps\\wood.png\n");
    let text = format!("mtllib other.mtl\n{SQUARE_OBJ}usemtl m\nf 1/1 2/2 3/3\n");
    let data = obj(&folder, &text);
    assert_eq!(mesh(&data).textures[0].image.pixels, [[9, 8, 7, 255]]);
    for words in ["`Other.MTL` is taken for it", "`Wood.PNG` is taken for it"] {
        assert!(has_note(&data, words), "{:?}", data.notes);
    }
    // A file of exactly that name takes precedence, without a note.
    folder.file("other.mtl", b"newmtl m\nKd 0 0 1\n");
    let data = obj(&folder, &text);
    assert!(data.notes.is_empty(), "{:?}", data.notes);
    assert_eq!(mesh(&data).materials[0].base_colour, [0.0, 0.0, 1.0, 1.0]);
    // The same holds for glTF.
    let mut file = Gltf::new();
    let primitive = square(&mut file);
    file.mesh(primitive);
    folder.file("Square.BIN", &file.bin);
    file.json["buffers"][0]["uri"] = json!("square.bin");
    let data = folder.open("a.gltf", &serde_json::to_vec(&file.json).unwrap());
    assert!(
        has_note(&data, "`Square.BIN` is taken for it"),
        "{:?}",
        data.notes
    );
}

const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";

#[test]
fn closed_surfaces_are_seen_from_outside() {
    let folder = Folder::new();
    let sides = |faces: &str| {
        let data = obj(&folder, &format!("{TETRAHEDRON}{faces}"));
        let mesh = mesh(&data);
        let sides: HashMap<String, bool> = mesh
            .materials
            .iter()
            .map(|m| (m.name.clone(), m.is_double_sided))
            .collect();
        sides
    };
    let two = |faces: &str| sides(faces)[""];
    assert!(!two("f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"));
    // Reversed, open, one face turned over.
    assert!(two("f 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n"));
    assert!(two("f 1 3 2\nf 1 2 4\nf 2 3 4\n"));
    assert!(two("f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"));
    // Duplicate vertices, as at seams of textures, count as one.
    assert!(!two(
        "v 0 0 0\nv 1 0 0\nv -0 1 0\nf 5 7 6\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    ));
    // A closed surface has two materials, one of which also covers an open surface.
    let both = sides(
        "v 5 0 0\nv 6 0 0\nv 5 1 0\nusemtl a\nf 1 3 2\nf 1 2 4\nusemtl b\nf 2 3 4\nf 1 4 3\n\
         f 5 6 7\n",
    );
    assert_eq!((both["a"], both["b"]), (false, true));
}

// glTF, trap by trap.

fn square(file: &mut Gltf) -> Value {
    let positions = file.floats("VEC3", &SQUARE);
    let indices = file.accessor("SCALAR", U16, false, &[0., 1., 2., 0., 2., 3.]);
    json!({ "attributes": { "POSITION": positions }, "indices": indices })
}

fn shown(file: &Gltf) -> Dataset {
    Folder::new().open("a.glb", &file.glb())
}

#[track_caller]
fn refused(file: &Gltf, words: &str) {
    let error = Folder::new().refuse("a.glb", &file.glb());
    assert!(error.contains(words), "{error}");
}

#[test]
fn gltf_is_known_by_its_bytes() {
    let folder = Folder::new();
    let file = rich_gltf();
    for (name, bytes) in [
        ("a.glb", file.glb()),
        ("a", file.glb()),
        ("a.gltf", file.text()),
        ("b", file.text()),
    ] {
        let data = folder.open(name, &bytes);
        assert_eq!(data.format, "glTF mesh");
        // A square, and two instances of a strip of two triangles.
        assert_eq!(mesh(&data).triangle_count(), 6, "{name}");
        assert!(data.notes.is_empty(), "{:?}", data.notes);
    }
}

#[test]
fn poses_at_rest_are_those_of_morphs_and_joints() {
    let data = shown(&rich_gltf());
    let found = mesh(&data);
    let z_of = |part: &MeshPart| -> Vec<f64> { part.positions.iter().map(|p| p.z).collect() };
    // The target has weight one half: 0, 1, 0, 2 at the corners.
    assert_eq!(z_of(&found.parts[0]), [0.0, 0.5, 0.0, 1.0]);
    assert!(found.parts[0].positions.iter().all(|p| p.x >= 1.0));
    // Both joints lie at z = 4 and act on points at z = 0. The nodes of skinned meshes do not
    // count, nor do their instances.
    for part in &found.parts[1..] {
        assert_eq!(z_of(part), [4.0; 4]);
        // Half a joint of scale 1 and half one of -2 give a mirrored part.
        assert!((0..2).all(|t| area(part, t).z < 0.0));
    }
    let material = &found.materials[found.parts[0].material];
    assert_eq!(material.alpha, AlphaMode::Mask(0.25));
    assert_eq!(material.emissive, [2.0, 0.0, 0.0]);
    assert_eq!(found.parts[0].colours[0], [1.0, 0.0, 1.0, 1.0]);
    assert_eq!(found.parts[0].normals[0], glam::Vec3::Z);
    let use_ = material.base_texture.as_ref().unwrap();
    assert_eq!(
        found.textures[use_.texture].wrap,
        [Wrap::ClampToEdge, Wrap::MirroredRepeat]
    );
    assert_eq!(
        found.parts[0].texture_coordinates[0][0],
        Vec2::new(0.0, 1.0)
    );
}

#[test]
fn nodes_place_meshes() {
    let mut file = Gltf::new();
    let mut primitive = square(&mut file);
    let normals = file.floats("VEC3", &[0.0, 0.6, 0.8].repeat(4));
    primitive["attributes"]["NORMAL"] = json!(normals);
    file.mesh(primitive);
    // A quarter turn about z after a mirrored stretch, in a node far away.
    let s = std::f64::consts::FRAC_1_SQRT_2;
    file.json["nodes"][0]["scale"] = json!([2, 3, -4]);
    file.json["nodes"][0]["rotation"] = json!([0, 0, s, s]);
    file.add(
        "nodes",
        json!({ "translation": [10, 0, 0], "children": [0] }),
    );
    let data = shown(&file);
    let part = &mesh(&data).parts[0];
    // The f32 of a quarter turn rounds.
    check_bounds(mesh(&data), [7.0, 0.0, 0.0], [10.0, 2.0, 0.0], 1e-6);
    // Mirrored in z: the front faces down, and so does the normal.
    assert!((0..2).all(|t| area(part, t).z < 0.0));
    // (0, .6 / 3, .8 / -4), rotated: (-.2, 0, -.2).
    let expected = glam::Vec3::new(-1.0, 0.0, -1.0).normalize();
    assert!(
        part.normals[0].distance(expected) < 1e-6,
        "{}",
        part.normals[0]
    );

    // The same transform as one matrix.
    let mut same = file.clone();
    let node = same.json["nodes"][0].as_object_mut().unwrap();
    for key in ["scale", "rotation"] {
        node.remove(key);
    }
    node.insert(
        "matrix".into(),
        json!([0, 2, 0, 0, -3, 0, 0, 0, 0, 0, -4, 0, 0, 0, 0, 1]),
    );
    let other = shown(&same);
    for (a, b) in part.positions.iter().zip(&mesh(&other).parts[0].positions) {
        assert!(a.distance(*b) < 1e-6);
    }
    same.json["nodes"][0]["matrix"][3] = json!(0.5);
    refused(&same, "affine");
}

#[test]
fn the_default_scene_is_shown() {
    let mut file = Gltf::new();
    let primitive = square(&mut file);
    file.mesh(primitive);
    file.add("nodes", json!({ "mesh": 0, "translation": [5, 0, 0] }));
    let count = |file: &Gltf| mesh(&shown(file)).parts.len();
    assert_eq!(count(&file), 2);
    file.json["scenes"] = json!([{ "nodes": [0] }, { "nodes": [1, 0, 1] }]);
    assert_eq!(count(&file), 1);
    file.json["scene"] = json!(1);
    assert_eq!(count(&file), 2);
    file.json["scene"] = json!(2);
    refused(&file, "one of 2 scenes");
    file.json["scene"] = json!(0);
    file.json["scenes"][0] = json!({ "nodes": [7] });
    refused(&file, "node 7");
    file.json["scenes"] = json!([{ "nodes": [] }]);
    refused(&file, "a triangle with an area");
}

#[test]
fn trees_of_nodes_have_no_loops() {
    let mut file = Gltf::new();
    let primitive = square(&mut file);
    file.mesh(primitive);
    for (nodes, words) in [
        (json!([{ "mesh": 0, "children": [0] }]), "its own ancestor"),
        (
            json!([{ "mesh": 0 }, { "children": [2] }, { "children": [1] }]),
            "its own ancestor",
        ),
        (
            json!([{ "mesh": 0 }, { "children": [0] }, { "children": [0] }]),
            "no other parent",
        ),
        (json!([{ "mesh": 0, "children": [9] }]), "node 9"),
        (json!([{ "mesh": 3 }]), "mesh 3"),
        (json!([{ "mesh": 0, "skin": 0 }]), "skin 0"),
    ] {
        file.json["nodes"] = nodes;
        refused(&file, words);
    }
    // The tree is as deep as a file can state: the reader does not recurse.
    let deep: Vec<Value> = (0..20_000)
        .map(|i| match i {
            19_999 => json!({ "mesh": 0 }),
            _ => json!({ "children": [i + 1] }),
        })
        .collect();
    file.json["nodes"] = json!(deep);
    assert_eq!(mesh(&shown(&file)).triangle_count(), 2);
}

#[test]
fn indices_of_all_types_and_modes_are_read() {
    for component in [U8, U16, U32] {
        for (mode, indices, triangles) in [
            (4, vec![0., 1., 2., 0., 2., 3.], 2),
            (4, vec![0., 1., 2., 0., 2.], 1),
            (5, vec![0., 1., 3., 2.], 2),
            (5, vec![0., 1., 3., 3., 2., 1.], 2),
            (6, vec![0., 1., 2., 3.], 2),
        ] {
            let mut file = Gltf::new();
            let positions = file.floats("VEC3", &SQUARE);
            let indices = file.accessor("SCALAR", component, false, &indices);
            file.mesh(json!({
                "attributes": { "POSITION": positions }, "indices": indices, "mode": mode,
            }));
            let data = shown(&file);
            let found = mesh(&data);
            assert_eq!(found.triangle_count(), triangles, "mode {mode}");
            let part = &found.parts[0];
            assert!((0..triangles).all(|t| area(part, t).z > 0.0), "mode {mode}");
        }
    }
    let mut file = Gltf::new();
    let positions = file.floats("VEC3", &SQUARE[..9]);
    file.mesh(json!({ "attributes": { "POSITION": positions } }));
    assert_eq!(mesh(&shown(&file)).triangle_count(), 1);
    for (mode, lines, points) in [(0, 0, 3), (1, 1, 0), (2, 3, 0), (3, 2, 0)] {
        let primitive = json!({ "attributes": { "POSITION": positions }, "mode": mode });
        let mut file = file.clone();
        file.mesh(primitive);
        let data = shown(&file);
        assert!(data.notes.is_empty(), "{:?}", data.notes);
        assert_eq!(mesh(&data).triangle_count(), 1);
        let counts = [mesh(&data).line_count(), mesh(&data).point_count()];
        assert_eq!(counts, [lines, points], "mode {mode}");
    }
}

#[test]
fn numbers_of_all_types_are_read() {
    // Interleaved: positions in units of 1 / 32767, two bytes unused, texture coordinates.
    let mut file = Gltf::new();
    let mut bytes = Vec::new();
    for (p, uv) in SQUARE.chunks(3).zip(SQUARE_UV.chunks(2)) {
        let scaled: Vec<f64> = p.iter().map(|x| 32767.0 * x).collect();
        bytes.extend(component_bytes(I16, &scaled));
        bytes.extend([0; 2]);
        bytes.extend(component_bytes(F32, uv));
    }
    let view = file.view(&bytes);
    file.json["bufferViews"][view]["byteStride"] = json!(16);
    let positions = json!({
        "bufferView": view, "componentType": I16, "normalized": true, "type": "VEC3", "count": 4,
    });
    let uv = json!({
        "bufferView": view, "byteOffset": 8, "componentType": F32, "type": "VEC2", "count": 4,
    });
    let positions = file.add("accessors", positions);
    let uv = file.add("accessors", uv);
    let colours = file.accessor("VEC3", U8, true, &[255., 51., 0.].repeat(4));
    let image = file.view(&jpeg(8, [255, 0, 0]));
    file.add("images", json!({ "bufferView": image }));
    file.add("textures", json!({ "source": 0 }));
    let texture = json!({ "index": 0, "texCoord": 3, "extensions": {
        "KHR_texture_transform": { "texCoord": 1 } } });
    file.add(
        "materials",
        json!({ "pbrMetallicRoughness": { "baseColorTexture": texture } }),
    );
    file.mesh(json!({
        "attributes": { "POSITION": positions, "TEXCOORD_1": uv, "COLOR_0": colours },
        "mode": 6, "material": 0,
    }));
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_texture_transform"]);
    let data = shown(&file);
    let part = &mesh(&data).parts[0];
    check_bounds(mesh(&data), [0.0; 3], [1.0, 1.0, 0.0], 0.0);
    assert_eq!(part.texture_coordinates.len(), 1);
    for (p, uv) in part.positions.iter().zip(&part.texture_coordinates[0]) {
        assert_eq!(Vec2::new(p.x as f32, 1.0 - p.y as f32), *uv);
    }
    assert!(part.colours.iter().all(|c| *c == [1.0, 0.2, 0.0, 1.0]));
    // Without the transform's override, the material names an absent set.
    let path = "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions";
    *file.json.pointer_mut(path).unwrap() = json!({});
    let data = shown(&file);
    assert!(has_note(&data, "no TEXCOORD_3"), "{:?}", data.notes);
    assert!(mesh(&data).materials[0].base_texture.is_none());
}

#[test]
fn accessors_are_checked_before_they_are_read() {
    let sound = || {
        let mut file = Gltf::new();
        let primitive = square(&mut file);
        file.mesh(primitive);
        file
    };
    mesh(&shown(&sound()));
    for (pointer, value, words) in [
        ("/accessors/0/count", json!(5), "room for 4"),
        ("/accessors/0/count", json!(u64::MAX), "room for 4"),
        ("/accessors/0/byteOffset", json!(4), "room for 3"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "room for 0"),
        (
            "/accessors/0/type",
            json!("VEC2"),
            "VEC3 of bytes, shorts or floats",
        ),
        (
            "/accessors/0/componentType",
            json!(U32),
            "VEC3 of component type 5125",
        ),
        ("/accessors/0/componentType", json!(7), "component type 7"),
        ("/accessors/0/bufferView", json!(9), "one of 2 buffer views"),
        (
            "/accessors/1/componentType",
            json!(F32),
            "SCALAR of bytes, shorts or integers",
        ),
        (
            "/bufferViews/0/byteLength",
            json!(4000),
            "a part of buffer 0",
        ),
        (
            "/bufferViews/0/byteOffset",
            json!(u64::MAX),
            "a part of buffer 0",
        ),
        ("/bufferViews/0/byteStride", json!(4), "a stride of 12"),
        ("/bufferViews/0/byteStride", json!(1_000_000), "room for 1"),
        ("/bufferViews/0/buffer", json!(3), "one of 1 buffers"),
        ("/buffers/0/byteLength", json!(1000), "1000 bytes"),
        ("/meshes/0/primitives/0/indices", json!(8), "accessor 8"),
        ("/meshes/0/primitives/0/mode", json!(8), "0 to 6"),
        ("/meshes/0/primitives/0/material", json!(8), "material 8"),
        ("/meshes/0/primitives/0/attributes", json!({}), "POSITION"),
        ("/asset/version", json!("1.0"), "2.0"),
    ] {
        let mut file = sound();
        match file.json.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => {
                let (parent, key) = pointer.rsplit_once('/').unwrap();
                file.json.pointer_mut(parent).unwrap()[key] = value;
            }
        }
        refused(&file, words);
    }
    let mut file = sound();
    file.bin[48..50].copy_from_slice(&[7, 0]);
    refused(&file, "indices of 4 vertices, found 7");
    // A zero accessor of any count needs no bytes and gets no memory.
    let mut file = sound();
    file.json["accessors"][0] = json!({
        "componentType": F32, "type": "VEC3", "count": 1_000_000_000_000_u64,
    });
    refused(&file, "1000000000000 elements");
    // Attributes must be as long as positions.
    let mut file = sound();
    let short = file.floats("VEC3", &[0., 0., 1.]);
    file.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(short);
    refused(&file, "as many as positions");
    // Unknown attributes are skipped.
    let mut file = sound();
    let attributes = &mut file.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["_MY:OWN"] = json!(99);
    attributes["TEXCOORD_x"] = json!(99);
    assert_eq!(mesh(&shown(&file)).triangle_count(), 2);
}

#[test]
fn sparse_accessors_replace_what_they_name() {
    let sparse = |indices: &[u8], count: usize| {
        let mut file = Gltf::new();
        let primitive = square(&mut file);
        file.mesh(primitive);
        let indices = file.view(indices);
        let values = file.view(&component_bytes(F32, &[5., 5., 5., 6., 6., 6.]));
        file.json["accessors"][0]["sparse"] = json!({
            "count": count,
            "indices": { "bufferView": indices, "componentType": U8 },
            "values": { "bufferView": values },
        });
        file
    };
    let data = shown(&sparse(&[1, 3], 2));
    let positions = &mesh(&data).parts[0].positions;
    assert_eq!(positions[1], DVec3::splat(5.0));
    assert_eq!(positions[3], DVec3::splat(6.0));
    assert_eq!(positions[2], DVec3::new(1.0, 1.0, 0.0));
    refused(&sparse(&[3, 1], 2), "rise");
    refused(&sparse(&[1, 1], 2), "rise");
    refused(&sparse(&[1, 4], 2), "below 4");
    refused(&sparse(&[1, 3], 3), "3 elements");
}

#[test]
fn buffers_and_images_lie_beside_the_file() {
    let folder = Folder::new();
    let mut file = Gltf::new();
    let mut primitive = square(&mut file);
    let uv = file.floats("VEC2", &SQUARE_UV);
    primitive["attributes"]["TEXCOORD_0"] = json!(uv);
    primitive["material"] = json!(0);
    file.mesh(primitive);
    file.add("images", json!({ "uri": "my%20image.png" }));
    file.add("textures", json!({ "source": 0 }));
    let texture = json!({ "index": 0 });
    file.add(
        "materials",
        json!({
            "name": "m", "emissiveFactor": [1, 1, 1], "emissiveTexture": texture,
            "pbrMetallicRoughness": { "baseColorTexture": texture, "baseColorFactor": [1, 0, 0, 1] },
        }),
    );
    file.json["buffers"][0]["uri"] = json!("parts%2Fa%20b.bin");
    let text = |file: &Gltf| serde_json::to_vec(&file.json).unwrap();

    let error = folder.refuse("a.gltf", &text(&file));
    assert!(error.contains("no file `parts/a b.bin`"), "{error}");
    std::fs::create_dir(folder.path().join("parts")).unwrap();
    folder.file("parts/a b.bin", &file.bin[..8]);
    let error = folder.refuse("a.gltf", &text(&file));
    assert!(error.contains("buffer 0"), "{error}");
    folder.file("parts/a b.bin", &file.bin);
    let data = folder.open("a.gltf", &text(&file));
    assert!(
        has_note(&data, "no file `my image.png`"),
        "{:?}",
        data.notes
    );
    let material = &mesh(&data).materials[0];
    assert!(material.base_texture.is_none());
    assert_eq!(material.base_colour, [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(material.emissive, [0.0; 3]);

    folder.file("my image.png", b"\x89PNG\r\n\x1a\nno");
    let data = folder.open("a.gltf", &text(&file));
    assert!(has_note(&data, "is damaged"), "{:?}", data.notes);
    folder.file("my image.png", &png(1, &[[1, 2, 3, 4]]));
    let data = folder.open("a.gltf", &text(&file));
    assert!(data.notes.is_empty(), "{:?}", data.notes);
    let material = &mesh(&data).materials[0];
    assert!(material.base_texture.is_some() && material.emissive_texture.is_some());
    assert_eq!(mesh(&data).textures.len(), 1);
    assert_eq!(mesh(&data).textures[0].image.pixels, [[1, 2, 3, 4]]);

    for uri in [
        "/etc/passwd",
        "http://a/b.bin",
        "C:\\a.bin",
        "",
        "data:x,abc",
    ] {
        file.json["buffers"][0]["uri"] = json!(uri);
        let error = folder.refuse("a.gltf", &text(&file));
        assert!(error.contains("buffer 0"), "{uri}: {error}");
    }
    file.json["buffers"][0]
        .as_object_mut()
        .unwrap()
        .remove("uri");
    let error = folder.refuse("a.gltf", &text(&file));
    assert!(error.contains("a URI, or the binary chunk"), "{error}");
}

#[test]
fn extensions_are_obeyed_noted_or_refused() {
    let sound = || {
        let mut file = Gltf::new();
        let primitive = square(&mut file);
        file.mesh(primitive);
        file
    };
    for name in ["ACME_other", "ACME_secret"] {
        let mut file = sound();
        file.json["extensionsUsed"] = json!([name]);
        let data = shown(&file);
        assert!(has_note(&data, name), "{:?}", data.notes);
        file.json["extensionsRequired"] = json!([name]);
        refused(&file, name);
    }
    let mut file = sound();
    file.json["extensionsRequired"] = json!(["KHR_lights_punctual", "KHR_materials_unlit"]);
    assert!(shown(&file).notes.is_empty());
    // The vertices are only in a compressed form, which is invalid.
    let mut file = sound();
    let extension = json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": {} } });
    file.json["meshes"][0]["primitives"][0]["extensions"] = extension;
    file.json["accessors"][0] = json!({ "componentType": F32, "type": "VEC3", "count": 4 });
    refused(&file, "KHR_draco_mesh_compression");
    let mut file = sound();
    file.json["bufferViews"][0]["extensions"] = json!({ "EXT_meshopt_compression": {
        "buffer": 0, "byteLength": 8, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES",
    } });
    refused(&file, "meshopt");
    file.json["bufferViews"][0]["extensions"] = json!({ "EXT_meshopt_compression": {
        "buffer": 0, "byteLength": 8, "byteStride": 12, "count": 4_000_000_000_u32, "mode": "ATTRIBUTES",
    } });
    refused(&file, "unpacked from those that there are");
    // Splats belong to another reader.
    let mut file = sound();
    file.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_gaussian_splatting": { "kernel": "ellipse" } });
    refused(&file, "KHR_gaussian_splatting");
    // The textures' image needs an extension.
    let mut file = sound();
    let uv = file.floats("VEC2", &SQUARE_UV);
    file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uv);
    file.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let texture = json!({ "extensions": { "EXT_texture_avif": { "source": 0 } } });
    file.add("textures", texture);
    file.add(
        "materials",
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
    );
    let data = shown(&file);
    assert!(
        has_note(&data, "needs EXT_texture_avif"),
        "{:?}",
        data.notes
    );
    // The older colours: specular and glossiness.
    let mut file = sound();
    file.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let extension = json!({ "diffuseFactor": [0, 1, 0, 1] });
    file.add(
        "materials",
        json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": extension } }),
    );
    assert_eq!(
        mesh(&shown(&file)).materials[0].base_colour,
        [0.0, 1.0, 0.0, 1.0]
    );
}

#[test]
fn a_scene_of_too_many_instances_is_refused() {
    let mut file = Gltf::new();
    let positions = file.floats("VEC3", &SQUARE[..9]);
    let indices = file.accessor("SCALAR", U8, false, &[0., 1., 2.].repeat(1 << 14));
    file.mesh(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    let translations = file.floats("VEC3", &vec![0.0; 3 << 12]);
    file.json["nodes"][0]["extensions"] = json!({
        "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": translations } }
    });
    refused(&file, "fewer instances");
}

#[test]
fn broken_containers_are_told() {
    let folder = Folder::new();
    let glb = rich_gltf().glb();
    for cut in [4, 8, 11, 12, 16, 20, 40, glb.len() - 1] {
        let error = folder.refuse("a.glb", &glb[..cut]);
        assert!(error.contains("; "), "{error}");
    }
    let mut old = glb.clone();
    old[4] = 1;
    assert!(folder.refuse("a.glb", &old).contains("version 1"));
    for (text, words) in [
        ("{", "JSON"),
        ("{}", "asset, version"),
        ("{\"asset\":{\"version\":\"2.0\"},\"meshes\":3}", "JSON"),
        ("[1]", "asset, version"),
        (
            "{\"asset\":{\"version\":\"2.0\"}}",
            "a triangle with an area",
        ),
    ] {
        let error = folder.refuse("a.gltf", text.as_bytes());
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn images_claim_no_more_than_their_bytes_hold() {
    let folder = Folder::new();
    let mut claims = png(1, &[[255; 4]]);
    // Width and height in the header, with its checksum.
    claims[16..24].copy_from_slice(&[0, 0, 255, 255, 0, 0, 255, 255]);
    let mut crc = flate2::Crc::new();
    crc.update(&claims[12..29]);
    claims[29..33].copy_from_slice(&crc.sum().to_be_bytes());
    folder.file("a.png", &claims);
    let (_, data) = painted(&folder, "map_Kd a.png");
    assert!(
        has_note(&data, "claims 65535 x 65535 pixels"),
        "{:?}",
        data.notes
    );
}
