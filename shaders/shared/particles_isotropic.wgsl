// Reads spheres: offset from the block's origin and standard deviation, four words each. Twin:
// `BlockShapes` in src/cpu/project/shapes.rs.

@group(0) @binding(0) var<storage, read> blocks: array<DeviceBlock>;
@group(0) @binding(1) var<storage, read> shapes: array<vec4<f32>>;

// Index in arrays with one entry per particle.
fn particle_index(block: u32, local: u32) -> u32 {
    return blocks[block].first + local;
}

// Greatest number of a block's kernels that overlap at a point, as a multiple of OVERLAP; at least 1.
fn crowding_of(block: u32) -> f32 {
    return blocks[block].crowding;
}

// Offset from the block's origin, world units.
fn world_offset(block: u32, local: u32) -> vec3<f32> {
    return shapes[particle_index(block, local)].xyz;
}

// Factor of the variance, camera space: a sphere's does not depend on the camera's rotation.
fn camera_factor(rotation: mat3x3<f32>, block: u32, local: u32) -> Factor {
    return sphere(shapes[particle_index(block, local)].w);
}

// Returns the axis of a piece in the frame of the factor's columns, which for a sphere are the camera's
// axes.
fn piece_axis(rotation: mat3x3<f32>, axis: vec3<f32>) -> vec3<f32> {
    return times(rotation, axis);
}

// No plane cuts a sphere.
fn edge_of(block: u32, local: u32, k: u32) -> vec4<f32> {
    return vec4<f32>(0.0, 0.0, 0.0, infinity());
}
