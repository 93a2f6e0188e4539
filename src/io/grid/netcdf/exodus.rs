//! Reads Exodus II: unstructured grids of finite elements, in blocks of one type each, with results at several
//! times.
//!
//! | variable | content |
//! |---|---|
//! | `coordx`, `coordy`, `coordz`, or `coord` (axis, node) | positions |
//! | `connectB` (element, node), attribute `elem_type` | the elements of block B, by nodes counted from 1 |
//! | `connectB` of one dimension, `ebepecntB` (element) | polygons of several sizes (`NSIDED`), and the number of nodes of each |
//! | `time_whole` (step) | times |
//! | `name_nod_var`; `vals_nod_varV` (step, node), or `vals_nod_var` (step, variable, node) | results at nodes |
//! | `name_elem_var`; `vals_elem_varVebB` (step, element) | results in elements, for blocks that have them |
//!
//! Positions are those of the start: displacements are fields. Results whose names differ in a last X, Y and Z
//! become a vector, as in VTK. An element of a block without a result has NaN there.

use std::ops::Range;

use glam::DVec3;
use netcdf_reader::NcVariable;

use super::elements::{Element, element};
use super::{DAMAGED, NetcdfFile, text};
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::options::ReadAs;
use crate::io::particles::table::{joined, list};
use crate::io::time_steps::chosen;
use crate::io::vtk;
use crate::io::vtk::xml::clip;
use crate::scene::Values;

/// Whether the variables are those of Exodus.
pub(super) fn is_exodus(file: &NetcdfFile<'_>) -> Result<bool> {
    let has_positions = file.variable("coord")?.is_some() || file.variable("coordx")?.is_some();
    Ok(has_positions && file.dimension("num_nodes")?.is_some())
}

/// The times of the results.
///
/// # Errors
/// A damaged file.
pub(super) fn times(file: &NetcdfFile<'_>) -> Result<Vec<f64>> {
    match file.variable("time_whole")? {
        Some(times) if times.ndim() == 1 => file.doubles(times, &[]),
        _ => Ok(Vec::new()),
    }
}

/// Reads the elements of all blocks, with the results of one time.
///
/// # Errors
/// No nodes; elements with nodes that do not exist; arrays of other lengths than the file's dimensions.
pub(super) fn read(
    file: &NetcdfFile<'_>,
    time_step: Option<usize>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let times = times(file)?;
    let (step, note) = chosen(file.path, &times, time_step)?;
    let mut notes: Vec<String> = note.into_iter().collect();
    let (nodes, axis_count) = positions(file)?;
    let mut mesh = CellMesh {
        nodes,
        offsets: vec![0],
        ..CellMesh::default()
    };
    let mut blocks = Vec::new();
    for (number, connect) in connectivities(file)? {
        let before = mesh.cell_count();
        let left_out = append_block(file, number, connect, &mut mesh)?;
        notes.extend(left_out);
        blocks.push(Block {
            number,
            cells: before..mesh.cell_count(),
        });
    }
    let mut fields = Vec::new();
    if !times.is_empty() {
        let axes = axis_count.clamp(2, 3);
        let of_nodes = node_results(file, step, mesh.nodes.len())?;
        fields.extend(joined(of_nodes, Association::Nodes, axes));
        let of_cells = element_results(file, step, mesh.cell_count(), &blocks)?;
        fields.extend(joined(of_cells, Association::Cells, axes));
    }
    if let Some(globals) = file.variable("name_glo_var")? {
        let names = file.texts(globals)?;
        let names = list(names.iter().map(String::as_str));
        notes.push(format!("Left out, because they are of no place: {names}."));
    }
    let mut data = vtk::grid::dataset(file.path, "Exodus II", mesh, fields, read_as)?;
    data.notes.splice(0..0, notes);
    Ok(data)
}

/// The cells of one block.
struct Block {
    /// Block number, counted from 1.
    number: u64,
    cells: Range<usize>,
}

/// The elements of all blocks, with the block numbers, in their order. A block without elements has none.
fn connectivities<'f>(file: &'f NetcdfFile<'_>) -> Result<Vec<(u64, &'f NcVariable)>> {
    let number = |v: &'f NcVariable| Some((v.name().strip_prefix("connect")?.parse().ok()?, v));
    let mut found: Vec<(u64, &NcVariable)> = file.variables()?.iter().filter_map(number).collect();
    found.sort_by_key(|(number, _)| *number);
    Ok(found)
}

/// The positions of all nodes, and the number of coordinates in the file.
fn positions(file: &NetcdfFile<'_>) -> Result<(Vec<DVec3>, usize)> {
    let axes = match file.variable("coord")? {
        Some(all) if all.ndim() == 2 => {
            let count = usize::try_from(all.shape()[0]).unwrap_or(usize::MAX).min(3);
            let axes = (0..count).map(|axis| file.doubles(all, &[axis]));
            axes.collect::<Result<Vec<_>>>()?
        }
        _ => {
            let mut axes = Vec::new();
            for name in ["coordx", "coordy", "coordz"] {
                if let Some(axis) = file.variable(name)? {
                    axes.push(file.doubles(axis, &[])?);
                }
            }
            axes
        }
    };
    let count = axes.first().map_or(0, Vec::len);
    if let Some(other) = axes.iter().find(|axis| axis.len() != count) {
        let expected = format!("{count} numbers of each axis");
        let found = other.len().to_string();
        return Err(Error::format(
            file.path,
            "coordinates",
            expected,
            found,
            DAMAGED,
        ));
    }
    let node = |i: usize| {
        let at = |axis: usize| axes.get(axis).map_or(0.0, |numbers| numbers[i]);
        DVec3::new(at(0), at(1), at(2))
    };
    Ok(((0..count).map(node).collect(), axes.len()))
}

/// Appends the elements of a block; returns a note if they are left out.
fn append_block(
    file: &NetcdfFile<'_>,
    number: u64,
    connect: &NcVariable,
    mesh: &mut CellMesh,
) -> Result<Option<String>> {
    let name = text(connect.attributes(), "elem_type").unwrap_or_default();
    let shape = connect.shape();
    let is_polygons = name.to_ascii_lowercase().starts_with("nsided");
    let left_out = |what: &str| {
        let name = clip(&name);
        Ok(Some(format!(
            "Block {number} is left out: {what} `{name}` are not read."
        )))
    };
    let per_element = match (is_polygons, shape.as_slice()) {
        (true, [_]) => {
            let counts = file.variable(&format!("ebepecnt{number}"))?;
            let counts = counts.map(|counts| file.doubles(counts, &[])).transpose()?;
            let Some(counts) = counts else {
                let expected = format!("`ebepecnt{number}` beside it, the sizes of its polygons");
                return Err(file.fault(connect, expected, "none".into()));
            };
            return append_polygons(file, connect, &counts, mesh).map(|()| None);
        }
        (false, [_, per_element]) => usize::try_from(*per_element).unwrap_or(usize::MAX),
        _ => return left_out("elements of the type"),
    };
    let Some(Element { kind, order }) = element(&name, per_element) else {
        return left_out(&format!("elements of {per_element} nodes of the type"));
    };
    let nodes = node_numbers(file, connect, mesh.nodes.len())?;
    for cell in nodes.chunks_exact(per_element) {
        match order {
            Some(order) => mesh
                .connectivity
                .extend(order.iter().map(|&i| cell[usize::from(i)])),
            None => mesh.connectivity.extend(cell),
        }
        finish_cell(file, kind, mesh)?;
    }
    Ok(None)
}

fn append_polygons(
    file: &NetcdfFile<'_>,
    connect: &NcVariable,
    counts: &[f64],
    mesh: &mut CellMesh,
) -> Result<()> {
    let nodes = node_numbers(file, connect, mesh.nodes.len())?;
    let mut rest = nodes.as_slice();
    for &count in counts {
        let is_whole = (3.0..=f64::from(u32::MAX)).contains(&count) && count.fract() == 0.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number within the range above"
        )]
        let polygon = is_whole
            .then(|| rest.split_at_checked(count as usize))
            .flatten();
        let Some((polygon, others)) = polygon else {
            let expected = format!("polygons of 3 nodes or more, {} in all", nodes.len());
            return Err(file.fault(connect, expected, format!("one of {count} nodes")));
        };
        mesh.connectivity.extend(polygon);
        finish_cell(file, CellKind::POLYGON, mesh)?;
        rest = others;
    }
    Ok(())
}

fn finish_cell(file: &NetcdfFile<'_>, kind: CellKind, mesh: &mut CellMesh) -> Result<()> {
    let end = u32::try_from(mesh.connectivity.len()).map_err(|_| {
        let expected = format!("at most {} nodes of elements", u32::MAX);
        let advice = "save it in several files, and read them one by one";
        Error::format(file.path, "elements", expected, "more", advice)
    })?;
    mesh.offsets.push(end);
    mesh.kinds.push(kind);
    Ok(())
}

/// Nodes counted from 0.
fn node_numbers(
    file: &NetcdfFile<'_>,
    connect: &NcVariable,
    node_count: usize,
) -> Result<Vec<u32>> {
    let numbers = file.doubles(connect, &[])?;
    let node = |&number: &f64| {
        let is_node = number >= 1.0 && number <= node_count as f64 && number.fract() == 0.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number of at least 1; one beyond `u32` saturates, and is no node of a checked mesh"
        )]
        is_node.then_some((number - 1.0) as u32).ok_or_else(|| {
            let expected = format!("nodes from 1 to {node_count}");
            file.fault(connect, expected, number.to_string())
        })
    };
    numbers.iter().map(node).collect()
}

/// Names of results, and their values.
type Results = Vec<(String, Values)>;

fn node_results(file: &NetcdfFile<'_>, step: usize, count: usize) -> Result<Results> {
    let Some(names) = file.variable("name_nod_var")? else {
        return Ok(Vec::new());
    };
    let mut results = Vec::new();
    let together = file.variable("vals_nod_var")?;
    for (i, name) in file.texts(names)?.into_iter().enumerate() {
        let (variable, at) = match file.variable(&format!("vals_nod_var{}", i + 1))? {
            Some(own) => (own, vec![step]),
            None => match together {
                Some(all) => (all, vec![step, i]),
                None => continue,
            },
        };
        results.push((name, numbers(file, variable, &at, count)?));
    }
    Ok(results)
}

/// The values at one time, one for each of `count` nodes or elements.
fn numbers(
    file: &NetcdfFile<'_>,
    variable: &NcVariable,
    at: &[usize],
    count: usize,
) -> Result<Values> {
    let shape = variable.shape();
    let is_there = |(length, i): (&u64, &usize)| *length > *i as u64;
    let is_whole = shape.len() == at.len() + 1
        && shape.iter().zip(at).all(is_there)
        && shape[at.len()] == count as u64;
    if !is_whole {
        let place: Vec<String> = at.iter().map(|i| format!("more than {i}, ")).collect();
        let expected = format!("dimensions of {}{count}", place.concat());
        return Err(file.fault(variable, expected, format!("{shape:?}")));
    }
    file.values(variable, at)
}

fn element_results(
    file: &NetcdfFile<'_>,
    step: usize,
    count: usize,
    blocks: &[Block],
) -> Result<Results> {
    let Some(names) = file.variable("name_elem_var")? else {
        return Ok(Vec::new());
    };
    let mut results = Vec::new();
    for (i, name) in file.texts(names)?.into_iter().enumerate() {
        file.spend(
            || format!("results `{name}`"),
            Some(count),
            size_of::<f64>(),
        )?;
        let mut all = vec![f64::NAN; count];
        for block in blocks.iter().filter(|block| !block.cells.is_empty()) {
            let own = file.variable(&format!("vals_elem_var{}eb{}", i + 1, block.number))?;
            // A block without this result has no variable for it.
            let Some(own) = own else { continue };
            let values = numbers(file, own, &[step], block.cells.len())?;
            for (to, from) in block.cells.clone().zip(0..) {
                all[to] = values.wide(from);
            }
        }
        results.push((name, all.into()));
    }
    Ok(results)
}
