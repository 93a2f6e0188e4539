//! Files in and out, one file of code per format.
//!
//! | file | format |
//! |---|---|
//! | `raw.rs` | headerless volumes |
//! | `vti.rs`, `vtk_xml.rs` | VTK XML image data |
//! | `plot3d.rs` | PLOT3D grids and solutions |
//! | `csv.rs`, `npy.rs` | particle tables |
//! | `image_file.rs` | pictures: PNG, EXR, PFM, NPY |
//! | `atomic.rs` | files written whole or not at all |

mod atomic;
mod dataset;
mod image_file;
mod plot3d;
mod raw;

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

pub use atomic::write_bytes_atomically;
pub use dataset::{Association, Dataset, Field, FieldSource, Geometry};
pub use image_file::{check_extension, read_image, write_depth, write_image};
pub use raw::{RawLayout, RawType};

/// What a reader cannot know from the file itself.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// The layout of a raw volume; where it is given, the file is read as one.
    pub raw: Option<RawLayout>,
    /// The solution of a PLOT3D grid; `None` looks for one beside it.
    pub solution: Option<PathBuf>,
}

/// Reads a file, recognised by its content and then by its name.
///
/// # Errors
/// A file that cannot be read, is empty, or is of no known format; and what the format's reader
/// says.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Dataset> {
    let bytes = read_file(path)?;
    if let Some(layout) = &options.raw {
        return raw::read(path, bytes, layout);
    }
    let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let extension = name.rsplit_once('.').map_or("", |(_, e)| e);
    if bytes.starts_with(b"\x93NUMPY") {
        return npy::read(path, &bytes);
    }
    if starts_like_xml(&bytes) {
        return vti::read(path, &bytes);
    }
    if bytes.starts_with(b"# vtk DataFile") {
        return Err(unknown(path, "a legacy VTK file", "write it as VTK XML image data (.vti)"));
    }
    match extension {
        "csv" | "tsv" | "txt" => csv::read(path, &bytes),
        "raw" | "gz" => Err(raw::needs_layout(path, bytes.len())),
        "xyz" | "x" | "p3d" | "bin" => plot3d::read(path, &bytes, options.solution.as_deref()),
        _ => Err(unknown(
            path,
            &format!("the extension `{extension}` and bytes of no known format"),
            "convert it to one of these, or give --dims for a raw volume",
        )),
    }
}

fn starts_like_xml(bytes: &[u8]) -> bool {
    let head = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let start = head.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(0);
    head[start..].starts_with(b"<?xml") || head[start..].starts_with(b"<VTKFile")
}

fn unknown(path: &Path, found: &str, advice: &str) -> Error {
    Error::format(
        path,
        "file format",
        "VTK image data (.vti), a PLOT3D grid (.xyz, .bin), a table (.csv, .npy) or a raw volume",
        found,
        advice,
    )
}

/// All bytes of a file that has some.
fn read_file(path: &Path) -> Result<Vec<u8>> {
    let io = |place, e| Error::io(path, place, e, "check the path and its permissions");
    let metadata = std::fs::metadata(path).map_err(|e| io("opening", e))?;
    if !metadata.is_file() {
        return Err(Error::format(path, "opening", "a file", "something else", "name a file"));
    }
    let bytes = std::fs::read(path).map_err(|e| io("reading", e))?;
    if bytes.is_empty() {
        return Err(Error::format(path, "byte 0", "data", "an empty file", "check its origin"));
    }
    Ok(bytes)
}
