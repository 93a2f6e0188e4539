//! Evens out kernels of different levels side by side on meshes, in space.
//!
//! Meshes have no index space, so sums of kernels are taken in space: each volume is divided by the sum of all kernels
//! at its centre, [`PASSES`] times. The sums are those of volumes with a sharp boundary ([`CutKernels`]): mirror images
//! take the place of kernels outside, and change with the kernels that they mirror. Only split nodes and those near
//! them take part.

use glam::DVec3;

use crate::constants::MOST_EDGES;
use crate::error::Result;
use crate::math::{narrowed, principal_sigmas};
use crate::sample::kernels::even::CutKernels;
use crate::sample::kernels::sums::Summand;
use crate::sample::points::neighbours::PointIndex;
use crate::sample::positions::index_u32;
use crate::sample::refine::PASSES;
use crate::scene::BoundaryPlanes;
use crate::task::Task;

/// Greatest factor by which a volume changes in one correction.
const MOST_CHANGE: f64 = 2.0;

/// Greatest number of terms of all sums: some seconds of one core.
const MOST_TERMS: usize = 1 << 30;

/// Kernels that are evened out together.
#[derive(Debug, Default)]
pub(super) struct UnevenKernels {
    pub(super) positions: Vec<DVec3>,
    pub(super) factors: Vec<[f32; 6]>,
    pub(super) boundary: BoundaryPlanes,
    /// The kernel that each follows: itself, or the one that it mirrors.
    pub(super) follows: Vec<u32>,
    /// Kernels whose volumes stay as they are: far from any jump, or beside a boundary without images.
    pub(super) is_fixed: Vec<bool>,
    pub(super) volumes: Vec<f64>,
}

impl UnevenKernels {
    /// Corrects the volumes. Returns false, and leaves them as they are, if kernels are so long compared with
    /// distances that the sums would take long.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn even_out(&mut self, task: Option<&Task>) -> Result<bool> {
        let Some(index) = PointIndex::new(&self.positions) else {
            return Ok(true);
        };
        let kernels = CutKernels {
            positions: &self.positions,
            factors: &self.factors,
            boundary: &self.boundary,
            sources: &[],
        };
        let summand = |volumes: &[f64], j: usize| {
            let factor = kernels.factor(j);
            Some(Summand {
                factor,
                sigma: principal_sigmas(factor)[0],
                amplitude: volumes[j],
            })
        };
        let reach = index.mean_reach(|j| summand(&self.volumes, j));
        if reach.saturating_mul(self.positions.len()) > MOST_TERMS {
            return Ok(false);
        }
        let changes = |n: usize| self.follows[n] as usize == n && !self.is_fixed[n];
        for _ in 0..PASSES {
            // Summands are narrow; sums need no more.
            let volumes = &self.volumes;
            let sums =
                index.kernel_sums(task, changes, |j| summand(volumes, j), |j| kernels.cut(j))?;
            let evened = |(n, volume): (usize, &f64)| {
                let own = self.follows[n] as usize;
                let sum = sums[own];
                match self.is_fixed[own] || !sum.is_finite() {
                    true => *volume,
                    false => volume / sum.clamp(1.0 / MOST_CHANGE, MOST_CHANGE),
                }
            };
            self.volumes = volumes.iter().enumerate().map(evened).collect();
        }
        Ok(true)
    }

    /// Appends a kernel.
    ///
    /// - `follows`, `is_fixed`: as in the fields of these names.
    pub(super) fn push(
        &mut self,
        (position, factor, volume): (DVec3, [f64; 6], f64),
        edges: Option<&[[f32; 4]; MOST_EDGES]>,
        follows: u32,
        is_fixed: bool,
    ) {
        self.positions.push(position);
        self.factors.push(factor.map(narrowed));
        self.volumes.push(volume);
        self.follows.push(follows);
        self.is_fixed.push(is_fixed);
        let planes = &mut self.boundary;
        planes.edges.extend(edges);
        let word = edges.map_or(0, |_| index_u32(planes.edges.len()));
        planes.of_particle.push(word);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns cubes of side 1 over 8³, those of the lower half along x in eight parts each.
    fn graded() -> UnevenKernels {
        let mut all = UnevenKernels::default();
        for n in 0..512_usize {
            let low = DVec3::from([n % 8, n / 8 % 8, n / 64].map(|i| i as f64));
            let count = if low.x < 4.0 { 2 } else { 1 };
            let side = 1.0 / f64::from(count);
            for part in 0..count * count * count {
                let place = [part % count, part / count % count, part / (count * count)];
                let centre = low + (DVec3::from(place.map(f64::from)) + 0.5) * side;
                let sigma = 0.6 * side;
                let factor = [sigma, 0.0, sigma, 0.0, 0.0, sigma];
                // Kernels at the ends lack those beyond.
                let is_fixed = (centre - 4.0).abs().max_element() > 2.0;
                let follows = u32::try_from(all.positions.len()).unwrap();
                all.push((centre, factor, side.powi(3)), None, follows, is_fixed);
            }
        }
        all
    }

    /// Returns the root mean square of the sum's difference from 1 at the kernels in the middle.
    fn unevenness(all: &UnevenKernels) -> f64 {
        let inside: Vec<usize> = (0..all.positions.len())
            .filter(|&i| !all.is_fixed[i])
            .collect();
        let density = |at: DVec3| -> f64 {
            let terms = all.positions.iter().zip(&all.factors).zip(&all.volumes);
            let term = |((position, factor), volume): ((&DVec3, &[f32; 6]), &f64)| {
                let sigma = f64::from(factor[0]);
                let squared = (at - *position).length_squared() / (sigma * sigma);
                volume * (-0.5 * squared).exp() / (std::f64::consts::TAU.sqrt() * sigma).powi(3)
            };
            terms.map(term).sum()
        };
        let squares = inside
            .iter()
            .map(|&i| (density(all.positions[i]) - 1.0).powi(2));
        (squares.sum::<f64>() / inside.len() as f64).sqrt()
    }

    #[test]
    fn kernels_beside_jumps_are_evened_out() {
        let mut all = graded();
        let before = unevenness(&all);
        assert!(all.even_out(None).unwrap());
        let after = unevenness(&all);
        assert!(before > 0.04 && after < 0.3 * before, "{before} {after}");
        let fixed = graded();
        let stays = (0..fixed.positions.len()).filter(|&i| fixed.is_fixed[i]);
        assert!(
            stays
                .into_iter()
                .all(|i| all.volumes[i] == fixed.volumes[i])
        );
    }

    #[test]
    fn images_follow_what_they_mirror() {
        // Two kernels and the image of the first beyond x = 0.
        let mut all = UnevenKernels::default();
        let factor = [0.6, 0.0, 0.6, 0.0, 0.0, 0.6];
        for (x, follows) in [(0.5, 0), (1.5, 1), (-0.5, 0)] {
            all.push((DVec3::X * x, factor, 1.0), None, follows, false);
        }
        assert!(all.even_out(None).unwrap());
        assert_eq!(all.volumes[0], all.volumes[2]);
        assert_ne!(all.volumes[0], all.volumes[1]);
    }
}
