//! Splats as a file's bytes, and what formats lose of them.

use glam::DVec3;

use super::splats::SplatCloud;

/// Which of PLY's two forms is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlyForm {
    /// With `scale_2`, as viewers read it.
    #[default]
    Volumetric,
    /// Without `scale_2`, marked `SplatRenderMode: 2dgs`: flat splats as 2-D Gaussian splatting
    /// stores them.
    Surfels,
}

/// Which version of SPZ is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SpzVersion {
    /// One gzip stream: what more viewers read.
    #[default]
    Three,
    /// A zstd stream for each array, which those made before it refuse.
    Four,
}

/// What a file of splats is to be, beyond what its name says.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SplatFileOptions {
    /// Which of PLY's forms; of other formats volumetric.
    pub form: PlyForm,
    /// The version of an SPZ file; of other formats `None`.
    pub spz_version: Option<SpzVersion>,
    /// What points up among the splats, a unit vector ([`Up::of_scene`](super::Up::of_scene)): they are turned so that this is up in
    /// the file, as [`SplatAxes`](super::SplatAxes) has it. Without it they keep the coordinates that readers give.
    pub up: Option<DVec3>,
}

/// A file's bytes before they are written.
pub(super) struct Encoded {
    pub(super) bytes: Vec<u8>,
    pub(super) position_quantum: f64,
    pub(super) notes: Vec<String>,
}

/// The step between neighbouring f32 numbers at the greatest coordinate.
pub(super) fn single_precision_quantum(positions: impl Iterator<Item = DVec3>) -> f64 {
    let greatest = positions.fold(0.0_f64, |m, p| m.max(p.abs().max_element()));
    let exponent = greatest.max(f64::from(f32::MIN_POSITIVE)).log2().floor();
    (exponent - 23.0).exp2()
}

/// That a format has no harmonics beyond the constant, where there are some.
pub(super) fn note_harmonics_lost(notes: &mut Vec<String>, cloud: &SplatCloud) {
    if cloud.harmonics_degree > 0 {
        notes.push("colours that depend on the view are lost: the format has none".into());
    }
}

/// That a format has no mark of anti-aliased splats, where these are some.
pub(super) fn note_mark_lost(notes: &mut Vec<String>, cloud: &SplatCloud) {
    if cloud.is_anti_aliased {
        notes.push("the mark of anti-aliased splats is lost: the format has none".into());
    }
}

/// Counts numbers that a format's range cuts.
pub(super) fn note_cut(notes: &mut Vec<String>, count: usize, what: &str) {
    if count > 0 {
        notes.push(format!("{count} {what}"));
    }
}

/// `round(x)` as a byte, and whether the range cut it by more than rounding does.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to a byte first"
)]
pub(super) fn byte(x: f64, cut: &mut usize) -> u8 {
    if !(-0.5..255.5).contains(&x) {
        *cut += 1;
    }
    x.round().clamp(0.0, 255.0) as u8
}
