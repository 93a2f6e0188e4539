//! Reads VTK XML files, each with the reader for its type.

use super::{amr, vti, vtp, vtr, vts, vtu, xml};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::{HEAD, Input};
use crate::io::options::ReadAs;

/// Types that are not read: their prefixes, and advice.
const NOT_READ: &[(&str, &str)] = &[
    (
        "vtkNonOverlapping",
        "give one of the files that it names, or resample it to ImageData (.vti)",
    ),
    ("HyperTreeGrid", "resample it to ImageData (.vti)"),
    ("PHyperTreeGrid", "resample it to ImageData (.vti)"),
    ("Table", "export it as CSV with columns x, y and z"),
    ("PTable", "export it as CSV with columns x, y and z"),
];

/// Reads a file of data, or an index of pieces.
///
/// # Errors
/// Another type; errors of the type's reader.
pub(in crate::io) fn read(input: Input<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    let (head, _) = input.head(HEAD)?;
    match xml::file_type(&head).unwrap_or("") {
        "ImageData" | "PImageData" => vti::read(input),
        "RectilinearGrid" | "PRectilinearGrid" => vtr::read(input),
        "StructuredGrid" | "PStructuredGrid" => vts::read(input),
        "UnstructuredGrid" | "PUnstructuredGrid" => vtu::read(input, read_as),
        "PolyData" | "PPolyData" => vtp::read(input, read_as),
        kind if amr::TYPES.contains(&kind) => amr::read(input),
        kind => {
            let known = NOT_READ.iter().find(|(start, _)| kind.starts_with(start));
            let advice = known.map_or("save it as one of these", |(_, advice)| advice);
            Err(Error::format(
                input.path,
                "VTKFile, `type`",
                "ImageData, RectilinearGrid, StructuredGrid, UnstructuredGrid, PolyData or vtkOverlappingAMR",
                format!("`{}`, which is not read yet", xml::clip(kind)),
                advice,
            ))
        }
    }
}
