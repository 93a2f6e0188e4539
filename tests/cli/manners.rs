//! Tests the program's help, silence, output for several files, and error messages.

use serde_json::Value;

use crate::commands::{fixture, run, text};

#[test]
fn shells_and_man_get_what_they_read() {
    let folder = tempfile::tempdir().unwrap();
    let of = |arguments: &[&str]| {
        let output = run(folder.path(), arguments);
        assert!(output.status.success(), "{arguments:?}");
        assert!(output.stderr.is_empty());
        text(&output.stdout)
    };
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = of(&["completions", shell]);
        assert!(script.contains("transfer-function"), "{shell}");
    }
    let page = of(&["man"]);
    assert!(page.contains(".TH ewa-splat 1"), "{page}");
    assert!(page.contains("ewa\\-splat\\-render(1)"), "{page}");
    let page = of(&["man", "render"]);
    assert!(page.contains(".TH ewa-splat-render 1"), "{page}");
    assert!(page.contains("\\-\\-scale\\-bar"));
    let refused = run(folder.path(), &["man", "paint"]);
    assert_eq!(refused.status.code(), Some(2));
    let version = of(&["--version"]);
    assert!(version.starts_with(&format!("ewa-splat {}\n", env!("CARGO_PKG_VERSION"))));
    assert!(
        version.contains("GPU path") && version.contains("SIMD: "),
        "{version}"
    );
}

#[test]
fn quiet_leaves_errors_alone() {
    let folder = tempfile::tempdir().unwrap();
    let wake = fixture("wake.xyz");
    let render = ["render", &wake, "--size", "40x30", "--out", "a.png"];
    let loud = run(folder.path(), &render);
    assert!(text(&loud.stderr).contains("periodic seam"));
    for quiet in [
        [&render[..], &["--quiet"]].concat(),
        [&["--quiet"], &render[..]].concat(),
    ] {
        let quiet = run(folder.path(), &quiet);
        assert!(quiet.status.success());
        assert_eq!(text(&quiet.stderr), "");
    }
    let refused = run(folder.path(), &["--quiet", "info", "missing.csv"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).starts_with("error: missing.csv"));
}

#[test]
fn errors_and_statistics_are_objects_for_programs() {
    let folder = tempfile::tempdir().unwrap();
    let error = |arguments: &[&str], status: i32| {
        let refused = run(folder.path(), arguments);
        assert_eq!(refused.status.code(), Some(status), "{arguments:?}");
        let said = text(&refused.stderr);
        let object: serde_json::Value = serde_json::from_str(&said).unwrap();
        object["error"].clone()
    };
    let missing = error(&["--errors", "json", "info", "missing.csv"], 1);
    assert_eq!([&missing["kind"], &missing["file"]], ["io", "missing.csv"]);
    std::fs::write(folder.path().join("a.vti"), "<VTKFile").unwrap();
    let damaged = error(&["info", "a.vti", "--errors=json"], 1);
    assert_eq!(damaged["kind"], "format");
    for part in ["place", "expected", "found", "do", "text"] {
        assert!(damaged[part].is_string(), "{damaged}");
    }
    let unknown = error(&["--errors", "json", "info", "a.vti", "--no-such"], 2);
    assert_eq!(unknown["kind"], "usage");
    assert!(unknown["text"].as_str().unwrap().contains("--no-such"));
    // The other form, and help, are as they were.
    let plain = run(folder.path(), &["--errors", "text", "info", "missing.csv"]);
    assert!(text(&plain.stderr).starts_with("error: missing.csv"));
    let help = run(folder.path(), &["--errors", "json", "info", "--help"]);
    assert!(help.status.success() && text(&help.stdout).contains("Usage"));
    let wake = fixture("wake.xyz");
    let words = [
        "render", &wake, "--size", "40x30", "--out", "a.png", "--stats", "-",
    ];
    let drawn = run(folder.path(), &words);
    let stats: serde_json::Value = serde_json::from_slice(&drawn.stdout).unwrap();
    assert!(stats["footprints"].as_u64() > Some(0));
    assert!(!folder.path().join("-").exists());
}

#[test]
fn info_of_several_files_is_a_row_for_each() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("data/inner");
    std::fs::create_dir_all(&inner).unwrap();
    for (name, to) in [
        ("wake.xyz", "data/wake.xyz"),
        ("wake.q", "data/wake.q"),
        ("particles.csv", "data/inner/particles.csv"),
        ("vase.obj", "data/vase.obj"),
    ] {
        std::fs::copy(fixture(name), folder.path().join(to)).unwrap();
    }
    std::fs::write(folder.path().join("data/noise"), [0, 255, 1, 2, 3]).unwrap();
    let info = |arguments: &[&str]| {
        let output = run(folder.path(), &[&["info"], arguments].concat());
        let says = text(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {says}");
        text(&output.stdout)
    };
    let table = info(&["data"]);
    let lines: Vec<Vec<&str>> = table
        .lines()
        .map(|l| l.split_whitespace().collect())
        .collect();
    let row = |name: &str| {
        let of = |line: &&Vec<&str>| line.first().is_some_and(|first| first.ends_with(name));
        lines
            .iter()
            .find(of)
            .unwrap_or_else(|| panic!("{table}"))
            .clone()
    };
    assert_eq!(
        lines[0],
        ["file", "format", "kind", "count", "shown", "field"]
    );
    assert!(row("wake.xyz").ends_with(&["nodes", "density"]), "{table}");
    assert!(row("vase.obj").ends_with(&["triangles", "-"]), "{table}");
    assert_eq!(row("particles.csv")[0], "data/inner/particles.csv");
    // Unread files come last, with a reason.
    let last: Vec<&str> = table.lines().rev().take(2).collect();
    assert_eq!(last[1], "data/noise: not recognised", "{table}");
    assert!(
        last[0].starts_with("data/wake.q: ") && last[0].contains("--solution"),
        "{table}"
    );

    let list: Value = serde_json::from_str(&info(&["data", "--json"])).unwrap();
    let list = list.as_array().unwrap();
    assert_eq!(list.len(), 5);
    assert_eq!(
        list.iter().filter(|file| file["error"].is_string()).count(),
        2
    );
    assert!(list.iter().all(|file| file["file"].is_string()));
    // A pattern that no shell expanded gives a list even if it matches one file.
    let list: Value = serde_json::from_str(&info(&["data/*.obj", "--json"])).unwrap();
    assert_eq!(list[0]["format"], "Wavefront OBJ mesh");
    assert!(info(&["data/wake.x*"]).contains("bytes per particle"));
    assert!(info(&["data/vase.obj", "data/wake.xyz"]).starts_with("file "));

    for (arguments, says) in [
        (&["data/noise", "data/wake.q"][..], "none among 2"),
        (&["data/*.vti"], "files that it matches"),
        (&["data/noise"], "none of these"),
    ] {
        let refused = run(folder.path(), &[&["info"], arguments].concat());
        assert_eq!(refused.status.code(), Some(1));
        let message = text(&refused.stderr);
        assert!(
            message.starts_with("error: ") && message.contains(says),
            "{message}"
        );
    }
}

/// Files of other programs beside the data do not hide readable files: one line for each reason.
#[test]
fn info_of_a_folder_says_once_what_is_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for i in 0..5 {
        std::fs::write(
            path.join(format!("note{i}.txt")),
            "some words\nand others\n",
        )
        .unwrap();
        std::fs::write(path.join(format!("m{i}.mtl")), "newmtl a\nKd 1 1 1\n").unwrap();
    }
    std::fs::create_dir(path.join("a.zarr")).unwrap();
    std::fs::write(path.join("a.zarr/.zgroup"), "{\"zarr_format\": 2}").unwrap();
    for i in 0..9 {
        std::fs::write(path.join(format!("a.zarr/0.{i}")), [i, 255, 0]).unwrap();
    }
    std::fs::write(path.join("a.csv"), "x,y,z,sigma\n0,0,0,1\n1,0,0,1\n").unwrap();
    let output = run(path, &["info", "."]);
    assert!(output.status.success());
    let table = text(&output.stdout);
    let lines: Vec<&str> = table.lines().collect();
    let has = |part: &str| lines.iter().filter(|line| line.contains(part)).count();
    assert_eq!(
        has("5 files: not recognised: ./note0.txt") + has("5 files: not recognised: note0.txt"),
        1,
        "{table}"
    );
    assert_eq!(has("5 files: a library of materials (MTL)"), 1, "{table}");
    assert_eq!(
        (has("and 2 more"), has("a.zarr"), has("0.3")),
        (2, 1, 0),
        "{table}"
    );
    assert!(lines.len() < 9, "{table}");
}

/// A file that cannot be drawn still gets a geometry and fields, and a reason that does not refer
/// to `info`.
#[test]
fn info_explains_what_cannot_be_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let table = "x,y,z,scale_0,scale_1,scale_2,rot_0,rot_1,rot_2,rot_3,mass\n\
                 0,0,0,-3,-4,-2,1,0,0,0,.5\n0.0100000001,0,1,-3,-4,-2,1,0,0,0,.5\n";
    std::fs::write(folder.path().join("a.csv"), table).unwrap();
    // Logarithms are recognised by their signs.
    let output = run(folder.path(), &["info", "a.csv", "--json"]);
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["particles"], 2);
    assert!(info["problem"].is_null(), "{info}");
    let note = info["notes"][0].as_str().unwrap();
    assert!(
        note.contains("2 particles are taken as logarithms"),
        "{note}"
    );
    let linear = ["info", "a.csv", "--scales", "linear"];
    let output = run(folder.path(), &[&linear[..], &["--json"]].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["geometry"]["count"], 2);
    assert_eq!(info["fields"].as_array().unwrap().len(), 8);
    let problem = info["problem"].as_str().unwrap();
    assert!(problem.contains("2 particles left out"), "{problem}");
    assert!(!problem.contains("ewa-splat info"), "{problem}");
    let note = info["notes"][0].as_str().unwrap();
    assert!(
        note.contains("logarithms") && note.contains("--scales"),
        "{note}"
    );
    let output = run(folder.path(), &linear);
    let table = text(&output.stdout);
    assert!(table.contains("upper bound        0.01, 0, 1\n"), "{table}");
    assert!(table.contains("\nproblem "), "{table}");
    let radius = [&linear[..], &["--radius", ".1", "--json"]].concat();
    let output = run(folder.path(), &radius);
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["particles"], 2);
    assert!(info["problem"].is_null() && info["notes"][0].is_null());
    // A wrong field name is the user's error, not the file's.
    let refused = run(folder.path(), &["info", "a.csv", "--field", "rho"]);
    assert_eq!(refused.status.code(), Some(1));
}
