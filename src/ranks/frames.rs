//! Draws frames over ranks: each rank projects its particles and draws its tiles; the first rank assembles the image.

use std::mem::{replace, take};
use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::exchange::{Arrived, Sorting, parcels};
use super::statistics::RankStats;
use super::tiles::{TileShares, Work};
use crate::blocks::{AmplitudeSummary, BlockedScene, Frustum, runs_in_turn};
use crate::collective::Collective;
use crate::cpu::{CpuFrames, MOST_ENTRIES, TileSums, tile_size};
use crate::error::Result;
use crate::frame::backend::{DrawFrames, Edit, FrameReport, Images};
use crate::frame::plan::{FramePlan, PassPlan};
use crate::message;
use crate::record::{BlockView, ClassifiedBy, ViewUniform};
use crate::splat::Accumulate;
use crate::stats::Stopwatch;

/// Particles that a rank projects before it sends their footprints (about 50 MB), while the batch before is under way.
const BATCH: usize = 1 << 19;

/// Greatest number of particles in view for each rank at which the image is drawn in one part.
const FEW: usize = 1 << 18;

/// Draws frames of a scene whose particles are partitioned among ranks.
#[derive(Debug)]
pub(crate) struct RankFrames {
    ranks: Box<dyn Collective>,
    cpu: CpuFrames,
    /// Blocks whose particles this rank holds, for each volume.
    own: Vec<Vec<Range<u32>>>,
    /// Statistics of the last frame, by rank.
    stats: Vec<RankStats>,
    /// Statistics of this rank, for the frame that is being drawn.
    now: RankStats,
    /// Most footprints that a rank may hold at a time.
    most: usize,
}

/// View and visible blocks of a pass that is about to be drawn.
struct Seen {
    /// View, with the scale of its depth keys.
    view: ViewUniform,
    /// Blocks in view for each volume, whichever rank holds their particles.
    views: Vec<Vec<BlockView>>,
}

impl RankFrames {
    /// Partitions a scene that every rank holds: with n ranks, each keeps the particles of every n-th run of blocks.
    ///
    /// # Errors
    /// The errors of [`BlockedScene::keep`].
    pub(crate) fn sharing(ranks: Box<dyn Collective>, scene: &mut BlockedScene) -> Result<Self> {
        let (size, rank) = (ranks.size(), ranks.rank());
        let own = (0..).zip(scene.volumes());
        let own = own.map(|(v, volume)| runs_in_turn(volume.blocks.len(), size, rank, v));
        let own: Vec<_> = own.collect();
        scene.keep(&own)?;
        Ok(Self::of_shared(ranks, own))
    }

    /// Prepares to draw a scene that is partitioned already.
    ///
    /// - `own`: for each volume, the blocks whose particles this rank holds.
    pub(super) fn of_shared(ranks: Box<dyn Collective>, own: Vec<Vec<Range<u32>>>) -> Self {
        Self {
            ranks,
            cpu: CpuFrames::default(),
            own,
            stats: Vec::new(),
            now: RankStats::default(),
            most: usize::MAX,
        }
    }

    /// Summarises the amplitudes of all ranks' particles.
    ///
    /// # Errors
    /// A rank that is gone.
    pub(crate) fn amplitudes(&mut self, scene: &BlockedScene) -> Result<AmplitudeSummary> {
        let mut own = AmplitudeSummary::default();
        let mut known = AmplitudeSummary::default();
        for (i, family) in scene.families().iter().enumerate() {
            if let Some(of_volume) = scene.known_amplitudes(i) {
                known = known.and(&of_volume);
                continue;
            }
            let volume = &scene.volumes()[family.start];
            for run in &self.own[family.start] {
                own = own.and(&AmplitudeSummary::of_blocks(volume, run.clone()));
            }
        }
        let not_finite = own.not_finite as f64;
        let all = self
            .ranks
            .gather_one(Ok([own.largest, own.sum, not_finite]))?;
        let all = all.into_iter();
        let all = all.map(|[largest, sum, not_finite]| AmplitudeSummary {
            largest,
            sum,
            not_finite: not_finite as usize,
        });
        Ok(all.fold(known, |a, b| a.and(&b)))
    }

    /// Broadcasts a value of the first rank, which has the images, to all ranks.
    ///
    /// - `own`: ignored on other ranks.
    ///
    /// # Errors
    /// A rank that is gone.
    pub(crate) fn first_of<T: Pod>(&mut self, own: Vec<T>) -> Result<Vec<T>> {
        let mut all = self.ranks.gather_records(Ok(own))?;
        Ok(all.swap_remove(0))
    }

    /// Statistics of the last frame, by rank.
    pub(crate) fn stats(&self) -> &[RankStats] {
        &self.stats
    }

    pub(crate) fn rank(&self) -> usize {
        self.ranks.rank()
    }

    /// Finds the blocks in view of every pass, and assigns tiles to ranks.
    fn see(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        report: &mut FrameReport,
    ) -> Result<(Vec<Seen>, TileShares)> {
        let mut passes = Vec::with_capacity(plan.passes.len());
        let mut work: Option<Work> = None;
        let mut seen = 0;
        for pass in &plan.passes {
            let view = self.cpu.see(scene, plan, pass, report)?;
            let views = take(&mut self.cpu.views);
            self.cpu.views.resize_with(views.len(), Vec::new);
            let size = tile_size(pass);
            let work = work.get_or_insert_with(|| Work::new(&view, size));
            for (volume, views) in scene.volumes().iter().zip(&views) {
                work.add(volume, views, &view);
                seen += views.len();
            }
            passes.push(Seen { view, views });
        }
        report.counts.blocks = scene.block_count();
        report.counts.blocks_culled = report.counts.blocks - seen;
        let work = work.unwrap_or_else(|| Work::new(&ViewUniform::zeroed(), 1));
        Ok((passes, work.shares(self.ranks.size())))
    }

    /// Whether this rank holds a block's particles.
    fn is_own(&self, volume: usize, block: u32) -> bool {
        let runs = &self.own[volume];
        let run = runs.partition_point(|run| run.end <= block);
        runs.get(run).is_some_and(|run| run.contains(&block))
    }

    /// Returns the number of parts of the image that are drawn one after another, the same on all ranks. A part's
    /// footprints, averaged over the ranks, fit the memory of each rank.
    fn parts_of(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        seen: &Seen,
        report: &mut FrameReport,
    ) -> Result<usize> {
        let volumes = scene.volumes().iter().zip(&seen.views);
        let in_view = volumes.flat_map(|(volume, views)| {
            let count = |view: &BlockView| u64::from(volume.blocks[view.block as usize].count);
            views.iter().map(count)
        });
        let in_view: u64 = in_view.sum();
        let few = self.most.min(FEW) as u64 * self.ranks.size() as u64;
        if in_view <= few || !plan.culls {
            return Ok(1);
        }
        // Some of the particles in view may be transparent.
        for (v, views) in seen.views.iter().enumerate() {
            let is_own = |view: &&BlockView| self.is_own(v, view.block);
            let own = views.iter().filter(is_own).copied().collect();
            self.cpu.views[v] = own;
        }
        let visible = self.cpu.count_particles(scene, plan, pass, report);
        let visible = self.ranks.sum(visible.map(|count| count as u64))?;
        let each = usize::try_from(visible).unwrap_or(usize::MAX) / self.ranks.size();
        let most = self.cpu.most_particles(each).min(self.most) as u64;
        let most = self.ranks.gather_one(Ok(most))?;
        let most = most.into_iter().min().unwrap_or(1).max(1);
        // No more parts than tiles.
        let tiles = view_tiles(&seen.view, tile_size(pass));
        Ok((each.div_ceil(most as usize)).clamp(1, tiles.max(1)))
    }

    /// Splits this rank's blocks in view into batches of about [`BATCH`] particles. A batch has the views of every
    /// volume, and each block's number among all in view.
    ///
    /// - `part`: the part of the image that is drawn, unless all of it is.
    fn batches(
        &self,
        scene: &BlockedScene,
        plan: &FramePlan,
        seen: &Seen,
        part: Option<&mut Part<'_>>,
    ) -> Vec<Batch> {
        let mut batches: Vec<Batch> = Vec::new();
        let mut count = BATCH;
        let mut part = part;
        for (v, (volume, views)) in scene.volumes().iter().zip(&seen.views).enumerate() {
            for (number, view) in (0..).zip(views) {
                if !self.is_own(v, view.block) {
                    continue;
                }
                let mut is_again = false;
                if let Some(part) = &mut part {
                    let block = &volume.blocks[view.block as usize];
                    let is_spread = view.classified_by == ClassifiedBy::Extent as u32;
                    let sees = |side: &Frustum| side.sees(&plan.camera, block, is_spread);
                    if !part.frusta.iter().any(sees) {
                        continue;
                    }
                    is_again = replace(&mut part.had[v][number as usize], true);
                }
                if count >= BATCH {
                    batches.push(Batch::of(seen.views.len()));
                    count = 0;
                }
                count += volume.blocks[view.block as usize].count as usize;
                if let Some(batch) = batches.last_mut() {
                    batch.views[v].push(*view);
                    batch.numbers[v].push(number);
                    batch.again[v].push(is_again);
                }
            }
        }
        batches
    }

    /// Projects this rank's blocks of a pass, batch by batch, and sends the footprints to the ranks that draw them.
    /// Returns the footprints that this rank draws.
    #[allow(
        clippy::too_many_arguments,
        reason = "a frame, a part of it, and what is counted"
    )]
    fn project(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        seen: &Seen,
        shares: &TileShares,
        part: Option<&mut Part<'_>>,
        report: &mut FrameReport,
    ) -> Result<Projected> {
        let is_part = part.is_some();
        let mut batches = self.batches(scene, plan, seen, part).into_iter();
        let counts = self.ranks.gather_one(Ok(batches.len() as u64))?;
        let rounds = counts.into_iter().max().unwrap_or(0);
        let mut out = Projected::default();
        // A rank that failed goes on to take part, so that all ranks receive its error.
        let mut fault = None;
        for round in 0..=rounds {
            if round < rounds {
                let parts = match fault.take() {
                    Some(error) => Err(error),
                    None => {
                        let batch = batches.next();
                        let batch = batch.unwrap_or_else(|| Batch::of(seen.views.len()));
                        let of = (pass, &seen.view, is_part);
                        self.parts(scene, plan, of, batch, shares, &mut out, report)
                    }
                };
                let mut clock = Stopwatch::start();
                fault = self.ranks.begin_exchange(parts).err();
                self.now.times.exchange += clock.lap();
            }
            if round > 0 {
                let mut clock = Stopwatch::start();
                let arrived = self.ranks.complete_exchange();
                self.now.times.exchange += clock.lap();
                let added = arrived.and_then(|parts| {
                    parts.iter().try_for_each(|part| {
                        self.now.bytes_received += part.len() as u64;
                        out.arrived.add(part)
                    })
                });
                fault = fault.or(added.err());
            }
        }
        fault.map_or(Ok(out), Err)
    }

    /// Projects a batch and packs its footprints for each rank.
    #[allow(
        clippy::too_many_arguments,
        reason = "a frame, a part of it, and what is counted"
    )]
    fn parts(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        (pass, view, is_part): (&PassPlan, &ViewUniform, bool),
        batch: Batch,
        shares: &TileShares,
        out: &mut Projected,
        report: &mut FrameReport,
    ) -> Result<Vec<Vec<u8>>> {
        self.cpu.views = batch.views;
        if is_part {
            self.cpu.count_particles(scene, plan, pass, report)?;
            self.cpu.make_counted(scene, plan, pass, view, report)?;
        } else {
            self.cpu.make_footprints(scene, plan, pass, view, report)?;
        }
        let mut clock = Stopwatch::start();
        let sorting = Sorting {
            shares,
            ranks: self.ranks.size(),
            is_opaque: pass.axes.accumulate == Accumulate::Opaque,
        };
        let (parts, [visible, sent]) = parcels(&mut self.cpu, &batch.numbers, sorting);
        let before = report.counts.footprints;
        match is_part {
            true => self.cpu.count_once(scene, plan, pass, &batch.again, report),
            false => self.cpu.count_footprints(pass, visible, report),
        }
        out.exact_count += self.cpu.project_output.exact_count() as u64;
        self.now.footprints_made += (report.counts.footprints - before) as u64;
        self.now.footprints_sent += sent as u64;
        self.now.bytes_sent += parts.iter().map(|part| part.len() as u64).sum::<u64>();
        self.now.times.sort += clock.lap();
        Ok(parts)
    }

    /// Draws a pass, without resolving it.
    fn draw_pass(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        seen: &Seen,
        shares: &TileShares,
        report: &mut FrameReport,
    ) -> Result<()> {
        let parts = self.parts_of(scene, plan, pass, seen, report)?;
        if parts == 1 {
            return self.draw_part(scene, plan, pass, seen, shares, None, report);
        }
        let mut had: Vec<Vec<bool>> = seen.views.iter().map(|v| vec![false; v.len()]).collect();
        for part in 0..parts {
            let shares = shares.part(part, parts);
            let boxes = shares.boxes(seen.view.size.map(|n| n as usize));
            let of_box = |pixels| plan.frustum.of_part(&plan.camera, pixels);
            let mut part = Part {
                frusta: boxes.iter().map(of_box).collect(),
                had: &mut had,
            };
            self.draw_part(scene, plan, pass, seen, &shares, Some(&mut part), report)?;
        }
        Ok(())
    }

    /// Draws a part of the image, or all of it: the tiles in `shares`.
    #[allow(
        clippy::too_many_arguments,
        reason = "a frame, a part of it, and what is counted"
    )]
    fn draw_part(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        seen: &Seen,
        shares: &TileShares,
        part: Option<&mut Part<'_>>,
        report: &mut FrameReport,
    ) -> Result<()> {
        let projected = self.project(scene, plan, pass, seen, shares, part, report)?;
        let Projected {
            arrived,
            exact_count,
        } = projected;
        let exact_count = self.ranks.sum(Ok(exact_count))?;
        let is_opaque = pass.axes.accumulate == Accumulate::Opaque;
        self.now.footprints_received += arrived.len() as u64;
        arrived.put(&mut self.cpu, exact_count as usize, is_opaque);
        let view = &seen.view;
        self.cpu.order_footprints(pass, view, report);
        let own = shares.of(self.ranks.rank());
        let size = tile_size(pass);
        let rows = (view.size[1] as usize).div_ceil(size);
        let columns = shares.columns();
        let mut drawn = Ok(());
        for rows in self.cpu.bands(view, size, 0..rows, MOST_ENTRIES) {
            let tiles = (rows.start * columns).max(own.start)..(rows.end * columns).min(own.end);
            if !tiles.is_empty() && drawn.is_ok() {
                self.cpu.list(pass, view, tiles, report);
                drawn = self.cpu.draw_tiles(scene, plan, pass, view, report);
            }
        }
        self.ranks.agree(drawn)
    }

    /// Gathers the tiles of a frame on the first rank, which makes images of them.
    fn gather(
        &mut self,
        plan: &FramePlan,
        shares: &TileShares,
        images: &mut Images,
        report: &mut FrameReport,
    ) -> Result<()> {
        let mut clock = Stopwatch::start();
        let own = shares.of(self.ranks.rank());
        let is_column = plan.column().is_some();
        let is_first = self.ranks.rank() == 0;
        let mut part = Vec::new();
        if is_column {
            message::put(&mut part, self.cpu.sums.totals());
        } else if !is_first {
            message::put(&mut part, &self.cpu.picture(plan)[own.clone()]);
            if plan.normals && !self.cpu.surface_normals.is_empty() {
                message::put(&mut part, &self.cpu.surface_normals[own].concat());
            }
        }
        let parts = self.ranks.gather_on_first(Ok(part))?;
        self.now.times.exchange += clock.lap();
        let resolved = if !is_first {
            Ok(())
        } else if is_column {
            let all = parts.iter().map(|part| message::take(&mut part.as_slice()));
            all.collect::<Result<Vec<Vec<TileSums>>>>().map(|all| {
                self.cpu.sums = crate::cpu::ColumnSums::of_totals(all.concat());
                self.cpu.resolve(plan, images);
            })
        } else {
            self.place(plan, shares, &parts)
                .map(|()| self.cpu.resolve(plan, images))
        };
        report.times.resolve += clock.lap();
        resolved
    }

    /// Copies the tiles of the other ranks to their places in the image.
    fn place(&mut self, plan: &FramePlan, shares: &TileShares, parts: &[Vec<u8>]) -> Result<()> {
        for (rank, part) in parts.iter().enumerate().skip(1) {
            let mut part = part.as_slice();
            let run = shares.of(rank);
            let tiles = message::take(&mut part)?;
            for (to, tile) in self.cpu.picture_mut(plan)[run.clone()]
                .iter_mut()
                .zip(tiles)
            {
                *to = tile;
            }
            if !part.is_empty() {
                let normals: Vec<[f32; 3]> = message::take(&mut part)?;
                let each = normals.len() / run.len().max(1);
                let normals = normals.chunks(each.max(1));
                for (to, normals) in self.cpu.surface_normals[run].iter_mut().zip(normals) {
                    *to = normals.to_vec();
                }
            }
        }
        Ok(())
    }
}

impl DrawFrames for RankFrames {
    fn adapter(&self) -> Option<String> {
        None
    }

    fn upload(&mut self, scene: &BlockedScene) -> Result<()> {
        self.cpu.upload(scene)
    }

    fn edit(&mut self, scene: &BlockedScene, edit: Edit) -> Result<()> {
        self.cpu.edit(scene, edit)
    }

    fn draw(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        images: &mut Images,
    ) -> Result<FrameReport> {
        let mut whole = Stopwatch::start();
        let mut report = FrameReport::default();
        self.now = RankStats::of(scene, &self.own);
        let seen = self.see(scene, plan, &mut report);
        let (passes, shares) = self.ranks.agree(seen)?;
        for (pass, seen) in plan.passes.iter().zip(&passes) {
            self.draw_pass(scene, plan, pass, seen, &shares, &mut report)?;
        }
        let gathered = self.gather(plan, &shares, images, &mut report);
        self.now.tiles = shares.of(self.ranks.rank()).len() as u64;
        report.times.frame = whole.lap();
        self.now.add(&report);
        let stats = self.ranks.gather_one(gathered.map(|()| self.now))?;
        RankStats::sum(&stats, &mut report.counts);
        // Statistics are those of the picture, not of samples of its tiles.
        if plan.tiles.is_none() {
            self.stats = stats;
        }
        Ok(report)
    }
}

fn view_tiles(view: &ViewUniform, size: usize) -> usize {
    let [columns, rows] = view.size.map(|n| (n as usize).div_ceil(size));
    columns * rows
}

/// A part of the image that is drawn at a time.
struct Part<'a> {
    /// Frusta around the tiles that each rank draws in this part.
    frusta: Vec<Frustum>,
    /// Whether an earlier part had a block, for each volume's blocks in view.
    had: &'a mut Vec<Vec<bool>>,
}

/// Some of this rank's blocks in view.
struct Batch {
    /// Views of the blocks, for each volume.
    views: Vec<Vec<BlockView>>,
    /// Number of each block among all of its volume in view.
    numbers: Vec<Vec<u32>>,
    /// Whether an earlier part of the image had the block already.
    again: Vec<Vec<bool>>,
}

impl Batch {
    fn of(volumes: usize) -> Self {
        Self {
            views: vec![Vec::new(); volumes],
            numbers: vec![Vec::new(); volumes],
            again: vec![Vec::new(); volumes],
        }
    }
}

/// Footprints that a pass left on this rank.
#[derive(Debug, Default)]
struct Projected {
    arrived: Arrived,
    /// Number of footprints on the exact path that this rank made.
    exact_count: u64,
}

#[cfg(test)]
mod tests {
    use std::thread;

    use glam::DVec3;

    use super::*;
    use crate::blocks::SceneOptions;
    use crate::breadth::some;
    use crate::ranks::ThreadRank;
    use crate::render::{ColumnSettings, Composite, Settings};
    use crate::scene::fixtures::spheres_and_plane;
    use crate::stats::FrameCounts;
    use crate::view::Camera;

    /// Draws with `size` ranks; returns the image, the counts, and the most footprints that one rank received.
    fn drawn(
        size: usize,
        most: usize,
        plan: &(dyn Fn(&BlockedScene) -> FramePlan + Sync),
    ) -> (Vec<u32>, FrameCounts, u64) {
        let found = thread::scope(|scope| {
            let ranks = ThreadRank::group(size).into_iter();
            let draw = |own: ThreadRank| {
                let mut scene =
                    BlockedScene::new(spheres_and_plane(12_000), &SceneOptions::default()).unwrap();
                let ranks = Box::new(own);
                let mut frames = RankFrames::sharing(ranks, &mut scene).unwrap();
                frames.most = most;
                frames.upload(&scene).unwrap();
                let plan = plan(&scene);
                let mut images = Images::default();
                let report = frames.draw(&scene, &plan, &mut images).unwrap();
                let received = frames.stats().iter().map(|s| s.footprints_received);
                let numbers = match plan.column() {
                    Some(_) => images.column.values,
                    None => images.image.pixels.concat(),
                };
                let bits = numbers.into_iter().map(f32::to_bits).collect();
                (bits, report.counts, received.max().unwrap_or(0))
            };
            let threads: Vec<_> = ranks.map(|own| scope.spawn(move || draw(own))).collect();
            let all = threads.into_iter().map(|t| t.join().unwrap());
            all.collect::<Vec<_>>()
        });
        found.into_iter().next().unwrap()
    }

    #[test]
    fn parts_are_the_picture_to_the_last_bit_and_count_what_it_counts() {
        let from = |z: f64| {
            let eye = DVec3::new(0.1, -0.2, z);
            Camera::perspective(eye, DVec3::ZERO, DVec3::Y, 50.0, [70, 99])
        };
        let mut several = 0;
        // Far enough for levels of detail; near; among the particles, some of which cross the plane of the eye.
        for camera in [from(-12.0), from(-1.4), from(-0.2)] {
            let picture = |scene: &BlockedScene, composite| {
                let settings = Settings {
                    composite,
                    ..Settings::default()
                };
                FramePlan::new(scene, &camera, &settings).unwrap()
            };
            let over = |scene: &BlockedScene| picture(scene, Composite::Over);
            let slabs = |scene: &BlockedScene| picture(scene, Composite::SLABS);
            let columns = |scene: &BlockedScene| {
                FramePlan::of_columns(scene, &camera, &ColumnSettings::default(), 2e-5)
            };
            let plans: [&(dyn Fn(&BlockedScene) -> FramePlan + Sync); 3] =
                [&over, &slabs, &columns];
            for plan in plans {
                let (image, counts, received) = drawn(1, usize::MAX, plan);
                assert!(counts.footprints > 100);
                for (size, most) in some(vec![(1, 900), (7, 40), (2, 500), (3, 1)], 2) {
                    let (cut, cut_counts, in_parts) = drawn(size, most, plan);
                    assert_eq!(cut_counts, counts, "{size} ranks, {most}");
                    assert!(cut == image, "{size} ranks, {most}");
                    // A footprint that reaches several parts is sent for each of them.
                    assert!(size > 1 || in_parts >= received, "{in_parts} {received}");
                    several += usize::from(size == 1 && in_parts > received);
                }
            }
        }
        assert!(several > 0);
    }
}
