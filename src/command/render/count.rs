//! Describes the output of `ewa-splat render --show count`.

use crate::Image;

/// Describes the counts in a picture and the meaning of its colours.
pub(crate) fn describe(count: &Image, is_png: bool) -> String {
    let numbers = || count.pixels.iter().map(|p| p[0]);
    let greatest = numbers().fold(0.0, f32::max);
    let sum: f64 = numbers().map(f64::from).sum();
    let mean = sum / count.pixels.len().max(1) as f64;
    let colours = if is_png {
        format!("; colours: viridis from 0 to {greatest}")
    } else {
        String::new()
    };
    format!("kernels per pixel: {greatest} at most, {mean:.1} on average{colours}")
}
