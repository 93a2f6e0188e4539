//! Draws every variant, times it and holds it against the reference.

use super::report::{About, Budget, BudgetRow, Cost, Machine, Picture, Report, Row, Saving};
use super::variants::{self, ACCURATE, Variant};
use super::{ImageErrors, compare, median_times, pareto_front};
use crate::error::Result;
use crate::image::Image;
use crate::render::{Renderer, Settings};
use crate::scene::PointVolume;
use crate::view::Camera;

/// What is measured.
#[derive(Debug)]
pub struct Subject<'a> {
    /// The scene made ready.
    pub renderer: &'a mut Renderer,
    /// The view.
    pub camera: &'a Camera,
    /// The true image.
    pub reference: &'a Image,
    /// The true image with the low-pass filter on each kernel's depth instead of on the image;
    /// without it the budget says nothing about the reference itself.
    pub reference_kernels: Option<&'a Image>,
    /// Where the scene can be sampled with kernels of another width.
    pub resampling: Option<Resampling<'a>>,
}

/// How to sample the scene with kernels of another width.
#[derive(Clone, Copy)]
pub struct Resampling<'a> {
    /// The width over spacing that the scene has.
    pub kernel_width: f64,
    /// The scene at a width over spacing.
    pub scene: &'a dyn Fn(f64) -> Result<Vec<PointVolume>>,
}

impl std::fmt::Debug for Resampling<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Resampling")
            .field("kernel_width", &self.kernel_width)
            .finish_non_exhaustive()
    }
}

/// How it is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepOptions {
    /// Frames of which times are the medians, after one that warms up.
    pub frames: usize,
    /// The settings that variants change.
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

/// How far a sweep is.
#[derive(Debug, Clone, Copy)]
pub struct SweepProgress<'a> {
    /// Variants done.
    pub done: usize,
    /// Variants in all.
    pub total: usize,
    /// The variant that comes next.
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
/// Pictures over no background; `options.base.background` should be `None`, as the reference's.
///
/// # Errors
/// What rendering, sampling anew or comparing says: a reference of another size, pixels that are
/// not finite.
pub fn sweep(
    subject: &mut Subject<'_>,
    about: About,
    options: &SweepOptions,
    progress: &mut dyn FnMut(SweepProgress<'_>),
) -> Result<Report> {
    let base = &options.base;
    let width = subject.resampling.map(|r| r.kernel_width);
    let variants = variants::variants(base, width);
    let budget_variants = variants::budget_variants(base);
    let total = variants.len() + budget_variants.len();
    let particles = particle_count(subject.renderer);

    let mut rows = Vec::with_capacity(variants.len());
    let mut pictures = Vec::new();
    let mut baseline = None;
    for (done, variant) in variants.iter().enumerate() {
        progress(SweepProgress {
            done,
            total,
            label: &variant.label,
        });
        let (cost, image) = match (variant.kernel_width, subject.resampling) {
            (Some(width), Some(resampling)) => {
                let mut renderer = Renderer::new((resampling.scene)(width)?)?;
                let cost = time(&mut renderer, subject.camera, variant, options.frames)?;
                (cost, renderer.image().clone())
            }
            _ => {
                let cost = time(subject.renderer, subject.camera, variant, options.frames)?;
                (cost, subject.renderer.image().clone())
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
            cost,
            errors: compare(subject.reference, &image)?,
            on_front: false,
        });
        if variant.id == ACCURATE {
            baseline = Some((cost.times_ms.frame, image.clone()));
        }
        if PICTURED.contains(&variant.id.as_str()) {
            pictures.push(Picture {
                id: variant.id.clone(),
                image,
            });
        }
    }
    mark_front(&mut rows);

    // Where the settings given are the accurate ones, they are listed once, as the default.
    let (baseline_id, (baseline_frame_ms, baseline_image)) = match baseline {
        Some(baseline) => (ACCURATE, baseline),
        None => {
            let image = subject.renderer.render(subject.camera, base)?.clone();
            let frame = rows.first().map_or(0.0, |row| row.cost.times_ms.frame);
            (variants::DEFAULT, (frame, image))
        }
    };
    let mut budget = Budget {
        baseline: baseline_id.into(),
        baseline_frame_ms,
        baseline_errors: compare(subject.reference, &baseline_image)?,
        rows: Vec::new(),
    };
    for (i, variant) in budget_variants.iter().enumerate() {
        progress(SweepProgress {
            done: variants.len() + i,
            total,
            label: &variant.label,
        });
        let cost = time(subject.renderer, subject.camera, variant, options.frames)?;
        let image = subject.renderer.image();
        budget.rows.push(BudgetRow {
            id: variant.id.clone(),
            label: variant.label.clone(),
            alone: compare(&baseline_image, image)?,
            compares: "with it and without, splatted".into(),
            against_reference: Some(compare(subject.reference, image)?),
            saving: Some(Saving::new(cost.times_ms.frame, baseline_frame_ms)),
        });
    }
    if let Some(kernels) = subject.reference_kernels {
        budget.rows.extend(reference_rows(
            compare(subject.reference, kernels)?,
            compare(kernels, &baseline_image)?,
        ));
    }
    progress(SweepProgress {
        done: total,
        total,
        label: "",
    });
    Ok(Report {
        about,
        machine: Machine::here(),
        camera: subject.camera.into(),
        particles,
        frames: options.frames,
        rows,
        budget,
        reference_image: subject.reference.clone(),
        pictures,
    })
}

/// What splatting itself approximates, whatever its settings.
fn reference_rows(low_pass: ImageErrors, sorting: ImageErrors) -> [BudgetRow; 2] {
    let row = |id: &str, label: &str, compares: &str, alone| BudgetRow {
        id: id.into(),
        label: label.into(),
        alone,
        compares: compares.into(),
        against_reference: None,
        saving: None,
    };
    [
        row(
            "splatting-low-pass",
            "low-pass on depths instead of opacities",
            "both integrated: pixel filter on the image, and on each kernel",
            low_pass,
        ),
        row(
            "splatting-sorting",
            "whole kernels sorted, not overlapping",
            "the baseline, and integrated with the pixel filter on each kernel",
            sorting,
        ),
    ]
}

/// A warm-up and then `frames` frames; the renderer holds the last.
fn time(
    renderer: &mut Renderer,
    camera: &Camera,
    variant: &Variant,
    frames: usize,
) -> Result<Cost> {
    renderer.render(camera, &variant.settings)?;
    let mut times = Vec::with_capacity(frames);
    for _ in 0..frames {
        renderer.render(camera, &variant.settings)?;
        times.push(renderer.times());
    }
    if times.is_empty() {
        times.push(renderer.times());
    }
    let times_ms = median_times(&times);
    let counts = renderer.counts();
    let core_seconds = times_ms.rasterise / 1e3 * rayon::current_num_threads() as f64;
    let bytes: f64 = renderer
        .volumes()
        .iter()
        .map(|v| v.bytes_per_particle() * v.particle_count() as f64)
        .sum();
    Ok(Cost {
        times_ms,
        splat_pixels: counts.splat_pixels,
        footprints: counts.footprints,
        footprints_affine: counts.footprints - counts.footprints_exact - counts.footprints_near,
        footprints_exact: counts.footprints_exact,
        footprints_near: counts.footprints_near,
        bytes_per_particle: bytes / particle_count(renderer).max(1) as f64,
        splat_pixels_per_core_second: (core_seconds > 0.0)
            .then(|| counts.splat_pixels as f64 / core_seconds),
    })
}

fn particle_count(renderer: &Renderer) -> usize {
    renderer.volumes().iter().map(|v| v.particle_count()).sum()
}

fn mark_front(rows: &mut [Row]) {
    let points: Vec<(f64, f64)> = rows
        .iter()
        .map(|row| {
            if row.changes_signal {
                (f64::INFINITY, f64::INFINITY)
            } else {
                (row.cost.times_ms.frame, row.errors.rmse)
            }
        })
        .collect();
    for i in pareto_front(&points) {
        rows[i].on_front = true;
    }
}
