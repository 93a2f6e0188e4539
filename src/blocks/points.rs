//! Defines a point set as columns.

use glam::DVec3;

use super::merge::{Shapes, Source};
#[cfg(feature = "prepared")]
use super::room::ColumnBuilder;
use super::room::Room;
use crate::error::Result;
use crate::math::harmonics_count;
use crate::scene::{
    Boundary, BoundaryPlanes, BoundaryPlanesIn, ColourIn, Column, LocalModels, LocalModelsIn,
    Particles, PointVolume, Shared, StrengthIn, TransferFunction, Values, ValuesIn,
};

/// Points, and their columns.
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

/// Columns of particles other than positions and shapes.
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
    /// Takes the points of a volume, and its transfer function; `None` for a lattice.
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

    /// Returns the points as levels of detail read them.
    ///
    /// - `principal`: the result of [`principal_ranges`](super::build::principal_ranges).
    pub(super) fn source<'a>(&'a self, principal: &'a [[f32; 2]]) -> Source<'a> {
        Source {
            positions: &self.positions,
            shapes: match &self.shapes {
                PointShapes::Spheres(sigmas) => Shapes::Spheres(sigmas),
                PointShapes::Ellipsoids(factors)
                | PointShapes::Surfels {
                    tangents: factors, ..
                } => Shapes::Factors(factors),
            },
            principal,
            strength: &self.rest.strength,
            colour: &self.rest.colour,
            values: self.rest.values.as_ref(),
            models: self.rest.local_models.as_ref(),
            boundary: self.rest.boundary.as_ref(),
        }
    }

    /// Whether levels of detail may be made of them. Merged particles reflect unlike any of their members (see
    /// [`PointVolume::normals`]), and a cluster of surfels need not lie in a plane.
    pub(super) fn are_merged(&self) -> bool {
        self.rest.normals.is_none() && !matches!(self.shapes, PointShapes::Surfels { .. })
    }

    /// Reorders the points.
    pub(super) fn gather(self, order: &[u32], room: Room<'_>) -> Result<Self> {
        Ok(Self {
            positions: room.pick(self.positions, order)?,
            shapes: self.shapes.gather(order, room)?,
            rest: self.rest.gather(order, room)?,
        })
    }
}

impl PointShapes {
    /// Reorders the shapes.
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
}

impl Rest {
    /// Reorders the columns.
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
                    is_linear,
                } => {
                    let stride = 3 * harmonics_count(degree);
                    let set = |&i: &u32| &coefficients[i as usize * stride..][..stride];
                    ColourIn::Harmonics {
                        degree,
                        coefficients: order.iter().flat_map(set).copied().collect(),
                        is_linear,
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
                    ValuesIn::F64(v) => ValuesIn::F64(room.pick(v, order)?),
                }),
            },
            boundary: self.boundary.map(|planes| planes.gather(order)),
            normals: match self.normals {
                None => None,
                Some(normals) => Some(room.pick(normals, order)?),
            },
            local_models: self.local_models.map(|models| models.gather(order)),
        })
    }
}

/// Builds the columns of points from parts.
#[cfg(feature = "prepared")]
pub(super) struct PointsBuilder<'a> {
    positions: ColumnBuilder<'a, DVec3>,
    numbers: ColumnBuilder<'a, u32>,
    sigmas: ColumnBuilder<'a, f32>,
    shapes: ColumnBuilder<'a, [f32; 6]>,
    strengths: ColumnBuilder<'a, f32>,
    colours: ColumnBuilder<'a, [f32; 3]>,
    coefficients: ColumnBuilder<'a, f32>,
    values: Option<ValuesBuilder<'a>>,
}

#[cfg(feature = "prepared")]
enum ValuesBuilder<'a> {
    U8(ColumnBuilder<'a, u8>),
    I16(ColumnBuilder<'a, i16>),
    U16(ColumnBuilder<'a, u16>),
    F32(ColumnBuilder<'a, f32>),
}

#[cfg(feature = "prepared")]
impl<'a> PointsBuilder<'a> {
    pub(super) fn new(like: &PointVolume, count: usize, room: Room<'a>) -> Result<Self> {
        Ok(Self {
            positions: room.column(count)?,
            numbers: room.column(count)?,
            sigmas: room.column(0)?,
            shapes: room.column(0)?,
            strengths: room.column(count)?,
            colours: room.column(0)?,
            coefficients: room.column(0)?,
            values: match &like.values {
                None => None,
                Some(Values::U8(_)) => Some(ValuesBuilder::U8(room.column(count)?)),
                Some(Values::I16(_)) => Some(ValuesBuilder::I16(room.column(count)?)),
                Some(Values::U16(_)) => Some(ValuesBuilder::U16(room.column(count)?)),
                Some(Values::F32(_) | Values::F64(_)) => {
                    Some(ValuesBuilder::F32(room.column(count)?))
                }
            },
        })
    }

    pub(super) fn extend(&mut self, points: &Points, numbers: &[u32]) -> Result<()> {
        self.positions.extend(&points.positions)?;
        self.numbers.extend(numbers)?;
        match &points.shapes {
            PointShapes::Spheres(sigmas) => self.sigmas.extend(sigmas)?,
            PointShapes::Ellipsoids(shapes)
            | PointShapes::Surfels {
                tangents: shapes, ..
            } => self.shapes.extend(shapes)?,
        }
        self.strengths.extend(points.rest.strength.stored())?;
        match &points.rest.colour {
            ColourIn::PerParticle(colours) => self.colours.extend(colours)?,
            ColourIn::Harmonics { coefficients, .. } => self.coefficients.extend(coefficients)?,
            ColourIn::Classified | ColourIn::Uniform(_) => {}
        }
        match (&mut self.values, &points.rest.values) {
            (Some(ValuesBuilder::U8(own)), Some(ValuesIn::U8(values))) => own.extend(values),
            (Some(ValuesBuilder::I16(own)), Some(ValuesIn::I16(values))) => own.extend(values),
            (Some(ValuesBuilder::U16(own)), Some(ValuesIn::U16(values))) => own.extend(values),
            (Some(ValuesBuilder::F32(own)), Some(ValuesIn::F32(values))) => own.extend(values),
            _ => Ok(()),
        }
    }

    /// Returns all points, and their numbers.
    pub(super) fn finish(self, like: &PointVolume) -> Result<(Points, Column<u32>)> {
        let strengths = self.strengths.finish()?;
        let points = Points {
            positions: self.positions.finish()?,
            shapes: match like.particles {
                Particles::Surfels { is_one_sided, .. } => PointShapes::Surfels {
                    tangents: self.shapes.finish()?,
                    is_one_sided,
                },
                Particles::Isotropic { .. } => PointShapes::Spheres(self.sigmas.finish()?),
                _ => PointShapes::Ellipsoids(self.shapes.finish()?),
            },
            rest: Rest {
                strength: match like.strength {
                    StrengthIn::Classified { .. } => StrengthIn::Classified { volumes: strengths },
                    StrengthIn::Mass(_) => StrengthIn::Mass(strengths),
                    StrengthIn::Surface(_) => StrengthIn::Surface(strengths),
                    StrengthIn::Translucent(_) => StrengthIn::Translucent(strengths),
                    StrengthIn::PeakOpacity {
                        is_anti_aliased, ..
                    } => StrengthIn::PeakOpacity {
                        opacities: strengths,
                        is_anti_aliased,
                    },
                },
                colour: match like.colour {
                    ColourIn::PerParticle(_) => ColourIn::PerParticle(self.colours.finish()?),
                    ColourIn::Harmonics {
                        degree, is_linear, ..
                    } => ColourIn::Harmonics {
                        degree,
                        coefficients: self.coefficients.finish()?,
                        is_linear,
                    },
                    ColourIn::Uniform(colour) => ColourIn::Uniform(colour),
                    ColourIn::Classified => ColourIn::Classified,
                },
                values: match self.values {
                    None => None,
                    Some(ValuesBuilder::U8(own)) => Some(ValuesIn::U8(own.finish()?)),
                    Some(ValuesBuilder::I16(own)) => Some(ValuesIn::I16(own.finish()?)),
                    Some(ValuesBuilder::U16(own)) => Some(ValuesIn::U16(own.finish()?)),
                    Some(ValuesBuilder::F32(own)) => Some(ValuesIn::F32(own.finish()?)),
                },
                boundary: None,
                normals: None,
                local_models: None,
            },
        };
        Ok((points, self.numbers.finish()?))
    }
}
