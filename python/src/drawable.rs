//! Defines drawables: data sets in memory, or surfels that are ready.

use std::path::PathBuf;
use std::sync::Arc;

use ewa_splat::Result;
use ewa_splat::io::{
    Association, CellMesh, CurvilinearBlock, Field, FieldSource, Geometry, Mesh, SplatCloud,
    SplatFileOptions, StepChoice, TextureImage, Up, write_splats,
};
use ewa_splat::render::{bake_light, nothing_lit};
use ewa_splat::sample::{SampleOptions, SampleReport, discs, splat_cloud};
use ewa_splat::scene::{Lattice, LatticeSpacing, SplatRule, Values};
use ewa_splat::session::{self, Data, Opening, field};
use glam::{DMat3, DVec3};
use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arrays::{Floats, Numbers, Points, indices, pairs, quadruples, triples};
use crate::errors::exception;
use crate::settings::{lighting, open_options, sample_options};
use crate::task::{detached, run};

/// Drawable made of one object: a volume, a surface, or the parts of a collection.
#[pyclass(frozen, module = "ewa_splat._core")]
pub(crate) struct Drawable(pub(crate) Arc<session::Drawable>);

/// Makes an array of a field's values, in their type.
fn array<'py>(py: Python<'py>, values: &Values) -> Bound<'py, PyAny> {
    match values {
        Values::U8(values) => values.to_pyarray(py).into_any(),
        Values::I16(values) => values.to_pyarray(py).into_any(),
        Values::U16(values) => values.to_pyarray(py).into_any(),
        Values::F32(values) => values.to_pyarray(py).into_any(),
        Values::F64(values) => values.to_pyarray(py).into_any(),
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
        let sampling = sample_options(options)?;
        let of = || session::Drawable::of(what, geometry, fields, sampling);
        Self::made(detached(py, of))
    }

    fn made(drawable: Result<session::Drawable>) -> PyResult<Self> {
        match drawable {
            Ok(drawable) => Ok(Self(Arc::new(drawable))),
            Err(error) => Err(exception(&error)),
        }
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
        let drawable = session::Drawable::of_surfels(sampled, up.map(DVec3::from));
        Ok(Self(Arc::new(drawable)))
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
        let (said, how) = (sample_options(options)?, open_options(how)?);
        let drawable = run(py, |_| session::Drawable::open(&path, &how, &said))?;
        Ok(Self(Arc::new(drawable)))
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
        let Opening {
            options: mut how,
            types,
            step,
        } = open_options(how)?;
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
        let drawable = run(py, |_| session::Drawable::read(name, bytes, &how, &said))?;
        Ok(Self(Arc::new(drawable)))
    }

    /// Joins drawables to one.
    #[staticmethod]
    fn together(things: Vec<Py<Self>>) -> Self {
        let things = things.iter().map(|thing| &*thing.get().0);
        Self(Arc::new(session::Drawable::together(things)))
    }

    /// Returns the names of its fields.
    fn fields(&self) -> Vec<String> {
        self.0.fields()
    }

    /// Returns the name and the arguments of the call that makes the same object, but for its options.
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let unknown = || {
            let text = "pickle: expected particles, or one grid of scalar fields";
            PyTypeError::new_err(text)
        };
        let [source] = self.0.sources.as_slice() else {
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
        Self::made(self.0.showing(field))
    }

    /// Returns the notes of its data sets.
    fn notes(&self) -> Vec<String> {
        self.0.notes()
    }

    /// Returns the least and the greatest coordinates.
    fn bounds(&self, py: Python<'_>) -> Option<([f64; 3], [f64; 3])> {
        let ends = detached(py, || self.0.bounds());
        ends.map(|(low, high)| (low.to_array(), high.to_array()))
    }

    /// Describes its sampling: samples, particles, field, unit, and notes.
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let reports = run(py, |task| self.0.reports(task))?;
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
        let lighting = lighting(lit, lights.as_deref())?;
        run(py, |task| {
            let up = Up::of_scene(self.0.ups()).direction;
            let mut volumes = Vec::new();
            for source in &self.0.sources {
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
