//! Checks settings and cameras, and words the errors for those that are refused.

use super::settings::{Blend, Composite, Order, Settings, Show};
use crate::blocks::{BlockedScene, BlockedVolume};
use crate::constants::{MAX_CLIP_PLANES, MAX_CUTOFF};
use crate::error::{Error, Result};
use crate::scene::Classification;
use crate::splat::Filter;
use crate::view::Camera;

/// Greatest width and height of an image: pixel ranges are half words.
const MAX_IMAGE_SIZE: usize = 65_535;
/// Greatest number of pixels of an image: 5 GiB of tiles and picture.
const MAX_IMAGE_PIXELS: usize = 1 << 27;

/// Checks the size of an image.
///
/// # Errors
/// No pixels, or too many.
pub(crate) fn check_size([width, height]: [usize; 2]) -> Result<()> {
    let refuse = |expected: &str| {
        let found = format!("{width} x {height}");
        Err(Error::invalid(
            "settings",
            "image size",
            expected,
            found,
            "change it",
        ))
    };
    let range = 1..=MAX_IMAGE_SIZE;
    if !range.contains(&width) || !range.contains(&height) {
        return refuse("1 to 65,535 pixels along each side");
    }
    if width * height > MAX_IMAGE_PIXELS {
        return refuse("at most 134,217,728 pixels in all");
    }
    Ok(())
}

/// Checks a camera and settings, and refuses those that cannot be drawn.
///
/// # Errors
/// A camera or settings out of range.
pub(crate) fn check(camera: &Camera, settings: &Settings) -> Result<()> {
    let refuse = |place: &str, expected: &str, found: String| {
        Err(Error::invalid(
            "settings",
            place,
            expected,
            found,
            "change it",
        ))
    };
    check_size([camera.width, camera.height])?;
    camera.validate()?;
    if let Some(background) = settings.background
        && !background.iter().all(|b| b.is_finite())
    {
        let found = format!("{background:?}");
        return refuse("background", "three finite numbers", found);
    }
    if let Some(backdrop) = &settings.backdrop {
        let depth = backdrop.depth();
        if [depth.width, depth.height] != [camera.width, camera.height] {
            let expected = format!(
                "{} x {} pixels, as the picture",
                camera.width, camera.height
            );
            return refuse(
                "backdrop",
                &expected,
                format!("{} x {}", depth.width, depth.height),
            );
        }
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
    let slack = settings.advanced.merge_slack;
    if !(slack >= 1.0 && slack.is_finite()) {
        return refuse("merge slack", "a number from 1 up", slack.to_string());
    }
    if let Some(thickness) = settings.composite.thickness()
        && !(thickness > 0.0 && thickness.is_finite())
    {
        let found = thickness.to_string();
        return refuse("thickness of layers", "a number above 0", found);
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
    if let Some(aperture) = &settings.aperture {
        aperture.validate(camera)?;
    }
    check_pairs(settings)
}

/// Refuses settings that are valid alone but not together.
///
/// # Errors
/// Thresholds for a filter that does not choose; classified slabs together with colours or depths that do
/// not belong to a field.
fn check_pairs(settings: &Settings) -> Result<()> {
    let refuse = |place: &str, expected: &str| {
        Err(Error::invalid(
            "settings",
            place,
            expected,
            "slabs classified by their mean values",
            "leave out one of the two",
        ))
    };
    if settings.advanced.thresholds.is_some() && settings.filter != Filter::Adaptive {
        return Err(Error::invalid(
            "settings",
            "thresholds",
            "the filter adaptive, which chooses by them",
            settings.filter.name(),
            "leave out one of the two",
        ));
    }
    if settings.advanced.thresholds.is_some() && settings.aperture.is_some() {
        return Err(Error::invalid(
            "settings",
            "thresholds",
            "one low-pass filter for all kernels",
            "an aperture, which gives each its own",
            "leave out one of the two",
        ));
    }
    if let Composite::Maximum { .. } = settings.composite {
        let refuse = |place: &str, found: &str| {
            let expected = "what a maximum along the ray has";
            let advice = "leave out one of the two";
            Err(Error::invalid("settings", place, expected, found, advice))
        };
        if settings.lighting.is_some() {
            return refuse("composite maximum", "light, which asks for a surface");
        }
        if settings.advanced.linear_opacity {
            return refuse("composite maximum", "an opacity, of which it has none");
        }
    }
    if settings.order != Order::Auto && settings.composite != Composite::Over {
        return Err(Error::invalid(
            "settings",
            "order of kernels",
            "a composite of single kernels",
            settings.composite.name(),
            "leave the order out: layers have one of their own",
        ));
    }
    let has_slabs = settings.composite.accumulate().cuts_slabs();
    if settings.classify == Classification::Slab && !has_slabs {
        return Err(Error::invalid(
            "settings",
            "classification of slabs",
            "a composite of slabs",
            settings.composite.name(),
            "take Composite::SLABS",
        ));
    }
    if !settings.classifies_slabs() {
        return Ok(());
    }
    if settings
        .lighting
        .as_ref()
        .is_some_and(|own| own.shadows.is_some())
    {
        return refuse("shadows", "particles that are lit one by one");
    }
    if settings.blend == Blend::Encoded {
        return refuse(
            "blending in codes",
            "particles that carry colours, which are encoded",
        );
    }
    if settings.show == Show::Choice {
        // Kernels carry a value here, and have no room for a colour.
        return refuse("what draws each kernel", "particles classified one by one");
    }
    if settings.advanced.sub_pixel_opacity {
        // The mean of a slab is taken over the length of the ray in it.
        return refuse(
            "opacity of lone kernels",
            "particles with optical depths of their own",
        );
    }
    Ok(())
}

/// Checks settings against a scene, and refuses those by which it cannot be drawn.
///
/// # Errors
/// Splats that state their opacity, with any composite but `over`; surfaces with a maximum.
pub(crate) fn check_scene(scene: &BlockedScene, settings: &Settings) -> Result<()> {
    if settings.composite != Composite::Over && scene.has_splats() {
        return Err(Error::invalid(
            "settings",
            "composite",
            "over, by which splats that state their opacity are made",
            settings.composite.name(),
            "leave it out",
        ));
    }
    let is_maximum = matches!(settings.composite, Composite::Maximum { .. });
    if is_maximum && scene.data().any(BlockedVolume::is_surface) {
        return Err(Error::invalid(
            "settings",
            "composite maximum",
            "one volume with a field",
            "surfaces beside it",
            "leave them out",
        ));
    }
    Ok(())
}
