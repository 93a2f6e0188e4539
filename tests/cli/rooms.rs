//! Imports among the files of `src`: rooms import lower rooms only, and no two files import each other.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Rooms from the lowest to the highest; those in one row may import one another.
const ROOMS: [&[&str]; 17] = [
    &[
        "breadth",
        "clock",
        "collective",
        "constants",
        "error",
        "image",
        "math",
        "memory",
        "message",
        "opened",
        "parallel",
        "simd",
        "stats",
        "task",
    ],
    &["scene", "view"],
    &["data"],
    &["io"],
    &["edit"],
    &["sample"],
    &["reference"],
    &["record"],
    &["splat"],
    &["blocks"],
    &["prepared"],
    // A back end is named in the settings, and devices belong to theirs.
    &["frame", "cpu", "gpu"],
    &["ranks", "render"],
    &["load"],
    &["annotate", "legend", "measure", "overlay"],
    &["session"],
    &["command"],
];

/// A path of names: `crate`, `io`, `vtk`, `Piece`.
type Names = Vec<String>;

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The module of a file, named by its path below `src`.
fn module(file: &str) -> Names {
    let mut names: Names = file
        .trim_end_matches(".rs")
        .split('/')
        .map(String::from)
        .collect();
    if names
        .last()
        .is_some_and(|last| last == "mod" || last == "lib")
    {
        names.pop();
    }
    names.insert(0, "crate".into());
    names
}

/// The `use` statements of a file outside its tests: whether each is a re-export, and the tree that it names.
fn uses(text: &str) -> Vec<(bool, String)> {
    let code = text.split("\n#[cfg(test)]\n").next().unwrap_or_default();
    let mut found = Vec::new();
    let mut lines = code.lines();
    while let Some(line) = lines.next() {
        let line = line.trim_start();
        let is_public = line.starts_with("pub");
        let Some(start) = line.strip_prefix("use ").or_else(|| {
            let after = line.split_once(" use ")?;
            is_public.then_some(after.1)
        }) else {
            continue;
        };
        let mut tree = start.to_string();
        while !tree.contains(';') {
            let Some(more) = lines.next() else { break };
            tree.push_str(more.trim());
        }
        found.push((is_public, tree.split(';').next().unwrap().to_string()));
    }
    found
}

/// All paths of a tree such as `super::{a, b::{c, d as e}}`.
fn leaves(prefix: &[String], tree: &str, out: &mut Vec<Names>) {
    let names = |text: &str| -> Names {
        let parts = text
            .split("::")
            .map(str::trim)
            .filter(|part| !part.is_empty());
        parts.map(String::from).collect()
    };
    let Some((head, body)) = tree.split_once('{') else {
        let path = tree.split(" as ").next().unwrap_or_default();
        let path = [prefix, &names(path)].concat();
        out.push(
            path.into_iter()
                .filter(|name| name != "self" && name != "*")
                .collect(),
        );
        return;
    };
    let prefix = [prefix, &names(head)].concat();
    let body = &body[..body.rfind('}').unwrap_or(body.len())];
    let mut depth = 0;
    let parts = body.split(|c: char| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    });
    for part in parts.filter(|part| !part.trim().is_empty()) {
        leaves(&prefix, part, out);
    }
}

/// The files that each file imports from. A room's `mod.rs` that re-exports its own files does not depend on them.
fn imports() -> BTreeMap<String, BTreeSet<String>> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    rust_files(&source, &mut paths);
    let names = paths.iter().map(|path| {
        let below = path.strip_prefix(&source).unwrap();
        below.to_str().unwrap().replace('\\', "/")
    });
    let files: BTreeMap<Names, String> = names.map(|name| (module(&name), name)).collect();
    let mut all = BTreeMap::new();
    for (own, file) in &files {
        let mut targets = BTreeSet::new();
        for (is_public, tree) in uses(&std::fs::read_to_string(source.join(file)).unwrap()) {
            let mut paths = Vec::new();
            leaves(&[], &tree, &mut paths);
            for path in paths {
                let mut at = own.clone();
                let mut path = path.as_slice();
                match path.first().map(String::as_str) {
                    Some("crate") => at = Vec::new(),
                    Some("super") => {
                        while let Some(("super", rest)) =
                            path.split_first().map(|(a, b)| (a.as_str(), b))
                        {
                            at.pop();
                            path = rest;
                        }
                    }
                    _ => {}
                }
                at.extend_from_slice(path);
                // A path of another crate is none of a file here.
                let target = (1..=at.len())
                    .rev()
                    .find_map(|n| files.get_key_value(&at[..n]));
                let Some((module, target)) = target.filter(|(module, _)| *module != own) else {
                    continue;
                };
                if !(is_public && module.starts_with(own)) {
                    targets.insert(target.clone());
                }
            }
        }
        all.insert(file.clone(), targets);
    }
    all
}

#[test]
fn rooms_import_lower_rooms() {
    let height = |file: &str| {
        let room = file.split('/').next().unwrap().trim_end_matches(".rs");
        ROOMS.iter().position(|rooms| rooms.contains(&room))
    };
    let all = imports();
    assert!(all.len() > 400, "{}", all.len());
    for (file, targets) in all {
        if ["lib.rs", "bin/ewa-splat.rs"].contains(&file.as_str()) {
            continue;
        }
        let own = height(&file).unwrap_or_else(|| panic!("no room of {file}"));
        for target in targets {
            // The library's front page re-exports from all rooms.
            let is_lower = target == "lib.rs" || height(&target) <= Some(own);
            assert!(is_lower, "{file} imports {target}, which lies higher");
        }
    }
}

#[test]
fn no_two_files_import_each_other() {
    let all = imports();
    let reached = |from: &String| {
        let mut seen = BTreeSet::new();
        let mut left: Vec<&String> = all[from].iter().collect();
        while let Some(file) = left.pop() {
            if seen.insert(file.clone()) {
                left.extend(all[file].iter());
            }
        }
        seen
    };
    let reached: BTreeMap<&String, BTreeSet<String>> =
        all.keys().map(|file| (file, reached(file))).collect();
    let mut firsts = BTreeSet::new();
    for (file, seen) in &reached {
        if seen.contains(*file) {
            let circle = seen.iter().filter(|other| reached[other].contains(*file));
            firsts.insert(circle.min().unwrap().clone());
        }
    }
    assert!(
        firsts.is_empty(),
        "circles of imports, by their first files: {firsts:?}"
    );
}
