//! Implements the Gauss-Kronrod rule of 7 and 15 points (Kronrod 1965; nodes and error estimate as in
//! QUADPACK's QK15, Piessens et al. 1983).

/// An integral and its estimated error, the greatest of the components.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadrature<const N: usize> {
    pub(super) value: [f64; N],
    pub(super) error: f64,
}

/// Nodes in (0, 1], from the outermost inwards; those at odd indices are Gauss's.
const NODES: [f64; 7] = [
    0.991_455_371_120_812_6,
    0.949_107_912_342_758_5,
    0.864_864_423_359_769_1,
    0.741_531_185_599_394_4,
    0.586_087_235_467_691_1,
    0.405_845_151_377_397_2,
    0.207_784_955_007_898_47,
];
const KRONROD: [f64; 7] = [
    0.022_935_322_010_529_224,
    0.063_092_092_629_978_56,
    0.104_790_010_322_250_18,
    0.140_653_259_715_525_92,
    0.169_004_726_639_267_9,
    0.190_350_578_064_785_4,
    0.204_432_940_075_298_9,
];
const KRONROD_MIDDLE: f64 = 0.209_482_141_084_727_82;
const GAUSS: [f64; 3] = [
    0.129_484_966_168_869_7,
    0.279_705_391_489_276_64,
    0.381_830_050_505_118_9,
];
const GAUSS_MIDDLE: f64 = 0.417_959_183_673_469_4;

/// Returns the 15 places at which to evaluate an integrand over [a, b]: the middle, then pairs.
#[inline(always)]
pub(super) fn nodes(a: f64, b: f64) -> [f64; 15] {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    let mut places = [middle; 15];
    for (i, x) in NODES.iter().enumerate() {
        places[2 * i + 1] = middle - half * x;
        places[2 * i + 2] = middle + half * x;
    }
    places
}

/// Returns the integral over [a, b] from the integrand's values at [`nodes`].
pub(super) fn kronrod<const N: usize>(values: &[[f64; N]; 15], a: f64, b: f64) -> Quadrature<N> {
    let half = 0.5 * (b - a);
    let centre = values[0];
    let mut out = Quadrature {
        value: [0.0; N],
        error: 0.0,
    };
    for n in 0..N {
        let pairs = [0, 1, 2, 3, 4, 5, 6].map(|i| [values[2 * i + 1][n], values[2 * i + 2][n]]);
        let mut fine = KRONROD_MIDDLE * centre[n];
        let mut coarse = GAUSS_MIDDLE * centre[n];
        for (i, [left, right]) in pairs.iter().enumerate() {
            let sum = left + right;
            fine += KRONROD[i] * sum;
            if i % 2 == 1 {
                coarse += GAUSS[i / 2] * sum;
            }
        }
        // Mean deviation of the integrand from its mean: the scale for the difference of the rules.
        let mean = 0.5 * fine;
        let mut spread = KRONROD_MIDDLE * (centre[n] - mean).abs();
        for (w, [left, right]) in KRONROD.iter().zip(&pairs) {
            spread += w * ((left - mean).abs() + (right - mean).abs());
        }
        let difference = (fine - coarse).abs();
        let error = if spread > 0.0 {
            spread * (200.0 * difference / spread).powf(1.5).min(1.0)
        } else {
            difference
        };
        out.value[n] = fine * half;
        out.error = out.error.max(error * half.abs());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_of_degree_22_are_exact_and_estimates_bound_errors() {
        // The 15-point rule is exact to degree 22 (3 n + 1 for n = 7).
        for degree in 0..=22 {
            let rule = kronrod(&nodes(0.0, 1.0).map(|x| [x.powi(degree)]), 0.0, 1.0);
            let truth = 1.0 / (f64::from(degree) + 1.0);
            assert!((rule.value[0] - truth).abs() < 1e-14, "{degree}");
        }
        for width in [0.5, 2.0, 8.0, 20.0] {
            let values = nodes(0.0, width).map(|x| [(-0.5 * x * x).exp()]);
            let rule = kronrod(&values, 0.0, width);
            let truth = (std::f64::consts::PI / 2.0).sqrt() * libm::erf(width / 2f64.sqrt());
            // 1e-15 for rounding.
            assert!(
                (rule.value[0] - truth).abs() <= rule.error + 1e-15,
                "{width}"
            );
        }
    }
}
