//! Runs `ewa-splat render`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::Filter;
use crate::collective::Collective;
use crate::image::DARK_GREY;
use crate::io::{
    check_depth_path, check_folder, check_image_path, write_bytes_atomically, write_count,
    write_depth, write_normals,
};
use crate::legend::{ColourBar, legend_width};
use crate::load::prepared::renderer as renderer_of;
use crate::load::{Input, Loaded};
use crate::measure::{ErrorSample, SampledError};
use crate::ranks::Share;
use crate::reference::ReferenceSettings;
use crate::render::{Blend, Classification, ClassifyAt, Composite};
use crate::sample::SampleOptions;
use crate::scene::{Lighting, Particles, PointVolume, ScaleName, TransferFunction};
use crate::stages::blocks::BlockedVolume;
use crate::view::{Bounds, Camera, ClipPlane, Lens};
use crate::{
    Backend, ColumnSettings, Error, Image, Renderer, Result, SceneOptions, Settings, Show, Task,
};
use clap::{Args, ValueEnum};
use indicatif::ProgressBar;
use serde_json::json;

use super::animation::{self, Animation};
use super::annotations::{AnnotationOptions, Overlays};
use super::column_mean::{self, ColumnMean};
use super::count::describe;
use super::cut::{CutOptions, add_faces};
use super::input::DataOptions;
use super::legend::{LegendOptions, bars};
use super::lit::LightOptions;
use super::outputs::{check_collisions, paths, warn_unconverged};
use super::parse::{self, Background, Clip};
use super::progress::{bar, note, spinner, task_of, with_bar};
use super::ranks;
use super::sequence::SequenceOptions;
use super::statistics::{Prepared, stats};
use super::truth::{ReferenceName, Truth};
use super::usage::{CLASSIFIED, is_filtered, is_surface, refuse_beside, refuse_unused};
use super::viewpoint::{CameraOptions, Canvas, left_of};
use super::words;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Files to render together; FILE@FIELD shows another field of one, FILE@FIELD@FUNCTION by another transfer
    /// function
    #[arg(required = true, value_name = "FILE[@FIELD[@FUNCTION]]", value_parser = parse::input())]
    pub(super) inputs: Vec<Input>,
    /// Image to write: png, exr, pfm or npy
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Width and height in pixels [default: 1024x1024]
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    pub(super) size: Option<[usize; 2]>,
    /// What renders
    #[arg(long, value_enum, default_value = "auto")]
    pub(super) backend: BackendName,
    /// Under mpirun or srun: the ranks share the scene and draw it together, on their processors, or draw the pictures
    /// of a sequence in turn; the first writes. The picture is that of one process. (A build with the feature mpi)
    #[arg(long, conflicts_with_all = ["reference", "measure_error", "calibrate", "column_mean"])]
    pub(super) mpi: bool,
    #[command(flatten)]
    pub(super) camera: CameraOptions,
    /// Leave inputs whose formats have other axes than the first has (y up beside z up) as they are, instead of turning
    /// them to it
    #[arg(long, help_heading = "Placement")]
    keep_axes: bool,
    #[command(flatten)]
    pub(super) data: DataOptions,
    #[command(flatten)]
    pub(super) method: Method,
    #[command(flatten)]
    light: LightOptions,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    pub(super) cut: CutOptions,
    #[command(flatten)]
    pub(crate) legend: LegendOptions,
    #[command(flatten)]
    pub(super) sequence: SequenceOptions,
    #[command(flatten)]
    pub(crate) annotations: AnnotationOptions,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum BackendName {
    /// A hardware GPU where there is one or EWA_ADAPTER names one; the CPU otherwise, and for scenes that it
    /// draws before a driver is loaded
    Auto,
    /// A GPU, or a software adapter where there is no other; the environment variable EWA_ADAPTER
    /// chooses one by a part of its name
    Gpu,
    Cpu,
}

#[derive(Args)]
#[command(next_help_heading = "Method")]
pub(super) struct Method {
    /// Error in linear colour that approximations may add to 99.9 % of pixels [default: 1/255]
    #[arg(long, value_name = "T", value_parser = parse::tolerance)]
    tolerance: Option<f32>,
    /// Which footprint draws a kernel; adaptive takes the cheapest that fits the tolerance
    #[arg(long, value_enum, default_value = "adaptive")]
    filter: FilterName,
    /// For adaptive, instead of the tolerance: c_min,c_max of Chen et al. 2004. Kernels nearer than
    /// c_min r_k/r_h are drawn without the low-pass filter, those beyond c_max (1 + 2 tan²(fov/2))
    /// r_k/r_h by it alone; the paper's are 0.3,2
    #[arg(long, value_name = "CMIN,CMAX", value_parser = parse::thresholds)]
    thresholds: Option<[f32; 2]>,
    /// Whether adaptive merges particles far below a pixel
    #[arg(long, value_enum, default_value = "auto", value_name = "auto|off")]
    level_of_detail: Detail,
    /// How kernels that lie behind one another become a picture
    #[arg(long, value_enum, default_value = "over", conflicts_with_all = ["reference", "column_density"])]
    composite: CompositeName,
    /// Thickness of slabs (or sheets) in world units [default: slabs from the tolerance, sheets from
    /// the distance between samples]
    #[arg(long, value_name = "D", value_parser = parse::positive, requires = "composite",
          conflicts_with_all = ["reference", "column_density"])]
    slab_thickness: Option<f64>,
    /// With slabs: ask the transfer function for the mean value of each slab at each pixel, instead of
    /// for each particle
    #[arg(long, conflicts_with_all = ["reference", "column_density"])]
    post_classification: bool,
    /// Space in which colours are composited: auto is encoded for splats of radiance fields alone, as
    /// viewers show them, and linear elsewhere
    #[arg(long, value_enum, default_value = "auto", conflicts_with_all = ["reference", "column_density"])]
    blend: BlendName,
    /// Where the transfer function is asked: over each kernel's extent, with the field's slope, or at
    /// each sample's value alone
    #[arg(long, value_enum, default_value = "extent", conflicts_with_all = ["column_density"])]
    classify: ClassifyName,
    /// Keep the side nx x + ny y + nz z + d >= 0 of everything, or (six numbers) what lies in a box;
    /// again for more, eight planes at most
    #[arg(long, value_name = "nx,ny,nz,d|x0,y0,z0,x1,y1,z1", value_parser = parse::clip,
          allow_hyphen_values = true)]
    clip: Vec<Clip>,
    /// Opacity of an optical depth: 1 - exp(-tau), or min(tau, 1)
    #[arg(long, value_enum, default_value = "exponential")]
    opacity: Opacity,
    /// Variance of the low-pass filter in square pixels [default: 0.15 for volumes with a field, 0.3 for
    /// bare particles, 1 with surfels or splats and for column densities]
    #[arg(long, value_name = "VARIANCE_PX2", value_parser = parse::variance)]
    pub(super) low_pass: Option<f32>,
    /// Cut-off radius in standard deviations [default: from the tolerance]
    #[arg(long, value_name = "R", value_parser = parse::cutoff)]
    cutoff: Option<f32>,
    /// Give kernels smaller than a pixel the opacity that each has alone: right for sparse sets of
    /// opaque particles, too faint where they fill pixels together
    #[arg(long)]
    sub_pixel_opacity: bool,
    /// Draw a hundredth of the picture again with everything exact, and state with --stats, or in
    /// words, what the picture errs by
    #[arg(long, conflicts_with_all = ["reference", "column_density", "show"])]
    measure_error: bool,
    /// Draw as fast as the tolerance allows by measurement instead of by bounds: at the greatest one at which
    /// a sample of the picture errs by less than half of the one that was asked for
    #[arg(long, conflicts_with_all = ["reference", "column_density", "show"])]
    calibrate: bool,
    /// Integrate the true image in f64 instead of splatting: slow, to the error that --tolerance
    /// states [default: 1e-4]; of the kernels, or of the data's own field (one grid)
    #[arg(long, value_enum, value_name = "kernels|data", num_args = 0..=1, require_equals = true,
          default_missing_value = "kernels", hide_possible_values = true,
          conflicts_with_all = ["backend", "filter", "opacity", "cutoff", "depth", "frames",
                                "show", "sub_pixel_opacity"])]
    reference: Option<ReferenceName>,
    /// Write the line integral of the field along each pixel's ray instead of a picture: no
    /// transfer function, no opacity; exr, pfm and npy hold the values, png their logarithm in
    /// viridis, or what --transfer-function NAME, --range and --scale say. Values are means over pixels, or filtered by
    /// --low-pass: below 1 that loses mass of kernels smaller than a pixel
    #[arg(long, conflicts_with_all = ["reference", "opacity", "background", "depth", "flatten",
                                      "opacity_scale", "write_transfer_function", "show",
                                      "sub_pixel_opacity"])]
    column_density: bool,
    /// Beside --column-density: write the mean of this field along each ray, weighed by mass where it is known, or by
    /// what the columns are of
    #[arg(long, value_name = "FIELD")]
    column_mean: Option<String>,
}

/// Appearance of the picture of a column density: the colour map's name, the range of the values
/// and their scale, each if asked for.
pub(crate) struct ColumnLook<'a> {
    pub(crate) map: Option<&'a str>,
    pub(crate) range: Option<[f32; 2]>,
    pub(crate) scale: Option<ScaleName>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum FilterName {
    Adaptive,
    Exact,
    Ewa,
    Reconstruction,
    LowPass,
    Isotropic,
    UniformScaling,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum CompositeName {
    /// Each kernel by itself, in the order of their centres
    Over,
    /// Whole kernels summed in sheets parallel to the image
    Sheets,
    /// Whole kernels summed in sheets across the volume's axis nearest to the view
    AxisSheets,
    /// Kernels sliced into slabs parallel to the image: converges to the true integral
    Slabs,
    /// The colour of the greatest mean value over the slabs of each ray
    Maximum,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum BlendName {
    /// The space that the scene's colours are made for
    Auto,
    /// sRGB codes, decoded afterwards
    Encoded,
    /// Linear light
    Linear,
}

impl From<BlendName> for Blend {
    fn from(name: BlendName) -> Self {
        match name {
            BlendName::Auto => Self::Auto,
            BlendName::Encoded => Self::Encoded,
            BlendName::Linear => Self::Linear,
        }
    }
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ClassifyName {
    /// Over each kernel's extent
    Extent,
    /// At its value alone
    Particle,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Opacity {
    Exponential,
    Linear,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Detail {
    Auto,
    Off,
}

#[derive(Clone, Copy, ValueEnum)]
enum ShowName {
    /// The picture
    Scene,
    /// Each splat in the colour of what draws it: exact red, affine green, reconstruction kernel
    /// alone blue, low-pass filter alone yellow, round cyan; merged in shades of magenta
    Choice,
    /// How many kernels each pixel evaluates until it is opaque, whatever the background: exr, pfm
    /// and npy hold the numbers, png has viridis from 0 to the largest
    Count,
}

#[derive(Args)]
#[command(next_help_heading = "Output")]
struct Output {
    /// What the image shows
    #[arg(long, value_enum, default_value = "scene")]
    show: ShowName,
    /// Colour behind everything: linear numbers from 0 to 1, a name or #rrggbb of the web, or none, which leaves
    /// the image transparent [default: a dark grey, #1c1c21, of png; none of others]
    #[arg(long, value_name = "r,g,b|NAME|none", value_parser = parse::background, allow_hyphen_values = true)]
    background: Option<Background>,
    /// Write counts, memory and times as JSON
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,
    /// Write the depth at which half the light is gone: exr, pfm or npy
    #[arg(long, value_name = "FILE")]
    depth: Option<PathBuf>,
    /// Write the transfer function that is drawn as a JSON file, which --transfer-function reads
    #[arg(long, value_name = "FILE")]
    write_transfer_function: Option<PathBuf>,
    /// Write the normals of opaque surfels, world space: exr, pfm or npy
    #[arg(long, value_name = "FILE", conflicts_with_all = ["reference", "column_density"])]
    normals: Option<PathBuf>,
    /// Render the frame N times after a warm-up and report median times
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
}

/// Scene ready to be drawn, with its cameras and overlays.
struct Made {
    renderer: Renderer,
    cameras: Vec<Camera>,
    legend: Vec<ColourBar>,
    bounds: Option<Bounds>,
    fields: Vec<Option<String>>,
    mean: Option<ColumnMean>,
    truth: Option<Truth>,
    read_ms: f64,
    prepare_start: Instant,
}

pub(crate) fn run(arguments: &mut Arguments) -> Result<()> {
    let begun = Instant::now();
    let mut ranks = arguments.mpi.then(ranks::start).transpose()?;
    let is_first = ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0);
    let checked = arguments.check(is_first);
    match &mut ranks {
        Some(ranks) => ranks.agree(checked)?,
        None => checked?,
    }
    let arguments = &*arguments;
    // The spinner is hidden if standard error is no terminal.
    let progress = spinner();

    let task = task_of(&progress);

    let options = arguments.sample_options(task.clone());
    if arguments.sequence.is_series() {
        return arguments.draw_series(&options, &progress, ranks);
    }
    let made = arguments.made(&options, &progress, &mut ranks);
    let Made {
        renderer,
        cameras,
        legend,
        bounds,
        fields,
        mean,
        truth,
        read_ms,
        prepare_start,
    } = match &mut ranks {
        Some(ranks) => ranks.agree(made)?,
        None => made?,
    };
    let is_column = arguments.method.column_density;
    let camera = cameras[0].clone();
    let is_sequence = arguments.sequence.is_asked_for();
    let mut renderer = match ranks.take_if(|_| !is_sequence) {
        Some(ranks) => renderer.over_ranks(ranks)?,
        // A rank draws on its CPU: one node may run several ranks but have one GPU.
        None if ranks.is_some() || renderer.rank().is_some() => renderer,
        None => {
            let backend = arguments.backend(&renderer, &camera);
            renderer.on_backend(backend)?
        }
    };
    let prepare_ms = prepare_start.elapsed().as_secs_f64() * 1e3;
    let prepared = Prepared {
        begun,
        read_ms,
        prepare_ms,
    };
    let annotations = arguments.annotations.at(&arguments.inputs);
    let overlays = Overlays::new(&annotations, legend.clone(), bounds, &camera)?;
    if is_column {
        return arguments.draw_column(
            &mut renderer,
            &camera,
            (&fields, mean),
            overlays,
            prepared,
            &progress,
        );
    }
    let suitable = renderer.suitable_low_pass_px2();
    let low_pass = arguments.method.low_pass.unwrap_or(suitable);
    if let Some(truth) = truth {
        progress.finish_and_clear();
        return arguments.integrate(&truth, &camera, low_pass, &overlays, prepared);
    }
    let mut settings = arguments.settings(low_pass);
    let blend = blend_of(&renderer, &settings)?;
    if let Some(note) = blend.note().filter(|_| is_first) {
        progress.suspend(|| super::progress::note!("{note}"));
    }
    if is_sequence {
        let mut draw = |n: usize| {
            let camera = &cameras[n];
            let over = Overlays::new(&annotations, legend.clone(), bounds, camera)?;
            let image = renderer.render(camera, &settings)?;
            Ok(over.drawn(image)?.into_owned())
        };
        return arguments.draw_all(&cameras, &mut draw, ranks);
    }
    let asked = settings.tolerance;
    let mut sample = None;
    if arguments.method.calibrate {
        progress.set_message("calibrating");
        if settings.composite != Composite::Over {
            renderer.render(&camera, &settings)?;
            settings.composite = with_layers_of(&renderer, settings.composite);
        }
        let own = ErrorSample::draw(&mut renderer, &camera, &settings)?;
        (settings.tolerance, _) = own.calibrated(&mut renderer)?;
        sample = Some(own);
    }
    progress.set_message("rendering");
    let shown = Settings {
        task,
        ..settings.clone()
    };
    renderer.render(&camera, &shown)?;
    let mut times = vec![renderer.times()];
    if let Some(frames) = arguments.output.frames {
        times.clear();
        progress.set_length(u64::from(frames));
        for _ in 0..frames {
            renderer.render(&camera, &settings)?;
            times.push(renderer.times());
            progress.inc(1);
        }
    }
    if !is_first {
        return Ok(());
    }
    progress.set_message("writing");
    let shows_count = settings.show == Show::Count;
    if shows_count {
        write_count(&arguments.out, renderer.image())?;
    } else {
        overlays.write(&arguments.out, renderer.image())?;
    }
    if let (Some(path), Some(depth)) = (&arguments.output.depth, renderer.depth()) {
        write_depth(path, depth)?;
    }
    if let (Some(path), Some(normals)) = (&arguments.output.normals, renderer.normals()) {
        write_normals(path, normals)?;
    }
    let mut stats = stats(&renderer, &times, prepared);
    stats["tolerance"] = json!(settings.tolerance);
    stats["blend"] = json!(blend.name());
    let footprints = renderer.counts().footprints;
    let layers = renderer.layers().cloned();
    if arguments.method.measure_error || arguments.method.calibrate {
        progress.set_message("measuring the error");
        let image = renderer.image().clone();
        let sample = match sample {
            Some(sample) => sample,
            None => {
                settings.composite = with_layers_of(&renderer, settings.composite);
                ErrorSample::draw(&mut renderer, &camera, &settings)?
            }
        };
        let error = sample.error_of(&image);
        stats["tolerance_asked"] = json!(asked);
        stats["measured_error"] = json!(error);
        if arguments.output.stats.is_none() {
            progress.suspend(|| note!("{}", in_words(&error, asked, settings.tolerance)));
        }
    }
    if let Some(path) = &arguments.output.stats {
        write_bytes_atomically(path, format!("{stats:#}\n").as_bytes())?;
    }
    progress.finish_and_clear();
    if footprints == 0 {
        note!("nothing visible: no particle reaches the image with an opacity above zero");
    } else if shows_count {
        note!("{}", describe(renderer.image(), arguments.is_png()));
    }
    if let (Some(layers), None) = (layers, arguments.method.slab_thickness) {
        let tolerance = f64::from(settings.tolerance);
        if layers.error > tolerance {
            note!(
                "slabs {:.1e} thick are thicker than the tolerance of {tolerance:.1e} asks of the \
                 thinnest kernels: they err by {:.1e} at most, as a rule far less; --slab-thickness \
                 makes them thinner",
                layers.thickness,
                layers.error
            );
        }
    }
    Ok(())
}

/// Space that a picture is composited in, and the note on it.
struct BlendOf {
    is_encoded: bool,
    /// True if splats with encoded colours are composited in linear light because of other volumes
    /// in the scene.
    gives_way: bool,
}

impl BlendOf {
    fn name(&self) -> &'static str {
        match self.is_encoded {
            true => "encoded",
            false => "linear",
        }
    }

    fn note(&self) -> Option<&'static str> {
        self.gives_way.then_some(
            "splats are composited in linear light, because not all that is shown are splats of sRGB codes; viewers              composite the codes, and so does --blend encoded",
        )
    }
}

/// Chooses the space of compositing.
///
/// # Errors
/// A space asked for in a scene without splats of radiance fields.
fn blend_of(renderer: &Renderer, settings: &Settings) -> Result<BlendOf> {
    let has_encoded = renderer.volumes().iter().any(BlockedVolume::is_encoded);
    let has_splats = renderer.volumes().iter().any(BlockedVolume::is_of_splats);
    if settings.blend != Blend::Auto && !has_splats {
        return Err(Error::invalid(
            "--blend",
            "inputs",
            "splats of radiance fields",
            "none",
            "leave it out",
        ));
    }
    let is_encoded = renderer.blends_encoded(settings);
    let is_auto = settings.blend == Blend::Auto && settings.show == Show::Scene;
    Ok(BlendOf {
        is_encoded,
        gives_way: has_encoded && !is_encoded && is_auto,
    })
}

/// Refuses options of light if no volume has normals.
fn check_lit(scene: &[PointVolume]) -> Result<()> {
    let reflects = |volume: &PointVolume| {
        let is_surface = matches!(volume.particles, Particles::Surfels { .. });
        is_surface || volume.normals.is_some()
    };
    if scene.iter().any(reflects) {
        return Ok(());
    }
    let expected = "surfaces, or volumes with a field";
    let found = "splats or particles without one";
    Err(Error::invalid(
        "--lit",
        "inputs",
        expected,
        found,
        "leave it out",
    ))
}

/// Returns the transfer function to write. All volumes must share it.
fn written_function(scene: &[PointVolume]) -> Result<&TransferFunction> {
    let fault = |found: String| {
        let expected = "one transfer function for all inputs";
        let advice = "leave --write-transfer-function out, or name one input";
        Error::invalid("--write-transfer-function", "data", expected, found, advice)
    };
    let mut functions = scene.iter().filter_map(|v| v.transfer_function.as_ref());
    let first = functions.next();
    let first =
        first.ok_or_else(|| fault("none: colours or optical depths of their own".into()))?;
    match functions.filter(|other| *other != first).count() {
        0 => Ok(first),
        others => Err(fault(format!("{} different ones", others + 1))),
    }
}

/// Returns `composite` with the layer thickness of the last frame, so that parts of the picture are
/// cut into the same layers.
fn with_layers_of(renderer: &Renderer, composite: Composite) -> Composite {
    match renderer.layers() {
        Some(layers) => composite.with_thickness(Some(layers.thickness)),
        None => composite,
    }
}

/// Describes the measured error of a picture in words.
fn in_words(error: &SampledError, asked: f32, drawn: f32) -> String {
    let mut words = format!(
        "99.9 % of the picture err by less than {:.1e}, the worst pixel by {:.1e} (tolerance {asked:.1e}; measured in \
         {} tiles, {} pixels)",
        error.percentile_999, error.greatest, error.tiles, error.pixels
    );
    if drawn != asked {
        words += &format!("; drawn at a tolerance of {drawn:.1e}");
    }
    words
}

impl Arguments {
    /// Expands the inputs, and refuses impossible requests before any input is read.
    ///
    /// - `is_first`: whether this is the rank that writes. Folders of outputs need not exist on
    ///   other ranks.
    fn check(&mut self, is_first: bool) -> Result<()> {
        if self.mpi && self.backend == BackendName::Gpu {
            return Err(ranks::refuse("--backend gpu"));
        }
        let named = std::mem::take(&mut self.inputs);
        self.inputs = self.data.inputs(named, self.sequence.is_series())?;
        self.take_axes();
        if is_first {
            self.check_outputs()?;
        }
        self.camera.read_file(self.size)?;
        if let Some(lighting) = self.lighting() {
            lighting.validate()?;
        }
        self.check_legend()?;
        self.annotations.check(self.numbers())?;
        self.annotations.check_time(&self.inputs)?;
        self.method.check()?;
        self.check_show()
    }

    /// Passes `--keep-axes` on to the options of the data.
    pub(super) fn take_axes(&mut self) {
        self.data.keeps_axes = self.keep_axes;
    }

    /// Checks that all outputs can be written and overwrite no input.
    fn check_outputs(&self) -> Result<()> {
        self.check_sequence()?;
        let layers = [&self.output.depth, &self.output.normals];
        for path in layers.into_iter().flatten() {
            check_depth_path(path)?;
        }
        let texts = [&self.output.stats, &self.output.write_transfer_function];
        for path in texts.into_iter().flatten() {
            check_folder(path)?;
        }
        let outputs = [
            Some(&self.out),
            self.output.depth.as_ref(),
            self.output.normals.as_ref(),
            self.output.stats.as_ref(),
            self.output.write_transfer_function.as_ref(),
        ];
        check_collisions(paths(&self.inputs), outputs.into_iter().flatten())
    }

    /// Checks that the format of the output can hold the sequence or picture asked for.
    fn check_sequence(&self) -> Result<()> {
        let fault = |option: &'static str, expected: &str, found: &str| {
            let advice = "leave it out";
            Err(Error::invalid(option, "use", expected, found, advice))
        };
        if self.sequence.has_rate() && !animation::is_animated(&self.out) {
            return fault("--rate", "an .apng or a .gif", "files of one picture");
        }
        match self.sequence.is_asked_for() {
            true if self.output.stats.is_some() => {
                fault("--stats", "one picture", "a sequence of them")
            }
            true => Animation::check_path(&self.out),
            false => check_image_path(&self.out),
        }
    }

    /// Reads the inputs, sorts them into blocks and places the cameras.
    ///
    /// - `ranks`: the ranks, if there are any. It is taken if the ranks share the scene and draw it
    ///   together.
    fn made(
        &self,
        options: &SampleOptions,
        progress: &ProgressBar,
        ranks: &mut Option<Box<dyn Collective>>,
    ) -> Result<Made> {
        let read_start = Instant::now();
        let planes = self.clip_planes();
        let cameras = |boxes: &[Bounds], up, canvas: &Canvas| {
            let sequence = &self.sequence;
            sequence.cameras(&self.camera, boxes, up, canvas)
        };
        let whole = Canvas::of(self.size);
        let of_boxes =
            |boxes: &[Bounds], up| cameras(&left_of(boxes.to_vec(), &planes), up, &whole);
        let read = || {
            let scene = self
                .data
                .scene(&self.inputs, options, &of_boxes, progress)?;
            self.checked(scene)
        };
        // If ranks share a picture, each may read a part of the data.
        let sharing = ranks.as_mut().filter(|_| !self.sequence.is_asked_for());
        let (scene, shared) = match sharing {
            None => (read()?, None),
            Some(ranks) => {
                let inputs = &self.inputs;
                // Cut faces need whole volumes.
                let takes_parts = !self.cut.cut_faces;
                let check = |scene| self.checked(scene);
                self.data.shared(
                    inputs,
                    options,
                    &of_boxes,
                    progress,
                    &mut **ranks,
                    takes_parts,
                    read,
                    check,
                )?
            }
        };
        let is_shared = shared.is_some();
        let is_column = self.method.column_density;
        let legend = match self.legend.legend {
            true if !is_column => bars(&scene)?,
            _ => Vec::new(),
        };
        let bounds = scene.bounds();
        let (scene, prepared, up, fields) = (scene.volumes, scene.prepared, scene.up, scene.fields);
        // Other ranks learn of a failure here when they next wait for this rank.
        let is_first = ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0);
        if let (Some(path), true) = (&self.output.write_transfer_function, is_first) {
            let function = written_function(&scene)?;
            write_bytes_atomically(path, function.to_json().as_bytes())?;
        }
        let mean = match &self.method.column_mean {
            None => None,
            Some(field) => {
                let of = (scene.as_slice(), field.as_str());
                let (data, inputs) = (&self.data, &self.inputs);
                Some(column_mean::weighed(data, inputs, of, options, progress)?)
            }
        };
        let read_ms = read_start.elapsed().as_secs_f64() * 1e3;

        progress.set_message("sorting into blocks");
        let prepare_start = Instant::now();
        let truth = match self.method.reference {
            None => None,
            Some(ReferenceName::Kernels) => {
                Some(Truth::of_kernels(&scene, self.method.classification())?)
            }
            Some(ReferenceName::Data) => {
                let (data, inputs) = (&self.data, &self.inputs);
                Some(Truth::of_data(data, inputs, &scene, &fields)?)
            }
        };
        let truth = truth.map(|truth| truth.clipped(&self.clip_planes()));
        let scene_options = self.scene_options(options);
        let renderer = match (shared, ranks.take_if(|_| is_shared)) {
            (Some(share), Some(ranks)) => {
                let share = Share {
                    volumes: scene,
                    ..share
                };
                crate::ranks::shared(share, &scene_options, ranks)?
            }
            _ => renderer_of(scene, prepared, &scene_options)?,
        };
        let (all, canvas) = if is_column {
            let lens = Lens::OrthoHeight(None);
            (renderer.boxes(), Canvas { lens, ..whole })
        } else {
            let room_px = legend_width(&legend, whole.size());
            let boxes = self.camera.boxes(&renderer);
            if is_first && let Some(note) = self.camera.strays(&renderer, &boxes) {
                progress.suspend(|| super::progress::note!("{note}"));
            }
            (boxes, Canvas { room_px, ..whole })
        };
        let mut boxes = left_of(all, &self.clip_planes());
        // The camera shows the whole outline, even if the data inside it are clipped.
        boxes.extend(bounds.filter(|_| self.annotations.has_outline()));
        let cameras = cameras(&boxes, up, &canvas)?;
        Ok(Made {
            renderer,
            cameras,
            legend,
            bounds,
            fields,
            mean,
            truth,
            read_ms,
            prepare_start,
        })
    }

    /// Returns the options for sorting the scene into blocks.
    fn scene_options(&self, options: &SampleOptions) -> SceneOptions {
        let method = &self.method;
        let draws_merged = self.settings(0.0).draws_merged();
        SceneOptions {
            level_of_detail: draws_merged && !method.column_density && method.reference.is_none(),
            task: options.task.clone(),
            ..SceneOptions::default()
        }
    }

    /// Checks that the options apply to the scene, and adds cut faces if they are asked for.
    fn checked(&self, mut scene: Loaded) -> Result<Loaded> {
        let refused = [
            ("--reference", self.method.reference.is_some()),
            ("--cut-faces", self.cut.cut_faces),
            ("--column-mean", self.method.column_mean.is_some()),
        ];
        refuse_beside(&scene.prepared, &refused)?;
        self.method.check_use(&scene.volumes)?;
        if self.is_lit() && !self.method.post_classification {
            check_lit(&scene.volumes)?;
        }
        if self.cut.cut_faces {
            let volumes = &mut scene.volumes;
            add_faces(volumes, &self.clip_planes(), self.is_lit())?;
        }
        Ok(scene)
    }

    /// Opens the output for the pictures of the cameras.
    fn animation(&self, cameras: &[Camera]) -> Result<Animation> {
        let size = [cameras[0].width, cameras[0].height];
        Animation::new(&self.out, size, cameras.len(), self.sequence.rate())
    }

    /// Draws a picture for each camera and writes them. If there are ranks, they draw in turn.
    fn draw_all(
        &self,
        cameras: &[Camera],
        draw: &mut dyn FnMut(usize) -> Result<Image>,
        ranks: Option<Box<dyn Collective>>,
    ) -> Result<()> {
        let count = cameras.len();
        let Some(mut ranks) = ranks else {
            let mut animation = self.animation(cameras)?;
            let bar = bar(count as u64).with_message("rendering");
            for n in 0..count {
                animation.push(&draw(n)?)?;
                bar.inc(1);
            }
            bar.finish_and_clear();
            return animation.finish();
        };
        let is_first = ranks.rank() == 0;
        let animation = is_first.then(|| self.animation(cameras)).transpose();
        let mut animation = ranks.agree(animation)?;
        let bar = bar(count as u64).with_message("rendering");
        ranks::in_turn(&mut *ranks, count, draw, |image| {
            bar.inc(1);
            animation.as_mut().map_or(Ok(()), |own| own.push(image))
        })?;
        bar.finish_and_clear();
        ranks.agree(animation.map_or(Ok(()), Animation::finish))
    }

    /// Draws a picture of each time step, with one camera and one transfer function.
    fn draw_series(
        &self,
        options: &SampleOptions,
        progress: &ProgressBar,
        mut ranks: Option<Box<dyn Collective>>,
    ) -> Result<()> {
        let is_first = ranks.as_ref().is_none_or(|ranks| ranks.rank() == 0);
        let planes = self.clip_planes();
        let whole = Canvas::of(self.size);
        let steps: Vec<&[Input]> = self.inputs.chunk_by(|a, b| a.step == b.step).collect();
        let series = self.data.series(&self.inputs, options, progress);
        let series = match &mut ranks {
            Some(ranks) => ranks.agree(series)?,
            None => series?,
        };
        let options = series.of_step(options);
        let boxes = left_of(series.boxes, &planes);
        let place = |up, canvas: &Canvas| self.camera.camera(&boxes, up, canvas);
        let read = |step: &[Input]| {
            let cameras = |_: &[Bounds], up| Ok(vec![place(up, &whole)?]);
            let scene = match self.data.scene(step, &options, &cameras, progress) {
                // A time step that holds nothing gives an empty picture.
                Err(error) if error.holds_nothing() => {
                    progress.suspend(|| note!("{}; an empty picture", words::line(&error)));
                    Loaded::of_nothing()
                }
                scene => self.checked(scene?)?,
            };
            let bounds = scene.bounds();
            let legend = match self.legend.legend {
                true => bars(&scene)?,
                false => Vec::new(),
            };
            Ok((scene, bounds, legend))
        };
        let shown = |step: &(Loaded, _, _)| !step.0.volumes.is_empty();
        let first = || {
            // The first step that shows something sets the width of the legend, and its transfer
            // function is written: all steps share it.
            let first = read(steps[0])?;
            let mut said = None;
            let mut rest = steps.iter().skip(1);
            let mut own = &first;
            while !shown(own)
                && let Some(step) = rest.next()
            {
                own = said.insert(read(step)?);
            }
            let (scene, _, legend) = own;
            if let (Some(path), true) = (&self.output.write_transfer_function, is_first) {
                let function = written_function(&scene.volumes)?;
                write_bytes_atomically(path, function.to_json().as_bytes())?;
            }
            let room_px = legend_width(legend, whole.size());
            let camera = place(series.up, &Canvas { room_px, ..whole })?;
            Ok((first, camera))
        };
        let first = first();
        let (first, camera) = match &mut ranks {
            Some(ranks) => ranks.agree(first)?,
            None => first?,
        };
        let mut first = Some(first);
        let is_alone = ranks.is_none();
        let scene_options = self.scene_options(&options);
        let mut draw = |n: usize| {
            let (scene, bounds, legend) = match first.take_if(|_| n == 0) {
                Some(first) => first,
                None => read(steps[n])?,
            };
            let mut renderer = renderer_of(scene.volumes, scene.prepared, &scene_options)?;
            if is_alone {
                let backend = self.backend(&renderer, &camera);
                renderer = renderer.on_backend(backend)?;
            }
            let suitable = renderer.suitable_low_pass_px2();
            let settings = Settings {
                task: options.task.clone(),
                ..self.settings(self.method.low_pass.unwrap_or(suitable))
            };
            let blend = blend_of(&renderer, &settings)?;
            if let Some(note) = blend.note().filter(|_| n == 0) {
                progress.suspend(|| super::progress::note!("{note}"));
            }
            let image = renderer.render(&camera, &settings)?;
            let annotations = self.annotations.at(steps[n]);
            let over = Overlays::new(&annotations, legend, bounds, &camera)?;
            Ok(over.drawn(image)?.into_owned())
        };
        let cameras = vec![camera.clone(); steps.len()];
        self.draw_all(&cameras, &mut draw, ranks)
    }

    /// Writes the reference image, and adds its stated error to the statistics.
    fn integrate(
        &self,
        truth: &Truth,
        camera: &Camera,
        low_pass: f32,
        overlays: &Overlays,
        prepared: Prepared,
    ) -> Result<()> {
        let defaults = ReferenceSettings::default();
        let mut settings = ReferenceSettings {
            error: self.method.tolerance.map_or(defaults.error, f64::from),
            low_pass_variance_px2: low_pass.into(),
            background: self.background(),
            ..defaults
        };
        let start = Instant::now();
        let frame = with_bar("integrating", |task| {
            settings.task = Some(task);
            truth.render(camera, &settings)
        })?;
        let frame_ms = start.elapsed().as_secs_f64() * 1e3;
        overlays.write(&self.out, &frame.image)?;
        if let Some(path) = &self.output.stats {
            let stats = json!({
                "particles": truth.particle_count(),
                "cells_left_out": truth.cells_left_out(),
                "backend": "reference",
                "adapter": format!("{} threads, f64", rayon::current_num_threads()),
                "error_wanted": settings.error,
                "error_estimate": frame.error,
                "pixels_above_error_wanted": frame.unconverged,
                "rays": frame.rays,
                "times_ms": {
                    "read": prepared.read_ms,
                    "prepare": prepared.prepare_ms,
                    "frame": frame_ms,
                },
                "time_to_picture_ms": prepared.begun.elapsed().as_secs_f64() * 1e3,
                "frames": 1,
            });
            write_bytes_atomically(path, format!("{stats:#}\n").as_bytes())?;
        }
        warn_unconverged(&frame, settings.error);
        Ok(())
    }

    /// Refuses a legend if the output holds numbers: a legend belongs to a picture.
    fn check_legend(&self) -> Result<()> {
        let fault = |place: &str, expected: &str, found: String| {
            let advice = "leave --legend out";
            Err(Error::invalid("--legend", place, expected, found, advice))
        };
        if !self.legend.legend {
            return Ok(());
        }
        if !matches!(self.output.show, ShowName::Scene) {
            return fault("--show", "scene", "choice or count".into());
        }
        if self.method.column_density && !self.is_png() {
            let found = self.out.display().to_string();
            return fault("--column-density", "a png, which is a picture", found);
        }
        Ok(())
    }

    /// Returns the option that writes numbers instead of a picture, and the value it expects for a
    /// picture.
    fn numbers(&self) -> Option<(&'static str, &'static str)> {
        if matches!(self.output.show, ShowName::Count) {
            return Some(("--show", "scene or choice"));
        }
        let is_column = self.method.column_density && !self.is_png();
        is_column.then_some(("--column-density", "a png, which is a picture"))
    }

    /// Chooses the backend. The CPU integrates reference images in f64. It also draws scenes that
    /// take less time than loading a GPU driver; the picture is the same.
    pub(crate) fn backend(&self, renderer: &Renderer, camera: &Camera) -> Backend {
        let frames = 1 + self.output.frames.unwrap_or(0);
        match self.backend {
            _ if self.method.reference.is_some() => Backend::Cpu,
            BackendName::Auto if renderer.suits_cpu(camera, frames) => Backend::Cpu,
            BackendName::Auto => Backend::Auto,
            BackendName::Gpu => Backend::Gpu,
            BackendName::Cpu => Backend::Cpu,
        }
    }

    pub(crate) fn frames(&self) -> Option<u32> {
        self.output.frames
    }

    pub(crate) fn stats_path(&self) -> Option<&Path> {
        self.output.stats.as_deref()
    }

    pub(crate) fn is_png(&self) -> bool {
        self.out
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("png"))
    }

    pub(crate) fn column_settings(&self) -> ColumnSettings {
        let defaults = ColumnSettings::default();
        let low_pass = self.method.low_pass;
        let shared = self.settings(low_pass.unwrap_or(defaults.low_pass_variance_px2));
        ColumnSettings {
            tolerance: shared.tolerance,
            filter: shared.filter,
            low_pass_variance_px2: shared.low_pass_variance_px2,
            cutoff: shared.cutoff.unwrap_or(defaults.cutoff),
            clip: shared.clip,
            simd: shared.simd,
            task: None,
        }
    }

    /// Returns the options that turn data into particles.
    pub(super) fn sample_options(&self, task: Option<Task>) -> SampleOptions {
        SampleOptions {
            for_columns: self.method.column_density,
            for_means: self.method.column_mean.is_some(),
            normals: self.asks_normals(),
            local_models: self.asks_models(),
            task,
            ..self.data.sample_options()
        }
    }

    pub(super) fn clip_planes(&self) -> Vec<ClipPlane> {
        self.method
            .clip
            .iter()
            .flat_map(|clip| &clip.0)
            .copied()
            .collect()
    }

    /// Returns the settings of rendering.
    ///
    /// - `low_pass`: variance of the low-pass filter, px².
    pub(super) fn settings(&self, low_pass: f32) -> Settings {
        let defaults = Settings::default();
        Settings {
            tolerance: self.method.tolerance.unwrap_or(defaults.tolerance),
            filter: match self.method.filter {
                FilterName::Adaptive => Filter::Adaptive,
                FilterName::Exact => Filter::Exact,
                FilterName::Ewa => Filter::Ewa,
                FilterName::Reconstruction => Filter::Reconstruction,
                FilterName::LowPass => Filter::LowPass,
                FilterName::Isotropic => Filter::Isotropic,
                FilterName::UniformScaling => Filter::UniformScaling,
            },
            thresholds: self.method.thresholds,
            level_of_detail: self.method.level_of_detail == Detail::Auto,
            merge_slack: defaults.merge_slack,
            show: match self.output.show {
                ShowName::Scene => Show::Scene,
                ShowName::Choice => Show::Choice,
                ShowName::Count => Show::Count,
            },
            linear_opacity: self.method.opacity == Opacity::Linear,
            composite: self.method.composite(),
            classify: self.method.classification(),
            clip: self.clip_planes(),
            low_pass_variance_px2: low_pass,
            cutoff: self.method.cutoff,
            blend: self.method.blend.into(),
            background: self.background(),
            depth: self.output.depth.is_some(),
            normals: self.output.normals.is_some(),
            simd: defaults.simd,
            lighting: self.lighting(),
            sub_pixel_opacity: self.method.sub_pixel_opacity,
            task: None,
        }
    }
}

impl Arguments {
    /// Returns true if local models of the field are needed: by classification over kernels'
    /// extents or in slabs, or by an iso-surface.
    fn asks_models(&self) -> bool {
        let by_extent = self.method.classify == ClassifyName::Extent;
        let classifies = by_extent || self.method.post_classification;
        self.data.flatten.is_some() || (classifies && !self.method.column_density)
    }

    /// Returns true if lighting needs normals of volumes. Post-classified slabs and iso-surfaces
    /// compute their own.
    fn asks_normals(&self) -> bool {
        let has_own = self.method.post_classification || self.data.flatten.is_some();
        self.light.lighting().is_some() && !has_own
    }

    /// Returns the lighting of the scene. Surfaces are lit by default, with three exceptions: a
    /// reference image, a maximum (which has no surface), and post-classification (which would
    /// light the slabs, too).
    fn lighting(&self) -> Option<Lighting> {
        let method = &self.method;
        let lights_more = method.post_classification || method.reference.is_some();
        let is_maximum = method.composite == CompositeName::Maximum;
        let of_surfaces = !lights_more && !is_maximum && !self.light.is_unlit();
        self.light
            .lighting()
            .or_else(|| of_surfaces.then(Lighting::default))
    }

    /// Returns the appearance of the picture of a column density.
    pub(crate) fn column_look(&self) -> ColumnLook<'_> {
        ColumnLook {
            map: self.data.transfer_function.as_deref(),
            range: self
                .data
                .range
                .map(|range| glam::DVec2::from(range).as_vec2().to_array()),
            scale: match (self.data.scale_name(), &self.method.column_mean) {
                (None, Some(_)) => Some(ScaleName::Linear),
                (scale, _) => scale,
            },
        }
    }

    /// Refuses options of light with `--show` other than `scene`. (A background is allowed: counts
    /// have one, too.)
    fn check_show(&self) -> Result<()> {
        let is_asked = self.is_lit() || self.light.is_unlit();
        if !is_asked || matches!(self.output.show, ShowName::Scene) {
            return Ok(());
        }
        let (option, found) = ("--lit, --unlit or --light", "--show beside it");
        let expected = "the scene";
        Err(Error::invalid(
            option,
            "what is shown",
            expected,
            found,
            "leave it out",
        ))
    }

    /// Returns true if light was asked for.
    pub(super) fn is_lit(&self) -> bool {
        self.light.lighting().is_some()
    }

    /// Returns the linear background colour. The default is dark grey for pictures to look at (png,
    /// apng, gif) and none for other formats.
    fn background(&self) -> Option<[f32; 3]> {
        let is_picture = (self.is_png() || animation::is_animated(&self.out))
            && matches!(self.output.show, ShowName::Scene | ShowName::Choice);
        match self.output.background {
            Some(Background::None) => None,
            Some(Background::Colour(colour)) => Some(colour),
            None => is_picture.then_some(DARK_GREY),
        }
    }
}

impl Method {
    /// Refuses options that do not apply to any of the volumes.
    pub(super) fn check_use(&self, volumes: &[PointVolume]) -> Result<()> {
        let default = FilterName::Adaptive;
        let is_filtered = volumes.iter().any(is_filtered);
        let is_translucent = !volumes.iter().all(is_surface);
        let is_classified = volumes.iter().any(|v| v.transfer_function.is_some());
        let absorbing = "kernels that absorb light, not surfaces or splats";
        let is_over = self.composite == CompositeName::Over;
        let is_each = self.classify == ClassifyName::Particle;
        let is_linear = self.opacity == Opacity::Linear;
        refuse_unused(&[
            ("--filter", self.filter != default, is_filtered, absorbing),
            (
                "--thresholds",
                self.thresholds.is_some(),
                is_filtered,
                absorbing,
            ),
            ("--opacity", is_linear, is_filtered, absorbing),
            (
                "--sub-pixel-opacity",
                self.sub_pixel_opacity,
                is_filtered,
                absorbing,
            ),
            (
                "--composite",
                !is_over,
                is_translucent,
                "more than opaque surfaces",
            ),
            ("--classify", is_each, is_classified, CLASSIFIED),
        ])
    }

    fn classification(&self) -> Classification {
        match self.classify {
            ClassifyName::Extent => Classification::Extent,
            ClassifyName::Particle => Classification::Particle,
        }
    }

    /// Returns the compositing of kernels that lie behind one another.
    fn composite(&self) -> Composite {
        let thickness = self.slab_thickness;
        match self.composite {
            CompositeName::Over => Composite::Over,
            CompositeName::Sheets => Composite::Sheets { thickness },
            CompositeName::AxisSheets => Composite::AxisSheets { thickness },
            CompositeName::Maximum => Composite::Maximum { thickness },
            CompositeName::Slabs => Composite::Slabs {
                thickness,
                classify: if self.post_classification {
                    ClassifyAt::Slab
                } else {
                    ClassifyAt::Particle
                },
            },
        }
    }

    /// Refuses options of layers for a composite without layers, and options of column densities
    /// without these. (Clap does not enforce `requires` if the required option conflicts with a
    /// third that is given.)
    pub(super) fn check(&self) -> Result<()> {
        let refuse = |place: &str, expected: &str| {
            let found = self.composite().name();
            Err(Error::format(
                "settings",
                place,
                expected,
                found,
                "change it",
            ))
        };
        if self.post_classification && self.composite != CompositeName::Slabs {
            return refuse("composite of classified slabs", "slabs");
        }
        if self.slab_thickness.is_some() && self.composite == CompositeName::Over {
            return refuse(
                "composite of a thickness",
                "slabs, sheets, axis-sheets or maximum",
            );
        }
        let is_each = self.classify == ClassifyName::Particle;
        if is_each && (self.post_classification || self.composite == CompositeName::Maximum) {
            return refuse(
                "composite of particles classified one by one",
                "one that classifies these, not slabs",
            );
        }
        if self.column_mean.is_some() && !self.column_density {
            return Err(Error::invalid(
                "--column-mean",
                "what is written",
                "--column-density beside it",
                "none",
                "add it",
            ));
        }
        Ok(())
    }
}
