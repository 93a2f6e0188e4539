//! Numbers as shaders have them.

/// The words of a number of f64, the low one first.
pub(super) fn words(x: f64) -> [u32; 2] {
    let bits = x.to_bits();
    [bits as u32, (bits >> 32) as u32]
}

/// The columns of a rotation as a uniform `mat3x3<f32>` holds them: four words each.
pub(super) fn rotation_uniform(rotation: [[f32; 3]; 3]) -> [[f32; 4]; 3] {
    rotation.map(|[x, y, z]| [x, y, z, 0.0])
}
