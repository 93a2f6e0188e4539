//! Finds the planes of a mesh's surface that cut kernels of parts of its cells.
//!
//! A face of four corners is a bilinear patch, other faces are triangles. A part is cut by the tangent plane of each
//! wall at the place nearest to the part: of faces that continue one another the nearest one counts. At a re-entrant
//! edge the region inside two planes is smaller than the domain. There a wall counts only if the part lies straight
//! above it; above neither wall, the kernel is not cut.

use glam::{DMat3, DVec3};

use super::covered::OuterFace;
use super::sharp::{CONCAVE, SAME_PLANE, mirror};
use crate::constants::{EDGE_REACH, MOST_EDGES};

/// Number of steps towards the nearest place of a bilinear patch. Each halves what is left at least on faces that
/// bend by less than their size.
const STEPS: usize = 6;

/// Least cosine between a face's normal and the line to its nearest place if that place is not on its edge.
const STRAIGHT: f64 = 0.97;

/// Greatest number of walls in which a kernel has mirror images.
const MOST_MIRRORS: usize = 3;

/// Greatest distance of a kernel from a plane, in standard deviations, at which its image reaches across.
const IMAGE_REACH: f64 = 3.0;

/// The place of a face nearest to a point.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    place: DVec3,
    /// Unit normal into the domain.
    normal: DVec3,
    distance: f64,
    /// Middle of the face.
    middle: DVec3,
    /// True if the point lies straight above the place, not beside the face.
    is_straight: bool,
}

/// The planes of the walls beside a kernel.
#[derive(Debug, Clone, Default)]
pub(super) struct Walls {
    /// A unit normal into the domain and a point each, from near to far.
    pub(super) planes: Vec<[DVec3; 2]>,
    /// True if a wall is beside the kernel that is none of these.
    pub(super) is_partial: bool,
}

/// Returns the planes that cut a kernel.
///
/// - `faces`: faces near the kernel; `node`: returns the position of a node.
/// - `factor`: factor of the kernel's variance.
pub(super) fn walls<'a>(
    faces: impl Iterator<Item = &'a OuterFace>,
    node: impl Fn(u32) -> DVec3,
    centre: DVec3,
    factor: DMat3,
) -> Walls {
    let mut walls = Walls::default();
    let longest = factor
        .transpose()
        .to_cols_array()
        .iter()
        .map(|l| l * l)
        .sum::<f64>();
    let longest = f64::from(EDGE_REACH) * longest.sqrt();
    let near = |face: &OuterFace| {
        let reach = longest
            + face
                .nodes
                .iter()
                .map(|&n| node(n).distance(face.middle))
                .fold(0.0, f64::max);
        if centre.distance_squared(face.middle) > reach * reach {
            return None;
        }
        let found = nearest(face, &node, centre)?;
        let reach = f64::from(EDGE_REACH) * (factor.transpose() * found.normal).length();
        (found.normal.dot(centre - found.place) < reach && found.distance < longest)
            .then_some(found)
    };
    let mut all: Vec<Nearest> = faces.filter_map(near).collect();
    all.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    let mut kept: Vec<Nearest> = Vec::new();
    for found in all {
        if !kept
            .iter()
            .any(|own| own.normal.dot(found.normal) > SAME_PLANE)
        {
            kept.push(found);
        }
    }
    let is_outside = |of: &Nearest, other: &Nearest| {
        let aside = other.middle - of.place;
        of.normal.dot(aside) < -CONCAVE * aside.length()
    };
    for (n, own) in kept.iter().enumerate() {
        let others = kept.iter().enumerate().filter(|(m, _)| *m != n);
        let mut is_reentrant = false;
        for (_, other) in others {
            is_reentrant |= is_outside(own, other) || is_outside(other, own);
        }
        if (is_reentrant && !own.is_straight) || walls.planes.len() == MOST_EDGES {
            walls.is_partial = true;
        } else {
            walls.planes.push([own.normal, own.place]);
        }
    }
    walls
}

impl Walls {
    /// Returns the mirror images of a kernel: centres, and matrices that mirror offsets. There is one in each wall
    /// that the kernel reaches across, and in each pair and triple of them.
    pub(super) fn images(&self, centre: DVec3, factor: DMat3) -> Vec<(DVec3, DMat3)> {
        let reaches = |plane: &&[DVec3; 2]| {
            let inside = plane[0].dot(centre - plane[1]);
            inside < IMAGE_REACH * (factor.transpose() * plane[0]).length()
        };
        let near: Vec<&[DVec3; 2]> = self
            .planes
            .iter()
            .filter(reaches)
            .take(MOST_MIRRORS)
            .collect();
        let image = |images: usize| {
            let planes = near
                .iter()
                .enumerate()
                .filter(|(n, _)| images >> n & 1 == 1);
            planes.fold(
                (centre, DMat3::IDENTITY),
                |(at, turn), (_, [normal, point])| {
                    let at = at - *normal * (2.0 * normal.dot(at - *point));
                    (at, mirror(*normal) * turn)
                },
            )
        };
        (1..1_usize << near.len()).map(image).collect()
    }
}

/// Returns the place of a face nearest to a point; `None` if the face has no normal there.
fn nearest(face: &OuterFace, node: impl Fn(u32) -> DVec3, point: DVec3) -> Option<Nearest> {
    let corners: Vec<DVec3> = face.nodes.iter().map(|&n| node(n)).collect();
    let (place, across) = match corners[..] {
        [a, b, c] => on_triangle([a, b, c], point),
        [a, b, c, d] => on_patch([a, b, c, d], point),
        _ => {
            let count = corners.len();
            let fans = (0..count)
                .map(|i| on_triangle([corners[i], corners[(i + 1) % count], face.middle], point));
            fans.min_by(|(p, _), (q, _)| {
                p.distance_squared(point)
                    .total_cmp(&q.distance_squared(point))
            })?
        }
    };
    let normal = across.try_normalize()?;
    let normal = normal * normal.dot(face.normal).signum();
    let line = point - place;
    let distance = line.length();
    Some(Nearest {
        place,
        normal,
        distance,
        middle: face.middle,
        is_straight: normal.dot(line) >= STRAIGHT * distance,
    })
}

/// Returns the place of a triangle nearest to a point, and a normal.
fn on_triangle([a, b, c]: [DVec3; 3], point: DVec3) -> (DVec3, DVec3) {
    let across = (b - a).cross(c - a);
    let area = across.length_squared();
    let (u, v, w) = (b - a, c - a, point - a);
    let p = w.cross(v).dot(across) / area;
    let q = u.cross(w).dot(across) / area;
    if p >= 0.0 && q >= 0.0 && p + q <= 1.0 {
        return (a + u * p + v * q, across);
    }
    let on_edge = |[from, to]: [DVec3; 2]| {
        let along = to - from;
        let share = (point - from).dot(along) / along.length_squared();
        from + along * share.clamp(0.0, 1.0)
    };
    let edges = [[a, b], [b, c], [c, a]].map(on_edge);
    let best = edges.into_iter().min_by(|p, q| {
        p.distance_squared(point)
            .total_cmp(&q.distance_squared(point))
    });
    (best.unwrap_or(a), across)
}

/// Returns the place of a bilinear patch nearest to a point, and a normal there.
fn on_patch([a, b, c, d]: [DVec3; 4], point: DVec3) -> (DVec3, DVec3) {
    let at = |s: f64, t: f64| a + (b - a) * s + (d - a) * t + (a - b + c - d) * (s * t);
    let tangents = |s: f64, t: f64| {
        let twist = a - b + c - d;
        [b - a + twist * t, d - a + twist * s]
    };
    let (mut s, mut t) = (0.5, 0.5);
    for _ in 0..STEPS {
        let [u, v] = tangents(s, t);
        let left = point - at(s, t);
        // Along each tangent in turn with the other held if the step leaves the patch.
        let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
        let (ul, vl) = (u.dot(left), v.dot(left));
        let det = uu * vv - uv * uv;
        if !(det > 0.0) {
            break;
        }
        let free = [s + (ul * vv - vl * uv) / det, t + (vl * uu - ul * uv) / det];
        let held = free.map(|x| x.clamp(0.0, 1.0));
        let [x, y] = if held[0] != free[0] {
            let y = t + (vl - (held[0] - s) * uv) / vv;
            [held[0], y.clamp(0.0, 1.0)]
        } else if held[1] != free[1] {
            let x = s + (ul - (held[1] - t) * uv) / uu;
            [x.clamp(0.0, 1.0), held[1]]
        } else {
            held
        };
        (s, t) = (x, y);
    }
    let [u, v] = tangents(s, t);
    (at(s, t), u.cross(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::positions::index_u32;

    fn face(nodes: [DVec3; 4], inner: DVec3) -> OuterFace {
        OuterFace::new(0, &[0, 1, 2, 3], |n| nodes[n as usize], inner).unwrap()
    }

    fn square(origin: DVec3, u: DVec3, v: DVec3) -> [DVec3; 4] {
        [origin, origin + u, origin + u + v, origin + v]
    }

    /// Returns the walls of faces of the nodes of each.
    fn of(faces: &[([DVec3; 4], DVec3)], centre: DVec3, sigma: f64) -> Walls {
        let nodes: Vec<DVec3> = faces.iter().flat_map(|(nodes, _)| *nodes).collect();
        let all: Vec<OuterFace> = faces
            .iter()
            .enumerate()
            .map(|(n, (corners, inner))| {
                let mut own = face(*corners, *inner);
                own.nodes = (0..4).map(|c| index_u32(4 * n + c)).collect();
                own
            })
            .collect();
        let factor = DMat3::from_diagonal(DVec3::splat(sigma));
        walls(all.iter(), |n| nodes[n as usize], centre, factor)
    }

    #[test]
    fn a_part_is_cut_at_the_patch_beside_it() {
        let up = DVec3::Z;
        // A saddle: z = x y.
        let mut saddle = square(DVec3::ZERO, DVec3::X, DVec3::Y);
        saddle[2].z = 1.0;
        let found = of(&[(saddle, up)], DVec3::new(0.5, 0.2, 0.4), 0.2);
        let [[normal, place]] = found.planes[..] else {
            panic!("{found:?}")
        };
        assert!((place.z - place.x * place.y).abs() < 1e-12);
        let line = DVec3::new(0.5, 0.2, 0.4) - place;
        assert!((normal.dot(line) - line.length()).abs() < 1e-4, "{found:?}");
        assert!(
            of(&[(saddle, up)], DVec3::new(0.5, 0.2, 3.0), 0.2)
                .planes
                .is_empty()
        );
    }

    #[test]
    fn faces_of_one_wall_cut_once_and_those_of_a_corner_each() {
        let floor = |x: f64| {
            (
                square(DVec3::X * x, DVec3::X, DVec3::Y),
                DVec3::new(x, 0.5, 1.0),
            )
        };
        let side = (
            square(DVec3::ZERO, DVec3::Y, DVec3::Z),
            DVec3::new(1.0, 0.5, 0.5),
        );
        let centre = DVec3::new(0.2, 0.5, 0.1);
        let found = of(&[floor(0.0), floor(1.0), side], centre, 0.1);
        assert_eq!(found.planes.len(), 2);
        assert!(found.planes[0][0].abs_diff_eq(DVec3::Z, 1e-12));
        let factor = DMat3::from_diagonal(DVec3::splat(0.1));
        let images: Vec<DVec3> = found.images(centre, factor).iter().map(|i| i.0).collect();
        let expected = [(0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1)];
        let expected = expected.map(|(x, z)| DVec3::new(x, 0.5, z));
        assert!(
            images
                .iter()
                .zip(expected)
                .all(|(a, b)| a.abs_diff_eq(b, 1e-12)),
            "{images:?}"
        );
    }

    #[test]
    fn re_entrant_edges_do_not_cut_what_lies_behind_the_other_wall() {
        // The domain is all but x < 0, z < 0.
        let floor = (
            square(-DVec3::X, DVec3::X, DVec3::Y),
            DVec3::new(-0.5, 0.5, 1.0),
        );
        let side = (
            square(-DVec3::Z, DVec3::Z, DVec3::Y),
            DVec3::new(1.0, 0.5, -0.5),
        );
        let both = [floor, side];
        let above = of(&both, DVec3::new(-0.5, 0.5, 0.1), 0.2);
        assert_eq!(above.planes.len(), 1);
        let beyond = of(&both, DVec3::new(0.1, 0.5, 0.1), 0.2);
        assert!(beyond.planes.is_empty() && beyond.is_partial);
    }
}
