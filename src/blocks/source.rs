//! Defines the particles from which levels of detail are made.

use glam::DVec3;

use crate::math::{lower_matrix, symmetric};
use crate::scene::{
    BoundaryPlanesIn, ColourIn, LocalModelsIn, Shared, StrengthIn, ValuesIn, cut_kernel,
};

/// Particles to merge, in block order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) positions: &'a [DVec3],
    pub(super) shapes: Shapes<'a>,
    /// Least and greatest standard deviation of each particle, unless all are spheres.
    pub(super) principal: &'a [[f32; 2]],
    pub(super) strength: &'a StrengthIn<Shared>,
    pub(super) colour: &'a ColourIn<Shared>,
    pub(super) values: Option<&'a ValuesIn<Shared>>,
    pub(super) models: Option<&'a LocalModelsIn<Shared>>,
    pub(super) boundary: Option<&'a BoundaryPlanesIn<Shared>>,
}

/// Shapes of particles.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shapes<'a> {
    Spheres(&'a [f32]),
    Factors(&'a [[f32; 6]]),
}

/// A particle to merge, cut by the domain.
#[derive(Debug, Clone)]
pub(super) struct Member {
    pub(super) index: usize,
    pub(super) strength: f64,
    /// Mean relative to the block's origin.
    pub(super) offset: DVec3,
    /// xx, xy, xz, yy, yz, zz.
    pub(super) variance: [f64; 6],
    /// Vectors whose third powers sum to the third central moments; empty if nothing is cut.
    pub(super) skews: Vec<DVec3>,
}

impl Source<'_> {
    /// Least and greatest standard deviation of a particle.
    #[inline]
    pub(super) fn sigmas(&self, i: usize) -> [f32; 2] {
        match self.shapes {
            Shapes::Spheres(sigmas) => [sigmas[i]; 2],
            Shapes::Factors(_) => self.principal[i],
        }
    }

    /// Returns the strength of an uncut particle; `None` if it draws nothing or has no value.
    fn whole_strength(&self, i: usize) -> Option<f64> {
        let strength = self.strength.stored()[i];
        let has_value = self.values.is_none_or(|v| !v.get(i).is_nan());
        (strength > 0.0 && strength.is_finite() && has_value).then_some(f64::from(strength))
    }

    /// Returns the strength of a particle that the domain leaves.
    pub(super) fn strength_left(&self, i: usize) -> Option<f64> {
        match self.boundary.and_then(|b| b.of(i)) {
            None => self.whole_strength(i),
            Some(_) => self.member(i, self.positions[i]).map(|m| m.strength),
        }
    }

    /// Returns a particle cut by the domain; `None` if it draws nothing (no strength, no value, or outside the domain).
    pub(super) fn member(&self, i: usize, origin: DVec3) -> Option<Member> {
        let strength = self.whole_strength(i)?;
        let lower @ [l00, l10, l11, l20, l21, l22] = match self.shapes {
            Shapes::Spheres(sigmas) => {
                let l = f64::from(sigmas[i]);
                [l, 0.0, l, 0.0, 0.0, l]
            }
            Shapes::Factors(factors) => factors[i].map(f64::from),
        };
        let whole = Member {
            index: i,
            strength,
            offset: self.positions[i] - origin,
            variance: [
                l00 * l00,
                l00 * l10,
                l00 * l20,
                l10 * l10 + l11 * l11,
                l10 * l20 + l11 * l21,
                l20 * l20 + l21 * l21 + l22 * l22,
            ],
            skews: Vec::new(),
        };
        let Some(planes) = self.boundary.and_then(|b| b.of(i)) else {
            return Some(whole);
        };
        let left = cut_kernel(lower_matrix(lower), planes)?;
        Some(Member {
            index: i,
            strength: whole.strength * left.share,
            offset: whole.offset + left.shift,
            variance: symmetric(left.factor * left.factor.transpose()),
            skews: left.skews,
        })
    }
}
