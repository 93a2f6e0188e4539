//! The volume rendering integral along one ray.

use super::gauss_kronrod::{Quadrature, kronrod};
use super::kernel::Segment;
use crate::math::normal_density_and_cdf;

/// What a ray brings to the eye.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayIntegral {
    /// Red, green, blue, premultiplied, and opacity.
    pub rgba: [f64; 4],
    /// Estimated error of red, green and blue; the opacity is exact to rounding.
    pub error: f64,
}

/// Kernels that overlap at some place of the ray, as arrays.
#[derive(Debug, Default)]
struct Active {
    mean: Vec<f64>,
    inverse_sigma: Vec<f64>,
    tau: Vec<f64>,
    colour: [Vec<f64>; 3],
    end: Vec<f64>,
}

/// Memory that rays share.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub(super) segments: Vec<Segment>,
    sheets: Vec<Segment>,
    /// Where kernels begin to matter, and which.
    starts: Vec<(f64, usize)>,
    /// Places to divide the ray at, with the standard deviation of the kernel they belong to.
    events: Vec<(f64, f64)>,
    /// Where it is divided.
    cuts: Vec<f64>,
    active: Active,
}

/// Standard deviations from a kernel's mean at which the ray is divided.
const EVENTS: [f64; 7] = [-7.0, -3.0, -1.0, 0.0, 1.0, 3.0, 7.0];

/// Events closer together than this many standard deviations are one. A Gauss-Kronrod rule over
/// two standard deviations has errors of 1e-9 and less, and bisects where it has more; at a half
/// there are four times the evaluations for nothing.
const MERGE: f64 = 2.0;

/// Bisections of one interval: what 2^-40 of it leaves unresolved is a rounding error.
const DEEPEST: u32 = 40;

/// Integrates eq. 3 of Zwicker et al. 2001 over the kernels in `scratch.segments`, from the eye:
///
/// I = ∫ Σ c_k κ_k(t) T(t) dt, T(t) = exp(-Σ tau_k [Phi((t - mu_k)/s_k) - Phi((0 - mu_k)/s_k)]).
///
/// Extinctions of kernels that overlap add up; nothing is sorted. T is exact, the integral is by
/// adaptive Gauss-Kronrod quadrature between the kernels' own places, to about `error`. Sheets
/// (kernels without extent along the ray) are steps of T.
pub(super) fn integrate(scratch: &mut Scratch, error: f64) -> RayIntegral {
    let Scratch {
        segments,
        sheets,
        starts,
        events,
        cuts,
        active,
    } = scratch;
    let count = segments.len().max(1) as f64;
    // A kernel's tails beyond this depth change nothing that is asked for.
    let least_depth = error * 1e-3 / count;
    sheets.clear();
    starts.clear();
    events.clear();
    active.clear();

    let mut total_depth = 0.0;
    // Optical depth that lies behind the eye.
    let mut behind = 0.0;
    let mut far_end = 0.0_f64;
    for (i, s) in segments.iter().enumerate() {
        if s.sigma <= SHEET * s.mean.abs() {
            if s.mean > 0.0 {
                sheets.push(*s);
                events.push((s.mean, 0.0));
                total_depth += s.tau;
                far_end = far_end.max(s.mean);
            }
            continue;
        }
        let share_behind = normal_density_and_cdf(-s.mean / s.sigma).1;
        total_depth += s.tau * (1.0 - share_behind);
        if s.tau <= least_depth {
            continue;
        }
        let reach = (2.0 * (s.tau / least_depth).ln()).sqrt().min(LONGEST_REACH) * s.sigma;
        behind += s.tau * share_behind;
        starts.push((s.mean - reach, i));
        far_end = far_end.max(s.mean + reach);
        for e in EVENTS {
            let t = s.mean + e * s.sigma;
            if t > 0.0 && t < s.mean + reach {
                events.push((t, s.sigma));
            }
        }
        events.push((s.mean + reach, s.sigma));
    }
    let opacity = -(-total_depth).exp_m1();
    let mut out = RayIntegral {
        rgba: [0.0, 0.0, 0.0, opacity],
        error: 0.0,
    };
    starts.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    events.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    sheets.sort_unstable_by(|a, b| a.mean.total_cmp(&b.mean));

    let mut from = starts.first().map_or(0.0, |s| s.0.max(0.0));
    cuts.clear();
    cuts.push(from);
    for &(t, sigma) in events.iter() {
        let last = cuts[cuts.len() - 1];
        if sigma == 0.0 || t - last >= MERGE * sigma || t >= far_end {
            cuts.push(t.max(last));
        }
    }

    let mut starting = starts.iter().peekable();
    let mut sheet = sheets.iter().peekable();
    // Depth of the kernels that end before `from`.
    let mut passed = -behind;
    let mut transmittance = 1.0;
    for &t in cuts.iter() {
        if t > from {
            while let Some((_, i)) = starting.next_if(|s| s.0 < t) {
                active.push(&segments[*i]);
            }
            passed += active.retire(from);
            if !active.is_empty() {
                let end = (-passed - active.depth(t)).exp();
                let share = (transmittance - end).max(1.0 / cuts.len() as f64);
                let ends = [transmittance, end];
                let integral = interval(active, passed, [from, t], ends, 0.5 * error * share);
                for (c, v) in out.rgba.iter_mut().zip(integral.value) {
                    *c += v;
                }
                out.error += integral.error;
                transmittance = end;
            }
            from = t;
        }
        while let Some(s) = sheet.next_if(|s| s.mean <= t) {
            // Sheets in one place are one sheet of mixed colour.
            let mut tau = s.tau;
            let mut light = s.colour.map(|c| c * s.tau);
            while let Some(o) = sheet.next_if(|o| o.mean == s.mean) {
                tau += o.tau;
                for (l, c) in light.iter_mut().zip(o.colour) {
                    *l += c * o.tau;
                }
            }
            let alpha = -(-tau).exp_m1();
            for (c, l) in out.rgba.iter_mut().zip(light) {
                *c += transmittance * alpha * l / tau;
            }
            passed += tau;
            transmittance *= 1.0 - alpha;
        }
        if transmittance < 1e-3 * error {
            out.error += transmittance;
            break;
        }
    }
    out
}

/// A kernel thinner than this share of its distance is a sheet: f64 cannot step through it.
const SHEET: f64 = 1e-12;

/// Standard deviations beyond which the normal distribution is constant in f64.
const LONGEST_REACH: f64 = 8.5;

impl Active {
    fn clear(&mut self) {
        for v in self.arrays() {
            v.clear();
        }
    }

    fn arrays(&mut self) -> [&mut Vec<f64>; 7] {
        let [r, g, b] = &mut self.colour;
        [
            &mut self.mean,
            &mut self.inverse_sigma,
            &mut self.tau,
            &mut self.end,
            r,
            g,
            b,
        ]
    }

    fn is_empty(&self) -> bool {
        self.mean.is_empty()
    }

    fn push(&mut self, s: &Segment) {
        self.mean.push(s.mean);
        self.inverse_sigma.push(1.0 / s.sigma);
        self.tau.push(s.tau);
        self.end.push(s.mean + LONGEST_REACH * s.sigma);
        for (channel, c) in self.colour.iter_mut().zip(s.colour) {
            channel.push(c);
        }
    }

    /// Takes out the kernels that end before `t` and returns their depth.
    fn retire(&mut self, t: f64) -> f64 {
        let mut depth = 0.0;
        for i in (0..self.mean.len()).rev() {
            if self.end[i] <= t {
                depth += self.tau[i];
                for v in self.arrays() {
                    v.swap_remove(i);
                }
            }
        }
        depth
    }

    /// Optical depth of all up to `t`.
    fn depth(&self, t: f64) -> f64 {
        let mut depth = 0.0;
        for ((&mean, &inverse), &tau) in self.mean.iter().zip(&self.inverse_sigma).zip(&self.tau) {
            depth += tau * normal_density_and_cdf((t - mean) * inverse).1;
        }
        depth
    }

    /// Red, green, blue and extinction at `t`, attenuated by all that lies before.
    fn attenuated(&self, passed: f64, t: f64) -> [f64; 4] {
        let n = self.mean.len();
        let [red, green, blue] = self.colour.each_ref().map(|c| &c[..n]);
        let (mean, inverse, tau) = (&self.mean[..n], &self.inverse_sigma[..n], &self.tau[..n]);
        let (mut depth, mut sums) = (0.0, [0.0; 4]);
        for i in 0..n {
            let (density, cdf) = normal_density_and_cdf((t - mean[i]) * inverse[i]);
            depth += tau[i] * cdf;
            let extinction = tau[i] * inverse[i] * density;
            sums[0] += extinction * red[i];
            sums[1] += extinction * green[i];
            sums[2] += extinction * blue[i];
            sums[3] += extinction;
        }
        let transmittance = (-passed - depth).exp();
        sums.map(|s| s * transmittance)
    }
}

/// The integral over one interval whose ends' transmittances are known: of the extinction it is
/// exactly their difference, which says how well the quadrature does on the colours, too.
fn interval(
    active: &Active,
    passed: f64,
    [a, b]: [f64; 2],
    [before, after]: [f64; 2],
    tolerance: f64,
) -> Quadrature<3> {
    let mut out = Quadrature {
        value: [0.0; 3],
        error: 0.0,
    };
    let mut stack = vec![(a, b, before, after, tolerance, 0)];
    while let Some((a, b, before, after, tolerance, depth)) = stack.pop() {
        let rule = kronrod(|t| active.attenuated(passed, t), a, b);
        let error = rule.error.max((rule.value[3] - (before - after)).abs());
        let middle = 0.5 * (a + b);
        // Below its rounding the difference says nothing.
        let rounding = 4.0 * f64::EPSILON * (1.0 + passed.abs()) * before;
        if error <= tolerance.max(rounding) || depth == DEEPEST || !(a < middle && middle < b) {
            for (sum, v) in out.value.iter_mut().zip(rule.value) {
                *sum += v;
            }
            out.error += error;
        } else {
            let between = (-passed - active.depth(middle)).exp();
            let tolerance = 0.5 * tolerance;
            stack.push((middle, b, between, after, tolerance, depth + 1));
            stack.push((a, middle, before, between, tolerance, depth + 1));
        }
    }
    out
}
