//! Holds scenes and draws them.

use std::borrow::Cow;
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use ewa_splat::command::{Prepared, left_of, stats};
use ewa_splat::io::{Dataset, Geometry, SphKernel, Up};
use ewa_splat::legend::{ColourBar, check_legend_size, draw_legend, legend_width, title_of};
use ewa_splat::load::{SurfelDemand, prefer, sample_together};
use ewa_splat::measure::{About, ErrorSample, ReferenceSummary, Subject, SweepOptions, sweep};
use ewa_splat::reference::{DataIntegrator, Integrator, ReferenceFrame, ReferenceSettings};
use ewa_splat::render::ColumnMeans;
use ewa_splat::sample::mesh::Spread;
use ewa_splat::sample::{
    BoundaryChoice, FunctionOptions, KernelOptions, MeanPart, PeriodicBox, PurposeOptions,
    SampleOptions, TransferChoice, as_surface, common_smoothing, field_choices, is_surface,
};
use ewa_splat::scene::{PointVolume, TransferDefaults, TransferFunction, Values};
use ewa_splat::view::{Along, Bounds, Camera, ClipPlane, DEFAULT_FOV_DEG, Lens};
use ewa_splat::{Backend, ColumnSettings, Error, Image, Result, SceneOptions, Settings, Task};
use numpy::{IntoPyArray, PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::Numbers;
use crate::camera::View;
use crate::drawable::{Data, Drawable, Source};
use crate::forked::usable;
use crate::settings::{Drawing, Keywords, drawing, transfer};
use crate::task::run;

/// Ratio of wanted to existing surfels of a mesh above which it is sampled again.
const DENSER: f64 = 1.5;

/// Data in memory with the scene made of them. It draws one picture at a time.
#[pyclass(frozen, module = "ewa_splat._core")]
pub(crate) struct Renderer {
    state: Mutex<State>,
    /// Process that locked the state last. A forked process inherits its parent's locks.
    process: AtomicU32,
}

struct State {
    things: Vec<Py<Drawable>>,
    backend: Backend,
    /// Last transfer function given for all data.
    transfer: Option<TransferChoice>,
    keep_shapes: bool,
    ready: Option<Ready>,
}

/// Purpose that a scene is sampled for.
#[derive(Clone, PartialEq)]
struct Purpose {
    for_columns: bool,
    mean: MeanPart,
    normals: bool,
    models: bool,
    detail: bool,
    indices: bool,
    shapes: bool,
    transfer: Option<TransferChoice>,
    /// The quantity that columns sum; `None` for pictures.
    summed: Option<Summed>,
}

/// A quantity that columns sum.
#[derive(Clone, PartialEq)]
enum Summed {
    /// Mass where it is known, else the field that is shown.
    Known,
    /// Mass.
    Mass,
    /// A field, as a density.
    Field(String),
}

impl Summed {
    fn of(text: Option<String>) -> Self {
        match text.as_deref() {
            None => Self::Known,
            Some("mass") => Self::Mass,
            Some(field) => Self::Field(field.into()),
        }
    }

    /// Returns the field of a source that makes columns sum this.
    fn field(&self, source: &Source, mean: MeanPart) -> Result<Option<String>> {
        match (self, source.masses()) {
            (Self::Field(name), _) => Ok(Some(name.clone())),
            // Masses that columns sum by themselves are a field by the name of their column.
            (Self::Mass, Some(None)) if mean == MeanPart::Field => Ok(Some("mass".into())),
            (_, Some(masses)) => Ok(masses),
            (Self::Known, None) => Ok(source.options.field.clone()),
            (Self::Mass, None) => Err(Error::invalid(
                "of",
                "columns of mass",
                "particles with masses",
                "data without",
                "give masses, or name a field",
            )),
        }
    }
}

/// Scene ready to be drawn.
struct Ready {
    purpose: Purpose,
    /// Process that made the scene.
    process: u32,
    renderer: ewa_splat::Renderer,
    /// True if a device has been chosen.
    is_open: bool,
    bars: Vec<ColourBar>,
    functions: Vec<Option<TransferFunction>>,
    /// For each drawable, the number of its first volume, and whether each of its samples is a
    /// particle.
    firsts: Vec<(usize, bool)>,
    /// Largest number of surfels of each surface by the pixels of a picture, if the surface states
    /// no number.
    counts: Vec<Option<usize>>,
    /// SPH kernel that columns draw.
    smoothing: Option<SphKernel>,
    /// Name and unit of the field.
    title: (Option<String>, Option<String>),
    prepared: Prepared,
}

/// Sampled volumes with their titles, fields and numbers of surfels.
struct Sampled {
    volumes: Vec<PointVolume>,
    smoothing: Option<SphKernel>,
    titles: Vec<Option<String>>,
    /// Unit of each field.
    units: Vec<Option<String>>,
    fields: Vec<Option<String>>,
    firsts: Vec<(usize, bool)>,
    counts: Vec<Option<usize>>,
}

/// Picture with its depths, normals, camera and statistics.
struct Drawn {
    image: Image,
    depth: Option<Vec<f32>>,
    normals: Option<Vec<[f32; 3]>>,
    camera: Camera,
    stats: String,
    error: Option<String>,
}

impl Sampled {
    /// Returns the name and the unit of the field, if all volumes show the same.
    fn title(&self) -> (Option<String>, Option<String>) {
        let common = |all: &[Option<String>]| {
            let first = all.first().cloned().flatten();
            first.filter(|_| all.windows(2).all(|pair| pair[0] == pair[1]))
        };
        (common(&self.fields), common(&self.units))
    }
}

impl State {
    /// Forgets a scene on a device that another process opened. Freeing it would call its driver.
    fn leave_device(&mut self) {
        let is_of_another = |ready: &mut Ready| {
            ready.process != process::id() && ready.renderer.adapter().is_some()
        };
        if let Some(ready) = self.ready.take_if(is_of_another) {
            std::mem::forget(ready);
        }
    }

    /// Returns all sources, each with the number of its drawable.
    fn sources(&self) -> impl Iterator<Item = (usize, &Source)> {
        let things = self.things.iter().enumerate();
        things.flat_map(|(i, thing)| thing.get().sources.iter().map(move |source| (i, source)))
    }

    fn up(&self, view: Option<&View>) -> Up {
        let up = Up::of_scene(self.things.iter().flat_map(|thing| thing.get().ups()));
        match view.and_then(View::up) {
            Some(direction) => Up { direction, ..up },
            None => up,
        }
    }

    /// Returns how surfels are spread over each surface that states no number, and the largest
    /// number of each. The pixels of a camera determine both; all meshes together get no more
    /// surfels than one would.
    fn spreads(
        &self,
        purpose: &Purpose,
        camera: &dyn Fn(&[Bounds]) -> Camera,
        clip: &[ClipPlane],
    ) -> Result<Vec<Option<(Spread, usize)>>> {
        let is_open = |source: &Source| source.options.kernels.spread == Spread::Automatic;
        let surfaces = self.sources().map(|(_, source)| {
            let surface = source.surface(purpose.for_columns)?;
            Ok(surface.filter(|_| is_open(source)))
        });
        let surfaces: Vec<Option<Cow<'_, Dataset>>> = surfaces.collect::<Result<_>>()?;
        if surfaces.iter().all(Option::is_none) {
            return Ok(vec![None; surfaces.len()]);
        }
        let corners = self.sources().filter_map(|(_, source)| source.corners());
        let boxes = corners.map(|(a, b)| ((a + b) / 2.0, (b - a) / 2.0));
        let cameras = [camera(&left_of(boxes.collect(), clip))];
        let demands: Vec<Option<SurfelDemand>> = surfaces
            .iter()
            .map(|surface| match &surface.as_ref()?.geometry {
                Geometry::Mesh(mesh) => Some(SurfelDemand::of(mesh, &cameras)),
                _ => None,
            })
            .collect();
        Ok(SurfelDemand::share(&demands))
    }

    /// Samples all drawables. Those that show one field by an automatic transfer function share
    /// one.
    fn sample(
        &self,
        purpose: &Purpose,
        camera: &dyn Fn(&[Bounds]) -> Camera,
        clip: &[ClipPlane],
        task: &Task,
    ) -> Result<Sampled> {
        let count = self.sources().count();
        let spreads = self.spreads(purpose, camera, clip)?;
        let counts = spreads.iter().map(|own| own.map(|(_, count)| count));
        let counts: Vec<Option<usize>> = counts.collect();
        let mut options = Vec::new();
        for ((_, source), spread) in self.sources().zip(&spreads) {
            let own = source.options.clone();
            let own = SampleOptions {
                kernels: KernelOptions {
                    spread: spread.map_or(own.kernels.spread, |(spread, _)| spread),
                    ..own.kernels
                },
                function: FunctionOptions {
                    transfer: purpose.transfer.clone().unwrap_or(own.function.transfer),
                    ..own.function
                },
                field: match &purpose.summed {
                    None => own.field,
                    Some(summed) => summed.field(source, purpose.mean)?,
                },
                purpose: PurposeOptions {
                    for_columns: purpose.for_columns,
                    mean: purpose.mean,
                    normals: purpose.normals && own.flatten.is_none(),
                    local_models: purpose.models || own.flatten.is_some(),
                    keeps_value_sample: count > 1 && !purpose.for_columns,
                },
                task: Some(task.clone()),
                ..own
            };
            options.push(own);
        }
        let sources: Vec<&Source> = self.sources().map(|(_, source)| source).collect();
        if count > 1 {
            let choices = sources.iter().map(|source| match &source.data {
                Data::Set(dataset) => field_choices(dataset),
                Data::Surfels(_) => Vec::new(),
            });
            prefer(&mut options, choices.collect());
        }
        let scenes = sample_together(&options, |i, options| sources[i].scene(options))?;
        let mut sampled = Sampled {
            volumes: Vec::new(),
            smoothing: common_smoothing(scenes.iter().map(|scene| &scene.report)),
            titles: Vec::new(),
            units: Vec::new(),
            fields: Vec::new(),
            firsts: Vec::new(),
            counts,
        };
        for ((thing, _), scene) in self.sources().zip(scenes) {
            if thing == sampled.firsts.len() {
                let report = &scene.report;
                let is_whole = report.sample_count == report.particle_count;
                sampled.firsts.push((sampled.volumes.len(), is_whole));
            }
            sampled.volumes.extend(scene.volumes);
            let (field, unit) = (scene.report.field, scene.report.unit);
            let title = field.as_deref().map(|f| title_of(f, unit.as_deref()));
            sampled.titles.resize(sampled.volumes.len(), title);
            sampled.units.resize(sampled.volumes.len(), unit);
            sampled.fields.resize(sampled.volumes.len(), field);
        }
        Ok(sampled)
    }

    /// Returns the periodic box of all particles.
    ///
    /// # Errors
    /// Things with different boxes, or with and without one.
    fn periodic(&self) -> Result<Option<PeriodicBox>> {
        let mut boxes = self.sources().map(|(_, source)| source.options.periodic);
        let first = boxes.next().flatten();
        match boxes.all(|own| own == first) {
            true => Ok(first),
            false => Err(Error::invalid(
                "box",
                "things",
                "the same periodic box for all",
                "different ones",
                "give all the same",
            )),
        }
    }

    /// Prepares the scene, unless it is ready.
    fn prepare(
        &mut self,
        purpose: Purpose,
        camera: &dyn Fn(&[Bounds]) -> Camera,
        clip: &[ClipPlane],
        task: &Task,
    ) -> Result<&mut Ready> {
        let is_ready = self.ready.as_ref().is_some_and(|ready| {
            let serves = Purpose {
                detail: ready.purpose.detail || purpose.detail,
                indices: ready.purpose.indices || purpose.indices,
                shapes: ready.purpose.shapes || purpose.shapes,
                ..purpose.clone()
            };
            let denser = || {
                let wanted = self.spreads(&purpose, camera, clip).unwrap_or_default();
                let mut pairs = ready.counts.iter().zip(wanted);
                pairs.any(|(own, wanted)| {
                    own.zip(wanted)
                        .is_some_and(|(own, (_, wanted))| wanted as f64 > DENSER * own as f64)
                })
            };
            ready.purpose == serves && !denser()
        });
        if !is_ready {
            // The old scene is freed before the new one is made.
            self.ready = None;
            self.ready = Some(self.made(purpose, camera, clip, task)?);
        }
        match &mut self.ready {
            Some(ready) => Ok(ready),
            None => unreachable!("it was made above"),
        }
    }

    /// Makes a scene ready to be drawn.
    fn made(
        &self,
        purpose: Purpose,
        camera: &dyn Fn(&[Bounds]) -> Camera,
        clip: &[ClipPlane],
        task: &Task,
    ) -> Result<Ready> {
        let begun = Instant::now();
        let sampled = self.sample(&purpose, camera, clip, task)?;
        let read_ms = begun.elapsed().as_secs_f64() * 1e3;
        let title = sampled.title();
        let named = sampled.volumes.iter().zip(&sampled.titles);
        let bars = named.filter_map(|(volume, title)| {
            ColourBar::of_volume(title.as_deref().unwrap_or("value"), volume)
        });
        let mut different: Vec<ColourBar> = Vec::new();
        for bar in bars {
            if !different.contains(&bar) {
                different.push(bar);
            }
        }
        let volumes = sampled.volumes.iter();
        let functions = volumes.map(|volume| volume.transfer_function.clone());
        let functions = functions.collect();
        let start = Instant::now();
        let options = SceneOptions {
            level_of_detail: purpose.detail,
            keep_shapes: purpose.shapes,
            keep_indices: purpose.indices,
            task: Some(task.clone()),
        };
        let renderer = ewa_splat::Renderer::with_options(sampled.volumes, &options)?;
        // With an automatic backend, the device is chosen when the first picture needs one.
        let backend = usable(self.backend)?;
        let is_open = backend != Backend::Auto;
        let renderer = match is_open {
            true => renderer.on(backend.open()?)?,
            false => renderer,
        };
        Ok(Ready {
            purpose,
            process: process::id(),
            renderer,
            is_open,
            bars: different,
            functions,
            firsts: sampled.firsts,
            counts: sampled.counts,
            smoothing: sampled.smoothing,
            title,
            prepared: Prepared {
                begun,
                read_ms,
                prepare_ms: start.elapsed().as_secs_f64() * 1e3,
                refined: (0, 0),
            },
        })
    }

    /// Returns the ready scene, on a device if a picture of this camera is worth it.
    fn opened(&mut self, camera: &Camera) -> Result<&mut Ready> {
        let waits = |ready: &mut Ready| !ready.is_open && !ready.renderer.suits_cpu(camera, 1);
        if let Some(ready) = self.ready.take_if(waits) {
            self.ready = Some(Ready {
                renderer: ready.renderer.on(usable(self.backend)?.open()?)?,
                is_open: true,
                ..ready
            });
        }
        match &mut self.ready {
            Some(ready) => Ok(ready),
            None => unreachable!("it was prepared before"),
        }
    }

    /// Returns the purpose of pictures with these settings.
    fn purpose(&self, drawing: &Drawing) -> Purpose {
        let settings = &drawing.settings;
        let slabs = settings.classifies_slabs();
        let by_extent = settings.classify == ewa_splat::Classification::Extent;
        Purpose {
            for_columns: false,
            mean: MeanPart::None,
            summed: None,
            normals: drawing.is_lit && !is_post_classified(settings),
            models: by_extent || slabs,
            detail: settings.draws_merged(),
            indices: false,
            shapes: self.keep_shapes,
            transfer: self.transfer.clone(),
        }
    }

    /// Sets a transfer function for all data. It takes effect at once if no sampled data depend on
    /// it, otherwise when the next picture is drawn.
    fn set_transfer(&mut self, choice: Option<TransferChoice>) -> Result<()> {
        if choice == self.transfer {
            return Ok(());
        }
        let is_plain = self.sources().all(|(_, source)| source.is_plain());
        if let (Some(TransferChoice::Text(text)), Some(ready), true) =
            (&choice, &mut self.ready, is_plain)
            && let Some(functions) = exchanged(text, &ready.functions)?
        {
            for (i, function) in functions.iter().enumerate() {
                if let Some(function) = function {
                    ready.renderer.set_transfer_function(i, function.clone())?;
                }
            }
            for bar in &mut ready.bars {
                if let Some(function) = functions.iter().flatten().next() {
                    *bar = bar.with_transfer_function(function);
                }
            }
            ready.bars.dedup();
            ready.functions = functions;
            ready.purpose.transfer.clone_from(&choice);
        }
        self.transfer = choice;
        Ok(())
    }
}

/// Returns new transfer functions from one text in place of old ones. It returns `None` if the data
/// must be sampled again: if the scale differs, so do the stored positions of values, and if the
/// text states no unit distance, sampling finds it.
fn exchanged(
    text: &str,
    old: &[Option<TransferFunction>],
) -> Result<Option<Vec<Option<TransferFunction>>>> {
    let of = |range: [f32; 2], unit_distance: f64| {
        let defaults = TransferDefaults {
            range,
            unit_distance,
        };
        TransferFunction::from_json("transfer function".as_ref(), text, &defaults)
    };
    let mut new = Vec::new();
    for old in old {
        let Some(old) = old else {
            new.push(None);
            continue;
        };
        let ([low, high], unit) = (old.range(), old.unit_distance());
        let one = of([low, high], unit)?;
        // Two sets of defaults give different functions if the text leaves anything open.
        let other = of([low - 1.0, high + 1.0], 2.0 * unit)?;
        let Some(moved) = one.moved_to(old.value_scale()).filter(|_| one == other) else {
            return Ok(None);
        };
        new.push(Some(moved));
    }
    Ok(Some(new))
}

/// Returns true if slabs are classified by their mean values and compute their own slopes.
fn is_post_classified(settings: &Settings) -> bool {
    settings.classify == ewa_splat::Classification::Slab
}

impl Source {
    /// Returns true if no sampled data depend on the transfer function: no boundary, no opacity of
    /// a surface, no unit distance or opacity scale that was asked for.
    fn is_plain(&self) -> bool {
        let options = &self.options;
        let is_of_points = match &self.data {
            Data::Set(dataset) => matches!(dataset.geometry, Geometry::Points { .. }),
            Data::Surfels(_) => true,
        };
        let is_soft = options.kernels.boundary == BoundaryChoice::Soft && !self.is_mesh();
        let is_scaled = (options.function.opacity_scale - 1.0).abs() > 0.0;
        (is_of_points || is_soft)
            && options.flatten.is_none()
            && options.surface.is_none()
            && options.function.unit_distance.is_none()
            && !is_scaled
    }

    /// Returns true if it is a mesh.
    fn is_mesh(&self) -> bool {
        match &self.data {
            Data::Set(dataset) => matches!(dataset.geometry, Geometry::Mesh(_)),
            Data::Surfels(_) => false,
        }
    }

    /// Returns the mesh from which surfels are made, if any are.
    fn surface(&self, for_columns: bool) -> Result<Option<Cow<'_, Dataset>>> {
        let Data::Set(dataset) = &self.data else {
            return Ok(None);
        };
        if self.is_mesh() {
            return Ok(Some(Cow::Borrowed(&**dataset)));
        }
        if self.options.surface.is_none() && (for_columns || !is_surface(dataset)) {
            return Ok(None);
        }
        let surface = as_surface(Dataset::clone(dataset), &self.options)?;
        Ok(Some(Cow::Owned(surface)))
    }
}

/// Returns a point of the plane at a coordinate along the axis that a camera looks along.
fn point_of_slice(camera: &Camera, at: f64) -> Result<glam::DVec3> {
    let fault = |place: &str, expected: &str, found: String| {
        Error::invalid("slice", place, expected, found, "correct it")
    };
    if !at.is_finite() {
        return Err(fault("coordinate", "a finite number", at.to_string()));
    }
    let along = Along::of_camera(camera);
    let expected = "one that looks along an axis: Camera.along";
    let along = along.ok_or_else(|| fault("camera", expected, "another one".into()))?;
    Ok(along.axis() * at)
}

/// Returns the camera of a view.
fn camera(
    view: Option<&View>,
    up: Up,
    boxes: &[Bounds],
    lens: Lens,
    size: [usize; 2],
    room_px: usize,
) -> Camera {
    let viewpoint = up.viewpoint();
    let room = if 2 * room_px <= size[0] { room_px } else { 0 };
    let inner = [size[0] - room, size[1]];
    let fitted = |viewpoint: ewa_splat::view::Viewpoint, lens, around| {
        let camera = match around {
            true => viewpoint.camera_around(boxes, lens, inner),
            false => viewpoint.camera(boxes, lens, inner),
        };
        // The columns left free lie to the right of the part that the camera was fitted to.
        camera.map(|camera| Camera {
            width: size[0],
            ..camera
        })
    };
    let along = match view {
        Some(view) => view.along(boxes, inner),
        // Column densities are seen along z.
        None if lens == Lens::OrthoHeight(None) => Along::Z.fitted(boxes, None, inner),
        None => None,
    };
    if let Some(camera) = along {
        return Camera {
            width: size[0],
            ..camera
        };
    }
    match view {
        Some(view) => view.camera(size, viewpoint, lens, fitted),
        None => fitted(viewpoint, lens, false).unwrap_or_else(|| {
            use glam::DVec3;
            Camera::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, DEFAULT_FOV_DEG, size)
        }),
    }
}

/// Checks the size of a picture.
fn checked(size: [usize; 2]) -> PyResult<()> {
    if size.iter().all(|n| (1..=65_535).contains(n)) {
        return Ok(());
    }
    let [width, height] = size;
    let text =
        format!("size: expected a width and a height from 1 to 65535, found {width}, {height}");
    Err(PyValueError::new_err(text))
}

impl Renderer {
    /// Locks the state, once no other thread draws.
    fn lock(&self, task: &Task) -> Result<MutexGuard<'_, State>> {
        let mut turns = 0;
        loop {
            match self.state.try_lock() {
                Ok(mut state) => {
                    self.process.store(process::id(), Ordering::Relaxed);
                    state.leave_device();
                    return Ok(state);
                }
                // After a panic, the state is as before, or lacks what is made anew.
                Err(TryLockError::Poisoned(poisoned)) => {
                    let mut state = poisoned.into_inner();
                    state.ready = None;
                    self.state.clear_poison();
                    return Ok(state);
                }
                Err(TryLockError::WouldBlock) => {
                    if task.is_cancelled() {
                        return Err(Error::Cancelled);
                    }
                    let owner = self.process.load(Ordering::Relaxed);
                    // A thread of this process that has just locked the state stores its process
                    // number at once.
                    turns = match owner == 0 || owner == process::id() {
                        true => 0,
                        false => turns + 1,
                    };
                    if turns > 100 {
                        return Err(Error::invalid(
                            "Renderer",
                            "process",
                            "one in which no other thread was drawing when it was forked",
                            "a renderer that its parent was drawing with",
                            "make another renderer of the same things",
                        ));
                    }
                    sleep(Duration::from_millis(1));
                }
            }
        }
    }

    /// Prepares a scene for a picture, and passes it on with the camera and settings.
    fn with_picture<T: Send>(
        &self,
        py: Python<'_>,
        (view, size, drawing): (Option<&View>, [usize; 2], &Drawing),
        indices: bool,
        of: impl FnOnce(&mut Ready, Camera, Settings) -> Result<T> + Send,
    ) -> PyResult<T> {
        checked(size)?;
        run(py, |task| {
            let mut state = self.lock(task)?;
            if drawing.transfer.is_some() {
                state.set_transfer(drawing.transfer.clone())?;
            }
            let purpose = Purpose {
                indices,
                ..state.purpose(drawing)
            };
            let mut settings = drawing.settings.clone();
            settings
                .clip
                .extend(state.periodic()?.iter().flat_map(PeriodicBox::planes));
            let clip = &settings.clip;
            let lens = Lens::FovDeg(DEFAULT_FOV_DEG);
            let up = state.up(view);
            let of_boxes = |boxes: &[Bounds]| camera(view, up, boxes, lens, size, 0);
            let ready = state.prepare(purpose, &of_boxes, clip, task)?;
            let boxes = left_of(ready.renderer.fitted_boxes(), clip);
            let room = match drawing.legend {
                true => legend_width(&ready.bars, size),
                false => 0,
            };
            let camera = camera(view, up, &boxes, lens, size, room);
            if !drawing.has_low_pass {
                settings.low_pass_variance_px2 = ready.renderer.suitable_low_pass_px2();
            }
            settings.task = Some(task.clone());
            of(state.opened(&camera)?, camera, settings)
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
        Ok(Self {
            state: Mutex::new(State {
                things,
                backend,
                transfer: None,
                keep_shapes,
                ready: None,
            }),
            process: AtomicU32::new(0),
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
        let drawing = drawing(said)?;
        let asked = (view.as_ref(), size, &drawing);
        let drawn = self.with_picture(py, asked, false, |ready, camera, settings| {
            if drawing.legend && ready.bars.is_empty() {
                return Err(Error::invalid(
                    "legend",
                    "data",
                    "a field with a transfer function",
                    "splats, meshes or particles with colours of their own",
                    "leave it out",
                ));
            }
            if drawing.legend {
                check_legend_size(&ready.bars, size)?;
            }
            let renderer = &mut ready.renderer;
            let mut image = renderer.render(&camera, &settings)?.clone();
            let times = [renderer.times()];
            let stats = stats(renderer, &times, ready.prepared);
            let depth = renderer.depth().map(|depth| depth.depths.clone());
            let normals = renderer.normals().map(|normals| normals.normals.clone());
            let error = match drawing.measure_error {
                false => None,
                true => {
                    let thickness = renderer.layers().map(|layers| layers.thickness);
                    let composite = match thickness {
                        Some(_) => settings.composite.with_thickness(thickness),
                        None => settings.composite,
                    };
                    let settings = Settings {
                        composite,
                        ..settings
                    };
                    let sample = ErrorSample::draw(renderer, &camera, &settings)?;
                    Some(serde_json::json!(sample.error_of(&image)).to_string())
                }
            };
            if drawing.legend {
                draw_legend(&ready.bars, &mut image)?;
            }
            Ok(Drawn {
                image,
                depth,
                normals,
                camera,
                stats: stats.to_string(),
                error,
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
        dict.set_item("stats", drawn.stats)?;
        dict.set_item("error", drawn.error)?;
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
        let drawing = drawing(said)?;
        let shared = &drawing.settings;
        let defaults = ColumnSettings::default();
        let settings = ColumnSettings {
            tolerance: shared.tolerance,
            filter: shared.filter,
            low_pass_variance_px2: match drawing.has_low_pass {
                true => shared.low_pass_variance_px2,
                false => defaults.low_pass_variance_px2,
            },
            cutoff: shared.cutoff.unwrap_or(defaults.cutoff),
            smoothing: None,
            slice: None,
            clip: shared.clip.clone(),
            simd: shared.advanced.simd,
            task: None,
        };
        let drawn = run(py, |task| {
            let mut state = self.lock(task)?;
            let purpose = Purpose {
                for_columns: true,
                mean: match mean {
                    Some(_) => MeanPart::Weights,
                    None => MeanPart::None,
                },
                summed: Some(Summed::of(of)),
                normals: false,
                models: false,
                detail: false,
                indices: false,
                shapes: state.keep_shapes,
                transfer: None,
            };
            let lens = Lens::OrthoHeight(None);
            let up = state.up(view.as_ref());
            let periodic = state.periodic()?;
            let mut clip = settings.clip.clone();
            clip.extend(periodic.iter().flat_map(PeriodicBox::planes));
            let of_boxes = |boxes: &[Bounds]| camera(view.as_ref(), up, boxes, lens, size, 0);
            let ready = state.prepare(purpose.clone(), &of_boxes, &clip, task)?;
            let boxes = left_of(ready.renderer.boxes(), &clip);
            // The picture of a periodic box shows the box alone, if it has its shape.
            let filled = periodic.filter(|_| view.is_none()).and_then(|periodic| {
                let window = Along::Z.window(periodic.corners());
                let has_shape = window.has_shape(size);
                has_shape.then(|| Along::Z.camera(&window, &boxes, size))
            });
            let camera = filled.unwrap_or_else(|| of_boxes(&boxes));
            let through = match slice {
                None => None,
                Some(at) => Some(point_of_slice(&camera, at)?),
            };
            let fields = match &mean {
                None => None,
                Some(field) => {
                    let of_field = Purpose {
                        summed: Some(Summed::of(Some(field.clone()))),
                        mean: MeanPart::Field,
                        ..purpose.clone()
                    };
                    let weights = state.sample(&purpose, &of_boxes, &clip, task)?;
                    let fields = state.sample(&of_field, &of_boxes, &clip, task)?;
                    Some((weights, fields))
                }
            };
            let backend = usable(state.backend)?;
            let ready = state.opened(&camera)?;
            let mut settings = ColumnSettings {
                smoothing: ready.smoothing,
                slice: through,
                clip,
                task: Some(task.clone()),
                ..settings
            };
            if mean.is_some() {
                settings = ColumnMeans::settings(&settings);
            }
            let mut column = ready.renderer.column_density(&camera, &settings)?.clone();
            let mut title = ready.title.clone();
            if let Some((weights, fields)) = fields {
                let on = |renderer: &ewa_splat::Renderer| match backend {
                    Backend::Auto if renderer.suits_cpu(&camera, 1) => Backend::Cpu,
                    backend => backend,
                };
                let mut means =
                    ColumnMeans::new(&weights.volumes, &fields.volumes, slice.is_some())?.on(on)?;
                column = means.draw(&column, &camera, &settings)?;
                title = fields.title();
            }
            let amplitudes = ready.renderer.amplitudes();
            Ok((column, camera, amplitudes, title))
        })?;
        let (column, camera, amplitudes, (name, unit)) = drawn;
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
        let drawing = drawing(said)?;
        let (frame, camera) = run(py, |task| {
            let mut state = self.lock(task)?;
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
            let reference = ReferenceSettings {
                error,
                low_pass_variance_px2: low_pass.into(),
                background: settings.background,
                task: Some(task.clone()),
                ..ReferenceSettings::default()
            };
            let sampled = state.sample(&purpose, &of_boxes, &settings.clip, task)?;
            let frame = match of_data {
                false => Integrator::classified(&sampled.volumes, settings.classify)?
                    .clipped(&settings.clip)
                    .render(&camera, &reference)?,
                true => of_field(&state, &sampled, settings, &camera, &reference)?,
            };
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
        let drawing = drawing(said)?;
        let asked = (view.as_ref(), size, &drawing);
        self.with_picture(py, asked, true, |ready, camera, settings| {
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
        let drawing = drawing(None)?;
        let asked = (view.as_ref(), size, &drawing);
        let volumes = run(py, |task| {
            let state = self.lock(task)?;
            let lens = Lens::FovDeg(DEFAULT_FOV_DEG);
            let up = state.up(view.as_ref());
            let of_boxes = |boxes: &[Bounds]| camera(view.as_ref(), up, boxes, lens, size, 0);
            Ok(state
                .sample(&state.purpose(&drawing), &of_boxes, &[], task)?
                .volumes)
        })?;
        self.with_picture(py, asked, false, |ready, camera, settings| {
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
        let old = run(py, |task| {
            let state = self.lock(task)?;
            let count = state.things.len();
            let old = state
                .things
                .get(thing)
                .map(|old| Python::attach(|py| old.clone_ref(py)));
            let found = || {
                let expected = format!("one of {count}");
                Error::invalid(
                    "thing",
                    "number",
                    expected,
                    thing.to_string(),
                    "name another",
                )
            };
            old.ok_or_else(found)
        })?;
        let kept: Values = values.0.clone();
        let new = Py::new(py, old.get().with_values(py, values)?)?;
        run(py, |task| {
            let mut state = self.lock(task)?;
            let quick = state.ready.as_mut().filter(|ready| ready.purpose.shapes);
            if let Some(ready) = quick
                && let (first, true) = ready.firsts[thing]
                && let Some(function) = &ready.functions[first]
                && kept.non_finite_count() == 0
            {
                let values = function.value_scale().positions(kept);
                ready.renderer.set_values(first, values)?;
            } else {
                state.ready = None;
            }
            state.things[thing] = new;
            Ok(())
        })
    }

    /// Sets a transfer function for all data.
    fn set_transfer_function(&self, py: Python<'_>, said: &Bound<'_, PyDict>) -> PyResult<()> {
        let choice = transfer(&Keywords::new(Some(said))?)?;
        run(py, |task| self.lock(task)?.set_transfer(choice))
    }

    /// Returns the current transfer functions as JSON; `None` for drawables without one.
    fn transfer_functions(&self, py: Python<'_>) -> PyResult<Vec<Option<String>>> {
        let drawing = drawing(None)?;
        self.with_picture(py, (None, [64, 64], &drawing), false, |ready, _, _| {
            let functions = ready.functions.iter();
            Ok(functions
                .map(|f| f.as_ref().map(TransferFunction::to_json))
                .collect())
        })
    }

    /// Returns the adapter that draws, or `None` for the CPU.
    fn adapter(&self, py: Python<'_>) -> PyResult<Option<String>> {
        run(py, |task| {
            let state = self.lock(task)?;
            Ok(state
                .ready
                .as_ref()
                .and_then(|ready| ready.renderer.adapter()))
        })
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
    DataIntegrator::new((**dataset).clone(), field, function)?
        .clipped(&settings.clip)
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
