//! Integrates along rays through lattices, cell by cell; the field is trilinear between samples.

use glam::{DMat3, DVec3};

use super::cubic::Cubic;
use super::emission::Emission;
use crate::data::association::Association;
use crate::scene::{Lattice, LatticeSpacing, Values};

/// A lattice's samples and the planes between which the field is trilinear.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    /// Origin of lattice coordinates, world space.
    origin: DVec3,
    lattice_from_world: DMat3,
    axes: [Axis; 3],
    /// Number of samples along each index.
    dims: [usize; 3],
    values: Values,
}

/// The planes perpendicular to one axis, lattice coordinates. For values at nodes they are the nodes. For
/// values of cells they are the cells' centres and the faces at both ends, which have the values of the
/// outermost centres.
#[derive(Debug, Clone)]
struct Axis {
    planes: Vec<f64>,
    /// Sample on each plane.
    samples: Vec<usize>,
}

impl Axis {
    fn new(nodes: Vec<f64>, association: Association) -> Self {
        let last = nodes.len() - 1;
        match association {
            Association::Nodes => Self {
                samples: (0..=last).collect(),
                planes: nodes,
            },
            Association::Cells => {
                let centres = nodes.windows(2).map(|w| 0.5 * (w[0] + w[1]));
                let planes = std::iter::once(nodes[0]).chain(centres);
                Self {
                    samples: std::iter::once(0)
                        .chain(0..last)
                        .chain(std::iter::once(last - 1))
                        .collect(),
                    planes: planes.chain(std::iter::once(nodes[last])).collect(),
                }
            }
        }
    }

    /// Returns the slab that a ray enters at `t`, or the nearest slab.
    fn slab(&self, origin: f64, rate: f64, t: f64) -> usize {
        let behind = if rate > 0.0 {
            self.planes.partition_point(|p| (p - origin) / rate <= t)
        } else if rate < 0.0 {
            self.planes.partition_point(|p| (p - origin) / rate > t)
        } else {
            self.planes.partition_point(|p| *p <= origin)
        };
        behind.saturating_sub(1).min(self.planes.len() - 2)
    }

    /// Returns the parameter at which a ray leaves slab `i`.
    fn exit(&self, i: usize, origin: f64, rate: f64) -> f64 {
        if rate > 0.0 {
            (self.planes[i + 1] - origin) / rate
        } else if rate < 0.0 {
            (self.planes[i] - origin) / rate
        } else {
            f64::INFINITY
        }
    }
}

impl Grid {
    /// Returns `None` if the lattice has no volume. There is one value for each node or cell, NaN if missing.
    pub(super) fn new(lattice: &Lattice, association: Association, values: Values) -> Option<Self> {
        if lattice.dims.iter().any(|&n| n < 2) {
            return None;
        }
        let (origin, lattice_from_world, nodes) = match &lattice.spacing {
            LatticeSpacing::Uniform { origin, step } => {
                let indices = lattice.dims.map(|n| (0..n).map(|i| i as f64).collect());
                (*origin, step.inverse(), indices)
            }
            // Relative to the first sample, so that a distant origin costs no digits.
            LatticeSpacing::Rectilinear { coordinates } => {
                let first = coordinates.each_ref().map(|line| line[0]);
                let lines =
                    [0, 1, 2].map(|d| coordinates[d].iter().map(|x| x - first[d]).collect());
                (DVec3::from(first), DMat3::IDENTITY, lines)
            }
        };
        let axes: [Axis; 3] = nodes.map(|line: Vec<f64>| Axis::new(line, association));
        let rises = |axis: &Axis| axis.planes.windows(2).all(|w| w[0] < w[1]);
        (lattice_from_world.is_finite() && axes.iter().all(rises)).then(|| Self {
            origin,
            lattice_from_world,
            axes,
            dims: match association {
                Association::Nodes => lattice.dims,
                Association::Cells => lattice.dims.map(|n| n - 1),
            },
            values,
        })
    }

    /// Returns centre and radius of the ball around the domain.
    pub(super) fn ball(&self) -> (DVec3, f64) {
        let world = self.lattice_from_world.inverse();
        let end = |axis: &Axis| axis.planes[axis.planes.len() - 1];
        let low = DVec3::from(self.axes.each_ref().map(|a| a.planes[0]));
        let high = DVec3::from(self.axes.each_ref().map(end));
        let half = (high - low) / 2.0;
        let corner = |signs: [f64; 3]| (world * (half * DVec3::from(signs))).length();
        let corners = [
            [1.0, 1.0, 1.0],
            [-1.0, 1.0, 1.0],
            [1.0, -1.0, 1.0],
            [1.0, 1.0, -1.0],
        ];
        let radius = corners.map(corner).into_iter().fold(0.0, f64::max);
        (self.origin + world * (low + half), radius)
    }

    /// Returns the number of cells with a sample that is not finite.
    pub(super) fn left_out(&self) -> usize {
        if self.values.non_finite_count() == 0 {
            return 0;
        }
        let [nx, ny, nz] = self.axes.each_ref().map(|a| a.planes.len() - 1);
        let slabs =
            (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])));
        slabs.filter(|&cell| self.corners(cell).is_none()).count()
    }

    /// Returns the samples at the corners of a cell, i fastest; `None` if one is not finite.
    fn corners(&self, cell: [usize; 3]) -> Option<[f64; 8]> {
        let [x, y, z] = [0, 1, 2].map(|d| {
            let samples = &self.axes[d].samples;
            [samples[cell[d]], samples[cell[d] + 1]]
        });
        let mut corners = [0.0; 8];
        for (c, corner) in corners.iter_mut().enumerate() {
            let row = y[c >> 1 & 1] + self.dims[1] * z[c >> 2];
            *corner = f64::from(self.values.get(x[c & 1] + self.dims[0] * row));
        }
        corners.iter().all(|v| v.is_finite()).then_some(corners)
    }

    /// Adds the emission along the ray `origin` + t `direction` (unit length), up to `end`.
    pub(super) fn integrate(
        &self,
        origin: DVec3,
        direction: DVec3,
        end: f64,
        emission: &mut Emission<'_>,
    ) {
        let o = (self.lattice_from_world * (origin - self.origin)).to_array();
        let rate = (self.lattice_from_world * direction).to_array();
        let (mut from, mut end) = (0.0_f64, end);
        for d in 0..3 {
            let planes = &self.axes[d].planes;
            let ends = [planes[0], planes[planes.len() - 1]];
            if rate[d] == 0.0 {
                if !(o[d] >= ends[0] && o[d] <= ends[1]) {
                    return;
                }
            } else {
                let [a, b] = ends.map(|p| (p - o[d]) / rate[d]);
                from = from.max(a.min(b));
                end = end.min(a.max(b));
            }
        }
        if !(from < end) {
            return;
        }
        let mut cell = [0, 1, 2].map(|d| self.axes[d].slab(o[d], rate[d], from));
        while emission.goes_on() {
            let exits = [0, 1, 2].map(|d| self.axes[d].exit(cell[d], o[d], rate[d]));
            let to = exits.into_iter().fold(end, f64::min);
            if to > from
                && let Some(corners) = self.corners(cell)
            {
                let low = corners.into_iter().fold(f64::INFINITY, f64::min);
                let high = corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
                if !emission.is_transparent(low, high) {
                    let lines = [0, 1, 2].map(|d| {
                        let planes = &self.axes[d].planes;
                        let width = planes[cell[d] + 1] - planes[cell[d]];
                        let start = (o[d] + rate[d] * from - planes[cell[d]]) / width;
                        [start, rate[d] * (to - from) / width]
                    });
                    emission.add(to - from, &along(&corners, lines));
                }
            }
            from = from.max(to);
            if !(from < end) {
                return;
            }
            for d in 0..3 {
                if exits[d] > to {
                    continue;
                }
                let is_last = cell[d] + 2 == self.axes[d].planes.len();
                match rate[d] > 0.0 {
                    true if !is_last => cell[d] += 1,
                    false if cell[d] > 0 => cell[d] -= 1,
                    _ => return,
                }
            }
        }
    }
}

/// Returns a trilinear function of its corners' values, i fastest, along a line. At s each coordinate is
/// start + rate s.
fn along(corners: &[f64; 8], [x, y, z]: [[f64; 2]; 3]) -> Cubic {
    let [edge00, edge10, edge01, edge11] = [0, 2, 4, 6].map(|c| {
        let difference = corners[c + 1] - corners[c];
        [corners[c] + x[0] * difference, x[1] * difference]
    });
    let [face0, face1] = [(edge00, edge10), (edge01, edge11)].map(|(a, b)| {
        let d = [b[0] - a[0], b[1] - a[1]];
        [
            a[0] + y[0] * d[0],
            a[1] + y[0] * d[1] + y[1] * d[0],
            y[1] * d[1],
        ]
    });
    let d = [0, 1, 2].map(|i| face1[i] - face0[i]);
    Cubic([
        face0[0] + z[0] * d[0],
        face0[1] + z[0] * d[1] + z[1] * d[0],
        face0[2] + z[0] * d[2] + z[1] * d[1],
        z[1] * d[2],
    ])
}
