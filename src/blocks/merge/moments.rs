//! Computes moments of mixtures of Gaussians, up to the fourth.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// A symmetric matrix: xx, xy, xz, yy, yz, zz.
pub(super) type Symmetric = [f64; 6];

/// Index of the element of two axes in a [`Symmetric`].
const PAIR: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

/// Central moments of a mixture of Gaussians, as sums of products of positions and variances. [`Moments::tensors`]
/// combines them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    /// Sums of d dᵀ and of V.
    places: Symmetric,
    variances: Symmetric,
    /// Sums of the products of d in the order of [`THIRD`], and of d V.
    third: [f64; 10],
    third_mixed: [Symmetric; 3],
    /// Sums of the products of d in the order of [`FOURTH`], of d dᵀ V and of V V.
    fourth: [f64; 15],
    fourth_mixed: [Symmetric; 6],
    fourth_own: [Symmetric; 6],
}

/// Axes of the distinct elements of a symmetric tensor of third order, and the number of elements equal to each.
const THIRD: [([usize; 3], f64); 10] = [
    ([0, 0, 0], 1.0),
    ([1, 1, 1], 1.0),
    ([2, 2, 2], 1.0),
    ([0, 0, 1], 3.0),
    ([0, 0, 2], 3.0),
    ([1, 1, 0], 3.0),
    ([1, 1, 2], 3.0),
    ([2, 2, 0], 3.0),
    ([2, 2, 1], 3.0),
    ([0, 1, 2], 6.0),
];

/// Axes of the distinct elements of a symmetric tensor of fourth order, and the number of elements equal to each.
const FOURTH: [([usize; 4], f64); 15] = [
    ([0, 0, 0, 0], 1.0),
    ([1, 1, 1, 1], 1.0),
    ([2, 2, 2, 2], 1.0),
    ([0, 0, 0, 1], 4.0),
    ([0, 0, 0, 2], 4.0),
    ([1, 1, 1, 0], 4.0),
    ([1, 1, 1, 2], 4.0),
    ([2, 2, 2, 0], 4.0),
    ([2, 2, 2, 1], 4.0),
    ([0, 0, 1, 1], 6.0),
    ([0, 0, 2, 2], 6.0),
    ([1, 1, 2, 2], 6.0),
    ([0, 0, 1, 2], 12.0),
    ([1, 1, 0, 2], 12.0),
    ([2, 2, 0, 1], 12.0),
];

impl Moments {
    /// Adds a kernel of variance `own` at `d` from the centre, with weight `w`.
    pub(super) fn add(&mut self, w: f64, d: DVec3, own: &Symmetric) {
        let d = d.to_array();
        let outer = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(a, b)| d[a] * d[b]);
        let add = |sums: &mut Symmetric, factor: f64, of: &Symmetric| {
            for (sum, x) in sums.iter_mut().zip(of) {
                *sum += factor * x;
            }
        };
        add(&mut self.places, w, &outer);
        add(&mut self.variances, w, own);
        for (sum, ([a, b, c], _)) in self.third.iter_mut().zip(THIRD) {
            *sum += w * d[a] * outer[PAIR[b][c]];
        }
        for (sums, d) in self.third_mixed.iter_mut().zip(d) {
            add(sums, w * d, own);
        }
        for (sum, ([a, b, c, e], _)) in self.fourth.iter_mut().zip(FOURTH) {
            *sum += w * outer[PAIR[a][b]] * outer[PAIR[c][e]];
        }
        for (i, (mixed, both)) in self
            .fourth_mixed
            .iter_mut()
            .zip(&mut self.fourth_own)
            .enumerate()
        {
            add(mixed, w * outer[i], own);
            add(both, w * own[i], own);
        }
    }

    /// Adds the third central moments of a cut kernel: the third power of a vector.
    pub(super) fn add_skew(&mut self, w: f64, skew: DVec3) {
        for (sum, ([a, b, c], _)) in self.third.iter_mut().zip(THIRD) {
            *sum += w * skew[a] * skew[b] * skew[c];
        }
    }

    /// The variance.
    fn second(&self) -> Symmetric {
        let mut second = self.places;
        for (sum, v) in second.iter_mut().zip(self.variances) {
            *sum += v;
        }
        second
    }

    /// Combines the sums into tensors.
    pub(super) fn tensors(&self) -> Tensors {
        let second = self.second();
        let mixed = |a: usize, b: usize, c: usize| self.third_mixed[a][PAIR[b][c]];
        let third = std::array::from_fn(|n| {
            let ([a, b, c], _) = THIRD[n];
            self.third[n] + mixed(a, b, c) + mixed(b, a, c) + mixed(c, a, b)
        });
        let fourth = std::array::from_fn(|n| {
            let (axes, _) = FOURTH[n];
            let mixed = pairs(axes, |i, j| self.fourth_mixed[i][j])
                + pairs(axes, |i, j| self.fourth_mixed[j][i]);
            self.fourth[n] + mixed + pairs(axes, |i, j| self.fourth_own[i][j])
        });
        Tensors {
            second,
            third,
            fourth,
        }
    }
}

/// Central moments of second to fourth order, of total weight 1.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Tensors {
    pub(super) second: Symmetric,
    /// The elements of [`THIRD`].
    third: [f64; 10],
    /// The elements of [`FOURTH`].
    fourth: [f64; 15],
}

impl Tensors {
    /// Adds the moments of a part whose mean lies at `d` from the centre, with weight `w`: moments about another point,
    /// by the binomial theorem.
    pub(super) fn add(&mut self, w: f64, d: DVec3, part: &Self) {
        let d = d.to_array();
        let outer = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(a, b)| d[a] * d[b]);
        let variance = |a: usize, b: usize| part.second[PAIR[a][b]];
        let third = |a: usize, b: usize, c: usize| part.third[third_place(a, b, c)];
        for (sum, (own, place)) in self.second.iter_mut().zip(part.second.iter().zip(outer)) {
            *sum += w * (own + place);
        }
        for ((sum, own), ([a, b, c], _)) in self.third.iter_mut().zip(part.third).zip(THIRD) {
            let mixed = d[a] * variance(b, c) + d[b] * variance(a, c) + d[c] * variance(a, b);
            *sum += w * (own + mixed + d[a] * outer[PAIR[b][c]]);
        }
        for ((sum, own), (axes, _)) in self.fourth.iter_mut().zip(part.fourth).zip(FOURTH) {
            let [a, b, c, e] = axes;
            let skewed = d[a] * third(b, c, e)
                + d[b] * third(a, c, e)
                + d[c] * third(a, b, e)
                + d[e] * third(a, b, c);
            let mixed = pairs(axes, |i, j| outer[i] * part.second[j])
                + pairs(axes, |i, j| part.second[i] * outer[j]);
            let places = outer[PAIR[a][b]] * outer[PAIR[c][e]];
            *sum += w * (own + skewed + mixed + places);
        }
    }

    /// Frobenius norm of the third moments.
    pub(super) fn third_norm(&self) -> f64 {
        let squares = self.third.iter().zip(THIRD).map(|(m, (_, n))| n * m * m);
        squares.sum::<f64>().sqrt()
    }

    /// Frobenius norm of the fourth cumulants: the difference between the fourth moments and a Gaussian's.
    pub(super) fn fourth_cumulant_norm(&self) -> f64 {
        let squares = self.fourth.iter().zip(FOURTH).map(|(moment, (axes, n))| {
            let gaussian = pairs(axes, |i, j| self.second[i] * self.second[j]);
            n * (moment - gaussian).powi(2)
        });
        squares.sum::<f64>().sqrt()
    }
}

/// Index of the element of three axes in [`THIRD`].
fn third_place(a: usize, b: usize, c: usize) -> usize {
    let times = |axis: usize| [a, b, c].iter().filter(|&&own| own == axis).count();
    match [times(0), times(1), times(2)] {
        [3, 0, 0] => 0,
        [0, 3, 0] => 1,
        [0, 0, 3] => 2,
        [2, 1, 0] => 3,
        [2, 0, 1] => 4,
        [1, 2, 0] => 5,
        [0, 2, 1] => 6,
        [1, 0, 2] => 7,
        [0, 1, 2] => 8,
        _ => 9,
    }
}

/// Returns the sum of `of` over the three ways to pair four axes. For products of variances it is the fourth moment of
/// a Gaussian.
fn pairs([a, b, c, e]: [usize; 4], of: impl Fn(usize, usize) -> f64) -> f64 {
    of(PAIR[a][b], PAIR[c][e]) + of(PAIR[a][c], PAIR[b][e]) + of(PAIR[a][e], PAIR[b][c])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a pseudo-random number from -1 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract()
    }

    #[test]
    fn moments_are_those_of_a_mixture() {
        let mut moments = Moments::default();
        let members: Vec<(f64, DVec3, DVec3)> = (0..9)
            .map(|n| {
                let at = |k: usize| number(7 * n + k);
                let d = DVec3::new(at(0), at(1), at(2));
                let v = DVec3::new(at(3).abs(), at(4).abs(), at(5).abs());
                (1.0 / 9.0, d, v)
            })
            .collect();
        let mean: DVec3 = members.iter().map(|(w, d, _)| *d * *w).sum();
        for (w, d, v) in &members {
            moments.add(*w, *d - mean, &[v.x, 0.0, 0.0, v.y, 0.0, v.z]);
        }
        // By Gauss-Hermite quadrature with three points per axis: exact to the fifth power.
        let root = 3.0_f64.sqrt();
        let rule = [(-root, 1.0 / 6.0), (0.0, 2.0 / 3.0), (root, 1.0 / 6.0)];
        let expect = |of: &dyn Fn(DVec3) -> f64| {
            let mut sum = 0.0;
            for (w, d, v) in &members {
                for (x, wx) in rule {
                    for (y, wy) in rule {
                        for (z, wz) in rule {
                            let spread = DVec3::new(v.x.sqrt() * x, v.y.sqrt() * y, v.z.sqrt() * z);
                            sum += w * wx * wy * wz * of(*d - mean + spread);
                        }
                    }
                }
            }
            sum
        };
        let tensors = moments.tensors();
        let second = tensors.second;
        for a in 0..3 {
            for b in a..3 {
                let expected = expect(&|p| p[a] * p[b]);
                assert!((second[PAIR[a][b]] - expected).abs() < 1e-14);
            }
        }
        let third: f64 = THIRD
            .iter()
            .map(|([a, b, c], n)| n * expect(&|p| p[*a] * p[*b] * p[*c]).powi(2))
            .sum();
        // Some hundred roundings of f64.
        assert!((tensors.third_norm() - third.sqrt()).abs() < 1e-13);
        let fourth: f64 = FOURTH
            .iter()
            .map(|(axes, n)| {
                let [a, b, c, e] = *axes;
                let moment = expect(&|p| p[a] * p[b] * p[c] * p[e]);
                n * (moment - pairs(*axes, |i, j| second[i] * second[j])).powi(2)
            })
            .sum();
        assert!((tensors.fourth_cumulant_norm() - fourth.sqrt()).abs() < 1e-13);
        assert!(third.sqrt() > 0.01 && fourth.sqrt() > 0.01);
    }
    /// Compares nested parts of unequal shares, about their own means, with the whole at once.
    #[test]
    fn moments_of_parts_are_those_of_the_whole() {
        let at = |n: usize| DVec3::new(number(9 * n), number(9 * n + 1), 3.0 * number(9 * n + 2));
        let weight = |n: usize| number(9 * n + 3).abs() + 0.01;
        let own = |n: usize| {
            let v = |k: usize| number(9 * n + k).abs();
            // Variance of a triangular factor: xx, xy, xz, yy, yz, zz.
            let (a, b, c) = (v(4), v(5), v(6));
            [a * a, a * b, 0.0, b * b + c * c, c * 0.3, 0.09]
        };
        let of = |members: &[usize], skew: f64| {
            let total: f64 = members.iter().map(|&n| weight(n)).sum();
            let centre: DVec3 = members.iter().map(|&n| at(n) * weight(n) / total).sum();
            let mut moments = Moments::default();
            for &n in members {
                moments.add(weight(n) / total, at(n) - centre, &own(n));
                moments.add_skew(weight(n) / total, at(n + 7) * skew);
            }
            (total, centre, moments.tensors())
        };
        let joined = |parts: &[(f64, DVec3, Tensors)]| {
            let total: f64 = parts.iter().map(|(w, ..)| w).sum();
            let centre: DVec3 = parts.iter().map(|(w, c, _)| *c * *w / total).sum();
            let mut tensors = Tensors::default();
            for (w, c, part) in parts {
                tensors.add(w / total, *c - centre, part);
            }
            (total, centre, tensors)
        };
        let all: Vec<usize> = (0..40).collect();
        for skew in [0.0, 0.5] {
            let (_, whole_centre, whole) = of(&all, skew);
            let first = joined(&[of(&all[..3], skew), of(&all[3..17], skew)]);
            let (_, centre, sum) = joined(&[first, of(&all[17..18], skew), of(&all[18..], skew)]);
            assert!((centre - whole_centre).length() < 1e-14);
            let gap = |a: &[f64], b: &[f64]| {
                let gaps = a.iter().zip(b).map(|(a, b)| (a - b).abs());
                gaps.fold(0.0, f64::max)
            };
            // Some hundred roundings of f64.
            assert!(gap(&sum.second, &whole.second) < 1e-13);
            assert!(gap(&sum.third, &whole.third) < 1e-13);
            // Sums over members leave out the contribution of a kernel's own skew to the fourth moments.
            if skew <= 0.0 {
                assert!(gap(&sum.fourth, &whole.fourth) < 1e-12);
                assert!(whole.fourth.iter().all(|m| m.abs() > 1e-3));
            }
        }
    }
}
