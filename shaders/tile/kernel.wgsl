// A kernel on a pixel: evaluated, as much of it taken as its ray's interval has, and accumulated.
// Surfels of opaque surfaces have accumulate/opaque.wgsl in the place of this.

// What footprints have besides: those on the exact path, or all of those whose place along the ray
// counts.
alias Terms = ExactTerms;

// A kernel on the ray of a pixel.
struct Sample {
    // Whether the pixel lies within its cut-off.
    is_inside: bool,
    // Its optical depth along the whole ray.
    tau: f32,
    // How far its mean depth z along the ray lies beyond the footprint's depth, and one over the standard
    // deviation; where they are wanted and the kernel is not near.
    beyond: f32,
    per_sigma: f32,
}

// Where a kernel lies: in front of the surface, behind it where something shows through, beyond all of
// which anything is seen, or maybe cut.
const SIDE_FRONT: u32 = 0u;
const SIDE_BEHIND: u32 = 1u;
const SIDE_HIDDEN: u32 = 2u;
const SIDE_CUT: u32 = 3u;

// What is drawn of a pixel's ray: where it begins, a surface divides it, and it ends; depths z.
struct Span {
    near: f32,
    middle: f32,
    far: f32,
}

const WHOLE_SPAN: Span = Span(-LARGEST, LARGEST, LARGEST);

// How far a depth lies beyond the mean of a kernel, in standard deviations. From the footprint's depth
// first: sums of depths would round away what needles are cut at.
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
