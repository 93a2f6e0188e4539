//! Measures sizes and shapes of a volume's kernels, in percentiles.

use glam::DMat3;
use rayon::prelude::*;

use crate::math::{lower_factor, principal_sigmas};
use crate::scene::{LatticeSpacing, Particles};

/// The percentiles that [`ShapeStatistics`] has.
pub const PERCENTILES: [f64; 5] = [0.0, 5.0, 50.0, 95.0, 100.0];

/// Greatest number of cells of a rectilinear lattice that are measured.
const MOST_CELLS: usize = 1 << 20;

/// Sizes and anisotropies of kernels at the [`PERCENTILES`], each in its own order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShapeStatistics {
    /// Geometric mean of the three standard deviations \[length\].
    pub size: [f64; 5],
    /// Greatest over least standard deviation; infinite for flat kernels.
    pub anisotropy: [f64; 5],
}

impl ShapeStatistics {
    /// Measures all particles; returns `None` if there are none.
    pub fn of(particles: &Particles) -> Option<Self> {
        let shape = |sigmas: [f64; 3]| {
            let [longest, middle, shortest] = sigmas;
            ((longest * middle * shortest).cbrt(), longest / shortest)
        };
        let (mut sizes, mut ratios): (Vec<f64>, Vec<f64>) = match particles {
            Particles::Lattice {
                lattice,
                kernel_width,
            } => {
                let [x, y, _] = lattice.dims;
                let of_cell = |i: usize| {
                    let step: DMat3 = lattice.step([i % x, i / x % y, i / (x * y)]);
                    shape(principal_sigmas(lower_factor(step * *kernel_width)))
                };
                let step = match lattice.spacing {
                    LatticeSpacing::Uniform { .. } => lattice.len(),
                    LatticeSpacing::Rectilinear { .. } => lattice.len().div_ceil(MOST_CELLS),
                };
                let cells = (0..lattice.len()).into_par_iter().step_by(step.max(1));
                cells.map(of_cell).unzip()
            }
            Particles::Isotropic { sigmas, .. } => {
                sigmas.iter().map(|&s| (f64::from(s), 1.0)).unzip()
            }
            Particles::Anisotropic { factors, .. } => factors
                .par_iter()
                .map(|f| shape(principal_sigmas(f.map(f64::from))))
                .unzip(),
            // Surfels are flat: the size of three axes has no meaning for them.
            Particles::Surfels { .. } => return None,
        };
        Some(Self {
            size: percentiles(&mut sizes)?,
            anisotropy: percentiles(&mut ratios)?,
        })
    }
}

fn percentiles(values: &mut [f64]) -> Option<[f64; 5]> {
    values.par_sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a share of the length, rounded"
    )]
    let at = |percent: f64| values[(percent / 100.0 * last as f64).round() as usize];
    Some(PERCENTILES.map(at))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn sizes_and_ratios_are_those_of_the_factors() {
        let factors = vec![[2.0, 0.0, 1.0, 0.0, 0.0, 0.5]; 3];
        let particles = Particles::Anisotropic {
            positions: vec![DVec3::ZERO; 3],
            factors,
        };
        let shapes = ShapeStatistics::of(&particles).unwrap();
        assert!(shapes.size.iter().all(|s| (s - 1.0).abs() < 1e-12));
        assert!(shapes.anisotropy.iter().all(|r| (r - 4.0).abs() < 1e-12));
        let sigmas = (0..=100_u8).map(|i| f32::from(i) + 1.0).collect();
        let spheres = Particles::Isotropic {
            positions: vec![DVec3::ZERO; 101],
            sigmas,
        };
        let sizes = ShapeStatistics::of(&spheres).unwrap().size;
        for (size, wanted) in sizes.iter().zip([1.0, 6.0, 51.0, 96.0, 101.0]) {
            assert!((size - wanted).abs() < 1e-9, "{sizes:?}");
        }
        let none = Particles::Isotropic {
            positions: vec![],
            sigmas: vec![],
        };
        assert!(ShapeStatistics::of(&none).is_none());
    }
}
