//! Classifies the kinds of data that a volume has. Shaders are specialised for them.

use crate::blocks::{BlockedParticles, BlockedVolume, Rule};
use crate::math::harmonics_count;
use crate::record::{BlockView, ClassifiedParticle, DeviceBlock, Footprint};
use crate::scene::{ColourIn, StrengthIn, ValuesIn, is_classified};

/// Sources of positions and shapes: one for each `shaders/shared/particles_*.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum ParticleKind {
    /// [`LatticeUniform`] and the samples of the axes.
    Lattice,
    /// Blocks, and four words per particle: the offset and sigma.
    Isotropic,
    /// Blocks, and nine words per particle: the offset and the lower-triangular factor.
    Anisotropic,
    /// Blocks, and nine words per particle: the offset and the two tangents.
    Surfels,
}

impl ParticleKind {
    pub(super) fn of(particles: &BlockedParticles) -> Self {
        match particles {
            BlockedParticles::Lattice(_) => Self::Lattice,
            BlockedParticles::Isotropic { .. } => Self::Isotropic,
            BlockedParticles::Anisotropic { .. } => Self::Anisotropic,
            BlockedParticles::Surfels { .. } => Self::Surfels,
        }
    }

    /// Returns the number of words that [`pack_shapes`] writes per particle.
    pub(super) fn words_per_particle(self) -> usize {
        match self {
            Self::Lattice => 0,
            Self::Isotropic => 4,
            Self::Anisotropic | Self::Surfels => 9,
        }
    }
}

/// The type of a part's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub(super) enum ValueKind {
    /// No values: nothing is classified.
    None,
    U8,
    U16,
    I16,
    F32,
    /// For merged particles: mean and spread of each.
    Spread,
}

/// Source of a part's masses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub(super) enum StrengthKind {
    /// Extinction times a volume of each particle.
    Volumes,
    /// Extinction times the volume that all cells share.
    Cell,
    /// Extinction times the product of a cell's widths.
    Widths,
    /// Masses or opacities that particles state.
    Given,
}

/// Source of a part's colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub(super) enum ColourKind {
    Classified,
    PerParticle,
    Uniform,
    /// Computed by `shade`.
    Harmonics,
}

/// The kinds of data of a part. Shaders are specialised for them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Kinds {
    pub(super) particles: ParticleKind,
    pub(super) rule: Rule,
    pub(super) values: ValueKind,
    pub(super) strength: StrengthKind,
    pub(super) colour: ColourKind,
    /// Coefficients of a colour channel; 0 without harmonics.
    pub(super) harmonics_count: u32,
    /// True if harmonics sum to linear light instead of sRGB codes.
    pub(super) has_linear_harmonics: bool,
    /// True if its particles are merged ones.
    pub(super) is_merged: bool,
    /// True if each strength is followed by the depth of its members.
    pub(super) has_member_depths: bool,
    /// True if it is lit.
    pub(super) is_lit: bool,
    /// True if normals are stored.
    pub(super) has_normals: bool,
}

impl Kinds {
    pub(super) fn of(volume: &BlockedVolume) -> Self {
        let is_classified = is_classified(&volume.strength, &volume.colour);
        Self {
            particles: ParticleKind::of(&volume.particles),
            rule: Rule::of(volume),
            values: match &volume.values {
                Some(_) if is_classified && volume.merged.is_some() => ValueKind::Spread,
                Some(ValuesIn::U8(_)) if is_classified => ValueKind::U8,
                Some(ValuesIn::U16(_)) if is_classified => ValueKind::U16,
                Some(ValuesIn::I16(_)) if is_classified => ValueKind::I16,
                Some(ValuesIn::F32(_) | ValuesIn::F64(_)) if is_classified => ValueKind::F32,
                _ => ValueKind::None,
            },
            strength: match (&volume.strength, &volume.particles) {
                (StrengthIn::Classified { .. }, BlockedParticles::Lattice(grid)) => {
                    if grid.uniform_volume().is_some() {
                        StrengthKind::Cell
                    } else {
                        StrengthKind::Widths
                    }
                }
                (StrengthIn::Classified { .. }, _) => StrengthKind::Volumes,
                _ => StrengthKind::Given,
            },
            colour: match volume.colour {
                ColourIn::Classified => ColourKind::Classified,
                ColourIn::PerParticle(_) => ColourKind::PerParticle,
                ColourIn::Uniform(_) => ColourKind::Uniform,
                ColourIn::Harmonics { .. } => ColourKind::Harmonics,
            },
            harmonics_count: volume
                .colour
                .harmonics_degree()
                .map_or(0, |degree| harmonics_count(degree) as u32),
            has_linear_harmonics: matches!(
                volume.colour,
                ColourIn::Harmonics {
                    is_linear: true,
                    ..
                }
            ),
            is_merged: volume.merged.is_some(),
            has_member_depths: volume
                .merged
                .as_ref()
                .is_some_and(|m| !m.member_depths.is_empty()),
            is_lit: volume.is_lit(),
            has_normals: volume.normals.is_some(),
        }
    }

    /// Returns whether particles are cells of a lattice.
    pub(super) fn is_lattice(&self) -> bool {
        self.particles == ParticleKind::Lattice
    }

    /// Returns whether blocks may be transparent.
    pub(super) fn may_be_transparent(&self) -> bool {
        self.strength != StrengthKind::Given
    }

    /// Returns the bytes per particle of the largest buffer with an entry for each: the colours, or a
    /// buffer of a frame in which all particles are visible.
    ///
    /// - `may_have_pieces`: whether terms of as many pieces may follow classified particles.
    pub(super) fn bytes_per_particle(&self, may_have_pieces: bool) -> u64 {
        const { assert!(size_of::<Footprint>() >= 9 * 4) };
        let words = if may_have_pieces { 2 } else { 1 };
        let frame = size_of::<Footprint>().max(words * size_of::<ClassifiedParticle>());
        // A block has at least one particle.
        let blocks = size_of::<DeviceBlock>().max(size_of::<BlockView>());
        let colours = 12 * self.harmonics_count.max(1) as usize;
        frame.max(blocks).max(colours) as u64
    }
}
