//! Moves the points of data sets by a vector field.

use glam::DVec3;

use crate::data::dataset::{CurvilinearBlock, Dataset, Field, Geometry};
use crate::data::vectors::{is_vector, place, vectors};
use crate::error::{Error, Result};

/// A field by which points are moved.
#[derive(Debug, Clone, PartialEq)]
pub struct Displacement {
    /// Name of a vector field at points.
    pub field: String,
    /// Factor of the vectors; 1 draws the deformed shape to scale.
    pub factor: f64,
}

/// Use of the vectors, in errors.
const WHAT: &str = "displacement";

/// Start of the names of displacements, in lower case, as ParaView finds them in Exodus files.
const NAME: &str = "disp";

/// Moves points by a vector field times a factor.
///
/// Nodes of grids, cells and meshes, and particles are moved; vectors of two components move them along x and y. A lattice
/// becomes a curvilinear grid. Normals of meshes are left out, because those of the deformed shape are others. Points
/// whose vectors are not finite stay in their places, with a note.
///
/// # Errors
/// No field of that name; a field of cells, or of one component or more than three; splats, and lattices with a single
/// layer of samples; a factor that is not finite.
pub fn displace(mut dataset: Dataset, by: &Displacement) -> Result<Dataset> {
    if !by.factor.is_finite() {
        let found = by.factor.to_string();
        return Err(Error::invalid(
            "displacement",
            "factor",
            "a finite number",
            found,
            "correct it",
        ));
    }
    dataset.validate()?;
    let vectors = vectors(&dataset, WHAT, &by.field)?;
    let mut still = 0;
    let mut at = vectors.iter();
    let mut moved = |positions: &mut [DVec3]| {
        for (position, vector) in positions.iter_mut().zip(&mut at) {
            match vector.is_finite() {
                true => *position += by.factor * *vector,
                false => still += 1,
            }
        }
    };
    let count = match &mut dataset.geometry {
        Geometry::Lattice(lattice) if lattice.dims.contains(&1) => None,
        Geometry::Lattice(lattice) => {
            let mut block = CurvilinearBlock::of_lattice(lattice);
            moved(&mut block.nodes);
            let count = block.nodes.len();
            let blocks = vec![block];
            dataset.geometry = Geometry::Curvilinear { blocks };
            Some(count)
        }
        Geometry::Curvilinear { blocks } => {
            blocks.iter_mut().for_each(|block| moved(&mut block.nodes));
            Some(blocks.iter().map(|block| block.nodes.len()).sum())
        }
        Geometry::Cells(mesh) => {
            moved(&mut mesh.nodes);
            Some(mesh.nodes.len())
        }
        Geometry::Points { positions } => {
            moved(positions);
            Some(positions.len())
        }
        Geometry::Mesh(mesh) => {
            for part in &mut mesh.parts {
                moved(&mut part.positions);
                part.normals.clear();
            }
            Some(mesh.parts.iter().map(|part| part.positions.len()).sum())
        }
        Geometry::Splats(_) => None,
    };
    if count != Some(vectors.len()) {
        let expected = match count {
            Some(count) => format!("a vector at each of {count} points"),
            None => "points that can be moved".to_owned(),
        };
        let found = match count {
            Some(_) => format!("{} vectors", vectors.len()),
            None => "splats, or a lattice of a single layer".to_owned(),
        };
        let advice = "leave the displacement out";
        return Err(Error::format(
            &dataset.path,
            place(WHAT, &by.field),
            expected,
            found,
            advice,
        ));
    }
    if still > 0 {
        dataset.notes.push(format!(
            "{still} points stay in their places, because `{}` is not finite there.",
            by.field
        ));
    }
    dataset.validate()?;
    Ok(dataset)
}

/// Returns a note if a data set has a field that is likely a displacement.
pub(crate) fn note_displacement(dataset: &Dataset) -> Option<String> {
    let is_likely =
        |field: &&Field| is_vector(field) && field.name.to_ascii_lowercase().starts_with(NAME);
    let field = dataset.fields.iter().find(is_likely)?;
    Some(format!(
        "The points are where they were before their displacement `{}`, which ParaView applies to Exodus files by \
         itself: move them by it to see the deformed shape.",
        field.name
    ))
}
