//! Computes shapes of particles, from columns, from lengths or from neighbours.

use std::borrow::Cow;

use glam::DVec3;
use rayon::prelude::*;

use super::super::left_out::LeftOut;
use super::columns::Columns;
use super::neighbourhoods::{Neighbourhoods, Surrounded, without_spacing};
use super::neighbours::{Groups, MOST_NEIGHBOURS, NEIGHBOUR_COUNT, PointIndex};
use super::{sph, yu_turk};
use crate::constants::DEFAULT_KERNEL_WIDTH;
use crate::data::shape_columns::{SCALES, VARIANCE};
use crate::data::smoothing::{LengthMeaning, SphKernel};
use crate::error::{Error, Hint, Result};
use crate::math::{eigen, factor_of_variance, from_eigen, principal_sigmas};
use crate::parallel;
use crate::sample::kernels::sums::{Summand, everywhere};
use crate::sample::options::{ParticleShape, SampleOptions};
use crate::sample::splats::factor::{factor_of_scales, sphere};
use crate::scene::Values;

/// A neighbourhood is flat, or a line, if the next standard deviation is smaller by this factor.
const FLAT_RATIO: f64 = 2.5;

/// Least thickness of a neighbourhood, as a share of its spacing.
const LEAST_THICKNESS: f64 = 0.02;

/// Source of the particles' shapes.
pub(super) enum Shape<'a> {
    /// Standard deviations of spheres.
    Spheres(Vec<f64>),
    Variance([&'a Values; 6]),
    ScaleRotation([&'a Values; 7]),
    /// Variances computed from neighbours.
    Computed(Vec<[f64; 6]>),
}

/// Shapes, and volumes if they were computed along with them.
pub(super) struct Shapes<'a> {
    pub(super) shape: Shape<'a>,
    /// Volume of each particle \[length³\]; NaN if unknown.
    pub(super) volumes: Option<Cow<'a, [f64]>>,
    /// True if the data have nothing but positions.
    pub(super) bare: bool,
    /// Meaning of the lengths, in words.
    pub(super) lengths: Option<String>,
    /// SPH kernel that the lengths belong to, if spheres stand for it.
    pub(super) smoothing: Option<SphKernel>,
    /// Groups of the positions, if shapes were computed from them and others may need them.
    pub(super) groups: Option<Groups>,
}

impl<'a> Columns<'a> {
    /// Returns the shapes of all particles, from the data and the options.
    pub(super) fn shapes(
        &self,
        positions: &[DVec3],
        options: &SampleOptions,
    ) -> Result<Shapes<'a>> {
        enum Stated<'a> {
            Length(&'a Values, &'a str, LengthMeaning),
            Variance([&'a Values; 6]),
            ScaleRotation([&'a Values; 7]),
        }
        let length = |name: &'a str, meaning| {
            let column = self.get(name)?;
            Ok::<_, Error>(column.map(|column| Stated::Length(column, name, meaning)))
        };
        let smoothing = self.dataset.smoothing.as_ref();
        let meaning = smoothing.map_or(LengthMeaning::SmoothingLength, |s| s.meaning);
        let own = self.names().0;
        let stated = match smoothing {
            Some(_) => length(own, meaning)?,
            None => self.one_of(
                "shape",
                [
                    ("sigma", length("sigma", LengthMeaning::Sigma)?),
                    (own, length(own, meaning)?),
                    ("radius", length("radius", LengthMeaning::Sigma)?),
                    ("vxx..vzz", self.set(VARIANCE)?.map(Stated::Variance)),
                    (
                        "scale_0..2, rot_0..3",
                        self.set(SCALES)?.map(Stated::ScaleRotation),
                    ),
                ],
            )?,
        };
        let kernel = options.kernels.smoothing.or(smoothing.map(|s| s.kernel));
        let kernel = kernel.unwrap_or(SphKernel::CubicSpline);
        let is_named = options.kernels.smoothing.is_some();
        // A standard deviation is that of a Gaussian, unless a code states its kernel.
        let is_sph = |meaning, is_stated: bool| {
            use LengthMeaning::{SmoothingLength, Support};
            is_named || is_stated || matches!(meaning, SmoothingLength | Support)
        };
        let stated_shape = |shape| Shapes {
            shape,
            volumes: None,
            bare: false,
            lengths: None,
            smoothing: None,
            groups: None,
        };
        let refuse_lengths = |found: &str| {
            let given = [
                (options.kernels.length.is_some(), "a meaning of lengths"),
                (
                    options.kernels.smoothing.is_some() || options.kernels.gaussian,
                    "a kernel of lengths",
                ),
            ];
            refuse(given, "particles with lengths", found)
        };
        let stated_alone = |columns: &str| {
            refuse_lengths(columns)?;
            let is_chosen = options.kernels.shape != ParticleShape::Automatic;
            let given = [(is_chosen, "a shape")];
            refuse(given, "particles whose shapes are not stated", columns)
        };
        match (options.kernels.radius, stated) {
            (Some(radius), _) => {
                let meaning = options.kernels.length.unwrap_or(LengthMeaning::Sigma);
                let lengths = Lengths::new("the radius given", meaning, kernel, |_| radius);
                let lengths = lengths.of_kernel(is_sph(meaning, false).then_some(kernel));
                Ok(self.of_lengths(positions, options, &lengths, true)?)
            }
            (None, Some(Stated::Length(column, name, meaning))) => {
                let meaning = options.kernels.length.unwrap_or(meaning);
                let lengths = Lengths::new(name, meaning, kernel, |i| f64::from(column.get(i)));
                let is_stated = smoothing.is_some() && options.kernels.length.is_none();
                let lengths = lengths.of_kernel(is_sph(meaning, is_stated).then_some(kernel));
                // A sigma in a table is a kernel's own size; it does not depend on neighbours.
                let crowded = smoothing.is_some() || name != "sigma";
                self.of_lengths(positions, options, &lengths, crowded)
            }
            (None, Some(Stated::Variance(v))) => {
                stated_alone("vxx..vzz")?;
                Ok(stated_shape(Shape::Variance(v)))
            }
            (None, Some(Stated::ScaleRotation(s))) => {
                stated_alone("scale_0..2, rot_0..3")?;
                Ok(stated_shape(Shape::ScaleRotation(s)))
            }
            (None, None) => {
                refuse_lengths("none")?;
                self.of_neighbours(positions, options)
            }
        }
    }

    /// Returns shapes from lengths. If no column gives volumes, neighbours do: 1 over the sum of the kernels at
    /// a particle, the number density of SPH.
    fn of_lengths(
        &self,
        positions: &[DVec3],
        options: &SampleOptions,
        lengths: &Lengths<impl Fn(usize) -> f64 + Sync>,
        crowded: bool,
    ) -> Result<Shapes<'a>> {
        let sigma = |i: usize| lengths.sigma_over_length * (lengths.of)(i);
        let (_, mass, density) = self.names();
        let states = |name| Ok::<_, Error>(self.of_table(name)?.is_some());
        let known = states("volume")?
            || states("mass")?
            || states("extinction")?
            || states("opacity")?
            || (self.get(mass)?.is_some() && self.get(density)?.is_some());
        let with_yu_turk = options.kernels.shape == ParticleShape::YuTurk;
        let index = if with_yu_turk || (crowded && !known) {
            PointIndex::new(positions)
        } else {
            None
        };
        let shape = match &index {
            Some(index) if with_yu_turk => {
                let support = lengths.support_over_length;
                let sizes = |i: usize| (sigma(i), support * (lengths.of)(i));
                Shape::Computed(yu_turk::variances(
                    index,
                    positions,
                    sizes,
                    options.task.as_ref(),
                )?)
            }
            _ => Shape::Spheres(parallel::map(self.count, sigma)),
        };
        let kernel = |j: usize| {
            let s = sigma(j);
            (s > 0.0 && s.is_finite()).then_some(Summand {
                factor: sphere(s),
                sigma: s,
                amplitude: 1.0,
            })
        };
        let average = index.as_ref().map_or(0, |index| index.mean_reach(kernel));
        if average > MOST_NEIGHBOURS {
            return Err(Error::format(
                &self.dataset.path,
                "particle lengths",
                "kernels that reach some dozens of neighbours",
                format!("{average} neighbours each, on average"),
                Hint::GiveMeaningOrRadius,
            ));
        }
        let volumes = match index.filter(|_| crowded && !known) {
            Some(index) => {
                let sums =
                    index.kernel_sums(options.task.as_ref(), |_| true, kernel, everywhere)?;
                Some(sums.into_iter().map(|sum| 1.0 / sum).collect())
            }
            None => None,
        };
        Ok(Shapes {
            shape,
            volumes,
            bare: false,
            lengths: Some(lengths.convention.clone()),
            smoothing: lengths
                .kernel
                .filter(|_| !with_yu_turk && !options.kernels.gaussian),
            groups: None,
        })
    }

    /// Returns shapes from the nearest neighbours: spheres, or ellipsoids if the set is anisotropic.
    fn of_neighbours(&self, positions: &[DVec3], options: &SampleOptions) -> Result<Shapes<'a>> {
        let (_, mass, density) = self.names();
        let volumes = match (self.get(mass)?, self.get(density)?) {
            (Some(mass), Some(density)) => {
                let scale = self.dataset.volume_scale;
                let volume = |i| scale * f64::from(mass.get(i)) / f64::from(density.get(i));
                Some(parallel::map(self.count, volume))
            }
            _ => None,
        };
        let (of_neighbours, covariances, groups): (Cow<'a, [f64]>, _, _) = match self.neighbourhoods
        {
            Some(known) => {
                let covariances = known.covariances.as_deref();
                (
                    known.volumes.as_slice().into(),
                    covariances.map(Cow::from),
                    None,
                )
            }
            None => {
                let points = Surrounded {
                    positions,
                    numbers: &|i| i as u64,
                    count: positions.len(),
                    of: positions.len() as u64,
                };
                let found = Neighbourhoods::of(&points, volumes.is_none(), options, None)?;
                let found = found.ok_or_else(|| without_spacing(&self.dataset.path))?;
                let covariances = found.covariances.map(Cow::from);
                (found.volumes.into(), covariances, found.groups)
            }
        };
        let volumes: Cow<'a, [f64]> = volumes.map_or(of_neighbours, Cow::Owned);
        let width = DEFAULT_KERNEL_WIDTH;
        let shape = if let Some(covariances) = covariances {
            let variance = |(c, volume): (&[f64; 6], &f64)| {
                neighbourhood_variance(*c, *volume).map(|v| v * width * width)
            };
            let each = covariances.par_iter().zip(volumes.par_iter());
            Shape::Computed(each.map(variance).collect())
        } else {
            Shape::Spheres(volumes.par_iter().map(|v| width * v.cbrt()).collect())
        };
        Ok(Shapes {
            shape,
            volumes: Some(volumes),
            bare: true,
            lengths: None,
            smoothing: None,
            groups,
        })
    }
}

/// One length per particle, and its meaning.
struct Lengths<F> {
    of: F,
    sigma_over_length: f64,
    support_over_length: f64,
    convention: String,
    /// `None` for lengths of Gaussians.
    kernel: Option<SphKernel>,
}

impl<F> Lengths<F> {
    /// Sets the kernel that the lengths belong to.
    fn of_kernel(self, kernel: Option<SphKernel>) -> Self {
        Self { kernel, ..self }
    }

    fn new(name: &str, meaning: LengthMeaning, kernel: SphKernel, of: F) -> Self {
        Self {
            of,
            sigma_over_length: sph::sigma_over_length(meaning, kernel),
            support_over_length: sph::support_over_length(meaning, kernel),
            convention: sph::convention(name, meaning, kernel),
            kernel: None,
        }
    }
}

/// Returns the variance of a kernel of width 1 from the covariance of its point's neighbours. The covariance is
/// divided by that of k points at unit spacing in a ball, on a disc or along a line, whichever the neighbours
/// resemble.
fn neighbourhood_variance(covariance: [f64; 6], volume: f64) -> [f64; 6] {
    use std::f64::consts::PI;
    let count = NEIGHBOUR_COUNT as f64;
    let ball = (3.0 * count / (4.0 * PI)).powf(2.0 / 3.0) / 5.0;
    let disc = count / (4.0 * PI);
    let line = count * count / 12.0;
    let (spread, axes) = eigen(covariance);
    let mut sorted = spread.to_array();
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    let drops = |i: usize| sorted[i] > FLAT_RATIO * FLAT_RATIO * sorted[i + 1];
    let unit = match (drops(0), drops(1)) {
        (true, _) => line,
        (false, true) => disc,
        (false, false) => ball,
    };
    let least = (LEAST_THICKNESS * volume.cbrt()).powi(2);
    from_eigen((spread / unit).max(DVec3::splat(least)), axes)
}

impl Shape<'_> {
    /// Returns the factor of row `i`, `scale` times as wide as stated, and its principal standard deviations,
    /// greatest first.
    pub(super) fn at(&self, i: usize, scale: f64) -> Result<([f64; 6], [f64; 3]), LeftOut> {
        let number = |column: &Values| f64::from(column.get(i));
        let factor = match self {
            Self::Spheres(sigmas) => {
                let sigma = scale * sigmas[i];
                return if sigma > 0.0 && sigma.is_finite() {
                    Ok((sphere(sigma), [sigma; 3]))
                } else {
                    Err(LeftOut::Size)
                };
            }
            Self::Variance(v) => factor_of_variance(v.map(number)).ok_or(LeftOut::Indefinite)?,
            Self::Computed(variances) => factor_of_variance(variances[i]).ok_or(LeftOut::Size)?,
            Self::ScaleRotation(columns) => {
                let [sx, sy, sz, w, x, y, z] = columns.map(|column| column.get(i));
                factor_of_scales([sx, sy, sz], [w, x, y, z]).map_err(|_| LeftOut::Size)?
            }
        };
        let factor = factor.map(|l| scale * l);
        let sigmas = principal_sigmas(factor);
        if sigmas[0] > 0.0 && sigmas[0].is_finite() {
            Ok((factor, sigmas))
        } else {
            Err(LeftOut::Size)
        }
    }
}

/// Refuses options that have no meaning for these particles.
fn refuse<const N: usize>(
    given: [(bool, &'static str); N],
    expected: &str,
    found: &str,
) -> Result<()> {
    match given.into_iter().find(|(is_given, _)| *is_given) {
        None => Ok(()),
        Some((_, what)) => {
            let advice = "leave it out";
            Err(Error::invalid(what, "particles", expected, found, advice))
        }
    }
}
