//! Holds splats as a file's bytes, and notes what a format loses.

use glam::DVec3;

use crate::data::splats::SplatCloud;
use crate::math::HARMONIC_0;

/// Ratio of distance and extent from which an offset moves positions to the origin. It costs six of f32's 24
/// bits.
const FAR: f64 = 64.0;

/// Form of a PLY file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlyForm {
    /// With `scale_2`, as viewers expect.
    #[default]
    Volumetric,
    /// Without `scale_2` and marked `SplatRenderMode: 2dgs`: flat splats as 2-D Gaussian splatting stores them.
    Surfels,
}

/// Version of an SPZ file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SpzVersion {
    /// One gzip stream; more viewers read this version.
    #[default]
    Three,
    /// One zstd stream for each array; viewers for earlier versions refuse it.
    Four,
}

/// Options for a file of splats, beyond the format that its name gives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SplatFileOptions {
    /// Form of a PLY file; volumetric for other formats.
    pub form: PlyForm,
    /// Version of an SPZ file; `None` for other formats.
    pub spz_version: Option<SpzVersion>,
    /// Upward direction among the splats, a unit vector ([`Up::of_scene`](crate::io::Up::of_scene)). The splats are rotated
    /// so that it becomes the file's upward axis; [`SplatAxes`](crate::io::SplatAxes) defines that axis. If `None`, they
    /// keep the readers' coordinates.
    pub up: Option<DVec3>,
}

/// Bytes of a file before they are written.
pub(in crate::io) struct Encoded {
    pub(in crate::io) bytes: Vec<u8>,
    /// Names and bytes of other files of the same folder, which the first names.
    pub(in crate::io) beside: Vec<(&'static str, Vec<u8>)>,
    pub(in crate::io) position_quantum: f64,
    /// As [`WrittenSplats::order`](crate::io::WrittenSplats::order).
    pub(in crate::io) order: Vec<usize>,
    pub(in crate::io) notes: Vec<String>,
}

/// Returns the step between neighbouring f32 numbers at the greatest coordinate.
pub(in crate::io) fn single_precision_quantum(positions: impl Iterator<Item = DVec3>) -> f64 {
    let greatest = positions.fold(0.0_f64, |m, p| m.max(p.abs().max_element()));
    let exponent = greatest.max(f64::from(f32::MIN_POSITIVE)).log2().floor();
    (exponent - 23.0).exp2()
}

/// Notes that harmonics beyond the constant are lost, if there are any.
pub(in crate::io) fn note_harmonics_lost(notes: &mut Vec<String>, cloud: &SplatCloud) {
    if cloud.harmonics_degree > 0 {
        notes.push("colours that depend on the view are lost: the format has none".into());
    }
}

/// Notes that the mark of anti-aliased splats is lost, if they have it.
pub(in crate::io) fn note_mark_lost(notes: &mut Vec<String>, cloud: &SplatCloud) {
    if cloud.rule.is_anti_aliased() {
        notes.push("the mark of anti-aliased splats is lost: the format has none".into());
    }
}

/// Notes the number of values that were clamped to a format's range.
pub(in crate::io) fn note_cut(notes: &mut Vec<String>, count: usize, what: &str) {
    if count > 0 {
        notes.push(format!("{count} {what}"));
    }
}

/// Returns `round(x)` as a byte. Increments `cut` if the range clamps it by more than rounding does.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to a byte first"
)]
pub(in crate::io) fn byte(x: f64, cut: &mut usize) -> u8 {
    if !(-0.5..255.5).contains(&x) {
        *cut += 1;
    }
    x.round().clamp(0.0, 255.0) as u8
}

/// The colour of splat `i` that does not depend on the view, as bytes of 0 to 1. Increments `cut` for each channel beyond.
pub(in crate::io) fn colour_bytes(cloud: &SplatCloud, i: usize, cut: &mut usize) -> [u8; 3] {
    [0, 1, 2].map(|channel| {
        let code = 0.5 + f64::from(HARMONIC_0) * f64::from(cloud.coefficients(i)[channel]);
        byte(255.0 * code, cut)
    })
}

/// The opacity of splat `i` as a byte. Increments `faint` if it is written as 0 and is not.
pub(in crate::io) fn opacity_byte(cloud: &SplatCloud, i: usize, faint: &mut usize) -> u8 {
    let opacity = f64::from(cloud.opacities[i]);
    let written = byte(255.0 * opacity, &mut 0);
    *faint += usize::from(written == 0 && opacity > 0.0);
    written
}

/// Notes the colour channels that were clamped.
pub(in crate::io) fn note_cut_colours(notes: &mut Vec<String>, count: usize) {
    note_cut(notes, count, "colour channels outside 0 to 1 are cut");
}

/// Notes the opacities that were lost.
pub(in crate::io) fn note_faint(notes: &mut Vec<String>, count: usize) {
    let what = "opacities are below half of 1/255 and written as 0";
    note_cut(notes, count, what);
}

/// The median of the splats' middle scales.
pub(in crate::io) fn median_size(cloud: &SplatCloud) -> f64 {
    let middle = |s: &[f32; 3]| s[0].max(s[1]).min(s[0].min(s[1]).max(s[2]));
    let mut sizes: Vec<f32> = cloud.scales.iter().map(middle).collect();
    let half = sizes.len() / 2;
    f64::from(*sizes.select_nth_unstable_by(half, f32::total_cmp).1)
}

/// Returns the offset that is subtracted from positions far from the origin: the middle of their box.
pub(in crate::io) fn offset(positions: &[DVec3]) -> DVec3 {
    let lower = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let upper = positions
        .iter()
        .copied()
        .fold(DVec3::NEG_INFINITY, DVec3::max);
    let extent = (upper - lower).max_element();
    let farthest = lower.abs().max(upper.abs()).max_element();
    // A single splat, or several at one position, keep their coordinates if f32 represents them.
    if farthest > FAR * extent && positions.iter().any(|p| p.as_vec3().as_dvec3() != *p) {
        (lower + upper) * 0.5
    } else {
        DVec3::ZERO
    }
}
