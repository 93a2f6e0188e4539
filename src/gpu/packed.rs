//! Packs numbers in the layout of shaders.

/// Returns the words of an f64, the low one first.
pub(super) fn words(x: f64) -> [u32; 2] {
    let bits = x.to_bits();
    [bits as u32, (bits >> 32) as u32]
}

/// Returns the columns of a rotation in the layout of a uniform `mat3x3<f32>`: four words each.
pub(super) fn rotation_uniform(rotation: [[f32; 3]; 3]) -> [[f32; 4]; 3] {
    rotation.map(|[x, y, z]| [x, y, z, 0.0])
}
