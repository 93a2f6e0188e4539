//! Samples curvilinear grids that are partitioned over ranks by planes.

use std::ops::Range;

use glam::DVec3;

use super::refined::refine_grids;
use super::sharp::{FARTHEST, nodes_of, sharpen_grids};
use super::structured::{CellCounts, Grid, volume_of};
use super::window::Window;
use super::{GridField, GridFit, even_grid};
use crate::collective::Collective;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::error::Result;
use crate::math::ExactSum;
use crate::sample::cells::may_refine;
use crate::sample::field::picked::picked_of;
use crate::sample::function::unclassified;
use crate::sample::kernels::Kernels;
use crate::sample::options::{SampleOptions, check_options};
use crate::sample::own::Own;
use crate::sample::positions::index_u32;
use crate::sample::refine;
use crate::sample::report::SampleReport;
use crate::scene::{LocalModel, Particles, PickedRow, PointVolume, ValueScale, Values};

/// Planes of constant k of a grid, with a field.
pub(crate) struct GridPlanes {
    /// Local nodes along i, j and k.
    pub(crate) dims: [usize; 3],
    pub(crate) nodes: Vec<DVec3>,
    pub(crate) blanking: Blanking,
    pub(crate) association: Association,
    /// Values of the nodes, or of the cells between them.
    pub(crate) values: Values,
    /// Scale for taking differences of values, common to all planes.
    pub(crate) differences: ValueScale,
    /// True for each index along which the first and the last plane of the grid coincide; false along k.
    pub(crate) periodic: [bool; 3],
    pub(crate) window: Window,
}

/// Returns the planes that a rank needs to make the kernels of some.
///
/// - `own`: the planes whose kernels are wanted, among `count`.
pub(crate) fn planes_around(
    own: &Range<usize>,
    count: usize,
    options: &SampleOptions,
) -> Range<usize> {
    // The sum of kernels at a node includes kernels up to `reach` away. If the spacing changes two nodes away,
    // the kernels beside those count, too. Local models reach two nodes. Kernels need the adjacent nodes.
    let reach = even_grid::reach(options.kernels.width).unsigned_abs();
    let reach = reach.max(3) + 2;
    let reach = match options.refinement {
        Some(_) => reach.max(refine::PLANES),
        None => reach,
    };
    let first = own.start.saturating_sub(reach);
    let end = (own.end + reach).min(count);
    // Kernels near a face are cut there, so the face's own plane is needed.
    let near = FARTHEST + 2;
    let first = if first <= near { 0 } else { first };
    let end = if end + near >= count { count } else { end };
    first..end
}

/// Particles made of a range of planes.
pub(crate) struct PartitionedGrid<'a> {
    here: &'a GridPlanes,
    grid: Grid<'a>,
    /// Sample of each particle.
    kept: Vec<u32>,
    /// The wanted particles; the others are ghosts that these need.
    own: Range<usize>,
    /// All local particles, with the data's values and without a function.
    pub(crate) volume: PointVolume,
    /// Models, one for each local particle.
    pub(crate) models: Option<Vec<LocalModel>>,
    /// Report on the wanted particles.
    pub(crate) report: SampleReport,
}

impl GridPlanes {
    fn samples(&self) -> Range<usize> {
        let [i, j, _] = self.dims;
        let (planes, each) = match self.association {
            Association::Nodes => (self.window.own.clone(), i * j),
            Association::Cells => (self.window.cells(self.dims), (i - 1) * (j - 1)),
        };
        planes.start * each..planes.end * each
    }

    /// Makes the particles of the wanted planes and of the ghost planes that these need.
    ///
    /// - `volume_sum`: sum to which the volumes of the wanted particles are added \[length³\].
    ///
    /// # Errors
    /// Errors of the reductions over `ranks`; work that was cancelled.
    pub(crate) fn sampled(
        &self,
        options: &SampleOptions,
        volume_sum: &mut ExactSum,
        ranks: &mut dyn Collective,
    ) -> Result<PartitionedGrid<'_>> {
        check_options(options)?;
        let mut counts = CellCounts::default();
        let (mut grid, rows) = Grid::of_planes(
            self.dims,
            &self.nodes,
            &self.blanking,
            self.periodic,
            self.window.clone(),
        );
        let volume = ranks.exact_sum(volume_of(&rows))?;
        grid.turn(volume.value(), &rows, &mut counts);
        let samples = self.samples();
        let mut report = SampleReport {
            sample_count: samples.len(),
            may_refine: self.association == Association::Nodes
                || may_refine(self.dims.map(|n| n - 1).iter().product()),
            ..SampleReport::default()
        };
        counts.report(&mut report);
        let grids = [(0, grid)];
        let seen = self.differences.seen(&self.values);
        let field = GridField {
            grids: &grids,
            association: self.association,
            values: &seen,
            own: samples.clone(),
        };
        let kernels = field.kernels(&mut report, options)?;
        let own = kernels.within(&samples);
        let GridFit { normals, models } = field.fit(&kernels, own.clone(), options)?;
        let count = kernels.kept.len();
        let Kernels {
            positions,
            factors,
            volumes,
            kept,
        } = kernels;
        let values = self.values.gather(&kept);
        report.particle_count = own.len();
        report.value_range = values.part(own.clone()).finite_range();
        let of_own = &volumes[own.clone()];
        of_own.iter().for_each(|v| volume_sum.add(f64::from(*v)));
        let [(_, grid)] = grids;
        Ok(PartitionedGrid {
            here: self,
            grid,
            kept,
            volume: PointVolume {
                normals: normals.map(|normals| padded(normals, 0, &own, count)),
                ..unclassified(
                    Particles::Anisotropic { positions, factors },
                    volumes,
                    values,
                )
            },
            models: models.map(|models| padded(models, LocalModel::NONE, &own, count)),
            own,
            report,
        })
    }
}

/// Pads values of the wanted particles with `none` for the others.
fn padded<T: Copy>(of_own: Vec<T>, none: T, own: &Range<usize>, count: usize) -> Vec<T> {
    let mut all = vec![none; count];
    all[own.clone()].copy_from_slice(&of_own);
    all
}

impl PartitionedGrid<'_> {
    /// Picks the particles from which a function may be chosen.
    ///
    /// - `first`: number of particles of the grid that precede these.
    /// - `count`: number of particles of the grid.
    pub(crate) fn picked(&self, first: usize, count: usize) -> Vec<PickedRow> {
        picked_of(&self.volume, &self.own, first, count)
    }

    /// Returns the wanted particles, with a sharp boundary and refined if the options ask for it. The numbers are
    /// those of samples, of ghosts and of parts, in this order, and the greatest level of the parts.
    ///
    /// # Errors
    /// Errors of the reductions over `ranks`.
    pub(crate) fn finished(
        self,
        options: &SampleOptions,
        ranks: &mut dyn Collective,
    ) -> Result<(PointVolume, [usize; 3], u8)> {
        let Self {
            here,
            grid,
            kept,
            own,
            mut volume,
            mut report,
            ..
        } = self;
        let mut wanted: Vec<u32> = own.clone().map(index_u32).collect();
        let grids = [(0, grid)];
        let is_of_nodes = here.association == Association::Nodes;
        let sharp = match options.is_sharp() && is_of_nodes {
            true => {
                let own = &mut Own {
                    range: own.clone(),
                    ranks: &mut *ranks,
                };
                sharpen_grids(&mut volume, &mut report, &grids, &kept, options, own)?
            }
            false => None,
        };
        let nodes = match sharp {
            Some((sources, nodes)) => {
                let is_own = |(_, source): &(usize, &usize)| own.contains(source);
                let of_own = sources.iter().enumerate().filter(is_own);
                wanted.extend(of_own.map(|(i, _)| index_u32(kept.len() + i)));
                nodes
            }
            None => vec![nodes_of(0, &grids[0].1, [0; 3], &kept)],
        };
        let of = (&*wanted, kept.len());
        if is_of_nodes && refine_grids(&mut volume, &nodes, &mut report, of, options, ranks)? {
            let (ghosts, parts) = (report.ghost_count, report.refined_count);
            let samples = report.particle_count - ghosts - parts;
            return Ok((volume, [samples, ghosts, parts], report.refined_level));
        }
        let ghosts = wanted.len() - own.len();
        Ok((volume.gathered(&wanted), [own.len(), ghosts, 0], 0))
    }
}
