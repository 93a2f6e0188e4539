//! Stage: from values to signed amplitudes, per particle: what [`classify`](super::classify()) is
//! to opacity, for column densities. No transfer function is asked.
//!
//! Amplitudes are products of numbers that each fit f32 and may not fit it together, so they are
//! formed in f64 and narrowed relative to the largest of the scene.

use rayon::prelude::*;

use super::classify::{Visit, count, fill};
use crate::blocks::BlockedVolume;
use crate::layout::{BlockView, ClassifiedParticle};
use crate::scene::Strength;

/// The amplitudes of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AmplitudeSummary {
    /// The largest magnitude.
    pub largest: f64,
    /// The sum, signs kept.
    pub sum: f64,
    /// Particles whose amplitude is no finite number.
    pub not_finite: usize,
}

impl AmplitudeSummary {
    /// What all of a scene's volumes have.
    pub fn of<'a>(volumes: impl Iterator<Item = &'a BlockedVolume>) -> Self {
        let of_block = |volume: &BlockedVolume, block: u32| {
            let mut summary = Self::default();
            visit(volume, block, |_, amplitude| {
                if amplitude.is_finite() {
                    summary.largest = summary.largest.max(amplitude.abs());
                    summary.sum += amplitude;
                } else {
                    summary.not_finite += 1;
                }
            });
            summary
        };
        let add = |a: Self, b: &Self| Self {
            largest: a.largest.max(b.largest),
            sum: a.sum + b.sum,
            not_finite: a.not_finite + b.not_finite,
        };
        volumes
            .map(|volume| {
                // Blocks first, then their sum: one order, whatever the threads.
                let blocks: Vec<Self> = (0..volume.blocks.len() as u32)
                    .into_par_iter()
                    .with_min_len(64)
                    .map(|block| of_block(volume, block))
                    .collect();
                blocks.iter().fold(Self::default(), add)
            })
            .fold(Self::default(), |a, b| add(a, &b))
    }
}

/// Counts the particles with an amplitude, as
/// [`count_classified`](super::count_classified) does.
pub fn count_amplitudes(volume: &BlockedVolume, views: &mut [BlockView], scale: f64) -> usize {
    count(&Amplitudes { volume, scale }, views)
}

/// Fills the particles of all views: the mass is the magnitude of the amplitude times `scale`,
/// the first channel of the colour its sign.
pub fn fill_amplitudes(
    volume: &BlockedVolume,
    views: &[BlockView],
    scale: f64,
    out: &mut [ClassifiedParticle],
) {
    fill(&Amplitudes { volume, scale }, 0, views, out);
}

struct Amplitudes<'a> {
    volume: &'a BlockedVolume,
    scale: f64,
}

impl Visit for Amplitudes<'_> {
    #[inline]
    fn visit(&self, block: u32, mut emit: impl FnMut(u32, f32, [f32; 3])) {
        visit(self.volume, block, |local, amplitude| {
            let scaled = (amplitude * self.scale) as f32;
            let mass = scaled.abs();
            if mass > 0.0 && mass.is_finite() {
                emit(local, mass, [1.0_f32.copysign(scaled), 0.0, 0.0]);
            }
        });
    }
}

/// Calls `each(local, amplitude)` for every particle of a block.
#[inline]
fn visit(volume: &BlockedVolume, block: u32, mut each: impl FnMut(u32, f64)) {
    let volumes = match &volume.strength {
        Strength::Mass(masses) => {
            volume.for_each_particle(block, |local, i, _| each(local, f64::from(masses[i])));
            return;
        }
        Strength::Classified { volumes } => volumes,
        // An opacity is no amount of anything; the frame refuses it.
        Strength::PeakOpacity { .. } | Strength::Surface(_) | Strength::Pane(_) => return,
    };
    let Some(values) = &volume.values else {
        return;
    };
    volume.for_each_particle(block, |local, i, cell| {
        let cell_volume = match cell {
            Some((grid, cell)) => grid.cell_volume_f64(cell),
            None => f64::from(volumes[i]),
        };
        each(local, f64::from(values.get(i)) * cell_volume);
    });
}
