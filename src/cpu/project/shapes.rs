//! Computes positions and shapes of particles in camera space.

use glam::{Mat3, Vec3};

use crate::blocks::{Block, BlockedParticles, BlockedVolume, BrickGrid};
use crate::constants::MOST_EDGES;
use crate::math::Factor;
use crate::record::PieceTerms;
use crate::scene::NO_EDGE;

/// Positions and factors of a volume's particles, rotated into camera space.
pub(in crate::cpu) struct Shapes<'a> {
    volume: &'a BlockedVolume,
    rotation: Mat3,
    /// For a lattice: the directions of its axes in camera space.
    turned_basis: Mat3,
    shared: Option<Factor>,
}

impl<'a> Shapes<'a> {
    pub(in crate::cpu) fn new(volume: &'a BlockedVolume, rotation: Mat3) -> Self {
        let (turned_basis, shared) = match &volume.particles {
            BlockedParticles::Lattice(grid) => (
                rotation * grid.basis(),
                grid.shared_factor()
                    .map(|f| Factor::from_matrix(rotation * f)),
            ),
            _ => (rotation, None),
        };
        Self {
            volume,
            rotation,
            turned_basis,
            shared,
        }
    }

    /// Returns a vector of the world in camera space.
    pub(in crate::cpu) fn turned(&self, world: Vec3) -> Vec3 {
        self.rotation * world
    }

    pub(in crate::cpu) fn of_block(&self, block: u32) -> BlockShapes<'_> {
        let cells = match &self.volume.particles {
            BlockedParticles::Lattice(grid) => grid.cells(block),
            _ => [[0; 2]; 3],
        };
        BlockShapes {
            shapes: self,
            block: &self.volume.blocks[block as usize],
            cells,
        }
    }
}

/// The shapes of one block's particles.
pub(in crate::cpu) struct BlockShapes<'a> {
    shapes: &'a Shapes<'a>,
    pub(in crate::cpu) block: &'a Block,
    /// A brick's cells.
    cells: [[usize; 2]; 3],
}

impl BlockShapes<'_> {
    /// Returns the axis of a piece in the frame of the factor's columns in camera space. For a sphere these are
    /// the camera's axes, so its axis is rotated. All other axes turn with the kernel.
    #[inline]
    pub(in crate::cpu) fn axis(&self, piece: &PieceTerms) -> Vec3 {
        let axis = Vec3::from(piece.axis);
        match &self.shapes.volume.particles {
            BlockedParticles::Isotropic { .. } => self.shapes.rotation * axis,
            _ => axis,
        }
    }

    /// Returns the planes that may cut a particle's kernel, world space; an infinite distance stands for
    /// no plane.
    pub(in crate::cpu) fn edges(&self, local: u32) -> [[f32; 4]; MOST_EDGES] {
        let volume = self.shapes.volume;
        match &volume.particles {
            BlockedParticles::Lattice(grid) => {
                grid.edges(BrickGrid::cell(self.cells.map(|[first, _]| first), local))
            }
            _ => {
                let planes = volume.boundary.as_ref();
                let own = planes.and_then(|p| p.of((self.block.first + local) as usize));
                own.copied().unwrap_or([NO_EDGE; MOST_EDGES])
            }
        }
    }

    /// Returns the offset from the block's origin and the factor, camera space.
    #[inline(always)]
    pub(in crate::cpu) fn get(&self, local: u32) -> (Vec3, Factor) {
        let Shapes {
            volume,
            rotation,
            turned_basis,
            shared,
        } = self.shapes;
        let i = (self.block.first + local) as usize;
        match &volume.particles {
            BlockedParticles::Lattice(grid) => {
                let cell = BrickGrid::cell(self.cells.map(|[first, _]| first), local);
                let factor = shared.unwrap_or_else(|| grid.cell_factor(turned_basis, cell));
                (*rotation * grid.offset(self.cells, cell), factor)
            }
            BlockedParticles::Isotropic { offsets, sigmas } => (
                *rotation * Vec3::from(offsets[i]),
                Factor::sphere(sigmas[i]),
            ),
            BlockedParticles::Anisotropic { offsets, factors } => (
                *rotation * Vec3::from(offsets[i]),
                Factor::rotated(rotation, &factors[i]),
            ),
            BlockedParticles::Surfels {
                offsets, tangents, ..
            } => (
                *rotation * Vec3::from(offsets[i]),
                Factor::of_tangents(rotation, &tangents[i]),
            ),
        }
    }
}
