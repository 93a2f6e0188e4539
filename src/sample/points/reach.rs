//! Bounds the distance from points to their nearest neighbours if the points are partitioned over ranks.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

use super::neighbours::PointIndex;
use crate::sample::positions::index_u32;

/// Number of points in a leaf: neighbours are searched for one of them, and bound those of the others.
const LEAF: usize = 8;

/// Greatest number of points in a box that is sent to other ranks.
const MOST: usize = 256;

/// Greatest diagonal of such a box, over the distance to the neighbours. A box of [`MOST`] evenly spread points
/// is six times as long as the distance to the 24 nearest.
const LONGEST: f64 = 10.0;

/// A box of points, and an upper bound on the distance from any of them to its nearest neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Reach {
    low: [f64; 3],
    high: [f64; 3],
    /// The bound: infinite if there are fewer neighbours than needed, negative if none are needed.
    pub(crate) distance: f64,
    /// Number of neighbours needed.
    count: u64,
}

impl Reach {
    /// The box of one point, which needs no neighbours.
    fn at(p: DVec3) -> Self {
        Self {
            low: p.to_array(),
            high: p.to_array(),
            distance: -1.0,
            count: 0,
        }
    }

    /// Returns a box around both boxes, with the greater distance.
    fn and(&self, other: &Self) -> Self {
        Self {
            low: DVec3::from(self.low).min(other.low.into()).to_array(),
            high: DVec3::from(self.high).max(other.high.into()).to_array(),
            distance: self.distance.max(other.distance),
            count: self.count.max(other.count),
        }
    }

    /// Returns a box around all boxes; `None` if there are none.
    fn around_all<'a>(boxes: impl Iterator<Item = &'a Self>) -> Option<Self> {
        boxes.copied().reduce(|all, own| all.and(&own))
    }

    fn diagonal(&self) -> f64 {
        (DVec3::from(self.high) - DVec3::from(self.low)).length()
    }

    /// Returns true if the other box may hold a neighbour.
    pub(crate) fn touches(&self, other: &Self) -> bool {
        let after = DVec3::from(other.low) - DVec3::from(self.high);
        let before = DVec3::from(self.low) - DVec3::from(other.high);
        after.max(before).max(DVec3::ZERO).length() <= self.distance
    }

    /// Returns true if a point may be a neighbour.
    pub(crate) fn has(&self, p: DVec3) -> bool {
        let (low, high) = (DVec3::from(self.low), DVec3::from(self.high));
        (p - high).max(low - p).max(DVec3::ZERO).length() <= self.distance
    }
}

/// Some points and their box.
#[derive(Debug)]
pub(crate) struct Leaf {
    pub(crate) reach: Reach,
    pub(crate) points: Vec<u32>,
}

/// The local points, with bounds from the local neighbours.
pub(crate) struct Near<'a> {
    positions: &'a [DVec3],
    index: Option<PointIndex<'a>>,
    /// The points with a finite position in groups of nearby ones, in a spatially coherent order.
    pub(crate) leaves: Vec<Leaf>,
}

impl<'a> Near<'a> {
    /// - `count`: returns the number of distinct neighbours that a point needs; may be 0.
    pub(crate) fn of(positions: &'a [DVec3], count: &(dyn Fn(u32) -> usize + Sync)) -> Self {
        let index = PointIndex::new(positions);
        let points: Vec<u32> = match &index {
            Some(index) => (0..index.len()).map(|n| index.in_order(n).0).collect(),
            None => {
                let points = (0..positions.len()).filter(|&i| positions[i].is_finite());
                points.map(index_u32).collect()
            }
        };
        let near = Self {
            positions,
            index,
            leaves: Vec::new(),
        };
        let leaf = |points: &[u32]| {
            let places = points.iter().map(|&i| Reach::at(positions[i as usize]));
            let count = points.iter().map(|&i| count(i)).max().unwrap_or(0);
            let from = positions[points[points.len() / 2] as usize];
            let within = places.fold(Reach::at(from), |all, own| all.and(&own));
            Leaf {
                reach: near.reach(within, from, count, f64::INFINITY),
                points: points.to_vec(),
            }
        };
        let leaves = points.par_chunks(LEAF).map(leaf).collect();
        Self { leaves, ..near }
    }

    /// Returns boxes around all points, with up to [`MOST`] points each. Consecutive points on a space-filling
    /// curve are sometimes far apart: no box is much longer than the distance to neighbours there.
    pub(crate) fn boxes(&self) -> Vec<Reach> {
        let mut boxes = Vec::new();
        let mut last: Option<(Reach, usize)> = None;
        for leaf in &self.leaves {
            let to_last = leaf.reach.distance - leaf.reach.diagonal();
            let longest = if to_last > 0.0 {
                LONGEST * to_last
            } else {
                0.0
            };
            for &point in &leaf.points {
                let own = Reach::at(self.positions[point as usize]);
                last = Some(match last {
                    Some((all, count)) if count < MOST && all.and(&own).diagonal() <= longest => {
                        (all.and(&own), count + 1)
                    }
                    other => {
                        boxes.extend(other.map(|(all, _)| all));
                        (own, 1)
                    }
                });
            }
        }
        boxes.extend(last.map(|(all, _)| all));
        boxes
    }

    /// Returns the box of one point, bounded by the point's own neighbours, which is tighter than its leaf's
    /// bound.
    ///
    /// - `most`: a known bound on the distance.
    pub(crate) fn alone(&self, point: u32, count: usize, most: f64) -> Reach {
        let at = self.positions[point as usize];
        self.reach(Reach::at(at), at, count, most)
    }

    /// - `from`: a place in the box.
    fn reach(&self, within: Reach, from: DVec3, count: usize, most: f64) -> Reach {
        let around = || self.to_last(from, count, most) + within.diagonal() * (1.0 + 1e-9);
        Reach {
            count: count as u64,
            distance: match count {
                0 => -1.0,
                // A ball around any point of the box, larger by the box's diagonal, contains as many points.
                _ => around().min(most),
            },
            ..within
        }
    }

    /// Returns a bound, from the local points, on the distance from any point of a box to the neighbours it
    /// needs. It is the box's own bound if that is smaller.
    pub(crate) fn bound(&self, reach: &Reach) -> f64 {
        let count = usize::try_from(reach.count).unwrap_or(usize::MAX - 1);
        let (low, high) = (DVec3::from(reach.low), DVec3::from(reach.high));
        let middle = (low + high) / 2.0;
        // To the farther corner, however the middle is rounded.
        let far = (high - middle).max(middle - low).length();
        let last = self.to_last(middle, count, reach.distance - far);
        reach.distance.min(last + far * (1.0 + 1e-9))
    }

    /// Returns the distance to the last of `count` neighbours, rounded up; infinite if fewer are within the
    /// radius.
    fn to_last(&self, from: DVec3, count: usize, radius: f64) -> f64 {
        let last = self.index.as_ref().filter(|_| radius > 0.0);
        let last = last.and_then(|index| index.last_within(from, count, radius));
        last.map_or(f64::INFINITY, |squared| squared.sqrt() * (1.0 + 1e-9))
    }
}

/// A hierarchy of boxes, for finding those that are near something.
pub(crate) struct Boxes {
    levels: Vec<Vec<Reach>>,
}

impl Boxes {
    /// Number of boxes that are combined.
    const TOGETHER: usize = 8;

    /// - `boxes`: in a spatially coherent order.
    pub(crate) fn of(boxes: Vec<Reach>) -> Self {
        let mut levels = vec![boxes];
        while let Some(last) = levels.last().filter(|last| last.len() > Self::TOGETHER) {
            let around = |boxes: &[Reach]| Reach::around_all(boxes.iter());
            let above = last.chunks(Self::TOGETHER).filter_map(around).collect();
            levels.push(above);
        }
        Self { levels }
    }

    /// Returns true if any box is near.
    ///
    /// - `is_near`: must be true of a box if it is true of any box inside.
    pub(crate) fn any(&self, is_near: &impl Fn(&Reach) -> bool) -> bool {
        let top = self.levels.len() - 1;
        (0..self.levels[top].len()).any(|n| self.any_in(top, n, is_near))
    }

    fn any_in(&self, level: usize, n: usize, is_near: &impl Fn(&Reach) -> bool) -> bool {
        if !is_near(&self.levels[level][n]) {
            return false;
        }
        if level == 0 {
            return true;
        }
        let below = self.levels[level - 1].len();
        let parts = Self::TOGETHER * n..(Self::TOGETHER * (n + 1)).min(below);
        parts
            .into_iter()
            .any(|n| self.any_in(level - 1, n, is_near))
    }
}
