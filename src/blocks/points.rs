//! A set of points as columns.

use glam::DVec3;

use super::room::{MEMORY, Room};
use crate::error::Result;
use crate::math::harmonics_count;
use crate::scene::{
    Boundary, BoundaryPlanes, BoundaryPlanesIn, ColourIn, Column, LocalModels, LocalModelsIn,
    Particles, PointVolume, Shared, StrengthIn, TransferFunction, Values, ValuesIn,
};

/// Points, and what each of them has.
#[derive(Debug)]
pub(super) struct Points {
    pub(super) positions: Column<DVec3>,
    pub(super) shapes: PointShapes,
    pub(super) rest: Rest,
}

/// Shapes of points.
#[derive(Debug)]
pub(super) enum PointShapes {
    Spheres(Column<f32>),
    Ellipsoids(Column<[f32; 6]>),
    Surfels {
        tangents: Column<[f32; 6]>,
        is_one_sided: bool,
    },
}

/// What particles have besides places and shapes.
#[derive(Debug)]
pub(super) struct Rest {
    pub(super) strength: StrengthIn<Shared>,
    pub(super) colour: ColourIn<Shared>,
    pub(super) values: Option<ValuesIn<Shared>>,
    pub(super) boundary: Option<BoundaryPlanesIn<Shared>>,
    pub(super) normals: Option<Column<u32>>,
    pub(super) local_models: Option<LocalModelsIn<Shared>>,
}

impl Points {
    /// Those of a volume, and its transfer function; `None` of a lattice.
    pub(super) fn of(volume: PointVolume) -> Option<(Self, Option<TransferFunction>)> {
        let (positions, shapes) = match volume.particles {
            Particles::Lattice { .. } => return None,
            Particles::Isotropic { positions, sigmas } => {
                (positions, PointShapes::Spheres(sigmas.into()))
            }
            Particles::Anisotropic { positions, factors } => {
                (positions, PointShapes::Ellipsoids(factors.into()))
            }
            Particles::Surfels {
                positions,
                tangents,
                is_one_sided,
            } => {
                let tangents = tangents.into();
                let shapes = PointShapes::Surfels {
                    tangents,
                    is_one_sided,
                };
                (positions, shapes)
            }
        };
        let points = Self {
            positions: positions.into(),
            shapes,
            rest: Rest {
                strength: volume.strength.shared(),
                colour: volume.colour.shared(),
                values: volume.values.map(Values::shared),
                boundary: match volume.boundary {
                    Some(Boundary::Planes(planes)) => Some(BoundaryPlanes::shared(planes)),
                    Some(Boundary::Lattice) | None => None,
                },
                normals: volume.normals.map(Into::into),
                local_models: volume.local_models.map(LocalModels::shared),
            },
        };
        Some((points, volume.transfer_function))
    }

    /// Those of an order.
    pub(super) fn gather(self, order: &[u32], room: Room<'_>) -> Result<Self> {
        Ok(Self {
            positions: room.pick(self.positions, order)?,
            shapes: self.shapes.gather(order, room)?,
            rest: self.rest.gather(order, room)?,
        })
    }
}

impl PointShapes {
    /// Those of the points of an order.
    pub(super) fn gather(self, order: &[u32], room: Room<'_>) -> Result<Self> {
        Ok(match self {
            Self::Spheres(sigmas) => Self::Spheres(room.pick(sigmas, order)?),
            Self::Ellipsoids(factors) => Self::Ellipsoids(room.pick(factors, order)?),
            Self::Surfels {
                tangents,
                is_one_sided,
            } => Self::Surfels {
                tangents: room.pick(tangents, order)?,
                is_one_sided,
            },
        })
    }

    pub(super) fn are_surfels(&self) -> bool {
        matches!(self, Self::Surfels { .. })
    }
}

impl Rest {
    /// That of the particles of an order.
    pub(super) fn gather(self, order: &[u32], room: Room<'_>) -> Result<Self> {
        Ok(Self {
            strength: match self.strength {
                StrengthIn::Classified { volumes } => StrengthIn::Classified {
                    volumes: room.pick(volumes, order)?,
                },
                StrengthIn::Mass(masses) => StrengthIn::Mass(room.pick(masses, order)?),
                StrengthIn::Surface(areas) => StrengthIn::Surface(room.pick(areas, order)?),
                StrengthIn::Translucent(areas) => StrengthIn::Translucent(room.pick(areas, order)?),
                StrengthIn::PeakOpacity {
                    opacities,
                    is_anti_aliased,
                } => StrengthIn::PeakOpacity {
                    opacities: room.pick(opacities, order)?,
                    is_anti_aliased,
                },
            },
            colour: match self.colour {
                ColourIn::PerParticle(colours) => ColourIn::PerParticle(room.pick(colours, order)?),
                ColourIn::Harmonics {
                    degree,
                    coefficients,
                } => {
                    let stride = 3 * harmonics_count(degree);
                    let set = |&i: &u32| &coefficients[i as usize * stride..][..stride];
                    ColourIn::Harmonics {
                        degree,
                        coefficients: order.iter().flat_map(set).copied().collect(),
                    }
                }
                other => other,
            },
            values: match self.values {
                None => None,
                Some(values) => Some(match values {
                    ValuesIn::U8(v) => ValuesIn::U8(room.pick(v, order)?),
                    ValuesIn::I16(v) => ValuesIn::I16(room.pick(v, order)?),
                    ValuesIn::U16(v) => ValuesIn::U16(room.pick(v, order)?),
                    ValuesIn::F32(v) => ValuesIn::F32(room.pick(v, order)?),
                }),
            },
            boundary: self.boundary.map(|planes| planes.gather(order)),
            normals: match self.normals {
                None => None,
                Some(normals) => Some(MEMORY.pick(normals, order)?),
            },
            local_models: self.local_models.map(|models| models.gather(order)),
        })
    }
}
