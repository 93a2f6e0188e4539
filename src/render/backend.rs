//! What draws frames: the back ends' common interface.

use std::fmt::Debug;

use super::plan::FramePlan;
use crate::blocks::BlockedScene;
use crate::error::Result;
#[cfg(feature = "gpu")]
use crate::gpu::{AdapterChoice, Gpu};
use crate::image::{ColumnImage, DepthImage, Image, NormalImage};
use crate::stats::{FrameCounts, StageTimes};
use crate::view::{Camera, Projection};

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

/// A back end that is ready to take scenes.
#[derive(Debug, Clone)]
pub struct OpenBackend {
    /// The device, and whether the caller asked for one.
    #[cfg(feature = "gpu")]
    pub(super) gpu: Option<(Gpu, bool)>,
}

impl Backend {
    /// Looks for its device: loading the drivers takes as long as reading a small file does, and may be done
    /// meanwhile, in another thread.
    ///
    /// # Errors
    /// No adapter where one is asked for.
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

/// What of a scene has changed since it was uploaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Edit {
    /// The transfer function of a volume.
    TransferFunction(usize),
    /// The values of a volume, and with them the order of its particles and its levels of detail.
    Values,
}

/// What a frame draws into.
#[derive(Debug, Default)]
pub(crate) struct Images {
    /// The picture.
    pub(crate) image: Image,
    /// Depths, where the plan asks for them.
    pub(crate) depth: Option<DepthImage>,
    /// Normals of opaque surfaces, where the plan asks for them.
    pub(crate) normals: Option<NormalImage>,
    /// The column density of a plan of columns.
    pub(crate) column: ColumnImage,
    /// Its greatest magnitude before it was narrowed to f32.
    pub(crate) largest: f64,
}

impl Images {
    /// Images of a plan's size: of the old ones those that have it. What was not asked for is gone.
    pub(crate) fn resize(&mut self, plan: &FramePlan) {
        let (width, height) = (plan.camera.width, plan.camera.height);
        if (self.image.width, self.image.height) != (width, height) {
            self.image = Image::new(width, height);
        }
        self.resize_beside(plan);
    }

    /// The same of what lies beside a picture that is drawn elsewhere.
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
            // Zeros where no pass writes any.
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
    /// A column density of a plan's size.
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

/// What a frame counted, and how long it took.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct FrameReport {
    pub(crate) counts: FrameCounts,
    pub(crate) times: StageTimes,
}

/// A back end: keeps what it needs of a scene, and draws plans of frames of it.
pub(crate) trait DrawFrames: Debug {
    /// What it draws on; `None` for the processor.
    fn adapter(&self) -> Option<String>;

    /// Takes what it keeps of a scene.
    ///
    /// # Errors
    /// Too little memory, or what this back end does not draw.
    fn upload(&mut self, scene: &BlockedScene) -> Result<()>;

    /// Takes what has changed of a scene that was uploaded.
    ///
    /// # Errors
    /// Too little memory.
    fn edit(&mut self, scene: &BlockedScene, edit: Edit) -> Result<()>;

    /// Draws a frame of the scene that was uploaded, and waits for it.
    ///
    /// # Errors
    /// Too little memory, what this back end does not draw, or a lost device.
    fn draw(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
    ) -> Result<FrameReport>;
}

/// What draws instead of the processor in a build without code for GPUs: nothing.
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
