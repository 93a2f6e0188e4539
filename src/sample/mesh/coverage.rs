//! Measures how evenly surfels cover their surface: the sum of their weights at points of the surface. The sum
//! is 1 if nothing shines through and nothing counts twice.

use glam::{DVec3, Vec3};

use super::grid::Cubes;
use super::pieces::Piece;
use super::surface::Triangle;
use super::surfels::Surfel;
use crate::parallel;

/// Cut-off of kernels, in standard deviations: .03 % of a kernel lies beyond.
const CUTOFF: f64 = 4.0;

/// Returns centres of pieces with their normals, one in each stretch of area `each`.
pub(super) fn points(pieces: &[Piece], triangles: &[Triangle], each: f64) -> Vec<(DVec3, Vec3)> {
    let mut passed = 0.0;
    let mut points = Vec::new();
    for piece in pieces {
        let triangle = &triangles[piece.triangle as usize];
        passed += triangle.area * piece.share();
        if passed > (points.len() as f64 + 0.5) * each {
            points.push((piece.centre, triangle.normal));
        }
    }
    points
}

/// Statistics of sums of weights minus one, over points of a surface.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ripple {
    pub(super) count: usize,
    pub(super) squares: f64,
    pub(super) greatest: f64,
}

impl Ripple {
    /// Measures surfels at points of the surface (with normals); lengths in spacings.
    pub(super) fn of(surfels: &[Surfel], points: &[(DVec3, Vec3)]) -> Self {
        if surfels.is_empty() {
            return Self::default();
        }
        let centres: Vec<DVec3> = surfels.iter().map(|s| s.centre).collect();
        // Kernels of evenly spread cells reach CUTOFF x .6 spacings; few reach farther.
        let (cubes, order) = Cubes::new(&centres, CUTOFF * 0.65);
        let excess = |&(point, normal): &(DVec3, Vec3)| {
            let cube = cubes.at(point)?;
            let near = cubes.around(cube).iter();
            let indices = near.flat_map(|&c| &order[cubes.points(c as usize)]);
            let weight = |&i: &u32| surfels[i as usize].weight_at(point, normal);
            Some(indices.map(weight).sum::<f64>() - 1.0)
        };
        let found: Vec<Option<f64>> = parallel::map(points.len(), |i| excess(&points[i]));
        let mut ripple = Self::default();
        for excess in found.into_iter().flatten() {
            ripple.count += 1;
            ripple.squares += excess * excess;
            ripple.greatest = ripple.greatest.max(excess.abs());
        }
        ripple
    }
}
