//! Reads VTK polygonal data (`.vtp`, `.pvtp`): points, lines, polygons and strips of triangles.
//!
//! ```text
//! <PolyData>
//!   <Piece NumberOfPoints="n" NumberOfVerts="..." NumberOfLines="..." NumberOfStrips="..."
//!          NumberOfPolys="...">
//!     <PointData> ... </PointData> <CellData> ... </CellData>
//!     <Points> <DataArray NumberOfComponents="3" .../> </Points>
//!     <Verts> <DataArray Name="connectivity"/> <DataArray Name="offsets"/> </Verts>
//!     <Lines> ... </Lines> <Strips> ... </Strips> <Polys> ... </Polys>
//!   </Piece> ...
//! </PolyData>
//! ```
//!
//! Cells are numbered through all four elements, in the order verts, lines, polys, strips, which is not the
//! order in the file. Several pieces are put one after another.

use std::path::Path;

use super::meshes::{Part, Runs, join};
use super::pieces::{self, Piece};
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;

/// An element, the attribute with its number of cells, and the kind of a cell by its number of nodes.
type Element = (&'static str, &'static str, fn(usize) -> CellKind);

/// The elements, in the order in which cells are numbered.
pub(in crate::io) const ELEMENTS: [Element; 4] = [
    ("Verts", "NumberOfVerts", |nodes| match nodes {
        1 => CellKind::VERTEX,
        _ => CellKind::POLY_VERTEX,
    }),
    ("Lines", "NumberOfLines", |nodes| match nodes {
        2 => CellKind::LINE,
        _ => CellKind::POLY_LINE,
    }),
    ("Polys", "NumberOfPolys", |nodes| match nodes {
        3 => CellKind::TRIANGLE,
        4 => CellKind::QUAD,
        _ => CellKind::POLYGON,
    }),
    ("Strips", "NumberOfStrips", |_| CellKind::TRIANGLE_STRIP),
];

/// Reads polygonal data.
///
/// # Errors
/// A file of another type; damaged arrays; cells with nodes that do not exist.
pub(crate) fn read(input: Input<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    let path = input.path;
    let ((), parts) = pieces::read(
        input,
        "PolyData",
        |_, _| Ok(()),
        |(), piece| {
            let mut cell_counts = [0; 4];
            for (count, (_, attribute, _)) in cell_counts.iter_mut().zip(ELEMENTS) {
                *count = piece.count(attribute)?;
            }
            let cell_count = cell_counts
                .iter()
                .fold(0, |a: usize, &b| a.saturating_add(b));
            Part::read(piece, cell_count, || read_cells(piece, cell_counts))
        },
    )?;
    join(path, "VTK polygonal data", parts, read_as)
}

/// The cells of a piece, without the nodes' positions.
fn read_cells(piece: Piece<'_>, counts: [usize; 4]) -> Result<CellMesh> {
    let mut mesh = CellMesh {
        offsets: vec![0],
        ..CellMesh::default()
    };
    for ((element, _, kind), count) in ELEMENTS.into_iter().zip(counts) {
        if count == 0 {
            continue;
        }
        let runs = Runs::read(piece, element, count)?;
        append(piece.path, &mut mesh, &runs, kind)?;
    }
    Ok(mesh)
}

/// Appends cells; their kinds follow from their numbers of nodes.
///
/// # Errors
/// More entries than `u32` counts.
pub(in crate::io) fn append(
    path: &Path,
    mesh: &mut CellMesh,
    runs: &Runs,
    kind: fn(usize) -> CellKind,
) -> Result<()> {
    for i in 0..runs.offsets.len() - 1 {
        let cell = runs.cell(i);
        mesh.kinds.push(kind(cell.len()));
        mesh.connectivity.extend_from_slice(cell);
        let end = u32::try_from(mesh.connectivity.len()).map_err(|_| {
            let expected = format!("at most {} entries of cells", u32::MAX);
            let advice = "save the data in several pieces, and read them one by one";
            Error::format(path, "cells", expected, "more", advice)
        })?;
        mesh.offsets.push(end);
    }
    Ok(())
}
