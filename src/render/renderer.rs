//! Scene + camera + settings -> frame.

#[cfg(not(feature = "gpu"))]
use super::backend::NoDevice as Device;
use super::backend::{Backend, DrawFrames, Edit, FrameReport, Images, OpenBackend};
use super::check::{check, check_scene};
use super::plan::FramePlan;
use super::settings::Settings;
use crate::blocks::{
    AmplitudeSummary, BlockedParticles, BlockedScene, BlockedVolume, Layers, SceneOptions,
};
use crate::constants::{
    DEFAULT_LOW_PASS_VARIANCE_PX2, FIELD_LOW_PASS_VARIANCE_PX2, PARTICLE_LOW_PASS_VARIANCE_PX2,
};
use crate::cpu::CpuFrames;
use crate::distributed::{RankFrames, RankStats, Ranks};
use crate::error::Result;
#[cfg(feature = "gpu")]
use crate::gpu::{DeviceScene as Device, Gpu};
use crate::image::{DepthImage, Image, NormalImage};
#[cfg(feature = "prepared")]
use crate::prepared::PreparedScene;
use crate::scene::{PointVolume, Requirements, StrengthIn, TransferFunction, Values};
use crate::stats::{FrameCounts, StageTimes};
use crate::view::{Bounds, Camera};

/// A scene made ready, and the memory of its frames: after the first frame of a size, a frame
/// allocates nothing of note.
///
/// It may move to a thread of its own, so that a window goes on while it draws:
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
    /// What draws instead of the processor, where anything does.
    pub(super) device: Option<Device>,
    /// What draws instead of either where ranks share the scene's particles.
    ranks: Option<RankFrames>,
    /// Whether the processor draws what the device cannot.
    falls_back: bool,
    /// Why the last frame was drawn on the processor although there is a device.
    pub(super) fallback: Option<String>,
    pub(super) images: Images,
    pub(super) amplitudes: Option<AmplitudeSummary>,
    layers: Option<Layers>,
    pub(super) report: FrameReport,
}

impl Renderer {
    /// Sorts the volumes' particles into blocks; frames are drawn on the CPU.
    ///
    /// # Errors
    /// More particles than a 32-bit index can name, or a volume that says it is classified and
    /// has no values or no transfer function.
    pub fn new(scene: Vec<PointVolume>) -> Result<Self> {
        Self::with_options(scene, &SceneOptions::default())
    }

    /// As [`Renderer::new`], and keeps what later exchanges and questions ask for; may be watched and
    /// cancelled.
    ///
    /// # Errors
    /// Those of [`Renderer::new`]; work that was cancelled.
    pub fn with_options(scene: Vec<PointVolume>, options: &SceneOptions) -> Result<Self> {
        Self::of_scene(BlockedScene::new(scene, options)?)
    }

    /// Draws prepared scenes together, in their order; frames are drawn on the CPU. What no frame asks for of scenes in
    /// files is not read.
    ///
    /// # Errors
    /// More particles than a 32-bit index can name.
    #[cfg(feature = "prepared")]
    pub fn of_prepared(scenes: Vec<PreparedScene>) -> Result<Self> {
        let scenes = scenes.into_iter().map(PreparedScene::into_scene);
        Self::of_scene(BlockedScene::joined(scenes)?)
    }

    fn of_scene(scene: BlockedScene) -> Result<Self> {
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
            amplitudes: None,
            layers: None,
            report: FrameReport::default(),
        })
    }

    /// As [`Renderer::new`], and keeps the scene on a GPU where `backend` asks for one.
    ///
    /// # Errors
    /// Those of [`Renderer::new`] and of [`Renderer::on_backend`].
    pub fn with_backend(scene: Vec<PointVolume>, backend: Backend) -> Result<Self> {
        Self::new(scene)?.on_backend(backend)
    }

    /// Keeps the scene on a GPU from now on where `backend` asks for one.
    ///
    /// # Errors
    /// No adapter where one is asked for, or too little memory on it.
    pub fn on_backend(self, backend: Backend) -> Result<Self> {
        self.on_open(backend.open()?)
    }

    /// As [`Renderer::on_backend`], of a back end that is open.
    ///
    /// # Errors
    /// Too little memory on a device that was asked for.
    #[cfg_attr(
        not(feature = "gpu"),
        expect(clippy::needless_pass_by_value, reason = "a device is taken")
    )]
    pub fn on_open(self, backend: OpenBackend) -> Result<Self> {
        #[cfg(feature = "gpu")]
        {
            match backend.gpu {
                None => Ok(self),
                Some((gpu, true)) => self.on(gpu),
                Some((gpu, false)) => Ok(self.on_if_it_can(gpu)),
            }
        }
        #[cfg(not(feature = "gpu"))]
        {
            let OpenBackend {} = backend;
            Ok(self)
        }
    }

    /// Uploads the scene to a device, which draws all frames from now on.
    ///
    /// # Errors
    /// Too little memory on the device.
    #[cfg(feature = "gpu")]
    pub fn on(mut self, gpu: Gpu) -> Result<Self> {
        let mut device = Device::new(gpu)?;
        device.upload(&self.scene)?;
        self.device = Some(device);
        Ok(self)
    }

    /// Uploads the scene to a device, which draws what it can from now on; the processor draws the rest:
    /// frames for which the device has too little memory or no code, and all of them where the scene does
    /// not fit. [`Renderer::fallback`] says of the last frame whether it did.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn on_if_it_can(mut self, gpu: Gpu) -> Self {
        self.falls_back = true;
        let device = Device::new(gpu).and_then(|mut device| {
            device.upload(&self.scene)?;
            Ok(device)
        });
        match device {
            Ok(device) => self.device = Some(device),
            Err(error) => self.fallback = Some(error.to_string()),
        }
        self
    }

    /// The adapter that draws the frames, or `None` where it is the CPU.
    pub fn adapter(&self) -> Option<String> {
        self.device.as_ref().and_then(|device| device.adapter())
    }

    /// Why the last frame was drawn on the processor where [`Backend::Auto`] had chosen a device, or
    /// the scene is kept on the processor; `None` where nothing fell back.
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
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
        self.scene.set_transfer_function(volume, transfer)?;
        self.edited(Edit::TransferFunction(volume))
    }

    /// Exchanges the values of a volume, for the next time step: places, shapes and the transfer function
    /// stay. The scene must have been made to keep its shapes ([`Renderer::with_options`]).
    ///
    /// ```
    /// use ewa_splat::scene::{Colour, Particles, PointVolume, Strength, TransferFunction, Values};
    /// use ewa_splat::{SceneOptions, Renderer};
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// # let positions: Vec<glam::DVec3> = (0..9).map(|i| glam::DVec3::splat(f64::from(i))).collect();
    /// # let grey = TransferFunction::from_curves(|v| [v; 3], |v| v, [0.0, 1.0], 1.0)?;
    /// let volume = PointVolume {
    ///     particles: Particles::Isotropic { positions, sigmas: vec![1.0; 9] },
    ///     strength: Strength::Classified { volumes: vec![1.0; 9] },
    ///     colour: Colour::Classified,
    ///     values: Some(Values::F32(vec![0.1; 9])),
    ///     transfer_function: Some(grey),
    ///     boundary: None,
    ///     normals: None,
    ///     local_models: None,
    /// };
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
        self.scene.set_values(volume, values)?;
        self.amplitudes = None;
        self.edited(Edit::Values)
    }

    /// Keeps this rank's share of the scene, which all ranks have: frames are drawn by all of them, and the first has
    /// the images.
    ///
    /// # Errors
    /// A rank that is gone.
    pub(crate) fn over_ranks(mut self, ranks: Ranks) -> Result<Self> {
        let frames = RankFrames::sharing(ranks, &mut self.scene)?;
        self.by(frames)
    }

    /// Of a scene of which each rank has its share.
    ///
    /// # Errors
    /// A rank that is gone.
    pub(crate) fn of_shared(scene: BlockedScene, frames: RankFrames) -> Result<Self> {
        Self::of_scene(scene)?.by(frames)
    }

    fn by(mut self, mut frames: RankFrames) -> Result<Self> {
        frames.upload(&self.scene)?;
        self.amplitudes = Some(frames.amplitudes(&self.scene)?);
        self.ranks = Some(frames);
        Ok(self)
    }

    /// This rank, where ranks share the scene.
    pub(crate) fn rank(&self) -> Option<usize> {
        self.ranks.as_ref().map(RankFrames::rank)
    }

    /// What each rank did for the last frame; none where there are none.
    pub(crate) fn rank_stats(&self) -> &[RankStats] {
        self.ranks.as_ref().map_or(&[], RankFrames::stats)
    }

    fn edited(&mut self, edit: Edit) -> Result<()> {
        self.cpu.edit(&self.scene, edit)?;
        if let Some(ranks) = &mut self.ranks {
            ranks.edit(&self.scene, edit)?;
        }
        let Some(device) = &mut self.device else {
            return Ok(());
        };
        match device.edit(&self.scene, edit) {
            Err(error) if self.falls_back && error.is_of_device() => {
                // What it keeps is of another time step.
                self.device = None;
                self.fallback = Some(error.to_string());
                Ok(())
            }
            edited => edited,
        }
    }

    /// Draws a frame; [`Renderer::image`] and the others hold its results until the next.
    ///
    /// # Errors
    /// An image of no pixels or of more than 65,535 along a side; settings out of range, or that
    /// do not go together with each other or with the scene; a device that is lost or has too little
    /// memory; a frame that was cancelled, which leaves the images with parts of it.
    pub fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<&Image> {
        let plan = self.plan(camera, settings)?;
        let report = self.draw(&plan)?;
        self.drawn(&plan, report);
        Ok(&self.images.image)
    }

    /// The plan of a picture, once its settings are checked.
    pub(super) fn plan(&mut self, camera: &Camera, settings: &Settings) -> Result<FramePlan> {
        check(camera, settings)?;
        check_scene(&self.scene, settings)?;
        self.carry(settings)?;
        FramePlan::new(&self.scene, camera, settings)
    }

    /// Keeps what a picture's frame found out.
    pub(super) fn drawn(&mut self, plan: &FramePlan, report: FrameReport) {
        self.report = report;
        self.layers = plan.of_volumes().and_then(|pass| pass.layers);
    }

    /// Lets particles carry what the settings ask for: values or colours.
    pub(super) fn carry(&mut self, settings: &Settings) -> Result<()> {
        let carries_values = settings.composite.classifies_slabs();
        match self.scene.carry_values(carries_values)? {
            Some(volume) => self.edited(Edit::TransferFunction(volume)),
            None => Ok(()),
        }
    }

    /// Draws a plan on the device, where there is one that can, on the processor otherwise.
    pub(super) fn draw(&mut self, plan: &FramePlan) -> Result<FrameReport> {
        if let Some(ranks) = &mut self.ranks {
            return ranks.draw(&self.scene, plan, &mut self.images);
        }
        let device = self.device.as_mut();
        let drawn = device.map(|device| device.draw(&self.scene, plan, &mut self.images));
        self.or_on_cpu(plan, drawn)
    }

    /// What the device has drawn, if there is one; otherwise, and where it may fall back, the processor draws.
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
        self.cpu.draw(&self.scene, plan, &mut self.images)
    }

    /// The last frame's image.
    pub fn image(&self) -> &Image {
        &self.images.image
    }

    /// The last frame's depths, where the settings asked for them.
    pub fn depth(&self) -> Option<&DepthImage> {
        self.images.depth.as_ref()
    }

    /// The last frame's normals of opaque surfaces, where the settings asked for them.
    pub fn normals(&self) -> Option<&NormalImage> {
        self.images.normals.as_ref()
    }

    /// What the last frame counted.
    pub fn counts(&self) -> FrameCounts {
        self.report.counts
    }

    /// The layers in which the last frame summed kernels, if it did.
    pub fn layers(&self) -> Option<&Layers> {
        self.layers.as_ref()
    }

    /// How long the last frame's stages took.
    pub fn times(&self) -> StageTimes {
        self.report.times
    }

    /// What each volume of the scene requires.
    pub fn requirements(&self) -> &[Requirements] {
        self.scene.requirements()
    }

    /// The variance of the low-pass filter \[px²\] that suits what the scene shows: what is nearest to the
    /// data of volumes with a field, a little more for bare particles, and the papers' 1, with which nothing
    /// ripples, where there are surfels, whose edges it softens.
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

    /// Whether a picture is composited in sRGB codes, as [`Settings::blend`] asks of the scene.
    pub fn blends_encoded(&self, settings: &Settings) -> bool {
        settings.blends_encoded(&self.scene)
    }

    /// Middles and half extents of the boxes that hold what is visible, for fitting a camera;
    /// world units.
    pub fn visible_boxes(&self) -> Vec<Bounds> {
        self.scene.visible_boxes()
    }

    /// The same without splats of radiance fields that lie far from where 99.5 % of the opacity times area of their set lie:
    /// stray ones would make all others small.
    pub fn fitted_boxes(&self) -> Vec<Bounds> {
        self.scene.fitted_boxes()
    }

    /// Middles and half extents of the boxes that hold all particles, grown by one standard
    /// deviation; world units. For a camera that fits a column density, where nothing is
    /// transparent.
    pub fn boxes(&self) -> Vec<Bounds> {
        self.scene.boxes()
    }

    /// Whether the processor draws so many frames of a camera before a device's driver is loaded, and no adapter is asked
    /// for by name: then [`Backend::Auto`] gains nothing.
    pub fn suits_cpu(&self, camera: &Camera, frames: u32) -> bool {
        /// Kernels times pixels that the processor draws in a tenth of a second at the worst, in a hundredth or less as a
        /// rule: about what loading drivers takes.
        const SMALL: f64 = 1e8;
        let pixels = camera.width as f64 * camera.height as f64;
        #[cfg(feature = "gpu")]
        let is_named = Gpu::is_adapter_named();
        #[cfg(not(feature = "gpu"))]
        let is_named = false;
        !is_named && self.particle_count() as f64 * pixels * f64::from(frames) <= SMALL
    }

    /// How many particles all volumes have.
    pub fn particle_count(&self) -> usize {
        self.scene.particle_count()
    }

    /// Bytes kept per particle, blocks and levels of detail included, over all volumes.
    pub fn bytes_per_particle(&self) -> f64 {
        self.scene.bytes_per_particle()
    }

    /// The volumes in blocks, each with its levels of detail after it.
    pub fn volumes(&self) -> &[BlockedVolume] {
        self.scene.volumes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a window or an interpreter hands to another thread; compiling this is the check.
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
