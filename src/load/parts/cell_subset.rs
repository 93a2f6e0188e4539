//! Encodes some cells of a mesh with their nodes and a field, to send them from one rank to another.

use std::path::Path;

use super::values::{put_values, take_values};
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh, renumber};
use crate::error::Result;
use crate::message::{put, take, unknown};
use crate::scene::Values;

/// Cells, their nodes, and values at the cells or at the nodes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CellSubset {
    pub(super) mesh: CellMesh,
    /// 1 for each hidden node, and for each hidden cell; else 0.
    pub(super) hidden_nodes: Vec<u8>,
    pub(super) hidden_cells: Vec<u8>,
    pub(super) association: Association,
    pub(super) values: Values,
}

impl CellSubset {
    /// Returns an empty subset with a field of the same type as another subset's.
    pub(super) fn none_of(other: &Self) -> Self {
        Self {
            mesh: CellMesh {
                offsets: vec![0],
                ..CellMesh::default()
            },
            hidden_nodes: Vec::new(),
            hidden_cells: Vec::new(),
            association: other.association,
            values: Values::of_type(other.values.type_name(), &[]),
        }
    }

    /// Extracts some nodes and some cells.
    ///
    /// - `number`: a node's number in the new subset.
    pub(super) fn some(&self, nodes: &[u32], cells: &[u32], number: impl Fn(u32) -> u32) -> Self {
        let mut some = Self::none_of(self);
        let own = &self.mesh;
        let of = |all: &[u8], some: &[u32]| some.iter().map(|&i| all[i as usize]).collect();
        some.hidden_nodes = of(&self.hidden_nodes, nodes);
        some.hidden_cells = of(&self.hidden_cells, cells);
        some.values = self.values.gather(match self.association {
            Association::Nodes => nodes,
            Association::Cells => cells,
        });
        let mesh = &mut some.mesh;
        mesh.nodes = nodes.iter().map(|&i| own.nodes[i as usize]).collect();
        for &cell in cells {
            let kind = own.kinds[cell as usize];
            let start = mesh.connectivity.len();
            mesh.connectivity.extend(own.cell(cell as usize));
            renumber(kind, &mut mesh.connectivity[start..], &number);
            mesh.kinds.push(kind);
            mesh.offsets.push(mesh.connectivity.len() as u32);
        }
        some
    }

    /// Extracts some cells with their nodes; also returns the numbers of these nodes.
    pub(super) fn of_cells(&self, cells: &[u32]) -> (Self, Vec<u32>) {
        let mut nodes = Vec::new();
        for &cell in cells {
            // All nodes that a cell names, also in faces that are not in use.
            let mut entries = self.mesh.cell(cell as usize).to_vec();
            renumber(self.mesh.kinds[cell as usize], &mut entries, |node| {
                nodes.push(node);
                node
            });
        }
        nodes.sort_unstable();
        nodes.dedup();
        let number = |node: u32| nodes.partition_point(|&other| other < node) as u32;
        (self.some(&nodes, cells, number), nodes)
    }

    /// Appends another subset.
    ///
    /// - `shift`: number added to the node numbers of the other subset.
    pub(super) fn append(&mut self, mut other: Self, shift: u32) {
        self.mesh.append(other.mesh, shift);
        self.hidden_nodes.append(&mut other.hidden_nodes);
        self.hidden_cells.append(&mut other.hidden_cells);
        self.values.append(other.values);
    }

    pub(super) fn put(&self, bytes: &mut Vec<u8>) {
        let kinds: Vec<u8> = self.mesh.kinds.iter().map(|kind| kind.0).collect();
        put(bytes, &self.mesh.nodes);
        put(bytes, &kinds);
        put(bytes, &self.mesh.offsets);
        put(bytes, &self.mesh.connectivity);
        put(bytes, &self.hidden_nodes);
        put(bytes, &self.hidden_cells);
        put_values(bytes, &self.values);
    }

    /// Reads a subset that [`Self::put`] wrote.
    ///
    /// - `alike`: a subset with a field of the same type.
    ///
    /// # Errors
    /// Cells that no rank of this program sends.
    pub(super) fn take(bytes: &mut &[u8], alike: &Self) -> Result<Self> {
        let nodes = take(bytes)?;
        let kinds: Vec<u8> = take(bytes)?;
        let mesh = CellMesh {
            nodes,
            kinds: kinds.into_iter().map(CellKind).collect(),
            offsets: take(bytes)?,
            connectivity: take(bytes)?,
        };
        let subset = Self {
            mesh,
            hidden_nodes: take(bytes)?,
            hidden_cells: take(bytes)?,
            association: alike.association,
            values: take_values(bytes, &alike.values)?,
        };
        let counts = [
            subset.hidden_nodes.len(),
            subset.hidden_cells.len(),
            subset.values.len(),
        ];
        let count = |association| subset.mesh.count_of(association);
        let expected = [Association::Nodes, Association::Cells, alike.association].map(count);
        if counts != expected {
            return Err(unknown("another number of values than of nodes or cells"));
        }
        subset.mesh.check(Path::new("message"))?;
        Ok(subset)
    }
}
