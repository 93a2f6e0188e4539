//! Defines the probe of a pixel.

use ewa_splat::render::Picked;
use glam::DVec3;

/// Probed pixel, and what lies under it.
#[derive(Debug, Clone)]
pub(crate) struct Probe {
    pub(crate) pixel: [usize; 2],
    /// True if the camera is to be centred on the point found.
    pub(crate) recentres: bool,
    pub(crate) found: Option<Found>,
}

/// Particle that contributes most to a pixel, and the depth at which half of the light is absorbed.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub(crate) volume: usize,
    pub(crate) particle: usize,
    pub(crate) position: DVec3,
    pub(crate) value: Option<f32>,
    pub(crate) share: f32,
    pub(crate) count: usize,
}

impl Probe {
    pub(crate) fn asked(pixel: [usize; 2], recentres: bool) -> Self {
        Self {
            pixel,
            recentres,
            found: None,
        }
    }

    /// Stores the result.
    pub(crate) fn answer(&mut self, picked: &[Picked]) {
        let most = picked.iter().max_by(|a, b| a.share.total_cmp(&b.share));
        self.found = most.map(|most| Found {
            volume: most.volume,
            particle: most.particle,
            position: most.position,
            value: most.value,
            share: most.share,
            count: picked.len(),
        });
    }
}
