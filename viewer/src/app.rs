//! What the window shows: its state, which panels change, and what the worker is told of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use egui::{Context, ViewportCommand};
use ewa_splat::Settings;
use ewa_splat::command::{Asked, Automatic, Frame, Over, line};
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
use crate::watch::Watch;
use crate::worker::{Drawn, Film, Load, Loaded, News, View, Worker};

/// What stands behind pictures without a background, linear.
const BACKGROUND: [f32; 3] = [0.0116, 0.0116, 0.0152];

/// The window.
pub(crate) struct App {
    pub(crate) asked: Arc<Asked>,
    pub(crate) inputs: Vec<String>,
    /// Which inputs are shown.
    pub(crate) chosen: Vec<bool>,
    pub(crate) field: Option<String>,
    worker: Worker,
    /// The number of the last [`Load`].
    scene: u64,
    /// How many there were.
    scenes: u64,
    /// Whether it is of other data than what was shown.
    is_new: bool,
    /// What is shown while another is read, and stays where that cannot be.
    good: Option<Source>,
    pub(crate) loaded: Option<Loaded>,
    pub(crate) settings: Settings,
    pub(crate) orbit: Option<Orbit>,
    /// The camera that the data were first seen by.
    pub(crate) home: Option<Orbit>,
    /// The size of the picture that it is fitted to.
    placed_in: [usize; 2],
    pub(crate) saved: Vec<Orbit>,
    /// The functions of the volumes, where they have any.
    pub(crate) histories: Vec<Option<History>>,
    /// Which volume's function is edited.
    pub(crate) edited: usize,
    /// Which colour stop is chosen.
    pub(crate) stop: Option<usize>,
    pub(crate) logarithmic_counts: bool,
    pub(crate) drawn: Option<Drawn>,
    pub(crate) canvas: Canvas,
    /// What is wrong, or what was done.
    pub(crate) message: Option<Message>,
    /// What is being read, and how far it is.
    pub(crate) progress: Option<String>,
    pub(crate) probe: Option<Probe>,
    pub(crate) shows_panels: bool,
    /// Whether what keys and the mouse do is listed.
    pub(crate) shows_help: bool,
    /// The last view that the worker was told of.
    view: Option<View>,
    /// How many views there were.
    views: u64,
    /// Width and height of the picture in pixels.
    pub(crate) size: [usize; 2],
    pub(crate) flies: bool,
    /// What is shown in place of the picture.
    pub(crate) instead: Option<Instead>,
    pub(crate) output: Output,
    pub(crate) time: Time,
    /// What is switched on over the picture.
    pub(crate) over: Over,
    pub(crate) handles: Handles,
    pub(crate) path: KeyFrames,
    /// What functions are found by, where that is asked for.
    pub(crate) automatic: Automatic,
    /// Whether the functions are to be those that are read, whatever was made of them.
    finds_functions: bool,
    pub(crate) dialogs: Dialogs,
    pub(crate) watch: Watch,
    /// Whether files that have changed are read again.
    pub(crate) follows: bool,
}

/// What was read.
#[derive(Debug, Clone)]
struct Source {
    scene: u64,
    asked: Arc<Asked>,
    inputs: Vec<String>,
    chosen: Vec<bool>,
    field: Option<String>,
    time: Time,
}

/// A line for people.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Message {
    pub(crate) text: String,
    pub(crate) is_error: bool,
}

impl App {
    /// A window that begins to read what was asked for.
    ///
    /// - `canvas`: where its pictures lie.
    pub(crate) fn new(asked: Asked, context: &Context, canvas: Canvas) -> Self {
        let told = context.clone();
        let worker = Worker::new(move || told.request_repaint());
        let mut app = Self {
            inputs: Vec::new(),
            over: Over {
                legend: true,
                axes: true,
                ..asked.over()
            },
            handles: Handles::default(),
            path: KeyFrames::default(),
            automatic: asked.automatic(),
            finds_functions: false,
            dialogs: Dialogs::default(),
            watch: Watch::default(),
            follows: true,
            chosen: Vec::new(),
            field: None,
            asked: Arc::new(asked),
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

    /// Reads what is chosen.
    pub(crate) fn load(&mut self) {
        self.scenes += 1;
        self.scene = self.scenes;
        self.progress = Some("reading".into());
        self.message = None;
        let chosen = self.asked.files();
        self.watch.set(chosen);
        self.worker.load(self.wanted());
    }

    /// Finds the functions from the values, by what is chosen for it.
    pub(crate) fn find_functions(&mut self) {
        self.asked = Arc::new(self.asked.with_automatic(&self.automatic));
        self.finds_functions = true;
        self.load();
    }

    /// Reads files that have changed again, where that is wished for.
    pub(crate) fn follow(&mut self) {
        if self.watch.has_changed() && self.follows && self.progress.is_none() {
            self.load();
        }
    }

    /// What is to be read for what is chosen.
    fn wanted(&self) -> Load {
        Load {
            scene: self.scene,
            asked: Arc::clone(&self.asked),
            field: self.field.clone(),
            chosen: self.chosen.clone(),
            step: self.time.step,
            gpu: self.canvas.device(self.asked.backend()),
        }
    }

    /// Asks for the integral of the kernels in place of the picture.
    pub(crate) fn ask_truth(&mut self) {
        self.progress = Some("the reference image".into());
        self.worker.ask_truth(self.wanted());
    }

    /// Reads other files in place of these.
    pub(crate) fn open(&mut self, paths: Vec<PathBuf>) {
        match crate::arguments::of_files(paths) {
            Ok(asked) => {
                self.automatic = asked.automatic();
                self.asked = Arc::new(asked);
                self.begin();
            }
            Err(text) => self.fail(text),
        }
    }

    /// Ends what is being read, or the reference image.
    pub(crate) fn cancel(&mut self) {
        self.worker.cancel();
    }

    /// Goes back to what is shown, as nothing else can be or is wanted.
    fn stay(&mut self, why: Option<String>) {
        self.progress = None;
        (self.is_new, self.finds_functions) = (false, false);
        if let Some(good) = self.good.clone() {
            let Source {
                scene,
                asked,
                inputs,
                chosen,
                field,
                time,
            } = good;
            (self.scene, self.asked, self.inputs) = (scene, asked, inputs);
            (self.chosen, self.field, self.time) = (chosen, field, time);
            self.automatic = self.asked.automatic();
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

    /// Asks what lies under a pixel.
    pub(crate) fn pick(&mut self, pixel: [usize; 2], recentres: bool) {
        self.probe = Some(Probe::asked(pixel, recentres));
        self.worker.pick(pixel);
    }

    /// Width and height of the pictures that are written.
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

    /// Whether nothing is left to be done.
    pub(crate) fn is_at_rest(&self) -> bool {
        let is_final = self.has_drawn() && self.drawn.as_ref().is_some_and(|d| d.is_final);
        let is_failed = self
            .message
            .as_ref()
            .is_some_and(|message| message.is_error);
        self.progress.is_none() && (is_final || is_failed)
    }

    /// Whether the view that is wanted has been drawn, however coarsely.
    pub(crate) fn has_drawn(&self) -> bool {
        matches!((&self.drawn, &self.view), (Some(drawn), Some(view)) if drawn.number == view.number)
    }

    /// Whether the view that is wanted has been drawn whole, to the asked tolerance.
    pub(crate) fn is_whole(&self) -> bool {
        self.has_drawn()
            && matches!((&self.drawn, &self.view), (Some(drawn), Some(view))
                if drawn.coarseness == Coarseness::none(view.settings.tolerance))
    }

    /// Takes what lies under a pixel, and looks at it where that was asked for.
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

    /// Begins to read what was asked for, all of it and its first step.
    fn begin(&mut self) {
        self.inputs = self.asked.inputs();
        self.chosen = vec![true; self.inputs.len()];
        self.field = None;
        self.is_new = true;
        // What cannot be read says so where it is read.
        self.time = Time::of(self.asked.steps().unwrap_or_default());
        self.load();
    }

    /// Shows another step of a series.
    pub(crate) fn go(&mut self, step: usize) {
        self.time.go(step);
        self.load();
    }

    /// Takes what the worker tells.
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

    /// The title of the window: the first file that is shown, its field, and the program.
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
        // Steps of a series share their functions, and what was made of them; so do files that are read again.
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
            asked: Arc::clone(&self.asked),
            inputs: self.inputs.clone(),
            chosen: self.chosen.clone(),
            field: self.field.clone(),
            time: self.time.clone(),
        });
        self.loaded = Some(loaded);
        self.view = None;
    }

    /// The camera that a command would take for a picture of this size.
    fn place(&mut self) {
        let Some(loaded) = &self.loaded else {
            return;
        };
        let boxes = loaded.boxes.clone();
        let over = self.shown_over();
        // The data stay in the middle, where they are turned, and are as small as beside a legend.
        let frame = Frame {
            size: self.size,
            legend_px: match over.legend {
                true => legend_width(&self.bars(), self.size),
                false => 0,
            },
            outline: loaded.bounds.filter(|_| over.outline),
        };
        let camera = match self.asked.camera(loaded.up, boxes, &frame) {
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

    /// Tells the worker what is to be seen, where that has changed.
    pub(crate) fn show_view(&mut self) {
        // Another field of the same data is seen from where they were; who has not moved sees all of them in a window of any
        // size.
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

    /// Moves the camera of a standard view.
    pub(crate) fn look_along(&mut self, forward: DVec3) {
        if let Some(orbit) = &mut self.orbit {
            orbit.look_along(forward);
        }
    }

    /// The history of the function that is edited.
    pub(crate) fn history(&mut self) -> Option<&mut History> {
        self.histories.get_mut(self.edited)?.as_mut()
    }
}
