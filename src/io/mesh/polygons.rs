//! Triangulates polygons: by a fan if it covers the polygon, else by a constrained Delaunay triangulation in
//! the polygon's plane.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

/// Twice the least area of a fan's triangle, in units of the squared extent of its polygon. Below it, three
/// corners count as collinear, and a fan would leave out the area next to them.
const LEAST_FAN_AREA: f64 = 1e-10;

/// Number of fans that are tried for a polygon that crosses itself; each visits all corners.
const MOST_FANS: usize = 16;

/// Result of a triangulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// The triangles cover the polygon.
    Exact,
    /// The polygon crosses itself or has no area: a fan replaces it.
    Approximate,
}

/// The triangles of polygons, in order.
///
/// - `indices`: the polygons' corners, one polygon after another, as indices into `positions`.
/// - `ends`: end of each polygon in `indices`; the last is the length of `indices`.
/// - `approximate`: is increased by the number of polygons replaced by a fan; see [`approximate_note`].
///
/// A polygon with fewer than three corners becomes a triangle without an area, and is counted with those.
pub(crate) fn triangles(
    indices: &[u32],
    ends: &[usize],
    positions: &[DVec3],
    approximate: &mut usize,
) -> Vec<[u32; 3]> {
    triangles_with(indices, ends, positions, approximate, |_| ())
}

/// As [`triangles`]; calls `of_polygon` with the number of triangles of each polygon, in order.
pub(crate) fn triangles_with(
    indices: &[u32],
    ends: &[usize],
    positions: &[DVec3],
    approximate: &mut usize,
    mut of_polygon: impl FnMut(usize),
) -> Vec<[u32; 3]> {
    if ends.iter().enumerate().all(|(i, end)| *end == 3 * (i + 1)) {
        ends.iter().for_each(|_| of_polygon(1));
        return indices.as_chunks::<3>().0.to_vec();
    }
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    let (mut corners, mut local) = (Vec::new(), Vec::new());
    let mut start = 0;
    for &end in ends {
        // A corner named twice in a row is one.
        let mut face = indices[start..end].to_vec();
        start = end;
        face.dedup();
        while face.len() > 1 && face.first() == face.last() {
            face.pop();
        }
        if face.len() < 3 {
            // Left out and counted with the others that have no area.
            triangles.extend(face.first().map(|&i| [i; 3]));
            of_polygon(usize::from(!face.is_empty()));
            continue;
        }
        corners.clear();
        corners.extend(face.iter().map(|&i| positions[i as usize]));
        local.clear();
        if triangulate(&corners, &mut local) == Outcome::Approximate {
            *approximate += 1;
        }
        triangles.extend(local.iter().map(|t: &[usize; 3]| t.map(|i| face[i])));
        of_polygon(local.len());
    }
    triangles
}

/// The note on polygons replaced by a fan.
pub(crate) fn approximate_note(count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!(
            "{count} polygons cross themselves or have no area: fans of triangles stand for them"
        )
    })
}

/// Appends the triangles of a strip, with its winding: each corner from the third on makes one with the two
/// before it. Triangles of fewer than three different corners, which join strips or change their direction, are
/// skipped.
pub(crate) fn strip(corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    for (i, window) in corners.windows(3).enumerate() {
        let [a, b, c] = [window[0], window[1], window[2]];
        if a != b && b != c && c != a {
            triangles.push(if i % 2 == 0 { [a, b, c] } else { [b, a, c] });
        }
    }
}

/// Appends the triangles of one polygon, as indices of its corners. Returns the outcome.
///
/// The plane is that of Newell's normal. A polygon may touch itself (a hole connected by a cut that is
/// traversed twice): regions of winding number 1 are inside.
fn triangulate(corners: &[DVec3], triangles: &mut Vec<[usize; 3]>) -> Outcome {
    let n = corners.len();
    match n {
        0..=2 => return Outcome::Exact,
        3 => {
            triangles.push([0, 1, 2]);
            return Outcome::Exact;
        }
        _ => {}
    }
    if let Some(points) = in_plane(corners) {
        if fan_covers(&points) {
            triangles.extend(fan(n, 0));
            return Outcome::Exact;
        }
        if let Some(exact) = delaunay(&points) {
            triangles.extend(exact);
            return Outcome::Exact;
        }
    }
    // The fan of least area: for a twisted quad, it is the one without an overhang.
    let area = |start: &usize| -> f64 {
        fan(n, *start)
            .map(|t| {
                let [a, b, c] = t.map(|i| corners[i]);
                (b - a).cross(c - a).length()
            })
            .sum()
    };
    let starts = 0..n.min(MOST_FANS);
    let best = starts.min_by(|a, b| area(a).total_cmp(&area(b)));
    triangles.extend(fan(n, best.unwrap_or(0)));
    Outcome::Approximate
}

/// The triangles between one corner and the edges that do not touch it.
fn fan(corner_count: usize, start: usize) -> impl Iterator<Item = [usize; 3]> {
    let corner = move |i: usize| (start + i) % corner_count;
    (1..corner_count - 1).map(move |i| [corner(0), corner(i), corner(i + 1)])
}

/// The corners in their plane, counter-clockwise, scaled to a unit extent; `None` if there is no plane.
fn in_plane(corners: &[DVec3]) -> Option<Vec<DVec2>> {
    let origin = *corners.first()?;
    let extent = corners
        .iter()
        .map(|p| (*p - origin).abs().max_element())
        .fold(0.0, f64::max);
    if !(extent > 0.0 && extent.is_finite()) {
        return None;
    }
    let local: Vec<DVec3> = corners.iter().map(|p| (*p - origin) / extent).collect();
    if local.iter().any(|p| !p.is_finite()) {
        return None;
    }
    // Newell's normal: the sum over all edges of a x b, here about the first corner.
    let next = local.iter().cycle().skip(1);
    let sum: DVec3 = local.iter().zip(next).map(|(a, b)| a.cross(*b)).sum();
    if !(sum.length() > LEAST_FAN_AREA) {
        return None;
    }
    let (u, v) = sum.normalize().any_orthonormal_pair();
    Some(
        local
            .iter()
            .map(|p| DVec2::new(p.dot(u), p.dot(v)))
            .collect(),
    )
}

/// Whether the triangles between the first corner and each edge tile the polygon: they are in order around the
/// corner, through less than half a turn.
fn fan_covers(points: &[DVec2]) -> bool {
    let arm = |i: usize| points[i] - points[0];
    (1..points.len() - 1).all(|i| {
        arm(i).perp_dot(arm(i + 1)) > LEAST_FAN_AREA && arm(1).perp_dot(arm(i + 1)) > LEAST_FAN_AREA
    })
}

/// The triangles of a polygon that does not cross itself, or `None`.
fn delaunay(points: &[DVec2]) -> Option<Vec<[usize; 3]>> {
    let mut mesh = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    // Corners at one position share a vertex, which keeps the first one's index.
    let mut corner_of: HashMap<FixedVertexHandle, usize> = HashMap::new();
    let mut handles = Vec::with_capacity(points.len());
    // spade refuses numbers that are tiny and not zero.
    let flush = |x: f64| if x.abs() < 1e-30 { 0.0 } else { x };
    for (i, p) in points.iter().enumerate() {
        let handle = mesh.insert(Point2::new(flush(p.x), flush(p.y))).ok()?;
        corner_of.entry(handle).or_insert(i);
        handles.push(handle);
    }
    // Number of times that the polygon traverses each edge from the lower vertex to the higher one, minus the
    // other direction: the change of the winding number across it.
    let mut runs: HashMap<[usize; 2], i64> = HashMap::new();
    let next = handles.iter().cycle().skip(1);
    for (&from, &to) in handles.iter().zip(next) {
        if from == to {
            continue;
        }
        // More than one edge if a vertex lies on the way.
        let edges = mesh.try_add_constraint(from, to);
        let mut at = from;
        for edge in edges {
            let edge = mesh.directed_edge(edge);
            if edge.from().fix() != at {
                return None;
            }
            at = edge.to().fix();
            let [a, b] = [edge.from().index(), edge.to().index()];
            *runs.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
        if at != to {
            return None;
        }
    }
    // Winding numbers of all faces, from the outer one inwards.
    let mut winding = vec![None; mesh.num_all_faces()];
    let outer = mesh.outer_face().index();
    winding[outer] = Some(0_i64);
    let mut open: Vec<_> = Vec::new();
    let cross = |edge: spade::handles::DirectedEdgeHandle<'_, _, _, _, _>| {
        let [a, b] = [edge.from().index(), edge.to().index()];
        let along = runs.get(&[a.min(b), a.max(b)]).copied().unwrap_or(0);
        if a < b { along } else { -along }
    };
    for edge in mesh.convex_hull() {
        // The hull's edges have the outer face on their left.
        let inner = edge.rev();
        let face = inner.face();
        if face.is_outer() || winding[face.index()].is_some() {
            continue;
        }
        winding[face.index()] = Some(cross(inner));
        open.push(face.fix());
    }
    while let Some(face) = open.pop() {
        let number = winding[face.index()]?;
        for edge in mesh.face(face).as_inner()?.adjacent_edges() {
            let neighbour = edge.rev().face();
            let beyond = number - cross(edge);
            match winding[neighbour.index()] {
                Some(known) if known == beyond => {}
                Some(_) => return None,
                None => {
                    winding[neighbour.index()] = Some(beyond);
                    open.push(neighbour.fix());
                }
            }
        }
    }
    let mut triangles = Vec::new();
    for face in mesh.inner_faces() {
        match winding[face.index()]? {
            0 => {}
            1 => {
                let corners = face.vertices().map(|v| corner_of.get(&v.fix()).copied());
                let [Some(a), Some(b), Some(c)] = corners else {
                    return None;
                };
                triangles.push([a, b, c]);
            }
            // Winding number -1 or 2, say: the polygon crosses itself.
            _ => return None,
        }
    }
    Some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice the signed area, in the plane z = 0.
    fn area(points: &[DVec3], triangles: &[[usize; 3]]) -> f64 {
        triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| points[i]);
                (b - a).cross(c - a).z
            })
            .sum()
    }

    fn polygon(xy: &[[f64; 2]]) -> Vec<DVec3> {
        xy.iter().map(|p| DVec3::new(p[0], p[1], 0.0)).collect()
    }

    fn shoelace(points: &[DVec3]) -> f64 {
        let next = points.iter().cycle().skip(1);
        points.iter().zip(next).map(|(a, b)| a.cross(*b).z).sum()
    }

    #[track_caller]
    fn check(xy: &[[f64; 2]], outcome: Outcome) {
        let points = polygon(xy);
        for turn in 0..points.len() {
            let mut points = points.clone();
            points.rotate_left(turn);
            let mut triangles = Vec::new();
            assert_eq!(
                triangulate(&points, &mut triangles),
                outcome,
                "{turn} of {xy:?}"
            );
            let [found, expected] = [area(&points, &triangles), shoelace(&points)];
            assert!(
                (found - expected).abs() <= 1e-12 * expected.abs(),
                "{found} for {expected}, turned {turn}: {triangles:?}"
            );
            if outcome == Outcome::Exact {
                // No triangle is inverted: together with the area, none overlaps another.
                assert!(triangles.iter().all(|t| area(&points, &[*t]) >= 0.0));
            }
        }
    }

    #[test]
    fn polygons_keep_their_area() {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        check(&square, Outcome::Exact);
        // Concave: an arrow head, and a comb.
        check(
            &[[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]],
            Outcome::Exact,
        );
        check(
            &[
                [0.0, 0.0],
                [5.0, 0.0],
                [5.0, 3.0],
                [4.0, 3.0],
                [4.0, 1.0],
                [3.0, 1.0],
                [3.0, 3.0],
                [2.0, 3.0],
                [2.0, 1.0],
                [1.0, 1.0],
                [1.0, 3.0],
                [0.0, 3.0],
            ],
            Outcome::Exact,
        );
        // Collinear corners.
        check(
            &[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]],
            Outcome::Exact,
        );
        // A hole, connected by a cut that is traversed twice.
        check(
            &[
                [0.0, 0.0],
                [4.0, 0.0],
                [4.0, 4.0],
                [0.0, 4.0],
                [0.0, 0.0],
                [1.0, 1.0],
                [1.0, 3.0],
                [3.0, 3.0],
                [3.0, 1.0],
                [1.0, 1.0],
            ],
            Outcome::Exact,
        );
        // Two triangles that touch in a corner, and a corner on another edge.
        check(
            &[
                [0.0, 0.0],
                [1.0, -1.0],
                [1.0, 1.0],
                [0.0, 0.0],
                [-1.0, 1.0],
                [-1.0, -1.0],
            ],
            Outcome::Exact,
        );
        check(
            &[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.0, 0.0], [0.0, 3.0]],
            Outcome::Exact,
        );
    }

    #[test]
    fn polygons_that_cross_themselves_are_told() {
        for xy in [
            // A bow tie of unequal halves, a pentagram, a polygon traversed twice.
            vec![[0.0, 0.0], [3.0, 3.0], [3.0, 0.0], [0.0, 1.0]],
            (0..5)
                .map(|i| {
                    let angle = f64::from(i) * 0.8 * std::f64::consts::PI;
                    [angle.cos(), angle.sin()]
                })
                .collect(),
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].repeat(2),
        ] {
            let mut triangles = Vec::new();
            let outcome = triangulate(&polygon(&xy), &mut triangles);
            assert_eq!(outcome, Outcome::Approximate, "{xy:?}");
            assert_eq!(triangles.len(), xy.len() - 2);
        }
    }

    #[test]
    fn polygons_without_a_plane_are_fans() {
        let line: Vec<DVec3> = (0..5).map(|i| DVec3::splat(f64::from(i))).collect();
        let far = vec![DVec3::X, DVec3::splat(f64::NAN), DVec3::Y, DVec3::Z];
        let huge = vec![
            DVec3::ZERO,
            DVec3::X * f64::MAX,
            DVec3::Y * f64::MAX,
            -DVec3::X * f64::MAX,
        ];
        for points in [line, vec![DVec3::ONE; 4], far, huge] {
            let mut triangles = Vec::new();
            triangulate(&points, &mut triangles);
            assert_eq!(triangles.len(), points.len() - 2);
        }
    }
}
