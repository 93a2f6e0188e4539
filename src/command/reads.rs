//! Collects facts about an input other than its particles, and checks that the input fits into
//! memory.

use glam::DVec3;

use super::input::DataOptions;
use super::source::Input;
use super::usage::{Kind, Uses, is_surface};
use crate::Result;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::up::Up;
use crate::sample::{LEAST_PER_NODE, SampleOptions, SampleReport, TransferChoice};
use crate::scene::PointVolume;

/// Facts about an input other than its particles.
pub(super) struct ReadAbout {
    /// Sampler's report: the field that is shown, and its unit.
    pub(super) report: SampleReport,
    pub(super) kind: Kind,
    pub(super) up: Up,
    /// Least and greatest coordinates.
    pub(super) corners: Option<(DVec3, DVec3)>,
    /// True if its transfer function is chosen from its own values.
    pub(super) is_automatic: bool,
    /// Number of volumes.
    pub(super) volume_count: usize,
    /// True if a transfer function shows any volume.
    pub(super) is_classified: bool,
    /// True if a transfer function gives the opacity of any volume.
    pub(super) has_opacity: bool,
    /// True if it holds nothing to draw and is left out.
    pub(super) is_nothing: bool,
}

impl ReadAbout {
    /// Returns true for grids, whose kernels follow the spacing, and for splats.
    pub(super) fn is_grid_or_splats(&self) -> bool {
        !matches!(self.kind, Kind::Points | Kind::Mesh)
    }
}

impl DataOptions {
    /// Returns true if any of the inputs can be cut sharply at its boundary.
    pub(super) fn may_end_sharply<'a>(
        &self,
        mut reads: impl Iterator<Item = &'a ReadAbout>,
    ) -> bool {
        self.flatten.is_none() && self.shepard == 0 && reads.any(|read| read.kind.is_grid())
    }
}

/// Collects the kinds of the inputs, for options that apply to some kinds alone.
pub(super) fn uses(reads: &[ReadAbout], options: &SampleOptions) -> Uses {
    let has_own = |read: &&ReadAbout| !read.is_automatic && read.report.field.is_some();
    let reads = || reads.iter().filter(|read| !read.is_nothing);
    Uses {
        kinds: reads().map(|read| read.kind).collect(),
        is_classified: reads().any(|read| read.is_classified),
        has_opacity: reads().any(|read| read.has_opacity),
        has_file_function: reads().any(|read| has_own(&read)),
        for_columns: options.for_columns,
        of_prepared: None,
    }
}

/// Returns true if a transfer function gives the opacity of any of the volumes.
pub(super) fn has_opacity(volumes: &[PointVolume]) -> bool {
    let mut classified = volumes.iter().filter(|v| v.transfer_function.is_some());
    classified.any(|volume| !is_surface(volume))
}

/// Least memory that a point takes while it is sampled and sorted, beyond what was read, in bytes.
/// A hundred million spheres with masses take 32 bytes each once they are read, and 67 at the peak.
const LEAST_PER_POINT: usize = 32;

/// Least memory of a lattice sample, in bytes, as it is read and with ghosts or in blocks.
/// ([`LEAST_PER_NODE`] is that of a grid's node.)
const LEAST_PER_CELL: usize = 2;

/// Refuses data whose particles would not fit into memory.
pub(super) fn check_memory(dataset: &Dataset) -> Result<()> {
    let (count, each) = match &dataset.geometry {
        Geometry::Points { positions } => (positions.len(), LEAST_PER_POINT),
        Geometry::Lattice(lattice) => (lattice.len(), LEAST_PER_CELL),
        Geometry::Curvilinear { blocks } => {
            let counts = blocks.iter().map(|block| block.nodes.len());
            (counts.sum(), LEAST_PER_NODE)
        }
        // There is one kernel for each node or each cell.
        Geometry::Cells(mesh) => (mesh.nodes.len().min(mesh.cell_count()), LEAST_PER_NODE),
        Geometry::Splats(splats) => (splats.positions.len(), LEAST_PER_POINT),
        // Surfels are counted before they are spread.
        Geometry::Mesh(_) => return Ok(()),
    };
    crate::memory::check(count, each).map_err(|e| e.in_file(&dataset.path))
}

/// Returns true if the transfer function is chosen from the values.
pub(super) fn is_automatic(options: &SampleOptions) -> bool {
    let transfer = &options.transfer;
    matches!(
        transfer,
        TransferChoice::Automatic | TransferChoice::Named(_) | TransferChoice::Shared(_)
    )
}

/// Returns a note on a field that has one value everywhere, since its picture is uniform.
pub(super) fn uniform(report: &SampleReport, input: &Input) -> Option<String> {
    let [least, greatest] = report.value_range?;
    let field = report.field.as_deref()?;
    let is_one = least >= greatest && report.sample_count > 1;
    let others = match input.time {
        Some(_) => "; other time steps may differ (--step, --time)",
        None => "",
    };
    is_one.then(|| format!("`{field}` is {least} everywhere{others}"))
}
