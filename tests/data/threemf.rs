//! Tests 3MF: archives made by hand, and one of another program.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::image::linear_from_srgb;
use ewa_splat::io::{AlphaMode, Dataset, Geometry, Mesh, OpenOptions, Wrap, open};
use glam::{DVec3, Vec2};

use crate::common::real_data;
use crate::support::{Folder, npz, threemf};

fn mesh(data: &Dataset) -> &Mesh {
    match &data.geometry {
        Geometry::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

/// Returns the volume that closed parts enclose, by the divergence theorem.
fn volume(mesh: &Mesh) -> f64 {
    let of = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c)) / 6.0;
    mesh.parts
        .iter()
        .flat_map(|part| {
            part.triangles
                .iter()
                .map(|t| t.map(|i| part.positions[i as usize]))
        })
        .map(|[a, b, c]| of(a, b, c))
        .sum()
}

#[test]
fn objects_stand_in_their_places() {
    let folder = Folder::new();
    for name in ["a.3mf", "b.zip"] {
        let data = folder.open(name, &threemf::rich());
        let mesh = mesh(&data);
        // A tetrahedron of 1/6, enlarged twofold in each direction, and its mirror image.
        assert!((volume(mesh) - (8.0 + 1.0) / 6.0).abs() < 1e-12);
        assert_eq!(mesh.triangle_count(), 9);
        let [lower, upper] = data.bounds().map(|(a, b)| [a, b]).unwrap();
        assert_eq!(lower, DVec3::new(-1.0, 0.0, 0.0));
        assert_eq!(upper, DVec3::new(12.0, 22.0, 32.0));
        assert!(
            data.notes.iter().any(|n| n.contains("inch")),
            "{:?}",
            data.notes
        );
    }
}

#[test]
fn colours_and_textures_are_those_of_their_groups() {
    let folder = Folder::new();
    let data = folder.open("a.3mf", &threemf::rich());
    let mesh = mesh(&data);
    let [coloured, textured] = [false, true].map(|is| {
        let has = |m: usize| mesh.materials[m].base_texture.is_some();
        mesh.parts
            .iter()
            .find(|part| has(part.material) == is)
            .unwrap()
    });
    let half = linear_from_srgb(128.0 / 255.0);
    let at = |position: DVec3, colours: &[[f32; 4]]| {
        let corners = coloured.positions.iter().zip(&coloured.colours);
        let mut found: Vec<[f32; 4]> = corners
            .filter(|(p, _)| **p == position)
            .map(|(_, c)| *c)
            .collect();
        found.sort_by(|a, b| a.partial_cmp(b).unwrap());
        found.dedup();
        assert_eq!(found, colours, "{position}");
    };
    // Three faces of the object's own colour meet there; at the other corners also one of the
    // corners' colours.
    at(
        DVec3::new(10.0, 20.0, 32.0),
        &[[0.0, half, 1.0, 0.5019608], [1.0, 0.0, 0.0, 1.0]],
    );
    at(DVec3::new(10.0, 20.0, 30.0), &[[1.0, 0.0, 0.0, 1.0]]);
    assert_eq!(mesh.materials[coloured.material].alpha, AlphaMode::Blend);
    assert_eq!(textured.triangles.len(), 1);
    let coordinates = &textured.texture_coordinates[0];
    assert_eq!(
        coordinates[..],
        [
            Vec2::new(0.0, 1.0),
            Vec2::new(1.0, 1.0),
            Vec2::new(0.0, 0.25)
        ]
    );
    let texture = &mesh.textures[0];
    assert_eq!(texture.wrap, [Wrap::ClampToEdge, Wrap::Repeat]);
    assert_eq!(texture.image.pixels[0], [255, 0, 0, 255]);
}

#[test]
fn a_box_of_another_program_is_whole() {
    let Some(path) = real_data("formats/meshes/box.3mf") else {
        return;
    };
    let data = open(&path, &OpenOptions::default()).unwrap();
    // The count is that of trimesh 5.2.
    assert_eq!(mesh(&data).parts[0].positions.len(), 8);
    assert_eq!(mesh(&data).triangle_count(), 12);
    assert!((volume(mesh(&data)) - 6000.0).abs() < 1e-9);
    assert_eq!(
        data.bounds(),
        Some((DVec3::ZERO, DVec3::new(10.0, 20.0, 30.0)))
    );
    assert!(!mesh(&data).materials[0].is_double_sided);
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}

#[test]
fn what_is_wrong_is_told() {
    let folder = Folder::new();
    let model = threemf::model();
    for (from, to, words) in [
        ("objectid=\"1\"", "objectid=\"3\"", "components 32 deep"),
        ("objectid=\"1\"", "objectid=\"9\"", "object 9"),
        ("v1=\"0\"", "v1=\"4\"", "one of 4 vertices"),
        ("x=\"1\"", "x=\"one\"", "`one`"),
        ("#FF0000", "red", "#RRGGBB"),
        ("2 0 0 0 2 0", "2 0 0 0 2", "twelve numbers"),
        ("<model", "<modal", "well-formed"),
        (
            "p:path=\"/3D/part.model\"",
            "p:path=\"/3D/none.model\"",
            "none.model",
        ),
    ] {
        assert!(model.contains(from), "{from}");
        let file = threemf::archive(&model.replacen(from, to, 1));
        let error = folder.refuse("a.3mf", &file);
        assert!(error.contains(words), "{from} {to}: {error}");
    }
    let error = folder.refuse("a.3mf", &npz(&[("a", vec![1])], false));
    assert!(error.contains("3dmodel.model"), "{error}");
    // An invalid texture is left out with a note; so are properties of other kinds.
    let model = model
        .replacen("a.png", "b.png", 1)
        .replacen("pid=\"10\"", "pid=\"77\"", 1);
    let data = folder.open("a.3mf", &threemf::archive(&model));
    let notes = data.notes.join("\n");
    assert!(
        notes.contains("b.png") && notes.contains("a kind that is not read"),
        "{notes}"
    );
}
