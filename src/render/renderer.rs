//! Draws frames of a scene, given a camera and settings.

use std::sync::Arc;

use super::options::{Contents, RendererOptions};
use super::shadows::ShadowsKept;
use crate::blocks::{AmplitudeSummary, BlockedParticles, BlockedScene, BlockedVolume, Layers};
use crate::collective::Collective;
use crate::constants::{
    DEFAULT_LOW_PASS_VARIANCE_PX2, FIELD_LOW_PASS_VARIANCE_PX2, PARTICLE_LOW_PASS_VARIANCE_PX2,
    TILE_SIZE,
};
use crate::cpu::CpuFrames;
use crate::error::{Error, Result};
use crate::frame::backdrop::Backdrop;
#[cfg(not(feature = "gpu"))]
use crate::frame::backend::NoDevice as Device;
use crate::frame::backend::{DrawFrames, Edit, FrameReport, Images, OpenBackend};
use crate::frame::check::{check, check_scene};
use crate::frame::plan::FramePlan;
use crate::frame::settings::{Settings, Show};
use crate::frame::supersample::{Region, choose, may_supersample, regions};
#[cfg(feature = "gpu")]
use crate::gpu::{DeviceScene as Device, Gpu};
use crate::image::{DepthImage, Image, NormalImage};
#[cfg(feature = "prepared")]
use crate::prepared::PreparedScene;
use crate::ranks::{RankFrames, RankStats};
use crate::scene::{Lighting, PointVolume, Requirements, StrengthIn, TransferFunction, Values};
use crate::stats::{FrameCounts, StageTimes};
use crate::view::{Bounds, Camera};

/// A scene ready to be drawn, and the memory of its frames. After the first frame of a size, a frame
/// allocates almost nothing.
///
/// A renderer may move to a thread of its own, so that a window stays responsive while it draws:
///
///
/// ```
/// use std::sync::mpsc::channel;
///
/// use ewa_splat::{Renderer, Settings, scene::PointVolume, view::Camera};
/// use glam::DVec3;
///
/// # fn main() -> ewa_splat::Result<()> {
/// let ball = PointVolume::spheres([DVec3::ZERO], [0.5]).with_masses([1.0]);
/// let mut renderer = Renderer::new(vec![ball])?;
/// let (cameras, wanted) = channel::<Camera>();
/// let drawing = std::thread::spawn(move || {
///     let draw = |camera| Ok(renderer.render(&camera, &Settings::default())?.clone());
///     wanted.iter().map(draw).collect::<ewa_splat::Result<Vec<_>>>()
/// });
/// let camera = Camera::perspective(DVec3::Y * -5.0, DVec3::ZERO, DVec3::Z, 40.0, [64, 48]);
/// cameras.send(camera).unwrap();
/// drop(cameras);
/// assert_eq!(drawing.join().unwrap()?.len(), 1);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Renderer {
    pub(super) scene: BlockedScene,
    pub(super) cpu: CpuFrames,
    /// The device that draws instead of the CPU, if there is one.
    pub(super) device: Option<Device>,
    /// The ranks that draw instead of either, if the scene's particles are partitioned among ranks.
    ranks: Option<RankFrames>,
    /// True if the CPU draws the frames that the device cannot.
    falls_back: bool,
    /// Reason why the CPU drew the last frame although there is a device.
    pub(super) fallback: Option<String>,
    pub(super) images: Images,
    /// Samples of the tiles that a frame draws again.
    pub(super) samples: Images,
    pub(super) amplitudes: Option<AmplitudeSummary>,
    layers: Option<Layers>,
    pub(super) report: FrameReport,
    pub(super) coarser: Coarser,
    shadows: ShadowsKept,
}

/// The scene on coarser lattices, and the choice among them.
#[derive(Debug, Default)]
pub(super) struct Coarser {
    /// The scene at half as many samples along each axis, at a quarter, and so on; empty before a frame has asked.
    pub(super) levels: Vec<Renderer>,
    pub(super) are_made: bool,
    /// Errors that were measured, the last ones last.
    pub(super) measured: Vec<MeasuredLevels>,
    /// The errors that were asked for last; empty before.
    pub(super) last: Vec<f32>,
    /// Milliseconds of measurements that no frame has reported.
    pub(super) time: f64,
}

/// Errors of coarser lattices.
#[derive(Debug)]
pub(super) struct MeasuredLevels {
    /// Settings, without what the errors do not depend on.
    pub(super) settings: Settings,
    /// Binary logarithm of the pixels for each cell.
    pub(super) zoom: i32,
    /// Error that the allowed share of pixels exceed, for each coarser level; full scale is 1.
    pub(super) errors: Vec<f32>,
    /// Whether all directions were looked at. Otherwise the first ones have refused all levels.
    pub(super) is_complete: bool,
}

/// Returns true if all coarser levels err by more than a bound. The finest does not decide alone: it may err most.
pub(super) fn refuse_all(errors: &[f32], bound: f32) -> bool {
    errors.iter().all(|error| *error > bound)
}

impl MeasuredLevels {
    /// Whether the errors decide which levels are within a bound.
    pub(super) fn suffices(&self, bound: f32) -> bool {
        self.is_complete || refuse_all(&self.errors, bound)
    }
}

impl Renderer {
    /// Makes a renderer of volumes with the default [`RendererOptions`]: the CPU draws the frames.
    ///
    /// # Errors
    /// The errors of [`Renderer::with_options`].
    pub fn new(volumes: Vec<PointVolume>) -> Result<Self> {
        Self::with_options(volumes, RendererOptions::default())
    }

    /// Makes a renderer of volumes or of prepared scenes. This is the one way in; [`Renderer::new`] only
    /// leaves out the options.
    ///
    /// - `scene`: a vector of [`PointVolume`]s, whose particles are sorted into blocks, or of
    ///   [`PreparedScene`](crate::prepared::PreparedScene)s (feature `prepared`).
    /// - `options`: [`RendererOptions`], or the only part that differs from the default: a
    ///   [`Backend`](super::Backend) or `&`[`SceneOptions`](super::SceneOptions).
    ///
    /// ```
    /// use ewa_splat::{Backend, Renderer, scene::PointVolume};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let ball = PointVolume::spheres([DVec3::ZERO], [0.5]).with_masses([1.0]);
    /// let renderer = Renderer::with_options(vec![ball], Backend::Auto)?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// More particles than a 32-bit index can number; a volume that is declared classified but has no
    /// values or no transfer function; work that was cancelled; the errors of
    /// [`Backend::open`](super::Backend::open) and of [`Renderer::on`].
    pub fn with_options(
        scene: impl Into<Contents>,
        options: impl Into<RendererOptions>,
    ) -> Result<Self> {
        let options = options.into();
        let scene = match scene.into() {
            Contents::Volumes(volumes) => BlockedScene::new(volumes, &options.scene)?,
            #[cfg(feature = "prepared")]
            Contents::Prepared(scenes) => {
                BlockedScene::joined(scenes.into_iter().map(PreparedScene::into_scene))?
            }
        };
        Self::of_scene(scene)?.on(options.backend.open()?)
    }

    pub(super) fn of_scene(scene: BlockedScene) -> Result<Self> {
        let mut cpu = CpuFrames::default();
        cpu.upload(&scene)?;
        Ok(Self {
            scene,
            cpu,
            device: None,
            ranks: None,
            falls_back: false,
            fallback: None,
            images: Images::default(),
            samples: Images::default(),
            amplitudes: None,
            layers: None,
            report: FrameReport::default(),
            coarser: Coarser::default(),
            shadows: ShadowsKept::default(),
        })
    }

    /// Moves the scene to a device, which draws all frames from now on. Serves callers that choose the
    /// device once the scene is known.
    ///
    /// - `device`: an opened [`Backend`](super::Backend), or a [`Gpu`](super::Gpu) (feature `gpu`). Clones of
    ///   one `Gpu` share compiled pipelines among several scenes.
    ///
    /// With [`Backend::Auto`](super::Backend::Auto) and [`OpenBackend::or_cpu`] the CPU draws whatever the
    /// device cannot, and [`Renderer::fallback`] returns the reason.
    ///
    /// # Errors
    /// Too little memory on a device that was explicitly asked for.
    #[cfg_attr(
        not(feature = "gpu"),
        expect(unused_mut, reason = "only a device changes the renderer")
    )]
    pub fn on(mut self, device: impl Into<OpenBackend>) -> Result<Self> {
        let opened = device.into();
        #[cfg(feature = "gpu")]
        if let Some((gpu, is_asked_for)) = opened.gpu {
            let device = Device::new(gpu).and_then(|mut device| {
                device.upload(&self.scene)?;
                Ok(device)
            });
            self.falls_back = !is_asked_for;
            match device {
                Ok(device) => self.device = Some(device),
                Err(error) if is_asked_for => return Err(error),
                Err(error) => self.fallback = Some(error.to_string()),
            }
        }
        #[cfg(not(feature = "gpu"))]
        let OpenBackend {} = opened;
        Ok(self)
    }

    /// Draws on the device of another renderer, too, if it has one.
    ///
    /// # Errors
    /// Too little memory on a device that was explicitly asked for.
    #[cfg_attr(
        not(feature = "gpu"),
        expect(unused_variables, reason = "only a device is shared")
    )]
    pub(super) fn on_device_of(self, other: &Self) -> Result<Self> {
        #[cfg(feature = "gpu")]
        if let Some(device) = &other.device {
            let gpu = Some((device.gpu().clone(), !other.falls_back));
            return self.on(OpenBackend { gpu });
        }
        Ok(self)
    }

    /// Returns the name of the adapter that draws the frames, or `None` for the CPU.
    pub fn adapter(&self) -> Option<String> {
        self.device.as_ref().and_then(|device| device.adapter())
    }

    /// Returns the reason why the CPU drew the last frame although
    /// [`Backend::Auto`](super::Backend::Auto) had chosen a device, or why the scene is kept on the CPU. `None` if nothing fell back.
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
    }

    /// Replaces the transfer function of a volume; its particles and their positions stay unchanged.
    ///
    /// # Errors
    /// No such volume, or one that is not classified.
    pub fn set_transfer_function(
        &mut self,
        volume: usize,
        transfer: TransferFunction,
    ) -> Result<()> {
        self.coarser.measured.clear();
        for level in &mut self.coarser.levels {
            level.set_transfer_function(volume, transfer.clone())?;
        }
        self.scene.set_transfer_function(volume, transfer)?;
        self.edited(Edit::TransferFunction(volume))
    }

    /// Replaces the values of a volume, for the next time step. Positions, shapes and the transfer
    /// function stay. The scene must have been made with
    /// [`SceneOptions::keep_shapes`](super::SceneOptions::keep_shapes).
    ///
    /// ```
    /// use ewa_splat::scene::{Particles, PointVolume, Strength, TransferFunction, Values};
    /// use ewa_splat::{SceneOptions, Renderer};
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// # let positions: Vec<glam::DVec3> = (0..9).map(|i| glam::DVec3::splat(f64::from(i))).collect();
    /// # let grey = TransferFunction::from_curves(|v| [v; 3], |v| v, [0.0, 1.0], 1.0)?;
    /// let spheres = Particles::Isotropic { positions, sigmas: vec![1.0; 9] };
    /// let volume = PointVolume::new(spheres, Strength::Classified { volumes: vec![1.0; 9] })
    ///     .classified(Values::F32(vec![0.1; 9]), grey);
    /// let options = SceneOptions { keep_shapes: true, ..SceneOptions::default() };
    /// let mut renderer = Renderer::with_options(vec![volume], &options)?;
    /// renderer.set_values(0, Values::F32(vec![0.7; 9]))?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// No such volume, one without values, another number of values than of particles, or a scene that
    /// did not keep its shapes.
    pub fn set_values(&mut self, volume: usize, values: Values) -> Result<()> {
        self.coarser = Coarser::default();
        self.scene.set_values(volume, values)?;
        self.amplitudes = None;
        self.edited(Edit::Values)
    }

    /// Partitions the scene among the ranks; before this call every rank has the whole scene. All ranks
    /// draw the frames, and the first rank has the images.
    ///
    /// # Errors
    /// A rank that has exited.
    pub(crate) fn over_ranks(mut self, ranks: Box<dyn Collective>) -> Result<Self> {
        let frames = RankFrames::sharing(ranks, &mut self.scene)?;
        self.by(frames)
    }

    /// Makes a renderer of a scene that is already partitioned among the ranks.
    ///
    /// # Errors
    /// A rank that has exited.
    pub(crate) fn of_shared(scene: BlockedScene, frames: RankFrames) -> Result<Self> {
        Self::of_scene(scene)?.by(frames)
    }

    fn by(mut self, mut frames: RankFrames) -> Result<Self> {
        frames.upload(&self.scene)?;
        self.amplitudes = Some(frames.amplitudes(&self.scene)?);
        self.ranks = Some(frames);
        Ok(self)
    }

    /// Returns this rank's number, if ranks share the scene.
    pub(crate) fn rank(&self) -> Option<usize> {
        self.ranks.as_ref().map(RankFrames::rank)
    }

    /// Returns each rank's statistics of the last frame; empty without ranks.
    pub(crate) fn rank_stats(&self) -> &[RankStats] {
        self.ranks.as_ref().map_or(&[], RankFrames::stats)
    }

    fn edited(&mut self, edit: Edit) -> Result<()> {
        self.shadows.kept = None;
        self.cpu.edit(&self.scene, edit)?;
        if let Some(ranks) = &mut self.ranks {
            ranks.edit(&self.scene, edit)?;
        }
        let Some(device) = &mut self.device else {
            return Ok(());
        };
        match device.edit(&self.scene, edit) {
            Err(error) if self.falls_back && error.is_of_device() => {
                // The device still holds the data of another time step.
                self.device = None;
                self.fallback = Some(error.to_string());
                Ok(())
            }
            edited => edited,
        }
    }

    /// Draws a frame. [`Renderer::image`] and the other getters return its results until the next frame.
    ///
    /// # Errors
    /// An image of no pixels or of more than 65,535 along a side; settings that are out of range, or that
    /// conflict with each other or with the scene; a device that is lost or has too little memory; a
    /// cancelled frame, which leaves the images partly drawn.
    pub fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<&Image> {
        self.render_some(camera, settings, None)
    }

    /// Draws some tiles of a frame as [`Renderer::render`] draws them, bit for bit. Other tiles are not defined.
    ///
    /// - `tiles`: whether each tile of 16 x 16 pixels is drawn, row by row.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`]; another number of tiles than the picture has.
    pub fn render_tiles(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        tiles: &[bool],
    ) -> Result<&Image> {
        let [columns, rows] = tile_grid(camera);
        if tiles.len() != columns.saturating_mul(rows) {
            return Err(Error::invalid(
                "tiles",
                "number",
                format!("{columns} x {rows}"),
                tiles.len().to_string(),
                "give one for each 16 x 16 pixels",
            ));
        }
        self.render_some(camera, settings, Some(tiles))
    }

    /// Draws all tiles of a frame, or some.
    fn render_some(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        tiles: Option<&[bool]>,
    ) -> Result<&Image> {
        match &settings.aperture {
            Some(aperture) => {
                aperture.validate(camera)?;
                self.expose(&vec![camera.clone(); aperture.pictures], settings, tiles)?;
            }
            None => self.render_sharp(camera, settings, tiles)?,
        }
        Ok(&self.images.image)
    }

    /// Draws tiles of a frame by one picture, with the discs of an aperture's part.
    pub(super) fn render_sharp(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        tiles: Option<&[bool]>,
    ) -> Result<()> {
        let level = self.chosen(camera, settings)?;
        self.at_level(level)
            .render_samples(camera, settings, tiles)?;
        self.take_from(level);
        Ok(())
    }

    /// Draws a frame of this renderer's own samples.
    fn render_samples(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        tiles: Option<&[bool]>,
    ) -> Result<()> {
        let mut plan = self.plan(camera, settings)?;
        // Whether a tile is drawn again depends on the pixels beside it, too.
        plan.tiles = tiles.map(|tiles| match self.may_sample_edges(settings) {
            true => widened(tiles, tile_grid(camera)),
            false => tiles.to_vec(),
        });
        let behind = self.take_background(&mut plan, settings);
        let mut report = self.draw(&plan)?;
        if tiles.is_some() {
            // Plans of some tiles draw into the images of samples.
            std::mem::swap(&mut self.images, &mut self.samples);
        }
        for region in self.regions(&plan, settings, tiles)? {
            let finer = region.plan(&self.scene, &plan, settings)?;
            let samples = self.draw(&finer)?;
            self.average(&region, &samples, &mut report);
        }
        self.lay_over(&behind);
        self.drawn(&plan, report);
        Ok(())
    }

    /// Takes the picture of a frame that was drawn at a level, and its report.
    pub(super) fn take_from(&mut self, level: usize) {
        if level > 0 {
            let mut images = std::mem::take(&mut self.images);
            std::mem::swap(&mut images, &mut self.at_level(level).images);
            self.images = images;
        }
        self.take_report_from(level);
    }

    /// Takes the report of a frame that was drawn at a level, and adds the time of choosing that level.
    pub(super) fn take_report_from(&mut self, level: usize) {
        if level > 0 {
            let from = self.at_level(level);
            let (report, layers, fallback) = (from.report, from.layers, from.fallback.clone());
            (self.report, self.layers, self.fallback) = (report, layers, fallback);
        }
        self.report.counts.lattice_level = level;
        let time = std::mem::take(&mut self.coarser.time);
        self.report.times.choose = time;
        self.report.times.frame += time;
    }

    /// Returns true if pictures may have tiles of several samples a pixel
    /// ([`Advanced::opaque_edges`](crate::render::Advanced::opaque_edges)).
    pub fn may_sample_edges(&self, settings: &Settings) -> bool {
        may_supersample(&self.scene, settings)
    }

    /// Takes the background out of a plan if there are colours in front of it, or if tiles may be drawn again: they
    /// are chosen by opacities, which a background hides. Without colours, one that is blended in codes stays.
    pub(super) fn take_background(&self, plan: &mut FramePlan, settings: &Settings) -> Behind {
        let backdrop = settings
            .backdrop
            .as_ref()
            .filter(|backdrop| backdrop.colours().is_some() && settings.show != Show::Count);
        let is_taken = backdrop.is_some() || self.may_sample_edges(settings) && !plan.is_encoded;
        Behind {
            background: plan.background.take_if(|_| is_taken),
            backdrop: backdrop.cloned(),
            is_encoded: plan.is_encoded,
        }
    }

    /// Draws what was taken out of a plan behind the picture.
    pub(super) fn lay_over(&mut self, behind: &Behind) {
        if self.is_first() {
            behind.lay_under(&mut self.images.image);
        }
    }

    /// Returns true unless another rank's renderer has the picture.
    fn is_first(&self) -> bool {
        self.rank().is_none_or(|rank| rank == 0)
    }

    /// Returns the regions of the picture that was just drawn whose tiles contain opaque edges: the same on
    /// all ranks.
    ///
    /// - `tiles`: those whose samples are wanted; `None` for all.
    pub(super) fn regions(
        &mut self,
        plan: &FramePlan,
        settings: &Settings,
        tiles: Option<&[bool]>,
    ) -> Result<Vec<Region>> {
        if !self.may_sample_edges(settings) {
            return Ok(Vec::new());
        }
        let choose = || choose(&self.images.image, settings);
        let chosen = match &mut self.ranks {
            None => choose(),
            Some(ranks) => {
                let own = if ranks.rank() == 0 {
                    choose()
                } else {
                    Vec::new()
                };
                ranks.first_of(own)?
            }
        };
        let mut chosen = chosen;
        for (is_chosen, is_wanted) in chosen.iter_mut().zip(tiles.into_iter().flatten()) {
            *is_chosen &= u8::from(*is_wanted);
        }
        Ok(regions(&plan.camera, &chosen))
    }

    /// Replaces the pixels of a region's tiles by the means of the samples that were just drawn.
    pub(super) fn average(
        &mut self,
        region: &Region,
        samples: &FrameReport,
        report: &mut FrameReport,
    ) {
        if self.is_first() {
            region.average(&self.samples.image, &mut self.images.image);
        }
        report.add_samples(region.count(), samples);
    }

    /// Checks the settings and returns the plan of a picture.
    pub(super) fn plan(&mut self, camera: &Camera, settings: &Settings) -> Result<FramePlan> {
        check(camera, settings)?;
        check_scene(&self.scene, settings)?;
        self.carry(settings)?;
        let mut plan = FramePlan::new(&self.scene, camera, settings)?;
        if let Some(lighting) = &settings.lighting {
            self.refuse_shadows_on_ranks(lighting)?;
            plan.shadows = self
                .shadows
                .of(&self.scene, &plan, lighting, &settings.clip)?;
        }
        Ok(plan)
    }

    /// Refuses shadows if ranks share the scene: no rank has all that hides a light.
    fn refuse_shadows_on_ranks(&self, lighting: &Lighting) -> Result<()> {
        if lighting.shadows.is_none() || self.ranks.is_none() {
            return Ok(());
        }
        Err(Error::invalid(
            "settings",
            "shadows",
            "a scene in one process",
            "a scene that is partitioned among ranks",
            "leave the shadows out, or draw in one process",
        ))
    }

    /// Stores the report of a picture's frame.
    pub(super) fn drawn(&mut self, plan: &FramePlan, report: FrameReport) {
        self.report = report;
        let time = std::mem::take(&mut self.shadows.time);
        self.report.times.shadow = time;
        self.report.times.frame += time;
        self.layers = plan.of_volumes().and_then(|pass| pass.layers);
    }

    /// Sets whether particles carry values or colours, as the settings require.
    pub(super) fn carry(&mut self, settings: &Settings) -> Result<()> {
        let carries_values = settings.classifies_slabs();
        match self.scene.carry_values(carries_values)? {
            Some(volume) => self.edited(Edit::TransferFunction(volume)),
            None => Ok(()),
        }
    }

    /// Draws a plan on the device if there is one that can, and on the CPU otherwise.
    pub(super) fn draw(&mut self, plan: &FramePlan) -> Result<FrameReport> {
        let images = plan.target(&mut self.images, &mut self.samples);
        if let Some(ranks) = &mut self.ranks {
            return ranks.draw(&self.scene, plan, images);
        }
        let device = self.device.as_mut();
        let drawn = device.map(|device| device.draw(&self.scene, plan, images));
        self.or_on_cpu(plan, drawn)
    }

    /// Returns the device's result if it has drawn. The CPU draws if there is no device, or if the device
    /// failed and the renderer may fall back.
    pub(super) fn or_on_cpu(
        &mut self,
        plan: &FramePlan,
        drawn: Option<Result<FrameReport>>,
    ) -> Result<FrameReport> {
        match drawn {
            Some(Err(error)) if self.falls_back && error.is_of_device() => {
                self.fallback = Some(error.to_string());
            }
            Some(drawn) => {
                self.fallback = None;
                return drawn;
            }
            None => {}
        }
        let images = plan.target(&mut self.images, &mut self.samples);
        self.cpu.draw(&self.scene, plan, images)
    }

    /// Returns the last frame's image.
    pub fn image(&self) -> &Image {
        &self.images.image
    }

    /// Returns the last frame's depths, if the settings asked for them.
    pub fn depth(&self) -> Option<&DepthImage> {
        self.images.depth.as_ref()
    }

    /// Returns the last frame's normals of opaque surfaces, if the settings asked for them.
    pub fn normals(&self) -> Option<&NormalImage> {
        self.images.normals.as_ref()
    }

    /// Returns the last frame's counts.
    pub fn counts(&self) -> FrameCounts {
        self.report.counts
    }

    /// Returns the layers in which the last frame summed kernels, if it had any.
    pub fn layers(&self) -> Option<&Layers> {
        self.layers.as_ref()
    }

    /// Returns the times of the last frame's stages.
    pub fn times(&self) -> StageTimes {
        self.report.times
    }

    /// Returns the requirements of each volume of the scene.
    pub fn requirements(&self) -> &[Requirements] {
        self.scene.requirements()
    }

    /// Returns the variance of the low-pass filter \[px²\] that suits the scene:
    ///
    /// - for volumes with a field: the variance that comes nearest to the data;
    /// - for bare particles: a little more;
    /// - if there are surfels: the papers' 1, which shows no ripples and softens the surfels' edges.
    ///
    ///
    /// [`Settings::default`] has 1, whatever the scene.
    pub fn suitable_low_pass_px2(&self) -> f32 {
        let is_flat = |volume: &BlockedVolume| {
            volume.is_of_splats() || matches!(volume.particles, BlockedParticles::Surfels { .. })
        };
        let is_of_field = |volume: &BlockedVolume| {
            matches!(volume.strength, StrengthIn::Classified { .. }) && volume.values.is_some()
        };
        if self.scene.data().any(is_flat) {
            DEFAULT_LOW_PASS_VARIANCE_PX2
        } else if self.scene.data().all(is_of_field) {
            FIELD_LOW_PASS_VARIANCE_PX2
        } else {
            PARTICLE_LOW_PASS_VARIANCE_PX2
        }
    }

    /// Returns whether a picture is composited in sRGB codes, given [`Settings::blend`] and the scene.
    pub fn blends_encoded(&self, settings: &Settings) -> bool {
        settings.blends_encoded(&self.scene)
    }

    /// Returns the middles and half extents of the boxes that contain the visible particles, for fitting
    /// a camera; world units.
    pub fn visible_boxes(&self) -> Vec<Bounds> {
        self.scene.visible_boxes()
    }

    /// As [`Self::visible_boxes`], without stray splats of radiance fields: those far from 99.5 % of the
    /// opacity times area of their set. Stray splats would make all others appear small.
    pub fn fitted_boxes(&self) -> Vec<Bounds> {
        self.scene.fitted_boxes()
    }

    /// Returns the middles and half extents of the boxes that contain all particles, enlarged by one
    /// standard deviation; world units. Use them to fit a camera to a column density, in which nothing is
    /// transparent.
    pub fn boxes(&self) -> Vec<Bounds> {
        self.scene.boxes()
    }

    /// Returns whether the CPU draws this number of frames of a camera faster than a device's driver
    /// loads. In that case [`Backend::Auto`](super::Backend::Auto) gains nothing. False if an adapter is named.
    pub fn suits_cpu(&self, camera: &Camera, frames: u32) -> bool {
        /// Kernels times pixels that the CPU draws in a tenth of a second at the worst, and as a rule in
        /// a hundredth or less: about the time that loading drivers takes.
        const SMALL: f64 = 1e8;
        let pixels = camera.width as f64 * camera.height as f64;
        #[cfg(feature = "gpu")]
        let is_named = Gpu::is_adapter_named();
        #[cfg(not(feature = "gpu"))]
        let is_named = false;
        !is_named && self.particle_count() as f64 * pixels * f64::from(frames) <= SMALL
    }

    /// Returns the number of particles in all volumes.
    pub fn particle_count(&self) -> usize {
        self.scene.particle_count()
    }

    /// Returns the bytes kept per particle over all volumes, including blocks and levels of detail.
    pub fn bytes_per_particle(&self) -> f64 {
        self.scene.bytes_per_particle()
    }

    /// Returns the volumes in blocks, each followed by its levels of detail.
    pub fn volumes(&self) -> &[BlockedVolume] {
        self.scene.volumes()
    }
}

/// Background and backdrop of a picture, which are drawn after it.
pub(super) struct Behind {
    background: Option<[f32; 3]>,
    /// A backdrop with colours.
    backdrop: Option<Arc<Backdrop>>,
    /// True if the picture is composited in sRGB codes.
    is_encoded: bool,
}

impl Behind {
    fn lay_under(&self, image: &mut Image) {
        match (&self.backdrop, self.background) {
            (Some(backdrop), background) => {
                backdrop.lay_under_blended(image, background, self.is_encoded);
            }
            (None, Some(background)) => image.lay_over(background),
            (None, None) => {}
        }
    }
}

/// Returns the numbers of columns and rows of a picture's tiles.
fn tile_grid(camera: &Camera) -> [usize; 2] {
    [camera.width, camera.height].map(|n| n.div_ceil(TILE_SIZE))
}

/// Returns some tiles and all that touch them.
fn widened(tiles: &[bool], [columns, rows]: [usize; 2]) -> Vec<bool> {
    let is_near = |t: usize| {
        let (x, y) = (t % columns, t / columns);
        let across = x.saturating_sub(1)..(x + 2).min(columns);
        let mut down = y.saturating_sub(1)..(y + 2).min(rows);
        down.any(|y| across.clone().any(|x| tiles[y * columns + x]))
    };
    (0..columns * rows).map(is_near).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_tiles_are_those_of_the_whole_picture() {
        use glam::DVec3;
        let at = |i: u32| DVec3::new(f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25));
        let centres: Vec<DVec3> = (0..125).map(at).collect();
        let balls = PointVolume::spheres(centres, vec![0.3; 125]).with_masses(vec![9.0; 125]);
        let mut renderer = Renderer::new(vec![balls]).unwrap();
        let eye = DVec3::new(7.0, -9.0, 5.0);
        let camera = Camera::perspective(eye, DVec3::splat(2.0), DVec3::Z, 40.0, [150, 101]);
        let settings = Settings {
            low_pass_variance_px2: PARTICLE_LOW_PASS_VARIANCE_PX2,
            ..Settings::default()
        };
        let whole = renderer.render(&camera, &settings).unwrap().clone();
        let sampled = renderer.counts().supersampled_tiles;
        assert!(sampled > 5, "{sampled}");
        let tiles: Vec<bool> = (0..70).map(|t| t % 7 == 3 || t == 42).collect();
        let some = renderer.render_tiles(&camera, &settings, &tiles).unwrap();
        for y in 0..101 {
            for x in 0..150 {
                if tiles[y / TILE_SIZE * 10 + x / TILE_SIZE] {
                    let bits = |image: &Image| image.pixel(x, y).map(f32::to_bits);
                    assert_eq!(bits(some), bits(&whole), "{x}, {y}");
                }
            }
        }
        assert!(renderer.counts().supersampled_tiles < sampled);
        assert!(
            renderer
                .render_tiles(&camera, &settings, &tiles[1..])
                .is_err()
        );
    }

    /// Windows and interpreters pass these types to another thread. The check is that this compiles.
    #[test]
    fn may_move_between_threads() {
        fn sent<T: Send + 'static>() {}
        fn shared<T: Send + Sync + 'static>() {}
        sent::<Renderer>();
        shared::<PointVolume>();
        shared::<crate::io::Dataset>();
        shared::<Settings>();
        shared::<Camera>();
        shared::<Image>();
        shared::<crate::error::Error>();
        #[cfg(feature = "gpu")]
        shared::<Gpu>();
    }
}
