//! Samples meshes that are partitioned over ranks.

use super::sharp::DrawnCells;
use super::{CellField, CellKernels};
use crate::data::association::Association;
use crate::error::Result;
use crate::math::ExactSum;
use crate::sample::field::picked::picked_of;
use crate::sample::function::unclassified;
use crate::sample::kernels::Kernels;
use crate::sample::options::{SampleOptions, check_options};
use crate::sample::report::SampleReport;
use crate::scene::{LocalModel, Particles, PickedRow, PointVolume};

/// The particles of the wanted nodes or cells of a mesh.
pub(crate) struct PartitionedCells {
    /// Particles with the data's values, and without a function.
    pub(crate) volume: PointVolume,
    pub(crate) models: Option<Vec<LocalModel>>,
    /// Particles that may lie on a boundary that is to be sharp.
    pub(crate) on_boundary: Vec<usize>,
    pub(crate) report: SampleReport,
}

impl CellField<'_> {
    /// Samples some of the nodes or cells of a mesh.
    ///
    /// - `turned`: for each kind of cell, the number of the whole mesh's cells in either orientation.
    /// - `volume_sum`: the sum to which the particles' volumes are added \[length³\].
    ///
    /// # Errors
    /// Invalid options; work that was cancelled.
    pub(crate) fn sampled(
        &self,
        turned: &[[usize; 2]],
        options: &SampleOptions,
        volume_sum: &mut ExactSum,
    ) -> Result<PartitionedCells> {
        check_options(options)?;
        let mut report = SampleReport {
            sample_count: self.own().len(),
            ..SampleReport::default()
        };
        let made = self.kernels(turned, &mut report, options)?;
        let CellKernels {
            duals,
            kernels,
            own,
            normals,
            models,
            ..
        } = made;
        let Kernels {
            mut positions,
            mut factors,
            mut volumes,
            mut kept,
        } = kernels;
        let mut on_boundary = Vec::new();
        if options.is_sharp() && self.association == Association::Nodes {
            let outer = DrawnCells {
                mesh: self.mesh,
                duals: &duals,
                blanking: self.blanking,
            }
            .outer_nodes();
            let is_outer = |node: u32| outer.binary_search(&duals.first_of(node)).is_ok();
            let of_own = kept[own.clone()].iter().enumerate();
            on_boundary.extend(of_own.filter(|(_, node)| is_outer(**node)).map(|(i, _)| i));
        }
        drop(duals);
        // Remote particles are no longer needed.
        fn of_own<T>(all: &mut Vec<T>, own: &std::ops::Range<usize>) {
            all.truncate(own.end);
            all.drain(..own.start);
            all.shrink_to_fit();
        }
        of_own(&mut positions, &own);
        of_own(&mut factors, &own);
        of_own(&mut volumes, &own);
        of_own(&mut kept, &own);
        let values = self.values.gather(&kept);
        report.particle_count = kept.len();
        report.value_range = values.finite_range();
        volumes.iter().for_each(|v| volume_sum.add(f64::from(*v)));
        Ok(PartitionedCells {
            volume: PointVolume {
                normals,
                ..unclassified(
                    Particles::Anisotropic { positions, factors },
                    volumes,
                    values,
                )
            },
            models,
            on_boundary,
            report,
        })
    }
}

impl PartitionedCells {
    /// Picks the particles from which a function may be chosen.
    ///
    /// - `first`: number of particles of the mesh that precede these.
    /// - `count`: number of particles of the mesh.
    pub(crate) fn picked(volume: &PointVolume, first: usize, count: usize) -> Vec<PickedRow> {
        picked_of(volume, &(0..volume.particles.len()), first, count)
    }
}
