//! What each rank did for a frame.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::blocks::BlockedScene;
use crate::render::backend::FrameReport;
use crate::stats::FrameCounts;

/// What one rank has, did and exchanged for the last frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct RankStats {
    /// Particles that it has, without merged ones.
    pub particles: u64,
    /// Bytes that it keeps of the scene: particles, levels of detail, and the blocks of all ranks. Of a prepared scene,
    /// which is mapped, those that it may come to read; of a lattice that ranks have made together the values of its own
    /// cells (those beside its planes come on top).
    pub bytes: u64,
    /// Tiles that it draws.
    pub tiles: u64,
    /// Particles that the transfer function leaves visible, in its blocks in view.
    pub classified: u64,
    /// Of these, in volumes whose kernels are classified over their extents.
    pub pieces: u64,
    /// Footprints of its particles that reach the image.
    pub footprints_made: u64,
    /// Of these, surfels of opaque surfaces.
    pub surfels: u64,
    /// Of these, on the exact path.
    pub footprints_exact: u64,
    /// Of these, kernels that cross the camera plane.
    pub footprints_near: u64,
    /// Those that it sent, itself among the receivers: one for each that draws a tile of its box.
    pub footprints_sent: u64,
    /// Those that it received.
    pub footprints_received: u64,
    /// Bytes that it sent with them.
    pub bytes_sent: u64,
    /// Bytes that it received with them.
    pub bytes_received: u64,
    /// Entries of its tiles' lists.
    pub tile_entries: u64,
    /// Kernels evaluated at pixel centres within their cut-off.
    pub splat_pixels: u64,
    /// Milliseconds.
    pub times: RankTimes,
}

/// Milliseconds of a rank's frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct RankTimes {
    /// Culling of all ranks' blocks.
    pub cull: f64,
    /// Classification.
    pub classify: f64,
    /// Projection.
    pub project: f64,
    /// Sorting footprints by who draws them, and by depth.
    pub sort: f64,
    /// Sending and waiting for others.
    pub exchange: f64,
    /// Lists of tiles.
    pub bin: f64,
    /// Drawing.
    pub rasterise: f64,
    /// Making images of tiles; of the first rank alone.
    pub resolve: f64,
    /// The whole frame.
    pub frame: f64,
}

impl RankStats {
    /// Of a rank that has done nothing yet.
    pub(super) fn of(scene: &BlockedScene, own: &[Vec<Range<u32>>]) -> Self {
        let mut stats = Self::default();
        for (volume, own) in scene.volumes().iter().zip(own) {
            let blocks = own.iter().cloned().flatten();
            let count = |i: u32| u64::from(volume.blocks[i as usize].count);
            let particles = blocks.map(count).sum::<u64>();
            let bytes = volume.bytes() as u64;
            let all = volume.particle_count().max(1) as u64;
            let of_values = match &volume.values {
                Some(values) if values.is_mapped() => all * values.bytes_per_value() as u64,
                _ => 0,
            };
            // Of a lattice, whose blocks do not lie one after the other, its values alone.
            let apart = match volume.is_mapped() {
                true => bytes - size_of_val(&*volume.blocks) as u64,
                false => of_values,
            };
            stats.bytes += bytes - apart + apart / all * particles;
            if volume.merged.is_none() {
                stats.particles += particles;
            }
        }
        stats
    }

    /// Adds what a frame counted here, and how long it took.
    pub(super) fn add(&mut self, report: &FrameReport) {
        let FrameReport { counts, times } = report;
        self.classified = counts.classified as u64;
        self.pieces = counts.pieces as u64;
        self.surfels = counts.surfels as u64;
        self.footprints_exact = counts.footprints_exact as u64;
        self.footprints_near = counts.footprints_near as u64;
        self.tile_entries = counts.tile_entries as u64;
        self.splat_pixels = counts.splat_pixels;
        self.times = RankTimes {
            cull: times.cull,
            classify: times.classify,
            project: times.project,
            sort: self.times.sort + times.sort,
            exchange: self.times.exchange,
            bin: times.bin,
            rasterise: times.rasterise,
            resolve: times.resolve,
            frame: times.frame,
        };
    }

    /// What all ranks counted, which is what one machine alone would have; what each counts of the whole stays.
    pub(super) fn sum(ranks: &[Self], counts: &mut FrameCounts) {
        let sum = |of: fn(&Self) -> u64| ranks.iter().map(of).sum::<u64>();
        let count = |of| sum(of) as usize;
        counts.classified = count(|rank| rank.classified);
        counts.pieces = count(|rank| rank.pieces);
        counts.footprints = count(|rank| rank.footprints_made);
        counts.surfels = count(|rank| rank.surfels);
        counts.footprints_exact = count(|rank| rank.footprints_exact);
        counts.footprints_near = count(|rank| rank.footprints_near);
        counts.tile_entries = count(|rank| rank.tile_entries);
        counts.splat_pixels = sum(|rank| rank.splat_pixels);
    }

    /// The greatest of what ranks did over its mean: 1 where all did the same, or nothing.
    pub fn balance(ranks: &[Self], of: impl Fn(&Self) -> f64) -> f64 {
        let most = ranks.iter().map(&of).fold(0.0, f64::max);
        let mean = ranks.iter().map(&of).sum::<f64>() / ranks.len().max(1) as f64;
        if mean > 0.0 { most / mean } else { 1.0 }
    }
}
