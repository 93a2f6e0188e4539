//! Compares the footprint evaluation of Zwicker et al. 2001 (section 6) with the renderer's.
//!
//! The paper updates the radial index Q along a row of pixels by two additions each, and looks exp(-Q/2) up in a table.
//! The renderer evaluates Q from its triangular form and the exponential by a series, separately for each pixel
//! (`src/cpu/tile/accumulate/over.rs`). The benchmark prints the largest error, as a share of the footprint's peak,
//! then the time per pixel. Both are compiled for the processor's vectors.
//!
//! On an AMD EPYC with AVX2 direct evaluation takes .42 to .65 ns a pixel; forward differences take 3 to 3.7 times as
//! long. Each step waits for the one before, and even side by side each pixel still looks up its own entry. The error
//! of forward differences is that of the table, .01 for 256 entries and .003 for 1024. In long rows of narrow kernels
//! it is that of the recurrence: .18 of the peak at 1:100 over 1024 pixels, .7 over 4096. Direct evaluation is within
//! 2e-6 throughout.
//!
//! `cargo bench -p ewa-splat-lab --bench forward_differences`
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "inputs are narrowed on purpose; indices of tables are clamped"
)]

use std::hint::black_box;
use std::time::{Duration, Instant};

use ewa_splat::stages::constants::{EXP2_SERIES, MAX_CUTOFF};

/// Cut-off radius, standard deviations: that of the default tolerance for a faint kernel.
const CUTOFF: f32 = 3.33;
const CUTOFF_SQUARED: f32 = CUTOFF * CUTOFF;

/// Lengths of rows, pixels: a tile's, and lengths at which the errors of recurrences are known.
const ROWS: [usize; 4] = [16, 64, 1024, 4096];
const RATIOS: [f64; 3] = [1.0, 10.0, 100.0];

/// A footprint of peak 1 whose bounding box is a row wide.
struct Footprint {
    /// Rows of the triangular form, pixels: Q = (p . d)² + (r . d)².
    p: [f32; 2],
    r: [f32; 2],
    /// Conic of the paper: Q = a dx² + 2 b dx dy + c dy².
    conic: [f32; 3],
    /// Conic in f64.
    exact: [f64; 3],
    /// Half the height of the box.
    half_height: f64,
}

impl Footprint {
    fn new(width: usize, ratio: f64, angle: f64) -> Self {
        let (s, c) = angle.sin_cos();
        // Variances of a unit major axis, and the scale that makes the box as wide as the row.
        let minor2 = 1.0 / (ratio * ratio);
        let scale = width as f64 / (2.0 * f64::from(CUTOFF) * (c * c + s * s * minor2).sqrt());
        let [vxx, vxy, vyy] = [
            c * c + s * s * minor2,
            c * s * (1.0 - minor2),
            s * s + c * c * minor2,
        ]
        .map(|v| v * scale * scale);
        // From the axes, not as a difference.
        let determinant = minor2 * scale.powi(4);
        let exact = [vyy / determinant, -vxy / determinant, vxx / determinant];
        let (p, r) = if vxx >= vyy {
            let s = (vxx / determinant).sqrt();
            ([1.0 / vxx.sqrt(), 0.0], [-(vxy / vxx) * s, s])
        } else {
            let s = (vyy / determinant).sqrt();
            ([0.0, 1.0 / vyy.sqrt()], [s, -(vxy / vyy) * s])
        };
        Self {
            p: p.map(|x| x as f32),
            r: r.map(|x| x as f32),
            conic: exact.map(|x| x as f32),
            exact,
            half_height: f64::from(CUTOFF) * vyy.sqrt(),
        }
    }
}

/// Returns exp(-q/2) as the renderer evaluates it.
#[inline(always)]
fn exp_minus_half(q: f32) -> f32 {
    const ROUND_TO_EXPONENT: f32 = 12_582_912.0 + 127.0;
    let y = q * (-0.5 * std::f32::consts::LOG2_E);
    let shifted = y + ROUND_TO_EXPONENT;
    let f = y - (shifted - ROUND_TO_EXPONENT);
    let power = f32::from_bits(shifted.to_bits() << 23);
    let [c0, c1, c2, c3] = EXP2_SERIES;
    let series = c3.mul_add(f, c2).mul_add(f, c1).mul_add(f, c0);
    power.mul_add(series.mul_add(f, std::f32::consts::LN_2) * f, power)
}

/// Table of exp(-Q/2) at `len` values of Q from 0 to the cut-off; looked up at the nearest value.
struct Table {
    entries: Vec<f32>,
    scale: f32,
}

impl Table {
    fn new(len: usize) -> Self {
        let step = f64::from(CUTOFF_SQUARED) / (len - 1) as f64;
        Self {
            entries: (0..len)
                .map(|i| (-0.5 * step * i as f64).exp() as f32)
                .collect(),
            scale: (1.0 / step) as f32,
        }
    }

    #[inline(always)]
    fn at(&self, q: f32) -> f32 {
        self.entries[((q * self.scale + 0.5).max(0.0) as u32 as usize).min(self.entries.len() - 1)]
    }
}

/// A method that adds a footprint's row to sums.
trait Method {
    /// Adds a row.
    ///
    /// - `dx`, `dy`: offset of the first pixel from the centre.
    fn add(&self, footprint: &Footprint, dx: f32, dy: f32, sums: &mut [f32]);
}

/// Pixels that are evaluated together, as many as in a tile's row.
const LANES: usize = 16;

struct Direct;

impl Method for Direct {
    #[inline(always)]
    fn add(&self, footprint: &Footprint, dx: f32, dy: f32, sums: &mut [f32]) {
        let ([px, py], [rx, ry]) = (footprint.p, footprint.r);
        let (p_row, r_row) = (py * dy, ry * dy);
        for (i, chunk) in sums.chunks_exact_mut(LANES).enumerate() {
            let dx_chunk = dx + (i * LANES) as f32;
            for (lane, sum) in chunk.iter_mut().enumerate() {
                let dx = dx_chunk + lane as f32;
                let p = px.mul_add(dx, p_row);
                let r = rx.mul_add(dx, r_row);
                let q = p.mul_add(p, r * r);
                let value = exp_minus_half(q.min(MAX_CUTOFF * MAX_CUTOFF));
                *sum += if q <= CUTOFF_SQUARED { value } else { 0.0 };
            }
        }
    }
}

/// Forward differences in `LANES` interleaved runs: one as in the paper, more for vectors.
struct Forward<'a, const LANES: usize> {
    /// Table, or `None` to evaluate the exponential, which shows the error of the recurrence alone.
    table: Option<&'a Table>,
}

impl<const LANES: usize> Method for Forward<'_, LANES> {
    #[inline(always)]
    fn add(&self, footprint: &Footprint, dx: f32, dy: f32, sums: &mut [f32]) {
        let [a, b, c] = footprint.conic;
        let stride = LANES as f32;
        let (mut q, mut change) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let x = dx + lane as f32;
            q[lane] = a * x * x + 2.0 * b * x * dy + c * dy * dy;
            change[lane] = a * stride * (2.0 * x + stride) + 2.0 * b * stride * dy;
        }
        let bend = 2.0 * a * stride * stride;
        for chunk in sums.chunks_exact_mut(LANES) {
            for lane in 0..LANES {
                let now = q[lane];
                let value = match self.table {
                    Some(table) => table.at(now),
                    None => exp_minus_half(now.clamp(0.0, MAX_CUTOFF * MAX_CUTOFF)),
                };
                chunk[lane] += if now <= CUTOFF_SQUARED { value } else { 0.0 };
                q[lane] = now + change[lane];
                change[lane] += bend;
            }
        }
    }
}

/// Returns the largest error of a method over rows of footprints at several angles.
fn error(method: &impl Method, width: usize, ratio: f64) -> f64 {
    const ANGLES: usize = 12;
    const ROWS_EACH: usize = 33;
    let mut worst = 0.0_f64;
    let mut sums = vec![0.0; width];
    for i in 0..ANGLES {
        // Not exactly along an axis.
        let angle = (i as f64 + 0.3) / ANGLES as f64 * std::f64::consts::PI;
        let footprint = Footprint::new(width, ratio, angle);
        for k in 0..ROWS_EACH {
            let dy = (footprint.half_height * (k as f64 / 16.0 - 1.0)) as f32;
            let dx = (0.5 - width as f64 / 2.0) as f32;
            sums.fill(0.0);
            method.add(&footprint, dx, dy, &mut sums);
            for (n, found) in sums.iter().enumerate() {
                let (x, y) = (f64::from(dx) + n as f64, f64::from(dy));
                let [a, b, c] = footprint.exact;
                let q = a * x * x + 2.0 * b * x * y + c * y * y;
                // Either result is right at the edge of the cut-off.
                if q <= 0.999 * f64::from(CUTOFF_SQUARED) {
                    worst = worst.max((f64::from(*found) - (-0.5 * q).exp()).abs());
                }
            }
        }
    }
    worst
}

/// Returns nanoseconds per pixel, the least of many runs, with the processor's vectors.
fn time(method: &impl Method, width: usize) -> f64 {
    const RUN: Duration = Duration::from_millis(400);
    const PIXELS: usize = 1 << 16;
    let footprint = Footprint::new(width, 3.0, 0.5);
    let rows = PIXELS / width;
    let mut sums = vec![0.0; width];
    let arch = pulp::Arch::new();
    let (start, mut least) = (Instant::now(), f64::INFINITY);
    while start.elapsed() < RUN {
        let run = Instant::now();
        arch.dispatch(
            #[inline(always)]
            || {
                for k in 0..rows {
                    let dy = k as f32 / rows as f32 - 0.5;
                    let dx = 0.5 - width as f32 / 2.0;
                    method.add(black_box(&footprint), dx, dy, &mut sums);
                }
            },
        );
        black_box(&mut sums);
        least = least.min(run.elapsed().as_secs_f64() * 1e9 / PIXELS as f64);
    }
    least
}

fn main() {
    let (small, large) = (Table::new(256), Table::new(1024));
    let forward = |table| Forward::<1> { table };
    println!("largest error, share of the peak; rows of pixels, axis ratios");
    println!("  row  ratio    direct  forward+exp  forward+256  forward+1024");
    for width in ROWS {
        for ratio in RATIOS {
            println!(
                "{width:>5}  {ratio:>5}   {:.1e}      {:.1e}      {:.1e}       {:.1e}",
                error(&Direct, width, ratio),
                error(&forward(None), width, ratio),
                error(&forward(Some(&small)), width, ratio),
                error(&forward(Some(&large)), width, ratio),
            );
        }
    }
    println!("ns per pixel, and as a ratio to direct");
    println!("  row  direct   forward+256   forward+1024  16 lanes+256  16 lanes+1024");
    for width in ROWS {
        let direct = time(&Direct, width);
        let lanes = |table| Forward::<LANES> { table: Some(table) };
        let others = [
            time(&forward(Some(&small)), width),
            time(&forward(Some(&large)), width),
            time(&lanes(&small), width),
            time(&lanes(&large), width),
        ];
        let [a, b, c, d] = others.map(|ns| format!("{ns:.3} ({:.1}x)", ns / direct));
        println!("{width:>5}  {direct:>6.3}  {a:>12}  {b:>12}  {c:>12}  {d:>12}");
    }
}
