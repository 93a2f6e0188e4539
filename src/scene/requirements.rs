//! Defines what a scene requires of storage and code: decided once, used wherever memory is laid out.

use serde::Serialize;

use super::point_volume::is_classified;
use crate::math::harmonics_count;
use crate::scene::point_volume::{ColourIn, Particles, PointVolume, StrengthIn};
use crate::scene::storage::Storage;
use crate::scene::values::ValuesIn;

/// Storage and code that one volume requires of the renderer.
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
    /// Whether particles are surfels of an opaque surface, which a separate pass draws.
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
    /// Requirements of `volume`.
    pub fn of(volume: &PointVolume) -> Self {
        let shape_floats = match volume.particles {
            Particles::Lattice { .. } => None,
            Particles::Isotropic { .. } => Some(1),
            Particles::Anisotropic { .. } | Particles::Surfels { .. } => Some(6),
        };
        Self {
            normals: volume.normals.is_some(),
            local_models: volume.local_models.is_some(),
            ..Self::of_columns(
                shape_floats,
                &volume.strength,
                &volume.colour,
                volume.values.as_ref(),
            )
        }
    }

    /// Requirements of columns, without normals and local models.
    ///
    /// - `shape_floats`: per particle; `None` for a lattice.
    pub(crate) fn of_columns<S: Storage>(
        shape_floats: Option<usize>,
        strength: &StrengthIn<S>,
        colour: &ColourIn<S>,
        values: Option<&ValuesIn<S>>,
    ) -> Self {
        let harmonics_degree = colour.harmonics_degree();
        Self {
            positions: shape_floats.is_some(),
            shape_floats: shape_floats.unwrap_or(0),
            values: values.map_or("none", |v| v.type_name()),
            classification: is_classified(strength, colour),
            strength_floats: match strength {
                StrengthIn::Classified { volumes } => usize::from(!volumes.is_empty()),
                _ => 1,
            },
            colour_floats: match colour {
                ColourIn::PerParticle(_) => 3,
                _ => harmonics_degree.map_or(0, |degree| 3 * harmonics_count(degree)),
            },
            surface: matches!(strength, StrengthIn::Surface(_)),
            peak_opacity: matches!(strength, StrengthIn::PeakOpacity { .. }),
            harmonics_degree: harmonics_degree.unwrap_or(0),
            normals: false,
            local_models: false,
        }
    }
}
