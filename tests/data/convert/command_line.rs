//! Tests `convert` as a user runs it: what it opens, refuses and turns.

use std::process::{Command, Output};

use ewa_splat::io::SplatCloud;
use glam::DVec3;
use serde_json::Value;

use super::{FORMATS, Folder, cloud_of, some_cloud};

fn run(folder: &Folder, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ewa-splat"))
        .args(arguments)
        .current_dir(folder.0.path())
        .output()
        .unwrap()
}

fn words(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn converts_anything_that_opens() {
    let folder = Folder::new();
    let wake = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/wake.xyz");
    let transfer = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/wake_transfer.json");
    for extension in FORMATS {
        let out = format!("wake.{extension}");
        let arguments = [
            "convert",
            wake,
            "--transfer-function",
            transfer,
            "--out",
            &out,
        ];
        let output = run(&folder, &arguments);
        assert!(output.status.success(), "{}", words(&output.stderr));
        let text = words(&output.stdout);
        assert!(
            text.contains("transparent") && text.contains("position quantum"),
            "{text}"
        );
        let output = run(&folder, &[&arguments[..], &["--json"]].concat());
        let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
        let cloud = cloud_of(folder.read(&out));
        assert_eq!(summary["splats"], cloud.positions.len());
        assert_eq!(
            summary["bytes"],
            std::fs::metadata(folder.path(&out)).unwrap().len()
        );
        // Nodes without those that coincide on the O-grid's seam.
        assert_eq!(summary["particles"], 20_988);
        let left_out = summary["left_out"][0]["count"].as_u64().unwrap();
        assert_eq!(left_out as usize + cloud.positions.len(), 20_988);
    }
    // Several inputs become one output, and splats stay unchanged.
    let output = run(
        &folder,
        &[
            "convert", "wake.ply", "wake.glb", "--out", "two.ply", "--json",
        ],
    );
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    let one = cloud_of(folder.read("wake.ply")).positions.len();
    assert_eq!(summary["splats"], 2 * one);
}

/// The summary says what each format loses: half a step at most, as tables of the formats have it.
#[test]
fn the_summary_says_what_was_lost() {
    let folder = Folder::new();
    let mut cloud = some_cloud(400, 1, 5);
    // Codes within 0 to 1, and harmonics within every format's range.
    for (k, c) in cloud.harmonics.iter_mut().enumerate() {
        *c = if k % 12 < 3 {
            c.clamp(-1.5, 1.5)
        } else {
            c.clamp(-0.9, 0.9)
        };
    }
    folder.write("ply", &cloud);
    let given = cloud_of(folder.read("a.ply"));
    for (extension, [position, opacity, colour, harmonics], decibels) in [
        // The logarithm and the logit are rounded, and the picture barely changes.
        ("ply", [0.0, 1e-6, 1e-6, 1e-6], 90.0),
        ("glb", [0.0, 1e-6, 1e-6, 1e-6], 90.0),
        ("csv", [0.0, 1e-6, 1e-6, 1e-6], 90.0),
        (
            "splat",
            [0.0, 0.51 / 255.0, 0.51 / 255.0, f64::INFINITY],
            25.0,
        ),
        (
            "spz",
            [
                1e-3,
                0.51 / 255.0,
                0.51 / 255.0 / 0.15 * 0.283,
                0.51 / 128.0,
            ],
            30.0,
        ),
        (
            "compressed.ply",
            [2e-2, 0.51 / 255.0, 0.51 / 255.0 * 2.0, 0.51 / 32.0],
            30.0,
        ),
        ("sog", [1e-3, 0.51 / 255.0, 0.05, 0.01], 30.0),
    ] {
        let out = format!("lost.{extension}");
        let output = run(
            &folder,
            &["convert", "a.ply", "--out", &out, "--json", "--keep-axes"],
        );
        let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
        let of = |key: &str, kind: &str| summary["certificate"][key][kind].as_f64().unwrap();
        for (key, most) in [
            ("position", position),
            ("opacity", opacity),
            ("colour", colour),
            ("harmonics", harmonics),
        ] {
            let [rms, greatest] = ["rms", "greatest"].map(|kind| of(key, kind));
            assert!(
                greatest <= most + 1e-6,
                "{extension} {key}: {greatest} above {most}"
            );
            assert!(
                rms <= greatest * (1.0 + 1e-12),
                "{extension} {key}: {rms} {greatest}"
            );
        }
        assert!(of("shape", "greatest") < 0.1, "{extension}: {summary}");
        let psnr = summary["certificate"]["pictures"]["psnr"].as_f64();
        assert_eq!(summary["certificate"]["pictures"]["splats"], 400);
        assert!(
            psnr.is_none_or(|psnr| psnr > decibels),
            "{extension}: {psnr:?}"
        );
        // Opacities are those that this test finds, too: the file's order is known.
        let found = cloud_of(folder.read(&out));
        let mut sorted = [&given, &found].map(|cloud| cloud.opacities.clone());
        sorted
            .iter_mut()
            .for_each(|all| all.sort_by(f32::total_cmp));
        let apart = sorted[0]
            .iter()
            .zip(&sorted[1])
            .map(|(a, b)| f64::from(a - b).abs());
        let apart = apart.fold(0.0, f64::max);
        assert!(apart <= of("opacity", "greatest") + 1e-7, "{extension}");
        if extension == "splat" {
            // All harmonics are lost.
            let harmonics = |cloud: &SplatCloud| -> f64 {
                let rest = cloud
                    .harmonics
                    .iter()
                    .enumerate()
                    .filter(|(k, _)| k % 12 >= 3);
                let squares: f64 = rest.map(|(_, c)| f64::from(*c).powi(2)).sum();
                (squares / (9 * cloud.positions.len()) as f64).sqrt()
            };
            assert!((of("harmonics", "rms") - harmonics(&given)).abs() < 1e-6);
        }
        let output = run(&folder, &["convert", "a.ply", "--out", &out]);
        let text = words(&output.stdout);
        assert!(
            text.contains("read back") && text.contains("rms differences"),
            "{extension}: {text}"
        );
    }
    // VTK's vertices are not read as splats.
    let output = run(
        &folder,
        &["convert", "a.ply", "--out", "lost.vtu", "--json"],
    );
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["certificate"], Value::Null);
}

#[test]
fn bad_usage_is_told_in_one_line() {
    let folder = Folder::new();
    folder.write("ply", &some_cloud(3, 0, 1));
    for (arguments, expected) in [
        (
            &["a.ply", "--out", "b.obj"][..],
            ".ply, .splat, .ksplat, .spz, .sog, .glb, .gltf, .usda, .usdc, .usdz, .csv or .vtu, or meta.json",
        ),
        (
            &["a.ply", "--out", "b"],
            ".ply, .splat, .ksplat, .spz, .sog, .glb, .gltf, .usda, .usdc, .usdz, .csv or .vtu, or meta.json",
        ),
        (&["a.ply", "--out", "none/b.ply"], "folder"),
        (&["a.ply", "--out", "a.ply"], "an input"),
        (&["b.ply", "--out", "c.ply"], "opening"),
        (&["a.ply", "--out", "c.ply", "--surfels"], "flat splat"),
        (&["a.ply", "--out", "c.ply", "--spacing", "1,2,3"], "--dims"),
        (
            &[
                "a.ply",
                "--out",
                "c.ply",
                "--spacing",
                "1",
                "--density",
                "2",
            ],
            "leave one",
        ),
    ] {
        let output = run(&folder, &[&["convert"], arguments].concat());
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        let text = words(&output.stderr);
        assert!(
            text.contains(expected) && text.lines().count() == 1,
            "{text}"
        );
    }
    let names: Vec<_> = std::fs::read_dir(folder.0.path()).unwrap().collect();
    assert_eq!(names.len(), 1, "{names:?}");
    let output = run(&folder, &["convert", "a.ply"]);
    assert_eq!(output.status.code(), Some(2));
    // One number gives a raw volume even spacing.
    std::fs::write(folder.path("v.raw"), [0_u8, 255, 9, 200, 0, 255, 3, 80]).unwrap();
    let arguments = [
        "convert",
        "v.raw",
        "--dims",
        "2,2,2",
        "--spacing",
        "3",
        "--out",
        "v.ply",
        "--transfer-function",
        "grayscale",
    ];
    let output = run(&folder, &arguments);
    assert!(output.status.success(), "{}", words(&output.stderr));
    let cloud = cloud_of(folder.read("v.ply"));
    // z, which is up in volumes, becomes -y.
    let of_volume = cloud.positions.iter().flat_map(|p| [p.x, -p.y, p.z]);
    assert!(of_volume.into_iter().all(|x| x == 0.0 || x == 3.0));
}

#[test]
fn what_is_up_is_turned_to_where_the_format_has_it() {
    let folder = Folder::new();
    folder.write("ply", &some_cloud(9, 2, 3));
    let before = cloud_of(folder.read("a.ply"));
    let convert = |arguments: &[&str]| {
        let output = run(&folder, &[&["convert"], arguments].concat());
        assert!(output.status.success(), "{}", words(&output.stderr));
        words(&output.stderr)
    };
    let said = convert(&["a.ply", "--out", "a.glb"]);
    assert!(
        said.contains("lie along -x, -y, +z") && said.contains("--keep-axes"),
        "{said}"
    );
    let half_turn = |p: &DVec3| DVec3::new(-p.x, -p.y, p.z);
    let turned: Vec<DVec3> = before.positions.iter().map(half_turn).collect();
    assert_eq!(cloud_of(folder.read("a.glb")).positions, turned);
    let said = convert(&["a.glb", "--out", "b.ply"]);
    assert!(said.contains("glTF has y up"), "{said}");
    let after = cloud_of(folder.read("b.ply"));
    assert_eq!(after.positions, before.positions);
    assert_eq!(after.harmonics, before.harmonics);
    // No note is printed if nothing is rotated.
    for arguments in [
        &["a.ply", "--out", "b.ply"][..],
        &["a.ply", "--out", "b.spz"],
        &["a.glb", "--out", "b.glb"],
        &["a.ply", "--out", "b.glb", "--keep-axes"],
        &["a.glb", "--out", "b.ply", "--keep-axes"],
    ] {
        assert_eq!(convert(arguments), "", "{arguments:?}");
    }
    assert_eq!(cloud_of(folder.read("b.glb")).positions, before.positions);
    assert_eq!(cloud_of(folder.read("b.ply")).positions, turned);
    // Inputs of different axes are not rotated relative to each other, and a note reports it.
    let said = convert(&["a.ply", "a.glb", "--out", "b.ply"]);
    assert!(said.contains("a.glb: +y is up"), "{said}");
    let both = cloud_of(folder.read("b.ply"));
    assert_eq!(both.positions, [before.positions.clone(), turned].concat());
    let vase = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/vase.glb");
    let said = convert(&[vase, "--count", "200", "--out", "vase.ply"]);
    assert!(said.contains("vase.ply: turned, +y is up"), "{said}");
    let output = run(&folder, &["info", "b.spz"]);
    let text = words(&output.stdout);
    assert!(text.contains("x right, y up, z back; turned"), "{text}");
}
