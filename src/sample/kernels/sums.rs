//! Sums many kernels at all their points: the value of a uniform field there.
//!
//! Nearby points are summed together, in lanes. A tree of boxes finds the kernels that may reach one of them.
//! Each sum is taken in one order, whatever the number of threads.

use glam::DVec3;
use rayon::prelude::*;

use crate::constants::MOST_EDGES;
use crate::error::Result;
use crate::math::small_exp;
use crate::parallel;
use crate::sample::points::neighbours::PointIndex;
use crate::sample::positions::{around, index_u32};
use crate::task::{Stage, Task};

/// Cut-off of kernels, in standard deviations; .1 % of a kernel lies beyond.
pub(in crate::sample) const SUM_CUTOFF: f64 = 4.0;

/// Number of points that are summed together.
const LEAF: usize = 8;

/// Number of points that are summed at a time. The kernels that reach them take 96 bytes each.
const WINDOW: usize = 1 << 18;

/// A kernel of a sum.
pub(in crate::sample) struct Summand {
    /// Lower-triangular factor of the kernel's variance.
    pub(in crate::sample) factor: [f64; 6],
    /// Greatest standard deviation.
    pub(in crate::sample) sigma: f64,
    /// Integral of the kernel.
    pub(in crate::sample) amplitude: f64,
}

/// Planes that cut a kernel.
#[derive(Clone, Copy)]
pub(in crate::sample) struct Cut<'a> {
    planes: &'a [[f32; 4]],
    /// Distance of the kernel's centre inside each plane, with the distance beyond it at which the kernel still counts.
    distances: [f64; MOST_EDGES],
}

impl<'a> Cut<'a> {
    /// - `planes`: unit normals into the domain, and distances of the kernel's centre inside; those that are not used are
    ///   infinite and come last.
    /// - `beyond`: returns how far beyond a plane the kernel counts, given the normal.
    pub(in crate::sample) fn new(
        planes: &'a [[f32; 4]; MOST_EDGES],
        beyond: impl Fn(DVec3) -> f64,
    ) -> Self {
        let count = planes
            .iter()
            .take_while(|plane| plane[3] < f32::INFINITY)
            .count();
        let planes = &planes[..count];
        let mut distances = [0.0; MOST_EDGES];
        for (distance, plane) in distances.iter_mut().zip(planes) {
            *distance = f64::from(plane[3]) + beyond(normal_of(plane));
        }
        Self { planes, distances }
    }

    /// Returns true if an offset from the kernel's centre is inside all planes.
    pub(in crate::sample) fn holds(&self, offset: DVec3) -> bool {
        self.sides()
            .all(|(normal, distance)| distance + normal.dot(offset) >= 0.0)
    }

    /// Returns the normal of each plane, and its distance.
    #[inline(always)]
    fn sides(&self) -> impl Iterator<Item = (DVec3, f64)> {
        let normals = self.planes.iter().map(normal_of);
        normals.zip(self.distances)
    }

    /// Sets the terms to 0 whose offsets from the kernel's centre are outside.
    #[inline(always)]
    fn apply(&self, offsets: &[[f64; LEAF]; 3], terms: &mut [f64; LEAF]) {
        for (normal, distance) in self.sides() {
            for n in 0..LEAF {
                let offset = DVec3::new(offsets[0][n], offsets[1][n], offsets[2][n]);
                // NaN counts as outside.
                let is_inside = distance + normal.dot(offset) >= 0.0;
                terms[n] = if is_inside { terms[n] } else { 0.0 };
            }
        }
    }
}

/// Returns the normal of a plane: its first three components.
#[inline(always)]
fn normal_of(&[x, y, z, _]: &[f32; 4]) -> DVec3 {
    DVec3::new(x.into(), y.into(), z.into())
}

/// Density of a kernel, prepared for evaluation.
#[derive(Debug, Clone, Copy)]
pub(in crate::sample) struct Density {
    /// The inverse of the lower-triangular factor.
    inverse: [f64; 6],
    /// Amplitude over (2 pi)^(3/2) det.
    peak: f64,
}

impl Density {
    /// No kernel.
    pub(in crate::sample) const NONE: Self = Self {
        inverse: [0.0; 6],
        peak: 0.0,
    };

    pub(in crate::sample) fn new([l00, l10, l11, l20, l21, l22]: [f64; 6], amplitude: f64) -> Self {
        let [i00, i11, i22] = [l00, l11, l22].map(f64::recip);
        let i10 = -l10 * i00 * i11;
        let i21 = -l21 * i11 * i22;
        let i20 = -(l20 * i00 + l21 * i10) * i22;
        Self {
            inverse: [i00, i10, i11, i20, i21, i22],
            peak: amplitude * i00 * i11 * i22 / std::f64::consts::TAU.powf(1.5),
        }
    }

    /// Returns the squared distance from the centre, in standard deviations.
    #[inline(always)]
    pub(in crate::sample) fn squared(&self, d: DVec3) -> f64 {
        let [i00, i10, i11, i20, i21, i22] = self.inverse;
        let x = i00 * d.x;
        let y = i10 * d.x + i11 * d.y;
        let z = i20 * d.x + i21 * d.y + i22 * d.z;
        x * x + y * y + z * z
    }

    /// Returns the density at a squared distance in standard deviations.
    pub(in crate::sample) fn at(&self, squared: f64) -> f64 {
        self.peak * (-0.5 * squared).exp()
    }
}

/// A kernel in the order of the points.
#[derive(Clone, Copy)]
struct Placed {
    centre: DVec3,
    density: Density,
    /// Square of the kernel's reach; negative if there is no kernel.
    reach_squared: f64,
    kernel: u32,
    /// Number of the cut; `u32::MAX` if nothing cuts the kernel.
    cut: u32,
}

/// A box of kernels' centres.
#[derive(Clone, Copy)]
struct Bounds {
    low: DVec3,
    high: DVec3,
    /// Square of the greatest reach among the kernels.
    reach_squared: f64,
}

impl Bounds {
    const EMPTY: Self = Self {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
        reach_squared: -1.0,
    };

    /// Bounds of some kernels.
    fn of(kernels: impl Iterator<Item = Placed>) -> Self {
        let bounds = kernels.filter(|k| k.reach_squared >= 0.0).map(|k| Self {
            low: k.centre,
            high: k.centre,
            reach_squared: k.reach_squared,
        });
        bounds.fold(Self::EMPTY, Self::and)
    }

    fn and(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            reach_squared: self.reach_squared.max(other.reach_squared),
        }
    }

    /// Returns true if the kernels may reach a box.
    fn reaches(&self, [low, high]: [DVec3; 2]) -> bool {
        gap_squared([self.low, self.high], [low, high]) <= self.reach_squared
    }
}

/// Returns the squared distance between two boxes.
fn gap_squared(a: [DVec3; 2], b: [DVec3; 2]) -> f64 {
    (b[0] - a[1])
        .max(a[0] - b[1])
        .max(DVec3::ZERO)
        .length_squared()
}

/// Cut for kernels that nothing cuts.
pub(in crate::sample) fn everywhere(_: usize) -> Option<Cut<'static>> {
    None
}

impl PointIndex<'_> {
    /// Returns the average number of points that a kernel reaches, from a sample of kernels. A sum takes as
    /// many terms per point.
    pub(in crate::sample) fn mean_reach(
        &self,
        kernel: impl Fn(usize) -> Option<Summand> + Sync,
    ) -> usize {
        /// Number of sampled kernels.
        const SAMPLE: usize = 256;
        let step = self.len().div_ceil(SAMPLE).max(1);
        let some: Vec<u32> = (0..self.len())
            .step_by(step)
            .map(|place| self.in_order(place).0)
            .collect();
        let reached: usize = some
            .par_iter()
            .filter_map(|&j| {
                let Summand { sigma, .. } = kernel(j as usize)?;
                let mut count = 0;
                self.for_each_within(self.position(j), SUM_CUTOFF * sigma, |_, _| count += 1);
                Some(count)
            })
            .sum();
        reached / some.len().max(1)
    }

    /// Returns, for each wanted point, the sum over kernels j of amplitude x Gaussian; 0 for the others, and for points
    /// that are not finite. Prepares the kernels that reach one window of points after another.
    ///
    /// - `is_wanted`: returns true for the points at which sums are wanted.
    /// - `kernel`: returns the kernel at point j, or `None`.
    /// - `cut`: returns the planes that cut kernel j; `None` for a kernel that counts everywhere.
    pub(in crate::sample) fn kernel_sums<'c>(
        &self,
        task: Option<&Task>,
        is_wanted: impl Fn(usize) -> bool,
        kernel: impl Fn(usize) -> Option<Summand> + Sync,
        cut: impl Fn(usize) -> Option<Cut<'c>>,
    ) -> Result<Vec<f64>> {
        self.kernel_sums_by(WINDOW, task, is_wanted, kernel, cut)
    }

    /// As [`Self::kernel_sums`], in windows of `window` points.
    fn kernel_sums_by<'c>(
        &self,
        window: usize,
        task: Option<&Task>,
        is_wanted: impl Fn(usize) -> bool,
        kernel: impl Fn(usize) -> Option<Summand> + Sync,
        cut: impl Fn(usize) -> Option<Cut<'c>>,
    ) -> Result<Vec<f64>> {
        let is_wanted = |&j: &u32| is_wanted(j as usize);
        let wanted: Vec<u32> = self.order().iter().copied().filter(is_wanted).collect();
        let placed = |&j: &u32| Placed::new(j, self.position(j), kernel(j as usize));
        let leaves: Vec<&[u32]> = self.order().chunks(LEAF).collect();
        let reached: Vec<Bounds> = match self.len() > window {
            true => parallel::map(leaves.len(), |n| Bounds::of(leaves[n].iter().map(placed))),
            false => Vec::new(),
        };
        let mut sums = vec![0.0; self.point_count()];
        let stage = Stage::new(task, "summing kernels", wanted.len());
        for (first, points) in (0..).step_by(window).zip(wanted.chunks(window)) {
            let around = around(points.iter().map(|&j| self.position(j)));
            let reaches = |&n: &usize| reached.get(n).is_none_or(|own| own.reaches(around));
            let reaching: Vec<usize> = (0..leaves.len()).into_par_iter().filter(reaches).collect();
            let reaching = reaching.into_iter().flat_map(|n| leaves[n]);
            let reaching: Vec<u32> = reaching.copied().collect();
            let mut kernels: Vec<Placed> = parallel::map(reaching.len(), |n| placed(&reaching[n]));
            let mut cuts = Vec::new();
            for own in &mut kernels {
                if let Some(cut) = cut(own.kernel as usize) {
                    own.cut = index_u32(cuts.len());
                    cuts.push(cut);
                }
            }
            let tree = &Tree::new(&kernels);
            let cuts = &cuts;
            let mut of_points = vec![0.0; points.len()];
            parallel::chunks(&mut of_points, Stage::GRAIN, |n, sums| {
                let n = n * Stage::GRAIN;
                if !stage.counts(first + n) {
                    return;
                }
                for (sums, points) in sums.chunks_mut(LEAF).zip(points[n..].chunks(LEAF)) {
                    let mut at = [DVec3::NAN; LEAF];
                    for (at, &j) in at.iter_mut().zip(points) {
                        *at = self.position(j);
                    }
                    pulp::Arch::new().dispatch(SumLeaf {
                        tree,
                        points: &at[..points.len()],
                        sums,
                        cuts,
                    });
                }
            });
            stage.check()?;
            for (&j, sum) in points.iter().zip(of_points) {
                sums[j as usize] = sum;
            }
        }
        Ok(sums)
    }
}

/// Runs [`Tree::sum`] compiled for the processor's vector instructions.
struct SumLeaf<'a> {
    tree: &'a Tree<'a>,
    points: &'a [DVec3],
    sums: &'a mut [f64],
    cuts: &'a [Cut<'a>],
}

impl pulp::NullaryFnOnce for SumLeaf<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.tree.sum(self.points, self.sums, self.cuts);
    }
}

/// Boxes of [`LEAF`] kernels each, boxes of two of these, and so on.
struct Tree<'a> {
    kernels: &'a [Placed],
    levels: Vec<Vec<Bounds>>,
}

impl<'a> Tree<'a> {
    fn new(kernels: &'a [Placed]) -> Self {
        let of = |leaf: &[Placed]| Bounds::of(leaf.iter().copied());
        let mut levels = vec![kernels.chunks(LEAF).map(of).collect::<Vec<_>>()];
        while let Some(below) = levels.last().filter(|level| level.len() > 1) {
            let pairs = below.chunks(2);
            levels.push(
                pairs
                    .map(|pair| pair.iter().copied().fold(Bounds::EMPTY, Bounds::and))
                    .collect(),
            );
        }
        Self { kernels, levels }
    }

    /// Adds the densities of all kernels that reach the points of a leaf.
    #[inline(always)]
    fn sum(&self, points: &[DVec3], sums: &mut [f64], cuts: &[Cut<'_>]) {
        let mut at = [[f64::NAN; LEAF]; 3];
        for (n, point) in points.iter().enumerate() {
            for (d, at) in at.iter_mut().enumerate() {
                at[n] = point[d];
            }
        }
        let bounds = around(points.iter().copied());
        let mut all = [0.0; LEAF];
        let mut open = vec![(self.levels.len() - 1, 0)];
        while let Some((level, n)) = open.pop() {
            if !self.levels[level][n].reaches(bounds) {
                continue;
            }
            if level > 0 {
                let below = self.levels[level - 1].len();
                open.extend(
                    [2 * n + 1, 2 * n]
                        .into_iter()
                        .filter(|&n| n < below)
                        .map(|n| (level - 1, n)),
                );
                continue;
            }
            let leaf = &self.kernels[n * LEAF..self.kernels.len().min((n + 1) * LEAF)];
            for kernel in leaf {
                if gap_squared([kernel.centre; 2], bounds) <= kernel.reach_squared {
                    kernel.add(&at, &mut all, cuts.get(kernel.cut as usize));
                }
            }
        }
        sums.copy_from_slice(&all[..sums.len()]);
    }
}

impl Placed {
    /// - `number`: of the point, which is at `centre`.
    fn new(number: u32, centre: DVec3, kernel: Option<Summand>) -> Self {
        let (density, reach_squared) = match kernel {
            Some(Summand {
                factor,
                sigma,
                amplitude,
            }) => (
                Density::new(factor, amplitude),
                (SUM_CUTOFF * sigma).powi(2),
            ),
            None => (Density::NONE, -1.0),
        };
        // A flat kernel has no density.
        let is_kernel = density.peak.is_finite() && density.inverse.iter().all(|i| i.is_finite());
        Self {
            centre,
            density,
            reach_squared: if is_kernel { reach_squared } else { -1.0 },
            kernel: number,
            cut: u32::MAX,
        }
    }

    /// Adds the kernel's density at the points of a leaf.
    #[inline(always)]
    fn add(&self, at: &[[f64; LEAF]; 3], sums: &mut [f64; LEAF], cut: Option<&Cut<'_>>) {
        let Self {
            centre,
            density,
            reach_squared,
            ..
        } = *self;
        let [mut distances_squared, mut exponents, mut terms] = [[0.0; LEAF]; 3];
        let mut offsets = [[0.0; LEAF]; 3];
        for n in 0..LEAF {
            let offset = DVec3::new(
                at[0][n] - centre.x,
                at[1][n] - centre.y,
                at[2][n] - centre.z,
            );
            for (offsets, x) in offsets.iter_mut().zip(offset.to_array()) {
                offsets[n] = x;
            }
            distances_squared[n] = offset.length_squared();
            // Smaller terms add nothing to a sum.
            exponents[n] = (-0.5 * density.squared(offset)).max(-700.0);
        }
        let mut is_near = false;
        for squared in distances_squared {
            is_near |= squared <= reach_squared;
        }
        if !is_near {
            return;
        }
        let shares = small_exp(exponents);
        for n in 0..LEAF {
            // NaN counts as beyond reach.
            let is_within = distances_squared[n] <= reach_squared;
            terms[n] = if is_within {
                density.peak * shares[n]
            } else {
                0.0
            };
        }
        if let Some(cut) = cut {
            cut.apply(&offsets, &mut terms);
        }
        for n in 0..LEAF {
            sums[n] += terms[n];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::narrowed;
    use crate::sample::points::neighbours::lattice;
    use crate::scene::NO_EDGE;

    /// Returns numbers from -1 to 1.
    fn noise(n: usize, d: usize) -> f64 {
        let step = [0.754_878, 0.569_840, 0.870_271, 0.618_034][d];
        2.0 * ((n as f64 + 1.0) * step).fract() - 1.0
    }

    #[test]
    fn kernels_of_unit_cells_add_up_to_one() {
        let points = lattice(9, 100.0);
        let index = PointIndex::new(&points).unwrap();
        let kernel = |_| {
            Some(Summand {
                factor: [0.7, 0.0, 0.7, 0.0, 0.0, 0.7],
                sigma: 0.7,
                amplitude: 1.0,
            })
        };
        let sums = index
            .kernel_sums(None, |_| true, kernel, everywhere)
            .unwrap();
        // Within the cut-off's .1 % and the ripple at sigma .7, .04 %.
        let centre = sums[4 + 9 * (4 + 9 * 4)];
        assert!((centre - 1.0).abs() < 1.5e-3, "{centre}");
        // A corner has an eighth of the kernels around it, but more than an eighth of the sum.
        assert!(sums[0] > 0.2 && sums[0] < 0.6, "{}", sums[0]);
    }

    /// The Gaussian of unit integral by forward substitution.
    fn gaussian([l00, l10, l11, l20, l21, l22]: [f64; 6], d: DVec3) -> f64 {
        let x = d.x / l00;
        let y = (d.y - l10 * x) / l11;
        let z = (d.z - l20 * x - l21 * y) / l22;
        let scale = std::f64::consts::TAU.powf(1.5) * l00 * l11 * l22;
        (-0.5 * (x * x + y * y + z * z)).exp() / scale
    }

    #[test]
    fn sums_are_those_of_all_pairs() {
        // Points crowded at one end; some coincide, some are not finite.
        let mut points: Vec<DVec3> = (0..1500)
            .map(|n| DVec3::new(noise(n, 0), noise(n, 1), noise(n, 2)))
            .map(|p| p * p.x.abs() * 3.0 + 1e5)
            .collect();
        points.extend(std::iter::repeat_n(points[7], 40));
        points[3] = DVec3::NAN;
        points[4].y = f64::INFINITY;
        let factor = |j: usize| {
            let [a, b, c] = [0, 1, 2].map(|d| 0.15 + 0.1 * noise(3 * j, d));
            [a, 0.1 * noise(j, 3), b, 0.1 * noise(j, 0), -0.05, c]
        };
        let kernel = |j: usize| {
            let flat = |l: [f64; 6]| [l[0], l[1], l[2], l[3], l[4], 0.0];
            // One point in five has no kernel; one kernel in seven is flat.
            (!j.is_multiple_of(5)).then(|| Summand {
                factor: if j.is_multiple_of(7) {
                    flat(factor(j))
                } else {
                    factor(j)
                },
                sigma: if j.is_multiple_of(11) { 0.9 } else { 0.2 },
                amplitude: 1.0 + noise(j, 1),
            })
        };
        // One kernel in three is cut by a plane.
        let plane = |j: usize| {
            let normal = [noise(j, 0), noise(j, 1), noise(j, 2), 0.03].map(narrowed);
            [[normal; 1].as_slice(), &[NO_EDGE; 5]].concat()
        };
        let planes: Vec<[[f32; 4]; 6]> = (0..points.len())
            .map(|j| plane(j).try_into().unwrap())
            .collect();
        let cut = |j: usize| j.is_multiple_of(3).then(|| Cut::new(&planes[j], |_| 0.02));
        let index = PointIndex::new(&points).unwrap();
        let sums = index.kernel_sums(None, |_| true, kernel, cut).unwrap();
        let is_finite = |i: usize| points[i].is_finite();
        let inside = |j: usize, d: DVec3| {
            let [x, y, z, distance] = planes[j][0].map(f64::from);
            distance + 0.02 + DVec3::new(x, y, z).dot(d) >= 0.0
        };
        for i in 0..points.len() {
            let mut expected = 0.0;
            for j in (0..points.len()).filter(|&j| is_finite(j)) {
                let d = points[i] - points[j];
                let Some(Summand {
                    factor,
                    sigma,
                    amplitude,
                }) = kernel(j)
                else {
                    continue;
                };
                let counts =
                    j % 7 != 0 && d.length() <= SUM_CUTOFF * sigma && (j % 3 != 0 || inside(j, d));
                if is_finite(i) && counts {
                    expected += amplitude * gaussian(factor, d);
                }
            }
            // Some hundred roundings, amplified by exponents of some ten.
            let off = (sums[i] - expected).abs();
            assert!(off <= 1e-12 * expected, "{i}: {} {expected}", sums[i]);
        }
        let one = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .unwrap();
        let alone = one
            .install(|| index.kernel_sums(None, |_| true, kernel, cut))
            .unwrap();
        assert_eq!(alone, sums);
        // No window changes a bit, nor do points that are left out.
        let is_some = |j: usize| !j.is_multiple_of(3);
        for window in [64, 1000] {
            let in_windows = index.kernel_sums_by(window, None, is_some, kernel, cut);
            let expected = |(j, sum): (usize, &f64)| if is_some(j) { *sum } else { 0.0 };
            let expected: Vec<f64> = sums.iter().enumerate().map(expected).collect();
            assert_eq!(in_windows.unwrap(), expected, "{window}");
        }
    }
}
