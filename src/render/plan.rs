//! The plan of a frame: what is drawn, in which passes, and how. Made once, from scene, camera and
//! settings; both back ends read it, and none decides again what it says.

use super::settings::{Blend, ColumnSettings, Composite, Settings, Show};
use super::uniforms::{choice_uniform, cull_planes, frustum, lighting_uniform, view_uniform};
use crate::blocks::{BlockedScene, BlockedVolume, Frustum, LayerKind, Layers, distance_interval};
use crate::constants::GREATEST_SRGB_SLOPE;
use crate::error::Result;
use crate::record::{ChoiceUniform, ClassifiedBy, LightingUniform, ViewUniform};
use crate::scene::{Classification, TransferFunction};
use crate::simd::SimdLevel;
use crate::splat::{Accumulate, Axes, Classify, Filter, Interval, SPLAT_LOW_PASS_PX2};
use crate::task::Task;
use crate::view::{Camera, Projection};

/// Which volumes of a scene are drawn together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Draws {
    /// Surfels of opaque surfaces.
    Surfaces,
    /// All that light passes through.
    Volumes,
}

impl Draws {
    /// Whether a volume is among them.
    pub(crate) fn draws(self, volume: &BlockedVolume) -> bool {
        volume.is_surface() == (self == Self::Surfaces)
    }
}

/// What classified particles, and footprints, have in the place of a colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Carries {
    /// Linear RGB.
    Colour,
    /// Their value, as its share of the transfer function's range: slabs are classified.
    Value,
    /// The sign of their amplitude, whose magnitude times this is the mass: sums of them are columns.
    Amplitude {
        /// Masses per amplitude.
        scale: f64,
        /// Field x length per unit of a sum of masses.
        per_mass: f64,
    },
}

/// A pass of a frame: volumes that are drawn together, all stages from culling to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PassPlan {
    /// Which volumes.
    pub(crate) draws: Draws,
    /// What the rasteriser is specialised for.
    pub(crate) axes: Axes,
    /// What is carried from stage to stage besides places and masses.
    pub(crate) carries: Carries,
    /// Whether light falls on particles.
    pub(crate) lights_particles: bool,
    /// The layers in which kernels are summed, if they are: their depth keys number them.
    pub(crate) layers: Option<Layers>,
    /// The view in f32. Its `key_scale` follows from the depths that culling finds.
    pub(crate) view: ViewUniform,
}

/// A frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FramePlan {
    /// The camera.
    pub(crate) camera: Camera,
    /// What it sees, widened by the reach of the low-pass filter.
    pub(crate) frustum: Frustum,
    /// Whether blocks outside the frustum are left out: uniform scaling enlarges kernels beyond any
    /// reach.
    pub(crate) culls: bool,
    /// Rules by which blocks choose their filter.
    pub(crate) choice: ChoiceUniform,
    /// Lights as the camera sees them.
    pub(crate) lighting: Option<LightingUniform>,
    /// Linear RGB behind everything.
    pub(crate) background: Option<[f32; 3]>,
    /// Whether colours are composited as sRGB codes, and decoded afterwards.
    pub(crate) is_encoded: bool,
    /// Whether depths are wanted.
    pub(crate) depth: bool,
    /// Whether normals of opaque surfaces are wanted.
    pub(crate) normals: bool,
    /// In the order in which they are drawn: surfaces first.
    pub(crate) passes: Vec<PassPlan>,
    /// The instruction set of the CPU's inner loops.
    pub(crate) simd: SimdLevel,
    /// Is told how far the frame is, and may cancel it.
    pub(crate) task: Option<Task>,
}

impl FramePlan {
    /// The plan of a picture. Settings and camera have been checked.
    ///
    /// # Errors
    /// Layers too thin to be told apart.
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
            linear_opacity: settings.linear_opacity,
            depth: settings.depth,
            normals: settings.normals,
            count: settings.show == Show::Count,
            ..Axes::default()
        };
        let planes = !settings.clip.is_empty();
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
                view: view_uniform(camera, settings, None),
            });
        }
        if surfaces < scene.families().len() || surfaces == 0 {
            let classifies_slabs = settings.composite.classifies_slabs();
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
                    interval: match (surfaces > 0, planes) {
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
                // Slabs that are classified are lit themselves.
                lights_particles: lighting.is_some() && !classifies_slabs,
                layers,
                view: ViewUniform {
                    least_length: least_length(scene, layers.as_ref()),
                    ..view_uniform(camera, settings, layers.as_ref())
                },
            });
        }
        // Splats that state their opacity have a filter of their own.
        let low_pass = if scene.has_splats() {
            settings.low_pass_variance_px2.max(SPLAT_LOW_PASS_PX2)
        } else {
            settings.low_pass_variance_px2
        };
        let planes = cull_planes(camera, &settings.clip, low_pass);
        Ok(Self {
            frustum: frustum(camera, low_pass).clipped(planes),
            culls: settings.filter != Filter::UniformScaling,
            choice: ChoiceUniform {
                classified_by: classified_by(scene, settings) as u32,
                slab_thickness: thickness(layers.as_ref()),
                ..choice_uniform(camera, settings)
            },
            lighting,
            background: settings.shown_background(),
            is_encoded,
            depth: settings.depth,
            normals: settings.normals,
            passes,
            simd: settings.simd,
            task: settings.task.clone(),
            camera: camera.clone(),
        })
    }

    /// The plan of a column density.
    ///
    /// - `largest`: the greatest magnitude of an amplitude of the scene.
    pub(crate) fn of_columns(
        scene: &BlockedScene,
        camera: &Camera,
        settings: &ColumnSettings,
        largest: f64,
    ) -> Self {
        let settings = settings.shared();
        let low_pass = settings.low_pass_variance_px2;
        let planes = cull_planes(camera, &settings.clip, low_pass);
        let frustum = frustum(camera, low_pass).clipped(planes);
        let culls = settings.filter != Filter::UniformScaling;
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
                ..Axes::default()
            },
            carries: amplitudes(scene, camera, culls.then_some(&frustum), largest),
            lights_particles: false,
            layers: None,
            view: view_uniform(camera, &settings, None),
        };
        Self {
            frustum,
            culls,
            choice: ChoiceUniform {
                // Merged particles stand for what is composited.
                merge_tolerance: 0.0,
                ..choice_uniform(camera, &settings)
            },
            lighting: None,
            background: None,
            is_encoded: false,
            depth: false,
            normals: false,
            passes: vec![pass],
            simd: settings.simd,
            task: settings.task.clone(),
            camera: camera.clone(),
        }
    }

    /// Of a plan of columns: its view, and field x length per unit of a sum of masses.
    pub(crate) fn column(&self) -> Option<(&ViewUniform, f64)> {
        self.passes.iter().find_map(|pass| match pass.carries {
            Carries::Amplitude { per_mass, .. } => Some((&pass.view, per_mass)),
            _ => None,
        })
    }

    /// What decides about kernels, where more is known than their values.
    pub(crate) fn classified_by(&self) -> ClassifiedBy {
        ClassifiedBy::of(self.choice.classified_by)
    }

    /// Whether merged particles may stand for their members.
    pub(crate) fn has_detail(&self) -> bool {
        self.choice.merge_tolerance > 0.0
    }

    /// The pass that draws volumes, if there is one.
    pub(crate) fn of_volumes(&self) -> Option<&PassPlan> {
        self.passes.iter().find(|p| p.draws == Draws::Volumes)
    }
}

impl Settings {
    /// Whether a picture of the scene is composited in sRGB codes.
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

/// Under perspective the footprints' peaks are held below one by this factor, for kernels down to
/// a thousandth of the farthest one's distance: where a footprint's peak is below one, `choose_exact`
/// compares errors with the tolerance relative to it.
const PERSPECTIVE_HEADROOM: f64 = 1.0 / (1 << 20) as f64;

/// Masses in f32 leave this much room on either side for what multiplies them.
const MASS_RANGE: [f64; 2] = [1e-30, 1e30];

/// Masses relative to the largest amplitude, such that footprints come out near one: f32 holds
/// neither 1e43 g nor the square of an image in parsecs.
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
        // A scene without any amplitude is drawn as nothing.
        scale: if largest == 0.0 { 0.0 } else { unit / largest },
        per_mass: largest / unit,
    }
}

/// What decides about a picture's kernels.
fn classified_by(scene: &BlockedScene, settings: &Settings) -> ClassifiedBy {
    // Where no kernel is too wide for its value alone, nothing is asked for.
    if scene.data().all(|volume| volume.lobes.is_none()) {
        return ClassifiedBy::Value;
    }
    match (settings.composite.classifies_slabs(), settings.classify) {
        // The greatest mean value may be one that is not shown.
        (true, _) if settings.composite.accumulate() == Accumulate::Maximum => ClassifiedBy::Value,
        (true, _) => ClassifiedBy::Neighbours,
        (false, Classification::Extent) => ClassifiedBy::Extent,
        (false, Classification::Particle) => ClassifiedBy::Value,
    }
}

/// Of layers, world units; 0 without.
#[allow(
    clippy::cast_possible_truncation,
    reason = "stages work in f32 by design"
)]
fn thickness(layers: Option<&Layers>) -> f32 {
    layers.map_or(0.0, |layers| layers.thickness as f32)
}

/// The optical depth of half a slab, where particles carry values.
fn least_length(scene: &BlockedScene, layers: Option<&Layers>) -> f32 {
    let extinction = scene.carried().map(TransferFunction::greatest_extinction);
    0.5 * extinction.unwrap_or(0.0) * thickness(layers)
}

/// Whether a footprint may be on the exact path.
fn may_be_exact(camera: &Camera, filter: Filter) -> bool {
    matches!(filter, Filter::Adaptive | Filter::Exact)
        && camera.projection == Projection::Perspective
}

impl Composite {
    /// What kernels become together.
    pub(crate) fn accumulate(self) -> Accumulate {
        match self {
            Self::Over => Accumulate::Over,
            Self::Sheets { .. } | Self::AxisSheets { .. } => Accumulate::Sheets,
            Self::Slabs { .. } => Accumulate::Slabs,
            Self::Maximum { .. } => Accumulate::Maximum,
        }
    }

    /// The layers that it sums kernels in, if it does.
    fn layer_kind(self) -> Option<LayerKind> {
        match self {
            Self::Over => None,
            Self::Sheets { .. } => Some(LayerKind::Sheets),
            Self::AxisSheets { .. } => Some(LayerKind::AxisSheets),
            Self::Slabs { .. } | Self::Maximum { .. } => Some(LayerKind::Slabs),
        }
    }
}
