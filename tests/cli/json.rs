//! Tests that programs get what people get: each line of words has its key in JSON, and the documentation names it.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use crate::commands::{fixture, run, text};

/// Lines of `info`, and where their values stand in its JSON.
const LINES: [(&str, &str); 33] = [
    ("file", "/file"),
    ("  at time", "/time_steps/0/time"),
    ("  of", "/time_steps/0/files"),
    ("format", "/format"),
    ("kind", "/geometry/kind"),
    ("nodes along i, j, k", "/geometry/dims/0"),
    ("samples", "/geometry/dims"),
    ("nodes", "/geometry/nodes"),
    ("cells", "/geometry/cells"),
    ("count", "/geometry/count"),
    ("triangles", "/geometry/triangles"),
    ("lines", "/geometry/lines"),
    ("points", "/geometry/points"),
    ("parts", "/geometry/parts"),
    ("textures", "/geometry/textures"),
    ("  of kind", "/geometry/cell_kinds/0/count"),
    ("  of type", "/particle_types/0/count"),
    ("  of material", "/geometry/materials/0/triangles"),
    ("spacing", "/geometry/spacing"),
    ("axes", "/axes/file"),
    ("up", "/up/direction"),
    ("seen along", "/front"),
    ("lower bound", "/bounds/0"),
    ("upper bound", "/bounds/1"),
    ("particles", "/particles"),
    ("shown field", "/shown"),
    ("lengths", "/lengths"),
    ("kernel sigma", "/kernels/size"),
    ("anisotropy", "/kernels/anisotropy"),
    ("bytes per particle", "/bytes_per_particle"),
    ("note", "/notes"),
    ("will err", "/doubts/0"),
    ("problem", "/problem"),
];

fn json(line: &[&str]) -> Value {
    let output = run(Path::new("."), line);
    assert!(
        output.status.success(),
        "{line:?}: {}",
        text(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Collects the keys of objects at any depth.
fn keys(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => {
            for (key, value) in object {
                found.insert(key.clone());
                keys(value, found);
            }
        }
        Value::Array(values) => values.iter().for_each(|value| keys(value, found)),
        _ => {}
    }
}

fn documentation() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/command-line.md");
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn each_line_of_info_has_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let prepared = folder.path().join("p.arrow");
    let prepared = prepared.to_str().unwrap();
    let (particles, splats) = (fixture("particles.csv"), folder.path().join("s.spz"));
    let splats = splats.to_str().unwrap();
    json(&["convert", &particles, "--out", prepared, "--json"]);
    json(&["convert", &particles, "--out", splats, "--json"]);
    let names = [
        "wake.xyz",
        "vase.glb",
        "particles.csv",
        "gadget_types.h5",
        "swift.h5",
        "levels_in_time.vtkhdf",
        "solids.vtkhdf",
        "stack_lzw.tif",
        "picture.tif",
        "cloud_3.las",
        "snapshot.tipsy",
        "plt00010",
    ];
    let files = names.iter().map(|name| fixture(name));
    let files = files.chain([prepared.to_owned(), splats.to_owned()]);
    let (mut seen, mut found) = (BTreeSet::new(), BTreeSet::new());
    for file in files {
        let object = json(&["info", "--json", &file]);
        keys(&object, &mut found);
        let output = run(Path::new("."), &["info", &file]);
        let words = text(&output.stdout);
        for line in words.lines().take_while(|line| !line.is_empty()) {
            let label = line.get(..18).unwrap_or(line).trim_end();
            let label = match LINES
                .iter()
                .find(|(known, _)| line.starts_with(&format!("{known} ")))
            {
                _ if label.is_empty() => continue,
                Some((known, _)) if known.len() >= 18 => known,
                _ => label,
            };
            let (_, place) = (LINES.iter().find(|(known, _)| *known == label))
                .unwrap_or_else(|| panic!("{file}: a line without a key: {line}"));
            let is_there = object.pointer(place).is_some_and(|value| !value.is_null());
            assert!(is_there, "{file}: {line}: {place} of {object:#}");
            seen.insert(label.to_owned());
        }
        // A row for each field.
        let fields = words.lines().skip_while(|line| !line.is_empty()).skip(2);
        let rows = fields.filter(|line| !line.starts_with(' ')).count();
        assert_eq!(object["fields"].as_array().unwrap().len(), rows, "{file}");
    }
    assert!(seen.len() > 24, "{seen:?}");
    // Requirements and rules have keys of their own, which are those of the library.
    let documented = documentation();
    let top = json(&["info", "--json", &particles]);
    for key in top.as_object().unwrap().keys() {
        assert!(documented.contains(&format!("`{key}`")), "{key}");
    }
    for key in [
        "geometry",
        "fields",
        "particle_types",
        "kernels",
        "up",
        "axes",
    ] {
        assert!(found.contains(key), "{key}");
    }
}

#[test]
fn keys_of_other_commands_are_documented() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (particles, splats) = (fixture("particles.csv"), at("s.ply"));
    let documented = documentation();
    let check = |object: &Value| {
        for key in object.as_object().unwrap().keys() {
            assert!(documented.contains(&format!("`{key}`")), "{key}");
        }
    };
    check(&json(&["convert", &particles, "--out", &splats, "--json"]));
    check(&json(&[
        "convert",
        &particles,
        "--out",
        &at("p.arrow"),
        "--json",
    ]));
    for name in ["a.exr", "b.exr"] {
        let line = ["render", &particles, "--size", "40x30", "--out", &at(name)];
        assert!(run(folder.path(), &line).status.success());
    }
    let compared = json(&[
        "compare",
        &at("a.exr"),
        &at("b.exr"),
        "--difference",
        &at("d.png"),
        "--json",
    ]);
    assert!(compared["difference"]["brightest"].is_number());
    check(&compared);
    let data = Path::new(&particles)
        .parent()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let verified = json(&["verify", &at("a.exr"), "--data", &data, "--json"]);
    check(&verified);
    let formats = json(&["formats", "--json"]);
    let formats = formats.as_array().unwrap();
    assert_eq!(formats.len(), ewa_splat::io::formats().len());
    check(&formats[0]);
    let words = text(&run(folder.path(), &["formats"]).stdout);
    for format in formats {
        assert!(words.contains(format["name"].as_str().unwrap()), "{format}");
    }
}

#[test]
fn measure_prints_its_report() {
    let folder = tempfile::tempdir().unwrap();
    let particles = fixture("particles.csv");
    let line = [
        "measure",
        &particles,
        "--size",
        "16x16",
        "--frames",
        "1",
        "--reference-error",
        "1e-2",
        "--out",
        "m",
        "--json",
    ];
    let output = run(folder.path(), &line);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let written = std::fs::read(folder.path().join("m/report.json")).unwrap();
    assert_eq!(printed, serde_json::from_slice::<Value>(&written).unwrap());
}
