//! Converts nodes and cells of the VTK readers to a checked data set.

use std::path::Path;

use rayon::prelude::*;

use super::surface;
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Advice, Error, Result};
use crate::io::ReadAs;

/// A checked data set of cells. It is a mesh if the cells are a surface. It is particles if the only cells are
/// points, if there are none, or if `read_as` asks for a surface's points.
///
/// Values of vertex cells become the particles' values if there is one cell for each node; otherwise they are
/// left out, with a note.
///
/// # Errors
/// No nodes; offsets that decrease or exceed the end; a cell with too few nodes for its kind; a node that does
/// not exist.
pub(in crate::io) fn dataset(
    path: &Path,
    format: &'static str,
    mesh: CellMesh,
    fields: Vec<Field>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    check(path, &mesh)?;
    of_checked(path, format, mesh, fields, read_as)
}

/// Converts cells that [`check`] has passed; otherwise as [`dataset`].
pub(in crate::io) fn of_checked(
    path: &Path,
    format: &'static str,
    mesh: CellMesh,
    mut fields: Vec<Field>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let is_point = |kind: &CellKind| {
        matches!(
            *kind,
            CellKind::EMPTY | CellKind::VERTEX | CellKind::POLY_VERTEX
        )
    };
    let is_mesh = surface::is_surface(&mesh);
    if is_mesh && read_as != Some(ReadAs::Points) {
        return surface::dataset(path, format, mesh, fields);
    }
    if !is_mesh && !mesh.kinds.iter().all(is_point) {
        return Ok(Dataset::new(path, format, Geometry::Cells(mesh), fields));
    }

    let mut notes = Vec::new();
    if let Some(cell_of_node) = cell_of_node(&mesh) {
        for field in fields
            .iter_mut()
            .filter(|f| f.association == Association::Cells)
        {
            field.association = Association::Nodes;
            match &mut field.source {
                FieldSource::Scalar(values) => *values = values.gather(&cell_of_node),
                FieldSource::Vector(components) => {
                    for values in components {
                        *values = values.gather(&cell_of_node);
                    }
                }
                FieldSource::Derived(_) => {}
            }
        }
    } else {
        let before = fields.len();
        fields.retain(|f| f.association == Association::Nodes);
        if fields.len() < before {
            let count = before - fields.len();
            notes.push(format!(
                "{count} cell arrays left out: there is not one vertex cell for each point"
            ));
        }
    }
    let geometry = Geometry::Points {
        positions: mesh.nodes,
    };
    Ok(Dataset {
        notes,
        ..Dataset::new(path, format, geometry, fields)
    })
}

/// Refuses a mesh without nodes, and incomplete cells.
///
/// # Errors
/// As [`dataset`].
pub(crate) fn check(path: &Path, mesh: &CellMesh) -> Result<()> {
    let error = |place: String, expected: &str, found: String| {
        let advice = "the file is damaged: save it again";
        Err(Error::format(path, place, expected, found, advice))
    };
    if mesh.nodes.is_empty() {
        return Err(Error::format(
            path,
            "points",
            "at least one point",
            "none",
            Advice::no_data("the file holds no data: save another"),
        ));
    }
    if mesh.offsets.len() != mesh.kinds.len() + 1
        || mesh.offsets.last().map(|&n| n as usize) != Some(mesh.connectivity.len())
        || mesh.offsets.windows(2).any(|w| w[0] > w[1])
    {
        return error(
            "cells".into(),
            "offsets that rise to the length of the connectivity",
            format!(
                "{} offsets for {} cells and {} numbers",
                mesh.offsets.len(),
                mesh.kinds.len(),
                mesh.connectivity.len()
            ),
        );
    }
    let least = least_nodes();
    let fault = |i: usize| {
        let kind = mesh.kinds[i];
        let least = least[usize::from(kind.0)];
        let found = check_cell(kind, least, mesh.cell(i), mesh.nodes.len()).err()?;
        Some((i, found))
    };
    let first = (0..mesh.kinds.len()).into_par_iter().find_map_first(fault);
    if let Some((i, found)) = first {
        let place = format!("cell {i}, {}", mesh.kinds[i].name());
        let expected = format!("nodes among {}, as many as its kind has", mesh.nodes.len());
        return error(place, &expected, found);
    }
    Ok(())
}

/// The vertex cell of each node, if every node has exactly one.
fn cell_of_node(mesh: &CellMesh) -> Option<Vec<u32>> {
    let count = mesh.nodes.len();
    if mesh.cell_count() != count || mesh.connectivity.len() != count {
        return None;
    }
    let mut cells = vec![u32::MAX; count];
    for (cell, node) in (0..).zip(&mesh.connectivity) {
        cells[*node as usize] = cell;
    }
    let one_each = mesh.offsets.windows(2).all(|w| w[1] - w[0] == 1) && !cells.contains(&u32::MAX);
    one_each.then_some(cells)
}

/// Least number of nodes of a cell of each kind.
fn least_nodes() -> [usize; 256] {
    std::array::from_fn(|kind| {
        let kind = CellKind(u8::try_from(kind).unwrap_or(u8::MAX));
        let of_solid = kind.faces().map(|faces| {
            let corners = faces.iter().flat_map(|face| face.iter());
            corners.max().map_or(0, |&corner| usize::from(corner) + 1)
        });
        of_solid.or(kind.flat_corner_count()).unwrap_or(0)
    })
}

/// Checks a cell's entries against its kind; the error is what was found.
///
/// - `least`: least number of nodes of its kind.
fn check_cell(kind: CellKind, least: usize, cell: &[u32], node_count: usize) -> Result<(), String> {
    let exists = |n: &u32| (*n as usize) < node_count;
    let missing = |nodes: &[u32]| match nodes.iter().find(|n| !exists(n)) {
        Some(n) => Err(format!("node {n}")),
        None => Ok(()),
    };
    if kind == CellKind::POLYHEDRON {
        let Some((&face_count, mut rest)) = cell.split_first() else {
            return Err("no faces".into());
        };
        for _ in 0..face_count {
            let face = rest.split_first().and_then(|(&n, tail)| {
                let face = tail.get(..n as usize)?;
                rest = &tail[n as usize..];
                Some(face)
            });
            missing(face.ok_or("a face beyond the cell's end")?)?;
        }
        return if rest.is_empty() {
            Ok(())
        } else {
            Err(format!("{} numbers after its faces", rest.len()))
        };
    }
    if cell.len() < least {
        return Err(format!("{} nodes", cell.len()));
    }
    missing(cell)
}
