//! Turns the outer faces of cells without a field to show into a mesh.

use std::collections::{HashMap, HashSet};

use crate::data::blanking::Blanking;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{Material, Mesh, MeshPart};
use crate::data::polyhedron::polyhedron_faces;
use crate::error::Result;
use crate::io::leave_out_unused;
use crate::sample::cells::sharp::key;

/// Face of the outside of a mesh of cells.
pub(super) struct Face {
    pub(super) cell: usize,
    pub(super) nodes: Vec<u32>,
    /// False for the face of a surface cell.
    pub(super) is_of_solid: bool,
}

/// Turns a data set of cells into a mesh: the faces that belong to one cell alone, and the cells that are
/// surfaces. Fields are dropped.
///
/// # Errors
/// The errors of [`Dataset::validate`]; fields that state hidden cells or nodes and cannot be read.
pub(in crate::sample) fn as_mesh(mut dataset: Dataset) -> Result<Dataset> {
    dataset.validate()?;
    let blanking = Blanking::of(&dataset)?;
    let Geometry::Cells(cells) = &dataset.geometry else {
        return Ok(dataset);
    };
    let blanking = blanking.of_mesh(cells);
    let mut part = MeshPart::default();
    for Face { nodes, .. } in outer_faces(cells, |cell| blanking.cell(cell)) {
        let rest = nodes[1..].windows(2);
        part.triangles
            .extend(rest.map(|edge| [nodes[0], edge[0], edge[1]]));
    }
    part.positions.clone_from(&cells.nodes);
    leave_out_unused(&mut part);
    dataset.fields.clear();
    let note = "no field to show: the outside of the cells is drawn";
    dataset.notes.push(note.into());
    dataset.geometry = Geometry::Mesh(Mesh {
        parts: vec![part],
        materials: vec![Material::default()],
        textures: Vec::new(),
    });
    Ok(dataset)
}

/// Returns the faces that belong to one solid cell alone, and the faces of surface cells, in the order of the
/// cells. A surface cell on such a face is left out: two faces at one place would be mixed. Surface cells stated
/// twice are one.
pub(super) fn outer_faces(cells: &CellMesh, is_hidden: impl Fn(usize) -> bool) -> Vec<Face> {
    let drawn = || (0..cells.cell_count()).filter(|&cell| !is_hidden(cell));
    let mut counts: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
    for cell in drawn().filter(|&cell| cells.kinds[cell].is_solid()) {
        each_face(cells, cell, |face| {
            if let Some(key) = key(face) {
                *counts.entry(key).or_default() += 1;
            }
        });
    }
    let mut faces = Vec::new();
    let mut of_surface = HashSet::new();
    for cell in drawn() {
        let is_of_solid = cells.kinds[cell].is_solid();
        each_face(cells, cell, |face| {
            let Some(key) = key(face) else {
                return;
            };
            let is_outer = counts.get(&key) == Some(&1);
            if is_outer == is_of_solid && (is_of_solid || of_surface.insert(key)) {
                faces.push(Face {
                    cell,
                    nodes: face.to_vec(),
                    is_of_solid,
                });
            }
        });
    }
    faces
}

/// Calls `face` for each face of a cell, and for a surface cell with its corners; not for lines and points.
pub(super) fn each_face(cells: &CellMesh, i: usize, mut face: impl FnMut(&[u32])) {
    let (kind, nodes) = (cells.kinds[i], cells.cell(i));
    if kind == CellKind::POLYHEDRON {
        polyhedron_faces(nodes).for_each(face);
    } else if let Some(faces) = kind.faces() {
        for corners in faces {
            let own: Vec<u32> = corners.iter().map(|&c| nodes[usize::from(c)]).collect();
            face(&own);
        }
    } else if kind == CellKind::PIXEL {
        face(&[nodes[0], nodes[1], nodes[3], nodes[2]]);
    } else if let Some(count) = kind.flat_corner_count() {
        face(&nodes[..count]);
    } else if kind == CellKind::TRIANGLE_STRIP {
        // Every other triangle of a strip runs the other way.
        for (i, own) in nodes.windows(3).enumerate() {
            match i % 2 {
                0 => face(own),
                _ => face(&[own[1], own[0], own[2]]),
            }
        }
    } else if kind.is_flat() && nodes.len() >= 3 {
        face(nodes);
    }
}
