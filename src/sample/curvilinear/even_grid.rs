//! Sums kernels at the nodes of a curvilinear grid with a sharp boundary. The kernels around a node are found
//! by their indices, however long they are.

use std::ops::Range;

use rayon::prelude::*;

use super::structured::Grid;
use crate::parallel;
use crate::sample::field::gradient::step_along;
use crate::sample::kernels::even::CutKernels;
use crate::sample::kernels::sums::Density;

/// Marks a node without a particle.
const NONE: u32 = u32::MAX;

/// Least change of the spacing at a node for which sums are formed, over the distance between its neighbours.
/// Below it (a growth of 1.1 per cell), sums are within .4 % of 1 for kernels of .6 spacings.
const LEAST_BEND: f64 = 0.05;

/// Nodes along an index, in each direction, over which a change of the spacing makes sums uneven.
const NEAR_BEND: isize = 2;

/// Greatest number of nodes searched along an index, however wide the kernels are.
const MOST_REACH: isize = 6;

/// Cut-off in standard deviations, where a kernel has 3e-4 of its peak.
const CUTOFF: f64 = 4.0;

/// Returns the number of nodes to search along an index, in each direction.
///
/// - `width`: width of kernels, in spacings.
pub(in crate::sample) fn reach(width: f64) -> isize {
    // Three deviations: a node there adds exp(-9/2) / (2 pi)^(3/2) / .6³ of its value, .3 %.
    let reach = (1..MOST_REACH).find(|&n| n as f64 >= 3.0 * width);
    reach.unwrap_or(MOST_REACH)
}

/// The nodes of one grid and of its ghost layers (the extended grid).
pub(in crate::sample) struct GridNodes<'a, 'b> {
    grid: &'a Grid<'b>,
    /// Layers of nodes by which the grid is extended.
    layers: [usize; 3],
    /// Nodes of the extended grid along each index.
    dims: [usize; 3],
    /// Particle of each node of the extended grid.
    particles: Vec<u32>,
}

/// Planes of nodes along the last index whose sums are formed at a time.
const PLANES: usize = 8;

/// Marks a plane without densities.
const NO_SLOT: usize = usize::MAX;

/// Densities of the kernels in some planes of nodes along the last index.
struct Window {
    /// Position of each plane's densities in `densities`.
    slots: Vec<usize>,
    /// One entry for each node of the planes; without meaning where a node has no particle.
    densities: Vec<Density>,
}

impl<'a, 'b> GridNodes<'a, 'b> {
    /// - `own`: nodes of the grid itself with their particles, both ascending.
    pub(in crate::sample) fn new(
        grid: &'a Grid<'b>,
        layers: [usize; 3],
        own: impl Iterator<Item = (usize, u32)>,
    ) -> Self {
        let dims = [0, 1, 2].map(|a| grid.dims[a] + 2 * layers[a]);
        let [ni, nj, _] = grid.dims;
        let mut particles = vec![NONE; dims.iter().product()];
        // Current row of the grid, and its position in the extended grid.
        let (mut row, mut place) = (usize::MAX, 0);
        for (node, particle) in own {
            if node / ni != row {
                row = node / ni;
                let [j, k] = [row % nj + layers[1], row / nj + layers[2]];
                place = layers[0] + dims[0] * (j + dims[1] * k);
            }
            particles[place + node % ni] = particle;
        }
        Self {
            grid,
            layers,
            dims,
            particles,
        }
    }

    pub(in crate::sample) fn grid(&self) -> &'a Grid<'b> {
        self.grid
    }

    pub(in crate::sample) fn layers(&self) -> [usize; 3] {
        self.layers
    }

    /// Returns the number of nodes of the extended grid along each index.
    pub(in crate::sample) fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Returns the particle at a node of the extended grid.
    pub(in crate::sample) fn particle_at(&self, node: [usize; 3]) -> Option<usize> {
        self.particle(self.place(node))
    }

    /// Sets the particle of a node of the extended grid.
    pub(in crate::sample) fn set(&mut self, place: usize, particle: u32) {
        self.particles[place] = particle;
    }

    /// Returns the index `by` nodes away along axis `a`, across a seam; `None` outside.
    fn along(&self, a: usize, at: usize, by: isize) -> Option<usize> {
        // On a closed index the last plane of nodes repeats the first.
        let period = self.grid.periodic[a].then(|| self.dims[a] - 1);
        step_along(at, by, self.dims[a], period)
    }

    fn place(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Returns the particle at a node of the extended grid.
    fn particle(&self, place: usize) -> Option<usize> {
        let particle = self.particles[place];
        (particle != NONE).then_some(particle as usize)
    }

    /// Collects the results of `of` for the grid's own nodes that have a particle, in their order. `of`
    /// receives a node's indices in the extended grid, and its particle.
    ///
    /// - `planes`: range of the last index.
    fn collect<T: Send>(
        &self,
        own_count: usize,
        planes: Range<usize>,
        of: impl Fn([usize; 3], usize) -> Option<T> + Sync,
    ) -> Vec<T> {
        let [ni, nj, _] = self.dims;
        let rows = (nj * planes.start..nj * planes.end).into_par_iter();
        let of_row = |row: usize| {
            let of = &of;
            (0..ni).filter_map(move |i| {
                let particle = self.particle(row * ni + i).filter(|&p| p < own_count)?;
                of([i, row % nj, row / nj], particle)
            })
        };
        rows.flat_map_iter(of_row).collect()
    }

    /// Computes the densities of all kernels within `reach` of some planes along the last index.
    fn window(
        &self,
        kernels: &CutKernels<'_>,
        volumes: &[f32],
        planes: Range<usize>,
        reach: isize,
    ) -> Window {
        let mut slots = vec![NO_SLOT; self.dims[2]];
        let size = self.dims[0] * self.dims[1];
        let mut used = Vec::new();
        let near = planes.flat_map(|k| (-reach..=reach).map(move |by| (k, by)));
        for k in near.filter_map(|(k, by)| self.along(2, k, by)) {
            if slots[k] == NO_SLOT {
                slots[k] = used.len() * size;
                used.push(k);
            }
        }
        let density = |n: usize| {
            let place = used[n / size] * size + n % size;
            let of = |i: usize| Density::new(kernels.factor(i), volumes[i].into());
            self.particle(place).map_or(Density::NONE, of)
        };
        Window {
            densities: parallel::map(used.len() * size, density),
            slots,
        }
    }

    /// Returns the sums of all kernels at the grid's own nodes, by particle. Nodes are left out if the grid is
    /// even around them, or if it ends nearby without being cut.
    ///
    /// - `width`: width of kernels, in spacings.
    pub(in crate::sample) fn sums(
        &self,
        kernels: &CutKernels<'_>,
        volumes: &[f32],
        width: f64,
    ) -> Vec<(usize, f64)> {
        let [ni, nj, nk] = self.dims;
        let bent = self.collect(kernels.own_count(), 0..nk, |at, own| {
            self.bends(kernels, at, own).then_some(self.place(at))
        });
        let mut is_bent = vec![false; self.particles.len()];
        let mut has_bent = vec![false; nk];
        for n in bent {
            is_bent[n] = true;
            has_bent[n / (ni * nj)] = true;
        }
        let is_near_bent = |k: usize| {
            let mut near = (-NEAR_BEND..=NEAR_BEND).filter_map(|by| self.along(2, k, by));
            near.any(|k| has_bent[k])
        };
        let reach = reach(width);
        let starts = (0..nk).step_by(PLANES);
        starts
            .map(|first| first..nk.min(first + PLANES))
            .filter(|planes| planes.clone().any(is_near_bent))
            .flat_map(|planes| {
                let window = self.window(kernels, volumes, planes.clone(), reach);
                self.sums_of(kernels, planes, &window, &is_bent, reach)
            })
            .collect()
    }

    /// Returns the sums at nodes of some planes.
    ///
    /// - `is_bent`: whether the spacing changes at each node of the extended grid.
    fn sums_of(
        &self,
        kernels: &CutKernels<'_>,
        planes: Range<usize>,
        window: &Window,
        is_bent: &[bool],
        reach: isize,
    ) -> Vec<(usize, f64)> {
        let sum = |at: [usize; 3], own: usize| {
            let is_near_bend = (0..3).any(|a| {
                (-NEAR_BEND..=NEAR_BEND).any(|by| {
                    let mut to = at;
                    let along = self.along(a, at[a], by).map(|i| to[a] = i);
                    along.is_some() && is_bent[self.place(to)]
                })
            });
            if !is_near_bend {
                return None;
            }
            let position = kernels.positions[own];
            // The indices around the node along each axis.
            let axis = |a: usize| {
                let indices: [Option<usize>; 2 * MOST_REACH as usize + 1] =
                    std::array::from_fn(|n| self.along(a, at[a], n as isize - MOST_REACH));
                indices
            };
            let [is, js, ks] = [axis(0), axis(1), axis(2)];
            let near = (MOST_REACH - reach).unsigned_abs()..=(MOST_REACH + reach).unsigned_abs();
            let is_beside = |n: usize| n.abs_diff(MOST_REACH.unsigned_abs()) <= 1;
            let mut sum = 0.0;
            for k in near.clone() {
                for j in near.clone() {
                    for i in near.clone() {
                        let found = match (is[i], js[j], ks[k]) {
                            (Some(i), Some(j), Some(k)) => {
                                let other = self.particle(self.place([i, j, k]));
                                other.map(|other| (other, window.slots[k] + self.place([i, j, 0])))
                            }
                            _ => None,
                        };
                        let Some((other, slot)) = found else {
                            if [i, j, k].into_iter().all(is_beside) {
                                return None;
                            }
                            continue;
                        };
                        let offset = position - kernels.positions[other];
                        let density = &window.densities[slot];
                        let squared = density.squared(offset);
                        let is_near = squared < CUTOFF * CUTOFF;
                        if is_near && kernels.cut(other).is_none_or(|cut| cut.holds(offset)) {
                            sum += density.at(squared);
                        }
                    }
                }
            }
            Some((own, sum))
        };
        self.collect(kernels.own_count(), planes, sum)
    }

    /// Returns true if the spacing changes at a node.
    fn bends(&self, kernels: &CutKernels<'_>, at: [usize; 3], own: usize) -> bool {
        let own = kernels.positions[own];
        (0..3).any(|a| {
            let beside = |by: isize| {
                let mut to = at;
                to[a] = self.along(a, at[a], by)?;
                Some(kernels.positions[self.particle(self.place(to))?])
            };
            let (Some(above), Some(below)) = (beside(1), beside(-1)) else {
                return false;
            };
            let bend = (above - own) - (own - below);
            bend.length() > LEAST_BEND * (above - below).length()
        })
    }
}
