//! Packs unit vectors into whole numbers: octahedral coordinates (Meyer et al. 2010, *On Floating-Point Normal
//! Vectors*) in steps. Twin: `shaders/shared/normal.wgsl`.

use glam::{DVec3, Vec2, Vec3};

/// Number of steps along each axis of the octahedron to which normals are rounded. A packed normal is a whole
/// number of 22 bits, which f32 holds; its direction is within .12 degrees.
pub(crate) const NORMAL_STEPS: f32 = 2047.0;

/// Maps a unit vector to the octahedron unfolded to a square, -1 to 1 along each axis.
#[inline]
pub(crate) fn to_octahedral(normal: Vec3) -> Vec2 {
    let sum = normal.x.abs() + normal.y.abs() + normal.z.abs();
    let (x, y) = (normal.x / sum, normal.y / sum);
    if normal.z < 0.0 {
        let fold = |a: f32, b: f32| (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 };
        Vec2::new(fold(x, y), fold(y, x))
    } else {
        Vec2::new(x, y)
    }
}

/// Returns the unit vector of [`to_octahedral`].
#[inline]
pub(crate) fn from_octahedral(Vec2 { x, y }: Vec2) -> Vec3 {
    let z = 1.0 - x.abs() - y.abs();
    let under = (-z).max(0.0);
    let unfold = |a: f32| if a < 0.0 { a + under } else { a - under };
    Vec3::new(unfold(x), unfold(y), z).normalize_or_zero()
}

/// Packs a unit vector into a whole number below 2²²: its octahedral coordinates in steps.
#[inline]
pub fn pack_normal(normal: Vec3) -> f32 {
    let Vec2 { x, y } = to_octahedral(normal);
    let step = |x: f32| ((0.5 * x + 0.5) * NORMAL_STEPS + 0.5).floor();
    step(x) * (NORMAL_STEPS + 1.0) + step(y)
}

/// Returns the unit vector of [`pack_normal`].
#[inline]
pub fn unpack_normal(packed: f32) -> Vec3 {
    let row = (packed / (NORMAL_STEPS + 1.0)).floor();
    let coordinate = |step: f32| step * (2.0 / NORMAL_STEPS) - 1.0;
    let x = coordinate(row);
    let y = coordinate(packed - row * (NORMAL_STEPS + 1.0));
    from_octahedral(Vec2::new(x, y))
}

/// The [`normal_code`] for no normal.
pub const NO_NORMAL: u32 = 0;

/// Returns a normal as the scene stores it: [`pack_normal`] plus one. Returns [`NO_NORMAL`] if `normal` has no
/// direction (zero, not finite). The length does not matter.
#[inline]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a whole number of 22 bits"
)]
pub fn normal_code(normal: DVec3) -> u32 {
    match normal.try_normalize() {
        Some(unit) => pack_normal(unit.as_vec3()) as u32 + 1,
        None => NO_NORMAL,
    }
}

/// Returns the unit vector of a [`normal_code`]; zero for [`NO_NORMAL`].
#[inline]
pub fn normal_of_code(code: u32) -> Vec3 {
    if code == NO_NORMAL {
        return Vec3::ZERO;
    }
    unpack_normal((code - 1) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_survive_packing() {
        let mut worst = 0.0_f32;
        for i in 0..40_000 {
            let (z, a) = (1.0 - (i as f32 + 0.5) / 20_000.0, 2.399_963 * i as f32);
            let r = (1.0 - z * z).sqrt();
            let normal = Vec3::new(r * a.cos(), r * a.sin(), z);
            let packed = pack_normal(normal);
            assert!(packed.fract() == 0.0 && (0.0..4_194_304.0).contains(&packed));
            worst = worst.max((unpack_normal(packed) - normal).length());
        }
        // Half a step of 2 / 2047 along each axis, sqrt(2) for both, stretched by at most sqrt(3) in the middle
        // of the octahedron's faces.
        assert!(worst < 2.1e-3, "{worst}");
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert!((unpack_normal(pack_normal(axis)) - axis).length() < 2.1e-3);
        }
    }

    #[test]
    fn codes_tell_none_from_every_direction() {
        for none in [DVec3::ZERO, DVec3::NAN, DVec3::X * f64::INFINITY] {
            assert_eq!(normal_code(none), NO_NORMAL);
        }
        assert_eq!(normal_of_code(NO_NORMAL), Vec3::ZERO);
        // The corners of the octahedron's square, among them the code 0 of `pack_normal`.
        for direction in [
            DVec3::NEG_Z,
            DVec3::new(-1e-9, -1e-9, -1.0),
            DVec3::X * 1e-100,
        ] {
            let code = normal_code(direction);
            assert_ne!(code, NO_NORMAL);
            let off = normal_of_code(code).as_dvec3() - direction.normalize();
            assert!(off.length() < 2.1e-3, "{direction}");
        }
    }
}
