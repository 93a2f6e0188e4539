//! `ewa-splat view`, and what the window takes of the command line: the options of `render` that a window understands.

use std::ffi::OsString;
use std::ops::Range;
use std::path::PathBuf;
use std::process::Command as Process;
use std::sync::{Arc, OnceLock};

use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};
use indicatif::ProgressBar;

use super::render::{self, BackendName};
use super::scene::Scene;
use super::source::Input;
use super::together::Series;
use super::viewpoint::{Canvas, left_of};
use crate::io::Up;
use crate::prepared::PreparedScene;
use crate::sample::{BoundaryChoice, SampleOptions, TransferChoice};
use crate::scene::{PointVolume, ScaleName};
use crate::view::{Bounds, Camera};
use crate::{Backend, Error, Renderer, Result, SceneOptions, Settings, Task};

/// The window's program.
const PROGRAM: &str = "ewa-splat-view";

/// Options of `render` that say what is written, of which a window writes nothing: by their identifiers.
const OF_FILES: [&str; 17] = [
    "out",
    "stats",
    "depth",
    "normals",
    "frames",
    "write_transfer_function",
    "reference",
    "column_density",
    "column_mean",
    "turntable",
    "camera_path",
    "rate",
    "measure_error",
    "calibrate",
    "scale_bar",
    "title",
    "time_stamp",
];

#[derive(Args)]
pub(crate) struct Arguments {
    /// Files and options: those of `render` that say nothing of files to write
    #[arg(
        value_name = "INPUT",
        required = true,
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    words: Vec<OsString>,
}

/// Hands over to the window's program.
///
/// # Errors
/// A program that is neither beside this one nor on the path, or that fails.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let name = format!("{PROGRAM}{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok();
    let beside = beside.and_then(|own| Some(own.parent()?.join(&name)));
    let program = beside.filter(|path| path.is_file());
    let program = program.unwrap_or_else(|| PathBuf::from(&name));
    let status = Process::new(&program)
        .args(&arguments.words)
        .status()
        .map_err(|e| {
            let advice = "install the window: cargo install ewa-splat-view";
            Error::io(&program, "starting the window", e, advice)
        })?;
    match status.code() {
        Some(0) => Ok(()),
        // It has said why.
        code => std::process::exit(code.unwrap_or(1)),
    }
}

/// What a window was asked to show, in the words of `render`.
pub struct Asked {
    arguments: Arc<render::Arguments>,
    given: Vec<(String, Option<String>)>,
    /// What the steps of a series share.
    series: OnceLock<Series>,
    boundary: BoundaryChoice,
    /// What the window asked for in place of the options.
    automatic: Option<Automatic>,
}

/// How a transfer function is found from the values: `--transfer-function NAME`, `--range`, `--scale`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Automatic {
    /// The name of a colour map; `None` chooses one.
    pub map: Option<String>,
    /// The range of values; `None` looks at them.
    pub range: Option<[f64; 2]>,
    /// Where values lie between its ends; `None` looks at them.
    pub scale: Option<ScaleName>,
}

/// What is drawn over the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Over {
    /// A colour bar for each transfer function.
    pub legend: bool,
    /// The directions of x, y and z.
    pub axes: bool,
    /// The box of the data.
    pub outline: bool,
}

/// A picture that a camera is fitted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Columns at the right that are left free for a [legend](crate::legend::legend_width).
    pub legend_px: usize,
    /// A box that is seen whole, whatever planes cut off.
    pub outline: Option<Bounds>,
}

/// What was read for a window.
pub struct Shown {
    /// The volumes, ready to be sorted into blocks; without particles those that stand for prepared scenes'.
    pub volumes: Vec<PointVolume>,
    /// Prepared scenes, and which volumes stand for those of each.
    pub prepared: Vec<(Range<usize>, PreparedScene)>,
    /// What each volume shows: the name of its field.
    pub fields: Vec<Option<String>>,
    /// What legends call these.
    pub titles: Vec<Option<String>>,
    /// What can be shown of the first input: its fields, and components of vectors.
    pub selectors: Vec<String>,
    /// The box of all data; `None` where nothing has a place.
    pub bounds: Option<Bounds>,
    /// Whether any of the data can end sharply at its boundary.
    pub has_boundary: bool,
    /// What points up.
    pub up: Up,
}

impl std::fmt::Debug for Asked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Asked").finish_non_exhaustive()
    }
}

impl Shown {
    /// Sorts the volumes into blocks; none are left.
    ///
    /// # Errors
    /// Those of [`Renderer::with_options`].
    pub fn renderer(&mut self, options: &SceneOptions) -> Result<Renderer> {
        let volumes = std::mem::take(&mut self.volumes);
        super::prepared::renderer(volumes, std::mem::take(&mut self.prepared), options)
    }
}

impl std::fmt::Debug for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shown")
            .field("fields", &self.fields)
            .finish_non_exhaustive()
    }
}

impl Asked {
    /// The options, added to those that a program has already.
    pub fn options(command: Command) -> Command {
        let mut command = render::Arguments::augment_args(command);
        for name in OF_FILES {
            command = command.mut_arg(name, |option| option.hide(true));
        }
        command.mut_arg("out", |out| {
            out.required(false).default_value("picture.png")
        })
    }

    /// What was asked for.
    ///
    /// # Errors
    /// Options that say what is written, and those that clap takes for wrong.
    pub fn of(matches: &ArgMatches) -> Result<Self> {
        let is_given = |name: &&&str| matches.value_source(name) == Some(ValueSource::CommandLine);
        if let Some(name) = OF_FILES.iter().find(is_given) {
            return Err(Error::invalid(
                "view",
                "use",
                "what is to be shown",
                format!("--{}", name.replace('_', "-")),
                "leave it out, or use `ewa-splat render`",
            ));
        }
        let arguments = render::Arguments::from_arg_matches(matches);
        let mut arguments = arguments.unwrap_or_else(|error| error.exit());
        arguments.take_axes();
        Ok(Self {
            boundary: arguments.data.sample_options().boundary,
            arguments: Arc::new(arguments),
            given: given(matches),
            series: OnceLock::new(),
            automatic: None,
        })
    }

    /// The options that were given, without dashes, and the value of each that has one.
    pub fn given(&self) -> &[(String, Option<String>)] {
        &self.given
    }

    /// What was asked for over the picture.
    pub fn over(&self) -> Over {
        let annotations = &self.arguments.annotations;
        Over {
            legend: self.arguments.legend.legend,
            axes: annotations.has_axes(),
            outline: annotations.has_outline(),
        }
    }

    /// How the data end at their boundary.
    pub fn boundary(&self) -> BoundaryChoice {
        self.boundary
    }

    /// The same with another end of the data, among the options that were given, too.
    #[must_use]
    pub fn with_boundary(&self, boundary: BoundaryChoice) -> Self {
        let name = match boundary {
            BoundaryChoice::Automatic => None,
            BoundaryChoice::Sharp => Some("sharp"),
            BoundaryChoice::Soft => Some("soft"),
        };
        let others = self.given.iter().filter(|(name, _)| name != "boundary");
        let own = name.map(|name| ("boundary".to_owned(), Some(name.to_owned())));
        Self {
            arguments: Arc::clone(&self.arguments),
            given: others.cloned().chain(own).collect(),
            series: OnceLock::new(),
            boundary,
            automatic: self.automatic.clone(),
        }
    }

    /// How functions are found from the values.
    pub fn automatic(&self) -> Automatic {
        if let Some(automatic) = &self.automatic {
            return automatic.clone();
        }
        let options = self.arguments.data.sample_options();
        Automatic {
            map: match options.transfer {
                TransferChoice::Named(name) => Some(name),
                _ => None,
            },
            range: options.range,
            scale: options.scale,
        }
    }

    /// The same with functions that are found so, among the options that were given, too. Inputs that name functions of
    /// their own keep them.
    #[must_use]
    pub fn with_automatic(&self, automatic: &Automatic) -> Self {
        const NAMES: [&str; 3] = ["transfer-function", "range", "scale"];
        let others = self.given.iter();
        let others = others.filter(|(name, _)| !NAMES.contains(&name.as_str()));
        let values = [
            automatic.map.clone(),
            automatic.range.map(|[lo, hi]| format!("{lo},{hi}")),
            automatic.scale.map(|scale| scale.name().to_owned()),
        ];
        let own = NAMES.into_iter().zip(values);
        let own = own.filter_map(|(name, value)| Some((name.to_owned(), Some(value?))));
        Self {
            arguments: Arc::clone(&self.arguments),
            given: others.cloned().chain(own).collect(),
            series: OnceLock::new(),
            boundary: self.boundary,
            automatic: Some(automatic.clone()),
        }
    }

    /// The size of the picture, where one was asked for.
    pub fn size(&self) -> Option<[usize; 2]> {
        self.arguments.size
    }

    /// The files that were named, with what is said of each: `FILE@FIELD@FUNCTION`.
    pub fn inputs(&self) -> Vec<String> {
        let text = |input: &Input| {
            let parts = [&input.field, &input.function];
            let said = parts.iter().rposition(|part| part.is_some());
            let said = said.map_or(&parts[..0], |last| &parts[..=last]);
            let mut text = input.path.display().to_string();
            for part in said {
                text.push('@');
                text.push_str(part.as_deref().unwrap_or_default());
            }
            text
        };
        self.arguments.inputs.iter().map(text).collect()
    }

    /// The files and folders that were named.
    pub fn files(&self) -> Vec<PathBuf> {
        let inputs = self.arguments.inputs.iter();
        inputs.map(|input| input.path.clone()).collect()
    }

    /// The inputs that are chosen, as steps of time where they are a series.
    fn chosen(&self, chosen: &[bool]) -> Result<Vec<Input>> {
        let arguments = &*self.arguments;
        let named = arguments.inputs.iter().enumerate();
        let named = named.filter(|(i, _)| chosen.get(*i) != Some(&false));
        let named = named.map(|(_, input)| input.clone()).collect();
        arguments.data.inputs(named, arguments.sequence.is_series())
    }

    /// The steps of a series (`--series`), each with its time where a file states it; none of one picture.
    ///
    /// # Errors
    /// Collections that cannot be read.
    pub fn steps(&self) -> Result<Vec<Option<f64>>> {
        if !self.arguments.sequence.is_series() {
            return Ok(Vec::new());
        }
        let inputs = self.chosen(&[])?;
        let steps = inputs.chunk_by(|a, b| a.step == b.step);
        Ok(steps.map(|step| step[0].time).collect())
    }

    /// Reads and samples what was asked for.
    ///
    /// - `field`: shown instead of the one that was asked for.
    /// - `chosen`: which of the inputs, all of them where it says nothing of one.
    /// - `step`: of a series.
    /// - `task`: watches the work, and ends it.
    ///
    /// # Errors
    /// Those of `render`.
    pub fn read(
        &self,
        field: Option<&str>,
        chosen: &[bool],
        step: usize,
        task: &Task,
    ) -> Result<Shown> {
        let arguments = &*self.arguments;
        arguments.method.check()?;
        let mut inputs = self.chosen(chosen)?;
        let mut options = arguments.sample_options(Some(task.clone()));
        options.boundary = self.boundary;
        if let Some(automatic) = &self.automatic {
            let Automatic { map, range, scale } = automatic.clone();
            options.transfer = map.map_or(TransferChoice::Automatic, TransferChoice::Named);
            (options.range, options.scale) = (range, scale);
        }
        if let Some(field) = field {
            options.field = Some(field.to_owned());
        }
        if arguments.sequence.is_series() {
            options = self
                .of_all_steps(&inputs, &options, field)?
                .of_step(&options);
            let steps: Vec<usize> = inputs
                .chunk_by(|a, b| a.step == b.step)
                .map(|step| step[0].step)
                .collect();
            let wanted = steps.get(step).copied();
            inputs.retain(|input| Some(input.step) == wanted);
        }
        let silent = ProgressBar::hidden();
        let planes = arguments.clip_planes();
        let canvas = Canvas::of(arguments.size);
        let cameras = |boxes: &[Bounds], up: Up| {
            let boxes = left_of(boxes.to_vec(), &planes);
            Ok(vec![arguments.camera.camera(&boxes, up, &canvas)?])
        };
        let scene = arguments.data.scene(&inputs, &options, &cameras, &silent)?;
        arguments.method.check_use(&scene.volumes)?;
        let bounds = scene.bounds();
        let Scene {
            mut volumes,
            prepared,
            fields,
            titles,
            selectors,
            up,
            has_boundary,
            ..
        } = scene;
        if arguments.cut.cut_faces {
            super::prepared::refuse_beside(&prepared, &[("--cut-faces", true)])?;
            super::cut::add_faces(&mut volumes, &planes, arguments.is_lit())?;
        }
        Ok(Shown {
            volumes,
            prepared,
            fields,
            titles,
            selectors,
            bounds,
            has_boundary,
            up,
        })
    }

    /// The choices that all steps share. If no field is named, they are found once and kept.
    fn of_all_steps(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        field: Option<&str>,
    ) -> Result<Series> {
        if let (Some(found), None) = (self.series.get(), field) {
            return Ok(found.clone());
        }
        let silent = ProgressBar::hidden();
        let series = self.arguments.data.series(inputs, options, &silent)?;
        if field.is_none() {
            return Ok(self.series.get_or_init(|| series).clone());
        }
        Ok(series)
    }

    /// The boxes that a camera is fitted to.
    pub fn boxes(&self, renderer: &Renderer) -> Vec<Bounds> {
        self.arguments.camera.boxes(renderer)
    }

    /// The camera that `render` would take.
    ///
    /// - `up`: what points up in the data.
    /// - `boxes`: of what is visible.
    ///
    /// # Errors
    /// Those of `render`.
    pub fn camera(&self, up: Up, boxes: Vec<Bounds>, frame: &Frame) -> Result<Camera> {
        let mut boxes = left_of(boxes, &self.arguments.clip_planes());
        boxes.extend(frame.outline);
        let canvas = Canvas {
            room_px: frame.legend_px,
            ..Canvas::of(Some(frame.size))
        };
        self.arguments.camera.camera(&boxes, up, &canvas)
    }

    /// What draws, as `--backend` says.
    pub fn backend(&self) -> Backend {
        match self.arguments.backend {
            BackendName::Auto => Backend::Auto,
            BackendName::Gpu => Backend::Gpu,
            BackendName::Cpu => Backend::Cpu,
        }
    }

    /// How `render` would draw.
    ///
    /// - `suitable`: the variance of the low-pass filter where none was asked for, px².
    pub fn settings(&self, suitable: f32) -> Settings {
        self.arguments
            .settings(self.arguments.method.low_pass.unwrap_or(suitable))
    }
}

/// The options of a line, in the order of the help.
fn given(matches: &ArgMatches) -> Vec<(String, Option<String>)> {
    let command = Asked::options(Command::new(PROGRAM));
    let mut given = Vec::new();
    for option in command.get_arguments() {
        let id = option.get_id().as_str();
        let (Some(name), Some(ValueSource::CommandLine)) =
            (option.get_long(), matches.value_source(id))
        else {
            continue;
        };
        if !option.get_action().takes_values() {
            given.push((name.to_owned(), None));
            continue;
        }
        for values in matches.get_raw_occurrences(id).into_iter().flatten() {
            let texts: Vec<String> = values.map(|v| v.to_string_lossy().into_owned()).collect();
            given.push((name.to_owned(), Some(texts.join(","))));
        }
    }
    given
}

/// An error in the words of the command line.
pub fn line(error: &Error) -> String {
    super::words::line(error)
}
