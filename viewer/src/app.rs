//! Holds the state of the window, which panels change, and passes requests to the worker.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use egui::{Context, ViewportCommand};
use ewa_splat::Settings;
use ewa_splat::command::{Automatic, Frame, Over, ViewRequest, line};
use ewa_splat::legend::legend_width;
use ewa_splat::render::Picked;
use glam::DVec3;

use crate::canvas::Canvas;
use crate::controller::Coarseness;
use crate::curve::History;
use crate::dialogs::Dialogs;
use crate::handles::Handles;
use crate::instead::Instead;
use crate::orbit::Orbit;
use crate::output::Output;
use crate::path::KeyFrames;
use crate::probe::Probe;
use crate::time::Time;
use crate::wanted::{Film, Load, View};
use crate::watch::Watch;
use crate::worker::{Drawn, Loaded, News, Worker};

/// Linear colour behind pictures without a background.
const BACKGROUND: [f32; 3] = [0.0116, 0.0116, 0.0152];

/// State of the window.
pub(crate) struct App {
    pub(crate) request: Arc<ViewRequest>,
    pub(crate) inputs: Vec<String>,
    /// Flags of the inputs that are shown.
    pub(crate) chosen: Vec<bool>,
    pub(crate) field: Option<String>,
    worker: Worker,
    /// Number of the last [`Load`].
    scene: u64,
    /// Number of loads so far.
    scenes: u64,
    /// True if the load is of other data than those shown.
    is_new: bool,
    /// Source of the scene that is shown, kept while another is read and if reading fails.
    good: Option<Source>,
    pub(crate) loaded: Option<Loaded>,
    pub(crate) settings: Settings,
    pub(crate) orbit: Option<Orbit>,
    /// Camera by which the data were first seen.
    pub(crate) home: Option<Orbit>,
    /// Size of the picture that the camera is fitted to.
    placed_in: [usize; 2],
    pub(crate) saved: Vec<Orbit>,
    /// Transfer functions of the volumes that have one, with their edits.
    pub(crate) histories: Vec<Option<History>>,
    /// Number of the volume whose transfer function is edited.
    pub(crate) edited: usize,
    /// Number of the selected colour stop.
    pub(crate) stop: Option<usize>,
    pub(crate) logarithmic_counts: bool,
    pub(crate) drawn: Option<Drawn>,
    pub(crate) canvas: Canvas,
    /// Last error or message.
    pub(crate) message: Option<Message>,
    /// Progress of the work in the background, if any.
    pub(crate) progress: Option<String>,
    pub(crate) probe: Option<Probe>,
    pub(crate) shows_panels: bool,
    /// True if the list of keys and mouse actions is shown.
    pub(crate) shows_help: bool,
    /// Last view sent to the worker.
    view: Option<View>,
    /// Number of views so far.
    views: u64,
    /// Width and height of the picture in pixels.
    pub(crate) size: [usize; 2],
    pub(crate) flies: bool,
    /// Image shown in place of the picture.
    pub(crate) instead: Option<Instead>,
    pub(crate) output: Output,
    pub(crate) time: Time,
    /// Overlays that are switched on.
    pub(crate) over: Over,
    pub(crate) handles: Handles,
    pub(crate) path: KeyFrames,
    /// Choice of transfer functions from the values.
    pub(crate) automatic: Automatic,
    /// True if the next load replaces edited transfer functions by those that it chooses.
    finds_functions: bool,
    pub(crate) dialogs: Dialogs,
    pub(crate) watch: Watch,
    /// True if changed files are read again.
    pub(crate) follows: bool,
}

/// Inputs of a scene that was read.
#[derive(Debug, Clone)]
struct Source {
    scene: u64,
    request: Arc<ViewRequest>,
    inputs: Vec<String>,
    chosen: Vec<bool>,
    field: Option<String>,
    time: Time,
}

/// Message for the user.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Message {
    pub(crate) text: String,
    pub(crate) is_error: bool,
}

impl App {
    /// Creates a window, which begins to read the data of a request.
    ///
    /// - `canvas`: place of its pictures.
    pub(crate) fn new(request: ViewRequest, context: &Context, canvas: Canvas) -> Self {
        let shared = context.clone();
        let worker = Worker::new(move || shared.request_repaint());
        let mut app = Self {
            inputs: Vec::new(),
            over: Over {
                legend: true,
                axes: true,
                ..request.over()
            },
            handles: Handles::default(),
            path: KeyFrames::default(),
            automatic: request.automatic(),
            finds_functions: false,
            dialogs: Dialogs::default(),
            watch: Watch::default(),
            follows: true,
            chosen: Vec::new(),
            field: None,
            request: Arc::new(request),
            worker,
            scene: 0,
            scenes: 0,
            loaded: None,
            settings: Settings::default(),
            orbit: None,
            home: None,
            placed_in: [0, 0],
            saved: Vec::new(),
            histories: Vec::new(),
            edited: 0,
            stop: None,
            logarithmic_counts: true,
            drawn: None,
            canvas,
            is_new: true,
            good: None,
            message: None,
            progress: None,
            probe: None,
            shows_panels: true,
            shows_help: false,
            view: None,
            views: 0,
            size: [0, 0],
            flies: false,
            instead: None,
            output: Output::default(),
            time: Time::default(),
        };
        app.begin();
        app
    }

    /// Reads the chosen inputs.
    pub(crate) fn load(&mut self) {
        self.scenes += 1;
        self.scene = self.scenes;
        self.progress = Some("reading".into());
        self.message = None;
        let chosen = self.request.files();
        self.watch.set(chosen);
        self.worker.load(self.wanted());
    }

    /// Chooses the transfer functions from the values again.
    pub(crate) fn find_functions(&mut self) {
        self.request = Arc::new(self.request.with_automatic(&self.automatic));
        self.finds_functions = true;
        self.load();
    }

    /// Reads changed files again, if the user asked for this.
    pub(crate) fn follow(&mut self) {
        if self.watch.has_changed() && self.follows && self.progress.is_none() {
            self.load();
        }
    }

    /// Returns the load of the chosen inputs.
    fn wanted(&self) -> Load {
        Load {
            scene: self.scene,
            request: Arc::clone(&self.request),
            field: self.field.clone(),
            chosen: self.chosen.clone(),
            step: self.time.step,
            gpu: self.canvas.device(self.request.backend()),
        }
    }

    /// Requests the reference image in place of the picture.
    pub(crate) fn ask_truth(&mut self) {
        self.progress = Some("the reference image".into());
        self.worker.ask_truth(self.wanted());
    }

    /// Reads other files in place of these.
    pub(crate) fn open(&mut self, paths: Vec<PathBuf>) {
        match ViewRequest::of_files(paths) {
            Ok(request) => {
                self.automatic = request.automatic();
                self.request = Arc::new(request);
                self.begin();
            }
            Err(error) => self.fail(line(&error)),
        }
    }

    /// Cancels the reading, or the reference image.
    pub(crate) fn cancel(&mut self) {
        self.worker.cancel();
    }

    /// Returns to the scene that is shown, if reading failed or was cancelled.
    fn stay(&mut self, why: Option<String>) {
        self.progress = None;
        (self.is_new, self.finds_functions) = (false, false);
        if let Some(good) = self.good.clone() {
            let Source {
                scene,
                request,
                inputs,
                chosen,
                field,
                time,
            } = good;
            (self.scene, self.request, self.inputs) = (scene, request, inputs);
            (self.chosen, self.field, self.time) = (chosen, field, time);
            self.automatic = self.request.automatic();
            self.view = None;
        }
        match why {
            Some(text) => self.fail(text),
            None => self.say("cancelled".into()),
        }
    }

    pub(crate) fn say(&mut self, text: String) {
        let is_error = false;
        self.message = Some(Message { text, is_error });
    }

    pub(crate) fn fail(&mut self, text: String) {
        let is_error = true;
        self.message = Some(Message { text, is_error });
    }

    /// Asks the worker what lies under a pixel.
    pub(crate) fn pick(&mut self, pixel: [usize; 2], recentres: bool) {
        self.probe = Some(Probe::asked(pixel, recentres));
        self.worker.pick(pixel);
    }

    /// Returns the width and height of pictures in files.
    pub(crate) fn picture_size(&self) -> [usize; 2] {
        match self.output.size {
            [0, _] | [_, 0] => self.size,
            size => size,
        }
    }

    /// Draws the view and writes it.
    pub(crate) fn write(&mut self, path: PathBuf) {
        let Some(view) = &self.view else {
            return self.fail("nothing is shown".into());
        };
        let Some(orbit) = &self.orbit else {
            return;
        };
        let view = View {
            camera: orbit.camera(self.picture_size()),
            ..view.clone()
        };
        self.worker.write(view, self.overlay(), path);
    }

    /// Draws the pictures of the key frames and writes them.
    pub(crate) fn film(&mut self, file: PathBuf) {
        let (Some(view), Some(path)) = (&self.view, self.path.path()) else {
            return self.fail("two key frames are wanted, of what is shown".into());
        };
        let film = Film {
            view: view.clone(),
            cameras: path.cameras(self.picture_size()),
            over: self.overlay(),
            path: file,
        };
        self.progress = Some("the film".into());
        self.worker.film(film);
    }

    /// Returns true if no work is left.
    pub(crate) fn is_at_rest(&self) -> bool {
        let is_final = self.has_drawn() && self.drawn.as_ref().is_some_and(|d| d.is_final);
        let is_failed = self
            .message
            .as_ref()
            .is_some_and(|message| message.is_error);
        self.progress.is_none() && (is_final || is_failed)
    }

    /// Returns true if the current view has been drawn, however coarsely.
    pub(crate) fn has_drawn(&self) -> bool {
        matches!((&self.drawn, &self.view), (Some(drawn), Some(view)) if drawn.number == view.number)
    }

    /// Returns true if the current view has been drawn with all pixels, to the tolerance asked for.
    pub(crate) fn is_whole(&self) -> bool {
        self.has_drawn()
            && matches!((&self.drawn, &self.view), (Some(drawn), Some(view))
                if drawn.coarseness == Coarseness::none(view.settings.tolerance))
    }

    /// Stores what lies under a pixel, and centres the view there if this was asked for.
    fn found(&mut self, picked: &[Picked]) {
        let Some(probe) = &mut self.probe else {
            return;
        };
        probe.answer(picked);
        match (&probe.found, &mut self.orbit) {
            (None, _) => self.say("nothing is there".into()),
            (Some(found), Some(orbit)) if probe.recentres => orbit.recentre(found.position),
            _ => {}
        }
    }

    /// Begins to read all inputs, at their first step.
    fn begin(&mut self) {
        self.inputs = self.request.inputs();
        self.chosen = vec![true; self.inputs.len()];
        self.field = None;
        self.is_new = true;
        // Reading reports the errors of inputs that cannot be read.
        self.time = Time::of(self.request.steps().unwrap_or_default());
        self.load();
    }

    /// Shows another step of a series.
    pub(crate) fn go(&mut self, step: usize) {
        self.time.go(step);
        self.load();
    }

    /// Processes the worker's messages.
    pub(crate) fn hear(&mut self, context: &Context) {
        for news in self.worker.news() {
            match news {
                News::Progress(text) => {
                    if self.progress.is_some() {
                        self.progress = Some(text);
                    }
                }
                News::Loaded(loaded) if loaded.scene == self.scene => {
                    self.loaded(*loaded);
                    context.send_viewport_cmd(ViewportCommand::Title(self.title()));
                }
                News::Drawn(drawn) => {
                    self.canvas.show(context, &drawn.picture);
                    self.drawn = Some(*drawn);
                }
                News::NotLoaded(scene, why) if scene == self.scene => self.stay(why),
                News::True(errors) => {
                    self.progress = None;
                    self.say(format!(
                        "the reference image, without light; the splatted picture is off by {:.1e}, {:.1e} at the worst",
                        errors.p999, errors.max
                    ));
                }
                News::Ended => {
                    if self.loaded.as_ref().is_some_and(|l| l.scene == self.scene) {
                        self.progress = None;
                    }
                }
                News::Picked(picked) => self.found(&picked),
                News::Failed(text) => {
                    self.progress = None;
                    self.fail(text);
                }
                News::Filmed(path) => {
                    self.progress = None;
                    self.say(format!("{} is written", path.display()));
                }
                News::Written(path) => self.say(format!("{} is written", path.display())),
                News::Loaded(_) | News::NotLoaded(..) => {}
            }
        }
    }

    /// Returns the title of the window: the first file shown, its field, and the program.
    fn title(&self) -> String {
        let shown = self.inputs.iter().zip(&self.chosen);
        let mut shown = shown.filter_map(|(input, is_chosen)| is_chosen.then_some(input));
        let first = shown.next().map_or("", |input| input.as_str());
        let name = Path::new(first).file_name();
        let mut title = name.map_or(first.into(), |name| name.to_string_lossy().into_owned());
        match shown.count() {
            0 => {}
            more => title += &format!(" and {more} more"),
        }
        let volumes = self.loaded.iter().flat_map(|loaded| &loaded.volumes);
        if let Some(volume) = volumes.into_iter().find(|volume| volume.bar.is_some()) {
            title += &format!(": {}", volume.title);
        }
        title + " - ewa-splat"
    }

    fn loaded(&mut self, loaded: Loaded) {
        self.progress = None;
        let is_new = std::mem::take(&mut self.is_new);
        if is_new {
            self.orbit = None;
            self.settings = Settings {
                background: loaded.settings.background.or(Some(BACKGROUND)),
                ..loaded.settings.clone()
            };
        }
        // Steps of a series, and files that are read again, keep their transfer functions with all
        // edits.
        let titles = |loaded: &Loaded| {
            let volumes = loaded.volumes.iter();
            volumes
                .map(|volume| volume.title.clone())
                .collect::<Vec<_>>()
        };
        let is_alike = self.loaded.as_ref().map(titles) == Some(titles(&loaded));
        let is_edited = self.histories.iter().flatten().any(History::can_undo);
        let is_found = std::mem::take(&mut self.finds_functions);
        if !(is_alike && !is_new && !is_found && (self.time.keeps() || is_edited)) {
            let functions = loaded.volumes.iter().map(|volume| volume.function.clone());
            self.histories = functions.map(|f| f.and_then(History::new)).collect();
            let first = self.histories.iter().position(Option::is_some);
            self.edited = first.unwrap_or(0);
            self.stop = None;
        }
        self.good = Some(Source {
            scene: loaded.scene,
            request: Arc::clone(&self.request),
            inputs: self.inputs.clone(),
            chosen: self.chosen.clone(),
            field: self.field.clone(),
            time: self.time.clone(),
        });
        self.loaded = Some(loaded);
        self.view = None;
    }

    /// Places the camera as a command would for a picture of this size.
    fn place(&mut self) {
        let Some(loaded) = &self.loaded else {
            return;
        };
        let boxes = loaded.boxes.clone();
        let over = self.shown_over();
        // The camera turns around the centre of the data. They are as small as beside a legend, but
        // stay centred.
        let frame = Frame {
            size: self.size,
            legend_px: match over.legend {
                true => legend_width(&self.bars(), self.size),
                false => 0,
            },
            outline: loaded.bounds.filter(|_| over.outline),
        };
        let camera = match self.request.camera(loaded.up, boxes, &frame) {
            Ok(camera) => camera,
            Err(error) => return self.fail(line(&error)),
        };
        let distance = loaded.bounds.map_or(1.0, |(centre, half)| {
            let ahead = (centre - camera.eye).dot(camera.forward());
            if ahead > 0.0 { ahead } else { half.length() }
        });
        let orbit = Orbit::of(&camera, loaded.up.direction, distance);
        self.home = Some(orbit.clone());
        self.orbit = Some(orbit);
        self.placed_in = self.size;
    }

    /// Sends the view to the worker if it has changed.
    pub(crate) fn show_view(&mut self) {
        // Another field of the same data keeps the camera. A camera that has not been moved is
        // fitted again to a window of another size.
        let is_read = self.loaded.as_ref().is_some_and(|l| l.scene == self.scene);
        let is_home = self.orbit == self.home && self.placed_in != self.size;
        if (self.orbit.is_none() || is_home) && is_read && !self.size.contains(&0) {
            self.place();
        }
        let (Some(orbit), Some(loaded)) = (&self.orbit, &self.loaded) else {
            return;
        };
        if self.size.contains(&0) || loaded.scene != self.scene {
            return;
        }
        let functions = self.histories.iter();
        let functions = functions.map(|h| h.as_ref().map(|h| h.function().clone()));
        let view = View {
            scene: self.scene,
            number: self.view.as_ref().map_or(0, |view| view.number),
            camera: orbit.camera(self.size),
            settings: self.settings.clone(),
            instead: self.instead,
            functions: functions.collect(),
        };
        if self.view.as_ref() != Some(&view) {
            self.views += 1;
            let number = self.views;
            let view = View { number, ..view };
            self.worker.show(view.clone());
            self.view = Some(view);
        }
    }

    /// Turns the camera to a standard view.
    pub(crate) fn look_along(&mut self, forward: DVec3) {
        if let Some(orbit) = &mut self.orbit {
            orbit.look_along(forward);
        }
    }

    /// Returns the edited transfer function with its history.
    pub(crate) fn history(&mut self) -> Option<&mut History> {
        self.histories.get_mut(self.edited)?.as_mut()
    }
}
