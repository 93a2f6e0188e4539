//! Reads which nodes and cells a file declares not to be part of its data.

use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::Dataset;
use crate::data::polyhedron::polyhedron_faces;
use crate::error::Result;
use crate::scene::Values;

/// VTK's name for the array that marks cells and nodes.
pub(crate) const GHOST_TYPE: &str = "vtkGhostType";
/// Bits of VTK's `vtkGhostType` that remove a cell: a copy of a cell of another piece, a cell replaced by finer ones, a
/// hidden cell.
const GHOST_CELL: u8 = 1 | REFINED_CELL | 32;
/// Bit of a cell that finer cells replace.
pub(crate) const REFINED_CELL: u8 = 8;
/// Bit that hides a node. Copies of another piece's nodes stay, because their own cells use them.
const HIDDEN_NODE: u8 = 2;

/// Masks of blanked nodes and cells, from PLOT3D's `iblank` and VTK's ghost arrays.
#[derive(Debug, Default)]
pub(crate) struct Blanking {
    nodes: Option<Vec<bool>>,
    cells: Option<Vec<bool>>,
    /// True if finer cells replace some cells.
    has_refined: bool,
}

impl Blanking {
    pub(crate) const NONE: Self = Self {
        nodes: None,
        cells: None,
        has_refined: false,
    };

    /// Returns true if a field of this name marks blanked nodes or cells.
    pub(crate) fn is_told_by(name: &str) -> bool {
        let names = ["iblank", "vtkGhostType", "vtkGhostLevels"];
        names.iter().any(|known| name.eq_ignore_ascii_case(known))
    }

    pub(crate) fn of(dataset: &Dataset) -> Result<Self> {
        let mut blanking = Self::default();
        for field in &dataset.fields {
            let of_nodes = field.association == Association::Nodes;
            let is = |name: &str| field.name.eq_ignore_ascii_case(name);
            let bits = if of_nodes { HIDDEN_NODE } else { GHOST_CELL };
            let is_blank: &dyn Fn(f32) -> bool = if is("iblank") {
                // Values: 0 blanked, 1 field, 2 wall, negative: interpolated from another block.
                &|v| v.abs() < 0.5
            } else if is(GHOST_TYPE) {
                &|v| ghost_bits(v) & bits != 0
            } else if is("vtkGhostLevels") && !of_nodes {
                &|v| v > 0.5
            } else {
                continue;
            };
            let values: Values = dataset.field_scalar(field)?;
            let mask = if of_nodes {
                &mut blanking.nodes
            } else {
                &mut blanking.cells
            };
            let mask = mask.get_or_insert_with(|| vec![false; values.len()]);
            for (i, blank) in mask.iter_mut().enumerate().take(values.len()) {
                *blank |= is_blank(values.get(i));
            }
            if is(GHOST_TYPE) && !of_nodes {
                let mut all = (0..values.len()).map(|i| ghost_bits(values.get(i)));
                blanking.has_refined |= all.any(|bits| bits & REFINED_CELL != 0);
            }
        }
        Ok(blanking)
    }

    /// Builds the blanking from masks of all nodes and all cells.
    pub(crate) fn of_masks(nodes: Vec<bool>, cells: Vec<bool>) -> Self {
        Self {
            nodes: Some(nodes),
            cells: Some(cells),
            has_refined: false,
        }
    }

    /// Hides also the cells with a hidden corner, because no field is known everywhere in them.
    pub(crate) fn of_mesh(mut self, mesh: &CellMesh) -> Self {
        let Some(hidden) = self.nodes.as_ref().filter(|nodes| nodes.contains(&true)) else {
            return self;
        };
        let cells = self.cells.take();
        let is_hidden = |node: &u32| hidden.get(*node as usize) == Some(&true);
        let of_cell = |cell: usize| {
            let own = cells.as_ref().and_then(|cells| cells.get(cell).copied());
            let entries = mesh.cell(cell);
            let has_hidden = match mesh.kinds[cell] {
                CellKind::POLYHEDRON => polyhedron_faces(entries).flatten().any(is_hidden),
                _ => entries.iter().any(is_hidden),
            };
            own.unwrap_or(false) || has_hidden
        };
        self.cells = Some((0..mesh.cell_count()).map(of_cell).collect());
        self
    }

    /// Hides also the cells of a lattice with a hidden corner, then the nodes whose cells are all hidden.
    ///
    /// - `dims`: number of nodes along each axis.
    pub(crate) fn of_lattice(mut self, dims: [usize; 3]) -> Self {
        // An axis of one node has one layer of cells.
        let of_cells = dims.map(|n| n.max(2) - 1);
        let step = dims.map(|n| usize::from(n > 1));
        let corners = |at: [usize; 3]| {
            (0..8_usize).map(move |c| {
                let [i, j, k] = [0, 1, 2].map(|d| at[d] + (c >> d & 1) * step[d]);
                i + dims[0] * (j + dims[1] * k)
            })
        };
        let count: usize = of_cells.iter().product();
        let place = |n: usize| {
            let [ci, cj, _] = of_cells;
            [n % ci, n / ci % cj, n / (ci * cj)]
        };
        let cells: Vec<bool> = (0..count)
            .map(|n| self.cell(n) || corners(place(n)).any(|node| self.node(node)))
            .collect();
        if !cells.contains(&true) {
            return self;
        }
        let mut nodes = vec![true; dims.iter().product()];
        for n in (0..count).filter(|&n| !cells[n]) {
            corners(place(n)).for_each(|node| nodes[node] = false);
        }
        self.nodes = Some(nodes);
        self.cells = Some(cells);
        self
    }

    /// Returns true if any node or cell is hidden.
    pub(crate) fn hides_any(&self) -> bool {
        let masks = [&self.nodes, &self.cells];
        masks.into_iter().flatten().any(|mask| mask.contains(&true))
    }

    /// Returns true if finer cells replace some cells.
    pub(crate) fn has_refined_cells(&self) -> bool {
        self.has_refined
    }

    /// Returns the mask, one entry per node or cell; `None` if no array marks any.
    pub(crate) fn mask(&self, association: Association) -> Option<&[bool]> {
        match association {
            Association::Nodes => self.nodes.as_deref(),
            Association::Cells => self.cells.as_deref(),
        }
    }

    pub(crate) fn node(&self, i: usize) -> bool {
        self.mask(Association::Nodes)
            .is_some_and(|mask| mask.get(i) == Some(&true))
    }

    pub(crate) fn cell(&self, i: usize) -> bool {
        self.mask(Association::Cells)
            .is_some_and(|mask| mask.get(i) == Some(&true))
    }
}

/// Returns the bits of a ghost array's number, an unsigned byte.
#[expect(
    clippy::cast_possible_truncation,
    reason = "ghost arrays are bytes; anything else saturates"
)]
fn ghost_bits(value: f32) -> u8 {
    value as u8
}
