// Stage: light on particles that have a normal, per visible particle, once.
// Twin: src/cpu/light.rs.

// Bindings 0 and 1 are the particles'.
@group(0) @binding(2) var<storage, read> lighting: LightingUniform;
// The camera's rotation.
@group(0) @binding(3) var<uniform> rotation: mat3x3<f32>;
@group(0) @binding(4) var<storage, read> state: PartState;
@group(0) @binding(5) var<storage, read> views: array<BlockView>;
@group(0) @binding(6) var<storage, read_write> classified: array<ClassifiedParticle>;
// Codes of normals; none of surfels.
@group(0) @binding(7) var<storage, read> normals: array<u32>;

// Whether particles are surfels, whose tangents say the normal and which light falls on from the
// eye's side alone.
override IS_SURFEL: bool = false;

// The unit normal of a particle, camera space; zero for none.
fn normal_of(block: u32, local: u32) -> vec3<f32> {
    if IS_SURFEL {
        var c = columns(camera_factor(rotation, block, local));
        let plane_normal = unit_normal(c[0], c[1]);
        if !plane_normal.exists {
            return vec3<f32>(0.0);
        }
        return plane_normal.normal;
    }
    let code = normals[particle_index(block, local)];
    if code == 0u {
        return vec3<f32>(0.0);
    }
    return times(rotation, unpack_normal(f32(code - 1u)));
}

// How much of what falls in at an angle is seen.
fn seen(cosine: f32) -> f32 {
    return select(abs(cosine), max(cosine, 0.0), IS_SURFEL);
}

// x^y for x from 0 to 1, y from 1 up.
fn power(x: f32, y: f32) -> f32 {
    if x <= 0.0 {
        return 0.0;
    }
    return exp2(y * log2(x));
}

fn lit(colour: vec3<f32>, plane_normal: vec3<f32>, to_eye: vec3<f32>) -> vec3<f32> {
    var normal = plane_normal;
    if IS_SURFEL && dot3(normal, to_eye) < 0.0 {
        normal = -normal;
    }
    var reflected = vec3<f32>(lighting.ambient);
    var highlight = vec3<f32>(0.0);
    for (var i = 0u; i < lighting.count; i = i + 1u) {
        let direction = vector(lighting.lights[i].direction);
        let diffuse = seen(dot3(normal, direction));
        // Behind a surface.
        if !(diffuse > 0.0) {
            continue;
        }
        let halfway = unit_or_zero(direction + to_eye);
        let specular = min(seen(dot3(normal, halfway)), 1.0);
        let light = vector(lighting.lights[i].colour);
        reflected = reflected + light * (lighting.diffuse * diffuse);
        highlight = highlight
            + light * (lighting.specular * power(specular, lighting.shininess));
    }
    return colour * reflected + highlight;
}

@compute @workgroup_size(THREADS)
fn light(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let n = group_index(group) * THREADS + thread;
    if n >= state.classified_count {
        return;
    }
    let particle = classified[n];
    let view = views[particle.view];
    let normal = normal_of(view.block, particle.local);
    if all(normal == vec3<f32>(0.0)) {
        return;
    }
    var to_eye = vec3<f32>(0.0, 0.0, -1.0);
    if lighting.orthographic == 0u {
        let offset = times(rotation, world_offset(view.block, particle.local));
        to_eye = -unit_or_zero(vector(view.origin_camera) + offset);
    }
    classified[n].colour = triple(lit(vector(particle.colour), normal, to_eye));
}
