//! Determines the capacities of a pass: the amounts for which it has memory.

use super::kind::PassKind;
use super::report::Seen;
use crate::constants::TILE_SIZE;
use crate::error::{Error, Hint, Result};
use crate::gpu::device::Gpu;
use crate::gpu::project::near_bytes;
use crate::gpu::rasterise::slots_for;
use crate::gpu::scene::Scene;
use crate::record::Footprint;

/// Capacities, as the frames so far have needed them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Capacity {
    /// Classified particles of each part.
    pub(super) classified: Vec<u32>,
    /// Kernels that cross the camera plane, and those that the boundary of their domain cuts.
    pub(super) near: u32,
    /// True if kernels across the camera plane have been seen. Otherwise the rasteriser is compiled
    /// without code for them.
    pub(super) crossing: bool,
    /// Entries of the tiles' lists of a chunk.
    pub(super) entries: u32,
    /// Footprints of a depth chunk.
    pub(super) chunk: u32,
    /// True if exact footprints have been seen. Otherwise the rasteriser is compiled without code for
    /// them.
    pub(super) exact: bool,
    /// Greatest number of slabs that a kernel has reached.
    pub(super) layers: u32,
}

/// Initial capacity for classified particles of a part.
const FIRST_CLASSIFIED: u32 = 1 << 18;
/// The same for merged particles, of which a frame draws few.
const FIRST_MERGED: u32 = 1 << 14;
const FIRST_ENTRIES: u32 = 1 << 20;

/// Greatest number of entries of a chunk's lists: 1 GiB of them. Beyond it, a frame takes smaller chunks.
/// This also bounds the time of one submission, for systems that abort submissions after seconds.
fn entries_limit(binding_bytes: u64) -> u64 {
    (binding_bytes / 4).min(1 << 26)
}

impl Capacity {
    /// Returns the capacities before any frame was drawn.
    pub(super) fn first(scene: &Scene, binding_bytes: u64) -> Self {
        let classified = scene.parts.iter().map(|part| {
            let all = part.slots as u32;
            // All particles are visible if nothing is classified.
            if part.kinds.is_merged {
                all.min(FIRST_MERGED)
            } else if part.kinds.may_be_transparent() {
                all.min(FIRST_CLASSIFIED)
            } else {
                all
            }
        });
        Self {
            classified: classified.collect(),
            near: 0,
            crossing: false,
            entries: FIRST_ENTRIES.min(entries_limit(binding_bytes) as u32),
            chunk: chunk_limit(binding_bytes),
            exact: false,
            layers: 0,
        }
    }

    /// Returns the capacities that a frame would have needed; equal to these if they sufficed.
    ///
    /// - `kind`, `seen`: kind and report of the frame.
    ///
    /// # Errors
    /// More than the device's bindings hold.
    pub(super) fn grown(
        &self,
        gpu: &Gpu,
        scene: &Scene,
        kind: &PassKind,
        seen: &Seen,
    ) -> Result<Self> {
        let limit = gpu.max_binding_bytes();
        let mut grown = self.clone();
        let parts = scene.drawn(&mut grown.classified, kind.detail);
        for ((part, classified), state) in parts.zip(&seen.parts) {
            if state.needed > *classified {
                *classified = with_slack(state.needed, part.most_classified());
            }
        }
        if grown.classified != self.classified {
            // The later stages have not processed all particles.
            return Ok(grown);
        }
        let [listed, crossing] = seen.near;
        if listed > grown.near {
            let most = (limit - near_bytes(0)) / (near_bytes(1) - near_bytes(0));
            grown.near = with_slack(listed, most);
            let what = "kernels across the camera plane or cut by the boundary";
            check(gpu, what, listed, most)?;
        }
        grown.crossing |= crossing > 0;
        if seen.sort.exact > 0 {
            grown.exact = true;
        }
        let layers = seen.tiles.layers_needed;
        let is_lit = kind.axes.has_slopes();
        if kind.axes.accumulate.cuts_slabs() && layers > slots_for(gpu, is_lit, grown.layers) {
            let most = slots_for(gpu, is_lit, layers);
            check(gpu, "slabs that a kernel reaches", layers, most.into())?;
            grown.layers = layers;
        }
        if seen.needed_entries > grown.entries {
            let most = entries_limit(limit);
            if u64::from(seen.needed_entries) <= most {
                grown.entries = with_slack(seen.needed_entries, most);
            } else {
                // Fewer footprints at a time, because each touches many tiles.
                let chunk = grown.chunk.min(seen.sort.visible);
                if chunk <= 1 {
                    check(gpu, "entries of one footprint", seen.needed_entries, most)?;
                }
                let share = u64::from(chunk) * most / u64::from(seen.needed_entries);
                grown.chunk = (share as u32).min(chunk / 2).max(1);
                grown.entries = most as u32;
            }
        }
        Ok(grown)
    }

    /// Returns the capacity for classified particles over all parts that frames of a kind draw.
    pub(super) fn all_classified(&self, scene: &Scene, kind: &PassKind) -> u64 {
        let capacities = scene.drawn(self.classified.iter().copied(), kind.detail);
        capacities.map(|(_, n)| u64::from(n)).sum()
    }
}

/// Returns `needed` plus an eighth, so that the next frame fits as well.
fn with_slack(needed: u32, most: u64) -> u32 {
    let wanted = u64::from(needed) + u64::from(needed) / 8 + 64;
    wanted
        .min(most)
        .max(u64::from(needed))
        .min(u64::from(u32::MAX)) as u32
}

fn check(gpu: &Gpu, what: &str, needed: u32, most: u64) -> Result<()> {
    if u64::from(needed) <= most {
        return Ok(());
    }
    Err(Error::Unsupported {
        place: gpu.adapter(),
        expected: format!("at most {most} {what}"),
        found: needed.to_string(),
        advice: Hint::UseCpu.into(),
    })
}

/// Returns the greatest number of footprints of a depth chunk. Their buffer must fit a binding, and their
/// splat-pixels must fit a tile's count, which has 32 bits for all its pixels.
fn chunk_limit(binding_bytes: u64) -> u32 {
    const COUNTABLE: u64 = u32::MAX as u64 / (TILE_SIZE * TILE_SIZE) as u64;
    let footprints = binding_bytes / size_of::<Footprint>() as u64;
    footprints.clamp(1, COUNTABLE) as u32
}
