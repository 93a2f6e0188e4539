// Chooses the approximation that draws a kernel. Twin: src/splat/choose.rs.

// An exact footprint's terms, if it is chosen.
struct ExactChoice {
    exists: bool,
    terms: ExactTerms,
}

// Chooses between the affine and the exact footprint. This choice is made nowhere else.
fn choose_exact(
    view: ViewUniform,
    filter_kind: u32,
    screen: ScreenFactor,
    kernel: ImageKernel,
    crowding: f32,
) -> ExactChoice {
    var choice: ExactChoice;
    let is_exact = filter_kind == FILTER_EXACT;
    if view.orthographic != 0u || !(is_exact || filter_kind == FILTER_ADAPTIVE) {
        return choice;
    }
    choice.terms = exact_terms(screen, view.low_pass_variance_px2, kernel.determinant);
    if is_exact {
        choice.exists = true;
        return choice;
    }
    let amplification = max(opacity_amplification(kernel.tau * crowding), 1.0);
    let error = affine_error(view, screen, kernel, choice.terms) * amplification;
    // NaN takes the safe side.
    choice.exists = is_nan(error) || error > view.tolerance * AFFINE_SHARE;
    return choice;
}
