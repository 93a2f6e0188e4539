//! Reads VTK unstructured grids (`.vtu`, `.pvtu`): cells of any shape over shared nodes.
//!
//! ```text
//! <UnstructuredGrid>
//!   <Piece NumberOfPoints="n" NumberOfCells="m">
//!     <PointData> ... </PointData> <CellData> ... </CellData>
//!     <Points> <DataArray NumberOfComponents="3" .../> </Points>
//!     <Cells>
//!       <DataArray Name="connectivity"/>  nodes of one cell after those of another
//!       <DataArray Name="offsets"/>       where each cell's nodes end
//!       <DataArray Name="types"/>         VTK's number for each cell's kind
//!     </Cells>
//!   </Piece> ...
//! </UnstructuredGrid>
//! ```
//!
//! Several pieces are put one after another. Polyhedra have faces besides, in one of two forms:
//!
//! | until version 2.2 | |
//! |---|---|
//! | `faces` | for each polyhedron the number of its faces, then for each face the number of its nodes and the nodes |
//! | `faceoffsets` | for each cell the end of its entries in `faces`, or -1 |
//!
//! | version 2.3 | |
//! |---|---|
//! | `face_connectivity`, `face_offsets` | the nodes of all faces, concatenated, and the end of each face |
//! | `polyhedron_to_faces`, `polyhedron_offsets` | the faces of all cells, concatenated, and the end of each cell |

use super::meshes::{
    Part, Runs, face_streams, join, read_indices, read_offsets, with_polyhedra, without_nodes,
};
use super::pieces::{self, Piece};
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;

/// The format's name, for people.
pub(in crate::io) const FORMAT: &str = "VTK unstructured grid";

/// The `type` of such a file.
pub(in crate::io) const KIND: &str = "UnstructuredGrid";

const CELLS: &str = "Cells";

/// Reads an unstructured grid.
///
/// # Errors
/// A file of another type; damaged arrays; cells with nodes that do not exist.
pub(crate) fn read(input: Input<'_>, read_as: Option<ReadAs>) -> Result<Dataset> {
    let path = input.path;
    let ((), parts) = pieces::read(input, KIND, |_, _| Ok(()), |(), piece| read_part(piece))?;
    join(path, FORMAT, parts, read_as)
}

/// Reads a piece; `None` if it is empty.
pub(in crate::io) fn read_part(piece: Piece<'_>) -> Result<Option<Part>> {
    let cell_count = piece.count("NumberOfCells")?;
    Part::read(piece, cell_count, || read_cells(piece, cell_count))
}

/// The cells of a piece, without the nodes' positions.
fn read_cells(piece: Piece<'_>, count: usize) -> Result<CellMesh> {
    if count == 0 {
        return Ok(CellMesh {
            offsets: vec![0],
            ..CellMesh::default()
        });
    }
    let types = piece.array_named(CELLS, "types");
    let types = types.ok_or_else(|| piece.missing("Cells, `types`"))?;
    let kinds = piece
        .decoder
        .integers(types, Some(count), "kinds from 0 to 255", |n| {
            u8::try_from(n).ok().map(CellKind)
        })?;
    let runs = Runs::read(piece, CELLS, count)?;
    if !kinds.contains(&CellKind::POLYHEDRON) {
        return Ok(without_nodes(kinds, runs));
    }
    let faces = if piece.array_named(CELLS, "polyhedron_offsets").is_some() {
        read_shared_faces(piece, count)?
    } else {
        read_face_streams(piece, count)?
    };
    with_polyhedra(piece.path, kinds, &runs, &faces)
}

/// Reads `faces` and `faceoffsets`, which already have the form of [`CellMesh`].
fn read_face_streams(piece: Piece<'_>, count: usize) -> Result<Runs> {
    let ends = piece.array_named(CELLS, "faceoffsets");
    let ends = ends.ok_or_else(|| piece.missing("Cells, `faceoffsets`"))?;
    let expected = "whole numbers from 0 to 4294967295, or -1";
    let end = |n| {
        if n == -1 {
            Some(None)
        } else {
            u32::try_from(n).ok().map(Some)
        }
    };
    let ends = piece.decoder.integers(ends, Some(count), expected, end)?;
    let mut offsets = vec![0];
    let mut last = 0;
    for end in ends {
        let end = end.unwrap_or(last);
        if end < last {
            let place = "Cells, `faceoffsets`";
            let found = format!("{end} after {last}");
            return Err(damaged(piece, place, "ends that do not fall", found));
        }
        last = end;
        offsets.push(end);
    }
    let connectivity = read_indices(piece, CELLS, "faces", Some(last as usize))?;
    Ok(Runs {
        offsets,
        connectivity,
    })
}

/// Reads faces with indices, which cells may share.
fn read_shared_faces(piece: Piece<'_>, count: usize) -> Result<Runs> {
    let face_ends = read_offsets(piece, CELLS, "face_offsets", None)?;
    let node_count = face_ends.last().map(|&n| n as usize);
    let faces = Runs {
        offsets: face_ends,
        connectivity: read_indices(piece, CELLS, "face_connectivity", node_count)?,
    };
    let cell_ends = read_offsets(piece, CELLS, "polyhedron_offsets", Some(count))?;
    let face_count = cell_ends.last().map(|&n| n as usize);
    let cells = Runs {
        offsets: cell_ends,
        connectivity: read_indices(piece, CELLS, "polyhedron_to_faces", face_count)?,
    };

    face_streams(piece.path, "Cells, `polyhedron_to_faces`", &faces, &cells)
}

fn damaged(piece: Piece<'_>, place: &str, expected: &str, found: String) -> Error {
    let advice = "the file is damaged: save it again";
    Error::format(piece.path, place, expected, found, advice)
}
