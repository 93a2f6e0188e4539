//! Runs `ewa-splat view`, and gives the window the options of `render` that apply to it.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command as Process;
use std::sync::{Arc, OnceLock};

use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};
use indicatif::ProgressBar;

use super::render::{self, BackendName};
use super::usage::refuse_beside;
use super::viewpoint::Canvas;
use crate::data::up::Up;
use crate::load::{Input, Loaded, Series};
use crate::sample::{BoundaryChoice, Refinement, SampleOptions, TransferChoice};
use crate::scene::{ScaleName, TransferFunction};
use crate::view::{Bounds, Camera, left_of};
use crate::{Backend, Error, Renderer, Result, Settings, Task};

/// Name of the window's program.
const PROGRAM: &str = "ewa-splat-view";

/// Identifiers of the options of `render` that write files, or that the window does not have.
const OF_FILES: [&str; 36] = [
    "out",
    "stats",
    "depth",
    "normals",
    "frames",
    "write_transfer_function",
    "no_provenance",
    "reference",
    "column_density",
    "column_mean",
    "column_of",
    "weight",
    "turntable",
    "camera_path",
    "rate",
    "measure_error",
    "calibrate",
    "scale_bar",
    "title",
    "time_stamp",
    "depth_in",
    "depth_in_is",
    "depth_in_range",
    "background_image",
    "deep",
    "depth_of",
    "projection",
    "fisheye_fov",
    "fisheye",
    "nside",
    "stereo",
    "aperture",
    "focus",
    "shutter",
    "velocity",
    "exposures",
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

/// Runs the window's program.
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
        // The program has printed its error.
        code => std::process::exit(code.unwrap_or(1)),
    }
}

/// Request to show data in a window, by the options of `render`.
pub struct ViewRequest {
    arguments: Arc<render::Arguments>,
    given: Vec<(String, Option<String>)>,
    /// Choices that the steps of a series share.
    series: OnceLock<Series>,
    boundary: BoundaryChoice,
    /// Choices of the window that replace the options.
    automatic: Option<Automatic>,
}

/// Pictures for which kernels are refined.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedView {
    /// Cameras of the pictures.
    pub cameras: Vec<Camera>,
    /// Tolerance of the pictures.
    pub tolerance: f32,
    /// Transfer function of each input in place of the one that its options choose, if it was edited.
    pub functions: Vec<Option<TransferFunction>>,
}

/// Arguments of the window's program.
#[derive(Debug)]
pub struct ViewArguments {
    /// Request to show data.
    pub request: ViewRequest,
    /// File for a picture of the window, written instead of opening one.
    pub screenshot: Option<PathBuf>,
    /// Number of pictures to time instead of opening a window.
    pub replay: Option<u32>,
}

// Options of the window alone. (A doc comment would be the program's description.)
#[derive(Args)]
struct WindowOptions {
    /// Write a picture of the whole window once nothing is left to be refined, and exit; needs no display
    #[arg(long, value_name = "FILE.png")]
    screenshot: Option<PathBuf>,
    /// Turn once around the data in N pictures and edit the transfer function in N more, say how long they take, and
    /// exit; needs no display
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=10_000),
          conflicts_with = "screenshot")]
    replay: Option<u32>,
}

/// Choice of a transfer function from the values: `--transfer-function NAME`, `--range`, `--scale`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Automatic {
    /// Name of a colour map; `None` chooses one.
    pub map: Option<String>,
    /// Range of values; `None` takes it from the values.
    pub range: Option<[f64; 2]>,
    /// Scale of the values within the range; `None` chooses it from the values.
    pub scale: Option<ScaleName>,
}

/// Overlays drawn over the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Over {
    /// Colour bar for each transfer function.
    pub legend: bool,
    /// Directions of x, y and z.
    pub axes: bool,
    /// Box of the data.
    pub outline: bool,
}

/// Picture that a camera is fitted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Columns at the right that are left free for a [legend](crate::legend::legend_width).
    pub legend_px: usize,
    /// Box that the camera shows whole, even if planes clip the data inside it.
    pub outline: Option<Bounds>,
}

impl std::fmt::Debug for ViewRequest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ViewRequest").finish_non_exhaustive()
    }
}

/// Returns the command of the window's program: its own options and those of `render`.
fn command() -> Command {
    let command = Command::new(PROGRAM)
        .version(env!("CARGO_PKG_VERSION"))
        .about("Shows volumes, particles, splats and meshes in a window")
        .max_term_width(100);
    let mut command = render::Arguments::augment_args(WindowOptions::augment_args(command));
    for name in OF_FILES {
        command = command.mut_arg(name, |option| option.hide(true));
    }
    command.mut_arg("out", |out| {
        out.required(false).default_value("picture.png")
    })
}

impl ViewArguments {
    /// Parses the arguments, of which the first is the program's name. Wrong usage ends the
    /// program.
    ///
    /// # Errors
    /// Options that write files.
    pub fn parse(words: impl Iterator<Item = OsString>) -> Result<Self> {
        let matches = command().get_matches_from(words);
        let window = WindowOptions::from_arg_matches(&matches);
        let WindowOptions { screenshot, replay } = window.unwrap_or_else(|error| error.exit());
        Ok(Self {
            request: ViewRequest::of(&matches)?,
            screenshot,
            replay,
        })
    }
}

impl ViewRequest {
    /// Creates the request to show some files with default options.
    ///
    /// # Errors
    /// No files.
    pub fn of_files(paths: Vec<PathBuf>) -> Result<Self> {
        let words = std::iter::once(OsString::from(PROGRAM));
        let words = words.chain(paths.into_iter().map(Into::into));
        let matches = command().try_get_matches_from(words).map_err(|error| {
            let found = error.to_string();
            Error::invalid("view", "inputs", "files", found, "name some")
        })?;
        Self::of(&matches)
    }

    /// Creates a request from parsed arguments.
    ///
    /// # Errors
    /// Options that write files.
    fn of(matches: &ArgMatches) -> Result<Self> {
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
        arguments.pass_on();
        Ok(Self {
            boundary: arguments.data.sample_options().kernels.boundary,
            arguments: Arc::new(arguments),
            given: given(matches),
            series: OnceLock::new(),
            automatic: None,
        })
    }

    /// Returns the options that were given, without dashes, each with its value if it has one.
    pub fn given(&self) -> &[(String, Option<String>)] {
        &self.given
    }

    /// Returns the overlays that were asked for.
    pub fn over(&self) -> Over {
        let annotations = &self.arguments.annotations;
        Over {
            legend: self.arguments.legend.legend,
            axes: annotations.has_axes(),
            outline: annotations.has_outline(),
        }
    }

    /// Returns true if kernels may be refined for pictures.
    pub fn refines(&self) -> bool {
        self.arguments.refinement().is_some()
    }

    /// Returns the treatment of the data's boundary.
    pub fn boundary(&self) -> BoundaryChoice {
        self.boundary
    }

    /// Returns this request with another treatment of the boundary, also among the given options.
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

    /// Returns the choice of transfer functions from the values.
    pub fn automatic(&self) -> Automatic {
        if let Some(automatic) = &self.automatic {
            return automatic.clone();
        }
        let options = self.arguments.data.sample_options();
        Automatic {
            map: match options.function.transfer {
                TransferChoice::Named(name) => Some(name),
                _ => None,
            },
            range: options.function.range,
            scale: options.function.scale,
        }
    }

    /// Returns this request with another choice of transfer functions, also among the given
    /// options. Inputs that name their own functions keep them.
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

    /// Returns the size of the picture, if one was asked for.
    pub fn size(&self) -> Option<[usize; 2]> {
        self.arguments.size
    }

    /// Returns the inputs as they were named: `FILE@FIELD@FUNCTION`.
    pub fn inputs(&self) -> Vec<String> {
        self.arguments.inputs.iter().map(Input::to_string).collect()
    }

    /// Returns the paths of the files and folders that were named.
    pub fn files(&self) -> Vec<PathBuf> {
        let inputs = self.arguments.inputs.iter();
        inputs.map(|input| input.path.clone()).collect()
    }

    /// Returns the chosen inputs, expanded to time steps if they are a series.
    fn chosen(&self, chosen: &[bool]) -> Result<Vec<Input>> {
        let arguments = &*self.arguments;
        let named = arguments.inputs.iter().enumerate();
        let named = named.filter(|(i, _)| chosen.get(*i) != Some(&false));
        let named = named.map(|(_, input)| input.clone()).collect();
        arguments.data.inputs(named, arguments.sequence.is_series())
    }

    /// Returns the steps of a series (`--series`), each with its time if a file states it. The list
    /// is empty for a single picture.
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

    /// Reads and samples the inputs.
    ///
    /// - `field`: field to show instead of the one that was asked for.
    /// - `chosen`: whether to read each input; inputs beyond its end are read.
    /// - `step`: step of a series.
    /// - `refined`: pictures for which kernels are refined; `None` makes one kernel per sample.
    /// - `task`: reports the progress and can cancel the work.
    ///
    /// # Errors
    /// The errors of `render`.
    pub fn read(
        &self,
        field: Option<&str>,
        chosen: &[bool],
        step: usize,
        refined: Option<&RefinedView>,
        task: &Task,
    ) -> Result<Loaded> {
        let arguments = &*self.arguments;
        arguments.method.check()?;
        let mut inputs = self.chosen(chosen)?;
        let mut options = arguments.sample_options(Some(task.clone()));
        options.kernels.boundary = self.boundary;
        options.refinement = match (options.refinement, refined) {
            (Some(_), Some(refined)) => Some(Refinement::for_tolerance(refined.tolerance)),
            _ => None,
        };
        if let Some(automatic) = &self.automatic {
            let Automatic { map, range, scale } = automatic.clone();
            options.function.transfer =
                map.map_or(TransferChoice::Automatic, TransferChoice::Named);
            (options.function.range, options.function.scale) = (range, scale);
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
        let functions = refined.map_or(&[][..], |refined| &refined.functions);
        for (input, function) in inputs.iter_mut().zip(functions) {
            input.transfer.clone_from(function);
        }
        let silent = ProgressBar::hidden();
        let planes = arguments.clip_planes();
        let canvas = Canvas::of(arguments.size);
        let cameras = |boxes: &[Bounds], up: Up| {
            if let Some(refined) = refined {
                return Ok(refined.cameras.clone());
            }
            let boxes = left_of(boxes.to_vec(), &planes);
            Ok(vec![arguments.camera.camera(&boxes, up, &canvas)?])
        };
        let mut scene = arguments.data.scene(&inputs, &options, &cameras, &silent)?;
        arguments.method.check_use(&scene.volumes)?;
        if arguments.cut.cut_faces {
            refuse_beside(&scene.prepared, &[("--cut-faces", true)])?;
            super::cut::add_faces(&mut scene.volumes, &planes, arguments.is_lit())?;
        }
        Ok(scene)
    }

    /// Returns the choices that all steps share. If no field is named, they are found once and
    /// kept.
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

    /// Returns the boxes that a camera is fitted to.
    pub fn boxes(&self, renderer: &Renderer) -> Vec<Bounds> {
        self.arguments.camera.boxes(renderer)
    }

    /// Returns the camera that `render` would use.
    ///
    /// - `up`: direction up of the data.
    /// - `boxes`: boxes of what is visible.
    ///
    /// # Errors
    /// The errors of `render`.
    pub fn camera(&self, up: Up, boxes: Vec<Bounds>, frame: &Frame) -> Result<Camera> {
        let mut boxes = left_of(boxes, &self.arguments.clip_planes());
        boxes.extend(frame.outline);
        let canvas = Canvas {
            room_px: frame.legend_px,
            ..Canvas::of(Some(frame.size))
        };
        self.arguments.camera.camera(&boxes, up, &canvas)
    }

    /// Returns the backend that `--backend` names.
    pub fn backend(&self) -> Backend {
        match self.arguments.backend {
            BackendName::Auto => Backend::Auto,
            BackendName::Gpu => Backend::Gpu,
            BackendName::Cpu => Backend::Cpu,
        }
    }

    /// Returns the settings that `render` would use.
    ///
    /// - `suitable`: default variance of the low-pass filter, px².
    pub fn settings(&self, suitable: f32) -> Settings {
        self.arguments
            .settings(self.arguments.method.low_pass.unwrap_or(suitable))
    }
}

/// Returns the options of a command line, in the order of the help.
fn given(matches: &ArgMatches) -> Vec<(String, Option<String>)> {
    let command = command();
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

/// Formats an error with the options of the command line.
pub fn line(error: &Error) -> String {
    super::words::line(error)
}
