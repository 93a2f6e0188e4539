//! Computes directions of gradients, for light: unit normals of the surfaces of equal value.
//!
//! | data | gradient | error |
//! |---|---|---|
//! | lattices, curvilinear grids | central differences along each index of values and of positions, g = F⁻ᵀ ∂v/∂(i, j, k), F = ∂x/∂(i, j, k) by the same differences; one-sided at borders and beside samples without a value | second order in the spacing if it is even, first order if it changes |
//! | cells | least squares over the samples that share a cell or a node, weights 1/distance² | first order |
//! | particles | least squares over the 14 nearest, more if these lie in a plane | first order |
//!
//! All are exact for linear fields, except at a sample whose neighbours do not span space: there the field
//! counts as constant across them. Directions are stored to .12 degrees ([`normal_code`]).

use glam::{DMat3, DVec3};

use super::fit::least_squares;
use super::local_models::mesh::SampledMesh;
use crate::error::Result;
use crate::math::normal_code;
use crate::parallel;
use crate::sample::cells::incidence::{first_of, nodes_of};
use crate::sample::points::neighbours::{Groups, PointIndex};
use crate::scene::{Lattice, Particles, PointVolume, Strength, Values};
use crate::task::{Task, collect};

/// Columns of F span space if its determinant exceeds this share of the product of their lengths. Only cells
/// sheared flat fall below it; thin cells do not.
pub(in crate::sample) const SPANNING: f64 = 1e-9;

/// Gives a volume normals if it has values and no normals yet. Surfels and splats stay as they are.
///
/// - `groups`: groups of the particles' positions, if they are known.
pub(in crate::sample) fn complete(
    volume: &mut PointVolume,
    groups: &mut Option<Groups>,
    task: Option<&Task>,
) -> Result<()> {
    let is_of_splats = matches!(volume.strength, Strength::PeakOpacity { .. });
    let (Some(values), None, false) = (&volume.values, &volume.normals, is_of_splats) else {
        return Ok(());
    };
    volume.normals = match &volume.particles {
        Particles::Lattice { lattice, .. } => Some(of_lattice(lattice, values, task)?),
        Particles::Isotropic { positions, .. } | Particles::Anisotropic { positions, .. } => {
            match PointIndex::of(positions, groups.take()) {
                Some(index) => {
                    let (normals, _) = index.normals(task, |i| values.get(i))?;
                    *groups = Some(index.into_groups());
                    Some(normals)
                }
                None => None,
            }
        }
        Particles::Surfels { .. } => None,
    };
    Ok(())
}

fn of_lattice(lattice: &Lattice, values: &Values, task: Option<&Task>) -> Result<Vec<u32>> {
    let [nx, ny, _] = lattice.dims;
    let samples = Samples {
        dims: lattice.dims,
        periods: [None; 3],
        at: |cell: [usize; 3]| {
            let value = values.get(cell[0] + nx * (cell[1] + ny * cell[2]));
            value
                .is_finite()
                .then(|| (lattice.position(cell), f64::from(value)))
        },
    };
    let normal = |i| normal_code(samples.gradient([i % nx, i / nx % ny, i / (nx * ny)]));
    collect(task, "fitting gradients", lattice.len(), normal)
}

/// Samples in a three-dimensional array.
pub(in crate::sample) struct Samples<F> {
    pub(in crate::sample) dims: [usize; 3],
    /// Number of samples after which an index repeats, for a grid that closes on itself.
    pub(in crate::sample) periods: [Option<usize>; 3],
    /// Returns position and value of a sample, if it has both.
    pub(in crate::sample) at: F,
}

impl<F: Fn([usize; 3]) -> Option<(DVec3, f64)>> Samples<F> {
    /// Returns the indices of a sample, given its number.
    pub(in crate::sample) fn indices(&self, sample: usize) -> [usize; 3] {
        let [ni, nj, _] = self.dims;
        [sample % ni, sample / ni % nj, sample / (ni * nj)]
    }

    /// Returns the gradient at a sample; zero if the sample is unknown.
    pub(in crate::sample) fn gradient(&self, sample: [usize; 3]) -> DVec3 {
        let Some(own) = (self.at)(sample) else {
            return DVec3::ZERO;
        };
        let mut columns = [DVec3::ZERO; 3];
        let mut changes = DVec3::ZERO;
        for axis in 0..3 {
            let side = |step: isize| {
                let mut steps = [0; 3];
                steps[axis] = step;
                self.neighbour(sample, steps).unwrap_or(own)
            };
            let (below, above) = (side(-1), side(1));
            columns[axis] = above.0 - below.0;
            changes[axis] = above.1 - below.1;
        }
        let jacobian = DMat3::from_cols_array_2d(&columns.map(Into::into));
        let lengths: f64 = columns.iter().map(|c| c.length()).product();
        if jacobian.determinant().abs() > SPANNING * lengths {
            return jacobian.inverse().transpose() * changes;
        }
        // On a singular line, in a single layer or beside samples without values: fit all 26 neighbours.
        let around = (0..27_usize).filter_map(|n| {
            let steps = [n % 3, n / 3 % 3, n / 9].map(|s| s as isize - 1);
            let (position, value) = self.neighbour(sample, steps)?;
            Some((position - own.0, value - own.1))
        });
        least_squares(around)
    }

    /// Returns position and value of the sample some steps away.
    pub(in crate::sample) fn neighbour(
        &self,
        sample: [usize; 3],
        steps: [isize; 3],
    ) -> Option<(DVec3, f64)> {
        (self.at)(self.stepped(sample, steps)?)
    }

    /// Returns the sample some steps away, if there is one. Steps along a closed index must be fewer than its
    /// samples.
    fn stepped(&self, sample: [usize; 3], steps: [isize; 3]) -> Option<[usize; 3]> {
        let along = |axis: usize| self.along(axis, sample[axis], steps[axis]);
        Some([along(0)?, along(1)?, along(2)?])
    }

    /// Returns the index some steps away along one axis.
    pub(in crate::sample) fn along(&self, axis: usize, own: usize, step: isize) -> Option<usize> {
        step_along(own, step, self.dims[axis], self.periods[axis])
    }
}

/// Returns the index `step` steps away among `count`, `None` outside. A closed index repeats after its period:
/// steps cross the seam.
pub(in crate::sample) fn step_along(
    own: usize,
    step: isize,
    count: usize,
    period: Option<usize>,
) -> Option<usize> {
    match period {
        Some(period) => Some(
            (own as isize + step)
                .rem_euclid(period as isize)
                .unsigned_abs(),
        ),
        None => own.checked_add_signed(step).filter(|&i| i < count),
    }
}

/// Returns codes of the normals at the wanted samples of an unstructured grid. Neighbours are the samples that
/// share a cell (values of nodes) or a node (values of cells). In layers of cells far thinner than wide, the
/// nearest samples in space would all lie in one direction.
///
/// Samples without a kernel are ignored.
pub(in crate::sample) fn of_mesh(samples: &SampledMesh<'_>) -> Vec<u32> {
    let &SampledMesh {
        mesh,
        around,
        first,
        of_nodes,
        kernels,
        values,
        ..
    } = samples;
    let mut known = vec![DVec3::NAN; values.len()];
    for (n, &sample) in kernels.kept.iter().enumerate() {
        // Values belong to nodes, not to the centroids of their dual cells.
        known[sample as usize] = match of_nodes {
            true => mesh.nodes[sample as usize],
            false => kernels.positions[n],
        };
    }
    let normal = |&sample: &u32| {
        let own = sample as usize;
        let offset = |other: u32| {
            let other = other as usize;
            let change = f64::from(values.get(other)) - f64::from(values.get(own));
            (known[other] - known[own], change)
        };
        let gradient = if of_nodes {
            let cells = around.of(first_of(first, sample)).iter();
            least_squares(cells.flat_map(|&c| nodes_of(mesh, c as usize)).map(offset))
        } else {
            let nodes = nodes_of(mesh, own).map(|n| first_of(first, n));
            least_squares(nodes.flat_map(|n| around.of(n)).map(|&c| offset(c)))
        };
        normal_code(gradient)
    };
    let own = &kernels.kept[samples.own.clone()];
    parallel::map(own.len(), |i| normal(&own[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::field::fit::Fit;

    /// Samples at `place` of each index, with values of `field`; NaN means no value.
    fn samples(
        dims: [usize; 3],
        place: impl Fn([f64; 3]) -> DVec3,
        field: impl Fn(DVec3) -> f64,
    ) -> Samples<impl Fn([usize; 3]) -> Option<(DVec3, f64)>> {
        Samples {
            dims,
            periods: [None; 3],
            at: move |sample: [usize; 3]| {
                let position = place(sample.map(|i| i as f64));
                let value = field(position);
                value.is_finite().then_some((position, value))
            },
        }
    }

    fn all(dims: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
        let [ni, nj, nk] = dims;
        (0..ni * nj * nk).map(move |n| [n % ni, n / ni % nj, n / (ni * nj)])
    }

    const SLOPE: DVec3 = DVec3::new(0.3, -1.7, 0.9);

    fn linear(x: DVec3) -> f64 {
        4.0 + SLOPE.dot(x)
    }

    /// A stretched grid, a sheared one, and one bent around an axis, whose line of samples is one place.
    fn places() -> [fn([f64; 3]) -> DVec3; 3] {
        [
            |[i, j, k]| DVec3::new(1.1_f64.powf(i), j * j, 0.3 * k),
            |[i, j, k]| DVec3::new(i + 0.4 * j, j - 0.2 * k, 1e-3 * k + 0.5 * i),
            |[i, j, k]| DVec3::new(j * (0.5 * i).cos(), j * (0.5 * i).sin(), k + 0.1 * j * i),
        ]
    }

    #[test]
    fn linear_fields_are_exact_on_any_grid() {
        let dims = [6, 5, 4];
        for (n, place) in places().into_iter().enumerate() {
            let samples = samples(dims, place, linear);
            for sample in all(dims) {
                let error = (samples.gradient(sample) - SLOPE).length();
                // Differences of f64 values of some 10, over steps down to 1e-3. On the singular line, least
                // squares damped by 1e-9 of the trace.
                let most = if n == 2 && sample[1] == 0 {
                    1e-6
                } else {
                    1e-10
                };
                assert!(error < most, "{n}, {sample:?}: {error}");
            }
        }
    }

    #[test]
    fn quadratic_fields_err_by_the_change_of_spacing() {
        // v = x²: (v+ - v-) / (x+ - x-) = x+ + x-, which is 2 x if the spacing is even.
        let square = |x: DVec3| x.x * x.x;
        let place = |[i, j, k]: [f64; 3]| DVec3::new(1.2_f64.powf(i), j, k);
        let dims = [8, 3, 3];
        let stretched = samples(dims, place, square);
        let x = |i: usize| 1.2_f64.powi(i32::try_from(i).unwrap());
        for i in 1..7 {
            let gradient = stretched.gradient([i, 1, 1]).x;
            let stated = x(i + 1) - 2.0 * x(i) + x(i - 1);
            assert!((gradient - 2.0 * x(i) - stated).abs() < 1e-12, "{i}");
        }
        let even = samples(dims, |[i, j, k]| DVec3::new(0.5 * i, j, k), square);
        for i in 0..8 {
            // At the ends the difference is that of half a step inside.
            let off = [0.5, 0.0, -0.5][usize::from(i > 0) + usize::from(i == 7)];
            let gradient = even.gradient([i, 1, 1]);
            assert!(
                (gradient.x - (i as f64 + off)).abs() < 1e-12,
                "{i}: {gradient}"
            );
        }
    }

    #[test]
    fn curved_grids_are_of_second_order() {
        let field = |x: DVec3| x.x * x.x - x.y * x.z + 0.5 * x.z * x.z;
        let truth = |x: DVec3| DVec3::new(2.0 * x.x, -x.z, x.z - x.y);
        let worst = |n: usize| {
            let place = move |[i, j, k]: [f64; 3]| {
                let [a, r, z] = [i, j, k].map(|t| 1.0 + t / n as f64);
                DVec3::new(r * a.cos(), r * a.sin(), z + 0.2 * a * r)
            };
            let samples = samples([n + 1; 3], place, field);
            let inside = all([n + 1; 3]).filter(|s| s.iter().all(|&i| i > 0 && i < n));
            inside
                .map(|s| {
                    let at = place(s.map(|i| i as f64));
                    (samples.gradient(s) - truth(at)).length()
                })
                .fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(8), worst(16));
        let ratio = coarse / fine;
        assert!((3.4..4.6).contains(&ratio), "{coarse} {fine}");
    }

    #[test]
    fn samples_without_a_value_are_gone_around() {
        let dims = [7, 7, 7];
        let place = |s: [f64; 3]| DVec3::from(s);
        let holes = |x: DVec3| {
            let n = x.dot(DVec3::new(1.0, 7.0, 49.0)).round();
            if n % 3.0 == 0.0 { f64::NAN } else { linear(x) }
        };
        let samples = samples(dims, place, holes);
        for sample in all(dims) {
            let gradient = samples.gradient(sample);
            if holes(place(sample.map(|i| i as f64))).is_nan() {
                assert_eq!(gradient, DVec3::ZERO);
            } else {
                assert!((gradient - SLOPE).length() < 1e-6, "{sample:?}: {gradient}");
            }
        }
    }

    #[test]
    fn layers_and_lone_samples_have_what_they_can() {
        let flat = samples([5, 5, 1], DVec3::from, linear);
        let gradient = flat.gradient([2, 0, 0]);
        assert!((gradient - SLOPE.with_z(0.0)).length() < 1e-6, "{gradient}");
        let lone = samples([1; 3], DVec3::from, linear);
        assert_eq!(lone.gradient([0; 3]), DVec3::ZERO);
        assert_eq!(least_squares(std::iter::empty()), DVec3::ZERO);
    }

    #[test]
    fn the_near_count_more_than_the_far() {
        // x² at 1 and at -2: (1 - 4/2) / (1 + 1) with weights 1/distance², (1 - 8) / (1 + 4) without.
        let neighbours = [(DVec3::X, 1.0), (-2.0 * DVec3::X, 4.0)];
        let gradient = least_squares(neighbours.into_iter());
        assert!((gradient - DVec3::X * -0.5).length() < 1e-8, "{gradient}");
        assert!(!Fit::of(neighbours.into_iter()).spans());
    }

    #[test]
    fn closed_grids_have_no_border() {
        let n = 12;
        let angle = |i: f64| std::f64::consts::TAU * i / n as f64;
        let place = move |[i, j, k]: [f64; 3]| {
            (1.0 + j) * DVec3::new(angle(i).cos(), angle(i).sin(), 0.0) + DVec3::Z * k
        };
        let open = samples([n + 1, 3, 3], place, |x| x.x * x.x);
        let closed = Samples {
            periods: [Some(n), None, None],
            ..samples([n + 1, 3, 3], place, |x| x.x * x.x)
        };
        let (a, b) = (closed.gradient([0, 1, 1]), closed.gradient([6, 1, 1]));
        // Half a turn away the field is the same and its gradient is reversed.
        assert!((a + b).length() < 1e-12, "{a} {b}");
        assert!((open.gradient([0, 1, 1]) - a).length() > 1e-3);
        assert_eq!(open.gradient([6, 1, 1]), b);
    }
}
