//! Holds the data of a session and the scene made of them.

use std::borrow::Cow;
use std::fmt::{self, Display};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread::sleep;
use std::time::Duration;

use super::drawable::Drawable;
use super::forked::{own_process, usable};
use super::options::Drawing;
use super::ranks::{Parts, Ranks};
use super::sampled::{Purpose, Ready, Sampled};
use super::source::{Data, Source};
use super::view::View;
use crate::blocks::SceneOptions;
use crate::clock::Instant;
use crate::collective::Collective;
use crate::error::{Error, Result};
use crate::frame::backend::{Backend, OpenBackend};
use crate::frame::settings::Settings;
#[cfg(feature = "gpu")]
use crate::gpu::Gpu;
use crate::io::{Dataset, Geometry, Up};
use crate::legend::ColourBar;
use crate::load::{SurfelDemand, prefer, sample_together};
use crate::ranks::renderer::shared;
use crate::render::Renderer;
use crate::sample::mesh::Spread;
use crate::sample::{
    FunctionOptions, KernelOptions, MeanPart, PeriodicBox, PurposeOptions, SampleOptions,
    TransferChoice, common_smoothing, field_choices,
};
use crate::scene::{Classification, TransferDefaults, TransferFunction, Values};
use crate::task::{Task, check};
use crate::view::{Bounds, Camera, ClipPlane, left_of};

/// Ratio of wanted to existing surfels of a mesh above which it is sampled again.
const DENSER: f64 = 1.5;

/// Data in memory with the scene made of them. It draws one picture at a time.
pub struct Session {
    /// The group of ranks that share the data, if there is one.
    pub(super) ranks: Option<Ranks>,
    state: Mutex<State>,
    /// Process that locked the state last. A forked process inherits its parent's locks.
    process: AtomicU32,
}

/// Contents of a session.
pub struct State {
    /// The data of all ranks, if ranks share them.
    pub(super) parts: Option<Parts>,
    things: Vec<Arc<Drawable>>,
    backend: Backend,
    /// Device that the caller opened, which draws in place of `backend`.
    #[cfg(feature = "gpu")]
    device: Option<Gpu>,
    /// Last transfer function given for all data.
    transfer: Option<TransferChoice>,
    keep_shapes: bool,
    /// Number of changes of values and of the device.
    changes: u64,
    ready: Option<Ready>,
}

impl State {
    /// Forgets a scene on a device that another process opened. Freeing it would call its driver.
    fn leave_device(&mut self) {
        let is_of_another = |ready: &mut Ready| {
            ready.process != own_process() && ready.renderer.adapter().is_some()
        };
        if let Some(ready) = self.ready.take_if(is_of_another) {
            std::mem::forget(ready);
        }
    }

    /// Returns all sources, each with the number of its drawable.
    pub fn sources(&self) -> impl Iterator<Item = (usize, &Source)> {
        let things = self.things.iter().enumerate();
        things.flat_map(|(i, thing)| thing.sources.iter().map(move |source| (i, source)))
    }

    /// Returns the direction up.
    pub fn up(&self, view: Option<&View>) -> Up {
        let up = match &self.parts {
            None => Up::of_scene(self.things.iter().flat_map(|thing| thing.ups())),
            Some(parts) => Up::of_scene(parts.ups(&self.things)),
        };
        match view.and_then(|view| view.up) {
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
        let surfaces: Result<Vec<Option<Cow<'_, Dataset>>>> = surfaces.collect();
        let surfaces = match &self.parts {
            None => surfaces?,
            Some(parts) => parts.agree(surfaces)?,
        };
        let has_some = surfaces.iter().any(Option::is_some);
        let has_some = match &self.parts {
            None => has_some,
            Some(parts) => parts.any(has_some)?,
        };
        if !has_some {
            return Ok(vec![None; surfaces.len()]);
        }
        let corners = self.sources().filter_map(|(_, source)| source.corners());
        let boxes = corners.map(|(a, b)| ((a + b) / 2.0, (b - a) / 2.0));
        let boxes = match &self.parts {
            None => boxes.collect(),
            Some(parts) => parts.boxes(),
        };
        let cameras = [camera(&left_of(boxes, clip))];
        let demands: Vec<Option<SurfelDemand>> = surfaces
            .iter()
            .map(|surface| match &surface.as_ref()?.geometry {
                Geometry::Mesh(mesh) => Some(SurfelDemand::of(mesh, &cameras)),
                _ => None,
            })
            .collect();
        match &self.parts {
            None => Ok(SurfelDemand::share(&demands)),
            Some(parts) => parts.surfels(demands),
        }
    }

    /// Samples all drawables. Those that show one field by an automatic transfer function share
    /// one.
    pub fn sample(
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
        let sources = self.sources().zip(&spreads);
        let options = sources.map(|((_, source), spread)| {
            let own = source.options.clone();
            Ok(SampleOptions {
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
                    keeps_value_sample: (count > 1 || self.parts.is_some()) && !purpose.for_columns,
                },
                task: Some(task.clone()),
                ..own
            })
        });
        let options: Result<Vec<SampleOptions>> = options.collect();
        let mut options = match &self.parts {
            None => options?,
            Some(parts) => parts.agree(options)?,
        };
        if let Some(parts) = &self.parts {
            let things: Vec<(usize, &Source)> = self.sources().collect();
            return parts.sample(&things, options, purpose, counts);
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
            smoothing: common_smoothing(scenes.iter().map(|scene| &scene.report)),
            counts,
            ..Sampled::default()
        };
        for ((thing, _), scene) in self.sources().zip(scenes) {
            if thing == sampled.firsts.len() {
                let report = &scene.report;
                let is_whole = report.sample_count == report.particle_count;
                sampled.firsts.push((sampled.volumes.len(), is_whole));
            }
            let count = scene.volumes.len();
            sampled.volumes.extend(scene.volumes);
            sampled.note(count, scene.report.field, scene.report.unit);
        }
        Ok(sampled)
    }

    /// Returns the periodic box of all particles.
    ///
    /// # Errors
    /// Drawables with different boxes, or with and without one.
    pub fn periodic(&self) -> Result<Option<PeriodicBox>> {
        let mut boxes = self.sources().map(|(_, source)| source.options.periodic);
        let first = boxes.next().flatten();
        match boxes.all(|own| own == first) {
            true => Ok(first),
            false => Err(Error::invalid(
                "box",
                "data",
                "the same periodic box for all",
                "different ones",
                "give all the same",
            )),
        }
    }

    /// Prepares the scene, unless it is ready.
    pub fn prepare(
        &mut self,
        purpose: Purpose,
        camera: &dyn Fn(&[Bounds]) -> Camera,
        clip: &[ClipPlane],
        task: &Task,
    ) -> Result<&mut Ready> {
        let serves = self.ready.as_ref().is_some_and(|ready| {
            let serves = Purpose {
                detail: ready.purpose.detail || purpose.detail,
                indices: ready.purpose.indices || purpose.indices,
                shapes: ready.purpose.shapes || purpose.shapes,
                ..purpose.clone()
            };
            ready.purpose == serves
        });
        // Ranks make a scene together, or all keep theirs.
        let on_any = |own: bool| match &self.parts {
            None => Ok(own),
            Some(parts) => parts.any(own),
        };
        let mut is_ready = !on_any(!serves)?;
        if let (true, Some(ready)) = (is_ready, &self.ready) {
            let wanted = self.spreads(&purpose, camera, clip).unwrap_or_default();
            let mut pairs = ready.counts.iter().zip(wanted);
            let denser = pairs.any(|(own, wanted)| {
                own.zip(wanted)
                    .is_some_and(|(own, (_, wanted))| wanted as f64 > DENSER * own as f64)
            });
            is_ready = !on_any(denser)?;
        }
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
        let mut sampled = self.sample(&purpose, camera, clip, task)?;
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
        let renderer = match (&self.parts, sampled.placement.take()) {
            (Some(parts), Some(placement)) => {
                let ranks = Box::new(parts.ranks.clone());
                shared(placement.share(sampled.volumes), &options, ranks)?
            }
            _ => Renderer::with_options(sampled.volumes, &options)?,
        };
        // With an automatic backend, the device is chosen when the first picture needs one. Ranks draw on processors.
        let is_open = usable(self.backend)? != Backend::Auto;
        let renderer = match is_open {
            true => renderer.on(self.open_backend()?)?,
            false => renderer,
        };
        Ok(Ready {
            purpose,
            process: own_process(),
            renderer,
            is_open,
            bars: different,
            functions,
            firsts: sampled.firsts,
            counts: sampled.counts,
            smoothing: sampled.smoothing,
            title,
            begun,
            read_ms,
            prepare_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }

    /// Opens the device that draws.
    fn open_backend(&self) -> Result<OpenBackend> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.device {
            return Ok(OpenBackend::or_cpu(gpu.clone()));
        }
        usable(self.backend)?.open()
    }

    /// Draws on a device that the caller opened from now on, and on the CPU what it cannot; or by the backend that the
    /// session was made with.
    #[cfg(feature = "gpu")]
    pub fn set_device(&mut self, device: Option<Gpu>) {
        self.device = device;
        self.changes += 1;
        self.ready = None;
    }

    /// Takes the ready scene, while a device draws it, with the number of changes of the data until now.
    #[cfg(feature = "gpu")]
    pub(super) fn take_ready(&mut self) -> Option<(Ready, u64)> {
        let changes = self.changes;
        self.ready.take().map(|ready| (ready, changes))
    }

    /// Puts back a scene that was taken, unless the data have changed or another scene has been made.
    #[cfg(feature = "gpu")]
    pub(super) fn put_ready(&mut self, (ready, changes): (Ready, u64)) {
        if changes == self.changes && self.ready.is_none() {
            self.ready = Some(ready);
        }
    }

    /// Returns a drawable with other values.
    fn replaced(&self, thing: usize, values: Values) -> Result<Arc<Drawable>> {
        let Some(old) = self.things.get(thing) else {
            let (expected, found) = (format!("one of {}", self.things.len()), thing.to_string());
            return Err(Error::invalid(
                "scene",
                "number",
                expected,
                found,
                "name another",
            ));
        };
        Ok(Arc::new(old.with_values(values)?))
    }

    /// Draws a drawable with other values from now on.
    fn set_values(&mut self, thing: usize, new: Arc<Drawable>, values: Values) -> Result<()> {
        self.changes += 1;
        let quick = self.ready.as_mut().filter(|ready| ready.purpose.shapes);
        if let Some(ready) = quick
            && let (first, true) = ready.firsts[thing]
            && let Some(function) = &ready.functions[first]
            && values.non_finite_count() == 0
        {
            let values = function.value_scale().positions(values);
            ready.renderer.set_values(first, values)?;
        } else {
            self.ready = None;
        }
        self.things[thing] = new;
        Ok(())
    }

    /// Returns the ready scene, on a device if a picture of this camera is worth it.
    pub fn opened(&mut self, camera: &Camera) -> Result<&mut Ready> {
        let waits = |ready: &mut Ready| !ready.is_open && !ready.renderer.suits_cpu(camera, 1);
        if let Some(ready) = self.ready.take_if(waits) {
            self.ready = Some(Ready {
                renderer: ready.renderer.on(self.open_backend()?)?,
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
    pub fn purpose(&self, drawing: &Drawing) -> Purpose {
        let settings = &drawing.settings;
        let slabs = settings.classifies_slabs();
        let by_extent = settings.classify == Classification::Extent;
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

    /// Returns true if shapes are kept for other values.
    pub(crate) fn keeps_shapes(&self) -> bool {
        self.keep_shapes
    }

    /// Returns the chosen back end.
    pub(crate) fn backend(&self) -> Backend {
        self.backend
    }

    /// Sets a transfer function for all data. It takes effect at once if no sampled data depend on
    /// it, otherwise when the next picture is drawn.
    pub fn set_transfer(&mut self, choice: Option<TransferChoice>) -> Result<()> {
        if choice == self.transfer {
            return Ok(());
        }
        let is_plain = self.sources().all(|(_, source)| source.is_plain());
        // Ranks sample again.
        let is_plain = is_plain && self.parts.is_none();
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
    settings.classify == Classification::Slab
}

impl fmt::Debug for Session {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Session").finish_non_exhaustive()
    }
}

impl fmt::Debug for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("State").finish_non_exhaustive()
    }
}

impl Session {
    /// Makes a session of drawables.
    ///
    /// - `keep_shapes`: true if values may be replaced without sampling the data again.
    pub fn new(things: Vec<Arc<Drawable>>, backend: Backend, keep_shapes: bool) -> Self {
        Self {
            ranks: None,
            state: Mutex::new(State {
                parts: None,
                things,
                backend,
                #[cfg(feature = "gpu")]
                device: None,
                transfer: None,
                keep_shapes,
                changes: 0,
                ready: None,
            }),
            process: AtomicU32::new(0),
        }
    }

    /// Makes a session of the data of several ranks, each of which gives a part of every drawable. All ranks call the same
    /// functions in the same order; the first one gets the pictures.
    ///
    /// - `own`: this rank's part, if it has one. A rank that fails before reports its error to the others here.
    ///
    /// # Errors
    /// The error of any rank; other numbers of drawables, or other options, on other ranks; a rank that is gone.
    pub fn over_ranks<E: From<Error> + Display>(
        own: Result<Vec<Arc<Drawable>>, E>,
        communicator: impl Collective + 'static,
    ) -> Result<Self, E> {
        let mut ranks = Ranks::new(Box::new(communicator));
        let things = ranks.agreed("making a renderer", own)?;
        let parts = Parts::of(&things, ranks.clone())?;
        let mut session = Self::new(things, Backend::Cpu, false);
        session.ranks = Some(ranks);
        let state = session.state.get_mut();
        state.unwrap_or_else(PoisonError::into_inner).parts = Some(parts);
        Ok(session)
    }

    /// Returns this rank's result if all ranks are in the same call and have one. Without ranks, it returns the result.
    ///
    /// # Errors
    /// The error of this rank, or of another; ranks in other calls; a rank that is gone.
    pub fn agreed<T, E: From<Error> + Display>(
        &self,
        call: &'static str,
        own: Result<T, E>,
    ) -> Result<T, E> {
        match &self.ranks {
            None => own,
            Some(ranks) => ranks.clone().agreed(call, own),
        }
    }

    /// Begins work of all ranks: checks that all do the same, and that none is cancelled. Returns a task that nothing
    /// cancels, because a rank must not leave the others in the middle; `None` without ranks.
    ///
    /// - `said`: what must be the same on all ranks.
    pub(super) fn begin(&self, task: &Task, said: impl FnOnce() -> String) -> Result<Option<Task>> {
        let Some(ranks) = &self.ranks else {
            return Ok(None);
        };
        let mut ranks = ranks.clone();
        ranks.check_same("settings", &said())?;
        ranks.agreed("begun work", check(Some(task)))?;
        Ok(Some(task.without_cancel()))
    }

    /// Returns the first rank's answers. Without ranks, these are the own ones.
    ///
    /// # Errors
    /// A rank that is gone.
    pub fn of_first<const N: usize>(&self, own: [bool; N]) -> Result<[bool; N]> {
        match &self.ranks {
            None => Ok(own),
            Some(ranks) => ranks.clone().of_first(own),
        }
    }

    /// Returns true if this process gets the pictures.
    pub fn is_first(&self) -> bool {
        self.ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0)
    }

    /// Returns true if ranks share the data.
    pub fn is_shared(&self) -> bool {
        self.ranks.is_some()
    }

    /// Replaces the values of a drawable by as many others. It samples the data again only if it must.
    ///
    /// # Errors
    /// No such drawable; one without a field of values; another number of values.
    pub fn set_values(&self, thing: usize, values: Values, task: &Task) -> Result<()> {
        let mut state = self.lock(task)?;
        self.check_same("scene", || thing.to_string())?;
        // No rank takes the values unless all can.
        let new = self.agreed("other values", state.replaced(thing, values.clone()))?;
        state.set_values(thing, new, values)
    }

    /// Sets a transfer function for all data: see [`State::set_transfer`].
    ///
    /// # Errors
    /// A function that does not fit the data; other functions on other ranks; cancelled work.
    pub fn set_transfer(&self, choice: Option<TransferChoice>, task: &Task) -> Result<()> {
        let mut state = self.lock(task)?;
        self.check_same("transfer function", || format!("{choice:?}"))?;
        let set = state.set_transfer(choice);
        self.agreed("a transfer function", set)
    }

    /// Checks that all ranks say the same; without ranks there is nothing to check.
    fn check_same(&self, what: &'static str, said: impl FnOnce() -> String) -> Result<()> {
        match &self.ranks {
            None => Ok(()),
            Some(ranks) => ranks.clone().check_same(what, &said()),
        }
    }

    /// Returns the adapter that draws, or `None` for the CPU.
    ///
    /// # Errors
    /// Cancelled work.
    pub fn adapter(&self, task: &Task) -> Result<Option<String>> {
        let state = self.lock(task)?;
        Ok(state
            .ready
            .as_ref()
            .and_then(|ready| ready.renderer.adapter()))
    }

    /// Notes the process that holds the state, and leaves a device of its parent alone.
    fn entered<'a>(&self, mut state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.process.store(own_process(), Ordering::Relaxed);
        state.leave_device();
        state
    }

    /// Locks the state, once no other thread draws.
    pub fn lock(&self, task: &Task) -> Result<MutexGuard<'_, State>> {
        let mut turns = 0;
        loop {
            match self.state.try_lock() {
                Ok(state) => return Ok(self.entered(state)),
                // After a panic, the state is as before, or lacks what is made anew.
                Err(TryLockError::Poisoned(poisoned)) => {
                    let mut state = self.entered(poisoned.into_inner());
                    state.ready = None;
                    self.state.clear_poison();
                    return Ok(state);
                }
                Err(TryLockError::WouldBlock) => {
                    if task.is_cancelled() {
                        return Err(Error::Cancelled);
                    }
                    if cfg!(target_family = "wasm") {
                        return Err(Error::invalid(
                            "Session",
                            "calls",
                            "one at a time",
                            "one within another",
                            "wait for the first",
                        ));
                    }
                    let owner = self.process.load(Ordering::Relaxed);
                    // A thread of this process that has just locked the state stores its process
                    // number at once.
                    turns = match owner == 0 || owner == own_process() {
                        true => 0,
                        false => turns + 1,
                    };
                    if turns > 100 {
                        return Err(Error::invalid(
                            "Renderer",
                            "process",
                            "one in which no other thread was drawing when it was forked",
                            "a renderer that its parent was drawing with",
                            "make another renderer of the same data",
                        ));
                    }
                    sleep(Duration::from_millis(1));
                }
            }
        }
    }
}
