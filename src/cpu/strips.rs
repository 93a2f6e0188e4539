//! Draws pictures of very many particles strip by strip, so that the memory of a frame is bounded for any
//! view.
//!
//! A strip consists of rows of tiles, or of a part of one row. It draws the blocks whose kernels may
//! reach it, tested against the planes through its sides. A kernel that reaches two strips is projected
//! for both. Depth keys are those of the whole picture, and the order of blocks stays. So every tile's
//! list, and with it every pixel, is the same to the last bit.

use std::mem::take;
use std::ops::Range;

use super::frame::CpuFrames;
use super::pass::{has_pieces, tile_size};
use crate::blocks::BlockedScene;
use crate::error::Result;
use crate::frame::backend::FrameReport;
use crate::frame::plan::{Draws, FramePlan, PassPlan};
use crate::memory::left;
use crate::record::{BlockView, ClassifiedBy, PATH_EXACT, ViewUniform};
use crate::splat::Accumulate;

/// Greatest number of visible particles drawn at a time if the free memory is unknown.
const MOST_PARTICLES: usize = 1 << 22;
/// Number of particles that are always drawn at once: 64 MB.
const FEW_PARTICLES: usize = 1 << 18;
/// Measured bytes per visible particle while it is drawn: the particle, its footprint with exact terms,
/// its word in the order, its entries in lists of small kernels.
const BYTES_EACH: u64 = 256;

/// A frame's pass, and the data to draw it.
struct Strips<'a> {
    scene: &'a BlockedScene,
    plan: &'a FramePlan,
    pass: &'a PassPlan,
    view: &'a ViewUniform,
    /// Greatest number of particles at a time.
    most: usize,
}

/// The blocks of a strip, for each volume. For each block, a flag tells whether a strip above already
/// contained it.
#[derive(Default)]
struct InStrip {
    views: Vec<Vec<BlockView>>,
    again: Vec<Vec<bool>>,
}

impl CpuFrames {
    /// Returns how many of `count` particles may be drawn at a time. They may use half of the free
    /// memory, besides the memory that earlier frames have allocated.
    pub(crate) fn most_particles(&self, count: usize) -> usize {
        if count <= FEW_PARTICLES {
            return count;
        }
        let Some((left, _)) = left() else {
            return MOST_PARTICLES;
        };
        let more = usize::try_from(left / 2 / BYTES_EACH).unwrap_or(usize::MAX);
        self.footprints
            .capacity()
            .saturating_add(more)
            .clamp(FEW_PARTICLES, MOST_PARTICLES)
    }

    /// Draws the blocks in `self.views`, in as many strips as their number of particles requires, down to
    /// one tile each.
    ///
    /// - `most`: returns how many of a number of particles are drawn at a time.
    ///
    /// # Errors
    /// Cancelled.
    pub(super) fn draw_strips(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        view: &ViewUniform,
        most: impl Fn(&Self, usize) -> usize,
        report: &mut FrameReport,
    ) -> Result<()> {
        let count = self.count_particles(scene, plan, pass, report)?;
        let strips = Strips {
            scene,
            plan,
            pass,
            view,
            most: most(self, count),
        };
        let tiles = view.size.map(|n| 0..(n as usize).div_ceil(tile_size(pass)));
        if count <= strips.most {
            return strips.draw(self, None, tiles, report);
        }
        let again = self.views.iter().map(|views| vec![false; views.len()]);
        let mut all = InStrip {
            again: again.collect(),
            views: take(&mut self.views),
        };
        let drawn = strips.cut(self, &mut all, tiles, report);
        self.views = all.views;
        drawn
    }
}

impl Strips<'_> {
    /// Halves the columns and rows of tiles recursively until each part has few enough particles, and
    /// draws the parts.
    fn cut(
        &self,
        frames: &mut CpuFrames,
        all: &mut InStrip,
        tiles: [Range<usize>; 2],
        report: &mut FrameReport,
    ) -> Result<()> {
        let count = |views: &Vec<BlockView>| views.iter().map(|v| v.count as usize).sum::<usize>();
        let [columns, rows] = tiles.clone();
        let is_one = columns.len() <= 1 && rows.len() <= 1;
        if is_one || all.views.iter().map(count).sum::<usize>() <= self.most {
            frames.views = take(&mut all.views);
            let counted = frames.count_particles(self.scene, self.plan, self.pass, report);
            let drawn = counted.and_then(|_| self.draw(frames, Some(&all.again), tiles, report));
            all.views = take(&mut frames.views);
            return drawn;
        }
        // A strip is a run of tiles: only a single row is divided into parts.
        let halves = if rows.len() > 1 {
            cut_in_two(&rows).map(|rows| [columns.clone(), rows])
        } else {
            cut_in_two(&columns).map(|columns| [columns, rows.clone()])
        };
        for half in halves {
            let mut own = self.narrowed(all, &half);
            self.cut(frames, &mut own, half, report)?;
        }
        Ok(())
    }

    /// Returns the blocks that may reach some tiles, and marks them as contained in a strip.
    fn narrowed(&self, all: &mut InStrip, tiles: &[Range<usize>; 2]) -> InStrip {
        let size = tile_size(self.pass);
        let camera = &self.plan.camera;
        let pixels = [0, 1].map(|axis| {
            let end = (tiles[axis].end * size).min(self.view.size[axis] as usize);
            tiles[axis].start * size..end
        });
        let frustum = self.plan.frustum.of_part(camera, &pixels);
        let mut own = InStrip::default();
        for ((volume, views), again) in self
            .scene
            .volumes()
            .iter()
            .zip(&all.views)
            .zip(&mut all.again)
        {
            let (mut views_here, mut again_here) = (Vec::new(), Vec::new());
            for (view, again) in views.iter().zip(again) {
                let block = &volume.blocks[view.block as usize];
                let is_spread = view.classified_by == ClassifiedBy::Extent as u32;
                if frustum.sees(camera, block, is_spread) {
                    views_here.push(*view);
                    again_here.push(std::mem::replace(again, true));
                }
            }
            own.views.push(views_here);
            own.again.push(again_here);
        }
        own
    }

    /// Draws some columns and rows of tiles from the counted particles.
    ///
    /// - `again`: flags of the blocks that were already counted with a strip above; `None` if the picture
    ///   is one strip.
    fn draw(
        &self,
        frames: &mut CpuFrames,
        again: Option<&[Vec<bool>]>,
        [columns, rows]: [Range<usize>; 2],
        report: &mut FrameReport,
    ) -> Result<()> {
        let (scene, plan, pass, view) = (self.scene, self.plan, self.pass, self.view);
        frames.make_counted(scene, plan, pass, view, report)?;
        frames.order_footprints(pass, view, report);
        match again {
            None => {
                report.counts.classified += frames.classified.len();
                report.counts.pieces += frames.terms.len();
                frames.count_footprints(pass, frames.order.len(), report);
            }
            Some(again) => frames.count_once(scene, plan, pass, again, report),
        }
        let in_a_row = (view.size[0] as usize).div_ceil(tile_size(pass));
        if columns.len() == in_a_row {
            return frames.draw_rows(scene, plan, pass, view, rows, report);
        }
        let first = rows.start * in_a_row;
        let run = first + columns.start..first + columns.end;
        frames.list(pass, view, run, report);
        frames.draw_tiles(scene, plan, pass, view, report)
    }
}

impl CpuFrames {
    /// Counts the particles of the blocks in `self.views` that no earlier strip counted. A block counts
    /// with all its visible particles, in whichever strip they are.
    ///
    /// - `again`: for each block, whether an earlier strip counted it.
    pub(crate) fn count_once(
        &self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        again: &[Vec<bool>],
        report: &mut FrameReport,
    ) {
        let counts = &mut report.counts;
        let is_opaque = pass.axes.accumulate == Accumulate::Opaque;
        let volumes = scene.volumes().iter().zip(&self.views).zip(again);
        let mut first = 0;
        for (((volume, views), again), total) in volumes.zip(&self.totals) {
            for view in views.iter().zip(again).filter(|(_, again)| !**again) {
                let (view, _) = view;
                let start = first + view.first as usize;
                let own = &self.footprints[start..start + view.count as usize];
                counts.classified += own.len();
                if has_pieces(plan, volume) {
                    counts.pieces += own.len();
                }
                let mut visible = 0;
                for footprint in own {
                    let is_near = footprint.near_place(is_opaque).is_some();
                    counts.footprints_near += usize::from(is_near);
                    if footprint.is_visible() {
                        visible += 1;
                        if pass.draws == Draws::Volumes {
                            counts.footprints_exact += usize::from(footprint.path == PATH_EXACT);
                        }
                    }
                }
                counts.footprints += visible;
                if is_opaque {
                    counts.surfels += visible;
                }
            }
            first += total;
        }
    }
}

fn cut_in_two(range: &Range<usize>) -> [Range<usize>; 2] {
    let middle = range.start + range.len() / 2;
    [range.start..middle, middle..range.end]
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::blocks::{BlockedScene, SceneOptions};
    use crate::breadth::some;
    use crate::frame::backend::{DrawFrames, Images};
    use crate::render::{ColumnSettings, Composite, Settings};
    use crate::scene::fixtures::spheres_and_plane;
    use crate::stats::FrameCounts;
    use crate::view::Camera;

    fn drawn(scene: &BlockedScene, plan: &FramePlan, most: usize) -> (Vec<u32>, FrameCounts) {
        let mut frames = CpuFrames::default();
        frames.upload(scene).unwrap();
        let mut report = FrameReport::default();
        for pass in &plan.passes {
            let view = frames.see(scene, plan, pass, &mut report).unwrap();
            frames
                .draw_strips(scene, plan, pass, &view, |_, _| most, &mut report)
                .unwrap();
        }
        let mut images = Images::default();
        frames.resolve(plan, &mut images);
        let numbers = match plan.column() {
            Some(_) => images.column.values,
            None => images.image.pixels.concat(),
        };
        (
            numbers.into_iter().map(f32::to_bits).collect(),
            report.counts,
        )
    }

    fn scene() -> BlockedScene {
        BlockedScene::new(spheres_and_plane(8_000), &SceneOptions::default()).unwrap()
    }

    #[test]
    fn few_particles_are_drawn_at_once_and_of_many_no_more_than_memory_is_for() {
        let frames = CpuFrames::default();
        assert_eq!(frames.most_particles(FEW_PARTICLES), FEW_PARTICLES);
        let most = frames.most_particles(usize::MAX);
        assert!((FEW_PARTICLES..=MOST_PARTICLES).contains(&most), "{most}");
    }

    #[test]
    fn strips_are_the_picture_to_the_last_bit_and_count_what_it_counts() {
        let scene = scene();
        let from = |z: f64| {
            let eye = DVec3::new(0.1, -0.2, z);
            Camera::perspective(eye, DVec3::ZERO, DVec3::Y, 50.0, [70, 99])
        };
        let flat = Camera::orthographic(
            DVec3::new(1.0, 2.0, -4.0),
            DVec3::ZERO,
            DVec3::Y,
            1.2,
            [50, 70],
        );
        // Cameras: far enough for levels of detail; among the particles; across some of them;
        // orthographic.
        for (name, camera) in [
            ("far", from(-12.0)),
            ("near", from(-1.4)),
            ("within", from(-0.2)),
            ("flat", flat),
        ] {
            let composites = [Composite::Over, Composite::SLABS];
            let mut plans = composites
                .map(|composite| {
                    let settings = Settings {
                        composite,
                        ..Settings::default()
                    };
                    FramePlan::new(&scene, &camera, &settings).unwrap()
                })
                .to_vec();
            let columns = &ColumnSettings::default();
            plans.push(FramePlan::of_columns(&scene, &camera, columns, 2e-5));
            for (n, plan) in plans.iter().enumerate() {
                let (image, counts) = drawn(&scene, plan, usize::MAX);
                let has_surface = plan.column().is_none();
                assert!(
                    counts.footprints > 100 && (counts.surfels > 0) == has_surface,
                    "{name}: {counts:?}"
                );
                assert_eq!(counts.footprints_near > 0, name == "within");
                // One particle at a time takes long.
                let few = usize::from(name == "near") + 1;
                for most in some(vec![2000, 1], few) {
                    let (cut, cut_counts) = drawn(&scene, plan, most);
                    assert_eq!(cut_counts, counts, "{name} {n} {most}");
                    assert!(cut == image, "{name} {n} {most}");
                }
            }
        }
    }
}
