//! Cuts elements into small cells of first order, on a lattice of `n` steps along each edge.
//!
//! Neighbours cut a shared edge or face in the same way: edges into equal parts, triangles along three families of
//! lines, quadrilaterals into `n` by `n` cells.

use super::Shape;
use super::nodes::Place;
use crate::data::cells::CellKind;

/// Returns the small cells, with the lattice positions of their corners in VTK's order. In pyramids, k counts layers
/// from the base, and i and j count the n - k steps of a layer.
pub(super) fn cells(shape: Shape, n: i32) -> Vec<(CellKind, Vec<Place>)> {
    match shape {
        Shape::Triangle => triangles(n)
            .into_iter()
            .map(|places| (CellKind::TRIANGLE, places.to_vec()))
            .collect(),
        Shape::Quadrilateral => squares(n)
            .map(|places| (CellKind::QUAD, places.to_vec()))
            .collect(),
        Shape::Tetrahedron => tetrahedra(n),
        Shape::Hexahedron => prisms(CellKind::HEXAHEDRON, squares(n).collect(), n),
        Shape::Wedge => prisms(CellKind::WEDGE, triangles(n), n),
        Shape::Pyramid => pyramids(n),
    }
}

fn squares(n: i32) -> impl Iterator<Item = [Place; 4]> {
    let square = |i, j| [[i, j, 0], [i + 1, j, 0], [i + 1, j + 1, 0], [i, j + 1, 0]];
    (0..n).flat_map(move |j| (0..n).map(move |i| square(i, j)))
}

fn triangles(n: i32) -> Vec<[Place; 3]> {
    let mut all = Vec::new();
    for j in 0..n {
        for i in 0..n - j {
            all.push([[i, j, 0], [i + 1, j, 0], [i, j + 1, 0]]);
            if i + j + 2 <= n {
                all.push([[i + 1, j, 0], [i + 1, j + 1, 0], [i, j + 1, 0]]);
            }
        }
    }
    all
}

fn prisms<const N: usize>(
    kind: CellKind,
    bases: Vec<[Place; N]>,
    n: i32,
) -> Vec<(CellKind, Vec<Place>)> {
    let lifted = |base: &[Place; N], k| base.map(|[x, y, z]| [x, y, z + k]);
    let prism = |base: &[Place; N], k| (kind, [lifted(base, k), lifted(base, k + 1)].concat());
    (0..n)
        .flat_map(|k| bases.iter().map(move |base| (base, k)))
        .map(|(base, k)| prism(base, k))
        .collect()
}

/// Cuts the tetrahedron x >= y >= z of a cube. Each small cube is cut into six tetrahedra, one for each order of the
/// axes (Freudenthal's subdivision).
fn tetrahedra(n: i32) -> Vec<(CellKind, Vec<Place>)> {
    const ORDERS: [([usize; 3], bool); 6] = [
        ([0, 1, 2], true),
        ([1, 2, 0], true),
        ([2, 0, 1], true),
        ([0, 2, 1], false),
        ([2, 1, 0], false),
        ([1, 0, 2], false),
    ];
    let is_inside = |[x, y, z]: &Place| n >= *x && x >= y && y >= z && *z >= 0;
    // Converts from x >= y >= z to the steps along the three edges at the first corner.
    let along_edges = |[x, y, z]: Place| [x - y, y - z, z];
    let mut all = Vec::new();
    for z in 0..n {
        for y in z..n {
            for x in y..n {
                for (order, is_even) in ORDERS {
                    let mut at = [x, y, z];
                    let mut corners = vec![at];
                    for axis in order {
                        at[axis] += 1;
                        corners.push(at);
                    }
                    if !corners.iter().all(is_inside) {
                        continue;
                    }
                    if !is_even {
                        corners.swap(1, 2);
                    }
                    let corners = corners.into_iter().map(along_edges).collect();
                    all.push((CellKind::TETRA, corners));
                }
            }
        }
    }
    all
}

/// Returns layers of upright pyramids, inverted pyramids between them, and tetrahedra between their sides.
fn pyramids(n: i32) -> Vec<(CellKind, Vec<Place>)> {
    let square = |i, j, k| {
        let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        corners.map(|(i, j)| [i, j, k])
    };
    let mut all = Vec::new();
    for k in 0..n {
        let wide = n - k;
        for j in 0..wide {
            for i in 0..wide {
                let mut standing = square(i, j, k).to_vec();
                standing.push([i, j, k + 1]);
                all.push((CellKind::PYRAMID, standing));
                if i + 1 < wide && j + 1 < wide {
                    let mut hanging = square(i, j, k + 1).to_vec();
                    hanging.reverse();
                    hanging.push([i + 1, j + 1, k]);
                    all.push((CellKind::PYRAMID, hanging));
                }
                if i + 1 < wide {
                    let side = [
                        [i + 1, j, k],
                        [i + 1, j + 1, k],
                        [i, j, k + 1],
                        [i + 1, j, k + 1],
                    ];
                    all.push((CellKind::TETRA, side.to_vec()));
                }
                if j + 1 < wide {
                    let side = [
                        [i + 1, j + 1, k],
                        [i, j + 1, k],
                        [i, j, k + 1],
                        [i, j + 1, k + 1],
                    ];
                    all.push((CellKind::TETRA, side.to_vec()));
                }
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns six times the signed volume of a small cell in integers, as a sum of tetrahedra at the first corner.
    fn volume(kind: CellKind, corners: &[Place]) -> i64 {
        let edge = |a: usize, b: usize| [0, 1, 2].map(|c| i64::from(corners[b][c] - corners[a][c]));
        let six = |a, b, c, d| {
            let [u, v, w] = [edge(a, b), edge(a, c), edge(a, d)];
            u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0])
                + u[2] * (v[0] * w[1] - v[1] * w[0])
        };
        match kind {
            CellKind::TETRA => six(0, 1, 2, 3),
            CellKind::PYRAMID => six(0, 1, 2, 4) + six(0, 2, 3, 4),
            CellKind::WEDGE => six(0, 1, 2, 5) + six(0, 1, 5, 4) + six(0, 4, 5, 3),
            _ => {
                six(0, 1, 2, 5)
                    + six(0, 2, 3, 7)
                    + six(0, 5, 7, 4)
                    + six(2, 7, 5, 6)
                    + six(0, 2, 7, 5)
            }
        }
    }

    #[test]
    fn parts_fill_the_whole_and_none_is_turned_over() {
        for n in 1..6 {
            for (shape, whole) in [
                (Shape::Tetrahedron, 1),
                (Shape::Hexahedron, 6),
                (Shape::Wedge, 3),
                (Shape::Pyramid, 2),
            ] {
                let cells = cells(shape, n);
                let mut sum = 0;
                for (kind, corners) in &cells {
                    // In a pyramid, each layer is shifted inwards by half a step, so the lattice is twice as fine.
                    let placed: Vec<Place> = corners
                        .iter()
                        .map(|&[i, j, k]| match shape {
                            Shape::Pyramid => [2 * i + k, 2 * j + k, 2 * k],
                            _ => [2 * i, 2 * j, 2 * k],
                        })
                        .collect();
                    let volume = volume(*kind, &placed);
                    assert!(volume > 0, "{shape:?} {n}: {kind:?} {corners:?}");
                    sum += volume;
                }
                assert_eq!(sum, 8 * whole * i64::from(n).pow(3), "{shape:?} {n}");
            }
        }
    }
}
