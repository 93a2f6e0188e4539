// Computes the means of footprints over pixels, for sums of columns. Twin: src/splat/pixel_mean.rs.

struct PixelMean {
    // True if the footprint is averaged over pixels rather than sampled at their centres.
    is_mean: bool,
    has_rows: bool,
    is_sampled: bool,
    mass: f32,
    sigma: f32,
    per_sigma: f32,
    slope: f32,
    variance: f32,
    per_across: f32,
}

struct Band {
    mass: f32,
    mean: f32,
    per_sigma: f32,
}

// Returns Phi(x) within 3e-7. Twin: `cdf_near` in src/math/lane.rs.
fn cdf_near(place: f32) -> f32 {
    let x = clamp(place, -CDF_REACH, CDF_REACH);
    let u = x * x * (2.0 / (CDF_REACH * CDF_REACH)) - 1.0;
    var series = CDF_SERIES[12];
    series = series * u + CDF_SERIES[11];
    series = series * u + CDF_SERIES[10];
    series = series * u + CDF_SERIES[9];
    series = series * u + CDF_SERIES[8];
    series = series * u + CDF_SERIES[7];
    series = series * u + CDF_SERIES[6];
    series = series * u + CDF_SERIES[5];
    series = series * u + CDF_SERIES[4];
    series = series * u + CDF_SERIES[3];
    series = series * u + CDF_SERIES[2];
    series = series * u + CDF_SERIES[1];
    series = series * u + CDF_SERIES[0];
    return x * series + 0.5;
}

fn pixel_mean_of(low_pass_variance_px2: f32, p: vec2<f32>, r: vec2<f32>, peak: f32) -> PixelMean {
    var own = PixelMean();
    if low_pass_variance_px2 != PIXEL_VARIANCE_PX2 {
        return own;
    }
    // The inverse of the widened variance.
    let xx = p.x * p.x + r.x * r.x;
    let xy = p.x * p.y + r.x * r.y;
    let yy = p.y * p.y + r.y * r.y;
    let half = 0.5 * (xx + yy);
    let turn = 0.5 * (xx - yy);
    let sharpest = half + sqrt(turn * turn + xy * xy);
    if !(sharpest * SAMPLED_FROM_PX2 > 1.0) {
        return own;
    }
    let per_determinant = p.x * r.y - p.y * r.x;
    let determinant = 1.0 / (per_determinant * per_determinant);
    let mass = peak * TAU / abs(per_determinant);
    own.has_rows = xx >= yy;
    let sharp = select(yy, xx, own.has_rows);
    let wide = sharp * determinant;
    let covariance = -xy * determinant;
    if !(is_finite(wide) && is_finite(mass)) {
        return own;
    }
    let least = LEAST_MEAN_SIGMA_PX * LEAST_MEAN_SIGMA_PX;
    own.is_mean = true;
    own.is_sampled = wide >= SAMPLED_FROM_PX2;
    let narrowed = max(wide - PIXEL_VARIANCE_PX2, least);
    let widened_slope = covariance / wide;
    var spread = wide;
    var taken = PIXEL_VARIANCE_PX2;
    own.slope = widened_slope;
    if !own.is_sampled {
        spread = narrowed;
        own.slope = covariance / narrowed;
        taken = PIXEL_VARIANCE_PX2 * (1.0 + own.slope * widened_slope);
    }
    own.variance = max(1.0 / sharp - taken, least);
    own.sigma = sqrt(spread);
    own.per_sigma = 1.0 / own.sigma;
    own.per_across = 1.0 / sqrt(own.variance);
    let whole = select(
        CDF_WHOLE * CDF_WHOLE,
        CDF_WHOLE * FRAC_1_SQRT_2PI * own.per_sigma,
        own.is_sampled,
    );
    own.mass = mass * whole;
    return own;
}

fn band_at(own: PixelMean, d: f32) -> Band {
    if own.is_sampled {
        let t = d * own.per_sigma;
        return Band(own.mass * exp_minus_half(min(t * t, 49.0)), own.slope * d, own.per_across);
    }
    var begin = (d - 0.5) * own.per_sigma;
    var end = (d + 0.5) * own.per_sigma;
    let mass = own.mass * (cdf_near(end) - cdf_near(begin));
    begin = max(begin, -BAND_REACH);
    end = min(end, BAND_REACH);
    if own.slope == 0.0 || !(begin < end) {
        return Band(mass, 0.0, own.per_across);
    }
    let middle = 0.5 * (begin + end);
    let half = 0.5 * (end - begin);
    // Position in the band at which the density is greatest.
    let top = max(begin, min(end, 0.0));
    let least = top * top;
    var sum = 0.0;
    var first = 0.0;
    var second = 0.0;
    var nodes = BAND_NODES;
    for (var n = 0u; n < 4u; n = n + 1u) {
        let u = nodes[2u * n] * half;
        let weight = nodes[2u * n + 1u];
        let before = middle - u;
        let behind = middle + u;
        let low = weight * exp_minus_half(max(before * before - least, 0.0));
        let high = weight * exp_minus_half(max(behind * behind - least, 0.0));
        sum = sum + low + high;
        first = first + u * (high - low);
        second = second + u * u * (high + low);
    }
    let mean = first / sum;
    let spread = max(second / sum - mean * mean, 0.0);
    let scale = own.slope * own.sigma;
    let variance = own.variance + scale * scale * spread;
    return Band(mass, scale * (middle + mean), 1.0 / sqrt(variance));
}

// Returns the mean over the pixel whose centre lies `d` from the footprint's, px.
fn mean_at(own: PixelMean, d: vec2<f32>) -> f32 {
    let along = select(d.x, d.y, own.has_rows);
    let across = select(d.y, d.x, own.has_rows);
    let band = band_at(own, along);
    let begin = ((across - 0.5) - band.mean) * band.per_sigma;
    let end = ((across + 0.5) - band.mean) * band.per_sigma;
    return band.mass * (cdf_near(end) - cdf_near(begin));
}
