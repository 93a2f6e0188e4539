//! Tests the records of how pictures were made, and their verification.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use serde_json::Value;

use crate::commands::{files, fixture, run, text};

/// Runs a command that must succeed.
fn sound(folder: &Path, line: &[&str]) -> String {
    let output = run(folder, line);
    assert!(
        output.status.success(),
        "{line:?}: {}",
        text(&output.stderr)
    );
    text(&output.stdout)
}

/// Runs a command that must fail, and returns its error, which is one line.
fn refused(folder: &Path, line: &[&str]) -> String {
    let output = run(folder, &[line, &["--quiet"]].concat());
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{line:?}: {error}");
    assert_eq!(error.trim_end().lines().count(), 1, "{error}");
    error
}

/// Copies a fixture into a folder.
fn copy(folder: &Path, name: &str) {
    std::fs::copy(fixture(name), folder.join(name)).unwrap();
}

/// Pieces of a PNG file: the kind of each chunk and its bytes.
fn chunks(bytes: &[u8]) -> Vec<([u8; 4], &[u8])> {
    let mut rest = &bytes[8..];
    let mut found = Vec::new();
    while !rest.is_empty() {
        let len = u32::from_be_bytes(rest[..4].try_into().unwrap()) as usize;
        found.push((rest[4..8].try_into().unwrap(), &rest[8..8 + len]));
        rest = &rest[12 + len..];
    }
    found
}

/// The record of a PNG file, read by the layout of its chunk.
fn record(path: &Path) -> Option<Value> {
    let bytes = std::fs::read(path).unwrap();
    let chunks = chunks(&bytes);
    let text = chunks.iter().find(|(kind, _)| kind == b"iTXt")?.1;
    // Keyword, flags of compression, language and translated keyword.
    let text = text.strip_prefix(b"ewa-splat\0\0\0\0\0").unwrap();
    Some(serde_json::from_slice(text).unwrap())
}

/// Writes a PNG file again with another record.
fn with_record(path: &Path, record: &str) {
    let bytes = std::fs::read(path).unwrap();
    let mut written = bytes[..8].to_vec();
    for (kind, data) in chunks(&bytes) {
        let mut data = data.to_vec();
        if kind == *b"iTXt" {
            data = b"ewa-splat\0\0\0\0\0".to_vec();
            data.extend(record.as_bytes());
        }
        let mut crc = flate2::Crc::new();
        crc.update(&kind);
        crc.update(&data);
        written.extend(u32::try_from(data.len()).unwrap().to_be_bytes());
        written.extend(kind);
        written.extend(data);
        written.extend(crc.sum().to_be_bytes());
    }
    std::fs::write(path, written).unwrap();
}

fn verified(folder: &Path, line: &[&str]) -> Value {
    let words: Vec<&str> = ["verify", "--json"].iter().chain(line).copied().collect();
    serde_json::from_str(&sound(folder, &words)).unwrap()
}

#[test]
fn a_record_names_files_and_nothing_of_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (wake, function) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    let line = [
        "render",
        &wake,
        "--transfer-function",
        &function,
        "--size",
        "64x48",
        "--out",
        "a.png",
    ];
    sound(at, &line);
    let record = record(&at.join("a.png")).unwrap();
    let expected = [
        "render",
        "wake.xyz",
        "--transfer-function",
        "wake_transfer.json",
        "--size",
        "64x48",
        "--out",
        "a.png",
    ];
    assert_eq!(record["command"], serde_json::json!(expected));
    assert_eq!(record["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(record["measured_error"], Value::Null);
    assert!((record["tolerance"].as_f64().unwrap() - 1.0 / 255.0).abs() < 1e-8);
    let names: Vec<&str> = (record["inputs"].as_array().unwrap().iter())
        .map(|input| input["file"].as_str().unwrap())
        .collect();
    // The solution was found beside the grid.
    assert_eq!(names, ["wake.xyz", "wake_transfer.json", "wake.q"]);
    for input in record["inputs"].as_array().unwrap() {
        let bytes = std::fs::read(fixture(input["file"].as_str().unwrap())).unwrap();
        assert_eq!(input["bytes"], bytes.len());
        assert_eq!(input["sha256"].as_str().unwrap().len(), 64);
    }
    let whole = record.to_string();
    for private in [
        at.to_str().unwrap(),
        env!("CARGO_MANIFEST_DIR"),
        "/tmp",
        "/home",
    ] {
        assert!(!whole.contains(private), "{private}: {whole}");
    }
    sound(at, &[&line[..], &["--no-provenance"]].concat());
    assert_eq!(self::record(&at.join("a.png")), None);
    let error = refused(at, &["verify", "a.png"]);
    assert!(error.contains("record"), "{error}");
    // The measured error goes in.
    sound(at, &[&line[..], &["--measure-error"]].concat());
    let record = self::record(&at.join("a.png")).unwrap();
    assert!(
        record["measured_error"]["greatest"].as_f64().unwrap() > 0.0,
        "{record}"
    );
}

#[test]
fn pictures_drawn_again_are_equal() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    copy(at, "particles.csv");
    write_mesh(at, "0.9 0.2 0.1");
    let particles = ["particles.csv", "--size", "200x150"];
    let cases: [(&[&str], &str); 10] = [
        (&["--outline", "--title", "ä/b", "--axes"], "a.png"),
        (&["--calibrate"], "a.exr"),
        (&["--composite", "slabs", "--opaque-edges", "off"], "a.exr"),
        (&["--column-density"], "a.exr"),
        (&["--column-density", "--legend"], "a.png"),
        (&["--show", "count"], "a.png"),
        (&["--show", "count"], "a.exr"),
        (&["--depth", "d.npy", "--stats", "s.json"], "a.exr"),
        (&["--turntable", "3"], "t_%d.png"),
        (
            &["--reference", "--size", "24x16", "--tolerance", "1e-2"],
            "a.exr",
        ),
    ];
    for (options, out) in cases {
        let size = if options.contains(&"--size") { 1 } else { 3 };
        let line = [&["render"], &particles[..size], options, &["--out", out]].concat();
        sound(at, &line);
        let picture = out.replace("%d", "1");
        for side in ["d.npy", "s.json"] {
            let _ = std::fs::remove_file(at.join(side));
        }
        let before = files(at);
        let found = verified(at, &[&picture]);
        assert_eq!(found["result"], "equal", "{line:?}: {found}");
        assert_eq!(found["inputs"], 1);
        assert_eq!(files(at), before, "{line:?}");
    }
    // Opaque surfaces, whose tiles are drawn at more samples, and transparent volumes.
    let line = [
        "render",
        "a.obj",
        "particles.csv",
        "--low-pass",
        "0.3",
        "--size",
        "300x200",
        "--out",
        "v.png",
    ];
    sound(at, &line);
    let found = verified(at, &["v.png"]);
    assert_eq!(
        (&found["result"], &found["tiles_compared"]),
        (&"equal".into(), &90.into())
    );
    let found = verified(at, &["v.png", "--tiles", "all"]);
    assert_eq!(
        (&found["result"], &found["tiles_compared"]),
        (&"equal".into(), &247.into())
    );
    // A series: the step is found by the number of the picture.
    let line = [
        "render",
        "a.obj",
        "particles.csv",
        "--series",
        "--size",
        "64x64",
        "--out",
        "s_%d.png",
    ];
    sound(at, &line);
    assert_eq!(verified(at, &["s_1.png"])["result"], "equal");
}

/// Writes a mesh of two triangles, whose material is in a file beside it.
fn write_mesh(folder: &Path, colour: &str) {
    let mesh = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n";
    std::fs::write(folder.join("a.obj"), mesh).unwrap();
    std::fs::write(folder.join("a.mtl"), format!("newmtl m\nKd {colour}\n")).unwrap();
}

#[test]
fn changes_of_pictures_and_inputs_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_mesh(at, "0.9 0.2 0.1");
    sound(
        at,
        &["render", "a.obj", "--size", "100x80", "--out", "m.png"],
    );
    assert_eq!(verified(at, &["m.png"])["inputs"], 2);
    // The data lie elsewhere.
    let below = at.join("data/below");
    std::fs::create_dir_all(&below).unwrap();
    for name in ["a.obj", "a.mtl"] {
        std::fs::rename(at.join(name), below.join(name)).unwrap();
    }
    let error = refused(at, &["verify", "m.png"]);
    assert!(error.contains("a.obj missing"), "{error}");
    assert_eq!(
        verified(at, &["m.png", "--data", "data"])["result"],
        "equal"
    );
    // Another file of the name is passed over, and is named where it is the only one.
    std::fs::write(at.join("a.obj"), "v 0 0 0\n").unwrap();
    assert_eq!(
        verified(at, &["m.png", "--data", "data"])["result"],
        "equal"
    );
    let error = refused(at, &["verify", "m.png"]);
    assert!(error.contains("a.obj different"), "{error}");
    // A file beside the input, which the command does not name.
    write_mesh(&below, "0.9 0.2 0.11");
    let output = run(at, &["verify", "m.png", "--data", "data", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        found["faults"],
        serde_json::json!([{ "file": "a.mtl", "fault": "different" }])
    );
    assert_eq!(found["result"], "inputs");

    // Another picture under the record: a denser one.
    copy(at, "particles.csv");
    let line = [
        "render",
        "particles.csv",
        "--size",
        "100x80",
        "--out",
        "a.png",
    ];
    sound(at, &line);
    let good = record(&at.join("a.png")).unwrap();
    sound(at, &[&line[..5], &["b.png", "--azimuth", "60"]].concat());
    with_record(&at.join("b.png"), &good.to_string());
    let output = run(at, &["verify", "b.png", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["result"], "different");
    assert!(found["tiles_different"].as_u64().unwrap() > 3, "{found}");
    assert!(found["greatest_difference"].as_f64() > found["tolerance"].as_f64());
    let words = text(&run(at, &["verify", "b.png"]).stdout);
    assert!(words.contains("different at"), "{words}");
    // A looser picture differs by less than its tolerance.
    let with = |words: &[&str]| {
        let mut record = good.clone();
        record["command"] = serde_json::json!(words);
        record.to_string()
    };
    let loose = [
        "render",
        "particles.csv",
        "--size",
        "100x80",
        "--tolerance",
        "0.1",
        "--out",
        "c.png",
    ];
    std::fs::copy(at.join("a.png"), at.join("c.png")).unwrap();
    with_record(&at.join("c.png"), &with(&loose));
    let found = verified(at, &["c.png"]);
    assert_eq!(found["result"], "within tolerance", "{found}");
    // Another version, with the same picture.
    let mut older = good.clone();
    older["version"] = "0.0.9".into();
    with_record(&at.join("a.png"), &older.to_string());
    let output = run(at, &["verify", "a.png"]);
    assert!(output.status.success());
    assert!(
        text(&output.stderr).contains("0.0.9"),
        "{}",
        text(&output.stderr)
    );
    // Another size.
    let other = [
        "render",
        "particles.csv",
        "--size",
        "90x80",
        "--out",
        "a.png",
    ];
    with_record(&at.join("a.png"), &with(&other));
    assert!(refused(at, &["verify", "a.png"]).contains("size"));
}

#[test]
fn hostile_and_damaged_records_do_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    copy(at, "particles.csv");
    std::fs::create_dir(at.join("other")).unwrap();
    std::fs::write(at.join("other/secret.json"), "{}").unwrap();
    sound(
        at,
        &[
            "render",
            "particles.csv",
            "--size",
            "64x48",
            "--out",
            "a.png",
        ],
    );
    let path = at.join("a.png");
    let good = record(&path).unwrap();
    let with = |words: &[&str]| {
        let mut record = good.clone();
        record["command"] = serde_json::json!(words);
        record.to_string()
    };
    let before = files(at);
    let outside = at.join("other/secret.json");
    let outside = outside.to_str().unwrap();
    for words in [
        &[
            "render",
            "particles.csv",
            "--camera",
            outside,
            "--out",
            "a.png",
        ][..],
        &["render", outside, "--out", "a.png"],
        &[
            "render",
            "particles.csv",
            "--transfer-function",
            outside,
            "--out",
            "a.png",
        ],
        &[
            "render",
            "particles.csv@@other/secret.json",
            "--out",
            "a.png",
        ],
        &["render", "../particles.csv/..", "--out", "a.png"],
        &["convert", "particles.csv", "--out", "x.ply"],
        &["info", "particles.csv"],
        &["--help"],
        &["render", "--help"],
        &["render", "--version"],
        &["render", "particles.csv", "--no-such-option"],
        &["measure", "particles.csv", "--out", "m"],
        &["verify", "a.png"],
        &[],
    ] {
        with_record(&path, &with(words));
        let error = refused(at, &["verify", "a.png"]);
        assert!(!error.contains("panicked"), "{error}");
        assert_eq!(files(at), before, "{words:?}");
    }
    // What would be written is not.
    let elsewhere = at.join("other/x.json");
    let elsewhere = elsewhere.to_str().unwrap();
    let writes = [
        "render",
        "particles.csv",
        "--size",
        "64x48",
        "--out",
        elsewhere,
        "--stats",
        elsewhere,
        "--depth",
        "d.npy",
        "--normals",
        "n.npy",
        "--write-transfer-function",
        elsewhere,
        "--frames",
        "100000",
    ];
    let picture = std::fs::read(&path).unwrap().len();
    with_record(&path, &with(&writes));
    verified(at, &["a.png"]);
    assert_eq!(files(at), before);
    assert_eq!(files(&at.join("other")), ["secret.json"]);
    assert!(std::fs::read(&path).unwrap().len() > picture / 2);
    // Damaged records.
    let text = good.to_string();
    for damaged in [
        text[..text.len() / 2].to_owned(),
        "[]".into(),
        "null".into(),
        String::new(),
        text.replace("\"format\":1", "\"format\":2"),
        text.replace("\"inputs\":[", "\"inputs\":[7,"),
        text.replace("\"frame\":null", "\"frame\":-1"),
        text.replace("\"command\":[", "\"command\":[[],"),
        "[".repeat(100_000),
    ] {
        with_record(&path, &damaged);
        refused(at, &["verify", "a.png"]);
    }
    let no_picture = refused(at, &["verify", "particles.csv"]);
    assert!(no_picture.contains("png"), "{no_picture}");
}

#[test]
#[cfg(feature = "gpu")]
fn pictures_of_a_gpu_are_equal_there_and_within_the_tolerance_elsewhere() {
    if crate::common::gpu::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    copy(at, "particles.csv");
    sound(
        at,
        &[
            "render",
            "particles.csv",
            "--backend",
            "gpu",
            "--size",
            "100x80",
            "--out",
            "a.png",
        ],
    );
    let mut made = record(&at.join("a.png")).unwrap();
    assert_eq!(made["backend"], "gpu");
    assert!(made["adapter"].is_string());
    assert_eq!(verified(at, &["a.png"])["result"], "equal");
    made["backend"] = "cpu".into();
    with_record(&at.join("a.png"), &made.to_string());
    assert_ne!(verified(at, &["a.png"])["result"], "different");
}
