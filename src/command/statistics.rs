//! Collects the counts and times of `ewa-splat render --stats`.

use std::path::Path;
use std::time::Instant;

use crate::Result;
use crate::io::write_bytes_atomically;
use crate::measure::median_times;
use crate::ranks::RankStats;
use crate::render::{FrameCounts, StageTimes};
use crate::stages::blocks::{BlockedParticles, BlockedVolume};
use crate::{Filter, Renderer};
use serde_json::json;

/// Times of the work before the first frame, in milliseconds.
#[derive(Debug, Clone, Copy)]
pub struct Prepared {
    /// Start of the command.
    pub begun: Instant,
    /// Time of reading and sampling.
    pub read_ms: f64,
    /// Time of sorting into blocks.
    pub prepare_ms: f64,
    /// Number of kernels that are parts of refined cells, and their greatest level.
    pub refined: (usize, u8),
}

/// Returns whether `--stats` asks for standard output.
pub(super) fn is_standard_output(path: &Path) -> bool {
    path == Path::new("-")
}

/// Writes statistics to a file, or to standard output.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn write_stats(path: &Path, stats: &serde_json::Value) -> Result<()> {
    if is_standard_output(path) {
        super::say!("{stats:#}");
        return Ok(());
    }
    write_bytes_atomically(path, format!("{stats:#}\n").as_bytes())
}

/// Bytes of a refined kernel: position, factor, volume, value and local model.
const REFINED_BYTES: usize = 24 + 24 + 4 + 4 + 6;

/// Returns the counts of the last frame, and the times of the last frame and of all frames in
/// `times`.
pub fn stats(renderer: &Renderer, times: &[StageTimes], prepared: Prepared) -> serde_json::Value {
    let counts: FrameCounts = renderer.counts();
    let median = median_times(times);
    // Adapter that drew the last frame; the CPU may have taken over from it.
    let adapter = renderer.adapter().filter(|_| renderer.fallback().is_none());
    let of_filter = |filter: Filter| counts.block_filters[filter as usize];
    let is_flat = |v: &&BlockedVolume| matches!(v.particles, BlockedParticles::Surfels { .. });
    let surfels = renderer.volumes().iter().filter(is_flat);
    let surfels: usize = surfels.map(BlockedVolume::particle_count).sum();
    let mut stats = json!({
        "particles": renderer.particle_count(),
        "surfels": surfels,
        "refined": {
            "kernels": prepared.refined.0,
            "levels": prepared.refined.1,
            "bytes": prepared.refined.0 * REFINED_BYTES,
        },
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
        "lattice_level": counts.lattice_level,
        "supersampled_tiles": counts.supersampled_tiles,
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
            "choose": median.choose,
            "shadow": median.shadow,
            "cull": median.cull,
            "classify": median.classify,
            "project": median.project,
            "sort": median.sort,
            "bin": median.bin,
            "rasterise": median.rasterise,
            "resolve": median.resolve,
            "frame": median.frame,
        },
        "shadow_ms": times.iter().map(|own| own.shadow).fold(0.0, f64::max),
        "time_to_picture_ms": prepared.begun.elapsed().as_secs_f64() * 1e3,
        "frames": times.len(),
    });
    let ranks = renderer.rank_stats();
    if !ranks.is_empty() {
        stats["particles"] = json!(ranks.iter().map(|rank| rank.particles).sum::<u64>());
        stats["ranks"] = ranks.iter().map(of_rank).collect();
        let balance = |of: fn(&RankStats) -> f64| RankStats::balance(ranks, of);
        stats["balance"] = json!({
            "particles": balance(|rank| rank.particles as f64),
            "bytes": balance(|rank| rank.bytes as f64),
            "footprints_made": balance(|rank| rank.footprints_made as f64),
            "footprints_received": balance(|rank| rank.footprints_received as f64),
            "splat_pixels": balance(|rank| rank.splat_pixels as f64),
        });
    }
    stats
}

/// Returns the counts and times of one rank.
fn of_rank(rank: &RankStats) -> serde_json::Value {
    let times = &rank.times;
    json!({
        "particles": rank.particles,
        "bytes": rank.bytes,
        "tiles": rank.tiles,
        "classified": rank.classified,
        "footprints_made": rank.footprints_made,
        "footprints_sent": rank.footprints_sent,
        "footprints_received": rank.footprints_received,
        "bytes_sent": rank.bytes_sent,
        "bytes_received": rank.bytes_received,
        "tile_entries": rank.tile_entries,
        "splat_pixels": rank.splat_pixels,
        "times_ms": {
            "cull": times.cull,
            "classify": times.classify,
            "project": times.project,
            "sort": times.sort,
            "exchange": times.exchange,
            "bin": times.bin,
            "rasterise": times.rasterise,
            "resolve": times.resolve,
            "frame": times.frame,
        },
    })
}
