//! Finds the files of a series: those in a folder with the same `SeriesInstanceUID`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::image::{looks_bare, looks_like, series_of};
use crate::error::{Error, Result};
use crate::io::bytes::file::{HEAD, Input};

/// Greatest number of files of a folder that are read, more than in any series.
const MOST_FILES: usize = 1 << 16;

/// Number of first bytes that contain the series in nearly all files.
const START: usize = 1 << 14;

/// Files of one series, sorted by name.
pub(super) struct Series {
    pub(super) files: Vec<PathBuf>,
    pub(super) note: Option<String>,
}

/// Returns true if the first bytes may be those of a DICOM file.
pub(super) fn may_be(head: &[u8]) -> bool {
    looks_like(head) || looks_bare(head)
}

/// Returns the series of a file, if it is a DICOM file that states one.
fn series(path: &Path) -> Option<String> {
    let input = Input::of_file(path);
    let (head, _) = input.head(HEAD).ok()?;
    if !may_be(&head) {
        return None;
    }
    if let Some(uid) = series_of(&head) {
        return Some(uid);
    }
    let (head, len) = input.head(START).ok()?;
    let found = series_of(&head);
    match found {
        None if len > head.len() as u64 => series_of(&input.read_all().ok()?),
        found => found,
    }
}

/// Returns the files of a folder, limited in number and sorted by name.
fn listed(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder)?.take(MOST_FILES);
    let files = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut files = files.collect::<std::io::Result<Vec<_>>>()?;
    files.sort();
    Ok(files)
}

/// Returns the first file of the series with the most files in a folder. Returns `None` if most files of the folder
/// belong to no series.
pub(super) fn largest_in(folder: &Path) -> Option<PathBuf> {
    let mut series_of: BTreeMap<String, (usize, PathBuf)> = BTreeMap::new();
    let mut others = 0;
    for path in listed(folder).ok()? {
        match series(&path) {
            Some(uid) => series_of.entry(uid).or_insert((0, path)).0 += 1,
            None => others += usize::from(path.is_file()),
        }
    }
    let count: usize = series_of.values().map(|(count, _)| count).sum();
    let series = series_of.into_values().filter(|_| count >= others);
    let largest = series.max_by(|a, b| a.0.cmp(&b.0).then(b.1.cmp(&a.1)));
    largest.map(|(_, path)| path)
}

/// Returns all files of the series that a file belongs to.
///
/// # Errors
/// The folder cannot be listed.
pub(super) fn of(input: Input<'_>) -> Result<Series> {
    let path = input.path;
    let alone = || Series {
        files: vec![path.to_path_buf()],
        note: None,
    };
    // Bytes in memory have no folder.
    if !input.is_on_disk() {
        return Ok(alone());
    }
    let Some(own) = series(path).or_else(|| series_of(&input.read_all().ok()?)) else {
        return Ok(alone());
    };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let fault = |e| Error::io(folder, "listing the folder", e, "check its permissions");
    let mut files = Vec::new();
    let mut others: BTreeMap<String, usize> = BTreeMap::new();
    for file in listed(folder).map_err(fault)? {
        match series(&file) {
            Some(uid) if uid == own => files.push(file),
            Some(uid) => *others.entry(uid).or_default() += 1,
            None => {}
        }
    }
    // The given file itself may be missing from the list, if it was recognised only by its name.
    if !files
        .iter()
        .any(|file| file.file_name() == path.file_name())
    {
        files.push(path.to_path_buf());
    }
    let count: usize = others.values().sum();
    let note = (count > 0).then(|| {
        format!(
            "{count} files of {} other series in the folder are left out: name one of theirs to read it.",
            others.len()
        )
    });
    Ok(Series { files, note })
}
