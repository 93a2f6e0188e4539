//! Defines the boundary of a volume's data: planes that cut the kernels beside them, so that these do not leak
//! out.

#![allow(
    clippy::cast_possible_truncation,
    reason = "values of ghosts are narrowed to the type of the others by design"
)]

use glam::{DMat3, DVec3};

use super::storage::{Owned, Shared, Storage};
use crate::math::Truncated;
use crate::scene::lattice::{Lattice, LatticeSpacing};
use crate::scene::values::Values;

pub use crate::constants::MOST_EDGES;

/// No plane: the whole kernel lies inside.
pub(crate) const NO_EDGE: [f32; 4] = [0.0, 0.0, 0.0, f32::INFINITY];

/// The sharp boundary of a volume's data.
///
/// Without a boundary, kernels at the edge leak out of the domain, and density falls to half at a face. With
/// one, each kernel is cut at the domain, by its share of Phi along the ray. One layer of ghosts beyond the
/// boundary replaces the kernels that would continue there. So a uniform field in a lattice's box stays uniform
/// up to the faces.
#[derive(Debug, Clone, PartialEq)]
pub enum Boundary {
    /// The box of a lattice's samples. Ghosts are added when blocks are made. They are extrapolated linearly
    /// from the outermost two samples (2 v0 - v1), clamped to the values' type. An axis of one sample has no
    /// faces.
    Lattice,
    /// Tangent planes of the boundary beside each particle of a set of ellipsoids. Ghosts are among the
    /// particles.
    Planes(BoundaryPlanes),
}

/// Planes of the boundary, in vectors.
pub type BoundaryPlanes = BoundaryPlanesIn<Owned>;

/// The particles that the boundary of their domain cuts, and the planes that cut them.
///
/// The domain of one kernel is the convex region inside all of its planes.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryPlanesIn<S: Storage> {
    /// One word per particle: 0 if nothing cuts it, otherwise its index in `edges` plus 1.
    pub of_particle: S::Of<u32>,
    /// Up to [`MOST_EDGES`] planes of each cut particle: a unit normal into the domain and the particle's
    /// distance inside \[world units\], negative outside. Unused planes have an infinite distance.
    pub edges: S::Of<[[f32; 4]; MOST_EDGES]>,
}

impl Default for BoundaryPlanes {
    fn default() -> Self {
        Self {
            of_particle: Vec::new(),
            edges: Vec::new(),
        }
    }
}

impl<S: Storage> BoundaryPlanesIn<S> {
    /// The planes that cut a particle; `None` if nothing cuts it.
    pub(crate) fn of(&self, particle: usize) -> Option<&[[f32; 4]; MOST_EDGES]> {
        let word = *self.of_particle.get(particle)?;
        self.edges.get((word as usize).checked_sub(1)?)
    }

    /// Reorders the planes with their particles.
    pub(crate) fn gather(&self, order: &[u32]) -> Self {
        let is_cut = |&&i: &&u32| self.of(i as usize).is_some();
        let mut of_particle = Vec::with_capacity(order.len());
        let mut kept = Vec::with_capacity(order.iter().filter(is_cut).count());
        for &i in order {
            let word = match self.of(i as usize) {
                None => 0,
                Some(edges) => {
                    kept.push(*edges);
                    u32::try_from(kept.len()).unwrap_or(0)
                }
            };
            of_particle.push(word);
        }
        Self {
            of_particle: of_particle.into(),
            edges: kept.into(),
        }
    }
}

impl BoundaryPlanes {
    /// Converts the columns to a renderer's storage.
    pub(crate) fn shared(self) -> BoundaryPlanesIn<Shared> {
        BoundaryPlanesIn {
            of_particle: self.of_particle.into(),
            edges: self.edges.into(),
        }
    }
}

/// Moments of the part of a kernel inside its planes.
#[derive(Debug, Clone)]
pub(crate) struct CutKernel {
    /// Share of the kernel's mass.
    pub(crate) share: f64,
    /// Shift of the mean, world units.
    pub(crate) shift: DVec3,
    /// Factor F of the variance F Fᵀ.
    pub(crate) factor: DMat3,
    /// Third central moments: the sum of the third powers of these vectors.
    pub(crate) skews: Vec<DVec3>,
}

/// Moments of a kernel cut by planes one after another. Exact for one plane, and for planes that are orthogonal
/// in the kernel's own metric. `None` if nothing significant is left.
pub(crate) fn cut_kernel(factor: DMat3, planes: &[[f32; 4]]) -> Option<CutKernel> {
    let mut left = CutKernel {
        share: 1.0,
        shift: DVec3::ZERO,
        factor,
        skews: Vec::new(),
    };
    for &[x, y, z, distance] in planes {
        if distance == f32::INFINITY {
            continue;
        }
        let normal = DVec3::new(x.into(), y.into(), z.into());
        let inside = f64::from(distance) + normal.dot(left.shift);
        let along = left.factor.transpose() * normal;
        let reach = along.length().max(f64::MIN_POSITIVE);
        let half = Truncated::new(-inside / reach, f64::INFINITY);
        if half.share == 0.0 {
            return None;
        }
        let axis = along / reach;
        let side = left.factor * axis;
        left.share *= half.share;
        left.shift += side * half.mean;
        let narrower = side * (half.variance.sqrt() - 1.0);
        left.factor += DMat3::from_cols(narrower * axis.x, narrower * axis.y, narrower * axis.z);
        left.skews.push(side * half.third.cbrt());
    }
    Some(left)
}

impl Lattice {
    /// Number of ghosts before the first sample along each axis, and behind the last.
    pub(crate) fn ghosts(&self) -> [usize; 3] {
        self.dims.map(|n| usize::from(n > 1))
    }

    /// The lattice with a layer of ghosts around it.
    pub(crate) fn with_ghosts(&self) -> Self {
        let ghosts = self.ghosts();
        let spacing = match &self.spacing {
            LatticeSpacing::Uniform { origin, step } => LatticeSpacing::Uniform {
                origin: *origin - *step * DVec3::from(ghosts.map(|n| n as f64)),
                step: *step,
            },
            LatticeSpacing::Rectilinear { coordinates } => LatticeSpacing::Rectilinear {
                coordinates: coordinates.each_ref().map(|line| match line.as_slice() {
                    [a, b, ..] => {
                        let (y, z) = (line[line.len() - 2], line[line.len() - 1]);
                        let mut wider = Vec::with_capacity(line.len() + 2);
                        wider.push(2.0 * a - b);
                        wider.extend_from_slice(line);
                        wider.push(2.0 * z - y);
                        wider
                    }
                    one => one.to_vec(),
                }),
            },
        };
        Self {
            dims: [0, 1, 2].map(|a| self.dims[a] + 2 * ghosts[a]),
            spacing,
        }
    }

    /// The source samples for each sample of [`Self::with_ghosts`]: the nearest sample of this lattice, and the
    /// one as far behind that. They are the same unless the sample is a ghost.
    fn ghost_sources(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let planes = self.dims[2] + 2 * self.ghosts()[2];
        (0..planes).flat_map(|plane| self.ghost_sources_of(plane))
    }

    /// The source samples of [`Self::ghost_sources`], for one plane of samples.
    pub(crate) fn ghost_sources_of(
        &self,
        plane: usize,
    ) -> impl Iterator<Item = [usize; 2]> + use<'_> {
        let ghosts = self.ghosts();
        let wide = [0, 1, 2].map(|a| self.dims[a] + 2 * ghosts[a]);
        let of_axis = move |a: usize, i: usize| {
            let (n, i) = (self.dims[a], i as isize - ghosts[a] as isize);
            let nearest = i.clamp(0, n as isize - 1);
            [nearest as usize, (2 * nearest - i) as usize]
        };
        let index = |[i, j, k]: [usize; 3]| i + self.dims[0] * (j + self.dims[1] * k);
        (0..wide[0] * wide[1]).map(move |n| {
            let cell = [n % wide[0], n / wide[0], plane];
            let [x, y, z] = [0, 1, 2].map(|a| of_axis(a, cell[a]));
            [index([x[0], y[0], z[0]]), index([x[1], y[1], z[1]])]
        })
    }

    /// Values of the samples and their ghosts, of the same type.
    pub(crate) fn values_with_ghosts(&self, values: &Values) -> Values {
        values.extrapolated(self.ghost_sources())
    }

    /// Entries of the samples and their ghosts; a ghost has its nearest sample's entry.
    pub(crate) fn copied_to_ghosts<T: Copy>(&self, entries: &[T]) -> Vec<T> {
        self.ghost_sources().map(|[a, _]| entries[a]).collect()
    }
}

impl Values {
    /// Extrapolates to a ghost from each pair of values: 2 v0 - v1, where v1 lies behind v0. Results are
    /// clamped to the values' type; if one is not finite, it is v0.
    pub(crate) fn extrapolated(&self, pairs: impl Iterator<Item = [usize; 2]>) -> Self {
        macro_rules! integers {
            ($v:expr, $type:ty) => {
                pairs
                    .map(|[a, b]| {
                        let wide = 2 * i32::from($v[a]) - i32::from($v[b]);
                        let held = wide.clamp(<$type>::MIN.into(), <$type>::MAX.into());
                        <$type>::try_from(held).unwrap_or($v[a])
                    })
                    .collect()
            };
        }
        let beyond = |a: f32, b: f32| {
            let beyond = 2.0 * a - b;
            if beyond.is_finite() { beyond } else { a }
        };
        match self {
            Self::U8(v) => Self::U8(integers!(v, u8)),
            Self::I16(v) => Self::I16(integers!(v, i16)),
            Self::U16(v) => Self::U16(integers!(v, u16)),
            Self::F32(v) => Self::F32(pairs.map(|[a, b]| beyond(v[a], v[b])).collect()),
            Self::F64(_) => {
                let of = |[a, b]: [usize; 2]| f64::from(beyond(self.get(a), self.get(b)));
                Self::F64(pairs.map(of).collect())
            }
        }
    }

    /// Appends the values of ghosts: a given value, rounded and clamped to the values' type, or one
    /// extrapolated from a pair.
    pub(crate) fn extrapolate(&mut self, ghosts: &[([usize; 2], Option<f64>)]) {
        let mut beyond = self.extrapolated(ghosts.iter().map(|(pair, _)| *pair));
        for (i, given) in ghosts.iter().enumerate() {
            if let Some(given) = given.1.filter(|given| given.is_finite()) {
                // Casts saturate.
                match &mut beyond {
                    Self::U8(v) => v[i] = given.round() as u8,
                    Self::I16(v) => v[i] = given.round() as i16,
                    Self::U16(v) => v[i] = given.round() as u16,
                    Self::F32(v) => v[i] = given as f32,
                    Self::F64(v) => v[i] = given,
                }
            }
        }
        fn append<T>(values: &mut Vec<T>, ghosts: Vec<T>) {
            values.reserve_exact(ghosts.len());
            values.extend(ghosts);
        }
        let ghosts = beyond;
        match (self, ghosts) {
            (Self::U8(v), Self::U8(ghosts)) => append(v, ghosts),
            (Self::I16(v), Self::I16(ghosts)) => append(v, ghosts),
            (Self::U16(v), Self::U16(ghosts)) => append(v, ghosts),
            (Self::F32(v), Self::F32(ghosts)) => append(v, ghosts),
            (Self::F64(v), Self::F64(ghosts)) => append(v, ghosts),
            // They have the same type.
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_leave_the_moments_that_sums_have() {
        let factor = DMat3::from_cols(
            DVec3::new(0.8, 0.1, -0.2),
            DVec3::new(0.0, 0.5, 0.3),
            DVec3::new(0.0, 0.0, 0.6),
        );
        // Two planes that are orthogonal in the kernel's metric: their normals are rows of the factor's
        // inverse.
        let rows = factor.inverse().transpose();
        let plane = |n: DVec3, deviations: f64| {
            let unit = n.normalize();
            let distance = deviations * (factor.transpose() * unit).length();
            unit.extend(distance).to_array().map(|x| x as f32)
        };
        let planes = [plane(rows.x_axis, 0.3), plane(-rows.y_axis, -0.5), NO_EDGE];
        let left = cut_kernel(factor, &planes).unwrap();
        const STEPS: usize = 120;
        let (mut share, mut first) = (0.0, DVec3::ZERO);
        let mut second = [DVec3::ZERO; 3];
        let step = 12.0 / STEPS as f64;
        for n in 0..STEPS.pow(3) {
            let cell = [n % STEPS, n / STEPS % STEPS, n / (STEPS * STEPS)];
            let z = DVec3::from(cell.map(|i| (i as f64 + 0.5) * step - 6.0));
            if z.x < -0.3 || z.y > -0.5 {
                continue;
            }
            let weight =
                step.powi(3) * (-0.5 * z.length_squared()).exp() / std::f64::consts::TAU.powf(1.5);
            let x = factor * z;
            share += weight;
            first += weight * x;
            for (a, sum) in second.iter_mut().enumerate() {
                *sum += weight * x * x[a];
            }
        }
        // Planes cut through integration steps of a tenth: each end contributes an error of about a thousandth
        // of the whole.
        let mean = first / share;
        assert!((left.share - share).abs() < 2e-3 * share);
        assert!((left.shift - mean).length() < 5e-3);
        let variance = left.factor * left.factor.transpose();
        for a in 0..3 {
            let expected = second[a] / share - mean * mean[a];
            assert!((variance.col(a) - expected).length() < 5e-3, "{a}");
        }
        assert!(cut_kernel(factor, &[plane(rows.x_axis, -9.0)]).is_none());
    }

    #[test]
    fn ghosts_continue_linear_values_and_are_held_to_their_type() {
        let lattice = Lattice::uniform([3, 2, 1], DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0));
        let wide = lattice.with_ghosts();
        assert_eq!(wide.dims, [5, 4, 1]);
        assert_eq!(wide.position([0, 0, 0]), DVec3::new(-1.0, -2.0, 0.0));
        // Ghosts of a linear field have the field's own values, at corners too.
        let field = |p: DVec3| (10.0 + 2.0 * p.x - 3.0 * p.y) as f32;
        let cells = |l: &Lattice| -> Vec<DVec3> {
            let [x, y, _] = l.dims;
            (0..l.len())
                .map(|n| l.position([n % x, n / x % y, 0]))
                .collect()
        };
        let values = Values::F32(cells(&lattice).into_iter().map(field).collect());
        let Values::F32(found) = lattice.values_with_ghosts(&values) else {
            panic!("values keep their type");
        };
        for (found, place) in found.iter().zip(cells(&wide)) {
            assert!((found - field(place)).abs() < 1e-5, "{place}: {found}");
        }
        // 2 x 250 - 240 is above a byte's range, 2 x 3 - 10 below it.
        let bytes = Values::U8(vec![3, 10, 250, 3, 10, 250]);
        let Values::U8(found) = lattice.values_with_ghosts(&bytes) else {
            panic!("values keep their type");
        };
        assert_eq!(found[..5], [0, 3, 10, 250, 255]);
        let nan = Values::F32(vec![1.0, f32::NAN, 2.0, 1.0, f32::NAN, 2.0]);
        assert_eq!(lattice.values_with_ghosts(&nan).get(0), 1.0);
    }
}
