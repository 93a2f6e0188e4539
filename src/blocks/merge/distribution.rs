//! Finds how the values of clusters' members are distributed.

use std::ops::Range;

use rayon::prelude::*;

use super::sums::Cluster;
use crate::blocks::merge::places::Places;
use crate::blocks::source::Source;
use crate::blocks::tree::PartialTree;
use crate::parallel;

/// Number of particles that a task reads.
const TASK: usize = 8192;

impl Source<'_> {
    /// Returns the distribution of the values of each cluster's members, all of which must be here.
    pub(super) fn places_of(&self, clusters: &[Cluster]) -> Vec<Places> {
        let of_all = |cluster: &Cluster| {
            let Range { start, end } = cluster.run();
            let pieces = (start..end).into_par_iter().step_by(TASK);
            let none = || self.places(start..start, cluster);
            pieces
                .map(|piece| self.places(piece..end.min(piece + TASK), cluster))
                .reduce(none, |a, b| a.and(&b))
        };
        parallel::map(clusters.len(), |i| of_all(&clusters[i]))
    }

    /// Returns the distribution of the values of those members of each cluster that are here.
    pub(in crate::blocks) fn places_of_parts(
        &self,
        clusters: &[Cluster],
        trees: &[PartialTree<'_>],
    ) -> Vec<Places> {
        let of_parts = |cluster: &Cluster| {
            let run = cluster.run();
            let end = |tree: &PartialTree<'_>| tree.start + tree.tree.len();
            let first = trees.partition_point(|tree| end(tree) <= run.start);
            let parts = trees[first..]
                .iter()
                .take_while(|tree| tree.start < run.end);
            parts.fold(cluster.no_places(), |all, tree| {
                let (start, end) = (run.start.max(tree.start), run.end.min(end(tree)));
                let here = tree.at + start - tree.start..tree.at + end - tree.start;
                all.and(&self.places(here, cluster))
            })
        };
        parallel::map(clusters.len(), |i| of_parts(&clusters[i]))
    }

    /// Returns the distribution of the values of a cluster's members.
    ///
    /// - `members`: some or all of the cluster's members, in block order.
    pub(in crate::blocks) fn places(&self, members: Range<usize>, of: &Cluster) -> Places {
        let mut places = of.no_places();
        let Some(values) = self.values else {
            return places;
        };
        for i in members {
            if let Some(strength) = self.strength_left(i) {
                places.add(strength / of.sums.strength, f64::from(values.get(i)));
            }
        }
        places
    }
}
