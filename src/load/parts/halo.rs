//! Builds the halo of a rank's points: the points of other ranks among their nearest neighbours. The search is
//! exact.
//!
//! 1. Points are redistributed by position, so that a rank's points lie together ([`super::rows`]).
//! 2. Each rank groups its points in small boxes. For each box, it finds an upper bound on the distance from the box's
//!    points to their nearest neighbours among its own points ([`Reach`]). A box *touches* another if the distance
//!    between them is within the bound.
//! 3. Ranks exchange coarse boxes of their points. A rank sends a box, with its bound, to the ranks whose boxes it
//!    touches. They answer with the bound that their own points give, and the smaller bound counts.
//! 4. Boxes that still touch other ranks are divided into single points, each with its own bound. Ranks send
//!    these points to the ranks that they touch.
//! 5. A rank that receives points sends its own points within their bounds: the halo.

use bytemuck::Pod;
use glam::DVec3;
use rayon::prelude::*;

use crate::collective::Collective;
use crate::error::Result;
use crate::sample::{Boxes, Leaf, Near, Reach};
use crate::scene::{Values, of_same_type};

/// Points of this rank that other ranks need as neighbours.
#[derive(Debug)]
pub(super) struct Halo {
    /// Points of this rank that each rank asked for, ascending.
    wanted: Vec<Vec<u32>>,
}

impl Halo {
    /// Finds the points that each rank needs from the others.
    ///
    /// - `count`: number of nearest distinct positions that a point needs, on any rank.
    pub(super) fn of(
        positions: &[DVec3],
        count: &(dyn Fn(u32) -> usize + Sync),
        ranks: &mut dyn Collective,
    ) -> Result<Self> {
        let (rank, size) = (ranks.rank(), ranks.size());
        if size == 1 {
            let wanted = vec![Vec::new()];
            return Ok(Self { wanted });
        }
        let near = Near::of(positions, count);
        let mut leaves: Vec<Reach> = near.leaves.iter().map(|leaf| leaf.reach).collect();
        // Boxes around the points of every rank.
        let boxes = ranks.gather_records(Ok(near.boxes()))?.into_iter();
        let boxes: Vec<Boxes> = boxes.map(Boxes::of).collect();
        let is_among = |own: &Reach, other: usize| {
            other != rank && boxes[other].any(&|theirs| own.touches(theirs))
        };
        // For each rank, the reaches that may extend to its points.
        let asked = |own: &[Reach]| -> Vec<Vec<u32>> {
            let of_rank = |other| {
                let is_asked = |&n: &u32| is_among(&own[n as usize], other);
                (0..own.len() as u32)
                    .into_par_iter()
                    .filter(is_asked)
                    .collect()
            };
            (0..size).map(of_rank).collect()
        };
        // A rank with few points near another's many reaches too far: the others send bounds on the distance to as many
        // of their points.
        let first = asked(&leaves);
        let theirs = ranks.exchange_records(Ok(entries(&leaves, &first)))?;
        let bound = |theirs: &Vec<Reach>| theirs.par_iter().map(|own| near.bound(own)).collect();
        let bounds = theirs.iter().map(bound).collect();
        let bounds = ranks.exchange_records::<f64>(Ok(bounds))?;
        for (&n, bound) in first.iter().flatten().zip(bounds.iter().flatten()) {
            let own = &mut leaves[n as usize].distance;
            *own = own.min(*bound);
        }
        // The points of the leaves that still reach other ranks, one by one.
        let of_leaf = |(own, leaf): (&Reach, &Leaf)| {
            let is_asked = (0..size).any(|other| is_among(own, other));
            let alone = |&point: &u32| near.alone(point, count(point), own.distance);
            let points = leaf.points.iter().filter(|_| is_asked);
            points.map(alone).collect::<Vec<Reach>>()
        };
        let points = leaves.par_iter().zip(&near.leaves);
        let points: Vec<Reach> = points.flat_map_iter(of_leaf).collect();
        let theirs = ranks.exchange_records(Ok(entries(&points, &asked(&points))))?;
        let found = |theirs: Vec<Reach>| {
            if theirs.is_empty() {
                return Vec::new();
            }
            let theirs = Boxes::of(theirs);
            let of_leaf = |n: usize| {
                let leaf = &near.leaves[n];
                let is_near = theirs.any(&|their| their.touches(&leaf.reach));
                let is_wanted = |i: &&u32| theirs.any(&|their| their.has(positions[**i as usize]));
                let points = leaf.points.iter().filter(move |_| is_near);
                points.filter(is_wanted).copied().collect::<Vec<u32>>()
            };
            let leaves = (0..near.leaves.len()).into_par_iter();
            let mut found: Vec<u32> = leaves.flat_map_iter(of_leaf).collect();
            found.par_sort_unstable();
            found
        };
        Ok(Self {
            wanted: theirs.into_iter().map(found).collect(),
        })
    }

    /// Fetches the other ranks' entries for the halo, always in the same order.
    ///
    /// - `own`: one entry for each of this rank's points.
    pub(super) fn fetch<T: Pod>(&self, own: &[T], ranks: &mut dyn Collective) -> Result<Vec<T>> {
        send(own, &self.wanted, ranks)
    }

    /// Fetches the other ranks' values for the halo.
    pub(super) fn fetch_values(&self, own: &Values, ranks: &mut dyn Collective) -> Result<Values> {
        send_values(own, &self.wanted, ranks)
    }
}

/// Sends some entries of a column to each rank; returns the entries that the other ranks sent.
pub(super) fn send<T: Pod>(
    own: &[T],
    to: &[Vec<u32>],
    ranks: &mut dyn Collective,
) -> Result<Vec<T>> {
    Ok(ranks.exchange_records(Ok(entries(own, to)))?.concat())
}

/// Sends some values to each rank; returns those received. Floating-point values are in double precision if any rank's
/// are.
pub(super) fn send_values(
    own: &Values,
    to: &[Vec<u32>],
    ranks: &mut dyn Collective,
) -> Result<Values> {
    if matches!(own, Values::F32(_) | Values::F64(_)) && ranks.any(matches!(own, Values::F64(_)))? {
        let wide: Vec<f64> = (0..own.len()).map(|i| own.wide(i)).collect();
        return Ok(send(&wide, to, ranks)?.into());
    }
    Ok(of_same_type!(own, own => send(own, to, ranks)?))
}

/// Returns the entries that go to each rank.
fn entries<T: Copy>(own: &[T], to: &[Vec<u32>]) -> Vec<Vec<T>> {
    let of_rank = |some: &Vec<u32>| some.iter().map(|&i| own[i as usize]).collect();
    to.iter().map(of_rank).collect()
}
