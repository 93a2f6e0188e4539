//! Runs `ewa-splat measure`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

use crate::data::up::Up;
use crate::io::{read_image, write_bytes_atomically, write_image};
use crate::load::prepared::renderer as renderer_of;
use crate::load::{Input, Loaded};
use crate::measure::{
    ACCURATE, About, DEFAULT, FAST, ReferenceSummary, Report, Resampling, Row, Subject,
    SweepOptions, sweep,
};
use crate::reference::{PixelFilter, ReferenceFrame, ReferenceSettings};
use crate::sample::SampleOptions;
use crate::scene::Classification;
use crate::view::{Bounds, Camera};
use crate::{Error, Image, Result, SceneOptions, Settings};
use clap::Args;

use super::input::DataOptions;
use super::outputs::{check_collisions, paths, warn_unconverged};
use super::parse;

use super::progress::{bar, spinner, task_of, with_bar};
use super::truth::Truth;
use super::usage::refuse_beside;
use super::viewpoint::{CameraOptions, Canvas};

/// Default width and height of a measurement in pixels.
const DEFAULT_SIZE: [usize; 2] = [256, 256];

/// Default error of the reference image. It is well below the error of splatting and takes about a
/// minute on small data.
const DEFAULT_REFERENCE_ERROR: f64 = 1e-3;

const REFERENCE: &str = "reference.exr";
const REFERENCE_KERNELS: &str = "reference-kernels.exr";
const REFERENCE_DATA: &str = "reference-data.exr";

#[derive(Args)]
pub(crate) struct Arguments {
    /// Files to render together; FILE@FIELD shows another field of one, FILE@FIELD@FUNCTION by another transfer
    /// function
    #[arg(required = true, value_name = "FILE[@FIELD[@FUNCTION]]", value_parser = parse::input())]
    inputs: Vec<Input>,
    /// Folder for report.html, report.json, report.csv and the reference; made if missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Width and height in pixels [default: 256x256]
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    size: Option<[usize; 2]>,
    /// Frames of which times are the medians, after one that warms up
    #[arg(long, value_name = "N", default_value = "5",
          value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// The true image, from an earlier run: exr, pfm or npy [default: integrated]
    #[arg(long, value_name = "FILE")]
    reference_image: Option<PathBuf>,
    /// The true image with the pixel filter on each kernel, from an earlier run; integrated only
    /// where --reference-image is
    #[arg(long, value_name = "FILE", requires = "reference_image")]
    reference_kernels_image: Option<PathBuf>,
    /// The true image of the data's own field, from an earlier run; integrated only where
    /// --reference-image is, and only of one grid
    #[arg(long, value_name = "FILE", requires = "reference_image")]
    reference_data_image: Option<PathBuf>,
    /// Variance of the low-pass filter in square pixels, of references and pictures [default: as render]
    #[arg(long, value_name = "VARIANCE_PX2", value_parser = parse::variance)]
    low_pass: Option<f32>,
    /// The reference's error in linear colour: aimed at, or of the file given [default: 1e-3]
    #[arg(long, value_name = "E", value_parser = parse::positive)]
    reference_error: Option<f64>,
    /// Print the report as JSON: the contents of report.json
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    camera: CameraOptions,
    #[command(flatten)]
    data: DataOptions,
}

pub(crate) fn run(arguments: &mut Arguments) -> Result<()> {
    let named = std::mem::take(&mut arguments.inputs);
    arguments.inputs = arguments.data.inputs(named, false)?;
    let arguments = &*arguments;
    if !arguments.camera.depth_planes(None).is_empty() {
        return Err(Error::invalid(
            "--window",
            "coordinates",
            "four, across and upwards: measure cuts nothing",
            "six",
            "leave the last two out",
        ));
    }
    let folder = &arguments.out;
    let kernel_width = arguments.data.kernel_width();
    check_collisions(paths(&arguments.inputs), outputs(folder).iter())?;
    // The spinner is hidden if standard error is no terminal.
    let progress = spinner();

    let options = SampleOptions {
        task: task_of(&progress),
        ..arguments.data.sample_options()
    };
    let canvas = Canvas {
        default_size: DEFAULT_SIZE,
        ..Canvas::of(arguments.size)
    };
    let cameras = |boxes: &[Bounds], up: Up| Ok(vec![arguments.camera.camera(boxes, up, &canvas)?]);
    let mut scene = arguments
        .data
        .scene(&arguments.inputs, &options, &cameras, &progress)?;
    refuse_beside(
        &scene.prepared,
        &[(
            "measure without --reference-image",
            arguments.reference_image.is_none(),
        )],
    )?;
    let prepared = std::mem::take(&mut scene.prepared);
    let mut renderer = renderer_of(scene.volumes.clone(), prepared, &SceneOptions::default())?;
    let boxes = arguments.camera.boxes(&renderer);
    let camera = arguments.camera.camera(&boxes, scene.up, &canvas)?;
    let suitable = renderer.suitable_low_pass_px2();
    let low_pass = arguments.low_pass.unwrap_or(suitable);
    progress.finish_and_clear();
    let given = given_references(arguments, &camera)?;
    std::fs::create_dir_all(folder)
        .map_err(|e| Error::io(folder, "making the folder", e, "name a folder elsewhere"))?;
    let references = match given {
        Some(given) => given,
        None => integrate(arguments, &scene, &camera, low_pass)?,
    };
    write_image(&folder.join(REFERENCE), &references.image)?;
    if let Some(kernels) = &references.kernels {
        write_image(&folder.join(REFERENCE_KERNELS), kernels)?;
    }
    if let Some(data) = &references.data {
        write_image(&folder.join(REFERENCE_DATA), data)?;
    }

    let resample = |width| {
        arguments
            .data
            .scene_at_kernel_width(&arguments.inputs, width)
    };
    let mut subject = Subject {
        renderer: &mut renderer,
        camera: &camera,
        reference: &references.image,
        reference_kernels: references.kernels.as_ref(),
        reference_data: references.data.as_ref(),
        resampling: scene.grids_only.then_some(Resampling {
            kernel_width,
            scene: &resample,
        }),
    };
    let about = About {
        inputs: arguments.inputs.iter().map(|i| name(&i.path)).collect(),
        command: command_line(),
        reference: references.summary,
        reference_data: references.data_summary,
    };
    let options = SweepOptions {
        frames: arguments.frames as usize,
        base: Settings {
            low_pass_variance_px2: low_pass,
            ..Settings::default()
        },
    };
    let progress = bar(0);
    let report = sweep(&mut subject, about, &options, &mut |step| {
        progress.set_length(step.total as u64);
        progress.set_position(step.done as u64);
        progress.set_message(step.label.to_owned());
    })?;
    write_bytes_atomically(&folder.join("report.json"), &report.json()?)?;
    write_bytes_atomically(&folder.join("report.csv"), &report.csv()?)?;
    write_bytes_atomically(&folder.join("report.html"), &report.html()?)?;
    progress.finish_and_clear();
    if arguments.json {
        super::say!("{}", String::from_utf8_lossy(&report.json()?).trim_end());
        return Ok(());
    }
    print_table(&report);
    super::say!("\n{}", folder.join("report.html").display());
    Ok(())
}

fn outputs(folder: &Path) -> Vec<PathBuf> {
    ["report.json", "report.csv", "report.html"]
        .map(|name| folder.join(name))
        .into()
}

/// Reference images.
struct References {
    image: Image,
    kernels: Option<Image>,
    data: Option<Image>,
    summary: ReferenceSummary,
    data_summary: Option<ReferenceSummary>,
}

/// Reads the reference images that the user gives, before any long work.
fn given_references(arguments: &Arguments, camera: &Camera) -> Result<Option<References>> {
    let read = |path: &PathBuf| {
        let image = read_image(path)?;
        if (image.width, image.height) == (camera.width, camera.height) {
            return Ok(image);
        }
        Err(Error::format(
            path,
            "image size",
            format!("{} x {}, as measured", camera.width, camera.height),
            format!("{} x {}", image.width, image.height),
            format!("measure with --size {}x{}", image.width, image.height),
        ))
    };
    let Some(path) = &arguments.reference_image else {
        return Ok(None);
    };
    let kernels = arguments.reference_kernels_image.as_ref();
    let data = arguments.reference_data_image.as_ref();
    let summary = |path: &PathBuf| ReferenceSummary {
        origin: path.display().to_string(),
        error: arguments.reference_error,
        ..ReferenceSummary::default()
    };
    Ok(Some(References {
        image: read(path)?,
        kernels: kernels.map(read).transpose()?,
        data: data.map(read).transpose()?,
        summary: summary(path),
        data_summary: data.map(summary),
    }))
}

/// Integrates the reference image of the kernels and, if the scene is one grid, that of its own
/// field.
fn integrate(
    arguments: &Arguments,
    scene: &Loaded,
    camera: &Camera,
    low_pass: f32,
) -> Result<References> {
    let error = arguments.reference_error.unwrap_or(DEFAULT_REFERENCE_ERROR);
    let render = |truth: &Truth, message, pixel_filter| -> Result<(ReferenceFrame, f64)> {
        let start = Instant::now();
        let frame = with_bar(message, |task| {
            let settings = ReferenceSettings {
                error,
                low_pass_variance_px2: low_pass.into(),
                pixel_filter,
                task: Some(task),
                ..ReferenceSettings::default()
            };
            truth.render(camera, &settings)
        })?;
        Ok((frame, start.elapsed().as_secs_f64()))
    };
    let summary = |(frame, seconds): &(ReferenceFrame, f64)| ReferenceSummary {
        origin: "integrated".into(),
        error: Some(frame.error),
        unconverged: Some(frame.unconverged),
        rays: Some(frame.rays),
        seconds: Some(*seconds),
    };
    let kernels = Truth::of_kernels(&scene.volumes, Classification::default())?;
    let image = render(&kernels, "integrating the true image", PixelFilter::Image)?;
    warn_unconverged(&image.0, error);
    let of_kernels = render(
        &kernels,
        "integrating with the pixel filter on kernels",
        PixelFilter::Kernels,
    )?;
    // Data other than grids define no field apart from their kernels.
    let (data, inputs) = (&arguments.data, &arguments.inputs);
    let data = scene
        .grids_only
        .then(|| Truth::of_data(data, inputs, &scene.volumes, &scene.fields).ok())
        .flatten()
        .map(|data| {
            render(
                &data,
                "integrating the data's own field",
                PixelFilter::Image,
            )
        })
        .transpose()?;
    if let Some((frame, _)) = &data {
        warn_unconverged(frame, error);
    }
    Ok(References {
        summary: summary(&image),
        data_summary: data.as_ref().map(summary),
        image: image.0.image,
        kernels: Some(of_kernels.0.image),
        data: data.map(|(frame, _)| frame.image),
    })
}

/// Returns the file's name without its folders: a report may be shown to others.
fn name(path: &Path) -> String {
    path.file_name().map_or_else(
        || path.display().to_string(),
        |n| n.to_string_lossy().into_owned(),
    )
}

/// Arguments that the program was started with.
static WORDS: OnceLock<Vec<String>> = OnceLock::new();

/// Stores the command line for reports.
pub(crate) fn note_command_line(words: &[OsString]) {
    let words = words.iter().map(|word| word.to_string_lossy().into_owned());
    WORDS.get_or_init(|| words.collect());
}

/// Formats the command line with the quotes that a shell needs.
fn command_line() -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@%".contains(c);
    let words = WORDS.get().into_iter().flatten().cloned();
    let quoted = words.skip(1).map(|a| {
        if !a.is_empty() && a.chars().all(plain) {
            a
        } else {
            format!("'{}'", a.replace('\'', "'\\''"))
        }
    });
    std::iter::once("ewa-splat".to_owned())
        .chain(quoted)
        .collect::<Vec<_>>()
        .join(" ")
}

/// Prints the variants that no other beats in both time and error, and those that show the limit of
/// splatting.
fn print_table(report: &Report) {
    super::say!(
        "{:<46} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8} {:>13}",
        "not beaten in time and rmse, and some others",
        "frame ms",
        "rmse",
        "from data",
        "99.9 %",
        "ssim",
        "flip",
        "from accurate"
    );
    let mut shown: Vec<&Row> = report
        .rows
        .iter()
        .filter(|row| {
            row.on_front
                || row.on_data_front
                || [DEFAULT, FAST, ACCURATE].contains(&row.id.as_str())
        })
        .collect();
    shown.sort_by(|a, b| a.cost.times_ms.frame.total_cmp(&b.cost.times_ms.frame));
    for row in shown {
        let or_dash = |x: Option<f64>| x.map_or_else(|| "-".into(), |x| format!("{x:.4}"));
        super::say!(
            "{:<46} {:>9.2} {:>9.2e} {:>9} {:>9.2e} {:>8} {:>8} {:>13.2e}",
            row.label,
            row.cost.times_ms.frame,
            row.errors.rmse,
            row.from_data
                .map_or_else(|| "-".into(), |e| format!("{:.2e}", e.rmse)),
            row.errors.p999,
            or_dash(row.errors.ssim),
            or_dash(row.errors.flip),
            row.from_baseline.rmse,
        );
    }
}
