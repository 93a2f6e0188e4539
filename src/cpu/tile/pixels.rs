//! Defines the pixels of a tile: their planes, their positions, and the pixels that a footprint meets.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

use crate::constants::{TILE_PIXELS, TILE_SIZE};
use crate::record::{Footprint, ViewUniform};

/// One float per pixel of a tile.
pub(super) type Plane = [f32; TILE_PIXELS];

/// One float per pixel of a row.
pub(super) type RowOf<T> = [T; TILE_SIZE];

/// Footprints between the prefetch of one and its use.
pub(super) const PREFETCH: usize = 8;

/// Prefetches the cache line of a footprint, or of its terms. Footprints are stored in the order of
/// particles and read in the order of depth. Without prefetching, waiting for memory takes a quarter of
/// binning and rasterising.
#[inline(always)]
pub(in crate::cpu) fn prefetch<T>(what: Option<&T>) {
    #[cfg(target_arch = "x86_64")]
    if let Some(what) = what {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: the address is a reference's, and a prefetch reads nothing.
        #[allow(unsafe_code, reason = "the intrinsic takes a raw pointer")]
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(what).cast());
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = what;
}

/// A raster tile, one array per channel, rows from the top.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Tile {
    /// Accumulated opacity. Opacity rather than transmittance: it starts at zero, where f32 is
    /// fine enough for a hundred thousand layers of 1e-8.
    pub alpha: [f32; TILE_PIXELS],
    /// Accumulated linear colour, premultiplied.
    pub red: [f32; TILE_PIXELS],
    /// Green.
    pub green: [f32; TILE_PIXELS],
    /// Blue.
    pub blue: [f32; TILE_PIXELS],
    /// Depth at which the opacity passed one half.
    pub depth: [f32; TILE_PIXELS],
}

impl Default for Tile {
    fn default() -> Self {
        Self {
            alpha: [0.0; TILE_PIXELS],
            red: [0.0; TILE_PIXELS],
            green: [0.0; TILE_PIXELS],
            blue: [0.0; TILE_PIXELS],
            depth: [f32::INFINITY; TILE_PIXELS],
        }
    }
}

impl Tile {
    /// Clears the tile.
    ///
    /// - `has_depth`: whether depths are written.
    pub(super) fn clear(&mut self, has_depth: bool) {
        self.alpha.fill(0.0);
        self.red.fill(0.0);
        self.green.fill(0.0);
        self.blue.fill(0.0);
        if has_depth {
            self.depth.fill(f32::INFINITY);
        }
    }
}

/// Returns the ray D = (X, Y, 1) through a point of the image.
#[inline]
pub(super) fn ray(view: &ViewUniform, pixel: Vec2) -> Vec3 {
    ((pixel - Vec2::from(view.centre_px)) / Vec2::from(view.focal_px)).extend(1.0)
}

/// Position of a tile of `SIZE`² pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct TilePlace<'a, const SIZE: usize = TILE_SIZE> {
    pub(super) view: &'a ViewUniform,
    /// The tile's first pixel.
    pub(super) origin: [usize; 2],
}

/// The pixels of a tile that a footprint meets: columns and rows of the tile, half-open.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    pub(super) columns: [usize; 2],
    pub(super) rows: [usize; 2],
}

impl<'a, const SIZE: usize> TilePlace<'a, SIZE> {
    /// Returns the position of tile `t` of an image with `columns` tiles in a row.
    pub(super) fn new(view: &'a ViewUniform, t: usize, columns: usize) -> Self {
        Self {
            view,
            origin: [t % columns * SIZE, t / columns * SIZE],
        }
    }

    /// Returns the centre of a pixel of the tile along an axis; it is exact.
    #[inline(always)]
    pub(super) fn px(&self, axis: usize, i: usize) -> f32 {
        (self.origin[axis] + i) as f32 + 0.5
    }

    /// Returns the centre of the pixel in a column and a row of the tile.
    #[inline(always)]
    pub(super) fn centre(&self, x: usize, y: usize) -> Vec2 {
        Vec2::new(self.px(0, x), self.px(1, y))
    }

    /// Returns the centre of a pixel of the tile.
    pub(super) fn pixel(&self, i: usize) -> Vec2 {
        self.centre(i % SIZE, i / SIZE)
    }

    /// Returns the column and the row of a pixel of the tile in the image.
    pub(super) fn at(&self, i: usize) -> [usize; 2] {
        [self.origin[0] + i % SIZE, self.origin[1] + i / SIZE]
    }

    /// Returns the number of columns of the tile in the image.
    pub(super) fn width(&self) -> usize {
        (self.view.size[0] as usize)
            .saturating_sub(self.origin[0])
            .min(SIZE)
    }

    /// Returns the number of rows of the tile in the image.
    pub(super) fn height(&self) -> usize {
        (self.view.size[1] as usize)
            .saturating_sub(self.origin[1])
            .min(SIZE)
    }

    /// Returns the tile's pixels in the image.
    pub(super) fn pixels(&self) -> impl Iterator<Item = usize> + use<SIZE> {
        let (width, height) = (self.width(), self.height());
        (0..height).flat_map(move |y| y * SIZE..y * SIZE + width)
    }

    /// Returns the pixels of the tile that a footprint meets.
    #[inline]
    pub(super) fn patch(&self, footprint: &Footprint) -> Patch {
        let clip = |(first, end): (u32, u32), i: usize| {
            let first = (first as usize).max(self.origin[i]) - self.origin[i];
            let end = (end as usize).min(self.origin[i] + SIZE);
            [first, end.saturating_sub(self.origin[i])]
        };
        Patch {
            columns: clip(footprint.column_range(), 0),
            rows: clip(footprint.row_range(), 1),
        }
    }
}

impl Patch {
    /// Returns whether it contains no pixel.
    pub(super) fn is_empty(&self) -> bool {
        self.columns[0] >= self.columns[1] || self.rows[0] >= self.rows[1]
    }
}

/// Adds numbers times a factor to the pixels from `first` on.
#[inline(always)]
pub(super) fn add_scaled(plane: &mut Plane, first: usize, numbers: &RowOf<f32>, factor: f32) {
    if let Some(sums) = plane[first..].first_chunk_mut::<TILE_SIZE>() {
        // Copies: if the memory might alias, the numbers would be added one by one.
        let (mut row, numbers) = (*sums, *numbers);
        for lane in 0..TILE_SIZE {
            row[lane] += numbers[lane] * factor;
        }
        *sums = row;
    }
}

/// Counts a kernel at the pixels that evaluated it, in all three colours.
#[inline(always)]
pub(super) fn count_row(tile: &mut Tile, first: usize, inside: &RowOf<u32>) {
    let inside = inside.map(|is| is as f32);
    for plane in [&mut tile.red, &mut tile.green, &mut tile.blue] {
        add_scaled(plane, first, &inside, 1.0);
    }
}
