//! Points of other ranks that are among the nearest neighbours of this rank's.

use bytemuck::Pod;
use glam::DVec3;
use rayon::prelude::*;

use super::ranks::Ranks;
use crate::blocks::Peers;
use crate::error::Result;
use crate::sample::{Boxes, Leaf, Near, Reach};
use crate::scene::Values;

/// Who looks at which of this rank's points.
#[derive(Debug)]
pub(super) struct PointsAround {
    /// Of each rank those of this one's points that it asked for, ascending.
    wanted: Vec<Vec<u32>>,
}

impl PointsAround {
    /// Finds out.
    ///
    /// - `count`: of the nearest distinct places that a point looks at, on whichever rank they are.
    pub(super) fn of(
        positions: &[DVec3],
        count: &(dyn Fn(u32) -> usize + Sync),
        ranks: &mut Ranks,
    ) -> Result<Self> {
        let (rank, size) = (ranks.rank(), ranks.size());
        if size == 1 {
            let wanted = vec![Vec::new()];
            return Ok(Self { wanted });
        }
        let near = Near::of(positions, count);
        let mut leaves: Vec<Reach> = near.leaves.iter().map(|leaf| leaf.reach).collect();
        let ranks: &mut dyn Peers = ranks;
        // Where everybody's points are.
        let boxes = ranks.gather_records(Ok(&near.boxes()))?.into_iter();
        let boxes: Vec<Boxes> = boxes.map(Boxes::of).collect();
        let is_among = |own: &Reach, other: usize| {
            other != rank && boxes[other].any(&|theirs| own.touches(theirs))
        };
        // Of each rank those whose neighbours may be where it has points.
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
        // Where this rank has few points others may have many: they tell how near as many of theirs are.
        let first = asked(&leaves);
        let theirs = ranks.exchange_records(Ok(entries(&leaves, &first)))?;
        let bound = |theirs: &Vec<Reach>| theirs.par_iter().map(|own| near.bound(own)).collect();
        let bounds = theirs.iter().map(bound).collect();
        let bounds = ranks.exchange_records::<f64>(Ok(bounds))?;
        for (&n, bound) in first.iter().flatten().zip(bounds.iter().flatten()) {
            let own = &mut leaves[n as usize].distance;
            *own = own.min(*bound);
        }
        // The points of those that are left, one by one.
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

    /// What others have of the points that this rank looks at: always in the same order.
    ///
    /// - `own`: of each of this rank's points.
    pub(super) fn fetch<T: Pod>(&self, own: &[T], ranks: &mut Ranks) -> Result<Vec<T>> {
        sent(own, &self.wanted, ranks)
    }

    /// The same of values.
    pub(super) fn fetch_values(&self, own: &Values, ranks: &mut Ranks) -> Result<Values> {
        sent_values(own, &self.wanted, ranks)
    }
}

/// What others send of a column, some of whose entries go to each rank.
pub(super) fn sent<T: Pod>(own: &[T], to: &[Vec<u32>], ranks: &mut Ranks) -> Result<Vec<T>> {
    let ranks: &mut dyn Peers = ranks;
    Ok(ranks.exchange_records(Ok(entries(own, to)))?.concat())
}

/// The same of values; floating-point ones are in double precision where any rank has some in that.
pub(super) fn sent_values(own: &Values, to: &[Vec<u32>], ranks: &mut Ranks) -> Result<Values> {
    if matches!(own, Values::F32(_) | Values::F64(_)) {
        let is_wide = u64::from(matches!(own, Values::F64(_)));
        if ranks.sums(Ok(vec![is_wide]))? != [0] {
            let wide: Vec<f64> = (0..own.len()).map(|i| own.wide(i)).collect();
            return Ok(sent(&wide, to, ranks)?.into());
        }
    }
    Ok(match own {
        Values::U8(own) => Values::U8(sent(own, to, ranks)?),
        Values::I16(own) => Values::I16(sent(own, to, ranks)?),
        Values::U16(own) => Values::U16(sent(own, to, ranks)?),
        Values::F32(own) => Values::F32(sent(own, to, ranks)?),
        Values::F64(own) => Values::F64(sent(own, to, ranks)?),
    })
}

/// Of each rank some entries.
fn entries<T: Copy>(own: &[T], to: &[Vec<u32>]) -> Vec<Vec<T>> {
    let of_rank = |some: &Vec<u32>| some.iter().map(|&i| own[i as usize]).collect();
    to.iter().map(of_rank).collect()
}
