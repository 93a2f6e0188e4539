// Computes the amplitude of a particle for column densities: value x volume, or the mass. It uses no
// transfer function. It works in f64, as the twin does: an amplitude is a product of numbers that each
// fit f32; the product may not. Twin: src/cpu/amplitude.rs.

struct AmplitudeUniform {
    // Mass per unit of amplitude, f64.
    scale: vec2<u32>,
    // The volume that all cells of a lattice share, f64.
    cell_volume: vec2<u32>,
}

@group(0) @binding(7) var<uniform> amplitudes: AmplitudeUniform;

// Computes particle `index`; for a lattice, its cell. The mass is the amplitude's magnitude, relative to
// the largest of the scene, and the carried number is its sign.
fn weighed(index: u32, cell: vec3<u32>) -> Visit {
    var particle = Visit(index, 0.0, vec4<f32>(0.0));
    var amplitude: vec2<u32>;
    if STRENGTH == STRENGTH_GIVEN {
        amplitude = f64_from_f32(strengths[index]);
    } else {
        amplitude = f64_mul(f64_from_f32(value_at(index)), volume_of(index, cell));
    }
    let scaled = f64_to_f32(f64_mul(amplitude, amplitudes.scale));
    if is_finite(scaled) {
        particle.mass = abs(scaled);
        let is_negative = bitcast<u32>(scaled) >= 0x80000000u;
        particle.class_of_value.x = select(1.0, -1.0, is_negative);
    }
    return particle;
}

fn volume_of(index: u32, cell: vec3<u32>) -> vec2<u32> {
    if STRENGTH == STRENGTH_CELL {
        return amplitudes.cell_volume;
    }
    if STRENGTH == STRENGTH_WIDTHS {
        let x = f64_from_f32(strengths[cell.x]);
        let y = f64_from_f32(strengths[bricks.dims.x + cell.y]);
        let z = f64_from_f32(strengths[bricks.dims.x + bricks.dims.y + cell.z]);
        return f64_mul(f64_mul(x, y), z);
    }
    return f64_from_f32(strengths[index]);
}

fn carried_by(particle: Visit) -> array<f32, 3> {
    return array<f32, 3>(particle.class_of_value.x, 0.0, 0.0);
}
