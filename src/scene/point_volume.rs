//! Defines the renderer's input: particles with a shape, a strength and a colour.

use glam::{DMat3, DVec3};

use super::storage::{Owned, Shared, Storage};
use crate::error::{Error, Parameter, Result};
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count, lower_matrix};
use crate::scene::boundary::Boundary;
use crate::scene::lattice::Lattice;
use crate::scene::local_models::LocalModels;
use crate::scene::splat_rule::SplatRule;
use crate::scene::transfer_function::TransferFunction;
use crate::scene::values::Values;

/// A set of particles that emit and absorb light. Each is a Gaussian kernel of unit integral times a mass g =
/// extinction x volume \[length²\].
///
/// [`Particles`] has a variant for each kind of data, so that no more is stored than the data needs.
#[derive(Debug, Clone, PartialEq)]
pub struct PointVolume {
    /// Positions and shapes.
    pub particles: Particles,
    /// Source of the masses.
    pub strength: Strength,
    /// Source of the colours.
    pub colour: Colour,
    /// One scalar per particle; needed if strength or colour is classified.
    pub values: Option<Values>,
    /// The transfer function; needed if strength or colour is classified.
    pub transfer_function: Option<TransferFunction>,
    /// Boundary of the data, at which kernels are cut. With `None` kernels extend beyond the data, and density
    /// falls to half at a face. A volume with a boundary has no levels of detail. Ghosts of a set of points are
    /// ordinary particles with values of their own.
    pub boundary: Option<Boundary>,
    /// Normals for lighting, one direction per particle: usually that of the field's gradient
    /// ([`normal_code`](crate::math::normal_code); 0: no normal, the particle stays unlit). Surfels without
    /// normals use those of their tangents. Normals given for surfels describe a surface smoother than the
    /// surfels' planes and point to the front. A volume with normals has no levels of detail, because no bound
    /// is known for the light that merged particles reflect.
    pub normals: Option<Vec<u32>>,
    /// Linear models of the field over each kernel, for particles with shapes of their own. Lattices compute
    /// such models from neighbouring values.
    pub local_models: Option<LocalModels>,
}

/// Positions and shapes of particles. A shape is a factor L of the variance V = L Lᵀ.
#[derive(Debug, Clone, PartialEq)]
pub enum Particles {
    /// Positions and shapes follow from the index: L = kernel_width x local spacing.
    Lattice {
        /// The sample points.
        lattice: Lattice,
        /// Standard deviation over spacing.
        kernel_width: f64,
    },
    /// Spherical kernels.
    Isotropic {
        /// Centres, world units.
        positions: Vec<DVec3>,
        /// Standard deviations, world units.
        sigmas: Vec<f32>,
    },
    /// Arbitrary variances.
    Anisotropic {
        /// Centres, world units.
        positions: Vec<DVec3>,
        /// Lower-triangular factors: l00, l10, l11, l20, l21, l22, world units.
        factors: Vec<[f32; 6]>,
    },
    /// Surfels: flat kernels in their tangent planes, V = t1 t1ᵀ + t2 t2ᵀ.
    Surfels {
        /// Centres, world units.
        positions: Vec<DVec3>,
        /// Two tangents t1 and t2 each, world units: x, y, z of the first, then of the second.
        /// They need not be orthogonal; the front faces the side to which t1 x t2 points.
        tangents: Vec<[f32; 6]>,
        /// Whether surfels seen from behind are left out, as those of a closed surface may be. If planes clip
        /// the surface and so open it, all surfels are drawn.
        is_one_sided: bool,
    },
}

/// Source of the masses, with columns in vectors.
pub type Strength = StrengthIn<Owned>;

/// Source of the colours, with columns in vectors.
pub type Colour = ColourIn<Owned>;

/// Source of a particle's mass.
#[derive(Debug, Clone, PartialEq)]
pub enum StrengthIn<S: Storage> {
    /// extinction(value) x cell volume.
    Classified {
        /// Cell volumes \[length³\]; empty for a lattice, whose volumes follow from the index.
        volumes: S::Of<f32>,
    },
    /// The masses themselves \[length²\].
    Mass(S::Of<f32>),
    /// Splats of a radiance field: no extinction, but an opacity on the image of peak x exp(-Q/2), the same
    /// from every side and distance.
    ///
    /// They are drawn by the rule of their format; the settings for filters and opacities do not apply
    /// ([`crate::splat::peak_footprint`]).
    PeakOpacity {
        /// The opacity at the centre, 0 to 1.
        opacities: S::Of<f32>,
        /// Rule of the renderer that they were made for.
        rule: SplatRule,
        /// Whether splats are sorted by their distance from the eye, not by their depth, if nothing else is in the
        /// scene ([`Order::Auto`](crate::Order::Auto)).
        by_distance: bool,
    },
    /// Surfels of an opaque surface: the area \[length²\] that each represents, times its coverage. Together
    /// they hide what lies behind them. Overlapping surfels are averaged instead of absorbing one another
    /// ([`crate::splat::surfel_footprint`]).
    Surface(S::Of<f32>),
    /// Surfels of a translucent surface whose opacity is the same from every side, as in a mesh's material:
    /// area x -ln(1 - opacity) \[length²\]. (Surfels with a [`Strength::Mass`] absorb as sheets do: more at
    /// grazing angles.)
    Translucent(S::Of<f32>),
}

/// Source of a particle's colour.
#[derive(Debug, Clone, PartialEq)]
pub enum ColourIn<S: Storage> {
    /// The transfer function's colour of the particle's value.
    Classified,
    /// One linear RGB each.
    PerParticle(S::Of<[f32; 3]>),
    /// One linear RGB for all.
    Uniform([f32; 3]),
    /// Colours of radiance fields, which may depend on the viewing direction: [`crate::math::harmonics_sum`] in
    /// the direction from the eye to the particle, at least 0.
    Harmonics {
        /// 0 to 3.
        degree: u8,
        /// (degree + 1)² coefficients of R, G and B per particle, one particle after another.
        coefficients: S::Of<f32>,
        /// Whether sums are linear light. Otherwise they are sRGB codes, which are composited as such if
        /// [`Blend`](crate::render::Blend) says so.
        is_linear: bool,
    },
}

impl Strength {
    /// Converts the columns to a renderer's storage.
    pub(crate) fn shared(self) -> StrengthIn<Shared> {
        match self {
            Self::Classified { volumes } => StrengthIn::Classified {
                volumes: volumes.into(),
            },
            Self::Mass(masses) => StrengthIn::Mass(masses.into()),
            Self::PeakOpacity {
                opacities,
                rule,
                by_distance,
            } => StrengthIn::PeakOpacity {
                opacities: opacities.into(),
                rule,
                by_distance,
            },
            Self::Surface(areas) => StrengthIn::Surface(areas.into()),
            Self::Translucent(areas) => StrengthIn::Translucent(areas.into()),
        }
    }
}

impl<S: Storage> StrengthIn<S> {
    /// The stored numbers, one per particle: volumes, masses, areas or opacities. Empty for a classified
    /// lattice.
    pub fn stored(&self) -> &[f32] {
        match self {
            Self::Classified { volumes } => volumes,
            Self::Mass(numbers) | Self::Surface(numbers) | Self::Translucent(numbers) => numbers,
            Self::PeakOpacity { opacities, .. } => opacities,
        }
    }
}

impl Particles {
    /// Positions; empty for a lattice.
    pub(crate) fn positions(&self) -> &[DVec3] {
        match self {
            Self::Lattice { .. } => &[],
            Self::Isotropic { positions, .. }
            | Self::Anisotropic { positions, .. }
            | Self::Surfels { positions, .. } => positions,
        }
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        match self {
            Self::Lattice { lattice, .. } => lattice.len(),
            Self::Isotropic { positions, .. }
            | Self::Anisotropic { positions, .. }
            | Self::Surfels { positions, .. } => positions.len(),
        }
    }

    /// Whether there are no particles.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A particle's centre, a factor L of its variance V = L Lᵀ (world units), and the volume of a lattice's
    /// cell (0 for other particles).
    pub(crate) fn shape(&self, i: usize) -> (DVec3, DMat3, f64) {
        match self {
            Self::Lattice {
                lattice,
                kernel_width,
            } => {
                let [nx, ny, _] = lattice.dims;
                let cell = [i % nx, i / nx % ny, i / (nx * ny)];
                let step = lattice.step(cell);
                let volume = step.determinant().abs();
                (lattice.position(cell), step * *kernel_width, volume)
            }
            Self::Isotropic { positions, sigmas } => (
                positions[i],
                DMat3::from_diagonal(DVec3::splat(f64::from(sigmas[i]))),
                0.0,
            ),
            Self::Anisotropic { positions, factors } => {
                (positions[i], lower_matrix(factors[i].map(f64::from)), 0.0)
            }
            Self::Surfels {
                positions,
                tangents,
                ..
            } => {
                let [ax, ay, az, bx, by, bz] = tangents[i].map(f64::from);
                let (a, b) = (DVec3::new(ax, ay, az), DVec3::new(bx, by, bz));
                (positions[i], DMat3::from_cols(a, b, DVec3::ZERO), 0.0)
            }
        }
    }
}

impl Colour {
    /// Converts the columns to a renderer's storage.
    pub(crate) fn shared(self) -> ColourIn<Shared> {
        match self {
            Self::Classified => ColourIn::Classified,
            Self::PerParticle(colours) => ColourIn::PerParticle(colours.into()),
            Self::Uniform(colour) => ColourIn::Uniform(colour),
            Self::Harmonics {
                degree,
                coefficients,
                is_linear,
            } => ColourIn::Harmonics {
                degree,
                coefficients: coefficients.into(),
                is_linear,
            },
        }
    }
}

impl<S: Storage> ColourIn<S> {
    /// Degree of the spherical harmonics, if there are any.
    pub fn harmonics_degree(&self) -> Option<u8> {
        match self {
            Self::Harmonics { degree, .. } => Some(*degree),
            _ => None,
        }
    }
}

/// Whether a transfer function gives masses or colours.
pub(crate) fn is_classified<S: Storage>(strength: &StrengthIn<S>, colour: &ColourIn<S>) -> bool {
    matches!(strength, StrengthIn::Classified { .. }) || matches!(colour, ColourIn::Classified)
}

impl PointVolume {
    /// Returns the linear colour of particle `i`; `None` if it depends on the view. It is black if a function is to give it and there
    /// is none.
    pub(crate) fn linear_colour(&self, i: usize) -> Option<[f32; 3]> {
        match &self.colour {
            Colour::PerParticle(colours) => Some(colours[i]),
            Colour::Uniform(colour) => Some(*colour),
            Colour::Classified => {
                let [r, g, b, _] = self.classified_at(i);
                Some([r, g, b])
            }
            Colour::Harmonics { .. } => None,
        }
    }

    /// Returns the linear colour and the extinction that the transfer function gives particle `i`; zeros without one.
    pub(crate) fn classified_at(&self, i: usize) -> [f32; 4] {
        match (&self.transfer_function, &self.values) {
            (Some(transfer), Some(values)) => transfer.classify(Values::get(values, i)),
            _ => [0.0; 4],
        }
    }

    /// Whether a transfer function gives masses or colours.
    pub fn is_classified(&self) -> bool {
        is_classified(&self.strength, &self.colour)
    }

    /// Whether the volume is a lattice that stores values alone, for a transfer function to show.
    pub(crate) fn is_plain_lattice(&self) -> bool {
        matches!(self.particles, Particles::Lattice { .. })
            && matches!(&self.strength, Strength::Classified { volumes } if volumes.is_empty())
            && matches!(self.colour, Colour::Classified | Colour::Uniform(_))
            && self.values.is_some()
            && self.normals.is_none()
            && !matches!(self.boundary, Some(Boundary::Planes(_)))
    }

    /// Checks that every array has one entry per particle, that a lattice has a position and a width for each
    /// kernel, and that classified quantities have values and a transfer function.
    ///
    /// # Errors
    /// The first array of another length, or the missing one; those of [`Lattice::validate`]; a kernel width
    /// that is not a positive number.
    pub fn validate(&self) -> Result<()> {
        self.validate_of(self.particles.len())
    }

    /// Validates a volume that stores only some of its particles.
    ///
    /// - `count`: number of stored particles.
    pub(crate) fn validate_of(&self, count: usize) -> Result<()> {
        if let Particles::Lattice {
            lattice,
            kernel_width,
        } = &self.particles
        {
            lattice.validate()?;
            if !(*kernel_width > 0.0 && kernel_width.is_finite()) {
                return Err(Error::invalid(
                    "point volume",
                    Parameter::KernelWidth,
                    "a positive number",
                    kernel_width.to_string(),
                    "give a standard deviation over the spacing, such as 0.6",
                ));
            }
        }
        let is_lattice = matches!(self.particles, Particles::Lattice { .. });
        let check = |name: &str, len: usize| {
            if len == count {
                return Ok(());
            }
            Err(Error::invalid(
                "point volume",
                name,
                format!("one per particle, {count}"),
                len.to_string(),
                "give one entry for each particle",
            ))
        };
        match &self.particles {
            Particles::Lattice { .. } => {}
            Particles::Isotropic { sigmas, .. } => check("standard deviations", sigmas.len())?,
            Particles::Anisotropic { factors, .. } => check("factors", factors.len())?,
            Particles::Surfels { tangents, .. } => check("tangents", tangents.len())?,
        }
        match &self.strength {
            Strength::Classified { volumes } if is_lattice && volumes.is_empty() => {}
            Strength::Classified { volumes } => check("cell volumes", volumes.len())?,
            Strength::Mass(masses) => check("masses", masses.len())?,
            Strength::PeakOpacity { opacities, .. } => check("opacities", opacities.len())?,
            Strength::Surface(areas) | Strength::Translucent(areas) => {
                check("areas", areas.len())?;
                if !matches!(self.particles, Particles::Surfels { .. }) {
                    return Err(Error::invalid(
                        "point volume",
                        "areas",
                        "surfels",
                        "particles of another kind",
                        "give masses, or tangents instead of shapes",
                    ));
                }
            }
        }
        match &self.colour {
            Colour::PerParticle(colours) => check("colours", colours.len())?,
            Colour::Harmonics {
                degree,
                coefficients,
                ..
            } => {
                if *degree > MAX_HARMONICS_DEGREE {
                    return Err(Error::invalid(
                        "point volume",
                        "degree of the harmonics",
                        format!("at most {MAX_HARMONICS_DEGREE}"),
                        degree.to_string(),
                        "leave out the coefficients of higher degrees",
                    ));
                }
                let stride = 3 * harmonics_count(*degree);
                if count.checked_mul(stride) != Some(coefficients.len()) {
                    return Err(Error::invalid(
                        "point volume",
                        "harmonics",
                        format!("{stride} per particle of {count}"),
                        coefficients.len().to_string(),
                        "give all coefficients for each particle",
                    ));
                }
            }
            Colour::Classified | Colour::Uniform(_) => {}
        }
        match (&self.boundary, &self.particles) {
            (None, _) | (Some(Boundary::Lattice), Particles::Lattice { .. }) => {}
            (Some(Boundary::Planes(planes)), Particles::Anisotropic { .. }) => {
                check("words of the boundary", planes.of_particle.len())?;
                let most = planes.edges.len();
                if planes.of_particle.iter().any(|&word| word as usize > most) {
                    return Err(Error::invalid(
                        "point volume",
                        "boundary",
                        format!("places among {most} sets of planes"),
                        "a place beyond them",
                        "give the planes of each particle that is cut",
                    ));
                }
            }
            _ => {
                return Err(Error::invalid(
                    "point volume",
                    "boundary",
                    "a lattice's box, or planes of ellipsoids",
                    "particles of another kind",
                    "leave it out",
                ));
            }
        }
        if let Some(normals) = &self.normals {
            check("normals", normals.len())?;
        }
        if let Some(models) = &self.local_models {
            check("local models", models.len())?;
            let is_irregular = matches!(
                self.particles,
                Particles::Isotropic { .. } | Particles::Anisotropic { .. }
            );
            if !is_irregular {
                return Err(Error::invalid(
                    "point volume",
                    "local models",
                    "none: lattices find them in their values, and surfels have none",
                    models.len().to_string(),
                    "leave them out",
                ));
            }
            check("values", self.values.as_ref().map_or(0, Values::len))?;
        }
        let classified = self.is_classified();
        if classified || self.values.is_some() {
            check("values", self.values.as_ref().map_or(0, Values::len))?;
        }
        if classified && self.transfer_function.is_none() {
            return Err(Error::invalid(
                "point volume",
                "transfer function",
                "one, because masses or colours are classified",
                "none",
                "give a transfer function, or masses and colours",
            ));
        }
        Ok(())
    }
}
