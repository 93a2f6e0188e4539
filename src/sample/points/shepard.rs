//! Corrects cell volumes by Shepard passes, until they reproduce a uniform field at the particles.

use glam::DVec3;
use rayon::prelude::*;

use super::neighbours::{Groups, PointIndex};
use crate::error::Result;
use crate::math::{narrowed, principal_sigmas};
use crate::sample::kernels::sums::{Summand, everywhere};
use crate::sample::splats::factor::sphere;
use crate::scene::{Particles, PointVolume, Strength};
use crate::task::Task;

/// Least sum that is corrected. At a boundary half of a kernel's neighbours are missing; a sum that would more
/// than double a volume several times over is no ripple.
const LEAST_SUM: f64 = 0.2;

/// Divides each particle's volume by the sum of all volumes' kernels at its centre, `passes` times. Then scales
/// all volumes to restore their total.
///
/// Lattices need no correction, and masses stated by the data must not change: both stay.
///
/// - `groups`: groups of the particles' positions, if they are known.
pub(in crate::sample) fn even_out(
    volume: &mut PointVolume,
    groups: &mut Option<Groups>,
    passes: u32,
    task: Option<&Task>,
) -> Result<()> {
    let Strength::Classified { volumes } = &mut volume.strength else {
        return Ok(());
    };
    let (positions, factor): (&[DVec3], &(dyn Fn(usize) -> [f64; 6] + Sync)) =
        match &volume.particles {
            Particles::Lattice { .. } | Particles::Surfels { .. } => return Ok(()),
            Particles::Isotropic { positions, sigmas } => {
                (positions, &|i| sphere(f64::from(sigmas[i])))
            }
            Particles::Anisotropic { positions, factors } => {
                (positions, &|i| factors[i].map(f64::from))
            }
        };
    let Some(index) = PointIndex::of(positions, groups.take()) else {
        return Ok(());
    };
    let total = |volumes: &[f32]| volumes.iter().copied().map(f64::from).sum::<f64>();
    let before = total(volumes);
    for _ in 0..passes {
        let kernel = |j: usize| {
            let factor = factor(j);
            Some(Summand {
                factor,
                sigma: principal_sigmas(factor)[0],
                amplitude: f64::from(volumes[j]),
            })
        };
        let sums = index.kernel_sums(task, |_| true, kernel, everywhere)?;
        volumes
            .par_iter_mut()
            .zip(&sums)
            .for_each(|(volume, sum)| *volume = narrowed(f64::from(*volume) / sum.max(LEAST_SUM)));
    }
    *groups = Some(index.into_groups());
    let scale = before / total(volumes);
    if scale.is_finite() {
        for volume in volumes {
            *volume = narrowed(f64::from(*volume) * scale);
        }
    }
    Ok(())
}
