//! Defines the particles from which levels of detail are made.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::Places;
use super::fine::PartialTree;
use super::moments::Symmetric;
use super::sums::Cluster;
use crate::math::{lower_matrix, symmetric};
use crate::parallel;
use crate::scene::{
    BoundaryPlanesIn, ColourIn, LocalModelsIn, Shared, StrengthIn, ValuesIn, cut_kernel,
};

/// Particles to merge, in block order.
#[derive(Debug, Clone, Copy)]
pub(in crate::blocks) struct Source<'a> {
    pub(in crate::blocks) positions: &'a [DVec3],
    pub(in crate::blocks) shapes: Shapes<'a>,
    /// Least and greatest standard deviation of each particle, unless all are spheres.
    pub(in crate::blocks) principal: &'a [[f32; 2]],
    pub(in crate::blocks) strength: &'a StrengthIn<Shared>,
    pub(in crate::blocks) colour: &'a ColourIn<Shared>,
    pub(in crate::blocks) values: Option<&'a ValuesIn<Shared>>,
    pub(in crate::blocks) models: Option<&'a LocalModelsIn<Shared>>,
    pub(in crate::blocks) boundary: Option<&'a BoundaryPlanesIn<Shared>>,
}

/// Shapes of particles.
#[derive(Debug, Clone, Copy)]
pub(in crate::blocks) enum Shapes<'a> {
    Spheres(&'a [f32]),
    Factors(&'a [[f32; 6]]),
}

/// Number of particles that a task reads.
const TASK: usize = 8192;

/// A particle to merge, cut by the domain.
#[derive(Debug, Clone)]
pub(super) struct Member {
    pub(super) index: usize,
    pub(super) strength: f64,
    /// Mean relative to the block's origin.
    pub(super) offset: DVec3,
    pub(super) variance: Symmetric,
    /// Vectors whose third powers sum to the third central moments; empty if nothing is cut.
    pub(super) skews: Vec<DVec3>,
}

impl Source<'_> {
    /// Least and greatest standard deviation of a particle.
    #[inline]
    pub(in crate::blocks) fn sigmas(&self, i: usize) -> [f32; 2] {
        match self.shapes {
            Shapes::Spheres(sigmas) => [sigmas[i]; 2],
            Shapes::Factors(_) => self.principal[i],
        }
    }

    /// Returns the strength of an uncut particle; `None` if it draws nothing or has no value.
    fn whole_strength(&self, i: usize) -> Option<f64> {
        let strength = self.strength.stored()[i];
        let has_value = self.values.is_none_or(|v| !v.get(i).is_nan());
        (strength > 0.0 && strength.is_finite() && has_value).then_some(f64::from(strength))
    }

    /// Returns the strength of a particle that the domain leaves.
    fn strength_left(&self, i: usize) -> Option<f64> {
        match self.boundary.and_then(|b| b.of(i)) {
            None => self.whole_strength(i),
            Some(_) => self.member(i, self.positions[i]).map(|m| m.strength),
        }
    }

    /// Returns a particle cut by the domain; `None` if it draws nothing (no strength, no value, or outside the domain).
    pub(super) fn member(&self, i: usize, origin: DVec3) -> Option<Member> {
        let strength = self.whole_strength(i)?;
        let lower @ [l00, l10, l11, l20, l21, l22] = match self.shapes {
            Shapes::Spheres(sigmas) => {
                let l = f64::from(sigmas[i]);
                [l, 0.0, l, 0.0, 0.0, l]
            }
            Shapes::Factors(factors) => factors[i].map(f64::from),
        };
        let whole = Member {
            index: i,
            strength,
            offset: self.positions[i] - origin,
            variance: [
                l00 * l00,
                l00 * l10,
                l00 * l20,
                l10 * l10 + l11 * l11,
                l10 * l20 + l11 * l21,
                l20 * l20 + l21 * l21 + l22 * l22,
            ],
            skews: Vec::new(),
        };
        let Some(planes) = self.boundary.and_then(|b| b.of(i)) else {
            return Some(whole);
        };
        let left = cut_kernel(lower_matrix(lower), planes)?;
        Some(Member {
            index: i,
            strength: whole.strength * left.share,
            offset: whole.offset + left.shift,
            variance: symmetric(left.factor * left.factor.transpose()),
            skews: left.skews,
        })
    }

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
