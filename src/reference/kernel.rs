//! Computes particles in f64 and their integrals along a ray.

use glam::{DMat3, DVec3};

use super::piece::FieldOf;
use super::settings::PixelFilter;
use super::sight::between;
use crate::constants::MOST_EDGES;
use crate::math::normal_of_code;
use crate::scene::{Boundary, Classification, Colour, Particles, PointVolume, Strength};
use crate::view::{Camera, Projection};

/// Cut-off of a kernel, in standard deviations: e^(-49/2) = 2e-11 of its peak.
pub(super) const REACH: f64 = 7.0;

/// A visible particle, world units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Particle {
    pub(super) position: DVec3,
    /// L with V = L Lᵀ.
    factor: DMat3,
    /// Mass; for a surface its area, or the area times the optical depth.
    mass: f64,
    pub(super) colour: [f64; 3],
    pub(super) plane: Option<Plane>,
    /// Stored unit normal, or zero.
    pub(super) normal: DVec3,
    /// Boundary planes n . x + d >= 0 that cut the particle; unused ones have a zero normal.
    edges: [(DVec3, f64); MOST_EDGES],
}

/// A surfel of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    /// Unit normal of the front.
    pub(super) normal: DVec3,
    /// The greater standard deviation.
    widest: f64,
    is_one_sided: bool,
    /// True for an opaque surfel, which covers; a translucent one absorbs.
    pub(super) is_opaque: bool,
}

impl Plane {
    /// Returns `None` if the two tangents do not span a plane.
    fn new(tangents: &DMat3, is_one_sided: bool, is_opaque: bool) -> Option<Self> {
        let (a, b) = (tangents.x_axis, tangents.y_axis);
        let normal = a.cross(b).try_normalize()?;
        let (aa, bb, ab) = (a.length_squared(), b.length_squared(), a.dot(b));
        let widest = (0.5 * (aa + bb) + (0.5 * (aa - bb)).hypot(ab)).sqrt();
        Some(Self {
            normal,
            widest,
            is_one_sided,
            is_opaque,
        })
    }
}

/// A kernel in camera space, prepared for line integrals.
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
    /// Plane of a surfel, whose depth or weight is the same from every side.
    pub(super) plane: Option<Plane>,
    /// Boundary planes that cut the kernel.
    edges: [(DVec3, f64); MOST_EDGES],
}

/// A kernel along one ray: the optical depth tau, distributed as a Gaussian of mean and standard deviation in
/// arc length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    pub(super) tau: f64,
    pub(super) mean: f64,
    pub(super) sigma: f64,
    pub(super) colour: [f64; 3],
    /// Parameters at which the ray enters and leaves the kernel's domain; infinite if nothing cuts it.
    pub(super) domain: [f64; 2],
}

/// Returns the particles of a scene that have a mass or an area and finite numbers. Kernels that are classified
/// over their extents give one particle per piece.
pub(super) fn particles(scene: &[PointVolume], classification: Classification) -> Vec<Particle> {
    let mut out = Vec::new();
    for volume in scene {
        let faces = faces(volume);
        let bounded = volume.boundary.is_some();
        let with_ghosts = bounded.then(|| volume.clone().with_ghosts());
        let volume = with_ghosts.as_ref().unwrap_or(volume);
        let field = match classification {
            Classification::Extent | Classification::Slab => FieldOf::new(volume),
            Classification::Particle => None,
        };
        let classes = volume
            .values
            .as_ref()
            .zip(volume.transfer_function.as_ref());
        let surface = match volume.strength {
            Strength::Surface(_) => Some(true),
            Strength::Translucent(_) => Some(false),
            _ => None,
        };
        let is_one_sided = matches!(
            volume.particles,
            Particles::Surfels {
                is_one_sided: true,
                ..
            }
        );
        let class = |i: usize| classes.map_or([0.0; 4], |(v, t)| t.classify(v.get(i)));
        let colour_of = |i: usize, class: [f32; 3]| match &volume.colour {
            Colour::Classified => class,
            Colour::PerParticle(colours) => colours[i],
            Colour::Uniform(colour) => *colour,
            Colour::Harmonics { .. } => [0.0; 3],
        };
        let normal_of = |i: usize| {
            let codes = volume.normals.as_ref();
            codes.map_or(DVec3::ZERO, |codes| normal_of_code(codes[i]).as_dvec3())
        };
        for i in 0..volume.particles.len() {
            let (position, factor, cell_volume) = volume.particles.shape(i);
            if let (Some(field), Strength::Classified { volumes }) = (&field, &volume.strength) {
                let cell = volumes.get(i).map_or(cell_volume, |&v| f64::from(v));
                // The particle's own planes cut all its pieces.
                let edges = edges(volume, &faces, i, position);
                field.pieces(i, |piece| {
                    let colour = colour_of(i, piece.colour);
                    let (position, factor) = piece.of(position, factor);
                    let mass = piece.extinction * cell;
                    if mass > 0.0 && mass.is_finite() && position.is_finite() && factor.is_finite()
                    {
                        out.push(Particle {
                            position,
                            factor,
                            mass,
                            colour: colour.map(f64::from),
                            plane: None,
                            normal: normal_of(i),
                            edges,
                        });
                    }
                });
                continue;
            }
            let [r, g, b, extinction] = class(i);
            let mass = match &volume.strength {
                Strength::Classified { volumes } => {
                    f64::from(extinction) * volumes.get(i).map_or(cell_volume, |&v| f64::from(v))
                }
                Strength::Mass(masses)
                | Strength::Surface(masses)
                | Strength::Translucent(masses) => f64::from(masses[i]),
                // `Integrator::new` refuses these.
                Strength::PeakOpacity { .. } => 0.0,
            };
            let colour = colour_of(i, [r, g, b]);
            let is_finite = position.is_finite()
                && factor.is_finite()
                && mass.is_finite()
                && colour.iter().all(|c| c.is_finite());
            let plane = surface.and_then(|is_opaque| Plane::new(&factor, is_one_sided, is_opaque));
            if mass > 0.0 && is_finite && plane.is_some() == surface.is_some() {
                let colour = colour.map(f64::from);
                out.push(Particle {
                    position,
                    factor,
                    mass,
                    colour,
                    plane,
                    normal: normal_of(i),
                    edges: edges(volume, &faces, i, position),
                });
            }
        }
    }
    out
}

/// Marks an unused plane.
const NO_EDGE: (DVec3, f64) = (DVec3::ZERO, 0.0);

/// Returns the faces of the box of a lattice's samples: unit normals into it, and a point of each.
fn faces(volume: &PointVolume) -> Vec<(DVec3, DVec3)> {
    let (Some(Boundary::Lattice), Particles::Lattice { lattice, .. }) =
        (&volume.boundary, &volume.particles)
    else {
        return Vec::new();
    };
    let step = lattice.step([0; 3]);
    let last = lattice.dims.map(|n| n.saturating_sub(1));
    let ends = [lattice.position([0; 3]), lattice.position(last)];
    (0..3)
        .filter(|&a| lattice.dims[a] > 1)
        .flat_map(|a| {
            let across = step.col((a + 1) % 3).cross(step.col((a + 2) % 3));
            let normal = across.normalize_or_zero() * step.col(a).dot(across).signum();
            [(normal, ends[0]), (-normal, ends[1])]
        })
        .collect()
}

/// Returns the planes that cut a particle, and the particle's distance inside each.
fn edges(
    volume: &PointVolume,
    faces: &[(DVec3, DVec3)],
    i: usize,
    position: DVec3,
) -> [(DVec3, f64); MOST_EDGES] {
    let mut out = [NO_EDGE; MOST_EDGES];
    if let Some(Boundary::Planes(planes)) = &volume.boundary {
        let own = planes.of(i).into_iter().flatten();
        let own = own.filter(|edge| edge[3] < f32::INFINITY);
        for (out, &[x, y, z, inside]) in out.iter_mut().zip(own) {
            let normal = DVec3::new(x.into(), y.into(), z.into());
            *out = (normal, inside.into());
        }
    }
    for (out, (normal, point)) in out.iter_mut().zip(faces) {
        *out = (*normal, normal.dot(position - *point));
    }
    out
}

impl Kernel {
    /// Returns a particle as `camera` sees it.
    ///
    /// [`PixelFilter::Kernels`] adds the low-pass filter to the variance, parallel to the screen: Ve = V + u2²
    /// diag(h²/fx², h²/fy², 0). Near the camera plane the kernel's own extent replaces u2.
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
            plane: particle.plane.map(|plane| Plane {
                normal: camera.camera_from_world * plane.normal,
                ..plane
            }),
            edges: particle.edges.map(|(normal, inside)| {
                // Relative to the eye.
                let normal = camera.camera_from_world * normal;
                (normal, inside - normal.dot(centre))
            }),
        }
    }

    /// Returns true if `camera` sees a one-sided surfel from behind: then all rays that meet its plane do.
    pub(super) fn is_turned_away(&self, camera: &Camera) -> bool {
        let towards = match camera.projection {
            Projection::Perspective => self.centre,
            Projection::Orthographic => DVec3::Z,
        };
        let is_behind = |plane: &Plane| plane.is_one_sided && plane.normal.dot(towards) > 0.0;
        self.plane.as_ref().is_some_and(is_behind)
    }

    /// Returns the greatest distance along a ray between this fragment and others of the same surface.
    pub(super) fn gap(&self, direction: DVec3, segment: &Segment) -> f64 {
        let across = |plane: &Plane| plane.widest / plane.normal.dot(direction).abs();
        self.plane.as_ref().map_or(0.0, across) + segment.sigma
    }

    /// Returns half the size of the box around the kernel's [`REACH`], camera space.
    pub(super) fn half_extent(&self) -> DVec3 {
        let f = self.factor.transpose();
        DVec3::new(f.x_axis.length(), f.y_axis.length(), f.z_axis.length()) * REACH
    }

    /// Returns the kernel along the ray `origin` + t `direction` (unit length), t > 0. Returns `None` beyond
    /// its reach, behind the origin, and for a rod or a point, which have no line integral (almost no ray meets
    /// them).
    ///
    /// With c = u x D: Q = |Lᵀ c|² / |adj(L) D|², tau = g/(2 pi |adj(L) D|) e^(-Q/2), mean = (adj(L) u . adj(L)
    /// D)/|adj(L) D|², sigma = det L/|adj(L) D|. These are sums of squares, so that a needle costs the digits
    /// of its axis ratio once and not twice.
    ///
    /// For a surface g is multiplied by |n . D|. |adj(L) D| is its ellipse's area over pi times that, so tau
    /// becomes g G(x) at the place x where the ray meets the plane. The `tau` of an opaque surfel is its
    /// weight.
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
        let facing = |plane: &Plane| plane.normal.dot(direction).abs();
        let mass = self.mass * self.plane.as_ref().map_or(1.0, facing);
        let tau = mass / (std::f64::consts::TAU * scale) * (-0.5 * miss2 / across2).exp();
        (tau > 0.0).then_some(Segment {
            tau,
            mean,
            sigma,
            colour: self.colour,
            domain: self.domain(origin, direction),
        })
    }

    /// Returns the distances between which a ray lies inside the planes that cut the kernel.
    fn domain(&self, origin: DVec3, direction: DVec3) -> [f64; 2] {
        let [from, to] = between(&self.edges, origin, direction, f64::NEG_INFINITY);
        [from, to.max(from)]
    }
}

/// Returns the lower-triangular factor of the same variance: Givens rotations of the columns.
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
