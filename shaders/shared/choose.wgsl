// Chooses how a block is drawn in a frame: the filter of its particles, and whether merged particles
// replace their members. The stage declares `camera`, `maxima` and sets the overrides below. Twin:
// src/blocks/choose.rs, which explains the numbers. Comparisons are phrased so that NaN takes the same
// side.

// True if masses are classified, so that blocks may be transparent.
override IS_CLASSIFIED: bool = false;
// True if colours are classified.
override IS_COLOUR_CLASSIFIED: bool = false;
// True if particles are merged ones.
override IS_MERGED: bool = false;
// True if all particles are spheres.
override ARE_ROUND: bool = false;

// Bounds on the appearance of a block's kernels on the image, at any position in the block.
struct Appearance {
    // False if the block may reach the plane of the eye.
    exists: bool,
    // Least distance of a kernel's centre, world units; unused for an orthographic camera.
    distance: f32,
    // Greatest tangent of an angle off the camera's axis.
    slope: f32,
    // 1 + slope².
    stretch: f32,
    // Least and greatest pixels per world unit at the centres, before the stretch off the axis.
    scale_px: vec2<f32>,
}

// - `centre`: centre of the block, camera space.
fn appearance_of(choice: ChoiceUniform, centre: vec3<f32>, half_extent: vec3<f32>) -> Appearance {
    let least = choice.focal_px.x;
    let greatest = choice.focal_px.y;
    if choice.orthographic != 0u {
        return Appearance(true, 0.0, 0.0, 1.0, vec2<f32>(least, greatest));
    }
    let rotation = camera.rotation;
    let axis = abs(vec3<f32>(rotation[0][2], rotation[1][2], rotation[2][2]));
    let half_depth = axis.x * half_extent.x + axis.y * half_extent.y + axis.z * half_extent.z;
    let near = centre.z - half_depth;
    if !is_above(near, 0.0) {
        var none: Appearance;
        return none;
    }
    let radius = length3(half_extent);
    let beside = sqrt(centre.x * centre.x + centre.y * centre.y) + radius;
    let slope = beside / near;
    return Appearance(
        true,
        max_number(near, length3(centre) - radius),
        slope,
        1.0 + slope * slope,
        vec2<f32>(least / (centre.z + half_depth), greatest / near),
    );
}

// Properties of a block's particles other than their positions.
struct Kernels {
    // Least and greatest standard deviation.
    sigmas: vec2<f32>,
    // True if all are spheres.
    are_round: bool,
    // The greatest mass.
    mass: f32,
    // Greatest number of kernels that overlap at a point, as a multiple of OVERLAP.
    crowding: f32,
    // Greatest change of the colour, or of the extinction as a fraction of its greatest, per unit of
    // value.
    slope: f32,
}

// - `is_spread`: whether the kernels are classified over their extents, and may be flattened.
fn kernels_of(block: DeviceBlock, is_spread: bool) -> Kernels {
    let low = select(block.value_range[0], block.values_around[0], is_spread);
    let high = select(block.value_range[1], block.values_around[1], is_spread);
    var change = 0.0;
    if IS_MERGED && (IS_CLASSIFIED || IS_COLOUR_CLASSIFIED) {
        change = max_slope(low, high);
    }
    var extinction = 1.0;
    var slope = change;
    if IS_CLASSIFIED {
        extinction = max_extinction(low, high);
        slope = change / extinction;
    }
    let whole = vec2<f32>(block.min_sigma, block.max_sigma);
    let pieces = vec2<f32>(0.0, block.max_sigma * MAX_PIECE_WIDTH);
    return Kernels(
        select(whole, pieces, is_spread),
        ARE_ROUND && !is_spread,
        block.max_strength * extinction,
        block.crowding,
        slope,
    );
}

// Returns a bound on the optical depth at a kernel's centre, low-passed.
fn peak_of(kernels: Kernels, appearance: Appearance, h2: f32) -> f32 {
    let greatest_px = appearance.scale_px.y;
    let narrowest = kernels.sigmas.x * appearance.scale_px.x;
    return kernels.mass * greatest_px * greatest_px * sqrt(appearance.stretch)
        / (TAU * (h2 + narrowest * narrowest));
}

fn filter_of(
    choice: ChoiceUniform,
    block: DeviceBlock,
    is_spread: bool,
    centre: vec3<f32>,
) -> u32 {
    if choice.filter_kind != FILTER_ADAPTIVE {
        return choice.filter_kind;
    }
    let appearance = appearance_of(choice, centre, vector(block.half_extent));
    let is_by_hand = choice.by_hand != 0u;
    if !appearance.exists {
        return select(FILTER_ADAPTIVE, FILTER_EWA, is_by_hand);
    }
    let kernels = kernels_of(block, is_spread);
    if is_by_hand {
        return by_hand(choice, appearance, kernels);
    }
    return by_tolerance(choice, appearance, kernels);
}

// Applies eq. 7 of Chen et al. 2004 to all of a block: r_k is the kernels' standard deviation, r_h that
// of the low-pass filter, one unit in front of the eye.
fn by_hand(choice: ChoiceUniform, appearance: Appearance, kernels: Kernels) -> u32 {
    let h = sqrt(choice.low_pass_variance_px2);
    let c_min = choice.thresholds.x;
    let c_max = choice.thresholds.y;
    if is_above(kernels.sigmas.x * appearance.scale_px.x * c_min, h) {
        return FILTER_RECONSTRUCTION;
    }
    if is_above(h, kernels.sigmas.y * appearance.scale_px.y * c_max) {
        return FILTER_LOW_PASS;
    }
    return FILTER_EWA;
}

// Returns the cheapest filter whose bound fits the tolerance for every kernel; FILTER_ADAPTIVE if each
// kernel must choose for itself.
fn by_tolerance(choice: ChoiceUniform, appearance: Appearance, kernels: Kernels) -> u32 {
    let h2 = choice.low_pass_variance_px2;
    let least_px = appearance.scale_px.x;
    let greatest_px = appearance.scale_px.y;
    let least = kernels.sigmas.x;
    let greatest = kernels.sigmas.y;
    let amplification = amplification(peak_of(kernels, appearance, h2) * kernels.crowding);
    if choice.orthographic == 0u {
        let filter_variance = h2 / (least_px * least_px);
        let widest = sqrt(greatest * greatest + filter_variance) / appearance.distance;
        let narrowest = least / appearance.distance;
        let error = 0.82 * (widest - narrowest)
            + 1.16 * appearance.slope * widest
            + 1.1 * appearance.stretch * widest * widest;
        if !is_at_most(error * amplification, choice.tolerance * AFFINE_SHARE) {
            return FILTER_ADAPTIVE;
        }
    }
    let allowed = choice.tolerance * FILTER_SHARE / amplification;
    let widest_px2 = greatest * greatest * greatest_px * greatest_px;
    let narrowest_px2 = least * least * least_px * least_px;
    if is_at_most(widest_px2 * appearance.stretch, allowed * h2) {
        return FILTER_LOW_PASS;
    }
    // Greatest difference of the variances along a footprint's axes, as a fraction of their mean.
    let unequal = choice.focal_px.x / choice.focal_px.y;
    // A device's quotient of equal numbers may not be 1.
    let focal = select(1.0 - unequal * unequal, 0.0, choice.focal_px.x == choice.focal_px.y);
    let beside = appearance.slope * appearance.slope + focal;
    var own = 0.0;
    if !kernels.are_round {
        own = (greatest * greatest - least * least) * greatest_px * greatest_px * appearance.stretch
            / (h2 + narrowest_px2);
    }
    let difference = 0.5 * (own + beside * widest_px2 / (h2 + widest_px2));
    let square = difference * difference;
    if is_at_most(0.368 * difference + 0.64 * square * square, allowed) {
        return FILTER_ISOTROPIC;
    }
    if is_at_most(h2, narrowest_px2 * allowed) {
        return FILTER_RECONSTRUCTION;
    }
    return FILTER_EWA;
}

// Returns a bound on `opacity_amplification`, at least 1, without logarithms.
fn amplification(tau: f32) -> f32 {
    if is_at_most(tau, 1.0) {
        return 1.0;
    }
    let r2 = 8.0 * (sqrt(sqrt(tau)) - 1.0);
    let r = sqrt(r2);
    return 1.0 + 0.43 * r * r2 * max_number(0.42 * r, 1.0);
}

// Returns whether the merged particles of a block may be drawn instead of their members.
fn merge_fits(
    choice: ChoiceUniform,
    block: DeviceBlock,
    bounds: MergeBounds,
    centre: vec3<f32>,
) -> bool {
    let kernels = kernels_of(block, false);
    let appearance = appearance_of(choice, centre, vector(block.half_extent));
    if !appearance.exists {
        return false;
    }
    let error = merge_error(choice.low_pass_variance_px2, appearance, kernels, bounds);
    return is_at_most(error, choice.merge_tolerance * MERGE_SHARE);
}

// Returns a bound on the change of a pixel by merging, for clusters in ordinary arrangements.
fn merge_error(h2: f32, appearance: Appearance, kernels: Kernels, bounds: MergeBounds) -> f32 {
    let least_px = appearance.scale_px.x;
    let greatest_px = appearance.scale_px.y;
    let narrowest = kernels.sigmas.x * least_px;
    // Lengths in units of the blur that all members share.
    let unit = greatest_px * sqrt(appearance.stretch) / sqrt(h2 + narrowest * narrowest);
    let tau = peak_of(kernels, appearance, h2);
    // The error of a lone cluster; and of many behind one another, whose errors have either sign.
    var alone = sqrt(sqrt(tau));
    if is_above(1.0, tau) {
        alone = tau;
    }
    let many = MANY_SHARE * sqrt(min_number(tau, 1.0));
    var varied = 0.0;
    var unlike = 0.0;
    if kernels.slope != 0.0 {
        varied = kernels.slope * bounds.spread;
        unlike = kernels.slope * bounds.uneven;
    }
    let contrast = min_number(bounds.colour + varied, 1.0);
    let blurred = CONTRAST_SHARE * bounds.second * unit * many;
    // Values are classified as if they were evenly distributed; all clusters along a ray may be alike.
    let misread = MISREAD_SHARE * min_number(unlike, 1.0);
    // Clusters side by side form a layer of this depth, in which front and back become one colour. The
    // visible layers all err to the same side.
    let layer = kernels.mass / (4.0 * bounds.second * bounds.second);
    let trend = min_number(contrast, TREND * sqrt(layer));
    let mixed = min_number(MIXED_SHARE * layer, 1.0) * trend;
    let of_one = alone * merge_shape(bounds.third * unit, bounds.fourth * unit);
    let of_many = many * merge_shape(bounds.third_mean * unit, bounds.fourth * unit);
    return max_number(of_one, of_many) + contrast * blurred + mixed + misread;
}

fn merge_shape(third: f32, fourth: f32) -> f32 {
    let square = fourth * fourth;
    return MERGE_THIRD * (third * third * third) + MERGE_FOURTH * (square * square);
}
