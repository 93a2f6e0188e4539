// Implements IEEE 754 double precision in integers: a number is its 64 bits, x the low and y the high
// word. It serves differences that must be taken before narrowing. Compilers may reassociate the sums of
// floats that would split a number in two, so it uses integers.
//
// Sums, products, quotients and roots are rounded to nearest, ties to even, as f64's own. Denormals count
// as zeros, and every NaN is the same NaN. Twin: Rust's f64.

const F64_INFINITY: vec2<u32> = vec2<u32>(0u, 0x7ff00000u);
const F64_NAN: vec2<u32> = vec2<u32>(0u, 0x7ff80000u);
const F64_LEAST_NORMAL: vec2<u32> = vec2<u32>(0u, 0x00100000u);
const F64_SIGN: u32 = 0x80000000u;

// Words of 64 bits.

fn u64_add(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2<u32>(low, a.y + b.y + select(0u, 1u, low < a.x));
}

fn u64_sub(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return vec2<u32>(a.x - b.x, a.y - b.y - select(0u, 1u, a.x < b.x));
}

fn u64_less(a: vec2<u32>, b: vec2<u32>) -> bool {
    return a.y < b.y || (a.y == b.y && a.x < b.x);
}

// Returns the greater of two.
fn u64_max(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return select(a, b, u64_less(a, b));
}

// Shifts by less than 64 places.
fn u64_shift_left(a: vec2<u32>, places: u32) -> vec2<u32> {
    if places == 0u {
        return a;
    }
    if places < 32u {
        return vec2<u32>(a.x << places, (a.y << places) | (a.x >> (32u - places)));
    }
    return vec2<u32>(0u, a.x << (places - 32u));
}

// Shifts by any number of places. Ones that are shifted out set the lowest place, so that rounding
// accounts for them.
fn u64_shift_right(a: vec2<u32>, places: u32) -> vec2<u32> {
    if places == 0u {
        return a;
    }
    if places < 32u {
        let lost = u32((a.x << (32u - places)) != 0u);
        return vec2<u32>((a.x >> places) | (a.y << (32u - places)) | lost, a.y >> places);
    }
    if places < 64u {
        let kept = a.y >> (places - 32u);
        let lost = u32(a.x != 0u || (kept << (places - 32u)) != a.y);
        return vec2<u32>(kept | lost, 0u);
    }
    return vec2<u32>(u32((a.x | a.y) != 0u), 0u);
}

// Returns the leading zeros of a word that is not zero.
fn u64_leading_zeros(a: vec2<u32>) -> u32 {
    if a.y == 0u {
        return 32u + countLeadingZeros(a.x);
    }
    return countLeadingZeros(a.y);
}

// Returns the whole product of two words of 32 bits, computed by halves.
fn u32_product(a: u32, b: u32) -> vec2<u32> {
    let a_low = a & 0xffffu;
    let a_high = a >> 16u;
    let b_low = b & 0xffffu;
    let b_high = b >> 16u;
    let low = a_low * b_low;
    let middle = a_high * b_low + (low >> 16u);
    let other = a_low * b_high + (middle & 0xffffu);
    return vec2<u32>(
        (other << 16u) | (low & 0xffffu),
        a_high * b_high + (middle >> 16u) + (other >> 16u),
    );
}

// Parts of a number.

fn f64_is_special(a: vec2<u32>) -> bool {
    return (a.y & 0x7ff00000u) == 0x7ff00000u;
}

fn f64_is_nan(a: vec2<u32>) -> bool {
    return f64_is_special(a) && ((a.y & 0xfffffu) | a.x) != 0u;
}

// Denormals count as zeros.
fn f64_is_zero(a: vec2<u32>) -> bool {
    return (a.y & 0x7ff00000u) == 0u;
}

fn f64_exponent(a: vec2<u32>) -> i32 {
    return i32((a.y >> 20u) & 0x7ffu) - 1023;
}

// Returns the 53 digits, the first in bit 63.
fn f64_significand(a: vec2<u32>) -> vec2<u32> {
    return u64_shift_left(vec2<u32>(a.x, (a.y & 0xfffffu) | 0x100000u), 11u);
}

// Returns the number of this sign (bit 31) whose digits are `significand`, with bit 63 worth 2^exponent.
fn f64_round(sign: u32, exponent: i32, significand: vec2<u32>) -> vec2<u32> {
    if (significand.x | significand.y) == 0u {
        return vec2<u32>(0u, sign);
    }
    let zeros = u64_leading_zeros(significand);
    let digits = u64_shift_left(significand, zeros);
    var e = exponent - i32(zeros);
    // Half a unit of bit 11, less one where that bit is even: ties go to even.
    var rounded = u64_add(digits, vec2<u32>(0x3ffu + ((digits.x >> 11u) & 1u), 0u));
    if u64_less(rounded, digits) {
        rounded = vec2<u32>(0u, 0x80000000u);
        e = e + 1;
    }
    if e > 1023 {
        return vec2<u32>(0u, sign | F64_INFINITY.y);
    }
    if e < -1022 {
        return vec2<u32>(0u, sign);
    }
    return vec2<u32>(
        (rounded.x >> 11u) | (rounded.y << 21u),
        sign | (u32(e + 1023) << 20u) | ((rounded.y >> 11u) & 0xfffffu),
    );
}

// Arithmetic.

fn f64_negate(a: vec2<u32>) -> vec2<u32> {
    return vec2<u32>(a.x, a.y ^ F64_SIGN);
}

fn f64_add(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let is_difference = ((a.y ^ b.y) & F64_SIGN) != 0u;
    if f64_is_special(a) || f64_is_special(b) {
        let is_undefined = f64_is_special(a) && f64_is_special(b) && is_difference;
        if f64_is_nan(a) || f64_is_nan(b) || is_undefined {
            return F64_NAN;
        }
        return select(b, a, f64_is_special(a));
    }
    if f64_is_zero(a) && f64_is_zero(b) {
        return vec2<u32>(0u, a.y & b.y & F64_SIGN);
    }
    if f64_is_zero(b) {
        return a;
    }
    if f64_is_zero(a) {
        return b;
    }
    let is_swapped = u64_less(vec2<u32>(a.x, a.y & ~F64_SIGN), vec2<u32>(b.x, b.y & ~F64_SIGN));
    let greater = select(a, b, is_swapped);
    let lesser = select(b, a, is_swapped);
    let sign = greater.y & F64_SIGN;
    let exponent = f64_exponent(greater);
    // One place down, so that the sum does not overflow.
    let digits = u64_shift_right(f64_significand(greater), 1u);
    let places = u32(exponent - f64_exponent(lesser)) + 1u;
    let others = u64_shift_right(f64_significand(lesser), places);
    if is_difference {
        let difference = u64_sub(digits, others);
        let is_nothing = (difference.x | difference.y) == 0u;
        return f64_round(select(sign, 0u, is_nothing), exponent + 1, difference);
    }
    return f64_round(sign, exponent + 1, u64_add(digits, others));
}

fn f64_sub(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return f64_add(a, f64_negate(b));
}

fn f64_mul(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let sign = (a.y ^ b.y) & F64_SIGN;
    if f64_is_special(a) || f64_is_special(b) {
        if f64_is_nan(a) || f64_is_nan(b) || f64_is_zero(a) || f64_is_zero(b) {
            return F64_NAN;
        }
        return vec2<u32>(0u, sign | F64_INFINITY.y);
    }
    if f64_is_zero(a) || f64_is_zero(b) {
        return vec2<u32>(0u, sign);
    }
    let p = f64_significand(a);
    let q = f64_significand(b);
    let low = u32_product(p.x, q.x);
    // Neither sum overflows: (2^32 - 1)² + 2^32 - 1 < 2^64.
    let middle = u64_add(u32_product(p.x, q.y), vec2<u32>(low.y, 0u));
    let other = u64_add(u32_product(p.y, q.x), vec2<u32>(middle.x, 0u));
    let high = u64_add(
        u64_add(u32_product(p.y, q.y), vec2<u32>(middle.y, 0u)),
        vec2<u32>(other.y, 0u),
    );
    let lost = u32((low.x | other.x) != 0u);
    return f64_round(sign, f64_exponent(a) + f64_exponent(b) + 1, vec2<u32>(high.x | lost, high.y));
}

// Number of digits that quotients and roots are computed to: 53, those that normalising may shift out,
// and one for the half.
const F64_LONG_DIGITS: u32 = 56u;

fn f64_div(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let sign = (a.y ^ b.y) & F64_SIGN;
    let is_undefined = (f64_is_zero(a) && f64_is_zero(b)) || (f64_is_special(a) && f64_is_special(b));
    if f64_is_nan(a) || f64_is_nan(b) || is_undefined {
        return F64_NAN;
    }
    if f64_is_special(a) || f64_is_zero(b) {
        return vec2<u32>(0u, sign | F64_INFINITY.y);
    }
    if f64_is_zero(a) || f64_is_special(b) {
        return vec2<u32>(0u, sign);
    }
    // Long division, digit by digit.
    let divisor = u64_shift_right(f64_significand(b), 11u);
    var rest = u64_shift_right(f64_significand(a), 11u);
    var quotient = vec2<u32>(0u);
    for (var i = 0u; i < F64_LONG_DIGITS; i = i + 1u) {
        quotient = u64_shift_left(quotient, 1u);
        if !u64_less(rest, divisor) {
            rest = u64_sub(rest, divisor);
            quotient.x = quotient.x | 1u;
        }
        rest = u64_shift_left(rest, 1u);
    }
    quotient.x = quotient.x | u32((rest.x | rest.y) != 0u);
    let exponent = f64_exponent(a) - f64_exponent(b) + i32(64u - F64_LONG_DIGITS);
    return f64_round(sign, exponent, quotient);
}

fn f64_sqrt(a: vec2<u32>) -> vec2<u32> {
    if f64_is_zero(a) {
        return vec2<u32>(0u, a.y & F64_SIGN);
    }
    if f64_is_nan(a) || (a.y & F64_SIGN) != 0u {
        return F64_NAN;
    }
    if f64_is_special(a) {
        return a;
    }
    // Two digits before the point and an even exponent.
    let is_odd = (f64_exponent(a) & 1) != 0;
    var digits = f64_significand(a);
    if !is_odd {
        digits = u64_shift_right(digits, 1u);
    }
    let exponent = (f64_exponent(a) - i32(is_odd)) / 2;
    // Digit by digit: two digits of the number for each of the root.
    var rest = vec2<u32>(0u);
    var root = vec2<u32>(0u);
    for (var i = 0u; i < F64_LONG_DIGITS; i = i + 1u) {
        rest = u64_shift_left(rest, 2u);
        rest.x = rest.x | (digits.y >> 30u);
        digits = u64_shift_left(digits, 2u);
        var trial = u64_shift_left(root, 2u);
        trial.x = trial.x | 1u;
        root = u64_shift_left(root, 1u);
        if !u64_less(rest, trial) {
            rest = u64_sub(rest, trial);
            root.x = root.x | 1u;
        }
    }
    root.x = root.x | u32((rest.x | rest.y) != 0u);
    return f64_round(0u, exponent + i32(64u - F64_LONG_DIGITS), root);
}

// Returns x*x' + y*y' + z*z', summed from the left.
fn f64_dot(a: array<vec2<u32>, 3>, b: array<vec2<u32>, 3>) -> vec2<u32> {
    var p = a;
    var q = b;
    // -0 changes no number that is added to it.
    var sum = vec2<u32>(0u, F64_SIGN);
    for (var i = 0u; i < 3u; i = i + 1u) {
        sum = f64_add(sum, f64_mul(p[i], q[i]));
    }
    return sum;
}

// Order.

// Maps numbers to words in the same order.
fn f64_ordered(a: vec2<u32>) -> vec2<u32> {
    return select(vec2<u32>(a.x, a.y ^ F64_SIGN), ~a, (a.y & F64_SIGN) != 0u);
}

// The inverse of `f64_ordered`.
fn f64_of_ordered(a: vec2<u32>) -> vec2<u32> {
    return select(~a, vec2<u32>(a.x, a.y ^ F64_SIGN), (a.y & F64_SIGN) != 0u);
}

// Returns the greater of two; if one is NaN, the other.
fn f64_max(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    if f64_is_nan(a) {
        return b;
    }
    if f64_is_nan(b) {
        return a;
    }
    return select(a, b, u64_less(f64_ordered(a), f64_ordered(b)));
}

// Returns the lesser of two; if one is NaN, the other.
fn f64_min(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return f64_negate(f64_max(f64_negate(a), f64_negate(b)));
}

// Returns a >= 0; false for NaN.
fn f64_is_at_least_zero(a: vec2<u32>) -> bool {
    return !f64_is_nan(a) && ((a.y & F64_SIGN) == 0u || f64_is_zero(a));
}

// Conversion to and from other types.

fn f64_from_f32(x: f32) -> vec2<u32> {
    let bits = bitcast<u32>(x);
    let sign = bits & F64_SIGN;
    let field = (bits >> 23u) & 0xffu;
    let fraction = bits & 0x7fffffu;
    if field == 0xffu {
        return select(F64_NAN, vec2<u32>(0u, sign | F64_INFINITY.y), fraction == 0u);
    }
    // A denormal has no leading one, and the exponent of the least normal number.
    let digits = (fraction | select(0x800000u, 0u, field == 0u)) << 8u;
    return f64_round(sign, i32(max(field, 1u)) - 127, vec2<u32>(0u, digits));
}

// Rounds to nearest, ties to even, including denormals.
fn f64_to_f32(a: vec2<u32>) -> f32 {
    let sign = a.y & F64_SIGN;
    if f64_is_nan(a) {
        return bitcast<f32>(0x7fc00000u | sign);
    }
    if f64_is_zero(a) {
        return bitcast<f32>(sign);
    }
    let exponent = f64_exponent(a);
    if exponent > 127 {
        return bitcast<f32>(0x7f800000u | sign);
    }
    // 24 digits, or fewer for a denormal, and 8 to be rounded.
    let below = u32(max(-126 - exponent, 0));
    let digits = u64_shift_right(f64_significand(a), 32u + below).x;
    let rest = digits & 0xffu;
    var rounded = digits >> 8u;
    rounded = rounded + u32(rest > 0x80u || (rest == 0x80u && (rounded & 1u) != 0u));
    // Added, so that a carry increments the exponent.
    let field = u32(max(exponent + 126, 0)) << 23u;
    return bitcast<f32>(sign | (field + rounded));
}

// Truncates towards zero, clamped to the range of u32; NaN gives 0.
fn f64_to_u32(a: vec2<u32>) -> u32 {
    let exponent = f64_exponent(a);
    if f64_is_nan(a) || (a.y & F64_SIGN) != 0u || exponent < 0 {
        return 0u;
    }
    if exponent > 31 {
        return 0xffffffffu;
    }
    return f64_significand(a).y >> u32(31 - exponent);
}
