//! Cuts triangles into pieces that are small compared with a surfel's cell.

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::surface::{Surface, Triangle};
use crate::sample::positions::index_u32;

/// Greatest number of pieces for each cell, in addition to [`MOST_PER_TRIANGLE`].
const MOST_PER_CELL: f64 = 40.0;
const MOST_PER_TRIANGLE: f64 = 4.0;

/// Total number of pieces that is always allowed: half a gigabyte.
const MANY: f64 = 16e6;

/// A part of a triangle, obtained by repeated halving.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    /// Centroid, in the surface's frame.
    pub(super) centre: DVec3,
    /// Index into the triangles that were cut.
    pub(super) triangle: u32,
    /// Halves taken: a leading one, then one bit for each cut, the first cut highest.
    path: u32,
}

/// Greatest number of cuts from a triangle to a piece: one bit of `path` is the leading one.
const MOST_CUTS: u32 = 31;

/// A triangle within a triangle of the mesh.
#[derive(Debug, Clone, Copy)]
struct Part {
    /// Barycentric coordinates of the corners along the two edges of the mesh's triangle.
    corners: [DVec2; 3],
    /// Squared lengths of the sides opposite to the corners.
    sides: [f64; 3],
}

impl Part {
    /// Returns all of a triangle; `e1` and `e2` are the edges of the mesh's triangle.
    fn whole(triangle: &Triangle, e1: DVec3, e2: DVec3) -> Self {
        let [a, b, c] = triangle.corners;
        let squared = |d: DVec2| (e1 * d.x + e2 * d.y).length_squared();
        Self {
            corners: triangle.corners,
            sides: [squared(b - c), squared(c - a), squared(b - a)],
        }
    }

    /// Returns the squared length of the longest side and the corner opposite to it; the first of equal ones.
    fn longest(&self) -> (f64, usize) {
        let [a, b, c] = self.sides;
        if a >= b && a >= c {
            (a, 0)
        } else if b >= c {
            (b, 1)
        } else {
            (c, 2)
        }
    }

    /// Returns the half that `bit` selects. The cut runs from the middle of the longest side to the opposite
    /// corner, which becomes the first. The orientation stays.
    fn half(&self, bit: u32) -> Self {
        let (longest, apex) = self.longest();
        let (next, last) = ((apex + 1) % 3, (apex + 2) % 3);
        let middle = 0.5 * (self.corners[next] + self.corners[last]);
        // Apollonius's theorem: the cut is a median.
        let cut = 0.5 * (self.sides[next] + self.sides[last]) - 0.25 * longest;
        if bit == 0 {
            Self {
                corners: [self.corners[apex], self.corners[next], middle],
                sides: [0.25 * longest, cut, self.sides[last]],
            }
        } else {
            Self {
                corners: [self.corners[apex], middle, self.corners[last]],
                sides: [0.25 * longest, self.sides[next], cut],
            }
        }
    }
}

impl Piece {
    /// Returns the piece's share of its triangle: a power of one half.
    pub(super) fn share(&self) -> f64 {
        let cuts = MOST_CUTS - self.path.leading_zeros();
        1.0 / f64::from(1_u32 << cuts)
    }

    /// Returns barycentric coordinates of the piece's corners along the edges `e1` and `e2` of the mesh's
    /// triangle.
    pub(super) fn corners(&self, triangle: &Triangle, e1: DVec3, e2: DVec3) -> [DVec2; 3] {
        let cuts = MOST_CUTS - self.path.leading_zeros();
        let whole = Part::whole(triangle, e1, e2);
        let half = |part: Part, cut: u32| part.half(self.path >> cut & 1);
        (0..cuts).rev().fold(whole, half).corners
    }
}

/// Returns the variance of a triangle about its centroid, from its corners relative to that.
pub(super) fn variance(corners: [DVec3; 3]) -> DMat3 {
    let square = |d: DVec3| DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    corners.into_iter().map(square).sum::<DMat3>() * (1.0 / 12.0)
}

/// Cuts triangles until no side is longer than `longest`. The limit grows if there would be too many pieces for
/// `cell_count` cells (long slivers).
pub(super) fn cut(
    surface: &Surface,
    triangles: &[Triangle],
    longest: f64,
    cell_count: usize,
) -> Vec<Piece> {
    let most = MOST_PER_CELL * cell_count as f64 + MOST_PER_TRIANGLE * triangles.len() as f64;
    let most = most.max(MANY);
    let mut limit = longest;
    while estimate(surface, triangles, limit) > most {
        limit *= 1.25;
    }
    let limit_squared = limit * limit;
    (0..triangles.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            let [origin, e1, e2] = surface.edges_of(&triangles[i]);
            let mut pieces = Vec::new();
            let whole = Part::whole(&triangles[i], e1, e2);
            cut_one(whole, limit_squared, |path, corners| {
                let b = (corners[0] + corners[1] + corners[2]) / 3.0;
                pieces.push(Piece {
                    centre: origin + e1 * b.x + e2 * b.y,
                    triangle: index_u32(i),
                    path,
                });
            });
            pieces
        })
        .collect()
}

/// Estimates the number of pieces, rather too high. Halves of right isosceles triangles have at least an eighth
/// of the squared limit; slivers are cut along their length.
fn estimate(surface: &Surface, triangles: &[Triangle], limit: f64) -> f64 {
    let of = |t: &Triangle| {
        let [_, e1, e2] = surface.edges_of(t);
        let (longest, _) = Part::whole(t, e1, e2).longest();
        let is_whole = longest <= limit * limit;
        let cuts = 8.0 * t.area / (limit * limit) + 3.0 * longest.sqrt() / limit;
        1.0 + if is_whole { 0.0 } else { cuts }
    };
    // In integers, whose sum does not depend on the order.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturates, and is compared only"
    )]
    let whole = |t: &Triangle| (of(t) as u64).min(1 << 40);
    triangles.par_iter().map(whole).sum::<u64>() as f64
}

fn cut_one(whole: Part, limit_squared: f64, mut found: impl FnMut(u32, &[DVec2; 3])) {
    let mut waiting = vec![(1_u32, whole)];
    while let Some((path, part)) = waiting.pop() {
        let (longest, _) = part.longest();
        if !(longest > limit_squared) || path.leading_zeros() == 0 {
            found(path, &part.corners);
            continue;
        }
        waiting.push((path << 1 | 1, part.half(1)));
        waiting.push((path << 1, part.half(0)));
    }
}
