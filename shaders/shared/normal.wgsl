// Packs unit vectors as whole numbers: octahedral coordinates in steps. Twins: `pack_normal` and
// `unpack_normal` in src/math/direction.rs.

fn fold(a: f32, b: f32) -> f32 {
    return (1.0 - abs(b)) * select(1.0, -1.0, a < 0.0);
}

fn normal_step(x: f32) -> f32 {
    return floor((0.5 * x + 0.5) * NORMAL_STEPS + 0.5);
}

fn pack_normal(normal: vec3<f32>) -> f32 {
    let sum = abs(normal.x) + abs(normal.y) + abs(normal.z);
    var x = normal.x / sum;
    var y = normal.y / sum;
    if normal.z < 0.0 {
        let folded = fold(x, y);
        y = fold(y, x);
        x = folded;
    }
    return normal_step(x) * (NORMAL_STEPS + 1.0) + normal_step(y);
}

fn unfold(a: f32, under: f32) -> f32 {
    return select(a - under, a + under, a < 0.0);
}

fn unpack_normal(packed: f32) -> vec3<f32> {
    let row = floor(packed / (NORMAL_STEPS + 1.0));
    let x = row * (2.0 / NORMAL_STEPS) - 1.0;
    let y = (packed - row * (NORMAL_STEPS + 1.0)) * (2.0 / NORMAL_STEPS) - 1.0;
    return from_octahedral(vec2<f32>(x, y));
}

// Returns the unit vector at a point of the octahedron unfolded to a square, -1 to 1 each way.
fn from_octahedral(place: vec2<f32>) -> vec3<f32> {
    let x = place.x;
    let y = place.y;
    let z = 1.0 - abs(x) - abs(y);
    let under = max(-z, 0.0);
    return unit_or_zero(vec3<f32>(unfold(x, under), unfold(y, under), z));
}

// Returns a direction; zero if there is none.
fn unit_or_zero(v: vec3<f32>) -> vec3<f32> {
    let inverse = 1.0 / sqrt(dot3(v, v));
    return select(vec3<f32>(0.0), v * inverse, is_finite(inverse) && inverse > 0.0);
}
