//! Defines unstructured grids as files store them.

use glam::DVec3;

use crate::data::association::Association;
use crate::error::{Error, Result};

/// Cells of any shape over shared nodes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CellMesh {
    /// Node positions.
    pub nodes: Vec<DVec3>,
    /// Kind of each cell.
    pub kinds: Vec<CellKind>,
    /// Index of each cell's first entry in `connectivity`; one more at the end.
    pub offsets: Vec<u32>,
    /// Nodes of the cells, in VTK's order. A polyhedron stores its faces instead: their number, then for each face the
    /// number of its nodes and the nodes.
    pub connectivity: Vec<u32>,
}

impl CellMesh {
    /// Builds a grid from lists as VTK programs hold them in memory.
    ///
    /// - `nodes`: positions, world units.
    /// - `kinds`: VTK's number for the kind of each cell.
    /// - `cells`: for each cell the number of its entries, then the entries. They are its nodes, in VTK's order, or the
    ///   faces of a polyhedron as in [`CellMesh::connectivity`].
    ///
    /// ```
    /// use ewa_splat::io::{CellKind, CellMesh};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let nodes = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    /// let mesh = CellMesh::of_lists(nodes, &[10], &[4, 0, 1, 2, 3])?;
    /// assert_eq!((mesh.kinds[0], mesh.cell(0)), (CellKind::TETRA, &[0, 1, 2, 3][..]));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The numbers of lists and of kinds differ, a list ends too soon, or a number is not that of a node.
    pub fn of_lists(nodes: impl Into<Vec<DVec3>>, kinds: &[u8], cells: &[i64]) -> Result<Self> {
        let fault = |place: String, expected: &str, found: String| {
            let advice = "give the cells as VTK counts them";
            Error::invalid("cells", place, expected, found, advice)
        };
        let number = |at: usize, cell: usize| {
            let found = cells[at];
            let place = || format!("cell {cell}");
            u32::try_from(found).map_err(|_| fault(place(), "numbers from 0 up", found.to_string()))
        };
        let mut mesh = Self {
            nodes: nodes.into(),
            kinds: kinds.iter().copied().map(CellKind).collect(),
            offsets: vec![0],
            connectivity: Vec::with_capacity(cells.len().saturating_sub(kinds.len())),
        };
        let mut at: usize = 0;
        for cell in 0..kinds.len() {
            let whole = |length: usize| {
                (at + 1)
                    .checked_add(length)
                    .filter(|end| *end <= cells.len())
            };
            let end = match at < cells.len() {
                true => whole(number(at, cell)? as usize),
                false => None,
            };
            let end = end.ok_or_else(|| {
                let found = format!("the end of {} numbers", cells.len());
                fault(
                    format!("cell {cell}"),
                    "its count of numbers, and these",
                    found,
                )
            })?;
            for place in at + 1..end {
                mesh.connectivity.push(number(place, cell)?);
            }
            let offset = u32::try_from(mesh.connectivity.len());
            mesh.offsets.push(offset.map_err(|_| {
                fault("numbers".into(), "fewer than 2^32", cells.len().to_string())
            })?);
            at = end;
        }
        if at != cells.len() {
            let found = format!("{} numbers beyond the last of them", cells.len() - at);
            let expected = format!("{} cells, one for each kind", kinds.len());
            return Err(fault("lists".into(), &expected, found));
        }
        Ok(mesh)
    }

    /// Returns the number of cells.
    pub fn cell_count(&self) -> usize {
        self.kinds.len()
    }

    /// Returns the number of values of a field of nodes or cells.
    pub(crate) fn count_of(&self, association: Association) -> usize {
        match association {
            Association::Nodes => self.nodes.len(),
            Association::Cells => self.cell_count(),
        }
    }

    /// Appends the cells and nodes of another grid. The caller checks that 32-bit integers can count them.
    ///
    /// - `shift`: number that is added to the node indices of `other`.
    pub(crate) fn append(&mut self, mut other: Self, shift: u32) {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "callers count entries first"
        )]
        let first = self.connectivity.len() as u32;
        for (i, &kind) in other.kinds.iter().enumerate().filter(|_| shift > 0) {
            let cell = other.offsets[i] as usize..other.offsets[i + 1] as usize;
            renumber(kind, &mut other.connectivity[cell], |node| node + shift);
        }
        self.nodes.append(&mut other.nodes);
        self.kinds.append(&mut other.kinds);
        let ends = other.offsets.iter().skip(1);
        self.offsets.extend(ends.map(|end| end + first));
        self.connectivity.append(&mut other.connectivity);
    }

    /// Returns the entries of one cell in `connectivity`.
    pub fn cell(&self, i: usize) -> &[u32] {
        &self.connectivity[self.offsets[i] as usize..self.offsets[i + 1] as usize]
    }
}

/// Renumbers the nodes of a cell whose entries have been checked.
pub(crate) fn renumber(kind: CellKind, mut cell: &mut [u32], mut number: impl FnMut(u32) -> u32) {
    if kind != CellKind::POLYHEDRON {
        cell.iter_mut().for_each(|n| *n = number(*n));
        return;
    }
    cell = &mut cell[1..];
    while let Some((&mut count, rest)) = cell.split_first_mut() {
        let (face, rest) = rest.split_at_mut(count as usize);
        face.iter_mut().for_each(|n| *n = number(*n));
        cell = rest;
    }
}

/// Kind of a cell: VTK's number for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct CellKind(pub u8);

impl CellKind {
    /// An unused cell.
    pub const EMPTY: Self = Self(0);
    /// A single node.
    pub const VERTEX: Self = Self(1);
    /// Several nodes, each a separate point.
    pub const POLY_VERTEX: Self = Self(2);
    /// A line.
    pub const LINE: Self = Self(3);
    /// A chain of lines.
    pub const POLY_LINE: Self = Self(4);
    /// A triangle.
    pub const TRIANGLE: Self = Self(5);
    /// A strip of triangles.
    pub const TRIANGLE_STRIP: Self = Self(6);
    /// A polygon.
    pub const POLYGON: Self = Self(7);
    /// A rectangle whose nodes are numbered x fastest.
    pub const PIXEL: Self = Self(8);
    /// A quadrilateral.
    pub const QUAD: Self = Self(9);
    /// A tetrahedron.
    pub const TETRA: Self = Self(10);
    /// A cuboid whose nodes are numbered x fastest.
    pub const VOXEL: Self = Self(11);
    /// A hexahedron.
    pub const HEXAHEDRON: Self = Self(12);
    /// A triangular prism.
    pub const WEDGE: Self = Self(13);
    /// A pyramid over a quadrilateral.
    pub const PYRAMID: Self = Self(14);
    /// A polygon with a node on each of its edges.
    pub const QUADRATIC_POLYGON: Self = Self(36);
    /// A solid bounded by any polygons.
    pub const POLYHEDRON: Self = Self(42);

    /// Returns the name, for people.
    pub fn name(self) -> &'static str {
        match self.0 {
            0 => "empty cell",
            1 => "vertex",
            2 => "poly-vertex",
            3 => "line",
            4 => "poly-line",
            5 => "triangle",
            6 => "triangle strip",
            7 => "polygon",
            8 => "pixel",
            9 => "quadrilateral",
            10 => "tetrahedron",
            11 => "voxel",
            12 => "hexahedron",
            13 => "wedge",
            14 => "pyramid",
            15 => "pentagonal prism",
            16 => "hexagonal prism",
            21 => "quadratic edge",
            22 => "quadratic triangle",
            23 => "quadratic quadrilateral",
            24 => "quadratic tetrahedron",
            25 => "quadratic hexahedron",
            26 => "quadratic wedge",
            27 => "quadratic pyramid",
            28 => "biquadratic quadrilateral",
            29 => "triquadratic hexahedron",
            30 => "quadratic-linear quadrilateral",
            31 => "quadratic-linear wedge",
            32 => "biquadratic wedge",
            33 => "biquadratic hexahedron",
            34 => "biquadratic triangle",
            35 => "cubic line",
            36 => "quadratic polygon",
            37 => "triquadratic pyramid",
            41 => "convex point set",
            42 => "polyhedron",
            68 => "Lagrange curve",
            69 => "Lagrange triangle",
            70 => "Lagrange quadrilateral",
            71 => "Lagrange tetrahedron",
            72 => "Lagrange hexahedron",
            73 => "Lagrange wedge",
            74 => "Lagrange pyramid",
            75 => "Bezier curve",
            76 => "Bezier triangle",
            77 => "Bezier quadrilateral",
            78 => "Bezier tetrahedron",
            79 => "Bezier hexahedron",
            80 => "Bezier wedge",
            81 => "Bezier pyramid",
            _ => "unknown cell",
        }
    }

    /// Returns true if the cell is a piece of a surface.
    pub(crate) fn is_flat(self) -> bool {
        let has_any_count = matches!(
            self,
            Self::TRIANGLE_STRIP | Self::POLYGON | Self::QUADRATIC_POLYGON
        );
        has_any_count || self.flat_corner_count().is_some()
    }

    /// Returns the number of corners of a piece of a surface, if its kind fixes it. Cells of higher order count by
    /// their corners, which VTK numbers first.
    pub(crate) fn flat_corner_count(self) -> Option<usize> {
        match self.0 {
            5 | 22 | 34 | 69 | 76 => Some(3),
            8 | 9 | 23 | 28 | 30 | 70 | 77 => Some(4),
            _ => None,
        }
    }

    /// Returns true if the cell has no area: points, lines, empty cells.
    pub(crate) fn is_thin(self) -> bool {
        matches!(self.0, 0..=4 | 21 | 35 | 68 | 75)
    }

    /// Returns true if the cell is a solid whose faces are known. A polyhedron states them itself.
    pub(crate) fn is_solid(self) -> bool {
        self.faces().is_some() || self == Self::POLYHEDRON
    }

    /// Returns the faces of a solid cell of fixed shape, each a list of corners, as indices of the cell's nodes. Seen
    /// from outside, corners run anticlockwise. Cells of higher order are represented by their corners, which VTK
    /// numbers first. Returns `None` for all others, including polyhedra.
    pub fn faces(self) -> Option<&'static [&'static [u8]]> {
        Some(match self.0 {
            10 | 24 | 71 | 78 => &[&[0, 1, 3], &[1, 2, 3], &[2, 0, 3], &[0, 2, 1]],
            11 => &[
                &[0, 4, 6, 2],
                &[1, 3, 7, 5],
                &[0, 1, 5, 4],
                &[2, 6, 7, 3],
                &[0, 2, 3, 1],
                &[4, 5, 7, 6],
            ],
            12 | 25 | 29 | 33 | 72 | 79 => &[
                &[0, 4, 7, 3],
                &[1, 2, 6, 5],
                &[0, 1, 5, 4],
                &[3, 7, 6, 2],
                &[0, 3, 2, 1],
                &[4, 5, 6, 7],
            ],
            13 | 26 | 31 | 32 | 73 | 80 => &[
                &[0, 1, 2],
                &[3, 5, 4],
                &[0, 3, 4, 1],
                &[1, 4, 5, 2],
                &[2, 5, 3, 0],
            ],
            14 | 27 | 37 | 74 | 81 => &[
                &[0, 3, 2, 1],
                &[0, 1, 4],
                &[1, 2, 4],
                &[2, 3, 4],
                &[3, 0, 4],
            ],
            15 => &[
                &[0, 4, 3, 2, 1],
                &[5, 6, 7, 8, 9],
                &[0, 1, 6, 5],
                &[1, 2, 7, 6],
                &[2, 3, 8, 7],
                &[3, 4, 9, 8],
                &[4, 0, 5, 9],
            ],
            16 => &[
                &[0, 5, 4, 3, 2, 1],
                &[6, 7, 8, 9, 10, 11],
                &[0, 1, 7, 6],
                &[1, 2, 8, 7],
                &[2, 3, 9, 8],
                &[3, 4, 10, 9],
                &[4, 5, 11, 10],
                &[5, 0, 6, 11],
            ],
            _ => return None,
        })
    }

    /// Returns true if the cell has nodes that are no corners, which [`CellKind::faces`] leaves out.
    pub fn is_of_higher_order(self) -> bool {
        matches!(self.0, 21..=37 | 68..=81)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cells_end_in_a_mesh_or_in_an_error() {
        let nodes = [DVec3::ZERO; 8];
        let of = |kinds: &[u8], cells: &[i64]| CellMesh::of_lists(nodes, kinds, cells);
        let mesh = of(&[10, 5], &[4, 0, 1, 2, 3, 3, 7, 6, 5]).unwrap();
        assert_eq!(mesh.offsets, [0, 4, 7]);
        assert_eq!(mesh.cell(1), [7, 6, 5]);
        assert_eq!(of(&[], &[]).unwrap().cell_count(), 0);
        for (kinds, cells) in [
            (&[10][..], &[][..]),
            (&[10], &[5, 0, 1, 2, 3]),
            (&[10], &[4, 0, 1, 2, 3, 0]),
            (&[10], &[-1, 0]),
            (&[10], &[1, -1]),
            (&[10], &[i64::MAX, 0]),
            (&[10], &[1, i64::from(u32::MAX) + 1]),
            (&[10, 10], &[1, 0]),
        ] {
            assert!(of(kinds, cells).is_err(), "{kinds:?} {cells:?}");
        }
    }
}
