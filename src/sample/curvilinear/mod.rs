//! Samples curvilinear grids: one anisotropic kernel per node or cell.
//!
//! The variance is V = kernel_width² F Fᵀ with F = ∂x/∂(i, j, k). The mass follows from the volume of the
//! node's own part of the grid: the eighths of the cells around it ([`Grid::node_parts`]).
//!
//! A kernel lies at the centroid of its part, not at the node. Four variants were measured in one dimension at
//! width .6, by the rms error of a uniform density from .6 spacings inside the boundary on. Parts at the
//! boundary are half cells:
//!
//! - half-width kernels at the node: 7.8 %,
//! - full-width kernels at the node: 4.5 %,
//! - half-width kernels at the centroid: 4.7 %,
//! - full-width kernels at the centroid: 2.2 % (.3 % from one spacing on).
//!
//! The last variant is used: boundary parts have half the volume and the full F. Centroids reduce the greatest
//! error from 22 % to 12 % if the spacing changes 2:1 at once, and from 4.6 % to 2.8 % at a stretching of 1.3
//! per cell. Nothing more is done about it.

mod cells;
pub(crate) mod even_grid;
pub(crate) mod overlap;
pub(crate) mod partitioned;
pub(crate) mod refined;
pub(crate) mod seam;
pub(crate) mod sharp;
pub(crate) mod structured;
pub(crate) mod window;

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use self::cells::refine_blocks;
use self::refined::refine_grids;
use self::sharp::{nodes_of, sharpen_grids};
use self::structured::{CellCounts, Grid, Part};
use super::cells::{may_be_refined, may_refine};
use super::field::gradient::Samples;
use super::field::local_models;
use super::field::local_models::grid::{GridKernel, RUN, Run};
use super::kernels::{Kernel, Kernels, levels};
use super::left_out::LeftOut;
use super::own::Own;
use crate::collective::Alone;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::error::{Error, Result};
use crate::math::{lower_factor, normal_code};
use crate::sample::field::choice::shown_field;
use crate::sample::function::{classified_kernels, differences};
use crate::sample::options::SampleOptions;
use crate::sample::positions::index_u32;
use crate::sample::report::SampleReport;
use crate::sample::sampled::Sampled;
use crate::sample::scalar::{check_count, check_len, nothing_left, take_scalar};
use crate::scene::{LocalModel, LocalModels, Surroundings, Values};
use crate::task::fill;

pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let blanking = Blanking::of(&dataset)?;
    let shown = shown_field(&dataset, options)?;
    let taken = take_scalar(&mut dataset, &shown)?;
    let Geometry::Curvilinear { blocks } = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    // Some files have walls among their blocks; the nodes of walls have no volume.
    let is_flat = |block: &CurvilinearBlock| block.dims.iter().any(|&n| n < 2);
    if blocks.iter().all(is_flat) {
        let dims = blocks.first().map_or([0; 3], |block| block.dims);
        return Err(Error::format(
            &dataset.path,
            "dimensions",
            "at least two nodes along each index",
            format!("{} x {} x {}", dims[0], dims[1], dims[2]),
            "a surface has no volume to render",
        ));
    }
    let samples_of =
        |block: &CurvilinearBlock| block.dims_of(taken.association).iter().product::<usize>();
    let sample_count = blocks.iter().map(samples_of).sum();
    check_count(&dataset, sample_count)?;
    check_len(&dataset, &taken, sample_count)?;

    let mut report = SampleReport {
        field: Some(taken.name.clone()),
        sample_count,
        ..SampleReport::default()
    };
    let mut samples = Vec::with_capacity(blocks.len());
    let mut counts = CellCounts::default();
    let (mut first_node, mut first_cell, mut first_sample) = (0, 0, 0);
    for block in blocks {
        let grid = Grid::new(
            block.dims,
            &block.nodes,
            &blanking,
            first_node,
            first_cell,
            &mut counts,
        );
        samples.push((first_sample, grid));
        first_node += block.nodes.len();
        first_cell += block.dims_of(Association::Cells).iter().product::<usize>();
        first_sample += samples_of(block);
    }
    counts.report(&mut report);
    report.note_overlap(&samples);

    let seen = differences(&taken.values);
    let field = GridField {
        grids: &samples,
        association: taken.association,
        values: &seen,
        own: 0..sample_count,
    };
    let mut kernels = field.kernels(&mut report, options)?;
    if kernels.kept.is_empty() {
        return Err(nothing_left(&dataset.path, &report));
    }
    if taken.association == Association::Cells && blanking.has_refined_cells() {
        levels::even_out(&mut kernels, options.task.as_ref())?;
    }
    let GridFit { normals, models } = field.fit(&kernels, 0..kernels.kept.len(), options)?;
    // The encoded models take a quarter of the memory.
    let local_models = models.map(|models| LocalModels::new(&models));
    let of_nodes = taken.association == Association::Nodes;
    let is_sharp = options.is_sharp() && of_nodes;
    report.may_refine = of_nodes || may_refine(sample_count);
    let is_refined = match of_nodes {
        true => options.refinement.is_some(),
        false => may_be_refined(sample_count, of_nodes, options),
    };
    let kept = if is_sharp || is_refined {
        kernels.kept.clone()
    } else {
        Vec::new()
    };
    drop(seen);
    let mut sampled = classified_kernels(
        kernels,
        taken.values,
        report,
        Surroundings::Included,
        options,
    )?;
    sampled.volume.normals = normals;
    sampled.volume.local_models = local_models;
    let Sampled { volume, report } = &mut sampled;
    let own = &mut Own {
        range: 0..kept.len(),
        ranks: &mut Alone::default(),
    };
    let sharp = match is_sharp {
        true => sharpen_grids(volume, report, &samples, &kept, options, own)?,
        false => None,
    };
    if is_refined && !of_nodes {
        refine_blocks(blocks, &blanking, &kept, &mut sampled, options)?;
    } else if is_refined {
        let all_nodes = match sharp {
            Some((_, nodes)) => nodes,
            None => {
                let each = samples.iter();
                each.map(|(first, grid)| nodes_of(*first, grid, [0; 3], &kept))
                    .collect()
            }
        };
        let wanted: Vec<u32> = (0..volume.particles.len()).map(index_u32).collect();
        let wanted = (&*wanted, kept.len());
        refine_grids(volume, &all_nodes, report, wanted, options, own.ranks)?;
    }
    Ok(sampled)
}

/// A field on curvilinear grids. Kernels are wanted for some of its samples.
pub(super) struct GridField<'a> {
    /// Each grid with the number of its first sample.
    pub(super) grids: &'a [(usize, Grid<'a>)],
    pub(super) association: Association,
    /// Values of all samples.
    pub(super) values: &'a Values,
    /// The samples whose kernels are wanted.
    pub(super) own: Range<usize>,
}

/// Normals and local models fitted to the field around kernels.
pub(super) struct GridFit {
    pub(super) normals: Option<Vec<u32>>,
    pub(super) models: Option<Vec<LocalModel>>,
}

impl GridField<'_> {
    /// Returns the grid of a sample, with the number of its first sample.
    fn of_sample(&self, i: usize) -> &(usize, Grid<'_>) {
        &self.grids[self.grids.partition_point(|(first, _)| *first <= i) - 1]
    }

    /// Computes the kernels of all samples; the report covers the wanted ones.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn kernels(
        &self,
        report: &mut SampleReport,
        options: &SampleOptions,
    ) -> Result<Kernels> {
        let noun = match self.association {
            Association::Nodes => "nodes",
            Association::Cells => "cells",
        };
        let kernel = |i: usize, part: Result<Part, LeftOut>| {
            let part = part?;
            if !self.values.wide(i).is_finite() {
                return Err(LeftOut::Value);
            }
            let factor = lower_factor(part.jacobian * options.kernels.width);
            Kernel::new(part.centroid, factor, part.volume)
        };
        Kernels::collect_runs(
            self.values.len(),
            &self.own,
            report,
            noun,
            options.task.as_ref(),
            |mut rest, each| {
                while !rest.is_empty() {
                    let (first, grid) = self.of_sample(rest.start);
                    let count: usize = grid.dims_of(self.association).iter().product();
                    let end = rest.end.min(first + count);
                    let of_grid = rest.start - first..end - first;
                    let mut each = |i, part| each(first + i, kernel(first + i, part));
                    match self.association {
                        Association::Nodes => grid.node_parts(of_grid, each),
                        Association::Cells => of_grid.for_each(|i| each(i, grid.cell_part(i))),
                    }
                    rest.start = end;
                }
            },
        )
    }

    /// Computes normals and local models if the options ask for them.
    ///
    /// - `own`: the kernels for which they are wanted.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn fit(
        &self,
        kernels: &Kernels,
        own: Range<usize>,
        options: &SampleOptions,
    ) -> Result<GridFit> {
        let known = if options.purpose.normals || options.purpose.local_models {
            known_values(self.grids, self.association, self.values)
        } else {
            Vec::new()
        };
        let normals = options.purpose.normals.then(|| {
            let normal = |&sample: &u32| {
                let (first, grid) = self.of_sample(sample as usize);
                let samples = grid.samples(self.association, &known[*first..]);
                normal_code(samples.gradient(samples.indices(sample as usize - first)))
            };
            kernels.kept[own.clone()].par_iter().map(normal).collect()
        });
        let models = if options.purpose.local_models {
            let mut models = vec![LocalModel::NONE; own.len()];
            let task = options.task.as_ref();
            fill(task, local_models::STAGE, &mut models, |begin, models| {
                let mut rest = &mut *models;
                let mut kernel = own.start + begin;
                while !rest.is_empty() {
                    let sample = kernels.kept[kernel] as usize;
                    let (first, grid) = self.of_sample(sample);
                    let of_grid = grid.samples(self.association, &known[*first..]);
                    let start = of_grid.indices(sample - first);
                    // A run ends with its row of samples at the latest.
                    let end = sample + RUN.min(of_grid.dims[0] - start[0]);
                    let members = &kernels.kept[kernel..kernel + rest.len().min(RUN)];
                    let count = members.partition_point(|&member| (member as usize) < end);
                    let run_length = members[count - 1] as usize + 1 - sample;
                    let run = Run::new(&of_grid, &known[*first..], start, run_length);
                    let (own, others) = rest.split_at_mut(count);
                    for (model, member) in own.iter_mut().zip(members) {
                        let of_kernel = GridKernel {
                            centre: kernels.positions[kernel],
                            factor: kernels.factors[kernel],
                            width: options.kernels.width,
                        };
                        *model = run.model(*member as usize - sample, &of_kernel);
                        kernel += 1;
                    }
                    rest = others;
                }
            })?;
            Some(models)
        } else {
            None
        };
        Ok(GridFit { normals, models })
    }
}

/// Values of all samples, with NaN for hidden or non-finite ones.
fn known_values(
    samples: &[(usize, Grid<'_>)],
    association: Association,
    values: &Values,
) -> Vec<f32> {
    let mut known = Vec::with_capacity(values.len());
    for (first, grid) in samples {
        let count = grid.dims_of(association).iter().product::<usize>();
        known.par_extend((0..count).into_par_iter().map(|i| {
            let is_hidden = match association {
                Association::Nodes => grid.blanking.node(grid.first_node + i),
                Association::Cells => grid.blanking.cell(grid.first_cell + i),
            };
            let value = values.get(first + i);
            if value.is_finite() && !is_hidden {
                value
            } else {
                f32::NAN
            }
        }));
    }
    known
}

impl Grid<'_> {
    /// Samples of a field that have a position and a `known` value; `known` starts at the grid's first sample.
    /// Gradients are taken between samples, not at the kernels' centroids: there the chain rule is exact.
    fn samples(
        &self,
        association: Association,
        known: &[f32],
    ) -> Samples<impl Fn([usize; 3]) -> Option<(DVec3, f64)>> {
        let dims = self.dims_of(association);
        let at = move |ijk: [usize; 3]| {
            let (position, value) = match association {
                Association::Nodes => {
                    let node = self.node_index(ijk);
                    (self.nodes[node], known[node])
                }
                Association::Cells => {
                    let middle = self.cell_corners(ijk).iter().sum::<DVec3>() / 8.0;
                    (middle, known[self.cell_index(ijk)])
                }
            };
            let is_known = position.is_finite() && !value.is_nan();
            is_known.then_some((position, f64::from(value)))
        };
        // On a closed index the last plane of nodes repeats the first.
        let periods = [0, 1, 2].map(|d| self.periodic[d].then(|| self.dims[d] - 1));
        Samples { dims, periods, at }
    }

    fn dims_of(&self, association: Association) -> [usize; 3] {
        match association {
            Association::Nodes => self.dims,
            Association::Cells => self.dims.map(|n| n - 1),
        }
    }
}
