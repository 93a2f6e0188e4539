//! Points of other ranks that are among the nearest neighbours of this rank's.

use bytemuck::Pod;
use glam::DVec3;
use rayon::prelude::*;

use super::ranks::Ranks;
use crate::blocks::Peers;
use crate::error::Result;
use crate::sample::{LEAF, Reach, reaches};

/// Boxes of points that are told of together.
const GROUP: usize = 512;

/// Who looks at which of this rank's points.
#[derive(Debug)]
pub(super) struct Surroundings {
    /// Of each rank those of this one's points that it asked for, ascending.
    wanted: Vec<Vec<u32>>,
}

impl Surroundings {
    /// Finds out.
    ///
    /// - `count`: of the nearest distinct places that each point looks at, on whichever rank they are.
    pub(super) fn of(positions: &[DVec3], count: usize, ranks: &mut Ranks) -> Result<Self> {
        let (rank, size) = (ranks.rank(), ranks.size());
        if size == 1 {
            let wanted = vec![Vec::new()];
            return Ok(Self { wanted });
        }
        let (points, leaves) = reaches(positions, count);
        let around = |group: &[Reach]| group.iter().fold(Reach::NONE, |all, leaf| all.and(leaf));
        let groups: Vec<Reach> = leaves.chunks(GROUP).map(around).collect();
        let ranks: &mut dyn Peers = ranks;
        let all = ranks.gather_records(Ok(&groups))?;
        // Those boxes whose neighbours may be where others have points.
        let mut asked = vec![Vec::new(); size];
        for (group, leaves) in groups.iter().zip(leaves.chunks(GROUP)) {
            let whole = group.whole();
            for (other, groups) in all.iter().enumerate().filter(|(n, _)| *n != rank) {
                let near: Vec<&Reach> = groups.iter().filter(|own| own.touches(&whole)).collect();
                let wholes = leaves.iter().map(Reach::whole);
                asked[other].extend(wholes.filter(|own| near.iter().any(|n| n.touches(own))));
            }
        }
        let asked = ranks.exchange_records(Ok(asked))?;
        let found = |asked: &Vec<Reach>| {
            let each = groups.par_iter().zip(leaves.par_chunks(GROUP));
            let each = each.zip(points.par_chunks(GROUP * LEAF));
            let of_group = each.map(|((group, leaves), points)| {
                let near: Vec<&Reach> = asked.iter().filter(|own| own.touches(group)).collect();
                let mut found = Vec::new();
                for (leaf, points) in leaves.iter().zip(points.chunks(LEAF)) {
                    let near = near.iter().filter(|own| own.touches(leaf));
                    let near: Vec<&&Reach> = near.collect();
                    let is_wanted = |i: &&u32| near.iter().any(|n| n.has(positions[**i as usize]));
                    found.extend(points.iter().filter(is_wanted));
                }
                found
            });
            let mut found: Vec<u32> = of_group.flatten().collect();
            found.par_sort_unstable();
            found
        };
        Ok(Self {
            wanted: asked.iter().map(found).collect(),
        })
    }

    /// What others have of the points that this rank looks at: always in the same order.
    ///
    /// - `own`: of each of this rank's points.
    pub(super) fn fetch<T: Pod>(&self, own: &[T], ranks: &mut Ranks) -> Result<Vec<T>> {
        let of_rank = |points: &Vec<u32>| points.iter().map(|&i| own[i as usize]).collect();
        let parts: Vec<Vec<T>> = self.wanted.iter().map(of_rank).collect();
        let ranks: &mut dyn Peers = ranks;
        Ok(ranks.exchange_records(Ok(parts))?.concat())
    }
}
