//! Describes volumes without their particles (metadata), as the rank that has them sends them to the others.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::message::unknown;
use crate::prepared::about::{self, BatchHead, Function, Grid};
use crate::scene::{
    Boundary, BoundaryPlanes, Colour, LocalModels, Particles, PointVolume, Strength,
    TransferFunction, Values,
};

/// Metadata of a volume: everything but its particles.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Metadata {
    function: Option<Function>,
    lattice: Option<Grid>,
    columns: BatchHead,
    has_boundary: bool,
    /// Whether the volume is a lattice of values only.
    pub(super) is_plain: bool,
}

impl Metadata {
    pub(super) fn of(volume: &PointVolume) -> Self {
        let (particles, lattice) = match &volume.particles {
            Particles::Lattice {
                lattice,
                kernel_width,
            } => {
                let grid = Grid::of(lattice, *kernel_width, None);
                (about::Particles::Lattice { cube: 1 }, Some(grid))
            }
            Particles::Isotropic { .. } => (about::Particles::Isotropic, None),
            Particles::Anisotropic { .. } => (about::Particles::Anisotropic, None),
            Particles::Surfels { is_one_sided, .. } => {
                let is_one_sided = *is_one_sided;
                (about::Particles::Surfels { is_one_sided }, None)
            }
        };
        Self {
            function: volume.transfer_function.as_ref().map(Function::of),
            lattice,
            columns: BatchHead {
                particles,
                strength: match volume.strength {
                    Strength::Classified { .. } => about::Strength::Classified,
                    Strength::Mass(_) => about::Strength::Mass,
                    Strength::PeakOpacity {
                        is_anti_aliased, ..
                    } => about::Strength::PeakOpacity { is_anti_aliased },
                    Strength::Surface(_) => about::Strength::Surface,
                    Strength::Translucent(_) => about::Strength::Translucent,
                },
                colour: match volume.colour {
                    Colour::Classified => about::Colour::Classified,
                    Colour::PerParticle(_) => about::Colour::PerParticle,
                    Colour::Uniform(colour) => about::Colour::Uniform(colour),
                    Colour::Harmonics {
                        degree, is_linear, ..
                    } => about::Colour::Harmonics { degree, is_linear },
                },
                values: volume.values.as_ref().map(|values| match values {
                    Values::U8(_) => about::Values::U8,
                    Values::I16(_) => about::Values::I16,
                    Values::U16(_) => about::Values::U16,
                    Values::F32(_) | Values::F64(_) => about::Values::F32,
                }),
                local_model_scales: volume.local_models.as_ref().map(|models| models.scales()),
                has_normals: volume.normals.is_some(),
                has_indices: false,
                has_planes: matches!(volume.boundary, Some(Boundary::Planes(_))),
            },
            has_boundary: volume.boundary.is_some(),
            is_plain: volume.is_plain_lattice(),
        }
    }

    /// Returns the volume without particles, or a lattice without values.
    ///
    /// # Errors
    /// Metadata that no rank of this program sends.
    pub(super) fn volume(&self) -> Result<PointVolume> {
        let columns = &self.columns;
        let particles = match (columns.particles, &self.lattice) {
            (about::Particles::Lattice { .. }, Some(grid)) => Particles::Lattice {
                lattice: grid.lattice(),
                kernel_width: grid.kernel_width,
            },
            (about::Particles::Lattice { .. }, None) => return Err(unknown("no lattice")),
            (about::Particles::Isotropic, _) => Particles::Isotropic {
                positions: Vec::new(),
                sigmas: Vec::new(),
            },
            (about::Particles::Anisotropic, _) => Particles::Anisotropic {
                positions: Vec::new(),
                factors: Vec::new(),
            },
            (about::Particles::Surfels { is_one_sided }, _) => Particles::Surfels {
                positions: Vec::new(),
                tangents: Vec::new(),
                is_one_sided,
            },
        };
        let function = self.function.as_ref().map(|function| {
            let transfer: Option<TransferFunction> = function.transfer();
            transfer.ok_or_else(|| unknown("no transfer function"))
        });
        Ok(PointVolume {
            particles,
            strength: match columns.strength {
                about::Strength::Classified => Strength::Classified {
                    volumes: Vec::new(),
                },
                about::Strength::Mass => Strength::Mass(Vec::new()),
                about::Strength::PeakOpacity { is_anti_aliased } => Strength::PeakOpacity {
                    opacities: Vec::new(),
                    is_anti_aliased,
                },
                about::Strength::Surface => Strength::Surface(Vec::new()),
                about::Strength::Translucent => Strength::Translucent(Vec::new()),
            },
            colour: match columns.colour {
                about::Colour::Classified => Colour::Classified,
                about::Colour::PerParticle => Colour::PerParticle(Vec::new()),
                about::Colour::Uniform(colour) => Colour::Uniform(colour),
                about::Colour::Harmonics { degree, is_linear } => Colour::Harmonics {
                    degree,
                    coefficients: Vec::new(),
                    is_linear,
                },
            },
            values: columns.values.map(|values| match values {
                about::Values::U8 => Values::U8(Vec::new()),
                about::Values::I16 => Values::I16(Vec::new()),
                about::Values::U16 => Values::U16(Vec::new()),
                about::Values::F32 => Values::F32(Vec::new()),
            }),
            transfer_function: function.transpose()?,
            boundary: match (columns.has_planes, self.has_boundary) {
                (true, _) => Some(Boundary::Planes(BoundaryPlanes::default())),
                (false, true) => Some(Boundary::Lattice),
                (false, false) => None,
            },
            normals: columns.has_normals.then(Vec::new),
            local_models: columns.local_model_scales.map(|_| LocalModels::new(&[])),
        })
    }
}

/// Encodes metadata as bytes.
///
/// # Errors
/// Lengths or colours that are not finite.
pub(super) fn encode(metadata: &[Metadata]) -> Result<Vec<u8>> {
    let text = serde_json::to_vec(metadata).unwrap_or_default();
    // JSON stores numbers that are not finite as null, which cannot be read back.
    match decode(&text) {
        Ok(_) => Ok(text),
        Err(_) => Err(Error::invalid(
            "scene",
            "volumes",
            "finite numbers",
            "others among colours or lengths",
            "leave such volumes out",
        )),
    }
}

pub(super) fn decode(bytes: &[u8]) -> Result<Vec<Metadata>> {
    serde_json::from_slice(bytes).map_err(|e| unknown(&e.to_string()))
}
