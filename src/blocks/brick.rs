//! Blocks of a lattice: bricks of neighbouring cells. Positions, shapes and volumes follow from
//! indices, so that a voxel costs its value and a share of its brick.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::{Block, EMPTY_RANGE, value_range};
use crate::constants::BRICK;
use crate::math::Factor;
use crate::scene::{Lattice, LatticeSpacing, Values, cell_width};

/// A lattice cut into bricks of [`BRICK`] cells.
#[derive(Debug, Clone)]
pub struct BrickGrid {
    lattice: Lattice,
    kernel_width: f64,
    bricks: [usize; 3],
    cells: Cells,
}

/// What cells within a brick follow from.
#[derive(Debug, Clone)]
enum Cells {
    /// Columns: the step between neighbours along each index, world units.
    Uniform(Mat3),
    /// The samples of each axis.
    Rectilinear([Vec<AxisSample>; 3]),
}

/// A sample of a rectilinear lattice's axis as bricks see it, world units.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct AxisSample {
    /// Its coordinate relative to the middle of its brick: subtracted in f64.
    pub offset: f32,
    /// The width of its cell.
    pub width: f32,
}

impl BrickGrid {
    /// Cuts a lattice into bricks.
    pub(super) fn new(lattice: Lattice, kernel_width: f64) -> Self {
        let bricks = [0, 1, 2].map(|a| lattice.dims[a].div_ceil(BRICK[a]));
        let cells = match &lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => Cells::Uniform(step.as_mat3()),
            LatticeSpacing::Rectilinear { coordinates } => {
                Cells::Rectilinear([0, 1, 2].map(|a| axis_samples(&coordinates[a], BRICK[a])))
            }
        };
        Self {
            lattice,
            kernel_width,
            bricks,
            cells,
        }
    }

    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Standard deviation over spacing.
    pub fn kernel_width(&self) -> f64 {
        self.kernel_width
    }

    /// Bricks along each axis.
    pub fn bricks(&self) -> [usize; 3] {
        self.bricks
    }

    /// The samples of each axis: none for a uniform lattice.
    pub fn axes(&self) -> Option<&[Vec<AxisSample>; 3]> {
        match &self.cells {
            Cells::Uniform(_) => None,
            Cells::Rectilinear(axes) => Some(axes),
        }
    }

    /// The step between neighbouring cells along each index, as columns, world units: none for a
    /// rectilinear lattice.
    pub fn step(&self) -> Option<Mat3> {
        match self.cells {
            Cells::Uniform(step) => Some(step),
            Cells::Rectilinear(_) => None,
        }
    }

    /// First cell and one past the last cell of a brick along each axis.
    #[inline]
    pub fn cells(&self, brick: u32) -> [[usize; 2]; 3] {
        let b = brick as usize;
        let [bx, by, _] = self.bricks;
        let at = [b % bx, b / bx % by, b / (bx * by)];
        [0, 1, 2].map(|a| {
            let first = at[a] * BRICK[a];
            [first, (first + BRICK[a]).min(self.lattice.dims[a])]
        })
    }

    /// Index of a cell in the lattice's order.
    #[inline]
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.lattice.dims[0] * (j + self.lattice.dims[1] * k)
    }

    /// Cell `local` of the brick whose first cell is `corner`.
    #[inline]
    pub fn cell(corner: [usize; 3], local: u32) -> [usize; 3] {
        let l = local as usize;
        [
            corner[0] + l % BRICK[0],
            corner[1] + l / BRICK[0] % BRICK[1],
            corner[2] + l / (BRICK[0] * BRICK[1]),
        ]
    }

    /// The inverse of [`BrickGrid::cell`].
    #[inline]
    pub fn local(corner: [usize; 3], cell: [usize; 3]) -> u32 {
        let [x, y, z] = [0, 1, 2].map(|a| cell[a] - corner[a]);
        (x + BRICK[0] * (y + BRICK[1] * z)) as u32
    }

    /// Position of a cell of the brick of `cells` relative to the brick's middle, which is its
    /// block's origin; world units.
    ///
    /// In f32, without a position: half integers times the step err by three roundings of half a
    /// brick, wherever the lattice lies. Twin: `shaders/shared/particles_lattice.wgsl`.
    #[inline]
    pub fn offset(&self, cells: [[usize; 2]; 3], [i, j, k]: [usize; 3]) -> Vec3 {
        let from_middle = |cell: usize, [first, end]: [usize; 2]| {
            (cell - first) as f32 - 0.5 * (end - first - 1) as f32
        };
        match &self.cells {
            Cells::Uniform(step) => {
                *step
                    * Vec3::new(
                        from_middle(i, cells[0]),
                        from_middle(j, cells[1]),
                        from_middle(k, cells[2]),
                    )
            }
            Cells::Rectilinear([x, y, z]) => Vec3::new(x[i].offset, y[j].offset, z[k].offset),
        }
    }

    /// The factor that all kernels share: none for a rectilinear lattice.
    pub fn shared_factor(&self) -> Option<Mat3> {
        match &self.lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => Some((*step * self.kernel_width).as_mat3()),
            LatticeSpacing::Rectilinear { .. } => None,
        }
    }

    /// Rotated factor of a rectilinear lattice's cell.
    #[inline]
    pub fn cell_factor(&self, rotation: &Mat3, cell: [usize; 3]) -> Factor {
        let w = self.cell_width(cell) * self.kernel_width as f32;
        Factor::from_matrix(*rotation * Mat3::from_diagonal(w))
    }

    /// The volume that all cells share, world units cubed: none for a rectilinear lattice.
    pub fn uniform_volume(&self) -> Option<f32> {
        match &self.lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => Some(step.determinant().abs() as f32),
            LatticeSpacing::Rectilinear { .. } => None,
        }
    }

    /// Volume of a rectilinear lattice's cell, world units cubed.
    #[inline]
    pub fn cell_volume(&self, cell: [usize; 3]) -> f32 {
        self.cell_width(cell).element_product()
    }

    /// Volume of a cell of any lattice, world units cubed, in f64: cubes of lengths beyond 1e13
    /// or below 1e-13 leave f32.
    #[inline]
    pub fn cell_volume_f64(&self, cell: [usize; 3]) -> f64 {
        match &self.lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => step.determinant().abs(),
            LatticeSpacing::Rectilinear { .. } => {
                self.cell_width(cell).as_dvec3().element_product()
            }
        }
    }

    #[inline]
    fn cell_width(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        self.axes().map_or(Vec3::ONE, |[x, y, z]| {
            Vec3::new(x[i].width, y[j].width, z[k].width)
        })
    }

    /// One block per brick.
    pub(super) fn blocks(&self, values: Option<&Values>) -> Vec<Block> {
        let count: usize = self.bricks.iter().product();
        let uniform_sigma = self.shared_factor().map(|m| {
            let columns = [m.x_axis, m.y_axis, m.z_axis];
            columns
                .iter()
                .map(|c| c.length_squared())
                .sum::<f32>()
                .sqrt()
        });
        let block = |brick: u32| {
            let cells = self.cells(brick);
            let [x, y, z] = cells;
            let lower = self.lattice.position([x[0], y[0], z[0]]);
            let upper = self.lattice.position([x[1] - 1, y[1] - 1, z[1] - 1]);
            // A sheared lattice's bricks are bounded by the sum of their edges.
            let half_extent = match &self.lattice.spacing {
                LatticeSpacing::Uniform { step, .. } => cells
                    .iter()
                    .zip([step.x_axis, step.y_axis, step.z_axis])
                    .map(|([first, end], s)| s.abs() * ((end - 1 - first) as f64 / 2.0))
                    .sum::<DVec3>()
                    .as_vec3(),
                LatticeSpacing::Rectilinear { .. } => ((upper - lower) / 2.0).as_vec3().abs(),
            };
            let max_sigma = uniform_sigma.unwrap_or_else(|| {
                let widest = self.axes().map_or(0.0, |axes| {
                    (0..3)
                        .flat_map(|a| &axes[a][cells[a][0]..cells[a][1]])
                        .map(|sample| sample.width)
                        .fold(0.0, f32::max)
                });
                widest * self.kernel_width as f32
            });
            let value_range = values.map_or(EMPTY_RANGE, |v| self.brick_range(v, cells));
            Block {
                origin: (lower + upper) / 2.0,
                half_extent: half_extent * (1.0 + f32::EPSILON),
                max_sigma,
                first: brick,
                count: cells.iter().map(|[a, b]| (b - a) as u32).product(),
                value_range,
            }
        };
        (0..u32::try_from(count).unwrap_or(u32::MAX))
            .into_par_iter()
            .with_min_len(64)
            .map(block)
            .collect()
    }

    fn brick_range(&self, values: &Values, [x, y, z]: [[usize; 2]; 3]) -> [f32; 2] {
        let rows = (z[0]..z[1]).flat_map(|k| (y[0]..y[1]).map(move |j| (j, k)));
        let mut range = EMPTY_RANGE;
        for (j, k) in rows {
            let first = self.index([x[0], j, k]);
            let row = first..first + (x[1] - x[0]);
            let [lo, hi] = match values {
                Values::U8(v) => value_range(v[row].iter().map(|&v| f32::from(v))),
                Values::I16(v) => value_range(v[row].iter().map(|&v| f32::from(v))),
                Values::U16(v) => value_range(v[row].iter().map(|&v| f32::from(v))),
                Values::F32(v) => value_range(v[row].iter().copied()),
            };
            range = [range[0].min(lo), range[1].max(hi)];
        }
        range
    }
}

/// The samples of an axis that is cut into bricks of `brick` cells.
fn axis_samples(axis: &[f64], brick: usize) -> Vec<AxisSample> {
    (0..axis.len())
        .map(|i| {
            let first = i / brick * brick;
            let last = (first + brick).min(axis.len()) - 1;
            // The block's origin along this axis, as `BrickGrid::blocks` finds it.
            let middle = (axis[first] + axis[last]) / 2.0;
            AxisSample {
                offset: (axis[i] - middle) as f32,
                width: cell_width(axis, i) as f32,
            }
        })
        .collect()
}
