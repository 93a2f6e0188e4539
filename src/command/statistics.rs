//! `ewa-splat render --stats`: what was counted, and how long it took.

use std::time::Instant;

use crate::measure::median_times;
use crate::render::{FrameCounts, StageTimes};
use crate::stages::blocks::{BlockedParticles, BlockedVolume};
use crate::{Filter, Renderer};
use serde_json::json;

/// Milliseconds before the first frame.
#[derive(Debug, Clone, Copy)]
pub struct Prepared {
    /// When the command began.
    pub begun: Instant,
    /// Reading and sampling.
    pub read_ms: f64,
    /// Sorting into blocks.
    pub prepare_ms: f64,
}

/// The counts and times of the last frame; `times` of all.
pub fn stats(renderer: &Renderer, times: &[StageTimes], prepared: Prepared) -> serde_json::Value {
    let counts: FrameCounts = renderer.counts();
    let median = median_times(times);
    // What drew the last frame.
    let adapter = renderer.adapter().filter(|_| renderer.fallback().is_none());
    let of_filter = |filter: Filter| counts.block_filters[filter as usize];
    let is_flat = |v: &&BlockedVolume| matches!(v.particles, BlockedParticles::Surfels { .. });
    let surfels = renderer.volumes().iter().filter(is_flat);
    let surfels: usize = surfels.map(BlockedVolume::particle_count).sum();
    json!({
        "particles": renderer.particle_count(),
        "surfels": surfels,
        "blocks": {
            "total": counts.blocks,
            "culled": counts.blocks_culled,
            "by_particle": of_filter(Filter::Adaptive),
            "exact": of_filter(Filter::Exact),
            "ewa": of_filter(Filter::Ewa),
            "reconstruction": of_filter(Filter::Reconstruction),
            "low_pass": of_filter(Filter::LowPass),
            "isotropic": of_filter(Filter::Isotropic),
            "uniform_scaling": of_filter(Filter::UniformScaling),
            "merged": counts.blocks_merged,
        },
        "classified": counts.classified,
        "pieces": counts.pieces,
        "footprints": counts.footprints,
        "footprint_paths": {
            "affine": counts.footprints - counts.footprints_exact - counts.footprints_near,
            "exact": counts.footprints_exact,
            "near": counts.footprints_near,
        },
        "tile_entries": counts.tile_entries,
        "layer_thickness": renderer.layers().map(|layers| layers.thickness),
        "layer_error": renderer.layers().map(|layers| layers.error),
        "splat_pixels": counts.splat_pixels,
        "bytes_per_particle": renderer.bytes_per_particle(),
        "requirements": renderer.requirements(),
        "backend": if adapter.is_some() { "gpu" } else { "cpu" },
        "fallback": renderer.fallback(),
        "adapter": adapter.unwrap_or_else(|| {
            let level = crate::render::SimdLevel::best();
            format!("{} threads, {level:?}", rayon::current_num_threads())
        }),
        "times_ms": {
            "read": prepared.read_ms,
            "prepare": prepared.prepare_ms,
            "cull": median.cull,
            "classify": median.classify,
            "project": median.project,
            "sort": median.sort,
            "bin": median.bin,
            "rasterise": median.rasterise,
            "resolve": median.resolve,
            "frame": median.frame,
        },
        "time_to_picture_ms": prepared.begun.elapsed().as_secs_f64() * 1e3,
        "frames": times.len(),
    })
}
