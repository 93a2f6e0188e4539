//! Defines the counts of a frame and the times of its stages.

use crate::clock::Instant;

use serde::Serialize;

/// Counts of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameCounts {
    /// Number of blocks of all volumes and of their levels of detail.
    pub blocks: usize,
    /// Number of blocks outside the view, transparent, or replaced by merged particles.
    pub blocks_culled: usize,
    /// Number of drawn blocks by filter, in the order of [`Filter::ALL`](crate::splat::Filter::ALL). The first
    /// counts blocks whose filter was chosen for each kernel separately.
    pub block_filters: [usize; 7],
    /// Number of drawn blocks of merged particles.
    pub blocks_merged: usize,
    /// Number of particles in the remaining blocks that the transfer function leaves visible.
    pub classified: usize,
    /// Number of pieces among these, for volumes whose kernels were classified over their extents. A kernel has
    /// one piece for each lobe of the transfer function that contributes to it.
    pub pieces: usize,
    /// Number of footprints that reach the image.
    pub footprints: usize,
    /// Number of these that are surfels of opaque surfaces.
    pub surfels: usize,
    /// Number of these on the exact path.
    pub footprints_exact: usize,
    /// Number of these whose kernels cross the camera plane.
    pub footprints_near: usize,
    /// Number of times that the samples of lattices were halved along each axis: the picture shows coarser lattices
    /// where that errs by less than the tolerance. 0 for the samples themselves.
    pub lattice_level: usize,
    /// Number of tiles that contain opaque edges, and whose pixels are means of four samples.
    pub supersampled_tiles: usize,
    /// Number of kernels at a slice whose sections are narrower than a pixel: those between pixels' centres do not show.
    pub narrow: usize,
    /// Number of entries of the tiles' lists.
    pub tile_entries: usize,
    /// Number of kernel evaluations at pixel centres within the cut-off.
    pub splat_pixels: u64,
}

impl FrameCounts {
    /// Adds the counts of a frame that drew another part of the picture.
    pub(crate) fn add(&mut self, part: &Self) {
        let Self {
            blocks,
            blocks_culled,
            block_filters,
            blocks_merged,
            classified,
            pieces,
            footprints,
            surfels,
            footprints_exact,
            footprints_near,
            lattice_level,
            supersampled_tiles,
            narrow,
            tile_entries,
            splat_pixels,
        } = *part;
        self.blocks += blocks;
        self.blocks_culled += blocks_culled;
        for (own, of_part) in self.block_filters.iter_mut().zip(block_filters) {
            *own += of_part;
        }
        self.blocks_merged += blocks_merged;
        self.classified += classified;
        self.pieces += pieces;
        self.footprints += footprints;
        self.surfels += surfels;
        self.footprints_exact += footprints_exact;
        self.footprints_near += footprints_near;
        self.lattice_level = self.lattice_level.max(lattice_level);
        self.supersampled_tiles += supersampled_tiles;
        self.narrow += narrow;
        self.tile_entries += tile_entries;
        self.splat_pixels += splat_pixels;
    }
}

/// Milliseconds per stage of a frame.
///
/// On the GPU the stages' times are the device's own timestamps, 0 if the adapter has none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[allow(missing_docs, reason = "each is the stage of its name")]
pub struct StageTimes {
    /// Choosing the level of lattices.
    pub choose: f64,
    /// Making the shadows of lights, unless those of an earlier frame remain.
    pub shadow: f64,
    pub cull: f64,
    pub classify: f64,
    pub project: f64,
    pub sort: f64,
    pub bin: f64,
    pub rasterise: f64,
    pub resolve: f64,
    /// The whole frame, as long as the caller waits for it.
    pub frame: f64,
}

impl StageTimes {
    /// Adds the times of another frame.
    pub(crate) fn add(&mut self, other: &Self) {
        self.choose += other.choose;
        self.shadow += other.shadow;
        self.cull += other.cull;
        self.classify += other.classify;
        self.project += other.project;
        self.sort += other.sort;
        self.bin += other.bin;
        self.rasterise += other.rasterise;
        self.resolve += other.resolve;
        self.frame += other.frame;
    }
}

/// Measures [`StageTimes`] on the processor.
#[derive(Debug)]
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }

    /// Returns the milliseconds since the last lap, or the start.
    pub(crate) fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let elapsed = now - std::mem::replace(&mut self.0, now);
        elapsed.as_secs_f64() * 1e3
    }
}
