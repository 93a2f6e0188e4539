//! Tests `convert` as a user runs it: what it opens, refuses and turns.

use std::process::{Command, Output};

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

#[test]
fn bad_usage_is_told_in_one_line() {
    let folder = Folder::new();
    folder.write("ply", &some_cloud(3, 0, 1));
    for (arguments, expected) in [
        (
            &["a.ply", "--out", "b.obj"][..],
            ".ply, .splat, .spz, .sog, .glb or .vtu",
        ),
        (
            &["a.ply", "--out", "b"],
            ".ply, .splat, .spz, .sog, .glb or .vtu",
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
