//! A scene kept on a device, and its frames: the scene is uploaded once, a frame uploads a camera.
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
use rayon::prelude::*;
use wgpu::CommandEncoder;

use super::bin::{Bin, BoundBin, MAX_BAND_TILES};
use super::classify::{BoundClassify, bind_classify};
use super::cull::{BoundCull, Cull, camera_uniform};
use super::device::Gpu;
use super::gather::{BoundGather, Gather};
use super::kernel::BoundKernel;
use super::project::{Project, ProjectBuffers, ProjectSpec, near_bytes};
use super::rasterise::{
    BoundRasterise, RasterBuffers, RasterSpec, Rasterise, TileProgress, depth_of_word, pixel_words,
};
use super::resolve::{Background, Resolve};
use super::scene::{FrameBuffers, PARTICLE_ARGUMENTS, Part, PartBuffers, Scene};
use super::shade::{BoundShade, bind_shade};
use super::sort::{BoundSort, Sort};
use super::timer::{Stage, Timer};
use crate::blocks::{BlockedVolume, Frustum};
use crate::constants::TILE_SIZE;
use crate::error::{Error, Result};
use crate::image::{DepthImage, Image};
use crate::layout::{
    ChoiceUniform, ChunkState, ChunkUniform, ExactTerms, Footprint, FrameState, PartState,
    SortState, ViewUniform,
};
use crate::splat::Filter;
use crate::stats::{FrameCounts, StageTimes};
use crate::view::Camera;

/// What a frame is asked for.
#[derive(Debug, Clone, Copy)]
pub struct FrameInput<'a> {
    /// The view.
    pub camera: &'a Camera,
    /// What it sees, widened by the reach of the low-pass filter.
    pub frustum: &'a Frustum,
    /// Whether blocks outside the frustum are left out.
    pub is_culled: bool,
    /// The view in f32; the device finds its `key_scale`.
    pub view: ViewUniform,
    /// What blocks are drawn by.
    pub choice: ChoiceUniform,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau).
    pub linear_opacity: bool,
    /// Whether depths are wanted.
    pub depth: bool,
    /// Whether pixels count kernels instead of showing them.
    pub count: bool,
    /// Linear RGB behind everything.
    pub background: Option<[f32; 3]>,
}

/// What makes a frame's buffers and pipelines differ from another's.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FrameKind {
    size: [u32; 2],
    filter: u32,
    orthographic: u32,
    linear_opacity: bool,
    depth: bool,
    count: bool,
    /// Whether merged particles may be drawn.
    detail: bool,
}

impl FrameKind {
    fn of(input: &FrameInput<'_>) -> Self {
        Self {
            size: input.view.size,
            filter: input.view.filter_kind,
            orthographic: input.view.orthographic,
            linear_opacity: input.linear_opacity,
            depth: input.depth,
            count: input.count,
            detail: input.choice.level_of_detail != 0,
        }
    }

    /// Whether a footprint may be on the exact path.
    fn may_be_exact(&self) -> bool {
        let filters = [Filter::Adaptive as u32, Filter::Exact as u32];
        self.orthographic == 0 && filters.contains(&self.filter)
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
}

/// Classified particles of a part that there is room for before anything is known.
const FIRST_CLASSIFIED: u32 = 1 << 18;
/// The same of merged ones, of which a frame draws few.
const FIRST_MERGED: u32 = 1 << 14;
const FIRST_ENTRIES: u32 = 1 << 20;

/// Bytes of the picture that one thread copies at a time.
const COPY_BYTES: usize = 1 << 20;

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

/// Volumes on a device, and the memory of their frames.
#[derive(Debug)]
pub struct DeviceScene {
    gpu: Gpu,
    scene: Scene,
    block_count: usize,
    timer: Timer,
    room: Room,
    frame: Option<(FrameKind, Frame)>,
}

impl DeviceScene {
    /// Uploads volumes, each with its levels of detail after it.
    ///
    /// # Errors
    /// Too little memory on the device, or what only the CPU draws.
    pub fn new(gpu: Gpu, volumes: &[BlockedVolume]) -> Result<Self> {
        let scene = Scene::new(&gpu, volumes, gpu.max_binding_bytes())?;
        Ok(Self {
            timer: Timer::new(&gpu)?,
            block_count: volumes.iter().map(|v| v.blocks.len()).sum(),
            room: Room::first(&scene, gpu.max_binding_bytes()),
            frame: None,
            scene,
            gpu,
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Uploads the transfer function that a volume and its levels of detail were given: tables, no
    /// particle.
    pub fn set_transfer_function(&mut self, volume: usize, family: &[BlockedVolume]) {
        self.scene.set_transfer_function(&self.gpu, volume, family);
    }

    /// Draws a frame into `image` and, where asked for, `depth`.
    ///
    /// # Errors
    /// Too little memory on the device, or a device that is lost.
    pub fn render(
        &mut self,
        input: &FrameInput<'_>,
        image: &mut Image,
        depth: &mut Option<DepthImage>,
    ) -> Result<(FrameCounts, StageTimes)> {
        self.gpu.check()?;
        let (width, height) = (input.camera.width, input.camera.height);
        if (image.width, image.height) != (width, height) {
            *image = Image::new(width, height);
        }
        if !input.depth {
            *depth = None;
        } else if depth
            .as_ref()
            .is_none_or(|d| (d.width, d.height) != (width, height))
        {
            *depth = Some(DepthImage {
                width,
                height,
                depths: vec![0.0; width * height],
            });
        }
        let kind = FrameKind::of(input);
        loop {
            let frame = match self.frame.take() {
                Some((made_for, frame)) if made_for == kind => frame,
                // Its memory is free before the next one's is asked for.
                other => {
                    drop(other);
                    let made = Frame::new(&self.gpu, &self.scene, &input.view, &kind, &self.room);
                    if made.is_err() {
                        // Another frame may need less than this one found it did.
                        self.room = Room::first(&self.scene, self.gpu.max_binding_bytes());
                    }
                    made?
                }
            };
            let seen = frame.draw(&self.gpu, &mut self.timer, input, image, depth)?;
            let room = self.grown(&kind, &seen)?;
            if room == self.room {
                self.frame = Some((kind, frame));
                let times = self.timer.read(&self.gpu)?;
                return Ok((self.counts(&kind, &seen), times));
            }
            self.room = room;
        }
    }

    /// The room that a frame would have needed: what there is where that was enough.
    ///
    /// # Errors
    /// More than the device's bindings hold.
    fn grown(&self, kind: &FrameKind, seen: &Seen) -> Result<Room> {
        let limit = self.gpu.max_binding_bytes();
        let mut room = self.room.clone();
        let parts = self.scene.drawn(&mut room.classified, kind.detail);
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
            self.check_room("kernels across the camera plane", seen.near, most)?;
        }
        if seen.sort.exact > 0 {
            room.exact = true;
        }
        if seen.needed_entries > room.entries {
            let most = entries_limit(limit);
            if u64::from(seen.needed_entries) <= most {
                room.entries = with_slack(seen.needed_entries, most);
            } else {
                // Fewer footprints at a time, however many tiles each touches.
                let chunk = room.chunk.min(seen.sort.visible);
                if chunk <= 1 {
                    self.check_room("entries of one footprint", seen.needed_entries, most)?;
                }
                let share = u64::from(chunk) * most / u64::from(seen.needed_entries);
                room.chunk = (share as u32).min(chunk / 2).max(1);
                room.entries = most as u32;
            }
        }
        Ok(room)
    }

    fn counts(&self, kind: &FrameKind, seen: &Seen) -> FrameCounts {
        let sum = |of: fn(&PartState) -> u32| seen.parts.iter().map(|p| of(p) as usize).sum();
        let views: usize = sum(|p| p.view_count);
        let parts = self.scene.drawn(0.., kind.detail).zip(&seen.parts);
        let merged = parts.filter(|((part, _), _)| part.kinds.is_merged);
        FrameCounts {
            blocks: self.block_count,
            blocks_culled: self.block_count - views,
            block_filters: seen.filters.map(|n| n as usize),
            blocks_merged: merged.map(|(_, state)| state.view_count as usize).sum(),
            classified: sum(|p| p.classified_count),
            footprints: seen.sort.visible as usize,
            surfels: 0,
            footprints_exact: seen.sort.exact as usize,
            footprints_near: seen.near as usize,
            tile_entries: seen.entries as usize,
            splat_pixels: seen.splat_pixels,
        }
    }

    fn check_room(&self, what: &str, needed: u32, most: u64) -> Result<()> {
        if u64::from(needed) <= most {
            return Ok(());
        }
        Err(Error::format(
            "GPU",
            self.gpu.adapter(),
            format!("at most {most} {what}"),
            needed.to_string(),
            "use --backend cpu",
        ))
    }
}

/// Footprints of a depth chunk at most: those whose buffer a binding holds, and fewer than overflow
/// a tile's count of splat-pixels, one of 32 bits for all its pixels.
fn chunk_limit(binding_bytes: u64) -> u32 {
    const COUNTABLE: u64 = u32::MAX as u64 / (TILE_SIZE * TILE_SIZE) as u64;
    let footprints = binding_bytes / size_of::<Footprint>() as u64;
    footprints.clamp(1, COUNTABLE) as u32
}

/// What a frame found out.
#[derive(Debug)]
struct Seen {
    parts: Vec<PartState>,
    sort: SortState,
    near: u32,
    /// Views by their filter.
    filters: [u32; 7],
    needed_entries: u32,
    entries: u64,
    splat_pixels: u64,
}

/// Which word of a [`PartState`] counts what the projection reads.
const CLASSIFIED_COUNT: u32 = (offset_of!(PartState, classified_count) / 4) as u32;

/// Buffers and bindings of frames of one kind.
#[derive(Debug)]
struct Frame {
    buffers: FrameBuffers,
    parts: Vec<PartBuffers>,
    near: wgpu::Buffer,
    cull: BoundCull,
    classify: Vec<BoundClassify>,
    shade: Vec<BoundShade>,
    project: Vec<BoundKernel>,
    counts: wgpu::Buffer,
    sort: BoundSort,
    chunk: wgpu::Buffer,
    gather: BoundGather,
    bin: BoundBin,
    rasterise: BoundRasterise,
    pixels: wgpu::Buffer,
    progress: wgpu::Buffer,
    background: wgpu::Buffer,
    resolve: BoundKernel,
    plan: Plan,
    report: wgpu::Buffer,
    pixels_back: wgpu::Buffer,
    progress_back: wgpu::Buffer,
}

/// How a frame is cut.
#[derive(Debug, Clone, Copy)]
struct Plan {
    /// Columns and rows of tiles of the image.
    tiles: [u32; 2],
    /// Rows of tiles of a band.
    band_rows: u32,
    /// Footprints of a chunk.
    chunk: u32,
    /// Chunks that hold all footprints that there is room for.
    chunks: u32,
    /// Words of a pixel.
    pixel_words: u64,
}

impl Plan {
    /// - `capacity`: classified particles that there is room for.
    /// - `chunk`: footprints of a chunk at most.
    fn new(gpu: &Gpu, kind: &FrameKind, capacity: u64, chunk: u32) -> Result<Self> {
        let tile = TILE_SIZE as u32;
        let tiles = kind.size.map(|n| n.div_ceil(tile));
        let pixel_words = pixel_words(kind.depth);
        let row_bytes = 4 * pixel_words * u64::from(kind.size[0]) * u64::from(tile);
        let rows = gpu.max_binding_bytes() / row_bytes;
        let rows = rows.min(u64::from(MAX_BAND_TILES / tiles[0]));
        if rows == 0 {
            return Err(Error::format(
                "GPU",
                gpu.adapter(),
                format!(
                    "rows of tiles of at most {} bytes, what a binding holds",
                    gpu.max_binding_bytes()
                ),
                format!("{row_bytes} bytes for one of {} pixels", kind.size[0]),
                "render a narrower image, or use --backend cpu",
            ));
        }
        let chunk = u64::from(chunk).min(capacity).max(1);
        Ok(Self {
            tiles,
            band_rows: rows.min(tiles[1].into()) as u32,
            chunk: chunk as u32,
            // One at least: it clears the image.
            chunks: capacity.div_ceil(chunk).max(1) as u32,
            pixel_words,
        })
    }

    fn bands(&self) -> u32 {
        self.tiles[1].div_ceil(self.band_rows)
    }

    /// First row of tiles and rows of a band.
    fn band(&self, band: u32) -> (u32, u32) {
        let first = band * self.band_rows;
        (first, self.band_rows.min(self.tiles[1] - first))
    }

    /// Bytes of the report: parts, the sort, near kernels, filters, chunks.
    fn report_places(&self, parts: usize) -> ReportPlaces {
        let sort = (parts * size_of::<PartState>()) as u64;
        let near = sort + size_of::<SortState>() as u64;
        let filters = near + 4;
        let chunks = filters + FILTER_BYTES;
        let steps = u64::from(self.bands()) * u64::from(self.chunks);
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

/// Where in a frame's report things lie, bytes.
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

impl Frame {
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        view: &ViewUniform,
        kind: &FrameKind,
        room: &Room,
    ) -> Result<Self> {
        let (drawn, capacities): (Vec<&Part>, Vec<u32>) = scene
            .drawn(room.classified.iter().copied(), kind.detail)
            .unzip();
        let capacity: u64 = capacities.iter().map(|n| u64::from(*n)).sum();
        let plan = Plan::new(gpu, kind, capacity, room.chunk)?;
        let buffers = FrameBuffers::new(gpu)?;
        let parts = drawn.iter().zip(&capacities);
        let parts = parts
            .map(|(part, capacity)| PartBuffers::new(gpu, part, *capacity))
            .collect::<Result<Vec<_>>>()?;
        let cull = Cull::new(gpu).bind(gpu, &buffers, &drawn, &parts)?;
        let classify = bind_classify(gpu, &buffers, &drawn, &parts)?;
        let shade = drawn.iter().zip(&parts);
        let shade = shade.filter_map(|(part, b)| bind_shade(gpu, &buffers, part, b));
        let near = gpu.buffer("near kernels", near_bytes(room.near.max(1) as usize))?;

        let mut footprints = Vec::with_capacity(parts.len());
        let mut project = Vec::with_capacity(parts.len());
        for ((part, of_part), capacity) in drawn.iter().zip(&parts).zip(&capacities) {
            let spec = ProjectSpec::new(&part.kinds, view, CLASSIFIED_COUNT);
            let bytes = |each: usize| u64::from(*capacity) * each as u64;
            let own = gpu.buffer("footprints", bytes(size_of::<Footprint>()))?;
            let exact = spec
                .may_be_exact()
                .then_some(bytes(size_of::<ExactTerms>()));
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

        let exact = room.exact && kind.may_be_exact();
        let chunk = gpu.uniform("chunk", &ChunkUniform::zeroed())?;
        let in_parts: Vec<_> = footprints
            .iter()
            .map(|(f, e)| (f, exact.then_some(e)))
            .collect();
        let chunk_capacity = u64::from(plan.chunk);
        let gather = Gather::new(gpu, exact).bind(gpu, &chunk, &sort, &in_parts, chunk_capacity)?;
        let tiles = plan.tiles[0] * plan.band_rows;
        let entries = u64::from(room.entries);
        let bin =
            Bin::new(gpu, exact).bind(gpu, &chunk, &gather, chunk_capacity, tiles, entries)?;

        let band_pixels = u64::from(kind.size[0]) * u64::from(plan.band_rows) * TILE_SIZE as u64;
        let pixel_bytes = 4 * plan.pixel_words * band_pixels;
        let progress_bytes = u64::from(tiles) * size_of::<TileProgress>() as u64;
        let pixels = gpu.buffer("pixels", pixel_bytes)?;
        let progress = gpu.buffer("tiles", progress_bytes)?;
        let spec = RasterSpec {
            exact,
            near: room.near > 0,
            depth: kind.depth,
            count: kind.count,
            linear_opacity: kind.linear_opacity,
        };
        let rasterise = Rasterise::new(gpu, spec).bind(
            gpu,
            &RasterBuffers {
                chunk: &chunk,
                view: &buffers.view,
                tile_ranges: &bin.ranges,
                tile_lists: &bin.entries.values,
                footprints: &gather.footprints,
                exact: &gather.exact,
                near: &near,
                pixels: &pixels,
                progress: &progress,
            },
        );
        let background = gpu.uniform("background", &Background::new([0.0; 3], 0))?;
        let resolve = Resolve::new(gpu).bind(gpu, &background, &pixels);
        let report = gpu.staging("report", plan.report_places(parts.len()).end)?;
        let pixels_back = gpu.staging("picture", pixel_bytes)?;
        let progress_back = gpu.staging("tiles", progress_bytes)?;
        Ok(Self {
            shade: shade.collect(),
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
            pixels,
            progress,
            background,
            resolve,
            plan,
            report,
            pixels_back,
            progress_back,
        })
    }

    fn draw(
        &self,
        gpu: &Gpu,
        timer: &mut Timer,
        input: &FrameInput<'_>,
        image: &mut Image,
        depth: &mut Option<DepthImage>,
    ) -> Result<Seen> {
        timer.clear();
        let camera = camera_uniform(input.camera, input.frustum, input.is_culled, input.choice);
        self.buffers.write(gpu, &input.view, &camera);
        let places = self.plan.report_places(self.parts.len());
        let mut encoder = gpu.encoder();
        self.encode_until_sorted(&mut encoder, timer, &places);
        gpu.submit(encoder);
        let mut splat_pixels = 0;
        let mut state_place = places.chunks;
        for band in 0..self.plan.bands() {
            for chunk in 0..self.plan.chunks {
                self.write_step(gpu, input, band, chunk);
                let mut encoder = gpu.encoder();
                if chunk == 0 {
                    encoder.clear_buffer(&self.progress, 0, None);
                }
                self.encode_chunk(&mut encoder, timer, band);
                let bytes = size_of::<ChunkState>() as u64;
                let state = &self.gather.state;
                encoder.copy_buffer_to_buffer(state, 0, &self.report, state_place, bytes);
                state_place += bytes;
                if chunk + 1 == self.plan.chunks {
                    self.encode_band_end(&mut encoder, timer, input, band);
                    if band + 1 == self.plan.bands() {
                        timer.finish(&mut encoder);
                    }
                }
                gpu.submit(encoder);
            }
            splat_pixels += self.read_band(gpu, input, band, image, depth)?;
        }
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
                splat_pixels,
            }
        })
    }

    /// Cull, classify, shade, project, sort; and their part of the report.
    fn encode_until_sorted(
        &self,
        encoder: &mut CommandEncoder,
        timer: &mut Timer,
        places: &ReportPlaces,
    ) {
        encoder.clear_buffer(&self.near, 0, Some(4));
        encoder.clear_buffer(&self.gather.state, 0, None);
        self.cull.encode(&mut timer.pass(encoder, Stage::Cull));
        {
            let mut pass = timer.pass(encoder, Stage::Classify);
            self.classify.iter().for_each(|p| p.encode(&mut pass));
            self.shade.iter().for_each(|p| p.encode(&mut pass));
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
    fn write_step(&self, gpu: &Gpu, input: &FrameInput<'_>, band: u32, chunk: u32) {
        let (first_row, rows) = self.plan.band(band);
        let columns = self.plan.tiles[0];
        let of_chunk = ChunkUniform {
            start: chunk * self.plan.chunk,
            capacity: self.plan.chunk,
            band_first: [0, first_row],
            band_size: [columns, rows],
        };
        gpu.write(&self.chunk, bytemuck::bytes_of(&of_chunk));
        if let Some(colour) = input.background {
            let background = Background::new(colour, self.band_pixels(input, band));
            gpu.write(&self.background, bytemuck::bytes_of(&background));
        }
    }

    /// Pixels of the image in a band.
    fn band_pixels(&self, input: &FrameInput<'_>, band: u32) -> u32 {
        let [width, height] = input.view.size;
        let tile = TILE_SIZE as u32;
        let (first_row, rows) = self.plan.band(band);
        width * (rows * tile).min(height - first_row * tile)
    }

    fn encode_chunk(&self, encoder: &mut CommandEncoder, timer: &mut Timer, band: u32) {
        {
            let mut pass = timer.pass(encoder, Stage::Bin);
            self.gather.encode(&mut pass);
            self.bin.encode(&mut pass);
        }
        let tiles = self.plan.tiles[0] * self.plan.band(band).1;
        let mut pass = timer.pass(encoder, Stage::Rasterise);
        self.rasterise.encode(&mut pass, tiles, self.plan.chunk);
    }

    /// The background, and the way back.
    fn encode_band_end(
        &self,
        encoder: &mut CommandEncoder,
        timer: &mut Timer,
        input: &FrameInput<'_>,
        band: u32,
    ) {
        let pixels = self.band_pixels(input, band);
        if input.background.is_some() {
            let mut pass = timer.pass(encoder, Stage::Resolve);
            self.resolve.dispatch(&mut pass, Resolve::groups(pixels));
        }
        let bytes = 4 * self.plan.pixel_words * u64::from(pixels);
        encoder.copy_buffer_to_buffer(&self.pixels, 0, &self.pixels_back, 0, bytes);
        let bytes = self.progress.size();
        encoder.copy_buffer_to_buffer(&self.progress, 0, &self.progress_back, 0, bytes);
    }

    /// Copies a band's rows into the image; returns its splat-pixels.
    fn read_band(
        &self,
        gpu: &Gpu,
        input: &FrameInput<'_>,
        band: u32,
        image: &mut Image,
        depth: &mut Option<DepthImage>,
    ) -> Result<u64> {
        let (first_row, rows) = self.plan.band(band);
        let first = first_row as usize * TILE_SIZE * image.width;
        let count = self.band_pixels(input, band) as usize;
        gpu.read_staging(&self.pixels_back, |bytes| {
            let (colours, depths) = bytes.split_at(16 * count);
            let pixels = bytemuck::cast_slice_mut::<_, u8>(&mut image.pixels[first..first + count]);
            // On a graphics card one thread's copy would take longer than the frame.
            pixels
                .par_chunks_mut(COPY_BYTES)
                .zip(colours.par_chunks(COPY_BYTES))
                .for_each(|(to, from)| to.copy_from_slice(from));
            if let Some(depth) = depth {
                let words = bytemuck::cast_slice::<u8, f32>(&depths[..4 * count]);
                for (out, word) in depth.depths[first..first + count].iter_mut().zip(words) {
                    *out = depth_of_word(*word);
                }
            }
        })?;
        let tiles = (self.plan.tiles[0] * rows) as usize;
        gpu.read_staging(&self.progress_back, |bytes| {
            bytes
                .chunks_exact(size_of::<TileProgress>())
                .take(tiles)
                .map(|tile| at::<TileProgress>(tile, 0).splat_pixels())
                .sum()
        })
    }
}
