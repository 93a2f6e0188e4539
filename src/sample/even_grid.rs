//! What a uniform field reads at the nodes of a curvilinear grid with a sharp boundary: kernels around a node
//! are found by their indices, however long they are.

use glam::DVec3;
use rayon::prelude::*;

use super::even::CutKernels;
use super::structured::Grid;

/// No particle.
const NONE: u32 = u32::MAX;

/// Where the spacing bends by less, sums are off by less than .4 % (a growth of 1.1 per cell; rho .6).
const LEAST_BEND: f64 = 0.05;

/// Nodes that are looked at along an index, however wide kernels are asked for.
const MOST_REACH: isize = 6;

/// Beyond so many standard deviations a kernel leaves 3e-4 of its peak.
const CUTOFF: f64 = 4.0;

/// The nodes of one grid and of its layers of ghosts.
pub(super) struct GridNodes<'a, 'b> {
    grid: &'a Grid<'b>,
    /// How far it is continued along each index.
    layers: [usize; 3],
    /// The particle of each node of the continued grid.
    particles: Vec<u32>,
}

/// What a kernel's density takes.
#[derive(Clone, Copy)]
pub(super) struct Inverse {
    /// Of the lower-triangular factor.
    lower: [f64; 6],
    /// Volume over (2 pi)^(3/2) det.
    peak: f64,
}

impl Inverse {
    fn new([l00, l10, l11, l20, l21, l22]: [f64; 6], volume: f64) -> Self {
        let [i00, i11, i22] = [l00, l11, l22].map(f64::recip);
        let i10 = -l10 * i00 * i11;
        let i21 = -l21 * i11 * i22;
        let i20 = -(l20 * i00 + l21 * i10) * i22;
        let peak = volume * i00 * i11 * i22 / std::f64::consts::TAU.powf(1.5);
        Self {
            lower: [i00, i10, i11, i20, i21, i22],
            peak,
        }
    }

    /// Of all kernels.
    pub(super) fn of_all(kernels: &CutKernels<'_>, volumes: &[f32]) -> Vec<Self> {
        let of = |(i, &volume): (usize, &f32)| Self::new(kernels.factor(i), volume.into());
        volumes.par_iter().enumerate().map(of).collect()
    }

    /// 0 beyond the cut-off.
    #[inline]
    fn density(&self, d: DVec3) -> f64 {
        let [i00, i10, i11, i20, i21, i22] = self.lower;
        let x = i00 * d.x;
        let y = i10 * d.x + i11 * d.y;
        let z = i20 * d.x + i21 * d.y + i22 * d.z;
        let square = x * x + y * y + z * z;
        if square < CUTOFF * CUTOFF {
            self.peak * (-0.5 * square).exp()
        } else {
            0.0
        }
    }
}

impl<'a, 'b> GridNodes<'a, 'b> {
    pub(super) fn new(grid: &'a Grid<'b>, layers: [usize; 3]) -> Self {
        let count = (0..3).map(|a| grid.dims[a] + 2 * layers[a]).product();
        Self {
            grid,
            layers,
            particles: vec![NONE; count],
        }
    }

    /// Says which particle a node of the continued grid is.
    pub(super) fn set(&mut self, place: usize, particle: u32) {
        self.particles[place] = particle;
    }

    fn dims(&self) -> [usize; 3] {
        [0, 1, 2].map(|a| self.grid.dims[a] + 2 * self.layers[a])
    }

    /// The place of one of the grid's own nodes.
    pub(super) fn place_of(&self, node: usize) -> usize {
        let [ni, nj, _] = self.grid.dims;
        let own = [node % ni, node / ni % nj, node / (ni * nj)];
        let [i, j, k] = [0, 1, 2].map(|a| own[a] + self.layers[a]);
        let dims = self.dims();
        i + dims[0] * (j + dims[1] * k)
    }

    /// The place so many nodes away along each index, across seams; `None` outside.
    fn moved(&self, at: [usize; 3], by: [isize; 3]) -> Option<usize> {
        let dims = self.dims();
        let mut to = [0; 3];
        for a in 0..3 {
            let n = at[a] as isize + by[a];
            let last = dims[a] as isize;
            // The last plane of nodes is the first.
            let n = if self.grid.periodic[a] {
                n.rem_euclid(last - 1)
            } else {
                n
            };
            if n < 0 || n >= last {
                return None;
            }
            to[a] = n.unsigned_abs();
        }
        Some(to[0] + dims[0] * (to[1] + dims[1] * to[2]))
    }

    fn particle(&self, at: [usize; 3], by: [isize; 3]) -> Option<usize> {
        let particle = self.particles[self.moved(at, by)?];
        (particle != NONE).then_some(particle as usize)
    }

    /// The sums of all kernels at the grid's own nodes, by particle; none where the grid is even around, and where
    /// it ends without being cut.
    ///
    /// - `inverses`: of all kernels, made where the first grid asks for them;
    /// - `width`: of kernels, in spacings.
    pub(super) fn sums(
        &self,
        kernels: &CutKernels<'_>,
        volumes: &[f32],
        inverses: &mut Option<Vec<Inverse>>,
        width: f64,
    ) -> Vec<(usize, f64)> {
        let dims = self.dims();
        let places: Vec<[usize; 3]> = (0..self.particles.len())
            .filter(|&n| (self.particles[n] as usize) < kernels.own_count())
            .map(|n| [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])])
            .collect();
        let mut is_bent = vec![false; self.particles.len()];
        let bent: Vec<usize> = places
            .par_iter()
            .filter(|&&at| self.bends(kernels, at))
            .filter_map(|&at| self.moved(at, [0; 3]))
            .collect();
        if bent.is_empty() {
            return Vec::new();
        }
        for n in bent {
            is_bent[n] = true;
        }
        let inverses = &*inverses.get_or_insert_with(|| Inverse::of_all(kernels, volumes));
        // Three deviations: a node there adds exp(-9/2) / (2 pi)^(3/2) / .6³ of itself, .3 %.
        let reach = (1..MOST_REACH).find(|&n| n as f64 >= 3.0 * width);
        let reach = reach.unwrap_or(MOST_REACH);
        let near = move |n: isize| -n..=n;
        let sum = |&at: &[usize; 3]| {
            let own = self.particle(at, [0; 3])?;
            let is_near_bend = (0..3).any(|a| {
                near(2).any(|n| {
                    let mut by = [0; 3];
                    by[a] = n;
                    self.moved(at, by).is_some_and(|place| is_bent[place])
                })
            });
            if !is_near_bend {
                return None;
            }
            let mut sum = 0.0;
            for k in near(reach) {
                for j in near(reach) {
                    for i in near(reach) {
                        let by = [i, j, k];
                        let Some(other) = self.particle(at, by) else {
                            if by.iter().all(|n| n.abs() <= 1) {
                                return None;
                            }
                            continue;
                        };
                        let place = kernels.positions[own];
                        let density = inverses[other].density(place - kernels.positions[other]);
                        if density > 0.0 && kernels.holds(other, place) {
                            sum += density;
                        }
                    }
                }
            }
            Some((own, sum))
        };
        places.par_iter().filter_map(sum).collect()
    }

    /// Whether the spacing changes at a node.
    fn bends(&self, kernels: &CutKernels<'_>, at: [usize; 3]) -> bool {
        let position = |by| self.particle(at, by).map(|i| kernels.positions[i]);
        (0..3).any(|a| {
            let mut by = [0; 3];
            by[a] = 1;
            let (Some(own), Some(above), Some(below)) =
                (position([0; 3]), position(by), position(by.map(|n| -n)))
            else {
                return false;
            };
            let bend = (above - own) - (own - below);
            bend.length() > LEAST_BEND * (above - below).length()
        })
    }
}
