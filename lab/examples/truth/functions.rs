//! Defines transfer functions over the field: thin, smooth, hard, and many-coloured.

use ewa_splat::Result;
use ewa_splat::scene::{ColourSpace, ControlPoint, TransferFunction};

/// Length over which opacities are stated.
pub(crate) const UNIT: f64 = 0.1;

/// Value, opacity over [`UNIT`], linear colour.
pub(crate) type Point = (f32, f32, [f32; 3]);

const BLUE: [f32; 3] = [0.2, 0.5, 1.0];
const ORANGE: [f32; 3] = [1.0, 0.6, 0.2];

pub(crate) const FUNCTIONS: [(&str, &[Point]); 4] = [
    (
        "shells",
        &[
            (0.27, 0.0, BLUE),
            (0.30, 0.9, BLUE),
            (0.33, 0.0, BLUE),
            (0.57, 0.0, ORANGE),
            (0.60, 0.98, ORANGE),
            (0.63, 0.0, ORANGE),
        ],
    ),
    ("smooth", &[(0.15, 0.0, BLUE), (1.0, 0.7, ORANGE)]),
    (
        "step",
        &[(0.3, 0.0, BLUE), (0.3, 0.95, BLUE), (1.0, 0.95, ORANGE)],
    ),
    // The whole box is visible: its faces show.
    (
        "rainbow",
        &[
            (0.0, 0.05, [0.3, 0.0, 0.8]),
            (0.15, 0.08, [0.0, 0.2, 1.0]),
            (0.3, 0.12, [0.0, 0.9, 0.9]),
            (0.45, 0.16, [0.0, 1.0, 0.1]),
            (0.6, 0.2, [1.0, 1.0, 0.0]),
            (0.75, 0.25, [1.0, 0.3, 0.0]),
            (0.9, 0.3, [1.0, 0.0, 0.3]),
            (1.05, 0.35, [1.0, 1.0, 1.0]),
        ],
    ),
];

pub(crate) fn transfer(points: &[Point]) -> Result<TransferFunction> {
    let points: Vec<ControlPoint> = points
        .iter()
        .map(|&(value, opacity, colour)| ControlPoint {
            value,
            colour: Some(colour),
            opacity: Some(opacity),
        })
        .collect();
    TransferFunction::from_points(&points, ColourSpace::Linear, [0.0, 1.25], UNIT)
}
