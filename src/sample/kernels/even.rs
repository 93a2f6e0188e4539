//! Evens out volumes inside a sharp boundary, by the sum of kernels at the samples of a uniform field.
//!
//! If the spacing of a grid changes, its kernels do not add up to 1. They are off by rho² X'''/X' along an
//! axis: by 2.5 % at a growth of 1.3 per cell, by a fifth at a sudden change. The volume of each sample is
//! divided once by the sum of all kernels there. The volume of a ghost changes as that of its sample.
//!
//! Inside a sharp boundary these sums are complete. Beside a boundary that is not cut they lack kernels
//! outside: samples there stay as they are.

use glam::DVec3;
use rayon::prelude::*;

use super::sums::{Cut, Summand};
use crate::error::Result;
use crate::math::{lower_matrix, narrowed, principal_sigmas};
use crate::sample::own::Own;
use crate::sample::points::neighbours::PointIndex;
use crate::scene::{BoundaryPlanes, cut_kernel};
use crate::task::Task;

/// Greatest factor by which a volume changes: larger errors have causes other than spacing.
const MOST_CHANGE: f64 = 1.5;

/// A plane cuts a kernel at places this many of its standard deviations outside. On a curved wall, nodes lie
/// outside the planes of their neighbours by less than that.
const SLACK: f64 = 1.0;

/// Greatest average number of samples per kernel for which kernels are summed: more would take noticeable time.
const MOST_REACHED: usize = 400;

/// The kernels of a volume with a sharp boundary, ghosts last.
pub(in crate::sample) struct CutKernels<'a> {
    pub(in crate::sample) positions: &'a [DVec3],
    pub(in crate::sample) factors: &'a [[f32; 6]],
    pub(in crate::sample) boundary: &'a BoundaryPlanes,
    /// Sample of each ghost.
    pub(in crate::sample) sources: &'a [usize],
}

impl CutKernels<'_> {
    /// Returns the number of samples without ghosts.
    pub(in crate::sample) fn own_count(&self) -> usize {
        self.positions.len() - self.sources.len()
    }

    pub(in crate::sample) fn factor(&self, kernel: usize) -> [f64; 6] {
        self.factors[kernel].map(f64::from)
    }

    /// Returns the planes that cut a kernel; `None` if nothing cuts it.
    pub(in crate::sample) fn cut(&self, kernel: usize) -> Option<Cut<'_>> {
        let planes = self.boundary.of(kernel)?;
        let transposed = lower_matrix(self.factor(kernel)).transpose();
        let slack = |normal: DVec3| SLACK * (transposed * normal).length();
        Some(Cut::new(planes, slack))
    }

    /// Returns the sums of all kernels at the samples, found by distance; 0 for ghosts. Returns `None` if each kernel
    /// reaches many samples, because kernels are long compared with distances.
    pub(in crate::sample) fn sums(
        &self,
        volumes: &[f32],
        task: Option<&Task>,
    ) -> Result<Option<Vec<f64>>> {
        let Some(index) = PointIndex::new(self.positions) else {
            return Ok(None);
        };
        let kernel = |j: usize| {
            let factor = self.factor(j);
            let sigma = principal_sigmas(factor)[0];
            Some(Summand {
                factor,
                sigma,
                amplitude: f64::from(volumes[j]),
            })
        };
        if index.mean_reach(kernel) > MOST_REACHED {
            return Ok(None);
        }
        let is_sample = |j| j < self.own_count();
        let sums = index.kernel_sums(task, is_sample, kernel, |j| self.cut(j))?;
        Ok(Some(sums))
    }

    /// Divides volumes by sums, then scales all so that their total inside the boundary equals the volume of
    /// the data.
    ///
    /// - `sums`: the sum at each sample; a sample whose sum is not finite stays as it is.
    /// - `inside`: volume of the data.
    ///
    /// # Errors
    /// Errors of the reductions over the ranks that have the other samples.
    pub(in crate::sample) fn even_out(
        &self,
        volumes: &mut [f32],
        sums: &[f64],
        inside: f64,
        own: &mut Own<'_>,
    ) -> Result<()> {
        let count = self.own_count();
        let sample = |i: usize| match i.checked_sub(count) {
            None => i,
            Some(ghost) => self.sources[ghost],
        };
        volumes.par_iter_mut().enumerate().for_each(|(i, volume)| {
            let sum = sums[sample(i)];
            if sum.is_finite() {
                let held = sum.clamp(1.0 / MOST_CHANGE, MOST_CHANGE);
                *volume = narrowed(f64::from(*volume) / held);
            }
        });
        let left = |(i, volume): (usize, &f32)| {
            let share = self.boundary.of(i).map_or(1.0, |planes| {
                cut_kernel(lower_matrix(self.factor(i)), planes).map_or(0.0, |left| left.share)
            });
            share * f64::from(*volume)
        };
        let all: Vec<f64> = volumes.par_iter().enumerate().map(left).collect();
        let range = own.range.clone();
        let of_own = all
            .iter()
            .enumerate()
            .filter(|(i, _)| range.contains(&sample(*i)));
        let scale = inside / own.sum(of_own.map(|(_, left)| *left))?;
        if scale.is_finite() {
            volumes
                .par_iter_mut()
                .for_each(|volume| *volume = narrowed(f64::from(*volume) * scale));
        }
        Ok(())
    }
}
