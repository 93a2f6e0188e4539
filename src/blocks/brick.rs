//! Cuts a lattice into bricks of neighbouring cells, which are its blocks. Positions, shapes and volumes follow from
//! indices: a voxel costs its value and a share of its brick.
//!
//! A grid is the lattice itself or, for level of detail, a coarser grid whose cells are cubes of the lattice's cells.
//! The mean and variance of a cube's kernels follow from indices as well.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3, Mat3, Vec3};

use crate::constants::{BRICK, EDGE_REACH, MOST_EDGES};
use crate::math::{Factor, Truncated, lower_factor, principal_sigmas};
use crate::scene::{Lattice, LatticeSpacing, NO_EDGE, cell_width};

/// A lattice cut into bricks of [`BRICK`] cells.
#[derive(Debug, Clone)]
pub struct BrickGrid {
    lattice: Lattice,
    /// Cells of the lattice along each edge of a cell of the grid.
    merged: usize,
    dims: [usize; 3],
    kernel_width: f64,
    bricks: [usize; 3],
    /// Units of the axes in the world, as columns; for a uniform lattice, the step from one cell to the next along each
    /// index.
    basis: Mat3,
    cells: Cells,
    faces: Option<Faces>,
}

/// Faces of the box of a lattice's own samples. The grid has a layer of ghosts around that box.
#[derive(Debug, Clone)]
pub struct Faces {
    /// Ghosts before the first sample along each axis, and as many behind the last.
    ghosts: [usize; 3],
    /// Unit normals of the lower faces, into the box; the normals of the upper faces are opposite.
    pub normals: [Vec3; 3],
    /// Distance of each cell along each axis inside the lower and the upper face, world units; infinite if the face
    /// does not reach the cell's kernel.
    pub distances: [Vec<[f32; 2]>; 3],
}

impl Faces {
    /// Finds the faces of a lattice that already has a layer of ghosts around its own samples.
    fn new(wide: &Lattice, ghosts: [usize; 3], kernel_width: f64) -> Self {
        let normal = |a: usize| match &wide.spacing {
            LatticeSpacing::Uniform { step, .. } => {
                let normal = step.col((a + 1) % 3).cross(step.col((a + 2) % 3));
                let normal = normal.normalize_or_zero();
                normal * step.col(a).dot(normal).signum()
            }
            LatticeSpacing::Rectilinear { .. } => DVec3::AXES[a],
        };
        let normals = [0, 1, 2].map(normal);
        let distances = [0, 1, 2].map(|a| {
            let Axis {
                coordinates,
                widths,
            } = Axis::new(wide, a);
            let unit = match &wide.spacing {
                LatticeSpacing::Uniform { step, .. } => step.col(a).dot(normals[a]),
                LatticeSpacing::Rectilinear { .. } => 1.0,
            };
            let count = coordinates.len();
            let inside = |i: usize, face: f64, sign: f64| {
                let distance = sign * (coordinates[i] - face) * unit;
                let reach = f64::from(EDGE_REACH) * kernel_width * widths[i] * unit;
                if ghosts[a] > 0 && distance < reach {
                    distance as f32
                } else {
                    f32::INFINITY
                }
            };
            let faces = [ghosts[a], count - 1 - ghosts[a]].map(|i| coordinates[i]);
            (0..count)
                .map(|i| [inside(i, faces[0], 1.0), inside(i, faces[1], -1.0)])
                .collect()
        });
        Self {
            ghosts,
            normals: normals.map(|n| n.as_vec3()),
            distances,
        }
    }

    /// Ghosts before the first sample along each axis, and as many behind the last.
    pub(crate) fn ghosts(&self) -> [usize; 3] {
        self.ghosts
    }
}

/// Data from which the cells of a brick follow.
#[derive(Debug, Clone)]
enum Cells {
    /// All cells are alike, a unit of each axis apart.
    Uniform,
    /// The samples of each axis.
    Axes([Vec<AxisSample>; 3]),
}

/// A sample of a grid's axis, in units of the grid's basis.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct AxisSample {
    /// Coordinate relative to the middle of the brick: subtracted in f64.
    pub offset: f32,
    /// Standard deviation of the kernel along the axis.
    pub sigma: f32,
    /// Factor of the cell's volume \[world units\]: the volume is the product over the axes.
    pub extent: f32,
    /// Change of the spacing: (x+ - 2 x + x-) / (x+ - x-) of the sample and its neighbours. 0 if the spacing is even,
    /// at the ends, and for merged cells.
    pub bend: f32,
}

impl BrickGrid {
    /// Cuts a lattice into bricks.
    pub(super) fn new(lattice: Lattice, kernel_width: f64) -> Self {
        Self::of_cubes(lattice, kernel_width, 1, |axis, a| {
            axis.samples(kernel_width, BRICK[a])
        })
    }

    /// Returns the grid whose cells are cubes of `merged` cells along each edge. If faces cut the kernels, the cubes
    /// merge the cut kernels.
    pub(crate) fn merged(&self, merged: usize) -> Self {
        let kernels = self.axis_kernels();
        let lattice = self.lattice.clone();
        Self::of_cubes(lattice, self.kernel_width, merged, |axis, a| {
            axis.merged_samples(&kernels[a], merged, BRICK[a])
        })
    }

    /// Returns the kernels of the lattice's own samples along each axis, cut by the faces; in units of the grid's
    /// basis.
    fn axis_kernels(&self) -> [Vec<AxisKernel>; 3] {
        let ghosts = self.faces.as_ref().map_or([0; 3], |faces| faces.ghosts);
        [0, 1, 2].map(|a| Axis::new(&self.lattice, a).kernels(self.kernel_width, ghosts[a]))
    }

    /// Makes a grid whose cells are cubes of `merged` cells of a lattice.
    ///
    /// - `samples`: returns the samples of an axis.
    fn of_cubes(
        lattice: Lattice,
        kernel_width: f64,
        merged: usize,
        samples: impl Fn(&Axis, usize) -> Vec<AxisSample>,
    ) -> Self {
        let dims = lattice.dims.map(|n| n.div_ceil(merged));
        let bricks = [0, 1, 2].map(|a| dims[a].div_ceil(BRICK[a]));
        let (basis, volume) = match &lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => (*step, step.determinant().abs() as f32),
            LatticeSpacing::Rectilinear { .. } => (DMat3::IDENTITY, 1.0),
        };
        let cells = match &lattice.spacing {
            LatticeSpacing::Uniform { .. } if merged == 1 => Cells::Uniform,
            _ => {
                let mut axes = [0, 1, 2].map(|a| samples(&Axis::new(&lattice, a), a));
                for sample in &mut axes[0] {
                    sample.extent *= volume;
                }
                Cells::Axes(axes)
            }
        };
        Self {
            lattice,
            merged,
            dims,
            kernel_width,
            bricks,
            basis: basis.as_mat3(),
            cells,
            faces: None,
        }
    }

    /// Adds a layer of ghosts around the lattice's own samples, and cuts the kernels at the box of these samples.
    pub(super) fn with_faces(lattice: &Lattice, kernel_width: f64) -> Self {
        Self::of_wide(lattice.with_ghosts(), kernel_width, Some(lattice.ghosts()))
    }

    /// Makes the grid of a lattice that already has its ghosts, if any.
    ///
    /// - `ghosts`: number of ghosts before the first sample along each axis, if faces cut kernels.
    pub(crate) fn of_wide(lattice: Lattice, kernel_width: f64, ghosts: Option<[usize; 3]>) -> Self {
        Self {
            faces: ghosts.map(|ghosts| Faces::new(&lattice, ghosts, kernel_width)),
            ..Self::new(lattice, kernel_width)
        }
    }

    /// Cells of the lattice along each edge of a cell of the grid.
    pub(crate) fn cells_per_edge(&self) -> usize {
        self.merged
    }

    /// Whether faces of the box of its samples cut kernels.
    pub fn has_faces(&self) -> bool {
        self.faces.is_some()
    }

    /// Faces that cut kernels, if any do.
    pub fn faces(&self) -> Option<&Faces> {
        self.faces.as_ref()
    }

    /// Returns the faces that may cut a cell's kernel: for each axis the lower one, then the upper one.
    #[inline]
    pub fn edges(&self, cell: [usize; 3]) -> [[f32; 4]; MOST_EDGES] {
        let mut edges = [NO_EDGE; MOST_EDGES];
        if let Some(faces) = &self.faces {
            for a in 0..3 {
                let [lower, upper] = faces.distances[a][cell[a]];
                edges[2 * a] = faces.normals[a].extend(lower).into();
                edges[2 * a + 1] = (-faces.normals[a]).extend(upper).into();
            }
        }
        edges
    }

    /// Returns the least and the greatest corner of the box at whose faces kernels are cut, if they are.
    pub(super) fn domain(&self) -> Option<[DVec3; 2]> {
        let faces = self.faces.as_ref()?;
        let ends = [0, 1, 2].map(|a| [faces.ghosts[a], self.dims[a] - 1 - faces.ghosts[a]]);
        let corners = (0..8_usize).map(|c| {
            self.lattice
                .position([0, 1, 2].map(|a: usize| ends[a][c >> a & 1]))
        });
        Some(
            corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[lo, hi], p| {
                [lo.min(p), hi.max(p)]
            }),
        )
    }

    /// Returns the index of the lattice's own sample that a cell shows; for a ghost, that of the nearest sample.
    pub(super) fn own_index(&self, index: usize) -> usize {
        let Some(faces) = &self.faces else {
            return index;
        };
        let [nx, ny, _] = self.dims;
        let cell = [index % nx, index / nx % ny, index / (nx * ny)];
        let own = [0, 1, 2].map(|a| self.dims[a] - 2 * faces.ghosts[a]);
        let [i, j, k] = [0, 1, 2].map(|a| cell[a].saturating_sub(faces.ghosts[a]).min(own[a] - 1));
        i + own[0] * (j + own[1] * k)
    }

    /// Cells of the grid along each axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Sample points at which the cells lie.
    pub(crate) fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Whether the grid has no cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bricks along each axis.
    pub fn bricks(&self) -> [usize; 3] {
        self.bricks
    }

    /// Samples of each axis; `None` if all cells are alike.
    pub fn axes(&self) -> Option<&[Vec<AxisSample>; 3]> {
        match &self.cells {
            Cells::Uniform => None,
            Cells::Axes(axes) => Some(axes),
        }
    }

    /// Units of the axes in the world, as columns; for a uniform lattice, the step between neighbouring cells along
    /// each index.
    pub fn basis(&self) -> Mat3 {
        self.basis
    }

    /// First cell and one past the last cell of a brick along each axis.
    #[inline]
    pub fn cells(&self, brick: u32) -> [[usize; 2]; 3] {
        let b = brick as usize;
        let [bx, by, _] = self.bricks;
        let at = [b % bx, b / bx % by, b / (bx * by)];
        [0, 1, 2].map(|a| {
            let first = at[a] * BRICK[a];
            [first, (first + BRICK[a]).min(self.dims[a])]
        })
    }

    /// Index of a cell in the grid's order: x fastest.
    #[inline]
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
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

    /// Position of a cell of the brick of `cells` relative to the brick's middle, which is its block's origin; world
    /// units.
    ///
    /// Computed in f32 from indices: half integers times the step err by three roundings of half a brick, wherever the
    /// lattice lies. Twin: `shaders/shared/particles_lattice.wgsl`.
    #[inline]
    pub fn offset(&self, cells: [[usize; 2]; 3], [i, j, k]: [usize; 3]) -> Vec3 {
        let from_middle = |cell: usize, [first, end]: [usize; 2]| {
            (cell - first) as f32 - 0.5 * (end - first - 1) as f32
        };
        let units = match &self.cells {
            Cells::Uniform => Vec3::new(
                from_middle(i, cells[0]),
                from_middle(j, cells[1]),
                from_middle(k, cells[2]),
            ),
            Cells::Axes([x, y, z]) => Vec3::new(x[i].offset, y[j].offset, z[k].offset),
        };
        self.basis * units
    }

    /// Returns the factor that all kernels share, world units; `None` if cells differ.
    pub fn shared_factor(&self) -> Option<Mat3> {
        match (&self.cells, &self.lattice.spacing) {
            (Cells::Uniform, LatticeSpacing::Uniform { step, .. }) => {
                Some((*step * self.kernel_width).as_mat3())
            }
            _ => None,
        }
    }

    /// Returns the rotated factor of a cell, if cells differ. `turned_basis`: the basis times the rotation into camera
    /// space.
    #[inline]
    pub fn cell_factor(&self, turned_basis: &Mat3, [i, j, k]: [usize; 3]) -> Factor {
        let sigmas = self.axes().map_or(Vec3::ONE, |[x, y, z]| {
            Vec3::new(x[i].sigma, y[j].sigma, z[k].sigma)
        });
        Factor::from_matrix(*turned_basis * Mat3::from_diagonal(sigmas))
    }

    /// Returns the volume that all cells share, world units cubed; `None` if cells differ.
    pub fn uniform_volume(&self) -> Option<f32> {
        match (&self.cells, &self.lattice.spacing) {
            (Cells::Uniform, LatticeSpacing::Uniform { step, .. }) => {
                Some(step.determinant().abs() as f32)
            }
            _ => None,
        }
    }

    /// Volume of a cell, if cells differ; world units cubed.
    #[inline]
    pub fn cell_volume(&self, cell: [usize; 3]) -> f32 {
        self.extents(cell).element_product()
    }

    /// Volume of a cell of any lattice, world units cubed. In f64, because cubes of lengths beyond 1e13 or below 1e-13
    /// leave the range of f32.
    #[inline]
    pub fn cell_volume_f64(&self, cell: [usize; 3]) -> f64 {
        match &self.lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => step.determinant().abs(),
            LatticeSpacing::Rectilinear { .. } => self.extents(cell).as_dvec3().element_product(),
        }
    }

    #[inline]
    fn extents(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        self.axes().map_or(Vec3::ONE, |[x, y, z]| {
            Vec3::new(x[i].extent, y[j].extent, z[k].extent)
        })
    }

    /// Change of the spacing at a cell along each axis ([`AxisSample::bend`]).
    #[inline]
    pub(crate) fn bends(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        self.axes().map_or(Vec3::ZERO, |[x, y, z]| {
            Vec3::new(x[i].bend, y[j].bend, z[k].bend)
        })
    }

    /// Standard deviation of the kernels, in spacings.
    pub(crate) fn kernel_width(&self) -> f64 {
        self.kernel_width
    }

    /// Returns the moments of cubes of `merged` cells along each axis, in units of the grid's basis.
    pub(super) fn axis_moments(&self, merged: usize) -> [Vec<AxisMoments>; 3] {
        let of_axis = |kernels: Vec<AxisKernel>| {
            let cubes = kernels.chunks(merged).map(AxisMoments::of);
            cubes.collect()
        };
        self.axis_kernels().map(of_axis)
    }

    /// Returns the factor that each sample along each axis contributes to the volume of its cell inside the faces, in
    /// units of the grid's basis.
    pub(super) fn axis_extents(&self) -> [Vec<f64>; 3] {
        self.axis_kernels()
            .map(|kernels| kernels.iter().map(|kernel| kernel.extent).collect())
    }
}

/// Returns the least and the greatest standard deviation of a kernel of factor F, rounded outwards.
pub(super) fn sigma_range(factor: &DMat3) -> [f32; 2] {
    let [greatest, _, least] = principal_sigmas(lower_factor(*factor));
    outwards(least, greatest)
}

/// Rounds bounds outwards to f32.
pub(super) fn outwards(least: f64, greatest: f64) -> [f32; 2] {
    // Rounding of the singular values, and of the narrowing to f32.
    const ROUNDING: f32 = 2.0 * f32::EPSILON;
    [
        least as f32 * (1.0 - ROUNDING),
        greatest as f32 * (1.0 + ROUNDING),
    ]
}

/// An axis of a lattice, in units of the grid's basis.
struct Axis {
    coordinates: Vec<f64>,
    /// Width of the cell around each sample.
    widths: Vec<f64>,
}

/// A sample's kernel along an axis, cut by the domain.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AxisKernel {
    /// Width of the cell, times the share of the kernel inside.
    extent: f64,
    mean: f64,
    variance: f64,
    /// Third central moment.
    third: f64,
}

impl Axis {
    fn new(lattice: &Lattice, a: usize) -> Self {
        match &lattice.spacing {
            LatticeSpacing::Uniform { .. } => Self {
                coordinates: (0..lattice.dims[a]).map(|i| i as f64).collect(),
                widths: vec![1.0; lattice.dims[a]],
            },
            LatticeSpacing::Rectilinear { coordinates } => {
                let axis = &coordinates[a];
                Self {
                    widths: (0..axis.len()).map(|i| cell_width(axis, i)).collect(),
                    coordinates: axis.clone(),
                }
            }
        }
    }

    /// Returns the kernels of all samples. The outermost `ghosts` samples lie beyond the faces; the next samples lie on
    /// the faces, which cut all kernels.
    fn kernels(&self, kernel_width: f64, ghosts: usize) -> Vec<AxisKernel> {
        let axis = &self.coordinates;
        let faces = (ghosts > 0).then(|| [axis[ghosts], axis[axis.len() - 1 - ghosts]]);
        let kernel = |(&at, &width): (&f64, &f64)| {
            let sigma = kernel_width * width;
            let Some(faces) = faces else {
                return AxisKernel {
                    extent: width,
                    mean: at,
                    variance: sigma * sigma,
                    third: 0.0,
                };
            };
            // Coordinates may descend.
            let [a, b] = faces.map(|face| (face - at) / sigma);
            let left = Truncated::new(a.min(b), a.max(b));
            AxisKernel {
                extent: width * left.share,
                mean: at + sigma * left.mean,
                variance: sigma * sigma * left.variance,
                third: sigma * sigma * sigma * left.third,
            }
        };
        axis.iter().zip(&self.widths).map(kernel).collect()
    }

    /// Returns the samples, for bricks of `brick` cells.
    fn samples(&self, kernel_width: f64, brick: usize) -> Vec<AxisSample> {
        let axis = &self.coordinates;
        let sample = |i: usize| {
            let width = self.widths[i] as f32;
            AxisSample {
                offset: (axis[i] - self.middle(i / brick, brick)) as f32,
                sigma: width * kernel_width as f32,
                extent: width,
                bend: bend(axis, i),
            }
        };
        (0..axis.len()).map(sample).collect()
    }

    /// Returns the samples of kernels that are merged by `merged`, for bricks of `brick` merged cells.
    fn merged_samples(
        &self,
        kernels: &[AxisKernel],
        merged: usize,
        brick: usize,
    ) -> Vec<AxisSample> {
        let sample = |(i, members): (usize, &[AxisKernel])| {
            let moments = AxisMoments::of(members);
            AxisSample {
                offset: (moments.mean - self.middle(i / brick, brick * merged)) as f32,
                sigma: moments.variance.sqrt() as f32,
                extent: moments.extent as f32,
                bend: 0.0,
            }
        };
        kernels.chunks(merged).enumerate().map(sample).collect()
    }

    /// Returns the origin along this axis of a brick's block, as `BrickGrid::blocks` finds it.
    fn middle(&self, brick: usize, samples: usize) -> f64 {
        let first = brick * samples;
        let last = (first + samples).min(self.coordinates.len()) - 1;
        (self.coordinates[first] + self.coordinates[last]) / 2.0
    }
}

/// Returns the change of the spacing at one of an axis' samples ([`AxisSample::bend`]).
fn bend(axis: &[f64], i: usize) -> f32 {
    if i == 0 || i + 1 == axis.len() {
        return 0.0;
    }
    let (below, own, above) = (axis[i - 1], axis[i], axis[i + 1]);
    (((above - own) - (own - below)) / (above - below)) as f32
}

/// Moments of neighbouring kernels along an axis, weighted by their extents.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AxisMoments {
    /// The sum of the extents.
    pub(super) extent: f64,
    pub(super) mean: f64,
    /// Variance of the mixture: of the kernels, and of their positions.
    pub(super) variance: f64,
    /// Variance of the narrowest kernel.
    pub(super) narrowest: f64,
    /// Third central moment.
    pub(super) third: f64,
    /// Fourth cumulant.
    pub(super) fourth: f64,
}

impl AxisMoments {
    fn of(members: &[AxisKernel]) -> Self {
        let extent: f64 = members.iter().map(|k| k.extent).sum();
        let average = |of: &dyn Fn(&AxisKernel) -> f64| {
            let sum: f64 = members.iter().map(|k| k.extent * of(k)).sum();
            sum / extent
        };
        let mean = average(&|k| k.mean);
        let from_mean = |k: &AxisKernel| k.mean - mean;
        let variance = average(&|k| from_mean(k).powi(2) + k.variance);
        let third = average(&|k| from_mean(k).powi(3) + 3.0 * from_mean(k) * k.variance + k.third);
        let fourth = average(&|k| {
            let (square, own) = (from_mean(k).powi(2), k.variance);
            square * square + 6.0 * square * own + 4.0 * from_mean(k) * k.third + 3.0 * own * own
        });
        let narrowest = members.iter().map(|k| k.variance);
        Self {
            extent,
            mean,
            variance,
            narrowest: narrowest.fold(f64::INFINITY, f64::min).min(variance),
            third,
            fourth: fourth - 3.0 * variance * variance,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    #[test]
    fn what_cubes_differ_by_from_their_cells_is_of_the_cells_places() {
        // Two positions a step apart: a variance of 1/4 and a fourth cumulant of 1/16 - 3/16, for any kernel.
        let bounds = |lattice: Lattice| {
            let cells = BrickGrid::new(lattice, 0.6);
            let grid = cells.merged(2);
            let moments = cells.axis_moments(2);
            grid.merge_bounds(&moments, grid.cells(0))
        };
        let even = bounds(Lattice::uniform(
            [16, 16, 16],
            DVec3::ZERO,
            DVec3::splat(2.0),
        ));
        assert!(
            (even.second - (3.0_f32 / 4.0).sqrt() * 2.0).abs() < 1e-5,
            "{even:?}"
        );
        let norm = 3.0_f32.sqrt() / 8.0;
        assert!(
            (even.fourth - norm.sqrt().sqrt() * 2.0).abs() < 1e-5,
            "{even:?}"
        );
        assert!(even.third < 1e-4, "{even:?}");
        // Slanted axes: the tensor of one axis may lie along that of another.
        let mut slanted = Lattice::uniform([16, 16, 16], DVec3::ZERO, DVec3::ONE);
        if let LatticeSpacing::Uniform { step, .. } = &mut slanted.spacing {
            *step = DMat3::from_cols(DVec3::X, DVec3::new(0.6, 0.8, 0.0), DVec3::Z);
        }
        let sum = bounds(slanted).fourth;
        assert!((sum - (3.0_f32 / 8.0).sqrt().sqrt()).abs() < 1e-5, "{sum}");
    }
}
