//! Tests the overlays of `render`: their positions, and refusals.

use std::path::Path;

use ewa_splat::Image;
use ewa_splat::io::read_image;

use crate::commands::{files, fixture, run, text};

const SIZE: [usize; 2] = [240, 200];

/// Draws particles with options into a file, and reads it.
fn drawn(folder: &Path, out: &str, options: &[&str]) -> Image {
    let particles = fixture("particles.csv");
    let own = ["render", &particles, "--size", "240x200", "--out", out];
    let made = run(folder, &[&own, options].concat());
    assert!(made.status.success(), "{options:?}: {}", text(&made.stderr));
    read_image(&folder.join(out)).unwrap()
}

/// Returns the first and the last column and row that differ.
fn changed(a: &Image, b: &Image) -> [usize; 4] {
    let mut corners = [usize::MAX, usize::MAX, 0, 0];
    for (i, _) in (a.pixels.iter().zip(&b.pixels).enumerate()).filter(|(_, (a, b))| a != b) {
        let (x, y) = (i % SIZE[0], i / SIZE[0]);
        corners = [
            corners[0].min(x),
            corners[1].min(y),
            corners[2].max(x),
            corners[3].max(y),
        ];
    }
    corners
}

#[test]
fn annotations_lie_in_their_corners() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let plain = drawn(folder, "a.npy", &[]);
    let of = |options: &[&str]| changed(&plain, &drawn(folder, "b.npy", options));
    // Columns and rows: the first two, the last two. Text is 16 pixels high.
    let [left, top, right, bottom] = of(&["--title", "Knot"]);
    assert!(left == 8 && top == 8 && right < 60 && bottom < 36);
    let title = "A long title that no picture of this size has room for";
    let [left, _, right, bottom] = of(&["--title", title]);
    assert!(left == 8 && right > 215 && right < 232 && bottom < 36);
    let [left, top, right, bottom] = of(&["--axes"]);
    assert!(left >= 8 && top > 90 && right < 110 && bottom < 192);
    let [left, top, right, bottom] = of(&["--time-stamp", "t = 4"]);
    assert!(left == 8 && top > 160 && right < 80 && bottom == 191);
    let [left, top, right, bottom] = of(&["--scale-bar"]);
    assert!(left > 150 && top > 140 && right == 231 && bottom == 191);
    // The box is as large as the data, whose kernels the fitted camera shows up to the rims.
    let [left, top, right, bottom] = of(&["--outline"]);
    assert!(left < 60 && top < 60 && right > 180 && bottom > 140);
    // A legend has its own columns.
    let annotated = ["--column-density", "--title", title];
    let plain = drawn(folder, "c.png", &[&annotated[..], &["--legend"]].concat());
    let other = ["--column-density", "--legend", "--title", "Short"];
    let [_, _, right, bottom] = changed(&plain, &drawn(folder, "d.png", &other));
    assert!(
        (40..160).contains(&right) && bottom < 36,
        "{right} {bottom}"
    );
}

/// The outline is drawn whole, whatever part of the data is visible.
#[test]
fn an_outline_is_seen_whole() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let is_core = |i: &usize| {
        [i % 12, i / 12 % 12, i / 144]
            .iter()
            .all(|x| (5..7).contains(x))
    };
    let bytes: Vec<u8> = (0..1728)
        .map(|i| if is_core(&i) { 200 } else { 0 })
        .collect();
    std::fs::write(folder.join("core.raw"), bytes).unwrap();
    let line = "render core.raw --dims 12,12,12 --size 120x100 --backend cpu --background none --outline --out a.npy";
    let words: Vec<&str> = line.split(' ').collect();
    let output = run(folder, &words);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let image = read_image(&folder.join("a.npy")).unwrap();
    let shown = |x: usize, y: usize| image.pixel(x, y)[3] > 0.05;
    let at_edges = (0..120).any(|x| shown(x, 0) || shown(x, 99));
    let at_sides = (0..100).any(|y| shown(0, y) || shown(119, y));
    assert!(!at_edges && !at_sides);
    let rows = (0..100).filter(|&y| (0..120).any(|x| shown(x, y)));
    assert!(rows.count() > 80);
}

#[test]
fn annotations_are_of_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let particles = fixture("particles.csv");
    for (options, says) in [
        (
            &["--column-density", "--out", "a.npy", "--axes"][..],
            "--axes: --column-density: expected a png",
        ),
        (
            &["--show", "count", "--out", "a.png", "--title", "n"],
            "--title: --show: expected scene or choice",
        ),
        (
            &["--size", "40x40", "--out", "a.png", "--axes"],
            "pixels at least, found 40 x 40",
        ),
        (
            &[
                "--out",
                "a.png",
                "--scale-bar",
                "--eye",
                "0,90,0",
                "--target",
                "0,99,0",
            ],
            "in front of the eye",
        ),
    ] {
        let refused = run(folder.path(), &[&["render", &particles], options].concat());
        assert_eq!(refused.status.code(), Some(1), "{options:?}");
        let message = text(&refused.stderr);
        assert!(message.contains(says), "{message}");
        assert!(files(folder.path()).is_empty());
    }
    let shown = [
        "--show", "choice", "--out", "a.png", "--axes", "--size", "120x120",
    ];
    let made = run(
        folder.path(),
        &[&["render", &particles], &shown[..]].concat(),
    );
    assert!(made.status.success(), "{}", text(&made.stderr));
}

/// A unit occurs in the legend once, and `info` reports it.
#[test]
fn legends_show_units() {
    let folder = tempfile::tempdir().unwrap();
    let table = |name: &str, field: &str| {
        let rows = (0..64).map(|i| format!("{},{},{},.5,{i}\n", i % 4, i / 4 % 4, i / 16));
        let text = format!("x,y,z,sigma,{field}\n{}", rows.collect::<String>());
        std::fs::write(folder.path().join(name), text).unwrap();
    };
    table("a.csv", "Temp [K]");
    table("b.csv", "Temp");
    let picture = |input: &str, field: &str| {
        let words = ["render", input, "--field", field, "--legend", "--quiet"];
        let rest = ["--size", "200x200", "--backend", "cpu", "--out", "a.npy"];
        let output = run(folder.path(), &[&words[..], &rest].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        read_image(&folder.path().join("a.npy")).unwrap()
    };
    let whole = picture("a.csv", "Temp [K]");
    assert!(picture("a.csv", "Temp") == whole, "the unit is added once");
    assert!(picture("b.csv", "Temp") != whole, "no unit is added");
    let output = run(folder.path(), &["info", "a.csv", "--json"]);
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let fields = told["fields"].as_array().unwrap();
    let field = fields.iter().find(|f| f["name"] == "Temp [K]").unwrap();
    assert_eq!(field["unit"], "K");
}
