//! Defines the parts that the rasterisers of kernels and of surfels share. Tiles are drawn slice by
//! slice, and their pixels are carried from one chunk of footprints to the next.

use bytemuck::{Pod, Zeroable};

use super::constants::NO_DEPTH;
use super::device::Gpu;
use super::kernel::BoundKernel;
use crate::error::Result;
use crate::record::{ChunkUniform, NearTerms};

/// A tile's pixels and its progress.
pub(super) const PIXELS: &str = include_str!("../../shaders/tile/pixels.wgsl");
/// Footprints as the rasterisers read them.
pub(super) const FOOTPRINT: &str = include_str!("../../shaders/tile/footprint.wgsl");
/// Planes that clip.
pub(super) const CLIP: &str = include_str!("../../shaders/shared/clip.wgsl");
/// The rasterisers' main function.
pub(super) const RASTERISE: &str = include_str!("../../shaders/rasterise.wgsl");

/// State of a tile that is carried from one chunk of footprints to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TileProgress {
    pub(super) drawn: u32,
    pub(super) hidden: u32,
    pub(super) splat_pixels: [u32; 2],
    pub(super) first_layer: u32,
    pub(super) layers_needed: u32,
}

impl TileProgress {
    /// Returns the number of kernels evaluated within their cut-off.
    pub(super) fn splat_pixels(&self) -> u64 {
        u64::from(self.splat_pixels[0]) | u64::from(self.splat_pixels[1]) << 32
    }
}

/// Decodes a depth from the device.
pub(super) fn depth_of_word(word: f32) -> f32 {
    if word <= NO_DEPTH {
        f32::INFINITY
    } else {
        word
    }
}

/// Encodes a depth for the device.
pub(super) fn word_of_depth(depth: f32) -> f32 {
    if depth == f32::INFINITY {
        NO_DEPTH
    } else {
        depth
    }
}

/// Greatest number of entries of a list that a dispatch draws: no limit.
const WHOLE_LIST: u32 = u32::MAX;
/// Greatest number on a software adapter. llvmpipe silently ends all loops of a thread after 65,535
/// iterations. An entry takes one iteration and a share of its batch's.
const SHORT_LIST: u32 = 60_000;

/// Returns the greatest number of entries of a list that a dispatch draws.
///
/// - `rounds`: loop iterations that an entry may take besides its own.
pub(super) fn slice(gpu: &Gpu, rounds: u32) -> u32 {
    if gpu.is_software() {
        SHORT_LIST / (1 + rounds)
    } else {
        WHOLE_LIST
    }
}

/// A rasteriser with its buffers.
#[derive(Debug)]
pub(super) struct BoundTiles {
    pub(super) kernel: BoundKernel,
    pub(super) slice: u32,
}

impl BoundTiles {
    /// Draws lists of at most `longest` entries, in one dispatch if the adapter has no limit.
    ///
    /// The tiles' progress must be cleared before a frame's first lists.
    ///
    /// - `tiles`: number of tiles of the band.
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, tiles: u32, longest: u32) {
        for _ in 0..longest.div_ceil(self.slice).max(1) {
            self.kernel.dispatch(pass, tiles);
        }
    }
}

/// The buffers that both rasterisers read and write.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileBuffers<'a> {
    /// A uniform [`ChunkUniform`], whose band is as wide as the image.
    pub(super) chunk: &'a wgpu::Buffer,
    /// A uniform [`ViewUniform`](crate::record::ViewUniform).
    pub(super) view: &'a wgpu::Buffer,
    pub(super) tile_ranges: &'a wgpu::Buffer,
    pub(super) tile_lists: &'a wgpu::Buffer,
    pub(super) footprints: &'a wgpu::Buffer,
    pub(super) terms: &'a wgpu::Buffer,
    pub(super) near: &'a wgpu::Buffer,
    pub(super) progress: &'a wgpu::Buffer,
}

impl<'a> TileBuffers<'a> {
    /// Returns the bindings that all rasterisers begin with; `pixels` is their output.
    pub(super) fn with(&self, pixels: &'a wgpu::Buffer) -> [&'a wgpu::Buffer; 9] {
        [
            self.chunk,
            self.view,
            self.tile_ranges,
            self.tile_lists,
            self.footprints,
            self.terms,
            self.near,
            pixels,
            self.progress,
        ]
    }
}

/// Packs the near terms for the device: their number, twice, then the terms, with space for at least one.
pub(super) fn near_words(near: &[NearTerms]) -> Vec<u32> {
    let mut words = vec![near.len() as u32; 2];
    words.extend_from_slice(bytemuck::cast_slice(near));
    words.resize(words.len().max(2 + size_of::<NearTerms>() / 4), 0);
    words
}

/// Uploads lists of the tiles of a whole image, divided into depth chunks as in a frame of many
/// footprints. Returns for each chunk its uniform, the tiles' ranges and their entries.
pub(super) fn upload_lists(
    gpu: &Gpu,
    lists: &[Vec<u32>],
    tiles: [u32; 2],
    chunks: usize,
) -> Result<Vec<[wgpu::Buffer; 3]>> {
    let band = ChunkUniform {
        start: 0,
        capacity: longest(lists),
        band_first: [0; 2],
        band_size: tiles,
        is_last: 0,
        unused: 0,
    };
    let chunk = |chunk: usize| {
        let mut ranges = Vec::new();
        let mut entries = Vec::new();
        for list in lists {
            let cut = |n: usize| list.len() * n / chunks;
            let first = entries.len() as u32;
            entries.extend_from_slice(&list[cut(chunk)..cut(chunk + 1)]);
            ranges.push([first, entries.len() as u32]);
        }
        let is_last = u32::from(chunk + 1 == chunks);
        Ok([
            gpu.uniform("chunk", &ChunkUniform { is_last, ..band })?,
            gpu.upload("tile ranges", &ranges)?,
            gpu.upload("tile lists", &entries)?,
        ])
    };
    (0..chunks).map(chunk).collect()
}

/// Returns the number of entries of the longest list.
pub(super) fn longest(lists: &[Vec<u32>]) -> u32 {
    lists.iter().map(Vec::len).max().unwrap_or(0) as u32
}
