//! Computes anisotropic kernels of fluid particles after Yu and Turk (2013): flat along surfaces, long along
//! filaments.

use glam::DVec3;

use super::neighbours::{PointIndex, square};
use crate::error::Result;
use crate::math::{eigen, from_eigen};
use crate::task::{Task, collect};

/// Greatest ratio of the widths of one kernel.
const MAX_RATIO: f64 = 4.0;
/// Greatest number of neighbours with which a particle counts as a lone drop.
const LONE_NEIGHBOURS: usize = 25;
/// Width of a lone drop's kernel over that of an isotropic one.
const LONE_WIDTH: f64 = 0.5;

/// Returns the variances of all kernels: sigma² R S² Rᵀ. The covariance of the neighbours within the support is
/// R D Rᵀ. S is D with its entries raised to at least a quarter of the greatest, then scaled to unit
/// determinant. The paper's constant k_s depends on the unit of length instead.
///
/// `sizes(i)` returns the standard deviation and the support radius of particle i. The weight of a
/// neighbour is 1 - (distance / support)³. The centres stay where they are.
pub(in crate::sample) fn variances(
    index: &PointIndex<'_>,
    positions: &[DVec3],
    sizes: impl Fn(usize) -> (f64, f64) + Sync,
    task: Option<&Task>,
) -> Result<Vec<[f64; 6]>> {
    let variance = |i: usize| {
        let (sigma, support) = sizes(i);
        let sphere = |width: f64| {
            let v = (sigma * width).powi(2);
            [v, 0.0, 0.0, v, 0.0, v]
        };
        if !(positions[i].is_finite() && support > 0.0 && support.is_finite()) {
            return sphere(1.0);
        }
        let mut count = 0;
        let mut total = 0.0;
        let mut first = DVec3::ZERO;
        let mut second = [0.0; 6];
        index.for_each_within(positions[i], support, |_, d| {
            let weight = 1.0 - (d.length() / support).powi(3);
            count += 1;
            total += weight;
            first += d * weight;
            for (sum, term) in second.iter_mut().zip(square(d)) {
                *sum += term * weight;
            }
        });
        // The particle itself is among those found.
        if count <= LONE_NEIGHBOURS + 1 {
            return sphere(LONE_WIDTH);
        }
        let mean = first / total;
        let about = square(mean);
        let covariance = std::array::from_fn(|c| second[c] / total - about[c]);
        let (spread, axes) = eigen(covariance);
        let greatest = spread.max_element();
        if !(greatest > 0.0) {
            return sphere(1.0);
        }
        let widths = spread.max(DVec3::splat(greatest / MAX_RATIO));
        let widths = widths * (sigma / widths.element_product().cbrt());
        from_eigen(widths * widths, axes)
    };
    collect(task, "shaping kernels", positions.len(), variance)
}
