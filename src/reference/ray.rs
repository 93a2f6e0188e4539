//! Computes the volume rendering integral along one ray.

use super::gauss_kronrod::{Quadrature, kronrod, nodes};
use super::kernel::Segment;
use super::surface::{Fragment, Surface, surfaces};
use crate::math::normal_density_and_cdf;

/// Light along a ray, as seen by the eye.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayIntegral {
    /// Red, green, blue, premultiplied, and opacity.
    pub rgba: [f64; 4],
    /// Estimated error of red, green and blue. The opacity of kernels is exact to rounding; that of a field is
    /// as accurate as the colours.
    pub error: f64,
}

/// Kernels that overlap at a place of the ray.
#[derive(Debug, Default)]
struct Active {
    segments: Vec<Segment>,
    /// The same as arrays, padded with kernels of zero depth.
    lanes: Vec<Lanes>,
}

/// Kernels side by side: sums over them are [`LANES`] sums, which the compiler may vectorise.
#[derive(Debug, Clone, Copy, Default)]
struct Lanes {
    mean: [f64; LANES],
    /// Start and end of each kernel's domain.
    domain: [[f64; LANES]; 2],
    /// Share of each kernel before its domain.
    before: [f64; LANES],
    inverse_sigma: [f64; LANES],
    tau: [f64; LANES],
    colour: [[f64; LANES]; 3],
}

const LANES: usize = 8;

/// Buffers that rays reuse.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub(super) segments: Vec<Segment>,
    pub(super) fragments: Vec<Fragment>,
    surfaces: Vec<Surface>,
    sheets: Vec<Segment>,
    /// Parameters from which kernels matter, with their indices.
    starts: Vec<(f64, usize)>,
    /// Places at which to divide the ray, with the standard deviation of the kernel they belong to.
    events: Vec<(f64, f64)>,
    /// Places at which the ray is divided.
    cuts: Vec<f64>,
    active: Active,
}

/// Distances from a kernel's mean, in standard deviations, at which the ray is divided.
const EVENTS: [f64; 7] = [-7.0, -3.0, -1.0, 0.0, 1.0, 3.0, 7.0];

/// Events closer together than this many standard deviations are merged. A Gauss-Kronrod rule over two standard
/// deviations has errors of at most 1e-9, and bisects otherwise. Merging below half a deviation would cost four
/// times the evaluations for nothing.
const MERGE: f64 = 3.0;

/// Greatest number of bisections of one interval, so that no scene can hang the program: a kernel needs some
/// ten.
const MOST_BISECTIONS: u32 = 10_000;

/// Returns the light of the kernels in `scratch.segments` and the opaque surfels in `scratch.fragments`, up to
/// `end`, which may be infinite.
///
/// Each surface ends the share of the ray that it covers: light is integrated up to its depth, and its colour
/// is the background. The rest of the ray continues to `end`.
pub(super) fn integrate(scratch: &mut Scratch, end: f64, error: f64) -> RayIntegral {
    if scratch.fragments.is_empty() {
        return integrate_volumes(scratch, end, error);
    }
    let mut met = std::mem::take(&mut scratch.surfaces);
    surfaces(&mut scratch.fragments, &mut met);
    let mut out = RayIntegral::default();
    let mut left = 1.0;
    for surface in &met {
        let front = integrate_volumes(scratch, surface.depth, error);
        let through = 1.0 - front.rgba[3];
        for ((sum, light), own) in out.rgba.iter_mut().zip(front.rgba).zip(surface.colour) {
            *sum += surface.share * (light + through * own);
        }
        out.rgba[3] += surface.share;
        out.error += surface.share * front.error;
        left -= surface.share;
    }
    if left > 0.0 {
        let rest = integrate_volumes(scratch, end, error);
        for (sum, light) in out.rgba.iter_mut().zip(rest.rgba) {
            *sum += left * light;
        }
        out.error += left * rest.error;
    }
    scratch.surfaces = met;
    out
}

/// Integrates eq. 3 of Zwicker et al. 2001 over the kernels in `scratch.segments`, from the eye to
/// `end`, which may be infinite:
///
/// I = ∫ Σ c_k κ_k(t) T(t) dt, T(t) = exp(-Σ tau_k [Phi((t - mu_k)/s_k) - Phi((0 - mu_k)/s_k)]).
///
/// Extinctions of overlapping kernels add up; nothing is sorted. T is exact. The integral uses adaptive
/// Gauss-Kronrod quadrature between places that the kernels determine, to about `error`. Sheets (kernels
/// without extent along the ray) are steps of T.
fn integrate_volumes(scratch: &mut Scratch, end: f64, error: f64) -> RayIntegral {
    // Compiled for the processor's vector instructions: half the time with AVX2.
    pulp::Arch::new().dispatch(
        #[inline(always)]
        || integrate_inlined(scratch, end, error),
    )
}

#[inline(always)]
fn integrate_inlined(scratch: &mut Scratch, end: f64, error: f64) -> RayIntegral {
    let Scratch {
        segments,
        sheets,
        starts,
        events,
        cuts,
        active,
        ..
    } = scratch;
    let count = segments.len().max(1) as f64;
    // The tails of all kernels beyond this depth are together a small part of the error.
    let least_depth = error * TAIL_SHARE / count;
    sheets.clear();
    starts.clear();
    events.clear();
    active.clear();

    let mut total_depth = 0.0;
    // Optical depth behind the eye.
    let mut behind = 0.0;
    let mut far_end = 0.0_f64;
    for (i, s) in segments.iter().enumerate() {
        if s.sigma <= SHEET * s.mean.abs() {
            let [from, to] = s.domain;
            if s.mean > 0.0 && s.mean < end && from <= s.mean && s.mean < to {
                sheets.push(*s);
                events.push((s.mean, 0.0));
                total_depth += s.tau;
                far_end = far_end.max(s.mean);
            }
            continue;
        }
        let share_at = |t: f64| (t.clamp(s.domain[0], s.domain[1]) - s.mean) / s.sigma;
        let (_, [share_behind, up_to_end]) = normal_density_and_cdf([share_at(0.0), share_at(end)]);
        total_depth += s.tau * (up_to_end - share_behind);
        if s.tau <= least_depth {
            continue;
        }
        let reach = (2.0 * (s.tau / least_depth).ln()).sqrt().min(LONGEST_REACH) * s.sigma;
        behind += s.tau * (share_behind - s.share_before());
        starts.push((s.mean - reach, i));
        far_end = far_end.max(s.mean + reach);
        for e in EVENTS {
            let t = s.mean + e * s.sigma;
            if t > 0.0 && t < s.mean + reach {
                events.push((t, s.sigma));
            }
        }
        events.push((s.mean + reach, s.sigma));
        // Places at which the extinction jumps.
        let jumps = s.domain.into_iter().filter(|t| t.is_finite() && *t > 0.0);
        events.extend(jumps.map(|t| (t, 0.0)));
    }
    let opacity = -(-total_depth).exp_m1();
    let mut out = RayIntegral {
        rgba: [0.0, 0.0, 0.0, opacity],
        error: 0.0,
    };
    starts.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    events.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    sheets.sort_unstable_by(|a, b| a.mean.total_cmp(&b.mean));

    let mut from = starts.first().map_or(0.0, |s| s.0.max(0.0)).min(end);
    cuts.clear();
    cuts.push(from);
    far_end = far_end.min(end);
    for &(t, sigma) in events.iter() {
        let t = t.min(end);
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
            let starting = std::iter::from_fn(|| starting.next_if(|s| s.0 < t));
            passed += active.advance(from, starting.map(|(_, i)| &segments[*i]));
            if !active.segments.is_empty() {
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
            // Coinciding sheets are one sheet of mixed colour.
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
        if transmittance < TAIL_SHARE * error {
            out.error += transmittance;
            break;
        }
    }
    out
}

/// Share of the error that cut-off tails may use.
const TAIL_SHARE: f64 = 0.05;

/// Kernels thinner than this share of their distance are sheets: f64 cannot step through them.
const SHEET: f64 = 1e-12;

/// Standard deviations beyond which the normal distribution is constant in f64.
const LONGEST_REACH: f64 = 8.5;

impl Segment {
    /// Returns the share of the whole kernel up to a place of the ray.
    fn share_up_to(&self, t: f64) -> f64 {
        if t.is_infinite() {
            return if t > 0.0 { 1.0 } else { 0.0 };
        }
        normal_density_and_cdf([(t - self.mean) / self.sigma]).1[0]
    }

    /// Returns the share before the kernel's domain.
    fn share_before(&self) -> f64 {
        self.share_up_to(self.domain[0])
    }
}

impl Lanes {
    /// Returns the distance of `t` beyond each mean, in standard deviations.
    #[inline(always)]
    fn normalised(&self, t: f64) -> [f64; LANES] {
        let mut z = self.mean;
        let [from, to] = &self.domain;
        for (l, z) in z.iter_mut().enumerate() {
            *z = (t.max(from[l]).min(to[l]) - *z) * self.inverse_sigma[l];
        }
        z
    }
}

impl Active {
    fn clear(&mut self) {
        self.segments.clear();
        self.lanes.clear();
    }

    #[inline(always)]
    /// Adds the kernels of `starting` and removes those that end before `t`; returns the depth of the latter.
    fn advance<'a>(&mut self, t: f64, starting: impl Iterator<Item = &'a Segment>) -> f64 {
        let mut depth = 0.0;
        self.segments.extend(starting);
        self.segments.retain(|s| {
            let ends = s.mean + LONGEST_REACH * s.sigma <= t;
            if ends {
                depth += s.tau * (s.share_up_to(s.domain[1]) - s.share_before());
            }
            !ends
        });
        self.lanes.clear();
        for chunk in self.segments.chunks(LANES) {
            let mut lanes = Lanes::default();
            for (l, s) in chunk.iter().enumerate() {
                lanes.mean[l] = s.mean;
                lanes.before[l] = s.share_before();
                (lanes.domain[0][l], lanes.domain[1][l]) = (s.domain[0], s.domain[1]);
                lanes.inverse_sigma[l] = 1.0 / s.sigma;
                lanes.tau[l] = s.tau;
                for (channel, c) in lanes.colour.iter_mut().zip(s.colour) {
                    channel[l] = c;
                }
            }
            self.lanes.push(lanes);
        }
        depth
    }

    /// Returns the optical depth of all kernels up to `t`.
    #[inline(always)]
    fn depth(&self, t: f64) -> f64 {
        let mut depth = [0.0; LANES];
        for lanes in &self.lanes {
            let (_, cdf) = normal_density_and_cdf(lanes.normalised(t));
            for l in 0..LANES {
                depth[l] += lanes.tau[l] * (cdf[l] - lanes.before[l]);
            }
        }
        depth.iter().sum()
    }

    /// Returns red, green, blue and extinction at `t`, attenuated by everything before.
    #[inline(always)]
    fn attenuated(&self, passed: f64, t: f64) -> [f64; 4] {
        let mut depth = [0.0; LANES];
        let mut sums = [[0.0; LANES]; 4];
        for lanes in &self.lanes {
            let mut extinction = [0.0; LANES];
            let (density, cdf) = normal_density_and_cdf(lanes.normalised(t));
            for l in 0..LANES {
                depth[l] += lanes.tau[l] * (cdf[l] - lanes.before[l]);
                let is_inside = lanes.domain[0][l] <= t && t < lanes.domain[1][l];
                let tau = if is_inside { lanes.tau[l] } else { 0.0 };
                extinction[l] = tau * lanes.inverse_sigma[l] * density[l];
                sums[3][l] += extinction[l];
            }
            for (sum, colour) in sums.iter_mut().zip(&lanes.colour) {
                for l in 0..LANES {
                    sum[l] += extinction[l] * colour[l];
                }
            }
        }
        let transmittance = (-passed - depth.iter().sum::<f64>()).exp();
        sums.map(|s| s.iter().sum::<f64>() * transmittance)
    }
}

/// Integrates over one interval with known transmittances at its ends. Their difference is the exact integral
/// of the extinction, which shows the accuracy of the quadrature for the colours, too.
#[inline(always)]
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
    // Depths are sums of this size: a difference below their rounding is meaningless.
    let depths: f64 = active.segments.iter().map(|s| s.tau).sum();
    let rounding = 4.0 * f64::EPSILON * (1.0 + passed.abs() + depths);
    let mut stack = vec![(a, b, before, after, tolerance)];
    let mut bisections = 0;
    while let Some((a, b, before, after, tolerance)) = stack.pop() {
        let mut values = [[0.0; 4]; 15];
        for (value, t) in values.iter_mut().zip(nodes(a, b)) {
            *value = active.attenuated(passed, t);
        }
        let rule = kronrod(&values, a, b);
        let error = rule.error.max((rule.value[3] - (before - after)).abs());
        let middle = 0.5 * (a + b);
        let smallest = tolerance.max(rounding * before);
        let is_thin = !(a < middle && middle < b);
        if error <= smallest || is_thin || bisections == MOST_BISECTIONS {
            for (sum, v) in out.value.iter_mut().zip(rule.value) {
                *sum += v;
            }
            out.error += error;
        } else {
            let between = (-passed - active.depth(middle)).exp();
            let tolerance = 0.5 * tolerance;
            stack.push((middle, b, between, after, tolerance));
            stack.push((a, middle, before, between, tolerance));
            bisections += 1;
        }
    }
    out
}
