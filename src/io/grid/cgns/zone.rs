//! Reads a zone: its nodes, its cells and its solutions.

use glam::DVec3;

use super::tree::{Node, Tree};
use super::{Base, sections, whole};
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::{CurvilinearBlock, Field};
use crate::error::{Error, Result};
use crate::io::grid::budget::Budget;
use crate::io::grid::highest::keep_highest;
use crate::io::grid::zones::{Shape, Zone, push_cell};
use crate::io::particles::table::{joined, list};
use crate::scene::Values;

/// Length of a name in a list of names.
const NAME: usize = 32;

/// Reader of zones, with what it leaves out.
pub(super) struct Reading<'a> {
    tree: &'a Tree<'a>,
    budget: &'a Budget<'a>,
    /// Index of the time; `None` if the file states none.
    step: Option<usize>,
    /// Elements of types that are not read.
    elements: usize,
    /// Notes on cells on the boundary of others, and zones without cells.
    about_cells: Vec<String>,
    /// Solutions at other places than nodes and cells.
    elsewhere: Vec<String>,
    /// Arrays that are not numbers.
    others: Vec<String>,
}

/// Counts of rind planes before and behind along each axis.
type Rind = Vec<[usize; 2]>;

impl<'a> Reading<'a> {
    pub(super) fn new(tree: &'a Tree<'a>, budget: &'a Budget<'a>, step: Option<usize>) -> Self {
        Self {
            tree,
            budget,
            step,
            elements: 0,
            about_cells: Vec::new(),
            elsewhere: Vec::new(),
            others: Vec::new(),
        }
    }

    /// Returns notes on what was left out.
    pub(super) fn notes(mut self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.elements > 0 {
            notes.push(format!(
                "Left out: {} elements of third order or above, or of types that are not known.",
                self.elements
            ));
        }
        self.about_cells.dedup();
        notes.append(&mut self.about_cells);
        for (names, why) in [
            (&mut self.elsewhere, "they are not at nodes or cells"),
            (&mut self.others, "they are no numbers"),
        ] {
            names.sort_unstable();
            names.dedup();
            if !names.is_empty() {
                let names = list(names.iter().map(String::as_str));
                notes.push(format!("Left out, because {why}: {names}."));
            }
        }
        notes
    }

    /// Reads a zone; `None` if it has no coordinates.
    pub(super) fn zone(&mut self, base: &Base, node: &Node) -> Result<Option<Zone>> {
        let tree = self.tree;
        let children = tree.children(node)?;
        let names = self.names_at_step(&children)?;
        let Some(coordinates) = self.grid(&children, names.grid.as_deref()) else {
            return Ok(None);
        };
        let sizes = tree.numbers(node)?;
        let sizes = sizes.map(|sizes| whole(tree, node, &sizes)).transpose()?;
        let kind = children
            .iter()
            .find(|child| child.label == "ZoneType_t" || child.name == "ZoneType");
        let kind = kind.map(|kind| tree.text(kind)).transpose()?;
        let is_structured = kind.as_deref() == Some("Structured");
        let dims = match (&sizes, is_structured) {
            (Some(sizes), true) => Some(self.dims(node, sizes, base)?),
            (None, true) => {
                return Err(tree.fault(node, "counts of nodes and cells", "none".to_owned()));
            }
            _ => None,
        };
        let stated = sizes.as_ref().and_then(|sizes| sizes.first().copied());
        let stated = stated.and_then(|count| usize::try_from(count).ok());
        let nodes = self.nodes(coordinates, dims, stated)?;
        let shape = match dims {
            Some(dims) => Shape::Block(CurvilinearBlock { dims, nodes }),
            None => Shape::Cells(self.cells(nodes, &children)?),
        };
        let mut fields = Vec::new();
        for child in &children {
            let is_solution = matches!(child.label.as_str(), "FlowSolution_t" | "DiscreteData_t");
            let is_now = !names.all.contains(&child.name) || names.now.contains(&child.name);
            if is_solution && is_now {
                self.solution(base, child, &shape, dims, &mut fields)?;
            }
        }
        Ok(Some(Zone { shape, fields }))
    }

    /// Returns the node of the coordinates.
    fn grid<'n>(&self, children: &'n [Node], name: Option<&str>) -> Option<&'n Node> {
        let mut grids = children
            .iter()
            .filter(|child| child.label == "GridCoordinates_t");
        let named = |name: &str| {
            let mut grids = children
                .iter()
                .filter(|child| child.label == "GridCoordinates_t");
            grids.find(|grid| grid.name == name)
        };
        let of_step = name.and_then(named).or_else(|| named("GridCoordinates"));
        of_step.or_else(|| grids.next())
    }

    fn dims(&self, node: &Node, sizes: &[i64], base: &Base) -> Result<[usize; 3]> {
        let count = usize::try_from(base.cell_dim).unwrap_or(3);
        let mut dims = [1; 3];
        for (dim, &size) in dims.iter_mut().zip(sizes).take(count) {
            *dim = usize::try_from(size).unwrap_or(0);
        }
        let is_whole = sizes.len() == 3 * count && !dims.contains(&0);
        match is_whole {
            true => Ok(dims),
            false => {
                let expected = format!("counts of nodes and cells along {count} axes");
                Err(self.tree.fault(node, expected, format!("{sizes:?}")))
            }
        }
    }

    /// Reads the counts of rind planes of a node.
    fn rind(&self, node: &Node) -> Result<Rind> {
        let tree = self.tree;
        let children = tree.children(node)?;
        let Some(rind) = children.iter().find(|child| child.label == "Rind_t") else {
            return Ok(Vec::new());
        };
        let array = tree.numbers(rind)?;
        let planes = array
            .map(|array| whole(tree, rind, &array))
            .transpose()?
            .unwrap_or_default();
        let plane = |&n: &i64| usize::try_from(n).ok();
        let planes: Option<Vec<usize>> = planes.iter().map(plane).collect();
        let fault = || {
            tree.fault(
                rind,
                "counts of planes before and behind each axis",
                "others".to_owned(),
            )
        };
        let planes = planes.ok_or_else(fault)?;
        if !planes.len().is_multiple_of(2) || planes.len() > 6 {
            return Err(fault());
        }
        Ok(planes
            .chunks_exact(2)
            .map(|pair| [pair[0], pair[1]])
            .collect())
    }

    fn nodes(
        &self,
        grid: &Node,
        dims: Option<[usize; 3]>,
        stated: Option<usize>,
    ) -> Result<Vec<DVec3>> {
        let tree = self.tree;
        let rind = self.rind(grid)?;
        let arrays = tree.children(grid)?;
        let count = dims.map(|dims| dims.iter().try_fold(1_usize, |n, &m| n.checked_mul(m)));
        let count = count.map_or(stated, |count| Some(count.unwrap_or(usize::MAX)));
        let mut axes = Vec::new();
        for name in ["CoordinateX", "CoordinateY", "CoordinateZ"] {
            let Some(array) = arrays.iter().find(|array| array.name == name) else {
                continue;
            };
            let Some(numbers) = tree.numbers(array)? else {
                continue;
            };
            let numbers = numbers.numbers(0, 1);
            let found = numbers.len();
            let numbers = without_rind(numbers.len(), dims, count, &rind)
                .map(|core| core.map(|i| numbers[i]).collect::<Vec<f64>>());
            axes.push((
                name,
                numbers.ok_or_else(|| {
                    let expected = match count {
                        Some(count) => format!("numbers of {count} nodes and of the rind {rind:?}"),
                        None => format!("numbers of nodes and of the rind {rind:?}"),
                    };
                    tree.fault(array, expected, format!("{found} numbers"))
                })?,
            ));
        }
        let Some(node_count) = axes.first().map(|(_, axis)| axis.len()) else {
            let names = list(arrays.iter().map(|array| array.name.as_str()));
            let place = format!("node `{}`", grid.name);
            let expected = "Cartesian coordinates: `CoordinateX`, `CoordinateY`, `CoordinateZ`";
            let advice = "turn it into Cartesian coordinates";
            return Err(Error::format(tree.path, place, expected, names, advice));
        };
        if axes.iter().any(|(_, axis)| axis.len() != node_count) {
            return Err(tree.fault(grid, "as many numbers of each axis", "others".to_owned()));
        }
        self.budget.spend("coordinates", node_count, 24)?;
        let at = |name: &str, i: usize| {
            let axis = axes.iter().find(|(own, _)| *own == name);
            axis.map_or(0.0, |(_, axis)| axis[i])
        };
        let node = |i| {
            DVec3::new(
                at("CoordinateX", i),
                at("CoordinateY", i),
                at("CoordinateZ", i),
            )
        };
        Ok((0..node_count).map(node).collect())
    }

    fn cells(&mut self, nodes: Vec<DVec3>, children: &[Node]) -> Result<CellMesh> {
        let mut mesh = CellMesh {
            nodes,
            offsets: vec![0],
            ..CellMesh::default()
        };
        let own = children.iter().filter(|child| child.label == "Elements_t");
        sections::append(self.tree, own, &mut mesh, &mut self.elements)?;
        if mesh.kinds.is_empty() {
            let note = "A zone without elements that are read: its nodes are points.";
            self.about_cells.push(note.to_owned());
            for i in 0..mesh.nodes.len() {
                mesh.connectivity.push(u32::try_from(i).unwrap_or(u32::MAX));
                push_cell(self.tree.path, &mut mesh, CellKind::VERTEX)?;
            }
        }
        self.about_cells.extend(keep_highest(&mut mesh, &mut []));
        Ok(mesh)
    }

    fn solution(
        &mut self,
        base: &Base,
        solution: &Node,
        shape: &Shape,
        dims: Option<[usize; 3]>,
        fields: &mut Vec<Field>,
    ) -> Result<()> {
        let tree = self.tree;
        let children = tree.children(solution)?;
        let location = children
            .iter()
            .find(|child| child.label == "GridLocation_t");
        let location = location.map(|location| tree.text(location)).transpose()?;
        let association = match location.as_deref().unwrap_or("Vertex") {
            "Vertex" => Association::Nodes,
            "CellCenter" => Association::Cells,
            _ => {
                self.elsewhere.push(solution.name.clone());
                return Ok(());
            }
        };
        // Solutions of some elements only have a list or a range of them.
        if children
            .iter()
            .any(|child| matches!(child.name.as_str(), "PointList" | "PointRange"))
        {
            self.elsewhere.push(solution.name.clone());
            return Ok(());
        }
        let rind = self.rind(solution)?;
        let count = shape.count_of(association);
        let dims = dims.map(|dims| match association {
            Association::Nodes => dims,
            Association::Cells => dims.map(|n| n.saturating_sub(1).max(1)),
        });
        let mut columns: Vec<(String, Values)> = Vec::new();
        for child in children.iter().filter(|child| child.label == "DataArray_t") {
            let Some(array) = tree.numbers(child)? else {
                self.others.push(child.name.clone());
                continue;
            };
            let size = array.encoding.scalar.size();
            let has = array.bytes.len() / size;
            let core = without_rind(has, dims, Some(count), &rind);
            let Some(core) = core else {
                let expected = format!(
                    "numbers of {count} {} and of the rind {rind:?}",
                    association.name()
                );
                return Err(tree.fault(child, expected, format!("{has} numbers")));
            };
            self.budget.spend("solutions", count, size)?;
            let all = array.values(0, 1);
            let values = match has == count {
                true => all,
                false => {
                    let core = core.map(|i| u32::try_from(i).unwrap_or(u32::MAX));
                    all.gather(&core.collect::<Vec<u32>>())
                }
            };
            columns.push((child.name.clone(), values));
        }
        let axes = usize::try_from(base.space_dim.max(2)).unwrap_or(3);
        for field in joined(columns, association, axes) {
            let is_same = |own: &Field| own.name == field.name && own.association == association;
            if !fields.iter().any(is_same) {
                fields.push(field);
            }
        }
        Ok(())
    }

    /// Reads which solutions and coordinates belong to the time.
    fn names_at_step(&self, children: &[Node]) -> Result<Names> {
        let mut names = Names::default();
        let iterative = children
            .iter()
            .find(|child| child.label == "ZoneIterativeData_t");
        let (Some(iterative), Some(step)) = (iterative, self.step) else {
            return Ok(names);
        };
        for pointers in self.tree.children(iterative)? {
            let is_grid = pointers.name == "GridCoordinatesPointers";
            if !is_grid && !pointers.name.starts_with("FlowSolution") {
                continue;
            }
            let Some(array) = self.tree.numbers(&pointers)? else {
                continue;
            };
            let name = |bytes: &[u8]| {
                String::from_utf8_lossy(bytes)
                    .trim_matches(['\0', ' '])
                    .to_owned()
            };
            let all: Vec<String> = array.bytes.chunks(NAME).map(name).collect();
            let now = all.get(step).cloned();
            if is_grid {
                names.grid = now;
            } else {
                names.now.extend(now);
                names.all.extend(all);
            }
        }
        Ok(names)
    }
}

/// Names of nodes that belong to times.
#[derive(Default)]
struct Names {
    grid: Option<String>,
    /// Solutions of this time.
    now: Vec<String>,
    /// Solutions of all times.
    all: Vec<String>,
}

/// Returns the indices of the numbers that are not of the rind; `None` if there are more or fewer numbers.
///
/// - `has`: number of all.
/// - `dims`: number along each axis without the rind, of structured zones.
/// - `count`: number of all without the rind; `None` if the file does not state it.
fn without_rind(
    has: usize,
    dims: Option<[usize; 3]>,
    count: Option<usize>,
    rind: &[[usize; 2]],
) -> Option<Box<dyn Iterator<Item = usize>>> {
    let has_rind = rind.iter().flatten().any(|&n| n > 0);
    if !has_rind {
        return (count.is_none_or(|count| count == has)).then(|| Box::new(0..has) as Box<_>);
    }
    let Some(dims) = dims else {
        // Of unstructured zones the rind lies before and behind all others.
        let [before, behind] = *rind.first()?;
        let core = has.checked_sub(before.checked_add(behind)?)?;
        let is_whole = count.is_none_or(|count| count == core);
        return is_whole.then(|| Box::new(before..before + core) as Box<_>);
    };
    let mut all = [1; 3];
    let mut first = [0; 3];
    for axis in 0..3 {
        let [before, behind] = rind.get(axis).copied().unwrap_or([0; 2]);
        all[axis] = dims[axis].checked_add(before)?.checked_add(behind)?;
        first[axis] = before;
    }
    let total = all.iter().try_fold(1_usize, |n, &m| n.checked_mul(m))?;
    if total != has {
        return None;
    }
    let count: usize = dims.iter().product();
    let [x, y, _] = dims;
    Some(Box::new((0..count).map(move |n| {
        let at = [n % x, n / x % y, n / (x * y)];
        let [i, j, k] = [0, 1, 2].map(|axis| at[axis] + first[axis]);
        i + all[0] * (j + all[1] * k)
    })))
}
