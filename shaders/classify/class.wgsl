// Computes a particle's mass, from the transfer function and its strength, and its colour.

override COLOUR: u32 = COLOUR_CLASSIFIED;
// For merged points: whether each strength is followed by the depth of its members.
override HAS_MEMBER_DEPTHS: bool = false;

@group(0) @binding(7) var<storage, read> transfer: TransferTable;
@group(0) @binding(8) var<storage, read> colours: array<f32>;

fn cell_volume(cell: vec3<u32>) -> f32 {
    let y = bricks.dims.x + cell.y;
    let z = bricks.dims.x + bricks.dims.y + cell.z;
    return strengths[cell.x] * strengths[y] * strengths[z];
}

// Computes particle `index`; for a lattice, its cell.
fn weighed(index: u32, cell: vec3<u32>) -> Visit {
    var particle = Visit(index, 0.0, vec4<f32>(0.0));
    if VALUES != VALUES_NONE {
        particle.class_of_value = class_at(particle.index);
    }
    if STRENGTH == STRENGTH_GIVEN {
        particle.mass = as_cluster(strength_at(particle.index), particle.index);
        return particle;
    }
    // Most cells of most volumes are rejected here.
    if !is_positive(particle.class_of_value.w) {
        return particle;
    }
    var volume = 0.0;
    if STRENGTH == STRENGTH_CELL {
        volume = strengths[0];
    } else if STRENGTH == STRENGTH_WIDTHS {
        volume = cell_volume(cell);
    } else {
        volume = strength_at(particle.index);
    }
    particle.mass = as_cluster(particle.class_of_value.w * volume, particle.index);
    return particle;
}

// Applies the transfer function to value i; for merged particles, to the interval of their values.
fn class_at(i: u32) -> vec4<f32> {
    if VALUES == VALUES_SPREAD {
        let mean = bitcast<f32>(values[2u * i]);
        let spread = bitcast<f32>(values[2u * i + 1u]);
        return classify_spread(mean, spread, STRENGTH == STRENGTH_GIVEN);
    }
    return classify(value_at(i));
}

fn strength_at(i: u32) -> f32 {
    return strengths[select(i, 2u * i, HAS_MEMBER_DEPTHS)];
}

// If members do not overlap, each is less opaque than their mean depth implies.
fn as_cluster(mass: f32, i: u32) -> f32 {
    if HAS_MEMBER_DEPTHS {
        return mass * ein_share(mass * strengths[2u * i + 1u]);
    }
    return mass;
}

fn carried_by(particle: Visit) -> array<f32, 3> {
    if COLOUR == COLOUR_CLASSIFIED {
        return triple(particle.class_of_value.xyz);
    }
    if COLOUR == COLOUR_PER_PARTICLE {
        let i = 3u * particle.index;
        return array<f32, 3>(colours[i], colours[i + 1u], colours[i + 2u]);
    }
    if COLOUR == COLOUR_UNIFORM {
        return array<f32, 3>(colours[0], colours[1], colours[2]);
    }
    // shade.wgsl computes these.
    return array<f32, 3>(0.0, 0.0, 0.0);
}
