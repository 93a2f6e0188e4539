//! Every approximation with a stated bound, against f64 judges over thousands of random cases:
//! measured <= bound, and how much room is left.
//!
//! `cargo test --test bounds -- --nocapture` prints a table, one bound a line: cases, worst and
//! median ratio of the measured error to the bound. A worst ratio far below 1 is a bound too
//! loose.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

mod common;

use std::f64::consts::TAU;

use common::Random;
use common::draw::{Draw, EPS, draw, judged, ray};
use common::judge::{self, Body};
use ewa_splat::layout::ViewUniform;
use ewa_splat::splat::{
    Filter, ImageKernel, Kernel, ScreenFactor, affine_error, cutoff_radius, cutoff_share,
    exact_terms, opacity_amplification, project_kernel,
};
use glam::{DVec2, DVec3, Vec2};

/// One line of the table: what was measured over what was promised.
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

    /// Takes a case in.
    fn add(&mut self, measured: f64, bound: f64, case: impl FnOnce() -> String) {
        let ratio = measured / bound;
        // Phrased so that NaN is the worst.
        if !(ratio <= self.worst.0) {
            self.worst = (ratio, format!("{measured:e} against {bound:e}: {}", case()));
        }
        self.ratios.push(ratio);
    }

    /// Prints the line. The bound holds, for enough cases, and is not a hundred times too loose.
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

/// The greatest value of a function of the plane, by a polar grid to radius 6 (exp(-18) of a
/// footprint lies beyond) and a descent of steps from its best point.
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

/// The kernel with all but `rank` of its dimensions flattened to nothing.
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

/// A kernel with its footprint, its bound on the affine error and what judges that.
struct Case {
    view: ViewUniform,
    kernel: Kernel,
    screen: ScreenFactor,
    image: ImageKernel,
    bound: f64,
    body: Body,
    cholesky: glam::DMat2,
    /// sqrt(largest eigenvalue over smallest) of the footprint.
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

    /// The exact line integral at offset `cholesky * a`, relative to the centre's.
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

/// Kernels of every rank, with and without low-pass filter, needles to 1:10,000, up to
/// 80 degrees off the axis or all but on it, standard deviations 1e-4 to .3 of the distance.
fn cases(seed: u64, count: usize) -> impl Iterator<Item = (usize, Case)> {
    let mut random = Random::new(seed);
    (0..count).map(move |i| {
        let rank = [3, 3, 3, 2, 1, 0][i % 6];
        let h2 = if rank == 3 { [1.0, 0.0][i % 2] } else { 1.0 };
        let from = Draw {
            ratio: 1e4,
            size: [1e-4, 0.3],
            // On the axis the error has other terms.
            off_axis_deg: if random.index(4) == 0 { 0.01 } else { 80.0 },
            h2,
        };
        let (view, kernel) = draw(&mut random, from);
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
        // Some sixteen roundings of the bound's own terms, and the judge's cancellation.
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
        // The promise of the exact path's documentation for roundings.
        let rounding = 6e-6 + 4.0 * EPS * case.axis_ratio;
        evaluated.add(error, case.bound + rounding, || case.describe());
    }
    for slack in by_rank {
        slack.finish(2_000);
    }
    evaluated.finish(12_000);
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
        // An error above 1 is none: every opacity is below.
        if bound < 1.0 {
            let error = greatest(|a| {
                let affine = tau * (-0.5 * a.length_squared()).exp();
                ((-affine).exp() - (-tau * case.exact(a)).exp()).abs()
            });
            // The judge's cancellation, as above.
            let case = || format!("tau {tau}, {}", case.describe());
            slack.add(error, bound + 1e-9, case);
        }
    }
    faint.finish(3_000);
    opaque.finish(4_000);
}
