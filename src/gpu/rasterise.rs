//! Stage: from lists of footprints to pixels, front to back. Twin: [`crate::cpu::rasterise`].

use bytemuck::{Pod, Zeroable};

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::resolve::{Background, Resolve};
use super::shaders;
use crate::constants::TILE_SIZE;
use crate::error::Result;
use crate::image::{DepthImage, Image};
use crate::layout::{ChunkUniform, ExactTerms, Footprint, NearTerms, ViewUniform};

/// What specialises the rasteriser.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct RasterSpec {
    /// Whether any footprint may be on the exact path.
    pub exact: bool,
    /// Whether any kernel may cross the camera plane.
    pub near: bool,
    /// Whether depths are wanted.
    pub depth: bool,
    /// Whether pixels count the kernels that they evaluate within their cut-off, in all three
    /// colours, instead of showing them.
    pub count: bool,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau), for all footprints; splats have it anyway.
    pub linear_opacity: bool,
}

/// What a tile carries from one chunk of footprints to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TileProgress {
    pub(super) drawn: u32,
    pub(super) is_done: u32,
    pub(super) splat_pixels: [u32; 2],
}

impl TileProgress {
    /// Kernels evaluated within their cut-off.
    pub(super) fn splat_pixels(&self) -> u64 {
        u64::from(self.splat_pixels[0]) | u64::from(self.splat_pixels[1]) << 32
    }
}

/// Words of a pixel on the device.
pub(super) fn pixel_words(depth: bool) -> u64 {
    if depth { 5 } else { 4 }
}

/// The buffers that the rasteriser reads and writes.
#[derive(Debug, Clone, Copy)]
pub(super) struct RasterBuffers<'a> {
    /// A uniform [`ChunkUniform`], whose band is as wide as the image.
    pub(super) chunk: &'a wgpu::Buffer,
    pub(super) view: &'a wgpu::Buffer,
    pub(super) tile_ranges: &'a wgpu::Buffer,
    pub(super) tile_lists: &'a wgpu::Buffer,
    pub(super) footprints: &'a wgpu::Buffer,
    pub(super) exact: &'a wgpu::Buffer,
    pub(super) near: &'a wgpu::Buffer,
    pub(super) pixels: &'a wgpu::Buffer,
    pub(super) progress: &'a wgpu::Buffer,
}

/// The rasteriser's pipeline.
#[derive(Debug)]
pub(super) struct Rasterise {
    kernel: Kernel,
    slice: u32,
}

/// The rasteriser with its buffers.
#[derive(Debug)]
pub(super) struct BoundRasterise {
    kernel: BoundKernel,
    slice: u32,
}

/// Entries of a list that a dispatch draws at most: all.
const WHOLE_LIST: u32 = u32::MAX;
/// The same on a software adapter: llvmpipe ends all loops of a thread, without a word, after
/// 65,535 rounds. An entry takes one and a share of its batch's.
const SHORT_LIST: u32 = 60_000;
/// The same where kernels may be near, whose columns and their pairs take rounds of their own.
const SHORT_NEAR_LIST: u32 = 3_000;

impl Rasterise {
    pub(super) fn new(gpu: &Gpu, spec: RasterSpec) -> Self {
        use Access::{Read, Uniform, Write};
        let flag = f64::from;
        let slice = match (gpu.is_software(), spec.near) {
            (false, _) => WHOLE_LIST,
            (true, false) => SHORT_LIST,
            (true, true) => SHORT_NEAR_LIST,
        };
        let kernel = gpu.kernel(
            &shaders::RASTERISE,
            "rasterise",
            &[Uniform, Read, Write, Read, Read, Read, Read, Write, Write],
            &[
                ("HAS_EXACT", flag(u8::from(spec.exact))),
                ("HAS_NEAR", flag(u8::from(spec.near))),
                ("HAS_DEPTH", flag(u8::from(spec.depth))),
                ("IS_COUNT", flag(u8::from(spec.count))),
                ("IS_LINEAR", flag(u8::from(spec.linear_opacity))),
                ("SLICE", f64::from(slice)),
            ],
        );
        Self { kernel, slice }
    }

    pub(super) fn bind(&self, gpu: &Gpu, b: &RasterBuffers<'_>) -> BoundRasterise {
        let kernel = self.kernel.bind(
            gpu,
            &[
                b.chunk,
                b.view,
                b.tile_ranges,
                b.tile_lists,
                b.footprints,
                b.exact,
                b.near,
                b.pixels,
                b.progress,
            ],
        );
        BoundRasterise {
            kernel,
            slice: self.slice,
        }
    }
}

impl BoundRasterise {
    /// Draws lists of at most `longest` entries, in one dispatch where the adapter has no limit.
    ///
    /// The tiles' progress must be cleared before a frame's first lists.
    ///
    /// - `tiles`: of the band.
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, tiles: u32, longest: u32) {
        for _ in 0..longest.div_ceil(self.slice).max(1) {
            self.kernel.dispatch(pass, tiles);
        }
    }
}

/// The near terms as the device keeps them: their number, then the terms, room for one at least.
fn near_words(near: &[NearTerms]) -> Vec<u32> {
    let mut words = vec![near.len() as u32];
    words.extend_from_slice(bytemuck::cast_slice(near));
    words.resize(words.len().max(1 + size_of::<NearTerms>() / 4), 0);
    words
}

/// Draws all tiles of an image: what [`crate::cpu::rasterise`] and [`crate::cpu::resolve`] do
/// together.
///
/// - `lists`: the footprints of each tile, front to back.
/// - `chunks`: into how many depth chunks the lists are cut, as a frame of many footprints is.
///
/// Returns the image, depths where asked for, and the number of splat-pixels.
///
/// # Errors
/// No memory, or a lost device.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn rasterise(
    gpu: &Gpu,
    view: &ViewUniform,
    spec: RasterSpec,
    footprints: &[Footprint],
    exact: &[ExactTerms],
    near: &[NearTerms],
    lists: &[Vec<u32>],
    chunks: usize,
    background: Option<[f32; 3]>,
) -> Result<(Image, Option<DepthImage>, u64)> {
    let [width, height] = view.size.map(|n| n as usize);
    let columns = width.div_ceil(TILE_SIZE) as u32;
    let rows = height.div_ceil(TILE_SIZE) as u32;
    let kernel = Rasterise::new(gpu, spec);
    let view = gpu.upload("view", &[*view])?;
    let longest = lists.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let footprints = gpu.upload("footprints", footprints)?;
    let exact = gpu.upload("exact terms", exact)?;
    let near = gpu.upload("near terms", &near_words(near))?;
    let count = width * height;
    let words = count * pixel_words(spec.depth) as usize;
    let pixels = gpu.buffer("pixels", 4 * words as u64)?;
    let progress = gpu.buffer(
        "tiles",
        lists.len() as u64 * size_of::<TileProgress>() as u64,
    )?;
    for chunk in 0..chunks {
        let mut ranges = Vec::new();
        let mut entries = Vec::new();
        for list in lists {
            let cut = |n: usize| list.len() * n / chunks;
            let first = entries.len() as u32;
            entries.extend_from_slice(&list[cut(chunk)..cut(chunk + 1)]);
            ranges.push([first, entries.len() as u32]);
        }
        let band = ChunkUniform {
            start: 0,
            capacity: longest,
            band_first: [0; 2],
            band_size: [columns, rows],
        };
        let bound = kernel.bind(
            gpu,
            &RasterBuffers {
                chunk: &gpu.uniform("chunk", &band)?,
                view: &view,
                tile_ranges: &gpu.upload("tile ranges", &ranges)?,
                tile_lists: &gpu.upload("tile lists", &entries)?,
                footprints: &footprints,
                exact: &exact,
                near: &near,
                pixels: &pixels,
                progress: &progress,
            },
        );
        gpu.run(|pass| bound.encode(pass, columns * rows, longest));
    }
    if let Some(colour) = background {
        let background = gpu.uniform("background", &Background::new(colour, count as u32))?;
        let resolve = Resolve::new(gpu).bind(gpu, &background, &pixels);
        gpu.run(|pass| resolve.dispatch(pass, Resolve::groups(count as u32)));
    }
    let words: Vec<f32> = gpu.read(&pixels, words)?;
    let progress: Vec<TileProgress> = gpu.read(&progress, lists.len())?;
    let (colours, depths) = words.split_at(4 * count);
    let image = Image {
        width,
        height,
        pixels: bytemuck::cast_slice(colours).to_vec(),
    };
    let depth = spec.depth.then(|| DepthImage {
        width,
        height,
        depths: depths.iter().copied().map(depth_of_word).collect(),
    });
    let splat_pixels = progress.iter().map(TileProgress::splat_pixels).sum();
    Ok((image, depth, splat_pixels))
}

/// The device writes a negative number where there is no depth.
pub(super) fn depth_of_word(word: f32) -> f32 {
    if word < 0.0 { f32::INFINITY } else { word }
}
