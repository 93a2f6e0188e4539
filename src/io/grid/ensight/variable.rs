//! Reads variables. For each part that has one, the file stores a number per node, or per element, type by type.
//!
//! ```text
//! a line of text
//! part  its number
//! coordinates|block|hexa8 ... [undef|partial]   all first components, all second ones ...
//! ```
//!
//! `undef` is followed by a number that means "no value". `partial` is followed by a count and the indices, from 1, of
//! the elements with values. Elements without a value get NaN.

use super::geometry::{Part, Shape};
use super::stream::Stream;
use crate::data::association::Association;
use crate::error::Result;
use crate::scene::Values;

/// Positions of the numbers of all parts in the fields.
pub(super) struct Layout<'a> {
    parts: Vec<Places<'a>>,
    node_count: usize,
    cell_count: usize,
}

/// Positions of the numbers of one part.
struct Places<'a> {
    number: i32,
    first_node: usize,
    node_count: usize,
    /// Element types, their numbers of elements, and their first cells; `None` for types that are left out.
    cells: Vec<(&'a str, usize, Option<usize>)>,
}

impl<'a> Layout<'a> {
    pub(super) fn of(parts: &'a [Part]) -> Self {
        let mut layout = Self {
            parts: Vec::new(),
            node_count: 0,
            cell_count: 0,
        };
        for part in parts {
            let mut cells = Vec::new();
            let mut add = |name: &'a str, count: usize, is_read: bool| {
                cells.push((name, count, is_read.then_some(layout.cell_count)));
                layout.cell_count += if is_read { count } else { 0 };
            };
            match &part.shape {
                Shape::Elements { blocks, .. } => {
                    for block in blocks {
                        add(&block.name, block.count, block.cells.is_some());
                    }
                }
                Shape::Block(block) => add("block", block.cell_dims().iter().product(), true),
            }
            let node_count = part.node_count();
            layout.parts.push(Places {
                number: part.number,
                first_node: layout.node_count,
                node_count,
                cells,
            });
            layout.node_count = layout.node_count.saturating_add(node_count);
        }
        layout
    }

    /// Returns the greater of the counts of nodes and of cells.
    pub(super) fn most(&self) -> usize {
        self.node_count.max(self.cell_count)
    }

    /// Reads a variable, one array for each component.
    ///
    /// # Errors
    /// The geometry lacks a part or an element type, or the file ends before the numbers.
    pub(super) fn read(
        &self,
        stream: &mut Stream<'_>,
        association: Association,
        components: usize,
    ) -> Result<Vec<Values>> {
        let count = match association {
            Association::Nodes => self.node_count,
            Association::Cells => self.cell_count,
        };
        let mut all = vec![vec![f32::NAN; count]; components];
        stream.line()?;
        let mut part: Option<(&Places<'_>, usize)> = None;
        while let Some(keyword) = stream.keyword() {
            let mut words = keyword.split_ascii_whitespace();
            let name = words.next().unwrap_or_default();
            if name == "part" {
                let number = stream.integer()?;
                let found = self.parts.iter().find(|part| part.number == number);
                let found = found.ok_or_else(|| {
                    stream.fault("a part of the geometry", format!("part {number}"))
                })?;
                part = Some((found, 0));
                continue;
            }
            let sort = words.next().unwrap_or_default();
            let found = part.as_mut().and_then(|(part, passed)| match association {
                Association::Nodes if matches!(name, "coordinates" | "block") => {
                    Some((part.node_count, Some(part.first_node)))
                }
                Association::Nodes => None,
                Association::Cells => {
                    let behind = part.cells.iter().enumerate().skip(*passed);
                    let mut same = behind.filter(|(_, (other, ..))| *other == name);
                    let (i, (_, count, first)) = same.next()?;
                    *passed = i + 1;
                    Some((*count, *first))
                }
            });
            let Some((count, first)) = found else {
                let shown: String = keyword.chars().take(40).collect();
                return Err(stream.fault("`part`, or what the geometry has", format!("`{shown}`")));
            };
            read_section(stream, sort, count, first, &mut all)?;
        }
        Ok(all.into_iter().map(Values::F32).collect())
    }
}

/// Reads the numbers of one section into the arrays.
fn read_section(
    stream: &mut Stream<'_>,
    sort: &str,
    count: usize,
    first: Option<usize>,
    all: &mut [Vec<f32>],
) -> Result<()> {
    let undefined = match sort {
        "undef" => stream.reals(1)?.first().copied(),
        _ => None,
    };
    let places = match sort {
        "partial" => {
            let count = stream.count()?;
            Some(stream.integers(count)?)
        }
        _ => None,
    };
    let stored = places.as_ref().map_or(count, Vec::len);
    for component in all {
        let numbers = stream.reals(stored)?;
        let Some(first) = first else { continue };
        let component = &mut component[first..first + count];
        for (i, &number) in numbers.iter().enumerate() {
            let at = match &places {
                Some(places) => usize::try_from(places[i])
                    .ok()
                    .and_then(|n| n.checked_sub(1)),
                None => Some(i),
            };
            let is_defined = undefined != Some(number);
            if let Some(value) = at
                .and_then(|at| component.get_mut(at))
                .filter(|_| is_defined)
            {
                *value = number;
            }
        }
    }
    Ok(())
}
