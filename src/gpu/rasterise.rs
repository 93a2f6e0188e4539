//! Stage: from lists of footprints to pixels, front to back. Twin: [`crate::cpu::rasterise`].

use super::compose::Compose;
use super::device::Gpu;
use super::kernel::{Access, Kernel};
use super::resolve::{Background, Resolve};
use super::shaders;
use super::tile::{
    BoundTiles, TileBuffers, TileProgress, depth_of_word, longest, near_words, slice, upload_lists,
    word_of_depth,
};
use crate::constants::{MAX_LIGHTS, TILE_SIZE};
use crate::error::Result;
use crate::image::{DepthImage, Image};
use crate::layout::{ExactTerms, Footprint, NearTerms, ViewUniform};
use crate::scene::TransferFunction;
use crate::splat::Composite;

/// What specialises the rasteriser.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
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
    /// Whether opaque surfaces lie among the kernels.
    pub surface: bool,
    /// Whether clip planes cut them.
    pub clip: bool,
    /// How footprints become a picture.
    pub composite: Composite,
    /// Whether layers are classified by their mean value, and whether they are lit then.
    pub post: Option<IsLit>,
    /// Layers that a pixel keeps open at most: 1, 16, 32, 64 or 256.
    pub slots: u32,
    /// Whether layers that are open may have to be carried from one dispatch to the next.
    pub carries: bool,
}

/// Whether there is light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct IsLit(pub bool);

/// Of how many open layers there are pipelines.
pub(super) const LAYER_SLOTS: [u32; 5] = [
    shaders::RASTERISE[0].0,
    shaders::RASTERISE[1].0,
    shaders::RASTERISE[2].0,
    shaders::RASTERISE[3].0,
    shaders::RASTERISE[4].0,
];

impl RasterSpec {
    /// Words of a pixel on the device; of the picture they are the first.
    pub(super) fn pixel_words(&self) -> u64 {
        let words = picture_words(self.depth);
        let words = if self.surface { 2 * words } else { words };
        let is_carried = self.carries && self.composite != Composite::Over;
        let slopes = if self.post == Some(IsLit(true)) {
            6 * (self.slots + 1)
        } else {
            0
        };
        let carried = if is_carried {
            4 * (self.slots + 2) + slopes
        } else {
            0
        };
        words + u64::from(carried)
    }

    /// Whether all footprints have terms.
    pub(super) fn has_terms_of_all(&self) -> bool {
        self.surface || self.clip || self.composite == Composite::Slabs
    }
}

/// Words of a pixel of the picture.
pub(super) fn picture_words(depth: bool) -> u64 {
    if depth { 5 } else { 4 }
}

/// What classifies layers: linear colours, and extinctions over the greatest.
pub(super) fn classes(transfer: &TransferFunction) -> Vec<[f32; 4]> {
    let per_extinction = 1.0 / transfer.greatest_extinction();
    let table = transfer.table().iter();
    table
        .map(|&[r, g, b, extinction]| [r, g, b, extinction * per_extinction])
        .collect()
}

/// The rasteriser's pipeline.
#[derive(Debug)]
pub(super) struct Rasterise {
    kernel: Kernel,
    slice: u32,
}

/// Rounds of a kernel that may be near: its five columns and their ten pairs, and the pairs once more
/// for each of the three depths at which it may be cut.
const NEAR_ROUNDS: u32 = 45;

/// Entries of a list that a dispatch draws at most.
pub(super) fn slice_of(gpu: &Gpu, spec: &RasterSpec) -> u32 {
    let near = if spec.near { NEAR_ROUNDS } else { 0 };
    // A layer is added to, and closed; of a near kernel its pairs of columns are looked at again.
    let layers = match spec.composite {
        Composite::Over => 0,
        Composite::Sheets | Composite::AxisSheets => 2,
        Composite::Slabs => spec.slots * if spec.near { 12 } else { 2 },
    };
    // Where layers are lit, all lights once for each that is closed.
    let lights = if spec.post == Some(IsLit(true)) {
        spec.slots * MAX_LIGHTS as u32
    } else {
        0
    };
    slice(gpu, near + layers + lights)
}

impl Rasterise {
    pub(super) fn new(gpu: &Gpu, spec: RasterSpec) -> Self {
        use Access::{Read, Uniform, Write};
        let flag = |is: bool| f64::from(u8::from(is));
        let slice = slice_of(gpu, &spec);
        let place = LAYER_SLOTS.iter().position(|slots| *slots == spec.slots);
        let place = place.unwrap_or(0);
        let mut bindings = vec![
            Uniform, Uniform, Write, Read, Read, Read, Read, Write, Write, Read,
        ];
        let mut constants = vec![
            ("HAS_EXACT", flag(spec.exact)),
            ("HAS_NEAR", flag(spec.near)),
            ("HAS_DEPTH", flag(spec.depth)),
            ("IS_COUNT", flag(spec.count)),
            ("IS_LINEAR", flag(spec.linear_opacity)),
            ("HAS_SURFACE", flag(spec.surface)),
            ("IS_CUT", flag(spec.surface || spec.clip)),
            ("COMPOSITE", f64::from(spec.composite as u32)),
            ("CARRIES", flag(spec.carries)),
            ("SLICE", f64::from(slice)),
        ];
        let shader = match spec.post {
            None => &shaders::RASTERISE[place].1,
            Some(IsLit(is_lit)) => {
                bindings.extend([Uniform, Uniform]);
                constants.push(("HAS_SLOPES", flag(is_lit)));
                &shaders::RASTERISE_CLASSIFIED[place.max(1) - 1]
            }
        };
        let kernel = gpu.kernel(shader, "rasterise", &bindings, &constants);
        Self { kernel, slice }
    }

    /// - `surface`: its pixels; of any buffer where there is none.
    /// - `post`: what [`classes`] gives and lighting, where layers are classified.
    pub(super) fn bind<'a>(
        &self,
        gpu: &Gpu,
        b: &TileBuffers<'a>,
        pixels: &'a wgpu::Buffer,
        surface: &'a wgpu::Buffer,
        post: Option<[&'a wgpu::Buffer; 2]>,
    ) -> BoundTiles {
        let mut buffers = b.with(pixels).to_vec();
        buffers.push(surface);
        buffers.extend(post.into_iter().flatten());
        BoundTiles {
            kernel: self.kernel.bind(gpu, &buffers),
            slice: self.slice,
        }
    }
}

/// Draws all tiles of an image: what [`crate::cpu::rasterise`] and [`crate::cpu::resolve`] do
/// together.
///
/// - `lists`: the footprints of each tile, front to back.
/// - `chunks`: into how many depth chunks the lists are cut, as a frame of many footprints is.
/// - `surface`: opaque surfaces among them, where the specialisation says so.
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
    surface: Option<(&Image, &DepthImage)>,
    background: Option<[f32; 3]>,
) -> Result<(Image, Option<DepthImage>, u64)> {
    let [width, height] = view.size.map(|n| n as usize);
    let tiles = view.size.map(|n| n.div_ceil(TILE_SIZE as u32));
    let kernel = Rasterise::new(gpu, spec);
    let view = gpu.uniform("view", view)?;
    let footprints = gpu.upload("footprints", footprints)?;
    let exact = gpu.upload("exact terms", exact)?;
    let near = gpu.upload("near terms", &near_words(near))?;
    let count = width * height;
    let pixels = gpu.buffer("pixels", 4 * spec.pixel_words() * count as u64)?;
    let progress = gpu.buffer(
        "tiles",
        lists.len() as u64 * size_of::<TileProgress>() as u64,
    )?;
    let mut of_surface = Vec::new();
    if let Some((image, depth)) = surface {
        of_surface.extend(image.pixels.as_flattened());
        of_surface.extend(depth.depths.iter().copied().map(word_of_depth));
    }
    let of_surface = gpu.upload("surface", &of_surface)?;
    for [chunk, tile_ranges, tile_lists] in &upload_lists(gpu, lists, tiles, chunks)? {
        let buffers = TileBuffers {
            chunk,
            view: &view,
            tile_ranges,
            tile_lists,
            footprints: &footprints,
            terms: &exact,
            near: &near,
            progress: &progress,
        };
        let bound = kernel.bind(gpu, &buffers, &pixels, &of_surface, None);
        gpu.run(|pass| bound.encode(pass, tiles[0] * tiles[1], longest(lists)));
    }
    let colour = background.unwrap_or([0.0; 3]);
    let uniform = gpu.uniform("background", &Background::new(colour, count as u32))?;
    if spec.surface {
        let compose = Compose::new(gpu, spec).bind(gpu, &uniform, &pixels, &of_surface);
        gpu.run(|pass| compose.dispatch(pass, Resolve::groups(count as u32)));
    }
    if background.is_some() {
        let resolve = Resolve::new(gpu).bind(gpu, &uniform, &pixels);
        gpu.run(|pass| resolve.dispatch(pass, Resolve::groups(count as u32)));
    }
    let words: Vec<f32> = gpu.read(&pixels, count * picture_words(spec.depth) as usize)?;
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
