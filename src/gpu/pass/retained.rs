//! Keeps the data of a pass from frame to frame: its volumes on the device, and the capacities that its
//! frames need.

use super::capacity::Capacity;
use super::kind::PassKind;
use super::report::Seen;
use crate::blocks::BlockedScene;
use crate::constants::TILE_SIZE;
use crate::error::{Error, Hint, Result};
use crate::frame::plan::Draws;
use crate::gpu::bin::MAX_BAND_TILES;
use crate::gpu::device::Gpu;
use crate::gpu::rasterise::{RasterSpec, slice_of, slots_for};
use crate::gpu::scene::Scene;
use crate::gpu::surface::SurfaceSpec;
use crate::record::PartState;
use crate::splat::Axes;
use crate::stats::FrameCounts;

/// The volumes of a pass on a device, and the capacities that its frames need.
#[derive(Debug)]
pub(in crate::gpu) struct Pass {
    pub(in crate::gpu) draws: Draws,
    /// True if its pixels are the picture, as for surfaces without volumes.
    is_picture: bool,
    pub(in crate::gpu) scene: Scene,
    pub(super) capacity: Capacity,
}

impl Pass {
    /// Uploads the volumes that the pass draws.
    ///
    /// # Errors
    /// Too little memory on the device, or volumes that only the CPU draws.
    pub(in crate::gpu) fn new(
        gpu: &Gpu,
        draws: Draws,
        is_picture: bool,
        scene: &BlockedScene,
    ) -> Result<Self> {
        let limit = gpu.max_binding_bytes();
        let scene = Scene::new(gpu, scene.volumes(), |volume| draws.draws(volume), limit)?;
        Ok(Self {
            draws,
            is_picture,
            capacity: Capacity::first(&scene, limit),
            scene,
        })
    }

    /// Resets the capacities to their initial values.
    pub(in crate::gpu) fn forget_capacity(&mut self, gpu: &Gpu) {
        self.capacity = Capacity::first(&self.scene, gpu.max_binding_bytes());
    }

    /// Adopts the capacities that a frame would have needed. Returns whether they have grown.
    ///
    /// # Errors
    /// More than the device's bindings hold.
    pub(in crate::gpu) fn grow(&mut self, gpu: &Gpu, kind: &PassKind, seen: &Seen) -> Result<bool> {
        let capacity = self.capacity.grown(gpu, &self.scene, kind, seen)?;
        let is_more = capacity != self.capacity;
        self.capacity = capacity;
        Ok(is_more)
    }

    /// Adds a frame's counts to `counts`.
    pub(in crate::gpu) fn count(&self, kind: &PassKind, seen: &Seen, counts: &mut FrameCounts) {
        let sum = |of: fn(&PartState) -> u32| -> usize {
            seen.parts.iter().map(|p| of(p) as usize).sum()
        };
        let parts = self.scene.drawn(0.., kind.detail).zip(&seen.parts);
        let pieces = self.scene.drawn(0.., kind.detail).zip(&seen.parts);
        let pieces = pieces.filter(|((part, _), _)| part.has_pieces(kind.classified_by));
        counts.pieces += pieces
            .map(|(_, state)| state.classified_count as usize)
            .sum::<usize>();
        let merged = parts.filter(|((part, _), _)| part.kinds.is_merged);
        let visible = seen.sort.visible as usize;
        counts.blocks_culled -= sum(|p| p.view_count);
        for (filter, n) in counts.block_filters.iter_mut().zip(seen.filters) {
            *filter += n as usize;
        }
        counts.blocks_merged += merged
            .map(|(_, state)| state.view_count as usize)
            .sum::<usize>();
        counts.classified += sum(|p| p.classified_count);
        counts.footprints += visible;
        counts.surfels += if self.is_surface() { visible } else { 0 };
        counts.footprints_exact += seen.sort.exact as usize;
        counts.footprints_near += seen.near[1] as usize;
        counts.tile_entries += seen.entries as usize;
        counts.splat_pixels += seen.tiles.splat_pixels;
    }

    fn is_surface(&self) -> bool {
        self.draws == Draws::Surfaces
    }

    /// Returns the variant of the rasteriser.
    pub(super) fn raster(&self, gpu: &Gpu, kind: &PassKind) -> Raster {
        let near = self.capacity.crossing;
        if self.is_surface() {
            return Raster::Surface(SurfaceSpec {
                near,
                normals: kind.axes.normals,
                count: kind.axes.count,
                clip: kind.axes.interval.is_cut(),
                ends: kind.axes.ends,
                is_picture: self.is_picture,
            });
        }
        let spec = RasterSpec {
            axes: Axes {
                may_be_exact: self.capacity.exact && kind.axes.may_be_exact,
                ..kind.axes
            },
            near,
            slots: if kind.axes.accumulate.cuts_slabs() {
                slots_for(gpu, kind.axes.has_slopes(), self.capacity.layers)
            } else {
                1
            },
            carries: false,
        };
        Raster::Volumes(RasterSpec {
            carries: self.capacity.all_classified(&self.scene, kind)
                > slice_of(gpu, &spec).min(self.capacity.chunk).into(),
            ..spec
        })
    }

    /// Returns the number of rows of tiles of an image whose pixels fit a binding.
    ///
    /// # Errors
    /// Not even one row fits.
    pub(in crate::gpu) fn band_rows(&self, gpu: &Gpu, kind: &PassKind) -> Result<u32> {
        let tile = TILE_SIZE as u32;
        let [columns, tile_rows] = kind.size.map(|n| n.div_ceil(tile));
        let words = match self.raster(gpu, kind) {
            Raster::Surface(spec) => spec.layer_words().max(spec.pixel_words()),
            Raster::Volumes(spec) => spec.pixel_words(),
        };
        let row_bytes = 4 * words * u64::from(kind.size[0]) * u64::from(tile);
        let rows = gpu.max_binding_bytes() / row_bytes;
        let rows = rows.min(u64::from(MAX_BAND_TILES / columns));
        if rows == 0 {
            return Err(Error::Unsupported {
                place: gpu.adapter(),
                expected: format!(
                    "rows of tiles of at most {} bytes, what a binding holds",
                    gpu.max_binding_bytes()
                ),
                found: format!("{row_bytes} bytes for one of {} pixels", kind.size[0]),
                advice: Hint::NarrowerImageOrCpu.into(),
            });
        }
        Ok(rows.min(tile_rows.into()) as u32)
    }
}

/// A variant of a rasteriser.
#[derive(Debug, Clone, Copy)]
pub(super) enum Raster {
    Surface(SurfaceSpec),
    Volumes(RasterSpec),
}
