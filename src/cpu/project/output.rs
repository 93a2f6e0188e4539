//! What a projection writes besides footprints.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::record::NearTerms;

/// What the projection of one frame writes besides footprints.
#[derive(Debug, Default)]
pub struct ProjectOutput {
    pub(super) near: Mutex<Vec<NearTerms>>,
    /// How many of them are edges alone.
    pub(super) cut_count: AtomicUsize,
    pub(super) exact_count: AtomicUsize,
    pub(super) tile_count: AtomicU64,
}

impl ProjectOutput {
    /// What was found elsewhere.
    pub(crate) fn of(near: Vec<NearTerms>, exact_count: usize, tile_count: u64) -> Self {
        Self {
            near: Mutex::new(near),
            cut_count: AtomicUsize::default(),
            exact_count: exact_count.into(),
            tile_count: tile_count.into(),
        }
    }

    /// Forgets the last frame.
    pub fn clear(&mut self) {
        self.near
            .get_mut()
            .unwrap_or_else(PoisonError::into_inner)
            .clear();
        *self.cut_count.get_mut() = 0;
        *self.exact_count.get_mut() = 0;
        *self.tile_count.get_mut() = 0;
    }

    /// Terms of the kernels that cross the camera plane, few, and of those that the domain of their data
    /// cuts, in no particular order.
    pub fn near(&mut self) -> &[NearTerms] {
        self.near.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// How many kernels cross the camera plane.
    pub fn near_count(&mut self) -> usize {
        let cut = *self.cut_count.get_mut();
        self.near().len() - cut
    }

    /// How many footprints that reach the image are on the exact path.
    pub fn exact_count(&self) -> usize {
        self.exact_count.load(Ordering::Relaxed)
    }

    /// How many tiles the footprints' boxes touch, all together: no fewer than lists have entries.
    pub fn tile_count(&self) -> u64 {
        self.tile_count.load(Ordering::Relaxed)
    }
}
