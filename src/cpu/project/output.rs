//! Collects the results of a projection other than footprints.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::record::NearTerms;

/// Results of one frame's projection other than footprints.
#[derive(Debug, Default)]
pub struct ProjectOutput {
    pub(super) near: Mutex<Vec<NearTerms>>,
    /// Number of near terms that contain only edges.
    pub(super) cut_count: AtomicUsize,
    pub(super) exact_count: AtomicUsize,
    pub(super) tile_count: AtomicU64,
}

impl ProjectOutput {
    /// Wraps results that were computed elsewhere.
    pub(crate) fn of(near: Vec<NearTerms>, exact_count: usize, tile_count: u64) -> Self {
        Self {
            near: Mutex::new(near),
            cut_count: AtomicUsize::default(),
            exact_count: exact_count.into(),
            tile_count: tile_count.into(),
        }
    }

    /// Clears the results of the last frame.
    pub fn clear(&mut self) {
        self.near
            .get_mut()
            .unwrap_or_else(PoisonError::into_inner)
            .clear();
        *self.cut_count.get_mut() = 0;
        *self.exact_count.get_mut() = 0;
        *self.tile_count.get_mut() = 0;
    }

    /// Returns the terms of the kernels that cross the camera plane, and of the kernels that the boundary
    /// of their domain cuts, in no particular order. There are few of them.
    pub fn near(&mut self) -> &[NearTerms] {
        self.near.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the number of kernels that cross the camera plane.
    pub fn near_count(&mut self) -> usize {
        let cut = *self.cut_count.get_mut();
        self.near().len() - cut
    }

    /// Returns the number of visible footprints on the exact path.
    pub fn exact_count(&self) -> usize {
        self.exact_count.load(Ordering::Relaxed)
    }

    /// Returns the total number of tiles that the footprints' boxes touch: an upper bound of the lists'
    /// entries.
    pub fn tile_count(&self) -> u64 {
        self.tile_count.load(Ordering::Relaxed)
    }
}
