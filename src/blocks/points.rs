//! Defines a point set as columns.

#[cfg(feature = "prepared")]
use std::path::Path;

use bytemuck::Pod;
use glam::DVec3;

#[cfg(feature = "prepared")]
use super::room::ColumnFile;
use super::room::Room;
use crate::blocks::source::{Shapes, Source};
use crate::error::{Error, Result};
use crate::scene::columns::{ColumnBytes, Columns, Visitor, columns, columns_of_fields};
use crate::scene::storage::picked;
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
    pub(super) fn gather(mut self, order: &[u32], room: Room<'_>) -> Result<Self> {
        self.visit(&mut Picking { order, room })?;
        Ok(self)
    }
}

impl Columns<Shared> for Points {
    fn list<'a>(&'a self, to: &mut Vec<ColumnBytes<'a>>) {
        to.push(ColumnBytes::of("position", 1, &self.positions));
        self.shapes.list(to);
        self.rest.list(to);
    }

    fn visit<V: Visitor<Shared>>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
        visitor.column("position", 1, &mut self.positions)?;
        self.shapes.visit(visitor)?;
        self.rest.visit(visitor)
    }
}

columns! { [] Shared, PointShapes {
    Self::Spheres(sigmas) => { "sigma": [f32; 1] in sigmas; }
    Self::Ellipsoids(factors) => { "factor": [[f32; 6]; 1] in factors; }
    Self::Surfels { tangents, .. } => { "tangents": [[f32; 6]; 1] in tangents; }
} }

columns_of_fields! { Shared, Rest {
    strength colour values local_models;
    "normal": [u32; 1] in normals;
    boundary
} }

/// Picks particles in an order.
pub(super) struct Picking<'a> {
    pub(super) order: &'a [u32],
    pub(super) room: Room<'a>,
}

impl Visitor<Shared> for Picking<'_> {
    type Error = Error;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        _: &'static str,
        width: usize,
        column: &mut Column<T>,
    ) -> Result<()> {
        // Merged particles may have no depths of members.
        if !column.is_empty() {
            let own = std::mem::take(column);
            *column = match width {
                1 => self.room.pick(own, self.order)?,
                _ => picked(&own, width, self.order).into(),
            };
        }
        Ok(())
    }

    fn planes(&mut self, planes: &mut BoundaryPlanesIn<Shared>) -> Result<()> {
        *planes = planes.gather(self.order);
        Ok(())
    }
}

/// Builds the columns of points from parts, in files.
#[cfg(feature = "prepared")]
pub(super) struct PointsBuilder<'a> {
    numbers: ColumnFile<'a>,
    columns: Vec<ColumnFile<'a>>,
}

#[cfg(feature = "prepared")]
impl<'a> PointsBuilder<'a> {
    /// Starts columns of the same kind as those of `like`.
    pub(super) fn new(like: &Points, folder: &'a Path) -> Result<Self> {
        let columns = like.columns();
        let columns = columns.iter().map(|_| ColumnFile::new(folder));
        Ok(Self {
            numbers: ColumnFile::new(folder)?,
            columns: columns.collect::<Result<_>>()?,
        })
    }

    pub(super) fn extend(&mut self, points: &Points, numbers: &[u32]) -> Result<()> {
        self.numbers.extend(bytemuck::cast_slice(numbers))?;
        let mut each = self.columns.iter_mut().zip(points.columns());
        each.try_for_each(|(own, column)| own.extend(&column.bytes))
    }

    /// Moves all points to `points`, which has none; returns their numbers.
    pub(super) fn finish(self, points: &mut Points) -> Result<Column<u32>> {
        points.visit(&mut Finishing(self.columns.into_iter()))?;
        self.numbers.finish()
    }
}

#[cfg(feature = "prepared")]
struct Finishing<'a>(std::vec::IntoIter<ColumnFile<'a>>);

#[cfg(feature = "prepared")]
impl Visitor<Shared> for Finishing<'_> {
    type Error = Error;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        _: &'static str,
        _: usize,
        column: &mut Column<T>,
    ) -> Result<()> {
        if let Some(own) = self.0.next() {
            *column = own.finish()?;
        }
        Ok(())
    }
}
