//! Unstructured grids: one anisotropic kernel per node or cell.
//!
//! - **Values at nodes**: a kernel at the centroid of the node's dual cell ([`Duals`]), whose covariance
//!   is C: V = 12 kernel_width² C, with the dual cell's volume. 12 makes V = (kernel_width spacing)² on a cubic lattice.
//! - **Values of cells**: a kernel at the cell's centroid with the cell's volume,
//!   V = 12 kernel_width² times the mean of the covariances of its corners' dual cells. A
//!   tetrahedron's own covariance is too small for the gaps between centroids: a uniform field
//!   ripples by 16 to 25 % with it, by 2.5 to 5 % with this.
//!
//! Cells of higher order were cut before, where their corners do not say what their elements do ([`crate::io`]). Those
//! that are still there are taken by their corners; the nodes between are corners of no cell and carry nothing.

use super::duals::{Duals, cut, sound_volume};
use super::incidence::CellsAround;
use super::kernels::{Kernel, Kernels};
use super::left_out::LeftOut;
use super::local_models;
use super::sharp::{apply, even_out};
use super::sharp_cells::{DrawnCells, Surface, sharp_cells};
use super::{
    SampleOptions, SampleReport, Sampled, check_count, check_len, classified_kernels, gradient,
    nothing_left, take_scalar,
};
use crate::error::{Error, Result};
use crate::io::{Association, Blanking, Dataset, Geometry};
use crate::math::factor_of_variance;
use crate::scene::{LocalModels, Surroundings};
pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let blanking = Blanking::of(&dataset)?;
    let taken = take_scalar(&mut dataset, options.field.as_deref())?;
    let Geometry::Cells(mesh) = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    check_count(&dataset, mesh.nodes.len())?;
    check_count(&dataset, mesh.cell_count())?;
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
    let of_nodes = taken.association == Association::Nodes;
    let (noun, sample_count) = if of_nodes {
        ("nodes", mesh.nodes.len())
    } else {
        ("cells", mesh.cell_count())
    };
    check_len(&dataset, &taken, sample_count)?;
    let mut report = SampleReport {
        field: Some(taken.name.clone()),
        sample_count,
        ..SampleReport::default()
    };
    let higher = mesh
        .kinds
        .iter()
        .filter(|k| k.is_of_higher_order() && k.is_solid());
    report.note(
        higher.count(),
        "cells",
        "of higher order: drawn by their corners",
    );
    let ghosts = blanking.mask(Association::Cells).filter(|_| of_nodes);
    report.note(
        ghosts.map_or(0, |mask| mask.iter().filter(|ghost| **ghost).count()),
        "cells",
        "hidden, or copies of another piece's: left out of their nodes' volumes",
    );
    let task = options.task.as_ref();
    let duals = Duals::new(mesh, &blanking, &mut report, task)?;

    let width_squared = options.kernel_width * options.kernel_width;
    let factor = |shape: [f64; 6]| {
        factor_of_variance(shape.map(|v| v * width_squared)).ok_or(LeftOut::Degenerate)
    };
    let values = &taken.values;
    let kernels = if of_nodes {
        let if_any = |i: usize| {
            if mesh.nodes[i].is_finite() {
                LeftOut::Unused
            } else {
                LeftOut::Position
            }
        };
        Kernels::collect(sample_count, &mut report, noun, task, |i| {
            if blanking.node(i) {
                return Err(LeftOut::Blanked);
            }
            let shape = duals.shape(i).ok_or_else(|| if_any(i))?;
            if !values.get(i).is_finite() {
                return Err(LeftOut::Value);
            }
            let dual = duals.moments(i);
            let centroid = mesh.nodes[i] + dual.first / dual.volume;
            Kernel::new(centroid, factor(shape)?, duals.share(i))
        })?
    } else {
        Kernels::collect(sample_count, &mut report, noun, task, |i| {
            let kind = mesh.kinds[i];
            if !kind.is_solid() {
                return Err(LeftOut::LowerDimension);
            }
            if blanking.cell(i) {
                return Err(LeftOut::Blanked);
            }
            let mut parts = Vec::with_capacity(8);
            let (volume, centroid) = cut(mesh, i, &mut parts);
            let volume = sound_volume(mesh, kind, &parts, volume, &duals.handedness)?;
            if !values.get(i).is_finite() {
                return Err(LeftOut::Value);
            }
            let mut mean = [0.0; 6];
            for shape in parts.iter().filter_map(|(n, _)| duals.shape(*n as usize)) {
                for (mean, v) in mean.iter_mut().zip(shape) {
                    *mean += v / parts.len() as f64;
                }
            }
            Kernel::new(centroid, factor(mean)?, volume)
        })?
    };
    if kernels.kept.is_empty() {
        return Err(nothing_left(&dataset.path, &report));
    }
    let first = &duals.first;
    let is_around = options.normals || options.local_models;
    let around = is_around.then(|| CellsAround::new(mesh, first));
    let normals = around.as_ref().filter(|_| options.normals).map(|around| {
        // Values belong to nodes, not to the centroids of their dual cells.
        let place = |n: usize| match kernels.kept[n] {
            node if of_nodes => mesh.nodes[node as usize],
            _ => kernels.positions[n],
        };
        gradient::of_mesh(mesh, around, first, of_nodes, &kernels.kept, place, values)
    });
    let local_models = match around.as_ref().filter(|_| options.local_models) {
        Some(around) => {
            let samples = local_models::mesh::SampledMesh {
                mesh,
                around,
                first,
                of_nodes,
                kernels: &kernels,
                values,
            };
            let models = local_models::mesh::models(&samples, task)?;
            Some(LocalModels::new(&models))
        }
        None => None,
    };
    let kept = if options.is_sharp() && of_nodes {
        kernels.kept.clone()
    } else {
        Vec::new()
    };
    let mut sampled =
        classified_kernels(kernels, taken.values, report, Surroundings::Absent, options)?;
    sampled.volume.normals = normals;
    sampled.volume.local_models = local_models;
    if kept.is_empty() {
        return Ok(sampled);
    }
    let particle = |node: u32| kept.binary_search(&node).ok();
    let cells = DrawnCells {
        mesh,
        duals: &duals,
        blanking: &blanking,
    };
    let surface = Surface::new(&cells);
    // Most of what is transparent there needs no more than this.
    let on_boundary = surface.nodes().iter().filter_map(|&node| particle(node));
    if !options.cuts(&sampled.volume, on_boundary) {
        return Ok(sampled);
    }
    let Sampled { volume, report } = &mut sampled;
    let Some(values) = &volume.values else {
        return Ok(sampled);
    };
    let around = around.unwrap_or_else(|| CellsAround::new(mesh, &duals.first));
    let (changes, reentrant) = sharp_cells(
        &cells,
        &surface,
        &around,
        particle,
        values,
        options.kernel_width,
    );
    report.note(
        reentrant.len(),
        "nodes",
        "on edges where the boundary goes in: not cut there",
    );
    // The mesh has done its work.
    drop((surface, around, duals, dataset));
    if let Some(ghosts) = apply(volume, report, vec![changes], options) {
        even_out(volume, &ghosts, |kernels, volumes| {
            let mut sums = kernels.sums(volumes, task)?;
            // Beside them something is missing.
            if let Some(sums) = &mut sums {
                for i in reentrant {
                    sums[i] = f64::NAN;
                }
            }
            Ok(sums)
        })?;
    }
    Ok(sampled)
}
