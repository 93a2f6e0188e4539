// Stage: encodes colours for the space in which a picture blends, once per visible particle: linear light
// to sRGB codes. Twin: `encode` of src/cpu/shade.rs.

@group(0) @binding(0) var<storage, read> state: PartState;
@group(0) @binding(1) var<storage, read_write> classified: array<ClassifiedParticle>;

// A negative number is encoded by its magnitude, with its sign.
fn encoded(linear: f32) -> f32 {
    if !is_finite(linear) {
        return linear;
    }
    let code = srgb_from_linear(abs(linear));
    return select(code, -code, linear < 0.0);
}

@compute @workgroup_size(THREADS)
fn encode(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let n = group_index(group) * THREADS + thread;
    if n >= state.classified_count {
        return;
    }
    let colour = classified[n].carried;
    classified[n].carried = array<f32, 3>(encoded(colour[0]), encoded(colour[1]), encoded(colour[2]));
}
