//! Tests written SOG scenes: this library and an external ZIP reader find the original splats,
//! within the format's steps. `splat_axes` tests what PlayCanvas's program reads in one.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::io::Read;
use std::path::Path;

use ewa_splat::io::{
    Geometry, OpenOptions, SplatCloud, SplatFileOptions, WrittenSplats, open, write_splats,
};
use ewa_splat::math::harmonics_count;
use ewa_splat::scene::SplatRule;
use glam::DVec3;

use crate::common::Random;
use crate::support::Folder;

/// Returns random splats whose harmonics lie around a few sets.
fn some_cloud(count: usize, degree: u8) -> SplatCloud {
    let mut random = Random::new(5);
    let mut number = move |least: f64, most: f64| random.range(least, most);
    let stride = 3 * harmonics_count(degree);
    let sets: Vec<f32> = (0..40 * stride).map(|_| number(-0.5, 0.5) as f32).collect();
    let mut cloud = SplatCloud {
        harmonics_degree: degree,
        rule: SplatRule::Mip,
        ..SplatCloud::default()
    };
    for i in 0..count {
        let position = [0, 1, 2].map(|_| number(-1.0, 1.0) * number(0.0, 3.0).exp());
        cloud.positions.push(DVec3::from(position));
        cloud
            .scales
            .push([0, 1, 2].map(|_| number(-7.0, -2.0).exp() as f32));
        cloud
            .rotations
            .push([0, 1, 2, 3].map(|_| number(-1.0, 1.0) as f32));
        cloud.opacities.push(number(0.01, 1.0) as f32);
        let set = &sets[i % 40 * stride..][..stride];
        let moved = set.iter().map(|x| x + number(-0.02, 0.02) as f32);
        cloud.harmonics.extend(moved);
    }
    cloud
}

fn written(path: &Path, cloud: &SplatCloud) -> (WrittenSplats, SplatCloud) {
    let written = write_splats(path, cloud, &SplatFileOptions::default()).unwrap();
    let data = open(path, &OpenOptions::default()).unwrap();
    assert!(data.notes.is_empty(), "{:?}", data.notes);
    let Geometry::Splats(after) = data.geometry else {
        panic!("no splats")
    };
    (written, after)
}

/// Returns for each splat read the index of the original, by position.
fn order(before: &SplatCloud, after: &SplatCloud) -> Vec<usize> {
    let distance = |i: &usize, p: &DVec3| before.positions[*i].distance_squared(*p);
    let nearest = |p: &DVec3| {
        let all = 0..before.positions.len();
        all.min_by(|a, b| distance(a, p).total_cmp(&distance(b, p)))
            .unwrap()
    };
    let order: Vec<usize> = after.positions.iter().map(nearest).collect();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, (0..before.positions.len()).collect::<Vec<_>>());
    order
}

/// Returns the root mean square and the greatest of differences.
fn errors(pairs: impl Iterator<Item = (f32, f32)>) -> [f64; 2] {
    let all: Vec<f64> = pairs.map(|(a, b)| f64::from(a - b).abs()).collect();
    let squares: f64 = all.iter().map(|e| e * e).sum();
    let most = all.iter().copied().fold(0.0, f64::max);
    [(squares / all.len() as f64).sqrt(), most]
}

/// A folder holds the members of the archive.
#[test]
fn scenes_are_written_as_folders_too() {
    let folder = Folder::new();
    let cloud = some_cloud(500, 2);
    let (_, packed) = written(&folder.path().join("a.sog"), &cloud);
    let (in_folder, plain) = written(&folder.path().join("meta.json"), &cloud);
    assert_eq!(plain.positions, packed.positions);
    assert_eq!(plain.harmonics, packed.harmonics);
    let entries = std::fs::read_dir(folder.path()).unwrap();
    let sizes = entries.map(|entry| entry.unwrap()).map(|entry| {
        let is_archive = entry.file_name() == "a.sog";
        if is_archive {
            0
        } else {
            entry.metadata().unwrap().len()
        }
    });
    assert_eq!(sizes.sum::<u64>(), in_folder.bytes as u64);
    let error = write_splats(
        &folder.path().join("b.json"),
        &cloud,
        &SplatFileOptions::default(),
    );
    assert!(error.unwrap_err().to_string().contains("meta.json"));
}

#[test]
fn scenes_come_back_within_the_steps_of_the_format() {
    let folder = Folder::new();
    for degree in 0..4 {
        let cloud = some_cloud(3000, degree);
        let (written, after) = written(&folder.path().join("a.sog"), &cloud);
        assert_eq!(
            (after.harmonics_degree, after.rule),
            (degree, SplatRule::Mip)
        );
        // Logarithms up to ln 21, of either sign, in 65,535 steps, times 21.
        let quantum = written.position_quantum;
        assert!((1e-3..2.1e-3).contains(&quantum), "{quantum}");
        let stride = cloud.harmonics_stride();
        let order = order(&cloud, &after);
        let pairs = || order.iter().copied().enumerate();
        for (i, k) in pairs() {
            let apart = (after.positions[i] - cloud.positions[k]).abs();
            assert!(apart.max_element() <= 0.51 * quantum, "{apart}");
            let [a, b] = [after.rotations[i], cloud.rotations[k]].map(|q| {
                let length = q.iter().map(|c| c * c).sum::<f32>().sqrt();
                q.map(|c| c / length)
            });
            let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            // Half of 1 / (127.5 sqrt 2) in three components, and its effect on the largest.
            assert!(dot.abs() > 1.0 - 6e-5, "{dot}");
            let opacity = (after.opacities[i] - cloud.opacities[k]).abs();
            assert!(opacity <= 0.501 / 255.0, "{opacity}");
        }
        let logarithms = errors(pairs().flat_map(|(i, k)| {
            [0, 1, 2].map(|c| (after.scales[i][c].ln(), cloud.scales[k][c].ln()))
        }));
        // Numbers spread evenly from -7 to -2: steps of 5 / 256, off by 1 / sqrt 12 of one, or
        // half.
        assert!(
            logarithms[0] < 1.02 * 5.0 / 256.0 / 12_f64.sqrt(),
            "{logarithms:?}"
        );
        assert!(logarithms[1] < 5.0 / 256.0, "{logarithms:?}");
        let coefficients = |of: std::ops::Range<usize>| {
            let own = |c: &SplatCloud, i: usize| c.harmonics[i * stride..][of.clone()].to_vec();
            errors(pairs().flat_map(|(i, k)| own(&after, i).into_iter().zip(own(&cloud, k))))
        };
        // They lie in 120 ranges of .04.
        let constant = coefficients(0..3);
        assert!(constant[0] < 1.1e-3 && constant[1] < 6e-3, "{constant:?}");
        if degree > 0 {
            // 3000 sets, each off one of the 40 by .02 / sqrt 3 = .0115, become 2048. A third
            // shares the entry of another and is off by at most .0115 in the root mean square.
            let rest = coefficients(3..stride);
            assert!(rest[0] < 0.009 && rest[1] < 0.045, "{rest:?}");
            assert!(
                written
                    .notes
                    .iter()
                    .any(|n| n.contains("are those of 2048"))
            );
        }
    }
}

#[test]
fn few_splats_keep_their_harmonics() {
    let folder = Folder::new();
    let mut cloud = some_cloud(50, 2);
    // The numbers fit 256 levels: the palette has an entry for each.
    for x in &mut cloud.harmonics {
        *x = (*x * 100.0).round() / 100.0;
    }
    let (_, after) = written(&folder.path().join("a.sog"), &cloud);
    let stride = cloud.harmonics_stride();
    for (i, k) in order(&cloud, &after).into_iter().enumerate() {
        let [a, b] = [(&after, i), (&cloud, k)].map(|(c, i)| &c.harmonics[i * stride..][..stride]);
        assert_eq!(a, b);
    }
}

#[test]
fn archives_are_the_same_each_time_and_sound_to_others() {
    let folder = Folder::new();
    let cloud = some_cloud(2500, 1);
    let read = |name: &str| {
        let path = folder.path().join(name);
        write_splats(&path, &cloud, &SplatFileOptions::default()).unwrap();
        std::fs::read(path).unwrap()
    };
    let bytes = read("a.sog");
    assert!(bytes == read("b.sog"), "two archives of one scene differ");
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    for name in [
        "meta.json",
        "means_l.webp",
        "means_u.webp",
        "quats.webp",
        "scales.webp",
        "sh0.webp",
        "shN_centroids.webp",
        "shN_labels.webp",
    ] {
        assert!(archive.by_name(name).is_ok(), "{name}");
    }
    let mut text = String::new();
    let mut meta = archive.by_name("meta.json").unwrap();
    meta.read_to_string(&mut text).unwrap();
    let meta: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (&meta["version"], &meta["count"]),
        (&2.into(), &2500.into())
    );
    assert_eq!(meta["shN"]["bands"], 1);
    for of in ["scales", "sh0", "shN"] {
        let levels = meta[of]["codebook"].as_array().unwrap();
        let levels: Vec<f64> = levels.iter().map(|x| x.as_f64().unwrap()).collect();
        assert_eq!(levels.len(), 256);
        assert!(levels.is_sorted(), "{of}");
    }
}

/// Scenes in which all splats share one palette or codebook entry.
#[test]
fn scenes_of_one_splat_and_of_equal_ones_are_written() {
    let folder = Folder::new();
    for count in [1, 3000] {
        let mut cloud = some_cloud(1, 3);
        let one = cloud.clone();
        for _ in 1..count {
            cloud.append(one.clone());
        }
        let (_, after) = written(&folder.path().join("a.sog"), &cloud);
        assert_eq!(after.positions.len(), count);
        assert!(
            after
                .positions
                .iter()
                .all(|p| p.distance(one.positions[0]) < 1e-9)
        );
        let same = after.harmonics.chunks(48).all(|set| set == one.harmonics);
        assert!(same);
    }
}
