//! Makes the blocks of a lattice: the bounds of each brick and of its values.

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::block::{Block, EMPTY_RANGE, NO_PARENT, value_range};
use super::brick::{AxisMoments, AxisSample, BrickGrid, sigma_range};
use super::halo::Halo;
use super::merged::MergeBounds;
use crate::scene::{LatticeSpacing, Shared, ValuesIn};

impl BrickGrid {
    /// Makes one block for each brick, of level of detail `level`.
    ///
    /// - `is_classified`: whether a transfer function makes masses of the values.
    pub(super) fn blocks(
        &self,
        values: Option<&ValuesIn<Shared>>,
        is_classified: bool,
        level: u32,
    ) -> Vec<Block> {
        let count: usize = self.bricks().iter().product();
        let all = 0..u32::try_from(count).unwrap_or(u32::MAX);
        self.blocks_of(all, values, is_classified, level)
    }

    /// Makes the blocks of some bricks.
    pub(super) fn blocks_of(
        &self,
        bricks: Range<u32>,
        values: Option<&ValuesIn<Shared>>,
        is_classified: bool,
        level: u32,
    ) -> Vec<Block> {
        let shared = self.shared_factor().map(|m| sigma_range(&m.as_dmat3()));
        let block = |brick: u32| {
            let cells = self.cells(brick);
            // The lattice's own cells bound the cells merged from them.
            let [x, y, z] = [0, 1, 2].map(|a| {
                let [first, end] = cells[a].map(|cell| cell * self.cells_per_edge());
                [first, end.min(self.lattice().dims[a])]
            });
            let lower = self.lattice().position([x[0], y[0], z[0]]);
            let upper = self.lattice().position([x[1] - 1, y[1] - 1, z[1] - 1]);
            // A sheared lattice's bricks are bounded by the sum of their edges.
            let half_extent = match &self.lattice().spacing {
                LatticeSpacing::Uniform { step, .. } => [x, y, z]
                    .iter()
                    .zip([step.x_axis, step.y_axis, step.z_axis])
                    .map(|([first, end], s)| s.abs() * ((end - 1 - first) as f64 / 2.0))
                    .sum::<DVec3>()
                    .as_vec3(),
                LatticeSpacing::Rectilinear { .. } => ((upper - lower) / 2.0).as_vec3().abs(),
            };
            let [min_sigma, max_sigma] = shared.unwrap_or_else(|| self.brick_sigmas(cells));
            let (values_around, greatest_spread) = match values {
                Some(values) if is_classified => self.spread(values, cells),
                _ => (EMPTY_RANGE, 0.0),
            };
            Block {
                origin: (lower + upper) / 2.0,
                half_extent: half_extent * (1.0 + f32::EPSILON),
                max_sigma,
                min_sigma,
                max_strength: self
                    .uniform_volume()
                    .unwrap_or_else(|| self.greatest_volume(cells)),
                first: brick,
                count: cells.iter().map(|[a, b]| (b - a) as u32).product(),
                value_range: values.map_or(EMPTY_RANGE, |v| self.brick_range(v, cells)),
                values_around,
                greatest_spread,
                parent: NO_PARENT,
                level,
                crowding: 1.0,
            }
        };
        bricks.into_par_iter().with_min_len(64).map(block).collect()
    }

    /// Returns the range of all values that classification over a brick's kernel extents may need, and the greatest
    /// spread w of its kernels.
    fn spread(&self, values: &ValuesIn<Shared>, cells: [[usize; 2]; 3]) -> ([f32; 2], f32) {
        let halo = Halo::new(self, values, cells);
        let ranges = halo.ranges();
        let corner = cells.map(|[first, _]| first);
        let counts = cells.map(|[first, end]| end - first);
        let (mut around, mut steepest) = (EMPTY_RANGE, 0.0_f32);
        for n in 0..counts.iter().product::<usize>() {
            let own = [
                n % counts[0],
                n / counts[0] % counts[1],
                n / (counts[0] * counts[1]),
            ];
            let value = halo.value(own);
            if value.is_nan() {
                continue;
            }
            let cell = [0, 1, 2].map(|a| corner[a] + own[a]);
            let model = halo.model(own, self.kernel_width() as f32, self.bends(cell));
            let local = Self::local([0; 3], own) as usize;
            let range = [ranges.least[local], ranges.greatest[local]];
            let [lo, hi] = model.reached(value, range);
            around = [around[0].min(lo), around[1].max(hi)];
            steepest = steepest.max(model.slope.length());
        }
        (around, steepest)
    }

    /// Returns bounds on the difference between the cells of a brick and the lattice's own cells in them, apart from
    /// values.
    ///
    /// - `moments`: the moments of [`BrickGrid::axis_moments`].
    pub(super) fn merge_bounds(
        &self,
        moments: &[Vec<AxisMoments>; 3],
        cells: [[usize; 2]; 3],
    ) -> MergeBounds {
        let add = |a: f64, b: f64| {
            if self.is_orthogonal() {
                a.hypot(b)
            } else {
                a + b
            }
        };
        let (mut third, mut fourth, mut second) = (0.0, 0.0, 0.0);
        for (a, [first, end]) in cells.into_iter().enumerate() {
            let length = match &self.lattice().spacing {
                LatticeSpacing::Uniform { step, .. } => step.col(a).length(),
                LatticeSpacing::Rectilinear { .. } => 1.0,
            };
            let mut widest = [0.0_f64; 3];
            for m in &moments[a][first..end] {
                let own = [m.variance - m.narrowest, m.third.abs(), m.fourth.abs()];
                widest = [0, 1, 2].map(|i| widest[i].max(own[i]));
            }
            second += widest[0] * length.powi(2);
            // The moments of the axes are independent. A tensor's norm is the root of their squares if the axes are at
            // right angles, and at most their sum otherwise.
            let own = [widest[1] * length.powi(3), widest[2] * length.powi(4)];
            third = add(third, own[0]);
            fourth = add(fourth, own[1]);
        }
        MergeBounds {
            third_mean: third.cbrt() as f32,
            third: third.cbrt() as f32,
            fourth: fourth.sqrt().sqrt() as f32,
            second: second.sqrt() as f32,
            ..MergeBounds::default()
        }
    }

    /// Whether the axes are at right angles.
    fn is_orthogonal(&self) -> bool {
        match &self.lattice().spacing {
            LatticeSpacing::Rectilinear { .. } => true,
            LatticeSpacing::Uniform { step, .. } => {
                let [x, y, z] = [0, 1, 2].map(|a| step.col(a).normalize_or_zero());
                let cosines = [x.dot(y), y.dot(z), z.dot(x)];
                cosines.into_iter().all(|cosine| cosine.abs() < 1e-6)
            }
        }
    }

    /// Returns the samples of a brick along each axis.
    fn samples(&self, cells: [[usize; 2]; 3]) -> impl Iterator<Item = &[AxisSample]> {
        let axes = self.axes().into_iter().flatten();
        axes.zip(cells)
            .map(|(axis, [first, end])| &axis[first..end])
    }

    /// Returns bounds on the standard deviations of a brick's kernels.
    fn brick_sigmas(&self, cells: [[usize; 2]; 3]) -> [f32; 2] {
        let mut bounds = [DVec3::INFINITY, DVec3::ZERO];
        for (a, samples) in self.samples(cells).enumerate() {
            for sample in samples {
                bounds[0][a] = bounds[0][a].min(f64::from(sample.sigma));
                bounds[1][a] = bounds[1][a].max(f64::from(sample.sigma));
            }
        }
        // Singular values grow with the factor's columns.
        let basis = self.basis().as_dmat3();
        let [least, greatest] = bounds.map(|s| sigma_range(&(basis * DMat3::from_diagonal(s))));
        [least[0], greatest[1]]
    }

    fn greatest_volume(&self, cells: [[usize; 2]; 3]) -> f32 {
        let greatest = |samples: &[AxisSample]| {
            let extents = samples.iter().map(|sample| sample.extent);
            extents.fold(0.0, f32::max)
        };
        self.samples(cells).map(greatest).product()
    }

    fn brick_range(&self, values: &ValuesIn<Shared>, [x, y, z]: [[usize; 2]; 3]) -> [f32; 2] {
        let rows = (z[0]..z[1]).flat_map(|k| (y[0]..y[1]).map(move |j| (j, k)));
        let mut range = EMPTY_RANGE;
        for (j, k) in rows {
            let first = self.index([x[0], j, k]);
            let row = first..first + (x[1] - x[0]);
            let [lo, hi] = match values {
                ValuesIn::U8(v) => value_range(v[row].iter().map(|&v| f32::from(v))),
                ValuesIn::I16(v) => value_range(v[row].iter().map(|&v| f32::from(v))),
                ValuesIn::U16(v) => value_range(v[row].iter().map(|&v| f32::from(v))),
                ValuesIn::F32(v) => value_range(v[row].iter().copied()),
                ValuesIn::F64(_) => value_range(row.map(|i| values.get(i))),
            };
            range = [range[0].min(lo), range[1].max(hi)];
        }
        range
    }
}
