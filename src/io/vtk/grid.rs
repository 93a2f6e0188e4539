//! Converts nodes and cells of the VTK readers to a checked data set.

use std::path::Path;

use super::surface;
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::Result;
use crate::io::options::ReadAs;

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
    mesh.check(path)?;
    of_checked(path, format, mesh, fields, read_as)
}

/// Converts cells that [`CellMesh::check`] has passed; otherwise as [`dataset`].
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
