//! Describes volumes without their particles (metadata), as the rank that has them sends them to the others.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::message::unknown;
use crate::prepared::about::{self, BatchHead, Function, Grid};
use crate::scene::headers::{ColourHeader, StrengthHeader, ValuesHeader};
use crate::scene::{
    Boundary, BoundaryPlanes, LocalModels, Particles, PointVolume, TransferFunction,
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
                strength: StrengthHeader::of(&volume.strength),
                colour: ColourHeader::of(&volume.colour),
                values: volume.values.as_ref().map(ValuesHeader::of),
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
            strength: columns.strength.empty(),
            colour: columns.colour.empty(),
            values: columns.values.map(ValuesHeader::empty),
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
