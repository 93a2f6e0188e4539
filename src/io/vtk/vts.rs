//! Reads VTK structured grids (`.vts`, `.pvts`): curvilinear grids.
//!
//! ```text
//! <StructuredGrid WholeExtent="i0 i1 j0 j1 k0 k1">
//!   <Piece Extent="i0 i1 j0 j1 k0 k1">
//!     <PointData> ... </PointData> <CellData> ... </CellData>
//!     <Points> <DataArray NumberOfComponents="3" .../> </Points>
//!   </Piece> ...
//! </StructuredGrid>
//! ```
//!
//! Nodes are stored i fastest, then j, then k. Several pieces are put together, see
//! [`super::extent`].

use std::path::Path;

use glam::DVec3;

use super::extent::{Extent, Part, check_cover, join, place};
use super::pieces::{self, Piece};
use crate::data::association::Association;
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, Geometry};
use crate::error::Result;
use crate::io::bytes::file::Input;

/// The format's name, for people.
pub(in crate::io) const FORMAT: &str = "VTK structured grid";

/// The `type` of such a file.
pub(in crate::io) const KIND: &str = "StructuredGrid";

/// Reads a structured grid.
///
/// # Errors
/// A file of another type; damaged arrays; pieces that do not make up the whole.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let (whole, parts) = pieces::read(input, KIND, Extent::whole, read_part)?;
    let (nodes, fields, notes) = joined(path, &whole, parts)?;
    let dims = whole.dims(Association::Nodes);
    let blocks = vec![CurvilinearBlock { dims, nodes }];
    let geometry = Geometry::Curvilinear { blocks };
    Ok(Dataset {
        notes,
        ..Dataset::new(path, FORMAT, geometry, fields)
    })
}

/// Joined nodes and fields of pieces, and notes on what was left out.
///
/// # Errors
/// Pieces that do not make up the whole.
pub(in crate::io) fn joined(
    path: &Path,
    whole: &Extent,
    parts: Vec<Part<Vec<DVec3>>>,
) -> Result<(Vec<DVec3>, Vec<Field>, Vec<String>)> {
    let (parts, mut nodes): (Vec<_>, Vec<_>) = parts.into_iter().map(Part::split).unzip();
    let nodes = match nodes.as_mut_slice() {
        [(extent, nodes)] if *extent == *whole => std::mem::take(nodes),
        _ => {
            let extents: Vec<Extent> = nodes.iter().map(|(extent, _)| *extent).collect();
            check_cover(path, whole, &extents, Association::Nodes, "Points")?;
            let parts = nodes.into_iter();
            place(whole, Association::Nodes, DVec3::NAN, parts, |_, b| b)
        }
    };
    let (fields, notes) = join(path, whole, parts)?;
    Ok((nodes, fields, notes))
}

/// A piece with its own nodes.
pub(in crate::io) fn read_part(
    whole: &Extent,
    piece: Piece<'_>,
) -> Result<Option<Part<Vec<DVec3>>>> {
    let Some(part) = Part::read(whole, piece)? else {
        return Ok(None);
    };
    let count = part.extent.count(Association::Nodes).unwrap_or(usize::MAX);
    let node = piece.only_array("Points")?;
    let nodes = piece.decoder.points(node, count)?;
    Ok(Some(part.with(nodes)))
}
