//! How far the nearest neighbours of points are at most, where some of these may be elsewhere.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

use super::index_u32;
use super::neighbours::PointIndex;

/// Points of a box at most: neighbours of one of them are looked for, and bound those of the others.
pub(crate) const LEAF: usize = 8;

/// A box of points, and how far from any of these its nearest neighbours are at most.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Reach {
    pub(crate) low: [f64; 3],
    pub(crate) high: [f64; 3],
    /// Infinite where there are fewer neighbours than are asked for.
    pub(crate) distance: f64,
}

impl Reach {
    /// Around no points.
    pub(crate) const NONE: Self = Self {
        low: [f64::INFINITY; 3],
        high: [f64::NEG_INFINITY; 3],
        distance: 0.0,
    };

    /// Around points, without neighbours.
    fn around(places: impl Iterator<Item = DVec3>) -> Self {
        places.fold(Self::NONE, |all, p| Self {
            low: DVec3::from(all.low).min(p).to_array(),
            high: DVec3::from(all.high).max(p).to_array(),
            ..all
        })
    }

    /// The box in which all these neighbours are.
    pub(crate) fn whole(&self) -> Self {
        let distance = DVec3::splat(self.distance);
        Self {
            low: (DVec3::from(self.low) - distance).to_array(),
            high: (DVec3::from(self.high) + distance).to_array(),
            distance: 0.0,
        }
    }

    /// A box around both boxes.
    pub(crate) fn and(&self, other: &Self) -> Self {
        Self {
            low: DVec3::from(self.low).min(other.low.into()).to_array(),
            high: DVec3::from(self.high).max(other.high.into()).to_array(),
            distance: self.distance.max(other.distance),
        }
    }

    /// Whether the boxes have a point in common.
    pub(crate) fn touches(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }

    /// Whether a point is in the box.
    pub(crate) fn has(&self, p: DVec3) -> bool {
        let p = p.to_array();
        (0..3).all(|k| self.low[k] <= p[k] && p[k] <= self.high[k])
    }
}

/// The points that have a place, in an order in which what is near follows soon, and the boxes of [`LEAF`] of these each.
///
/// - `count`: of distinct neighbours that each point asks for.
pub(crate) fn reaches(positions: &[DVec3], count: usize) -> (Vec<u32>, Vec<Reach>) {
    let Some(index) = PointIndex::new(positions) else {
        let points = (0..positions.len()).filter(|&i| positions[i].is_finite());
        let points: Vec<u32> = points.map(index_u32).collect();
        let reach = |leaf: &[u32]| Reach {
            distance: f64::INFINITY,
            ..Reach::around(leaf.iter().map(|&i| positions[i as usize]))
        };
        let reaches = points.chunks(LEAF).map(reach).collect();
        return (points, reaches);
    };
    let points: Vec<u32> = (0..index.len())
        .map(|place| index.in_order(place).0)
        .collect();
    let reach = |(n, leaf): (usize, &[u32])| {
        let own = Reach::around(leaf.iter().map(|&i| positions[i as usize]));
        let place = n * LEAF + leaf.len() / 2;
        let nearest: Vec<(usize, f64)> = index.nearest(index.in_order(place).1, count).collect();
        // Around any point of the box a ball that is larger by its diagonal has as many.
        let diagonal = (DVec3::from(own.high) - DVec3::from(own.low)).length();
        let distance = match nearest.get(count) {
            Some((_, squared)) => (squared.sqrt() + diagonal) * (1.0 + 1e-9),
            None => f64::INFINITY,
        };
        Reach { distance, ..own }
    };
    let reaches = points
        .par_chunks(LEAF)
        .enumerate()
        .map(|(n, leaf)| reach((n, leaf)));
    let reaches = reaches.collect();
    (points, reaches)
}
