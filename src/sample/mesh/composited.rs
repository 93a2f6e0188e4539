//! Colours of surfels that viewers of splats composite, the nearer before the farther, instead of averaging.
//!
//! Seen along the normal, neighbouring splats have equal depths: which of them hides the other is chance. Splat j has at a
//! point the expected weight
//!
//! w_j = integral over u from 0 to 1 of alpha_j times the product over k other than j of (1 - u alpha_k),
//!
//! where u is the share of the other splats that lie in front of j. Colours are those for which the expected picture is
//! nearest to the surface's own colours (least squares over points of the surface, in sRGB codes, in which viewers
//! composite).

use glam::DVec3;

use super::surfels::Surfel;
use crate::error::Result;
use crate::math::narrowed;
use crate::parallel;
use crate::sample::points::neighbours::PointIndex;
use crate::sample::report::CompositedReport;
use crate::task::{Stage, Task};

/// Nodes and weights of Gauss's quadrature on 0 to 1: three points are exact to the fifth power of u, and few splats
/// overlap.
const NODES: [[f64; 2]; 3] = [
    [0.112_701_665_379_258_3, 5.0 / 18.0],
    [0.5, 8.0 / 18.0],
    [0.887_298_334_620_741_7, 5.0 / 18.0],
];

/// Distance in standard deviations at which viewers cut splats.
const CUT: f64 = 3.0;

/// Greatest opacity of a splat in most viewers.
const CEILING: f64 = 0.99;

/// Opacity below which most viewers do not draw a splat.
const FLOOR: f64 = 1.0 / 255.0;

/// Standard deviation across the plane, as a share of the longer tangent: surface farther off belongs to another layer.
const THICKNESS: f64 = 0.25;

/// Least cosine between normals, of either sign, for a splat to lie on a surface.
const LEAST_COSINE: f64 = 0.5;

/// Number of accelerated steps of descent. Five gave the PSNR of thirty within .01 dB on a cow and on a sphere.
const STEPS: usize = 6;

/// How surfels look if viewers composite them, over a surface.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Look {
    /// Area, and its integrals of opacity and of the squared error of codes (the mean of three channels).
    pub(super) area: f64,
    pub(super) opacity: f64,
    pub(super) squares: f64,
}

impl Look {
    pub(super) fn append(&mut self, other: Self) {
        self.area += other.area;
        self.opacity += other.opacity;
        self.squares += other.squares;
    }

    /// Returns means over the surface; `None` if no surface was composited.
    pub(super) fn report(&self) -> Option<CompositedReport> {
        (self.area > 0.0).then(|| CompositedReport {
            opacity: self.opacity / self.area,
            error: (self.squares / self.area).sqrt(),
        })
    }
}

/// The weight of a splat at a point of the surface.
#[derive(Debug, Clone, Copy)]
struct Weight {
    point: u32,
    weight: f32,
}

/// Sets the colours of surfels, so that compositing them shows those of `surface`: surfels that are spread evenly over the
/// same surface.
pub(super) fn solve(
    surfels: &mut [Surfel],
    surface: &[Surfel],
    task: Option<&Task>,
) -> Result<Look> {
    let stage = Stage::new(task, "solving colours", STEPS + 1);
    let is_point = |s: &&Surfel| s.is_seen();
    let points: Vec<&Surfel> = surface.iter().filter(is_point).collect();
    let centres: Vec<DVec3> = points.iter().map(|s| s.centre).collect();
    let Some(index) = PointIndex::new(&centres) else {
        return Ok(Look::default());
    };
    let normals: Vec<DVec3> = points.iter().map(|s| s.normal()).collect();
    let mut weights: Vec<Vec<Weight>> =
        parallel::map(surfels.len(), |j| opacities(&surfels[j], &normals, &index));
    expect(&mut weights, points.len());
    stage.check()?;
    stage.advance(1);

    let opacity = {
        let mut sums = vec![0.0; points.len()];
        for w in weights.iter().flatten() {
            sums[w.point as usize] += f64::from(w.weight);
        }
        sums
    };
    // What the splats leave uncovered shows what is behind, and is no error of theirs.
    let wanted: Vec<[f64; 3]> = points
        .iter()
        .zip(&opacity)
        .map(|(s, o)| s.codes().map(|c| c * o))
        .collect();
    let excess = |colours: &[[f64; 3]]| {
        let mut sums: Vec<[f64; 3]> = wanted.iter().map(|c| c.map(|c| -c)).collect();
        for (weights, colour) in weights.iter().zip(colours) {
            for w in weights {
                let sum = &mut sums[w.point as usize];
                for c in 0..3 {
                    sum[c] += f64::from(w.weight) * colour[c];
                }
            }
        }
        sums
    };
    let first: Vec<[f64; 3]> = surfels.iter().map(Surfel::codes).collect();
    let mut colours = first.clone();
    // The step of each colour is the inverse of its row's sum, which bounds the matrix.
    let area_weight = |w: &Weight| points[w.point as usize].area * f64::from(w.weight);
    let row = |j: usize| {
        let terms = weights[j]
            .iter()
            .map(|w| area_weight(w) * opacity[w.point as usize]);
        terms.sum::<f64>()
    };
    let rows: Vec<f64> = parallel::map(surfels.len(), row);
    // Nesterov's momentum.
    let (mut leading, mut momentum) = (colours.clone(), 1.0_f64);
    for _ in 0..STEPS {
        stage.check()?;
        let excess = excess(&leading);
        let step = |j: usize| {
            let mut slope = [0.0; 3];
            for w in &weights[j] {
                let weight = area_weight(w);
                for c in 0..3 {
                    slope[c] += weight * excess[w.point as usize][c];
                }
            }
            let moved = |c: usize| match rows[j] > 0.0 {
                true => leading[j][c] - slope[c] / rows[j],
                false => first[j][c],
            };
            std::array::from_fn(|c| moved(c).clamp(0.0, first[j][c].max(1.0)))
        };
        let stepped: Vec<[f64; 3]> = parallel::map(surfels.len(), step);
        let next = f64::midpoint(1.0, (1.0 + 4.0 * momentum * momentum).sqrt());
        let share = (momentum - 1.0) / next;
        leading = stepped
            .iter()
            .zip(&colours)
            .map(|(to, from)| std::array::from_fn(|c| to[c] + share * (to[c] - from[c])))
            .collect();
        (colours, momentum) = (stepped, next);
        stage.advance(1);
    }
    let mut look = Look::default();
    for ((point, opacity), excess) in points.iter().zip(&opacity).zip(excess(&colours)) {
        look.area += point.area;
        look.opacity += point.area * opacity;
        look.squares += point.area * excess.iter().map(|e| e * e).sum::<f64>() / 3.0;
    }
    for (surfel, colour) in surfels.iter_mut().zip(colours).filter(|(s, _)| s.is_seen()) {
        surfel.set_codes(colour);
    }
    Ok(look)
}

/// Returns a splat's opacity at the points that it reaches.
fn opacities(splat: &Surfel, normals: &[DVec3], index: &PointIndex<'_>) -> Vec<Weight> {
    let mut found = Vec::new();
    if !splat.is_seen() {
        return found;
    }
    let normal = splat.normal();
    let [a, b] = splat.tangents.map(|t| t / t.length_squared());
    let long = splat
        .tangents
        .map(DVec3::length)
        .into_iter()
        .fold(0.0, f64::max);
    let across = normal / (THICKNESS * long);
    // As `splat_cloud` has it: cells of which less than half is there are translucent.
    let peak = (2.0 * splat.share).min(1.0);
    index.for_each_within(splat.centre, CUT * long, |i, offset| {
        // The tangents are orthogonal.
        let q = [a, b, across]
            .map(|axis| axis.dot(offset).powi(2))
            .into_iter()
            .sum::<f64>();
        let alpha = (peak * (-0.5 * q).exp()).min(CEILING);
        let is_on = normals[i as usize].dot(normal).abs() > LEAST_COSINE;
        if q < CUT * CUT && is_on && alpha > FLOOR {
            found.push(Weight {
                point: i,
                weight: narrowed(alpha),
            });
        }
    });
    found
}

/// Replaces opacities by expected weights.
fn expect(opacities: &mut [Vec<Weight>], points: usize) {
    let mut passing = vec![[0.0_f64; 3]; points];
    for w in opacities.iter().flatten() {
        for (sum, [u, _]) in passing[w.point as usize].iter_mut().zip(NODES) {
            *sum += (-u * f64::from(w.weight)).ln_1p();
        }
    }
    parallel::chunks(opacities, 1024, |_, chunk| {
        for w in chunk.iter_mut().flatten() {
            let alpha = f64::from(w.weight);
            let others = |k: usize| {
                let [u, _] = NODES[k];
                (passing[w.point as usize][k] - (-u * alpha).ln_1p()).exp()
            };
            let sum: f64 = (0..3).map(|k| NODES[k][1] * others(k)).sum();
            w.weight = narrowed(alpha * sum);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn splat(x: f64, colour: f64) -> Surfel {
        Surfel {
            centre: DVec3::X * x,
            tangents: [DVec3::X * 0.5, DVec3::Y * 0.5],
            area: 1.0,
            colour: [colour; 3],
            share: 1.0,
            unpainted: 0.0,
            reflecting: DVec3::ZERO,
        }
    }

    /// The weight of a splat is its mean over all orders of compositing.
    #[test]
    fn weights_are_means_over_all_orders() {
        let alphas = [0.9_f32, 0.6, 0.3, 0.15];
        let mut lists: Vec<Vec<Weight>> = alphas
            .iter()
            .map(|&weight| vec![Weight { point: 0, weight }])
            .collect();
        expect(&mut lists, 1);
        // Enumerates permutations by Heap's algorithm.
        let mut order = [0, 1, 2, 3];
        let mut sums = [0.0; 4];
        let mut count = 0.0;
        let mut counters = [0; 4];
        let mut i = 1;
        loop {
            let mut passed = 1.0;
            for &j in &order {
                sums[j] += passed * f64::from(alphas[j]);
                passed *= 1.0 - f64::from(alphas[j]);
            }
            count += 1.0;
            while i < 4 && counters[i] >= i {
                counters[i] = 0;
                i += 1;
            }
            if i == 4 {
                break;
            }
            order.swap(if i % 2 == 0 { 0 } else { counters[i] }, i);
            counters[i] += 1;
            i = 1;
        }
        assert!((count - 24.0_f64).abs() < 1e-9);
        for (list, sum) in lists.iter().zip(sums) {
            let got = f64::from(list[0].weight);
            // Single precision; the quadrature is exact for products of three.
            assert!((got - sum / count).abs() < 1e-6, "{got} {}", sum / count);
        }
    }

    /// A stripe keeps its contrast, of which compositing loses a part; a surface of one colour stays as it is.
    #[test]
    fn a_stripe_keeps_its_contrast() {
        let row = |of: &dyn Fn(i32) -> f64| -> Vec<Surfel> {
            (-8..8).map(|i| splat(f64::from(i), of(i))).collect()
        };
        let surface = row(&|i| if i == 0 { 0.6 } else { 0.2 });
        let mut surfels = surface.clone();
        let look = solve(&mut surfels, &surface, None).unwrap();
        assert!(surfels[8].colour[0] > 0.62, "{}", surfels[8].colour[0]);
        assert!(look.squares / look.area < 1e-4, "{look:?}");
        assert!(
            look.opacity / look.area > 0.98,
            "splats are opaque at their middles"
        );
        let surface = row(&|_| 0.4);
        let mut surfels = surface.clone();
        solve(&mut surfels, &surface, None).unwrap();
        for s in &surfels {
            assert!((s.colour[0] - 0.4).abs() < 1e-4, "{}", s.colour[0]);
        }
    }
}
