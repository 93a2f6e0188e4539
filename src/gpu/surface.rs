//! Stage: draws lists of surfels of opaque surfaces into pixels. Twin: [`crate::cpu::rasterise_surface`].

use super::device::Gpu;
use super::kernel::{Access, BoundKernel, Kernel};
use super::resolve::Resolve;
use super::shader::{DISPATCH, EXPONENTIAL, NORMAL, STRUCTS, Shader};
use super::tile::{
    self, BoundTiles, TileBuffers, TileProgress, depth_of_word, longest, near_words, slice,
    upload_lists,
};
use crate::constants::{MAX_CLIP_PLANES, SURFACE_LAYERS, TILE_SIZE};
use crate::error::Result;
use crate::image::{DepthImage, Image};
use crate::record::{Footprint, NearTerms, SurfelTerms, ViewUniform};

/// Shader of the stage: it draws tiles of opaque surfaces, and computes pixels from their layers.
pub(super) const SHADER: Shader = Shader::new(
    "surface",
    &[
        DISPATCH,
        STRUCTS,
        EXPONENTIAL,
        NORMAL,
        tile::CLIP,
        tile::PIXELS,
        tile::FOOTPRINT,
        include_str!("../../shaders/tile/evaluate/surfel.wgsl"),
        include_str!("../../shaders/tile/accumulate/opaque.wgsl"),
        tile::RASTERISE,
        include_str!("../../shaders/surface.wgsl"),
    ],
);

/// Variant of the rasteriser of surfels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SurfaceSpec {
    /// True if any surfel may reach the camera plane.
    pub near: bool,
    /// True if normals are written.
    pub normals: bool,
    /// True if pixels count the surfels that they evaluate within their cut-off, in all three
    /// colours, instead of showing them.
    pub count: bool,
    /// True if clip planes cut surfels.
    pub clip: bool,
    /// True if rays end at depths of the caller's.
    pub ends: bool,
    /// True if the surface is the whole picture. If so, a pixel has a depth if the surface covers half of
    /// it. Among volumes it has a depth if the surface covers any part of it.
    pub is_picture: bool,
}

/// Returns the words of a surface's pixel before the depth at which its ray ends.
pub(super) fn surface_words(normals: bool) -> u64 {
    if normals { 8 } else { 5 }
}

impl SurfaceSpec {
    /// Returns the words of a pixel: colour and coverage, depth, normal, and the depth at which its ray ends.
    pub(super) fn pixel_words(&self) -> u64 {
        surface_words(self.normals) + u64::from(self.ends)
    }

    /// Returns the words of a pixel's layers, and of its count.
    pub(super) fn layer_words(&self) -> u64 {
        let layer = if self.normals { 8 } else { 5 };
        SURFACE_LAYERS as u64 * layer + u64::from(self.count)
    }
}

/// The pipelines of the stage.
#[derive(Debug)]
pub(super) struct Surface {
    kernel: Kernel,
    resolve: Kernel,
    slice: u32,
}

/// The stage with its buffers.
#[derive(Debug)]
pub(super) struct BoundSurface {
    pub(super) tiles: BoundTiles,
    /// Computes pixels from their layers.
    resolve: BoundKernel,
}

impl Surface {
    pub(super) fn new(gpu: &Gpu, spec: SurfaceSpec) -> Self {
        use Access::{Read, Uniform, Write};
        let flag = |is: bool| f64::from(u8::from(is));
        // Every surfel visits all planes.
        let slice = slice(gpu, if spec.clip { MAX_CLIP_PLANES as u32 } else { 0 });
        let constants = [
            ("HAS_TERMS", 1.0),
            ("HAS_NEAR", flag(spec.near)),
            ("HAS_NORMALS", flag(spec.normals)),
            ("IS_COUNT", flag(spec.count)),
            ("IS_CUT", flag(spec.clip)),
            ("HAS_ENDS", flag(spec.ends)),
            ("SLICE", f64::from(slice)),
            ("IS_PICTURE", flag(spec.is_picture)),
        ];
        let kernel = |entry, bindings: &[Access]| gpu.kernel(&SHADER, entry, bindings, &constants);
        Self {
            kernel: kernel(
                "rasterise",
                &[
                    Uniform, Uniform, Write, Read, Read, Read, Read, Write, Write, Read,
                ],
            ),
            resolve: kernel("resolve_layers", &[Uniform, Uniform, Read, Write]),
            slice,
        }
    }

    /// Binds the rasteriser.
    ///
    /// - `layers`: buffer of [`SurfaceSpec::layer_words`] for each pixel of a band.
    /// - `pixels`: buffer of [`SurfaceSpec::pixel_words`] for each pixel of a band.
    /// - `ends`: inverse depths at which the rays of a band end; any buffer if they do not.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        b: &TileBuffers<'_>,
        layers: &wgpu::Buffer,
        pixels: &wgpu::Buffer,
        ends: &wgpu::Buffer,
    ) -> BoundSurface {
        let mut buffers = b.with(layers).to_vec();
        buffers.push(ends);
        let kernel = self.kernel.bind(gpu, &buffers);
        BoundSurface {
            tiles: BoundTiles {
                kernel,
                slice: self.slice,
            },
            resolve: self.resolve.bind(gpu, &[b.chunk, b.view, layers, pixels]),
        }
    }
}

impl BoundSurface {
    /// Writes the pixels of a band after its last chunk.
    pub(super) fn encode_pixels(&self, pass: &mut wgpu::ComputePass<'_>, pixels: u32) {
        self.resolve.dispatch(pass, Resolve::groups(pixels));
    }
}

/// A picture of opaque surfaces.
#[derive(Debug, Clone)]
pub struct SurfacePixels {
    /// Colour (premultiplied) and coverage.
    pub image: Image,
    /// Depths.
    pub depth: DepthImage,
    /// Normals in camera space, on request.
    pub normals: Vec<[f32; 3]>,
    /// Number of surfels evaluated at pixels within their cut-off.
    pub splat_pixels: u64,
}

/// Draws all tiles of an image, as [`crate::cpu::rasterise_surface`] does.
///
/// - `terms`: terms of each footprint.
/// - `lists`: the footprints of each tile, front to back.
/// - `chunks`: number of depth chunks into which the lists are divided, as in a frame of many footprints.
///
/// # Errors
/// No memory, or a lost device.
#[allow(
    clippy::too_many_arguments,
    reason = "a stage takes the slices it reads and writes"
)]
pub fn rasterise_surface(
    gpu: &Gpu,
    view: &ViewUniform,
    spec: SurfaceSpec,
    footprints: &[Footprint],
    terms: &[SurfelTerms],
    near: &[NearTerms],
    lists: &[Vec<u32>],
    chunks: usize,
) -> Result<SurfacePixels> {
    let [width, height] = view.size.map(|n| n as usize);
    let tiles = view.size.map(|n| n.div_ceil(TILE_SIZE as u32));
    let kernel = Surface::new(gpu, spec);
    let view = gpu.uniform("view", view)?;
    let footprints = gpu.upload("footprints", footprints)?;
    let terms = gpu.upload("terms", terms)?;
    let near = gpu.upload("near terms", &near_words(near))?;
    let count = width * height;
    let layers = gpu.buffer("layers", 4 * spec.layer_words() * count as u64)?;
    let words = count * spec.pixel_words() as usize;
    let pixels = gpu.buffer("pixels", 4 * words as u64)?;
    let ends = gpu.buffer("no ends", 0)?;
    let progress = gpu.buffer(
        "tiles",
        lists.len() as u64 * size_of::<TileProgress>() as u64,
    )?;
    for [chunk, tile_ranges, tile_lists] in &upload_lists(gpu, lists, tiles, chunks)? {
        let buffers = TileBuffers {
            chunk,
            view: &view,
            tile_ranges,
            tile_lists,
            footprints: &footprints,
            terms: &terms,
            near: &near,
            progress: &progress,
        };
        let bound = kernel.bind(gpu, &buffers, &layers, &pixels, &ends);
        gpu.run(|pass| {
            bound
                .tiles
                .encode(pass, tiles[0] * tiles[1], longest(lists));
            bound.encode_pixels(pass, count as u32);
        });
    }
    let words: Vec<f32> = gpu.read(&pixels, words)?;
    let progress: Vec<TileProgress> = gpu.read(&progress, lists.len())?;
    let (colours, rest) = words.split_at(4 * count);
    let (depths, normals) = rest.split_at(count);
    Ok(SurfacePixels {
        image: Image {
            width,
            height,
            pixels: bytemuck::cast_slice(colours).to_vec(),
        },
        depth: DepthImage {
            width,
            height,
            depths: depths.iter().copied().map(depth_of_word).collect(),
        },
        normals: bytemuck::cast_slice(normals).to_vec(),
        splat_pixels: progress.iter().map(TileProgress::splat_pixels).sum(),
    })
}
