//! Fits gradients by least squares.

use glam::{DMat3, DVec3};

/// Damping added to the diagonal of the normal equations, as a share of their trace. If the neighbours lie in a
/// plane, it keeps the gradient in that plane. Otherwise it changes the gradient by less than the stored
/// precision.
const DAMPING: f64 = 1e-9;

/// Least determinant of the sum of unit dyads for neighbours in all directions, as a share of the determinant
/// for evenly spread neighbours. At least one neighbour in a hundred must then lie outside a common plane.
const EVEN: f64 = 0.05;

/// Returns the gradient that best fits offsets and changes of value, weighted by 1/distance²; zero without
/// neighbours.
pub(in crate::sample) fn least_squares(neighbours: impl Iterator<Item = (DVec3, f64)>) -> DVec3 {
    Fit::of(neighbours).gradient()
}

/// Sums of the normal equations.
#[derive(Debug, Clone, Copy)]
pub(in crate::sample) struct Fit {
    matrix: DMat3,
    right: DVec3,
}

impl Fit {
    /// Sums over neighbours' offsets and changes of value; an offset of zero or a non-finite change does not
    /// count.
    pub(in crate::sample) fn of(neighbours: impl Iterator<Item = (DVec3, f64)>) -> Self {
        let mut fit = Self {
            matrix: DMat3::ZERO,
            right: DVec3::ZERO,
        };
        for (offset, change) in neighbours {
            let squared = offset.length_squared();
            if squared > 0.0 && change.is_finite() {
                let weighted = offset / squared;
                fit.matrix += DMat3::from_cols(
                    weighted * offset.x,
                    weighted * offset.y,
                    weighted * offset.z,
                );
                fit.right += weighted * change;
            }
        }
        fit
    }

    /// Returns true if the neighbours lie in all directions, not in a plane alone.
    pub(in crate::sample) fn spans(&self) -> bool {
        self.matrix.determinant() > EVEN * (self.trace() / 3.0).powi(3)
    }

    /// Returns the gradient; zero without neighbours.
    pub(in crate::sample) fn gradient(&self) -> DVec3 {
        let trace = self.trace();
        if !(trace > 0.0) {
            return DVec3::ZERO;
        }
        let damping = DMat3::from_diagonal(DVec3::splat(DAMPING * trace));
        (self.matrix + damping).inverse() * self.right
    }

    fn trace(&self) -> f64 {
        self.matrix.x_axis.x + self.matrix.y_axis.y + self.matrix.z_axis.z
    }
}
