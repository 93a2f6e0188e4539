// Lights a colour; the including file declares `lighting`. Twin: `lit` in src/cpu/light.rs.

// Returns the fraction of the light from an angle that is seen.
fn seen(cosine: f32, is_surface: bool) -> f32 {
    return select(abs(cosine), max(cosine, 0.0), is_surface);
}

// Returns x^y for x from 0 to 1, y from 1 up.
fn power(x: f32, y: f32) -> f32 {
    if x <= 0.0 {
        return 0.0;
    }
    return exp2(y * log2(x));
}

// Returns the shares of lights without shadows.
fn no_shadows() -> array<f32, MAX_LIGHTS> {
    var all: array<f32, MAX_LIGHTS>;
    for (var i = 0u; i < MAX_LIGHTS; i = i + 1u) {
        all[i] = 1.0;
    }
    return all;
}

// Returns a colour under the lights, on the eye's side of a surface or on both sides of a gradient.
//
// - `passed`: share of each light that reaches it.
fn lit(
    passed: array<f32, MAX_LIGHTS>,
    colour: vec3<f32>,
    plane_normal: vec3<f32>,
    is_surface: bool,
    to_eye: vec3<f32>,
) -> vec3<f32> {
    var shares = passed;
    var normal = plane_normal;
    if is_surface && dot3(normal, to_eye) < 0.0 {
        normal = -normal;
    }
    var reflected = vec3<f32>(lighting.ambient);
    var highlight = vec3<f32>(0.0);
    for (var i = 0u; i < lighting.count; i = i + 1u) {
        let direction = lighting.lights[i].direction.xyz;
        let diffuse = seen(dot3(normal, direction), is_surface);
        // The light is behind the surface.
        if !(diffuse > 0.0) {
            continue;
        }
        let halfway = unit_or_zero(direction + to_eye);
        let specular = min(seen(dot3(normal, halfway), is_surface), 1.0);
        let light = lighting.lights[i].colour.xyz * shares[i];
        reflected = reflected + light * (lighting.diffuse * diffuse);
        highlight = highlight
            + light * (lighting.specular * power(specular, lighting.shininess));
    }
    return colour * reflected + highlight;
}
