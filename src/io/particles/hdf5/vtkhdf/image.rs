//! Reads images: a lattice with arrays (z, y, x), or (step, z, y, x) if there are time steps.

use std::path::Path;

use glam::DVec3;
use hdf5_reader::group::Group;

use super::{Block, numbers};
use crate::data::association::Association;
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::error::{Error, Result};
use crate::io::vtk::array::Array;
use crate::io::vtk::extent::Extent;
use crate::io::vtk::meshes::append_arrays;
use crate::io::vtk::pieces::{element_of, keep_common, to_fields};
use crate::io::vtk::vti;
use crate::scene::Lattice;

/// Lattice and arrays of an image.
pub(super) struct Image {
    lattice: Lattice,
    arrays: [Vec<Array>; 2],
}

impl Block<'_, '_> {
    pub(super) fn image(&self) -> Result<Image> {
        let group = &self.group;
        let whole = numbers::<6>(self, group, "WholeExtent")?;
        let whole = whole.and_then(Extent::from_reals).ok_or_else(|| {
            let expected = "the first and the last node along each axis";
            self.fault("attribute `WholeExtent`", expected, "something else".into())
        })?;
        let origin = numbers(self, group, "Origin")?.unwrap_or([0.0; 3]);
        let spacing = numbers(self, group, "Spacing")?.unwrap_or([1.0; 3]);
        let direction = numbers(self, group, "Direction")?;
        let direction = direction.unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let placed = vti::Placement {
            origin: DVec3::from_array(origin),
            spacing: DVec3::from_array(spacing),
            by_rows: direction,
        };
        let lattice = placed.lattice(self.file.path, &whole)?;
        let arrays = |association| match whole.count(association) {
            Some(count) if count > 0 => self.image_arrays(association, count),
            _ => Ok(Vec::new()),
        };
        let arrays = [arrays(Association::Nodes)?, arrays(Association::Cells)?];
        if arrays.iter().all(Vec::is_empty) {
            return Err(self.fault(
                "PointData and CellData",
                "at least one array of numbers",
                "none".into(),
            ));
        }
        Ok(Image { lattice, arrays })
    }

    fn image_arrays(&self, association: Association, count: usize) -> Result<Vec<Array>> {
        let Some(data) = self.file.child(&self.group, element_of(association))? else {
            return Ok(Vec::new());
        };
        let mut arrays = Vec::new();
        for name in self.file.names(&data)? {
            let shape = self.shape(&data, &name)?;
            let steps = usize::from(self.steps.is_some());
            let samples = shape.get(steps..).unwrap_or_default();
            // Trailing axes with one sample may be absent.
            let ranks = (1..=samples.len()).rev().find(|&n| {
                let product = samples[..n]
                    .iter()
                    .try_fold(1_u64, |product, n| product.checked_mul(*n));
                product.and_then(|n| usize::try_from(n).ok()) == Some(count)
            });
            let Some(ranks) = ranks else {
                let expected = format!("{count} numbers, or as many for each component");
                return Err(self.fault(&name, &expected, format!("shape {shape:?}")));
            };
            let rows = match self.steps {
                None => None,
                Some(_) => {
                    let step = self.data_start(association, &name)?.unwrap_or(self.step);
                    Some(step..step.saturating_add(1))
                }
            };
            arrays.extend(self.array(&data, &name, ranks + steps, rows)?);
        }
        Ok(arrays)
    }

    fn shape(&self, group: &Group, name: &str) -> Result<Vec<u64>> {
        let dataset = group.dataset(name);
        let dataset = dataset.map_err(|e| super::broken(self.file.path, name, &e))?;
        Ok(dataset.shape().to_vec())
    }
}

/// Returns one image as a lattice, and several as separate curvilinear grids.
pub(super) fn dataset(path: &Path, mut images: Vec<Image>) -> Result<Dataset> {
    const FORMAT: &str = "VTKHDF image data";
    let mut fields = Vec::new();
    if let [image] = images.as_mut_slice() {
        let Image { lattice, arrays } = image;
        for (arrays, association) in arrays.iter_mut().zip(Association::BOTH) {
            fields.extend(to_fields(std::mem::take(arrays), association));
        }
        let geometry = Geometry::Lattice(lattice.clone());
        return Ok(Dataset::new(path, FORMAT, geometry, fields));
    }
    let mut notes = Vec::new();
    for (i, association) in Association::BOTH.into_iter().enumerate() {
        let arrays = images
            .iter_mut()
            .map(|image| std::mem::take(&mut image.arrays[i]));
        let mut arrays: Vec<Vec<Array>> = arrays.collect();
        keep_common(&mut arrays, element_of(association), &mut notes);
        let arrays = arrays.into_iter().reduce(append_arrays).unwrap_or_default();
        fields.extend(to_fields(arrays, association));
    }
    if fields.is_empty() {
        let advice = "save them with the same arrays";
        let expected = "an array that all images have";
        return Err(Error::format(
            path,
            "PointData and CellData",
            expected,
            "none",
            advice,
        ));
    }
    let block = |image: &Image| {
        let dims = image.lattice.dims;
        let [nx, ny, _] = dims;
        let place = |n: usize| image.lattice.position([n % nx, n / nx % ny, n / (nx * ny)]);
        let nodes = (0..image.lattice.len()).map(place).collect();
        CurvilinearBlock { dims, nodes }
    };
    let blocks = images.iter().map(block).collect();
    Ok(Dataset {
        notes,
        ..Dataset::new(path, FORMAT, Geometry::Curvilinear { blocks }, fields)
    })
}
