//! Defines factors of variance matrices: V = F Fᵀ. A variance itself is never formed: squared axis ratios do
//! not survive f32 (beyond about 1:4000 nothing is left of the short axis).
//!
//! Twin: `shaders/shared/factor.wgsl`.

use glam::{Mat3, Vec3};

/// A factor F of a variance V = F Fᵀ, by rows: element (i, j) of V is `row(i) . row(j)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Factor {
    /// First row: its length is the standard deviation along x.
    pub x: Vec3,
    /// Second row.
    pub y: Vec3,
    /// Third row.
    pub z: Vec3,
}

impl Factor {
    /// Makes a factor of a matrix F.
    #[inline]
    pub fn from_matrix(m: Mat3) -> Self {
        Self {
            x: m.row(0),
            y: m.row(1),
            z: m.row(2),
        }
    }

    /// Returns the factor of a sphere of standard deviation `sigma`.
    #[inline]
    pub fn sphere(sigma: f32) -> Self {
        Self {
            x: Vec3::X * sigma,
            y: Vec3::Y * sigma,
            z: Vec3::Z * sigma,
        }
    }

    /// Returns `rotation` times the lower-triangular factor (l00, l10, l11, l20, l21, l22).
    #[inline]
    pub fn rotated(rotation: &Mat3, lower: &[f32; 6]) -> Self {
        let [l00, l10, l11, l20, l21, l22] = *lower;
        let columns = Mat3::from_cols(
            *rotation * Vec3::new(l00, l10, l20),
            rotation.y_axis * l11 + rotation.z_axis * l21,
            rotation.z_axis * l22,
        );
        Self::from_matrix(columns)
    }

    /// Returns `rotation` times the two tangents of a surfel (x, y, z of the first, then of the second). The
    /// factor has rank two; its third column is zero.
    #[inline]
    pub fn of_tangents(rotation: &Mat3, tangents: &[f32; 6]) -> Self {
        let [ax, ay, az, bx, by, bz] = *tangents;
        Self::from_matrix(Mat3::from_cols(
            *rotation * Vec3::new(ax, ay, az),
            *rotation * Vec3::new(bx, by, bz),
            Vec3::ZERO,
        ))
    }

    /// Returns the three columns of F.
    #[inline]
    pub fn columns(&self) -> [Vec3; 3] {
        let [x, y, z] = [self.x, self.y, self.z];
        [
            Vec3::new(x.x, y.x, z.x),
            Vec3::new(x.y, y.y, z.y),
            Vec3::new(x.z, y.z, z.z),
        ]
    }
}
