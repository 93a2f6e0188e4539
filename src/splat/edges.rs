//! Cuts kernels at the boundary of their data's domain. Up to three planes cut a kernel; each leaves the
//! share of the kernel that lies inside it along a pixel's ray.
//!
//! Along a ray a kernel is a Gaussian. A plane keeps the part behind the point where the ray enters the
//! domain, or in front of the point where it leaves: Phi of the distance from the plane, in standard
//! deviations. Among planes where the ray enters, the one that cuts away most counts. Among planes where
//! it leaves, the one that keeps least counts. So one distance per ray stands for all planes. If the
//! low-pass filter makes up most of a footprint, it mixes rays, and the planes are independent: their
//! shares are multiplied.
//!
//! - **Affine footprints** follow the joint Gaussian of pixel and distance. With n the plane's normal, s
//!   the distance of the kernel's centre inside, x and y the rows of the footprint's factor in pixels, t
//!   = Lᵀn, S the low-passed variance of the footprint and c = (x . t, y . t), the distance at the offset
//!   d has the mean s + cᵀ S⁻¹ d and the variance t . t - cᵀ S⁻¹ c. So the low-pass filter softens an
//!   edge seen along the plane, as it softens the kernel.
//! - **Exact footprints** are cut where the ray meets the plane. If the low-pass filter blurs them by
//!   more than perspective bends them, they are cut as affine ones are.
//! - Kernels across the plane of the eye are cut where the ray meets the plane.
//!
//! Twin: `shaders/shared/edges.wgsl`.

use glam::{Mat3, Vec2, Vec3};

use super::footprint::{Kernel, ScreenFactor, project_kernel};
use crate::constants::{EDGE_REACH, LEAST_SPREAD, MOST_EDGES};
use crate::record::{NearTerms, PATH_EXACT, PATH_NEAR, RAY_EDGES, ViewUniform};

/// The planes that cut one kernel, camera space.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Edges {
    /// Inward unit normal, and the distance of the kernel's centre inside.
    planes: [(Vec3, f32); MOST_EDGES],
    count: u32,
    is_outside: bool,
}

impl Edges {
    /// Selects the planes that cut a kernel.
    ///
    /// - `moved`: offset of the kernel's centre from the particle's, camera space.
    /// - `planes`: planes of the kernel's particle: unit normal in the world, and distance of the
    ///   particle's centre inside.
    #[inline]
    pub fn of(
        view: &ViewUniform,
        kernel: &Kernel,
        rotation: &Mat3,
        moved: Vec3,
        planes: &[[f32; 4]],
    ) -> Self {
        let deviations = reach_within(view.tolerance);
        let mut edges = Self::default();
        for &[x, y, z, distance] in planes {
            if distance == f32::INFINITY {
                continue;
            }
            let normal = *rotation * Vec3::new(x, y, z);
            let inside = distance + normal.dot(moved);
            let reach = deviations * along(kernel, normal).length();
            if inside <= -reach {
                edges.is_outside = true;
            }
            if inside < reach
                && let Some(plane) = edges.planes.get_mut(edges.count as usize)
            {
                *plane = (normal, inside);
                edges.count += 1;
            }
        }
        edges
    }

    /// Returns whether the whole kernel lies outside.
    #[inline]
    pub fn is_outside(&self) -> bool {
        self.is_outside
    }

    /// Returns whether no plane cuts the kernel.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Writes the planes in the form that a footprint's path reads:
    ///
    /// | path | edge |
    /// |---|---|
    /// | affine, half-line, exact and blurred | distance inside of a pixel's share, standard deviations: change per pixel along x and y, value at the centre; 1 if rays enter, -1 if they leave, 0 if the filter mixes them |
    /// | exact | change of n . D per pixel along x and y, n . D at the centre, distance of the centre inside |
    /// | near | m = n over the distance of the eye from the plane, so that a ray meets it at z = 1/(m . D); 1 if the eye lies inside, -1 outside |
    pub fn write(&self, view: &ViewUniform, kernel: &Kernel, path: u32, terms: &mut NearTerms) {
        let direction = if view.orthographic != 0 {
            Vec3::Z
        } else {
            kernel.centre
        };
        let screen = project_kernel(view, kernel);
        let meets_rays = path == PATH_EXACT && !is_blurred(view, kernel, &screen);
        for (edge, &(normal, inside)) in terms
            .edges
            .iter_mut()
            .zip(&self.planes[..self.count as usize])
        {
            *edge = if path & 3 == PATH_NEAR {
                // Distance of the eye, at the origin.
                let of_eye = inside - normal.dot(kernel.centre);
                let side = if of_eye > 0.0 { 1.0 } else { -1.0 };
                let distance = of_eye.abs().max(f32::MIN_POSITIVE);
                (normal * (-side / distance)).extend(side).into()
            } else if meets_rays {
                let slope = Vec2::new(normal.x, normal.y) / Vec2::from(view.focal_px);
                let across = normal.dot(kernel.centre) / kernel.centre.z;
                [slope.x, slope.y, across, inside]
            } else {
                let h2 = view.low_pass_variance_px2;
                let reach = along(kernel, normal);
                let length = reach.length().max(f32::MIN_POSITIVE);
                let (x, y, t) = (screen.row_x, screen.row_y, reach / length);
                let (m, xt, yt) = (x.cross(y), x.cross(t), y.cross(t));
                let (xx, yy) = (x.length_squared(), y.length_squared());
                let determinant = m.length_squared() + h2 * (xx + yy) + h2 * h2;
                // Minors, not products of squares, which would cancel for long kernels.
                let inverse = 1.0 / determinant.max(f32::MIN_POSITIVE);
                let slope = Vec2::new(h2 * x.dot(t) - m.dot(yt), h2 * y.dot(t) + m.dot(xt));
                let triple = m.dot(t);
                let squares = triple * triple
                    + h2 * (xt.length_squared() + yt.length_squared())
                    + h2 * h2 * t.length_squared();
                let spread = (squares * inverse).sqrt().max(LEAST_SPREAD);
                let slope = slope * (inverse / spread);
                let enters = if 2.0 * h2 > xx + yy {
                    0.0
                } else if normal.dot(direction) > 0.0 {
                    1.0
                } else {
                    -1.0
                };
                [slope.x, slope.y, inside / length / spread, enters]
            };
        }
        terms.edge_count = self.count | if meets_rays { RAY_EDGES } else { 0 };
    }
}

/// Returns the number of standard deviations within which a plane cuts a kernel. At a boundary face an
/// opaque picture ends. Beyond the face, the tails of uncut kernels deeper inside would add up: at three
/// deviations the blunt fin's rim was up to 3.2 levels of 255 too deep, 1.8 in one pixel of a thousand.
/// The value changes in steps, so that both back ends agree.
#[inline]
fn reach_within(tolerance: f32) -> f32 {
    if tolerance >= 1.5e-2 { 3.5 } else { EDGE_REACH }
}

/// Returns whether the low-pass filter's share of a footprint's narrower side exceeds the angle that its
/// kernel fills. The first is the error of an edge that the filter does not soften. The second is the
/// error of an affine footprint's edge.
#[inline]
fn is_blurred(view: &ViewUniform, kernel: &Kernel, screen: &ScreenFactor) -> bool {
    let (x, y) = (screen.row_x, screen.row_y);
    let both = x.length_squared() + y.length_squared();
    // A lower bound of the lesser of two variances with this sum and this product.
    let narrower = x.cross(y).length_squared() / both.max(f32::MIN_POSITIVE);
    let f = &kernel.factor;
    let size = (f.x.length_squared() + f.y.length_squared() + f.z.length_squared()).sqrt();
    let h2 = view.low_pass_variance_px2;
    h2 * kernel.centre.length() > size * (h2 + narrower)
}

/// Returns Lᵀn: the kernel's reach along a normal, by the axes of its factor.
#[inline]
fn along(kernel: &Kernel, normal: Vec3) -> Vec3 {
    let f = &kernel.factor;
    f.x * normal.x + f.y * normal.y + f.z * normal.z
}
