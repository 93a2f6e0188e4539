//! Interpolates positions and values in the dual cell of a node, from the 3³ nodes around it.

use glam::{DMat3, DVec3, DVec4, Vec4Swizzles as _};

use crate::sample::field::gradient::{SPANNING, Samples};

/// Positions and values of the 3³ nodes around a node, relative to its own.
pub(super) struct Neighbourhood {
    /// Position and value of the node itself.
    own: (DVec3, f64),
    /// Differences of position and value, the first index fastest.
    nodes: [DVec4; 27],
    /// Least and greatest value.
    pub(super) range: [f64; 2],
}

/// Position, value and derivatives at a place of a dual cell.
pub(super) struct Place {
    pub(super) position: DVec3,
    pub(super) value: f64,
    /// Columns ∂x/∂(i, j, k).
    pub(super) jacobian: DMat3,
    /// ∂f/∂(i, j, k).
    slopes: DVec3,
    /// Second differences of position and value along each index; zero along indices that are split.
    second: [DVec4; 3],
}

/// Weights of the three nodes along an index: of the value, of the first and of the second difference.
pub(super) type Weights = [[f64; 3]; 3];

/// Returns the weights along an index.
///
/// - `offset`: distance from the node, in -1/2 to 1/2; `None` for an index that is not split.
pub(super) fn weights(offset: Option<f64>) -> Weights {
    match offset {
        None => [[0.0, 1.0, 0.0], [-0.5, 0.0, 0.5], [1.0, -2.0, 1.0]],
        Some(s) if s < 0.0 => [[-s, 1.0 + s, 0.0], [-1.0, 1.0, 0.0], [0.0; 3]],
        Some(s) => [[0.0, 1.0 - s, s], [0.0, -1.0, 1.0], [0.0; 3]],
    }
}

impl Neighbourhood {
    /// Returns the neighbourhood of a node; `None` if a node of it is unknown.
    pub(super) fn new<F: Fn([usize; 3]) -> Option<(DVec3, f64)>>(
        samples: &Samples<F>,
        node: [usize; 3],
    ) -> Option<Self> {
        let own = (samples.at)(node)?;
        let mut nodes = [DVec4::ZERO; 27];
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for (n, difference) in nodes.iter_mut().enumerate() {
            let steps = [n % 3, n / 3 % 3, n / 9].map(|s| s as isize - 1);
            let (position, value) = samples.neighbour(node, steps)?;
            *difference = (position - own.0).extend(value - own.1);
            range = [range[0].min(value), range[1].max(value)];
        }
        Some(Self { own, nodes, range })
    }

    pub(super) fn position(&self) -> DVec3 {
        self.own.0
    }

    /// Returns the distance of the farthest node around.
    pub(super) fn radius(&self) -> f64 {
        let lengths = self.nodes.iter().map(|node| node.xyz().length());
        lengths.fold(0.0, f64::max)
    }

    /// Returns the difference to the node some steps away.
    fn at(&self, [i, j, k]: [isize; 3]) -> DVec4 {
        let n = 13 + i + 3 * (j + 3 * k);
        self.nodes[n.unsigned_abs()]
    }

    /// Returns the second difference of position and value along an index.
    pub(super) fn second(&self, axis: usize) -> DVec4 {
        let beside = |by: isize| {
            let mut steps = [0; 3];
            steps[axis] = by;
            self.at(steps)
        };
        beside(-1) + beside(1)
    }

    /// Returns the mixed part of position and value at the four corners between two indices: the quarter of the
    /// corner's difference less those along each index.
    pub(super) fn mixed(&self, [a, b]: [usize; 2]) -> [DVec4; 4] {
        [[-1, -1], [1, -1], [-1, 1], [1, 1]].map(|[s, t]| {
            let steps = |s: isize, t: isize| {
                let mut steps = [0; 3];
                steps[a] = s;
                steps[b] = t;
                self.at(steps)
            };
            (steps(s, t) - steps(s, 0) - steps(0, t)) * 0.25
        })
    }

    /// Returns the least and the greatest value of the nodes from which a kernel at a place takes values.
    ///
    /// - `reach`: reach of the kernel along each index.
    pub(super) fn range_near(&self, offsets: [Option<f64>; 3], reach: DVec3) -> [f64; 2] {
        let near = [0, 1, 2].map(|a| match offsets[a] {
            None => [true; 3],
            Some(s) => [s - reach[a] < 0.0, true, s + reach[a] > 0.0],
        });
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for (n, node) in self.nodes.iter().enumerate() {
            if near[0][n % 3] && near[1][n / 3 % 3] && near[2][n / 9] {
                range = [range[0].min(node.w), range[1].max(node.w)];
            }
        }
        range.map(|difference| self.own.1 + difference)
    }

    /// Returns position, value and derivatives at a place of the dual cell.
    pub(super) fn place(&self, offsets: [Option<f64>; 3]) -> Place {
        let [wi, wj, wk] = offsets.map(weights);
        // Contracted along one index after the other: value, first and second difference of each.
        let mut sums = [[[DVec4::ZERO; 3]; 3]; 3];
        for k in 0..3 {
            let mut of_plane = [[DVec4::ZERO; 3]; 3];
            for j in 0..3 {
                let row = &self.nodes[3 * (j + 3 * k)..][..3];
                let along_i = wi.map(|w| row[0] * w[0] + row[1] * w[1] + row[2] * w[2]);
                for (of_plane, w) in of_plane.iter_mut().zip(&wj) {
                    for (sum, x) in of_plane.iter_mut().zip(along_i) {
                        *sum += x * w[j];
                    }
                }
            }
            for (sums, w) in sums.iter_mut().zip(&wk) {
                for (sums, of_plane) in sums.iter_mut().zip(&of_plane) {
                    for (sum, x) in sums.iter_mut().zip(of_plane) {
                        *sum += *x * w[k];
                    }
                }
            }
        }
        let value = sums[0][0][0];
        let first = [sums[0][0][1], sums[0][1][0], sums[1][0][0]];
        Place {
            position: self.own.0 + value.xyz(),
            value: self.own.1 + value.w,
            jacobian: DMat3::from_cols(first[0].xyz(), first[1].xyz(), first[2].xyz()),
            slopes: DVec3::new(first[0].w, first[1].w, first[2].w),
            second: [sums[0][0][2], sums[0][2][0], sums[2][0][0]],
        }
    }
}

impl Place {
    /// Returns the gradient and the second derivatives along the indices that are not split; `None` if the
    /// columns of the Jacobian do not span space.
    pub(super) fn derivatives(&self) -> Option<(DVec3, DMat3)> {
        let [x, y, z] = [0, 1, 2].map(|a| self.jacobian.col(a));
        let lengths = x.length() * y.length() * z.length();
        // Phrased so that NaN counts as singular.
        let spans = self.jacobian.determinant().abs() > SPANNING * lengths;
        if !spans {
            return None;
        }
        let inverse = self.jacobian.inverse();
        let gradient = inverse.transpose() * self.slopes;
        let bends = self
            .second
            .map(|second| second.w - gradient.dot(second.xyz()));
        let along = DMat3::from_diagonal(DVec3::from(bends));
        Some((gradient, inverse.transpose() * along * inverse))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(field: impl Fn(DVec3) -> f64, place: impl Fn(DVec3) -> DVec3) -> Neighbourhood {
        let samples = Samples {
            dims: [3; 3],
            periods: [None; 3],
            at: |n: [usize; 3]| {
                let index = DVec3::from(n.map(|i| i as f64 - 1.0));
                Some((place(index), field(index)))
            },
        };
        Neighbourhood::new(&samples, [1; 3]).unwrap()
    }

    #[test]
    fn places_follow_the_interpolant_and_its_derivatives() {
        let place = |s: DVec3| DVec3::new(s.x + 0.2 * s.y, s.y * 2.0, s.z - 0.1 * s.x);
        // Trilinear within each cell, with a kink at the node.
        let field = |s: DVec3| 3.0 + s.x.max(0.0) * 2.0 - s.y * s.z + 0.5 * s.z;
        let cell = of(field, place);
        let at = DVec3::new(0.3, -0.4, 0.1);
        let all = cell.place([Some(at.x), Some(at.y), Some(at.z)]);
        assert!((all.position - place(at)).length() < 1e-14);
        assert!((all.value - field(at)).abs() < 1e-14);
        let (gradient, hessian) = all.derivatives().unwrap();
        let slopes = all.jacobian.transpose() * gradient;
        assert!(
            (slopes - DVec3::new(2.0, -0.1, 0.9)).length() < 1e-13,
            "{slopes}"
        );
        // Nothing is left to the prefilter along indices that are split.
        assert_eq!(hessian, DMat3::ZERO);
        let none = cell.place([None; 3]);
        let (_, hessian) = none.derivatives().unwrap();
        let along = none.jacobian.transpose() * hessian * none.jacobian;
        assert!((along.x_axis.x - 2.0).abs() < 1e-13, "{along}");
        assert!((none.value - 3.0).abs() < 1e-14);
    }

    #[test]
    fn ranges_hold_the_nodes_that_a_part_reaches() {
        let cell = of(|s| s.x, |s| s);
        let reach = DVec3::splat(0.2);
        let near = cell.range_near([Some(0.375), None, None], reach);
        assert_eq!(near, [0.0, 1.0]);
        let both = cell.range_near([Some(0.125), None, None], reach);
        assert_eq!(both, [-1.0, 1.0]);
    }
}
