//! Computes FLIP for low dynamic range (P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström,
//! M. Fairchild, *FLIP: A Difference Evaluator for Alternating Images*, 2020).
//!
//! FLIP estimates the difference that a viewer sees when switching between two images: a colour difference
//! after the eye's contrast sensitivity, raised where edges or points differ. Constants are the paper's;
//! filters are applied separably, as in its authors' later versions.

use super::band::{Band, displayed_rows, sum_over_bands};
use crate::image::Image;

/// Pixels per degree of the paper's viewer: 3840 pixels over .7 m, seen from .7 m.
pub const FLIP_PIXELS_PER_DEGREE: f64 = 67.020_643_276_582_25;

/// Contrast sensitivity as sums of Gaussians (table 1): (a, b) of a sqrt(π/b) exp(-π² x²/b), x in
/// degrees; one for achromatic, one for red-green, two for blue-yellow.
const CSF_ACHROMATIC: (f64, f64) = (1.0, 0.0047);
const CSF_RED_GREEN: (f64, f64) = (1.0, 0.0053);
const CSF_BLUE_YELLOW: [(f64, f64); 2] = [(34.1, 0.04), (13.5, 0.025)];
/// Exponent of the colour difference, q_c.
const COLOUR_EXPONENT: f64 = 0.7;
/// Differences below this share of the greatest one (p_c) map to \[0, p_t\].
const COLOUR_SHARE: f64 = 0.4;
const COLOUR_SHARE_MAPPED: f64 = 0.95;
/// Width of the feature detectors in degrees, w.
const FEATURE_WIDTH_DEG: f64 = 0.082;
/// Exponent of the feature difference, q_f.
const FEATURE_EXPONENT: f64 = 0.5;

/// CIE XYZ of linear sRGB, D65.
const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [
        10_135_552.0 / 24_577_794.0,
        8_788_810.0 / 24_577_794.0,
        4_435_075.0 / 24_577_794.0,
    ],
    [
        2_613_072.0 / 12_288_897.0,
        8_788_810.0 / 12_288_897.0,
        887_015.0 / 12_288_897.0,
    ],
    [
        1_425_312.0 / 73_733_382.0,
        8_788_810.0 / 73_733_382.0,
        70_074_185.0 / 73_733_382.0,
    ],
];
/// Inverse of [`XYZ_FROM_RGB`].
const RGB_FROM_XYZ: [[f64; 3]; 3] = [
    [3.241_003_275, -1.537_398_934, -0.498_615_861],
    [-0.969_224_334, 1.875_930_071, 0.041_554_224],
    [0.055_639_423, -0.204_011_202, 1.057_148_933],
];

/// Greatest number of pixels per degree, which limits the length of filters to a thousand pixels.
const MOST_PIXELS_PER_DEGREE: f64 = 1000.0;

/// Returns the mean FLIP of two images of one size: 0 for equal ones, at most 1.
///
/// The images are put over black and clamped to 0..1. `pixels_per_degree` is the angular resolution for the
/// viewer, usually [`FLIP_PIXELS_PER_DEGREE`]. Pixels beyond the border repeat the outermost, so that any image
/// with a pixel has a figure. Returns `None` without pixels, for images that lack some, and for
/// `pixels_per_degree` outside 0 to a thousand.
pub fn flip(first: &Image, second: &Image, pixels_per_degree: f64) -> Option<f64> {
    let (width, height) = (first.width, first.height);
    if (width, height) != (second.width, second.height) || width.min(height) == 0 {
        return None;
    }
    // Phrased so that NaN returns None.
    let is_seen = pixels_per_degree > 0.0 && pixels_per_degree <= MOST_PIXELS_PER_DEGREE;
    if !(is_seen && first.is_whole() && second.is_whole()) {
        return None;
    }
    let filters = Filters::new(pixels_per_degree);
    let greatest = greatest_difference();
    let sum = sum_over_bands(0..height, |rows| {
        let a = Seen::new(first, &rows, &filters);
        let b = Seen::new(second, &rows, &filters);
        let mut sum = 0.0;
        for i in 0..rows.len() * width {
            let colour = spread(hyab(a.colour(i), b.colour(i)), greatest);
            let feature = (a.edge(i) - b.edge(i))
                .abs()
                .max((a.point(i) - b.point(i)).abs());
            let feature = (feature / std::f64::consts::SQRT_2).powf(FEATURE_EXPONENT);
            // The exponent is at most 1, so feature differences raise the result.
            sum += colour.powf(1.0 - feature);
        }
        sum
    });
    Some(sum / (width * height) as f64)
}

/// Weights of all filters, of one length.
struct Filters {
    radius: usize,
    achromatic: Vec<f64>,
    red_green: Vec<f64>,
    blue_yellow: [Vec<f64>; 2],
    /// A Gaussian and its first and second derivative.
    feature: [Vec<f64>; 3],
}

impl Filters {
    fn new(pixels_per_degree: f64) -> Self {
        use std::f64::consts::PI;
        let feature_sigma = 0.5 * FEATURE_WIDTH_DEG * pixels_per_degree;
        // exp(-π² x²/b) has σ = sqrt(b / 2) / π degrees.
        let colour_sigma = (CSF_BLUE_YELLOW[0].1 / 2.0).sqrt() / PI * pixels_per_degree;
        let [colour_radius, feature_radius] = [colour_sigma, feature_sigma].map(radius);
        let radius = colour_radius.max(feature_radius);
        let taps = |reach: usize, weight: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let offsets = (0..=2 * radius).map(|i| i as f64 - radius as f64);
            offsets
                .map(|x| {
                    if x.abs() <= reach as f64 {
                        weight(x)
                    } else {
                        0.0
                    }
                })
                .collect()
        };
        // The square root of the 2D Gaussian's height, because the filter is applied along both axes.
        let csf = |(a, b): (f64, f64)| {
            let height = (a * (PI / b).sqrt()).sqrt();
            taps(colour_radius, &|x| {
                height * (-PI * PI * (x / pixels_per_degree).powi(2) / b).exp()
            })
        };
        let blue_yellow = CSF_BLUE_YELLOW.map(csf);
        // The two together sum to 1 over the plane.
        let squares = blue_yellow.iter().map(|w| w.iter().sum::<f64>().powi(2));
        let whole = squares.sum::<f64>().sqrt();
        let gaussian = |x: f64| (-0.5 * (x / feature_sigma).powi(2)).exp();
        Self {
            radius,
            achromatic: balanced(csf(CSF_ACHROMATIC)),
            red_green: balanced(csf(CSF_RED_GREEN)),
            blue_yellow: blue_yellow.map(|w| w.iter().map(|w| w / whole).collect()),
            feature: [
                balanced(taps(feature_radius, &gaussian)),
                balanced(taps(feature_radius, &|x| -x * gaussian(x))),
                balanced(taps(feature_radius, &|x| {
                    ((x / feature_sigma).powi(2) - 1.0) * gaussian(x)
                })),
            ],
        }
    }
}

/// Returns three standard deviations, rounded up to whole pixels.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "float casts saturate; a degree has few pixels"
)]
fn radius(sigma: f64) -> usize {
    (3.0 * sigma).ceil() as usize
}

/// Scales positive weights to a sum of 1, negative ones to -1.
fn balanced(mut weights: Vec<f64>) -> Vec<f64> {
    let positive: f64 = weights.iter().map(|w| w.max(0.0)).sum();
    let negative: f64 = weights.iter().map(|w| (-w).max(0.0)).sum();
    for w in &mut weights {
        *w /= if *w > 0.0 {
            positive
        } else if *w < 0.0 {
            negative
        } else {
            1.0
        };
    }
    weights
}

/// A band of one image as the eye filters it.
struct Seen {
    achromatic: Vec<f64>,
    red_green: Vec<f64>,
    blue_yellow: [Vec<f64>; 2],
    edges: [Vec<f64>; 2],
    points: [Vec<f64>; 2],
}

impl Seen {
    fn new(image: &Image, rows: &std::ops::Range<usize>, filters: &Filters) -> Self {
        let mut channels = [(); 3].map(|()| Vec::new());
        for rgb in displayed_rows(image, rows, filters.radius) {
            for (channel, value) in channels.iter_mut().zip(ycxcz_from_linear(rgb)) {
                channel.push(value);
            }
        }
        let [y, cx, cz] = channels.map(|values| Band::new(image.width, values));
        let luminance = Band::new(
            image.width,
            y.values.iter().map(|y| (y + 16.0) / 116.0).collect(),
        );
        let filtered = |band: &Band, h: &[f64], v: &[f64]| band.filtered(h, v).values;
        let [g, dg, ddg] = &filters.feature;
        Self {
            achromatic: filtered(&y, &filters.achromatic, &filters.achromatic),
            red_green: filtered(&cx, &filters.red_green, &filters.red_green),
            blue_yellow: [0, 1]
                .map(|i| filtered(&cz, &filters.blue_yellow[i], &filters.blue_yellow[i])),
            edges: [filtered(&luminance, dg, g), filtered(&luminance, g, dg)],
            points: [filtered(&luminance, ddg, g), filtered(&luminance, g, ddg)],
        }
    }

    /// Returns L*a*b* of the filtered colour, clamped to displayable values, with chroma scaled by lightness
    /// (the Hunt effect).
    fn colour(&self, i: usize) -> [f64; 3] {
        let blue_yellow = self.blue_yellow[0][i] + self.blue_yellow[1][i];
        let rgb = linear_from_ycxcz([self.achromatic[i], self.red_green[i], blue_yellow]);
        hunt_lab(rgb.map(|c| c.clamp(0.0, 1.0)))
    }

    fn edge(&self, i: usize) -> f64 {
        self.edges[0][i].hypot(self.edges[1][i])
    }

    fn point(&self, i: usize) -> f64 {
        self.points[0][i].hypot(self.points[1][i])
    }
}

fn product(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2])
}

/// Returns XYZ relative to white.
fn relative_xyz(rgb: [f64; 3]) -> [f64; 3] {
    let xyz = product(&XYZ_FROM_RGB, rgb);
    std::array::from_fn(|i| xyz[i] / XYZ_FROM_RGB[i].iter().sum::<f64>())
}

/// Converts to the linearised opponent space in which contrast sensitivity is defined.
fn ycxcz_from_linear(rgb: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = relative_xyz(rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn linear_from_ycxcz([y, cx, cz]: [f64; 3]) -> [f64; 3] {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    let xyz = std::array::from_fn(|i| relative[i] * XYZ_FROM_RGB[i].iter().sum::<f64>());
    product(&RGB_FROM_XYZ, xyz)
}

fn hunt_lab(rgb: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let [x, y, z] = relative_xyz(rgb).map(|t| {
        if t > DELTA.powi(3) {
            t.cbrt()
        } else {
            t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
        }
    });
    let lightness = 116.0 * y - 16.0;
    let chroma = 0.01 * lightness;
    [
        lightness,
        chroma * 500.0 * (x - y),
        chroma * 200.0 * (y - z),
    ]
}

/// Returns the HyAB distance, city-block in lightness and Euclidean in chroma, raised to q_c.
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    ((a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])).powf(COLOUR_EXPONENT)
}

/// Returns the greatest difference between two displayed colours: green against blue.
fn greatest_difference() -> f64 {
    hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0]))
}

/// Maps differences to 0..1, with most of the scale for the lesser ones.
fn spread(difference: f64, greatest: f64) -> f64 {
    let knee = COLOUR_SHARE * greatest;
    if difference < knee {
        difference * COLOUR_SHARE_MAPPED / knee
    } else {
        COLOUR_SHARE_MAPPED + (difference - knee) / (greatest - knee) * (1.0 - COLOUR_SHARE_MAPPED)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_images::{codes, constant, noise_code, noisy};
    use super::*;

    fn of(a: &Image, b: &Image) -> f64 {
        flip(a, b, FLIP_PIXELS_PER_DEGREE).unwrap()
    }

    /// Compares with the authors' C++ implementation at 67 pixels per degree.
    #[test]
    fn agrees_with_the_authors_implementation() {
        let image = |f: &dyn Fn(u32, u32) -> [u8; 3]| codes(48, 40, f);
        let disc = |cx: i32, cy: i32| {
            move |x: u32, y: u32| {
                let (dx, dy) = (x.cast_signed() - cx, y.cast_signed() - cy);
                if dx * dx + dy * dy <= 81 {
                    [230, 120, 30]
                } else {
                    [10, 20, 40]
                }
            }
        };
        let grey = image(&|_, _| [100; 3]);
        let noise = [1, 2].map(|seed| image(&|x, y| noise_code(seed, x, y)));
        let discs = [image(&disc(20, 20)), image(&disc(22, 19))];
        let byte = |n: u32| u8::try_from(n).unwrap();
        let gradient = image(&|x, y| [byte(x * 5), byte(y * 6), byte((x + y) * 2)]);
        let [black, white] = [0, 255].map(|c| image(&|_, _| [c; 3]));
        let [green, blue] = [[0, 255, 0], [0, 0, 255]].map(|c| image(&|_, _| c));
        let tiny = [1, 2].map(|seed| codes(7, 3, &|x, y| noise_code(seed, x, y)));
        for (name, a, b, expected) in [
            ("black, white", &black, &white, 0.967_401),
            ("green, blue", &green, &blue, 1.0),
            ("greys", &grey, &image(&|_, _| [110; 3]), 0.153_483),
            ("noise", &noise[0], &noise[1], 0.383_135),
            ("discs", &discs[0], &discs[1], 0.128_882),
            ("gradient, noise", &gradient, &noise[0], 0.802_497),
            ("grey, noise", &grey, &noise[1], 0.574_227),
            ("gradient, disc", &gradient, &discs[0], 0.856_073),
            ("smaller than the filters", &tiny[0], &tiny[1], 0.568_484),
        ] {
            let found = flip(a, b, 67.0).unwrap();
            // Theirs is in f32; square roots of feature differences near 0 amplify its rounding.
            assert!(
                (found - expected).abs() < 2e-4,
                "{name}: {found} {expected}"
            );
        }
    }

    #[test]
    fn equal_is_zero_and_order_does_not_matter() {
        let [a, b] = [1, 2].map(|seed| codes(30, 150, &|x, y| noise_code(seed, x, y)));
        assert_eq!(of(&a, &a), 0.0);
        assert!((of(&a, &b) - of(&b, &a)).abs() < 1e-12);
        assert_eq!(flip(&Image::new(0, 0), &Image::new(0, 0), 67.0), None);
    }

    #[test]
    fn grows_with_noise() {
        let clean = constant(64, 64, [0.2, 0.3, 0.1]);
        let found = [0.0, 0.01, 0.03, 0.1].map(|amplitude| of(&clean, &noisy(&clean, amplitude)));
        assert!(found.is_sorted_by(|a, b| a < b), "{found:?}");
    }
}
