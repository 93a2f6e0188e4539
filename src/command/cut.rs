//! Adds cut faces: `ewa-splat render --clip ... --cut-faces`.

use crate::math::NO_NORMAL;
use crate::sample::cut_faces;
use crate::scene::{Particles, PointVolume, Strength};
use crate::view::ClipPlane;
use crate::{Error, Result};
use clap::Args;

#[derive(Args)]
#[command(next_help_heading = "Method")]
pub(crate) struct CutOptions {
    /// Show the field on the planes of --clip, opaque and (unless --lit) in the transfer function's
    /// colours
    #[arg(long, requires = "clip", conflicts_with_all = ["reference", "column_density"])]
    pub(crate) cut_faces: bool,
}

/// Adds the faces where the planes cut each volume of a field. Splats and surfels get none.
///
/// - `is_lit`: whether the faces are lit; otherwise they show the transfer function's colours
///   unchanged.
pub(crate) fn add_faces(
    volumes: &mut Vec<PointVolume>,
    planes: &[ClipPlane],
    is_lit: bool,
) -> Result<()> {
    let has_field = |v: &&PointVolume| {
        let is_flat = matches!(v.particles, Particles::Surfels { .. });
        matches!(v.strength, Strength::Classified { .. }) && !is_flat
    };
    if !volumes.iter().any(|v| has_field(&v)) {
        return Err(Error::invalid(
            "--cut-faces",
            "data",
            "a field with a transfer function",
            "splats, meshes or particles with masses of their own",
            "leave --cut-faces out",
        ));
    }
    let faces = volumes
        .iter()
        .filter(has_field)
        .map(|v| cut_faces(v, planes));
    let faces = faces.collect::<Result<Vec<_>>>()?;
    for mut face in faces.into_iter().flatten() {
        face.normals = (!is_lit).then(|| vec![NO_NORMAL; face.particles.len()]);
        volumes.push(face);
    }
    Ok(())
}
