//! Finds the nearest of many positions, by a tree of boxes.
//!
//! Boxes are compared with distances as they are computed, not as they would be exactly: differences, squares and sums
//! of non-negative terms round monotonically, so that no rounding hides a position.

use std::cmp::Ordering;

use glam::DVec3;

use crate::sample::positions::{self, compare, index_u32};
use crate::simd::{SimdLevel, SimdWork, run_at};

/// Number of positions in a leaf.
const LEAF: usize = 32;

/// Number of boxes in a node.
const FAN: usize = 8;

/// Least number of positions that two threads sort.
const FORK: usize = 1 << 13;

/// Greatest number of leaves that are kept for the positions of one leaf. For 24 neighbours evenly spread positions
/// need 28 on average, clusters 44.
const MOST_KEPT: usize = 128;

/// Square of the radius within which the next position's neighbours are looked for, over that of the last one's. For 24
/// neighbours one search in sixteen finds too few among evenly spread positions, one in seven among clusters; it is
/// repeated.
const NEXT: f64 = 1.3;

/// Square of the radius within which leaves are kept, over that of the next search.
const KEPT: f64 = 1.5;

/// Limit that excludes only squared distances that overflow.
pub(super) const UNLIMITED: f64 = f64::MAX;

/// Low bits of a sorting key that number what is sorted.
const SLOTS: u64 = 0xffff;

/// Distinct positions, sorted so that nearby ones are adjacent. Each leaf has [`LEAF`] of them, and each node the
/// boxes of [`FAN`] leaves or nodes.
pub(super) struct Tree {
    /// x, y and z of the positions of each leaf; NaN behind the last position.
    leaves: Vec<[[f64; LEAF]; 3]>,
    /// The nodes of each level: those of the leaves first, the root last.
    levels: Vec<Vec<Node>>,
}

/// Up to [`FAN`] boxes.
#[derive(Debug, Clone, Copy)]
struct Node {
    low: [[f64; FAN]; 3],
    high: [[f64; FAN]; 3],
    count: usize,
}

/// Position that was found.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Near {
    pub(super) index: u32,
    /// Squared distance.
    pub(super) squared: f64,
}

type Corners = [DVec3; 2];

const NOTHING: Corners = [DVec3::INFINITY, DVec3::NEG_INFINITY];

fn around(boxes: impl Iterator<Item = Corners>) -> Corners {
    boxes.fold(NOTHING, |all, own| [all[0].min(own[0]), all[1].max(own[1])])
}

fn around_positions<T>(items: &[(DVec3, T)]) -> Corners {
    positions::around(items.iter().map(|item| item.0))
}

/// Sorts positions by halves along the longest axis. The first half has the positions of a power of two of leaves.
fn sort<T: Send>(items: &mut [(DVec3, T)]) {
    if items.len() <= LEAF {
        return;
    }
    let [low, high] = around_positions(items);
    // Halves, which do not overflow.
    let axis = (0.5 * high - 0.5 * low).max_position();
    let half = LEAF * (items.len().div_ceil(LEAF).next_power_of_two() / 2);
    items.select_nth_unstable_by(half, |a, b| a.0[axis].total_cmp(&b.0[axis]));
    let (left, right) = items.split_at_mut(half);
    match right.len() < FORK {
        true => [left, right].map(sort).into_iter().collect(),
        false => {
            rayon::join(|| sort(left), || sort(right));
        }
    }
}

impl Node {
    fn of(boxes: &[Corners]) -> Self {
        let corner = |side: usize, d: usize| {
            std::array::from_fn(|n| boxes.get(n).map_or(NOTHING[side][d], |own| own[side][d]))
        };
        Self {
            low: [0, 1, 2].map(|d| corner(0, d)),
            high: [0, 1, 2].map(|d| corner(1, d)),
            count: boxes.len(),
        }
    }

    /// Returns the squared distances of a box to the boxes.
    #[inline(always)]
    fn gaps(&self, [low, high]: Corners) -> [f64; FAN] {
        let greater = |a: f64, b: f64| if a > b { a } else { b };
        let mut squared = [0.0; FAN];
        for (n, squared) in squared.iter_mut().enumerate() {
            let gap = |d: usize| {
                let gap = greater(self.low[d][n] - high[d], low[d] - self.high[d][n]);
                greater(gap, 0.0)
            };
            let [x, y, z] = [gap(0), gap(1), gap(2)];
            *squared = x * x + y * y + z * z;
        }
        squared
    }

    /// Returns the boxes whose squared distance does not exceed a limit.
    #[inline(always)]
    fn within(&self, gaps: &[f64; FAN], limit: f64) -> Mask {
        let mut mask = 0;
        for (n, gap) in gaps.iter().enumerate() {
            mask |= u32::from(*gap <= limit) << n;
        }
        Mask(mask & ((1 << self.count) - 1))
    }
}

/// A set of small numbers.
struct Mask(u32);

impl Iterator for Mask {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let n = self.0.trailing_zeros();
        self.0 &= self.0.wrapping_sub(1);
        (n < 32).then_some(n as usize)
    }
}

/// Walk through the leaves near a box.
struct Walk<'a> {
    tree: &'a Tree,
    corners: Corners,
    /// Squared distance, level, and number in the level, of what is to be visited; leaves have level 0.
    open: Vec<(f64, usize, usize)>,
}

impl Walk<'_> {
    /// Returns the next leaf within a limit, a squared distance; of the boxes of a node the nearest comes first. The
    /// limit may shrink from call to call.
    #[inline(always)]
    fn next(&mut self, limit: f64) -> Option<usize> {
        loop {
            let (gap, level, n) = self.open.pop()?;
            if gap > limit {
                continue;
            }
            let Some(below) = level.checked_sub(1) else {
                return Some(n);
            };
            let node = &self.tree.levels[below][n];
            let gaps = node.gaps(self.corners);
            let first = self.open.len();
            for k in node.within(&gaps, limit) {
                let own = (gaps[k], below, FAN * n + k);
                self.open.push(own);
                let mut at = self.open.len() - 1;
                while at > first && self.open[at - 1].0 < own.0 {
                    self.open[at] = self.open[at - 1];
                    at -= 1;
                }
                self.open[at] = own;
            }
        }
    }
}

impl Tree {
    /// Sorts distinct finite positions, and makes the tree of them.
    pub(super) fn new<T: Send>(items: &mut [(DVec3, T)]) -> Self {
        sort(items);
        let chunks = || items.chunks(LEAF);
        let leaf = |some: &[(DVec3, T)]| {
            let along =
                |d: usize| std::array::from_fn(|n| some.get(n).map_or(f64::NAN, |item| item.0[d]));
            [0, 1, 2].map(along)
        };
        let mut boxes: Vec<Corners> = chunks().map(around_positions).collect();
        let mut levels = Vec::new();
        loop {
            levels.push(boxes.chunks(FAN).map(Node::of).collect());
            if boxes.len() <= FAN {
                break;
            }
            boxes = boxes
                .chunks(FAN)
                .map(|some| around(some.iter().copied()))
                .collect();
        }
        Self {
            leaves: chunks().map(leaf).collect(),
            levels,
        }
    }

    /// Returns a position.
    #[inline(always)]
    pub(super) fn position(&self, i: usize) -> DVec3 {
        let leaf = &self.leaves[i / LEAF];
        DVec3::from([0, 1, 2].map(|d| leaf[d][i % LEAF]))
    }

    /// Begins a walk through the leaves near a box.
    #[inline(always)]
    fn walk(&self, corners: Corners) -> Walk<'_> {
        // All boxes of one node on each level.
        let mut open = Vec::with_capacity(1 + FAN * self.levels.len());
        open.push((0.0, self.levels.len(), 0));
        Walk {
            tree: self,
            corners,
            open,
        }
    }

    /// Returns the box of a leaf.
    #[inline(always)]
    fn corners(&self, leaf: usize) -> Corners {
        let (node, n) = (&self.levels[0][leaf / FAN], leaf % FAN);
        [node.low, node.high].map(|c| DVec3::new(c[0][n], c[1][n], c[2][n]))
    }

    /// Adds the positions of a leaf within a limit of a place.
    #[inline(always)]
    fn add(&self, leaf: usize, from: DVec3, limit: f64, found: &mut Vec<Near>) {
        let [x, y, z] = &self.leaves[leaf];
        let mut squares = [0.0; LEAF];
        for (n, squared) in squares.iter_mut().enumerate() {
            let d = DVec3::new(x[n] - from.x, y[n] - from.y, z[n] - from.z);
            *squared = d.length_squared();
        }
        // Without a branch, which would not be foreseen.
        let first = found.len();
        found.resize(first + LEAF, Near::default());
        let room = &mut found[first..first + LEAF];
        let mut count = 0;
        for (n, &squared) in squares.iter().enumerate() {
            room[count % LEAF] = Near {
                index: index_u32(LEAF * leaf + n),
                squared,
            };
            count += usize::from(squared <= limit);
        }
        found.truncate(first + count);
    }

    /// Calls `visit` with each position within a radius.
    pub(super) fn within(&self, from: DVec3, radius: f64, mut visit: impl FnMut(usize)) {
        let limit = radius * radius;
        let mut found = Vec::new();
        let mut walk = self.walk([from; 2]);
        while let Some(leaf) = walk.next(limit) {
            self.add(leaf, from, limit, &mut found);
            for near in found.drain(..) {
                visit(near.index as usize);
            }
        }
    }

    /// Compares by distance, and by coordinates at equal distances.
    fn compare(&self, a: &Near, b: &Near) -> Ordering {
        let tie = || {
            let [a, b] = [a, b].map(|near| self.position(near.index as usize));
            compare(a, b)
        };
        a.squared.total_cmp(&b.squared).then_with(tie)
    }
}

/// Searches for one position after the other. Positions of one leaf share a list of the leaves around it.
pub(super) struct Search<'a> {
    tree: &'a Tree,
    /// Square of the radius in which the next neighbours are looked for; [`UNLIMITED`] if unknown.
    next: f64,
    /// The leaf whose surroundings are kept.
    leaf: usize,
    /// Square of the radius around it within which leaves are kept; negative if there are too many.
    kept_within: f64,
    kept: Vec<Node>,
    kept_leaves: Vec<usize>,
    found: Vec<Near>,
    sorted: Vec<Near>,
    keys: Vec<u64>,
}

impl<'a> Search<'a> {
    pub(super) fn new(tree: &'a Tree) -> Self {
        Self {
            tree,
            next: UNLIMITED,
            leaf: usize::MAX,
            kept_within: -1.0,
            kept: Vec::new(),
            kept_leaves: Vec::new(),
            found: Vec::new(),
            sorted: Vec::new(),
            keys: Vec::new(),
        }
    }

    /// Returns the `count + 1` positions nearest to one of the tree's, which is the first of them.
    #[inline(always)]
    pub(super) fn around(&mut self, i: usize, count: usize) -> &[Near] {
        self.find(self.tree.position(i), Some(i / LEAF), count, UNLIMITED)
    }

    /// Returns the `count + 1` positions nearest to any place and within a limit, a squared distance.
    pub(super) fn nearest(&mut self, from: DVec3, count: usize, limit: f64) -> &[Near] {
        self.find(from, None, count, limit)
    }

    /// - `leaf`: the leaf of the place, if it is one of the tree's.
    #[inline(always)]
    fn find(&mut self, from: DVec3, leaf: Option<usize>, count: usize, limit: f64) -> &[Near] {
        let search = self;
        let nearest = Nearest {
            search,
            from,
            leaf,
            count,
            limit,
        };
        run_at(SimdLevel::best(), nearest)
    }

    /// Keeps the leaves near a leaf.
    #[inline(always)]
    fn keep(&mut self, leaf: usize, within: f64) {
        let tree = self.tree;
        self.leaf = leaf;
        self.kept_within = -1.0;
        self.kept_leaves.clear();
        self.kept.clear();
        let mut walk = tree.walk(tree.corners(leaf));
        while let Some(other) = walk.next(within) {
            if self.kept_leaves.len() == MOST_KEPT {
                return;
            }
            self.kept_leaves.push(other);
        }
        for some in self.kept_leaves.chunks(FAN) {
            let mut boxes = [NOTHING; FAN];
            for (own, leaf) in boxes.iter_mut().zip(some) {
                *own = tree.corners(*leaf);
            }
            self.kept.push(Node::of(&boxes[..some.len()]));
        }
        self.kept_within = within;
    }

    /// Adds a leaf's positions within a limit; returns the limit that follows.
    #[inline(always)]
    fn add(&mut self, leaf: usize, from: DVec3, count: usize, limit: f64) -> f64 {
        let found = &mut self.found;
        self.tree.add(leaf, from, limit, found);
        if found.len() / 2 <= count.saturating_add(LEAF) {
            return limit;
        }
        let (_, last, _) = found.select_nth_unstable_by_key(count, |near| near.squared.to_bits());
        let last = last.squared;
        found.retain(|near| near.squared <= last);
        // None is nearer, though squares of more may be zero.
        if last > 0.0 { last } else { -1.0 }
    }

    /// Looks for neighbours within a limit; returns true if there are enough.
    #[inline(always)]
    fn look(&mut self, from: DVec3, leaf: Option<usize>, count: usize, mut limit: f64) -> bool {
        self.found.clear();
        let leaf = leaf.filter(|_| limit < UNLIMITED);
        let is_kept = |leaf: &usize| {
            let has_too_many = self.kept_within < 0.0;
            *leaf == self.leaf && (has_too_many || limit <= self.kept_within)
        };
        if let Some(leaf) = leaf.filter(|leaf| !is_kept(leaf)) {
            self.keep(leaf, KEPT * limit);
        }
        if leaf.is_some() && limit <= self.kept_within {
            for n in 0..self.kept.len() {
                let gaps = self.kept[n].gaps([from; 2]);
                for k in self.kept[n].within(&gaps, limit) {
                    if gaps[k] <= limit {
                        limit = self.add(self.kept_leaves[FAN * n + k], from, count, limit);
                    }
                }
            }
        } else {
            let mut walk = self.tree.walk([from; 2]);
            while let Some(leaf) = walk.next(limit) {
                limit = self.add(leaf, from, count, limit);
            }
        }
        self.found.len() > count
    }

    /// Sorts what was found by distance.
    #[inline(always)]
    fn sort(&mut self) {
        let tree = self.tree;
        self.sorted.clear();
        if self.found.len() as u64 > SLOTS {
            self.sorted.append(&mut self.found);
            self.sorted.sort_unstable_by(|a, b| tree.compare(a, b));
            return;
        }
        // Numbers are sorted several times as fast as structures.
        self.keys.clear();
        let key = |(slot, near): (u64, &Near)| near.squared.to_bits() & !SLOTS | slot;
        self.keys.extend((0..).zip(&self.found).map(key));
        self.keys.sort_unstable();
        let found = &self.found;
        self.sorted
            .extend(self.keys.iter().map(|key| found[(key & SLOTS) as usize]));
        let is_close =
            |a: &Near, b: &Near| (a.squared.to_bits() ^ b.squared.to_bits()) & !SLOTS == 0;
        for run in self.sorted.chunk_by_mut(is_close) {
            if run.len() > 1 {
                run.sort_unstable_by(|a, b| tree.compare(a, b));
            }
        }
    }
}

/// One search.
struct Nearest<'a, 'b> {
    search: &'b mut Search<'a>,
    from: DVec3,
    leaf: Option<usize>,
    count: usize,
    limit: f64,
}

impl<'b> SimdWork for Nearest<'_, 'b> {
    type Output = &'b [Near];

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) -> &'b [Near] {
        let Self {
            search,
            from,
            leaf,
            count,
            limit,
        } = self;
        let next = match leaf {
            Some(_) => search.next,
            None => UNLIMITED,
        };
        let is_found = |search: &mut Search<'_>, within: f64| {
            within < limit && search.look(from, leaf, count, within)
        };
        if !(is_found(search, next)
            || (next < search.kept_within && is_found(search, search.kept_within)))
        {
            search.look(from, leaf, count, limit);
        }
        search.sort();
        search.sorted.truncate(count.saturating_add(1));
        if leaf.is_some() {
            let last = search.sorted.last().map_or(0.0, |near| near.squared);
            let is_known = search.sorted.len() > count && last > 0.0;
            search.next = if is_known { NEXT * last } else { UNLIMITED };
        }
        &search.sorted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns clusters of very different sizes, a lattice, and places far away.
    fn places() -> Vec<DVec3> {
        let share = |n: usize, step: f64| (n as f64 * step).fract();
        // Powers of the plastic number's inverse (Roberts 2018).
        let spread = |n: usize| {
            DVec3::new(
                share(n, 0.819_172),
                share(n, 0.671_044),
                share(n, 0.549_700),
            )
        };
        let clusters = (1..2000).map(|n| {
            let size = [1e-6, 1e-3, 0.1, 1.0][n % 4];
            DVec3::splat((n % 4) as f64) + size * spread(n)
        });
        let lattice = (0..1000)
            .map(|n| DVec3::new((n % 10) as f64, (n / 10 % 10) as f64, (n / 100) as f64) - 20.0);
        let far = [1e9, -3e12, 1e200].map(|x| DVec3::new(x, 0.0, 0.5 * x));
        clusters.chain(lattice).chain(far).collect()
    }

    fn tree_of(places: &[DVec3]) -> Tree {
        let mut items: Vec<(DVec3, ())> = places.iter().map(|p| (*p, ())).collect();
        Tree::new(&mut items)
    }

    #[test]
    fn the_nearest_are_those_of_all_compared() {
        let places = places();
        let tree = tree_of(&places);
        let all = |from: DVec3| {
            let near = |i: usize| Near {
                index: index_u32(i),
                squared: (tree.position(i) - from).length_squared(),
            };
            let is_known = |near: &Near| near.squared.is_finite();
            let mut all: Vec<Near> = (0..places.len()).map(near).filter(is_known).collect();
            all.sort_by(|a, b| tree.compare(a, b));
            all
        };
        let same = |found: &[Near], all: &[Near]| {
            let pair = |near: &Near| (near.index, near.squared.to_bits());
            found.iter().map(pair).eq(all.iter().map(pair))
        };
        let mut search = Search::new(&tree);
        for i in (0..places.len()).filter(|i| i % 32 < 5) {
            let all = all(tree.position(i));
            for count in [1, 24, 18, 200] {
                assert!(same(search.around(i, count), &all[..=count]), "{i} {count}");
            }
            assert!(same(search.around(i, 5000), &all), "{i}");
        }
        for from in [
            DVec3::ZERO,
            DVec3::splat(1.0),
            DVec3::new(-5.0, 1e6, 2.0),
            DVec3::splat(-15.5),
        ] {
            let all = all(from);
            assert!(
                same(search.nearest(from, 24, UNLIMITED), &all[..25]),
                "{from}"
            );
            let limit = all[40].squared;
            let within = all.iter().filter(|near| near.squared <= limit).count();
            assert!(
                same(search.nearest(from, 4000, limit), &all[..within]),
                "{from}"
            );
            let radius = limit.sqrt();
            let within = all.iter().filter(|near| near.squared <= radius * radius);
            let mut visited = Vec::new();
            tree.within(from, radius, |i| visited.push(index_u32(i)));
            visited.sort_unstable();
            let mut expected: Vec<u32> = within.map(|near| near.index).collect();
            expected.sort_unstable();
            assert_eq!(visited, expected, "{from}");
        }
    }

    #[test]
    fn squares_that_overflow_or_vanish_are_borne() {
        for (scale, found) in [(1e200, 1), (1.0, 2), (1e-200, 2)] {
            for count in [2, 31, 32, 33, 257, 5000] {
                let at = |n| DVec3::new(scale * f64::from(n), 0.0, 0.0);
                let tree = tree_of(&(0..count).map(at).collect::<Vec<_>>());
                let mut search = Search::new(&tree);
                for i in 0..count as usize {
                    assert_eq!(search.around(i, 1).len(), found, "{scale} {count}");
                }
            }
        }
    }
}
