//! Tests fields whose differences single precision cannot represent: absolute pressures, times,
//! values beyond its range.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::fmt::Write as _;
use std::path::Path;

use crate::commands::{run, text};
use ewa_splat::io::read_image;

const SIDE: usize = 12;

/// Writes a wave on a lattice, and the same wave far from 0 and beyond single precision.
fn write(folder: &Path) {
    let wave = |n: usize| {
        let [x, y, z] = [n % SIDE, n / SIDE % SIDE, n / (SIDE * SIDE)].map(|i| i as f64);
        (0.6 * x).sin() * (0.4 * y).cos() + 0.2 * z / SIDE as f64
    };
    // Names, values at 0, and factors.
    let fields = [
        ("p", 0.0, 1.0),
        ("p_abs", 101_325.0, 0.01),
        ("t_big", 1.7e9, 5.0),
        ("large", 0.0, 1e300),
        ("small", 0.0, 1e-200),
    ];
    let mut arrays = String::new();
    for (name, origin, factor) in fields {
        let numbers: Vec<String> = (0..SIDE.pow(3))
            .map(|n| format!("{:?}", origin + factor * wave(n)))
            .collect();
        writeln!(
            arrays,
            r#"<DataArray type="Float64" Name="{name}" format="ascii">{}</DataArray>"#,
            numbers.join(" ")
        )
        .unwrap();
    }
    let last = SIDE - 1;
    let file = format!(
        r#"<VTKFile type="ImageData" version="1.0"><ImageData WholeExtent="0 {last} 0 {last} 0 {last}" Origin="0 0 0" Spacing="1 1 1"><Piece Extent="0 {last} 0 {last} 0 {last}"><PointData>{arrays}</PointData></Piece></ImageData></VTKFile>"#
    );
    std::fs::write(folder.join("w.vti"), file).unwrap();
}

/// Draws a picture of a field, with further options.
fn picture(folder: &Path, field: &str, words: &[&str]) -> Vec<[f32; 4]> {
    let mut all = [
        &[
            "render", "w.vti", "--field", field, "--size", "48x48", "--out", "o.npy",
        ],
        words,
    ]
    .concat();
    if !words.contains(&"--reference") {
        all.extend(["--backend", "cpu"]);
    }
    let output = run(folder, &all);
    assert!(output.status.success(), "{field}: {}", text(&output.stderr));
    read_image(&folder.join("o.npy")).unwrap().pixels
}

fn assert_alike(one: &[[f32; 4]], other: &[[f32; 4]], what: &str) {
    let apart = one.iter().flatten().zip(other.iter().flatten());
    let most = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let shown = one.iter().map(|p| p[3]).fold(0.0, f32::max);
    assert!(shown > 0.3, "{what}: nothing to compare, {shown}");
    // The positions of both are rounded to 2^-24 of a range before the lookup in a table of 4096
    // entries.
    assert!(most < 2e-3, "{what}: {most}");
}

#[test]
fn fields_far_from_0_have_the_picture_of_their_differences() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(folder);
    let ranges = [
        ("p_abs", "101324.995,101325.005"),
        ("t_big", "1699999997.5,1700000002.5"),
    ];
    let p = picture(folder, "p", &["--transfer-function", "viridis"]);
    let within = |(field, range): (&str, &str)| {
        picture(
            folder,
            field,
            &["--transfer-function", "viridis", "--range", range],
        )
    };
    for field in ["p_abs", "t_big", "large", "small"] {
        let own = picture(folder, field, &["--transfer-function", "viridis"]);
        assert_alike(&p, &own, field);
    }
    let of_range = within(("p", "-0.5,0.5"));
    for (field, range) in ranges {
        assert_alike(&of_range, &within((field, range)), range);
    }
}

#[test]
fn values_are_named_in_the_fields_own_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(folder);
    let at = |field: &str, value: &str| {
        let words = ["--transfer-function", "viridis", "--flatten", value];
        picture(folder, field, &words)
    };
    let iso = at("p", "0.25");
    assert_alike(&iso, &at("p_abs", "101325.0025"), "iso-surface");
    let function = |low: &str, high: &str| {
        let json = format!(
            r#"{{"points": [{{"value": {low}, "opacity": 0.0, "color": [0, 0, 1]}},
                {{"value": {high}, "opacity": 0.5, "color": [1, 0, 0]}}], "unit_distance": 1.0}}"#
        );
        std::fs::write(folder.join("f.json"), json).unwrap();
    };
    let with_file = ["--transfer-function", "f.json"];
    function("0.0", "0.5");
    let p = picture(folder, "p", &with_file);
    let truth = picture(
        folder,
        "p",
        &[&with_file[..], &["--reference", "data"]].concat(),
    );
    function("101325.0", "101325.005");
    assert_alike(&p, &picture(folder, "p_abs", &with_file), "function");
    let own = picture(
        folder,
        "p_abs",
        &[&with_file[..], &["--reference", "data"]].concat(),
    );
    assert_alike(&truth, &own, "reference");
    let info = run(folder, &["info", "w.vti", "--field", "p_abs"]);
    assert!(
        text(&info.stdout).contains("101325.0"),
        "{}",
        text(&info.stdout)
    );
}

#[cfg(feature = "prepared")]
#[test]
fn prepared_scenes_keep_the_origin_of_values() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(folder);
    // Prepared scenes keep one kernel per sample.
    let own = picture(folder, "p_abs", &["--refine", "off"]);
    let prepare = ["convert", "w.vti", "--field", "p_abs", "--out", "s.arrow"];
    let output = run(folder, &prepare);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let draw = [
        "render",
        "s.arrow",
        "--size",
        "48x48",
        "--backend",
        "cpu",
        "--out",
        "o.npy",
    ];
    let output = run(folder, &draw);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let again = read_image(&folder.join("o.npy")).unwrap().pixels;
    assert_alike(&own, &again, "prepared");
}
