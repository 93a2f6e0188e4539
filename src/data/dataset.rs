//! Defines a data set as its file stores it, before any conversion.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::unit::divided;
use crate::data::association::Association;
use crate::data::cells::CellMesh;
use crate::data::gas::GasState;
use crate::data::mesh::Mesh;
use crate::data::particle_type::ParticleCount;
use crate::data::smoothing::Smoothing;
use crate::data::splats::SplatCloud;
use crate::error::{Advice, Error, Hint, Result};
use crate::scene::{Lattice, Values};

/// Geometry and fields of a data file, as a reader returns them. It contains nothing that the file does not state.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// File that was read.
    pub path: PathBuf,
    /// Name of the format, for people: "VTK image data", "PLOT3D grid", ...
    pub format: &'static str,
    /// Positions of the samples.
    pub geometry: Geometry,
    /// Values at the samples.
    pub fields: Vec<Field>,
    /// Names of the fields with the lengths, masses and densities of smoothed particles, if the format defines them. In
    /// tables, the names of columns identify them instead.
    pub smoothing: Option<Smoothing>,
    /// Facts from which temperatures of gas are derived, for snapshots with internal energies.
    pub gas: Option<GasState>,
    /// Types of particles that the file distinguishes, including those that were not read; empty for other formats.
    pub particle_types: Vec<ParticleCount>,
    /// Factor from mass over density to volume of a particle. It is 1, unless [`edit::place`](crate::edit::place)
    /// resized the particles and their densities are still those of the file.
    pub volume_scale: f64,
    /// Upward direction (a unit vector) and the reason for it in a few words, if the format defines one; see
    /// [`Dataset::up`].
    pub format_up: Option<(DVec3, &'static str)>,
    /// Omissions and assumptions of the reader, one sentence each, for people.
    pub notes: Vec<String>,
}

/// Positions of the samples of a [`Dataset`].
#[derive(Debug, Clone)]
pub enum Geometry {
    /// Samples on a regular or rectilinear lattice.
    Lattice(Lattice),
    /// One or more curvilinear grids. Fields hold the samples of one block after another.
    Curvilinear {
        /// The grids.
        blocks: Vec<CurvilinearBlock>,
    },
    /// An unstructured grid.
    Cells(CellMesh),
    /// Particles; the columns of their table are fields.
    Points {
        /// Positions.
        positions: Vec<DVec3>,
    },
    /// Splats with a peak opacity each, as radiance fields store them.
    Splats(SplatCloud),
    /// A polygon mesh.
    Mesh(Mesh),
}

/// One curvilinear grid.
#[derive(Debug, Clone, PartialEq)]
pub struct CurvilinearBlock {
    /// Nodes along i, j and k.
    pub dims: [usize; 3],
    /// Node positions, i fastest, then j, then k.
    pub nodes: Vec<DVec3>,
}

impl CurvilinearBlock {
    /// Returns the nodes of a lattice as a curvilinear grid.
    pub(crate) fn of_lattice(lattice: &Lattice) -> Self {
        let [x, y, _] = lattice.dims;
        let at = |n: usize| lattice.position([n % x, n / x % y, n / (x * y)]);
        Self {
            dims: lattice.dims,
            nodes: (0..lattice.len()).map(at).collect(),
        }
    }

    /// Checks that the number of nodes is the product of the dimensions.
    ///
    /// # Errors
    /// There are more or fewer nodes.
    pub fn validate(&self) -> Result<()> {
        let [x, y, z] = self.dims;
        let count = x.checked_mul(y).and_then(|n| n.checked_mul(z));
        if count == Some(self.nodes.len()) {
            return Ok(());
        }
        Err(Error::invalid(
            "curvilinear grid",
            "nodes",
            format!("{x} x {y} x {z} positions"),
            format!("{} positions", self.nodes.len()),
            "give one for each node",
        ))
    }

    /// Returns the number of nodes or cells along i, j and k.
    pub fn dims_of(&self, association: Association) -> [usize; 3] {
        match association {
            Association::Nodes => self.dims,
            Association::Cells => self.dims.map(|n| n.saturating_sub(1)),
        }
    }
}

/// Returns the magnitudes of vectors in double precision, even if the squares of components overflow or underflow.
fn magnitudes(components: &[Values], count: usize) -> Vec<f64> {
    let of = |i: usize| {
        let each = || components.iter().map(|c| c.wide(i));
        let greatest = each().fold(0.0, |most: f64, x| most.max(x.abs()));
        match (1e-150..1e150).contains(&greatest) {
            true => each().map(|x| x * x).sum::<f64>().sqrt(),
            false => each().fold(0.0, f64::hypot),
        }
    };
    (0..count).map(of).collect()
}

fn bounds(points: impl Iterator<Item = DVec3>) -> Option<(DVec3, DVec3)> {
    points
        .filter(|p| p.is_finite())
        .map(|p| (p, p))
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// Named numbers at the samples of a [`Dataset`].
#[derive(Debug, Clone)]
pub struct Field {
    /// Name in the file.
    pub name: String,
    /// Elements that the values belong to.
    pub association: Association,
    /// The numbers.
    pub source: FieldSource,
    /// Unit of the stored numbers, if the file states it: `K`, `g/cm^3`.
    pub unit: Option<String>,
}

/// Source of the numbers of a [`Field`].
#[derive(Debug, Clone)]
pub enum FieldSource {
    /// One scalar per sample.
    Scalar(Values),
    /// Several numbers per sample, one array per component.
    Vector(Vec<Values>),
    /// Computed from other fields on request, and not stored before.
    Derived(fn(&Dataset) -> Result<Values>),
}

impl Field {
    /// Returns the field's numbers, one array per component; returns none for a derived field.
    pub(crate) fn arrays(&self) -> &[Values] {
        match &self.source {
            FieldSource::Scalar(values) => std::slice::from_ref(values),
            FieldSource::Vector(components) => components,
            FieldSource::Derived(_) => &[],
        }
    }

    /// Returns the same arrays as [`Field::arrays`], mutable.
    pub(crate) fn arrays_mut(&mut self) -> &mut [Values] {
        match &mut self.source {
            FieldSource::Scalar(values) => std::slice::from_mut(values),
            FieldSource::Vector(components) => components,
            FieldSource::Derived(_) => &mut [],
        }
    }

    /// Returns true if the field's name is that of colours.
    pub(crate) fn is_named_colour(&self) -> bool {
        let lower = self.name.to_ascii_lowercase();
        lower.starts_with("color")
            || lower.starts_with("colour")
            || matches!(lower.as_str(), "rgb" | "rgba")
            || ["_rgb", "_rgba", "_color", "_colors"]
                .iter()
                .any(|end| lower.ends_with(end))
    }

    /// Returns true if the field holds colours. Its name must be that of colours, and it must have three or four
    /// components. They are unsigned integers of 8 or 16 bits, numbers from 0 to 1, or whole numbers from 0 to 255.
    pub(crate) fn is_colour(&self) -> bool {
        let FieldSource::Vector(components) = &self.source else {
            return false;
        };
        let is_channel = |values: &Values| match values {
            Values::U8(_) | Values::U16(_) => true,
            Values::I16(_) => values.finite_range().is_some_and(|[lo, _]| lo >= 0.0),
            Values::F32(_) | Values::F64(_) => values.finite_range().is_some_and(|[lo, hi]| {
                lo >= 0.0 && (hi <= 1.0 || (hi <= 255.0 && values.are_whole()))
            }),
        };
        self.is_named_colour()
            && matches!(components.len(), 3 | 4)
            && components.iter().all(is_channel)
    }
}

impl Dataset {
    /// Creates a data set without smoothing lengths and without notes.
    pub fn new(path: &Path, format: &'static str, geometry: Geometry, fields: Vec<Field>) -> Self {
        Self {
            path: path.to_path_buf(),
            format,
            geometry,
            fields,
            smoothing: None,
            gas: None,
            particle_types: Vec::new(),
            volume_scale: 1.0,
            format_up: None,
            notes: Vec::new(),
        }
    }

    /// Returns the least and the greatest finite coordinates of all samples, nodes or corners; `None` if there are
    /// none.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        match &self.geometry {
            Geometry::Lattice(lattice) if lattice.dims.contains(&0) => None,
            Geometry::Lattice(lattice) => {
                let last = lattice.dims.map(|n| n.saturating_sub(1));
                let end = |i: usize, axis: usize| if i >> axis & 1 == 0 { 0 } else { last[axis] };
                bounds((0..8).map(|i| lattice.position([0, 1, 2].map(|axis| end(i, axis)))))
            }
            Geometry::Curvilinear { blocks } => {
                bounds(blocks.iter().flat_map(|block| block.nodes.iter().copied()))
            }
            Geometry::Cells(mesh) => bounds(mesh.nodes.iter().copied()),
            Geometry::Splats(cloud) => bounds(cloud.positions.iter().copied()),
            Geometry::Mesh(mesh) => bounds(
                mesh.parts
                    .iter()
                    .flat_map(|part| part.positions.iter().copied()),
            ),
            Geometry::Points { positions } => bounds(positions.iter().copied()),
        }
    }

    /// Checks that geometry and fields are consistent. Readers guarantee this; data sets made by hand may not be.
    /// Fields with a wrong number of samples are refused when they are used.
    ///
    /// # Errors
    /// The first part that does not fit the others.
    pub fn validate(&self) -> Result<()> {
        let geometry = match &self.geometry {
            Geometry::Lattice(lattice) => lattice.validate(),
            Geometry::Curvilinear { blocks } => {
                blocks.iter().try_for_each(CurvilinearBlock::validate)
            }
            Geometry::Cells(mesh) => mesh.check(&self.path),
            Geometry::Points { .. } => Ok(()),
            Geometry::Splats(cloud) => cloud.validate(),
            Geometry::Mesh(mesh) => mesh.validate(),
        };
        geometry.map_err(|error| error.in_file(&self.path))?;
        self.fields.iter().try_for_each(|f| self.check_field(f))
    }

    /// Checks that all components of a vector have the same number of values.
    fn check_field(&self, field: &Field) -> Result<()> {
        let FieldSource::Vector(components) = &field.source else {
            return Ok(());
        };
        let count = components.first().map_or(0, Values::len);
        match components.iter().find(|c| c.len() != count) {
            None => Ok(()),
            Some(other) => Err(Error::format(
                &self.path,
                format!("field `{}`", field.name),
                format!("{count} values of each component"),
                other.len().to_string(),
                "give all components of each vector",
            )),
        }
    }

    /// Returns the scalar that `selector` names.
    ///
    /// - `NAME`: the field of this name, ignoring case. A vector field gives its magnitude.
    /// - `NAME:COMPONENT`: one component, given as `x`, `y`, `z` or its index.
    /// - `NAME@nodes` and `NAME@cells`: the field of nodes or of cells, if both have a field of this name. `NAME` alone
    ///   is the first.
    ///
    /// `Temp` also finds `Temp [K]`, if no field is named `Temp` and only one has that name with a unit.
    ///
    /// # Errors
    /// An unknown name or component; the message lists the fields of the data set.
    pub fn scalar(&self, selector: &str) -> Result<(Association, Values)> {
        if let Some((field, component)) = self.selected(selector) {
            let values = match (component, &field.source) {
                (None, _) => Some(self.field_scalar(field)?),
                (Some(i), FieldSource::Vector(components)) => components.get(i).cloned(),
                (Some(_), _) => None,
            };
            if let Some(values) = values {
                return Ok((field.association, values));
            }
        }
        Err(Error::format(
            &self.path,
            format!("field `{selector}`"),
            format!("one of {}", self.whole_selectors().join(", ")),
            self.gas
                .as_ref()
                .and_then(|gas| gas.not_derived(selector))
                .unwrap_or_else(|| "no field of that name".to_owned()),
            Hint::NameField,
        ))
    }

    /// Finds the field that a selector of [`Dataset::scalar`] names, and the component of a vector.
    pub(crate) fn selected(&self, selector: &str) -> Option<(&Field, Option<usize>)> {
        if let Some(found) = self.selected_of(selector, None) {
            return Some(found);
        }
        let (selector, of) = Association::split(selector)?;
        self.selected_of(selector, Some(of))
    }

    /// - `of`: the association of the field; `None` for either.
    fn selected_of(
        &self,
        selector: &str,
        of: Option<Association>,
    ) -> Option<(&Field, Option<usize>)> {
        let component = selector.rsplit_once(':').and_then(|(name, component)| {
            let index = match component.to_ascii_lowercase().as_str() {
                "x" => 0,
                "y" => 1,
                "z" => 2,
                digits => digits.parse().ok()?,
            };
            Some((name, index))
        });
        [Self::of_name, Self::of_bare_name]
            .into_iter()
            .find_map(|find| {
                let of_vector = || {
                    let (name, index) = component?;
                    let field = find(self, name, of)?;
                    let is_vector = matches!(field.source, FieldSource::Vector(_));
                    is_vector.then_some((field, Some(index)))
                };
                let whole = find(self, selector, of).map(|field| (field, None));
                whole.or_else(of_vector)
            })
    }

    fn of_name(&self, name: &str, of: Option<Association>) -> Option<&Field> {
        let is_meant = |f: &&Field| of.is_none_or(|of| of == f.association);
        let mut fields = self.fields.iter().filter(is_meant);
        fields.find(|f| f.name.eq_ignore_ascii_case(name))
    }

    /// Finds the only field whose name is `name` followed by a unit.
    fn of_bare_name(&self, name: &str, of: Option<Association>) -> Option<&Field> {
        let mut found = self
            .fields
            .iter()
            .filter(|f| of.is_none_or(|of| of == f.association))
            .filter(|f| divided(&f.name).is_some_and(|(bare, _)| bare.eq_ignore_ascii_case(name)));
        found.next().filter(|_| found.next().is_none())
    }

    /// Takes units from the names of fields whose unit is not stated otherwise.
    pub(crate) fn name_units(&mut self) {
        for field in &mut self.fields {
            let stated = field.unit.take();
            let in_name = || divided(&field.name).map(|(_, unit)| unit.to_owned());
            field.unit = stated.or_else(in_name);
        }
    }

    /// Returns the unit of the scalar that [`Dataset::scalar`] returns for a selector, if it is known.
    pub fn unit(&self, selector: &str) -> Option<&str> {
        self.selected(selector)?.0.unit.as_deref()
    }

    /// Returns the scalar of one field: its values, its magnitude or its derived values.
    ///
    /// # Errors
    /// The error of the derivation; components of unequal lengths.
    pub fn field_scalar(&self, field: &Field) -> Result<Values> {
        match &field.source {
            FieldSource::Scalar(values) => Ok(values.clone()),
            FieldSource::Vector(components) => {
                self.check_field(field)?;
                let n = components.first().map_or(0, Values::len);
                let is_wide = components.iter().any(|c| matches!(c, Values::F64(_)));
                Ok(match is_wide {
                    true => magnitudes(components, n).into(),
                    false => Values::F32(
                        (0..n)
                            .map(|i| {
                                components
                                    .iter()
                                    .map(|c| c.get(i).powi(2))
                                    .sum::<f32>()
                                    .sqrt()
                            })
                            .collect(),
                    ),
                })
            }
            FieldSource::Derived(derive) => derive(self),
        }
    }

    /// Returns the names of all fields in the order of the file, derived ones last.
    pub fn field_names(&self) -> Vec<&str> {
        self.fields.iter().map(|f| f.name.as_str()).collect()
    }

    /// Returns the name by which [`Dataset::scalar`] finds a whole field. It ends in `@nodes` or `@cells` if nodes and
    /// cells each have a field of that name.
    pub fn selector_of(&self, field: &Field) -> String {
        let is_other = |f: &Field| {
            f.association != field.association && f.name.eq_ignore_ascii_case(&field.name)
        };
        match self.fields.iter().any(is_other) {
            true => format!("{}@{}", field.name, field.association.name()),
            false => field.name.clone(),
        }
    }

    /// Returns the selectors of all fields, without those of components.
    fn whole_selectors(&self) -> Vec<String> {
        self.fields.iter().map(|f| self.selector_of(f)).collect()
    }

    /// Returns the names that [`Dataset::scalar`] accepts: each field's own ([`Dataset::selector_of`]), and those of
    /// the first three components of vectors.
    pub fn selectors(&self) -> Vec<String> {
        let of_field = |field: &Field| {
            let count = match &field.source {
                FieldSource::Vector(components) => components.len(),
                _ => 0,
            };
            let axes = ["x", "y", "z"].into_iter().take(count);
            let whole = self.selector_of(field);
            let of_axis = |axis| match Association::split(&whole) {
                Some((name, of)) if name == field.name => {
                    format!("{name}:{axis}@{}", of.name())
                }
                _ => format!("{whole}:{axis}"),
            };
            let components: Vec<String> = axes.map(of_axis).collect();
            std::iter::once(whole).chain(components)
        };
        self.fields.iter().flat_map(of_field).collect()
    }
}

impl SplatCloud {
    /// A data set of these splats.
    ///
    /// # Errors
    /// No splats.
    pub(crate) fn dataset(
        self,
        path: &Path,
        format: &'static str,
        fields: Vec<Field>,
    ) -> Result<Dataset> {
        if self.positions.is_empty() {
            return Err(Error::format(
                path,
                "splats",
                "at least one",
                "none",
                Advice::no_data("check that the file was written completely"),
            ));
        }
        Ok(Dataset::new(path, format, Geometry::Splats(self), fields))
    }
}
