// Converts between linear light and sRGB code values (IEC 61966-2-1), both from 0 up. Twins:
// `linear_from_srgb` and `srgb_from_linear` of src/image.rs.

fn linear_from_srgb(code: f32) -> f32 {
    if code <= 0.04045 {
        return code / SRGB_SLOPE;
    }
    return pow((code + SRGB_OFFSET) / SRGB_SCALE, SRGB_GAMMA);
}

fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= SRGB_LINEAR_END {
        return SRGB_SLOPE * linear;
    }
    return SRGB_SCALE * pow(linear, 1.0 / SRGB_GAMMA) - SRGB_OFFSET;
}
