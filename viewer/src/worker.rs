//! Runs the thread that reads and draws, so that the window never waits.
//!
//! The window sends the wanted state, not commands. The latest request counts, and the thread
//! cancels outdated work. It draws a change at once, as coarsely as the frame time requires. After
//! a pause without changes, it refines the picture and measures its error. Then the thread sleeps.

use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ewa_splat::command::{Animation, line};
use ewa_splat::io::{Up, write_image};
use ewa_splat::legend::ColourBar;
use ewa_splat::load;
use ewa_splat::measure::{ErrorSample, ImageErrors, SampledError, accurate, compare};
use ewa_splat::reference::{Integrator, ReferenceSettings};
use ewa_splat::render::{Advanced, FrameCounts, Gpu, Picked, StageTimes};
use ewa_splat::scene::TransferFunction;
use ewa_splat::view::{Bounds, Camera};
use ewa_splat::{Composite, Error, Image, Renderer, SceneOptions, Settings, Show, Task, wgpu};

use crate::controller::{Coarseness, Controller};
use crate::histogram::Histogram;
use crate::instead::{self, Instead};
use crate::overlay::Overlay;
use crate::path::RATE;
use crate::refinable::Refinable;
use crate::wanted::{Film, Load, View};

/// Time without changes after which a picture is refined.
const REST: Duration = Duration::from_millis(120);

/// Factor by which the first picture of all pixels is looser than the tolerance asked for.
const FIRST_STEP: f32 = 4.0;

/// Error of the reference image, as a share of the tolerance.
const TRUTH_SHARE: f64 = 0.1;

/// Time of a full picture, in seconds, below which no intermediate step is drawn.
const SOON: f32 = 0.25;

/// Facts about a scene after it is read.
#[derive(Debug, Clone)]
pub(crate) struct Loaded {
    pub(crate) scene: u64,
    pub(crate) settings: Settings,
    pub(crate) up: Up,
    /// Boxes around what is visible.
    pub(crate) boxes: Vec<Bounds>,
    pub(crate) bounds: Option<Bounds>,
    /// True if any of the data can be cut sharply at its boundary.
    pub(crate) has_boundary: bool,
    pub(crate) volumes: Vec<Volume>,
    /// Fields and vector components of the first input that can be shown.
    pub(crate) fields: Vec<String>,
    pub(crate) particle_count: usize,
    pub(crate) bytes_per_particle: f64,
    /// Name of the adapter or processor that draws.
    pub(crate) device: String,
    pub(crate) seconds: f64,
}

/// Facts about a volume.
#[derive(Debug, Clone)]
pub(crate) struct Volume {
    pub(crate) title: String,
    pub(crate) function: Option<TransferFunction>,
    pub(crate) histogram: Option<Histogram>,
    /// Colour bar, if a transfer function gives the volume's colours.
    pub(crate) bar: Option<ColourBar>,
}

/// Picture in the form that the window takes.
#[derive(Debug, Clone)]
pub(crate) enum Picture {
    /// Pixels in memory.
    Pixels(Arc<Image>),
    /// Texture on the window's device, of sRGB-encoded colours times alpha.
    Texture(Arc<wgpu::Texture>),
}

/// Picture, with the facts of its drawing.
#[derive(Debug, Clone)]
pub(crate) struct Drawn {
    /// Number of its view.
    pub(crate) number: u64,
    pub(crate) picture: Picture,
    pub(crate) coarseness: Coarseness,
    /// True if no refinement is left.
    pub(crate) is_final: bool,
    pub(crate) error: Option<SampledError>,
    pub(crate) counts: FrameCounts,
    pub(crate) times: StageTimes,
}

/// Messages from the thread to the window.
#[derive(Debug)]
pub(crate) enum News {
    Progress(String),
    Loaded(Box<Loaded>),
    Drawn(Box<Drawn>),
    Picked(Vec<Picked>),
    /// The reference image is drawn; the errors are those of the picture before it.
    True(ImageErrors),
    Written(PathBuf),
    /// The scene of this number was not read: the error, or `None` if it was cancelled. The
    /// previous scene stays.
    NotLoaded(u64, Option<String>),
    /// All pictures of a film are written.
    Filmed(PathBuf),
    /// The reference image, or a film, was cancelled.
    Ended,
    /// An error, worded as on the command line. The scene stays.
    Failed(String),
}

#[derive(Default)]
struct Mailbox {
    load: Option<Load>,
    view: Option<View>,
    pick: Option<[usize; 2]>,
    write: Option<(View, Box<Overlay>, PathBuf)>,
    /// Scene of a reference image, to be read again.
    truth: Option<Load>,
    film: Option<Box<Film>>,
    ends: bool,
    /// True if the current reading is cancelled.
    ends_reading: bool,
    /// Current task, and whether it is a picture, which a newer request cancels.
    task: Option<(Task, bool)>,
    news: Vec<News>,
}

struct Shared {
    mailbox: Mutex<Mailbox>,
    wake: Condvar,
    /// Notifies the window of messages.
    tell: Box<dyn Fn() + Send + Sync>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Mailbox> {
        self.mailbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tell(&self, news: News) {
        self.lock().news.push(news);
        (self.tell)();
    }
}

/// Handle of the thread.
pub(crate) struct Worker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Worker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Worker").finish_non_exhaustive()
    }
}

impl Worker {
    /// Starts the thread, which calls `tell` whenever it has sent a message.
    pub(crate) fn new(tell: impl Fn() + Send + Sync + 'static) -> Self {
        let shared = Arc::new(Shared {
            mailbox: Mutex::default(),
            wake: Condvar::new(),
            tell: Box::new(tell),
        });
        let own = Arc::clone(&shared);
        let thread = std::thread::spawn(move || work(&own));
        Self {
            shared,
            thread: Some(thread),
        }
    }

    fn wish(&self, note: impl FnOnce(&mut Mailbox)) {
        let mut mailbox = self.shared.lock();
        note(&mut mailbox);
        let ends = mailbox.ends || mailbox.ends_reading;
        match &mailbox.task {
            Some((task, is_picture)) if *is_picture || ends => task.cancel(),
            _ => {}
        }
        mailbox.ends_reading = false;
        drop(mailbox);
        self.shared.wake.notify_one();
    }

    /// Requests that other data are read.
    pub(crate) fn load(&self, load: Load) {
        self.wish(|mailbox| {
            mailbox.load = Some(load);
            mailbox.view = None;
            mailbox.ends_reading = true;
        });
    }

    /// Requests another view.
    pub(crate) fn show(&self, view: View) {
        self.wish(|mailbox| mailbox.view = Some(view));
    }

    /// Asks what lies under a pixel of the last view.
    pub(crate) fn pick(&self, pixel: [usize; 2]) {
        self.wish(|mailbox| mailbox.pick = Some(pixel));
    }

    /// Draws a view to the tolerance asked for, and writes the picture with its overlay.
    pub(crate) fn write(&self, view: View, over: Overlay, path: PathBuf) {
        self.wish(|mailbox| mailbox.write = Some((view, Box::new(over), path)));
    }

    /// Draws the reference image of the last view.
    ///
    /// - `load`: the load of the view's scene, which is read again.
    pub(crate) fn ask_truth(&self, load: Load) {
        self.wish(|mailbox| mailbox.truth = Some(load));
    }

    /// Draws and writes a film.
    pub(crate) fn film(&self, film: Film) {
        self.wish(|mailbox| mailbox.film = Some(Box::new(film)));
    }

    /// Cancels the reading, the reference image, or a film.
    pub(crate) fn cancel(&self) {
        self.wish(|mailbox| {
            if let Some(load) = mailbox.load.take() {
                mailbox.news.push(News::NotLoaded(load.scene, None));
            }
            if mailbox.truth.take().is_some() | mailbox.film.take().is_some() {
                mailbox.news.push(News::Ended);
            }
            mailbox.ends_reading = true;
        });
        (self.shared.tell)();
    }

    /// Returns the messages since the last call.
    pub(crate) fn news(&self) -> Vec<News> {
        std::mem::take(&mut self.shared.lock().news)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.wish(|mailbox| mailbox.ends = true);
        if let Some(thread) = self.thread.take() {
            // A panic has already been printed.
            let _ = thread.join();
        }
    }
}

/// Next job of the thread.
enum Job {
    Load(Load),
    Show(View),
    Pick([usize; 2]),
    Write(View, Box<Overlay>, PathBuf),
    Truth(Load),
    Film(Box<Film>),
    /// Nothing has changed for a while.
    Refine,
    End,
}

/// Waits for a job.
///
/// - `patience`: time without changes after which a picture is refined, if any refinement is left.
fn next(shared: &Shared, patience: Option<Duration>) -> Job {
    let mut mailbox = shared.lock();
    let since = Instant::now();
    loop {
        mailbox.task = None;
        if mailbox.ends {
            return Job::End;
        }
        if let Some(load) = mailbox.load.take() {
            return Job::Load(load);
        }
        if let Some(view) = mailbox.view.take() {
            return Job::Show(view);
        }
        if let Some(pixel) = mailbox.pick.take() {
            return Job::Pick(pixel);
        }
        if let Some((view, over, path)) = mailbox.write.take() {
            return Job::Write(view, over, path);
        }
        if let Some(load) = mailbox.truth.take() {
            return Job::Truth(load);
        }
        if let Some(film) = mailbox.film.take() {
            return Job::Film(film);
        }
        let left = patience.map(|patience| patience.saturating_sub(since.elapsed()));
        mailbox = match left {
            Some(Duration::ZERO) => return Job::Refine,
            Some(left) => {
                let waited = shared.wake.wait_timeout(mailbox, left);
                waited.unwrap_or_else(PoisonError::into_inner).0
            }
            None => shared
                .wake
                .wait(mailbox)
                .unwrap_or_else(PoisonError::into_inner),
        };
    }
}

fn work(shared: &Arc<Shared>) {
    let mut stage: Option<Stage> = None;
    loop {
        let patience = stage.as_ref().and_then(Stage::patience);
        let result = match (next(shared, patience), &mut stage) {
            (Job::End, _) => return,
            (Job::Load(load), stage) => match read(shared, &load) {
                Ok(read) => {
                    *stage = Some(read);
                    Ok(())
                }
                Err(error) => {
                    let is_wanted = !matches!(error, Error::Cancelled);
                    let why = is_wanted.then(|| line(&error));
                    shared.tell(News::NotLoaded(load.scene, why));
                    Ok(())
                }
            },
            (Job::Show(view), Some(stage)) => stage.show(shared, view),
            (Job::Pick(pixel), Some(stage)) => stage.pick(shared, pixel),
            (Job::Write(view, over, path), Some(stage)) => stage.write(shared, &view, &over, path),
            (Job::Truth(load), Some(stage)) => {
                let drawn = stage.draw_truth(shared, &load);
                if drawn.is_err() {
                    shared.tell(News::Ended);
                }
                drawn
            }
            (Job::Film(film), Some(stage)) => {
                let written = stage.film(shared, &film);
                if written.is_err() {
                    shared.tell(News::Ended);
                }
                written
            }
            (Job::Refine, Some(stage)) => stage.refine(shared),
            (_, None) => Ok(()),
        };
        match result {
            Ok(()) | Err(Error::Cancelled) => {}
            Err(error) => {
                if let Some(stage) = &mut stage {
                    stage.left = 0;
                }
                shared.tell(News::Failed(line(&error)));
            }
        }
    }
}

/// Effort of a picture.
#[derive(Clone, Copy, PartialEq)]
enum Effort {
    /// One kernel per sample and one sample a pixel.
    Motion,
    /// As the command draws it: refined kernels, and samples of opaque edges.
    Rest,
}

/// Purpose of a task. It determines what cancels the task, and whether its progress is shown.
#[derive(Clone, Copy, PartialEq)]
enum Purpose {
    /// Reading: its progress is shown; another load or the user cancels it.
    Reading,
    /// Film: its progress is counted in pictures; another load or the user cancels it.
    Film,
    /// Picture: any newer request cancels it.
    Picture,
    /// Reference image: its progress is shown, and any newer request cancels it.
    Truth,
}

fn begin(shared: &Arc<Shared>, purpose: Purpose) -> Task {
    let own = Arc::clone(shared);
    let task = match purpose {
        Purpose::Picture | Purpose::Film => Task::new(),
        _ => Task::observed(move |progress| own.tell(News::Progress(progress.to_string()))),
    };
    let is_picture = matches!(purpose, Purpose::Picture | Purpose::Truth);
    shared.lock().task = Some((task.clone(), is_picture));
    task
}

fn read(shared: &Arc<Shared>, load: &Load) -> ewa_splat::Result<Stage> {
    let begun = Instant::now();
    let task = begin(shared, Purpose::Reading);
    let request = &load.request;
    let field = load.field.as_deref();
    let mut scene = request.read(field, &load.chosen, load.step, None, &task)?;
    let refinable = Refinable::of(load, &scene);
    let volumes = volumes_of(&scene);
    let functions = volumes.iter().map(|volume| volume.function.clone());
    let functions = functions.collect();
    let options = SceneOptions {
        keep_indices: true,
        task: Some(task),
        ..SceneOptions::default()
    };
    let renderer = scene.renderer(&options)?;
    let renderer = load.opened(renderer)?;
    let has_window = load.gpu.is_some() && renderer.adapter().is_some();
    let window = load.gpu.clone().filter(|_| has_window);
    let settings = request.settings(renderer.suitable_low_pass_px2());
    let loaded = Loaded {
        scene: load.scene,
        settings,
        up: scene.up,
        boxes: request.boxes(&renderer),
        bounds: scene.bounds(),
        has_boundary: scene.has_boundary,
        particle_count: renderer.particle_count(),
        bytes_per_particle: renderer.bytes_per_particle(),
        device: renderer.adapter().unwrap_or_else(|| "processor".into()),
        volumes,
        fields: scene.selectors,
        seconds: begun.elapsed().as_secs_f64(),
    };
    shared.tell(News::Loaded(Box::new(loaded)));
    Ok(Stage {
        scene: load.scene,
        renderer,
        refinable,
        window,
        controller: Controller::default(),
        functions,
        view: None,
        drawn: None,
        left: 0,
        is_moving: false,
    })
}

fn volumes_of(scene: &load::Loaded) -> Vec<Volume> {
    let described = scene.volumes.iter().zip(&scene.titles);
    described
        .map(|(volume, title)| {
            let function = volume.transfer_function.clone();
            let values = volume.values.as_ref();
            let title = title.clone().unwrap_or_else(|| "value".into());
            Volume {
                bar: ColourBar::of_volume(&title, volume),
                title,
                histogram: function
                    .as_ref()
                    .zip(values)
                    .map(|(function, values)| Histogram::of(values, function)),
                function,
            }
        })
        .collect()
}

/// Scene and its current picture.
struct Stage {
    scene: u64,
    /// Renderer of one kernel per sample.
    renderer: Renderer,
    /// Source of refined kernels for pictures at rest.
    refinable: Option<Refinable>,
    /// The window's device, if pictures stay on it.
    window: Option<Gpu>,
    controller: Controller,
    /// Transfer functions of the volumes.
    functions: Vec<Option<TransferFunction>>,
    view: Option<View>,
    drawn: Option<Drawn>,
    /// Number of refinement steps that are left.
    left: u32,
    /// True if the last picture was of a motion.
    is_moving: bool,
}

impl Stage {
    /// Draws a new view as coarsely as the frame time requires.
    fn show(&mut self, shared: &Arc<Shared>, view: View) -> ewa_splat::Result<()> {
        if view.scene != self.scene {
            return Ok(());
        }
        for (i, (function, old)) in view.functions.iter().zip(&mut self.functions).enumerate() {
            if let Some(new) = function
                && function != old
            {
                self.renderer.set_transfer_function(i, new.clone())?;
                old.clone_from(function);
            }
        }
        let coarseness = self.controller.next(view.settings.tolerance);
        self.view = Some(view);
        let begun = Instant::now();
        // This picture is never cancelled, so that motion is visible: it takes no longer than a
        // frame.
        self.draw(shared, coarseness, Effort::Motion, None)?;
        let time = begun.elapsed();
        self.controller.took(time);
        // A full picture is not drawn again, unless it gains at rest. If the next one will be quick, no
        // intermediate step is drawn.
        let is_whole = self
            .view
            .as_ref()
            .is_some_and(|view| coarseness == Coarseness::none(view.settings.tolerance));
        let samples = |view: &View| self.renderer.may_sample_edges(&view.settings);
        let gains = self.refinable.is_some() || self.view.as_ref().is_some_and(samples);
        self.left = match time.as_secs_f32() / coarseness.share {
            _ if is_whole && !gains => 1,
            whole if is_whole || whole < SOON => 2,
            _ => 3,
        };
        self.is_moving = true;
        Ok(())
    }

    /// Returns the time to wait before the next refinement; `None` if none is left.
    fn patience(&self) -> Option<Duration> {
        match self.left {
            0 => None,
            _ if self.is_moving => Some(REST),
            _ => Some(Duration::ZERO),
        }
    }

    /// Runs the next step from a coarse picture to the one asked for, and then to its error.
    fn refine(&mut self, shared: &Arc<Shared>) -> ewa_splat::Result<()> {
        let Some(view) = &self.view else {
            self.left = 0;
            return Ok(());
        };
        let asked = view.settings.tolerance;
        self.is_moving = false;
        let task = begin(shared, Purpose::Picture);
        match self.left {
            3 => {
                let looser = Coarseness::none(asked * FIRST_STEP);
                self.draw(shared, looser, Effort::Motion, Some(task))?;
            }
            2 => self.draw(shared, Coarseness::none(asked), Effort::Rest, Some(task))?,
            _ => {
                let settings = Settings {
                    task: Some(task.clone()),
                    ..view.settings.clone()
                };
                let camera = view.camera.clone();
                let view = view.clone();
                // The error is sampled only for kernels composited one by one. Counts and choices have none.
                let is_measured = matches!(settings.composite, Composite::Over)
                    && matches!(settings.show, Show::Scene);
                let shows_error = view.instead == Some(Instead::Error);
                let Some(mut drawn) = self.drawn.clone() else {
                    self.left = 0;
                    return Ok(());
                };
                if is_measured {
                    let renderer = self.best(&view, std::slice::from_ref(&camera), &task)?;
                    let sample = ErrorSample::draw(renderer, &camera, &settings)?;
                    // The picture is drawn once more if it is shown as another image or is on the
                    // device only.
                    let image = match &drawn.picture {
                        Picture::Pixels(image) if view.instead.is_none() || shows_error => {
                            Arc::clone(image)
                        }
                        _ => Arc::new(renderer.render(&camera, &settings)?.clone()),
                    };
                    drawn.error = Some(sample.error_of(&image));
                    if shows_error {
                        let exact = accurate(&settings);
                        let truth = renderer.render(&camera, &exact)?;
                        let errors = instead::errors(&image, truth, settings.tolerance);
                        drawn.picture = Picture::Pixels(Arc::new(errors));
                    }
                }
                drawn.is_final = true;
                self.tell(shared, drawn);
            }
        }
        self.left -= 1;
        Ok(())
    }

    /// Returns the renderer of pictures at rest: of refined kernels if any is refined.
    ///
    /// - `cameras`: cameras of the pictures.
    fn best(
        &mut self,
        view: &View,
        cameras: &[Camera],
        task: &Task,
    ) -> ewa_splat::Result<&mut Renderer> {
        if let Some(refinable) = &mut self.refinable
            && let Some(renderer) = refinable.renderer(view, cameras, task)?
        {
            return Ok(renderer);
        }
        Ok(&mut self.renderer)
    }

    fn draw(
        &mut self,
        shared: &Arc<Shared>,
        coarseness: Coarseness,
        effort: Effort,
        task: Option<Task>,
    ) -> ewa_splat::Result<()> {
        let Some(view) = self.view.clone() else {
            return Ok(());
        };
        let size = coarseness.size([view.camera.width, view.camera.height]);
        let camera = scaled(&view.camera, size);
        let settings = Settings {
            tolerance: coarseness.tolerance,
            advanced: Advanced {
                merge_slack: coarseness.merge_slack,
                opaque_edges: effort == Effort::Rest && view.settings.advanced.opaque_edges,
                ..view.settings.advanced
            },
            classify: coarseness.classification(view.settings.classify),
            depth: view.instead == Some(Instead::Depth),
            normals: view.instead == Some(Instead::Normals),
            task: task.clone(),
            ..view.settings.clone()
        };
        // Samples of opaque edges are averaged in memory, not in textures.
        let window = self.window.clone();
        let window = window.filter(|_| !self.renderer.may_sample_edges(&settings));
        let renderer = match (effort, &task) {
            (Effort::Rest, Some(task)) => self.best(&view, std::slice::from_ref(&camera), task)?,
            _ => &mut self.renderer,
        };
        let picture = match (view.instead, window) {
            (None | Some(Instead::Error), Some(gpu)) => {
                let texture = texture(&gpu, size);
                renderer.render_to_texture(&camera, &settings, &texture)?;
                Picture::Texture(Arc::new(texture))
            }
            (instead, _) => {
                let image = renderer.render(&camera, &settings)?.clone();
                let image = match instead {
                    Some(Instead::Depth) => renderer.depth().map(instead::depths),
                    Some(Instead::Normals) => renderer.normals().map(instead::normals),
                    _ => Some(image),
                };
                Picture::Pixels(Arc::new(image.unwrap_or_default()))
            }
        };
        let (counts, times) = (renderer.counts(), renderer.times());
        let drawn = Drawn {
            number: view.number,
            picture,
            coarseness,
            is_final: false,
            error: None,
            counts,
            times,
        };
        self.tell(shared, drawn);
        Ok(())
    }

    /// Draws the reference image of the kernels in place of the picture, and reports the picture's
    /// error.
    fn draw_truth(&mut self, shared: &Arc<Shared>, load: &Load) -> ewa_splat::Result<()> {
        let Some(view) = self.view.clone().filter(|view| view.scene == load.scene) else {
            return Err(Error::Cancelled);
        };
        let task = begin(shared, Purpose::Truth);
        let (chosen, field) = (&load.chosen, load.field.as_deref());
        let cameras = std::slice::from_ref(&view.camera);
        let refinable = self.refinable.as_ref();
        let refined = refinable.and_then(|own| own.view(&view, cameras));
        let request = &load.request;
        let mut scene = request.read(field, chosen, load.step, refined.as_ref(), &task)?;
        if !scene.prepared.is_empty() {
            return Err(Error::invalid(
                "the reference image",
                "inputs",
                "the data themselves",
                "a prepared scene, which keeps its particles alone",
                "open the data",
            ));
        }
        for (volume, function) in scene.volumes.iter_mut().zip(&view.functions) {
            if let Some(function) = function {
                volume.transfer_function = Some(function.clone());
            }
        }
        let settings = Settings {
            task: Some(task.clone()),
            // The reference image is unlit.
            lighting: None,
            ..view.settings.clone()
        };
        let renderer = self.best(&view, cameras, &task)?;
        let image = renderer.render(&view.camera, &settings)?.clone();
        let (counts, times) = (renderer.counts(), renderer.times());
        let truth = Integrator::classified(&scene.volumes, settings.classify)?
            .clipped(&settings.clip)
            .render(
                &view.camera,
                &ReferenceSettings {
                    low_pass_variance_px2: settings.low_pass_variance_px2.into(),
                    background: settings.background,
                    // The error is far below that allowed for splatting.
                    error: f64::from(settings.tolerance) * TRUTH_SHARE,
                    task: Some(task),
                    ..ReferenceSettings::default()
                },
            )?
            .image;
        let errors = compare(&image, &truth)?;
        self.left = 0;
        let drawn = Drawn {
            number: view.number,
            picture: Picture::Pixels(Arc::new(truth)),
            coarseness: Coarseness::none(view.settings.tolerance),
            is_final: true,
            error: None,
            counts,
            times,
        };
        self.tell(shared, drawn);
        shared.tell(News::True(errors));
        Ok(())
    }

    fn tell(&mut self, shared: &Shared, drawn: Drawn) {
        self.drawn = Some(drawn.clone());
        shared.tell(News::Drawn(Box::new(drawn)));
    }

    fn pick(&mut self, shared: &Shared, pixel: [usize; 2]) -> ewa_splat::Result<()> {
        if let Some(view) = &self.view {
            let picked = self.renderer.pick(&view.camera, &view.settings, pixel)?;
            shared.tell(News::Picked(picked));
        }
        Ok(())
    }

    fn write(
        &mut self,
        shared: &Arc<Shared>,
        view: &View,
        over: &Overlay,
        path: PathBuf,
    ) -> ewa_splat::Result<()> {
        if view.scene == self.scene {
            let task = begin(shared, Purpose::Film);
            let cameras = std::slice::from_ref(&view.camera);
            let renderer = self.best(view, cameras, &task)?;
            let image = renderer.render(&view.camera, &view.settings)?;
            write_image(&path, &*over.drawn(image, &view.camera)?)?;
            shared.tell(News::Written(path));
        }
        Ok(())
    }

    /// Draws all pictures of a film and writes them.
    fn film(&mut self, shared: &Arc<Shared>, film: &Film) -> ewa_splat::Result<()> {
        let Film {
            view,
            cameras,
            over,
            path,
        } = film;
        let Some(first) = cameras.first().filter(|_| view.scene == self.scene) else {
            return Err(Error::Cancelled);
        };
        let task = begin(shared, Purpose::Film);
        let settings = Settings {
            task: Some(task.clone()),
            ..view.settings.clone()
        };
        let renderer = self.best(view, cameras, &task)?;
        let size = [first.width, first.height];
        let mut animation = Animation::new(path, size, cameras.len(), RATE)?;
        for (i, camera) in cameras.iter().enumerate() {
            let done = format!("picture {} of {}", i + 1, cameras.len());
            shared.tell(News::Progress(done));
            let image = renderer.render(camera, &settings)?;
            animation.push(&*over.drawn(image, camera)?)?;
        }
        animation.finish()?;
        shared.tell(News::Filmed(path.clone()));
        Ok(())
    }
}

/// Creates a texture on the window's device for a picture of this size.
fn texture(gpu: &Gpu, [width, height]: [usize; 2]) -> wgpu::Texture {
    #[expect(clippy::cast_possible_truncation, reason = "no larger than a screen")]
    let size = wgpu::Extent3d {
        width: width as u32,
        height: height as u32,
        depth_or_array_layers: 1,
    };
    gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("picture"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// Returns the camera for the same view in a picture of another size.
fn scaled(camera: &Camera, size: [usize; 2]) -> Camera {
    let scale = glam::DVec2::new(
        size[0] as f64 / camera.width as f64,
        size[1] as f64 / camera.height as f64,
    );
    Camera {
        focal_px: camera.focal_px * scale,
        centre_px: camera.centre_px * scale,
        width: size[0],
        height: size[1],
        ..camera.clone()
    }
}
