//! Computes masses of particles, or volumes for a transfer function.

use super::super::left_out::LeftOut;
use super::columns::Columns;
use super::shape::Shapes;
use crate::error::{Error, Result};
use crate::sample::options::SampleOptions;
use crate::scene::{MAX_OPACITY, Values};

/// Source of the particles' masses.
pub(super) enum Mass<'a> {
    /// The masses themselves.
    Stated(&'a Values),
    Extinction(&'a Values, &'a Values),
    Opacity(&'a Values),
    /// One opacity for all particles, if no column states any.
    Uniform(f64),
    /// From the transfer function, with these volumes.
    Classified(Volume<'a>),
}

/// Source of the particles' volumes.
#[derive(Clone, Copy)]
pub(super) enum Volume<'a> {
    Column(&'a Values),
    /// The masses, the densities, and a factor of their quotients.
    MassOverDensity(&'a Values, &'a Values, f64),
    /// Volumes computed from neighbours.
    Computed(&'a [f64]),
    /// The volume of the kernel: the product of the principal standard deviations over kernel_width³.
    Kernel,
}

impl<'a> Columns<'a> {
    /// Chooses the source of the particles' masses.
    pub(super) fn mass<'s>(
        &self,
        shapes: &'s Shapes<'_>,
        options: &SampleOptions,
    ) -> Result<Mass<'s>>
    where
        'a: 's,
    {
        let volume = self.of_table("volume")?;
        let extinction = match (self.of_table("extinction")?, volume) {
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
                ("mass", self.of_table("mass")?.map(Mass::Stated)),
                ("extinction", extinction),
                ("opacity", self.of_table("opacity")?.map(Mass::Opacity)),
            ],
        )?;
        // For column densities, a named field is summed and sets no colour.
        let stated = stated.filter(|_| !(options.purpose.for_columns && options.field.is_some()));
        Ok(match stated {
            Some(stated) => stated,
            None => {
                let (_, mass, density) = self.names();
                let volumes = shapes.volumes.as_deref();
                Mass::Classified(
                    match (volume, self.get(mass)?, self.get(density)?, volumes) {
                        (Some(volume), ..) => Volume::Column(volume),
                        (None, Some(m), Some(rho), _) => {
                            Volume::MassOverDensity(m, rho, self.dataset.volume_scale)
                        }
                        (_, _, _, Some(volumes)) => Volume::Computed(volumes),
                        _ => Volume::Kernel,
                    },
                )
            }
        })
    }
}

impl Mass<'_> {
    /// Returns the mass of row `i` (or the volume, if classified), and the volume that it represents.
    pub(super) fn at(
        &self,
        i: usize,
        sigmas: [f64; 3],
        kernel_volume: f64,
    ) -> Result<(f64, f64), LeftOut> {
        let number = |column: &Values| f64::from(column.get(i));
        let (strength, volume) = match self {
            Self::Stated(mass) => (number(mass), kernel_volume),
            Self::Extinction(extinction, volume) => {
                (number(extinction) * number(volume), number(volume))
            }
            Self::Opacity(opacity) => (of_opacity(number(opacity), sigmas)?, kernel_volume),
            Self::Uniform(opacity) => (of_opacity(*opacity, sigmas)?, kernel_volume),
            Self::Classified(volume) => {
                let volume = match volume {
                    Volume::Column(volume) => number(volume),
                    Volume::MassOverDensity(m, rho, scale) => scale * number(m) / number(rho),
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

/// Returns the mass of a kernel of this opacity.
///
/// The opacity is that along the shortest axis, the axis of least depth. The kernel's line integral there is 1
/// / (2 pi s1 s2), with s1 and s2 the two greatest standard deviations. A needle has no area perpendicular to
/// its shortest axis, so its opacity is undefined.
fn of_opacity(opacity: f64, sigmas: [f64; 3]) -> Result<f64, LeftOut> {
    let area = std::f64::consts::TAU * sigmas[0] * sigmas[1];
    if opacity < 0.0 || area <= 0.0 {
        return Err(LeftOut::Strength);
    }
    Ok(-(-opacity.min(MAX_OPACITY)).ln_1p() * area)
}
