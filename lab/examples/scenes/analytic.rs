//! Renders reference images of analytic fields.

use ewa_splat::scene::TransferFunction;
use ewa_splat::stages::scene::Weighting;
use ewa_splat::view::Camera;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Integrates emission and absorption of a field over [-1, 1]³; returns premultiplied linear RGBA of each pixel. Each
/// of `steps` steps of a ray averages the transfer function over its values, and a pixel is the mean of `rays`² rays.
#[allow(
    clippy::cast_possible_truncation,
    reason = "transfer functions take values in f32"
)]
pub(crate) fn truth(
    camera: &Camera,
    transfer: &TransferFunction,
    field: impl Fn(DVec3) -> f64 + Sync,
    rays: usize,
    steps: usize,
) -> Vec<[f64; 4]> {
    let averages = transfer.averages(Weighting::Extinction);
    let [width, height] = [camera.width, camera.height];
    let world_from_camera = camera.camera_from_world.transpose();
    let ray = |pixel: DVec2| {
        let slope = (pixel - camera.centre_px) / camera.focal_px;
        let direction = (world_from_camera * slope.extend(1.0)).normalize();
        let inverse = direction.recip();
        let (a, b) = (
            (DVec3::NEG_ONE - camera.eye) * inverse,
            (DVec3::ONE - camera.eye) * inverse,
        );
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element();
        let mut out = [0.0; 4];
        if !(near < far) {
            return out;
        }
        let step = (far - near) / steps as f64;
        let mut through = 1.0;
        let mut before = field(camera.eye + direction * near);
        for i in 1..=steps {
            let after = field(camera.eye + direction * (near + i as f64 * step));
            let (middle, half) = (0.5 * (before + after), 0.5 * (after - before));
            let [r, g, b, extinction] = averages
                .classify_spread(middle as f32, half as f32)
                .map(f64::from);
            let left = (-extinction * step).exp();
            for (sum, c) in out.iter_mut().zip([r, g, b, 1.0]) {
                *sum += through * (1.0 - left) * c;
            }
            through *= left;
            before = after;
        }
        out
    };
    (0..width * height)
        .into_par_iter()
        .map(|i| {
            let corner = DVec2::new((i % width) as f64, (i / width) as f64);
            let mut sum = [0.0; 4];
            for n in 0..rays * rays {
                let at = DVec2::new((n % rays) as f64, (n / rays) as f64) + 0.5;
                for (sum, c) in sum.iter_mut().zip(ray(corner + at / rays as f64)) {
                    *sum += c / (rays * rays) as f64;
                }
            }
            sum
        })
        .collect()
}
