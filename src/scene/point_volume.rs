//! The volume as the renderer takes it: particles with a shape, a strength and a colour.

use glam::DVec3;

use super::{Lattice, TransferFunction, Values};

/// A set of particles that emit and absorb light; each is a Gaussian kernel of unit integral
/// times a mass g = extinction x volume \[length²\].
///
/// What is stored follows what the data needs: see [`Particles`].
#[derive(Debug, Clone, PartialEq)]
pub struct PointVolume {
    /// Where the particles lie and what shape they have.
    pub particles: Particles,
    /// Where their masses come from.
    pub strength: Strength,
    /// Where their colours come from.
    pub colour: Colour,
    /// One scalar per particle; needed where strength or colour is classified.
    pub values: Option<Values>,
    /// The transfer function; needed where strength or colour is classified.
    pub transfer_function: Option<TransferFunction>,
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
}

/// Where the mass of a particle comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Strength {
    /// extinction(value) x cell volume.
    Classified {
        /// Cell volumes \[length³\]; empty for a lattice, whose volumes follow from the index.
        volumes: Vec<f32>,
    },
    /// The masses themselves \[length²\].
    Mass(Vec<f32>),
}

/// Where the colour of a particle comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Colour {
    /// The transfer function's colour of the particle's value.
    Classified,
    /// One linear RGB each.
    PerParticle(Vec<[f32; 3]>),
    /// One linear RGB for all.
    Uniform([f32; 3]),
}

impl Particles {
    /// How many particles there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Lattice { lattice, .. } => lattice.len(),
            Self::Isotropic { positions, .. } | Self::Anisotropic { positions, .. } => {
                positions.len()
            }
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
