//! Stage: draws lists of footprints into pixels, front to back. Its shader is composed of one file for
//! each answer on each axis. Twin: [`crate::cpu::rasterise`].

use std::fmt::Write as _;

use super::compose::Compose;
use super::device::Gpu;
use super::kernel::{Access, Kernel};
use super::resolve::{Background, Resolve};
use super::shader::{DISPATCH, EXPONENTIAL, FLOATS, LIT, NORMAL, STRUCTS, Shader, TRANSFER};
use super::surface::surface_words;
use super::tile::{
    self, BoundTiles, TileBuffers, TileProgress, depth_of_word, longest, near_words, slice,
    upload_lists, word_of_depth,
};
use crate::constants::{MAX_LIGHTS, MOST_EDGES, TILE_SIZE};
use crate::error::Result;
use crate::image::{DepthImage, Image};
use crate::record::{ExactTerms, Footprint, NearTerms, ViewUniform};
use crate::scene::TransferFunction;
use crate::splat::{Accumulate, Axes, Classify, Interval, Profiles};

/// Settings that select a variant of the rasteriser.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct RasterSpec {
    /// The variant on each axis, and the outputs.
    pub axes: Axes,
    /// True if any kernel may cross the camera plane.
    pub near: bool,
    /// Greatest number of layers that a pixel keeps open: 1, or 16, 32, 64, 160 or 256 for slabs.
    pub slots: u32,
    /// True if open layers may have to be carried from one dispatch to the next.
    pub carries: bool,
}

/// Numbers of open layers for which there are pipelines.
const LAYER_SLOTS: [u32; 5] = [16, 32, 64, LIT_SLOTS, 256];
/// Number that lit layers alone have.
const LIT_SLOTS: u32 = 160;

/// Returns the number of open layers of the smallest pipeline that has `layers`, or of the largest one.
///
/// - `is_lit`: true if layers are lit.
pub(super) fn slots_for(gpu: &Gpu, is_lit: bool, layers: u32) -> u32 {
    // A layer and its derivatives take 48 bytes of a thread's own memory: more layers than 160 take more than WGSL
    // guarantees.
    let last = if is_lit && !gpu.has_more_private_memory() {
        LIT_SLOTS
    } else {
        LAYER_SLOTS[LAYER_SLOTS.len() - 1]
    };
    let mut slots = LAYER_SLOTS
        .into_iter()
        .filter(|slots| *slots <= last && (is_lit || *slots != LIT_SLOTS));
    slots.find(|slots| layers <= *slots).unwrap_or(last)
}

/// Sources that all variants share.
const SHARED: [&str; 9] = [
    DISPATCH,
    STRUCTS,
    EXPONENTIAL,
    tile::PIXELS,
    tile::FOOTPRINT,
    include_str!("../../shaders/tile/kernel.wgsl"),
    include_str!("../../shaders/tile/evaluate.wgsl"),
    include_str!("../../shaders/tile/evaluate/affine.wgsl"),
    include_str!("../../shaders/tile/evaluate/exact.wgsl"),
];
/// Cuts at the boundary of the data's domain.
const DOMAIN: &str = include_str!("../../shaders/tile/interval/domain.wgsl");
const NEAR: &str = include_str!("../../shaders/tile/evaluate/near.wgsl");

/// Restrictions of the ray.
const ALL: &str = include_str!("../../shaders/tile/interval/all.wgsl");
const CUT: [&str; 2] = [
    tile::CLIP,
    include_str!("../../shaders/tile/interval/cut.wgsl"),
];

/// Ways to combine the kernels of a pixel.
const COLUMN: [&str; 3] = [
    include_str!("../../shaders/shared/pixel_mean.wgsl"),
    include_str!("../../shaders/shared/smoothed.wgsl"),
    include_str!("../../shaders/tile/accumulate/column.wgsl"),
];
const OPACITY: &str = include_str!("../../shaders/tile/opacity.wgsl");
const OVER: &str = include_str!("../../shaders/tile/accumulate/over.wgsl");
const LAYERS: &str = include_str!("../../shaders/tile/accumulate/layers.wgsl");
const SHEETS: &str = include_str!("../../shaders/tile/accumulate/sheets.wgsl");
const SLABS: &str = include_str!("../../shaders/tile/accumulate/slabs.wgsl");
const COMPOSITED: &str = include_str!("../../shaders/tile/accumulate/composited.wgsl");
const MAXIMUM: &str = include_str!("../../shaders/tile/accumulate/maximum.wgsl");

/// Rules of classification.
const OF_PARTICLES: &str = include_str!("../../shaders/tile/classify/particle.wgsl");
const OF_SLABS: [&str; 5] = [
    FLOATS,
    NORMAL,
    TRANSFER,
    LIT,
    include_str!("../../shaders/tile/classify/slab.wgsl"),
];

/// Composes the rasteriser of an answer on each axis.
///
/// - `slots`: layers that a pixel keeps open, if kernels are summed in layers.
fn shader(axes: &Axes, slots: u32) -> Shader {
    let mut name = "rasterise".to_string();
    let mut constants = Vec::new();
    let mut parts = SHARED.to_vec();
    parts.extend([NEAR, DOMAIN]);
    if axes.interval.is_cut() {
        name += " cut";
        parts.extend(CUT);
    } else {
        parts.push(ALL);
    }
    match axes.accumulate {
        Accumulate::Column => {
            name += " columns";
            parts.extend(COLUMN);
        }
        Accumulate::Sheets | Accumulate::Slabs | Accumulate::Maximum => {
            let is_classified = axes.classify != Classify::Particle;
            let _ = write!(name, " in {slots} layers");
            if is_classified {
                name += ", classified";
            }
            let mut slope_slots = 1;
            if axes.has_slopes() {
                name += ", lit";
                slope_slots = slots;
            }
            constants.extend([("LAYER_SLOTS", slots), ("SLOPE_SLOTS", slope_slots)]);
            parts.extend([OPACITY, LAYERS]);
            match axes.accumulate {
                Accumulate::Sheets => parts.push(SHEETS),
                Accumulate::Maximum => {
                    name += ", their maximum";
                    parts.extend([SLABS, MAXIMUM]);
                }
                _ => parts.extend([SLABS, COMPOSITED]),
            }
            if is_classified {
                parts.extend(OF_SLABS);
            } else {
                parts.push(OF_PARTICLES);
            }
        }
        // Surfels have their own rasteriser.
        Accumulate::Over | Accumulate::Opaque => parts.extend([OPACITY, OVER]),
    }
    parts.push(tile::RASTERISE);
    Shader::composed(name, constants, parts)
}

/// Returns the rasterisers of all answers.
pub(super) fn shaders() -> Vec<Shader> {
    let mut all = Vec::new();
    for interval in [Interval::All, Interval::Surface] {
        let mut add = |accumulate, classify, slots| {
            let axes = Axes {
                interval,
                accumulate,
                classify,
                ..Axes::default()
            };
            all.push(shader(&axes, slots));
        };
        add(Accumulate::Over, Classify::Particle, 1);
        add(Accumulate::Column, Classify::Particle, 1);
        add(Accumulate::Sheets, Classify::Particle, 1);
        for slots in LAYER_SLOTS {
            add(Accumulate::Slabs, Classify::Slab { is_lit: true }, slots);
            if slots != LIT_SLOTS {
                add(Accumulate::Slabs, Classify::Particle, slots);
                add(Accumulate::Slabs, Classify::Slab { is_lit: false }, slots);
                add(Accumulate::Maximum, Classify::Slab { is_lit: false }, slots);
            }
        }
    }
    all
}

impl RasterSpec {
    /// Returns the words of a pixel on the device; the first are those of the picture.
    pub(super) fn pixel_words(&self) -> u64 {
        if self.axes.accumulate == Accumulate::Column {
            return COLUMN_WORDS;
        }
        let words = picture_words(self.axes.depth);
        let words = if self.has_surface() { 2 * words } else { words };
        let is_carried = self.carries && self.axes.accumulate.is_layered();
        let slopes = if self.axes.has_slopes() {
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

    /// Returns whether opaque surfaces lie among the kernels.
    pub(super) fn has_surface(&self) -> bool {
        self.axes.interval == Interval::Surface
    }

    /// Returns the words of each pixel before the depth at which its ray ends: those of the surface.
    pub(super) fn words_before_ends(&self) -> u64 {
        match self.has_surface() {
            true => surface_words(self.axes.normals),
            false => 0,
        }
    }
}

/// Returns the words of a pixel of the picture.
pub(super) fn picture_words(depth: bool) -> u64 {
    if depth { 5 } else { 4 }
}

/// Words of a pixel of a column density: partial sums.
pub(super) const COLUMN_WORDS: u64 = 4;

/// Returns the table that classifies layers: linear colours, and extinctions relative to the greatest.
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

/// Loop iterations of a kernel that may be near: its five columns and their ten pairs, and the pairs once
/// more for each of the three depths at which it may be cut.
const NEAR_ROUNDS: u32 = 45;

/// Loop iterations of an SPH kernel: eight rows of a pixel, with room for how adapters count them.
const SMOOTHED_ROUNDS: u32 = 24;

/// Returns the greatest number of entries of a list that a dispatch draws.
pub(super) fn slice_of(gpu: &Gpu, spec: &RasterSpec) -> u32 {
    let near = if spec.near { NEAR_ROUNDS } else { 0 };
    // A layer is added to, and composited. For a near kernel its pairs of columns are visited again.
    let layers = match spec.axes.accumulate {
        Accumulate::Slabs | Accumulate::Maximum => spec.slots * if spec.near { 12 } else { 2 },
        Accumulate::Sheets => 2,
        Accumulate::Over | Accumulate::Column | Accumulate::Opaque => 0,
    };
    // If layers are lit, each layer that is composited visits all lights.
    let lights = if spec.axes.has_slopes() {
        spec.slots * MAX_LIGHTS as u32
    } else {
        0
    };
    // Planes; a near kernel visits its pairs of columns once more for each.
    let edges = match (spec.axes.edges, spec.near) {
        (false, _) => 0,
        (true, false) => MOST_EDGES as u32,
        (true, true) => 12 * MOST_EDGES as u32,
    };
    let smoothed = if spec.axes.smooths {
        SMOOTHED_ROUNDS
    } else {
        0
    };
    slice(gpu, near + layers + lights + edges + smoothed)
}

impl Rasterise {
    pub(super) fn new(gpu: &Gpu, spec: RasterSpec) -> Self {
        use Access::{Read, Uniform, Write};
        let axes = &spec.axes;
        let flag = |is: bool| f64::from(u8::from(is));
        let slice = slice_of(gpu, &spec);
        let mut bindings = vec![
            Uniform, Uniform, Write, Read, Read, Read, Read, Write, Write, Read,
        ];
        let mut constants = vec![
            (
                "HAS_TERMS",
                flag(axes.may_be_exact || axes.needs_depth_terms() || axes.edges),
            ),
            ("HAS_EXACT", flag(axes.may_be_exact)),
            ("HAS_NEAR", flag(spec.near)),
            ("HAS_EDGES", flag(axes.edges)),
            ("IS_COUNT", flag(axes.count)),
            ("SLICE", f64::from(slice)),
        ];
        if axes.interval.is_cut() {
            constants.push(("HAS_SURFACE", flag(spec.has_surface())));
            constants.push(("HAS_ENDS", flag(axes.ends)));
            constants.push(("WORDS_BEFORE_ENDS", spec.words_before_ends() as f64));
        }
        if axes.accumulate == Accumulate::Column {
            bindings.push(Uniform);
            constants.push(("SMOOTHS", flag(axes.smooths)));
        } else {
            constants.push(("HAS_DEPTH", flag(axes.depth)));
            constants.push(("IS_LINEAR", flag(axes.linear_opacity)));
        }
        if axes.accumulate.is_layered() {
            constants.push(("CARRIES", flag(spec.carries)));
        }
        if let Classify::Slab { is_lit } = axes.classify {
            bindings.extend([Uniform, Uniform]);
            constants.push(("HAS_SLOPES", flag(is_lit)));
        }
        let shader = shader(axes, spec.slots);
        let kernel = gpu.kernel(&shader, "rasterise", &bindings, &constants);
        Self { kernel, slice }
    }

    /// Binds the rasteriser.
    ///
    /// - `surface`: pixels of the opaque surface, and depths at which rays end; any buffer if there are none.
    /// - `tables`: the profiles of the SPH kernel, for columns; the table of [`classes`] and lighting, if layers are classified.
    pub(super) fn bind<'a>(
        &self,
        gpu: &Gpu,
        b: &TileBuffers<'a>,
        pixels: &'a wgpu::Buffer,
        surface: &'a wgpu::Buffer,
        tables: &[&'a wgpu::Buffer],
    ) -> BoundTiles {
        let mut buffers = b.with(pixels).to_vec();
        buffers.push(surface);
        buffers.extend(tables);
        BoundTiles {
            kernel: self.kernel.bind(gpu, &buffers),
            slice: self.slice,
        }
    }
}

/// Draws all tiles of an image: [`crate::cpu::rasterise`] and [`crate::cpu::resolve`] together. Returns
/// the image, depths on request, and the number of splat-pixels.
///
/// - `lists`: the footprints of each tile, front to back.
/// - `chunks`: number of depth chunks into which the lists are divided, as in a frame of many footprints.
/// - `surface`: opaque surfaces among them, if the variant has any.
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
    let smoothing = view.smoothing;
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
    let is_column = spec.axes.accumulate == Accumulate::Column;
    let profiles = is_column.then(|| gpu.uniform("profiles", Profiles::of(smoothing)));
    let profiles = profiles.transpose()?;
    let tables: Vec<_> = profiles.iter().collect();
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
        let bound = kernel.bind(gpu, &buffers, &pixels, &of_surface, &tables);
        gpu.run(|pass| bound.encode(pass, tiles[0] * tiles[1], longest(lists)));
    }
    let of_pixels = Background::new(background, false, count as u32);
    let uniform = gpu.uniform("background", &of_pixels)?;
    if spec.has_surface() {
        let compose = Compose::new(gpu, &spec.axes).bind(gpu, &uniform, &pixels, &of_surface);
        gpu.run(|pass| compose.dispatch(pass, Resolve::groups(count as u32)));
    }
    if of_pixels.is_needed() {
        let resolve = Resolve::new(gpu).bind(gpu, &uniform, &pixels);
        gpu.run(|pass| resolve.dispatch(pass, Resolve::groups(count as u32)));
    }
    let words: Vec<f32> = gpu.read(&pixels, count * picture_words(spec.axes.depth) as usize)?;
    let progress: Vec<TileProgress> = gpu.read(&progress, lists.len())?;
    let (colours, depths) = words.split_at(4 * count);
    let image = Image {
        width,
        height,
        pixels: bytemuck::cast_slice(colours).to_vec(),
    };
    let depth = spec.axes.depth.then(|| DepthImage {
        width,
        height,
        depths: depths.iter().copied().map(depth_of_word).collect(),
    });
    let splat_pixels = progress.iter().map(TileProgress::splat_pixels).sum();
    Ok((image, depth, splat_pixels))
}
