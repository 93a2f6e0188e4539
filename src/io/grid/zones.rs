//! Joins the zones of a grid: lattices, curvilinear blocks and unstructured cells, each with fields of its own.

use std::path::Path;

use super::block_cells;
use super::budget::Budget;
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::options::ReadAs;
use crate::io::vtk;
use crate::scene::{Lattice, Values};

/// Positions and cells of a zone.
pub(super) enum Shape {
    Lattice(Lattice),
    Block(CurvilinearBlock),
    Cells(CellMesh),
}

impl Shape {
    fn dims(&self) -> Option<[usize; 3]> {
        match self {
            Self::Lattice(lattice) => Some(lattice.dims),
            Self::Block(block) => Some(block.dims),
            Self::Cells(_) => None,
        }
    }

    /// Returns the number of values of a field.
    pub(super) fn count_of(&self, association: Association) -> usize {
        match (self, self.dims()) {
            (Self::Cells(mesh), _) => mesh.count_of(association),
            (_, Some(dims)) => match association {
                Association::Nodes => dims.iter().product(),
                Association::Cells => dims.map(|n| n.saturating_sub(1).max(1)).iter().product(),
            },
            _ => 0,
        }
    }
}

/// A zone.
pub(super) struct Zone {
    pub(super) shape: Shape,
    /// Fields whose numbers of values are those of the shape.
    pub(super) fields: Vec<Field>,
}

/// Joins zones to one data set. A zone without a field of others has NaN there.
///
/// # Errors
/// No zones; more nodes or entries of cells than 32-bit integers count; fields of more memory than the budget allows;
/// the errors of [`vtk::grid::dataset`].
pub(super) fn joined(
    path: &Path,
    format: &'static str,
    mut zones: Vec<Zone>,
    budget: &Budget<'_>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let fields = fields(&mut zones, budget)?;
    let is_deep = |zone: &Zone| {
        zone.shape
            .dims()
            .is_some_and(|dims| dims.iter().all(|&n| n > 1))
    };
    if zones.iter().all(is_deep) && !zones.is_empty() {
        if let [
            Zone {
                shape: Shape::Lattice(lattice),
                ..
            },
        ] = zones.as_slice()
            && lattice.validate().is_ok()
        {
            let geometry = Geometry::Lattice(lattice.clone());
            return Ok(Dataset::new(path, format, geometry, fields));
        }
        let mut blocks = Vec::new();
        for zone in zones {
            blocks.push(match zone.shape {
                Shape::Lattice(lattice) => {
                    budget.spend("nodes of all grids", lattice.len(), 24)?;
                    CurvilinearBlock::of_lattice(&lattice)
                }
                Shape::Block(block) => block,
                Shape::Cells(_) => unreachable!("all have dimensions"),
            });
        }
        let geometry = Geometry::Curvilinear { blocks };
        return Ok(Dataset::new(path, format, geometry, fields));
    }
    let mut mesh = CellMesh {
        offsets: vec![0],
        ..CellMesh::default()
    };
    let too_many = || {
        let expected = format!("at most {} nodes, and entries of cells", u32::MAX);
        let advice = "save the zones in files of their own";
        Error::format(path, "all zones together", expected, "more", advice)
    };
    let small = |n: usize| u32::try_from(n).map_err(|_| too_many());
    for zone in zones {
        let first = mesh.nodes.len();
        let block = match zone.shape {
            Shape::Cells(cells) => {
                cells.check(path)?;
                small(first + cells.nodes.len())?;
                small(mesh.connectivity.len() + cells.connectivity.len())?;
                mesh.append(cells, small(first)?);
                continue;
            }
            Shape::Block(block) => block,
            Shape::Lattice(lattice) => {
                budget.spend("nodes of all grids", lattice.len(), 24)?;
                CurvilinearBlock::of_lattice(&lattice)
            }
        };
        budget.spend("cells of all grids", block.nodes.len(), 40)?;
        mesh.nodes.extend(&block.nodes);
        block_cells::append(&mut mesh, block.dims, first).ok_or_else(too_many)?;
    }
    vtk::grid::dataset(path, format, mesh, fields, read_as)
}

/// Joins the fields of all zones, in the order in which zones name them.
fn fields(zones: &mut [Zone], budget: &Budget<'_>) -> Result<Vec<Field>> {
    if let [only] = zones {
        return Ok(std::mem::take(&mut only.fields));
    }
    let mut all: Vec<Field> = Vec::new();
    let is_same = |a: &Field, b: &Field| {
        a.name == b.name && a.association == b.association && a.arrays().len() == b.arrays().len()
    };
    for zone in zones.iter() {
        for field in &zone.fields {
            if !all.iter().any(|known| is_same(known, field)) {
                all.push(Field {
                    name: field.name.clone(),
                    association: field.association,
                    source: match &field.source {
                        FieldSource::Vector(c) => {
                            FieldSource::Vector(vec![Values::U8(Vec::new()); c.len()])
                        }
                        _ => FieldSource::Scalar(Values::U8(Vec::new())),
                    },
                    unit: field.unit.clone(),
                });
            }
        }
    }
    for field in &mut all {
        let association = field.association;
        let count: usize = zones
            .iter()
            .map(|zone| zone.shape.count_of(association))
            .sum();
        let place = format!("field `{}` of all zones", field.name);
        let component_count = field.arrays().len();
        budget.spend(&place, count, 4 * component_count)?;
        let sources: Vec<Option<&Field>> = zones
            .iter()
            .map(|zone| zone.fields.iter().find(|own| is_same(own, field)))
            .collect();
        for component in 0..component_count {
            let mut values: Vec<f64> = Vec::with_capacity(count);
            for (zone, own) in zones.iter().zip(&sources) {
                let end = values.len() + zone.shape.count_of(association);
                if let Some(own) = own.map(|own| &own.arrays()[component]) {
                    values.extend((0..own.len()).map(|i| own.wide(i)));
                }
                values.resize(end, f64::NAN);
            }
            field.arrays_mut()[component] = values.into();
        }
    }
    Ok(all)
}

/// Appends a cell whose nodes have been checked.
///
/// # Errors
/// More entries than 32-bit integers count.
pub(super) fn push_cell(path: &Path, mesh: &mut CellMesh, kind: CellKind) -> Result<()> {
    let end = u32::try_from(mesh.connectivity.len());
    let end = end.map_err(|_| too_many_entries(path, "cells", "save the grid in several files"))?;
    mesh.offsets.push(end);
    mesh.kinds.push(kind);
    Ok(())
}

/// Makes the error for cells whose nodes 32-bit integers do not count.
pub(super) fn too_many_entries(path: &Path, place: &str, advice: &str) -> Error {
    let expected = format!("at most {} entries of cells", u32::MAX);
    Error::format(path, place, expected, "more", advice)
}
