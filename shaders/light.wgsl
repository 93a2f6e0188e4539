// Stage: lights the visible particles that have a normal, once per particle. Twin: src/cpu/light.rs.

// Bindings 0 and 1 belong to the particles.
@group(0) @binding(2) var<uniform> lighting: LightingUniform;
// The camera's rotation.
@group(0) @binding(3) var<uniform> rotation: mat3x3<f32>;
@group(0) @binding(4) var<storage, read> state: PartState;
@group(0) @binding(5) var<storage, read> views: array<BlockView>;
@group(0) @binding(6) var<storage, read_write> classified: array<ClassifiedParticle>;
// Codes of normals; surfels may have none.
@group(0) @binding(7) var<storage, read> normals: array<u32>;
// The grids and maps of the lights, if there are shadows.
@group(0) @binding(8) var<storage, read> shadow_words: array<f32>;
@group(0) @binding(9) var<uniform> shadows: ShadowUniform;

// True if lights have shadows.
override HAS_SHADOWS: bool = false;
// True if surfels are of a translucent surface.
override IS_SHEET: bool = false;
// True if particles are pieces of kernels, whose terms follow after all particles.
override HAS_PIECES: bool = false;

// True if particles are surfels. Their normal follows from their tangents, and only light from the eye's
// side falls on them.
override IS_SURFEL: bool = false;

// True if normals are stored. Those of surfels belong to a surface that is smoother than their planes.
override HAS_NORMALS: bool = true;

// Least cosine between a smooth normal and the direction to the eye.
const LEAST_FACING: f32 = 0.01;

// Returns the stored unit normal of a particle, camera space; zero for none.
fn stored_normal(block: u32, local: u32) -> vec3<f32> {
    let code = normals[particle_index(block, local)];
    if code == 0u {
        return vec3<f32>(0.0);
    }
    return times(rotation, unpack_normal(f32(code - 1u)));
}

// Returns the unit normal of a surfel's plane, camera space; zero for none.
fn plane_of(block: u32, local: u32) -> vec3<f32> {
    var c = columns(camera_factor(rotation, block, local));
    let plane_normal = unit_normal(c[0], c[1]);
    if !plane_normal.exists {
        return vec3<f32>(0.0);
    }
    return plane_normal.normal;
}

// Returns the normal by which a surfel of a smooth surface reflects, on the eye's side of the surfel's
// plane.
fn smooth_normal(
    plane: vec3<f32>,
    stored: vec3<f32>,
    to_eye: vec3<f32>,
) -> vec3<f32> {
    var outward = stored;
    if dot3(plane, to_eye) < 0.0 {
        outward = -stored;
    }
    let cosine = dot3(outward, to_eye);
    if all(stored == vec3<f32>(0.0)) || cosine >= LEAST_FACING {
        return outward;
    }
    return unit_or_zero(outward + to_eye * (LEAST_FACING - cosine));
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
    var to_eye = vec3<f32>(0.0, 0.0, -1.0);
    if lighting.orthographic == 0u {
        let offset = times(rotation, world_offset(view.block, particle.local));
        to_eye = -unit_or_zero(vector(view.origin_camera) + offset);
    }
    var normal = vec3<f32>(0.0);
    if HAS_NORMALS {
        normal = stored_normal(view.block, particle.local);
    }
    var plane = vec3<f32>(0.0);
    if IS_SURFEL {
        plane = plane_of(view.block, particle.local);
        if HAS_NORMALS {
            normal = smooth_normal(plane, normal, to_eye);
        } else {
            normal = plane;
        }
    }
    if all(normal == vec3<f32>(0.0)) {
        return;
    }
    var passed = no_shadows();
    if HAS_SHADOWS {
        let block = view.block;
        var at = vector(view.origin_camera)
            + times(rotation, world_offset(block, particle.local));
        if IS_SURFEL {
            for (var i = 0u; i < lighting.count; i = i + 1u) {
                passed[i] = surfel_transmittance(i, at, plane, IS_SHEET);
            }
        } else {
            var factor = camera_factor(rotation, block, particle.local);
            if HAS_PIECES {
                let terms = piece_terms(classified[state.capacity + n]);
                let piece = piece_of(terms, rotation, factor);
                factor = piece.factor;
                at = at + piece.shift;
            }
            for (var i = 0u; i < lighting.count; i = i + 1u) {
                passed[i] = kernel_transmittance(i, at, factor, to_eye);
            }
        }
    }
    let colour = lit(passed, vector(particle.carried), normal, IS_SURFEL, to_eye);
    classified[n].carried = triple(colour);
}
