//! Reads EnSight Gold: a case file (`.case`) that names a geometry and variables, each in separate files, at one or
//! several times.
//!
//! | file | module |
//! |---|---|
//! | the case file | [`case`] |
//! | the geometry: parts of elements, and structured blocks | [`geometry`] |
//! | variables, for each part that has them | [`variable`] |
//! | their words and numbers: text, C binary, Fortran binary | [`stream`] |
//!
//! All parts of elements form one unstructured grid. A single block becomes a lattice if its axes allow it, and several
//! become curvilinear blocks. Blocks beside parts of elements become hexahedra and quadrilaterals. Tensors become
//! vectors of six or nine numbers, and complex numbers become two fields.
//!
//! Source: the chapter on EnSight Gold files in EnSight's user manual.

mod case;
mod geometry;
mod stream;
mod variable;

use crate::data::association::Association;
use crate::io::grid::ensight::stream::DAMAGED;
use crate::io::vtk;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::DVec3;

use self::case::Case;
use self::geometry::{Block, Part, Places, Shape};
use self::stream::{Form, Stream};
use super::block_cells;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::options::ReadAs;
use crate::io::time_steps::{self, TimeStep, chosen};
use crate::scene::{Lattice, LatticeSpacing, Values};

pub(in crate::io) use self::case::looks_like;

/// Greatest number of times that a file may be named. Some case files name one file for the real and the imaginary
/// part.
const MOST_USES: usize = 2;

/// Greatest number of bytes of all fields per byte read. Fields may be larger than files, because parts may lack
/// variables.
const MOST_INFLATION: usize = 8;

/// Additional bytes that fields may use in any case.
const SMALL: usize = 16 << 20;

/// Reads the geometry and all variables at one time.
///
/// # Errors
/// A file is missing or named too often, is not EnSight Gold, or ends before its numbers do.
pub(in crate::io) fn read(
    input: Input<'_>,
    time_step: Option<usize>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let path = input.path;
    let case = Case::parse(path, &String::from_utf8_lossy(&input.read_all()?))?;
    let times = case.times();
    let (step, note) = chosen(path, &times, time_step)?;
    let time = times.get(step).copied();
    let mut notes: Vec<String> = note.into_iter().chain(case.note()).collect();
    let mut files = Files {
        input,
        uses: HashMap::new(),
        byte_count: 0,
    };
    let model = case.model.as_ref().ok_or_else(|| {
        let expected = "the geometry's file";
        Error::format(path, "GEOMETRY, model", expected, "none", "name it there")
    })?;
    let place = case.place(path, model, time)?;
    let bytes = files.read(&place.path)?;
    let form = Form::of(&bytes);
    let parts = geometry::read(&mut Stream::new(&place.path, bytes, form, place.step)?)?;
    let layout = variable::Layout::of(&parts);
    let mut fields = Vec::new();
    for variable in &case.variables {
        let place = case.place(path, &variable.file, time)?;
        let bytes = files.read(&place.path)?;
        files.check_share(&layout, variable.components)?;
        let mut stream = Stream::new(&place.path, bytes, form, place.step)?;
        let association = match variable.is_of_nodes {
            true => Association::Nodes,
            false => Association::Cells,
        };
        let mut components = layout.read(&mut stream, association, variable.components)?;
        let source = match components.len() {
            1 => FieldSource::Scalar(components.remove(0)),
            _ => FieldSource::Vector(components),
        };
        fields.push(Field {
            name: variable.name.clone(),
            association,
            source,
            unit: None,
        });
    }
    fields.extend(iblank(&parts));
    files.check_share(&layout, 3 * size_of::<f64>() / size_of::<f32>())?;
    let mut data = joined(path, parts, fields, read_as)?;
    notes.append(&mut data.notes);
    data.notes = notes;
    Ok(data)
}

/// Reads the time steps that the case file names.
///
/// # Errors
/// The errors of [`read`] for the case file itself.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let case = Case::parse(input.path, &String::from_utf8_lossy(&input.read_all()?))?;
    Ok(time_steps::of_file(input.path, &case.times()))
}

/// Reader of the files that a case file names.
struct Files<'a> {
    input: Input<'a>,
    uses: HashMap<PathBuf, usize>,
    /// Total number of bytes read.
    byte_count: usize,
}

impl Files<'_> {
    fn read(&mut self, path: &Path) -> Result<Vec<u8>> {
        let uses = self.uses.entry(path.to_path_buf()).or_default();
        *uses += 1;
        if *uses > MOST_USES {
            let found = format!("`{}` again", path.display());
            let expected = "each file once, or for both parts of complex numbers";
            return Err(Error::format(
                self.input.path,
                "files that it names",
                expected,
                found,
                DAMAGED,
            ));
        }
        let bytes = self.input.read_beside(path)?;
        self.byte_count = self.byte_count.saturating_add(bytes.len());
        Ok(bytes)
    }

    /// Checks that a field's size is in proportion to the bytes read.
    fn check_share(&mut self, layout: &variable::Layout<'_>, components: usize) -> Result<()> {
        let most = self
            .byte_count
            .saturating_mul(MOST_INFLATION)
            .saturating_add(SMALL);
        let wanted = layout
            .most()
            .saturating_mul(components)
            .saturating_mul(size_of::<f32>());
        if wanted <= most {
            return Ok(());
        }
        let expected = format!("nodes and cells whose numbers are at most {most} bytes");
        let found = format!("{wanted} bytes");
        Err(Error::format(
            self.input.path,
            "files that it names",
            expected,
            found,
            DAMAGED,
        ))
    }
}

/// Returns the blanking of all nodes as a field: 1 for nodes without blanking.
fn iblank(parts: &[Part]) -> Option<Field> {
    let blanks = |part: &Part| matches!(&part.shape, Shape::Block(block) if block.iblank.is_some());
    if !parts.iter().any(blanks) {
        return None;
    }
    let mut all: Vec<f32> = Vec::new();
    for part in parts {
        match &part.shape {
            Shape::Block(Block {
                iblank: Some(iblank),
                ..
            }) => all.extend(iblank.iter().map(|&n| n as f32)),
            _ => all.resize(all.len() + part.node_count(), 1.0),
        }
    }
    Some(Field {
        name: "iblank".to_owned(),
        association: Association::Nodes,
        source: FieldSource::Scalar(Values::F32(all)),
        unit: None,
    })
}

/// Joins all parts to one geometry.
fn joined(
    path: &Path,
    parts: Vec<Part>,
    fields: Vec<Field>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    const FORMAT: &str = "EnSight Gold";
    if let [
        Part {
            shape: Shape::Block(block),
            ..
        },
    ] = parts.as_slice()
        && let Some(lattice) = lattice(block)
    {
        return Ok(Dataset::new(
            path,
            FORMAT,
            Geometry::Lattice(lattice),
            fields,
        ));
    }
    let blocks: Option<Vec<&Block>> = parts
        .iter()
        .map(|part| match &part.shape {
            Shape::Block(block) => Some(block),
            Shape::Elements { .. } => None,
        })
        .collect();
    if let Some(blocks) = blocks.filter(|blocks| !blocks.is_empty()) {
        // A block with a single layer of nodes has one layer of cells; a curvilinear grid would have none.
        let is_flat = |block: &&Block| block.dims.contains(&1);
        if !blocks.iter().any(is_flat) {
            let blocks = blocks.into_iter().map(|block| CurvilinearBlock {
                dims: block.dims,
                nodes: block.nodes(),
            });
            let blocks = blocks.collect();
            return Ok(Dataset::new(
                path,
                FORMAT,
                Geometry::Curvilinear { blocks },
                fields,
            ));
        }
    }
    let mut mesh = CellMesh {
        offsets: vec![0],
        ..CellMesh::default()
    };
    for part in parts {
        append(path, &mut mesh, part.shape)?;
    }
    vtk::grid::dataset(path, FORMAT, mesh, fields, read_as)
}

/// Returns a uniform or rectilinear block as a lattice, if its coordinates increase.
fn lattice(block: &Block) -> Option<Lattice> {
    let dims = block.dims;
    let rises = |axis: &Vec<f64>| {
        axis.iter().all(|x| x.is_finite()) && axis.windows(2).all(|w| w[0] < w[1])
    };
    let lattice = match &block.places {
        Places::Nodes(_) => return None,
        Places::Uniform { origin, step } => Lattice::uniform(dims, *origin, *step),
        Places::Axes(axes) if axes.iter().all(rises) => Lattice {
            dims,
            spacing: LatticeSpacing::Rectilinear {
                coordinates: axes.clone(),
            },
        },
        Places::Axes(_) => return None,
    };
    (lattice.validate().is_ok() && !dims.contains(&1)).then_some(lattice)
}

/// Appends the cells of a part.
fn append(path: &Path, mesh: &mut CellMesh, shape: Shape) -> Result<()> {
    let too_many = || {
        let expected = format!("at most {} nodes, and entries of cells", u32::MAX);
        let advice = "save the parts in files of their own";
        Error::format(path, "all parts together", expected, "more", advice)
    };
    let small = |n: usize| u32::try_from(n).map_err(|_| too_many());
    let first = small(mesh.nodes.len())?;
    match shape {
        Shape::Elements { nodes, blocks } => {
            small(mesh.nodes.len() + nodes.len())?;
            mesh.nodes.extend(nodes);
            for cells in blocks.into_iter().filter_map(|block| block.cells) {
                let mut start = 0;
                for &end in &cells.ends {
                    let before = mesh.connectivity.len();
                    mesh.connectivity
                        .extend_from_slice(&cells.connectivity[start..end]);
                    shift(cells.kind, &mut mesh.connectivity[before..], first);
                    mesh.kinds.push(cells.kind);
                    mesh.offsets.push(small(mesh.connectivity.len())?);
                    start = end;
                }
            }
        }
        Shape::Block(block) => {
            let nodes: Vec<DVec3> = block.nodes();
            small(mesh.nodes.len() + nodes.len())?;
            mesh.nodes.extend(nodes);
            block_cells::append(mesh, block.dims, first as usize).ok_or_else(too_many)?;
        }
    }
    Ok(())
}

/// Shifts the node numbers of a cell.
fn shift(kind: CellKind, mut cell: &mut [u32], by: u32) {
    if kind != CellKind::POLYHEDRON {
        cell.iter_mut().for_each(|n| *n += by);
        return;
    }
    cell = &mut cell[1..];
    while let Some((&mut count, rest)) = cell.split_first_mut() {
        let (face, rest) = rest.split_at_mut(count as usize);
        face.iter_mut().for_each(|n| *n += by);
        cell = rest;
    }
}
