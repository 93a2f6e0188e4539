//! Sums kernels at the nodes of a curvilinear grid with a sharp boundary. The kernels around a node are found
//! by their indices, however long they are.

use rayon::prelude::*;

use super::structured::Grid;
use crate::sample::field::gradient::step_along;
use crate::sample::kernels::even::CutKernels;
use crate::sample::kernels::sums::Density;

/// Marks a node without a particle.
const NONE: u32 = u32::MAX;

/// Least change of the spacing at a node for which sums are formed, over the distance between its neighbours.
/// Below it (a growth of 1.1 per cell), sums are within .4 % of 1 for kernels of .6 spacings.
const LEAST_BEND: f64 = 0.05;

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

/// Densities of all kernels.
fn densities(kernels: &CutKernels<'_>, volumes: &[f32]) -> Vec<Density> {
    let of = |(i, &volume): (usize, &f32)| Density::new(kernels.factor(i), volume.into());
    volumes.par_iter().enumerate().map(of).collect()
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
    fn collect<T: Send>(
        &self,
        own_count: usize,
        of: impl Fn([usize; 3], usize) -> Option<T> + Sync,
    ) -> Vec<T> {
        let [ni, nj, nk] = self.dims;
        let rows = (0..nj * nk).into_par_iter();
        let of_row = |row: usize| {
            let of = &of;
            (0..ni).filter_map(move |i| {
                let particle = self.particle(row * ni + i).filter(|&p| p < own_count)?;
                of([i, row % nj, row / nj], particle)
            })
        };
        rows.flat_map_iter(of_row).collect()
    }

    /// Returns the sums of all kernels at the grid's own nodes, by particle. Nodes are left out if the grid is
    /// even around them, or if it ends nearby without being cut.
    ///
    /// - `all_densities`: densities of all kernels; the first grid that needs them computes them.
    /// - `width`: width of kernels, in spacings.
    pub(in crate::sample) fn sums(
        &self,
        kernels: &CutKernels<'_>,
        volumes: &[f32],
        all_densities: &mut Option<Vec<Density>>,
        width: f64,
    ) -> Vec<(usize, f64)> {
        let own_count = kernels.own_count();
        let bent = self.collect(own_count, |at, own| {
            let place = self.place(at);
            self.bends(kernels, at, own).then_some(place)
        });
        if bent.is_empty() {
            return Vec::new();
        }
        let mut is_bent = vec![false; self.particles.len()];
        for n in bent {
            is_bent[n] = true;
        }
        let all_densities = &*all_densities.get_or_insert_with(|| densities(kernels, volumes));
        let reach = reach(width);
        let sum = |at: [usize; 3], own: usize| {
            let is_near_bend = (0..3).any(|a| {
                (-2..=2).any(|by| {
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
                        let place = match (is[i], js[j], ks[k]) {
                            (Some(i), Some(j), Some(k)) => Some(self.place([i, j, k])),
                            _ => None,
                        };
                        let Some(other) = place.and_then(|place| self.particle(place)) else {
                            if [i, j, k].into_iter().all(is_beside) {
                                return None;
                            }
                            continue;
                        };
                        let offset = position - kernels.positions[other];
                        let density = &all_densities[other];
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
        self.collect(own_count, sum)
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
