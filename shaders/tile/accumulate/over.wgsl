// Accumulate: composites kernels one by one, front to back. Twin: src/cpu/tile/accumulate/over.rs.

fn begin_sums_of_tile(tile: u32) {}

fn begin_sums(own: TilePixel, ray: TileRay, carried: TileProgress) {
    begin_opacity(own, carried.drawn > 0u);
}

fn prepare_sums(n: u32, i: u32) {}

fn before_kernel(n: u32) {}

fn needs_place(side: u32) -> bool {
    return side == SIDE_CUT;
}

// Composites an opacity behind a pixel's contents. In a picture of counts it counts the kernel instead.
fn put(pixel: ptr<private, Pixel>, opacity: f32, colour: vec3<f32>, depth: f32) {
    let before = (*pixel).alpha;
    let weight = opacity * (1.0 - before);
    (*pixel).alpha = before + weight;
    if IS_COUNT {
        (*pixel).colour = (*pixel).colour + 1.0;
    } else {
        (*pixel).colour = (*pixel).colour + weight * colour;
    }
    if HAS_DEPTH && before < 0.5 && (*pixel).alpha >= 0.5 {
        (*pixel).depth = depth;
    }
}

fn add(n: u32, footprint: TileFootprint, sample: Sample, ray: TileRay, side: u32) {
    let path = footprint.path;
    let tau = sample.tau * domain_share();
    var depth = footprint.depth;
    if side == SIDE_CUT || (HAS_NEAR && is_near_path(path)) {
        // If a kernel contains the eye, its centre may lie behind the eye.
        depth = max(depth, 0.0);
    }
    if side == SIDE_CUT {
        add_cut(footprint, sample, ray, depth);
        return;
    }
    var opacity: f32;
    if !IS_LINEAR && path == PATH_AFFINE && footprint.peak <= FAINT {
        opacity = tau * (1.0 - 0.5 * tau * (1.0 - tau * (1.0 / 3.0)));
    } else {
        opacity = opacity_by(path, tau);
    }
    if HAS_SURFACE && side == SIDE_BEHIND {
        put(&behind, opacity, footprint.carried, depth);
    } else {
        put(&front, opacity, footprint.carried, depth);
    }
}

// Adds the parts of a kernel within the span: before the surface and behind it.
fn add_cut(footprint: TileFootprint, sample: Sample, ray: TileRay, depth: f32) {
    var begin: f32;
    var middle: f32;
    var end: f32;
    if footprint.path == PATH_PEAK || footprint.path == PATH_CAPPED {
        // A splat that states its opacity is not divided: it lies at its centre's depth.
        begin = f32(footprint.depth < span.near);
        middle = f32(footprint.depth < span.middle);
        end = f32(footprint.depth < span.far);
    } else {
        begin = share_before(footprint, sample, ray, span.near);
        middle = share_before(footprint, sample, ray, span.middle);
        end = share_before(footprint, sample, ray, span.far);
    }
    let in_front = opacity_by(footprint.path, sample.tau * max(middle - begin, 0.0));
    put(&front, in_front, footprint.carried, max(min(depth, span.middle), span.near));
    if !IS_COUNT && shows_behind() {
        let rest = opacity_by(footprint.path, sample.tau * max(end - middle, 0.0));
        put(&behind, rest, footprint.carried, max(min(depth, span.far), span.middle));
    }
}

fn end_pixel(own: TilePixel, inside: u32, is_end: bool) {
    end_opacity(own);
}

fn layers_of_tile() -> vec2<u32> {
    return vec2<u32>(0u);
}
