//! Detects seams, along which grids close on themselves.

use std::ops::Range;

use glam::DVec3;

/// Tolerance of a seam: greatest distance between corresponding nodes of the two boundary planes, over the
/// spacing across the seam. Single precision closes a circle of 100 nodes to about 1e-5.
const SEAM_TOLERANCE: f64 = 1e-4;

/// Evidence from some lines of nodes that the first and the last plane along an index coincide.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Seam {
    pub(crate) is_closed: bool,
    /// True if some node of a boundary plane differs from its neighbour in the next plane inside.
    pub(crate) is_crossed: bool,
}

impl Seam {
    pub(crate) const NOTHING: Self = Self {
        is_closed: true,
        is_crossed: false,
    };

    /// Combines the evidence of two sets of lines.
    #[must_use]
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            is_closed: self.is_closed && other.is_closed,
            is_crossed: self.is_crossed || other.is_crossed,
        }
    }

    /// Checks one line of nodes: its first two, its last but one and its last.
    fn of([first, second, before, last]: [DVec3; 4]) -> Self {
        let spacing = first.distance(second).max(before.distance(last));
        Self {
            // Phrased so that NaN gives false.
            is_closed: first.distance(last) <= SEAM_TOLERANCE * spacing,
            is_crossed: spacing > 0.0,
        }
    }

    /// Checks seams along k, from the nodes of four planes.
    pub(crate) fn of_planes([first, second, before, last]: [&[DVec3]; 4]) -> Self {
        let lines = first.iter().zip(second).zip(before.iter().zip(last));
        let seams = lines.map(|((a, b), (c, d))| Self::of([*a, *b, *c, *d]));
        seams.fold(Self::NOTHING, Self::and)
    }

    pub(crate) fn is_seam(self) -> bool {
        self.is_closed && self.is_crossed
    }
}

/// Checks whether the first and last plane along index `d` coincide (an O-grid's seam), by the lines of nodes
/// that begin in `planes` of constant k.
pub(crate) fn seam(dims: [usize; 3], nodes: &[DVec3], d: usize, planes: Range<usize>) -> Seam {
    let n = dims[d];
    // At least three cells: two would enclose nothing.
    if n < 4 {
        return Seam {
            is_closed: false,
            is_crossed: false,
        };
    }
    let strides = [1, dims[0], dims[0] * dims[1]];
    let ranges = [0..dims[0], 0..dims[1], planes];
    let [a, b] = [(d + 1) % 3, (d + 2) % 3];
    let mut all = Seam::NOTHING;
    for p in ranges[a].clone() {
        for q in ranges[b].clone() {
            let start = p * strides[a] + q * strides[b];
            let at = |along: usize| nodes[start + along * strides[d]];
            all = all.and(Seam::of([at(0), at(1), at(n - 2), at(n - 1)]));
            if !all.is_closed {
                return all;
            }
        }
    }
    all
}
