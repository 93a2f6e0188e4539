//! Interpolates in cells of higher order, and cuts them into cells of first order.
//!
//! A position or a value inside a cell is a weighted sum over its nodes. The element's shape functions give the
//! weights. Those of Lagrange and quadratic elements are polynomials that are 1 at their node and 0 at the others.
//! The basis functions of Bezier elements are Bernstein polynomials. Incomplete (serendipity) elements use the polynomials that their
//! nodes determine. The quadratic pyramid uses the rational functions of Bedrosian (1992), which agree with those of
//! its neighbours on every face.
//!
//! | kinds of VTK | nodes | functions |
//! |---|---|---|
//! | 22, 24, 28, 29, 32 and 69 to 73 | all of a lattice | Lagrange |
//! | 30, 31 | two steps along some axes, one along the others | Lagrange |
//! | 23, 25, 26, 33, 34 | some of a lattice | from the terms in [`terms`] |
//! | 27 | corners and edges of a pyramid | from the terms in [`terms`] |
//! | 76 to 80 | as 69 to 73 | Bernstein, without rational weights |
//!
//! Triquadratic, Lagrange and Bezier pyramids (37, 74, 81), and elements whose axes differ in order, are not supported.

mod nodes;
mod split;
mod subdivision;

use nodes::Place;
pub(crate) use subdivision::{Subdivision, steps};

use crate::data::cells::CellKind;

/// Greatest number of steps along an edge of Lagrange and Bezier elements.
const MOST_ORDER: i32 = 8;

/// Shape of an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Shape {
    Triangle,
    Quadrilateral,
    Tetrahedron,
    Hexahedron,
    Wedge,
    Pyramid,
}

impl Shape {
    /// Returns the shape's axes, grouped by simplex: a line, a triangle or a tetrahedron. The shape is the product of
    /// these simplices.
    fn simplices(self) -> &'static [&'static [usize]] {
        match self {
            Self::Triangle => &[&[0, 1]],
            Self::Quadrilateral => &[&[0], &[1]],
            Self::Tetrahedron => &[&[0, 1, 2]],
            Self::Hexahedron | Self::Pyramid => &[&[0], &[1], &[2]],
            Self::Wedge => &[&[0, 1], &[2]],
        }
    }
}

/// Element of higher order.
#[derive(Debug)]
pub(crate) struct Element {
    shape: Shape,
    /// Number of steps along each axis.
    orders: [i32; 3],
    /// Positions of the nodes, in steps.
    places: Vec<Place>,
    functions: Functions,
    /// Greatest number of steps from node to node along an edge.
    order: i32,
}

#[derive(Debug)]
enum Functions {
    Lagrange,
    Bernstein,
    /// Terms of this kind, and row by row the coefficients of each node's function.
    Terms(CellKind, Vec<f64>),
}

impl Element {
    /// Returns the element of a cell; `None` if it is of first order or not supported.
    pub(crate) fn of(kind: CellKind, node_count: usize) -> Option<Self> {
        let quadratic = |shape, places: Vec<Place>, count: usize| {
            let places = places.get(..count)?.to_vec();
            Some((shape, [2; 3], places))
        };
        let (shape, orders, places) = match kind.0 {
            22 => quadratic(Shape::Triangle, nodes::triangles(2), 6),
            34 => {
                // The middle lies between two-step positions, so the lattice is three times as fine.
                let middle = [[2, 2, 0]];
                let fine = nodes::triangles(2)
                    .into_iter()
                    .map(|place| place.map(|i| 3 * i));
                Some((Shape::Triangle, [6; 3], fine.chain(middle).collect()))
            }
            23 => quadratic(Shape::Quadrilateral, nodes::quadrilateral(2), 8),
            28 => quadratic(Shape::Quadrilateral, nodes::quadrilateral(2), 9),
            30 => {
                let corners = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]];
                let places = [&corners[..], &[[1, 0, 0], [1, 1, 0]]].concat();
                Some((Shape::Quadrilateral, [2, 1, 1], places))
            }
            24 => quadratic(Shape::Tetrahedron, nodes::tetrahedron(2), 10),
            25 => quadratic(Shape::Hexahedron, nodes::hexahedron(2), 20),
            33 => quadratic(Shape::Hexahedron, nodes::hexahedron(2), 24),
            29 => quadratic(Shape::Hexahedron, nodes::hexahedron(2), 27),
            26 => quadratic(Shape::Wedge, nodes::wedge(2), 15),
            32 => quadratic(Shape::Wedge, nodes::wedge(2), 18),
            31 => {
                let flat = nodes::wedge(2).into_iter().filter(|place| place[2] != 1);
                let places = flat.map(|[i, j, k]| [i, j, k / 2]).collect();
                Some((Shape::Wedge, [2, 2, 1], places))
            }
            27 => {
                let base = nodes::quadrilateral(2);
                let corners = base[..4].iter().copied();
                let sides = corners.clone().map(|[i, j, _]| [i, j, 1]);
                let apex = [[0, 0, 2]];
                let middles = base[4..8].iter().copied();
                let places = corners.chain(apex).chain(middles).chain(sides).collect();
                Some((Shape::Pyramid, [2; 3], places))
            }
            69 | 76 => whole(Shape::Triangle, nodes::triangles, node_count),
            70 | 77 => whole(Shape::Quadrilateral, nodes::quadrilateral, node_count),
            71 | 78 => whole(Shape::Tetrahedron, nodes::tetrahedron, node_count),
            72 | 79 => whole(Shape::Hexahedron, nodes::hexahedron, node_count),
            73 | 80 => whole(Shape::Wedge, nodes::wedge, node_count),
            _ => None,
        }?;
        if places.len() != node_count {
            return None;
        }
        let order = match kind.0 {
            34 => 2,
            _ => orders.into_iter().max()?,
        };
        let functions = match kind.0 {
            23 | 25 | 26 | 27 | 33 | 34 => {
                let terms = places
                    .iter()
                    .map(|place| terms(kind, local(shape, *place, orders)));
                Functions::Terms(kind, inverse(terms.collect())?)
            }
            76..=80 => Functions::Bernstein,
            _ => Functions::Lagrange,
        };
        Some(Self {
            shape,
            orders,
            places,
            functions,
            order,
        })
    }

    /// Returns the weights of the nodes at a position inside.
    ///
    /// - `at`: position from 0 to 1 along each axis. The apex of a pyramid is above the middle of its base.
    pub(crate) fn weights(&self, at: [f64; 3]) -> Vec<f64> {
        match &self.functions {
            Functions::Terms(kind, coefficients) => {
                let terms = terms(*kind, at);
                let rows = coefficients.chunks_exact(terms.len());
                rows.map(|row| row.iter().zip(&terms).map(|(c, t)| c * t).sum())
                    .collect()
            }
            _ => self
                .places
                .iter()
                .map(|place| self.weight(*place, at))
                .collect(),
        }
    }

    /// Returns the weight of a node of a whole lattice: a product over the element's simplices, and in each over the
    /// barycentric coordinates.
    fn weight(&self, node: Place, at: [f64; 3]) -> f64 {
        let of_simplex = |axes: &&[usize]| {
            let n = self.orders[axes[0]];
            let rest = axes.iter().fold((n, 1.0), |(steps, share), &axis| {
                (steps - node[axis], share - at[axis])
            });
            let coordinates = axes
                .iter()
                .map(|&axis| (node[axis], at[axis]))
                .chain([rest]);
            match self.functions {
                Functions::Bernstein => {
                    let counts = coordinates.clone().map(|(steps, _)| steps);
                    let powers = coordinates.map(|(steps, share)| share.powi(steps));
                    multinomial(counts) * powers.product::<f64>()
                }
                _ => coordinates
                    .map(|(steps, share)| lagrange(steps, n, share))
                    .product(),
            }
        };
        self.shape.simplices().iter().map(of_simplex).product()
    }

    /// Returns small cells of first order, `n` along each edge, as their kinds and corners.
    fn split(&self, n: i32) -> Vec<(CellKind, Vec<[f64; 3]>)> {
        let shape = self.shape;
        let at = |[i, j, k]: Place| match shape {
            // In a pyramid, i and j count the steps of their own layer.
            Shape::Pyramid => {
                let middle = |i: i32| (f64::from(i) + 0.5 * f64::from(k)) / f64::from(n);
                [middle(i), middle(j), f64::from(k) / f64::from(n)]
            }
            _ => [i, j, k].map(|i| f64::from(i) / f64::from(n)),
        };
        let cells = split::cells(shape, n).into_iter();
        cells
            .map(|(kind, corners)| (kind, corners.into_iter().map(at).collect()))
            .collect()
    }
}

/// Returns an element with all nodes of a lattice.
fn whole(
    shape: Shape,
    nodes: fn(i32) -> Vec<Place>,
    count: usize,
) -> Option<(Shape, [i32; 3], Vec<Place>)> {
    (1..=MOST_ORDER).find_map(|n| {
        let places = nodes(n);
        (places.len() == count).then_some((shape, [n; 3], places))
    })
}

/// Returns the position of a node, from 0 to 1 along each axis.
fn local(shape: Shape, place: Place, orders: [i32; 3]) -> [f64; 3] {
    let share = |axis: usize| f64::from(place[axis]) / f64::from(orders[axis]);
    let [x, y, z] = [0, 1, 2].map(share);
    match shape {
        // The nodes of the sides lie above those of the base, moved inwards.
        Shape::Pyramid => [x + (0.5 - x) * z, y + (0.5 - y) * z, z],
        _ => [x, y, z],
    }
}

/// Returns the polynomial of one barycentric coordinate that is 1 at step `i` of `n` and 0 at the steps before `i`.
fn lagrange(i: i32, n: i32, share: f64) -> f64 {
    let steps = f64::from(n) * share;
    let factors = (0..i).map(|m| (steps - f64::from(m)) / f64::from(i - m));
    factors.product()
}

/// Returns the multinomial coefficient: the factorial of the sum over the product of the factorials.
fn multinomial(counts: impl Iterator<Item = i32>) -> f64 {
    let mut total = 0;
    let mut product = 1.0;
    for count in counts {
        for i in 1..=count {
            total += 1;
            product *= f64::from(total) / f64::from(i);
        }
    }
    product
}

/// Returns the terms of an incomplete element at a position. The element's functions are sums of these terms.
fn terms(kind: CellKind, [x, y, z]: [f64; 3]) -> Vec<f64> {
    // Terms of a quadrilateral with a node on each edge.
    let flat = |x: f64, y: f64| [1.0, x, y, x * x, x * y, y * y, x * x * y, x * y * y];
    match kind.0 {
        23 => flat(x, y).to_vec(),
        34 => {
            let bubble = x * y * (1.0 - x - y);
            vec![1.0, x, y, x * x, x * y, y * y, bubble]
        }
        26 => {
            let triangle = [1.0, x, y, x * x, x * y, y * y];
            let tilted = triangle.map(|t| t * z);
            let along = [z * z, x * z * z, y * z * z];
            [&triangle[..], &tilted, &along].concat()
        }
        27 => {
            let (p, q, wide) = (2.0 * x - 1.0, 2.0 * y - 1.0, 1.0 - z);
            // Fractions of the width at that height. At the apex they may be 0, because the width multiplies their
            // terms.
            let [r, s] = [p, q].map(|distance| if wide > 0.0 { distance / wide } else { 0.0 });
            let whole = [1.0, p, q, z, p * p, p * q, q * q, p * z, q * z, z * z];
            let rational = [r * s * wide, r * p * q, s * p * q];
            [&whole[..], &rational].concat()
        }
        _ => {
            let [xx, yy, zz] = [x * x, y * y, z * z];
            let mut all = vec![1.0, x, y, z, xx, yy, zz, x * y, y * z, z * x, x * y * z];
            all.extend([xx * y, xx * z, yy * x, yy * z, zz * x, zz * y]);
            all.extend([xx * y * z, x * yy * z, x * y * zz]);
            if kind.0 == 33 {
                all.extend([yy * zz, x * yy * zz, xx * zz, xx * y * zz]);
            }
            all
        }
    }
}

/// Inverts and transposes the matrix of the terms at each node. Row by row, the result holds the coefficients of each
/// node's function. The method is Gauss-Jordan elimination with row exchanges. Returns `None` if the terms do not
/// determine the functions.
fn inverse(mut rows: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let n = rows.len();
    for (i, row) in rows.iter_mut().enumerate() {
        if row.len() != n {
            return None;
        }
        row.extend((0..n).map(|j| f64::from(u8::from(i == j))));
    }
    for column in 0..n {
        let size = |i: &usize| rows[*i][column].abs();
        let pivot = (column..n).max_by(|a, b| size(a).total_cmp(&size(b)))?;
        if size(&pivot) < 1e-9 {
            return None;
        }
        rows.swap(column, pivot);
        let scale = rows[column][column].recip();
        rows[column].iter_mut().for_each(|x| *x *= scale);
        let chosen = rows[column].clone();
        for (i, row) in rows.iter_mut().enumerate() {
            if i != column {
                let times = row[column];
                row.iter_mut()
                    .zip(&chosen)
                    .for_each(|(x, y)| *x -= times * y);
            }
        }
    }
    let of_node = |node: usize| rows.iter().map(move |row| row[n + node]);
    Some((0..n).flat_map(of_node).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the weights of each kind, at positions inside, with those that VTK computed.
    #[test]
    fn weights_are_those_of_vtk() {
        let text = include_str!("../../../fixtures/elements_cases.json");
        let cases: serde_json::Value = serde_json::from_str(text).unwrap();
        let numbers = |value: &serde_json::Value| -> Vec<f64> {
            value
                .as_array()
                .unwrap()
                .iter()
                .map(|x| x.as_f64().unwrap())
                .collect()
        };
        for case in cases.as_array().unwrap() {
            let kind = CellKind(u8::try_from(case["kind"].as_u64().unwrap()).unwrap());
            let (at, expected) = (numbers(&case["at"]), numbers(&case["weights"]));
            let element = Element::of(kind, expected.len()).unwrap();
            let found = element.weights([at[0], at[1], at[2]]);
            for (a, b) in found.iter().zip(&expected) {
                let case = format!("{kind:?} of {} nodes at {at:?}", expected.len());
                // The cases have ten digits.
                assert!((a - b).abs() < 2e-10, "{case}: {found:?}, not {expected:?}");
            }
        }
    }

    #[test]
    fn functions_are_one_at_their_node_and_zero_at_the_others() {
        for (kind, count) in [
            (27, 13),
            (25, 20),
            (33, 24),
            (26, 15),
            (34, 7),
            (72, 125),
            (71, 35),
        ] {
            let element = Element::of(CellKind(kind), count).unwrap();
            for (i, place) in element.places.iter().enumerate() {
                let weights = element.weights(local(element.shape, *place, element.orders));
                for (j, weight) in weights.iter().enumerate() {
                    let expected = f64::from(u8::from(i == j));
                    assert!((weight - expected).abs() < 1e-9, "{kind}: {i} {j} {weight}");
                }
            }
        }
    }

    /// A pyramid agrees with a quadratic quadrilateral on its base and with a quadratic triangle on its sides.
    #[test]
    fn pyramids_agree_with_their_neighbours() {
        let pyramid = Element::of(CellKind(27), 13).unwrap();
        let base = Element::of(CellKind(23), 8).unwrap();
        let side = Element::of(CellKind(22), 6).unwrap();
        let spread = |weights: &[f64], nodes: &[usize]| {
            let mut all = [0.0; 13];
            weights.iter().zip(nodes).for_each(|(w, n)| all[*n] = *w);
            all
        };
        let is_same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        for [x, y] in [[0.2, 0.7], [0.5, 0.1], [0.3, 0.4]] {
            let below = spread(&base.weights([x, y, 0.0]), &[0, 1, 2, 3, 5, 6, 7, 8]);
            assert!(is_same(&pyramid.weights([x, y, 0.0]), &below));
            // Side over the edge from corner 0 to corner 1, in barycentric coordinates of corner 1 and the apex.
            let beside = spread(&side.weights([x, y, 0.0]), &[0, 1, 4, 5, 10, 9]);
            let at = [x + 0.5 * y, 0.5 * y, y];
            assert!(is_same(&pyramid.weights(at), &beside));
        }
    }

    #[test]
    fn counts_that_fit_no_element_are_none() {
        assert!(Element::of(CellKind(25), 19).is_none());
        assert!(Element::of(CellKind(72), 26).is_none());
        assert!(Element::of(CellKind(74), 14).is_none());
        assert!(Element::of(CellKind::HEXAHEDRON, 8).is_none());
    }
}
