//! Counts the work, bytes and times of each rank in a frame.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::blocks::BlockedScene;
use crate::frame::backend::FrameReport;
use crate::stats::FrameCounts;

/// Data held, work done and bytes exchanged by one rank for the last frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct RankStats {
    /// Particles that the rank holds, without merged ones.
    pub particles: u64,
    /// Bytes of the scene that the rank keeps: particles, levels of detail, and the blocks of all ranks. For a prepared
    /// scene, which is mapped: the bytes that the rank may come to read. For a lattice that ranks built together: the
    /// values of its own cells, without the planes beside them.
    pub bytes: u64,
    /// Tiles that the rank draws.
    pub tiles: u64,
    /// Particles that the transfer function leaves visible, in its blocks in view.
    pub classified: u64,
    /// Number of the classified particles in volumes whose kernels are classified over their extents.
    pub pieces: u64,
    /// Footprints of the rank's particles that reach the image.
    pub footprints_made: u64,
    /// Number of these that are surfels of opaque surfaces.
    pub surfels: u64,
    /// Number of these on the exact path.
    pub footprints_exact: u64,
    /// Number of these whose kernels cross the camera plane.
    pub footprints_near: u64,
    /// Footprints sent, also to itself: one for each rank that draws a tile of the footprint's box.
    pub footprints_sent: u64,
    /// Footprints received.
    pub footprints_received: u64,
    /// Bytes of the footprints sent.
    pub bytes_sent: u64,
    /// Bytes of the footprints received.
    pub bytes_received: u64,
    /// Entries in the lists of the rank's tiles.
    pub tile_entries: u64,
    /// Kernels evaluated at pixel centres within their cut-off.
    pub splat_pixels: u64,
    /// Times in milliseconds.
    pub times: RankTimes,
}

/// Times of a rank's frame, in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct RankTimes {
    /// Culling of all ranks' blocks.
    pub cull: f64,
    /// Classification.
    pub classify: f64,
    /// Projection.
    pub project: f64,
    /// Sorting footprints by the ranks that draw them, and by depth.
    pub sort: f64,
    /// Sending, and waiting for other ranks.
    pub exchange: f64,
    /// Making the lists of tiles.
    pub bin: f64,
    /// Drawing.
    pub rasterise: f64,
    /// Making images of tiles, on the first rank only.
    pub resolve: f64,
    /// The whole frame.
    pub frame: f64,
}

impl RankStats {
    /// Returns the statistics of a rank that has drawn nothing yet.
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
            // The blocks of a lattice are not stored one after another: only its values are partitioned.
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

    /// Adds this rank's counts and times of a frame.
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

    /// Sums the counts of all ranks; the sums equal the counts of a single machine. Counts that every rank takes of the
    /// whole scene are not summed.
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

    /// Returns the greatest work of a rank over the mean: 1 if all did the same, or nothing.
    pub fn balance(ranks: &[Self], of: impl Fn(&Self) -> f64) -> f64 {
        let most = ranks.iter().map(&of).fold(0.0, f64::max);
        let mean = ranks.iter().map(&of).sum::<f64>() / ranks.len().max(1) as f64;
        if mean > 0.0 { most / mean } else { 1.0 }
    }
}
