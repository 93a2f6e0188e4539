//! Elongates particles along their paths while a shutter is open.
//!
//! A kernel that moves by d at an even pace has the mean of the density along its path: its mass, on a line of length L = |d|. The line is
//! n kernels at steps h, elongated to a standard deviation s = .6 h along it, the width at which kernels of a lattice add up evenly. The second
//! moments are those of the line, (n² - 1) h²/12 + s² = L²/12, so h = L / sqrt(n² + 3.32). The fourth cumulants differ by
//! L⁴/120 (1 - (n⁴ - 1)/(n² + 3.32)²). The first term of an Edgeworth series makes that an error at the middle of a kernel of the
//! deviation S along the path, of (L/S)⁴/960 times the same factor of the peak; n is the least number for which it is below
//! [`MOST_ERROR`].

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::math::{factor_of_variance, lower_factor, narrowed};
use crate::memory::left;
use crate::sample::positions::index_u32;
use crate::sample::sampled::Sampled;
use crate::scene::{Particles, StrengthIn};

/// Motion of particles while a shutter is open.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Name of a vector field at points, length per time; or of three scalars, with commas between them.
    pub field: String,
    /// Time that the shutter is open. The middle of it is the data's time.
    pub time: f64,
}

/// Greatest error of a streak at its middle, as a share of its peak.
const MOST_ERROR: f64 = 1.0 / 255.0;

/// Standard deviation of a part of a streak over the step between parts.
const WIDTH: f64 = 0.6;

/// Most parts of a streak: those of a line without width.
const MOST_PARTS: u32 = 16;

/// Returns the step between `n` parts of a line, as a share of its length.
fn step(n: u32) -> f64 {
    let n = f64::from(n);
    (n * n - 1.0 + 12.0 * WIDTH * WIDTH).sqrt().recip()
}

/// Returns the length of a path in deviations of the kernel that goes it: that of y with L y = path. Infinite if the kernel is
/// flat, and the path leads out of its plane.
///
/// - `lower`: the kernel's lower-triangular factor L.
fn deviations([l00, l10, l11, l20, l21, l22]: [f64; 6], path: DVec3) -> f64 {
    let over = |x: f64, l: f64| if x == 0.0 { 0.0 } else { x / l };
    let x = over(path.x, l00);
    let y = over(path.y - l10 * x, l11);
    let z = over(path.z - l20 * x - l21 * y, l22);
    DVec3::new(x, y, z).length()
}

/// Returns the number of parts of a streak.
///
/// - `length`: its length in deviations of the kernel.
fn parts(length: f64) -> u32 {
    // Length over the deviation of the streak along itself.
    let slenderness = (length.powi(-2) + 1.0 / 12.0).sqrt().recip();
    let error = |n: u32| {
        let (square, step) = (f64::from(n) * f64::from(n), step(n));
        let kept = (square * square - 1.0) * step.powi(4);
        slenderness.powi(4) / 960.0 * (1.0 - kept)
    };
    (1..MOST_PARTS)
        .find(|&n| error(n) <= MOST_ERROR)
        .unwrap_or(MOST_PARTS)
}

/// Kernels in which a particle is drawn.
struct Streak {
    parts: u32,
    /// Lower-triangular factor of each.
    factor: [f32; 6],
}

impl Streak {
    /// Returns the kernels of a particle.
    ///
    /// - `factor`: that of its own kernel.
    fn new(factor: DMat3, path: DVec3) -> Self {
        let lower = lower_factor(factor);
        let still = Self {
            parts: 1,
            factor: lower.map(narrowed),
        };
        let length = path.length();
        if !(length > 0.0 && length.is_finite()) {
            return still;
        }
        let parts = parts(deviations(lower, path));
        let along = path * (step(parts) * WIDTH);
        let own = factor * factor.transpose();
        let v = own + DMat3::from_cols(along * along.x, along * along.y, along * along.z);
        let [x, y, z] = [v.x_axis, v.y_axis, v.z_axis];
        let factor = factor_of_variance([x.x, x.y, x.z, y.y, y.z, z.z]);
        factor.map_or(still, |factor| Self {
            parts,
            factor: factor.map(narrowed),
        })
    }
}

/// Replaces particles by those of their streaks. Local models are left out: their kernels are others.
///
/// - `paths`: of the particles, world units; particles whose paths are not finite stay still.
///
/// # Errors
/// More kernels than can be counted, or than the memory has room for.
pub(in crate::sample) fn draw_out(sampled: &mut Sampled, paths: &[DVec3]) -> Result<()> {
    let Sampled { volume, report } = sampled;
    let count = volume.particles.len().min(paths.len());
    let particles = &volume.particles;
    let streak = |i: usize| Streak::new(particles.shape(i).1, paths[i]);
    let streaks: Vec<Streak> = (0..count).into_par_iter().map(streak).collect();
    check_room(streaks.iter().map(|own| u64::from(own.parts)).sum())?;
    let mut sources: Vec<u32> = Vec::with_capacity(count);
    let mut positions = Vec::with_capacity(count);
    let mut factors = Vec::with_capacity(count);
    for (i, (streak, path)) in streaks.iter().zip(paths).enumerate() {
        let (position, _, _) = volume.particles.shape(i);
        let n = streak.parts;
        for part in 0..n {
            let place = (f64::from(part) - 0.5 * f64::from(n - 1)) * step(n);
            sources.push(index_u32(i));
            // A path that is not finite has one part.
            positions.push(match n {
                1 => position,
                _ => position + *path * place,
            });
            factors.push(streak.factor);
        }
    }
    volume.local_models = None;
    volume.gather(&sources);
    if let StrengthIn::Classified { volumes: strengths } | StrengthIn::Mass(strengths) =
        &mut volume.strength
    {
        for (strength, &source) in strengths.iter_mut().zip(&sources) {
            *strength *= 1.0 / streaks[source as usize].parts as f32;
        }
    }
    let still = paths.iter().filter(|path| !path.length().is_finite());
    report.note(
        still.count(),
        "particles",
        "have a velocity that is not finite, and stay still",
    );
    report.particle_count = sources.len();
    volume.particles = Particles::Anisotropic { positions, factors };
    Ok(())
}

/// Refuses more kernels than can be counted, or than the memory has room for.
fn check_room(kernels: u64) -> Result<()> {
    // Position, factor, share, source and columns, while they are made.
    const BYTES: u64 = 128;
    let (least, what) = left().unwrap_or((u64::MAX, ""));
    if kernels <= u64::from(u32::MAX) && kernels.saturating_mul(BYTES) <= least {
        return Ok(());
    }
    Err(Error::invalid(
        "shutter",
        "kernels",
        format!("at most 4,294,967,295, and {BYTES} bytes for each; {what} {least}"),
        format!("{kernels}, as long streaks have up to {MOST_PARTS}"),
        "shorten the time, or render a part of the data",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_the_variance_of_the_line() {
        for n in 1..=MOST_PARTS {
            let (count, step) = (f64::from(n), step(n));
            let places = (count * count - 1.0) / 12.0 * step * step;
            let variance = places + (WIDTH * step).powi(2);
            assert!((variance - 1.0 / 12.0).abs() < 1e-12, "{n}");
        }
        // A short way keeps one kernel; a line needs the most that there are.
        assert_eq!(parts(1.0), 1);
        assert_eq!(parts(f64::INFINITY), MOST_PARTS);
    }

    #[test]
    fn paths_across_flat_kernels_are_long() {
        // Deviations of 1 and .05, the narrow one tilted by 45 degrees; the path leads across.
        let axes = DMat3::from_rotation_z(std::f64::consts::FRAC_PI_4);
        let factor = |thin: f64| axes * DMat3::from_diagonal(DVec3::new(1.0, thin, 1.0));
        let across = axes * DVec3::Y;
        let length = |thin, path| deviations(lower_factor(factor(thin)), path);
        assert!((length(0.05, across * 0.9) - 18.0).abs() < 1e-9);
        assert!((length(0.05, axes * DVec3::X * 0.9) - 0.9).abs() < 1e-9);
        // Along x alone, most of the way is across the sheet.
        assert!(length(0.05, DVec3::X * 0.9) > 12.0);
        assert!(parts(length(1e-300, across)) == MOST_PARTS);
    }

    /// Profile of a kernel of unit deviation on a way of length `length`, at `x`: the mean of the Gaussian over the way.
    fn mean(length: f64, x: f64) -> f64 {
        let steps = 4000;
        let sum: f64 = (0..steps)
            .map(|i| {
                let at = x - length * ((f64::from(i) + 0.5) / f64::from(steps) - 0.5);
                (-0.5 * at * at).exp()
            })
            .sum();
        sum / f64::from(steps)
    }

    #[test]
    fn streaks_are_means_over_the_way() {
        for length in [0.3, 1.0, 2.0, 4.0, 8.0, 20.0, 60.0] {
            let n = parts(length);
            let step = length * step(n);
            let sigma = (1.0 + (WIDTH * step).powi(2)).sqrt();
            let drawn = |x: f64| -> f64 {
                let part = |i: u32| {
                    let at = x - (f64::from(i) - 0.5 * f64::from(n - 1)) * step;
                    (-0.5 * (at / sigma).powi(2)).exp() / sigma
                };
                (0..n).map(part).sum::<f64>() / f64::from(n)
            };
            let peak = mean(length, 0.0);
            let reach = 0.5 * length + 4.0;
            let places = (0..400).map(|i| reach * f64::from(i) / 400.0);
            let error = places
                .map(|x| (drawn(x) - mean(length, x)).abs() / peak)
                .fold(0.0, f64::max);
            println!("{length}: {n} parts, {error:.4}");
            // Ends of long lines are rounded over a part's width.
            let bound = if length <= 4.0 {
                3.0 * MOST_ERROR
            } else {
                0.25
            };
            assert!(error < bound, "{length}: {n} parts, {error}");
        }
    }
}
