//! Reads ParaView's collections: files by time step.
//!
//! ```text
//! <VTKFile type="Collection">
//!   <Collection>
//!     <DataSet timestep="0.5" part="0" file="x_0.vtu"/> ...
//!   </Collection>
//! </VTKFile>
//! ```
//!
//! A `file` is relative to the collection's folder. Entries with the same `timestep` (0 if none is stated) are
//! one step, with their files in the order of `part`. A collection names data, or VTK's collections of blocks
//! ([`super::collection`]), which are replaced by their files; never another collection of its own kind.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use super::collection;
use super::xml::{self, Frame, child, clip};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::time_steps::{Part, TimeStep};

/// The `type` of these files.
const TYPE: &str = collection::PARAVIEWS;

/// Greatest size of a collection in bytes: hundreds of thousands of entries. A larger file is no list of files.
const MOST_BYTES: u64 = 64 << 20;

/// Whether a file that begins with `head` is a collection.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    xml::looks_like(head) && xml::file_type(head) == Some(TYPE)
}

/// Returns the bytes of a list of files.
///
/// - `place`: place of the fault, if the file is too large for a list.
///
/// # Errors
/// The file cannot be read, or is larger than [`MOST_BYTES`].
pub(super) fn list_bytes<'a>(input: Input<'a>, place: &'static str) -> Result<Cow<'a, [u8]>> {
    let (_, len) = input.head(1)?;
    if len > MOST_BYTES {
        return Err(Error::format(
            input.path,
            place,
            format!("a list of files, of {MOST_BYTES} bytes at most"),
            format!("{len} bytes"),
            "give the files themselves",
        ));
    }
    input.read_all()
}

/// The steps, in the order of time; at least one. The named files are not checked to exist.
///
/// # Errors
/// A file that is no collection; entries without a file, with a time that is no number, that name one file
/// twice at one time, or that name a collection; no entries.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let path = input.path;
    let bytes = list_bytes(input, TYPE)?;
    let frame = Frame::new(path, &bytes)?;
    let document = frame.document()?;
    let root = document.root_element();
    let found = root.attribute("type").unwrap_or("");
    if root.tag_name().name() != "VTKFile" || found != TYPE {
        let found = format!("`{}`", clip(found));
        let advice = "give a .pvd file";
        return Err(Error::format(path, "VTKFile, `type`", TYPE, found, advice));
    }
    let damaged = "the collection is damaged: save it again";
    let entries = child(root, TYPE).ok_or_else(|| {
        let expected = "this element";
        Error::format(path, TYPE, expected, "none", damaged)
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut parts: Vec<(f64, i64, PathBuf)> = Vec::new();
    let of_data = entries.children().filter(|n| n.has_tag_name("DataSet"));
    for (i, node) in of_data.enumerate() {
        let place = |attribute: &str| format!("DataSet {i}, `{attribute}`");
        let stated = |attribute: &str| {
            let text = node.attribute(attribute).map(str::trim);
            text.filter(|text| !text.is_empty())
        };
        let fault = |attribute: &str, expected: &str, found: &str| {
            let found = format!("`{}`", clip(found));
            Error::format(path, place(attribute), expected, found, damaged)
        };
        let time = stated("timestep").map_or(Ok(0.0), |text| {
            let time = text.parse().ok().filter(|time: &f64| time.is_finite());
            time.ok_or_else(|| fault("timestep", "a finite number", text))
        })?;
        let part = stated("part").map_or(Ok(0), |text| {
            let part = text.parse().ok();
            part.ok_or_else(|| fault("part", "a whole number", text))
        })?;
        let file = stated("file").ok_or_else(|| fault("file", "the name of a file", ""))?;
        let file = folder.join(file);
        let is_nested = |ending: &OsStr| ending.eq_ignore_ascii_case("pvd");
        if file.extension().is_some_and(is_nested) {
            return Err(collection::refuse_nested(path, &place("file"), &file));
        }
        // Makes -0 equal to 0.
        parts.push((time + 0.0, part, file));
    }
    let steps = by_time(input, parts, damaged)?;
    if steps.is_empty() {
        let expected = "at least one `DataSet`";
        return Err(Error::format(path, TYPE, expected, "none", damaged));
    }
    Ok(steps)
}

/// The steps of files, in the order of their times and then of their parts' numbers. VTK's collections of
/// blocks are replaced by their files.
///
/// - `damaged`: advice if one file is named twice at one time.
///
/// # Errors
/// Such a file.
pub(in crate::io) fn by_time(
    input: Input<'_>,
    mut parts: Vec<(f64, i64, PathBuf)>,
    damaged: &str,
) -> Result<Vec<TimeStep>> {
    parts.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut steps: Vec<TimeStep> = Vec::new();
    for (time, _, file) in parts {
        // A collection that cannot be read stays: reading it reports the error.
        let is_of_blocks = collection::is_named(&file);
        let blocks = is_of_blocks.then(|| input.with_beside(&file, collection::files));
        let files = blocks.and_then(Result::ok).unwrap_or_else(|| vec![file]);
        let parts = files.into_iter().map(Part::file);
        match steps.last_mut() {
            Some(step) if step.time == Some(time) => step.parts.extend(parts),
            _ => steps.push(TimeStep {
                time: Some(time),
                parts: parts.collect(),
            }),
        }
    }
    for step in &steps {
        let mut files: Vec<&PathBuf> = step.parts.iter().map(|part| &part.path).collect();
        files.sort();
        if let Some(twice) = files.windows(2).find(|pair| pair[0] == pair[1]) {
            let place = format!("files of time {}", step.time.unwrap_or(0.0));
            let found = format!("`{}` again", clip(&twice[0].display().to_string()));
            let expected = "each file once";
            return Err(Error::format(input.path, place, expected, found, damaged));
        }
    }
    Ok(steps)
}
