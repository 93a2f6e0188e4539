//! Tests section 6: one table in one dimension gives the footprint of every kernel and view, and finite differences
//! give its argument. Claims: one table suffices; two additions a pixel.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "an index into a table"
)]

use ewa_splat::Result;

use crate::papers::Arguments;

/// Threshold of the paper, up to which the radial index is evaluated.
const PAPER_THRESHOLD: f64 = 4.0;
/// Threshold of the renderer at the default tolerance, for kernels of depth 1.
const WIDER_THRESHOLD: f64 = 14.6;

pub(crate) fn run(_: &Arguments) -> Result<()> {
    println!(
        "largest error of a table of exp(-r/2), as a share of the peak; the same for all kernels"
    );
    println!(
        "{:>8} {:>16} {:>16} {:>16} {:>16}",
        "entries", "nearest, r <= 4", "linear, r <= 4", "nearest, 14.6", "linear, 14.6"
    );
    for entries in [64, 256, 1024, 4096] {
        let [a, b] = table_errors(entries, PAPER_THRESHOLD);
        let [c, d] = table_errors(entries, WIDER_THRESHOLD);
        println!("{entries:>8} {a:>16.1e} {b:>16.1e} {c:>16.1e} {d:>16.1e}");
    }
    println!("left out beyond the threshold: exp(-r/2) at the edge, and as much of the mass");
    for threshold in [PAPER_THRESHOLD, 9.0, WIDER_THRESHOLD] {
        println!("{threshold:>8} {:>16.1e}", (-0.5 * threshold).exp());
    }
    println!(
        "largest error of exp(-r/2), r by finite differences in f32 from the first pixel of a row"
    );
    println!(
        "{:>8} {:>12} {:>12} {:>12}",
        "pixels", "axes 1:1", "1:10", "1:100"
    );
    for row in [16, 64, 256, 1024] {
        let [a, b, c] = [1.0, 10.0, 100.0].map(|ratio| difference_error(row, ratio));
        println!("{row:>8} {a:>12.1e} {b:>12.1e} {c:>12.1e}");
    }
    Ok(())
}

/// Returns the largest errors of the nearest entry and of linear interpolation, in a table up to `threshold`.
fn table_errors(entries: usize, threshold: f64) -> [f64; 2] {
    let step = threshold / (entries - 1) as f64;
    let table: Vec<f64> = (0..entries)
        .map(|i| (-0.5 * i as f64 * step).exp())
        .collect();
    let mut errors = [0.0_f64; 2];
    for i in 0..100_000 {
        let r = threshold * f64::from(i) / 1e5;
        let place = r / step;
        let below = (place as usize).min(entries - 2);
        let linear = table[below] + (table[below + 1] - table[below]) * (place - below as f64);
        let nearest = table[place.round() as usize];
        for (error, found) in errors.iter_mut().zip([nearest, linear]) {
            *error = error.max((found - (-0.5 * r).exp()).abs());
        }
    }
    errors
}

/// Returns the largest error of exp(-r/2) along rows of `pixels` across ellipses as wide as the rows, at all angles.
fn difference_error(pixels: u16, ratio: f64) -> f64 {
    let half = 0.5 * f64::from(pixels);
    let long = half / WIDER_THRESHOLD.sqrt();
    let mut worst = 0.0_f64;
    for turn in 0..64 {
        let angle = std::f64::consts::PI * f64::from(turn) / 64.0;
        let (sin, cos) = angle.sin_cos();
        let [p, q] = [long, long / ratio].map(|s| (s * s).recip());
        // r = a x² + 2 b x y + c y².
        let a = cos * cos * p + sin * sin * q;
        let b = sin * cos * (p - q);
        let c = sin * sin * p + cos * cos * q;
        for line in 0..8 {
            let y = half * (f64::from(line) / 8.0 - 0.5);
            let radial = |x: f64| a * x * x + 2.0 * b * x * y + c * y * y;
            let x0 = -half + 0.5;
            let mut r = radial(x0) as f32;
            let mut change = (radial(x0 + 1.0) - radial(x0)) as f32;
            let second = (2.0 * a) as f32;
            for i in 0..pixels {
                let exact = (-0.5 * radial(x0 + f64::from(i))).exp();
                worst = worst.max((f64::from(-0.5 * r).exp() - exact).abs());
                r += change;
                change += second;
            }
        }
    }
    worst
}
