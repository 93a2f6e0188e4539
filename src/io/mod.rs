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
mod csv;
mod dataset;
mod file;
mod image_file;
mod npy;
mod plot3d;
mod raw;
mod scalars;
mod table;

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
    /// Enough for every magic number and the dimensions of a grid.
    const HEAD: usize = 4096;
    if let Some(layout) = &options.raw {
        return raw::read(path, layout);
    }
    let (head, len) = file::read_head(path, HEAD)?;
    if head.starts_with(npy::MAGIC) {
        return npy::read(path);
    }
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("csv" | "tsv") => csv::read(path),
        Some("raw" | "gz") => Err(needs_layout(path, len)),
        Some("xyz" | "x" | "p3d") => plot3d::read(path, options.solution.as_deref()),
        _ if plot3d::looks_like_grid(&head, len) => plot3d::read(path, options.solution.as_deref()),
        _ => Err(unknown(
            path,
            &format!("the extension `{}` and bytes of no known format", extension.unwrap_or_default()),
            "convert it to one of these, or give --dims for a raw volume",
        )),
    }
}

/// The error for a raw file without a layout, with the options that its name suggests.
fn needs_layout(path: &Path, len: u64) -> Error {
    let advice = match raw::options_from_name(path) {
        Some(options) => format!("its name suggests {options}"),
        None => "add --dims X,Y,Z and --type u8|i16|u16|f32".to_string(),
    };
    let found = format!("{len} bytes without a header");
    Error::format(path, "layout", "--dims, since a raw volume does not say its own", found, advice)
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
