// Draws a kernel on a pixel: evaluates it, restricts it to the ray's interval, and accumulates it. For
// surfels of opaque surfaces accumulate/opaque.wgsl takes the place of this file.

// Additional terms of footprints: of those on the exact path, or of all if their depth along the ray
// counts.
alias Terms = ExactTerms;

// A kernel on the ray of a pixel.
struct Sample {
    // True if the pixel lies within its cut-off.
    is_inside: bool,
    // Its optical depth along the whole ray.
    tau: f32,
    // Mean depth z along the ray minus the footprint's depth, and one over the standard deviation; set if
    // they are needed and the kernel is not near.
    beyond: f32,
    per_sigma: f32,
}

// Position of a kernel: in front of the surface; behind it where it shows through; beyond all visible
// parts; or possibly cut.
const SIDE_FRONT: u32 = 0u;
const SIDE_BEHIND: u32 = 1u;
const SIDE_HIDDEN: u32 = 2u;
const SIDE_CUT: u32 = 3u;

// The part of a pixel's ray that is drawn: depths z at which it begins, is divided by a surface, and
// ends.
struct Span {
    near: f32,
    middle: f32,
    far: f32,
}

const WHOLE_SPAN: Span = Span(-LARGEST, LARGEST, LARGEST);

// Returns the distance of a depth beyond the mean of a kernel, in standard deviations. The footprint's
// depth is subtracted first: sums of depths would round away the cuts of needles.
fn ahead_of(footprint: TileFootprint, sample: Sample, depth: f32) -> f32 {
    return ((depth - footprint.depth) - sample.beyond) * sample.per_sigma;
}

fn begin_tile(tile: u32) {
    begin_interval_of_tile();
    begin_sums_of_tile(tile);
}

fn begin_pixel(own: TilePixel, ray: TileRay, carried: TileProgress) {
    begin_sums(own, ray, carried);
    begin_ray(ray);
    begin_interval(own, ray);
}

fn prepare(n: u32, i: u32) {
    prepare_interval(n, i);
    prepare_sums(n, i);
}

fn draw(n: u32, own: TilePixel, ray: TileRay, hidden: u32) -> bool {
    before_kernel(n);
    if !own.is_pixel || !is_in_box(n, own.at) {
        return false;
    }
    let side = side_of(n);
    if side == SIDE_HIDDEN {
        return false;
    }
    let footprint = footprint_of_batch(n);
    let edges = edges_at(n, footprint);
    let sample = evaluate(n, footprint, ray, needs_place(side) || edges != 0u);
    if sample.is_inside {
        begin_domain(edges, footprint, sample, ray);
        add(n, footprint, sample, ray, side);
    }
    return sample.is_inside;
}
