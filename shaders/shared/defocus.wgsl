// Computes the variance that the opening of a lens adds to a footprint. Twin: src/splat/defocus.rs.

// Returns the variance that the opening of the lens adds to a kernel's footprint along each axis, px²; 0 for a point.
fn defocus(view: ViewUniform, kernel: Kernel) -> f32 {
    if view.aperture <= 0.0 {
        return 0.0;
    }
    let reach = length3(kernel.factor.z);
    let depth = max_number(abs(kernel.centre.z), reach);
    let unit = view.aperture / depth;
    let beside = kernel.centre.z * view.per_focus - 1.0;
    let spread = reach / depth;
    let scale = view.focal_px * unit;
    return scale.x * scale.y * (beside * beside + spread * spread);
}
