//! Integrates with nested Clenshaw-Curtis rules of 3, 5 and 9 nodes, including the integrals up to each node.
//!
//! The light of a piece of a ray is the integral of emission attenuated by another integral, the optical depth.
//! Both use the same nodes: the depth up to a node is the integral of the polynomial through all nodes, to the
//! order of the rule (Clenshaw and Curtis 1960).

use std::sync::LazyLock;

/// A rule of N nodes over \[0, 1\].
#[derive(Debug)]
struct Rule<const N: usize> {
    /// Row i: the weights of the integral from 0 to node i.
    running: [[f64; N]; N],
}

/// Estimate of a piece by one rule.
#[derive(Debug, Clone, Copy)]
pub(super) struct Estimate {
    /// Light that leaves the piece: red, green, blue, and the light of a white piece. The last equals the
    /// opacity, as far as the rule is accurate.
    pub(super) light: [f64; 4],
    /// Optical depth of the piece.
    pub(super) depth: f64,
}

static RULES: LazyLock<(Rule<3>, Rule<5>, Rule<9>)> =
    LazyLock::new(|| (Rule::new(), Rule::new(), Rule::new()));

/// Nodes of the finest rule in \[0, 1\]; the others use every second and every fourth.
pub(super) static PLACES: LazyLock<[f64; 9]> = LazyLock::new(places);

fn places<const N: usize>() -> [f64; N] {
    std::array::from_fn(|i| {
        let angle = std::f64::consts::PI * i as f64 / (N - 1) as f64;
        0.5 - 0.5 * angle.cos()
    })
}

impl<const N: usize> Rule<N> {
    fn new() -> Self {
        // On [-1, 1], where powers are well conditioned.
        let x: [f64; N] = places().map(|s| 2.0 * s - 1.0);
        let mut running = [[0.0; N]; N];
        for j in 0..N {
            // Coefficients of Lagrange's polynomial for node j.
            let mut c = [0.0; N];
            c[0] = 1.0;
            for (_, &other) in x.iter().enumerate().filter(|(m, _)| *m != j) {
                let scale = 1.0 / (x[j] - other);
                for power in (0..N).rev() {
                    let lower = if power > 0 { c[power - 1] } else { 0.0 };
                    c[power] = (lower - other * c[power]) * scale;
                }
            }
            let integral = |to: f64| -> f64 {
                let term = |(k, c): (usize, &f64)| {
                    let power = k as i32 + 1;
                    c * (to.powi(power) - (-1.0_f64).powi(power)) / f64::from(power)
                };
                c.iter().enumerate().map(term).sum()
            };
            for (row, &to) in running.iter_mut().zip(&x) {
                row[j] = 0.5 * integral(to);
            }
        }
        Self { running }
    }

    /// Estimates a piece of length `length` from every `(9 - 1)/(N - 1)`th of the `values`: emission and
    /// extinction.
    fn estimate(&self, values: &[[f64; 4]; 9], length: f64) -> Estimate {
        let stride = 8 / (N - 1);
        let mut light = [0.0; 4];
        let mut depth = 0.0;
        for (i, row) in self.running.iter().enumerate() {
            let mut before = 0.0;
            for (j, weight) in row.iter().enumerate() {
                before += weight * values[j * stride][3];
            }
            depth = before * length;
            // Nothing lies before the first node.
            let through = if i == 0 { 1.0 } else { (-depth).exp() };
            let weight = self.running[N - 1][i] * length * through;
            for (sum, v) in light.iter_mut().zip(values[i * stride]) {
                *sum += weight * v;
            }
        }
        Estimate { light, depth }
    }
}

/// Estimates from every fourth value.
pub(super) fn of_3(values: &[[f64; 4]; 9], length: f64) -> Estimate {
    RULES.0.estimate(values, length)
}

/// Estimates from every second value.
pub(super) fn of_5(values: &[[f64; 4]; 9], length: f64) -> Estimate {
    RULES.1.estimate(values, length)
}

/// Estimates from all values.
pub(super) fn of_9(values: &[[f64; 4]; 9], length: f64) -> Estimate {
    RULES.2.estimate(values, length)
}

impl Estimate {
    /// Estimates the error, from the difference to a coarser rule and from the light of white, which should
    /// equal the opacity.
    pub(super) fn error(&self, coarser: &Self) -> f64 {
        let through = (-self.depth).exp();
        let mut error = (through - (-coarser.depth).exp()).abs();
        error = error.max((self.light[3] - (1.0 - through)).abs());
        for (a, b) in self.light.iter().zip(coarser.light) {
            error = error.max((a - b).abs());
        }
        error
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_within_a_linear_extinction_is_exact_to_the_order_of_the_rules() {
        // Extinction 2 s over [0, 1], white: opacity 1 - 1/e. Red is s: the integral of 2 s² e^(-s²) is
        // sqrt(pi)/2 erf(1) - 1/e.
        let values = PLACES.map(|s| [2.0 * s * s, 0.0, 0.0, 2.0 * s]);
        let red = 0.5 * std::f64::consts::PI.sqrt() * libm::erf(1.0) - (-1.0_f64).exp();
        let opacity = 1.0 - (-1.0_f64).exp();
        let [a, b, c] = [of_3, of_5, of_9].map(|rule| rule(&values, 1.0));
        for (estimate, bound) in [(a, 0.1), (b, 2e-3), (c, 1e-7)] {
            // Depths are of degree 2: exact.
            assert!((estimate.depth - 1.0).abs() < 1e-14, "{estimate:?}");
            assert!((estimate.light[0] - red).abs() < bound, "{estimate:?}");
            assert!((estimate.light[3] - opacity).abs() < bound, "{estimate:?}");
        }
        // The estimate bounds the error.
        assert!(c.error(&b) >= (c.light[0] - red).abs());
        assert!(b.error(&a) >= (b.light[0] - red).abs());
    }
}
