//! Draws frames of a scene on the CPU, stage after stage, and keeps the memory that frames share.

use super::resolve;
use crate::blocks::BlockedScene;
use crate::cpu::bin::Bins;
use crate::cpu::extent::Pieces;
use crate::cpu::project::ProjectOutput;
use crate::cpu::resolve::{resolve_depth, resolve_normals};
use crate::cpu::tile::{ColumnSums, NormalTile, Tile};
use crate::error::Result;
use crate::frame::backend::{DrawFrames, Edit, FrameReport, Images};
use crate::frame::plan::FramePlan;
use crate::record::{
    BlockView, ClassifiedParticle, ExactTerms, Footprint, PieceTerms, SurfelTerms,
};
use crate::stats::Stopwatch;

/// Memory that the frames of a scene reuse. After the first frame of a size, a frame allocates almost
/// nothing.
#[derive(Debug, Default)]
pub(crate) struct CpuFrames {
    pub(super) closed: Vec<bool>,
    pub(crate) views: Vec<Vec<BlockView>>,
    pub(super) classified: Vec<ClassifiedParticle>,
    /// Number of classified particles of each volume.
    pub(crate) totals: Vec<usize>,
    /// For each volume, the pieces of kernels classified over their extents. `terms` holds the terms of
    /// all volumes that have any, one after the other.
    pub(super) pieces: Vec<Pieces>,
    pub(super) terms: Vec<PieceTerms>,
    pub(crate) footprints: Vec<Footprint>,
    pub(crate) exact: Vec<ExactTerms>,
    pub(crate) surfels: Vec<SurfelTerms>,
    pub(crate) project_output: ProjectOutput,
    pub(super) order: Vec<u64>,
    pub(super) bins: Bins,
    pub(crate) tiles: Vec<Tile>,
    /// The opaque surfaces of the frame.
    pub(crate) surface: Vec<Tile>,
    pub(crate) surface_normals: Vec<NormalTile>,
    pub(crate) sums: ColumnSums,
}

impl DrawFrames for CpuFrames {
    fn adapter(&self) -> Option<String> {
        None
    }

    fn upload(&mut self, scene: &BlockedScene) -> Result<()> {
        self.views = vec![Vec::new(); scene.volumes().len()];
        Ok(())
    }

    /// Only the number of the scene's volumes is kept.
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
    /// Returns the tiles that make up a picture: those of volumes if any are drawn, else those of the
    /// surfaces.
    pub(crate) fn picture(&self, plan: &FramePlan) -> &[Tile] {
        match plan.of_volumes() {
            Some(_) => &self.tiles,
            None => &self.surface,
        }
    }

    /// As [`Self::picture`], mutable.
    pub(crate) fn picture_mut(&mut self, plan: &FramePlan) -> &mut [Tile] {
        match plan.of_volumes() {
            Some(_) => &mut self.tiles,
            None => &mut self.surface,
        }
    }

    /// Converts tiles or sums to images.
    pub(crate) fn resolve(&self, plan: &FramePlan, images: &mut Images) {
        if let Some((view, per_mass)) = plan.column() {
            images.resize_column(plan);
            images.largest = self.sums.write(view, per_mass, &mut images.column.values);
            return;
        }
        images.resize(plan);
        let tiles = self.picture(plan);
        resolve(tiles, plan.background, plan.is_encoded, &mut images.image);
        if let Some(depth) = &mut images.depth {
            resolve_depth(tiles, depth);
        }
        if let Some(normals) = &mut images.normals {
            // Empty without surfaces.
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
