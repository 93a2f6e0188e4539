// Ellipsoids: offset from the block's origin and lower-triangular factor, nine words each.
// Twin: `BlockShapes` in src/cpu/project.rs.

@group(0) @binding(0) var<storage, read> blocks: array<DeviceBlock>;
@group(0) @binding(1) var<storage, read> shapes: array<array<f32, 9>>;

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
    let i = particle_index(block, local);
    return vec3<f32>(shapes[i][0], shapes[i][1], shapes[i][2]);
}

// Factor of the variance, camera space.
fn camera_factor(rotation: mat3x3<f32>, block: u32, local: u32) -> Factor {
    let i = particle_index(block, local);
    var lower: array<f32, 6>;
    for (var k = 0; k < 6; k = k + 1) {
        lower[k] = shapes[i][3 + k];
    }
    return rotated(rotation, lower);
}
