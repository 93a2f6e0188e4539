// Evaluate: a surfel of an opaque surface, its weight and its inverse depth. Its z is not a mean along
// the ray, but the point where the ray meets the surfel's plane. Twin: src/cpu/tile/evaluate/surfel.rs.

// Additional terms of footprints.
alias Terms = SurfelTerms;

// True if any surfel reaches the plane of the eye.
override HAS_NEAR: bool = true;
override HAS_NORMALS: bool = false;
// True if clip planes cut surfels.
override IS_CUT: bool = false;

// True if rays end at depths of the caller's.
override HAS_ENDS: bool = false;

// Inverse depths at which the rays of the band's pixels end: `of_surfels` in src/frame/backdrop.rs.
@group(0) @binding(9) var<storage, read> ray_ends: array<f32>;

var<workgroup> batch_normals: array<vec3<f32>, TERMINATION_INTERVAL>;

fn prepare(n: u32, i: u32) {
    if HAS_NORMALS {
        batch_normals[n] = unpack_normal(terms[i].normal);
    }
}

// The part of a surfel at a pixel.
struct Fragment {
    // False if no part of the surfel is at the pixel.
    exists: bool,
    weight: f32,
    inverse_depth: f32,
    // Greatest difference of inverse depth between surfels that count as one surface.
    slack: f32,
    colour: vec3<f32>,
    normal: vec3<f32>,
}

// A surfel at the point where a pixel's ray meets its plane.
struct Meeting {
    exists: bool,
    q: f32,
    inverse_depth: f32,
    // Change of the inverse depth per pixel.
    gradient: vec2<f32>,
    slack: f32,
    normal: vec3<f32>,
    // The part of the surfel that the pixel shows: F of the twin's `ClipEdges`.
    shown: vec3<f32>,
    shown_at: vec2<f32>,
}

// Evaluates a surfel that reaches the plane of the eye, by its plane.
fn near_meeting(footprint: TileFootprint, ray: TileRay) -> Meeting {
    let at = footprint.path >> 4u;
    let direction = ray_through(view, ray.pixel);
    let a = vector(near.terms[at].misses[0]);
    let b = vector(near.terms[at].misses[1]);
    let plane = vector(near.terms[at].misses[2]);
    let inverse_depth = dot3(direction, plane);
    let along_a = dot3(direction, a) / inverse_depth;
    let along_b = dot3(direction, b) / inverse_depth;
    var meeting: Meeting;
    meeting.exists = !is_nan(inverse_depth) && inverse_depth > 0.0;
    meeting.q = along_a * along_a + along_b * along_b;
    meeting.inverse_depth = inverse_depth;
    meeting.gradient = plane.xy / view.focal_px;
    meeting.slack = near.terms[at].sigma * inverse_depth * inverse_depth;
    if HAS_NORMALS {
        let normal = unit_or_zero(plane);
        meeting.normal = select(normal, -normal, dot3(normal, direction) > 0.0);
    }
    meeting.shown = vec3<f32>(1.0, 0.0, 1.0);
    meeting.shown_at = ray.pixel;
    return meeting;
}

// Evaluates any other surfel: affine, or by the homography of its plane.
fn meeting_of(n: u32, footprint: TileFootprint, ray: TileRay) -> Meeting {
    let of_surfel = batch_terms[n];
    let d = offset_from(footprint.centre_px, ray);
    let z = of_surfel.gradient[0] * d.x + (of_surfel.gradient[1] * d.y + of_surfel.inverse_depth);
    var meeting: Meeting;
    meeting.exists = true;
    meeting.q = form_at(footprint, d);
    meeting.inverse_depth = z;
    meeting.gradient = vec2<f32>(of_surfel.gradient[0], of_surfel.gradient[1]);
    meeting.slack = of_surfel.slack;
    meeting.shown = vec3<f32>(1.0, 0.0, 1.0);
    meeting.shown_at = ray.pixel;
    if of_surfel.homography > 0.0 {
        let root = z * (1.0 / of_surfel.inverse_depth);
        meeting.q = meeting.q / (root * root);
        meeting.exists = !is_nan(root) && root > 0.0;
    } else if IS_CUT {
        let p = footprint.form_p;
        let r = footprint.form_r;
        let inverse = vec3<f32>(
            p.x * p.x + r.x * r.x,
            p.x * p.y + r.x * r.y,
            p.y * p.y + r.y * r.y,
        );
        let shown = meeting.shown - view.low_pass_variance_px2 * inverse;
        meeting.shown = shown;
        meeting.shown_at = footprint.centre_px + vec2<f32>(
            shown.x * d.x + shown.y * d.y,
            shown.y * d.x + shown.z * d.y,
        );
    }
    if HAS_NORMALS {
        meeting.normal = batch_normals[n];
    }
    return meeting;
}

// - `index`: the pixel's, in the band.
fn surfel(n: u32, footprint: TileFootprint, ray: TileRay, index: u32) -> Fragment {
    var fragment: Fragment;
    var meeting: Meeting;
    if (footprint.path & 15u) == PATH_NEAR_SURFEL {
        if HAS_NEAR {
            meeting = near_meeting(footprint, ray);
        }
    } else {
        meeting = meeting_of(n, footprint, ray);
    }
    let q = meeting.q;
    if !meeting.exists || !is_within(footprint, q) {
        return fragment;
    }
    // Phrased so that NaN is beyond.
    if HAS_ENDS {
        if !(!is_nan(meeting.inverse_depth) && meeting.inverse_depth > ray_ends[index]) {
            return fragment;
        }
    }
    var share = 1.0;
    if IS_CUT {
        share = clip_share(
            view,
            meeting.shown_at,
            meeting.inverse_depth,
            meeting.gradient,
            meeting.shown,
        );
        if share == 0.0 {
            return fragment;
        }
    }
    fragment.exists = true;
    fragment.weight = footprint.peak * falloff(q) * share;
    fragment.inverse_depth = meeting.inverse_depth;
    fragment.slack = meeting.slack;
    fragment.colour = footprint.carried;
    fragment.normal = meeting.normal;
    return fragment;
}
