//! The CPU back end: frames of a scene, stage after stage, and the memory that they share.

use std::ops::Range;

use super::{
    Bins, ColumnInput, ColumnSums, NormalTile, Pieces, PostClassification, ProjectInput,
    ProjectOutput, RasteriseSettings, Tile, bin, bin_columns, classify, count_amplitudes,
    count_classified, fill_amplitudes, light, list_visible, project, rasterise, rasterise_surface,
    resolve, resolve_depth, resolve_normals, shade, sort,
};
use crate::blocks::{
    BlockedScene, BlockedVolume, DepthRange, choose, cull, cull_detail, cull_outside,
    distance_interval,
};
use crate::constants::{COLUMN_TILE_SIZE, TILE_SIZE};
use crate::error::Result;
use crate::record::{
    BlockView, ClassifiedBy, ClassifiedParticle, ExactTerms, Footprint, FootprintTerms, PieceTerms,
    SurfelTerms, ViewUniform,
};
use crate::render::backend::{DrawFrames, Edit, FrameReport, Images};
use crate::render::plan::{Carries, Draws, FramePlan, PassPlan};
use crate::splat::{Accumulate, Axes};
use crate::stats::{FrameCounts, Stopwatch};
use crate::task::check;

/// Entries of tiles' lists at a time: 400 MB with what they are made from. Of more the picture is drawn in bands, and
/// is the same.
const MOST_ENTRIES: u64 = 1 << 25;

/// What the frames of a scene keep from one to the next: after the first frame of a size, a frame
/// allocates nothing of note.
#[derive(Debug, Default)]
pub(crate) struct CpuFrames {
    closed: Vec<bool>,
    pub(super) views: Vec<Vec<BlockView>>,
    pub(super) classified: Vec<ClassifiedParticle>,
    /// How many of those each volume has.
    pub(super) totals: Vec<usize>,
    /// Of each volume, what is classified over kernels' extents; and its terms, of those volumes that
    /// have any, one after the other.
    pieces: Vec<Pieces>,
    terms: Vec<PieceTerms>,
    pub(super) footprints: Vec<Footprint>,
    exact: Vec<ExactTerms>,
    surfels: Vec<SurfelTerms>,
    project_output: ProjectOutput,
    pub(super) order: Vec<u64>,
    bins: Bins,
    pub(super) tiles: Vec<Tile>,
    /// The opaque surfaces of the frame.
    pub(super) surface: Vec<Tile>,
    surface_normals: Vec<NormalTile>,
    sums: ColumnSums,
}

impl DrawFrames for CpuFrames {
    fn adapter(&self) -> Option<String> {
        None
    }

    fn upload(&mut self, scene: &BlockedScene) -> Result<()> {
        self.views = vec![Vec::new(); scene.volumes().len()];
        Ok(())
    }

    /// Nothing of the scene is kept here but how many volumes it has.
    fn edit(&mut self, scene: &BlockedScene, _: Edit) -> Result<()> {
        self.views.resize_with(scene.volumes().len(), Vec::new);
        Ok(())
    }

    fn draw(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
    ) -> Result<FrameReport> {
        let mut whole = Stopwatch::start();
        let mut report = FrameReport::default();
        report.counts.blocks = scene.block_count();
        let mut seen = 0;
        for pass in &plan.passes {
            self.draw_pass(scene, plan, pass, &mut report)?;
            seen += self.views.iter().map(Vec::len).sum::<usize>();
        }
        report.counts.blocks_culled = report.counts.blocks - seen;
        let mut clock = Stopwatch::start();
        self.resolve(plan, images);
        report.times.resolve = clock.lap();
        report.times.frame = whole.lap();
        Ok(report)
    }
}

impl CpuFrames {
    /// All stages of one pass but the last.
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
        let FrameReport { counts, times } = report;
        let task = plan.task.as_ref();
        check(task)?;
        let mut clock = Stopwatch::start();
        let view = self.cull(scene, plan, pass, counts);
        times.cull += clock.lap();
        check(task)?;

        self.classify(scene.volumes(), plan, pass);
        counts.classified += self.classified.len();
        counts.pieces += self.terms.len();
        times.classify += clock.lap();
        check(task)?;

        self.project(scene.volumes(), plan, pass, &view);
        times.project += clock.lap();
        check(task)?;

        let is_column = pass.axes.accumulate == Accumulate::Column;
        if is_column {
            list_visible(&self.footprints, &mut self.order);
        } else {
            sort(&self.footprints, &mut self.order);
        }
        counts.footprints += self.order.len();
        times.sort += clock.lap();

        counts.footprints_near += self.project_output.near_count();
        if pass.axes.accumulate == Accumulate::Opaque {
            counts.surfels += self.order.len();
        }
        let is_surface = pass.axes.accumulate == Accumulate::Opaque;
        self.make_room(pass, &view);
        let tile_size = if is_column {
            COLUMN_TILE_SIZE
        } else {
            TILE_SIZE
        };
        let columns = (view.size[0] as usize).div_ceil(tile_size);
        for rows in self.bands(&view, tile_size, MOST_ENTRIES) {
            let terms = if is_surface {
                FootprintTerms::Surfel(&self.surfels)
            } else {
                FootprintTerms::Exact(&self.exact)
            };
            let bin = if is_column { bin_columns } else { bin };
            let (footprints, order) = (&self.footprints, &self.order);
            bin(footprints, terms, order, columns, rows, &mut self.bins);
            counts.tile_entries += self.bins.len();
            times.bin += clock.lap();
            check(task)?;

            counts.splat_pixels += match pass.axes.accumulate {
                Accumulate::Opaque => self.rasterise_surface(plan, pass, &view),
                Accumulate::Column => self.sum_columns(plan, &view),
                _ => self.rasterise(scene, plan, pass, &view),
            };
            times.rasterise += clock.lap();
        }
        if pass.draws == Draws::Volumes {
            counts.footprints_exact = self.project_output.exact_count();
        }
        check(task)
    }

    /// Which blocks the pass draws, by what, and their depth keys. Returns the view with the scale of
    /// these.
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
                // Nothing is transparent.
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
            // Depths order nothing.
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
                in_view.map(|(block, is_spread)| distance_interval(camera, block, is_spread)),
            ),
            Some(layers) => layers.depth_range(),
        };
        for (volume, views) in volumes.iter().zip(&mut self.views) {
            for view in views {
                let block = &volume.blocks[view.block as usize];
                let distance = match &pass.layers {
                    None => distance_interval(camera, block, false).0,
                    Some(layers) => layers.axis.dot(camera.camera_point(block.origin)),
                };
                view.key = range.key(distance);
            }
        }
        ViewUniform {
            key_scale: range.keys_per_unit(),
            ..pass.view
        }
    }

    /// Visible particles, with masses and what they carry.
    fn classify(&mut self, volumes: &[BlockedVolume], plan: &FramePlan, pass: &PassPlan) {
        self.terms.clear();
        if let Carries::Amplitude { scale, .. } = pass.carries {
            self.count_classified(volumes, |_, volume, views| {
                count_amplitudes(volume, views, scale)
            });
            self.fill_classified(volumes, |_, volume, views, out| {
                fill_amplitudes(volume, views, scale, out);
            });
            return;
        }
        let rotation = plan.camera.camera_from_world.as_mat3();
        let mut pieces = std::mem::take(&mut self.pieces);
        pieces.resize_with(volumes.len(), Pieces::default);
        self.count_classified(volumes, |i, volume, views| {
            if has_pieces(plan, volume) {
                pieces[i].find(volume, views)
            } else {
                count_classified(volume, views)
            }
        });
        let mut terms = std::mem::take(&mut self.terms);
        self.fill_classified(volumes, |i, volume, views, out| {
            if has_pieces(plan, volume) {
                let first = terms.len();
                terms.resize(first + out.len(), PieceTerms::WHOLE);
                pieces[i].place(out, &mut terms[first..]);
            } else {
                classify(volume, views, out);
            }
            shade(volume, views, &plan.camera, out);
            if let (Some(lighting), true) = (&plan.lighting, pass.lights_particles) {
                light(volume, views, rotation, lighting, out);
            }
        });
        self.terms = terms;
        self.pieces = pieces;
    }

    /// Counts the particles of all views, the first argument the number of the volume, and makes room for
    /// them.
    fn count_classified(
        &mut self,
        volumes: &[BlockedVolume],
        mut count: impl FnMut(usize, &BlockedVolume, &mut [BlockView]) -> usize,
    ) {
        self.totals.clear();
        for (i, (volume, views)) in volumes.iter().zip(&mut self.views).enumerate() {
            self.totals.push(count(i, volume, views));
        }
        overwrite(&mut self.classified, self.totals.iter().sum());
    }

    /// Fills the places of what was counted.
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

    /// Projects what was classified.
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
    }

    /// Makes room for the tiles of a pass.
    fn make_room(&mut self, pass: &PassPlan, view: &ViewUniform) {
        let [columns, rows] = tile_grid(view);
        match pass.axes.accumulate {
            Accumulate::Opaque => {
                self.surface.resize_with(columns * rows, Tile::default);
                let wanted = if pass.axes.normals { columns * rows } else { 0 };
                self.surface_normals
                    .resize_with(wanted, NormalTile::default);
            }
            Accumulate::Column => self.sums.clear(),
            _ => self.tiles.resize_with(columns * rows, Tile::default),
        }
    }

    /// The rows of tiles whose lists are made and drawn at once: all, unless footprints touch more
    /// than `most` tiles.
    fn bands(&self, view: &ViewUniform, tile_size: usize, most: u64) -> Vec<Range<usize>> {
        let rows = (view.size[1] as usize).div_ceil(tile_size);
        if self.project_output.tile_count() <= most {
            return std::iter::once(0..rows).collect();
        }
        let mut counts = vec![0; rows];
        let touched = |(first, end): (u32, u32)| {
            first as usize / tile_size..(end as usize).div_ceil(tile_size)
        };
        for footprint in self.footprints.iter().filter(|f| f.is_visible()) {
            let columns = touched(footprint.column_range()).len() as u64;
            for count in &mut counts[touched(footprint.row_range())] {
                *count += columns;
            }
        }
        cut_into_bands(&counts, most)
    }

    /// Draws the surfaces of a band of tiles, whose lists `self.bins` has.
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

    /// The same of what light passes through.
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

    /// Tiles or sums to images.
    fn resolve(&self, plan: &FramePlan, images: &mut Images) {
        if let Some((view, per_mass)) = plan.column() {
            images.resize_column(plan);
            images.largest = self.sums.write(view, per_mass, &mut images.column.values);
            return;
        }
        images.resize(plan);
        let tiles = match plan.of_volumes() {
            Some(_) => &self.tiles,
            None => &self.surface,
        };
        resolve(tiles, plan.background, &mut images.image);
        if let Some(depth) = &mut images.depth {
            resolve_depth(tiles, depth);
        }
        if let Some(normals) = &mut images.normals {
            // None without surfaces.
            let none = Vec::new();
            let has_surface = !self.surface.is_empty();
            let tiles = if has_surface {
                &self.surface_normals
            } else {
                &none
            };
            resolve_normals(tiles, &plan.camera, normals);
        }
    }
}

/// Columns and rows of tiles.
fn tile_grid(view: &ViewUniform) -> [usize; 2] {
    view.size.map(|n| (n as usize).div_ceil(TILE_SIZE))
}

/// Rows of tiles in bands of no more than `most` entries, or of one row.
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

/// Whether a volume's particles become pieces: kernels are classified over their extents, and are too wide
/// for their values alone somewhere.
fn has_pieces(plan: &FramePlan, volume: &BlockedVolume) -> bool {
    plan.classified_by() == ClassifiedBy::Extent
        && volume.lobes.is_some()
        && volume.merged.is_none()
}

/// Resizes a buffer that will be overwritten: keeps its memory, clears nothing it holds.
fn overwrite<T: bytemuck::Zeroable + Clone>(buffer: &mut Vec<T>, len: usize) {
    buffer.resize(len, T::zeroed());
}

#[cfg(test)]
mod tests {
    use super::cut_into_bands;

    #[test]
    fn bands_hold_no_more_than_they_may_or_one_row() {
        let cut = |counts: &[u64]| cut_into_bands(counts, 10);
        assert_eq!(cut(&[3, 4, 3, 1]), [0..3, 3..4]);
        assert_eq!(cut(&[30, 2, 9, 2]), [0..1, 1..2, 2..3, 3..4]);
        assert_eq!(cut(&[0, 0, 11, 0, 10]), [0..2, 2..3, 3..5]);
        assert_eq!(cut(&[7, 3]).len(), 1);
    }
}
