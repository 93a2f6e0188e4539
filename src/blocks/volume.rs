//! Defines a volume in blocks: its particles, and the data that each of them has.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::block::Block;
use super::brick::BrickGrid;
use super::merged::Merged;
use crate::constants::FAINT_SHARE;
use crate::math::Core;
#[cfg(feature = "prepared")]
use crate::scene::Requirements;
use crate::scene::columns::{Columns, columns, columns_of_fields};
use crate::scene::{
    BoundaryPlanesIn, ColourIn, Column, Lobes, LocalModelsIn, Shared, StrengthIn, TransferFunction,
    ValuesIn,
};

/// A point volume that is ready for rendering: its particles in blocks of at most
/// [`BLOCK_CAPACITY`](crate::constants::BLOCK_CAPACITY).
#[derive(Debug, Clone)]
pub struct BlockedVolume {
    /// The blocks.
    pub blocks: Vec<Block>,
    /// Positions and shapes in block order.
    pub particles: BlockedParticles,
    /// Masses, or the volumes to classify, in block order.
    pub strength: StrengthIn<Shared>,
    /// Colours in block order, or their source.
    pub colour: ColourIn<Shared>,
    /// Values in block order (a lattice's stay in the lattice's order). The values of a block of points ascend, NaN
    /// last.
    pub values: Option<ValuesIn<Shared>>,
    /// Transfer function, if anything is classified.
    pub transfer_function: Option<TransferFunction>,
    /// Codes of normals in the order of the values, if particles can be lit.
    pub normals: Option<Column<u32>>,
    /// Variation of the field over each kernel, if it is stored; that of a lattice follows from its values.
    pub local_models: Option<LocalModelsIn<Shared>>,
    /// Transfer function over the extents of kernels, if any block's kernels are too wide to be classified by their
    /// values.
    pub lobes: Option<Arc<Lobes>>,
    /// Planes at which the domain of the data cuts points, in block order. A lattice's grid has its own faces.
    pub boundary: Option<BoundaryPlanesIn<Shared>>,
    /// Caller's number of each particle, if that is kept; the particles of a lattice stay in their order.
    pub indices: Option<Column<u32>>,
    /// Data of merged particles, in a level of detail.
    pub merged: Option<Merged>,
}

/// Positions and shapes of a [`BlockedVolume`].
#[derive(Debug, Clone)]
pub enum BlockedParticles {
    /// Particle `local` of brick `block` is a cell of the lattice.
    Lattice(Box<BrickGrid>),
    /// Spheres: offsets from the block's origin and standard deviations.
    Isotropic {
        /// World units, relative to the block's origin.
        offsets: Column<[f32; 3]>,
        /// World units.
        sigmas: Column<f32>,
    },
    /// Ellipsoids: offsets from the block's origin and lower-triangular factors.
    Anisotropic {
        /// World units, relative to the block's origin.
        offsets: Column<[f32; 3]>,
        /// l00, l10, l11, l20, l21, l22, world units.
        factors: Column<[f32; 6]>,
    },
    /// Surfels: offsets from the block's origin and two tangents.
    Surfels {
        /// World units, relative to the block's origin.
        offsets: Column<[f32; 3]>,
        /// x, y, z of the first tangent, then of the second, world units.
        tangents: Column<[f32; 6]>,
        /// Whether surfels seen from behind are left out.
        is_one_sided: bool,
    },
}

columns! { [] Shared, BlockedParticles {
    Self::Lattice(_) => {}
    Self::Isotropic { offsets, sigmas } => {
        "offset": [[f32; 3]; 1] in offsets;
        "sigma": [f32; 1] in sigmas;
    }
    Self::Anisotropic { offsets, factors } => {
        "offset": [[f32; 3]; 1] in offsets;
        "factor": [[f32; 6]; 1] in factors;
    }
    Self::Surfels { offsets, tangents, .. } => {
        "offset": [[f32; 3]; 1] in offsets;
        "tangents": [[f32; 6]; 1] in tangents;
    }
} }

columns_of_fields! { Shared, BlockedVolume {
    particles strength colour values local_models merged;
    "normal": [u32; 1] in normals;
    "index": [u32; 1] in indices;
    boundary
} }

impl BlockedVolume {
    /// Bytes kept per particle of a volume, including its levels of detail and all blocks.
    pub fn bytes_per_particle(family: &[Self]) -> f64 {
        let bytes: usize = family.iter().map(Self::bytes).sum();
        bytes as f64 / family.first().map_or(1, |v| v.particle_count().max(1)) as f64
    }

    /// Bytes kept, including the blocks.
    pub fn bytes(&self) -> usize {
        let columns: usize = self.columns().iter().map(|own| own.bytes.len()).sum();
        let blocks = size_of_val(&*self.blocks);
        let merged = self.merged.as_ref();
        let merged = merged.map_or(0, |own| size_of_val(&*own.bounds));
        let boundary = self.boundary.as_ref().map_or(0, |boundary| {
            size_of_val(&*boundary.of_particle) + size_of_val(&*boundary.edges)
        });
        columns + blocks + merged + boundary
    }

    /// Whether the particles lie in a mapped file, of which parts that are never read take no memory.
    pub(crate) fn is_mapped(&self) -> bool {
        match &self.particles {
            BlockedParticles::Lattice(_) => false,
            BlockedParticles::Isotropic { offsets, .. }
            | BlockedParticles::Anisotropic { offsets, .. }
            | BlockedParticles::Surfels { offsets, .. } => offsets.is_mapped(),
        }
    }

    /// Number of particles.
    pub fn particle_count(&self) -> usize {
        match &self.particles {
            BlockedParticles::Lattice(grid) => grid.len(),
            BlockedParticles::Isotropic { offsets, .. }
            | BlockedParticles::Anisotropic { offsets, .. }
            | BlockedParticles::Surfels { offsets, .. } => offsets.len(),
        }
    }

    /// Calls `each(local, i, cell)` for every particle of a block, in order: its number within the block, its index in
    /// arrays of one entry per particle and, on a lattice, its cell.
    #[inline]
    pub(crate) fn for_each_particle(
        &self,
        block: u32,
        mut each: impl FnMut(u32, usize, Option<(&BrickGrid, [usize; 3])>),
    ) {
        let BlockedParticles::Lattice(grid) = &self.particles else {
            let b = &self.blocks[block as usize];
            for local in 0..b.count {
                each(local, (b.first + local) as usize, None);
            }
            return;
        };
        let [x, y, z] = grid.cells(block);
        let corner = [x[0], y[0], z[0]];
        for k in z[0]..z[1] {
            for j in y[0]..y[1] {
                let row = grid.index([x[0], j, k]);
                for n in 0..x[1] - x[0] {
                    let cell = [x[0] + n, j, k];
                    each(BrickGrid::local(corner, cell), row + n, Some((grid, cell)));
                }
            }
        }
    }

    /// Returns the middles and half extents of boxes around the visible part of the volume, grown by one standard
    /// deviation; world units. Values with less than a hundredth of the greatest extinction do not count.
    pub fn visible_boxes(&self) -> Vec<(DVec3, DVec3)> {
        let boxes = self.visible_box_of_each(self.transfer_function.as_ref());
        boxes.into_iter().flatten().collect()
    }

    /// Returns the boxes for a fitted camera. Splats far from the region with 99.5 % of opacity times area do not
    /// count.
    pub(crate) fn fitted_boxes(&self) -> Vec<(DVec3, DVec3)> {
        let core = self.core();
        let of_core = |core: &Core| {
            let boxes = self.blocks.iter();
            let boxes: Vec<_> = boxes
                .filter_map(|b| self.splats_box(b, Some(core)))
                .collect();
            Some(boxes).filter(|boxes| !boxes.is_empty())
        };
        let boxes = core.as_ref().and_then(of_core);
        boxes.unwrap_or_else(|| self.visible_boxes())
    }

    /// Returns the ball that holds 99.5 % of the splats' opacity times area, with a margin; `None` for other particles.
    fn core(&self) -> Option<Core> {
        /// Most splats that are read: of more, an even selection.
        const MOST: usize = 1 << 20;
        let StrengthIn::PeakOpacity { opacities, .. } = &self.strength else {
            return None;
        };
        let BlockedParticles::Anisotropic { offsets, factors } = &self.particles else {
            return None;
        };
        // Lines and points of meshes are splats too, and none is stray.
        if !matches!(
            self.colour,
            ColourIn::Harmonics { .. } | ColourIn::Classified
        ) {
            return None;
        }
        let step = self.particle_count().div_ceil(MOST).max(1);
        let weight = |i: usize| {
            let area = greatest_area(factors[i].map(f64::from));
            f64::from(opacities[i]) * area
        };
        let points = self.blocks.iter().flat_map(|block| {
            let members = block.first as usize..(block.first + block.count) as usize;
            let chosen = members.filter(move |i| i % step == 0 && opacities[*i] >= FAINT_SHARE);
            chosen.map(move |i| (block.origin + Vec3::from(offsets[i]).as_dvec3(), weight(i)))
        });
        Core::of(&points.collect::<Vec<_>>())
    }

    /// Returns the visible box of each block, under another transfer function.
    pub(crate) fn visible_box_of_each(
        &self,
        transfer: Option<&TransferFunction>,
    ) -> Vec<Option<(DVec3, DVec3)>> {
        let (transfer, values) = match (&self.strength, transfer, &self.values) {
            (StrengthIn::Classified { .. }, Some(transfer), Some(values)) => (transfer, values),
            _ => {
                let seen = |b: &Block| {
                    self.splats_box(b, None)
                        .unwrap_or_else(|| self.whole_box(b))
                };
                return self.blocks.iter().map(|b| Some(seen(b))).collect();
            }
        };
        let [lowest, highest] = transfer.range();
        let least = (transfer.max_extinction(lowest, highest) * FAINT_SHARE).max(f32::MIN_POSITIVE);
        let offsets = match &self.particles {
            // Bricks are small and have no gaps: their ranges suffice.
            BlockedParticles::Lattice(_) => None,
            BlockedParticles::Isotropic { offsets, .. }
            | BlockedParticles::Anisotropic { offsets, .. }
            | BlockedParticles::Surfels { offsets, .. } => Some(offsets),
        };
        let seen = |block: &Block| {
            let [lo, hi] = block.value_range;
            if lo > hi || transfer.max_extinction(lo, hi) < least {
                return None;
            }
            let Some(offsets) = offsets else {
                return self.within_domain(self.whole_box(block));
            };
            let members = block.first as usize..(block.first + block.count) as usize;
            let bounds = members
                .filter(|&i| !self.is_beyond_domain(i))
                .filter(|&i| transfer.classify(values.get(i))[3] >= least)
                .map(|i| (Vec3::from(offsets[i]), Vec3::from(offsets[i])))
                .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
            bounds.map(|(lower, upper)| {
                let middle = block.origin + ((lower + upper) / 2.0).as_dvec3();
                // The domain cuts kernels that would reach beyond.
                let reach = if self.boundary.is_some() {
                    0.0
                } else {
                    block.max_sigma
                };
                (middle, ((upper - lower) / 2.0 + reach).as_dvec3())
            })
        };
        self.blocks.iter().map(seen).collect()
    }

    /// Returns the features that a frame needs to draw the volume.
    #[cfg(feature = "prepared")]
    pub(crate) fn requirements(&self) -> Requirements {
        let shape_floats = match self.particles {
            BlockedParticles::Lattice(_) => None,
            BlockedParticles::Isotropic { .. } => Some(1),
            BlockedParticles::Anisotropic { .. } | BlockedParticles::Surfels { .. } => Some(6),
        };
        Requirements {
            normals: self.normals.is_some(),
            local_models: self.local_models.is_some(),
            ..Requirements::of_columns(
                shape_floats,
                &self.strength,
                &self.colour,
                self.values.as_ref(),
            )
        }
    }

    /// Intersects a box (middle and half extent) with the box at whose faces a lattice's kernels are cut.
    fn within_domain(&self, (middle, half): (DVec3, DVec3)) -> Option<(DVec3, DVec3)> {
        let BlockedParticles::Lattice(grid) = &self.particles else {
            return Some((middle, half));
        };
        let Some([lower, upper]) = grid.domain() else {
            return Some((middle, half));
        };
        let (lower, upper) = (lower.max(middle - half), upper.min(middle + half));
        // A brick of ghosts has nothing inside.
        let is_any = lower.cmple(upper).all();
        is_any.then(|| ((lower + upper) / 2.0, (upper - lower) / 2.0))
    }

    /// Whether a point particle is a ghost beyond the domain.
    fn is_beyond_domain(&self, i: usize) -> bool {
        let edges = self.boundary.as_ref().and_then(|b| b.of(i));
        edges.is_some_and(|edges| edges.iter().any(|edge| edge[3] < 0.0))
    }

    /// Whether particles can be lit: surfels, and particles with normals. Splats that state their opacity belong to a
    /// radiance field, which is lit already.
    pub fn is_lit(&self) -> bool {
        let has_normals =
            self.normals.is_some() || matches!(self.particles, BlockedParticles::Surfels { .. });
        has_normals && !self.is_of_splats()
    }

    /// Returns the index of particle `local` of a block in arrays of one entry per particle, and its offset from the
    /// block's origin, world units.
    #[inline]
    pub(crate) fn place(&self, block: u32, local: u32) -> (usize, Vec3) {
        match &self.particles {
            BlockedParticles::Lattice(grid) => {
                let cells = grid.cells(block);
                let cell = BrickGrid::cell(cells.map(|[first, _]| first), local);
                (grid.index(cell), grid.offset(cells, cell))
            }
            BlockedParticles::Isotropic { offsets, .. }
            | BlockedParticles::Anisotropic { offsets, .. }
            | BlockedParticles::Surfels { offsets, .. } => {
                let i = (self.blocks[block as usize].first + local) as usize;
                (i, Vec3::from(offsets[i]))
            }
        }
    }

    /// Whether the caller's number of each particle is known.
    pub(crate) fn is_numbered(&self) -> bool {
        matches!(self.particles, BlockedParticles::Lattice(_)) || self.indices.is_some()
    }

    /// Returns the caller's number of the particle at [`Self::place`] `index`, in a numbered volume.
    pub(crate) fn number(&self, index: usize) -> usize {
        if let BlockedParticles::Lattice(grid) = &self.particles {
            return grid.own_index(index);
        }
        let order = self.indices.as_ref();
        order.map_or(index, |order| order[index] as usize)
    }

    /// Whether a transfer function gives all that the particles of a lattice show, but for a colour of all: nothing else
    /// is stored for each.
    pub(super) fn has_values_alone(&self) -> bool {
        matches!(&self.strength, StrengthIn::Classified { volumes } if volumes.is_empty())
            && matches!(self.colour, ColourIn::Classified | ColourIn::Uniform(_))
            && self.values.is_some()
    }

    /// Whether the domain of the data cuts kernels.
    pub fn has_boundary(&self) -> bool {
        match &self.particles {
            BlockedParticles::Lattice(grid) => grid.has_faces(),
            _ => self.boundary.is_some(),
        }
    }

    /// Whether the particles are surfels of an opaque surface.
    pub fn is_surface(&self) -> bool {
        matches!(self.strength, StrengthIn::Surface(_))
    }

    /// Whether the particles are splats, which state their opacity.
    pub fn is_of_splats(&self) -> bool {
        matches!(self.strength, StrengthIn::PeakOpacity { .. })
    }

    /// Whether the particles are splats of a radiance field that are sorted by depth.
    pub(crate) fn is_by_depth(&self) -> bool {
        matches!(
            self.strength,
            StrengthIn::PeakOpacity {
                by_distance: false,
                ..
            }
        )
    }

    /// Whether the particles are splats of a radiance field whose colours are sRGB codes.
    pub fn is_encoded(&self) -> bool {
        self.is_of_splats()
            && matches!(
                self.colour,
                ColourIn::Harmonics {
                    is_linear: false,
                    ..
                }
            )
    }

    /// Returns the box of splats that state their opacity, each grown by its own extent: some are much larger than
    /// others.
    ///
    /// - `core`: region of the splats that count, if not all do.
    fn splats_box(&self, block: &Block, core: Option<&Core>) -> Option<(DVec3, DVec3)> {
        let StrengthIn::PeakOpacity { opacities, .. } = &self.strength else {
            return None;
        };
        let BlockedParticles::Anisotropic { offsets, factors } = &self.particles else {
            return None;
        };
        let members = block.first as usize..(block.first + block.count) as usize;
        let bounds = members
            .filter(|&i| opacities[i] >= FAINT_SHARE)
            .filter(|&i| {
                let place =
                    |core: &Core| core.holds(block.origin + Vec3::from(offsets[i]).as_dvec3());
                core.is_none_or(place)
            })
            .map(|i| {
                let [l00, l10, l11, l20, l21, l22] = factors[i];
                let rows = [
                    Vec3::X * l00,
                    Vec3::new(l10, l11, 0.0),
                    Vec3::new(l20, l21, l22),
                ];
                let (centre, reach) = (Vec3::from(offsets[i]), Vec3::from(rows.map(Vec3::length)));
                (centre - reach, centre + reach)
            })
            .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        bounds.map(|(lower, upper)| {
            let middle = block.origin + ((lower + upper) / 2.0).as_dvec3();
            (middle, ((upper - lower) / 2.0).as_dvec3())
        })
    }

    /// Middles and half extents of the blocks' boxes, grown by one standard deviation; world units.
    pub fn boxes(&self) -> Vec<(DVec3, DVec3)> {
        self.blocks.iter().map(|b| self.whole_box(b)).collect()
    }

    fn whole_box(&self, block: &Block) -> (DVec3, DVec3) {
        (
            block.origin,
            (block.half_extent + block.max_sigma).as_dvec3(),
        )
    }
}

/// Returns the product of a kernel's two greatest standard deviations, within a factor of sqrt(3). It is the root of
/// the second invariant of L Lᵀ, the sum of the squares of the minors of L.
fn greatest_area([l00, l10, l11, l20, l21, l22]: [f64; 6]) -> f64 {
    let rows = [
        DVec3::new(l00, 0.0, 0.0),
        DVec3::new(l10, l11, 0.0),
        DVec3::new(l20, l21, l22),
    ];
    let [a, b, c] = rows;
    let minors = [a.cross(b), b.cross(c), c.cross(a)];
    minors.map(DVec3::length_squared).iter().sum::<f64>().sqrt()
}
