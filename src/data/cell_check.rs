//! Checks the cells of unstructured grids.

use std::path::Path;

use rayon::prelude::*;

use super::cells::{CellKind, CellMesh};
use crate::error::{Advice, Error, Result};

impl CellMesh {
    /// Refuses cells without nodes, and incomplete cells.
    ///
    /// # Errors
    /// No nodes; offsets that decrease or exceed the end; a cell with too few nodes for its kind; a node that does
    /// not exist.
    pub(crate) fn check(&self, path: &Path) -> Result<()> {
        let error = |place: String, expected: &str, found: String| {
            let advice = "the file is damaged: save it again";
            Err(Error::format(path, place, expected, found, advice))
        };
        if self.nodes.is_empty() {
            return Err(Error::format(
                path,
                "points",
                "at least one point",
                "none",
                Advice::no_data("the file holds no data: save another"),
            ));
        }
        if self.offsets.len() != self.kinds.len() + 1
            || self.offsets.last().map(|&n| n as usize) != Some(self.connectivity.len())
            || self.offsets.windows(2).any(|w| w[0] > w[1])
        {
            return error(
                "cells".into(),
                "offsets that rise to the length of the connectivity",
                format!(
                    "{} offsets for {} cells and {} numbers",
                    self.offsets.len(),
                    self.kinds.len(),
                    self.connectivity.len()
                ),
            );
        }
        let least = least_nodes();
        let fault = |i: usize| {
            let kind = self.kinds[i];
            let least = least[usize::from(kind.0)];
            let found = check_cell(kind, least, self.cell(i), self.nodes.len()).err()?;
            Some((i, found))
        };
        let first = (0..self.kinds.len()).into_par_iter().find_map_first(fault);
        if let Some((i, found)) = first {
            let place = format!("cell {i}, {}", self.kinds[i].name());
            let expected = format!("nodes among {}, as many as its kind has", self.nodes.len());
            return error(place, &expected, found);
        }
        Ok(())
    }
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
