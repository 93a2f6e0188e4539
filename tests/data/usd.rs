//! Tests splats of OpenUSD against files and numbers of its own library.
//!
//! `fixtures/usd/make.py` wrote one stage as text, in binary form and as an archive, with `usd-core` 26.11:
//! splats below transforms, and surflets in half floats below a transform that changes in time.
//! `expected.json` has what it shows, computed in numpy with that library's matrices.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{
    Dataset, Geometry, OpenOptions, SplatCloud, SplatFileOptions, open, read, write_splats,
};
use ewa_splat::math::{harmonics, harmonics_sum};
use ewa_splat::scene::SplatRule;
use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;

use crate::common::Random;
use crate::support::Folder;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/usd")
        .join(name)
}

fn cloud(data: &Dataset) -> &SplatCloud {
    match &data.geometry {
        Geometry::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    let values = value.as_array().unwrap().iter();
    values.map(|v| v.as_f64().unwrap()).collect()
}

fn variance(cloud: &SplatCloud, i: usize) -> DMat3 {
    let [w, x, y, z] = cloud.rotations[i].map(f64::from);
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let factor = axes * DMat3::from_diagonal(DVec3::from(cloud.scales[i].map(f64::from)));
    factor * factor.transpose()
}

#[test]
fn stages_show_what_their_own_library_shows() {
    let text = std::fs::read_to_string(fixture("expected.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let rows = expected["splats"].as_array().unwrap();
    let directions = expected["directions"].as_array().unwrap();
    for name in ["scene.usda", "scene.usdc", "scene.usdz"] {
        let data = open(&fixture(name), &OpenOptions::default()).unwrap();
        assert_eq!(data.format, "USD splats");
        assert_eq!(data.up().direction, DVec3::Z);
        let cloud = cloud(&data);
        assert_eq!((cloud.positions.len(), rows.len()), (40, 40), "{name}");
        assert_eq!((cloud.rule, cloud.is_linear), (SplatRule::Inria, false));
        assert_eq!(cloud.harmonics_degree, 1);
        // Text has the binary form's order: by name, or as written.
        for row in rows {
            let position = DVec3::from_slice(&numbers(&row["position"]));
            let distance = |i: &usize| cloud.positions[*i].distance(position);
            let near = (0..40).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let i = near.unwrap();
            // Text has six digits of halves, and angles are f32: some 1e-6 of coordinates up to 10.
            assert!(distance(&i) < 2e-5, "{name}: {position}");
            let expected = DMat3::from_cols_slice(&numbers(&row["variance"]));
            let apart = variance(cloud, i) - expected;
            let most = apart.to_cols_array().into_iter().map(f64::abs);
            let size = expected.x_axis.x + expected.y_axis.y + expected.z_axis.z;
            assert!(most.fold(0.0, f64::max) < 1e-5 * size, "{name}: {apart}");
            let opacity = row["opacity"].as_f64().unwrap();
            assert_eq!(f64::from(cloud.opacities[i]).to_bits(), opacity.to_bits());
            let colours = row["colours"].as_array().unwrap();
            for (direction, colour) in directions.iter().zip(colours) {
                let d = DVec3::from_slice(&numbers(direction)).as_vec3();
                let found = harmonics_sum(&cloud.harmonics[12 * i..][..12], &harmonics(d));
                for (a, b) in found.into_iter().zip(numbers(colour)) {
                    // Sums below 0 are drawn as 0.
                    let a = f64::from(a);
                    assert!(
                        (a.max(0.0) - b.max(0.0)).abs() < 1e-5,
                        "{name}: {a}, not {b}"
                    );
                }
            }
        }
        let notes = data.notes.join("\n");
        for words in ["1 prim of splats is not shown", "first sample", "1 Cube"] {
            assert!(notes.contains(words), "{words}: {notes}");
        }
        assert_eq!(data.notes.len(), 3, "{notes}");
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "numbers between -1 and 1 in single precision"
)]
fn some_cloud(count: usize, degree: u8) -> SplatCloud {
    let mut random = Random::new(11);
    let mut cloud = SplatCloud {
        harmonics_degree: degree,
        rule: SplatRule::Inria,
        ..SplatCloud::default()
    };
    for _ in 0..count {
        cloud.positions.push(random.point(2.0).as_vec3().as_dvec3());
        let size = |_| random.log_range(1e-6, 1e12) as f32;
        cloud.scales.push([0, 1, 2].map(size));
        // A unit quaternion that rounding keeps.
        cloud.rotations.push([0.5, -0.5, 0.5, 0.5]);
        cloud.opacities.push(random.range(0.0, 1.0) as f32);
        let harmonics = (0..cloud.harmonics_stride()).map(|_| random.range(-1.0, 1.0) as f32);
        cloud.harmonics.extend(harmonics.collect::<Vec<_>>());
    }
    cloud
}

#[test]
fn what_is_written_is_read_bit_for_bit() {
    let folder = Folder::new();
    for degree in 0..=3 {
        for is_flat in [false, true] {
            for (is_linear, by_distance) in [(false, false), (true, !is_flat)] {
                let mut before = some_cloud(9000, degree);
                before.is_linear = is_linear;
                before.by_distance = by_distance;
                if is_flat {
                    before.scales.iter_mut().for_each(|s| s[2] = 0.0);
                }
                for name in ["a.usda", "a.usdc", "a.usdz"] {
                    let path = folder.path().join(name);
                    let options = SplatFileOptions::default();
                    let written = write_splats(&path, &before, &options).unwrap();
                    assert!(written.notes.is_empty(), "{:?}", written.notes);
                    let data = open(&path, &OpenOptions::default()).unwrap();
                    assert!(data.notes.is_empty(), "{:?}", data.notes);
                    assert_eq!(*cloud(&data), before, "{name}, degree {degree}");
                    assert_eq!(data.up().direction, DVec3::Y);
                }
                let text = std::fs::read_to_string(folder.path().join("a.usda")).unwrap();
                assert_eq!(text.contains("GaussianSurfletAPI"), is_flat);
            }
        }
    }
}

#[test]
fn positions_far_from_the_origin_get_a_transform() {
    let folder = Folder::new();
    let path = folder.path().join("a.usda");
    let mut before = some_cloud(9, 0);
    let far = DVec3::new(1e7 + 0.125, -3e6, 0.0);
    before.positions.iter_mut().for_each(|p| *p += far);
    let written = write_splats(&path, &before, &SplatFileOptions::default()).unwrap();
    assert!(written.position_quantum < 1e-6);
    let data = open(&path, &OpenOptions::default()).unwrap();
    for (a, b) in before.positions.iter().zip(&cloud(&data).positions) {
        // A rounding of f64 at 1e7.
        assert!(
            (*a - *b).length() <= written.position_quantum + 4e-9,
            "{a}, {b}"
        );
    }
}

#[test]
fn binary_layers_are_checked_against_their_bytes() {
    let whole = std::fs::read(fixture("scene.usdc")).unwrap();
    let opened = |bytes: &[u8]| read("a.usdc", bytes, &OpenOptions::default());
    for len in 8..whole.len() {
        let error = opened(&whole[..len]).unwrap_err().to_string();
        assert!(error.contains("usdcat"), "{len}: {error}");
    }
    let mut old = whole.clone();
    old[9] = 3;
    let error = opened(&old).unwrap_err().to_string();
    assert!(
        error.contains("version 0.3") && error.contains("usdcat"),
        "{error}"
    );
    // Any byte may be wrong: data or an error.
    for at in 8..whole.len() {
        for mask in [1, 0x40, 0xff] {
            let mut damaged = whole.clone();
            damaged[at] ^= mask;
            if let Ok(data) = opened(&damaged) {
                assert!(!cloud(&data).positions.is_empty());
            }
        }
    }
}
