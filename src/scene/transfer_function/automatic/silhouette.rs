//! The area that data cover in a view, and their thickness along it.

use glam::DVec3;

use crate::scene::{LONE_CELL_WIDTH, Lattice, LatticeSpacing};

/// Places that a column across the view should have at least, on average.
const PLACES_IN_COLUMN: usize = 8;

/// Columns along an axis at most.
const MOST_COLUMNS: usize = 128;

/// A box around data, and the areas that they cover along its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Silhouette {
    lower: DVec3,
    upper: DVec3,
    /// The covered areas as seen along x, y and z \[length²\].
    areas: DVec3,
}

impl Silhouette {
    /// The silhouette of a lattice whose samples each stand for a cell around them; `None` if it has no samples.
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
        let half = edges.iter().map(|edge| edge.abs()).sum::<DVec3>() / 2.0;
        let [a, b, c] = edges;
        let areas = a.cross(b).abs() + b.cross(c).abs() + c.cross(a).abs();
        Some(Self {
            lower: middle - half,
            upper: middle + half,
            areas,
        })
    }

    /// The silhouette of samples at positions.
    ///
    /// - `count`: the number of samples that each position stands for.
    /// - `volumes`: the volume of one sample at each position, which covers no more than a cube of that volume; `None` if the
    ///   samples tile space.
    pub(super) fn of_places(places: &[DVec3], count: f64, volumes: Option<&[f64]>) -> Option<Self> {
        let ends = places.iter().map(|p| (*p, *p));
        let (lower, upper) = ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        let extent = upper - lower;
        let columns = (places.len() / PLACES_IN_COLUMN)
            .isqrt()
            .clamp(1, MOST_COLUMNS);
        let area = |axis: usize| {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let column = extent[u] * extent[v] / (columns * columns) as f64;
            let mut covered = vec![0.0_f64; columns * columns];
            for (i, p) in places.iter().enumerate() {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "a column's number, within the box"
                )]
                let at = |axis: usize| {
                    let share = (p[axis] - lower[axis]) / extent[axis];
                    ((share * columns as f64) as usize).min(columns - 1)
                };
                let own =
                    volumes.map_or(f64::INFINITY, |volumes| count * volumes[i].cbrt().powi(2));
                covered[at(u) + columns * at(v)] += own;
            }
            covered.iter().map(|own| own.min(column)).sum()
        };
        Some(Self {
            lower,
            upper,
            areas: DVec3::from([0, 1, 2].map(area)),
        })
    }

    /// The silhouette of two data sets together. Their areas add, but do not exceed the areas of their common box.
    pub(super) fn joined(self, other: Self) -> Self {
        let (lower, upper) = (self.lower.min(other.lower), self.upper.max(other.upper));
        let [x, y, z] = (upper - lower).to_array();
        let most = DVec3::new(y * z, z * x, x * y);
        let most = most.max(self.areas).max(other.areas);
        Self {
            lower,
            upper,
            areas: (self.areas + other.areas).min(most),
        }
    }

    /// The thickness \[length\] of data of this volume along the axis on whose view they cover most; `None` if they cover
    /// nothing.
    pub(super) fn thickness(&self, volume: f64) -> Option<f64> {
        let thickness = volume / self.areas.max_element();
        (thickness > 0.0 && thickness.is_finite()).then_some(thickness)
    }

    /// As records of three numbers.
    #[cfg(feature = "cli")]
    pub(super) fn to_records(self) -> [[f64; 3]; 3] {
        [self.lower, self.upper, self.areas].map(|v| v.to_array())
    }

    /// The silhouette that the records of [`Self::to_records`] store.
    #[cfg(feature = "cli")]
    pub(super) fn of_records([lower, upper, areas]: [[f64; 3]; 3]) -> Self {
        let [lower, upper, areas] = [lower, upper, areas].map(DVec3::from);
        Self {
            lower,
            upper,
            areas,
        }
    }
}
