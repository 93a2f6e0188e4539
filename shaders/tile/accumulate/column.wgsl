// Accumulate: sums kernels with their signs, without occlusion. Twin: src/cpu/tile/accumulate/column.rs.
//
// A pixel may receive a hundred thousand contributions. One f32 would lose a thousandth of the sum if
// they are alike, and compilers may reassociate the sums that would compensate for that. So there are
// sums of sums: of the 32 kernels since the last check of the tile, of 64 such sums, of 64 of these, and
// of the rest. If contributions are alike, partial sums grow evenly and half of all roundings count: (32
// + 64 + 64) / 2 of 6e-8, 4.8e-6 for up to 131,072 kernels in a pixel, 6.7e-6 for up to 64 times as many;
// on average far less. The host adds the four in f64.

// The four sums, the finest first.
var<private> sums: vec4<f32>;

// Number of sums that are added to one of the next.
const RUN: u32 = 64u;

fn begin_sums_of_tile(tile: u32) {}

fn begin_sums(own: TilePixel, ray: TileRay, carried: TileProgress) {
    sums = vec4<f32>(0.0);
    if own.is_pixel && carried.drawn > 0u {
        let at = 4u * own.index;
        sums = vec4<f32>(pixels[at], pixels[at + 1u], pixels[at + 2u], pixels[at + 3u]);
    }
}

fn prepare_sums(n: u32, i: u32) {}

fn before_kernel(n: u32) {}

fn is_finished(hidden: u32) -> bool {
    return false;
}

// Adds full sums to the next.
fn look(thread: u32, is_pixel: bool, drawn: u32) -> u32 {
    let looks = drawn / TERMINATION_INTERVAL;
    sums = vec4<f32>(0.0, sums.y + sums.x, sums.z, sums.w);
    if looks % RUN == 0u {
        sums = vec4<f32>(0.0, 0.0, sums.z + sums.y, sums.w);
    }
    if looks % (RUN * RUN) == 0u {
        sums = vec4<f32>(0.0, 0.0, 0.0, sums.w + sums.z);
    }
    return 0u;
}

fn needs_place(side: u32) -> bool {
    return side == SIDE_CUT;
}

fn add(n: u32, footprint: TileFootprint, sample: Sample, ray: TileRay, side: u32) {
    var part = domain_share();
    if side == SIDE_CUT {
        let begin = share_before(footprint, sample, ray, span.near);
        let end = share_before(footprint, sample, ray, span.far);
        part = max(end - begin, 0.0);
    }
    var tau = sample.tau;
    if footprint.path == PATH_AFFINE {
        let p = footprint.form_p;
        let r = footprint.form_r;
        let kernel = smoothed_of(view.smoothing, view.low_pass_variance_px2, p, r, footprint.peak);
        if kernel.is_drawn {
            tau = smoothed_mean(kernel, offset_from(footprint.centre_px, ray));
        } else {
            let own = pixel_mean_of(view.low_pass_variance_px2, p, r, footprint.peak);
            if own.is_mean {
                tau = mean_at(own, offset_from(footprint.centre_px, ray));
            }
        }
    }
    sums.x = sums.x + tau * part * footprint.carried.x;
}

fn end_pixel(own: TilePixel, inside: u32, is_end: bool) {
    if own.is_pixel {
        let at = 4u * own.index;
        pixels[at] = sums.x;
        pixels[at + 1u] = sums.y;
        pixels[at + 2u] = sums.z;
        pixels[at + 3u] = sums.w;
    }
}

fn layers_of_tile() -> vec2<u32> {
    return vec2<u32>(0u);
}
