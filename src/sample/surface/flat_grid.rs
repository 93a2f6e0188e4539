//! Turns grids of one layer into surfaces: there is no volume between their nodes.

use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::data::mesh::{Material, Mesh, MeshPart};
use crate::error::Result;

/// Returns true if all grids of a data set have one node along exactly one index.
pub(in crate::sample) fn is_flat(dataset: &Dataset) -> bool {
    match &dataset.geometry {
        Geometry::Lattice(lattice) => sides(lattice.dims).is_some(),
        Geometry::Curvilinear { blocks } => blocks.iter().all(|block| sides(block.dims).is_some()),
        _ => false,
    }
}

/// Turns a data set whose grids are all flat ([`is_flat`]) into a mesh with the same fields. Any other is
/// returned unchanged.
///
/// # Errors
/// The errors of [`Dataset::validate`]; fields that state hidden cells or nodes and cannot be read.
pub(in crate::sample) fn as_surface(mut dataset: Dataset) -> Result<Dataset> {
    if !is_flat(&dataset) {
        return Ok(dataset);
    }
    dataset.validate()?;
    let blocks = match &dataset.geometry {
        Geometry::Lattice(lattice) => vec![CurvilinearBlock::of_lattice(lattice)],
        Geometry::Curvilinear { blocks } => blocks.clone(),
        _ => return Ok(dataset),
    };
    let blanking = Blanking::of(&dataset)?;
    let mut parts = Vec::new();
    let mut cells = Vec::new();
    let (mut first_node, mut first_cell) = (0, 0);
    for CurvilinearBlock { dims, nodes } in blocks {
        let (wide, high) = sides(dims).unwrap_or_default();
        let mut triangles = Vec::new();
        for (j, i) in (1..high).flat_map(|j| (1..wide).map(move |i| (j, i))) {
            let corners = [(i - 1, j - 1), (i, j - 1), (i, j), (i - 1, j)];
            let corners = corners.map(|(i, j)| i + wide * j);
            let is_blank = corners.iter().any(|n| blanking.node(first_node + n));
            if !is_blank && !blanking.cell(first_cell) {
                #[expect(clippy::cast_possible_truncation, reason = "`sides` checks it")]
                let [a, b, c, d] = corners.map(|n| n as u32);
                triangles.extend([[a, b, c], [a, c, d]]);
                #[expect(clippy::cast_possible_truncation, reason = "fewer than nodes")]
                cells.extend([first_cell as u32; 2]);
            }
            first_cell += 1;
        }
        first_node += nodes.len();
        parts.push(MeshPart {
            positions: nodes,
            triangles,
            ..MeshPart::default()
        });
    }
    for field in &mut dataset.fields {
        if field.association == Association::Cells {
            let arrays = field.arrays_mut();
            let whole = arrays
                .iter_mut()
                .filter(|values| values.len() == first_cell);
            whole.for_each(|values| *values = values.gather(&cells));
        }
    }
    let fields = std::mem::take(&mut dataset.fields);
    let shown = fields
        .into_iter()
        .filter(|f| !Blanking::is_told_by(&f.name));
    dataset.fields = shown.collect();
    dataset.geometry = Geometry::Mesh(Mesh {
        parts,
        materials: vec![Material {
            is_double_sided: true,
            ..Material::default()
        }],
        textures: Vec::new(),
    });
    Ok(dataset)
}

/// Returns the nodes along the two indices of a layer, the faster index first; `None` if the grid is no layer,
/// or too large for a mesh.
fn sides(dims: [usize; 3]) -> Option<(usize, usize)> {
    let wide: Vec<usize> = dims.iter().copied().filter(|n| *n > 1).collect();
    let [wide, high] = wide[..] else {
        return None;
    };
    let is_small = wide
        .checked_mul(high)
        .is_some_and(|n| u32::try_from(n).is_ok());
    is_small.then_some((wide, high))
}
