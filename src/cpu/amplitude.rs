//! Stage: computes the signed amplitude of each particle from its value. It takes the place of
//! [`classify`](super::classify()) for column densities, and uses no transfer function.
//!
//! An amplitude is a product of numbers that each fit f32; the product may not. So it is formed in f64
//! and narrowed relative to the largest amplitude of the scene.

use super::classify::{Visit, count, fill};
use crate::blocks::{BlockedVolume, visit_amplitudes};
use crate::record::{BlockView, Carried, ClassifiedParticle};

/// Counts the particles with an amplitude, as
/// [`count_classified`](super::count_classified) does.
pub fn count_amplitudes(volume: &BlockedVolume, views: &mut [BlockView], scale: f64) -> usize {
    count(&Amplitudes { volume, scale }, views)
}

/// Fills the particles of all views: the mass is the magnitude of the amplitude times `scale`, and the
/// particle carries the sign.
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
    fn visit(&self, view: &BlockView, mut emit: impl FnMut(u32, f32, Carried)) {
        visit_amplitudes(self.volume, view.block, |local, amplitude| {
            let scaled = (amplitude * self.scale) as f32;
            let mass = scaled.abs();
            if mass > 0.0 && mass.is_finite() {
                emit(local, mass, Carried::of_sign(1.0_f32.copysign(scaled)));
            }
        });
    }
}
