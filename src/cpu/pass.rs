//! Runs one pass of a frame on the CPU: all stages but the last.

use std::ops::Range;

use rayon::prelude::*;

use super::frame::CpuFrames;
use super::{bin, classify, light, list_visible, project, rasterise, shade, sort};
use crate::blocks::{
    BlockedScene, BlockedVolume, DepthRange, choose, cull, cull_detail, cull_outside, tiles_of,
};
use crate::constants::{COLUMN_TILE_SIZE, TILE_SIZE};
use crate::cpu::amplitude::{count_amplitudes, fill_amplitudes};
use crate::cpu::classify::count_classified;
use crate::cpu::extent::Pieces;
use crate::cpu::light::Shadowing;
use crate::cpu::project::ProjectInput;
use crate::cpu::shade::encode;
use crate::cpu::tile::{
    ColumnInput, NormalTile, PostClassification, RasteriseSettings, Tile, bin_columns,
    rasterise_surface,
};
use crate::error::Result;
use crate::frame::backend::FrameReport;
use crate::frame::plan::{Carries, Draws, FramePlan, PassPlan};
use crate::record::{
    BlockView, ClassifiedBy, ClassifiedParticle, FootprintTerms, PieceTerms, ViewUniform,
};
use crate::splat::{Accumulate, Axes};
use crate::stats::{FrameCounts, Stopwatch};
use crate::task::check;

/// Greatest number of entries of the tiles' lists held at a time: 400 MB with their sources. If there are
/// more, the picture is drawn in bands; the result is the same.
pub(crate) const MOST_ENTRIES: u64 = 1 << 25;

impl CpuFrames {
    /// Runs all stages of one pass but the last.
    ///
    /// # Errors
    /// Cancelled.
    pub(super) fn draw_pass(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        report: &mut FrameReport,
    ) -> Result<()> {
        let view = self.see(scene, plan, pass, report)?;
        // Without culling, every strip would contain all kernels.
        if plan.culls {
            return self.draw_strips(scene, plan, pass, &view, Self::most_particles, report);
        }
        self.make_footprints(scene, plan, pass, &view, report)?;
        self.order_footprints(pass, &view, report);
        self.count_footprints(pass, self.order.len(), report);
        let rows = (view.size[1] as usize).div_ceil(tile_size(pass));
        self.draw_rows(scene, plan, pass, &view, 0..rows, report)
    }

    /// Draws some rows of tiles from sorted footprints.
    ///
    /// # Errors
    /// Cancelled.
    pub(super) fn draw_rows(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
        rows: Range<usize>,
        report: &mut FrameReport,
    ) -> Result<()> {
        let tile_size = tile_size(pass);
        let columns = (view.size[0] as usize).div_ceil(tile_size);
        for rows in self.bands(view, tile_size, rows, MOST_ENTRIES) {
            let tiles = rows.start * columns..rows.end * columns;
            self.list(pass, view, tiles, report);
            self.draw_tiles(scene, plan, pass, view, report)?;
        }
        Ok(())
    }

    /// Runs the first stage: writes the blocks that the pass draws to `self.views`. Returns the view with
    /// the scale of the depth keys.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn see(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        report: &mut FrameReport,
    ) -> Result<ViewUniform> {
        check(plan.task.as_ref())?;
        self.bins.restrict(plan.tiles.as_deref());
        self.sums.clear();
        let mut clock = Stopwatch::start();
        let view = self.cull(scene, plan, pass, &mut report.counts);
        report.times.cull += clock.lap();
        Ok(view)
    }

    /// Runs the stages from the blocks in `self.views` to footprints.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn make_footprints(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
        report: &mut FrameReport,
    ) -> Result<()> {
        self.count_particles(scene, plan, pass, report)?;
        self.make_counted(scene, plan, pass, view, report)?;
        report.counts.classified += self.classified.len();
        report.counts.pieces += self.terms.len();
        Ok(())
    }

    /// Counts the visible particles of the blocks in `self.views`, and returns their number.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn count_particles(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        report: &mut FrameReport,
    ) -> Result<usize> {
        check(plan.task.as_ref())?;
        let mut clock = Stopwatch::start();
        self.count(scene.volumes(), plan, pass);
        report.times.classify += clock.lap();
        Ok(self.totals.iter().sum())
    }

    /// Makes the footprints of the counted particles.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn make_counted(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
        report: &mut FrameReport,
    ) -> Result<()> {
        let times = &mut report.times;
        let task = plan.task.as_ref();
        let mut clock = Stopwatch::start();
        self.classify(scene.volumes(), plan, pass);
        times.classify += clock.lap();
        check(task)?;

        self.project(scene.volumes(), plan, pass, view);
        times.project += clock.lap();
        check(task)
    }

    /// Adds to the report's counts of footprints; `visible` of them reach the image.
    pub(crate) fn count_footprints(
        &mut self,
        pass: &PassPlan,
        visible: usize,
        report: &mut FrameReport,
    ) {
        let counts = &mut report.counts;
        counts.footprints += visible;
        counts.footprints_near += self.project_output.near_count();
        if pass.axes.accumulate == Accumulate::Opaque {
            counts.surfels += visible;
        }
        if pass.draws == Draws::Volumes {
            counts.footprints_exact += self.project_output.exact_count();
        }
    }

    /// Sorts the footprints, and allocates tiles.
    pub(crate) fn order_footprints(
        &mut self,
        pass: &PassPlan,
        view: &ViewUniform,
        report: &mut FrameReport,
    ) {
        let mut clock = Stopwatch::start();
        if pass.axes.accumulate == Accumulate::Column {
            list_visible(&self.footprints, &mut self.order);
        } else {
            sort(&self.footprints, &mut self.order);
        }
        report.times.sort += clock.lap();
        self.make_room(pass, view);
    }

    /// Makes the lists of a run of tiles.
    pub(crate) fn list(
        &mut self,
        pass: &PassPlan,
        view: &ViewUniform,
        tiles: Range<usize>,
        report: &mut FrameReport,
    ) {
        let mut clock = Stopwatch::start();
        let terms = if pass.axes.accumulate == Accumulate::Opaque {
            FootprintTerms::Surfel(&self.surfels)
        } else {
            FootprintTerms::Exact(&self.exact)
        };
        let bin = if pass.axes.accumulate == Accumulate::Column {
            bin_columns
        } else {
            bin
        };
        let columns = (view.size[0] as usize).div_ceil(tile_size(pass));
        let (footprints, order) = (&self.footprints, &self.order);
        bin(footprints, terms, order, columns, tiles, &mut self.bins);
        report.counts.tile_entries += self.bins.len();
        report.times.bin += clock.lap();
    }

    /// Draws the tiles that have lists.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn draw_tiles(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
        report: &mut FrameReport,
    ) -> Result<()> {
        check(plan.task.as_ref())?;
        let mut clock = Stopwatch::start();
        report.counts.splat_pixels += match pass.axes.accumulate {
            Accumulate::Opaque => self.rasterise_surface(plan, pass, view),
            Accumulate::Column => self.sum_columns(plan, view),
            _ => self.rasterise(scene, plan, pass, view),
        };
        report.times.rasterise += clock.lap();
        check(plan.task.as_ref())
    }

    /// Finds the blocks that the pass draws, their filters and their depth keys. Returns the view with
    /// the scale of the keys.
    fn cull(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        counts: &mut FrameCounts,
    ) -> ViewUniform {
        let camera = &plan.camera;
        let cull_by = plan.culls.then_some(&plan.frustum);
        let volumes = scene.volumes();
        for family in scene.families() {
            let volumes = &volumes[family.clone()];
            let views = &mut self.views[family.clone()];
            views.iter_mut().for_each(Vec::clear);
            if !pass.draws.draws(&volumes[0]) {
                continue;
            }
            if let Carries::Amplitude { .. } = pass.carries {
                // No particle is transparent.
                cull_outside(&volumes[0], camera, cull_by, &mut views[0]);
                for view in &mut views[0] {
                    view.filter_kind = plan.choice.filter_kind;
                }
                continue;
            }
            if plan.has_detail() {
                cull_detail(
                    volumes,
                    camera,
                    cull_by,
                    &plan.choice,
                    &mut self.closed,
                    views,
                );
            } else {
                cull(&volumes[0], camera, cull_by, &plan.choice, &mut views[0]);
            }
            for (volume, views) in volumes.iter().zip(views) {
                choose(volume, camera, &plan.choice, views);
                for view in &*views {
                    counts.block_filters[view.filter_kind as usize] += 1;
                }
                if volume.merged.is_some() {
                    counts.blocks_merged += views.len();
                }
            }
        }
        if pass.axes.accumulate == Accumulate::Column {
            // Depths define no order.
            return pass.view;
        }
        let in_view = volumes
            .iter()
            .zip(&self.views)
            .flat_map(|(volume, views)| {
                let block = |v: &BlockView| (&volume.blocks[v.block as usize], v.is_spread());
                views.iter().map(block)
            })
            .filter(|(block, is_spread)| plan.frustum.sees(camera, block, *is_spread));
        let range = match &pass.layers {
            None => DepthRange::of(
                in_view.map(|(block, is_spread)| pass.distance_interval(camera, block, is_spread)),
            ),
            Some(layers) => layers.depth_range(),
        };
        for (volume, views) in volumes.iter().zip(&mut self.views) {
            for view in views {
                let block = &volume.blocks[view.block as usize];
                view.key = range.key(pass.distance_interval(camera, block, false).0);
            }
        }
        if let Some(tiles) = &plan.tiles {
            let tiles = DrawnTiles::new(tiles, tile_grid(&pass.view)[0]);
            for (volume, views) in volumes.iter().zip(&mut self.views) {
                views.retain(|view| {
                    let block = &volume.blocks[view.block as usize];
                    let reached = plan.frustum.reached(camera, block, view.is_spread());
                    reached.is_none_or(|pixels| tiles.meet(pixels))
                });
            }
        }
        ViewUniform {
            key_scale: range.keys_per_unit(),
            ..pass.view
        }
    }

    /// Counts the visible particles of the views, for each volume in `self.totals`.
    fn count(&mut self, volumes: &[BlockedVolume], plan: &FramePlan, pass: &PassPlan) {
        self.pieces.resize_with(volumes.len(), Pieces::default);
        self.totals.clear();
        let of_volumes = volumes.iter().zip(&mut self.views).zip(&mut self.pieces);
        self.totals.extend(
            of_volumes.map(|((volume, views), pieces)| match pass.carries {
                Carries::Amplitude { scale, .. } => count_amplitudes(volume, views, scale),
                _ if has_pieces(plan, volume) => pieces.find(volume, views),
                _ => count_classified(volume, views),
            }),
        );
    }

    /// Classifies the counted particles: computes their masses and what they carry.
    fn classify(&mut self, volumes: &[BlockedVolume], plan: &FramePlan, pass: &PassPlan) {
        self.terms.clear();
        overwrite(&mut self.classified, self.totals.iter().sum());
        if let Carries::Amplitude { scale, .. } = pass.carries {
            self.fill_classified(volumes, |_, volume, views, out| {
                fill_amplitudes(volume, views, scale, out);
            });
            return;
        }
        let rotation = plan.camera.camera_from_world.as_mat3();
        let pieces = std::mem::take(&mut self.pieces);
        let mut terms = std::mem::take(&mut self.terms);
        let shadows = plan.shadows.as_ref();
        let shadows = shadows.map(|(grids, uniform)| Shadowing {
            uniform,
            words: grids.words(),
        });
        self.fill_classified(volumes, |i, volume, views, out| {
            let first = terms.len();
            if has_pieces(plan, volume) {
                terms.resize(first + out.len(), PieceTerms::WHOLE);
                pieces[i].place(out, &mut terms[first..]);
            } else {
                classify(volume, views, out);
            }
            shade(volume, views, &plan.camera, plan.is_encoded, out);
            if let (Some(lighting), true) = (&plan.lighting, pass.lights_particles) {
                let pieces = &terms[first..];
                light(volume, views, pieces, rotation, lighting, shadows, out);
            }
            if plan.is_encoded {
                encode(volume, out);
            }
        });
        self.terms = terms;
        self.pieces = pieces;
    }

    /// Fills the positions of the counted particles.
    fn fill_classified(
        &mut self,
        volumes: &[BlockedVolume],
        mut fill: impl FnMut(usize, &BlockedVolume, &[BlockView], &mut [ClassifiedParticle]),
    ) {
        let mut rest = self.classified.as_mut_slice();
        let counted = volumes.iter().zip(&self.views).zip(&self.totals);
        for (i, ((volume, views), &total)) in counted.enumerate() {
            let (out, others) = rest.split_at_mut(total);
            fill(i, volume, views, out);
            rest = others;
        }
    }

    /// Projects the classified particles.
    fn project(
        &mut self,
        volumes: &[BlockedVolume],
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
    ) {
        let count = self.classified.len();
        overwrite(&mut self.footprints, count);
        let all_have_depths = pass.axes.needs_depth_terms();
        let is_opaque = pass.axes.accumulate == Accumulate::Opaque;
        let has_edges = pass.axes.edges;
        let is_exact = !is_opaque && (pass.axes.may_be_exact || all_have_depths || has_edges);
        overwrite(&mut self.exact, if is_exact { count } else { 0 });
        overwrite(&mut self.surfels, if is_opaque { count } else { 0 });
        self.project_output.clear();
        let rotation = plan.camera.camera_from_world.as_mat3();
        let mut rest_of_terms = self.terms.as_slice();
        let mut first = 0;
        for ((volume, views), &total) in volumes.iter().zip(&self.views).zip(&self.totals) {
            let range = first..first + total;
            let own = if has_pieces(plan, volume) { total } else { 0 };
            let (terms, others) = rest_of_terms.split_at(own);
            rest_of_terms = others;
            project(
                &ProjectInput {
                    volume,
                    views,
                    classified: &self.classified[range.clone()],
                    pieces: terms,
                    view,
                    rotation,
                    is_cut: all_have_depths,
                    has_edges,
                    level: plan.simd,
                },
                &mut self.footprints[range.clone()],
                self.exact.get_mut(range.clone()).unwrap_or_default(),
                self.surfels.get_mut(range).unwrap_or_default(),
                &self.project_output,
            );
            first += total;
        }
        if let Some(tiles) = &plan.tiles {
            // Blocks reach farther than most of their kernels.
            let tiles = DrawnTiles::new(tiles, tile_grid(view)[0]);
            self.footprints.par_iter_mut().for_each(|footprint| {
                let pixels = [footprint.column_range(), footprint.row_range()]
                    .map(|(first, end)| [f64::from(first), f64::from(end)]);
                if !tiles.meet(pixels) {
                    (footprint.columns, footprint.rows) = (0, 0);
                }
            });
        }
    }

    /// Allocates the tiles of a pass.
    fn make_room(&mut self, pass: &PassPlan, view: &ViewUniform) {
        let [columns, rows] = tile_grid(view);
        match pass.axes.accumulate {
            Accumulate::Opaque => {
                self.surface.resize_with(columns * rows, Tile::default);
                let wanted = if pass.axes.normals { columns * rows } else { 0 };
                self.surface_normals
                    .resize_with(wanted, NormalTile::default);
            }
            Accumulate::Column => {}
            _ => self.tiles.resize_with(columns * rows, Tile::default),
        }
    }

    /// Returns the ranges of rows of tiles whose lists are made and drawn at once: all rows, unless
    /// footprints touch more than `most` tiles.
    pub(crate) fn bands(
        &self,
        view: &ViewUniform,
        tile_size: usize,
        rows: Range<usize>,
        most: u64,
    ) -> Vec<Range<usize>> {
        if self.project_output.tile_count() <= most {
            return std::iter::once(rows).collect();
        }
        let entries = self.entries_of_rows(view, tile_size);
        let bands = cut_into_bands(&entries[rows.clone()], most).into_iter();
        bands
            .map(|band| rows.start + band.start..rows.start + band.end)
            .collect()
    }

    /// Returns the number of tiles that footprints touch, for each row.
    fn entries_of_rows(&self, view: &ViewUniform, tile_size: usize) -> Vec<u64> {
        let mut counts = vec![0; (view.size[1] as usize).div_ceil(tile_size)];
        let touched = |(first, end): (u32, u32)| {
            first as usize / tile_size..(end as usize).div_ceil(tile_size)
        };
        for footprint in self.footprints.iter().filter(|f| f.is_visible()) {
            let columns = touched(footprint.column_range()).len() as u64;
            for count in &mut counts[touched(footprint.row_range())] {
                *count += columns;
            }
        }
        counts
    }

    /// Draws the surfaces of a band of tiles, whose lists are in `self.bins`.
    pub(super) fn rasterise_surface(
        &mut self,
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
    ) -> u64 {
        let [columns, _] = tile_grid(view);
        rasterise_surface(
            view,
            RasteriseSettings {
                axes: pass.axes,
                level: plan.simd,
                ends: plan.ends.as_ref(),
                task: plan.task.as_ref(),
            },
            &self.footprints,
            &self.surfels,
            self.project_output.near(),
            &self.bins,
            columns,
            &mut self.surface,
            &mut self.surface_normals,
        )
    }

    /// Draws the transparent volumes of a band of tiles, whose lists are in `self.bins`.
    pub(super) fn rasterise(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
    ) -> u64 {
        let [columns, _] = tile_grid(view);
        let settings = RasteriseSettings {
            axes: Axes {
                may_be_exact: self.project_output.exact_count() > 0,
                ..pass.axes
            },
            level: plan.simd,
            ends: plan.ends.as_ref(),
            task: plan.task.as_ref(),
        };
        let post = scene.carried().map(|transfer| PostClassification {
            transfer,
            per_extinction: 1.0 / transfer.greatest_extinction(),
            lighting: plan.lighting.as_ref(),
        });
        rasterise(
            view,
            settings,
            &self.footprints,
            &self.exact,
            self.project_output.near(),
            &self.bins,
            columns,
            &self.surface,
            post,
            &mut self.tiles,
        )
    }

    fn sum_columns(&mut self, plan: &FramePlan, view: &ViewUniform) -> u64 {
        self.sums.add_all(&ColumnInput {
            view,
            footprints: &self.footprints,
            exact: &self.exact,
            near: self.project_output.near(),
            bins: &self.bins,
            level: plan.simd,
            task: plan.task.as_ref(),
        })
    }
}

/// Numbers of drawn tiles, to test rectangles of pixels against them.
struct DrawnTiles {
    /// Tiles in a row and rows.
    size: [usize; 2],
    /// Number of drawn tiles above and to the left of each corner of tiles.
    sums: Vec<u32>,
}

impl DrawnTiles {
    /// Counts tiles.
    ///
    /// - `columns`: tiles in a row.
    fn new(tiles: &[bool], columns: usize) -> Self {
        let rows = tiles.len() / columns.max(1);
        let width = columns + 1;
        let mut sums = vec![0; width * (rows + 1)];
        for y in 0..rows {
            let mut row = 0;
            for x in 0..columns {
                row += u32::from(tiles[y * columns + x]);
                sums[(y + 1) * width + x + 1] = sums[y * width + x + 1] + row;
            }
        }
        Self {
            size: [columns, rows],
            sums,
        }
    }

    /// Returns whether a drawn tile meets columns and rows of pixels. NaN could lie anywhere.
    fn meet(&self, pixels: [[f64; 2]; 2]) -> bool {
        let [x, y] = tiles_of(pixels, self.size);
        let sum = |x: usize, y: usize| self.sums[y * (self.size[0] + 1) + x];
        sum(x.end, y.end) + sum(x.start, y.start) > sum(x.start, y.end) + sum(x.end, y.start)
    }
}

/// Returns the pixels along a side of the tiles of a pass.
pub(crate) fn tile_size(pass: &PassPlan) -> usize {
    if pass.axes.accumulate == Accumulate::Column {
        COLUMN_TILE_SIZE
    } else {
        TILE_SIZE
    }
}

/// Returns the numbers of columns and rows of tiles.
fn tile_grid(view: &ViewUniform) -> [usize; 2] {
    view.size.map(|n| (n as usize).div_ceil(TILE_SIZE))
}

/// Divides rows of tiles into bands of at most `most` entries, or of one row.
fn cut_into_bands(counts: &[u64], most: u64) -> Vec<Range<usize>> {
    let mut bands = Vec::new();
    let (mut first, mut sum) = (0, 0);
    for (row, count) in counts.iter().enumerate() {
        if row > first && sum + count > most {
            bands.push(first..row);
            (first, sum) = (row, 0);
        }
        sum += count;
    }
    bands.push(first..counts.len());
    bands
}

/// Returns whether a volume's particles become pieces: kernels are classified over their extents, and
/// some are too wide for their values alone.
pub(super) fn has_pieces(plan: &FramePlan, volume: &BlockedVolume) -> bool {
    plan.classified_by() == ClassifiedBy::Extent
        && volume.lobes.is_some()
        && volume.merged.is_none()
}

/// Resizes a buffer that will be overwritten: keeps its memory and its contents.
fn overwrite<T: bytemuck::Zeroable + Clone>(buffer: &mut Vec<T>, len: usize) {
    buffer.resize(len, T::zeroed());
}

#[cfg(test)]
mod tests {
    use super::{DrawnTiles, cut_into_bands};

    #[test]
    fn rectangles_of_pixels_meet_the_drawn_tiles_within() {
        let is_drawn = |t: usize| t % 3 == 1 && t % 5 != 2;
        let tiles: Vec<bool> = (0..7 * 4).map(is_drawn).collect();
        let counted = DrawnTiles::new(&tiles, 7);
        let mut met = 0;
        for n in 0..4_000_usize {
            let at = |step: usize, size: f64| (n * step % 1_009) as f64 / 1_009.0 * size - 20.0;
            let [x, y] = [at(17, 150.0), at(31, 100.0)];
            let [w, h] = [at(7, 60.0) + 20.0, at(3, 40.0) + 20.0];
            let touches = |t: usize| {
                let [tx, ty] = [t % 7, t / 7].map(|i| i as f64 * 16.0);
                x < tx + 16.0 && x + w > tx && y < ty + 16.0 && y + h > ty
            };
            let any = (0..tiles.len()).any(|t| tiles[t] && touches(t));
            assert_eq!(
                counted.meet([[x, x + w], [y, y + h]]),
                any,
                "{x} {y} {w} {h}"
            );
            met += usize::from(any);
        }
        assert!((500..3_500).contains(&met), "{met}");
        assert!(counted.meet([[f64::NAN; 2]; 2]));
    }

    #[test]
    fn bands_hold_no_more_than_they_may_or_one_row() {
        let cut = |counts: &[u64]| cut_into_bands(counts, 10);
        assert_eq!(cut(&[3, 4, 3, 1]), [0..3, 3..4]);
        assert_eq!(cut(&[30, 2, 9, 2]), [0..1, 1..2, 2..3, 3..4]);
        assert_eq!(cut(&[0, 0, 11, 0, 10]), [0..2, 2..3, 3..5]);
        assert_eq!(cut(&[7, 3]).len(), 1);
    }
}
