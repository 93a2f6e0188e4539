//! One pass of a frame on a device, over the volumes that are drawn together: from blocks to the pixels
//! of a band.
//!
//! Everything that a frame needs room for has a capacity that the host chose before it knew the
//! frame. The device counts on where room ends and writes nothing beyond it; a frame that needed
//! more is drawn again with more room.
//!
//! What a binding cannot hold is cut: a volume into parts, the sorted footprints into depth chunks,
//! the image into bands of rows of tiles. Each band draws the chunks front to back, its pixels
//! carried from one to the next.

use std::mem::offset_of;

use bytemuck::Zeroable;
use wgpu::CommandEncoder;

use super::bin::{Bin, BoundBin, MAX_BAND_TILES};
use super::classify::{BoundClassify, bind_classify};
use super::compose::Compose;
use super::cull::{BoundCull, Cull, camera_uniform};
use super::device::Gpu;
use super::frame::{FrameInput, FrameKind};
use super::gather::{BoundGather, Gather, Terms};
use super::kernel::BoundKernel;
use super::light::{BoundLight, bind_light};
use super::project::{Project, ProjectBuffers, ProjectSpec, near_bytes};
use super::rasterise::{IsLit, LAYER_SLOTS, RasterSpec, Rasterise, classes, slice_of};
use super::resolve::Resolve;
use super::scene::{FrameBuffers, PARTICLE_ARGUMENTS, Part, PartBuffers, Scene};
use super::shade::{BoundShade, bind_shade};
use super::sort::{BoundSort, Sort};
use super::surface::{BoundSurface, Surface, SurfaceSpec};
use super::tile::{BoundTiles, TileBuffers, TileProgress};
use super::timer::{Stage, Timer};
use crate::blocks::BlockedVolume;
use crate::constants::TILE_SIZE;
use crate::error::{Error, Result};
use crate::layout::{
    ChunkState, ChunkUniform, ExactTerms, Footprint, FrameState, PartState, SortState, ViewUniform,
};
use crate::scene::CLASSIFICATION_TABLE_LEN;
use crate::splat::{Composite, Filter};
use crate::stats::FrameCounts;

/// What a pass draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PassKind {
    /// Surfels of opaque surfaces.
    Surface {
        /// Whether there is nothing else.
        is_picture: bool,
    },
    /// All that light passes through.
    Volumes {
        /// Whether opaque surfaces, drawn before, lie among it.
        is_cut: bool,
    },
}

impl PassKind {
    /// Whether a pass of this kind draws a volume.
    pub(super) fn draws(self, volume: &BlockedVolume) -> bool {
        volume.is_surface() == matches!(self, Self::Surface { .. })
    }
}

/// The room that frames have found they need.
#[derive(Debug, Clone, PartialEq)]
struct Room {
    /// Classified particles of each part.
    classified: Vec<u32>,
    /// Kernels that cross the camera plane; without any the rasteriser has no code for them.
    near: u32,
    /// Entries of the tiles' lists of a chunk.
    entries: u32,
    /// Footprints of a depth chunk.
    chunk: u32,
    /// Whether exact footprints have been seen: without them the rasteriser has no code for them.
    exact: bool,
    /// Layers that a pixel keeps open, one of [`LAYER_SLOTS`]; of slabs.
    slots: u32,
}

/// Classified particles of a part that there is room for before anything is known.
const FIRST_CLASSIFIED: u32 = 1 << 18;
/// The same of merged ones, of which a frame draws few.
const FIRST_MERGED: u32 = 1 << 14;
const FIRST_ENTRIES: u32 = 1 << 20;

/// Entries of a chunk's lists at most, 1 GiB of them: beyond, a frame takes smaller chunks. So is
/// what one submission may take bounded, for systems that end those of seconds.
fn entries_limit(binding_bytes: u64) -> u64 {
    (binding_bytes / 4).min(1 << 26)
}

impl Room {
    /// What there is room for before any frame was drawn.
    fn first(scene: &Scene, binding_bytes: u64) -> Self {
        let classified = scene.parts.iter().map(|part| {
            let all = part.slots as u32;
            // All are visible where nothing is classified.
            if part.kinds.is_merged {
                all.min(FIRST_MERGED)
            } else if part.kinds.may_be_transparent() {
                all.min(FIRST_CLASSIFIED)
            } else {
                all
            }
        });
        Self {
            classified: classified.collect(),
            near: 0,
            entries: FIRST_ENTRIES.min(entries_limit(binding_bytes) as u32),
            chunk: chunk_limit(binding_bytes),
            exact: false,
            slots: LAYER_SLOTS[1],
        }
    }
}

/// `needed`, and an eighth more, so that the next frame fits as well.
fn with_slack(needed: u32, most: u64) -> u32 {
    let wanted = u64::from(needed) + u64::from(needed) / 8 + 64;
    wanted
        .min(most)
        .max(u64::from(needed))
        .min(u64::from(u32::MAX)) as u32
}

/// The volumes of a pass on a device, and what room its frames need.
#[derive(Debug)]
pub(super) struct Pass {
    pub(super) kind: PassKind,
    pub(super) scene: Scene,
    room: Room,
}

impl Pass {
    /// Uploads those of the volumes that the pass draws.
    ///
    /// # Errors
    /// Too little memory on the device, or what only the CPU draws.
    pub(super) fn new(gpu: &Gpu, kind: PassKind, volumes: &[BlockedVolume]) -> Result<Self> {
        let limit = gpu.max_binding_bytes();
        let scene = Scene::new(gpu, volumes, |volume| kind.draws(volume), limit)?;
        Ok(Self {
            kind,
            room: Room::first(&scene, limit),
            scene,
        })
    }

    /// Forgets what room frames have found they need.
    pub(super) fn forget_room(&mut self, gpu: &Gpu) {
        self.room = Room::first(&self.scene, gpu.max_binding_bytes());
    }

    /// Takes the room that a frame would have needed; returns whether that is more than there was.
    ///
    /// # Errors
    /// More than the device's bindings hold.
    pub(super) fn grow(&mut self, gpu: &Gpu, frame: &FrameKind, seen: &Seen) -> Result<bool> {
        let room = self.grown(gpu, frame, seen)?;
        let is_more = room != self.room;
        self.room = room;
        Ok(is_more)
    }

    /// The room that a frame would have needed: what there is where that was enough.
    ///
    /// # Errors
    /// More than the device's bindings hold.
    fn grown(&self, gpu: &Gpu, frame: &FrameKind, seen: &Seen) -> Result<Room> {
        let limit = gpu.max_binding_bytes();
        let mut room = self.room.clone();
        let parts = self.scene.drawn(&mut room.classified, frame.detail);
        for ((part, room), state) in parts.zip(&seen.parts) {
            if state.needed > *room {
                *room = with_slack(state.needed, part.slots as u64);
            }
        }
        if room.classified != self.room.classified {
            // What follows has not seen all particles.
            return Ok(room);
        }
        if seen.near > room.near {
            let most = (limit - near_bytes(0)) / (near_bytes(1) - near_bytes(0));
            room.near = with_slack(seen.near, most);
            check_room(gpu, "kernels across the camera plane", seen.near, most)?;
        }
        if seen.sort.exact > 0 {
            room.exact = true;
        }
        let layers = seen.tiles.layers_needed;
        if frame.composite == Composite::Slabs && layers > room.slots {
            let most = LAYER_SLOTS[LAYER_SLOTS.len() - 1];
            check_room(gpu, "slabs that a kernel reaches", layers, most.into())?;
            let slots = LAYER_SLOTS.into_iter().find(|slots| layers <= *slots);
            room.slots = slots.unwrap_or(most);
        }
        if seen.needed_entries > room.entries {
            let most = entries_limit(limit);
            if u64::from(seen.needed_entries) <= most {
                room.entries = with_slack(seen.needed_entries, most);
            } else {
                // Fewer footprints at a time, however many tiles each touches.
                let chunk = room.chunk.min(seen.sort.visible);
                if chunk <= 1 {
                    check_room(gpu, "entries of one footprint", seen.needed_entries, most)?;
                }
                let share = u64::from(chunk) * most / u64::from(seen.needed_entries);
                room.chunk = (share as u32).min(chunk / 2).max(1);
                room.entries = most as u32;
            }
        }
        Ok(room)
    }

    /// Adds what a frame counted to `counts`.
    pub(super) fn count(&self, frame: &FrameKind, seen: &Seen, counts: &mut FrameCounts) {
        let sum = |of: fn(&PartState) -> u32| -> usize {
            seen.parts.iter().map(|p| of(p) as usize).sum()
        };
        let parts = self.scene.drawn(0.., frame.detail).zip(&seen.parts);
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
        counts.footprints_near += seen.near as usize;
        counts.tile_entries += seen.entries as usize;
        counts.splat_pixels += seen.tiles.splat_pixels;
    }

    fn is_surface(&self) -> bool {
        matches!(self.kind, PassKind::Surface { .. })
    }

    /// What the rasteriser is specialised for.
    fn raster(&self, gpu: &Gpu, frame: &FrameKind) -> Raster {
        let near = self.room.near > 0;
        match self.kind {
            PassKind::Surface { is_picture } => Raster::Surface(SurfaceSpec {
                near,
                normals: frame.normals,
                count: frame.count,
                clip: frame.clip,
                is_picture,
            }),
            PassKind::Volumes { is_cut } => {
                let spec = RasterSpec {
                    exact: self.room.exact && frame.may_be_exact(),
                    near,
                    depth: frame.depth,
                    count: frame.count,
                    linear_opacity: frame.linear_opacity,
                    surface: is_cut,
                    clip: frame.clip,
                    composite: frame.composite,
                    post: frame.post.then_some(IsLit(frame.is_lit)),
                    slots: if frame.composite == Composite::Slabs {
                        self.room.slots
                    } else {
                        1
                    },
                    carries: false,
                };
                Raster::Volumes(RasterSpec {
                    carries: self.capacity(frame)
                        > slice_of(gpu, &spec).min(self.room.chunk).into(),
                    ..spec
                })
            }
        }
    }

    /// Classified particles that there is room for.
    fn capacity(&self, frame: &FrameKind) -> u64 {
        let room = self.room.classified.iter().copied();
        let capacities = self.scene.drawn(room, frame.detail);
        capacities.map(|(_, n)| u64::from(n)).sum()
    }

    /// Rows of tiles of an image this wide whose pixels a binding holds.
    ///
    /// # Errors
    /// Not one.
    pub(super) fn band_rows(&self, gpu: &Gpu, frame: &FrameKind) -> Result<u32> {
        let tile = TILE_SIZE as u32;
        let [columns, tile_rows] = frame.size.map(|n| n.div_ceil(tile));
        let words = match self.raster(gpu, frame) {
            Raster::Surface(spec) => spec.layer_words().max(spec.pixel_words()),
            Raster::Volumes(spec) => spec.pixel_words(),
        };
        let row_bytes = 4 * words * u64::from(frame.size[0]) * u64::from(tile);
        let rows = gpu.max_binding_bytes() / row_bytes;
        let rows = rows.min(u64::from(MAX_BAND_TILES / columns));
        if rows == 0 {
            return Err(Error::format(
                "GPU",
                gpu.adapter(),
                format!(
                    "rows of tiles of at most {} bytes, what a binding holds",
                    gpu.max_binding_bytes()
                ),
                format!("{row_bytes} bytes for one of {} pixels", frame.size[0]),
                "render a narrower image, or use --backend cpu",
            ));
        }
        Ok(rows.min(tile_rows.into()) as u32)
    }
}

/// What a rasteriser is specialised for.
#[derive(Debug, Clone, Copy)]
enum Raster {
    Surface(SurfaceSpec),
    Volumes(RasterSpec),
}

/// A rasteriser with its buffers, and what turns its last chunk into the band's pixels.
#[derive(Debug)]
enum BoundRaster {
    Surface(BoundSurface),
    Volumes(BoundTiles, Option<BoundKernel>),
}

fn check_room(gpu: &Gpu, what: &str, needed: u32, most: u64) -> Result<()> {
    if u64::from(needed) <= most {
        return Ok(());
    }
    Err(Error::format(
        "GPU",
        gpu.adapter(),
        format!("at most {most} {what}"),
        needed.to_string(),
        "use --backend cpu",
    ))
}

/// Footprints of a depth chunk at most: those whose buffer a binding holds, and fewer than overflow
/// a tile's count of splat-pixels, one of 32 bits for all its pixels.
fn chunk_limit(binding_bytes: u64) -> u32 {
    const COUNTABLE: u64 = u32::MAX as u64 / (TILE_SIZE * TILE_SIZE) as u64;
    let footprints = binding_bytes / size_of::<Footprint>() as u64;
    footprints.clamp(1, COUNTABLE) as u32
}

/// What a pass of a frame found out.
#[derive(Debug)]
pub(super) struct Seen {
    parts: Vec<PartState>,
    sort: SortState,
    near: u32,
    /// Views by their filter.
    filters: [u32; 7],
    needed_entries: u32,
    entries: u64,
    tiles: TileCounts,
}

/// What the tiles of a pass counted.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TileCounts {
    splat_pixels: u64,
    /// The most layers that a kernel wanted to have open at once.
    layers_needed: u32,
}

/// Which word of a [`PartState`] counts what the projection reads.
const CLASSIFIED_COUNT: u32 = (offset_of!(PartState, classified_count) / 4) as u32;

/// Buffers and bindings of a pass of frames of one kind.
#[derive(Debug)]
pub(super) struct PassFrame {
    buffers: FrameBuffers,
    parts: Vec<PartBuffers>,
    near: wgpu::Buffer,
    cull: BoundCull,
    classify: Vec<BoundClassify>,
    shade: Vec<BoundShade>,
    light: Vec<BoundLight>,
    project: Vec<BoundKernel>,
    counts: wgpu::Buffer,
    sort: BoundSort,
    chunk: wgpu::Buffer,
    gather: BoundGather,
    bin: BoundBin,
    rasterise: BoundRaster,
    /// Whether this is the pass of opaque surfels.
    is_surface: bool,
    /// What classifies layers, where anything does.
    classes: Option<wgpu::Buffer>,
    /// Pixels of a band.
    pub(super) pixels: wgpu::Buffer,
    progress: wgpu::Buffer,
    plan: Plan,
    report: wgpu::Buffer,
    progress_back: wgpu::Buffer,
}

/// How a pass of a frame is cut.
#[derive(Debug, Clone, Copy)]
struct Plan {
    bands: Bands,
    /// Footprints of a chunk.
    chunk: u32,
    /// Chunks that hold all footprints that there is room for.
    chunks: u32,
}

/// The image in bands of rows of tiles, those of all passes alike.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bands {
    /// Width and height of the image.
    pub(super) size: [u32; 2],
    /// Columns and rows of tiles of the image.
    pub(super) tiles: [u32; 2],
    /// Rows of tiles of a band.
    pub(super) rows: u32,
}

impl Bands {
    /// How many there are.
    pub(super) fn count(&self) -> u32 {
        self.tiles[1].div_ceil(self.rows)
    }

    /// First row of tiles and rows of a band.
    pub(super) fn band(&self, band: u32) -> (u32, u32) {
        let first = band * self.rows;
        (first, self.rows.min(self.tiles[1] - first))
    }

    /// Pixels of the image in a band.
    pub(super) fn pixels(&self, band: u32) -> u32 {
        let [width, height] = self.size;
        let tile = TILE_SIZE as u32;
        let (first_row, rows) = self.band(band);
        width * (rows * tile).min(height - first_row * tile)
    }

    /// Pixels of the largest band.
    pub(super) fn most_pixels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.rows) * TILE_SIZE as u64
    }
}

impl Plan {
    /// - `capacity`: classified particles that there is room for.
    /// - `chunk`: footprints of a chunk at most.
    fn new(bands: Bands, capacity: u64, chunk: u32) -> Self {
        let chunk = u64::from(chunk).min(capacity).max(1);
        Self {
            bands,
            chunk: chunk as u32,
            // One at least: it clears the image.
            chunks: capacity.div_ceil(chunk).max(1) as u32,
        }
    }

    /// Bytes of the report: parts, the sort, near kernels, filters, chunks.
    fn report_places(&self, parts: usize) -> ReportPlaces {
        let sort = (parts * size_of::<PartState>()) as u64;
        let near = sort + size_of::<SortState>() as u64;
        let filters = near + 4;
        let chunks = filters + FILTER_BYTES;
        let steps = u64::from(self.bands.count()) * u64::from(self.chunks);
        ReportPlaces {
            sort,
            near,
            filters,
            chunks,
            end: chunks + steps * size_of::<ChunkState>() as u64,
        }
    }
}

/// Bytes of [`FrameState::filters`].
const FILTER_BYTES: u64 = 4 * Filter::ALL.len() as u64;

/// Where in a report things lie, bytes.
struct ReportPlaces {
    sort: u64,
    near: u64,
    filters: u64,
    chunks: u64,
    end: u64,
}

/// The value of type T at a byte of a report.
fn at<T: bytemuck::Pod>(report: &[u8], place: u64) -> T {
    bytemuck::pod_read_unaligned(&report[place as usize..][..size_of::<T>()])
}

impl PassFrame {
    /// - `surface`: the pixels of the opaque surfaces that cut the pass' kernels.
    /// - `background`: of it the number of a band's pixels.
    ///
    /// # Errors
    /// Too little memory on the device.
    pub(super) fn new(
        gpu: &Gpu,
        pass: &Pass,
        view: &ViewUniform,
        frame: &FrameKind,
        bands: Bands,
        surface: Option<&wgpu::Buffer>,
        background: &wgpu::Buffer,
    ) -> Result<Self> {
        let Pass { scene, room, .. } = pass;
        let (drawn, capacities): (Vec<&Part>, Vec<u32>) = scene
            .drawn(room.classified.iter().copied(), frame.detail)
            .unzip();
        let capacity: u64 = capacities.iter().map(|n| u64::from(*n)).sum();
        let plan = Plan::new(bands, capacity, room.chunk);
        let buffers = FrameBuffers::new(gpu)?;
        let parts = drawn.iter().zip(&capacities);
        let parts = parts
            .map(|(part, capacity)| PartBuffers::new(gpu, part, *capacity))
            .collect::<Result<Vec<_>>>()?;
        let cull = Cull::new(gpu).bind(gpu, &buffers, &drawn, &parts)?;
        let classify = bind_classify(gpu, &buffers, &drawn, &parts)?;
        let shade = drawn.iter().zip(&parts);
        let shade = shade.filter_map(|(part, b)| bind_shade(gpu, &buffers, part, b));
        // Layers that are classified are lit themselves.
        let is_classified = frame.post && !pass.is_surface();
        let is_lit = frame.is_lit && !is_classified;
        let light = drawn.iter().zip(&parts).filter(|_| is_lit);
        let light = light.filter_map(|(part, b)| bind_light(gpu, &buffers, part, b));
        let near = gpu.buffer("near kernels", near_bytes(room.near.max(1) as usize))?;

        let no_classes = || vec![[0.0_f32; 4]; CLASSIFICATION_TABLE_LEN];
        let classes = is_classified
            .then(|| gpu.uniform_list("classes of layers", &no_classes()))
            .transpose()?;
        let raster = pass.raster(gpu, frame);
        let (is_cut, exact, terms) = match raster {
            Raster::Surface(_) => (false, false, Terms::OfAll),
            Raster::Volumes(spec) if spec.has_terms_of_all() => (true, spec.exact, Terms::OfAll),
            Raster::Volumes(spec) => (false, spec.exact, Terms::exact(spec.exact)),
        };
        let mut footprints = Vec::with_capacity(parts.len());
        let mut project = Vec::with_capacity(parts.len());
        for ((part, of_part), capacity) in drawn.iter().zip(&parts).zip(&capacities) {
            let spec = ProjectSpec::new(&part.kinds, view, is_cut, CLASSIFIED_COUNT);
            let bytes = |each: usize| u64::from(*capacity) * each as u64;
            let own = gpu.buffer("footprints", bytes(size_of::<Footprint>()))?;
            let exact = spec.has_terms().then_some(bytes(size_of::<ExactTerms>()));
            let exact = gpu.buffer("exact terms", exact.unwrap_or(0))?;
            let bound = Project::new(gpu, &spec).bind(
                gpu,
                &ProjectBuffers {
                    blocks: if part.kinds.is_lattice() {
                        &part.lattice
                    } else {
                        &part.blocks
                    },
                    shapes: &part.shapes,
                    view: &buffers.view,
                    rotation: &buffers.rotation,
                    counts: &of_part.state,
                    views: &of_part.views,
                    classified: &of_part.classified,
                    footprints: &own,
                    exact: &exact,
                    near: &near,
                },
            );
            project.push(bound);
            footprints.push((own, exact));
        }

        // The sort takes a part for each word: one at least.
        let counts = gpu.upload("part counts", &vec![0_u32; parts.len().max(1)])?;
        let in_parts: Vec<_> = footprints.iter().map(|(f, _)| f).collect();
        let sort = Sort::new(gpu).bind(gpu, &counts, &in_parts, capacity)?;

        let chunk = gpu.uniform("chunk", &ChunkUniform::zeroed())?;
        let has_terms = terms != Terms::None;
        let in_parts: Vec<_> = footprints
            .iter()
            .map(|(f, e)| (f, has_terms.then_some(e)))
            .collect();
        let chunk_capacity = u64::from(plan.chunk);
        let gather = Gather::new(gpu, terms).bind(gpu, &chunk, &sort, &in_parts, chunk_capacity)?;
        let tiles = bands.tiles[0] * bands.rows;
        let entries = u64::from(room.entries);
        let bin =
            Bin::new(gpu, exact).bind(gpu, &chunk, &gather, chunk_capacity, tiles, entries)?;

        let pixels_of = |label, words: u64| gpu.buffer(label, 4 * words * bands.most_pixels());
        let progress_bytes = u64::from(tiles) * size_of::<TileProgress>() as u64;
        let progress = gpu.buffer("tiles", progress_bytes)?;
        let of_tiles = TileBuffers {
            chunk: &chunk,
            view: &buffers.view,
            tile_ranges: &bin.ranges,
            tile_lists: &bin.entries.values,
            footprints: &gather.footprints,
            terms: &gather.exact,
            near: &near,
            progress: &progress,
        };
        let pixels;
        let rasterise = match raster {
            Raster::Surface(spec) => {
                pixels = pixels_of("pixels of surfaces", spec.pixel_words())?;
                let layers = pixels_of("layers of surfaces", spec.layer_words())?;
                let bound = Surface::new(gpu, spec).bind(gpu, &of_tiles, &layers, &pixels);
                BoundRaster::Surface(bound)
            }
            Raster::Volumes(spec) => {
                pixels = pixels_of("pixels", spec.pixel_words())?;
                let none = gpu.buffer("no surface", 0)?;
                let behind = surface.unwrap_or(&none);
                let rasterise = Rasterise::new(gpu, spec);
                let post = classes.as_ref().map(|classes| [classes, &buffers.lighting]);
                let bound = rasterise.bind(gpu, &of_tiles, &pixels, behind, post);
                let compose = surface
                    .map(|surface| Compose::new(gpu, spec).bind(gpu, background, &pixels, surface));
                BoundRaster::Volumes(bound, compose)
            }
        };
        let report = gpu.staging("report", plan.report_places(parts.len()).end)?;
        let progress_back = gpu.staging("tiles", progress_bytes)?;
        Ok(Self {
            shade: shade.collect(),
            light: light.collect(),
            buffers,
            parts,
            near,
            cull,
            classify,
            project,
            counts,
            sort,
            chunk,
            gather,
            bin,
            rasterise,
            is_surface: pass.is_surface(),
            classes,
            pixels,
            progress,
            plan,
            report,
            progress_back,
        })
    }

    /// Submits what all bands begin with: cull, classify, shade, project, sort.
    pub(super) fn begin(&self, gpu: &Gpu, timer: &mut Timer, input: &FrameInput<'_>) {
        // Surfels have layers of their own.
        let layers = input.layers.as_ref().filter(|_| !self.is_surface);
        let camera = camera_uniform(
            input.camera,
            input.frustum,
            input.is_culled,
            input.choice,
            layers,
        );
        let view = ViewUniform {
            directional_keys: u32::from(layers.is_some()),
            ..input.view
        };
        let lighting = input.lighting.as_ref();
        self.buffers.write(gpu, &view, &camera, lighting);
        if let (Some(buffer), Some(transfer)) = (&self.classes, input.post) {
            gpu.write(buffer, bytemuck::cast_slice(&classes(transfer)));
        }
        let mut encoder = gpu.encoder();
        self.encode_until_sorted(&mut encoder, timer);
        gpu.submit(encoder);
    }

    /// Submits what draws a band's pixels.
    pub(super) fn draw_band(&self, gpu: &Gpu, timer: &mut Timer, band: u32) {
        let bytes = size_of::<ChunkState>() as u64;
        let steps = u64::from(band) * u64::from(self.plan.chunks);
        let mut place = self.plan.report_places(self.parts.len()).chunks + steps * bytes;
        for chunk in 0..self.plan.chunks {
            self.write_step(gpu, band, chunk);
            let mut encoder = gpu.encoder();
            if chunk == 0 {
                encoder.clear_buffer(&self.progress, 0, None);
            }
            self.encode_chunk(&mut encoder, timer, band);
            let state = &self.gather.state;
            encoder.copy_buffer_to_buffer(state, 0, &self.report, place, bytes);
            place += bytes;
            if chunk + 1 == self.plan.chunks {
                self.encode_band_end(&mut encoder, timer, band);
            }
            gpu.submit(encoder);
        }
    }

    /// Adds what the tiles of the band that was drawn last counted.
    ///
    /// # Errors
    /// A lost device.
    pub(super) fn read_tiles(&self, gpu: &Gpu, band: u32, counts: &mut TileCounts) -> Result<()> {
        let tiles = self.plan.bands.tiles[0] * self.plan.bands.band(band).1;
        gpu.read_staging(&self.progress_back, |bytes| {
            let tiles = bytes
                .chunks_exact(size_of::<TileProgress>())
                .take(tiles as usize);
            for tile in tiles.map(|tile| at::<TileProgress>(tile, 0)) {
                counts.splat_pixels += tile.splat_pixels();
                counts.layers_needed = counts.layers_needed.max(tile.layers_needed);
            }
        })
    }

    /// What the pass found out, all bands drawn.
    ///
    /// # Errors
    /// A lost device.
    pub(super) fn read_report(&self, gpu: &Gpu, tiles: TileCounts) -> Result<Seen> {
        let places = self.plan.report_places(self.parts.len());
        gpu.read_staging(&self.report, |report| {
            let parts =
                (0..self.parts.len()).map(|i| at(report, (i * size_of::<PartState>()) as u64));
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
    }

    /// Cull, classify, shade, project, sort; and their part of the report.
    fn encode_until_sorted(&self, encoder: &mut CommandEncoder, timer: &mut Timer) {
        let places = self.plan.report_places(self.parts.len());
        encoder.clear_buffer(&self.near, 0, Some(4));
        encoder.clear_buffer(&self.gather.state, 0, None);
        self.cull.encode(&mut timer.pass(encoder, Stage::Cull));
        {
            let mut pass = timer.pass(encoder, Stage::Classify);
            self.classify.iter().for_each(|p| p.encode(&mut pass));
            self.shade.iter().for_each(|p| p.encode(&mut pass));
            self.light.iter().for_each(|p| p.encode(&mut pass));
        }
        let count = u64::from(4 * CLASSIFIED_COUNT);
        for (i, part) in (0..).zip(&self.parts) {
            encoder.copy_buffer_to_buffer(&part.state, count, &self.counts, 4 * i, 4);
        }
        {
            let mut pass = timer.pass(encoder, Stage::Project);
            for (project, part) in self.project.iter().zip(&self.parts) {
                let particles = u64::from(4 * PARTICLE_ARGUMENTS);
                project.dispatch_indirect(&mut pass, &part.arguments, particles);
            }
        }
        self.sort.encode(&mut timer.pass(encoder, Stage::Sort));
        let bytes = size_of::<PartState>() as u64;
        for (i, part) in (0..).zip(&self.parts) {
            encoder.copy_buffer_to_buffer(&part.state, 0, &self.report, bytes * i, bytes);
        }
        let bytes = size_of::<SortState>() as u64;
        encoder.copy_buffer_to_buffer(&self.sort.state, 0, &self.report, places.sort, bytes);
        encoder.copy_buffer_to_buffer(&self.near, 0, &self.report, places.near, 4);
        let filters = offset_of!(FrameState, filters) as u64;
        let state = &self.buffers.state;
        encoder.copy_buffer_to_buffer(state, filters, &self.report, places.filters, FILTER_BYTES);
    }

    /// What the next submission draws: a chunk of a band.
    fn write_step(&self, gpu: &Gpu, band: u32, chunk: u32) {
        let (first_row, rows) = self.plan.bands.band(band);
        let of_chunk = ChunkUniform {
            start: chunk * self.plan.chunk,
            capacity: self.plan.chunk,
            band_first: [0, first_row],
            band_size: [self.plan.bands.tiles[0], rows],
            is_last: u32::from(chunk + 1 == self.plan.chunks),
            unused: 0,
        };
        gpu.write(&self.chunk, bytemuck::bytes_of(&of_chunk));
    }

    fn encode_chunk(&self, encoder: &mut CommandEncoder, timer: &mut Timer, band: u32) {
        {
            let mut pass = timer.pass(encoder, Stage::Bin);
            self.gather.encode(&mut pass);
            self.bin.encode(&mut pass);
        }
        let tiles = self.plan.bands.tiles[0] * self.plan.bands.band(band).1;
        let mut pass = timer.pass(encoder, Stage::Rasterise);
        let rasterise = match &self.rasterise {
            BoundRaster::Surface(surface) => &surface.tiles,
            BoundRaster::Volumes(tiles, _) => tiles,
        };
        rasterise.encode(&mut pass, tiles, self.plan.chunk);
    }

    /// What follows a band's last chunk, and the way back of its counts.
    fn encode_band_end(&self, encoder: &mut CommandEncoder, timer: &mut Timer, band: u32) {
        let pixels = self.plan.bands.pixels(band);
        match &self.rasterise {
            BoundRaster::Surface(surface) => {
                surface.encode_pixels(&mut timer.pass(encoder, Stage::Rasterise), pixels);
            }
            BoundRaster::Volumes(_, Some(compose)) => {
                let mut pass = timer.pass(encoder, Stage::Rasterise);
                compose.dispatch(&mut pass, Resolve::groups(pixels));
            }
            BoundRaster::Volumes(_, None) => {}
        }
        let bytes = self.progress.size();
        encoder.copy_buffer_to_buffer(&self.progress, 0, &self.progress_back, 0, bytes);
    }
}
