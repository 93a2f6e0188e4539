//! Collects facts about an input other than its particles, and checks that the input fits into
//! memory.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::Result;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::up::Up;
use crate::sample::{LEAST_PER_NODE, SampleOptions, SampleReport, TransferChoice};
use crate::scene::{PointVolume, Strength};

/// Kind of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// Raw volume.
    Raw,
    /// PLOT3D grid.
    Plot3d,
    /// Any other grid: a lattice, a curvilinear grid or cells.
    Grid,
    /// Particles.
    Points,
    /// Splats of a radiance field.
    Splats,
    /// Mesh.
    Mesh,
}

impl Kind {
    pub(crate) fn of(dataset: &Dataset) -> Self {
        match &dataset.geometry {
            Geometry::Lattice(_) if dataset.format == "raw volume" => Self::Raw,
            Geometry::Curvilinear { .. } if dataset.format.contains("PLOT3D") => Self::Plot3d,
            Geometry::Lattice(_) | Geometry::Curvilinear { .. } | Geometry::Cells(_) => Self::Grid,
            Geometry::Points { .. } => Self::Points,
            Geometry::Splats(_) => Self::Splats,
            Geometry::Mesh(_) => Self::Mesh,
        }
    }

    /// Returns true for grids of any kind.
    pub fn is_grid(self) -> bool {
        matches!(self, Self::Raw | Self::Plot3d | Self::Grid)
    }
}

/// Least and greatest coordinates.
pub type Corners = (DVec3, DVec3);

/// Facts about an input other than its particles.
#[derive(Debug, Clone)]
pub struct InputFacts {
    /// Sampler's report: the field that is shown, and its unit.
    pub report: SampleReport,
    /// Kind of the data.
    pub kind: Kind,
    /// Direction up.
    pub up: Up,
    /// Least and greatest coordinates.
    pub corners: Option<Corners>,
    /// True if its transfer function is chosen from its own values.
    pub is_automatic: bool,
    /// Number of volumes.
    pub volume_count: usize,
    /// True if a transfer function shows any volume.
    pub is_classified: bool,
    /// True if a transfer function gives the opacity of any volume.
    pub has_opacity: bool,
    /// True if it holds nothing to draw and is left out.
    pub is_nothing: bool,
}

impl InputFacts {
    /// Describes an input of which each rank has read a part, shown by a transfer function of its own values.
    pub(super) fn of_part(
        kind: Kind,
        report: SampleReport,
        up: Up,
        corners: Option<Corners>,
    ) -> Self {
        Self {
            report,
            kind,
            up,
            corners,
            is_automatic: true,
            volume_count: 1,
            is_classified: true,
            has_opacity: true,
            is_nothing: false,
        }
    }

    /// Returns true for grids, whose kernels follow the spacing, and for splats.
    pub(super) fn is_grid_or_splats(&self) -> bool {
        !matches!(self.kind, Kind::Points | Kind::Mesh)
    }

    /// Returns true if the input shows a field by a transfer function that was given.
    pub fn has_given_function(&self) -> bool {
        !self.is_automatic && self.report.field.is_some()
    }
}

/// Returns true if any of the inputs can be cut sharply at its boundary.
pub(super) fn may_end_sharply(inputs: &[InputFacts], options: &SampleOptions) -> bool {
    let is_cut = !options.makes_surface() && options.kernels.shepard_passes == 0;
    is_cut && inputs.iter().any(|input| input.kind.is_grid())
}

/// Returns true if a transfer function gives the opacity of any of the volumes.
pub(super) fn has_opacity(volumes: &[PointVolume]) -> bool {
    let mut classified = volumes.iter().filter(|v| v.transfer_function.is_some());
    classified.any(|volume| !matches!(volume.strength, Strength::Surface(_)))
}

/// Least memory that a point takes while it is sampled and sorted, beyond what was read, in bytes.
/// A hundred million spheres with masses take 32 bytes each once they are read, and 67 at the peak.
const LEAST_PER_POINT: usize = 32;

/// Least memory of a lattice sample, in bytes: one byte as it is read, and one byte with ghosts or
/// in blocks. [`LEAST_PER_NODE`] is the least memory of a grid's node.
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
pub(crate) fn is_automatic(options: &SampleOptions) -> bool {
    let transfer = &options.function.transfer;
    matches!(
        transfer,
        TransferChoice::Automatic | TransferChoice::Named(_) | TransferChoice::Shared(_)
    )
}
