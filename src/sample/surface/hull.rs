//! Turns the outer faces of cells without a field to show into a mesh.

use std::collections::HashMap;

use crate::data::blanking::Blanking;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{Material, Mesh, MeshPart};
use crate::data::polyhedron::polyhedron_faces;
use crate::error::Result;
use crate::io::leave_out_unused;

/// The three least nodes of a face: faces that share them are the same face.
type Key = [u32; 3];

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
    let is_hidden = |i: usize| {
        let nodes = cells.cell(i).iter();
        let is_listed = cells.kinds[i] != CellKind::POLYHEDRON;
        blanking.cell(i) || (is_listed && nodes.clone().any(|&n| blanking.node(n as usize)))
    };
    let drawn = || (0..cells.cell_count()).filter(|&i| !is_hidden(i));
    let mut counts: HashMap<Key, u32> = HashMap::new();
    for i in drawn() {
        each_face(cells, i, |face| *counts.entry(key(face)).or_default() += 1);
    }
    let mut part = MeshPart::default();
    for i in drawn() {
        each_face(cells, i, |face| {
            if counts.get(&key(face)) == Some(&1) {
                let rest = face[1..].windows(2);
                part.triangles
                    .extend(rest.map(|edge| [face[0], edge[0], edge[1]]));
            }
        });
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

fn key(face: &[u32]) -> Key {
    let mut least = [u32::MAX; 3];
    for &node in face {
        let place = least.partition_point(|&other| other < node);
        if place < 3 && least[place] != node {
            least[place..].rotate_right(1);
            least[place] = node;
        }
    }
    least
}

/// Calls `face` for each face of a cell, and for a surface cell with its corners; not for lines and points.
fn each_face(cells: &CellMesh, i: usize, mut face: impl FnMut(&[u32])) {
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
        nodes.windows(3).for_each(face);
    } else if kind.is_flat() && nodes.len() >= 3 {
        face(nodes);
    }
}
