//! Converts scenes to splats, which viewers of radiance fields can draw.
//!
//! Splats have a peak opacity, the same from every side: alpha = peak x exp(-Q/2). Volumes and surfaces have
//! depth instead, so conversion approximates:
//!
//! | scene | opacity |
//! |---|---|
//! | volumes, absorbing sheets | 1 - exp(-g / (2 pi s1 s2)): the opacity of the kernel along its shortest axis, with s1 and s2 the two greatest standard deviations. The inverse of a table's column `opacity`. From other sides a volume is deeper than its splat. |
//! | opaque surfaces | 1, or twice the visible share if that is less than half (masks) |
//! | translucent surfaces | the opacity that keeps the optical depth, averaged over the surface: see [`translucent_splat`] |
//! | splats | their own |
//!
//! Colours are encoded as sRGB; the coefficient of the constant harmonic follows from the code. Surfels get the
//! axes of their variance: the third has no length and points along the front's normal.

use std::f64::consts::TAU;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use crate::data::splats::{SplatCloud, constants_of_light};
use crate::error::{Error, Hint, Result};
use crate::math::{harmonics_count, lower_matrix, narrowed, scales_and_rotation};
use crate::sample::left_out::LeftOut;
use crate::sample::mesh::SURFEL_WIDTH;
use crate::sample::positions::index_u32;
use crate::sample::report::{Finding, SampleReport};
use crate::sample::splats;
use crate::scene::{Boundary, Colour, Particles, PointVolume, SplatRule, Strength};

/// Particles of volumes below this opacity give no splat: sixteen of them are less than one of 255 levels.
pub const LEAST_OPACITY: f32 = 1.0 / (16.0 * 255.0);

/// Opacity below which most viewers draw no splat.
const LEAST_SEEN: f32 = 1.0 / 255.0;

/// Report of a conversion from a scene to splats.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ConversionReport {
    /// Number of particles, surfels and splats in the scene.
    pub particle_count: usize,
    /// Number of splats made.
    pub splat_count: usize,
    /// Findings of the conversion.
    pub findings: Vec<Finding>,
}

impl ConversionReport {
    /// Adds the report of another part of the scene.
    pub fn append(&mut self, other: Self) {
        self.particle_count += other.particle_count;
        self.splat_count += other.splat_count;
        for finding in other.findings {
            let same = |f: &&mut Finding| f.noun == finding.noun && f.reason == finding.reason;
            match self.findings.iter_mut().find(same) {
                Some(known) => known.count += finding.count,
                None => self.findings.push(finding),
            }
        }
    }

    fn note(&mut self, count: usize, noun: &'static str, reason: &'static str, left_out: bool) {
        if count > 0 {
            self.findings.push(Finding {
                count,
                noun: noun.into(),
                reason: reason.into(),
                left_out,
            });
        }
    }
}

/// One splat with a colour that does not depend on the view.
struct Splat {
    position: DVec3,
    scales: [f32; 3],
    rotation: [f32; 4],
    opacity: f32,
}

/// Turns a scene into splats, one for each particle that can be seen.
///
/// # Errors
/// A volume that is invalid; a volume of points with a sharp boundary; a scene without a visible particle.
pub fn splat_cloud(volumes: &[PointVolume]) -> Result<(SplatCloud, ConversionReport)> {
    let mut cloud = SplatCloud::default();
    let mut report = ConversionReport::default();
    for volume in volumes {
        volume.validate()?;
        if let Some(Boundary::Planes(_)) = volume.boundary {
            return Err(Error::invalid(
                "scene",
                "boundary",
                "volumes whose kernels nothing cuts, as splats are",
                "one with a sharp boundary",
                "sample it with BoundaryChoice::Soft",
            ));
        }
        let (part, part_report) = of_volume(volume);
        cloud.append(part);
        report.append(part_report);
    }
    if cloud.positions.is_empty() {
        let faults = SampleReport {
            findings: report.findings,
            ..SampleReport::default()
        };
        return Err(Error::invalid(
            "scene",
            "splats",
            "at least one that can be seen",
            format!("none: {}", faults.warnings().join(", ")),
            Hint::LookAtDataOrRaiseOpacity,
        ));
    }
    Ok((cloud, report))
}

/// Returns the splats of a file without those that cannot be drawn. Opacities above 1 become 1.
///
/// # Errors
/// The errors of [`SplatCloud::validate`].
pub fn sound_splats(cloud: SplatCloud) -> Result<(SplatCloud, ConversionReport)> {
    cloud.validate()?;
    let count = cloud.positions.len();
    let faults: Vec<Option<LeftOut>> = (0..count)
        .into_par_iter()
        .map(|i| splats::factor(&cloud, None, i).err())
        .collect();
    let kept: Vec<u32> = (0..count)
        .filter(|&i| faults[i].is_none())
        .map(index_u32)
        .collect();
    let mut counted = SampleReport::default();
    LeftOut::report(&mut counted, "splats", faults.into_iter().flatten());
    let mut cloud = match kept.len() == count {
        true => cloud,
        false => cloud.gathered(&kept),
    };
    for opacity in &mut cloud.opacities {
        *opacity = opacity.min(1.0);
    }
    let report = ConversionReport {
        particle_count: count,
        splat_count: kept.len(),
        findings: counted.findings,
    };
    Ok((cloud, report))
}

fn of_volume(volume: &PointVolume) -> (SplatCloud, ConversionReport) {
    let count = volume.particles.len();
    let closing = Closing::of(volume);
    let faults = [const { AtomicUsize::new(0) }; LeftOut::COUNT];
    let [transparent, unseen] = [const { AtomicUsize::new(0) }; 2];
    let mut splats: Vec<(u32, Splat)> = (0..count)
        .into_par_iter()
        .filter_map(|i| match splat(volume, &closing, i) {
            Err(fault) => {
                faults[fault as usize].fetch_add(1, Relaxed);
                None
            }
            Ok(splat) if !(splat.opacity >= LEAST_OPACITY) && !closing.keeps_faint => {
                transparent.fetch_add(1, Relaxed);
                None
            }
            Ok(splat) => {
                unseen.fetch_add(usize::from(splat.opacity < LEAST_SEEN), Relaxed);
                Some((index_u32(i), splat))
            }
        })
        .collect();

    // Viewers draw splats of equal depth in the order of the file. In rows they would overlap like roof tiles,
    // and edges would lean to one side.
    if matches!(volume.particles, Particles::Surfels { .. }) {
        splats.par_sort_unstable_by_key(|(i, _)| (scattered(*i), *i));
    }

    let mut counted = SampleReport::default();
    for (fault, number) in LeftOut::ALL.into_iter().zip(&faults) {
        counted.leave_out(number.load(Relaxed), "particles", fault.reason());
    }
    let mut report = ConversionReport {
        particle_count: count,
        splat_count: splats.len(),
        findings: counted.findings,
    };
    report.note(transparent.load(Relaxed), "particles", "transparent", true);
    let reason = "fainter than 1/255, which most viewers do not draw";
    report.note(unseen.load(Relaxed), "splats", reason, false);
    if let Particles::Surfels {
        is_one_sided: true, ..
    } = volume.particles
    {
        let reason = "of one side: splats are seen from both";
        report.note(splats.len(), "surfels", reason, false);
    }

    let (degree, harmonics) = colours(volume, splats.iter().map(|(i, _)| *i as usize));
    let cloud = SplatCloud {
        positions: splats.iter().map(|(_, s)| s.position).collect(),
        scales: splats.iter().map(|(_, s)| s.scales).collect(),
        rotations: splats.iter().map(|(_, s)| s.rotation).collect(),
        opacities: splats.iter().map(|(_, s)| s.opacity).collect(),
        harmonics_degree: degree,
        harmonics,
        is_linear: matches!(
            volume.colour,
            Colour::Harmonics {
                is_linear: true,
                ..
            }
        ),
        by_distance: matches!(
            volume.strength,
            Strength::PeakOpacity {
                by_distance: true,
                ..
            }
        ),
        rule: match volume.strength {
            Strength::PeakOpacity { rule, .. } => rule,
            _ => SplatRule::of_mark(false),
        },
        ..SplatCloud::default()
    };
    (cloud, report)
}

/// Returns the degree and the coefficients of the particles at `indices`.
fn colours(volume: &PointVolume, indices: impl Iterator<Item = usize>) -> (u8, Vec<f32>) {
    let Colour::Harmonics {
        degree,
        coefficients,
        ..
    } = &volume.colour
    else {
        let colours = indices.filter_map(|i| volume.linear_colour(i));
        return (0, colours.flat_map(constants_of_light).collect());
    };
    let stride = 3 * harmonics_count(*degree);
    let set = |i: usize| &coefficients[i * stride..][..stride];
    (*degree, indices.flat_map(set).copied().collect())
}

/// Returns particle `i` as a splat, or the reason why it gives none.
fn splat(volume: &PointVolume, closing: &Closing, i: usize) -> Result<Splat, LeftOut> {
    let (position, factor, normal) = shape(&volume.particles, i);
    if !position.is_finite() || !position.as_vec3().is_finite() {
        return Err(LeftOut::Position);
    }
    if !factor.is_finite() {
        return Err(LeftOut::Size);
    }
    let (sigmas, rotation) = scales_and_rotation(factor);
    // Half a turn about the first axis makes the third axis point to the front.
    let third = rotation * DVec3::Z;
    let rotation = if third.dot(normal) < 0.0 {
        rotation * DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0)
    } else {
        rotation
    };
    let area = TAU * sigmas[0] * sigmas[1];
    let sheet = |mass: f64| 1.0 - (-mass / area).exp();
    let (opacity, widening) = match &volume.strength {
        Strength::PeakOpacity { opacities, .. } => (f64::from(opacities[i]), 1.0),
        Strength::Mass(masses) => (sheet(f64::from(masses[i])), 1.0),
        Strength::Classified { volumes } => {
            let cell = match (&volume.particles, volumes.get(i)) {
                (_, Some(volume)) => f64::from(*volume),
                (Particles::Lattice { lattice, .. }, None) => {
                    lattice.step(cell(lattice.dims, i)).determinant().abs()
                }
                (_, None) => 0.0,
            };
            (sheet(f64::from(volume.classified_at(i)[3]) * cell), 1.0)
        }
        Strength::Surface(areas) => (closing.opaque(f64::from(areas[i]), sigmas), 1.0),
        Strength::Translucent(strengths) => translucent_splat(f64::from(strengths[i]) / area),
    };
    let is_size = sigmas[0] > 0.0 && sigmas.iter().all(|s| narrowed(*s * widening).is_finite());
    if !is_size {
        return Err(LeftOut::Size);
    }
    // Needles have no area over which to state a depth; NaN and negative numbers are no depth.
    if !(opacity >= 0.0) {
        return Err(LeftOut::Strength);
    }
    // The colours are taken later, from the kept particles.
    if !is_colour(volume, i) {
        return Err(LeftOut::Colour);
    }
    Ok(Splat {
        position,
        scales: sigmas.map(|s| narrowed(s * widening)),
        rotation: [rotation.w, rotation.x, rotation.y, rotation.z].map(narrowed),
        opacity: narrowed(opacity).min(1.0),
    })
}

fn is_colour(volume: &PointVolume, i: usize) -> bool {
    match (&volume.colour, volume.linear_colour(i)) {
        (
            Colour::Harmonics {
                degree,
                coefficients,
                ..
            },
            _,
        ) => {
            let stride = 3 * harmonics_count(*degree);
            let own = &coefficients[i * stride..][..stride];
            own.iter().all(|c| c.is_finite())
        }
        (_, colour) => colour.iter().flatten().all(|c| c.is_finite()),
    }
}

/// Returns centre, factor of the variance, and the front's normal (zero for kernels without a front).
fn shape(particles: &Particles, i: usize) -> (DVec3, DMat3, DVec3) {
    match particles {
        Particles::Lattice {
            lattice,
            kernel_width,
        } => {
            let cell = cell(lattice.dims, i);
            let factor = lattice.step(cell) * *kernel_width;
            (lattice.position(cell), factor, DVec3::ZERO)
        }
        Particles::Isotropic { positions, sigmas } => {
            let factor = DMat3::from_diagonal(DVec3::splat(f64::from(sigmas[i])));
            (positions[i], factor, DVec3::ZERO)
        }
        Particles::Anisotropic { positions, factors } => {
            let factor = lower_matrix(factors[i].map(f64::from));
            (positions[i], factor, DVec3::ZERO)
        }
        Particles::Surfels {
            positions,
            tangents,
            ..
        } => {
            let [ax, ay, az, bx, by, bz] = tangents[i].map(f64::from);
            let (a, b) = (DVec3::new(ax, ay, az), DVec3::new(bx, by, bz));
            (
                positions[i],
                DMat3::from_cols(a, b, DVec3::ZERO),
                a.cross(b),
            )
        }
    }
}

/// Hashes an index, so that neighbouring indices give unrelated numbers (the finaliser of SplitMix64).
fn scattered(i: u32) -> u64 {
    let mut x = u64::from(i).wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Returns the cell of a lattice with this index.
fn cell([nx, ny, _]: [usize; 3], i: usize) -> [usize; 3] {
    [i % nx, i / nx % ny, i / (nx * ny)]
}

/// Opacities of the surfels of an opaque volume.
struct Closing {
    /// Standard deviation over spacing of the volume's surfels, measured on whole cells.
    width: f64,
    /// True if faint splats stay, because the scene has them as splats.
    keeps_faint: bool,
}

impl Closing {
    fn of(volume: &PointVolume) -> Self {
        let keeps_faint = matches!(volume.strength, Strength::PeakOpacity { .. });
        let Strength::Surface(areas) = &volume.strength else {
            return Self {
                width: SURFEL_WIDTH,
                keeps_faint,
            };
        };
        let widths = areas.par_iter().enumerate().map(|(i, area)| {
            let (_, factor, _) = shape(&volume.particles, i);
            (factor.x_axis.cross(factor.y_axis).length() / f64::from(*area)).sqrt()
        });
        let mut widths: Vec<f64> = widths.filter(|w| *w > 0.0 && w.is_finite()).collect();
        // A cell that a mask cuts has a smaller area and so seems wider. The tenth percentile of widths stands
        // for whole cells, because cells differ, too.
        let tenth = widths.len() / 10;
        let width = match widths.is_empty() {
            true => SURFEL_WIDTH,
            false => *widths.select_nth_unstable_by(tenth, f64::total_cmp).1,
        };
        Self { width, keeps_faint }
    }

    /// Returns the opacity of an opaque surfel.
    fn opaque(&self, area: f64, sigmas: [f64; 3]) -> f64 {
        let there = area * self.width.powi(2) / (sigmas[0] * sigmas[1]);
        // `clamp` keeps NaN.
        (2.0 * there).clamp(0.0, 1.0)
    }
}

/// Returns the opacity of the surfel of a translucent surface and the factor by which it is widened.
///
/// - `depth`: optical depth of the kernel at its centre, on the surface.
///
/// A splat of peak opacity a has the optical depth -ln(1 - a exp(-Q/2)). Its integral over the surface is 2 pi
/// s1 s2 Li2(a), with Li2 the dilogarithm. The depth of a kernel integrates to 2 pi s1 s2 `depth`. Equal
/// integrals keep the mean optical depth of the surface, whatever the overlap. A splat has Li2(1) = pi²/6 at
/// most: deeper surfels are widened.
fn translucent_splat(depth: f64) -> (f64, f64) {
    const MOST: f64 = std::f64::consts::PI * std::f64::consts::PI / 6.0;
    if depth >= MOST {
        return (1.0, (depth / MOST).sqrt());
    }
    if !(depth >= 0.0) {
        return (f64::NAN, 1.0);
    }
    // The dilogarithm increases, so bisection is safe.
    let [mut low, mut high] = [0.0, 1.0];
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if dilogarithm(middle) < depth {
            low = middle;
        } else {
            high = middle;
        }
    }
    (0.5 * (low + high), 1.0)
}

/// Returns the dilogarithm Li2(x) = sum of x^k / k², for 0 <= x <= 1.
fn dilogarithm(x: f64) -> f64 {
    let series = |x: f64| {
        let (mut power, mut sum) = (1.0, 0.0);
        // For x <= 1/2 the remaining terms are below 2^-50.
        for k in 1..=50 {
            power *= x;
            sum += power / f64::from(k * k);
        }
        sum
    };
    if x <= 0.5 {
        series(x)
    } else if x < 1.0 {
        // Euler's reflection formula.
        std::f64::consts::PI.powi(2) / 6.0 - x.ln() * (-x).ln_1p() - series(1.0 - x)
    } else {
        std::f64::consts::PI.powi(2) / 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dilogarithm_has_its_known_values() {
        let pi2 = std::f64::consts::PI.powi(2);
        let half = pi2 / 12.0 - 0.5 * std::f64::consts::LN_2.powi(2);
        for (x, value) in [(0.0, 0.0), (0.5, half), (1.0, pi2 / 6.0)] {
            assert!((dilogarithm(x) - value).abs() < 1e-14, "{x}");
        }
        // The function is continuous where the formula changes, and its slope is -ln(1 - x) / x.
        for x in [0.1, 0.49, 0.51, 0.9] {
            let slope = (dilogarithm(x + 1e-5) - dilogarithm(x - 1e-5)) / 2e-5;
            assert!((slope + (-x).ln_1p() / x).abs() < 1e-8, "{x}");
        }
    }

    #[test]
    fn a_panes_splat_has_its_mean_depth() {
        for depth in [1e-6, 0.1, 1.0, 1.6, 1.7, 4.0] {
            let (opacity, widening) = translucent_splat(depth);
            let mean = dilogarithm(opacity) * widening * widening;
            // 40 bisections, and the slope is infinite at 1.
            assert!(
                (mean - depth).abs() < 1e-9 * depth.max(1.0),
                "{depth}: {mean}"
            );
        }
        assert!(translucent_splat(f64::NAN).0.is_nan());
    }
}
