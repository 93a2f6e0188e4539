//! The spacing of scattered points, from their nearest neighbours.

use std::num::NonZero;

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// Neighbours that a spacing is taken from: enough to average, few enough to stay local.
const NEIGHBOUR_COUNT: usize = 14;

/// For each point the share of a ball that is its own: the ball reaches to the
/// [`NEIGHBOUR_COUNT`]-th neighbour, and its volume is shared among the neighbours within.
///
/// Points at one position share what one would have had; they are put in the tree once, so
/// that no node of it holds more equal points than it can split. Points that are not finite
/// get NaN. `None` with fewer than two distinct positions.
pub(super) fn neighbour_volumes(positions: &[DVec3]) -> Option<Vec<f64>> {
    let mut order: Vec<usize> = (0..positions.len())
        .filter(|&i| positions[i].is_finite())
        .collect();
    // + 0.0 makes -0 and 0 one position.
    let key = |i: usize| (positions[i] + DVec3::ZERO).to_array();
    order.par_sort_unstable_by(|&a, &b| {
        let (a, b) = (key(a), key(b));
        a[0].total_cmp(&b[0])
            .then(a[1].total_cmp(&b[1]))
            .then(a[2].total_cmp(&b[2]))
    });
    let groups: Vec<&[usize]> = order
        .chunk_by(|&a, &b| key(a).map(f64::to_bits) == key(b).map(f64::to_bits))
        .collect();
    if groups.len() < 2 {
        return None;
    }
    // Relative to a point: squared distances stay exact far from the origin.
    let origin = positions[groups[0][0]];
    let points: Vec<[f64; 3]> = groups
        .iter()
        .map(|g| (positions[g[0]] - origin).to_array())
        .collect();
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&points).ok()?;
    let wanted = NonZero::new(NEIGHBOUR_COUNT + 1)?;
    let volumes: Vec<f64> = points
        .par_iter()
        .map(|point| {
            let nearest = tree
                .query(point)
                .nearest_n::<SquaredEuclidean<f64>>(wanted)
                .execute();
            let mut within = 0;
            let mut squared_radius = 0.0;
            for found in nearest {
                squared_radius = found.distance;
                within += usize::try_from(found.item).map_or(1, |i| groups[i].len());
                if squared_radius > 0.0 && within > NEIGHBOUR_COUNT {
                    break;
                }
            }
            let ball = 4.0 / 3.0 * std::f64::consts::PI * f64::powf(squared_radius, 1.5);
            ball / (within - 1).max(1) as f64
        })
        .collect();
    let mut by_point = vec![f64::NAN; positions.len()];
    for (group, volume) in groups.iter().zip(volumes) {
        for &i in *group {
            by_point[i] = volume;
        }
    }
    Some(by_point)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice(n: u32, offset: f64) -> Vec<DVec3> {
        let at = |i: u32| f64::from(i) + offset;
        (0..n * n * n)
            .map(|i| DVec3::new(at(i % n), at(i / n % n), at(i / (n * n))))
            .collect()
    }

    #[test]
    fn a_lattice_of_spacing_one_has_volumes_near_one() {
        for offset in [0.0, 1e7] {
            let volumes = neighbour_volumes(&lattice(9, offset)).unwrap();
            // The 14th neighbour is one of 12 at sqrt(2): 4/3 pi 2^1.5 / 14 = .846.
            let centre = volumes[4 + 9 * (4 + 9 * 4)];
            assert!((centre - 0.8463).abs() < 1e-3, "{centre}");
        }
    }

    #[test]
    fn duplicates_and_bad_points_are_borne() {
        let mut points = lattice(8, 0.0);
        points.extend(std::iter::repeat_n(DVec3::splat(3.0), 5000));
        points.push(DVec3::NAN);
        let volumes = neighbour_volumes(&points).unwrap();
        assert!(volumes.last().unwrap().is_nan());
        assert!(volumes[..5512].iter().all(|v| *v > 0.0 && v.is_finite()));
        assert!(neighbour_volumes(&[DVec3::ONE; 100]).is_none());
        assert!(neighbour_volumes(&[]).is_none());
        assert!(neighbour_volumes(&[DVec3::ONE, DVec3::ZERO]).is_some());
        // All in a plane, and on a line.
        let plane: Vec<DVec3> = lattice(20, 0.0)
            .into_iter()
            .map(|p| p.with_z(0.0))
            .collect();
        assert!(neighbour_volumes(&plane).unwrap().iter().all(|v| *v > 0.0));
        let line: Vec<DVec3> = (0..5000).map(|i| DVec3::X * f64::from(i)).collect();
        assert!(neighbour_volumes(&line).unwrap().iter().all(|v| *v > 0.0));
    }
}
