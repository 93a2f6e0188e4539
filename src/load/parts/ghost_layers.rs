//! Builds ghost layers: the cells of other ranks around a rank's cells of an unstructured mesh.
//!
//! Nodes at the same position are the same node, whichever rank holds them. A rank asks the others for their cells at
//! its own nodes, then for their cells at the nodes of these, and so on, layer after layer. Within that many layers of
//! its own cells, the rank then has the cells, nodes and values of the whole mesh, in the same order.

use std::collections::HashSet;
use std::ops::Range;

use glam::DVec3;

use super::cell_subset::CellSubset;
use crate::collective::Collective;
use crate::error::Result;
use crate::message::{put, take, unknown};
use crate::sample::{CellsAround, compare, is_same, sort_by_position};

/// A rank's cells and the ghost cells around them, in the order of the whole mesh.
pub(super) struct GhostLayers {
    pub(super) subset: CellSubset,
    /// The rank's own nodes and cells in the subset.
    pub(super) nodes: Range<usize>,
    pub(super) cells: Range<usize>,
}

/// Ghost cells: cells that other ranks sent.
struct Others {
    /// Numbers of their nodes and cells in the whole mesh; some occur more than once.
    nodes: Vec<u64>,
    cells: Vec<u64>,
    subset: CellSubset,
}

/// Cells that a rank has sent to another.
#[derive(Debug, Clone, Default)]
struct Sent {
    cells: HashSet<u32>,
    /// Nodes without a position, for which the other rank cannot ask.
    nowhere: HashSet<u32>,
}

/// A rank's own nodes, sorted by position.
struct Places<'a> {
    nodes: &'a [DVec3],
    order: Vec<u32>,
}

impl<'a> Places<'a> {
    fn of(nodes: &'a [DVec3]) -> Self {
        let finite = (0..).zip(nodes).filter(|(_, p)| p.is_finite());
        let mut order: Vec<u32> = finite.map(|(i, _)| i).collect();
        sort_by_position(nodes, &mut order);
        Self { nodes, order }
    }

    fn at(&self, place: DVec3) -> &[u32] {
        let is_before = |&i: &u32| compare(self.nodes[i as usize], place).is_lt();
        let rest = &self.order[self.order.partition_point(is_before)..];
        let is_there = |&i: &u32| is_same(self.nodes[i as usize], place);
        &rest[..rest.partition_point(is_there)]
    }
}

impl GhostLayers {
    /// Finds the ghost layers around a rank's cells.
    ///
    /// - `own`: this rank's cells, numbered after those of the ranks before.
    /// - `count`: number of layers.
    ///
    /// # Errors
    /// More nodes or cell entries than 32 bits count; a rank that is gone.
    pub(super) fn around(
        own: CellSubset,
        count: usize,
        ranks: &mut dyn Collective,
    ) -> Result<Self> {
        let (rank, size) = (ranks.rank(), ranks.size());
        let first = [
            ranks.sum_before(Ok(own.mesh.nodes.len() as u64))?,
            ranks.sum_before(Ok(own.mesh.cell_count() as u64))?,
        ];
        let places = Places::of(&own.mesh.nodes);
        let around = CellsAround::new(&own.mesh, &[]);
        let finite = || own.mesh.nodes.iter().filter(|p| p.is_finite());
        let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let bounds = finite().fold(none, |[a, b], p| [a.min(*p), b.max(*p)]);
        let boxes = ranks.gather_records(Ok(bounds.to_vec()))?;
        let is_within = |p: DVec3, other: usize| match boxes[other][..] {
            [low, high] => other != rank && p.cmpge(low).all() && p.cmple(high).all(),
            _ => false,
        };
        let mut others = Others {
            nodes: Vec::new(),
            cells: Vec::new(),
            subset: CellSubset::none_of(&own),
        };
        let mut asked = HashSet::new();
        let mut sent = vec![Sent::default(); size];
        let mut frontier: Vec<DVec3> = finite().copied().collect();
        for _ in 0..count {
            frontier.retain(|&p| (0..size).any(|other| is_within(p, other)));
            // Adding 0 makes -0 and 0 the same.
            frontier.retain(|p| asked.insert((p + DVec3::ZERO).to_array().map(f64::to_bits)));
            let of_rank = |other| {
                let there = frontier.iter().filter(|p| is_within(**p, other));
                there.copied().collect::<Vec<DVec3>>()
            };
            let asks = (0..size).map(of_rank).collect();
            let theirs = ranks.exchange_records(Ok(asks))?;
            let answer = |(asked, sent): (&Vec<DVec3>, &mut Sent)| {
                let found = asked.iter().flat_map(|&p| places.at(p));
                let found = found.chain(&sent.nowhere);
                let cells = found.flat_map(|&node| around.of(node)).copied();
                let mut cells: Vec<u32> = cells.filter(|&cell| sent.cells.insert(cell)).collect();
                cells.sort_unstable();
                let (subset, nodes) = own.of_cells(&cells);
                let is_nowhere = |&node: &u32| !own.mesh.nodes[node as usize].is_finite();
                sent.nowhere
                    .extend(nodes.iter().copied().filter(is_nowhere));
                let numbers = |of: &[u32], first: u64| -> Vec<u64> {
                    of.iter().map(|&i| first + u64::from(i)).collect()
                };
                let mut bytes = Vec::new();
                put(&mut bytes, &numbers(&nodes, first[0]));
                put(&mut bytes, &numbers(&cells, first[1]));
                if !cells.is_empty() {
                    subset.put(&mut bytes);
                }
                bytes
            };
            let answers = theirs.iter().zip(&mut sent).map(answer).collect();
            let answers = ranks.exchange(Ok(answers))?;
            frontier.clear();
            let mut answers = answers.iter();
            let added = answers.try_for_each(|part| others.add(part, &own, &mut frontier));
            ranks.agree(added)?;
        }
        drop((places, around, sent, asked));
        Self::joined(own, first, others)
    }

    fn joined(mut own: CellSubset, first: [u64; 2], others: Others) -> Result<Self> {
        let [of_nodes, of_cells] = [&others.nodes, &others.cells].map(|numbers| {
            let mut order: Vec<u32> = (0..numbers.len() as u32).collect();
            order.sort_unstable_by_key(|&i| numbers[i as usize]);
            order.dedup_by_key(|i| numbers[*i as usize]);
            order
        });
        let below = of_nodes.partition_point(|&i| others.nodes[i as usize] < first[0]);
        let cells_below = of_cells.partition_point(|&i| others.cells[i as usize] < first[1]);
        let (node_count, cell_count) = (own.mesh.nodes.len(), own.mesh.cell_count());
        // Place of each of the others' nodes among all nodes.
        let mut place_of = vec![0; others.nodes.len()];
        let number = |i: u32| others.nodes[i as usize];
        for (i, place) in place_of.iter_mut().enumerate() {
            let among = of_nodes.partition_point(|&other| number(other) < others.nodes[i]);
            *place = (if among < below {
                among
            } else {
                among + node_count
            }) as u32;
        }
        let entries = |subset: &CellSubset| subset.mesh.connectivity.len();
        check_fits(of_nodes.len() + node_count)?;
        check_fits(entries(&own) + entries(&others.subset))?;
        let of_place = |i: u32| place_of[i as usize];
        let some = |nodes, cells| others.subset.some(nodes, cells, of_place);
        let mut subset = some(&of_nodes[..below], &of_cells[..cells_below]);
        let after = some(&of_nodes[below..], &of_cells[cells_below..]);
        drop(others.subset);
        if below == 0 {
            std::mem::swap(&mut subset, &mut own);
        } else {
            subset.append(own, below as u32);
        }
        subset.append(after, 0);
        Ok(Self {
            subset,
            nodes: below..below + node_count,
            cells: cells_below..cells_below + cell_count,
        })
    }
}

fn check_fits(count: usize) -> Result<()> {
    match u32::try_from(count) {
        Ok(_) => Ok(()),
        Err(_) => Err(unknown("more cells than 32 bits count: start more ranks")),
    }
}

impl Others {
    /// Adds the cells that a rank sent in answer to a request.
    ///
    /// - `frontier`: receives the positions of their nodes.
    fn add(&mut self, mut part: &[u8], own: &CellSubset, frontier: &mut Vec<DVec3>) -> Result<()> {
        let (nodes, cells) = (take::<u64>(&mut part)?, take::<u64>(&mut part)?);
        if cells.is_empty() {
            return Ok(());
        }
        let subset = CellSubset::take(&mut part, own)?;
        if subset.mesh.nodes.len() != nodes.len() || subset.mesh.cell_count() != cells.len() {
            return Err(unknown("another number of cells than of their places"));
        }
        let entries = self.subset.mesh.connectivity.len() + subset.mesh.connectivity.len();
        let shift = self.subset.mesh.nodes.len();
        check_fits(entries.max(shift + nodes.len()))?;
        frontier.extend(subset.mesh.nodes.iter().filter(|p| p.is_finite()));
        self.nodes.extend(nodes);
        self.cells.extend(cells);
        self.subset.append(subset, shift as u32);
        Ok(())
    }
}
