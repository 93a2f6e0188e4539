//! Assigns each place of a ray to one cell.

use super::hexahedron::Span;

/// A part of a ray that a cell claims.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) cell: usize,
    /// The whole part that the cell claims.
    pub(super) span: Span,
}

impl Piece {
    /// Returns the whole claim of a cell.
    pub(super) fn new(cell: usize, span: Span) -> Self {
        Self {
            from: span.from,
            to: span.to,
            cell,
            span,
        }
    }
}

/// Greatest gap that is closed, as a share of the adjacent pieces. Two cells round the position of their common
/// face differently, the more so the flatter the ray meets it.
const GAP: f64 = 1e-8;

/// Buffers of [`disjoint`].
#[derive(Debug, Default)]
pub(super) struct Scratch {
    places: Vec<f64>,
    active: Vec<usize>,
}

/// Returns parts that do not overlap, in order. If several cells claim a place, it belongs to the first of
/// them. No medium counts twice where blocks overlap, faces are rounded or a ray runs along a face.
pub(super) fn disjoint(claims: &mut [Piece], scratch: &mut Scratch, parts: &mut Vec<Piece>) {
    let Scratch { places, active } = scratch;
    parts.clear();
    active.clear();
    claims.sort_unstable_by(|a, b| a.from.total_cmp(&b.from).then(a.cell.cmp(&b.cell)));
    places.clear();
    places.extend(claims.iter().flat_map(|c| [c.from, c.to]));
    places.sort_unstable_by(f64::total_cmp);
    places.dedup();
    let mut next = 0;
    // The claim that contains the last part.
    let mut last_claim = usize::MAX;
    for pair in places.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        while next < claims.len() && claims[next].from <= from {
            active.push(next);
            next += 1;
        }
        active.retain(|&i| claims[i].to > from);
        let Some(&first) = active.iter().min_by_key(|&&i| (claims[i].cell, i)) else {
            continue;
        };
        match parts.last_mut() {
            Some(last) if last_claim == first && last.to == from => last.to = to,
            _ => parts.push(Piece {
                from,
                to,
                ..claims[first]
            }),
        }
        last_claim = first;
    }
    for i in 1..parts.len() {
        let end = parts[i - 1].to;
        let longer = (parts[i].to - parts[i].from).max(end - parts[i - 1].from);
        if parts[i].from - end <= GAP * longer {
            parts[i].from = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn each_place_belongs_to_the_first_cell_that_claims_it() {
        let piece = |cell: usize, from: f64, to: f64| {
            let guides = [DVec3::ZERO; 3];
            Piece::new(cell, Span { from, to, guides })
        };
        let mut claims = [
            piece(5, 0.0, 4.0),
            piece(2, 1.0, 2.0),
            piece(7, 3.5, 6.0),
            piece(7, 6.0 + 1e-10, 7.0),
            piece(1, 8.0, 9.0),
        ];
        let mut parts = Vec::new();
        disjoint(&mut claims, &mut Scratch::default(), &mut parts);
        let found: Vec<_> = parts.iter().map(|p| (p.cell, p.from, p.to)).collect();
        let expected = [
            (5, 0.0, 1.0),
            (2, 1.0, 2.0),
            (5, 2.0, 4.0),
            (7, 4.0, 6.0),
            (7, 6.0, 7.0),
            (1, 8.0, 9.0),
        ];
        assert_eq!(found, expected);
    }
}
