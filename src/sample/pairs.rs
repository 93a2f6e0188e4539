//! Merges neighbours in pairs, the cheapest first: Ward's method on a graph of neighbours, in rounds.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::parallel;
use crate::sample::points::neighbours::{FINDING, Neighbours, PointIndex};
use crate::sample::positions::index_u32;
use crate::task::Task;

/// Number of cells in one place that may merge with others: the two sides of a sheet, twice.
const COINCIDING: usize = 4;

/// Two cells that may merge.
#[derive(Debug, Clone, Copy)]
struct Edge {
    pair: [u32; 2],
    /// NaN if it is not known.
    cost: f64,
}

/// Cells that may merge, each pair once and in ascending order.
#[derive(Debug)]
pub(super) struct Pairs {
    edges: Vec<Edge>,
    /// Number of cells before any merged.
    cells: usize,
}

impl Pairs {
    /// Returns pairs of neighbouring points; `None` if all lie in one place.
    ///
    /// - `neighbours`: number of nearest positions with which a point may merge.
    pub(super) fn of_nearest(
        centres: &[DVec3],
        neighbours: usize,
        task: Option<&Task>,
    ) -> Result<Option<Self>> {
        let Some(index) = PointIndex::new(centres) else {
            return Ok(None);
        };
        let edge = |i: u32, k: u32| Edge {
            pair: [i.min(k), i.max(k)],
            cost: f64::NAN,
        };
        let first = |g: usize| index.group(g).iter().take(COINCIDING);
        let of_group = |search: &mut Neighbours<'_>, g: usize| {
            let mut found = Vec::new();
            for (other, _) in search.of(g, neighbours) {
                for &i in first(g) {
                    found.extend(first(other).filter(|&&k| k != i).map(|&k| edge(i, k)));
                }
            }
            found
        };
        let mut pairs = Self {
            edges: index.of_groups(task, FINDING, of_group)?.concat(),
            cells: centres.len(),
        };
        pairs.unite_equal();
        Ok(Some(pairs))
    }

    /// Leaves one edge of each pair.
    fn unite_equal(&mut self) {
        self.edges.par_sort_unstable_by_key(|edge| edge.pair);
        self.edges.dedup_by_key(|edge| edge.pair);
    }

    /// Returns the pairs.
    pub(super) fn all(&self) -> impl Iterator<Item = [u32; 2]> + Clone {
        self.edges.iter().map(|edge| edge.pair)
    }

    /// Finds the costs of pairs that have none yet, or whose cells have merged since. Pairs of infinite cost never merge.
    pub(super) fn price(&mut self, cost: impl Fn([u32; 2]) -> f64 + Sync) {
        let edges = &self.edges;
        let costs = parallel::map(edges.len(), |i| match edges[i].cost {
            unknown if unknown.is_nan() => cost(edges[i].pair),
            known => known,
        });
        for (edge, cost) in self.edges.iter_mut().zip(costs) {
            edge.cost = cost;
        }
    }

    /// Returns the cheapest pairs, at most `most` of them; no cell is in two of them.
    pub(super) fn cheapest(&self, most: usize) -> Vec<[u32; 2]> {
        let mut order: Vec<u32> = (0..self.edges.len()).map(index_u32).collect();
        order.par_sort_unstable_by(|&a, &b| {
            let (a, b) = (&self.edges[a as usize], &self.edges[b as usize]);
            a.cost.total_cmp(&b.cost).then_with(|| a.pair.cmp(&b.pair))
        });
        let mut is_taken = vec![false; self.cells];
        let mut pairs = Vec::new();
        for edge in order.into_iter().map(|i| self.edges[i as usize]) {
            if pairs.len() == most || edge.cost == f64::INFINITY {
                break;
            }
            let places = edge.pair.map(|c| c as usize);
            if !places.iter().any(|&c| is_taken[c]) {
                places.iter().for_each(|&c| is_taken[c] = true);
                pairs.push(edge.pair);
            }
        }
        pairs
    }

    /// Replaces both cells of each pair by the first.
    pub(super) fn merge(&mut self, pairs: &[[u32; 2]]) {
        let mut parent: Vec<u32> = (0..self.cells).map(index_u32).collect();
        let mut is_merged = vec![false; self.cells];
        for &[own, other] in pairs {
            parent[other as usize] = own;
            is_merged[own as usize] = true;
            is_merged[other as usize] = true;
        }
        for edge in &mut self.edges {
            if edge.pair.iter().any(|&c| is_merged[c as usize]) {
                let [a, b] = edge.pair.map(|c| parent[c as usize]);
                edge.pair = [a.min(b), a.max(b)];
                edge.cost = f64::NAN;
            }
        }
        self.edges.retain(|edge| edge.pair[0] != edge.pair[1]);
        self.unite_equal();
    }
}
