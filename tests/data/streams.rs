//! Tests files of points as streams: reading in parts gives the same as reading at once.

use std::path::{Path, PathBuf};

use ewa_splat::SceneOptions;
use ewa_splat::io::{Dataset, Geometry, OpenOptions, ParticleType, RowFile, open};
use ewa_splat::prepared::{About, ParticleStream, PointFile, PreparedScene};
use ewa_splat::sample::{KernelOptions, ParticleShape, PurposeOptions, SampleOptions, scene};
use glam::DVec3;

use crate::common::Random;
use crate::support::npy;

/// Returns a structured array of f4 columns, row by row.
fn table(columns: &[&str], rows: usize, mut number: impl FnMut(usize, &str) -> f32) -> Vec<u8> {
    let described: Vec<String> = columns
        .iter()
        .map(|name| format!("('{name}', '<f4')"))
        .collect();
    let header = format!(
        "{{'descr': [{}], 'fortran_order': False, 'shape': ({rows},), }}",
        described.join(", ")
    );
    let numbers = (0..rows).flat_map(|i| columns.iter().map(move |name| (i, *name)));
    let body: Vec<u8> = numbers
        .flat_map(|(i, name)| number(i, name).to_le_bytes())
        .collect();
    npy(1, &header, &body)
}

/// Number of rows, enough for several chunks of a tree and several parts of a file; some rows are
/// not valid particles.
const ROWS: usize = 300_000;

fn written(scene: &PreparedScene, path: &Path) -> Vec<u8> {
    scene.write(path, &About::default()).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn a_stream_of_a_files_points_is_the_scene_of_all_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.npy");
    let tables: [&[&str]; 4] = [
        &["x", "y", "z", "sigma", "mass"],
        &["mass", "radius", "z", "y", "x", "r", "g", "b", "rho"],
        &[
            "x", "y", "z", "vxx", "vxy", "vxz", "vyy", "vyz", "vzz", "opacity",
        ],
        &["x", "y", "z", "h", "extinction", "volume", "t"],
    ];
    for (i, columns) in tables.into_iter().enumerate() {
        let mut random = Random::new(columns.len() as u64);
        let bytes = table(columns, ROWS, |i, name| {
            let number = random.range(0.0, 1.0) as f32;
            match name {
                "x" | "y" if i % 30_011 == 7 => f32::NAN,
                "sigma" | "vxx" | "h" if i % 5_003 == 1 => -1.0,
                "mass" | "opacity" if i % 9_001 == 2 => f32::INFINITY,
                "x" | "y" | "z" => number.powi(3) * 7.0,
                "vxx" | "vyy" | "vzz" => 0.01 + 0.01 * number,
                "vxy" | "vxz" | "vyz" => 0.002 * number,
                "sigma" | "radius" | "h" => 0.01 + 0.1 * number,
                _ => number,
            }
        });
        std::fs::write(&path, bytes).unwrap();
        // Sums of masses, for one of them.
        for for_columns in [false, true].into_iter().take(if i == 0 { 2 } else { 1 }) {
            let options = SampleOptions {
                purpose: PurposeOptions {
                    for_columns,
                    local_models: !for_columns,
                    ..PurposeOptions::default()
                },
                ..SampleOptions::default()
            };
            let scene_options = SceneOptions {
                level_of_detail: !for_columns,
                ..SceneOptions::default()
            };
            let whole = open(&path, &OpenOptions::default()).unwrap();
            let (up, bounds) = (whole.up(), whole.bounds());
            let whole = scene(whole, &options).unwrap();
            let report = whole.report;
            let whole = PreparedScene::new(whole.volumes, &scene_options).unwrap();
            let mut file = PointFile::open(&path, None, &options).unwrap().unwrap();
            assert!(file.len() == ROWS && file.report().is_none());
            let own = PreparedScene::of_stream(&mut file, &scene_options, folder.path()).unwrap();
            assert_eq!(
                written(&own, &folder.path().join("own.arrow")),
                written(&whole, &folder.path().join("whole.arrow")),
                "{columns:?}"
            );
            let found = file.report().unwrap();
            assert_eq!(found.findings, report.findings, "{columns:?}");
            assert!(found.left_out_count() > 0);
            assert_eq!(found.particle_count, report.particle_count);
            assert_eq!((file.up(), file.bounds()), (up, bounds));
            assert_eq!(
                format!("{:?}", own.volumes()),
                format!("{:?}", whole.volumes())
            );
        }
    }
}

#[test]
fn what_depends_on_others_is_no_stream() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.npy");
    let is_stream = |bytes: &[u8], options: &SampleOptions| {
        std::fs::write(&path, bytes).unwrap();
        PointFile::open(&path, None, options).unwrap().is_some()
    };
    let some = |columns: &[&str]| table(columns, 50, |i, _| 1.0 + i as f32);
    let spheres = some(&["x", "y", "z", "sigma", "mass", "t"]);
    let default = SampleOptions::default();
    assert!(is_stream(&spheres, &default));
    // Sizes from neighbours, and functions chosen from all values.
    assert!(!is_stream(&some(&["x", "y", "z", "mass"]), &default));
    assert!(!is_stream(&some(&["x", "y", "z", "sigma"]), &default));
    assert!(!is_stream(&some(&["x", "y", "z", "sigma", "t"]), &default));
    // Scales may be logarithms if any is negative.
    let scales = [
        "x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "mass",
    ];
    assert!(!is_stream(&some(&scales), &default));
    let others = [
        SampleOptions {
            field: Some("t".into()),
            ..default.clone()
        },
        SampleOptions {
            purpose: PurposeOptions {
                normals: true,
                ..default.purpose
            },
            ..default.clone()
        },
        SampleOptions {
            kernels: KernelOptions {
                shepard_passes: 1,
                ..default.kernels
            },
            ..default.clone()
        },
        SampleOptions {
            flatten: Some(3.0),
            ..default.clone()
        },
        SampleOptions {
            kernels: KernelOptions {
                shape: ParticleShape::YuTurk,
                ..default.kernels
            },
            ..default.clone()
        },
    ];
    for options in others {
        assert!(!is_stream(&spheres, &options), "{options:?}");
    }
    let radius = SampleOptions {
        kernels: KernelOptions {
            radius: Some(0.1),
            ..default.kernels
        },
        ..default.clone()
    };
    assert!(is_stream(&some(&["x", "y", "z", "mass"]), &radius));
    // Columns one after another; other formats.
    let turned = npy(
        1,
        "{'descr': '<f4', 'fortran_order': True, 'shape': (2, 5), }",
        &[0; 40],
    );
    assert!(!is_stream(&turned, &radius));
    assert!(!is_stream(b"x,y,z,sigma,mass\n0,0,0,1,1\n", &default));
}

fn positions(data: &Dataset) -> Vec<DVec3> {
    match &data.geometry {
        Geometry::Points { positions } => positions.clone(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn rows_of_a_snapshot_are_those_of_all_its_files() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let files = [
        ("split/snap_010.1.hdf5", None),
        ("split/snap_010.0.hdf5", Some(ParticleType::DarkMatter)),
        ("split/snap_010.hdf5", None),
        ("gadget_old_packed.h5", None),
        ("gadget_types.h5", Some(ParticleType::Stars)),
        ("swift_lossy.h5", None),
    ];
    for (name, particle_type) in files {
        let path = fixtures.join(name);
        let options = OpenOptions {
            particle_type,
            ..OpenOptions::default()
        };
        let whole = open(&path, &options).unwrap();
        let mut file = RowFile::open(&path, particle_type).unwrap().unwrap();
        assert_eq!(file.count(), positions(&whole).len(), "{name}");
        for most in [1, 100] {
            let runs = file.runs(most);
            let parts: Vec<Dataset> = runs
                .iter()
                .map(|run| file.read(run.clone()).unwrap())
                .collect();
            let all: Vec<DVec3> = parts.iter().flat_map(positions).collect();
            assert_eq!(all, positions(&whole), "{name}");
            for field in whole.field_names() {
                let Ok((_, values)) = whole.scalar(field) else {
                    continue;
                };
                let mut i = 0;
                for part in &parts {
                    let own = part.scalar(field).unwrap().1;
                    for k in 0..own.len() {
                        assert_eq!(
                            own.get(k).to_bits(),
                            values.get(i).to_bits(),
                            "{name} {field}"
                        );
                        i += 1;
                    }
                }
            }
        }
    }
    let absent = RowFile::open(
        &fixtures.join("gadget_old.h5"),
        Some(ParticleType::BlackHoles),
    );
    assert!(absent.is_err());
    for other in ["phantom.h5", "wake.xyz"] {
        assert!(
            RowFile::open(&fixtures.join(other), None)
                .unwrap()
                .is_none(),
            "{other}"
        );
    }
}

#[test]
fn rows_are_those_of_the_file_and_damaged_files_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.npy");
    let bytes = table(&["x", "y", "z", "sigma"], 40, |i, name| {
        i as f32 + f32::from(name.as_bytes()[0])
    });
    std::fs::write(&path, &bytes).unwrap();
    let mut file = RowFile::open(&path, None).unwrap().unwrap();
    assert_eq!(file.count(), 40);
    assert_eq!(file.runs(15), [0..15, 15..30, 30..40]);
    let whole = open(&path, &OpenOptions::default()).unwrap();
    let part = file.read(7..19).unwrap();
    assert_eq!(positions(&part), positions(&whole)[7..19]);
    let sigmas = |data: &Dataset| data.scalar("sigma").unwrap().1;
    assert_eq!(sigmas(&part).len(), 12);
    assert_eq!(sigmas(&part).get(3), sigmas(&whole).get(10));
    assert!(file.read(30..41).is_err());
    // Truncated, too long, without rows, an invalid header.
    for (len, word) in [(bytes.len() - 1, "cut off"), (bytes.len() + 3, "cut off")] {
        let mut other = bytes.clone();
        other.resize(len, 0);
        std::fs::write(&path, other).unwrap();
        let error = RowFile::open(&path, None).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
    std::fs::write(&path, &bytes[..40]).unwrap();
    assert!(RowFile::open(&path, None).unwrap().is_none());
    let none = table(&["x", "y", "z", "sigma", "mass"], 0, |_, _| 0.0);
    std::fs::write(&path, none).unwrap();
    let of_none = PointFile::open(&path, None, &SampleOptions::default());
    assert!(of_none.unwrap().is_none());
    // All rows are left out.
    let bad = table(&["x", "y", "z", "sigma", "mass"], 30, |_, _| f32::NAN);
    std::fs::write(&path, bad).unwrap();
    let mut file = PointFile::open(&path, None, &SampleOptions::default())
        .unwrap()
        .unwrap();
    let made = PreparedScene::of_stream(&mut file, &SceneOptions::default(), folder.path());
    let error = made.unwrap_err().to_string();
    assert!(
        error.contains("none") || error.contains("left out"),
        "{error}"
    );
}

/// Column densities of snapshots sum a field without a scale, in one file and in several.
#[test]
fn columns_of_snapshots_are_streams() {
    let folder = tempfile::tempdir().unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let mut paths: Vec<(PathBuf, Option<ParticleType>)> = Vec::new();
    for name in [
        "gadget_old.h5",
        "gadget_old_packed.h5",
        "gadget_big_endian.h5",
        "swift.h5",
    ] {
        paths.push((fixtures.join(name), None));
    }
    paths.push((fixtures.join("split/snap_010.1.hdf5"), None));
    let mut streams = 0;
    for (path, particle_type) in paths {
        let options = SampleOptions {
            purpose: PurposeOptions {
                for_columns: true,
                local_models: false,
                ..PurposeOptions::default()
            },
            ..SampleOptions::default()
        };
        let scene_options = SceneOptions {
            level_of_detail: false,
            ..SceneOptions::default()
        };
        let open_options = OpenOptions {
            particle_type,
            ..OpenOptions::default()
        };
        let Some(mut file) = PointFile::open(&path, particle_type, &options).unwrap() else {
            continue;
        };
        streams += 1;
        let whole = open(&path, &open_options).unwrap();
        let (up, bounds) = (whole.up(), whole.bounds());
        let whole = scene(whole, &options).unwrap();
        let report = whole.report;
        let whole = PreparedScene::new(whole.volumes, &scene_options).unwrap();
        let own = PreparedScene::of_stream(&mut file, &scene_options, folder.path()).unwrap();
        assert_eq!(
            written(&own, &folder.path().join("own.arrow")),
            written(&whole, &folder.path().join("whole.arrow")),
            "{}",
            path.display()
        );
        let found = file.report().unwrap();
        assert_eq!(found.field, report.field);
        assert_eq!(found.unit, report.unit);
        assert_eq!(found.value_range, report.value_range);
        assert_eq!(
            found.unit_distance.to_bits(),
            report.unit_distance.to_bits()
        );
        assert_eq!(file.field(), report.field.as_deref());
        assert_eq!((file.up(), file.bounds()), (up, bounds));
    }
    assert!(streams >= 4, "{streams}");
}
