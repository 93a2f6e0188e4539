//! Scene + camera + settings -> frame.

mod column;

use std::ops::Range;
use std::time::Instant;

use crate::blocks::{
    BlockedVolume, DepthRange, Frustum, Layers, choose, cull, cull_detail, distance_interval,
    set_transfer_function,
};
use crate::constants::{
    DEFAULT_LOW_PASS_VARIANCE_PX2, DEFAULT_TOLERANCE, MAX_CLIP_PLANES, MAX_CUTOFF, TILE_SIZE,
};
use crate::cpu::{
    self, Bins, NormalTile, PostClassification, ProjectOutput, RasteriseSettings, SimdLevel, Tile,
};
use crate::error::{Error, Result};
#[cfg(feature = "gpu")]
use crate::gpu::{AdapterChoice, DeviceScene, FrameInput, FrameOutput, Gpu};
use crate::image::{DepthImage, Image, NormalImage};
use crate::layout::{
    BlockView, ChoiceUniform, ClassifiedParticle, ExactTerms, Footprint, LightingUniform,
    PATH_EXACT, ViewUniform,
};
use crate::scene::{Colour, Lighting, PointVolume, Requirements, Strength, TransferFunction};
use crate::splat::{Composite, Filter, SPLAT_LOW_PASS_PX2};
use crate::view::{Bounds, Camera, ClipPlane, Projection};
use glam::{DVec2, DVec3};

pub use crate::stats::{FrameCounts, StageTimes};
use column::ColumnMemory;
pub use column::ColumnSettings;

/// How a frame is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The error in linear colour, as a fraction of full scale, that all approximations together
    /// may add to 99.9 % of pixels; [`splat::budget`](crate::splat::budget) says how it is shared
    /// out among them.
    pub tolerance: f32,
    /// Which footprint draws a kernel. Splats that state their opacity are always drawn by the
    /// rule of their format, [`peak_footprint`](crate::splat::peak_footprint).
    pub filter: Filter,
    /// c_min and c_max of eq. 7 of Chen et al. 2004, by hand: under [`Filter::Adaptive`] blocks
    /// nearer than c_min r_k/r_h are drawn by the reconstruction kernel alone, those beyond
    /// c_max (1 + 2 tan²(fov/2)) r_k/r_h by the low-pass filter alone, others by the resampling
    /// filter; none exactly, none merged. `None` follows the tolerance. The paper's: .3 and 2.
    pub thresholds: Option<[f32; 2]>,
    /// Whether particles far below a pixel are drawn merged, under [`Filter::Adaptive`].
    pub level_of_detail: bool,
    /// What the picture shows.
    pub show: Show,
    /// Opacity min(tau, 1) instead of 1 - exp(-tau): off by at most tau²/2 for one kernel, by at
    /// most a share 1/e of the greatest tau for many behind one another.
    pub linear_opacity: bool,
    /// How kernels that lie behind one another become a picture.
    pub composite: Composite,
    /// Thickness of sheets and slabs, world units. `None`: of slabs what the tolerance allows, of sheets
    /// the distance between samples.
    pub layer_thickness: Option<f64>,
    /// Whether the transfer function, and light, are asked for each slab of each pixel, of the mean value
    /// there, instead of for each particle: sharper where the function is steep and samples are few.
    /// With [`Composite::Slabs`], for scenes of one volume with a field (and surfaces).
    pub post_classification: bool,
    /// Planes that keep one side of everything that is drawn; eight at most.
    pub clip: Vec<ClipPlane>,
    /// Variance of the low-pass filter, px²; splats that state their opacity have their own.
    pub low_pass_variance_px2: f32,
    /// Cut-off radius in standard deviations; `None` follows the tolerance.
    pub cutoff: Option<f32>,
    /// Linear RGB behind everything; `None` leaves the image transparent.
    pub background: Option<[f32; 3]>,
    /// Whether a depth image is wanted.
    pub depth: bool,
    /// Whether the normals of opaque surfels are wanted.
    pub normals: bool,
    /// The instruction set of the rasteriser.
    pub simd: SimdLevel,
    /// Light on surfels and on volumes that have normals; `None` shows colours as they are.
    pub lighting: Option<Lighting>,
    /// Whether kernels smaller than a pixel are as opaque as each would be alone. The filter
    /// spreads optical depths; a kernel that fills a tenth of a pixel and has a depth of 10 hides a
    /// fifth of it and is drawn as hiding more than half
    /// ([`sub_pixel_depth`](crate::splat::sub_pixel_depth)).
    ///
    /// For sparse sets of opaque particles, such as stars or droplets: the error of a hundred of
    /// depth 30 falls from .35 to .014 of full scale (root mean square, sigma .3 px). Where kernels
    /// fill pixels together it makes them too faint, as if light passed between them: one layer of a
    /// lattice with two samples to the pixel loses .04 of opacity at depth 4, eight layers .004, where
    /// depths are right to 1e-5 (`tests/sub_pixel.rs`). Merged particles know of their members'
    /// opacity and stay as they are; so do kernels that reach the eye.
    pub sub_pixel_opacity: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tolerance: DEFAULT_TOLERANCE,
            filter: Filter::Adaptive,
            thresholds: None,
            level_of_detail: true,
            show: Show::Scene,
            linear_opacity: false,
            composite: Composite::Over,
            layer_thickness: None,
            post_classification: false,
            clip: Vec::new(),
            low_pass_variance_px2: DEFAULT_LOW_PASS_VARIANCE_PX2,
            cutoff: None,
            background: None,
            depth: false,
            normals: false,
            simd: SimdLevel::best(),
            lighting: None,
            sub_pixel_opacity: false,
        }
    }
}

impl Settings {
    /// What lies behind what is shown. Numbers of kernels have black there: it adds nothing to them
    /// and makes them opaque.
    fn shown_background(&self) -> Option<[f32; 3]> {
        match self.show {
            Show::Count => Some([0.0; 3]),
            Show::Scene | Show::Choice => self.background,
        }
    }
}

/// What a picture shows: the scene, or how it is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Show {
    /// The scene.
    #[default]
    Scene = 0,
    /// Each splat in the colour of its path or of its level of detail.
    Choice = 1,
    /// \[n, n, n, 1\] with the number n of kernels that a pixel evaluated within their cut-off; no
    /// background. The sum over the picture is [`FrameCounts::splat_pixels`], as long as no pixel
    /// has more than 2²⁴.
    Count = 2,
}

/// What draws frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// A hardware GPU where there is one that the scene fits, the CPU otherwise: on a software
    /// adapter the CPU's own path is faster. Where the environment variable `EWA_ADAPTER` names an
    /// adapter, that one.
    #[default]
    Auto,
    /// A GPU, a software adapter where there is no other.
    Gpu,
    /// The processor.
    Cpu,
}

/// A scene made ready, and the memory of its frames: after the first frame of a size, a frame
/// allocates nothing of note.
#[derive(Debug)]
pub struct Renderer {
    /// Volumes and their levels of detail.
    volumes: Vec<BlockedVolume>,
    /// Each volume of the scene among `volumes`: itself, and its levels after it.
    families: Vec<Range<usize>>,
    closed: Vec<bool>,
    requirements: Vec<Requirements>,
    views: Vec<Vec<BlockView>>,
    classified: Vec<ClassifiedParticle>,
    footprints: Vec<Footprint>,
    exact: Vec<ExactTerms>,
    project_output: ProjectOutput,
    order: Vec<u64>,
    bins: Bins,
    tiles: Vec<Tile>,
    /// The opaque surfaces of the frame.
    surface: Vec<Tile>,
    surface_normals: Vec<NormalTile>,
    image: Image,
    depth: Option<DepthImage>,
    normals: Option<NormalImage>,
    column: ColumnMemory,
    layers: Option<Layers>,
    /// The transfer function of the volume whose particles carry values in its place.
    carried: Option<TransferFunction>,
    counts: FrameCounts,
    times: StageTimes,
    #[cfg(feature = "gpu")]
    device: Option<DeviceScene>,
}

/// Images at most this wide and high: pixel ranges are half words.
const MAX_IMAGE_SIZE: usize = 65_535;
/// Pixels of an image at most: 5 GiB of tiles and picture.
const MAX_IMAGE_PIXELS: usize = 1 << 27;

impl Renderer {
    /// Sorts the volumes' particles into blocks; frames are drawn on the CPU.
    ///
    /// # Errors
    /// More particles than a 32-bit index can name, or a volume that says it is classified and
    /// has no values or no transfer function.
    pub fn new(scene: Vec<PointVolume>) -> Result<Self> {
        let total: usize = scene.iter().map(|v| v.particles.len()).sum();
        if u32::try_from(total).is_err() {
            return Err(Error::format(
                "scene",
                "particles",
                "at most 4,294,967,295 particles",
                total.to_string(),
                "render a part of the data",
            ));
        }
        for volume in &scene {
            volume.validate()?;
        }
        let requirements = scene.iter().map(Requirements::of).collect();
        let mut volumes = Vec::new();
        let mut families = Vec::new();
        for volume in scene {
            let first = volumes.len();
            volumes.extend(BlockedVolume::with_detail(volume));
            families.push(first..volumes.len());
        }
        Ok(Self {
            requirements,
            families,
            closed: Vec::new(),
            views: vec![Vec::new(); volumes.len()],
            volumes,
            classified: Vec::new(),
            footprints: Vec::new(),
            exact: Vec::new(),
            project_output: ProjectOutput::default(),
            order: Vec::new(),
            bins: Bins::default(),
            tiles: Vec::new(),
            surface: Vec::new(),
            surface_normals: Vec::new(),
            image: Image::new(0, 0),
            depth: None,
            normals: None,
            column: ColumnMemory::default(),
            layers: None,
            carried: None,
            counts: FrameCounts::default(),
            times: StageTimes::default(),
            #[cfg(feature = "gpu")]
            device: None,
        })
    }

    /// As [`Renderer::new`], and keeps the scene on a GPU where `backend` asks for one.
    ///
    /// # Errors
    /// Those of [`Renderer::new`]; no adapter where one is asked for, or too little memory on it.
    pub fn with_backend(scene: Vec<PointVolume>, backend: Backend) -> Result<Self> {
        #[cfg(feature = "gpu")]
        {
            let is_asked_for = backend == Backend::Gpu || Gpu::is_adapter_named();
            let gpu = match backend {
                Backend::Cpu => None,
                _ if is_asked_for => Some(Gpu::open(AdapterChoice::Any)?),
                _ => Gpu::open(AdapterChoice::Hardware).ok(),
            };
            let mut renderer = Self::new(scene)?;
            renderer.device = match gpu.map(|gpu| DeviceScene::new(gpu, &renderer.volumes)) {
                // What is too large for the device, or not drawn on any.
                Some(Err(_)) if !is_asked_for => None,
                device => device.transpose()?,
            };
            Ok(renderer)
        }
        #[cfg(not(feature = "gpu"))]
        {
            if backend == Backend::Gpu {
                return Err(Error::format(
                    "GPU",
                    "back end",
                    "a build with the feature gpu",
                    "one without",
                    "build with it, or use the CPU",
                ));
            }
            Self::new(scene)
        }
    }

    /// Uploads the scene to a device, which draws all frames from now on.
    ///
    /// # Errors
    /// Too little memory on the device.
    #[cfg(feature = "gpu")]
    pub fn on(mut self, gpu: Gpu) -> Result<Self> {
        self.device = Some(DeviceScene::new(gpu, &self.volumes)?);
        Ok(self)
    }

    /// The adapter that draws the frames, or `None` where it is the CPU.
    pub fn adapter(&self) -> Option<String> {
        #[cfg(feature = "gpu")]
        return self.device.as_ref().map(|d| d.gpu().adapter());
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// Replaces the transfer function of a volume; its particles stay as and where they are.
    ///
    /// # Errors
    /// No such volume, or one that is not classified.
    pub fn set_transfer_function(
        &mut self,
        volume: usize,
        transfer: TransferFunction,
    ) -> Result<()> {
        let count = self.families.len();
        let classified = self.requirements.get(volume).map(|r| r.classification);
        if classified != Some(true) {
            return Err(Error::format(
                "scene",
                format!("volume {volume}"),
                format!("a classified volume, one of {count}"),
                if classified.is_some() {
                    "one with masses and colours of its own"
                } else {
                    "none"
                },
                "give the number of a volume whose masses or colours come from values",
            ));
        }
        let family = &mut self.volumes[self.families[volume].clone()];
        let transfer = if self.carried.is_some() && !family[0].is_surface() {
            let carrier = transfer.carrier();
            self.carried = Some(transfer);
            carrier
        } else {
            transfer
        };
        set_transfer_function(family, &transfer);
        #[cfg(feature = "gpu")]
        if let Some(device) = &mut self.device {
            device.set_transfer_function(volume, family);
        }
        Ok(())
    }

    /// Draws a frame; [`Renderer::image`] and the others hold its results until the next.
    ///
    /// # Errors
    /// An image of no pixels or of more than 65,535 along a side; settings out of range.
    pub fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<&Image> {
        check(camera, settings)?;
        let low_pass = if self.volumes.iter().any(BlockedVolume::is_of_splats) {
            settings.low_pass_variance_px2.max(SPLAT_LOW_PASS_PX2)
        } else {
            settings.low_pass_variance_px2
        };
        if settings.composite != Composite::Over
            && self.volumes.iter().any(BlockedVolume::is_of_splats)
        {
            return Err(Error::format(
                "settings",
                "composite",
                "over, by which splats that state their opacity are made",
                settings.composite.name(),
                "leave it out",
            ));
        }
        self.carry_values(settings)?;
        let layers = Layers::new(
            &self.volumes,
            camera,
            settings.composite,
            settings.layer_thickness,
            settings.tolerance.into(),
        )?;
        self.layers = layers;
        let planes = cull_planes(camera, &settings.clip, low_pass);
        let frustum = frustum(camera, low_pass).clipped(planes);
        #[cfg(feature = "gpu")]
        if self.device.is_some() {
            self.render_on_device(camera, settings, layers, &frustum)?;
            return Ok(&self.image);
        }
        self.render_on_cpu(camera, settings, layers, &frustum);
        Ok(&self.image)
    }

    /// Lets the particles of the one volume with a field carry their values, or their colours again, as
    /// the settings ask.
    fn carry_values(&mut self, settings: &Settings) -> Result<()> {
        if settings.post_classification == self.carried.is_some() {
            return Ok(());
        }
        let refuse = |found: &str| {
            Err(Error::format(
                "settings",
                "classification of slabs",
                "--composite slabs and one volume with a field",
                found,
                "leave it out",
            ))
        };
        let is_field = |v: &BlockedVolume| {
            matches!(v.strength, Strength::Classified { .. }) && v.colour == Colour::Classified
        };
        let mut volumes = (0..self.families.len())
            .filter(|&i| !self.volumes[self.families[i].start].is_surface());
        let (Some(volume), None) = (volumes.next(), volumes.next()) else {
            return refuse("none or several");
        };
        let own = &self.volumes[self.families[volume].start];
        let Some(transfer) = own.transfer_function.clone().filter(|_| is_field(own)) else {
            return refuse("masses or colours of its own");
        };
        if let Some(carried) = self.carried.take() {
            return self.set_transfer_function(volume, carried);
        }
        self.set_transfer_function(volume, transfer.carrier())?;
        self.carried = Some(transfer);
        Ok(())
    }

    /// The frame on the GPU.
    #[cfg(feature = "gpu")]
    fn render_on_device(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        layers: Option<Layers>,
        frustum: &Frustum,
    ) -> Result<()> {
        let Some(device) = &mut self.device else {
            return Ok(());
        };
        let start = Instant::now();
        let input = FrameInput {
            camera,
            frustum,
            is_culled: is_culled(settings),
            // The device finds the range of depth keys.
            view: view_uniform(camera, settings, layers, 0.0),
            layers,
            choice: choice_uniform(camera, settings),
            linear_opacity: settings.linear_opacity,
            depth: settings.depth,
            normals: settings.normals,
            count: settings.show == Show::Count,
            background: settings.shown_background(),
            lighting: lighting_uniform(camera, settings),
            post: self.carried.as_ref(),
        };
        let output = FrameOutput {
            image: &mut self.image,
            depth: &mut self.depth,
            normals: &mut self.normals,
        };
        let (counts, times) = device.render(&input, output)?;
        self.counts = counts;
        self.times = StageTimes {
            frame: start.elapsed().as_secs_f64() * 1e3,
            ..times
        };
        Ok(())
    }

    /// The frame on the CPU: opaque surfels first, then what lies in front of them.
    fn render_on_cpu(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        layers: Option<Layers>,
        frustum: &Frustum,
    ) {
        let frame_start = Instant::now();
        let mut times = StageTimes::default();
        let mut counts = FrameCounts {
            blocks: self.volumes.iter().map(|v| v.blocks.len()).sum(),
            ..FrameCounts::default()
        };
        let surfaces = self.data().filter(|v| v.is_surface()).count();
        let passes = [
            (surfaces > 0).then_some(Pass::Surface),
            (surfaces < self.families.len() || surfaces == 0).then_some(Pass::Volumes {
                is_cut: is_cut(settings, surfaces > 0),
            }),
        ];
        let mut seen = 0;
        for pass in passes.into_iter().flatten() {
            let frame = PassInput {
                pass,
                camera,
                settings,
                // Surfels have layers of their own.
                layers: layers.filter(|_| pass != Pass::Surface),
                frustum,
            };
            self.draw(&frame, &mut counts, &mut times);
            seen += self.views.iter().map(Vec::len).sum::<usize>();
        }
        counts.blocks_culled = counts.blocks - seen;

        let mut clock = Clock(Instant::now());
        if (self.image.width, self.image.height) != (camera.width, camera.height) {
            self.image = Image::new(camera.width, camera.height);
        }
        let tiles = match passes {
            [Some(_), None] => &self.surface,
            _ => &self.tiles,
        };
        cpu::resolve(tiles, settings.shown_background(), &mut self.image);
        let (width, height) = (camera.width, camera.height);
        self.depth = settings
            .depth
            .then(|| cpu::resolve_depth(tiles, width, height));
        self.normals = settings.normals.then(|| {
            // None without surfaces.
            cpu::resolve_normals(&self.surface_normals, camera, width, height)
        });
        times.resolve = clock.lap();
        times.frame = frame_start.elapsed().as_secs_f64() * 1e3;
        self.counts = counts;
        self.times = times;
    }

    /// All stages of one pass but the last.
    fn draw(&mut self, frame: &PassInput<'_>, counts: &mut FrameCounts, times: &mut StageTimes) {
        let &PassInput {
            pass,
            camera,
            settings,
            layers,
            frustum,
        } = frame;
        let mut clock = Clock(Instant::now());
        // Cull, and the range of depth keys over what is left and in view.
        let cull_by = is_culled(settings).then_some(frustum);
        let choice = choice_uniform(camera, settings);
        for family in &self.families {
            let volumes = &self.volumes[family.clone()];
            let views = &mut self.views[family.clone()];
            views.iter_mut().for_each(Vec::clear);
            if volumes[0].is_surface() != (pass == Pass::Surface) {
                continue;
            }
            if choice.level_of_detail != 0 {
                cull_detail(volumes, camera, cull_by, &choice, &mut self.closed, views);
            } else {
                cull(&volumes[0], camera, cull_by, &mut views[0]);
            }
            for (volume, views) in volumes.iter().zip(views) {
                choose(volume, camera, &choice, views);
                for view in &*views {
                    counts.block_filters[view.filter_kind as usize] += 1;
                }
                if volume.merged.is_some() {
                    counts.blocks_merged += views.len();
                }
            }
        }
        let in_view = self
            .volumes
            .iter()
            .zip(&self.views)
            .flat_map(|(volume, views)| views.iter().map(|v| &volume.blocks[v.block as usize]))
            .filter(|block| frustum.sees(camera, block));
        let range = match &layers {
            None => DepthRange::of(in_view.map(|block| distance_interval(camera, block))),
            Some(layers) => layers.depth_range(),
        };
        for (volume, views) in self.volumes.iter().zip(&mut self.views) {
            for view in views {
                let block = &volume.blocks[view.block as usize];
                let distance = match &layers {
                    None => distance_interval(camera, block).0,
                    Some(layers) => layers.axis.dot(camera.camera_point(block.origin)),
                };
                view.key = range.key(distance);
            }
        }
        let uniform = view_uniform(camera, settings, layers, range.keys_per_unit());
        times.cull += clock.lap();

        // Classify.
        let lighting = lighting_uniform(camera, settings);
        let carries = self.carried.is_some();
        let rotation = camera.camera_from_world.as_mat3();
        let totals = self.fill_classified(cpu::count_classified, |volume, views, out| {
            cpu::classify(volume, views, out);
            cpu::shade(volume, views, camera, out);
            if let (Some(lighting), false) = (&lighting, carries && !volume.is_surface()) {
                cpu::light(volume, views, rotation, lighting, out);
            }
        });
        counts.classified += self.classified.len();
        times.classify += clock.lap();

        self.project(pass, camera, settings, &uniform, &totals);
        times.project += clock.lap();

        cpu::sort(&self.footprints, &mut self.order);
        counts.footprints += self.order.len();
        times.sort += clock.lap();

        let columns = camera.width.div_ceil(TILE_SIZE);
        let rows = camera.height.div_ceil(TILE_SIZE);
        cpu::bin(
            &self.footprints,
            &self.exact,
            &self.order,
            [columns, rows],
            &mut self.bins,
        );
        counts.tile_entries += self.bins.len();
        times.bin += clock.lap();

        let any_exact = self.project_output.any_exact();
        let near = self.project_output.near();
        counts.footprints_near += near.len();
        let is_count = settings.show == Show::Count;
        if pass == Pass::Surface {
            self.surface.resize_with(columns * rows, Tile::default);
            let wanted = if settings.normals { columns * rows } else { 0 };
            self.surface_normals
                .resize_with(wanted, NormalTile::default);
            counts.splat_pixels += cpu::rasterise_surface(
                &uniform,
                settings.simd,
                is_count,
                &self.footprints,
                &self.exact,
                near,
                &self.bins,
                columns,
                &mut self.surface,
                &mut self.surface_normals,
            );
            times.rasterise += clock.lap();
            counts.surfels += self.order.len();
            return;
        }
        self.tiles.resize_with(columns * rows, Tile::default);
        let raster = RasteriseSettings {
            linear_opacity: settings.linear_opacity,
            depth: settings.depth,
            count: is_count,
            exact: any_exact,
            composite: settings.composite,
            level: settings.simd,
        };
        let post = self.carried.as_ref().map(|transfer| PostClassification {
            transfer,
            per_extinction: 1.0 / transfer.greatest_extinction(),
            lighting: lighting.as_ref(),
        });
        counts.splat_pixels += cpu::rasterise(
            &uniform,
            raster,
            &self.footprints,
            &self.exact,
            near,
            &self.bins,
            columns,
            &self.surface,
            post,
            &mut self.tiles,
        );
        times.rasterise += clock.lap();
        counts.footprints_exact = self.count_exact();
    }

    /// Counts the particles of all views and fills their places; returns each volume's
    /// number.
    fn fill_classified(
        &mut self,
        count: impl Fn(&BlockedVolume, &mut [BlockView]) -> usize,
        fill: impl Fn(&BlockedVolume, &[BlockView], &mut [ClassifiedParticle]),
    ) -> Vec<usize> {
        let mut totals = Vec::with_capacity(self.volumes.len());
        for (volume, views) in self.volumes.iter().zip(&mut self.views) {
            totals.push(count(volume, views));
        }
        resize(&mut self.classified, totals.iter().sum());
        let mut rest = self.classified.as_mut_slice();
        for ((volume, views), &total) in self.volumes.iter().zip(&self.views).zip(&totals) {
            let (out, others) = rest.split_at_mut(total);
            fill(volume, views, out);
            rest = others;
        }
        totals
    }

    /// Projects what was classified, `totals` of each volume.
    fn project(
        &mut self,
        pass: Pass,
        camera: &Camera,
        settings: &Settings,
        uniform: &ViewUniform,
        totals: &[usize],
    ) {
        resize(&mut self.footprints, self.classified.len());
        let is_cut = pass == Pass::Volumes { is_cut: true };
        let may_be_exact = matches!(settings.filter, Filter::Adaptive | Filter::Exact)
            && camera.projection == Projection::Perspective
            && !self.volumes.iter().all(BlockedVolume::is_of_splats);
        resize(
            &mut self.exact,
            if may_be_exact || pass == Pass::Surface || is_cut {
                self.classified.len()
            } else {
                0
            },
        );
        self.project_output.clear();
        let rotation = camera.camera_from_world.as_mat3();
        let mut first = 0;
        for ((volume, views), &total) in self.volumes.iter().zip(&self.views).zip(totals) {
            let range = first..first + total;
            cpu::project(
                volume,
                views,
                &self.classified[range.clone()],
                uniform,
                rotation,
                is_cut,
                &mut self.footprints[range.clone()],
                self.exact.get_mut(range).unwrap_or_default(),
                &self.project_output,
            );
            first += total;
        }
    }

    /// How many of the footprints in order are on the exact path.
    fn count_exact(&self) -> usize {
        let exact = |i: &&u64| self.footprints[cpu::footprint_index(**i)].path == PATH_EXACT;
        self.order.iter().filter(exact).count()
    }

    /// The last frame's image.
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// The last frame's depths, where the settings asked for them.
    pub fn depth(&self) -> Option<&DepthImage> {
        self.depth.as_ref()
    }

    /// The last frame's normals of opaque surfaces, where the settings asked for them.
    pub fn normals(&self) -> Option<&NormalImage> {
        self.normals.as_ref()
    }

    /// What the last frame counted.
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// The layers in which the last frame summed kernels, if it did.
    pub fn layers(&self) -> Option<&Layers> {
        self.layers.as_ref()
    }

    /// How long the last frame's stages took.
    pub fn times(&self) -> StageTimes {
        self.times
    }

    /// What each volume of the scene requires.
    pub fn requirements(&self) -> &[Requirements] {
        &self.requirements
    }

    /// Middles and half extents of the boxes that hold what is visible, for fitting a camera;
    /// world units.
    pub fn visible_boxes(&self) -> Vec<Bounds> {
        let of_volume = |volume: &BlockedVolume| match &self.carried {
            Some(transfer) if !volume.is_surface() => volume.visible_boxes_under(Some(transfer)),
            _ => volume.visible_boxes(),
        };
        self.data().flat_map(of_volume).collect()
    }

    /// Middles and half extents of the boxes that hold all particles, grown by one standard
    /// deviation; world units. For a camera that fits a column density, where nothing is
    /// transparent.
    pub fn boxes(&self) -> Vec<Bounds> {
        self.data().flat_map(BlockedVolume::boxes).collect()
    }

    /// How many particles all volumes have.
    pub fn particle_count(&self) -> usize {
        self.data().map(BlockedVolume::particle_count).sum()
    }

    /// The volumes themselves, without their levels of detail.
    fn data(&self) -> impl Iterator<Item = &BlockedVolume> {
        self.families
            .iter()
            .map(|family| &self.volumes[family.start])
    }

    /// Bytes kept per particle, blocks and levels of detail included, over all volumes.
    pub fn bytes_per_particle(&self) -> f64 {
        let bytes: usize = self.volumes.iter().map(BlockedVolume::bytes).sum();
        bytes as f64 / self.particle_count().max(1) as f64
    }

    /// The volumes in blocks, each with its levels of detail after it.
    pub fn volumes(&self) -> &[BlockedVolume] {
        &self.volumes
    }
}

/// What is drawn together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pass {
    /// Surfels of opaque surfaces.
    Surface,
    /// All that light passes through.
    Volumes {
        /// Whether opaque surfaces, drawn before, lie among it.
        is_cut: bool,
    },
}

/// What a pass of a frame is drawn by.
struct PassInput<'a> {
    pass: Pass,
    camera: &'a Camera,
    settings: &'a Settings,
    layers: Option<Layers>,
    frustum: &'a Frustum,
}

struct Clock(Instant);

impl Clock {
    /// Milliseconds since the last lap.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let elapsed = (now - self.0).as_secs_f64() * 1e3;
        self.0 = now;
        elapsed
    }
}

/// Resizes a buffer that will be overwritten: keeps its memory, clears nothing it holds.
fn resize<T: bytemuck::Zeroable + Clone>(buffer: &mut Vec<T>, len: usize) {
    buffer.resize(len, T::zeroed());
}

/// Whether blocks outside the frustum are left out: uniform scaling enlarges kernels beyond any
/// reach.
fn is_culled(settings: &Settings) -> bool {
    settings.filter != Filter::UniformScaling
}

/// The frustum, widened by the reach of the low-pass filter.
fn frustum(camera: &Camera, low_pass_variance_px2: f32) -> Frustum {
    let margin = f64::from(MAX_CUTOFF) * f64::from(low_pass_variance_px2).sqrt();
    Frustum::new(camera, margin)
}

/// Whether kernels may be cut, so that all have terms of their depth.
pub(crate) fn is_cut(settings: &Settings, has_surface: bool) -> bool {
    has_surface || !settings.clip.is_empty() || settings.composite == Composite::Slabs
}

/// Planes in camera space, of unit normals: inside where n . u + d >= 0. `check` has seen them.
fn clip_planes(camera: &Camera, planes: &[ClipPlane]) -> impl Iterator<Item = (DVec3, f64)> {
    planes
        .iter()
        .filter_map(ClipPlane::normalised)
        .map(|plane| {
            (
                camera.camera_from_world * plane.normal,
                plane.inside(camera.eye),
            )
        })
}

/// The same moved out by the reach of the low-pass filter, which spreads what lies beyond them: blocks
/// are left out by these.
fn cull_planes(
    camera: &Camera,
    planes: &[ClipPlane],
    low_pass_variance_px2: f32,
) -> impl Iterator<Item = (DVec3, f64)> {
    let reach_px = f64::from(MAX_CUTOFF) * f64::from(low_pass_variance_px2).sqrt();
    // World units, under perspective at a depth of 1.
    let reach = reach_px / camera.focal_px.min_element();
    clip_planes(camera, planes).map(move |(normal, distance)| match camera.projection {
        Projection::Orthographic => (normal, distance + reach),
        Projection::Perspective => {
            let wider = normal + DVec3::Z * reach;
            let length = wider.length().max(f64::MIN_POSITIVE);
            (wider / length, distance / length)
        }
    })
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "stages work in f32 and u32 by design, and `check` has bounded what is counted"
)]
fn view_uniform(
    camera: &Camera,
    settings: &Settings,
    layers: Option<Layers>,
    key_scale: f32,
) -> ViewUniform {
    let mut planes = [[0.0; 4]; MAX_CLIP_PLANES];
    for (to, (normal, distance)) in planes.iter_mut().zip(clip_planes(camera, &settings.clip)) {
        *to = normal.extend(distance).as_vec4().into();
    }
    let layer = |of: fn(&Layers) -> f64| layers.as_ref().map_or(0.0, of) as f32;
    ViewUniform {
        focal_px: camera.focal_px.as_vec2().into(),
        centre_px: camera.centre_px.as_vec2().into(),
        size: [camera.width, camera.height].map(|n| n as u32),
        orthographic: u32::from(camera.projection == Projection::Orthographic),
        filter_kind: settings.filter as u32,
        low_pass_variance_px2: settings.low_pass_variance_px2,
        tolerance: settings.tolerance,
        cutoff: settings.cutoff.unwrap_or(0.0),
        key_scale,
        show_choice: u32::from(settings.show == Show::Choice),
        directional_keys: u32::from(layers.is_some()),
        layer_near: layer(|l| l.near),
        layer_thickness: layer(|l| l.thickness),
        key_axis: layers.map_or([0.0; 3], |l| l.axis.as_vec3().into()),
        layer_shift: layers.map_or(0, |l| l.shift),
        composite: settings.composite as u32,
        clip_count: settings.clip.len() as u32,
        sub_pixel_opacity: u32::from(settings.sub_pixel_opacity),
        unused: 0,
        clip_planes: planes,
    }
}

/// The lights as the camera sees them.
fn lighting_uniform(camera: &Camera, settings: &Settings) -> Option<LightingUniform> {
    let lighting = settings.lighting.as_ref()?;
    Some(LightingUniform::new(lighting, camera))
}

fn choice_uniform(camera: &Camera, settings: &Settings) -> ChoiceUniform {
    let focal = camera.focal_px.as_vec2();
    // As far off the axis as the image reaches: 1 + 2 tan²(fov/2) for a square one.
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let farthest = camera.centre_px.max(size - camera.centre_px) / camera.focal_px;
    let stretch = match camera.projection {
        Projection::Perspective => 1.0 + farthest.as_vec2().length_squared(),
        Projection::Orthographic => 1.0,
    };
    let [c_min, c_max] = settings.thresholds.unwrap_or([0.0; 2]);
    let is_adaptive = settings.filter == Filter::Adaptive;
    let by_hand = is_adaptive && settings.thresholds.is_some();
    ChoiceUniform {
        focal_px: [focal.min_element(), focal.max_element()],
        thresholds: [c_min, c_max * stretch],
        by_hand: u32::from(by_hand),
        orthographic: u32::from(camera.projection == Projection::Orthographic),
        filter_kind: settings.filter as u32,
        low_pass_variance_px2: settings.low_pass_variance_px2,
        tolerance: settings.tolerance,
        level_of_detail: u32::from(
            // Slabs cut kernels that stand for many as if these were one.
            is_adaptive
                && !by_hand
                && settings.level_of_detail
                && settings.composite != Composite::Slabs,
        ),
    }
}

fn check(camera: &Camera, settings: &Settings) -> Result<()> {
    let refuse = |place: &str, expected: &str, found: String| {
        Err(Error::format(
            "settings",
            place,
            expected,
            found,
            "change it",
        ))
    };
    if !(1..=MAX_IMAGE_SIZE).contains(&camera.width)
        || !(1..=MAX_IMAGE_SIZE).contains(&camera.height)
    {
        let found = format!("{} x {}", camera.width, camera.height);
        return refuse("image size", "1 to 65,535 pixels along each side", found);
    }
    if camera.width * camera.height > MAX_IMAGE_PIXELS {
        let found = format!("{} x {}", camera.width, camera.height);
        return refuse("image size", "at most 134,217,728 pixels in all", found);
    }
    let is_camera = camera.eye.is_finite()
        && camera.camera_from_world.is_finite()
        && camera.centre_px.is_finite()
        && camera.focal_px.is_finite()
        && camera.focal_px.min_element() > 0.0;
    if !is_camera {
        let found = format!("{camera:?}");
        return refuse("camera", "finite numbers and positive focal lengths", found);
    }
    if let Some(background) = settings.background
        && !background.iter().all(|b| b.is_finite())
    {
        let found = format!("{background:?}");
        return refuse("background", "three finite numbers", found);
    }
    if let Some(lighting) = &settings.lighting {
        lighting.validate()?;
    }
    let h2 = settings.low_pass_variance_px2;
    if !(h2 >= 0.0 && h2.is_finite()) {
        return refuse("low-pass variance", "a number from 0 up", h2.to_string());
    }
    let tolerance = settings.tolerance;
    if !(tolerance > 0.0 && tolerance < 1.0) {
        return refuse(
            "tolerance",
            "a number between 0 and 1",
            tolerance.to_string(),
        );
    }
    if let Some(thickness) = settings.layer_thickness
        && !(thickness > 0.0 && thickness.is_finite())
    {
        let found = thickness.to_string();
        return refuse("thickness of layers", "a number above 0", found);
    }
    if settings.post_classification && settings.composite != Composite::Slabs {
        let found = settings.composite.name().to_string();
        return refuse("composite of classified slabs", "slabs", found);
    }
    if settings.clip.len() > MAX_CLIP_PLANES {
        let expected = format!("at most {MAX_CLIP_PLANES}");
        return refuse("clip planes", &expected, settings.clip.len().to_string());
    }
    if let Some(plane) = settings.clip.iter().find(|p| p.normalised().is_none()) {
        let found = format!("{plane:?}");
        return refuse(
            "clip plane",
            "finite numbers and a normal other than 0",
            found,
        );
    }
    if let Some(r) = settings.cutoff
        && !(r > 0.0 && r <= MAX_CUTOFF)
    {
        return refuse(
            "cut-off radius",
            "a number above 0, at most 7",
            r.to_string(),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn thresholds_have_the_papers_factor_of_the_field_of_view() {
        let settings = Settings {
            thresholds: Some([0.3, 2.0]),
            ..Settings::default()
        };
        let of = |camera: &Camera| choice_uniform(camera, &settings);
        let at = |size| Camera::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, 60.0, size);
        // tan² 30° = 1/3: 2 (1 + 2/3), within roundings of f32.
        let choice = of(&at([64, 64]));
        assert!((choice.thresholds[1] - 10.0 / 3.0).abs() < 1e-6);
        assert!((choice.thresholds[0] - 0.3).abs() < 1e-7);
        assert_eq!((choice.by_hand, choice.level_of_detail), (1, 0));
        // Twice as wide: tan² is 4/3 across, and the farthest corner counts.
        let wide = of(&at([128, 64])).thresholds[1];
        assert!((wide - 16.0 / 3.0).abs() < 1e-6, "{wide}");
        let flat = Camera::orthographic(DVec3::ZERO, DVec3::Y, DVec3::Z, 9.0, [64, 64]);
        assert!((of(&flat).thresholds[1] - 2.0).abs() < 1e-6);
    }
}
