//! Makes kernels or splats of data, merges them to a stated size and error, and measures what pictures lose.
//!
//! Volumes become a table of kernels that absorb light: what is drawn, without its field. Surfaces, splats and data with
//! baked light become splats, which have one opacity from all sides.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::files::Embedded;
use crate::blocks::{BlockedParticles, BlockedVolume};
use crate::command::certificate::{self, cameras, drawn, renderer_of};
use crate::command::convert::Conversion;
use crate::command::fewer::{AZIMUTHS_DEG, STEP, losses, percentile, share};
use crate::command::render::{self, Shown};
use crate::data::splats::SplatCloud;
use crate::data::up::Up;
use crate::image::{Image, linear_from_srgb};
use crate::io::{OpenOptions, SplatFileOptions, open, write_splats};
use crate::math::HARMONIC_0;
use crate::render::Composite;
use crate::sample::fewer_splats;
use crate::scene::{Lighting, StrengthIn};
use crate::view::Camera;
use crate::{Error, Result, Settings};

/// Name of the file of splats. It keeps linear light, in which volumes are composited.
const SPLATS: &str = "splats.glb";
/// Name of the table of kernels.
const KERNELS: &str = "kernels.csv";
/// Least ratio of a kernel's axes in a table, whose variances have six digits.
const FLATTEST: f64 = 1.0 / 200.0;
/// Greatest opacity of a kernel in a table: of more, the depth is not known.
const MOST_OPAQUE: f32 = 0.99999;
/// Pixels along a side of the picture of the page's view.
const SIDE: usize = 512;
/// Share of the room that a try aims at, as packing differs.
const AIM: f64 = 0.98;
/// Greatest number of tries to reach a size.
const TRIES: usize = 12;
/// Bits of the fractions of stored numbers: they err by a thousandth of themselves, and pack to half.
const FRACTION_BITS: u32 = 9;
/// Steps of positions along the longest edge of the data.
const STEPS: f64 = 65_536.0;

/// Greatest size and error of splats.
pub(super) struct Limits {
    /// Characters of the packed file.
    pub(super) characters: Option<u64>,
    /// Difference that 99.9 % of the pixels have at most.
    pub(super) error: Option<f64>,
}

/// Kernels or splats of data.
pub(super) struct Merged {
    pub(super) file: Embedded,
    /// Rotation from the data to the splats.
    pub(super) turn: DQuat,
    pub(super) summary: Value,
}

/// Kernels or splats in a packed file, and their pictures.
struct Written {
    file: Embedded,
    turn: DQuat,
    images: Vec<Image>,
}

/// Pictures of the data.
struct Pictures<'a> {
    settings: &'a Settings,
    cameras: Vec<Camera>,
    images: Vec<Image>,
    up: DVec3,
    /// True if kernels are written, not splats.
    of_kernels: bool,
}

/// Converts what is drawn to splats, and merges them.
///
/// # Errors
/// The errors of converting, drawing and writing; splats that do not fit; an error that needs more than the size.
pub(super) fn fewer(
    own: &render::Arguments,
    shown: &mut Shown,
    limits: &Limits,
    bar: &ProgressBar,
) -> Result<Merged> {
    let conversion = Conversion {
        data: &own.data,
        width: None,
        light: own.light.lighting(),
        of_surfaces: (!own.light.is_unlit()).then(Lighting::default),
        light_option: "--lit",
        is_quiet: true,
        fewer: None,
    };
    let mut converted = conversion.converted(&own.inputs, bar)?;
    let mut cloud = std::mem::take(&mut converted.cloud);
    let given = cloud.positions.len();
    let up = Up::of_scene(converted.ups.iter().map(|(_, up)| *up)).direction;
    if let Some(count) = own.data.count.filter(|_| !converted.has_meshes()) {
        cloud = fewer_splats(cloud, count as usize, None)?;
    }
    bar.set_message("drawing the data");
    let of_kernels =
        cloud.harmonics_degree == 0 && shown.renderer.volumes().iter().all(is_absorbing);
    let pictures = Pictures::of(shown, up, of_kernels)?;
    bar.set_message("merging splats");
    let mut written = pictures.written(&cloud)?;
    let of_all = pictures.error(&written);
    if let Some(most) = limits.error {
        if of_all > most {
            let text = format!(
                "--error {most}: all of them differ by {of_all:.3} from the data, and none are merged for it"
            );
            converted.notes.push(text);
        }
        while pictures.error(&written) <= most {
            let fewer = fewer_splats(cloud.clone(), share(STEP, cloud.positions.len()), None)?;
            if fewer.positions.len() == cloud.positions.len() {
                break;
            }
            let tried = pictures.written(&fewer)?;
            if pictures.error(&tried) > most {
                break;
            }
            (cloud, written) = (fewer, tried);
        }
    }
    if let Some(most) = limits.characters {
        let needed = written.file.characters;
        if let Some(error) = limits
            .error
            .filter(|error| of_all <= *error && needed > most)
        {
            let expected = format!("{} bytes more, which --error {error} needs", needed - most);
            let found = "less";
            let advice = "state more, or a greater error";
            return Err(Error::invalid("--size", "value", expected, found, advice));
        }
        let mut tries = 0;
        while written.file.characters > most {
            let count = cloud.positions.len();
            let ratio = AIM * most as f64 / written.file.characters as f64;
            let fewer = fewer_splats(cloud.clone(), share(ratio, count), None)?;
            tries += 1;
            if fewer.positions.len() == count || tries > TRIES {
                let expected = format!(
                    "more bytes: {} for what cannot be merged",
                    written.file.characters
                );
                let found = most.to_string();
                return Err(Error::invalid(
                    "--size",
                    "value",
                    expected,
                    found,
                    "state more",
                ));
            }
            cloud = fewer;
            written = pictures.written(&cloud)?;
        }
    }
    let mut summary = losses(&pictures.images, &written.images);
    summary["kind"] = json!(if of_kernels { "kernels" } else { "splats" });
    summary["given"] = json!(given);
    summary["count"] = json!(cloud.positions.len());
    summary["of_all"] = json!(of_all);
    summary["notes"] = json!(converted.notes);
    Ok(Merged {
        file: written.file,
        turn: written.turn,
        summary,
    })
}

impl<'a> Pictures<'a> {
    /// Draws the data: the view of the page, and four from around them.
    fn of(shown: &'a mut Shown, up: DVec3, of_kernels: bool) -> Result<Self> {
        let own = &shown.camera;
        let ratio = SIDE as f64 / own.width.max(own.height) as f64;
        let scaled = |n: usize| share(ratio, n);
        let view = Camera {
            width: scaled(own.width),
            height: scaled(own.height),
            focal_px: own.focal_px * ratio,
            centre_px: own.centre_px * ratio,
            ..own.clone()
        };
        let around = cameras(&shown.renderer, up, &AZIMUTHS_DEG);
        let cameras: Vec<Camera> = std::iter::once(view).chain(around).collect();
        let settings = Settings {
            background: None,
            ..shown.settings.clone()
        };
        let images = drawn(&mut shown.renderer, &cameras, &settings)?;
        Ok(Self {
            settings: &shown.settings,
            cameras,
            images,
            up,
            of_kernels,
        })
    }

    /// Writes kernels or splats, and draws what is read back.
    fn written(&self, cloud: &SplatCloud) -> Result<Written> {
        let failed =
            |path: &Path, e| Error::io(path, "writing", e, "check the folder for temporary files");
        let folder = tempfile::tempdir().map_err(|e| failed(&std::env::temp_dir(), e))?;
        let name = if self.of_kernels { KERNELS } else { SPLATS };
        let path = folder.path().join(name);
        let turn = if self.of_kernels {
            std::fs::write(&path, table(cloud)).map_err(|e| failed(&path, e))?;
            DQuat::IDENTITY
        } else {
            let options = SplatFileOptions {
                up: Some(self.up),
                ..SplatFileOptions::default()
            };
            write_splats(&path, &rounded(cloud.clone()), &options)?.turn
        };
        let file = Embedded::of_file(name.into(), &path)?;
        let mut renderer = renderer_of(open(&path, &OpenOptions::default())?)?;
        let back = DMat3::from_quat(turn.inverse());
        let cameras = self.cameras.iter().map(|camera| Camera {
            eye: turn * camera.eye,
            camera_from_world: camera.camera_from_world * back,
            ..camera.clone()
        });
        let clip = self
            .settings
            .clip
            .iter()
            .map(|plane| crate::view::ClipPlane {
                normal: turn * plane.normal,
                ..*plane
            });
        let settings = Settings {
            tolerance: self.settings.tolerance,
            clip: clip.collect(),
            low_pass_variance_px2: renderer.suitable_low_pass_px2(),
            composite: Composite::Over,
            ..Settings::default()
        };
        let images = drawn(&mut renderer, &cameras.collect::<Vec<_>>(), &settings)?;
        Ok(Written { file, turn, images })
    }

    /// Returns the difference that 99.9 % of the pixels have at most, sRGB codes.
    fn error(&self, written: &Written) -> f64 {
        percentile(&self.images, &written.images, None)
    }
}

/// Returns true if kernels of a volume absorb light, and are no splats that state opacities.
fn is_absorbing(volume: &BlockedVolume) -> bool {
    let is_flat = matches!(volume.particles, BlockedParticles::Surfels { .. });
    !is_flat && !matches!(volume.strength, StrengthIn::PeakOpacity { .. })
}

/// Returns the variance of a kernel. None is so flat that the digits of a table could make it none.
fn variance(cloud: &SplatCloud, i: usize) -> DMat3 {
    let scales = DVec3::from(cloud.scales[i].map(f64::from));
    let scales = scales.max(DVec3::splat(FLATTEST * scales.max_element()));
    certificate::variance(cloud, i, scales)
}

/// Returns kernels as a table: places, variances, opacities along the shortest axis and linear colours.
fn table(cloud: &SplatCloud) -> String {
    let (low, step) = steps(&cloud.positions);
    // As many decimals as steps need.
    let decimals = if step > 0.0 {
        (-step.log10()).ceil().clamp(0.0, 300.0)
    } else {
        6.0
    };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 0 and 300"
    )]
    let decimals = decimals as usize;
    let mut text = String::from("x,y,z,vxx,vxy,vxz,vyy,vyz,vzz,opacity,r,g,b\n");
    let stride = cloud.harmonics_stride();
    for (i, position) in cloud.positions.iter().enumerate() {
        let place = near(*position, low, step).to_array();
        let variance = variance(cloud, i);
        let [x, y, z] = [variance.x_axis, variance.y_axis, variance.z_axis];
        let shape = [x.x, x.y, x.z, y.y, y.z, z.z];
        let colours = &cloud.harmonics[i * stride..][..3];
        let light = |c: &f32| {
            let own = 0.5 + HARMONIC_0 * c;
            let linear = if cloud.is_linear {
                own
            } else {
                linear_from_srgb(own)
            };
            linear.clamp(0.0, 1.0)
        };
        let opacity = cloud.opacities[i].min(MOST_OPAQUE);
        let opacity = match opacity < 0.1 {
            true => format!("{opacity:.3e}"),
            false => format!("{opacity:.5}"),
        };
        let words = place.map(|n| format!("{n:.decimals$}")).into_iter();
        let words = words
            .chain(shape.map(|n| format!("{n:.5e}")))
            .chain([opacity])
            .chain(colours.iter().map(|c| format!("{:.4}", light(c))));
        text += &words.collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    text
}

/// Returns the lower corner of positions, and the step that they are stored in.
fn steps(positions: &[DVec3]) -> (DVec3, f64) {
    let low = positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = positions
        .iter()
        .fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let step = (high - low).max_element() / STEPS;
    (low, if step.is_finite() { step } else { 0.0 })
}

/// Returns the nearest of the positions that are stored.
fn near(position: DVec3, low: DVec3, step: f64) -> DVec3 {
    match step > 0.0 {
        true => low + ((position - low) / step).round() * step,
        false => position,
    }
}

/// Rounds the numbers of splats, so that they pack to half.
fn rounded(mut cloud: SplatCloud) -> SplatCloud {
    let round = |x: &mut f32| {
        let unused = f32::MANTISSA_DIGITS - 1 - FRACTION_BITS;
        // The carry may reach the exponent, as it should; infinite numbers stay.
        let bits = x.to_bits().wrapping_add(1 << (unused - 1)) & (u32::MAX << unused);
        let near = f32::from_bits(bits);
        if near.is_finite() {
            *x = near;
        }
    };
    let (low, step) = steps(&cloud.positions);
    for position in &mut cloud.positions {
        *position = near(*position, low, step);
    }
    cloud.scales.as_flattened_mut().iter_mut().for_each(round);
    cloud
        .rotations
        .as_flattened_mut()
        .iter_mut()
        .for_each(round);
    cloud.opacities.iter_mut().for_each(|opacity| {
        round(opacity);
        *opacity = opacity.min(1.0);
    });
    cloud.harmonics.iter_mut().for_each(round);
    cloud
}
