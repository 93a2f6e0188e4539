//! Tests `ewa-splat export` with a page of a few words in place of the built one; tests/web opens what it writes.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::read::GzDecoder;
use serde_json::{Value, json};

use crate::commands::{files, fixture, run, text};

/// Writes the files that a page has.
fn page(folder: &Path) -> PathBuf {
    let page = folder.join("page");
    std::fs::create_dir_all(page.join("simd")).unwrap();
    let index = "<html><link rel=\"stylesheet\" href=\"style.css\">\n<script type=\"module\" src=\"page.js\"></script></html>";
    std::fs::write(page.join("index.html"), index).unwrap();
    for name in [
        "style.css",
        "page.js",
        "command.js",
        "function.js",
        "view.js",
        "worker.js",
    ] {
        std::fs::write(page.join(name), format!("/* {name} */\n")).unwrap();
    }
    for name in ["ewa_splat.js", "ewa_splat_bg.wasm"] {
        std::fs::write(page.join("simd").join(name), name).unwrap();
    }
    page
}

fn unpacked(data: &Value) -> Vec<u8> {
    let packed = STANDARD.decode(data.as_str().unwrap()).unwrap();
    let mut bytes = Vec::new();
    GzDecoder::new(packed.as_slice())
        .read_to_end(&mut bytes)
        .unwrap();
    bytes
}

/// Reads what a page holds.
fn embedded(path: &Path) -> Value {
    let html = std::fs::read_to_string(path).unwrap();
    let begin = "<script id=\"embedded\" type=\"application/json\">";
    let [_, rest] = html.split(begin).collect::<Vec<_>>().try_into().unwrap();
    let (own, after) = rest.split_once("</script>").unwrap();
    assert!(html.starts_with("<html><style>\n/* style.css */\n</style>"));
    assert!(
        after.ends_with("<script type=\"module\">\n/* page.js */\n</script></html>"),
        "{after}"
    );
    serde_json::from_str(own).unwrap()
}

/// Exports with some options, and returns what the page holds and the summary.
fn exported(folder: &Path, line: &[&str]) -> (Value, Value) {
    let page = page(folder);
    let page = page.to_str().unwrap();
    let line = [
        &["export"],
        line,
        &["--page", page, "--out", "a.html", "--json"],
    ]
    .concat();
    let output = run(folder, &line);
    assert!(
        output.status.success(),
        "{line:?}: {}",
        text(&output.stderr)
    );
    let out = folder.join("a.html");
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["bytes"], std::fs::metadata(&out).unwrap().len());
    (embedded(&out), summary)
}

#[test]
fn a_page_holds_its_program_the_data_and_those_that_they_name() {
    let folder = tempfile::tempdir().unwrap();
    let (own, summary) = exported(folder.path(), &[&fixture("wake.xyz")]);
    for (key, name) in [
        ("script", "ewa_splat.js"),
        ("module", "ewa_splat_bg.wasm"),
        ("worker", "/* worker.js */\n"),
    ] {
        assert_eq!(text(&unpacked(&own[key])), name);
    }
    let named = own["files"].as_array().unwrap();
    assert_eq!(named.len(), 2, "{summary}");
    for (file, name) in named.iter().zip(["wake.xyz", "wake.q"]) {
        assert_eq!(file["name"], name);
        assert_eq!(
            unpacked(&file["data"]),
            std::fs::read(fixture(name)).unwrap()
        );
    }
    assert_eq!(
        own["view"],
        json!({ "camera": null, "settings": {}, "function": null })
    );
    assert_eq!(summary["merged"], Value::Null);
    // The page is found by the environment, too, and is small enough without merging.
    let line = [
        "export",
        &fixture("wake.xyz"),
        "--size",
        "1M",
        "--out",
        "b.html",
    ];
    let mut command = Command::new(env!("CARGO_BIN_EXE_ewa-splat"));
    let command = command
        .args(line)
        .current_dir(folder.path())
        .env("EWA_SPLAT_PAGE", page(folder.path()));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(embedded(&folder.path().join("b.html")), own);
}

#[test]
fn options_become_the_view_of_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let wake = fixture("wake.xyz");
    let line = "--field energy --transfer-function magma --range 0.5,2 --scale linear --opacity-scale 2 \
                --composite slabs --slab-thickness 0.5 --light 1,2,3 --shadow-softness 4 --clip 0,0,1,0.5 \
                --background #ff8000 --tolerance 0.01 --eye 9,-9,3 --target 1,0,0 --fov 30";
    let line: Vec<&str> = std::iter::once(wake.as_str())
        .chain(line.split_whitespace())
        .collect();
    let (own, _) = exported(folder.path(), &line);
    let view = &own["view"];
    let expected = json!({
        "field": "energy", "map": "magma", "range": [0.5, 2.0], "scale": "linear", "opacity": 2.0, "composite": "slabs",
        "thickness": 0.5, "light": "on", "direction": [1.0, 2.0, 3.0], "shadows": true, "softness": 4.0,
        "clip": [0.0, 0.0, 1.0, 0.5], "background": "#ff8000", "tolerance": 0.01,
    });
    assert_eq!(view["settings"], expected);
    let camera = &view["camera"];
    assert_eq!(
        (&camera["eye"], &camera["up"]),
        (&json!([9.0, -9.0, 3.0]), &json!([0.0, 0.0, 1.0]))
    );
    assert!((camera["fov_deg"].as_f64().unwrap() - 30.0).abs() < 1e-9);
    // The target is on the line of sight, amid the data.
    let at = |key: &str| {
        glam::DVec3::from(serde_json::from_value::<[f64; 3]>(camera[key].clone()).unwrap())
    };
    let sight = (at("target") - at("eye")).normalize();
    assert!(sight.distance(glam::DVec3::new(-8.0, 9.0, -3.0).normalize()) < 1e-9);

    let function = fixture("wake_transfer.json");
    let (own, _) = exported(
        folder.path(),
        &[
            &wake,
            "--transfer-function",
            &function,
            "--along",
            "x",
            "--unlit",
            "--background",
            "none",
        ],
    );
    let view = &own["view"];
    assert_eq!(
        view["settings"],
        json!({ "light": "off", "background": "" })
    );
    assert!(view["function"]["points"].as_array().unwrap().len() > 2);
    assert!(view["camera"]["ortho_height"].as_f64().unwrap() > 1.0);

    let (own, _) = exported(
        folder.path(),
        &[
            &fixture("particles.csv"),
            "--column-density",
            "--column-of",
            "opacity",
            "--range",
            "1,2",
        ],
    );
    assert_eq!(
        own["view"]["settings"],
        json!({ "columns": true, "of": "opacity", "range": [1.0, 2.0] })
    );
}

#[test]
fn data_become_kernels_of_a_stated_size_and_error() {
    let folder = tempfile::tempdir().unwrap();
    let particles = fixture("particles.csv");
    let (own, whole) = exported(folder.path(), &[&particles, "--error", "0.02"]);
    let merged = &whole["merged"];
    // Particles without a field are kernels, and stay what they are.
    assert_eq!(merged["kind"], "kernels");
    assert!(merged["of_all"].as_f64().unwrap() < 0.01, "{whole}");
    assert!(merged["p999"].as_f64().unwrap() <= 0.02, "{whole}");
    assert_eq!(own["files"][0]["name"], "kernels.csv");
    let table = text(&unpacked(&own["files"][0]["data"]));
    assert_eq!(
        table.lines().count() as u64,
        1 + merged["count"].as_u64().unwrap()
    );
    let fov = own["view"]["camera"]["fov_deg"].as_f64().unwrap();
    assert!((fov - 35.0).abs() < 1e-9);

    let size = whole["bytes"].as_u64().unwrap() / 2;
    let (_, small) = exported(
        folder.path(),
        &[&particles, "--size", &size.to_string(), "--up", "0,0,1"],
    );
    assert!(small["bytes"].as_u64().unwrap() <= size, "{small}");
    let few = &small["merged"];
    assert!(few["count"].as_u64() < few["given"].as_u64(), "{small}");
    assert!(few["p999"].as_f64() > few["of_all"].as_f64(), "{small}");

    // Surfaces become splats. An error that all of them exceed merges none.
    let vase = fixture("vase.glb");
    let (own, surface) = exported(
        folder.path(),
        &[&vase, "--count", "500", "--error", "0.0001"],
    );
    let merged = &surface["merged"];
    assert_eq!(
        (&merged["kind"], &own["files"][0]["name"]),
        (&json!("splats"), &json!("splats.glb"))
    );
    assert_eq!(merged["count"], merged["given"]);
    assert!(
        merged["notes"]
            .to_string()
            .contains("all of them differ by"),
        "{surface}"
    );
    assert!(unpacked(&own["files"][0]["data"]).starts_with(b"glTF"));
}

#[test]
fn a_name_cannot_end_the_script_that_holds_it() {
    let folder = tempfile::tempdir().unwrap();
    let name = "a<!--<script>.csv";
    std::fs::copy(fixture("particles.csv"), folder.path().join(name)).unwrap();
    let (own, _) = exported(folder.path(), &[name]);
    assert_eq!(own["files"][0]["name"], name);
    let html = std::fs::read_to_string(folder.path().join("a.html")).unwrap();
    assert!(!html.contains("<!--"));
}

#[test]
fn what_a_page_cannot_show_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let sources = tempfile::tempdir().unwrap();
    let page = page(sources.path());
    let page = page.to_str().unwrap();
    let empty = sources.path().to_str().unwrap();
    for (line, part) in [
        (
            "WAKE --out a.png",
            "expected a name that ends in .html, found a.png",
        ),
        (
            "WAKE --out a.html --page EMPTY",
            "expected the built page, found none",
        ),
        (
            "WAKE CSV --out a.html",
            "expected one file, with those that it names, found several",
        ),
        (
            "WAKE --out a.html --backend cpu",
            "--backend: use: expected what the page has a setting for",
        ),
        (
            "WAKE --out a.html --picture-size 9x9",
            "--picture-size: use",
        ),
        ("WAKE --out a.html --kernel-width 1", "--kernel-width: use"),
        (
            "WAKE --out a.html --clip 0,0,0,1,1,1",
            "expected one plane, found 6 of them",
        ),
        (
            "WAKE --out a.html --light 1,0,0 --light 0,1,0",
            "expected one light, found 2 of them",
        ),
        (
            "WAKE --out a.html --light 1,0,0,1,0,0",
            "of white light, found a colour",
        ),
        (
            "WAKE --out a.html --error 0.1 --shadows",
            "--shadows: use: expected what kernels keep",
        ),
        (
            "WAKE --out a.html --error 0.1 --column-density",
            "--column-density: use: expected what kernels keep",
        ),
        (
            "CSV --out a.html --size 300",
            "which the page takes without data, found 300",
        ),
        ("CSV --out a.html --size 0", "a number of bytes above 0"),
        ("CSV --out a.html --error 2", "above 0 and below 1"),
        ("none.vtu --out a.html", "none.vtu"),
        ("CSV --out none/a.html", "an existing folder"),
    ] {
        let line = line
            .replace("WAKE", &fixture("wake.xyz"))
            .replace("CSV", &fixture("particles.csv"));
        let line = line.replace("EMPTY", empty);
        let mut words: Vec<&str> = std::iter::once("export").chain(line.split(' ')).collect();
        if !words.contains(&"--page") {
            words.extend(["--page", page]);
        }
        let output = run(folder.path(), &words);
        let said = text(&output.stderr);
        assert!(
            !output.status.success() && said.contains(part),
            "{line}: {said}"
        );
        assert!(files(folder.path()).is_empty(), "{line}");
    }
}
