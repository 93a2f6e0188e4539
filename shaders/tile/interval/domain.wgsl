// Cuts kernels at the boundary of their data's domain: of the share along a ray, the part between the
// points where the ray enters and leaves the domain remains. Twin: src/cpu/tile/interval/domain.rs.

// True if the boundary may cut any kernel.
override HAS_EDGES: bool = false;

// The shares at which the current kernel enters its domain and leaves it.
var<private> domain: vec2<f32>;
// True if the boundary cuts it.
var<private> has_domain: bool;

const WHOLE_DOMAIN: vec2<f32> = vec2<f32>(0.0, 1.0);

// Returns one more than the index of the planes of footprint n of the batch; 0 if it has none.
fn edges_at(n: u32, footprint: TileFootprint) -> u32 {
    if !HAS_EDGES {
        return 0u;
    }
    if HAS_NEAR && is_near_path(footprint.path) {
        let place = footprint.path >> 2u;
        return select(0u, place + 1u, near.terms[place].edge_count > 0u);
    }
    return batch_terms[n].edges;
}

fn begin_domain(at: u32, footprint: TileFootprint, sample: Sample, ray: TileRay) {
    domain = WHOLE_DOMAIN;
    has_domain = at != 0u;
    if !HAS_EDGES || at == 0u {
        return;
    }
    let edge_count = near.terms[at - 1u].edge_count;
    let count = min(edge_count & ~RAY_EDGES, MOST_EDGES);
    for (var k = 0u; k < count; k = k + 1u) {
        let edge = near.terms[at - 1u].edges[k];
        let plane = vec4<f32>(edge[0], edge[1], edge[2], edge[3]);
        var own = WHOLE_DOMAIN;
        if HAS_NEAR && is_near_path(footprint.path) {
            own = near_domain(footprint, plane, ray);
        } else {
            let d = offset_from(footprint.centre_px, ray);
            if (edge_count & RAY_EDGES) != 0u {
                own = exact_domain(footprint, sample, plane, d);
            } else {
                own = affine_domain(plane, d);
            }
        }
        // Either the shares of all planes of a kernel are multiplied, or none.
        let product = domain.y * own.y;
        let is_mixed = plane.w == 0.0
            && (edge_count & RAY_EDGES) == 0u
            && !(HAS_NEAR && is_near_path(footprint.path));
        domain = vec2<f32>(
            max(domain.x, own.x),
            select(min(domain.y, own.y), product, is_mixed),
        );
    }
}

// Returns Phi of any f32.
fn share_inside(deviations: f32) -> f32 {
    return select(0.0, normal_cdf(clamp(deviations, -38.0, 38.0)), !is_nan(deviations));
}

// Cuts by the joint Gaussian of pixel and distance.
fn affine_domain(plane: vec4<f32>, d: vec2<f32>) -> vec2<f32> {
    let deviations = plane.z + (plane.x * d.x + plane.y * d.y);
    if plane.w > 0.0 {
        return vec2<f32>(share_inside(-deviations), 1.0);
    }
    // Planes where rays leave, or for which the filter mixes rays.
    return vec2<f32>(0.0, share_inside(deviations));
}

// Cuts at the point where the ray meets the plane.
fn exact_domain(
    footprint: TileFootprint,
    sample: Sample,
    plane: vec4<f32>,
    d: vec2<f32>,
) -> vec2<f32> {
    let aside = plane.x * d.x + plane.y * d.y;
    let rate = plane.z + aside;
    let start = plane.w + footprint.depth * aside;
    if rate == 0.0 {
        return vec2<f32>(0.0, select(1.0, 0.0, start < 0.0));
    }
    // Relative to the centre's depth, so that nothing cancels.
    let share = share_inside((-start / rate - sample.beyond) * sample.per_sigma);
    if rate > 0.0 {
        return vec2<f32>(share, 1.0);
    }
    return vec2<f32>(0.0, share);
}

// Cuts the part of a near kernel in front of the eye.
fn near_domain(footprint: TileFootprint, plane: vec4<f32>, ray: TileRay) -> vec2<f32> {
    let is_inside = plane.w > 0.0;
    if (footprint.path & 3u) == PATH_NEAR {
        let per_depth = dot3(plane.xyz, ray_through(view, ray.pixel));
        // Cases: the eye is inside or outside, the plane lies ahead or behind.
        if per_depth > 0.0 {
            let share = near_share(footprint, ray.pixel, min(1.0 / per_depth, LARGEST));
            return select(vec2<f32>(share, 1.0), vec2<f32>(0.0, share), is_inside);
        }
        return select(vec2<f32>(1.0, 0.0), WHOLE_DOMAIN, is_inside);
    }
    let d = ray.pixel - footprint.centre_px;
    let own = affine_domain(plane, d);
    let at = footprint.path >> 2u;
    let half_line = near.terms[at].half_line;
    let z = half_line[2] + half_line[0] * d.x + half_line[1] * d.y;
    let behind_eye = normal_cdf(clamp(-z / max(near.terms[at].sigma, SMALLEST), -38.0, 38.0));
    let shares = (own - behind_eye) / (1.0 - behind_eye);
    return vec2<f32>(
        select(0.0, min(shares.x, 1.0), shares.x > 0.0),
        select(0.0, min(shares.y, 1.0), shares.y > 0.0),
    );
}

// Returns the share of the current kernel for the whole ray.
fn domain_share() -> f32 {
    return select(1.0, max(domain.y - domain.x, 0.0), HAS_EDGES);
}

// Clamps a share to the domain.
fn within_domain(share: f32) -> f32 {
    return select(share, min(max(share, domain.x), domain.y), HAS_EDGES);
}

// Returns whether a share changes with the depth up to which it counts.
fn moves_in_domain(share: f32) -> bool {
    return !(HAS_EDGES && has_domain) || (domain.x < share && share < domain.y);
}
