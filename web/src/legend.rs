//! Describes colour bars for the page, which draws them itself.

use ewa_splat::legend::ColourBar;
use serde_json::{Value, json};

/// Number of colours along a bar.
const COLOURS: u16 = 64;
/// Greatest number of labels.
const LABELS: usize = 7;

/// Describes a bar: its title, labels with their heights, and sRGB colours with opacities (1 for opaque ones).
pub(crate) fn described(bar: &ColourBar) -> Value {
    let colours = (0..COLOURS).map(|i| {
        let (rgb, opacity) = bar.at(f64::from(i) / f64::from(COLOURS - 1));
        let [r, g, b] = rgb.map(ewa_splat::image::srgb_from_linear);
        [r, g, b, opacity.unwrap_or(1.0)]
    });
    json!({
        "title": bar.title(),
        "labels": bar.labels(LABELS),
        "colours": colours.collect::<Vec<_>>(),
    })
}
