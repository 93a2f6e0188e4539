//! Makes the buffers and bindings of a pass, for frames of one kind.

use bytemuck::Zeroable;

use super::bands::{Bands, Cuts};
use super::kind::PassKind;
use super::report::Report;
use super::retained::{Pass, Raster};
use crate::constants::CLASSIFICATION_TABLE_LEN;
use crate::error::Result;
use crate::gpu::bin::{Bin, BoundBin};
use crate::gpu::classify::{AmplitudeUniform, BoundClassify, bind_classify};
use crate::gpu::compose::Compose;
use crate::gpu::cull::{BoundCull, Cull, SeenFor};
use crate::gpu::device::Gpu;
use crate::gpu::gather::{BoundGather, Gather, Terms};
use crate::gpu::kernel::BoundKernel;
use crate::gpu::light::{BoundLight, bind_light};
use crate::gpu::project::{Project, ProjectBuffers, ProjectSpec, near_bytes};
use crate::gpu::rasterise::Rasterise;
use crate::gpu::scene::{FrameBuffers, Part, PartBuffers};
use crate::gpu::shade::{BoundShade, bind_encode, bind_shade};
use crate::gpu::sort::{BoundSort, Sort};
use crate::gpu::surface::{BoundSurface, Surface};
use crate::gpu::tile::{BoundTiles, TileBuffers, TileProgress};
use crate::record::{ChunkUniform, ExactTerms, Footprint, ViewUniform};
use crate::splat::{Classify, Profiles};

/// A rasteriser with its buffers, and the kernel that turns its last chunk into the band's pixels.
#[derive(Debug)]
pub(super) enum BoundRaster {
    Surface(BoundSurface),
    Volumes(BoundTiles, Option<BoundKernel>),
}

/// A buffer for the depths at which the rays of a band end.
#[derive(Debug)]
pub(super) struct EndBuffer {
    pub(super) buffer: wgpu::Buffer,
    /// Words of each of the band's pixels before the depths.
    pub(super) words_before: u64,
    /// True for depths as surfels state theirs.
    pub(super) of_surfels: bool,
}

/// Word of a [`PartState`](crate::record::PartState) with the count that the projection reads.
pub(super) const CLASSIFIED_COUNT: u32 =
    (std::mem::offset_of!(crate::record::PartState, classified_count) / 4) as u32;

/// Buffers and bindings of a pass, for frames of one kind.
#[derive(Debug)]
pub(in crate::gpu) struct PassFrame {
    pub(super) buffers: FrameBuffers,
    pub(super) parts: Vec<PartBuffers>,
    pub(super) near: wgpu::Buffer,
    pub(super) cull: BoundCull,
    pub(super) classify: Vec<BoundClassify>,
    /// An amplitude uniform of each part, if amplitudes are summed.
    pub(super) amplitudes: Vec<wgpu::Buffer>,
    pub(super) cell_volumes: Vec<f64>,
    pub(super) shade: Vec<BoundShade>,
    pub(super) light: Vec<BoundLight>,
    /// Encodes colours for the space of blending.
    pub(super) encode: Vec<BoundShade>,
    pub(super) project: Vec<BoundKernel>,
    pub(super) counts: wgpu::Buffer,
    pub(super) sort: BoundSort,
    pub(super) chunk: wgpu::Buffer,
    pub(super) gather: BoundGather,
    /// A word for each tile of the picture, 1 if it is drawn; `None` if all are.
    pub(super) drawn_tiles: Option<wgpu::Buffer>,
    pub(super) bin: BoundBin,
    pub(super) rasterise: BoundRaster,
    /// Buffers for the depths at which rays end.
    pub(super) ends: Vec<EndBuffer>,
    /// Table that classifies layers, if layers are classified.
    pub(super) classes: Option<wgpu::Buffer>,
    /// The frame's SPH kernel, of columns.
    pub(super) profiles: Option<wgpu::Buffer>,
    /// Pixels of a band.
    pub(in crate::gpu) pixels: wgpu::Buffer,
    pub(super) progress: wgpu::Buffer,
    pub(super) cuts: Cuts,
    pub(super) report: Report,
}

impl PassFrame {
    /// Makes the buffers and bindings.
    ///
    /// - `surface`: the pixels of the opaque surfaces that cut the pass' kernels.
    /// - `shadow_words`: the lights' grids and maps, if they have shadows.
    /// - `background`: a uniform of which the number of a band's pixels is read.
    ///
    /// # Errors
    /// Too little memory on the device.
    #[allow(
        clippy::too_many_arguments,
        reason = "the parts of a frame that a pass is bound to"
    )]
    pub(in crate::gpu) fn new(
        gpu: &Gpu,
        pass: &Pass,
        view: &ViewUniform,
        kind: &PassKind,
        bands: Bands,
        surface: Option<&wgpu::Buffer>,
        shadow_words: Option<&wgpu::Buffer>,
        background: &wgpu::Buffer,
    ) -> Result<Self> {
        let Pass {
            scene, capacity, ..
        } = pass;
        let (drawn, capacities): (Vec<&Part>, Vec<u32>) = scene
            .drawn(capacity.classified.iter().copied(), kind.detail)
            .unzip();
        let all_classified: u64 = capacities.iter().map(|n| u64::from(*n)).sum();
        let cuts = Cuts::new(bands, all_classified, capacity.chunk);
        let mut buffers = FrameBuffers::new(gpu)?;
        if let Some(words) = shadow_words {
            buffers.shadow_words = words.clone();
        }
        let parts = drawn.iter().zip(&capacities);
        let parts = parts
            .map(|(part, capacity)| PartBuffers::new(gpu, part, *capacity, kind.classified_by))
            .collect::<Result<Vec<_>>>()?;
        let seen_for = if kind.is_column() {
            SeenFor::Column
        } else {
            SeenFor::Picture
        };
        let cull = Cull::new(gpu).bind(gpu, &buffers, &drawn, &parts, seen_for)?;
        let amplitudes = kind.is_column().then(|| {
            let uniform = |_| gpu.uniform("amplitudes", &AmplitudeUniform::zeroed());
            drawn.iter().map(uniform).collect::<Result<Vec<_>>>()
        });
        let amplitudes = amplitudes.transpose()?;
        let amplitudes_of = amplitudes.as_deref();
        let classify = bind_classify(
            gpu,
            &buffers,
            &drawn,
            &parts,
            amplitudes_of,
            kind.classified_by,
        )?;
        // Signs of amplitudes take the place of colours.
        let shade = drawn.iter().zip(&parts).filter(|_| !kind.is_column());
        let shade =
            shade.filter_map(|(part, b)| bind_shade(gpu, &buffers, part, b, kind.is_encoded));
        // Layers that are classified are lit as layers.
        let is_classified = kind.axes.classify != Classify::Particle;
        let light = drawn.iter().zip(&parts).filter(|_| kind.lights_particles);
        let light = light.filter_map(|(part, b)| {
            bind_light(gpu, &buffers, part, b, kind.has_shadows, kind.classified_by)
        });
        let encode = drawn.iter().zip(&parts).filter(|_| kind.is_encoded);
        let encode = encode.filter_map(|(part, b)| bind_encode(gpu, part, b));
        let near = gpu.buffer("near kernels", near_bytes(capacity.near.max(1) as usize))?;

        let no_classes = || vec![[0.0_f32; 4]; CLASSIFICATION_TABLE_LEN];
        let classes = is_classified
            .then(|| gpu.uniform_list("classes of layers", &no_classes()))
            .transpose()?;
        let profiles = kind
            .is_column()
            .then(|| gpu.uniform("profiles", Profiles::of(0)))
            .transpose()?;
        let raster = pass.raster(gpu, kind);
        let has_edges = kind.axes.edges && matches!(raster, Raster::Volumes(_));
        let (is_cut, exact, terms) = match raster {
            Raster::Surface(_) => (false, false, Terms::OfAll),
            Raster::Volumes(spec) if spec.axes.needs_depth_terms() => {
                (true, spec.axes.may_be_exact, Terms::OfAll)
            }
            Raster::Volumes(spec) if has_edges => (false, spec.axes.may_be_exact, Terms::OfAll),
            Raster::Volumes(spec) => (
                false,
                spec.axes.may_be_exact,
                Terms::exact(spec.axes.may_be_exact),
            ),
        };
        let mut footprints = Vec::with_capacity(parts.len());
        let mut project = Vec::with_capacity(parts.len());
        for ((part, of_part), classified) in drawn.iter().zip(&parts).zip(&capacities) {
            let mut spec =
                ProjectSpec::new(&part.kinds, view, [is_cut, has_edges], CLASSIFIED_COUNT);
            spec.has_pieces = part.has_pieces(kind.classified_by);
            let bytes = |each: usize| u64::from(*classified) * each as u64;
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

        // The sort expects a word for each part, and at least one.
        let counts = gpu.upload("part counts", &vec![0_u32; parts.len().max(1)])?;
        let in_parts: Vec<_> = footprints.iter().map(|(f, _)| f).collect();
        let sort = Sort::new(gpu).bind(gpu, &counts, &in_parts, all_classified)?;

        let chunk = gpu.uniform("chunk", &ChunkUniform::zeroed())?;
        let has_terms = terms != Terms::None;
        let in_parts: Vec<_> = footprints
            .iter()
            .map(|(f, e)| (f, has_terms.then_some(e)))
            .collect();
        let chunk_capacity = u64::from(cuts.chunk);
        let gather = Gather::new(gpu, terms).bind(gpu, &chunk, &sort, &in_parts, chunk_capacity)?;
        let tiles = bands.tiles[0] * bands.rows;
        let entries = u64::from(capacity.entries);
        // For kernels on the exact path, and for surfels that follow the homography of their planes.
        let has_outlines = exact || matches!(raster, Raster::Surface(_));
        let bin = Bin::new(gpu, has_outlines);
        let words = u64::from(bands.tiles[0]) * u64::from(bands.tiles[1]);
        let drawn_tiles = kind
            .is_masked
            .then(|| gpu.buffer("drawn tiles", 4 * words))
            .transpose()?;
        let bin = bin.bind(
            gpu,
            &chunk,
            &gather,
            chunk_capacity,
            tiles,
            entries,
            drawn_tiles.as_ref(),
        )?;

        let pixels_of = |label, words: u64| gpu.buffer(label, 4 * words * bands.most_pixels());
        let progress_bytes = u64::from(tiles) * size_of::<TileProgress>() as u64;
        let progress = gpu.buffer("tiles", progress_bytes)?;
        let of_tiles = TileBuffers {
            chunk: &chunk,
            view: &buffers.view,
            tile_ranges: &bin.ranges,
            tile_lists: &bin.entries.sorted_values,
            footprints: &gather.footprints,
            terms: &gather.exact,
            near: &near,
            progress: &progress,
        };
        let pixels;
        let mut ends = Vec::new();
        let rasterise = match raster {
            Raster::Surface(spec) => {
                pixels = pixels_of("pixels of surfaces", spec.pixel_words())?;
                let layers = pixels_of("layers of surfaces", spec.layer_words())?;
                let own = pixels_of("ends of rays", u64::from(spec.ends))?;
                let bound = Surface::new(gpu, spec).bind(gpu, &of_tiles, &layers, &pixels, &own);
                if spec.ends {
                    ends.push(EndBuffer {
                        buffer: own,
                        words_before: 0,
                        of_surfels: true,
                    });
                }
                BoundRaster::Surface(bound)
            }
            Raster::Volumes(spec) => {
                pixels = pixels_of("pixels", spec.pixel_words())?;
                let is_alone = spec.axes.ends && surface.is_none();
                let own = pixels_of("ends of rays", u64::from(is_alone))?;
                let behind = surface.unwrap_or(&own);
                if spec.axes.ends {
                    ends.push(EndBuffer {
                        buffer: behind.clone(),
                        words_before: spec.words_before_ends(),
                        of_surfels: false,
                    });
                }
                let rasterise = Rasterise::new(gpu, spec);
                let mut tables: Vec<_> = profiles.iter().collect();
                if let Some(classes) = &classes {
                    tables.extend([classes, &buffers.lighting]);
                }
                let bound = rasterise.bind(gpu, &of_tiles, &pixels, behind, &tables);
                let compose = surface.map(|surface| {
                    Compose::new(gpu, &spec.axes).bind(gpu, background, &pixels, surface)
                });
                BoundRaster::Volumes(bound, compose)
            }
        };
        let report = Report::new(gpu, parts.len(), cuts.steps(), tiles)?;
        Ok(Self {
            shade: shade.collect(),
            light: light.collect(),
            encode: encode.collect(),
            buffers,
            parts,
            near,
            cull,
            cell_volumes: drawn.iter().map(|part| part.cell_volume).collect(),
            amplitudes: amplitudes.unwrap_or_default(),
            classify,
            project,
            counts,
            sort,
            chunk,
            gather,
            drawn_tiles,
            bin,
            rasterise,
            ends,
            classes,
            profiles,
            pixels,
            progress,
            cuts,
            report,
        })
    }
}
