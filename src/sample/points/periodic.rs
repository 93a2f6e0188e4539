//! Wraps particles of a periodic box: moves them into the box, and adds images of kernels that cross its faces.

use glam::DVec3;

use crate::error::{Error, Result};
use crate::sample::positions::index_u32;
use crate::sample::sampled::Sampled;
use crate::scene::Particles;
use crate::view::ClipPlane;

/// Reach of a kernel along an axis, in its standard deviations there; 3.4e-6 of it lies beyond on one side.
const REACH: f64 = 4.5;

/// A box that repeats itself along all three axes \[world units\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeriodicBox {
    /// Edges; above 0.
    pub size: DVec3,
    /// The point in the middle of the picture of the box.
    pub centre: DVec3,
}

impl PeriodicBox {
    /// Returns the box whose least corner is the origin, as simulations have it.
    pub fn from_origin(size: DVec3) -> Self {
        let centre = size / 2.0;
        Self { size, centre }
    }

    /// Returns the least and the greatest corner of the box about its centre.
    pub fn corners(&self) -> [DVec3; 2] {
        [self.centre - self.size / 2.0, self.centre + self.size / 2.0]
    }

    /// Returns the planes at its faces: inside is the box about its centre.
    pub fn planes(&self) -> [ClipPlane; 6] {
        let [lower, upper] = self.corners();
        ClipPlane::of_box(lower, upper)
    }

    /// Checks that the box has a volume.
    ///
    /// # Errors
    /// An edge that is not above 0, or a number that is not finite.
    pub(in crate::sample) fn check(&self) -> Result<()> {
        let is_box = self.size.min_element() > 0.0
            && self.size.is_finite()
            && self.corners().iter().all(|corner| corner.is_finite());
        match is_box {
            true => Ok(()),
            false => Err(Error::invalid(
                "periodic box",
                "edges and centre",
                "finite numbers, and edges above 0",
                format!("{} and {}", self.size, self.centre),
                "correct it",
            )),
        }
    }

    /// Moves a position into the box, by whole edges. A position that is not finite stays as it is.
    fn wrapped(&self, position: DVec3) -> DVec3 {
        let [low, high] = self.corners();
        let turns = ((position - low) / self.size).floor();
        let moved = position - turns * self.size;
        // Rounding may leave it a little outside.
        match moved.is_finite() {
            true => moved.clamp(low, high),
            false => position,
        }
    }

    /// Returns the shifts, other than none, at which the image of a kernel reaches into the box.
    ///
    /// - `reach`: along each axis, less than the edges.
    fn shifts(&self, position: DVec3, reach: DVec3) -> impl Iterator<Item = DVec3> {
        let [low, high] = self.corners();
        let crosses = [
            (position - reach).cmplt(low),
            (position + reach).cmpgt(high),
        ];
        let of_axis = move |a: usize| {
            let beyond = crosses.map(|side| side.test(a));
            [(true, 0.0), (beyond[0], 1.0), (beyond[1], -1.0)]
                .into_iter()
                .filter_map(|(is_there, turn)| is_there.then_some(turn))
        };
        let size = self.size;
        let all = of_axis(0).flat_map(move |x| {
            of_axis(1).flat_map(move |y| of_axis(2).map(move |z| DVec3::new(x, y, z)))
        });
        all.filter(|turns| *turns != DVec3::ZERO)
            .map(move |turns| turns * size)
    }
}

/// Moves positions into a periodic box.
pub(in crate::sample) fn wrap(positions: &mut [DVec3], periodic: &PeriodicBox) {
    for position in positions {
        *position = periodic.wrapped(*position);
    }
}

/// Adds an image of each particle for each way in which its kernel crosses faces of a periodic box. Images are ghosts,
/// behind the particles.
///
/// # Errors
/// Kernels that reach farther than an edge of the box; more particles than can be counted.
pub(in crate::sample) fn add_images(sampled: &mut Sampled, periodic: &PeriodicBox) -> Result<()> {
    let Sampled { volume, report } = sampled;
    let count = volume.particles.len();
    let mut sources: Vec<u32> = (0..count).map(index_u32).collect();
    let mut shifts = Vec::new();
    for i in 0..count {
        let (position, factor, _) = volume.particles.shape(i);
        let reach = REACH * DVec3::from([0, 1, 2].map(|a| factor.row(a).length()));
        if reach.cmpge(periodic.size).any() {
            return Err(Error::invalid(
                "periodic box",
                "kernels",
                "kernels that reach less than an edge of the box",
                format!("one that reaches {} in a box of {}", reach, periodic.size),
                "check the unit of the box and of the lengths",
            ));
        }
        for shift in periodic.shifts(position, reach) {
            sources.push(index_u32(i));
            shifts.push(shift);
        }
    }
    if shifts.is_empty() {
        return Ok(());
    }
    if u32::try_from(sources.len()).is_err() {
        return Err(Error::invalid(
            "periodic box",
            "particles",
            "at most 4,294,967,295 with their images",
            sources.len().to_string(),
            "render a part of the data",
        ));
    }
    volume.gather(&sources);
    let positions = match &mut volume.particles {
        Particles::Isotropic { positions, .. }
        | Particles::Anisotropic { positions, .. }
        | Particles::Surfels { positions, .. } => positions,
        Particles::Lattice { .. } => return Ok(()),
    };
    for (position, shift) in positions[count..].iter_mut().zip(&shifts) {
        *position += *shift;
    }
    report.particle_count = positions.len();
    report.ghost_count += shifts.len();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_moved_by_whole_edges_and_images_lie_at_every_face_that_is_crossed() {
        let periodic = PeriodicBox {
            size: DVec3::new(1.0, 2.0, 4.0),
            centre: DVec3::new(10.0, 0.0, 0.0),
        };
        let mut positions = [
            DVec3::new(0.2, 3.1, -9.0),
            DVec3::new(10.5, -1.0, 2.0),
            DVec3::NAN,
        ];
        wrap(&mut positions, &periodic);
        let moved = positions[0] - DVec3::new(10.2, -0.9, -1.0);
        assert!(moved.length() < 1e-12, "{}", positions[0]);
        let [low, high] = periodic.corners();
        assert!(positions[1].cmpge(low).all() && positions[1].cmple(high).all());
        assert!(positions[2].is_nan());
        // Beside an edge of the box: two faces and what lies across both.
        let at = DVec3::new(9.55, 0.95, 0.0);
        let mut found: Vec<[f64; 3]> = periodic
            .shifts(at, DVec3::splat(0.1))
            .map(DVec3::into)
            .collect();
        found.sort_unstable_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(found, [[0.0, -2.0, 0.0], [1.0, -2.0, 0.0], [1.0, 0.0, 0.0]]);
        // A kernel as wide as the box has an image on both sides.
        let wide = periodic.shifts(DVec3::new(10.0, 0.0, 0.0), DVec3::new(0.6, 0.1, 0.1));
        assert_eq!(wide.count(), 2);
    }
}
