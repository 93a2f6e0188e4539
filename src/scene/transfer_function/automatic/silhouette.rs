//! The area that data cover in a view, and their thickness along it.

use glam::{DMat3, DVec3};

use crate::math::eigen;
use crate::scene::lattice::{LONE_CELL_WIDTH, Lattice, LatticeSpacing};

/// Divisor of a squared length: the variance of an even distribution over it.
const EVEN: f64 = 12.0;

/// Extent of the data along their principal axes; rotating the data does not change it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Silhouette {
    /// Volume over which the moments are taken \[length³\].
    weight: f64,
    middle: DVec3,
    /// The variance about the middle: xx, xy, xz, yy, yz, zz \[length²\].
    variance: [f64; 6],
    /// The area that the data cover as seen along their thinnest axis \[length²\].
    area: f64,
    /// Whether samples may leave gaps between them, so that their volume says little of what they cover.
    is_loose: bool,
}

impl Silhouette {
    /// The silhouette of a lattice whose samples each represent the cell around them; `None` if it has no
    /// samples.
    pub(super) fn of_lattice(lattice: &Lattice) -> Option<Self> {
        let [i, j, k] = lattice.dims;
        let last = [i.checked_sub(1)?, j.checked_sub(1)?, k.checked_sub(1)?];
        let edges: [DVec3; 3] = match &lattice.spacing {
            LatticeSpacing::Uniform { step, .. } => {
                [0, 1, 2].map(|axis| step.col(axis) * lattice.dims[axis] as f64)
            }
            LatticeSpacing::Rectilinear { coordinates } => [0, 1, 2].map(|axis| {
                let width = match coordinates[axis].as_slice() {
                    [first, .., last] => {
                        let n = lattice.dims[axis] as f64;
                        (last - first) * n / (n - 1.0)
                    }
                    _ => LONE_CELL_WIDTH,
                };
                DVec3::AXES[axis] * width
            }),
        };
        let corner = |n: usize| {
            lattice.position([0, 1, 2].map(|axis| if n >> axis & 1 == 0 { 0 } else { last[axis] }))
        };
        let middle = corner(0).midpoint(corner(7));
        let edges = DMat3::from_cols_array_2d(&edges.map(|edge| edge.to_array()));
        Some(Self::of_moments(
            edges.determinant().abs(),
            middle,
            products(edges).map(|v| v / EVEN),
            false,
        ))
    }

    /// The silhouette of samples at positions.
    ///
    /// - `volumes`: the volume of one sample at each position.
    /// - `is_loose`: whether there may be gaps between samples.
    pub(super) fn of_places(places: &[DVec3], volumes: &[f64], is_loose: bool) -> Option<Self> {
        let weight: f64 = volumes.iter().sum();
        let all = || places.iter().zip(volumes);
        let middle = all().map(|(p, v)| *p * *v).sum::<DVec3>() / weight;
        let mut variance = [0.0; 6];
        for (p, v) in all() {
            let d = *p - middle;
            // Each sample is a cube.
            let own = v.cbrt().powi(2) / EVEN;
            let terms = [
                d.x * d.x + own,
                d.x * d.y,
                d.x * d.z,
                d.y * d.y + own,
                d.y * d.z,
                d.z * d.z + own,
            ];
            for (sum, term) in variance.iter_mut().zip(terms) {
                *sum += v * term / weight;
            }
        }
        let is_known = weight > 0.0 && variance.iter().all(|v| v.is_finite());
        is_known.then(|| Self::of_moments(weight, middle, variance, is_loose))
    }

    fn of_moments(weight: f64, middle: DVec3, variance: [f64; 6], is_loose: bool) -> Self {
        let [widest, wide, _] = widths(variance);
        Self {
            weight,
            middle,
            variance,
            area: widest * wide,
            is_loose,
        }
    }

    /// The silhouette of two data sets together. Their areas add, but do not exceed that of their common
    /// distribution.
    pub(super) fn joined(self, other: Self) -> Self {
        let weight = self.weight + other.weight;
        let share = other.weight / weight;
        let apart = other.middle - self.middle;
        let between = products(DMat3::from_cols(apart, DVec3::ZERO, DVec3::ZERO));
        let variance = std::array::from_fn(|i| {
            let within = self.variance[i] + share * (other.variance[i] - self.variance[i]);
            within + share * (1.0 - share) * between[i]
        });
        let middle = self.middle + share * apart;
        let all = Self::of_moments(weight, middle, variance, self.is_loose || other.is_loose);
        Self {
            area: all.area.min(self.area + other.area),
            ..all
        }
    }

    /// The thickness \[length\] of data of this volume along their thinnest axis, and the volume \[length³\] to
    /// which it belongs; `None` if the data cover nothing.
    pub(super) fn thickness(&self, volume: f64) -> Option<(f64, f64)> {
        let [widest, wide, thin] = widths(self.variance);
        let (thickness, volume) = match self.is_loose {
            true => (thin, widest * wide * thin),
            false => (volume / self.area, volume),
        };
        (thickness > 0.0 && thickness.is_finite()).then_some((thickness, volume))
    }

    /// The silhouette as records of three numbers.
    #[cfg(feature = "prepared")]
    pub(super) fn to_records(self) -> [[f64; 3]; RECORDS] {
        let [xx, xy, xz, yy, yz, zz] = self.variance;
        let is_loose = f64::from(u8::from(self.is_loose));
        let middle = self.middle.to_array();
        [
            [self.weight, self.area, is_loose],
            middle,
            [xx, xy, xz],
            [yy, yz, zz],
        ]
    }

    /// The silhouette that the records of [`Self::to_records`] store.
    #[cfg(feature = "prepared")]
    pub(super) fn of_records(records: [[f64; 3]; RECORDS]) -> Self {
        let [[weight, area, is_loose], middle, [xx, xy, xz], [yy, yz, zz]] = records;
        Self {
            weight,
            middle: middle.into(),
            variance: [xx, xy, xz, yy, yz, zz],
            area,
            is_loose: is_loose > 0.0,
        }
    }
}

/// Number of records, of three numbers each, in a silhouette.
#[cfg(feature = "prepared")]
pub(super) const RECORDS: usize = 4;

/// The elements xx, xy, xz, yy, yz, zz of m mᵀ.
fn products(m: DMat3) -> [f64; 6] {
    let v = m * m.transpose();
    [
        v.x_axis.x, v.x_axis.y, v.x_axis.z, v.y_axis.y, v.y_axis.z, v.z_axis.z,
    ]
}

/// The edges of the box that has a variance if it is filled evenly, the longest first.
fn widths(variance: [f64; 6]) -> [f64; 3] {
    let (eigenvalues, _) = eigen(variance);
    let mut widths = eigenvalues.to_array().map(|v| (EVEN * v.max(0.0)).sqrt());
    widths.sort_unstable_by(|a, b| b.total_cmp(a));
    widths
}
