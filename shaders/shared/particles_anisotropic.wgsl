// Reads ellipsoids: offset from the block's origin and lower-triangular factor, nine words each. Twin:
// `BlockShapes` in src/cpu/project/shapes.rs.

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

// Factor of the variance, camera space.
fn camera_factor(rotation: mat3x3<f32>, block: u32, local: u32) -> Factor {
    let i = particle_index(block, local);
    var lower: array<f32, 6>;
    for (var k = 0; k < 6; k = k + 1) {
        lower[k] = shapes[i][3 + k];
    }
    return rotated(rotation, lower);
}

// Returns the axis of a piece in the frame of the factor's columns: it turns with the kernel.
fn piece_axis(rotation: mat3x3<f32>, axis: vec3<f32>) -> vec3<f32> {
    return axis;
}

fn shape_word(word: u32) -> f32 {
    return shapes[word / 9u][word % 9u];
}

// Returns plane k that cuts a particle at the boundary of its domain; not finite if there is none. A
// block that the boundary cuts has a word for each particle: 0, or one more than the index of its planes.
// The planes follow these words.
fn edge_of(block: u32, local: u32, k: u32) -> vec4<f32> {
    let own = blocks[block];
    if own.edges != 0u {
        let first = own.edges - 1u;
        let place = u32(shape_word(first + local));
        if place != 0u {
            let at = first + own.count + 4u * (MOST_EDGES * (place - 1u) + k);
            return vec4<f32>(
                shape_word(at),
                shape_word(at + 1u),
                shape_word(at + 2u),
                shape_word(at + 3u),
            );
        }
    }
    return vec4<f32>(0.0, 0.0, 0.0, infinity());
}
