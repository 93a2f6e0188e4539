//! A data set as its file holds it, before anything is made of it.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::unit::divided;
use super::{CellMesh, Mesh, ParticleCount, Smoothing, SplatCloud};
use crate::error::{Error, Hint, Result};
use crate::scene::{Lattice, Values};

/// What a reader returns: geometry, fields, and nothing that the file does not say.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// The file it came from.
    pub path: PathBuf,
    /// The format's name, for people: "VTK image data", "PLOT3D grid", ...
    pub format: &'static str,
    /// Where the samples lie.
    pub geometry: Geometry,
    /// What is known at them.
    pub fields: Vec<Field>,
    /// Which fields carry the lengths, masses and densities of smoothed particles, where the
    /// format says so; tables are known by their columns' names instead.
    pub smoothing: Option<Smoothing>,
    /// The types of particles that the file tells apart, those that were not read among them; of other formats empty.
    pub particle_types: Vec<ParticleCount>,
    /// What masses of particles over their densities are multiplied by to be volumes: 1, unless the particles were
    /// resized ([`edit::place`](crate::edit::place)) and the densities are still those of the file.
    pub volume_scale: f64,
    /// What points up, a unit vector, and why, in a few words, where the format says so; see [`Dataset::up`].
    pub format_up: Option<(DVec3, &'static str)>,
    /// What the reader left out or took for granted, one sentence each, for people.
    pub notes: Vec<String>,
}

/// Where the samples of a [`Dataset`] lie.
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
    /// Particles, with whatever columns their table has.
    Points {
        /// Positions.
        positions: Vec<DVec3>,
    },
    /// Splats with a peak opacity each, as radiance fields are stored.
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
    /// The nodes of a lattice.
    pub(crate) fn of_lattice(lattice: &Lattice) -> Self {
        let [x, y, _] = lattice.dims;
        let at = |n: usize| lattice.position([n % x, n / x % y, n / (x * y)]);
        Self {
            dims: lattice.dims,
            nodes: (0..lattice.len()).map(at).collect(),
        }
    }

    /// Checks that there are as many nodes as the dimensions say.
    ///
    /// # Errors
    /// More or fewer.
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

    /// Nodes or cells along i, j and k.
    pub fn dims_of(&self, association: Association) -> [usize; 3] {
        match association {
            Association::Nodes => self.dims,
            Association::Cells => self.dims.map(|n| n.saturating_sub(1)),
        }
    }
}

/// The magnitudes of vectors, in double precision; of those whose squares are beyond it, too.
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
    /// The name in the file.
    pub name: String,
    /// What the values belong to.
    pub association: Association,
    /// The numbers.
    pub source: FieldSource,
    /// The unit of the numbers as they are stored, where the file states it: `K`, `g/cm^3`.
    pub unit: Option<String>,
}

/// What the values of a [`Field`] belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Association {
    /// Nodes of a grid, or particles.
    Nodes,
    /// Cells of a grid; where it is structured, one fewer than the nodes along each axis.
    Cells,
}

impl Association {
    /// Nodes and cells, in the order of files.
    pub(crate) const BOTH: [Self; 2] = [Self::Nodes, Self::Cells];

    /// The word by which a selector of [`Dataset::scalar`] names it: `nodes` or `cells`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nodes => "nodes",
            Self::Cells => "cells",
        }
    }

    /// A selector without the word for nodes or cells behind it (`NAME@cells`), and what the word says.
    pub(crate) fn split(selector: &str) -> Option<(&str, Self)> {
        let (name, word) = selector.rsplit_once('@')?;
        Some((name, Self::of_name(word)?))
    }

    /// The one that a word names.
    pub(crate) fn of_name(word: &str) -> Option<Self> {
        let is = |of: &Self| of.name().eq_ignore_ascii_case(word);
        Self::BOTH.into_iter().find(is)
    }
}

/// Where the numbers of a [`Field`] come from.
#[derive(Debug, Clone)]
pub enum FieldSource {
    /// One scalar per sample.
    Scalar(Values),
    /// Several numbers per sample, one array per component.
    Vector(Vec<Values>),
    /// Computed from other fields when asked for, and stored nowhere until then.
    Derived(fn(&Dataset) -> Result<Values>),
}

impl Field {
    /// Its numbers, one array per component; none of what is derived.
    pub(crate) fn arrays(&self) -> &[Values] {
        match &self.source {
            FieldSource::Scalar(values) => std::slice::from_ref(values),
            FieldSource::Vector(components) => components,
            FieldSource::Derived(_) => &[],
        }
    }

    /// The same, to be changed.
    pub(crate) fn arrays_mut(&mut self) -> &mut [Values] {
        match &mut self.source {
            FieldSource::Scalar(values) => std::slice::from_mut(values),
            FieldSource::Vector(components) => components,
            FieldSource::Derived(_) => &mut [],
        }
    }

    /// Whether its name says that it holds colours.
    pub(crate) fn is_named_colour(&self) -> bool {
        let lower = self.name.to_ascii_lowercase();
        lower.starts_with("color")
            || lower.starts_with("colour")
            || matches!(lower.as_str(), "rgb" | "rgba")
            || ["_rgb", "_rgba", "_color", "_colors"]
                .iter()
                .any(|end| lower.ends_with(end))
    }

    /// Whether it holds colours: three or four unsigned integers of 8 or 16 bits, numbers from 0 to 1 or whole ones from 0
    /// to 255, under a name that says so.
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
    /// A data set without smoothing lengths and without notes.
    pub fn new(path: &Path, format: &'static str, geometry: Geometry, fields: Vec<Field>) -> Self {
        Self {
            path: path.to_path_buf(),
            format,
            geometry,
            fields,
            smoothing: None,
            particle_types: Vec::new(),
            volume_scale: 1.0,
            format_up: None,
            notes: Vec::new(),
        }
    }

    /// The least and the greatest coordinates of all samples, nodes or corners that are finite; `None` where
    /// none is.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        match &self.geometry {
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

    /// Checks that geometry and fields hold together: what readers promise, and what data sets made
    /// by hand may miss. Fields that belong to another number of samples are refused where they are
    /// used.
    ///
    /// # Errors
    /// The first part that does not fit the others.
    pub fn validate(&self) -> Result<()> {
        let geometry = match &self.geometry {
            Geometry::Lattice(lattice) => lattice.validate(),
            Geometry::Curvilinear { blocks } => {
                blocks.iter().try_for_each(CurvilinearBlock::validate)
            }
            Geometry::Cells(mesh) => super::check_cells(&self.path, mesh),
            Geometry::Points { .. } => Ok(()),
            Geometry::Splats(cloud) => cloud.validate(),
            Geometry::Mesh(mesh) => mesh.validate(),
        };
        geometry.map_err(|error| error.in_file(&self.path))?;
        self.fields.iter().try_for_each(|f| self.check_field(f))
    }

    /// As many numbers in each component of a vector.
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

    /// The scalar that `selector` names: a field's name (case-insensitive; a vector field
    /// gives its magnitude), or `NAME:COMPONENT` with a component `x`, `y`, `z` or its index. `NAME@nodes` and
    /// `NAME@cells` tell two fields of one name apart, of which `NAME` is the first. `Temp` finds `Temp [K]`, too, where
    /// no field has that very name and no other that name and a unit.
    ///
    /// # Errors
    /// An unknown name or component; the message lists the fields there are.
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
            "no field of that name",
            Hint::NameField,
        ))
    }

    /// The field that a selector of [`Dataset::scalar`] names, and the component of a vector.
    pub(crate) fn selected(&self, selector: &str) -> Option<(&Field, Option<usize>)> {
        if let Some(found) = self.selected_of(selector, None) {
            return Some(found);
        }
        let (selector, of) = Association::split(selector)?;
        self.selected_of(selector, Some(of))
    }

    /// - `of`: nodes or cells, where only fields of these are meant.
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

    /// The one field that has this name and a unit behind it.
    fn of_bare_name(&self, name: &str, of: Option<Association>) -> Option<&Field> {
        let mut found = self
            .fields
            .iter()
            .filter(|f| of.is_none_or(|of| of == f.association))
            .filter(|f| divided(&f.name).is_some_and(|(bare, _)| bare.eq_ignore_ascii_case(name)));
        found.next().filter(|_| found.next().is_none())
    }

    /// The unit of what [`Dataset::scalar`] gives for a selector, where it is known.
    pub fn unit(&self, selector: &str) -> Option<&str> {
        self.selected(selector)?.0.unit.as_deref()
    }

    /// The scalar of one field: its values, its magnitude, or what it is derived as.
    ///
    /// # Errors
    /// What the derivation says; components of unequal lengths.
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

    /// The names of all fields, in the file's order, derived ones last.
    pub fn field_names(&self) -> Vec<&str> {
        self.fields.iter().map(|f| f.name.as_str()).collect()
    }

    /// The name by which [`Dataset::scalar`] finds a whole field. It ends in `@nodes` or `@cells` if nodes and cells
    /// each have a field of that name.
    pub fn selector_of(&self, field: &Field) -> String {
        let is_other = |f: &Field| {
            f.association != field.association && f.name.eq_ignore_ascii_case(&field.name)
        };
        match self.fields.iter().any(is_other) {
            true => format!("{}@{}", field.name, field.association.name()),
            false => field.name.clone(),
        }
    }

    /// The selectors of all fields, each as a whole.
    fn whole_selectors(&self) -> Vec<String> {
        self.fields.iter().map(|f| self.selector_of(f)).collect()
    }

    /// The names that [`Dataset::scalar`] takes: the fields, each by a name of its own ([`Dataset::selector_of`]), and the first
    /// three components of vectors.
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
