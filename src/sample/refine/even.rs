//! Evens out kernels of different levels side by side, in index space.
//!
//! In index space kernels are Gaussians along the indices, with deviations of the kernel width over the number
//! of parts. Where levels jump, their sum is off by .09 (rms) between neighbouring levels. Each volume is divided
//! by the sum at its centre, [`PASSES`] times, which leaves .02.

use rayon::prelude::*;

use super::levels::Extent;
use super::rule::MOST_LEVEL;

/// Number of corrections.
pub(in crate::sample) const PASSES: usize = 3;

/// Cut-off in standard deviations.
const CUTOFF: f64 = 4.0;

/// Number of parts of an index at all levels together.
const PARTS: usize = (1 << (MOST_LEVEL + 1)) - 1;

/// Marks a node that is not beside a jump.
const NONE: u32 = u32::MAX;

/// Returns the offset of a part's centre from its node.
pub(super) fn offset(level: u8, part: usize) -> f64 {
    let count = f64::from(1 << level);
    (part as f64 + 0.5) / count - 0.5
}

/// Returns the number of parts of a dual cell.
pub(super) fn part_count(level: [u8; 3]) -> usize {
    1 << level.iter().map(|&l| usize::from(l)).sum::<usize>()
}

/// Returns the indices of a part of a dual cell along each index.
pub(super) fn part(level: [u8; 3], n: usize) -> [usize; 3] {
    let [i, j, k] = level;
    [
        n & ((1 << i) - 1),
        n >> i & ((1 << j) - 1),
        n >> (i + j) & ((1 << k) - 1),
    ]
}

/// Values of Gaussians along an index: of each part of a node at each part of another.
struct Gaussians {
    reach: isize,
    values: Vec<f64>,
    /// Sum of each row over its number of parts.
    means: Vec<f64>,
}

impl Gaussians {
    fn new(kernel_width: f64, reach: isize) -> Self {
        let steps = 2 * reach.unsigned_abs() + 1;
        let parts = (0..=MOST_LEVEL).flat_map(|level| (0..1 << level).map(move |n| (level, n)));
        let parts: Vec<(u8, usize)> = parts.collect();
        let mut values = Vec::with_capacity(PARTS * PARTS * steps);
        for &(level, n) in &parts {
            for step in -reach..=reach {
                for &(other, m) in &parts {
                    let sigma = kernel_width / f64::from(1 << other);
                    let distance = offset(other, m) + step as f64 - offset(level, n);
                    let t = distance / sigma;
                    let norm = sigma * (2.0 * std::f64::consts::PI).sqrt();
                    values.push(if t.abs() < CUTOFF {
                        (-0.5 * t * t).exp() / norm
                    } else {
                        0.0
                    });
                }
            }
        }
        let rows = values.chunks(PARTS);
        let means = rows.flat_map(|row| {
            (0..=MOST_LEVEL).map(|level| {
                let parts = &row[number(level, 0)..][..1 << level];
                parts.iter().sum::<f64>() / parts.len() as f64
            })
        });
        let means = means.collect();
        Self {
            reach,
            values,
            means,
        }
    }

    /// Returns the row of values of a node some steps away at a part of a node.
    fn row(&self, level: u8, part: usize, step: isize) -> usize {
        let steps = 2 * self.reach.unsigned_abs() + 1;
        number(level, part) * steps + (step + self.reach).unsigned_abs()
    }

    /// Returns the values of the parts of a node with a level, and their mean.
    fn of(&self, row: usize, level: u8) -> (&[f64], f64) {
        let values = &self.values[row * PARTS + number(level, 0)..][..1 << level];
        let levels = usize::from(MOST_LEVEL) + 1;
        (values, self.means[row * levels + usize::from(level)])
    }
}

/// Returns the number of a part among those of an index at all levels.
fn number(level: u8, part: usize) -> usize {
    (1 << level) - 1 + part
}

/// Volumes of the parts of nodes, in index space.
pub(super) struct Volumes {
    /// First volume of each node beside a jump.
    first: Vec<u32>,
    volumes: Vec<f64>,
}

impl Volumes {
    /// Returns the volume of a part of a node with a level.
    pub(super) fn of(&self, node: usize, level: [u8; 3], part: usize) -> f64 {
        match self.first[node] {
            NONE => 1.0 / part_count(level) as f64,
            first => self.volumes[first as usize + part],
        }
    }

    /// Computes volumes under which the sum of kernels is even.
    ///
    /// - `reach`: number of nodes that kernels reach along an index.
    pub(super) fn new(
        extent: &Extent,
        levels: &[[u8; 3]],
        kernel_width: f64,
        reach: isize,
    ) -> Self {
        let is_beside = extent.beside_jumps(levels, reach);
        let mut first = vec![NONE; levels.len()];
        let mut nodes = Vec::new();
        let mut count = 0_u32;
        for n in (0..levels.len()).filter(|&n| is_beside[n]) {
            first[n] = count;
            nodes.push(n);
            count += u32::try_from(part_count(levels[n])).unwrap_or(0);
        }
        let of_node = |&n: &usize| {
            let parts = part_count(levels[n]);
            std::iter::repeat_n(1.0 / parts as f64, parts)
        };
        let mut all = Self {
            first,
            volumes: nodes.iter().flat_map(of_node).collect(),
        };
        let gaussians = Gaussians::new(kernel_width, reach);
        for _ in 0..PASSES {
            let even = |&n: &usize| {
                let parts = 0..part_count(levels[n]);
                let even =
                    |p: usize| all.of(n, levels[n], p) / all.sum(extent, levels, &gaussians, n, p);
                parts.map(even).collect::<Vec<f64>>()
            };
            let evened: Vec<Vec<f64>> = nodes.par_iter().map(even).collect();
            all.volumes = evened.concat();
        }
        all
    }

    /// Returns the sum of all kernels at the centre of a part.
    fn sum(
        &self,
        extent: &Extent,
        levels: &[[u8; 3]],
        gaussians: &Gaussians,
        node: usize,
        n: usize,
    ) -> f64 {
        let at = extent.node(node);
        let level = levels[node];
        let place = part(level, n);
        let reach = gaussians.reach;
        let mut sum = 0.0;
        for dk in -reach..=reach {
            let k = extent.held(2, at[2], dk);
            for dj in -reach..=reach {
                let j = extent.held(1, at[1], dj);
                for di in -reach..=reach {
                    let i = extent.held(0, at[0], di);
                    let other = extent.number([i, j, k]);
                    let of = levels[other];
                    let along = |a: usize, step| {
                        let row = gaussians.row(level[a], place[a], step);
                        gaussians.of(row, of[a])
                    };
                    let ((x, mean_x), (y, mean_y), (z, mean_z)) =
                        (along(0, di), along(1, dj), along(2, dk));
                    let mean = mean_x * mean_y * mean_z;
                    if mean == 0.0 || self.first[other] == NONE {
                        sum += mean;
                        continue;
                    }
                    let mut rest = &self.volumes[self.first[other] as usize..];
                    for z in z {
                        for y in y {
                            let (row, others) = rest.split_at(x.len());
                            rest = others;
                            let weight = y * z;
                            if weight > 0.0 {
                                let of_row: f64 = row.iter().zip(x).map(|(v, x)| v * x).sum();
                                sum += of_row * weight;
                            }
                        }
                    }
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the root mean square of the sum's difference from 1 at all centres.
    fn unevenness(extent: &Extent, levels: &[[u8; 3]], volumes: &Volumes) -> f64 {
        let gaussians = Gaussians::new(0.6, 2);
        let nodes = (0..levels.len()).flat_map(|n| (0..part_count(levels[n])).map(move |p| (n, p)));
        let squares: Vec<f64> = nodes
            .map(|(n, p)| (volumes.sum(extent, levels, &gaussians, n, p) - 1.0).powi(2))
            .collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    #[test]
    fn kernels_beside_jumps_are_evened_out() {
        let extent = Extent {
            dims: [12; 3],
            periods: [None; 3],
        };
        let mut levels = vec![[0; 3]; extent.len()];
        // A sloping sheet, as an iso-surface would ask for.
        for (n, level) in levels.iter_mut().enumerate() {
            let [i, j, k] = extent.node(n);
            if 2 * i + j == 16 + k % 2 {
                *level = [2, 1, 0];
            }
        }
        extent.grade(&mut levels, &vec![true; extent.len()]);
        let even = Volumes::new(&extent, &levels, 0.6, 2);
        let uneven = Volumes {
            first: vec![NONE; levels.len()],
            volumes: Vec::new(),
        };
        let (before, after) = (
            unevenness(&extent, &levels, &uneven),
            unevenness(&extent, &levels, &even),
        );
        // Levels that differ among indices leave .03 of .1; equal ones .02.
        assert!(before > 0.08 && after < 0.035, "{before} {after}");
        // The volume of the whole stays.
        let of_node = |n: usize| (0..part_count(levels[n])).map(move |p| (n, p));
        let all = (0..levels.len()).flat_map(of_node);
        let total: f64 = all.map(|(n, p)| even.of(n, levels[n], p)).sum();
        assert!((total / levels.len() as f64 - 1.0).abs() < 0.01, "{total}");
    }

    #[test]
    fn parts_fill_a_cell() {
        let level = [2, 0, 3];
        let mut seen = std::collections::HashSet::new();
        for p in 0..part_count(level) {
            let at = part(level, p);
            assert!((0..3).all(|a| at[a] < 1 << level[a]));
            seen.insert(at);
        }
        assert_eq!(seen.len(), 32);
        let sum: f64 = (0..8).map(|n| offset(3, n)).sum();
        assert!(sum.abs() < 1e-15 && (offset(0, 0)).abs() < 1e-15);
    }
}
