//! Defines drawables: data sets in memory, or surfels that are ready.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use ewa_splat::io::{
    Association, CellMesh, CurvilinearBlock, Dataset, Field, FieldSource, Geometry, Mesh,
    OpenOptions, SplatCloud, SplatFileOptions, StepChoice, TextureImage, Up, format_of,
    has_particle_types, open, read, write_splats,
};
use ewa_splat::render::{bake_light, nothing_lit};
use ewa_splat::sample::{
    SampleOptions, SampleReport, Sampled, SampledScene, discs, is_surface, scene, splat_cloud,
};
use ewa_splat::scene::{Lattice, LatticeSpacing, SplatRule};
use ewa_splat::{Result, Task};
use glam::{DMat3, DVec3};
use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arrays::{Floats, Numbers, Points, indices, pairs, quadruples, triples};
use crate::errors::exception;
use crate::forked::detached;
use crate::settings::{Said, lighting, open_options, sample_options};
use crate::task::run;

/// Drawable made of one object: a volume, a surface, or the parts of a collection.
#[pyclass(frozen, module = "ewa_splat._core")]
pub(crate) struct Drawable {
    pub(crate) sources: Vec<Source>,
    /// Direction up, if it was given.
    up: Option<DVec3>,
}

/// Data set with its sampling options, or surfels that are ready.
pub(crate) struct Source {
    pub(crate) data: Data,
    pub(crate) options: SampleOptions,
    /// Last sampled scene, until it is drawn.
    sampled: Mutex<Option<(SampleOptions, SampledScene)>>,
    /// Report of the first sampling.
    report: Mutex<Option<SampleReport>>,
}

pub(crate) enum Data {
    Set(Arc<Dataset>),
    Surfels(Arc<Sampled>),
}

impl Source {
    fn new(data: Data, options: SampleOptions) -> Self {
        Self {
            data,
            options,
            sampled: Mutex::new(None),
            report: Mutex::new(None),
        }
    }

    /// Samples the source. A scene sampled before with the same options is returned, once.
    pub(crate) fn scene(&self, options: &SampleOptions) -> Result<SampledScene> {
        let alike = |own: &SampleOptions| SampleOptions {
            task: None,
            ..own.clone()
        };
        let kept = self
            .sampled
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        if let Some((own, sampled)) = kept
            && alike(&own) == alike(options)
        {
            return Ok(sampled);
        }
        let sampled = match &self.data {
            Data::Set(dataset) => scene(Dataset::clone(dataset), options)?,
            Data::Surfels(ready) => SampledScene {
                volumes: vec![ready.volume.clone()],
                report: ready.report.clone(),
            },
        };
        let mut report = self.report.lock().unwrap_or_else(PoisonError::into_inner);
        report.get_or_insert_with(|| SampleReport {
            value_sample: None,
            ..sampled.report.clone()
        });
        Ok(sampled)
    }

    /// Returns the report of sampling. It samples the source now if this was not done before.
    fn report(&self, task: &Task) -> Result<SampleReport> {
        let known = || {
            let report = self.report.lock();
            report.unwrap_or_else(PoisonError::into_inner).clone()
        };
        if let Some(report) = known() {
            return Ok(report);
        }
        let options = SampleOptions {
            task: Some(task.clone()),
            ..self.options.clone()
        };
        let sampled = self.scene(&options)?;
        let report = sampled.report.clone();
        let mut kept = self.sampled.lock().unwrap_or_else(PoisonError::into_inner);
        *kept = Some((options, sampled));
        Ok(report)
    }

    /// Returns the field that makes columns sum masses, `Some(None)` if they do so by themselves; `None` without masses.
    pub(crate) fn masses(&self) -> Option<Option<String>> {
        let Data::Set(dataset) = &self.data else {
            return None;
        };
        if !matches!(dataset.geometry, Geometry::Points { .. }) {
            return None;
        }
        let has = |name: &str| {
            let mut names = dataset.fields.iter().map(|field| &field.name);
            names.any(|own| own.eq_ignore_ascii_case(name))
        };
        let of_snapshot = dataset.smoothing.as_ref();
        match of_snapshot.map(|smoothing| smoothing.mass.clone()) {
            Some(mass) => mass.map(Some),
            None if has("m") => Some(Some("m".into())),
            None => has("mass").then_some(None),
        }
    }

    /// Returns the direction up.
    pub(crate) fn up(&self) -> Up {
        match &self.data {
            Data::Set(dataset) => dataset.up(),
            Data::Surfels(_) => Up {
                is_of_mesh: true,
                ..Up::of_scene([])
            },
        }
    }

    /// Returns the least and the greatest coordinates.
    pub(crate) fn corners(&self) -> Option<(DVec3, DVec3)> {
        match &self.data {
            Data::Set(dataset) => dataset.bounds(),
            Data::Surfels(ready) => {
                let shapes = &ready.volume.particles;
                let ewa_splat::scene::Particles::Surfels { positions, .. } = shapes else {
                    return None;
                };
                let ends = positions.iter().map(|&p| (p, p));
                ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            }
        }
    }
}

/// Makes an array of a field's values, in their type.
fn array<'py>(py: Python<'py>, values: &ewa_splat::scene::Values) -> Bound<'py, PyAny> {
    use ewa_splat::scene::Values;
    match values {
        Values::U8(values) => values.to_pyarray(py).into_any(),
        Values::I16(values) => values.to_pyarray(py).into_any(),
        Values::U16(values) => values.to_pyarray(py).into_any(),
        Values::F32(values) => values.to_pyarray(py).into_any(),
        Values::F64(values) => values.to_pyarray(py).into_any(),
    }
}

/// Makes a field of an array.
fn field(name: &str, values: ewa_splat::scene::Values, association: Association) -> Field {
    Field {
        name: name.into(),
        association,
        source: FieldSource::Scalar(values),
        unit: None,
    }
}

/// Returns the association: nodes, unless `cells` is given.
fn association(of: &str) -> Association {
    match of {
        "cells" => Association::Cells,
        _ => Association::Nodes,
    }
}

impl Drawable {
    /// Makes a drawable of one data set. It checks now that its parts fit; samples are checked when
    /// they are drawn.
    fn of(
        py: Python<'_>,
        what: &'static str,
        geometry: Geometry,
        fields: Vec<Field>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let said = sample_options(options)?;
        let mut dataset = Dataset::new(what.as_ref(), what, geometry, fields);
        said.set_units(&mut dataset);
        let Said {
            options,
            up,
            around,
            ..
        } = said;
        let dataset = detached(py, || dataset.validate().map(|()| dataset));
        let dataset = dataset.map_err(|error| exception(&error))?;
        if around.is_some() && is_surface(&dataset) {
            return Err(without_volume());
        }
        Ok(Self {
            sources: sources_of(dataset, options, around).collect(),
            up,
        })
    }

    /// Returns this drawable, of one data set, with other values of its field in the same unit.
    pub(crate) fn with_values(&self, py: Python<'_>, values: Numbers) -> PyResult<Self> {
        let ([source], Some(name)) = (self.sources.as_slice(), self.field_name()) else {
            let text = "values: expected a volume with values, found one without, or parts of a collection";
            return Err(PyValueError::new_err(text));
        };
        let Data::Set(dataset) = &source.data else {
            return Err(PyValueError::new_err(
                "values: expected a volume, found surfels",
            ));
        };
        let mut dataset = detached(py, || Dataset::clone(dataset));
        for field in &mut dataset.fields {
            if field.name.eq_ignore_ascii_case(&name)
                && let FieldSource::Scalar(own) = &mut field.source
            {
                if own.len() != values.0.len() {
                    let text = format!(
                        "values: expected {} of them, found {}",
                        own.len(),
                        values.0.len()
                    );
                    return Err(PyValueError::new_err(text));
                }
                *own = values.0;
                let data = Data::Set(Arc::new(dataset));
                return Ok(Self {
                    sources: vec![Source::new(data, source.options.clone())],
                    up: self.up,
                });
            }
        }
        let text = format!("values: expected a scalar field `{name}`, found none");
        Err(PyValueError::new_err(text))
    }

    /// Returns the name of the field that was asked for.
    fn field_name(&self) -> Option<String> {
        let mut sources = self.sources.iter();
        sources.find_map(|source| source.options.field.clone())
    }

    /// Returns the direction up of each data set.
    pub(crate) fn ups(&self) -> impl Iterator<Item = Up> {
        self.sources.iter().map(|source| match self.up {
            Some(direction) => Up {
                direction,
                reason: "as it was said",
                front: None,
                is_plane: false,
                is_of_mesh: false,
            },
            None => source.up(),
        })
    }
}

#[pymethods]
impl Drawable {
    /// Makes a drawable of points with columns, named as in tables.
    #[staticmethod]
    #[pyo3(signature = (positions, columns, options=None))]
    fn points(
        py: Python<'_>,
        positions: Points,
        columns: Vec<(String, Numbers)>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let columns = columns.into_iter();
        let fields = columns.map(|(name, values)| field(&name, values.0, Association::Nodes));
        let geometry = Geometry::Points {
            positions: positions.0,
        };
        Self::of(py, "points", geometry, fields.collect(), options)
    }

    /// Makes a drawable of a lattice. Rows of `step` are the steps along x, y and z of the array.
    #[staticmethod]
    #[pyo3(signature = (dims, origin, step, name, values, of, options=None))]
    #[expect(clippy::too_many_arguments, reason = "the package's own call")]
    fn grid(
        py: Python<'_>,
        dims: [usize; 3],
        origin: [f64; 3],
        step: [[f64; 3]; 3],
        name: &str,
        values: Numbers,
        of: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let lattice = Lattice {
            dims,
            spacing: LatticeSpacing::Uniform {
                origin: origin.into(),
                step: DMat3::from_cols_array_2d(&step),
            },
        };
        let fields = vec![field(name, values.0, association(of))];
        Self::of(py, "grid", Geometry::Lattice(lattice), fields, options)
    }

    /// Makes a drawable of a rectilinear lattice from the coordinates along its axes.
    #[staticmethod]
    #[pyo3(signature = (coordinates, name, values, of, options=None))]
    fn rectilinear(
        py: Python<'_>,
        coordinates: [Vec<f64>; 3],
        name: &str,
        values: Numbers,
        of: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let lattice = Lattice {
            dims: coordinates.each_ref().map(Vec::len),
            spacing: LatticeSpacing::Rectilinear { coordinates },
        };
        let fields = vec![field(name, values.0, association(of))];
        Self::of(py, "grid", Geometry::Lattice(lattice), fields, options)
    }

    /// Makes a drawable of a curvilinear grid, nodes along i fastest.
    #[staticmethod]
    #[pyo3(signature = (dims, points, name, values, of, options=None))]
    fn structured(
        py: Python<'_>,
        dims: [usize; 3],
        points: Points,
        name: &str,
        values: Numbers,
        of: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let blocks = vec![CurvilinearBlock {
            dims,
            nodes: points.0,
        }];
        let fields = vec![field(name, values.0, association(of))];
        let geometry = Geometry::Curvilinear { blocks };
        Self::of(py, "structured grid", geometry, fields, options)
    }

    /// Makes a drawable of an unstructured grid in VTK's lists.
    #[staticmethod]
    #[pyo3(signature = (points, cells, kinds, name, values, of, options=None))]
    #[expect(clippy::too_many_arguments, reason = "the package's own call")]
    fn cells(
        py: Python<'_>,
        points: Points,
        cells: PyReadonlyArray1<'_, i64>,
        kinds: PyReadonlyArray1<'_, u8>,
        name: &str,
        values: Numbers,
        of: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let (cells, kinds) = (cells.as_slice()?, kinds.as_slice()?);
        let mesh = CellMesh::of_lists(points.0, kinds, cells);
        let mesh = mesh.map_err(|error| exception(&error))?;
        let fields = vec![field(name, values.0, association(of))];
        Self::of(py, "cells", Geometry::Cells(mesh), fields, options)
    }

    /// Makes a drawable of triangles with vertex colours, a texture, or values.
    #[staticmethod]
    #[pyo3(signature = (vertices, faces, colours=None, uv=None, texture=None, values=None, of="nodes", options=None))]
    #[expect(clippy::too_many_arguments, reason = "the package's own call")]
    fn mesh(
        py: Python<'_>,
        vertices: Points,
        faces: PyReadonlyArray2<'_, u32>,
        colours: Option<PyReadonlyArray2<'_, f32>>,
        uv: Option<PyReadonlyArray2<'_, f64>>,
        texture: Option<(usize, usize, PyReadonlyArray1<'_, u8>)>,
        values: Option<(String, Numbers)>,
        of: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let mut mesh = Mesh::of_triangles(vertices.0, indices(&faces)?);
        if let Some(colours) = &colours {
            mesh = mesh.with_colours(quadruples(colours)?);
        }
        if let (Some(uv), Some((width, height, bytes))) = (&uv, &texture) {
            let (pixels, _) = bytes.as_slice()?.as_chunks::<4>();
            let image = TextureImage {
                width: *width,
                height: *height,
                pixels: pixels.to_vec(),
            };
            mesh = mesh.with_texture(pairs(uv)?, image);
        }
        let fields = values.map(|(name, values)| field(&name, values.0, association(of)));
        let fields = fields.into_iter().collect();
        Self::of(py, "mesh", Geometry::Mesh(mesh), fields, options)
    }

    /// Makes a drawable of surfels: points with normals and radii.
    #[staticmethod]
    fn surfels(
        py: Python<'_>,
        positions: Points,
        normals: Points,
        radii: PyReadonlyArray1<'_, f64>,
        colours: Option<PyReadonlyArray2<'_, f32>>,
        up: Option<[f64; 3]>,
    ) -> PyResult<Self> {
        let radii = radii.as_slice()?;
        let colours = colours.as_ref().map(triples).transpose()?;
        let colours = colours.unwrap_or_default();
        let sampled = detached(py, || discs(positions.0, &normals.0, radii, &colours));
        let sampled = sampled.map_err(|error| exception(&error))?;
        let data = Data::Surfels(Arc::new(sampled));
        Ok(Self {
            sources: vec![Source::new(data, SampleOptions::default())],
            up: up.map(DVec3::from),
        })
    }

    /// Makes a drawable of splats of a radiance field: `scales` (n, 3), `rotations` (n, 4) w, x, y,
    /// z, `harmonics` with all coefficients of one splat after those of another.
    #[staticmethod]
    #[pyo3(signature = (positions, scales, rotations, opacities, degree, harmonics, options=None))]
    #[expect(clippy::too_many_arguments, reason = "the package's own call")]
    fn splats(
        py: Python<'_>,
        positions: Points,
        scales: PyReadonlyArray2<'_, f32>,
        rotations: PyReadonlyArray2<'_, f32>,
        opacities: Floats,
        degree: u8,
        harmonics: Floats,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let cloud = SplatCloud {
            positions: positions.0,
            scales: triples(&scales)?,
            rotations: quadruples(&rotations)?,
            opacities: opacities.0,
            harmonics_degree: degree,
            harmonics: harmonics.0,
            rule: SplatRule::Exact,
            is_linear: false,
            ..SplatCloud::default()
        };
        Self::of(py, "splats", Geometry::Splats(cloud), Vec::new(), options)
    }

    /// Opens a file as a drawable: all parts of its first time step, or of another. From a
    /// snapshot, it takes the particles of each type that is named.
    #[staticmethod]
    #[pyo3(signature = (path, options=None, how=None))]
    fn open(
        py: Python<'_>,
        path: PathBuf,
        options: Option<&Bound<'_, PyDict>>,
        how: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let said = sample_options(options)?;
        let (how, types, step) = open_options(how)?;
        let sets = run(py, |_| {
            let format = format_of(&path, &how);
            // Errors of unreadable files are reported when they are read.
            let parts = match format {
                Ok(format) => {
                    let steps = format.time_steps(&path)?;
                    let chosen = step.unwrap_or(StepChoice::Number(0)).of(&path, &steps)?;
                    let parts = steps.into_iter().skip(chosen).take(1);
                    let parts = parts.flat_map(|step| step.parts);
                    parts.map(|part| (part.path, part.time_step)).collect()
                }
                Err(_) => vec![(path.clone(), None)],
            };
            let (mut sets, mut empty, mut nothing) = (Vec::new(), Vec::new(), None);
            for (path, time_step) in parts {
                let has_types = !types.is_empty() && has_particle_types(&path)?;
                let types = types.iter().copied().map(Some);
                let types: Vec<_> = if has_types {
                    types.collect()
                } else {
                    vec![None]
                };
                for particle_type in types {
                    let how = OpenOptions {
                        time_step,
                        particle_type: particle_type.or(how.particle_type),
                        ..how.clone()
                    };
                    match open(&path, &how) {
                        // Another part may hold something.
                        Err(error) if error.holds_nothing() => {
                            empty.push(path.display().to_string());
                            nothing.get_or_insert(error);
                        }
                        set => sets.push(set?),
                    }
                }
            }
            if let (true, Some(error)) = (sets.is_empty(), nothing) {
                return Err(error);
            }
            if let (false, Some(set)) = (empty.is_empty(), sets.first_mut()) {
                let names = empty.join(", ");
                set.notes.push(format!(
                    "parts that hold nothing to draw are left out: {names}"
                ));
            }
            Ok(sets)
        })?;
        of_sets(sets, &said)
    }

    /// Reads a drawable from the bytes of a file.
    #[staticmethod]
    #[pyo3(signature = (name, bytes, options=None, how=None))]
    fn read(
        py: Python<'_>,
        name: &str,
        bytes: &[u8],
        options: Option<&Bound<'_, PyDict>>,
        how: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let said = sample_options(options)?;
        let (mut how, types, step) = open_options(how)?;
        how.time_step = match step {
            None => None,
            Some(StepChoice::Number(number)) => Some(number),
            Some(_) => {
                let text = "time, time_step: expected a step's number from 0 for a file-like object, found another";
                return Err(PyValueError::new_err(text));
            }
        };
        how.particle_type = types.first().copied();
        if types.len() > 1 {
            let text = "particle_type: expected one type of a file-like object, found several";
            return Err(PyValueError::new_err(text));
        }
        let dataset = run(py, |_| read(name, bytes, &how))?;
        of_sets(vec![dataset], &said)
    }

    /// Joins drawables to one.
    #[staticmethod]
    fn together(things: Vec<Py<Self>>) -> Self {
        let sources = things.iter().flat_map(|thing| &thing.get().sources);
        let copy = |source: &Source| {
            let data = match &source.data {
                Data::Set(dataset) => Data::Set(Arc::clone(dataset)),
                Data::Surfels(ready) => Data::Surfels(Arc::clone(ready)),
            };
            Source::new(data, source.options.clone())
        };
        Self {
            sources: sources.map(copy).collect(),
            up: things.iter().find_map(|thing| thing.get().up),
        }
    }

    /// Returns the names of its fields.
    fn fields(&self) -> Vec<String> {
        let mut names = Vec::new();
        for source in &self.sources {
            if let Data::Set(dataset) = &source.data {
                for name in dataset.selectors() {
                    if !names.contains(&name) {
                        names.push(name);
                    }
                }
            }
        }
        names
    }

    /// Returns the name and the arguments of the call that makes the same object, but for its options.
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let unknown = || {
            let text = "pickle: expected particles, or one grid of scalar fields";
            PyTypeError::new_err(text)
        };
        let [source] = self.sources.as_slice() else {
            return Err(unknown());
        };
        let Data::Set(dataset) = &source.data else {
            return Err(unknown());
        };
        let mut columns = Vec::new();
        for field in &dataset.fields {
            let FieldSource::Scalar(values) = &field.source else {
                return Err(unknown());
            };
            columns.push((field.name.as_str(), array(py, values), field.association));
        }
        let rows = |points: &[DVec3]| {
            let numbers: Vec<f64> = points.iter().flat_map(|p| p.to_array()).collect();
            numbers.into_pyarray(py).reshape([points.len(), 3])
        };
        let of = |association| match association {
            Association::Cells => "cells",
            Association::Nodes => "nodes",
        };
        match (&dataset.geometry, columns.as_slice()) {
            (Geometry::Points { positions }, _) => {
                let columns = columns.iter().map(|(name, values, _)| (*name, values));
                let columns: Vec<_> = columns.collect();
                ("points", rows(positions)?, columns).into_pyobject(py)
            }
            (Geometry::Lattice(lattice), [(name, values, association)]) => match &lattice.spacing {
                LatticeSpacing::Uniform { origin, step } => {
                    let steps = step.to_cols_array_2d();
                    let dims = lattice.dims;
                    let of = of(*association);
                    ("grid", dims, origin.to_array(), steps, *name, values, of).into_pyobject(py)
                }
                LatticeSpacing::Rectilinear { coordinates } => {
                    let axes = coordinates.clone();
                    ("rectilinear", axes, *name, values, of(*association)).into_pyobject(py)
                }
            },
            (Geometry::Curvilinear { blocks }, [(name, values, association)])
                if blocks.len() == 1 =>
            {
                let (dims, nodes) = (blocks[0].dims, rows(&blocks[0].nodes)?);
                ("structured", dims, nodes, *name, values, of(*association)).into_pyobject(py)
            }
            _ => Err(unknown()),
        }
    }

    /// Returns the same data with another field to show.
    fn showing(&self, field: &str) -> PyResult<Self> {
        let known = self.fields();
        if !known.iter().any(|name| name.eq_ignore_ascii_case(field)) {
            let names = known.join(", ");
            let text = format!("field: expected one of {names}, found {field}");
            return Err(PyValueError::new_err(text));
        }
        let sources = self.sources.iter().map(|source| {
            let data = match &source.data {
                Data::Set(dataset) => Data::Set(Arc::clone(dataset)),
                Data::Surfels(ready) => Data::Surfels(Arc::clone(ready)),
            };
            let options = SampleOptions {
                field: Some(field.into()),
                ..source.options.clone()
            };
            Source::new(data, options)
        });
        Ok(Self {
            sources: sources.collect(),
            up: self.up,
        })
    }

    /// Returns the notes of its data sets.
    fn notes(&self) -> Vec<String> {
        let notes = self.sources.iter().filter_map(|source| match &source.data {
            Data::Set(dataset) => Some(dataset.notes.clone()),
            Data::Surfels(_) => None,
        });
        notes.flatten().collect()
    }

    /// Returns the least and the greatest coordinates.
    fn bounds(&self, py: Python<'_>) -> Option<([f64; 3], [f64; 3])> {
        let ends = detached(py, || {
            let all = self.sources.iter().filter_map(Source::corners);
            all.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
        });
        ends.map(|(low, high)| (low.to_array(), high.to_array()))
    }

    /// Describes its sampling: samples, particles, field, unit, and notes.
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let reports = run(py, |task| {
            let all = self.sources.iter().map(|source| source.report(task));
            all.collect::<Result<Vec<_>>>()
        })?;
        let dict = PyDict::new(py);
        let count = |of: fn(&SampleReport) -> usize| reports.iter().map(of).sum::<usize>();
        dict.set_item("samples", count(|r| r.sample_count))?;
        dict.set_item("particles", count(|r| r.particle_count))?;
        dict.set_item("left_out", count(SampleReport::left_out_count))?;
        let field = reports.iter().find_map(|r| r.field.clone());
        dict.set_item("field", field)?;
        let unit = reports.iter().find_map(|r| r.unit.clone());
        dict.set_item("unit", unit)?;
        let range = reports.iter().filter_map(|r| r.value_range);
        let range = range.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        dict.set_item("value_range", range)?;
        let lengths = reports.iter().find_map(|r| r.lengths.clone());
        dict.set_item("lengths", lengths)?;
        let findings: Vec<String> = reports.iter().flat_map(SampleReport::warnings).collect();
        dict.set_item("findings", findings)?;
        Ok(dict)
    }

    /// Writes it as a file of splats. Returns their number, the file's size in bytes, and the
    /// notes.
    ///
    /// - `width`: standard deviation of splats over their spacing.
    #[pyo3(signature = (path, width, lit, lights))]
    fn convert(
        &self,
        py: Python<'_>,
        path: PathBuf,
        width: Option<f64>,
        lit: Option<bool>,
        lights: Option<Vec<[f64; 6]>>,
    ) -> PyResult<(usize, u64, Vec<String>)> {
        let lighting = lighting(lit, lights.as_deref(), false)?;
        run(py, |task| {
            let up = Up::of_scene(self.ups()).direction;
            let mut volumes = Vec::new();
            for source in &self.sources {
                let options = SampleOptions {
                    task: Some(task.clone()),
                    ..source.options.clone()
                };
                let options = options.for_splats(width, lighting.is_some());
                volumes.extend(source.scene(&options)?.volumes);
            }
            if let Some(lighting) = &lighting
                && !bake_light(&mut volumes, lighting, up)?
            {
                return Err(nothing_lit("lit"));
            }
            let (cloud, report) = splat_cloud(&volumes)?;
            let options = SplatFileOptions {
                up: Some(up),
                ..SplatFileOptions::default()
            };
            let written = write_splats(&path, &cloud, &options)?;
            let bytes = written.bytes as u64;
            Ok((report.splat_count, bytes, written.notes))
        })
    }
}

/// Makes a drawable of data sets. A field that one data set lacks may be in another.
fn of_sets(mut sets: Vec<Dataset>, said: &Said) -> PyResult<Drawable> {
    for set in &mut sets {
        said.set_units(set);
    }
    let Said {
        options,
        up,
        around,
        ..
    } = said;
    let lacks = |set: &Dataset| {
        let field = options.field.as_deref()?;
        let has_none = matches!(set.geometry, Geometry::Mesh(_)) && set.fields.is_empty();
        set.scalar(field).err().filter(|_| !has_none)
    };
    let lacking: Vec<_> = sets.iter().map(lacks).collect();
    let all_lack = lacking.iter().all(Option::is_some);
    if let Some(error) = lacking.iter().flatten().next().filter(|_| all_lack) {
        return Err(exception(error));
    }
    let is_lacking: Vec<bool> = lacking.iter().map(Option::is_some).collect();
    // Beside grids, surfaces are drawn as they are: they have no volume within.
    if around.is_some() && sets.iter().all(is_surface) {
        return Err(without_volume());
    }
    let sources = sets.into_iter().zip(is_lacking).flat_map(|(set, lacks)| {
        let around = around.filter(|_| !is_surface(&set));
        let own = SampleOptions {
            field: options.field.clone().filter(|_| !lacks),
            ..options.clone()
        };
        sources_of(set, own, around)
    });
    Ok(Drawable {
        sources: sources.collect(),
        up: *up,
    })
}

/// Returns the error for the boundary of data that are surfaces themselves.
fn without_volume() -> PyErr {
    let text = "surface_opacity: expected a grid with a volume, found a surface; leave it out";
    PyValueError::new_err(text)
}

/// Makes the source of a data set, and that of its boundary if it is drawn around the volume.
///
/// - `around`: opacity of the boundary.
fn sources_of(
    dataset: Dataset,
    options: SampleOptions,
    around: Option<f64>,
) -> impl Iterator<Item = Source> {
    let dataset = Arc::new(dataset);
    let boundary = around.map(|opacity| {
        let options = SampleOptions {
            surface: Some(opacity),
            ..options.clone()
        };
        Source::new(Data::Set(Arc::clone(&dataset)), options)
    });
    std::iter::once(Source::new(Data::Set(dataset), options)).chain(boundary)
}
