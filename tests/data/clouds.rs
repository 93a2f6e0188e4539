//! Tests point clouds: files of other programs give the numbers that those programs read.
//!
//! Fixtures: LAS by laspy, E57 by pye57, PCD by pypcd4 except `cloud_ascii.pcd`.

use std::path::Path;

use ewa_splat::io::{Dataset, Geometry, OpenOptions, open};
use ewa_splat::sample::{PurposeOptions, SampleOptions, volume};
use ewa_splat::scene::{Colour, Strength};
use glam::DVec3;

use crate::support::Folder;

fn fixture(name: &str) -> Dataset {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name);
    open(&path, &OpenOptions::default()).unwrap()
}

fn positions(data: &Dataset) -> &[DVec3] {
    match &data.geometry {
        Geometry::Points { positions } => positions,
        _ => panic!("no points"),
    }
}

/// Returns one row of columns.
fn row(data: &Dataset, names: &[&str], i: usize) -> Vec<f32> {
    let value = |name: &&str| data.scalar(name).unwrap().1.get(i);
    names.iter().map(value).collect()
}

fn is_near(a: DVec3, b: [f64; 3]) -> bool {
    (a - DVec3::from_array(b)).length() < 1e-6
}

/// Returns a point on a sphere of radius 1, as in the fixtures.
fn on_sphere(i: usize, count: usize) -> DVec3 {
    let i = i as f64 + 0.5;
    let t = (1.0 - 2.0 * i / count as f64).acos();
    let p = std::f64::consts::PI * (1.0 + 5_f64.sqrt()) * i;
    DVec3::new(p.cos() * t.sin(), p.sin() * t.sin(), t.cos())
}

#[test]
fn las_points_are_those_of_laspy() {
    let data = fixture("cloud_8.las");
    let at = positions(&data);
    assert_eq!(at.len(), 60);
    assert!(is_near(at[0], [431_000.632, 5_799_999.912, 101.967]));
    assert!(is_near(at[17], [430_999.772, 5_800_001.916, 100.833]));
    assert!(is_near(at[59], [431_000.448, 5_800_000.61, 98.033]));
    let names = [
        "intensity",
        "classification",
        "return_number",
        "number_of_returns",
        "infrared",
        "gps_time",
        "height",
        "scaled",
    ];
    let wanted = [1700.0, 4.0, 3.0, 3.0, 119.0, 2.125, 4.25, 18.5];
    assert_eq!(row(&data, &names, 17), wanted);
    // 70 steps of .006 degrees.
    assert!((row(&data, &["scan_angle"], 17)[0] - 0.42).abs() < 1e-6);
    // 20817, 60138, 46517 of 65535.
    assert_eq!(
        row(&data, &["red", "green", "blue"], 17),
        [81.0, 234.0, 181.0]
    );
}

#[test]
fn scans_without_colours_show_intensities() {
    let shown = |name: &str| {
        let sampled = volume(fixture(name), &SampleOptions::default()).unwrap();
        (sampled.report.field, sampled.volume.values.is_some())
    };
    assert_eq!(shown("cloud_0.las"), (Some("intensity".into()), true));
    // Colours are shown unchanged.
    assert_eq!(shown("cloud_3.las"), (None, false));
    // A column density counts points.
    let options = SampleOptions {
        purpose: PurposeOptions {
            for_columns: true,
            ..PurposeOptions::default()
        },
        ..SampleOptions::default()
    };
    let counted = volume(fixture("cloud_0.las"), &options).unwrap();
    assert_eq!(counted.report.field.as_deref(), Some("number density"));
}

#[test]
fn las_points_that_are_withheld_are_left_out() {
    let data = fixture("cloud_3.las");
    assert_eq!(positions(&data).len(), 59);
    assert!(
        data.notes
            .concat()
            .contains("1 points that are flagged as withheld")
    );
    // The sixth row is gone: the former 18th is the 17th, in all columns.
    assert!(is_near(
        positions(&data)[16],
        [430_999.772, 5_800_001.916, 100.833]
    ));
    assert_eq!(
        row(&data, &["red", "scaled", "intensity"], 16),
        [81.0, 18.5, 1700.0]
    );
    let old = fixture("cloud_0.las");
    assert_eq!(row(&old, &["scan_angle"], 3), [-27.0]);
    assert!(!old.field_names().contains(&"red"));
    assert_eq!(row(&fixture("cloud_1.las"), &["gps_time"], 59), [7.375]);
}

#[test]
fn las_headers_that_promise_too_much_are_refused() {
    let folder = Folder::new();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cloud_0.las");
    let sound = std::fs::read(path).unwrap();
    let mut packed = sound.clone();
    packed[104] |= 0x80;
    let refused = folder.refuse("a.laz", &packed);
    assert!(refused.contains("las2las -i") && refused.contains("laspy decompress"));
    let mut many = sound.clone();
    many[107..111].copy_from_slice(&[255; 4]);
    assert!(folder.refuse("a.las", &many).contains("60 points"));
    let mut thin = sound;
    thin[105] = 19;
    assert!(folder.refuse("a.las", &thin).contains("at least 20 bytes"));
}

#[cfg(feature = "e57")]
#[test]
fn e57_scans_lie_where_their_poses_put_them() {
    let data = fixture("cloud.e57");
    let at = positions(&data);
    assert_eq!(at.len(), 60);
    // The positions are those that pye57 computes.
    assert!(is_near(
        at[0],
        [0.211_320_097, 0.855_433_846, 2.966_666_639]
    ));
    assert!(is_near(at[7], [0.104_503_152, 1.859_697_091, 2.5]));
    assert!(is_near(at[37], [10.104_503_152, 1.859_697_091, 2.5]));
    let names = ["intensity", "red", "green", "blue", "scan"];
    assert_eq!(row(&data, &names, 0), [0.0, 139.0, 0.0, 200.0, 0.0]);
    assert_eq!(row(&data, &names, 37), [14.0, 200.0, 7.0, 200.0, 1.0]);
}

#[test]
fn pcd_points_are_the_same_in_all_forms() {
    for name in ["cloud_binary.pcd", "cloud_packed.pcd"] {
        let data = fixture(name);
        let at = positions(&data);
        assert_eq!(at.len(), 40, "{name}");
        assert!((at[33] - on_sphere(33, 40)).length() < 1e-6, "{name}");
        let names = ["intensity", "red", "green", "blue"];
        assert_eq!(row(&data, &names, 0), [0.0, 136.0, 106.0, 253.0], "{name}");
        assert_eq!(
            row(&data, &names, 33),
            [16.5, 163.0, 249.0, 113.0],
            "{name}"
        );
    }
    let data = fixture("cloud_ascii.pcd");
    let at = positions(&data);
    assert!((at[7] - 2.0 * on_sphere(7, 40)).length() < 1e-6);
    assert!(at[3].is_nan());
    let names = ["red", "green", "blue", "hist:x", "hist:y"];
    assert_eq!(row(&data, &names, 7), [42.0, 10.0, 248.0, -7.0, 49.0]);
    assert!((row(&data, &["normal_z"], 39)[0] - -0.975).abs() < 1e-6);
    assert!(data.notes[0].contains("viewpoint"));
}

#[test]
fn columns_of_text_are_known_by_their_numbers() {
    let folder = Folder::new();
    let names = |text: &str| {
        let data = folder.open("a.xyz", text.as_bytes());
        data.field_names().join(" ")
    };
    assert_eq!(names("0.5 1 2\n3 4 5\n"), "");
    assert_eq!(names("# x y z\n0.5,1,2,-7\n3,4,5,9\n"), "intensity");
    assert_eq!(names("0.5 1 2 0 128 255\n3 4 5 9 9 9\n"), "red green blue");
    assert_eq!(names("0.5 1 2 0 .6 .8\n3 4 5 -1 0 0\n"), "nx ny nz");
    assert_eq!(
        names("0.5 1 2 7 0 128 255\n3 4 5 90 9 9 9\n"),
        "intensity red green blue"
    );
    assert_eq!(
        names("0.5 1 2 0 0 1 0 128 255\n3 4 5 0 1 0 9 9 9\n"),
        "nx ny nz red green blue"
    );
    let data = folder.open("a.pts", b"2\n1.5 2 3 -312 128 90 77\n4 5 6 9 1 2 3\n");
    assert_eq!(positions(&data)[1], DVec3::new(4.0, 5.0, 6.0));
    let names = ["intensity", "red", "green", "blue"];
    assert_eq!(row(&data, &names, 0), [-312.0, 128.0, 90.0, 77.0]);
    // Colours from 0 to 1 are encoded, too.
    let data = folder.open("b.txt", b"1.5 2 3 .5 .2 .2\n4 5 6 .25 .2 .2\n");
    assert!((row(&data, &["r"], 0)[0] - 0.214_041).abs() < 1e-5);

    let said = folder.refuse("c.pts", b"3\n1.5 2 3\n4 5 6\n");
    assert!(said.contains("2 lines"), "{said}");
    let said = folder.refuse("c.pts", b"1.5 2 3\n4 5\n");
    assert!(said.contains("line 2"), "{said}");
}

#[test]
fn text_grids_of_plot3d_stay_grids() {
    let folder = Folder::new();
    let mut grid = "2 2 2\n".to_owned();
    for axis in 0..3 {
        for i in 0..8 {
            grid += &format!("{} ", i >> axis & 1);
        }
        grid += "\n";
    }
    let data = folder.open("a.xyz", grid.as_bytes());
    assert!(matches!(data.geometry, Geometry::Curvilinear { .. }));
    // Every line has three numbers, as in a cloud.
    let rows: Vec<&str> = grid.split_whitespace().collect();
    let lines: Vec<String> = rows.chunks(3).map(|row| row.join(" ")).collect();
    let data = folder.open("b.xyz", lines.join("\n").as_bytes());
    assert!(matches!(data.geometry, Geometry::Curvilinear { .. }));
    let data = folder.open("c.xyz", b"2 2 2\n1 2 3\n4 5 6\n");
    assert_eq!(positions(&data).len(), 3);
}

#[test]
fn points_with_colours_and_no_more_are_opaque() {
    let text: String = (0..400)
        .map(|i| format!("{}.5 {} 0 {} 200 90\n", i % 20, i / 20, i % 256))
        .collect();
    let data = Folder::new().open("a.xyz", text.as_bytes());
    let sampled = volume(data, &SampleOptions::default()).unwrap();
    assert!(matches!(sampled.volume.colour, Colour::PerParticle(_)));
    assert!(matches!(sampled.volume.strength, Strength::Mass(_)));
}
