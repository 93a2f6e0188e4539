// Reads surfels: offset from the block's origin and two tangents, nine words each. Twin: `BlockShapes` in
// src/cpu/project/shapes.rs.

@group(0) @binding(0) var<storage, read> blocks: array<DeviceBlock>;
@group(0) @binding(1) var<storage, read> shapes: array<array<f32, 9>>;

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
    let i = particle_index(block, local);
    return vec3<f32>(shapes[i][0], shapes[i][1], shapes[i][2]);
}

// Factor of the variance, camera space: rank two.
fn camera_factor(rotation: mat3x3<f32>, block: u32, local: u32) -> Factor {
    let i = particle_index(block, local);
    let a = times(rotation, vec3<f32>(shapes[i][3], shapes[i][4], shapes[i][5]));
    let b = times(rotation, vec3<f32>(shapes[i][6], shapes[i][7], shapes[i][8]));
    return Factor(
        vec3<f32>(a.x, b.x, 0.0),
        vec3<f32>(a.y, b.y, 0.0),
        vec3<f32>(a.z, b.z, 0.0),
    );
}

// Returns the axis of a piece in the frame of the factor's columns: it turns with the kernel.
fn piece_axis(rotation: mat3x3<f32>, axis: vec3<f32>) -> vec3<f32> {
    return axis;
}

// No plane cuts a surfel.
fn edge_of(block: u32, local: u32, k: u32) -> vec4<f32> {
    return vec4<f32>(0.0, 0.0, 0.0, infinity());
}
