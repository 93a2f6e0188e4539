//! Expands inputs to files: names, folders and patterns.

use std::path::{Path, PathBuf};

use crate::io::{OpenOptions, format_of, refused};
use crate::{Error, Result};

/// Files that the inputs name.
pub(crate) struct Files {
    pub(crate) paths: Vec<PathBuf>,
    /// True if the inputs may name several files: anything but a single file name.
    pub(crate) is_list: bool,
}

impl Files {
    /// Expands folders and patterns.
    ///
    /// A folder that is not itself a data set stands for all files in it and in its subfolders. A
    /// name with `*`, `?` or `[...]` that names no file stands for the files that it matches, for
    /// shells that do not expand patterns. Files are in the order of their names.
    ///
    /// # Errors
    /// Patterns that match nothing or have wrong syntax; folders that cannot be read.
    pub(crate) fn of(inputs: &[PathBuf]) -> Result<Self> {
        let mut paths = Vec::new();
        let mut is_list = inputs.len() != 1;
        for input in inputs {
            if is_list_of_files(input) {
                is_list = true;
                walk(input, &mut paths)?;
            } else if is_pattern(input) && !input.exists() {
                is_list = true;
                for path in matching(input)? {
                    if is_list_of_files(&path) {
                        walk(&path, &mut paths)?;
                    } else {
                        paths.push(path);
                    }
                }
            } else {
                paths.push(input.clone());
            }
        }
        Ok(Self { paths, is_list })
    }
}

fn is_pattern(path: &Path) -> bool {
    path.to_str()
        .is_some_and(|text| text.contains(['*', '?', '[']))
}

fn matching(pattern: &Path) -> Result<Vec<PathBuf>> {
    let fault = |expected: &str, found: String| {
        Error::format(pattern, "pattern", expected, found, "correct the pattern")
    };
    let matches = glob::glob(&pattern.to_string_lossy())
        .map_err(|e| fault("a pattern of *, ?, [...] and **", e.msg.into()))?;
    let paths: Vec<PathBuf> = matches.filter_map(std::result::Result::ok).collect();
    if paths.is_empty() {
        return Err(fault("files that it matches", "none".into()));
    }
    Ok(paths)
}

/// Returns true if a path is a folder that is not itself a data set. A folder in a known but
/// unsupported format counts as a data set.
fn is_list_of_files(path: &Path) -> bool {
    path.is_dir()
        && refused::folder(path).is_none()
        && format_of(path, &OpenOptions::default()).is_err()
}

/// Collects all files below a folder. It does not follow links to folders: they may form cycles.
fn walk(folder: &Path, paths: &mut Vec<PathBuf>) -> Result<()> {
    let fault = |e| Error::io(folder, "listing the folder", e, "check its permissions");
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fault)? {
        let entry = entry.map_err(fault)?;
        entries.push((entry.path(), entry.file_type().map_err(fault)?));
    }
    entries.sort_by(|a, b| a.0.cmp(&b.0));
    for (path, kind) in entries {
        if kind.is_dir() && is_list_of_files(&path) {
            walk(&path, paths)?;
        } else if kind.is_dir() || path.is_file() {
            paths.push(path);
        }
    }
    Ok(())
}
