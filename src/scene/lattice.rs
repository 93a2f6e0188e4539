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
