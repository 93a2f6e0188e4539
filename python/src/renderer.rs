//! Holds scenes and draws them.

use std::sync::Arc;

use ewa_splat::command::{Prepared, stats};
use ewa_splat::measure::{About, ErrorSample, ReferenceSummary, Subject, SweepOptions, sweep};
use ewa_splat::reference::{DataIntegrator, Integrator, ReferenceFrame, ReferenceSettings};
use ewa_splat::sample::PeriodicBox;
use ewa_splat::scene::TransferFunction;
use ewa_splat::session::{
    ColumnRequest, Data, DrawnColumn, PictureRequest, Purpose, Ready, Sampled, Session, State,
    camera, check_size,
};
use ewa_splat::view::{Bounds, Camera, DEFAULT_FOV_DEG, Lens, left_of};
use ewa_splat::{Backend, Error, Result, Settings};
use numpy::{IntoPyArray, PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::Numbers;
use crate::camera::View;
use crate::deep::Deep;
use crate::drawable::Drawable;
use crate::settings::{drawing, transfer};
use crate::task::run;

/// Data in memory with the scene made of them. It draws one picture at a time.
#[pyclass(frozen, module = "ewa_splat._core")]
pub(crate) struct Renderer {
    session: Session,
}

/// Checks the size of a picture.
fn checked(size: [usize; 2]) -> PyResult<()> {
    check_size(size).map_err(PyValueError::new_err)
}

impl Renderer {
    /// Prepares a scene for a picture, and passes it on with the camera and settings.
    fn with_picture<T: Send>(
        &self,
        py: Python<'_>,
        request: PictureRequest<'_>,
        indices: bool,
        of: impl FnOnce(&mut Ready, Camera, Settings) -> Result<T> + Send,
    ) -> PyResult<T> {
        checked(request.size)?;
        run(py, |task| {
            self.session.with_picture(request, indices, task, of)
        })
    }
}

#[pymethods]
impl Renderer {
    #[new]
    #[pyo3(signature = (things, backend, keep_shapes))]
    fn new(things: Vec<Py<Drawable>>, backend: &str, keep_shapes: bool) -> PyResult<Self> {
        let backend = match backend {
            "auto" => Backend::Auto,
            "gpu" => Backend::Gpu,
            "cpu" => Backend::Cpu,
            other => {
                let text = format!("backend: expected auto, gpu or cpu, found {other}");
                return Err(PyValueError::new_err(text));
            }
        };
        if things.is_empty() {
            let text = "things: expected something to draw, found none";
            return Err(PyValueError::new_err(text));
        }
        let things = things.iter().map(|thing| Arc::clone(&thing.get().0));
        Ok(Self {
            session: Session::new(things.collect(), backend, keep_shapes),
        })
    }

    /// Draws a picture. Returns its pixels, depths and normals as arrays, the camera, the
    /// statistics and the measured error as JSON.
    #[pyo3(signature = (view, size, said))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        view: Option<View>,
        size: [usize; 2],
        said: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        checked(size)?;
        let (drawing, is_measured) = drawing(said)?;
        let view = view.map(View::view);
        let request = PictureRequest {
            view: view.as_ref(),
            size,
            drawing: &drawing,
        };
        let (drawn, (stats, error)) = run(py, |task| {
            self.session
                .render(request, task, |ready, image, camera, settings| {
                    let renderer = &mut ready.renderer;
                    let prepared = Prepared {
                        begun: ready.begun,
                        read_ms: ready.read_ms,
                        prepare_ms: ready.prepare_ms,
                        refined: (0, 0),
                    };
                    let times = [renderer.times()];
                    let stats = stats(renderer, &times, prepared).to_string();
                    if !is_measured {
                        return Ok((stats, None));
                    }
                    let thickness = renderer.layers().map(|layers| layers.thickness);
                    let composite = match thickness {
                        Some(_) => settings.composite.with_thickness(thickness),
                        None => settings.composite,
                    };
                    let settings = Settings {
                        composite,
                        ..settings
                    };
                    let sample = ErrorSample::draw(renderer, camera, &settings)?;
                    let error = serde_json::json!(sample.error_of(image)).to_string();
                    Ok((stats, Some(error)))
                })
        })?;
        let dict = PyDict::new(py);
        let [width, height] = size;
        let pixels = drawn.image.pixels.into_flattened().into_pyarray(py);
        dict.set_item("pixels", pixels.reshape([height, width, 4])?)?;
        let depth = drawn
            .depth
            .map(|depth| depth.into_pyarray(py).reshape([height, width]));
        dict.set_item("depth", depth.transpose()?)?;
        let normals = drawn.normals.map(|normals| {
            let flat: Bound<'_, PyArray1<f32>> = normals.into_flattened().into_pyarray(py);
            flat.reshape([height, width, 3])
        });
        dict.set_item("normals", normals.transpose()?)?;
        dict.set_item("camera", described(py, &drawn.camera)?)?;
        dict.set_item("stats", stats)?;
        dict.set_item("error", error)?;
        Ok(dict)
    }

    /// Draws a column density, or the mean of a field along each ray. Returns the values, the area of a pixel, the camera,
    /// the quantity that is summed, and its name and unit.
    ///
    /// - `of`: what is summed, or weighs the mean; "mass" or a field.
    /// - `mean`: the field whose mean is drawn.
    /// - `slice`: coordinate along the camera's axis of the plane that is drawn instead of columns.
    #[pyo3(signature = (view, size, said, of, mean, slice))]
    #[expect(clippy::too_many_arguments, reason = "the package's own call")]
    fn column_density<'py>(
        &self,
        py: Python<'py>,
        view: Option<View>,
        size: [usize; 2],
        said: Option<&Bound<'py, PyDict>>,
        of: Option<String>,
        mean: Option<String>,
        slice: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        checked(size)?;
        let (drawing, _) = drawing(said)?;
        let view = view.map(View::view);
        let request = ColumnRequest {
            view: view.as_ref(),
            size,
            drawing: &drawing,
            of: of.as_deref(),
            mean: mean.as_deref(),
            slice,
        };
        let DrawnColumn {
            column,
            camera,
            amplitudes,
            title: (name, unit),
        } = run(py, |task| self.session.columns(request, task))?;
        let dict = PyDict::new(py);
        let [width, height] = size;
        let values = column.values.into_pyarray(py).reshape([height, width])?;
        dict.set_item("values", values)?;
        dict.set_item("pixel_area", column.pixel_area)?;
        dict.set_item("camera", described(py, &camera)?)?;
        dict.set_item("amplitude_sum", amplitudes.sum)?;
        dict.set_item("not_finite", amplitudes.not_finite)?;
        dict.set_item("field", name)?;
        dict.set_item("unit", unit)?;
        Ok(dict)
    }

    /// Draws a deep image. Returns it with its camera.
    #[pyo3(signature = (view, size, said))]
    fn render_deep<'py>(
        &self,
        py: Python<'py>,
        view: Option<View>,
        size: [usize; 2],
        said: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Deep, Bound<'py, PyDict>)> {
        checked(size)?;
        let (drawing, _) = drawing(said)?;
        let view = view.map(View::view);
        let request = PictureRequest {
            view: view.as_ref(),
            size,
            drawing: &drawing,
        };
        let (deep, camera) = self.with_picture(py, request, false, |ready, camera, settings| {
            let deep = ready.renderer.render_deep(&camera, &settings)?;
            Ok((deep, camera))
        })?;
        Ok((Deep(deep), described(py, &camera)?))
    }

    /// Integrates the reference image, of kernels or of data, in f64, and rounds it.
    #[pyo3(signature = (of, view, size, error, said))]
    fn reference<'py>(
        &self,
        py: Python<'py>,
        of: &str,
        view: Option<View>,
        size: [usize; 2],
        error: f64,
        said: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        checked(size)?;
        let of_data = match of {
            "kernels" => false,
            "data" => true,
            other => {
                let text = format!("of: expected kernels or data, found {other}");
                return Err(PyValueError::new_err(text));
            }
        };
        let (drawing, _) = drawing(said)?;
        let view = view.map(View::view);
        let (frame, camera) = run(py, |task| {
            let mut state = self.session.lock(task)?;
            if drawing.transfer.is_some() {
                state.set_transfer(drawing.transfer.clone())?;
            }
            let mut settings = drawing.settings.clone();
            settings
                .clip
                .extend(state.periodic()?.iter().flat_map(PeriodicBox::planes));
            let settings = &settings;
            let purpose = Purpose {
                normals: false,
                ..state.purpose(&drawing)
            };
            let lens = Lens::FovDeg(DEFAULT_FOV_DEG);
            let up = state.up(view.as_ref());
            let of_boxes = |boxes: &[Bounds]| camera(view.as_ref(), up, boxes, lens, size, 0);
            let (boxes, suitable) = {
                let ready = state.prepare(purpose.clone(), &of_boxes, &settings.clip, task)?;
                let renderer = &ready.renderer;
                (renderer.fitted_boxes(), renderer.suitable_low_pass_px2())
            };
            let boxes = left_of(boxes, &settings.clip);
            let camera = camera(view.as_ref(), up, &boxes, lens, size, 0);
            let low_pass = match drawing.has_low_pass {
                true => settings.low_pass_variance_px2,
                false => suitable,
            };
            let backdrop = drawing.backdrop.seen_by(&camera)?;
            let colours = backdrop.as_ref().and_then(|backdrop| backdrop.colours());
            let reference = ReferenceSettings {
                error,
                low_pass_variance_px2: low_pass.into(),
                // Colours of a backdrop stand in front of it.
                background: settings.background.filter(|_| colours.is_none()),
                task: Some(task.clone()),
                ..ReferenceSettings::default()
            };
            let settings = &Settings {
                backdrop: backdrop.clone(),
                ..settings.clone()
            };
            let sampled = state.sample(&purpose, &of_boxes, &settings.clip, task)?;
            let mut frame = match of_data {
                false => Integrator::classified(&sampled.volumes, settings.classify)?
                    .clipped(&settings.clip)
                    .ended(backdrop.as_ref().map(|backdrop| backdrop.depth()))
                    .render(&camera, &reference)?,
                true => of_field(&state, &sampled, settings, &camera, &reference)?,
            };
            if let Some(backdrop) = &backdrop {
                backdrop.lay_under(&mut frame.image, settings.background);
            }
            Ok((frame, camera))
        })?;
        let dict = PyDict::new(py);
        let [width, height] = size;
        let pixels = frame.image.pixels.into_flattened().into_pyarray(py);
        dict.set_item("pixels", pixels.reshape([height, width, 4])?)?;
        dict.set_item("camera", described(py, &camera)?)?;
        dict.set_item("error_estimate", frame.error)?;
        dict.set_item("unconverged", frame.unconverged)?;
        dict.set_item("rays", frame.rays)?;
        Ok(dict)
    }

    /// Returns the particles that a pixel shows, each with its drawable, number, value, position,
    /// depth and share.
    #[expect(clippy::type_complexity, reason = "the package names its parts")]
    fn pick(
        &self,
        py: Python<'_>,
        pixel: [usize; 2],
        view: Option<View>,
        size: [usize; 2],
        said: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Vec<(usize, usize, Option<f64>, [f64; 3], f64, f32)>> {
        let (drawing, _) = drawing(said)?;
        let view = view.map(View::view);
        let request = PictureRequest {
            view: view.as_ref(),
            size,
            drawing: &drawing,
        };
        self.with_picture(py, request, true, |ready, camera, settings| {
            let picked = ready.renderer.pick(&camera, &settings, pixel)?;
            let thing = |volume: usize| {
                let firsts = ready.firsts.iter();
                firsts.filter(|(first, _)| *first <= volume).count() - 1
            };
            let value = |volume: usize, position: f32| match &ready.functions[volume] {
                Some(function) => function.value_scale().value(position),
                None => f64::from(position),
            };
            let found = picked.iter().map(|p| {
                let place = p.position.to_array();
                let value = p.value.map(|v| value(p.volume, v));
                (thing(p.volume), p.particle, value, place, p.depth, p.share)
            });
            Ok(found.collect())
        })
    }

    /// Measures speed against accuracy, and returns the report as JSON.
    fn measure(
        &self,
        py: Python<'_>,
        view: Option<View>,
        size: [usize; 2],
        frames: usize,
        error: f64,
    ) -> PyResult<String> {
        let (drawing, _) = drawing(None)?;
        let view = view.map(View::view);
        let request = PictureRequest {
            view: view.as_ref(),
            size,
            drawing: &drawing,
        };
        let volumes = run(py, |task| {
            let state = self.session.lock(task)?;
            let lens = Lens::FovDeg(DEFAULT_FOV_DEG);
            let up = state.up(view.as_ref());
            let of_boxes = |boxes: &[Bounds]| camera(view.as_ref(), up, boxes, lens, size, 0);
            Ok(state
                .sample(&state.purpose(&drawing), &of_boxes, &[], task)?
                .volumes)
        })?;
        self.with_picture(py, request, false, |ready, camera, settings| {
            let reference = ReferenceSettings {
                error,
                low_pass_variance_px2: settings.low_pass_variance_px2.into(),
                task: settings.task.clone(),
                ..ReferenceSettings::default()
            };
            let frame = Integrator::new(&volumes)?.render(&camera, &reference)?;
            let mut subject = Subject {
                renderer: &mut ready.renderer,
                camera: &camera,
                reference: &frame.image,
                reference_kernels: None,
                reference_data: None,
                resampling: None,
            };
            let about = About {
                command: "ewa_splat.measure".into(),
                reference: ReferenceSummary {
                    origin: "integrated".into(),
                    error: Some(frame.error),
                    unconverged: Some(frame.unconverged),
                    rays: Some(frame.rays),
                    seconds: None,
                },
                ..About::default()
            };
            let options = SweepOptions {
                frames,
                base: Settings {
                    lighting: None,
                    ..settings
                },
            };
            let report = sweep(&mut subject, about, &options, &mut |_| {})?;
            Ok(String::from_utf8_lossy(&report.json()?).into_owned())
        })
    }

    /// Replaces the values of a drawable by as many others.
    fn set_values(&self, py: Python<'_>, thing: usize, values: Numbers) -> PyResult<()> {
        run(py, |task| self.session.set_values(thing, values.0, task))
    }

    /// Sets a transfer function for all data.
    fn set_transfer_function(&self, py: Python<'_>, said: &Bound<'_, PyDict>) -> PyResult<()> {
        let choice = transfer(said)?;
        run(py, |task| self.session.lock(task)?.set_transfer(choice))
    }

    /// Returns the current transfer functions as JSON; `None` for drawables without one.
    fn transfer_functions(&self, py: Python<'_>) -> PyResult<Vec<Option<String>>> {
        let (drawing, _) = drawing(None)?;
        let request = PictureRequest {
            view: None,
            size: [64, 64],
            drawing: &drawing,
        };
        self.with_picture(py, request, false, |ready, _, _| {
            let functions = ready.functions.iter();
            Ok(functions
                .map(|f| f.as_ref().map(TransferFunction::to_json))
                .collect())
        })
    }

    /// Returns the adapter that draws, or `None` for the CPU.
    fn adapter(&self, py: Python<'_>) -> PyResult<Option<String>> {
        run(py, |task| self.session.adapter(task))
    }
}

/// Integrates the reference image of the one grid's own field.
fn of_field(
    state: &State,
    sampled: &Sampled,
    settings: &Settings,
    camera: &Camera,
    reference: &ReferenceSettings,
) -> Result<ReferenceFrame> {
    let refuse = |expected: &str, found: &str| {
        let advice = "integrate the kernels";
        Err(Error::invalid("reference", "data", expected, found, advice))
    };
    let mut sources = state.sources();
    let (Some((_, source)), None) = (sources.next(), sources.next()) else {
        return refuse("one grid", "several things");
    };
    let Data::Set(dataset) = &source.data else {
        return refuse("one grid", "surfels");
    };
    let ([volume], [Some(field)]) = (sampled.volumes.as_slice(), sampled.fields.as_slice()) else {
        return refuse("a grid with a field", "one without, or a surface");
    };
    let Some(function) = volume.transfer_function.clone() else {
        return refuse("a field under a transfer function", "colours of its own");
    };
    let backdrop = settings.backdrop.as_ref();
    DataIntegrator::new((**dataset).clone(), field, function)?
        .clipped(&settings.clip)
        .ended(backdrop.map(|backdrop| backdrop.depth()))
        .render(camera, reference)
}

/// Describes a camera as the package does.
fn described<'py>(py: Python<'py>, camera: &Camera) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let rows = camera.camera_from_world.transpose().to_cols_array_2d();
    dict.set_item("eye", camera.eye.to_array())?;
    dict.set_item("rotation", rows)?;
    dict.set_item("focal_px", camera.focal_px.to_array())?;
    dict.set_item("centre_px", camera.centre_px.to_array())?;
    dict.set_item("size", [camera.width, camera.height])?;
    let flat = camera.projection == ewa_splat::view::Projection::Orthographic;
    dict.set_item("orthographic", flat)?;
    Ok(dict)
}
