//! Converts camera and settings to f32, for the stages of a frame.

use glam::{DVec2, DVec3};

use super::settings::{Settings, Show};
use crate::blocks::{Frustum, Layers};
use crate::constants::{MAX_CLIP_PLANES, MAX_CUTOFF};
use crate::record::{ChoiceUniform, ClassifiedBy, KeyKind, LightingUniform, ViewUniform};
use crate::splat::Filter;
use crate::view::{Aperture, Camera, ClipPlane, Projection};

/// Greatest distance by which filters move a kernel's end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reach {
    /// In the image, pixels.
    px: f64,
    /// Across the view, world units.
    world: f64,
}

impl Reach {
    /// Returns the reach of a low-pass filter, and of an opening of the lens. The disc of a point at depth z is
    /// f |1/focus - 1/z| times the opening's in pixels: less than the sum of f/focus and of the opening itself, at z. The depths of a kernel
    /// around the eye add as much as its own depth does, at most.
    pub(crate) fn new(
        camera: &Camera,
        low_pass_variance_px2: f32,
        aperture: Option<&Aperture>,
    ) -> Self {
        let cutoff = f64::from(MAX_CUTOFF);
        let (opening, far_px) = aperture.map_or((0.0, 0.0), |own| {
            let opening = own.deviation();
            (opening, camera.focal_px.max_element() * opening / own.focus)
        });
        Self {
            px: cutoff * f64::from(low_pass_variance_px2).sqrt().hypot(far_px),
            world: cutoff * opening * std::f64::consts::SQRT_2,
        }
    }
}

/// Returns the frustum, widened by the reach of filters.
pub(crate) fn frustum(camera: &Camera, reach: Reach) -> Frustum {
    Frustum::new(camera, reach.px).widened(reach.world)
}

/// Returns the planes in camera space, with unit normals; inside is n . u + d >= 0. `check` has validated
/// them.
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

/// Returns the clip planes moved out by the reach of filters, which spread kernels beyond the planes. Blocks are culled by
/// these planes.
pub(crate) fn cull_planes(
    camera: &Camera,
    planes: &[ClipPlane],
    Reach { px, world }: Reach,
) -> impl Iterator<Item = (DVec3, f64)> {
    // World units; under perspective at a depth of 1.
    let reach = px / camera.focal_px.min_element();
    let planes = clip_planes(camera, planes).map(move |(n, distance)| (n, distance + world));
    planes.map(move |(normal, distance)| match camera.projection {
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
pub(crate) fn view_uniform(
    camera: &Camera,
    settings: &Settings,
    keys: KeyKind,
    layers: Option<&Layers>,
) -> ViewUniform {
    let mut planes = [[0.0; 4]; MAX_CLIP_PLANES];
    for (to, (normal, distance)) in planes.iter_mut().zip(clip_planes(camera, &settings.clip)) {
        *to = normal.extend(distance).as_vec4().into();
    }
    let layer = |of: fn(&Layers) -> f64| layers.map_or(0.0, of) as f32;
    ViewUniform {
        focal_px: camera.focal_px.as_vec2().into(),
        centre_px: camera.centre_px.as_vec2().into(),
        size: [camera.width, camera.height].map(|n| n as u32),
        orthographic: u32::from(camera.projection == Projection::Orthographic),
        filter_kind: settings.filter as u32,
        low_pass_variance_px2: settings.low_pass_variance_px2,
        tolerance: settings.tolerance,
        cutoff: settings.cutoff.unwrap_or(0.0),
        // Culling finds it later.
        key_scale: 0.0,
        show_choice: u32::from(settings.show == Show::Choice),
        key_kind: keys as u32,
        // Slabs begin at whole multiples of the thickness.
        layer_first: layers.map_or(0, |l| (l.near / l.thickness).round() as i32),
        layer_thickness: layer(|l| l.thickness),
        key_axis: layers.map_or([0.0; 3], |l| l.axis.as_vec3().into()),
        layer_shift: layers.map_or(0, |l| l.shift),
        keys_begin: u32::from(settings.composite.accumulate().cuts_slabs()),
        clip_count: settings.clip.len() as u32,
        sub_pixel_opacity: u32::from(settings.advanced.sub_pixel_opacity),
        // The plan sets it for maxima.
        least_length: 0.0,
        smoothing: 0,
        aperture: settings.aperture.map_or(0.0, |own| own.deviation()) as f32,
        per_focus: settings.aperture.map_or(0.0, |own| own.focus.recip()) as f32,
        unused: 0,
        clip_planes: planes,
    }
}

/// Returns the lights in camera space.
pub(crate) fn lighting_uniform(camera: &Camera, settings: &Settings) -> Option<LightingUniform> {
    let lighting = settings.lighting.as_ref()?;
    Some(LightingUniform::new(lighting, camera))
}

pub(crate) fn choice_uniform(camera: &Camera, settings: &Settings) -> ChoiceUniform {
    let focal = camera.focal_px.as_vec2();
    // Greatest tangent off the axis in the image: 1 + 2 tan²(fov/2) for a square image.
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let farthest = camera.centre_px.max(size - camera.centre_px) / camera.focal_px;
    let stretch = match camera.projection {
        Projection::Perspective => 1.0 + farthest.as_vec2().length_squared(),
        Projection::Orthographic => 1.0,
    };
    let [c_min, c_max] = settings.advanced.thresholds.unwrap_or([0.0; 2]);
    let is_adaptive = settings.filter == Filter::Adaptive;
    let by_hand = is_adaptive && settings.advanced.thresholds.is_some();
    ChoiceUniform {
        focal_px: [focal.min_element(), focal.max_element()],
        thresholds: [c_min, c_max * stretch],
        by_hand: u32::from(by_hand),
        orthographic: u32::from(camera.projection == Projection::Orthographic),
        filter_kind: settings.filter as u32,
        low_pass_variance_px2: settings.low_pass_variance_px2,
        // A low-pass filter that differs from kernel to kernel lets no block choose for all of its kernels.
        tolerance: match settings.aperture {
            Some(_) => 0.0,
            None => settings.tolerance,
        },
        merge_tolerance: if settings.draws_merged() {
            settings.tolerance * settings.advanced.merge_slack
        } else {
            0.0
        },
        // The plan sets it from the scene.
        classified_by: ClassifiedBy::Value as u32,
        slab_thickness: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::frame::settings::Advanced;

    #[test]
    fn thresholds_have_the_papers_factor_of_the_field_of_view() {
        let settings = Settings {
            advanced: Advanced {
                thresholds: Some([0.3, 2.0]),
                ..Advanced::default()
            },
            ..Settings::default()
        };
        let of = |camera: &Camera| choice_uniform(camera, &settings);
        let at = |size| Camera::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, 60.0, size);
        // tan² 30° = 1/3: 2 (1 + 2/3), within roundings of f32.
        let choice = of(&at([64, 64]));
        assert!((choice.thresholds[1] - 10.0 / 3.0).abs() < 1e-6);
        assert!((choice.thresholds[0] - 0.3).abs() < 1e-7);
        assert_eq!((choice.by_hand, choice.merge_tolerance), (1, 0.0));
        // Twice as wide: tan² is 4/3 across, and the farthest corner counts.
        let wide = of(&at([128, 64])).thresholds[1];
        assert!((wide - 16.0 / 3.0).abs() < 1e-6, "{wide}");
        let flat = Camera::orthographic(DVec3::ZERO, DVec3::Y, DVec3::Z, 9.0, [64, 64]);
        assert!((of(&flat).thresholds[1] - 2.0).abs() < 1e-6);
    }
}
