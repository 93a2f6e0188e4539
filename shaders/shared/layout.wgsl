// Defines the structs that stages exchange. Twin: src/record/; src/gpu/reflection.rs compares offsets.
// Triples are arrays: a vec3 would be aligned to four words.

struct ViewUniform {
    focal_px: vec2<f32>,
    centre_px: vec2<f32>,
    size: vec2<u32>,
    orthographic: u32,
    filter_kind: u32,
    low_pass_variance_px2: f32,
    tolerance: f32,
    cutoff: f32,
    key_scale: f32,
    show_choice: u32,
    key_kind: u32,
    layer_first: i32,
    layer_thickness: f32,
    // Its offset happens to be aligned to four words.
    key_axis: vec3<f32>,
    layer_shift: u32,
    keys_begin: u32,
    clip_count: u32,
    sub_pixel_opacity: u32,
    least_length: f32,
    aperture: f32,
    per_focus: f32,
    unused: u32,
    smoothing: u32,
    clip_planes: array<vec4<f32>, MAX_CLIP_PLANES>,
}

struct CameraUniform {
    eye: array<vec2<u32>, 3>,
    camera_from_world: array<array<vec2<u32>, 3>, 3>,
    plane_normals: array<array<vec2<u32>, 3>, MAX_PLANES>,
    plane_distances: array<vec2<u32>, MAX_PLANES>,
    plane_spreads: array<array<vec2<u32>, 3>, MAX_PLANES>,
    key_axis: array<vec2<u32>, 3>,
    key_near: vec2<u32>,
    keys_per_unit: vec2<u32>,
    rotation: array<array<f32, 3>, 3>,
    has_frustum: u32,
    orthographic: u32,
    key_kind: u32,
    plane_count: u32,
    unused: u32,
    choice: ChoiceUniform,
}

struct LightUniform {
    direction: vec4<f32>,
    colour: vec4<f32>,
}

struct LightingUniform {
    lights: array<LightUniform, MAX_LIGHTS>,
    count: u32,
    orthographic: u32,
    ambient: f32,
    diffuse: f32,
    specular: f32,
    shininess: f32,
    unused: vec2<u32>,
}

struct LightShadow {
    to_cells: array<vec4<f32>, 3>,
    size: vec3<u32>,
    first: u32,
    map_size: vec2<u32>,
    map_first: u32,
    map_scale: f32,
    map_corner: vec2<f32>,
    bias: f32,
    softness: f32,
}

struct ShadowUniform {
    lights: array<LightShadow, MAX_LIGHTS>,
}

struct ChoiceUniform {
    focal_px: vec2<f32>,
    thresholds: vec2<f32>,
    by_hand: u32,
    orthographic: u32,
    filter_kind: u32,
    low_pass_variance_px2: f32,
    tolerance: f32,
    merge_tolerance: f32,
    classified_by: u32,
    slab_thickness: f32,
}

struct DeviceBlock {
    origin: array<vec2<u32>, 3>,
    half_extent: array<f32, 3>,
    max_sigma: f32,
    min_sigma: f32,
    max_strength: f32,
    value_range: array<f32, 2>,
    first: u32,
    count: u32,
    parent: u32,
    level: u32,
    crowding: f32,
    greatest_spread: f32,
    values_around: array<f32, 2>,
    edges: u32,
    unused: u32,
}

struct MergeBounds {
    third_mean: f32,
    third: f32,
    fourth: f32,
    second: f32,
    spread: f32,
    colour: f32,
    uneven: f32,
}

struct MergedBlock {
    parent: u32,
    state: u32,
}

struct LatticeUniform {
    dims: array<u32, 3>,
    bricks: array<u32, 3>,
    first_brick: u32,
    has_axes: u32,
    basis: array<array<f32, 3>, 3>,
    factor: array<array<f32, 3>, 3>,
    face_normals: array<array<f32, 3>, 3>,
    first_face: u32,
}

struct BrickUniform {
    dims: vec3<u32>,
    first: u32,
    values_first: u32,
    kernel_width: f32,
    models_first: u32,
    unused: u32,
    model_scales: vec2<f32>,
    unused_end: vec2<u32>,
}

struct FrameState {
    nearest: vec2<u32>,
    farthest: vec2<u32>,
    near: vec2<u32>,
    keys_per_unit: vec2<u32>,
    classified_count: u32,
    filters: array<atomic<u32>, FILTER_COUNT>,
}

struct PartState {
    capacity: u32,
    view_count: u32,
    count_length: u32,
    needed: u32,
    classified_count: u32,
    first: u32,
}

struct BlockView {
    origin_camera: array<f32, 3>,
    block: u32,
    first: u32,
    count: u32,
    key: u32,
    filter_kind: u32,
    level: u32,
    classified_by: u32,
}

struct ClassifiedParticle {
    view: u32,
    local: u32,
    mass: f32,
    carried: array<f32, 3>,
}

struct PieceTerms {
    axis: array<f32, 3>,
    shift: f32,
    width: f32,
    unused: u32,
}

struct Footprint {
    centre_px: vec2<f32>,
    form_p: vec2<f32>,
    form_r: vec2<f32>,
    tau: f32,
    cutoff_squared: f32,
    // A colour. If slabs are classified: a value, three times. In sums of columns: a sign.
    carried: array<f32, 3>,
    depth: f32,
    path: u32,
    columns: u32,
    rows: u32,
    key: u32,
}

struct ExactTerms {
    gradient: array<f32, 2>,
    hessian: array<f32, 3>,
    depth_sigma: f32,
    edges: u32,
}

struct SurfelTerms {
    gradient: array<f32, 2>,
    inverse_depth: f32,
    slack: f32,
    homography: f32,
    normal: f32,
    unused: u32,
}

struct NearTerms {
    misses: array<array<f32, 3>, 5>,
    minors: array<array<f32, 3>, 10>,
    minor_depths: array<f32, 10>,
    sigma: f32,
    unit: f32,
    reach: f32,
    half_line: array<f32, 3>,
    edges: array<array<f32, 4>, MOST_EDGES>,
    edge_count: u32,
}

struct PartIndex {
    index: u32,
}

struct PartRange {
    first: u32,
    count: u32,
}

struct SortState {
    count: u32,
    visible: u32,
    exact: u32,
}

struct ChunkUniform {
    start: u32,
    capacity: u32,
    band_first: vec2<u32>,
    band_size: vec2<u32>,
    is_last: u32,
    unused: u32,
}

struct ChunkState {
    length: u32,
    offset_count: u32,
    entries: u32,
    needed: u32,
}

// Converts a triple to a vector.
fn vector(v: array<f32, 3>) -> vec3<f32> {
    return vec3<f32>(v[0], v[1], v[2]);
}

// Converts a vector to a triple.
fn triple(v: vec3<f32>) -> array<f32, 3> {
    return array<f32, 3>(v.x, v.y, v.z);
}

// Returns a . b, summed from the left as in the twin: `dot` leaves the order open.
fn dot2(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.x + a.y * b.y;
}

fn dot3(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

// Returns whether x is a finite number. Tested by bits: WGSL may assume that compared numbers are finite.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

// Returns infinity. Through a variable: WGSL refuses constants that are not finite.
fn infinity() -> f32 {
    var word = INFINITE_WORD;
    return bitcast<f32>(word);
}

fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

// Returns x > 0, also for denormals and infinity; false for NaN. Tested by bits: see `is_finite`.
fn is_positive(x: f32) -> bool {
    return bitcast<u32>(x) - 1u < 0x7f800000u;
}
