// Cuts kernels into the layers that they reach. The next file, composited.wgsl or maximum.wgsl, finishes
// layers. Twin: src/cpu/tile/accumulate/slabs.rs.

fn layers_of(i: u32) -> vec2<u32> {
    let footprint = footprint_of_chunk(i);
    let first = layer_of_key(i);
    var reach = reach_of(i, footprint);
    if !is_near_path(footprint.path) {
        // No farther behind its centre than its beginning is before it: slopes are rounded.
        reach = min(reach, footprint.depth - layer_start(first));
    }
    let end = footprint.depth + reach;
    let last = clamp(floor(end / view.layer_thickness), -2147483520.0, 2147483520.0);
    return vec2<u32>(first, max(u32(max(i32(last) - view.layer_first, 0)), first));
}

fn needs_place(side: u32) -> bool {
    return true;
}

// Returns the density of a kernel along the ray at a depth; 0 at the ends of the ray.
fn density_at(footprint: TileFootprint, sample: Sample, depth: f32) -> f32 {
    let ahead = ahead_of(footprint, sample, depth);
    if abs(depth) >= LARGEST || is_nan(ahead) || !(abs(ahead) <= 7.0) {
        return 0.0;
    }
    return exp_minus_half(ahead * ahead) * (FRAC_1_SQRT_2PI * sample.per_sigma);
}

// Returns the same density; 0 if the domain ends the kernel before.
fn moving_density(footprint: TileFootprint, sample: Sample, depth: f32, share: f32) -> f32 {
    return select(0.0, density_at(footprint, sample, depth), moves_in_domain(share));
}

// Returns the derivative of a part of a footprint: of the optical depth `tau` between two depths. `rise`
// is its growth if both depths increase.
fn part_slope(footprint: FootprintSlope, tau: f32, rise: f32) -> vec3<f32> {
    return vec3<f32>(footprint.log_tau * tau - footprint.mean * rise, rise);
}

fn with_slope(slopes: Slopes, slope: vec3<f32>, carried: f32) -> Slopes {
    return Slopes(slopes.carried + carried * slope, slopes.length + slope);
}

fn add(n: u32, footprint: TileFootprint, sample: Sample, ray: TileRay, side: u32) {
    if IS_COUNT {
        front.colour = front.colour + 1.0;
    }
    let tau = sample.tau;
    let first = max(batch_layers[n].x, first_layer);
    // More layers than slots: this frame will be drawn again.
    let last = min(max(first, batch_layers[n].y), first + LAYER_SLOTS - 1u);
    var drawn_span = WHOLE_SPAN;
    var divide_at = 1.0;
    if side != SIDE_FRONT {
        drawn_span = span;
        divide_at = share_before(footprint, sample, ray, drawn_span.middle);
    }
    var below = within_domain(0.0);
    if drawn_span.near > -LARGEST {
        below = share_before(footprint, sample, ray, drawn_span.near);
    }
    var begin = drawn_span.near;
    var slope: FootprintSlope;
    if HAS_SLOPES {
        slope = slope_of(n, footprint, ray);
    }
    for (var layer = first; layer <= last; layer = layer + 1u) {
        var end = LARGEST;
        if layer < last {
            end = layer_start(layer + 1u);
        }
        end = min(max(end, drawn_span.near), drawn_span.far);
        let above = max(share_before(footprint, sample, ray, end), below);
        // A layer behind the surface lies wholly behind it.
        var divide = above;
        if layer_start(layer) < drawn_span.middle {
            divide = max(min(divide_at, above), below);
        }
        let in_front = tau * (divide - below);
        let rest = tau * (above - divide);
        add_to_layer(layer, in_front, rest, footprint.carried);
        if HAS_SLOPES {
            var divide_depth = end;
            if layer_start(layer) < drawn_span.middle {
                divide_depth = max(min(drawn_span.middle, end), begin);
            }
            let at_begin = moving_density(footprint, sample, begin, below);
            let at_divide = moving_density(footprint, sample, divide_depth, divide);
            let at_end = moving_density(footprint, sample, end, above);
            let value = footprint.carried.x;
            let own_slope = part_slope(slope, in_front, tau * (at_divide - at_begin));
            let at_slot = layer % SLOPE_SLOTS;
            ring_slopes[at_slot] = with_slope(ring_slopes[at_slot], own_slope, value);
            if HAS_SURFACE {
                let rest_slope = part_slope(slope, rest, tau * (at_end - at_divide));
                divided_slopes = with_slope(divided_slopes, rest_slope, value);
            }
        }
        begin = end;
        below = above;
    }
}
