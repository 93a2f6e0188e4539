//! Stage: computes masses, colours and pieces of particles that are classified over their own extents. A
//! particle becomes one piece for each lobe of the transfer function that its values reach, or for each
//! window of a lobe with steps.
//!
//! Blocks in which the field changes too little for that use [`classify`](super::classify()). Twin:
//! `shaders/classify/pieces.wgsl`.

use glam::Vec3;
use rayon::prelude::*;

use super::classify::{Classes, Visit, colour_of};
use crate::blocks::{BlockedParticles, BlockedVolume, BrickGrid, Halo};
use crate::math::Factor;
use crate::record::{BlockView, Carried, ClassifiedParticle, PieceTerms};
use crate::scene::{LOBE_REACH, Lobes, LocalModel, StrengthIn, TransferFunction};

/// The pieces of a run of views, in memory that frames reuse.
#[derive(Debug, Default)]
struct Run {
    particles: Vec<ClassifiedParticle>,
    terms: Vec<PieceTerms>,
}

/// Pieces of a volume's kernels, before their positions are known.
#[derive(Debug, Default)]
pub struct Pieces {
    runs: Vec<Run>,
}

/// Number of views per parallel task.
const GRAIN: usize = 16;

impl Pieces {
    /// Finds the pieces of all views, sets `count` and `first` of each, and returns the number of pieces.
    ///
    /// # Panics
    /// Never: a volume without lobes has no pieces.
    pub fn find(&mut self, volume: &BlockedVolume, views: &mut [BlockView]) -> usize {
        let (Some(lobes), Some(transfer)) = (&volume.lobes, &volume.transfer_function) else {
            views.iter_mut().for_each(|view| view.count = 0);
            return 0;
        };
        let kernels = Kernels {
            volume,
            lobes,
            transfer,
            alone: Classes::new(volume),
        };
        self.runs
            .resize_with(views.len().div_ceil(GRAIN), Run::default);
        let runs = self.runs.par_iter_mut().enumerate();
        runs.zip(views.par_chunks_mut(GRAIN))
            .for_each(|((n, run), views)| {
                run.particles.clear();
                run.terms.clear();
                for (v, view) in ((n * GRAIN) as u32..).zip(views) {
                    let before = run.particles.len();
                    kernels.visit(view, |local, mass, carried, terms| {
                        run.particles.push(ClassifiedParticle {
                            view: v,
                            local,
                            mass,
                            carried,
                        });
                        run.terms.push(terms);
                    });
                    view.count = (run.particles.len() - before) as u32;
                }
            });
        let mut first = 0;
        for view in views {
            view.first = first;
            first += view.count;
        }
        first as usize
    }

    /// Copies the pieces to their positions; `particles` and `terms` have the length that
    /// [`Pieces::find`] returned.
    pub fn place(&self, particles: &mut [ClassifiedParticle], terms: &mut [PieceTerms]) {
        let mut rest = (particles, terms);
        let mut places = Vec::with_capacity(self.runs.len());
        for run in &self.runs {
            let (particles, more_particles) = rest.0.split_at_mut(run.particles.len());
            let (terms, more_terms) = rest.1.split_at_mut(run.terms.len());
            places.push((run, particles, terms));
            rest = (more_particles, more_terms);
        }
        places.into_par_iter().for_each(|(run, particles, terms)| {
            particles.copy_from_slice(&run.particles);
            terms.copy_from_slice(&run.terms);
        });
    }
}

/// The kernels of a volume with the lobes of its transfer function.
struct Kernels<'a> {
    volume: &'a BlockedVolume,
    lobes: &'a Lobes,
    transfer: &'a TransferFunction,
    alone: Classes<'a>,
}

impl Kernels<'_> {
    /// Calls `emit` for each piece of a block's particles, in order.
    fn visit(&self, view: &BlockView, mut emit: impl FnMut(u32, f32, Carried, PieceTerms)) {
        if !view.is_spread() {
            self.alone.visit(view, |local, mass, carried| {
                emit(local, mass, carried, PieceTerms::WHOLE);
            });
            return;
        }
        match &self.volume.particles {
            BlockedParticles::Lattice(grid) => self.visit_brick(grid, view.block, emit),
            _ => self.visit_points(view.block, emit),
        }
    }

    fn visit_brick(
        &self,
        grid: &BrickGrid,
        block: u32,
        mut emit: impl FnMut(u32, f32, Carried, PieceTerms),
    ) {
        let Some(values) = &self.volume.values else {
            return;
        };
        let cells = grid.cells(block);
        let corner = cells.map(|[first, _]| first);
        let [ni, nj, nk] = cells.map(|[first, end]| end - first);
        let halo = Halo::new(grid, values, cells);
        // Computed only if a kernel reaches a lobe.
        let mut ranges = None;
        let uniform = grid.uniform_volume();
        let width = grid.kernel_width() as f32;
        for k in 0..nk {
            for j in 0..nj {
                for i in 0..ni {
                    let own = [i, j, k];
                    let value = halo.value(own);
                    let cell = [corner[0] + i, corner[1] + j, corner[2] + k];
                    let model = halo.model(own, width, grid.bends(cell));
                    let local = BrickGrid::local([0; 3], own);
                    let index = grid.index(cell);
                    let volume = || uniform.unwrap_or_else(|| grid.cell_volume(cell));
                    let around = || {
                        let ranges = ranges.get_or_insert_with(|| halo.ranges());
                        [
                            ranges.least[local as usize],
                            ranges.greatest[local as usize],
                        ]
                    };
                    self.pieces(value, &model, around, |extinction, class, terms| {
                        let carried = Carried::of_colour(colour_of(self.volume, index, class));
                        emit(local, extinction * volume(), carried, terms);
                    });
                }
            }
        }
    }

    fn visit_points(&self, block: u32, mut emit: impl FnMut(u32, f32, Carried, PieceTerms)) {
        let volume = self.volume;
        let (Some(values), Some(models), StrengthIn::Classified { volumes }) =
            (&volume.values, &volume.local_models, &volume.strength)
        else {
            return;
        };
        let block = &volume.blocks[block as usize];
        for local in 0..block.count {
            let index = (block.first + local) as usize;
            let value = values.get(index);
            let model = models.get(index);
            let around = || [value - model.below, value + model.above];
            self.pieces(value, &model, around, |extinction, class, terms| {
                let carried = Carried::of_colour(colour_of(self.volume, index, class));
                emit(local, extinction * volumes[index], carried, terms);
            });
        }
    }

    /// Calls `emit` with extinction, colour and terms for each lobe that a kernel reaches.
    ///
    /// - `around`: computes the range of the values around, on demand.
    #[inline]
    fn pieces(
        &self,
        value: f32,
        model: &LocalModel,
        mut around: impl FnMut() -> [f32; 2],
        mut emit: impl FnMut(f32, [f32; 3], PieceTerms),
    ) {
        let spread = model.slope.length();
        let middle = value + model.departure;
        for lobe in self.lobes.lobes() {
            if !(spread > lobe.threshold) {
                if lobe.holds(value) {
                    let [r, g, b, extinction] = self.transfer.classify(value);
                    if extinction > 0.0 {
                        emit(extinction, [r, g, b], PieceTerms::WHOLE);
                    }
                }
                continue;
            }
            let reach = LOBE_REACH * spread;
            if !lobe.meets(middle - reach, middle + reach) {
                continue;
            }
            let [lo, hi] = model.reached(value, around());
            if !lobe.meets(lo, hi) {
                continue;
            }
            let [first, last] = lobe.interval;
            let [r, g, b, _] = self.transfer.classify(value.clamp(first, last));
            for window in self.lobes.windows(lobe) {
                let Some(piece) = self.lobes.piece(lobe, window, middle, spread) else {
                    continue;
                };
                if !(piece.extinction > 0.0) {
                    continue;
                }
                let terms = PieceTerms {
                    axis: (model.slope / spread).into(),
                    shift: piece.shift,
                    width: piece.width,
                    unused: 0,
                };
                emit(piece.extinction, [r, g, b], terms);
            }
        }
    }
}

impl PieceTerms {
    /// Returns the piece of a kernel: its centre's offset from the particle's, and its factor.
    ///
    /// - `axis`: in the frame of `factor`'s columns.
    #[inline]
    pub(super) fn applied(&self, axis: Vec3, factor: Factor) -> (Vec3, Factor) {
        let along = Vec3::new(factor.x.dot(axis), factor.y.dot(axis), factor.z.dot(axis));
        let change = self.width - 1.0;
        let flattened = Factor {
            x: factor.x + axis * (change * along.x),
            y: factor.y + axis * (change * along.y),
            z: factor.z + axis * (change * along.z),
        };
        (along * self.shift, flattened)
    }
}
