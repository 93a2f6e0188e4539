//! Tests SOG: scenes of both versions, from folders and archives, give the original splats and what
//! PlayCanvas's program reads.

#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::path::Path;

use ewa_splat::io::{Dataset, Geometry, OpenOptions, SplatCloud, open, read_with};

use crate::common::real_data;
use crate::support::Folder;
use crate::support::sog::{archive, scene, webp};
use crate::support::splats::{Splat, some_splats};

fn cloud(data: &Dataset) -> &SplatCloud {
    match &data.geometry {
        Geometry::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

fn folder_of(files: &[(&str, Vec<u8>)]) -> Folder {
    let folder = Folder::new();
    for (name, bytes) in files {
        folder.file(name, bytes);
    }
    folder
}

/// Asserts that splats equal the original ones within half of the storage steps.
fn assert_holds(data: &Dataset, splats: &[Splat]) {
    let found = cloud(data);
    assert_eq!(found.positions.len(), splats.len());
    assert!(data.notes.is_empty(), "{:?}", data.notes);
    let stride = found.harmonics_stride();
    for (i, s) in splats.iter().enumerate() {
        let near = |a: f64, b: f64, most: f64, what: &str| {
            assert!((a - b).abs() <= most, "{what} of {i}: {a} for {b}");
        };
        for axis in 0..3 {
            let position = found.positions[i][axis];
            // Half a step of the logarithm is 3.2e-5, times 1 + |x|, at most 5.5.
            near(position, s.position[axis], 1.8e-4, "position");
            let scale = f64::from(found.scales[i][axis]).ln();
            near(scale, s.scales[axis].ln(), 4.01 / 255.0, "scale");
        }
        let length = s.rotation.iter().map(|q| q * q).sum::<f64>().sqrt();
        let largest = s
            .rotation
            .iter()
            .fold(0.0_f64, |m, q| if q.abs() > m.abs() { *q } else { m });
        for k in 0..4 {
            let expected = s.rotation[k] * largest.signum() / length;
            near(f64::from(found.rotations[i][k]), expected, 6e-3, "rotation");
        }
        // A logit's step is 6 / 255, whose effect on an opacity is at most a quarter.
        near(f64::from(found.opacities[i]), s.opacity, 3e-3, "opacity");
        let own = &found.harmonics[stride * i..][..stride];
        for (k, (a, b)) in own.iter().zip(s.harmonics.as_flattened()).enumerate() {
            let most = if k < 3 { 0.501 / 255.0 } else { 0.251 / 255.0 };
            near(f64::from(*a), *b, most, "coefficient");
        }
    }
}

#[test]
fn both_versions_give_what_went_in() {
    for degree in 0..4 {
        let splats = some_splats(5, degree);
        for version in [1, 2] {
            let files = scene(version, &splats);
            let folder = folder_of(&files);
            let meta = folder.path().join("meta.json");
            for path in [folder.path(), &meta] {
                let data = open(path, &OpenOptions::default()).unwrap();
                assert_eq!(data.format, "SOG splats");
                assert_eq!(usize::from(cloud(&data).harmonics_degree), degree);
                assert_eq!(cloud(&data).rule.is_anti_aliased(), version == 2);
                assert_holds(&data, &splats);
            }
            for packed in [false, true] {
                for name in ["a.sog", "a.zip"] {
                    let data = folder.open(name, &archive(version, &splats, packed));
                    assert_holds(&data, &splats);
                }
            }
            let beside = |path: &Path| {
                let name = path.to_str()?;
                let mut files = files.iter();
                files.find(|(n, _)| *n == name).map(|(_, b)| b.clone())
            };
            let (_, meta) = files.last().unwrap();
            let data = read_with("x.json", meta, &OpenOptions::default(), &beside).unwrap();
            assert_holds(&data, &splats);
        }
    }
}

#[test]
fn what_is_wrong_with_a_scene_is_told() {
    let splats = some_splats(5, 1);
    let broken = |version: u32, from: &str, to: &str| {
        let files = scene(version, &splats);
        let folder = folder_of(&files);
        let meta = String::from_utf8(files.last().unwrap().1.clone()).unwrap();
        assert!(meta.contains(from), "{meta}");
        let meta = meta.replacen(from, to, 1);
        folder.refuse("meta.json", meta.as_bytes())
    };
    for (version, from, to, words) in [
        (2, "\"version\":2", "\"version\":3", "version 3"),
        (
            2,
            "\"count\":5,\"means\"",
            "\"counts\":5,\"means\"",
            "`count`",
        ),
        (2, "\"bands\":1", "\"bands\":4", "`shN.bands`"),
        (2, "\"bands\":1", "\"bands\":2", "512 pixels a row"),
        (2, "[-0.5,", "[", "256 numbers"),
        (
            2,
            "\"count\":5,\"means\"",
            "\"count\":70,\"means\"",
            "each of 70 splats",
        ),
        (
            2,
            "\"count\":5,\"means\"",
            "\"count\":99999999,\"means\"",
            "of 99999999 splats",
        ),
        (
            2,
            "\"count\":5,\"means\"",
            "\"count\":0,\"means\"",
            "at least one",
        ),
        (2, "means_l.webp", "../means_l.webp", "a relative path"),
        (2, "means_l.webp", "/means_l.webp", "a relative path"),
        (2, "means_l.webp", "means_x.webp", "means_x.webp"),
        (
            2,
            "means_l.webp",
            "meta.json",
            "neither PNG, JPEG, WebP nor KTX 2",
        ),
        (1, "[5,3]", "[]", "`means.shape`"),
        (1, "quaternion_packed", "quaternion", "`quaternion`"),
        (1, "\"mins\":[-6.0,", "\"mins\":[", "3 numbers each"),
    ] {
        let error = broken(version, from, to);
        assert!(error.contains(words), "{from} {to}: {error}");
    }
    let folder = Folder::new();
    let error = folder.refuse("a.sog", &crate::support::npz(&[("a.webp", vec![1])], false));
    assert!(error.contains("no `meta.json`"), "{error}");
    let files = &scene(2, &splats)[1..];
    let error = folder.refuse("a.sog", &crate::support::npz(files, false));
    assert!(error.contains("no `means_l.webp`"), "{error}");
    // The folder holds something else.
    let error = open(folder.path(), &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("a directory"), "{error}");
}

/// A codebook without its first entry is extrapolated downwards. Invalid rotations and palette
/// entries are counted.
#[test]
fn what_some_writers_leave_out_is_filled_in() {
    let splats = some_splats(5, 1);
    let folder = folder_of(&scene(2, &splats));
    let meta = std::fs::read_to_string(folder.path().join("meta.json")).unwrap();
    let meta = meta.replacen("[-0.5,", "[null,", 1).replacen(
        "\"count\":5,\"files\"",
        "\"count\":3,\"files\"",
        1,
    );
    assert!(meta.contains("\"count\":3"), "{meta}");
    folder.file("meta.json", meta.as_bytes());
    folder.file("sh0.webp", &webp(4, &[[0, 1, 255, 102]; 8]));
    folder.file("quats.webp", &webp(4, &[[9, 8, 7, 6]; 8]));
    let data = open(folder.path(), &OpenOptions::default()).unwrap();
    let found = cloud(&data);
    let constant = &found.harmonics[..3];
    // -.5 + 1/255 less (1 - 1/255) / 255.
    assert!((constant[0] + 0.499_984_6).abs() < 1e-6, "{constant:?}");
    assert!((constant[1] + 0.496_078_4).abs() < 1e-6, "{constant:?}");
    assert!((found.opacities[4] - 0.4).abs() < 1e-6);
    assert_eq!(
        found.rotations[0].map(f32::to_bits),
        [1.0, 0.0, 0.0, 0.0].map(f32::to_bits)
    );
    let notes = data.notes.join("\n");
    assert!(notes.contains("5 rotations do not say"), "{notes}");
    assert!(notes.contains("2 splats name harmonics"), "{notes}");
}

/// Numbers of `splat-transform` 2.7: of the first, middle and last splat the position, logarithms
/// of scales, coefficients of the constant harmonic, logit and quaternion; then the first two and
/// the last of the other coefficients in PLY's order.
#[test]
fn real_scenes_hold_what_their_makers_program_reads() {
    let first = [
        -1.195292, -2.550772, -0.4683755, -11.24548, -5.207421, -9.329841, 0.9152414, 0.04087364,
        -0.2966105, 1.173426, 0.2745238, -0.2135185, 0.7236065, -0.5961881,
    ];
    let middle = [
        0.9981683,
        -0.02115293,
        -0.03018775,
        -7.05006,
        -5.447349,
        -7.98908,
        0.6933506,
        0.1291782,
        -0.2537027,
        0.6061358,
        0.42981,
        0.63727,
        -0.3965344,
        0.5019072,
    ];
    let last = [
        0.9979095,
        -0.0262421,
        1.021142,
        -8.731708,
        -4.475065,
        -5.712896,
        -1.028823,
        -1.237095,
        -1.22216,
        0.7646061,
        0.7310913,
        -0.04159452,
        -0.04714045,
        -0.6793771,
    ];
    for (name, count, degree, i, expected, rest) in [
        ("sog_v1", 307_128, 0, 0, first, None),
        (
            "sog_v2",
            31_000,
            2,
            15_500,
            middle,
            Some([0.3872965, -0.2139094, 0.2189316]),
        ),
        (
            "sog_v2",
            31_000,
            2,
            30_999,
            last,
            Some([0.01919161, -0.3990518, 0.05122896]),
        ),
    ] {
        let Some(path) = real_data(&format!("formats/splats/{name}/meta.json")) else {
            return;
        };
        let data = open(&path, &OpenOptions::default()).unwrap();
        let found = cloud(&data);
        assert_eq!(
            (found.positions.len(), found.harmonics_degree),
            (count, degree)
        );
        let own = &found.harmonics[found.harmonics_stride() * i..][..found.harmonics_stride()];
        let opacity = found.opacities[i];
        let numbers: Vec<f32> = found.positions[i]
            .as_vec3()
            .to_array()
            .into_iter()
            .chain(found.scales[i].map(f32::ln))
            .chain(own[..3].iter().copied())
            .chain([(opacity / (1.0 - opacity)).ln()])
            .chain(found.rotations[i])
            .collect();
        for (found, expected) in numbers.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < 3e-6, "{numbers:?}");
        }
        if let Some([first, second, last]) = rest {
            let read = [own[3], own[6], own[own.len() - 1]].map(f64::from);
            for (found, expected) in read.into_iter().zip([first, second, last]) {
                assert!((found - expected).abs() < 1e-7, "{found} for {expected}");
            }
        }
    }
}
