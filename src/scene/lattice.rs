//! Defines grids whose positions follow from indices: nothing is stored per particle.

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};

/// A three-dimensional array of sample points, x fastest, then y, then z.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// Number of samples along each axis.
    pub dims: [usize; 3],
    /// Positions of the samples.
    pub spacing: LatticeSpacing,
}

/// Positions of a [`Lattice`]'s samples.
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

    /// Number of samples; `usize::MAX` if there are more.
    pub fn len(&self) -> usize {
        self.checked_len().unwrap_or(usize::MAX)
    }

    fn checked_len(&self) -> Option<usize> {
        let [x, y, z] = self.dims;
        x.checked_mul(y)?.checked_mul(z)
    }

    /// Checks that every sample has a position.
    ///
    /// # Errors
    /// More samples than can be counted; a number of coordinates other than the dimensions; coordinates that do
    /// not rise or are not finite; an origin or a step that is not finite.
    pub fn validate(&self) -> Result<()> {
        let [x, y, z] = self.dims;
        let fault = |place: &str, expected: &str, found: String| {
            let advice = "correct the lattice";
            Err(Error::invalid("lattice", place, expected, found, advice))
        };
        if self.checked_len().is_none() {
            let expected = "three counts whose product fits into memory";
            return fault("dimensions", expected, format!("{x} x {y} x {z}"));
        }
        match &self.spacing {
            LatticeSpacing::Uniform { origin, step } => {
                if !(origin.is_finite() && step.is_finite()) {
                    let found = format!("{origin} and {step}");
                    return fault("origin and step", "finite numbers", found);
                }
            }
            LatticeSpacing::Rectilinear { coordinates } => {
                for (axis, line) in coordinates.iter().enumerate() {
                    let count = self.dims[axis];
                    let place = format!("coordinates along {}", ["x", "y", "z"][axis]);
                    if line.len() != count {
                        let found = line.len().to_string();
                        return fault(&place, &format!("{count} of them"), found);
                    }
                    let rises = |i: usize| i == 0 || line[i - 1] < line[i];
                    let wrong = (0..count).find(|&i| !(line[i].is_finite() && rises(i)));
                    if let Some(i) = wrong {
                        let found = format!("{} as number {i}", line[i]);
                        return fault(&place, "finite numbers that rise", found);
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether there are no samples.
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

/// Width of a cell along a rectilinear axis with one sample, in world units. Files do not store this width.
pub(crate) const LONE_CELL_WIDTH: f64 = 1.0;
