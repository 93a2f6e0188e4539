//! Defines colour spaces for interpolation, and named colour maps.

use colorgrad::Gradient;

use super::{TransferDefaults, TransferFunction};
use crate::error::{Error, Parameter, Result};
use crate::image::linear_from_srgb;

/// The names that [`TransferFunction::named`] accepts.
pub const COLOUR_MAP_NAMES: [&str; 12] = [
    "viridis",
    "plasma",
    "inferno",
    "magma",
    "cividis",
    "turbo",
    "coolwarm",
    "grayscale",
    "gray",
    "jet",
    "hot",
    "rainbow",
];

/// Positions and values of red, green and blue in matplotlib's `jet`, sRGB.
const JET: [&[[f32; 2]]; 3] = [
    &[
        [0.0, 0.0],
        [0.35, 0.0],
        [0.66, 1.0],
        [0.89, 1.0],
        [1.0, 0.5],
    ],
    &[
        [0.0, 0.0],
        [0.125, 0.0],
        [0.375, 1.0],
        [0.64, 1.0],
        [0.91, 0.0],
        [1.0, 0.0],
    ],
    &[
        [0.0, 0.5],
        [0.11, 1.0],
        [0.34, 1.0],
        [0.65, 0.0],
        [1.0, 0.0],
    ],
];

/// Positions and values of red, green and blue in matplotlib's `hot`, sRGB.
const HOT: [&[[f32; 2]]; 3] = [
    &[[0.0, 0.0416], [0.365_079, 1.0], [1.0, 1.0]],
    &[[0.0, 0.0], [0.365_079, 0.0], [0.746_032, 1.0], [1.0, 1.0]],
    &[[0.0, 0.0], [0.746_032, 0.0], [1.0, 1.0]],
];

/// The hue at the lower end of VTK's `rainbow`, blue, in turns; the other end is red.
const RAINBOW_HUE: f32 = 2.0 / 3.0;

/// Opacity per unit distance at the top of a named map's ramp. With the mean spacing as unit distance, a few
/// dozen bright samples hide what is behind them; faint samples do not.
const NAMED_PEAK_OPACITY: f32 = 0.2;

/// Ends and middle of Moreland's cool-to-warm map (K. Moreland, "Diverging Color Maps for
/// Scientific Visualization", 2009, table 1), sRGB.
const COOLWARM: [[f32; 3]; 3] = [
    [0.23, 0.299, 0.754],
    [0.865, 0.865, 0.865],
    [0.706, 0.016, 0.15],
];

/// Encoding of control points' colours, and the space of their interpolation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourSpace {
    /// sRGB-encoded, interpolated as encoded (also ParaView's `RGB`).
    Srgb,
    /// Linear RGB, interpolated as such.
    Linear,
    /// sRGB-encoded, interpolated in CIE L*a*b* under D65. ParaView's `Diverging` maps are drawn with this too.
    /// ParaView's Msh space bends the path between two saturated colours through white; a map with its neutral
    /// middle among its points does not need that.
    Lab,
    /// sRGB-encoded, interpolated in hue (the shorter way round), saturation and value.
    Hsv,
}

impl ColourSpace {
    /// The linear colour at fraction `s` of the way from `a` to `b`.
    pub(super) fn mix_to_linear(self, a: [f32; 3], b: [f32; 3], s: f32) -> [f32; 3] {
        let lerp = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|i| a[i] + (b[i] - a[i]) * s);
        match self {
            Self::Linear => lerp(a, b),
            Self::Srgb => lerp(a, b).map(linear_from_srgb),
            Self::Lab => linear_from_lab(lerp(
                lab_from_linear(a.map(linear_from_srgb)),
                lab_from_linear(b.map(linear_from_srgb)),
            ))
            .map(|x| x.clamp(0.0, 1.0)),
            Self::Hsv => {
                let (mut a, mut b) = (hsv_from_rgb(a), hsv_from_rgb(b));
                // A grey has no hue: it takes the other's.
                if a[1] <= 0.0 {
                    a[0] = b[0];
                } else if b[1] <= 0.0 {
                    b[0] = a[0];
                }
                b[0] -= (b[0] - a[0]).round();
                rgb_from_hsv(lerp(a, b)).map(linear_from_srgb)
            }
        }
    }
}

/// White of D65 in CIE XYZ, Y = 1 (IEC 61966-2-1).
const WHITE: [f32; 3] = [0.950_47, 1.0, 1.088_83];

/// CIE L*a*b* (1976) of linear sRGB.
fn lab_from_linear([r, g, b]: [f32; 3]) -> [f32; 3] {
    let xyz = [
        0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b,
        0.212_672_9 * r + 0.715_152_2 * g + 0.072_175 * b,
        0.019_333_9 * r + 0.119_192 * g + 0.950_304_1 * b,
    ];
    let f = |t: f32| {
        if t > 216.0 / 24389.0 {
            t.cbrt()
        } else {
            (24389.0 / 27.0 * t + 16.0) / 116.0
        }
    };
    let [x, y, z]: [f32; 3] = std::array::from_fn(|i| f(xyz[i] / WHITE[i]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The inverse of [`lab_from_linear`]; results may lie outside 0..1.
fn linear_from_lab([l, a, b]: [f32; 3]) -> [f32; 3] {
    let y = (l + 16.0) / 116.0;
    let g = |t: f32| {
        if t > 6.0 / 29.0 {
            t.powi(3)
        } else {
            (116.0 * t - 16.0) * 27.0 / 24389.0
        }
    };
    let (x, y, z) = (
        WHITE[0] * g(y + a / 500.0),
        WHITE[1] * g(y),
        WHITE[2] * g(y - b / 200.0),
    );
    [
        3.240_454_2 * x - 1.537_138_5 * y - 0.498_531_4 * z,
        -0.969_266 * x + 1.876_010_8 * y + 0.041_556 * z,
        0.055_643_4 * x - 0.204_025_9 * y + 1.057_225_2 * z,
    ]
}

/// Hue (turns), saturation, value.
fn hsv_from_rgb([r, g, b]: [f32; 3]) -> [f32; 3] {
    let value = r.max(g).max(b);
    let chroma = value - r.min(g).min(b);
    if chroma <= 0.0 {
        return [0.0, 0.0, value];
    }
    let hue = if value <= r {
        (g - b) / chroma
    } else if value <= g {
        2.0 + (b - r) / chroma
    } else {
        4.0 + (r - g) / chroma
    };
    [(hue / 6.0).rem_euclid(1.0), chroma / value, value]
}

/// The inverse of [`hsv_from_rgb`].
fn rgb_from_hsv([h, s, v]: [f32; 3]) -> [f32; 3] {
    [5.0, 3.0, 1.0].map(|n| {
        let k = (n + 6.0 * h).rem_euclid(6.0);
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

/// A linear colour, interpolated linearly between the points of each channel.
fn piecewise(channels: [&[[f32; 2]]; 3], s: f32) -> [f32; 3] {
    channels.map(|points| {
        let s = s.clamp(0.0, 1.0);
        let value = match super::segment(points, |p| p[0], s) {
            Some((a, b, t)) => points[a][1] + (points[b][1] - points[a][1]) * t,
            None => 0.0,
        };
        linear_from_srgb(value)
    })
}

/// A linear colour for each position in a range, 0..1.
pub(super) type ColourMap = Box<dyn Fn(f32) -> [f32; 3]>;

/// The map with a neutral colour in its middle.
pub(super) const DIVERGING: &str = "coolwarm";

/// Returns whether a map has a neutral colour in its middle.
pub(crate) fn is_diverging(name: &str) -> bool {
    name.eq_ignore_ascii_case(DIVERGING)
}

/// The map of [`colour_map`], or an error that lists the known names.
pub(super) fn known_map(name: &str) -> Result<ColourMap> {
    colour_map(name).ok_or_else(|| {
        Error::invalid(
            Parameter::TransferFunction,
            format!("name `{name}`"),
            format!("one of {}", COLOUR_MAP_NAMES.join(", ")),
            "no colour map of that name",
            "name one of these, or a .json file",
        )
    })
}

/// The linear colour of a named map at `s`, 0..1; `None` for an unknown name.
pub(super) fn colour_map(name: &str) -> Option<ColourMap> {
    fn encoded(gradient: impl Gradient + 'static) -> ColourMap {
        Box::new(move |s| {
            let c = gradient.at(s.clamp(0.0, 1.0));
            [c.r, c.g, c.b].map(|x| linear_from_srgb(x.clamp(0.0, 1.0)))
        })
    }
    use colorgrad::preset;
    Some(match name.to_ascii_lowercase().as_str() {
        "viridis" => encoded(preset::viridis()),
        "plasma" => encoded(preset::plasma()),
        "inferno" => encoded(preset::inferno()),
        "magma" => encoded(preset::magma()),
        "cividis" => encoded(preset::cividis()),
        "turbo" => encoded(preset::turbo()),
        "coolwarm" => Box::new(|s| {
            let [cool, neutral, warm] = COOLWARM;
            let s = 2.0 * s.clamp(0.0, 1.0);
            if s < 1.0 {
                ColourSpace::Lab.mix_to_linear(cool, neutral, s)
            } else {
                ColourSpace::Lab.mix_to_linear(neutral, warm, s - 1.0)
            }
        }),
        "jet" => Box::new(|s| piecewise(JET, s)),
        "hot" => Box::new(|s| piecewise(HOT, s)),
        "rainbow" => Box::new(|s| {
            let hue = RAINBOW_HUE * (1.0 - s.clamp(0.0, 1.0));
            rgb_from_hsv([hue, 1.0, 1.0]).map(linear_from_srgb)
        }),
        "grayscale" | "gray" => Box::new(|s| [linear_from_srgb(s.clamp(0.0, 1.0)); 3]),
        _ => return None,
    })
}

impl TransferFunction {
    /// A named colour map over the data's range, with an opacity that rises linearly from 0 to 0.2 per unit
    /// distance.
    ///
    /// Names (case-insensitive): [`COLOUR_MAP_NAMES`]. The maps are the crate `colorgrad`'s splines and
    /// polynomials, within a few 255ths of the published tables. But `coolwarm` is Moreland's, interpolated in
    /// L*a*b*; `jet` and `hot` are matplotlib's, and `rainbow` is VTK's from blue to red.
    ///
    /// # Errors
    /// An unknown name (the message lists the known ones); defaults that are no range or no
    /// length.
    pub fn named(name: &str, defaults: &TransferDefaults) -> Result<Self> {
        let map = known_map(name)?;
        let fraction = over_range(defaults.range);
        Self::from_curves(
            |value| map(fraction(value)),
            |value| NAMED_PEAK_OPACITY * fraction(value),
            defaults.range,
            defaults.unit_distance,
        )
    }
}

/// The position of a value in a range, 0..1; 0.5 in an empty range (constant data).
pub(super) fn over_range([lo, hi]: [f32; 2]) -> impl Fn(f32) -> f32 {
    let (lo, span) = (f64::from(lo), f64::from(hi) - f64::from(lo));
    move |value| {
        if span > 0.0 {
            #[expect(clippy::cast_possible_truncation, reason = "0..1")]
            {
                ((f64::from(value) - lo) / span).clamp(0.0, 1.0) as f32
            }
        } else {
            0.5
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DEFAULTS: TransferDefaults = TransferDefaults {
        range: [-1.0, 3.0],
        unit_distance: 0.5,
    };

    #[test]
    fn every_name_is_known_and_the_message_lists_them() {
        for name in COLOUR_MAP_NAMES {
            let t = TransferFunction::named(name, &DEFAULTS).unwrap();
            assert_eq!(t.range(), DEFAULTS.range, "{name}");
            assert!(t.classify(-1.0)[3].abs() < 1e-9, "{name}");
            let expected = -(0.8f32.ln()) / 0.5;
            assert!((t.classify(3.0)[3] - expected).abs() < 1e-5, "{name}");
        }
        let message = TransferFunction::named("parula", &DEFAULTS)
            .unwrap_err()
            .to_string();
        assert!(message.contains("viridis, plasma") && message.contains("parula"));
    }

    #[test]
    fn viridis_has_its_published_ends() {
        let map = colour_map("Viridis").unwrap();
        // matplotlib's table: #440154 and #fde725; colorgrad interpolates samples of it.
        for (s, published) in [(0.0, [0x44, 0x01, 0x54]), (1.0, [0xfd, 0xe7, 0x25])] {
            let colour = map(s).map(crate::image::srgb_from_linear);
            for (c, p) in colour.iter().zip(published) {
                assert!((c * 255.0 - p as f32).abs() < 2.0, "{colour:?}");
            }
        }
    }

    #[test]
    fn older_maps_have_their_published_colours() {
        for (name, s, published) in [
            ("jet", 0.0, [0.0, 0.0, 0.5]),
            ("jet", 0.5, [0.483_871, 1.0, 0.483_871]),
            ("jet", 1.0, [0.5, 0.0, 0.0]),
            ("hot", 0.0, [0.0416, 0.0, 0.0]),
            ("hot", 0.5, [1.0, 0.354_166, 0.0]),
            ("hot", 1.0, [1.0, 1.0, 1.0]),
            ("rainbow", 0.0, [0.0, 0.0, 1.0]),
            ("rainbow", 0.5, [0.0, 1.0, 0.0]),
            ("rainbow", 1.0, [1.0, 0.0, 0.0]),
        ] {
            let colour = colour_map(name).unwrap()(s);
            for (c, p) in colour.iter().zip(published) {
                // Rounding of f32.
                assert!(
                    (c - linear_from_srgb(p)).abs() < 1e-5,
                    "{name} {s}: {colour:?}"
                );
            }
        }
    }

    #[test]
    fn hsv_goes_the_shorter_way_round() {
        // Magenta to yellow passes red, not cyan.
        let [r, g, b] = ColourSpace::Hsv.mix_to_linear([1.0, 0.0, 1.0], [1.0, 1.0, 0.0], 0.5);
        assert!(r > 0.999 && g < 1e-5 && b < 1e-5);
    }

    proptest! {
        #[test]
        fn every_space_keeps_its_ends(
            a in prop::array::uniform3(0.0f32..=1.0),
            b in prop::array::uniform3(0.0f32..=1.0),
        ) {
            for space in [ColourSpace::Srgb, ColourSpace::Lab, ColourSpace::Hsv] {
                for (s, end) in [(0.0, a), (1.0, b)] {
                    let got = space.mix_to_linear(a, b, s);
                    for i in 0..3 {
                        // 2e-4: the seven-digit matrices are inverses to about 1e-6 and
                        // L*a*b*'s cube amplifies f32 rounding some hundred times.
                        prop_assert!((got[i] - linear_from_srgb(end[i])).abs() < 2e-4,
                            "{space:?} {a:?} {b:?} {s}: {got:?}");
                    }
                }
            }
        }
    }
}
