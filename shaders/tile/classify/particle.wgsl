// Classify: particles are classified before projection. Layers are composited as they are.

const HAS_SLOPES: bool = false;

fn classify_layer(sums: vec4<f32>, slopes: Slopes, at: vec2<f32>, depth: f32) -> vec4<f32> {
    return sums;
}
