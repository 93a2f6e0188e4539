//! What a scene requires of storage and code: decided once, read by whoever lays out memory.

use serde::Serialize;

use super::{Colour, Particles, PointVolume, Strength};
use crate::math::harmonics_count;

/// What one volume makes the renderer store and run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Requirements {
    /// Whether positions are stored; a lattice's follow from indices.
    pub positions: bool,
    /// Floats of shape stored per particle: 0 (shared or per axis), 1 (spheres) or 6 (factors).
    pub shape_floats: usize,
    /// The type of the stored values: `none`, `u8`, `i16`, `u16` or `f32`.
    pub values: &'static str,
    /// Whether a transfer function is applied every frame.
    pub classification: bool,
    /// Floats of mass, cell volume or opacity stored per particle.
    pub strength_floats: usize,
    /// Floats of colour stored per particle.
    pub colour_floats: usize,
    /// Whether particles are surfels of an opaque surface, which a pass of their own draws.
    pub surface: bool,
    /// Whether particles state an opacity on the image instead of an optical depth.
    pub peak_opacity: bool,
    /// Degree of the spherical harmonics that are evaluated for every frame; 0: none.
    pub harmonics_degree: u8,
    /// Whether a normal is stored per particle, four bytes.
    pub normals: bool,
    /// Whether a local model of the field is stored per particle, six bytes.
    pub local_models: bool,
}

impl Requirements {
    /// What `volume` requires.
    pub fn of(volume: &PointVolume) -> Self {
        let (positions, shape_floats) = match volume.particles {
            Particles::Lattice { .. } => (false, 0),
            Particles::Isotropic { .. } => (true, 1),
            Particles::Anisotropic { .. } | Particles::Surfels { .. } => (true, 6),
        };
        let harmonics_degree = volume.colour.harmonics_degree();
        Self {
            positions,
            shape_floats,
            values: volume.values.as_ref().map_or("none", |v| v.type_name()),
            classification: volume.is_classified(),
            strength_floats: match &volume.strength {
                Strength::Classified { volumes } => usize::from(!volumes.is_empty()),
                _ => 1,
            },
            colour_floats: match volume.colour {
                Colour::PerParticle(_) => 3,
                _ => harmonics_degree.map_or(0, |degree| 3 * harmonics_count(degree)),
            },
            surface: matches!(volume.strength, Strength::Surface(_)),
            peak_opacity: matches!(volume.strength, Strength::PeakOpacity { .. }),
            harmonics_degree: harmonics_degree.unwrap_or(0),
            normals: volume.normals.is_some(),
            local_models: volume.local_models.is_some(),
        }
    }
}
