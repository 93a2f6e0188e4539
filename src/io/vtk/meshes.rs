//! Reads and joins the pieces of the VTK XML formats of cells, each of which has cells of its own.

use std::path::Path;

use super::array::Array;
use super::grid;
use super::pieces::{Piece, element_of, keep_common, to_fields};
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::options::ReadAs;

/// One decoded piece. Its cells refer to its own nodes, counted from 0.
#[derive(Debug)]
pub(in crate::io) struct Part {
    mesh: CellMesh,
    node_arrays: Vec<Array>,
    cell_arrays: Vec<Array>,
}

impl Part {
    /// Decodes the nodes and arrays of a piece, with its `cell_count` cells from `cells`, and checks them;
    /// `None` if the piece is empty.
    pub(in crate::io) fn read(
        piece: Piece<'_>,
        cell_count: usize,
        cells: impl FnOnce() -> Result<CellMesh>,
    ) -> Result<Option<Self>> {
        let node_count = piece.count("NumberOfPoints")?;
        if node_count == 0 && cell_count == 0 {
            return Ok(None);
        }
        let mut mesh = cells()?;
        if node_count > 0 {
            let points = piece.only_array("Points")?;
            mesh.nodes = piece.decoder.points(points, node_count)?;
        }
        mesh.check(piece.path)?;
        let node_arrays = piece.fields(Association::Nodes, node_count)?;
        let cell_arrays = piece.fields(Association::Cells, cell_count)?;
        Ok(Some(Self::new(mesh, node_arrays, cell_arrays)))
    }

    /// - `mesh`: with its nodes, checked.
    /// - `node_arrays`, `cell_arrays`: a number for each node and each cell.
    pub(in crate::io) fn new(
        mesh: CellMesh,
        node_arrays: Vec<Array>,
        cell_arrays: Vec<Array>,
    ) -> Self {
        Self {
            mesh,
            node_arrays,
            cell_arrays,
        }
    }
}

/// Lists of one length per cell, concatenated: nodes of cells, say, with the end of each list.
#[derive(Debug)]
pub(in crate::io) struct Runs {
    /// Start of each cell's nodes; one more at the end.
    pub(in crate::io) offsets: Vec<u32>,
    pub(in crate::io) connectivity: Vec<u32>,
}

impl Runs {
    /// Decodes `connectivity` and `offsets` of `count` cells.
    pub(in crate::io) fn read(piece: Piece<'_>, element: &str, count: usize) -> Result<Self> {
        let offsets = read_offsets(piece, element, "offsets", Some(count))?;
        let end = offsets.last().map(|&n| n as usize);
        let connectivity = read_indices(piece, element, "connectivity", end)?;
        Ok(Self {
            offsets,
            connectivity,
        })
    }

    /// The nodes of one cell.
    pub(in crate::io) fn cell(&self, i: usize) -> &[u32] {
        &self.connectivity[self.offsets[i] as usize..self.offsets[i + 1] as usize]
    }
}

/// Cells of fixed kinds, without the nodes' positions.
pub(in crate::io) fn without_nodes(kinds: Vec<CellKind>, runs: Runs) -> CellMesh {
    CellMesh {
        nodes: Vec::new(),
        kinds,
        offsets: runs.offsets,
        connectivity: runs.connectivity,
    }
}

/// Cells without the nodes' positions: the entries of polyhedra are those of `faces`, the entries of others
/// those of `runs`.
///
/// # Errors
/// More entries than `u32` counts.
pub(in crate::io) fn with_polyhedra(
    path: &Path,
    kinds: Vec<CellKind>,
    runs: &Runs,
    faces: &Runs,
) -> Result<CellMesh> {
    let mut all = Runs {
        offsets: vec![0],
        connectivity: Vec::new(),
    };
    for (i, &kind) in kinds.iter().enumerate() {
        let cells = if kind == CellKind::POLYHEDRON {
            faces
        } else {
            runs
        };
        all.connectivity.extend_from_slice(cells.cell(i));
        all.offsets.push(counted(path, all.connectivity.len())?);
    }
    Ok(without_nodes(kinds, all))
}

/// Converts polyhedra to the form of [`CellMesh`], from faces with indices, which cells may share.
///
/// - `place`: name of the faces' array, for errors.
/// - `faces`: the nodes of each face.
/// - `cells`: the faces of each cell; empty for cells that are no polyhedra.
///
/// # Errors
/// Faces that do not exist, or that more than two cells have.
pub(in crate::io) fn face_streams(
    path: &Path,
    place: &str,
    faces: &Runs,
    cells: &Runs,
) -> Result<Runs> {
    // A face lies between two cells. If more cells could use one, a small file could fill the memory.
    let mut uses = vec![0_u8; faces.offsets.len() - 1];
    let mut streams = Runs {
        offsets: vec![0],
        connectivity: Vec::new(),
    };
    for i in 0..cells.offsets.len() - 1 {
        let cell = cells.cell(i);
        if !cell.is_empty() {
            streams.connectivity.push(counted(path, cell.len())?);
        }
        for &face in cell {
            let used = uses.get_mut(face as usize).filter(|n| **n < 2);
            let Some(used) = used else {
                return Err(Error::format(
                    path,
                    place,
                    format!(
                        "faces below {}, each at most twice",
                        faces.offsets.len() - 1
                    ),
                    format!("face {face} in cell {i}"),
                    "the file is damaged: save it again",
                ));
            };
            *used += 1;
            let nodes = faces.cell(face as usize);
            streams.connectivity.push(counted(path, nodes.len())?);
            streams.connectivity.extend_from_slice(nodes);
        }
        streams
            .offsets
            .push(counted(path, streams.connectivity.len())?);
    }
    Ok(streams)
}

fn counted(path: &Path, count: usize) -> Result<u32> {
    u32::try_from(count).map_err(|_| {
        let expected = format!("at most {} entries of cells", u32::MAX);
        let advice = "save the grid in several pieces, and read them one by one";
        Error::format(path, "cells", expected, "more", advice)
    })
}

/// Decodes an array of indices.
pub(in crate::io) fn read_indices(
    piece: Piece<'_>,
    element: &str,
    name: &str,
    count: Option<usize>,
) -> Result<Vec<u32>> {
    let array = piece.array_named(element, name);
    let array = array.ok_or_else(|| piece.missing(&format!("{element}, `{name}`")))?;
    let expected = "whole numbers from 0 to 4294967295";
    piece
        .decoder
        .integers(array, count, expected, |n| u32::try_from(n).ok())
}

/// Decodes an array of ends, which may not decrease, and puts a 0 before them.
pub(in crate::io) fn read_offsets(
    piece: Piece<'_>,
    element: &str,
    name: &str,
    count: Option<usize>,
) -> Result<Vec<u32>> {
    let mut offsets = read_indices(piece, element, name, count)?;
    if let Some(i) = offsets.windows(2).position(|w| w[0] > w[1]) {
        return Err(Error::format(
            piece.path,
            format!("{element}, `{name}`"),
            "ends that do not fall",
            format!("{} after {}", offsets[i + 1], offsets[i]),
            "the file is damaged: save it again",
        ));
    }
    offsets.insert(0, 0);
    Ok(offsets)
}

/// Joins parts one after another.
///
/// # Errors
/// No part, or more nodes or entries than `u32` counts.
pub(in crate::io) fn join(
    path: &Path,
    format: &'static str,
    mut parts: Vec<Part>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let mut notes = Vec::new();
    let mut fields = Vec::new();
    for association in Association::BOTH {
        let mut arrays = arrays_of(&mut parts, association);
        keep_common(&mut arrays, element_of(association), &mut notes);
        let arrays = arrays.into_iter().reduce(append_arrays).unwrap_or_default();
        fields.extend(to_fields(arrays, association));
    }
    if parts.is_empty() {
        CellMesh::default().check(path)?;
    }
    let mesh = mesh_of(path, parts)?;
    let mut data = grid::of_checked(path, format, mesh, fields, read_as)?;
    data.notes.splice(0..0, notes);
    Ok(data)
}

/// Takes the arrays of nodes or of cells out of parts.
pub(in crate::io) fn arrays_of(parts: &mut [Part], association: Association) -> Vec<Vec<Array>> {
    parts
        .iter_mut()
        // A part without cells has no arrays of cells; likewise nodes.
        .filter(|part| part.count(association) > 0)
        .map(|part| match association {
            Association::Nodes => std::mem::take(&mut part.node_arrays),
            Association::Cells => std::mem::take(&mut part.cell_arrays),
        })
        .collect()
}

/// The cells of parts, one after another.
///
/// # Errors
/// More nodes or entries than `u32` counts.
pub(in crate::io) fn mesh_of(path: &Path, parts: Vec<Part>) -> Result<CellMesh> {
    let mut meshes = parts.into_iter().map(|part| part.mesh);
    let mut mesh = meshes.next().unwrap_or_else(|| CellMesh {
        offsets: vec![0],
        ..CellMesh::default()
    });
    for part in meshes {
        append_mesh(path, &mut mesh, part)?;
    }
    Ok(mesh)
}

impl Part {
    /// The cells of the part.
    pub(in crate::io) fn mesh(&self) -> &CellMesh {
        &self.mesh
    }

    fn count(&self, association: Association) -> usize {
        self.mesh.count_of(association)
    }
}

/// Appends arrays to those of the same names and kinds.
pub(in crate::io) fn append_arrays(mut all: Vec<Array>, part: Vec<Array>) -> Vec<Array> {
    for (all, part) in all.iter_mut().zip(part) {
        for (all, part) in all.components.iter_mut().zip(part.components) {
            all.append(part);
        }
    }
    all
}

/// Appends a mesh; its nodes are renumbered to follow.
fn append_mesh(path: &Path, all: &mut CellMesh, part: CellMesh) -> Result<()> {
    let sum = |name: &str, a: usize, b: usize| match u32::try_from(a.saturating_add(b)) {
        Ok(_) => u32::try_from(a).map_err(|_| name.to_owned()),
        Err(_) => Err(name.to_owned()),
    };
    let node_shift = sum("nodes", all.nodes.len(), part.nodes.len())
        .and_then(|nodes| {
            sum(
                "entries of cells",
                all.connectivity.len(),
                part.connectivity.len(),
            )?;
            Ok(nodes)
        })
        .map_err(|name| {
            Error::format(
                path,
                "all pieces together",
                format!("at most {} {name}", u32::MAX),
                "more",
                "read the pieces one by one",
            )
        })?;
    all.append(part, node_shift);
    Ok(())
}
