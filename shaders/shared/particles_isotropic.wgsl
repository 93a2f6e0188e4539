// Spheres: offset from the block's origin and standard deviation, four words each.
// Twin: `BlockShapes` in src/cpu/project.rs.

@group(0) @binding(0) var<storage, read> blocks: array<DeviceBlock>;
@group(0) @binding(1) var<storage, read> shapes: array<vec4<f32>>;

// Place among entries of one per particle.
fn particle_index(block: u32, local: u32) -> u32 {
    return blocks[block].first + local;
}

// The most of a block's kernels that lie in one place, as a multiple of OVERLAP; 1 at least.
fn crowding_of(block: u32) -> f32 {
    return blocks[block].crowding;
}

// Offset from the block's origin, world units.
fn world_offset(block: u32, local: u32) -> vec3<f32> {
    return shapes[particle_index(block, local)].xyz;
}

// Factor of the variance, camera space: a sphere's is the same however the camera turns.
fn camera_factor(rotation: mat3x3<f32>, block: u32, local: u32) -> Factor {
    return sphere(shapes[particle_index(block, local)].w);
}

// The axis of a piece in the frame of the factor's columns, which a sphere has along the camera's axes.
fn piece_axis(rotation: mat3x3<f32>, axis: vec3<f32>) -> vec3<f32> {
    return times(rotation, axis);
}

// No plane cuts it.
fn edge_of(block: u32, local: u32, k: u32) -> vec4<f32> {
    return vec4<f32>(0.0, 0.0, 0.0, bitcast<f32>(INFINITE_WORD));
}
