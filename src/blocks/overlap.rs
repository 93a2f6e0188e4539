//! Where more kernels of a point set lie in one place than the budget provides for: their edges meet
//! there on the image, and what they leave out adds up.

use std::ops::Range;

use glam::DVec3;

use super::merge::Source;
use super::tree::Tree;
use crate::splat::budget::OVERLAP;

/// Kernels whose centres fit into a box of this diagonal, in units of the standard deviation that at least
/// half of them have, lie in one place. Of kernels spread by .3, .5 and .7 standard deviations about a centre, a third, a
/// twelfth and a thirtieth do: as much of the edge that they would have together is left.
const DIAGONAL: f64 = 1.0;

/// Particles from one sum that is kept to the next.
const STEP: usize = 8;

/// The places of a point set where more than [`OVERLAP`] kernels lie.
#[derive(Debug, Default)]
pub(in crate::blocks) struct Crowds {
    /// Runs of block order, ascending and disjoint, and how many kernels lie in one place of each.
    runs: Vec<(Range<usize>, usize)>,
}

impl Crowds {
    /// Finds them.
    ///
    /// Least standard deviations count; particles of no strength draw nothing, and add to no crowd.
    ///
    /// - `tree`: over the particles; empty where all are in one block.
    pub(super) fn new(tree: &Tree, source: &Source<'_>) -> Self {
        let (positions, strengths) = (source.positions, source.strength.stored());
        // The least standard deviation, of what draws anything.
        let width = |i: usize| {
            let [least, greatest] = source.sigmas(i);
            let is_drawn = least >= 0.0 && greatest.is_finite() && {
                let strength = strengths[i];
                strength > 0.0 && strength.is_finite()
            };
            is_drawn.then_some(f64::from(least))
        };
        let at = |i: usize| positions[i];
        let mut runs = Vec::new();
        if tree.is_empty() {
            let drawn: Vec<usize> = (0..positions.len())
                .filter(|&i| width(i).is_some())
                .collect();
            let beside = |&i: &usize| {
                // A wide kernel is no place of many narrow ones.
                let reach = |i: usize| 0.5 * DIAGONAL * width(i).unwrap_or(0.0);
                let is_near = |&&j: &&usize| at(i).distance(at(j)) <= reach(i).min(reach(j));
                drawn.iter().filter(is_near).count()
            };
            let count = drawn.iter().map(beside).max().unwrap_or(0);
            if is_crowd(count) {
                runs.push((0..positions.len(), count));
            }
            return Self { runs };
        }
        // Up to a particle: how many are drawn, and the sum of their widths. Every so many are kept.
        let add = |(count, sum), i| width(i).map_or((count, sum), |w| (count + 1, sum + w));
        let mut kept = Vec::with_capacity(positions.len() / STEP + 1);
        let mut sums = (0, 0.0);
        let mut widest = 0.0_f64;
        for i in 0..positions.len() {
            if i.is_multiple_of(STEP) {
                kept.push(sums);
            }
            sums = add(sums, i);
            widest = widest.max(width(i).unwrap_or(0.0));
        }
        kept.push(sums);
        let before = |place: usize| (place / STEP * STEP..place).fold(kept[place / STEP], add);
        let is_one_place = |run: &Range<usize>| {
            let drawn = run.clone().filter_map(|i| Some((at(i), width(i)?)));
            let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let (lower, upper) = drawn
                .clone()
                .fold(none, |(lower, upper), (p, _)| (lower.min(p), upper.max(p)));
            let diagonal = (upper - lower).length();
            let (wide, all) = drawn.fold((0, 0), |(wide, all), (_, w)| {
                (wide + u32::from(diagonal <= DIAGONAL * w), all + 1)
            });
            2 * wide >= all
        };
        tree.visit(|run, diagonal| {
            if !is_crowd(run.len()) {
                return false;
            }
            // Where half have a width, the mean is half of it or more. The tree knows its boxes roughly, and
            // so do differences of sums: particles are asked where it may be.
            let reach = |mean: f64| (1.0 + 1e-6) * 2.0 * DIAGONAL * mean;
            if diagonal > reach(widest) {
                return true;
            }
            let ((earlier, sum_before), (later, sum)) = (before(run.start), before(run.end));
            let count = later - earlier;
            if !is_crowd(count) {
                return false;
            }
            let mean = (sum - sum_before) / count as f64;
            let is_found = diagonal <= reach(mean) && is_one_place(&run);
            if is_found {
                runs.push((run.clone(), count));
            }
            !is_found
        });
        Self { runs }
    }

    /// The most kernels that lie in one place among those of a run of block order, as a multiple of
    /// [`OVERLAP`]; no less than 1.
    ///
    /// - `share`: how many of the particles that are drawn stand for one of these.
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
    use crate::blocks::merge::Shapes;
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
            particles: Particles::Isotropic {
                sigmas: (0..count).map(sigma).collect(),
                positions,
            },
            strength: StrengthIn::Mass((0..count).map(mass).collect()),
            colour: ColourIn::Uniform([1.0; 3]),
            values: None,
            transfer_function: None,
            boundary: None,
            normals: None,
            local_models: None,
        });
        let blocks = family.iter().flat_map(|volume| &volume.blocks);
        blocks.map(|block| block.crowding).collect()
    }

    /// Numbers without a pattern, 0 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract().abs()
    }

    fn scattered(count: usize) -> Vec<DVec3> {
        let at = |n: usize| DVec3::new(number(3 * n), number(3 * n + 1), number(3 * n + 2));
        (0..count).map(at).collect()
    }

    /// Smoothing lengths of 1.2 mean distances, and twice them: data as they are meant to be.
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
                // Others may lie beside them.
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
        // Thirty-sevenths of the whole: no plane that halves it again and again cuts a place.
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
        let Crowds { runs } = Crowds::new(&tree, &source);
        for (run, count) in &runs {
            assert_eq!(run.len(), *count);
            assert!(run.clone().all(|i| positions[i] == positions[run.start]));
        }
        // The tree leaves single kernels of a place to its neighbour.
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
                // All at one place: with these, a crowd.
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
