//! Measures dual cells a run of nodes at a time. Most cells stay whole, which these measures show at a tenth of the cost
//! of an interpolant ([`Neighbourhood`](super::neighbourhood::Neighbourhood)).

use std::ops::Range;

use glam::DVec3;

use super::levels::Extent;
use crate::sample::field::gradient::{SPANNING, Samples};
use crate::simd::{SimdLevel, SimdWork, run_at};

/// Number of nodes in a run along i.
const RUN: usize = 16;

/// Greatest numbers of rows and of planes that are read at once, so that their cells share the nodes between them.
const ROWS: usize = 16;
const MOST_PLANES: usize = 8;

/// Least share of its columns' lengths that the determinant has: gradients then have nine digits.
const SPANS_WELL: f64 = 1e3 * SPANNING;

/// A number for each node of a run.
type Lanes = [f64; RUN];

/// Measures of a dual cell, from the 3³ nodes around its own.
#[derive(Debug, Clone, Copy)]
pub(super) struct Outline {
    pub(super) position: DVec3,
    /// Distance of the farthest node around.
    pub(super) radius: f64,
    /// Least and greatest value.
    pub(super) range: [f64; 2],
    /// Length of the gradient.
    pub(super) steepness: f64,
    /// Greatest part of the value that the linear model misses at half a cell, along an index or between two.
    pub(super) missed: f64,
}

/// Returns the number of planes of a slab, so that all threads have some.
pub(super) fn planes_of_slab(extent: &Extent) -> usize {
    let each = extent.dims[2] / (4 * rayon::current_num_threads());
    each.clamp(1, MOST_PLANES)
}

/// Passes on each node of some planes with the outline of its dual cell: `None` where a node around is unknown, or where
/// the cell is almost flat.
///
/// - `planes`: at most as many as [`planes_of_slab`] returns.
/// - `each`: receives a node's number and the outline, and returns false to end; nodes come in no order.
pub(super) fn each_outline<F: Fn([usize; 3]) -> Option<(DVec3, f64)>>(
    samples: &Samples<F>,
    planes: Range<usize>,
    mut each: impl FnMut(usize, Option<Outline>) -> bool,
) {
    let [ni, nj, _] = samples.dims;
    let extent = Extent {
        dims: samples.dims,
        periods: samples.periods,
    };
    let mut nodes = vec![Row::NONE; (ROWS + 2) * (planes.len() + 2)];
    for first_j in (0..nj).step_by(ROWS) {
        let rows = first_j..nj.min(first_j + ROWS);
        for first in (0..ni).step_by(RUN) {
            let run = first..ni.min(first + RUN);
            read(samples, [&run, &rows, &planes], &mut nodes);
            for (at_k, k) in planes.clone().enumerate() {
                for (at_j, j) in rows.clone().enumerate() {
                    let around =
                        std::array::from_fn(|n| &nodes[at_j + n % 3 + (ROWS + 2) * (at_k + n / 3)]);
                    let mut found = Found::default();
                    let work = Measure {
                        around,
                        found: &mut found,
                    };
                    run_at(SimdLevel::best(), work);
                    for (n, i) in run.clone().enumerate() {
                        let outline = found.outline(n, around[4]);
                        if !each(extent.number([i, j, k]), outline) {
                            return;
                        }
                    }
                }
            }
        }
    }
}

/// Position and value of the nodes of a run, and of one more on either side; NaN where a node is unknown.
#[derive(Clone, Copy)]
struct Row([[f64; RUN + 2]; 4]);

impl Row {
    const NONE: Self = Self([[f64::NAN; RUN + 2]; 4]);

    /// Returns a component of the nodes that are `step` - 1 nodes further along i than those of the run.
    #[inline(always)]
    fn lanes(&self, component: usize, step: usize) -> &Lanes {
        let all = &self.0[component][step..];
        // A step is 2 at most.
        all.first_chunk().unwrap_or(&[f64::NAN; RUN])
    }
}

/// Reads the nodes of a run of some rows in some planes, and those around them.
fn read<F: Fn([usize; 3]) -> Option<(DVec3, f64)>>(
    samples: &Samples<F>,
    [run, rows, planes]: [&Range<usize>; 3],
    nodes: &mut [Row],
) {
    for at_k in 0..planes.len() + 2 {
        for at_j in 0..rows.len() + 2 {
            let k = samples.along(2, planes.start, at_k as isize - 1);
            let j = samples.along(1, rows.start, at_j as isize - 1);
            let row = &mut nodes[at_j + (ROWS + 2) * at_k];
            *row = Row::NONE;
            let Some((j, k)) = j.zip(k) else {
                continue;
            };
            for n in 0..run.len() + 2 {
                let i = samples.along(0, run.start, n as isize - 1);
                if let Some((position, value)) = i.and_then(|i| (samples.at)([i, j, k])) {
                    for (own, x) in row.0.iter_mut().zip(position.extend(value).to_array()) {
                        own[n] = x;
                    }
                }
            }
        }
    }
}

/// Measures of the cells of a run.
#[derive(Default)]
struct Found {
    low: Lanes,
    high: Lanes,
    /// Squared distance of the farthest node.
    far: Lanes,
    /// Sum of all values: NaN if one is unknown.
    sum: Lanes,
    /// Determinant of the Jacobian over the product of its columns' lengths.
    spans: Lanes,
    /// Squared length of the gradient.
    steep: Lanes,
    missed: Lanes,
}

impl Found {
    fn outline(&self, n: usize, own: &Row) -> Option<Outline> {
        // Phrased so that NaN counts as flat.
        let is_known = !self.sum[n].is_nan() && self.spans[n] > SPANS_WELL;
        let [x, y, z] = [0, 1, 2].map(|a| own.0[a][n + 1]);
        is_known.then(|| Outline {
            position: DVec3::new(x, y, z),
            radius: self.far[n].sqrt(),
            range: [self.low[n], self.high[n]],
            steepness: self.steep[n].sqrt(),
            missed: self.missed[n],
        })
    }
}

/// Measures the cells of a run.
struct Measure<'a> {
    /// The 3² rows around the run's own, the one before along j and k first; j is fastest.
    around: [&'a Row; 9],
    found: &'a mut Found,
}

impl SimdWork for Measure<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FMA: bool, const LANES: usize>(self) {
        let Self { around, found } = self;
        found.low = [f64::INFINITY; RUN];
        found.high = [f64::NEG_INFINITY; RUN];
        let own = [0, 1, 2, 3].map(|c| *around[4].lanes(c, 1));
        for row in around {
            for step in 0..3 {
                let [x, y, z, value] = [0, 1, 2, 3].map(|c| row.lanes(c, step));
                for n in 0..RUN {
                    let v = value[n];
                    found.sum[n] += v;
                    found.low[n] = if v < found.low[n] { v } else { found.low[n] };
                    found.high[n] = if v > found.high[n] { v } else { found.high[n] };
                    let [dx, dy, dz] = [x[n] - own[0][n], y[n] - own[1][n], z[n] - own[2][n]];
                    let far = dx * dx + dy * dy + dz * dz;
                    found.far[n] = if far > found.far[n] {
                        far
                    } else {
                        found.far[n]
                    };
                }
            }
        }
        let columns = [0, 1, 2].map(|axis| {
            let [below, above] = [-1, 1].map(|by| differences(&around, &own, along(axis, by)));
            combined(&below, &above, -0.5, 0.5)
        });
        let gradient = gradients(&columns, found);
        found.missed = [0.0; RUN];
        let mut add = |d: &[Lanes; 4], scale: f64| {
            for n in 0..RUN {
                let [x, y, z] = [0, 1, 2].map(|c| gradient[c][n] * d[c][n]);
                let missed = (d[3][n] - (x + y + z)).abs() * scale;
                let most = found.missed[n];
                found.missed[n] = if missed > most || missed.is_nan() {
                    missed
                } else {
                    most
                };
            }
        };
        for axis in 0..3 {
            let [below, above] = [-1, 1].map(|by| differences(&around, &own, along(axis, by)));
            add(&combined(&below, &above, 1.0, 1.0), 0.25);
        }
        for [a, b] in [[0, 1], [0, 2], [1, 2]] {
            for [s, t] in [[-1, -1], [1, -1], [-1, 1], [1, 1]] {
                let [by_a, by_b] = [along(a, s), along(b, t)];
                let both = std::array::from_fn(|d| by_a[d] + by_b[d]);
                let [of_a, of_b, corner] =
                    [by_a, by_b, both].map(|steps| differences(&around, &own, steps));
                let sides = combined(&of_a, &of_b, 1.0, 1.0);
                add(&combined(&corner, &sides, 1.0, -1.0), 0.25);
            }
        }
    }
}

/// Returns steps along one axis.
fn along(axis: usize, by: isize) -> [isize; 3] {
    let mut steps = [0; 3];
    steps[axis] = by;
    steps
}

/// Returns the differences of position and value to the nodes some steps away.
#[inline(always)]
fn differences(around: &[&Row; 9], own: &[Lanes; 4], [i, j, k]: [isize; 3]) -> [Lanes; 4] {
    let row = around[(4 + j + 3 * k).unsigned_abs()];
    let mut found = *own;
    for (c, found) in found.iter_mut().enumerate() {
        let lanes = row.lanes(c, (1 + i).unsigned_abs());
        for n in 0..RUN {
            found[n] = lanes[n] - found[n];
        }
    }
    found
}

#[inline(always)]
fn combined(a: &[Lanes; 4], b: &[Lanes; 4], of_a: f64, of_b: f64) -> [Lanes; 4] {
    let mut sum = *a;
    for (sum, b) in sum.iter_mut().zip(b) {
        for n in 0..RUN {
            sum[n] = of_a * sum[n] + of_b * b[n];
        }
    }
    sum
}

/// Returns the gradients by position; sets their lengths, and how well the columns of the Jacobian span space.
///
/// - `columns`: derivatives of position and value by each index.
#[inline(always)]
fn gradients(columns: &[[Lanes; 4]; 3], found: &mut Found) -> [Lanes; 3] {
    let mut gradient = [[0.0; RUN]; 3];
    for n in 0..RUN {
        let column = |a: usize| [0, 1, 2].map(|c| columns[a][c][n]);
        let [i, j, k] = [column(0), column(1), column(2)];
        let normals = [cross(j, k), cross(k, i), cross(i, j)];
        let determinant = dot(i, normals[0]);
        let lengths = dot(i, i) * dot(j, j) * dot(k, k);
        found.spans[n] = determinant.abs() / lengths.sqrt();
        let mut squared = 0.0;
        for c in 0..3 {
            let rises = [0, 1, 2].map(|a| columns[a][3][n] * normals[a][c]);
            gradient[c][n] = (rises[0] + rises[1] + rises[2]) / determinant;
            squared += gradient[c][n] * gradient[c][n];
        }
        found.steep[n] = squared;
    }
    gradient
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| {
        let [d, e] = [(c + 1) % 3, (c + 2) % 3];
        a[d] * b[e] - a[e] * b[d]
    })
}

#[cfg(test)]
mod tests {
    use glam::{DVec4, Vec4Swizzles as _};

    use super::*;
    use crate::sample::refine::neighbourhood::Neighbourhood;
    use crate::sample::refine::rule::{Rule, ShownValues};
    use crate::scene::TransferFunction;

    #[test]
    fn outlines_are_those_of_neighbourhoods() {
        let dims = [21, 11, 7];
        let noise = |n: usize, d: usize| ((n * (d + 3)) as f64 * 1.7).sin();
        let rule = |width: f32| {
            let hat = move |v: f32| (1.0 - (v - 0.5).abs() / width).max(0.0) * 0.5;
            let function = TransferFunction::from_curves(|_| [1.0; 3], hat, [-3.0, 5.0], 1.0);
            Rule::new(&ShownValues::of_function(&function.unwrap()), 1.0, 0.6)
        };
        let rules =
            [0.1, 1.0, 10.0, 1e3].map(|px| [0.1, 3.0, 100.0].map(|width| (rule(width), px)));
        let rules = rules.into_iter().flatten().collect::<Vec<_>>();
        let mut whole = [0; 2];
        for periods in [[None; 3], [Some(20), None, None], [None, Some(10), None]] {
            let samples = Samples {
                dims,
                periods,
                at: |[i, j, k]: [usize; 3]| {
                    let n = i + dims[0] * (j + dims[1] * k);
                    let shift = DVec3::new(noise(n, 0), noise(n, 1), noise(n, 2)) * 0.2;
                    let place = DVec3::new(1e4 + i as f64, 2.0 * j as f64, 0.5 * k as f64) + shift;
                    // One node is unknown.
                    (n != 800).then_some((place, noise(n, 3) + 0.1 * place.y))
                },
            };
            let extent = Extent { dims, periods };
            let mut visits = vec![0; extent.len()];
            let mut known = 0;
            for first in (0..dims[2]).step_by(3) {
                let planes = first..dims[2].min(first + 3);
                each_outline(&samples, planes, |n, outline| {
                    visits[n] += 1;
                    let node = extent.node(n);
                    if (0..3).any(|a| periods[a] == Some(node[a])) {
                        // The last plane of a closed index stands for the first.
                        return true;
                    }
                    let cell = Neighbourhood::new(&samples, node);
                    // Jittered cells are far from flat.
                    if let (Some(outline), Some(cell)) = (outline, &cell) {
                        known += 1;
                        assert_eq!(outline.position, cell.position());
                        assert_eq!(outline.range, cell.range);
                        assert!((outline.radius / cell.radius() - 1.0).abs() < 1e-12);
                        let (gradient, _) = cell.place([None; 3]).derivatives().unwrap();
                        let missed = |d: DVec4| (d.w - gradient.dot(d.xyz())).abs();
                        let kinks = (0..3).map(|a| missed(cell.second(a)) / 4.0);
                        let twists = [[0, 1], [0, 2], [1, 2]].map(|of| cell.mixed(of).map(missed));
                        let missed = kinks.chain(twists.into_iter().flatten());
                        let missed = missed.fold(0.0, f64::max);
                        // Digits of positions and of gradients.
                        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
                        assert!(near(outline.missed, missed), "{outline:?} {missed}");
                        assert!(near(outline.steepness, gradient.length()));
                        for (rule, px) in &rules {
                            let is_whole = rule.levels(cell, *px, [false; 3]) == [0; 3];
                            let stays = rule.keeps_whole(&outline, *px);
                            assert!(is_whole || !stays, "{node:?} {px}");
                            whole[usize::from(stays)] += 1;
                        }
                    } else {
                        assert!(outline.is_none() && cell.is_none(), "{node:?}");
                    }
                    true
                });
            }
            assert!(visits.iter().all(|&count| count == 1));
            assert!(known > 19 * 9 * 5 - 30, "{known}");
            assert!(whole.iter().all(|&count| count > 500), "{whole:?}");
        }
    }
}
