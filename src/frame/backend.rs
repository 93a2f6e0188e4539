//! Defines the common interface of the back ends that draw frames.

use std::fmt::Debug;

use super::plan::FramePlan;
use crate::blocks::BlockedScene;
use crate::error::Result;
#[cfg(feature = "gpu")]
use crate::gpu::{AdapterChoice, Gpu};
use crate::image::{ColumnImage, DepthImage, Image, NormalImage};
use crate::stats::{FrameCounts, StageTimes};
use crate::view::{Camera, Projection};

/// A choice of back end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// A hardware GPU if there is one that the scene fits, the CPU otherwise. Software adapters are
    /// skipped, because the CPU's own path is faster. If the environment variable `EWA_ADAPTER` names an
    /// adapter, that adapter.
    #[default]
    Auto,
    /// A GPU; a software adapter if there is no other.
    Gpu,
    /// The CPU.
    Cpu,
}

/// A back end that is ready to receive scenes. [`Backend::open`] opens one; a [`Gpu`](crate::render::Gpu)
/// converts to one that must draw all frames.
#[derive(Debug, Clone)]
pub struct OpenBackend {
    /// The device, and whether the caller asked for one explicitly.
    #[cfg(feature = "gpu")]
    pub(crate) gpu: Option<(Gpu, bool)>,
}

#[cfg(feature = "gpu")]
impl From<Gpu> for OpenBackend {
    fn from(gpu: Gpu) -> Self {
        Self {
            gpu: Some((gpu, true)),
        }
    }
}

#[cfg(feature = "gpu")]
impl OpenBackend {
    /// Returns a back end that draws on the device, and on the CPU if the scene does not fit on the device
    /// or the device has too little memory or no code for a frame.
    pub fn or_cpu(gpu: Gpu) -> Self {
        Self {
            gpu: Some((gpu, false)),
        }
    }
}

impl Backend {
    /// Opens the device of this choice. Loading the drivers takes as long as reading a small file;
    /// another thread may do it meanwhile.
    ///
    /// # Errors
    /// An adapter was asked for, and there is none.
    pub fn open(self) -> Result<OpenBackend> {
        #[cfg(feature = "gpu")]
        {
            let is_asked_for = self == Self::Gpu || Gpu::is_adapter_named();
            let gpu = match self {
                Self::Cpu => None,
                _ if is_asked_for => Some(Gpu::open(AdapterChoice::Any)?),
                _ => Gpu::open(AdapterChoice::Hardware).ok(),
            };
            Ok(OpenBackend {
                gpu: gpu.map(|gpu| (gpu, is_asked_for)),
            })
        }
        #[cfg(not(feature = "gpu"))]
        {
            if self == Self::Gpu {
                return Err(crate::error::Error::without_gpu());
            }
            Ok(OpenBackend {})
        }
    }
}

/// A change of a scene since it was uploaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Edit {
    /// The transfer function of a volume has changed.
    TransferFunction(usize),
    /// The values of a volume have changed, and with them the order of its particles and its levels of
    /// detail.
    Values,
}

/// The images that a frame draws into.
#[derive(Debug, Default)]
pub(crate) struct Images {
    /// The picture.
    pub(crate) image: Image,
    /// Depths, if the plan asks for them.
    pub(crate) depth: Option<DepthImage>,
    /// Normals of opaque surfaces, if the plan asks for them.
    pub(crate) normals: Option<NormalImage>,
    /// Column density, for a plan of columns.
    pub(crate) column: ColumnImage,
    /// Greatest magnitude of the column density before it was narrowed to f32.
    pub(crate) largest: f64,
}

impl Images {
    /// Resizes the images to a plan's size. Images that already have this size are reused; images that
    /// the plan does not ask for are dropped.
    pub(crate) fn resize(&mut self, plan: &FramePlan) {
        let (width, height) = (plan.camera.width, plan.camera.height);
        if (self.image.width, self.image.height) != (width, height) {
            self.image = Image::new(width, height);
        }
        self.resize_beside(plan);
    }

    /// Resizes the images other than the picture, for a picture that is drawn elsewhere.
    pub(crate) fn resize_beside(&mut self, plan: &FramePlan) {
        let (width, height) = (plan.camera.width, plan.camera.height);
        let has_size = |w: usize, h: usize| (w, h) == (width, height);
        match &mut self.depth {
            Some(depth) if plan.depth && has_size(depth.width, depth.height) => {}
            depth => {
                *depth = plan.depth.then(|| DepthImage {
                    width,
                    height,
                    depths: vec![0.0; width * height],
                });
            }
        }
        match &mut self.normals {
            // No pass may write normals: start from zeros.
            Some(normals) if plan.normals && has_size(normals.width, normals.height) => {
                normals.normals.fill([0.0; 3]);
            }
            normals => {
                *normals = plan.normals.then(|| NormalImage {
                    width,
                    height,
                    normals: vec![[0.0; 3]; width * height],
                });
            }
        }
    }
}

impl Images {
    /// Resizes the column density to a plan's size.
    pub(crate) fn resize_column(&mut self, plan: &FramePlan) {
        let Camera {
            width,
            height,
            focal_px,
            projection,
            ..
        } = &plan.camera;
        let image = &mut self.column;
        (image.width, image.height) = (*width, *height);
        image.values.resize(width * height, 0.0);
        let area = 1.0 / focal_px.element_product();
        image.pixel_area = (*projection == Projection::Orthographic).then_some(area);
    }
}

/// Counts and times of a frame.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct FrameReport {
    pub(crate) counts: FrameCounts,
    pub(crate) times: StageTimes,
}

impl FrameReport {
    /// Adds the times of a frame that drew the samples of some tiles of the picture. Other counts stay those
    /// of the picture.
    pub(crate) fn add_samples(&mut self, tiles: usize, samples: &Self) {
        self.counts.supersampled_tiles += tiles;
        self.times.add(&samples.times);
    }

    /// Adds the counts and times of a frame that drew another part of the picture.
    pub(crate) fn add_part(&mut self, part: &Self) {
        self.counts.add(&part.counts);
        self.times.add(&part.times);
    }
}

/// A back end: it keeps its own copy of a scene's data and draws plans of frames of the scene.
pub(crate) trait DrawFrames: Debug {
    /// Returns the name of its adapter; `None` for the CPU.
    fn adapter(&self) -> Option<String>;

    /// Uploads a scene.
    ///
    /// # Errors
    /// Too little memory, or data that this back end does not draw.
    fn upload(&mut self, scene: &BlockedScene) -> Result<()>;

    /// Uploads a change of the uploaded scene.
    ///
    /// # Errors
    /// Too little memory.
    fn edit(&mut self, scene: &BlockedScene, edit: Edit) -> Result<()>;

    /// Draws a frame of the uploaded scene, and waits for it.
    ///
    /// # Errors
    /// Too little memory, data that this back end does not draw, or a lost device.
    fn draw(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
    ) -> Result<FrameReport>;
}

/// Stands in for the device in a build without code for GPUs. It has no values.
#[cfg(not(feature = "gpu"))]
#[derive(Debug)]
pub(crate) enum NoDevice {}

#[cfg(not(feature = "gpu"))]
impl DrawFrames for NoDevice {
    fn adapter(&self) -> Option<String> {
        match *self {}
    }

    fn upload(&mut self, _: &BlockedScene) -> Result<()> {
        match *self {}
    }

    fn edit(&mut self, _: &BlockedScene, _: Edit) -> Result<()> {
        match *self {}
    }

    fn draw(&mut self, _: &BlockedScene, _: &FramePlan, _: &mut Images) -> Result<FrameReport> {
        match *self {}
    }
}
