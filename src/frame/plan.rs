//! Plans a frame: what is drawn, in which passes, and how.
//!
//! The plan is made once, from scene, camera and settings. Both back ends follow it and repeat none of
//! its decisions.

use std::sync::Arc;

use super::backdrop::RayEnds;
use super::settings::{Blend, ColumnSettings, Composite, Order, Settings, Show};
use super::shadows::ShadowGrids;
use super::uniforms::{
    Reach, choice_uniform, cull_planes, frustum, lighting_uniform, view_uniform,
};
use crate::blocks::{
    Block, BlockedScene, BlockedVolume, Frustum, LayerKind, Layers, distance_interval,
};
use crate::constants::{COLUMN_CUTOFF, GREATEST_SRGB_SLOPE};
use crate::error::Result;
use crate::record::{
    ChoiceUniform, ClassifiedBy, KeyKind, LightingUniform, ShadowUniform, ViewUniform,
};
use crate::scene::{Classification, TransferFunction};
use crate::simd::SimdLevel;
use crate::splat::{Accumulate, Axes, Classify, Filter, Interval, SPLAT_LOW_PASS_PX2};
use crate::task::Task;
use crate::view::{Camera, Projection};

/// Groups of volumes that one pass draws together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Draws {
    /// Surfels of opaque surfaces.
    Surfaces,
    /// Everything that transmits light.
    Volumes,
}

impl Draws {
    /// Returns whether this group contains a volume.
    pub(crate) fn draws(self, volume: &BlockedVolume) -> bool {
        volume.is_surface() == (self == Self::Surfaces)
    }
}

/// The quantity that classified particles and footprints carry in the place of a colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Carries {
    /// Linear RGB.
    Colour,
    /// Their value as a fraction of the transfer function's range, for classified slabs.
    Value,
    /// The sign of their amplitude, for sums of columns. The amplitude's magnitude times `scale` is the
    /// mass.
    Amplitude {
        /// Mass per unit of amplitude.
        scale: f64,
        /// Field x length per unit of mass in a sum.
        per_mass: f64,
    },
}

/// A pass of a frame: a group of volumes that go through all stages together, from culling to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PassPlan {
    /// The group of volumes that the pass draws.
    pub(crate) draws: Draws,
    /// The variant of the rasteriser.
    pub(crate) axes: Axes,
    /// The quantity carried from stage to stage besides positions and masses.
    pub(crate) carries: Carries,
    /// True if particles are lit.
    pub(crate) lights_particles: bool,
    /// The layers in which kernels are summed, if the composite has any. Depth keys are numbers of these
    /// layers.
    pub(crate) layers: Option<Layers>,
    /// Quantity that depth keys measure.
    pub(crate) keys: KeyKind,
    /// The view in f32. Its `key_scale` follows from the range of depths that culling finds.
    pub(crate) view: ViewUniform,
}

/// The plan of a frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FramePlan {
    /// The camera.
    pub(crate) camera: Camera,
    /// The camera's frustum, widened by the reach of the low-pass filter.
    pub(crate) frustum: Frustum,
    /// True if blocks outside the frustum are left out. Uniform scaling enlarges kernels beyond any
    /// reach, so it culls nothing.
    pub(crate) culls: bool,
    /// Rules by which blocks choose their filter.
    pub(crate) choice: ChoiceUniform,
    /// Lights in camera space.
    pub(crate) lighting: Option<LightingUniform>,
    /// Shadows of the lights. The renderer makes them and adds them to the plan.
    pub(crate) shadows: Option<(Arc<ShadowGrids>, ShadowUniform)>,
    /// Linear RGB behind everything.
    pub(crate) background: Option<[f32; 3]>,
    /// True if colours are composited as sRGB codes, and decoded afterwards.
    pub(crate) is_encoded: bool,
    /// Depths at which rays end, if any do.
    pub(crate) ends: Option<RayEnds>,
    /// True if depths are written.
    pub(crate) depth: bool,
    /// True if normals of opaque surfaces are wanted.
    pub(crate) normals: bool,
    /// True for each tile that is drawn, row by row; the others stay empty. `None` draws all.
    pub(crate) tiles: Option<Vec<bool>>,
    /// The passes in drawing order: surfaces first.
    pub(crate) passes: Vec<PassPlan>,
    /// The instruction set of the CPU's inner loops.
    pub(crate) simd: SimdLevel,
    /// Receives the progress of the frame, and may cancel it.
    pub(crate) task: Option<Task>,
}

impl FramePlan {
    /// Plans a picture. Settings and camera have been checked.
    ///
    /// # Errors
    /// Layers too thin to have different depth keys.
    pub(crate) fn new(scene: &BlockedScene, camera: &Camera, settings: &Settings) -> Result<Self> {
        let is_encoded = settings.blends_encoded(scene);
        let in_codes;
        let settings = if is_encoded {
            // The tolerance is one of linear colour.
            in_codes = Settings {
                tolerance: settings.tolerance / GREATEST_SRGB_SLOPE,
                ..settings.clone()
            };
            &in_codes
        } else {
            settings
        };
        let layers = settings.composite.layer_kind().map(|kind| {
            let (thickness, tolerance) = (settings.composite.thickness(), settings.tolerance);
            Layers::new(scene, camera, kind, thickness, tolerance.into())
        });
        let layers = layers.transpose()?;
        let surfaces = scene.data().filter(|v| v.is_surface()).count();
        let lighting = lighting_uniform(camera, settings);
        let shared = Axes {
            linear_opacity: settings.advanced.linear_opacity,
            depth: settings.depth,
            normals: settings.normals,
            count: settings.show == Show::Count,
            ends: settings.backdrop.is_some(),
            ..Axes::default()
        };
        let planes = !settings.clip.is_empty();
        let keys = settings.keys(scene, camera);
        let keys_of_volumes = match layers {
            Some(_) => KeyKind::Layers,
            None => keys,
        };
        let mut passes = Vec::with_capacity(2);
        if surfaces > 0 {
            passes.push(PassPlan {
                draws: Draws::Surfaces,
                axes: Axes {
                    interval: if planes {
                        Interval::Planes
                    } else {
                        Interval::All
                    },
                    accumulate: Accumulate::Opaque,
                    ..shared
                },
                carries: Carries::Colour,
                lights_particles: lighting.is_some(),
                // Surfels have layers of their own.
                layers: None,
                keys,
                view: view_uniform(camera, settings, keys, None),
            });
        }
        if surfaces < scene.families().len() || surfaces == 0 {
            let classifies_slabs = settings.classifies_slabs();
            let classify = if classifies_slabs {
                Classify::Slab {
                    is_lit: lighting.is_some(),
                }
            } else {
                Classify::Particle
            };
            passes.push(PassPlan {
                draws: Draws::Volumes,
                axes: Axes {
                    may_be_exact: may_be_exact(camera, settings.filter)
                        && !scene.volumes().iter().all(BlockedVolume::is_of_splats),
                    interval: match (surfaces > 0, planes || shared.ends) {
                        (true, _) => Interval::Surface,
                        (false, true) => Interval::Planes,
                        (false, false) => Interval::All,
                    },
                    edges: scene.data().any(BlockedVolume::has_boundary),
                    accumulate: settings.composite.accumulate(),
                    classify,
                    ..shared
                },
                carries: if classifies_slabs {
                    Carries::Value
                } else {
                    Carries::Colour
                },
                // Slabs that are classified are lit as slabs.
                lights_particles: lighting.is_some() && !classifies_slabs,
                layers,
                keys: keys_of_volumes,
                view: ViewUniform {
                    least_length: least_length(scene, layers.as_ref()),
                    ..view_uniform(camera, settings, keys_of_volumes, layers.as_ref())
                },
            });
        }
        // Splats that state their opacity have their own low-pass filter.
        let low_pass = if scene.has_splats() {
            settings.low_pass_variance_px2.max(SPLAT_LOW_PASS_PX2)
        } else {
            settings.low_pass_variance_px2
        };
        let reach = Reach::new(camera, low_pass, settings.aperture.as_ref());
        let planes = cull_planes(camera, &settings.clip, reach);
        Ok(Self {
            frustum: frustum(camera, reach).clipped(planes),
            culls: settings.filter != Filter::UniformScaling,
            choice: ChoiceUniform {
                classified_by: classified_by(scene, settings) as u32,
                slab_thickness: thickness(layers.as_ref()),
                ..choice_uniform(camera, settings)
            },
            lighting,
            shadows: None,
            background: settings.shown_background(),
            is_encoded,
            ends: settings.backdrop.as_ref().map(RayEnds::of),
            depth: settings.depth,
            normals: settings.normals,
            tiles: None,
            passes,
            simd: settings.advanced.simd,
            task: settings.task.clone(),
            camera: camera.clone(),
        })
    }

    /// Plans a column density.
    ///
    /// - `largest`: the greatest magnitude of an amplitude of the scene.
    pub(crate) fn of_columns(
        scene: &BlockedScene,
        camera: &Camera,
        settings: &ColumnSettings,
        largest: f64,
    ) -> Self {
        let smoothing = settings
            .smoothing
            .filter(|_| settings.cutoff >= COLUMN_CUTOFF);
        let smoothing = smoothing.map_or(0, |kernel| 1 + kernel as u32);
        let settings = settings.shared();
        let reach = Reach::new(camera, settings.low_pass_variance_px2, None);
        let planes = cull_planes(camera, &settings.clip, reach);
        let frustum = frustum(camera, reach).clipped(planes);
        let culls = settings.filter != Filter::UniformScaling;
        // Sums have no order.
        let keys = KeyKind::Distance;
        let pass = PassPlan {
            draws: Draws::Volumes,
            axes: Axes {
                may_be_exact: may_be_exact(camera, settings.filter),
                interval: if settings.clip.is_empty() {
                    Interval::All
                } else {
                    Interval::Planes
                },
                edges: scene.data().any(BlockedVolume::has_boundary),
                accumulate: Accumulate::Column,
                smooths: smoothing != 0,
                ..Axes::default()
            },
            carries: amplitudes(scene, camera, culls.then_some(&frustum), largest),
            lights_particles: false,
            layers: None,
            keys,
            view: ViewUniform {
                smoothing,
                ..view_uniform(camera, &settings, keys, None)
            },
        };
        Self {
            frustum,
            culls,
            choice: ChoiceUniform {
                // Merged particles are exact for composited pictures only.
                merge_tolerance: 0.0,
                ..choice_uniform(camera, &settings)
            },
            lighting: None,
            shadows: None,
            background: None,
            is_encoded: false,
            ends: None,
            depth: false,
            normals: false,
            tiles: None,
            passes: vec![pass],
            simd: settings.advanced.simd,
            task: settings.task.clone(),
            camera: camera.clone(),
        }
    }

    /// Returns the view of a plan of columns, and field x length per unit of mass in a sum.
    pub(crate) fn column(&self) -> Option<(&ViewUniform, f64)> {
        self.passes.iter().find_map(|pass| match pass.carries {
            Carries::Amplitude { per_mass, .. } => Some((&pass.view, per_mass)),
            _ => None,
        })
    }

    /// Returns the rule that classifies kernels.
    pub(crate) fn classified_by(&self) -> ClassifiedBy {
        ClassifiedBy::of(self.choice.classified_by)
    }

    /// Returns whether merged particles may replace their members.
    pub(crate) fn has_detail(&self) -> bool {
        self.choice.merge_tolerance > 0.0
    }

    /// Returns the images that the plan draws: those of samples if it draws some tiles alone.
    pub(crate) fn target<'a, T>(&self, picture: &'a mut T, samples: &'a mut T) -> &'a mut T {
        match self.tiles {
            Some(_) => samples,
            None => picture,
        }
    }

    /// Returns the pass that draws volumes, if there is one.
    pub(crate) fn of_volumes(&self) -> Option<&PassPlan> {
        self.passes.iter().find(|p| p.draws == Draws::Volumes)
    }
}

impl PassPlan {
    /// Returns what [`distance_interval`] does, as the depth keys of this pass measure it.
    pub(crate) fn distance_interval(
        &self,
        camera: &Camera,
        block: &Block,
        is_spread: bool,
    ) -> (f64, f64) {
        let (distance, radius) = distance_interval(camera, block, is_spread);
        let distance = match (&self.layers, self.keys) {
            (Some(layers), _) => layers.axis.dot(camera.camera_point(block.origin)),
            (None, KeyKind::Depth) => camera.camera_point(block.origin).z,
            (None, _) => distance,
        };
        (distance, radius)
    }
}

impl Settings {
    /// Returns what the depth keys of a picture without layers measure.
    fn keys(&self, scene: &BlockedScene, camera: &Camera) -> KeyKind {
        let by_depth = match self.order {
            Order::Distance => false,
            Order::Depth => true,
            Order::Auto => {
                let mut volumes = scene.data().peekable();
                volumes.peek().is_some() && volumes.all(BlockedVolume::is_by_depth)
            }
        };
        match by_depth || camera.projection == Projection::Orthographic {
            true => KeyKind::Depth,
            false => KeyKind::Distance,
        }
    }

    /// Returns whether a picture of the scene is composited in sRGB codes.
    pub(crate) fn blends_encoded(&self, scene: &BlockedScene) -> bool {
        match (self.show, self.blend) {
            (Show::Choice | Show::Count, _) | (_, Blend::Linear) => false,
            (Show::Scene, Blend::Encoded) => true,
            (Show::Scene, Blend::Auto) => {
                let mut volumes = scene.data().peekable();
                volumes.peek().is_some() && volumes.all(BlockedVolume::is_encoded)
            }
        }
    }
}

/// Factor that keeps the peaks of footprints below one under perspective, for kernels down to a
/// thousandth of the distance of the farthest one. For a footprint whose peak is below one,
/// `choose_exact` compares the error relative to the peak with the tolerance.
const PERSPECTIVE_HEADROOM: f64 = 1.0 / (1 << 20) as f64;

/// Range of masses in f32: it leaves a margin on either side for the factors that multiply them.
const MASS_RANGE: [f64; 2] = [1e-30, 1e30];

/// Scales masses relative to the largest amplitude, so that footprints are of the order of one. Without
/// this, 1e43 g or the square of an image in parsecs would overflow f32.
fn amplitudes(
    scene: &BlockedScene,
    camera: &Camera,
    cull_by: Option<&Frustum>,
    largest: f64,
) -> Carries {
    let pixels_per_area = camera.focal_px.element_product();
    let unit = match camera.projection {
        Projection::Orthographic => 1.0 / pixels_per_area,
        Projection::Perspective => {
            let blocks = scene.data().flat_map(|volume| &volume.blocks);
            let farthest = blocks
                .filter(|block| cull_by.is_none_or(|frustum| frustum.sees(camera, block, false)))
                .map(|block| {
                    let (distance, radius) = distance_interval(camera, block, false);
                    distance + radius
                })
                .fold(0.0, f64::max);
            PERSPECTIVE_HEADROOM * farthest * (farthest / pixels_per_area)
        }
    };
    let unit = unit.clamp(MASS_RANGE[0], MASS_RANGE[1]);
    Carries::Amplitude {
        // A scene without amplitudes gives an empty image.
        scale: if largest == 0.0 { 0.0 } else { unit / largest },
        per_mass: largest / unit,
    }
}

/// Returns the rule that classifies a picture's kernels.
fn classified_by(scene: &BlockedScene, settings: &Settings) -> ClassifiedBy {
    // If no kernel is too wide for its value alone, its value classifies it.
    if scene.data().all(|volume| volume.lobes.is_none()) {
        return ClassifiedBy::Value;
    }
    match (settings.composite, settings.classify) {
        // The greatest mean value may be one that the transfer function hides.
        (Composite::Maximum { .. }, _) | (_, Classification::Particle) => ClassifiedBy::Value,
        (_, Classification::Extent) => ClassifiedBy::Extent,
        (_, Classification::Slab) => ClassifiedBy::Neighbours,
    }
}

/// Returns the thickness of layers, world units; 0 without layers.
#[allow(
    clippy::cast_possible_truncation,
    reason = "stages work in f32 by design"
)]
fn thickness(layers: Option<&Layers>) -> f32 {
    layers.map_or(0.0, |layers| layers.thickness as f32)
}

/// Returns the optical depth of half a slab; 0 unless particles carry values.
fn least_length(scene: &BlockedScene, layers: Option<&Layers>) -> f32 {
    let extinction = scene.carried().map(TransferFunction::greatest_extinction);
    0.5 * extinction.unwrap_or(0.0) * thickness(layers)
}

/// Returns whether a footprint may be on the exact path.
fn may_be_exact(camera: &Camera, filter: Filter) -> bool {
    matches!(filter, Filter::Adaptive | Filter::Exact)
        && camera.projection == Projection::Perspective
}

impl Composite {
    /// Returns the way in which the kernels of a pixel are combined.
    pub(crate) fn accumulate(self) -> Accumulate {
        match self {
            Self::Over => Accumulate::Over,
            Self::Sheets { .. } | Self::AxisSheets { .. } => Accumulate::Sheets,
            Self::Slabs { .. } => Accumulate::Slabs,
            Self::Maximum { .. } => Accumulate::Maximum,
        }
    }

    /// Returns the kind of layers in which kernels are summed, if there are any.
    fn layer_kind(self) -> Option<LayerKind> {
        match self {
            Self::Over => None,
            Self::Sheets { .. } => Some(LayerKind::Sheets),
            Self::AxisSheets { .. } => Some(LayerKind::AxisSheets),
            Self::Slabs { .. } | Self::Maximum { .. } => Some(LayerKind::Slabs),
        }
    }
}
