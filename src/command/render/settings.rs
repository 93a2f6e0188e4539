//! Converts the options of `ewa-splat render` to settings.

use super::options::{
    Arguments, BackendName, BlendName, ClassifyName, ColumnLook, CompositeName, Detail, FilterName,
    Method, Opacity, OrderName, ShowName,
};
use crate::command::animation;
use crate::command::parse::Background;
use crate::command::truth::ReferenceName;
use crate::command::viewpoint::Horizon;
use crate::image::DARK_GREY;
use crate::render::{Advanced, Blend, Classification, Composite, Order};
use crate::sample::{MeanPart, PeriodicBox, PurposeOptions, Refinement, SampleOptions};
use crate::scene::{Lighting, ScaleName};
use crate::view::{Along, Camera, ClipPlane, Panorama};
use crate::{Backend, ColumnSettings, Filter, Renderer, SceneOptions, Settings, Show, Task};

impl From<BlendName> for Blend {
    fn from(name: BlendName) -> Self {
        match name {
            BlendName::Auto => Self::Auto,
            BlendName::Encoded => Self::Encoded,
            BlendName::Linear => Self::Linear,
        }
    }
}

impl Arguments {
    /// Returns the options that turn data into particles.
    pub(in crate::command) fn sample_options(&self, task: Option<Task>) -> SampleOptions {
        SampleOptions {
            purpose: PurposeOptions {
                for_columns: self.method.column_density,
                mean: match self.method.column_mean {
                    Some(_) => MeanPart::Weights,
                    None => MeanPart::None,
                },
                normals: self.asks_normals(),
                local_models: self.asks_models(),
                ..PurposeOptions::default()
            },
            refinement: self.refinement(),
            periodic: self.periodic_box(),
            motion: self.exposure.motion(),
            task,
            ..self.data.sample_options()
        }
    }

    /// Returns how far kernels are refined for the pictures. Only kernels that are classified over their extent
    /// gain by it.
    pub(in crate::command) fn refinement(&self) -> Option<Refinement> {
        let method = &self.method;
        let is_classified = method.classify == ClassifyName::Extent && !method.column_density;
        let is_refined = is_classified
            && method.refine == Detail::Auto
            && method.reference != Some(ReferenceName::Data)
            && !method.post_classification;
        // The tolerance of a reference image is that of its integrals.
        let asked = method.tolerance.filter(|_| method.reference.is_none());
        let tolerance = asked.unwrap_or(Settings::default().tolerance);
        is_refined.then(|| Refinement::for_tolerance(tolerance))
    }

    /// Returns true if local models of the field are needed: by classification over kernels'
    /// extents or in slabs, or by an iso-surface.
    pub(in crate::command) fn asks_models(&self) -> bool {
        let by_extent = self.method.classify == ClassifyName::Extent;
        let classifies = by_extent || self.method.post_classification;
        self.data.flatten.is_some() || (classifies && !self.method.column_density)
    }

    /// Returns true if lighting needs normals of volumes. Post-classified slabs and iso-surfaces
    /// compute their own.
    pub(in crate::command) fn asks_normals(&self) -> bool {
        let has_own = self.method.post_classification || self.data.flatten.is_some();
        self.light.lighting().is_some() && !has_own
    }

    /// Returns the options for sorting the scene into blocks.
    pub(in crate::command) fn scene_options(&self, options: &SampleOptions) -> SceneOptions {
        let method = &self.method;
        let draws_merged = self.settings(0.0).draws_merged();
        SceneOptions {
            level_of_detail: draws_merged && !method.column_density && method.reference.is_none(),
            task: options.task.clone(),
            ..SceneOptions::default()
        }
    }

    /// Returns the settings of rendering.
    ///
    /// - `low_pass`: variance of the low-pass filter, px².
    pub(in crate::command) fn settings(&self, low_pass: f32) -> Settings {
        let defaults = Settings::default();
        Settings {
            tolerance: self.method.tolerance.unwrap_or(defaults.tolerance),
            filter: match self.method.filter {
                FilterName::Adaptive => Filter::Adaptive,
                FilterName::Exact => Filter::Exact,
                FilterName::Ewa => Filter::Ewa,
                FilterName::Reconstruction => Filter::Reconstruction,
                FilterName::LowPass => Filter::LowPass,
                FilterName::Isotropic => Filter::Isotropic,
                FilterName::UniformScaling => Filter::UniformScaling,
            },
            advanced: Advanced {
                thresholds: self.method.thresholds,
                merge_slack: defaults.advanced.merge_slack,
                linear_opacity: self.method.opacity == Opacity::Linear,
                simd: defaults.advanced.simd,
                sub_pixel_opacity: self.method.sub_pixel_opacity,
                opaque_edges: self.method.opaque_edges == Detail::Auto,
            },
            level_of_detail: self.method.level_of_detail == Detail::Auto,
            show: match self.output.show {
                ShowName::Scene => Show::Scene,
                ShowName::Choice => Show::Choice,
                ShowName::Count => Show::Count,
            },
            composite: self.method.composite(),
            classify: self.method.classification(),
            clip: self.clip_planes(),
            low_pass_variance_px2: low_pass,
            cutoff: self.method.cutoff,
            blend: self.method.blend.into(),
            order: match self.method.order {
                OrderName::Auto => Order::Auto,
                OrderName::Distance => Order::Distance,
                OrderName::Depth => Order::Depth,
            },
            background: self.background(),
            backdrop: None,
            depth: self.output.depth.is_some(),
            normals: self.output.normals.is_some(),
            lighting: self.lighting(),
            // Its focus depends on what is shown.
            aperture: None,
            task: None,
        }
    }

    /// Returns the lighting of the scene. Surfaces are lit by default, with three exceptions: a
    /// reference image, a maximum (which has no surface), and post-classification (which would
    /// light the slabs, too).
    pub(in crate::command) fn lighting(&self) -> Option<Lighting> {
        let method = &self.method;
        let lights_more = method.post_classification || method.reference.is_some();
        let is_maximum = method.composite == CompositeName::Maximum;
        let of_surfaces = !lights_more && !is_maximum && !self.light.is_unlit();
        self.light
            .lighting()
            .or_else(|| of_surfaces.then(Lighting::default))
    }

    /// Returns true if light was asked for.
    pub(in crate::command) fn is_lit(&self) -> bool {
        self.light.lighting().is_some()
    }

    /// Returns the linear background colour. The default is dark grey for pictures to look at (png,
    /// apng, gif, mp4) and none for other formats.
    pub(in crate::command) fn background(&self) -> Option<[f32; 3]> {
        let is_picture = (self.is_png() || animation::is_animated(&self.out))
            && matches!(self.output.show, ShowName::Scene | ShowName::Choice);
        match self.output.background {
            Some(Background::None) => None,
            Some(Background::Colour(colour)) => Some(colour),
            // The picture goes over the other renderer's.
            None if self.backdrop.is_given() => None,
            None => is_picture.then_some(DARK_GREY),
        }
    }

    pub(in crate::command) fn clip_planes(&self) -> Vec<ClipPlane> {
        let clip = self.method.clip.iter().flat_map(|clip| &clip.0).copied();
        let between = self.camera.depth_planes(self.default_axis());
        let of_box = self.periodic_box().map(|periodic| periodic.planes());
        clip.chain(between)
            .chain(of_box.into_iter().flatten())
            .collect()
    }

    /// Returns the periodic box of the particles, if there is one.
    pub(in crate::command) fn periodic_box(&self) -> Option<PeriodicBox> {
        let whole = PeriodicBox::from_origin(self.periodic?);
        Some(PeriodicBox {
            centre: self.centre.unwrap_or(whole.centre),
            ..whole
        })
    }

    /// Returns the axis that the camera looks along if no option says from where.
    pub(in crate::command) fn default_axis(&self) -> Option<Along> {
        let slice = self.method.slice.map(|slice| slice.along);
        slice.or(self.method.column_density.then_some(Along::Z))
    }

    pub(in crate::command) fn column_settings(&self) -> ColumnSettings {
        let defaults = ColumnSettings::default();
        let low_pass = self.method.low_pass;
        let shared = self.settings(low_pass.unwrap_or(defaults.low_pass_variance_px2));
        ColumnSettings {
            tolerance: shared.tolerance,
            filter: shared.filter,
            low_pass_variance_px2: shared.low_pass_variance_px2,
            cutoff: shared.cutoff.unwrap_or(defaults.cutoff),
            smoothing: None,
            slice: self.method.slice.map(|slice| slice.through()),
            clip: shared.clip,
            simd: shared.advanced.simd,
            task: None,
        }
    }

    /// Returns the appearance of the picture of a column density.
    pub(in crate::command) fn column_look(&self) -> ColumnLook<'_> {
        ColumnLook {
            map: self.data.transfer_function.as_deref(),
            range: self
                .data
                .range
                .map(|range| glam::DVec2::from(range).as_vec2().to_array()),
            scale: match (self.data.scale_name(), &self.method.column_mean) {
                (None, Some(_)) => Some(ScaleName::Linear),
                (scale, _) => scale,
            },
        }
    }

    /// Chooses the backend. The CPU integrates reference images in f64. It also draws scenes that
    /// take less time than loading a GPU driver; the picture is the same.
    pub(in crate::command) fn backend(&self, renderer: &Renderer, camera: &Camera) -> Backend {
        let frames = 1 + self.output.frames.unwrap_or(0);
        match self.backend {
            _ if self.method.reference.is_some() => Backend::Cpu,
            BackendName::Auto if renderer.suits_cpu(camera, frames) => Backend::Cpu,
            BackendName::Auto => Backend::Auto,
            BackendName::Gpu => Backend::Gpu,
            BackendName::Cpu => Backend::Cpu,
        }
    }

    pub(in crate::command) fn is_png(&self) -> bool {
        self.out
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("png"))
    }

    /// Returns the panorama that is drawn from a camera, or `None` for a picture of the camera itself.
    pub(super) fn panorama(&self, camera: &Camera) -> Option<Panorama> {
        self.projection.panorama(camera, self.camera.named())
    }

    /// Returns the size of the whole picture that is drawn from a camera.
    pub(super) fn whole_size(&self, camera: &Camera) -> [usize; 2] {
        let eyes = if self.projection.stereo().is_some() {
            2
        } else {
            1
        };
        match self.panorama(camera) {
            Some(panorama) => [panorama.width, panorama.height],
            None => [camera.width, eyes * camera.height],
        }
    }

    /// Returns the horizon of a panorama.
    pub(super) fn horizon(&self) -> Option<Horizon> {
        let is_panorama = self.projection.is_panorama(self.camera.named());
        is_panorama.then_some(match self.projection.is_level() {
            true => Horizon::Level,
            false => Horizon::Free,
        })
    }
}

impl Method {
    pub(in crate::command) fn classification(&self) -> Classification {
        match self.classify {
            _ if self.post_classification => Classification::Slab,
            ClassifyName::Extent => Classification::Extent,
            ClassifyName::Particle => Classification::Particle,
        }
    }

    /// Returns the compositing of kernels that lie behind one another.
    pub(in crate::command) fn composite(&self) -> Composite {
        let thickness = self.slab_thickness;
        match self.composite {
            CompositeName::Over => Composite::Over,
            CompositeName::Sheets => Composite::Sheets { thickness },
            CompositeName::AxisSheets => Composite::AxisSheets { thickness },
            CompositeName::Maximum => Composite::Maximum { thickness },
            CompositeName::Slabs => Composite::Slabs { thickness },
        }
    }
}
