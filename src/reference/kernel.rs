//! Particles in f64 and their integrals along a ray.

use glam::{DMat3, DVec3};

use super::PixelFilter;
use crate::scene::{Colour, PointVolume, Strength};
use crate::view::{Camera, Projection};

/// How many standard deviations a kernel reaches: beyond, e^(-49/2) = 2e-11 of its peak.
pub(super) const REACH: f64 = 7.0;

/// A visible particle, world units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Particle {
    pub(super) position: DVec3,
    /// L with V = L Lᵀ.
    pub(super) factor: DMat3,
    pub(super) mass: f64,
    pub(super) colour: [f64; 3],
}

/// A kernel in camera space, with what its line integrals need.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kernel {
    pub(super) centre: DVec3,
    /// L with V = L Lᵀ.
    pub(super) factor: DMat3,
    /// adj(L): the inverse of L times its determinant; exists for every rank.
    adjugate: DMat3,
    determinant: f64,
    pub(super) mass: f64,
    pub(super) colour: [f64; 3],
}

/// A kernel along one ray: optical depth tau, spread as a Gaussian of mean and standard
/// deviation in arc length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    pub(super) tau: f64,
    pub(super) mean: f64,
    pub(super) sigma: f64,
    pub(super) colour: [f64; 3],
}

/// The particles of a scene that have a mass and finite numbers.
pub(super) fn particles(scene: &[PointVolume]) -> Vec<Particle> {
    let mut out = Vec::new();
    for volume in scene {
        let classes = volume
            .values
            .as_ref()
            .zip(volume.transfer_function.as_ref());
        let class = |i: usize| classes.map_or([0.0; 4], |(v, t)| t.classify(v.get(i)));
        for i in 0..volume.particles.len() {
            let class = class(i);
            let (position, factor, cell_volume) = volume.particles.shape(i);
            let mass = match &volume.strength {
                Strength::Classified { volumes } => {
                    f64::from(class[3]) * volumes.get(i).map_or(cell_volume, |&v| f64::from(v))
                }
                Strength::Mass(masses) => f64::from(masses[i]),
                // `Integrator::new` refuses these.
                Strength::PeakOpacity { .. } | Strength::Surface(_) | Strength::Pane(_) => 0.0,
            };
            let colour = match &volume.colour {
                Colour::Classified => [class[0], class[1], class[2]],
                Colour::PerParticle(colours) => colours[i],
                Colour::Uniform(colour) => *colour,
                Colour::Harmonics { .. } => [0.0; 3],
            };
            let is_finite = position.is_finite()
                && factor.is_finite()
                && mass.is_finite()
                && colour.iter().all(|c| c.is_finite());
            if mass > 0.0 && is_finite {
                let colour = colour.map(f64::from);
                out.push(Particle {
                    position,
                    factor,
                    mass,
                    colour,
                });
            }
        }
    }
    out
}

impl Kernel {
    /// A particle as `camera` sees it.
    ///
    /// [`PixelFilter::Kernels`] adds the low-pass filter to the variance, parallel to the screen:
    /// Ve = V + u2² diag(h²/fx², h²/fy², 0), with the kernel's own reach for u2 near the camera
    /// plane.
    pub(super) fn new(particle: &Particle, camera: &Camera, filter: PixelFilter, h2: f64) -> Self {
        let centre = camera.camera_point(particle.position);
        let rotated = camera.camera_from_world * particle.factor;
        let factor = match filter {
            PixelFilter::Image => rotated,
            PixelFilter::Kernels => {
                let distance = match camera.projection {
                    Projection::Perspective => centre.z.abs().max(rotated.row(2).length()),
                    Projection::Orthographic => 1.0,
                };
                let h = camera.focal_px.recip() * (h2.sqrt() * distance);
                lower_factor([
                    rotated.x_axis,
                    rotated.y_axis,
                    rotated.z_axis,
                    DVec3::X * h.x,
                    DVec3::Y * h.y,
                ])
            }
        };
        let (x, y, z) = (factor.x_axis, factor.y_axis, factor.z_axis);
        let adjugate = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)).transpose();
        Self {
            centre,
            factor,
            adjugate,
            determinant: x.dot(y.cross(z)).abs(),
            mass: particle.mass,
            colour: particle.colour,
        }
    }

    /// Half the size of the box around the kernel's [`REACH`], camera space.
    pub(super) fn half_extent(&self) -> DVec3 {
        let f = self.factor.transpose();
        DVec3::new(f.x_axis.length(), f.y_axis.length(), f.z_axis.length()) * REACH
    }

    /// The kernel along the ray `origin` + t `direction` (unit length), t > 0; `None` beyond its
    /// reach, behind the origin, and where it has no line integral (a rod or a point, which
    /// almost no ray meets).
    ///
    /// With c = u x D: Q = |Lᵀ c|² / |adj(L) D|², tau = g/(2 pi |adj(L) D|) e^(-Q/2),
    /// mean = (adj(L) u . adj(L) D)/|adj(L) D|², sigma = det L/|adj(L) D|. Sums of squares, so
    /// that a needle costs the axis ratio once and not twice.
    #[inline]
    pub(super) fn along(&self, origin: DVec3, direction: DVec3) -> Option<Segment> {
        let u = self.centre - origin;
        let across = self.adjugate * direction;
        let across2 = across.length_squared();
        let miss2 = (self.factor.transpose() * u.cross(direction)).length_squared();
        // Phrased so that 0/0 is a miss.
        if !(miss2 <= REACH * REACH * across2) || across2 == 0.0 {
            return None;
        }
        let scale = across2.sqrt();
        let mean = (self.adjugate * u).dot(across) / across2;
        let sigma = self.determinant / scale;
        if mean + REACH * sigma < 0.0 {
            return None;
        }
        let tau = self.mass / (std::f64::consts::TAU * scale) * (-0.5 * miss2 / across2).exp();
        (tau > 0.0).then_some(Segment {
            tau,
            mean,
            sigma,
            colour: self.colour,
        })
    }
}

/// The lower-triangular factor of the same variance: Givens rotations of the columns.
fn lower_factor(mut columns: [DVec3; 5]) -> DMat3 {
    for row in 0..3 {
        for i in row + 1..columns.len() {
            let (a, b) = (columns[row], columns[i]);
            let length = a[row].hypot(b[row]);
            if b[row] != 0.0 {
                let (cos, sin) = (a[row] / length, b[row] / length);
                columns[row] = a * cos + b * sin;
                columns[i] = b * cos - a * sin;
                columns[i][row] = 0.0;
            }
        }
    }
    let [x, y, z, ..] = columns;
    DMat3::from_cols(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lower_factor_keeps_the_variance() {
        let columns = [
            DVec3::new(0.3, -0.2, 0.9),
            DVec3::new(0.0, 1e-3, 2.0),
            DVec3::new(-1.0, 0.5, 0.1),
            DVec3::X * 0.01,
            DVec3::Y * 0.02,
        ];
        let f = lower_factor(columns);
        let [xy, xz, yz] = [f.y_axis.x, f.z_axis.x, f.z_axis.y];
        assert!(xy.abs().max(xz.abs()).max(yz.abs()) < 1e-16);
        let variance = f * f.transpose();
        for i in 0..3 {
            for j in 0..3 {
                let truth: f64 = columns.iter().map(|c| c[i] * c[j]).sum();
                assert!((variance.col(i)[j] - truth).abs() < 1e-15);
            }
        }
    }
}
