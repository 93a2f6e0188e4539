//! Summarises amplitudes, which column densities sum.

use std::ops::Range;

use rayon::prelude::*;

use crate::blocks::volume::BlockedVolume;
use crate::scene::StrengthIn;

/// Summary of the amplitudes of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AmplitudeSummary {
    /// The largest magnitude.
    pub largest: f64,
    /// The sum, signs kept.
    pub sum: f64,
    /// Number of particles whose amplitude is not finite.
    pub not_finite: usize,
}

impl AmplitudeSummary {
    /// Combines several summaries, in their order.
    pub(crate) fn joined(summaries: impl IntoIterator<Item = Self>) -> Self {
        summaries
            .into_iter()
            .fold(Self::default(), |a, b| a.and(&b))
    }

    /// Summarises all volumes of a scene.
    pub fn of<'a>(volumes: impl Iterator<Item = &'a BlockedVolume>) -> Self {
        Self::joined(volumes.map(|v| Self::of_blocks(v, 0..v.blocks.len() as u32)))
    }

    /// Combines two summaries.
    pub(crate) fn and(self, other: &Self) -> Self {
        Self {
            largest: self.largest.max(other.largest),
            sum: self.sum + other.sum,
            not_finite: self.not_finite + other.not_finite,
        }
    }

    /// Summarises some blocks of a volume.
    pub(crate) fn of_blocks(volume: &BlockedVolume, blocks: Range<u32>) -> Self {
        let of_block = |volume: &BlockedVolume, block: u32| {
            let mut summary = Self::default();
            visit_amplitudes(volume, block, |_, amplitude| {
                if amplitude.is_finite() {
                    summary.largest = summary.largest.max(amplitude.abs());
                    summary.sum += amplitude;
                } else {
                    summary.not_finite += 1;
                }
            });
            summary
        };
        // Blocks first, then their sum: the order does not depend on the threads.
        let blocks: Vec<Self> = blocks
            .into_par_iter()
            .with_min_len(64)
            .map(|block| of_block(volume, block))
            .collect();
        Self::joined(blocks)
    }
}

/// Calls `each(local, amplitude)` for every particle of a block.
#[inline]
pub(crate) fn visit_amplitudes(volume: &BlockedVolume, block: u32, mut each: impl FnMut(u32, f64)) {
    let volumes = match &volume.strength {
        StrengthIn::Mass(masses) => {
            volume.for_each_particle(block, |local, i, _| each(local, f64::from(masses[i])));
            return;
        }
        StrengthIn::Classified { volumes } => volumes,
        // An opacity is not an amount of anything; the frame refuses it.
        StrengthIn::PeakOpacity { .. } | StrengthIn::Surface(_) | StrengthIn::Translucent(_) => {
            return;
        }
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
