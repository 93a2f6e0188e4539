//! Tests every approximation with a stated bound against f64 references, over thousands of random
//! cases: measured <= bound, and how loose the bound is.
//!
//! `cargo test --test bounds -- --nocapture` prints a table, one bound a line: cases, worst and
//! median ratio of the measured error to the bound. A worst ratio far below 1 shows that the bound
//! is too loose.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::TAU;

use crate::common::draw::{Draw, EPS, draw, judged, ray};
use crate::common::frame::Frame;
use crate::common::judge::{self, Body};
use crate::common::scene::{Particle, camera, difference, overlapping, render, volume};
use crate::common::{Random, some};
use ewa_splat::math::normal_cdf;
use ewa_splat::render::Advanced;
use ewa_splat::scene::{ColourSpace, ControlPoint, TransferFunction};
use ewa_splat::stages::blocks::{
    Block, BlockedParticles, BlockedVolume, DepthRange, Frustum, distance_interval,
};
use ewa_splat::stages::constants::{MAX_CUTOFF, TERMINATION_SHARE};
use ewa_splat::stages::record::{BlockView, PATH_NEAR, ViewUniform};
use ewa_splat::stages::splat::{
    Filter, ImageKernel, Kernel, ScreenFactor, affine_error, cutoff_radius, cutoff_share,
    edge_growth, exact_terms, opacity_amplification, project_kernel,
};
use ewa_splat::view::{Camera, Projection};
use ewa_splat::{Image, Settings};
use glam::{DMat3, DVec2, DVec3, Vec2};

/// Line of the table: ratios of measured errors to bounds.
struct Slack {
    name: String,
    ratios: Vec<f64>,
    worst: (f64, String),
}

impl Slack {
    fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            ratios: Vec::new(),
            worst: (0.0, String::new()),
        }
    }

    /// Adds a case.
    fn add(&mut self, measured: f64, bound: f64, case: impl FnOnce() -> String) {
        let ratio = measured / bound;
        // The comparison makes NaN the worst ratio.
        if !(ratio <= self.worst.0) {
            self.worst = (ratio, format!("{measured:e} against {bound:e}: {}", case()));
        }
        self.ratios.push(ratio);
    }

    /// Prints the line. Checks that the bound holds, for enough cases, and is not a hundred times
    /// too loose.
    fn finish(mut self, least_cases: usize) {
        self.ratios.sort_by(f64::total_cmp);
        let cases = self.ratios.len();
        let median = self.ratios[cases / 2];
        let (worst, case) = self.worst;
        println!(
            "{:<52} {cases:>7}  worst {worst:.3e}  median {median:.3e}",
            self.name
        );
        assert!(cases >= least_cases, "{}: {cases} cases", self.name);
        assert!(worst <= 1.0, "{}: {case}", self.name);
        assert!(worst > 0.01, "{} is too loose", self.name);
    }
}

/// Returns the greatest value of a function of the plane, by a polar grid to radius 6 (exp(-18) of
/// a footprint lies beyond) and a local search from its best point.
fn greatest(f: impl Fn(DVec2) -> f64) -> f64 {
    let mut best = (f(DVec2::ZERO), DVec2::ZERO);
    let try_at = |best: &mut (f64, DVec2), a: DVec2| {
        let e = f(a);
        if !(e <= best.0) {
            *best = (e, a);
        }
    };
    for radius in 1..=24 {
        for n in 0..32 {
            let a = DVec2::from_angle(TAU * f64::from(n) / 32.0);
            try_at(&mut best, a * (0.25 * f64::from(radius)));
        }
    }
    let mut step = 0.25;
    for _ in 0..6 {
        let at = best.1;
        for (x, y) in [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)] {
            try_at(&mut best, at + DVec2::new(x, y) * step);
        }
        step *= 0.5;
    }
    best.0
}

/// Returns the kernel with all but `rank` of its dimensions flattened.
fn flattened(random: &mut Random, kernel: Kernel, rank: usize) -> Kernel {
    let rotation = random.rotation().as_mat3();
    let kept = (0..rank).map(|i| rotation.col(i)).collect::<Vec<_>>();
    let project = |row: glam::Vec3| kept.iter().map(|&e| e * e.dot(row)).sum::<glam::Vec3>();
    let mut flat = kernel;
    flat.factor.x = project(kernel.factor.x);
    flat.factor.y = project(kernel.factor.y);
    flat.factor.z = project(kernel.factor.z);
    flat
}

/// Kernel with its footprint, the bound on its affine error, and the reference values.
struct Case {
    view: ViewUniform,
    kernel: Kernel,
    screen: ScreenFactor,
    image: ImageKernel,
    bound: f64,
    body: Body,
    cholesky: glam::DMat2,
    /// Square root of the footprint's ratio of eigenvalues, largest over smallest.
    axis_ratio: f64,
}

impl Case {
    fn new(view: ViewUniform, kernel: Kernel) -> Self {
        let h2 = view.low_pass_variance_px2;
        let screen = project_kernel(&view, &kernel);
        let image = screen.filtered(Filter::Ewa, h2);
        let terms = exact_terms(&screen, h2, image.determinant);
        let (body, variance, cholesky) = judged(&view, &kernel);
        let (small, large) = judge::eigenvalues(&variance);
        Self {
            bound: f64::from(affine_error(&view, &screen, &image, &terms)),
            axis_ratio: (large / small).sqrt(),
            view,
            kernel,
            screen,
            image,
            body,
            cholesky,
        }
    }

    /// Returns the exact line integral at offset `cholesky * a`, relative to the centre's.
    fn exact(&self, a: DVec2) -> f64 {
        let at = |a: DVec2| {
            self.body
                .line_integral(ray(&self.view, &self.body, self.cholesky * a))
        };
        at(a) / at(DVec2::ZERO)
    }

    fn describe(&self) -> String {
        format!("{:?}, {:?}", self.kernel, self.view)
    }
}

/// Returns kernels of every rank, with and without low-pass filter, needles to 1:10,000, up to 80
/// degrees off the axis, nearly on it or pointing along it, with standard deviations 1e-4 to .3 of
/// the distance.
fn cases(seed: u64, count: usize) -> impl Iterator<Item = (usize, Case)> {
    let mut random = Random::new(seed);
    (0..count).map(move |i| {
        let rank = [3, 3, 3, 2, 1, 0][i % 6];
        let h2 = if rank == 3 { [1.0, 0.0][i % 2] } else { 1.0 };
        let from = Draw {
            ratio: 1e4,
            size: [1e-4, 0.3],
            // On the axis, the error has other terms.
            off_axis_deg: if random.index(4) == 0 { 0.01 } else { 80.0 },
            h2,
        };
        let (view, mut kernel) = draw(&mut random, from);
        if random.index(8) == 0 {
            // The kernel is long in depth and on the axis: there, only the Hessian of w remains.
            let depth = kernel.centre.z;
            let long = depth * random.range(0.01, 0.29) as f32;
            let wide = long * random.log_range(0.01, 1.0) as f32;
            let rows = [[wide, 0.0, 0.0], [0.0, wide, 0.0], [0.0, 0.0, long]];
            kernel = crate::common::kernel([0.0, 0.0, depth], rows, 1.0);
        }
        let kernel = flattened(&mut random, kernel, rank);
        (rank, Case::new(view, kernel))
    })
}

#[test]
fn affine_error_is_within_its_bound() {
    let mut by_rank = [0, 1, 2, 3].map(|rank| Slack::new(format!("affine error, rank {rank}")));
    let mut evaluated = Slack::new("affine error, as f32 evaluates it");
    for (rank, case) in cases(1, 12_000) {
        let error = greatest(|a| ((-0.5 * a.length_squared()).exp() - case.exact(a)).abs());
        // Some sixteen roundings of the bound's own terms, and the reference's cancellation.
        let bound = case.bound * (1.0 + 16.0 * EPS) + 1e-9;
        by_rank[rank].add(error, bound, || case.describe());

        let peak = f64::from(case.image.tau);
        let [p, r] = case.image.triangular_form().map(Vec2::from);
        let error = greatest(|a| {
            let d = (case.cholesky * a).as_vec2();
            let q = p.dot(d).powi(2) + r.dot(d).powi(2);
            let tau = case.image.tau * (-0.5 * q).exp();
            (f64::from(tau) / peak - case.exact(a)).abs()
        });
        // The documentation of the exact path states this bound of roundings.
        let rounding = 6e-6 + 4.0 * EPS * case.axis_ratio;
        evaluated.add(error, case.bound + rounding, || case.describe());
    }
    for slack in by_rank {
        slack.finish(2_000);
    }
    evaluated.finish(12_000);

    let mut random = Random::new(17);
    let mut spheres = Slack::new("affine error of spheres, in two terms");
    for _ in 0..3_000 {
        let (eps, angle) = (random.log_range(1e-4, 0.03), random.range(0.0, 1.2));
        let centre = DVec3::new(angle.sin(), 0.0, angle.cos()).as_vec3();
        let sigma = eps as f32;
        let rows = [[sigma, 0.0, 0.0], [0.0, sigma, 0.0], [0.0, 0.0, sigma]];
        let view = crate::common::view([500.0; 2], [0.0; 2], 0.0);
        let case = Case::new(view, crate::common::kernel(centre.into(), rows, 1.0));
        let error = greatest(|a| ((-0.5 * a.length_squared()).exp() - case.exact(a)).abs());
        let tan = angle.tan();
        // The bound is of first order, and of second order on the axis, where the first vanishes.
        let bound = 1.16 * eps * tan + 1.1 * eps * eps * (1.0 + tan * tan);
        spheres.add(error, bound + 1e-9, || case.describe());
    }
    spheres.finish(3_000);
}

#[test]
fn opacity_errs_by_no_more_than_the_amplified_bound() {
    let mut random = Random::new(2);
    let mut faint = Slack::new("opacity of an affine kernel, depth 1e-4 to 1");
    let mut opaque = Slack::new("opacity of an affine kernel, depth 1 to 1e4");
    for (i, (_, case)) in cases(3, 12_000).enumerate() {
        let (slack, tau) = if i % 3 == 0 {
            (&mut faint, random.log_range(1e-4, 1.0))
        } else {
            (&mut opaque, random.log_range(1.0, 1e4))
        };
        let bound = case.bound * f64::from(opacity_amplification(tau as f32));
        // A bound above 1 is trivial: every opacity is below 1.
        if bound < 1.0 {
            let error = greatest(|a| {
                let affine = tau * (-0.5 * a.length_squared()).exp();
                ((-affine).exp() - (-tau * case.exact(a)).exp()).abs()
            });
            // The reference's cancellation, as above.
            let case = || format!("tau {tau}, {}", case.describe());
            slack.add(error, bound + 1e-9, case);
        }
    }
    faint.finish(3_000);
    opaque.finish(4_000);
}

#[test]
fn cheaper_filters_err_by_no_more_than_they_say() {
    let mut random = Random::new(4);
    let mut reconstruction = Slack::new("reconstruction kernel alone");
    let mut low_pass = Slack::new("low-pass filter alone");
    let mut isotropic = Slack::new("isotropic footprint");
    for _ in 0..6_000 {
        let h2 = random.range(0.3, 2.0);
        let from = Draw {
            ratio: 100.0,
            size: [1e-4, 0.1],
            off_axis_deg: 60.0,
            h2: h2 as f32,
        };
        let (view, kernel) = draw(&mut random, from);
        let case = Case::new(view, kernel);
        let h2 = f64::from(view.low_pass_variance_px2);
        let bare = Body::of(&kernel).projected(judge::focal(&view));
        let (l1, l2) = judge::eigenvalues(&bare);
        // The EWA footprint's peak, by the determinant of the reference variance.
        let peak = f64::from(case.screen.weight) / (TAU * case.cholesky.determinant());
        let error = |filter| {
            let image = case.screen.filtered(filter, view.low_pass_variance_px2);
            let [p, r] = image.triangular_form().map(Vec2::from);
            greatest(|a| {
                let d = (case.cholesky * a).as_vec2();
                let q = p.dot(d).powi(2) + r.dot(d).powi(2);
                let tau = f64::from(image.tau * (-0.5 * q).exp()) / peak;
                (tau - (-0.5 * a.length_squared()).exp()).abs()
            })
        };
        // Some sixteen roundings of either footprint, and that of T, as on the exact path.
        let rounding = 6e-6 + 4.0 * EPS * (l2 / l1).sqrt();
        let ratio = ((1.0 + h2 / l1) * (1.0 + h2 / l2)).sqrt();
        let bound = ratio - 1.0 + rounding * ratio;
        reconstruction.add(error(Filter::Reconstruction), bound, || case.describe());
        let ratio = ((1.0 + l1 / h2) * (1.0 + l2 / h2)).sqrt();
        let bound = ratio - 1.0 + rounding * ratio;
        low_pass.add(error(Filter::LowPass), bound, || case.describe());
        let delta = 0.5 * (l2 - l1) / (h2 + 0.5 * (l1 + l2));
        let bound = 0.368 * delta + 0.64 * delta.powi(4) + rounding;
        isotropic.add(error(Filter::Isotropic), bound, || case.describe());
    }
    for slack in [reconstruction, low_pass, isotropic] {
        slack.finish(6_000);
    }
}

#[test]
fn what_a_cutoff_leaves_out_is_the_tolerance() {
    let mut random = Random::new(5);
    let mut edge = Slack::new("depth at the cut-off's edge");
    let mut lost = Slack::new("mass beyond the cut-off");
    let mut opacity = Slack::new("opacity of a kernel with a cut-off");
    for _ in 0..20_000 {
        let tau = random.log_range(1e-4, 1e4);
        let tolerance = random.log_range(1e-5, 0.5);
        let r = f64::from(cutoff_radius(tau as f32, 1.0, tolerance as f32, 0.0));
        let share = f64::from(cutoff_share(r as f32));
        let case = || format!("tau {tau}, tolerance {tolerance}");
        let gauss = |r: f64| (-0.5 * r * r).exp();
        // r² / 2 up to 20, in some four roundings.
        let rounding = 1.0 + 80.0 * EPS;
        edge.add(tau * gauss(r), tolerance * tau.min(1.0) * rounding, case);
        // The integral beyond r, by Simpson's rule on the ring's density.
        let step = (12.0 - r) / 400.0;
        let beyond: f64 = (0..400)
            .map(|i| {
                let [a, b, c] = [0.0, 0.5, 1.0].map(|s| r + step * (f64::from(i) + s));
                step / 6.0 * (a * gauss(a) + 4.0 * b * gauss(b) + c * gauss(c))
            })
            .sum();
        lost.add(beyond, tolerance / tau.max(1.0) * rounding, case);
        // Compares the cut-off kernel, with its mass restored, with the whole kernel.
        let error = (0..=600)
            .map(|i| f64::from(i) * 0.01)
            .chain([r * (1.0 - 1e-9), r * (1.0 + 1e-9)])
            .map(|x| {
                let whole = tau * gauss(x);
                let cut = if x < r { whole / share } else { 0.0 };
                ((-cut).exp() - (-whole).exp()).abs()
            })
            .fold(0.0, f64::max);
        // Inside the cut-off, the restored mass raises the kernel.
        let bound = tolerance * tau.min(1.0) / (1.0 - tolerance / tau.max(1.0));
        // The share itself is rounded.
        opacity.add(error, bound * rounding + 2.0 * EPS * tau, case);
    }
    for slack in [edge, lost, opacity] {
        slack.finish(20_000);
    }
}

#[test]
fn the_normal_distribution_is_as_good_as_it_says() {
    let mut random = Random::new(6);
    let mut relative = Slack::new("normal_cdf, relative");
    let mut absolute = Slack::new("normal_cdf, absolute");
    for i in 0..100_000 {
        let x = if i % 2 == 0 {
            random.range(-8.0, 8.0)
        } else {
            random.range(-1.0, 1.0)
        } as f32;
        let exact = 0.5 * libm::erfc(-f64::from(x) * std::f64::consts::FRAC_1_SQRT_2);
        let error = (f64::from(normal_cdf(x)) - exact).abs();
        let case = || format!("x = {x}");
        let bound = 5e-7 + 1.2e-7 * f64::from(x * x);
        relative.add(error / exact, bound, case);
        absolute.add(error, 2e-7, case);
    }
    relative.finish(100_000);
    absolute.finish(100_000);
}

/// Images of the same scenes drawn in two ways: all differences of a channel, relative to the
/// tolerance.
struct Differences {
    name: String,
    tolerance: f64,
    ratios: Vec<f32>,
}

impl Differences {
    fn new(name: &str, tolerance: f64) -> Self {
        Self {
            name: format!("{name}, tolerance {tolerance:.1e}"),
            tolerance,
            ratios: Vec::new(),
        }
    }

    fn add(&mut self, a: &Image, b: &Image) {
        for (a, b) in a.pixels.iter().zip(&b.pixels) {
            if a[3] > 0.0 || b[3] > 0.0 {
                // NaN counts as the greatest error.
                let channels = a.iter().zip(b).map(|(a, b)| (a - b).abs());
                let most = channels.fold(0.0, |m: f32, d| if d <= m { m } else { d });
                self.ratios.push(most / self.tolerance as f32);
            }
        }
    }

    fn finish(mut self, least_pixels: usize, limit: f64) {
        self.ratios.sort_by(f32::total_cmp);
        let count = self.ratios.len();
        let at = |share: f64| f64::from(self.ratios[((count - 1) as f64 * share) as usize]);
        println!(
            "{:<52} {count:>7}  worst {:.3e}  p99.9 {:.3e}  of the tolerance",
            self.name,
            at(1.0),
            at(0.999)
        );
        assert!(count >= least_pixels, "{}: {count} pixels", self.name);
        assert!(at(1.0) <= limit, "{}: {}", self.name, at(1.0));
    }
}

const TOLERANCES: [f64; 5] = [1.0 / 16.0, 1.0 / 64.0, 1.0 / 255.0, 1e-3, 1e-4];

/// Returns a single kernel and a camera that looks past it. The largest standard deviation on the
/// image is 1 to 40 pixels, focal lengths are 16 and up (127 degrees), and optical depths .01 to
/// 1000.
fn isolated(random: &mut Random) -> (Particle, Camera) {
    loop {
        let from = Draw {
            ratio: 100.0,
            size: [1e-4, 0.3],
            off_axis_deg: if random.index(4) == 0 { 1.0 } else { 75.0 },
            h2: 0.0,
        };
        let (_, kernel) = draw(random, from);
        let body = Body::of(&kernel);
        let (_, largest) = judge::eigenvalues(&body.projected(DVec2::ONE));
        let focal = random.log_range(1.0, 40.0) / largest.sqrt();
        if focal < 16.0 {
            continue;
        }
        let focal = DVec2::new(focal, focal * random.range(0.7, 1.4));
        let mut camera = camera(Projection::Perspective, focal.into(), [64, 64]);
        let slope = body.centre.truncate() / body.centre.z;
        camera.centre_px = DVec2::splat(32.0) + random.point(24.0).truncate() - focal * slope;
        let low_passed = body.low_passed(focal, 1.0, body.centre.z);
        let tau = random.log_range(0.01, 1e3);
        let f = &kernel.factor;
        let rows = [f.x, f.y, f.z].map(glam::Vec3::as_dvec3);
        let particle = Particle {
            position: body.centre,
            factor: DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(),
            mass: (tau / low_passed.line_integral(body.centre)) as f32,
            colour: [1.0, 0.5, 0.25],
        };
        return (particle, camera);
    }
}

/// Returns the optical depth of the most opaque pixel, at most some 16.
fn brightest_depth(image: &Image) -> f32 {
    let alpha = image.pixels.iter().map(|p| p[3]).fold(0.0, f32::max);
    -(1.0 - alpha).max(f32::EPSILON).ln()
}

fn draw_image(particles: &[Particle], camera: &Camera, settings: &Settings) -> Image {
    render(vec![volume(particles)], camera, settings)
}

#[test]
fn adaptive_images_are_within_the_tolerance_of_exact_ones() {
    for tolerance in some(TOLERANCES, 1, 3) {
        let settings = |filter| Settings {
            filter,
            tolerance: tolerance as f32,
            // exp(-6²/2) = 1.5e-8: no edge matters.
            cutoff: Some(6.0),
            ..Settings::default()
        };
        let (adaptive, exact) = (settings(Filter::Adaptive), settings(Filter::Exact));
        let mut random = Random::new(7);
        let mut alone = Differences::new("adaptive, isolated kernels", tolerance);
        for _ in 0..800 {
            let (particle, camera) = isolated(&mut random);
            let [a, b] = [&adaptive, &exact].map(|s| draw_image(&[particle], &camera, s));
            alone.add(&a, &b);
        }
        alone.finish(10_000, 1.0);
        let mut together = Differences::new("adaptive, overlapping kernels", tolerance);
        for _ in 0..40 {
            let (particles, camera) = overlapping(&mut random);
            let [a, b] = [&adaptive, &exact].map(|s| draw_image(&particles, &camera, s));
            together.add(&a, &b);
        }
        together.finish(10_000, 1.0);
        // Kernels at one position act as one kernel of their total depth, whose amplification is
        // used here.
        let mut together = Slack::new(format!("adaptive, kernels in one place, {tolerance:.1e}"));
        for _ in 0..200 {
            let (particle, camera) = isolated(&mut random);
            let particle = Particle {
                mass: particle.mass / 1000.0,
                ..particle
            };
            let count = 2 + random.index(60);
            let particles = vec![particle; count];
            let [a, b] = [&adaptive, &exact].map(|s| draw_image(&particles, &camera, s));
            let total = brightest_depth(&b);
            let bound = tolerance * f64::from(opacity_amplification(total).max(1.0));
            let error = f64::from(difference(&a, &b));
            together.add(error, bound, || format!("{count} of {particle:?}"));
        }
        together.finish(200);
    }
}

#[test]
fn cut_off_images_are_within_the_tolerance_of_whole_ones() {
    for tolerance in TOLERANCES {
        let settings = |cutoff| Settings {
            filter: Filter::Exact,
            tolerance: tolerance as f32,
            cutoff,
            ..Settings::default()
        };
        let (cut, whole) = (settings(None), settings(Some(7.0)));
        let mut random = Random::new(8);
        let mut alone = Differences::new("cut-off, isolated kernels", tolerance);
        for _ in 0..800 {
            let (particle, camera) = isolated(&mut random);
            let [a, b] = [&cut, &whole].map(|s| draw_image(&[particle], &camera, s));
            alone.add(&a, &b);
        }
        alone.finish(10_000, 1.0);
        let mut together = Differences::new("cut-off, overlapping kernels", tolerance);
        for _ in 0..40 {
            let (particles, camera) = overlapping(&mut random);
            let [a, b] = [&cut, &whole].map(|s| draw_image(&particles, &camera, s));
            together.add(&a, &b);
        }
        // The figure in the documentation of `cutoff_radius`, and a fifth.
        together.finish(10_000, 6.0);
    }
}

#[test]
fn the_edge_of_an_exact_footprint_is_within_its_growth() {
    let mut random = Random::new(9);
    let mut edge = Slack::new("growth at the edge of exact footprints, over 1");
    for (_, case) in cases(10, 6_000) {
        let r = random.range(1.0, 3.4);
        let h2 = case.view.low_pass_variance_px2;
        let terms = exact_terms(&case.screen, h2, case.image.determinant);
        let bound = edge_growth(&case.view, &case.screen, &case.image, &terms, r as f32);
        let adjugate = judge::adjugate(&case.body.variance);
        let mut most = 0.0_f64;
        for n in 0..128 {
            // Finds the outline, Q = r², along a ray from the centre.
            let direction = case.cholesky * DVec2::from_angle(TAU * f64::from(n) / 128.0);
            let q = |t: f64| {
                let ray = ray(&case.view, &case.body, direction * t);
                let c = case.body.centre.cross(ray);
                c.dot(case.body.variance * c) / ray.dot(adjugate * ray)
            };
            let (mut inner, mut outer) = (0.0, 1.0);
            while q(outer) < r * r && outer < 1e6 {
                outer *= 2.0;
            }
            for _ in 0..40 {
                let between = 0.5 * (inner + outer);
                if q(between) < r * r {
                    inner = between;
                } else {
                    outer = between;
                }
            }
            let a = DVec2::from_angle(TAU * f64::from(n) / 128.0) * inner;
            most = most.max(case.exact(a) * (0.5 * r * r).exp());
        }
        // The bisection's 1e-12, the reference's cancellation, and some sixteen roundings of the
        // bound.
        let bound = f64::from(bound) - 1.0 + 1e-7 + 16.0 * EPS;
        edge.add(most - 1.0, bound, || format!("r {r}, {}", case.describe()));
    }
    edge.finish(6_000);
}

#[test]
fn linear_opacity_errs_by_no_more_than_it_says() {
    let mut random = Random::new(11);
    let mut one = Slack::new("linear opacity, one kernel");
    let mut many = Slack::new("linear opacity, kernels behind one another");
    let mut series = Slack::new("opacity of faint kernels, relative");
    let camera = camera(Projection::Orthographic, [1.0; 2], [1, 1]);
    let bare = |linear_opacity| Settings {
        low_pass_variance_px2: 0.0,
        advanced: Advanced {
            linear_opacity,
            ..Advanced::default()
        },
        cutoff: Some(7.0),
        ..Settings::default()
    };
    let (linear, exponential) = (bare(true), bare(false));
    for i in 0..3_000 {
        let count = [1, 1 + random.index(300)][i % 2];
        let largest = random.log_range(1e-3, 2.0);
        let mut total = 0.0;
        let particles: Vec<_> = (0..count)
            .map(|n| {
                let tau = largest * random.range(0.5, 1.0);
                total += tau;
                // The pixel lies on the axis: exp(0) times the kernel's depth.
                Particle::sphere(DVec3::Z * (20.0 + n as f64), 1.0, TAU * tau)
            })
            .collect();
        let alpha = |settings| f64::from(draw_image(&particles, &camera, settings).pixels[0][3]);
        let true_opacity = -(-total).exp_m1();
        let error = (alpha(&linear) - true_opacity).abs();
        // Three roundings per kernel, of an opacity below 1.
        let rounding = 3.0 * EPS * count as f64 * true_opacity;
        let case = || format!("{count} kernels, depth {total}");
        if count == 1 {
            one.add(error, 0.5 * total * total + rounding, case);
            if total <= 0.03 {
                // tau³/24 of the opacity, for the series that draws faint kernels, and ten
                // roundings.
                let error = (alpha(&exponential) - true_opacity).abs() / true_opacity;
                series.add(error, total.powi(3) / 24.0 + 10.0 * EPS, case);
            }
        } else {
            many.add(error, largest / std::f64::consts::E + rounding, case);
        }
    }
    one.finish(1_000);
    many.finish(1_000);
    series.finish(300);
}

#[test]
fn a_tile_that_stops_early_leaves_out_a_share_of_the_tolerance() {
    let mut random = Random::new(12);
    let mut stopped = Slack::new("what shines through where a tile stops");
    for _ in 0..300 {
        let tolerance = random.log_range(1e-3, 0.3);
        let settings = |tolerance: f64| Settings {
            filter: Filter::Exact,
            tolerance: tolerance as f32,
            cutoff: Some(7.0),
            ..Settings::default()
        };
        let camera = camera(Projection::Perspective, [40.0; 2], [16, 16]);
        let depth = random.log_range(0.02, 1.0);
        let particles: Vec<_> = (0..600)
            .map(|n| {
                let z = 10.0 + f64::from(n) * 0.05;
                let mass = TAU * 9.0 * depth * random.range(0.5, 1.0);
                // White comes last, so that an omission would be visible.
                let colour = if n % 40 < 20 { [0.0; 3] } else { [1.0; 3] };
                Particle::sphere(DVec3::new(0.0, 0.0, z), 3.0, mass).coloured(colour)
            })
            .collect();
        let [a, b] = [tolerance, 1e-9].map(|t| draw_image(&particles, &camera, &settings(t)));
        let bound = tolerance * f64::from(TERMINATION_SHARE);
        // 600 layers are composited in f32, with one rounding each near opacity 1.
        let rounding = 1e-6;
        stopped.add(f64::from(difference(&a, &b)), bound + rounding, || {
            format!("tolerance {tolerance}, depth {depth}")
        });
    }
    stopped.finish(300);
}

#[test]
fn a_constant_ripples_by_what_the_low_pass_filter_leaves() {
    let mut random = Random::new(13);
    let mut ripple = Slack::new("ripple between pixel centres");
    for _ in 0..2_000 {
        let h2 = random.range(0.1, 0.5);
        let (h2_f32, pi2) = (h2 as f32, std::f64::consts::PI.powi(2));
        let view = crate::common::view([100.0; 2], [0.0; 2], h2_f32);
        let point = crate::common::kernel([0.0, 0.0, 1.0], [[0.0; 3]; 3], 1.0);
        let screen = project_kernel(&view, &point);
        let image = screen.filtered(Filter::Ewa, h2_f32);
        let [p, r] = image.triangular_form().map(Vec2::from);
        let from = random.point(0.5).truncate();
        let mut sum = 0.0;
        for (y, x) in (-6..=6).flat_map(|y| (-6..=6).map(move |x| (y, x))) {
            let d = (from + DVec2::new(f64::from(x), f64::from(y))).as_vec2();
            let q = f64::from(p.dot(d).powi(2) + r.dot(d).powi(2));
            sum += f64::from(image.tau) * (-0.5 * q).exp();
        }
        // The first harmonic of a pixel's period, along x and y; the next ones, product and double,
        // add a fifth at h² = .1.
        let first = (-2.0 * pi2 * h2).exp();
        let bound = 4.0 * first * (1.0 + first) + 4.0 * first.powi(4) + 1e-6;
        let error = (sum / f64::from(screen.weight) - 1.0).abs();
        ripple.add(error, bound, || format!("h² {h2}, {from}"));
    }
    ripple.finish(2_000);
}

/// Returns a small cloud of needles about a point: one block or a few.
fn cloud(random: &mut Random, count: usize) -> Vec<Particle> {
    let (width, size) = (random.log_range(0.01, 1.0), random.log_range(0.01, 0.5));
    let middle = random.point(1.0);
    (0..count)
        .map(|_| {
            let (largest, ratio) = (
                size * random.log_range(0.1, 1.0),
                random.log_range(1.0, 100.0),
            );
            Particle {
                position: middle + random.point(width),
                factor: random.factor(largest, ratio),
                mass: 1.0,
                colour: [1.0; 3],
            }
        })
        .collect()
}

/// Returns a visible particle that is longest along the normal of one of the frustum's planes, and
/// that outward normal.
fn needle_beside(camera: &Camera, random: &mut Random) -> (Vec<Particle>, DVec3) {
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let edge = size / 2.0 / camera.focal_px;
    let tilt = match camera.projection {
        Projection::Perspective => edge,
        Projection::Orthographic => DVec2::ZERO,
    };
    let outwards = match random.index(5) {
        0 => DVec3::new(1.0, 0.0, -tilt.x),
        1 => DVec3::new(-1.0, 0.0, -tilt.x),
        2 => DVec3::new(0.0, 1.0, -tilt.y),
        3 => DVec3::new(0.0, -1.0, -tilt.y),
        _ => DVec3::NEG_Z,
    };
    let outwards = outwards.normalize();
    let world_from_camera = camera.camera_from_world.transpose();
    let side = outwards.any_orthonormal_vector();
    let size = random.log_range(0.01, 0.5);
    let [a, b] = [0, 1].map(|_| random.log_range(0.01, 1.0));
    let factor = DMat3::from_cols(outwards, side * a, outwards.cross(side) * b);
    let needle = Particle {
        position: camera.eye + world_from_camera * (DVec3::Z * random.range(1.0, 5.0)),
        factor: world_from_camera * factor * size,
        mass: 1.0,
        colour: [1.0; 3],
    };
    (vec![needle], world_from_camera * outwards)
}

#[test]
fn blocks_bound_what_they_hold() {
    let mut random = Random::new(14);
    let mut sigma = Slack::new("a block's largest standard deviation");
    let mut radius = Slack::new("a block's interval of distances");
    let mut culled = Slack::new("the frustum: 7 over the nearest deviations");
    for round in 0..3_000 {
        // A single particle is tested against its own bound, several against their box.
        let projection = [Projection::Perspective, Projection::Orthographic][round / 2 % 2];
        let mut camera = camera(projection, [40.0, 50.0], [64, 48]);
        camera.camera_from_world = random.rotation();
        camera.eye = random.point(4.0);
        let (particles, away) = if round % 2 == 0 {
            needle_beside(&camera, &mut random)
        } else {
            let count = 2 + random.index(8);
            (cloud(&mut random, count), random.point(1.0))
        };
        let built = BlockedVolume::new(volume(&particles));
        let [block] = built.blocks[..] else {
            panic!("one block")
        };
        // f32 roundings of a factor, an offset, an extent: some four.
        let rounding = 1.0 + 4.0 * EPS;
        let mut widest = 0.0_f64;
        for p in &particles {
            let v = p.factor * p.factor.transpose();
            widest = widest.max(largest_eigenvalue(&v).sqrt());
        }
        let bound = f64::from(block.max_sigma) * rounding;
        sigma.add(widest, bound, || format!("{particles:?}"));

        let (distance, reach) = distance_interval(&camera, &block, false);
        let farthest = particles
            .iter()
            .map(|p| {
                let u = camera.camera_point(p.position);
                let d = if projection == Projection::Perspective {
                    u.length()
                } else {
                    u.z
                };
                (d - distance).abs()
            })
            .fold(0.0, f64::max);
        if particles.len() > 1 {
            radius.add(farthest, reach * rounding, || format!("{particles:?}"));
        }

        // Moves the block away from the view until it is culled.
        let h2 = [0.0, 1.0][round / 4 % 2] * random.range(0.0, 1.0);
        let frustum = Frustum::new(&camera, f64::from(MAX_CUTOFF) * h2.sqrt());
        let at = |t: f64| Block {
            origin: block.origin + away * t,
            ..block
        };
        let (mut seen, mut unseen) = (0.0, 1e3);
        if frustum.sees(&camera, &at(unseen), false) {
            continue;
        }
        for _ in 0..50 {
            let between = 0.5 * (seen + unseen);
            if frustum.sees(&camera, &at(between), false) {
                seen = between;
            } else {
                unseen = between;
            }
        }
        let nearest = particles
            .iter()
            .map(|p| nearest_deviation(&camera, p, p.position + away * unseen, h2))
            .fold(f64::INFINITY, f64::min);
        let bound = f64::from(MAX_CUTOFF);
        // The margin of a thousandth of a deviation is negligible at 7; the search leaves 1e-12.
        culled.add(bound / nearest, 1.0 + 1e-6, || {
            format!(
                "{particles:?} moved by {}, {camera:?}, h² {h2}",
                away * unseen
            )
        });
    }
    sigma.finish(3_000);
    radius.finish(1_500);
    culled.finish(2_000);
}

/// Returns the largest eigenvalue of a variance, by powers.
fn largest_eigenvalue(v: &DMat3) -> f64 {
    let mut power = *v / v.to_cols_array().into_iter().fold(0.0, f64::max);
    for _ in 0..12 {
        power = power * power;
        power = power
            * (1.0
                / power
                    .to_cols_array()
                    .into_iter()
                    .map(f64::abs)
                    .fold(0.0, f64::max));
    }
    let columns = [power.x_axis, power.y_axis, power.z_axis];
    let e = columns
        .into_iter()
        .max_by(|a, b| a.length().total_cmp(&b.length()))
        .unwrap()
        .normalize();
    e.dot(*v * e)
}

/// Returns the least Mahalanobis distance of a low-passed particle from the half lines of all
/// pixels: their centres, and the corners of the image.
fn nearest_deviation(camera: &Camera, p: &Particle, position: DVec3, h2: f64) -> f64 {
    let f = camera.camera_from_world * p.factor;
    let v = f * f.transpose();
    let centre = camera.camera_point(position);
    let perspective = camera.projection == Projection::Perspective;
    let depth = match perspective {
        true => centre.z.abs().max(v.z_axis.z.sqrt()),
        false => 1.0,
    };
    let body = Body {
        centre,
        variance: v,
        mass: 1.0,
    }
    .low_passed(camera.focal_px, h2, depth);
    let inverse = body.variance.inverse();
    let mut nearest = f64::INFINITY;
    for (i, j) in (0..=16).flat_map(|i| (0..=16).map(move |j| (i, j))) {
        let share = DVec2::new(f64::from(i), f64::from(j)) / 16.0;
        let px = share * DVec2::new(camera.width as f64, camera.height as f64);
        let slope = (px - camera.centre_px) / camera.focal_px;
        let (start, d) = match perspective {
            true => (DVec3::ZERO, slope.extend(1.0)),
            false => (slope.extend(0.0), DVec3::Z),
        };
        let u = centre - start;
        let t = (d.dot(inverse * u) / d.dot(inverse * d)).max(0.0);
        let x = d * t - u;
        nearest = nearest.min(x.dot(inverse * x).sqrt());
    }
    nearest
}

#[test]
fn depth_keys_are_as_fine_as_they_say() {
    let mut random = Random::new(15);
    let mut keys = Slack::new("a particle's depth key");
    for round in 0..60 {
        let scale = random.log_range(1e-3, 1e3);
        let count = [40, 2_000][round % 2];
        let particles: Vec<_> = (0..count)
            .map(|_| {
                let at = random.point(scale) + DVec3::Z * scale * 2.0;
                Particle::sphere(at, scale * 1e-3, scale * scale)
            })
            .collect();
        let projection = [Projection::Perspective, Projection::Orthographic][round / 2 % 2];
        let mut camera = camera(projection, [20.0; 2], [64, 64]);
        camera.focal_px *= if projection == Projection::Perspective {
            1.0
        } else {
            1.0 / scale
        };
        let frame = Frame::uncut(volume(&particles), &camera, &Settings::default());
        let interval = |v: &BlockView| {
            distance_interval(&frame.camera, &frame.volume.blocks[v.block as usize], false)
        };
        let range = DepthRange::of(frame.views.iter().map(interval));
        let BlockedParticles::Anisotropic { offsets, .. } = &frame.volume.particles else {
            panic!("anisotropic particles")
        };
        for (classified, footprint) in frame.classified.iter().zip(&frame.footprints) {
            let block = &frame.volume.blocks[frame.views[classified.view as usize].block as usize];
            let offset = offsets[(block.first + classified.local) as usize];
            let at = block.origin + DVec3::from(offset.map(f64::from));
            let u = camera.camera_point(at);
            let distance = match projection {
                Projection::Perspective => u.length(),
                Projection::Orthographic => u.z,
            };
            let expected = f64::from(range.key(distance));
            let error = (f64::from(footprint.key) - expected).abs();
            // Each key is truncated, the difference rounded; four roundings of the block's size.
            let size = block.half_extent.as_dvec3().length();
            let bound = 1.5 + 4.0 * EPS * size * f64::from(range.keys_per_unit());
            keys.add(error, bound, || format!("{projection:?} at {at}"));
        }
    }
    keys.finish(30_000);
}

#[test]
fn a_transfer_table_is_within_its_interpolation_error() {
    let mut random = Random::new(16);
    let mut smooth = Slack::new("transfer table, between control points");
    let mut steps = Slack::new("transfer table, around control points");
    for round in 0..300 {
        let count = 2 + random.index(6);
        let (low, unit) = (
            random.range(-100.0, 100.0) as f32,
            random.log_range(0.01, 10.0),
        );
        let span = random.log_range(0.1, 1e3) as f32;
        let range = [low, low + span];
        let mut at: Vec<f32> = (0..count)
            .map(|_| low + span * random.range(0.0, 1.0) as f32)
            .collect();
        at.sort_by(f32::total_cmp);
        if round % 3 == 0 {
            // A step.
            at[count - 1] = at[count - 2];
        }
        let points: Vec<_> = at
            .iter()
            .map(|&value| ControlPoint {
                value,
                colour: None,
                opacity: Some(random.range(0.0, 0.99) as f32),
            })
            .collect();
        let table =
            TransferFunction::from_points(&points, ColourSpace::Linear, range, unit).unwrap();
        let truth = |value: f64| {
            let o = |p: &ControlPoint| f64::from(p.opacity.unwrap());
            let after = points.partition_point(|p| f64::from(p.value) <= value);
            let opacity = match after {
                0 => o(&points[0]),
                n if n == count => o(&points[n - 1]),
                n => {
                    let (a, b) = (&points[n - 1], &points[n]);
                    let (x, y) = (f64::from(a.value), f64::from(b.value));
                    o(a) + (o(b) - o(a)) * (value - x) / (y - x)
                }
            };
            -(-opacity).ln_1p() / unit
        };
        let step = (f64::from(range[1]) - f64::from(range[0])) / 4095.0;
        for _ in 0..200 {
            let value = if random.index(2) == 0 {
                f64::from(at[random.index(count)]) + step * random.range(-1.0, 1.0)
            } else {
                random.range(f64::from(range[0]), f64::from(range[1]))
            };
            let value = (value as f32).clamp(range[0], range[1]);
            let got = f64::from(table.classify(value)[3]);
            let value = f64::from(value);
            // The position between two entries has three roundings of 4095 entries, and the value
            // of an entry one.
            let grain = EPS * (3.0 * 4095.0 + value.abs().max(f64::from(low).abs()) / step);
            let around = |t: f64| value + t * step * (1.001 + grain);
            let case = || format!("{points:?} over {range:?} at {value}");
            let near =
                |p: &&ControlPoint| (around(-1.0)..=around(1.0)).contains(&f64::from(p.value));
            // An entry's own roundings, and its value's.
            let rounding = 4.0 * EPS * truth(value);
            if points.iter().any(|p| near(&p)) {
                // The function's least and greatest value within one entry of the value.
                let values = points.iter().filter(near).flat_map(|p| {
                    let v = f64::from(p.value);
                    [v, v.next_down()]
                });
                let [lo, hi] = values
                    .chain([-1.0, 0.0, 1.0].map(around))
                    .map(truth)
                    .fold([f64::INFINITY, 0.0], |[lo, hi], e| [lo.min(e), hi.max(e)]);
                let (middle, half) = (0.5 * (lo + hi), 0.5 * (hi - lo));
                steps.add((got - middle).abs(), half + rounding + 4.0 * EPS * hi, case);
            } else {
                // h²/8 times the second derivative of -ln(1 - o), o linear.
                let slope =
                    (truth(around(1.0)) - truth(around(-1.0))).abs() / (2.002 + 2.0 * grain);
                let second = (slope * unit).powi(2) / unit;
                let bound = second / 8.0 * 1.01 + slope * grain + rounding;
                smooth.add((got - truth(value)).abs(), bound + 1e-12 / unit, case);
            }
        }
    }
    smooth.finish(20_000);
    steps.finish(10_000);
}

#[test]
fn near_kernels_are_nowhere_deeper_than_their_bound() {
    let mut random = Random::new(18);
    let mut depth = Slack::new("greatest depth of a near kernel");
    for _ in 0..2_000 {
        let (size, ratio) = (random.log_range(1e-3, 1e3), random.log_range(1.0, 100.0));
        let factor = random.factor(size, ratio);
        // From focal lengths of 2 pixels on, where the low-pass filter is as wide as the kernel.
        let focal = DVec2::splat(random.log_range(2.0, 2000.0));
        let mut camera = camera(Projection::Perspective, focal.into(), [64, 64]);
        camera.centre_px = DVec2::splat(32.0);
        let mut particle = Particle {
            position: factor * random.point(0.5),
            factor,
            mass: 1.0,
            colour: [1.0; 3],
        };
        let v = factor * factor.transpose();
        let z = particle.position.z.abs().max(v.z_axis.z.sqrt());
        let body = Body {
            centre: particle.position,
            variance: v,
            mass: 1.0,
        }
        .low_passed(focal, 1.0, z);
        // 1/sqrt(least eigenvalue of adj(V)), along the longest axis.
        let largest = largest_eigenvalue(&body.variance);
        let peak = (largest / body.variance.determinant()).sqrt() / TAU;
        particle.mass = (random.log_range(2.0, 1e3) / peak) as f32;
        let peak = peak * f64::from(particle.mass);
        let settings = Settings::default();
        let frame = Frame::new(volume(&[particle]), &camera, &settings);
        let footprint = frame.footprints[0];
        if footprint.path & 3 != PATH_NEAR || !footprint.is_visible() {
            continue;
        }
        let r2 = f64::from(footprint.cutoff_squared);
        // exp(-r²/2) is the tolerance over the bound. r² has some eight roundings, among them those
        // of a determinant's factors at axis ratio 100.
        let bound = f64::from(settings.tolerance) * (0.5 * r2).exp() * (1.0 + 1e-4);
        depth.add(peak, bound, || format!("{particle:?}, {focal}"));
    }
    depth.finish(1_500);
}
