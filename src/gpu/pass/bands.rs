//! Divides the image into bands of rows of tiles, and the sorted footprints into depth chunks.

use crate::constants::TILE_SIZE;

/// The image in bands of rows of tiles, the same for all passes.
#[derive(Debug, Clone, Copy)]
pub(in crate::gpu) struct Bands {
    /// Width and height of the image.
    pub(in crate::gpu) size: [u32; 2],
    /// Columns and rows of tiles of the image.
    pub(in crate::gpu) tiles: [u32; 2],
    /// Rows of tiles of a band.
    pub(in crate::gpu) rows: u32,
}

impl Bands {
    /// Returns the number of bands.
    pub(in crate::gpu) fn count(&self) -> u32 {
        self.tiles[1].div_ceil(self.rows)
    }

    /// Returns the first row of tiles of a band, and the number of its rows.
    pub(in crate::gpu) fn band(&self, band: u32) -> (u32, u32) {
        let first = band * self.rows;
        (first, self.rows.min(self.tiles[1] - first))
    }

    /// Returns the number of pixels of the image in a band.
    pub(in crate::gpu) fn pixels(&self, band: u32) -> u32 {
        let [width, height] = self.size;
        let tile = TILE_SIZE as u32;
        let (first_row, rows) = self.band(band);
        width * (rows * tile).min(height - first_row * tile)
    }

    /// Returns the number of pixels of the largest band.
    pub(in crate::gpu) fn most_pixels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.rows) * TILE_SIZE as u64
    }
}

/// Division of a pass of a frame: bands and chunks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cuts {
    pub(super) bands: Bands,
    /// Footprints of a chunk.
    pub(super) chunk: u32,
    /// Number of chunks that hold all footprints in memory.
    pub(super) chunks: u32,
}

impl Cuts {
    /// Divides a pass.
    ///
    /// - `capacity`: greatest number of classified particles in memory.
    /// - `chunk`: greatest number of footprints of a chunk.
    pub(super) fn new(bands: Bands, capacity: u64, chunk: u32) -> Self {
        let chunk = u64::from(chunk).min(capacity).max(1);
        Self {
            bands,
            chunk: chunk as u32,
            // At least one chunk: it clears the image.
            chunks: capacity.div_ceil(chunk).max(1) as u32,
        }
    }

    /// Returns the number of steps of a frame: chunks of bands.
    pub(super) fn steps(&self) -> u64 {
        u64::from(self.bands.count()) * u64::from(self.chunks)
    }
}
