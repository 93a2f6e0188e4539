//! The back end of ranks: each projects the particles it has and draws the tiles it has; the first has the picture.

use std::mem::take;
use std::ops::Range;

use bytemuck::Zeroable;

use super::exchange::{Arrived, Sorting, parcels};
use super::message;
use super::ranks::Ranks;
use super::statistics::RankStats;
use super::tiles::{TileShares, Work};
use crate::blocks::{AmplitudeSummary, BlockedScene, runs_in_turn};
use crate::cpu::{CpuFrames, MOST_ENTRIES, TileSums, cut_into_bands, tile_size};
use crate::error::Result;
use crate::record::{BlockView, ViewUniform};
use crate::render::backend::{DrawFrames, Edit, FrameReport, Images};
use crate::render::plan::{FramePlan, PassPlan};
use crate::splat::Accumulate;
use crate::stats::Stopwatch;

/// Particles that are projected before their footprints leave, while those before travel: some 50 MB of footprints.
const BATCH: usize = 1 << 19;

/// Frames of a scene whose particles ranks share.
#[derive(Debug)]
pub(crate) struct RankFrames {
    ranks: Ranks,
    cpu: CpuFrames,
    /// Of each volume, the blocks whose particles are here.
    own: Vec<Vec<Range<u32>>>,
    /// Of the last frame, by rank.
    stats: Vec<RankStats>,
    /// Of this rank, while a frame is drawn.
    now: RankStats,
}

/// A pass that is about to be drawn.
struct Seen {
    /// With the scale of its depth keys.
    view: ViewUniform,
    /// Of each volume the blocks in view, whoever has their particles.
    views: Vec<Vec<BlockView>>,
}

impl RankFrames {
    /// Of a scene that every rank has: this one keeps the particles of every so many blocks.
    ///
    /// # Errors
    /// Those of [`BlockedScene::keep`].
    pub(crate) fn sharing(ranks: Ranks, scene: &mut BlockedScene) -> Result<Self> {
        let (size, rank) = (ranks.size(), ranks.rank());
        let own = (0..).zip(scene.volumes());
        let own = own.map(|(v, volume)| runs_in_turn(volume.blocks.len(), size, rank, v));
        let own: Vec<_> = own.collect();
        scene.keep(&own)?;
        Ok(Self::of_shared(ranks, own))
    }

    /// Of a scene of which this rank has its share alone.
    ///
    /// - `own`: of each volume, the blocks whose particles are here.
    pub(super) fn of_shared(ranks: Ranks, own: Vec<Vec<Range<u32>>>) -> Self {
        Self {
            ranks,
            cpu: CpuFrames::default(),
            own,
            stats: Vec::new(),
            now: RankStats::default(),
        }
    }

    /// The amplitudes of all ranks' particles.
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
            .gather_records(Ok(vec![own.largest, own.sum, not_finite]))?;
        let all = all.iter().filter_map(|numbers| numbers.first_chunk::<3>());
        let all = all.map(|&[largest, sum, not_finite]| AmplitudeSummary {
            largest,
            sum,
            not_finite: not_finite as usize,
        });
        Ok(all.fold(known, |a, b| a.and(&b)))
    }

    /// Of the last frame, by rank.
    pub(crate) fn stats(&self) -> &[RankStats] {
        &self.stats
    }

    pub(crate) fn rank(&self) -> usize {
        self.ranks.rank()
    }

    /// Which blocks every pass draws, and who draws which tiles.
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

    /// The views of this rank's blocks and their numbers among all, in batches of some particles: of each batch those
    /// of every volume.
    fn batches(&self, scene: &BlockedScene, seen: &Seen) -> Vec<Batch> {
        let mut batches: Vec<Batch> = Vec::new();
        let mut count = BATCH;
        for (v, (volume, views)) in scene.volumes().iter().zip(&seen.views).enumerate() {
            for (number, view) in (0..).zip(views) {
                let runs = &self.own[v];
                let run = runs.partition_point(|run| run.end <= view.block);
                if !runs.get(run).is_some_and(|run| run.contains(&view.block)) {
                    continue;
                }
                if count >= BATCH {
                    batches.push(Batch::of(seen.views.len()));
                    count = 0;
                }
                count += volume.blocks[view.block as usize].count as usize;
                if let Some(batch) = batches.last_mut() {
                    batch.views[v].push(*view);
                    batch.numbers[v].push(number);
                }
            }
        }
        batches
    }

    /// Projects what is here of a pass and sends it, batch by batch, to those who draw it; takes what is drawn here.
    fn project(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        seen: &Seen,
        shares: &TileShares,
        report: &mut FrameReport,
    ) -> Result<Projected> {
        let mut batches = self.batches(scene, seen).into_iter();
        let counts = self.ranks.gather_records(Ok(vec![batches.len() as u64]))?;
        let rounds = counts.concat().into_iter().max().unwrap_or(0);
        let mut out = Projected::default();
        // A rank that failed goes on to take part, so that all learn of it.
        let mut fault = None;
        for round in 0..=rounds {
            if round < rounds {
                let parts = match fault.take() {
                    Some(error) => Err(error),
                    None => {
                        let batch = batches.next();
                        let batch = batch.unwrap_or_else(|| Batch::of(seen.views.len()));
                        let of = (pass, &seen.view);
                        self.parts(scene, plan, of, batch, shares, &mut out, report)
                    }
                };
                let mut clock = Stopwatch::start();
                fault = self.ranks.begin(parts).err();
                self.now.times.exchange += clock.lap();
            }
            if round > 0 {
                let mut clock = Stopwatch::start();
                let arrived = self.ranks.complete();
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

    /// The footprints of a batch for each rank.
    #[allow(
        clippy::too_many_arguments,
        reason = "a frame, a part of it, and what is counted"
    )]
    fn parts(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        (pass, view): (&PassPlan, &ViewUniform),
        batch: Batch,
        shares: &TileShares,
        out: &mut Projected,
        report: &mut FrameReport,
    ) -> Result<Vec<Vec<u8>>> {
        self.cpu.views = batch.views;
        self.cpu.make_footprints(scene, plan, pass, view, report)?;
        let mut clock = Stopwatch::start();
        let sorting = Sorting {
            shares,
            ranks: self.ranks.size(),
            is_opaque: pass.axes.accumulate == Accumulate::Opaque,
        };
        let (parts, [visible, sent]) = parcels(&mut self.cpu, &batch.numbers, sorting);
        self.cpu.count_footprints(pass, visible, report);
        out.exact_count += self.cpu.project_output.exact_count() as u64;
        out.tile_count += self.cpu.project_output.tile_count();
        if pass.axes.accumulate == Accumulate::Column {
            let rows = self.cpu.entries_of_rows(view, tile_size(pass));
            out.rows.resize(rows.len(), 0);
            for (sum, row) in out.rows.iter_mut().zip(rows) {
                *sum += row;
            }
        }
        self.now.footprints_made += visible as u64;
        self.now.footprints_sent += sent as u64;
        self.now.bytes_sent += parts.iter().map(|part| part.len() as u64).sum::<u64>();
        self.now.times.sort += clock.lap();
        Ok(parts)
    }

    /// All stages of a pass but the last.
    fn draw_pass(
        &mut self,
        scene: &BlockedScene,
        plan: &FramePlan,
        pass: &PassPlan,
        seen: &Seen,
        shares: &TileShares,
        report: &mut FrameReport,
    ) -> Result<()> {
        let projected = self.project(scene, plan, pass, seen, shares, report)?;
        let Projected {
            arrived,
            exact_count,
            tile_count,
            rows,
        } = projected;
        let numbers = [vec![exact_count, tile_count], rows].concat();
        let sums = self.ranks.sums(Ok(numbers))?;
        let (of_all, rows) = sums.split_at(2.min(sums.len()));
        let [exact_count, tile_count] = *of_all else {
            return Ok(());
        };
        let is_column = pass.axes.accumulate == Accumulate::Column;
        let is_opaque = pass.axes.accumulate == Accumulate::Opaque;
        self.now.footprints_received += arrived.len() as u64;
        arrived.put(&mut self.cpu, exact_count as usize, is_opaque);
        let view = &seen.view;
        self.cpu.order_footprints(pass, view, report);
        let own = shares.of(self.ranks.rank());
        let size = tile_size(pass);
        let bands = if !is_column {
            let rows = (view.size[1] as usize).div_ceil(size);
            self.cpu.bands(view, size, 0..rows, MOST_ENTRIES)
        } else if tile_count > MOST_ENTRIES {
            // Sums are formed in parts that follow from the lists of a band: all ranks have the same bands.
            cut_into_bands(rows, MOST_ENTRIES)
        } else {
            std::iter::once(0..(view.size[1] as usize).div_ceil(size)).collect()
        };
        let columns = shares.columns();
        let mut drawn = Ok(());
        for rows in bands {
            let tiles = (rows.start * columns).max(own.start)..(rows.end * columns).min(own.end);
            let is_any = !tiles.is_empty() && drawn.is_ok();
            let mut entries = 0;
            if is_any {
                entries = self.cpu.list(pass, view, tiles, report);
            }
            if is_column {
                let sum = self.ranks.sums(drawn.map(|()| vec![entries as u64]))?;
                entries = sum.iter().sum::<u64>() as usize;
                drawn = Ok(());
            }
            if is_any {
                drawn = self
                    .cpu
                    .draw_tiles(scene, plan, pass, view, entries, report);
            }
        }
        self.ranks.agree(drawn)
    }

    /// Brings the tiles of a frame to the first rank, which makes images of them.
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
            message::put(&mut part, &self.cpu.sums.totals());
        } else if !is_first {
            message::put(&mut part, &self.cpu.picture(plan)[own.clone()]);
            if plan.normals && !self.cpu.surface_normals.is_empty() {
                message::put(&mut part, &self.cpu.surface_normals[own].concat());
            }
        }
        let mut parts = vec![Vec::new(); self.ranks.size()];
        parts[0] = part;
        self.ranks.begin(Ok(parts))?;
        let parts = self.ranks.complete()?;
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

    /// Puts the tiles of the other ranks where they belong.
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
        let stats = gathered.map(|()| vec![self.now]);
        self.stats = self.ranks.gather_records(stats)?.concat();
        RankStats::sum(&self.stats, &mut report.counts);
        Ok(report)
    }
}

/// Some of this rank's blocks in view.
struct Batch {
    /// Of each volume.
    views: Vec<Vec<BlockView>>,
    /// Their numbers among all in view.
    numbers: Vec<Vec<u32>>,
}

impl Batch {
    fn of(volumes: usize) -> Self {
        Self {
            views: vec![Vec::new(); volumes],
            numbers: vec![Vec::new(); volumes],
        }
    }
}

/// What was found of a pass.
#[derive(Debug, Default)]
struct Projected {
    arrived: Arrived,
    /// Of the footprints that were made here: how many are on the exact path, how many tiles their boxes touch, and of
    /// column densities how many tiles of each row.
    exact_count: u64,
    tile_count: u64,
    rows: Vec<u64>,
}
