//! The image in bands of rows of tiles, and the sorted footprints in depth chunks.

use crate::constants::TILE_SIZE;

/// The image in bands of rows of tiles, those of all passes alike.
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
    /// How many there are.
    pub(in crate::gpu) fn count(&self) -> u32 {
        self.tiles[1].div_ceil(self.rows)
    }

    /// First row of tiles and rows of a band.
    pub(in crate::gpu) fn band(&self, band: u32) -> (u32, u32) {
        let first = band * self.rows;
        (first, self.rows.min(self.tiles[1] - first))
    }

    /// Pixels of the image in a band.
    pub(in crate::gpu) fn pixels(&self, band: u32) -> u32 {
        let [width, height] = self.size;
        let tile = TILE_SIZE as u32;
        let (first_row, rows) = self.band(band);
        width * (rows * tile).min(height - first_row * tile)
    }

    /// Pixels of the largest band.
    pub(in crate::gpu) fn most_pixels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.rows) * TILE_SIZE as u64
    }
}

/// How a pass of a frame is cut: bands of chunks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cuts {
    pub(super) bands: Bands,
    /// Footprints of a chunk.
    pub(super) chunk: u32,
    /// Chunks that hold all footprints that there is memory for.
    pub(super) chunks: u32,
}

impl Cuts {
    /// - `capacity`: classified particles that there is memory for.
    /// - `chunk`: footprints of a chunk at most.
    pub(super) fn new(bands: Bands, capacity: u64, chunk: u32) -> Self {
        let chunk = u64::from(chunk).min(capacity).max(1);
        Self {
            bands,
            chunk: chunk as u32,
            // One at least: it clears the image.
            chunks: capacity.div_ceil(chunk).max(1) as u32,
        }
    }

    /// Steps of a frame: chunks of bands.
    pub(super) fn steps(&self) -> u64 {
        u64::from(self.bands.count()) * u64::from(self.chunks)
    }
}
