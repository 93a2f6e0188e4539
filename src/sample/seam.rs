//! Where grids close on themselves.

use std::ops::Range;

use glam::DVec3;

/// Two boundary planes are one seam if no pair of nodes is farther apart than this times the
/// spacing across the seam. Single precision closes a circle of 100 nodes to about 1e-5.
const SEAM_TOLERANCE: f64 = 1e-4;

/// Whether the first and the last plane along an index are one, as far as some nodes tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Seam {
    pub(crate) is_closed: bool,
    /// Whether there is anything between the planes.
    pub(crate) is_crossed: bool,
}

impl Seam {
    pub(crate) const NOTHING: Self = Self {
        is_closed: true,
        is_crossed: false,
    };

    /// What it and another tell.
    #[must_use]
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            is_closed: self.is_closed && other.is_closed,
            is_crossed: self.is_crossed || other.is_crossed,
        }
    }

    /// Of a line of nodes: the first two, the last but one, the last.
    fn of([first, second, before, last]: [DVec3; 4]) -> Self {
        let spacing = first.distance(second).max(before.distance(last));
        Self {
            // Phrased so that NaN says no.
            is_closed: first.distance(last) <= SEAM_TOLERANCE * spacing,
            is_crossed: spacing > 0.0,
        }
    }

    /// Along k, of the nodes of these four planes.
    #[cfg(feature = "cli")]
    pub(crate) fn of_planes([first, second, before, last]: [&[DVec3]; 4]) -> Self {
        let lines = first.iter().zip(second).zip(before.iter().zip(last));
        let seams = lines.map(|((a, b), (c, d))| Self::of([*a, *b, *c, *d]));
        seams.fold(Self::NOTHING, Self::and)
    }

    pub(crate) fn is_seam(self) -> bool {
        self.is_closed && self.is_crossed
    }
}

/// Whether the first and last plane along index `d` coincide (an O-grid's seam), by the lines of nodes that begin in some
/// planes of constant k.
pub(crate) fn seam(dims: [usize; 3], nodes: &[DVec3], d: usize, planes: Range<usize>) -> Seam {
    let n = dims[d];
    // Three cells or more: two would have no inside.
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
