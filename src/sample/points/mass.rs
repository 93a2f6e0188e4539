//! Masses of particles, or volumes for a transfer function.

use super::super::SampleOptions;
use super::super::left_out::LeftOut;
use super::columns::Columns;
use super::shape::Shapes;
use crate::error::{Error, Result};
use crate::scene::{MAX_OPACITY, Values};

/// The columns that give masses.
pub(super) enum Mass<'a> {
    /// The masses themselves.
    Stated(&'a Values),
    Extinction(&'a Values, &'a Values),
    Opacity(&'a Values),
    /// The opacity of all, where nothing states one.
    Uniform(f64),
    /// From the transfer function, with these volumes.
    Classified(Volume<'a>),
}

/// The columns that give volumes.
#[derive(Clone, Copy)]
pub(super) enum Volume<'a> {
    Column(&'a Values),
    /// The masses, the densities, and what their quotients are multiplied by.
    MassOverDensity(&'a Values, &'a Values, f64),
    /// What the neighbours leave.
    Computed(&'a [f64]),
    /// The volume whose kernel this is: the product of the principal standard deviations over
    /// kernel_width³.
    Kernel,
}

impl<'a> Columns<'a> {
    /// What gives the particles' masses.
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
    /// Mass (or, where classified, volume) of row `i`, and the volume it stands for.
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

/// The mass of a kernel of this opacity.
///
/// Seen along the axis of least depth, the shortest, the kernel's line integral is 1 / (2 pi s1 s2) with the two greatest
/// standard deviations. Flat and round kernels have that direction; a needle has none with an area to state it for.
fn of_opacity(opacity: f64, sigmas: [f64; 3]) -> Result<f64, LeftOut> {
    let area = std::f64::consts::TAU * sigmas[0] * sigmas[1];
    if opacity < 0.0 || area <= 0.0 {
        return Err(LeftOut::Strength);
    }
    Ok(-(-opacity.min(MAX_OPACITY)).ln_1p() * area)
}
