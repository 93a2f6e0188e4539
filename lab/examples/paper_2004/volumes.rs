//! Reproduces table 3: adaptive filters against EWA on volumes. Claim: 9 to 21 % more frames, the same image.

use ewa_splat::Filter;
use ewa_splat::measure::{PAPER_THRESHOLDS, compare};
use ewa_splat::render::Advanced;
use ewa_splat::scene::TransferFunction;
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Result, Settings};
use glam::DVec3;

use crate::papers::volumes::{Volume, engine, head, nucleon, transfer};
use crate::papers::{Arguments, fitted_camera, times};

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    println!(
        "{0} x {0}, {1} threads, medians of {2} frames; errors in 255ths, from EWA",
        arguments.size,
        rayon::current_num_threads(),
        arguments.frames
    );
    println!(
        "{:>14} {:>6} {:>9} {:>7} {:>12} {:>8} {:>9} {:>8} {:>8} {:>8}",
        "data", "view", "visible", "of all", "filter", "ms", "ewa's:1", "rms", "99.9 %", "FLIP"
    );
    for (volume, transfer) in volumes(arguments.size)? {
        measure(&volume, &transfer, arguments)?;
    }
    Ok(())
}

/// Returns the available volumes, each with a transfer function that leaves its inside translucent.
pub(crate) fn volumes(size: usize) -> Result<Vec<(Volume, TransferFunction)>> {
    let (cold, warm) = ([0.15, 0.35, 0.8], [1.0, 0.75, 0.35]);
    let between = |clear: f32, soft: f32, hard: f32| {
        transfer(&[
            (clear, cold, 0.0),
            (soft, cold, 0.03),
            (hard - 10.0, cold, 0.03),
            (hard, warm, 0.4),
        ])
    };
    let mut all = Vec::new();
    if let Some(engine) = engine()? {
        all.push((engine, between(100.0, 120.0, 190.0)?));
    }
    if let Some(nucleon) = nucleon()? {
        all.push((nucleon, between(20.0, 60.0, 150.0)?));
    }
    all.push((head(size), between(20.0, 50.0, 150.0)?));
    Ok(all)
}

/// Returns three views: all of the volume; from so far that a voxel is a fraction of a pixel; and from near.
fn views(renderer: &Renderer, size: usize) -> Vec<(&'static str, Camera)> {
    let Some(fitted) = fitted_camera(renderer, size) else {
        return Vec::new();
    };
    let middle = DVec3::ZERO;
    let far = Camera {
        eye: middle + (fitted.eye - middle) * 6.0,
        ..fitted.clone()
    };
    let near = Camera {
        eye: middle + (fitted.eye - middle) * 0.35,
        ..fitted.clone()
    };
    vec![("fitted", fitted), ("far", far), ("near", near)]
}

fn measure(volume: &Volume, transfer: &TransferFunction, arguments: &Arguments) -> Result<()> {
    let mut renderer = Renderer::new(volume.scene(transfer)?)?;
    let of = |filter, thresholds| Settings {
        filter,
        advanced: Advanced {
            thresholds,
            ..Advanced::default()
        },
        ..Settings::default()
    };
    let names = ["ewa", "thresholds", "adaptive"];
    let settings = [
        of(Filter::Ewa, None),
        of(Filter::Adaptive, Some(PAPER_THRESHOLDS)),
        of(Filter::Adaptive, None),
    ];
    for (view, camera) in views(&renderer, arguments.size) {
        let times = times(&mut renderer, &camera, &settings, arguments.frames)?;
        let ewa = renderer.render(&camera, &settings[0])?.clone();
        let visible = renderer.counts().classified;
        let file = volume.name.replace(' ', "-");
        arguments.write(&format!("{file}-{view}.png"), &ewa)?;
        for ((name, settings), ms) in names.iter().zip(&settings).zip(&times) {
            let errors = compare(renderer.render(&camera, settings)?, &ewa)?;
            println!(
                "{:>14} {view:>6} {visible:>9} {:>5.1} % {name:>12} {ms:>8.1} {:>9.2} {:>8.2} {:>8.2} \
                 {:>8.4}",
                volume.name,
                100.0 * visible as f64 / volume.values.len() as f64,
                times[0] / ms,
                errors.rmse * 255.0,
                errors.p999 * 255.0,
                errors.flip.unwrap_or(f64::NAN)
            );
        }
    }
    Ok(())
}
