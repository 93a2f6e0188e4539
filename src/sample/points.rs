//! Particles: shapes, strengths and colours from the columns of a table.

use std::borrow::Cow;

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::factor::{factor_of_variance, principal_sigmas};
use super::neighbours::neighbour_volumes;
use super::{
    SampleOptions, SampleReport, Sampled, TakenScalar, check_count, check_len, index_u32, keep,
    lower_factor, narrowed, nothing_left, take_scalar, transfer_function,
};
use crate::error::{Error, Result};
use crate::io::{Association, Dataset, FieldSource, Geometry};
use crate::scene::{Colour, MAX_OPACITY, Particles, PointVolume, Strength, Values};

/// Variance of the cubic spline kernel (support 2h) per axis, over h².
const CUBIC_SPLINE_VARIANCE: f64 = 0.3;

/// The name that the report gives to the field computed for bare positions. The logarithm,
/// because clustered points span many decades of density.
const NUMBER_DENSITY: &str = "log10 number density";

const VARIANCE: [&str; 6] = ["vxx", "vxy", "vxz", "vyy", "vyz", "vzz"];
const SCALES: [&str; 7] = [
    "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];
const RGB: [&str; 3] = ["r", "g", "b"];

/// Columns with a meaning of their own: none is the field to show by default.
const RESERVED: [&str; 11] = [
    "x",
    "y",
    "z",
    "sigma",
    "h",
    "mass",
    "m",
    "extinction",
    "volume",
    "opacity",
    "id",
];

/// Fields preferred where none is named.
const DENSITIES: [&str; 2] = ["rho", "density"];

/// The columns that give shapes.
enum Shape<'a> {
    Sigma(&'a Values),
    SmoothingLength(&'a Values),
    Variance([&'a Values; 6]),
    ScaleRotation([&'a Values; 7]),
    /// Cell volumes from the neighbours \[length³\].
    Neighbours(Vec<f64>),
}

/// The columns that give masses.
enum Mass<'a> {
    /// The masses themselves.
    Stated(&'a Values),
    Extinction(&'a Values, &'a Values),
    Opacity(&'a Values),
    /// From the transfer function, with these volumes.
    Classified(Volume<'a>),
}

/// The columns that give volumes.
#[derive(Clone, Copy)]
enum Volume<'a> {
    Column(&'a Values),
    MassOverDensity(&'a Values, &'a Values),
    /// The volume whose kernel this is: the product of the principal standard deviations over
    /// kernel_width³.
    Kernel,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum LeftOut {
    Position,
    Value,
    Size,
    Indefinite,
    Strength,
    Colour,
    BeyondSinglePrecision,
}

const REASONS: [(LeftOut, &str); 7] = [
    (LeftOut::Position, "position not finite"),
    (LeftOut::Value, "value not finite"),
    (LeftOut::Size, "size zero, negative or not finite"),
    (LeftOut::Indefinite, "variance indefinite or not finite"),
    (
        LeftOut::Strength,
        "strength or volume negative or not finite",
    ),
    (LeftOut::Colour, "colour not finite"),
    (
        LeftOut::BeyondSinglePrecision,
        "shape, volume or mass beyond single precision; rescale",
    ),
];

/// What becomes of one row.
struct Particle {
    /// Lower-triangular factor; isotropic shapes use the first element.
    factor: [f32; 6],
    /// Mass \[length²\] or, where classified, volume \[length³\].
    strength: f32,
    /// The volume it stands for \[length³\], for the mean spacing.
    volume: f64,
    colour: [f32; 3],
}

pub(super) fn volume(mut dataset: Dataset, options: &SampleOptions) -> Result<Sampled> {
    let Geometry::Points { positions } = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let count = positions.len();
    check_count(&dataset, count)?;
    let columns = Columns {
        dataset: &dataset,
        count,
    };
    let shape = columns.shape(positions)?;
    let mass = columns.mass()?;
    let is_classified = matches!(mass, Mass::Classified(_));
    let rgb = columns.set(RGB)?;

    // The field: the one named; else, where masses are classified, a default one.
    let wanted = match &options.field {
        Some(name) => Some(name.clone()),
        None if is_classified && !matches!(shape, Shape::Neighbours(_)) => columns.default_field(),
        None => None,
    };
    let computed = is_classified && wanted.is_none();
    // A named field colours, even beside masses; else r, g, b do.
    let named = options.field.is_some();
    let rgb = rgb.filter(|_| !named);
    let field: Option<Cow<'_, Values>> = match &wanted {
        Some(name) => match columns.get(name)? {
            Some(stored) => Some(Cow::Borrowed(stored)),
            None => Some(Cow::Owned(columns.derived(name)?)),
        },
        None => None,
    };

    let isotropic = matches!(
        shape,
        Shape::Sigma(_) | Shape::SmoothingLength(_) | Shape::Neighbours(_)
    );
    let width_cubed = options.kernel_width.powi(3);
    let row = |i: usize| -> Result<Particle, LeftOut> {
        if !positions[i].is_finite() {
            return Err(LeftOut::Position);
        }
        if field.as_ref().is_some_and(|v| !v.get(i).is_finite()) {
            return Err(LeftOut::Value);
        }
        let (factor, sigmas) = shape.at(i, options.kernel_width)?;
        let kernel_volume = sigmas.iter().product::<f64>() / width_cubed;
        let (strength, volume) = mass.at(i, sigmas, kernel_volume)?;
        let colour = rgb.map_or([1.0; 3], |c| c.map(|c| c.get(i)));
        if !colour.iter().all(|c| c.is_finite()) {
            return Err(LeftOut::Colour);
        }
        let particle = Particle {
            factor: factor.map(narrowed),
            strength: narrowed(strength),
            volume,
            colour: colour.map(|c| c.max(0.0)),
        };
        let sound = particle.factor.iter().all(|l| l.is_finite())
            && particle.factor.iter().any(|l| l.abs() >= f32::MIN_POSITIVE)
            && particle.strength.is_finite()
            && (particle.strength >= f32::MIN_POSITIVE || strength <= 0.0);
        if sound {
            Ok(particle)
        } else {
            Err(LeftOut::BeyondSinglePrecision)
        }
    };
    let rows: Vec<Result<Particle, LeftOut>> = (0..count).into_par_iter().map(row).collect();

    let mut report = SampleReport {
        field: if computed {
            Some(NUMBER_DENSITY.into())
        } else {
            wanted.clone()
        },
        sample_count: count,
        ..SampleReport::default()
    };
    for (reason, text) in REASONS {
        let failed = |r: &&Result<Particle, LeftOut>| r.as_ref().err() == Some(&reason);
        report.leave_out(rows.iter().filter(failed).count(), "particles", text);
    }
    let mut kept = Vec::with_capacity(count);
    let mut particles = Vec::with_capacity(count);
    for (i, row) in rows.into_iter().enumerate() {
        if let Ok(particle) = row {
            kept.push(index_u32(i));
            particles.push(particle);
        }
    }
    if kept.is_empty() {
        return Err(nothing_left(&dataset, &report));
    }
    report.particle_count = kept.len();

    let has_rgb = rgb.is_some();
    // Moved out of the data set, not copied, where it is stored there.
    let field = field.map(|f| match f {
        Cow::Owned(derived) => Some(derived),
        Cow::Borrowed(_) => None,
    });
    let values = match (field, &wanted) {
        (Some(Some(derived)), _) => Some(keep(derived, &kept)),
        (Some(None), Some(name)) => Some(keep(
            take_scalar(&mut dataset, Some(name.as_str()))?.values,
            &kept,
        )),
        _ if computed => {
            let density = particles.iter().map(|p| narrowed(-p.volume.log10()));
            Some(Values::F32(density.collect()))
        }
        _ => None,
    };
    let total: f64 = particles
        .iter()
        .map(|p| p.volume)
        .filter(|v| v.is_finite())
        .sum();
    let mean_spacing = Some((total / kept.len() as f64).cbrt()).filter(|s| *s > 0.0);
    let mean_spacing = mean_spacing.unwrap_or(1.0);
    let volumes: Vec<f32> = particles.iter().map(|p| narrowed(p.volume)).collect();
    let transfer_function = match &values {
        Some(values) => Some(transfer_function(values, &volumes, mean_spacing, options)?),
        None => None,
    };
    report.value_range = values.as_ref().and_then(Values::finite_range);
    report.unit_distance = transfer_function.as_ref().map_or_else(
        || options.unit_distance.unwrap_or(mean_spacing),
        |t| t.unit_distance(),
    );

    let Geometry::Points { positions } = &mut dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let mut positions = std::mem::take(positions);
    if kept.len() < positions.len() {
        positions = kept.iter().map(|&i| positions[i as usize]).collect();
    }
    let strengths = particles.iter().map(|p| p.strength).collect();
    Ok(Sampled {
        volume: PointVolume {
            strength: if is_classified {
                Strength::Classified { volumes: strengths }
            } else {
                Strength::Mass(strengths)
            },
            colour: if has_rgb {
                Colour::PerParticle(particles.iter().map(|p| p.colour).collect())
            } else if values.is_some() {
                Colour::Classified
            } else {
                Colour::Uniform([1.0; 3])
            },
            particles: if isotropic {
                let sigmas = particles.iter().map(|p| p.factor[0]).collect();
                Particles::Isotropic { positions, sigmas }
            } else {
                let factors = particles.iter().map(|p| p.factor).collect();
                Particles::Anisotropic { positions, factors }
            },
            values,
            transfer_function,
        },
        report,
    })
}

/// The columns of a table, by name.
#[derive(Clone, Copy)]
struct Columns<'a> {
    dataset: &'a Dataset,
    count: usize,
}

impl<'a> Columns<'a> {
    fn get(&self, name: &str) -> Result<Option<&'a Values>> {
        let stored = self.dataset.fields.iter().find_map(|f| match &f.source {
            FieldSource::Scalar(values)
                if f.association == Association::Nodes && f.name.eq_ignore_ascii_case(name) =>
            {
                Some(values)
            }
            _ => None,
        });
        match stored {
            Some(values) if values.len() != self.count => Err(Error::format(
                &self.dataset.path,
                format!("column `{name}`"),
                format!("{} values", self.count),
                format!("{} values", values.len()),
                "the file is damaged",
            )),
            stored => Ok(stored),
        }
    }

    /// All columns of a set, or none; some of them are an error.
    fn set<const N: usize>(&self, names: [&str; N]) -> Result<Option<[&'a Values; N]>> {
        let mut columns = Vec::with_capacity(N);
        for name in names {
            columns.push(self.get(name)?);
        }
        let present: Vec<&'a Values> = columns.iter().copied().flatten().collect();
        if present.is_empty() {
            return Ok(None);
        }
        if let Some(missing) = columns.iter().position(Option::is_none) {
            return Err(Error::format(
                &self.dataset.path,
                "columns",
                names.join(", "),
                format!("no `{}`", names[missing]),
                "give all of these or none",
            ));
        }
        Ok(present.try_into().ok())
    }

    /// The only one present of several alternatives.
    fn one_of<T, const N: usize>(
        &self,
        what: &str,
        alternatives: [(&str, Option<T>); N],
    ) -> Result<Option<T>> {
        let present: Vec<(&str, T)> = alternatives
            .into_iter()
            .filter_map(|(name, t)| t.map(|t| (name, t)))
            .collect();
        if present.len() > 1 {
            let names: Vec<&str> = present.iter().map(|(name, _)| *name).collect();
            return Err(Error::format(
                &self.dataset.path,
                "columns",
                format!("one kind of {what}"),
                names.join(" and "),
                "drop all but one",
            ));
        }
        Ok(present.into_iter().next().map(|(_, t)| t))
    }

    /// A scalar that no column stores: a vector's magnitude or component, or a derived one.
    fn derived(&self, selector: &str) -> Result<Values> {
        let (association, values) = self.dataset.scalar(selector)?;
        let taken = TakenScalar {
            name: selector.into(),
            association,
            values,
        };
        check_len(self.dataset, &taken, self.count)?;
        Ok(taken.values)
    }

    fn shape(&self, positions: &[DVec3]) -> Result<Shape<'a>> {
        let shape = self.one_of(
            "shape",
            [
                ("sigma", self.get("sigma")?.map(Shape::Sigma)),
                ("h", self.get("h")?.map(Shape::SmoothingLength)),
                ("vxx..vzz", self.set(VARIANCE)?.map(Shape::Variance)),
                (
                    "scale_0..2, rot_0..3",
                    self.set(SCALES)?.map(Shape::ScaleRotation),
                ),
            ],
        )?;
        match shape {
            Some(shape) => Ok(shape),
            None => neighbour_volumes(positions)
                .map(Shape::Neighbours)
                .ok_or_else(|| {
                    Error::format(
                        &self.dataset.path,
                        "columns",
                        "a shape: sigma, h, vxx..vzz or scale_0..2 with rot_0..3",
                        "fewer than two distinct positions to take a spacing from",
                        "add a column `sigma`",
                    )
                }),
        }
    }

    fn mass(&self) -> Result<Mass<'a>> {
        let volume = self.get("volume")?;
        let extinction = match (self.get("extinction")?, volume) {
            (Some(extinction), Some(volume)) => Some(Mass::Extinction(extinction, volume)),
            (Some(_), None) => {
                return Err(Error::format(
                    &self.dataset.path,
                    "columns",
                    "a column `volume` beside `extinction`",
                    "none",
                    "add it, or give `mass` or `opacity` instead",
                ));
            }
            (None, _) => None,
        };
        let stated = self.one_of(
            "strength",
            [
                ("mass", self.get("mass")?.map(Mass::Stated)),
                ("extinction", extinction),
                ("opacity", self.get("opacity")?.map(Mass::Opacity)),
            ],
        )?;
        Ok(match stated {
            Some(stated) => stated,
            None => Mass::Classified(match (volume, self.get("m")?, self.get("rho")?) {
                (Some(volume), ..) => Volume::Column(volume),
                (None, Some(m), Some(rho)) => Volume::MassOverDensity(m, rho),
                _ => Volume::Kernel,
            }),
        })
    }

    /// A density if there is one, else the first column without a meaning of its own that is
    /// not constant.
    fn default_field(&self) -> Option<String> {
        let is = |name: &str, list: &[&str]| list.iter().any(|l| l.eq_ignore_ascii_case(name));
        let varying = || {
            self.dataset.fields.iter().filter(|f| match &f.source {
                FieldSource::Scalar(values) => {
                    values.finite_range().is_some_and(|[lo, hi]| lo < hi)
                        && ![&RESERVED[..], &VARIANCE, &SCALES, &RGB]
                            .iter()
                            .any(|list| is(&f.name, list))
                }
                _ => false,
            })
        };
        varying()
            .find(|f| is(&f.name, &DENSITIES))
            .or_else(|| varying().next())
            .map(|f| f.name.clone())
    }
}

impl Shape<'_> {
    /// The factor of row `i` and its principal standard deviations, greatest first.
    fn at(&self, i: usize, kernel_width: f64) -> Result<([f64; 6], [f64; 3]), LeftOut> {
        let sphere = |sigma: f64| {
            if sigma > 0.0 && sigma.is_finite() {
                Ok(([sigma, 0.0, sigma, 0.0, 0.0, sigma], [sigma; 3]))
            } else {
                Err(LeftOut::Size)
            }
        };
        let number = |column: &Values| f64::from(column.get(i));
        let factor = match self {
            Self::Sigma(sigma) => return sphere(number(sigma)),
            Self::SmoothingLength(h) => return sphere(CUBIC_SPLINE_VARIANCE.sqrt() * number(h)),
            Self::Neighbours(volumes) => return sphere(kernel_width * volumes[i].cbrt()),
            Self::Variance(v) => factor_of_variance(v.map(number)).ok_or(LeftOut::Indefinite)?,
            Self::ScaleRotation(columns) => {
                let [sx, sy, sz, w, x, y, z] = columns.map(number);
                let scales = DVec3::new(sx, sy, sz);
                let rotation = DQuat::from_xyzw(x, y, z, w);
                let length = rotation.length();
                let sound = scales.is_finite()
                    && scales.min_element() >= 0.0
                    && scales.max_element() > 0.0
                    && length > 0.0
                    && length.is_finite();
                if !sound {
                    return Err(LeftOut::Size);
                }
                let rotation = DMat3::from_quat(rotation * (1.0 / length));
                lower_factor(rotation * DMat3::from_diagonal(scales))
            }
        };
        let sigmas = principal_sigmas(factor);
        if sigmas[0] > 0.0 && sigmas[0].is_finite() {
            Ok((factor, sigmas))
        } else {
            Err(LeftOut::Size)
        }
    }
}

impl Mass<'_> {
    /// Mass (or, where classified, volume) of row `i`, and the volume it stands for.
    fn at(&self, i: usize, sigmas: [f64; 3], kernel_volume: f64) -> Result<(f64, f64), LeftOut> {
        let number = |column: &Values| f64::from(column.get(i));
        let (strength, volume) = match self {
            Self::Stated(mass) => (number(mass), kernel_volume),
            Self::Extinction(extinction, volume) => {
                (number(extinction) * number(volume), number(volume))
            }
            // Seen along the axis of least depth, the shortest, the kernel's line integral is
            // 1 / (2 pi s1 s2) with the two greatest standard deviations. Flat and round
            // kernels have that direction; a needle has none with an area to state it for.
            Self::Opacity(opacity) => {
                let opacity = number(opacity);
                let area = std::f64::consts::TAU * sigmas[0] * sigmas[1];
                if opacity < 0.0 || area <= 0.0 {
                    return Err(LeftOut::Strength);
                }
                (-(-opacity.min(MAX_OPACITY)).ln_1p() * area, kernel_volume)
            }
            Self::Classified(volume) => {
                let volume = match volume {
                    Volume::Column(volume) => number(volume),
                    Volume::MassOverDensity(m, rho) => number(m) / number(rho),
                    Volume::Kernel => kernel_volume,
                };
                if volume <= 0.0 {
                    return Err(LeftOut::Strength);
                }
                (volume, volume)
            }
        };
        if strength >= 0.0 && strength.is_finite() && volume >= 0.0 {
            Ok((strength, volume))
        } else {
            Err(LeftOut::Strength)
        }
    }
}
