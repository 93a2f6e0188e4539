//! Reads VTK XML files, each with the reader for its type.

use super::dataset::Dataset;
use super::file::{HEAD, Input};
use super::{ReadAs, vti, vtk_amr, vtk_xml, vtp, vtr, vts, vtu};
use crate::error::{Error, Result};

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
pub(super) fn read(input: Input<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    let (head, _) = input.head(HEAD)?;
    match vtk_xml::file_type(&head).unwrap_or("") {
        "ImageData" | "PImageData" => vti::read(input),
        "RectilinearGrid" | "PRectilinearGrid" => vtr::read(input),
        "StructuredGrid" | "PStructuredGrid" => vts::read(input),
        "UnstructuredGrid" | "PUnstructuredGrid" => vtu::read(input, read_as),
        "PolyData" | "PPolyData" => vtp::read(input, read_as),
        kind if vtk_amr::TYPES.contains(&kind) => vtk_amr::read(input),
        kind => {
            let known = NOT_READ.iter().find(|(start, _)| kind.starts_with(start));
            let advice = known.map_or("save it as one of these", |(_, advice)| advice);
            Err(Error::format(
                input.path,
                "VTKFile, `type`",
                "ImageData, RectilinearGrid, StructuredGrid, UnstructuredGrid, PolyData or vtkOverlappingAMR",
                format!("`{}`, which is not read yet", vtk_xml::clip(kind)),
                advice,
            ))
        }
    }
}
