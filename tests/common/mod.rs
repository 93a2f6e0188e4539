//! What several test files share.
#![allow(dead_code, reason = "each test file uses a part")]

use ewa_splat::layout::ViewUniform;
use ewa_splat::math::Factor;
use ewa_splat::splat::{Filter, Kernel};
use glam::Vec3;
use serde_json::Value;

/// A JSON file of `fixtures/`.
pub fn fixture(name: &str) -> Value {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The number at a JSON pointer.
pub fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("no {pointer}"))
}

/// The numbers at a JSON pointer.
pub fn numbers(value: &Value, pointer: &str) -> Vec<f64> {
    let list = value.pointer(pointer).and_then(Value::as_array);
    let list = list.unwrap_or_else(|| panic!("no {pointer}"));
    list.iter().map(|v| v.as_f64().unwrap()).collect()
}

/// A kernel from camera-space rows of its factor.
pub fn kernel(centre: [f32; 3], rows: [[f32; 3]; 3], mass: f32) -> Kernel {
    let [x, y, z] = rows.map(Vec3::from);
    Kernel { centre: Vec3::from(centre), factor: Factor { x, y, z }, mass }
}

/// A perspective view of 1024 x 768.
pub fn view(focal_px: [f32; 2], centre_px: [f32; 2], h2: f32) -> ViewUniform {
    ViewUniform {
        focal_px,
        centre_px,
        size: [1024, 768],
        orthographic: 0,
        filter: Filter::Exact as u32,
        low_pass_variance_px2: h2,
        tolerance: 1.0 / 255.0,
        cutoff: 0.0,
        key_scale: 1.0,
    }
}

/// One splat's evaluation at a pixel in its plainest form, f32: what the rasteriser's vector loop
/// must equal.
pub mod scalar {
    use ewa_splat::layout::{ExactTerms, ViewUniform};
    use ewa_splat::splat::{ImageKernel, ScreenFactor};
    use glam::{Vec2, Vec3};

    /// (Q, tau) of the affine footprint.
    pub fn affine(screen: &ScreenFactor, image: &ImageKernel, pixel: Vec2) -> (f32, f32) {
        let d = pixel - screen.centre_px;
        let [p, r] = image.triangular_form().map(Vec2::from);
        let q = p.dot(d).powi(2) + r.dot(d).powi(2);
        (q, image.tau * (-0.5 * q).exp())
    }

    /// (w, tau) of the exact footprint.
    pub fn exact(
        view: &ViewUniform,
        screen: &ScreenFactor,
        image: &ImageKernel,
        terms: &ExactTerms,
        pixel: Vec2,
    ) -> (f32, f32) {
        let d = pixel - screen.centre_px;
        let [hxx, hxy, hyy] = terms.hessian;
        let w = 1.0
            + Vec2::from(terms.gradient).dot(d)
            + hxx * d.x * d.x
            + hxy * d.x * d.y
            + hyy * d.y * d.y;
        let (q, _) = affine(screen, image, pixel);
        let slope = (pixel - Vec2::from(view.centre_px)) / Vec2::from(view.focal_px);
        let ray = Vec3::new(slope.x, slope.y, 1.0).length();
        (w, image.tau * ray / screen.ray_length / w.sqrt() * (-0.5 * q / w).exp())
    }
}
