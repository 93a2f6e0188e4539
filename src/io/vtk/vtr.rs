//! Reads VTK rectilinear grids (`.vtr`, `.pvtr`): lattices with coordinates for each axis.
//!
//! ```text
//! <RectilinearGrid WholeExtent="i0 i1 j0 j1 k0 k1">
//!   <Piece Extent="i0 i1 j0 j1 k0 k1">
//!     <PointData> ... </PointData> <CellData> ... </CellData>
//!     <Coordinates> <DataArray (x)/> <DataArray (y)/> <DataArray (z)/> </Coordinates>
//!   </Piece> ...
//! </RectilinearGrid>
//! ```
//!
//! Node (i, j, k) lies at (x\[i\], y\[j\], z\[k\]). Axes with falling coordinates are reversed, and their
//! samples with them. Several pieces are put together, see [`super::extent`].

use std::path::Path;

use super::extent::{Extent, Part, join};
use super::pieces::{self, Piece};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::scene::{Lattice, LatticeSpacing, Values, of_any_type};

const AXES: [&str; 3] = ["x", "y", "z"];

/// Reads a rectilinear grid.
///
/// # Errors
/// A file of another type; damaged arrays; pieces that do not make up the whole; coordinates that neither rise
/// nor fall throughout.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let (whole, parts) = pieces::read(input, "RectilinearGrid", Extent::whole, read_part)?;
    let (parts, axes): (Vec<_>, Vec<_>) = parts.into_iter().map(Part::split).unzip();
    let mut coordinates: [Vec<f64>; 3] = Default::default();
    for (axis, all) in coordinates.iter_mut().enumerate() {
        *all = join_axis(path, &whole, &axes, axis)?;
    }
    let (mut fields, notes) = join(path, &whole, parts)?;
    for (axis, all) in coordinates.iter_mut().enumerate() {
        if all.len() > 1 && all[0] > all[1] {
            all.reverse();
            for field in &mut fields {
                reverse_field(field, &whole, axis);
            }
        }
        check_axis(path, all, axis)?;
    }
    let lattice = Lattice {
        dims: whole.dims(Association::Nodes),
        spacing: LatticeSpacing::Rectilinear { coordinates },
    };
    let geometry = Geometry::Lattice(lattice);
    Ok(Dataset {
        notes,
        ..Dataset::new(path, "VTK rectilinear grid", geometry, fields)
    })
}

/// A piece with its own coordinates.
fn read_part(whole: &Extent, piece: Piece<'_>) -> Result<Option<Part<[Vec<f64>; 3]>>> {
    let Some(part) = Part::read(whole, piece)? else {
        return Ok(None);
    };
    let nodes = piece.array_nodes("Coordinates");
    if nodes.len() != 3 {
        return Err(Error::format(
            piece.path,
            "Coordinates",
            "three arrays: x, y and z",
            format!("{}", nodes.len()),
            "the file is damaged: save it again",
        ));
    }
    let mut coordinates: [Vec<f64>; 3] = Default::default();
    let dims = part.extent.dims(Association::Nodes);
    for (axis, all) in coordinates.iter_mut().enumerate() {
        *all = piece.decoder.doubles(nodes[axis], dims[axis])?;
    }
    Ok(Some(part.with(coordinates)))
}

/// The coordinates of the whole along one axis; NaN if no part has them.
fn join_axis(
    path: &Path,
    whole: &Extent,
    parts: &[(Extent, [Vec<f64>; 3])],
    axis: usize,
) -> Result<Vec<f64>> {
    let count = whole.dims(Association::Nodes)[axis];
    let lengths = parts.iter().map(|(_, coordinates)| coordinates[axis].len());
    let present = lengths.fold(0, usize::saturating_add);
    if count > present {
        return Err(Error::format(
            path,
            "Coordinates",
            format!("{count} coordinates along {}", AXES[axis]),
            format!("{present} in all pieces"),
            "save the grid as one piece",
        ));
    }
    let mut all = vec![f64::NAN; count];
    for (extent, coordinates) in parts {
        let start = extent.shift_from(whole)[axis];
        let part = &coordinates[axis];
        all[start..start + part.len()].copy_from_slice(part);
    }
    Ok(all)
}

/// Refuses coordinates that are not finite or do not rise.
fn check_axis(path: &Path, all: &[f64], axis: usize) -> Result<()> {
    let bad = (0..all.len())
        .find(|&i| !all[i].is_finite() || (i > 0 && !(all[i - 1] < all[i])))
        .map(|i| (i, all[i]));
    match bad {
        None => Ok(()),
        Some((i, coordinate)) => Err(Error::format(
            path,
            "Coordinates",
            format!("finite {} that rise, or fall, throughout", AXES[axis]),
            format!("{coordinate} at node {i} in rising order"),
            "correct the coordinates, or save the grid as a StructuredGrid (.vts)",
        )),
    }
}

/// Reverses the samples of a field along one axis.
fn reverse_field(field: &mut Field, whole: &Extent, axis: usize) {
    let dims = whole.dims(field.association);
    match &mut field.source {
        FieldSource::Scalar(values) => reverse(values, dims, axis),
        FieldSource::Vector(components) => {
            for values in components {
                reverse(values, dims, axis);
            }
        }
        FieldSource::Derived(_) => {}
    }
}

/// Reverses samples along one axis.
pub(in crate::io) fn reverse(values: &mut Values, dims: [usize; 3], axis: usize) {
    /// Swaps runs of samples that share an index along the axis with their mirror images.
    fn swap<T>(all: &mut [T], dims: [usize; 3], axis: usize) {
        let run = dims[..axis].iter().product::<usize>();
        let n = dims[axis];
        for block in all.chunks_exact_mut(run * n) {
            for i in 0..n / 2 {
                let (front, back) = block.split_at_mut((n - 1 - i) * run);
                front[i * run..(i + 1) * run].swap_with_slice(&mut back[..run]);
            }
        }
    }
    if values.is_empty() {
        return;
    }
    of_any_type!(values, all => swap(all, dims, axis));
}
