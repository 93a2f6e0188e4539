//! Adds ghosts around a lattice: their values are extrapolated linearly, all else is copied from the nearest
//! sample.

use crate::math::harmonics_count;
use crate::scene::boundary::Boundary;
use crate::scene::point_volume::{Colour, Particles, PointVolume, Strength};

impl PointVolume {
    /// Adds its ghosts to a lattice that has a boundary; leaves other volumes as they are.
    pub(crate) fn with_ghosts(self) -> Self {
        let (
            Some(Boundary::Lattice),
            Particles::Lattice {
                lattice,
                kernel_width,
            },
        ) = (&self.boundary, &self.particles)
        else {
            return self;
        };
        let particles = Particles::Lattice {
            lattice: lattice.with_ghosts(),
            kernel_width: *kernel_width,
        };
        let copied = |v: Vec<f32>| lattice.copied_to_ghosts(&v);
        let strength = match self.strength {
            // Volumes follow from the index.
            Strength::Classified { volumes } if volumes.is_empty() => {
                Strength::Classified { volumes }
            }
            Strength::Classified { volumes } => Strength::Classified {
                volumes: copied(volumes),
            },
            Strength::Mass(masses) => Strength::Mass(copied(masses)),
            Strength::Surface(areas) => Strength::Surface(copied(areas)),
            Strength::Translucent(areas) => Strength::Translucent(copied(areas)),
            Strength::PeakOpacity {
                opacities,
                is_anti_aliased,
            } => Strength::PeakOpacity {
                opacities: copied(opacities),
                is_anti_aliased,
            },
        };
        let colour = match self.colour {
            Colour::PerParticle(colours) => Colour::PerParticle(lattice.copied_to_ghosts(&colours)),
            Colour::Harmonics {
                degree,
                coefficients,
                is_linear,
            } => {
                let stride = 3 * harmonics_count(degree);
                let sets: Vec<&[f32]> = coefficients.chunks_exact(stride).collect();
                Colour::Harmonics {
                    degree,
                    coefficients: lattice.copied_to_ghosts(&sets).concat(),
                    is_linear,
                }
            }
            other => other,
        };
        let values = self
            .values
            .map(|values| lattice.values_with_ghosts(&values));
        let normals = self.normals.map(|codes| lattice.copied_to_ghosts(&codes));
        Self {
            particles,
            strength,
            colour,
            values,
            transfer_function: self.transfer_function,
            boundary: self.boundary,
            normals,
            // A lattice has no local models: they follow from its values, including those of ghosts.
            local_models: self.local_models,
        }
    }
}
