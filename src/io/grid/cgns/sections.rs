//! Reads the elements of an unstructured zone, section by section in the order of their numbers.
//!
//! | type | `ElementConnectivity` |
//! |---|---|
//! | a fixed type | the nodes of each element |
//! | `MIXED` | the type of each element and its nodes |
//! | `NGON_n` | the nodes of each polygon |
//! | `NFACE_n` | the polygons of each polyhedron by their numbers, negative if their nodes are anticlockwise seen from inside |
//!
//! `ElementStartOffset` states where each element of the last three begins; before version 4 a count preceded each
//! polygon and each polyhedron. Numbers count from 1. If there are no `NFACE_n`, `ParentElements` state the cells on both
//! sides of polygons. Polygons without either are cells themselves.

use super::elements::{MIXED, NFACE, NGON, element};
use super::tree::{Node, Tree};
use super::whole;
use crate::data::cells::{CellKind, CellMesh};
use crate::error::{Error, Result};
use crate::io::grid::face_cells;
use crate::io::grid::zones::{push_cell, too_many_entries};

/// A section.
struct Section<'n> {
    node: &'n Node,
    kind: i64,
    /// Number of its first element.
    first: i64,
    count: usize,
    connectivity: Vec<i64>,
    offsets: Option<Vec<i64>>,
    parents: Option<Vec<i64>>,
}

/// Polygons of all sections, by their numbers.
#[derive(Default)]
struct Polygons {
    /// Number of the first polygon of each section, and its index here.
    sections: Vec<(i64, usize, usize)>,
    offsets: Vec<usize>,
    nodes: Vec<u32>,
    /// Number of cells that each polygon has bounded so far.
    uses: Vec<u8>,
}

impl Polygons {
    fn index(&self, number: i64) -> Option<usize> {
        self.sections.iter().find_map(|&(first, at, count)| {
            let i = usize::try_from(number.checked_sub(first)?).ok()?;
            (i < count).then_some(at + i)
        })
    }

    fn nodes(&self, i: usize) -> &[u32] {
        &self.nodes[self.offsets[i]..self.offsets[i + 1]]
    }

    /// Returns the nodes of a polygon, turned if it faces inwards.
    fn outward(&self, i: usize, is_outward: bool) -> Vec<u32> {
        let mut nodes = self.nodes(i).to_vec();
        if !is_outward {
            nodes.reverse();
        }
        nodes
    }
}

/// Appends the elements of all sections to the nodes of a zone.
///
/// - `left_out`: receives the number of elements of types that are not read.
///
/// # Errors
/// Sections whose numbers are missing or too few; nodes that do not exist.
pub(super) fn append<'n>(
    tree: &Tree<'_>,
    nodes: impl Iterator<Item = &'n Node>,
    mesh: &mut CellMesh,
    left_out: &mut usize,
) -> Result<()> {
    let mut sections = Vec::new();
    for node in nodes {
        sections.extend(read(tree, node)?);
    }
    sections.sort_by_key(|section| section.first);
    let has_cells = |s: &Section<'_>| s.kind == NFACE || s.parents.is_some();
    let are_faces = sections.iter().any(has_cells);
    let mut polygons = Polygons {
        offsets: vec![0],
        ..Polygons::default()
    };
    for section in sections.iter().filter(|section| section.kind == NGON) {
        section.add_polygons(tree, mesh.nodes.len(), &mut polygons)?;
    }
    let has_polyhedra = sections.iter().any(|section| section.kind == NFACE);
    if are_faces && !has_polyhedra {
        of_parents(tree, &sections, &polygons, mesh)?;
    }
    for section in &sections {
        match section.kind {
            NGON if are_faces => {}
            NGON => {
                for i in section.own(&polygons) {
                    mesh.connectivity.extend(polygons.nodes(i));
                    push_cell(tree.path, mesh, CellKind::POLYGON)?;
                }
            }
            NFACE => section.add_polyhedra(tree, &mut polygons, mesh)?,
            MIXED => section.add_mixed(tree, mesh, left_out)?,
            kind => match element(kind) {
                Some(_) => section.add_fixed(tree, mesh)?,
                None => *left_out += section.count,
            },
        }
    }
    Ok(())
}

/// Reads the numbers of a section; `None` if it has no elements.
fn read<'n>(tree: &Tree<'_>, node: &'n Node) -> Result<Option<Section<'n>>> {
    let children = tree.children(node)?;
    let numbers = |name: &str| -> Result<Option<Vec<i64>>> {
        let Some(child) = children.iter().find(|child| child.name == name) else {
            return Ok(None);
        };
        let array = tree.numbers(child)?;
        array.map(|array| whole(tree, child, &array)).transpose()
    };
    let Some(connectivity) = numbers("ElementConnectivity")? else {
        return Ok(None);
    };
    let range = numbers("ElementRange")?;
    let range = match range.as_deref() {
        Some(&[first, last]) if first >= 1 && last >= first => Some((first, last - first + 1)),
        _ => None,
    };
    let count = range.and_then(|(first, count)| Some((first, usize::try_from(count).ok()?)));
    // Each element has a number at least.
    let count = count.filter(|(_, count)| *count <= connectivity.len());
    let Some((first, count)) = count else {
        let expected = "`ElementRange`: the first and the last number of its elements";
        return Err(tree.fault(node, expected, format!("{} numbers", connectivity.len())));
    };
    let own = tree.numbers(node)?;
    let own = own.map(|own| whole(tree, node, &own)).transpose()?;
    let kind = match own.as_deref() {
        Some([kind, ..]) => *kind,
        // Writers that leave the type out have tetrahedra only.
        _ if connectivity.len() == 4 * count => 10,
        _ => return Err(tree.fault(node, "the type of its elements", "none".to_owned())),
    };
    Ok(Some(Section {
        kind,
        first,
        count,
        connectivity,
        offsets: numbers("ElementStartOffset")?,
        parents: match kind {
            NGON => numbers("ParentElements")?,
            _ => None,
        },
        node,
    }))
}

fn index(tree: &Tree<'_>, node: &Node, node_count: usize, number: i64) -> Result<u32> {
    let at = number.checked_sub(1).and_then(|i| u32::try_from(i).ok());
    let at = at.filter(|&i| (i as usize) < node_count);
    at.ok_or_else(|| {
        tree.fault(
            node,
            format!("nodes from 1 to {node_count}"),
            number.to_string(),
        )
    })
}

impl Section<'_> {
    fn fault(&self, tree: &Tree<'_>, expected: &str, found: String) -> Error {
        tree.fault(self.node, expected, found)
    }

    /// Returns the indices of its polygons.
    fn own(&self, polygons: &Polygons) -> std::ops::Range<usize> {
        let found = polygons
            .sections
            .iter()
            .find(|(first, ..)| *first == self.first);
        found.map_or(0..0, |&(_, at, count)| at..at + count)
    }

    fn add_fixed(&self, tree: &Tree<'_>, mesh: &mut CellMesh) -> Result<()> {
        let Some(element) = element(self.kind) else {
            return Ok(());
        };
        if Some(self.connectivity.len()) != self.count.checked_mul(element.node_count) {
            let expected = format!("{} elements of {} nodes", self.count, element.node_count);
            let found = format!("{} numbers", self.connectivity.len());
            return Err(self.fault(tree, &expected, found));
        }
        for nodes in self.connectivity.chunks_exact(element.node_count) {
            self.add(tree, mesh, &element, nodes)?;
        }
        Ok(())
    }

    fn add(
        &self,
        tree: &Tree<'_>,
        mesh: &mut CellMesh,
        element: &super::elements::Element,
        nodes: &[i64],
    ) -> Result<()> {
        let taken = element.order.map_or(nodes.len(), <[u8]>::len);
        for i in 0..taken {
            let place = element.order.map_or(i, |order| usize::from(order[i]));
            let node = index(tree, self.node, mesh.nodes.len(), nodes[place])?;
            mesh.connectivity.push(node);
        }
        push_cell(tree.path, mesh, element.kind)
    }

    fn add_mixed(&self, tree: &Tree<'_>, mesh: &mut CellMesh, left_out: &mut usize) -> Result<()> {
        let mut rest = self.connectivity.as_slice();
        for i in 0..self.count {
            let start = self.connectivity.len() - rest.len();
            if let Some(offsets) = &self.offsets
                && offsets.get(i).and_then(|&n| usize::try_from(n).ok()) != Some(start)
            {
                let expected = format!("element {i} at place {start}, behind the one before");
                return Err(self.fault(
                    tree,
                    &expected,
                    offsets
                        .get(i)
                        .map_or_else(|| "none".into(), ToString::to_string),
                ));
            }
            let kind = rest.first().copied().unwrap_or(0);
            let Some(element) = element(kind) else {
                // Its length is known from the next one's place alone.
                let next = self.offsets.as_ref().and_then(|offsets| offsets.get(i + 1));
                let length = next.and_then(|&n| usize::try_from(n).ok());
                let length = length.and_then(|next| next.checked_sub(start));
                let behind = length.filter(|&n| n > 0).and_then(|n| rest.get(n..));
                rest = behind.ok_or_else(|| {
                    let expected = "elements of first or second order";
                    self.fault(tree, expected, format!("one of the type {kind}"))
                })?;
                *left_out += 1;
                continue;
            };
            let Some(nodes) = rest.get(1..=element.node_count) else {
                let expected = format!("{} elements", self.count);
                return Err(self.fault(tree, &expected, format!("the end within element {i}")));
            };
            self.add(tree, mesh, &element, nodes)?;
            rest = &rest[1 + element.node_count..];
        }
        Ok(())
    }

    /// Returns the numbers of each polygon or polyhedron.
    fn lists(&self, tree: &Tree<'_>) -> Result<Vec<&[i64]>> {
        let mut lists = Vec::with_capacity(self.count);
        if let Some(offsets) = &self.offsets {
            let place = |i: usize| offsets.get(i).and_then(|&n| usize::try_from(n).ok());
            for i in 0..self.count {
                let list = place(i).zip(place(i + 1));
                let list = list.and_then(|(a, b)| self.connectivity.get(a..b));
                lists.push(list.ok_or_else(|| {
                    let expected = "`ElementStartOffset`: places that rise to the last number";
                    self.fault(
                        tree,
                        expected,
                        offsets
                            .get(i)
                            .map_or_else(|| "none".into(), |at| format!("{at} of element {i}")),
                    )
                })?);
            }
            return Ok(lists);
        }
        let mut rest = self.connectivity.as_slice();
        for i in 0..self.count {
            let list = rest
                .split_first()
                .and_then(|(&count, behind)| behind.split_at_checked(usize::try_from(count).ok()?));
            let (list, behind) = list.ok_or_else(|| {
                let expected = format!("{} elements, each with its count", self.count);
                self.fault(tree, &expected, format!("the end within element {i}"))
            })?;
            lists.push(list);
            rest = behind;
        }
        Ok(lists)
    }

    fn add_polygons(
        &self,
        tree: &Tree<'_>,
        node_count: usize,
        polygons: &mut Polygons,
    ) -> Result<()> {
        let at = polygons.offsets.len() - 1;
        for list in self.lists(tree)? {
            if list.len() < 3 {
                return Err(self.fault(
                    tree,
                    "three nodes of a polygon or more",
                    list.len().to_string(),
                ));
            }
            for &number in list {
                polygons
                    .nodes
                    .push(index(tree, self.node, node_count, number)?);
            }
            polygons.offsets.push(polygons.nodes.len());
        }
        polygons.uses.resize(polygons.offsets.len() - 1, 0);
        polygons.sections.push((self.first, at, self.count));
        Ok(())
    }

    fn add_polyhedra(
        &self,
        tree: &Tree<'_>,
        polygons: &mut Polygons,
        mesh: &mut CellMesh,
    ) -> Result<()> {
        for list in self.lists(tree)? {
            let mut outward = Vec::with_capacity(list.len());
            for &number in list {
                let face = polygons.index(number.saturating_abs());
                // A face lies between two cells. If more could use one, a small file could fill the memory.
                let face = face.filter(|&face| polygons.uses[face] < 2);
                let face = face.ok_or_else(|| {
                    let expected = "the numbers of polygons, each at most twice";
                    self.fault(tree, expected, number.to_string())
                })?;
                polygons.uses[face] += 1;
                outward.push(polygons.outward(face, number > 0));
            }
            if outward.is_empty() {
                return Err(self.fault(tree, "faces of each polyhedron", "none".to_owned()));
            }
            face_cells::append(mesh, &outward).ok_or_else(|| too_many(tree))?;
        }
        Ok(())
    }
}

/// Appends the cells on both sides of polygons.
fn of_parents(
    tree: &Tree<'_>,
    sections: &[Section<'_>],
    polygons: &Polygons,
    mesh: &mut CellMesh,
) -> Result<()> {
    // Each side of a polygon: the number of its cell, the polygon, and whether it faces outwards.
    let mut sides: Vec<(i64, usize, bool)> = Vec::new();
    for section in sections.iter().filter(|section| section.kind == NGON) {
        let own = section.own(polygons);
        let parents = section.parents.as_deref().unwrap_or_default();
        if parents.len() != 2 * own.len() {
            let expected = format!("`ParentElements` of {} polygons, two of each", own.len());
            return Err(section.fault(tree, &expected, format!("{} numbers", parents.len())));
        }
        let (left, right) = parents.split_at(own.len());
        for ((polygon, &left), &right) in own.zip(left).zip(right) {
            sides.extend((left > 0).then_some((left, polygon, true)));
            sides.extend((right > 0).then_some((right, polygon, false)));
        }
    }
    sides.sort_unstable();
    for cell in sides.chunk_by(|a, b| a.0 == b.0) {
        let face = cell
            .iter()
            .map(|&(_, polygon, is_outward)| polygons.outward(polygon, is_outward));
        let outward: Vec<Vec<u32>> = face.collect();
        face_cells::append(mesh, &outward).ok_or_else(|| too_many(tree))?;
    }
    Ok(())
}

fn too_many(tree: &Tree<'_>) -> Error {
    too_many_entries(
        tree.path,
        "elements",
        "save the zones in files of their own",
    )
}
