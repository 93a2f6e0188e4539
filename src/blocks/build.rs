//! Blocks of a point set: the subtrees of a BVH that hold few enough particles.

use std::ops::Range;

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::{Block, BlockedParticles, BlockedVolume, BrickGrid, EMPTY_RANGE, value_range};
use crate::constants::BLOCK_CAPACITY;
use crate::math::harmonics_count;
use crate::scene::{Colour, Particles, PointVolume, Strength, Values};

pub(super) fn build(volume: PointVolume) -> BlockedVolume {
    let PointVolume {
        particles,
        strength,
        colour,
        values,
        transfer_function,
    } = volume;
    let (positions, sigmas) = match particles {
        Particles::Lattice {
            lattice,
            kernel_width,
        } => {
            let grid = BrickGrid::new(lattice, kernel_width);
            let blocks = if grid.lattice().is_empty() {
                Vec::new()
            } else {
                grid.blocks(values.as_ref())
            };
            return BlockedVolume {
                blocks,
                particles: BlockedParticles::Lattice(grid),
                strength,
                colour,
                values,
                transfer_function,
            };
        }
        Particles::Isotropic { positions, sigmas } => (positions, Ok(sigmas)),
        Particles::Anisotropic { positions, factors } => (positions, Err(factors)),
    };
    let (mut order, runs) = finite_block_order(&positions);
    // The Frobenius norm of the factor bounds its largest singular value.
    let sigma = |i: u32| match &sigmas {
        Ok(sigmas) => sigmas[i as usize],
        Err(factors) => factors[i as usize]
            .iter()
            .map(|l| l * l)
            .sum::<f32>()
            .sqrt(),
    };
    let runs = without_outliers(&mut order, runs, &positions, &sigma);
    if let Some(values) = &values {
        sort_by_value(&mut order, &runs, values);
    }
    let blocks: Vec<Block> = runs
        .par_iter()
        .map(|run| {
            block(
                &order[run.clone()],
                run.start,
                &positions,
                &sigma,
                values.as_ref(),
            )
        })
        .collect();
    let mut offsets = vec![[0.0_f32; 3]; order.len()];
    for (block, run) in blocks.iter().zip(&runs) {
        for (offset, &i) in offsets[run.clone()].iter_mut().zip(&order[run.clone()]) {
            *offset = (positions[i as usize] - block.origin).as_vec3().into();
        }
    }
    drop(positions);
    let pick = |v: &[f32]| order.iter().map(|&i| v[i as usize]).collect::<Vec<_>>();
    BlockedVolume {
        particles: match sigmas {
            Ok(sigmas) => BlockedParticles::Isotropic {
                offsets,
                sigmas: pick(&sigmas),
            },
            Err(factors) => BlockedParticles::Anisotropic {
                offsets,
                factors: order.iter().map(|&i| factors[i as usize]).collect(),
            },
        },
        strength: match strength {
            Strength::Classified { volumes } => Strength::Classified {
                volumes: pick(&volumes),
            },
            Strength::Mass(masses) => Strength::Mass(pick(&masses)),
            Strength::PeakOpacity {
                opacities,
                is_anti_aliased,
            } => Strength::PeakOpacity {
                opacities: pick(&opacities),
                is_anti_aliased,
            },
        },
        colour: match colour {
            Colour::PerParticle(colours) => {
                Colour::PerParticle(order.iter().map(|&i| colours[i as usize]).collect())
            }
            Colour::Harmonics {
                degree,
                coefficients,
            } => {
                let stride = 3 * harmonics_count(degree);
                let set = |&i: &u32| &coefficients[i as usize * stride..][..stride];
                Colour::Harmonics {
                    degree,
                    coefficients: order.iter().flat_map(set).copied().collect(),
                }
            }
            other => other,
        },
        values: values.map(|v| v.gather(&order)),
        transfer_function,
        blocks,
    }
}

/// How many times its kernels' width a block may span: 2^14 leaves f32 offsets a thousandth of
/// a standard deviation.
const WIDEST_BLOCK: f64 = 16_384.0;

/// Splits blocks that a few far particles stretch, where one gap is most of the width: there
/// the far ones would take the bits of the near ones' offsets.
fn without_outliers(
    order: &mut [u32],
    runs: Vec<Range<usize>>,
    positions: &[DVec3],
    sigma: &impl Fn(u32) -> f32,
) -> Vec<Range<usize>> {
    let mut kept = Vec::with_capacity(runs.len());
    let mut rest: Vec<_> = runs.into_iter().rev().collect();
    while let Some(run) = rest.pop() {
        let members = &mut order[run.clone()];
        let (lower, upper) = members.iter().fold(
            (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(lower, upper), &i| {
                (
                    lower.min(positions[i as usize]),
                    upper.max(positions[i as usize]),
                )
            },
        );
        // Halved first: the extent itself may overflow.
        let half = upper / 2.0 - lower / 2.0;
        let axis = half.max_position();
        let widest_kernel = members.iter().map(|&i| sigma(i)).fold(0.0, f32::max);
        if half[axis] <= WIDEST_BLOCK * f64::from(widest_kernel) {
            kept.push(run);
            continue;
        }
        let at = |i: u32| positions[i as usize][axis];
        members.sort_unstable_by(|&a, &b| at(a).total_cmp(&at(b)).then(a.cmp(&b)));
        let gap = |n: usize| at(members[n]) / 2.0 - at(members[n - 1]) / 2.0;
        let widest = (1..members.len()).max_by(|&a, &b| gap(a).total_cmp(&gap(b)));
        match widest {
            Some(n) if gap(n) > half[axis] / 2.0 => {
                rest.push(run.start + n..run.end);
                rest.push(run.start..run.start + n);
            }
            _ => kept.push(run),
        }
    }
    kept
}

/// Orders the particles of each run by their values, NaN last: those of an interval of values are
/// a run of their own.
fn sort_by_value(order: &mut [u32], runs: &[Range<usize>], values: &Values) {
    let mut rest = order;
    let mut blocks = Vec::with_capacity(runs.len());
    for run in runs {
        let (members, others) = rest.split_at_mut(run.len());
        blocks.push(members);
        rest = others;
    }
    blocks.into_par_iter().for_each(|members| {
        members.sort_unstable_by(|&a, &b| {
            let (v, w) = (values.get(a as usize), values.get(b as usize));
            // Zeros of either sign are the same.
            let by_value = v.partial_cmp(&w).unwrap_or(v.is_nan().cmp(&w.is_nan()));
            by_value.then(a.cmp(&b))
        });
    });
}

fn block(
    members: &[u32],
    first: usize,
    positions: &[DVec3],
    sigma: &(impl Fn(u32) -> f32 + Sync),
    values: Option<&Values>,
) -> Block {
    let start = positions[members[0] as usize];
    let (lower, upper) = members.iter().fold((start, start), |(lower, upper), &i| {
        let p = positions[i as usize];
        (lower.min(p), upper.max(p))
    });
    Block {
        origin: (lower + upper) / 2.0,
        half_extent: ((upper - lower) / 2.0).as_vec3() * (1.0 + f32::EPSILON),
        max_sigma: members.iter().map(|&i| sigma(i)).fold(0.0, f32::max),
        first: u32::try_from(first).unwrap_or(u32::MAX),
        count: u32::try_from(members.len()).unwrap_or(u32::MAX),
        value_range: values.map_or(EMPTY_RANGE, |v| {
            value_range(members.iter().map(|&i| v.get(i as usize)))
        }),
    }
}

/// [`block_order`] of the particles whose positions are numbers; the others, which would take
/// the bounds of their block with them, are in no block.
fn finite_block_order(positions: &[DVec3]) -> (Vec<u32>, Vec<Range<usize>>) {
    if positions.par_iter().all(|p| p.is_finite()) {
        return block_order(positions);
    }
    let (kept, finite): (Vec<u32>, Vec<DVec3>) =
        (0..).zip(positions).filter(|(_, p)| p.is_finite()).unzip();
    let (mut order, runs) = block_order(&finite);
    for i in &mut order {
        *i = kept[*i as usize];
    }
    (order, runs)
}

/// The particles' order in which every block is a run, and the runs: the largest subtrees of a
/// PLOC BVH with at most [`BLOCK_CAPACITY`] particles.
fn block_order(positions: &[DVec3]) -> (Vec<u32>, Vec<Range<usize>>) {
    let count = u32::try_from(positions.len()).unwrap_or(u32::MAX);
    if positions.len() <= BLOCK_CAPACITY {
        let all = 0..positions.len();
        let runs = if all.is_empty() {
            Vec::new()
        } else {
            vec![all]
        };
        return ((0..count).collect(), runs);
    }
    // obvhs works in f32: relative to the middle, so that a far origin costs no bits.
    let (lower, upper) = positions
        .par_iter()
        .fold(
            || (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(lower, upper), p| (lower.min(*p), upper.max(*p)),
        )
        .reduce(
            || (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |a, b| (a.0.min(b.0), a.1.max(b.1)),
        );
    let middle = (lower + upper) / 2.0;
    // Unit size, so that areas neither overflow nor vanish at the scale of some scenes.
    let scale = 1.0 / (upper - lower).max_element().max(f64::MIN_POSITIVE);
    // PLOC merges mutual nearest neighbours. Of points in one place only one pair per pass is
    // mutual (20 s for 1e5 points, and quadratic), so each is moved by a millionth.
    let jitter = |i: u32| {
        let bits = u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let axis = |shift: u32| (bits >> shift & 0xffff) as f32 / 65_536.0 - 0.5;
        Vec3A::new(axis(16), axis(32), axis(48)) * 2e-6
    };
    let points: Vec<Aabb> = (0..count)
        .into_par_iter()
        .zip(positions)
        .map(|(i, p)| Aabb::from_point(Vec3A::from(((*p - middle) * scale).as_vec3()) + jitter(i)))
        .collect();
    let bvh = PlocBuilder::with_capacity(points.len()).build(
        PlocSearchDistance::Minimum,
        &points,
        (0..count).collect(),
        SortPrecision::U64,
        0,
    );
    drop(points);

    // Particles below each node: children lie after their parents.
    let mut below = vec![0_u32; bvh.nodes.len()];
    for (i, node) in bvh.nodes.iter().enumerate().rev() {
        below[i] = if node.is_leaf() {
            node.prim_count
        } else {
            let child = node.first_index as usize;
            below[child] + below[child + 1]
        };
    }
    let mut order = Vec::with_capacity(positions.len());
    let mut runs = Vec::new();
    let mut run_start = 0;
    // A marker on the stack ends the run of the subtree below it.
    enum Visit {
        Node { index: usize, in_run: bool },
        EndRun,
    }
    let mut stack = vec![Visit::Node {
        index: 0,
        in_run: false,
    }];
    while let Some(visit) = stack.pop() {
        match visit {
            Visit::EndRun => {
                runs.push(run_start..order.len());
                run_start = order.len();
            }
            Visit::Node { index, in_run } => {
                let node = &bvh.nodes[index];
                let starts_run = !in_run && below[index] as usize <= BLOCK_CAPACITY;
                if starts_run {
                    stack.push(Visit::EndRun);
                }
                let first = node.first_index as usize;
                if node.is_leaf() {
                    let members = first..first + node.prim_count as usize;
                    order.extend_from_slice(&bvh.primitive_indices[members]);
                } else {
                    let in_run = in_run || starts_run;
                    stack.push(Visit::Node {
                        index: first + 1,
                        in_run,
                    });
                    stack.push(Visit::Node {
                        index: first,
                        in_run,
                    });
                }
            }
        }
    }
    (order, runs)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn points(n: usize, f: impl Fn(f64) -> DVec3) -> Vec<DVec3> {
        (0..n).map(|i| f(i as f64)).collect()
    }

    #[test]
    fn every_particle_lies_in_one_block_of_bounded_size() {
        let spiral = |t: f64| DVec3::new((t * 0.7).sin() * t, (t * 1.3).cos() * t, t * 0.01);
        for positions in [
            points(0, spiral),
            points(1, spiral),
            points(257, spiral),
            points(20_000, spiral),
            points(5_000, |_| DVec3::splat(3.0)),
            points(3_000, |t| DVec3::new(1e7 + t, 0.0, 0.0)),
            points(2_000, |t| DVec3::splat(t * 1e-14)),
        ] {
            let (order, runs) = block_order(&positions);
            let mut seen = vec![0; positions.len()];
            order.iter().for_each(|&i| seen[i as usize] += 1);
            assert!(seen.iter().all(|&n| n == 1));
            assert!(
                runs.iter()
                    .all(|r| !r.is_empty() && r.len() <= BLOCK_CAPACITY)
            );
            assert_eq!(
                runs.iter().map(ExactSizeIterator::len).sum::<usize>(),
                order.len()
            );
            assert!(runs.windows(2).all(|w| w[0].end == w[1].start));
        }
    }

    #[test]
    fn blocks_bound_their_particles() {
        let positions = points(3_000, |t| {
            DVec3::new(t.sin(), (t * 0.3).cos(), t * 1e-3) * 50.0
        });
        let sigmas = vec![0.1; positions.len()];
        let volume = BlockedVolume::new(PointVolume {
            particles: Particles::Isotropic { positions, sigmas },
            strength: Strength::Mass(vec![1.0; 3_000]),
            colour: Colour::Uniform([1.0; 3]),
            values: None,
            transfer_function: None,
        });
        let BlockedParticles::Isotropic { offsets, .. } = &volume.particles else {
            panic!("isotropic particles stay isotropic");
        };
        for b in &volume.blocks {
            let run = b.first as usize..(b.first + b.count) as usize;
            for o in &offsets[run] {
                assert!(Vec3::from(*o).abs().cmple(b.half_extent).all());
            }
        }
    }
}
