//! Tests splats in the axes of each format, and `.ksplat` files, against the numbers of another
//! program.
//!
//! `fixtures/splats/scene.ply` holds three splats of degree 3 without any symmetry (`some_splats`).
//! PlayCanvas's `splat-transform` 2.7.1 (from npm) converted it to the files called `theirs`, and
//! `write_splats` to those called `ours`. `support::splats::ksplat` wrote those called `mode`.
//! `read.json` holds the numbers of the PLY file that `splat-transform FILE a.ply` made of each
//! file.

use std::path::{Path, PathBuf};

use ewa_splat::io::{
    Dataset, Geometry, OpenOptions, SplatAxes, SplatCloud, SplatFileOptions, SpzVersion, Up, open,
    write_splats,
};
use ewa_splat::math::harmonics_count;
use ewa_splat::scene::SplatRule;
use glam::{DQuat, DVec3};
use serde_json::Value;

use crate::support::Folder;
use crate::support::splats::{Splat, glb_packed, ksplat, some_splats, spz};

fn fixture(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/splats");
    folder.join(name)
}

fn cloud(data: Dataset) -> SplatCloud {
    match data.geometry {
        Geometry::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

fn opened(path: &Path) -> SplatCloud {
    cloud(open(path, &OpenOptions::default()).unwrap())
}

/// Returns options that rotate the data read from `path`.
fn turned(path: &Path, spz_version: Option<SpzVersion>) -> SplatFileOptions {
    let up = open(path, &OpenOptions::default()).unwrap().up();
    SplatFileOptions {
        spz_version,
        up: Some(up.direction),
        ..SplatFileOptions::default()
    }
}

/// Returns the numbers of splat `i` as in PLY: position, constant colour, other harmonics, logit,
/// logarithms, unit quaternion.
fn numbers(cloud: &SplatCloud, i: usize) -> [Vec<f64>; 6] {
    let all = |x: &[f32]| x.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    let count = harmonics_count(cloud.harmonics_degree);
    let set = &cloud.harmonics[3 * count * i..][..3 * count];
    let rest = (0..3).flat_map(|c| set[3..].iter().skip(c).step_by(3));
    let rest: Vec<f32> = rest.copied().collect();
    let opacity = f64::from(cloud.opacities[i]);
    [
        cloud.positions[i].to_array().to_vec(),
        all(&set[..3]),
        all(&rest),
        vec![(opacity / (1.0 - opacity)).ln()],
        cloud.scales[i].map(|s| f64::from(s).ln()).to_vec(),
        unit(&all(&cloud.rotations[i])),
    ]
}

fn unit(q: &[f64]) -> Vec<f64> {
    let length = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    q.iter().map(|c| c / length).collect()
}

fn assert_near(a: &[Vec<f64>; 6], b: &[Vec<f64>; 6], what: &str) {
    for (k, (a, b)) in a.iter().zip(b).enumerate() {
        assert_eq!(a.len(), b.len(), "{what}");
        // Some roundings of f32, of numbers up to 4. That program reads a record's rotation as byte
        // / 127.5 - 1; the format's first viewer and this library read byte / 128 - 1. The
        // difference is at most 1/128.
        let most = if k == 5 && what.contains(".splat") {
            8e-3
        } else {
            1e-6
        };
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() < most, "{what}: {a}, not {b}");
        }
    }
}

#[test]
fn files_hold_what_another_program_reads_in_them() {
    let text = std::fs::read_to_string(fixture("read.json")).unwrap();
    let read: Value = serde_json::from_str(&text).unwrap();
    let read = read.as_object().unwrap();
    assert_eq!(read.len(), 11);
    for (name, rows) in read {
        let cloud = opened(&fixture(name));
        let rows = rows.as_array().unwrap();
        assert_eq!(cloud.positions.len(), rows.len(), "{name}");
        for (i, row) in rows.iter().enumerate() {
            let list = |key: &str| -> Vec<f64> {
                let values = row[key].as_array().unwrap().iter();
                values.map(|v| v.as_f64().unwrap()).collect()
            };
            let theirs = [
                list("position"),
                list("constant"),
                list("rest"),
                vec![row["logit"].as_f64().unwrap()],
                list("logarithms"),
                unit(&list("rotation")),
            ];
            assert_near(&numbers(&cloud, i), &theirs, &format!("{name}, splat {i}"));
        }
    }
}

#[test]
fn what_is_written_is_what_the_other_program_has_read() {
    let folder = Folder::new();
    let scene = fixture("scene.ply");
    for (name, version) in [
        ("ours.splat", None),
        ("ours.compressed.ply", None),
        ("ours_3.spz", None),
        ("ours_3.spz", Some(SpzVersion::Three)),
        ("ours_4.spz", Some(SpzVersion::Four)),
        ("ours.sog", None),
    ] {
        let path = folder.path().join(name);
        write_splats(&path, &opened(&scene), &turned(&scene, version)).unwrap();
        // Compressors may change between releases.
        assert_eq!(opened(&path), opened(&fixture(name)), "{name}");
    }
}

#[test]
fn gltf_files_are_turned_as_the_other_program_turns_them() {
    let folder = Folder::new();
    let (scene, theirs) = (fixture("scene.ply"), fixture("theirs.glb"));
    let ours = folder.path().join("a.glb");
    let written = write_splats(&ours, &opened(&scene), &turned(&scene, None)).unwrap();
    assert_eq!(written.turn, DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0));
    let (a, b) = (opened(&ours), opened(&theirs));
    for i in 0..3 {
        assert_near(&numbers(&a, i), &numbers(&b, i), "glb");
    }
    // x left, y up: half a turn about z.
    let before = opened(&scene);
    assert_eq!(
        a.positions[1],
        before.positions[1] * DVec3::new(-1.0, -1.0, 1.0)
    );
    // Conversion back gives the same numbers, except that quaternions are normalised.
    for glb in [&ours, &theirs] {
        let back = folder.path().join("back.ply");
        write_splats(&back, &opened(glb), &turned(glb, None)).unwrap();
        let after = opened(&back);
        if *glb == ours {
            assert_eq!(after.positions, before.positions);
            assert_eq!(after.harmonics, before.harmonics);
        }
        for i in 0..3 {
            assert_near(&numbers(&after, i), &numbers(&before, i), "back");
        }
    }
    // Without a stated direction up, nothing is rotated.
    let written = write_splats(&ours, &before, &SplatFileOptions::default()).unwrap();
    assert_eq!(written.turn, DQuat::IDENTITY);
    assert_eq!(opened(&ours).positions, before.positions);
}

#[test]
fn every_format_is_upright() {
    let folder = Folder::new();
    let scene = fixture("scene.ply");
    let glb = folder.path().join("a.glb");
    write_splats(&glb, &opened(&scene), &turned(&scene, None)).unwrap();
    for name in [
        "a.ply",
        "a.compressed.ply",
        "a.splat",
        "a.spz",
        "a.sog",
        "b.glb",
    ] {
        let path = folder.path().join(name);
        write_splats(&path, &opened(&glb), &turned(&glb, None)).unwrap();
        let data = open(&path, &OpenOptions::default()).unwrap();
        let (_, read) = SplatAxes::of_format(data.format).unwrap();
        assert_eq!(data.up().direction, read.up(), "{name}");
        // The highest splat: y is .5 - .25 i downwards in the scene.
        let height = |p: &DVec3| p.dot(data.up().direction);
        let heights: Vec<f64> = opened(&path).positions.iter().map(height).collect();
        let most = heights.iter().copied().fold(f64::MIN, f64::max);
        assert!((most - 0.5).abs() < 1e-5, "{name}: {heights:?}");
    }
    // Meshes beside splats state no direction up, and are not rotated.
    let of = |path: &Path| open(path, &OpenOptions::default()).unwrap().up();
    let mesh = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vase.glb");
    assert_eq!(of(&mesh).direction, of(&glb).direction);
    assert_eq!(
        Up::of_scene([of(&mesh), of(&scene)]).direction,
        DVec3::NEG_Y
    );
}

#[test]
fn options_of_another_format_are_refused() {
    let folder = Folder::new();
    let scene = opened(&fixture("scene.ply"));
    let options = SplatFileOptions {
        spz_version: Some(SpzVersion::Four),
        ..SplatFileOptions::default()
    };
    let path = folder.path().join("a.ply");
    let error = write_splats(&path, &scene, &options)
        .unwrap_err()
        .to_string();
    assert!(error.contains("SPZ") && !path.exists(), "{error}");
}

#[test]
fn compressed_ply_keeps_scenes_within_its_steps() {
    let folder = Folder::new();
    // There are more than two chunks, in an order other than that of the curve.
    let mut splats: Vec<Splat> = some_splats(600, 2);
    for (i, splat) in splats.iter_mut().enumerate() {
        let x = i as f64;
        splat.position = [(x * 0.7).sin(), (x * 1.3).cos(), (x * 2.9).sin()];
        splat.scales[1] = 0.25;
        splat.opacity = 0.125 + 0.75 * x / 600.0;
    }
    let before = opened(&folder.file(
        "a.splat.ply",
        &crate::support::splats::splat_ply(crate::support::splats::Ply::Little, "", &splats, &[]),
    ));
    let path = folder.path().join("b.compressed.ply");
    let written = write_splats(&path, &before, &SplatFileOptions::default()).unwrap();
    let after = opened(&path);
    assert_eq!(after.positions.len(), 600);
    // Chunks are smaller than the whole; otherwise the curve would be useless.
    assert!(written.position_quantum < 2.0 / 1023.0, "{written:?}");
    for i in 0..600 {
        // Opacities identify the splats, to half a code.
        let distance = |j: &usize| {
            let apart = before.positions[*j].distance(after.positions[i]);
            apart + f64::from((before.opacities[*j] - after.opacities[i]).abs())
        };
        let j = (0..600)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap();
        let (a, b) = (numbers(&before, j), numbers(&after, i));
        let most = |k: usize| {
            let pairs = a[k].iter().zip(&b[k]);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        // Half a step of each; for rotations half of 2 / (1023 sqrt 2), and its effect on the
        // largest component.
        assert!(most(0) < 0.51 * written.position_quantum, "{}", most(0));
        assert!(most(1) < 0.51 / 255.0 * 1.2, "{}", most(1));
        assert!(most(2) <= 0.5 * 8.0 / 256.0 + 1e-6, "{}", most(2));
        assert!(most(4) < 1e-3, "{}", most(4));
        let dot: f64 = a[5].iter().zip(&b[5]).map(|(a, b)| a * b).sum();
        assert!(dot.abs() > 1.0 - 4e-6, "{dot}");
        let opacity = (before.opacities[j] - after.opacities[i]).abs();
        assert!(opacity < 0.51 / 255.0, "{opacity}");
    }
}

#[test]
fn ksplat_sections_of_two_degrees_are_put_together() {
    let folder = Folder::new();
    let (first, second) = (some_splats(3, 2), some_splats(7, 1));
    for (mode, step, rounding) in [
        (0, 0.0, 1e-6),
        // Steps of positions, eleven bits of half floats, steps of harmonics.
        (1, 8.0 / 32_767.0, 5e-4),
        (2, 8.0 / 32_767.0, 1e-3),
    ] {
        let data = folder.open("a.ksplat", &ksplat(mode, &[&first, &second]));
        assert_eq!(data.format, "KSPLAT splats");
        let cloud = cloud(data);
        assert_eq!((cloud.positions.len(), cloud.harmonics_degree), (10, 2));
        assert_eq!(cloud.rule, SplatRule::Inria);
        for (i, splat) in first.iter().chain(&second).enumerate() {
            let apart = (cloud.positions[i] - DVec3::from(splat.position)).abs();
            assert!(apart.max_element() <= 0.51 * step + 1e-6, "{mode}: {apart}");
            let set = &cloud.harmonics[27 * i..][..27];
            let mut expected: Vec<f64> = splat.harmonics[1..].concat();
            expected.resize(24, 0.0);
            for (a, b) in set[3..].iter().zip(expected) {
                assert!((f64::from(*a) - b).abs() <= rounding, "{mode}: {a}, {b}");
            }
            for (a, b) in cloud.scales[i].iter().zip(&splat.scales) {
                assert!((f64::from(*a) - b).abs() <= rounding, "{mode}: {a}, {b}");
            }
        }
    }
}

#[test]
fn ksplat_headers_are_checked_against_the_bytes() {
    let folder = Folder::new();
    let sound = ksplat(1, &[&some_splats(3, 1)]);
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = sound.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        folder.refuse("a.ksplat", &file)
    };
    for (at, bytes, words) in [
        (1, &[0][..], "version 0.1"),
        (20, &[3], "mode 0, 1 or 2"),
        (16, &[4], "4 splats"),
        (4, &[255; 4], "section headers"),
        (4096, &[255; 4], "section 0"),
        (4096 + 12, &[255; 4], "section 0"),
        (4096 + 20, &[11], "12 bytes each or more"),
        (4096 + 32, &[255; 4], "centres of"),
        (4096 + 32, &[0], "in its buckets"),
        (4096 + 40, &[3], "degree 3"),
    ] {
        let error = changed(at, bytes);
        assert!(error.contains(words), "{error}");
    }
    for len in [1, 4095, 4096, 6144, sound.len() - 2 * 34] {
        let error = folder.refuse("a.ksplat", &sound[..len]);
        assert!(error.contains("bytes from byte"), "{len}: {error}");
    }
}

#[test]
fn packed_gltf_splats_keep_the_axes_of_their_file() {
    let folder = Folder::new();
    for version in [2, 3] {
        let splats = some_splats(3, 3);
        let stream = spz(version, 0, &splats);
        let alone = cloud(folder.open("a.spz", &stream));
        let data = folder.open("a.glb", &glb_packed(&stream));
        assert_eq!(data.up().direction, DVec3::Y);
        let packed = cloud(data);
        for i in 0..3 {
            // The stream has its own y and z, and the node an offset.
            let expected = alone.positions[i] * DVec3::new(1.0, -1.0, -1.0);
            assert_eq!(packed.positions[i], expected + DVec3::new(1.0, 2.0, 3.0));
            let [w, x, y, z] = alone.rotations[i];
            assert_eq!(packed.rotations[i], [w, x, -y, -z]);
            // In degree 1, only the coefficient of x keeps its sign.
            let [a, b] = [&alone, &packed].map(|c| &c.harmonics[48 * i..][..12]);
            let signs = [1.0, -1.0, -1.0, 1.0];
            for (k, sign) in signs.into_iter().enumerate() {
                for c in 3 * k..3 * k + 3 {
                    assert_eq!(a[c] * sign, b[c], "harmonic {k}");
                }
            }
        }
        assert_eq!(packed.scales, alone.scales);
        assert_eq!(packed.opacities, alone.opacities);
    }
    let error = folder.refuse("b.glb", &glb_packed(b"none of these"));
    assert!(error.contains("b.glb"), "{error}");
}
