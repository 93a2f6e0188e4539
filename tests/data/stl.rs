//! Tests STL: text and binary files give the original triangles and what VTK reads.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{AlphaMode, Dataset, Geometry, Mesh, MeshPart, OpenOptions, open};
use glam::DVec3;

use crate::common::real_data;
use crate::support::Folder;

/// Triangle with its attribute word.
type Facet = ([[f32; 3]; 3], u16);

fn binary(comment: &[u8], facets: &[Facet]) -> Vec<u8> {
    let mut bytes = comment.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(u32::try_from(facets.len()).unwrap().to_le_bytes());
    for (corners, attributes) in facets {
        bytes.extend([0; 12]);
        bytes.extend(corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(attributes.to_le_bytes());
    }
    bytes
}

const A: [f32; 3] = [0.0, 0.0, 0.0];
const B: [f32; 3] = [1.0, 0.0, 0.0];
const C: [f32; 3] = [0.0, 1.0, 0.0];
const D: [f32; 3] = [0.0, 0.0, 1.0];

/// Returns a tetrahedron with its front outwards.
fn tetrahedron(attributes: u16) -> [Facet; 4] {
    [[A, C, B], [A, B, D], [A, D, C], [B, C, D]].map(|corners| (corners, attributes))
}

const TEXT: &str = "solid a facet of facets\n facet normal 0 0 0\n  outer loop\n   vertex 0 0 0\n   VERTEX 1 0 0\r\n\n\
                    vertex 0 1e0 0\n  endloop\n endfacet\nendsolid\nsolid b\nfacet normal 0 0 0\nouter loop\n\
                    vertex 1 0 0\nvertex 1 1 .5\nvertex 0 1 -0\nendloop\nendfacet\nendsolid b\n";

fn mesh(data: &Dataset) -> &Mesh {
    match &data.geometry {
        Geometry::Mesh(mesh) => mesh,
        _ => panic!("no mesh"),
    }
}

fn part(data: &Dataset) -> &MeshPart {
    &mesh(data).parts[0]
}

#[test]
fn text_and_binary_files_give_their_triangles() {
    let folder = Folder::new();
    for name in ["a.stl", "b"] {
        let data = folder.open(name, TEXT.as_bytes());
        let v = DVec3::new;
        let places = [DVec3::ZERO, DVec3::X, DVec3::Y, v(1.0, 1.0, 0.5)];
        assert_eq!(part(&data).positions, places);
        assert_eq!(part(&data).triangles, [[0, 1, 2], [1, 3, 2]]);
        assert!(mesh(&data).materials[0].is_double_sided);
        // The size shows that it is binary, whatever the comment begins with.
        for comment in [b"solid facet".as_slice(), b"made"] {
            let data = folder.open(name, &binary(comment, &tetrahedron(0)));
            assert_eq!(
                part(&data).positions,
                [DVec3::ZERO, DVec3::Y, DVec3::X, DVec3::Z]
            );
            assert_eq!(
                part(&data).triangles,
                [[0, 1, 2], [0, 2, 3], [0, 3, 1], [2, 1, 3]]
            );
            assert!(!mesh(&data).materials[0].is_double_sided);
            assert!(part(&data).colours.is_empty() && data.notes.is_empty());
        }
    }
    let mut long = binary(b"made", &tetrahedron(0));
    long.push(7);
    assert!(folder.open("a.stl", &long).notes[0].contains("beyond"));
    let nan = (([A, B, [f32::NAN; 3]]), 0);
    let data = folder.open(
        "a.stl",
        &binary(b"", &[(([A, B, C]), 0), nan, ([A, A, B], 0)]),
    );
    assert_eq!((part(&data).triangles.len(), data.notes.len()), (1, 2));
}

#[test]
fn colours_are_of_two_kinds() {
    let folder = Folder::new();
    let colours = |comment: &[u8], attributes: [u16; 2]| {
        let facets = [([A, B, C], attributes[0]), ([A, C, D], attributes[1])];
        let data = folder.open("a.stl", &binary(comment, &facets));
        let first = part(&data).triangles.iter();
        let first = first.map(|t| part(&data).colours[t[0] as usize]);
        (first.collect::<Vec<_>>(), mesh(&data).materials[0].alpha)
    };
    let [red, blue] = [[1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]];
    // Triangles without colour are grey: 80 % when sRGB-encoded.
    let grey = [0.604, 0.604, 0.604, 1.0];
    let viscam = colours(b"", [0x8000 | 31 << 10, 31]);
    assert_eq!(viscam.0, [red, grey]);
    assert_eq!(
        colours(b"", [0x8000 | 31, 0x8000 | 31 << 10]).0,
        [blue, red]
    );
    let header = b"x COLOR=\xff\x00\x00\x80,MATERIAL=";
    let (found, alpha) = colours(header, [31 << 10, 0x8000]);
    assert_eq!(found, [blue, [1.0, 0.0, 0.0, 128.0 / 255.0]]);
    assert!(matches!(alpha, AlphaMode::Blend), "{alpha:?}");
}

#[test]
fn what_breaks_the_rules_is_refused() {
    let folder = Folder::new();
    let whole = binary(b"made", &tetrahedron(0));
    for (bytes, said) in [
        (&whole[..283], "4 triangles"),
        (&whole[..84], "4 triangles"),
        (&whole[..83], "a count of triangles"),
        (b"solid facet endsolid", "a triangle"),
        (b"solid a\nfacet\nouter loop\nvertex 1 2\n", "three numbers"),
        (b"solid a\nfacet\nouter loop\nvertex 1 2 x\n", "line 4"),
        (
            b"solid a\nfacet\nouter loop\nvertex 1 2 3\nendloop",
            "three corners",
        ),
        (
            b"solid a\nfacet\nouter loop\nvertex 1 2 3\n",
            "the end of the file",
        ),
        (
            b"solid a\nfacet\nouter loop\nvertex 1 2 3\nendfacet",
            "endloop",
        ),
        (b"solid a\nfacet\nouter loop\nwhat", "`what`"),
    ] {
        let error = folder.refuse("a.stl", bytes);
        assert!(error.contains(said), "{said}: {error}");
    }
}

#[test]
fn real_meshes_are_what_vtk_reads() {
    // Triangles, positions, and the bounds of all, by VTK's vtkSTLReader with merged points.
    for (name, counts, low, high) in REAL {
        let Some(path) = real_data(&format!("formats/meshes/{name}")) else {
            return;
        };
        let data = open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(
            [part(&data).triangles.len(), part(&data).positions.len()],
            counts,
            "{name}"
        );
        let (found_low, found_high) = data.bounds().unwrap();
        let near = |a: DVec3, b: [f64; 3]| (a - DVec3::from_array(b)).abs().max_element() < 1e-5;
        assert!(
            near(found_low, low) && near(found_high, high),
            "{name}: {found_low} {found_high}"
        );
    }
}

/// File, its numbers of triangles and positions, and its bounds.
type Real = (&'static str, [usize; 2], [f64; 3], [f64; 3]);

const REAL: [Real; 3] = [
    ("triangle.stl", [1, 3], [-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]),
    (
        "greatWhite.stl",
        [6264, 3155],
        [-4.364, -2.2, -14.490_001],
        [4.362, 7.912, 9.660_001],
    ),
    (
        "Spider_ascii.stl",
        [1312, 722],
        [-3.114_895, -4.0, -1.649_329],
        [3.114_895, 4.0, 1.649_329],
    ),
];
