//! Converts flat cells of VTK files to a mesh.
//!
//! | array | use |
//! |---|---|
//! | the first of points, or else of cells, with three or four bytes each or with the name of a colour | colours, sRGB-encoded, and opacity |
//! | `Normals` of points, three numbers each | normals |
//!
//! Cells of higher order are reduced to their corners. Cells that ghost arrays hide are left out. Other arrays
//! stay fields: those of points at the corners, those of cells at the triangles. The surface is seen from
//! behind, too, unless it is closed with its front outwards (see [`crate::io::mesh::closed`]).

use std::collections::HashMap;
use std::path::Path;

use glam::Vec3;

use super::xml::clip;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::colour_columns::{ColourNumbers, ColourScale};
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::data::first_order::surface_of_first_order;
use crate::data::mesh::{AlphaMode, Mesh, MeshPart};
use crate::error::Result;
use crate::io::mesh::closed::are_closed;
use crate::io::mesh::mesh_part::{LeftOut, check_not_empty, finish, plain};
use crate::io::mesh::polygons::{approximate_note, strip, triangles_with};
use crate::scene::Values;

/// Whether cells are a surface: some are flat, and none is a solid or of an unknown kind.
pub(in crate::io) fn is_surface(cells: &CellMesh) -> bool {
    cells.kinds.iter().any(|kind| kind.is_flat())
        && cells
            .kinds
            .iter()
            .all(|kind| kind.is_flat() || kind.is_thin())
}

/// The mesh of checked cells for which [`is_surface`] holds.
///
/// # Errors
/// No triangle with an area.
pub(in crate::io) fn dataset(
    path: &Path,
    format: &'static str,
    cells: CellMesh,
    fields: Vec<Field>,
) -> Result<Dataset> {
    let (cells, fields) = surface_of_first_order(cells, fields);
    let mut data = Dataset::new(path, format, Geometry::Cells(cells), fields);
    let blanking = Blanking::of(&data)?;
    let Geometry::Cells(cells) =
        std::mem::replace(&mut data.geometry, Geometry::Mesh(Mesh::default()))
    else {
        unreachable!("it was made above")
    };
    let fields = std::mem::take(&mut data.fields);

    let mut part = MeshPart::default();
    let mut used = Vec::new();
    let counts = (cells.nodes.len(), cells.kinds.len());
    let notes = &mut data.notes;
    let of_nodes = colours(&fields, Association::Nodes, counts.0, notes);
    let of_cells = match of_nodes {
        None => colours(&fields, Association::Cells, counts.1, notes),
        Some(_) => None,
    };
    if let Some((i, colours)) = of_nodes {
        used.push(i);
        part.colours = colours;
    }
    if let Some((i, normals)) = normals(&fields, cells.nodes.len()) {
        used.push(i);
        part.normals = normals;
    }
    let (mut hidden, mut thin, mut higher) = (0, 0, 0);
    let (mut corners, mut ends, mut owners) = (Vec::new(), Vec::new(), Vec::new());
    for (i, &kind) in cells.kinds.iter().enumerate() {
        let cell = cells.cell(i);
        if kind.is_thin() {
            thin += usize::from(kind != CellKind::EMPTY);
            continue;
        }
        if blanking.cell(i) || cell.iter().any(|&n| blanking.node(n as usize)) {
            hidden += 1;
            continue;
        }
        higher += usize::from(kind.is_of_higher_order());
        if kind == CellKind::TRIANGLE_STRIP {
            let mut triangles = Vec::new();
            strip(cell, &mut triangles);
            for triangle in triangles {
                corners.extend(triangle);
                ends.push(corners.len());
                owners.push(index(i));
            }
            continue;
        }
        outline(kind, cell, &mut corners);
        ends.push(corners.len());
        owners.push(index(i));
    }
    part.positions = cells.nodes;
    // The node of each corner; empty if they are the same.
    let mut nodes = Vec::new();
    if let Some((i, colours)) = of_cells {
        used.push(i);
        (nodes, part.colours) = split_by_colour(&mut corners, &ends, &owners, &colours);
        let of_nodes = |i: &u32| part.positions[*i as usize];
        part.positions = nodes.iter().map(of_nodes).collect();
        if !part.normals.is_empty() {
            part.normals = nodes.iter().map(|i| part.normals[*i as usize]).collect();
        }
    }
    let mut approximate = 0;
    let (node_count, cell_count) = counts;
    let mut cell_of_triangle = Vec::new();
    let mut polygons = owners.iter();
    let of_polygon = |count| {
        let owner = polygons.next().copied().unwrap_or_default();
        cell_of_triangle.extend(std::iter::repeat_n(owner, count));
    };
    part.triangles = triangles_with(
        &corners,
        &ends,
        &part.positions,
        &mut approximate,
        of_polygon,
    );

    let mut material = plain(!part.colours.is_empty());
    if part.colours.iter().any(|c| c[3] < 1.0) {
        material.alpha = AlphaMode::Blend;
    }
    material.is_double_sided = are_closed(std::slice::from_ref(&part)) != [true];
    let mut left_out = LeftOut::default();
    let kept = finish(&mut part, &mut left_out);
    let mesh = Mesh {
        parts: vec![part],
        materials: vec![material],
        textures: Vec::new(),
    };
    check_not_empty(path, &mesh)?;
    data.geometry = Geometry::Mesh(mesh);

    for (count, what) in [
        (thin, "points and lines are not shown beside the surface"),
        (
            hidden,
            "cells are hidden, or copies of another piece's, and left out",
        ),
        (
            higher,
            "cells are of a higher order that is not known: drawn by their corners",
        ),
    ] {
        if count > 0 {
            data.notes.push(format!("{count} {what}"));
        }
    }
    data.notes.extend(approximate_note(approximate));
    data.notes.extend(left_out.notes());
    let of_kept = |corner: &u32| nodes[*corner as usize];
    let corners = match (nodes.is_empty(), kept.corners.is_empty()) {
        (true, _) => kept.corners,
        (false, true) => nodes,
        (false, false) => kept.corners.iter().map(of_kept).collect(),
    };
    let cells: Vec<u32> = kept
        .triangles
        .iter()
        .map(|&triangle| cell_of_triangle[triangle as usize])
        .collect();
    let others = fields.into_iter().enumerate();
    let others =
        others.filter(|(i, field)| !used.contains(i) && !Blanking::is_told_by(&field.name));
    for (_, mut field) in others {
        let (expected, chosen) = match field.association {
            Association::Nodes => (node_count, &corners),
            Association::Cells => (cell_count, &cells),
        };
        let all = field.association == Association::Nodes && chosen.is_empty();
        let arrays = field.arrays_mut();
        if arrays.is_empty() || arrays.iter().any(|values| values.len() != expected) {
            continue;
        }
        if !all {
            arrays
                .iter_mut()
                .for_each(|values| *values = values.gather(chosen));
        }
        data.fields.push(field);
    }
    Ok(data)
}

/// A cell's index. Cells have at most as many as their offsets, which are u32.
#[expect(clippy::cast_possible_truncation, reason = "offsets of cells are u32")]
fn index(cell: usize) -> u32 {
    cell as u32
}

/// Appends the corners of a flat cell, in order around it.
fn outline(kind: CellKind, cell: &[u32], corners: &mut Vec<u32>) {
    match (kind, kind.flat_corner_count()) {
        (CellKind::PIXEL, _) => corners.extend([0, 1, 3, 2].map(|i: usize| cell[i])),
        // Nodes on the edges follow those at the corners.
        (CellKind::QUADRATIC_POLYGON, _) => corners.extend(&cell[..cell.len() / 2]),
        (_, Some(count)) => corners.extend(&cell[..count]),
        (_, None) => corners.extend(cell),
    }
}

/// The first field of points or of cells that has colours, as linear RGBA: three or four bytes each, or another
/// kind of colours ([`Field::is_colour`]).
fn colours(
    fields: &[Field],
    association: Association,
    count: usize,
    notes: &mut Vec<String>,
) -> Option<(usize, Vec<[f32; 4]>)> {
    let is_bytes = |field: &Field| {
        let arrays = field.arrays();
        matches!(arrays.len(), 3 | 4) && arrays.iter().all(|a| matches!(a, Values::U8(_)))
    };
    let (i, field) = fields.iter().enumerate().find(|(_, field)| {
        field.association == association
            && field.arrays().iter().all(|array| array.len() == count)
            && (is_bytes(field) || field.is_colour())
    })?;
    let (channels, alpha) = field.arrays().split_at_checked(3)?;
    let scale = ColourScale::of(None, ColourNumbers::of(channels));
    if let Some(assumed) = scale.assumed() {
        notes.push(format!("colours `{}` {assumed}", clip(&field.name)));
    }
    let of_alpha = ColourScale::of(None, ColourNumbers::of(alpha));
    let colour = |p: usize| {
        let [r, g, b] = [0, 1, 2].map(|c: usize| scale.linear(channels[c].get(p)));
        let opacity = alpha.first().map_or(1.0, |a| of_alpha.share(a.get(p)));
        [r, g, b, opacity]
    };
    Some((i, (0..count).map(colour).collect()))
}

/// Splits each corner, so that it has one copy for each colour of the polygons around it.
///
/// - `colours`: colours of cells; `owners`: the cell of each polygon.
///
/// Returns the node of each new corner, and its colour.
fn split_by_colour(
    corners: &mut [u32],
    ends: &[usize],
    owners: &[u32],
    colours: &[[f32; 4]],
) -> (Vec<u32>, Vec<[f32; 4]>) {
    let mut number_of: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let (mut nodes, mut of_corner) = (Vec::new(), Vec::new());
    let mut start = 0;
    for (&end, &owner) in ends.iter().zip(owners) {
        let colour = colours[owner as usize];
        for corner in &mut corners[start..end] {
            let next = u32::try_from(nodes.len()).unwrap_or(u32::MAX);
            let key = (*corner, colour.map(f32::to_bits));
            *corner = *number_of.entry(key).or_insert_with(|| {
                nodes.push(key.0);
                of_corner.push(colour);
                next
            });
        }
        start = end;
    }
    (nodes, of_corner)
}

/// The normals of points.
fn normals(fields: &[Field], count: usize) -> Option<(usize, Vec<Vec3>)> {
    fields.iter().enumerate().find_map(|(i, field)| {
        let is_normals =
            field.association == Association::Nodes && field.name.eq_ignore_ascii_case("normals");
        match &field.source {
            FieldSource::Vector(xyz) if is_normals => {
                let [x, y, z] = xyz.as_slice() else {
                    return None;
                };
                let is_whole = [x, y, z].iter().all(|c| c.len() == count);
                let normal = |p: usize| Vec3::new(x.get(p), y.get(p), z.get(p));
                is_whole.then(|| (i, (0..count).map(normal).collect()))
            }
            _ => None,
        }
    })
}
