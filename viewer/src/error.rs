//! A picture of another's errors.

use ewa_splat::Image;

/// Decades of errors that are told apart, the asked tolerance at two thirds of them.
const DECADES: f32 = 3.0;

/// Each pixel in the colour of its greatest difference in linear colour: black below a hundredth of the tolerance, through blue and
/// green to yellow at the tolerance, and red from ten times as much on.
pub(crate) fn shown(image: &Image, truth: &Image, tolerance: f32) -> Image {
    let mut shown = image.clone();
    for (pixel, exact) in shown.pixels.iter_mut().zip(&truth.pixels) {
        let differences = pixel.iter().zip(exact).map(|(a, b)| (a - b).abs());
        let error = differences.fold(0.0, f32::max);
        *pixel = colour((error / tolerance).log10() + 2.0);
    }
    shown
}

/// The colour of an error of so many decades above a hundredth of the tolerance.
fn colour(decades: f32) -> [f32; 4] {
    const STOPS: [[f32; 3]; 5] = [
        [0.0, 0.0, 0.0],
        [0.02, 0.05, 0.5],
        [0.02, 0.4, 0.15],
        [0.9, 0.8, 0.1],
        [0.9, 0.05, 0.02],
    ];
    // The fourth stop is the tolerance itself.
    let place = match decades {
        d if d <= 2.0 => d.max(0.0) * 1.5,
        d => 3.0 + (d.min(DECADES) - 2.0),
    };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "from 0 to the last stop"
    )]
    let below = (place as usize).min(STOPS.len() - 2);
    let t = place - below as f32;
    let [r, g, b] =
        std::array::from_fn(|i| STOPS[below][i] + (STOPS[below + 1][i] - STOPS[below][i]) * t);
    [r, g, b, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tolerance_is_yellow() {
        let image = |x: f32| Image {
            width: 1,
            height: 1,
            pixels: vec![[0.5, x, 0.5, 1.0]],
        };
        let at = |error: f32| shown(&image(0.25 + error), &image(0.25), 0.01).pixels[0];
        assert_eq!(at(0.0), [0.0, 0.0, 0.0, 1.0]);
        let [r, g, b, _] = at(0.01);
        assert!((r - 0.9).abs() < 0.02 && (g - 0.8).abs() < 0.02 && (b - 0.1).abs() < 0.02);
        let [r, g, b, _] = at(0.2);
        assert!((r - 0.9).abs() < 1e-6 && (g - 0.05).abs() < 1e-6 && (b - 0.02).abs() < 1e-6);
        assert!(at(0.0005)[2] > at(0.0005)[0]);
    }
}
