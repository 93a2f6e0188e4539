//! Particles: shapes, strengths and colours from the columns of a table.

use std::borrow::Cow;

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::factor::{eigen, factor_of_variance, from_eigen, principal_sigmas};
use super::left_out::LeftOut;
use super::neighbours::{NEIGHBOUR_COUNT, PointIndex};
use super::{
    DEFAULT_KERNEL_WIDTH, ParticleShape, SampleOptions, SampleReport, Sampled, TakenScalar,
    check_count, check_len, describes_the_grid, index_u32, keep, lower_factor, narrowed,
    nothing_left, sph, take_scalar, transfer_function, yu_turk,
};
use crate::error::{Error, Result};
use crate::image::linear_from_srgb;
use crate::io::{Association, Dataset, FieldSource, Geometry, LengthMeaning, Smoothing, SphKernel};
use crate::scene::{Colour, MAX_OPACITY, Particles, PointVolume, Strength, Values};

/// The name that the report gives to the field computed for bare positions. The logarithm,
/// because clustered points span many decades of density.
const LOG_NUMBER_DENSITY: &str = "log10 number density";

/// The same for column densities, which then count particles.
const NUMBER_DENSITY: &str = "number density";

/// The name that the report gives to mass over volume where no density is stated.
const MASS_DENSITY: &str = "density (mass over volume)";

const VARIANCE: [&str; 6] = ["vxx", "vxy", "vxz", "vyy", "vyz", "vzz"];
const SCALES: [&str; 7] = [
    "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];
const RGB: [&str; 3] = ["r", "g", "b"];
/// The names that scanners give to colours: bytes, as displays take them.
const RED_GREEN_BLUE: [&str; 3] = ["red", "green", "blue"];

/// Columns with a meaning of their own: none is the field to show by default.
const RESERVED: [&str; 12] = [
    "x",
    "y",
    "z",
    "sigma",
    "h",
    "radius",
    "mass",
    "m",
    "extinction",
    "volume",
    "opacity",
    "id",
];

/// Fields preferred where none is named.
const DENSITIES: [&str; 2] = ["rho", "density"];

/// A set is truly anisotropic, lying on surfaces or along lines, if the neighbourhoods of this
/// share of its points are longer than wide by [`TRUE_RATIO`], the wide ones of
/// [`TRUE_NEIGHBOURS`] points: sets that fill space look flat at a few neighbours where they lie in
/// layers, and round at many.
const TRUE_SHARE: f64 = 0.5;
/// See [`TRUE_SHARE`]; a ratio of standard deviations.
const TRUE_RATIO: f64 = 3.0;
/// See [`TRUE_SHARE`].
const TRUE_NEIGHBOURS: usize = 60;
/// Points whose neighbourhoods are looked at for it.
const TRUE_SAMPLE: usize = 4096;

/// A neighbourhood is flat, or a line, where the next standard deviation is smaller by this.
const FLAT_RATIO: f64 = 2.5;

/// No neighbourhood is thinner than this share of its spacing.
const LEAST_THICKNESS: f64 = 0.02;

/// What gives shapes.
enum Shape<'a> {
    /// Standard deviations of spheres.
    Spheres(Vec<f64>),
    Variance([&'a Values; 6]),
    ScaleRotation([&'a Values; 7]),
    /// Variances computed here.
    Computed(Vec<[f64; 6]>),
}

/// Shapes, and volumes where these came with them.
struct Shapes<'a> {
    shape: Shape<'a>,
    /// The space that each particle has to itself \[length³\]; NaN where there is none.
    volumes: Option<Vec<f64>>,
    /// Whether there is nothing but positions.
    bare: bool,
    /// The convention for the lengths, in words.
    lengths: Option<String>,
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
    /// What the neighbours leave.
    Computed(&'a [f64]),
    /// The volume whose kernel this is: the product of the principal standard deviations over
    /// kernel_width³.
    Kernel,
}

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
    let shapes = columns.shapes(positions, options)?;
    let mass = columns.mass(&shapes, options)?;
    let shape = &shapes.shape;
    let is_classified = matches!(mass, Mass::Classified(_));
    let rgb = match columns.set(RGB)? {
        Some(rgb) => Some(rgb),
        None => columns.set(RED_GREEN_BLUE)?,
    };

    // The field: the one named; else, where masses are classified, a default one.
    let wanted = match &options.field {
        Some(name) => Some(name.clone()),
        None if is_classified => columns.default_field(!shapes.bare),
        None => None,
    };
    // Masses and a column of them: their density, so that columns are of mass.
    let mass_name = columns.names().1;
    let of_masses = options.for_columns
        && wanted
            .as_deref()
            .is_some_and(|name| name.eq_ignore_ascii_case(mass_name));
    let wanted = wanted.filter(|_| !of_masses);
    let computed = is_classified && wanted.is_none();
    // Mass over volume, where masses are known and nothing else is to be shown.
    let masses = match computed {
        true => columns.get(mass_name)?,
        false => None,
    };
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

    let isotropic = matches!(shape, Shape::Spheres(_));
    // Stated shapes are those of the default width.
    let scale = options.kernel_width / DEFAULT_KERNEL_WIDTH;
    let width_cubed = options.kernel_width.powi(3);
    let row = |i: usize| -> Result<Particle, LeftOut> {
        if !positions[i].is_finite() {
            return Err(LeftOut::Position);
        }
        let is_known = |v: &Values| v.get(i).is_finite();
        if !field.as_deref().is_none_or(is_known) || !masses.is_none_or(is_known) {
            return Err(LeftOut::Value);
        }
        let (factor, sigmas) = shape.at(i, scale)?;
        let kernel_volume = sigmas.iter().product::<f64>() / width_cubed;
        let (strength, volume) = mass.at(i, sigmas, kernel_volume)?;
        let colour = rgb.map_or([1.0; 3], |c| c.map(|c| linear_channel(c, i)));
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
        field: match (computed, masses) {
            (true, Some(_)) => Some(MASS_DENSITY.into()),
            (true, None) if options.for_columns => Some(NUMBER_DENSITY.into()),
            (true, None) => Some(LOG_NUMBER_DENSITY.into()),
            (false, _) => wanted.clone(),
        },
        lengths: shapes.lengths.clone(),
        sample_count: count,
        ..SampleReport::default()
    };
    let faults = rows.iter().filter_map(|row| row.as_ref().err().copied());
    LeftOut::report(&mut report, "particles", faults);
    let is_picture = !named && !options.for_columns;
    if is_picture && matches!(mass, Mass::Stated(_)) && columns.default_field(false).is_some() {
        report.note(
            count,
            "particles",
            "`mass` is taken for extinction x volume; call physical masses `m` to see the density",
        );
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
            let density = particles.iter().zip(&kept).map(|(p, &i)| match masses {
                Some(m) => narrowed(f64::from(m.get(i as usize)) / p.volume),
                None if options.for_columns => narrowed(1.0 / p.volume),
                None => narrowed(-p.volume.log10()),
            });
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

/// A channel of a colour: as it is, or decoded from sRGB where it is a byte.
fn linear_channel(column: &Values, i: usize) -> f32 {
    match column {
        Values::U8(bytes) => linear_from_srgb(f32::from(bytes[i]) / 255.0),
        _ => column.get(i),
    }
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

    /// The fields with lengths, masses and densities of smoothed particles; empty where the format
    /// has none.
    fn names(&self) -> (&'a str, &'a str, &'a str) {
        match &self.dataset.smoothing {
            Some(Smoothing {
                length,
                mass,
                density,
                ..
            }) => {
                let or_none = |name: &'a Option<String>| name.as_deref().unwrap_or("");
                (or_none(length), or_none(mass), or_none(density))
            }
            None => ("h", "m", "rho"),
        }
    }

    fn shapes(&self, positions: &[DVec3], options: &SampleOptions) -> Result<Shapes<'a>> {
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
        let kernel = options.kernel.or(smoothing.map(|s| s.kernel));
        let kernel = kernel.unwrap_or(SphKernel::CubicSpline);
        let stated_shape = |shape| Shapes {
            shape,
            volumes: None,
            bare: false,
            lengths: None,
        };
        match (options.radius, stated) {
            (Some(radius), _) => {
                let meaning = options.length.unwrap_or(LengthMeaning::Sigma);
                let lengths = Lengths::new("the radius given", meaning, kernel, |_| radius);
                Ok(self.of_lengths(positions, options, &lengths, true)?)
            }
            (None, Some(Stated::Length(column, name, meaning))) => {
                let meaning = options.length.unwrap_or(meaning);
                let lengths = Lengths::new(name, meaning, kernel, |i| f64::from(column.get(i)));
                // A sigma in a table is a kernel's own size, whatever its neighbours.
                let crowded = smoothing.is_some() || name != "sigma";
                self.of_lengths(positions, options, &lengths, crowded)
            }
            (None, Some(Stated::Variance(v))) => Ok(stated_shape(Shape::Variance(v))),
            (None, Some(Stated::ScaleRotation(s))) => Ok(stated_shape(Shape::ScaleRotation(s))),
            (None, None) => self.of_neighbours(positions, options),
        }
    }

    /// Shapes from lengths; where nothing else gives volumes, the neighbours do: 1 over the sum of
    /// the kernels at a particle, the number density of SPH.
    fn of_lengths(
        &self,
        positions: &[DVec3],
        options: &SampleOptions,
        lengths: &Lengths<impl Fn(usize) -> f64 + Sync>,
        crowded: bool,
    ) -> Result<Shapes<'a>> {
        let sigma = |i: usize| lengths.sigma_over_length * (lengths.of)(i);
        let (_, mass, density) = self.names();
        let is_table = self.dataset.smoothing.is_none();
        let states = |name| Ok::<_, Error>(is_table && self.get(name)?.is_some());
        let known = states("volume")?
            || states("mass")?
            || states("extinction")?
            || states("opacity")?
            || (self.get(mass)?.is_some() && self.get(density)?.is_some());
        let with_yu_turk = options.shape == ParticleShape::YuTurk;
        let index = if with_yu_turk || (crowded && !known) {
            PointIndex::new(positions)
        } else {
            None
        };
        let shape = match &index {
            Some(index) if with_yu_turk => {
                let support = lengths.support_over_length;
                let sizes = |i: usize| (sigma(i), support * (lengths.of)(i));
                Shape::Computed(yu_turk::variances(index, positions, sizes))
            }
            _ => Shape::Spheres((0..self.count).into_par_iter().map(sigma).collect()),
        };
        let kernel = |j: usize| {
            let s = sigma(j);
            (s > 0.0 && s.is_finite()).then_some(([s, 0.0, s, 0.0, 0.0, s], s, 1.0))
        };
        if let Some(average) = index.as_ref().and_then(|index| index.crowd(kernel)) {
            return Err(Error::format(
                &self.dataset.path,
                "particle lengths",
                "kernels that reach some dozens of neighbours",
                format!("{average} neighbours each, on average"),
                "say what the lengths are with --length, or give --radius",
            ));
        }
        let volumes = index.filter(|_| crowded && !known).map(|index| {
            let sums = index.kernel_sums(kernel);
            sums.into_iter().map(|sum| 1.0 / sum).collect()
        });
        Ok(Shapes {
            shape,
            volumes,
            bare: false,
            lengths: Some(lengths.convention.clone()),
        })
    }

    /// Shapes from the nearest neighbours: spheres, or ellipsoids where the set is anisotropic.
    fn of_neighbours(&self, positions: &[DVec3], options: &SampleOptions) -> Result<Shapes<'a>> {
        let index = PointIndex::new(positions).ok_or_else(|| {
            Error::format(
                &self.dataset.path,
                "columns",
                "a shape: sigma, h, radius, vxx..vzz or scale_0..2 with rot_0..3",
                "fewer than two distinct positions to take a spacing from",
                "add a column `sigma`, or give --radius",
            )
        })?;
        let (_, mass, density) = self.names();
        let volumes = match (self.get(mass)?, self.get(density)?) {
            (Some(mass), Some(density)) => {
                let volume = |i| f64::from(mass.get(i)) / f64::from(density.get(i));
                (0..self.count).into_par_iter().map(volume).collect()
            }
            _ => index.volumes(),
        };
        let with_covariances = match options.shape {
            ParticleShape::Covariance => true,
            ParticleShape::Automatic => is_truly_anisotropic(&index),
            ParticleShape::Isotropic | ParticleShape::YuTurk => false,
        };
        let width = DEFAULT_KERNEL_WIDTH;
        let shape = if with_covariances {
            let variance = |(c, volume): (&[f64; 6], &f64)| {
                neighbourhood_variance(*c, *volume).map(|v| v * width * width)
            };
            let covariances = index.covariances();
            Shape::Computed(covariances.par_iter().zip(&volumes).map(variance).collect())
        } else {
            Shape::Spheres(volumes.par_iter().map(|v| width * v.cbrt()).collect())
        };
        Ok(Shapes {
            shape,
            volumes: Some(volumes),
            bare: true,
            lengths: None,
        })
    }

    fn mass<'s>(&self, shapes: &'s Shapes<'_>, options: &SampleOptions) -> Result<Mass<'s>>
    where
        'a: 's,
    {
        // What a table's names mean says nothing of a snapshot's.
        let is_table = self.dataset.smoothing.is_none();
        let of_table = |name| if is_table { self.get(name) } else { Ok(None) };
        let volume = of_table("volume")?;
        let extinction = match (of_table("extinction")?, volume) {
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
                ("mass", of_table("mass")?.map(Mass::Stated)),
                ("extinction", extinction),
                ("opacity", of_table("opacity")?.map(Mass::Opacity)),
            ],
        )?;
        // A field named for column densities is what is summed, not what colours.
        let stated = stated.filter(|_| !(options.for_columns && options.field.is_some()));
        Ok(match stated {
            Some(stated) => stated,
            None => {
                let (_, mass, density) = self.names();
                let volumes = shapes.volumes.as_deref();
                Mass::Classified(
                    match (volume, self.get(mass)?, self.get(density)?, volumes) {
                        (Some(volume), ..) => Volume::Column(volume),
                        (None, Some(m), Some(rho), _) => Volume::MassOverDensity(m, rho),
                        (_, _, _, Some(volumes)) => Volume::Computed(volumes),
                        _ => Volume::Kernel,
                    },
                )
            }
        })
    }

    /// A density if there is one, else, where `any` will do, the first column without a meaning of
    /// its own that is not constant.
    fn default_field(&self, any: bool) -> Option<String> {
        let is = |name: &str, list: &[&str]| list.iter().any(|l| l.eq_ignore_ascii_case(name));
        let (length, mass, density) = self.names();
        let own = [length, mass];
        let varying = || {
            self.dataset.fields.iter().filter(|f| match &f.source {
                FieldSource::Scalar(values) => {
                    values.finite_range().is_some_and(|[lo, hi]| lo < hi)
                        && ![
                            &RESERVED[..],
                            &VARIANCE,
                            &SCALES,
                            &RGB,
                            &RED_GREEN_BLUE,
                            &own,
                        ]
                        .iter()
                        .any(|list| is(&f.name, list))
                        && !describes_the_grid(&f.name)
                }
                _ => false,
            })
        };
        varying()
            .find(|f| is(&f.name, &DENSITIES) || is(&f.name, &[density]))
            .or_else(|| varying().next().filter(|_| any))
            .map(|f| f.name.clone())
    }
}

/// One length per particle and what it means.
struct Lengths<F> {
    of: F,
    sigma_over_length: f64,
    support_over_length: f64,
    convention: String,
}

impl<F> Lengths<F> {
    fn new(name: &str, meaning: LengthMeaning, kernel: SphKernel, of: F) -> Self {
        Self {
            of,
            sigma_over_length: sph::sigma_over_length(meaning, kernel),
            support_over_length: sph::support_over_length(meaning, kernel),
            convention: sph::convention(name, meaning, kernel),
        }
    }
}

/// See [`TRUE_SHARE`].
fn is_truly_anisotropic(index: &PointIndex<'_>) -> bool {
    let covariances = index.some_covariances(TRUE_SAMPLE, TRUE_NEIGHBOURS);
    let is_long = |c: &&[f64; 6]| {
        let (spread, _) = eigen(**c);
        spread.max_element() > TRUE_RATIO * TRUE_RATIO * spread.min_element()
    };
    let long = covariances.iter().filter(is_long).count();
    long as f64 > TRUE_SHARE * covariances.len() as f64
}

/// The variance of a kernel of width 1 from the covariance of its point's neighbours: divided by
/// that of k points at unit spacing, in a ball, on a disc or along a line, whichever the
/// neighbours resemble.
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
    /// The factor of row `i`, `scale` times as wide as stated, and its principal standard
    /// deviations, greatest first.
    fn at(&self, i: usize, scale: f64) -> Result<([f64; 6], [f64; 3]), LeftOut> {
        let number = |column: &Values| f64::from(column.get(i));
        let factor = match self {
            Self::Spheres(sigmas) => {
                let sigma = scale * sigmas[i];
                return if sigma > 0.0 && sigma.is_finite() {
                    Ok(([sigma, 0.0, sigma, 0.0, 0.0, sigma], [sigma; 3]))
                } else {
                    Err(LeftOut::Size)
                };
            }
            Self::Variance(v) => factor_of_variance(v.map(number)).ok_or(LeftOut::Indefinite)?,
            Self::Computed(variances) => factor_of_variance(variances[i]).ok_or(LeftOut::Size)?,
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
        let factor = factor.map(|l| scale * l);
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
                    Volume::Computed(volumes) => volumes[i],
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
