//! Reads the report of a pass of a frame back to the host.

use std::mem::offset_of;

use wgpu::CommandEncoder;

use crate::error::Result;
use crate::gpu::device::Gpu;
use crate::gpu::tile::TileProgress;
use crate::record::{ChunkState, FrameState, PartState, SortState};
use crate::splat::Filter;

/// The report of a pass of a frame.
#[derive(Debug)]
pub(in crate::gpu) struct Seen {
    pub(super) parts: Vec<PartState>,
    pub(super) sort: SortState,
    /// Number of terms in the list of near kernels, and number of kernels that cross the camera plane.
    pub(super) near: [u32; 2],
    /// Number of views with each filter.
    pub(super) filters: [u32; Filter::ALL.len()],
    pub(super) needed_entries: u32,
    pub(super) entries: u64,
    pub(super) tiles: TileCounts,
}

/// Counts of the tiles of a pass.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::gpu) struct TileCounts {
    pub(super) splat_pixels: u64,
    /// Greatest number of layers that a kernel needed open at once.
    pub(super) layers_needed: u32,
}

/// Bytes of [`FrameState::filters`].
const FILTER_BYTES: u64 = 4 * Filter::ALL.len() as u64;

/// Offsets of the sections of a report, bytes; parts come first.
#[derive(Debug)]
struct Places {
    sort: u64,
    near: u64,
    filters: u64,
    chunks: u64,
    end: u64,
}

impl Places {
    /// Lays out a report.
    ///
    /// - `parts`: number of parts; `steps`: chunks of bands.
    fn new(parts: usize, steps: u64) -> Self {
        let sort = (parts * size_of::<PartState>()) as u64;
        let near = sort + size_of::<SortState>() as u64;
        let filters = near + 8;
        let chunks = filters + FILTER_BYTES;
        Self {
            sort,
            near,
            filters,
            chunks,
            end: chunks + steps * size_of::<ChunkState>() as u64,
        }
    }
}

/// Buffers that the host reads after a frame.
#[derive(Debug)]
pub(super) struct Report {
    parts: usize,
    places: Places,
    counts: wgpu::Buffer,
    /// A [`TileProgress`] per tile of a band.
    tiles: wgpu::Buffer,
}

impl Report {
    /// Makes the buffers.
    ///
    /// - `parts`: number of parts of the pass; `steps`: chunks of bands; `tiles`: greatest number of
    ///   tiles of a band.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn new(gpu: &Gpu, parts: usize, steps: u64, tiles: u32) -> Result<Self> {
        let places = Places::new(parts, steps);
        let tile_bytes = u64::from(tiles) * size_of::<TileProgress>() as u64;
        Ok(Self {
            parts,
            counts: gpu.staging("report", places.end)?,
            tiles: gpu.staging("tiles", tile_bytes)?,
            places,
        })
    }

    /// Encodes the copy of the counts of the stages up to the sort.
    ///
    /// - `parts`: a [`PartState`] each; `near`: its first two words are counts.
    pub(super) fn encode_counts<'a>(
        &self,
        encoder: &mut CommandEncoder,
        parts: impl Iterator<Item = &'a wgpu::Buffer>,
        sort: &wgpu::Buffer,
        near: &wgpu::Buffer,
        frame: &wgpu::Buffer,
    ) {
        let to = &self.counts;
        let bytes = size_of::<PartState>() as u64;
        for (i, part) in (0..).zip(parts) {
            encoder.copy_buffer_to_buffer(part, 0, to, bytes * i, bytes);
        }
        let bytes = size_of::<SortState>() as u64;
        encoder.copy_buffer_to_buffer(sort, 0, to, self.places.sort, bytes);
        encoder.copy_buffer_to_buffer(near, 0, to, self.places.near, 8);
        let filters = offset_of!(FrameState, filters) as u64;
        encoder.copy_buffer_to_buffer(frame, filters, to, self.places.filters, FILTER_BYTES);
    }

    /// Encodes the copy of a step's counts: the chunk's [`ChunkState`].
    pub(super) fn encode_step(
        &self,
        encoder: &mut CommandEncoder,
        step: u64,
        state: &wgpu::Buffer,
    ) {
        let bytes = size_of::<ChunkState>() as u64;
        let place = self.places.chunks + step * bytes;
        encoder.copy_buffer_to_buffer(state, 0, &self.counts, place, bytes);
    }

    /// Encodes the copy of the counts of a band's tiles.
    pub(super) fn encode_tiles(&self, encoder: &mut CommandEncoder, progress: &wgpu::Buffer) {
        encoder.copy_buffer_to_buffer(progress, 0, &self.tiles, 0, progress.size());
    }

    /// Adds the counts of the tiles of the last band drawn.
    ///
    /// # Errors
    /// A lost device.
    pub(super) async fn read_tiles(
        &self,
        gpu: &Gpu,
        tiles: u32,
        counts: &mut TileCounts,
    ) -> Result<()> {
        gpu.read_staging(&self.tiles, |bytes| {
            let tiles = bytes
                .chunks_exact(size_of::<TileProgress>())
                .take(tiles as usize);
            for tile in tiles.map(|tile| at::<TileProgress>(tile, 0)) {
                counts.splat_pixels += tile.splat_pixels();
                counts.layers_needed = counts.layers_needed.max(tile.layers_needed);
            }
        })
        .await
    }

    /// Reads the report of the pass, after all bands are drawn.
    ///
    /// # Errors
    /// A lost device.
    pub(super) async fn read(&self, gpu: &Gpu, tiles: TileCounts) -> Result<Seen> {
        let places = &self.places;
        gpu.read_staging(&self.counts, |report| {
            let parts = (0..self.parts).map(|i| at(report, (i * size_of::<PartState>()) as u64));
            let states = report[places.chunks as usize..places.end as usize]
                .chunks_exact(size_of::<ChunkState>())
                .map(|state| at::<ChunkState>(state, 0));
            Seen {
                parts: parts.collect(),
                sort: at(report, places.sort),
                near: at(report, places.near),
                filters: at(report, places.filters),
                needed_entries: states.clone().map(|s| s.needed).max().unwrap_or(0),
                entries: states.map(|s| u64::from(s.entries)).sum(),
                tiles,
            }
        })
        .await
    }
}

/// Returns the value of type T at a byte of a report.
fn at<T: bytemuck::Pod>(report: &[u8], place: u64) -> T {
    bytemuck::pod_read_unaligned(&report[place as usize..][..size_of::<T>()])
}
