//! Reads CGNS files in HDF5 (`.cgns`): bases of structured and unstructured zones with solutions.
//!
//! | node | module |
//! |---|---|
//! | `CGNSBase_t`, `BaseIterativeData_t`, `ZoneIterativeData_t` | here |
//! | `Zone_t`, `GridCoordinates_t`, `FlowSolution_t`, `DiscreteData_t` | [`zone`] |
//! | `Elements_t` | [`sections`]; their types: [`elements`] |
//! | the tree in HDF5 | [`tree`] |
//!
//! Bases of fewer dimensions than others are left out; all zones are read together. Arrays whose names differ in a last X, Y
//! and Z become a vector. Planes of rind, beyond the zone's own nodes or cells, are left out.
//!
//! Source: the CGNS Standard Interface Data Structures (SIDS), version 4.

mod elements;
mod sections;
mod tree;
mod zone;

use self::tree::{DAMAGED, Node, Tree};
use super::budget::Budget;
use super::zones::joined;
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{NotIntegers, integers};
use crate::io::options::ReadAs;
use crate::io::particles::hdf5::arrays::ShapedArray;
use crate::io::particles::table::list;
use crate::io::time_steps::{self, TimeStep, chosen};

/// Name of a node that each file has.
const VERSION: &[u8] = b"CGNSLibraryVersion";

/// Returns true if the first bytes of an HDF5 file contain the name of CGNS's version. The name may also stand farther
/// behind.
pub(in crate::io) fn is_named(head: &[u8]) -> bool {
    head.windows(VERSION.len()).any(|bytes| bytes == VERSION)
}

/// Reads all zones at one time.
///
/// # Errors
/// A damaged file; nodes of other kinds than those that are read; arrays of other lengths than their zones.
pub(in crate::io) fn read(
    input: Input<'_>,
    time_step: Option<usize>,
    read_as: Option<ReadAs>,
) -> Result<Dataset> {
    let path = input.path;
    let (_, len) = input.open()?;
    let len = usize::try_from(len).unwrap_or(usize::MAX);
    // Arrays may be packed.
    let budget = Budget::new(path, len.saturating_mul(4));
    let tree = Tree::open(input)?;
    let bases = bases(&tree)?;
    let times = times(&tree, &bases)?;
    let (step, note) = chosen(path, &times, time_step)?;
    let mut notes: Vec<String> = note.into_iter().collect();
    let most = bases.iter().map(|base| base.cell_dim).max().unwrap_or(0);
    let others = bases.iter().filter(|base| base.cell_dim < most);
    let others: Vec<&str> = others.map(|base| base.node.name.as_str()).collect();
    if !others.is_empty() {
        let names = list(others.into_iter());
        notes.push(format!("Bases of fewer dimensions are left out: {names}."));
    }
    let mut zones = Vec::new();
    let step = (!times.is_empty()).then_some(step);
    let mut reading = zone::Reading::new(&tree, &budget, step);
    for base in bases.iter().filter(|base| base.cell_dim == most) {
        for node in tree.children(&base.node)? {
            if node.label == "Zone_t" {
                zones.extend(reading.zone(base, &node)?);
            }
        }
    }
    notes.extend(reading.notes());
    if zones.is_empty() {
        let advice = "the file holds no grid: save another";
        return Err(Error::format(
            path,
            "bases",
            "a zone with coordinates",
            "none",
            advice,
        ));
    }
    let mut data = joined(path, "CGNS", zones, &budget, read_as)?;
    data.notes.splice(0..0, notes);
    Ok(data)
}

/// Reads the times of the solutions.
///
/// # Errors
/// As [`read`].
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let path = input.path;
    let tree = Tree::open(input)?;
    let times = times(&tree, &bases(&tree)?)?;
    Ok(time_steps::of_file(path, &times))
}

/// A base, with its numbers of dimensions.
struct Base {
    node: Node,
    /// Dimensions of the cells.
    cell_dim: i64,
    /// Dimensions of the space.
    space_dim: i64,
}

fn bases(tree: &Tree<'_>) -> Result<Vec<Base>> {
    let mut bases = Vec::new();
    for node in tree.bases()? {
        let dims = tree.numbers(&node)?;
        let dims = dims.map(|dims| whole(tree, &node, &dims)).transpose()?;
        let (cell_dim, space_dim) = match dims.as_deref() {
            Some(&[cell_dim @ 1..=3, space_dim @ 1..=3]) => (cell_dim, space_dim),
            // Some writers leave them out.
            None => (3, 3),
            Some(other) => {
                let expected = "dimensions of cells and of space, 1 to 3";
                return Err(tree.fault(&node, expected, format!("{other:?}")));
            }
        };
        bases.push(Base {
            node,
            cell_dim,
            space_dim,
        });
    }
    match bases.is_empty() {
        false => Ok(bases),
        true => Err(Error::format(
            tree.path,
            "root",
            "a `CGNSBase_t`",
            "none",
            DAMAGED,
        )),
    }
}

/// The times of the first base that states some.
fn times(tree: &Tree<'_>, bases: &[Base]) -> Result<Vec<f64>> {
    for base in bases {
        for iterative in of_label(tree, &base.node, "BaseIterativeData_t")? {
            let children = tree.children(&iterative)?;
            let Some(values) = children.iter().find(|child| child.name == "TimeValues") else {
                continue;
            };
            let array = tree.numbers(values)?;
            return Ok(array.map(|array| array.numbers(0, 1)).unwrap_or_default());
        }
    }
    Ok(Vec::new())
}

fn of_label(tree: &Tree<'_>, node: &Node, label: &str) -> Result<Vec<Node>> {
    let children = tree.children(node)?;
    Ok(children
        .into_iter()
        .filter(|child| child.label == label)
        .collect())
}

/// Returns whole numbers.
fn whole(tree: &Tree<'_>, node: &Node, array: &ShapedArray) -> Result<Vec<i64>> {
    let numbers = integers(&array.bytes, array.encoding, |n| i64::try_from(n).ok());
    numbers.map_err(|fault| {
        let found = match fault {
            NotIntegers::Fractions => "real numbers".to_owned(),
            NotIntegers::Refused(_, number) => number.to_string(),
        };
        tree.fault(node, "whole numbers", found)
    })
}
