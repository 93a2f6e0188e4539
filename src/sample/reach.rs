//! How far the nearest neighbours of points are at most, where some of these are elsewhere.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

use super::index_u32;
use super::neighbours::PointIndex;

/// Points of a box: neighbours of one of them are looked for, and bound those of the others.
const LEAF: usize = 8;

/// Points of a box of which others hear at most.
const MOST: usize = 256;

/// How many times as long as neighbours are far such a box may be: those of [`MOST`] evenly spread points are six times as
/// long as the 24 nearest are far.
const LONGEST: f64 = 10.0;

/// A box of points, and how far from any of these its nearest neighbours are at most.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Reach {
    low: [f64; 3],
    high: [f64; 3],
    /// Infinite where there are fewer neighbours than are asked for; negative where none are.
    pub(crate) distance: f64,
    /// How many are asked for.
    count: u64,
}

impl Reach {
    /// A point, without neighbours.
    fn at(p: DVec3) -> Self {
        Self {
            low: p.to_array(),
            high: p.to_array(),
            distance: -1.0,
            count: 0,
        }
    }

    /// A box around both boxes, and the greater distance.
    fn and(&self, other: &Self) -> Self {
        Self {
            low: DVec3::from(self.low).min(other.low.into()).to_array(),
            high: DVec3::from(self.high).max(other.high.into()).to_array(),
            distance: self.distance.max(other.distance),
            count: self.count.max(other.count),
        }
    }

    /// Around boxes; of none, none.
    fn around_all<'a>(boxes: impl Iterator<Item = &'a Self>) -> Option<Self> {
        boxes.copied().reduce(|all, own| all.and(&own))
    }

    fn diagonal(&self) -> f64 {
        (DVec3::from(self.high) - DVec3::from(self.low)).length()
    }

    /// Whether a neighbour may be in the other box.
    pub(crate) fn touches(&self, other: &Self) -> bool {
        let after = DVec3::from(other.low) - DVec3::from(self.high);
        let before = DVec3::from(self.low) - DVec3::from(other.high);
        after.max(before).max(DVec3::ZERO).length() <= self.distance
    }

    /// Whether a point may be a neighbour.
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

/// Points, and how far their neighbours among themselves are.
pub(crate) struct Near<'a> {
    positions: &'a [DVec3],
    index: Option<PointIndex<'a>>,
    /// Of the points that have a place, some that are near one another together, in an order in which what is near
    /// follows soon.
    pub(crate) leaves: Vec<Leaf>,
}

impl<'a> Near<'a> {
    /// - `count`: of distinct neighbours that a point asks for; of none it needs none.
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

    /// Boxes around all points, of up to [`MOST`] of these each. Along a curve through space what follows is sometimes far
    /// away: none is much longer than neighbours there are far.
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

    /// A point by itself, whose own neighbours bound it better than those of its box.
    ///
    /// - `most`: how far these are at most.
    pub(crate) fn alone(&self, point: u32, count: usize, most: f64) -> Reach {
        let at = self.positions[point as usize];
        self.reach(Reach::at(at), at, count, most)
    }

    /// - `from`: in the box.
    fn reach(&self, within: Reach, from: DVec3, count: usize, most: f64) -> Reach {
        let around = || self.to_last(from, count, most) + within.diagonal() * (1.0 + 1e-9);
        Reach {
            count: count as u64,
            distance: match count {
                0 => -1.0,
                // Around any point of the box a ball that is larger by its diagonal has as many.
                _ => around().min(most),
            },
            ..within
        }
    }

    /// How far from any point of a box as many of these points are as it asks for, at most; its own bound where that is
    /// not nearer.
    pub(crate) fn bound(&self, reach: &Reach) -> f64 {
        let count = usize::try_from(reach.count).unwrap_or(usize::MAX - 1);
        let (low, high) = (DVec3::from(reach.low), DVec3::from(reach.high));
        let middle = (low + high) / 2.0;
        // To the farther end, wherever the middle is rounded to.
        let far = (high - middle).max(middle - low).length();
        let last = self.to_last(middle, count, reach.distance - far);
        reach.distance.min(last + far * (1.0 + 1e-9))
    }

    /// To the last of some neighbours, and a rounding; infinite where fewer are within a radius.
    fn to_last(&self, from: DVec3, count: usize, radius: f64) -> f64 {
        let last = self.index.as_ref().filter(|_| radius > 0.0);
        let last = last.and_then(|index| index.last_within(from, count, radius));
        last.map_or(f64::INFINITY, |squared| squared.sqrt() * (1.0 + 1e-9))
    }
}

/// Boxes, and boxes around some of them, and so on: to find those that something is near to.
pub(crate) struct Boxes {
    levels: Vec<Vec<Reach>>,
}

impl Boxes {
    /// How many are put together.
    const TOGETHER: usize = 8;

    /// - `boxes`: in an order in which what is near follows soon.
    pub(crate) fn of(boxes: Vec<Reach>) -> Self {
        let mut levels = vec![boxes];
        while let Some(last) = levels.last().filter(|last| last.len() > Self::TOGETHER) {
            let around = |boxes: &[Reach]| Reach::around_all(boxes.iter());
            let above = last.chunks(Self::TOGETHER).filter_map(around).collect();
            levels.push(above);
        }
        Self { levels }
    }

    /// Whether any box is near.
    ///
    /// - `is_near`: of a box around others also where it is of one of these.
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
