//! Samples unstructured grids: one anisotropic kernel per node or cell.
//!
//! - **Values at nodes**: a kernel at the centroid of the node's dual cell ([`Duals`]), with the dual cell's
//!   volume. Its variance is V = 12 kernel_width² C, with C the covariance of the dual cell. The factor 12
//!   makes V = (kernel_width spacing)² on a cubic lattice.
//! - **Values of cells**: a kernel at the cell's centroid with the cell's volume. V = 12 kernel_width² times
//!   the mean of the covariances of its corners' dual cells. A tetrahedron's own covariance is too small for
//!   the gaps between centroids: with it a uniform field ripples by 16 to 25 %, with the mean by 2.5 to 5 %.
//!
//! Cells of higher order have been cut already wherever their corners do not describe the field well enough
//! ([`crate::io`]). The remaining ones are represented by their corners; their other nodes carry nothing.

mod beside;
mod bodies;
pub(crate) mod covered;
pub(crate) mod duals;
mod even;
pub(crate) mod incidence;
mod levels;
pub(crate) mod partitioned;
mod parts;
mod pieces;
pub(crate) mod refined;
pub(crate) mod sharp;
mod walls;

use std::cell::OnceCell;
use std::ops::Range;

use self::bodies::{CellBodies, DualCells};
use self::duals::{Duals, cut, sound_volume, turned};
use self::incidence::CellsAround;
use self::refined::{MOST_CELLS, RefinedMesh};
use self::sharp::{DrawnCells, NodeParticles, SharpCells, Surface, sharp_cells};
use super::field::local_models::mesh::SampledMesh;
use super::field::{gradient, local_models};
use super::kernels::ghosts::{apply, even_out};
use super::kernels::{Kernel, Kernels};
use super::left_out::LeftOut;
use super::own::Own;
use crate::collective::Alone;
use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::cells::CellMesh;
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Result};
use crate::math::factor_of_variance;
use crate::sample::field::choice::shown_field;
use crate::sample::function::{classified_kernels, differences};
use crate::sample::options::SampleOptions;
use crate::sample::report::SampleReport;
use crate::sample::sampled::Sampled;
use crate::sample::scalar::{check_count, check_len, nothing_left, take_scalar};
use crate::scene::{LocalModel, LocalModels, Surroundings, Values};

/// A field on a mesh. Kernels are wanted for some of its nodes or cells; the others are ghosts that these need.
pub(crate) struct CellField<'a> {
    pub(crate) mesh: &'a CellMesh,
    pub(crate) blanking: &'a Blanking,
    pub(crate) association: Association,
    /// Values of all nodes, or of all cells.
    pub(crate) values: &'a Values,
    /// The values on a scale for taking differences: [`ValueScale::of_differences`].
    pub(crate) seen: &'a Values,
    /// Nodes and cells whose kernels are wanted.
    pub(crate) nodes: Range<usize>,
    pub(crate) cells: Range<usize>,
}

/// Kernels, normals and local models of a field on a mesh.
pub(super) struct CellKernels {
    pub(super) duals: Duals,
    /// Cells at each node, if normals or models needed them.
    around: Option<CellsAround>,
    /// Kernels of all samples.
    pub(super) kernels: Kernels,
    /// The kernels that are wanted. Normals and models are of these alone.
    pub(super) own: Range<usize>,
    pub(super) normals: Option<Vec<u32>>,
    pub(super) models: Option<Vec<LocalModel>>,
}

impl CellField<'_> {
    fn is_of_nodes(&self) -> bool {
        self.association == Association::Nodes
    }

    /// Returns the samples whose kernels are wanted.
    pub(super) fn own(&self) -> &Range<usize> {
        match self.association {
            Association::Nodes => &self.nodes,
            Association::Cells => &self.cells,
        }
    }

    /// Computes kernels, and normals and local models if the options ask for them.
    ///
    /// - `turned`: for each kind of cell, the number of cells in either orientation.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn kernels(
        &self,
        turned: &[[usize; 2]],
        report: &mut SampleReport,
        options: &SampleOptions,
    ) -> Result<CellKernels> {
        let &Self { mesh, blanking, .. } = self;
        let of_nodes = self.is_of_nodes();
        let task = options.task.as_ref();
        let own_kinds = mesh.kinds[self.cells.clone()].iter();
        let higher = own_kinds.filter(|k| k.is_of_higher_order() && k.is_solid());
        report.note(
            higher.count(),
            "cells",
            "of higher order: drawn by their corners",
        );
        let ghosts = blanking.mask(Association::Cells).filter(|_| of_nodes);
        let is_ghost = |cell: &usize| ghosts.is_some_and(|mask| mask.get(*cell) == Some(&true));
        report.note(
            self.cells.clone().filter(is_ghost).count(),
            "cells",
            "hidden, or copies of another piece's: left out of their nodes' volumes",
        );
        let mut duals = Duals::new(mesh, blanking, turned, &self.cells, report, task)?;
        let kernels = match of_nodes {
            true => self.of_nodes(&duals, report, options)?,
            false => self.of_cells(&duals, report, options)?,
        };
        // Sharp boundaries alone need them again.
        if !(of_nodes && options.is_sharp()) {
            duals.drop_moments();
        }
        let own = kernels.within(self.own());
        let is_around = options.purpose.normals || options.purpose.local_models;
        let around = is_around.then(|| CellsAround::new(mesh, &duals.first));
        let samples = around.as_ref().map(|around| SampledMesh {
            mesh,
            around,
            first: &duals.first,
            of_nodes,
            kernels: &kernels,
            own: own.clone(),
            values: self.seen,
        });
        let of_normals = samples.as_ref().filter(|_| options.purpose.normals);
        let normals = of_normals.map(gradient::of_mesh);
        let of_models = samples.as_ref().filter(|_| options.purpose.local_models);
        let models = of_models.map(|samples| local_models::mesh::models(samples, task));
        let models = models.transpose()?;
        Ok(CellKernels {
            duals,
            around,
            kernels,
            own,
            normals,
            models,
        })
    }

    /// Factor of a kernel's variance, kernel_width² times `shape`.
    fn factor(shape: [f64; 6], options: &SampleOptions) -> Result<[f64; 6], LeftOut> {
        let width_squared = options.kernels.width * options.kernels.width;
        factor_of_variance(shape.map(|v| v * width_squared)).ok_or(LeftOut::Degenerate)
    }

    fn of_nodes(
        &self,
        duals: &Duals,
        report: &mut SampleReport,
        options: &SampleOptions,
    ) -> Result<Kernels> {
        let (mesh, task) = (self.mesh, options.task.as_ref());
        let if_any = |i: usize| {
            if mesh.nodes[i].is_finite() {
                LeftOut::Unused
            } else {
                LeftOut::Position
            }
        };
        Kernels::collect(mesh.nodes.len(), &self.nodes, report, "nodes", task, |i| {
            if self.blanking.node(i) {
                return Err(LeftOut::Blanked);
            }
            let shape = duals.shape(i).ok_or_else(|| if_any(i))?;
            if !self.values.wide(i).is_finite() {
                return Err(LeftOut::Value);
            }
            let dual = duals.moments(i);
            let centroid = mesh.nodes[i] + dual.first / dual.volume;
            Kernel::new(centroid, Self::factor(shape, options)?, duals.share(i))
        })
    }

    fn of_cells(
        &self,
        duals: &Duals,
        report: &mut SampleReport,
        options: &SampleOptions,
    ) -> Result<Kernels> {
        let (mesh, task) = (self.mesh, options.task.as_ref());
        Kernels::collect(mesh.cell_count(), &self.cells, report, "cells", task, |i| {
            let kind = mesh.kinds[i];
            if !kind.is_solid() {
                return Err(LeftOut::LowerDimension);
            }
            if self.blanking.cell(i) {
                return Err(LeftOut::Blanked);
            }
            let mut parts = Vec::with_capacity(8);
            let (volume, centroid) = cut(mesh, i, &mut parts);
            let volume = sound_volume(mesh, kind, &parts, volume, &duals.handedness)?;
            if !self.values.wide(i).is_finite() {
                return Err(LeftOut::Value);
            }
            let mut mean = [0.0; 6];
            for shape in parts.iter().filter_map(|(n, _)| duals.shape(*n as usize)) {
                for (mean, v) in mean.iter_mut().zip(shape) {
                    *mean += v / parts.len() as f64;
                }
            }
            Kernel::new(centroid, Self::factor(mean, options)?, volume)
        })
    }
}

pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let blanking = Blanking::of(&dataset)?;
    let shown = shown_field(&dataset, options)?;
    let taken = take_scalar(&mut dataset, &shown)?;
    let Geometry::Cells(mesh) = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    check_count(&dataset, mesh.nodes.len())?;
    check_count(&dataset, mesh.cell_count())?;
    let blanking = blanking.of_mesh(mesh);
    if !mesh.kinds.iter().any(|kind| kind.is_solid()) {
        return Err(Error::format(
            &dataset.path,
            "cells",
            "cells with a volume",
            format!(
                "{} of kind {} and the like",
                mesh.cell_count(),
                mesh.kinds[0].name()
            ),
            "lines are not rendered: give a volume mesh, a surface, or the points alone",
        ));
    }
    let seen = differences(&taken.values);
    let field = CellField {
        mesh,
        blanking: &blanking,
        association: taken.association,
        values: &taken.values,
        seen: &seen,
        nodes: 0..mesh.nodes.len(),
        cells: 0..mesh.cell_count(),
    };
    let of_nodes = field.is_of_nodes();
    let sample_count = field.own().len();
    check_len(&dataset, &taken, sample_count)?;
    let mut report = SampleReport {
        field: Some(taken.name.clone()),
        sample_count,
        may_refine: may_refine(mesh.cell_count()),
        ..SampleReport::default()
    };
    let CellKernels {
        duals,
        around,
        kernels,
        normals,
        models,
        ..
    } = field.kernels(&turned(mesh), &mut report, options)?;
    if kernels.kept.is_empty() {
        return Err(nothing_left(&dataset.path, &report));
    }
    let is_sharp = options.is_sharp() && of_nodes;
    let is_refined = may_be_refined(mesh.cell_count(), of_nodes, options);
    let kept = match is_sharp || is_refined {
        true => kernels.kept.clone(),
        false => Vec::new(),
    };
    // The encoded models take a quarter of the memory.
    let local_models = models.map(|models| LocalModels::new(&models));
    drop(seen);
    if kept.is_empty() {
        // Nothing below needs the mesh.
        drop((duals, around, dataset));
        let mut sampled =
            classified_kernels(kernels, taken.values, report, Surroundings::Absent, options)?;
        sampled.volume.normals = normals;
        sampled.volume.local_models = local_models;
        return Ok(sampled);
    }
    let mut sampled =
        classified_kernels(kernels, taken.values, report, Surroundings::Absent, options)?;
    sampled.volume.normals = normals;
    sampled.volume.local_models = local_models;
    let cells = DrawnCells {
        mesh,
        duals: &duals,
        blanking: &blanking,
    };
    if !of_nodes {
        refine_drawn_cells(&cells, around, &kept, &mut sampled, options)?;
        return Ok(sampled);
    }
    let particles = NodeParticles::new(&duals, &kept);
    let surface = Surface::new(&cells);
    // A sample that is transparent on the boundary needs no cut: most such volumes end here.
    let is_cut = is_sharp && {
        let on_boundary = surface.nodes().iter().flat_map(|&node| particles.at(node));
        options.cuts(&sampled.volume, on_boundary.map(|(_, particle)| particle))
    };
    if !(is_cut || is_refined) {
        return Ok(sampled);
    }
    let around = around.unwrap_or_else(|| CellsAround::new(mesh, &duals.first));
    let width = options.kernels.width;
    let values = sampled.volume.values.as_ref().filter(|_| is_cut);
    let sharp =
        values.map(|values| sharp_cells(&cells, &surface, &around, &particles, values, width));
    if !is_refined {
        // Nothing below needs the mesh.
        drop((surface, around, particles, duals, dataset));
        if let Some(sharp) = sharp {
            sharpen(&mut sampled, sharp, kept.len(), options)?;
        }
        return Ok(sampled);
    }
    let (ghosts, partial) = match sharp {
        Some(sharp) => sharpen(&mut sampled, sharp, kept.len(), options)?,
        None => (Vec::new(), Vec::new()),
    };
    let bodies = DualCells {
        cells: &cells,
        around: &around,
        particles: &particles,
        values: &values_of(&sampled, &kept, sample_count),
    };
    let mesh = RefinedMesh {
        cells: &cells,
        surface: surface.into(),
        ghosts: &ghosts,
        partial: &partial,
    };
    mesh.refine(&bodies, &mut sampled, options)?;
    Ok(sampled)
}

/// Returns the value of each sample; NaN for those that are not drawn.
fn values_of(sampled: &Sampled, kept: &[u32], sample_count: usize) -> Vec<f64> {
    let mut values = vec![f64::NAN; sample_count];
    if let Some(own) = &sampled.volume.values {
        for (particle, &sample) in kept.iter().enumerate() {
            values[sample as usize] = own.wide(particle);
        }
    }
    values
}

/// Refines a volume of the cells of a mesh, which has a soft boundary.
///
/// - `kept`: cell of each particle, ascending.
///
/// # Errors
/// Work that was cancelled.
pub(super) fn refine_cells(
    mesh: &CellMesh,
    blanking: &Blanking,
    kept: &[u32],
    sampled: &mut Sampled,
    options: &SampleOptions,
) -> Result<()> {
    let (all, task) = (0..mesh.cell_count(), options.task.as_ref());
    // What is left out has been counted already.
    let report = &mut SampleReport::default();
    let duals = &Duals::new(mesh, blanking, &turned(mesh), &all, report, task)?;
    let cells = DrawnCells {
        mesh,
        duals,
        blanking,
    };
    refine_drawn_cells(&cells, None, kept, sampled, options)
}

/// Does the same as [`refine_cells`] for cells whose nodes have been joined.
///
/// - `around`: the cells at each node, if they are known.
fn refine_drawn_cells(
    cells: &DrawnCells<'_>,
    around: Option<CellsAround>,
    kept: &[u32],
    sampled: &mut Sampled,
    options: &SampleOptions,
) -> Result<()> {
    let bodies = CellBodies {
        cells,
        around: &around.unwrap_or_else(|| CellsAround::new(cells.mesh, &cells.duals.first)),
        kept,
        values: &values_of(sampled, kept, cells.mesh.cell_count()),
    };
    let mesh = RefinedMesh {
        cells,
        surface: OnceCell::new(),
        ghosts: &[],
        partial: &[],
    };
    mesh.refine(&bodies, sampled, options)
}

/// Returns true if a mesh may be refined.
pub(crate) fn may_refine(cell_count: usize) -> bool {
    cell_count <= MOST_CELLS
}

/// Returns true if a mesh may be refined under these options.
///
/// - `of_nodes`: true for values at nodes.
pub(crate) fn may_be_refined(cell_count: usize, of_nodes: bool, options: &SampleOptions) -> bool {
    let is_wanted = options.refinement.is_some() && options.surface.is_none();
    // Iso-surfaces and light need slopes of the field, which parts of cells with one value have not.
    let needs_slopes = options.flatten.is_some() || options.purpose.normals;
    is_wanted
        && (of_nodes || !needs_slopes)
        && options.kernels.shepard_passes == 0
        && may_refine(cell_count)
}

/// Gives a volume a sharp boundary. Returns the particle of each ghost, and the particles beside the boundary that
/// are not cut, ascending.
///
/// - `count`: number of particles without ghosts.
///
/// # Errors
/// Work that was cancelled.
fn sharpen(
    sampled: &mut Sampled,
    sharp: SharpCells,
    count: usize,
    options: &SampleOptions,
) -> Result<(Vec<usize>, Vec<usize>)> {
    let Sampled { volume, report } = sampled;
    let SharpCells {
        changes,
        reentrant,
        undecided,
    } = sharp;
    let what = "on edges where the boundary goes in: not cut there";
    report.note(reentrant.len(), "nodes", what);
    let what = "of faces that others cover in part: not cut there";
    report.note(undecided.len(), "nodes", what);
    let task = options.task.as_ref();
    let mut partial: Vec<usize> = reentrant.into_iter().chain(undecided).collect();
    partial.sort_unstable();
    let own = &mut Own {
        range: 0..count,
        ranks: &mut Alone::default(),
    };
    let Some(ghosts) = apply(volume, report, changes, options, own)? else {
        return Ok((Vec::new(), partial));
    };
    even_out(volume, &ghosts, own, |kernels, volumes| {
        let mut sums = kernels.sums(volumes, task)?;
        // These samples lack neighbouring kernels or ghosts: their volumes stay.
        if let Some(sums) = &mut sums {
            for &i in &partial {
                sums[i] = f64::NAN;
            }
        }
        Ok(sums)
    })?;
    Ok((ghosts.sources, partial))
}
