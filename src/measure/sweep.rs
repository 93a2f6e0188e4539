//! Draws every variant, times it and compares it with the reference.

use super::report::{About, Budget, BudgetRow, Cost, Machine, Picture, Report, Row, Saving};
use super::variants::{self, ACCURATE, Variant};
use crate::error::Result;
use crate::image::Image;
use crate::measure::errors::{ImageErrors, compare};
use crate::measure::front::{median_times, pareto_front};
use crate::render::{FrameCounts, Renderer, Settings, StageTimes};
use crate::scene::PointVolume;
use crate::view::Camera;

/// Scene, view and references of a sweep.
#[derive(Debug)]
pub struct Subject<'a> {
    /// Renderer of the scene.
    pub renderer: &'a mut Renderer,
    /// The view.
    pub camera: &'a Camera,
    /// The reference image.
    pub reference: &'a Image,
    /// The reference image with the low-pass filter on each kernel's depth instead of on the image. Without it,
    /// the budget has no rows about the reference itself.
    pub reference_kernels: Option<&'a Image>,
    /// The reference image of the data's own field, for the scene of a grid.
    pub reference_data: Option<&'a Image>,
    /// Access to the scene with kernels of other widths, if it can be sampled again.
    pub resampling: Option<Resampling<'a>>,
}

/// Samples the scene with kernels of another width.
#[derive(Clone, Copy)]
pub struct Resampling<'a> {
    /// Width over spacing of the scene's kernels.
    pub kernel_width: f64,
    /// Returns the scene at a width over spacing.
    pub scene: &'a dyn Fn(f64) -> Result<Vec<PointVolume>>,
}

impl std::fmt::Debug for Resampling<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Resampling")
            .field("kernel_width", &self.kernel_width)
            .finish_non_exhaustive()
    }
}

/// Options of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepOptions {
    /// Number of timed frames, after one that warms up; times are their medians.
    pub frames: usize,
    /// Settings that variants change.
    pub base: Settings,
}

impl Default for SweepOptions {
    fn default() -> Self {
        Self {
            frames: 5,
            base: Settings::default(),
        }
    }
}

/// Progress of a sweep.
#[derive(Debug, Clone, Copy)]
pub struct SweepProgress<'a> {
    /// Number of frames done.
    pub done: usize,
    /// Total number of frames.
    pub total: usize,
    /// Name of the next variant to draw.
    pub label: &'a str,
}

/// Variants whose renderings a report keeps.
const PICTURED: [&str; 4] = [
    variants::DEFAULT,
    variants::FAST,
    "opacity-linear",
    "filter-isotropic",
];

/// Measures all of [`variants::variants`] and [`variants::budget_variants`].
///
/// Frames are drawn in rounds, one of every variant in each, so that a disturbance of the machine affects all
/// alike. Scenes that are sampled again are measured separately afterwards, because only one at a time is held
/// in memory.
///
/// Pictures have no background: `options.base.background` should be `None`, as for the reference.
///
/// # Errors
/// Errors of rendering, sampling or comparing: a reference of another size, pixels that are not finite.
pub fn sweep(
    subject: &mut Subject<'_>,
    about: About,
    options: &SweepOptions,
    progress: &mut dyn FnMut(SweepProgress<'_>),
) -> Result<Report> {
    let base = &options.base;
    let width = subject.resampling.map(|r| r.kernel_width);
    let mut all = variants::variants(base, width);
    if subject.reference_data.is_some() {
        all.extend(variants::post_classified(base));
    }
    let from_data = |image: &Image| -> Result<Option<ImageErrors>> {
        let reference = subject.reference_data;
        reference.map(|data| compare(data, image)).transpose()
    };
    let budget_variants = variants::budget_variants(base);
    let resampled = all.iter().filter(|v| v.kernel_width.is_some()).count();

    // Each combination of settings once, however many variants use it.
    let mut distinct: Vec<&Variant> = Vec::new();
    for variant in all.iter().chain(&budget_variants) {
        let known = distinct.iter().any(|d| d.settings == variant.settings);
        if variant.kernel_width.is_none() && !known {
            distinct.push(variant);
        }
    }
    let total = (distinct.len() + resampled) * (options.frames + 1);
    let mut done = 0;
    let mut step = |label: &str| {
        progress(SweepProgress { done, total, label });
        done += 1;
    };
    let accurate = variants::accurate(base);
    let baseline = subject.renderer.render(subject.camera, &accurate)?.clone();
    let mut cells = Vec::with_capacity(distinct.len());
    for variant in &distinct {
        step(&variant.label);
        let image = subject.renderer.render(subject.camera, &variant.settings)?;
        cells.push(Cell {
            settings: variant.settings.clone(),
            errors: compare(subject.reference, image)?,
            from_data: from_data(image)?,
            alone: compare(&baseline, image)?,
            image: PICTURED
                .contains(&variant.id.as_str())
                .then(|| image.clone()),
            counts: subject.renderer.counts(),
            times: Vec::with_capacity(options.frames),
        });
    }
    for _ in 0..options.frames {
        for (cell, variant) in cells.iter_mut().zip(&distinct) {
            step(&variant.label);
            subject.renderer.render(subject.camera, &cell.settings)?;
            cell.times.push(subject.renderer.times());
        }
    }
    let bytes = subject.renderer.bytes_per_particle();

    let mut rows = Vec::with_capacity(all.len());
    let mut pictures = Vec::new();
    for variant in &all {
        let (cost, errors, data_errors, from_baseline) =
            match (variant.kernel_width, subject.resampling) {
                (Some(width), Some(resampling)) => {
                    step(&variant.label);
                    let mut renderer = Renderer::new((resampling.scene)(width)?)?;
                    let image = renderer.render(subject.camera, &variant.settings)?;
                    let errors = compare(subject.reference, image)?;
                    let data_errors = from_data(image)?;
                    let from_baseline = compare(&baseline, image)?;
                    let mut times = Vec::with_capacity(options.frames);
                    for _ in 0..options.frames {
                        step(&variant.label);
                        renderer.render(subject.camera, &variant.settings)?;
                        times.push(renderer.times());
                    }
                    let bytes = renderer.bytes_per_particle();
                    let cost = cost(&times, renderer.counts(), bytes);
                    (cost, errors, data_errors, from_baseline)
                }
                _ => {
                    let Some(cell) = Cell::find(&cells, &variant.settings) else {
                        continue;
                    };
                    if let Some(image) = &cell.image {
                        pictures.push(Picture {
                            id: variant.id.clone(),
                            image: image.clone(),
                        });
                    }
                    let cost = cost(&cell.times, cell.counts, bytes);
                    (cost, cell.errors, cell.from_data, cell.alone)
                }
            };
        rows.push(Row {
            id: variant.id.clone(),
            label: variant.label.clone(),
            mark: variant.mark.clone(),
            group: variant.group,
            settings: (&variant.settings).into(),
            kernel_width: variant.kernel_width,
            changes_signal: variant.changes_signal(base),
            changes_pixels: variant.changes_pixels(base),
            cost,
            errors,
            from_data: data_errors,
            from_baseline,
            on_front: false,
            on_data_front: false,
        });
    }
    mark_front(&mut rows);
    let mut budget = budget(
        &rows,
        &cells,
        &budget_variants,
        compare(subject.reference, &baseline)?,
    );
    if let Some(kernels) = subject.reference_kernels {
        budget.rows.extend(reference_rows(
            compare(subject.reference, kernels)?,
            compare(kernels, &baseline)?,
        ));
    }
    if let Some(data) = subject.reference_data {
        budget
            .rows
            .push(data_row(compare(data, subject.reference)?));
    }
    step("");
    Ok(Report {
        about,
        machine: Machine::here(),
        camera: subject.camera.into(),
        particles: subject.renderer.particle_count(),
        frames: options.frames,
        budget,
        rows,
        reference_image: subject.reference.clone(),
        reference_data_image: subject.reference_data.cloned(),
        pictures,
    })
}

/// Measurements of one combination of settings.
struct Cell {
    settings: Settings,
    /// Against the reference.
    errors: ImageErrors,
    /// Against the data's own field.
    from_data: Option<ImageErrors>,
    /// Against the baseline.
    alone: ImageErrors,
    /// Image, kept for some variants.
    image: Option<Image>,
    counts: FrameCounts,
    times: Vec<StageTimes>,
}

impl Cell {
    fn find<'a>(cells: &'a [Self], settings: &Settings) -> Option<&'a Self> {
        cells.iter().find(|cell| cell.settings == *settings)
    }
}

fn cost(times: &[StageTimes], counts: FrameCounts, bytes_per_particle: f64) -> Cost {
    let times_ms = median_times(times);
    let core_seconds = times_ms.rasterise / 1e3 * rayon::current_num_threads() as f64;
    Cost {
        times_ms,
        splat_pixels: counts.splat_pixels,
        footprints: counts.footprints,
        footprints_affine: counts.footprints - counts.footprints_exact - counts.footprints_near,
        footprints_exact: counts.footprints_exact,
        footprints_near: counts.footprints_near,
        bytes_per_particle,
        splat_pixels_per_core_second: (core_seconds > 0.0)
            .then(|| counts.splat_pixels as f64 / core_seconds),
    }
}

fn budget(
    rows: &[Row],
    cells: &[Cell],
    variants: &[Variant],
    baseline_errors: ImageErrors,
) -> Budget {
    // If the given settings are the most accurate ones, they are listed once, as the default.
    let baseline = rows.iter().find(|row| row.id == ACCURATE).or(rows.first());
    let baseline_frame_ms = baseline.map_or(0.0, |row| row.cost.times_ms.frame);
    let row = |variant: &Variant| {
        let cell = Cell::find(cells, &variant.settings)?;
        let frame_ms = median_times(&cell.times).frame;
        Some(BudgetRow {
            id: variant.id.clone(),
            label: variant.label.clone(),
            alone: cell.alone,
            compares: "splatted with it and without".into(),
            against_reference: Some(cell.errors),
            saving: Some(Saving::new(frame_ms, baseline_frame_ms)),
        })
    };
    Budget {
        baseline: baseline.map_or_else(String::new, |row| row.id.clone()),
        baseline_frame_ms,
        baseline_errors,
        rows: variants.iter().filter_map(row).collect(),
    }
}

/// Returns the approximations of splatting itself, whatever its settings.
fn reference_rows(low_pass: ImageErrors, sorting: ImageErrors) -> [BudgetRow; 2] {
    [
        reference_row(
            "splatting-low-pass",
            "low-pass on depths instead of opacities",
            "both integrated: pixel filter on the image, and on each kernel",
            low_pass,
        ),
        reference_row(
            "splatting-sorting",
            "whole kernels sorted, not overlapping",
            "the baseline, and integrated with the pixel filter on each kernel",
            sorting,
        ),
    ]
}

/// Returns the error of kernels relative to the data, however the kernels are drawn.
fn data_row(kernels: ImageErrors) -> BudgetRow {
    reference_row(
        "kernels-for-data",
        "kernels in place of the data's own field",
        "both integrated: the data interpolated, and their kernels",
        kernels,
    )
}

fn reference_row(id: &str, label: &str, compares: &str, alone: ImageErrors) -> BudgetRow {
    BudgetRow {
        id: id.into(),
        label: label.into(),
        alone,
        compares: compares.into(),
        against_reference: None,
        saving: None,
    }
}

fn mark_front(rows: &mut [Row]) {
    for i in front_of(rows, |row| (!row.changes_signal).then_some(row.errors.rmse)) {
        rows[i].on_front = true;
    }
    for i in front_of(rows, Row::data_rmse) {
        rows[i].on_data_front = true;
    }
}

/// Returns the rows that no other beats in both time and error; rows without an error are ignored.
pub(super) fn front_of(rows: &[Row], error: impl Fn(&Row) -> Option<f64>) -> Vec<usize> {
    let points: Vec<(f64, f64)> = rows
        .iter()
        .map(|row| match error(row) {
            Some(error) => (row.cost.times_ms.frame, error),
            None => (f64::INFINITY, f64::INFINITY),
        })
        .collect();
    pareto_front(&points)
}
