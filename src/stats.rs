//! What a frame counted, and how long its stages took.

use std::time::Instant;

use serde::Serialize;

/// What a frame counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameCounts {
    /// Blocks of all volumes and of their levels of detail.
    pub blocks: usize,
    /// Blocks outside the view, transparent, or for whose particles others stand.
    pub blocks_culled: usize,
    /// Blocks that are drawn, by their filter: the place is that of
    /// [`Filter::ALL`](crate::splat::Filter::ALL), the first for blocks each of whose kernels was
    /// asked for itself.
    pub block_filters: [usize; 7],
    /// Of these, blocks of merged particles.
    pub blocks_merged: usize,
    /// Particles that the transfer function leaves visible, in the blocks that are left.
    pub classified: usize,
    /// Of these, those of volumes whose kernels were classified over their extents: a kernel is as many as
    /// lobes of the transfer function leave something of it.
    pub pieces: usize,
    /// Footprints that reach the image.
    pub footprints: usize,
    /// Of these, surfels of opaque surfaces.
    pub surfels: usize,
    /// Of these, on the exact path.
    pub footprints_exact: usize,
    /// Of these, kernels that cross the camera plane.
    pub footprints_near: usize,
    /// Entries of the tiles' lists.
    pub tile_entries: usize,
    /// Kernels evaluated at pixel centres within their cut-off.
    pub splat_pixels: u64,
}

/// Milliseconds per stage of a frame.
///
/// On the GPU the stages' are the device's own timestamps, 0 where the adapter has none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[allow(missing_docs, reason = "each is the stage of its name")]
pub struct StageTimes {
    pub cull: f64,
    pub classify: f64,
    pub project: f64,
    pub sort: f64,
    pub bin: f64,
    pub rasterise: f64,
    pub resolve: f64,
    /// The whole frame, as whoever asked for it waits.
    pub frame: f64,
}

/// What measures [`StageTimes`] on the processor. The standard library has no clock in a browser: times
/// are 0 there.
#[derive(Debug)]
pub(crate) struct Stopwatch(Option<Instant>);

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self((!cfg!(target_family = "wasm")).then(Instant::now))
    }

    /// Milliseconds since the last lap, or the start.
    pub(crate) fn lap(&mut self) -> f64 {
        let Some(last) = &mut self.0 else { return 0.0 };
        let now = Instant::now();
        let elapsed = now - std::mem::replace(last, now);
        elapsed.as_secs_f64() * 1e3
    }
}
