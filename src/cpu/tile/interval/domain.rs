//! Cuts kernels at the boundary of their data's domain: of the share along a ray, the part between the
//! points where the ray enters and leaves the domain remains.
//!
//! Twin: `shaders/tile/interval/domain.wgsl`.

use crate::constants::{EDGE_REACH, TILE_SIZE};
use crate::cpu::tile::evaluate::near::NearWalk;
use crate::cpu::tile::evaluate::{Evaluate, Row, Walk};
use crate::cpu::tile::pixels::RowOf;
use crate::math::lane::cdf;
use crate::record::{NearTerms, RAY_EDGES};

/// Returns the shares of a row's kernel at which the rays enter its domain and leave it. Nothing remains
/// if the first is not less than the second. `None` if nothing cuts it.
#[inline(always)]
pub(in crate::cpu::tile) fn domain_of<const FMA: bool>(
    evaluate: &Evaluate<'_>,
    row: &Row,
) -> Option<[RowOf<f32>; 2]> {
    match evaluate {
        Evaluate::Affine(walk, _) => walk.edges.map(|edges| affine::<FMA>(walk, edges, row)),
        Evaluate::Exact(walk, _) => walk.edges.map(|edges| {
            if edges.edge_count & RAY_EDGES == 0 {
                affine::<FMA>(walk, edges, row)
            } else {
                exact::<FMA>(walk, edges, row)
            }
        }),
        Evaluate::Near(walk) => near::<FMA>(walk, row),
    }
}

const WHOLE: [RowOf<f32>; 2] = [[0.0; TILE_SIZE], [1.0; TILE_SIZE]];

#[inline(always)]
fn planes(terms: &NearTerms) -> &[[f32; 4]] {
    let count = terms.edge_count & !RAY_EDGES;
    &terms.edges[..terms.edges.len().min(count as usize)]
}

/// Cuts by the joint Gaussian of pixel and distance.
#[inline(always)]
fn affine<const FMA: bool>(walk: &Walk<'_>, edges: &NearTerms, row: &Row) -> [RowOf<f32>; 2] {
    let [mut from, mut to] = WHOLE;
    let dy = walk.dy(row.y);
    for &[along_x, along_y, inside, enters] in planes(edges) {
        // One test for all lanes: loops without branches become vector code.
        let side = if enters > 0.0 { -1.0 } else { 1.0 };
        let along_row = |lane| inside + (along_x * walk.dx(lane) + along_y * dy);
        if along_row(0).min(along_row(TILE_SIZE - 1)) > EDGE_REACH {
            continue;
        }
        let mut shares = [0.0; TILE_SIZE];
        for (lane, share) in shares.iter_mut().enumerate() {
            let aside = along_x * walk.dx(lane) + along_y * dy;
            *share = cdf::<FMA>(side * (inside + aside));
        }
        if enters > 0.0 {
            for (from, share) in from.iter_mut().zip(shares) {
                *from = from.max(share);
            }
        } else if enters < 0.0 {
            for (to, share) in to.iter_mut().zip(shares) {
                *to = to.min(share);
            }
        } else {
            // Either all planes of a kernel are of this kind, or none is.
            for (to, share) in to.iter_mut().zip(shares) {
                *to *= share;
            }
        }
    }
    [from, to]
}

/// Cuts at the points where the rays meet the planes.
#[inline(always)]
fn exact<const FMA: bool>(walk: &Walk<'_>, edges: &NearTerms, row: &Row) -> [RowOf<f32>; 2] {
    let [mut from, mut to] = WHOLE;
    let (dy, depth) = (walk.dy(row.y), walk.footprint.depth);
    for &[along_x, along_y, across, inside] in planes(edges) {
        for lane in 0..TILE_SIZE {
            let aside = along_x * walk.dx(lane) + along_y * dy;
            let rate = across + aside;
            // Relative to the centre's depth, so that nothing cancels.
            let beyond = -(inside + depth * aside) / rate;
            let share = cdf::<FMA>((beyond - row.beyond[lane]) * row.per_sigma[lane]);
            if rate > 0.0 {
                from[lane] = from[lane].max(share);
            } else if rate < 0.0 {
                to[lane] = to[lane].min(share);
            } else if inside + depth * aside < 0.0 {
                to[lane] = 0.0;
            }
        }
    }
    [from, to]
}

/// Cuts the part of a near kernel in front of the eye.
#[inline(always)]
fn near<const FMA: bool>(walk: &NearWalk<'_>, row: &Row) -> Option<[RowOf<f32>; 2]> {
    let edges = planes(walk.terms());
    if edges.is_empty() {
        return None;
    }
    let [mut from, mut to] = WHOLE;
    for &edge in edges {
        let [begin, end] = walk.edge_shares::<FMA>(row, edge);
        for lane in 0..TILE_SIZE {
            from[lane] = from[lane].max(begin[lane]);
            to[lane] = to[lane].min(end[lane]);
        }
    }
    Some([from, to])
}
