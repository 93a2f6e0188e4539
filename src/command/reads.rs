//! Facts about an input other than its particles, and a check that it fits into memory.

use glam::DVec3;

use super::input::DataOptions;
use super::source::Input;
use super::usage::{Kind, Uses, is_surface};
use crate::Result;
use crate::io::{Dataset, Geometry, Up};
use crate::sample::{LEAST_PER_NODE, SampleOptions, SampleReport, TransferChoice};
use crate::scene::PointVolume;

/// Facts about an input other than its particles.
pub(super) struct ReadAbout {
    /// The sampler's report: the field that is shown, and its unit.
    pub(super) report: SampleReport,
    pub(super) kind: Kind,
    pub(super) up: Up,
    /// The least and the greatest coordinates.
    pub(super) corners: Option<(DVec3, DVec3)>,
    /// Whether its transfer function is chosen from its own values.
    pub(super) is_automatic: bool,
    /// How many volumes there are, whether a function shows any, and whether it gives the opacity of any.
    pub(super) volume_count: usize,
    pub(super) is_classified: bool,
    pub(super) has_opacity: bool,
    /// Whether it holds nothing to draw, and is left out.
    pub(super) is_nothing: bool,
}

impl ReadAbout {
    /// Whether it is a grid, whose kernels follow the spacing, or splats.
    pub(super) fn is_grid_or_splats(&self) -> bool {
        !matches!(self.kind, Kind::Points | Kind::Mesh)
    }
}

impl DataOptions {
    /// Whether any of some inputs can end sharply.
    pub(super) fn may_end_sharply<'a>(
        &self,
        mut reads: impl Iterator<Item = &'a ReadAbout>,
    ) -> bool {
        self.flatten.is_none() && self.shepard == 0 && reads.any(|read| read.kind.is_grid())
    }
}

/// The kinds of the inputs, for options that apply to some kinds alone.
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

/// Whether a function gives the opacity of any of some volumes.
pub(super) fn has_opacity(volumes: &[PointVolume]) -> bool {
    let mut classified = volumes.iter().filter(|v| v.transfer_function.is_some());
    classified.any(|volume| !is_surface(volume))
}

/// Bytes that a point takes at the least while it is sampled and sorted, beyond what was read: a hundred million spheres
/// with masses, 32 bytes each once they are read, take 67 at the peak.
const LEAST_PER_POINT: usize = 32;

/// The same of a value on a lattice ([`LEAST_PER_NODE`] of one on a grid): as it is read, and with ghosts or in blocks.
const LEAST_PER_CELL: usize = 2;

/// Refuses data that do not fit into memory once they are particles.
pub(super) fn check_memory(dataset: &Dataset) -> Result<()> {
    let (count, each) = match &dataset.geometry {
        Geometry::Points { positions } => (positions.len(), LEAST_PER_POINT),
        Geometry::Lattice(lattice) => (lattice.len(), LEAST_PER_CELL),
        Geometry::Curvilinear { blocks } => {
            let counts = blocks.iter().map(|block| block.nodes.len());
            (counts.sum(), LEAST_PER_NODE)
        }
        // One kernel for each of either.
        Geometry::Cells(mesh) => (mesh.nodes.len().min(mesh.cell_count()), LEAST_PER_NODE),
        Geometry::Splats(splats) => (splats.positions.len(), LEAST_PER_POINT),
        // Surfels are counted before they are spread.
        Geometry::Mesh(_) => return Ok(()),
    };
    crate::memory::check(count, each).map_err(|e| e.in_file(&dataset.path))
}

/// Whether a transfer function is chosen from values.
pub(super) fn is_automatic(options: &SampleOptions) -> bool {
    let transfer = &options.transfer;
    matches!(
        transfer,
        TransferChoice::Automatic | TransferChoice::Named(_) | TransferChoice::Shared(_)
    )
}

/// A word on a field that has one value everywhere: its picture shows nothing else.
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
