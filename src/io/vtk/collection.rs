//! Reads VTK's collections of blocks (`.vtm`, `.vtmb`, `.vtpc`, `.vtpd`): files that are drawn together.
//!
//! ```text
//! <VTKFile type="vtkMultiBlockDataSet">
//!   <vtkMultiBlockDataSet>
//!     <Block index="0"> <DataSet index="0" file="a/a_0.vti"/> ... </Block>
//!     <Piece index="1"> <DataSet index="0" file="a/a_1.vtp"/> ... </Piece>
//!     <DataSet index="2" file="a/a_2.vtu"/>
//!   </vtkMultiBlockDataSet>
//! </VTKFile>
//! ```
//!
//! `vtkMultiPieceDataSet`, `vtkPartitionedDataSet` and `vtkPartitionedDataSetCollection` (with `Partitions` for
//! `Piece`) are alike. A `file` lies beside the collection or in a folder below. A `DataSet` without `file` is
//! empty. A collection that another names is replaced by its files.

use std::path::{Path, PathBuf};

use roxmltree::Node;

use super::xml::{self, Frame, child_among, clip};
use crate::data::dataset::Dataset;
use crate::error::{Advice, Error, Result};
use crate::io::bytes::file::{HEAD, Input, extension};
use crate::io::format::Recognise;
use crate::io::options::OpenOptions;
use crate::io::time_steps::{Part, TimeStep};
use crate::io::volume::voxels;

/// Extensions of these files.
pub(in crate::io) const ENDINGS: [&str; 4] = ["vtm", "vtmb", "vtpc", "vtpd"];

const TYPES: [&str; 4] = [
    "vtkMultiBlockDataSet",
    "vtkMultiPieceDataSet",
    "vtkPartitionedDataSet",
    "vtkPartitionedDataSetCollection",
];

/// The type of ParaView's collections of time steps.
pub(in crate::io) const PARAVIEWS: &str = "Collection";

/// Elements that contain others.
const GROUPS: [&str; 3] = ["Block", "Piece", "Partitions"];

/// Greatest size of a collection in bytes. A larger file is no list of files.
const MOST_BYTES: u64 = 64 << 20;

/// Greatest depth of groups in groups, and of collections in collections.
const DEEPEST: usize = 32;

/// Greatest number of files in all collections together.
const MOST_FILES: usize = 1 << 20;

const DAMAGED: &str = "the collection is damaged: save it again";

/// Whether a file that begins with `head` is such a collection.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let kind = xml::looks_like(head).then(|| xml::file_type(head));
    kind.flatten().is_some_and(|kind| TYPES.contains(&kind))
}

/// All files as the parts of one step without a time. Files of data are not checked to exist.
///
/// # Errors
/// A file that is no collection; a collection that contains itself, names a file outside its folder, or names
/// none.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let parts = files(input)?.into_iter().map(Part::file).collect();
    Ok(vec![TimeStep { time: None, parts }])
}

/// The files of data in a collection and in the collections that it names.
///
/// # Errors
/// The errors of [`steps`].
pub(in crate::io) fn files(input: Input<'_>) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    collect(input, &mut Vec::new(), &mut files)?;
    if files.is_empty() {
        let expected = "at least one `DataSet` with a `file`";
        let advice = Advice::no_data(DAMAGED);
        return Err(Error::format(
            input.path, "DataSet", expected, "none", advice,
        ));
    }
    Ok(files)
}

/// Whether a file name is that of a collection.
pub(in crate::io) fn is_named(path: &Path) -> bool {
    ENDINGS.contains(&extension(path).as_str())
}

/// - `within`: the chain of collections that led here, each by one path however it was named.
fn collect(input: Input<'_>, within: &mut Vec<PathBuf>, files: &mut Vec<PathBuf>) -> Result<()> {
    let path = input.path;
    let (head, len) = input.head(HEAD)?;
    if len > MOST_BYTES || !looks_like(&head) {
        let expected = format!("one of {}, of {MOST_BYTES} bytes at most", TYPES.join(", "));
        let kind = xml::file_type(&head).unwrap_or("");
        let found = format!("`{}`, {len} bytes", xml::clip(kind));
        return Err(Error::format(
            path,
            "VTKFile, `type`",
            expected,
            found,
            DAMAGED,
        ));
    }
    let own = input.resolved_beside(path);
    let own = own.unwrap_or_else(|| path.to_path_buf());
    if within.len() >= DEEPEST || within.contains(&own) {
        let found = format!("`{}` again", xml::clip(&path.display().to_string()));
        let expected = "collections that do not name themselves";
        return Err(Error::format(
            path,
            "DataSet, `file`",
            expected,
            found,
            DAMAGED,
        ));
    }
    within.push(own);
    let bytes = input.read_all()?;
    let frame = Frame::new(path, &bytes)?;
    let document = frame.document()?;
    let whole = child_among(document.root_element(), &TYPES);
    let mut named = Vec::new();
    if let Some(whole) = whole {
        walk(path, whole, 0, &mut named)?;
    }
    for file in named {
        // Files of refinement levels have used the same extension.
        let begins = |nested: Input<'_>| Ok(looks_like(&nested.head(HEAD)?.0));
        if is_named(&file) && input.with_beside(&file, begins)? {
            input.with_beside(&file, |nested| collect(nested, within, files))?;
        } else if files.len() >= MOST_FILES {
            let expected = format!("{MOST_FILES} files at most");
            return Err(Error::format(
                path,
                "DataSet, `file`",
                expected,
                "more",
                DAMAGED,
            ));
        } else {
            files.push(file);
        }
    }
    within.pop();
    Ok(())
}

/// The files that an element and its children name, in their order, each once.
fn walk(path: &Path, node: Node<'_, '_>, depth: usize, files: &mut Vec<PathBuf>) -> Result<()> {
    if depth > DEEPEST {
        let expected = format!("blocks in blocks {DEEPEST} deep at most");
        return Err(Error::format(path, "Block", expected, "more", DAMAGED));
    }
    for child in node.children() {
        if GROUPS.iter().any(|group| child.has_tag_name(*group)) {
            walk(path, child, depth + 1, files)?;
        } else if child.has_tag_name("DataSet")
            && let Some(file) = child.attribute("file").filter(|file| !file.is_empty())
        {
            files.push(voxels::beside_as(path, "DataSet, `file`", file)?);
        }
    }
    Ok(())
}

/// Reads the first part of the first step that has any, with notes on the other steps and parts.
///
/// # Errors
/// The errors of the part; a part that is a collection.
pub(in crate::io) fn read_first(
    input: Input<'_>,
    steps: &[TimeStep],
    options: &OpenOptions,
    recognise: Recognise,
) -> Result<Dataset> {
    let (first, count) = (&steps[0], steps.len());
    let mut notes = Vec::new();
    if let (true, Some(time)) = (count > 1, first.time) {
        notes.push(format!("The first of {count} time steps, of time {time}."));
    }
    if first.parts.len() > 1 {
        let parts = first.parts.len();
        let of = first.time.map_or("", |_| " of the time step");
        notes.push(format!("The first of {parts} parts{of}."));
    }
    let read = |file: &PathBuf| {
        input.with_beside(file, |part| {
            // A collection's file could name the collection again.
            let head = part.head(HEAD)?.0;
            if looks_like(&head) || xml::file_type(&head) == Some(PARAVIEWS) {
                return Err(refuse_nested(input.path, "DataSet, `file`", file));
            }
            recognise(part, options)?.open(part, options)
        })
    };
    let mut nothing = None;
    for (empty, part) in first.parts.iter().enumerate() {
        let mut data = match read(&part.path) {
            Err(error) if error.holds_nothing() => {
                nothing.get_or_insert(error);
                continue;
            }
            data => data?,
        };
        if empty > 0 {
            notes.push(format!("{empty} parts before it hold nothing to draw."));
        }
        data.notes.extend(notes);
        return Ok(data);
    }
    Err(nothing.unwrap_or_else(|| {
        let expected = "at least one part";
        Error::format(input.path, "DataSet", expected, "none", DAMAGED)
    }))
}

/// The error for a collection that names another where this is not allowed.
pub(in crate::io) fn refuse_nested(path: &Path, place: &str, file: &Path) -> Error {
    Error::format(
        path,
        place,
        "a file of data",
        format!(
            "another collection, `{}`",
            clip(&file.display().to_string())
        ),
        "give that one instead",
    )
}
