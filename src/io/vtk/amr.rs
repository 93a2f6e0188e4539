//! Reads VTK's levels of refinement as XML (`.vthb`, `.vth`, and `.vtm` of old ParaView): a list of images.
//!
//! ```text
//! <VTKFile type="vtkOverlappingAMR" version="1.1">         <VTKFile type="vtkHierarchicalBoxDataSet" version="0.1">
//!   <vtkOverlappingAMR origin="x y z">                        <vtkHierarchicalBoxDataSet>
//!     <Block level="0" spacing="x y z">                          <DataSet group="0" dataset="0" amr_box="..." file="a.vti"/>
//!       <DataSet index="0" amr_box="..." file="a/a_0.vti"/>      ...
//!     </Block> ...                                             </vtkHierarchicalBoxDataSet>
//!   </vtkOverlappingAMR>
//! </VTKFile>
//! ```
//!
//! The images store their own positions and spacings; the list stores their levels, in `level` or `group`.
//! [`crate::io::grid::amr`] converts them to a data set.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use glam::DVec3;
use roxmltree::Node;

use super::array::Array;
use super::vti;
use super::xml::{Frame, child_among, clip};
use crate::data::association::Association;
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::grid::amr::{self, Level, Patch};
use crate::io::volume::voxels;
use crate::scene::{Lattice, LatticeSpacing};

/// Types of these files.
pub(in crate::io) const TYPES: [&str; 3] = [
    "vtkOverlappingAMR",
    "vtkHierarchicalBoxDataSet",
    "vtkHierarchicalDataSet",
];

/// Greatest number of levels; far more than anything writes.
const MOST_LEVELS: usize = 64;

const DAMAGED: &str = "the file is damaged: save it again";

/// Reads the boxes of all levels.
///
/// # Errors
/// A damaged list; images that are missing or named twice; images outside the lattice of their level.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let frame = Frame::new(path, &bytes)?;
    let document = frame.document()?;
    let whole = child_among(document.root_element(), &TYPES);
    let mut named = Vec::new();
    for node in whole.into_iter().flat_map(|whole| whole.children()) {
        if node.has_tag_name("Block") {
            for file in node.children().filter(|n| n.has_tag_name("DataSet")) {
                named.extend(entry(path, node.attribute("level"), file)?);
            }
        } else if node.has_tag_name("DataSet") {
            named.extend(entry(path, node.attribute("group"), node)?);
        }
    }
    let level_count = named.iter().map(|(level, _)| level + 1).max().unwrap_or(0);
    let mut levels: Vec<Option<Level>> = vec![None; level_count];
    let mut patches = Vec::new();
    let mut seen = HashSet::new();
    for (level, file) in named {
        // A file named repeatedly would be in memory as many times.
        let resolved = input.resolved_beside(&file).ok_or_else(|| {
            let found = format!("no file `{}`", clip(&file.display().to_string()));
            let advice = "put the file there";
            Error::format(
                path,
                "DataSet, `file`",
                "a file beside the list",
                found,
                advice,
            )
        })?;
        if !seen.insert(resolved) {
            let found = format!("`{}` again", clip(&file.display().to_string()));
            return Err(Error::format(
                path,
                "DataSet, `file`",
                "each file once",
                found,
                DAMAGED,
            ));
        }
        let image = input.with_beside(&file, vti::read)?;
        patches.push(patch(image, level, &mut levels[level])?);
    }
    let levels: Option<Vec<Level>> = levels.into_iter().collect();
    let levels = levels.ok_or_else(|| {
        let expected = "an image of each level";
        Error::format(path, "DataSet", expected, "a level without any", DAMAGED)
    })?;
    amr::dataset(path, "VTK levels of refinement", levels, patches)
}

/// The level and the file of a `DataSet`; `None` if it is empty.
fn entry(path: &Path, level: Option<&str>, node: Node<'_, '_>) -> Result<Option<(usize, PathBuf)>> {
    let Some(file) = node.attribute("file").filter(|file| !file.is_empty()) else {
        return Ok(None);
    };
    let level = level.unwrap_or("0").trim();
    let number = level.parse().ok().filter(|n| *n < MOST_LEVELS);
    let number = number.ok_or_else(|| {
        let expected = format!("a level below {MOST_LEVELS}");
        Error::format(
            path,
            "level",
            expected,
            format!("`{}`", clip(level)),
            DAMAGED,
        )
    })?;
    Ok(Some((
        number,
        voxels::beside_as(path, "DataSet, `file`", file)?,
    )))
}

/// Converts an image to a part of its level's lattice, which the level's first image defines.
fn patch(image: Dataset, level: usize, lattice: &mut Option<Level>) -> Result<Patch> {
    let fault = |expected: &str, found: String| {
        Error::format(&image.path, "ImageData", expected, found, DAMAGED)
    };
    let Geometry::Lattice(Lattice {
        dims,
        spacing: LatticeSpacing::Uniform { origin, step },
    }) = &image.geometry
    else {
        return Err(fault("an image", "another data set".into()));
    };
    let spacing = DVec3::new(step.x_axis.x, step.y_axis.y, step.z_axis.z);
    if *step != glam::DMat3::from_diagonal(spacing) {
        return Err(fault("an image along the axes", "a turned one".into()));
    }
    let of_level = *lattice.get_or_insert(Level {
        origin: *origin,
        spacing,
    });
    let first = (*origin - of_level.origin) / of_level.spacing;
    let off = (first - first.round()).abs().max_element();
    let stretched = (spacing / of_level.spacing - 1.0).abs().max_element();
    // Tolerances for single precision, some thousand cells away. Phrased so that NaN is refused.
    if !(off < 0.01 && stretched < 1e-4) {
        let expected = "the lattice of the other images of its level";
        return Err(fault(expected, format!("spacing {spacing} from {origin}")));
    }
    let first = first.round().clamp(DVec3::splat(-1e15), DVec3::splat(1e15));
    #[allow(
        clippy::cast_possible_truncation,
        reason = "it is whole and was clamped"
    )]
    let first = first.to_array().map(|n| n as i64);
    let mut patch = Patch {
        level,
        first,
        cells: dims.map(|n| n.saturating_sub(1)),
        node_arrays: Vec::new(),
        cell_arrays: Vec::new(),
    };
    for field in image.fields {
        match field.association {
            Association::Nodes => patch.node_arrays.extend(Array::of_field(field)),
            Association::Cells => patch.cell_arrays.extend(Array::of_field(field)),
        }
    }
    Ok(patch)
}
