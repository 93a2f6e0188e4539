//! A pixel that is asked about.

use ewa_splat::render::Picked;
use glam::DVec3;

/// A pixel that was asked about, and what lies under it.
#[derive(Debug, Clone)]
pub(crate) struct Probe {
    pub(crate) pixel: [usize; 2],
    /// Whether the camera is to look at it.
    pub(crate) recentres: bool,
    pub(crate) found: Option<Found>,
}

/// The particle that a pixel shows most of, and where half of its light is gone.
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

    /// Takes what was found.
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
