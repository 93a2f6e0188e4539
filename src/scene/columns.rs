//! Lists the columns of particles, for all that copies, reorders, sends, writes or reads every column alike.
//!
//! [`Columns`] of a part of a volume matches its variants. A new column is added there.

use std::borrow::Cow;
use std::convert::Infallible;

use bytemuck::Pod;
use glam::DVec3;

use crate::math::harmonics_count;
use crate::scene::boundary::{Boundary, BoundaryPlanes, BoundaryPlanesIn};
use crate::scene::headers::{ColourHeader, StrengthHeader};
use crate::scene::local_models::{LocalModels, LocalModelsIn};
use crate::scene::point_volume::{ColourIn, Particles, PointVolume, StrengthIn};
use crate::scene::storage::{Owned, Storage, picked};
use crate::scene::values::ValuesIn;

/// A column as bytes.
pub(crate) struct ColumnBytes<'a> {
    /// Name in files.
    #[cfg_attr(
        not(feature = "prepared"),
        expect(dead_code, reason = "files alone name columns")
    )]
    pub(crate) name: &'static str,
    /// Bytes per particle.
    pub(crate) size: usize,
    pub(crate) bytes: Cow<'a, [u8]>,
}

impl<'a> ColumnBytes<'a> {
    /// A column with `width` entries per particle.
    pub(crate) fn of<T: Pod>(name: &'static str, width: usize, entries: &'a [T]) -> Self {
        Self {
            name,
            size: width * size_of::<T>(),
            bytes: bytemuck::cast_slice(entries).into(),
        }
    }
}

/// Work on the columns of particles, one after another.
pub(crate) trait Visitor<S: Storage> {
    type Error;

    /// Visits a column.
    ///
    /// - `width`: number of entries per particle.
    fn column<T: Pod + Send + Sync>(
        &mut self,
        name: &'static str,
        width: usize,
        column: &mut S::Of<T>,
    ) -> Result<(), Self::Error>;

    /// Visits the planes that cut particles: not a column, because few particles are cut. Leaves them as they are
    /// by default.
    fn planes(&mut self, _: &mut BoundaryPlanesIn<S>) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// Parts of a volume that have columns.
pub(crate) trait Columns<S: Storage> {
    /// Appends all columns but planes, in the order of [`Self::visit`].
    fn list<'a>(&'a self, to: &mut Vec<ColumnBytes<'a>>);

    /// Calls a visitor with one column after another, and with planes last.
    ///
    /// # Errors
    /// The first error of the visitor.
    fn visit<V: Visitor<S>>(&mut self, visitor: &mut V) -> Result<(), V::Error>;

    /// All columns but planes, as bytes.
    fn columns(&self) -> Vec<ColumnBytes<'_>> {
        let mut all = Vec::new();
        self.list(&mut all);
        all
    }
}

impl<S: Storage, C: Columns<S>> Columns<S> for Option<C> {
    fn list<'a>(&'a self, to: &mut Vec<ColumnBytes<'a>>) {
        if let Some(own) = self {
            own.list(to);
        }
    }

    fn visit<V: Visitor<S>>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
        self.as_mut().map_or(Ok(()), |own| own.visit(visitor))
    }
}

/// Implements [`Columns`] for a part of a volume: the columns of each of its variants, with their types and numbers
/// of entries per particle.
macro_rules! columns {
    ([$($generics:tt)*] $storage:ty, $part:ty {
        $($variant:pat => { $($name:literal: [$type:ty; $width:expr] in $column:expr;)* })*
    }) => {
        impl<$($generics)*> $crate::scene::columns::Columns<$storage> for $part {
            fn list<'a>(&'a self, to: &mut Vec<$crate::scene::columns::ColumnBytes<'a>>) {
                match self {
                    $($variant => { $(to.push($crate::scene::columns::ColumnBytes::of::<$type>($name, $width, $column));)* })*
                }
            }

            fn visit<V: $crate::scene::columns::Visitor<$storage>>(
                &mut self,
                visitor: &mut V,
            ) -> Result<(), V::Error> {
                match self {
                    $($variant => { $(visitor.column::<$type>($name, $width, $column)?;)* })*
                }
                Ok(())
            }
        }
    };
}

/// Implements [`Columns`] for a volume: the columns of its fields.
macro_rules! columns_of_fields {
    ($storage:ty, $volume:ty {
        $($field:ident)*; $($name:literal: [u32; 1] in $optional:ident;)* $planes:ident
    }) => {
        impl $crate::scene::columns::Columns<$storage> for $volume {
            fn list<'a>(&'a self, to: &mut Vec<$crate::scene::columns::ColumnBytes<'a>>) {
                $(self.$field.list(to);)*
                $(if let Some(own) = &self.$optional {
                    to.push($crate::scene::columns::ColumnBytes::of::<u32>($name, 1, own));
                })*
            }

            fn visit<V: $crate::scene::columns::Visitor<$storage>>(
                &mut self,
                visitor: &mut V,
            ) -> Result<(), V::Error> {
                $(self.$field.visit(visitor)?;)*
                $(if let Some(own) = &mut self.$optional {
                    visitor.column::<u32>($name, 1, own)?;
                })*
                self.$planes.visit(visitor)
            }
        }
    };
}

pub(crate) use {columns, columns_of_fields};

columns! { [] Owned, Particles {
    Self::Lattice { .. } => {}
    Self::Isotropic { positions, sigmas } => {
        "position": [DVec3; 1] in positions;
        "sigma": [f32; 1] in sigmas;
    }
    Self::Anisotropic { positions, factors } => {
        "position": [DVec3; 1] in positions;
        "factor": [[f32; 6]; 1] in factors;
    }
    Self::Surfels { positions, tangents, .. } => {
        "position": [DVec3; 1] in positions;
        "tangents": [[f32; 6]; 1] in tangents;
    }
} }

columns! { [S: Storage] S, StrengthIn<S> {
    Self::Classified { volumes: numbers }
    | Self::Mass(numbers)
    | Self::PeakOpacity { opacities: numbers, .. }
    | Self::Surface(numbers)
    | Self::Translucent(numbers) => { "strength": [f32; 1] in numbers; }
} }

columns! { [S: Storage] S, ColourIn<S> {
    Self::Classified | Self::Uniform(_) => {}
    Self::PerParticle(colours) => { "colour": [[f32; 3]; 1] in colours; }
    Self::Harmonics { degree, coefficients, .. } => {
        "harmonics": [f32; 3 * harmonics_count(*degree)] in coefficients;
    }
} }

columns! { [S: Storage] S, ValuesIn<S> {
    Self::U8(values) => { "value_u8": [u8; 1] in values; }
    Self::I16(values) => { "value_i16": [i16; 1] in values; }
    Self::U16(values) => { "value_u16": [u16; 1] in values; }
    Self::F32(values) => { "value_f32": [f32; 1] in values; }
    Self::F64(values) => { "value_f64": [f64; 1] in values; }
} }

columns! { [S: Storage] S, LocalModelsIn<S> {
    Self { codes, .. } => { "local_model": [[u16; 3]; 1] in codes; }
} }

impl<S: Storage> Columns<S> for BoundaryPlanesIn<S> {
    fn list<'a>(&'a self, _: &mut Vec<ColumnBytes<'a>>) {}

    fn visit<V: Visitor<S>>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
        visitor.planes(self)
    }
}

impl Columns<Owned> for Boundary {
    fn list<'a>(&'a self, _: &mut Vec<ColumnBytes<'a>>) {}

    fn visit<V: Visitor<Owned>>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
        match self {
            Self::Lattice => Ok(()),
            Self::Planes(planes) => visitor.planes(planes),
        }
    }
}

columns_of_fields! { Owned, PointVolume {
    particles strength colour values local_models;
    "normal": [u32; 1] in normals;
    boundary
} }

impl PointVolume {
    /// A volume of the same kind without particles, or a lattice without entries for its samples.
    pub(crate) fn emptied(&self) -> Self {
        Self {
            particles: match &self.particles {
                lattice @ Particles::Lattice { .. } => lattice.clone(),
                Particles::Isotropic { .. } => Particles::Isotropic {
                    positions: Vec::new(),
                    sigmas: Vec::new(),
                },
                Particles::Anisotropic { .. } => Particles::Anisotropic {
                    positions: Vec::new(),
                    factors: Vec::new(),
                },
                Particles::Surfels { is_one_sided, .. } => Particles::Surfels {
                    positions: Vec::new(),
                    tangents: Vec::new(),
                    is_one_sided: *is_one_sided,
                },
            },
            strength: StrengthHeader::of(&self.strength).empty(),
            colour: ColourHeader::of(&self.colour).empty(),
            values: self.values.as_ref().map(|values| values.part(0..0)),
            transfer_function: self.transfer_function.clone(),
            boundary: self.boundary.as_ref().map(|boundary| match boundary {
                Boundary::Lattice => Boundary::Lattice,
                Boundary::Planes(_) => Boundary::Planes(BoundaryPlanes::default()),
            }),
            normals: self.normals.as_ref().map(|_| Vec::new()),
            local_models: self.local_models.as_ref().map(LocalModels::emptied),
        }
    }

    /// Keeps the particles at `indices`, in that order.
    pub(crate) fn gathered(mut self, indices: &[u32]) -> Self {
        self.gather(indices);
        self
    }

    /// Keeps the particles at `indices`, in that order, in place.
    pub(crate) fn gather(&mut self, indices: &[u32]) {
        let Ok(()) = self.visit(&mut Gathering(indices));
    }
}

struct Gathering<'a>(&'a [u32]);

impl Visitor<Owned> for Gathering<'_> {
    type Error = Infallible;

    fn column<T: Pod + Send + Sync>(
        &mut self,
        _: &'static str,
        width: usize,
        column: &mut Vec<T>,
    ) -> Result<(), Infallible> {
        *column = picked(column, width, self.0);
        Ok(())
    }

    fn planes(&mut self, planes: &mut BoundaryPlanes) -> Result<(), Infallible> {
        *planes = planes.gather(self.0);
        Ok(())
    }
}
