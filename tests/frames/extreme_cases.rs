//! Evaluates the 40 extreme cases of `fixtures/extreme_cases.json` (digits from 60-digit
//! arithmetic) by the f32 formulas.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic; the path under test is f32"
)]

use crate::common::{fixture, kernel, number, numbers, scalar, view};
use ewa_splat::stages::record::ViewUniform;
use ewa_splat::stages::splat::{
    Filter, Kernel, evaluate_near, exact_extent, exact_terms, near_terms, project_kernel,
};
use glam::{Vec2, Vec3};
use serde_json::Value;

/// At most 6e-6 of the peak. Some sixteen f32 roundings of 6e-8 each, and the rounding of a pixel
/// coordinate near 600 (3e-5 px at a slope of .6 per px over a standard deviation of several px).
/// The worst published case of this path has 5.5e-6.
const TOLERANCE_OF_PEAK: f64 = 6e-6;

fn cases(kind: &str) -> Vec<Value> {
    let all = fixture("extreme_cases.json");
    let list: Vec<Value> = all["cases"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|c| c["kind"] == kind)
        .cloned()
        .collect();
    assert!(!list.is_empty(), "no case of kind {kind}");
    list
}

fn setup(case: &Value) -> (ViewUniform, Kernel) {
    let n = |p: &str| number(case, p) as f32;
    let mut v = view(
        [n("/input/camera/fx"), n("/input/camera/fy")],
        [n("/input/camera/cx"), n("/input/camera/cy")],
        n("/input/lowpass_h2_px2"),
    );
    v.orthographic = u32::from(case["input"]["camera"]["model"] == "orthographic");
    let row = |i: usize| {
        let r = numbers(case, &format!("/input/factor_L_rows/{i}"));
        [r[0] as f32, r[1] as f32, r[2] as f32]
    };
    let c = numbers(case, "/input/mean_cam");
    let centre = [c[0] as f32, c[1] as f32, c[2] as f32];
    (
        v,
        kernel(centre, [row(0), row(1), row(2)], n("/input/mass_g")),
    )
}

fn pixels(case: &Value) -> Vec<Vec2> {
    let list = case["input"]["pixels"].as_array().unwrap();
    let at = |p: &Value, i: usize| p[i].as_f64().unwrap() as f32;
    list.iter().map(|p| Vec2::new(at(p, 0), at(p, 1))).collect()
}

#[test]
fn footprints_affine_and_exact() {
    let mut tested = 0;
    for case in cases("footprint") {
        let name = case["name"].as_str().unwrap();
        let (v, k) = setup(&case);
        if case["expected"].get("tau_ewa").is_none() || k.centre.z <= 0.0 {
            continue;
        }
        tested += 1;
        let screen = project_kernel(&v, &k);
        let image = screen.filtered(Filter::Ewa, v.low_pass_variance_px2);
        let peak = number(&case, "/expected/tau_peak_ewa");

        let determinant = number(&case, "/expected/cov2_det");
        let error = (f64::from(image.determinant) - determinant).abs() / determinant;
        // Products of twelve roundings; the published worst of this path is 2.5e-7.
        assert!(
            error < 2e-6,
            "{name}: determinant {} for {determinant}",
            image.determinant
        );

        // A peak that underflows below f32's normal range has no relative precision.
        let allowed = TOLERANCE_OF_PEAK * peak;
        let ewa = numbers(&case, "/expected/tau_ewa");
        let exact = case["expected"]
            .get("tau_exact")
            .map(|_| numbers(&case, "/expected/tau_exact"));
        let terms = exact_terms(&screen, v.low_pass_variance_px2, image.determinant);
        for (i, pixel) in pixels(&case).into_iter().enumerate() {
            let (_, tau) = scalar::affine(&screen, &image, pixel);
            let error = (f64::from(tau) - ewa[i]).abs();
            assert!(
                error <= allowed,
                "{name}: affine pixel {i}: {tau} for {}",
                ewa[i]
            );
            if v.orthographic != 0 {
                continue;
            }
            if let Some(exact) = &exact {
                let (w, tau) = scalar::exact(&v, &screen, &image, &terms, pixel);
                let error = (f64::from(tau) - exact[i]).abs();
                assert!(
                    error <= allowed,
                    "{name}: exact pixel {i}: {tau} for {}",
                    exact[i]
                );
                let expected = numbers(&case, "/expected/w")[i];
                // w is a sum of terms up to the square of the pixel's distance in widths.
                let error = (f64::from(w) - expected).abs() / expected.max(1.0);
                assert!(error < 2e-5, "{name}: w {w} for {expected}");
            }
        }
    }
    assert!(tested >= 21, "only {tested} cases ran");
}

#[test]
fn exact_bounds_of_the_three_sigma_ellipsoid() {
    let mut tested = 0;
    for case in cases("footprint") {
        let name = case["name"].as_str().unwrap();
        let (v, k) = setup(&case);
        let Some(bounds) = case["expected"].get("bbox_exact_r3_px") else {
            continue;
        };
        if v.orthographic != 0 {
            continue;
        }
        if k.centre.z <= 0.0 {
            assert!(bounds.is_null(), "{name}");
            continue;
        }
        let screen = project_kernel(&v, &k);
        let extent = exact_extent(&screen, v.low_pass_variance_px2, 3.0);
        assert_eq!(extent.is_some(), !bounds.is_null(), "{name}");
        let Some((middle, half)) = extent else {
            continue;
        };
        tested += 1;
        for axis in 0..2 {
            let expected = numbers(&case, &format!("/expected/bbox_exact_r3_px/{axis}"));
            for (sign, expected) in [(-1.0, expected[0]), (1.0, expected[1])] {
                let got = screen.centre_px[axis] + middle[axis] + sign * half[axis];
                // The rounding of the pixel coordinate, and sixteen roundings of the extent.
                let allowed = 1e-6 * (expected.abs() + f64::from(half[axis])) + 1e-5;
                let error = (f64::from(got) - expected).abs();
                assert!(error < allowed, "{name}: {got} for {expected}");
            }
        }
    }
    assert!(tested >= 18, "only {tested} cases ran");
}

#[test]
fn kernels_at_and_behind_the_camera_plane() {
    let mut tested = 0;
    for case in cases("footprint") {
        let name = case["name"].as_str().unwrap();
        if case["expected"].get("tau_exact_half_line").is_none() {
            continue;
        }
        tested += 1;
        let (v, k) = setup(&case);
        let expected = numbers(&case, "/expected/tau_exact_half_line");
        let peak = expected.iter().fold(0.0_f64, |a, &b| a.max(b));
        let (terms, weight) = near_terms(&v, &k).unwrap();
        for (i, pixel) in pixels(&case).into_iter().enumerate() {
            let slope = (pixel - Vec2::from(v.centre_px)) / Vec2::from(v.focal_px);
            let tau = evaluate_near(&terms, weight, Vec3::new(slope.x, slope.y, 1.0), 49.0);
            let error = (f64::from(tau) - expected[i]).abs();
            assert!(
                error <= TOLERANCE_OF_PEAK * peak,
                "{name}: {tau} for {}",
                expected[i]
            );
        }
    }
    assert_eq!(tested, 3);
}

#[test]
fn offsets_from_the_origin_are_subtracted_in_f64() {
    for case in cases("offset") {
        let eye = numbers(&case, "/input/eye_world_f64");
        let mean = numbers(&case, "/input/mean_world_f64");
        let mut camera = ewa_splat::view::Camera::perspective(
            glam::DVec3::from_slice(&eye),
            glam::DVec3::from_slice(&eye) + glam::DVec3::Z,
            -glam::DVec3::Y,
            90.0,
            [1024, 768],
        );
        camera.focal_px = glam::DVec2::splat(number(&case, "/input/camera/fx"));
        let centre = camera.camera_point(glam::DVec3::from_slice(&mean));
        assert_eq!(
            centre.to_array().to_vec(),
            numbers(&case, "/expected/mean_cam")
        );
        let pixel = camera.project(glam::DVec3::from_slice(&mean)).unwrap();
        assert_eq!(
            pixel.to_array().to_vec(),
            numbers(&case, "/expected/center_px")
        );
    }
}

#[test]
fn quadratic_rows_evaluated_directly() {
    for case in cases("quad_row") {
        let n = |p: &str| number(&case, p) as f32;
        let (a, b, c) = (n("/input/A"), n("/input/B"), n("/input/C"));
        // Q = A x² + 2 B x y + C y² in the triangular form of its inverse.
        let determinant = a * c - b * b;
        let image = ewa_splat::stages::splat::ImageKernel {
            a: c / determinant,
            b: -b / determinant,
            c: a / determinant,
            determinant: 1.0 / determinant,
            tau: 1.0,
            enlargement: 1.0,
        };
        let [p, r] = image.triangular_form().map(Vec2::from);
        let expected = numbers(&case, "/expected/Q");
        for (i, index) in numbers(&case, "/input/indices").into_iter().enumerate() {
            let d = Vec2::new(n("/input/x0") + index as f32, n("/input/dy"));
            let q = p.dot(d).powi(2) + r.dot(d).powi(2);
            let error = (f64::from((-0.5 * q).exp()) - (-0.5 * expected[i]).exp()).abs();
            assert!(
                error < TOLERANCE_OF_PEAK,
                "index {index}: {q} for {}",
                expected[i]
            );
        }
    }
}
