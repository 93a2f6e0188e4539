//! Counts overlapping kernels of a point set: finds the places with more kernels than the error budget provides for.
//! The edges of such kernels meet on the image, and their errors add up.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::tree::{PartialTree, Tree};
use crate::blocks::source::Source;
use crate::collective::Collective;
use crate::error::Result;
use crate::splat::budget::OVERLAP;

/// Greatest diagonal of the box around the centres of kernels in one place, in units of the standard deviation that at
/// least half of them have. If kernels scatter by .3, .5 and .7 standard deviations about a centre, a third, a twelfth
/// and a thirtieth of the edge remain that they would have together.
const DIAGONAL: f64 = 1.0;

/// Number of particles in each sum that is kept.
const STEP: usize = 8;

/// Overlap counts of a point set at its crowds: places where more than [`OVERLAP`] kernels overlap.
#[derive(Debug, Default)]
pub(in crate::blocks) struct OverlapCounts {
    /// Runs of block order, ascending and disjoint, and the overlap count of each.
    runs: Vec<(Range<usize>, usize)>,
}

/// Kernels among which crowds are searched.
struct Kernels<'a> {
    source: &'a Source<'a>,
    /// Number of drawn kernels, and the sum of their widths, for every [`STEP`] particles.
    kept: Vec<(usize, f64)>,
    widest: f64,
}

/// Summary of a run of kernels.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Summary {
    /// Number of drawn kernels.
    count: u64,
    /// Sum of their widths.
    sum: f64,
    lower: DVec3,
    upper: DVec3,
}

impl Summary {
    const NONE: Self = Self {
        count: 0,
        sum: 0.0,
        lower: DVec3::INFINITY,
        upper: DVec3::NEG_INFINITY,
    };

    fn and(mut self, other: &Self) -> Self {
        self.count += other.count;
        self.sum += other.sum;
        self.lower = self.lower.min(other.lower);
        self.upper = self.upper.max(other.upper);
        self
    }

    fn diagonal(&self) -> f64 {
        (self.upper - self.lower).length()
    }

    /// Whether they may lie in one place, by a lower bound on the diagonal of their box.
    ///
    /// If at least half of them have a width, the mean is at least half of it. The tree bounds its boxes only roughly:
    /// if this returns true, the particles must be read.
    fn may_be_one_place(&self, diagonal: f64) -> bool {
        diagonal <= reach(self.sum / self.count as f64)
    }
}

fn reach(mean: f64) -> f64 {
    (1.0 + 1e-6) * 2.0 * DIAGONAL * mean
}

impl<'a> Kernels<'a> {
    fn new(source: &'a Source<'a>) -> Self {
        let mut own = Self {
            source,
            kept: Vec::with_capacity(source.positions.len() / STEP + 1),
            widest: 0.0,
        };
        let count = source.positions.len();
        for start in (0..count).step_by(STEP) {
            let some = start..count.min(start + STEP);
            let widths = some.clone().filter_map(|i| own.width(i));
            own.widest = widths.fold(own.widest, f64::max);
            let sums = some.fold((0, 0.0), |sums, i| own.add(sums, i));
            own.kept.push(sums);
        }
        own
    }

    /// Returns the least standard deviation of a drawn kernel.
    fn width(&self, i: usize) -> Option<f64> {
        width(self.source, i)
    }

    fn add(&self, (count, sum): (usize, f64), i: usize) -> (usize, f64) {
        self.width(i).map_or((count, sum), |w| (count + 1, sum + w))
    }

    /// Sums the number and the widths of kernels, without their positions. Sums of a few wide kernels are rounded
    /// separately from those of many narrow kernels elsewhere.
    fn sums(&self, run: &Range<usize>) -> Summary {
        let (first, last) = (run.start.div_ceil(STEP), run.end / STEP);
        let singly = |sums, some: Range<usize>| some.fold(sums, |sums, i| self.add(sums, i));
        let (count, sum) = if first < last {
            let head = singly((0, 0.0), run.start..first * STEP);
            let whole = self.kept[first..last].iter();
            let whole = whole.fold(head, |(count, sum), own| (count + own.0, sum + own.1));
            singly(whole, last * STEP..run.end)
        } else {
            singly((0, 0.0), run.clone())
        };
        Summary {
            count: count as u64,
            sum,
            ..Summary::NONE
        }
    }

    fn drawn(&self, run: &Range<usize>) -> impl Iterator<Item = (DVec3, f64)> {
        let positions = self.source.positions;
        run.clone()
            .filter_map(move |i| Some((positions[i], self.width(i)?)))
    }

    fn summary(&self, run: &Range<usize>) -> Summary {
        self.drawn(run)
            .map(|(p, width)| Summary {
                count: 1,
                sum: width,
                lower: p,
                upper: p,
            })
            .fold(Summary::NONE, |all, own| all.and(&own))
    }

    /// Counts the kernels that are so wide that a box of this diagonal is one place.
    fn wide(&self, run: &Range<usize>, diagonal: f64) -> u64 {
        let wide = self
            .drawn(run)
            .filter(|(_, width)| diagonal <= DIAGONAL * width);
        wide.count() as u64
    }

    fn are_one_place(&self, run: &Range<usize>) -> bool {
        let all = self.summary(run);
        2 * self.wide(run, all.diagonal()) >= all.count
    }

    /// Finds the crowds in a tree.
    ///
    /// - `at`: index of the tree's first particle.
    fn find(&self, tree: &Tree, at: usize) -> Vec<(Range<usize>, usize)> {
        let mut found = Vec::new();
        tree.visit(|run, diagonal| {
            if !is_crowd(run.len()) {
                return false;
            }
            if diagonal > reach(self.widest) {
                return true;
            }
            let here = run.start + at..run.end + at;
            let sums = self.sums(&here);
            let count = sums.count as usize;
            if !is_crowd(count) {
                return false;
            }
            let is_found = sums.may_be_one_place(diagonal) && self.are_one_place(&here);
            if is_found {
                found.push((run, count));
            }
            !is_found
        });
        found
    }
}

/// Returns the least standard deviation of a drawn kernel.
fn width(source: &Source<'_>, i: usize) -> Option<f64> {
    let [least, greatest] = source.sigmas(i);
    let is_drawn = least >= 0.0 && greatest.is_finite() && {
        let strength = source.strength.stored()[i];
        strength > 0.0 && strength.is_finite()
    };
    is_drawn.then_some(f64::from(least))
}

impl OverlapCounts {
    /// Finds the crowds of a point set.
    ///
    /// A kernel's width is its least standard deviation. Particles without strength draw nothing, and do not count.
    ///
    /// - `tree`: over the particles; empty if all are in one block.
    pub(super) fn new(tree: &Tree, source: &Source<'_>) -> Self {
        if !tree.is_empty() {
            let runs = Kernels::new(source).find(tree, 0);
            return Self { runs };
        }
        let at = |i: usize| source.positions[i];
        let all = 0..source.positions.len();
        let drawn: Vec<usize> = all.filter(|&i| width(source, i).is_some()).collect();
        let beside = |&i: &usize| {
            // A wide kernel does not put many narrow ones in one place.
            let reach = |i: usize| 0.5 * DIAGONAL * width(source, i).unwrap_or(0.0);
            let is_near = |&&j: &&usize| at(i).distance(at(j)) <= reach(i).min(reach(j));
            drawn.iter().filter(is_near).count()
        };
        let mut runs = Vec::new();
        let count = drawn.iter().map(beside).max().unwrap_or(0);
        if is_crowd(count) {
            runs.push((0..source.positions.len(), count));
        }
        Self { runs }
    }

    /// Finds the crowds among the particles of all ranks.
    ///
    /// - `trees`: trees over this rank's particles, each with its index among the leaves of `top_tree`.
    /// - `top_tree`: top tree, whose leaves are the trees of all ranks.
    /// - `runs`: particles of each of its leaves, in block order.
    pub(super) fn of_all_ranks(
        trees: &[(usize, PartialTree<'_>)],
        top_tree: &Tree,
        runs: &[Range<usize>],
        source: &Source<'_>,
        ranks: &mut dyn Collective,
    ) -> Result<Self> {
        let kernels = Kernels::new(source);
        let here = |own: &PartialTree<'_>| own.at..own.at + own.tree.len();
        let mut leaves = vec![Summary::NONE; runs.len()];
        for (leaf, own) in trees {
            leaves[*leaf] = kernels.summary(&here(own));
        }
        let leaves = ranks.reduce(Ok(leaves), |all, own| *all = all.and(own))?;
        let particles = |leaves: &Range<usize>| runs[leaves.start].start..runs[leaves.end - 1].end;
        let mut asked = Vec::new();
        top_tree.visit(|run, diagonal| {
            if run.len() == 1 || !is_crowd(particles(&run).len()) {
                return false;
            }
            let all = leaves[run.clone()]
                .iter()
                .fold(Summary::NONE, |all, own| all.and(own));
            let is_any = is_crowd(all.count as usize);
            if is_any && all.may_be_one_place(diagonal) {
                asked.push((run, all));
            }
            is_any
        });
        let wide = asked.iter().map(|(run, all)| {
            let own = trees.iter().filter(|(leaf, _)| run.contains(leaf));
            let wide = own.map(|(_, own)| kernels.wide(&here(own), all.diagonal()));
            wide.sum()
        });
        let wide = ranks.sums(Ok(wide.collect()))?;
        let mut found: Vec<(Range<usize>, usize)> = Vec::new();
        // Each run lies within an earlier one, or behind all of them.
        for ((run, all), wide) in asked.into_iter().zip(wide) {
            let is_within = found.last().is_some_and(|(last, _)| run.start < last.end);
            if !is_within && 2 * wide >= all.count {
                found.push((run, all.count as usize));
            }
        }
        let mut own = Vec::new();
        for (leaf, tree) in trees {
            if found.iter().any(|(run, _)| run.contains(leaf)) {
                continue;
            }
            let of_tree = kernels.find(tree.tree, tree.at).into_iter();
            own.extend(of_tree.map(|(run, count)| {
                [run.start + tree.start, run.end + tree.start, count].map(|n| n as u64)
            }));
        }
        let own = ranks.gather_records(Ok(own))?.concat().into_iter();
        let own = own.map(|[start, end, count]| (start as usize..end as usize, count as usize));
        let above = found
            .into_iter()
            .map(|(run, count)| (particles(&run), count));
        let mut runs: Vec<(Range<usize>, usize)> = own.chain(above).collect();
        runs.sort_unstable_by_key(|(run, _)| run.start);
        Ok(Self { runs })
    }

    /// Returns the greatest overlap count in a run of block order, as a multiple of [`OVERLAP`]; at least 1.
    ///
    /// - `share`: number of drawn particles for each of these.
    pub(super) fn greatest(&self, run: &Range<usize>, share: f32) -> f32 {
        let first = self.runs.partition_point(|(own, _)| own.end <= run.start);
        self.runs[first..]
            .iter()
            .take_while(|(own, _)| own.start < run.end)
            .map(|(_, count)| *count as f32 * share / OVERLAP)
            .fold(1.0, f32::max)
    }
}

fn is_crowd(count: usize) -> bool {
    count as f32 > OVERLAP
}

#[cfg(test)]
mod tests {
    use crate::blocks::BlockedVolume;
    use crate::blocks::source::Shapes;
    use crate::scene::{ColourIn, Particles, PointVolume, StrengthIn};

    use super::*;

    fn crowding(positions: Vec<DVec3>, sigma: impl Fn(usize) -> f32) -> Vec<f32> {
        crowding_of(positions, sigma, |_| 1.0)
    }

    fn crowding_of(
        positions: Vec<DVec3>,
        sigma: impl Fn(usize) -> f32,
        mass: impl Fn(usize) -> f32,
    ) -> Vec<f32> {
        let count = positions.len();
        let family = BlockedVolume::with_detail(PointVolume {
            colour: ColourIn::Uniform([1.0; 3]),
            ..PointVolume::new(
                Particles::Isotropic {
                    sigmas: (0..count).map(sigma).collect(),
                    positions,
                },
                StrengthIn::Mass((0..count).map(mass).collect()),
            )
        });
        let blocks = family.iter().flat_map(|volume| &volume.blocks);
        blocks.map(|block| block.crowding).collect()
    }

    /// Returns a pseudo-random number from 0 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract().abs()
    }

    fn scattered(count: usize) -> Vec<DVec3> {
        let at = |n: usize| DVec3::new(number(3 * n), number(3 * n + 1), number(3 * n + 2));
        (0..count).map(at).collect()
    }

    /// Smoothing lengths of 1.2 mean distances, and twice that: ordinary data.
    #[test]
    fn what_lies_evenly_is_no_crowd() {
        let n = 24;
        let lattice = |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64);
        for sigma in [0.6, 1.0, 1.3] {
            let all = crowding((0..n * n * n).map(lattice).collect(), |_| sigma);
            assert!(all.iter().all(|&c| c.to_bits() == 1.0_f32.to_bits()));
        }
        for count in [200, 20_000] {
            let distance = (count as f64).cbrt().recip();
            let all = crowding(scattered(count), |_| (0.66 * distance) as f32);
            assert!(all.iter().all(|&c| c.to_bits() == 1.0_f32.to_bits()));
        }
    }

    #[test]
    fn crowds_are_counted_wherever_they_are() {
        // In one block; across blocks; part of a block.
        for (crowd, others) in [(150, 0), (5_000, 0), (5_000, 20_000), (60, 20_000)] {
            for far in [0.0, 1e9] {
                let mut positions = scattered(others);
                positions.extend(vec![DVec3::splat(0.3); crowd]);
                for p in &mut positions {
                    *p += DVec3::splat(far);
                }
                let all = crowding(positions, |_| 0.01);
                let greatest = all.iter().copied().fold(0.0, f32::max);
                let expected = crowd as f32 / OVERLAP;
                // Other particles may lie close by.
                assert!(
                    greatest >= expected && greatest < 1.2 * expected,
                    "{greatest}"
                );
                assert!(all.iter().all(|&c| c >= 1.0));
            }
        }
    }

    #[test]
    fn every_kernel_of_a_place_counts_and_none_beside_it() {
        // Thirty-sevenths of the whole: no plane that halves the box repeatedly cuts a place.
        let place = |i: usize| DVec3::from([7, 11, 17].map(|k| (k * i % 38) as f64));
        let crowds = (0..38).map(|i| vec![place(i); i + 1]);
        let unordered: Vec<DVec3> = crowds.flatten().collect();
        let (tree, order) = Tree::over(&unordered, &[]);
        let positions: Vec<DVec3> = order.iter().map(|&i| unordered[i as usize]).collect();
        let sigmas = vec![1e-3; positions.len()];
        let source = Source {
            positions: &positions,
            shapes: Shapes::Spheres(&sigmas),
            principal: &[],
            strength: &StrengthIn::Mass(vec![1.0; positions.len()].into()),
            colour: &ColourIn::Uniform([1.0; 3]),
            values: None,
            models: None,
            boundary: None,
        };
        let OverlapCounts { runs } = OverlapCounts::new(&tree, &source);
        for (run, count) in &runs {
            assert_eq!(run.len(), *count);
            assert!(run.clone().all(|i| positions[i] == positions[run.start]));
        }
        // The tree puts single kernels of a place with its neighbour.
        assert!((31..=32).contains(&runs.len()), "{}", runs.len());
    }

    #[test]
    fn a_crowd_far_narrower_than_the_scene_is_told_from_a_cluster() {
        let mut positions = vec![DVec3::ZERO; 1_000];
        positions.extend(scattered(1_000).into_iter().map(|p| p * 1e-6 + 1.0));
        positions.push(DVec3::splat(1e3));
        let all = crowding(positions, |_| 1e-7);
        let greatest = all.iter().copied().fold(0.0, f32::max);
        assert!((greatest * OVERLAP - 1_000.0).abs() < 1.0, "{greatest}");
    }

    #[test]
    fn what_draws_nothing_adds_to_no_crowd() {
        for broken in [f32::NAN, f32::INFINITY, 0.0, -1.0] {
            for count in [100, 1_000] {
                // All at one position: with the broken kernels they would be a crowd.
                let all = crowding_of(
                    vec![DVec3::splat(0.3); count],
                    |_| 0.01,
                    |i| {
                        if i < 5 { 1.0 } else { broken }
                    },
                );
                assert!(
                    all.iter().all(|&c| c.to_bits() == 1.0_f32.to_bits()),
                    "{broken}"
                );
            }
        }
    }

    #[test]
    fn a_wide_kernel_is_no_place_of_many_narrow_ones() {
        for wide in [1.0, 1e30] {
            for count in [100, 1_000] {
                let all = crowding(scattered(count), |i| if i == 7 { wide } else { 1e-3 });
                assert!(
                    all.iter().all(|&c| c.to_bits() == 1.0_f32.to_bits()),
                    "{wide}"
                );
            }
        }
    }

    #[test]
    fn widths_that_are_none_are_no_crowd() {
        for broken in [f32::NAN, f32::INFINITY, 0.0, -1.0] {
            for count in [100, 1_000] {
                let all = crowding(scattered(count), |_| broken);
                assert!(
                    all.iter().all(|&c| c.to_bits() == 1.0_f32.to_bits()),
                    "{broken}"
                );
            }
        }
    }
}
