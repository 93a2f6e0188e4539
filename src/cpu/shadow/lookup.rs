//! Looks up the transmittance from a light to a particle. Twin: `shaders/shared/shadow.wgsl`.

use glam::{Vec2, Vec3, Vec4};

use crate::math::Factor;
use crate::record::LightShadow;

/// Number of directions that stand for a light with a size.
pub(crate) const SHADOW_DIRECTIONS: usize = 16;

/// Directions that stand for a light with a size: points of a Gaussian of unit variance along each axis, each
/// of equal weight, along a spiral.
pub(crate) const SHADOW_TAPS: [[f32; 2]; SHADOW_DIRECTIONS] = [
    [0.323_183_57, 0.100_664_295],
    [-0.321_919_86, 0.339_597_23],
    [0.099_272_68, -0.458_415_06],
    [0.518_701_9, 0.636_265],
    [-0.848_880_1, -0.108_543_49],
    [0.905_107, -0.323_264_96],
    [-0.252_745_6, 0.987_643_7],
    [-0.534_912_6, -0.891_218_07],
    [1.330_460_9, 0.562_333],
    [-1.339_423_1, 0.472_365_65],
    [0.732_434_3, -1.113_704_8],
    [0.573_480_3, 1.541_993_1],
    [-1.637_688_8, -0.846_942_4],
    [2.138_625, -0.168_791_04],
    [-1.351_345_5, 1.660_336_5],
    [-0.334_350_05, -2.390_318_6],
];

/// The steepest slope by which a surface is followed from a particle to the texels around it.
pub(crate) const STEEPEST_SHADOW: f32 = 4.0;

/// Greatest number of standard deviations by which a kernel's visible part lies before its centre.
pub(crate) const GREATEST_LEAN: f32 = 1.0;

/// Distance of the places at which a kernel is lit from the middle of its visible part, standard deviations: the
/// six places on the axes of a Gaussian in space, of equal weight, give the mean of any cubic polynomial.
const SQRT_3: f32 = 1.732_050_8;

/// Returns the share of a light's colour that reaches a kernel: the mean over the kernel's visible part.
///
/// The grid's optical depth includes the kernel's own. The mean transmittance is taken over the kernel's
/// extent, at six places. An opaque kernel shows its side toward the eye: where the optical depth grows by k
/// per standard deviation, the visible part of a Gaussian is centred k deviations before the centre, at most
/// [`GREATEST_LEAN`]. In a cloud of 300 kernels with optical depths up to 1, the transmittance at the centre errs by
/// .20 (root mean square of what is visible), the mean along the light by .18, and this by .06.
///
/// - `at`: its centre, camera space.
/// - `to_eye`: unit vector.
#[inline]
pub(crate) fn kernel_transmittance(
    shadow: &LightShadow,
    words: &[f32],
    at: Vec3,
    factor: &Factor,
    to_eye: Vec3,
) -> f32 {
    let place = cells(shadow, at);
    if shadow.size[2] == 0 {
        return passed_surfaces(shadow, words, place, Vec2::ZERO);
    }
    let away = Vec4::from(shadow.to_cells[2]).truncate();
    let reach = SQRT_3 * along(factor, away).length();
    let up_to = |place: Vec3| optical_depth(shadow, words, place);
    let change = up_to(place + Vec3::Z * reach) - up_to(place - Vec3::Z * reach);
    let of_eye = along(factor, to_eye);
    let sigma = of_eye.length().max(f32::MIN_POSITIVE);
    // V v / sqrt(v V v): one standard deviation toward the eye.
    let toward = Vec3::new(
        factor.x.dot(of_eye),
        factor.y.dot(of_eye),
        factor.z.dot(of_eye),
    ) / sigma;
    let per_cell = change / (2.0 * reach.max(0.5));
    let scale = away.length();
    // Behind an occluder a soft light comes back.
    let lean = (per_cell * scale * sigma).clamp(0.0, GREATEST_LEAN);
    let seen = place + turned(shadow, toward) * lean;
    let mut sum = 0.0;
    for column in factor.columns() {
        let step = turned(shadow, column) * SQRT_3;
        sum += (-up_to(seen - step)).exp() + (-up_to(seen + step)).exp();
    }
    passed_surfaces(shadow, words, seen, Vec2::ZERO) * (sum * (1.0 / 6.0))
}

/// Returns the share of a light's colour that reaches a surfel.
///
/// - `at`: its centre, camera space.
/// - `plane`: unit normal of its plane, camera space, on either side; zero for none.
/// - `is_sheet`: whether surfels absorb, so that the grid has their own depth: it is looked up a cell before them.
#[inline]
pub(crate) fn surfel_transmittance(
    shadow: &LightShadow,
    words: &[f32],
    at: Vec3,
    plane: Vec3,
    is_sheet: bool,
) -> f32 {
    let mut place = cells(shadow, at);
    // Directions do not depend on the scale.
    let mut normal = turned(shadow, plane);
    let length = normal.length().max(f32::MIN_POSITIVE);
    normal /= length;
    if normal.z > 0.0 {
        normal = -normal;
    }
    let before = if is_sheet {
        normal - Vec3::Z
    } else {
        Vec3::ZERO
    };
    let volumes = (-optical_depth(shadow, words, place + before)).exp();
    place += normal * shadow.bias;
    place.z -= shadow.bias;
    let steepness = 1.0 / (-normal.z).max(1.0 / STEEPEST_SHADOW);
    let slope = Vec2::new(normal.x, normal.y) * steepness;
    volumes * passed_surfaces(shadow, words, place, slope)
}

/// Returns Fᵀ n for a kernel's factor F.
#[inline]
fn along(factor: &Factor, n: Vec3) -> Vec3 {
    factor.x * n.x + factor.y * n.y + factor.z * n.z
}

/// Returns a point of camera space in cells.
#[inline]
fn cells(shadow: &LightShadow, at: Vec3) -> Vec3 {
    let [x, y, z] = shadow
        .to_cells
        .map(|[a, b, c, d]| a * at.x + b * at.y + c * at.z + d);
    Vec3::new(x, y, z)
}

/// Returns a vector of camera space in cells.
#[inline]
fn turned(shadow: &LightShadow, v: Vec3) -> Vec3 {
    let [x, y, z] = shadow
        .to_cells
        .map(|[a, b, c, _]| a * v.x + b * v.y + c * v.z);
    Vec3::new(x, y, z)
}

/// Returns the optical depth of volumes from the light to a place: trilinear between the grid's numbers.
#[inline]
fn optical_depth(shadow: &LightShadow, words: &[f32], place: Vec3) -> f32 {
    let [columns, rows, layers] = shadow.size;
    if layers == 0 {
        return 0.0;
    }
    let x = (place.x - 0.5).clamp(0.0, (columns - 1) as f32);
    let y = (place.y - 0.5).clamp(0.0, (rows - 1) as f32);
    let z = place.z.clamp(0.0, layers as f32);
    let (i, j, k) = (
        (x as u32).min(columns - 2),
        (y as u32).min(rows - 2),
        (z as u32).min(layers - 1),
    );
    let (fx, fy, fz) = (x - i as f32, y - j as f32, z - k as f32);
    let column = |i: u32, j: u32| {
        let word = shadow.first + (j * columns + i) * (layers + 1) + k;
        let [a, b] = [words[word as usize], words[word as usize + 1]];
        a + (b - a) * fz
    };
    let [a, b] = [column(i, j), column(i + 1, j)];
    let [c, d] = [column(i, j + 1), column(i + 1, j + 1)];
    let (near, far) = (a + (b - a) * fx, c + (d - c) * fx);
    near + (far - near) * fy
}

/// Returns the share of a light that opaque surfaces let pass to a place.
///
/// - `slope`: change of z along x and y on the receiver's own surface.
#[inline]
fn passed_surfaces(shadow: &LightShadow, words: &[f32], place: Vec3, slope: Vec2) -> f32 {
    if shadow.map_size[0] == 0 {
        return 1.0;
    }
    if shadow.softness == 0.0 {
        return passed_texels(shadow, words, place, slope, Vec2::ZERO);
    }
    // Surfaces before the receiver, seen from it: the mean distance of those that hide the light.
    let mut sum = 0.0;
    let mut count = 0.0;
    let farthest = shadow.softness * place.z.max(0.0);
    for tap in SHADOW_TAPS {
        let shift = Vec2::from(tap) * farthest;
        let before = place.z + slope.dot(shift) - nearest_surface(shadow, words, place, shift);
        if before > 0.0 {
            sum += before;
            count += 1.0;
        }
    }
    if count == 0.0 {
        return 1.0;
    }
    let width = shadow.softness * (sum / count);
    let mut passed = 0.0;
    for tap in SHADOW_TAPS {
        passed += passed_texels(shadow, words, place, slope, Vec2::from(tap) * width);
    }
    passed * (1.0 / SHADOW_DIRECTIONS as f32)
}

/// Returns the depth of the surface nearest to the light at the texel of a place moved by `shift`; beyond all
/// if there is none.
#[inline]
fn nearest_surface(shadow: &LightShadow, words: &[f32], place: Vec3, shift: Vec2) -> f32 {
    let corner = Vec2::from(shadow.map_corner);
    let texel = (place.truncate() + shift - corner) * shadow.map_scale;
    let [columns, rows] = shadow.map_size;
    // Phrased so that NaN is outside.
    let is_inside =
        texel.x >= 0.0 && texel.y >= 0.0 && texel.x < columns as f32 && texel.y < rows as f32;
    if !is_inside {
        return f32::MAX;
    }
    words[(shadow.map_first + texel.y as u32 * columns + texel.x as u32) as usize]
}

/// Returns the share of the four texels around a place moved by `shift` whose surfaces do not hide the
/// receiver: bilinear between zeros and ones.
#[inline]
fn passed_texels(
    shadow: &LightShadow,
    words: &[f32],
    place: Vec3,
    slope: Vec2,
    shift: Vec2,
) -> f32 {
    let corner = Vec2::from(shadow.map_corner);
    let per_texel = 1.0 / shadow.map_scale;
    let at = (place.truncate() + shift - corner) * shadow.map_scale - 0.5;
    let f = at - at.floor();
    let first = shift - f * per_texel;
    let passes = |i: f32, j: f32| {
        let step = first + Vec2::new(i, j) * per_texel;
        let surface = nearest_surface(shadow, words, place, step);
        let is_hidden = place.z + slope.dot(step) > surface;
        if is_hidden { 0.0 } else { 1.0 }
    };
    let (a, b) = (passes(0.0, 0.0), passes(1.0, 0.0));
    let (c, d) = (passes(0.0, 1.0), passes(1.0, 1.0));
    let (near, far) = (a + (b - a) * f.x, c + (d - c) * f.x);
    near + (far - near) * f.y
}
