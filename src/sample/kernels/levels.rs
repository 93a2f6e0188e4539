//! Evens out kernels beside a jump between levels of refinement.
//!
//! If the spacing halves at once, kernels of .6 spacings add up to .84 on the coarse side and 1.16 on the fine
//! one. Two corrections apply, both only within some spacings of the jump:
//!
//! - A kernel becomes as wide as the mean spacing around it, weighted by kernels 1.5 times as wide, if that is
//!   wider.
//! - The volume of a kernel is divided by the sum of all kernels at its centre, twice.
//!
//! Measured at a plane jump: 16 % become 2.6 %, and within two coarse cells of the jump 7.7 % rms become 1.4 %.

use rayon::prelude::*;

use super::Kernels;
use super::sums::{Summand, everywhere};
use crate::error::Result;
use crate::math::{narrowed, principal_sigmas};
use crate::sample::points::neighbours::PointIndex;
use crate::task::Task;

/// Factor by which the kernels that weight spacings are wider.
const WIDER: f64 = 1.5;

/// A kernel is beside a jump if the mean spacing differs from its own by more than this share.
const JUMP: f64 = 0.02;

const PASSES: usize = 2;

/// Least sum of kernels at a centre for which a volume is corrected. A lesser sum shows that the data end. One
/// cell before a face the sum is .8; beside a jump it is at least .9 once kernels are widened.
const LEAST_SUM: f64 = 0.87;

pub(in crate::sample) fn even_out(kernels: &mut Kernels, task: Option<&Task>) -> Result<()> {
    let Some(index) = PointIndex::new(&kernels.positions) else {
        return Ok(());
    };
    let sums = |factors: &[[f32; 6]], wider: f64, amplitude: &(dyn Fn(usize) -> f64 + Sync)| {
        let kernel = |j: usize| {
            let factor = factors[j].map(|l| f64::from(l) * wider);
            Some(Summand {
                factor,
                sigma: principal_sigmas(factor)[0],
                amplitude: amplitude(j),
            })
        };
        index.kernel_sums(task, |_| true, kernel, everywhere)
    };
    let volume = |volumes: &[f32], j: usize| f64::from(volumes[j]);
    let own = |j: usize| volume(&kernels.volumes, j).cbrt();
    let weights = sums(&kernels.factors, WIDER, &|j| volume(&kernels.volumes, j))?;
    let weighted = sums(&kernels.factors, WIDER, &|j| {
        volume(&kernels.volumes, j) * own(j)
    })?;
    let means = weighted
        .iter()
        .zip(&weights)
        .map(|(sum, weight)| sum / weight);
    let ratios: Vec<f64> = means.enumerate().map(|(j, mean)| mean / own(j)).collect();
    // Phrased so that NaN counts as no jump.
    let is_beside = |ratio: f64| (ratio - 1.0).abs() > JUMP;
    kernels
        .factors
        .par_iter_mut()
        .zip(&ratios)
        .filter(|(_, ratio)| is_beside(**ratio) && **ratio > 1.0)
        .for_each(|(factor, ratio)| *factor = factor.map(|l| narrowed(f64::from(l) * ratio)));
    for _ in 0..PASSES {
        let found = sums(&kernels.factors, 1.0, &|j| volume(&kernels.volumes, j))?;
        let all = kernels.volumes.par_iter_mut().zip(&found).zip(&ratios);
        all.filter(|(_, ratio)| is_beside(**ratio))
            .filter(|((_, sum), _)| **sum > LEAST_SUM)
            .for_each(|((volume, sum), _)| *volume = narrowed(f64::from(*volume) / sum));
    }
    Ok(())
}
