//! Tests glTF meshes compressed by Draco and by meshopt, against the reference decoders' results.
//!
//! `fixtures/packed` holds each mesh twice: compressed by glTF-Transform (with draco3d 1.5) or by
//! meshoptimizer 1.3, and decompressed by the same libraries.

use std::path::{Path, PathBuf};

use ewa_splat::io::{Dataset, Geometry, Mesh, OpenOptions, open, read};
use glam::DVec3;

use crate::common::real_data;

fn fixture(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/packed");
    folder.join(name)
}

fn opened(path: &Path) -> Dataset {
    open(path, &OpenOptions::default()).unwrap()
}

fn mesh_of(data: &Dataset) -> &Mesh {
    match &data.geometry {
        Geometry::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

/// Returns all corners of all triangles, in an order that does not depend on that of triangles or
/// vertices.
fn corners(mesh: &Mesh) -> Vec<[f64; 12]> {
    let mut all = Vec::new();
    for part in &mesh.parts {
        for i in part.triangles.as_flattened().iter().map(|i| *i as usize) {
            let uv = part.texture_coordinates.first().map(|set| set[i]);
            let [u, v] = uv.unwrap_or_default().as_dvec2().to_array();
            let [x, y, z] = part.positions[i].to_array();
            let [nx, ny, nz] = part.normals[i].as_dvec3().to_array();
            let [r, g, b, a] = part.colours[i].map(f64::from);
            all.push([x, y, z, nx, ny, nz, u, v, r, g, b, a]);
        }
    }
    all
}

#[test]
#[cfg(feature = "draco")]
fn draco_gives_what_its_reference_decoder_gives() {
    for name in ["draco", "draco_sequential"] {
        check_same(name);
    }
}

#[test]
fn meshopt_gives_what_its_reference_decoder_gives() {
    for name in ["meshopt", "meshopt_khr"] {
        check_same(name);
    }
}

/// Checks that every number of every corner equals that of the decompressed file, in its order.
fn check_same(name: &str) {
    let packed = opened(&fixture(&format!("{name}.glb")));
    let unpacked = opened(&fixture(&format!("{name}_unpacked.glb")));
    assert!(packed.notes.is_empty(), "{name}: {:?}", packed.notes);
    let [packed, unpacked] = [&packed, &unpacked].map(mesh_of);
    assert_eq!(packed.triangle_count(), unpacked.triangle_count(), "{name}");
    assert!(packed.triangle_count() >= 192, "{name}");
    let [packed, unpacked] = [packed, unpacked].map(corners);
    for (packed, unpacked) in packed.iter().zip(&unpacked) {
        for (a, b) in packed.iter().zip(unpacked) {
            assert!((a - b).abs() < 1e-6, "{name}: {packed:?} {unpacked:?}");
        }
    }
    // The original torus has radii 2 and 0.7, to within the quantisation.
    if name != "meshopt_khr" {
        for corner in &packed {
            let p = DVec3::from_slice(&corner[..3]) - DVec3::new(1.0, 2.0, 3.0);
            let ring = p.x.hypot(p.z) - 2.0;
            assert!((ring.hypot(p.y) - 0.7).abs() < 1e-3, "{name}: {p}");
            let normal = DVec3::from_slice(&corner[3..6]);
            let outwards = DVec3::new(p.x, 0.0, p.z).normalize() * ring + DVec3::Y * p.y;
            assert!(normal.dot(outwards / 0.7) > 0.99, "{name}: {normal}");
        }
    }
}

#[test]
fn real_packed_boxes_have_their_corners() {
    let centre_of = [
        ("meshopt/BoxMeshopt.glb", DVec3::ZERO, true),
        (
            "draco/BoxMetaDraco.gltf",
            DVec3::Z * 2.0,
            cfg!(feature = "draco"),
        ),
    ];
    for (name, centre, is_read) in centre_of {
        let Some(path) = real_data(&format!("formats/meshes/{name}")) else {
            return;
        };
        if !is_read {
            continue;
        }
        let data = opened(&path);
        let mesh = mesh_of(&data);
        assert_eq!(mesh.triangle_count(), 12, "{name}");
        let part = &mesh.parts[0];
        let (mut volume, mut sum) = (0.0, DVec3::ZERO);
        for triangle in &part.triangles {
            let [a, b, c] = triangle.map(|i| part.positions[i as usize] - centre);
            for corner in [a, b, c] {
                assert!((corner.abs() - 0.5).abs().max_element() < 1e-4, "{corner}");
            }
            let normal = part.normals[triangle[0] as usize].as_dvec3();
            assert!(
                (b - a).cross(c - a).normalize().dot(normal) > 0.999,
                "{name}"
            );
            volume += a.dot(b.cross(c)) / 6.0;
            sum += a + b + c;
        }
        assert!((volume - 1.0).abs() < 1e-3, "{name}: {volume}");
        assert!(sum.length() < 1e-2, "{name}: {sum}");
    }
}

#[test]
fn unknown_modes_of_packed_views_are_refused() {
    let bytes = std::fs::read(fixture("meshopt.glb")).unwrap();
    let error_of = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes());
        let mut changed = bytes.clone();
        changed[at.unwrap()..][..to.len()].copy_from_slice(to.as_bytes());
        let error = read("a.glb", &changed, &OpenOptions::default()).unwrap_err();
        error.to_string()
    };
    let error = error_of("\"mode\":\"ATTRIBUTES\"", "\"mode\":\"ATTRIBUTED\"");
    assert!(error.contains("a mode `ATTRIBUTES`"), "{error}");
}
