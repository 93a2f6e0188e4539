// The plane of two tangents. Twin: `unit_normal` in src/splat/surfel.rs.

struct UnitNormal {
    exists: bool,
    normal: vec3<f32>,
}

// Returns the direction of a x b, if it has one.
fn unit_normal(first: vec3<f32>, second: vec3<f32>) -> UnitNormal {
    let normal = cross3(first / largest_of(first), second / largest_of(second));
    let size = length3(normal);
    return UnitNormal(is_above(size, 1e-6), normal / size);
}
