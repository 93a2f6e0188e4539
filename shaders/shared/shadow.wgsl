// The transmittance from a light to a particle; the including file declares `shadows` and `shadow_words`.
// Twin: src/cpu/shadow/lookup.rs.

// Distance of the places at which a kernel is lit from the middle of its visible part, standard deviations.
const SQRT_3: f32 = 1.7320508;

// Returns F^T n for a kernel's factor F.
fn along(factor: Factor, n: vec3<f32>) -> vec3<f32> {
    return factor.x * n.x + factor.y * n.y + factor.z * n.z;
}

// Returns a point of camera space in cells.
fn cells(light: u32, at: vec3<f32>) -> vec3<f32> {
    var place = vec3<f32>(0.0);
    for (var i = 0u; i < 3u; i = i + 1u) {
        let row = shadows.lights[light].to_cells[i];
        place[i] = row.x * at.x + row.y * at.y + row.z * at.z + row.w;
    }
    return place;
}

// Returns a vector of camera space in cells.
fn turned(light: u32, v: vec3<f32>) -> vec3<f32> {
    var out = vec3<f32>(0.0);
    for (var i = 0u; i < 3u; i = i + 1u) {
        let row = shadows.lights[light].to_cells[i];
        out[i] = row.x * v.x + row.y * v.y + row.z * v.z;
    }
    return out;
}

// Returns the optical depth at a place of a column, between its boundaries.
fn column_depth(word: u32, f: f32) -> f32 {
    let a = shadow_words[word];
    let b = shadow_words[word + 1u];
    return a + (b - a) * f;
}

// Returns the optical depth of volumes from the light to a place: trilinear between the grid's numbers.
fn optical_depth(light: u32, place: vec3<f32>) -> f32 {
    let size = shadows.lights[light].size;
    if size.z == 0u {
        return 0.0;
    }
    let x = clamp(place.x - 0.5, 0.0, f32(size.x - 1u));
    let y = clamp(place.y - 0.5, 0.0, f32(size.y - 1u));
    let z = clamp(place.z, 0.0, f32(size.z));
    let i = min(u32(x), size.x - 2u);
    let j = min(u32(y), size.y - 2u);
    let k = min(u32(z), size.z - 1u);
    let f = vec3<f32>(x - f32(i), y - f32(j), z - f32(k));
    let words = size.z + 1u;
    let word = shadows.lights[light].first + ((j * size.x) + i) * words + k;
    let below = word + (size.x * words);
    let a = column_depth(word, f.z);
    let b = column_depth(word + words, f.z);
    let c = column_depth(below, f.z);
    let d = column_depth(below + words, f.z);
    let near = a + (b - a) * f.x;
    let far = c + (d - c) * f.x;
    return near + (far - near) * f.y;
}

// Returns the depth of the surface nearest to the light at the texel of a place moved by `shift`; beyond all
// if there is none.
fn nearest_surface(light: u32, place: vec3<f32>, shift: vec2<f32>) -> f32 {
    let corner = shadows.lights[light].map_corner;
    let texel = (place.xy + shift - corner) * shadows.lights[light].map_scale;
    let size = shadows.lights[light].map_size;
    let is_inside = texel.x >= 0.0
        && texel.y >= 0.0
        && texel.x < f32(size.x)
        && texel.y < f32(size.y);
    if !is_inside {
        return LARGEST;
    }
    return shadow_words[shadows.lights[light].map_first + (u32(texel.y) * size.x) + u32(texel.x)];
}

// Returns 1 if the surface at a texel does not hide the receiver, 0 otherwise.
fn passes(light: u32, place: vec3<f32>, slope: vec2<f32>, step: vec2<f32>) -> f32 {
    let surface = nearest_surface(light, place, step);
    let own = place.z + (slope.x * step.x + slope.y * step.y);
    return select(1.0, 0.0, own > surface);
}

// Returns the share of the four texels around a place moved by `shift` whose surfaces do not hide the
// receiver: bilinear between zeros and ones.
fn passed_texels(light: u32, place: vec3<f32>, slope: vec2<f32>, shift: vec2<f32>) -> f32 {
    let corner = shadows.lights[light].map_corner;
    let scale = shadows.lights[light].map_scale;
    let per_texel = 1.0 / scale;
    let at = (place.xy + shift - corner) * scale - vec2<f32>(0.5);
    let f = at - floor(at);
    let first = shift - f * per_texel;
    let a = passes(light, place, slope, first);
    let b = passes(light, place, slope, first + vec2<f32>(per_texel, 0.0));
    let c = passes(light, place, slope, first + vec2<f32>(0.0, per_texel));
    let d = passes(light, place, slope, first + vec2<f32>(per_texel, per_texel));
    let near = a + (b - a) * f.x;
    let far = c + (d - c) * f.x;
    return near + (far - near) * f.y;
}

// Returns a direction that stands for a light with a size.
fn tap(i: u32) -> vec2<f32> {
    var taps = SHADOW_TAPS;
    return vec2<f32>(taps[2u * i], taps[(2u * i) + 1u]);
}

// Returns the share of a light that opaque surfaces let pass to a place.
//
// - `slope`: change of z along x and y on the receiver's own surface.
fn passed_surfaces(light: u32, place: vec3<f32>, slope: vec2<f32>) -> f32 {
    if shadows.lights[light].map_size.x == 0u {
        return 1.0;
    }
    let softness = shadows.lights[light].softness;
    if softness == 0.0 {
        return passed_texels(light, place, slope, vec2<f32>(0.0));
    }
    var sum = 0.0;
    var count = 0.0;
    let farthest = softness * max(place.z, 0.0);
    for (var i = 0u; i < SHADOW_DIRECTIONS; i = i + 1u) {
        let shift = tap(i) * farthest;
        let own = place.z + (slope.x * shift.x + slope.y * shift.y);
        let before = own - nearest_surface(light, place, shift);
        if before > 0.0 {
            sum = sum + before;
            count = count + 1.0;
        }
    }
    if count == 0.0 {
        return 1.0;
    }
    let width = softness * (sum / count);
    var passed = 0.0;
    for (var i = 0u; i < SHADOW_DIRECTIONS; i = i + 1u) {
        passed = passed + passed_texels(light, place, slope, tap(i) * width);
    }
    return passed * (1.0 / f32(SHADOW_DIRECTIONS));
}

// Returns the share of a light's colour that reaches a kernel: the mean over the kernel's visible part.
fn kernel_transmittance(light: u32, at: vec3<f32>, factor: Factor, to_eye: vec3<f32>) -> f32 {
    let place = cells(light, at);
    if shadows.lights[light].size.z == 0u {
        return passed_surfaces(light, place, vec2<f32>(0.0));
    }
    let away = shadows.lights[light].to_cells[2].xyz;
    let reach = SQRT_3 * length(along(factor, away));
    let step = vec3<f32>(0.0, 0.0, reach);
    let change = optical_depth(light, place + step) - optical_depth(light, place - step);
    let of_eye = along(factor, to_eye);
    let sigma = max(length(of_eye), SMALLEST);
    // V v / sqrt(v V v): one standard deviation toward the eye.
    let toward = vec3<f32>(dot3(factor.x, of_eye), dot3(factor.y, of_eye), dot3(factor.z, of_eye))
        / sigma;
    let per_cell = change / (2.0 * max(reach, 0.5));
    // Behind an occluder a soft light comes back.
    let lean = clamp(per_cell * length(away) * sigma, 0.0, GREATEST_LEAN);
    let seen = place + turned(light, toward) * lean;
    var sum = 0.0;
    var axes = columns(factor);
    for (var i = 0u; i < 3u; i = i + 1u) {
        let axis = turned(light, axes[i]) * SQRT_3;
        sum = sum
            + (exp(-optical_depth(light, seen - axis)) + exp(-optical_depth(light, seen + axis)));
    }
    return passed_surfaces(light, seen, vec2<f32>(0.0)) * (sum * (1.0 / 6.0));
}

// Returns the share of a light's colour that reaches a surfel.
//
// - `plane`: unit normal of its plane, camera space, on either side; zero for none.
// - `is_sheet`: whether surfels absorb, so that the grid has their own depth.
fn surfel_transmittance(light: u32, at: vec3<f32>, plane: vec3<f32>, is_sheet: bool) -> f32 {
    var place = cells(light, at);
    // Directions do not depend on the scale.
    var normal = turned(light, plane);
    normal = normal / max(length(normal), SMALLEST);
    if normal.z > 0.0 {
        normal = -normal;
    }
    let ahead = normal - vec3<f32>(0.0, 0.0, 1.0);
    let before = select(vec3<f32>(0.0), ahead, is_sheet);
    let volumes = exp(-optical_depth(light, place + before));
    let bias = shadows.lights[light].bias;
    place = place + normal * bias;
    place.z = place.z - bias;
    let steepness = 1.0 / max(-normal.z, 1.0 / STEEPEST_SHADOW);
    let slope = normal.xy * steepness;
    return volumes * passed_surfaces(light, place, slope);
}
