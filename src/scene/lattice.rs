//! Grids whose positions follow from indices: nothing is stored per particle.

use glam::{DMat3, DVec3};

/// A three-dimensional array of sample points, x fastest, then y, then z.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// Samples along each axis.
    pub dims: [usize; 3],
    /// Where they lie.
    pub spacing: LatticeSpacing,
}

/// Where the samples of a [`Lattice`] lie.
#[derive(Debug, Clone, PartialEq)]
pub enum LatticeSpacing {
    /// Sample (i, j, k) lies at origin + step * (i, j, k).
    Uniform {
        /// Position of sample (0, 0, 0).
        origin: DVec3,
        /// Columns: the step from one sample to the next along each index.
        step: DMat3,
    },
    /// Sample (i, j, k) lies at (x\[i\], y\[j\], z\[k\]).
    Rectilinear {
        /// Strictly increasing coordinates along x, y and z.
        coordinates: [Vec<f64>; 3],
    },
}

impl Lattice {
    /// An axis-aligned lattice from its dimensions, origin and spacing.
    pub fn uniform(dims: [usize; 3], origin: DVec3, spacing: DVec3) -> Self {
        Self {
            dims,
            spacing: LatticeSpacing::Uniform {
                origin,
                step: DMat3::from_diagonal(spacing),
            },
        }
    }

    /// How many samples there are.
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The step from sample (i, j, k) to its neighbours along each index, as columns: the edges of
    /// its cell.
    pub fn step(&self, [i, j, k]: [usize; 3]) -> DMat3 {
        match &self.spacing {
            LatticeSpacing::Uniform { step, .. } => *step,
            LatticeSpacing::Rectilinear {
                coordinates: [x, y, z],
            } => DMat3::from_diagonal(DVec3::new(
                cell_width(x, i),
                cell_width(y, j),
                cell_width(z, k),
            )),
        }
    }

    /// The mean step from a sample to its neighbours along each index, as columns.
    pub(crate) fn mean_step(&self) -> DMat3 {
        match &self.spacing {
            LatticeSpacing::Uniform { step, .. } => *step,
            LatticeSpacing::Rectilinear { coordinates } => {
                let mean = |line: &[f64]| match line {
                    [first, .., last] => (last - first) / (line.len() - 1) as f64,
                    _ => LONE_CELL_WIDTH,
                };
                DMat3::from_diagonal(DVec3::from(coordinates.each_ref().map(|line| mean(line))))
            }
        }
    }

    /// The position of sample (i, j, k).
    pub fn position(&self, [i, j, k]: [usize; 3]) -> DVec3 {
        match &self.spacing {
            LatticeSpacing::Uniform { origin, step } => {
                *origin + *step * DVec3::new(i as f64, j as f64, k as f64)
            }
            LatticeSpacing::Rectilinear { coordinates } => {
                DVec3::new(coordinates[0][i], coordinates[1][j], coordinates[2][k])
            }
        }
    }
}

/// The width of the cell around a rectilinear axis's sample: half the distance between its
/// neighbours; at the ends, the distance to the one neighbour. A sample that is alone has width 1.
pub(crate) fn cell_width(axis: &[f64], i: usize) -> f64 {
    if axis.len() == 1 {
        return LONE_CELL_WIDTH;
    }
    let (a, b) = (i.saturating_sub(1), (i + 1).min(axis.len() - 1));
    ((axis[b] - axis[a]) / (b - a) as f64).abs()
}

/// What the cells of a rectilinear axis with one sample count as being wide, in world units: the
/// file says nothing of it.
pub(crate) const LONE_CELL_WIDTH: f64 = 1.0;
